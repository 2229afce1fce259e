"""A chart of the set drawn: panels in equal scales, bands of one standard error, labels at the ends of the curves, points from flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aerodb.figures.drawing import (
    LEFT,
    RIGHT,
    WIDTH,
    Axes,
    Figure,
    FigureSheet,
    Line2D,
    MaxNLocator,
    axis_limits,
    band_handle,
    colormaps,
    database_pens,
    drawing_style,
    foot_height,
    foot_lines,
)
from aerodb.figures.family_panels import end_labels
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints

_TOP, _KEY, _PANEL, _ALONE, _AXIS, _TITLE = 0.52, 0.17, 2.1, 3.6, 0.4, 0.2  # [in]


_BEYOND = 0.2  # of the range of lines and points: bands that reach farther are cut


_ROOM = 0.62  # right of a panel, for the labels of its curves [in]


_COLUMNS, _KEYS = 2, 4  # panels and entries of the legend next to each other


_BLACK = "#000000"


# members that are no scale: heights, configurations; colours of Okabe and Ito that are apart in
# grey too
_APART = ("#0072b2", "#d55e00", "#009e73", "#7a3f7d", "#8a5a00", "#56b4e9")


_MARKS = ("o", "s", "^", "D", "v", "P")


_DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (2.5, 1)),
    (0, (8, 2)),
)


def draw_chart(chart: Chart, aircraft: str, notes: Sequence[str] = ()) -> Figure:
    """Return a chart as a figure, `notes` at its foot after its own; its lines and points carry
    their labels.
    """
    with drawing_style():
        return _sheet(chart, aircraft, foot_lines((*chart.notes, *notes)))


def _sheet(chart: Chart, aircraft: str, notes: list[str]) -> Figure:
    handles = _handles(chart)
    rows_of_key = -(-len(handles) // _KEYS)
    titled = _TITLE if any(panel.title or panel.by for panel in chart.panels) else 0.0
    top = _TOP + _KEY * rows_of_key + 0.06
    columns = min(len(chart.panels), _COLUMNS)
    rows = -(-len(chart.panels) // columns)
    height = _ALONE if len(chart.panels) == 1 else _PANEL
    sheet = FigureSheet(top + rows * (titled + height + _AXIS) + foot_height(notes))
    number = f"{chart.number}, " if chart.number else ""
    sheet.figure.set_label(f"{number}{chart.title}")
    sheet.head(
        f"{aircraft}: {chart.title}" + (f" (LR-743 {chart.number})" if chart.number else ""),
        [chart.line],
    )
    if handles:
        sheet.figure.legend(
            handles=_row_by_row(handles),
            loc="upper left",
            bbox_to_anchor=(0.0, 1.0 - _TOP / sheet.height),
            ncols=min(len(handles), _KEYS),
            frameon=False,
            fontsize=7,
            handlelength=2.1,
            columnspacing=1.1,
            borderaxespad=0.2,
            labelspacing=0.25,
        )
    limits = _limits(chart)
    room = _ROOM if any(panel.by for panel in chart.panels) else RIGHT
    width = (WIDTH - LEFT - room - (columns - 1) * (room + 0.25)) / columns
    for k, panel in enumerate(chart.panels):
        left = LEFT + (k % columns) * (width + room + 0.25)
        axes = sheet.panel(
            left, top + titled + (k // columns) * (titled + height + _AXIS), width, height
        )
        _draw(axes, chart, panel, limits, (width, height))
        axes.set_xlabel(chart.x_label if k + columns >= len(chart.panels) else "", labelpad=1)
        axes.set_ylabel(chart.y_label if k % columns == 0 else "")
    sheet.foot(notes)
    return sheet.figure


def _draw(
    axes: Axes,
    chart: Chart,
    panel: ChartPanel,
    limits: tuple[tuple[float, float], tuple[float, float]],
    size: tuple[float, float],
) -> None:
    (left, right), (low, high) = limits
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 4, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(7))
    axes.set_title(panel.title, fontsize=7.5, loc="left", pad=3)
    codes = _codes(chart, panel.lines)
    for points in panel.points:
        _points(axes, chart, points)
    for line, looks in zip(panel.lines, codes):
        if line.stderr.any():
            fill, along, across = (
                (axes.fill_betweenx, line.y, line.x)
                if line.is_across
                else (axes.fill_between, line.x, line.y)
            )
            shade = {"color": looks["color"], "alpha": 0.16, "linewidth": 0, "zorder": 1.5}
            fill(
                along,
                across - line.stderr,
                across + line.stderr,
                label=f"{line.label} error",
                **shade,
            )
        axes.plot(line.x, line.y, label=line.label, zorder=2.5, **looks)
    if panel.by:
        ends = [_end(line, right, (low, high)) for line in panel.lines if len(line.x)]
        end_labels(axes, ends, (low, high), size)
        axes.set_xlim(left, right)
        axes.text(
            1.0 + 0.14 / size[0],
            1.0 + 0.05 / size[1],
            panel.by,
            transform=axes.transAxes,
            va="bottom",
            fontsize=7,
        )


def _end(line: ChartLine, right: float, limits: tuple[float, float]) -> tuple[float, float, str]:
    """Return the last point of a line inside the axes and its label, without symbol and unit where
    it has a number.
    """
    inside = np.flatnonzero(
        (line.x <= right) & (line.y >= limits[0]) & (line.y <= limits[1]) & np.isfinite(line.y)
    )
    at = inside[-1] if len(inside) else -1
    return float(line.x[at]), float(line.y[at]), short_label(line.label)


def short_label(label: str) -> str:
    """Return the number of a label ``$M$ = 0.3``, with the unit of a height; another label as it
    is.
    """
    value = label.rpartition(" = ")[2]
    return value.removesuffix(" deg") if " = " in label else value


def _codes(chart: Chart, lines: Sequence[ChartLine]) -> list[dict[str, Any]]:
    if chart.is_by_database:
        code = list(database_pens([line.label for line in lines]).values())
        return [
            {"color": pen.color, "linestyle": pen.dashes, "linewidth": pen.width} for pen in code
        ]
    return [
        {
            "color": _colour(chart, line.member),
            "linestyle": _dashes(chart, line.member),
            "linewidth": 1.1,
        }
        for line in lines
    ]


def _scaled(chart: Chart) -> bool:
    """Whether the members of the family are a scale, drawn in shades from dark to light."""
    return any("$M$" in panel.by for panel in chart.panels)


def _colour(chart: Chart, member: int) -> Any:
    if member < 0 or member == 99:
        return _BLACK
    if _scaled(chart):
        count = 1 + max((line.member for panel in chart.panels for line in panel.lines), default=0)
        return colormaps["cividis"](0.72 * member / max(count - 1, 1))
    return _APART[member % len(_APART)]


def _dashes(chart: Chart, member: int) -> Any:
    return (
        (0, (9, 2, 1.2, 2))
        if member == 99
        else "-"
        if member < 0
        else _DASHES[member % len(_DASHES)]
    )


def _points(axes: Axes, chart: Chart, points: FlightPoints) -> None:
    colour = _colour(chart, points.member)
    if points.kind == "trace":
        shade = "#8c8c8c" if points.member < 0 else colour
        axes.plot(
            points.x,
            points.y,
            color=shade,
            linewidth=0.5,
            alpha=0.75,
            label=points.label,
            zorder=1.8,
        )
    elif points.kind == "sample":
        axes.plot(
            points.x,
            points.y,
            linestyle="none",
            marker=".",
            markersize=1.4,
            color=colour,
            alpha=0.5,
            label=points.label,
            zorder=1.8,
        )
    else:
        mark = _MARKS[points.member % len(_MARKS)] if points.member >= 0 else "o"
        axes.errorbar(
            points.x,
            points.y,
            points.stderr if points.stderr.any() else None,
            linestyle="none",
            marker=mark,
            markersize=3.4,
            markerfacecolor="white",
            markeredgewidth=0.7,
            elinewidth=0.7,
            color=colour,
            label=points.label,
            zorder=3,
        )


def _handles(chart: Chart) -> list[Any]:
    """Return the legend: each database or curve that has no label at its end, each kind of points,
    the band.
    """
    found: dict[str, Any] = {}
    for panel in chart.panels:
        for line, looks in zip(panel.lines, _codes(chart, panel.lines)):
            if not panel.by:
                found.setdefault(line.label, Line2D([], [], label=line.label, **looks))
    for points in (points for panel in chart.panels for points in panel.points):
        found.setdefault(points.label, _handle(chart, points))
    if any(line.stderr.any() for panel in chart.panels for line in panel.lines):
        found["band"] = band_handle("#6e6e6e", "one standard error")
    return list(found.values())


def _row_by_row(handles: Sequence[Any]) -> list[Any]:
    """Return handles in the order in which matplotlib, which fills columns, puts them in rows."""
    return [handle for column in range(_KEYS) for handle in handles[column::_KEYS]]


def _handle(chart: Chart, points: FlightPoints) -> Line2D:
    several = _scaled(chart) and points.kind != "estimate"
    colour = (
        _BLACK
        if several and points.kind == "test point"
        else "#8c8c8c"
        if several
        else _colour(chart, points.member)
    )
    if points.kind == "trace":
        return Line2D([], [], color="#8c8c8c", linewidth=0.7, label=points.label)
    if points.kind == "sample":
        return Line2D([], [], color=colour, linestyle="none", marker=".", label=points.label)
    mark = _MARKS[points.member % len(_MARKS)] if points.member >= 0 else "o"
    return Line2D(
        [],
        [],
        color=colour,
        linestyle="none",
        marker=mark,
        markerfacecolor="white",
        label=points.label,
    )


def _limits(chart: Chart) -> tuple[tuple[float, float], tuple[float, float]]:
    lines = [line for panel in chart.panels for line in panel.lines]
    points = [points for panel in chart.panels for points in panel.points if len(points.x)]
    x = axis_limits([*(line.x for line in lines), *(p.x for p in points)], zero=chart.x_zero)
    values = [
        line.y + s * line.stderr * (not line.is_across) for line in lines for s in (-1.0, 1.0)
    ]
    core = axis_limits([*(line.y for line in lines), *(p.y for p in points)], zero=chart.y_zero)
    whole = axis_limits(
        [*values, *(p.y + s * p.stderr for p in points for s in (-1.0, 1.0))], zero=chart.y_zero
    )
    more = _BEYOND * (core[1] - core[0])
    y = max(whole[0], core[0] - more), min(whole[1], core[1] + more)
    return (max(x[0], 0.0) if chart.x_zero else x[0], x[1]), (
        max(y[0], 0.0) if chart.y_zero else y[0],
        y[1],
    )
