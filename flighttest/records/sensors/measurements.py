"""The channels of a record that a reconstruction reads, inside its windows, with derived air data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.air import (
    GAMMA,
    R_AIR,
    atmosphere,
    impact_pressure,
    impact_pressure_at,
    mach_number,
)
from flightmech.errors import OutOfRange, SchemaError
from flightmech.names import quantity_attributes
from flighttest.records.sensors.instruments import IMU, MEASURED, SPEEDS, Instruments
from flighttest.records.signals.conditioning import demand_numbers, lowpass
from flighttest.records.signals.sample_flags import find_spikes

_EARTH_RADIUS = 6356766.0  # m, of the standard atmosphere's geopotential height


def pressure(h_baro) -> np.ndarray:
    """Return the static pressure behind a pressure altitude, which counts geopotential metres. [Pa]

    Examples
    --------
    >>> round(float(pressure(11000.0)))
    22632
    """
    h = np.asarray(h_baro, float)
    return atmosphere(_EARTH_RADIUS * h / (_EARTH_RADIUS - h)).p_static


def derive_air_data(leaves: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the leaves that gain static or impact pressure computed back from what the air-data
    computer shows.

    Parameters
    ----------
    leaves : dict of Dataset
        Leaves of a record; nothing is derived where the pressures are recorded.

    Returns
    -------
    dict of Dataset
        The changed leaves: ``p_static`` from ``h_baro``; ``q_c`` from ``mach``, from ``V`` with
        ``temperature``, or from ``V_cas``, whichever stands in the same leaf first.
    """
    changed = {}
    recorded = {str(name) for data in leaves.values() for name in data.data_vars}
    for leaf, data in leaves.items():
        new = data
        if "p_static" not in recorded and "h_baro" in data:
            new = new.assign(
                p_static=("time", pressure(data["h_baro"].values), quantity_attributes("p_static"))
            )
        if "q_c" not in recorded and (q := _impact(new)) is not None:
            new = new.assign(q_c=("time", q, quantity_attributes("q_c")))
        if new is not data:
            changed[leaf] = new
    return changed


def _impact(data: xr.Dataset) -> np.ndarray | None:
    if "p_static" in data and "mach" in data:
        return impact_pressure(data["mach"].values, data["p_static"].values)
    if {"p_static", "V", "temperature"} <= set(data.data_vars):
        return impact_pressure(
            data["V"].values / np.sqrt(GAMMA * R_AIR * data["temperature"].values),
            data["p_static"].values,
        )
    if "V_cas" in data:
        return impact_pressure_at(data["V_cas"].values)
    return None


class MeasuredChannels:
    """Channels of a record inside the windows, with derived air data."""

    def __init__(self, record: xr.DataTree, windows: Sequence[tuple[float, float]]):
        leaves = {name: node.to_dataset() for name, node in record.children.items()}
        self.recorded = {str(name) for data in leaves.values() for name in data.data_vars}
        leaves.update(_with_temperature(leaves, record.attrs.get("temperature")))
        leaves.update(derive_air_data(leaves))
        self.windows = windows
        self.title = str(record.attrs.get("title", "flight record"))
        self.leaf: dict[str, str] = {
            str(n): leaf for leaf, data in leaves.items() for n in data.data_vars
        }
        self.leaves = leaves
        self._spikes: dict[str, np.ndarray] = {}
        self._clean: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def __contains__(self, name: str) -> bool:
        return name in self.leaf

    def get(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return clock and values of a channel; heading unwrapped, readings that are spikes
        replaced by the line over them.

        The arrays are kept for the next call: they are not to be written to.
        """
        if name not in self._clean:
            self._clean[name] = self._cleaned(name)
        return self._clean[name]

    def _cleaned(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        data = self.leaves[self.leaf[name]]
        demand_numbers({self.leaf[name]: self._near(data[[name]])}, self.title)
        x, clock = data[name].values.astype(float), data["time"].values
        x = np.unwrap(x) if name == "psi" else x
        wild = self.spikes(name)
        return clock, x if name in IMU or not wild.any() else np.interp(
            clock, clock[~wild], x[~wild]
        )

    def spikes(self, name: str) -> np.ndarray:
        """Return which samples of a channel are spikes."""
        if name not in self._spikes:
            self._spikes[name] = find_spikes(
                self.leaves[self.leaf[name]][name].values.astype(float), name
            )
        return self._spikes[name]

    def spikes_in_words(self) -> list[str]:
        """Return what was done about spikes inside the windows."""
        words = []
        for name in (name for name in (*IMU, *MEASURED) if name in self.recorded):
            clock = self.leaves[self.leaf[name]]["time"].values
            near = self.spikes(name) & np.any(
                [(clock >= a) & (clock <= b) for a, b in self.windows], axis=0
            )
            if near.any():
                remedy = (
                    "the path goes through them; choose windows without them"
                    if name in IMU
                    else "left out"
                )
                words.append(
                    f"{name}: {near.sum()} samples are spikes, first at {clock[near][0]:g} "
                    f"s; {remedy}"
                )
        return words

    def rate(self, name: str) -> float:
        """Return the samples per second of a channel."""
        return float(self.leaves[self.leaf[name]].attrs["rate"])

    def _near(self, data: xr.Dataset) -> xr.Dataset:
        time = data["time"].values
        near = np.any([(time >= a) & (time <= b) for a, b in self.windows], axis=0)
        return data if near.all() else data.isel(time=near)

    def by_leaf(self, names: Sequence[str]) -> list[list[str]]:
        """Return `names` that the record has, grouped by leaf."""
        groups: dict[str, list[str]] = {}
        for name in names:
            if name in self:
                groups.setdefault(self.leaf[name], []).append(name)
        return list(groups.values())


def _with_temperature(
    leaves: dict[str, xr.Dataset], temperature: float | None
) -> dict[str, xr.Dataset]:
    """Return the leaf of the airspeed with the constant outside temperature that the record states,
    where no channel shows one.
    """
    if temperature is None or any("temperature" in data for data in leaves.values()):
        return {}
    leaf = next(
        (leaf for name in ("q_c", *SPEEDS) for leaf, data in leaves.items() if name in data), None
    )
    if leaf is None:
        return {}
    data = leaves[leaf]
    return {
        leaf: data.assign(
            temperature=(
                "time",
                np.full(data.sizes["time"], float(temperature)),
                quantity_attributes("temperature"),
            )
        )
    }


def airspeed_channel(channels: MeasuredChannels, specification: Instruments) -> str:
    """Return the channel that shows the airspeed: impact pressure when recorded, else V, V_cas or
    mach with noise of its own.

    Raises
    ------
    SchemaError
        Several airspeeds that would count as independent readings.
    """
    if "q_c" in channels.recorded and specification.name_of("q_c"):
        return "q_c"
    shown = [name for name in SPEEDS if name in channels.recorded and specification.name_of(name)]
    if len(shown) > 1:
        raise SchemaError(
            "instruments",
            [
                f"noise of {' and '.join(shown)}: one pitot tube shows all of them, one at "
                f"most can be a reading; keep the noise of one"
            ],
        )
    return shown[0] if shown else "q_c"


def order_windows(
    record: xr.DataTree, windows: Sequence[tuple[float, float]] | None
) -> list[tuple[float, float]]:
    """Return the windows in order, by default the whole span of the inertial unit.

    Raises
    ------
    OutOfRange
        A window outside the record, or two that overlap.
    SchemaError
        Channels of the inertial unit are missing.
    """
    missing = [
        name
        for name in (*IMU, "phi", "theta")
        if not any(name in node.data_vars for node in record.children.values())
    ]
    if missing:
        raise SchemaError(
            "flight record",
            [
                f"no channel {name}; the reconstruction needs it, name its column in the name map"
                for name in missing
            ],
        )
    clock = next(
        node.to_dataset()["time"].values
        for node in record.children.values()
        if "p" in node.data_vars
    )
    first, last = float(clock[0]), float(clock[-1])
    chosen = (
        sorted((float(a), float(b)) for a, b in windows) if windows is not None else [(first, last)]
    )
    end = -np.inf
    for a, b in chosen:
        if a < first - 1e-9 or b > last + 1e-9 or not b > a:
            raise OutOfRange(
                f"window {a:g} ... {b:g} s; the record holds {first:g} ... {last:g} s; "
                f"choose a window inside it"
            )
        if a <= end:
            raise OutOfRange(f"windows overlap at {a:g} s; join them")
        end = b
    return chosen


@dataclass(frozen=True)
class AirData:
    """Air data as recorded: clock, smoothed temperature, rough true airspeed; `delay` is the
    expected latency.

    `channel` shows the airspeed, see `airspeed_channel`.
    """

    channel: str
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


def air_readings(channels: MeasuredChannels, specification: Instruments) -> AirData:
    """Return the air data of a record.

    Without static pressure that of the standard atmosphere at ``h_gps`` is taken, for first values
    only.

    Raises
    ------
    SchemaError
        Airspeed, static pressure (or height) or temperature are neither recorded nor to be derived.
    """
    name = airspeed_channel(channels, specification)
    demand_air_data(channels, name)
    clock, shown = channels.get(name)
    T = np.interp(clock, *channels.get("temperature"))
    p = np.interp(
        clock,
        *(channels.get("p_static") if "p_static" in channels else _standard_pressure(channels)),
    )
    rate = channels.rate(name)
    if rate > 2.5 and len(clock) > 30:
        T, shown = lowpass(T, rate, 0.5), lowpass(shown, rate, 1.0)
    item = specification.of(name)
    speed = _true_airspeed(name, shown / item.factor.get(name, (1.0, 0.0))[0], p, T)
    return AirData(name, clock, T, speed, p, (item.delay or (0.0, 0.0))[0])


def demand_air_data(channels: MeasuredChannels, name: str) -> None:
    """Check that airspeed (channel `name`), static pressure or height, and temperature are there.

    Raises
    ------
    SchemaError
        All that is missing.
    """
    problems = []
    if name not in channels:
        shown = [speed for speed in SPEEDS if speed in channels]
        found = (
            f"{', '.join(shown)} recorded, but no instrument gives its noise"
            if shown
            else "no airspeed recorded"
        )
        problems.append(
            f"no channel q_c: {found}; record q_c, or h_baro with mach, V or V_cas, or give "
            f"an instrument the noise of V, V_cas or mach"
        )
    if "p_static" not in channels and "h_gps" not in channels:
        problems.append("no channel p_static; give p_static, h_baro or h_gps")
    if "temperature" not in channels:
        problems.append(
            "no channel temperature; record it, or state a constant one: [record] "
            'temperature = "12 degC" in the name map'
        )
    if problems:
        raise SchemaError("flight record", problems)


def _standard_pressure(channels: MeasuredChannels) -> tuple[np.ndarray, np.ndarray]:
    clock, h = channels.get("h_gps")
    return clock, atmosphere(h).p_static


def _true_airspeed(name: str, shown: np.ndarray, p: np.ndarray, T: np.ndarray) -> np.ndarray:
    a = np.sqrt(GAMMA * R_AIR * T)
    if name == "V":
        return np.maximum(shown, 0.0)
    if name == "mach":
        return np.maximum(shown, 0.0) * a
    q_c = impact_pressure_at(np.maximum(shown, 0.0)) if name == "V_cas" else np.maximum(shown, 0.0)
    return mach_number(q_c, p) * a
