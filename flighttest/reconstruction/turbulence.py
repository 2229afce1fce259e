"""Detection of turbulence in the residuals of a path, and the intensity of its gusts."""

from __future__ import annotations

import numpy as np

from flightmech.air import GAMMA, R_AIR, RHO_SEA
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.output_equations import SEES_GUSTS
from flighttest.reconstruction.problem.problem import VELOCITY, PathProblem
from flighttest.reconstruction.problem.readings import sensor_residuals
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.records.sensors.instruments import SPEEDS, VANES

# m, of the gust model. Vanes and pitot measure the gusts themselves, so it has little influence.
GUST_LENGTH = 150.0
# Residual rms over noise of vanes and pitot above which the air may be turbulent, or the noise is
# larger than specified.
CALM = 1.1
# Share of the excess variance that must be correlated for gusts: halfway between white noise and
# gusts alone.
GUSTY = 0.5
# Share of the correlation time of gusts over which residuals are tested for correlation.
MEMORY = 0.25
_LEAST_SPEED = 10.0  # m/s
_LEAST_READINGS = 3


def in_calm_air(setup: Setup, solution: Solution) -> bool:
    """Return whether vanes and impact pressure agree with a path in uniformly moving air.

    With an inertial unit the path hardly follows gusts, so gusts remain in these residuals. Gusts
    are correlated in time, and noise of instruments is not. Of a residual larger than the specified
    noise, only the part that is correlated from reading to reading indicates gusts. A specification
    of too small noise is therefore not turbulence.
    """
    memory = MEMORY * GUST_LENGTH / _typical_speed(solution)
    for sensor in setup.problem.sensors:
        residuals, _ = sensor_residuals(setup.problem, sensor, solution.x, solution.c)
        for r, sigma, name in zip(residuals.T, sensor.sigma, sensor.names, strict=True):
            if name in SEES_GUSTS and has_gusts(r / sigma, sensor.time, memory):
                return False
    return True


def has_gusts(r: np.ndarray, time: np.ndarray, memory: float) -> bool:
    """Return whether scaled residuals contain gusts.

    Parameters
    ----------
    r : array (readings,)
        Residuals over the specified noise.
    time : array (readings,)
        [s]
    memory : float
        Largest lag of the mean autocovariance; at least one reading is used. [s]

    Notes
    -----
    Let s^2 be the variance of r and c its mean autocovariance over the lags. White noise of any
    size has c = 0. Gusts on top of the specified noise have c = s^2 - 1. Gusts are detected if
    s > `CALM` and c > `GUSTY` (s^2 - 1), and c exceeds two of its standard errors for white noise,
    s^2/sqrt(readings lags).
    """
    power = float(np.mean(r**2))
    if len(r) < _LEAST_READINGS or power < CALM**2:
        return False
    step = max(float(np.median(np.diff(time))), 1e-9)
    # a quarter of the readings at most, so that every lag has enough products
    lags = int(np.clip(memory // step, 1, max(len(r) // 4, 1)))
    covariances = [r[k:] @ r[:-k] / len(r) for k in range(1, lags + 1)]
    c = float(np.mean(covariances))
    return c > max(GUSTY * (power - 1.0), 2.0 * power / np.sqrt(len(r) * lags))


def measured_airspeed(problem: PathProblem) -> str:
    """Return the channel of the airspeed."""
    for sensor in problem.sensors:
        for name in sensor.names:
            if name in ("q_c", *SPEEDS):
                return name
    return "q_c"


def hidden_by_gusts(problem: PathProblem) -> tuple[str, ...]:
    """Return the constants that turbulence hides.

    Gusts change vanes and the motion of the aeroplane alike. Latencies and factors of the sensors
    of gusts are therefore not identifiable.
    """
    hidden = {"lag.vanes"}
    for name in VANES:
        hidden.add(f"factor.{name}")
    for sensor in problem.sensors:
        if not SEES_GUSTS.keys().isdisjoint(sensor.names):
            hidden.add(sensor.delay)
    return tuple(name for name in problem.constants.names if name in hidden)


def gust_intensity(setup: Setup, solution: Solution, sigma: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the gusts north, east, down (3,). [m s-1]

    Parameters
    ----------
    setup : Setup
    solution : Solution
    sigma : array (3,)
        Standard deviation of the changes that gusts make in the readings of ``alpha_vane``,
        ``beta_vane`` and the airspeed.

    Notes
    -----
    w = V alpha, v = V beta. The component u is the reading times its slope: 1/(rho V) for q_c,
    sqrt(rho_0/rho) for V_cas, the speed of sound for mach. The horizontal components have the same
    variance, the mean over v and u.
    """
    V = _typical_speed(solution)
    temperature = setup.reference[1]
    p = setup.problem.constants.get(solution.c, "p_reference")
    rho = p / (R_AIR * temperature)
    speed_of_sound = np.sqrt(GAMMA * R_AIR * temperature)
    slopes = {"q_c": 1.0 / (rho * V), "V": 1.0, "V_cas": np.sqrt(RHO_SEA / rho)}
    slopes["mach"] = speed_of_sound
    slope = slopes[measured_airspeed(setup.problem)]
    vertical, lateral, longitudinal = sigma * np.array([V, V, slope])
    horizontal = float(np.sqrt((lateral**2 + longitudinal**2) / 2.0))
    return np.array([horizontal, horizontal, vertical])


def _typical_speed(solution: Solution) -> float:
    """Return the median ground speed, at least 10 m/s. [m s-1]"""
    speed = np.linalg.norm(solution.x[:, VELOCITY], axis=1)
    return max(float(np.median(speed)), _LEAST_SPEED)
