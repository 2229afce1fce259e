"""What a section on a submodel consists of, the same for the HTML page and for paper, and how its
figures are drawn.
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

LEFT, GAP, TOP, HEIGHT, FOOT = 54.0, 62.0, 34.0, 150.0, 34.0
COLUMNS = 2


@dataclass(frozen=True)
class SectionTable:
    """A table.

    Attributes
    ----------
    caption : str
    head : tuple of str
        The first column holds words, the others numbers.
    rows : tuple of tuple of str
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure of `WIDTH` units: its content without the frame of a page or drawing, its height,
    and its words.
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
        Part of the submodel, technique by which it was identified ([LR743] table 1), and what it
        leaves as a residual.
    grids : tuple of Grid
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
    """A line of a panel: abscissas, ordinates, class of its line code, one standard error where it
    has one.
    """

    x: np.ndarray
    y: np.ndarray
    css: str
    stderr: np.ndarray | None = None
    marks: bool = False


@dataclass(frozen=True)
class PanelOf:
    """A panel: its title, what stands below its abscissa, its curves."""

    title: str
    abscissa: str
    curves: tuple[SectionLine, ...]


def estimate_cells(value: float, stderr: float) -> tuple[str, str]:
    """Return a value and its standard error as cells; the error is missing where it is not finite."""
    return format_number(value, 4), format_number(stderr, 2) if np.isfinite(stderr) else MISSING


def make_picture(
    name: str, panels: Sequence[PanelOf], key: Sequence[tuple[str, str]], words: str
) -> Picture:
    """Return panels side by side with a key of line codes above them.

    Parameters
    ----------
    name : str
        Unique in the page.
    panels : sequence of PanelOf
    key : sequence of (class, str)
        Line code and what it stands for.
    words : str
        Alternative text.
    """
    width = (WIDTH - LEFT - GAP * (COLUMNS - 1) - 8.0) / COLUMNS
    parts, x = [], LEFT
    for css, meaning in key:
        parts += [
            draw_line(x, 10, x + 30, 10, f"trace {css}"),
            draw_text(x + 35, 13.5, meaning, "caption"),
        ]
        x += 56 + 5.6 * len(meaning)
    rows = -(-len(panels) // COLUMNS)
    for i, panel in enumerate(panels):
        left, top = LEFT + i % COLUMNS * (width + GAP), TOP + i // COLUMNS * (HEIGHT + FOOT + 16.0)
        frame = Frame(
            left,
            top,
            width,
            HEIGHT,
            find_axis_limits(np.concatenate([c.x for c in panel.curves])),
            find_axis_limits(np.concatenate([y for c in panel.curves for y in _edges(c)]), 0.06),
        )
        parts += [
            draw_text(left, top - 6, panel.title, "title"),
            draw_axes(frame, x_labels=True, x_most=5),
        ]
        parts += [
            clip_to_frame(frame, f"{name}-{i}", "".join(_drawn(frame, c) for c in panel.curves))
        ]
        parts += [
            draw_text(left + width / 2, frame.bottom + 26, panel.abscissa, "caption", "middle")
        ]
    return Picture("".join(parts), TOP + rows * (HEIGHT + FOOT + 16.0) - 12.0, words)


def _drawn(frame: Frame, c: SectionLine) -> str:
    body = (
        draw_area(frame, c.x, c.y - c.stderr, c.y + c.stderr, f"error {c.css}-area")
        if c.stderr is not None
        else ""
    )
    return body + (
        draw_dots(frame, c.x, c.y, f"node {c.css}")
        if c.marks
        else draw_curve(frame, c.x, c.y, f"trace {c.css}")
    )


def _edges(c: SectionLine) -> tuple[np.ndarray, ...]:
    return (c.y,) if c.stderr is None else (c.y - c.stderr, c.y + c.stderr)
