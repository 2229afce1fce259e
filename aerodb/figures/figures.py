"""Figures of databases: families of curves as LR-743 Figs. 1 to 4 and 12 to 15 show them, databases
over each other.

A sheet has one panel per database with the whole family, then one panel per member of the family
with all databases in it: bands of one standard error, the nodes marked by their source, ticks where
flight samples lie, and below each the difference to the first database.  Databases are
distinguished by line code, members by a label at the end of the curve, so that a grey print reads
as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import Conditions
from aerodb.figures.curve_families import DatabaseCurve, Family, supporting_samples
from aerodb.figures.curve_families import curve_family as curves_of
from aerodb.figures.drawing import (
    LEFT,
    MARKS,
    RIGHT,
    WIDTH,
    Axes,
    Figure,
    FigureSheet,
    Line2D,
    MaxNLocator,
    Pen,
    axis_limits,
    band_handle,
    colormaps,
    database_handles,
    database_pens,
    drawing_style,
    foot_height,
    foot_lines,
    reference_notes,
    source_handles,
)
from aerodb.figures.symbols import (
    axis_label,
    derivative_unit,
    math_symbol,
    number_text,
    positive_sense,
    printed_unit,
    term_symbol,
    to_printed_unit,
    value_with_symbol,
)
from aerodb.store.templates import lr743
from flightmech.names import lookup

_HEAD, _KEY, _FAMILY, _PANEL, _STRIP = 0.5, 0.28, 1.95, 1.3, 0.46
_TITLE, _TICKS, _AXIS = (
    0.2,
    0.16,
    0.34,
)  # above a panel; below it with tick labels only, and with the name of the axis too [in]
_COLUMNS = 3
_LEADER, _DIGIT = (
    0.14,
    0.06,
)  # from a panel to the labels at the ends of its curves, and the width of one character there [in]
_MOST_TICKS = 300


def plot_term(
    db: xr.DataTree,
    term: str,
    family: str | None = None,
    *,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
    support: Conditions | None = None,
) -> Figure:
    """Draw a term of one database as a family of curves with standard errors, nodes and sources.

    Parameters
    ----------
    db : DataTree
        The database.
    term : str
        ``"CL/basic"``; a coefficient, ``"CL"``, will do as well.
    family, over, at, support
        As in `plot_comparison`.

    Returns
    -------
    matplotlib Figure

    Raises
    ------
    UnknownName, SchemaError
        As in `plot_comparison`.

    Examples
    --------
    >>> import aerodb
    >>> figure = aerodb.figures.plot_term(db, "CL/flap")  # doctest: +SKIP
    >>> aerodb.figures.save_figure(figure, "flap.svg")  # doctest: +SKIP
    """
    return plot_comparison({"database": db}, term, family, over=over, at=at, support=support)


def plot_comparison(
    databases: Mapping[str, xr.DataTree],
    name: str,
    family: str | None = None,
    *,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
    support: Conditions | None = None,
) -> Figure:
    """Draw a term or a coefficient of several databases over each other, as LR-743 sets Figs. 1 to
    4 against Figs. 12 to 15.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Name to database, the a-priori one first: it is drawn dotted and the others are set against
        it; the last one is solid.
    name : str
        ``"CL/basic"``, or ``"CL"`` for the whole coefficient.
    family : str, optional
        Variable that distinguishes the curves, such as ``"mach"`` or ``"delta_f"``; see
        `aerodb.figures.curve_families` for the choice made without.
    over : str, optional
        The abscissa; alpha where the term has it.
    at : mapping of str to float, optional
        Where the other variables are held. [SI]
    support : mapping of str to array, optional
        Flight samples by variable, a Dataset or DataFrame; each is a tick in the panel it belongs
        to. [SI]

    Returns
    -------
    matplotlib Figure
        Its curves carry the names of the databases as labels.

    Raises
    ------
    UnknownName
        No database has the term or coefficient, or a variable is none of its own.
    SchemaError
        A term without axes, or with other regressors in each database.
    """
    return _sheet(databases, curves_of(databases, name, family, over, at), support)


def _sheet(databases: Mapping[str, xr.DataTree], f: Family, support: Conditions | None) -> Figure:
    """Return the sheet of a family of curves."""
    code = {name: pen for name, pen in database_pens(list(databases)).items() if name in f.curves}
    ticks = [supporting_samples(support, f, i) for i in range(len(f.members))]
    several = len(f.members) > 1
    strips = _STRIP if len(code) > 1 else 0.0
    columns = _COLUMNS if several else 1
    rows = -(-len(f.members) // columns)
    panel = _PANEL if several else 2 * _PANEL
    notes = foot_lines(_notes(databases, f, code))
    top = _HEAD + _KEY
    members_top = top + _TITLE + (_FAMILY + _AXIS + _TITLE if several else 0.0)
    step = panel + strips + _TICKS + _TITLE
    height = members_top + rows * step - _TITLE + (_AXIS - _TICKS) + 0.08 + foot_height(notes)
    with drawing_style():
        sheet = FigureSheet(height)
        sheet.figure.set_label(term_title(f.name))
        sheet.head(
            f"{next(iter(databases.values())).attrs['aircraft']}: {term_title(f.name)}",
            _head_lines(f),
        )
        sheet.key(_handles(f, code, any(len(t) for t in ticks)), _HEAD)
        if several:
            _families(sheet, f, code, top + _TITLE)
        for i in range(len(f.members)):
            lowest = i + columns >= len(f.members)
            axes = _member(
                sheet,
                f,
                code,
                i,
                ticks[i],
                columns,
                members_top + (i // columns) * step,
                panel,
                strips,
            )
            axes.set_xlabel(axis_label(f.over) if lowest else "", labelpad=1)
        sheet.foot(notes)
    return sheet.figure


def term_title(name: str) -> str:
    """Return a term or coefficient in words."""
    coefficient, _, contribution = name.partition("/")
    words = lookup(coefficient).long_name.split(",")[0]
    slot = lr743().get(name)
    meaning = f": {slot.meaning}" if slot is not None else ""
    return f"{name}, {words}{meaning}" if contribution else f"{name}, {words}"


def quantity_symbol(f: Family) -> str:
    """Return the symbol of the ordinate."""
    return term_symbol(f.name, f.regressors) if f.is_term else math_symbol(f.name)


def _ordinate(f: Family) -> str:
    return f"${quantity_symbol(f)}$ [{derivative_unit(f.regressors)}]"


def _head_lines(f: Family) -> list[str]:
    times = "".join(rf"\,{math_symbol(name)}" for name in f.regressors) + _power_symbol(f)
    unit = printed_unit(f.by) if f.by else ""
    by = f", curves by ${math_symbol(f.by)}$" + (f" [{unit}]" if unit else "") if f.by else ""
    first = (
        f"${quantity_symbol(f)}$"
        + (f" times ${times}$" if times else "")
        + f" over ${math_symbol(f.over)}${by}"
    )
    return [first + held_text(f)]


def _power_symbol(f: Family) -> str:
    return (
        rf"\,\max({math_symbol(f.power.variable)}, {f.power.floor:g})^{{{f.power.exponent:g}}}"
        if f.power is not None
        else ""
    )


def held_text(f: Family) -> str:
    """Return where the further variables are held, to end a line of the head."""
    held = ", ".join(value_with_symbol(name, value) for name, value in f.held.items())
    return f"; at {held}" if held else ""


def _notes(databases: Mapping[str, xr.DataTree], f: Family, code: Mapping[str, Pen]) -> list[str]:
    sense = positive_sense(f.name.partition("/")[0])
    notes = reference_notes({name: databases[name] for name in code})
    multiplied = "".join(f" {name}: {lookup(name).long_name}." for name in f.regressors)
    notes.append(
        (f"{f.name.partition('/')[0]} positive {sense}." if sense else "")
        + multiplied
        + " Bands: one standard error either side, node errors correlated as in an a-priori table"
        + ("." if f.is_term else ", terms independent.")
        + (
            f" Lower strips: difference to {next(iter(code))}, grey band one standard error "
            f"of {next(iter(code))}."
            if len(code) > 1
            else ""
        )
    )
    lacking = [name for name in databases if name not in code]
    notes += [f"{name}: {databases[name].attrs['title']}." for name in code]
    return notes + ([f"Without this term: {', '.join(lacking)}."] if lacking else [])


def _handles(f: Family, code: Mapping[str, Pen], supported: bool) -> list[Any]:
    curves = [curve for found in f.curves.values() for curve in found if curve is not None]
    sources = {int(s) for curve in curves for s in curve.node_source}
    handles: list[Any] = [*database_handles(code), *source_handles(sources)]
    if any(curve.stderr.any() for curve in curves):
        handles.append(band_handle(list(code.values())[-1].color, "standard error"))
    if supported:
        handles.append(
            Line2D(
                [],
                [],
                color="black",
                linestyle="none",
                marker="|",
                markersize=6,
                label="flight sample",
            )
        )
    return handles


def _families(sheet: FigureSheet, f: Family, code: Mapping[str, Pen], top: float) -> None:
    """Draw the whole family of every database, side by side in equal scales."""
    count = len(code)
    words = [number_text(float(to_printed_unit(f.by, member))) for member in f.members]
    room = _LEADER + _DIGIT * max(
        4, *map(len, words)
    )  # as wide as the symbol above the labels at least
    width = (WIDTH - LEFT - RIGHT - room - (count - 1) * (room + RIGHT)) / count
    limits = axis_limits(
        curve.y for found in f.curves.values() for curve in found if curve is not None
    )
    shades = colormaps["cividis"](np.linspace(0.0, 0.72, len(f.members)))
    for k, (name, pen) in enumerate(code.items()):
        axes = sheet.panel(LEFT + k * (width + room + RIGHT), top, width, _FAMILY)
        ends = []
        for curve, member, label, shade in zip(f.curves[name], f.members, words, shades):
            if curve is None:
                continue
            x = to_printed_unit(f.over, curve.x)
            axes.plot(
                x,
                curve.y,
                color=shade,
                linestyle=pen.dashes,
                linewidth=pen.width,
                label=f"{name} {value_with_symbol(f.by, member)}",
            )
            ends.append((float(x[-1]), float(curve.y[-1]), label))
        _frame(axes, f, limits, k == 0)
        axes.set_title(name, fontsize=7.5, loc="left", pad=3)
        axes.text(
            1.0 + _LEADER / width,
            1.05,
            f"${math_symbol(f.by)}$",
            transform=axes.transAxes,
            va="bottom",
            fontsize=7,
        )
        end_labels(axes, ends, limits, (width, _FAMILY))
        axes.set_xlabel(axis_label(f.over), labelpad=1)


def end_labels(
    axes: Axes,
    ends: Sequence[tuple[float, float, str]],
    limits: tuple[float, float],
    size: tuple[float, float],
) -> None:
    """Write the member at the end of each curve, moved apart where curves end close together;
    `size` of the panel. [in]
    """
    (low, high), (width, height) = limits, size
    order = np.argsort([y for _, y, _ in ends], kind="stable")
    wanted = np.array([(ends[i][1] - low) / (high - low) for i in order])
    right = axes.get_xlim()[1]
    for i, place in zip(order, spread_apart(wanted, 0.105 / height)):
        x, y, words = ends[i]
        axes.annotate(
            words,
            xy=(x, y),
            xytext=(1.0 + _LEADER / width, place),
            textcoords="axes fraction",
            va="center",
            fontsize=6.5,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "linewidth": 0.35,
                "color": "#8c8c8c",
                "shrinkA": 0.5,
                "shrinkB": 0.0,
            },
        )
    axes.set_xlim(right=right)


def spread_apart(places: np.ndarray, least: float) -> np.ndarray:
    """Return rising places moved so that neighbours are at least `least` apart, inside 0 ... 1
    where they fit, with little movement.
    """
    groups: list[list[float]] = []  # sum of the wanted places of the first label, number of labels
    for i, place in enumerate(np.asarray(places, float)):
        groups.append([place - i * least, 1.0])
        while len(groups) > 1 and groups[-2][0] / groups[-2][1] >= groups[-1][0] / groups[-1][1]:
            total, number_of = groups.pop()
            groups[-1][0] += total
            groups[-1][1] += number_of
    base = (
        np.concatenate([np.full(int(n), total / n) for total, n in groups])
        if groups
        else np.zeros(0)
    )
    room = max(0.0, 1.0 - least * (len(base) - 1))
    return np.clip(base, 0.0, room) + least * np.arange(len(base))


def _member(
    sheet: FigureSheet,
    f: Family,
    code: Mapping[str, Pen],
    i: int,
    ticks: np.ndarray,
    columns: int,
    top: float,
    panel: float,
    strips: float,
) -> Axes:
    """Draw one member of the family with all databases in it and the differences below; return the
    lower axes.
    """
    width = (WIDTH - LEFT - RIGHT - (columns - 1) * 0.12) / columns
    left = LEFT + (i % columns) * (width + 0.12)
    axes = sheet.panel(left, top, width, panel)
    for name, pen in list(code.items())[::-1]:  # the first one on top: dots hide nothing
        curve = f.curves[name][i]
        if curve is not None:
            _curve(axes, f, curve, name, pen)
    drawn = [c for found in f.curves.values() for c in found if c is not None]
    _frame(
        axes, f, axis_limits([c.y + s * c.stderr for c in drawn for s in (-1, 1)]), i % columns == 0
    )
    _support(axes, to_printed_unit(f.over, ticks))
    if f.by:
        axes.set_title(value_with_symbol(f.by, f.members[i]), fontsize=7.5, loc="left", pad=2.5)
    if not strips:
        return axes
    axes.tick_params(labelbottom=False)
    strip = sheet.panel(left, top + panel + 0.05, width, strips - 0.05)
    _differences(strip, f, code, i)
    _frame(strip, f, axis_limits(_difference_range(f, code), zero=True), i % columns == 0)
    strip.set_ylabel(
        rf"difference [{derivative_unit(f.regressors)}]" if i % columns == 0 else "", fontsize=6
    )
    strip.yaxis.set_major_locator(MaxNLocator(3))
    return strip


def _curve(axes: Axes, f: Family, curve: DatabaseCurve, name: str, pen: Pen) -> None:
    x = to_printed_unit(f.over, curve.x)
    if curve.stderr.any():
        axes.fill_between(
            x,
            curve.y - curve.stderr,
            curve.y + curve.stderr,
            color=pen.color,
            alpha=0.2,
            linewidth=0,
            label=f"{name} error",
        )
    axes.plot(x, curve.y, color=pen.color, linestyle=pen.dashes, linewidth=pen.width, label=name)
    for source, mark in MARKS.items():
        on = curve.node_source == source
        if on.any():
            looks = {"color": pen.color, "linestyle": "none", "markeredgewidth": 0.6, **mark}
            axes.plot(
                to_printed_unit(f.over, curve.node_x[on]),
                curve.node_y[on],
                label=f"{name} nodes {source}",
                **looks,
            )


def _differences(strip: Axes, f: Family, code: Mapping[str, Pen], i: int) -> None:
    strip.axhline(0.0, color="black", linewidth=0.4)
    base = f.curves[next(iter(code))][i]
    if base is None:
        return
    strip.fill_between(
        to_printed_unit(f.over, base.x),
        -base.stderr,
        base.stderr,
        color="#6e6e6e",
        alpha=0.25,
        linewidth=0,
    )
    for name, pen in list(code.items())[1:]:
        x, d = _difference(base, f.curves[name][i])
        strip.plot(
            to_printed_unit(f.over, x),
            d,
            color=pen.color,
            linestyle=pen.dashes,
            linewidth=pen.width,
            label=name,
        )


def _difference(
    base: DatabaseCurve | None, other: DatabaseCurve | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve less the base, where both reach."""
    if base is None or other is None:
        return np.zeros(0), np.zeros(0)
    x = other.x[(other.x >= base.x[0]) & (other.x <= base.x[-1])]
    return x, np.interp(x, other.x, other.y) - np.interp(x, base.x, base.y)


def _difference_range(f: Family, code: Mapping[str, Pen]) -> list[np.ndarray]:
    first, *others = code
    lines = [
        _difference(base, other)[1]
        for name in others
        for base, other in zip(f.curves[first], f.curves[name])
    ]
    return [
        *lines,
        *(s * base.stderr for base in f.curves[first] if base is not None for s in (-1, 1)),
    ]


def _support(axes: Axes, x: np.ndarray) -> None:
    """Draw a tick at the foot of the panel for every flight sample, as many as can be
    distinguished.
    """
    low, high = axes.get_xlim()
    places = np.unique(((x - low) / (high - low) * _MOST_TICKS).round()) / _MOST_TICKS
    inside = low + (high - low) * places[(places >= 0) & (places <= 1)]
    if len(inside):
        axes.vlines(
            inside,
            0.0,
            0.055,
            transform=axes.get_xaxis_transform(),
            color="black",
            linewidth=0.5,
            alpha=0.6,
            label="flight sample",
        )


def _frame(axes: Axes, f: Family, limits: tuple[float, float], leftmost: bool) -> None:
    x = to_printed_unit(f.over, f.points[f.over])
    margin = 0.02 * (x[-1] - x[0]) or 1.0
    axes.set_xlim(x[0] - margin, x[-1] + margin)
    axes.set_ylim(*limits)
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 4, 5, 10]))
    axes.set_ylabel(_ordinate(f) if leftmost else "")
    axes.yaxis.set_label_coords(-0.53 / (axes.get_position().width * WIDTH), 0.5)
    axes.tick_params(labelleft=leftmost)
