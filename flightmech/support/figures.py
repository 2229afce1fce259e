"""The SVG writer of every page and report: frames with ticks, lines, areas, points, text.

Colours and dashes come from the style sheet of the page by classes, so that screen, dark screen and
print share one look.  Lengths are in user units; a figure of the report is `WIDTH` wide and is
scaled to the column, 180 mm on A4 paper.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import BaseLoader, Environment, StrictUndefined

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
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
        Stands above the table.
    columns : sequence of str
    rows : iterable of sequences
        Numbers are shown with five significant digits, all else as text.
    notes : sequence of str
        Paragraphs below the table.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<div><p><b>{escape(caption)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{below}</div>"


def _cell(item: Any) -> str:
    if isinstance(item, float | np.floating):
        return f'<td style="text-align: right">{item:.5g}</td>'
    return f'<td style="text-align: left">{escape(str(item))}</td>'


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of matplotlib that no window or notebook keeps. [in]

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
        A format that is not drawn.
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
    """Write a figure atomically in the format that the ending of the file names; errors as
    `demand_drawable`.
    """
    kind = demand_drawable(target)
    with written_atomically(target) as part:
        figure.savefig(part, dpi=dpi, format=kind)


def to_display_quantity(name: str, values: np.ndarray) -> tuple[np.ndarray, str]:
    """Return values of a quantity of the vocabulary in its display unit, and the unit; others as
    they are.
    """
    try:
        unit = lookup(name).display_units
    except UnknownName:
        return values, ""
    return from_si(values, unit), unit


MINUS = "\N{MINUS SIGN}"
WIDTH = 720.0
# a point may be left out of a line when the line stays this close to it: an eighth of a millimetre
# on paper, a third of its width
SLACK = 0.5


@dataclass(frozen=True)
class Frame:
    """A rectangle of the figure with its scales; data outside `y` is clipped at the edge."""

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

    def px(self, x):
        """Return the place of abscissas."""
        return self.left + (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0]) * self.width

    def py(self, y):
        """Return the place of ordinates, kept just outside the frame where they leave it."""
        place = (
            self.bottom - (np.asarray(y, float) - self.y[0]) / (self.y[1] - self.y[0]) * self.height
        )
        return np.clip(place, self.top - 3.0, self.bottom + 3.0)


def find_axis_limits(values: np.ndarray, margin: float = 0.0) -> tuple[float, float]:
    """Return the ends of an axis that shows all finite values.

    Parameters
    ----------
    values : array
        NaN is left out; without any finite value the axis is that of zero.
    margin : float
        How far the axis reaches beyond the values, as a part of their range.

    Examples
    --------
    >>> limits(np.array([1.0, 3.0]), 0.05)
    (0.9, 3.1)
    >>> limits(np.array([2.0, 2.0]))
    (1.0, 3.0)
    """
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        half = 0.5 * (abs(low) or 1.0)
        low, high = low - half, high + half
    beyond = margin * (high - low)
    return low - beyond, high + beyond


def choose_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round tick values, about `most` of them and never fewer than two, steps 1, 2 or 5
    times a power of ten.
    """
    span = high - low
    raw = span / max(most, 1)
    base = 10.0 ** math.floor(math.log10(raw))
    step = next(base * m for m in (1, 2, 5, 10) if base * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    found = [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]
    return found if len(found) > 1 else choose_ticks(low, high, most + 1)


def tick_text(values: Sequence[float]) -> list[str]:
    """Return tick values with just the decimals their step needs, as powers of ten where these
    would be more than six.
    """
    step = abs(values[1] - values[0])
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    if decimals > 6:
        return [f"{v:.6g}".replace("-", MINUS) if abs(v) > step / 1e6 else "0" for v in values]
    return [
        f"{v:.{decimals}f}".replace("-", MINUS) if abs(v) > step / 1e6 else f"{0:.{decimals}f}"
        for v in values
    ]


def draw_text(x: float, y: float, words: str, css: str = "", anchor: str = "start") -> str:
    """Return a text element; `words` is escaped."""
    kind = f' class="{css}"' if css else ""
    place = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text x="{_short(x)}" y="{_short(y)}"{kind}{place}>{escape(words)}</text>'


def text_pieces(
    x: float, y: float, pieces: Sequence[tuple[str, str]], anchor: str = "start"
) -> str:
    """Return a text element of (text, kind) pieces; kind ``sub`` is a subscript, all else a class."""
    spans, shift = [], False
    for words, kind in pieces:
        if kind == "sub":
            spans.append(f'<tspan class="sub" dy="3">{escape(words)}</tspan>')
        else:
            back = ' dy="-3"' if shift else ""
            css = f' class="{kind}"' if kind else ""
            spans.append(f"<tspan{css}{back}>{escape(words)}</tspan>")
        shift = kind == "sub"
    place = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{place}>{"".join(spans)}</text>'


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
    ys = (
        list(y_ticks)
        if y_ticks is not None
        else choose_ticks(*frame.y, max(2, int(frame.height / 26)))
    )
    lines = [f"M{_short(frame.px(v))},{_short(frame.top)}v{_short(frame.height)}" for v in xs]
    lines += [f"M{_short(frame.left)},{_short(frame.py(v))}h{_short(frame.width)}" for v in ys]
    parts = [
        f'<path class="grid" d="{"".join(lines)}"/>',
        draw_rectangle(frame.left, frame.top, frame.width, frame.height, "frame"),
    ]
    words = [
        draw_text(frame.left - 5, float(frame.py(v)) + 3.5, w)
        for v, w in zip(ys, tick_text(ys), strict=True)
    ]
    parts.append(f'<g class="tick" text-anchor="end">{"".join(words)}</g>')
    if x_labels:
        words = [
            draw_text(float(frame.px(v)), frame.bottom + 12, w)
            for v, w in zip(xs, tick_text(xs), strict=True)
        ]
        parts.append(f'<g class="tick" text-anchor="middle">{"".join(words)}</g>')
    return "".join(parts)


def _short(value) -> str:
    """Return a length in tenths of a unit without trailing zeros."""
    return f"{round(float(value), 1):g}"


def clip_to_frame(frame: Frame, name: str, body: str) -> str:
    """Return `body` drawn inside the frame only; `name` must be unique in the page."""
    box = (
        f'<rect x="{frame.left:.1f}" y="{frame.top:.1f}" width="{frame.width:.1f}" '
        f'height="{frame.height:.1f}"/>'
    )
    return (
        f'<clipPath id="{escape(name)}">{box}</clipPath><g '
        f'clip-path="url(#{escape(name)})">{body}</g>'
    )


def thin_to_extremes(y: np.ndarray, buckets: int = 420) -> np.ndarray:
    """Return the indices of the smallest and the largest value of each of `buckets` equal parts, or
    all of a short line.

    A part without a finite value keeps one sample, so that a gap remains a gap.
    """
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), buckets + 1).astype(int)
    picked: list[int] = []
    for a, b in pairwise(edges.tolist()):
        piece = y[a:b]
        picked += (
            sorted({a + int(np.nanargmin(piece)), a + int(np.nanargmax(piece))})
            if np.isfinite(piece).any()
            else [a]
        )
    return np.array(picked)


def draw_curve(frame: Frame, x: np.ndarray, y: np.ndarray, css: str, slack: float = SLACK) -> str:
    """Return a line through the finite points, with gaps where a value is missing and without
    superfluous points.
    """
    pieces = []
    for a, b in true_runs(np.isfinite(y) & np.isfinite(x)):
        px, py = frame.px(x[a:b]), frame.py(y[a:b])
        keep = simplify_line(px, py, slack)
        pieces.append(_path(px[keep], py[keep]))
    return f'<path class="{css}" d="{"".join(pieces)}"/>' if pieces else ""


def draw_area(frame: Frame, x: np.ndarray, low: np.ndarray, high: np.ndarray, css: str) -> str:
    """Return the areas between two lines, one per run of finite points."""
    pieces = []
    for a, b in true_runs(np.isfinite(low) & np.isfinite(high)):
        px = frame.px(x[a:b])
        up, down = frame.py(high[a:b]), frame.py(low[a:b])
        ku, kd = simplify_line(px, up), simplify_line(px, down)[::-1]
        pieces.append(
            _path(np.concatenate([px[ku], px[kd]]), np.concatenate([up[ku], down[kd]])) + "z"
        )
    return f'<path class="{css}" d="{"".join(pieces)}"/>' if pieces else ""


def true_runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return start and end (exclusive) of every run of true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """Return path data in tenths of a unit, relative to the point before: a third of the length of
    absolute numbers.
    """
    places = np.rint(np.stack([x, y]) * 10.0).astype(int)
    steps = np.diff(places).T
    start = f"M{places[0, 0] / 10:g},{places[1, 0] / 10:g}"
    return start + (
        "l" + "".join(_tenths(dx) + _tenths(dy) for dx, dy in steps.tolist())
        if len(steps)
        else "h0"
    )


@lru_cache(maxsize=8192)
def _tenths(value: int) -> str:
    """Return an integer number of tenths as short as path data allow: no leading zero, the sign as
    separator.
    """
    sign = "-" if value < 0 else " "
    whole, part = divmod(abs(value), 10)
    return sign + (f"{whole or ''}.{part}" if part else str(whole))


def simplify_line(x: np.ndarray, y: np.ndarray, slack: float = SLACK) -> np.ndarray:
    """Return the indices whose straight connection stays within `slack` of every point (Douglas and
    Peucker, all pieces at once).
    """
    keep = np.zeros(len(x), bool)
    keep[[0, -1]] = True
    rest = np.arange(len(x))  # points of pieces that may still have to be divided
    rising = bool(
        (np.diff(x) >= 0.0).all()
    )  # else what np.interp finds depends on the points before
    while True:
        at = np.flatnonzero(keep)
        if len(at) == len(x):
            return at
        error = np.where(
            keep[rest], 0.0, np.abs(np.interp(x[rest], x[at], y[at]) - y[rest])
        )  # of several points at one x one is seen
        piece = np.searchsorted(at, rest, side="right")
        first = np.flatnonzero(np.diff(piece, prepend=0))
        largest = np.repeat(np.maximum.reduceat(error, first), np.diff(first, append=len(rest)))
        wide = largest > slack
        worst = np.flatnonzero(wide & (error == largest))
        if not len(worst):
            return at
        keep[rest[worst[np.flatnonzero(np.diff(piece[worst], append=0))]]] = (
            True  # of equals the last
        )
        if rising:
            rest = rest[wide]


def draw_dots(frame: Frame, x: np.ndarray, y: np.ndarray, css: str) -> str:
    """Return a round mark at every finite point; its size is the width of the line of class `css`."""
    good = np.isfinite(y)
    places = [
        f"M{_short(a)},{_short(b)}h0"
        for a, b in zip(frame.px(x[good]), frame.py(y[good]), strict=True)
    ]
    return f'<path class="{css}" d="{"".join(places)}"/>' if places else ""


def draw_arrow(x: float, frame: Frame, upward: bool, css: str) -> str:
    """Return a mark at the edge of the frame: the line goes on beyond it."""
    tip, foot = (frame.top + 1, frame.top + 7) if upward else (frame.bottom - 1, frame.bottom - 7)
    return (
        f'<path class="{css} arrow" d="M{x:.1f},{tip:.1f} {x - 4:.1f},{foot:.1f} '
        f'{x + 4:.1f},{foot:.1f}Z"/>'
    )


def make_svg_figure(height: float, body: str, words: str, width: float = WIDTH) -> str:
    """Return the whole figure, to stand in a page; `words` is its alternative text."""
    return (
        f'<svg class="figure" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="{escape(words)}">{body}</svg>'
    )


def make_template_environment(loader: BaseLoader) -> Environment:
    """Return the environment whose templates `loader` finds."""
    return Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
