"""Inputs of free motion without the noise of their transducers.

A free control has the force zero, a pulse is flown with a force that rises, holds and falls, the
tab does not move and speed and angle of attack hardly change.  Such an input is a line with few
corners.  As an input of a simulation, its noise would move the control by more than the noise of
the pick-ups.
"""

from __future__ import annotations

import numpy as np

# Cost of a further piece over the variance of the noise, and of its slope.
_PIECE, _SLOPE = 16.0, 8.0
# Largest mean square of the rest over the variance of the noise, and fewest samples per line.
_LARGEST_REST, _FEWEST_PER_LINE = 1.6, 6
# Standard errors of the mean square of white noise that a single piece may exceed.
_CLEAR = 3.0
# Longest record whose corners are looked for. [samples]
_LONGEST = 2500


def quiet_lines(x: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an input as lines between corners and jumps, if such lines explain it.

    Parameters
    ----------
    x : array (time,)
        Recorded input, uniformly sampled.
    noise : float
        Standard deviation of its white noise.

    Returns
    -------
    array (time,)
        The lines; `x` itself if it needs many lines or differs from them by more than noise.
    array of int (time,)
        Samples of the line of each sample; 1 where `x` itself is returned.

    Notes
    -----
    The lines minimise the sum of squares over the variance of the noise plus a penalty per line,
    by dynamic programming over the last corner. A piece is a constant unless its slope is
    significant.
    """
    n = len(x)
    alone = np.ones(n, int)
    if not noise > 0.0 or n < _FEWEST_PER_LINE:
        return x, alone
    single = _piece(x, noise)
    if np.mean((x - single) ** 2) < noise**2 * (1.0 + _CLEAR * np.sqrt(2.0 / n)):
        return single, np.full(n, n)
    if n > _LONGEST:
        return x, alone
    costs = _piece_costs(x / noise)
    best, last = np.full(n + 1, np.inf), np.zeros(n + 1, int)
    best[0] = 0.0
    for stop in range(1, n + 1):
        total = best[:stop] + costs[:stop, stop]
        last[stop] = int(np.argmin(total))
        best[stop] = total[last[stop]]
    lines, sizes, corners, stop = np.empty(n), alone.copy(), 0, n
    while stop > 0:
        start = int(last[stop])
        lines[start:stop] = _piece(x[start:stop], noise)
        sizes[start:stop] = stop - start
        corners, stop = corners + 1, start
    rest = float(np.mean((x - lines) ** 2))
    if corners * _FEWEST_PER_LINE > n or rest > _LARGEST_REST * noise**2:
        return x, alone
    return lines, sizes


def _piece(x: np.ndarray, noise: float) -> np.ndarray:
    """Return the mean of samples, or their line of least squares if its slope is significant."""
    k = np.arange(len(x)) - 0.5 * (len(x) - 1)
    spread = max(float(k @ k), 0.5)
    slope = float(k @ x) / spread
    if slope**2 * spread < _SLOPE * noise**2:
        slope = 0.0
    return x.mean() + slope * k


def _piece_costs(x: np.ndarray) -> np.ndarray:
    """Return the cost of one piece through the samples start to stop - 1, (start, stop).

    It is the residual sum of squares over the variance of the noise, with the penalties.
    """
    n = len(x)
    k = np.arange(n, dtype=float)
    x = x - x.mean()
    sums = np.zeros((6, n + 1))
    for row, values in enumerate((np.ones(n), k, k**2, x, k * x, x**2)):
        sums[row, 1:] = np.cumsum(values)
    count, sk, skk, sx, skx, sxx = sums[:, None, :] - sums[:, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        about_mean = sxx - sx**2 / count
        gain = (skx - sk * sx / count) ** 2 / (skk - sk**2 / count)
    about_mean = np.maximum(about_mean, 0.0)
    # A single sample has no slope.
    gain = np.where(count > 1, gain, 0.0)
    return _PIECE + about_mean - np.clip(gain - _SLOPE, 0.0, about_mean)
