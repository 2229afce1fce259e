"""One flight under two titles: cases whose windows hold the same samples.

A test that wants several conditions or repetitions is not shown by one flight twice, and two
records of a report are two flights.  File names do not show a copy, and the motion of two flights
that were flown alike does not show the difference.  The noise of the instruments shows both: no two
flights share it.  A smoothed copy has no noise; its motion agrees more closely than that of any two
flights (`flightmech.flown_samples`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from flightmech.flown_samples import FlownWindow, cut_windows, find_shared_windows
from flightmech.quantities import time_text
from pom.cases.case import PomCase
from pom.judging.conditions.condition_coverage import SHARED, SHARED_TESTS
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
"""Pairs of cases whose noise is compared, by test; each takes some milliseconds."""
MOST_MOTIONS = 500
"""Pairs of cases of a report whose motion is compared; each takes one to three milliseconds."""
LEVELS = ("V_cas", "theta", "q", "nz")
"""Channels whose ranges overlap in two windows that share samples, also if one is mirrored."""
LEAST_OVERLAP = 0.2
"""Share of the smaller range that overlaps; a window of the same samples has nearly all of it."""


@dataclass(frozen=True)
class _JudgedFlight:
    """Flight of a result, prepared for its comparisons with the others."""

    case: PomCase
    time: np.ndarray
    traces: Mapping[str, np.ndarray]
    windows: tuple[FlownWindow, ...]
    ranges: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, result: PomResult) -> _JudgedFlight:
        time = result.signals["time"].values.astype(float)
        traces = traces_of(result.signals, "flight")
        windows = cut_windows(Path(result.case.record).name, time, traces)
        ranges = {}
        for name in LEVELS:
            if name in traces:
                ranges[name] = float(np.nanmin(traces[name])), float(np.nanmax(traces[name]))
        return cls(result.case, time, traces, tuple(windows), ranges)

    @property
    def test(self) -> tuple[str, str, str]:
        return self.case.standard, self.case.edition, self.case.id

    @property
    def record(self) -> Path:
        return Path(self.case.record)


def shared_flight_remarks(results: Sequence[PomResult]) -> list[tuple[RowRemark, ...]]:
    """Return the remarks on flights that several cases of a report show, per result.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of tuple of RowRemark
        Of kind ``departure`` on the later case of a test, and on the later case of any test if its
        record is a copy of another one.  Of kind ``record_warning`` on the later case of another
        test that names the same record: rules let some tests be flown together.  Of kind ``probe``
        on the earlier case, and on a case that states itself as additional, which counts for
        nothing.
    """
    remarks: list[tuple[RowRemark, ...]] = [() for _ in results]
    flown = [k for k, result in enumerate(results) if result.case.reference == "flight"]
    flights = {k: _JudgedFlight.of(results[k]) for k in flown}
    # cases of the same test first: one flight counts once there
    search = _SharedSearch()
    for place, second in enumerate(flown):
        later = flights[second]
        earlier = sorted(flown[:place], key=lambda k: flights[k].test != later.test)
        for first in earlier:
            part = search.common_part(flights[first], later)
            if not part:
                continue
            remarks[second] += (_later_remark(flights[first], later, part),)
            if not remarks[first]:
                text = _shared_text(later.case, part)
                remarks[first] += (RowRemark("probe", text, SHARED),)
            # one earlier case is enough
            break
    if search.skipped:
        text = f"{search.skipped} pairs of cases were not searched for shared samples"
        for k in flown:
            remarks[k] += (RowRemark("probe", text, SHARED),)
    return remarks


def _later_remark(earlier: _JudgedFlight, later: _JudgedFlight, part: str) -> RowRemark:
    text = _shared_text(earlier.case, part)
    if later.case.additional:
        return RowRemark("probe", text, SHARED)
    if earlier.test == later.test:
        return RowRemark("departure", f"departure: {text}; one flight counts once", SHARED)
    if earlier.record == later.record:
        text = f"record: {text}; state that both tests are flown together"
        return RowRemark("record_warning", text, SHARED_TESTS)
    text = f"departure: {text}; name one record in both cases, if both tests are flown together"
    return RowRemark("departure", text, SHARED_TESTS)


def _shared_text(other: PomCase, part: str) -> str:
    return f"the same flight is judged as case {other.name} ({other.title}): {part}"


class _SharedSearch:
    """Search for common samples of pairs, and the number of pairs that were left out."""

    def __init__(self) -> None:
        self.skipped = 0
        self._noises: Counter[tuple[str, str, str]] = Counter()
        self._motions = 0

    def common_part(self, first: _JudgedFlight, second: _JudgedFlight) -> str:
        """Return what two flights have in common as a text; empty if it is less than `MOST`."""
        a, b = first.case, second.case
        least = MOST * min(a.window[1] - a.window[0], b.window[1] - b.window[0])
        if first.record == second.record:
            start, stop = max(a.window[0], b.window[0]), min(a.window[1], b.window[1])
            return (
                f"{time_text(start)} ... {time_text(stop)} s of one record"
                if stop - start > least
                else ""
            )
        is_same_test = first.test == second.test
        if not is_same_test and not _do_ranges_overlap(first, second):
            return ""
        kind, correlation, overlap = "noise", 0.0, 0.0
        # A case that shows few channels of the motion has its noise alone.
        if is_same_test or not (first.windows and second.windows):
            self._noises[first.test] += 1
            if self._noises[first.test] > MOST_PAIRS:
                self.skipped += 1
                return ""
            correlation, overlap = compare_noise(
                first.time, first.traces, second.time, second.traces
            )
        if correlation < ALIKE and first.windows and second.windows:
            self._motions += 1
            if self._motions > MOST_MOTIONS:
                self.skipped += 1
                return ""
            kind = "motion"
            correlation, overlap = compare_motion(first, second)
        if correlation < ALIKE or overlap <= least:
            return ""
        return (
            f"{overlap:.1f} s of {first.record.name} are in {second.record.name}, correlation of "
            f"the {kind} {min(correlation, 1.0):.4g}"
        )


def _do_ranges_overlap(first: _JudgedFlight, second: _JudgedFlight) -> bool:
    """Return whether two flights have common values in each of `LEVELS`."""
    for name in first.ranges.keys() & second.ranges.keys():
        (low_a, high_a), (low_b, high_b) = first.ranges[name], second.ranges[name]
        overlap = min(high_a, high_b) - max(low_a, low_b)
        if overlap < LEAST_OVERLAP * min(high_a - low_a, high_b - low_b):
            return False
    return True


def compare_motion(first: _JudgedFlight, second: _JudgedFlight) -> tuple[float, float]:
    """Return correlation and length [s] of the longest part that two flights share, or zeros."""
    shared = find_shared_windows(first.windows, second.time, second.traces)
    if not shared:
        return 0.0, 0.0
    longest = max(shared, key=lambda item: item.stop - item.start)
    return longest.correlation, longest.stop - longest.start


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
