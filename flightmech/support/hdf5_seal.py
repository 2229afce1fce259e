"""Overview and seal behind the HDF5 content of a file, where HDF5 does not read.

HDF5 has no checksum of texts and numbers. A changed byte changes a value without an error. In the
heap of the texts it leads to an endless loop of the library (HDF5 2.0). Therefore the last line of
a file is the SHA-256 of all bytes above. The overview is the printed summary of the file as JSON,
which is printed without reading the HDF5 content. It is covered by the seal. A program that
changes the file in place removes both, because HDF5 truncates a file at the end of its content.
"""

from __future__ import annotations

import json
import mmap
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import h5py
from h5py import h5a, h5d, h5ds, h5g, h5l, h5o, h5t

from flightmech.errors import AeromatchError, ParseError
from flightmech.support.input_files import demand_regular

if TYPE_CHECKING:
    from hashlib import _Hash

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file."""

# templates of the seal and of the overview, and the beginning of each
_SEAL = b"\nsha256 of the bytes above: %s\n"
_OVERVIEW = b"\noverview %s: "
_BEGIN = (_SEAL.split(b"%s")[0], _OVERVIEW.split(b"%s")[0])
# position of the end-of-file address in the superblock, by version, for addresses of eight bytes
_END_ADDRESS = {0: 40, 1: 44, 2: 28, 3: 28}
_HEAD = max(_END_ADDRESS.values()) + 8
# bytes that are read at a time
_CHUNK = 1 << 20
# length of a seal, with the 64 hexadecimal digits of a SHA-256
_LENGTH = len(_SEAL) - len(b"%s") + 64


class Unbroken(NamedTuple):
    """A file with a valid seal, or without a seal.

    Its fields are the digest, whether the file has a seal, and the bytes between the content and
    the seal.
    """

    digest: bytes
    sealed: bool
    between: bytes

    def overview(self, rules: str) -> Any:
        """Return the overview of a sealed file, None if it has none of these rules.

        The name of the rules changes with the form of the overview.
        """
        start = _OVERVIEW % rules.encode()
        if not self.sealed or not self.between.startswith(start):
            return None
        try:
            return json.loads(self.between[len(start) :])
        except (ValueError, RecursionError):
            # sealed by another program
            return None


def add_seal(content: bytes, rules: str, overview: Any) -> bytes:
    """Return the content of a file with overview and seal.

    Parameters
    ----------
    content : bytes
    rules : str
        Name of the rules of the overview.
    overview : object
        Types of JSON. None writes no overview.
    """
    if overview is not None:
        text = json.dumps(overview, separators=(",", ":"))
        # the seal covers the overview
        content += _OVERVIEW % rules.encode() + text.encode()
    return content + _make_seal(sha256(content))


def write_seal(path: Path) -> None:
    """Write a seal behind the content of a file."""
    digest = sha256()
    with path.open("r+b") as file:
        for chunk in _read_chunks(file, path.stat().st_size):
            digest.update(chunk)
        file.write(_make_seal(digest))


def _make_seal(digest: _Hash) -> bytes:
    """Return the seal of a content with this digest."""
    return _SEAL % digest.hexdigest().encode()


def read_if_sealed(path: Path, expected: str) -> Unbroken | None:
    """Return the result of `read_sealed_tail` for a file with a seal, else None.

    A file without a seal is not read as a whole.
    """
    if not path.is_file():
        return None
    size = path.stat().st_size
    if size < _LENGTH:
        return None
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if not head.startswith(SIGNATURE):
            return None
        end = min(_content_end(head), size)
        # A seal is known by its length and by its beginning, at the end of the content or of the
        # file: a damaged byte can hide one of them.
        has_length = size - end == _LENGTH
        starts = (end, size - _LENGTH)
        if not has_length and not any(
            _read_at(file, start, _LENGTH).startswith(_BEGIN) for start in starts
        ):
            return None
    return read_sealed_tail(path, expected)


def read_sealed_tail(path: Path, expected: str) -> Unbroken:
    """Return the bytes behind the HDF5 content of a file, and check the seal.

    A file of another program has no bytes behind its content.

    Raises
    ------
    ParseError
        The bytes of the file do not have the SHA-256 of the seal. `expected` is the end of the
        message.
    """
    size, digest = path.stat().st_size, sha256()
    with path.open("rb") as file:
        end = _content_end(file.read(_HEAD))
        file.seek(0)
        for chunk in _read_chunks(file, size - _LENGTH):
            digest.update(chunk)
        last_bytes, seal = file.read(), _SEAL % digest.hexdigest().encode()
        between = _read_at(file, min(end, size), max(size - _LENGTH - end, 0))
    if size != end and last_bytes != seal:
        fault = "a damaged file (its SHA-256 is not that of its seal)"
        raise ParseError(str(path), 0, fault, expected=expected)
    if fault := find_false_heap(path):
        raise ParseError(str(path), 0, fault, expected=expected)
    digest.update(last_bytes)
    return Unbroken(digest.digest(), last_bytes == seal, between)


def _read_chunks(file: IO[bytes], size: int) -> Iterator[bytes]:
    """Yield the next `size` bytes of a file in chunks."""
    for start in range(0, size, _CHUNK):
        yield file.read(min(_CHUNK, size - start))


def _read_at(file: IO[bytes], position: int, size: int) -> bytes:
    file.seek(position)
    return file.read(size)


def _content_end(head: bytes) -> int:
    """Return the address of the end of file in an HDF5 superblock.

    See HDF5 File Format Specification 3.0, section II.A.
    """
    version = head[8] if len(head) > 8 else 0
    position = _END_ADDRESS.get(version, _HEAD - 8)
    return int.from_bytes(head[position : position + 8], "little")


# causes with a text of their own, which no decoder raises for a damaged content
_OTHER_CAUSES = (AeromatchError, FileNotFoundError, PermissionError, IsADirectoryError, ImportError)


@contextmanager
def decoding_errors(path: str | os.PathLike[str], expected: str) -> Iterator[None]:
    """Replace any error of a decoder by a `ParseError` with the name of the file.

    HDF5 and xarray raise OSError, KeyError, RuntimeError, ValueError and others for a damaged file.
    """
    try:
        yield
    except _OTHER_CAUSES:
        raise
    except Exception as error:
        _clear_frames(error)
        text = " ".join(str(error).split())
        raise ParseError(
            os.fspath(path),
            0,
            f"content that cannot be decoded ({type(error).__name__}: {text})",
            expected,
        ) from error


def _clear_frames(error: Exception) -> None:
    """Remove the objects of the calls that failed, without a message of Python.

    A file of h5netcdf that is opened half raises when it is removed; Python prints that error.
    """
    hook = sys.unraisablehook
    sys.unraisablehook = lambda unraisable: None
    try:
        traceback.clear_frames(error.__traceback__)
    finally:
        sys.unraisablehook = hook


# attributes of dimension scales; see "HDF5 Dimension Scale Specification"
_DIMENSIONS, _NAME = b"DIMENSION_LIST", b"NAME"

# beginning of a heap of texts (global heap collection, version 1), and its least size [byte]
_HEAP, _LEAST_HEAP = b"GCOL\x01\0\0\0", 4096

MOST_GROUPS = 5000
"""Greatest number of groups of a file. Files of this product have some hundred."""


def demand_self_contained(path: str | os.PathLike[str]) -> None:
    """Check that an HDF5 or netCDF-4 file has all its numbers inside, and each group once.

    A file that HDF5 cannot open, or that is damaged, passes. The reader of the file reports it.

    Raises
    ------
    ParseError
        An external or symbolic link, external storage, a virtual dataset, a circle of groups,
        more than `MOST_GROUPS` groups, false attributes of dimension scales, or a heap of texts
        whose objects do not fill it. A named pipe or a device, on which HDF5 would wait.
    """
    fault = find_unreadable(path)
    try:
        # in the same mode as all readers: HDF5 cannot open a file in two modes at once
        with h5py.File(path, "r") as file:
            fault = fault or _find_foreign_storage(file)
    except (OSError, KeyError, ValueError, RuntimeError, TypeError):
        return
    demand_no_fault(path, fault)


def find_unreadable(path: str | os.PathLike[str]) -> str:
    """Return the fault of a file on which HDF5 would never end, an empty text without one.

    Raises
    ------
    ParseError
        A named pipe or a device.
    """
    demand_regular(path, "an HDF5 or netCDF-4 file")
    return find_false_heap(Path(path))


def demand_no_fault(path: str | os.PathLike[str], fault: str) -> None:
    """Raise a `ParseError` for the fault of a file; an empty text is none."""
    if fault:
        expected = "a sound file that holds its numbers itself; copy them into it"
        raise ParseError(os.fspath(path), 0, fault, expected=expected)


class LinkedItems:
    """Items of the groups of a file, each checked to be inside the file.

    A reader that opens all items takes them from here, so that the file is gone through once.

    Parameters
    ----------
    root : GroupID
        The root of the file.
    """

    def __init__(self, root: h5g.GroupID) -> None:
        # Groups are identified by their address.
        self._addresses = {h5o.get_info(root).addr}

    def of(self, group: h5g.GroupID, parent: str) -> Iterator[tuple[str, Any, str]]:
        """Yield name, item and fault of each link of a group.

        The fault is an empty text for a sound item. A link with a fault is the last one.

        Parameters
        ----------
        group : GroupID
        parent : str
            Path of the group, empty for the root.
        """
        links: list[tuple[bytes, int]] = []
        # The low-level functions of h5py do not follow links.
        group.links.iterate(lambda name, link: links.append((name, link.type)), info=True)
        for key, kind in links:
            name = key.decode("utf-8", "surrogateescape")
            path = f"{parent}/{name}"
            if kind == h5l.TYPE_EXTERNAL:
                target = os.fsdecode(group.links.get_val(key)[0])
                yield name, None, f"{path} is a link into another file, {target}"
                return
            if kind != h5l.TYPE_HARD:
                yield name, None, f"{path} is a symbolic link"
                return
            item = h5o.open(group, key)
            fault = self._fault_of(item, path)
            yield name, item, fault
            if fault:
                return

    def _fault_of(self, item: Any, path: str) -> str:
        if isinstance(item, h5d.DatasetID) and _is_stored_outside(item):
            return f"{path} keeps its numbers in another file"
        if not isinstance(item, h5g.GroupID):
            return ""
        address = h5o.get_info(item).addr
        if address in self._addresses:
            return f"the group {path} is linked to more than once"
        self._addresses.add(address)
        if len(self._addresses) > MOST_GROUPS:
            return f"more than {MOST_GROUPS} groups"
        return ""


def _find_foreign_storage(file: Any) -> str:
    """Return the first fault of the links and datasets of a file, an empty text without one."""
    items = LinkedItems(file.id)
    stack = [("", file.id)]
    while stack:
        parent, group = stack.pop()
        for name, item, fault in items.of(group, parent):
            path = f"{parent}/{name}"
            if fault:
                return fault
            if isinstance(item, h5d.DatasetID) and (fault := find_false_scale(item)):
                return f"{path} has {fault}"
            if isinstance(item, h5g.GroupID):
                stack.append((path, item))
    return ""


def find_false_heap(path: Path) -> str:
    """Return the first heap of texts whose objects do not fill it, an empty text without one.

    HDF5 2.0 goes from object to object by their sizes. A size of zero is an endless loop, which no
    error ends. Sizes of a heap and of its objects: HDF5 File Format Specification 3.0, section
    III.E.
    """
    if not path.is_file() or not path.stat().st_size:
        return ""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        at = content.find(_HEAP)
        while at >= 0:
            size = int.from_bytes(content[at + 8 : at + 16], "little")
            # HDF5 refuses a heap of another size itself
            if _LEAST_HEAP <= size <= len(content) - at and not _is_filled(content, at, size):
                return f"a damaged heap of texts at byte {at}"
            at = content.find(_HEAP, at + 1)
    return ""


def _is_filled(content: mmap.mmap, start: int, size: int) -> bool:
    """Return whether the objects of a heap, each with a header of 16 bytes, fill it."""
    at, end = start + 16, start + size
    while end - at >= 16:
        number = int.from_bytes(content[at : at + 2], "little")
        length = int.from_bytes(content[at + 8 : at + 16], "little")
        # object 0 is the free space, with its header, up to the end
        if number == 0:
            return length == end - at
        at += 16 + (length + 7) // 8 * 8
    return at <= end


def find_false_scale(dataset: h5d.DatasetID) -> str:
    """Return the attribute of a dataset that is not what the interface of dimension scales wrote.

    The result is an empty text if there is none. To be called before any function of `h5ds`: that
    part of HDF5 takes for granted what the attributes hold. It follows a text as an address, and
    writes a long one beyond its memory (HDF5 2.0, H5DSiterate_scales and H5DSget_scale_name).
    """
    if h5a.exists(dataset, _DIMENSIONS):
        references = h5a.open(dataset, _DIMENSIONS)
        if references.shape != (dataset.rank,) or not _holds_references(references.get_type()):
            return "an attribute DIMENSION_LIST that is not a list of references for each dimension"
    if h5a.exists(dataset, _NAME) and h5ds.is_scale(dataset):
        name = h5a.open(dataset, _NAME)
        kind = name.get_type()
        is_fixed = kind.get_class() == h5t.STRING and not kind.is_variable_str()
        if name.shape or not is_fixed:
            return "an attribute NAME that is not one text of fixed length"
    return ""


def _holds_references(kind: h5t.TypeID) -> bool:
    """Return whether a type is a list of references to objects of variable length."""
    if kind.get_class() != h5t.VLEN:
        return False
    item = kind.get_super()
    return item.get_class() == h5t.REFERENCE and item.equal(h5t.STD_REF_OBJ)


def _is_stored_outside(dataset: Any) -> bool:
    # with an offset the numbers are at that position of this file
    if dataset.get_offset() is not None:
        return False
    plan = dataset.get_create_plist()
    return plan.get_layout() == h5d.VIRTUAL or plan.get_external_count() > 0
