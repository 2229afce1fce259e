"""Output equations: what each sensor shows for a given state and given constants, with derivatives.

A `Sensor` is a group of channels that share clock and latency.  Its `model` takes states and body
rates at the instants of the readings (M, n + 3) and returns outputs (M, m), their derivative by
state (M, m, n), or by state and body rates (M, m, n + 3), or one of these that all readings share
(1, m, n), the names of the constants involved, and the derivative by these (M, m, names).
"""

from __future__ import annotations

import numpy as np

from flightmech.air import A_SEA, GAMMA, P_SEA, R_AIR
from flighttest.reconstruction.dynamics.kinematics import cross_product_matrix, ned_to_body
from flighttest.reconstruction.problem.problem import (
    ATTITUDE,
    VELOCITY,
    PathProblem,
    Sensor,
    wind_velocity,
)

LAPSE = 0.0065  # K/m, inside one run; the level is measured
_BEHIND_AIR = (
    "wind_n",
    "wind_e",
    "wind_d",
    "bias.temperature",
    "p_reference",
    "static_error",
)  # constants behind air data
SEES_GUSTS = {
    "alpha_vane": 0,
    "beta_vane": 1,
    "q_c": 2,
    "V": 2,
    "V_cas": 2,
    "mach": 2,
}  # place of what gusts add to a reading


def show_states(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show single state variables, each with a bias when there is a constant ``bias.<channel>``."""
    places = sensor.extra["places"]
    y = x[:, places]
    J = np.zeros((1, len(places), problem.states))
    J[:, np.arange(len(places)), places] = 1.0
    y, names, Jc = _with_bias(sensor, problem, y, c)
    return y, J, names, Jc


def show_vanes(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show K times the lagged angle plus an offset."""
    places = np.array([7 + problem.vanes.index(name) for name in sensor.names])
    factors = tuple(f"factor.{name}" for name in sensor.names)
    K = c[problem.constants.index(*factors)]
    J = np.zeros((1, len(places), problem.states))
    J[:, np.arange(len(places)), places] = K
    angle = x[:, places]
    y = K * angle
    for i, name in enumerate(sensor.names):
        _show_gust(problem, x, name, y[:, i], J[:, i])
    y, names, Jb = _with_bias(sensor, problem, y, c)
    Jc = np.zeros((*y.shape, len(places) + len(names)))
    Jc[:, np.arange(len(places)), np.arange(len(places))], Jc[..., len(places) :] = angle, Jb
    return y, J, (*factors, *names), Jc


def show_radio_height(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show the height of the antenna over the runway."""
    (sf, st, _), (cf, ct, _) = np.sin(x[:, :3]).T, np.cos(x[:, :3]).T
    a, b, d = sensor.extra["arm"]
    below = -st * a + sf * ct * b + cf * ct * d  # third row of the rotation
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, 0] = -(cf * ct * b - sf * ct * d)
    J[:, 0, 1] = ct * a + sf * st * b + cf * st * d
    J[:, 0, 6] = 1.0
    y, names, Jc = _with_bias(
        sensor, problem, (x[:, 6] - sensor.extra["elevation"] - below)[:, None], c
    )
    return y, J, names, Jc


def air_data(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show impact and static pressure, q_c (1 - k) + bias and p + k q_c, or an airspeed, K V +
    bias.

    Total pressure is taken as exact, so both pressures share the position error k.  Static pressure
    follows the height hydrostatically from ``p_reference`` at the reference height, with the
    measured temperature.  The pitot tube moves with omega x arm, so the derivative by the body
    rates follows that by the state (M, m, states + 3).
    """
    square, moved = airspeed_squared(problem, x, c, sensor.extra.get("arm"))
    rows = _air_rows(problem, c, square, x[:, 6], sensor)
    y = np.stack([rows[name][0] for name in sensor.names], axis=1)
    J = np.empty((*y.shape, problem.states + 3))
    behind = [name for name in _BEHIND_AIR if name in problem.constants]
    factors = [f"factor.{name}" for name in sensor.names if f"factor.{name}" in problem.constants]
    by = np.zeros((*y.shape, len(behind) + len(factors)))
    for i, name in enumerate(sensor.names):
        K = problem.constants.get(c, f"factor.{name}", 1.0)
        value, d_square, d_h, d_temperature, d_reference, d_k = rows[name]
        if f"factor.{name}" in factors:
            by[:, i, len(behind) + factors.index(f"factor.{name}")] = value
        y[:, i] = K * value
        np.multiply((K * d_square)[:, None], moved, out=J[:, i])
        J[:, i, 6] = K * d_h
        own = dict(
            zip(
                _BEHIND_AIR,
                (*-J[:, i, VELOCITY].T, -K * d_temperature, K * d_reference, K * d_k),
                strict=True,
            )
        )
        for j, constant in enumerate(behind):
            by[:, i, j] = own[constant]
        if problem.gust is not None and not problem.shown:
            J[:, i, problem.gusts] = -J[:, i, VELOCITY]
        _show_gust(problem, x, name, y[:, i], J[:, i])
    y, names, Jb = _with_bias(sensor, problem, y, c)
    return y, J, (*behind, *factors, *names), np.concatenate([by, Jb], axis=-1)


def _air_rows(
    problem: PathProblem, c: np.ndarray, square: np.ndarray, h: np.ndarray, sensor: Sensor
) -> dict[str, tuple[np.ndarray, ...]]:
    """Return per channel its value without errors and the derivatives by V^2, height, temperature,
    ``p_reference`` and k.
    """
    temperature, none = sensor.extra["temperature"], np.zeros(len(square))
    k = problem.constants.get(c, "static_error")
    q, p, by = impact_and_static(problem, square, h, c, temperature, sensor.extra["reference"])
    T = temperature - problem.constants.get(c, "bias.temperature")
    V, a = np.sqrt(np.maximum(square, 1.0)), np.sqrt(GAMMA * R_AIR * T)
    ratio = 1.0 + np.maximum(q, 1e-3) / P_SEA
    V_cas = A_SEA * np.sqrt(5.0 * (ratio ** (2.0 / 7.0) - 1.0))
    by_q = 5.0 / 7.0 * A_SEA**2 * ratio ** (-5.0 / 7.0) / (P_SEA * V_cas)
    return {
        "q_c": ((1.0 - k) * q, *((1.0 - k) * dq for dq, _ in by), -q),
        "p_static": (p + k * q, *(dp + k * dq for dq, dp in by), q),
        "V": (V, 0.5 / V, none, none, none, none),
        "mach": (V / a, 0.5 / (V * a), none, -0.5 * V / (a * T), none, none),
        "V_cas": (V_cas, *(by_q * dq for dq, _ in by), none),
    }


def airspeed_squared(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, arm: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the square of the airspeed at a place of the aeroplane and its derivative by state and
    body rates.

    Parameters
    ----------
    x : array (M, states + 3)
        State and body rates.
    arm : array (3,), optional
        Place from the c.g.; the c.g. itself without it. [m]

    Returns
    -------
    square : array (M,)
        |R'(v - wind) + omega x arm|^2 [m2 s-2]
    derivative : array (M, states + 3)
        Gusts are left out.
    """
    air, D = x[:, VELOCITY] - wind_velocity(problem, x, c), np.zeros((len(x), problem.states + 3))
    if arm is None:
        D[:, VELOCITY] = 2.0 * air
        return (air**2).sum(axis=1), D
    U, turn, Rt = ned_to_body(x[:, ATTITUDE], air)
    local = U + np.cross(x[:, problem.states :], arm)
    double = 2.0 * local[:, None, :]
    D[:, ATTITUDE], D[:, VELOCITY], D[:, problem.states :] = (
        (double @ turn)[:, 0],
        (double @ Rt)[:, 0],
        (double @ -cross_product_matrix(arm))[:, 0],
    )
    return (local**2).sum(axis=1), D


def impact_and_static(
    problem: PathProblem,
    square: np.ndarray,
    h: np.ndarray,
    c: np.ndarray,
    temperature: np.ndarray,
    reference: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Return true impact and static pressure and the derivatives of both.

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
    T, level, X, base, left, ratio, p = _air(problem, square, h, c, temperature, reference)
    strong = base * base * np.sqrt(base)  # power 2.5
    F, dF = base * strong - 1.0, 0.7 * strong
    dp_h = -p * problem.g / (R_AIR * level * left)
    dp_T = p * problem.g * (h - reference[0]) / (R_AIR * level**2 * left)
    dq = p * dF / (GAMMA * R_AIR * T)
    return (
        p * F,
        p,
        [
            (dq, np.zeros_like(dq)),
            (F * dp_h, dp_h),
            (F * dp_T - p * dF * X / T, dp_T),
            (F * ratio, ratio),
        ],
    )


def impact_static_pressures(
    problem: PathProblem, square, h, c, temperature, reference
) -> tuple[np.ndarray, np.ndarray]:
    """Return true impact and static pressure alone; arguments as `impact_and_static`."""
    *_, base, _, _, p = _air(problem, square, h, c, temperature, reference)
    return p * (base * base * base * np.sqrt(base) - 1.0), p


def _air(problem: PathProblem, square, h, c, temperature, reference) -> tuple[np.ndarray, ...]:
    """Return T, temperature at the reference height, Mach number squared, T_0/T of it, T/T of the
    reference, p/p of it, and p.
    """
    warm = problem.constants.get(c, "bias.temperature")
    T, level = temperature - warm, reference[1] - warm
    X = square / (GAMMA * R_AIR * T)
    left = 1.0 - LAPSE * (h - reference[0]) / level
    ratio = left ** (problem.g / (R_AIR * LAPSE))
    return T, level, X, 1.0 + 0.2 * X, left, ratio, problem.constants.get(c, "p_reference") * ratio


def _show_gust(
    problem: PathProblem, x: np.ndarray, name: str, y: np.ndarray, J: np.ndarray
) -> None:
    """Add in place what the gusts do to a reading, where the state holds just that."""
    if problem.shown and problem.gust is not None and name in SEES_GUSTS:
        at = problem.gusts.start + SEES_GUSTS[name]
        y += x[:, at]
        J[:, at] = 1.0


def no_sideslip(sensor: Sensor, problem: PathProblem, x: np.ndarray, c: np.ndarray):
    """Show the air-relative velocity along body y: without a sideslip vane it is held near zero."""
    U, turn, Rt = ned_to_body(x[:, :3], x[:, 3:6] - wind_velocity(problem, x, c))
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, :3], J[:, 0, 3:6] = turn[:, 1], Rt[:, 1]
    return U[:, 1:2], J, (), np.zeros((len(x), 1, 0))


def _with_bias(
    sensor: Sensor, problem: PathProblem, y: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Add the biases of the channels that have one; return also their names and the derivative by
    them (M, m, names).
    """
    biased = [i for i, name in enumerate(sensor.names) if f"bias.{name}" in problem.constants]
    names = tuple(f"bias.{sensor.names[i]}" for i in biased)
    Jc = np.zeros((*y.shape, len(biased)))
    Jc[:, biased, np.arange(len(biased))] = 1.0
    y = y.copy()
    y[:, biased] += c[problem.constants.index(*names)]
    return y, names, Jc
