"""Figures of databases as families of curves, like LR-743 Figs. 1 to 4 and 12 to 15.

A sheet has one panel per database with the whole family, then one panel per member of the family
with all databases: bands of one standard error, nodes marked by their source, ticks at flight
samples.  A strip below each panel shows the difference to the first database.  Line code
distinguishes databases, and a label at the end of a curve distinguishes members, so that a grey
print can be read as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from aerodb.comparison.conditions import Conditions
from aerodb.figures.curve_families import Family, curve_family, supporting_samples
from aerodb.figures.drawing import (
    Figure,
    FigureSheet,
    Line2D,
    Pen,
    band_handle,
    database_handles,
    database_pens,
    drawing_style,
    foot_height,
    foot_lines,
    reference_notes,
    source_handles,
)
from aerodb.figures.family_panels import (
    FAMILY_HEIGHT,
    FamilySheet,
    draw_families,
    draw_member,
    quantity_symbol,
)
from aerodb.figures.symbols import (
    axis_label,
    math_symbol,
    positive_sense,
    printed_unit,
    value_with_symbol,
)
from aerodb.store.templates import lr743
from flightmech.names import lookup

_HEAD, _KEY, _PANEL, _STRIP = 0.5, 0.28, 1.3, 0.46  # heights [in]
_TITLE = 0.2  # above a panel [in]
_TICKS, _AXIS = (
    0.16,
    0.34,
)  # below a panel with tick labels only, and with the name of the axis [in]
_BOTTOM = 0.08  # between the panels and the foot [in]
_COLUMNS = 3


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
        ``"CL/basic"``, or a coefficient, ``"CL"``.
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
    """Draw a term or a coefficient of several databases over each other.

    LR-743 compares Figs. 1 to 4 and Figs. 12 to 15 in this way.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Name to database.  The first one, a priori, is dotted, and the differences are relative to
        it.  The last one is solid.
    name : str
        ``"CL/basic"``, or ``"CL"`` for the whole coefficient.
    family : str, optional
        Variable that distinguishes the curves, such as ``"mach"`` or ``"delta_f"``; see
        `aerodb.figures.curve_families` for the default.
    over : str, optional
        The abscissa.  The default is alpha if the term has it.
    at : mapping of str to float, optional
        Values of the other variables. [SI]
    support : mapping of str to array, optional
        Flight samples by variable, a Dataset or DataFrame.  Each is a tick in the panel of its
        member. [SI]

    Returns
    -------
    matplotlib Figure
        Its curves have the names of the databases as labels.

    Raises
    ------
    UnknownName
        No database has the term or coefficient, or it does not depend on a variable.
    SchemaError
        A term has no axis, or other regressors in each database.
    """
    return _draw_sheet(databases, curve_family(databases, name, family, over, at), support)


def _draw_sheet(
    databases: Mapping[str, xr.DataTree], f: Family, support: Conditions | None
) -> Figure:
    """Return the sheet of a family of curves."""
    # A database without the term has no curve, but the others keep their line code.
    pens = {}
    for name, pen in database_pens(list(databases)).items():
        if name in f.curves:
            pens[name] = pen
    count = len(f.members)
    samples = [supporting_samples(support, f, i) for i in range(count)]
    notes = foot_lines(_foot_notes(databases, f, pens))

    # A single member has a wide and high panel, and no panels of the whole family.
    columns, panel_height, families_height = 1, 2 * _PANEL, 0.0
    if count > 1:
        columns, panel_height = _COLUMNS, _PANEL
        families_height = FAMILY_HEIGHT + _AXIS + _TITLE
    strip_height = _STRIP if len(pens) > 1 else 0.0
    rows = -(-count // columns)
    top = _HEAD + _KEY
    members_top = top + _TITLE + families_height
    row_height = panel_height + strip_height + _TICKS + _TITLE
    members_height = rows * row_height - _TITLE + (_AXIS - _TICKS)
    height = members_top + members_height + _BOTTOM + foot_height(notes)

    with drawing_style():
        sheet = FigureSheet(height)
        page = FamilySheet(
            sheet,
            f,
            pens,
            columns=columns,
            panel_height=panel_height,
            strip_height=strip_height,
        )
        title = term_title(f.name)
        sheet.figure.set_label(title)
        aircraft = next(iter(databases.values())).attrs["aircraft"]
        sheet.head(f"{aircraft}: {title}", [_head_line(f)])
        sheet.key(_legend_handles(f, pens, any(map(len, samples))), _HEAD)
        if count > 1:
            draw_families(page, top + _TITLE)
        for i in range(count):
            axes = draw_member(page, i, samples[i], members_top + (i // columns) * row_height)
            # Only the lowest panel of a column has the name of the abscissa.
            is_lowest = i + columns >= count
            axes.set_xlabel(axis_label(f.over) if is_lowest else "", labelpad=1)
        sheet.foot(notes)
    return sheet.figure


def term_title(name: str) -> str:
    """Return the name of a term or coefficient with its meaning in words."""
    coefficient, _, contribution = name.partition("/")
    title = f"{name}, {lookup(coefficient).long_name.split(',')[0]}"
    slot = lr743().get(name)
    if contribution and slot is not None:
        title += f": {slot.meaning}"
    return title


def _head_line(f: Family) -> str:
    """Return ordinate, abscissa, family variable and fixed variables."""
    # A table of a term is multiplied by its regressors and its power factor.
    times = "".join(rf"\,{math_symbol(name)}" for name in f.regressors) + _power_symbol(f)
    line = f"${quantity_symbol(f)}$"
    if times:
        line += f" times ${times}$"
    line += f" over ${math_symbol(f.over)}$"
    if f.by:
        line += f", curves by ${math_symbol(f.by)}$"
        if printed_unit(f.by):
            line += f" [{printed_unit(f.by)}]"
    return line + held_text(f)


def _power_symbol(f: Family) -> str:
    if f.power is None:
        return ""
    variable = math_symbol(f.power.variable)
    return rf"\,\max({variable}, {f.power.floor:g})^{{{f.power.exponent:g}}}"


def held_text(f: Family) -> str:
    """Return the values of the fixed variables as the end of a line of the head."""
    values = ", ".join(value_with_symbol(name, value) for name, value in f.held.items())
    return f"; at {values}" if values else ""


def _foot_notes(
    databases: Mapping[str, xr.DataTree], f: Family, pens: Mapping[str, Pen]
) -> list[str]:
    """Return references, signs, definitions and titles of the databases."""
    coefficient, first = f.name.partition("/")[0], next(iter(pens))
    notes = reference_notes({name: databases[name] for name in pens})
    # The definitions are one paragraph.
    sense = positive_sense(coefficient)
    definitions = f"{coefficient} positive {sense}." if sense else ""
    for name in f.regressors:
        definitions += f" {name}: {lookup(name).long_name}."
    definitions += (
        " Bands: one standard error either side, node errors correlated as in an a-priori"
    )
    definitions += " table." if f.is_term else " table, terms independent."
    if len(pens) > 1:
        definitions += (
            f" Lower strips: difference to {first}, grey band one standard error of {first}."
        )
    notes.append(definitions)
    notes += [f"{name}: {databases[name].attrs['title']}." for name in pens]
    missing = [name for name in databases if name not in pens]
    if missing:
        notes.append(f"Without this term: {', '.join(missing)}.")
    return notes


def _legend_handles(f: Family, pens: Mapping[str, Pen], has_samples: bool) -> list[Any]:
    curves = f.all_curves()
    # The legend has only sources and bands that occur.
    sources: set[int] = set()
    for curve in curves:
        sources.update(map(int, curve.node_source))
    handles: list[Any] = [*database_handles(pens), *source_handles(sources)]
    if any(curve.stderr.any() for curve in curves):
        handles.append(band_handle(list(pens.values())[-1].color, "standard error"))
    if has_samples:
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
