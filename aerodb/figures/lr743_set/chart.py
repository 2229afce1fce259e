"""Content of a figure of the LR-743 set: panels, lines with standard errors, points from flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

# Member of a line that is not one of the family: a boundary of the flight envelope.
BOUNDARY = 99


class NotDrawn(Exception):
    """A figure that cannot be drawn; the text states the missing data."""


@dataclass(frozen=True)
class ChartLine:
    """One curve.

    Attributes
    ----------
    label : str
        Label for the legend or for the end of the curve.
    x, y, stderr : array (point,)
        Coordinates and standard errors in display units.
    member : int
        Index in the family, which determines the colour; -1 for black.
    is_across : bool
        Whether the standard error is that of `x`, and not of `y`.
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    stderr: np.ndarray
    member: int = 0
    is_across: bool = False


@dataclass(frozen=True)
class FlightPoints:
    """Points of one kind from flight.

    Attributes
    ----------
    label : str
        Label for the legend.
    x, y, stderr : array (point,)
        Coordinates and standard errors of `y` in display units; zero for no standard error.
    kind : {"estimate", "test point", "sample", "trace"}
        Local estimate with its standard error, steady start of a manoeuvre, single samples, samples
        of one manoeuvre joined by a line.
    member : int
        Index in the family, which determines the colour; -1 for black.
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    stderr: np.ndarray
    kind: str
    member: int = -1


@dataclass(frozen=True)
class ChartPanel:
    """Lines and points over one pair of axes.

    Attributes
    ----------
    title : str
        Title of the panel.
    lines : sequence of ChartLine
        Lines of one database.
    points : sequence of FlightPoints
        Points from flight.
    by : str
        Symbol of the variable that distinguishes the lines, such as ``$M$``.  It is above the
        labels at their ends.
    """

    title: str
    lines: Sequence[ChartLine]
    points: Sequence[FlightPoints] = ()
    by: str = ""


@dataclass(frozen=True)
class Chart:
    """A figure of the set.

    Attributes
    ----------
    stem : str
        File name without suffix.
    number : str
        Number in LR-743: ``Fig. 3``; empty for an additional figure.
    title : str
        Title of the figure.
    line : str
        Ordinate, abscissa and the values of the fixed variables.
    x_label, y_label : str
        Labels of the axes with units.
    panels : sequence of ChartPanel
        Panels in equal scales, next to each other and in rows.
    notes : sequence of str
        Sources and definitions at the foot.
    is_by_database : bool
        Whether the lines are databases, with their line code, and not a family.
    x_zero, y_zero : bool
        Whether an axis begins at zero.
    """

    stem: str
    number: str
    title: str
    line: str
    x_label: str
    y_label: str
    panels: Sequence[ChartPanel]
    notes: Sequence[str] = field(default_factory=tuple)
    is_by_database: bool = False
    x_zero: bool = False
    y_zero: bool = False
