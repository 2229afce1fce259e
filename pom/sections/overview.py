"""The overview: every case against every model, and which entries of the tolerance table the cases cover."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pom.result import PomResult

from .case import line_styles, outcomes
from .verdicts import Verdict

_ORDER = ("pass", "fail", "invalid", "not_tested")


def matrix(keys: Sequence[str], results: Sequence[PomResult]) -> dict[str, Any]:
    """Return rows (case) by columns (model) with verdict and worst ratio, and the counts of every model."""
    runs = list(dict.fromkeys(run for result in results for run in result.runs))
    styles = line_styles(runs)
    rows = []
    for key, result in zip(keys, results, strict=True):
        cells = {cell["run"]: cell for cell in outcomes(result, styles)}
        status = {cell["status"] for cell in cells.values()}
        ratios = [cell["ratio"] for cell in cells.values() if cell["ratio"] == cell["ratio"]]
        rows.append(
            {
                "key": key,
                "case": result.case,
                "cells": [cells.get(run) for run in runs],
                "fail": "fail" in status,
                "not_run": bool(result.failure) or bool(status & {"invalid", "not_tested"}),
                "worst": max(ratios, default=-1.0),
            }
        )
    counts = [{"run": run, "counts": _counts([result.status(run) for result in results if run in result.runs])} for run in runs]
    return {"runs": runs, "styles": styles, "rows": rows, "counts": counts, "order": [Verdict.of(word) for word in _ORDER]}


def _counts(status: Sequence[str]) -> list[int]:
    count = Counter(status)
    return [count[word] for word in _ORDER]


def coverage(results: Sequence[PomResult], table: Sequence[Mapping[str, str]]) -> list[dict[str, Any]]:
    """Return, per standard and edition that a case names, which entries of the table have a case and which have none.

    Parameters
    ----------
    table : sequence of mapping
        Rows of the tolerance table with ``standard``, ``edition``, ``test_id`` and ``title``.
    """
    found = []
    for standard, edition in dict.fromkeys((r.case.standard, r.case.edition) for r in results):
        titles = {row["test_id"]: row["title"] for row in table if (row["standard"], row["edition"]) == (standard, edition)}
        ids = dict.fromkeys(r.case.id for r in results if (r.case.standard, r.case.edition) == (standard, edition))
        found.append(
            {
                "standard": standard,
                "edition": edition,
                "total": len(titles),
                "run": [(i, titles[i]) for i in ids if i in titles],
                "missing": [(i, title) for i, title in titles.items() if i not in ids],
            }
        )
    return found
