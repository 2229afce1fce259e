"""Terms that differ between two databases, their groups, and their exchange."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import xarray as xr

import aerodb
from flightmech.aircraft.controls import ICE
from flightmech.errors import UnknownName

# Variables of a configuration or a control. Terms with one of them among their axes or regressors
# form a group.
_VARIABLES = ("delta_f", "gear", "speedbrake", ICE, "h_agl", "delta_e", "delta_a", "delta_r")
_SUBMODEL_OF_PART = {
    "engine": "engine",
    "gear": "landing gear",
    "circuit": "control loading",
    "fuel": "fuel",
}
_RULES = ("regressors", "outside", "power", "exponent", "floor")
_TABLES = ("value", "K1", "K2")


def differing_terms(prior: xr.DataTree, final: xr.DataTree) -> list[str]:
    """Return the names of terms that differ between two databases or exist in only one."""
    prior_terms, final_terms = aerodb.terms(prior), aerodb.terms(final)
    different = []
    # Terms of either database; a missing term differs.
    for name in {**prior_terms, **final_terms}:
        if not _is_same(prior_terms.get(name), final_terms.get(name)):
            different.append(name)
    return different


def _is_same(first: xr.Dataset | None, second: xr.Dataset | None) -> bool:
    """Whether two terms have equal tables and rules."""
    if first is None or second is None:
        return False
    if contribution_rules(first) != contribution_rules(second):
        return False
    for name in _TABLES:
        if name not in first and name not in second:
            continue
        if name not in first or name not in second:
            return False
        if not _is_same_table(first[name], second[name]):
            return False
    return True


def _is_same_table(first: xr.DataArray, second: xr.DataArray) -> bool:
    """Whether two tables have equal axes and values; NaN equals NaN.

    `DataArray.equals` imports dask, if it is installed: a third of a second of each match.
    """
    if first.dims != second.dims or set(first.coords) != set(second.coords):
        return False
    pairs = [(first.values, second.values)]
    for name in first.coords:
        pairs.append((first.coords[name].values, second.coords[name].values))
    return all(np.array_equal(one, other, equal_nan=True) for one, other in pairs)


def contribution_rules(leaf: xr.Dataset) -> dict[str, Any]:
    """Return the attributes that define how the table of a term contributes."""
    return {key: leaf.attrs.get(key) for key in _RULES}


def groups_of(
    prior: xr.DataTree,
    final: xr.DataTree,
    names: Sequence[str],
    wanted: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, tuple[str, ...]]:
    """Return the groups of terms and parts that are swapped as a whole, by name.

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
        A pattern of `wanted` does not match a name that differs.
    """
    parts, terms = [], []
    for name in names:
        if name.split("/")[0] in _SUBMODEL_OF_PART:
            parts.append(name)
        else:
            terms.append(name)
    leaves = [aerodb.terms(prior), aerodb.terms(final)]
    candidates: dict[str, list[str]] = {}
    for coefficient in _list_heads(terms):
        candidates[f"{coefficient}/*"] = _names_below(coefficient, terms)
    # Terms that depend on a control or on the configuration, by axis or by regressor.
    variables = {name: _variables_of(leaves, name) for name in terms}
    for variable in _VARIABLES:
        members = [name for name in terms if variable in variables[name]]
        candidates[f"*({variable})"] = members
    for submodel in _list_heads(parts):
        candidates[f"{submodel}/*"] = _names_below(submodel, parts)
    # The circuits are parts of the aircraft, and the hinge moments are terms.
    loading = [name for name in names if name.startswith(("circuit/", "Ch_"))]
    candidates["control loading"] = loading
    candidates["C*/*"] = terms
    # A group of one member or of all names repeats another swap.
    groups: dict[str, tuple[str, ...]] = {}
    for key, members in candidates.items():
        if 1 < len(members) < len(names) and tuple(members) not in groups.values():
            groups[key] = tuple(members)
    for key, patterns in (wanted or {}).items():
        groups[key] = _match_patterns(key, patterns, names)
    return groups


def _list_heads(names: Iterable[str]) -> list[str]:
    """Return the first parts of names, each once."""
    heads = [name.split("/")[0] for name in names]
    return list(dict.fromkeys(heads))


def _names_below(head: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(f"{head}/")]


def _variables_of(leaves: Sequence[Mapping[str, xr.Dataset]], name: str) -> set[str]:
    """Return the axes and regressors of a term in either database."""
    variables: set[str] = set()
    for terms in leaves:
        if name in terms:
            variables.update(map(str, terms[name].dims))
            variables.update(str(terms[name].attrs.get("regressors", "")).split())
    return variables


def _match_patterns(key: str, patterns: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the names that match the patterns of a group, each once."""
    matches: dict[str, None] = {}
    for pattern in patterns:
        members = [name for name in names if fnmatchcase(name, pattern)]
        if not members:
            raise UnknownName(pattern, names, "term or part that differs", f"group {key!r}")
        matches |= dict.fromkeys(members)
    return tuple(matches)


def swap_terms(
    prior: xr.DataTree,
    final: xr.DataTree,
    names: Iterable[str],
    why: Mapping[str, str] | None = None,
) -> xr.DataTree:
    """Return `prior` with the named terms of `final`; terms that `final` lacks are deleted.

    Names that are not terms of either database, such as parts of the aircraft, are ignored.

    Parameters
    ----------
    prior, final : DataTree
        Two databases of one aircraft.
    names : iterable of str
        Terms to copy from `final`.
    why : mapping of str to str, optional
        Reason by name: a line for the history of the term.
    """
    reasons = why or {}
    final_terms, prior_terms = aerodb.terms(final), aerodb.terms(prior)
    replacements: dict[str, xr.Dataset] = {}
    deletions: list[str] = []
    for name in names:
        if name in final_terms:
            replacements[name] = _add_history(final_terms[name], reasons.get(name, ""))
        elif name in prior_terms:
            deletions.append(name)
    swapped = aerodb.replace_terms(prior, replacements, "term swap")
    if not deletions:
        return swapped
    note = "term swap"
    lines = "; ".join(f"{name}: {reasons[name]}" for name in deletions if name in reasons)
    if lines:
        note = f"term swap; {lines}"
    return aerodb.delete_terms(swapped, deletions, note)


def _add_history(leaf: xr.Dataset, line: str) -> xr.Dataset:
    """Return a term with one more line in its history."""
    if not line:
        return leaf
    history = str(leaf.attrs.get("history", ""))
    if history:
        line = f"{history}\n{line}"
    return leaf.assign_attrs(history=line)


def by_submodel(names: Iterable[str], *databases: xr.DataTree) -> dict[str, list[str]]:
    """Return terms and parts by the submodel to which they belong.

    Parameters
    ----------
    names : iterable of str
        Terms, and parts of the aircraft, such as `corrected_terms` returns them.
    *databases : DataTree
        Databases that hold the terms.

    Returns
    -------
    dict of str to list of str
        ``aerodynamics``, ``ground effect`` (terms over the height), ``control loading`` (circuits
        and hinge moments), ``engine``, ``landing gear``, ``fuel``; only those that have a member.
    """
    leaves = [aerodb.terms(db) for db in databases]
    members: dict[str, list[str]] = {}
    for name in names:
        members.setdefault(_submodel_of(name, leaves), []).append(name)
    order = ("aerodynamics", "ground effect", *_SUBMODEL_OF_PART.values())
    return {submodel: members[submodel] for submodel in order if submodel in members}


def _submodel_of(name: str, leaves: Sequence[Mapping[str, xr.Dataset]]) -> str:
    """Return the submodel of one term or part."""
    head = name.split("/")[0]
    if head in _SUBMODEL_OF_PART:
        return _SUBMODEL_OF_PART[head]
    if head.startswith("Ch_"):
        return "control loading"
    if "h_agl" in _variables_of(leaves, name):
        return "ground effect"
    return "aerodynamics"
