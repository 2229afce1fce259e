"""Variable projection: least squares over a few nonlinear parameters, the linear ones found on the
way.

For given nonlinear parameters s the coefficients are c = A(s)^+ z, and the residual is r(s) = (I -
A A^+) z.  Its exact derivative [Golub1973], with A_m the derivative of A by s_m,

    dr/ds_m = - (I - A A^+) A_m c - (A^+)' A_m' r

([Kaufman1975] leaves out the second part), gives Gauss and Newton's step in the nonlinear
parameters alone, damped after Levenberg and Marquardt; a parameter that is pushed against a bound
stays there.  It is the combined Gauss-Newton / linear regression of [LR743] 4.5.1.  Where a term is
small its shape is hardly determined and these steps become slow: the last ones are Newton's, with
second derivatives as differences of the exact gradient.

References
----------
.. [Golub1973] Golub, Pereyra, SIAM J. Numer. Anal. 10, 1973.
.. [Kaufman1975] Kaufman, BIT 15, 1975.
.. [LR743] Report LR-743, 1993, section 4.5.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError, OutOfRange

STARTS = 5  # values between the bounds from which the search starts
_STEPS = 100
# decrease of the cost, relative, with which Gauss and Newton's steps end and Newton's begin
_ENOUGH = 1e-6
_SETTLED = 1e-13  # gradient over the lengths of residual and derivative
_HIDDEN = 1e-12  # change of the cost, relative, that may be rounding
_DIFFERENCE = 1e-5  # step of the second derivatives, of the range of a parameter
# smallest diagonal of R of scaled regressors: below, the coefficients of these shapes are not
# determined
_RANK = 1e-10


class LinearBlock(NamedTuple):
    """One linear least-squares problem: z (rows,), A (rows, n), and what its columns change with
    the parameters.

    ``slopes`` holds (parameter, column, derivative of the column (rows,)).
    """

    z: np.ndarray
    A: np.ndarray
    slopes: Sequence[tuple[int, int, np.ndarray]]


class Projection(NamedTuple):
    """The residual after the linear coefficients are found.

    Attributes
    ----------
    cost : float
        Sum of squares of `residual`.
    residual : array (rows,)
        Of all blocks, one after the other.
    jacobian : array (rows, m)
        Exact derivative of `residual`.
    coefficients : tuple of array (n,)
        Per block.
    """

    cost: float
    residual: np.ndarray
    jacobian: np.ndarray
    coefficients: tuple[np.ndarray, ...]


Blocks = Callable[[np.ndarray], Sequence[LinearBlock]]


def project_blocks(
    blocks: Sequence[LinearBlock],
    parameters: int,
    fixed: tuple[np.ndarray, np.ndarray] | None = None,
) -> Projection | None:
    """Return the projection, or None where the coefficients are not determined.

    Parameters
    ----------
    blocks : sequence of Block
    parameters : int
        Number m of nonlinear parameters.
    fixed : (residual (m,), jacobian (m, m)), optional
        Further rows that the nonlinear parameters alone determine: a prior.
    """
    residuals, jacobians, coefficients = [], [], []
    for z, A, slopes in blocks:
        length = np.linalg.norm(A, axis=0)
        if not (np.isfinite(length).all() and length.all()):
            return None
        Q, R = np.linalg.qr(A / length)
        if np.abs(np.diag(R)).min() < _RANK:
            return None
        c = np.linalg.solve(R, Q.T @ z) / length
        r = z - A @ c
        r -= Q @ (Q.T @ r)  # a second time, against rounding
        D, turned = np.zeros((len(z), parameters)), np.zeros((parameters, len(c)))
        for m, j, slope in slopes:
            D[:, m] += slope * c[j]
            turned[m, j] += slope @ r / length[j]
        J = Q @ (Q.T @ D - np.linalg.solve(R.T, turned.T)) - D
        residuals.append(r)
        jacobians.append(J)
        coefficients.append(c)
    if fixed is not None:
        residuals.append(fixed[0])
        jacobians.append(fixed[1])
    r, J = np.concatenate(residuals), np.concatenate(jacobians)
    cost = float(r @ r)
    return (
        Projection(cost, r, J, tuple(coefficients))
        if np.isfinite(cost) and np.isfinite(J).all()
        else None
    )


def minimise_projection(
    evaluate: Callable[[np.ndarray], Projection | None],
    low: np.ndarray,
    high: np.ndarray,
    starts: np.ndarray,
) -> np.ndarray:
    """Return the nonlinear parameters of the least cost between bounds.

    Parameters
    ----------
    evaluate : callable
        Projection at parameters (m,), or None where there is none.
    low, high : array (m,)
    starts : array (starts, m)
        First values; the search goes on from the best, and from there along each parameter alone.

    Raises
    ------
    IdentificationError
        Nowhere a projection.
    """
    best: _SearchPoint | None = None
    for start in starts:
        best = _better(best, _descended(evaluate, low, high, np.clip(start, low, high)))
    if best is None:
        raise IdentificationError(
            "the coefficients are not determined at any start; leave out a term, narrow the "
            "bounds, or give a start"
        )
    for trial in _valleys(evaluate, best, low, high) if len(starts) > 1 else ():
        best = _better(best, _descended(evaluate, low, high, trial)) or best
    return _polished(evaluate, low, high, best.s)


def _valleys(evaluate, best: _SearchPoint, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Starts that differ from a solution in one parameter, where the cost along it has another
    valley.
    """
    found = []
    for m in range(len(low)):
        line = np.sort(np.append(_between(low[m], high[m]), best.s[m]))
        points = [np.where(np.arange(len(low)) == m, value, best.s) for value in line]
        tried = [_tried(evaluate, point) for point in points]
        cost = np.array([np.inf, *(np.inf if one is None else one.cost for one in tried), np.inf])
        lowest = (cost[1:-1] < cost[:-2]) & (cost[1:-1] <= cost[2:]) & (line != best.s[m])
        found += [point for point, is_lowest in zip(points, lowest) if is_lowest]
    return found


def spread_starts(low: np.ndarray, high: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Return starts (starts, m): all parameters at the same place between their bounds; those with
    a value in `given` there.
    """
    grid = np.array([_between(a, b) for a, b in zip(low, high)]).T
    return np.where(np.isnan(given), grid, given) if np.isnan(given).any() else given[None, :]


def _between(low: float, high: float) -> np.ndarray:
    return low + (high - low) * (np.arange(STARTS) + 0.5) / STARTS


class _SearchPoint(NamedTuple):
    cost: float
    s: np.ndarray


def _better(best: _SearchPoint | None, found: _SearchPoint | None) -> _SearchPoint | None:
    """The second only where it is clearly better, so that equal minima are not exchanged."""
    if found is None or (best is not None and found.cost > best.cost * (1.0 - 1e-6)):
        return best
    return found


def _descended(evaluate, low: np.ndarray, high: np.ndarray, s: np.ndarray) -> _SearchPoint | None:
    """Levenberg and Marquardt from one start: the least cost, nearly, and where."""
    now = _tried(evaluate, s)
    if now is None:
        return None
    damping = 1e-3
    for _ in range(_STEPS):
        gradient, free, length = _slope(now, s, low, high)
        if not free.any():
            break
        J = now.jacobian[:, free] / length[free]
        new = _stepped(s, J.T @ J + damping * np.eye(J.shape[1]), gradient, free, length, low, high)
        then = _tried(evaluate, new)
        if then is None or then.cost > now.cost:
            damping *= 10.0
            if damping > 1e12:
                break
            continue
        gain = now.cost - then.cost
        s, now, damping = new, then, max(damping / 10.0, 1e-14)
        if gain <= _ENOUGH * now.cost:
            break
    return _SearchPoint(now.cost, s)


def _polished(evaluate, low: np.ndarray, high: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Newton's steps to the minimum, damped until they go downhill."""
    now = evaluate(s)
    for _ in range(_STEPS):
        gradient, free, length = _slope(now, s, low, high)
        if (np.abs(gradient[free]) <= _SETTLED * length[free] * np.sqrt(now.cost)).all():
            break
        H = _curvature(evaluate, s, gradient, free, low, high) / np.outer(
            length[free], length[free]
        )
        values, vectors = np.linalg.eigh(H)
        H = vectors * np.maximum(np.abs(values), 1e-10) @ vectors.T
        for damping in (0.0, *10.0 ** np.arange(-6.0, 7.0)):
            new = _stepped(s, H + damping * np.eye(len(H)), gradient, free, length, low, high)
            then = _tried(evaluate, new)
            if then is not None and _onward(now, then, s, new, low, high):
                break
        else:
            break
        s, now = new, then
    return s


def _onward(now: Projection, then: Projection, s, new, low, high) -> bool:
    """Whether a step led on: downhill, or where rounding hides the descent, to a gradient less than
    half as large.
    """
    if abs(then.cost - now.cost) > _HIDDEN * now.cost:
        return then.cost < now.cost
    sizes = []
    for one, place in ((now, s), (then, new)):
        gradient, free, length = _slope(one, place, low, high)
        sizes.append(float(np.abs(gradient[free] / length[free]).max(initial=0.0)))
    return sizes[1] < 0.5 * sizes[0]


def _slope(
    now: Projection, s: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gradient of half the cost, the parameters that no bound holds, and the lengths of the
    derivatives.
    """
    gradient, length = now.jacobian.T @ now.residual, np.linalg.norm(now.jacobian, axis=0)
    held = ((s <= low) & (gradient > 0)) | ((s >= high) & (gradient < 0)) | (length == 0.0)
    return gradient, ~held, length


def _stepped(s, H: np.ndarray, gradient, free, length, low, high) -> np.ndarray:
    """The parameters after one step, within their bounds; `H` is scaled by the lengths."""
    step = np.zeros_like(s)
    step[free] = -np.linalg.solve(H, gradient[free] / length[free]) / length[free]
    return np.clip(s + step, low, high)


def _curvature(
    evaluate,
    s: np.ndarray,
    gradient: np.ndarray,
    free: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Second derivatives of half the cost by the free parameters, as differences of the exact
    gradient.
    """
    places = np.flatnonzero(free)
    H = np.empty((len(places), len(places)))
    for k, m in enumerate(places):
        moved = s.copy()
        moved[m] += (
            _DIFFERENCE * (high[m] - low[m]) * (1.0 if s[m] < 0.5 * (low[m] + high[m]) else -1.0)
        )
        there = evaluate(moved)
        if there is None:
            raise IdentificationError(
                "the coefficients are not determined together with the best shapes; leave "
                "out a term or narrow the bounds"
            )
        H[:, k] = ((there.jacobian.T @ there.residual - gradient) / (moved[m] - s[m]))[places]
    return 0.5 * (H + H.T)


def _tried(evaluate, s: np.ndarray) -> Projection | None:
    try:
        return evaluate(s)
    except OutOfRange:
        return None
