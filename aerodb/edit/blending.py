"""Blending of two databases of one aircraft by their standard errors.

Rule ``inverse_variance`` treats every node of the union of the breakpoints by itself.  With values
v and standard errors s,

    v = v_1 + s_1^2/(s_1^2 + s_2^2) (v_2 - v_1),    1/s^2 = 1/s_1^2 + 1/s_2^2
    chi2 = sum (v_2 - v_1)^2/(s_1^2 + s_2^2)

Rule ``correlated`` treats all nodes of a table together (mixed estimation [Theil1961]_).  The nodes
of the second table are independent observations y = H v, R = diag(s_2^2), of the first table.  The
errors of the first have the covariance P of `aerodb.update.correlation`.

    G = P H' (H P H' + R)^-1,    v = v_1 + G (y - H v_1),    cov = P - G H P
    chi2 = (y - H v_1)' (H P H' + R)^-1 (y - H v_1)

The first rule assumes that DATCOM is in error at each node independently.  The second assumes that
it is in error along the table, so that a correction reaches nodes that the second database does not
have.  Along an axis that only the first has, a node of the second is compared with the mean of the
first (in H).  It does not count once per breakpoint.

References
----------
.. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int. Econ.
   Rev. 2, 1961.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.edit.outside_rules import compare_outside_rules
from aerodb.edit.term_edits import match_names
from aerodb.store.grids import (
    fold_factors,
    has_same_table,
    is_within,
    known_source,
    node_text,
    regrid_leaf,
    same_factors,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.store.schema import terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit
from aerodb.update.correlation import prior_covariance
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.flown_samples import with_flown_samples

RULES = ("inverse_variance", "correlated")
# Probability of chi-square below which two tables disagree by more than their errors.
UNLIKELY = 0.01
# A node has the second source if that reduced the standard error below this share.
COUNTED = 0.9
_SAME = ("S", "cbar", "b", "x_ref", "y_ref", "z_ref", "force_axes")
_MOST_NAMES = 5  # of terms in a problem
_AGREE = 1e-6  # relative and absolute difference of equal quantities
_PSEUDO_INVERSE = 1e-12  # eigenvalue over the largest, below which it counts as zero
COLUMNS = ("nodes", "chi2", "probability", "worst", "location")


def blend(
    db: xr.DataTree,
    other: xr.DataTree,
    names: str | Iterable[str] | None = None,
    rule: str = "inverse_variance",
    *,
    note: str = "",
) -> xr.DataTree:
    """Return a database with its terms blended with those of another one.

    Parameters
    ----------
    db : DataTree
        The database, such as the prior; it does not change.
    other : DataTree
        Independent information on the same terms.  A result of `tabulate` already contains its
        prior and is not independent.
    names : str or iterable of str, optional
        Terms, or patterns; the default is every common term.
    rule : {"inverse_variance", "correlated"}
        Nodes by themselves, or all nodes of a table together with the correlations of
        `aerodb.update.correlation` for `db`.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        Tables over the union of the breakpoints.  A standard error of zero means exact.  A node
        that only one table has keeps its value (with ``correlated`` it is corrected by its
        neighbours).  A node beyond both has the value of `db` by the rule of the leaf.  A node has
        the source of `other` if that reduced its standard error below 0.9 of the former one, else
        that of `db`.

    Raises
    ------
    UnknownName
        A term that one of the two does not have, or an unknown rule.
    SchemaError
        Reference quantities or axes differ, terms have other regressors or no standard errors, both
        are exact and differ, or both are the same table; all faults.

    Warns
    -----
    AeromatchWarning
        Terms that disagree by more than their errors: chi-square with a probability below 0.01.
        Terms whose rules ``outside`` differ; the rule of `db` holds.

    References
    ----------
    .. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int.
    Econ. Rev. 2, 1961.
    """
    pairs = _match_pairs(db, other, names, rule)
    table = _compare_pairs(pairs, rule)
    leaves, problems = terms(db), []
    for name, pair in pairs.items():
        try:
            new = _blend_pair(pair, rule)
        except SchemaError as error:
            problems += [f"{name}: {fault}" for fault in error.problems]
            continue
        row = table.loc[name]
        line = f"blend: {rule}, chi-square {row.chi2:.4g} of {row.nodes} nodes{note_suffix(note)}"
        leaves[name] = add_history_line(new, line)
        rules = {"here": pair.ours, "there": pair.theirs}
        if remark := compare_outside_rules(name, rules):
            warnings.warn(f"blend: {remark}", AeromatchWarning, stacklevel=2)
            leaves[name] = add_history_line(leaves[name], remark)
    if problems:
        raise SchemaError("blend", problems)
    # Disagreeing terms are blended nevertheless.
    disagreements = []
    for term, row in table[table["probability"] < UNLIKELY].iterrows():
        disagreements.append(
            f"{term} (chi-square {row.chi2:.4g} of {row.nodes} nodes, {row.worst:.3g} at "
            f"{row.location})"
        )
    if disagreements:
        summary = "; ".join(disagreements)
        text = f"blend: tables disagree by more than their standard errors: {summary}"
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    title = str(other.attrs["title"])
    summary = f"{' '.join(pairs)} with {title!r}, {rule}"
    # the blend rests on the flights of both
    attributes = with_flown_samples(db.attrs, other.attrs)
    return record_edit(db, leaves, "blend", summary=summary, note=note, attributes=attributes)


def consistency(
    db: xr.DataTree,
    other: xr.DataTree,
    names: str | Iterable[str] | None = None,
    rule: str = "inverse_variance",
) -> pd.DataFrame:
    """Return the agreement of two databases within their standard errors, before blending.

    Parameters
    ----------
    db, other, names, rule
        As in `blend`.

    Returns
    -------
    DataFrame, index ``term``
        ``nodes`` (number of nodes of `other` within the table of `db`, unless both are exact
        there), ``chi2`` and its ``probability`` for as many nodes, ``worst`` (largest difference
        other - db in its standard error, signed) and ``location``.  Correlated errors of `db` make
        the probability too small or too large unless the rule is ``correlated``.

    Raises
    ------
    UnknownName, SchemaError
        As in `blend`.
    """
    return _compare_pairs(_match_pairs(db, other, names, rule), rule)


@dataclass(frozen=True)
class _TermPair:
    """A term of both databases, with equal factors."""

    ours: xr.Dataset
    theirs: xr.Dataset


def _match_pairs(
    db: xr.DataTree, other: xr.DataTree, names: str | Iterable[str] | None, rule: str
) -> dict[str, _TermPair]:
    """Return the terms to blend by name; raise with all faults."""
    if rule not in RULES:
        raise UnknownName(rule, RULES, "rule")
    # Faults of all terms are collected, unknown names raise at once.
    ours, theirs = terms(db), terms(other)
    if names is None:
        selected = [name for name in ours if name in theirs]
    else:
        selected = match_names(db, names)
    problems = []
    for key in _SAME:
        if not _is_same_quantity(db.attrs[key], other.attrs[key]):
            problems.append(f"{key} is {db.attrs[key]!r} here and {other.attrs[key]!r} there")
    if not selected:
        problems.append(
            "the two have no term in common; aerodb.replace_terms(db, aerodb.terms(other)) adds "
            "the terms of the other"
        )
    pairs = {}
    for name in selected:
        if name not in theirs:
            raise UnknownName(name, theirs, "term", "the other database does not have it")
        problems += _pair_faults(name, ours[name], theirs[name])
        pair = _TermPair(ours[name], theirs[name])
        # Different factors are multiplied into the tables.
        if not same_factors(pair.ours, pair.theirs):
            pair = _TermPair(fold_factors(pair.ours), fold_factors(pair.theirs))
        pairs[name] = pair
    repeated = [name for name, pair in pairs.items() if _is_repeated(pair)]
    if repeated:
        more = f" and {len(repeated) - _MOST_NAMES} more" if len(repeated) > _MOST_NAMES else ""
        problems.append(
            f"{', '.join(repeated[:_MOST_NAMES])}{more}: both databases hold the same "
            f"values and standard errors; the same numbers twice are one source, and their blend "
            f"would state smaller errors without new knowledge: give an independent database, or "
            f"name the terms to blend"
        )
    if problems:
        raise SchemaError("blend", problems)
    return pairs


def _is_repeated(pair: _TermPair) -> bool:
    """Return whether both tables of a term are the same, with errors that a blend would reduce."""
    is_same = has_same_table(pair.ours, pair.theirs)
    return is_same and "stderr" in pair.ours and bool((pair.ours["stderr"] > 0.0).any())


def _pair_faults(name: str, ours: xr.Dataset, theirs: xr.Dataset) -> list[str]:
    """Return the reasons why two terms cannot be blended."""
    problems = []
    for leaf, location in ((ours, "here"), (theirs, "there")):
        if "stderr" not in leaf:
            problems.append(f"{name}: no stderr {location}; give one to every node")
    our_regressors = " ".join(_terms.list_multipliers(ours)) or "none"
    their_regressors = " ".join(_terms.list_multipliers(theirs)) or "none"
    if our_regressors != their_regressors:
        problems.append(
            f"{name}: regressors {our_regressors} here and {their_regressors} there; only tables "
            f"of the same meaning can be joined"
        )
    return problems


def _is_same_quantity(first: Any, second: Any) -> bool:
    """Return whether two root attributes are equal, numbers within rounding."""
    if isinstance(first, str):
        return first == second
    return bool(np.isclose(float(first), float(second), rtol=_AGREE, atol=_AGREE))


def _compare_pairs(pairs: dict[str, _TermPair], rule: str) -> pd.DataFrame:
    """Return the table of `consistency`."""
    rows = {name: _consistency_row(pair, rule) for name, pair in pairs.items()}
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS))
    return table.rename_axis("term")


@dataclass(frozen=True)
class _NodeObservations:
    """Observations of our nodes g by the nodes of the other database within our table.

    y = H g + e, cov(e) = diag(s^2).
    """

    points: dict[str, np.ndarray]
    H: np.ndarray  # (observations, nodes)
    y: np.ndarray
    s: np.ndarray


def _observe_table(table: xr.Dataset, pair: _TermPair) -> _NodeObservations:
    """Return the observations of `table`, which is our term on any grid."""
    # Nodes of the other database beyond our table do not observe it.
    our_points = value_breakpoints(pair.ours)
    points = {}
    for axis, axis_points in value_breakpoints(pair.theirs).items():
        if axis in our_points:
            axis_points = axis_points[is_within(our_points[axis], axis_points)]
        points[axis] = axis_points
    # Axes that only our table has: the mean along them is observed.
    other_points = {}
    for axis, axis_points in value_breakpoints(table).items():
        if axis not in points:
            other_points[axis] = axis_points
    count = int(np.prod([len(axis_points) for axis_points in points.values()]))
    repeats = int(np.prod([len(axis_points) for axis_points in other_points.values()]))
    size = table["value"].size
    if not count:
        return _NodeObservations(points, np.zeros((0, size)), y=np.zeros(0), s=np.zeros(0))
    axes = {**points, **other_points}
    samples = {}
    if axes:
        for axis, grid in zip(axes, np.meshgrid(*axes.values(), indexing="ij")):
            samples[axis] = grid.ravel()
    B = _terms.basis(_terms.without_multipliers(table[["value"]]), samples, "clamp").toarray()
    # Mean over the axes that the other database does not have.
    by_observation = np.broadcast_to(B, (count * repeats, size)).reshape(count, repeats, size)
    theirs = pair.theirs.sel(points)
    return _NodeObservations(
        points=points,
        H=by_observation.mean(axis=1),
        y=theirs["value"].values.ravel(),
        s=theirs["stderr"].values.ravel(),
    )


def _consistency_row(pair: _TermPair, rule: str) -> tuple[int, float, float, float, str]:
    """Return the row of one term, in the order of `COLUMNS`."""
    observed = _observe_table(pair.ours, pair)
    r = observed.y - observed.H @ pair.ours["value"].values.ravel()
    variance = (observed.H @ pair.ours["stderr"].values.ravel()) ** 2 + observed.s**2
    # Nodes that are exact in both do not count.
    uncertain = variance > 0.0
    if not uncertain.any():
        return 0, 0.0, 1.0, float("nan"), ""
    in_errors = np.divide(r, np.sqrt(variance), out=np.zeros_like(r), where=uncertain)
    worst = int(np.argmax(np.abs(in_errors)))
    if rule == "correlated":
        H = observed.H[uncertain]
        A = H @ prior_covariance(pair.ours) @ H.T + np.diag(observed.s[uncertain] ** 2)
        chi2 = float(r[uncertain] @ _invert_covariance(A) @ r[uncertain])
    else:
        chi2 = float((in_errors**2).sum())
    count = int(uncertain.sum())
    node: list[int] = []
    if observed.points:
        sizes = [len(axis_points) for axis_points in observed.points.values()]
        node = list(map(int, np.unravel_index(worst, sizes)))
    probability = float(scipy.stats.chi2.sf(chi2, count))
    return count, chi2, probability, float(in_errors[worst]), node_text(observed.points, node)


def _blend_pair(pair: _TermPair, rule: str) -> xr.Dataset:
    """Return the blended term over the union of the breakpoints."""
    points = union_axes(pair.ours, pair.theirs)
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "blend",
            [f"the axes {' '.join(points)} of the two together are more than {_terms.MAX_AXES}"],
        )
    ours, theirs = regrid_leaf(pair.ours, points), regrid_leaf(pair.theirs, points)
    in_ours, in_theirs = _is_inside(pair.ours, points), _is_inside(pair.theirs, points)
    in_both, only_theirs = in_ours & in_theirs, in_theirs & ~in_ours
    v1, v2 = ours["value"].values, theirs["value"].values
    s1, s2 = ours["stderr"].values, theirs["stderr"].values
    # Two exact nodes with different values cannot be blended.
    differs = ~np.isclose(v1, v2, rtol=_AGREE, atol=1e-12)
    contradiction = in_both & (s1 == 0.0) & (s2 == 0.0) & differs
    if contradiction.any():
        location = node_text(points, list(map(int, np.argwhere(contradiction)[0])))
        raise SchemaError(
            "blend",
            [
                f"both are exact (standard error 0) and differ at {location} and "
                f"{int(contradiction.sum()) - 1} more nodes"
            ],
        )
    # Correction of our values, and the standard errors after it.
    if rule == "correlated":
        correction, error = _correct_together(ours, pair)
    else:
        correction, error = _correct_nodes(in_both, v2 - v1, s1, s2)
    value = np.where(only_theirs, v2, v1 + correction)
    stderr = np.where(only_theirs, s2, error)
    from_theirs = only_theirs | (in_both & (stderr < COUNTED * s1))
    source = np.where(from_theirs, known_source(theirs), known_source(ours))
    return with_table(ours, points, value=value, stderr=stderr, source=source)


def _correct_nodes(
    in_both: np.ndarray, difference: np.ndarray, s1: np.ndarray, s2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return correction and standard error of each node by itself.

    A node that is not in both tables keeps its value and the first standard error.
    """
    # Share s1^2 / (s1^2 + s2^2) of the difference; exact nodes are not corrected.
    variance = s1**2 + s2**2
    share = np.zeros_like(difference)
    np.divide(s1**2, variance, out=share, where=in_both & (variance > 0.0))
    return share * difference, np.where(in_both, np.sqrt(share) * s2, s1)


def _correct_together(ours: xr.Dataset, pair: _TermPair) -> tuple[np.ndarray, np.ndarray]:
    """Return correction and standard error of all nodes of a table together."""
    P, observed = prior_covariance(ours), _observe_table(ours, pair)
    shape = ours["value"].shape
    A = observed.H @ P @ observed.H.T + np.diag(observed.s**2)
    uncertain = np.diag(A) > 0.0
    # G = P H' (H P H' + R)^-1; exact observations of exact nodes do not count.
    H = observed.H[uncertain]
    G = P @ H.T @ _invert_covariance(A[np.ix_(uncertain, uncertain)])
    residual = (observed.y - observed.H @ ours["value"].values.ravel())[uncertain]
    variance = np.diag(P) - np.einsum("ij,ij->i", G, P @ H.T)
    stderr = np.sqrt(np.maximum(variance, 0.0))
    return (G @ residual).reshape(shape), stderr.reshape(shape)


def _invert_covariance(A: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance that may be singular, scaled to a unit diagonal first."""
    scale = np.outer(np.sqrt(np.diag(A)), np.sqrt(np.diag(A)))
    return np.linalg.pinv(A / scale, rcond=_PSEUDO_INVERSE, hermitian=True) / scale


def _is_inside(leaf: xr.Dataset, points: dict[str, np.ndarray]) -> np.ndarray:
    """Return which nodes of a grid are within the table of a leaf, array of bool."""
    inside = np.ones([len(axis_points) for axis_points in points.values()], bool)
    for dimension, (axis, axis_points) in enumerate(points.items()):
        if axis in leaf["value"].dims:
            # One axis of the grid, broadcast along the others.
            along_axis = [1] * len(points)
            along_axis[dimension] = -1
            within = is_within(value_breakpoints(leaf)[axis], axis_points)
            inside &= within.reshape(along_axis)
    return inside
