"""documentation/index.html of an FMU: what the model is, how it is driven, which terms it holds and
where they come from.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jinja2 import PackageLoader

from flightmech.fmu_export.description import CHOICES, Description, FmuVariable
from flightmech.simulation.catalogue import power_name
from flightmech.simulation.kernel import (
    INPUT,
    OUTPUT,
    PARAMETER,
    STATE,
    VARIABLE,
    CatalogueEntry,
    Simulation,
    computable_names,
    list_name_groups,
)
from flightmech.support import figures as svg_chart
from flightmech.support.figures import Frame, find_axis_limits, make_template_environment
from flightmech.units import from_si, to_si

if TYPE_CHECKING:
    from flightmech.simulation.compiler import SimModel

WIDTH, HEIGHT = 300, 180
LEFT, RIGHT, TOP, BOTTOM, LEGEND = 56, 12, 12, 34, 62
SHADES = (
    5  # classes ``shade-0`` to ``shade-4`` of the page: one hue, dark to light with the second axis
)
POINTS = 121
SLACK = 0.1  # what leaving out points may move a curve: no kink of a table is rounded

# "alpha -11.46 ... 17.19 deg (4)" as the compiler describes an axis
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
    """The plot of a term (SVG), or its value when it has no axes, and the remarks that belong to
    it.
    """

    term: str
    svg: str
    value: float | None
    caption: str


def make_term_figures(sim: SimModel) -> Iterator[TermPlot]:
    """Return a figure per term, in the order of the model.

    The axis with the most nodes runs, as far as anything changes; the next is at up to five values,
    others are in their middle. A regressor that is no axis is one and a power factor is left out,
    so that the plot is per unit of them.
    """
    table = _Evaluation(sim)
    return (table.figure(term, sim.meta.get("terms", {}).get(term, {})) for term in sim.terms)


def parse_axis_spans(text: str) -> list[AxisSpan]:
    """Return the axes that the compiler wrote down for a term.

    Examples
    --------
    >>> axes_of("mach 0.1 ... 0.6 (2)")
    [Span(name='mach', low=0.1, high=0.6, nodes=2)]
    """
    found = []
    for match in _AXIS.finditer(text.replace(", ", "\n")):
        unit = match["unit"] or "1"
        low, high = (
            float(to_si(float(match[end] or match["low"]), unit)) for end in ("low", "high")
        )
        found.append(AxisSpan(match["name"], low, high, int(match["nodes"])))
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

    def figure(self, term: str, text: Mapping[str, str]) -> TermPlot:
        """Return the figure of a term with the axes and regressors that the compiler wrote down."""
        spans = sorted(parse_axis_spans(text.get("axes", "")), key=lambda span: -span.nodes)
        units = {
            name: 1.0
            for name in text.get("regressors", "").split()
            if name not in {span.name for span in spans}
        }
        remarks = [f"per unit of {' '.join(units)}"] if units else []
        if power_name(term) in self.powers:
            remarks.append("without its power factor")
        if not spans:
            return TermPlot(term, "", float(self.over(term, units)[0]), "; ".join(remarks))
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
        remarks += [
            f"{span.name} = {self.shown(span.name, held[span.name])}" for span in others[1:]
        ]
        return TermPlot(
            term, _svg(term, self.rows[first.name], x, curves, labels), None, "; ".join(remarks)
        )

    def changing(
        self, term: str, span: AxisSpan, spans: Sequence[AxisSpan], units: Mapping[str, float]
    ) -> AxisSpan:
        """Return an axis without what lies beyond its last change, to a factor of two: heights
        reach to the stratosphere.
        """
        end = span.high
        while end - span.low > 1e-6 * (span.high - span.low):
            middle = 0.5 * (span.low + end)
            x = np.linspace(middle, span.high, POINTS)
            for part in (0.0, 0.25, 0.5, 1.0):
                others = {
                    other.name: other.low + part * (other.high - other.low) for other in spans
                }
                curve = self.over(term, {**units, **others, span.name: x})
                if np.ptp(curve) > 1e-9 * abs(curve).max():
                    return span._replace(high=end)
            end = middle
        return span

    def shown(self, name: str, value: float) -> str:
        """Return a value of a variable in the unit for people."""
        unit = self.rows[name].display_units
        return f"{_number(from_si(value, unit))}{'' if unit == '1' else ' ' + unit}"


def _levels(span: AxisSpan) -> list[float]:
    return np.linspace(span.low, span.high, min(span.nodes, SHADES)).tolist()


def _number(value: float) -> str:
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _svg(
    term: str,
    axis: CatalogueEntry,
    x: np.ndarray,
    curves: Sequence[np.ndarray],
    labels: Sequence[str],
) -> str:
    shown = np.asarray(from_si(x, axis.display_units))
    right = WIDTH - RIGHT - (LEGEND if labels else 0)
    frame = Frame(
        LEFT,
        TOP,
        right - LEFT,
        HEIGHT - TOP - BOTTOM,
        find_axis_limits(shown),
        find_axis_limits(np.concatenate(curves)),
    )
    parts = [svg_chart.draw_axes(frame, x_labels=True, x_most=4)]
    if frame.y[0] < 0.0 < frame.y[1]:
        zero = float(frame.py(0.0))
        parts.append(svg_chart.draw_line(frame.left, zero, frame.right, zero, "zero"))
    parts += [
        svg_chart.draw_curve(frame, shown, y, f"curve {shade}", SLACK)
        for y, shade in zip(curves, _shades(len(curves)), strict=True)
    ]
    for i, (label, shade) in enumerate(zip(labels, _shades(len(labels)), strict=True)):
        y = TOP + 8.0 + 14.0 * i
        parts += [
            svg_chart.draw_line(right + 6.0, y - 4.0, right + 16.0, y - 4.0, f"key {shade}"),
            svg_chart.draw_text(right + 19.0, y, label),
        ]
    unit = "" if axis.display_units == "1" else f" [{axis.display_units}]"
    parts.append(
        svg_chart.draw_text(0.5 * (LEFT + right), HEIGHT - 8.0, axis.name + unit, anchor="middle")
    )
    return svg_chart.make_svg_figure(HEIGHT, "".join(parts), f"{term} over {axis.name}", WIDTH)


def _shades(count: int) -> Sequence[str]:
    """Return the classes of so many curves, spread from dark to light."""
    return [f"shade-{round(i * (SHADES - 1) / max(count - 1, 1))}" for i in range(count)]


# group of names: what it stands for
_SUBMODELS = {
    "weather": "wind over height, turbulence (Dryden) and discrete gusts",
    "engine": "thrust and its lever arm, first-order lag",
    "spool": "engine deck: governor, spool speeds, fuel flow, flame",
    "fuel": "fuel burnt moves mass, centre of gravity and inertia",
    "gear": "landing gear as a whole: brakes, steering, runway condition",
    "contact": "strut and tyre, or a point that touches the ground",
    "circuit": "control system from the pilot's hand to the surface: masses, cable, friction, "
    "stops, hinge moments",
    "device": "further controls that only the tables know: an input each, without dynamics",
}
LONG = 200  # characters that a cell of a table shows at once
_TERM_TEXTS = ("axes", "regressors", "source", "references", "history", "comment")
_KINDS = (("input", INPUT), ("output", OUTPUT), ("parameter", PARAMETER), ("state", STATE))


class PageTable(NamedTuple):
    """A table of the page: its head, its rows, and the columns of numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()


class PageAxis(NamedTuple):
    """One table axis with its range and its rule beyond the ends."""

    variable: str
    units: str
    low: float
    high: float
    outside: str


def render_documentation(
    description: Description,
    terms: Sequence[str],
    axes: Sequence[PageAxis],
    meta: Mapping[str, Any],
    figures: Iterable[TermPlot] = (),
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
        Provenance as compiled into the block: ``database`` (attributes), ``terms`` (name to texts)
        and further texts.
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
        "Table axes": PageTable(
            ("variable", "unit", "from", "to", "outside"), [_axis(axis) for axis in axes], (2, 3)
        ),
        "Enumerations": _enumerations(description),
        **{
            f"{causality.capitalize()}s": _variables(description, causality)
            for causality in ("input", "output", "parameter", "state")
        },
    }
    template = make_template_environment(PackageLoader(__package__, "")).get_template(
        "documentation.html"
    )
    filled = {name: content for name, content in sections.items() if content}
    return template.render(
        title=description.title, token=description.token, sections=filled, long=LONG
    )


def _submodels(description: Description) -> PageTable:
    rows = []
    for group, text in _SUBMODELS.items():
        if group in list_name_groups():
            items = _items(description, group)
            counts = [str(len(_patterns(group, kind)) * len(items)) for _, kind in _KINDS]
            rows += (
                [(group, " ".join(item for item in items if item), text, *counts)] if items else []
            )
    heads = [f"{causality}s" for causality, _ in _KINDS]
    return PageTable(
        ("group of names", "items", "what it stands for", *heads), rows, range(3, 3 + len(heads))
    )


def _patterns(group: str, kind: int) -> list[str]:
    patterns = [row.pattern for row in computable_names(kind) if row.group == group]
    return (
        [f"state.{pattern.removeprefix('state.')}" for pattern in patterns]
        if kind == STATE
        else patterns
    )


def _items(description: Description, group: str) -> list[str]:
    """Return the items of a group: those for which every name of the group is a variable of the
    model.
    """
    patterns = [pattern for _, kind in _KINDS for pattern in _patterns(group, kind)]
    names = {v.name for v in description.variables}
    starred = [pattern for pattern in patterns if "*" in pattern]
    if not starred:
        return [""] if patterns and names.issuperset(patterns) else []
    form = re.compile(re.escape(starred[0]).replace(r"\*", r"([\w.]+)"), re.ASCII)
    found = [match[1] for v in description.variables if (match := form.fullmatch(v.name))]
    return [
        item
        for item in dict.fromkeys(found)
        if names.issuperset(pattern.replace("*", item) for pattern in patterns)
    ]


def _provenance(meta: Mapping[str, Any]) -> PageTable:
    flat = {key: item for key, item in meta.items() if key not in ("database", "terms")} | meta.get(
        "database", {}
    )
    return PageTable(("attribute", "value"), [(key, str(item)) for key, item in flat.items()])


def _terms(
    names: Sequence[str], texts: Mapping[str, Mapping[str, str]], drawn: Sequence[TermPlot]
) -> PageTable:
    values = {
        figure.term: f"{figure.value:.6g} {figure.caption}".strip()
        for figure in drawn
        if figure.value is not None
    }
    columns = [key for key in _TERM_TEXTS if any(key in texts.get(name, {}) for name in names)]
    value = ("value",) if values else ()
    rows = [
        (
            name,
            *((values.get(name, "table"),) if values else ()),
            *(texts.get(name, {}).get(key, "") for key in columns),
        )
        for name in names
    ]
    return PageTable(("name", *value, *columns), rows)


def _plots(drawn: Sequence[TermPlot]) -> list[tuple[str, list[TermPlot]]]:
    """Return the plots by coefficient."""
    groups = groupby(
        (figure for figure in drawn if figure.svg), lambda figure: figure.term.split("/")[0]
    )
    return [(coefficient, list(group)) for coefficient, group in groups]


def _axis(axis: PageAxis) -> tuple[str, ...]:
    return axis.variable, axis.units, f"{axis.low:.6g}", f"{axis.high:.6g}", axis.outside


def _enumerations(description: Description) -> PageTable | None:
    rows = [
        (v.name, ", ".join(f"{value} {name}" for name, value in CHOICES[v.name].items()))
        for v in description.variables
        if v.name in CHOICES
    ]
    return PageTable(("name", "values"), rows) if rows else None


def _variables(description: Description, causality: str) -> PageTable | None:
    found = description.of(causality)
    limited = any(v.low is not None or v.high is not None for v in found)
    started = any(v.start is not None for v in found)
    head = (
        "name",
        "unit",
        *(("start",) if started else ()),
        *(("from", "to") if limited else ()),
        "may change",
        "description",
    )
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
    return PageTable(head, rows, range(2, len(head) - 2)) if rows else None


def _shown(v: FmuVariable, value: float | None) -> str:
    if value is None:
        return ""
    if v.name in CHOICES:
        return next((name for name, item in CHOICES[v.name].items() if item == value), f"{value:g}")
    shown = (
        f" ({from_si(value, v.display_units):.6g} {v.display_units})"
        if v.display_units != v.units
        else ""
    )
    return f"{value:.9g}{shown}"
