"""Where results come from: versions of the software, digests of inputs and models, the command."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..cases.case import PomCase
    from ..result import PomResult
    from .provenance_record import Provenance

FILES = ("path", "record", "names", "aircraft", "law", "law_names")
SOFTWARE = ("aeromatch", "fmpy", "numpy", "scipy", "typst", "xarray")


def provenance(
    inputs: Iterable[str | Path],
    models: Mapping[str, str | Path],
    command: str = "",
    date: str = "",
    digest: Callable[[str | Path], str] | None = None,
) -> Provenance:
    """Return what a report states about the origin of its numbers.

    Parameters
    ----------
    inputs : iterable of path
        Files the results rest on; they are named from the folder they have in common.
    models : mapping of str to path
        Name of a run to its FMU.
    command : str
        Command line that made the results.
    date : str
        Of the results, ``2026-11-21``; no clock is read.
    digest : callable, optional
        Gives the SHA-256 of a file: ``Custody.sha256`` of files that were taken before they were read.  Without it they are
        hashed now.

    Returns
    -------
    dict
        For `write_report`: ``command``, ``date``, ``versions``, ``inputs`` with their SHA-256, the ``places`` where they lie,
        ``models`` with file, SHA-256 and path.
    """
    digest = digest or sha256
    files = sorted({Path(file).resolve() for file in inputs})
    folder = os.path.commonpath([file.parent for file in files]) if files else ""
    return {
        "command": command,
        "date": date,
        "versions": _versions(),
        "inputs": {file.relative_to(folder).as_posix(): digest(file) for file in files},
        "places": {file.relative_to(folder).as_posix(): str(file) for file in files},
        "models": {
            name: {"file": Path(file).name, "sha256": digest(file), "path": str(Path(file).resolve())} for name, file in models.items()
        },
    }


def _versions() -> dict[str, str]:
    found = {}
    for name in SOFTWARE:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def without_places(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a report prints of its provenance: names and hashes, no folder of the machine it was made on."""
    models = {run: {key: text for key, text in model.items() if key != "path"} for run, model in provenance.get("models", {}).items()}
    kept = {key: item for key, item in provenance.items() if key != "places"}
    return {**kept, "models": models} if models else kept


def seen_from(path: str | os.PathLike, folder: str | os.PathLike) -> str:
    """Return a path as it is seen from a folder, so that a report discloses nothing of the machine it was made on."""
    try:
        return Path(os.path.relpath(Path(path).resolve(), Path(folder).resolve())).as_posix()
    except ValueError:  # another drive
        return Path(path).as_posix()


def case_seen_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case whose files are named as seen from `folder`."""
    names: dict[str, Any] = {name: seen_from(getattr(case, name), folder) for name in FILES if getattr(case, name)}
    return replace(case, **names)


def with_full_places(result: PomResult) -> PomResult:
    """Return a result whose case names its files by full paths, for processes that may have another working directory."""
    names: dict[str, Any] = {name: str(Path(getattr(result.case, name)).resolve()) for name in FILES if getattr(result.case, name)}
    return replace(result, case=replace(result.case, **names))


def case_found_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case of `case_seen_from` with its files found again."""
    names: dict[str, Any] = {name: os.path.normpath(Path(folder, getattr(case, name))) for name in FILES if getattr(case, name)}
    return replace(case, **names)


def sha256(file: str | Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with Path(file).open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
