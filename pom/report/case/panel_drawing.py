"""Parts of the drawing of a panel, common to the page and to the PDF.

Every function returns SVG elements inside the frame that it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.support.figures import (
    Frame,
    clip_to_frame,
    draw_area,
    draw_arrow,
    draw_axes,
    draw_curve,
    draw_line,
    draw_text,
)
from pom.report.case.panels import CasePanel
from pom.report.presentation.quantities import format_number

# Height of the lane of one run in the bars of the exits, above the time axis. [unit]
LANE = 4.0
# End of the scale of the residual strip, in half widths of the band.
RESIDUAL = 1.6


@dataclass(frozen=True)
class StripStyle:
    """Style of the residual strip in one medium.

    Attributes
    ----------
    y_ticks : tuple of float
        Ticks in half widths of the band.
    x_most : int
        Greatest number of ticks of the time.
    label_x : float
        Left edge of the label ``e/t``. [unit]
    marks_beyond : bool
        Mark residuals beyond the scale of the strip.
    """

    y_ticks: tuple[float, ...]
    x_most: int
    label_x: float
    marks_beyond: bool


def draw_residual_strip(
    frame: Frame,
    name: str,
    time: np.ndarray,
    panel: CasePanel,
    styles: Mapping[str, str],
    strip_style: StripStyle,
    with_time: bool,
) -> str:
    """Return the strip of residuals to the flight, in half widths of the band.

    Parameters
    ----------
    frame : Frame
        Its ordinate has half widths, from -`RESIDUAL` to `RESIDUAL`.
    name : str
        Identifier of the clipping path, unique in the document.
    time : array (time,)
        Clock of the record. [s]
    panel : CasePanel
        Panel with a band.
    styles : mapping of str to str
        Run to the class of its line.
    strip_style : StripStyle
    with_time : bool
        Print the labels of the time axis.
    """
    if panel.half is None:
        return ""
    middle = frame.top + frame.height / 2
    x_most, y_ticks = strip_style.x_most, strip_style.y_ticks
    # 3.5 is half of the height of the letters.
    parts = [
        draw_axes(frame, x_labels=with_time, x_most=x_most, y_ticks=y_ticks),
        draw_text(strip_style.label_x, middle + 3.5, "e/t", "caption"),
    ]
    band = np.where(np.isfinite(panel.half), 1.0, np.nan)
    body = draw_area(frame, time, -band, band, "band")
    flight = panel.traces["flight"]
    for run, values in panel.traces.items():
        if run == "flight":
            continue
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(panel.half > 0, (values - flight) / panel.half, np.nan)
        body += draw_curve(frame, time, ratio, f"trace {styles[run]}")
        if strip_style.marks_beyond:
            parts.append(_mark_beyond_scale(frame, time, ratio, styles[run], with_value=False))
    return "".join(parts) + clip_to_frame(frame, name, body)


def draw_tolerance(
    frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]
) -> str:
    """Return the band around the flight, the exits of the models, and the quantiles of draws."""
    parts, flight = [], panel.traces.get("flight")
    if panel.half is not None and flight is not None:
        low, high = flight - panel.half, flight + panel.half
        parts.append(draw_area(frame, time, low, high, "band"))
        for run, values in panel.traces.items():
            if panel.exits.get(run):
                parts.append(_exceedance_area(frame, time, values=values, low=low, high=high))
    for run, quantiles in panel.fans.items():
        parts.append(_quantile_areas(frame, time, quantiles, styles[run]))
    return "".join(parts)


def draw_window_and_traces(
    frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]
) -> str:
    """Return the edges of the window and the traces of all runs."""
    parts = []
    for instant in panel.window or ():
        x = float(frame.px(instant))
        parts.append(draw_line(x, frame.top, x, frame.bottom, "window"))
    for run, values in panel.traces.items():
        parts.append(draw_curve(frame, time, values, f"trace {styles[run]}"))
    return "".join(parts)


def _quantile_areas(frame: Frame, time: np.ndarray, quantiles: np.ndarray, css: str) -> str:
    """Return nested areas between the quantiles (quantile, time) of the draws of a run."""
    # The outermost pair is first: lowest and highest quantile, then the next ones inside.
    parts = []
    for low, high in zip(quantiles[: len(quantiles) // 2], quantiles[::-1], strict=False):
        parts.append(draw_area(frame, time, low, high, f"fan {css}-area"))
    return "".join(parts)


def _exceedance_area(
    frame: Frame, time: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray
) -> str:
    """Return the hatched area between a trace and the edges of the band that it exceeds."""
    # Samples without a value compare as inside.
    with np.errstate(invalid="ignore"):
        is_above, is_below = values > high, values < low
    above, below = np.where(is_above, values, high), np.where(is_below, values, low)
    shapes = ""
    for edge, trace, outside in ((high, above, is_above), (below, low, is_below)):
        # One sample more at each side completes the area at the crossing.
        wide = outside | np.roll(outside, 1) | np.roll(outside, -1)
        lower, upper = np.where(wide, edge, np.nan), np.where(wide, trace, np.nan)
        shapes += draw_area(frame, time, lower, upper, "exit")
    return shapes


def draw_exit_bars(
    frame: Frame, exits: Mapping[str, Sequence[tuple[float, float]]], styles: Mapping[str, str]
) -> str:
    """Return bars along the time axis where runs are outside of the band.

    Each run with an exit has a lane.  A mark shows its first exit.
    """
    parts, lane = [], 0
    for run, spans in exits.items():
        if not spans:
            continue
        y = frame.bottom - 2.5 - LANE * lane
        for start, stop in spans:
            left, right = float(frame.px(start)), float(frame.px(stop))
            # The bar of a single sample is visible too.
            parts.append(draw_line(left, y, max(right, left + 1.0), y, f"lane {styles[run]}"))
        x = float(frame.px(spans[0][0]))
        parts.append(draw_line(x, frame.bottom - 9 - LANE * lane, x, frame.bottom + 4, "tickmark"))
        lane += 1
    return "".join(parts)


def mark_models_beyond_scale(
    frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]
) -> str:
    """Return the marks of models whose values leave the scale of the frame."""
    # The marks stay clear of the lanes of the exits at the bottom.
    lanes = LANE * sum(map(bool, panel.exits.values()))
    clear = replace(frame, height=frame.height - lanes)
    marks = []
    for run, values in panel.traces.items():
        if run != "flight":
            marks.append(_mark_beyond_scale(clear, time, values, styles[run]))
    return "".join(marks)


def _mark_beyond_scale(
    frame: Frame, time: np.ndarray, values: np.ndarray, css: str, with_value: bool = True
) -> str:
    """Return an arrow, and the extreme value, where a trace leaves the scale of the frame."""
    if not np.isfinite(values).any():
        return ""
    parts = []
    highest, lowest = int(np.nanargmax(values)), int(np.nanargmin(values))
    if values[highest] > frame.y[1]:
        parts.append(_mark_extreme(frame, time[highest], values[highest], css, True, with_value))
    if values[lowest] < frame.y[0]:
        parts.append(_mark_extreme(frame, time[lowest], values[lowest], css, False, with_value))
    return "".join(parts)


def _mark_extreme(
    frame: Frame, instant: float, value: float, css: str, upward: bool, with_value: bool
) -> str:
    """Return the mark of one extreme value beyond the upper or the lower edge of the frame."""
    x = float(np.clip(frame.px(instant), frame.left + 6, frame.right - 6))
    arrow = draw_arrow(x, frame, upward, css)
    if not with_value:
        return arrow
    y = frame.top + 9 if upward else frame.bottom - 3
    # The value is at the side of the arrow that has more room.
    anchor, shift = "start", 7
    if x > frame.left + frame.width / 2:
        anchor, shift = "end", -7
    return arrow + draw_text(x + shift, y, format_number(value), "tick halo", anchor)
