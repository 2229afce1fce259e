"""Kind of a file by its content, for errors: what it is, and the command that reads it."""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from flightmech.errors import ParseError
from flightmech.support.input_files import decode_text, marked_encoding
from flightmech.support.toml_text import toml_content

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
