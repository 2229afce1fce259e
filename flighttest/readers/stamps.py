"""The clock of a table: from raw stamps to a rising clock in seconds, with every fault flagged.

Counters that wrap are unrolled, stray stamps dropped, repeated ones too.  A clock that is set back is refused unless the name map states
``reset = true``: samples recorded twice or files glued together would otherwise pass for one flight.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightmech.errors import SchemaError
from flightmech.support.arrays import median

from ..signals.conditioning import GAP
from ..signals.sample_flags import MOST, Flag
from .name_map import Clock

_COUNTERS = tuple(float(2**bits) for bits in (16, 24, 31, 32))  # in counts of the clock
_PERIODS = (60.0, 3600.0, 86400.0, 604800.0)  # s: minute, hour, day, week of satellite time
_NEAR = 5.0  # a wrap continues the clock within so many median steps
_STRAY = 10.0  # median steps off the neighbours


@dataclass
class Settled:
    """A rising clock [s], the raw samples that belong to it, the flags, and attributes for the leaf."""

    time: np.ndarray
    keep: np.ndarray
    flags: list[Flag] = field(default_factory=list)
    about: dict[str, Any] = field(default_factory=dict)


def settled(raw: np.ndarray, clock: Clock, scale: float, what: str) -> Settled:
    """Return the clock of a table.

    Parameters
    ----------
    raw : array (time,)
        Stamps as recorded.
    clock : Clock
        What the name map states about them.
    scale : float
        Seconds in one unit of `raw`.
    what : str
        File and leaf, for the errors.

    Raises
    ------
    SchemaError
        Fewer than two stamps, a clock that goes back, stamps too coarse for their samples.
    """
    time = np.asarray(raw, float) * scale
    finite = np.isfinite(time)
    keep, lost = np.flatnonzero(finite), np.flatnonzero(~finite)
    if len(keep) < 2:
        raise SchemaError(what, [f"its clock has {len(time)} samples, {len(lost)} of them NaN; at least two finite ones are needed"])
    time = time[keep]
    found: list[Flag] = []
    if (np.diff(time) < 0.0).any():
        time, wraps = _unrolled(time, clock.wrap, scale)
        found += [Flag("", "wrap", time[i], time[i + 1], 1, f"period {period:g} s") for i, period in wraps]
        good = _on_course(time)
        lost = np.concatenate([lost, keep[~good]])
        keep, time = keep[good], time[good]
    if len(lost):
        at = time[np.clip(np.searchsorted(keep, np.sort(lost)), 0, len(time) - 1)]
        found.append(Flag("", "stray", float(at[0]), float(at[-1]), len(lost)))
    time, resets = _risen(time, clock.reset, what)
    found += resets
    if clock.rate is not None:
        time = _even(time, clock.rate, what)
    else:
        time, keep, twice = _unique(time, keep, what)
        found += twice
    time = time[0] + (time - time[0]) / (1.0 + clock.drift) + clock.offset
    found = [flag._replace(start=flag.start + clock.offset, stop=flag.stop + clock.offset) for flag in found]
    step = np.diff(time)
    usual = median(step)
    gaps = np.flatnonzero(step > GAP * usual)
    found += [Flag("", "gap", float(time[i]), float(time[i + 1]), 0, f"{step[i]:.3g} s") for i in gaps[:MOST]]
    words = ", ".join(f"{time[i]:g} s ({step[i]:.3g} s)" for i in gaps[:MOST])
    repeated = sum(flag.samples for flag in found if flag.kind == "duplicate")
    return Settled(time, keep, found, {"rate": 1.0 / usual, "gaps": words, "duplicates": repeated})


def _unrolled(time: np.ndarray, period: float | None, scale: float) -> tuple[np.ndarray, list[tuple[int, float]]]:
    """Return the clock with its wraps undone, and where they were with their period."""
    step = np.diff(time)
    back = np.flatnonzero(step < 0.0)
    forward = step[step > 0.0]
    usual = median(forward) if len(forward) else 0.0
    candidates = (period,) if period is not None else tuple(count * scale for count in _COUNTERS) + _PERIODS
    shift, wraps = np.zeros(len(time)), []
    for i in back:
        for one in candidates:
            if (0.5 * one < -step[i] <= one) if period is not None else (0.0 < step[i] + one <= _NEAR * usual):
                shift[i + 1 :] += one
                wraps.append((int(i), float(one)))
                break
    return time + shift, wraps


def _on_course(time: np.ndarray) -> np.ndarray:
    """Return which stamps lie near the median of themselves and two neighbours on each side."""
    step = np.diff(time)
    if len(time) < 5 or not (step < 0.0).any():
        return np.ones(len(time), bool)
    padded = np.concatenate([time[2:0:-1] - 2 * (time[2:0:-1] - time[0]), time, 2 * time[-1] - time[-2:-4:-1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
    return np.abs(time - np.median(windows, axis=1)) <= _STRAY * float(np.median(np.abs(step)))


def _risen(time: np.ndarray, reset: bool, what: str) -> tuple[np.ndarray, list[Flag]]:
    step = np.diff(time)
    back = np.flatnonzero(step < 0.0)
    if not len(back):
        return time, []
    at = int(back[0])
    if not reset:
        text = f"time does not rise: {time[at]:g} s is followed by {time[at + 1]:g} s (sample {at + 1})"
        raise SchemaError(what, [f"{text}; split or sort the file, or set reset = true for its clock in the name map"])
    rising = step[step > 0.0]
    if not len(rising):
        raise SchemaError(what, [f"time only falls, from {time[0]:g} s to {time[-1]:g} s; sort the file"])
    jump = np.zeros(len(time))
    jump[back + 1] = float(np.median(rising)) - step[back]
    moved = time + np.cumsum(jump)
    return moved, [Flag("", "reset", float(moved[i]), float(moved[i + 1]), 1, f"by {-step[i]:.6g} s") for i in back[:MOST]]


def _even(time: np.ndarray, rate: float, what: str) -> np.ndarray:
    even = time[0] + np.arange(len(time)) / rate
    resolution = float(np.max(np.diff(time), initial=1.0 / rate))
    error = float(np.max(np.abs(even - time)))
    if error > resolution + 1.0 / rate:
        text = f"stamps and rate = {rate:g} Hz drift apart by {error:.3g} s over {time[-1] - time[0]:.6g} s"
        raise SchemaError(what, [f"{text}; give the rate with more digits, or leave it out"])
    return even


def _unique(time: np.ndarray, keep: np.ndarray, what: str) -> tuple[np.ndarray, np.ndarray, list[Flag]]:
    new = np.concatenate([[True], np.diff(time) > 0.0])
    repeated = int((~new).sum())
    if not repeated:
        return time, keep, []
    if repeated > 0.5 * len(time):
        share = len(time) / int(new.sum())
        text = f"{repeated} of {len(time)} stamps repeat the one before, {share:.3g} samples to each"
        raise SchemaError(what, [f"{text}: the clock is too coarse; give rate = ... for it in the name map, or another clock column"])
    first = time[~new]
    return time[new], keep[new], [Flag("", "duplicate", float(first[0]), float(first[-1]), repeated)]
