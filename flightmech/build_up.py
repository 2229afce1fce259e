"""Dependences between the coefficients of a model, and the order of their evaluation.

A term may have coefficients among its variables. For example, the drag polar ``CD0 + k CL^2`` is a
term of ``CD`` with the regressors ``CL CL``, and a measured polar is a table of ``CD`` over ``CL``.
The coefficients have their values at the same instant: all terms of ``CL`` are summed first, then
the terms of ``CD``. The *level* of a coefficient is the number of such steps. It is 0 if its terms
depend on no coefficient. Otherwise it is one more than the highest level among the coefficients
that its terms depend on. Coefficients that depend on each other in a loop have no order. The loop
is an error, and the message has its path.
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
# coefficients that a term may depend on, if its model has them
COEFFICIENTS = ("CL", "CD", "CY", *_MOMENTS, "CX", "CZ")


def coefficient_inputs(force_axes: str) -> dict[str, tuple[str, ...]]:
    """Return the coefficients that terms may depend on, and the inputs of each.

    The inputs are the coefficients of the model from which the coefficient is computed.

    Examples
    --------
    >>> coefficient_inputs("body")["CL"]
    ('CX', 'CZ')
    """
    inputs: dict[str, tuple[str, ...]] = {name: (name,) for name in _model_coefficients(force_axes)}
    if force_axes == "body":
        # lift and drag are the components of CX and CZ in stability axes
        inputs |= {"CL": ("CX", "CZ"), "CD": ("CX", "CZ")}
    return inputs


def _model_coefficients(force_axes: str) -> tuple[str, ...]:
    return (*FORCES[force_axes], *_MOMENTS)


def used_coefficients(leaf: xr.Dataset) -> set[str]:
    """Return the coefficients among the variables of a term."""
    return list_model_variables(leaf) & set(COEFFICIENTS)


def required_coefficients(leaf: xr.Dataset, force_axes: str) -> set[str]:
    """Return the coefficients of the model that must be complete before a term is evaluated."""
    inputs = coefficient_inputs(force_axes)
    required: set[str] = set()
    for name in used_coefficients(leaf):
        required.update(inputs.get(name, ()))
    return required


def evaluation_levels(
    leaves: Mapping[str, xr.Dataset], force_axes: str
) -> tuple[dict[str, int], list[str]]:
    """Return the level of each coefficient, and the problems that prevent an order.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        Terms by name, ``"CD/polar"``, including the terms of hinge moments and engines.
    force_axes : {"stability", "wind", "body"}
        Axes of the forces.

    Returns
    -------
    levels : dict of str to int
        Level of each coefficient of the model. All levels are 0 if there are problems.
    problems : list of str
        Coefficients that the model does not have, and the first loop.
    """
    allowed = coefficient_inputs(force_axes)
    problems = []
    for name, leaf in leaves.items():
        # a model with body axes has no CL, but CL can be computed from CX and CZ
        for unknown in sorted(used_coefficients(leaf) - set(allowed)):
            problems.append(
                f"{name}: depends on {unknown}, which a model with force_axes {force_axes} does "
                f"not have; allowed: {', '.join(allowed)}"
            )
    graph = _dependence_graph(leaves, force_axes)
    coefficients = _model_coefficients(force_axes)
    for name in coefficients:
        if loop := _find_loop(graph, [name]):
            problems.append(_describe_loop(graph, loop))
            break
    if problems:
        return dict.fromkeys(coefficients, 0), problems
    return {name: _coefficient_level(graph, name) for name in coefficients}, []


def term_level(leaf: xr.Dataset, of: Mapping[str, int], force_axes: str) -> int:
    """Return the level of a term, 0 if it depends on no coefficient.

    Parameters
    ----------
    leaf : Dataset
    of : mapping of str to int
        Level of each coefficient.
    force_axes : {"stability", "wind", "body"}
    """
    return max((of[name] + 1 for name in required_coefficients(leaf, force_axes)), default=0)


# by coefficient: the coefficients that its terms require, each with the first term that does
_Graph = Mapping[str, Mapping[str, str]]


def _dependence_graph(leaves: Mapping[str, xr.Dataset], force_axes: str) -> _Graph:
    graph: dict[str, dict[str, str]] = {}
    for name, leaf in leaves.items():
        for required in sorted(required_coefficients(leaf, force_axes)):
            graph.setdefault(name.split("/")[0], {}).setdefault(required, name)
    return graph


def _find_loop(graph: _Graph, path: list[str]) -> list[str]:
    """Return a loop back to the first coefficient of a path, empty if there is none.

    In the result each coefficient is required by the next one.
    """
    for required in graph.get(path[-1], {}):
        if required == path[0]:
            return [required, *reversed(path)]
        if required not in path and (loop := _find_loop(graph, [*path, required])):
            return loop
    return []


def _describe_loop(graph: _Graph, loop: list[str]) -> str:
    terms = dict.fromkeys(graph[after][before] for before, after in pairwise(loop))
    return (
        f"{' -> '.join(loop)} (terms {', '.join(terms)}): a coefficient cannot depend on itself; "
        f"take one of these terms out"
    )


def _coefficient_level(graph: _Graph, name: str) -> int:
    required = graph.get(name, {})
    return max((_coefficient_level(graph, item) + 1 for item in required), default=0)
