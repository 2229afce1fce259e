"""What a report states of itself: manifest, results.json and results.nc against each other,
tolerances against the table.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError, UnknownName
from flightmech.support.console import to_json_types
from pom.archive.archive import Archive, read_archive
from pom.archive.origins import (
    NAME,
    case_found_from,
    case_seen_from,
    dependency_path,
    file_sha256,
    read_report_manifest,
    report_manifest_text,
    statement_text,
)
from pom.archive.results_document import case_results_text, results_json
from pom.cases.case import PomCase
from pom.judging.beyond_the_bands import watch_channels
from pom.judging.measures.modal import mode_table
from pom.judging.signals import traces_of
from pom.judging.verdict import judge_all, verdict_row
from pom.replaying.trim import beyond_limits, result_trim_limits
from pom.result import NUMBERS, PomResult
from pom.tolerances import rows
from pom.tolerances.bands import RowRemark

CLOSE = 1e-6
"""Relative difference of a number that still counts as the same: another processor rounds a fit differently."""
FLOWN_ALIKE = 1e-3
"""Difference of a ratio to the tolerance that still counts as the same: tuning flies the kernel, the report an FMU of it."""


def compare_statements(
    folder: Path, statement: Mapping[str, Any]
) -> Iterator[tuple[str, str, str]]:
    """Yield what was compared: kind, name, and the differences as one text, empty where there are
    none.

    The manifest and ``results.json``, field by field, against ``results.nc``, and the criteria of
    every case against the tolerance table.

    Parameters
    ----------
    folder : Path
        Of the report.
    statement : mapping
        Its manifest (`read_report_manifest`).
    """
    try:
        archive = read_archive(folder)
        document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    except (AeromatchError, OSError, ValueError):
        return  # reported where the verdicts are judged again
    definition = statement["predicate"]["buildDefinition"]
    made_from = archive.provenance
    given = definition.get("externalParameters", {})
    there = {key: given.get(key, "") for key in ("title", "revision", "command", "date", "cases")}
    due = {
        "title": archive.title,
        "revision": archive.revision,
        "command": made_from.get("command", ""),
        "date": made_from.get("date", ""),
    }
    due["cases"] = [result.case.name for result in archive.results]
    yield _compared("manifest", "title, revision, command, date, cases", due, there)
    versions = statement["predicate"].get("runDetails", {}).get("builder", {}).get("version", {})
    yield _compared("manifest", "versions", dict(made_from.get("versions", {})), versions)
    own = [
        to_json_types(case_seen_from(result.case, folder).to_dict()) for result in archive.results
    ]
    cases = [
        _as_written_now(item, folder)
        for item in definition.get("internalParameters", {}).get("cases", [])
    ]
    yield _compared("manifest", "resolved cases", dict(enumerate(own)), dict(enumerate(cases)))
    hashes = {
        **made_from.get("inputs", {}),
        **{run: model.get("sha256", "") for run, model in made_from.get("models", {}).items()},
    }
    named = {
        run_of(item) or item["name"]: item["digest"]["sha256"]
        for item in definition["resolvedDependencies"]
    }
    yield _compared("manifest", "hashes of inputs and models", hashes, named)
    yield "statement", "manifest: all else", "; ".join(_all_else(folder, statement, archive))
    due = json.loads(
        results_json(
            archive,
            [case_results_text(result, mode_table(result), folder) for result in archive.results],
        )
    )
    yield (
        "statement",
        "results.json",
        "; ".join(
            islice(_unlike_numbers(_with_cases(due, folder), _with_cases(document, folder)), 5)
        ),
    )
    for run, log in archive.tunings.items():
        yield (
            "statement",
            f"tuning of {run}",
            "; ".join(differences_from_log(archive.results, run, log)),
        )
    for result in archive.results:
        yield "tolerance", result.case.name, "; ".join(differences_from_table(result.case))


def _all_else(folder: Path, statement: Mapping[str, Any], archive: Archive) -> Iterator[str]:
    """Yield what of a manifest is not as it would be written today, and other spaces or lines than
    it is written with.
    """
    definition = statement["predicate"]["buildDefinition"]
    found = [
        (run_of(item), item, dependency_path(item, folder))
        for item in definition["resolvedDependencies"]
    ]
    places = {item["name"]: str(path) for run, item, path in found if path and not run}
    paths = {run: {"path": str(path)} for run, _, path in found if path and run}
    models = {
        run: {**model, **paths.get(run, {})}
        for run, model in archive.provenance.get("models", {}).items()
    }
    located = {**archive.provenance, "places": places, "models": models}
    outputs = {item["name"]: item["digest"]["sha256"] for item in statement["subject"]}
    paper = (
        definition["externalParameters"].get("paper") if archive.paper is None else archive.paper
    )
    due = report_manifest_text(
        archive.results,
        outputs,
        folder,
        title=archive.title,
        revision=archive.revision,
        paper=paper,
        provenance=located,
    )
    yield from islice(
        _unlike_numbers(
            _without_cases_and_places(json.loads(due)), _without_cases_and_places(statement)
        ),
        5,
    )
    if (folder / NAME).read_text(encoding="utf-8") != statement_text(statement):
        yield "spaces, lines or the order of the keys are not as they are written"


def _without_cases_and_places(statement: Mapping[str, Any]) -> Any:
    """Return a manifest without its cases, which are compared by themselves, and without places,
    which it alone states.
    """
    copy = json.loads(json.dumps(statement))
    copy["predicate"]["buildDefinition"].pop("internalParameters", None)
    for item in copy["predicate"]["buildDefinition"]["resolvedDependencies"]:
        item.pop("uri", None)
    return copy


def _with_cases(document: Any, folder: Path) -> Any:
    """Return a ``results.json`` whose cases have the keys of this version."""
    try:
        return {
            **document,
            "results": [
                {**item, "case": _as_written_now(item["case"], folder)}
                for item in document["results"]
            ],
        }
    except (KeyError, TypeError):
        return document


def _unlike_numbers(due: Any, there: Any, place: str = "") -> Iterator[str]:
    """Yield the places where plain data differ; numbers within `CLOSE`: another processor rounds a
    fit differently.
    """
    if isinstance(due, Mapping) and isinstance(there, Mapping):
        for key in {**due, **there}:
            yield from _unlike_numbers(
                due.get(key), there.get(key), f"{place}.{key}" if place else str(key)
            )
    elif isinstance(due, list) and isinstance(there, list) and len(due) == len(there):
        for i, (one, other) in enumerate(zip(due, there, strict=True)):
            yield from _unlike_numbers(one, other, f"{place}[{i}]")
    elif not _alike(due, there):
        yield f"{place}: results.nc has {_short(due)}, here {_short(there)}"


def _alike(one: Any, other: Any) -> bool:
    if (
        isinstance(one, int | float)
        and isinstance(other, int | float)
        and not isinstance(one, bool)
        and not isinstance(other, bool)
    ):
        return math.isclose(one, other, rel_tol=CLOSE, abs_tol=1e-12)
    return type(one) is type(other) and one == other


def _as_written_now(case: Mapping[str, Any], folder: Path) -> Any:
    """Return a case of a manifest with the keys of this version, so that an older report is
    compared by what it states.

    Its files are found and named again, as those of ``results.nc`` are: a path that leads up beyond
    the root of the drive, since the report was moved to a folder nearer to it, ends there.
    """
    try:
        return to_json_types(
            case_seen_from(case_found_from(PomCase.from_dict(case), folder), folder).to_dict()
        )
    except (KeyError, TypeError, ValueError, IndexError):
        return dict(case)


def _compared(
    where: str, name: str, due: Mapping[Any, Any], there: Mapping[Any, Any]
) -> tuple[str, str, str]:
    """Return in what a file differs from ``results.nc``."""
    words = [
        f"{key}: results.nc has {_short(due.get(key))}, {where} {_short(there.get(key))}"
        for key in _unlike(due, there)
    ]
    return "statement", f"{where}: {name}", "; ".join(words)


def _unlike(due: Mapping[Any, Any], there: Mapping[Any, Any]) -> list[Any]:
    return [key for key in {**due, **there} if due.get(key) != there.get(key)]


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


def run_of(item: Mapping[str, Any]) -> str:
    """Return the run of a dependency that is a model; empty for an input."""
    return str(item.get("annotations", {}).get("run", ""))


def differences_from_log(
    results: Iterable[PomResult], run: str, log: Mapping[str, Any]
) -> Iterator[str]:
    """Yield the cases in which a tuned model does otherwise here than its log states."""
    due = {row["case"]: row for row in log["rows"]}
    for result in results:
        row, worst = due.get(result.case.name), result.worst(run) if run in result.runs else None
        if row is None or run not in result.runs:
            continue
        if row["after"] != result.status(run):
            yield f"{result.case.name}: {row['after']} in the log, {result.status(run)} here"
        elif (
            worst is not None
            and abs(worst["worst_ratio"] - (row["ratio_after"] or 0.0)) > FLOWN_ALIKE
        ):
            yield f"{result.case.name}: ratio {row['ratio_after']:.4g} in the log, {worst['worst_ratio']:.4g} here"


def differences_from_table(case: PomCase) -> Iterator[str]:
    """Yield what the criteria of a case have other than the rows of the tolerance table that they
    name.

    Bands that the case file set itself are marked ``case file`` in their provenance, and are not
    compared.
    """
    try:
        found = rows.rows_of_test(case.id, case.standard, case.edition)
    except UnknownName as error:
        yield str(error)
        return
    own = {criterion.name: criterion for criterion in case.criteria}
    for item, name in zip(found, rows.names_of(found), strict=True):
        criterion = own.get(name)
        if criterion is None:
            yield f"{name}: not among the criteria"
            continue
        if criterion.provenance == "case file":
            continue
        printed = rows.make_criterion(item, name, criterion.window, case.features)
        for what in ("band", "group", "condition", "provenance", "source"):
            if getattr(criterion, what) != getattr(printed, what):
                shown = [
                    getattr(value, "text", value)
                    for value in (getattr(criterion, what), getattr(printed, what))
                ]
                yield f"{name}: {what} {shown[0]!r}, the table of {case.standard}, {case.edition} has {shown[1]!r}"


KINDS = ("output", "input", "model", "statement", "tolerance", "verdict")


@dataclass(frozen=True)
class VerificationResult:
    """One thing that was checked.

    ``kind`` is one of `KINDS`; ``state`` is ``same``, ``changed`` or ``missing``; ``detail`` states
    what exactly changed.
    """

    kind: str
    name: str
    state: str
    detail: str = ""


def verify(folder: str | os.PathLike) -> list[VerificationResult]:
    """Check a report: hash all outputs and inputs again, judge all verdicts again from
    ``results.nc``, compare what the files state.

    Statements: every field of ``manifest.json`` and of ``results.json`` against ``results.nc``.
    Tolerances: the criteria of every case against the rows of the table of its standard and
    edition, bands of the case file apart.  Not covered: who wrote the report, and page and PDF but
    for their hashes.

    Parameters
    ----------
    folder : path
        With ``manifest.json``.

    Returns
    -------
    list of VerificationResult
        All that was checked; the report holds when every state is ``same``.

    Raises
    ------
    FileNotFoundError, SchemaError
        The folder holds no manifest of a report.
    """
    folder = Path(folder)
    statement = read_report_manifest(folder)
    found = [
        _hashed("output", item["name"], folder / item["name"], item["digest"]["sha256"])
        for item in statement["subject"]
    ]
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        run = run_of(item)
        name = f"{run}: {item['name']}" if run else item["name"]
        found.append(
            _hashed(
                "model" if run else "input",
                name,
                dependency_path(item, folder),
                item["digest"]["sha256"],
            )
        )
    return [
        *found,
        *(
            VerificationResult(kind, name, "changed" if detail else "same", detail)
            for kind, name, detail in compare_statements(folder, statement)
        ),
        *_verdicts(folder),
    ]


def _hashed(kind: str, name: str, path: Path | None, wanted: str) -> VerificationResult:
    if path is None:
        return VerificationResult(
            kind, name, "missing", "the manifest does not state where it lies"
        )
    if not path.is_file():
        return VerificationResult(kind, name, "missing", f"no file {path}")
    have = file_sha256(path)
    return (
        VerificationResult(kind, name, "same")
        if have == wanted
        else VerificationResult(kind, name, "changed", f"SHA-256 was {wanted}, is {have}")
    )


def _verdicts(folder: Path) -> Iterator[VerificationResult]:
    """Yield one result per case and model that states what is judged differently now, or printed
    differently in ``results.json``.
    """
    try:
        results = read_archive(folder).results
        pages = _json(folder)
        printed = [{(r["run"], r["criterion"]): r for r in item["verdict"]} for item in pages]
        statuses = [dict(item["status"]) for item in pages]
    except (AeromatchError, OSError, ValueError, KeyError, TypeError) as error:
        yield VerificationResult(
            "verdict", "all", "missing", f"the results cannot be read: {error}"
        )
        return
    if len(printed) != len(results):
        yield VerificationResult(
            "verdict",
            "all",
            "changed",
            f"results.json has {len(printed)} cases, results.nc has {len(results)}",
        )
        return
    for result, numbers, status in zip(results, printed, statuses, strict=True):
        for run in result.runs:
            stored = {row["criterion"]: row for row in result.rows if row["run"] == run}
            words = [
                *_judged_again(result, run, stored),
                *_not_stated(result, run),
                *_differences("results.json", run, stored, numbers),
            ]
            if status.get(run) != result.status(run):
                words.append(f"status {result.status(run)}, results.json {status.get(run)}")
            yield VerificationResult(
                "verdict",
                f"{result.case.name}, {run}",
                "changed" if words else "same",
                "; ".join(words),
            )


def _json(folder: Path) -> list[dict[str, Any]]:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]


def _judged_again(
    result: PomResult, run: str, stored: Mapping[str, Mapping[Hashable, Any]]
) -> Iterator[str]:
    time, refused = result.signals["time"].values, _refused(result, run)
    outcomes = judge_all(
        result.case, time, traces_of(result.signals, "flight"), traces_of(result.signals, run)
    )
    empty = {
        row["group"]
        for row in stored.values()
        if any(remark.kind == "no_value" for remark in row["remarks"])
    }
    for criterion in result.case.criteria:
        before = stored.get(criterion.name)
        if before is None:
            yield f"{criterion.name}: not in the table of verdicts"
        elif refused and criterion.applies:
            if before["verdict"] != "invalid":
                yield f"{criterion.name}: verdict {before['verdict']}, but the model stopped or its trim went beyond the limits of the case"
        else:
            now = verdict_row(run, criterion, outcomes[criterion.name])
            unseen = before["verdict"] == "invalid" and criterion.group in empty
            if not unseen and {before["verdict"], now["verdict"]} != _EMPTY:
                yield from _difference(criterion.name, "judged again", before, now)


_EMPTY = {
    "invalid",
    "not_tested",
}  # a channel without any sample is missing or empty: the archive does not show which


def _refused(result: PomResult, run: str) -> bool:
    """Whether a run carries no judgement at all."""
    return f"{run}: " in result.failure or bool(_beyond(result, run, demanded=True))


def _not_stated(result: PomResult, run: str) -> Iterator[str]:
    """Yield the remarks on the trim and on watched channels that the samples call for and no row
    states.
    """
    if _refused(result, run):
        return
    stated = {remark.text for row in result.rows if row["run"] == run for remark in row["remarks"]}
    flight, model = traces_of(result.signals, "flight"), traces_of(result.signals, run)
    due = (
        *_beyond(result, run, demanded=False),
        *watch_channels(result.case, result.signals["time"].values, flight, model),
    )
    yield from (f"{remark.text}: not stated" for remark in due if remark.text not in stated)


def _beyond(result: PomResult, run: str, demanded: bool) -> tuple[RowRemark, ...]:
    """Return what the trim of a model, by its table, has beyond its limits."""
    if run not in result.trim:
        return ()
    found = {str(name): np.array([value]) for name, value in result.trim[run].dropna().items()}
    return beyond_limits(result_trim_limits(result), found, demanded)


def _differences(
    where: str, run: str, stored: Mapping[str, Mapping[Hashable, Any]], others: Mapping[Any, Any]
) -> Iterator[str]:
    for name, before in stored.items():
        other = others.get((run, name))
        if other is None:
            yield f"{name}: not in {where}"
        else:
            yield from _difference(name, where, before, other)


def _difference(
    name: str, where: str, before: Mapping[Hashable, Any], now: Mapping[Any, Any]
) -> Iterator[str]:
    if before["verdict"] != now["verdict"]:
        yield f"{name}: verdict {before['verdict']}, {where} {now['verdict']}"
    for column in NUMBERS:
        one, other = _number(before[column]), _number(now[column])
        if math.isfinite(one) and not math.isclose(one, other, rel_tol=CLOSE, abs_tol=1e-12):
            yield f"{name}: {column} {one:.9g}, {where} {other:.9g}"


def _number(value: Any) -> float:
    """Return a stored number; JSON holds neither NaN nor infinity."""
    return float(value) if value is not None and math.isfinite(value) else math.nan
