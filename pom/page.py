"""The HTML page of the report: one self-contained file that asks for nothing outside itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from flightmech.console import plain

from .sections import case, models, overview, verdicts
from .sections import provenance as origin
from .table import rows as tolerance_rows

_HERE = Path(__file__).parent
_STATIC = {
    "uplot_css": "uplot/uPlot.min.css",
    "report_css": "report.css",
    "uplot_js": "uplot/uPlot.iife.min.js",
    "report_js": "report.js",
}


def html_page(results, title, revision, provenance, databases, diagnoses, support, modes) -> str:
    """Return the text of ``report.html``; the arguments are those of `pom.write_report`, `modes` a table for every result."""
    environment = Environment(
        loader=FunctionLoader(_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["script_json"] = _script_json
    keys = case.keys(results)
    pages = [
        {**case.page(key, result, provenance, diagnoses.get(result.case.name), table), "position": i}
        for i, (key, result, table) in enumerate(zip(keys, results, modes, strict=True), 1)
    ]
    return environment.get_template("report.html").render(
        title=title,
        revision=revision,
        matrix=overview.matrix(keys, results),
        coverage=overview.coverage(results, tolerance_rows()),
        cases=pages,
        models=models.page(databases, support, case.line_styles(databases)) if databases else None,
        origin=origin.page(provenance, results, databases),
        verdict=verdicts.Verdict.of,
        **{name: Markup((_HERE / "static" / file).read_text(encoding="utf-8")) for name, file in _STATIC.items()},
    )


def _template(name: str) -> str:
    """Return a template without its indentation, which would be a tenth of the page."""
    lines = (_HERE / "templates" / name).read_text(encoding="utf-8").splitlines()
    return "".join(f"{line.lstrip()}\n" for line in lines)


def _script_json(item: Any) -> Markup:
    """Return JSON that cannot end the script element it stands in."""
    text = json.dumps(plain(item), sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))
