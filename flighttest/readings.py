"""The channels of a record that a reconstruction reads, inside its windows, with derived air data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, mach_number
from flightmech.errors import OutOfRange, SchemaError

from .air_data import derived
from .conditioning import demand_numbers, lowpass
from .instruments import IMU, Instruments

MEASURED = ("phi", "theta", "psi", "vn", "ve", "vd", "h_gps", "q_c", "p_static", "temperature", "alpha_vane", "beta_vane", "h_radio")
"""Channels that the reconstruction can use as measurements."""


class Channels:
    """Channels of a record inside the windows, with derived air data."""

    def __init__(self, record: xr.DataTree, windows: Sequence[tuple[float, float]]):
        leaves = {name: node.to_dataset() for name, node in record.children.items()}
        leaves.update(derived(leaves))
        self.windows = windows
        self.title = str(record.attrs.get("title", "flight record"))
        self.leaf: dict[str, str] = {str(n): leaf for leaf, data in leaves.items() for n in data.data_vars}
        self.leaves = leaves

    def __contains__(self, name: str) -> bool:
        return name in self.leaf

    def get(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return clock and values of a channel; heading unwrapped."""
        data = self.leaves[self.leaf[name]]
        x = data[name].values.astype(float)
        demand_numbers({self.leaf[name]: self._near(data[[name]])}, self.title)
        return data["time"].values, np.unwrap(x) if name == "psi" else x

    def rate(self, name: str) -> float:
        """Return the samples per second of a channel."""
        return float(self.leaves[self.leaf[name]].attrs["rate"])

    def _near(self, data: xr.Dataset) -> xr.Dataset:
        time = data["time"].values
        return data.isel(time=np.any([(time >= a) & (time <= b) for a, b in self.windows], axis=0))

    def by_leaf(self, names: Sequence[str]) -> list[list[str]]:
        """Return `names` that the record has, grouped by leaf."""
        groups: dict[str, list[str]] = {}
        for name in names:
            if name in self:
                groups.setdefault(self.leaf[name], []).append(name)
        return list(groups.values())


def windows_of(record: xr.DataTree, windows: Sequence[tuple[float, float]] | None) -> list[tuple[float, float]]:
    """Return the windows in order, by default the whole span of the inertial unit.

    Raises
    ------
    OutOfRange
        A window outside the record, or two that overlap.
    SchemaError
        Channels of the inertial unit are missing.
    """
    missing = [name for name in (*IMU, "phi", "theta") if not any(name in node.data_vars for node in record.children.values())]
    if missing:
        raise SchemaError("flight record", [f"no channel {name}; the reconstruction needs it" for name in missing])
    clock = next(node.to_dataset()["time"].values for node in record.children.values() if "p" in node.data_vars)
    first, last = float(clock[0]), float(clock[-1])
    chosen = sorted((float(a), float(b)) for a, b in windows) if windows is not None else [(first, last)]
    end = -np.inf
    for a, b in chosen:
        if a < first - 1e-9 or b > last + 1e-9 or not b > a:
            raise OutOfRange(f"window {a:g} ... {b:g} s; the record holds {first:g} ... {last:g} s; choose a window inside it")
        if a <= end:
            raise OutOfRange(f"windows overlap at {a:g} s; join them")
        end = b
    return chosen


@dataclass(frozen=True)
class AirData:
    """Air data as recorded: clock, smoothed temperature, rough true airspeed; `delay` is the expected latency."""

    time: np.ndarray
    temperature: np.ndarray
    speed: np.ndarray
    p_static: np.ndarray
    delay: float

    def at(self, time: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return readings at the times when they were true."""
        return np.interp(time + self.delay, self.time, values)

    def temperature_at(self, time: np.ndarray) -> np.ndarray:
        """Return the measured temperature at true times. [K]"""
        return self.at(time, self.temperature)

    def speed_at(self, time: np.ndarray) -> np.ndarray:
        """Return the rough airspeed at true times. [m s-1]"""
        return self.at(time, self.speed)


def air_readings(channels: Channels, specification: Instruments) -> AirData:
    """Return the air data of a record.

    Raises
    ------
    SchemaError
        Pressures or temperature are neither recorded nor to be derived.
    """
    missing = [name for name in ("q_c", "p_static", "temperature") if name not in channels]
    if missing:
        allowed = "give q_c, p_static, temperature, or h_baro with mach or V or V_cas, and temperature"
        raise SchemaError("flight record", [f"no channel {name}; {allowed}" for name in missing])
    clock, q_c = channels.get("q_c")
    p, T = (np.interp(clock, *channels.get(name)) for name in ("p_static", "temperature"))
    rate = channels.rate("q_c")
    if rate > 2.5 and len(clock) > 30:
        T, q_c = lowpass(T, rate, 0.5), lowpass(q_c, rate, 1.0)
    speed = mach_number(np.maximum(q_c, 0.0), p) * np.sqrt(GAMMA * R_AIR * T)
    return AirData(clock, T, speed, p, (specification.of("q_c").delay or (0.0, 0.0))[0])
