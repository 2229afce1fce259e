"""Last draft of a new project: columns, remarks and problems, as `aeromatch init` printed them."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aeromatch.drafting.gaps import engine_numbers
from aeromatch.drafting.name_map.offered_quantities import offered_quantities
from aeromatch.drafting.previous import DRAFT_FOLDER, read_answers
from aeromatch.drafting.sources import FILES
from aeromatch.project.project import read_project
from aeromatch.workbench.new_project.aircraft_data import aircraft_rows, fact_rows
from aeromatch.workbench.new_project.dropped_files import MOST_BYTES
from aeromatch.workbench.new_project.sources import find_sources, list_files
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import AeromatchError
from flightmech.support.atomic_write import write_text
from flighttest.records.readers.name_map import Channel
from flighttest.records.readers.name_map_reading import read_names

_DRAFT = "draft.json"
# Engines in the list of quantities, if the draft shows no more.
_FEWEST_ENGINES = 1


def keep_draft(opened: OpenProject, output: str) -> None:
    """Store what ``aeromatch init --json`` printed, with the state of the files that it describes.

    Parameters
    ----------
    opened : OpenProject
    output : str
        Standard output of the command; an output that is not a JSON object is ignored.
    """
    try:
        document = json.loads(output)
    except ValueError:
        return
    if isinstance(document, dict) and "columns" in document:
        content = {"inputs": _state_of_inputs(opened), "document": document}
        write_text(opened.work / _DRAFT, json.dumps(content) + "\n")


def _state_of_inputs(opened: OpenProject) -> str:
    """Return a digest of names, sizes and times of the sources and of the project files."""
    sources = find_sources(opened)
    own = [opened.file.parent / name for name in FILES]
    files = [*sources.listings, *sources.decks, *sources.records, *own]
    total = hashlib.sha256()
    for file in sorted(files):
        if file.exists():
            status = file.stat()
            total.update(f"{file.name}\0{status.st_size}\0{status.st_mtime_ns}\n".encode())
    return total.hexdigest()


def _read_draft(opened: OpenProject) -> tuple[dict[str, Any] | None, bool]:
    """Return the last draft, and whether a file has changed since."""
    try:
        content = json.loads((opened.work / _DRAFT).read_text(encoding="utf-8"))
        document, inputs = dict(content["document"]), content["inputs"]
    except (OSError, ValueError, KeyError, TypeError):
        return None, False
    return document, inputs != _state_of_inputs(opened)


def show_draft(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the folder of a new project: files, columns, aircraft data, remarks and problems."""
    document, is_stale = _read_draft(opened)
    folder = opened.file.parent
    title, problems = _read_title(opened)
    rows, names = _column_rows(document, folder / "names.toml")
    offered = offered_quantities(max({_FEWEST_ENGINES, *engine_numbers(names)}), known=names)
    quantities = {}
    for group, members in offered.items():
        quantities[group] = [quantity.to_dict() for quantity in members]
    return {
        "folder": str(folder),
        "title": title,
        "exists": opened.file.exists(),
        "draft_folder": (folder / DRAFT_FOLDER).is_dir(),
        "problems": problems,
        "files": list_files(opened),
        "most_bytes": MOST_BYTES,
        "drafted": document is not None,
        "stale": is_stale,
        "columns": rows,
        "quantities": quantities,
        "remarks": document["remarks"] if document else [],
        "refusals": document["problems"] if document else [],
        "listings": document["listings"] if document else [],
        "records": document["records"] if document else {},
        "prove": list(read_answers(folder).prove),
        "aircraft": aircraft_rows(folder),
        "facts": fact_rows(folder),
    }


def show_title(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the title of the project, and whether its files can be read."""
    title, problems = _read_title(opened)
    return {"title": title, "ready": opened.file.exists() and not problems}


def _read_title(opened: OpenProject) -> tuple[str, list[str]]:
    """Return the title of the project, or the name of its folder, and problems of its files."""
    if not opened.file.exists():
        return opened.file.parent.name, []
    try:
        return read_project(opened.file).title, []
    except AeromatchError as error:
        return opened.file.parent.name, list(getattr(error, "problems", ())) or [str(error)]
    except (tomllib.TOMLDecodeError, OSError) as error:
        return opened.file.parent.name, [str(error)]


def _column_rows(
    document: Mapping[str, Any] | None, names: Path
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows of the table of columns with their keys in the name map, and its quantities.

    The keys are empty for a column without a channel, and without a name map.
    """
    channels: dict[str, Channel] = {}
    try:
        for leaf in read_names(names).leaves.values():
            channels |= leaf
    except (AeromatchError, OSError):
        # Another section of the page shows the problems of the map.
        channels = {}
    rows = []
    for row in document["columns"] if document else []:
        channel = channels.get(row["quantity"])
        rows.append({**row, "keys": channel.stated() if channel else {}})
    return rows, list(channels)


ROUTES = {("GET", "/api/new"): show_draft, ("GET", "/api/title"): show_title}
"""Requests of the page of a new project, in the form of `records.ROUTES`."""
