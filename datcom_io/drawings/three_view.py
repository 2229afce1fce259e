"""Three-view drawing of an input deck as SVG: top, side and front view at one scale.

The views are aligned as in a workshop drawing: the side view is below the top view and the front
view to the right of it. Coordinates of the drawing are rounded to 0.01, so that equal decks give
equal bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from textwrap import wrap

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.drawings.deck_shape import DeckShape, shape_of_deck
from datcom_io.drawings.doubts import doubts_of_deck
from datcom_io.drawings.outlines import DeckOutline
from flightmech.errors import SchemaError
from flightmech.units import to_si

_WIDE, _MARGIN, _GAP = 1000.0, 60.0, 70.0
_LINE, _FONT = 17.0, 12.0
_MOST_HIGH = 760.0  # height of the views together
_CHARACTERS = 128  # of a line of text below the views
# Axes of the views across and up the page, and their sign: x aft points to the right.
_AXES = {"top": (0, 1), "side": (0, 2), "front": (1, 2)}
_UNITS = {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"}
_COLOURS = {
    "body": ("#e4e7ea", "#4a5560"),
    "wing": ("#9cc3e6", "#1f5f99"),
    "tail": ("#a9d8b8", "#24733f"),
    "fin": ("#f2cf9d", "#9a5b00"),
    "device": ("#e89a9a", "#a01c1c"),
    "engine": ("#d3c2e8", "#5b3b91"),
}
_TITLES = {"top": "top view, right wing up the page", "side": "side view", "front": "front view"}


def draw_deck(deck: Deck, name: str = "") -> str:
    """Return the three-view drawing of a case as SVG.

    Parameters
    ----------
    deck : Deck
        One case, as an item of `read_deck`.
    name : str
        Title; by default the text of CASEID.

    Returns
    -------
    str
        SVG with title and description. What the deck does not define is named below the views, and
        so are dimensions that are probably errors.

    Raises
    ------
    SchemaError
        The deck has no part that can be drawn; the error states why.
    """
    shape = shape_of_deck(deck)
    drawn = [outline for outline in shape.outlines if np.isfinite(outline.points).all()]
    if not drawn or _size(drawn) <= 0.0:
        reason = "; ".join(shape.omissions) or "no namelist of a body or a surface"
        raise SchemaError("deck", [f"nothing to draw: {reason}"])
    drawing = _Drawing(shape, drawn, name or deck.caseid or "case without CASEID")
    return drawing.svg(doubts_of_deck(deck, shape))


def _size(outlines: Sequence[DeckOutline]) -> float:
    points = np.vstack([outline.points for outline in outlines])
    return float(np.ptp(points, axis=0).max())


@dataclass(frozen=True)
class _View:
    """One view: its range in the deck and its place on the page."""

    name: str
    low: np.ndarray
    high: np.ndarray
    origin: tuple[float, float]
    scale: float

    def place(self, points: np.ndarray) -> np.ndarray:
        """Return the places (n, 2) on the page of points (n, 3)."""
        across, up = _AXES[self.name]
        x = self.origin[0] + self.scale * (points[:, across] - self.low[0])
        y = self.origin[1] + self.scale * (self.high[1] - points[:, up])
        return np.column_stack([x, y])


class _Drawing:
    """Elements of one drawing."""

    def __init__(self, shape: DeckShape, outlines: Sequence[DeckOutline], name: str):
        self.shape, self.outlines, self.name = shape, outlines, name
        self.unit = _UNITS[shape.dim]
        self.views = self._layout()

    def _layout(self) -> dict[str, _View]:
        """Return the views with the largest scale that the page permits."""
        ranges = {}
        for view, axes in _AXES.items():
            points = [o.points[:, axes] for o in self.outlines if view in o.views]
            centre = [np.array([p.place])[:, axes] for p in self.shape.points]
            stacked = np.vstack(points + centre) if points else np.zeros((1, 2))
            ranges[view] = stacked.min(axis=0), stacked.max(axis=0)
        # Views side by side or above each other have one range of their common axis.
        for a, b, (first, second) in (("top", "side", (0, 0)), ("side", "front", (1, 1))):
            low = min(ranges[a][0][first], ranges[b][0][second])
            high = max(ranges[a][1][first], ranges[b][1][second])
            for view, axis in ((a, first), (b, second)):
                ranges[view][0][axis], ranges[view][1][axis] = low, high
        extent = {view: high - low for view, (low, high) in ranges.items()}
        wide = max(extent["side"][0] + extent["front"][0], 1e-9)
        high = max(extent["top"][1] + extent["side"][1], 1e-9)
        scale = min((_WIDE - 2.0 * _MARGIN - _GAP) / wide, (_MOST_HIGH - _GAP) / high)
        top_y = 112.0
        side_y = top_y + scale * extent["top"][1] + _GAP
        front_x = _MARGIN + scale * extent["side"][0] + _GAP
        origins = {"top": (_MARGIN, top_y), "side": (_MARGIN, side_y), "front": (front_x, side_y)}
        views = {}
        for view, (low, top) in ranges.items():
            views[view] = _View(view, low, top, origins[view], scale)
        return views

    def svg(self, doubts: Sequence[str]) -> str:
        """Return the document, with doubts below the views."""
        below = self._bottom() + 95.0
        lines = list(self._text_lines(doubts))
        height = below + _LINE * len(lines) + 20.0
        title = f"Three-view drawing: {self.name}"
        description = "; ".join(
            [
                f"Top, side and front view of an input deck, unit {self.unit}",
                *self.shape.parts,
                *(f"not in the deck: {text}" for text in self.shape.omissions),
                *(f"check: {text}" for text in doubts),
            ]
        )
        body = [
            f'<rect width="{_WIDE:g}" height="{_number(height)}" fill="#ffffff"/>',
            _text(_MARGIN, 34.0, self.name, size=18.0, weight="bold"),
            _text(_MARGIN, 56.0, f"dimensions in {self._both_units()}, x aft, y right, z up"),
        ]
        for view in self.views.values():
            body += self._draw_view(view)
        body += self._dimensions()
        body += self._scale_bar()
        y = below
        for style, text in lines:
            body += _legend_line(y, style, text)
            y += _LINE
        return (
            '<svg xmlns="http://www.w3.org/2000/svg" '
            f'viewBox="0 0 {_WIDE:g} {_number(height)}" role="img" '
            'aria-labelledby="title description" font-family="sans-serif">\n'
            f'<title id="title">{escape(title)}</title>\n'
            f'<desc id="description">{escape(description)}</desc>\n'
            + "\n".join(body)
            + "\n</svg>\n"
        )

    def _both_units(self) -> str:
        return "m" if self.unit == "m" else f"{self.unit}, in brackets m"

    def _length(self, value: float) -> str:
        """Return a length in the unit of the deck, and in metres."""
        text = f"{value:.4g} {self.unit}"
        if self.unit != "m":
            text += f" ({float(to_si(value, self.unit, 'm')):.4g} m)"
        return text

    def _bottom(self) -> float:
        view = self.views["side"]
        return view.origin[1] + view.scale * float(view.high[1] - view.low[1])

    def _draw_view(self, view: _View) -> Iterator[str]:
        """Yield the outlines of a view, the surfaces far from the eye first."""
        yield f'<g id="{view.name}">'
        yield _text(view.origin[0], view.origin[1] - 26.0, _TITLES[view.name], colour="#555555")
        order = ("body", "wing", "tail", "fin", "device", "engine")
        for style in order:
            for outline in self.outlines:
                if outline.style == style and view.name in outline.views:
                    yield _outline(outline, view.place(outline.points))
        yield from self._mark_points(view)
        yield from self._label_parts(view)
        yield "</g>"

    def _label_parts(self, view: _View) -> Iterator[str]:
        """Yield the names of surfaces and devices in the view that shows them best."""
        named: set[str] = set()
        for outline in self.outlines:
            in_top = outline.style in ("wing", "tail", "device")
            if outline.part in named or view.name != ("top" if in_top else "side"):
                continue
            if outline.style == "body" or view.name not in outline.views:
                continue
            named.add(outline.part)
            places = view.place(outline.points)
            x, y = places[:, 0].max() + 6.0, float(places[:, 1].mean()) + 4.0
            if outline.style in ("wing", "tail"):
                # at the tip, whose end is the last point of the first half of the outline
                tip = places[len(places) // 2 - 1 : len(places) // 2 + 1]
                x, y = tip[:, 0].max() + 6.0, float(tip[:, 1].mean()) + 10.0
            elif outline.part == "vertical tail":
                y = float(places[:, 1].min()) + 10.0
            yield _text(x, y, outline.part, size=11.0, colour=_COLOURS[outline.style][1])

    def _mark_points(self, view: _View) -> Iterator[str]:
        for point in self.shape.points:
            x, y = view.place(np.array([point.place]))[0]
            yield (
                f'<g class="point"><title>{escape(point.name)}</title>'
                f'<circle cx="{_number(x)}" cy="{_number(y)}" r="6" fill="#ffffff" '
                f'stroke="#000000"/>'
                f'<path d="M{_number(x)} {_number(y)}v-6a6 6 0 0 1 6 6zm0 0v6a6 6 0 0 1 -6 -6z" '
                f'fill="#000000"/></g>'
            )

    def _dimensions(self) -> Iterator[str]:
        """Yield length, height and span."""
        side, front = self.views["side"], self.views["front"]
        z = np.hstack([o.points[:, 2] for o in self.outlines if "side" in o.views])
        # Length below the side view, span below the front view.
        for view, outlines_axis, label in ((side, 0, "length"), (front, 1, "span")):
            values = [o.points[:, outlines_axis] for o in self.outlines if view.name in o.views]
            low, high = float(np.min(np.hstack(values))), float(np.max(np.hstack(values)))
            x0 = view.origin[0] + view.scale * (low - float(view.low[0]))
            x1 = view.origin[0] + view.scale * (high - float(view.low[0]))
            y = self._bottom() + 26.0
            yield _dimension_line(x0, x1, y)
            text = f"{label} {self._length(high - low)}"
            if label == "length":
                text += f", height {self._length(float(np.ptp(z)))}"
            yield _text(0.5 * (x0 + x1), y + 16.0, text, anchor="middle")
        # Height left of the side view; y of the drawing points down.
        low, high = float(z.min()), float(z.max())
        x = side.origin[0] - 22.0
        y0 = side.origin[1] + side.scale * (float(side.high[1]) - high)
        y1 = side.origin[1] + side.scale * (float(side.high[1]) - low)
        yield (
            f'<path d="M{_number(x)} {_number(y0)}V{_number(y1)}M{_number(x - 5)} {_number(y0)}h10'
            f'M{_number(x - 5)} {_number(y1)}h10" stroke="#333333" fill="none"/>'
        )

    def _scale_bar(self) -> Iterator[str]:
        """Yield a bar of a round length in metres, and a person of 1.8 m where it fits."""
        metre = self.views["side"].scale / float(to_si(1.0, self.unit, "m"))
        length = _round_length(140.0 / metre)
        top, front = self.views["top"], self.views["front"]
        # in the corner that the views leave free
        free = top.scale * float(top.high[1] - top.low[1])
        x, y = front.origin[0], top.origin[1] + free
        yield _dimension_line(x, x + metre * length, y)
        yield _text(x + 0.5 * metre * length, y - 8.0, f"{length:g} m", anchor="middle")
        tall = 1.8 * metre
        if 12.0 <= tall <= free:
            yield _person(x + metre * length + 30.0 + 0.15 * tall, y + 5.0, tall)

    def _text_lines(self, doubts: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Yield style and text of the lines below the views."""
        styles = {outline.part: outline.style for outline in self.outlines}
        for text in self.shape.parts:
            part = next((name for name in styles if text.startswith(name)), "")
            yield from _wrapped(styles.get(part, "point"), text)
        if doubts:
            yield "", ""
            for text in doubts:
                yield from _wrapped("check", f"check: {text}")
        if self.shape.omissions:
            yield "", ""
            for text in self.shape.omissions:
                yield from _wrapped("", f"not in the deck: {text}")


def _wrapped(style: str, text: str) -> Iterator[tuple[str, str]]:
    for number, line in enumerate(wrap(text, _CHARACTERS)):
        # The swatch of a part stands at its first line.
        yield (style, line) if number == 0 or style == "check" else ("", line)


def _round_length(target: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most `target`."""
    power = 10.0 ** math.floor(math.log10(target))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= target)


def _number(value: float) -> str:
    """Return a coordinate with two decimals, without a negative zero."""
    return f"{round(float(value), 2) + 0.0:g}" if abs(value) < 1e4 else f"{value:.0f}"


def _outline(outline: DeckOutline, places: np.ndarray) -> str:
    fill, stroke = _COLOURS[outline.style]
    pairs = " ".join(f"{_number(x)},{_number(y)}" for x, y in places)
    title = f"<title>{escape(outline.part)}</title>"
    if len(places) == 2 or np.ptp(places, axis=0).min() < 0.5:
        return (
            f'<polyline points="{pairs}" fill="none" stroke="{stroke}" stroke-width="3">{title}'
            f"</polyline>"
        )
    opacity = "0.35" if outline.style == "engine" else "0.8"
    return (
        f'<polygon points="{pairs}" fill="{fill}" fill-opacity="{opacity}" stroke="{stroke}" '
        f'stroke-width="1">{title}</polygon>'
    )


def _text(
    x: float,
    y: float,
    text: str,
    *,
    size: float = _FONT,
    anchor: str = "start",
    colour: str = "#111111",
    weight: str = "normal",
) -> str:
    return (
        f'<text x="{_number(x)}" y="{_number(y)}" font-size="{size:g}" text-anchor="{anchor}" '
        f'font-weight="{weight}" fill="{colour}">{escape(text)}</text>'
    )


def _dimension_line(x0: float, x1: float, y: float) -> str:
    return (
        f'<path d="M{_number(x0)} {_number(y)}H{_number(x1)}M{_number(x0)} {_number(y - 5)}v10'
        f'M{_number(x1)} {_number(y - 5)}v10" stroke="#333333" fill="none"/>'
    )


def _person(x: float, foot: float, tall: float) -> str:
    """Return a figure of a person, for the size of the aeroplane."""
    head = 0.075 * tall
    return (
        '<g fill="#777777"><title>person of 1.8 m</title>'
        f'<circle cx="{_number(x)}" cy="{_number(foot - tall + head)}" r="{_number(head)}"/>'
        f'<path d="M{_number(x - 0.13 * tall)} {_number(foot - 0.82 * tall)}'
        f"h{_number(0.26 * tall)}l{_number(-0.05 * tall)} {_number(0.4 * tall)}"
        f'v{_number(0.42 * tall)}h{_number(-0.16 * tall)}v{_number(-0.42 * tall)}z"/></g>'
        + _text(x, foot + 13.0, "1.8 m", anchor="middle", size=10.0, colour="#555555")
    )


def _legend_line(y: float, style: str, text: str) -> Iterator[str]:
    """Yield a line of text with the colour of its part."""
    colour = "#111111"
    if style in _COLOURS:
        fill, stroke = _COLOURS[style]
        yield (
            f'<rect x="{_MARGIN:g}" y="{_number(y - 10)}" width="14" height="10" fill="{fill}" '
            f'stroke="{stroke}"/>'
        )
    elif style == "check":
        colour = "#a01c1c"
    if text:
        yield _text(_MARGIN + 22.0, y, text, colour=colour)
