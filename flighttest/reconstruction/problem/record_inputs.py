"""Inputs of a reconstruction from one record: channels on the clock of the path, first path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import pressure_altitude
from flightmech.aircraft.aircraft import tanks_of, with_contents
from flightmech.errors import OutOfRange
from flighttest.reconstruction.dynamics.kinematics import body_to_ned_rotation
from flighttest.records.readers.name_map import latitude_problem
from flighttest.records.sensors.instruments import SPEEDS, VANES, Instruments
from flighttest.records.sensors.measurements import MEASURED, MeasuredChannels, air_readings
from flighttest.records.signals.resampling import resample_to_grid

# m/s: standard deviation of the mean vertical wind of a run in air without thermals, the default
WIND_DOWN_SIGMA = 0.2
# Factor of vanes whose specification does not state one: value and standard deviation.
EXACT_FACTOR = (1.0, 1e-6)
_LEAST_SAMPLES = 10  # per window
_STEEPEST = np.radians(80.0)  # pitch attitude up to which Euler angles serve
_CLOCK_ROUNDING = 1e-6  # of a sample, at the end of a window


class RecordInputs:
    """Channels of one record, its windows and the clock of the path.

    Parameters
    ----------
    record : DataTree
        Flight record.
    aircraft : Aircraft
        For the c.g., where the record has none.
    specification : Instruments
    windows : sequence of (start, stop)
        [s]
    rate : float
        Samples per second of the path. [Hz]

    Attributes
    ----------
    time : array (N,)
        Clock of the path, all windows. [s]
    grids : list of array
        Clock of the path in each window. [s]
    air : AirReadings
        Airspeed, pressures and temperature.
    measured : tuple of str
        Channels that a sensor may measure, with one airspeed only.
    vanes : tuple of str
        Vanes that can be used.
    cg : array (3,)
        Mean centre of gravity. [m]

    Raises
    ------
    OutOfRange
        A window has fewer than ten samples, the pitch attitude exceeds 80 degrees, or the latitude
        is beyond a pole.
    """

    def __init__(
        self,
        record: xr.DataTree,
        aircraft: Any,
        specification: Instruments,
        windows: Sequence[tuple[float, float]],
        rate: float,
    ):
        self.channels = MeasuredChannels(record, windows)
        self.specification, self.windows, self.rate = specification, windows, rate
        self.latitude = _number_or_none(record, "latitude")
        problem = "" if self.latitude is None else latitude_problem(self.latitude)
        if problem:
            raise OutOfRange(f"attribute of the record: {problem}")
        self.runway = _number_or_none(record, "runway_elevation")
        self.wind_down = float(record.attrs.get("wind_down_sigma", WIND_DOWN_SIGMA))
        self.grids = [_window_clock(start, stop, rate) for start, stop in windows]
        shortest = min(map(len, self.grids))
        if shortest < _LEAST_SAMPLES:
            raise OutOfRange(
                f"a window holds {shortest} samples at {rate:g} Hz; at least {_LEAST_SAMPLES} "
                f"are needed"
            )
        self.time = np.concatenate(self.grids)
        self.air = air_readings(self.channels, specification)
        steepest = float(np.abs(self.resample("theta")).max())
        if steepest > _STEEPEST:
            raise OutOfRange(
                f"pitch attitude reaches {np.degrees(steepest):.0f} deg; Euler angles serve "
                f"up to 80 deg; choose other windows"
            )
        # Airspeeds repeat each other, so one of them takes part.
        repeated = {"q_c", *SPEEDS} - {self.air.channel}
        self.measured = tuple(name for name in MEASURED if name not in repeated)
        self.vanes = tuple(name for name in VANES if self.can_use(name))
        default = dict(zip("xyz", self._expected_cg(aircraft), strict=True))
        self.cg = np.array([self.mean(f"{axis}_cg_b", default[axis]) for axis in "xyz"])

    def can_use(self, *names: str) -> bool:
        """Return whether the record has all channels and an instrument gives their noise."""
        return all(name in self.channels and self.specification.name_of(name) for name in names)

    def mean(self, name: str, default: float) -> float:
        """Return the mean of a slow channel, or the default if the record does not have it."""
        if name not in self.channels:
            return float(default)
        _, values = self.channels.get(name)
        return float(np.mean(values))

    def _expected_cg(self, aircraft: Any) -> Sequence[float]:
        """Return the c.g. of the aircraft with the mean of the recorded contents of its tanks (3,).
        [m]
        """
        contents = {}
        for tank in tanks_of(aircraft):
            mean = self.mean(f"tank.{tank.name}.fuel", tank.content)
            # a gauge may show a little more than full
            contents[tank.name] = min(max(mean, 0.0), tank.capacity)
        return with_contents(aircraft, contents).cg if contents else aircraft.cg

    def resample(self, name: str) -> np.ndarray:
        """Return a channel on the clock of the path (N,)."""
        clock, values = self.channels.get(name)
        pieces = [resample_to_grid(clock, values, grid, name) for grid in self.grids]
        return np.concatenate(pieces)

    def resample_undelayed(self, name: str) -> np.ndarray:
        """Return a channel on the clock of the path (N,), without its expected latency."""
        clock, values = self.channels.get(name)
        latency, _ = self.specification.of(name).delay or (0.0, 0.0)
        return np.interp(self.time, clock - latency, values)

    def split_windows(self, values: np.ndarray) -> list[np.ndarray]:
        """Return the samples of each window of values (N, ...)."""
        ends = np.cumsum([len(grid) for grid in self.grids])
        return np.split(values, ends[:-1])

    def arm(self, channel: str) -> np.ndarray:
        """Return the position of a sensor relative to the c.g. (3,). [m]"""
        return np.array(self.specification.of(channel).position) - self.cg


TRACK = ("vn", "ve")
"""Channels that show the track over the ground."""


def first_path(inputs: RecordInputs) -> np.ndarray:
    """Return a first trajectory (N, 7 + vanes) from the readings."""
    x = np.zeros((len(inputs.time), 7 + len(inputs.vanes)))
    # Columns: attitude, velocity, height, then the angles of the vanes.
    for i, name in enumerate(("phi", "theta", "psi")):
        if name in inputs.channels:
            x[:, i] = inputs.resample(name)
    if "psi" not in inputs.channels:
        x[:, 2] = _integrated_heading(inputs, x)
        if inputs.can_use(*TRACK):
            x[:, 2] = _turn_to_track(inputs, x[:, 2])
    alpha = np.zeros(len(inputs.time))
    for i, name in enumerate(inputs.vanes):
        factor, _ = inputs.specification.of(name).factor.get(name, EXACT_FACTOR)
        x[:, 7 + i] = inputs.resample_undelayed(name) / factor
        if name == "alpha_vane":
            alpha = x[:, 7 + i]
    x[:, 3:6] = _first_velocity(inputs, x, alpha)
    # Height of the satellite receiver, else pressure altitude.
    if inputs.can_use("h_gps"):
        x[:, 6] = inputs.resample_undelayed("h_gps")
    else:
        x[:, 6] = pressure_altitude(inputs.air.at(inputs.time, inputs.air.p_static))
    return x


def _first_velocity(inputs: RecordInputs, x: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return the ground velocity (N, 3), or the air-relative one without wind and sideslip."""
    ground = ("vn", "ve", "vd")
    if inputs.can_use(*ground):
        return np.stack([inputs.resample_undelayed(name) for name in ground], axis=1)
    V = inputs.air.speed_at(inputs.time)
    body = np.stack([V * np.cos(alpha), np.zeros_like(V), V * np.sin(alpha)], axis=1)
    return (body_to_ned_rotation(x[:, :3]) @ body[..., None])[..., 0]


def _integrated_heading(inputs: RecordInputs, x: np.ndarray) -> np.ndarray:
    """Return the heading from the start of each window, integrated from the gyros."""
    # psi_dot = (q sin phi + r cos phi)/cos theta, by the trapezoidal rule
    phi, theta = x[:, 0], x[:, 1]
    q, r = inputs.resample("q"), inputs.resample("r")
    rate = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    headings = []
    for piece in inputs.split_windows(rate):
        steps = np.append(0.0, (piece[1:] + piece[:-1]) / 2.0)
        headings.append(np.cumsum(steps) / inputs.rate)
    return np.concatenate(headings)


def _turn_to_track(inputs: RecordInputs, psi: np.ndarray) -> np.ndarray:
    """Return the heading of each window turned so that it is the track on average.

    The ground velocities fix the heading; a heading from zero would contradict them.
    """
    north, east = (inputs.resample_undelayed(name) for name in TRACK)
    turned = []
    pieces = (inputs.split_windows(signal) for signal in (psi, north, east))
    for heading, along, across in zip(*pieces, strict=True):
        # The mean of the difference, on the circle, weighted by the speed.
        difference = np.mean((along + 1j * across) * np.exp(-1j * heading))
        turned.append(heading + np.angle(difference))
    return np.concatenate(turned)


def _number_or_none(record: xr.DataTree, attribute: str) -> float | None:
    if attribute not in record.attrs:
        return None
    return float(record.attrs[attribute])


def _window_clock(start: float, stop: float, rate: float) -> np.ndarray:
    """Return the uniform clock of a window (n,). [s]"""
    steps = int(np.floor((stop - start) * rate + _CLOCK_ROUNDING))
    return start + np.arange(steps + 1) / rate
