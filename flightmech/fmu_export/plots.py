"""Small line plots of the tables of a model, drawn by evaluating its own block: what is seen is what the FMU computes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..simulation.catalogue import power_name
from ..simulation.kernel import VARIABLE, Entry, Simulation
from ..support import svg_chart
from ..support.svg_chart import Frame, limits
from ..units import from_si, to_si

if TYPE_CHECKING:
    from ..simulation.compiler import SimModel

WIDTH, HEIGHT = 300, 180
LEFT, RIGHT, TOP, BOTTOM, LEGEND = 56, 12, 12, 34, 62
SHADES = 5  # classes ``shade-0`` to ``shade-4`` of the page: one hue, dark to light with the second axis
POINTS = 121
SLACK = 0.1  # what leaving out points may move a curve: no kink of a table is rounded

# "alpha -11.46 ... 17.19 deg (4)" as the compiler describes an axis
_AXIS = re.compile(r"(?P<name>\S+) (?P<low>\S+?)(?: \.\.\. (?P<high>\S+))?(?: (?P<unit>[^()]+))? \((?P<nodes>\d+)\)")


class Span(NamedTuple):
    """An axis of a table: name, ends [SI], number of breakpoints."""

    name: str
    low: float
    high: float
    nodes: int


class Figure(NamedTuple):
    """The plot of a term (SVG), or its value when it has no axes, and the remarks that belong to it."""

    term: str
    svg: str
    value: float | None
    caption: str


def figures(sim: SimModel) -> Iterator[Figure]:
    """Return a figure per term, in the order of the model.

    The axis with the most nodes runs, as far as anything changes; the next is at up to five values, others are in their middle.
    A regressor that is no axis is one and a power factor is left out, so that the plot is per unit of them.
    """
    table = _Evaluation(sim)
    return (table.figure(term, sim.meta.get("terms", {}).get(term, {})) for term in sim.terms)


def axes_of(text: str) -> list[Span]:
    """Return the axes that the compiler wrote down for a term.

    Examples
    --------
    >>> axes_of("mach 0.1 ... 0.6 (2)")
    [Span(name='mach', low=0.1, high=0.6, nodes=2)]
    """
    found = []
    for match in _AXIS.finditer(text.replace(", ", "\n")):
        unit = match["unit"] or "1"
        low, high = (float(to_si(float(match[end] or match["low"]), unit)) for end in ("low", "high"))
        found.append(Span(match["name"], low, high, int(match["nodes"])))
    return found


class _Evaluation:
    """The terms of a model over chosen variables; all others are zero, power factors are one."""

    def __init__(self, sim: SimModel):
        self.terms, self.run = sim.terms, Simulation(sim.model)
        self.rows = {row.name: row for row in sim.entries(VARIABLE)}
        self.powers = [name for name in sim.parameters if name.startswith("power.")]
        for name in self.powers:
            self.run.set_parameter(sim.parameters.index(name), 0.0)

    def over(self, term: str, values: Mapping[str, float | np.ndarray]) -> np.ndarray:
        """Return the contribution of a term, scalars held and arrays running."""
        size = max((np.size(value) for value in values.values()), default=1)
        variables = np.zeros((size, len(self.rows)))
        for i, name in enumerate(self.rows):
            variables[:, i] = values.get(name, 0.0)
        return self.run.evaluate(variables)[1][:, self.terms.index(term)]

    def figure(self, term: str, text: Mapping[str, str]) -> Figure:
        """Return the figure of a term with the axes and regressors that the compiler wrote down."""
        spans = sorted(axes_of(text.get("axes", "")), key=lambda span: -span.nodes)
        units = {name: 1.0 for name in text.get("regressors", "").split() if name not in {span.name for span in spans}}
        remarks = [f"per unit of {' '.join(units)}"] if units else []
        if power_name(term) in self.powers:
            remarks.append("without its power factor")
        if not spans:
            return Figure(term, "", float(self.over(term, units)[0]), "; ".join(remarks))
        first, *others = [self.changing(term, span, spans, units) for span in spans]
        held = units | {span.name: 0.5 * (span.low + span.high) for span in others[1:]}
        levels = [{others[0].name: level} for level in _levels(others[0])] if others else [{}]
        x = np.linspace(first.low, first.high, POINTS)
        curves = [self.over(term, {**held, **level, first.name: x}) for level in levels]
        labels = [self.shown(*pair) for level in levels for pair in level.items()]
        if first.high < spans[0].high:
            remarks.append(f"constant beyond {self.shown(first.name, first.high)}")
        if others:
            remarks.append(f"shades: {others[0].name}")
        remarks += [f"{span.name} = {self.shown(span.name, held[span.name])}" for span in others[1:]]
        return Figure(term, _svg(term, self.rows[first.name], x, curves, labels), None, "; ".join(remarks))

    def changing(self, term: str, span: Span, spans: Sequence[Span], units: Mapping[str, float]) -> Span:
        """Return an axis without what lies beyond its last change, to a factor of two: heights reach to the stratosphere."""
        end = span.high
        while end - span.low > 1e-6 * (span.high - span.low):
            middle = 0.5 * (span.low + end)
            x = np.linspace(middle, span.high, POINTS)
            for part in (0.0, 0.25, 0.5, 1.0):
                others = {other.name: other.low + part * (other.high - other.low) for other in spans}
                curve = self.over(term, {**units, **others, span.name: x})
                if np.ptp(curve) > 1e-9 * abs(curve).max():
                    return span._replace(high=end)
            end = middle
        return span

    def shown(self, name: str, value: float) -> str:
        """Return a value of a variable in the unit for people."""
        unit = self.rows[name].display_units
        return f"{_number(from_si(value, unit))}{'' if unit == '1' else ' ' + unit}"


def _levels(span: Span) -> list[float]:
    return np.linspace(span.low, span.high, min(span.nodes, SHADES)).tolist()


def _number(value: float) -> str:
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _svg(term: str, axis: Entry, x: np.ndarray, curves: Sequence[np.ndarray], labels: Sequence[str]) -> str:
    shown = np.asarray(from_si(x, axis.display_units))
    right = WIDTH - RIGHT - (LEGEND if labels else 0)
    frame = Frame(LEFT, TOP, right - LEFT, HEIGHT - TOP - BOTTOM, limits(shown), limits(np.concatenate(curves)))
    parts = [svg_chart.axes(frame, x_labels=True, x_most=4)]
    if frame.y[0] < 0.0 < frame.y[1]:
        zero = float(frame.py(0.0))
        parts.append(svg_chart.line(frame.left, zero, frame.right, zero, "zero"))
    parts += [svg_chart.curve(frame, shown, y, f"curve {shade}", SLACK) for y, shade in zip(curves, _shades(len(curves)), strict=True)]
    for i, (label, shade) in enumerate(zip(labels, _shades(len(labels)), strict=True)):
        y = TOP + 8.0 + 14.0 * i
        parts += [svg_chart.line(right + 6.0, y - 4.0, right + 16.0, y - 4.0, f"key {shade}"), svg_chart.text(right + 19.0, y, label)]
    unit = "" if axis.display_units == "1" else f" [{axis.display_units}]"
    parts.append(svg_chart.text(0.5 * (LEFT + right), HEIGHT - 8.0, axis.name + unit, anchor="middle"))
    return svg_chart.svg(HEIGHT, "".join(parts), f"{term} over {axis.name}", WIDTH)


def _shades(count: int) -> Sequence[str]:
    """Return the classes of so many curves, spread from dark to light."""
    return [f"shade-{round(i * (SHADES - 1) / max(count - 1, 1))}" for i in range(count)]
