"""Readers of text, CSV, JSON and TOML files, and the kind of a file for error messages."""

from __future__ import annotations

import codecs
import csv
import hashlib
import io
import json
import os
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from flightmech.errors import ParseError
from flightmech.support.toml_text import toml_content

MOST_COLUMNS = 20_000
"""Greatest number of columns of a CSV file. Large recordings have some thousand columns."""

WESTERN = "cp1252"
"""Encoding of texts by Western European Windows programs.

ASCII, umlauts and the degree sign have the same codes in ISO 8859-1.
"""

# UTF-32 comes before UTF-16, because its mark begins with the mark of UTF-16
_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def demand_regular(path: str | os.PathLike[str], expected: str) -> None:
    """Raise for a named pipe, a device or a socket. Folders and missing files pass.

    A reader of such a file could wait, or read, without end.

    Raises
    ------
    ParseError
        `path` exists, but it is neither a regular file nor a folder.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        expected = f"{expected} in a regular file; write it to one first"
        raise ParseError(str(path), 0, "a named pipe or a device", expected)


def read_bytes(path: str | os.PathLike[str], expected: str) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        The file does not exist, or cannot be read.
    ParseError
        It is not a regular file.
    """
    demand_regular(path, expected)
    return Path(path).read_bytes()


def marked_encoding(head: bytes) -> tuple[str, int]:
    """Return the encoding of the byte-order mark at the beginning, and the length of the mark.

    Without a mark the result is an empty text and 0.
    """
    for mark, encoding in _BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return encoding, len(mark)
    return "", 0


def decode_text(
    raw: bytes, file: str | os.PathLike[str], expected: str, otherwise: str = ""
) -> str:
    """Decode bytes as UTF-8, or in the encoding of their byte-order mark.

    Parameters
    ----------
    raw : bytes
    file : path
        Name of the file, for an error.
    expected : str
        Expected content of the file, for an error.
    otherwise : str
        Encoding with one byte per character, such as `WESTERN`, for bytes that are not UTF-8. By
        default they are an error.

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
            position = skip + error.start
            name = encoding.upper()
            if not encoding:
                name = "UTF-8 (ISO 8859-1 or Windows-1252, as it seems)"
            raise ParseError(
                file=os.fspath(file),
                line=raw.count(b"\n", 0, position) + 1,
                found=f"the byte 0x{raw[position]:02x}, which is not valid {name}",
                expected=f"{expected}; save it with the encoding UTF-8",
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
    """Return the text of a file with line feeds as line ends.

    Parameters and errors are those of `decode_text` and `read_bytes`.
    """
    return with_line_feeds(decode_text(read_bytes(path, expected), path, expected, otherwise))


def with_line_feeds(text: str) -> str:
    """Replace the line ends CR LF and CR of a text by LF."""
    if "\r" not in text:
        return text
    return text.replace("\r\n", "\n").replace("\r", "\n")


def csv_rows(
    text: str, file: str | os.PathLike[str], separator: str = ",", first: int = 1
) -> list[list[str]]:
    """Return the cells of a CSV text by row.

    Parameters
    ----------
    text : str
    file : path
        Name of the file, for an error.
    separator : str
    first : int
        Number of the first line of `text` in the file.

    Raises
    ------
    ParseError
        A cell of more than 131 072 characters, for example because of a quotation mark without its
        end, or a row of more than `MOST_COLUMNS` cells.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    rows: list[list[str]] = []
    while True:
        line = first + reader.line_num
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise ParseError(
                file=os.fspath(file),
                line=line,
                found=f"a text that is not a row of CSV ({error})",
                expected=f"cells of at most {csv.field_size_limit()} characters; look for a "
                f"quotation mark without its end",
            ) from None
        if row is None:
            return rows
        if len(row) > MOST_COLUMNS:
            expected = f"at most {MOST_COLUMNS}; divide the file into several"
            raise ParseError(os.fspath(file), line, f"{len(row)} cells", expected)
        rows.append(row)


def json_content(text: Any, file: str | os.PathLike[str], what: str) -> Any:
    """Return the content of a JSON text inside a file.

    Parameters
    ----------
    text : str or bytes
    file : path
        Name of the file, for an error.
    what : str
        Name of the text, for an error.

    Raises
    ------
    ParseError
        The text is not JSON, is nested too deep, or has an integer of thousands of digits.
    """
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        fault = f"{what} that cannot be read ({type(error).__name__}: {str(error)[:100]})"
        expected = "JSON as this program writes it; write or copy the file again"
        raise ParseError(os.fspath(file), 0, fault, expected=expected) from None


# Bytes for the recognition of a file. A listing names its program on the first page.
_HEAD = 65536
# by first bytes
_STARTS = {
    b"ULog": "a PX4 log (`aeromatch flight info` reads it)",
    b"%PDF": "a PDF document",
    b"MATLAB": "a MATLAB file",
    b"<?xml": "an XML file",
}
# archives, by first bytes
_PACKED = {
    b"\x1f\x8b": "a gzip archive",
    b"7z\xbc\xaf\x27\x1c": "a 7z archive",
    b"Rar!": "a rar archive",
    b"BZh": "a bzip2 archive",
    b"\xfd7zXZ\x00": "an xz archive",
    b"\x28\xb5\x2f\xfd": "a zstd archive",
}
# tables of other programs and the remedy, by first bytes
_OTHER_TABLES = {
    b"\xd0\xcf\x11\xe0": "an Excel workbook of the old form (xls); save the sheet as CSV",
    b"PAR1": "a Parquet file; write it as CSV or HDF5, for instance with pandas",
    b"ARROW1": "a Feather file; write it as CSV or HDF5, for instance with pandas",
    b"\x93NUMPY": "a NumPy array (npy); write it as CSV with a line of names, or as HDF5 with one "
    "array for each channel",
    b"SQLite format 3": "an SQLite database; write its table as CSV",
    b"TDSm": "a LabVIEW TDMS file; write it as CSV or HDF5, for instance with npTDMS",
}
# position of the name of the format in a tar archive
_TAR = 257
# greatest number of members of an archive in an error
_MOST_MEMBERS = 4
# its print begins as one of Digital DATCOM does
MISSILE_FILE = (
    "a file of Missile DATCOM, another program than Digital DATCOM, which aeromatch does not read"
)
_MISSILE = re.compile(rb"MISSILE DATCOM", re.I)
# namelists of its decks that Digital DATCOM does not have
_MISSILE_DECK = re.compile(rb"^ ?\$ *(?:REFQ|AXIBOD|ELLBOD|FINSET\d|DEFLCT)\b", re.I | re.M)
_LISTING = re.compile(
    rb"STABILITY AND CONTROL +(?:METHODS|DIGITAL DATCOM)|CONFIGURATION AUXILIARY|INPUT DATA CARDS"
)
# all TOML files with content have a table or a key
_KEY = re.compile(r"^[ \t]*\[|=", re.MULTILINE)
_DECK = re.compile(rb"\$FLTCON", re.I)
# kinds of TOML files, by keys that only this kind has, and the option or command for them
TOML = {
    "an aircraft file": ({"S", "cbar"}, "goes with --aircraft or the key aircraft"),
    "a project file": ({"listings", "flights"}, "goes to aeromatch match"),
    "a case file": ({"case"}, "goes to aeromatch pom, or the key cases of a project"),
}


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return the kind of a file by its content, and the command that reads it, for an error.

    The function does not raise.
    """
    if Path(path).is_dir():
        return "a folder"
    if Path(path).exists() and not Path(path).is_file():
        return "a named pipe or a device"
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
    # texts of UTF-16 have zero bytes, which the next check would take for a binary file
    if marked_encoding(head)[0].startswith(("utf-16", "utf-32")):
        head = _to_utf8(head)
    if b"\0" in head:
        return f"bytes that begin with {head[:8]!r}"
    if _MISSILE.search(head) or _MISSILE_DECK.search(head):
        return MISSILE_FILE
    if _LISTING.search(head):
        return (
            "a Digital DATCOM listing (`aeromatch datcom show` reads it, `db build` makes a "
            "database of it)"
        )
    if _DECK.search(head):
        return "an input deck of Digital DATCOM (`aeromatch datcom check` reads it)"
    return _text_kind(head.decode("utf-8", "replace"))


def packed_kind(path: str | os.PathLike[str], head: bytes) -> str:
    """Return the kind of an archive or a table of another program, and the remedy.

    The result is an empty text for other files.

    Parameters
    ----------
    path : path
    head : bytes
        First 300 bytes or more. For the kind of the content of a gzip file: the first bytes of the
        content.
    """
    if head.startswith(b"PK\x03\x04") or head.startswith(b"PK\x05\x06"):
        return _zip_kind(path)
    for start, kind in _PACKED.items():
        if head.startswith(start):
            return f"{kind}; unpack it and give the file inside"
    if head[_TAR : _TAR + 5] == b"ustar":
        return "a tar archive; unpack it and give one of the files inside"
    for start, kind in _OTHER_TABLES.items():
        if head.startswith(start):
            return kind
    return ""


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
    members = ", ".join(files[:_MOST_MEMBERS]) or "empty"
    if len(files) > _MOST_MEMBERS:
        members += f" and {len(files) - _MOST_MEMBERS} more"
    return f"a zip archive ({members}); unpack it and give the file inside"


def _to_utf8(head: bytes) -> bytes:
    """Return the beginning of a text of UTF-16 or UTF-32 as UTF-8, or the same bytes if damaged."""
    try:
        # whole characters only
        return decode_text(head[: len(head) // 4 * 4], "", "").encode()
    except ParseError:
        return head


def _hdf5_kind(path: str | os.PathLike[str]) -> str:
    import h5py

    try:
        with h5py.File(path) as file:
            groups, attributes = set(file), set(file.attrs)
    except Exception:
        # h5py raises OSError, RuntimeError, KeyError, ValueError and others for damaged bytes
        return "a damaged netCDF-4 (HDF5) file"
    if "force_axes" in attributes or {"CL", "Cm"} <= groups:
        return "an aero database (`aeromatch db show` reads it)"
    if {"states", "biases"} <= groups:
        return "a reconstructed flight path (`aeromatch flight identify` reads it)"
    if "manoeuvres" in attributes or groups & {"imu", "air_data", "controls"}:
        return "a flight record (`aeromatch flight show` reads it)"
    return "a netCDF-4 (HDF5) file"


def _text_kind(text: str) -> str:
    try:
        content = toml_content(text) if _KEY.search(text) else {}
    except ValueError:
        content = {}
    if not content:
        # also for a text of comments alone, which is TOML
        # Without the blank lines at the beginning.
        lines = text.strip().splitlines() or [""]
        return f"a text that begins with {lines[0].strip()[:40]!r}"
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
        The text is not TOML, has another encoding or exceeds the limits of `toml_content`, or the
        file is not a regular file.
    """
    path = Path(path)
    raw = read_bytes(path, _TOML)
    try:
        text = with_line_feeds(decode_text(raw, path, _TOML))
    except ParseError as error:
        # a file of another kind gets the name of its kind instead of a byte
        kind = file_kind(path)
        if kind.startswith(("a text", "bytes", "a TOML", *TOML)):
            raise
        raise ParseError(str(path), 0, kind, _TOML) from error
    try:
        return toml_content(text)
    except ValueError as error:
        kind = file_kind(path)
        if not kind.startswith("a text"):
            raise ParseError(str(path), 0, kind, _TOML) from error
        message = str(error)
        # tomllib writes the line into its message: "(at line 3, column 4)"
        match = _LINE.search(message)
        number = int(match.group(1)) if match else 0
        lines = text.splitlines()
        if not 0 < number <= len(lines):
            raise ParseError(str(path), 0, message, _TOML) from error
        raise ParseError(
            file=str(path),
            line=number,
            found=f"{lines[number - 1].strip()[:60]!r} ({message})",
            expected=f"{_TOML}; a number with a unit is a text too, 'S = \"16.9 m2\"'",
        ) from error


_LINE = re.compile(r"\(at line (\d+)[,)]")


def foreign_kind(content: Mapping[str, Any], own: Iterable[str] = ()) -> str:
    """Return a sentence if the content of a TOML file is of another kind, else an empty text.

    Parameters
    ----------
    content : mapping
    own : iterable of str
        Keys of the expected kind.
    """
    for kind, (keys, use) in TOML.items():
        if keys <= set(content) and not keys & set(own):
            return f"this is {kind} (it has {', '.join(sorted(keys))}), which {use}"
    return ""


def name_and_sha256(path: Path) -> dict[str, str]:
    """Return name and hash of a file, for a list of sources."""
    return {"name": path.name, "sha256": file_sha256(path)}


def file_sha256(file: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
