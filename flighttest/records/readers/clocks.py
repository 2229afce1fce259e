"""The clock of a table: from raw stamps to a rising clock in seconds, with every fault flagged.

Counters that wrap are unrolled, stray stamps dropped, repeated ones too.  A clock that is set back
is refused unless the name map states ``reset = true``: samples recorded twice or files glued
together would otherwise pass for one flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.support.arrays import median
from flighttest.records.readers.bus_words import Arinc429, label_tables, words_of_columns
from flighttest.records.readers.columns import column_called, unit_of_column
from flighttest.records.readers.name_map import Clock, NameMap, Utc
from flighttest.records.readers.recording import LeftOut, RecordedTable, clock_name
from flighttest.records.readers.times_of_day import seconds_of_digits
from flighttest.records.signals.conditioning import GAP
from flighttest.records.signals.sample_flags import MOST, Flag

_COUNTERS = tuple(float(2**bits) for bits in (16, 24, 31, 32))  # in counts of the clock
_PERIODS = (60.0, 3600.0, 86400.0, 604800.0)  # s: minute, hour, day, week of satellite time
_NEAR = 5.0  # a wrap continues the clock within so many median steps
_STRAY = 10.0  # median steps off the neighbours


@dataclass
class Settled:
    """A rising clock [s], the raw samples that belong to it, the flags, and attributes for the
    leaf.
    """

    time: np.ndarray
    keep: np.ndarray
    flags: list[Flag] = field(default_factory=list)
    about: dict[str, Any] = field(default_factory=dict)


def rising_clock(raw: np.ndarray, clock: Clock, scale: float, what: str) -> Settled:
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
        raise SchemaError(
            what,
            [
                f"its clock has {len(time)} samples, {len(lost)} of them NaN; at least two "
                f"finite ones are needed"
            ],
        )
    time = time[keep]
    found: list[Flag] = []
    if (np.diff(time) < 0.0).any():
        time, wraps = _unrolled(time, clock.wrap, scale)
        found += [
            Flag("", "wrap", time[i], time[i + 1], 1, f"period {period:g} s") for i, period in wraps
        ]
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
    found = [
        flag._replace(start=flag.start + clock.offset, stop=flag.stop + clock.offset)
        for flag in found
    ]
    step = np.diff(time)
    usual = median(step)
    gaps = np.flatnonzero(step > GAP * usual)
    found += [
        Flag("", "gap", float(time[i]), float(time[i + 1]), 0, f"{step[i]:.3g} s")
        for i in gaps[:MOST]
    ]
    words = ", ".join(f"{time[i]:g} s ({step[i]:.3g} s)" for i in gaps[:MOST])
    repeated = sum(flag.samples for flag in found if flag.kind == "duplicate")
    return Settled(time, keep, found, {"rate": 1.0 / usual, "gaps": words, "duplicates": repeated})


def _unrolled(
    time: np.ndarray, period: float | None, scale: float
) -> tuple[np.ndarray, list[tuple[int, float]]]:
    """Return the clock with its wraps undone, and where they were with their period."""
    step = np.diff(time)
    back = np.flatnonzero(step < 0.0)
    forward = step[step > 0.0]
    usual = median(forward) if len(forward) else 0.0
    candidates = (
        (period,) if period is not None else tuple(count * scale for count in _COUNTERS) + _PERIODS
    )
    shift, wraps = np.zeros(len(time)), []
    for i in back:
        for one in candidates:
            if (
                (0.5 * one < -step[i] <= one)
                if period is not None
                else (0.0 < step[i] + one <= _NEAR * usual)
            ):
                shift[i + 1 :] += one
                wraps.append((int(i), float(one)))
                break
    return time + shift, wraps


def _on_course(time: np.ndarray) -> np.ndarray:
    """Return which stamps lie near the median of themselves and two neighbours on each side."""
    step = np.diff(time)
    if len(time) < 5 or not (step < 0.0).any():
        return np.ones(len(time), bool)
    padded = np.concatenate(
        [time[2:0:-1] - 2 * (time[2:0:-1] - time[0]), time, 2 * time[-1] - time[-2:-4:-1]]
    )
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
    return np.abs(time - np.median(windows, axis=1)) <= _STRAY * float(np.median(np.abs(step)))


def _risen(time: np.ndarray, reset: bool, what: str) -> tuple[np.ndarray, list[Flag]]:
    step = np.diff(time)
    back = np.flatnonzero(step < 0.0)
    if not len(back):
        return time, []
    at = int(back[0])
    if not reset:
        text = (
            f"time does not rise: {time[at]:g} s is followed by {time[at + 1]:g} s (sample "
            f"{at + 1})"
        )
        raise SchemaError(
            what,
            [f"{text}; split or sort the file, or set reset = true for its clock in the name map"],
        )
    rising = step[step > 0.0]
    if not len(rising):
        raise SchemaError(
            what, [f"time only falls, from {time[0]:g} s to {time[-1]:g} s; sort the file"]
        )
    jump = np.zeros(len(time))
    jump[back + 1] = float(np.median(rising)) - step[back]
    moved = time + np.cumsum(jump)
    return moved, [
        Flag("", "reset", float(moved[i]), float(moved[i + 1]), 1, f"by {-step[i]:.6g} s")
        for i in back[:MOST]
    ]


def _even(time: np.ndarray, rate: float, what: str) -> np.ndarray:
    even = time[0] + np.arange(len(time)) / rate
    resolution = float(np.max(np.diff(time), initial=1.0 / rate))
    error = float(np.max(np.abs(even - time)))
    if error > resolution + 1.0 / rate:
        text = (
            f"stamps and rate = {rate:g} Hz drift apart by {error:.3g} s over "
            f"{time[-1] - time[0]:.6g} s"
        )
        raise SchemaError(what, [f"{text}; give the rate with more digits, or leave it out"])
    return even


def _unique(
    time: np.ndarray, keep: np.ndarray, what: str
) -> tuple[np.ndarray, np.ndarray, list[Flag]]:
    new = np.concatenate([[True], np.diff(time) > 0.0])
    repeated = int((~new).sum())
    if not repeated:
        return time, keep, []
    if repeated > 0.5 * len(time):
        share = len(time) / int(new.sum())
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
    first = time[~new]
    return (
        time[new],
        keep[new],
        [Flag("", "duplicate", float(first[0]), float(first[-1]), repeated)],
    )


_EPOCHS = {"unix": datetime(1970, 1, 1, tzinfo=UTC), "gps": datetime(1980, 1, 6, tzinfo=UTC)}
_OUTLIER = 6.0  # scaled median absolute deviations


class Clocks:
    """Clocks of the tables of one file as the name map wants them."""

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
        self._settled: dict[str, Settled] = {}
        known = {*self.tables, *(one.place for one in left_out)}
        unknown = [name for name in names.clocks if name not in known and not names.decode]
        if unknown and not any(
            channel.optional for leaf in names.leaves.values() for channel in leaf.values()
        ):
            raise UnknownName(
                unknown[0],
                self.tables,
                "table",
                f"[time.{unknown[0]}] of the name map; {file} holds none of this name",
            )

    def with_decoded_words(self) -> dict[str, RecordedTable]:
        """Return the tables, with those that ``[decode]`` takes out of columns of words."""
        if not self.names.decode:
            return self.tables

        for name, spec in self.names.decode.items():
            if isinstance(spec, Arinc429) and spec.column is not None:
                words = words_of_columns(self.tables, spec, self._word_times)
                found, notes = label_tables(words, spec, name)
                self.tables.update(found)
                self.notes += notes
        return self.tables

    def _word_times(self, table: str) -> np.ndarray:
        """Words of a bus often share a stamp: their times are taken as they are."""
        raw, scale, _ = self._raw(table)
        return np.asarray(raw, float) * scale

    def _raw(self, table: str) -> tuple[np.ndarray, float, str | None]:
        clock, part = self.names.clock_of(table), self.tables[table]
        if self._own_column(clock.column, table) is None and part.time is not None:
            return part.time, 1.0, None
        column = self._own_column(clock.column, table) or clock_name(part.columns)
        if column is None and clock.rate is not None and part.columns:
            length = len(np.asarray(next(iter(part.columns.values()))))
            return np.arange(length) / clock.rate, 1.0, None
        if column is None or column not in part.columns:
            hint = (
                f'table {table}; name the clock in the name map: [time] column = "...", or '
                f"give its rate"
            )
            raise UnknownName(column or "time", part.columns, "time column", hint)
        raw = np.asarray(part.columns[column], float)
        scale = clock.seconds(unit_of_column(part, column, "time"))
        if scale == 1.0 and (seconds := seconds_of_digits(raw)) is not None:
            note = (
                f"clock {column}: hours, minutes and seconds in one number (hhmmss), read as "
                f"seconds of the day"
            )
            self.notes += [] if note in self.notes else [note]
            raw = seconds
        return raw, scale, column

    def _own_column(self, wanted: str | None, table: str) -> str | None:
        """Return the column that ``[time] column`` names in a table; None without one, and for the
        table/column of another table.
        """
        if wanted is None:
            return None
        if own := column_called(wanted, self.tables[table]):
            return own
        group, _, column = wanted.rpartition("/")
        return column if group == table else None if group in self.tables else wanted

    def settled(self, table: str, what: str) -> Settled:
        """Return the settled clock of a table."""
        if table not in self._settled:
            raw, scale, column = self._raw(table)
            if column is not None:
                self.columns_used.add((table, column))
            self._settled[table] = rising_clock(raw, self.names.clock_of(table), scale, what)
        return self._settled[table]

    def same(self, one: str, other: str, what: str) -> bool:
        """Return whether two tables share their stamps."""
        a, b = self.settled(one, what), self.settled(other, what)
        return np.array_equal(a.time, b.time) and np.array_equal(a.keep, b.keep)


def utc_facts(
    utc: Utc | None, tables: Mapping[str, RecordedTable], clocks: Clocks
) -> dict[str, Any]:
    """Return what a column with the time of the world shows about the clock of the record.

    Returns
    -------
    dict
        ``start`` (ISO 8601, UTC at zero of the record's clock), ``clock_drift`` (seconds the
        record's clock gains per second of UTC) with its standard error ``clock_drift_stderr``,
        ``clock_scatter`` (median absolute deviation from the line, scaled to sigma) [s].

    Notes
    -----
    A straight line through time of the world over record time, without stamps further off than `_OUTLIER` scaled deviations.

    Raises
    ------
    UnknownName
        The column is not there and not optional.
    SchemaError
        Fewer than two valid stamps.
    """
    if utc is None:
        return {}
    group, _, column = utc.column.rpartition("/")
    group = group or next(iter(tables))
    if group not in tables or column not in tables[group].columns:
        if utc.optional:
            return {}
        raise UnknownName(
            utc.column,
            [f"{t}/{c}" for t, table in tables.items() for c in table.columns],
            "column",
            "[utc] of the name map",
        )
    clock = clocks.settled(group, f"{clocks.file}, table {group}")
    clocks.columns_used.add((group, column))
    scale = clocks.names.clock.changed(unit=utc.unit).seconds(None)
    shown = np.asarray(tables[group].columns[column], float)[clock.keep] * scale
    good = np.isfinite(shown) & (shown > 0.0)  # receivers show zero before they know
    if good.sum() < 2:
        if utc.optional:
            return {}
        raise SchemaError(
            f"{clocks.file}, column {utc.column}",
            [f"{int(good.sum())} valid stamps; two or more name the start"],
        )
    time, shown = clock.time[good], shown[good]
    whole = np.floor(shown[0])
    slope, intercept, keep = 1.0, float(np.median(shown - whole - time)), np.ones(len(time), bool)
    for _ in range(3):
        off = shown - whole - (intercept + slope * time)
        sigma = max(1.4826 * float(np.median(np.abs(off[keep] - np.median(off[keep])))), 1e-6)
        keep = np.abs(off - np.median(off[keep])) <= _OUTLIER * sigma
        if np.ptp(time[keep]) > 10.0:
            slope, intercept = np.polyfit(time[keep], (shown - whole)[keep], 1)
    seconds = whole + intercept - (utc.leap_seconds if utc.epoch == "gps" else 0)
    start = _EPOCHS[utc.epoch] + timedelta(seconds=float(seconds))
    facts = {
        "start": start.isoformat(timespec="microseconds").replace("+00:00", "Z"),
        "clock_scatter": sigma,
    }
    spread = float(np.sqrt(np.sum((time[keep] - time[keep].mean()) ** 2)))
    if np.ptp(time[keep]) > 10.0:
        facts.update(clock_drift=float(1.0 / slope - 1.0), clock_drift_stderr=sigma / spread)
    lost = int((~keep).sum())
    if lost:
        clocks.notes.append(f"{utc.column}: {lost} stamps off the line were not used")
    return facts
