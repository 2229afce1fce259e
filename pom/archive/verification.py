"""Verification of a report: hashes, statements, tolerances and verdicts."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError, SchemaError
from flightmech.support.input_files import file_sha256
from pom.archive.archive import read_archive
from pom.archive.case_files import compare_case_files, compare_signals
from pom.archive.origins import dependency_path, read_report_manifest
from pom.archive.program_files import compare_program
from pom.archive.statements import CLOSE, compare_statements, run_of
from pom.judging.departures import case_departures
from pom.judging.signals import traces_of
from pom.judging.verdict import judge_all, verdict_row
from pom.judging.watched_channels import watch_channels
from pom.probing.scatter_probe import measure_scatter, noise_of_inputs
from pom.replaying.recorded_runs import shows_master
from pom.replaying.table_agreement import shows_own_tables
from pom.replaying.trim import beyond_limits, result_trim_limits
from pom.result import NUMBERS, PomResult
from pom.status import PASSED, UNPROBED
from pom.tolerances.bands import RowRemark

KINDS = (
    "output",
    "input",
    "model",
    "program file",
    "statement",
    "tolerance",
    "verdict",
    "case file",
    "flight",
)

# The channel without samples is either missing or empty.  The archive does not show which.
_EMPTY = {"invalid", "not_tested"}


@dataclass(frozen=True)
class VerificationResult:
    """Result of one check.

    ``kind`` is one of `KINDS`.  ``state`` is ``same``, ``changed``, ``missing``, or ``unknown`` for
    the program of another version or of a manifest that does not state it.  ``detail``
    states what exactly changed.
    """

    kind: str
    name: str
    state: str
    detail: str = ""


def verify(folder: str | os.PathLike) -> list[VerificationResult]:
    """Check a report: its files, its statements, its tolerances and its verdicts.

    All outputs and inputs are hashed again, and the tolerance table and the files of the program
    are compared with those of this installation.  Every field of ``manifest.json`` and
    ``results.json`` is compared with ``results.nc``.  The criteria of every case are compared with
    the rows of the table of its standard and edition, except for bands of the case file.  All
    verdicts are judged again from ``results.nc``, and its cases are compared with their files.  Not
    covered: the author of the report (`pom.archive.report_signature`), whether traces, departures
    and probes are those of the inputs (`pom.archive.flown_again`), and the content of page and PDF,
    of which only the hashes are checked.

    Parameters
    ----------
    folder : path
        Folder with ``manifest.json``.

    Returns
    -------
    list of VerificationResult
        Results of all checks.  The report is valid if every state is ``same`` or ``unknown``.

    Raises
    ------
    FileNotFoundError, SchemaError
        The folder does not hold the manifest of a report, or the manifest lacks a part.
    """
    folder = Path(folder)
    statement = read_report_manifest(folder)
    try:
        return _check_statement(folder, statement)
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        problem = f"a part of the manifest is missing or of another kind ({error}); write it again"
        raise SchemaError(str(folder / "manifest.json"), [problem]) from error


def _check_statement(folder: Path, statement: Mapping[str, Any]) -> list[VerificationResult]:
    """Return the results of all checks of a report with this manifest."""
    checks = []
    for item in statement["subject"]:
        path = folder / item["name"]
        checks.append(_check_hash("output", item["name"], path, item["digest"]["sha256"]))
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        run = run_of(item)
        # a dependency with a run is the FMU of a model
        kind, name = "input", item["name"]
        if run:
            kind, name = "model", f"{run}: {item['name']}"
        path = dependency_path(item, folder)
        checks.append(_check_hash(kind, name, path, item["digest"]["sha256"]))
    for name, state, detail in compare_program(statement):
        checks.append(VerificationResult("program file", name, state, detail))
    for kind, name, detail in compare_statements(folder, statement):
        checks.append(_make_result(kind, name, detail))
    checks.extend(_check_case_files(folder, statement))
    checks.extend(_check_verdicts(folder))
    return checks


def _check_case_files(folder: Path, statement: Mapping[str, Any]) -> Iterator[VerificationResult]:
    try:
        archive = read_archive(folder)
    except (AeromatchError, OSError):
        return  # the second judgement of the verdicts reports these errors
    inputs = []
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        path = dependency_path(item, folder)
        if path is not None and not run_of(item):
            inputs.append(path)
    for name, state, detail in compare_case_files(archive, inputs):
        yield VerificationResult("case file", name, state, detail)


def _make_result(kind: str, name: str, detail: str) -> VerificationResult:
    return VerificationResult(kind, name, "changed" if detail else "same", detail)


def _check_hash(kind: str, name: str, path: Path | None, digest: str) -> VerificationResult:
    """Return the result of hashing a file again."""
    if path is None:
        detail = "the manifest does not state where it lies"
        return VerificationResult(kind, name, "missing", detail)
    if not path.is_file():
        return VerificationResult(kind, name, "missing", f"no file {path}")
    present = file_sha256(path)
    if present == digest:
        return VerificationResult(kind, name, "same")
    return VerificationResult(kind, name, "changed", f"SHA-256 was {digest}, is {present}")


def _check_verdicts(folder: Path) -> Iterator[VerificationResult]:
    """Yield one result per case and model, on its second judgement and on ``results.json``."""
    try:
        results = read_archive(folder).results
        pages = json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]
        printed, statuses = [], []
        for item in pages:
            printed.append({(row["run"], row["criterion"]): row for row in item["verdict"]})
            statuses.append(dict(item["status"]))
    except (AeromatchError, OSError, ValueError, KeyError, TypeError) as error:
        detail = f"the results cannot be read: {error}"
        yield VerificationResult("verdict", "all", "missing", detail)
        return
    # Results and pages are compared in pairs.
    if len(printed) != len(results):
        detail = f"results.json has {len(printed)} cases, results.nc has {len(results)}"
        yield VerificationResult("verdict", "all", "changed", detail)
        return
    for result, numbers, status in zip(results, printed, statuses, strict=True):
        contradictions = list(compare_signals(result))
        for run in result.runs:
            stored = {row["criterion"]: row for row in result.rows if row["run"] == run}
            differences = [
                *contradictions,
                *_judge_again(result, run, stored),
                *_find_missing_remarks(result, run),
                *_compare_printed(run, stored, numbers),
            ]
            if status.get(run) != result.status(run):
                differences.append(f"status {result.status(run)}, results.json {status.get(run)}")
            yield _make_result("verdict", f"{result.case.name}, {run}", "; ".join(differences))


def _judge_again(
    result: PomResult, run: str, stored: Mapping[str, Mapping[Hashable, Any]]
) -> Iterator[str]:
    """Yield the differences between the stored verdicts of a run and a second judgement."""
    time, refused = result.signals["time"].values, _is_refused(result, run)
    flight, model = traces_of(result.signals, "flight"), traces_of(result.signals, run)
    outcomes = judge_all(result.case, time, flight, model)
    # Groups with a criterion whose samples are NaN: their verdict may be another empty one.
    empty_groups = set()
    for row in stored.values():
        if any(remark.kind == "no_value" for remark in row["remarks"]):
            empty_groups.add(row["group"])

    for criterion in result.case.criteria:
        before = stored.get(criterion.name)
        if before is None:
            yield f"{criterion.name}: not in the table of verdicts"
        elif refused and criterion.applies:
            # a run without a verdict has no valid row
            if before["verdict"] != "invalid":
                yield (
                    f"{criterion.name}: verdict {before['verdict']}, but the model stopped or its "
                    "trim went beyond the limits of the case"
                )
        else:
            now = verdict_row(run, criterion, outcomes[criterion.name])
            unseen = before["verdict"] == "invalid" and criterion.group in empty_groups
            if not unseen and {before["verdict"], now["verdict"]} != _EMPTY:
                yield from compare_rows(criterion.name, "judged again", before, now)


def _is_refused(result: PomResult, run: str) -> bool:
    """Return whether a run has no verdict: it failed, or its trim is beyond a demanded limit."""
    return f"{run}: " in result.failure or bool(_trim_remarks(result, run, demanded=True))


def _find_missing_remarks(result: PomResult, run: str) -> Iterator[str]:
    """Yield the remarks on trim, watched channels and departures that no row of a run states."""
    if _is_refused(result, run):
        return
    stated: set[str] = set()
    own_tables = is_master = False
    for row in result.rows:
        if row["run"] == run:
            stated.update(remark.text for remark in row["remarks"])
            own_tables |= shows_own_tables(row["remarks"])
            is_master |= shows_master(row["remarks"])
    flight, model = traces_of(result.signals, "flight"), traces_of(result.signals, run)
    expected = (
        *case_departures(result.case),
        *_trim_remarks(result, run, demanded=False),
        *watch_channels(result.case, result.signals["time"].values, flight, model),
    )
    # the scatter of a master was judged in its own report
    is_judged = result.case.reference == "flight" and not is_master
    if result.status(run) in PASSED and is_judged:
        scatter = measure_scatter(result.signals, run)
        if own_tables:
            scatter = noise_of_inputs(scatter)
        # reports of earlier versions do not state the probes that were not made
        copied = [item for item in scatter if item.kind not in ("probe", UNPROBED)]
        expected = (*expected, *copied)
    for remark in expected:
        if remark.text not in stated:
            yield f"{remark.text}: not stated"


def _trim_remarks(result: PomResult, run: str, demanded: bool) -> tuple[RowRemark, ...]:
    """Return the remarks on quantities of the stored trim that are beyond their limits."""
    if run not in result.trim:
        return ()
    trim = {str(name): np.array([value]) for name, value in result.trim[run].dropna().items()}
    return beyond_limits(result_trim_limits(result), trim, demanded)


def _compare_printed(
    run: str, stored: Mapping[str, Mapping[Hashable, Any]], printed: Mapping[Any, Any]
) -> Iterator[str]:
    """Yield the differences between the stored rows of a run and those of ``results.json``."""
    for name, row in stored.items():
        printed_row = printed.get((run, name))
        if printed_row is None:
            yield f"{name}: not in results.json"
        else:
            yield from compare_rows(name, "results.json", row, printed_row)


def compare_rows(
    name: str, where: str, before: Mapping[Hashable, Any], now: Mapping[Any, Any]
) -> Iterator[str]:
    """Yield the differences of two rows of verdicts on one criterion, `now` found at `where`."""
    if before["verdict"] != now.get("verdict"):
        yield f"{name}: verdict {before['verdict']}, {where} {now.get('verdict')}"
    for column in NUMBERS:
        if column not in now or isinstance(now[column], str | list | dict):
            yield f"{name}: {column} {before[column]}, {where} no number"
            continue
        stored, present = _to_float(before[column]), _to_float(now[column])
        # Columns that a measure does not fill are NaN on both sides.
        is_same = math.isnan(stored) and math.isnan(present)
        if not is_same and not math.isclose(stored, present, rel_tol=CLOSE, abs_tol=1e-12):
            yield f"{name}: {column} {stored:.9g}, {where} {present:.9g}"


def _to_float(value: Any) -> float:
    """Return a stored number; NaN for None and infinity, which JSON does not hold."""
    if value is None or not math.isfinite(value):
        return math.nan
    return float(value)
