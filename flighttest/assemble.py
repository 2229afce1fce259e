"""From a flight record and an instrument specification to the least-squares problem of the flight path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError
from flightmech.names import lookup

from . import observation
from .air_data import derived, pressure_altitude
from .conditioning import SLOW, demand_numbers, lowpass, to_grid
from .constants import Constants
from .differentiate import derivative
from .instruments import IMU, Instruments
from .kinematics import earth, gravity, rotation
from .observation import R_AIR, Sensor
from .trajectory import Problem

WIND_SIGMA = 25.0  # m/s, of each horizontal component
WIND_DOWN_SIGMA = 0.2  # m/s, mean over a run in air without thermals
SIDESLIP = (3.0, 5.0)  # m/s and s: size and memory of the sideslip velocity where no vane shows it
_START = {"phi": 0.2, "theta": 0.2, "psi": 3.0, "v": 50.0, "h": 500.0, "vane": 0.3}
_RADIO_MAXIMUM = 700.0  # m, when the instrument states none


@dataclass(frozen=True)
class Setup:
    """A problem with its start, and what the results need besides."""

    problem: Problem
    x: np.ndarray
    c: np.ndarray
    temperature: np.ndarray
    reference: tuple[float, float]
    cg: np.ndarray
    unused: tuple[str, ...]


class _Channels:
    """Channels of a record inside the windows, with derived air data."""

    def __init__(self, record: xr.DataTree, windows: Sequence[tuple[float, float]]):
        leaves = {name: node.to_dataset() for name, node in record.children.items()}
        leaves.update(derived(leaves))
        self.windows = windows
        self.leaf: dict[str, str] = {str(n): leaf for leaf, data in leaves.items() for n in data.data_vars}
        self.leaves = leaves

    def __contains__(self, name: str) -> bool:
        return name in self.leaf

    def get(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return clock and values of a channel; heading unwrapped."""
        data = self.leaves[self.leaf[name]]
        x = data[name].values.astype(float)
        demand_numbers({self.leaf[name]: self._near(data[[name]])}, "a channel of the reconstruction")
        return data["time"].values, np.unwrap(x) if name == "psi" else x

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
    node = next(node for node in record.children.values() if "p" in node.data_vars)
    first, last = float(node["time"][0]), float(node["time"][-1])
    chosen = sorted((float(a), float(b)) for a, b in windows) if windows is not None else [(first, last)]
    end = -np.inf
    for a, b in chosen:
        if a < first - 1e-9 or b > last + 1e-9 or not b > a:
            raise OutOfRange(f"window {a:g} ... {b:g} s; the record holds {first:g} ... {last:g} s; choose a window inside it")
        if a <= end:
            raise OutOfRange(f"windows overlap at {a:g} s; join them")
        end = b
    return chosen


def assemble(
    record: xr.DataTree,
    aircraft: Any,
    specification: Instruments,
    windows: Sequence[tuple[float, float]],
    rate: float,
    prior: xr.Dataset | None,
) -> Setup:
    """Return the problem of a record with its start values; arguments as in `reconstruct`."""
    channels = _Channels(record, windows)
    grids = [a + np.arange(int(np.floor((b - a) * rate + 1e-6)) + 1) / rate for a, b in windows]
    if min(map(len, grids)) < 10:
        raise OutOfRange(f"a window holds {min(map(len, grids))} samples at {rate:g} Hz; at least 10 are needed")
    time = np.concatenate(grids)
    on_grid = {name: np.concatenate([to_grid(*channels.get(name), grid, name) for grid in grids]) for name in (*IMU, "phi", "theta")}
    omega = np.stack([on_grid[n] for n in "pqr"], axis=1)
    pieces = np.split(omega, np.cumsum([len(g) for g in grids])[:-1])
    omega_dot = np.concatenate([np.stack([derivative(w, 1.0 / rate) for w in piece.T], axis=1) for piece in pieces])
    cg = np.array([_mean(channels, f"{axis}_cg_b", aircraft.cg[i]) for i, axis in enumerate("xyz")])
    air = _air(channels, specification, time)
    latitude = record.attrs.get("latitude")
    vanes = tuple(name for name in ("alpha_vane", "beta_vane") if name in channels and specification.of(name))
    x, reference = _start(channels, specification, time, grids, on_grid, air, vanes)
    g = gravity(None if latitude is None else float(latitude), reference[0])
    constants, c = _constants(channels, specification, x, air, reference, g, vanes)
    if prior is not None:
        constants = constants.with_prior(prior)
        c = np.where(
            [n in prior["parameter"] and n not in ("wind_n", "wind_e", "wind_d", "p_reference") for n in constants.names], constants.mean, c
        )
    sensors = _sensors(channels, specification, constants, record, cg, air, reference, vanes)
    noise = np.array([specification.noise(name) * np.sqrt(min(rate / _rate(channels, name), 1.0)) for name in IMU])
    speed_limit = specification.of(vanes[0])[1].minimum_speed if vanes else 0.0
    sigma = [_START["phi"], _START["theta"], _START["psi"], *3 * [_START["v"]], _START["h"], *len(vanes) * [_START["vane"]]]
    problem = Problem(
        time=time,
        linked=np.diff(time) < 1.5 / rate,
        omega=omega,
        omega_dot=omega_dot,
        force=np.stack([on_grid[n] for n in ("ax_imu", "ay_imu", "az_imu")], axis=1),
        noise=noise,
        arm=_arm(specification, "ax_imu", cg),
        vane_arm=_arm(specification, vanes[0], cg) if vanes else np.zeros(3),
        g=g,
        earth=earth(None if latitude is None else float(latitude)),
        airborne=air.speed_at(time) > speed_limit,
        vanes=vanes,
        sensors=sensors,
        constants=constants,
        start_sigma=np.array(sigma),
    )
    used = {name for sensor in sensors for name in sensor.names} | set(IMU) | {"temperature"}
    instrument = set(observation_channels()) & set(channels.leaf)
    return Setup(problem, x, c, air.temperature_at(time), reference, cg, tuple(sorted(instrument - used)))


def observation_channels() -> tuple[str, ...]:
    """Return the channels that the reconstruction can use as measurements."""
    return ("phi", "theta", "psi", "vn", "ve", "vd", "h_gps", "q_c", "p_static", "temperature", "alpha_vane", "beta_vane", "h_radio")


@dataclass(frozen=True)
class _Air:
    """Air data as recorded: clock, smoothed temperature, rough true airspeed; `delay` is the expected latency."""

    time: np.ndarray
    temperature: np.ndarray
    speed: np.ndarray
    q_c: np.ndarray
    p_static: np.ndarray
    delay: float

    def temperature_at(self, time: np.ndarray) -> np.ndarray:
        """Return the measured temperature at true times."""
        return np.interp(time + self.delay, self.time, self.temperature)

    def speed_at(self, time: np.ndarray) -> np.ndarray:
        """Return the rough airspeed at true times."""
        return np.interp(time + self.delay, self.time, self.speed)


def _air(channels: _Channels, specification: Instruments, time: np.ndarray) -> _Air:
    missing = [name for name in ("q_c", "p_static", "temperature") if name not in channels]
    if missing:
        allowed = "give q_c, p_static, temperature, or h_baro with mach or V or V_cas, and temperature"
        raise SchemaError("flight record", [f"no channel {name}; {allowed}" for name in missing])
    clock, q_c = channels.get("q_c")
    p, T = (np.interp(clock, *channels.get(name)) for name in ("p_static", "temperature"))
    rate = 1.0 / float(np.median(np.diff(clock)))
    if rate > 2.5 and len(clock) > 30:
        T, q_s = lowpass(T, rate, 0.5), lowpass(q_c, rate, 1.0)
    else:
        q_s = q_c
    found = specification.of("q_c")
    delay = found[1].delay[0] if found and found[1].delay else 0.0
    mach2 = 5.0 * ((np.maximum(q_s, 0.0) / p + 1.0) ** (2.0 / 7.0) - 1.0)
    return _Air(clock, T, np.sqrt(mach2 * observation.GAMMA * R_AIR * T), q_c, p, delay)


def _start(
    channels: _Channels, specification: Instruments, time, grids, on_grid, air: _Air, vanes
) -> tuple[np.ndarray, tuple[float, float]]:
    """Return a first trajectory from the readings, and the reference height with the temperature there."""
    x = np.zeros((len(time), 7 + len(vanes)))
    x[:, 0], x[:, 1] = on_grid["phi"], on_grid["theta"]
    if "psi" in channels:
        x[:, 2] = np.concatenate([to_grid(*channels.get("psi"), grid, "psi") for grid in grids])
    alpha = np.zeros(len(time))
    for i, name in enumerate(vanes):
        _, item = specification.of(name) or ("", None)
        clock, z = channels.get(name)
        x[:, 7 + i] = np.interp(time, clock, z) / (item.factor[name][0] if item and name in item.factor else 1.0)
        alpha = x[:, 7 + i] if name == "alpha_vane" else alpha
    if all(name in channels for name in ("vn", "ve", "vd")):
        delay = _delay(specification, "vn")[0]
        for i, name in enumerate(("vn", "ve", "vd")):
            clock, z = channels.get(name)
            x[:, 3 + i] = np.interp(time, clock - delay, z)
    else:
        V = air.speed_at(time)
        along = np.stack([V * np.cos(alpha), np.zeros_like(V), V * np.sin(alpha)], axis=1)
        x[:, 3:6] = (rotation(x[:, :3]) @ along[..., None])[..., 0]
    if "h_gps" in channels:
        clock, z = channels.get("h_gps")
        x[:, 6] = np.interp(time, clock - _delay(specification, "h_gps")[0], z)
    else:
        x[:, 6] = np.interp(time + air.delay, air.time, pressure_altitude(air.p_static))
    return x, (float(x[:, 6].mean()), float(air.temperature_at(time).mean()))


def _constants(channels: _Channels, specification: Instruments, x, air: _Air, reference, g: float, vanes) -> tuple[Constants, np.ndarray]:
    rows: list[tuple[str, str, float, float, float | None]] = []  # name, unit, prior mean, sigma, start when not the mean

    def add(name: str, units: str, mean: float, sigma: float, start: float | None = None) -> None:
        rows.append((name, units, mean, sigma, start))

    for name in (*IMU, "phi", "theta", "psi", "alpha_vane", "beta_vane", "q_c", "temperature", "h_radio"):
        found = specification.of(name)
        if found and name in channels and name in found[1].bias_sigma:
            add(f"bias.{name}", lookup(name).units, 0.0, found[1].bias_sigma[name])
    for name in vanes:
        _, item = specification.of(name)  # type: ignore[misc]
        add(f"factor.{name}", "1", *item.factor.get(name, (1.0, 1e-6)))
    if vanes:
        item = specification.of(vanes[0])[1]  # type: ignore[index]
        add("lag.vanes", "s", *(item.lag or (0.02, 0.01)))
    q_c = specification.of("q_c")
    if q_c and q_c[1].static_error:
        add("static_error", "1", *q_c[1].static_error)
    for channel in ("q_c", "vn", "alpha_vane"):
        mean, sigma = _delay(specification, channel)
        name = _delay_name(specification, channel)
        if name and channel in channels and name not in {row[0] for row in rows}:
            add(name, "s", mean, sigma)
    ground = all(name in channels and specification.of(name) for name in ("vn", "ve"))
    if ground:
        start = _first_wind(x, air, channels)
        add("wind_n", "m s-1", 0.0, WIND_SIGMA, start[0])
        add("wind_e", "m s-1", 0.0, WIND_SIGMA, start[1])
    add("wind_d", "m s-1", 0.0, WIND_DOWN_SIGMA)
    level = _first_pressure(channels, x, air, reference, g)
    # without another height sensor the height is the one the pressure gives
    add("p_reference", "Pa", level, 1000.0 if "h_gps" in channels and specification.of("h_gps") else 0.1, level)
    names, units, mean, sigma, starts = zip(*rows, strict=True)
    c = np.array([m if s is None else s for m, s in zip(mean, starts, strict=True)])
    return Constants(names, units, np.array(mean), np.diag(np.square(sigma))), c


def _first_wind(x: np.ndarray, air: _Air, channels: _Channels) -> np.ndarray:
    """Return ground velocity minus airspeed along the nose, averaged; zero without a heading."""
    if "psi" not in channels:
        return np.zeros(2)
    clock = air.time - air.delay
    inside = np.any([(clock >= a) & (clock <= b) for a, b in channels.windows], axis=0) & (air.speed > 20.0)
    if not inside.any():
        return np.zeros(2)
    grid = np.concatenate([np.linspace(a, b, max(int((b - a) * 5), 2)) for a, b in channels.windows])
    psi = np.interp(grid, *channels.get("psi"))
    V = air.speed_at(grid)
    keep = V > 20.0
    vn, ve = (np.interp(grid, *channels.get(name)) for name in ("vn", "ve"))
    return np.array([(vn - V * np.cos(psi))[keep].mean(), (ve - V * np.sin(psi))[keep].mean()]) if keep.any() else np.zeros(2)


def _first_pressure(channels: _Channels, x: np.ndarray, air: _Air, reference, g: float) -> float:
    """Return the pressure at the reference height that fits the readings on average."""
    grid = np.concatenate([np.linspace(a, b, 50) for a, b in channels.windows])
    p = np.interp(grid + air.delay, air.time, air.p_static)
    if "h_gps" in channels:
        h = np.interp(grid, *channels.get("h_gps"))
        return float(np.mean(p / (1.0 - observation.LAPSE * (h - reference[0]) / reference[1]) ** (g / (R_AIR * observation.LAPSE))))
    h = pressure_altitude(p)
    return float(np.mean(p / (1.0 - observation.LAPSE * (h - reference[0]) / reference[1]) ** (g / (R_AIR * observation.LAPSE))))


def _sensors(
    channels: _Channels, specification: Instruments, constants: Constants, record, cg, air: _Air, reference, vanes
) -> list[Sensor]:
    known = [name for name in observation_channels() if name in channels and specification.of(name)]
    place = {"phi": 0, "theta": 1, "psi": 2, "vn": 3, "ve": 4, "vd": 5, "h_gps": 6}
    sensors = []
    for names in channels.by_leaf([n for n in known if n in place]):
        sensors.append(
            _sensor(channels, specification, constants, names, observation.pick, {"places": np.array([place[n] for n in names])})
        )
    if vanes:
        limit = specification.of(vanes[0])[1].minimum_speed  # type: ignore[index]
        for names in channels.by_leaf(vanes):
            clock = channels.get(names[0])[0]
            sensors.append(_sensor(channels, specification, constants, names, observation.vanes, {}, air.speed_at(clock) > limit))
    if "beta_vane" not in vanes:
        sensors.append(_sideslip(channels))
    for names in channels.by_leaf([n for n in ("q_c", "p_static") if n in known]):
        found = specification.of(names[0])
        clock = channels.get(names[0])[0]
        keep = np.interp(clock, air.time, air.speed) > (found[1].minimum_speed if found else 0.0)
        extra = {"temperature": np.interp(clock, air.time, air.temperature), "reference": reference}
        sensors.append(_sensor(channels, specification, constants, names, observation.pressures, extra, keep))
    if "h_radio" in known and "runway_elevation" in record.attrs:
        clock, z = channels.get("h_radio")
        limit = specification.of("h_radio")[1].maximum or _RADIO_MAXIMUM  # type: ignore[index]
        extra = {"arm": _arm(specification, "h_radio", cg), "elevation": float(record.attrs["runway_elevation"])}
        sensors.append(_sensor(channels, specification, constants, ["h_radio"], observation.radio, extra, z < limit))
    return [sensor for sensor in sensors if len(sensor.time)]


def _sensor(channels: _Channels, specification: Instruments, constants: Constants, names, model, extra, keep=None) -> Sensor:
    """Return the readings that stay inside their window for every delay the prior allows."""
    clock = channels.get(names[0])[0]
    z = np.stack([channels.get(name)[1] for name in names], axis=1)
    delay = _delay_name(specification, names[0])
    mean, sigma = _delay(specification, names[0]) if delay in constants else (0.0, 0.0)
    if delay in constants:
        at = int(constants.index(delay)[0])
        mean, sigma = float(constants.mean[at]), max(sigma, float(np.sqrt(constants.covariance[at, at])))
    early, late = mean - 4.0 * sigma, mean + 4.0 * sigma
    inside = np.any([(clock - late >= a - 1e-9) & (clock - early <= b + 1e-9) for a, b in channels.windows], axis=0)
    if keep is not None:
        inside &= keep
    extra = {key: item[inside] if isinstance(item, np.ndarray) and len(item) == len(clock) else item for key, item in extra.items()}
    sigma_z = np.array([specification.noise(name) for name in names])
    return Sensor(tuple(names), clock[inside], z[inside], sigma_z, model, delay if delay in constants else "", extra)


def _sideslip(channels: _Channels) -> Sensor:
    """Return the weak knowledge that an aeroplane does not fly sideways for long, one reading per memory time."""
    size, memory = SIDESLIP
    clock = np.concatenate([np.arange(a, b, memory) for a, b in channels.windows])
    return Sensor(("v",), clock, np.zeros((len(clock), 1)), np.array([size]), observation.no_sideslip)


def _delay(specification: Instruments, channel: str) -> tuple[float, float]:
    found = specification.of(channel)
    return found[1].delay if found and found[1].delay else (0.0, 0.0)


def _delay_name(specification: Instruments, channel: str) -> str:
    found = specification.of(channel)
    return f"delay.{found[0]}" if found and found[1].delay else ""


def _arm(specification: Instruments, channel: str, cg: np.ndarray) -> np.ndarray:
    found = specification.of(channel)
    assert found is not None and found[1].position is not None  # `instruments` has seen to it
    return np.array(found[1].position) - cg


def _mean(channels: _Channels, name: str, default: float) -> float:
    assert name in SLOW
    return float(np.mean(channels.get(name)[1])) if name in channels else float(default)


def _rate(channels: _Channels, name: str) -> float:
    return 1.0 / float(np.median(np.diff(channels.get(name)[0])))
