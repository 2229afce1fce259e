"""Region of a state: a code for how far flights support a model, and the grid that holds it.

=====  ==============  =============================================================================
code   name            meaning
=====  ==============  =============================================================================
0      flown           flights were there
1      between         between flown points
2      a-priori        within the tables, supported by a handbook or by judgement alone
3      extrapolated    beyond the end of a table, which holds its last value or its last slope
=====  ==============  =============================================================================

A `RegionTable` has one code and one axis for each cell of a grid.  The axis is the one along which
the next better region is nearest: the axis by which the state left.  The region of a state is the
largest code of all tables.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from flightmech.flown_states import CELL
from flightmech.names import lookup
from flightmech.short_text import ShortText

REGIONS = ("flown", "between flown points", "a-priori", "extrapolated")
FLOWN, BETWEEN, A_PRIORI, EXTRAPOLATED = range(4)
AXES = (
    "alpha",
    "beta",
    "mach",
    "delta_f",
    "gear",
    "speedbrake",
    "h_agl",
    "CT",
    "h",
    "delta_e",
    "delta_a",
    "delta_r",
)
"""Axes by code, from 1 on.  Another axis has the code after the last, and no axis has 0."""
OTHER_AXIS = len(AXES) + 1
ANGLES = ("alpha", "beta")
"""Angles of the flow, which repeat after a full turn."""
_TURN = 2.0 * np.pi
_USUAL_SPAN = {"rad": 0.1, "1": 0.1}
_HALF = 1e-6  # share of a cell by which a corner lies inside its faces


def axis_code(name: str) -> int:
    """Return the code of an axis."""
    return AXES.index(name) + 1 if name in AXES else OTHER_AXIS


def axis_name(code: int) -> str:
    """Return the axis of a code; empty for 0, ``another axis`` beyond the list."""
    if not code:
        return ""
    return AXES[code - 1] if code <= len(AXES) else "another axis"


@dataclass(frozen=True)
class RegionTable(ShortText):
    """Regions of the cells of a grid.

    Attributes
    ----------
    axes : tuple of str
    edges : tuple of array (cell - 1,)
        Rising inner edges of the cells of each axis; the outer cells have no end. [SI]
    regions, leaving : array of uint8 (cell, ...)
        Region, and code of the axis along which the next better region is nearest.
    """

    axes: tuple[str, ...]
    edges: tuple[np.ndarray, ...]
    regions: np.ndarray
    leaving: np.ndarray

    def look_up(self, states: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Return region and axis code at states, in the broadcast shape of the axes.

        A state on an edge belongs to the cell above it.  NaN is extrapolated along its axis.
        """
        columns = [np.asarray(states[name], dtype=float) for name in self.axes]
        shape = np.broadcast_shapes(*(column.shape for column in columns))
        places, missing = [], np.zeros(shape, np.uint8)
        for name, edges, column in zip(self.axes, self.edges, columns, strict=True):
            x = np.broadcast_to(wrap_angle(name, column), shape)
            places.append(np.searchsorted(edges, x, side="right"))
            missing = np.where(np.isnan(x), np.uint8(axis_code(name)), missing)
        is_missing = missing > 0
        regions = np.where(is_missing, EXTRAPOLATED, self.regions[tuple(places)])
        return regions, np.where(is_missing, missing, self.leaving[tuple(places)])


def wrap_angle(name: str, x: np.ndarray) -> np.ndarray:
    """Return an angle of the flow in -pi ... pi; any other variable as it is."""
    if name not in ANGLES:
        return x
    return np.where(np.abs(x) <= np.pi, x, x - _TURN * np.round(x / _TURN))


def unwrap_about(values: np.ndarray) -> float:
    """Return the middle of the widest gap of angles on the circle, where they are cut. [rad]"""
    angles = np.unique(wrap_angle(ANGLES[0], np.asarray(values, dtype=float)))
    following = np.append(angles[1:], angles[0] + _TURN)
    widest = int(np.argmax(following - angles))
    cut = 0.5 * (angles[widest] + following[widest])
    return float(cut - _TURN if cut > np.pi else cut)


def unwrap_from(cut: float, x: np.ndarray) -> np.ndarray:
    """Return angles in cut ... cut + 2 pi. [rad]"""
    return cut + np.mod(x - cut, _TURN)


def cell_centres(edges: np.ndarray, width: float) -> np.ndarray:
    """Return a point in every cell; those of the outer cells are half a width beyond the edge."""
    if not len(edges):
        return np.zeros(1)
    outer = np.concatenate([[edges[0] - width], edges, [edges[-1] + width]])
    return 0.5 * (outer[1:] + outer[:-1])


def usual_width(name: str) -> float:
    """Return the width of the cells of a variable: `CELL`, or a tenth of its unit. [SI]"""
    return CELL.get(name, _USUAL_SPAN.get(lookup(name).units, 1.0))


def inside_hull(low: np.ndarray, high: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return which points lie in the convex hull of boxes.

    Parameters
    ----------
    low, high : array (box, axis)
        Opposite corners of every box; ``low < high``.
    points : array (point, axis)

    Returns
    -------
    array of bool (point,)
    """
    if not len(low):
        return np.zeros(len(points), bool)
    if low.shape[1] == 1:
        return (points[:, 0] >= low.min()) & (points[:, 0] <= high.max())
    # a hull of boxes has a volume, even where all of them are on one line
    scale = np.ptp(np.concatenate([low, high]), axis=0)
    corners = []
    for choice in np.ndindex((2,) * low.shape[1]):
        corners.append(np.where(np.array(choice, bool), high, low) / scale)
    hull = scipy.spatial.ConvexHull(np.unique(np.concatenate(corners), axis=0))
    normals, offsets = hull.equations[:, :-1], hull.equations[:, -1]
    inside = np.ones(len(points), bool)
    for normal, offset in zip(normals, offsets, strict=True):
        inside &= points @ (normal / scale) + offset <= _HALF
    return inside


def fill_table(
    axes: Sequence[str],
    edges: Sequence[np.ndarray],
    region_of: Callable[[dict[str, np.ndarray]], np.ndarray],
    widths: Mapping[str, float] | None = None,
) -> RegionTable:
    """Return the table of a function of the states.

    Parameters
    ----------
    axes, edges : sequence of str, of array
        Variables and inner edges of the cells. [SI]
    region_of : callable
        Takes the points of all cells by variable, each (point,), and returns regions (point,).
    widths : mapping of str to float, optional
        How far beyond the outer edges the outer cells are tried, twice; `usual_width` unless given.
    """
    centres = []
    for name, own in zip(axes, edges, strict=True):
        width = (widths or {}).get(name, usual_width(name))
        centres.append(wrap_angle(name, cell_centres(np.asarray(own, float), width)))
    mesh = np.meshgrid(*centres, indexing="ij")
    shape = tuple(len(own) for own in centres)
    states = {name: points.ravel() for name, points in zip(axes, mesh, strict=True)}
    regions = np.asarray(region_of(states), np.uint8).reshape(shape)
    return shrink_table(
        RegionTable(
            tuple(axes),
            tuple(np.asarray(own, float) for own in edges),
            regions,
            leaving_axes(axes, centres, regions),
        )
    )


def leaving_axes(
    axes: Sequence[str], centres: Sequence[np.ndarray], regions: np.ndarray
) -> np.ndarray:
    """Return the code of the axis along which a better region is nearest, in cells of `CELL`.

    It is 0 where the region is flown, and where no better region exists along any axis.
    """
    best = np.full(regions.shape, np.inf)
    codes = np.zeros(regions.shape, np.uint8)
    for k, name in enumerate(axes):
        x = centres[k] / usual_width(name)
        moved = np.moveaxis(regions, k, -1)
        distance = np.full(moved.shape, np.inf)
        for i in range(len(x)):
            # distance from every cell of a line to cell i, where cell i is better
            steps = np.broadcast_to(np.abs(x - x[i]), moved.shape)
            is_better = moved[..., i : i + 1] < moved
            distance = np.where(is_better, np.minimum(distance, steps), distance)
        distance = np.moveaxis(distance, -1, k)
        codes = np.where(distance < best, np.uint8(axis_code(name)), codes)
        best = np.minimum(best, distance)
    return codes


def shrink_table(table: RegionTable) -> RegionTable:
    """Return a table without edges that separate equal cells, and without axes of no effect."""
    axes: list[str] = []
    kept = []
    regions, leaving = table.regions, table.leaving
    for k, (_, edges) in enumerate(zip(table.axes, table.edges, strict=True)):
        place = len(axes)
        both = np.stack([regions, leaving])
        moved = np.moveaxis(both, place + 1, 0)
        is_change = (moved[1:] != moved[:-1]).reshape(len(edges), -1).any(axis=1)
        chosen = np.concatenate([[0], np.flatnonzero(is_change) + 1])
        regions, leaving = regions.take(chosen, axis=place), leaving.take(chosen, axis=place)
        if len(chosen) == 1:
            regions, leaving = regions.take(0, axis=place), leaving.take(0, axis=place)
            continue
        axes.append(table.axes[k])
        kept.append(edges[is_change])
    return RegionTable(tuple(axes), tuple(kept), np.ascontiguousarray(regions), leaving)


def join_tables(first: RegionTable, second: RegionTable) -> RegionTable:
    """Return one table with the larger region of two; the axes of the second are among the first's.

    The axis of the first counts where both regions are equal, unless it has none.
    """
    edges, takes = [], []
    for name, own in zip(first.axes, first.edges, strict=True):
        other = second.edges[second.axes.index(name)] if name in second.axes else own
        union = np.union1d(own, other)
        # the cell of the union that begins at an edge lies in the cell of each table above it
        starts = np.concatenate([[-np.inf], union])
        edges.append(union)
        takes.append(
            (np.searchsorted(own, starts, "right"), np.searchsorted(other, starts, "right"))
        )
    grid = np.ix_(*(own for own, _ in takes))
    order = [first.axes.index(name) for name in second.axes]
    others = np.ix_(*(takes[place][1] for place in order))
    # axes of the second in the order of the first, length 1 where it has none
    shape = [1] * len(first.axes)
    rank = np.argsort(order)
    for place in order:
        shape[place] = len(takes[place][1])
    a = first.regions[grid], first.leaving[grid]
    b = []
    for part in (second.regions, second.leaving):
        # a table without axes has one cell, which indexing makes a number
        b.append(np.asarray(part[others]).transpose(*rank).reshape(shape))
    is_second = (b[0] > a[0]) | ((b[0] == a[0]) & (a[1] == 0))
    return RegionTable(
        first.axes,
        tuple(edges),
        np.where(is_second, b[0], a[0]).astype(np.uint8),
        np.where(is_second, b[1], a[1]).astype(np.uint8),
    )
