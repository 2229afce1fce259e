"""Aerodynamic coefficients along a flight path, with the effect of the errors of measurement.

Force and moment follow from the equation of motion, see `loads`. The coefficients are valid in the
air only: wheel forces are part of the specific force, so samples with a wheel on the ground give
NaN.

Every coefficient has the change by one standard error of each common error of the measurement,
sample by sample, see `coefficient_errors`. The same errors change the regressors.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import OutOfRange
from flightmech.names import quantity_attributes
from flightmech.quantities import time_text, value_in_si
from flightmech.units import G0
from flighttest.reconstruction.dynamics.coefficient_errors import (
    MOVED,
    Changes,
    load_changes,
    relevant_changes,
    state_changes,
    surface_changes,
)
from flighttest.reconstruction.dynamics.loads import (
    air_load,
    is_airborne,
    load_coefficients,
    thrust_coefficient,
)
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from flighttest.reconstruction.dynamics.reduced_rates import (
    Columns,
    read_column,
    read_columns,
    reduced_rates,
)
from flighttest.records.signals.resampling import lowpass

NAMES = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn")
_REACH = 1.5  # periods of the cut-off over which the low-pass spreads a shock
_GAP = 1.5  # median steps: a longer step is a gap


def coefficients(
    path: Any,
    aircraft: Aircraft,
    errors: Mapping[str, float] | None = None,
    cutoff: float | str | None = None,
) -> xr.Dataset:
    """Return the aerodynamic coefficients along a reconstructed flight path.

    Parameters
    ----------
    path : Path or Dataset (time,)
        A reconstruction, or its states: `V qbar alpha p q r ax ay az` at the c.g. and
        `engineN.thrust` for each engine, or what a propeller gives it from
        (`with_engine_channels`), are needed; `p_dot q_dot r_dot` are differentiated when
        they are missing, `mass`, `x_cg_b`, `y_cg_b`, `z_cg_b` are taken from the aircraft when they
        are missing. [SI]
    aircraft : Aircraft
        Reference lengths, inertia, engines.
    errors : mapping, optional
        Relative standard errors of `qbar`, `mass`, `inertia` and `thrust` (each engine by itself),
        and the standard error of `timing`, the clock of accelerations against the clock of states
        and controls [s]. The defaults are 1 %, 0.5 %, 2 %, 2 % and 2 ms (a tenth of a sample at
        50 Hz, the skew of a scan). A Path has errors of its dynamic pressure among the errors of
        its states. `qbar` then takes part only if it is in this mapping.
    cutoff : float or str, optional
        Cut-off of a low-pass filter for all states, controls included (`smooth_states`): 2 to 3
        times the frequency of the fastest mode of motion. [Hz]

    Returns
    -------
    Dataset (time,)
        The states, and ``CL CD`` (stability axes), ``CX CY CZ`` (body axes), ``Cl Cm Cn`` (body
        axes, about the moment reference point), ``nz dnz``, reduced rates, and ``CT`` of an
        aircraft with engines. Samples with a wheel on the ground have NaN coefficients.

        ``CL_error (error, time)`` etc. hold the change of the coefficient for one standard error of
        each source. Their rms is in the attributes ``error_qbar`` ... of the coefficient.
        ``alpha_error`` etc. hold the change of the variables `MOVED`, if a source changes them.

        Sources are ``qbar mass inertia thrust1 ... timing``, the errors of a Path (`state_errors`),
        and ``bias.delta_e scale.delta_e`` etc. of the surfaces in the states. The instruments of
        the aircraft give the size of the surface errors (`instruments.surface_errors`).

    Raises
    ------
    UnknownName
        A state is missing, or `errors` names an unknown source.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 3.
    """
    states = getattr(path, "states", path)
    margin = 0.0
    frequency: float | None = value_in_si(cutoff, "Hz", "cutoff")
    if frequency is not None:
        states = smooth_states(states, frequency)
        margin = _REACH / frequency
    states = with_engine_channels(reduced_rates(states, aircraft), aircraft)
    columns = read_columns(states)
    if aircraft.engines:
        columns["CT"] = thrust_coefficient(columns, aircraft)
    F, M = air_load(columns, aircraft)
    total = load_coefficients(F, M, columns, aircraft)
    airborne = is_airborne(columns, margin)
    changes = _all_changes(path, columns, total=total, aircraft=aircraft, errors=errors)
    changes = relevant_changes(changes, airborne)
    variables = _coefficient_variables(total, changes, airborne)
    # load factor: positive upwards
    nz = -read_column(columns, "az") / G0
    variables["nz"] = ("time", nz, quantity_attributes("nz"))
    variables["dnz"] = ("time", nz - 1.0, quantity_attributes("dnz"))
    if "CT" in columns:
        variables["CT"] = "time", columns["CT"], quantity_attributes("CT")
    states = states.assign_coords(error=list(changes))
    return states.assign(variables).assign_attrs(force_axes="stability")


def sample_coefficients(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return states with reduced rates and coefficients, sample by sample, without their errors.

    The values are those of `coefficients`. With angular accelerations in the states, each sample
    depends on itself alone, so that a stream can be converted in parts.

    Parameters
    ----------
    states : Dataset (time,)
        As of `coefficients`. [SI]
    aircraft : Aircraft
    """
    states = with_engine_channels(reduced_rates(states, aircraft), aircraft)
    columns = read_columns(states)
    if aircraft.engines:
        columns["CT"] = thrust_coefficient(columns, aircraft)
    total = load_coefficients(*air_load(columns, aircraft), columns, aircraft)
    airborne = is_airborne(columns, 0.0)
    variables = {}
    for name in NAMES:
        variables[name] = "time", np.where(airborne, total[name], np.nan)
    nz = -read_column(columns, "az") / G0
    variables |= {"nz": ("time", nz), "dnz": ("time", nz - 1.0)}
    if "CT" in columns:
        variables["CT"] = "time", columns["CT"]
    return states.assign(variables)


def _all_changes(
    path: Any,
    columns: Columns,
    total: Mapping[str, np.ndarray],
    aircraft: Aircraft,
    errors: Mapping[str, float] | None,
) -> Changes:
    """Return the changes of coefficients and variables by all sources of error."""
    changes = load_changes(columns, total, aircraft=aircraft, errors=errors)
    state_errors = getattr(path, "errors", None)
    if state_errors is not None:
        # The errors of the states include dynamic pressure.
        if "qbar" not in (errors or {}):
            del changes["qbar"]
        changes |= state_changes(columns, state_errors, total=total, aircraft=aircraft)
    return changes | surface_changes(columns, aircraft)


def _coefficient_variables(
    total: Mapping[str, np.ndarray], changes: Changes, airborne: np.ndarray
) -> dict[str, Any]:
    """Return the coefficients, and the changes of coefficients and variables (error, time)."""
    variables: dict[str, Any] = {}
    for name in (*NAMES, *MOVED):
        changed = any(name in source_changes for source_changes in changes.values())
        if name not in NAMES and not changed:
            continue
        change = _stack_changes(changes, name, samples=len(airborne))
        attributes = {
            "units": quantity_attributes(name)["units"],
            "long_name": f"change of {name} for one standard error of the source",
        }
        variables[f"{name}_error"] = ("error", "time"), change, attributes
        if name in NAMES:
            budget = {}
            for source, rms in zip(changes, _rms_in_air(change, airborne), strict=True):
                budget[f"error_{source}"] = float(rms)
            values = np.where(airborne, total[name], np.nan)
            variables[name] = ("time", values, {**quantity_attributes(name), **budget})
    return variables


def _stack_changes(changes: Changes, name: str, samples: int) -> np.ndarray:
    """Return the change of one variable by all sources (error, time)."""
    # zero where a source does not act; no row where none does, as without a number in the record
    zero = np.zeros(samples)
    rows = [by_source.get(name, zero) for by_source in changes.values()]
    return np.array(rows).reshape(len(rows), samples)


def _rms_in_air(change: np.ndarray, airborne: np.ndarray) -> np.ndarray:
    """Return the rms over the samples in the air (error,); NaN without such samples."""
    if not airborne.any():
        return np.full(len(change), np.nan)
    return np.sqrt(np.nanmean(np.where(airborne, change, np.nan) ** 2, axis=1))


def select_time(data: xr.Dataset, start: float | str, stop: float | str) -> xr.Dataset:
    """Return the samples of one manoeuvre, ``start <= time < stop``.

    Times are in seconds, or texts with a unit.

    Raises
    ------
    OutOfRange
        The window is not inside the data.
    """
    first: float = value_in_si(start, "s", "start")
    last: float = value_in_si(stop, "s", "stop")
    time = data["time"].values
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if not time[0] - step <= first < last <= time[-1] + 1.5 * step:
        raise OutOfRange(
            f"window {time_text(first)} ... {time_text(last)} s is not inside the data, "
            f"{time_text(time[0])} ... "
            f"{time_text(time[-1])} s; choose one that is"
        )
    return data.sel(time=slice(first, last - 0.5 * step))


def smooth_states(states: xr.Dataset, cutoff: float) -> xr.Dataset:
    """Return all states after the same low-pass filter, without phase.

    Noise of the regressors makes slopes too small, by noise variance over the variance that the
    other regressors do not explain: 12 % of the pitch damping in a fast 3-2-1-1 with gyros of
    0.03 deg/s. Equations linear in the states stay true if all states go through the same filter.
    The controls go through it too. Otherwise their steps would be sharper than the response.

    Parameters
    ----------
    states : Dataset (time,)
        Uniform between gaps in time and NaN, where the filter starts anew. Wheel switches
        (``wow_``) and ``psi`` are not filtered. [SI]
    cutoff : float
        Frequency where the amplitude is 0.71. [Hz]

    Raises
    ------
    OutOfRange
        The cut-off does not lie between 0 and half the sampling rate.
    """
    if not 0.0 < cutoff < np.inf:
        raise OutOfRange(
            f"cut-off {cutoff:g} Hz; it must be more than 0 Hz and less than half the "
            f"samples per second"
        )
    time = states["time"].values
    step = float(np.median(np.diff(time)))
    gaps = np.flatnonzero(np.diff(time) > _GAP * step) + 1
    smoothed = {}
    for name, item in states.data_vars.items():
        is_signal = item.dims == ("time",) and np.issubdtype(item.dtype, np.floating)
        if is_signal and not str(name).startswith(("wow_", "psi")):
            values = _smooth_signal(item.values.astype(float), gaps, rate=1.0 / step, cutoff=cutoff)
            smoothed[name] = "time", values, item.attrs
    return states.assign(smoothed)


def _smooth_signal(x: np.ndarray, gaps: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Return a signal (time,), filtered piece by piece between gaps and NaN."""
    # A NaN would spread over the reach of the filter.
    finite = np.isfinite(x)
    ends_of_finite = np.flatnonzero(np.diff(finite)) + 1
    cuts = np.unique(np.concatenate([[0, len(x)], gaps, ends_of_finite]))
    pieces = []
    for start, stop in pairwise(cuts):
        piece = x[start:stop]
        if finite[start]:
            piece = lowpass(piece, rate, cutoff)
        pieces.append(piece)
    return np.concatenate(pieces)
