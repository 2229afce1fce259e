"""Where results come from: versions of the software, digests of inputs and models, the command."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .sections.provenance import Provenance

SOFTWARE = ("aeromatch", "fmpy", "numpy", "scipy", "xarray")


def provenance(inputs: Iterable[str | Path], models: Mapping[str, str | Path], command: str = "") -> Provenance:
    """Return what a report says about where its numbers come from.

    Parameters
    ----------
    inputs : iterable of path
        Files the results rest on; they are named from the folder they have in common.
    models : mapping of str to path
        Name of a run to its FMU.
    command : str
        Command line that made the results.

    Returns
    -------
    dict
        For `write_report`: ``command``, ``versions``, ``inputs`` with their SHA-256, ``models`` with theirs.
    """
    files = sorted({Path(file).resolve() for file in inputs})
    folder = os.path.commonpath([file.parent for file in files]) if files else ""
    return {
        "command": command,
        "versions": {name: version(name) for name in SOFTWARE},
        "inputs": {file.relative_to(folder).as_posix(): _sha256(file) for file in files},
        "models": {name: {"file": Path(file).name, "sha256": _sha256(Path(file))} for name, file in models.items()},
    }


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
