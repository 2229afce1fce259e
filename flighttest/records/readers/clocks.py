"""Clocks of the tables of a file: rising stamps in seconds, with every fault flagged.

Counters that wrap are unrolled.  Stray and repeated stamps are removed.  A clock that steps back is
refused unless the name map states ``reset = true``.  Otherwise samples that were recorded twice, or
joined files, would pass for one flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import time_text
from flightmech.support.arrays import median
from flighttest.records.readers.arinc429 import label_tables, words_of_columns
from flighttest.records.readers.bus_words import Arinc429
from flighttest.records.readers.columns import column_called, unit_of_column
from flighttest.records.readers.name_map import Clock, NameMap
from flighttest.records.readers.recording import (
    LeftOut,
    RecordedTable,
    clock_name,
    left_out_as,
    left_out_clock,
)
from flighttest.records.readers.times_of_day import seconds_of_digits
from flighttest.records.signals.resampling import GAP
from flighttest.records.signals.sample_flags import MOST, Flag

_COUNTERS = tuple(float(2**bits) for bits in (16, 24, 31, 32))  # in counts of the clock
_PERIODS = (60.0, 3600.0, 86400.0, 604800.0)  # s: minute, hour, day, week of satellite time
_NEAR = 5.0  # largest step across a wrap, in median steps
_STRAY = 10.0  # largest distance from the neighbours, in median steps
_LONGEST = 2 * 86400.0  # longest gap of a recording [s]


@dataclass
class TableClock:
    """A rising clock of a table.

    Attributes
    ----------
    time : array (sample,)
        Stamps. [s]
    samples : array (sample,) of int
        Raw samples that belong to the stamps.
    flags : list of Flag
    attributes : dict
        Attributes for the leaf of the record.
    """

    time: np.ndarray
    samples: np.ndarray
    flags: list[Flag] = field(default_factory=list)
    attributes: dict[str, Any] = field(default_factory=dict)


def rising_clock(
    raw: np.ndarray, clock: Clock, scale: float, what: str, origin: float | None = None
) -> TableClock:
    """Return the clock of a table.

    Parameters
    ----------
    raw : array (time,)
        Recorded stamps.
    clock : Clock
        Description of the stamps in the name map.
    scale : float
        Seconds in one unit of `raw`.
    what : str
        File and leaf, for the errors.
    origin : float, optional
        Stamp from which the drift counts; by default the first one. [s]

    Raises
    ------
    SchemaError
        There are fewer than two stamps, the clock steps back or has a gap of days, or the stamps
        are too coarse for their samples.
    """
    time = np.asarray(raw, float) * scale
    is_finite = np.isfinite(time)
    samples, lost = np.flatnonzero(is_finite), np.flatnonzero(~is_finite)
    if len(samples) < 2:
        raise SchemaError(
            what,
            [
                f"its clock has {len(time)} samples, {len(lost)} of them NaN; at least two "
                f"finite ones are needed"
            ],
        )
    time = time[samples]
    flags: list[Flag] = []
    if (np.diff(time) < 0.0).any():
        time, wraps = _unroll_wraps(time, clock.wrap, scale)
        for i, period in wraps:
            flags.append(
                Flag("", "wrap", time[i], stop=time[i + 1], samples=1, note=f"period {period:g} s")
            )
        is_near = _is_near_neighbours(time)
        lost = np.concatenate([lost, samples[~is_near]])
        samples, time = samples[is_near], time[is_near]
    if len(lost):
        # A stray sample is flagged at the next sample that remains.
        following = np.searchsorted(samples, np.sort(lost))
        stray = time[np.clip(following, 0, len(time) - 1)]
        flags.append(Flag("", "stray", float(stray[0]), stop=float(stray[-1]), samples=len(lost)))
    time, resets = _join_resets(time, clock.reset, what)
    flags += resets
    if clock.rate is not None:
        time = _even_stamps(time, clock.rate, what)
    else:
        time, samples, repeated = _remove_repeated(time, samples, what)
        flags += repeated
    if len(time) < 2:
        text = f"its clock has {len(raw)} samples of one stamp; at least two stamps are needed"
        raise SchemaError(what, [text])
    # A single damaged stamp makes a record of years, whose samples at a uniform step fill memory.
    gaps = np.diff(time)
    longest = int(np.argmax(gaps))
    if gaps[longest] > _LONGEST:
        text = (
            f"its clock goes from {time_text(time[0])} s to {time_text(time[-1])} s; the gap "
            "behind sample "
            f"{samples[longest]} at {time_text(time[longest])} s is longer than the "
            f"{_LONGEST / 86400:g} "
            "days "
            f"that are allowed: correct or remove these stamps"
        )
        raise SchemaError(what, [text])
    return _corrected_clock(
        time, samples, flags, clock, float(time[0]) if origin is None else origin
    )


def _corrected_clock(
    time: np.ndarray, samples: np.ndarray, flags: list[Flag], clock: Clock, origin: float
) -> TableClock:
    """Return the clock with drift and offset of the name map, and its gaps."""
    # The drift stretches the time from its origin, the offset shifts it.
    slope, shift = 1.0 / (1.0 + clock.drift), clock.offset
    time = origin + slope * (time - origin) + shift
    shifted = []
    for flag in flags:
        start, stop = (origin + slope * (at - origin) + shift for at in (flag.start, flag.stop))
        shifted.append(flag._replace(start=start, stop=stop))
    step = np.diff(time)
    usual_step = median(step)
    gaps = []
    # A few gaps are enough for a message.
    for i in np.flatnonzero(step > GAP * usual_step)[:MOST]:
        start, stop = float(time[i]), float(time[i + 1])
        shifted.append(Flag("", "gap", start, stop=stop, samples=0, note=f"{step[i]:.3g} s"))
        gaps.append(f"{time_text(time[i])} s ({step[i]:.3g} s)")
    attributes = {
        "rate": 1.0 / usual_step,
        "gaps": ", ".join(gaps),
        "duplicates": sum(flag.samples for flag in shifted if flag.kind == "duplicate"),
    }
    return TableClock(time, samples, shifted, attributes)


def _unroll_wraps(
    time: np.ndarray, period: float | None, scale: float
) -> tuple[np.ndarray, list[tuple[int, float]]]:
    """Return the clock without its wraps, and sample and period of each wrap."""
    step = np.diff(time)
    forward = step[step > 0.0]
    usual_step = median(forward) if len(forward) else 0.0
    if period is None:
        periods = tuple(count * scale for count in _COUNTERS) + _PERIODS
    else:
        periods = (period,)
    shift, wraps = np.zeros(len(time)), []
    for i in np.flatnonzero(step < 0.0):
        for candidate in periods:
            # A stated period is a wrap if the clock steps back by more than half of it.  Any other
            # period must continue the clock within a few steps.
            if period is not None:
                is_wrap = 0.5 * candidate < -step[i] <= candidate
            else:
                is_wrap = 0.0 < step[i] + candidate <= _NEAR * usual_step
            if is_wrap:
                shift[i + 1 :] += candidate
                wraps.append((int(i), float(candidate)))
                break
    return time + shift, wraps


def _is_near_neighbours(time: np.ndarray) -> np.ndarray:
    """Return which stamps are near the median of themselves and two neighbours on each side."""
    step = np.diff(time)
    if len(time) < 5 or not (step < 0.0).any():
        return np.ones(len(time), bool)
    # The ends are continued by point reflection, so that each stamp has four neighbours.
    before = time[2:0:-1] - 2 * (time[2:0:-1] - time[0])
    after = 2 * time[-1] - time[-2:-4:-1]
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, time, after]), 5)
    return np.abs(time - np.median(windows, axis=1)) <= _STRAY * float(np.median(np.abs(step)))


def _join_resets(time: np.ndarray, reset: bool, what: str) -> tuple[np.ndarray, list[Flag]]:
    """Return the clock with the samples after each backward step moved behind those before it."""
    step = np.diff(time)
    backward = np.flatnonzero(step < 0.0)
    if not len(backward):
        return time, []
    first = int(backward[0])
    if not reset:
        text = (
            f"time does not rise: {time_text(time[first])} s is followed by "
            f"{time_text(time[first + 1])} s (sample "
            f"{first + 1})"
        )
        raise SchemaError(
            what,
            [f"{text}; split or sort the file, or set reset = true for its clock in the name map"],
        )
    rising = step[step > 0.0]
    if not len(rising):
        raise SchemaError(
            what,
            [
                f"time only falls, from {time_text(time[0])} s to {time_text(time[-1])} s; sort "
                "the file"
            ],
        )
    # The samples continue one median step after the sample before the backward step.
    jump = np.zeros(len(time))
    jump[backward + 1] = float(np.median(rising)) - step[backward]
    joined = time + np.cumsum(jump)
    flags = []
    for i in backward[:MOST]:
        start, stop = float(joined[i]), float(joined[i + 1])
        flags.append(Flag("", "reset", start, stop=stop, samples=1, note=f"by {-step[i]:.6g} s"))
    return joined, flags


def _even_stamps(time: np.ndarray, rate: float, what: str) -> np.ndarray:
    """Return even stamps at a rate [Hz] from the first stamp on."""
    even = time[0] + np.arange(len(time)) / rate
    # Coarse stamps may differ from the even ones by their resolution, but not drift away.
    resolution = float(np.max(np.diff(time), initial=1.0 / rate))
    error = float(np.max(np.abs(even - time)))
    if error > resolution + 1.0 / rate:
        text = (
            f"stamps and rate = {rate:g} Hz drift apart by {error:.3g} s over "
            f"{time[-1] - time[0]:.6g} s"
        )
        raise SchemaError(what, [f"{text}; give the rate with more digits, or leave it out"])
    return even


def _remove_repeated(
    time: np.ndarray, samples: np.ndarray, what: str
) -> tuple[np.ndarray, np.ndarray, list[Flag]]:
    """Return stamps and samples without stamps that repeat the stamp before."""
    is_new = np.concatenate([[True], np.diff(time) > 0.0])
    repeated = int((~is_new).sum())
    if not repeated:
        return time, samples, []
    if repeated > 0.5 * len(time):
        share = len(time) / int(is_new.sum())
        text = (
            f"{repeated} of {len(time)} stamps repeat the one before, {share:.3g} samples to each"
        )
        raise SchemaError(
            what,
            [
                f"{text}: the clock is too coarse; give rate = ... for it in the name map, "
                f"or another clock column"
            ],
        )
    removed = time[~is_new]
    flag = Flag("", "duplicate", float(removed[0]), stop=float(removed[-1]), samples=repeated)
    return time[is_new], samples[is_new], [flag]


def _first_stamp(raw: np.ndarray, scale: float) -> float | None:
    """Return the first stamp that is a number; None without any. [s]"""
    stamps = np.asarray(raw, float)
    known = np.flatnonzero(np.isfinite(stamps))
    return float(stamps[known[0]]) * scale if known.size else None


class Clocks:
    """Clocks of the tables of one file by a name map."""

    def __init__(
        self,
        tables: Mapping[str, RecordedTable],
        names: NameMap,
        file: str,
        left_out: Sequence[LeftOut] = (),
    ):
        self.tables, self.names, self.file = dict(tables), names, file
        self.columns_used: set[tuple[str, str]] = set()
        self.notes: list[str] = []
        self._clocks: dict[str, TableClock] = {}
        self._left_out = left_out
        self._demand_tables(left_out)

    def _demand_tables(self, left_out: Sequence[LeftOut]) -> None:
        """Raise if the name map states the clock of a table that the file does not have."""
        # Tables of [decode] do not exist yet.
        if self.names.decode:
            return
        in_file = {*self.tables, *(item.place for item in left_out)}
        unknown = [name for name in self.names.clocks if name not in in_file]
        if not unknown:
            return
        # A map with optional channels serves files with different tables.
        for channels in self.names.leaves.values():
            if any(channel.optional for channel in channels.values()):
                return
        raise UnknownName(
            unknown[0],
            self.tables,
            what="table",
            hint=f"[time.{unknown[0]}] of the name map; {self.file} holds none of this name",
        )

    def with_decoded_words(self) -> dict[str, RecordedTable]:
        """Return the tables, with the tables that ``[decode]`` defines for columns of words."""
        for name, spec in self.names.decode.items():
            if isinstance(spec, Arinc429) and spec.column is not None:
                bus_words = words_of_columns(self.tables, spec, self._word_times)
                decoded, notes = label_tables(bus_words, spec, name)
                self.tables.update(decoded)
                self.notes += notes
        return self.tables

    def _word_times(self, table: str) -> np.ndarray:
        """Return the recorded times of words, which may share a stamp. [s]"""
        raw, scale, _ = self._recorded_stamps(table)
        return np.asarray(raw, float) * scale

    def _unknown_clock(self, column: str | None, table: str) -> UnknownName:
        """Return the error for a table without the column of its clock."""
        hint = f"table {table}; "
        if column is None:
            omission = left_out_clock(self._left_out)
        else:
            omission = left_out_as(column, table, self._left_out)
        # the likely clock, of which some cells are not numbers
        if omission is not None:
            hint += f"{omission.place} is left out: {omission.reason}; "
        hint += 'name the clock in the name map: [time] column = "...", or give its rate'
        return UnknownName(
            column or "time", self.tables[table].columns, what="time column", hint=hint
        )

    def _recorded_stamps(self, table: str) -> tuple[np.ndarray, float, str | None]:
        """Return recorded stamps, the seconds in one unit, and their column if they have one."""
        clock, recorded = self.names.clock_of(table), self.tables[table]
        column = self._clock_column(clock.column, table)
        if column is None and recorded.time is not None:
            return recorded.time, 1.0, None
        column = column or clock_name(recorded.columns)
        if column is None and clock.rate is not None and recorded.columns:
            length = len(np.asarray(next(iter(recorded.columns.values()))))
            return np.arange(length) / clock.rate, 1.0, None
        if column is None or column not in recorded.columns:
            raise self._unknown_clock(column, table)
        raw = np.asarray(recorded.columns[column], float)
        scale = clock.seconds(unit_of_column(recorded, column, "time"))
        seconds = seconds_of_digits(raw) if scale == 1.0 else None
        if seconds is None:
            return raw, scale, column
        note = (
            f"clock {column}: hours, minutes and seconds in one number (hhmmss), read as "
            f"seconds of the day"
        )
        if note not in self.notes:
            self.notes.append(note)
        return seconds, scale, column

    def _clock_column(self, stated: str | None, table: str) -> str | None:
        """Return the column of a table that ``[time] column`` states.

        The result is None if the map states no column, or the TABLE/COLUMN of another table.
        """
        if stated is None:
            return None
        column = column_called(stated, self.tables[table])
        if column:
            return column
        group, _, column_of_group = stated.rpartition("/")
        if group == table:
            return column_of_group
        if group in self.tables:
            return None
        return stated

    def table_clock(self, table: str, what: str) -> TableClock:
        """Return the rising clock of a table; `what` is file and leaf for the errors."""
        if table not in self._clocks:
            raw, scale, column = self._recorded_stamps(table)
            if column is not None:
                self.columns_used.add((table, column))
            clock = self.names.clock_of(table)
            origin = self._drift_origin(table, raw, scale) if clock.drift else None
            self._clocks[table] = rising_clock(raw, clock, scale, what, origin)
        return self._clocks[table]

    def _drift_origin(self, table: str, raw: np.ndarray, scale: float) -> float | None:
        """Return the stamp from which the drift of a table counts; None for its own first. [s]

        Tables of one clock have one origin, the earliest of their first stamps: their samples of
        one instant stay together, whatever table begins first.
        """
        own = _first_stamp(raw, scale)
        if own is None or table in self.names.clocks:
            return None
        firsts = [own]
        for other in self.tables:
            if other == table or other in self.names.clocks:
                continue
            try:
                stamps, other_scale, _ = self._recorded_stamps(other)
            except (UnknownName, ValueError):
                # a table without a clock is not read
                continue
            first = _first_stamp(stamps, other_scale)
            # a counter of its own, such as since power-on, is another clock
            if first is not None and abs(first - own) < _LONGEST:
                firsts.append(first)
        return min(firsts)

    def have_same_stamps(self, first: str, second: str, what: str) -> bool:
        """Return whether two tables share their stamps."""
        a, b = self.table_clock(first, what), self.table_clock(second, what)
        return np.array_equal(a.time, b.time) and np.array_equal(a.samples, b.samples)
