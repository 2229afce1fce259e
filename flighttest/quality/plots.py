"""Small time histories, and points with a line, for the pages of this package: the SVG writer with one size and one look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from flightmech.support.svg_chart import Frame, axes, curve, dots, limits, line, rect, svg, text, thinned

WIDTH, HEIGHT = 560, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 22, 22
_MARGIN = 0.05  # of the range, above and below the values
_SLACK = 0.2  # what thinning may move a line: noise of half a line's width is seen


def chart(
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
        In the unit to be shown; the first is drawn on top.  Long ones keep smallest and largest value of each of 420 parts.
    units : str
        Shown at the axis.
    shaded, flagged : sequence of (float, float)
        Spans in grey and in red. [s]
    label : str
        Text for screen readers.
    """
    frame = _frame(limits(time), limits(np.concatenate(lines), _MARGIN))
    parts = [_span(frame, *span, "ground", 0.0) for span in shaded] + [_span(frame, *span, "fault", 2.0) for span in flagged]
    parts.append(axes(frame, x_labels=True, x_most=6))
    for values, style in reversed(list(zip(lines, ("one", "two"), strict=False))):
        kept = thinned(values)
        parts.append(curve(frame, time[kept], values[kept], style, _SLACK))
    return _figure(parts, units, "over time [s]", label)


def scatter(x: np.ndarray, y: np.ndarray, straight: tuple[float, float], names: tuple[str, str], label: str = "") -> Markup:
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
    frame = _frame(limits(x, _MARGIN), limits(np.append(y, fitted), _MARGIN))
    first, last = np.argmin(x), np.argmax(x)
    (x1, x2), (y1, y2) = (values[[first, last]].tolist() for values in (frame.px(x), frame.py(fitted)))
    parts = [axes(frame, x_labels=True, x_most=6), line(x1, y1, x2, y2, "two"), dots(frame, x, y, "dot")]
    return _figure(parts, names[1], f"over {names[0]}", label)


def _frame(x: tuple[float, float], y: tuple[float, float]) -> Frame:
    return Frame(_LEFT, _TOP, WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM, x, y)


def _figure(parts: Sequence[str], vertical: str, horizontal: str, label: str) -> Markup:
    """Return the figure with the names of its axes above it."""
    names = [text(4.0, 11.0, vertical), text(WIDTH - _RIGHT, 11.0, horizontal, anchor="end")]
    return Markup(svg(HEIGHT, "".join([*parts, *names]), label, WIDTH))  # every text in it is escaped


def _span(frame: Frame, start: float, stop: float, style: str, least: float) -> str:
    left, right = (float(np.clip(frame.px(t), frame.left, frame.right)) for t in (start, stop))
    return rect(left, frame.top, max(right - left, least), frame.height, style)
