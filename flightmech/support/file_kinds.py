"""What a file is, in words, for the error of a reader that was given a file of another kind."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ..errors import ParseError
from .input_files.text import decoded, marked_encoding
from .input_files.toml_text import toml_content

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
    b"\x93NUMPY": "a NumPy array (npy); write it as CSV with a line of names, or as HDF5 with one array for each channel",
    b"SQLite format 3": "an SQLite database; write its table as CSV",
    b"TDSm": "a LabVIEW TDMS file; write it as CSV or HDF5, for instance with npTDMS",
}
_TAR = 257  # byte where a tar archive states what it is
_NAMED = 4  # members of an archive that an error names
_LISTING = re.compile(rb"STABILITY AND CONTROL +(?:METHODS|DIGITAL DATCOM)|CONFIGURATION AUXILIARY|INPUT DATA CARDS")
_KEY = re.compile(r"^[ \t]*\[|=", re.MULTILINE)  # no TOML file has content without one
_DECK = re.compile(rb"\$FLTCON", re.I)
# kinds of TOML files by keys that no other kind has, and where they belong
TOML = {
    "an aircraft file": ({"S", "cbar"}, "goes with --aircraft or the key aircraft"),
    "a project file": ({"listings", "flights"}, "goes to aeromatch match"),
    "a case file": ({"case"}, "goes to aeromatch pom, or the key cases of a project"),
}


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return what a file is and what reads it, judged by its content, for the text of an error; it never raises one."""
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
        return "a Digital DATCOM listing (`aeromatch datcom show` reads it, `db build` makes a database of it)"
    if _DECK.search(head):
        return "an input deck of Digital DATCOM (`aeromatch datcom check` reads it)"
    return _text_kind(head.decode("utf-8", "replace"))


def packed_kind(path: str | os.PathLike[str], head: bytes) -> str:
    """Return which archive or file of another program a file is, and what to do with it; empty for any other one.

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
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return "a zip archive that is damaged or packed once more; unpack it and give the file inside"
    if "modelDescription.xml" in names:
        return "a zip archive such as an FMU (`aeromatch fmu show` reads it)"
    if any(name.startswith("xl/") for name in names):
        return "an Excel workbook (xlsx, a zip archive); save the sheet as CSV and give that file"
    if "content.xml" in names and "mimetype" in names:
        return "an OpenDocument file (a zip archive); save the sheet as CSV and give that file"
    if names and all(name.endswith(".npy") for name in names):
        return "NumPy arrays (npz, a zip archive); write them as HDF5, one array for each channel"
    files = [name for name in names if not name.endswith("/")]
    inside = ", ".join(files[:_NAMED]) + (f" and {len(files) - _NAMED} more" if len(files) > _NAMED else "")
    return f"a zip archive ({inside or 'empty'}); unpack it and give the file inside"


def _as_utf8(head: bytes) -> bytes:
    """Return the beginning of a text of UTF-16 or UTF-32 as UTF-8; what is damaged stays as it is."""
    try:
        return decoded(head[: len(head) // 4 * 4], "", "").encode()
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
