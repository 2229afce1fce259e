"""What a file is, in words, for the error of a reader that was given a file of another kind."""

from __future__ import annotations

import codecs
import csv
import io
import json
import os
import re
import tomllib
import zipfile
from collections.abc import Iterable, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from flightmech.errors import ParseError

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
    """Refuse a named pipe, a device or a socket, whose reader could wait, or read, without end;
    folders and missing files pass.

    Raises
    ------
    ParseError
        See above.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        raise ParseError(
            str(path),
            0,
            "a named pipe or a device",
            f"{expected} in a regular file; write it to one first",
        )


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
    """Return the encoding that a byte-order mark at the beginning states, and its length; an empty
    text and 0 without one.
    """
    return next(
        (
            (encoding, len(mark))
            for mark, encoding in _BYTE_ORDER_MARKS.items()
            if head.startswith(mark)
        ),
        ("", 0),
    )


def decode_text(
    raw: bytes, file: str | os.PathLike[str], expected: str, otherwise: str = ""
) -> str:
    """Return bytes as text: UTF-8, or as their byte-order mark states.

    Parameters
    ----------
    raw : bytes
    file : path
        Their file, for the text of an error.
    expected : str
        What the file should be, for the text of an error.
    otherwise : str
        Encoding of one byte a character for what is no UTF-8, such as `WESTERN`; without it that is
        an error.

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
            raise ParseError(
                os.fspath(file), line, found, f"{expected}; save it with the encoding UTF-8"
            ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        expected = (
            f"{expected}; the file is damaged, or UTF-16 without a byte-order mark: save "
            f"it with the encoding UTF-8"
        )
        raise ParseError(os.fspath(file), line, "zero bytes", expected)
    return text


def read_text(path: str | os.PathLike[str], expected: str, otherwise: str = "") -> str:
    """Return a text file with line feeds as line ends; parameters and errors as in `decode_text` and
    `read_bytes`.
    """
    return with_line_feeds(decode_text(read_bytes(path, expected), path, expected, otherwise))


def with_line_feeds(text: str) -> str:
    """Return a text whose lines end with LF where they ended with CR LF or CR."""
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def csv_rows(
    text: str, file: str | os.PathLike[str], separator: str = ",", first: int = 1
) -> list[list[str]]:
    """Return the cells of CSV text; `first` is the number of its first line.

    Raises
    ------
    ParseError
        With the line: a cell longer than the reader allows (131 072 characters), as a quotation
        mark without its end gives, or more than `MOST_COLUMNS` cells.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    rows: list[list[str]] = []
    while True:
        line = first + reader.line_num
        try:
            row = next(reader, None)
        except csv.Error as error:
            expected = (
                f"cells of at most {csv.field_size_limit()} characters; look for a "
                f"quotation mark without its end"
            )
            raise ParseError(
                os.fspath(file), line, f"what is no row of CSV ({error})", expected
            ) from None
        if row is None:
            return rows
        if len(row) > MOST_COLUMNS:
            raise ParseError(
                os.fspath(file),
                line,
                f"{len(row)} cells",
                f"at most {MOST_COLUMNS}; divide the file into several",
            )
        rows.append(row)


def json_content(text: Any, file: str | os.PathLike[str], what: str) -> Any:
    """Return the content of a JSON text that a file carries.

    Raises
    ------
    ParseError
        It is no JSON, nested without end, or holds an integer of thousands of digits; `what` names
        it.
    """
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        found = f"{what} that cannot be read ({type(error).__name__}: {str(error)[:100]})"
        raise ParseError(
            os.fspath(file),
            0,
            found,
            "JSON as this program writes it; write or copy the file again",
        ) from None


MOST_CHARACTERS = 2**21
"""Of a TOML text; the name map of 5000 channels has a fifth of it."""

MOST_DEPTH = 100
"""Tables and arrays inside each other, and parts of a dotted key."""

_LARGEST = 2**63
_CONTROL = re.compile(
    r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]"
)  # TOML allows them as escapes; no name and no title has one
_PART = re.compile(r"\s*(?:[\w-]+|\"[^\"\n]*\"|'[^'\n]*')\s*")


def toml_content(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    ValueError
        `tomllib.TOMLDecodeError` with the line when the text is not TOML; else what goes beyond
        `MOST_CHARACTERS`, `MOST_DEPTH` or the 64 bits that TOML gives an integer, and control
        characters, which reach terminals and XML.
    """

    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{len(text)} characters, at most {MOST_CHARACTERS} are read")
    if _longest_key(text) > MOST_DEPTH:
        raise ValueError(f"a key of more than {MOST_DEPTH} parts")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep") from None
    except ValueError:  # Python's limit of the digits of an integer
        raise ValueError(
            "an integer of thousands of digits, beyond the 64 bits that TOML allows"
        ) from None
    _demand_ordinary(content)
    return content


def _longest_key(text: str) -> int:
    """Return how many parts the longest dotted key has, of long lines alone; the time of `tomllib`
    grows with its square.
    """
    lines = (line.split(".") for line in text.split("\n") if line.count(".") >= MOST_DEPTH)
    runs = (
        run
        for line in lines
        for run in groupby(line, lambda part: _PART.fullmatch(part) is not None)
    )
    return max((sum(1 for _ in group) for is_part, group in runs if is_part), default=0)


def _demand_ordinary(content: dict[str, Any]) -> None:
    """Raise for integers beyond 64 bits, control characters, and tables nested too deep."""
    waiting: list[tuple[Any, str, int]] = [(content, "", 0)]
    while waiting:
        item, place, depth = waiting.pop()
        if isinstance(item, int) and not -_LARGEST <= item < _LARGEST:
            raise ValueError(
                f"an integer of {len(str(abs(item)))} digits at {place}, beyond the 64 bits "
                f"that TOML allows"
            )
        if isinstance(item, str) and (found := _CONTROL.search(item)):
            raise ValueError(f"the control character {found[0]!r} at {place}")
        if depth > MOST_DEPTH:
            raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep")
        if isinstance(item, dict):
            waiting += [(key, f"the key {key!r}", depth) for key in item]
            waiting += [
                (part, f"{place}.{key}" if place else key, depth + 1) for key, part in item.items()
            ]
        elif isinstance(item, list):
            waiting += [(part, place, depth + 1) for part in item]


_HEAD = 65536  # bytes that decide; a listing names its program on the first page
_STARTS = {
    b"ULog": "a PX4 log (`aeromatch flight info` reads it)",
    b"%PDF": "a PDF document",
    b"MATLAB": "a MATLAB file",
    b"<?xml": "an XML file",
}
_PACKED = {
    b"\x1f\x8b": "a gzip archive",
    b"7z\xbc\xaf\x27\x1c": "a 7z archive",
    b"Rar!": "a rar archive",
    b"BZh": "a bzip2 archive",
    b"\xfd7zXZ\x00": "an xz archive",
    b"\x28\xb5\x2f\xfd": "a zstd archive",
}
_OTHER_TABLES = {
    b"\xd0\xcf\x11\xe0": "an Excel workbook of the old form (xls); save the sheet as CSV",
    b"PAR1": "a Parquet file; write it as CSV or HDF5, for instance with pandas",
    b"ARROW1": "a Feather file; write it as CSV or HDF5, for instance with pandas",
    b"\x93NUMPY": "a NumPy array (npy); write it as CSV with a line of names, or as HDF5 with one "
    "array for each channel",
    b"SQLite format 3": "an SQLite database; write its table as CSV",
    b"TDSm": "a LabVIEW TDMS file; write it as CSV or HDF5, for instance with npTDMS",
}
_TAR = 257  # byte where a tar archive states what it is
_NAMED = 4  # members of an archive that an error names
_LISTING = re.compile(
    rb"STABILITY AND CONTROL +(?:METHODS|DIGITAL DATCOM)|CONFIGURATION AUXILIARY|INPUT DATA CARDS"
)
_KEY = re.compile(r"^[ \t]*\[|=", re.MULTILINE)  # no TOML file has content without one
_DECK = re.compile(rb"\$FLTCON", re.I)
# kinds of TOML files by keys that no other kind has, and where they belong
TOML = {
    "an aircraft file": ({"S", "cbar"}, "goes with --aircraft or the key aircraft"),
    "a project file": ({"listings", "flights"}, "goes to aeromatch match"),
    "a case file": ({"case"}, "goes to aeromatch pom, or the key cases of a project"),
}


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return what a file is and what reads it, judged by its content, for the text of an error; it
    never raises one.
    """
    if Path(path).exists() and not Path(path).is_file():
        return "a folder" if Path(path).is_dir() else "a named pipe or a device"
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return "a file that cannot be read"
    if not head:
        return "an empty file"
    if head.startswith(b"\x89HDF"):
        return _hdf5_kind(path)
    for start, kind in _STARTS.items():
        if head.startswith(start):
            return kind
    if packed := packed_kind(path, head):
        return packed
    if marked_encoding(head)[0].startswith(("utf-16", "utf-32")):
        head = _as_utf8(head)
    if b"\0" in head:
        return f"bytes that begin with {head[:8]!r}"
    if _LISTING.search(head):
        return (
            "a Digital DATCOM listing (`aeromatch datcom show` reads it, `db build` makes a "
            "database of it)"
        )
    if _DECK.search(head):
        return "an input deck of Digital DATCOM (`aeromatch datcom check` reads it)"
    return _text_kind(head.decode("utf-8", "replace"))


def packed_kind(path: str | os.PathLike[str], head: bytes) -> str:
    """Return which archive or file of another program a file is, and what to do with it; empty for
    any other one.

    Parameters
    ----------
    path : path
    head : bytes
        First 300 bytes or more; of a gzip file those of its content, whose kind is then returned.
    """
    if head.startswith(b"PK\x03\x04") or head.startswith(b"PK\x05\x06"):
        return _zip_kind(path)
    for start, kind in _PACKED.items():
        if head.startswith(start):
            return f"{kind}; unpack it and give the file inside"
    if head[_TAR : _TAR + 5] == b"ustar":
        return "a tar archive; unpack it and give one of the files inside"
    return next((kind for start, kind in _OTHER_TABLES.items() if head.startswith(start)), "")


def _zip_kind(path: str | os.PathLike[str]) -> str:

    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return (
            "a zip archive that is damaged or packed once more; unpack it and give the file inside"
        )
    if "modelDescription.xml" in names:
        return "a zip archive such as an FMU (`aeromatch fmu show` reads it)"
    if any(name.startswith("xl/") for name in names):
        return "an Excel workbook (xlsx, a zip archive); save the sheet as CSV and give that file"
    if "content.xml" in names and "mimetype" in names:
        return "an OpenDocument file (a zip archive); save the sheet as CSV and give that file"
    if names and all(name.endswith(".npy") for name in names):
        return "NumPy arrays (npz, a zip archive); write them as HDF5, one array for each channel"
    files = [name for name in names if not name.endswith("/")]
    inside = ", ".join(files[:_NAMED]) + (
        f" and {len(files) - _NAMED} more" if len(files) > _NAMED else ""
    )
    return f"a zip archive ({inside or 'empty'}); unpack it and give the file inside"


def _as_utf8(head: bytes) -> bytes:
    """Return the beginning of a text of UTF-16 or UTF-32 as UTF-8; what is damaged stays as it is."""
    try:
        return decode_text(head[: len(head) // 4 * 4], "", "").encode()
    except ParseError:
        return head


def _hdf5_kind(path: str | os.PathLike[str]) -> str:
    import h5py

    try:
        with h5py.File(path) as file:
            groups, about = set(file), set(file.attrs)
    except (OSError, RuntimeError):  # h5py raises either on damaged bytes
        return "a damaged netCDF-4 (HDF5) file"
    if "force_axes" in about or {"CL", "Cm"} <= groups:
        return "an aero database (`aeromatch db show` reads it)"
    if {"states", "biases"} <= groups:
        return "a reconstructed flight path (`aeromatch flight identify` reads it)"
    if "manoeuvres" in about or groups & {"imu", "air_data", "controls"}:
        return "a flight record (`aeromatch flight show` reads it)"
    return "a netCDF-4 (HDF5) file"


def _text_kind(text: str) -> str:
    try:
        content = toml_content(text) if _KEY.search(text) else {}
    except ValueError:
        content = {}
    if not content:  # comments alone are TOML too
        first = next((line.strip() for line in text.splitlines() if line.strip()), "")
        return f"a text that begins with {first[:40]!r}"
    for kind, (keys, use) in TOML.items():
        if keys <= set(content):
            return f"{kind} (TOML, which {use})"
    return "a TOML file"


_TOML = "a TOML text (key = value, texts in quotes)"


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises
    ------
    ParseError
        With the line, when the text is not TOML; no regular file, another encoding, or a text
        beyond the limits of `toml_content`.
    """
    path = Path(path)
    raw = read_bytes(path, _TOML)
    try:
        text = with_line_feeds(decode_text(raw, path, _TOML))
    except ParseError as error:
        kind = file_kind(path)
        if kind.startswith(("a text", "bytes", "a TOML", *TOML)):
            raise
        raise ParseError(str(path), 0, kind, _TOML) from error
    try:
        return toml_content(text)
    except ValueError as error:
        place = str(error)
        line = (
            int(place.rsplit("line ", 1)[1].split(",")[0].rstrip(")"))
            if "(at line " in place
            else 0
        )
        kind = file_kind(path)
        if not kind.startswith("a text"):
            raise ParseError(str(path), 0, kind, _TOML) from error
        written = text.splitlines()
        if not 0 < line <= len(written):
            raise ParseError(str(path), 0, place, _TOML) from error
        expected = f"{_TOML}; a number with a unit is a text too, 'S = \"16.9 m2\"'"
        raise ParseError(
            str(path), line, f"{written[line - 1].strip()[:60]!r} ({place})", expected
        ) from error


def foreign_kind(content: Mapping[str, Any], own: Iterable[str] = ()) -> str:
    """Return what the content of a TOML file is when it is plainly one of another kind than that
    with the keys `own`, else nothing.
    """
    for kind, (keys, use) in TOML.items():
        if keys <= set(content) and not keys & set(own):
            return f"this is {kind} (it has {', '.join(sorted(keys))}), which {use}"
    return ""
