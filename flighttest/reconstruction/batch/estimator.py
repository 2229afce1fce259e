"""Maximum-likelihood estimate of a batch fit by Levenberg-Marquardt, with estimated noise."""

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
from flighttest.reconstruction.problem.problem import PathProblem, Sensor
from flighttest.reconstruction.problem.readings import linearise_sensor, states_and_rates
from flighttest.remarks import Convergence

ITERATIONS = 30
ROUNDS = 6  # largest number of estimates of the noise
SAME = 0.05  # relative change of the noise at which its estimate has converged
GAIN = 0.01  # expected decrease of the cost at which the iteration has converged
STIFF = 1e9  # damping from which a step has no effect
FEW = 20  # readings below which a channel keeps the noise of its specification
FAR = 1000.0  # cost per reading above which factors, lags and latencies wait
# Least ratio of the estimated noise to the present one. Why: perfect readings have no residuals.
_LEAST_NOISE = 1e-3
# Damping of the first damped step; a damping below the second value is zero.
_FIRST_DAMPING = 1e-3
_NO_DAMPING = 1e-6
_MULTIPLIERS = ("factor.", "lag.", "delay.", "scale.")


@dataclass(frozen=True)
class Unknowns:
    """Values of the unknowns, and the paths that follow from the values before.

    Attributes
    ----------
    c : array (nc,)
        Constants.
    starts : list of array (segments, n)
        Starts of the segments, per record.
    paths : list of array (N, n)
        Paths before the last step, per record.
    """

    c: np.ndarray
    starts: list[np.ndarray]
    paths: list[np.ndarray]

    def after_step(
        self, layout: BatchUnknowns, step: np.ndarray, paths: list[np.ndarray]
    ) -> Unknowns:
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
        Samples of the segment.
    readings : Readings
        Readings along the path of the segment. Derivatives are by the unknowns of the segment.
    """

    names: tuple[str, ...]
    segment: int
    samples: slice
    readings: Readings


@dataclass(frozen=True)
class Sums:
    """Sums over the readings of one sensor in one segment.

    Attributes
    ----------
    names : tuple of str
        Channels.
    places : array (u,)
        Indices of the unknowns of the segment among all unknowns.
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
    """Normal equations of the readings of all records, weighted by the noise of the channels.

    Parameters
    ----------
    layout : BatchUnknowns
    at : Unknowns
        Values of the unknowns to linearise about.
    sigma : dict of float
        Standard deviation of the noise of each channel.
    """

    def __init__(self, layout: BatchUnknowns, at: Unknowns, sigma: dict[str, float]):
        self.layout, self.at, self.sigma = layout, at, sigma
        self.paths: list[np.ndarray] = []
        self.sums: list[Sums] = []
        for run in range(len(layout.setups)):
            path, places = self.linearise_path(run)
            self.paths.append(path.x)
            for part in self.segment_readings(run, path):
                indices = places[part.segment]
                products = driven_products(path.X[part.samples], len(indices), part.readings)
                self.sums.append(Sums(part.names, indices, products, count=len(part.readings.r)))
        self.normal, self.gradient, self.cost = self._weigh_sums()

    def linearise_path(self, run: int) -> tuple[PathSensitivities, list[np.ndarray]]:
        """Return the path of a record with its sensitivities, and the unknowns of each segment.

        The unknowns of a segment are its start, the free constants that drive the path, and the
        other free constants. They are given as indices among all unknowns.
        """
        layout, problem = self.layout, self.layout.setups[run].problem
        places = layout.places[run]
        free = layout.free[places]
        path = path_sensitivities(
            problem,
            self.at.starts[run],
            c=self.at.c[places],
            before=self.at.paths[run],
            free=free,
        )
        constants = places[_order_constants(path.columns, free)]
        return path, [np.append(start, constants) for start in layout.start_places(run)]

    def segment_readings(self, run: int, path: PathSensitivities) -> Iterator[SegmentReadings]:
        """Yield the linearised readings of a record along its path, segment by segment."""
        layout, problem = self.layout, self.layout.setups[run].problem
        places = layout.places[run]
        c = self.at.c[places]
        # column of each constant among the unknowns of a segment; -1 for constants that are fixed
        order = _order_constants(path.columns, layout.free[places])
        column_of = np.full(len(c), -1)
        column_of[order] = problem.states + np.arange(len(order))
        values = states_and_rates(problem, path.x, c)
        for sensor in problem.sensors:
            yield from _sensor_segments(problem, sensor, values, c=c, column_of=column_of)

    def with_noise(self, sigma: dict[str, float]) -> BatchEquations:
        """Return the equations at the same unknowns for another noise of the channels."""
        equations = copy(self)
        equations.sigma = sigma
        equations.normal, equations.gradient, equations.cost = equations._weigh_sums()
        return equations

    def _weigh_sums(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Return normal matrix, gradient and cost of readings and priors."""
        size, nc = self.layout.size, len(self.layout.names)
        normal, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for item in self.sums:
            weight = 1.0 / np.array([self.sigma[name] for name in item.names]) ** 2
            total = np.tensordot(weight, item.products, 1)
            normal[np.ix_(item.places, item.places)] += total[:-1, :-1]
            gradient[item.places] += total[:-1, -1]
            cost += float(total[-1, -1])
        information = self.layout.prior_information()
        deviation = self.at.c - self.layout.mean
        normal[:nc, :nc] += information
        gradient[:nc] += information @ deviation
        cost += float(deviation @ information @ deviation)
        # The prior of a start is wide. It prevents drift of a start that no reading determines.
        for run, setup in enumerate(self.layout.setups):
            weight = 1.0 / setup.problem.start_sigma**2
            deviation = self.at.starts[run] - setup.x[setup.problem.starts]
            places = self.layout.start_places(run)
            normal[places, places] += weight
            gradient[places] += weight * deviation
            cost += float((weight * deviation**2).sum())
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
        channels = {}
        for name, total in squares.items():
            channels[name] = (float(np.sqrt(total / count[name])), count[name])
        return channels

    def step(self, damping: float, held: np.ndarray) -> tuple[np.ndarray, float]:
        """Return a Levenberg-Marquardt step (size,) and the decrease of the cost that it promises.

        Parameters
        ----------
        damping : float
            Addition to the diagonal of the normal matrix, scaled to unit diagonal.
        held : array of bool (nc,)
            Constants that do not move in this step.
        """
        movable = self.layout.moving
        movable = movable[~np.isin(movable, np.flatnonzero(held))]
        normal = self.normal[np.ix_(movable, movable)]
        scale = 1.0 / np.sqrt(np.diag(normal))
        scaled = normal * np.outer(scale, scale) + damping * np.eye(len(movable))
        step = np.zeros(self.layout.size)
        step[movable] = -scale * np.linalg.solve(scaled, scale * self.gradient[movable])
        return step, float(-2.0 * self.gradient @ step - step @ self.normal @ step)


def _sensor_segments(
    problem: PathProblem, sensor: Sensor, values: np.ndarray, c: np.ndarray, column_of: np.ndarray
) -> Iterator[SegmentReadings]:
    """Yield the linearised readings of one sensor, segment by segment."""
    r, k, f, J, columns, Jc = linearise_sensor(problem, sensor, values, c)
    for segment, samples in enumerate(window_slices(problem)):
        rows = slice(*np.searchsorted(k, [samples.start, samples.stop]))
        if rows.stop <= rows.start:
            continue
        # One derivative may belong to all readings.
        state_slopes = J
        if len(J) != 1:
            state_slopes = J[rows]
        readings = Readings(
            r=r[rows],
            k=k[rows] - samples.start,
            f=f[rows],
            A=state_slopes,
            columns=column_of[columns],
            J=Jc[rows],
        )
        yield SegmentReadings(sensor.names, segment, samples=samples, readings=readings)


def _order_constants(driving: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the indices of the free constants, with the constants that drive the path first."""
    return np.append(driving, np.setdiff1d(np.flatnonzero(free), driving))


@dataclass(frozen=True)
class BatchSolution:
    """Result of a batch fit.

    Attributes
    ----------
    equations : BatchEquations
        Equations at the estimate.
    sigma : dict of float
        Standard deviation of the noise of each channel in the equations.
    iterations : int
    convergence : Convergence
        End of the rounds of noise. Its change is the largest of a noise over its tolerance of 5 %.
    """

    equations: BatchEquations
    sigma: dict[str, float]
    iterations: int
    convergence: Convergence


def first_equations(layout: BatchUnknowns) -> BatchEquations:
    """Return the equations at the start.

    Paths follow from the readings, constants have their first values, and the noise is as
    specified.
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
    equations : BatchEquations
        Equations at the start.

    Raises
    ------
    IdentificationError
        No step lowers the cost, or the iteration does not converge.

    Notes
    -----
    The cost is J = 1/2 sum over channels [r'r/R + N ln R]. For a given noise R, Levenberg-Marquardt
    estimates the unknowns. Then R = r'r/N, until R changes by less than 5 %.
    """
    iterations = 0
    for number in range(1, ROUNDS + 1):
        equations, count = _minimise_cost(equations)
        iterations += count
        sigma = _estimate_noise(equations)
        change = max(abs(sigma[name] / equations.sigma[name] - 1.0) for name in sigma)
        convergence = Convergence(change < SAME, number, change / SAME)
        if convergence.converged:
            break
        equations = equations.with_noise(sigma)
    return BatchSolution(equations, equations.sigma, iterations, convergence)


def _estimate_noise(equations: BatchEquations) -> dict[str, float]:
    """Return the rms residual of each channel; channels with few readings keep their noise."""
    sigma = {}
    for name, (rms, count) in equations.rms().items():
        present = equations.sigma[name]
        estimate = present
        if count >= FEW:
            estimate = rms
        sigma[name] = max(estimate, _LEAST_NOISE * present)
    return sigma


def _minimise_cost(equations: BatchEquations) -> tuple[BatchEquations, int]:
    """Return the equations at the minimum for the present noise, and the number of iterations."""
    layout = equations.layout
    multiplies = np.array([name.startswith(_MULTIPLIERS) for name in layout.names])
    damping, fresh = 0.0, False
    for count in range(1, ITERATIONS + 1):
        far = equations.cost > FAR * equations.readings
        step, gain = equations.step(damping, multiplies & far)
        # in units of the noise that the residuals will show
        tolerance = GAIN * max(1.0, equations.cost / equations.readings)
        trial = _step_equations(equations, step)
        if trial is not None and trial.cost <= equations.cost + tolerance:
            equations, fresh = trial, False
            if damping > _NO_DAMPING:
                damping /= 10.0
            else:
                damping = 0.0
            if gain < tolerance and not far:
                return equations, count
        elif not fresh:
            # Weakly path-dependent terms belong to the path before. Evaluate them at this path.
            equations, fresh = _step_equations(equations, 0.0 * step) or equations, True
        else:
            damping = max(10.0 * damping, _FIRST_DAMPING)
            if damping > STIFF:
                raise IdentificationError(
                    "the batch fit finds no better path from its start; check signs, units "
                    "and positions of the sensors"
                )
    raise IdentificationError(
        f"the batch fit did not settle in {ITERATIONS} iterations; see which constants the "
        f"readings do not determine (`visible`)"
    )


def _step_equations(equations: BatchEquations, step: np.ndarray) -> BatchEquations | None:
    """Return the equations after a step; None if the path leaves the range of Euler angles."""
    after = equations.at.after_step(equations.layout, step, equations.paths)
    trial = BatchEquations(equations.layout, after, equations.sigma)
    if not np.isfinite(trial.cost):
        return None
    return trial
