"""The HTML page of the report: one self-contained file that loads nothing from outside.

In a long report each case is packed into a file of its own next to the page, which then stays small whatever their number.
"""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from ..tolerances.rows import rows as tolerance_rows
from . import overview
from . import provenance as origin
from .case import case
from .models import database_comparison, identification, tuning
from .page_templates import page_templates
from .presentation.traces import parcel
from .submodels import page as submodel_page

_HERE = Path(__file__).parent
_STATIC = {
    "uplot_css": "uplot/uPlot.min.css",
    "report_css": "report.css",
    "uplot_js": "uplot/uPlot.iife.min.js",
}
_SCRIPT = ("basics", "parcels", "scales", "marks", "plots", "fraction", "paper", "fits", "pages")
MOST_PACKED = 2_500_000  # characters of packed pages that ``report.html`` holds itself
PAGE, PAGES = "report.html", "pages"


def html_files(
    results, cases, title, revision, provenance, databases, diagnoses, support, fits=(), submodels=(), tunings=()
) -> dict[str, str]:
    """Return the texts of ``report.html`` and of the files that it loads, by name.

    The arguments are those of `pom.write_report`, `cases` the `PackedPage` of every result.
    """
    pages = page_templates()
    common = {"title": title, "revision": revision, "origin": origin.page(provenance, results, databases), "count": len(results)}
    common["models"] = database_comparison.page(databases, support, case.line_styles(databases)) if databases else None
    more, files = {}, {}
    entries = [{"key": page.key, "fail": page.fail, "brief": Markup(page.brief), "parcel": page.parcel, "file": ""} for page in cases]
    if sum(len(page.parcel) for page in cases) > MOST_PACKED:
        for entry in entries:
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
        matrix=overview.matrix([page.key for page in cases], results, [page.outcome for page in cases]),
        coverage=overview.coverage(results, tolerance_rows()),
        cases=entries,
        more=more.items(),
        apart=bool(files),
        report_js=Markup("\n".join(_static(f"script/{name}.js") for name in _SCRIPT)),
        **{name: Markup(_static(file)) for name, file in _STATIC.items()},
    )
    return {PAGE: text, **files}


def _static(name: str) -> str:
    return (_HERE / "static" / name).read_text(encoding="utf-8")
