"""Standard errors of a batch fit: Cramer-Rao, and corrected for residuals that are correlated in time and for a noisy inertial unit.

The fit takes the readings for the only random thing.  Two facts make its Cramer-Rao bounds too small:

- residuals are correlated in time: their own autocorrelation replaces the white one;
- the gyros and accelerometers that drive the path are noisy too, and their noise is summed up to a wandering path.
  What it does to the estimate follows from the noise of the specification, by the adjoint of the sensitivity equations:
  one backward running sum per unknown.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve

from ...dynamics.kinematics import rate_matrix, rotation, skew
from ..problem.normal_equations import add_at
from ..problem.problem import ATTITUDE, HEIGHT, VELOCITY, Problem, specific_force
from ..problem.trajectory import vane_geometry
from .normal_equations import Equations, Seen
from .path_sensitivities import segments

WINDOW = 0.1  # lag window over the length of a segment


def covariances(equations: Equations) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected and the white (Cramer-Rao) covariance of all unknowns; zero for those not estimated.

    Notes
    -----
    ::

        D = (S' R^-1 S + P0^-1)^-1
        corrected = D [P0^-1 + sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j + sum_i T_i' Q T_i] D

    Rvv: biased autocorrelation of the residuals of each channel with Bartlett's taper over a tenth of the segment; T_i:
    gradient by the noise of the inertial unit at sample i, Q its variance.  Where the autocorrelation makes a variance
    smaller than white residuals would (it is itself estimated), the white one stays.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [MaineIliff] Maine, Iliff, NASA RP-1138, 1985.
    """
    layout = equations.layout
    move = np.ix_(layout.moving, layout.moving)
    D = np.zeros_like(equations.normal)
    scale = 1.0 / np.sqrt(np.diag(equations.normal[move]))
    D[move] = np.linalg.inv(equations.normal[move] * np.outer(scale, scale)) * np.outer(scale, scale)
    rest = inertial(equations)
    floor = np.diag(D) + np.diag(D @ rest @ D)
    nc = len(layout.names)
    rest[:nc, :nc] += layout.prior_information()
    for run, setup in enumerate(layout.setups):
        places = layout.start_places(run)
        rest[places, places] += 1.0 / setup.problem.start_sigma**2
    corrected = D @ (coloured(equations) + rest) @ D
    short = np.sqrt(np.maximum(floor / np.maximum(np.diag(corrected), 1e-300), 1.0))
    corrected *= np.outer(short, short)
    return (corrected + corrected.T) / 2.0, D


def coloured(equations: Equations) -> np.ndarray:
    """Return sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j."""
    inner = np.zeros_like(equations.normal)
    for _, places, rows, item in equations.by_segment():
        for j, name in enumerate(item.names):
            S, r = item.A[rows][:, j] / equations.sigma[name], item.r[rows][:, j] / equations.sigma[name]
            used = np.flatnonzero(np.abs(S).max(axis=0) > 0.0)
            S = S[:, used]
            spread = fftconvolve(S, tapered(r)[:, None], mode="same", axes=0)
            at = places[used]
            inner[np.ix_(at, at)] += S.T @ spread
    return (inner + inner.T) / 2.0


def tapered(r: np.ndarray) -> np.ndarray:
    """Return the biased autocorrelation at lags -(N-1) ... N-1, Bartlett's taper over a tenth of the record."""
    N = len(r)
    window = max(1, round(WINDOW * N))
    size = 1 << int(2 * N - 1).bit_length()
    right = np.fft.irfft(np.abs(np.fft.rfft(r, size)) ** 2, size)[:window] / N * (1.0 - np.arange(window) / window)
    both = np.zeros(2 * N - 1)
    both[N - window : N + window - 1] = np.concatenate([right[:0:-1], right])
    return both


def inertial(equations: Equations) -> np.ndarray:
    """Return sum_i T_i' Q T_i, what the noise of gyros and accelerometers adds to the covariance of the gradient."""
    layout = equations.layout
    inner = np.zeros_like(equations.normal)
    for run, setup in enumerate(layout.setups):
        problem, swept = setup.problem, equations.sweeps[run]
        c = equations.at.c[layout.places[run]]
        b = _pressed(problem, swept.x, c, equations.seen[run], equations.sigma)
        force = (rotation(swept.x[:, ATTITUDE]) @ specific_force(problem, c)[..., None])[..., 0]
        for places, part in zip(layout.start_places(run), segments(problem), strict=True):
            at = np.append(places, layout.places[run])
            T = _adjoint(problem, swept.x[part], force[part], b[part]) * problem.noise[:, None]
            flat = T.reshape(-1, len(at))
            inner[np.ix_(at, at)] += flat.T @ flat
    return inner


def _pressed(problem: Problem, x: np.ndarray, c: np.ndarray, items: list[Seen], sigma: dict[str, float]) -> np.ndarray:
    """Return per sample the derivative of the gradient by the state (N, 7, unknowns): sum of J' R^-1 A over its readings.

    Vanes act through the angle at the same instant: their lag is short against everything that the noise sums up to.
    """
    _, by_state, _ = vane_geometry(problem, x, c)
    b = np.zeros((len(x), problem.states, items[0].A.shape[2]))
    for item in items:
        w = 1.0 / np.array([sigma[name] for name in item.names]) ** 2
        add = np.swapaxes(item.J * w[:, None], 1, 2) @ item.A
        add_at(b, item.k, (1.0 - item.f)[:, None, None] * add)
        later = item.f > 0.0
        if later.any():
            add_at(b, item.k[later] + 1, item.f[later, None, None] * add[later])
    out = b[:, :7].copy()
    for i in range(len(problem.vanes)):
        out += by_state[:, i, :7, None] * b[:, 7 + i, None]
    return out


def _adjoint(problem: Problem, x: np.ndarray, force: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the derivative of the gradient by the noise of each sample (N, 6, unknowns)."""
    dt = problem.dt
    R = rotation(x[:, ATTITUDE])
    height = _later(b[:, HEIGHT])
    speed = b[:, VELOCITY].copy()
    speed[:-1, 2] -= dt * height[1:]
    speed = _later(speed)
    by_turn = R @ np.swapaxes(np.linalg.inv(rate_matrix(x[:, ATTITUDE])), 1, 2) @ b[:, ATTITUDE]
    by_turn[:-1] += dt * (skew(force[:-1]) @ speed[1:])
    turn = _later(by_turn)
    Rt = np.swapaxes(R, 1, 2)
    return dt * np.concatenate([Rt @ turn, Rt @ speed], axis=1)


def _later(values: np.ndarray) -> np.ndarray:
    """Return the sum of each sample and all after it."""
    return np.cumsum(values[::-1], axis=0)[::-1]
