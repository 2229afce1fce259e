"""Classes of the reconstruction problem: constants, sensors and inputs of an unknown path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from flighttest.reconstruction.dynamics.kinematics import EARTH_RADIUS
from flighttest.records.sensors.instruments import IMU
from flighttest.records.sensors.position_corrections import force_at_cg

# Constants of the air of one run. All others belong to the instruments and stay from run to run.
PER_RUN = ("wind_n", "wind_e", "wind_d", "p_reference")
# Distance of an estimate from its prior, in standard errors of the prior, from which they disagree.
CONTRADICTED = 4.0
# A posterior standard error above this share of the prior one: the data hold little information.
_UNINFORMED = 0.5
# A correlation above which only a combination of two constants is determined.
_INDISTINCT = 0.9


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
        """Return the indices of `names`."""
        return np.array([self.names.index(name) for name in names], int)

    def get(self, c: np.ndarray, name: str, default: float = 0.0) -> float:
        """Return the value of one constant in the vector `c`.

        A constant that is not estimated has the value `default`.
        """
        if name not in self.names:
            return default
        return float(c[self.names.index(name)])

    def precision(self) -> np.ndarray:
        """Return the inverse of the prior covariance."""
        return invert_covariance(self.covariance)

    def with_prior(self, prior: xr.Dataset) -> Constants:
        """Return these constants with the estimates of other runs as prior of the shared ones.

        Parameters
        ----------
        prior : Dataset (parameter,)
            Result of `bias_estimates` or `combine_biases`. Constants of a single run are ignored.
        """
        shared = []
        for name in map(str, prior["parameter"].values):
            if name in self.names and name not in PER_RUN:
                shared.append(name)
        indices = self.index(*shared)
        estimates = prior.sel(parameter=shared, parameter_=shared)
        stderr = estimates["stderr"].values
        mean = self.mean.copy()
        mean[indices] = estimates["estimate"].values
        # The shared constants are independent of the constants of this run.
        covariance = self.covariance.copy()
        covariance[indices, :] = 0.0
        covariance[:, indices] = 0.0
        block = estimates["correlation"].values * np.outer(stderr, stderr)
        covariance[np.ix_(indices, indices)] = block
        return Constants(self.names, self.units, mean, covariance)


def invert_covariance(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance."""
    # Scaled to unit diagonal first, because the units of the constants differ by powers of ten.
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)


def bias_estimates(
    constants: Constants, c: np.ndarray, covariance: np.ndarray, held: tuple[str, ...] = ()
) -> xr.Dataset:
    """Return the estimates of the constants as a Dataset over ``parameter``.

    Parameters
    ----------
    constants : Constants
        Names, units and prior.
    c : array (nc,)
        Estimates.
    covariance : array (nc, nc)
    held : tuple of str
        Constants that stayed at their prior.

    Returns
    -------
    Dataset
        ``estimate stderr prior prior_stderr unit held`` (parameter), ``correlation
        prior_correlation`` (parameter, parameter_).
    """
    stderr = np.sqrt(np.diag(covariance))
    prior_stderr = np.sqrt(np.diag(constants.covariance))
    correlation = covariance / np.outer(stderr, stderr)
    prior_correlation = constants.covariance / np.outer(prior_stderr, prior_stderr)
    square = ("parameter", "parameter_")
    names = list(constants.names)
    is_held = [name in held for name in names]
    return xr.Dataset(
        {
            "estimate": ("parameter", c),
            "stderr": ("parameter", stderr),
            "prior": ("parameter", constants.mean),
            "prior_stderr": ("parameter", prior_stderr),
            "unit": ("parameter", list(constants.units)),
            "held": ("parameter", is_held),
            "correlation": (square, correlation),
            "prior_correlation": (square, prior_correlation),
        },
        coords={"parameter": names, "parameter_": names},
    )


def identifiability_remarks(estimates: xr.Dataset) -> list[str]:
    """Return sentences about constants that the data do not determine.

    The sentences name constants that rest on their prior, constants that contradict their prior,
    and pairs of constants with the same effect.

    Parameters
    ----------
    estimates : Dataset (parameter,)
        Result of `bias_estimates`.

    Notes
    -----
    A posterior standard error above half the prior one means that the data contain little
    information. A correlation beyond 0.9 means that only a combination of the two is known.

    Chance brings an estimate beyond four standard errors of the prior once in 16 000. Such an
    estimate means that the prior is too narrow or a reading is wrong. The estimate then lies
    between the two and its standard error is too small.
    """
    names = [str(name) for name in estimates["parameter"].values]
    return [
        *_uninformed_constants(names, estimates),
        *_contradicted_priors(names, estimates),
        *_indistinct_pairs(names, estimates["correlation"].values),
    ]


def _uninformed_constants(names: list[str], estimates: xr.Dataset) -> list[str]:
    remarks = []
    ratios = (estimates["stderr"] / estimates["prior_stderr"]).values
    for name, ratio in zip(names, ratios, strict=True):
        if ratio > _UNINFORMED:
            remarks.append(
                f"{name} rests on its prior: standard error {ratio:.0%} of the prior one"
            )
    return remarks


def _contradicted_priors(names: list[str], estimates: xr.Dataset) -> list[str]:
    remarks = []
    deviations = ((estimates["estimate"] - estimates["prior"]) / estimates["prior_stderr"]).values
    for name, deviation in zip(names, deviations, strict=True):
        if abs(deviation) <= CONTRADICTED:
            continue
        # The prior of the vertical wind is an attribute of the record, not of an instrument.
        attribute = ""
        if name == "wind_d":
            attribute = " (wind_down_sigma of the record)"
        remarks.append(
            f"{name} contradicts its prior: {abs(deviation):.1f} standard errors of the prior "
            f"from it; give it a wider one{attribute} or look for a wrong reading"
        )
    return remarks


def _indistinct_pairs(names: list[str], correlation: np.ndarray) -> list[str]:
    remarks = []
    for i in range(len(names)):
        for j in range(i):
            if not abs(correlation[i, j]) > _INDISTINCT:
                continue
            # Errors of opposite sign cancel in the sum, errors of the same sign in the difference.
            combination = "difference"
            if correlation[i, j] < 0:
                combination = "sum"
            remarks.append(
                f"{names[j]} and {names[i]} cannot be distinguished (correlation "
                f"{correlation[i, j]:+.3f}): their weighted {combination} is known"
            )
    return remarks


Model = Callable[
    ["Sensor", "PathProblem", np.ndarray, np.ndarray],
    tuple[np.ndarray, np.ndarray, tuple[str, ...], np.ndarray],
]
# Indices of the state variables. Lagged vane angles and gusts follow the height.
ATTITUDE = slice(0, 3)
VELOCITY = slice(3, 6)
HEIGHT = 6
_RIGID_STATES = 7  # attitude, velocity, height
_GUST_STATES = 3


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
        Standard deviation of their white noise.
    model : callable
        Output equation, see `output_equations`.
    delay : str
        Name of the constant that holds the latency, or "".
    extra : dict
        Further arguments of the model: arrays (M,) or numbers.
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
    """Inputs, readings and priors of a flight path. The path and the constants are the unknowns.

    Attributes
    ----------
    time : array (N,)
        Uniform within a segment. [s]
    linked : array (N-1,) of bool
        False where one window ends and the next begins.
    omega, omega_dot, force : array (N, 3)
        Inertial unit as recorded (not yet moved to the c.g.). [rad s-1], [rad s-2], [m s-2]
    noise : array (6,)
        Standard deviation of omega and force per sample of the grid.
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
        Standard deviation of the lag equation per step, far below the noise of the vane. [rad]
    sensors : sequence of Sensor
    constants : Constants
    start_sigma : array (n,)
        Standard deviation of the state at the start of a segment.
    gust : array (3,) or None
        Standard deviation of the gust components north, east, down [m s-1]. If `shown` is true, it
        belongs to the change of ``alpha_vane``, ``beta_vane`` and ``q_c``. [rad], [rad], [Pa]
    gust_time : float
        Correlation time of the gusts. [s]
    g_height : float
        Height that `g` belongs to. [m]
    shown : bool
        Whether the gust states are changes of readings. Constants are estimated with such states.
        A mode over gust velocities and vane factor would take too large a factor (or too small a
        lag), because that makes all gusts smaller and so more probable.
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
        return int(self.gusts.stop)

    @property
    def gusts(self) -> slice:
        """Indices of the gust in the state; empty in calm air."""
        first = _RIGID_STATES + len(self.vanes)
        if self.gust is None:
            return slice(first, first)
        return slice(first, first + _GUST_STATES)

    @property
    def has_gust_velocity(self) -> bool:
        """Whether the state holds the velocity of the gusts."""
        return self.gust is not None and not self.shown

    @property
    def g_fall(self) -> float:
        """Decrease of gravity per metre of height. [s-2]"""
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
    wind = np.broadcast_to(steady, (len(x), 3))
    if problem.has_gust_velocity:
        return wind + x[:, problem.gusts]
    return wind + 0.0


def body_rates(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the gyro signals without biases and scale errors (N, 3). [rad s-1]"""
    bias = c[problem.constants.index("bias.p", "bias.q", "bias.r")]
    return (problem.omega - bias) * inertial_gains(problem, c)[:3]


def specific_force(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the specific force at the c.g. without biases and scale errors (N, 3). [m s-2]"""
    return force_at_cg(
        sensed_force(problem, c), body_rates(problem, c), problem.omega_dot, problem.arm
    )


def sensed_force(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return the specific force at the accelerometers (N, 3). [m s-2]

    Biases and scale errors are removed.
    """
    bias = c[problem.constants.index("bias.ax_imu", "bias.ay_imu", "bias.az_imu")]
    return (problem.force - bias) * inertial_gains(problem, c)[3:]


def inertial_gains(problem: PathProblem, c: np.ndarray) -> np.ndarray:
    """Return 1/(1 + scale error) of gyros and accelerometers (6,)."""
    scale_errors = np.array([problem.constants.get(c, f"scale.{name}") for name in IMU])
    return 1.0 / (1.0 + scale_errors)
