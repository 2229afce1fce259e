"""Measured forces and moments as coefficients.

Equation of motion of a rigid aeroplane with spinning rotors, solved for the aerodynamic force and moment::

    F_A = m a - F_T
    M_A = I omega_dot + omega x (I omega + h_e) - M_T           about the c.g.
    M_ref = M_A + (r_cg - r_ref) x F_A                          about the moment reference point

`a` is the specific force at the c.g., so gravity does not appear.  Positions count from the moment
reference point. Valid in the air only: wheel forces are inside `a`, so samples with a wheel on the
ground give NaN.

Every coefficient comes with what one standard error of each common error of the measurement would
change in it, sample by sample: mass, inertia, each thrust, and what the instruments' constants
leave open in the reconstructed states (without a reconstruction, dynamic pressure).  The same
errors move the regressors, and so do bias and scale error of the surface pick-ups; the regression
turns all of them into systematic errors of the derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, OutOfRange, UnknownName
from flightmech.names import REDUCED_RATES, quantity_attributes
from flightmech.units import G0
from flighttest.records.sensors.instruments import SURFACES, surface_errors
from flighttest.records.signals.conditioning import lowpass
from flighttest.records.signals.differentiation import derivative

ERRORS = {"qbar": 0.01, "mass": 0.005, "inertia": 0.02, "thrust": 0.02, "timing": 0.002}
# what regressors and tables are functions of: their errors go with them
MOVED = (
    "alpha",
    "beta",
    "mach",
    *REDUCED_RATES,
    "CT",
    "h",
    "h_agl",
    *SURFACES,
)
_DERIVED = (*REDUCED_RATES, "CT")  # formed anew from states that are moved
# share of the standard error of every coefficient and variable below which a source is left out
_LEAST = 1e-3
_REACH = 1.5  # periods of the cut-off over which the low-pass spreads a shock
NAMES = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn")

_Columns = dict[str, np.ndarray]  # states by name, and time


def coefficients(
    path: Any,
    aircraft: Aircraft,
    errors: Mapping[str, float] | None = None,
    cutoff: float | None = None,
) -> xr.Dataset:
    """Return the aerodynamic coefficients along a reconstructed flight path.

    Parameters
    ----------
    path : Path or Dataset (time,)
        A reconstruction, or its states: `V qbar alpha p q r ax ay az` at the c.g. and
        `engineN.thrust` for each engine are needed; `p_dot q_dot r_dot` are differentiated when
        they are missing, `mass`, `x_cg_b`, `y_cg_b`, `z_cg_b` are taken from the aircraft when they
        are missing. [SI]
    aircraft : Aircraft
        Reference lengths, inertia, engines.
    errors : mapping, optional
        Relative standard errors of `qbar`, `mass`, `inertia`, `thrust` (each engine by itself); and
        `timing`, that of the clock of accelerations against the one of states and controls [s].
        Missing ones keep the defaults 1 %, 0.5 %, 2 %, 2 %, 2 ms (a tenth of a sample at 50 Hz, the
        skew of a scan).  A Path brings the errors of its dynamic pressure along with those of its
        other states; `qbar` then counts only when it is given.
    cutoff : float, optional
        Low-pass all states alike first, controls included (`smooth_states`): 2 to 3 times the frequency
        of the fastest mode of motion. [Hz]

    Returns
    -------
    Dataset (time,)
        The states, and ``CL CD`` (stability axes), ``CX CY CZ`` (body axes), ``Cl Cm Cn`` (body
        axes, about the moment reference point), ``nz dnz``, reduced rates, and ``CT`` of an
        aircraft with engines.  ``CL_error (error, time)`` etc. hold the change of the coefficient
        for one standard error of each source; their rms is in the attributes ``error_qbar`` ... of
        the coefficient. ``alpha_error`` and its sisters of `MOVED` hold the change of the variable,
        where any source moves it.  Sources are ``qbar mass inertia thrust1 ... timing``, the errors
        of a Path (`state_errors`), ``bias.delta_e`` and ``scale.delta_e`` and the same of the other
        surfaces that are in the states, of the size that the aircraft's instruments give
        (`instruments.surface_errors`).

    Raises
    ------
    UnknownName
        A state that is needed and missing.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 3.
    """
    states = getattr(path, "states", path)
    known = reduced_rates(states if cutoff is None else smooth_states(states, cutoff), aircraft)
    data = _columns(known)
    if aircraft.engines:
        data["CT"] = _thrust_coefficient(data, aircraft)
    F_inertial, M_inertial = _inertial(data, aircraft)
    thrust = [_thrust(data, aircraft, i) for i in range(len(aircraft.engines))]
    F, M = F_inertial - sum(f for f, _ in thrust), M_inertial - sum(m for _, m in thrust)

    def reduced(F, M):
        return _reduced(F, M, data, aircraft)

    total = reduced(F, M)
    sigma = _sigma(errors)
    nothing = np.zeros_like(F)
    shares: dict[str, dict[str, np.ndarray]] = {
        "qbar": {name: -sigma["qbar"] * c for name, c in total.items()},
        "mass": {name: sigma["mass"] * c for name, c in reduced(F_inertial, nothing).items()},
        "inertia": {name: sigma["inertia"] * c for name, c in reduced(nothing, M_inertial).items()},
        **{
            f"thrust{i + 1}": {name: sigma["thrust"] * c for name, c in reduced(-f, -m).items()}
            for i, (f, m) in enumerate(thrust)
        },
        "timing": {name: sigma["timing"] * _by_time(c, data["time"]) for name, c in total.items()},
    }
    for i in range(len(thrust)):
        shares[f"thrust{i + 1}"]["CT"] = sigma["thrust"] * _thrust_coefficient(data, aircraft, i)
    if thrust:
        shares["qbar"]["CT"] = -sigma["qbar"] * _column(data, "CT")
    left = getattr(path, "errors", None)
    if left is not None:
        if "qbar" not in (errors or {}):
            del shares["qbar"]
        shares |= _of_states(data, left, total, aircraft)
    shares |= _of_surfaces(data, aircraft)
    airborne = _airborne(data, 0.0 if cutoff is None else _REACH / cutoff)
    shares = _counting(shares, airborne)
    found: dict[str, Any] = {}
    for name in (*NAMES, *MOVED):
        if name not in NAMES and not any(name in share for share in shares.values()):
            continue
        change = np.stack([share.get(name, nothing[:, 0]) for share in shares.values()])
        about = {
            "units": quantity_attributes(name)["units"],
            "long_name": f"change of {name} for one standard error of the source",
        }
        found[f"{name}_error"] = ("error", "time"), change, about
        if name in NAMES:
            rms = (
                np.sqrt(np.nanmean(np.where(airborne, change, np.nan) ** 2, axis=1))
                if airborne.any()
                else np.full(len(shares), np.nan)
            )
            budget = {f"error_{source}": float(value) for source, value in zip(shares, rms)}
            found[name] = (
                "time",
                np.where(airborne, total[name], np.nan),
                {**quantity_attributes(name), **budget},
            )
    nz = -_column(data, "az") / G0
    found |= {
        "nz": ("time", nz, quantity_attributes("nz")),
        "dnz": ("time", nz - 1.0, quantity_attributes("dnz")),
    }
    if "CT" in data:
        found["CT"] = "time", data["CT"], quantity_attributes("CT")
    return (
        known.assign_coords(error=list(shares)).assign(found).assign_attrs(force_axes="stability")
    )


def _by_time(c: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the derivative by time, zero where it has no value: next to a gap and at the ends of
    what is known. [s-1]
    """
    if len(time) < 3:
        return np.zeros_like(c)
    slope = np.gradient(c, time)
    gap = np.diff(time) > 1.5 * np.median(np.diff(time))
    adjacent = np.append(gap, False) | np.append(False, gap)
    return np.where(adjacent | ~np.isfinite(slope), 0.0, slope)


def _of_states(
    data: _Columns, left: xr.Dataset, total: Mapping[str, np.ndarray], aircraft: Aircraft
) -> dict[str, dict[str, np.ndarray]]:
    """Return what the errors of reconstructed states change in coefficients and variables, by
    source.
    """
    found = {}
    left = left.sel(time=data["time"])
    changes = {str(name): item.values for name, item in left.data_vars.items() if name in data}
    given = {name: values for name, values in data.items() if name not in _DERIVED}
    for k, source in enumerate(left["error"].values):
        moved = given | {name: data[name] + change[k] for name, change in changes.items()}
        moved |= _reduced_rates(moved, aircraft)
        if aircraft.engines:
            moved["CT"] = _thrust_coefficient(moved, aircraft)
        F, M = _air_load(moved, aircraft)
        share = {
            name: (c - total[name]).astype(np.float32)
            for name, c in _reduced(F, M, moved, aircraft).items()
        }
        share |= {
            name: (moved[name] - data[name]).astype(np.float32)
            for name in MOVED
            if name in moved and name in data
        }
        found[str(source)] = share
    return found


def _of_surfaces(data: _Columns, aircraft: Aircraft) -> dict[str, dict[str, np.ndarray]]:
    """Return what bias and scale error of the pick-ups change in the surfaces, by source."""
    found = {}
    for name, (bias, scale) in surface_errors(getattr(aircraft, "instruments", {})).items():
        if name in data:
            found[f"bias.{name}"] = {name: np.full(len(data["time"]), bias)}
            found[f"scale.{name}"] = {name: scale * _column(data, name)}
    return found


def _counting(
    shares: Mapping[str, dict[str, np.ndarray]], airborne: np.ndarray
) -> dict[str, dict[str, np.ndarray]]:
    """Return the sources that count: with more than `_LEAST` of the standard error of some
    coefficient or variable.
    """
    names = list(dict.fromkeys(name for share in shares.values() for name in share))
    at = airborne if airborne.any() else np.ones_like(airborne)
    power = np.array(
        [
            [
                np.nanmean(share[name][at].astype(float) ** 2) if name in share else 0.0
                for name in names
            ]
            for share in shares.values()
        ]
    )
    counts = (power > _LEAST**2 * power.sum(axis=0)).any(axis=1)
    return {source: share for (source, share), used in zip(shares.items(), counts) if used}


def select_time(data: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Return the samples of one manoeuvre, ``start <= time < stop``.

    Raises
    ------
    OutOfRange
        The window is not inside the data.
    """
    time = data["time"].values
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if not time[0] - step <= start < stop <= time[-1] + 1.5 * step:
        raise OutOfRange(
            f"window {start:g} ... {stop:g} s is not inside the data, {time[0]:g} ... "
            f"{time[-1]:g} s; choose one that is"
        )
    return data.sel(time=slice(start, stop - 0.5 * step))


def smooth_states(states: xr.Dataset, cutoff: float) -> xr.Dataset:
    """Return states low-passed without phase, every one alike.

    Noise of the regressors makes slopes too small, by noise variance over the variance that the
    other regressors leave: 12 % of the pitch damping in a fast 3-2-1-1 with gyros of 0.03 deg/s.
    Equations linear in the states stay true when all states go through the same filter; the
    controls must, or their steps would be sharper than the response to them.

    Parameters
    ----------
    states : Dataset (time,)
        Uniform stretches; gaps in time and NaN end a stretch.  Wheel switches (``wow_``) and
        ``psi`` stay as they are. [SI]
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
    gaps = np.flatnonzero(np.diff(time) > 1.5 * step) + 1
    found = {}
    for name, item in states.data_vars.items():
        if (
            item.dims == ("time",)
            and np.issubdtype(item.dtype, np.floating)
            and not str(name).startswith(("wow_", "psi"))
        ):
            x = item.values.astype(float)
            finite = np.isfinite(x)
            cuts = np.unique(
                np.concatenate([[0, len(x)], gaps, np.flatnonzero(np.diff(finite)) + 1])
            )
            parts = [
                lowpass(x[a:b], 1.0 / step, cutoff) if finite[a] else x[a:b]
                for a, b in pairwise(cuts)
            ]
            found[name] = "time", np.concatenate(parts), item.attrs
    return states.assign(found)


def reduced_rates(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return `states` with those of `flightmech.names.REDUCED_RATES` that are missing.

    Parameters
    ----------
    states : Dataset (time,)
        At least `V p q r`; with `alpha_dot` and `beta_dot`, or with what they follow from: `alpha
        beta ax ay az phi theta`. [SI]
    aircraft : Aircraft
        For the span and the mean chord.

    Returns
    -------
    Dataset (time,)
        A new Dataset.

    Notes
    -----
    Rates are divided by 2 V: phat = p b/(2 V), qhat = q cbar/(2 V).
    """
    found = _reduced_rates(_columns(states), aircraft)
    return states.assign(
        {name: ("time", values, quantity_attributes(name)) for name, values in found.items()}
    )


def _reduced_rates(data: _Columns, aircraft: Aircraft) -> _Columns:
    """Return the reduced rates that are missing, and what they follow from."""
    found = {}
    if (
        "alphadothat" not in data
        and "alpha_dot" not in data
        and _has(data, "alpha", "beta", "ax", "ay", "az", "phi", "theta")
    ):
        found = dict(zip(("alpha_dot", "beta_dot"), _incidence_rates(data)))
    for name, (rate, length) in REDUCED_RATES.items():
        if name not in data and (rate in found or rate in data):
            values = found[rate] if rate in found else _column(data, rate)
            found[name] = values * getattr(aircraft, length) / (2.0 * _column(data, "V"))
    return found


def external_load(states: xr.Dataset, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Return the force and the moment on the airframe that are neither weight nor thrust: of the
    air, and of the runway.

    Parameters
    ----------
    states : Dataset (time,)
        As for `coefficients`.
    aircraft : Aircraft
        Mass where the states have none, inertia, engines.

    Returns
    -------
    F, M : array (time, 3)
        Body axes, M about the c.g. [N, N m]
    """
    return _air_load(_columns(states), aircraft)


def _air_load(data: _Columns, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Return `external_load` of plain columns."""
    F, M = _inertial(data, aircraft)
    thrust = [_thrust(data, aircraft, i) for i in range(len(aircraft.engines))]
    return F - sum(f for f, _ in thrust), M - sum(m for _, m in thrust)


def known_moment(states: xr.Dataset, aircraft: Aircraft) -> np.ndarray:
    """Return the moment on the airframe that is not aerodynamic: of thrust about the c.g., less
    omega x h_e of the rotors.

    Parameters
    ----------
    states : Dataset (time,)
        `p q r`, and `engineN.thrust` of every engine; `x_cg_b`, `y_cg_b`, `z_cg_b` where they
        change. [SI]
    aircraft : Aircraft
        Engines.

    Returns
    -------
    array (time, 3)
        Body axes. [N m]
    """
    data = _columns(states)
    moment = -np.cross(_vector(data, ("p", "q", "r")), _rotors(aircraft))
    return moment + sum(
        (_thrust(data, aircraft, i)[1] for i in range(len(aircraft.engines))), np.zeros(3)
    )


def inertia_matrix(aircraft: Aircraft) -> np.ndarray:
    """Return the tensor of inertia about the c.g., body axes. [kg m2]"""
    return np.array(
        [
            [aircraft.Ixx, -aircraft.Ixy, -aircraft.Ixz],
            [-aircraft.Ixy, aircraft.Iyy, -aircraft.Iyz],
            [-aircraft.Ixz, -aircraft.Iyz, aircraft.Izz],
        ]
    )


def _incidence_rates(data: _Columns) -> tuple[np.ndarray, np.ndarray]:
    """alpha_dot and beta_dot from accelerations, air mass unaccelerated. [rad s-1]"""
    V, al, be, p, q, r, ph, th = (
        _column(data, name) for name in ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")
    )
    ax = _column(data, "ax") - G0 * np.sin(th)
    ay = _column(data, "ay") + G0 * np.cos(th) * np.sin(ph)
    az = _column(data, "az") + G0 * np.cos(th) * np.cos(ph)
    alpha_dot = (
        q
        - np.tan(be) * (p * np.cos(al) + r * np.sin(al))
        + (az * np.cos(al) - ax * np.sin(al)) / (V * np.cos(be))
    )
    beta_dot = (
        p * np.sin(al)
        - r * np.cos(al)
        + (ay * np.cos(be) - np.sin(be) * (ax * np.cos(al) + az * np.sin(al))) / V
    )
    return alpha_dot, beta_dot


def _inertial(data: _Columns, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """m a and I omega_dot + omega x (I omega + h_e), body axes, about the c.g. [N, N m]"""
    omega = _vector(data, ("p", "q", "r"))
    omega_dot = np.stack([_rate_of(data, name) for name in ("p", "q", "r")], axis=1)
    inertia = inertia_matrix(aircraft)
    mass = _column(data, "mass", aircraft.mass)
    return mass[:, None] * _vector(data, ("ax", "ay", "az")), omega_dot @ inertia + np.cross(
        omega, omega @ inertia + _rotors(aircraft)
    )


def _rotors(aircraft: Aircraft) -> np.ndarray:
    """Angular momentum of all rotors, body axes. [kg m2 s-1]"""
    return sum(
        (
            engine.angular_momentum * np.asarray(engine.direction, float)
            for engine in aircraft.engines
        ),
        np.zeros(3),
    )


def _thrust(data: _Columns, aircraft: Aircraft, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Force of one engine and its moment about the c.g. [N, N m]"""
    engine = aircraft.engines[index]
    force = _column(data, f"engine{index + 1}.thrust")[:, None] * np.asarray(
        engine.direction, float
    )
    return force, np.cross(np.asarray(engine.position, float) - _cg(data, aircraft), force)


def _thrust_coefficient(
    data: _Columns, aircraft: Aircraft, engine: int | None = None
) -> np.ndarray:
    """Net thrust of one engine, or of all, over qbar S, qbar at least 1 Pa as in the simulation.
    [1]
    """
    engines = range(len(aircraft.engines)) if engine is None else [engine]
    total = sum((_column(data, f"engine{i + 1}.thrust") for i in engines), np.zeros(1))
    return total / (np.maximum(_column(data, "qbar"), 1.0) * aircraft.S)


def _reduced(
    F: np.ndarray, M: np.ndarray, data: _Columns, aircraft: Aircraft
) -> dict[str, np.ndarray]:
    """The coefficients of a force and a moment about the c.g."""
    with np.errstate(divide="ignore", invalid="ignore"):
        C_force = F / (_column(data, "qbar") * aircraft.S)[:, None]
        C_moment = (M + np.cross(_cg(data, aircraft), F)) / (_column(data, "qbar") * aircraft.S)[
            :, None
        ]
    CX, CY, CZ = C_force.T
    al = _column(data, "alpha")
    C_moment = C_moment / np.array([aircraft.b, aircraft.cbar, aircraft.b])
    return {
        "CL": CX * np.sin(al) - CZ * np.cos(al),
        "CD": -CX * np.cos(al) - CZ * np.sin(al),
        "CX": CX,
        "CY": CY,
        "CZ": CZ,
        **dict(zip(("Cl", "Cm", "Cn"), C_moment.T)),
    }


def _cg(data: _Columns, aircraft: Aircraft) -> np.ndarray:
    return np.stack(
        [
            _column(data, name, value)
            for name, value in zip(("x_cg_b", "y_cg_b", "z_cg_b"), aircraft.cg)
        ],
        axis=1,
    )


def _airborne(data: _Columns, margin: float) -> np.ndarray:
    """Samples without a wheel on the ground, nor within `margin` seconds of one: a filter spreads
    the shock.
    """
    wheels = [values > 0.5 for name, values in data.items() if name.startswith("wow_")]
    if not wheels:
        return np.ones(len(data["time"]), bool)
    time, down = data["time"], np.any(wheels, axis=0)
    if not down.any():
        return ~down
    next_down = np.searchsorted(time[down], time)
    before, after = (
        time[down][np.maximum(next_down - 1, 0)],
        time[down][np.minimum(next_down, down.sum() - 1)],
    )
    return ~down & (np.minimum(np.abs(time - before), np.abs(after - time)) > margin)


def _rate_of(data: _Columns, name: str) -> np.ndarray:
    if f"{name}_dot" in data:
        return _column(data, f"{name}_dot")
    steps = np.diff(data["time"])
    if np.ptp(steps) > 0.01 * np.median(steps):
        raise IdentificationError(
            f"{name}_dot is missing and {name} steps by {steps.min():.4g} ... "
            f"{steps.max():.4g} s; cut and resample first"
        )
    return derivative(_column(data, name), float(np.median(steps)))


def _sigma(errors: Mapping[str, float] | None) -> dict[str, float]:
    for name in errors or {}:
        if name not in ERRORS:
            raise UnknownName(name, ERRORS, "source of error")
    return {**ERRORS, **(errors or {})}


def _has(data: _Columns, *names: str) -> bool:
    return all(name in data for name in names)


def _vector(data: _Columns, names: tuple[str, str, str]) -> np.ndarray:
    return np.stack([_column(data, name) for name in names], axis=1)


def _columns(states: xr.Dataset) -> _Columns:
    """Return time and the numbers of states along it; constants as often as samples."""
    time = states["time"].values
    found = {"time": time}
    for name, item in states.variables.items():
        if item.dims in ((), ("time",)) and item.dtype.kind in "fiub":
            found[str(name)] = np.broadcast_to(np.asarray(item.values, float), time.shape)
    return found


def _column(data: _Columns, name: str, default: float | None = None) -> np.ndarray:
    if name in data:
        return data[name]
    if default is None:
        raise UnknownName(
            name,
            set(data) - {"time"},
            "state",
            "the coefficients need it: name its column in the name map of the record and "
            "reconstruct again",
        )
    return np.full(len(data["time"]), float(default))
