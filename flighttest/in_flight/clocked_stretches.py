"""Samples of a stream on one clock: stretches without a gap, short gaps bridged, jumps found.

A stream has a nominal sampling interval. A stamp within half of it of its place continues the
stretch. Up to `BRIDGED` seconds without samples are filled with a straight line. After a longer gap,
or a jump of the clock, a new stretch begins. A stamp that repeats is left out. All of it is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from flightmech.errors import IdentificationError

BRIDGED = 0.15  # longest gap that a straight line fills [s]
_FIRST = 25  # stamps from which the sampling interval is taken
_OTHER = 0.05  # relative difference of stated and seen interval that is a mistake
_NEAR = 0.01  # relative difference from a whole number of hertz that is rounding of the stamps


@dataclass
class ClockedSamples:
    """Divides samples into stretches.

    Attributes
    ----------
    step : float
        Sampling interval; zero until it is known. [s]
    given : float
        Sampling interval that the user states; zero for none. [s]
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
        if not self.step:
            if len(time):
                self._waiting.append((time, values))
            if not self._waiting:
                return
            waiting = np.concatenate([part[0] for part in self._waiting])
            if len(waiting) < _FIRST and not (final and len(waiting) > 1):
                return
            self.step = _sampling_interval(waiting)
            if self.given:
                _demand_same(self.given, self.step)
                self.step = self.given
            time, values = waiting, np.concatenate([part[1] for part in self._waiting])
            self._waiting = []
        starts_new = False
        times: list[float] = []
        rows: list[np.ndarray] = []
        for t, row in zip(time.tolist(), values):
            place = (t - self._start) / self.step - self._count
            if self._last_row is None or not -0.5 <= place <= 0.5:
                since = t - self._last_time
                is_first = self._last_row is None
                if not is_first and abs(since) < 0.5 * self.step:
                    self.repeated += 1
                    continue
                missing = round(place)
                is_short = missing > 0 and missing * self.step <= BRIDGED
                if self._last_row is not None and is_short and abs(place - missing) <= 0.5:
                    times += self._bridge(missing, self._last_row, row, rows)
                    place = 0.0
                if is_first or place != 0.0:
                    if rows or starts_new:
                        yield starts_new, np.array(times), np.array(rows)
                    if not is_first:
                        self._count_break(since)
                    starts_new, times, rows = True, [], []
                    self._start, self._count = t, 0
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


def _demand_same(given: float, seen: float) -> None:
    """Raise when a stated sampling interval is not that of the stamps."""
    if abs(seen - given) > _OTHER * given:
        raise IdentificationError(
            f"the stamps of the stream have {1.0 / seen:.4g} Hz, {1.0 / given:.4g} Hz is stated; "
            f"leave the rate out, or correct the unit of the clock"
        )


def _sampling_interval(time: np.ndarray) -> float:
    """Return the sampling interval of the first stamps. [s]"""
    steps = np.diff(time)
    steps = steps[steps > 0.0]
    if not len(steps):
        raise IdentificationError(
            f"the clock stands at {time[0]:g} s in the first {len(time)} samples; time must rise"
        )
    usual = float(np.median(steps))
    near = steps[np.abs(steps - usual) < 0.5 * usual]
    # Stamps of three decimals at 60 Hz: their mean, and a whole number of hertz, have no rounding.
    rate = 1.0 / float(near.mean())
    if round(rate) >= 1 and abs(rate - round(rate)) < _NEAR * rate:
        rate = float(round(rate))
    return 1.0 / rate
