"""HTML page of the report: one self-contained file that loads nothing from other sites.

In a long report, each case and chapter is packed into a separate file next to the page.  In a very
long report, the list of the cases is a separate file too.  The page stays below 3 MB for any number
of cases.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from pom.report.case.page import PackedPage, run_line_classes
from pom.report.chapters import Chapters
from pom.report.guide_texts import missing_texts
from pom.report.models.database_comparison import models_page
from pom.report.models.identification import identification_page
from pom.report.models.tuning import NOTE
from pom.report.overview import (
    departure_table,
    list_runs,
    own_tables_text,
    provenance_page,
    table_coverage,
    verdict_matrix,
)
from pom.report.presentation.page_templates import page_templates
from pom.report.presentation.traces import pack_page
from pom.report.submodels.sections import chapter_title, identified_names, submodels_context
from pom.result import PomResult
from pom.tolerances.rows import tolerance_rows

_HERE = Path(__file__).parent
_STATIC = {
    "uplot_css": "uplot/uPlot.min.css",
    "report_css": "report.css",
    "uplot_js": "uplot/uPlot.iife.min.js",
}
_SCRIPT = ("basics", "parcels", "scales", "marks", "plots", "fraction", "paper", "fits", "pages")
# Characters of packed pages and of lists that ``report.html`` holds itself.
MOST_HELD = 2_500_000
PAGE, PAGES = "report.html", "pages"
INDEX = f"{PAGES}/index.js"
# A page from a disk may load scripts only, so the lists are a script.  It runs before that of the
# page, which finds all elements in their place.
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

    Parameters
    ----------
    results : sequence of PomResult
    cases : sequence of PackedPage
        Page of every result.
    title, revision : str
        As in `pom.write_report`.
    provenance : mapping
        Provenance without paths.
    chapters : Chapters
        Chapters in addition to the cases.
    tunings : sequence of mapping
        Result of `pom.report.models.tuning.tuning_context`.
    """
    templates = page_templates()
    common: dict[str, Any] = {
        "title": title,
        "revision": revision,
        "tables": own_tables_text(results),
        "missing_texts": missing_texts(results),
        "origin": provenance_page(provenance, results, chapters.roots),
        "count": len(results),
        "models": models_page(chapters.compared) if chapters.compared else None,
    }
    packed_chapters = _pack_chapters(templates, common, chapters)
    if tunings:
        packed_chapters["tuning"] = _pack_tunings(templates, common, tunings, results)
    matrix = verdict_matrix([page.key for page in cases], results, [page.outcome for page in cases])
    packed = {f"case-{page.key}": page.parcel for page in cases} | packed_chapters
    terms = _terms_of_pages(common["models"])
    lists = {
        "rows": templates.get_template("matrix_rows.html").render(matrix=matrix),
        "inputs": templates.get_template("input_rows.html").render(common),
        "articles": _render_articles(templates, cases, packed=packed, names={}, terms=terms),
    }

    # If the page is too long, the parcels become files.  If the lists alone are too long, they
    # become a file too.
    files: dict[str, str] = {}
    is_apart = _is_too_long(lists)
    if is_apart:
        names = {name: f"{PAGES}/{name}.js" for name in packed}
        files = _parcel_files(packed, names)
        lists["articles"] = _render_articles(
            templates, cases, packed=packed, names=names, terms=terms
        )
    has_index = _is_too_long(lists)
    if has_index:
        strings = {name: json.dumps(text, ensure_ascii=False) for name, text in lists.items()}
        files[INDEX] = _INDEX.format(**strings)
        lists = dict.fromkeys(lists, "")
    text = templates.get_template("report.html").render(
        common,
        matrix=matrix,
        departures=departure_table([page.key for page in cases], results),
        coverage=table_coverage(results, tolerance_rows()),
        more=[{"id": name} for name in packed_chapters if not name.startswith("models-")],
        apart=is_apart,
        index=INDEX if has_index else "",
        **{name: Markup(item) for name, item in lists.items()},
        **_static_texts(),
    )
    return {PAGE: text, **files}


def _terms_of_pages(models: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the terms of every page of models as in addresses, separated by blanks."""
    if models is None:
        return {}
    terms = {}
    for part in models["parts"]:
        terms[part["id"]] = " ".join([item["term"].replace("/", "-") for item in part["terms"]])
    return terms


def _parcel_files(packed: Mapping[str, str], names: Mapping[str, str]) -> dict[str, str]:
    """Return the scripts that hand parcels over to the page, by the name of the file."""
    files = {}
    for name, file in names.items():
        files[file] = f'(window.parcels ??= {{}})["{file}"] = "{packed[name]}";\n'
    return files


def _static_texts() -> dict[str, Markup]:
    """Return styles and scripts of the page, by their names in the template."""
    texts = {name: Markup(_static(file)) for name, file in _STATIC.items()}
    scripts = [_static(f"script/{name}.js") for name in _SCRIPT]
    return {**texts, "report_js": Markup("\n".join(scripts))}


def _pack_tunings(
    templates: Environment,
    common: Mapping[str, Any],
    tunings: Sequence[Mapping[str, Any]],
    results: Sequence[PomResult],
) -> str:
    """Return the packed page of the chapter on tuning."""
    text = templates.get_template("tuning.html").render(
        common, tunings=tunings, note=NOTE, styles=run_line_classes(list_runs(results))
    )
    return pack_page({"page": text})


def _pack_chapters(
    templates: Environment, common: Mapping[str, Any], chapters: Chapters
) -> dict[str, str]:
    """Return the packed pages of the chapters by name."""
    packed = {}
    if chapters.compared:
        text = templates.get_template("models.html").render(
            common, ranking=chapters.ranking, ranking_text=chapters.ranking_text
        )
        packed["models"] = pack_page({"page": text})
        # All terms on one page are 35 000 px high, so they have pages of their own.
        template = templates.get_template("model_terms.html")
        for part in common["models"]["parts"]:
            packed[part["id"]] = pack_page({"page": template.render(common, part=part)})
    if chapters.identification:
        context, head, body = identification_page(chapters.identification)
        text = templates.get_template("identification.html").render(common, identification=context)
        packed["identification"] = pack_page({**head, "page": text}, body)
    if chapters.submodels:
        text = templates.get_template("submodels.html").render(
            common,
            heading=chapter_title(chapters.submodels),
            identified=identified_names(chapters.submodels),
            submodels=submodels_context(chapters.submodels),
            needed=chapters.needed,
        )
        packed["submodels"] = pack_page({"page": text})
    return packed


def _render_articles(
    templates: Environment,
    cases: Sequence[PackedPage],
    packed: Mapping[str, str],
    names: Mapping[str, str],
    terms: Mapping[str, str],
) -> str:
    """Return the articles of all cases and chapters.

    `names` holds the files of parcels that are apart.  The articles hold all other parcels.
    `terms` holds the terms of the pages of models, so that a link to a term opens its page.
    """
    articles: dict[str, dict[str, Any]] = {}
    for name, parcel in packed.items():
        articles[name] = {
            "id": name,
            "file": names.get(name, ""),
            "parcel": parcel,
            "terms": terms.get(name, ""),
        }
    entries = []
    for page in cases:
        article = articles.pop(f"case-{page.key}")
        entries.append(article | {"key": page.key, "fail": page.fail, "brief": Markup(page.brief)})
    # The remaining articles are those of the chapters.
    return templates.get_template("articles.html").render(
        cases=entries, more=list(articles.values())
    )


def _is_too_long(lists: Mapping[str, str]) -> bool:
    return sum(map(len, lists.values())) > MOST_HELD


def _static(name: str) -> str:
    return (_HERE / "static" / name).read_text(encoding="utf-8")
