"""documentation/index.html of an FMU: what the model is, how it is driven, which terms it holds and where they come from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from jinja2 import PackageLoader

from ..simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE, groups, known
from ..support.templates import environment
from ..units import from_si
from .description import CHOICES, Description, Variable
from .plots import Figure

# group of names: what it stands for
_SUBMODELS = {
    "weather": "wind over height, turbulence (Dryden) and discrete gusts",
    "engine": "thrust and its lever arm, first-order lag",
    "spool": "engine deck: governor, spool speeds, fuel flow, flame",
    "fuel": "fuel burnt moves mass, centre of gravity and inertia",
    "gear": "landing gear as a whole: brakes, steering, runway condition",
    "contact": "strut and tyre, or a point that touches the ground",
    "circuit": "control system from the pilot's hand to the surface: masses, cable, friction, stops, hinge moments",
    "device": "further controls that only the tables know: an input each, without dynamics",
}
LONG = 200  # characters that a cell of a table shows at once
_TERM_TEXTS = ("axes", "regressors", "source", "references", "history", "comment")
_KINDS = (("input", INPUT), ("output", OUTPUT), ("parameter", PARAMETER), ("state", STATE))


class Table(NamedTuple):
    """A table of the page: its head, its rows, and the columns of numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()


class Axis(NamedTuple):
    """One table axis with its range and its rule beyond the ends."""

    variable: str
    units: str
    low: float
    high: float
    outside: str


def html(
    description: Description, terms: Sequence[str], axes: Sequence[Axis], meta: Mapping[str, Any], figures: Iterable[Figure] = ()
) -> str:
    """Return the page.

    Parameters
    ----------
    description : Description
        The interface.
    terms : sequence of str
        Names of the terms, ``CL/basic`` and so on.
    axes : sequence of Axis
        Table axes of the model.
    meta : mapping
        Provenance as compiled into the block: ``database`` (attributes), ``terms`` (name to texts) and further texts.
    figures : iterable of Figure
        Plots of the tables, from `plots.figures`.
    """
    drawn = list(figures)
    sections = {
        "Driving the model": True,  # the same for every model: the text is in the template
        "Submodels": _submodels(description),
        "Provenance": _provenance(meta),
        "Terms": _terms(terms, meta.get("terms", {}), drawn),
        "Tables": _plots(drawn),
        "Table axes": Table(("variable", "unit", "from", "to", "outside"), [_axis(axis) for axis in axes], (2, 3)),
        "Enumerations": _enumerations(description),
        **{f"{causality.capitalize()}s": _variables(description, causality) for causality in ("input", "output", "parameter", "state")},
    }
    template = environment(PackageLoader(__package__, "")).get_template("documentation.html")
    filled = {name: content for name, content in sections.items() if content}
    return template.render(title=description.title, token=description.token, sections=filled, long=LONG)


def _submodels(description: Description) -> Table:
    rows = []
    for group, text in _SUBMODELS.items():
        if group in groups():
            items = _items(description, group)
            counts = [str(len(_patterns(group, kind)) * len(items)) for _, kind in _KINDS]
            rows += [(group, " ".join(item for item in items if item), text, *counts)] if items else []
    heads = [f"{causality}s" for causality, _ in _KINDS]
    return Table(("group of names", "items", "what it stands for", *heads), rows, range(3, 3 + len(heads)))


def _patterns(group: str, kind: int) -> list[str]:
    patterns = [row.pattern for row in known(kind) if row.group == group]
    return [f"state.{pattern.removeprefix('state.')}" for pattern in patterns] if kind == STATE else patterns


def _items(description: Description, group: str) -> list[str]:
    """Return the items of a group: those for which every name of the group is a variable of the model."""
    patterns = [pattern for _, kind in _KINDS for pattern in _patterns(group, kind)]
    names = {v.name for v in description.variables}
    starred = [pattern for pattern in patterns if "*" in pattern]
    if not starred:
        return [""] if patterns and names.issuperset(patterns) else []
    form = re.compile(re.escape(starred[0]).replace(r"\*", r"([\w.]+)"), re.ASCII)
    found = [match[1] for v in description.variables if (match := form.fullmatch(v.name))]
    return [item for item in dict.fromkeys(found) if names.issuperset(pattern.replace("*", item) for pattern in patterns)]


def _provenance(meta: Mapping[str, Any]) -> Table:
    flat = {key: item for key, item in meta.items() if key not in ("database", "terms")} | meta.get("database", {})
    return Table(("attribute", "value"), [(key, str(item)) for key, item in flat.items()])


def _terms(names: Sequence[str], texts: Mapping[str, Mapping[str, str]], drawn: Sequence[Figure]) -> Table:
    values = {figure.term: f"{figure.value:.6g} {figure.caption}".strip() for figure in drawn if figure.value is not None}
    columns = [key for key in _TERM_TEXTS if any(key in texts.get(name, {}) for name in names)]
    value = ("value",) if values else ()
    rows = [
        (name, *((values.get(name, "table"),) if values else ()), *(texts.get(name, {}).get(key, "") for key in columns)) for name in names
    ]
    return Table(("name", *value, *columns), rows)


def _plots(drawn: Sequence[Figure]) -> list[tuple[str, list[Figure]]]:
    """Return the plots by coefficient."""
    groups = groupby((figure for figure in drawn if figure.svg), lambda figure: figure.term.split("/")[0])
    return [(coefficient, list(group)) for coefficient, group in groups]


def _axis(axis: Axis) -> tuple[str, ...]:
    return axis.variable, axis.units, f"{axis.low:.6g}", f"{axis.high:.6g}", axis.outside


def _enumerations(description: Description) -> Table | None:
    rows = [
        (v.name, ", ".join(f"{value} {name}" for name, value in CHOICES[v.name].items()))
        for v in description.variables
        if v.name in CHOICES
    ]
    return Table(("name", "values"), rows) if rows else None


def _variables(description: Description, causality: str) -> Table | None:
    found = description.of(causality)
    limited = any(v.low is not None or v.high is not None for v in found)
    started = any(v.start is not None for v in found)
    head = ("name", "unit", *(("start",) if started else ()), *(("from", "to") if limited else ()), "may change", "description")
    rows = [
        (
            v.name,
            v.units,
            *((_shown(v, v.start),) if started else ()),
            *((_shown(v, v.low), _shown(v, v.high)) if limited else ()),
            v.variability,
            v.description,
        )
        for v in found
    ]
    return Table(head, rows, range(2, len(head) - 2)) if rows else None


def _shown(v: Variable, value: float | None) -> str:
    if value is None:
        return ""
    if v.name in CHOICES:
        return next((name for name, item in CHOICES[v.name].items() if item == value), f"{value:g}")
    shown = f" ({from_si(value, v.display_units):.6g} {v.display_units})" if v.display_units != v.units else ""
    return f"{value:.9g}{shown}"
