"""Normal equations of a batch fit: the information of all readings of all records on the unknowns."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..problem.problem import Problem
from ..problem.trajectory import shown
from .parameter_layout import Layout
from .path_sensitivities import Sweep, chained, sweep, weak_terms


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


@dataclass(frozen=True)
class Seen:
    """One sensor of one record at the present unknowns.

    Attributes
    ----------
    names : tuple of str
        Channels.
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        Sample before each reading and the fraction of the step to it.
    J : array (M, m, n)
        Derivative by the state.
    A : array (M, m, n + constants of the record)
        Derivative by the start of the own segment and by the constants.
    """

    names: tuple[str, ...]
    r: np.ndarray
    k: np.ndarray
    f: np.ndarray
    J: np.ndarray
    A: np.ndarray


def seen(problem: Problem, swept: Sweep, c: np.ndarray) -> list[Seen]:
    """Return what the sensors of a record show."""
    found = []
    n = problem.states
    for sensor in problem.sensors:
        r, k, f, J, columns, Jc = shown(problem, sensor, swept.x, c)
        by_state = chained(J, swept.X, k, f)
        A = np.zeros((*r.shape, n + len(c)))
        A[..., :n] = by_state[..., :n]
        A[..., n + swept.columns] = by_state[..., n:]
        A[..., n + columns] += Jc
        found.append(Seen(sensor.names, r, k, f, J, A))
    return found


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
        self.sweeps: list[Sweep] = []
        self.seen: list[list[Seen]] = []
        for i, setup in enumerate(layout.setups):
            c = at.c[layout.places[i]]
            swept = sweep(setup.problem, at.starts[i], c, weak_terms(setup.problem, at.paths[i]))
            self.sweeps.append(swept)
            self.seen.append(seen(setup.problem, swept, c))
        self.normal, self.gradient, self.cost = self._assembled()

    def weighed(self, sigma: dict[str, float]) -> Equations:
        """Return the equations at the same unknowns for another noise of the channels."""
        found = copy(self)
        found.sigma = sigma
        found.normal, found.gradient, found.cost = found._assembled()
        return found

    def _assembled(self) -> tuple[np.ndarray, np.ndarray, float]:
        size, nc = self.layout.size, len(self.layout.names)
        normal, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for _, places, rows, item in self.by_segment():
            w = 1.0 / np.array([self.sigma[name] for name in item.names])
            flat, r = (item.A[rows] * w[:, None]).reshape(-1, len(places)), (item.r[rows] * w).ravel()
            normal[np.ix_(places, places)] += flat.T @ flat
            gradient[places] += flat.T @ r
            cost += float(r @ r)
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

    def by_segment(self):
        """Yield record, places of its unknowns, readings and sensor, segment by segment."""
        for run, setup in enumerate(self.layout.setups):
            starts = setup.problem.starts
            for item in self.seen[run]:
                edges = np.searchsorted(item.k, [*starts, len(setup.problem.time)])
                for j, places in enumerate(self.layout.start_places(run)):
                    if edges[j + 1] > edges[j]:
                        yield run, np.append(places, self.layout.places[run]), slice(edges[j], edges[j + 1]), item

    @cached_property
    def readings(self) -> int:
        """Number of readings."""
        return sum(item.r.size for items in self.seen for item in items)

    def rms(self) -> dict[str, tuple[float, int]]:
        """Return rms residual and number of readings of each channel over all records."""
        squares: dict[str, float] = {}
        count: dict[str, int] = {}
        for items in self.seen:
            for item in items:
                for j, name in enumerate(item.names):
                    squares[name] = squares.get(name, 0.0) + float(item.r[:, j] @ item.r[:, j])
                    count[name] = count.get(name, 0) + len(item.r)
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
