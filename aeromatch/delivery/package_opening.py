"""A package opened for reading: the copy of a folder, or the content of a zip, in our own folder.

Whoever can write to the place of a package could change a file after its hash was compared. All
stages of a verification therefore read one private copy, made once.
"""

from __future__ import annotations

import errno
import os
import stat
import struct
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from aeromatch.delivery.places import MANIFEST
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.foreign_code.process import printable

# Largest size of a package. [byte]
MOST_BYTES = 20_000_000_000
# Greatest number of files (a package has some hundred), and of folders around a file (it has two).
MOST_FILES, MOST_DEPTH = 100_000, 30
# Unpacked size against that of the zip; tables of numbers shrink to a tenth at best. [byte]
_SMALL, _MOST_TIMES = 100_000_000, 100
# Fixed part of the head of a member, and the longest description behind its data. [byte]
_HEAD, _DESCRIPTION = 30, 24
# The end record of a zip without a comment. [byte]
_END = 22
# Extra field with a second name of a member, which some programs use in place of the first.
_UNICODE_PATH = 0x7075
_AT_ONCE = 1 << 20  # byte


@contextmanager
def unpack_package(package: str | Path) -> Iterator[Path]:
    """Yield a private copy of the folder of a package; a zip is unpacked into it.

    The copy is removed at the end. Links and devices of a folder are not followed: they are copied
    as such, for `check_structure` to report.

    Raises
    ------
    SchemaError
        The path is not a data package; it is too large or too deep; or the zip is damaged, has
        members outside of its folder, two of one name, links, or bytes that belong to no member.
    ParseError
        A file of the copy could not be read; the error names the package and the file in it.
    """
    package = Path(package)
    with tempfile.TemporaryDirectory() as temporary:
        root = Path(temporary) / "package"
        root.mkdir()
        if package.is_dir():
            _copy_folder(package, root)
        elif package.is_file() and zipfile.is_zipfile(package):
            _unpack(package, root)
            root = _folder_of_zip(root)
        else:
            fault = "neither a folder nor a zip; give what `aeromatch package make` wrote"
            raise SchemaError(str(package), [fault])
        if not (root / MANIFEST).is_file():
            fault = f"no {MANIFEST}; give what `aeromatch package make` wrote"
            raise SchemaError(str(package), [fault])
        try:
            yield root
        except ParseError as error:
            # the user has the package; the copy that the error names is gone when it is printed
            if not Path(error.file).is_relative_to(root):
                raise
            name = f"{package}: {Path(error.file).relative_to(root).as_posix()}"
            raise ParseError(name, error.line, error.found, error.expected) from None


def _copy_folder(package: Path, target: Path) -> None:
    """Copy a folder; links and devices become links and pipes of the copy."""
    bytes_left, count = MOST_BYTES, 0
    # folders that are not copied yet, relative to the package
    waiting = [PurePosixPath()]
    while waiting:
        relative = waiting.pop()
        if len(relative.parts) > MOST_DEPTH:
            raise SchemaError(str(package), [f"folders in more than {MOST_DEPTH} folders"])
        for entry in sorted(os.scandir(package / relative), key=lambda item: item.name):
            count += 1
            if count > MOST_FILES:
                raise SchemaError(str(package), [f"more than {MOST_FILES} files"])
            copy = target / relative / entry.name
            if entry.is_symlink():
                _copy_link(entry, copy, package)
            elif entry.is_dir(follow_symlinks=False):
                copy.mkdir()
                waiting.append(relative / entry.name)
            elif entry.is_file(follow_symlinks=False):
                bytes_left -= _copy_file(Path(entry.path), copy, bytes_left)
                if bytes_left < 0:
                    raise SchemaError(str(package), [f"more than {MOST_BYTES:g} bytes"])
            elif hasattr(os, "mkfifo"):
                os.mkfifo(copy)
            else:
                # Windows has no pipes in folders, and other kinds of files belong to no package.
                raise SchemaError(str(package), [f"{entry.name} is not a file, folder or link"])


def _copy_link(entry: os.DirEntry[str], copy: Path, package: Path) -> None:
    """Copy a link, which a later stage names. Windows lets only some users make links."""
    try:
        copy.symlink_to(os.readlink(entry.path))
    except OSError:
        fault = f"{printable(entry.name)} is a link; a package has files and folders only"
        raise SchemaError(str(package), [fault]) from None


def _copy_file(source: Path, copy: Path, most: int) -> int:
    """Copy a regular file, and return its size; at most one block more than `most`. [byte]"""
    # The file may have become a link or a pipe since it was listed: neither is followed or awaited.
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    moved = SchemaError(str(source), ["changed while it was read; verify a package at rest"])
    try:
        handle = os.open(source, flags | getattr(os, "O_BINARY", 0))
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENOENT):
            raise moved from None
        raise
    with os.fdopen(handle, "rb") as content:
        status = os.fstat(content.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise moved
        if status.st_size > most:
            return most + 1
        size = 0
        with copy.open("xb") as target:
            # A file that grows as it is read has an end, too.
            while size <= most and (block := content.read(_AT_ONCE)):
                size += target.write(block)
    return size


def _unpack(package: Path, root: Path) -> None:
    """Unpack a zip into an empty folder."""
    try:
        with zipfile.ZipFile(package) as content:
            faults = [*_find_member_faults(content, package.stat().st_size)]
            if faults:
                raise SchemaError(str(package), [printable(fault) for fault in faults[:10]])
            content.extractall(root)
    except AeromatchError:
        raise
    except OSError as error:
        if error.errno not in (errno.ENAMETOOLONG, errno.EINVAL, errno.EILSEQ):
            raise
        fault = (
            f"a name that this system does not allow ({os.strerror(error.errno)}); pack it again"
        )
        raise SchemaError(str(package), [fault]) from None
    # zipfile and its decoders raise BadZipFile, zlib.error, EOFError, RuntimeError and others
    except Exception as error:
        fault = f"a damaged zip ({str(error)[:100]}); copy it again"
        raise SchemaError(str(package), [printable(fault)]) from None


def _folder_of_zip(root: Path) -> Path:
    """Return the folder of the package in an unpacked zip: the zip itself, or its only folder."""
    if (root / MANIFEST).exists():
        return root
    folders = [item for item in root.iterdir() if item.is_dir()]
    return folders[0] if len(folders) == 1 else root


def _find_member_faults(content: zipfile.ZipFile, packed: int) -> Iterator[str]:
    """Yield what differs from a zip as `aeromatch package make` writes it."""
    members = content.infolist()
    # A small zip can unpack to fill the disk.
    size = sum(item.file_size for item in members)
    if size > min(MOST_BYTES, _SMALL + _MOST_TIMES * packed):
        yield f"unpacks to {size:g} bytes, from {packed:g}; at most {_MOST_TIMES} times as much"
    if len(members) > MOST_FILES:
        yield f"{len(members)} files; at most {MOST_FILES}"
    seen: set[str] = set()
    for item in members:
        name = item.filename
        fault = _member_fault(item)
        if fault:
            yield f"{name!r} {fault}"
        # a file and a folder
        elif name.removesuffix("/") in seen or f"{name}/" in seen:
            yield f"two files are named {name!r}"
        elif _has_second_name(item.extra) or _has_second_name(_extra_at_head(content, item)):
            yield f"{name!r} has a second name in an extra field; pack it again"
        seen.add(name)
    # What lies outside the folder of the package would escape every check.
    folders = {name.split("/")[0] for name in seen}
    if MANIFEST not in seen and len(folders) > 1:
        names = ", ".join(map(repr, sorted(folders)[:4]))
        yield f"more than one folder ({names}); a package is one"
    # Another program may read what lies between the members, as a member or as another zip.
    if _has_foreign_bytes(content):
        yield "has bytes that belong to none of its members, or members that overlap; pack it again"


def _member_fault(item: zipfile.ZipInfo) -> str:
    """Return why a member is not one of a package; empty if it is."""
    name = item.filename
    path = PurePosixPath(name)
    if path.is_absolute() or "\\" in name or ".." in path.parts:
        return "leads out of the package"
    # "./x" and "a//x" are other names of "x" and "a/x".
    if str(path) != name.removesuffix("/"):
        return "is not written as a plain name"
    if len(path.parts) > MOST_DEPTH:
        return f"is in more than {MOST_DEPTH} folders"
    if item.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "is not packed as a data package is"
    # The Unix part of the attributes; other systems leave it empty.
    kind = stat.S_IFMT(item.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is a link or a device; a package has files and folders only"
    return ""


def _extra_at_head(content: zipfile.ZipFile, item: zipfile.ZipInfo) -> bytes:
    """Return the extra fields in front of a member, which the directory may state otherwise."""
    stream = content.fp
    if stream is None:
        return b""
    stream.seek(item.header_offset)
    head = stream.read(_HEAD)
    stream.seek(item.header_offset + _HEAD + int.from_bytes(head[26:28], "little"))
    return stream.read(int.from_bytes(head[28:30], "little"))


def _has_second_name(extra: bytes) -> bool:
    """Return whether extra fields name their member once more."""
    at = 0
    while at + 4 <= len(extra):
        kind, size = struct.unpack_from("<HH", extra, at)
        if kind == _UNICODE_PATH:
            return True
        at += 4 + size
    return False


def _has_foreign_bytes(content: zipfile.ZipFile) -> bool:
    """Return whether members overlap, leave more room than a description behind the data, or are
    not all of the file.
    """
    end = 0
    stream = content.fp
    if stream is None or content.comment:
        return True
    # Python's zipfile reads over what follows the end record, which has no comment here.
    stream.seek(-_END, 2)  # from the end
    if stream.read(4) != b"PK\x05\x06":
        return True
    for item in sorted(content.infolist(), key=lambda item: item.header_offset):
        if not 0 <= item.header_offset - end <= (_DESCRIPTION if end else 0):
            return True
        stream.seek(item.header_offset)
        head = stream.read(_HEAD)
        # lengths of the name and of the extra field behind the head
        lengths = int.from_bytes(head[26:28], "little") + int.from_bytes(head[28:30], "little")
        end = item.header_offset + _HEAD + lengths + item.compress_size
    return not 0 <= content.start_dir - end <= _DESCRIPTION
