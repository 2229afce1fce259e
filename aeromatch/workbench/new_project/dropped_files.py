"""Files that are dropped into the page, and their place in the folder of the project."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import tomlkit
from starlette.concurrency import run_in_threadpool
from tomlkit.exceptions import TOMLKitError

from aeromatch.workbench.allowed_actions import (
    ActionError,
    demand_inner_content,
    is_writable_text,
)
from aeromatch.workbench.opened import OpenProject
from aeromatch.workbench.requests.request_body import BodyError, parse_length
from flightmech.errors import AeromatchError
from flightmech.support.atomic_write import written_atomically
from flightmech.support.file_kinds import file_kind
from flightmech.support.foreign_code.portable_names import is_portable_name
from flightmech.support.input_files import file_sha256
from flighttest.records.readers.name_map_reading import read_names

MOST_BYTES = 4_000_000_000
"""Greatest size of a dropped file. [byte]"""
# Space that stays free on the disk. [byte]
_SPARE = 200_000_000
# Greatest length of a name; a file system has 255 bytes, and a copy gets a longer name.
_MOST_LETTERS = 120
_PROJECT_FILE = "aeromatch.toml"
# Place of a TOML file by the first words of its kind.
_PLACES = {"an aircraft file": "aircraft.toml", "a case file": "cases/"}


def demand_plain_name(name: str) -> None:
    """Raise if a name is not one of a file alone, without a path.

    Raises
    ------
    ActionError
    """
    is_plain = is_writable_text(name) and is_portable_name(name)
    is_hidden = name.startswith((".", "-", " ")) or name.endswith((".", " "))
    if not is_plain or is_hidden:
        raise ActionError(
            f"{name[:_MOST_LETTERS]!r} is not the name of a file alone; rename the file with "
            f"letters, digits, spaces, _ - and ."
        )
    if len(name) > _MOST_LETTERS:
        raise ActionError(
            f"the name has {len(name)} letters; rename the file to {_MOST_LETTERS} at most"
        )


def demand_request_size(length: str | None, folder: Path) -> None:
    """Raise if the stated length of a file is too large for the page or for the disk.

    Parameters
    ----------
    length : str or None
        Header ``Content-Length`` [byte]; None if the browser does not state it.
    folder : Path
        Folder on the disk of the file.

    Raises
    ------
    BodyError
        More than 4 GB.
    ActionError
        The disk has no room.
    """
    size = parse_length(length)
    if size > MOST_BYTES:
        raise _too_large()
    if size + _SPARE > shutil.disk_usage(folder).free:
        raise ActionError(f"the disk of {folder} has no room for {size / 1e6:.0f} MB")


def _too_large() -> BodyError:
    return BodyError(
        f"the file has more than {MOST_BYTES / 1e9:g} GB; copy it into the folder of the project "
        f"by hand"
    )


@contextmanager
def _temporary_file(folder: Path) -> Iterator[tuple[BinaryIO, Path]]:
    """Yield an open temporary file, which is removed at the end unless it has been moved."""
    folder.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=folder)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file, Path(name)
    finally:
        with suppress(OSError):
            Path(name).unlink()


async def receive_file(
    opened: OpenProject, name: str, length: str | None, parts: AsyncIterator[bytes]
) -> dict[str, Any]:
    """Write a dropped file into the folder of the project, completely or not at all.

    Parameters
    ----------
    opened : OpenProject
    name : str
        Name of the file without a path.
    length : str or None
        As in `demand_request_size`.
    parts : asynchronous iterator of bytes
        Content of the file.

    Returns
    -------
    dict
        ``name`` in the folder, ``bytes``, and ``copy``: the name of the copy of an older
        file with another content, or None.

    Raises
    ------
    ActionError
        The name, the size or the content is refused.
    """
    demand_plain_name(name)
    demand_request_size(length, opened.work)
    size = 0
    with _temporary_file(opened.work / "dropped") as (file, place):
        async for part in parts:
            size += len(part)
            if size > MOST_BYTES:
                raise _too_large()
            file.write(part)
        file.close()
        # The hash and the flush of a large file would keep other requests waiting.
        return await run_in_threadpool(_place_file, opened, place, name)


def _place_file(opened: OpenProject, content: Path, name: str) -> dict[str, Any]:
    """Move a received file to its place in the folder of the project."""
    size = content.stat().st_size
    if size == 0:
        raise ActionError(f"{name} is empty; drop the file itself, not a link or a folder")
    inner = _inner_place(content, name)
    target = opened.file.parent / inner
    if target.is_symlink() or not opened.places.holds(target):
        raise ActionError(f"{inner} is a link in the folder of the project; remove the link first")
    if target.is_dir():
        raise ActionError(f"{inner} is a folder of the project; rename the file")
    result: dict[str, Any] = {"name": inner, "bytes": size, "copy": None}
    is_same = target.exists() and file_sha256(target) == file_sha256(content)
    if not is_same:
        target.parent.mkdir(exist_ok=True)
        if target.exists():
            result["copy"] = _copy_older(target)
        with written_atomically(target) as part:
            shutil.move(content, part)
            part.chmod(0o644)
    return result


def _copy_older(file: Path) -> str:
    """Copy a file that is to be replaced, and return the name of the copy."""
    number = 1
    while (copy := file.with_name(f"{file.name}.{number}.bak")).exists():
        number += 1
    with written_atomically(copy) as part:
        shutil.copyfile(file, part)
    return copy.name


def _inner_place(content: Path, name: str) -> str:
    """Return the path of a file in the folder; TOML files have a place by their kind."""
    if not name.lower().endswith(".toml"):
        return name
    try:
        document = tomlkit.parse(content.read_text(encoding="utf-8-sig")).unwrap()
    except (TOMLKitError, ValueError, RecursionError) as error:
        raise ActionError(f"{name} is not a TOML file: {error}") from error
    kind = file_kind(content)
    if kind.startswith("a project file") or name == _PROJECT_FILE:
        raise ActionError(
            f"{name} is a project file; open a project that exists with 'aeromatch view {name}'"
        )
    place = next((place for start, place in _PLACES.items() if kind.startswith(start)), "")
    # A file of the project may name files of its folder only, as with `aeromatch set`.
    demand_inner_content(document, depth=place.count("/"))
    if place:
        return place + name if place.endswith("/") else place
    return "names.toml" if _is_name_map(content) else name


def _is_name_map(file: Path) -> bool:
    try:
        return bool(read_names(file).leaves)
    except AeromatchError:
        return False
