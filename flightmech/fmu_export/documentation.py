"""documentation/index.html of an FMU: what the model is, how it is driven, which terms it holds and where they come from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import groupby
from typing import Any, NamedTuple

from ..simulation.kernel import INPUT, OUTPUT, PARAMETER, STATE, groups, known
from ..units import from_si
from .description import CHOICES, Description, Variable
from .plots import Figure

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem; color: #1b1f24 }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2.2rem } h3 { font-size: 1rem; margin: 1.4rem 0 .4rem }
p { max-width: 60rem } nav a { margin-right: 1.1rem } a { color: #0b57a4 } code { font-size: 13px }
table { border-collapse: collapse; font-size: 13px }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.2rem .25rem 0; border-bottom: 1px solid #d8dee4 }
summary { cursor: pointer } details[open] summary { color: #57606a }
th.n, td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: 1rem 1.5rem }
figure { margin: 0 } figcaption { font-size: 12px; color: #57606a } figcaption b { color: #1b1f24; font-weight: 600 }
svg { width: 100%; height: auto; font: 10px system-ui, sans-serif; fill: #57606a } svg path { fill: none }
svg polyline { fill: none; stroke-width: 1.6 } svg .grid { stroke: #e3e7eb } svg .zero { stroke: #9aa4ae }
"""

_DRIVING = """
<p>Set parameters, then inputs, in initialization mode. With <code>mode.trim</code> = 1 or 2 the end of initialization
solves for a steady state at the initial airspeed, flight path, bank, heading, height and rates, with 3 the aircraft stands on its
gear; the outputs <code>trim.*</code> hold what was found and the remaining accelerations. All values are SI and radians.</p>
<h3>Co-simulation</h3>
<p>Inputs are held over a communication step. FMI 2.0 importers may set first derivatives of the inputs at the start
of a step: they are then linear inside that step, and held again after it. Outputs follow the inputs without delay: after a
step, new inputs give new outputs. The internal step is at most <code>mode.step</code>; a communication step is
divided evenly. The state can be stored, restored and serialised at any point.</p>
<p>FMI 3.0: a whole record in one step. In configuration mode set <code>replay.n</code> to the number of samples, then
<code>replay.t</code> (rising) and <code>replay.u</code> (one row of all inputs per sample), initialise, and make one step from the
first to the last time; <code>replay.y</code> then holds all outputs at every sample. Inputs are linear between samples.</p>
<h3>Model exchange</h3>
<p>The importer's solver integrates the states below. Positions are those of an Earth-centred frame: request a relative
tolerance of 1e-9 or less. There are no event indicators; where a table has a kink, or a wheel touches the ground, the solver
finds a smaller step by itself. Turbulence and gusts, the delay of a power lever and a control system with friction
(<code>mode.controls</code> 1 and 2) are no states: while one of them is at work the model requests a time event every
<code>mode.step</code>, and they stand still in between. Inputs that jump need an event. Directional derivatives are not given.</p>
<h3>Beyond the tables</h3>
<p>Tables are held at their ends, or extended linearly where stated; <code>out_of_range</code> counts internal steps
in which an axis was left, in co-simulation.</p>
"""

# group of names: what it stands for
_SUBMODELS = {
    "weather": "wind over height, turbulence (Dryden) and discrete gusts",
    "engine": "thrust and its lever arm, first-order lag",
    "spool": "engine deck: governor, spool speeds, fuel flow, flame",
    "fuel": "fuel burnt moves mass, centre of gravity and inertia",
    "gear": "landing gear as a whole: brakes, steering, runway condition",
    "contact": "strut and tyre, or a point that touches the ground",
    "circuit": "control system from the pilot's hand to the surface: masses, cable, friction, stops, hinge moments",
}
LONG = 200  # characters that a cell of a table shows at once
_TERM_TEXTS = ("axes", "regressors", "source", "references", "history", "comment")
_KINDS = (("input", INPUT), ("output", OUTPUT), ("parameter", PARAMETER), ("state", STATE))


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
    title, drawn = escape(description.title), list(figures)
    sections = {
        "Driving the model": _DRIVING,
        "Submodels": _submodels(description),
        "Provenance": _provenance(meta),
        "Terms": _terms(terms, meta.get("terms", {}), drawn),
        "Tables": _plots(drawn),
        "Table axes": _table(("variable", "unit", "from", "to", "outside"), map(_axis, axes), right=(2, 3)),
        "Enumerations": _enumerations(description),
        **{f"{causality.capitalize()}s": _variables(description, causality) for causality in ("input", "output", "parameter", "state")},
    }
    filled = {name: body for name, body in sections.items() if body}
    links = " ".join(f'<a href="#{_anchor(name)}">{name}</a>' for name in filled)
    parts = [
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style></head>\n<body>',
        f"<h1>{title}</h1>\n<p>Flight simulation model. SHA-256 of <code>resources/model.bin</code>: <code>{description.token}</code></p>",
        f"<nav>{links}</nav>",
        *(f'<h2 id="{_anchor(name)}">{name}</h2>\n{body}' for name, body in filled.items()),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _anchor(name: str) -> str:
    return name.lower().replace(" ", "-")


def _submodels(description: Description) -> str:
    rows = []
    for group, text in _SUBMODELS.items():
        if group in groups():
            items = _items(description, group)
            counts = [str(len(_patterns(group, kind)) * len(items)) for _, kind in _KINDS]
            rows += [(group, " ".join(item for item in items if item), text, *counts)] if items else []
    heads = [f"{causality}s" for causality, _ in _KINDS]
    return _table(("group of names", "items", "what it stands for", *heads), rows, right=range(3, 3 + len(heads)))


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
    form = re.compile(re.escape(starred[0]).replace(r"\*", r"(\w+)"), re.ASCII)
    found = [match[1] for v in description.variables if (match := form.fullmatch(v.name))]
    return [item for item in dict.fromkeys(found) if names.issuperset(pattern.replace("*", item) for pattern in patterns)]


def _provenance(meta: Mapping[str, Any]) -> str:
    flat = {key: item for key, item in meta.items() if key not in ("database", "terms")} | meta.get("database", {})
    return _table(("attribute", "value"), ((key, str(item)) for key, item in flat.items()))


def _terms(names: Sequence[str], texts: Mapping[str, Mapping[str, str]], drawn: Sequence[Figure]) -> str:
    values = {figure.term: f"{figure.value:.6g} {figure.caption}".strip() for figure in drawn if figure.value is not None}
    columns = [key for key in _TERM_TEXTS if any(key in texts.get(name, {}) for name in names)]
    value = ("value",) if values else ()
    rows = (
        (name, *((values.get(name, "table"),) if values else ()), *(texts.get(name, {}).get(key, "") for key in columns)) for name in names
    )
    return _table(("name", *value, *columns), rows)


def _plots(drawn: Sequence[Figure]) -> str:
    parts = []
    for coefficient, group in groupby((figure for figure in drawn if figure.svg), lambda figure: figure.term.split("/")[0]):
        cards = (f"<figure>{f.svg}<figcaption><b>{escape(f.term)}</b> {escape(f.caption)}</figcaption></figure>" for f in group)
        parts.append(f'<h3>{escape(coefficient)}</h3>\n<div class="plots">\n' + "\n".join(cards) + "\n</div>")
    return "\n".join(parts)


def _axis(axis: Axis) -> tuple[str, ...]:
    return axis.variable, axis.units, f"{axis.low:.6g}", f"{axis.high:.6g}", axis.outside


def _enumerations(description: Description) -> str:
    rows = [
        (v.name, ", ".join(f"{value} {name}" for name, value in CHOICES[v.name].items()))
        for v in description.variables
        if v.name in CHOICES
    ]
    return _table(("name", "values"), rows) if rows else ""


def _variables(description: Description, causality: str) -> str:
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
    return _table(head, rows, right=range(2, len(head) - 2)) if rows else ""


def _shown(v: Variable, value: float | None) -> str:
    if value is None:
        return ""
    if v.name in CHOICES:
        return next((name for name, item in CHOICES[v.name].items() if item == value), f"{value:g}")
    shown = f" ({from_si(value, v.display_units):.6g} {v.display_units})" if v.display_units != v.units else ""
    return f"{value:.9g}{shown}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> str:
    lines = [_line("th", head, right), *(_line("td", row, right) for row in rows)]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _line(kind: str, cells: Sequence[str], right: Sequence[int]) -> str:
    marked = (f"<{kind}{' class=n' if i in right else ''}>{_folded(cell)}</{kind}>" for i, cell in enumerate(cells))
    return f"<tr>{''.join(marked)}</tr>"


def _folded(text: str) -> str:
    """Return a text as HTML; a long one shows its beginning and opens on demand."""
    if len(text) <= LONG:
        return escape(text)
    return f"<details><summary>{escape(text[: LONG // 2])} ...</summary>{escape(text)}</details>"
