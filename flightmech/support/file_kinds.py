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
    b"PK\x03\x04": "a zip archive such as an FMU (`aeromatch fmu show` reads it)",
    b"ULog": "a PX4 log (`aeromatch flight info` reads it)",
    b"%PDF": "a PDF document",
    b"MATLAB": "a MATLAB file",
    b"<?xml": "an XML file",
}
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
    if marked_encoding(head)[0].startswith(("utf-16", "utf-32")):
        head = _as_utf8(head)
    if b"\0" in head:
        return f"bytes that begin with {head[:8]!r}"
    if _LISTING.search(head):
        return "a Digital DATCOM listing (`aeromatch datcom show` reads it, `db build` makes a database of it)"
    if _DECK.search(head):
        return "an input deck of Digital DATCOM (`aeromatch datcom check` reads it)"
    return _text_kind(head.decode("utf-8", "replace"))


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
