"""CSV files, plain or gzip, as one table.

Columns under one line of names, parted by comma, semicolon, tab or blanks; lines that begin with
``#`` are skipped.  Units stand in the heading (``alpha [deg]``), in a second line, or in the name
map.  Stamps may be numbers, times of day (``10:22:33.05`` or ``10:22:33:050``, with the day of the
year before them or not) or ISO dates.  A column of text is left out (`csv_words`).  Where no comma
parts the columns, numbers may have decimal commas.  The encoding is UTF-8, UTF-16 or UTF-32 with a
byte-order mark, or else taken as Windows-1252; lines end with LF, CR LF or CR.  What is not plain
stands in the notes of the record.
"""

from __future__ import annotations

import gzip
import io
import os
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

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
_THOUSANDS = re.compile(r"^[-+]?[1-9]\d{0,2},\d{3}$")  # may be one: no proof of a decimal comma
_LOOKED_AT = 10  # lines that decide on the decimal mark
_EXPECTED = "comma-separated columns under one line of names"
# bytes: NumPy parses them in less time than the import of pandas takes, which parses three times as
# fast
_SMALL = 4_000_000
_NUMBERS = b"0123456789+-.eE,\n "  # bytes of a plain table
_WORD = re.compile(rb"[-+]?[A-Za-z]+")
_CHUNK = 8_000_000  # bytes: smaller files are not worth a second thread
TABLE = "data"


def read(path: Path, names: NameMap) -> Recording:
    """Return a CSV file as the table ``data``.

    Raises
    ------
    ParseError
        With the line: a cell that is no number, a line with other cells than the heading, or no
        heading.
    """
    raw, notes = _text(path)
    heads, shared, units, begin, separator = _heading(raw, path)
    texts, decimal = _text_columns(raw, begin, heads, separator, path)
    if decimal == ",":
        notes += ("numbers with decimal commas",)
    columns = _parsed(raw, begin, heads, texts, separator, decimal)
    words: set[str] = set()
    if columns is None:
        _find_fault(raw, begin, heads, separator, path)
        words = _columns_with_words(raw[begin:], heads, texts, separator, decimal)
        columns = _parsed(raw, begin, heads, texts | words, separator, decimal)
    if columns is None:
        raise ParseError(
            str(path), 0, "lines that do not fit the heading", f"{len(heads)} numbers in every line"
        )
    if not any(len(values) for values in columns.values()):
        raise ParseError(
            str(path),
            0,
            f"no line of numbers below the names {', '.join(heads[:6])}",
            "a recording: names, then numbers",
        )
    facts: dict[str, Any] = {"title": path.name.split(".")[0]}
    left_out: list[LeftOut] = []
    for name in [name for name in columns if name in words]:
        cells = [str(cell).strip() for cell in columns.pop(name)]
        numbers, note, lost = numbers_of(cells, name, f"{TABLE}/{name}", decimal)
        if lost is not None:
            left_out.append(
                lost._replace(line=_line_of(lost.fault, name, (raw, begin, heads, separator), path))
            )
        else:
            columns[name], notes = numbers, (*notes, note)
    columns = {name: columns[name] for name in heads if name in columns}
    columns, copies, ambiguous = without_copies(columns, units, shared, TABLE)
    notes, left_out = (*notes, *copies), [*left_out, *ambiguous]
    texts |= {head for head, called in shared.items() if called[0] in texts}
    stamped = [name for name in columns if name in texts]
    for name in stamped:
        columns[name], start = seconds_of(columns[name], name, path)
        units[name] = "s"
        if start:
            facts["start"] = start
    # a column of stamps is the clock where none is called so: the first that rises, not a mere date
    stamps: np.ndarray | None = None
    if stamped and clock_name(columns) is None:
        stamps = columns[next(filter(lambda name: rises(columns[name]), stamped), stamped[0])]
    return Recording(
        "csv",
        {TABLE: RecordedTable(columns, units, stamps)},
        facts,
        notes,
        left_out=tuple(left_out),
    )


def _line_of(cell: str, name: str, text: tuple[bytes, int, list[str], str], path: Path) -> int:
    """Return the first line with a cell in a column; 0 for an empty cell."""
    raw, begin, heads, separator = text
    at = heads.index(name)
    lines = _lines(raw, begin, raw.count(b"\n", 0, begin) + 1) if cell else iter(())
    return next(
        (
            number
            for number, _, _, line in lines
            if _cells(line.split("#")[0], separator, path, number)[at] == cell
        ),
        0,
    )


def _columns_with_words(
    piece: bytes, heads: list[str], texts: set[str], separator: str, decimal: str
) -> set[str]:
    """Return the columns that hold other cells than numbers and empty ones."""
    frame = _frame(piece, heads, texts, separator, decimal, guess=True)
    return (
        set()
        if frame is None
        else {head for head in heads if head not in texts and frame[head].dtype.kind not in "fiu"}
    )


def _text(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """Return the text as UTF-8 with line feeds, and a note where it was of another encoding."""
    raw = read_bytes(path, _EXPECTED)
    if raw[:2] == b"\x1f\x8b":
        with decoding_errors(path, "a whole .gz file"):
            raw = gzip.decompress(raw)
    notes: tuple[str, ...] = ()
    if not raw.isascii() or b"\0" in raw:
        encoding, skip = marked_encoding(raw)
        recoded = decode_text(raw, path, _EXPECTED, WESTERN).encode()
        if recoded != raw[skip:]:
            notes = (
                f"text in {encoding.upper()}"
                if encoding
                else "text that is no UTF-8, read as Windows-1252",
            )
        raw = recoded
    return raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in raw else raw, notes


def _lines(raw: bytes, start: int = 0, number: int = 1) -> Iterator[tuple[int, int, int, str]]:
    """Yield number, first byte, end and text of every line with content."""
    while start < len(raw):
        end = raw.find(b"\n", start)
        end = len(raw) if end < 0 else end
        text = raw[start:end].decode("utf-8", "replace").strip()
        if text and not text.startswith("#"):
            yield number, start, end + 1, text
        start, number = end + 1, number + 1


def _heading(
    raw: bytes, path: Path
) -> tuple[list[str], dict[str, list[str]], dict[str, str], int, str]:
    """Return the column names, those that share a heading, their units, the byte where the numbers
    begin, and what parts the columns.
    """
    lines = _lines(raw)
    top = next(lines, None)
    if top is None:
        raise ParseError(str(path), 0, "no line with content", _EXPECTED)
    separator = max(",;\t", key=top[3].count)
    if not top[3].count(separator):
        separator = " " if " " in top[3] else ","
    cells = _cells(top[3], separator, path, top[0])
    if all(is_csv_number(cell) for cell in cells):
        raise ParseError(
            str(path),
            top[0],
            f"numbers ({', '.join(cells[:3])}) where names belong",
            "one line of column names at the top",
        )
    short, of_headings = split_headings(cells)
    heads, shared = own_names(short)
    units = {
        head: of_headings[name]
        for head, name in zip(heads, short, strict=True)
        if name in of_headings
    }
    begin, second = top[2], next(lines, None)
    if second is not None:
        row = _cells(second[3], separator, path, second[0])
        if len(row) == len(heads) and _are_units(row):
            units.update(zip(heads, row, strict=True))
            begin = second[2]
    return heads, shared, units, begin, separator


def _are_units(row: list[str]) -> bool:
    """Whether a line holds units: nothing that begins like a number, but for the unit 1, and not
    blanks alone.
    """
    numbers = [cell for cell in row if _DIGIT.match(cell) or (cell and is_missing(cell))]
    return all(cell == "1" for cell in numbers) and any(
        cell and cell not in numbers for cell in row
    )


def _cells(text: str, separator: str, path: Path, number: int) -> list[str]:
    """Return the cells of one line."""
    if separator == " " and text.count(" ") < MOST_COLUMNS:
        return text.split()
    return [cell.strip() for cell in csv_rows(text, path, separator, number)[0]]


def _text_columns(
    raw: bytes, begin: int, heads: list[str], separator: str, path: Path
) -> tuple[set[str], str]:
    """Return the columns whose first filled cell is a time of day or a date, and the decimal mark: a
    comma where the first lines have one.
    """
    lines = islice(_lines(raw, begin, raw.count(b"\n", 0, begin) + 1), _LOOKED_AT)
    rows = [_cells(text, separator, path, number) for number, _, _, text in lines]
    texts = {
        head
        for head, *cells in zip(heads, *rows, strict=False)
        if is_stamp(next((cell for cell in cells if not is_missing(cell)), ""))
    }
    commas = separator != "," and any(
        _DECIMAL_COMMA.match(cell) and not _THOUSANDS.match(cell) for row in rows for cell in row
    )
    return texts, "," if commas else "."


def _parsed(
    raw: bytes, begin: int, heads: list[str], texts: set[str], separator: str, decimal: str
) -> dict[str, Any] | None:
    """Return the columns, or None when a cell or a line does not fit; large files are parsed in
    several threads.
    """
    if (
        len(raw) - begin <= _SMALL
        and not texts
        and (plain := _plain_table(raw[begin:], heads, separator, decimal)) is not None
    ):
        return plain
    parts = max(1, min(os.cpu_count() or 1, 8, (len(raw) - begin) // _CHUNK))
    cuts = [begin]
    for i in range(1, parts):
        at = raw.find(b"\n", begin + i * (len(raw) - begin) // parts) + 1
        cuts.append(max(at, cuts[-1]) if at else len(raw))
    spans = [
        (a, b)
        for a, b in pairwise([*cuts, len(raw)])
        if a < b and not (raw[a : a + 4096].isspace() and raw[a:b].isspace())
    ]
    if not spans:
        return {head: np.zeros(0) for head in heads}

    with ThreadPoolExecutor(len(spans)) as pool:
        frames = list(
            pool.map(
                lambda span: _frame(raw[span[0] : span[1]], heads, texts, separator, decimal), spans
            )
        )
    if any(frame is None for frame in frames):
        return None
    if len(frames) == 1:
        return {head: frames[0][head].to_numpy() for head in heads}
    return {head: np.concatenate([frame[head].to_numpy() for frame in frames]) for head in heads}


def _plain_table(
    piece: bytes, heads: list[str], separator: str, decimal: str
) -> dict[str, Any] | None:
    """Return the columns of lines of numbers, ``nan`` and empty cells; None for any other text, and
    where a line or a cell does not fit.

    NumPy and pandas round a number correctly, so that they give the same.
    """
    if decimal == "," and b"." in piece:
        return None
    text = piece.replace(b",", b".") if decimal == "," else piece
    if separator != "," and b"," in text:
        return None  # a comma would become a separator below
    if separator == " ":
        text = re.sub(rb"[ \t]+", b",", re.sub(rb"^[ \t]+|[ \t]+$", b"", text, flags=re.MULTILINE))
    elif separator != ",":
        text = text.replace(separator.encode(), b",")
    words = text.translate(None, _NUMBERS)
    if words and not (words.isalpha() and set(_WORD.findall(text)) <= {b"e", b"E", b"nan", b"NaN"}):
        return None
    if not text.strip():
        return None
    try:
        numbers = np.loadtxt(
            io.StringIO(_filled(text).decode("ascii")), delimiter=",", comments=None, ndmin=2
        )
    except ValueError:
        return None
    if numbers.shape[1] != len(heads):
        return None
    return dict(zip(heads, np.ascontiguousarray(numbers.T), strict=True))


def _filled(text: bytes) -> bytes:
    """Return lines of cells with ``nan`` in the empty ones; searches for two characters are six
    times as fast as a pattern.
    """
    text = b"\n" + text + b"\n"
    for before, behind in (
        (b",", b","),
        (b",", b","),
        (b"\n", b","),
        (b",", b"\n"),
    ):  # of three commas the first time sees two
        text = text.replace(before + behind, before + b"nan" + behind)
    return text


def _frame(
    piece: bytes,
    heads: list[str],
    texts: set[str],
    separator: str,
    decimal: str,
    guess: bool = False,
):
    """Return the lines as a frame, None where one does not fit; with `guess` pandas chooses the
    kind of each column.
    """

    kinds: Any = None if guess else {head: str if head in texts else np.float64 for head in heads}
    blanks = separator != " " and (
        piece.startswith(b" ") or b"\n " in piece or f"{separator} ".encode() in piece
    )
    try:
        frame = pd.read_csv(
            io.BytesIO(piece),
            sep=r"\s+" if separator == " " else separator,
            comment="#" if b"#" in piece else None,
            skipinitialspace=blanks,
            names=heads,
            header=None,
            dtype=kinds,
            decimal=decimal,
            index_col=False,
            encoding_errors="replace",
            low_memory=False,
        )
        for head in texts:
            frame[head] = frame[head].fillna("")
    except (ValueError, IndexError, pd.errors.ParserError):
        return None
    ragged = (
        separator != " "
        and b'"' not in piece
        and b"#" not in piece
        and piece.count(separator.encode()) != len(frame) * (len(heads) - 1)
    )
    return None if ragged else frame


def _find_fault(raw: bytes, begin: int, heads: list[str], separator: str, path: Path) -> None:
    """Raise for the first line with other cells than the heading."""
    for number, _, _, text in _lines(raw, begin, raw.count(b"\n", 0, begin) + 1):
        row = _cells(text.split("#")[0] or separator, separator, path, number)
        if len(row) != len(heads):
            first = ", ".join(map(repr, heads[:3])) + (" ..." if len(heads) > 3 else "")
            expected = (
                f"{len(heads)} cells, as the line of names has ({first}); delete a last "
                f"line that was cut off"
            )
            raise ParseError(str(path), number, f"{len(row)} cells", expected)
