"""Panels of a family of curves: the whole family, one member, and the difference below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerodb.figures.curve_families import Family
from aerodb.figures.curve_sources import DatabaseCurve
from aerodb.figures.drawing import (
    LEFT,
    MARKS,
    RIGHT,
    WIDTH,
    Axes,
    FigureSheet,
    MaxNLocator,
    Pen,
    axis_limits,
    colormaps,
)
from aerodb.figures.symbols import (
    axis_label,
    derivative_unit,
    math_symbol,
    number_text,
    term_symbol,
    to_printed_unit,
    value_with_symbol,
)

FAMILY_HEIGHT = 1.95  # of a panel with the whole family [in]
_LEADER = 0.14  # from a panel to the labels at the ends of its curves [in]
_DIGIT = 0.06  # width of one character of a label [in]
_LABEL_STEP = 0.105  # least distance of two labels [in]
_GAP = 0.12  # between two panels [in]
_STRIP_GAP = 0.05  # between a panel and the strip below it [in]
_LABEL_PLACE = -0.53  # of the label of the ordinate [in]
_MOST_TICKS = 300  # flight samples that can be distinguished along the abscissa
_LEADER_LINE = {
    "arrowstyle": "-",
    "linewidth": 0.35,
    "color": "#8c8c8c",
    "shrinkA": 0.5,
    "shrinkB": 0.0,
}


@dataclass(frozen=True)
class FamilySheet:
    """A sheet on which a family of curves is drawn.

    Parameters
    ----------
    sheet : FigureSheet
        The sheet.
    family : Family
        The curves.
    pens : mapping of str to Pen
        Line code of each database of the family.
    columns : int
        Panels of members next to each other.
    panel_height, strip_height : float
        Height of the panel of a member, and of the strip below it; 0 without strips. [in]
    """

    sheet: FigureSheet
    family: Family
    pens: Mapping[str, Pen]
    columns: int
    panel_height: float
    strip_height: float


def quantity_symbol(f: Family) -> str:
    """Return the symbol of the ordinate."""
    return term_symbol(f.name, f.regressors) if f.is_term else math_symbol(f.name)


def draw_families(page: FamilySheet, top: float) -> None:
    """Draw the whole family of every database, side by side in equal scales."""
    f, count = page.family, len(page.pens)
    labels = [number_text(float(to_printed_unit(f.by, member))) for member in f.members]
    # Space for the labels at the right of a panel, at least as wide as the symbol above them.
    label_width = _LEADER + _DIGIT * max(4, *map(len, labels))
    total_gap = (count - 1) * (label_width + RIGHT)
    width = (WIDTH - LEFT - RIGHT - label_width - total_gap) / count
    limits = axis_limits(curve.y for curve in f.all_curves())
    shades = colormaps["cividis"](np.linspace(0.0, 0.72, len(f.members)))
    for k, (name, pen) in enumerate(page.pens.items()):
        left_edge = LEFT + k * (width + label_width + RIGHT)
        axes = page.sheet.panel(left_edge, top, width, FAMILY_HEIGHT)
        # The shade distinguishes the members, the dashes the databases.
        ends = []
        for curve, member, label, shade in zip(
            f.curves[name], f.members, labels, shades, strict=True
        ):
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
        _set_frame(axes, f, limits, is_leftmost=k == 0)
        axes.set_title(name, fontsize=7.5, loc="left", pad=3)
        axes.text(
            1.0 + _LEADER / width,
            1.05,
            f"${math_symbol(f.by)}$",
            transform=axes.transAxes,
            va="bottom",
            fontsize=7,
        )
        end_labels(axes, ends, limits, (width, FAMILY_HEIGHT))
        axes.set_xlabel(axis_label(f.over), labelpad=1)


def end_labels(
    axes: Axes,
    ends: Sequence[tuple[float, float, str]],
    limits: tuple[float, float],
    size: tuple[float, float],
) -> None:
    """Write a label at the end of each curve; labels close together are spread.

    Parameters
    ----------
    axes : Axes
        The panel.
    ends : sequence of (x, y, label)
        Last point and label of each curve.
    limits : (low, high)
        Limits of the ordinate.
    size : (width, height)
        Size of the panel. [in]
    """
    # Positions are shares of the height of the panel.
    (low, high), (width, height) = limits, size
    order = np.argsort([y for _, y, _ in ends], kind="stable")
    positions = np.array([(ends[i][1] - low) / (high - low) for i in order])
    spread_positions = spread_apart(positions, _LABEL_STEP / height)
    right_limit = axes.get_xlim()[1]
    for i, position in zip(order, spread_positions, strict=True):
        x, y, label = ends[i]
        axes.annotate(
            label,
            xy=(x, y),
            xytext=(1.0 + _LEADER / width, position),
            textcoords="axes fraction",
            va="center",
            fontsize=6.5,
            annotation_clip=False,
            arrowprops=dict(_LEADER_LINE),
        )
    # An annotation must not widen the axes.
    axes.set_xlim(right=right_limit)


def spread_apart(positions: np.ndarray, least: float) -> np.ndarray:
    """Return rising positions with a distance of at least `least`, inside 0 ... 1 if they fit.

    Groups of labels move as little as possible in the mean.
    """
    # A group has a common distance `least` between its labels. It is the sum of the positions that
    # its first label would have for each of its labels, and their number.
    groups: list[list[float]] = []
    for i, position in enumerate(np.asarray(positions, float)):
        groups.append([position - i * least, 1.0])
        # A group that overlaps the one before it is joined with it.
        while len(groups) > 1 and groups[-2][0] / groups[-2][1] >= groups[-1][0] / groups[-1][1]:
            total, count = groups.pop()
            groups[-1][0] += total
            groups[-1][1] += count
    base = np.zeros(0)
    if groups:
        base = np.concatenate([np.full(int(count), total / count) for total, count in groups])
    space = max(0.0, 1.0 - least * (len(base) - 1))
    return np.clip(base, 0.0, space) + least * np.arange(len(base))


def draw_member(page: FamilySheet, i: int, samples: np.ndarray, top: float) -> Axes:
    """Draw one member with all databases and the differences below; return the lowest axes.

    `samples` are the abscissae of the flight samples. [SI]
    """
    f, column = page.family, i % page.columns
    width = (WIDTH - LEFT - RIGHT - (page.columns - 1) * _GAP) / page.columns
    left_edge = LEFT + column * (width + _GAP)
    axes = page.sheet.panel(left_edge, top, width, page.panel_height)
    # The first database is drawn last: its dots do not hide the other curves.
    for name, pen in list(page.pens.items())[::-1]:
        curve = f.curves[name][i]
        if curve is not None:
            _draw_curve(axes, f, curve, name=name, pen=pen)
    # All members have the same scale, which shows the bands of all curves.
    bands = []
    for curve in f.all_curves():
        bands += [curve.y - curve.stderr, curve.y + curve.stderr]
    _set_frame(axes, f, axis_limits(bands), is_leftmost=column == 0)
    _draw_samples(axes, to_printed_unit(f.over, samples))
    if f.by:
        axes.set_title(value_with_symbol(f.by, f.members[i]), fontsize=7.5, loc="left", pad=2.5)
    if not page.strip_height:
        return axes
    axes.tick_params(labelbottom=False)
    strip_top = top + page.panel_height + _STRIP_GAP
    strip = page.sheet.panel(left_edge, strip_top, width, page.strip_height - _STRIP_GAP)
    _draw_differences(strip, page, i)
    limits = axis_limits(_difference_range(page), zero=True)
    _set_frame(strip, f, limits, is_leftmost=column == 0)
    label = rf"difference [{derivative_unit(f.regressors)}]" if column == 0 else ""
    strip.set_ylabel(label, fontsize=6)
    strip.yaxis.set_major_locator(MaxNLocator(3))
    return strip


def _draw_curve(axes: Axes, f: Family, curve: DatabaseCurve, name: str, pen: Pen) -> None:
    """Draw a curve with its band of one standard error and its nodes, marked by their source."""
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
    # One plot per source, because each has its own mark.
    for source, mark in MARKS.items():
        has_source = curve.node_source == source
        if has_source.any():
            looks = {"color": pen.color, "linestyle": "none", "markeredgewidth": 0.6, **mark}
            axes.plot(
                to_printed_unit(f.over, curve.node_x[has_source]),
                curve.node_y[has_source],
                label=f"{name} nodes {source}",
                **looks,
            )


def _draw_differences(strip: Axes, page: FamilySheet, i: int) -> None:
    """Draw the differences to the first database, and its standard error."""
    f = page.family
    # The first database is the line of zero difference.
    strip.axhline(0.0, color="black", linewidth=0.4)
    first, *others = page.pens
    base = f.curves[first][i]
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
    for name in others:
        pen = page.pens[name]
        x, difference = _difference(base, f.curves[name][i])
        strip.plot(
            to_printed_unit(f.over, x),
            difference,
            color=pen.color,
            linestyle=pen.dashes,
            linewidth=pen.width,
            label=name,
        )


def _difference(
    base: DatabaseCurve | None, curve: DatabaseCurve | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return abscissae and difference of a curve to the base, where both reach."""
    if base is None or curve is None:
        return np.zeros(0), np.zeros(0)
    # The points of the curve are kept, the base is interpolated.
    x = curve.x[(curve.x >= base.x[0]) & (curve.x <= base.x[-1])]
    return x, np.interp(x, curve.x, curve.y) - np.interp(x, base.x, base.y)


def _difference_range(page: FamilySheet) -> list[np.ndarray]:
    """Return the ordinates of all strips, so that they have equal scales."""
    curves = page.family.curves
    first, *others = page.pens
    values = []
    for name in others:
        for base, curve in zip(curves[first], curves[name], strict=True):
            values.append(_difference(base, curve)[1])
    for base in curves[first]:
        if base is not None:
            values += [-base.stderr, base.stderr]
    return values


def _draw_samples(axes: Axes, x: np.ndarray) -> None:
    """Draw a tick at the foot of the panel for every flight sample that can be distinguished."""
    low, high = axes.get_xlim()
    shares = np.unique(((x - low) / (high - low) * _MOST_TICKS).round()) / _MOST_TICKS
    inside = low + (high - low) * shares[(shares >= 0) & (shares <= 1)]
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


def _set_frame(axes: Axes, f: Family, limits: tuple[float, float], is_leftmost: bool) -> None:
    """Set limits, ticks and the label of the ordinate of a panel."""
    # All panels show the range of all databases.
    x = to_printed_unit(f.over, f.points[f.over])
    margin = 0.02 * (x[-1] - x[0]) or 1.0
    axes.set_xlim(x[0] - margin, x[-1] + margin)
    axes.set_ylim(*limits)
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 4, 5, 10]))
    label = f"${quantity_symbol(f)}$ [{derivative_unit(f.regressors)}]" if is_leftmost else ""
    axes.set_ylabel(label)
    # The label is at the same distance from the axis in panels of any width.
    axes.yaxis.set_label_coords(_LABEL_PLACE / (axes.get_position().width * WIDTH), 0.5)
    axes.tick_params(labelleft=is_leftmost)
