"""CSV files, plain or gzip, as one table.

Columns stand under one line of names.  The separator is a comma, a semicolon, a tab or blanks.
Lines that begin with ``#`` are skipped.  Units are in the heading (``alpha [deg]``), in a second
line, or in the name map.

Stamps may be numbers, times of day (``10:22:33.05`` or ``10:22:33:050``, with or without the day of
the year before them) or ISO dates.  A column of text is left out (`csv_words`).  Numbers may have
decimal commas if the separator is not a comma.

The encoding is UTF-8, UTF-16 or UTF-32 with a byte-order mark, otherwise Windows-1252.  Lines end
with LF, CR LF or CR.  The notes of the record state every departure from plain UTF-8 numbers.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files import (
    MOST_COLUMNS,
    WESTERN,
    csv_rows,
    decode_text,
    marked_encoding,
    read_bytes,
)
from flighttest.records.readers.columns import split_headings
from flighttest.records.readers.formats.csv_columns import (
    Layout,
    columns_with_words,
    parse_columns,
)
from flighttest.records.readers.formats.csv_headings import own_names, without_copies
from flighttest.records.readers.formats.csv_words import (
    is_csv_number,
    is_missing,
    is_stamp,
    numbers_of,
    seconds_of,
)
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    LeftOut,
    RecordedTable,
    Recording,
    clock_name,
    decoding_errors,
    rises,
)

_DIGIT = re.compile(r"^[-+]?\.?\d")
_DECIMAL_COMMA = re.compile(r"^[-+]?\d*,\d+([eE][-+]?\d+)?$")
# A cell that may have a separator of thousands does not prove a decimal comma.
_THOUSANDS = re.compile(r"^[-+]?[1-9]\d{0,2},\d{3}$")
# Lines that decide on stamps and on the decimal mark.
_FIRST_LINES = 10
_GZIP = b"\x1f\x8b"
# Greatest size of the text behind gzip [byte]. A few kB can hold gigabytes of zeros.
_LARGEST_UNPACKED = 2**29
_EXPECTED = "comma-separated columns under one line of names"
TABLE = "data"


class _TextLine(NamedTuple):
    """A line with content: its number from 1, the byte behind it, and its text."""

    number: int
    end: int
    text: str


class _Content(NamedTuple):
    """Text of a CSV file and what its heading states.

    Attributes
    ----------
    path : Path
    raw : bytes
        Text as UTF-8 with line feeds.
    begin : int
        First byte of the numbers.
    heads : list of str
        Unique names of the columns.
    shared : dict of str to list of str
        Heading of several columns -> their names.
    units : dict of str to str
    separator : str
    """

    path: Path
    raw: bytes
    begin: int
    heads: list[str]
    shared: dict[str, list[str]]
    units: dict[str, str]
    separator: str

    def lines(self) -> Iterator[_TextLine]:
        """Yield the lines of numbers."""
        first_number = self.raw.count(b"\n", 0, self.begin) + 1
        return _lines(self.raw, self.begin, first_number)

    def cells(self, text: str, number: int) -> list[str]:
        """Return the cells of one line."""
        return _split_cells(text, self.separator, self.path, number)


def read(path: Path, names: NameMap) -> Recording:
    """Return a CSV file as the table ``data``.

    Raises
    ------
    ParseError
        A cell is not a number, a line has other cells than the heading, or the heading is missing.
        The error states the line.
    """
    raw, encoding_note = _read_text(path)
    notes = [encoding_note] if encoding_note else []
    content = _read_heading(raw, path)
    stamp_columns, decimal = _stamps_and_decimal_mark(content)
    if decimal == ",":
        notes.append("numbers with decimal commas")
    layout = Layout(content.heads, content.separator, decimal)

    # Most files have only numbers and stamps.  Columns with words are searched only if they fail.
    columns = parse_columns(raw, content.begin, layout, stamp_columns)
    word_columns: set[str] = set()
    if columns is None:
        _demand_whole_lines(content)
        word_columns = columns_with_words(raw[content.begin :], layout, stamp_columns)
        columns = parse_columns(raw, content.begin, layout, stamp_columns | word_columns)
    _demand_numbers(columns, content)
    assert columns is not None

    columns, word_notes, left_out = _convert_words(columns, word_columns, content, decimal)
    notes += word_notes
    columns, copy_notes, ambiguous = without_copies(
        columns, content.units, shared=content.shared, table=TABLE
    )
    notes += copy_notes
    left_out += ambiguous
    # A column that is read once for several copies has the heading as its name.
    for head, copies in content.shared.items():
        if copies[0] in stamp_columns:
            stamp_columns.add(head)
    stamps, start = _convert_stamps(columns, stamp_columns, content)
    facts: dict[str, Any] = {"title": path.name.split(".")[0]}
    if start:
        facts["start"] = start
    return Recording(
        "csv",
        {TABLE: RecordedTable(columns, content.units, stamps)},
        facts,
        notes=tuple(notes),
        left_out=tuple(left_out),
    )


def _demand_numbers(columns: dict[str, Any] | None, content: _Content) -> None:
    """Raise if the lines do not fit the heading, or if there are none."""
    path = str(content.path)
    if columns is None:
        raise ParseError(
            path,
            0,
            found="lines that do not fit the heading",
            expected=f"{len(content.heads)} numbers in every line",
        )
    if not any(len(values) for values in columns.values()):
        raise ParseError(
            path,
            0,
            found=f"no line of numbers below the names {', '.join(content.heads[:6])}",
            expected="a recording: names, then numbers",
        )


def _convert_words(
    columns: dict[str, Any], word_columns: set[str], content: _Content, decimal: str
) -> tuple[dict[str, Any], list[str], list[LeftOut]]:
    """Return the columns with words as numbers, notes on the words, and the omitted columns."""
    converted: dict[str, Any] = {}
    notes: list[str] = []
    left_out: list[LeftOut] = []
    for name in content.heads:
        if name not in word_columns:
            converted[name] = columns[name]
            continue
        cells = [str(cell).strip() for cell in columns[name]]
        numbers, note, omitted = numbers_of(cells, name, place=f"{TABLE}/{name}", decimal=decimal)
        if omitted is None:
            converted[name] = numbers
            notes.append(note)
        else:
            line = _line_of_cell(omitted.fault, name, content)
            left_out.append(omitted._replace(line=line))
    return converted, notes, left_out


def _line_of_cell(cell: str, name: str, content: _Content) -> int:
    """Return the first line with a cell in a column; 0 for an empty cell."""
    if not cell:
        return 0
    column = content.heads.index(name)
    for line in content.lines():
        if content.cells(line.text.split("#")[0], line.number)[column] == cell:
            return line.number
    return 0


def _convert_stamps(
    columns: dict[str, Any], stamp_columns: set[str], content: _Content
) -> tuple[np.ndarray | None, str]:
    """Convert columns of stamps to seconds in place and return the clock and its start.

    The clock is None if a column is the clock by its name.  The start is an ISO date, or empty.
    """
    names = [name for name in columns if name in stamp_columns]
    start = ""
    for name in names:
        columns[name], date = seconds_of(columns[name], name, content.path)
        content.units[name] = "s"
        start = date or start
    if not names or clock_name(columns) is not None:
        return None, start
    # The first column that rises is the clock.  A column of dates alone does not rise.
    for name in names:
        if rises(columns[name]):
            return columns[name], start
    return columns[names[0]], start


def _read_text(path: Path) -> tuple[bytes, str]:
    """Return the text as UTF-8 with line feeds, and a note on another encoding, else empty."""
    raw = read_bytes(path, _EXPECTED)
    if raw[:2] == _GZIP:
        with decoding_errors(path, "a whole .gz file"), gzip.open(path) as file:
            raw = file.read(_LARGEST_UNPACKED + 1)
        if len(raw) > _LARGEST_UNPACKED:
            found = f"more than {_LARGEST_UNPACKED >> 20} MiB behind gzip"
            raise ParseError(str(path), 0, found, "less; unpack it with gunzip, and divide it")
    note = ""
    # UTF-16 and UTF-32 of plain letters are ASCII bytes between zeros.
    if not raw.isascii() or b"\0" in raw:
        encoding, mark_length = marked_encoding(raw)
        recoded = decode_text(raw, path, _EXPECTED, otherwise=WESTERN).encode()
        if recoded != raw[mark_length:]:
            note = "text that is not UTF-8, read as Windows-1252"
            if encoding:
                note = f"text in {encoding.upper()}"
        raw = recoded
    if b"\r" in raw:
        raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return raw, note


def _lines(raw: bytes, start: int = 0, number: int = 1) -> Iterator[_TextLine]:
    """Yield every line with content from a byte on."""
    while start < len(raw):
        end = raw.find(b"\n", start)
        if end < 0:
            end = len(raw)
        text = raw[start:end].decode("utf-8", "replace").strip()
        if text and not text.startswith("#"):
            yield _TextLine(number, end + 1, text)
        start = end + 1
        number += 1


def _read_heading(raw: bytes, path: Path) -> _Content:
    """Return the names of the columns, their units and the separator."""
    lines = _lines(raw)
    top = next(lines, None)
    if top is None:
        raise ParseError(str(path), 0, found="no line with content", expected=_EXPECTED)
    # The most frequent separator of the top line; blanks separate only if there is no other.
    separator = max(",;\t", key=top.text.count)
    if not top.text.count(separator):
        separator = " " if " " in top.text else ","
    cells = _split_cells(top.text, separator, path, top.number)
    if all(is_csv_number(cell) for cell in cells):
        raise ParseError(
            str(path),
            top.number,
            found=f"numbers ({', '.join(cells[:3])}) where names belong",
            expected="one line of column names at the top",
        )

    short_names, stated_units = split_headings(cells)
    heads, shared = own_names(short_names)
    units = {}
    for head, name in zip(heads, short_names, strict=True):
        if name in stated_units:
            units[head] = stated_units[name]
    # The second line belongs to the heading if it holds units.
    begin = top.end
    second = next(lines, None)
    if second is not None:
        row = _split_cells(second.text, separator, path, second.number)
        if len(row) == len(heads) and _are_units(row):
            units.update(zip(heads, row, strict=True))
            begin = second.end
    return _Content(
        path=path,
        raw=raw,
        begin=begin,
        heads=heads,
        shared=shared,
        units=units,
        separator=separator,
    )


def _are_units(row: list[str]) -> bool:
    """Return whether a line holds units.

    A unit does not begin like a number, except the unit 1.  A line of blanks does not hold units.
    """
    numbers = [cell for cell in row if _DIGIT.match(cell) or (cell and is_missing(cell))]
    has_unit = any(cell and cell not in numbers for cell in row)
    return has_unit and all(cell == "1" for cell in numbers)


def _split_cells(text: str, separator: str, path: Path, number: int) -> list[str]:
    """Return the cells of one line."""
    if separator == " " and text.count(" ") < MOST_COLUMNS:
        return text.split()
    row = csv_rows(text, path, separator=separator, first=number)[0]
    return [cell.strip() for cell in row]


def _stamps_and_decimal_mark(content: _Content) -> tuple[set[str], str]:
    """Return the columns of times of day or dates, and the decimal mark.

    The first filled cell of a column decides.  The decimal mark is a comma if the first lines have
    a number with one.
    """
    lines = islice(content.lines(), _FIRST_LINES)
    rows = [content.cells(line.text, line.number) for line in lines]
    stamp_columns = set()
    for head, *cells in zip(content.heads, *rows, strict=False):
        filled = [cell for cell in cells if not is_missing(cell)]
        if filled and is_stamp(filled[0]):
            stamp_columns.add(head)
    if content.separator != ",":
        for row in rows:
            if any(_DECIMAL_COMMA.match(cell) and not _THOUSANDS.match(cell) for cell in row):
                return stamp_columns, ","
    return stamp_columns, "."


def _demand_whole_lines(content: _Content) -> None:
    """Raise for the first line with another number of cells than the heading."""
    heads = content.heads
    for line in content.lines():
        # A comment may follow the numbers of a line.
        text = line.text.split("#")[0] or content.separator
        row = content.cells(text, line.number)
        if len(row) != len(heads):
            first = ", ".join(map(repr, heads[:3])) + (" ..." if len(heads) > 3 else "")
            remedy = "delete a last line that was cut off"
            if len(row) > len(heads) and content.separator == ",":
                remedy = (
                    "numbers with decimal commas need another separator: write the table with "
                    "semicolons"
                )
            raise ParseError(
                str(content.path),
                line.number,
                found=f"{len(row)} cells",
                expected=(f"{len(heads)} cells, as the line of names has ({first}); {remedy}"),
            )
