"""The flight path that follows from its start, the constants and the recorded rates and accelerations, with exact sensitivities.

In level axes the kinematics are sums: attitudes are products of the turns between samples, velocity and height are sums
over them.  A small change of attitude, written as a turn delta about the level axes, obeys::

    delta' = -R (change of rates),    delta_v' = delta x R a + R (change of a),    delta_h' = -delta_v_down

so the sensitivity equations are running sums as well, and a whole record is integrated without a loop over its samples.
What depends on the path only weakly (Coriolis acceleration, turning of the level axes, fall of gravity with height) is
taken from the path before, and settles with the iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import lfilter

from ...dynamics.kinematics import rate_matrix, rotation, skew
from ...signals.first_order_lag import lag_weights
from ..problem.problem import ATTITUDE, HEIGHT, VELOCITY, Problem, bend, body_rates, over_steps, specific_force
from ..problem.trajectory import input_derivatives, vane_behind, vane_geometry


@dataclass(frozen=True)
class Sweep:
    """A path and its sensitivities.

    Attributes
    ----------
    x : array (N, n)
        States, as in `Problem`.
    X : array (N, n, n + driving)
        Derivative by the start of the segment that the sample belongs to, then by the driving constants.
    columns : array (driving,)
        Places of the driving constants among all constants.
    """

    x: np.ndarray
    X: np.ndarray
    columns: np.ndarray


def segments(problem: Problem) -> list[slice]:
    """Return the samples of each window."""
    edges = [*problem.starts.tolist(), len(problem.time)]
    return [slice(a, b) for a, b in pairwise(edges)]


def weak_terms(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what depends on the path only weakly.

    Returns
    -------
    turning : array (N, 3)
        Rate of the level axes, in body axes. [rad s-1]
    pull : array (N, 3)
        Gravity and Coriolis acceleration, north-east-down. [m s-2]
    """
    spin, transport = problem.earth
    v = x[:, VELOCITY]
    carried = v @ transport.T
    pull = -np.cross(2.0 * spin + carried, v)
    pull[:, 2] += problem.gravity_at(x[:, HEIGHT])
    turning = (np.swapaxes(rotation(x[:, ATTITUDE]), 1, 2) @ (carried + problem.gyro_spin)[..., None])[..., 0]
    return turning, pull


def path_of(problem: Problem, starts: np.ndarray, c: np.ndarray, weak: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the states that follow from the starts of the segments (segments, n) and the constants (nc,); see `weak_terms`."""
    return _run(problem, starts, c, weak)[0]


def sweep(problem: Problem, starts: np.ndarray, c: np.ndarray, weak: tuple[np.ndarray, np.ndarray]) -> Sweep:
    """Return states and sensitivities; arguments as `path_of`.

    Notes
    -----
    Rates and accelerations are cubics between samples, attitude takes the fourth-order Magnus step, velocity Simpson's rule over
    it; height and sensitivities the trapezoidal rule (1e-5 of their size at 50 Hz).  Straight lines between samples would
    take (omega dt)^2/12 off what oscillates with omega: 1e-3 at 0.9 Hz and 50 samples per second, found again in the vane factors.
    """
    x, R, turn, force, vanes = _run(problem, starts, c, weak)
    places, D = input_derivatives(problem, c)
    names = [name for name in ("wind_n", "wind_e", "wind_d") if name in problem.constants] + (["lag.vanes"] if problem.vanes else [])
    columns = np.append(places, problem.constants.index(*names))
    n, driving = problem.states, len(columns)
    X = np.zeros((len(x), n, n + driving))
    for part in segments(problem):
        _sensitivities(problem, part, x, R, turn, force, D, X)
    if problem.vanes:
        _lagged_sensitivities(problem, x, c, columns, X, vanes)
    return Sweep(x, X, columns)


def chained(J: np.ndarray, X: np.ndarray, k: np.ndarray | None = None, f: np.ndarray | None = None) -> np.ndarray:
    """Return J (M, m, states) times X (N, states, unknowns) at the samples k + f, all samples without them (M, m, unknowns).

    State by state: most of J is zero, and many products of small matrices cost more than few of long vectors.
    """
    out = np.zeros((*J.shape[:2], X.shape[2]))
    involved = np.asarray(J.any(axis=0))
    for s in np.flatnonzero(involved.any(axis=0)):
        at = X[:, s] if k is None else X[k, s]
        if k is not None and f is not None and f.any():
            at += f[:, None] * (X[np.minimum(k + 1, len(X) - 1), s] - at)
        for j in np.flatnonzero(involved[:, s]):
            out[:, j] += J[:, j, s, None] * at
    return out


def _run(problem: Problem, starts, c, weak) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Return states, rotations, turns between samples, specific force in level axes, and `vane_geometry`, if there are vanes."""
    turning, pull = weak
    omega, a = body_rates(problem, c) - turning, specific_force(problem, c)
    dt = problem.dt
    turn = dt * over_steps(problem, omega) + dt**2 / 12.0 * np.cross(omega[:-1], omega[1:])
    halfway = (a[:-1] + a[1:]) / 2.0 - bend(problem, a) / 8.0
    x = np.zeros((len(problem.time), problem.states))
    R = np.zeros((len(x), 3, 3))
    for start, part in zip(starts, segments(problem), strict=True):
        inner = slice(part.start, part.stop - 1)
        first = rotation(start[None, ATTITUDE])[0]
        R[part] = first @ _matrices(_products(_quaternions(turn[inner])))
        x[part, ATTITUDE] = _angles(R[part], start[2])
        at = (R[part] @ a[part, :, None])[..., 0]
        half = R[inner] @ _matrices(_quaternions(turn[inner] / 2.0 - dt / 8.0 * (omega[part][1:] - omega[inner])))
        middle = (half @ halfway[inner][..., None])[..., 0]
        gain = dt / 6.0 * (at[:-1] + 4.0 * middle + at[1:]) + dt / 2.0 * (pull[inner] + pull[part][1:])
        x[part, VELOCITY] = start[VELOCITY] + _summed(gain)
        down = x[part, 5]
        x[part, HEIGHT] = start[HEIGHT] - _summed(dt / 2.0 * (down[:-1] + down[1:]))
    vanes: tuple[np.ndarray, ...] = ()
    if problem.vanes:
        vanes = vane_geometry(problem, x, c)
        angle, tau = vanes[0], problem.constants.get(c, "lag.vanes")
        for start, part in zip(starts, segments(problem), strict=True):
            (E, c0, c1), _ = lag_weights(tau, dt)
            x[part, 7:] = _recursion(E, c0 * angle[part][:-1] + c1 * angle[part][1:], start[7 : 7 + len(problem.vanes)])
    return x, R, turn, (R @ a[..., None])[..., 0], vanes


def _sensitivities(problem: Problem, part: slice, x, R, turn, force, D, X) -> None:
    """Fill the sensitivities of attitude, velocity and height over one segment."""
    dt, n = problem.dt, problem.states
    R, force, D, x, turn = R[part], force[part], D[part], x[part], turn[part.start : part.stop - 1]
    turning = np.flatnonzero(D[:, :3].any(axis=(0, 1)))  # inputs that turn the path: gyros, not accelerometers
    delta = np.zeros((len(x), 3, 3 + len(turning)))
    delta[:, :, :3] = R[0] @ rate_matrix(x[:1, ATTITUDE])[0]
    rate = D[:, :3, turning]
    delta[1:, :, 3:] = np.cumsum(dt * (R[1:] @ _right_jacobian(turn)) @ ((rate[1:] + rate[:-1]) / 2.0), axis=0)
    tilted = np.append(np.arange(3), n + turning)
    X[part, ATTITUDE][:, :, tilted] = _turned_angles(x[:, ATTITUDE], np.swapaxes(R, 1, 2) @ delta)
    slope = np.zeros((len(x), 3, 3 + D.shape[2]))
    slope[:, :, 3:] = R @ D[:, 3:]
    slope[:, :, np.append(np.arange(3), 3 + turning)] += _across(delta, force)
    v = _summed(dt / 2.0 * (slope[1:] + slope[:-1]))
    X[part, VELOCITY, :3], X[part, VELOCITY, n : n + D.shape[2]] = v[:, :, :3], v[:, :, 3:]
    X[part, VELOCITY, VELOCITY] = np.eye(3)
    down = X[part, 5]
    X[part, HEIGHT] = -_summed(dt / 2.0 * (down[1:] + down[:-1]))
    X[part, HEIGHT, HEIGHT] = 1.0


def _turned_angles(attitude: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return what small turns about the body axes (N, 3, m) do to phi, theta, psi: the inverse of the rate matrix."""
    (sf, st, _), (cf, ct, _) = np.sin(attitude).T[..., None], np.cos(attitude).T[..., None]
    by_psi = (sf * turn[:, 1] + cf * turn[:, 2]) / ct
    return np.stack([turn[:, 0] + st * by_psi, cf * turn[:, 1] - sf * turn[:, 2], by_psi], axis=1)


def _across(delta: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return delta x force for each column of delta (N, 3, m)."""
    (a, b, c), (x, y, z) = np.moveaxis(delta, 1, 0), force.T[..., None]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _lagged_sensitivities(problem: Problem, x, c, columns, X, vanes) -> None:
    """Fill the sensitivities of the lagged vane angles."""
    n, count = problem.states, len(problem.vanes)
    angle, J, Jw = vanes
    A = chained(J, X)
    where = {int(place): n + j for j, place in enumerate(columns)}
    for i, name in vane_behind(problem).items():
        A[:, :, where[int(problem.constants.index(name)[0])]] += Jw[:, :, i]
    (E, c0, c1), (dE, d0, d1) = lag_weights(problem.constants.get(c, "lag.vanes"), problem.dt)
    for part in segments(problem):
        drive = c0 * A[part][:-1] + c1 * A[part][1:]
        drive[:, :, -1] += dE * x[part, 7:][:-1] + d0 * angle[part][:-1] + d1 * angle[part][1:]
        first = np.zeros((count, A.shape[2]))
        first[np.arange(count), 7 + np.arange(count)] = 1.0
        X[part, 7:] = _recursion(E, drive, first)


def _recursion(E: float, drive: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return y with y_0 = first, y_k+1 = E y_k + drive_k."""
    if E < 1e-8:
        return np.concatenate([first[None], drive])
    return lfilter([1.0], [1.0, -E], np.concatenate([first[None], drive]), axis=0)


def _summed(steps: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])


def _quaternions(turn: np.ndarray) -> np.ndarray:
    """Return the quaternions of rotation vectors (N, 3)."""
    angle = np.linalg.norm(turn, axis=1)[:, None]
    return np.concatenate([np.cos(angle / 2.0), turn * np.sinc(angle / (2.0 * np.pi)) / 2.0], axis=1)


def _products(q: np.ndarray) -> np.ndarray:
    """Return 1, q_0, q_0 q_1, ... (N + 1, 4), by doubling the length of the products."""
    found, reach = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], q]), 1
    while reach < len(found):
        found[reach:] = _times(found[:-reach], found[reach:])
        reach *= 2
    return found / np.linalg.norm(found, axis=1)[:, None]


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (a0, a1, a2, a3), (b0, b1, b2, b3) = a.T, b.T
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=1,
    )


def _matrices(q: np.ndarray) -> np.ndarray:
    s, a, b, c = q.T
    rows = [
        [1 - 2 * (b * b + c * c), 2 * (a * b - s * c), 2 * (a * c + s * b)],
        [2 * (a * b + s * c), 1 - 2 * (a * a + c * c), 2 * (b * c - s * a)],
        [2 * (a * c - s * b), 2 * (b * c + s * a), 1 - 2 * (a * a + b * b)],
    ]
    out = np.empty((len(q), 3, 3))
    for i in range(3):
        for j in range(3):
            out[:, i, j] = rows[i][j]
    return out


def _angles(R: np.ndarray, heading: float) -> np.ndarray:
    """Return phi, theta, psi; psi unwrapped from near `heading`."""
    psi = np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    psi += 2.0 * np.pi * np.round((heading - psi[0]) / (2.0 * np.pi))
    return np.stack([np.arctan2(R[:, 2, 1], R[:, 2, 2]), -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0)), psi], axis=1)


def _right_jacobian(turn: np.ndarray) -> np.ndarray:
    """Return d(turn applied last)/d(rotation vector), to third order."""
    K = skew(turn)
    return np.eye(3) - K / 2.0 + K @ K / 6.0
