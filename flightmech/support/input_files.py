"""Readers of text, CSV and JSON files, and the hash of a file."""

from __future__ import annotations

import codecs
import csv
import hashlib
import io
import json
import os
import re
from collections.abc import Iterable, Iterator
from glob import glob, iglob
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from flightmech.errors import ParseError

P = TypeVar("P", str, Path)

MOST_PLACES = 50_000
"""Greatest number of files and folders that a pattern with ``**`` looks through."""

MOST_BYTES = 2048 << 20
"""Greatest size of a file that is read as a whole: an hour of 200 channels is 0.7 GB as text."""

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


# The kernel calls these files regular, but a reader of /proc/kmsg waits without end.
_OF_THE_KERNEL = ("/proc/", "/sys/")


def is_regular(path: str | os.PathLike[str]) -> bool:
    """Return whether a path leads to a regular file; those below /proc and /sys are not."""
    real = os.path.realpath(path)
    return os.path.isfile(real) and not str(real).startswith(_OF_THE_KERNEL)


def demand_regular(path: str | os.PathLike[str], expected: str) -> None:
    """Raise for a named pipe, a device, a socket or a file of the kernel, below /proc or /sys.

    A reader of such a file could wait, or read, without end. Folders and missing files pass.

    Raises
    ------
    ParseError
        `path` exists, but it is neither a regular file nor a folder.
    """
    path = Path(path)
    if path.exists() and not path.is_dir() and not is_regular(path):
        expected = f"{expected} in a regular file; write it to one first"
        raise ParseError(str(path), 0, "a named pipe or a device", expected)


def regular_files(paths: Iterable[P], expected: str) -> list[P]:
    """Return the regular files among the content of a folder, in the same order, without folders.

    A file that is left out would be missing from a result without a word.

    Raises
    ------
    ParseError
        A named pipe, a device or a socket, or a link to a file that does not exist.
    """
    files = []
    for path in paths:
        demand_regular(path, expected)
        if os.path.isfile(path):
            files.append(path)
        # editors lock a file by a hidden link of this kind
        elif not os.path.exists(path) and not Path(path).name.startswith("."):
            fault = "a link to a file that does not exist"
            expected = f"{expected} in a regular file; delete the link or write its file"
            raise ParseError(str(path), 0, fault, expected)
    return files


def demand_size(path: str | os.PathLike[str], most: int, expected: str) -> None:
    """Raise for a file that is too large to be read as a whole.

    Raises
    ------
    ParseError
        The file has more than `most` bytes.
    """
    size = os.path.getsize(path)
    if size > most:
        expected = f"{expected} of at most {most >> 20} MiB; divide it"
        raise ParseError(str(path), 0, f"a file of {size >> 20} MiB", expected)


def read_bytes(path: str | os.PathLike[str], expected: str) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        The file does not exist, or cannot be read.
    ParseError
        It is not a regular file, or larger than `MOST_BYTES`.
    """
    demand_regular(path, expected)
    demand_size(path, MOST_BYTES, expected)
    try:
        return Path(path).read_bytes()
    except OSError as error:
        # a fault of the disk while reading has no name of a file, unlike one while opening
        if error.filename is None:
            error.filename = os.fspath(path)
        raise


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
    lines = _narrow_lines(text, file, separator, first)
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
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
            raise _too_wide(file, line, len(row))
        rows.append(row)


def _narrow_lines(
    text: str, file: str | os.PathLike[str], separator: str, first: int
) -> Iterator[str]:
    """Yield the lines; raise for more than `MOST_COLUMNS` cells before the cells are made.

    The cells of a line of 100 MB have 2 GB.
    """
    for number, line in enumerate(io.StringIO(text, newline=""), first):
        cells = line.count(separator) + 1
        if cells > MOST_COLUMNS and '"' in line:
            # separators in quotation marks do not divide
            cells = re.sub('"[^"]*"?', "", line).count(separator) + 1
        if cells > MOST_COLUMNS:
            raise _too_wide(file, number, cells)
        yield line


def _too_wide(file: str | os.PathLike[str], line: int, cells: int) -> ParseError:
    expected = f"at most {MOST_COLUMNS}; divide the file into several"
    return ParseError(os.fspath(file), line, f"{cells} cells", expected)


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
        return load_json(text)
    except (ValueError, TypeError, RecursionError) as error:
        fault = f"{what} that cannot be read ({type(error).__name__}: {str(error)[:100]})"
        expected = "JSON as this program writes it; write or copy the file again"
        raise ParseError(os.fspath(file), 0, fault, expected=expected) from None


def load_json(text: str | bytes) -> Any:
    """Return the content of a JSON text.

    Raises
    ------
    ValueError
        The text is not JSON, or has an integer of thousands of digits.
    """
    try:
        return json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise
    except ValueError:
        # int() limits the number of digits, and advises to change the limit
        raise ValueError("an integer of thousands of digits") from None


def match_files(pattern: str) -> list[str]:
    """Return the regular files that match a pattern, sorted.

    Raises
    ------
    ParseError
        The pattern also matches a named pipe, a device, a socket, or a link without its file.
    OSError
        ``**`` meets more than `MOST_PLACES` files and folders: a pattern of others may begin at the
        root of the file system, or in a folder whose links lead back to it.
    """
    for part in re.finditer(r"(?<![^/\\])\*\*(?![^/\\])", pattern):
        places = iglob(pattern[: part.end()], recursive=True)
        if next(islice(places, MOST_PLACES, None), None) is not None:
            raise OSError(f"{pattern!r} looks through more than {MOST_PLACES} files and folders")
    return regular_files(sorted(glob(pattern, recursive=True)), "an input")


def name_and_sha256(path: Path) -> dict[str, str]:
    """Return name and hash of a file, for a list of sources."""
    return {"name": path.name, "sha256": file_sha256(path)}


def file_sha256(file: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with open(file, "rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
