"""Delay and scale of a channel against integrals of inertial motion, fitted together.

Integrals are compared instead of rates: a satellite receiver has little noise in velocity and much
in its derivative.  Biases of accelerometers and gyros make an integral drift.  Each stretch of the
record therefore has its own parabola, and delay, scale and drift are estimated jointly.  A delay
after a separate removal of biases is wrong if the biases have absorbed a part of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from flightmech.support.arrays import true_runs
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.regression.uncertainty.jackknife import block_jackknife

_MOST_STRETCHES = 16
_SEARCH_SHARE = 0.2  # largest delay over the length of a stretch
_FILLED = 0.5  # least length of a stretch over the nominal one
_SHIFT = 0.1  # s between the delays of the search; the minimum is interpolated
_MEMORY = 2.0  # s over which residuals are correlated
_JACKKNIFE = 4  # stretches from which on their scatter counts for the standard errors
_MOST_CONDITION = 1e8


@dataclass(frozen=True)
class InertialFit:
    """Delay and coefficients of a channel.

    Attributes
    ----------
    delay, stderr : float
        Positive if the channel is late. The standard error is infinite at the end of the search.
        [s]
    scales, errors : array (references,)
        Coefficients of the references, and their standard errors. [1]
    explained : float
        Share of the variance of the channel that the references explain. [1]
    bound : bool
        Whether the delay lies at the end of the search.
    seconds : float
        Length of all stretches. [s]
    """

    delay: float
    stderr: float
    scales: np.ndarray
    errors: np.ndarray
    explained: float
    bound: bool
    seconds: float


@dataclass(frozen=True)
class _InertialStretch:
    """Detrended references (samples, references), and the channel at each shift (shifts,
    samples).
    """

    references: np.ndarray
    shifted: np.ndarray


def integrate(rate: np.ndarray, step: float) -> np.ndarray:
    """Return the integral of a rate, zero at its first sample."""
    return scipy.integrate.cumulative_trapezoid(rate, dx=step, initial=0.0)


def fit_inertial(
    channel: np.ndarray,
    references: Sequence[np.ndarray],
    *,
    mask: np.ndarray,
    step: float,
    stretch: float,
    longest: float,
    order: int = 2,
) -> InertialFit | None:
    """Return the delay and scale of a channel; None if the record is too short.

    Parameters
    ----------
    channel : array (time,)
        Channel with a possible delay.
    references : sequence of array (time,)
        The same quantity from other channels, without the constants of integration.
    mask : array of bool (time,)
        Valid samples.
    step, stretch, longest : float
        Sampling interval, length of a stretch with one drift, and longest delay searched. [s]
    order : int
        Order of the polynomial of the drift.

    Notes
    -----
    y(t + d) = sum_i c_i r_i(t) + polynomial of each stretch. The sum of squares is minimized over c
    and the polynomials for each d of a grid. The standard errors are the larger ones of the
    coloured residuals and of the jackknife over stretches. With fewer than four stretches they
    include the differences from drifts of other orders.
    """
    shifts = _possible_shifts(step, min(longest, _SEARCH_SHARE * stretch))
    slices = _choose_stretches(mask, references[0], step=step, stretch=stretch, edge=shifts[-1])
    fit = _fit_stretches(channel, references, slices, shifts, step=step, order=order)
    if fit is None or len(slices) >= _JACKKNIFE:
        return fit
    # A few stretches show no scatter. Another order of the drift shows what the drift absorbs.
    for other in (order - 1, order + 1):
        compared = _fit_stretches(channel, references, slices, shifts, step=step, order=other)
        if compared is not None:
            fit = _with_difference(fit, compared)
    return fit


def _fit_stretches(
    channel: np.ndarray,
    references: Sequence[np.ndarray],
    slices: list[slice],
    shifts: np.ndarray,
    *,
    step: float,
    order: int,
) -> InertialFit | None:
    """Return the fit of some stretches; None if they do not determine it."""
    pieces = [_detrended(channel, references, one, shifts, order=order) for one in slices]
    if not pieces:
        return None
    # Sums of squares and products, from which every delay has its least squares.
    normal = np.array([one.references.T @ one.references for one in pieces])
    if not np.linalg.cond(normal.sum(axis=0)) < _MOST_CONDITION:
        return None
    cross = np.array([one.shifted @ one.references for one in pieces])
    power = np.array([np.einsum("st,st->s", one.shifted, one.shifted) for one in pieces])
    shift, scales, explained = _minimize(normal, cross, power)
    delay = float(np.interp(shift, np.arange(len(shifts)), shifts * step))
    index = round(shift)
    bound = index in (0, len(shifts) - 1)
    stderr, errors = _coloured_errors(pieces, index, scales, step=step)

    def without_one(kept: np.ndarray) -> np.ndarray:
        shift, scales, _ = _minimize(normal[kept], cross[kept], power[kept])
        return np.array([shift, *scales])

    # The larger of two standard errors: of coloured residuals, and of the scatter of the stretches.
    if len(pieces) >= _JACKKNIFE:
        by_stretch = block_jackknife(without_one, len(pieces), len(pieces))
        stderr = max(stderr, float(by_stretch[0]) * step * (shifts[1] - shifts[0]))
        errors = np.maximum(errors, by_stretch[1:])
    if bound:
        stderr = np.inf
    seconds = step * sum(one.stop - one.start for one in slices)
    return InertialFit(delay, stderr, scales, errors, explained, bound=bound, seconds=seconds)


def _with_difference(fit: InertialFit, other: InertialFit) -> InertialFit:
    """Return a fit whose standard errors include the difference from another fit."""
    stderr = max(fit.stderr, abs(fit.delay - other.delay))
    errors = np.maximum(fit.errors, np.abs(fit.scales - other.scales))
    return replace(fit, stderr=stderr, errors=errors)


def _possible_shifts(step: float, longest: float) -> np.ndarray:
    """Return the shifts of the search in samples, with zero in the middle."""
    stride = max(1, round(_SHIFT / step))
    count = max(2, round(longest / (stride * step)))
    return stride * np.arange(-count, count + 1)


def _choose_stretches(
    mask: np.ndarray, reference: np.ndarray, *, step: float, stretch: float, edge: int
) -> list[slice]:
    """Return the stretches with most motion, each with samples for all shifts around it."""
    usable = mask.copy()
    usable[:edge] = usable[len(usable) - edge :] = False
    slices = []
    for start, stop in true_runs(usable):
        parts = max(1, round((stop - start) * step / stretch))
        limits = np.linspace(start, stop, parts + 1).astype(int)
        slices += [slice(first, last) for first, last in pairwise(limits)]
    slices = [one for one in slices if (one.stop - one.start) * step > _FILLED * stretch]
    slices.sort(key=lambda one: -float(np.var(_without_drift(reference[one][None], 2))))
    return slices[:_MOST_STRETCHES]


def _detrended(
    channel: np.ndarray,
    references: Sequence[np.ndarray],
    one: slice,
    shifts: np.ndarray,
    order: int,
) -> _InertialStretch:
    count = one.stop - one.start
    windows = np.lib.stride_tricks.sliding_window_view(channel, count)
    shifted = _without_drift(windows[one.start + shifts], order)
    inertial = _without_drift(np.stack([reference[one] for reference in references]), order)
    return _InertialStretch(inertial.T, shifted)


def _without_drift(x: np.ndarray, order: int) -> np.ndarray:
    """Return rows (rows, samples) without their polynomials."""
    polynomials = np.vander(np.linspace(-1.0, 1.0, x.shape[1]), order + 1)
    basis = np.linalg.qr(polynomials)[0]
    return x - (x @ basis) @ basis.T


def _minimize(
    normal: np.ndarray, cross: np.ndarray, power: np.ndarray
) -> tuple[float, np.ndarray, float]:
    """Return the index of the best shift (a fraction), its coefficients, and the explained
    share.
    """
    total = power.sum(axis=0)
    products = cross.sum(axis=0)
    scales = np.linalg.solve(normal.sum(axis=0), products.T).T
    cost = total - np.einsum("sr,sr->s", scales, products)
    best = int(np.argmin(cost))
    fraction = 0.0
    if 0 < best < len(cost) - 1:
        before, here, after = cost[best - 1 : best + 2]
        curvature = before - 2.0 * here + after
        if curvature > 0.0:
            fraction = 0.5 * (before - after) / curvature
    explained = 1.0 - cost[best] / max(total[best], np.finfo(float).tiny)
    return best + fraction, scales[best], float(explained)


def _coloured_errors(
    pieces: list[_InertialStretch], index: int, scales: np.ndarray, *, step: float
) -> tuple[float, np.ndarray]:
    """Return the standard errors of delay and coefficients from coloured residuals."""
    X, residuals, parts, start = [], [], [], 0
    for one in pieces:
        y = one.shifted[index]
        # y(t + d) changes by its rate times a change of d
        X.append(np.column_stack([np.gradient(y, step), one.references]))
        residuals.append(y - one.references @ scales)
        parts.append(slice(start, start + len(y)))
        start += len(y)
    steps = [step] * len(parts)
    coloured = coloured_covariance_of(
        np.concatenate(X), np.concatenate(residuals), parts, steps, lag=_MEMORY
    )
    errors = np.sqrt(np.diag(coloured.covariance))
    return float(errors[0]), errors[1:]
