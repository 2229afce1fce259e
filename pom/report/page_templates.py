"""The templates of the HTML page, read and compiled once per process."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from jinja2 import Environment, FunctionLoader

from flightmech.support.templates import environment

_FOLDER = Path(__file__).parent / "templates"


@cache
def page_templates() -> Environment:
    """Return the environment of the page; ``parts`` holds the macros that its templates share."""
    found = environment(FunctionLoader(_template))
    found.globals["parts"] = found.get_template("parts.html").module
    return found


def _template(name: str) -> str:
    """Return a template without its indentation, which would be a tenth of the page."""
    lines = (_FOLDER / name).read_text(encoding="utf-8").splitlines()
    return "".join(f"{line.lstrip()}\n" for line in lines)
