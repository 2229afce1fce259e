"""What stands behind the HDF5 content of a file, where no reader looks: an overview of it, and the
seal.

HDF5 has no check over its texts and numbers: a flipped byte changes a value unnoticed or, in the
heap of the texts, sends the library into an endless loop (HDF5 2.0).  So the last line holds the
SHA-256 of all bytes above it.  The overview is what a verb prints of the file, as JSON, so that
neither HDF5 nor NumPy is imported to print it; it is written with the content and sealed with it.
A program that changes the file in place cuts off both, since HDF5 cuts a file where its content
ends.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from flightmech.errors import ParseError

if TYPE_CHECKING:
    from hashlib import _Hash

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file."""

_SEAL = b"\nsha256 of the bytes above: %s\n"
_OVERVIEW = b"\noverview %s: "
_BEGIN = (_SEAL.split(b"%s")[0], _OVERVIEW.split(b"%s")[0])
_END_AT = {
    0: 40,
    1: 44,
    2: 28,
    3: 28,
}  # byte of the superblock, by its version, with addresses of eight bytes
_HEAD = max(_END_AT.values()) + 8
_CHUNK = 1 << 20
_LENGTH = len(_SEAL) - len(b"%s") + 64  # hexadecimal digits of a SHA-256


class Unbroken(NamedTuple):
    """A file whose bytes are as they were written: its digest, whether it is sealed, and what
    stands between content and seal.
    """

    digest: bytes
    sealed: bool
    between: bytes

    def overview(self, rules: str) -> Any:
        """Return the overview of a sealed file that was made by the rules of this name; None
        without one.
        """
        start = _OVERVIEW % rules.encode()
        if not self.sealed or not self.between.startswith(start):
            return None
        try:
            return json.loads(self.between[len(start) :])
        except (ValueError, RecursionError):  # sealed by another program
            return None


def add_seal(content: bytes, rules: str, overview: Any) -> bytes:
    """Return the content of a file with an overview, made by the rules of this name, and its seal;
    None is no overview.
    """
    return content + _tail(_sha256(content), rules, overview)


def write_seal(path: Path, rules: str, overview: Any) -> None:
    """Write overview and seal, as `sealed` gives them, behind the content of a file."""
    digest = _sha256()
    with path.open("r+b") as file:
        for chunk in _chunks(file, path.stat().st_size):
            digest.update(chunk)
        file.write(_tail(digest, rules, overview))


def _sha256(content: bytes = b"") -> _Hash:

    return sha256(content)


def _tail(digest: _Hash, rules: str, overview: Any) -> bytes:
    """Return what stands behind a content with this digest."""
    found = b""
    if overview is not None:
        found = _OVERVIEW % rules.encode() + json.dumps(overview, separators=(",", ":")).encode()
    digest.update(found)
    return found + _SEAL % digest.hexdigest().encode()


def read_if_sealed(path: Path, expected: str) -> Unbroken | None:
    """Return what a sealed file has behind its content, as `unbroken`; None for a file without a
    seal, which is not read whole.
    """
    size = path.stat().st_size if path.is_file() else 0
    if size < _LENGTH:
        return None
    with path.open("rb") as file:
        head = file.read(_HEAD)
        places = (
            min(_end_of_content(head), size),
            size - _LENGTH,
        )  # a damaged byte hides one of them
        marked = head.startswith(SIGNATURE) and any(
            _at(file, place, _LENGTH).startswith(_BEGIN) for place in places
        )
    return read_sealed_tail(path, expected) if marked else None


def read_sealed_tail(path: Path, expected: str) -> Unbroken:
    """Return what a file has behind its HDF5 content, which must be sealed, or nothing: a file of
    another program.

    Raises
    ------
    ParseError
        Its bytes are not those that were sealed; `expected` is the end of its text.
    """
    size, digest = path.stat().st_size, _sha256()
    with path.open("rb") as file:
        end = _end_of_content(file.read(_HEAD))
        file.seek(0)
        for chunk in _chunks(file, size - _LENGTH):
            digest.update(chunk)
        rest, due = file.read(), _SEAL % digest.hexdigest().encode()
        between = _at(file, min(end, size), max(size - _LENGTH - end, 0))
    if size != end and rest != due:
        raise ParseError(
            str(path), 0, "a damaged file (its SHA-256 is not that of its seal)", expected
        )
    digest.update(rest)
    return Unbroken(digest.digest(), rest == due, between)


def _chunks(file: IO[bytes], size: int) -> Iterator[bytes]:
    """Yield the next bytes of a file, `size` in all."""
    for start in range(0, size, _CHUNK):
        yield file.read(min(_CHUNK, size - start))


def _at(file: IO[bytes], place: int, size: int) -> bytes:
    file.seek(place)
    return file.read(size)


def _end_of_content(head: bytes) -> int:
    """Return the address of the end of file in an HDF5 superblock (HDF5 File Format Specification
    3.0, section II.A).
    """
    place = _END_AT.get(head[8] if len(head) > 8 else 0, _HEAD - 8)
    return int.from_bytes(head[place : place + 8], "little")


MOST_GROUPS = 5000
"""Groups of a file; one of this program has some hundred at most."""


def demand_self_contained(path: str | os.PathLike) -> None:
    """Check that an HDF5 or netCDF-4 file holds its numbers itself, each group once.

    A file that HDF5 cannot open, or that is damaged, passes: whoever reads it reports that.

    Raises
    ------
    ParseError
        The first external or symbolic link, external storage, virtual dataset, circle of groups, or
        more than `MOST_GROUPS` groups.
    """
    import h5py

    try:
        with h5py.File(
            path, "r"
        ) as file:  # as all readers do: HDF5 refuses to open one file in two ways at once
            fault = _fault(file)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError):
        return
    if fault:
        raise ParseError(
            os.fspath(path), 0, fault, "a file that holds its numbers itself; copy them into it"
        )


def _fault(file: Any) -> str:
    """Return what is wrong with the links and datasets of a file; empty when nothing is."""
    from h5py import h5d, h5g, h5l, h5o

    waiting = [("", file.id)]
    seen = {h5o.get_info(file.id).addr}
    while waiting:
        above, group = waiting.pop()
        links: list[tuple[bytes, int]] = []
        group.links.iterate(
            lambda name, link, links=links: links.append((name, link.type)), info=True
        )
        for name, kind in links:
            place = f"{above}/{name.decode('utf-8', 'surrogateescape')}"
            if kind == h5l.TYPE_EXTERNAL:
                return (
                    f"{place} is a link into another file, "
                    f"{os.fsdecode(group.links.get_val(name)[0])}"
                )
            if kind != h5l.TYPE_HARD:
                return f"{place} is a symbolic link"
            item = h5o.open(group, name)
            if (
                isinstance(item, h5d.DatasetID) and item.get_offset() is None
            ):  # else its numbers lie there, in one piece
                plan = item.get_create_plist()
                if plan.get_layout() == h5d.VIRTUAL or plan.get_external_count():
                    return f"{place} keeps its numbers in another file"
            if isinstance(item, h5g.GroupID):
                address = h5o.get_info(item).addr
                if address in seen:
                    return f"the group {place} is linked to more than once"
                seen.add(address)
                waiting.append((place, item))
                if len(seen) > MOST_GROUPS:
                    return f"more than {MOST_GROUPS} groups"
    return ""
