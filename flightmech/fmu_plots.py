"""Small line plots of the tables of a model, drawn by evaluating its own block: what is seen is what the FMU computes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .catalogue import power_name
from .library import VARIABLE, Entry, Simulation
from .units import from_si, to_si

if TYPE_CHECKING:
    from .compiler import SimModel

WIDTH, HEIGHT = 300, 180
LEFT, RIGHT, TOP, BOTTOM, LEGEND = 56, 12, 12, 34, 62
SHADES = ("#08306b", "#2171b5", "#4292c6", "#74a9cf", "#a6bddb")  # one hue, dark to light with the second axis
POINTS = 121

# "alpha -11.46 ... 17.19 deg (4)" as the compiler describes an axis
_AXIS = re.compile(r"(?P<name>\S+) (?P<low>\S+?)(?: \.\.\. (?P<high>\S+))?(?: (?P<unit>[^()]+))? \((?P<count>\d+)\)")


class Span(NamedTuple):
    """An axis of a table: name, ends [SI], number of breakpoints."""

    name: str
    low: float
    high: float
    count: int


class Figure(NamedTuple):
    """The plot of a term (SVG), or its value when it has no axes, and what has to be said with it."""

    term: str
    svg: str
    value: float | None
    caption: str


def figures(sim: SimModel) -> Iterator[Figure]:
    """Yield a figure per term, in the order of the model.

    The first axis runs, the second is at up to five values, others are in their middle.  A regressor that is no axis is one
    and a power factor is left out, so that the plot is per unit of them.
    """
    run, texts = _without_powers(sim), sim.meta.get("terms", {})
    rows = {row.name: row for row in sim.entries(VARIABLE)}
    for column, term in enumerate(sim.terms):
        text: Mapping[str, str] = texts.get(term, {})
        spans = axes_of(text.get("axes", ""))
        middle = {span.name: 0.5 * (span.low + span.high) for span in spans}
        units = {word: 1.0 for word in text.get("regressors", "").split() if word not in middle}
        per = [f"per unit of {' '.join(units)}"] if units else []
        if power_name(term) in sim.parameters:
            per.append("without its power factor")
        if not spans:
            yield Figure(term, "", float(_contribution(sim, run, column, units)[0]), "; ".join(per))
            continue
        x = np.linspace(spans[0].low, spans[0].high, POINTS)
        levels = _levels(spans[1]) if len(spans) > 1 else []
        curves = [
            _contribution(sim, run, column, {**units, **middle, **({spans[1].name: level} if levels else {}), spans[0].name: x})
            for level in levels or [0.0]
        ]
        labels = [_shown(rows[spans[1].name], level) for level in levels]
        held = [f"{span.name} = {_shown(rows[span.name], middle[span.name])}" for span in spans[2:]]
        said = [*per, *([f"shades: {spans[1].name}"] if levels else []), *held]
        yield Figure(term, _svg(term, rows[spans[0].name], x, curves, labels), None, "; ".join(said))


def axes_of(text: str) -> list[Span]:
    """Return the axes that the compiler wrote down for a term.

    Examples
    --------
    >>> axes_of("mach 0.1 ... 0.6 (2)")
    [Span(name='mach', low=0.1, high=0.6, count=2)]
    """
    found = []
    for match in _AXIS.finditer(text.replace(", ", "\n")):
        unit = match["unit"] or "1"
        low, high = (float(to_si(float(match[end] or match["low"]), unit)) for end in ("low", "high"))
        found.append(Span(match["name"], low, high, int(match["count"])))
    return found


def _without_powers(sim: SimModel) -> Simulation:
    run = Simulation(sim.model)
    for i, name in enumerate(sim.parameters):
        if name.startswith("power."):
            run.set_parameter(i, 0.0)
    return run


def _contribution(sim: SimModel, run: Simulation, column: int, values: Mapping[str, float | np.ndarray]) -> np.ndarray:
    size = max((np.size(value) for value in values.values()), default=1)
    rows = np.zeros((size, len(sim.variables)))
    for name, value in values.items():
        rows[:, sim.variables.index(name)] = value
    return run.evaluate(rows)[1][:, column]


def _levels(span: Span) -> list[float]:
    return np.linspace(span.low, span.high, min(span.count, len(SHADES))).tolist()


def _shown(row: Entry, value: float) -> str:
    return f"{from_si(value, row.display_units):.3g}{'' if row.display_units == '1' else ' ' + row.display_units}"


def _svg(term: str, axis: Entry, x: np.ndarray, curves: Sequence[np.ndarray], labels: Sequence[str]) -> str:
    low, high = float(min(map(np.min, curves))), float(max(map(np.max, curves)))
    if high == low:
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    right, bottom = WIDTH - RIGHT - (LEGEND if labels else 0), HEIGHT - BOTTOM
    px = LEFT + (x - x[0]) / ((x[-1] - x[0]) or 1.0) * (right - LEFT)

    def py(y):
        return bottom - (y - low) / (high - low) * (bottom - TOP)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(term)} over {escape(axis.name)}">']
    parts += [_tick(right, py(value), f"{value:.3g}") for value in (low, 0.5 * (low + high), high)]
    if low < 0.0 < high:
        parts.append(f'<path d="M{LEFT} {py(0.0):.1f}H{right}" class="zero"/>')
    for curve, shade in zip(curves, _shades(len(curves)), strict=True):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py(curve), strict=True))
        parts.append(f'<polyline points="{points}" stroke="{shade}"/>')
    for i, (label, shade) in enumerate(zip(labels, _shades(len(labels)), strict=True)):
        y = TOP + 8 + 14 * i
        parts.append(f'<path d="M{right + 6} {y - 4}h10" stroke="{shade}" stroke-width="2"/>')
        parts.append(_text(right + 19, y, label))
    unit = axis.display_units
    ends = [f"{from_si(float(end), unit):.3g}" for end in (x[0], x[-1])]
    parts.append(_text(LEFT, bottom + 14, ends[0]))
    parts.append(_text(right, bottom + 14, ends[1], "end"))
    parts.append(_text((LEFT + right) // 2, bottom + 26, axis.name + ("" if unit == "1" else f" [{unit}]"), "middle"))
    return "".join(parts) + "</svg>"


def _shades(count: int) -> Sequence[str]:
    if count < 2:
        return SHADES[:count]
    return [SHADES[round(i * (len(SHADES) - 1) / (count - 1))] for i in range(count)]


def _tick(right: float, y: float, text: str) -> str:
    return f'<path d="M{LEFT} {y:.1f}H{right}" class="grid"/>' + _text(LEFT - 5, round(y + 3.0, 1), text, "end")


def _text(x: float, y: float, text: str, anchor: str = "") -> str:
    return f'<text x="{x}" y="{y}"{f" text-anchor={chr(34)}{anchor}{chr(34)}" if anchor else ""}>{escape(text)}</text>'
