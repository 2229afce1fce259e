"""Small line plots of the tables of a model, drawn by flying its own block: what is seen is what the FMU computes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .library import Simulation
from .names import lookup
from .units import from_si, to_si

if TYPE_CHECKING:
    from .compiler import SimModel

WIDTH, HEIGHT = 300, 180
LEFT, RIGHT, TOP, BOTTOM = 56, 10, 12, 34
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

    The first axis runs, the second is at up to five values, others are in their middle; a regressor that is no axis is one,
    so that the plot is per unit of it.
    """
    run, texts = Simulation(sim.model), sim.meta.get("terms", {})
    for column, term in enumerate(sim.terms):
        text: Mapping[str, str] = texts.get(term, {})
        spans, words = axes_of(text.get("axes", "")), text.get("regressors", "").split()
        middle = {span.name: 0.5 * (span.low + span.high) for span in spans}
        units = {word: 1.0 for word in words if word not in middle}
        if not spans:
            yield Figure(term, "", _contribution(sim, run, column, units)[0], _per(units))
            continue
        x = np.linspace(spans[0].low, spans[0].high, POINTS)
        levels = _levels(spans[1]) if len(spans) > 1 else [0.0]
        curves = []
        for level in levels:
            values = {**units, **middle, **({spans[1].name: level} if len(spans) > 1 else {}), spans[0].name: x}
            curves.append(_contribution(sim, run, column, values))
        labels = [_shown(spans[1].name, level) for level in levels] if len(spans) > 1 else []
        yield Figure(term, _svg(term, spans[0], x, curves, labels), None, _caption(spans, middle, units))


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
        low, high = (to_si(float(match[end] or match["low"]), unit) for end in ("low", "high"))
        found.append(Span(match["name"], low, high, int(match["count"])))
    return found


def _contribution(sim: SimModel, run: Simulation, column: int, values: Mapping[str, float | np.ndarray]) -> np.ndarray:
    size = max((np.size(value) for value in values.values()), default=1)
    rows = np.zeros((size, len(sim.variables)))
    for name, value in values.items():
        rows[:, sim.variables.index(name)] = value
    return run.evaluate(rows)[1][:, column]


def _levels(span: Span) -> Sequence[float]:
    return np.linspace(span.low, span.high, min(span.count, len(SHADES))).tolist()


def _shown(name: str, value: float) -> str:
    unit = lookup(name).display_units
    return f"{from_si(value, unit):.3g}{'' if unit == '1' else ' ' + unit}"


def _per(units: Mapping[str, float]) -> str:
    return f"per unit of {' '.join(units)}" if units else ""


def _caption(spans: Sequence[Span], middle: Mapping[str, float], units: Mapping[str, float]) -> str:
    held = [f"{span.name} = {_shown(span.name, middle[span.name])}" for span in spans[2:]]
    shades = [f"shades: {spans[1].name}"] if len(spans) > 1 else []
    return "; ".join(text for text in (_per(units), *shades, *held) if text)


def _svg(term: str, span: Span, x: np.ndarray, curves: Sequence[np.ndarray], labels: Sequence[str]) -> str:
    low, high = float(min(map(np.min, curves))), float(max(map(np.max, curves)))
    if high == low:
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    right = WIDTH - RIGHT - (58 if labels else 0)
    px = LEFT + (x - x[0]) / ((x[-1] - x[0]) or 1.0) * (right - LEFT)

    def py(y):
        return HEIGHT - BOTTOM - (y - low) / (high - low) * (HEIGHT - BOTTOM - TOP)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(term)} over {escape(span.name)}">']
    parts += [_line(LEFT, right, py(tick), f"{tick:.3g}") for tick in (low, 0.5 * (low + high), high)]
    if low < 0.0 < high:
        parts.append(f'<path d="M{LEFT} {py(0.0):.1f}H{right}" class="zero"/>')
    for curve, shade in zip(curves, _shades(len(curves)), strict=True):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py(curve), strict=True))
        parts.append(f'<polyline points="{points}" stroke="{shade}"/>')
    for i, (label, shade) in enumerate(zip(labels, _shades(len(labels)), strict=True)):
        y = TOP + 8 + 14 * i
        parts.append(
            f'<path d="M{right + 6} {y - 4}h10" stroke="{shade}" stroke-width="2"/><text x="{right + 19}" y="{y}">{escape(label)}</text>'
        )
    bottom = HEIGHT - BOTTOM + 14
    unit = lookup(span.name).display_units
    parts.append(f'<text x="{LEFT}" y="{bottom}">{from_si(float(x[0]), unit):.3g}</text>')
    parts.append(f'<text x="{right}" y="{bottom}" text-anchor="end">{from_si(float(x[-1]), unit):.3g}</text>')
    name = escape(span.name + ("" if unit == "1" else f" [{unit}]"))
    parts.append(f'<text x="{(LEFT + right) / 2:.0f}" y="{bottom + 12}" text-anchor="middle">{name}</text></svg>')
    return "".join(parts)


def _shades(count: int) -> Sequence[str]:
    if count < 2:
        return SHADES[:count]
    return [SHADES[round(i * (len(SHADES) - 1) / (count - 1))] for i in range(count)]


def _line(left: float, right: float, y: float, text: str) -> str:
    return f'<path d="M{left} {y:.1f}H{right}" class="grid"/><text x="{left - 5}" y="{y + 3:.1f}" text-anchor="end">{text}</text>'
