"""Parts of the drawing of a panel, common to the page and to the PDF.

Every function returns SVG elements inside the frame that it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flightmech.support.figures import (
    Frame,
    clip_to_frame,
    draw_area,
    draw_arrow,
    draw_axes,
    draw_curve,
    draw_line,
    draw_rectangle,
    draw_text,
)
from pom.report.case.panel_marks import JudgedValue, ModeMark
from pom.report.case.panels import CasePanel
from pom.report.presentation.quantities import format_number

# Height of the lane of one run in the bars of the exits, above the time axis. [unit]
LANE = 4.0
# Half of the least width of the bar of a judged value, and height of the line of a period above the
# lower edge of the frame. [unit]
LEAST_BAR, MODE_LINE = 5.0, 10.0
# Height of a line of text, and width of a character, of the numbers at the edges. [unit]
_LINE, _CHARACTER = 10.5, 5.6
_MOST_LINES = 8
Box = tuple[float, float, float, float]
"""Left, upper, right and lower edge of a text. [unit]"""
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
    gap : float
        Between the panel and the strip. [unit]
    marks_beyond : bool
        Mark residuals beyond the scale of the strip.
    """

    y_ticks: tuple[float, ...]
    x_most: int
    label_x: float
    gap: float
    marks_beyond: bool


def draw_residuals_below(
    frame: Frame,
    name: str,
    time: np.ndarray,
    panel: CasePanel,
    styles: Mapping[str, str],
    strip_style: StripStyle,
    height: float,
    with_time: bool,
) -> tuple[str, float]:
    """Return bars of the exits and the strip of residuals below a panel, and its lower edge.

    Parameters
    ----------
    frame : Frame
        Frame of the panel.
    name, time, panel, styles, strip_style, with_time
        As in `_draw_residual_strip`.
    height : float
        Height of the strip.
    """
    if panel.half is None:
        return "", frame.bottom
    top = frame.bottom + strip_style.gap
    strip = Frame(frame.left, top, frame.width, height=height, x=frame.x, y=(-RESIDUAL, RESIDUAL))
    exits = _draw_exit_bars(frame, panel.exits, styles)
    residuals = _draw_residual_strip(
        strip,
        f"{name}-e",
        time=time,
        panel=panel,
        styles=styles,
        strip_style=strip_style,
        with_time=with_time,
    )
    return exits + residuals, strip.bottom


def _draw_residual_strip(
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
            for extreme in _extremes_beyond_scale(frame, time, ratio):
                parts.append(draw_arrow(extreme.x, frame, extreme.upward, styles[run]))
    return "".join(parts) + clip_to_frame(frame, name, body)


def draw_tolerance(
    frame: Frame, time: np.ndarray, panel: CasePanel, styles: Mapping[str, str]
) -> str:
    """Return the band around the flight, the exits of the models, and the quantiles of draws."""
    parts, flight = [], panel.traces.get("flight")
    for mark in panel.values:
        parts.append(_draw_judged_value(frame, mark))
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
    # A hair line of the flight on top, so that no model hides it.
    flight = panel.traces.get("flight")
    if flight is not None and len(panel.traces) > 1:
        parts.append(draw_curve(frame, time, flight, "hair"))
    if panel.mode is not None:
        parts.append(_draw_mode(frame, time, panel.mode))
    return "".join(parts)


def _draw_judged_value(frame: Frame, mark: JudgedValue) -> str:
    """Return the bar of the tolerance around a judged value of the flight."""
    left, right = float(frame.px(mark.start)), float(frame.px(mark.stop))
    left, right = min(left, right - LEAST_BAR), max(right, left + LEAST_BAR)
    top, bottom = frame.py(mark.centre + mark.half), frame.py(mark.centre - mark.half)
    return draw_rectangle(left, float(top), right - left, float(bottom - top), "band")


def _draw_mode(frame: Frame, time: np.ndarray, mode: ModeMark) -> str:
    """Return the envelope of the fitted mode, one period between two maxima, and its numbers."""
    parts = []
    for edge in mode.envelope(time):
        parts.append(draw_curve(frame, time, edge, "envelope"))
    x, text_y = _mode_text_place(frame, mode)
    y = frame.bottom - MODE_LINE
    if mode.peaks:
        first, second = (float(frame.px(instant)) for instant in mode.peaks)
        parts.append(draw_line(first, y, second, y, "event"))
        for end in (first, second):
            parts.append(draw_line(end, y - 4, end, y + 4, "event"))
    parts.append(draw_text(x, text_y, mode.words, "tick halo"))
    return "".join(parts)


def _mode_text_place(frame: Frame, mode: ModeMark) -> tuple[float, float]:
    """Return left edge and base line of the numbers of a mode.

    They are at the right of the line of the period, or above it if they have no room there.
    """
    y = frame.bottom - MODE_LINE
    if not mode.peaks:
        return float(frame.px(mode.start)) + 4, y + 3.5
    first, second = (float(frame.px(instant)) for instant in mode.peaks)
    if second + 5 + _CHARACTER * len(mode.words) > frame.right:
        return first + 5, y - 5
    return second + 5, y + 3.5


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


def _draw_exit_bars(
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
    frame: Frame,
    time: np.ndarray,
    panel: CasePanel,
    styles: Mapping[str, str],
    names: Sequence[Box] = (),
) -> str:
    """Return the marks of models whose values leave the scale of the frame.

    `names` holds the boxes of texts that stand in the frame already.
    """
    # The marks stay clear of the lanes of the exits at the bottom.
    lanes = LANE * sum(map(bool, panel.exits.values()))
    clear = replace(frame, height=frame.height - lanes)
    marks, taken = [], list(names)
    if panel.mode is not None:
        x, y = _mode_text_place(frame, panel.mode)
        clear_line(x, y, panel.mode.words, "start", inward=0.0, taken=taken)
    extremes = []
    for run, values in panel.traces.items():
        if run != "flight":
            for extreme in _extremes_beyond_scale(clear, time, values):
                extremes.append((extreme, styles[run]))
    # All arrows come before the numbers, which keep clear of them.
    for extreme, css in extremes:
        marks.append(draw_arrow(extreme.x, clear, extreme.upward, css))
        taken.append(_arrow_box(clear, extreme))
    for extreme, _ in extremes:
        marks.append(_draw_extreme(clear, extreme, taken))
    return "".join(marks)


class _Extreme(NamedTuple):
    """Extreme value of a trace beyond the upper or the lower edge of a frame."""

    x: float
    value: float
    upward: bool


def _extremes_beyond_scale(frame: Frame, time: np.ndarray, values: np.ndarray) -> list[_Extreme]:
    """Return the extreme values of a trace that leave the scale of the frame."""
    if not np.isfinite(values).any():
        return []
    extremes = []
    highest, lowest = int(np.nanargmax(values)), int(np.nanargmin(values))
    if values[highest] > frame.y[1]:
        extremes.append(_Extreme(_arrow_place(frame, time[highest]), values[highest], True))
    if values[lowest] < frame.y[0]:
        extremes.append(_Extreme(_arrow_place(frame, time[lowest]), values[lowest], False))
    return extremes


def _arrow_place(frame: Frame, instant: float) -> float:
    return float(np.clip(frame.px(instant), frame.left + 6, frame.right - 6))


def _base_line(frame: Frame, upward: bool) -> float:
    return frame.top + 9 if upward else frame.bottom - 3


def _arrow_box(frame: Frame, extreme: _Extreme) -> Box:
    y = _base_line(frame, extreme.upward)
    return (extreme.x - 4.0, y - _LINE + 1.0, extreme.x + 4.0, y + 1.0)


def _draw_extreme(frame: Frame, extreme: _Extreme, taken: list[Box]) -> str:
    """Return the number of an extreme value, clear of the boxes `taken`."""
    # The value is at the side of the arrow that has more room.
    anchor, shift = "start", 7
    if extreme.x > frame.left + frame.width / 2:
        anchor, shift = "end", -7
    x, text = extreme.x + shift, format_number(extreme.value)
    y, inward = _base_line(frame, extreme.upward), _LINE if extreme.upward else -_LINE
    y = clear_line(x, y, text, anchor, inward=inward, taken=taken)
    return draw_text(x, y, text, "tick halo", anchor)


def clear_line(
    x: float, y: float, text: str, anchor: str, inward: float, taken: list[Box]
) -> float:
    """Return the base line of a text that meets no earlier one, and append its box to `taken`.

    The text moves by `inward` until it is clear.  In a frame full of numbers the last line counts.
    """
    width = _CHARACTER * len(text)
    left = x - width if anchor == "end" else x
    for _ in range(_MOST_LINES):
        box = (left, y - _LINE + 1.0, left + width, y + 1.0)
        if not any(_is_overlap(box, other) for other in taken):
            break
        y += inward
    taken.append(box)
    return y


def _is_overlap(one: Box, other: Box) -> bool:
    is_clear_across = one[2] < other[0] or other[2] < one[0]
    is_clear_up = one[3] <= other[1] or other[3] <= one[1]
    return not is_clear_across and not is_clear_up
