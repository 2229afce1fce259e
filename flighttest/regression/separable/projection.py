"""Variable projection: least squares over a few nonlinear parameters.

For given nonlinear parameters s the coefficients are c = A(s)^+ z, and the residual is
r(s) = (I - A A^+) z. Its exact derivative is [Golub1973]_, with A_m the derivative of A by s_m,

    dr/ds_m = - (I - A A^+) A_m c - (A^+)' A_m' r

[Kaufman1975]_ omits the second part. The derivative gives Gauss-Newton steps in the nonlinear
parameters alone, damped after Levenberg and Marquardt. A parameter that the gradient pushes against
a bound stays there. The method is the combined Gauss-Newton / linear regression of [LR743]_ 4.5.1.

If a term is small, the data hardly determine its shape, and Gauss-Newton steps become slow. The
last steps are therefore Newton steps. Their second derivatives are differences of the exact
gradient.

References
----------
.. [Golub1973] Golub, Pereyra, SIAM J. Numer. Anal. 10, 1973.
.. [Kaufman1975] Kaufman, BIT 15, 1975.
.. [LR743] Report LR-743, 1993, section 4.5.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError, OutOfRange

STARTS = 5  # values between the bounds from which the search starts
_STEPS = 100  # of one descent
# relative decrease of the cost that ends the Gauss-Newton steps and starts the Newton steps
_ENOUGH = 1e-6
_CLEARLY = 1e-6  # relative decrease of the cost that makes another minimum the better one
_SETTLED = 1e-13  # gradient over the lengths of residual and derivative, at the minimum
_HIDDEN = 1e-12  # relative change of the cost that may be rounding
_DIFFERENCE = 1e-5  # step of the second derivatives, of the range of a parameter
# smallest diagonal of R of scaled regressors: below, the coefficients are not determined
_RANK = 1e-10
# damping of Levenberg and Marquardt: first value, factor of a change, and limits
_DAMPING, _FACTOR, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 10.0, 1e-14, 1e12
_LEAST_CURVATURE = 1e-10  # of the scaled second derivatives
# damping of the Newton steps: none, and then rising until a step goes downhill
_NEWTON_DAMPING = (0.0, *10.0 ** np.arange(-6.0, 7.0))

_UNDETERMINED_AT_BEST = (
    "the coefficients are not determined together with the best shapes; leave out a term or "
    "narrow the bounds"
)


class LinearBlock(NamedTuple):
    """One linear least-squares problem of given nonlinear parameters.

    Attributes
    ----------
    z : array (rows,)
        Measured quantity.
    A : array (rows, n)
        Regressors.
    slopes : sequence of (parameter, column, array (rows,))
        Derivatives of columns of A by nonlinear parameters; all others are zero.
    """

    z: np.ndarray
    A: np.ndarray
    slopes: Sequence[tuple[int, int, np.ndarray]]


class Projection(NamedTuple):
    """Residual of the linear problems with their best coefficients.

    Attributes
    ----------
    cost : float
        Sum of squares of `residual`.
    residual : array (rows,)
        Residuals of all blocks, one after the other.
    jacobian : array (rows, m)
        Exact derivative of `residual`.
    coefficients : tuple of array (n,)
        Coefficients of each block.
    """

    cost: float
    residual: np.ndarray
    jacobian: np.ndarray
    coefficients: tuple[np.ndarray, ...]


Evaluation = Callable[[np.ndarray], Projection | None]


def project_blocks(
    blocks: Sequence[LinearBlock],
    parameters: int,
    fixed: tuple[np.ndarray, np.ndarray] | None = None,
) -> Projection | None:
    """Return the projection, or None if the coefficients are not determined.

    Parameters
    ----------
    blocks : sequence of LinearBlock
    parameters : int
        Number m of nonlinear parameters.
    fixed : (residual (m,), jacobian (m, m)), optional
        Further rows that depend on the nonlinear parameters alone: a prior.
    """
    residuals, jacobians, coefficients = [], [], []
    for block in blocks:
        part = _project_block(block, parameters)
        if part is None:
            return None
        residuals.append(part[0])
        jacobians.append(part[1])
        coefficients.append(part[2])
    if fixed is not None:
        residuals.append(fixed[0])
        jacobians.append(fixed[1])
    r, J = np.concatenate(residuals), np.concatenate(jacobians)
    cost = float(r @ r)
    if not (np.isfinite(cost) and np.isfinite(J).all()):
        return None
    return Projection(cost, r, jacobian=J, coefficients=tuple(coefficients))


def _project_block(
    block: LinearBlock, parameters: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return residual, its derivative and the coefficients of one block."""
    z, A, slopes = block
    length = np.linalg.norm(A, axis=0)
    if not (np.isfinite(length).all() and length.all()):
        return None
    Q, R = np.linalg.qr(A / length)
    if np.abs(np.diag(R)).min() < _RANK:
        return None
    c = np.linalg.solve(R, Q.T @ z) / length
    r = z - A @ c
    r -= Q @ (Q.T @ r)  # a second projection removes the rounding of the first
    # [Golub1973] with A = QR: dr/ds_m = -(I - QQ') A_m c - Q R^-T A_m' r
    D, transposed = np.zeros((len(z), parameters)), np.zeros((parameters, len(c)))
    for m, j, slope in slopes:
        D[:, m] += slope * c[j]
        transposed[m, j] += slope @ r / length[j]
    J = Q @ (Q.T @ D - np.linalg.solve(R.T, transposed.T)) - D
    return r, J, c


def minimise_projection(
    evaluate: Evaluation,
    low: np.ndarray,
    high: np.ndarray,
    starts: np.ndarray,
) -> np.ndarray:
    """Return the nonlinear parameters of the least cost between bounds.

    Parameters
    ----------
    evaluate : callable
        Projection at parameters (m,), or None where the coefficients are not determined.
    low, high : array (m,)
        Bounds.
    starts : array (starts, m)
        Start values. The search continues from the best minimum, along each parameter alone.

    Raises
    ------
    IdentificationError
        The coefficients are not determined at any start.
    """
    search = _ProjectionSearch(evaluate, low, high)
    best: _Minimum | None = None
    for start in starts:
        best = _better_minimum(best, search.descend(np.clip(start, low, high)))
    if best is None:
        raise IdentificationError(
            "the coefficients are not determined at any start; leave out a term, narrow the "
            "bounds, or give a start"
        )
    if len(starts) > 1:
        for trial in search.other_valleys(best):
            best = _better_minimum(best, search.descend(trial)) or best
    return search.refine(best.s)


def spread_starts(low: np.ndarray, high: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return start values (starts, m), at equal fractions of all ranges.

    Parameters
    ----------
    low, high : array (m,)
        Bounds.
    start : array (m,)
        Start values of single parameters; NaN for a parameter that has none.
    """
    if not np.isnan(start).any():
        return start[None, :]
    grid = np.array([_divide_range(a, b) for a, b in zip(low, high)]).T
    return np.where(np.isnan(start), grid, start)


def _divide_range(low: float, high: float) -> np.ndarray:
    return low + (high - low) * (np.arange(STARTS) + 0.5) / STARTS


class _Minimum(NamedTuple):
    cost: float
    s: np.ndarray


def _better_minimum(best: _Minimum | None, trial: _Minimum | None) -> _Minimum | None:
    """Return the trial minimum only if it is clearly better: equal minima are not exchanged."""
    if trial is None or (best is not None and trial.cost > best.cost * (1.0 - _CLEARLY)):
        return best
    return trial


class _Gradient(NamedTuple):
    """Gradient of half the cost, (m,).

    Attributes
    ----------
    values : array (m,)
    free : array of bool (m,)
        Parameters that no bound fixes.
    length : array (m,)
        Lengths of the derivatives of the residual.
    """

    values: np.ndarray
    free: np.ndarray
    length: np.ndarray


@dataclass(frozen=True)
class _ProjectionSearch:
    """Search for the least cost between bounds."""

    evaluate: Evaluation
    low: np.ndarray
    high: np.ndarray

    def try_point(self, s: np.ndarray) -> Projection | None:
        """Return the projection, or None also where a term cannot be computed."""
        try:
            return self.evaluate(s)
        except OutOfRange:
            return None

    def gradient(self, projection: Projection, s: np.ndarray) -> _Gradient:
        """Return the gradient and the parameters that no bound fixes."""
        values = projection.jacobian.T @ projection.residual
        length = np.linalg.norm(projection.jacobian, axis=0)
        # A bound fixes a parameter if the descent direction points out of the range.
        at_low, at_high = (s <= self.low) & (values > 0), (s >= self.high) & (values < 0)
        return _Gradient(values, ~(at_low | at_high | (length == 0.0)), length)

    def step_from(self, s: np.ndarray, H: np.ndarray, gradient: _Gradient) -> np.ndarray:
        """Return the parameters after one step, within bounds; `H` is scaled by the lengths."""
        free, length = gradient.free, gradient.length
        step = np.zeros_like(s)
        step[free] = -np.linalg.solve(H, gradient.values[free] / length[free]) / length[free]
        return np.clip(s + step, self.low, self.high)

    def descend(self, s: np.ndarray) -> _Minimum | None:
        """Return an approximate minimum by Levenberg-Marquardt steps from one start."""
        projection = self.try_point(s)
        if projection is None:
            return None
        damping = _DAMPING
        for _ in range(_STEPS):
            gradient = self.gradient(projection, s)
            free = gradient.free
            if not free.any():
                break
            # Parameters at a bound take no part; the others are scaled to columns of length one.
            J = projection.jacobian[:, free] / gradient.length[free]
            trial = self.step_from(s, J.T @ J + damping * np.eye(J.shape[1]), gradient)
            trial_projection = self.try_point(trial)
            # A step that does not lower the cost is repeated with more damping.
            if trial_projection is None or trial_projection.cost > projection.cost:
                damping *= _FACTOR
                if damping > _MOST_DAMPING:
                    break
                continue
            gain = projection.cost - trial_projection.cost
            s, projection = trial, trial_projection
            damping = max(damping / _FACTOR, _LEAST_DAMPING)
            if gain <= _ENOUGH * projection.cost:
                break
        return _Minimum(projection.cost, s)

    def other_valleys(self, best: _Minimum) -> list[np.ndarray]:
        """Return starts that differ from a minimum in one parameter, in another valley along it."""
        valleys = []
        for m in range(len(self.low)):
            line = np.sort(np.append(_divide_range(self.low[m], self.high[m]), best.s[m]))
            points, costs = [], [np.inf]
            for value in line:
                point = np.where(np.arange(len(self.low)) == m, value, best.s)
                projection = self.try_point(point)
                points.append(point)
                costs.append(np.inf if projection is None else projection.cost)
            cost = np.array([*costs, np.inf])
            # A local minimum along the line; infinite costs at both ends close it.
            is_lowest = (cost[1:-1] < cost[:-2]) & (cost[1:-1] <= cost[2:]) & (line != best.s[m])
            for k in np.flatnonzero(is_lowest):
                valleys.append(points[k])
        return valleys

    def refine(self, s: np.ndarray) -> np.ndarray:
        """Return the minimum by Newton steps, damped until they go downhill."""
        projection = self._evaluate_near(s)
        for _ in range(_STEPS):
            gradient = self.gradient(projection, s)
            free, length = gradient.free, gradient.length
            limit = _SETTLED * length[free] * np.sqrt(projection.cost)
            if (np.abs(gradient.values[free]) <= limit).all():
                break
            # Negative curvature is replaced by its size, so that every step is a descent.
            H = self._curvature(s, gradient) / np.outer(length[free], length[free])
            values, vectors = np.linalg.eigh(H)
            H = vectors * np.maximum(np.abs(values), _LEAST_CURVATURE) @ vectors.T
            for damping in _NEWTON_DAMPING:
                trial = self.step_from(s, H + damping * np.eye(len(H)), gradient)
                trial_projection = self.try_point(trial)
                if trial_projection is not None and self._is_progress(
                    _Point(projection, s), _Point(trial_projection, trial)
                ):
                    break
            else:
                break
            s, projection = trial, trial_projection
        return s

    def _is_progress(self, point: _Point, trial: _Point) -> bool:
        """Return whether a step went downhill, or halved the gradient where rounding hides it."""
        cost, trial_cost = point.projection.cost, trial.projection.cost
        if abs(trial_cost - cost) > _HIDDEN * cost:
            return trial_cost < cost
        return self._gradient_size(trial) < 0.5 * self._gradient_size(point)

    def _gradient_size(self, point: _Point) -> float:
        """Return the largest scaled component of the gradient."""
        gradient = self.gradient(point.projection, point.s)
        free = gradient.free
        return float(np.abs(gradient.values[free] / gradient.length[free]).max(initial=0.0))

    def _curvature(self, s: np.ndarray, gradient: _Gradient) -> np.ndarray:
        """Return second derivatives of half the cost, as differences of the exact gradient."""
        parameters = np.flatnonzero(gradient.free)
        H = np.empty((len(parameters), len(parameters)))
        for k, m in enumerate(parameters):
            # The step points to the middle of the range, so that it stays within bounds.
            sign = 1.0 if s[m] < 0.5 * (self.low[m] + self.high[m]) else -1.0
            shifted = s.copy()
            shifted[m] += _DIFFERENCE * (self.high[m] - self.low[m]) * sign
            projection = self._evaluate_near(shifted)
            change = projection.jacobian.T @ projection.residual - gradient.values
            H[:, k] = (change / (shifted[m] - s[m]))[parameters]
        return 0.5 * (H + H.T)

    def _evaluate_near(self, s: np.ndarray) -> Projection:
        """Return the projection at or next to a minimum, where it must exist."""
        projection = self.evaluate(s)
        if projection is None:
            raise IdentificationError(_UNDETERMINED_AT_BEST)
        return projection


class _Point(NamedTuple):
    projection: Projection
    s: np.ndarray
