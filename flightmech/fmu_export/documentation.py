"""documentation/index.html of an FMU: the model, its interface, its terms and their sources."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from jinja2 import PackageLoader

from flightmech.flown_samples import FLOWN_SAMPLES
from flightmech.flown_states import FLOWN_STATES
from flightmech.fmu_export.description import CHOICES, Description, FmuVariable
from flightmech.fmu_export.term_plots import TermPlot
from flightmech.simulation.kernel import (
    INPUT,
    OUTPUT,
    PARAMETER,
    STATE,
    computable_names,
    list_name_groups,
)
from flightmech.support.figures import make_template_environment
from flightmech.units import from_si

# Description of each group of names.
_SUBMODELS = {
    "weather": "wind over height, turbulence (Dryden) and discrete gusts",
    "engine": "thrust and its lever arm, first-order lag",
    "spool": "engine deck: governor, spool speeds, fuel flow, flame",
    "propeller": "propeller: blades, governor, speed, torque",
    "piston": "piston engine: manifold, air, fuel, flame",
    "motor": "electric motor: battery",
    "fuel": "fuel burnt moves mass, centre of gravity and inertia",
    "gear": "landing gear as a whole: brakes, steering, runway condition",
    "contact": "strut and tyre, or a point that touches the ground",
    "circuit": "control system from the pilot's hand to the surface: masses, cable, friction, "
    "stops, hinge moments",
    "separation": "flow separation of both wing halves, a state each; buffet as an output",
    "envelope": "how far flights support the model at the present state",
    "tanks": "fuel in tanks: mass, centre of gravity and inertia, cross-feed",
    "tank": "content of a tank, its valve",
    "feed": "from a tank to an engine: never, always or with the cross-feed open",
    "transfer": "pump from a tank to a tank",
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
    axes : sequence of PageAxis
        Table axes of the model.
    meta : mapping
        Provenance as compiled into the block: ``database`` (attributes), ``terms`` (name to texts)
        and further texts.
    figures : iterable of TermPlot
        Plots of the tables, from `term_plots.make_term_figures`.
    """
    plots = list(figures)
    # The keys are the headings of the page, in this order. Empty sections are omitted.
    sections: dict[str, object] = {
        "Driving the model": True,  # the same for every model: the text is in the template
        "Submodels": _make_submodel_table(description),
        "Provenance": _make_provenance_table(meta),
        "Terms": _make_term_table(terms, meta.get("terms", {}), plots),
        "Tables": _group_plots(plots),
        "Table axes": _make_axis_table(axes),
        "Enumerations": _make_enumeration_table(description),
    }
    for causality, _ in _KINDS:
        sections[f"{causality.capitalize()}s"] = _make_variable_table(description, causality)
    template = make_template_environment(PackageLoader(__package__, "")).get_template(
        "documentation.html"
    )
    return template.render(
        title=description.title,
        token=description.token,
        sections={name: content for name, content in sections.items() if content},
        long=LONG,
    )


def _make_submodel_table(description: Description) -> PageTable:
    """Return the groups of names in the model, with their items and numbers of variables."""
    rows = []
    for group, text in _SUBMODELS.items():
        items: list[str] = []
        if group in list_name_groups():
            items = _find_items(description, group)
        if not items:
            continue
        counts = [str(len(_list_patterns(group, kind)) * len(items)) for _, kind in _KINDS]
        rows.append((group, " ".join(filter(None, items)), text, *counts))
    heads = [f"{causality}s" for causality, _ in _KINDS]
    first = ("group of names", "items", "what it stands for")
    return PageTable((*first, *heads), rows, right=range(3, 3 + len(heads)))


def _list_patterns(group: str, kind: int) -> list[str]:
    """Return the names of a group; ``*`` is the place of an item."""
    patterns = []
    for row in computable_names(kind):
        if row.group == group:
            prefix = "state." if kind == STATE else ""
            patterns.append(prefix + row.pattern.removeprefix(prefix))
    return patterns


def _find_items(description: Description, group: str) -> list[str]:
    """Return the items of a group whose names are all variables of the model."""
    patterns: list[str] = []
    for _, kind in _KINDS:
        patterns += _list_patterns(group, kind)
    names = {variable.name for variable in description.variables}
    starred = [pattern for pattern in patterns if "*" in pattern]
    if not starred:
        # a group without items has one nameless item
        return [""] if patterns and names.issuperset(patterns) else []
    # The first pattern finds candidates for the item. Every other pattern must exist for it, too.
    form = re.compile(re.escape(starred[0]).replace(r"\*", r"([\w.]+)"), re.ASCII)
    items: list[str] = []
    for variable in description.variables:
        match = form.fullmatch(variable.name)
        if match is None or match[1] in items:
            continue
        if names.issuperset(pattern.replace("*", match[1]) for pattern in patterns):
            items.append(match[1])
    return items


def _make_provenance_table(meta: Mapping[str, Any]) -> PageTable:
    """Return the texts of the model, then the attributes of its database."""
    texts = {key: item for key, item in meta.items() if key not in ("database", "terms")}
    texts |= meta.get("database", {})
    # numbers of the flights, no text
    for name in (FLOWN_SAMPLES, FLOWN_STATES):
        texts.pop(name, None)
    return PageTable(("attribute", "value"), [(key, str(item)) for key, item in texts.items()])


def _make_term_table(
    names: Sequence[str], texts: Mapping[str, Mapping[str, str]], plots: Sequence[TermPlot]
) -> PageTable:
    """Return one row per term; constants show their values, other terms the word table."""
    # a term without axes has a value in place of a plot
    constants = {}
    for plot in plots:
        if plot.value is not None:
            constants[plot.term] = f"{plot.value:.6g} {plot.caption}".strip()
    # a text that no term has does not get a column
    present: set[str] = set()
    for name in names:
        present |= texts.get(name, {}).keys()
    columns = [key for key in _TERM_TEXTS if key in present]
    head = ["name", *columns]
    if constants:
        head.insert(1, "value")
    rows = []
    for name in names:
        row = [name]
        if constants:
            row.append(constants.get(name, "table"))
        row += [texts.get(name, {}).get(key, "") for key in columns]
        rows.append(row)
    return PageTable(head, rows)


def _group_plots(plots: Sequence[TermPlot]) -> list[tuple[str, list[TermPlot]]]:
    """Return the plots by coefficient."""
    graphs = [plot for plot in plots if plot.svg]
    groups = groupby(graphs, lambda plot: plot.term.split("/")[0])
    return [(coefficient, list(group)) for coefficient, group in groups]


def _make_axis_table(axes: Sequence[PageAxis]) -> PageTable:
    rows = []
    for axis in axes:
        low, high = f"{axis.low:.6g}", f"{axis.high:.6g}"
        rows.append((axis.variable, axis.units, low, high, axis.outside))
    return PageTable(("variable", "unit", "from", "to", "outside"), rows, right=(2, 3))


def _make_enumeration_table(description: Description) -> PageTable | None:
    rows = []
    for variable in description.variables:
        if variable.name in CHOICES:
            choices = CHOICES[variable.name].items()
            rows.append((variable.name, ", ".join(f"{value} {name}" for name, value in choices)))
    return PageTable(("name", "values"), rows) if rows else None


def _make_variable_table(description: Description, causality: str) -> PageTable | None:
    """Return the variables of one causality; start and limits have columns if any has a value."""
    variables = description.of(causality)
    if not variables:
        return None
    has_limits = any(v.low is not None or v.high is not None for v in variables)
    has_start = any(v.start is not None for v in variables)
    # a column without numbers is not shown
    numbers = []
    if has_start:
        numbers.append("start")
    if has_limits:
        numbers += ["from", "to"]
    rows = []
    for variable in variables:
        row = [variable.name, variable.units]
        if has_start:
            row.append(_format_value(variable, variable.start))
        if has_limits:
            row.append(_format_value(variable, variable.low))
            row.append(_format_value(variable, variable.high))
        rows.append([*row, variable.variability, variable.description])
    head = ("name", "unit", *numbers, "may change", "description")
    return PageTable(head, rows, right=range(2, len(head) - 2))


def _format_value(variable: FmuVariable, value: float | None) -> str:
    """Return a value in SI and in its display unit, or the name of a choice."""
    if value is None:
        return ""
    if variable.name in CHOICES:
        for name, number in CHOICES[variable.name].items():
            if number == value:
                return name
        return f"{value:g}"
    text = f"{value:.9g}"
    if variable.display_units != variable.units:
        converted = from_si(value, variable.display_units)
        text += f" ({converted:.6g} {variable.display_units})"
    return text
