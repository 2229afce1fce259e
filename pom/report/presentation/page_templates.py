"""Templates of the page, with the environment that renders them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from jinja2 import Environment, FunctionLoader

from flightmech.support.figures import make_template_environment

_FOLDER = Path(__file__).parents[1] / "templates"


@cache
def page_templates() -> Environment:
    """Return the environment of the page; ``parts`` has the macros that its templates share."""
    environment = make_template_environment(FunctionLoader(_read_template))
    environment.globals["parts"] = environment.get_template("parts.html").module
    return environment


def _read_template(name: str) -> str:
    """Return a template without its indentation, which would be a tenth of the page."""
    lines = (_FOLDER / name).read_text(encoding="utf-8").splitlines()
    return "".join([f"{line.lstrip()}\n" for line in lines])
