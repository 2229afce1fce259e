"""What a reconstruction is made of: readings, inputs and constants, everything but the unknown path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...dynamics.kinematics import EARTH_RADIUS
from ...sensors.instruments import IMU
from ...sensors.position_corrections import force_at_cg
from .constants import Constants

Model = Callable[["Sensor", "Problem", np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, tuple[str, ...], np.ndarray]]
ATTITUDE, VELOCITY, HEIGHT = slice(0, 3), slice(3, 6), 6  # places in the state; lagged vane angles and gusts follow


@dataclass(frozen=True)
class Sensor:
    """Readings of channels with a common clock and latency.

    Attributes
    ----------
    names : tuple of str
        Channels.
    time : array (M,)
        [s]
    z : array (M, m)
        Readings.
    sigma : array (m,)
        One sigma of their white noise.
    delay : str
        Name of the constant that holds the latency, or "".
    extra : dict
        What the model needs besides: arrays (M,) or numbers.
    """

    names: tuple[str, ...]
    time: np.ndarray
    z: np.ndarray
    sigma: np.ndarray
    model: Model
    delay: str = ""
    extra: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Problem:
    """Everything but the unknowns.

    Attributes
    ----------
    time : array (N,)
        Uniform within a segment. [s]
    linked : array (N-1,) of bool
        False where one window ends and the next begins.
    omega, omega_dot, force : array (N, 3)
        Inertial unit as recorded (not yet moved to the c.g.). [rad s-1], [rad s-2], [m s-2]
    noise : array (6,)
        One sigma of omega and force per sample of the grid.
    arm : array (3,)
        Inertial unit from the c.g. [m]
    vane_arms : array (vanes, 3)
        Vanes from the c.g. [m]
    g : float
        Gravity at the height `g_height`. [m s-2]
    earth : (array (3,), array (3, 3))
        Rate of the Earth and transport matrix, see `kinematics.earth`.
    gyro_spin : array (3,)
        Rate of the Earth as far as the gyros show it, north-east-down. [rad s-1]
    airborne : array (N,) of bool
        Fast enough for vanes.
    vanes : tuple of str
        Lagged angles in the state, of ``alpha_vane``, ``beta_vane``.
    vane_noise : array (vanes,)
        One sigma by which the lag equation may be off per step, far below the noise of the vane. [rad]
    gust : array (3,) or None
        One sigma of the gust components north, east, down [m s-1]; or, when `shown`, of what they add to ``alpha_vane``,
        ``beta_vane`` and ``q_c``. [rad], [rad], [Pa]
    gust_time : float
        Correlation time of the gusts. [s]
    g_height : float
        [m]
    shown : bool
        Which of the two.  Constants are estimated with the second: a mode over gusts and vane factor together would
        take too large a factor (or too small a lag), because that makes all gusts smaller and so more probable.
    """

    time: np.ndarray
    linked: np.ndarray
    omega: np.ndarray
    omega_dot: np.ndarray
    force: np.ndarray
    noise: np.ndarray
    arm: np.ndarray
    vane_arms: np.ndarray
    g: float
    earth: tuple[np.ndarray, np.ndarray]
    airborne: np.ndarray
    vanes: tuple[str, ...]
    vane_noise: np.ndarray
    sensors: Sequence[Sensor]
    constants: Constants
    start_sigma: np.ndarray
    gust: np.ndarray | None = None
    gust_time: float = 1.0
    shown: bool = False
    g_height: float = 0.0
    gyro_spin: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def dt(self) -> float:
        """Sampling interval. [s]"""
        return float(self.time[1] - self.time[0])

    @property
    def states(self) -> int:
        """Number of state variables."""
        return 7 + len(self.vanes) + (3 if self.gust is not None else 0)

    @property
    def gusts(self) -> slice:
        """Places of the gust in the state; empty in calm air."""
        first = 7 + len(self.vanes)
        return slice(first, first + (3 if self.gust is not None else 0))

    @property
    def g_fall(self) -> float:
        """Gravity lost per metre of height. [s-2]"""
        return 2.0 * self.g / EARTH_RADIUS

    def gravity_at(self, h: np.ndarray) -> np.ndarray:
        """Return gravity at heights. [m s-2]"""
        return self.g - self.g_fall * (h - self.g_height)

    @property
    def starts(self) -> np.ndarray:
        """First sample of every segment."""
        return np.concatenate([[0], np.flatnonzero(~self.linked) + 1])


def wind(problem: Problem, x: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the velocity of the air mass at each state, gusts included (N, 3). [m s-1]"""
    steady = np.array([problem.constants.get(c, name) for name in ("wind_n", "wind_e", "wind_d")])
    blowing = problem.gust is not None and not problem.shown
    return np.broadcast_to(steady, (len(x), 3)) + (x[:, problem.gusts] if blowing else 0.0)


def body_rates(problem: Problem, c: np.ndarray) -> np.ndarray:
    """Return the gyro signals without biases and scale errors (N, 3). [rad s-1]"""
    return (problem.omega - c[problem.constants.index("bias.p", "bias.q", "bias.r")]) * gains(problem, c)[:3]


def specific_force(problem: Problem, c: np.ndarray) -> np.ndarray:
    """Return the specific force at the c.g. without biases and scale errors (N, 3). [m s-2]"""
    return force_at_cg(sensed_force(problem, c), body_rates(problem, c), problem.omega_dot, problem.arm)


def sensed_force(problem: Problem, c: np.ndarray) -> np.ndarray:
    """Return the specific force where the accelerometers sit, without biases and scale errors (N, 3). [m s-2]"""
    return (problem.force - c[problem.constants.index("bias.ax_imu", "bias.ay_imu", "bias.az_imu")]) * gains(problem, c)[3:]


def gains(problem: Problem, c: np.ndarray) -> np.ndarray:
    """Return 1/(1 + scale error) of gyros and accelerometers (6,)."""
    return 1.0 / (1.0 + np.array([problem.constants.get(c, f"scale.{name}") for name in IMU]))
