"""From a flight record and an instrument specification to the least-squares problem of the flight
path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import R_AIR, pressure_altitude
from flightmech.errors import OutOfRange, SchemaError
from flightmech.names import lookup
from flighttest.reconstruction.dynamics.kinematics import (
    body_to_ned_rotation,
    earth_rotation,
    gravity,
)
from flighttest.reconstruction.problem import output_equations
from flighttest.reconstruction.problem.output_equations import LAPSE
from flighttest.reconstruction.problem.problem import (
    PER_RUN,
    Constants,
    PathProblem,
    Sensor,
    bias_estimates,
)
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.records.sensors.instruments import IMU, SPEEDS, VANES, Instruments
from flighttest.records.sensors.measurements import MEASURED, MeasuredChannels, air_readings
from flighttest.records.signals.differentiation import derivative
from flighttest.records.signals.resampling import resample_to_grid

WIND_SIGMA = 25.0  # m/s, of each horizontal component
WIND_DOWN_SIGMA = (
    0.2  # m/s, mean over a run in air without thermals, where the record states no other
)
SIDESLIP = (3.0, 5.0)  # m/s and s: size and memory of the sideslip velocity where no vane shows it
# weights that keep the start of a window from drifting where nothing holds it; without a compass
# the heading counts from there
_START = {"phi": 0.2, "theta": 0.2, "psi": 3.0, "no psi": 1e-3, "v": 50.0, "h": 500.0, "vane": 0.3}
_EXACT, _LAG = (
    (1.0, 1e-6),
    (0.02, 0.01),
)  # factor and lag [s] of vanes whose specification is not informative
# Freedom of the lag equation over the noise of the vane.  It adds (factor * freedom)^2 to the
# variance of a reading, which a mode of the
# joint density takes for a reason to enlarge the factor: by N share^2 s^2 of a factor with standard
# error s from N readings.
VANE_SHARE = 0.01
_STEEPEST = np.radians(80.0)  # Euler angles
_FAST = 20.0  # m/s, for a first wind
_RADIO_MAXIMUM = 700.0  # m, when the instrument states none


@dataclass(frozen=True)
class Setup:
    """A problem with its start, and what the results need besides."""

    problem: PathProblem
    x: np.ndarray
    c: np.ndarray
    temperature: np.ndarray
    reference: tuple[float, float]
    cg: np.ndarray
    unused: tuple[str, ...]
    held: tuple[str, ...] = ()
    spikes: tuple[str, ...] = ()

    def biases(self, solution: Solution) -> xr.Dataset:
        """Return the constants of a solution, see `constants.biases`."""
        return bias_estimates(self.problem.constants, solution.c, solution.covariance, self.held)


def assemble_problem(
    record: xr.DataTree,
    aircraft: Any,
    specification: Instruments,
    windows: Sequence[tuple[float, float]],
    rate: float,
    prior: xr.Dataset | None,
) -> Setup:
    """Return the problem of a record with its start values; arguments as in `reconstruct`."""
    return _Assembly(record, aircraft, specification, windows, rate).setup(prior)


class _Assembly:
    """One record on its way to a problem: channels, clock of the path, first trajectory, constants,
    sensors.
    """

    def __init__(
        self,
        record,
        aircraft,
        specification: Instruments,
        windows: Sequence[tuple[float, float]],
        rate: float,
    ):
        self.channels = MeasuredChannels(record, windows)
        self.specification, self.windows, self.rate = specification, windows, rate
        self.latitude = float(record.attrs["latitude"]) if "latitude" in record.attrs else None
        self.runway = (
            float(record.attrs["runway_elevation"]) if "runway_elevation" in record.attrs else None
        )
        self.wind_down = float(record.attrs.get("wind_down_sigma", WIND_DOWN_SIGMA))
        self.grids = [
            a + np.arange(int(np.floor((b - a) * rate + 1e-6)) + 1) / rate for a, b in windows
        ]
        if min(map(len, self.grids)) < 10:
            raise OutOfRange(
                f"a window holds {min(map(len, self.grids))} samples at {rate:g} Hz; at "
                f"least 10 are needed"
            )
        self.time = np.concatenate(self.grids)
        self.air = air_readings(self.channels, specification)
        steepest = float(np.abs(self.on_grid("theta")).max())
        if steepest > _STEEPEST:
            raise OutOfRange(
                f"pitch attitude reaches {np.degrees(steepest):.0f} deg; Euler angles serve "
                f"up to 80 deg; choose other windows"
            )
        self.measured = tuple(
            name for name in MEASURED if name not in ("q_c", *SPEEDS) or name == self.air.channel
        )
        self.vanes = tuple(name for name in VANES if self.usable(name))
        default = dict(zip("xyz", aircraft.cg, strict=True))
        self.cg = np.array([self.mean(f"{axis}_cg_b", default[axis]) for axis in "xyz"])
        self.x = self.first_path()
        self.reference = (
            float(self.x[:, 6].mean()),
            float(self.air.temperature_at(self.time).mean()),
        )
        self.g = gravity(self.latitude, self.reference[0])

    def usable(self, *names: str) -> bool:
        """Return whether the record has all channels and an instrument gives their noise."""
        return all(name in self.channels and self.specification.name_of(name) for name in names)

    def mean(self, name: str, default: float) -> float:
        """Return the mean of a slow channel, or the aircraft's value."""
        return (
            float(np.mean(self.channels.get(name)[1])) if name in self.channels else float(default)
        )

    def on_grid(self, name: str) -> np.ndarray:
        """Return a channel on the clock of the path."""
        return np.concatenate(
            [resample_to_grid(*self.channels.get(name), grid, name) for grid in self.grids]
        )

    def arm(self, channel: str) -> np.ndarray:
        """Return the place of a sensor from the c.g."""
        return np.array(self.specification.of(channel).position) - self.cg

    def setup(self, prior: xr.Dataset | None) -> Setup:
        """Return the problem with its start."""
        constants, c = self.constants()
        if prior is not None:
            constants = constants.with_prior(prior)
            shared = [
                name in prior["parameter"] and name not in PER_RUN for name in constants.names
            ]
            c = np.where(shared, constants.mean, c)
        sensors = self.sensors(constants)
        omega = np.stack([self.on_grid(name) for name in "pqr"], axis=1)
        pieces = np.split(omega, np.cumsum([len(grid) for grid in self.grids])[:-1])
        limit = self.specification.of(self.vanes[0]).minimum_speed if self.vanes else 0.0
        heading = "psi" if self.usable("psi") else "no psi"
        start = [_START[name] for name in ("phi", "theta", heading, "v", "v", "v", "h")] + [
            _START["vane"]
        ] * len(self.vanes)
        problem = PathProblem(
            time=self.time,
            linked=np.diff(self.time) < 1.5 / self.rate,
            omega=omega,
            omega_dot=np.concatenate(
                [
                    np.stack([derivative(w, 1.0 / self.rate) for w in piece.T], axis=1)
                    for piece in pieces
                ]
            ),
            force=np.stack([self.on_grid(name) for name in ("ax_imu", "ay_imu", "az_imu")], axis=1),
            noise=np.array(
                [
                    self.specification.noise(name)
                    * np.sqrt(min(self.rate / self.channels.rate(name), 1.0))
                    for name in IMU
                ]
            ),
            arm=self.arm("ax_imu"),
            vane_arms=np.array([self.arm(name) for name in self.vanes]).reshape(-1, 3),
            g=self.g,
            g_height=self.reference[0],
            earth=earth_rotation(self.latitude),
            airborne=self.air.speed_at(self.time) > limit,
            vanes=self.vanes,
            vane_noise=VANE_SHARE
            * np.array([self.specification.noise(name) for name in self.vanes]),
            sensors=sensors,
            constants=constants,
            start_sigma=np.array(start),
            gyro_spin=self.gyro_spin(),
        )
        used = {name for sensor in sensors for name in sensor.names} | {"temperature"}
        shown = (
            set(MEASURED) - {*SPEEDS} if self.air.channel in used else set(MEASURED)
        )  # all airspeeds show the same
        unused = tuple(sorted((shown & self.channels.recorded) - used))
        temperature, spikes = (
            self.air.temperature_at(self.time),
            tuple(self.channels.spikes_in_words()),
        )
        return Setup(
            problem, self.x, c, temperature, self.reference, self.cg, unused, spikes=spikes
        )

    def gyro_spin(self) -> np.ndarray:
        """Return the rate of the Earth as far as the gyros show it, north-east-down."""
        if not self.specification.of("p").earth_rate:
            return np.zeros(3)
        if self.latitude is None:
            raise SchemaError(
                "flight record",
                [
                    "no latitude, but the gyros show the rate of the Earth (earth_rate); "
                    'give [record] latitude = "45 deg" in the name map'
                ],
            )
        return earth_rotation(self.latitude)[0]

    def first_path(self) -> np.ndarray:
        """Return a first trajectory from the readings."""
        x = np.zeros((len(self.time), 7 + len(self.vanes)))
        for i, name in enumerate(("phi", "theta", "psi")):
            if name in self.channels:
                x[:, i] = self.on_grid(name)
        if "psi" not in self.channels:
            x[:, 2] = self.turned(x)
        alpha = np.zeros(len(self.time))
        for i, name in enumerate(self.vanes):
            x[:, 7 + i] = (
                self.shifted(name) / self.specification.of(name).factor.get(name, _EXACT)[0]
            )
            alpha = x[:, 7 + i] if name == "alpha_vane" else alpha
        if self.usable("vn", "ve", "vd"):
            x[:, 3:6] = np.stack([self.shifted(name) for name in ("vn", "ve", "vd")], axis=1)
        else:
            V = self.air.speed_at(self.time)
            along = np.stack([V * np.cos(alpha), np.zeros_like(V), V * np.sin(alpha)], axis=1)
            x[:, 3:6] = (body_to_ned_rotation(x[:, :3]) @ along[..., None])[..., 0]
        x[:, 6] = (
            self.shifted("h_gps")
            if self.usable("h_gps")
            else pressure_altitude(self.air.at(self.time, self.air.p_static))
        )
        return x

    def turned(self, x: np.ndarray) -> np.ndarray:
        """Return the heading from the start of each window, integrated from the gyros."""
        rate = (self.on_grid("q") * np.sin(x[:, 0]) + self.on_grid("r") * np.cos(x[:, 0])) / np.cos(
            x[:, 1]
        )
        pieces = np.split(rate, np.cumsum([len(grid) for grid in self.grids])[:-1])
        return np.concatenate(
            [
                np.cumsum(np.append(0.0, (piece[1:] + piece[:-1]) / 2.0)) / self.rate
                for piece in pieces
            ]
        )

    def shifted(self, name: str) -> np.ndarray:
        """Return a channel on the clock of the path, its expected latency removed."""
        clock, z = self.channels.get(name)
        return np.interp(self.time, clock - (self.specification.of(name).delay or (0.0, 0.0))[0], z)

    def constants(self) -> tuple[Constants, np.ndarray]:
        """Return the constants with their prior, and start values."""
        rows: dict[str, tuple[str, float, float]] = {}  # unit, prior mean, sigma
        start: dict[str, float] = {}
        known = [name for name in (*IMU, *self.measured) if name != "h_radio" and self.usable(name)]
        if self.low_radio() is not None:
            known.append("h_radio")
        for name in known:
            if name in self.specification.of(name).bias_sigma:
                rows[f"bias.{name}"] = (
                    lookup(name).units,
                    0.0,
                    self.specification.of(name).bias_sigma[name],
                )
        for name in (name for name in IMU if name in self.specification.of(name).scale_sigma):
            rows[f"scale.{name}"] = ("1", 0.0, self.specification.of(name).scale_sigma[name])
        for name in self.vanes:
            rows[f"factor.{name}"] = ("1", *self.specification.of(name).factor.get(name, _EXACT))
        if self.vanes:
            rows["lag.vanes"] = ("s", *(self.specification.of(self.vanes[0]).lag or _LAG))
        factor = self.specification.of(self.air.channel).factor.get(self.air.channel)
        if factor and self.usable(self.air.channel):
            rows[f"factor.{self.air.channel}"] = ("1", *factor)
        static_error = self.specification.of("q_c").static_error
        if static_error:
            rows["static_error"] = ("1", *static_error)
        for name in known:
            delay = self.specification.of(name).delay
            if delay:
                rows[self.specification.delay_of(name)] = ("s", *delay)
        if self.usable("vn", "ve"):
            rows["wind_n"] = rows["wind_e"] = ("m s-1", 0.0, WIND_SIGMA)
            start["wind_n"], start["wind_e"] = self.first_wind()
        rows["wind_d"] = ("m s-1", 0.0, self.wind_down)
        p = self.air.at(self.time, self.air.p_static)
        left = 1.0 - LAPSE * (self.x[:, 6] - self.reference[0]) / self.reference[1]
        level = float(np.mean(p / left ** (self.g / (R_AIR * LAPSE))))
        # without another height sensor the height is the one the pressure gives
        rows["p_reference"] = ("Pa", level, 1000.0 if self.usable("h_gps") else 0.1)
        units, mean, sigma = zip(*rows.values(), strict=True)
        c = np.array([start.get(name, m) for name, m in zip(rows, mean, strict=True)])
        return Constants(tuple(rows), units, np.array(mean), np.diag(np.square(sigma))), c

    def first_wind(self) -> tuple[float, float]:
        """Return ground velocity minus airspeed along the nose, averaged; zero without a heading or
        in slow flight only.
        """
        V = self.air.speed_at(self.time)
        fast = V > _FAST
        if "psi" not in self.channels or not fast.any():
            return 0.0, 0.0
        psi = self.x[:, 2]
        return float((self.x[:, 3] - V * np.cos(psi))[fast].mean()), float(
            (self.x[:, 4] - V * np.sin(psi))[fast].mean()
        )

    def sensors(self, constants: Constants) -> list[Sensor]:
        """Return the readings, grouped by clock."""
        place = {"phi": 0, "theta": 1, "psi": 2, "vn": 3, "ve": 4, "vd": 5, "h_gps": 6}
        air, found = self.air, []
        for names in self.groups(*place):
            found.append(
                self.sensor(
                    constants,
                    names,
                    output_equations.show_states,
                    {"places": np.array([place[n] for n in names])},
                )
            )
        for names in self.groups(*self.vanes):
            found.append(
                self.sensor(
                    constants,
                    names,
                    output_equations.show_vanes,
                    {},
                    air.speed_at(self.channels.get(names[0])[0]),
                )
            )
        for names in self.groups(air.channel, "p_static"):
            clock = self.channels.get(names[0])[0]
            extra = {
                "temperature": np.interp(clock, air.time, air.temperature),
                "reference": self.reference,
            }
            if self.specification.of(air.channel).position is not None:
                extra["arm"] = self.arm(air.channel)
            found.append(
                self.sensor(
                    constants,
                    names,
                    output_equations.air_data,
                    extra,
                    np.interp(clock, air.time, air.speed),
                )
            )
        if "beta_vane" not in self.vanes:
            found.append(self.sideslip())
        low = self.low_radio()
        if low is not None:
            extra = {"arm": self.arm("h_radio"), "elevation": self.runway, "keep": low}
            found.append(
                self.sensor(constants, ["h_radio"], output_equations.show_radio_height, extra)
            )
        return [sensor for sensor in found if len(sensor.time)]

    def groups(self, *names: str) -> list[list[str]]:
        """Return the usable channels among `names` that share a clock, a latency and a least speed.

        An instrument that states neither follows the first one of its table, whose stamps it
        carries.
        """
        found: list[list[str]] = []
        for group in self.channels.by_leaf([name for name in names if self.usable(name)]):
            by_instrument: dict[str | None, list[str]] = {}
            first = self.specification.name_of(group[0])
            for name in group:
                item = self.specification.of(name)
                own = item.delay is not None or item.minimum_speed > 0.0
                by_instrument.setdefault(
                    self.specification.name_of(name) if own else first, []
                ).append(name)
            found += by_instrument.values()
        return found

    def sensor(
        self, constants: Constants, names, model, extra: dict, speed: np.ndarray | None = None
    ) -> Sensor:
        """Return the readings that stay inside their window for every latency the prior allows,
        fast enough where `speed` is given.
        """
        item, delay = self.specification.of(names[0]), self.specification.delay_of(names[0])
        clock = self.channels.get(names[0])[0]
        z = np.stack([self.channels.get(name)[1] for name in names], axis=1)
        mean, sigma = item.delay or (0.0, 0.0)
        early, late = mean - 4.0 * sigma, mean + 4.0 * sigma
        inside = np.any(
            [(clock - late >= a - 1e-9) & (clock - early <= b + 1e-9) for a, b in self.windows],
            axis=0,
        )
        if speed is not None:
            inside &= speed > item.minimum_speed
        inside &= extra.pop("keep", True)
        inside &= ~np.any([self.channels.spikes(name) for name in names], axis=0)
        extra = {key: item[inside] if key == "temperature" else item for key, item in extra.items()}
        noise = np.array([self.specification.noise(name) for name in names])
        return Sensor(tuple(names), clock[inside], z[inside], noise, model, delay, extra)

    def low_radio(self) -> np.ndarray | None:
        """Return which radio altitudes are low enough to use; None when there is none, or no runway
        is known.
        """
        if not self.usable("h_radio") or self.runway is None:
            return None
        clock, z = self.channels.get("h_radio")
        low = z < (self.specification.of("h_radio").maximum or _RADIO_MAXIMUM)
        return (
            low
            if (low & np.any([(clock >= a) & (clock <= b) for a, b in self.windows], axis=0)).any()
            else None
        )

    def sideslip(self) -> Sensor:
        """Return the weak knowledge that an aeroplane does not fly sideways for long, one reading
        per memory time.
        """
        size, memory = SIDESLIP
        clock = np.concatenate([np.arange(a, b, memory) for a, b in self.windows])
        return Sensor(
            ("v",), clock, np.zeros((len(clock), 1)), np.array([size]), output_equations.no_sideslip
        )
