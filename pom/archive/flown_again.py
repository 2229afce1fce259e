"""Comparison of a report with another one of the same cases, flown again by its reader.

Hashes and a second judgement do not show traces, departures and probes that were edited together
with all files of a report.  A second flight from the same inputs shows them.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from pom.archive.archive import read_archive
from pom.archive.origins import FILES
from pom.archive.verification import VerificationResult, compare_rows
from pom.result import PomResult

SAME_TRACE = 1e-4
"""Difference of two traces of one flight, over the largest value, that is rounding.  Our number."""
_PLACES = (*FILES, "models")
"""Parts of a case that differ between two computers."""
_MOST = 4  # differences that a detail lists
_NUMBER = re.compile(r"[-+\N{MINUS SIGN}]?\d[\d.]*(?:e[-+]?\d+)?")


def compare_flown_again(
    folder: str | os.PathLike, again: str | os.PathLike
) -> list[VerificationResult]:
    """Compare cases, traces, verdicts, status and remarks of a report with those of another one.

    Parameters
    ----------
    folder : path
        The report that is verified.
    again : path
        Report of the same command, flown again from inputs that the reader trusts.

    Returns
    -------
    list of VerificationResult
        Of kind ``flight``, for each case and model of either report.  A model or case of one
        report alone is ``missing``.  Remarks are compared without their numbers.

    Raises
    ------
    FileNotFoundError, SchemaError
        See `read_archive`.
    """
    stated = {result.case.name: result for result in read_archive(folder).results}
    flown = {result.case.name: result for result in read_archive(again).results}
    checks = []
    for name in dict.fromkeys([*stated, *flown]):
        if name not in stated or name not in flown:
            where = "the report" if name in flown else "the second flight"
            checks.append(VerificationResult("flight", name, "missing", f"not in {where}"))
            continue
        first, second = stated[name], flown[name]
        checks.append(_make_result(name, _compare_cases(first, second)))
        for run in dict.fromkeys([*first.runs, *second.runs]):
            label = f"{name}, {run}"
            if run not in first.runs or run not in second.runs:
                where = "the report" if run in second.runs else "the second flight"
                checks.append(VerificationResult("flight", label, "missing", f"not in {where}"))
                continue
            checks.append(_make_result(label, _compare_runs(first, second, run)))
    return checks


def _make_result(name: str, differences: Iterable[str]) -> VerificationResult:
    texts = list(differences)
    more = f"; {len(texts) - _MOST} more" if len(texts) > _MOST else ""
    state = "changed" if texts else "same"
    return VerificationResult("flight", name, state, "; ".join(texts[:_MOST]) + more)


def _compare_cases(first: PomResult, second: PomResult) -> Iterator[str]:
    """Yield the differences of case, conditions, drawn bands and failures."""
    cases = [result.case for result in (first, second)]
    for field in fields(cases[0]):
        if field.name not in _PLACES:
            a, b = (getattr(case, field.name) for case in cases)
            if a != b:
                yield f"{field.name} of the case is another one"
    for name in dict.fromkeys([*first.conditions, *second.conditions]):
        x, y = (item.conditions.get(name, np.nan) for item in (first, second))
        if not np.isclose(x, y, rtol=SAME_TRACE, atol=1e-6, equal_nan=True):
            yield f"condition {name} {x:.6g}, flown again {y:.6g} (SI)"
    if not first.tolerance.broadcast_equals(second.tolerance):
        for name in dict.fromkeys(map(str, [*first.tolerance, *second.tolerance])):
            a, b = (item.tolerance.get(name) for item in (first, second))
            if a is None or b is None:
                yield f"the drawn band of {name} is in one report alone"
            elif not np.allclose(a, b, rtol=SAME_TRACE, equal_nan=True):
                yield f"the drawn band of {name} is another one"
    if bool(first.failure) != bool(second.failure):
        yield f"failure {first.failure or 'none'!r}, flown again {second.failure or 'none'!r}"


def _compare_runs(first: PomResult, second: PomResult, run: str) -> Iterator[str]:
    """Yield the differences of one model, and of the flight that it is compared with."""
    if first.status(run) != second.status(run):
        yield f"status {first.status(run)}, flown again {second.status(run)}"
    rows = [_rows_of(result, run) for result in (first, second)]
    for name in dict.fromkeys([*rows[0], *rows[1]]):
        if name not in rows[0] or name not in rows[1]:
            yield f"{name}: a row of one report alone"
        else:
            yield from compare_rows(name, "flown again", rows[0][name], rows[1][name])
    remarks = [_remarks_of(items) for items in rows]
    for text in remarks[1] - remarks[0]:
        yield f"not stated: {text}"
    for text in remarks[0] - remarks[1]:
        yield f"not found again: {text}"
    yield from _compare_traces(first, second, "flight")
    yield from _compare_traces(first, second, run)
    yield from _compare_trims(first, second, run)


def _rows_of(result: PomResult, run: str) -> dict[str, Mapping[Hashable, Any]]:
    return {row["criterion"]: row for row in result.rows if row["run"] == run}


def _remarks_of(rows: Mapping[str, Mapping[Hashable, Any]]) -> Counter[str]:
    """Return the remarks of rows; numbers differ by rounding on another machine."""
    texts: Counter[str] = Counter()
    for row in rows.values():
        texts.update(f"{item.kind}: {_NUMBER.sub('#', item.text)}" for item in row["remarks"])
    return texts


def _compare_traces(first: PomResult, second: PomResult, run: str) -> Iterator[str]:
    """Yield the channels of a run that differ."""
    a, b = first.signals.sel(run=run), second.signals.sel(run=run)
    names = dict.fromkeys([*map(str, a.data_vars), *map(str, b.data_vars)])
    if a["time"].shape != b["time"].shape or not np.allclose(a["time"], b["time"]):
        yield f"the samples of {run} have other times"
        return
    for name in names:
        if name not in a or name not in b:
            yield f"{name} of {run} is in one report alone"
            continue
        x, y = a[name].values, b[name].values
        size = SAME_TRACE * float(np.nanmax(np.abs(y), initial=0.0)) + 1e-12
        if not np.allclose(x, y, rtol=0.0, atol=size, equal_nan=True):
            gap = float(np.nanmax(np.abs(x - y), initial=0.0))
            yield f"{name} of {run} differs by up to {gap:.3g} (SI)"


def _compare_trims(first: PomResult, second: PomResult, run: str) -> Iterator[str]:
    """Yield the quantities of the start and the trim that differ."""
    starts = [dict(result.trim[run].items()) for result in (first, second)]
    for name in dict.fromkeys([*starts[0], *starts[1]]):
        x, y = (start.get(name, np.nan) for start in starts)
        if not np.isclose(x, y, rtol=SAME_TRACE, atol=1e-6, equal_nan=True):
            yield f"start: {name} {x:.6g}, flown again {y:.6g} (SI)"
