"""The overview: every case against every model, and which entries of the tolerance table the cases cover."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pom.result import STATUSES, PomResult

from .case.case import line_styles
from .presentation.verdict_text import Verdict, reason, words


def matrix(keys: Sequence[str], results: Sequence[PomResult], found: Sequence[Sequence[Mapping[str, Any]]]) -> dict[str, Any]:
    """Return rows (case) by columns (model) with verdict and worst ratio, and the counts of every model.

    Parameters
    ----------
    found : sequence of sequence of mapping
        `case.outcomes` of every result.
    """
    runs = list(dict.fromkeys(run for result in results for run in result.runs))
    rows = []
    for key, result, outcome in zip(keys, results, found, strict=True):
        cells = {cell["run"]: cell for cell in outcome}
        status = {cell["status"] for cell in outcome}
        rows.append(
            {
                "key": key,
                "case": result.case,
                "chapter": chapter(result.case.id),
                "cells": [cells.get(run) for run in runs],
                "fail": bool(status & {"fail", "limits_exceeded", "record_error"}),
                "not_run": bool(result.failure) or bool(status & {"invalid", "not_tested"}),
            }
        )
    counts, shown = [], shown_statuses(results)
    for run in runs:
        count = Counter(cell["status"] for outcome in found for cell in outcome if cell["run"] == run)
        counts.append({"run": run, "counts": [count[word] for word in shown]})
    chapters = sorted({chapter(result.case.id) for result in results})
    order = [Verdict.of(word) for word in shown]
    return {"runs": runs, "styles": line_styles(runs), "rows": rows, "counts": counts, "order": order, "chapters": chapters}


def shown_statuses(results: Sequence[PomResult]) -> list[str]:
    """Return the statuses that the counts of a report have a column for; ``record_error`` only where a case has it."""
    rare = any(result.status(run) == "record_error" for result in results for run in result.runs)
    return [word for word in STATUSES if rare or word != "record_error"]


def chapter(test: str) -> str:
    """Return the part of the table that a test belongs to.

    Examples
    --------
    >>> chapter("2.c.10"), chapter("2.c(10)")
    ('2.c', '2.c')
    """
    found = re.match(r"\d+\.[a-z]", test)
    return found.group() if found else test


def coverage(results: Sequence[PomResult], table: Sequence[Mapping[str, str]]) -> list[dict[str, Any]]:
    """Return, per standard and edition that a case names, what of the table was run, and why the rest was not.

    Parameters
    ----------
    table : sequence of mapping
        Rows of the tolerance table with ``standard``, ``edition``, ``test_id`` and ``title``.

    Returns
    -------
    list of dict
        ``entries``: per entry of the table its cases, how many of its criteria were judged, and why the others were not.
    """
    found = []
    for standard, edition in dict.fromkeys((r.case.standard, r.case.edition) for r in results):
        mine = [r for r in results if (r.case.standard, r.case.edition) == (standard, edition)]
        titles = {row["test_id"]: row["title"] for row in table if (row["standard"], row["edition"]) == (standard, edition)}
        entries = [_entry(test, title, [r for r in mine if r.case.id == test]) for test, title in titles.items()]
        run = [entry for entry in entries if entry["cases"]]
        missing = [entry for entry in entries if not entry["cases"]]
        judged = sum(entry["judged"] > 0 for entry in run)
        found.append({"standard": standard, "edition": edition, "total": len(entries), "run": run, "judged": judged, "missing": missing})
    return found


def _entry(test: str, title: str, results: Sequence[PomResult]) -> dict[str, Any]:
    judged: set[str] = set()
    why: dict[str, str] = {}
    for result in results:
        for row in result.rows:
            if row["verdict"] in ("not_tested", "invalid"):
                why.setdefault(row["criterion"], reason(row["remarks"]))
            else:
                judged.add(row["criterion"])
    left = [(words(name), note) for name, note in why.items() if name not in judged]
    return {"id": test, "title": title, "cases": len(results), "judged": len(judged), "criteria": len(judged | set(why)), "left": left}
