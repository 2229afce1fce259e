"""The quality of a record as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import ChoiceLoader, PackageLoader, Template
from markupsafe import Markup

from flightmech.names import lookup
from flightmech.support.arrays import thin_to_extremes, true_runs
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

WIDTH, HEIGHT = 560, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 22, 22
_MARGIN = 0.05  # of the range, above and below the values
_SLACK = 0.2  # what thinning may move a line: noise of half a line's width is seen


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
        In the unit to be shown; the first is drawn on top.  Long ones keep smallest and largest
        value of each of 420 parts.
    units : str
        Shown at the axis.
    shaded, flagged : sequence of (float, float)
        Spans in grey and in red. [s]
    label : str
        Text for screen readers.
    """
    frame = _frame(find_axis_limits(time), find_axis_limits(np.concatenate(lines), _MARGIN))
    parts = [_span(frame, *span, "ground", 0.0) for span in shaded] + [
        _span(frame, *span, "fault", 2.0) for span in flagged
    ]
    parts.append(draw_axes(frame, x_labels=True, x_most=6))
    for values, style in reversed(list(zip(lines, ("one", "two"), strict=False))):
        kept = thin_to_extremes(values)
        parts.append(draw_curve(frame, time[kept], values[kept], style, _SLACK))
    return _figure(parts, units, "over time [s]", label)


def draw_scatter_chart(
    x: np.ndarray,
    y: np.ndarray,
    straight: tuple[float, float],
    names: tuple[str, str],
    label: str = "",
) -> Markup:
    """Return points and a straight line.

    Parameters
    ----------
    x, y : array (point,)
        In the units to be shown.
    straight : (float, float)
        Offset and slope of the line.
    names : (str, str)
        Of the axes, with their units.
    label : str
        Text for screen readers.
    """
    fitted = straight[0] + straight[1] * x
    frame = _frame(find_axis_limits(x, _MARGIN), find_axis_limits(np.append(y, fitted), _MARGIN))
    first, last = np.argmin(x), np.argmax(x)
    (x1, x2), (y1, y2) = (
        values[[first, last]].tolist() for values in (frame.px(x), frame.py(fitted))
    )
    parts = [
        draw_axes(frame, x_labels=True, x_most=6),
        draw_line(x1, y1, x2, y2, "two"),
        draw_dots(frame, x, y, "dot"),
    ]
    return _figure(parts, names[1], f"over {names[0]}", label)


def _frame(x: tuple[float, float], y: tuple[float, float]) -> Frame:
    return Frame(_LEFT, _TOP, WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM, x, y)


def _figure(parts: Sequence[str], vertical: str, horizontal: str, label: str) -> Markup:
    """Return the figure with the names of its axes above it."""
    names = [
        draw_text(4.0, 11.0, vertical),
        draw_text(WIDTH - _RIGHT, 11.0, horizontal, anchor="end"),
    ]
    return Markup(
        make_svg_figure(HEIGHT, "".join([*parts, *names]), label, WIDTH)
    )  # every text in it is escaped


def _span(frame: Frame, start: float, stop: float, style: str, least: float) -> str:
    left, right = (float(np.clip(frame.px(t), frame.left, frame.right)) for t in (start, stop))
    return draw_rectangle(left, frame.top, max(right - left, least), frame.height, style)


_HISTORIES = (
    "h_baro", "V", "alpha_vane", "beta_vane", "phi", "theta", "psi", "p", "q", "r", "ax_imu", "ay_imu", "az_imu",
    "delta_e", "delta_a", "delta_r", "engine1.throttle", "engine1.n1",
)  # fmt: skip
_HERE = "flighttest.reconstruction.quality"
_MINUTE = 60.0  # s
_MISTAKES = ("sign", "unit", "axis", "definition")
_AIR_DATA = (
    "airspeed",
    "mach",
    "mach_pressure",
    "calibrated",
    "altitude",
)  # exact: the table states it all unless they disagree


def template_of(package: str) -> Template:
    """Return the template ``page.html`` of a package; the frame around it is the same for all."""
    return make_template_environment(
        ChoiceLoader([PackageLoader(package, ""), PackageLoader(_HERE, "")])
    ).get_template("page.html")


def read_style_sheet() -> Markup:
    """Return the style sheet of the pages of this package."""
    return Markup(files(_HERE).joinpath("style.css").read_text(encoding="utf-8"))  # our own file


def write_page(quality: Quality, path: str | Path) -> None:
    """Write the quality of a record as one self-contained HTML page; an error leaves no file."""
    write_text(path, render_quality_page(quality))


def render_quality_page(quality: Quality) -> str:
    """Return the page as text."""
    template = template_of("flighttest.reconstruction.quality")
    grade = "error" if not quality.usable else "warning" if quality.count("warning") else "good"
    return template.render(
        style=read_style_sheet(),
        facts=quality.facts,
        verdict=quality.verdict,
        grade=grade,
        findings=quality.findings,
        mistakes=any(finding.kind in _MISTAKES for finding in quality.findings),
        histories=[_history(quality, name) for name in _HISTORIES if name in quality.signals],
        kinematics=[_kinematic(row) for row in quality.kinematics.to_dict("records")],
        as_read=[_comparison(quality.as_read[name]) for name in _broken(quality)],
        comparisons=[
            _comparison(c) for name, c in quality.comparisons.items() if _worth_seeing(name, c)
        ],
        not_checked=quality.not_checked.to_dict("records"),
        delays=quality.delays.to_dict("records"),
        answers=[_answer(row) for row in quality.answers.to_dict("records")],
        excitation=[_excited(row) for row in quality.excitation.to_dict("records")],
        correlation=_matrix(quality),
        channels=[_channel(row) for row in quality.channels.to_dict("records")],
    )


def _history(quality: Quality, name: str) -> dict[str, Any]:
    signals, row = quality.signals, lookup(name)
    spans = [
        (f.start, f.stop)
        for f in quality.findings
        if name in f.channels and f.start is not None and f.stop is not None
    ]
    faulty = _spans(signals.time, ~signals.good[name])
    x = from_si(
        np.where(signals.good[name] | (signals[name] != 0.0), signals[name], np.nan),
        row.display_units,
    )
    picture = draw_time_chart(
        signals.time,
        [x],
        row.display_units,
        _spans(signals.time, ~signals.flying),
        [*spans, *faulty],
        f"{name} over time",
    )
    return {"title": f"{name}: {row.long_name}", "svg": picture}


def _worth_seeing(name: str, c: RelationCheck) -> bool:
    return not c.consistent or (name not in _AIR_DATA and is_meaningful(c.moving, c.correlation))


def _broken(quality: Quality) -> list[str]:
    """Return the relations that did not hold as read, the worst first, at most four."""
    broken = [name for name, c in quality.as_read.items() if not c.consistent]
    return sorted(broken, key=lambda name: -quality.as_read[name].disagreement)[:4]


def _comparison(c: RelationCheck) -> dict[str, Any]:
    """Both sides over the minute in which they move most."""
    units = {"rad": "deg", "rad s-1": "deg/s"}.get(c.relation.units, c.relation.units)
    step = c.time[1] - c.time[0]
    width = min(round(_MINUTE / step), len(c.time))
    y = np.where(
        c.mask,
        np.abs(c.second - c.second[c.mask].mean()) + np.abs(c.first - c.first[c.mask].mean()),
        0.0,
    )
    energy = np.convolve(y**2, np.ones(width), mode="valid")
    first = int(np.argmax(energy))
    window = slice(first, first + width)
    lines = [from_si(np.where(c.mask, side, np.nan)[window], units) for side in (c.first, c.second)]
    return {
        "title": c.relation.title,
        "svg": draw_time_chart(c.time[window], lines, units, label=c.relation.title),
    }


def _kinematic(row) -> dict[str, Any]:
    texts = {
        f"{name}_text": format_display_value(row[name], row["units"]) for name in ("offset", "rms")
    }
    return {**row, **texts, "meaningful": is_meaningful(row["moving"], row["correlation"])}


def _answer(row) -> dict[str, Any]:
    significant = abs(row["ratio"]) >= SIGNIFICANT
    right = (
        "as it should be"
        if row["effect"] < 0.0
        else "wrong"
        if row["sign"] > 0
        else "wrong, or another time"
    )
    return {**row, "answer": right if significant else "not seen"}


def _excited(row) -> dict[str, Any]:
    return {
        **row,
        "input_deg": np.degrees(row["input"]),
        "response_deg": np.degrees(row["response"]),
    }


def _matrix(quality: Quality) -> dict[str, Any] | None:
    if quality.correlation.empty:
        return None
    names = [str(name) for name in quality.correlation.columns]
    rows = [
        {"name": name, "values": values}
        for name, values in zip(names, quality.correlation.to_numpy().tolist())
    ]
    return {"names": names, "rows": rows}


def _channel(row) -> dict[str, Any]:
    display = lookup(row["channel"]).display_units
    spread = {"degC": "K"}.get(display, display)

    def text(value: float, units: str) -> str:
        return f"{from_si(value, units):.4g}" if np.isfinite(value) else ""

    detail = {
        "low": text(row["minimum"], display),
        "high": text(row["maximum"], display),
        "noise_text": text(row["noise"], spread),
    }
    return {**row, **detail, "display": display}


def _spans(time: np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    return [(float(time[a]), float(time[b - 1])) for a, b in true_runs(mask)]
