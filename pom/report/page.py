"""The HTML page of the report: one self-contained file that loads nothing from outside.

In a long report each case and chapter is packed into a file of its own next to the page, in a very
long one the list of the cases too: the page stays below 3 MB whatever their number.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from markupsafe import Markup

from pom.cases.case_file import signature_rows
from pom.report.case import page as case
from pom.report.case.page import PackedPage, run_line_classes
from pom.report.chapters import Chapters
from pom.report.models import database_comparison, identification
from pom.report.models import diagnosis as tuning
from pom.report.presentation.quantities import quantity_label
from pom.report.presentation.traces import pack_page, page_templates
from pom.report.presentation.verdict_text import Verdict, criterion_words, reason_text
from pom.report.submodels import sections as submodel_page
from pom.result import STATUSES, PomResult, results_name
from pom.tolerances.rows import tolerance_rows


def verdict_matrix(
    keys: Sequence[str], results: Sequence[PomResult], found: Sequence[Sequence[Mapping[str, Any]]]
) -> dict[str, Any]:
    """Return rows (case) by columns (model) with verdict and worst ratio, and the counts of every
    model.

    Parameters
    ----------
    found : sequence of sequence of mapping
        `case.outcome_rows` of every result.
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
                "chapter": chapter_of_test(result.case.id),
                "cells": [cells.get(run) for run in runs],
                "fail": bool(status & {"fail", "limits_exceeded", "record_error"}),
                "not_run": bool(result.failure) or bool(status & {"invalid", "not_tested"}),
            }
        )
    counts, shown = [], shown_statuses(results)
    for run in runs:
        count = Counter(
            cell["status"] for outcome in found for cell in outcome if cell["run"] == run
        )
        counts.append({"run": run, "counts": [count[word] for word in shown]})
    chapters = sorted({chapter_of_test(result.case.id) for result in results})
    order = [Verdict.of(word) for word in shown]
    return {
        "runs": runs,
        "styles": run_line_classes(runs),
        "rows": rows,
        "counts": counts,
        "order": order,
        "chapters": chapters,
    }


def shown_statuses(results: Sequence[PomResult]) -> list[str]:
    """Return the statuses that the counts of a report have a column for; ``record_error`` only
    where a case has it.
    """
    rare = any(result.status(run) == "record_error" for result in results for run in result.runs)
    return [word for word in STATUSES if rare or word != "record_error"]


def chapter_of_test(test: str) -> str:
    """Return the part of the table that a test belongs to.

    Examples
    --------
    >>> chapter("2.c.10"), chapter("2.c(10)")
    ('2.c', '2.c')
    """
    found = re.match(r"\d+\.[a-z]", test)
    return found.group() if found else test


def table_coverage(
    results: Sequence[PomResult], table: Sequence[Mapping[str, str]]
) -> list[dict[str, Any]]:
    """Return, per standard and edition that a case names, what of the table was run, and why the
    rest was not.

    Parameters
    ----------
    table : sequence of mapping
        Rows of the tolerance table with ``standard``, ``edition``, ``test_id`` and ``title``.

    Returns
    -------
    list of dict
        ``entries``: per entry of the table its cases, how many of its criteria were judged, and why
        the others were not.
    """
    found = []
    for standard, edition in dict.fromkeys((r.case.standard, r.case.edition) for r in results):
        mine = [r for r in results if (r.case.standard, r.case.edition) == (standard, edition)]
        titles = {
            row["test_id"]: row["title"]
            for row in table
            if (row["standard"], row["edition"]) == (standard, edition)
        }
        entries = [
            _entry(test, title, [r for r in mine if r.case.id == test])
            for test, title in titles.items()
        ]
        run = [entry for entry in entries if entry["cases"]]
        missing = [entry for entry in entries if not entry["cases"]]
        judged = sum(entry["judged"] > 0 for entry in run)
        found.append(
            {
                "standard": standard,
                "edition": edition,
                "total": len(entries),
                "run": run,
                "judged": judged,
                "missing": missing,
            }
        )
    return found


def _entry(test: str, title: str, results: Sequence[PomResult]) -> dict[str, Any]:
    judged: set[str] = set()
    why: dict[str, str] = {}
    for result in results:
        for row in result.rows:
            if row["verdict"] in ("not_tested", "invalid"):
                why.setdefault(row["criterion"], reason_text(row["remarks"]))
            else:
                judged.add(row["criterion"])
    left = [(criterion_words(name), note) for name, note in why.items() if name not in judged]
    return {
        "id": test,
        "title": title,
        "cases": len(results),
        "judged": len(judged),
        "criteria": len(judged | set(why)),
        "left": left,
    }


def provenance_page(
    provenance: Mapping[str, Any],
    results: Sequence[PomResult],
    databases: Mapping[str, xr.DataTree],
) -> dict[str, Any]:
    """Return everything the template ``provenance.html`` needs."""
    channels = {
        str(name) for r in results for data in (r.signals, r.inputs) for name in data.data_vars
    }
    return {
        "date": provenance.get("date", ""),
        "results": (name := results_name(results)),
        "command": provenance.get("command", ""),
        "versions": sorted(provenance.get("versions", {}).items()),
        "inputs": sorted(provenance.get("inputs", {}).items()),
        "models": list(provenance.get("models", {}).items()),
        "records": list(provenance.get("records", {}).items()),
        "record_errors": list(provenance.get("record_errors", {}).items()),
        "signatures": signature_rows(given, provenance.get("date", ""), name)
        if (given := provenance.get("signatures", {}))
        else [],
        "absent": [
            (name, str(db.attrs.get("absent", "")).split()) for name, db in databases.items()
        ],
        "notices": [
            (name, notice)
            for name, db in databases.items()
            for notice in str(db.attrs.get("notices", "")).splitlines()
        ],
        "glossary": sorted(
            (quantity_label(name) for name in channels), key=lambda x: x.name.lower()
        ),
    }


_HERE = Path(__file__).parent
_STATIC = {
    "uplot_css": "uplot/uPlot.min.css",
    "report_css": "report.css",
    "uplot_js": "uplot/uPlot.iife.min.js",
}
_SCRIPT = ("basics", "parcels", "scales", "marks", "plots", "fraction", "paper", "fits", "pages")
MOST_HELD = 2_500_000  # characters of packed pages and of lists that ``report.html`` holds itself
PAGE, PAGES = "report.html", "pages"
INDEX = f"{PAGES}/index.js"
# a script, for a page from disk may load nothing else; it runs before that of the page, which finds
# everything in its place
_INDEX = """document.querySelector("#matrix tbody").innerHTML = {rows};
document.querySelector("#inputs").innerHTML = {inputs};
document.querySelector("#overview").insertAdjacentHTML("afterend", {articles});
"""


def html_files(
    results: Sequence[PomResult],
    cases: Sequence[PackedPage],
    title: str,
    revision: str,
    provenance: Mapping[str, Any],
    chapters: Chapters,
    tunings: Sequence[Mapping[str, Any]] = (),
) -> dict[str, str]:
    """Return the texts of ``report.html`` and of the files that it loads, by name.

    The arguments are those of `pom.write_report`, `cases` the page of every result, `chapters` what
    it shows in addition, `tunings` those of `tuning.context`.
    """
    pages, databases = page_templates(), chapters.roots
    common = {
        "title": title,
        "revision": revision,
        "origin": provenance_page(provenance, results, databases),
        "count": len(results),
    }
    table = verdict_matrix([page.key for page in cases], results, [page.outcome for page in cases])
    common["models"] = (
        database_comparison.models_page(chapters.compared) if chapters.compared else None
    )
    more = {}
    if chapters.compared:
        more["models"] = pack_page({"page": pages.get_template("models.html").render(common)})
    if chapters.identification:
        context, head, body = identification.identification_page(chapters.identification)
        more["identification"] = pack_page(
            {
                **head,
                "page": pages.get_template("identification.html").render(
                    common, identification=context
                ),
            },
            body,
        )
    if chapters.submodels:
        chapter = {
            "submodels": submodel_page.submodels_context(chapters.submodels),
            "needed": chapters.needed,
        }
        more["submodels"] = pack_page(
            {"page": pages.get_template("submodels.html").render(common, **chapter)}
        )
    if tunings:
        found_styles = case.run_line_classes(
            list(dict.fromkeys(run for result in results for run in result.runs))
        )
        text = pages.get_template("tuning.html").render(
            common, tunings=tunings, note=tuning.NOTE, styles=found_styles
        )
        more["tuning"] = pack_page({"page": text})
    lists = {
        "rows": pages.get_template("matrix_rows.html").render(matrix=table),
        "inputs": pages.get_template("input_rows.html").render(common),
    }
    packed = {**{f"case-{page.key}": page.parcel for page in cases}, **more}

    def articles(files: Mapping[str, str]) -> str:
        held = {
            name: {"id": name, "file": files.get(name, ""), "parcel": text}
            for name, text in packed.items()
        }
        entries = [
            held[f"case-{page.key}"]
            | {"key": page.key, "fail": page.fail, "brief": Markup(page.brief)}
            for page in cases
        ]
        return pages.get_template("articles.html").render(
            cases=entries, more=[held[name] for name in more]
        )

    files = {}
    lists["articles"] = articles({})
    if apart := _long(lists):
        names = {name: f"{PAGES}/{name}.js" for name in packed}
        files = {
            file: f'(window.parcels ??= {{}})["{file}"] = "{packed[name]}";\n'
            for name, file in names.items()
        }
        lists["articles"] = articles(names)
    if listed := _long(lists):
        files[INDEX] = _INDEX.format(
            **{name: json.dumps(text, ensure_ascii=False) for name, text in lists.items()}
        )
        lists = dict.fromkeys(lists, "")
    text = pages.get_template("report.html").render(
        common,
        matrix=table,
        coverage=table_coverage(results, tolerance_rows()),
        more=[{"id": name} for name in more],
        apart=apart,
        index=INDEX if listed else "",
        report_js=Markup("\n".join(_static(f"script/{name}.js") for name in _SCRIPT)),
        **{name: Markup(item) for name, item in lists.items()},
        **{name: Markup(_static(file)) for name, file in _STATIC.items()},
    )
    return {PAGE: text, **files}


def _long(lists: Mapping[str, str]) -> bool:
    return sum(map(len, lists.values())) > MOST_HELD


def _static(name: str) -> str:
    return (_HERE / "static" / name).read_text(encoding="utf-8")
