"""Output equations: what each sensor shows for a given state and given constants, with derivatives.

A `Sensor` is a group of channels that share clock and latency.  Its `model` takes states at the instants of the
readings and returns outputs (M, m), their derivative by state (M, m, n), the names of the constants involved, and the
derivative by these (M, m, names).
"""

from __future__ import annotations

import numpy as np

from flightmech.air import GAMMA, R_AIR

from .kinematics import to_body
from .problem import Problem, Sensor, wind

LAPSE = 0.0065  # K/m, inside one run; the level is measured


def pick(sensor: Sensor, problem: Problem, x: np.ndarray, c: np.ndarray):
    """Show single state variables, each with a bias when there is a constant ``bias.<channel>``."""
    places = sensor.extra["places"]
    y = x[:, places]
    J = np.zeros((len(x), len(places), problem.states))
    J[:, np.arange(len(places)), places] = 1.0
    return _with_bias(sensor, problem, y, J, c)


def vanes(sensor: Sensor, problem: Problem, x: np.ndarray, c: np.ndarray):
    """Show K times the lagged angle plus an offset."""
    places = np.array([7 + problem.vanes.index(name) for name in sensor.names])
    factors = tuple(f"factor.{name}" for name in sensor.names)
    K = c[problem.constants.index(*factors)]
    J = np.zeros((len(x), len(places), problem.states))
    J[:, np.arange(len(places)), places] = K
    Jc = np.zeros((len(x), len(places), len(places)))
    Jc[:, np.arange(len(places)), np.arange(len(places))] = x[:, places]
    y = K * x[:, places]
    for i, name in enumerate(sensor.names):
        _show_gust(problem, x, name, y[:, i], J[:, i])
    y, J, names, Jb = _with_bias(sensor, problem, y, J, c)
    return y, J, (*factors, *names), np.concatenate([Jc, Jb], axis=-1)


def radio(sensor: Sensor, problem: Problem, x: np.ndarray, c: np.ndarray):
    """Show the height of the antenna over the runway."""
    (sf, st, _), (cf, ct, _) = np.sin(x[:, :3]).T, np.cos(x[:, :3]).T
    a, b, d = sensor.extra["arm"]
    below = -st * a + sf * ct * b + cf * ct * d  # third row of the rotation
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, 0] = -(cf * ct * b - sf * ct * d)
    J[:, 0, 1] = ct * a + sf * st * b + cf * st * d
    J[:, 0, 6] = 1.0
    return _with_bias(sensor, problem, (x[:, 6] - sensor.extra["elevation"] - below)[:, None], J, c)


def pressures(sensor: Sensor, problem: Problem, x: np.ndarray, c: np.ndarray):
    """Show impact and static pressure with a position error k: q_c (1 - k) + bias, p + k q_c.

    Total pressure is taken as exact, so both readings share k.  Static pressure follows the height hydrostatically from
    ``p_reference`` at the reference height, with the measured temperature.
    """
    q, p, by = impact_and_static(problem, x, c, sensor.extra["temperature"], sensor.extra["reference"])
    k = problem.constants.get(c, "static_error")
    rows = {
        "q_c": ((1.0 - k) * q, [(1.0 - k) * d for d, _ in by], -q),
        "p_static": (p + k * q, [dp + k * dq for dq, dp in by], q),
    }
    y = np.stack([rows[name][0] for name in sensor.names], axis=1)
    J = np.zeros((len(x), len(sensor.names), problem.states))
    Jc = np.zeros((len(x), len(sensor.names), 6))
    for i, name in enumerate(sensor.names):
        _, (d_speed, d_h, d_temperature, d_reference), d_k = rows[name]
        J[:, i, 3:6] = d_speed
        J[:, i, 6] = d_h
        if problem.gust is not None and not problem.shown:
            J[:, i, problem.gusts] = -d_speed
        _show_gust(problem, x, name, y[:, i], J[:, i])
        Jc[:, i, :3], Jc[:, i, 3], Jc[:, i, 4], Jc[:, i, 5] = -d_speed, -d_temperature, d_reference, d_k
    names = ("wind_n", "wind_e", "wind_d", "bias.temperature", "p_reference", "static_error")
    used = [i for i, name in enumerate(names) if name in problem.constants]
    y, J, bias, Jb = _with_bias(sensor, problem, y, J, c)
    return y, J, (*(names[i] for i in used), *bias), np.concatenate([Jc[..., used], Jb], axis=-1)


def impact_and_static(problem: Problem, x: np.ndarray, c: np.ndarray, temperature: np.ndarray, reference: tuple[float, float]):
    """Return true impact and static pressure and the derivatives of both.

    Parameters
    ----------
    temperature : array (M,)
        Air temperature as measured. [K]
    reference : (float, float)
        Reference height and the measured temperature there. [m], [K]

    Returns
    -------
    q, p : array (M,)
        [Pa]
    derivatives : list of (dq, dp)
        By air-relative velocity (M, 3), by height, by temperature, by ``p_reference``.
    """
    warm = problem.constants.get(c, "bias.temperature")
    T, level = temperature - warm, reference[1] - warm
    air = x[:, 3:6] - wind(problem, x, c)
    X = (air**2).sum(axis=1) / (GAMMA * R_AIR * T)
    F, dF = (1.0 + 0.2 * X) ** 3.5 - 1.0, 0.7 * (1.0 + 0.2 * X) ** 2.5
    p_ref = problem.constants.get(c, "p_reference")
    rise = x[:, 6] - reference[0]
    left = 1.0 - LAPSE * rise / level
    ratio = left ** (problem.g / (R_AIR * LAPSE))
    p = p_ref * ratio
    dp_h = -p * problem.g / (R_AIR * level * left)
    dp_T = p * problem.g * rise / (R_AIR * level**2 * left)
    dq_V = (p * dF * 2.0 / (GAMMA * R_AIR * T))[:, None] * air
    return p * F, p, [(dq_V, np.zeros_like(dq_V)), (F * dp_h, dp_h), (F * dp_T - p * dF * X / T, dp_T), (F * ratio, ratio)]


def _show_gust(problem: Problem, x: np.ndarray, name: str, y: np.ndarray, J: np.ndarray) -> None:
    """Add in place what the gusts do to a reading, where the state holds just that."""
    places = {"alpha_vane": 0, "beta_vane": 1, "q_c": 2}
    if problem.shown and problem.gust is not None and name in places:
        at = problem.gusts.start + places[name]
        y += x[:, at]
        J[:, at] = 1.0


def no_sideslip(sensor: Sensor, problem: Problem, x: np.ndarray, c: np.ndarray):
    """Show the air-relative velocity along body y: without a sideslip vane it is held near zero."""
    U, turn, Rt = to_body(x[:, :3], x[:, 3:6] - wind(problem, x, c))
    J = np.zeros((len(x), 1, problem.states))
    J[:, 0, :3], J[:, 0, 3:6] = turn[:, 1], Rt[:, 1]
    return U[:, 1:2], J, (), np.zeros((len(x), 1, 0))


def _with_bias(sensor: Sensor, problem: Problem, y: np.ndarray, J: np.ndarray, c: np.ndarray):
    """Add the biases of the channels that have one."""
    biased = [i for i, name in enumerate(sensor.names) if f"bias.{name}" in problem.constants]
    names = tuple(f"bias.{sensor.names[i]}" for i in biased)
    Jc = np.zeros((*y.shape, len(biased)))
    Jc[:, biased, np.arange(len(biased))] = 1.0
    y = y.copy()
    y[:, biased] += c[problem.constants.index(*names)]
    return y, J, names, Jc
