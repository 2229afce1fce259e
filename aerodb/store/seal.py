"""What stands behind the HDF5 content of a database file, where no reader looks: an overview of the database, and the seal.

HDF5 has no check over its texts and numbers: a flipped byte changes a value unnoticed or, in the heap of the texts, sends the
library into an endless loop (HDF5 2.0).  So the last line holds the SHA-256 of all bytes above it.  The overview is what a list of the
terms shows, as JSON, so that neither HDF5 nor NumPy is imported to print it; it is written with the content and sealed with it.  A program
that changes the file in place cuts off both, since HDF5 cuts a file where its content ends.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flightmech.errors import ParseError
from flightmech.support.file_kinds import file_kind

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SEAL = b"\nsha256 of the bytes above: %s\n"
_OVERVIEW = b"\noverview %d: "
_END_AT = {0: 40, 1: 44, 2: 28, 3: 28}  # byte of the superblock, by its version, with addresses of eight bytes
_ENDS = max(_END_AT.values())
_CHUNK = 1 << 20
_LENGTH = len(_SEAL) - len(b"%s") + 2 * hashlib.sha256().digest_size


class Unbroken(NamedTuple):
    """A file whose bytes are as they were written: its digest, whether it is sealed, and what stands between content and seal."""

    digest: bytes
    sealed: bool
    between: bytes

    def overview(self, number: int) -> tuple[dict[str, Any], list[dict[str, Any]]] | None:
        """Return root attributes and rows of the overview; None without one, or with one of another number: other rules made it."""
        start = _OVERVIEW % number
        if not self.sealed or not self.between.startswith(start):
            return None
        try:
            attributes, rows = json.loads(self.between[len(start) :])
        except (ValueError, TypeError, RecursionError):  # sealed by another program
            return None
        return attributes, rows


def sealed(content: bytes, number: int, overview: tuple[Mapping[str, Any], Sequence[Mapping[str, Any]]] | None) -> bytes:
    """Return the content of a file with an overview, which is of rules with this number, and its seal."""
    if overview is not None:
        content += _OVERVIEW % number + json.dumps(overview, separators=(",", ":")).encode()
    return content + _SEAL % hashlib.sha256(content).hexdigest().encode()


def unbroken(path: Path) -> Unbroken:
    """Return what a file has behind its HDF5 content, which must be sealed, or nothing: a file of another program.

    Raises
    ------
    FileNotFoundError
        No such file.
    ParseError
        It is no HDF5 file, or its bytes are not those that were sealed.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; `aeromatch db build` writes a database")
    if not path.is_file() or not _is_hdf5(path):
        raise ParseError(str(path), 0, f"no netCDF-4 (HDF5) signature: {file_kind(path)}", "a database, as `aeromatch db build` writes it")
    size, digest = path.stat().st_size, hashlib.sha256()
    with path.open("rb") as file:
        end = _end_of_content(file.read(_ENDS + 8))
        file.seek(0)
        for start in range(0, size - _LENGTH, _CHUNK):
            digest.update(file.read(min(_CHUNK, size - _LENGTH - start)))
        rest, seal = file.read(), _SEAL % digest.hexdigest().encode()
        file.seek(min(end, size))
        between = file.read(max(size - _LENGTH - end, 0))
    if size != end and rest != seal:
        raise ParseError(str(path), 0, "a damaged file (its SHA-256 is not that of its seal)", "a database; build or copy it again")
    digest.update(rest)
    return Unbroken(digest.digest(), rest == seal, between)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        if file.read(len(_SIGNATURE)) == _SIGNATURE:
            return True
    import h5py  # HDF5 looks for its signature further on too

    return bool(h5py.is_hdf5(path))


def _end_of_content(head: bytes) -> int:
    """Return the address of the end of file in an HDF5 superblock (HDF5 File Format Specification 3.0, section II.A)."""
    place = _END_AT.get(head[8] if len(head) > 8 else 0, _ENDS)
    return int.from_bytes(head[place : place + 8], "little")
