"""One flight under two titles: cases of a test whose windows hold the same samples.

A test that wants several conditions or repetitions is not shown by one flight twice.  File names
do not show a copy, and the motion of two flights that were flown alike does not show the
difference.  The noise of the instruments shows both: no two flights share it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy

from pom.cases.case import PomCase
from pom.judging.condition_coverage import SHARED
from pom.judging.signals import traces_of
from pom.probing.scatter_probe import CHANNELS, cut_steps, is_noisy
from pom.result import PomResult
from pom.tolerances.bands import RowRemark

MOST = 0.5
"""Share of the shorter window that two cases of a test may have in common.

Our number: neighbouring parts of one manoeuvre overlap by their lead-in.
"""
ALIKE = 0.33
"""Correlation of the noise from which on two windows hold the same samples.

Copies of the cases of the T-37 have 0.99 and more, and 0.47 and more when re-sampled between the
samples.  The 170 pairs of different flights have 0.27 at most, at any lag.
"""
LEAST_SAMPLES = 200
MOST_PAIRS = 100
"""Pairs of records that are compared per test; each takes some milliseconds."""


def shared_flight_remarks(results: Sequence[PomResult]) -> list[tuple[RowRemark, ...]]:
    """Return the remarks on flights that several cases of one test show, per result.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of one test.

    Returns
    -------
    list of tuple of RowRemark
        Of kind ``departure`` on the later case, ``probe`` on the earlier one and on a case that
        states itself as additional, which counts for nothing.
    """
    remarks: list[tuple[RowRemark, ...]] = [() for _ in results]
    flown = [k for k, result in enumerate(results) if result.case.reference == "flight"]
    left = MOST_PAIRS
    for place, second in enumerate(flown):
        later = results[second].case
        for first in flown[:place]:
            earlier = results[first].case
            if Path(earlier.record) != Path(later.record):
                left -= 1
                if left < 0:
                    continue
            part = _common_part(results[first], results[second])
            if not part:
                continue
            text = _shared_text(earlier, part)
            if later.additional:
                remarks[second] += (RowRemark("probe", text, SHARED),)
            else:
                text = f"departure: {text}; one flight counts once"
                remarks[second] += (RowRemark("departure", text, SHARED),)
            if not remarks[first]:
                remarks[first] += (RowRemark("probe", _shared_text(later, part), SHARED),)
            # one earlier case is enough
            break
    if left < 0:
        text = f"{-left} pairs of cases of this test were not searched for shared samples"
        remarks = [(*own, RowRemark("probe", text, SHARED)) for own in remarks]
    return remarks


def _shared_text(other: PomCase, part: str) -> str:
    return f"the same flight is judged as case {other.name} ({other.title}): {part}"


def _common_part(first: PomResult, second: PomResult) -> str:
    """Return what two results have in common as a text; empty if it is less than `MOST`."""
    a, b = first.case, second.case
    least = MOST * min(a.window[1] - a.window[0], b.window[1] - b.window[0])
    if Path(a.record) == Path(b.record):
        start, stop = max(a.window[0], b.window[0]), min(a.window[1], b.window[1])
        return f"{start:g} ... {stop:g} s of one record" if stop - start > least else ""
    times = [result.signals["time"].values.astype(float) for result in (first, second)]
    traces = [traces_of(result.signals, "flight") for result in (first, second)]
    correlation, overlap = compare_noise(times[0], traces[0], times[1], traces[1])
    if correlation < ALIKE or overlap <= least:
        return ""
    return (
        f"{overlap:.1f} s of {Path(a.record).name} are in {Path(b.record).name}, correlation of "
        f"the noise {correlation:.2f}"
    )


def compare_noise(
    time_a: np.ndarray,
    a: Mapping[str, np.ndarray],
    time_b: np.ndarray,
    b: Mapping[str, np.ndarray],
) -> tuple[float, float]:
    """Return the largest correlation of the noise of two flights at any lag, and their overlap.

    Parameters
    ----------
    time_a, time_b : array (time,)
        The clocks of both need not agree. [s]
    a, b : mapping of str to array (time,)
        Channels by name; those with noise are compared, at the lower of the two rates.

    Returns
    -------
    (float, float)
        Median over the channels at the best lag, and the length that both share there [s]; zero for
        flights without noise.
    """
    steps = [float(np.median(np.diff(time))) for time in (time_a, time_b)]
    step = max(steps)
    best = (0.0, 0.0)
    # at the lower rate, every sample of the higher one may be the first
    for delay in np.arange(round(step / min(steps))) * min(steps):
        late = [delay if one < step else 0.0 for one in steps]
        grids = [
            np.arange(time[0] + shift, time[-1] + 1e-9, step)
            for time, shift in zip((time_a, time_b), late, strict=True)
        ]
        if min(grid.size for grid in grids) < LEAST_SAMPLES:
            continue
        curves = []
        for name in CHANNELS:
            if name not in a or name not in b:
                continue
            pair = np.interp(grids[0], time_a, a[name]), np.interp(grids[1], time_b, b[name])
            if is_noisy(pair[0]) and is_noisy(pair[1]):
                curves.append(_noise_correlation(*pair))
        if not curves:
            continue
        joint = np.median(curves, axis=0)
        place = int(np.argmax(joint))
        sizes = [grid.size - 3 for grid in grids]
        lag = place - (sizes[1] - 1)
        count = min(sizes[0], lag + sizes[1]) - max(lag, 0)
        best = max(best, (float(joint[place]), count * step))
    return best


def _noise_correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the correlation of the third differences at every lag of b in a (lag,).

    Lags run from 1 - size of b; those with fewer than `LEAST_SAMPLES` count as 0.
    """
    rows = [cut_steps(np.diff(values, 3)) for values in (a, b)]
    rows = [row / row.std() for row in rows]
    product = scipy.signal.correlate(rows[0], rows[1], "full", "fft")
    lags = np.arange(1 - rows[1].size, rows[0].size)
    count = np.minimum(rows[0].size, lags + rows[1].size) - np.maximum(lags, 0)
    return np.where(count < LEAST_SAMPLES, 0.0, product / count)
