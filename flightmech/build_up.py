"""Which coefficients of a model depend on which, and the order in which they are evaluated.

A term may have coefficients among its variables: the drag polar ``CD0 + k CL^2`` is a term of
``CD`` with the regressors ``CL CL``, a measured polar a table of ``CD`` over ``CL``.  They are
those of the same instant: all terms of ``CL`` are summed first, then those of ``CD``.  A *level* is
the number of such steps: 0 for a coefficient whose terms depend on none, else one more than the
highest of those that they depend on.  Coefficients that depend on each other in a loop have no
order and are refused with the path of the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

from flightmech.terms import list_model_variables

if TYPE_CHECKING:
    import xarray as xr

_MOMENTS = ("Cl", "Cm", "Cn")
FORCES = {"stability": ("CL", "CD", "CY"), "wind": ("CL", "CD", "CY"), "body": ("CX", "CY", "CZ")}
COEFFICIENTS = (
    "CL",
    "CD",
    "CY",
    *_MOMENTS,
    "CX",
    "CZ",
)  # that a term may depend on, as far as its model has them


def coefficient_inputs(force_axes: str) -> dict[str, tuple[str, ...]]:
    """Return the coefficients that terms of a model may depend on, and those of the model that each
    is made of.

    Examples
    --------
    >>> made_of("body")["CL"]
    ('CX', 'CZ')
    """
    found: dict[str, tuple[str, ...]] = {name: (name,) for name in (*FORCES[force_axes], *_MOMENTS)}
    return found | {"CL": ("CX", "CZ"), "CD": ("CX", "CZ")} if force_axes == "body" else found


def used_coefficients(leaf: xr.Dataset) -> set[str]:
    """Return the coefficients among the variables of a term."""
    return list_model_variables(leaf) & set(COEFFICIENTS)


def required_coefficients(leaf: xr.Dataset, force_axes: str) -> set[str]:
    """Return the coefficients of the model whose terms have to be summed before a term is
    evaluated.
    """
    known = coefficient_inputs(force_axes)
    return {part for name in used_coefficients(leaf) for part in known.get(name, ())}


def evaluation_levels(
    leaves: Mapping[str, xr.Dataset], force_axes: str
) -> tuple[dict[str, int], list[str]]:
    """Return the level of each coefficient and what stands against an order.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        Terms by name, ``"CD/polar"``; those of hinge moments and engines too.
    force_axes : {"stability", "wind", "body"}
        Axes of the forces.

    Returns
    -------
    levels : dict of str to int
        By coefficient of the model; 0 for all when there are problems.
    problems : list of str
        Coefficients that the model does not have, and the first loop.
    """
    known = coefficient_inputs(force_axes)
    problems = [
        f"{name}: depends on {word}, which a model with force_axes {force_axes} does not "
        f"have; allowed: {', '.join(known)}"
        for name, leaf in leaves.items()
        for word in sorted(used_coefficients(leaf) - set(known))
    ]
    graph: dict[str, dict[str, str]] = {}
    for name, leaf in leaves.items():
        for part in sorted(required_coefficients(leaf, force_axes)):
            graph.setdefault(name.split("/")[0], {}).setdefault(part, name)
    own = dict.fromkeys((*FORCES[force_axes], *_MOMENTS), 0)
    loop = next((found for name in own if (found := _loop(graph, [name]))), [])
    if loop:
        terms = ", ".join(dict.fromkeys(graph[after][before] for before, after in pairwise(loop)))
        problems.append(
            f"{' -> '.join(loop)} (terms {terms}): a coefficient cannot depend on itself; "
            f"take one of these terms out"
        )
    if problems:
        return own, problems
    return {name: _level(graph, name) for name in own}, []


def term_level(leaf: xr.Dataset, of: Mapping[str, int], force_axes: str) -> int:
    """Return the level of a term, given those of the coefficients: 0 when it depends on none."""
    return max((of[part] + 1 for part in required_coefficients(leaf, force_axes)), default=0)


def _loop(graph: Mapping[str, Mapping[str, str]], path: list[str]) -> list[str]:
    """Return a loop back to the first coefficient of a path, from what is needed to what needs it;
    empty when there is none.
    """
    for part in graph.get(path[-1], {}):
        if part == path[0]:
            return [part, *reversed(path)]
        if part not in path and (found := _loop(graph, [*path, part])):
            return found
    return []


def _level(graph: Mapping[str, Mapping[str, str]], name: str) -> int:
    return max((_level(graph, part) + 1 for part in graph.get(name, {})), default=0)
