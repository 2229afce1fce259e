"""Flags of faulty samples and clocks of a record.

Reading a record never removes flags.  Each leaf has its flags in the attribute ``flags`` (JSON, so
that files store them).  Kinds:

========== =========================================================================================
gap        the clock steps by more than 3.5 median steps
wrap       the counter of the clock started again and was unrolled
stray      stamps far off the clock, or not finite; their samples are dropped
duplicate  repeated stamps; their samples are dropped
reset      the clock was set back; its samples were moved behind the earlier ones, as the name map
           requests
missing    NaN samples
outside    raw values beyond the calibration table, or infinite, now NaN
held       a value that repeats for long in a channel that otherwise changes from sample to sample,
           and then jumps
spike      one to three samples far off both neighbours
========== =========================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flightmech.names import WRAPPED
from flightmech.quantities import time_text
from flightmech.support.arrays import median, true_runs

KINDS = ("gap", "wrap", "stray", "duplicate", "reset", "missing", "outside", "held", "spike")
MOST = 20
"""Largest number of spans of one kind on one channel. The last span then covers all the rest."""
# Shortest time and number of samples of a held value. [s], [1]
HELD_TIME = 0.5
HELD_SAMPLES = 10
# Smallest step after a held value, in typical steps of the channel.
RETURN = 8.0
# Length of a held value at the end of the record, in longest runs before it.
DEAD = 10.0
# Smallest step of a spike, in typical steps of the channel, and in steps near the spike.
SPIKE = 20.0
BURST = 4.0
# Samples of a spike, and steps on each side that are near it.
_WIDEST_SPIKE = 3
_NEAR_STEPS = 5
# Steps that are enough for the median size of all steps.
_MEDIAN_STEPS = 20_000


class Flag(NamedTuple):
    """One span of samples.

    `channel` is empty for a flag of the clock.  Times are seconds of the record.
    """

    channel: str
    kind: str
    start: float
    stop: float
    samples: int
    note: str = ""


def read_stored_flags(text: str) -> list[Flag]:
    """Return the flags in an attribute; none if another program wrote it."""
    try:
        return [Flag(*row) for row in json.loads(text)]
    except (ValueError, TypeError):
        return []


def as_text(flags: Iterable[Flag]) -> str:
    """Return flags as the text of the attribute."""
    return json.dumps([list(flag) for flag in flags])


def flag_sentences(flags: Iterable[Flag]) -> list[str]:
    """Return one sentence per channel and kind."""
    groups: dict[tuple[str, str], list[Flag]] = {}
    for flag in flags:
        groups.setdefault((flag.channel, flag.kind), []).append(flag)
    return [_sentence(channel, kind, group) for (channel, kind), group in groups.items()]


def _sentence(channel: str, kind: str, group: list[Flag]) -> str:
    total = sum(flag.samples for flag in group)
    times = []
    for flag in group[:5]:
        note = f" ({flag.note})" if flag.note else ""
        times.append(f"{time_text(flag.start)} s{note}")
    spans = ", ".join(times)
    if len(group) > 5:
        spans += f" and {len(group) - 5} more"
    first = f"{time_text(group[0].start)} s"
    sentences = {
        "gap": f"gaps in the clock at {spans}",
        "wrap": f"clock wrapped round and unrolled at {spans}",
        "stray": f"samples with stamps off the clock dropped: {total} from {spans}",
        "duplicate": f"repeated time stamps dropped: {total} from {spans}",
        "reset": f"clock set back at {spans}",
        "missing": f"NaN samples: {channel} {total} from {first}",
        "outside": f"raw values beyond the calibration table, or infinite, now NaN: {channel} "
        f"{total} from {first}",
        "held": f"value held: {channel} at {spans}",
        "spike": f"spikes: {channel} {len(group)} at {spans}",
    }
    return sentences[kind]


def flag_runs(
    time: np.ndarray, bad: np.ndarray, channel: str, kind: str, note: str = ""
) -> list[Flag]:
    """Return the runs of a mask as flags."""
    if not bad.any():
        return []
    runs = true_runs(bad)
    flags = []
    for first, end in runs[:MOST]:
        start, stop = float(time[first]), float(time[end - 1])
        flags.append(Flag(channel, kind, start, stop=stop, samples=end - first, note=note))
    if len(runs) > MOST:
        # The last flag covers all the rest.
        first = runs[MOST - 1][0]
        flags[-1] = Flag(
            channel,
            kind,
            float(time[first]),
            stop=float(time[runs[-1][1] - 1]),
            samples=int(bad[first:].sum()),
            note=f"{len(runs) - MOST + 1} spans",
        )
    return flags


def sample_faults(time: np.ndarray, x: np.ndarray, channel: str, rate: float) -> list[Flag]:
    """Return the flags of one channel: NaN, held values and spikes.

    Parameters
    ----------
    time, x : array (time,)
        Rising stamps [s] and samples.
    channel : str
        Canonical name.
    rate : float
        Samples per second. [Hz]

    Notes
    -----
    The typical step is the median size of the steps that are not zero.

    Held values are searched in channels of which more than half of all steps differ from zero.  A
    held value is a run of `HELD_SAMPLES` equal samples over `HELD_TIME`.  It ends with a step of
    `RETURN` typical steps and twice the steps after it.  (A parked aeroplane and a trimmed
    simulation hold their values too, but continue smoothly.)  Or it lasts to the end of the record,
    `DEAD` times longer than every run before.

    A spike leaves and returns by more than `SPIKE` typical steps and `BURST` times every other step
    within five samples.
    """
    faults = flag_runs(time, np.isnan(x), channel, "missing")
    step = _steps(x, channel)
    typical = _typical_step(step)
    if typical is None:
        return faults
    size = np.abs(step)
    if np.count_nonzero(size) > 0.5 * len(size):
        is_held = _is_held(size, typical, rate)
        faults += flag_runs(time, is_held, channel, "held")
    return faults + flag_runs(time, _is_spike(step, typical), channel, "spike")


def find_spikes(x: np.ndarray, channel: str) -> np.ndarray:
    """Return which samples of a channel are spikes, see `sample_faults` (time,)."""
    step = _steps(x, channel)
    typical = _typical_step(step)
    if typical is None:
        return np.zeros(len(x), bool)
    return _is_spike(step, typical)


def _steps(x: np.ndarray, channel: str) -> np.ndarray:
    """Return the steps from sample to sample; a full turn of an angle is not a step."""
    step = np.diff(x)
    if channel not in WRAPPED:
        return step
    return np.where(np.abs(step) > np.pi, (step + np.pi) % (2.0 * np.pi) - np.pi, step)


def _typical_step(step: np.ndarray) -> float | None:
    """Return the median size of the steps that are not zero.

    The result is None for a channel that is too short or constant.
    """
    size = np.abs(step)
    sample = size[:: max(1, len(size) // _MEDIAN_STEPS)]
    sample = sample[np.isfinite(sample) & (sample > 0.0)]
    if len(step) < HELD_SAMPLES or not len(sample):
        return None
    return median(sample)


def _is_held(size: np.ndarray, typical: float, rate: float) -> np.ndarray:
    """Return which samples repeat a held value, from the sizes of the steps."""
    required = max(HELD_SAMPLES - 1, round(HELD_TIME * rate))
    # A run lies between two steps that are not zero.
    bounds = np.concatenate([[-1], np.flatnonzero(size != 0.0), [len(size)]])
    runs = np.diff(bounds) - 1
    is_held = np.zeros(len(size) + 1, bool)
    for i in np.flatnonzero(runs >= required):
        end = bounds[i + 1]
        if end == len(size):
            longest = max(int(np.max(runs[:-1], initial=0)), HELD_SAMPLES)
            is_stuck = runs[i] > DEAD * longest
        else:
            jump, after = size[end], size[end + 1 : end + 1 + _NEAR_STEPS]
            is_stuck = bool(jump > RETURN * typical and jump > 2.0 * np.max(after, initial=0.0))
        is_held[bounds[i] + 1 : end + 1] = is_stuck
    return is_held


def _is_spike(step: np.ndarray, typical: float) -> np.ndarray:
    """Return which samples are spikes, from the steps of the channel."""
    size, is_spike = np.abs(step), np.zeros(len(step) + 1, bool)
    large = np.flatnonzero(size > SPIKE * typical)
    # Many large steps are the motion of the channel.
    if not len(large) or len(large) > max(10.0, 0.1 * len(size)):
        return is_spike
    for leaving, returning in pairwise(large):
        is_wide = returning - leaving > _WIDEST_SPIKE
        # signs, not the product: it overflows for 1e308 in a damaged file
        if is_wide or np.sign(step[leaving]) == np.sign(step[returning]):
            continue
        before = size[max(0, leaving - _NEAR_STEPS) : leaving]
        after = size[returning + 1 : returning + 1 + _NEAR_STEPS]
        near = np.concatenate([before, size[leaving + 1 : returning], after])
        largest = np.max(near, initial=0.0, where=np.isfinite(near))
        smaller, larger = sorted((size[leaving], size[returning]))
        if smaller > 0.5 * larger and smaller > BURST * largest:
            is_spike[leaving + 1 : returning + 1] = True
    return is_spike
