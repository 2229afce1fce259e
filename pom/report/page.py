"""The HTML page of the report: one self-contained file that loads nothing from outside.

In a long report each case and chapter is packed into a file of its own next to the page, in a very long one the list of the cases
too: the page stays below 3 MB whatever their number.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ..result import PomResult
from ..tolerances.rows import rows as tolerance_rows
from . import overview
from . import provenance as origin
from .case import case
from .case.packed_page import PackedPage
from .chapters import Chapters
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
MOST_HELD = 2_500_000  # characters of packed pages and of lists that ``report.html`` holds itself
PAGE, PAGES = "report.html", "pages"
INDEX = f"{PAGES}/index.js"
# a script, for a page from disk may load nothing else; it runs before that of the page, which finds everything in its place
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

    The arguments are those of `pom.write_report`, `cases` the page of every result, `chapters` what it shows in addition, `tunings` those
    of `tuning.context`.
    """
    pages, databases = page_templates(), chapters.roots
    common = {"title": title, "revision": revision, "origin": origin.page(provenance, results, databases), "count": len(results)}
    table = overview.matrix([page.key for page in cases], results, [page.outcome for page in cases])
    common["models"] = database_comparison.page(chapters.compared) if chapters.compared else None
    more = {}
    if chapters.compared:
        more["models"] = parcel({"page": pages.get_template("models.html").render(common)})
    if chapters.identification:
        context, head, body = identification.page(chapters.identification)
        more["identification"] = parcel(
            {**head, "page": pages.get_template("identification.html").render(common, identification=context)}, body
        )
    if chapters.submodels:
        chapter = {"submodels": submodel_page.context(chapters.submodels), "needed": chapters.needed}
        more["submodels"] = parcel({"page": pages.get_template("submodels.html").render(common, **chapter)})
    if tunings:
        found_styles = case.line_styles(list(dict.fromkeys(run for result in results for run in result.runs)))
        text = pages.get_template("tuning.html").render(common, tunings=tunings, note=tuning.NOTE, styles=found_styles)
        more["tuning"] = parcel({"page": text})
    lists = {
        "rows": pages.get_template("matrix_rows.html").render(matrix=table),
        "inputs": pages.get_template("input_rows.html").render(common),
    }
    packed = {**{f"case-{page.key}": page.parcel for page in cases}, **more}

    def articles(files: Mapping[str, str]) -> str:
        held = {name: {"id": name, "file": files.get(name, ""), "parcel": text} for name, text in packed.items()}
        entries = [held[f"case-{page.key}"] | {"key": page.key, "fail": page.fail, "brief": Markup(page.brief)} for page in cases]
        return pages.get_template("articles.html").render(cases=entries, more=[held[name] for name in more])

    files = {}
    lists["articles"] = articles({})
    if apart := _long(lists):
        names = {name: f"{PAGES}/{name}.js" for name in packed}
        files = {file: f'(window.parcels ??= {{}})["{file}"] = "{packed[name]}";\n' for name, file in names.items()}
        lists["articles"] = articles(names)
    if listed := _long(lists):
        files[INDEX] = _INDEX.format(**{name: json.dumps(text, ensure_ascii=False) for name, text in lists.items()})
        lists = dict.fromkeys(lists, "")
    text = pages.get_template("report.html").render(
        common,
        matrix=table,
        coverage=overview.coverage(results, tolerance_rows()),
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
