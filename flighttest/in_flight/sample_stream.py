"""Samples of a flight from lines of text, as they arrive.

The stream is CSV with one heading line. A line that is not complete waits for its end. A line with
another number of cells, with text in place of a number, or with NaN in a needed column is left out
and counted. No number is guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.units import to_si
from flighttest.records.readers.name_map import Channel, NameMap

_UNIT = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]$")
_CLOCKS = ("time", "t")  # headings of the clock without a name map
_SEPARATORS = (",", ";", "\t")
_LONGEST = 1_000_000  # characters without an end of line that are not a stream of samples


@dataclass(frozen=True)
class _Column:
    """Position of a quantity in a line, and its conversion to SI."""

    name: str
    position: int
    convert: Callable[[np.ndarray], np.ndarray]


@dataclass
class SampleStream:
    """Reader of a stream.

    Attributes
    ----------
    wanted : callable
        Returns the names to read, from the names that the stream offers.  It raises for missing
        names.
    names : NameMap, optional
        Without it, headings are canonical names; a unit that is not SI stands in brackets.
    read, left_out : int
        Samples so far, and lines that were left out.
    """

    wanted: Callable[[Sequence[str]], Sequence[str]]
    names: NameMap | None = None
    read: int = 0
    left_out: int = 0
    columns: list[_Column] = field(default_factory=list)
    _rest: str = ""
    _separator: str = ","
    _width: int = 0
    _clock: tuple[int, float] = (-1, 1.0)

    @property
    def channels(self) -> list[str]:
        """Names of the columns of `feed`; empty before the heading."""
        return [column.name for column in self.columns]

    @property
    def has_rest(self) -> bool:
        """Whether the last line has no end yet."""
        return bool(self._rest.strip())

    def feed(self, text: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples of the complete lines of a piece of text.

        Parameters
        ----------
        text : str
            The next characters of the stream.

        Returns
        -------
        time : array (samples,)
            [s]
        values : array (samples, channels)
            [SI]

        Raises
        ------
        ParseError
            A heading without a clock, or a text that is not a stream of samples.
        UnknownName
            A quantity that the stream does not give.
        SchemaError
            A name map with corrections that a stream cannot have.
        """
        *lines, self._rest = (self._rest + text).split("\n")
        if len(self._rest) > _LONGEST:
            raise ParseError("<stream>", 0, "a line without end", "CSV with one heading line")
        if not self._width and lines:
            heading = lines.pop(0)
            while lines and not heading.strip():
                heading = lines.pop(0)
            if heading.strip():
                self._read_heading(heading.strip().lstrip("\ufeff"))
        rows = []
        for line in lines:
            if not line.strip():
                continue
            row = self._read_line(line)
            if row is None:
                self.left_out += 1
            else:
                rows.append(row)
        if not rows:
            return np.zeros(0), np.zeros((0, len(self.columns)))
        table = np.array(rows)
        values = np.empty((len(rows), len(self.columns)))
        for k, column in enumerate(self.columns):
            values[:, k] = column.convert(table[:, k + 1])
        # A calibration table has NaN beyond its ends.
        usable = np.isfinite(values).all(axis=1)
        self.left_out += int((~usable).sum())
        self.read += int(usable.sum())
        return table[usable, 0] * self._clock[1], values[usable]

    def _read_line(self, line: str) -> list[float] | None:
        """Return clock and needed cells of one line; None if it must be left out."""
        cells = line.split(self._separator)
        if len(cells) != self._width:
            return None
        try:
            row = [float(cells[self._clock[0]])]
            for column in self.columns:
                # A constant has no column; the clock stands in for it.
                position = self._clock[0] if column.position < 0 else column.position
                row.append(float(cells[position]))
        except ValueError:
            return None
        if not all(map(math.isfinite, row)):
            return None
        return row

    def _read_heading(self, heading: str) -> None:
        self._separator = max(_SEPARATORS, key=heading.count)
        heads = [head.strip().strip('"') for head in heading.split(self._separator)]
        plain, units = [], []
        for head in heads:
            match = _UNIT.match(head)
            plain.append(match.group(1) if match else head)
            units.append(match.group(2) if match else None)
        if len(heads) < 2:
            raise ParseError("<stream>", 1, repr(heading[:80]), "a heading of CSV with a clock")
        if self.names is not None:
            offered = self._mapped_columns(self.names, heads, plain, units)
        else:
            offered = _canonical_columns(heads, plain, units)
        by_name = {column.name: column for column in offered}
        self.columns = [by_name[name] for name in self.wanted(list(by_name))]
        position, unit = self._find_clock(heads, plain, units)
        seconds = float(to_si(1.0, unit or "s", "s"))
        self._clock, self._width = (position, seconds), len(heads)

    def _find_clock(
        self, heads: list[str], plain: list[str], units: list[str | None]
    ) -> tuple[int, str | None]:
        """Return position and unit of the clock."""
        clock = self.names.clock if self.names is not None else None
        if clock is not None and clock.column:
            for k, names in enumerate(zip(heads, plain)):
                if clock.column in names:
                    return k, clock.unit or units[k]
            raise UnknownName(clock.column, heads, "column of the clock", "the heading lacks it")
        for name in _CLOCKS:
            if name in plain:
                k = plain.index(name)
                return k, (clock.unit if clock is not None else None) or units[k]
        raise ParseError(
            "<stream>", 1, f"no clock among {', '.join(heads[:20])}", "a column time or t"
        )

    @staticmethod
    def _mapped_columns(
        names: NameMap, heads: list[str], plain: list[str], units: list[str | None]
    ) -> list[_Column]:
        """Return the columns of a name map; refuse corrections that need the whole record."""
        problems = []
        clock = names.clock
        if clock.wrap or clock.rate or clock.drift or clock.reset or names.decode or names.utc:
            problems.append("wrap, rate, drift, reset, [utc] and [decode] need the whole record")
        columns = []
        for channels in names.leaves.values():
            for name, channel in channels.items():
                if channel.delay or channel.lag or channel.rate_limit or channel.stops:
                    problems.append(f"{name}: delay, lag and limits need the whole record")
                    continue
                position = _find_column(channel, heads, plain)
                if position < 0:
                    continue
                columns.append(_Column(name, position, _converter(channel, units[position], name)))
        if problems:
            raise SchemaError(f"name map {names.source} for a stream", problems)
        for name, value in names.constants.items():
            columns.append(_Column(name, -1, _constant(value)))
        return columns


def _find_column(channel: Channel, heads: list[str], plain: list[str]) -> int:
    """Return the position of the first column of a channel; -1 without any."""
    for column in channel.columns:
        for names in (heads, plain):
            if column in names:
                return names.index(column)
    return -1


def _converter(channel: Channel, unit: str | None, name: str) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: channel.convert(values, unit, name)


def _constant(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: np.full(len(values), value)


def _unit_change(unit: str, si: str) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: np.asarray(to_si(values, unit, si))


def _canonical_columns(
    heads: list[str], plain: list[str], units: list[str | None]
) -> list[_Column]:
    """Return the columns whose headings are canonical names."""
    columns = []
    for k, name in enumerate(plain):
        try:
            si = lookup(name).units
        except UnknownName:
            continue
        unit = units[k] or si
        if name in plain[:k]:
            raise ParseError("<stream>", 1, f"the heading {name} twice", "each quantity once")
        columns.append(_Column(name, k, _unit_change(unit, si)))
    if not columns:
        raise ParseError(
            "<stream>", 1, ", ".join(heads[:20]), "canonical names, or a name map (--names)"
        )
    return columns
