"""Delay and sign of the effect of a surface, estimated together.

Half a period of delay looks like a wrong sign. The motion is therefore explained with the surface
at every delay of a range, once with the sign of the convention and once with the opposite sign. A
sign is determined if no delay makes the other sign explain the motion as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.support.arrays import picked_runs
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

LONGEST = 2.0  # s of delay, either way
_STEP = 0.025  # s
_SHIFTS = _STEP * np.arange(-round(LONGEST / _STEP), round(LONGEST / _STEP) + 1)
# A delay of 0.6 s is preferred to no delay only if it reduces the natural logarithm of the
# unexplained variance by a tenth.
_USUAL, _RARE = 0.6, 0.1
# The logarithms of two signs must differ by this much.
_DISTINCT = 0.1
# In a short record they must differ by more: twice the logarithm of the likelihood, of samples that
# are independent after this time [s].
_LIKELIER, _INDEPENDENT = 8.0, 0.25
_MEMORY = 2.0  # s over which residuals are correlated
_TINY = 1e-300  # prevents division by zero
_LEAST_SHARE = 1e-12  # of the variance, in a logarithm
_SAMPLES_PER_COLUMN = 10
_LARGEST_CONDITION = 1e6


@dataclass(frozen=True)
class SurfaceTiming:
    """Delay and sign with which a surface explains the motion best.

    Attributes
    ----------
    lead, stderr : float
        Time from the record of the surface to its effect, and its standard error. It is negative if
        the surface is recorded late. At the end of the range (`bound`) the lead is a limit, and
        the standard error is infinite. [s]
    gained, explained : float
        Increase of R2 by the lead, and R2 with the lead.
    bound : bool
        Whether the best delay lies at the end of the range.
    sign : int
        Sign of the effect; 0 if the other sign explains the motion as well at some delay.
    other : float
        Best lead for the other sign. [s]
    """

    lead: float
    stderr: float
    gained: float
    explained: float
    bound: bool
    sign: int
    other: float


def surface_timing(
    y: np.ndarray,
    columns: Sequence[np.ndarray],
    surface: np.ndarray,
    time: np.ndarray,
    mask: np.ndarray,
) -> SurfaceTiming:
    """Return the delay and the sign with which a surface explains a motion best.

    Parameters
    ----------
    y : array (sample,)
        Motion at the samples of `mask`.
    columns : sequence of array (sample,)
        Other causes of the motion, at the same samples.
    surface, time, mask : array (time,)
        Surface on the complete clock [rad], the clock [s] and the valid samples.

    Notes
    -----
    The standard error belongs to the linear model at the best delay: a delay adds the derivative of
    the surface times its effect. Of two delays that explain the motion equally well, the shorter
    one is preferred, see `_USUAL`.
    """
    effect, unexplained = _unexplained_share(y, columns, surface=surface, time=time, mask=mask)
    cost = np.log(np.maximum(unexplained, _LEAST_SHARE)) + _RARE * (_SHIFTS / _USUAL) ** 2
    # cost of a sign that does not explain anything at any delay
    no_effect = float(np.log(max(float(unexplained.max()), _LEAST_SHARE)))
    best, costs = {}, {}
    for sign in (-1, 1):
        best[sign] = int(np.argmin(np.where(sign * effect > 0.0, cost, np.inf)))
        costs[sign] = no_effect
        if sign * effect[best[sign]] > 0.0:
            costs[sign] = float(cost[best[sign]])
    sign = min(costs, key=lambda candidate: costs[candidate])
    k = _descend(unexplained, best[sign])
    lead = float(_SHIFTS[k])
    bound = k in (0, len(unexplained) - 1)
    stderr = np.inf
    if not bound:
        lead -= _vertex_distance(unexplained[k - 1], unexplained[k], unexplained[k + 1])
        delayed = np.interp(time - lead, time, surface)
        stderr = _lead_error(y, columns, delayed=delayed, time=time, mask=mask)
    duration = len(y) * float(time[1] - time[0])
    needed = max(_DISTINCT, _LIKELIER * _INDEPENDENT / duration)
    is_distinct = costs[-sign] - costs[sign] > needed
    return SurfaceTiming(
        lead=lead,
        stderr=float(stderr),
        gained=float(unexplained[len(unexplained) // 2] - unexplained[k]),
        explained=1.0 - float(unexplained[k]),
        bound=bound,
        sign=sign if is_distinct else 0,
        other=float(_SHIFTS[best[-sign]]),
    )


def _unexplained_share(
    y: np.ndarray,
    columns: Sequence[np.ndarray],
    surface: np.ndarray,
    time: np.ndarray,
    mask: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of the surface and the unexplained share of the variance (delay,)."""
    # The other columns are removed from motion and surface by projection.
    Q = np.zeros((len(y), 0))
    if columns:
        Q, _ = np.linalg.qr(np.stack(columns, axis=1))
    motion = y - Q @ (Q.T @ y)
    effect, unexplained = np.empty(len(_SHIFTS)), np.empty(len(_SHIFTS))
    for k, shift in enumerate(_SHIFTS):
        delayed = np.interp(time - shift, time, surface)[mask]
        delayed = delayed - Q @ (Q.T @ delayed)
        effect[k] = delayed @ motion / max(delayed @ delayed, _TINY)
        unexplained[k] = np.var(motion - effect[k] * delayed) / max(np.var(y), _TINY)
    return effect, unexplained


def _descend(values: np.ndarray, start: int) -> int:
    """Return the index of the local minimum below `start`."""
    k = start
    while 0 < k < len(values) - 1 and min(values[k - 1], values[k + 1]) < values[k]:
        if values[k + 1] < values[k - 1]:
            k += 1
        else:
            k -= 1
    return k


def _vertex_distance(before: float, lowest: float, after: float) -> float:
    """Return the time from the vertex of a parabola to the middle of three points. [s]"""
    bend = before - 2.0 * lowest + after
    if not bend > 0.0:
        return 0.0
    return _STEP * (after - before) / (2.0 * bend)


def _lead_error(
    y: np.ndarray,
    columns: Sequence[np.ndarray],
    delayed: np.ndarray,
    time: np.ndarray,
    mask: np.ndarray,
) -> float:
    """Return the standard error of the lead; infinite if it is undetermined. [s]"""
    step = float(time[1] - time[0])
    with_surface = [*columns, delayed[mask]]
    with_slope = [*with_surface, np.gradient(delayed, step)[mask]]
    effect = regress_last_column(y, with_surface, mask, step)
    slope = regress_last_column(y, with_slope, mask, step)
    if effect is None or slope is None or effect[0] == 0.0:
        return np.inf
    return slope[1] / abs(effect[0])


def regress_last_column(
    y: np.ndarray, columns: Sequence[np.ndarray], mask: np.ndarray, step: float
) -> tuple[float, float, float] | None:
    """Return coefficient and standard error of the last column, and R2; None if undetermined.

    The standard error is for coloured residuals.
    """
    X = np.stack(columns, axis=1)
    size = X.std(axis=0)
    if (size < 1e-12).any() or len(y) < _SAMPLES_PER_COLUMN * X.shape[1]:
        return None
    scaled = X / size
    if np.linalg.cond(scaled) > _LARGEST_CONDITION:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    residual = y - scaled @ theta
    # Residuals are correlated within uninterrupted pieces of the mask.
    pieces = picked_runs(mask)
    steps = [step] * len(pieces)
    covariance = coloured_covariance_of(scaled, residual, pieces, steps, lag=_MEMORY).covariance
    coefficient = float(theta[-1] / size[-1])
    stderr = float(np.sqrt(covariance[-1, -1]) / size[-1])
    return coefficient, stderr, float(1.0 - residual.var() / y.var())
