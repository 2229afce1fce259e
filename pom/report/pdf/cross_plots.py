"""Cross plots of a case for paper: one quantity over another, flight and models."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_axes,
    draw_text,
    text_pieces,
)
from pom.report.case.panels import Cross
from pom.report.pdf.style import (
    HEAD,
    LEFT,
    RIGHT,
    Drawing,
    label_text,
    svg_drawing,
    title_pieces,
)
from pom.report.presentation.quantities import fixed_decimals
from pom.report.presentation.verdict_text import criterion_words

HEIGHT, CROSS_PLOT_FOOT = 230.0, 30.0
MARGIN = 0.05  # of the range, beyond the extreme values
_RESOLUTION = 0.5  # points nearer than this to the last one are not drawn, in units


def cross_drawing(
    name: str, cross: Cross, styles: Mapping[str, str], rows: Sequence[Mapping[Hashable, Any]]
) -> Drawing:
    """Return a cross plot.

    Parameters
    ----------
    name : str
        Identifier of the clipping path, unique in the document.
    cross : Cross
        Quantities of the plot.
    styles : mapping of str to str
        Run to the class of its line.
    rows : sequence of mapping
        Verdict rows of the case, for the alternative text.
    """
    flight_x, flight_y = cross.x["flight"], cross.y["flight"]
    half = np.where(np.isfinite(cross.half), cross.half, 0.0)
    low, high = flight_y - half, flight_y + half
    x_limits = _find_limits(cross.x.values())
    y_limits = _find_limits([*cross.y.values(), low, high])
    frame = Frame(LEFT, HEAD, WIDTH - LEFT - RIGHT, height=HEIGHT, x=x_limits, y=y_limits)

    body = ""
    if half.any():
        # The band is one closed outline: its upper edge forwards, its lower edge backwards.
        outline_x = np.append(flight_x, flight_x[::-1])
        outline_y = np.append(high, low[::-1])
        body += _draw_path(frame, outline_x, y=outline_y, css="band", end="z")
    for run in cross.x:
        body += _draw_path(frame, cross.x[run], y=cross.y[run], css=f"trace {styles[run]}")
    # A hair line of the flight lies above all, so that no model hides it.
    body += _draw_path(frame, flight_x, y=flight_y, css="hair")
    middle, bottom = LEFT + frame.width / 2, frame.bottom + 24.0
    parts = [
        text_pieces(LEFT, HEAD - 4.0, title_pieces(cross.ordinate)),
        draw_axes(frame, x_labels=True, x_most=10),
        clip_to_frame(frame, name, body),
        draw_text(middle, bottom, label_text(cross.abscissa), "caption", "middle"),
    ]
    sentences = [cross.words]
    for row in rows:
        if row["criterion"] in cross.criteria:
            sentences.append(
                f"{row['run']}: {criterion_words(row['criterion'])} "
                f"{row['verdict'].replace('_', ' ')}, "
                f"{fixed_decimals(row['worst_ratio'], 2)} of the tolerance"
            )
    height = frame.bottom + CROSS_PLOT_FOOT
    return Drawing(svg_drawing(height, "".join(parts)), height, ". ".join(sentences))


def _find_limits(values: Iterable[np.ndarray]) -> tuple[float, float]:
    """Return limits with a margin around all finite values."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = 0.0, 1.0
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
    # A constant gets a margin relative to its value.
    margin = MARGIN * ((high - low) or max(abs(high), 1.0))
    return low - margin, high + margin


def _draw_path(frame: Frame, x: np.ndarray, y: np.ndarray, css: str, end: str = "") -> str:
    """Return a line through points whose abscissa may turn back."""
    finite = np.isfinite(x) & np.isfinite(y)
    px, py = frame.px(x[finite]), frame.py(y[finite])
    points: list[tuple[float, float]] = []
    for point in zip(px.tolist(), py.tolist(), strict=True):
        if points:
            last_x, last_y = points[-1]
            if not abs(point[0] - last_x) + abs(point[1] - last_y) > _RESOLUTION:
                continue
        points.append(point)
    if not points:
        return ""
    steps = " ".join([f"{a:.1f},{b:.1f}" for a, b in points])
    return f'<path class="{css}" d="M{steps}{end}"/>'
