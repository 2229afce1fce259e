"""Samples of a stream on one clock: stretches without a gap, short gaps bridged, jumps found.

A stream has a nominal sampling interval. A stamp within half of it of its place continues the
stretch. The places follow the stamps: an interval that is not exactly the nominal one does not add
up to a gap. Up to `BRIDGED` seconds without samples are filled with a straight line. After a longer
gap, or a jump of the clock, a new stretch begins. A stamp that repeats is left out. All of it is
counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.quantities import time_text

BRIDGED = 0.15  # longest gap that a straight line fills [s]
_FIRST = 25  # stamps from which the sampling interval is taken
_OTHER = 0.05  # relative difference of stated and seen interval that is a mistake
_NEAR = 0.01  # largest relative difference from a whole number of hertz that may be rounding
_FINEST = 1e-6  # relative accuracy of the interval that no stamps exceed
# Share of the departure of a stamp from its place by which the next places move. An interval that
# is wrong by `_OTHER` then shifts the stamps by _OTHER/_FOLLOWED = 0.25 of it, half of what is
# allowed.
_FOLLOWED = 0.2
_LATE = 0.3  # parts of an interval that a late stamp lacks to the next place, where one is missing
_LONGEST = 4.0  # intervals without a stamp above which a step is a gap


@dataclass
class ClockedSamples:
    """Divides samples into stretches.

    Attributes
    ----------
    step : float
        Sampling interval; zero until it is known. [s]
    given : float
        Sampling interval that the user states; zero for none. Stamps that show another one within
        5 % have precedence. [s]
    bridged, gaps, jumps, repeated : int
        Samples that were filled in, gaps that were too long for it, jumps of the clock, and stamps
        that were left out.
    """

    step: float = 0.0
    given: float = 0.0
    bridged: int = 0
    gaps: int = 0
    jumps: int = 0
    repeated: int = 0
    _start: float = 0.0
    _count: int = 0
    _last_time: float = 0.0
    _last_row: np.ndarray | None = None
    _waiting: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def divide(
        self, time: np.ndarray, values: np.ndarray, final: bool = False
    ) -> Iterator[tuple[bool, np.ndarray, np.ndarray]]:
        """Yield parts of stretches: whether a new one begins, time, and values.

        Parameters
        ----------
        time : array (samples,)
            [s]
        values : array (samples, channels)
        final : bool
            Whether the stream ends here.
        """
        # The first samples determine the interval of the stream.
        if not self.step:
            if len(time):
                self._waiting.append((time, values))
            if not self._waiting:
                return
            waiting = np.concatenate([part[0] for part in self._waiting])
            if len(waiting) < _FIRST and not (final and len(waiting) > 1):
                return
            self.step = _sampling_interval(waiting, self.given)
            time, values = waiting, np.concatenate([part[1] for part in self._waiting])
            self._waiting = []
        starts_new = False
        times: list[float] = []
        rows: list[np.ndarray] = []
        for t, row in zip(time.tolist(), values):
            is_first = self._last_row is None
            since = t - self._last_time
            place = (t - self._start) / self.step - self._count
            # Number of samples between the last one and this one.
            missing = 0 if is_first else round(place)
            if missing and abs(since) < 0.5 * self.step:
                self.repeated += 1
                continue
            is_short = 0 <= missing * self.step <= BRIDGED
            if missing and is_short and self._last_row is not None:
                times += self._bridge(missing, self._last_row, row, rows)
            if is_first or not is_short:
                if rows or starts_new:
                    yield starts_new, np.array(times), np.array(rows)
                if not is_first:
                    self._count_break(since)
                starts_new, times, rows = True, [], []
                self._start, self._count = t, 0
            else:
                self._start += _FOLLOWED * (place - missing) * self.step
            times.append(t)
            rows.append(row)
            self._count += 1
            self._last_time, self._last_row = t, row
        if rows:
            yield starts_new, np.array(times), np.array(rows)

    def _bridge(
        self, missing: int, before: np.ndarray, row: np.ndarray, rows: list[np.ndarray]
    ) -> list[float]:
        """Append samples of a straight line to the next sample; return their times."""
        times = []
        for k in range(1, missing + 1):
            share = k / (missing + 1.0)
            rows.append((1.0 - share) * before + share * row)
            times.append(self._start + self._count * self.step)
            self._count += 1
        self.bridged += missing
        return times

    def _count_break(self, since: float) -> None:
        if since < 0.0:
            self.jumps += 1
        else:
            self.gaps += 1


def _sampling_interval(time: np.ndarray, given: float) -> float:
    """Return the sampling interval of the first stamps. [s]

    It is the stated one, or that of a whole number of hertz, if the stamps do not contradict it.

    Parameters
    ----------
    time : array (samples,)
        [s]
    given : float
        Stated interval; zero for none. [s]
    """
    steps = np.diff(time)
    steps = steps[steps > 0.0]
    if not len(steps):
        raise IdentificationError(
            f"the clock stands at {time_text(time[0])} s in the first {len(time)} samples; time "
            "must rise"
        )
    usual = float(np.median(steps))
    steps = steps[steps < _LONGEST * usual]
    # A missing stamp makes a step of two intervals.
    counts = np.maximum(1.0, np.floor(steps / usual + _LATE))
    seen = float(steps.sum() / counts.sum())
    # Rounded stamps differ by one unit of their last digit, late ones by more. The sum of the steps
    # has that error once.
    single = steps[counts == 1.0]
    resolution = float(np.ptp(single)) if len(single) else 0.0
    error = max(_FINEST, resolution / float(steps.sum()))
    if given:
        if abs(seen - given) > _OTHER * given:
            raise IdentificationError(
                f"the stamps of the stream have {1.0 / seen:.4g} Hz, {1.0 / given:.4g} Hz is "
                f"stated; leave the rate out, or correct the unit of the clock"
            )
        return given if abs(seen - given) <= error * given else seen
    whole = max(1.0, float(round(1.0 / seen)))
    return 1.0 / whole if abs(whole * seen - 1.0) <= min(error, _NEAR) else seen
