"""When a surface acts, and with which sign: both are estimated together.

Half a period of delay looks like a wrong sign.  So the motion is explained with the surface at
every delay of a range, once with the effect that the convention states and once with the opposite
one.  A sign is determined where no delay lets the other sign explain as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

LONGEST = 2.0  # s, either way, that a surface is looked for
_STEP = 0.025  # s
_SHIFTS = _STEP * np.arange(-round(LONGEST / _STEP), round(LONGEST / _STEP) + 1)
_USUAL, _RARE = (
    0.6,
    0.1,
)  # a delay of 0.6 s must leave a tenth (natural logarithm) less unexplained than none to be preferred
_DISTINCT = 0.1  # and so much less must one sign leave than the other,
_LIKELIER, _INDEPENDENT = (
    8.0,
    0.25,
)  # or more in a short record: twice the logarithm of the likelihood, of samples so many s apart
_MEMORY = 2.0  # s over which residuals are taken as correlated


@dataclass(frozen=True)
class SurfaceTiming:
    """The delay and the sign with which a surface explains the motion best.

    Attributes
    ----------
    lead, stderr : float
        Time by which the surface is recorded before it acts, negative when it is recorded late, and
        its standard error [s].  At the end of the range (`bound`) the lead is the least that
        explains the motion, and the standard error is infinite.
    gained, explained : float
        What the lead gains of R2, and the R2 with it.
    bound : bool
        Whether the best delay lies at the end of the range.
    sign : int
        Sign of the effect; 0 where a delay lets the other sign explain the motion as well.
    other : float
        Lead with which the other sign explains it best [s].
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
    """Return by how much a surface must be delayed to explain a motion best, and with which sign.

    Parameters
    ----------
    y : array (sample,)
        Motion at the samples of `mask`.
    columns : sequence of array (sample,)
        What else moves the aeroplane, at the same samples.
    surface, time, mask : array (time,)
        Surface on the whole clock [rad], the clock [s] and the samples that count.

    Notes
    -----
    The standard error is that of the linear model at the best delay: a delay adds the derivative of the surface times its effect.
    Between two delays that explain equally much, the shorter one is taken: see `_USUAL`.
    """
    effect, left = _unexplained(y, columns, surface, time, mask)
    cost = np.log(np.maximum(left, 1e-12)) + _RARE * (_SHIFTS / _USUAL) ** 2
    nothing = max(float(left.max()), 1e-12)  # where a sign explains nothing at any delay
    best = {sign: int(np.argmin(np.where(sign * effect > 0.0, cost, np.inf))) for sign in (-1, 1)}
    costs = {
        sign: float(cost[at]) if sign * effect[at] > 0.0 else float(np.log(nothing))
        for sign, at in best.items()
    }
    sign = min(costs, key=lambda s: costs[s])
    at = _lowest(left, best[sign])
    lead, bound = float(_SHIFTS[at]), at in (0, len(left) - 1)
    if not bound and (bend := left[at - 1] - 2.0 * left[at] + left[at + 1]) > 0.0:
        lead -= _STEP * (left[at + 1] - left[at - 1]) / (2.0 * bend)
    stderr = (
        np.inf if bound else _stderr(y, columns, np.interp(time - lead, time, surface), time, mask)
    )
    gained = float(left[len(left) // 2] - left[at])
    needed = max(_DISTINCT, _LIKELIER * _INDEPENDENT / (len(y) * float(time[1] - time[0])))
    distinct = costs[-sign] - costs[sign] > needed
    return SurfaceTiming(
        lead,
        float(stderr),
        gained,
        1.0 - float(left[at]),
        bound,
        sign if distinct else 0,
        float(_SHIFTS[best[-sign]]),
    )


def _unexplained(
    y: np.ndarray,
    columns: Sequence[np.ndarray],
    surface: np.ndarray,
    time: np.ndarray,
    mask: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of the surface and the share of the variance that is left, at each delay of
    the range.
    """
    Q = np.linalg.qr(np.stack(columns, axis=1))[0] if columns else np.zeros((len(y), 0))
    rest = y - Q @ (Q.T @ y)
    effect, left = np.empty(len(_SHIFTS)), np.empty(len(_SHIFTS))
    for k, shift in enumerate(_SHIFTS):
        delayed = np.interp(time - shift, time, surface)[mask]
        own = delayed - Q @ (Q.T @ delayed)  # what the other columns do not show as well
        effect[k] = own @ rest / max(own @ own, 1e-300)
        left[k] = np.var(rest - effect[k] * own) / max(np.var(y), 1e-300)
    return effect, left


def _lowest(left: np.ndarray, start: int) -> int:
    """Return the minimum into whose valley `start` lies."""
    at = start
    while 0 < at < len(left) - 1 and min(left[at - 1], left[at + 1]) < left[at]:
        at += 1 if left[at + 1] < left[at - 1] else -1
    return at


def _stderr(
    y: np.ndarray,
    columns: Sequence[np.ndarray],
    delayed: np.ndarray,
    time: np.ndarray,
    mask: np.ndarray,
) -> float:
    step = float(time[1] - time[0])
    effect = regress_last_column(y, [*columns, delayed[mask]], mask, step)
    slope = regress_last_column(
        y, [*columns, delayed[mask], np.gradient(delayed, step)[mask]], mask, step
    )
    return (
        np.inf if effect is None or slope is None or effect[0] == 0.0 else slope[1] / abs(effect[0])
    )


def regress_last_column(
    y: np.ndarray, columns: Sequence[np.ndarray], mask: np.ndarray, step: float
) -> tuple[float, float, float] | None:
    """Return the coefficient of the last column, its standard error with coloured residuals, and
    R2; None where it is undetermined.
    """
    X = np.stack(columns, axis=1)
    size = X.std(axis=0)
    if (size < 1e-12).any() or len(y) < 10 * X.shape[1]:
        return None
    scaled = X / size
    if np.linalg.cond(scaled) > 1e6:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    residual = y - scaled @ theta
    breaks = np.flatnonzero(np.diff(np.flatnonzero(mask)) > 1) + 1
    bounds = [0, *breaks.tolist(), len(y)]
    pieces = [slice(a, b) for a, b in pairwise(bounds)]
    covariance = coloured_covariance_of(
        scaled, residual, pieces, [step] * len(pieces), lag=_MEMORY
    ).covariance
    return (
        float(theta[-1] / size[-1]),
        float(np.sqrt(covariance[-1, -1]) / size[-1]),
        float(1.0 - residual.var() / y.var()),
    )
