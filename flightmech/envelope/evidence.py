"""Regions of the evidence: where the samples were that identified a model.

The evidence of a configuration is drawn in two planes, Mach number and sideslip over the angle of
attack; the rule requires the second one, and flights cover the first along a curve.  A state is
flown within one and a half cells of a sample (`flightmech.flown_states.CELL`), between flown points
inside the convex hull of the samples of its configuration, and a-priori elsewhere.  A configuration
between two flown ones is between flown points where both of them are flown or between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flightmech.envelope.regions import (
    A_PRIORI,
    ANGLES,
    BETWEEN,
    FLOWN,
    RegionTable,
    fill_table,
    inside_hull,
    unwrap_about,
    unwrap_from,
    wrap_angle,
)
from flightmech.flown_states import CELL, CONFIGURATION, HIGHEST, FlownStates

PLANES = (("alpha", "mach"), ("alpha", "beta"))
_NEAR = 1.5  # cells from the centre of a visited one
_MARGIN = 2  # cells beyond the visited ones that are tried one by one


def evidence_tables(states: FlownStates, variables: set[str]) -> list[RegionTable]:
    """Return the region tables of flown states.

    Parameters
    ----------
    states : FlownStates
    variables : set of str
        Variables of the model.  A height or a thrust coefficient counts only if the model has it.
    """
    tables = []
    for plane in PLANES:
        if set(plane) <= set(states.axes):
            tables.append(_plane_table(states, plane))
    for name, cells in states.single.items():
        if name in variables:
            tables.append(_single_table(name, cells))
    return [table for table in tables if table.regions.any()]


def flown_configurations(states: FlownStates) -> list[tuple[dict[str, float], int]]:
    """Return the visited configurations with the number of their cells, the most visited first.

    Each is a mapping of the axes of `CONFIGURATION` that the samples have to the centre of a cell.
    """
    axes = [name for name in CONFIGURATION if name in states.axes]
    columns = [states.axes.index(name) for name in axes]
    settings, counts = np.unique(states.cells[:, columns], axis=0, return_counts=True)
    found = []
    for k in np.argsort(-counts, kind="stable"):
        values = {name: float(n * CELL[name]) for name, n in zip(axes, settings[k], strict=True)}
        found.append((values, int(counts[k])))
    return found


def _single_table(name: str, cells: np.ndarray) -> RegionTable:
    """Return the regions of one variable."""

    def region_of(points: dict[str, np.ndarray]) -> np.ndarray:
        x = points[name] / CELL[name]
        is_near = (np.abs(x[:, np.newaxis] - cells) <= _NEAR).any(axis=1)
        if name == "h_agl":
            # free air has no upper end
            is_near |= points[name] >= HIGHEST
        is_between = (x >= cells.min()) & (x <= cells.max())
        return np.where(is_near, FLOWN, np.where(is_between, BETWEEN, A_PRIORI))

    return fill_table((name,), (_cell_edges(cells) * CELL[name],), region_of)


def _cell_edges(cells: np.ndarray) -> np.ndarray:
    """Return the edges of cells and of their neighbours, in cells."""
    near = np.unique(np.concatenate([cells + k for k in range(-_MARGIN, _MARGIN + 1)]))
    return np.unique(np.concatenate([near - 0.5, near + 0.5]))


def _plane_table(states: FlownStates, plane: Sequence[str]) -> RegionTable:
    """Return the regions over a plane and the configuration."""
    settings = [name for name in CONFIGURATION if name in states.axes]
    axes = (*plane, *settings)
    cells = states.cells[:, [states.axes.index(name) for name in axes]]
    cuts, edges = {}, []
    for k, name in enumerate(axes):
        own = cells[:, k]
        if name in ANGLES:
            cuts[name] = unwrap_about(own * CELL[name])
            # whole cells on the side of the cut that keeps the samples together
            turned = unwrap_from(cuts[name], own * CELL[name]) / CELL[name]
            cells[:, k] = np.round(turned)
        if name in plane:
            own = np.arange(cells[:, k].min() - _MARGIN, cells[:, k].max() + _MARGIN + 1)
        sides = np.unique(np.concatenate([own - 0.5, own + 0.5])) * CELL[name]
        edges.append(np.unique(wrap_angle(name, sides)))
    rule = _PlaneRegions(plane, settings, cells, cuts)
    return fill_table(axes, edges, rule.region_of)


class _PlaneRegions:
    """The rule of this module in one plane."""

    def __init__(
        self,
        plane: Sequence[str],
        settings: Sequence[str],
        cells: np.ndarray,
        cuts: Mapping[str, float],
    ):
        self.plane, self.settings, self.cuts = plane, settings, cuts
        self.visited: dict[tuple[int, ...], np.ndarray] = {}
        # the cells of a plane are the same in every configuration
        self._known: dict[tuple[tuple[int, ...], bytes], np.ndarray] = {}
        for setting in np.unique(cells[:, 2:], axis=0):
            chosen = (cells[:, 2:] == setting).all(axis=1)
            self.visited[tuple(map(int, setting))] = np.unique(cells[chosen, :2], axis=0)

    def region_of(self, points: dict[str, np.ndarray]) -> np.ndarray:
        """Return the region at points, each variable (point,)."""
        columns = []
        for name in self.plane:
            x = points[name]
            if name in self.cuts:
                x = unwrap_from(self.cuts[name], x)
            columns.append(x / CELL[name])
        place = np.stack(columns, axis=1)
        setting = np.zeros((len(place), len(self.settings)), int)
        for k, name in enumerate(self.settings):
            setting[:, k] = np.round(points[name] / CELL[name]).astype(int)
        regions = np.full(len(place), A_PRIORI)
        for own in np.unique(setting, axis=0):
            chosen = (setting == own).all(axis=1)
            regions[chosen] = self._region_at(tuple(map(int, own)), place[chosen])
        return regions

    def _region_at(self, setting: tuple[int, ...], place: np.ndarray) -> np.ndarray:
        """Return the regions of points in one configuration."""
        if setting in self.visited:
            return self._region_in(setting, place)
        best = np.full(len(place), A_PRIORI)
        for k in range(len(setting)):
            # flown settings of this control alone, on both sides
            line = [own for own in self.visited if _without(own, k) == _without(setting, k)]
            below = [own for own in line if own[k] < setting[k]]
            above = [own for own in line if own[k] > setting[k]]
            if below and above:
                ends = max(below, key=lambda own: own[k]), min(above, key=lambda own: own[k])
                sides = [self._region_in(own, place) for own in ends]
                best = np.minimum(best, np.maximum(BETWEEN, np.maximum(*sides)))
        return best

    def _region_in(self, setting: tuple[int, ...], place: np.ndarray) -> np.ndarray:
        """Return the regions of points (point, 2) in a visited configuration, in cells."""
        key = (setting, place.tobytes())
        if key not in self._known:
            visited = self.visited[setting]
            is_between = inside_hull(visited - 0.5, visited + 0.5, place)
            is_near = np.zeros(len(place), bool)
            for cell in visited:
                is_near |= (np.abs(place - cell) <= _NEAR).all(axis=1)
            regions = np.where(is_between, BETWEEN, A_PRIORI)
            self._known[key] = np.where(is_near, FLOWN, regions)
        return self._known[key]


def _without(setting: tuple[int, ...], k: int) -> tuple[int, ...]:
    return setting[:k] + setting[k + 1 :]
