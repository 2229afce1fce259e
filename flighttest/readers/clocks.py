"""The clocks of a recording: stamps of every table on the clock of the record, settled once, and the time of the world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from flightmech.errors import SchemaError, UnknownName

from .headings import column_called, unit_of_column
from .name_map import NameMap, Utc
from .recording import LeftOut, Table, clock_name
from .stamps import Settled, settled

_EPOCHS = {"unix": datetime(1970, 1, 1, tzinfo=UTC), "gps": datetime(1980, 1, 6, tzinfo=UTC)}
_OUTLIER = 6.0  # scaled median absolute deviations


class Clocks:
    """Clocks of the tables of one file as the name map wants them."""

    def __init__(self, tables: Mapping[str, Table], names: NameMap, file: str, left_out: Sequence[LeftOut] = ()):
        self.tables, self.names, self.file = dict(tables), names, file
        self.columns_used: set[tuple[str, str]] = set()
        self.notes: list[str] = []
        self._settled: dict[str, Settled] = {}
        known = {*self.tables, *(one.place for one in left_out)}
        unknown = [name for name in names.clocks if name not in known and not names.decode]
        if unknown and not any(channel.optional for leaf in names.leaves.values() for channel in leaf.values()):
            raise UnknownName(unknown[0], self.tables, "table", f"[time.{unknown[0]}] of the name map; {file} holds none of this name")

    def with_decoded_words(self) -> dict[str, Table]:
        """Return the tables, with those that ``[decode]`` takes out of columns of words."""
        if not self.names.decode:
            return self.tables
        from .bus.arinc429 import label_tables, words_of_columns
        from .bus.decode import Arinc429

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
            hint = f'table {table}; name the clock in the name map: [time] column = "...", or give its rate'
            raise UnknownName(column or "time", part.columns, "time column", hint)
        return np.asarray(part.columns[column], float), clock.seconds(unit_of_column(part, column, "time")), column

    def _own_column(self, wanted: str | None, table: str) -> str | None:
        """Return the column that ``[time] column`` names in a table; None without one, and for the table/column of another table."""
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
            self._settled[table] = settled(raw, self.names.clock_of(table), scale, what)
        return self._settled[table]

    def same(self, one: str, other: str, what: str) -> bool:
        """Return whether two tables share their stamps."""
        a, b = self.settled(one, what), self.settled(other, what)
        return np.array_equal(a.time, b.time) and np.array_equal(a.keep, b.keep)


def utc_facts(utc: Utc | None, tables: Mapping[str, Table], clocks: Clocks) -> dict[str, Any]:
    """Return what a column with the time of the world shows about the clock of the record.

    Returns
    -------
    dict
        ``start`` (ISO 8601, UTC at zero of the record's clock), ``clock_drift`` (seconds the record's clock gains per second of UTC) with
        its standard error ``clock_drift_stderr``, ``clock_scatter`` (median absolute deviation from the line, scaled to sigma) [s].

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
        raise UnknownName(utc.column, [f"{t}/{c}" for t, table in tables.items() for c in table.columns], "column", "[utc] of the name map")
    clock = clocks.settled(group, f"{clocks.file}, table {group}")
    clocks.columns_used.add((group, column))
    scale = clocks.names.clock.changed(unit=utc.unit).seconds(None)
    shown = np.asarray(tables[group].columns[column], float)[clock.keep] * scale
    good = np.isfinite(shown) & (shown > 0.0)  # receivers show zero before they know
    if good.sum() < 2:
        if utc.optional:
            return {}
        raise SchemaError(f"{clocks.file}, column {utc.column}", [f"{int(good.sum())} valid stamps; two or more name the start"])
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
    facts = {"start": start.isoformat(timespec="microseconds").replace("+00:00", "Z"), "clock_scatter": sigma}
    spread = float(np.sqrt(np.sum((time[keep] - time[keep].mean()) ** 2)))
    if np.ptp(time[keep]) > 10.0:
        facts.update(clock_drift=float(1.0 / slope - 1.0), clock_drift_stderr=sigma / spread)
    lost = int((~keep).sum())
    if lost:
        clocks.notes.append(f"{utc.column}: {lost} stamps off the line were not used")
    return facts
