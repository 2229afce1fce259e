"""What the instruments of an aircraft would record of a predicted flight: their noise, positions, lags and delays at the mean values.

Constant errors are zero: they do not change what a reconstruction can find out about them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.air import impact_pressure
from flightmech.names import attrs

from ..sensors.instruments import IMU, Instrument, Instruments, instruments
from ..signals.first_order_lag import remove_lag
from .catalogue import RATE
from .pilot import Flown

if TYPE_CHECKING:
    from flightmech import Aircraft

_ATTITUDE = ("phi", "theta", "psi")
_CONTROLS = ("delta_e", "delta_a", "delta_r", "delta_f", "gear", "speedbrake")
_MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b")


def predicted_record(flown: Flown, aircraft: Aircraft, title: str, rates: Mapping[str, float] | None = None, seed: int = 0) -> xr.DataTree:
    """Return the flight record of a predicted flight.

    Parameters
    ----------
    flown : Flown
    aircraft : Aircraft
        Its instruments: noise, positions, mean factors, lags, delays and static error.
    title : str
        Of the record.
    rates : mapping of str to float, optional
        Samples per second of an instrument by its name; 50 Hz without. [Hz]
    seed : int
        Of the noise.

    Returns
    -------
    DataTree
        As `flighttest.read` returns it, with manoeuvres.

    Raises
    ------
    SchemaError
        Instruments that a reconstruction cannot work with.
    """
    rng = np.random.default_rng(seed)
    specification = instruments(aircraft.instruments, f"instruments of {aircraft.name}")
    time = flown.motion["time"].values
    sensed = _sensed(flown.motion, aircraft, specification)
    leaves: dict[str, xr.Dataset] = {}
    for name, item in specification.table.items():
        channels = [channel for channel in item.noise if channel in sensed and channel not in _CONTROLS]
        if channels:
            leaves[name] = _leaf(time, {c: sensed[c] for c in channels}, item, (rates or {}).get(name, RATE), rng)
    known = {c: sensed[c] for c in (*_CONTROLS, *_MASS, *(n for n in sensed if n.endswith(".thrust"))) if c in sensed}
    surfaces = next((item for item in specification.table.values() if set(item.noise) & set(_CONTROLS)), Instrument())
    leaves["controls_and_mass"] = _leaf(time, known, surfaces, RATE, rng)
    about = {"title": title, "manoeuvres": json.dumps(flown.marks), "unmapped": "", "absent": "", "notes": "[]", "purpose": "prediction"}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=about), **{f"/{name}": data for name, data in leaves.items()}})


def _sensed(motion: xr.Dataset, aircraft: Aircraft, specification: Instruments) -> dict[str, np.ndarray]:
    """Return what perfect sensors at their places would show, by channel."""
    y = {str(name): item.values for name, item in motion.data_vars.items()}
    time = motion["time"].values
    cg = np.stack([y.get(name, np.full(len(time), at)) for name, at in zip(_MASS[1:], aircraft.cg, strict=True)], axis=1)
    omega = np.stack([y[name] for name in "pqr"], axis=1)
    omega_dot = np.stack([y[f"{name}_dot"] for name in "pqr"], axis=1)

    def arm(channel: str) -> np.ndarray:
        position = specification.of(channel).position
        return (np.asarray(position) - cg) if position is not None else np.zeros_like(cg)

    r = arm("ax_imu")
    force = np.stack([y[name] for name in ("ax", "ay", "az")], axis=1) + np.cross(omega_dot, r) + np.cross(omega, np.cross(omega, r))
    found = {**dict(zip(IMU[:3], omega.T, strict=True)), **dict(zip(IMU[3:], force.T, strict=True)), **{n: y[n] for n in _ATTITUDE}}
    u, v, w = (np.stack([y[name] for name in "uvw"], axis=1) + np.cross(omega, arm("alpha_vane"))).T
    for name, flow in (("alpha_vane", np.arctan2(w, u)), ("beta_vane", np.arctan2(v, u))):
        item = specification.of(name)
        shown = remove_lag(time, flow, -item.lag[0], name) if item.lag else flow
        found[name] = item.factor.get(name, (1.0, 0.0))[0] * shown
    q_c = impact_pressure(y["mach"], y["p_static"])
    error = (specification.of("q_c").static_error or (0.0, 0.0))[0]
    found |= {"q_c": q_c * (1.0 - error), "p_static": y["p_static"] + error * q_c, "temperature": y["temperature"]}
    found |= {name: y[name] * specification.of(name).factor.get(name, (1.0, 0.0))[0] for name in ("V", "V_cas", "mach")}
    found |= {"vn": y["vn"], "ve": y["ve"], "vd": y["vd"], "h_gps": y["h"]}
    found |= {name: y.get(f"applied.{name}", y.get(name)) for name in _CONTROLS if f"applied.{name}" in y or name in y}
    return found | {name: x for name, x in y.items() if name in _MASS or (name.startswith("engine") and name.endswith(".thrust"))}


def _leaf(time: np.ndarray, channels: Mapping[str, np.ndarray], item: Instrument, rate: float, rng: np.random.Generator) -> xr.Dataset:
    clock = np.arange(time[0], time[-1] + 1e-9, 1.0 / rate)
    delay = item.delay[0] if item.delay else 0.0
    shown = {}
    for name, x in channels.items():
        level = item.noise.get(name, 0.0)
        x = np.interp(clock - delay, time, np.unwrap(x) if name == "psi" else x)
        shown[name] = "time", x + rng.normal(0.0, level, len(clock)) if level else x, attrs(name)
    about = {"rate": rate, "gaps": "", "duplicates": 0, "missing": "", "flags": "[]"}
    return xr.Dataset(shown, {"time": ("time", clock, attrs("time"))}, about)
