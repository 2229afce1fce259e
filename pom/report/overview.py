"""Overview of a report: table of verdicts, coverage of the standards, origin of the numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from flightmech.support.console import count_text
from pom.cases.signatures import signature_rows
from pom.judging.conditions.condition_coverage import case_departs, cover_conditions
from pom.report.case.page import run_line_classes
from pom.report.presentation.quantities import quantity_label
from pom.report.presentation.unit_sets import units_in_text
from pom.report.presentation.verdict_text import Verdict, criterion_words, reason_text
from pom.result import PomResult, results_name
from pom.result_notices import NO_EVIDENCE, departure_remarks, is_additional, lacks_evidence
from pom.status import STATUSES

# Statuses by which the reader may filter the table of verdicts.
_FAILED = {"fail", "limits_exceeded", "record_error", "leak", "not_driven"}
_NOT_JUDGED = {"invalid", "not_tested"}


def verdict_matrix(
    keys: Sequence[str],
    results: Sequence[PomResult],
    outcomes: Sequence[Sequence[Mapping[str, Any]]],
) -> dict[str, Any]:
    """Return the table of verdicts, a row per case and a column per model, with the counts.

    Parameters
    ----------
    keys : sequence of str
        Keys of the cases.
    results : sequence of PomResult
    outcomes : sequence of sequence of mapping
        `pom.report.case.page.outcome_rows` of every result.
    """
    runs, rows = list_runs(results), []
    for key, result, outcome in zip(keys, results, outcomes, strict=True):
        cells, case_statuses = {}, set()
        for cell in outcome:
            cells[cell["run"]] = cell
            case_statuses.add(cell["status"])
        rows.append(
            {
                "key": key,
                "case": result.case,
                "chapter": chapter_of_test(result.case.id),
                # A model that a case does not have leaves its cell empty.
                "cells": [cells.get(run) for run in runs],
                "fail": bool(case_statuses & _FAILED),
                "not_run": bool(result.failure) or bool(case_statuses & _NOT_JUDGED),
            }
        )
    statuses = shown_statuses(results)
    # Number of cases by run and status.
    numbers: Counter[tuple[str, str]] = Counter()
    for outcome in outcomes:
        for cell in outcome:
            numbers[cell["run"], cell["status"]] += 1
    counts = []
    for run in runs:
        counts.append({"run": run, "counts": [numbers[run, status] for status in statuses]})
    return {
        "runs": runs,
        "styles": run_line_classes(runs),
        "rows": rows,
        "counts": counts,
        "order": [Verdict.of(status) for status in statuses],
        "chapters": sorted({chapter_of_test(result.case.id) for result in results}),
    }


def departure_table(keys: Sequence[str], results: Sequence[PomResult]) -> list[dict[str, Any]]:
    """Return the departures of a report, one entry per case that has any.

    Returns
    -------
    list of dict
        ``key``, ``id``, ``title`` and ``name`` of the case; ``rows``: models and text of each
        departure.  A departure of all models of the case has the text ``all models``.
    """
    table = []
    for key, result in zip(keys, results, strict=True):
        runs_by_text: dict[str, list[str]] = {}
        for run in result.runs:
            for text in map(units_in_text, departure_remarks(result, run)):
                runs_by_text.setdefault(text, []).append(run)
        rows = []
        for text, runs in runs_by_text.items():
            models = "all models" if runs == result.runs else ", ".join(runs)
            rows.append((models, text.removeprefix("departure: ")))
        if rows:
            case = result.case
            table.append(
                {"key": key, "id": case.id, "title": case.title, "name": case.name, "rows": rows}
            )
    return table


def list_runs(results: Sequence[PomResult]) -> list[str]:
    """Return the runs of all results, each once, in the order of their first result."""
    runs: dict[str, None] = {}
    for result in results:
        runs |= dict.fromkeys(result.runs)
    return list(runs)


def shown_statuses(results: Sequence[PomResult]) -> list[str]:
    """Return the statuses that have a column in the counts of a report.

    ``record_error``, ``leak``, ``not_driven``, ``demonstration`` and ``pass_with_departures`` have
    one only if a case has this status.
    """
    statuses: set[str] = set()
    for result in results:
        statuses.update(result.status(run) for run in result.runs)
    # A report without faulty records or departures does not need a column for them.
    rare = {"record_error", "pass_with_departures", "leak", "not_driven", "demonstration"}
    return [status for status in STATUSES if status not in rare or status in statuses]


def own_tables_text(results: Sequence[PomResult]) -> str:
    """Return the tolerance tables of the user in a report, with their hashes; empty without one."""
    tables: dict[str, None] = {}
    for result in results:
        own = result.case.table
        if own:
            tables[f"{own['file']} (sha256 {own['sha256'][:12]})"] = None
    return ", ".join(tables)


def chapter_of_test(test: str) -> str:
    """Return the part of the tolerance table that holds a test.

    Examples
    --------
    >>> chapter_of_test("2.c.10"), chapter_of_test("2.c(10)")
    ('2.c', '2.c')
    """
    match = re.match(r"\d+\.[a-z]", test)
    return match.group() if match else test


def table_coverage(
    results: Sequence[PomResult], table: Sequence[Mapping[str, str]]
) -> list[dict[str, Any]]:
    """Return the coverage of every standard and edition that a case names.

    Parameters
    ----------
    results : sequence of PomResult
    table : sequence of mapping
        Rows of the tolerance table with ``standard``, ``edition``, ``test_id`` and ``title``.

    Returns
    -------
    list of dict
        ``run`` and ``missing``: entries of the table with and without cases.  An entry has its
        number of cases, the number of criteria that were judged, the reasons for the others, and
        the flight conditions that its row wants and the cases show.
    """
    # Results by the standard and edition of their case, in the order of the first one.
    by_standard: dict[tuple[str, str], list[PomResult]] = {}
    for result in results:
        key = (result.case.standard, result.case.edition_words)
        by_standard.setdefault(key, []).append(result)
    coverage = []
    for (standard, edition), standard_results in by_standard.items():
        # a case of a table of the user keeps the titles of its tests
        titles = dict(standard_results[0].case.table.get("tests", {}))
        if not titles:
            for row in table:
                if (row["standard"], row["edition"]) == (standard, edition):
                    titles[row["test_id"]] = row["title"]
        entries = []
        for test, title in titles.items():
            # an additional case is not the test
            test_results = [
                result
                for result in standard_results
                if result.case.id == test and not is_additional(result)
            ]
            entries.append(_coverage_entry(test, title, test_results))
        run = [entry for entry in entries if entry["cases"]]
        coverage.append(
            {
                "standard": standard,
                "edition": edition,
                "total": len(entries),
                "run": run,
                "judged": sum(entry["judged"] > 0 for entry in run),
                "partly": sum("missing" in entry["conditions"] for entry in run),
                "missing": [entry for entry in entries if not entry["cases"]],
            }
        )
    return coverage


def _coverage_entry(test: str, title: str, results: Sequence[PomResult]) -> dict[str, Any]:
    """Return the coverage of one test by its results."""
    judged: set[str] = set()
    reasons: dict[str, str] = {}
    for result in results:
        for row in result.rows:
            if row["verdict"] in ("not_tested", "invalid", "demonstration"):
                reasons.setdefault(row["criterion"], reason_text(row["remarks"]))
            else:
                judged.add(row["criterion"])
    # A criterion that one case judges and another does not counts as judged.
    missing = []
    for name, reason in reasons.items():
        if name not in judged:
            missing.append((criterion_words(name), reason))
    return {
        "id": test,
        "title": title,
        "cases": len(results),
        "judged": len(judged),
        "criteria": len(judged | set(reasons)),
        "conditions": _conditions_text(results),
        "left": missing,
    }


def _conditions_text(results: Sequence[PomResult]) -> str:
    """Return the flight conditions that cases of one test show, and how many cases depart."""
    coverage = cover_conditions(results).text
    # A row that wants one condition has no count of conditions.
    departing = sum(map(case_departs, results))
    if coverage or not departing:
        return coverage
    return f"{departing} of {count_text(len(results), 'case')} with departures"


def absent_terms(databases: Mapping[str, xr.DataTree]) -> list[tuple[str, list[str]]]:
    """Return the terms that no source could give: those of all databases, then the further ones.

    The databases of a report lack mostly the same terms, so the common list stands once.

    Returns
    -------
    list of (str, list of str)
        Names of databases and terms.  A database without further terms has no entry.
    """
    lists = {name: str(db.attrs.get("absent", "")).split() for name, db in databases.items()}
    if len(lists) < 2:
        return list(lists.items())
    common = set.intersection(*map(set, lists.values()))
    first = next(iter(lists.values()))
    entries = [("all databases", [term for term in first if term in common])]
    for name, terms in lists.items():
        further = [term for term in terms if term not in common]
        if further:
            entries.append((f"{name}, further", further))
    return entries


def provenance_page(
    provenance: Mapping[str, Any],
    results: Sequence[PomResult],
    databases: Mapping[str, xr.DataTree],
) -> dict[str, Any]:
    """Return the data of the template ``provenance.html``.

    Parameters
    ----------
    provenance : mapping
        Provenance without paths.
    results : sequence of PomResult
    databases : mapping of str to DataTree
        Roots of the databases by name.
    """
    channels: set[str] = set()
    for result in results:
        channels.update(map(str, result.signals.data_vars))
        channels.update(map(str, result.inputs.data_vars))
    labels = [quantity_label(name) for name in channels]
    notices = []
    for database, db in databases.items():
        for notice in str(db.attrs.get("notices", "")).splitlines():
            notices.append((database, notice))
    name, date = results_name(results), provenance.get("date", "")
    signatures = provenance.get("signatures", {})
    return {
        "date": date,
        "results": name,
        "command": provenance.get("command", ""),
        "versions": sorted(provenance.get("versions", {}).items()),
        "inputs": sorted(provenance.get("inputs", {}).items()),
        "models": list(provenance.get("models", {}).items()),
        "records": list(provenance.get("records", {}).items()),
        "no_evidence": NO_EVIDENCE if any(map(lacks_evidence, results)) else "",
        "record_errors": list(provenance.get("record_errors", {}).items()),
        "signatures": signature_rows(signatures, date, name) if signatures else [],
        "absent": absent_terms(databases),
        "notices": notices,
        "glossary": sorted(labels, key=lambda label: label.name.lower()),
    }
