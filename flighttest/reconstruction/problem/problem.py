"""What a reconstruction is made of: readings, inputs and constants, everything but the unknown
path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flighttest.reconstruction.dynamics.kinematics import EARTH_RADIUS
from flighttest.records.sensors.instruments import IMU
from flighttest.records.sensors.position_corrections import force_at_cg

PER_RUN = (
    "wind_n",
    "wind_e",
    "wind_d",
    "p_reference",
)  # all others belong to the instruments and stay from run to run

CONTRADICTED = 4.0  # standard errors of its prior beyond which an estimate contradicts it


@dataclass(frozen=True)
class Constants:
    """Names, units and normal prior of the constants.

    Attributes
    ----------
    names, units : tuple of str
    mean : array (nc,)
    covariance : array (nc, nc)
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def index(self, *names: str) -> np.ndarray:
        """Return the places of `names`."""
        return np.array([self.names.index(name) for name in names], int)

    def get(self, c: np.ndarray, name: str, default: float = 0.0) -> float:
        """Return the value of one constant in the vector `c`, or `default` when it is not
        estimated.
        """
        return float(c[self.names.index(name)]) if name in self.names else default

    def precision(self) -> np.ndarray:
        """Return the inverse of the prior covariance."""
        return invert_covariance(self.covariance)

    def with_prior(self, prior: xr.Dataset) -> Constants:
        """Return these constants with the mean and covariance that another `bias_estimates` Dataset gives
        to the shared ones.
        """
        shared = [
            name
            for name in map(str, prior["parameter"].values)
            if name in self.names and name not in PER_RUN
        ]
        mean, covariance = self.mean.copy(), self.covariance.copy()
        at = self.index(*shared)
        chosen = prior.sel(parameter=shared, parameter_=shared)
        se = chosen["stderr"].values
        covariance[at, :] = 0.0
        covariance[:, at] = 0.0
        covariance[np.ix_(at, at)] = chosen["correlation"].values * np.outer(se, se)
        mean[at] = chosen["estimate"].values
        return Constants(self.names, self.units, mean, covariance)


def invert_covariance(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance, scaled first because the units of the constants differ by
    powers of ten.
    """
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)


def bias_estimates(
    constants: Constants, c: np.ndarray, covariance: np.ndarray, held: tuple[str, ...] = ()
) -> xr.Dataset:
    """Return the estimates as a Dataset over ``parameter``.

    Returns
    -------
    Dataset
        ``estimate stderr prior prior_stderr unit held`` (parameter), ``correlation
        prior_correlation`` (parameter, parameter_).
    """
    se, prior_se = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(constants.covariance))
    square = ("parameter", "parameter_")
    names = list(constants.names)
    return xr.Dataset(
        {
            "estimate": ("parameter", c),
            "stderr": ("parameter", se),
            "prior": ("parameter", constants.mean),
            "prior_stderr": ("parameter", prior_se),
            "unit": ("parameter", list(constants.units)),
            "held": ("parameter", [name in held for name in names]),
            "correlation": (square, covariance / np.outer(se, se)),
            "prior_correlation": (square, constants.covariance / np.outer(prior_se, prior_se)),
        },
        coords={"parameter": names, "parameter_": names},
    )


def identifiability_remarks(found: xr.Dataset) -> list[str]:
    """Return in words what the data could not determine: constants that rest on their prior or
    contradict it, and pairs that do the same.

    Notes
    -----
    A posterior standard error above half the prior one means that the data contain little information; a correlation beyond 0.9 means
    that only a combination of the two is known.  An estimate beyond four standard errors of the prior, which chance brings once in 16 000,
    means that the prior is too narrow or a reading wrong: the estimate then lies between the two and its standard error is too small.
    """
    words = []
    ratio = (found["stderr"] / found["prior_stderr"]).values
    names = [str(name) for name in found["parameter"].values]
    for name, r in zip(names, ratio, strict=True):
        if r > 0.5:
            words.append(f"{name} rests on its prior: standard error {r:.0%} of the prior one")
    off = ((found["estimate"] - found["prior"]) / found["prior_stderr"]).values
    for name, z in zip(names, off, strict=True):
        if abs(z) > CONTRADICTED:
            words.append(
                f"{name} contradicts its prior: {abs(z):.1f} standard errors of the prior "
                f"from it; give it a wider one"
                f"{' (wind_down_sigma of the record)' if name == 'wind_d' else ''} or look "
                f"for a wrong reading"
            )
    correlation = found["correlation"].values
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > 0.9:
                kind = "sum" if correlation[i, j] < 0 else "difference"
                words.append(
                    f"{names[j]} and {names[i]} cannot be distinguished (correlation "
                    f"{correlation[i, j]:+.3f}): "
                    f"their weighted {kind} is known"
                )
    return words


Model = Callable[
    ["Sensor", "PathProblem", np.ndarray, np.ndarray],
    tuple[np.ndarray, np.ndarray, tuple[str, ...], np.ndarray],
]
ATTITUDE, VELOCITY, HEIGHT = (
    slice(0, 3),
    slice(3, 6),
    6,
)  # places in the state; lagged vane angles and gusts follow


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
class PathProblem:
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
        Rate of the Earth and transport matrix, see `kinematics.earth_rotation`.
    gyro_spin : array (3,)
        Rate of the Earth as far as the gyros show it, north-east-down. [rad s-1]
    airborne : array (N,) of bool
        Fast enough for vanes.
    vanes : tuple of str
        Lagged angles in the state, of ``alpha_vane``, ``beta_vane``.
    vane_noise : array (vanes,)
        One sigma by which the lag equation may be off per step, far below the noise of the vane.
        [rad]
    gust : array (3,) or None
        One sigma of the gust components north, east, down [m s-1]; or, when `shown`, of what they
        add to ``alpha_vane``, ``beta_vane`` and ``q_c``. [rad], [rad], [Pa]
    gust_time : float
        Correlation time of the gusts. [s]
    g_height : float
        [m]
    shown : bool
        Which of the two.  Constants are estimated with the second: a mode over gusts and vane
        factor together would take too large a factor (or too small a lag), because that makes all
        gusts smaller and so more probable.
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


def wind_velocity(problem: PathProblem, x: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the velocity of the air mass at each state, gusts included (N, 3). [m s-1]"""
    steady = np.array([problem.constants.get(c, name) for name in ("wind_n", "wind_e", "wind_d")])
    blowing = problem.gust is not None and not problem.shown
    return np.broadcast_to(steady, (len(x), 3)) + (x[:, problem.gusts] if blowing else 0.0)


def body_rates(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the gyro signals without biases and scale errors (N, 3). [rad s-1]"""
    return (
        problem.omega - c[problem.constants.index("bias.p", "bias.q", "bias.r")]
    ) * inertial_gains(problem, c)[:3]


def specific_force(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the specific force at the c.g. without biases and scale errors (N, 3). [m s-2]"""
    return force_at_cg(
        sensed_force(problem, c), body_rates(problem, c), problem.omega_dot, problem.arm
    )


def sensed_force(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the specific force where the accelerometers sit, without biases and scale errors (N,
    3). [m s-2]
    """
    return (
        problem.force - c[problem.constants.index("bias.ax_imu", "bias.ay_imu", "bias.az_imu")]
    ) * inertial_gains(problem, c)[3:]


def inertial_gains(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return 1/(1 + scale error) of gyros and accelerometers (6,)."""
    return 1.0 / (1.0 + np.array([problem.constants.get(c, f"scale.{name}") for name in IMU]))
