"""The quality of a record as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import ChoiceLoader, PackageLoader, Template
from markupsafe import Markup

from flightmech.names import lookup
from flightmech.support.arrays import thin_to_extremes, true_spans
from flightmech.support.atomic_write import write_text
from flightmech.support.figures import (
    Frame,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_rectangle,
    draw_text,
    find_axis_limits,
    make_svg_figure,
    make_template_environment,
)
from flightmech.units import from_si
from flighttest.reconstruction.quality.checks.control_response import SIGNIFICANT
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.result import Quality, format_display_value, is_meaningful

# Size of a chart and the margins of its axes, in pixels.
WIDTH, HEIGHT = 560, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 22, 22
_MARGIN = 0.05  # of the range, above and below the values
# Largest error of a thinned line, in pixels. Noise of half the width of a line is visible.
_SLACK = 0.2
_FAULT_WIDTH = 2.0  # pixels of a fault at least, so that short faults are visible
_MOST_LABELS = 6
_MOST_BROKEN = 4  # relations in the section on the record as read
_HISTORIES = (
    "h_baro",
    "V",
    "alpha_vane",
    "beta_vane",
    "phi",
    "theta",
    "psi",
    "p",
    "q",
    "r",
    "ax_imu",
    "ay_imu",
    "az_imu",
    "delta_e",
    "delta_a",
    "delta_r",
    "engine1.throttle",
    "engine1.n1",
)
_PACKAGE = "flighttest.reconstruction.quality"
_MINUTE = 60.0  # s
_MISTAKES = ("sign", "unit", "axis", "definition")
# Exact relations. The table suffices unless their two sides disagree.
_AIR_DATA = ("airspeed", "mach", "mach_pressure", "calibrated", "altitude")


def draw_time_chart(
    time: np.ndarray,
    lines: Sequence[np.ndarray],
    units: str,
    shaded: Sequence[tuple[float, float]] = (),
    flagged: Sequence[tuple[float, float]] = (),
    label: str = "",
) -> Markup:
    """Return a chart of one or two lines over time.

    Parameters
    ----------
    time : array (time,)
        [s]
    lines : sequence of array (time,)
        Values in the unit of the axis. The first line is on top. Long lines are thinned to the
        smallest and largest value of each of 420 parts.
    units : str
        Unit at the axis.
    shaded, flagged : sequence of (float, float)
        Intervals in grey and in red. [s]
    label : str
        Text for screen readers.
    """
    frame = _make_frame(find_axis_limits(time), find_axis_limits(np.concatenate(lines), _MARGIN))
    parts = []
    for start, stop in shaded:
        parts.append(_draw_interval(frame, start, stop, style="ground", least=0.0))
    for start, stop in flagged:
        parts.append(_draw_interval(frame, start, stop, style="fault", least=_FAULT_WIDTH))
    parts.append(draw_axes(frame, x_labels=True, x_most=_MOST_LABELS))
    # A later part covers the parts before it.
    for values, style in reversed(list(zip(lines, ("one", "two"), strict=False))):
        samples = thin_to_extremes(values)
        parts.append(draw_curve(frame, time[samples], values[samples], style, _SLACK))
    return _make_figure(parts, units, horizontal="over time [s]", label=label)


def draw_scatter_chart(
    x: np.ndarray,
    y: np.ndarray,
    straight: tuple[float, float],
    names: tuple[str, str],
    label: str = "",
) -> Markup:
    """Return a chart of points and a straight line.

    Parameters
    ----------
    x, y : array (point,)
        Coordinates in the units of the axes.
    straight : (float, float)
        Offset and slope of the line.
    names : (str, str)
        Names of the axes, with their units.
    label : str
        Text for screen readers.
    """
    offset, slope = straight
    fitted = offset + slope * x
    y_limits = find_axis_limits(np.append(y, fitted), _MARGIN)
    frame = _make_frame(find_axis_limits(x, _MARGIN), y_limits)
    # the line between the points at both ends
    ends = [np.argmin(x), np.argmax(x)]
    x1, x2 = frame.px(x)[ends].tolist()
    y1, y2 = frame.py(fitted)[ends].tolist()
    parts = [
        draw_axes(frame, x_labels=True, x_most=_MOST_LABELS),
        draw_line(x1, y1, x2, y2, "two"),
        draw_dots(frame, x, y, "dot"),
    ]
    return _make_figure(parts, names[1], horizontal=f"over {names[0]}", label=label)


def _make_frame(x: tuple[float, float], y: tuple[float, float]) -> Frame:
    return Frame(_LEFT, _TOP, WIDTH - _LEFT - _RIGHT, height=HEIGHT - _TOP - _BOTTOM, x=x, y=y)


def _make_figure(parts: Sequence[str], vertical: str, horizontal: str, label: str) -> Markup:
    """Return the figure with the names of its axes above it."""
    names = [
        draw_text(4.0, 11.0, vertical),
        draw_text(WIDTH - _RIGHT, 11.0, horizontal, anchor="end"),
    ]
    # Every text in the figure is escaped.
    return Markup(make_svg_figure(HEIGHT, "".join([*parts, *names]), label, WIDTH))


def _draw_interval(frame: Frame, start: float, stop: float, style: str, least: float) -> str:
    """Return a rectangle over an interval of time, at least `least` pixels wide."""
    x1 = float(np.clip(frame.px(start), frame.left, frame.right))
    x2 = float(np.clip(frame.px(stop), frame.left, frame.right))
    return draw_rectangle(x1, frame.top, max(x2 - x1, least), frame.height, style)


def template_of(package: str) -> Template:
    """Return the template ``page.html`` of a package; the frame around it is common."""
    loader = ChoiceLoader([PackageLoader(package, ""), PackageLoader(_PACKAGE, "")])
    return make_template_environment(loader).get_template("page.html")


def read_style_sheet() -> Markup:
    """Return the style sheet of the pages of this package."""
    # The style sheet is part of the package, so it is safe without escapes.
    return Markup(files(_PACKAGE).joinpath("style.css").read_text(encoding="utf-8"))


def write_page(quality: Quality, path: str | Path) -> None:
    """Write the quality of a record as one self-contained HTML page; an error leaves no file."""
    write_text(path, render_quality_page(quality))


def render_quality_page(quality: Quality) -> str:
    """Return the page as text."""
    template = template_of(_PACKAGE)
    return template.render(
        style=read_style_sheet(),
        facts=quality.facts,
        verdict=quality.verdict,
        grade=_grade(quality),
        findings=quality.findings,
        mistakes=any(finding.kind in _MISTAKES for finding in quality.findings),
        histories=[_history(quality, name) for name in _HISTORIES if name in quality.signals],
        kinematics=_table_rows(quality.kinematics, _kinematic_row),
        as_read=[_comparison(check) for check in _worst_checks(quality)],
        comparisons=[_comparison(check) for check in _informative_checks(quality)],
        not_checked=quality.not_checked.to_dict("records"),
        delays=quality.delays.to_dict("records"),
        answers=_table_rows(quality.answers, _answer_row),
        excitation=_table_rows(quality.excitation, _excitation_row),
        correlation=_correlation_matrix(quality),
        channels=_table_rows(quality.channels, _channel_row),
    )


def _grade(quality: Quality) -> str:
    """Return the class of the verdict in the style sheet."""
    if not quality.usable:
        return "error"
    if quality.count("warning"):
        return "warning"
    return "good"


def _table_rows(
    table: pd.DataFrame, make_row: Callable[[dict[Any, Any]], dict[str, Any]]
) -> list[dict[str, Any]]:
    return [make_row(row) for row in table.to_dict("records")]


def _history(quality: Quality, name: str) -> dict[str, Any]:
    """Return the chart of a channel over time, with its faults."""
    signals, row = quality.signals, lookup(name)
    faults = []
    for finding in quality.findings:
        if name in finding.channels and finding.start is not None and finding.stop is not None:
            faults.append((finding.start, finding.stop))
    faults += true_spans(signals.time, ~signals.good[name])
    # An invalid sample of exactly zero is a filler for a missing reading.
    is_reading = signals.good[name] | (signals[name] != 0.0)
    x = from_si(np.where(is_reading, signals[name], np.nan), row.display_units)
    chart = draw_time_chart(
        signals.time,
        [x],
        units=row.display_units,
        shaded=true_spans(signals.time, ~signals.flying),
        flagged=faults,
        label=f"{name} over time",
    )
    return {"title": f"{name}: {row.long_name}", "svg": chart}


def _informative_checks(quality: Quality) -> list[RelationCheck]:
    """Return the relations with a chart: inconsistent ones, and ones with enough motion."""
    checks = []
    for name, check in quality.comparisons.items():
        has_motion = name not in _AIR_DATA and is_meaningful(check.moving, check.correlation)
        if not check.consistent or has_motion:
            checks.append(check)
    return checks


def _worst_checks(quality: Quality) -> list[RelationCheck]:
    """Return the relations that disagree in the record as read, the worst first."""
    broken = [check for check in quality.as_read.values() if not check.consistent]
    broken.sort(key=lambda check: -check.disagreement)
    return broken[:_MOST_BROKEN]


def _comparison(check: RelationCheck) -> dict[str, Any]:
    """Return the chart of both sides of a relation over the minute with the most motion."""
    units = {"rad": "deg", "rad s-1": "deg/s"}.get(check.relation.units, check.relation.units)
    step = check.time[1] - check.time[0]
    width = min(round(_MINUTE / step), len(check.time))
    # motion: deviation of both sides from their means
    second = np.abs(check.second - check.second[check.mask].mean())
    first = np.abs(check.first - check.first[check.mask].mean())
    motion = np.where(check.mask, second + first, 0.0)
    energy = np.convolve(motion**2, np.ones(width), mode="valid")
    start = int(np.argmax(energy))
    window = slice(start, start + width)
    lines = []
    for side in (check.first, check.second):
        lines.append(from_si(np.where(check.mask, side, np.nan)[window], units))
    title = check.relation.title
    chart = draw_time_chart(check.time[window], lines, units=units, label=title)
    return {"title": title, "svg": chart}


def _kinematic_row(row: dict[Any, Any]) -> dict[str, Any]:
    return {
        **row,
        "offset_text": format_display_value(row["offset"], row["units"]),
        "rms_text": format_display_value(row["rms"], row["units"]),
        "meaningful": is_meaningful(row["moving"], row["correlation"]),
    }


def _answer_row(row: dict[Any, Any]) -> dict[str, Any]:
    return {**row, "answer": _answer_text(row)}


def _answer_text(row: dict[Any, Any]) -> str:
    """Return the verdict on the response to a surface. By convention all effects are negative."""
    if not abs(row["ratio"]) >= SIGNIFICANT:
        return "not seen"
    if row["effect"] < 0.0:
        return "as it should be"
    if row["sign"] > 0:
        return "wrong"
    return "wrong, or another time"


def _excitation_row(row: dict[Any, Any]) -> dict[str, Any]:
    return {
        **row,
        "input_deg": np.degrees(row["input"]),
        "response_deg": np.degrees(row["response"]),
    }


def _correlation_matrix(quality: Quality) -> dict[str, Any] | None:
    if quality.correlation.empty:
        return None
    names = [str(name) for name in quality.correlation.columns]
    rows = []
    for name, values in zip(names, quality.correlation.to_numpy().tolist(), strict=True):
        rows.append({"name": name, "values": values})
    return {"names": names, "rows": rows}


def _channel_row(row: dict[Any, Any]) -> dict[str, Any]:
    display = lookup(row["channel"]).display_units
    # The noise of a temperature is a difference of temperatures.
    difference = {"degC": "K"}.get(display, display)
    return {
        **row,
        "low": _finite_text(row["minimum"], display),
        "high": _finite_text(row["maximum"], display),
        "noise_text": _finite_text(row["noise"], difference),
        "display": display,
    }


def _finite_text(value: float, units: str) -> str:
    """Return an SI value in other units; empty for NaN."""
    if not np.isfinite(value):
        return ""
    return f"{from_si(value, units):.4g}"
