"""Normal equations of a batch fit: the information of all readings of all records on the unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flightmech.simulation.normal_sums import Readings, driven_products

from ..problem.trajectory import moving, shown
from .parameter_layout import Layout
from .path_sensitivities import Sweep, segments, sweep


@dataclass(frozen=True)
class Unknowns:
    """Values of the unknowns: constants (nc,), starts of the segments per record (segments, n), and paths that led there."""

    c: np.ndarray
    starts: list[np.ndarray]
    paths: list[np.ndarray]

    def moved(self, layout: Layout, step: np.ndarray, paths: list[np.ndarray]) -> Unknowns:
        """Return the unknowns after a step (size,)."""
        starts = [start + step[layout.start_places(i)] for i, start in enumerate(self.starts)]
        return Unknowns(self.c + step[: len(self.c)], starts, paths)


class Part(NamedTuple):
    """Readings of one sensor in one segment of a record.

    Attributes
    ----------
    names : tuple of str
        Channels.
    segment : int
    samples : slice
        Of the segment.
    readings : Readings
        At the path of the segment, by the unknowns of the segment.
    """

    names: tuple[str, ...]
    segment: int
    samples: slice
    readings: Readings


@dataclass(frozen=True)
class Sums:
    """What one sensor indicates in one segment.

    Attributes
    ----------
    names : tuple of str
        Channels.
    places : array (u,)
        Of the unknowns of the segment among all.
    products : array (channels, u + 1, u + 1)
        Products of the derivatives of each channel by these unknowns, and of its residual, over the readings.
    count : int
        Number of readings of each channel.
    """

    names: tuple[str, ...]
    places: np.ndarray
    products: np.ndarray
    count: int


class Equations:
    """Readings of all records at the present unknowns, weighed by the noise of the channels.

    Parameters
    ----------
    layout : Layout
    at : Unknowns
    sigma : dict of float
        One sigma of the noise of each channel.
    """

    def __init__(self, layout: Layout, at: Unknowns, sigma: dict[str, float]):
        self.layout, self.at, self.sigma = layout, at, sigma
        self.paths: list[np.ndarray] = []
        self.sums: list[Sums] = []
        for run in range(len(layout.setups)):
            swept, places = self.swept(run)
            self.paths.append(swept.x)
            for part in self.parts(run, swept):
                at_segment = places[part.segment]
                products = driven_products(swept.X[part.samples], len(at_segment), part.readings)
                self.sums.append(Sums(part.names, at_segment, products, len(part.readings.r)))
        self.normal, self.gradient, self.cost = self._assembled()

    def swept(self, run: int) -> tuple[Sweep, list[np.ndarray]]:
        """Return the path of a record with its sensitivities, and for each segment the places of its unknowns among all.

        The unknowns of a segment are its start, the free constants that drive the path, and the other free constants.
        """
        layout, problem = self.layout, self.layout.setups[run].problem
        at = layout.places[run]
        swept = sweep(problem, self.at.starts[run], self.at.c[at], self.at.paths[run], layout.free[at])
        own = at[_order(swept.columns, layout.free[at])]
        return swept, [np.append(start, own) for start in layout.start_places(run)]

    def parts(self, run: int, swept: Sweep) -> Iterator[Part]:
        """Yield what the sensors of a record show along its path, segment by segment."""
        layout, problem = self.layout, self.layout.setups[run].problem
        c = self.at.c[layout.places[run]]
        order, place = _order(swept.columns, layout.free[layout.places[run]]), np.full(len(c), -1)
        place[order] = problem.states + np.arange(len(order))
        values = moving(problem, swept.x, c)
        for sensor in problem.sensors:
            r, k, f, J, columns, Jc = shown(problem, sensor, values, c)
            for i, samples in enumerate(segments(problem)):
                rows = slice(*np.searchsorted(k, [samples.start, samples.stop]))
                if rows.stop > rows.start:
                    readings = Readings(r[rows], k[rows] - samples.start, f[rows], J if len(J) == 1 else J[rows], place[columns], Jc[rows])
                    yield Part(sensor.names, i, samples, readings)

    def weighed(self, sigma: dict[str, float]) -> Equations:
        """Return the equations at the same unknowns for another noise of the channels."""
        found = copy(self)
        found.sigma = sigma
        found.normal, found.gradient, found.cost = found._assembled()
        return found

    def _assembled(self) -> tuple[np.ndarray, np.ndarray, float]:
        size, nc = self.layout.size, len(self.layout.names)
        normal, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for item in self.sums:
            weight = 1.0 / np.array([self.sigma[name] for name in item.names]) ** 2
            total = np.tensordot(weight, item.products, 1)
            normal[np.ix_(item.places, item.places)] += total[:-1, :-1]
            gradient[item.places] += total[:-1, -1]
            cost += float(total[-1, -1])
        information = self.layout.prior_information()
        off = self.at.c - self.layout.mean
        normal[:nc, :nc] += information
        gradient[:nc] += information @ off
        cost += float(off @ information @ off)
        for run, setup in enumerate(self.layout.setups):  # wide, against drift where nothing holds a start
            weight = 1.0 / setup.problem.start_sigma**2
            off = self.at.starts[run] - setup.x[setup.problem.starts]
            places = self.layout.start_places(run)
            normal[places, places] += weight
            gradient[places] += weight * off
            cost += float((weight * off**2).sum())
        return normal, gradient, cost

    @cached_property
    def readings(self) -> int:
        """Number of readings."""
        return sum(item.count * len(item.names) for item in self.sums)

    def rms(self) -> dict[str, tuple[float, int]]:
        """Return rms residual and number of readings of each channel over all records."""
        squares: dict[str, float] = {}
        count: dict[str, int] = {}
        for item in self.sums:
            for name, products in zip(item.names, item.products, strict=True):
                squares[name] = squares.get(name, 0.0) + float(products[-1, -1])
                count[name] = count.get(name, 0) + item.count
        return {name: (float(np.sqrt(squares[name] / count[name])), count[name]) for name in squares}

    def step(self, damping: float, held: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the step of the unknowns (size,) and what it promises to take off the cost; `held` (nc,) stay too."""
        move = self.layout.moving
        move = move[~np.isin(move, np.flatnonzero(held))]
        M = self.normal[np.ix_(move, move)]
        scale = 1.0 / np.sqrt(np.diag(M))
        scaled = M * np.outer(scale, scale) + damping * np.eye(len(move))
        step = np.zeros(self.layout.size)
        step[move] = -scale * np.linalg.solve(scaled, scale * self.gradient[move])
        return step, float(-2.0 * self.gradient @ step - step @ self.normal @ step)


def _order(driving: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the places of the free constants, those that drive the path first."""
    return np.append(driving, np.setdiff1d(np.flatnonzero(free), driving))
