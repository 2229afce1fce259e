"""Whether a report is still what it was: files by their hashes, verdicts by judging the stored samples again."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError

from ..judging.signals import traces_of
from ..judging.verdict import judge_all, row
from ..judging.watch import watch
from ..replaying.trim_state import beyond_limits, limits_of
from ..result import NUMBERS, PomResult
from ..tolerances.remarks import RowRemark
from .archive import read_archive
from .manifest import place, read_manifest
from .origins import sha256
from .stated import CLOSE, run_of, stated

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
    """Check a report: hash all outputs and inputs again, judge all verdicts again from ``results.nc``, compare what the files state.

    Statements: every field of ``manifest.json`` and of ``results.json`` against ``results.nc``.  Tolerances: the criteria of every case
    against the rows of the table of its standard and edition, bands of the case file apart.  Not covered: who wrote the report, and page
    and PDF but for their hashes.

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
    statement = read_manifest(folder)
    found = [_hashed("output", item["name"], folder / item["name"], item["digest"]["sha256"]) for item in statement["subject"]]
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        run = run_of(item)
        name = f"{run}: {item['name']}" if run else item["name"]
        found.append(_hashed("model" if run else "input", name, place(item, folder), item["digest"]["sha256"]))
    return [
        *found,
        *(VerificationResult(kind, name, "changed" if detail else "same", detail) for kind, name, detail in stated(folder, statement)),
        *_verdicts(folder),
    ]


def _hashed(kind: str, name: str, path: Path | None, wanted: str) -> VerificationResult:
    if path is None:
        return VerificationResult(kind, name, "missing", "the manifest does not state where it lies")
    if not path.is_file():
        return VerificationResult(kind, name, "missing", f"no file {path}")
    have = sha256(path)
    return (
        VerificationResult(kind, name, "same")
        if have == wanted
        else VerificationResult(kind, name, "changed", f"SHA-256 was {wanted}, is {have}")
    )


def _verdicts(folder: Path) -> Iterator[VerificationResult]:
    """Yield one result per case and model that states what is judged differently now, or printed differently in ``results.json``."""
    try:
        results = read_archive(folder).results
        pages = _json(folder)
        printed = [{(r["run"], r["criterion"]): r for r in item["verdict"]} for item in pages]
        statuses = [dict(item["status"]) for item in pages]
    except (AeromatchError, OSError, ValueError, KeyError, TypeError) as error:
        yield VerificationResult("verdict", "all", "missing", f"the results cannot be read: {error}")
        return
    if len(printed) != len(results):
        yield VerificationResult("verdict", "all", "changed", f"results.json has {len(printed)} cases, results.nc has {len(results)}")
        return
    for result, numbers, status in zip(results, printed, statuses, strict=True):
        for run in result.runs:
            stored = {row["criterion"]: row for row in result.rows if row["run"] == run}
            words = [*_judged_again(result, run, stored), *_not_stated(result, run), *_differences("results.json", run, stored, numbers)]
            if status.get(run) != result.status(run):
                words.append(f"status {result.status(run)}, results.json {status.get(run)}")
            yield VerificationResult("verdict", f"{result.case.name}, {run}", "changed" if words else "same", "; ".join(words))


def _json(folder: Path) -> list[dict[str, Any]]:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]


def _judged_again(result: PomResult, run: str, stored: Mapping[str, Mapping[Hashable, Any]]) -> Iterator[str]:
    time, refused = result.signals["time"].values, _refused(result, run)
    outcomes = judge_all(result.case, time, traces_of(result.signals, "flight"), traces_of(result.signals, run))
    empty = {row["group"] for row in stored.values() if any(remark.kind == "no_value" for remark in row["remarks"])}
    for criterion in result.case.criteria:
        before = stored.get(criterion.name)
        if before is None:
            yield f"{criterion.name}: not in the table of verdicts"
        elif refused and criterion.applies:
            if before["verdict"] != "invalid":
                yield f"{criterion.name}: verdict {before['verdict']}, but the model stopped or its trim went beyond the limits of the case"
        else:
            now = row(run, criterion, outcomes[criterion.name])
            unseen = before["verdict"] == "invalid" and criterion.group in empty
            if not unseen and {before["verdict"], now["verdict"]} != _EMPTY:
                yield from _difference(criterion.name, "judged again", before, now)


_EMPTY = {"invalid", "not_tested"}  # a channel without any sample is missing or empty: the archive does not show which


def _refused(result: PomResult, run: str) -> bool:
    """Whether a run carries no judgement at all."""
    return f"{run}: " in result.failure or bool(_beyond(result, run, demanded=True))


def _not_stated(result: PomResult, run: str) -> Iterator[str]:
    """Yield the remarks on the trim and on watched channels that the samples call for and no row states."""
    if _refused(result, run):
        return
    stated = {remark.text for row in result.rows if row["run"] == run for remark in row["remarks"]}
    flight, model = traces_of(result.signals, "flight"), traces_of(result.signals, run)
    due = (*_beyond(result, run, demanded=False), *watch(result.case, result.signals["time"].values, flight, model))
    yield from (f"{remark.text}: not stated" for remark in due if remark.text not in stated)


def _beyond(result: PomResult, run: str, demanded: bool) -> tuple[RowRemark, ...]:
    """Return what the trim of a model, by its table, has beyond its limits."""
    if run not in result.trim:
        return ()
    found = {str(name): np.array([value]) for name, value in result.trim[run].dropna().items()}
    return beyond_limits(limits_of(result), found, demanded)


def _differences(where: str, run: str, stored: Mapping[str, Mapping[Hashable, Any]], others: Mapping[Any, Any]) -> Iterator[str]:
    for name, before in stored.items():
        other = others.get((run, name))
        if other is None:
            yield f"{name}: not in {where}"
        else:
            yield from _difference(name, where, before, other)


def _difference(name: str, where: str, before: Mapping[Hashable, Any], now: Mapping[Any, Any]) -> Iterator[str]:
    if before["verdict"] != now["verdict"]:
        yield f"{name}: verdict {before['verdict']}, {where} {now['verdict']}"
    for column in NUMBERS:
        one, other = _number(before[column]), _number(now[column])
        if math.isfinite(one) and not math.isclose(one, other, rel_tol=CLOSE, abs_tol=1e-12):
            yield f"{name}: {column} {one:.9g}, {where} {other:.9g}"


def _number(value: Any) -> float:
    """Return a stored number; JSON holds neither NaN nor infinity."""
    return float(value) if value is not None and math.isfinite(value) else math.nan
