"""Which format a file has, by its first bytes, and the reader that belongs to it."""

from __future__ import annotations

import gzip
import importlib
import struct
from pathlib import Path

from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import read_if_sealed
from flightmech.support.input_files import demand_regular, file_kind, marked_encoding, packed_kind
from flighttest.records.readers.columns import with_units_of_headings
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors, without_short_tables

# format: (module, what people call it); the modules import their packages when they read
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
_START = {
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


def recognise_recording(path: str | Path) -> str:
    """Return the format of a file, a key of `FORMATS`, from its content and not from its name.

    Raises
    ------
    ParseError
        An empty file, bytes of no known format, or a record of this package whose bytes are not
        those that were sealed.
    """
    demand_regular(path, "a recording")
    read_if_sealed(Path(path), "a recording; write or copy it again")
    with open(path, "rb") as file:
        head = file.read(4096)
    packed = head[:2] == b"\x1f\x8b"
    if packed:
        head = _unpacked(path)
    known = f"one of the formats {', '.join(dict.fromkeys(name for _, name in FORMATS.values()))}"
    if other := packed_kind(path, head):
        kind, _, remedy = other.partition("; ")
        if packed:
            kind, remedy = (
                f"a gzip archive that holds {kind}",
                "unpack it and give one of the files inside",
            )
        raise ParseError(str(path), 0, kind, f"{known}; {remedy}" if remedy else known)
    for start, form in _START.items():
        if head.startswith(start):
            if packed:
                remedy = "a recording as it is, or CSV in gzip; unpack it with gunzip"
                raise ParseError(
                    str(path), 0, f"a gzip archive that holds {FORMATS[form][1]}", remedy
                )
            _demand_record(path, form)
            return form
    if not head:
        raise ParseError(str(path), 0, "an empty file", "a recording")
    if _is_text(head):
        _demand_record(path, "csv")
        return "csv"
    if (
        len(head) >= 128
        and struct.unpack_from("<H", head, 124)[0] in (0x0100, 0x0001)
        and head[126:128] in (b"IM", b"MI")
    ):
        return "matlab5"  # written by other programs, whose text may begin differently
    raise ParseError(str(path), 0, f"bytes that begin with {head[:8]!r}", known)


def _demand_record(path: str | Path, form: str) -> None:
    """Raise for a file of this package or of DATCOM that is plainly no recording, which the readers
    of CSV and HDF5 would take for one.
    """
    kind = file_kind(path) if form in ("csv", "hdf5") else ""
    if kind.startswith(
        (
            "an aero database",
            "a Digital DATCOM",
            "an input deck",
            "a TOML",
            "an aircraft",
            "a project",
            "a case",
        )
    ):
        raise ParseError(
            str(path),
            0,
            kind,
            "a recording, such as CSV with a line of names, ULog, MATLAB or netCDF",
        )


def _unpacked(path: str | Path) -> bytes:

    with decoding_errors(path, "a whole .gz file"), gzip.open(path) as file:
        return file.read(4096)


def _is_text(head: bytes) -> bool:
    encoding = marked_encoding(head)[0]
    if encoding.startswith(("utf-16", "utf-32")):
        return True
    return not any(byte < 9 or 13 < byte < 32 for byte in head)


def open_recording(path: str | Path, names: NameMap, form: str | None = None) -> Recording:
    """Return the tables of a file of any known format.

    Parameters
    ----------
    path : str or Path
    names : NameMap
    form : str, optional
        What `recognise_recording` found, where it has been called already.

    Raises
    ------
    ParseError
        The file is damaged or of no known format.
    AeromatchError
        The package that reads the format is not installed.
    """
    module, _ = FORMATS[form or recognise_recording(path)]
    recording = importlib.import_module(f".formats.{module}", __package__).read(Path(path), names)
    return with_units_of_headings(without_short_tables(recording))
