"""Regular files only, their encoding, and rows of CSV text."""

from __future__ import annotations

import codecs
import csv
import io
import json
import os
from pathlib import Path
from typing import Any

from ...errors import ParseError

MOST_COLUMNS = 20_000
"""Columns of a CSV file; a recording of a large flight-test installation has some thousand."""

WESTERN = "cp1252"
"""Encoding of texts by Western European Windows programs; on ASCII, umlauts and the degree sign it is ISO 8859-1."""

_BYTE_ORDER_MARKS = {  # that of UTF-32 begins like the one of UTF-16
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def demand_regular(path: str | os.PathLike[str], expected: str) -> None:
    """Refuse a named pipe, a device or a socket, whose reader could wait, or read, without end; folders and missing files pass.

    Raises
    ------
    ParseError
        See above.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        raise ParseError(str(path), 0, "a named pipe or a device", f"{expected} in a regular file; write it to one first")


def read_bytes(path: str | os.PathLike[str], expected: str) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        No such file, or it cannot be read.
    ParseError
        It is no regular file.
    """
    demand_regular(path, expected)
    return Path(path).read_bytes()


def marked_encoding(head: bytes) -> tuple[str, int]:
    """Return the encoding that a byte-order mark at the beginning states, and its length; an empty text and 0 without one."""
    return next(((encoding, len(mark)) for mark, encoding in _BYTE_ORDER_MARKS.items() if head.startswith(mark)), ("", 0))


def decoded(raw: bytes, file: str | os.PathLike[str], expected: str, otherwise: str = "") -> str:
    """Return bytes as text: UTF-8, or as their byte-order mark states.

    Parameters
    ----------
    raw : bytes
    file : path
        Their file, for the text of an error.
    expected : str
        What the file should be, for the text of an error.
    otherwise : str
        Encoding of one byte a character for what is no UTF-8, such as `WESTERN`; without it that is an error.

    Raises
    ------
    ParseError
        Bytes of another encoding, or zero bytes.
    """
    encoding, skip = marked_encoding(raw)
    try:
        text = raw[skip:].decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding in ("", "utf-8") and otherwise:
            text = raw[skip:].decode(otherwise, "replace")
        else:
            line = raw.count(b"\n", 0, skip + error.start) + 1
            name = (encoding or "utf-8").upper()
            guess = " (ISO 8859-1 or Windows-1252, as it seems)" if not encoding else ""
            found = f"the byte 0x{raw[skip + error.start]:02x}, which is no {name}{guess}"
            raise ParseError(os.fspath(file), line, found, f"{expected}; save it with the encoding UTF-8") from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        expected = f"{expected}; the file is damaged, or UTF-16 without a byte-order mark: save it with the encoding UTF-8"
        raise ParseError(os.fspath(file), line, "zero bytes", expected)
    return text


def read_text(path: str | os.PathLike[str], expected: str, otherwise: str = "") -> str:
    """Return a text file with line feeds as line ends; parameters and errors as in `decoded` and `read_bytes`."""
    return with_line_feeds(decoded(read_bytes(path, expected), path, expected, otherwise))


def with_line_feeds(text: str) -> str:
    """Return a text whose lines end with LF where they ended with CR LF or CR."""
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def csv_rows(text: str, file: str | os.PathLike[str], separator: str = ",", first: int = 1) -> list[list[str]]:
    """Return the cells of CSV text; `first` is the number of its first line.

    Raises
    ------
    ParseError
        With the line: a cell longer than the reader allows (131 072 characters), as a quotation mark without its end gives, or more
        than `MOST_COLUMNS` cells.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    rows: list[list[str]] = []
    while True:
        line = first + reader.line_num
        try:
            row = next(reader, None)
        except csv.Error as error:
            expected = f"cells of at most {csv.field_size_limit()} characters; look for a quotation mark without its end"
            raise ParseError(os.fspath(file), line, f"what is no row of CSV ({error})", expected) from None
        if row is None:
            return rows
        if len(row) > MOST_COLUMNS:
            raise ParseError(os.fspath(file), line, f"{len(row)} cells", f"at most {MOST_COLUMNS}; divide the file into several")
        rows.append(row)


def json_content(text: Any, file: str | os.PathLike[str], what: str) -> Any:
    """Return the content of a JSON text that a file carries.

    Raises
    ------
    ParseError
        It is no JSON, nested without end, or holds an integer of thousands of digits; `what` names it.
    """
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        found = f"{what} that cannot be read ({type(error).__name__}: {str(error)[:100]})"
        raise ParseError(os.fspath(file), 0, found, "JSON as this program writes it; write or copy the file again") from None
