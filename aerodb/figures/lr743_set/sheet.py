"""Drawing of a chart of the LR-743 set: panels, bands, labels, points from flight."""

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
from aerodb.figures.lr743_set.chart import BOUNDARY, Chart, ChartLine, ChartPanel, FlightPoints

_TOP, _KEY, _PANEL, _ALONE, _AXIS, _TITLE = 0.52, 0.17, 2.1, 3.6, 0.4, 0.2  # heights [in]
_LABELS = 0.62  # right of a panel, for the labels of its curves [in]
_GAP = 0.25  # between two panels, in addition to the labels [in]
# Bands extend the axis by this multiple of the range of lines and points, or by the median width of
# a band. Wider parts, such as the ends of a table that was not flown, are cut.
_BEYOND = 2.0
_CUT = "Bands or bars that end at the edge of the axes go on beyond it."
_COLUMNS, _KEYS = 2, 4  # panels and entries of the legend next to each other
_BLACK, _GREY = "#000000", "#8c8c8c"
# Colours of members that are not a scale, such as heights and configurations. They are colours of
# Okabe and Ito that differ in grey as well.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7a3f7d", "#8a5a00", "#56b4e9")
_MARKS = ("o", "s", "^", "D", "v", "P")
_DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (2.5, 1)),
    (0, (8, 2)),
)
_BOUNDARY_DASHES = (0, (9, 2, 1.2, 2))

Limits = tuple[tuple[float, float], tuple[float, float]]
"""Limits of the abscissa and of the ordinate."""


def draw_chart(chart: Chart, aircraft: str, notes: Sequence[str] = ()) -> Figure:
    """Return a chart as a figure; `notes` follow those of the chart at its foot.

    Lines and points have their labels.
    """
    with drawing_style():
        cut = [_CUT] if _is_cut(chart) else []
        return _draw_sheet(chart, aircraft, foot_lines((*chart.notes, *cut, *notes)))


def _draw_sheet(chart: Chart, aircraft: str, notes: list[str]) -> Figure:
    handles = _legend_handles(chart)
    count = len(chart.panels)
    # Rows of panels and rows of the legend; the height of the sheet follows from them.
    columns = min(count, _COLUMNS)
    rows, key_rows = -(-count // columns), -(-len(handles) // _KEYS)
    panel_height = _ALONE if count == 1 else _PANEL
    title_height = _TITLE if any(panel.title or panel.by for panel in chart.panels) else 0.0
    row_height = title_height + panel_height + _AXIS
    top = _TOP + _KEY * key_rows + 0.06
    sheet = FigureSheet(top + rows * row_height + foot_height(notes))
    _write_titles(sheet, chart, aircraft)
    if handles:
        _draw_legend(sheet, handles)

    limits = _chart_limits(chart)
    label_width = _LABELS if any(panel.by for panel in chart.panels) else RIGHT
    gap = label_width + _GAP
    width = (WIDTH - LEFT - label_width - (columns - 1) * gap) / columns
    for k, panel in enumerate(chart.panels):
        row, column = divmod(k, columns)
        left_edge = LEFT + column * (width + gap)
        axes = sheet.panel(left_edge, top + title_height + row * row_height, width, panel_height)
        _draw_panel(axes, chart, panel, limits=limits, size=(width, panel_height))
        is_lowest = k + columns >= count
        axes.set_xlabel(chart.x_label if is_lowest else "", labelpad=1)
        axes.set_ylabel(chart.y_label if column == 0 else "")
    sheet.foot(notes)
    return sheet.figure


def _write_titles(sheet: FigureSheet, chart: Chart, aircraft: str) -> None:
    label, title = chart.title, f"{aircraft}: {chart.title}"
    if chart.number:
        label = f"{chart.number}, {label}"
        title += f" (LR-743 {chart.number})"
    sheet.figure.set_label(label)
    sheet.head(title, [chart.line])


def _draw_legend(sheet: FigureSheet, handles: Sequence[Any]) -> None:
    sheet.figure.legend(
        handles=_order_by_rows(handles),
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


def _draw_panel(
    axes: Axes, chart: Chart, panel: ChartPanel, *, limits: Limits, size: tuple[float, float]
) -> None:
    """Draw points, bands and lines of a panel, and the labels at the ends of its lines."""
    (low_x, high_x), y_limits = limits
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(*y_limits)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 4, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(7))
    axes.set_title(panel.title, fontsize=7.5, loc="left", pad=3)
    # Points are below the lines of the database.
    for points in panel.points:
        _draw_points(axes, chart, points)
    for line, looks in zip(panel.lines, _line_looks(chart, panel.lines), strict=True):
        if line.stderr.any():
            _draw_band(axes, line, looks["color"])
        axes.plot(line.x, line.y, label=line.label, zorder=2.5, **looks)
    if panel.by:
        ends = [_line_end(line, high_x, y_limits) for line in panel.lines if len(line.x)]
        end_labels(axes, ends, y_limits, size)
        axes.set_xlim(low_x, high_x)
        axes.text(
            1.0 + 0.14 / size[0],
            1.0 + 0.05 / size[1],
            panel.by,
            transform=axes.transAxes,
            va="bottom",
            fontsize=7,
        )


def _draw_band(axes: Axes, line: ChartLine, color: Any) -> None:
    """Draw the band of one standard error, in the direction of the axis that has it."""
    fill: Any = axes.fill_between
    along, across = line.x, line.y
    if line.is_across:
        fill, along, across = axes.fill_betweenx, line.y, line.x
    fill(
        along,
        across - line.stderr,
        across + line.stderr,
        label=f"{line.label} error",
        color=color,
        alpha=0.16,
        linewidth=0,
        zorder=1.5,
    )


def _line_end(
    line: ChartLine, high_x: float, y_limits: tuple[float, float]
) -> tuple[float, float, str]:
    """Return the last point of a line inside the axes, and its short label."""
    # The label belongs to the last point that the axes show.
    is_inside = (line.x <= high_x) & (line.y >= y_limits[0]) & (line.y <= y_limits[1])
    inside = np.flatnonzero(is_inside & np.isfinite(line.y))
    last = inside[-1] if len(inside) else -1
    return float(line.x[last]), float(line.y[last]), short_label(line.label)


def short_label(label: str) -> str:
    """Return the number of a label ``$M$ = 0.3``, or a label without a number."""
    value = label.rpartition(" = ")[2]
    return value.removesuffix(" deg") if " = " in label else value


def _line_looks(chart: Chart, lines: Sequence[ChartLine]) -> list[dict[str, Any]]:
    """Return colour, dashes and width of lines: by database, or by member of the family."""
    looks = []
    if chart.is_by_database:
        for pen in database_pens([line.label for line in lines]).values():
            looks.append({"color": pen.color, "linestyle": pen.dashes, "linewidth": pen.width})
        return looks
    for line in lines:
        color, dashes = _member_colour(chart, line.member), _member_dashes(line.member)
        looks.append({"color": color, "linestyle": dashes, "linewidth": 1.1})
    return looks


def _has_scale(chart: Chart) -> bool:
    """Return whether the members are a scale, which is drawn in shades from dark to light."""
    return any("$M$" in panel.by for panel in chart.panels)


def _all_lines(chart: Chart) -> list[ChartLine]:
    lines: list[ChartLine] = []
    for panel in chart.panels:
        lines += panel.lines
    return lines


def _all_points(chart: Chart) -> list[FlightPoints]:
    points: list[FlightPoints] = []
    for panel in chart.panels:
        points += panel.points
    return points


def _member_colour(chart: Chart, member: int) -> Any:
    if member < 0 or member == BOUNDARY:
        return _BLACK
    # From dark to light; the lightest shades are not used.
    if _has_scale(chart):
        count = 1 + max((line.member for line in _all_lines(chart)), default=0)
        return colormaps["cividis"](0.72 * member / max(count - 1, 1))
    return _COLOURS[member % len(_COLOURS)]


def _member_dashes(member: int) -> Any:
    if member == BOUNDARY:
        return _BOUNDARY_DASHES
    return "-" if member < 0 else _DASHES[member % len(_DASHES)]


def _member_mark(member: int) -> str:
    return _MARKS[member % len(_MARKS)] if member >= 0 else "o"


def _draw_points(axes: Axes, chart: Chart, points: FlightPoints) -> None:
    colour = _member_colour(chart, points.member)
    if points.kind == "trace":
        axes.plot(
            points.x,
            points.y,
            color=_GREY if points.member < 0 else colour,
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
        axes.errorbar(
            points.x,
            points.y,
            points.stderr if points.stderr.any() else None,
            linestyle="none",
            marker=_member_mark(points.member),
            markersize=3.4,
            markerfacecolor="white",
            markeredgewidth=0.7,
            elinewidth=0.7,
            color=colour,
            label=points.label,
            zorder=3,
        )


def _legend_handles(chart: Chart) -> list[Any]:
    """Return the legend: lines without a label at their end, kinds of points, the band."""
    # Equal labels have one entry, that of their first occurrence.
    handles: dict[str, Any] = {}
    for panel in chart.panels:
        if panel.by:
            continue
        for line, looks in zip(panel.lines, _line_looks(chart, panel.lines), strict=True):
            handles.setdefault(line.label, Line2D([], [], label=line.label, **looks))
    for points in _all_points(chart):
        handles.setdefault(points.label, _points_handle(chart, points))
    if any(line.stderr.any() for line in _all_lines(chart)):
        handles["band"] = band_handle("#6e6e6e", "one standard error")
    return list(handles.values())


def _order_by_rows(handles: Sequence[Any]) -> list[Any]:
    """Return handles in an order that gives rows, because matplotlib fills columns."""
    ordered: list[Any] = []
    for column in range(_KEYS):
        ordered += handles[column::_KEYS]
    return ordered


def _points_handle(chart: Chart, points: FlightPoints) -> Line2D:
    """Return the entry of points in the legend."""
    if points.kind == "trace":
        return Line2D([], [], color=_GREY, linewidth=0.7, label=points.label)
    colour = _member_colour(chart, points.member)
    # One entry stands for points of several members, so it has a neutral colour.
    if _has_scale(chart) and points.kind != "estimate":
        colour = _BLACK if points.kind == "test point" else _GREY
    if points.kind == "sample":
        return Line2D([], [], color=colour, linestyle="none", marker=".", label=points.label)
    return Line2D(
        [],
        [],
        color=colour,
        linestyle="none",
        marker=_member_mark(points.member),
        markerfacecolor="white",
        label=points.label,
    )


def _chart_limits(chart: Chart) -> Limits:
    """Return limits that show all lines and points, and bands as far as `_BEYOND`."""
    curves: list[ChartLine | FlightPoints] = _all_curves(chart)
    low_x, high_x = axis_limits([item.x for item in curves], zero=chart.x_zero)
    inner = axis_limits([item.y for item in curves], zero=chart.y_zero)
    outer = axis_limits(_band_edges(curves), zero=chart.y_zero)
    # A flat line has no range of its own: the median width of its band is shown at least.
    widths = [float(np.median(_upright_stderr(item))) for item in curves]
    margin = max(_BEYOND * (inner[1] - inner[0]), *widths)
    low_y, high_y = max(outer[0], inner[0] - margin), min(outer[1], inner[1] + margin)
    if chart.x_zero:
        low_x = max(low_x, 0.0)
    if chart.y_zero:
        low_y = max(low_y, 0.0)
    return (low_x, high_x), (low_y, high_y)


def _all_curves(chart: Chart) -> list[ChartLine | FlightPoints]:
    """Return all lines, and the points that are not empty."""
    return [*_all_lines(chart), *(item for item in _all_points(chart) if len(item.x))]


def _upright_stderr(item: ChartLine | FlightPoints) -> np.ndarray:
    """Return the standard error in the ordinate; that of a horizontal band is zero."""
    return item.stderr * (not getattr(item, "is_across", False))


def _band_edges(curves: Sequence[ChartLine | FlightPoints]) -> list[np.ndarray]:
    """Return the ends of all bands and bars in the ordinate."""
    edges = []
    for item in curves:
        stderr = _upright_stderr(item)
        edges += [item.y - stderr, item.y + stderr]
    return edges


def _is_cut(chart: Chart) -> bool:
    """Return whether a band or bar ends beyond the axes."""
    _, (low, high) = _chart_limits(chart)
    edges = np.concatenate([np.zeros(0), *map(np.ravel, _band_edges(_all_curves(chart)))])
    return bool(((edges < low) | (edges > high)).any())
