"""Thrust, torque and regressors of propellers along a flight without a channel of thrust.

A record of a propeller aircraft has the speed of the propeller, and torque, manifold pressure or
n1. The tables of the aircraft file turn them into thrust and torque, and into the regressors ``J``,
``CT_prop``, ``CP_prop`` and ``CT`` of the effects of power.  The loads are those of the kernel
(`kernel/src/propulsion/propeller.c`), with the thrust line d, the rotation r and the velocity v of
the hub through the air::

    F = T d - CN rho n^2 D^4 v_across / v
    M = - r Q_e d - omega x (r I w d) - r CM rho n^2 D^5 v_across / v      at the hub

The acceleration of the shaft is the derivative of the recorded speed up to 1 Hz: a difference of
successive samples makes a torque of the noise of the tachometer.
"""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.errors import AeromatchWarning, IdentificationError
from flightmech.names import quantity_attributes
from flighttest.reconstruction.dynamics.deck_thrust import deck_channels, has_spool_speed
from flighttest.reconstruction.dynamics.reduced_rates import (
    Columns,
    center_of_gravity,
    read_columns,
    stack_columns,
)
from flighttest.reconstruction.dynamics.shaft_condition import (
    Condition,
    air_of,
    blade_setting,
    has_shaft_speed,
    hub_velocity,
    power_of,
    power_unit,
    propeller_of,
    shaft_condition,
    shaft_speed,
    table_at,
    thrust_unit,
)
from flighttest.records.signals.differentiation import derivative, derivative_window
from flighttest.records.signals.resampling import GAP

_SLOWEST = 1.0  # of the shaft [rad s-1], and of the air [m s-1]
# Acceleration of the shaft: frequency [Hz] at which the moving polynomial has the given gain, and
# its order. A lag of shaft and governor of 0.3 s or more ends below it.
_SHAFT_BAND, _GAIN, _ORDER = 1.0, 0.9, 2
_UNIFORM = 0.01  # relative range of the steps of a clock that counts as uniform
# Longest step over which the speed of the shaft is interpolated, in periods of the band.
_LONGEST_STEP = 0.5


def with_engine_channels(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return states with thrust, torque and coefficients of propellers, and the thrust of jets.

    Recorded channels are not changed. A ``CT`` of the states goes where a thrust is added: it is of
    the tables with which the path was reconstructed. A propeller without ``engineN.rpm`` gets no
    channels, and a jet without a deck or without recorded speeds of its spools neither
    (`deck_channels`).

    Parameters
    ----------
    states : Dataset (time,)
        ``V``, ``engineN.rpm`` or ``engineN.engine_rpm``, the air (`air_of`, or ``qbar``), and for
        the power ``engineN.torque``, or what the tables of the engine depend on. [SI]
    aircraft : Aircraft

    Raises
    ------
    IdentificationError
        A governed propeller without a measured power and without a recorded thrust.

    Warns
    -----
    AeromatchWarning
        A governed propeller with a recorded thrust and without a measured power: its torque and its
        force and moment in inflow from the side are unknown, and are not subtracted.
    """
    propellers, jets = [], []
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.propeller is not None and has_shaft_speed(states, number):
            propellers.append(number)
        # a recorded thrust holds, without the ram drag of the tables
        if f"engine{number}.thrust" not in states and has_spool_speed(states, engine, number):
            jets.append(number)
    if not propellers and not jets:
        return states
    columns = read_columns(states)
    columns = _with_air(columns)
    cg = center_of_gravity(columns, aircraft)
    added = {}
    for number in (*propellers, *jets):
        engine = aircraft.engines[number - 1]
        if number in propellers:
            channels = propeller_channels(columns, engine, number, cg)
        else:
            channels = deck_channels(columns, engine, number)
        for name, values in channels.items():
            full = f"engine{number}.{name}"
            if full not in states:
                added[full] = ("time", values, quantity_attributes(full))
    if any(name.endswith(".thrust") for name in added):
        states = states.drop_vars("CT", errors="ignore")
    return states.assign(added)


def _with_air(columns: Columns) -> Columns:
    """Return columns with the air; the density is that of dynamic pressure and airspeed."""
    columns = {**columns, **air_of(columns)}
    if "qbar" in columns:
        V = np.maximum(columns["V"], _SLOWEST)
        density = 2.0 * columns["qbar"] / V**2
        columns["rho"] = np.where(columns["V"] > _SLOWEST, density, columns["rho"])
    return columns


def propeller_channels(
    columns: Columns, engine: Engine, number: int, cg: np.ndarray | tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Return thrust, torque and coefficients of one engine with a propeller, by their last word.

    Parameters
    ----------
    columns : dict of str to array (time,)
        As `shaft_condition`, and ``time``. [SI]
    engine : Engine
    number : int
        1 for the first.
    cg : array (time, 3) or (3,)
        Centre of gravity. [m]

    Raises
    ------
    IdentificationError
        The speed is missing, or a governed propeller has neither a measured power nor a thrust.

    Warns
    -----
    AeromatchWarning
        As `with_engine_channels`.
    """
    propeller = propeller_of(engine, number)
    at = shaft_condition(columns, engine, number, cg)
    spin_up = propeller.inertia * _shaft_acceleration(at["rpm"], columns["time"])
    power = _engine_power(at, engine)
    if propeller.turns_blades:
        if power is None:
            if f"engine{number}.thrust" in columns:
                _warn_of_torque(number)
                return {"J": at["J"]}
            raise IdentificationError(
                f"engine {number}: the blade angle of its propeller follows from the power, and "
                f"neither torque nor what its tables need is recorded; map engine{number}.torque, "
                f"manifold_pressure, n1 or throttle"
            )
        angle = blade_setting(propeller, at, power - spin_up * at["rpm"]).angle
        at = at | {"blade_angle": angle}
    CT, CP = (table_at(propeller.tables[name], at) for name in ("CT_prop", "CP_prop"))
    speed = np.maximum(at["rpm"], _SLOWEST)
    if power is None:
        # torque of the engine: that of the air and the acceleration of the shaft
        power = CP * power_unit(propeller, at) + spin_up * speed
    channels = {
        "thrust": CT * thrust_unit(propeller, at),
        "torque": power / speed,
        "J": at["J"],
        "CT_prop": CT,
        "CP_prop": CP,
        "shaft_power": power,
    }
    if "blade_angle" in at:
        channels["blade_angle"] = at["blade_angle"]
    return channels


def _warn_of_torque(number: int) -> None:
    text = (
        f"engine {number}: thrust is recorded, but neither torque nor what the tables of the "
        f"engine need; the rolling moment of the torque and the loads of inflow from the side stay "
        f"in the coefficients of the airframe; map engine{number}.torque, manifold_pressure, n1 or "
        "throttle"
    )
    warnings.warn(text, AeromatchWarning, stacklevel=4)


def _shaft_acceleration(speed: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the derivative of a speed (time,) up to `_SHAFT_BAND`. [rad/s2]

    Each stretch between gaps is differentiated on its own.  Below ten samples per second the
    derivative is that of successive samples.  A sample between two gaps, and one without a speed,
    have NaN.

    Raises
    ------
    IdentificationError
        The clock does not increase.
    """
    acceleration = np.full(len(time), np.nan)
    # missing samples are a gap in the clock: a NaN would spread over the window
    known = np.flatnonzero(np.isfinite(speed))
    steps = np.diff(time[known])
    if not steps.size:
        return acceleration
    if not steps.min() > 0.0:
        raise IdentificationError(
            f"the time of the speed of the propeller steps by {steps.min():.4g} s, where more than "
            f"0 s is possible; resample on an increasing clock first"
        )
    # the speed between the samples of a gap is unknown
    longest = _LONGEST_STEP / _SHAFT_BAND
    # every step of a slow clock is longer than that: its gaps are those of any clock
    if _is_slow(float(np.median(steps))):
        longest = GAP * float(np.median(steps))
    gaps = np.flatnonzero(steps > longest) + 1
    for part in np.split(known, gaps):
        if len(part) > 1:
            acceleration[part] = _stretch_acceleration(speed[part], time[part])
    return acceleration


def _is_slow(step: float) -> bool:
    """Return whether a period of the band has fewer than ten samples."""
    # a clock of 10 Hz has rounding errors
    return 10.0 * step * _SHAFT_BAND > 1.0 + 1e-6


def _stretch_acceleration(speed: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return `_shaft_acceleration` of a stretch without a gap; times that jitter are resampled."""
    steps = np.diff(time)
    step = float(np.median(steps))
    if _is_slow(step):
        return np.gradient(speed, time)
    if np.ptp(steps) <= _UNIFORM * step:
        return _derivative_in_band(speed, step, time)
    # The median of rounded steps drifts from the clock over the record; their mean does not.
    clock = np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)
    step = float(clock[1] - clock[0])
    return np.interp(time, clock, _derivative_in_band(np.interp(clock, time, speed), step, clock))


def _derivative_in_band(speed: np.ndarray, step: float, time: np.ndarray) -> np.ndarray:
    """Return the derivative of a speed on a uniform clock up to `_SHAFT_BAND`. [rad/s2]"""
    window = derivative_window(_SHAFT_BAND, step, _ORDER, _GAIN)
    # a record that is shorter than the window is one polynomial
    window = min(window, len(speed) - 1 + len(speed) % 2)
    if window <= _ORDER:
        return np.gradient(speed, time)
    return derivative(speed, step, window, _ORDER)


def _engine_power(at: Condition, engine: Engine) -> np.ndarray | None:
    """Return the power at the shaft: torque, else the engine tables; None without both. [W]"""
    if "torque" in at:
        return at["torque"] * at["rpm"]
    tabled = power_of(engine, at)
    return None if tabled is None else tabled.gross - tabled.losses


def propeller_load(
    columns: Columns, engine: Engine, number: int, cg: np.ndarray | tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the loads of a propeller in addition to its thrust, body axes, at its hub.

    Parameters
    ----------
    columns : dict of str to array (time,)
        As `with_engine_channels` returns them, with ``p q r alpha``, and ``beta`` where it
        exists.
    engine : Engine
    number : int
    cg : array (time, 3) or (3,)
        Centre of gravity. [m]

    Returns
    -------
    F, M : array (time, 3)
        Force in the disk, and moment of torque, rotor and P-factor. [N, N m] None for an engine
        without a propeller or states without its speed; of the rotor alone where the torque is
        unknown.
    """
    propeller = engine.propeller
    if propeller is None or not has_shaft_speed(columns, number):
        return None
    line = np.asarray(engine.direction, float)
    rpm = shaft_speed(columns, engine, number)
    omega = stack_columns(columns, ("p", "q", "r"))
    momentum = propeller.rotation * propeller.inertia * rpm[:, None] * line
    moment = -np.cross(omega, momentum)
    force = np.zeros_like(moment)
    torque = columns.get(f"engine{number}.torque")
    if torque is None:
        return force, moment
    moment = moment - propeller.rotation * torque[:, None] * line
    if not {"CN_prop", "CM_prop"} & set(propeller.tables):
        return force, moment
    at = shaft_condition(_with_air(columns), engine, number, cg)
    load = thrust_unit(propeller, at)
    velocity = hub_velocity(columns, engine, cg)
    across = velocity - (velocity @ line)[:, None] * line
    across = across / np.maximum(np.linalg.norm(velocity, axis=1), _SLOWEST)[:, None]
    if "CN_prop" in propeller.tables:
        lift = load * table_at(propeller.tables["CN_prop"], at)
        force = force - lift[:, None] * across
    if "CM_prop" in propeller.tables:
        turn = load * propeller.diameter * table_at(propeller.tables["CM_prop"], at)
        moment = moment - propeller.rotation * turn[:, None] * across
    return force, moment
