"""Parts of a section on a submodel, for the HTML page and for paper, and the layout of its
figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.support.figures import (
    WIDTH,
    Frame,
    clip_to_frame,
    draw_area,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_text,
    find_axis_limits,
)
from pom.report.presentation.quantities import MISSING, format_number

# Margins and height of a panel, in units of the drawing.
LEFT, GAP, TOP, HEIGHT, FOOT = 54.0, 62.0, 34.0, 150.0, 34.0
ROW_GAP = 16.0  # between a panel with its labels and the panel below it
COLUMNS = 2


@dataclass(frozen=True)
class SectionTable:
    """A table of a section.

    Attributes
    ----------
    caption : str
    head : tuple of str
        Heads of the columns.  The first column holds words, the others numbers.
    rows : tuple of tuple of str
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure of `WIDTH` units.

    Attributes
    ----------
    body : str
        SVG content without the root element.
    height : float
        In units of the drawing.
    words : str
        Alternative text.
    """

    body: str
    height: float
    words: str


@dataclass(frozen=True)
class Section:
    """One submodel.

    Attributes
    ----------
    name : str
    techniques : tuple of (str, str, str)
        Part of the submodel, technique by which it was identified ([LR743] table 1), and its
        residual.
    grids : tuple of SectionTable
    pictures : tuple of Picture
    remarks : tuple of str
    """

    name: str
    techniques: tuple[tuple[str, str, str], ...]
    grids: tuple[SectionTable, ...] = ()
    pictures: tuple[Picture, ...] = ()
    remarks: tuple[str, ...] = ()


OUTPUT_ERROR, EQUATION_ERROR = "type 1, output error", "type 2, equation error"


@dataclass(frozen=True)
class SectionLine:
    """A line of a panel.

    Attributes
    ----------
    x, y : array (point,)
        In the units of the panel.
    css : str
        Class of its line code.
    stderr : array (point,) or None
        Half width of the band around the line, one standard error.
    marks : bool
        Draw points in place of a line.
    """

    x: np.ndarray
    y: np.ndarray
    css: str
    stderr: np.ndarray | None = None
    marks: bool = False


@dataclass(frozen=True)
class PanelOf:
    """A panel with its title, the label of its abscissa, and its curves."""

    title: str
    abscissa: str
    curves: tuple[SectionLine, ...]


def estimate_cells(value: float, stderr: float) -> tuple[str, str]:
    """Return a value and its standard error as cells; a standard error that is not finite is a
    dash.
    """
    if not np.isfinite(stderr):
        return format_number(value, 4), MISSING
    return format_number(value, 4), format_number(stderr, 2)


def make_picture(
    name: str, panels: Sequence[PanelOf], key: Sequence[tuple[str, str]], words: str
) -> Picture:
    """Return panels side by side with a key of line codes above them.

    Parameters
    ----------
    name : str
        Identifier, unique in the page.
    panels : sequence of PanelOf
    key : sequence of (class, str)
        Line code and its meaning.
    words : str
        Alternative text.
    """
    width = (WIDTH - LEFT - GAP * (COLUMNS - 1) - 8.0) / COLUMNS
    parts = _draw_key(key)
    for i, panel in enumerate(panels):
        left = LEFT + i % COLUMNS * (width + GAP)
        top = TOP + i // COLUMNS * (HEIGHT + FOOT + ROW_GAP)
        frame = Frame(left, top, width, height=HEIGHT, x=_x_limits(panel), y=_y_limits(panel))
        curves = "".join([_draw_line(frame, line) for line in panel.curves])
        middle = left + width / 2
        parts += [
            draw_text(left, top - 6, panel.title, "title"),
            draw_axes(frame, x_labels=True, x_most=5),
            clip_to_frame(frame, f"{name}-{i}", curves),
            draw_text(middle, frame.bottom + 26, panel.abscissa, "caption", "middle"),
        ]
    # Number of rows, rounded up.
    rows = -(-len(panels) // COLUMNS)
    return Picture("".join(parts), TOP + rows * (HEIGHT + FOOT + ROW_GAP) - 12.0, words)


def _draw_key(key: Sequence[tuple[str, str]]) -> list[str]:
    """Return a sample of every line code with its meaning, from left to right."""
    parts, x = [], LEFT
    for css, meaning in key:
        parts += [
            draw_line(x, 10, x + 30, 10, f"trace {css}"),
            draw_text(x + 35, 13.5, meaning, "caption"),
        ]
        # 5.6 units are about the width of a character of the caption.
        x += 56 + 5.6 * len(meaning)
    return parts


def _x_limits(panel: PanelOf) -> tuple[float, float]:
    # a point on the frame would be cut in half
    margin = 0.03 if any(line.marks for line in panel.curves) else 0.0
    return find_axis_limits(np.concatenate([line.x for line in panel.curves]), margin)


def _y_limits(panel: PanelOf) -> tuple[float, float]:
    """Return limits of the ordinate that hold every line with its standard error."""
    edges = []
    for line in panel.curves:
        if line.stderr is None:
            edges.append(line.y)
        else:
            edges += [line.y - line.stderr, line.y + line.stderr]
    return find_axis_limits(np.concatenate(edges), 0.06)


def _draw_line(frame: Frame, line: SectionLine) -> str:
    """Return a line or its points, above the band of one standard error."""
    band = ""
    if line.stderr is not None:
        low, high = line.y - line.stderr, line.y + line.stderr
        band = draw_area(frame, line.x, low, high, f"error {line.css}-area")
    if line.marks:
        return band + draw_dots(frame, line.x, line.y, f"node {line.css}")
    return band + draw_curve(frame, line.x, line.y, f"trace {line.css}")
