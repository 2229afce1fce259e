"""A simulated flight as the instruments of the aircraft file would record it.

Every instrument shows the truth at its place, late by its delay, with the constant errors and the
white noise of its specification (`flighttest.records.sensors.instruments`): one draw of the
constant errors per aircraft, one of the noise per run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.air import impact_pressure
from flighttest.records.sensors.instruments import IMU, Instrument, parse_instruments

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

_ATTITUDE_AND_PLACE = {
    "phi": "phi",
    "theta": "theta",
    "psi": "psi",
    "vn": "vn",
    "ve": "ve",
    "vd": "vd",
    "h_gps": "h",
    "temperature": "temperature",
}


def draw_errors(aircraft: Aircraft, rng: np.random.Generator) -> dict[str, float]:
    """Return constant errors of the instruments of an aircraft, drawn from their specification.

    Returns
    -------
    dict of str to float
        ``bias.p``, ``delay.gps``, ``static_error`` ..., named as `reconstruct` estimates them. [SI]
    """
    found: dict[str, float] = {}
    for name, item in parse_instruments(
        aircraft.instruments, f"instruments of {aircraft.name}"
    ).table.items():
        found |= {
            f"bias.{channel}": rng.normal(0.0, sigma) for channel, sigma in item.bias_sigma.items()
        }
        if item.delay:
            found[f"delay.{name}"] = max(0.0, rng.normal(*item.delay))
        if item.static_error:
            found["static_error"] = rng.normal(*item.static_error)
    return found


def as_recorded(
    truth: xr.Dataset,
    aircraft: Aircraft,
    errors: dict[str, float],
    rng: np.random.Generator,
    rates: dict[str, float],
    title: str = "",
) -> xr.DataTree:
    """Return a flight record of a simulated flight.

    Parameters
    ----------
    truth : Dataset (time,)
        Outputs of `flightmech.simulate`: `V p q r p_dot q_dot r_dot phi theta psi ax ay az vn ve vd
        h mach p_static temperature`, and the surfaces as ``applied.delta_e`` .... [SI]
    aircraft : Aircraft
        For the instruments and the c.g.
    errors : dict of str to float
        As `draw_errors` gives them.
    rng : Generator
        For the noise.
    rates : dict of str to float
        Samples per second of each instrument; the others record as fast as `truth`. [Hz]
    title : str
        Of the record.

    Returns
    -------
    DataTree
        One leaf per instrument, and the surfaces without error in the leaf ``controls``.
    """
    table = parse_instruments(aircraft.instruments, f"instruments of {aircraft.name}").table
    time = truth["time"].values
    shown = _readings(truth, aircraft, table, errors.get("static_error", 0.0))
    leaves: dict[str, xr.Dataset] = {}
    for name, item in table.items():
        step = 1.0 / rates[name] if name in rates else float(np.median(np.diff(time)))
        clock = np.arange(time[0], time[-1] + 1e-9, step)
        leaves[f"/{name}"] = xr.Dataset(coords={"time": clock}, attrs={"rate": 1.0 / step})
        for channel, sigma in item.noise.items():
            late = np.interp(clock - errors.get(f"delay.{name}", 0.0), time, shown[channel])
            leaves[f"/{name}"][channel] = (
                "time",
                late + errors.get(f"bias.{channel}", 0.0) + rng.normal(0.0, sigma, len(clock)),
            )
    surfaces = {
        str(n).removeprefix("applied."): ("time", truth[n].values)
        for n in truth.data_vars
        if str(n).startswith("applied.delta_")
    }
    leaves["/controls"] = xr.Dataset(
        surfaces, {"time": time}, {"rate": 1.0 / float(np.median(np.diff(time)))}
    )
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": title}), **leaves})


def _readings(
    truth: xr.Dataset, aircraft: Aircraft, table: dict[str, Instrument], static_error: float
) -> dict[str, np.ndarray]:
    """Every channel without noise, delay and bias."""
    place = next(item.position for item in table.values() if "ax_imu" in item.noise)
    arm = np.asarray(place, float) - np.asarray(aircraft.cg, float)
    omega, omega_dot, force = (
        np.stack([truth[name].values for name in names], axis=1)
        for names in (("p", "q", "r"), ("p_dot", "q_dot", "r_dot"), ("ax", "ay", "az"))
    )
    sensed = force + np.cross(omega_dot, arm) + np.cross(omega, np.cross(omega, arm))
    p_static = truth["p_static"].values
    q_c = impact_pressure(truth["mach"].values, p_static)
    return {
        **dict(zip(IMU, np.hstack([omega, sensed]).T, strict=True)),
        **{channel: truth[name].values for channel, name in _ATTITUDE_AND_PLACE.items()},
        "p_static": p_static + static_error * q_c,
        "q_c": q_c * (1.0 - static_error),
    }
