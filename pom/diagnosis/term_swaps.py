"""Terms and parts exchanged between two models: which differ, which belong together, and the
corrected model with its provenance.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.compiler import changed_parameters
from flightmech.support.kept_stages.content_hashes import content_hash

# what a configuration or a control is made of: terms with one of these among their axes or
# regressors make a group
_VARIABLES = ("delta_f", "gear", "speedbrake", "h_agl", "delta_e", "delta_a", "delta_r")
_PARTS_OF = {
    "engine": "engine",
    "gear": "landing gear",
    "circuit": "control loading",
    "fuel": "fuel",
}
_SUBMODELS = tuple(_PARTS_OF)
_RULES = ("regressors", "outside", "power", "exponent", "floor")


def differing_terms(prior: xr.DataTree, final: xr.DataTree) -> list[str]:
    """Return the names of the terms that are not the same in both databases, or only in one of
    them.
    """
    ours, theirs = aerodb.terms(prior), aerodb.terms(final)
    return [name for name in {**ours, **theirs} if not _same(ours.get(name), theirs.get(name))]


def _same(a: xr.Dataset | None, b: xr.Dataset | None) -> bool:
    if a is None or b is None:
        return False
    tables = [name for name in ("value", "K1", "K2") if name in a or name in b]
    return _rules(a) == _rules(b) and all(
        name in a and name in b and a[name].equals(b[name]) for name in tables
    )


def _rules(leaf: xr.Dataset) -> dict[str, Any]:
    """Return what makes a contribution of the table of a term."""
    return {key: leaf.attrs.get(key) for key in _RULES}


def groups_of(
    prior: xr.DataTree,
    final: xr.DataTree,
    names: Sequence[str],
    wanted: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, tuple[str, ...]]:
    """Return the groups of terms and parts that are worth a swap as a whole, by name.

    Parameters
    ----------
    prior, final : DataTree
        The two databases.
    names : sequence of str
        The terms, and parts of the aircraft, that differ.
    wanted : mapping of str to sequence of str, optional
        Further groups: names or patterns, ``{"nose leg and ground": ["gear/nose", "C?/ground*"]}``.

    Returns
    -------
    dict of str to tuple of str
        ``Cm/*`` all of a coefficient, ``*(gear)`` all terms that depend on a variable, ``engine/*``
        all parts of a submodel, ``control loading`` the circuits and the hinge moments, ``C*/*``
        all terms (and no parts), and those that are `wanted`.  Groups of one, of all, and
        repetitions are left out.

    Raises
    ------
    UnknownName
        A pattern of `wanted` means nothing that differs.
    """
    parts = [name for name in names if name.split("/")[0] in _SUBMODELS]
    terms = [name for name in names if name not in parts]
    leaves = [aerodb.terms(db) for db in (prior, final)]
    found = {
        f"{coefficient}/*": [name for name in terms if name.startswith(f"{coefficient}/")]
        for coefficient in _heads(terms)
    }
    found |= {
        f"*({variable})": [name for name in terms if variable in _depends(leaves, name)]
        for variable in _VARIABLES
    }
    found |= {
        f"{model}/*": [name for name in parts if name.startswith(f"{model}/")]
        for model in _heads(parts)
    }
    found |= {"control loading": [name for name in names if name.startswith(("circuit/", "Ch_"))]}
    found |= {"C*/*": terms}
    kept: dict[str, tuple[str, ...]] = {}
    for key, members in found.items():
        if 1 < len(members) < len(names) and tuple(members) not in kept.values():
            kept[key] = tuple(members)
    return kept | {key: _meant(key, patterns, names) for key, patterns in (wanted or {}).items()}


def _heads(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(name.split("/")[0] for name in names))


def _depends(leaves: Sequence[Mapping[str, xr.Dataset]], name: str) -> set[str]:
    """Return the axes and regressors of a term in either database."""
    found: set[str] = set()
    for terms in leaves:
        if name in terms:
            found |= set(map(str, terms[name].dims)) | set(
                str(terms[name].attrs.get("regressors", "")).split()
            )
    return found


def _meant(key: str, patterns: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    for pattern in patterns:
        meant = [name for name in names if fnmatchcase(name, pattern)]
        if not meant:
            raise UnknownName(pattern, names, "term or part that differs", f"group {key!r}")
        found |= dict.fromkeys(meant)
    return tuple(found)


def swap_terms(
    prior: xr.DataTree,
    final: xr.DataTree,
    names: Iterable[str],
    why: Mapping[str, str] | None = None,
) -> xr.DataTree:
    """Return `prior` with the named terms as they are in `final`; a term that `final` does not have
    is taken out.

    Names that are terms of neither, such as parts of the aircraft, are passed over.

    Parameters
    ----------
    prior, final : DataTree
        Two databases of one aircraft.
    names : iterable of str
        Terms to take from `final`.
    why : mapping of str to str, optional
        By name: a line for the history of the term.
    """
    theirs, ours = aerodb.terms(final), aerodb.terms(prior)
    names = [name for name in names if name in theirs or name in ours]
    taken = {
        name: _with_line(theirs[name], (why or {}).get(name, ""))
        for name in names
        if name in theirs
    }
    swapped = aerodb.replace_terms(prior, taken, "term swap")
    gone = [name for name in names if name not in theirs]
    reasons = "; ".join(f"{name}: {why[name]}" for name in gone if why and name in why)
    return (
        aerodb.delete_terms(swapped, gone, f"term swap; {reasons}" if reasons else "term swap")
        if gone
        else swapped
    )


def _with_line(leaf: xr.Dataset, line: str) -> xr.Dataset:
    history = [text for text in (str(leaf.attrs.get("history", "")), line) if text]
    return leaf.assign_attrs(history="\n".join(history)) if line else leaf


def by_submodel(names: Iterable[str], *databases: xr.DataTree) -> dict[str, list[str]]:
    """Return terms and parts by the submodel to which they belong.

    Parameters
    ----------
    names : iterable of str
        Terms, and parts of the aircraft, such as `corrected_terms` returns them.
    *databases : DataTree
        That hold the terms.

    Returns
    -------
    dict of str to list of str
        ``aerodynamics``, ``ground effect`` (terms over the height), ``control loading`` (circuits
        and hinge moments), ``engine``, ``landing gear``, ``fuel``; only those that have a member.
    """
    leaves = [aerodb.terms(db) for db in databases]
    found: dict[str, list[str]] = {}
    for name in names:
        head = name.split("/")[0]
        submodel = _PARTS_OF.get(head) or ("control loading" if head.startswith("Ch_") else "")
        submodel = submodel or (
            "ground effect" if "h_agl" in _depends(leaves, name) else "aerodynamics"
        )
        found.setdefault(submodel, []).append(name)
    return {
        submodel: found[submodel]
        for submodel in ("aerodynamics", "ground effect", *_PARTS_OF.values())
        if submodel in found
    }


def corrected_terms(diagnoses: Iterable[pd.DataFrame]) -> list[str]:
    """Return the terms and parts that several diagnoses needed, alone and together, in the order of
    the share each explains alone.

    Parameters
    ----------
    diagnoses : iterable of DataFrame
        From `diagnose` or `join_diagnoses`.
    """
    share: dict[str, float] = {}
    for table in diagnoses:
        alone = _explained(table, "single")
        for name in [*_terms(table, "sequence"), *_terms(table, "joint")]:
            share[name] = float(np.fmax(share.get(name, -np.inf), alone.get(name, 0.0)))
    return sorted(share, key=lambda name: -share[name])


def joint_terms(diagnoses: Mapping[str, pd.DataFrame]) -> dict[str, list[str]]:
    """Return what the corrected model takes further since the terms of one case change another, by
    the case for which.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `join_diagnoses`.
    """
    found = {case: _terms(table, "joint") for case, table in diagnoses.items()}
    return {case: names for case, names in found.items() if names}


def correction_reasons(diagnoses: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Return, by term or part that the corrected model takes, which cases need it and what it
    explains there.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose` or `join_diagnoses`.
    """
    found: dict[str, list[str]] = {}
    for case, table in diagnoses.items():
        alone, share = _explained(table, "single"), _explained(table, "share")
        for name in _terms(table, "sequence"):
            part = f", share {100.0 * share[name]:.0f} %" if name in share else ""
            found.setdefault(name, []).append(
                f"{case} (alone {100.0 * alone[name]:.0f} % of the gap{part})"
            )
    why = {name: f"needed by {'; '.join(texts)}" for name, texts in found.items()}
    for case, names in joint_terms(diagnoses).items():
        why |= {
            name: f"added for {case}, which does not pass with what each case needs alone"
            for name in names
        }
    return {name: why[name] for name in corrected_terms(diagnoses.values())}


def _terms(table: pd.DataFrame, stage: str) -> list[str]:
    return [name for name in table.loc[table["stage"] == stage, "term"] if name]


def _explained(table: pd.DataFrame, stage: str) -> dict[str, float]:
    rows = table[table["stage"] == stage]
    return dict(zip(rows["term"], rows["explained"], strict=True))


def corrected_database(
    prior: xr.DataTree, final: xr.DataTree, diagnoses: Mapping[str, pd.DataFrame], source: str = ""
) -> xr.DataTree:
    """Return the a-priori database with only the terms of the final one that the cases need: the
    corrected model of LR-743, 5.2.

    The history of every term that was taken states from where and for which cases.

    Parameters
    ----------
    prior, final : DataTree
        The databases that were diagnosed.
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose`.
    source : str, optional
        What to call `final` in the history; its title without it.
    """
    why = _lines(diagnoses, source or str(final.attrs.get("title", "the final database")))
    found = swap_terms(prior, final, why, why)
    found.attrs["title"] = (
        f"{prior.attrs['aircraft']}: a-priori database with the terms that the diagnosis needs"
    )
    return found


def corrected_aircraft(
    apriori: Aircraft, final: Aircraft, diagnoses: Mapping[str, pd.DataFrame], source: str = ""
) -> Aircraft:
    """Return the a-priori aircraft with only the parts of the final one that the cases need, and
    why in its history.

    Parameters
    ----------
    apriori, final : Aircraft
        The aircraft before and after the flights.
    diagnoses, source
        As in `corrected_database`.
    """
    why = _lines(diagnoses, source or final.name)
    taken = [name for name in different_parts(apriori, final) if name in why]
    history = [apriori.history, *(f"{name}: {why[name]}" for name in taken)]
    return (
        replace(swap_parts(apriori, final, taken), history="\n".join(filter(None, history)))
        if taken
        else apriori
    )


def _lines(diagnoses: Mapping[str, pd.DataFrame], source: str) -> dict[str, str]:
    return {
        name: f"pom diagnose: from {source}, {text}"
        for name, text in correction_reasons(diagnoses).items()
    }


_FINAL = "_of_final"


@dataclass(frozen=True)
class SwapModels:
    """Two models of one aeroplane, and every mixture of them.

    The scale parameters of the terms, 0 or 1, choose among the terms of one compiled model; parts
    that differ in constants only, such as a leg of the gear, are chosen by their parameters; every
    choice of other parts, such as the tables of an engine, is a compiled model of its own, made
    once for all cases that fly it, from any thread.

    Attributes
    ----------
    prior, final : DataTree
        The tables of the two databases.
    aircraft : tuple of Aircraft
        A priori and final.
    terms, parts : tuple of str
        What differs.
    constants : dict of str to (dict of str to float, dict of str to float)
        By part that differs in constants only: its parameters a priori and final.
    """

    prior: xr.DataTree
    final: xr.DataTree
    aircraft: tuple[Aircraft, Aircraft]
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    constants: dict[str, tuple[dict[str, float], dict[str, float]]]
    both: xr.DataTree = field(repr=False)
    _sims: dict[frozenset[str], Any] = field(default_factory=dict, repr=False)
    _lock: Any = field(default_factory=Lock, repr=False)

    @classmethod
    def of(
        cls, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft]
    ) -> SwapModels:
        """Return the mixtures of two databases and of two aircraft, a priori and final."""
        names = tuple(differing_terms(prior, final))
        ours, theirs = (
            {name: _flown(leaf) for name, leaf in aerodb.terms(db).items()} for db in (prior, final)
        )
        both = ours | {name + _FINAL: theirs[name] for name in names if name in theirs}
        trees = [
            _tree(attrs, leaves)
            for attrs, leaves in ((prior.attrs, ours), (final.attrs, theirs), (prior.attrs, both))
        ]
        parts = tuple(different_parts(*aircraft))
        return cls(
            trees[0], trees[1], aircraft, names, parts, _constants(aircraft, parts), trees[2]
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process without what is compiled, which a process makes for itself."""
        return SwapModels, (
            self.prior,
            self.final,
            self.aircraft,
            self.terms,
            self.parts,
            self.constants,
            self.both,
        )

    def compiled(self, parts: Collection[str]) -> Any:
        """Return the compiled model with those parts of the final aircraft, from `compiled_parts`.

        Raises
        ------
        SchemaError
            The parts make no aircraft, as tables of two engines that make no deck together.
        """
        chosen = frozenset(parts)
        with self._lock:
            if chosen not in self._sims:
                names = [name for name in self.parts if name in chosen]
                try:
                    self._sims[chosen] = flightmech.compile(
                        swap_parts(*self.aircraft, names), self.both
                    )
                except SchemaError as error:
                    self._sims[chosen] = error
        found = self._sims[chosen]
        if isinstance(found, SchemaError):
            raise found
        return found

    def compiled_parts(self, names: Collection[str]) -> frozenset[str]:
        """Return the named parts that a compiled model has to hold, since they differ in more than
        constants.
        """
        return frozenset(
            name for name in self.parts if name in names and name not in self.constants
        )

    def choice(self, names: Collection[str]) -> dict[str, float]:
        """Return the parameters with which the model compiled with `compiled_parts` has the named
        terms and parts of the final one.
        """
        prior, final = self._values
        chosen = dict(prior)
        for name in names:
            chosen |= final.get(name, {})
        return chosen

    @cached_property
    def content(self) -> dict[str, str]:
        """The hash of what each term or part of the final model flies, by name; by the empty name
        that of what every mixture has: the form of all terms, and what differs.
        """
        leaves = aerodb.terms(self.final)
        found = {name: content_hash(name, leaves.get(name)) for name in self.terms}
        found |= {name: content_hash(name, self._flown_part(name)) for name in self.parts}
        forms = {
            name: ({str(axis): leaf[axis].values for axis in leaf.dims}, _rules(leaf))
            for name, leaf in aerodb.terms(self.both).items()
        }
        return found | {"": content_hash(forms, self.terms, self.parts, sorted(self.constants))}

    def _flown_part(self, name: str) -> Any:
        """Return what a part of the final aircraft flies: its constants, else an aircraft that
        differs in nothing else from the a-priori one; the final one where there is none such.
        """
        if name in self.constants:
            return self.constants[name]
        try:
            aircraft = swap_parts(*self.aircraft, [name])
        except SchemaError:
            aircraft = self.aircraft[1]
        return replace(aircraft, history="")

    @cached_property
    def _values(self) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
        """The parameters of the a-priori model, and by name what a term or part of the final one
        changes of them.
        """
        prior: dict[str, float] = {}
        final: dict[str, dict[str, float]] = {}
        for name in self.terms:
            one, other = (f"term.{name.replace('/', '.')}{end}" for end in ("", _FINAL))
            prior |= {one: 1.0, other: 0.0}
            final[name] = {one: 0.0, other: 1.0}
        for part, (before, after) in self.constants.items():
            prior |= before
            final[part] = after
        return prior, final


def _constants(
    aircraft: tuple[Aircraft, Aircraft], parts: Collection[str]
) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Return the parameters, a priori and final, of parts that differ in nothing else."""
    found = {}
    for part in parts:
        try:
            swapped = swap_parts(*aircraft, [part])
        except SchemaError:  # it makes no aircraft without other parts
            continue
        if changed := changed_parameters(aircraft[0], swapped):
            found[part] = (
                {name: one for name, (one, _) in changed.items()},
                {name: other for name, (_, other) in changed.items()},
            )
    return found


def _tree(attributes: Mapping[Any, Any], leaves: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return terms by name as a database."""
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attributes), **leaves})


def _flown(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term without what does not fly: standard errors, sources, covariances, the texts of
    its history.
    """
    tables = [name for name in ("value", "K1", "K2") if name in leaf]
    return leaf[tables]
