"""Channels of a record for the reconstruction inside its windows, with derived air data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from flightmech.names import WRAPPED, quantity_attributes
from flightmech.quantities import time_text
from flighttest.records.sensors.instruments import IMU, MEASURED, SPEEDS, Instruments
from flighttest.records.signals.clock_gaps import clock_gaps, filled_instants, split_at_gaps
from flighttest.records.signals.conditioning import demand_numbers
from flighttest.records.signals.resampling import lowpass
from flighttest.records.signals.sample_flags import find_spikes

# Radius of the Earth in the geopotential height of the standard atmosphere. [m]
_EARTH_RADIUS = 6356766.0
# A window may end this much outside the record, for rounding of its times. [s]
_TIME_TOLERANCE = 1e-9
# Rough air data: channels with a rate above _SMOOTHED_RATE and more samples than _SMOOTHED_SAMPLES
# are low-passed. [Hz]
_SMOOTHED_RATE = 2.5
_SMOOTHED_SAMPLES = 30
_TEMPERATURE_CUTOFF = 0.5
_SPEED_CUTOFF = 1.0


def pressure(h_baro) -> np.ndarray:
    """Return the static pressure of a pressure altitude, which is a geopotential height. [Pa]

    Examples
    --------
    >>> round(float(pressure(11000.0)))
    22632
    """
    return atmosphere(geometric_height(h_baro)).p_static


def geometric_height(geopotential) -> np.ndarray:
    """Return the geometric height r H / (r - H) of a geopotential height. [m]

    `flightmech.air.atmosphere` takes geometric heights.

    Examples
    --------
    >>> round(float(geometric_height(11000.0)), 1)
    11019.1
    """
    H = np.asarray(geopotential, float)
    return _EARTH_RADIUS * H / (_EARTH_RADIUS - H)


def derive_air_data(leaves: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the leaves with static or impact pressure derived from other air data.

    Parameters
    ----------
    leaves : dict of Dataset
        Leaves of a record.  Recorded pressures are not derived.

    Returns
    -------
    dict of Dataset
        The changed leaves only: ``p_static`` from ``h_baro``; ``q_c`` from the first of ``mach``,
        ``V`` with ``temperature``, and ``V_cas`` in the same leaf.
    """
    changed = {}
    recorded = _channel_names(leaves)
    for leaf, data in leaves.items():
        derived = data
        if "p_static" not in recorded and "h_baro" in data:
            p_static = pressure(data["h_baro"].values)
            derived = derived.assign(p_static=("time", p_static, quantity_attributes("p_static")))
        if "q_c" not in recorded:
            q_c = _derive_impact_pressure(derived)
            if q_c is not None:
                derived = derived.assign(q_c=("time", q_c, quantity_attributes("q_c")))
        if derived is not data:
            changed[leaf] = derived
    return changed


def _channel_names(leaves: Mapping[str, xr.Dataset]) -> set[str]:
    names: set[str] = set()
    for data in leaves.values():
        names.update(map(str, data.data_vars))
    return names


def _derive_impact_pressure(data: xr.Dataset) -> np.ndarray | None:
    """Return the impact pressure from the other air data of a leaf. [Pa]"""
    if "p_static" in data and "mach" in data:
        return impact_pressure(data["mach"].values, data["p_static"].values)
    if {"p_static", "V", "temperature"} <= set(data.data_vars):
        speed_of_sound = np.sqrt(GAMMA * R_AIR * data["temperature"].values)
        return impact_pressure(data["V"].values / speed_of_sound, data["p_static"].values)
    if "V_cas" in data:
        return impact_pressure_at(data["V_cas"].values)
    return None


class MeasuredChannels:
    """Channels of a record inside the windows, with derived air data."""

    def __init__(self, record: xr.DataTree, windows: Sequence[tuple[float, float]]):
        leaves = {name: node.to_dataset() for name, node in record.children.items()}
        self.recorded = _channel_names(leaves)
        # The impact pressure from V requires the temperature, so that it is added first.
        leaves.update(_add_temperature(leaves, record.attrs.get("temperature")))
        leaves.update(derive_air_data(leaves))
        self.windows = windows
        self.title = str(record.attrs.get("title", "flight record"))
        self.leaf: dict[str, str] = {}
        for leaf, data in leaves.items():
            self.leaf.update({str(name): leaf for name in data.data_vars})
        self.leaves = leaves
        self._spikes: dict[str, np.ndarray] = {}
        self._clean: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def __contains__(self, name: str) -> bool:
        return name in self.leaf

    def get(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return clock and values of a channel, with unwrapped angles.

        Spikes of a reading are replaced by linear interpolation.  The arrays are stored for the
        next call; a caller must not change them.
        """
        if name not in self._clean:
            self._clean[name] = self._clean_channel(name)
        return self._clean[name]

    def _clean_channel(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        leaf = self.leaf[name]
        data = self.leaves[leaf]
        x, clock = data.variables[name].values.astype(float), data.variables["time"].values
        if not np.isfinite(x).all():
            demand_numbers({leaf: self._select_windows(data[[name]])}, self.title)
            # Samples outside the windows do not count, but filters would carry their NaN inside.
            x = without_blanks(clock, x)
        # An angle that passes its full turn has a step, which interpolation would smear.
        if name in WRAPPED:
            x = np.unwrap(x)
        is_spike = self.spikes(name)
        # The reconstruction integrates the inertial unit, so that its samples are not changed.
        if name in IMU or not is_spike.any():
            return clock, x
        return clock, np.interp(clock, clock[~is_spike], x[~is_spike])

    def spikes(self, name: str) -> np.ndarray:
        """Return which samples of a channel are spikes."""
        if name not in self._spikes:
            x = self.leaves[self.leaf[name]].variables[name].values.astype(float)
            self._spikes[name] = find_spikes(x, name)
        return self._spikes[name]

    def spikes_in_words(self) -> list[str]:
        """Return a sentence for each channel with spikes inside the windows."""
        texts = []
        for name in (*IMU, *MEASURED):
            if name not in self.recorded:
                continue
            clock = self.leaves[self.leaf[name]].variables["time"].values
            is_spike = self.spikes(name) & lies_in_windows(self.windows, clock)
            if is_spike.any():
                remedy = "left out"
                if name in IMU:
                    remedy = "the path goes through them; choose windows without them"
                texts.append(
                    f"{name}: {is_spike.sum()} samples are spikes, first at "
                    f"{time_text(clock[is_spike][0])} s; {remedy}"
                )
        return texts

    def rate(self, name: str) -> float:
        """Return the samples per second of a channel."""
        return float(self.leaves[self.leaf[name]].attrs["rate"])

    def _select_windows(self, data: xr.Dataset) -> xr.Dataset:
        inside = lies_in_windows(self.windows, data["time"].values)
        return data if inside.all() else data.isel(time=inside)

    def by_leaf(self, names: Sequence[str]) -> list[list[str]]:
        """Return those of `names` that the record has, grouped by leaf."""
        groups: dict[str, list[str]] = {}
        for name in names:
            if name in self:
                groups.setdefault(self.leaf[name], []).append(name)
        return list(groups.values())


def _add_temperature(
    leaves: dict[str, xr.Dataset], temperature: float | None
) -> dict[str, xr.Dataset]:
    """Return the leaf of the airspeed with the constant outside temperature of the record [K].

    A record with a channel of the temperature does not need it.
    """
    if temperature is None or any("temperature" in data for data in leaves.values()):
        return {}
    leaf = _leaf_of_airspeed(leaves)
    if leaf is None:
        return {}
    data = leaves[leaf]
    values = np.full(data.sizes["time"], float(temperature))
    variable = ("time", values, quantity_attributes("temperature"))
    return {leaf: data.assign(temperature=variable)}


def _leaf_of_airspeed(leaves: Mapping[str, xr.Dataset]) -> str | None:
    for name in ("q_c", *SPEEDS):
        for leaf, data in leaves.items():
            if name in data:
                return leaf
    return None


def airspeed_channel(channels: MeasuredChannels, specification: Instruments) -> str:
    """Return the channel that shows the airspeed.

    A recorded impact pressure has priority over V, V_cas and mach with noise of their own.

    Raises
    ------
    SchemaError
        Several airspeeds have a noise and would count as independent readings.
    """
    if "q_c" in channels.recorded and specification.name_of("q_c"):
        return "q_c"
    speeds = [name for name in SPEEDS if name in channels.recorded and specification.name_of(name)]
    if len(speeds) > 1:
        raise SchemaError(
            "instruments",
            [
                f"noise of {' and '.join(speeds)}: one pitot tube shows all of them, one at "
                f"most can be a reading; keep the noise of one"
            ],
        )
    return speeds[0] if speeds else "q_c"


def without_blanks(clock: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return a channel (time,) with a line across its NaN samples; all NaN stay."""
    known = np.isfinite(x)
    return np.interp(clock, clock[known], x[known]) if known.any() else x


def lies_in_windows(windows: Sequence[tuple[float, float]], time: np.ndarray) -> np.ndarray:
    """Return which instants (time,) lie in a window. [s]"""
    return np.any([(time >= start) & (time <= end) for start, end in windows], axis=0)


def order_windows(
    record: xr.DataTree, windows: Sequence[tuple[float, float]] | None
) -> list[tuple[float, float]]:
    """Return the windows in order, by default the whole span of the inertial unit.

    A window is split where the clock of the inertial unit has a gap, or all its channels are NaN:
    nothing shows the motion in it, and its integral would connect both sides.

    Raises
    ------
    OutOfRange
        A window is outside the record, two windows overlap, or gaps leave nothing of a window.
    SchemaError
        Channels of the inertial unit are missing.
    """
    clock = _inertial_clock(record)
    first, last = float(clock[0]), float(clock[-1])
    if windows is None:
        ordered = [(first, last)]
    else:
        ordered = sorted((float(start), float(stop)) for start, stop in windows)
    end = -np.inf
    for start, stop in ordered:
        is_inside = start >= first - _TIME_TOLERANCE and stop <= last + _TIME_TOLERANCE
        if not is_inside or not stop > start:
            raise OutOfRange(
                f"window {time_text(start)} ... {time_text(stop)} s; the record holds "
                f"{time_text(first)} ... {time_text(last)} s; "
                f"choose a window inside it"
            )
        if start <= end:
            raise OutOfRange(f"windows overlap at {time_text(start)} s; join them")
        end = stop
    return split_at_gaps(ordered, clock_gaps(clock))


def _inertial_clock(record: xr.DataTree) -> np.ndarray:
    """Return the instants with inertial readings [s]; all channels of the unit must exist."""
    leaves = list(record.children.values())
    problems = []
    for name in (*IMU, "phi", "theta"):
        if not any(name in node.data_vars for node in leaves):
            problems.append(
                f"no channel {name}; the reconstruction needs it, name its column in the name map"
            )
    if problems:
        raise SchemaError("flight record", problems)
    node = next(node for node in leaves if "p" in node.data_vars)
    data = node.to_dataset()
    clock = filled_instants(data, inertial_channels(data))
    # without two readings the NaN samples are named later
    return clock if clock.size > 1 else data["time"].values


def inertial_channels(data: xr.Dataset) -> list[str]:
    """Return the channels of the inertial unit and of the attitude in a leaf."""
    return [name for name in (*IMU, "phi", "theta") if name in data]


@dataclass(frozen=True)
class AirData:
    """Air data of a record.

    Attributes
    ----------
    channel : str
        Channel of the airspeed, see `airspeed_channel`.
    time : array (time,)
        Clock of this channel. [s]
    temperature : array (time,)
        Smoothed temperature. [K]
    speed : array (time,)
        Rough true airspeed. [m s-1]
    p_static : array (time,)
        Static pressure. [Pa]
    delay : float
        Expected latency. [s]
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

    Without static pressure the result has the pressure of the standard atmosphere at ``h_gps``,
    which is a first value only.

    Raises
    ------
    SchemaError
        Airspeed, static pressure (or height) or temperature are neither recorded nor derived.
    """
    name = airspeed_channel(channels, specification)
    demand_air_data(channels, name)
    clock, reading = channels.get(name)
    T = np.interp(clock, *channels.get("temperature"))
    if "p_static" in channels:
        pressure_clock, p_static = channels.get("p_static")
    else:
        pressure_clock, h = channels.get("h_gps")
        p_static = atmosphere(h).p_static
    p = np.interp(clock, pressure_clock, p_static)
    rate = channels.rate(name)
    if rate > _SMOOTHED_RATE and len(clock) > _SMOOTHED_SAMPLES:
        T = lowpass(T, rate, _TEMPERATURE_CUTOFF)
        reading = lowpass(reading, rate, _SPEED_CUTOFF)
    instrument = specification.of(name)
    factor, _ = instrument.factor.get(name, (1.0, 0.0))
    delay, _ = instrument.delay or (0.0, 0.0)
    return AirData(
        name, clock, T, speed=_true_airspeed(name, reading / factor, p, T), p_static=p, delay=delay
    )


def demand_air_data(channels: MeasuredChannels, name: str) -> None:
    """Raise if airspeed (channel `name`), static pressure or height, or temperature is missing.

    Raises
    ------
    SchemaError
        With all missing channels.
    """
    problems = []
    if name not in channels:
        speeds = [speed for speed in SPEEDS if speed in channels]
        fault = "no airspeed recorded"
        if speeds:
            fault = f"{', '.join(speeds)} recorded, but no instrument gives its noise"
        problems.append(
            f"no channel q_c: {fault}; record q_c, or h_baro with mach, V or V_cas, or give "
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


def _true_airspeed(name: str, reading: np.ndarray, p: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the true airspeed of a reading of the channel `name`. [m s-1]"""
    reading = np.maximum(reading, 0.0)
    if name == "V":
        return reading
    speed_of_sound = np.sqrt(GAMMA * R_AIR * T)
    if name == "mach":
        return reading * speed_of_sound
    q_c = impact_pressure_at(reading) if name == "V_cas" else reading
    return mach_number(q_c, p) * speed_of_sound
