"""Output equations of the sensors: readings for a given state and given constants.

A `Sensor` is a group of channels that share clock and latency. Its `model` takes states and body
rates at the instants of the readings (M, n + 3) and returns

- outputs (M, m),
- their derivative by the state (M, m, n), or by state and body rates (M, m, n + 3), or one
  derivative that all readings share (1, m, n),
- the names of the constants involved,
- the derivative by these constants (M, m, names).
"""

from __future__ import annotations

import numpy as np

from flightmech.air import A_SEA, GAMMA, P_SEA, R_AIR
from flighttest.reconstruction.dynamics.kinematics import cross_product_matrix, ned_to_body
from flighttest.reconstruction.problem.problem import (
    ATTITUDE,
    HEIGHT,
    VELOCITY,
    PathProblem,
    Sensor,
    wind_velocity,
)

LAPSE = 0.0065  # K/m, inside one run; the level is measured
# Constants that act on air data.
_AIR_CONSTANTS = (
    "wind_n",
    "wind_e",
    "wind_d",
    "bias.temperature",
    "p_reference",
    "static_error",
)
# Index of the gust state that is the change of a reading.
SEES_GUSTS = {"alpha_vane": 0, "beta_vane": 1, "q_c": 2, "V": 2, "V_cas": 2, "mach": 2}
# Limits that keep roots and ratios finite at rest.
_LEAST_SQUARE = 1.0  # m2 s-2
_LEAST_IMPACT = 1e-3  # Pa


def show_states(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show state variables, each with a bias if there is a constant ``bias.<channel>``."""
    places = sensor.extra["places"]
    J = np.zeros((1, len(places), problem.states))
    J[:, np.arange(len(places)), places] = 1.0
    y, names, Jc = _with_bias(sensor, problem, x[:, places], c)
    return y, J, names, Jc


def show_vanes(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show the lagged angles times a factor K, plus a bias."""
    m = len(sensor.names)
    rows = np.arange(m)
    places = np.array([7 + problem.vanes.index(name) for name in sensor.names])
    factors = tuple(f"factor.{name}" for name in sensor.names)
    K = c[problem.constants.index(*factors)]
    J = np.zeros((1, m, problem.states))
    J[:, rows, places] = K
    angle = x[:, places]
    y = K * angle
    for i, name in enumerate(sensor.names):
        _add_gust(problem, x, name, y=y[:, i], J=J[:, i])
    y, biases, J_bias = _with_bias(sensor, problem, y, c)
    # columns of the factors, then of the biases
    Jc = np.zeros((*y.shape, m + len(biases)))
    Jc[:, rows, rows] = angle
    Jc[..., m:] = J_bias
    return y, J, (*factors, *biases), Jc


def show_radio_height(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show the height of the antenna over the runway."""
    sf, st, _ = np.sin(x[:, ATTITUDE]).T
    cf, ct, _ = np.cos(x[:, ATTITUDE]).T
    a, b, d = sensor.extra["arm"]
    # third row of the rotation from body to north-east-down, times the arm
    below = -st * a + sf * ct * b + cf * ct * d
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, 0] = -(cf * ct * b - sf * ct * d)
    J[:, 0, 1] = ct * a + sf * st * b + cf * st * d
    J[:, 0, HEIGHT] = 1.0
    height = x[:, HEIGHT] - sensor.extra["elevation"] - below
    y, names, Jc = _with_bias(sensor, problem, height[:, None], c)
    return y, J, names, Jc


def air_data(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show impact pressure and static pressure, or an airspeed.

    The readings are q_c (1 - k) + bias, p + k q_c, or K V + bias. Total pressure is exact, so both
    pressures share the position error k. Static pressure follows from the height by the
    hydrostatic equation, from ``p_reference`` at the reference height, with the measured
    temperature. The pitot tube moves with omega x arm, so the derivative has columns for the body
    rates after the columns for the state (M, m, states + 3).
    """
    square, d_state = airspeed_squared(problem, x, c, sensor.extra.get("arm"))
    channels = _air_channels(problem, c, square, h=x[:, HEIGHT], sensor=sensor)
    y = np.stack([channels[name][0] for name in sensor.names], axis=1)
    J = np.empty((*y.shape, problem.states + 3))
    constants = [name for name in _AIR_CONSTANTS if name in problem.constants]
    factors = []
    for name in sensor.names:
        if f"factor.{name}" in problem.constants:
            factors.append(f"factor.{name}")
    Jc = np.zeros((*y.shape, len(constants) + len(factors)))
    for i, name in enumerate(sensor.names):
        factor = f"factor.{name}"
        K = problem.constants.get(c, factor, 1.0)
        value, d_square, d_height, d_temperature, d_reference, d_k = channels[name]
        y[:, i] = K * value
        # chain rule over the square of the airspeed, then the height
        np.multiply((K * d_square)[:, None], d_state, out=J[:, i])
        J[:, i, HEIGHT] = K * d_height
        # The wind acts like minus the ground velocity.
        slopes = (*-J[:, i, VELOCITY].T, -K * d_temperature, K * d_reference, K * d_k)
        by_constant = dict(zip(_AIR_CONSTANTS, slopes, strict=True))
        for j, constant in enumerate(constants):
            Jc[:, i, j] = by_constant[constant]
        if factor in factors:
            Jc[:, i, len(constants) + factors.index(factor)] = value
        if problem.has_gust_velocity:
            J[:, i, problem.gusts] = -J[:, i, VELOCITY]
        _add_gust(problem, x, name, y=y[:, i], J=J[:, i])
    y, biases, J_bias = _with_bias(sensor, problem, y, c)
    return y, J, (*constants, *factors, *biases), np.concatenate([Jc, J_bias], axis=-1)


def _air_channels(
    problem: PathProblem, c: np.ndarray, square: np.ndarray, h: np.ndarray, sensor: Sensor
) -> dict[str, tuple[np.ndarray, ...]]:
    """Return the value of each channel and its derivatives.

    The derivatives are by V^2, height, temperature, ``p_reference`` and position error k.
    """
    temperature = sensor.extra["temperature"]
    reference = sensor.extra["reference"]
    zero = np.zeros(len(square))
    k = problem.constants.get(c, "static_error")
    q, p, slopes = impact_and_static(
        problem, square, h=h, c=c, temperature=temperature, reference=reference
    )
    T = temperature - problem.constants.get(c, "bias.temperature")
    V = np.sqrt(np.maximum(square, _LEAST_SQUARE))
    a = np.sqrt(GAMMA * R_AIR * T)
    # calibrated airspeed: q_c/p_0 + 1 = (1 + V_cas^2/(5 a_0^2))^(7/2)
    ratio = 1.0 + np.maximum(q, _LEAST_IMPACT) / P_SEA
    V_cas = A_SEA * np.sqrt(5.0 * (ratio ** (2.0 / 7.0) - 1.0))
    cas_by_q = 5.0 / 7.0 * A_SEA**2 * ratio ** (-5.0 / 7.0) / (P_SEA * V_cas)
    impact_slopes = [(1.0 - k) * dq for dq, _ in slopes]
    static_slopes = [dp + k * dq for dq, dp in slopes]
    cas_slopes = [cas_by_q * dq for dq, _ in slopes]
    return {
        "q_c": ((1.0 - k) * q, *impact_slopes, -q),
        "p_static": (p + k * q, *static_slopes, q),
        "V": (V, 0.5 / V, zero, zero, zero, zero),
        "mach": (V / a, 0.5 / (V * a), zero, -0.5 * V / (a * T), zero, zero),
        "V_cas": (V_cas, *cas_slopes, zero),
    }


def airspeed_squared(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, arm: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the square of the airspeed at a point of the aeroplane, and its derivative.

    Parameters
    ----------
    x : array (M, states + 3)
        State and body rates.
    arm : array (3,), optional
        Position of the point from the c.g.; the c.g. itself by default. [m]

    Returns
    -------
    square : array (M,)
        |R'(v - wind) + omega x arm|^2 [m2 s-2]
    derivative : array (M, states + 3)
        By state and body rates; zero in the columns of gusts.
    """
    air = x[:, VELOCITY] - wind_velocity(problem, x, c)
    derivative = np.zeros((len(x), problem.states + 3))
    if arm is None:
        derivative[:, VELOCITY] = 2.0 * air
        return (air**2).sum(axis=1), derivative
    body, d_attitude, d_velocity = ned_to_body(x[:, ATTITUDE], air)
    local = body + np.cross(x[:, problem.states :], arm)
    # d|u|^2 = 2 u' du
    double = 2.0 * local[:, None, :]
    derivative[:, ATTITUDE] = (double @ d_attitude)[:, 0]
    derivative[:, VELOCITY] = (double @ d_velocity)[:, 0]
    derivative[:, problem.states :] = (double @ -cross_product_matrix(arm))[:, 0]
    return (local**2).sum(axis=1), derivative


def impact_and_static(
    problem: PathProblem,
    square: np.ndarray,
    h: np.ndarray,
    c: np.ndarray,
    temperature: np.ndarray,
    reference: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Return true impact and static pressure, and the derivatives of both.

    Parameters
    ----------
    square : array (M,)
        Square of the airspeed. [m2 s-2]
    h : array (M,)
        Height. [m]
    temperature : array (M,)
        Air temperature as measured. [K]
    reference : (float, float)
        Reference height and the measured temperature there. [m], [K]

    Returns
    -------
    q, p : array (M,)
        [Pa]
    derivatives : list of (dq, dp)
        By square, height, temperature and ``p_reference``.
    """
    air = _AirColumn(problem, square, h, c, temperature=temperature, reference=reference)
    T, p = air.temperature, air.pressure
    # q_c = p F, F = (1 + 0.2 M^2)^3.5 - 1, dF/dM^2 = 0.7 (1 + 0.2 M^2)^2.5
    root = air.stagnation * air.stagnation * np.sqrt(air.stagnation)
    F = air.stagnation * root - 1.0
    dF = 0.7 * root
    # p = p_0 (T/T_0)^(g/(R lapse)), T = T_0 - lapse (h - h_0)
    dp_height = -p * problem.g / (R_AIR * air.level * air.temperature_ratio)
    dp_temperature = (
        p * problem.g * (h - reference[0]) / (R_AIR * air.level**2 * air.temperature_ratio)
    )
    dq_square = p * dF / (GAMMA * R_AIR * T)
    slopes = [
        (dq_square, np.zeros_like(dq_square)),
        (F * dp_height, dp_height),
        (F * dp_temperature - p * dF * air.mach_squared / T, dp_temperature),
        (F * air.pressure_ratio, air.pressure_ratio),
    ]
    return p * F, p, slopes


def impact_static_pressures(
    problem: PathProblem, square, h, c, temperature, reference
) -> tuple[np.ndarray, np.ndarray]:
    """Return true impact and static pressure; arguments as `impact_and_static`."""
    air = _AirColumn(problem, square, h, c, temperature=temperature, reference=reference)
    base = air.stagnation
    return air.pressure * (base * base * base * np.sqrt(base) - 1.0), air.pressure


class _AirColumn:
    """Air at heights h (M,), for an airspeed of the given square (M,).

    Attributes
    ----------
    temperature : array (M,)
        Measured temperature less its bias. [K]
    level : float
        Temperature at the reference height. [K]
    mach_squared : array (M,)
    stagnation : array (M,)
        Ratio of total to static temperature, 1 + 0.2 M^2.
    temperature_ratio, pressure_ratio : array (M,)
        Over the values at the reference height.
    pressure : array (M,)
        Static pressure. [Pa]
    """

    def __init__(self, problem: PathProblem, square, h, c, temperature, reference):
        height, reference_temperature = reference
        bias = problem.constants.get(c, "bias.temperature")
        self.temperature = temperature - bias
        self.level = reference_temperature - bias
        self.mach_squared = square / (GAMMA * R_AIR * self.temperature)
        self.stagnation = 1.0 + 0.2 * self.mach_squared
        self.temperature_ratio = 1.0 - LAPSE * (h - height) / self.level
        self.pressure_ratio = self.temperature_ratio ** (problem.g / (R_AIR * LAPSE))
        self.pressure = problem.constants.get(c, "p_reference") * self.pressure_ratio


def _add_gust(problem: PathProblem, x: np.ndarray, name: str, y: np.ndarray, J: np.ndarray) -> None:
    """Add the gust state to a reading in place, if gust states are changes of readings."""
    if problem.shown and problem.gust is not None and name in SEES_GUSTS:
        state = problem.gusts.start + SEES_GUSTS[name]
        y += x[:, state]
        J[:, state] = 1.0


def no_sideslip(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show the air-relative velocity along body y. Without a sideslip vane its reading is zero."""
    air = x[:, VELOCITY] - wind_velocity(problem, x, c)
    body, d_attitude, d_velocity = ned_to_body(x[:, ATTITUDE], air)
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, ATTITUDE] = d_attitude[:, 1]
    J[:, 0, VELOCITY] = d_velocity[:, 1]
    return body[:, 1:2], J, (), np.zeros((len(x), 1, 0))


def _with_bias(
    sensor: Sensor, problem: PathProblem, y: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Return outputs with their biases, the names of the biases, and the derivative by them."""
    biased = [i for i, name in enumerate(sensor.names) if f"bias.{name}" in problem.constants]
    names = tuple(f"bias.{sensor.names[i]}" for i in biased)
    Jc = np.zeros((*y.shape, len(biased)))
    Jc[:, biased, np.arange(len(biased))] = 1.0
    y = y.copy()
    y[:, biased] += c[problem.constants.index(*names)]
    return y, names, Jc
