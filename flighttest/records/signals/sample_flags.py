"""Flags: what is wrong with samples and clocks of a record, kept with it and never removed by
reading.

Each leaf carries its flags in the attribute ``flags`` (JSON, so that files keep them).  Kinds:

========== ==================================================================================================
gap        the clock steps by more than three median steps
wrap       the clock's counter started again and was unrolled
stray      stamps far off the clock, or no numbers; their samples are dropped
duplicate  repeated stamps; their samples are dropped
reset      the clock was set back and its samples were moved behind those before, as the name map requested
missing    NaN samples
outside    raw values beyond the calibration table, or infinite, now NaN
held       a value that repeats for long in a channel that otherwise changes from sample to sample, and then jumps
spike      one to three samples far off both neighbours
========== ==================================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.support.arrays import median

ENDLESS = ("psi", "phi", "lon")  # angles that go on at zero behind a full turn
KINDS = ("gap", "wrap", "stray", "duplicate", "reset", "missing", "outside", "held", "spike")
MOST = 20  # spans kept for one kind on one channel; the last one then covers all the rest
HELD_TIME = 0.5  # s
HELD_SAMPLES = 10
RETURN = 8.0  # typical steps of the channel
DEAD = 10.0  # times the longest run before
SPIKE = 20.0  # typical steps of the channel
BURST = 4.0  # a spike is so many times larger than every other step near it


class Flag(NamedTuple):
    """One span of samples: `channel` is empty when the clock of the leaf is meant; times in seconds
    of the record.
    """

    channel: str
    kind: str
    start: float
    stop: float
    samples: int
    note: str = ""


def flags(record: xr.DataTree) -> pd.DataFrame:
    """Return every flag of a record.

    Returns
    -------
    DataFrame
        Columns ``leaf channel kind start stop samples note``; times in seconds.  ``channel`` is
        empty for flags of the clock.
    """

    rows = [
        {"leaf": leaf, **Flag(*row)._asdict()}
        for leaf, node in record.children.items()
        for row in json.loads(node.attrs.get("flags", "[]"))
    ]
    return pd.DataFrame(rows, columns=["leaf", *Flag._fields])


def add_flags(record: xr.DataTree, leaf: str, found: Iterable[Flag]) -> xr.DataTree:
    """Return the record with more flags on a leaf; equal ones are kept once.

    Raises
    ------
    UnknownName
        No such leaf, channel or kind.
    """
    if leaf not in record.children:
        raise UnknownName(leaf, record.children, "leaf")
    found = list(found)
    for flag in found:
        if flag.kind not in KINDS:
            raise UnknownName(flag.kind, KINDS, "kind of flag")
        if flag.channel and flag.channel not in record.children[leaf].data_vars:
            raise UnknownName(flag.channel, map(str, record.children[leaf].data_vars), "channel")
    flagged = record.copy()
    flagged[leaf].attrs["flags"] = as_text(
        dict.fromkeys([*read_stored_flags(flagged[leaf].attrs.get("flags", "[]")), *found])
    )
    return flagged


def read_stored_flags(text: str) -> list[Flag]:
    """Return the flags in an attribute; none when it is not ours."""
    try:
        return [Flag(*row) for row in json.loads(text)]
    except (ValueError, TypeError):
        return []


def as_text(found: Iterable[Flag]) -> str:
    """Return flags as the text of the attribute."""
    return json.dumps([list(flag) for flag in found])


def flag_sentences(found: Iterable[Flag]) -> list[str]:
    """Return one sentence per channel and kind."""
    groups: dict[tuple[str, str], list[Flag]] = {}
    for flag in found:
        groups.setdefault((flag.channel, flag.kind), []).append(flag)
    return [_sentence(channel, kind, group) for (channel, kind), group in groups.items()]


def _sentence(channel: str, kind: str, group: list[Flag]) -> str:
    total = sum(flag.samples for flag in group)
    places = ", ".join(f"{m.start:g} s" + (f" ({m.note})" if m.note else "") for m in group[:5])
    more = f" and {len(group) - 5} more" if len(group) > 5 else ""
    text = {
        "gap": f"gaps in the clock at {places}{more}",
        "wrap": f"clock wrapped round and unrolled at {places}{more}",
        "stray": f"samples with stamps off the clock dropped: {total} from {places}{more}",
        "duplicate": f"repeated time stamps dropped: {total} from {places}{more}",
        "reset": f"clock set back at {places}{more}",
        "missing": f"NaN samples: {channel} {total} from {group[0].start:g} s",
        "outside": f"raw values beyond the calibration table, or infinite, now NaN: {channel} "
        f"{total} from {group[0].start:g} s",
        "held": f"value held: {channel} at {places}{more}",
        "spike": f"spikes: {channel} {len(group)} at {places}{more}",
    }
    return text[kind]


def flag_runs(
    time: np.ndarray, bad: np.ndarray, channel: str, kind: str, note: str = ""
) -> list[Flag]:
    """Return the runs of a mask as flags."""
    if not bad.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    found = [
        Flag(channel, kind, float(time[a]), float(time[b - 1]), int(b - a), note)
        for a, b in zip(starts[:MOST], stops[:MOST], strict=True)
    ]
    if len(starts) > MOST:
        rest = int(bad[starts[MOST - 1] :].sum())
        found[-1] = Flag(
            channel,
            kind,
            float(time[starts[MOST - 1]]),
            float(time[stops[-1] - 1]),
            rest,
            f"{len(starts) - MOST + 1} spans",
        )
    return found


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
    Typical is the median size of the steps that are not zero.  Held values are looked for in channels of which more than half of all steps
    differ from zero: a run of `HELD_SAMPLES` equal samples over `HELD_TIME` that ends with a step `RETURN` times the typical one and twice
    those after it (a parked aeroplane and a trimmed simulation hold their values too, but go on smoothly), or one to the end of the record,
    `DEAD` times longer than every run before.
    A spike leaves and returns by more than `SPIKE` typical steps and `BURST` times every other step within five samples.
    """
    found = flag_runs(time, np.isnan(x), channel, "missing")
    step = _steps(x, channel)
    typical = _typical(step)
    if typical is None:
        return found
    size = np.abs(step)
    if np.count_nonzero(size) > 0.5 * len(size):
        found += _held(time, size, typical, channel, rate)
    return found + flag_runs(time, _spikes(step, typical), channel, "spike")


def find_spikes(x: np.ndarray, channel: str) -> np.ndarray:
    """Return which samples of a channel are spikes, see `sample_faults` (time,)."""
    step = _steps(x, channel)
    typical = _typical(step)
    return np.zeros(len(x), bool) if typical is None else _spikes(step, typical)


def _steps(x: np.ndarray, channel: str) -> np.ndarray:
    """Return the steps from sample to sample; an angle that passes its full turn makes none."""
    step = np.diff(x)
    return (
        np.where(np.abs(step) > np.pi, (step + np.pi) % (2.0 * np.pi) - np.pi, step)
        if channel in ENDLESS
        else step
    )


def _typical(step: np.ndarray) -> float | None:
    """Return the median size of the steps that are not zero; None for a channel too short or at
    rest.
    """
    size = np.abs(step)
    sample = size[:: max(1, len(size) // 20_000)]  # enough for a median
    sample = sample[np.isfinite(sample) & (sample > 0.0)]
    return median(sample) if len(step) >= HELD_SAMPLES and len(sample) else None


def _held(
    time: np.ndarray, size: np.ndarray, typical: float, channel: str, rate: float
) -> list[Flag]:
    needed = max(HELD_SAMPLES - 1, round(HELD_TIME * rate))
    bounds = np.concatenate([[-1], np.flatnonzero(size != 0.0), [len(size)]])
    runs = np.diff(bounds) - 1
    long = np.flatnonzero(runs >= needed)
    bad = np.zeros(len(time), bool)
    for i in long:
        to_the_end = bounds[i + 1] == len(size)
        if to_the_end:
            stuck = runs[i] > DEAD * max(int(np.max(runs[:-1], initial=0)), HELD_SAMPLES)
        else:
            jump, after = size[bounds[i + 1]], size[bounds[i + 1] + 1 : bounds[i + 1] + 6]
            stuck = bool(jump > RETURN * typical and jump > 2.0 * np.max(after, initial=0.0))
        bad[bounds[i] + 1 : bounds[i + 1] + 1] = stuck
    return flag_runs(time, bad, channel, "held")


def _spikes(step: np.ndarray, typical: float) -> np.ndarray:
    size, bad = np.abs(step), np.zeros(len(step) + 1, bool)
    large = np.flatnonzero(size > SPIKE * typical)
    if not len(large) or len(large) > max(10.0, 0.1 * len(size)):
        return bad
    for out, back in pairwise(large):
        width = back - out
        if width > 3 or step[out] * step[back] > 0.0:
            continue
        small, great = sorted((size[out], size[back]))
        near = np.concatenate(
            [size[max(0, out - 5) : out], size[out + 1 : back], size[back + 1 : back + 6]]
        )
        if small > 0.5 * great and small > BURST * np.max(
            near, initial=0.0, where=np.isfinite(near)
        ):
            bad[out + 1 : back + 1] = True
    return bad
