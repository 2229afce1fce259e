"""A-priori database of an aeroplane from several sources, and what each of them states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import chain

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.edit.joined_sources.convention_faults import (
    ConventionFault,
    compare_pairs,
    find_convention_faults,
)
from aerodb.edit.joined_sources.neutral_points import compare_neutral_points
from aerodb.edit.joined_sources.prior_sources import (
    PriorSource,
    collect_tables,
    label_sources,
    list_repeated_sources,
    refer_to_aircraft,
)
from aerodb.edit.joined_sources.source_blending import BlendedTerm, blend_term
from aerodb.edit.joined_sources.source_nodes import (
    HELD_ERROR,
    cover_ranges,
    speaking,
    spread_on_grid,
)
from aerodb.edit.outside_rules import compare_outside_rules
from aerodb.prior.sources import warn_user
from aerodb.store.grids import is_within, regrid_leaf, union_axes, value_breakpoints
from aerodb.store.overview import ORIGIN, plain_number
from aerodb.store.schema import make_prior_database, scheme_order, terms
from aerodb.store.undo_history import add_history_line
from aerodb.update.cautions.notices import NOTICES, note_plausibility, notices_of, with_notices
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.short_text import ShortText

_JOINED = ("references", "comment")
_OTHER_AREA = 0.05  # difference of reference areas that shows in coefficients
# Difference of two sources from which on one of them is wrong. [standard errors]
_FAR = 8.0
# Root attributes that the blend sets itself.
_OWN = (
    *("title", "aircraft", "S", "cbar", "b", "x_ref", "y_ref", "z_ref", "force_axes", "source"),
    *("history", "absent", "edits", NOTICES, *_JOINED),
)


@dataclass(frozen=True)
class PriorBlend(ShortText):
    """An a-priori database from several sources.

    Attributes
    ----------
    database : DataTree
    table : DataFrame
        Index ``term``; ``sources``, ``where`` (node of the largest disagreement), for each source a
        column with its value and one with its standard error (``AVL``, ``AVL stderr``), ``taken``,
        ``taken stderr``, ``nodes``, ``chi2``, ``probability``, ``worst`` [standard errors],
        ``decision`` (``blended``, ``widened``, or ``only`` and the source).
    """

    database: xr.DataTree
    table: pd.DataFrame

    def report(self) -> str:
        """Return the table of the terms as text."""
        return self.table.drop(columns="sources").to_string(na_rep="", float_format="%.4g")


def blend_sources(
    databases: Sequence[xr.DataTree],
    aircraft: Aircraft,
    *,
    take: Mapping[str, str] | None = None,
    methods: Sequence[str] | None = None,
    move_reference: bool = False,
) -> PriorBlend:
    """Return the a-priori database of several sources, blended by the covariance of their errors.

    Parameters
    ----------
    databases : sequence of DataTree
        A-priori databases of one aeroplane, such as of `aerodb.from_datcom` and
        `aerodb.from_estimate`, with forces in stability axes.
    aircraft : Aircraft
        Its reference quantities and reference point are those of the result.  Without a reference
        point that of the first database is used.
    take : mapping of str to str, optional
        Term, or a pattern such as ``"Cn/*"``, to the one source that it is taken from: a label such
        as ``AVL``.
    methods : sequence of str, optional
        Method of each database, empty for that of its program.  Sources of one method have common
        errors; two wind-tunnel tables of different tunnels may be two methods.
    move_reference : bool
        Permit a distance of more than 0.1 chord between a reference point and that of the aircraft.

    Returns
    -------
    PriorBlend
        Terms over the union of the breakpoints.  A term of one source is taken as it is.  The
        attribute ``origin`` of a term names its sources, its history what each of them states.

    Raises
    ------
    SchemaError
        Less than two databases, one that is not a-priori or is a blend, one twice, force axes other
        than stability axes, regressors of a term that differ, sources with opposite signs far
        beyond their errors, or sources that differ by a usual slip of units, signs or reference
        quantities (`aerodb.edit.joined_sources.convention_faults`), or sources of a term
        that are eight standard errors from each other; all faults.
    UnknownName
        An unknown term or source in `take`.

    Warns
    -----
    AeromatchWarning
        Terms whose sources disagree by more than their standard errors, which are widened; other
        reference quantities; neutral points that are far apart; rules ``outside`` of a term that
        differ, of which that of the first source holds; an implausible value.

    Notes
    -----
    See `aerodb.edit.joined_sources.source_blending` for the equations, and
    `aerodb.edit.joined_sources.source_nodes` for what a source states between and beyond its nodes.
    """
    if len(databases) < 2:
        raise SchemaError("blend", [f"{len(databases)} source; give two databases or more"])
    given = [float(databases[0].attrs[key]) for key in ("x_ref", "y_ref", "z_ref")]
    point = given if aircraft.reference is None else list(aircraft.reference)
    referred, remarks = [], list[str]()
    for db in databases:
        tree, texts = refer_to_aircraft(db, aircraft, point, move_reference)
        referred.append(tree)
        remarks += texts
    sources = label_sources(referred, methods)
    if problems := list_repeated_sources(databases):
        raise SchemaError("blend", problems)
    by_term = _sources_by_term(sources, take or {})
    areas = [float(db.attrs["S"]) / aircraft.S for db in databases]
    faults = _find_faults(sources, by_term, aircraft, areas)
    blended = _blend_terms(sources, by_term, faults)
    disagreements = [fault.text for fault in faults] + _describe_disagreements(blended)
    disagreements += compare_neutral_points(by_term)
    for name, members in by_term.items():
        leaves = {source.label: terms(source.database)[name] for source in members}
        disagreements += filter(None, [compare_outside_rules(name, leaves)])
    for text in (*remarks, *disagreements):
        warn_user(text)
    tree = _make_tree(aircraft, sources, blended, point=point, notices=disagreements)
    tree, findings = note_plausibility(tree, aircraft)
    for finding in findings:
        if finding.kind in ("implausible", "unused"):
            warn_user(str(finding))
    return PriorBlend(tree, _tabulate_terms(sources, blended))


def _sources_by_term(
    sources: Sequence[PriorSource], take: Mapping[str, str]
) -> dict[str, list[PriorSource]]:
    """Return the sources of every term, one where `take` names it, in the order of the scheme."""
    names = dict.fromkeys(chain.from_iterable(terms(s.database) for s in sources))
    by_term = {}
    for name in sorted(names, key=scheme_order):
        by_term[name] = [s for s in sources if name in terms(s.database)]
    labels = {source.label: source for source in sources}
    for pattern, label in take.items():
        if label not in labels:
            raise UnknownName(label, labels, "source", f"take: {pattern}")
        matched = [name for name in by_term if fnmatchcase(name, pattern)]
        held = [name for name in matched if labels[label] in by_term[name]]
        if not held:
            raise UnknownName(pattern, terms(labels[label].database), "term", f"take from {label}")
        for name in held:
            by_term[name] = [labels[label]]
    return by_term


def _find_faults(
    sources: Sequence[PriorSource],
    by_term: Mapping[str, Sequence[PriorSource]],
    aircraft: Aircraft,
    areas: Iterable[float],
) -> list[ConventionFault]:
    """Return the disagreements over all terms that a usual slip explains."""
    cover = _basic_ranges(sources)
    pairs = []
    for name, members in by_term.items():
        if len(members) < 2:
            continue
        # `_blend_terms` raises for tables that cannot meet, with all other faults.
        with suppress(SchemaError):
            points, spread = spread_on_grid(collect_tables(members, name), cover)
            pairs += compare_pairs(name, points, spread, speaking(spread))
    other = [ratio for ratio in areas if abs(ratio - 1.0) > _OTHER_AREA]
    return find_convention_faults(pairs, aircraft.cbar, aircraft.b, other)


def _blend_terms(
    sources: Sequence[PriorSource],
    by_term: Mapping[str, Sequence[PriorSource]],
    faults: Iterable[ConventionFault],
) -> dict[str, BlendedTerm]:
    """Return every term; raise with the faults of all of them."""
    cover = _basic_ranges(sources)
    certain = [fault for fault in faults if fault.is_certain]
    explained = set(chain.from_iterable(fault.names for fault in certain))
    blended, problems = {}, [fault.text for fault in certain]
    for name, members in by_term.items():
        try:
            term = blend_term(name, collect_tables(members, name), cover)
            if len(members) == 1:
                term = replace(term, leaf=_cover_ranges(term.leaf, cover))
            blended[name] = term
            if name not in explained:
                problems += _find_far_sources(name, term)
        except SchemaError as error:
            problems += [] if name in explained else error.problems
    if problems:
        raise SchemaError("blend", problems)
    return blended


def _find_far_sources(name: str, term: BlendedTerm) -> list[str]:
    """Return the problem of two sources so far from each other that one of them is wrong."""
    worst = term.worst
    if worst is None or not term.is_widened or abs(worst.worst) < _FAR:
        return []
    first, second = worst.labels
    values = f"{first} {_format_pair(term.stated[first])}, {second} "
    values += _format_pair(term.stated[second])
    return [
        f"{name}: {first} and {second} disagree by {abs(worst.worst):.2g} standard errors "
        f"({values} at {term.location}): one of them is wrong, and a mean would be neither; "
        f"correct it, or decide for one: --take '{name}={first}' (take in a project)"
    ]


def _describe_disagreements(blended: Mapping[str, BlendedTerm]) -> list[str]:
    """Return a sentence on each term whose sources disagree by more than their errors."""
    texts = []
    for name, term in blended.items():
        if term.is_widened and term.worst is not None:
            first, second = term.worst.labels
            texts.append(
                f"{name}: {first} and {second} disagree by up to {abs(term.worst.worst):.2g} "
                f"standard errors ({term.location}; probability {term.worst.probability:.1g}); "
                f"the standard error of the blend reaches to both"
            )
    return texts


def _make_tree(
    aircraft: Aircraft,
    sources: Sequence[PriorSource],
    blended: Mapping[str, BlendedTerm],
    *,
    point: Sequence[float],
    notices: Sequence[str],
) -> xr.DataTree:
    """Return the database of the blended terms."""
    labels = ", ".join(source.label for source in sources)
    attributes: dict[str, str | float] = {}
    history, earlier = list[str](), list[str]()
    for source in sources:
        root = source.database.attrs
        for key, item in root.items():
            if key not in _OWN:
                attributes.setdefault(str(key), item)
        history += str(root.get("history", "")).splitlines()
        earlier += notices_of(root)
    for key in _JOINED:
        texts = dict.fromkeys(str(source.database.attrs.get(key, "")) for source in sources)
        if joined := "; ".join(filter(None, texts)):
            attributes[key] = joined
    shared = [name for name, term in blended.items() if len(term.labels) > 1]
    history.append(f"blend_sources: {labels}; {len(shared)} terms of several sources")
    leaves = {name: _leaf_of(name, term, sources) for name, term in blended.items()}
    return make_prior_database(
        aircraft,
        leaves,
        point,
        source=labels,
        history="\n".join(history),
        **attributes,
        **with_notices({}, [*earlier, *notices]),
    )


def _basic_ranges(sources: Sequence[PriorSource]) -> dict[str, tuple[float, float]]:
    """Return the ranges of Mach number and incidence of the basic lift of all sources.

    All tables cover them: a flight inside the basic tables then stays inside all tables.
    """
    basic = [terms(s.database)["CL/basic"] for s in sources if "CL/basic" in terms(s.database)]
    union = union_axes(*basic)
    ranges: dict[str, tuple[float, float]] = {}
    for axis in ("mach", "alpha"):
        if axis in union:
            ranges[axis] = float(union[axis][0]), float(union[axis][-1])
    return ranges


def _cover_ranges(leaf: xr.Dataset, cover: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """Return the term of one source that reaches over ranges.

    Added nodes hold the value of the end with twice its standard error.  They are judgement.
    """
    old = value_breakpoints(leaf)
    points = cover_ranges(old, cover)
    if all(len(points[axis]) == len(old[axis]) for axis in old):
        return leaf
    new = regrid_leaf(leaf, points)
    outside = np.zeros((), bool)
    for dimension, axis in enumerate(points):
        along = [-1 if k == dimension else 1 for k in range(len(points))]
        outside = outside | ~is_within(old[axis], points[axis]).reshape(along)
    if "stderr" not in new:
        return new
    stderr = new["stderr"].values
    widened = np.where(outside, HELD_ERROR * stderr, stderr)
    return new.assign(stderr=new["stderr"].copy(data=widened))


def _leaf_of(name: str, term: BlendedTerm, sources: Sequence[PriorSource]) -> xr.Dataset:
    """Return the leaf of a term with its sources, and a line on what they state."""
    leaf = term.leaf.assign_attrs({ORIGIN: ", ".join(term.labels)})
    if len(term.labels) == 1:
        return add_history_line(leaf, f"blend_sources: from {term.labels[0]}")
    parts = [terms(source.database)[name] for source in sources if source.label in term.labels]
    for key in _JOINED:
        texts = dict.fromkeys(str(part.attrs.get(key, "")) for part in parts)
        leaf = leaf.assign_attrs({key: "; ".join(filter(None, texts))})
    stated = [f"{label} {_format_pair(pair)}" for label, pair in term.stated.items()]
    line = f"{', '.join(stated)} at {term.location}; taken {_format_pair(term.taken)}"
    if term.worst is not None:
        line = (
            f"{line}; chi-square {term.worst.chi2:.4g} of {term.worst.nodes} nodes, probability "
            f"{term.worst.probability:.2g}"
        )
    if term.is_widened:
        line = f"{line}; standard error widened to reach all sources"
    return add_history_line(leaf, f"blend_sources: {line}")


def _format_pair(pair: Iterable[float]) -> str:
    value, stderr = pair
    return f"{plain_number(value)} +- {stderr:.2g}"


def _tabulate_terms(
    sources: Sequence[PriorSource], blended: Mapping[str, BlendedTerm]
) -> pd.DataFrame:
    """Return the table of `PriorBlend`."""
    rows = {}
    for name, term in blended.items():
        row: dict[str, object] = {"sources": ", ".join(term.labels), "where": term.location}
        for source in sources:
            value, stderr = term.stated.get(source.label, (float("nan"), float("nan")))
            row |= {source.label: value, f"{source.label} stderr": stderr}
        row["taken"], row["taken stderr"] = term.taken
        worst = term.worst
        if worst is not None:
            row |= {"nodes": worst.nodes, "chi2": worst.chi2, "probability": worst.probability}
            row["worst"] = worst.worst
        row["decision"] = "widened" if term.is_widened else "blended"
        if len(term.labels) == 1:
            row["decision"] = f"only {term.labels[0]}"
        rows[name] = row
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")
