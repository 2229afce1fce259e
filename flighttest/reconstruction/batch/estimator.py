"""Normal equations of a batch fit: the information of all readings of all records on the unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.simulation.normal_sums import Readings, driven_products
from flighttest.reconstruction.batch.unknowns import (
    BatchUnknowns,
    PathSensitivities,
    path_sensitivities,
    window_slices,
)
from flighttest.reconstruction.problem.readings import linearise_sensor, states_and_rates


@dataclass(frozen=True)
class Unknowns:
    """Values of the unknowns: constants (nc,), starts of the segments per record (segments, n), and
    paths that led there.
    """

    c: np.ndarray
    starts: list[np.ndarray]
    paths: list[np.ndarray]

    def moved(self, layout: BatchUnknowns, step: np.ndarray, paths: list[np.ndarray]) -> Unknowns:
        """Return the unknowns after a step (size,)."""
        starts = [start + step[layout.start_places(i)] for i, start in enumerate(self.starts)]
        return Unknowns(self.c + step[: len(self.c)], starts, paths)


class SegmentReadings(NamedTuple):
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
        Products of the derivatives of each channel by these unknowns, and of its residual, over the
        readings.
    count : int
        Number of readings of each channel.
    """

    names: tuple[str, ...]
    places: np.ndarray
    products: np.ndarray
    count: int


class BatchEquations:
    """Readings of all records at the present unknowns, weighed by the noise of the channels.

    Parameters
    ----------
    layout : Layout
    at : Unknowns
    sigma : dict of float
        One sigma of the noise of each channel.
    """

    def __init__(self, layout: BatchUnknowns, at: Unknowns, sigma: dict[str, float]):
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

    def swept(self, run: int) -> tuple[PathSensitivities, list[np.ndarray]]:
        """Return the path of a record with its sensitivities, and for each segment the places of
        its unknowns among all.

        The unknowns of a segment are its start, the free constants that drive the path, and the
        other free constants.
        """
        layout, problem = self.layout, self.layout.setups[run].problem
        at = layout.places[run]
        swept = path_sensitivities(
            problem, self.at.starts[run], self.at.c[at], self.at.paths[run], layout.free[at]
        )
        own = at[_order(swept.columns, layout.free[at])]
        return swept, [np.append(start, own) for start in layout.start_places(run)]

    def parts(self, run: int, swept: PathSensitivities) -> Iterator[SegmentReadings]:
        """Yield what the sensors of a record show along its path, segment by segment."""
        layout, problem = self.layout, self.layout.setups[run].problem
        c = self.at.c[layout.places[run]]
        order, place = _order(swept.columns, layout.free[layout.places[run]]), np.full(len(c), -1)
        place[order] = problem.states + np.arange(len(order))
        values = states_and_rates(problem, swept.x, c)
        for sensor in problem.sensors:
            r, k, f, J, columns, Jc = linearise_sensor(problem, sensor, values, c)
            for i, samples in enumerate(window_slices(problem)):
                rows = slice(*np.searchsorted(k, [samples.start, samples.stop]))
                if rows.stop > rows.start:
                    readings = Readings(
                        r[rows],
                        k[rows] - samples.start,
                        f[rows],
                        J if len(J) == 1 else J[rows],
                        place[columns],
                        Jc[rows],
                    )
                    yield SegmentReadings(sensor.names, i, samples, readings)

    def weighed(self, sigma: dict[str, float]) -> BatchEquations:
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
        for run, setup in enumerate(
            self.layout.setups
        ):  # wide, against drift where nothing holds a start
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
        return {
            name: (float(np.sqrt(squares[name] / count[name])), count[name]) for name in squares
        }

    def step(self, damping: float, held: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the step of the unknowns (size,) and what it promises to take off the cost; `held`
        (nc,) stay too.
        """
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


ITERATIONS = 30
ROUNDS = 6  # of the noise
SAME = 0.05  # change of the noise at which it has settled
GAIN = 0.01  # expected change of the cost at which the iteration has settled
STIFF = 1e9  # damping at which no step is left
FEW = 20  # readings below which a channel keeps the noise of its specification
FAR = 1000.0  # cost per reading above which factors, lags and latencies wait
_MULTIPLY = ("factor.", "lag.", "delay.", "scale.")


@dataclass(frozen=True)
class BatchSolution:
    """The last equations, the noise they are weighed with, and the number of iterations."""

    equations: BatchEquations
    sigma: dict[str, float]
    iterations: int


def first_equations(layout: BatchUnknowns) -> BatchEquations:
    """Return the equations at the start: paths from the readings, constants at their first values,
    noise as specified.
    """
    c = layout.mean.copy()
    for setup, places in zip(layout.setups, layout.places, strict=True):
        c[places] = setup.c
    sigma: dict[str, float] = {}
    for setup in layout.setups:
        for sensor in setup.problem.sensors:
            sigma.update(zip(sensor.names, map(float, sensor.sigma), strict=True))
    paths = [setup.x for setup in layout.setups]
    starts = [setup.x[setup.problem.starts].copy() for setup in layout.setups]
    return BatchEquations(layout, Unknowns(c, starts, paths), sigma)


def fit_batch(equations: BatchEquations) -> BatchSolution:
    """Return the maximum-likelihood estimate.

    Parameters
    ----------
    equations : Equations
        At the start.

    Raises
    ------
    IdentificationError
        No step lowers the cost, or the iteration does not settle.

    Notes
    -----
    J = 1/2 sum over channels [r'r/R + N ln R]: for given noise R the unknowns by Levenberg-Marquardt, then R = r'r/N,
    until R changes by less than 5 %.
    """
    count = 0
    for _ in range(ROUNDS):
        equations, used = _settle(equations)
        count += used
        sigma = {
            name: rms if n >= FEW else equations.sigma[name]
            for name, (rms, n) in equations.rms().items()
        }
        sigma = {name: max(value, 1e-3 * equations.sigma[name]) for name, value in sigma.items()}
        change = max(abs(sigma[name] / equations.sigma[name] - 1.0) for name in sigma)
        if change < SAME:
            break
        equations = equations.weighed(sigma)
    return BatchSolution(equations, equations.sigma, count)


def _settle(equations: BatchEquations) -> tuple[BatchEquations, int]:
    layout, damping, fresh = equations.layout, 0.0, False
    multiply = np.array([name.startswith(_MULTIPLY) for name in layout.names])
    for count in range(1, ITERATIONS + 1):
        far = equations.cost > FAR * equations.readings
        step, gain = equations.step(damping, multiply & far)
        enough = GAIN * max(
            1.0, equations.cost / equations.readings
        )  # in terms of the noise that the residuals will show
        trial = _moved(equations, step)
        if trial is not None and trial.cost <= equations.cost + enough:
            equations, fresh = trial, False
            damping = damping / 10.0 if damping > 1e-6 else 0.0
            if gain < enough and not far:
                return equations, count
        elif not fresh:  # the weak terms were those of the path before
            equations, fresh = _moved(equations, 0.0 * step) or equations, True
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > STIFF:
                raise IdentificationError(
                    "the batch fit finds no better path from its start; check signs, units "
                    "and positions of the sensors"
                )
    raise IdentificationError(
        f"the batch fit did not settle in {ITERATIONS} iterations; see which constants the "
        f"readings do not determine (`visible`)"
    )


def _moved(equations: BatchEquations, step: np.ndarray) -> BatchEquations | None:
    """Return the equations after a step; None where the path leaves what Euler angles can show."""
    after = equations.at.moved(equations.layout, step, equations.paths)
    trial = BatchEquations(equations.layout, after, equations.sigma)
    return trial if np.isfinite(trial.cost) else None
