"""Comparison of the statements of a report with its results.

The manifest and ``results.json`` are compared with ``results.nc``, the criteria of every case with
the tolerance table, and the logs of tunings with the verdicts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from flightmech.errors import AeromatchError, UnknownName
from flightmech.support.console import to_json_types
from pom.archive.archive import Archive, read_archive
from pom.archive.origins import (
    NAME,
    case_found_from,
    case_seen_from,
    dependency_path,
    report_manifest_text,
    statement_text,
)
from pom.archive.results_document import case_results_text, results_json
from pom.cases.case import PomCase
from pom.judging.measures.modal import mode_table
from pom.result import PomResult
from pom.tolerances import rows

CLOSE = 1e-6
"""Relative difference of numbers that count as equal.

A fit is rounded differently on another processor.
"""
FLOWN_ALIKE = 1e-3
"""Difference of ratios to the tolerance that count as equal.

The tuning runs the kernel, the report runs an FMU that was exported from it.
"""
_MOST_DIFFERENCES = 5  # differences that the text of one comparison lists
_MOST_CHARACTERS = 60  # of a value in such a text


def compare_statements(
    folder: Path, statement: Mapping[str, Any]
) -> Iterator[tuple[str, str, str]]:
    """Yield kind, name and differences of every comparison.

    The manifest and ``results.json`` are compared, field by field, with ``results.nc``, and the
    criteria of every case with the tolerance table.  The differences are one text, which is empty
    if there are none.

    Parameters
    ----------
    folder : Path
        Folder of the report.
    statement : mapping
        Its manifest (`read_report_manifest`).
    """
    try:
        archive = read_archive(folder)
        document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    except (AeromatchError, OSError, ValueError):
        return  # the second judgement of the verdicts reports these errors
    yield from _compare_manifest(folder, statement, archive)
    yield "statement", "results.json", "; ".join(_compare_numbers(folder, document, archive))
    for run, log in archive.tunings.items():
        differences = differences_from_log(archive.results, run, log)
        yield "statement", f"tuning of {run}", "; ".join(differences)
    for result in archive.results:
        yield "tolerance", result.case.name, "; ".join(differences_from_table(result.case))


def _compare_manifest(
    folder: Path, statement: Mapping[str, Any], archive: Archive
) -> Iterator[tuple[str, str, str]]:
    """Yield the comparisons of a manifest with ``results.nc``."""
    definition = statement["predicate"]["buildDefinition"]
    origin = archive.provenance
    # Head of the report.
    expected = {
        "title": archive.title,
        "revision": archive.revision,
        "command": origin.get("command", ""),
        "date": origin.get("date", ""),
        "cases": [result.case.name for result in archive.results],
    }
    parameters = definition.get("externalParameters", {})
    stated = {key: parameters.get(key, "") for key in expected}
    yield _compare_fields("title, revision, command, date, cases", expected, stated)

    builder = statement["predicate"].get("runDetails", {}).get("builder", {})
    versions = dict(origin.get("versions", {}))
    yield _compare_fields("versions", versions, builder.get("version", {}))

    # Cases, with the keys of this version and paths relative to the report.
    cases = []
    for result in archive.results:
        cases.append(to_json_types(case_seen_from(result.case, folder).to_dict()))
    stated_cases = []
    for item in definition.get("internalParameters", {}).get("cases", []):
        stated_cases.append(_to_current_keys(item, folder))
    yield _compare_fields(
        "resolved cases", dict(enumerate(cases)), stated=dict(enumerate(stated_cases))
    )

    # A model is listed by its run, since two models may have the same file name.
    hashes = dict(origin.get("inputs", {}))
    for run, model in origin.get("models", {}).items():
        hashes[run] = model.get("sha256", "")
    stated_hashes = {}
    for item in definition["resolvedDependencies"]:
        stated_hashes[run_of(item) or item["name"]] = item["digest"]["sha256"]
    yield _compare_fields("hashes of inputs and models", hashes, stated_hashes)

    differences = _compare_rewritten(folder, statement, archive)
    yield "statement", "manifest: all else", "; ".join(differences)


def _compare_rewritten(
    folder: Path, statement: Mapping[str, Any], archive: Archive
) -> Iterator[str]:
    """Yield differences between a manifest and the manifest that would be written today."""
    definition = statement["predicate"]["buildDefinition"]
    # Only the manifest has the paths of the inputs, so they are taken from there.
    places: dict[str, str] = {}
    models = dict(archive.provenance.get("models", {}))
    for item in definition["resolvedDependencies"]:
        run, path = run_of(item), dependency_path(item, folder)
        if path and not run:
            places[item["name"]] = str(path)
        elif path and run in models:
            models[run] = {**models[run], "path": str(path)}

    paper = archive.paper
    if paper is None:
        # results.nc of an earlier version does not state the paper
        paper = definition["externalParameters"].get("paper")
    expected = report_manifest_text(
        archive.results,
        {item["name"]: item["digest"]["sha256"] for item in statement["subject"]},
        folder,
        title=archive.title,
        revision=archive.revision,
        paper=paper,
        provenance={**archive.provenance, "places": places, "models": models},
    )
    differences = list_differences(
        _without_cases_and_places(json.loads(expected)), _without_cases_and_places(statement)
    )
    yield from islice(differences, _MOST_DIFFERENCES)
    # Equal content may be written in another form.
    if (folder / NAME).read_text(encoding="utf-8") != statement_text(statement):
        yield "spaces, lines or the order of the keys are not as they are written"


def _without_cases_and_places(statement: Mapping[str, Any]) -> Any:
    """Return a manifest without its cases and without the paths of its inputs.

    The cases are compared separately.  Only the manifest states the paths.
    """
    copy = json.loads(json.dumps(statement))
    copy["predicate"]["buildDefinition"].pop("internalParameters", None)
    for item in copy["predicate"]["buildDefinition"]["resolvedDependencies"]:
        item.pop("uri", None)
    return copy


def _compare_numbers(folder: Path, document: Any, archive: Archive) -> Iterator[str]:
    """Yield differences between ``results.json`` and the numbers of ``results.nc``."""
    cases = []
    for result in archive.results:
        cases.append(case_results_text(result, mode_table(result), folder))
    expected = json.loads(results_json(archive, cases))
    differences = list_differences(
        _with_current_cases(expected, folder), _with_current_cases(document, folder)
    )
    return islice(differences, _MOST_DIFFERENCES)


def _with_current_cases(document: Any, folder: Path) -> Any:
    """Return a ``results.json`` whose cases have the keys of this version."""
    try:
        items = []
        for item in document["results"]:
            # only the case depends on the version; other keys are compared as they are
            items.append({**item, "case": _to_current_keys(item["case"], folder)})
        return {**document, "results": items}
    except (KeyError, TypeError):
        return document


def _to_current_keys(case: Mapping[str, Any], folder: Path) -> Any:
    """Return a case of a manifest with the keys of this version, to compare older reports.

    Its files are located and named again, as those of ``results.nc`` are.  If the report was moved
    nearer to the root of the drive, a path that leads beyond the root ends there.
    """
    try:
        located = case_found_from(PomCase.from_dict(case), folder)
        return to_json_types(case_seen_from(located, folder).to_dict())
    except (KeyError, TypeError, ValueError, IndexError):
        return dict(case)


def list_differences(
    expected: Any, stated: Any, path: str = "", *, here: str = "here"
) -> Iterator[str]:
    """Yield the differences of plain data; numbers within `CLOSE` are equal.

    `expected` are those of ``results.nc``; `here` names the place of the others.
    """
    if isinstance(expected, Mapping) and isinstance(stated, Mapping):
        for key in {**expected, **stated}:
            inner = f"{path}.{key}" if path else str(key)
            yield from list_differences(expected.get(key), stated.get(key), inner, here=here)
    elif isinstance(expected, list) and isinstance(stated, list) and len(expected) == len(stated):
        for i, (item, stated_item) in enumerate(zip(expected, stated, strict=True)):
            yield from list_differences(item, stated_item, f"{path}[{i}]", here=here)
    elif not _is_equal(expected, stated):
        yield f"{path}: results.nc has {_shorten(expected)}, {here} {_shorten(stated)}"


def _is_equal(first: Any, second: Any) -> bool:
    if _is_number(first) and _is_number(second):
        # the absolute tolerance is for numbers that are zero but for rounding
        return math.isclose(first, second, rel_tol=CLOSE, abs_tol=1e-12)
    return type(first) is type(second) and first == second


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _compare_fields(
    name: str, expected: Mapping[Any, Any], stated: Mapping[Any, Any]
) -> tuple[str, str, str]:
    """Return kind, name and differences of fields of the manifest."""
    differences = []
    for key in {**expected, **stated}:
        if expected.get(key) != stated.get(key):
            differences.append(
                f"{key}: results.nc has {_shorten(expected.get(key))}, "
                f"manifest {_shorten(stated.get(key))}"
            )
    return "statement", f"manifest: {name}", "; ".join(differences)


def _shorten(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    if len(text) <= _MOST_CHARACTERS:
        return text
    return f"{text[: _MOST_CHARACTERS - 3]}..."


def run_of(item: Mapping[str, Any]) -> str:
    """Return the run of a dependency that is a model; empty for an input."""
    return str(item.get("annotations", {}).get("run", ""))


def differences_from_log(
    results: Iterable[PomResult], run: str, log: Mapping[str, Any]
) -> Iterator[str]:
    """Yield the cases whose verdict on a tuned model differs from the log of its tuning."""
    log_rows = {row["case"]: row for row in log["rows"]}
    for result in results:
        row = log_rows.get(result.case.name)
        # a case that was not part of the tuning, or is not replayed by this model
        if row is None or run not in result.runs:
            continue
        worst = result.worst(run)
        # the log judges the rows alone, which does not show the departures of the case
        judged = result.status(run).removesuffix("_with_departures")
        if row["after"] != judged:
            yield f"{result.case.name}: {row['after']} in the log, {result.status(run)} here"
        elif worst is not None:
            ratio = worst["worst_ratio"]
            if abs(ratio - (row["ratio_after"] or 0.0)) > FLOWN_ALIKE:
                yield (
                    f"{result.case.name}: ratio {row['ratio_after']:.4g} in the log, "
                    f"{ratio:.4g} here"
                )


def differences_from_table(case: PomCase) -> Iterator[str]:
    """Yield the differences between the criteria of a case and the tolerance table.

    Bands of the case file itself are marked ``case file`` in their provenance.  They are not
    compared.
    """
    try:
        table_rows = case.printed_rows()
    except UnknownName as error:
        yield str(error)
        return
    criteria = {criterion.name: criterion for criterion in case.criteria}
    for row, name in zip(table_rows, rows.names_of(table_rows), strict=True):
        criterion = criteria.get(name)
        if criterion is None:
            yield f"{name}: not among the criteria"
            continue
        if criterion.provenance == "case file":
            continue
        # The window belongs to the case, so it is not compared.
        printed = rows.make_criterion(row, name, criterion.window, case.features)
        for field in ("band", "group", "condition", "provenance", "source"):
            value, table_value = getattr(criterion, field), getattr(printed, field)
            if value != table_value:
                # A band has a text; the other fields are printed as they are.
                yield (
                    f"{name}: {field} {getattr(value, 'text', value)!r}, the table of "
                    f"{case.standard}, {case.edition} has "
                    f"{getattr(table_value, 'text', table_value)!r}"
                )
