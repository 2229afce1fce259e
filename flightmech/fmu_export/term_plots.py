"""Plots of the terms of a model for the documentation of an FMU."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flightmech.simulation.catalogue import power_name
from flightmech.simulation.kernel import VARIABLE, CatalogueEntry, Simulation
from flightmech.support import figures as svg_chart
from flightmech.support.figures import Frame, find_axis_limits
from flightmech.units import from_si, to_si

if TYPE_CHECKING:
    from flightmech.simulation.compiler import SimModel

# Sizes of a plot, its margins, and the width of the legend. [px]
WIDTH, HEIGHT = 300, 180
LEFT, RIGHT, TOP, BOTTOM, LEGEND = 56, 12, 12, 34, 62
_LEGEND_LINE = 14.0  # distance of the lines of the legend [px]
# Classes ``shade-0`` to ``shade-4`` of the page: one hue, dark to light with the second axis.
SHADES = 5
POINTS = 121  # of a curve, before points are omitted
SLACK = 0.1  # largest shift of a curve by omitted points: a kink of a table stays sharp [px]
_SPAN_TOLERANCE = 1e-6  # of the end of the changes along an axis, of the range of the axis
_CONSTANT = 1e-9  # change of a curve that is rounding, of its largest value
_FRACTIONS = (0.0, 0.25, 0.5, 1.0)  # of the other axes, at which changes along an axis count

# "alpha -11.46 ... 17.19 deg (4)", the compiler's description of an axis
_AXIS = re.compile(
    r"(?P<name>\S+) (?P<low>\S+?)(?: \.\.\. (?P<high>\S+))?(?: (?P<unit>[^()]+))? "
    r"\((?P<nodes>\d+)\)"
)


class AxisSpan(NamedTuple):
    """An axis of a table: name, ends [SI], number of breakpoints."""

    name: str
    low: float
    high: float
    nodes: int


class TermPlot(NamedTuple):
    """The plot of a term as SVG, with its caption.

    A term without axes has a `value` and no SVG.
    """

    term: str
    svg: str
    value: float | None
    caption: str


class _CurveFamily(NamedTuple):
    """Curves of a term over one axis, with one label per curve or without labels."""

    axis: CatalogueEntry
    x: np.ndarray
    curves: Sequence[np.ndarray]
    labels: Sequence[str]


def make_term_figures(sim: SimModel) -> Iterator[TermPlot]:
    """Return a figure per term, in the order of the model.

    The abscissa is the axis with the most nodes, up to the last change of the term.  The next axis
    has up to five values, and the others are at their middle.  A regressor that is not an axis is
    one, and the power factor is omitted.  The plot is therefore per unit of them.
    """
    evaluation = _TermEvaluation(sim)
    texts = sim.meta.get("terms", {})
    return (evaluation.make_figure(term, texts.get(term, {})) for term in sim.terms)


def parse_axis_spans(text: str) -> list[AxisSpan]:
    """Return the axes of a term from the text of the compiler.

    Examples
    --------
    >>> parse_axis_spans("mach 0.1 ... 0.6 (2)")
    [AxisSpan(name='mach', low=0.1, high=0.6, nodes=2)]
    """
    spans = []
    for match in _AXIS.finditer(text.replace(", ", "\n")):
        unit = match["unit"] or "1"
        low = float(to_si(float(match["low"]), unit))
        # an axis with a single breakpoint has no upper end
        high = float(to_si(float(match["high"] or match["low"]), unit))
        spans.append(AxisSpan(match["name"], low, high, int(match["nodes"])))
    return spans


class _TermEvaluation:
    """Contributions of the terms of a model; other variables are zero, power factors one."""

    def __init__(self, sim: SimModel):
        self.terms, self.run = sim.terms, Simulation(sim.model)
        self.rows = {row.name: row for row in sim.entries(VARIABLE)}
        self.powers = [name for name in sim.parameters if name.startswith("power.")]
        # an exponent of zero makes a power factor one
        for name in self.powers:
            self.run.set_parameter(sim.parameters.index(name), 0.0)

    def evaluate(self, term: str, values: Mapping[str, float | np.ndarray]) -> np.ndarray:
        """Return the contribution of a term (point,) for scalars and arrays (point,)."""
        size = max((np.size(value) for value in values.values()), default=1)
        # one row per point, one column per variable of the model
        variables = np.zeros((size, len(self.rows)))
        for i, name in enumerate(self.rows):
            variables[:, i] = values.get(name, 0.0)
        return self.run.evaluate(variables)[1][:, self.terms.index(term)]

    def make_figure(self, term: str, text: Mapping[str, str]) -> TermPlot:
        """Return the figure of a term with the axes and regressors of the compiler's text."""
        # the axis with the most breakpoints is the abscissa
        spans = sorted(parse_axis_spans(text.get("axes", "")), key=lambda span: -span.nodes)
        axis_names = {span.name for span in spans}
        units = {}
        for name in text.get("regressors", "").split():
            if name not in axis_names:
                units[name] = 1.0
        remarks = []
        if units:
            remarks.append(f"per unit of {' '.join(units)}")
        if power_name(term) in self.powers:
            remarks.append("without its power factor")
        if not spans:
            value = float(self.evaluate(term, units)[0])
            return TermPlot(term, svg="", value=value, caption="; ".join(remarks))

        first, *others = [self._shorten_span(term, span, spans, units=units) for span in spans]
        if first.high < spans[0].high:
            remarks.append(f"constant beyond {self._format_value(first.name, first.high)}")
        if others:
            remarks.append(f"shades: {others[0].name}")
        constants = dict(units)
        for span in others[1:]:
            middle = 0.5 * (span.low + span.high)
            constants[span.name] = middle
            remarks.append(f"{span.name} = {self._format_value(span.name, middle)}")
        family = self._compute_family(term, constants, first, others=others)
        return TermPlot(term, _draw_plot(term, family), value=None, caption="; ".join(remarks))

    def _compute_family(
        self,
        term: str,
        constants: Mapping[str, float],
        span: AxisSpan,
        others: Sequence[AxisSpan],
    ) -> _CurveFamily:
        """Return the curves over `span`, one for each level of the first of the other axes."""
        axis = self.rows[span.name]
        x = np.linspace(span.low, span.high, POINTS)
        if not others:
            curve = self.evaluate(term, {**constants, span.name: x})
            return _CurveFamily(axis, x, curves=[curve], labels=[])
        curves, labels = [], []
        second = others[0]
        for level in np.linspace(second.low, second.high, min(second.nodes, SHADES)).tolist():
            values = {**constants, second.name: level, span.name: x}
            curves.append(self.evaluate(term, values))
            labels.append(self._format_value(second.name, level))
        return _CurveFamily(axis, x, curves=curves, labels=labels)

    def _shorten_span(
        self, term: str, span: AxisSpan, spans: Sequence[AxisSpan], units: Mapping[str, float]
    ) -> AxisSpan:
        """Return an axis up to the last change of the term, to a factor of two.

        Heights, for example, extend to the stratosphere.
        """
        # halve the interval from its lower end until the term changes beyond its middle
        end = span.high
        while end - span.low > _SPAN_TOLERANCE * (span.high - span.low):
            middle = 0.5 * (span.low + end)
            if self._changes_beyond(term, span, middle, spans=spans, units=units):
                return span._replace(high=end)
            end = middle
        return span

    def _changes_beyond(
        self,
        term: str,
        span: AxisSpan,
        start: float,
        *,
        spans: Sequence[AxisSpan],
        units: Mapping[str, float],
    ) -> bool:
        """Return whether a term changes along an axis from `start` to the end."""
        x = np.linspace(start, span.high, POINTS)
        for fraction in _FRACTIONS:
            values: dict[str, float | np.ndarray] = dict(units)
            for axis in spans:
                values[axis.name] = axis.low + fraction * (axis.high - axis.low)
            values[span.name] = x
            curve = self.evaluate(term, values)
            if np.ptp(curve) > _CONSTANT * abs(curve).max():
                return True
        return False

    def _format_value(self, name: str, value: float) -> str:
        """Return a value of a variable in its display unit."""
        unit = self.rows[name].display_units
        number = _format_number(from_si(value, unit))
        return number if unit == "1" else f"{number} {unit}"


def _format_number(value: float) -> str:
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _draw_plot(term: str, family: _CurveFamily) -> str:
    """Return the SVG of a family of curves, with a legend to the right of the axes."""
    axis, curves = family.axis, family.curves
    x = np.asarray(from_si(family.x, axis.display_units))
    right = WIDTH - RIGHT
    if family.labels:
        right -= LEGEND
    frame = Frame(
        left=LEFT,
        top=TOP,
        width=right - LEFT,
        height=HEIGHT - TOP - BOTTOM,
        x=find_axis_limits(x),
        y=find_axis_limits(np.concatenate(curves)),
    )
    parts = [svg_chart.draw_axes(frame, x_labels=True, x_most=4)]
    # a line at zero if the curves cross it
    if frame.y[0] < 0.0 < frame.y[1]:
        zero = float(frame.py(0.0))
        parts.append(svg_chart.draw_line(frame.left, zero, frame.right, y2=zero, css="zero"))
    for y, shade in zip(curves, _shade_classes(len(curves)), strict=True):
        parts.append(svg_chart.draw_curve(frame, x, y, css=f"curve {shade}", slack=SLACK))
    parts += _draw_legend(right, family.labels)
    unit = "" if axis.display_units == "1" else f" [{axis.display_units}]"
    title = axis.name + unit
    parts.append(svg_chart.draw_text(0.5 * (LEFT + right), HEIGHT - 8.0, title, anchor="middle"))
    return svg_chart.make_svg_figure(HEIGHT, "".join(parts), f"{term} over {axis.name}", WIDTH)


def _draw_legend(right: float, labels: Sequence[str]) -> list[str]:
    """Return a short line and a text per label, from the right end of the axes. [px]"""
    parts = []
    for i, shade in enumerate(_shade_classes(len(labels))):
        y = TOP + 8.0 + _LEGEND_LINE * i
        parts += [
            svg_chart.draw_line(right + 6.0, y - 4.0, right + 16.0, y2=y - 4.0, css=f"key {shade}"),
            svg_chart.draw_text(right + 19.0, y, labels[i]),
        ]
    return parts


def _shade_classes(count: int) -> Sequence[str]:
    """Return the CSS classes of `count` curves, spread from dark to light."""
    return [f"shade-{round(i * (SHADES - 1) / max(count - 1, 1))}" for i in range(count)]
