"""Files in the folder of a new project: recordings, listings, decks and files of the project."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aeromatch.drafting.previous import read_answers
from aeromatch.drafting.sources import FILES, Sources, source_folders, sources_of
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import SchemaError
from flightmech.support.file_kinds import file_kind

# Kinds of the files of a project, which are not sources.
_OWN_KINDS = dict(zip(FILES, ("aircraft", "name map", "manoeuvres", "project"), strict=True))
# Ends of files that are not shown: copies of older files, and files that are being written.
_NOT_SHOWN = (".bak", ".part")
# Files of a folder that are looked at.
_MOST_FILES = 2000


def find_sources(opened: OpenProject) -> Sources:
    """Return the listings, decks and recordings that `aeromatch init` takes for the folder."""
    folder = opened.file.parent
    answers = read_answers(folder)
    datcom, records = answers.datcom, answers.records
    if not datcom and not records:
        places = tuple(place for place in source_folders(folder) if place != opened.work)
        datcom, records = places, places
    files: list[Path] = []
    for place in {*datcom, *records}:
        files += _files_at(place)

    def find() -> Sources:
        try:
            return sources_of(list(datcom), list(records))
        except SchemaError:
            # The folder has no source yet.
            return Sources((), (), ())

    return opened.kept(("sources", str(folder)), sorted(files), find)


def _files_at(place: Path) -> list[Path]:
    if place.is_dir():
        return [item for item in place.iterdir() if item.is_file()][:_MOST_FILES]
    return [place]


def recordings_of(opened: OpenProject) -> dict[str, Path]:
    """Return the recordings of the folder by their names: the files without extension.

    Recordings of one name, such as a.csv and a.mat, keep their extensions here; `aeromatch init`
    refuses them.
    """
    records = find_sources(opened).records
    counts = Counter(file.stem for file in records)
    return {file.stem if counts[file.stem] == 1 else file.name: file for file in records}


def list_files(opened: OpenProject) -> list[dict[str, Any]]:
    """Return name, kind and size [byte] of the files in the folder and of all sources.

    A file that is not used has the reason as its kind.
    """
    sources = find_sources(opened)
    kinds: dict[Path, str] = {}
    groups: Mapping[str, tuple[Path, ...]] = {
        "recording": sources.records,
        "listing": sources.listings,
        "deck": sources.decks,
    }
    for kind, files in groups.items():
        kinds.update(dict.fromkeys(files, kind))
    for file in sorted(_files_at(opened.file.parent)):
        if file not in kinds and not file.name.startswith(".") and file.suffix not in _NOT_SHOWN:
            kinds[file] = _OWN_KINDS.get(file.name) or f"not used: {file_kind(file)}"
    rows = []
    for file, kind in kinds.items():
        name = opened.places.named(file).removeprefix("{project}/")
        rows.append({"name": name, "kind": kind, "bytes": file.stat().st_size})
    return rows
