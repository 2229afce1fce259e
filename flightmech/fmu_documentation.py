"""documentation/index.html of an FMU: what the model is, how it is driven, which terms it holds and where they come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

from .fmu_description import CHOICES, Description, Variable
from .units import from_si

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 68rem; padding: 0 1rem; color: #1b1f24 }
h1 { font-size: 1.6rem } h2 { font-size: 1.15rem; margin-top: 2rem }
table { border-collapse: collapse; font-size: 13px }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.2rem .25rem 0; border-bottom: 1px solid #d8dee4 }
th.n, td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap } code { font-size: 13px }
"""

_DRIVING = """
<p>Set parameters, then inputs, in initialization mode. With <code>mode.trim</code> = 1 or 2 the end of initialization
seeks a steady state at the initial airspeed, flight path, bank, heading, height and rates; the outputs
<code>trim.*</code> hold what was found and the accelerations that are left.</p>
<p>Inputs are held over a communication step. FMI 2.0 importers may set first derivatives of the inputs at the start
of a step: they are then linear inside that step, and held again after it. Outputs follow the inputs without delay: after a
step, new inputs give new outputs. The internal step is at most <code>mode.step</code>; a communication step is
divided evenly. The state can be stored, restored and serialised at any point.</p>
<p>Tables are held at their ends, or extended linearly where stated; <code>out_of_range</code> counts internal steps
in which an axis was left.</p>
"""

_TERM_TEXTS = ("axes", "regressors", "source", "references", "history", "comment")


class Axis(NamedTuple):
    """One table axis with its range and its rule beyond the ends."""

    variable: str
    units: str
    low: float
    high: float
    outside: str


def html(description: Description, terms: Sequence[str], axes: Sequence[Axis], meta: Mapping[str, Any]) -> str:
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
    """
    title = escape(description.title)
    parts = [
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style></head>\n<body>',
        f"<h1>{title}</h1>\n<p>Flight simulation model. SHA-256 of <code>resources/model.bin</code>: <code>{description.token}</code></p>",
        "<h2>Driving the model</h2>" + _DRIVING,
        "<h2>Provenance</h2>\n" + _provenance(meta),
        "<h2>Terms</h2>\n" + _terms(terms, meta.get("terms", {})),
        "<h2>Table axes</h2>\n" + _table(("variable", "unit", "from", "to", "outside"), map(_axis, axes), right=(2, 3)),
        *(_variables(description, causality) for causality in ("input", "output", "parameter")),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _provenance(meta: Mapping[str, Any]) -> str:
    flat = {key: item for key, item in meta.items() if key not in ("database", "terms")} | meta.get("database", {})
    return _table(("attribute", "value"), ((key, str(item)) for key, item in flat.items()))


def _terms(names: Sequence[str], texts: Mapping[str, Mapping[str, str]]) -> str:
    columns = [key for key in _TERM_TEXTS if any(key in texts.get(name, {}) for name in names)]
    return _table(("name", *columns), ((name, *(texts.get(name, {}).get(key, "") for key in columns)) for name in names))


def _axis(axis: Axis) -> tuple[str, ...]:
    return axis.variable, axis.units, f"{axis.low:.6g}", f"{axis.high:.6g}", axis.outside


def _variables(description: Description, causality: str) -> str:
    rows = ((v.name, v.units, _start(v), v.variability, v.description) for v in description.variables if v.causality == causality)
    return f"<h2>{causality.capitalize()}s</h2>\n" + _table(("name", "unit", "start", "may change", "description"), rows, right=(2,))


def _start(v: Variable) -> str:
    if v.start is None:
        return ""
    if v.name in CHOICES:
        return next((name for name, value in CHOICES[v.name].items() if value == v.start), f"{v.start:g}")
    shown = f" ({from_si(v.start, v.display_units):.6g} {v.display_units})" if v.display_units != v.units else ""
    return f"{v.start:.9g}{shown}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> str:
    lines = [_line("th", head, right), *(_line("td", row, right) for row in rows)]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _line(kind: str, cells: Sequence[str], right: Sequence[int]) -> str:
    marked = (f"<{kind}{' class=n' if i in right else ''}>{escape(cell)}</{kind}>" for i, cell in enumerate(cells))
    return f"<tr>{''.join(marked)}</tr>"
