"""Cross plots for paper: one quantity against another, such as force against position, the band about the flight."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np

from flightmech.support.svg_chart import WIDTH, Frame, axes, clipped, spaced, text
from pom.report.case.cross_plots import Cross
from pom.report.presentation.quantities import Label, fixed
from pom.report.presentation.verdict_text import words

from .panels import HEAD, LEFT, RIGHT, Drawing, svg

HEIGHT, CROSS_PLOT_FOOT, MARGIN = 230.0, 30.0, 0.05


def cross_drawing(name: str, cross: Cross, styles: Mapping[str, str], rows: Sequence[Mapping[Hashable, Any]]) -> Drawing:
    """Return a cross plot.

    Parameters
    ----------
    name : str
        Unique in the document; it names a clipping path.
    styles : mapping of str to str
        Run to the class of its line.
    rows : sequence of mapping
        Verdict rows of the case, for the alternative text.
    """
    flight_x, flight_y = cross.x["flight"], cross.y["flight"]
    half = np.where(np.isfinite(cross.half), cross.half, 0.0)
    x = _limits(cross.x.values())
    y = _limits([*cross.y.values(), flight_y - half, flight_y + half])
    frame = Frame(LEFT, HEAD, WIDTH - LEFT - RIGHT, HEIGHT, x, y)
    body = (
        _path(frame, np.append(flight_x, flight_x[::-1]), np.append(flight_y + half, (flight_y - half)[::-1]), "band", "z")
        if half.any()
        else ""
    )
    body += "".join(_path(frame, cross.x[run], cross.y[run], f"trace {styles[run]}") for run in cross.x)
    body += _path(frame, flight_x, flight_y, "hair")
    parts = [spaced(LEFT, HEAD - 4.0, _title(cross.ordinate)), axes(frame, x_labels=True, x_most=10), clipped(frame, name, body)]
    parts.append(text(LEFT + frame.width / 2, frame.bottom + 24.0, _words(cross.abscissa), "caption", "middle"))
    judged = [f"{row['run']}: {words(row['criterion'])} {row['verdict'].replace('_', ' ')}, {fixed(row['worst_ratio'], 2)} of the tolerance"
            for row in rows if row["criterion"] in cross.criteria]  # fmt: skip
    return Drawing(svg(frame.bottom + CROSS_PLOT_FOOT, "".join(parts)), frame.bottom + CROSS_PLOT_FOOT, ". ".join([cross.words, *judged]))


def _limits(values: Any) -> tuple[float, float]:
    joined = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = (float(joined.min()), float(joined.max())) if joined.size else (0.0, 1.0)
    pad = MARGIN * ((high - low) or max(abs(high), 1.0))
    return low - pad, high + pad


def _path(frame: Frame, x: np.ndarray, y: np.ndarray, css: str, end: str = "") -> str:
    """Return a line through points whose abscissa may turn back; points nearer than half a unit to the last one are left out."""
    good = np.isfinite(x) & np.isfinite(y)
    px, py = frame.px(x[good]), frame.py(y[good])
    kept: list[tuple[float, float]] = []
    for point in zip(px.tolist(), py.tolist(), strict=True):
        if not kept or abs(point[0] - kept[-1][0]) + abs(point[1] - kept[-1][1]) > 0.5:
            kept.append(point)
    return f'<path class="{css}" d="M{" ".join(f"{a:.1f},{b:.1f}" for a, b in kept)}{end}"/>' if kept else ""


def _title(shown: Label) -> list[tuple[str, str]]:
    pieces = [] if shown.is_word else [(shown.base, "symbol"), *([(shown.sub, "sub")] if shown.sub else []), (2 * "\N{NO-BREAK SPACE}", "")]
    return [*pieces, (_words(shown), "title")]


def _words(shown: Label) -> str:
    return f"{shown.words or shown.name}{f', {shown.unit}' if shown.unit else ''}"
