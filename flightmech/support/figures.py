"""SVG elements of pages and reports: frames with ticks, lines, areas, points and text.

Colours and dashes are classes of the style sheet of the page, which has variants for light and dark
screens and for print. Lengths are in user units. A figure of the report has the width `WIDTH`, and
is scaled to the column, 180 mm on A4 paper.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import BaseLoader, Environment, StrictUndefined

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.arrays import true_runs
from flightmech.support.atomic_write import written_atomically
from flightmech.units import from_si

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("png", "svg", "pdf")
"""Formats of figures."""


def html_table(
    caption: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], notes: Sequence[str] = ()
) -> str:
    """Return a table in HTML, for ``_repr_html_``.

    Parameters
    ----------
    caption : str
        Text above the table.
    columns : sequence of str
    rows : iterable of sequences
        Cells. Numbers have five significant digits.
    notes : sequence of str
        Paragraphs below the table.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(map(_html_cell, row)) + "</tr>" for row in rows)
    paragraphs = "".join(f"<p>{escape(note)}</p>" for note in notes)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div><p><b>{escape(caption)}</b></p>{table}{paragraphs}</div>"


def _html_cell(item: Any) -> str:
    if isinstance(item, float | np.floating):
        return f'<td style="text-align: right">{item:.5g}</td>'
    return f'<td style="text-align: left">{escape(str(item))}</td>'


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of matplotlib that is not registered in a window or notebook.

    Parameters
    ----------
    width, height : float
        [in]

    Raises
    ------
    AeromatchError
        matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise AeromatchError(
            "figures need matplotlib, which is not installed; run: pip install 'aeromatch[figures]'"
        ) from missing
    return Figure(figsize=(width, height), layout="constrained")


def demand_drawable(target: str | os.PathLike[str]) -> str:
    """Return the format of a figure by the ending of its file.

    Raises
    ------
    SchemaError
        A format that is not in `FIGURES`.
    """
    target = Path(target)
    kind = target.suffix.lstrip(".").lower()
    if kind not in FIGURES:
        raise SchemaError(
            "figure",
            [f"{target.name}: ending {kind or 'missing'!r}; give one of {', '.join(FIGURES)}"],
        )
    return kind


def write_figure(figure: Figure, target: str | os.PathLike[str], dpi: int = 130) -> None:
    """Write a figure atomically, with the same bytes when written again.

    The ending of the file is the format. The errors are those of `demand_drawable`.
    """
    kind = demand_drawable(target)
    # loaded by `new_figure` already
    from matplotlib import rc_context

    # without these the file has the time of the day, and random names of its parts
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with written_atomically(target) as part, rc_context({"svg.hashsalt": "aeromatch"}):
        figure.savefig(part, dpi=dpi, format=kind, metadata=undated)


def to_display_quantity(name: str, values: np.ndarray) -> tuple[np.ndarray, str]:
    """Return values of a quantity in its display unit, and the unit.

    Values of a name that is not in the vocabulary are not converted, and the unit is empty.
    """
    try:
        unit = lookup(name).display_units
    except UnknownName:
        return values, ""
    return from_si(values, unit), unit


MINUS = "\N{MINUS SIGN}"
WIDTH = 720.0
# Greatest distance between a simplified line and its points [user unit]. It is 1/8 mm on paper, a
# third of the width of the line.
SLACK = 0.5
# distance outside the frame at which ordinates are clipped, so that the line leaves the frame
_OUTSIDE = 3.0
# largest number of decimals of a tick
_MOST_DECIMALS = 6
# least distance between ticks of the ordinate
_TICK_DISTANCE = 26


@dataclass(frozen=True)
class Frame:
    """A rectangle of the figure with the ranges of its axes.

    Ordinates outside the range `y` are clipped at the edge.
    """

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def right(self) -> float:
        """Right edge."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Lower edge."""
        return self.top + self.height

    def px(self, x: Any) -> Any:
        """Return the horizontal position of abscissas."""
        return self.left + (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0]) * self.width

    def py(self, y: Any) -> Any:
        """Return the vertical position of ordinates, clipped just outside the frame."""
        position = (
            self.bottom - (np.asarray(y, float) - self.y[0]) / (self.y[1] - self.y[0]) * self.height
        )
        return np.clip(position, self.top - _OUTSIDE, self.bottom + _OUTSIDE)


def find_axis_limits(values: np.ndarray, margin: float = 0.0) -> tuple[float, float]:
    """Return the ends of an axis that contains all finite values.

    Parameters
    ----------
    values : array
        NaN is ignored. An array without a finite value has the axis of the value zero.
    margin : float
        Additional length at each end, as a fraction of the range of the values.

    Examples
    --------
    >>> find_axis_limits(np.array([1.0, 3.0]), 0.05)
    (0.9, 3.1)
    >>> find_axis_limits(np.array([2.0, 2.0]))
    (1.0, 3.0)
    """
    finite = values[np.isfinite(values)]
    low, high = 0.0, 0.0
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
    # equal values, except for rounding
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        half = 0.5 * (abs(low) or 1.0)
        low, high = low - half, high + half
    extra = margin * (high - low)
    return low - extra, high + extra


def choose_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round tick values, at least two and about `most`.

    The step is 1, 2 or 5 times a power of ten.
    """
    span = high - low
    raw = span / max(most, 1)
    base = 10.0 ** math.floor(math.log10(raw))
    # the factors 0.999 and 1e-9 allow for rounding
    step = next(base * m for m in (1, 2, 5, 10) if base * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    ticks = [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]
    if len(ticks) > 1:
        return ticks
    return choose_ticks(low, high, most + 1)


def tick_text(values: Sequence[float]) -> list[str]:
    """Return the texts of tick values, with the decimals that their step requires.

    More than six decimals are written as a power of ten.
    """
    step = abs(values[1] - values[0])
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    form = ".6g" if decimals > _MOST_DECIMALS else f".{decimals}f"
    texts = []
    for value in values:
        # a value that is zero except for rounding has no sign
        rounded = value if abs(value) > step / 1e6 else 0
        texts.append(f"{rounded:{form}}".replace("-", MINUS))
    return texts


def draw_text(x: float, y: float, text: str, css: str = "", anchor: str = "start") -> str:
    """Return a text element. The text is escaped."""
    css_class = f' class="{css}"' if css else ""
    return (
        f'<text x="{_short(x)}" y="{_short(y)}"{css_class}{_anchor(anchor)}>{escape(text)}</text>'
    )


def _anchor(anchor: str) -> str:
    """Return the attribute of an anchor, empty for the default of SVG."""
    return "" if anchor == "start" else f' text-anchor="{anchor}"'


def text_pieces(
    x: float, y: float, pieces: Sequence[tuple[str, str]], anchor: str = "start"
) -> str:
    """Return a text element of (text, kind) pieces.

    The kind ``sub`` is a subscript. Other kinds are classes of the style sheet.
    """
    spans, is_lowered = [], False
    for text, kind in pieces:
        if kind == "sub":
            spans.append(f'<tspan class="sub" dy="3">{escape(text)}</tspan>')
        else:
            # a shift of SVG also applies to the pieces behind, so it is reversed
            shift = ' dy="-3"' if is_lowered else ""
            css = f' class="{kind}"' if kind else ""
            spans.append(f"<tspan{css}{shift}>{escape(text)}</tspan>")
        is_lowered = kind == "sub"
    return f'<text x="{x:.1f}" y="{y:.1f}"{_anchor(anchor)}>{"".join(spans)}</text>'


def draw_line(x1: float, y1: float, x2: float, y2: float, css: str) -> str:
    """Return a straight line."""
    return f'<line class="{css}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def draw_rectangle(x: float, y: float, width: float, height: float, css: str) -> str:
    """Return a rectangle."""
    return (
        f'<rect class="{css}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
    )


def draw_axes(
    frame: Frame, *, x_labels: bool, x_most: int = 8, y_ticks: Sequence[float] | None = None
) -> str:
    """Return grid, frame and tick labels."""
    xs = choose_ticks(*frame.x, x_most)
    if y_ticks is None:
        y_ticks = choose_ticks(*frame.y, max(2, int(frame.height / _TICK_DISTANCE)))
    ys = list(y_ticks)
    # one path for the whole grid
    lines = [f"M{_short(frame.px(v))},{_short(frame.top)}v{_short(frame.height)}" for v in xs]
    lines += [f"M{_short(frame.left)},{_short(frame.py(v))}h{_short(frame.width)}" for v in ys]
    parts = [
        f'<path class="grid" d="{"".join(lines)}"/>',
        draw_rectangle(frame.left, frame.top, frame.width, frame.height, "frame"),
    ]
    # 3.5 is half of the height of a digit
    labels = []
    for value, text in zip(ys, tick_text(ys), strict=True):
        labels.append(draw_text(frame.left - 5, float(frame.py(value)) + 3.5, text))
    parts.append(f'<g class="tick" text-anchor="end">{"".join(labels)}</g>')
    if x_labels:
        labels = []
        for value, text in zip(xs, tick_text(xs), strict=True):
            labels.append(draw_text(float(frame.px(value)), frame.bottom + 12, text))
        parts.append(f'<g class="tick" text-anchor="middle">{"".join(labels)}</g>')
    return "".join(parts)


def _short(value: Any) -> str:
    """Return a length in tenths of a unit without trailing zeros."""
    return f"{round(float(value), 1):g}"


def clip_to_frame(frame: Frame, name: str, body: str) -> str:
    """Return the elements `body`, clipped to the frame. `name` must be unique in the page."""
    box = (
        f'<rect x="{frame.left:.1f}" y="{frame.top:.1f}" width="{frame.width:.1f}" '
        f'height="{frame.height:.1f}"/>'
    )
    return (
        f'<clipPath id="{escape(name)}">{box}</clipPath><g '
        f'clip-path="url(#{escape(name)})">{body}</g>'
    )


def draw_curve(frame: Frame, x: np.ndarray, y: np.ndarray, css: str, slack: float = SLACK) -> str:
    """Return a simplified line through the finite points, with gaps at missing values."""
    pieces = []
    for start, end in true_runs(np.isfinite(y) & np.isfinite(x)):
        px, py = frame.px(x[start:end]), frame.py(y[start:end])
        indices = simplify_line(px, py, slack)
        pieces.append(_path_data(px[indices], py[indices]))
    return f'<path class="{css}" d="{"".join(pieces)}"/>' if pieces else ""


def draw_area(frame: Frame, x: np.ndarray, low: np.ndarray, high: np.ndarray, css: str) -> str:
    """Return the areas between two lines, one per run of finite points."""
    pieces = []
    for start, end in true_runs(np.isfinite(low) & np.isfinite(high)):
        px = frame.px(x[start:end])
        upper, lower = frame.py(high[start:end]), frame.py(low[start:end])
        # along the upper line, and back along the lower line
        i, j = simplify_line(px, upper), simplify_line(px, lower)[::-1]
        outline_x = np.concatenate([px[i], px[j]])
        outline_y = np.concatenate([upper[i], lower[j]])
        pieces.append(_path_data(outline_x, outline_y) + "z")
    return f'<path class="{css}" d="{"".join(pieces)}"/>' if pieces else ""


def _path_data(x: np.ndarray, y: np.ndarray) -> str:
    """Return path data in tenths of a unit, relative to the point before.

    They have a third of the length of absolute numbers.
    """
    points = np.rint(np.stack([x, y]) * 10.0).astype(int)
    steps = np.diff(points).T
    start = f"M{points[0, 0] / 10:g},{points[1, 0] / 10:g}"
    if not len(steps):
        # a line of zero length, which is drawn as a dot
        return start + "h0"
    return start + "l" + "".join(_tenths(dx) + _tenths(dy) for dx, dy in steps.tolist())


@lru_cache(maxsize=8192)
def _tenths(value: int) -> str:
    """Return a number of tenths in its shortest form: no leading zero, the sign as separator."""
    sign = "-" if value < 0 else " "
    integer, tenth = divmod(abs(value), 10)
    if not tenth:
        return f"{sign}{integer}"
    return f"{sign}{integer or ''}.{tenth}"


def simplify_line(x: np.ndarray, y: np.ndarray, slack: float = SLACK) -> np.ndarray:
    """Return the indices of a simplified line, within `slack` of all points.

    The method is the algorithm of Douglas and Peucker for all pieces of the line at once.
    """
    is_vertex = np.zeros(len(x), bool)
    is_vertex[[0, -1]] = True
    # points of the pieces that may have to be divided
    points = np.arange(len(x))
    # Otherwise np.interp depends on the points before, and no piece is complete.
    is_rising = bool((np.diff(x) >= 0.0).all())
    while True:
        vertices = np.flatnonzero(is_vertex)
        if len(vertices) == len(x):
            return vertices
        # Vertical distance from the line. Of several vertices at one x, np.interp uses one.
        distance = np.abs(np.interp(x[points], x[vertices], y[vertices]) - y[points])
        error = np.where(is_vertex[points], 0.0, distance)
        # number of the piece of each point, first point of each piece, largest error in the piece
        piece = np.searchsorted(vertices, points, side="right")
        first = np.flatnonzero(np.diff(piece, prepend=0))
        sizes = np.diff(first, append=len(points))
        largest = np.repeat(np.maximum.reduceat(error, first), sizes)
        is_wide = largest > slack
        worst = np.flatnonzero(is_wide & (error == largest))
        if not len(worst):
            return vertices
        # of several points with the largest error the last one of the piece
        last = np.flatnonzero(np.diff(piece[worst], append=0))
        is_vertex[points[worst[last]]] = True
        if is_rising:
            points = points[is_wide]


def draw_dots(frame: Frame, x: np.ndarray, y: np.ndarray, css: str) -> str:
    """Return a round mark at each finite point. Its size is the line width of the class `css`."""
    is_finite = np.isfinite(y)
    dots = []
    for px, py in zip(frame.px(x[is_finite]), frame.py(y[is_finite]), strict=True):
        dots.append(f"M{_short(px)},{_short(py)}h0")
    return f'<path class="{css}" d="{"".join(dots)}"/>' if dots else ""


def draw_arrow(x: float, frame: Frame, upward: bool, css: str) -> str:
    """Return an arrow at the edge of the frame, where the line continues outside."""
    tip, foot = frame.bottom - 1, frame.bottom - 7
    if upward:
        tip, foot = frame.top + 1, frame.top + 7
    return (
        f'<path class="{css} arrow" d="M{x:.1f},{tip:.1f} {x - 4:.1f},{foot:.1f} '
        f'{x + 4:.1f},{foot:.1f}Z"/>'
    )


def make_svg_figure(height: float, body: str, text: str, width: float = WIDTH) -> str:
    """Return a figure for a page. `text` is its alternative text for screen readers."""
    return (
        f'<svg class="figure" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(text)}">{body}</svg>'
    )


def make_template_environment(loader: BaseLoader) -> Environment:
    """Return an environment for the templates of a loader, with escaped values."""
    return Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
