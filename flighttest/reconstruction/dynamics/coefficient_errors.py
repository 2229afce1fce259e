"""Systematic errors of measured coefficients, source by source.

Every source changes coefficients and regressors along the path. The sources are mass, inertia, each
thrust, the clock, the constants of the instruments in a reconstruction (without a reconstruction,
dynamic pressure), and bias and scale error of the surface pick-ups. The regression turns the
changes into systematic errors of the derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import REDUCED_RATES
from flighttest.reconstruction.dynamics.error_sizes import complete_errors
from flighttest.reconstruction.dynamics.loads import (
    air_load,
    engine_loads,
    inertial_load,
    load_coefficients,
    thrust_coefficient,
)
from flighttest.reconstruction.dynamics.reduced_rates import (
    Columns,
    missing_reduced_rates,
    read_column,
)
from flighttest.records.sensors.instruments import SURFACES, surface_errors

# Relative standard errors; of the timing in seconds.
ERRORS = {"qbar": 0.01, "mass": 0.005, "inertia": 0.02, "thrust": 0.02, "timing": 0.002}
# Variables of regressors and tables that follow from the states: errors of the states change them.
_DERIVED = (*REDUCED_RATES, "CT")
# Variables of regressors and tables: errors of the states change them too.
MOVED = ("alpha", "beta", "mach", *_DERIVED, "h", "h_agl", *SURFACES)
# Share of the standard error of every coefficient and variable below which a source is omitted.
_LEAST = 1e-3
# Largest step of a clock without a gap, in median steps.
_GAP = 1.5

# Changes by source, then by coefficient or variable: (time,) for one standard error.
Changes = dict[str, dict[str, np.ndarray]]


def load_changes(
    columns: Columns,
    total: Mapping[str, np.ndarray],
    aircraft: Aircraft,
    errors: Mapping[str, float] | None,
) -> Changes:
    """Return the changes by dynamic pressure, mass, inertia, thrust and clock.

    Parameters
    ----------
    columns : dict of array (time,)
        States.
    total : mapping of array (time,)
        Coefficients.
    aircraft : Aircraft
    errors : mapping, optional
        Standard errors that replace the defaults `ERRORS`.

    Raises
    ------
    UnknownName
        `errors` names another source.
    SchemaError
        A standard error is negative or not finite.

    Warns
    -----
    AeromatchWarning
        A standard error is too large for any aeroplane.
    """
    sigma = complete_errors(ERRORS, errors)
    F, M = inertial_load(columns, aircraft)
    zero = np.zeros_like(F)
    by_mass = load_coefficients(F, zero, columns, aircraft)
    by_inertia = load_coefficients(zero, M, columns, aircraft)
    # The coefficients are proportional to 1/qbar, their inertial parts to mass and inertia.
    changes = {
        "qbar": _scale(total, -sigma["qbar"]),
        "mass": _scale(by_mass, sigma["mass"]),
        "inertia": _scale(by_inertia, sigma["inertia"]),
    }
    for i, (force, moment) in enumerate(engine_loads(columns, aircraft)):
        by_thrust = load_coefficients(-force, -moment, columns, aircraft)
        change = _scale(by_thrust, sigma["thrust"])
        change["CT"] = sigma["thrust"] * thrust_coefficient(columns, aircraft, i)
        changes[f"thrust{i + 1}"] = change
    if aircraft.engines:
        changes["qbar"]["CT"] = -sigma["qbar"] * read_column(columns, "CT")
    timing = {}
    for name, values in total.items():
        timing[name] = sigma["timing"] * _rate_of_change(values, columns["time"])
    changes["timing"] = timing
    return changes


def state_changes(
    columns: Columns,
    state_errors: xr.Dataset,
    total: Mapping[str, np.ndarray],
    aircraft: Aircraft,
) -> Changes:
    """Return the changes by the errors (error, time) of reconstructed states, by source."""
    state_errors = state_errors.sel(time=columns["time"])
    by_state = {}
    for name, item in state_errors.data_vars.items():
        if name in columns:
            by_state[str(name)] = item.values
    primary = {name: values for name, values in columns.items() if name not in _DERIVED}
    changes: Changes = {}
    for k, source in enumerate(state_errors["error"].values):
        # the states with this error, and all that follows from them
        disturbed = dict(primary)
        for name, change in by_state.items():
            disturbed[name] = columns[name] + change[k]
        disturbed |= missing_reduced_rates(disturbed, aircraft)
        if aircraft.engines:
            disturbed["CT"] = thrust_coefficient(disturbed, aircraft)
        F, M = air_load(disturbed, aircraft)
        source_changes = {}
        for name, values in load_coefficients(F, M, disturbed, aircraft).items():
            source_changes[name] = (values - total[name]).astype(np.float32)
        for name in MOVED:
            if name in disturbed and name in columns:
                source_changes[name] = (disturbed[name] - columns[name]).astype(np.float32)
        changes[str(source)] = source_changes
    return changes


def surface_changes(columns: Columns, aircraft: Aircraft) -> Changes:
    """Return the changes of the surfaces by bias and scale error of their pick-ups."""
    changes: Changes = {}
    instruments = getattr(aircraft, "instruments", {})
    for name, (bias, scale) in surface_errors(instruments).items():
        if name in columns:
            changes[f"bias.{name}"] = {name: np.full(len(columns["time"]), bias)}
            changes[f"scale.{name}"] = {name: scale * read_column(columns, name)}
    return changes


def relevant_changes(changes: Changes, airborne: np.ndarray) -> Changes:
    """Return the sources with a relevant part in some coefficient or variable.

    A part is relevant if it exceeds `_LEAST` times the standard error by all sources.
    """
    names: dict[str, None] = {}
    for source_changes in changes.values():
        names |= dict.fromkeys(source_changes)
    samples = airborne
    if not airborne.any():
        samples = np.ones_like(airborne)
    # mean square of each change: (source, coefficient or variable)
    power = np.zeros((len(changes), len(names)))
    for i, source_changes in enumerate(changes.values()):
        for j, name in enumerate(names):
            if name in source_changes:
                power[i, j] = np.nanmean(source_changes[name][samples].astype(float) ** 2)
    relevant = (power > _LEAST**2 * power.sum(axis=0)).any(axis=1)
    return {source: changes[source] for source in np.array(list(changes))[relevant].tolist()}


def _scale(coefficients: Mapping[str, np.ndarray], factor: float) -> dict[str, np.ndarray]:
    return {name: factor * values for name, values in coefficients.items()}


def _rate_of_change(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the derivative by time; zero next to a gap and next to NaN. [s-1]"""
    if len(time) < 3:
        return np.zeros_like(values)
    slope = np.gradient(values, time)
    gap = np.diff(time) > _GAP * np.median(np.diff(time))
    next_to_gap = np.append(gap, False) | np.append(False, gap)
    return np.where(next_to_gap | ~np.isfinite(slope), 0.0, slope)
