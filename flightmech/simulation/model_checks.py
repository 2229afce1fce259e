"""Checks of a database before it is compiled with an aircraft."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.build_up import COEFFICIENTS, used_coefficients
from flightmech.errors import UnknownName
from flightmech.names import IMPLICIT
from flightmech.simulation.model_block import FORCES, MOMENTS, list_table_axes
from flightmech.support.array_files.netcdf_trees import GROUPS
from flightmech.terms import check_term, list_regressors, power_factor

HINGES = ("Ch_e", "Ch_a", "Ch_r")
# Relative difference of sizes after a unit conversion and a netCDF round trip.
_SIZE_TOLERANCE = 1e-6
# Distance of two moment reference points that count as equal, in mean chords.
_REFERENCE_TOLERANCE = 1e-4


def get_force_axes(db: xr.DataTree) -> str:
    """Return the axes of the force coefficients of a database; ``stability`` by default."""
    return str(db.attrs.get("force_axes", "stability"))


def check_root(aircraft: Aircraft, db: xr.DataTree) -> list[str]:
    """Return the problems of the database as a whole, and its differences from the aircraft."""
    problems = []
    axes = get_force_axes(db)
    if axes not in FORCES:
        problems.append(f"attribute force_axes is {axes!r}; allowed: {', '.join(FORCES)}")
        axes = "stability"
    for name in map(str, db.children):
        if name not in (*FORCES[axes], *MOMENTS, *HINGES, *GROUPS):
            allowed = ", ".join((*FORCES[axes], *MOMENTS))
            problems.append(
                f"/{name} is not a coefficient; with force_axes {axes} there are {allowed}"
            )
    for path, node in db.subtree_with_keys:
        # a term has the path coefficient/contribution
        misplaced = path.count("/") != 1 and path.split("/")[0] not in GROUPS
        if misplaced and node.data_vars:
            problems.append(
                f"/{path} holds a table; a term lies at /<coefficient>/<contribution>, this one "
                f"would not fly"
            )
    return problems + _compare_sizes(aircraft, db) + _compare_reference(aircraft, db)


def _compare_sizes(aircraft: Aircraft, db: xr.DataTree) -> list[str]:
    """Return the reference sizes that differ between database and aircraft."""
    problems = []
    for name in ("S", "cbar", "b"):
        if name not in db.attrs:
            continue
        of_database, of_aircraft = float(db.attrs[name]), getattr(aircraft, name)
        if not np.isclose(of_database, of_aircraft, rtol=_SIZE_TOLERANCE, atol=0.0):
            problems.append(
                f"{name} is {of_database:.8g} in the database and {of_aircraft:.8g} in the "
                f"aircraft; they must agree"
            )
    return problems


def _compare_reference(aircraft: Aircraft, db: xr.DataTree) -> list[str]:
    """Return the coordinates of the moment reference that differ."""
    problems = []
    reference = reference_in(aircraft, db.attrs)
    tolerance = _REFERENCE_TOLERANCE * aircraft.cbar
    for name, of_aircraft in zip(("x_ref", "y_ref", "z_ref"), reference, strict=True):
        if name not in db.attrs:
            continue
        of_database = float(db.attrs[name])
        if not np.isclose(of_database, of_aircraft, rtol=_SIZE_TOLERANCE, atol=tolerance):
            problems.append(
                f"{name} is {of_database:.6g} m in the database and {of_aircraft:.6g} m in the "
                f"aircraft; move the moment reference"
            )
    return problems


def check_leaf(name: str, leaf: xr.Dataset, stage: int, stages: Mapping[str, int]) -> list[str]:
    """Return the problems of a term.

    Parameters
    ----------
    name : str
        ``CL/basic`` and so on.
    leaf : Dataset
        The term, as in `flightmech.terms`.
    stage : int
        Stage of the kernel that evaluates the term.
    stages : mapping of str to int
        Stage of the kernel that computes each model variable.
    """
    problems = check_term(leaf)
    if problems:
        return [f"{name}: {text}" for text in problems]
    for axis in list_table_axes(leaf):
        problems += _check_axis(axis, stage, stages)
    regressors, factor = list_regressors(leaf), power_factor(leaf)
    for regressor in regressors:
        for text in _check_variable(regressor, stage, stages):
            problems.append(f"regressor: {text}")
    if factor:
        for text in _check_axis(factor.variable, stage, stages):
            problems.append(f"power: {text}")
    problems += _check_implicit(leaf, regressors)
    return [f"{name}: {text}" for text in problems]


def _check_implicit(leaf: xr.Dataset, regressors: tuple[str, ...]) -> list[str]:
    """Return the problems of variables that the simulation solves for: one per term."""
    problems = []
    implicit = sorted(set(regressors) & set(IMPLICIT))
    if used_coefficients(leaf) and implicit:
        problems.append(
            f"depends on {', '.join(sorted(used_coefficients(leaf)))} and on "
            f"{', '.join(implicit)}, of which only one can be solved for in a term"
        )
    if sum(regressor in IMPLICIT for regressor in regressors) > 1:
        problems.append(
            f"regressors {' '.join(regressors)}: only one of {', '.join(IMPLICIT)} can be solved "
            f"for in a term"
        )
    return problems


def _check_axis(axis: str, stage: int, stages: Mapping[str, int]) -> list[str]:
    if axis in IMPLICIT:
        return [f"{axis} cannot be an axis, the simulation solves for it; make it a regressor"]
    return [f"axis: {text}" for text in _check_variable(axis, stage, stages)]


def _check_variable(name: str, stage: int, stages: Mapping[str, int]) -> list[str]:
    """Return the problem of a variable that is unknown or computed too late."""
    if name not in stages:
        hint = ""
        if name in ("throttle", "thrust"):
            hint = "write engine1.throttle or engine1.thrust for one engine"
        return [str(UnknownName(name, list(stages), "model variable of the simulation", hint))]
    if stages[name] <= stage:
        if name in COEFFICIENTS and stages[name] < stage:
            return [f"only terms of {', '.join(COEFFICIENTS)} can depend on {name}"]
        return []
    # Terms of a coefficient may depend on coefficients of lower levels, which the kernel evaluates
    # first (`flightmech.build_up`).
    if name in COEFFICIENTS and stages[name] == stage + 1:
        return []
    return [f"{name} is found only after this table is evaluated; it cannot depend on it"]
