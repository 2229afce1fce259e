"""The HTML page of the report: one self-contained file that loads nothing from outside.

In a long report each case is packed into a file of its own next to the page, which then stays small whatever their number.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import FunctionLoader
from markupsafe import Markup

from flightmech.support.templates import environment

from ..tolerances.rows import rows as tolerance_rows
from . import overview
from . import provenance as origin
from .case import case
from .models import database_comparison, identification, tuning
from .presentation.traces import parcel
from .submodels import page as submodel_page

_HERE = Path(__file__).parent
_STATIC = {
    "uplot_css": "uplot/uPlot.min.css",
    "report_css": "report.css",
    "uplot_js": "uplot/uPlot.iife.min.js",
}
_SCRIPT = ("basics", "parcels", "scales", "marks", "plots", "fraction", "paper", "fits", "pages")
# figures for readers without a script take 10 kB a case: only a report that is short enough to be read that way has them
MOST_WITH_FIGURES = 30
MOST_PACKED = 2_500_000  # characters of packed pages that ``report.html`` holds itself
PAGE, PAGES = "report.html", "pages"


def html_files(
    results, title, revision, provenance, databases, diagnoses, support, modes, fits=(), submodels=(), tunings=()
) -> dict[str, str]:
    """Return the texts of ``report.html`` and of the files that it loads, by name.

    The arguments are those of `pom.write_report`, `modes` a table for every result.
    """
    pages = environment(FunctionLoader(_template))
    pages.globals["parts"] = pages.get_template("parts.html").module
    keys = case.keys(results)
    found = [case.outcomes(result, case.line_styles(result.runs)) for result in results]
    common = {"title": title, "revision": revision, "origin": origin.page(provenance, results, databases), "count": len(results)}
    common["models"] = database_comparison.page(databases, support, case.line_styles(databases)) if databases else None
    inner, brief = pages.get_template("case.html"), pages.get_template("brief.html")
    cases: list[dict[str, Any]] = []
    for i, (key, result, outcome, table) in enumerate(zip(keys, results, found, modes, strict=True), 1):
        diagnosis = diagnoses.get(result.case.name)
        page = case.page(key, result, outcome, provenance, diagnosis, table, with_figures=len(results) <= MOST_WITH_FIGURES)
        texts = {name: template.render(common, page={**page, "position": i}) for name, template in (("page", inner), ("brief", brief))}
        packed = parcel({**page["head"], "page": texts["page"]}, page["body"])
        fail = any(cell["status"] in ("fail", "limits_exceeded") for cell in outcome)
        cases.append({"key": key, "fail": fail, "brief": Markup(texts["brief"]), "parcel": packed, "file": ""})
    more, files = {}, {}
    if sum(len(entry["parcel"]) for entry in cases) > MOST_PACKED:
        for entry in cases:
            name = entry["file"] = f"{PAGES}/{entry['key']}.js"
            files[name] = f'(window.parcels ??= {{}})["{name}"] = "{entry["parcel"]}";\n'
    if databases:
        more["models"] = parcel({"page": pages.get_template("models.html").render(common)})
    if fits:
        context, head, body = identification.page(fits)
        more["identification"] = parcel(
            {**head, "page": pages.get_template("identification.html").render(common, identification=context)}, body
        )
    if submodels:
        chapter = {"submodels": submodel_page.context(submodels), "needed": submodel_page.needed(diagnoses, databases)}
        more["submodels"] = parcel({"page": pages.get_template("submodels.html").render(common, **chapter)})
    if tunings:
        found_styles = case.line_styles(list(dict.fromkeys(run for result in results for run in result.runs)))
        text = pages.get_template("tuning.html").render(common, tunings=tunings, note=tuning.NOTE, styles=found_styles)
        more["tuning"] = parcel({"page": text})
    text = pages.get_template("report.html").render(
        common,
        matrix=overview.matrix(keys, results, found),
        coverage=overview.coverage(results, tolerance_rows()),
        cases=cases,
        more=more.items(),
        apart=bool(files),
        report_js=Markup("\n".join(_static(f"script/{name}.js") for name in _SCRIPT)),
        **{name: Markup(_static(file)) for name, file in _STATIC.items()},
    )
    return {PAGE: text, **files}


def _static(name: str) -> str:
    return (_HERE / "static" / name).read_text(encoding="utf-8")


def _template(name: str) -> str:
    """Return a template without its indentation, which would be a tenth of the page."""
    lines = (_HERE / "templates" / name).read_text(encoding="utf-8").splitlines()
    return "".join(f"{line.lstrip()}\n" for line in lines)
