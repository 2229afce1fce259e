"""Reconstructed records that the last match has left in the store of stages."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from pathlib import Path

from aeromatch.workbench.opened import MATCH, OpenProject
from aeromatch.workflow.identification import find_paths
from flightmech.errors import AeromatchError
from flightmech.support.kept_stages.stages import NotStored, Stages
from flightmech.support.kept_stages.store import StageStore, store_folder


def list_kept_paths(opened: OpenProject) -> list[str]:
    """Return the records whose paths are in the store; none if one of them is not.

    Nothing is computed: the hashes of the inputs are looked up.
    """
    project = opened.project
    files = [opened.file, *opened.aircraft_files, *project.cases, *project.flights.values()]
    # The state of the folder of the match changes with a match, and with it what is in the store.
    files += [opened.work / MATCH / "final.nc", *([project.names] if project.names else [])]
    return opened.kept(("kept paths",), files, lambda: _look_up(opened), most=2)


def _look_up(opened: OpenProject) -> list[str]:
    folder = store_folder()
    if folder is None or not (opened.work / MATCH / "final.nc").exists():
        return []
    try:
        stages = Stages(StageStore(folder), only_stored=True)
        with warnings.catch_warnings():
            # The match has shown them.
            warnings.simplefilter("ignore")
            return list(find_paths(opened.project, 1, lambda text: nullcontext(), stages))
    except (NotStored, AeromatchError, OSError):
        return []


def has_newer_paths(opened: OpenProject, kept: list[str]) -> bool:
    """Return whether the last match came after one of the paths of its records."""
    matched = opened.work / MATCH / "final.nc"
    if not kept or not matched.exists():
        return False
    files = [opened.path_file(name) for name in kept]
    end = matched.stat().st_mtime
    return not all(file.exists() and file.stat().st_mtime >= end for file in files)


def list_older_paths(opened: OpenProject) -> list[str]:
    """Return the records whose path is older than the recording, its name map or the aircraft."""
    older = []
    for name in opened.project.flights:
        path = opened.path_file(name)
        if path.exists() and path.stat().st_mtime < _newest(opened, name):
            older.append(name)
    return older


def _newest(opened: OpenProject, name: str) -> float:
    files: list[Path] = [*opened.record_files(name), *opened.aircraft_files]
    return max(file.stat().st_mtime for file in files if file.exists())
