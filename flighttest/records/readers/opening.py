"""Recognition of the format of a recording by its first bytes, and the call of its reader."""

from __future__ import annotations

import gzip
import importlib
import struct
from pathlib import Path

from flightmech.errors import ParseError
from flightmech.plugins import RECORD_READERS, recognise_plugin
from flightmech.support.file_kinds import file_kind, packed_kind
from flightmech.support.hdf5_seal import read_if_sealed
from flightmech.support.input_files import demand_regular, marked_encoding
from flighttest.records.readers.columns import with_units_of_headings
from flighttest.records.readers.foreign_readers import read_foreign
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors, without_short_tables

# Format: module of the reader, and usual name.  A module is imported when a file needs it.
FORMATS = {
    "csv": ("csv_text", "CSV"),
    "netcdf3": ("netcdf3", "netCDF classic"),
    "hdf5": ("hdf5", "netCDF-4 or HDF5"),
    "matlab5": ("matlab", "MATLAB v5 to v7"),
    "matlab73": ("hdf5", "MATLAB v7.3"),
    "ulog": ("ulog", "PX4 ULog"),
    "dataflash": ("dataflash", "ArduPilot DataFlash"),
    "mdf": ("mdf", "MDF"),
    "chapter10": ("chapter10", "IRIG 106 Chapter 10"),
}
# First bytes of the formats.
_SIGNATURES = {
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"MATLAB 5.0 MAT-file": "matlab5",
    b"MATLAB 7.3 MAT-file": "matlab73",
    b"ULog\x01\x12\x35": "ulog",
    b"MDF     ": "mdf",
    b"UnFinMF ": "mdf",
    b"CDF\x01": "netcdf3",
    b"CDF\x02": "netcdf3",
    b"\xa3\x95": "dataflash",
    b"\x25\xeb": "chapter10",
}
# Bytes at the start of a file that decide on its format.
_HEAD_SIZE = 4096
_GZIP = b"\x1f\x8b"
# MATLAB v5: the bytes from 124 to 128 are the version and the byte order.
_MATLAB_VERSIONS = (0x0100, 0x0001)
_MATLAB_ORDERS = (b"IM", b"MI")
# Kinds of files of this package and of DATCOM that are text or HDF5, but not a recording.
_OTHER_FILES = (
    *("an aero database", "a Digital DATCOM", "an input deck", "a TOML"),
    *("an aircraft", "a project", "a case"),
)


def recognise_recording(path: str | Path) -> str:
    """Return the format of a file: a key of `FORMATS`, or the name of an entry point.

    The content of the file decides, not its name.

    Raises
    ------
    ParseError
        The file is empty or of no known format, or a sealed record is damaged.
    AeromatchError
        A reader of another package fails.
    """
    demand_regular(path, "a recording")
    read_if_sealed(Path(path), "a recording; write or copy it again")
    with open(path, "rb") as file:
        head = file.read(_HEAD_SIZE)
    is_gzip = head.startswith(_GZIP)
    if is_gzip:
        head = _unpack_head(path)
    _demand_not_packed(path, head, is_gzip)
    for signature, form in _SIGNATURES.items():
        if head.startswith(signature):
            if is_gzip:
                raise ParseError(
                    str(path),
                    line=0,
                    found=f"a gzip archive that holds {FORMATS[form][1]}",
                    expected="a recording as it is, or CSV in gzip; unpack it with gunzip",
                )
            _demand_record(path, form)
            return form
    if not head:
        raise ParseError(str(path), 0, found="an empty file", expected="a recording")
    # Text may have a format of another package, so that it is asked before CSV.
    if foreign := recognise_plugin(RECORD_READERS, path, head, own=FORMATS):
        return foreign
    if _is_text(head):
        _demand_record(path, "csv")
        return "csv"
    # Other programs may write another text at the beginning of a MATLAB file.
    if _has_matlab_version(head):
        return "matlab5"
    raise ParseError(str(path), 0, _describe_bytes(head), _known_formats())


def format_name(form: str) -> str:
    """Return the usual name of a format; an entry point has its own."""
    if form in FORMATS:
        return FORMATS[form][1]
    return form


def _has_matlab_version(head: bytes) -> bool:
    """Return whether a head has version and byte order of MATLAB v5 at its end."""
    if len(head) < 128 or head[126:128] not in _MATLAB_ORDERS:
        return False
    return struct.unpack_from("<H", head, 124)[0] in _MATLAB_VERSIONS


def _known_formats() -> str:
    """Return the formats as the text of an error."""
    names = dict.fromkeys(name for _, name in FORMATS.values())
    return f"one of the formats {', '.join(names)}"


def _demand_not_packed(path: str | Path, head: bytes, is_gzip: bool) -> None:
    """Raise for an archive or another packed file."""
    packed = packed_kind(path, head)
    if not packed:
        return
    kind, _, remedy = packed.partition("; ")
    if is_gzip:
        kind = f"a gzip archive that holds {kind}"
        remedy = "unpack it and give one of the files inside"
    expected = _known_formats()
    if remedy:
        expected += f"; {remedy}"
    raise ParseError(str(path), 0, kind, expected)


def _demand_record(path: str | Path, form: str) -> None:
    """Raise for a file of this package or of DATCOM that is text or HDF5 and not a recording."""
    if form not in ("csv", "hdf5"):
        return
    kind = file_kind(path)
    if kind.startswith(_OTHER_FILES):
        raise ParseError(
            str(path),
            line=0,
            found=kind,
            expected="a recording, such as CSV with a line of names, ULog, MATLAB or netCDF",
        )


def _unpack_head(path: str | Path) -> bytes:
    with decoding_errors(path, "a whole .gz file"), gzip.open(path) as file:
        return file.read(_HEAD_SIZE)


def _describe_bytes(head: bytes) -> str:
    """Return what the first bytes of an unknown file are, for an error."""
    if not any(head):
        return "zero bytes, as of a recording that was not written or not copied to its end"
    # One byte of each pair is zero for every letter of ASCII.
    if len(head) > 3 and not (any(head[1::2]) and any(head[::2])):
        return "a text in UTF-16 without a byte-order mark; save it with the encoding UTF-8"
    return f"bytes that begin with {head[:8]!r}"


def _is_text(head: bytes) -> bool:
    encoding = marked_encoding(head)[0]
    if encoding.startswith(("utf-16", "utf-32")):
        return True
    # Text has no control characters except tab, line feeds, form feed and carriage return.
    return not any(byte < 9 or 13 < byte < 32 for byte in head)


def open_recording(path: str | Path, names: NameMap, form: str | None = None) -> Recording:
    """Return the tables of a file of any known format.

    Parameters
    ----------
    path : str or Path
    names : NameMap
    form : str, optional
        Result of `recognise_recording`, if known.

    Raises
    ------
    ParseError
        The file is damaged or of no known format.
    AeromatchError
        The package that reads the format is not installed.
    """
    form = form or recognise_recording(path)
    if form in FORMATS:
        reader = importlib.import_module(f".formats.{FORMATS[form][0]}", __package__)
        recording = reader.read(Path(path), names)
    else:
        recording = read_foreign(Path(path), form)
    return with_units_of_headings(without_short_tables(recording))
