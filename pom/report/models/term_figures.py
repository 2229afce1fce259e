"""Figures of one term in several databases: a panel per slice of its table.

A panel holds the curves of all databases.  A curve has a band of one standard error where its
database states it.  Filled marks are nodes that flight has changed, open marks are nodes of the
prior.  A strip below the panel shows the changes against the first database.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd
import xarray as xr

from flightmech import terms
from flightmech.support.figures import (
    WIDTH,
    Frame,
    choose_ticks,
    clip_to_frame,
    draw_area,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_text,
    text_pieces,
)
from pom.report.presentation.quantities import quantity_label, short_number, symbol_parts
from pom.report.submodels.section import Picture

FLIGHT = terms.SOURCES.index("flight")
QUANTITIES = ("value", "K1", "K2")  # tables of a leaf that are drawn

# Layout, in units of the drawing.
_COLUMNS, _HEIGHT, _LEFT, _TOP, _FOOT, _STRIP, _LETTER = 3, 140.0, 46.0, 36.0, 52.0, 58.0, 5.9
_MOST_SLICES = 6
# The abscissa is the first of these axes that a table has.
_ABSCISSA = ("alpha", "beta", "mach", "h_agl", "delta_e", "delta_a", "delta_r", "delta_f")


@dataclass(frozen=True)
class _Curve:
    """Curve of one database in one panel.

    Attributes
    ----------
    database : str
    x : array (node,)
        In the unit in which the axis is printed.
    y : array (node,)
    stderr : array (node,) or None
        One standard error.
    from_flight : array (node,) of bool, or None
        Nodes that flight has changed.  None if the nodes are not marked.
    """

    database: str
    x: np.ndarray
    y: np.ndarray
    stderr: np.ndarray | None
    from_flight: np.ndarray | None

    @property
    def edges(self) -> list[np.ndarray]:
        """Edges of the band of one standard error; empty without a band."""
        if self.stderr is None:
            return []
        return [self.y - self.stderr, self.y + self.stderr]


@dataclass(frozen=True)
class _Panel:
    """A slice of a table: position on the other axes [SI], and the curves of the databases."""

    position: dict[str, float]
    curves: list[_Curve]


@dataclass(frozen=True)
class _Figure:
    """Data that the panels of a figure share.

    Attributes
    ----------
    title : str
        Term, or the name of its table K1 or K2.
    name : str
        Identifier of the figure in the page.
    x_axis : str
        Axis along the abscissa.
    tables : dict of str to DataArray
        Tables by database; equal ones once.
    styles : mapping of str to str
        Class of the line by database.
    support : DataFrame or None
        Flight samples that support the term. [SI]
    """

    title: str
    name: str
    x_axis: str
    tables: dict[str, xr.DataArray]
    styles: Mapping[str, str]
    support: pd.DataFrame | None


def term_figures(
    term: str,
    holders: Mapping[str, xr.Dataset],
    support: pd.DataFrame | None,
    styles: Mapping[str, str],
) -> list[Picture]:
    """Return a figure for every table of a term that at least one database holds.

    Parameters
    ----------
    term : str
    holders : mapping of str to Dataset
        Leaf of the term, by the name of the database.
    support : DataFrame or None
        Flight samples that support the term.  The columns are named after its axes. [SI]
    styles : mapping of str to str
        Database name to the class of its line.
    """
    shared = _group_identical(holders)
    figures = []
    for quantity in QUANTITIES:
        if any(quantity in leaf and leaf[quantity].ndim for leaf in holders.values()):
            figures.append(
                _draw_figure(
                    term,
                    quantity,
                    holders=holders,
                    shared=shared,
                    support=support,
                    styles=styles,
                )
            )
    return figures


def is_same_leaf(leaves: Sequence[xr.Dataset]) -> bool:
    """Return whether all leaves have the same tables and the same multipliers."""
    first = leaves[0]
    for leaf in leaves[1:]:
        for quantity in QUANTITIES:
            if not _has_equal_table(first, leaf, quantity):
                return False
        if terms.list_multipliers(leaf) != terms.list_multipliers(first):
            return False
    return True


def _has_equal_table(first: xr.Dataset, second: xr.Dataset, quantity: str) -> bool:
    if quantity not in first or quantity not in second:
        return quantity not in first and quantity not in second
    return second[quantity].equals(first[quantity])


def _group_identical(holders: Mapping[str, xr.Dataset]) -> dict[str, list[str]]:
    """Return the names of databases, by the first database that holds the identical leaf."""
    groups: dict[str, list[str]] = {}
    for name, leaf in holders.items():
        first = next((first for first in groups if _is_identical(leaf, holders[first])), name)
        groups.setdefault(first, []).append(name)
    return groups


def _is_identical(first: xr.Dataset, second: xr.Dataset) -> bool:
    """Return whether leaves also have the same standard errors and sources."""
    return (
        is_same_leaf([first, second])
        and _has_equal_table(second, first, "stderr")
        and _has_equal_table(second, first, "source")
    )


def _draw_figure(
    term: str,
    quantity: str,
    holders: Mapping[str, xr.Dataset],
    shared: Mapping[str, Sequence[str]],
    support: pd.DataFrame | None,
    styles: Mapping[str, str],
) -> Picture:
    """Draw one table of a term in all databases, a panel per slice."""
    tables = {name: holders[name][quantity] for name in shared if quantity in holders[name]}
    axes: dict[str, None] = {}
    for table in tables.values():
        axes |= dict.fromkeys(map(str, table.dims))
    x_axis = next((axis for axis in _ABSCISSA if axis in axes), next(iter(axes)))
    figure = _Figure(
        title=term if quantity == "value" else quantity,
        name=f"term-{term.replace('/', '-')}-{quantity}",
        x_axis=x_axis,
        tables=tables,
        styles=styles,
        support=support,
    )
    panels: list[_Panel] = []
    for position in _choose_slices(tables, [axis for axis in axes if axis != x_axis]):
        curves = _cut_curves(tables, holders, quantity=quantity, x_axis=x_axis, position=position)
        # Slices that look the same are drawn once.
        if not any(_has_same_curves(curves, panel.curves) for panel in panels):
            panels.append(_Panel(position, curves))

    parts, height = _draw_panels(figure, panels)
    body = _draw_key(figure, shared) + "".join(parts)
    return Picture(body, height, f"{term} {quantity} against {x_axis} in {', '.join(tables)}")


def _draw_panels(figure: _Figure, panels: Sequence[_Panel]) -> tuple[list[str], float]:
    """Return the SVG of all panels, and the height of the figure."""
    changes = [_subtract_first(panel.curves) for panel in panels]
    # All panels have a strip as soon as one of them has a change.
    strip = _STRIP if any(changes) else 0.0
    row_height = _HEIGHT + strip + _FOOT
    width = (WIDTH - _LEFT * _COLUMNS - 10) / _COLUMNS
    x_limits = _x_limits(figure.tables, figure.x_axis)
    y_limits = _y_limits(panel.curves for panel in panels)
    change_limits = _y_limits(changes, zero=True) if strip else (0.0, 0.0)
    parts = []
    for i, panel in enumerate(panels):
        left = _LEFT + i % _COLUMNS * (width + _LEFT)
        top = _TOP + i // _COLUMNS * row_height
        frame = Frame(left, top, width, height=_HEIGHT, x=x_limits, y=y_limits)
        parts += [
            _draw_title(frame, figure.title, panel.position),
            draw_axes(frame, x_labels=not strip, x_most=5),
            clip_to_frame(frame, f"{figure.name}-{i}", _draw_curves(frame, panel.curves, figure)),
            _draw_support(frame, figure, panel.position),
        ]
        if strip:
            frame = Frame(
                left, frame.bottom + 6, width, height=strip - 6, x=frame.x, y=change_limits
            )
            curves = _draw_curves(frame, changes[i], figure)
            parts += [
                draw_axes(frame, x_labels=True, x_most=5, y_ticks=choose_ticks(*frame.y, 3)),
                clip_to_frame(frame, f"{figure.name}-{i}-d", curves),
            ]
        parts.append(_draw_abscissa(frame, figure.x_axis))
    # Number of rows, rounded up.
    rows = -(-len(panels) // _COLUMNS)
    return parts, _TOP + rows * row_height - 16


def _has_same_curves(first: Sequence[_Curve], second: Sequence[_Curve]) -> bool:
    for a, b in zip(first, second, strict=True):
        if not (
            np.array_equal(a.x, b.x)
            and np.array_equal(a.y, b.y)
            and _is_equal(a.stderr, b.stderr)
            and _is_equal(a.from_flight, b.from_flight)
        ):
            return False
    return True


def _is_equal(first: np.ndarray | None, second: np.ndarray | None) -> bool:
    if first is None or second is None:
        return first is second
    return np.array_equal(first, second)


def _subtract_first(curves: Sequence[_Curve]) -> list[_Curve]:
    """Return later curves minus the first, on their own nodes; empty if all are the same."""
    first, *others = curves
    differences = []
    changed = False
    for curve in others:
        difference = curve.y - np.interp(curve.x, first.x, first.y)
        changed = changed or np.abs(difference).max() > 0.0
        differences.append(_Curve(curve.database, curve.x, difference, curve.stderr, None))
    return differences if changed else []


def _choose_slices(
    tables: Mapping[str, xr.DataArray], other_axes: Sequence[str]
) -> list[dict[str, float]]:
    """Return the positions of the panels on the other axes, at most `_MOST_SLICES` of them. [SI]"""
    positions: list[dict[str, float]] = [{}]
    for axis in other_axes:
        nodes = _richest_nodes(tables, axis)
        # Evenly spaced nodes, as many as the slices so far leave room for.
        count = min(len(nodes), max(1, _MOST_SLICES // len(positions)))
        chosen = nodes[np.unique(np.linspace(0, len(nodes) - 1, count).round().astype(int))]
        positions = [{**fixed, axis: float(node)} for fixed, node in product(positions, chosen)]
    return positions


def _richest_nodes(tables: Mapping[str, xr.DataArray], axis: str) -> np.ndarray:
    """Return the nodes of an axis in the table that has most of them."""
    return max((table[axis].values for table in tables.values() if axis in table.dims), key=len)


def _cut_curves(
    tables: Mapping[str, xr.DataArray],
    holders: Mapping[str, xr.Dataset],
    quantity: str,
    x_axis: str,
    position: Mapping[str, float],
) -> list[_Curve]:
    """Return the curves of all databases at a position of the other axes."""
    label, points = quantity_label(x_axis), _all_nodes(tables, x_axis)
    curves = []
    for name, table in tables.items():
        leaf, values = holders[name], _cut_table(table, position)
        # A table without the axis is a horizontal line.
        x = np.array([points.min(), points.max()])
        if x_axis in values.dims:
            x = values[x_axis].values
        stderr = from_flight = None
        # Standard errors and sources belong to the nodes of the values.
        if quantity == "value" and x_axis in table.dims:
            if "stderr" in leaf:
                stderr = _cut_table(leaf["stderr"], position).values
            if "source" in leaf:
                source = _cut_table(leaf["source"], position, nearest=True).values
                from_flight = source == FLIGHT
        y = np.broadcast_to(values.values, x.shape)
        curves.append(_Curve(name, label.shown(x), y, stderr=stderr, from_flight=from_flight))
    return curves


def _cut_table(
    table: xr.DataArray, position: Mapping[str, float], nearest: bool = False
) -> xr.DataArray:
    """Return a table at a position of its other axes, constant outside as in the simulation."""
    for axis, value in position.items():
        if axis not in table.dims:
            continue
        nodes = table[axis].values
        inside = float(np.clip(value, nodes[0], nodes[-1]))
        if nearest or len(nodes) == 1 or inside in nodes:
            table = table.sel({axis: inside}, method="nearest")
        else:
            table = table.interp({axis: inside})
    return table


def _all_nodes(tables: Mapping[str, xr.DataArray], axis: str) -> np.ndarray:
    return np.concatenate([t[axis].values for t in tables.values() if axis in t.dims])


def _y_limits(panels: Iterable[Sequence[_Curve]], zero: bool = False) -> tuple[float, float]:
    """Return limits of the ordinate that hold all curves with their bands, and zero on request."""
    values = []
    for curves in panels:
        for curve in curves:
            values += [curve.y, *curve.edges]
    finite = np.concatenate([v[np.isfinite(v)] for v in values] + [np.zeros(int(zero))])
    low, high = float(finite.min()), float(finite.max())
    # A constant gets a margin of a tenth of its value.
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def _x_limits(tables: Mapping[str, xr.DataArray], x_axis: str) -> tuple[float, float]:
    points = quantity_label(x_axis).shown(_all_nodes(tables, x_axis))
    low, high = float(points.min()), float(points.max())
    if high > low:
        return low, high
    return low - 1.0, high + 1.0


def _draw_curves(frame: Frame, curves: Sequence[_Curve], figure: _Figure) -> str:
    return "".join([_draw_curve(frame, curve, figure.styles[curve.database]) for curve in curves])


def _draw_curve(frame: Frame, curve: _Curve, css: str) -> str:
    """Return a curve above its band, with its nodes."""
    body = ""
    if curve.stderr is not None:
        low, high = curve.edges
        body += draw_area(frame, curve.x, low, high, f"error {css}-area")
    body += draw_curve(frame, curve.x, curve.y, f"trace {css}")
    if curve.from_flight is not None:
        # A white point inside a mark makes it open.
        hollow = np.where(curve.from_flight, np.nan, curve.y)
        body += draw_dots(frame, curve.x, curve.y, f"node {css}")
        body += draw_dots(frame, curve.x, hollow, "node hollow")
    return body


def _draw_title(frame: Frame, title: str, position: Mapping[str, float]) -> str:
    """Return the position of a slice, after the title of its term where the panel has room."""
    nodes = []
    for axis, value in position.items():
        label = quantity_label(axis)
        base, subscript = symbol_parts(axis)
        symbol = f"{base}_{subscript}" if subscript else base
        shown = short_number(float(label.shown(value)), 3)
        nodes.append(f"{symbol} = {shown} {label.unit}".strip())
    if nodes:
        whole = f"{title} at {', '.join(nodes)}"
        title = whole if len(whole) * _LETTER <= frame.width else ", ".join(nodes)
    return draw_text(frame.left, frame.top - 6, title, "title")


def _draw_abscissa(frame: Frame, x_axis: str) -> str:
    label = quantity_label(x_axis)
    pieces = [(label.base, "symbol")]
    if label.sub:
        pieces.append((label.sub, "sub"))
    pieces.append((f", {label.unit}" if label.unit else "", "caption"))
    return text_pieces(frame.left + frame.width / 2, frame.bottom + 25, pieces, "middle")


def _draw_key(figure: _Figure, shared: Mapping[str, Sequence[str]]) -> str:
    """Return the line code of the databases, and the mark of a flight sample."""
    parts, x = [], _LEFT
    for name in figure.tables:
        label = " = ".join(shared[name])
        parts += [
            draw_line(x, 10, x + 30, 10, f"trace {figure.styles[name]}"),
            draw_text(x + 35, 13.5, label, "caption"),
        ]
        # 6.4 units are about the width of a character.
        x += 52 + 6.4 * len(label)
    if figure.support is not None and len(figure.support):
        parts += [
            draw_line(x + 4, 4, x + 4, 14, "rug"),
            draw_text(x + 12, 13.5, "flight sample", "caption"),
        ]
    return "".join(parts)


def _draw_support(frame: Frame, figure: _Figure, position: Mapping[str, float]) -> str:
    """Return a tick below the curve for every supporting sample that is nearest to this slice."""
    support, x_axis = figure.support, figure.x_axis
    if support is None or x_axis not in support:
        return ""
    near = np.ones(len(support), bool)
    for axis, value in position.items():
        if axis in support:
            nodes = _richest_nodes(figure.tables, axis)
            distances = np.abs(support[axis].to_numpy()[:, None] - nodes)
            near &= nodes[distances.argmin(axis=1)] == value
    points = quantity_label(x_axis).shown(support[x_axis].to_numpy()[near])
    # Ticks nearer than half a unit fall together.
    positions = np.unique(np.round(frame.px(points) * 2) / 2)
    ticks = []
    for x in positions[(positions >= frame.left) & (positions <= frame.right)]:
        ticks.append(draw_line(float(x), frame.bottom - 7, float(x), frame.bottom, "rug"))
    return "".join(ticks)
