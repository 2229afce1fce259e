"""Text of ``results.json``, which holds every number that a report prints."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from flightmech.support.console import to_json_types
from pom.archive.archive import Archive, read_archive
from pom.archive.origins import NAME, case_seen_from, dependency_path, read_report_manifest
from pom.replaying.run_remarks import drift
from pom.result import PomResult, to_records, to_split_dict
from pom.result_notices import departure_remarks, spread_notice


@dataclass(frozen=True)
class _ReportPart:
    """One of the reports that are joined.

    Attributes
    ----------
    path : Path
        Folder of the report, or its ``results.nc``.
    archive : Archive
    places : dict of str to str
        Path of an input by its name, and of a model by its run.
    """

    path: Path
    archive: Archive
    places: dict[str, str]


def join_reports(paths: Iterable[str | os.PathLike]) -> Archive:
    """Read the results of reports and join them in their order.

    Title, revision and date are those of the first report.  The chapters are those of the first
    report that has any.

    Parameters
    ----------
    paths : iterable of path
        Folders of reports, or their ``results.nc``.  A manifest next to them states the paths of
        the inputs.

    Raises
    ------
    FileNotFoundError, SchemaError
        See `read_archive`.
    """
    parts = []
    for path in map(Path, paths):
        folder = path if path.is_dir() else path.parent
        parts.append(_ReportPart(path, read_archive(path), _input_places(folder)))

    # Diagnoses and tunings of a later report replace those of the same name.
    results: list[PomResult] = []
    diagnoses: dict[str, pd.DataFrame] = {}
    tunings: dict[str, dict[str, Any]] = {}
    chapters = b""
    for part in parts:
        results += part.archive.results
        diagnoses |= part.archive.diagnoses
        tunings |= part.archive.tunings
        chapters = chapters or part.archive.chapters
    first = parts[0].archive
    return Archive(
        results,
        first.title,
        revision=first.revision,
        provenance=_join_provenance(parts),
        diagnoses=diagnoses,
        tunings=tunings,
        chapters=chapters,
    )


def _join_provenance(parts: Sequence[_ReportPart]) -> dict[str, Any]:
    """Return the provenance of joined reports: that of the first with the inputs of all."""
    # The digest is part of the key: two files of one name stay apart, equal files count once.
    inputs: dict[tuple[str, str], tuple[Any, Path]] = {}
    models: dict[tuple[str, str], tuple[Any, Path]] = {}
    records: dict[str, Any] = {}
    record_errors: dict[str, Any] = {}
    for part in parts:
        origin = part.archive.provenance
        for name, digest in origin.get("inputs", {}).items():
            inputs[name, digest] = (part.places.get(name, ""), part.path)
        for run, model in origin.get("models", {}).items():
            located = {**model, "path": part.places.get(run, "")}
            models[run, model.get("sha256", "")] = (located, part.path)
        records |= origin.get("records", {})
        record_errors |= origin.get("record_errors", {})

    named_inputs = _name_uniquely(inputs)
    named_models = _name_uniquely(models)
    provenance = dict(parts[0].archive.provenance)
    provenance |= {"inputs": {}, "places": {}, "models": {}}
    for name, (digest, path) in named_inputs.items():
        provenance["inputs"][name] = digest
        # a report without a manifest does not state the path
        if path:
            provenance["places"][name] = path
    for run, (_, model) in named_models.items():
        provenance["models"][run] = model
    # keys without content are absent, as in the provenance of one report
    if records:
        provenance["records"] = records
    if record_errors:
        provenance["record_errors"] = record_errors
    return provenance


def _name_uniquely(
    items: Mapping[tuple[str, str], tuple[Any, Path]],
) -> dict[str, tuple[str, Any]]:
    """Return (digest, item) by name; equal names get the name of their report added."""
    names = [name for name, _ in items]
    unique = {}
    for (name, digest), (item, path) in items.items():
        key = name
        if names.count(name) > 1:
            key = f"{name} ({path.resolve().name})"
        unique[key] = (digest, item)
    return unique


def _input_places(folder: Path) -> dict[str, str]:
    """Return the paths of the inputs of a report by name, and of its models by run."""
    if not (folder / NAME).is_file():
        return {}
    definition = read_report_manifest(folder)["predicate"]["buildDefinition"]
    places = {}
    for item in definition["resolvedDependencies"]:
        path = dependency_path(item, folder)
        if path is not None:
            places[item.get("annotations", {}).get("run", item["name"])] = str(path.resolve())
    return places


class CaseText(NamedTuple):
    """JSON texts of one case.

    Attributes
    ----------
    name : str
        Name of the case.
    numbers : str
        All its numbers.
    modes : str
        Table of its modes; empty if it has none.
    """

    name: str
    numbers: str
    modes: str


def case_results_text(
    result: PomResult, modes: pd.DataFrame, folder: str | os.PathLike
) -> CaseText:
    """Return the texts of a case for ``results.json``.

    Parameters
    ----------
    result : PomResult
    modes : DataFrame
        Table of `pom.judging.mode_table`.
    folder : path
        Files are named relative to this folder.
    """
    modes_text = _to_json(_to_rows(modes)) if len(modes) else ""
    return CaseText(result.case.name, _to_json(_case_numbers(result, folder)), modes_text)


def results_json(archive: Archive, cases: Sequence[CaseText]) -> str:
    """Return the text of ``results.json``, with the keys of every object sorted.

    The samples are in ``results.nc``.
    """
    diagnoses = {name: _to_rows(table) for name, table in archive.diagnoses.items()}
    parts = {
        "title": _to_json(archive.title),
        "revision": _to_json(archive.revision),
        "provenance": _to_json(to_json_types(archive.provenance)),
        "samples": '"results.nc"',
        "results": f"[{','.join(case.numbers for case in cases)}]",
        "modes": _join_object({case.name: case.modes for case in cases if case.modes}),
        "diagnoses": _to_json(diagnoses),
    }
    if archive.tunings:
        parts["tunings"] = _to_json(to_json_types(archive.tunings))
    return _join_object(parts) + "\n"


def _to_json(item: Any) -> str:
    return json.dumps(
        item, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False
    )


def _join_object(texts: dict[str, str]) -> str:
    """Return a JSON object whose values are JSON texts, with the separators of `_to_json`."""
    entries = [f"{_to_json(name)}:{text}" for name, text in sorted(texts.items())]
    return f"{{{','.join(entries)}}}"


def _case_numbers(result: PomResult, folder: str | os.PathLike) -> dict[str, Any]:
    """Return all numbers of a case as plain JSON types."""
    numbers = {
        "case": case_seen_from(result.case, folder).to_dict(),
        "conditions": result.conditions,
        "status": {run: result.status(run) for run in result.runs},
        "departures": {run: departure_remarks(result, run) for run in result.runs},
        "attributes": dict(result.signals.attrs),
        "channels": [str(name) for name in result.signals.data_vars],
        "inputs": [str(name) for name in result.inputs.data_vars],
        "samples": int(result.signals.sizes["time"]),
        "trim": to_split_dict(result.trim),
        "drift": to_records(drift(result)),
        "verdict": result.verdict_records(),
        "failure": result.failure,
    }
    # With draws, the key holds their numbers in place of the number of time samples.
    if result.samples:
        numbers["samples"] = {
            run: {**replay.numbers(), "unexplained": spread_notice(result, run)}
            for run, replay in result.samples.items()
        }
    return to_json_types(numbers)


def _to_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return to_json_types(to_records(table))
