"""Instruments of a drafted aircraft file, with their noise from the records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from aeromatch.drafting.gaps import AircraftGap
from flightmech.names import lookup
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.samples import channel_table

# Least noise per sample of an ordinary instrument, by unit. [SI]
_LEAST = {
    "rad s-1": 1e-4,
    "rad": 2e-4,
    "m s-2": 5e-3,
    "m s-1": 0.05,
    "Pa": 2.0,
    "K": 0.1,
    "m": 0.3,
    "1": 1e-4,
}
# Size of the constant error of an ordinary instrument, by unit. [SI]
_BIAS = {
    "rad s-1": 0.2 * DEGREE,
    "rad": 0.5 * DEGREE,
    "m s-2": 0.2,
    "Pa": 100.0,
    "K": 2.0,
    "m": 1.0,
    "m s-1": 0.5,
    "1": 0.01,
}
_IMU = ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu")
_SPEEDS = ("q_c", "V_cas", "V", "mach")
# Standard deviation of rounding, in steps of the resolution.
_STEP = 1.0 / np.sqrt(12.0)
# Fraction of repeated values above which the resolution of a channel limits its noise.
_REPEATED = 0.05
# Change of the static pressure in one metre near the ground. [Pa/m]
_PRESSURE_GRADIENT = 12.0


def instrument_lines(
    records: Sequence[xr.DataTree], imu: Sequence[str] | None, gaps: list[AircraftGap]
) -> list[str]:
    """Return the tables ``[instruments.*]`` as lines; empty without a channel.

    Parameters
    ----------
    records : sequence of DataTree
    imu : sequence of str (3,), optional
        Position of the inertial unit.
    gaps : list of AircraftGap
        Gets the positions that the author has to confirm.
    """
    noise = noise_by_channel(records)
    if not noise:
        return []
    lines = [
        "",
        "# Instruments: noise is white noise per sample, estimated from the records and "
        "never below that of ordinary instruments;",
        "# bias_sigma is one standard error of the constant error of ordinary instruments: "
        "write what the data sheets state.",
    ]
    lines += _imu_lines(noise, imu, gaps)
    lines += _vane_lines(noise, gaps)
    return lines + _air_data_lines(noise) + _satellite_lines(noise)


def _imu_lines(
    noise: Mapping[str, float], position: Sequence[str] | None, gaps: list[AircraftGap]
) -> list[str]:
    names = [name for name in _IMU if name in noise]
    if not names:
        return []
    if position is None:
        text = (
            "the place of the inertial unit is not known: confirm position of "
            "[instruments.imu] in aircraft.toml"
        )
        gaps.append(AircraftGap(("instruments", "imu", "position"), text))
        line = "position = [0.0, 0.0, 0.0]   # CONFIRM: taken as at the c.g."
    else:
        line = f"position = [{', '.join(position)}]"
    return ["", "[instruments.imu]", line, *_error_lines(noise, names, names)]


def _vane_lines(noise: Mapping[str, float], gaps: list[AircraftGap]) -> list[str]:
    names = [name for name in ("alpha_vane", "beta_vane") if name in noise]
    if not names:
        return []
    text = (
        "the place of the vanes is not known: confirm position of [instruments.vanes] in "
        "aircraft.toml"
    )
    gaps.append(AircraftGap(("instruments", "vanes", "position"), text))
    factors = ", ".join(f"{name} = [1.0, 0.1]" for name in names)
    return [
        "",
        "[instruments.vanes]",
        "position = [0.0, 0.0, 0.0]   # CONFIRM: place of the vanes",
        *_error_lines(noise, names, names),
        f"factor = {{ {factors} }}   # upwash: mean and standard error",
        "lag = [0.05, 0.03]",
    ]


def _air_data_lines(noise: Mapping[str, float]) -> list[str]:
    # One channel of speed is sufficient; the impact pressure is closest to the instrument.
    speed = next((name for name in _SPEEDS if name in noise), "")
    errors: dict[str, float] = {}
    if speed:
        errors[speed] = noise[speed]
    pressure = noise.get("p_static")
    if not pressure and "h_baro" in noise:
        pressure = _PRESSURE_GRADIENT * noise["h_baro"]
    if pressure:
        errors["p_static"] = max(pressure, _LEAST["Pa"])
    if "temperature" in noise:
        errors["temperature"] = noise["temperature"]
    if not errors:
        return []
    # A speed has a scale factor in place of a constant error.
    biased = [name for name in errors if name != speed or speed == "q_c"]
    lines = ["", "[instruments.air_data]", *_error_lines(errors, list(errors), biased)]
    if speed == "q_c":
        lines.append(
            "static_error = [0.0, 0.03]   # static-pressure error over impact pressure: mean "
            "and standard error"
        )
    elif speed:
        lines.append(
            f"factor = {{ {speed} = [1.0, 0.03] }}   # scale of the airspeed: mean and "
            f"standard error"
        )
    return [*lines, "delay = [0.1, 0.1]   # latency [s]: mean and standard error"]


def _satellite_lines(noise: Mapping[str, float]) -> list[str]:
    names = [name for name in ("vn", "ve", "vd", "h_gps") if name in noise]
    if not names:
        return []
    return ["", "[instruments.gps]", *_error_lines(noise, names, ()), "delay = [0.15, 0.1]"]


def _error_lines(
    noise: Mapping[str, float], names: Sequence[str], biased: Sequence[str]
) -> list[str]:
    """Return the lines of the noise, and of the constant errors if there are any."""
    sigmas = ", ".join(f"{name} = {noise[name]:.2g}" for name in names)
    lines = [f"noise = {{ {sigmas} }}"]
    if biased:
        biases = ", ".join(f"{name} = {_BIAS[lookup(name).units]:.2g}" for name in biased)
        lines.append(f"bias_sigma = {{ {biases} }}")
    return lines


def noise_by_channel(records: Sequence[xr.DataTree]) -> dict[str, float]:
    """Return one sigma of the noise of every channel, the median of the records. [SI]

    The noise is the white noise, the rounding, or the least noise of ordinary instruments,
    whichever is largest.
    """
    sizes: dict[str, list[float]] = {}
    for record in records:
        for row in channel_table(record).to_dict("records"):
            rounding = np.nan
            if row["repeated"] > _REPEATED:
                rounding = _STEP * row["resolution"]
            least = _LEAST.get(row["units"], 0.0)
            size = float(np.nanmax([row["noise"], rounding, least]))
            sizes.setdefault(row["channel"], []).append(size)
    return {name: float(np.median(values)) for name, values in sizes.items()}
