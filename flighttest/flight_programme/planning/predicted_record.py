"""Flight record of a predicted flight, with the errors of the instruments of the aircraft."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import impact_pressure
from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import WRAPPED, quantity_attributes
from flighttest.flight_programme.planning.catalogue import RATE
from flighttest.flight_programme.planning.pilot import PredictedFlight
from flighttest.records.sensors.instruments import (
    IMU,
    VANES,
    Instrument,
    Instruments,
    parse_instruments,
)
from flighttest.records.signals.delays import remove_lag

_ATTITUDE = ("phi", "theta", "psi")
_CONTROLS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake")
_MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b")


def predicted_record(
    flight: PredictedFlight,
    aircraft: Aircraft,
    title: str,
    rates: Mapping[str, float] | None = None,
    seed: int = 0,
) -> xr.DataTree:
    """Return the flight record of a predicted flight.

    Parameters
    ----------
    flight : PredictedFlight
    aircraft : Aircraft
        Its instruments: noise, positions, mean factors, lags, delays and static error.
    title : str
        Title of the record.
    rates : mapping of str to float, optional
        Samples per second of an instrument by its name; 50 Hz by default. [Hz]
    seed : int
        Seed of the noise.

    Returns
    -------
    DataTree
        As `flighttest.read` returns it, with manoeuvres.

    Raises
    ------
    SchemaError
        A reconstruction is not possible with the instruments.
    """
    rng = np.random.default_rng(seed)
    specification = parse_instruments(aircraft.instruments, f"instruments of {aircraft.name}")
    time = flight.motion["time"].values
    measured = _measure(flight.motion, aircraft, specification)
    if flight.runway is not None:
        measured["h_radio"] = _height_of_antenna(flight.motion, specification)
    leaves: dict[str, xr.Dataset] = {}
    # one leaf per instrument; the order of the leaves is the order of the random draws
    for name, instrument in specification.table.items():
        channels = {}
        for channel in instrument.noise:
            if channel in measured and channel not in _CONTROLS:
                channels[channel] = measured[channel]
        if channels:
            rate = (rates or {}).get(name, RATE)
            leaves[name] = _sample_channels(time, channels, instrument, rate=rate, rng=rng)
    thrusts = [name for name in measured if name.endswith(".thrust")]
    inputs = {name: measured[name] for name in (*_CONTROLS, *_MASS, *thrusts) if name in measured}
    surfaces = _surface_instrument(specification)
    leaves["controls_and_mass"] = _sample_channels(time, inputs, surfaces, rate=RATE, rng=rng)
    attributes: dict[str, Any] = {
        "title": title,
        "manoeuvres": json.dumps(flight.marks),
        "unmapped": "",
        "absent": "",
        "notes": "[]",
        "purpose": "prediction",
    }
    if flight.runway is not None:
        attributes["runway_elevation"] = flight.runway
    leaves["/"] = xr.Dataset(attrs=attributes)
    return xr.DataTree.from_dict(leaves)


def _surface_instrument(specification: Instruments) -> Instrument:
    """Return the instrument of the surfaces; without one they are measured exactly."""
    for instrument in specification.table.values():
        if set(instrument.noise) & set(_CONTROLS):
            return instrument
    return Instrument()


def _measure(
    motion: xr.Dataset, aircraft: Aircraft, specification: Instruments
) -> dict[str, np.ndarray]:
    """Return what sensors without noise measure at their positions, by channel."""
    y = {str(name): item.values for name, item in motion.data_vars.items()}
    time = motion["time"].values
    columns = []
    for name, fixed in zip(_MASS[1:], aircraft.cg, strict=True):
        columns.append(y.get(name, np.full(len(time), fixed)))
    cg = np.stack(columns, axis=1)
    omega = np.stack([y[name] for name in "pqr"], axis=1)

    measured = dict(zip(IMU[:3], omega.T, strict=True))
    force = _force_at_sensor(y, _lever_arm(specification, "ax_imu", cg), omega)
    measured |= dict(zip(IMU[3:], force.T, strict=True))
    measured |= {name: y[name] for name in _ATTITUDE}

    velocity = np.stack([y[name] for name in "uvw"], axis=1)
    for name in VANES:
        vane = specification.of(name)
        # A vane shows the angle of the flow at its own position.
        u, v, w = (velocity + np.cross(omega, _lever_arm(specification, name, cg))).T
        crosswise = w if name == "alpha_vane" else v
        angle = np.arctan2(crosswise, u)
        lagged = angle
        if vane.lag:
            # the inverse correction adds the lag
            lagged = remove_lag(time, angle, -vane.lag[0], name)
        measured[name] = vane.factor.get(name, (1.0, 0.0))[0] * lagged

    # a static error moves pressure from the impact pressure to the static pressure
    q_c = impact_pressure(y["mach"], y["p_static"])
    error = (specification.of("q_c").static_error or (0.0, 0.0))[0]
    measured["q_c"] = q_c * (1.0 - error)
    measured["p_static"] = y["p_static"] + error * q_c
    measured["temperature"] = y["temperature"]
    for name in ("V", "V_cas", "mach"):
        measured[name] = y[name] * specification.of(name).factor.get(name, (1.0, 0.0))[0]
    measured |= {"vn": y["vn"], "ve": y["ve"], "vd": y["vd"], "h_gps": y["h"]}
    return measured | _known_inputs(y)


def _height_of_antenna(motion: xr.Dataset, specification: Instruments) -> np.ndarray:
    """Return the height of the antenna of the radio altimeter over the runway. [m]"""
    a, b, d = specification.of("h_radio").position or (0.0, 0.0, 0.0)
    phi, theta = motion["phi"].values, motion["theta"].values
    # third row of the rotation from body to north-east-down, times the position
    below = -np.sin(theta) * a + np.cos(theta) * (np.sin(phi) * b + np.cos(phi) * d)
    return motion["h_agl"].values - below


def _lever_arm(specification: Instruments, channel: str, cg: np.ndarray) -> np.ndarray:
    """Return the position of a sensor from the centre of gravity, (time, axis). [m]"""
    position = specification.of(channel).position
    if position is None:
        return np.zeros_like(cg)
    return np.asarray(position) - cg


def _force_at_sensor(y: Mapping[str, np.ndarray], r: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the specific force at a position, a + omega_dot x r + omega x (omega x r)."""
    omega_dot = np.stack([y[f"{name}_dot"] for name in "pqr"], axis=1)
    return (
        np.stack([y[name] for name in ("ax", "ay", "az")], axis=1)
        + np.cross(omega_dot, r)
        + np.cross(omega, np.cross(omega, r))
    )


def _known_inputs(y: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return controls as applied, mass properties and thrusts."""
    inputs = {}
    for name in _CONTROLS:
        if f"applied.{name}" in y:
            inputs[name] = y[f"applied.{name}"]
        elif name in y:
            inputs[name] = y[name]
    for name, x in y.items():
        if name in _MASS or (name.startswith("engine") and name.endswith(".thrust")):
            inputs[name] = x
    return inputs


def _sample_channels(
    time: np.ndarray,
    channels: Mapping[str, np.ndarray],
    instrument: Instrument,
    *,
    rate: float,
    rng: np.random.Generator,
) -> xr.Dataset:
    """Return channels at the rate of an instrument, with its delay and noise."""
    clock = np.arange(time[0], time[-1] + 1e-9, 1.0 / rate)
    delay = instrument.delay[0] if instrument.delay else 0.0
    variables = {}
    for name, x in channels.items():
        if name in WRAPPED:
            # interpolation across +-pi needs a continuous angle
            x = np.unwrap(x)
        sampled = np.interp(clock - delay, time, x)
        level = instrument.noise.get(name, 0.0)
        if level:
            sampled = sampled + rng.normal(0.0, level, len(clock))
        variables[name] = ("time", sampled, quantity_attributes(name))
    attributes = {"rate": rate, "gaps": "", "duplicates": 0, "missing": "", "flags": "[]"}
    return xr.Dataset(variables, {"time": ("time", clock, quantity_attributes("time"))}, attributes)
