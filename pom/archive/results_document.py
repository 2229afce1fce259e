"""``results.json``: every number that a report prints."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from flightmech.support.console import to_json_types
from pom.archive.archive import Archive, read_archive
from pom.archive.origins import NAME, case_seen_from, dependency_path, read_report_manifest
from pom.replaying.run_remarks import drift
from pom.result import PomResult, to_records, to_split_dict


def join_reports(paths: Iterable[str | os.PathLike]) -> Archive:
    """Read the results of reports and join them in their order.

    Title, revision and date are those of the first, the chapters those of the first that has any.

    Parameters
    ----------
    paths : iterable of path
        Folders of reports, or their ``results.nc``; a manifest next to them states where the inputs
        lie.

    Raises
    ------
    FileNotFoundError, SchemaError
        See `read_archive`.
    """
    parts = [(Path(path), read_archive(path)) for path in paths]
    first = parts[0][1]
    provenance = dict(first.provenance)
    located = [
        (_located(path if path.is_dir() else path.parent), path, part.provenance)
        for path, part in parts
    ]
    inputs = [
        (name, digest, places.get(name, ""), path)
        for places, path, made in located
        for name, digest in made.get("inputs", {}).items()
    ]
    models = [
        (run, model.get("sha256", ""), {**model, "path": places.get(run, "")}, path)
        for places, path, made in located
        for run, model in made.get("models", {}).items()
    ]
    known = _unambiguous({(name, digest): (place, path) for name, digest, place, path in inputs})
    provenance["inputs"] = {name: digest for name, (digest, _) in known.items()}
    provenance["places"] = {name: place for name, (_, place) in known.items() if place}
    provenance["models"] = {
        run: model
        for run, (_, model) in _unambiguous(
            {(run, sha): (model, path) for run, sha, model, path in models}
        ).items()
    }
    if records := {
        what: names
        for _, part in parts
        for what, names in part.provenance.get("records", {}).items()
    }:
        provenance["records"] = records
    if errors := {
        what: text
        for _, part in parts
        for what, text in part.provenance.get("record_errors", {}).items()
    }:
        provenance["record_errors"] = errors
    diagnoses = {name: table for _, part in parts for name, table in part.diagnoses.items()}
    tunings = {run: log for _, part in parts for run, log in part.tunings.items()}
    results = [result for _, part in parts for result in part.results]
    chapters = next((part.chapters for _, part in parts if part.chapters), b"")
    return Archive(
        results,
        first.title,
        first.revision,
        provenance,
        diagnoses,
        tunings=tunings,
        chapters=chapters,
    )


def _unambiguous(found: Mapping[tuple[str, str], tuple[Any, Path]]) -> dict[str, tuple[str, Any]]:
    """Return name -> (digest, item); where one name stands for several files, each takes the name
    of its report too.
    """
    names = [name for name, _ in found]
    return {
        name if names.count(name) == 1 else f"{name} ({path.resolve().name})": (digest, item)
        for (name, digest), (item, path) in found.items()
    }


def _located(folder: Path) -> dict[str, str]:
    """Return where the inputs of a report lie, by their names; models by their runs."""
    if not (folder / NAME).is_file():
        return {}
    found = {}
    for item in read_report_manifest(folder)["predicate"]["buildDefinition"][
        "resolvedDependencies"
    ]:
        path = dependency_path(item, folder)
        if path is not None:
            found[item.get("annotations", {}).get("run", item["name"])] = str(path.resolve())
    return found


class CaseText(NamedTuple):
    """JSON of one case: its name, all numbers, and the table of its modes, empty where it has none."""

    name: str
    numbers: str
    modes: str


def case_results_text(
    result: PomResult, modes: pd.DataFrame, folder: str | os.PathLike
) -> CaseText:
    """Return what ``results.json`` holds of a case; files are named from `folder`, `modes` is its
    `pom.judging.mode_table`.
    """
    return CaseText(
        result.case.name,
        _json(_numbers(result, folder)),
        _json(_records(modes)) if len(modes) else "",
    )


def results_json(archive: Archive, cases: Sequence[CaseText]) -> str:
    """Return the text of ``results.json``, the keys of every object in their order; the samples are
    in ``results.nc``.
    """
    parts = {
        "title": _json(archive.title),
        "revision": _json(archive.revision),
        "provenance": _json(to_json_types(archive.provenance)),
        "samples": '"results.nc"',
        "results": f"[{','.join(case.numbers for case in cases)}]",
        "modes": _joined({case.name: case.modes for case in cases if case.modes}),
        "diagnoses": _json({name: _records(table) for name, table in archive.diagnoses.items()}),
        **({"tunings": _json(to_json_types(archive.tunings))} if archive.tunings else {}),
    }
    return _joined(parts) + "\n"


def _json(item: Any) -> str:
    return json.dumps(
        item, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False
    )


def _joined(texts: dict[str, str]) -> str:
    """Return an object of JSON texts, as `_json` writes it."""
    return f"{{{','.join(f'{_json(name)}:{text}' for name, text in sorted(texts.items()))}}}"


def _numbers(result: PomResult, folder: str | os.PathLike) -> dict[str, Any]:
    samples = {run: found.numbers() for run, found in result.samples.items()}
    return to_json_types(
        {
            "case": case_seen_from(result.case, folder).to_dict(),
            "conditions": result.conditions,
            "status": {run: result.status(run) for run in result.runs},
            "attributes": dict(result.signals.attrs),
            "channels": [str(name) for name in result.signals.data_vars],
            "inputs": [str(name) for name in result.inputs.data_vars],
            "samples": int(result.signals.sizes["time"]),
            "trim": to_split_dict(result.trim),
            "drift": to_records(drift(result)),
            "verdict": result.verdict_records(),
            "failure": result.failure,
            **({"samples": samples} if samples else {}),
        }
    )


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return to_json_types(to_records(table))
