"""A chart of the set drawn: panels in equal scales, bands of one standard error, labels at the ends
of the curves, points from flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


class NotDrawn(Exception):
    """A figure that cannot be drawn; the text names what is missing."""


@dataclass(frozen=True)
class ChartLine:
    """One curve.

    Attributes
    ----------
    label : str
    x, y, stderr : array (points,)
        In display units; the standard error is that of `y`, or with `is_across` that of `x`.
    member : int
        Of the family, for the colour; -1 for black.
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
        For the legend.
    x, y, stderr : array (points,)
        In display units; standard errors may be zero.
    kind : {"estimate", "test point", "sample", "trace"}
        Local estimate with its standard error, steady start of a manoeuvre, single samples, samples
        of one manoeuvre joined by a line.
    member : int
        Of the family, for the colour; -1 for black.
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
    lines : sequence of Line
        Of the database that is shown.
    points : sequence of Points
    by : str
        What distinguishes the lines, as written above the labels at their ends: ``$M$``.
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
        In LR-743: ``Fig. 3``; empty for a figure that it does not have.
    title : str
    line : str
        What is drawn and where the other variables are held.
    x_label, y_label : str
        With units.
    panels : sequence of Panel
        Next to each other in equal scales, in rows of three.
    notes : sequence of str
        At the foot: sources and definitions.
    is_by_database : bool
        Whether the lines are databases, with their line code, and no family.
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
