"""Search for the maximum of a likelihood whose noise covariance is unknown.

With independent Gaussian noise of variance R_j on output j, the best R_j for given parameters is
the mean square of the residual. Put in, the negative log-likelihood becomes  J = sum_j N_j/2 ln
R_j(theta) + 1/2 (theta - theta_0)' P^-1 (theta - theta_0).  Its gradient is that of weighted least
squares with the present R, and Gauss-Newton's matrix  M = sum S'R^-1 S + P^-1  its Fisher
information.  So one Levenberg-Marquardt search takes the place of the usual relaxation between
parameters and R, and J falls in every step.

References
----------
.. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA RP-1138, 1985.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 4.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from flightmech.errors import IdentificationError, SchemaError
from flighttest.regression.uncertainty.collinearity import describe_combination


class Unknown(NamedTuple):
    """One parameter to estimate.

    Attributes
    ----------
    start : float or None
        First value, and mean of the prior.  None for what a record gives at its first sample, such
        as ``init.alpha``. [SI]
    sigma : float
        Standard error of the a-priori value; infinite when nothing is known. [SI]
    low, high : float
        Bounds. [SI]
    own : bool
        Whether every manoeuvre has a value of its own.
    """

    start: float | None
    sigma: float = math.inf
    low: float = -math.inf
    high: float = math.inf
    own: bool = False


Wanted = Mapping[str, "Unknown | float | tuple"]


@dataclass(frozen=True)
class UnknownVector:
    """All unknowns as one vector.

    Attributes
    ----------
    names : tuple of str
        One per unknown; that of a manoeuvre alone ends in ``@1``, ``@2`` ...
    bases : tuple of tuple of str
        Per manoeuvre the plain names of its unknowns.
    columns : tuple of array of int
        Per manoeuvre their places in the vector.
    start, sigma, low, high : array (unknown,)
    """

    names: tuple[str, ...]
    bases: tuple[tuple[str, ...], ...]
    columns: tuple[np.ndarray, ...]
    start: np.ndarray
    sigma: np.ndarray
    low: np.ndarray
    high: np.ndarray


def lay_out(wanted: Wanted, recorded: Sequence[Mapping[str, float]]) -> UnknownVector:
    """Return the vector of the unknowns.

    Parameters
    ----------
    wanted : mapping of str to Unknown, tuple or float
        A tuple holds the first fields of `Unknown`, a number is the start alone.
    recorded : sequence of mapping of str to float
        Per manoeuvre, what stands for a start of None.

    Raises
    ------
    SchemaError
        Unknowns without a start, outside their bounds, with a prior that is not positive; all at
        once.
    """
    unknowns = {name: _unknown(item) for name, item in wanted.items()}
    problems = [] if unknowns else ["no unknown; name at least one parameter"]
    rows: list[tuple[str, float, Unknown]] = []
    places: list[dict[str, int]] = [{} for _ in recorded]
    for name, unknown in unknowns.items():
        groups = (
            [[k] for k in range(len(recorded))] if unknown.own else [list(range(len(recorded)))]
        )
        for group in groups:
            label = f"{name}@{group[0] + 1}" if unknown.own and len(recorded) > 1 else name
            start = recorded[group[0]].get(name) if unknown.start is None else float(unknown.start)
            problems += _problems(label, start, unknown)
            for k in group:
                places[k][name] = len(rows)
            rows.append((label, math.nan if start is None else start, unknown))
    if problems:
        raise SchemaError("unknowns", problems)
    return UnknownVector(
        tuple(label for label, _, _ in rows),
        tuple(tuple(place) for place in places),
        tuple(np.array(list(place.values()), int) for place in places),
        np.array([start for _, start, _ in rows]),
        *(
            np.array([getattr(unknown, field) for _, _, unknown in rows], float)
            for field in ("sigma", "low", "high")
        ),
    )


def _unknown(item: Unknown | float | tuple) -> Unknown:
    return Unknown(*item) if isinstance(item, tuple) else Unknown(item)


def _problems(label: str, start: float | None, unknown: Unknown) -> list[str]:
    if start is None:
        return [f"{label} has no start, and neither model nor record gives it; give a start"]
    if (
        not math.isfinite(start)
        or not unknown.low < unknown.high
        or not unknown.low <= start <= unknown.high
    ):
        return [
            f"{label} starts at {start:g}, bounds {unknown.low:g} ... {unknown.high:g}; the "
            f"start must be finite and lie between them"
        ]
    if not unknown.sigma > 0.0:
        return [
            f"{label} has a prior standard error of {unknown.sigma:g}; give a positive one, "
            f"or hold the parameter at its value"
        ]
    return []


FLOOR = 1e-7  # smallest residual that counts, of the rms of a measured output about its mean
STEP = 0.05  # step of a difference, in standard errors
SMALL, LARGE = 1e-6, 1e-2  # its limits, in sizes of the parameter
CLOSE = 1e-2  # a step of so many standard errors is the last one
RANK = 1e-12  # smallest eigenvalue of the information scaled to unit diagonal
_DAMPING, _STUCK = 1e-3, 1e12


class Piece(Protocol):
    """One manoeuvre."""

    measured: np.ndarray  # (samples, outputs), NaN where there is no reading

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (samples, outputs) for the unknowns of this manoeuvre; NaN when they
        cannot be flown.
        """

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return their slopes (samples, outputs, unknowns), by central differences when asked."""


@runtime_checkable
class PrefetchedRuns(Protocol):
    """A manoeuvre that flies the slopes of its next prediction with it."""

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Learn which slopes will follow unless the next prediction is discarded."""


@dataclass(frozen=True)
class LikelihoodMaximum:
    """The maximum.

    Attributes
    ----------
    theta : array (unknown,)
    residuals : list of array (samples, outputs)
        Per manoeuvre measured minus predicted, 0 where there is no reading.
    slopes : list of array (samples, outputs, own unknowns)
    noise : array (manoeuvre, output)
        Variance R.
    information : array (unknown, unknown)
        M, prior included.
    active : array of bool (unknown,)
        At a bound against which the likelihood pushes.
    cost : float
        J.
    iterations : int
    converged : bool
    """

    theta: np.ndarray
    residuals: Any
    slopes: Any
    noise: np.ndarray
    information: np.ndarray
    active: np.ndarray
    cost: float
    iterations: int
    converged: bool


class Target(Protocol):
    """What is minimised; what stands for residuals and slopes is its own affair."""

    layout: UnknownVector

    def residuals(self, theta: np.ndarray) -> Any:
        """Return what cost and normal equations are made of."""

    def scatter(self, residuals: Any) -> np.ndarray:
        """Return the variance of the residuals (manoeuvre, output)."""

    def cost(self, theta: np.ndarray, residuals: Any) -> float:
        """Return J, infinite where there is none."""

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Learn which slopes will follow the next residuals, unless the cost rises."""

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> Any:
        """Return the derivatives of the residuals; one-sided differences will do unless `central`."""

    def normal(
        self, theta: np.ndarray, residuals: Any, slopes: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the information M and the downhill gradient."""


class Likelihood:
    """J over pieces.

    Parameters
    ----------
    pieces : sequence of Piece
    layout : Layout
    groups : array of int (manoeuvre,)
        Manoeuvres of one group have one noise covariance.
    """

    def __init__(self, pieces: Sequence[Piece], layout: UnknownVector, groups: np.ndarray):
        self.pieces, self.layout, self.groups = pieces, layout, groups
        self.seen = [np.isfinite(piece.measured) for piece in pieces]
        self.counts = self._grouped([seen.sum(axis=0) for seen in self.seen])
        together = np.concatenate(
            [piece.measured - np.nanmean(piece.measured, axis=0) for piece in pieces]
        )
        self.flown = len(pieces) > 1 and all(isinstance(piece, PrefetchedRuns) for piece in pieces)
        self.floor = (FLOOR * np.maximum(np.sqrt(np.nanmean(together**2, axis=0)), 1e-12)) ** 2

    def _grouped(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        total = np.zeros((self.groups.max() + 1, len(rows[0])))
        for group, row in zip(self.groups, rows):
            total[group] += row
        return total

    def _each(self, evaluate: Callable[[Any, np.ndarray], np.ndarray]) -> list[np.ndarray]:
        """Evaluate every piece, with the columns of its unknowns; those that fly do so together: a
        batch of one fills few processors.
        """
        if not self.flown:
            return list(map(evaluate, self.pieces, self.layout.columns))
        with ThreadPoolExecutor(min(len(self.pieces), os.cpu_count() or 1)) as pool:
            return list(pool.map(evaluate, self.pieces, self.layout.columns))

    def residuals(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return measured minus predicted per piece."""
        predicted = self._each(lambda piece, columns: piece.predict(theta[columns]))
        return [
            np.where(seen, piece.measured - y, 0.0)
            for piece, y, seen in zip(self.pieces, predicted, self.seen)
        ]

    def noise(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return R (group, output)."""
        return np.maximum(
            self._grouped([(v**2).sum(axis=0) for v in residuals]) / np.maximum(self.counts, 1),
            self.floor,
        )

    def scatter(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return R (manoeuvre, output)."""
        return self.noise(residuals)[self.groups]

    def cost(self, theta: np.ndarray, residuals: Sequence[np.ndarray]) -> float:
        """Return J; infinite when a piece could not be flown."""
        total = 0.5 * float((self.counts * np.log(self.noise(residuals))).sum()) + 0.5 * float(
            (self._pull(theta) ** 2).sum()
        )
        return total if np.isfinite(total) else np.inf

    def _pull(self, theta: np.ndarray) -> np.ndarray:
        return (theta - self.layout.start) / self.layout.sigma

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Prepare those pieces that fly slopes with a prediction."""
        for piece, columns in zip(self.pieces, self.layout.columns):
            if isinstance(piece, PrefetchedRuns):
                piece.expect(steps[columns], central)

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> list[np.ndarray]:
        """Return S per piece."""
        made = self._each(
            lambda piece, columns: piece.slopes(theta[columns], steps[columns], central)
        )
        for S, seen in zip(made, self.seen):
            if not seen.all():
                S[~seen] = 0.0
        return made

    def normal(
        self, theta: np.ndarray, residuals: Sequence[np.ndarray], slopes: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the information M and the downhill gradient."""
        M = np.diag(self.layout.sigma**-2.0)
        g = -self._pull(theta) / self.layout.sigma
        noise = self.noise(residuals)
        for columns, group, v, S in zip(self.layout.columns, self.groups, residuals, slopes):
            root = 1.0 / np.sqrt(noise[group])
            X = (S * root[None, :, None]).reshape(-1, S.shape[2])
            M[np.ix_(columns, columns)] += X.T @ X
            g[columns] += X.T @ (v * root).ravel()
        return M, g


def maximise_likelihood(likelihood: Target, iterations: int) -> LikelihoodMaximum:
    """Return the maximum of a likelihood, by Levenberg and Marquardt inside bounds.

    Raises
    ------
    IdentificationError
        The start cannot be flown, an unknown has no effect, or a combination of unknowns has none.
    """
    layout = likelihood.layout
    theta, size = layout.start.copy(), _sizes(layout)
    steps, damping, converged, hopeful, count = 1e-4 * size, _DAMPING, False, True, 0
    likelihood.expect(steps, central=iterations == 0)
    residuals = likelihood.residuals(theta)
    cost = likelihood.cost(theta, residuals)
    if not np.isfinite(cost):
        raise IdentificationError(
            "the model cannot be flown through the records from the start values; simulate "
            "them once and look"
        )
    slopes = likelihood.slopes(theta, steps, central=iterations == 0)
    while True:
        M, g = likelihood.normal(theta, residuals, slopes)
        _demand_effect(M, layout.names)
        steps = np.clip(STEP / np.sqrt(np.diag(M)), SMALL * size, LARGE * size)
        active = _active(theta, g, layout)
        if converged or count == iterations:
            break
        count += 1
        error = np.where(active, np.inf, np.sqrt(np.diag(invert_information(M, ~active))))
        for trial, damped, first in _trials(layout, theta, M, g, ~active, damping):
            near = bool((np.abs(trial - theta) < CLOSE * error).all())
            if first and hopeful:
                likelihood.expect(steps, central=near or count == iterations)
            tried = likelihood.residuals(trial)
            lower = likelihood.cost(trial, tried)
            if lower <= cost:
                converged, hopeful = near and cost - lower < CLOSE, first
                theta, residuals, cost, damping = trial, tried, lower, max(0.1 * damped, 1e-12)
                break
        else:
            converged = True
        # on the way a one-sided difference over a part of the standard error is as good
        slopes = likelihood.slopes(theta, steps, central=converged or count == iterations)
    _demand_rank(
        M[np.ix_(~active, ~active)], [name for name, held in zip(layout.names, active) if not held]
    )
    return LikelihoodMaximum(
        theta, residuals, slopes, likelihood.scatter(residuals), M, active, cost, count, converged
    )


def _trials(
    layout: UnknownVector, theta, M, g, free, damping
) -> Iterator[tuple[np.ndarray, float, bool]]:
    """Give parameters to try, each with its damping, ever closer to `theta`; and whether they are
    the first.
    """
    first = True
    while damping < _STUCK:
        step = np.zeros(len(theta))
        step[free] = _solve(M[np.ix_(free, free)], g[free], damping)
        yield np.clip(theta + step, layout.low, layout.high), damping, first
        damping, first = 10.0 * damping, False


def _solve(M: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
    scale = 1.0 / np.sqrt(np.diag(M))
    return scale * np.linalg.solve(M * np.outer(scale, scale) + damping * np.eye(len(g)), scale * g)


def root_of_inverse(information: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return B with B B' the inverse of the information over the free unknowns."""
    scale = np.where(free, 1.0 / np.sqrt(np.diag(information)), 0.0)
    part = (information * np.outer(scale, scale))[np.ix_(free, free)]
    values, vectors = np.linalg.eigh(part)
    root = np.zeros_like(information)
    root[np.ix_(free, free)] = vectors / np.sqrt(np.maximum(values, 1e-14))
    return scale[:, None] * root


def invert_information(information: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the inverse of the information over the free unknowns; zero for those at a bound."""
    root = root_of_inverse(information, free)
    return root @ root.T


def _sizes(layout: UnknownVector) -> np.ndarray:
    """Size of each unknown: its a-priori standard error, the width of its bounds or its value,
    whichever is there.
    """
    width = layout.high - layout.low
    rough = np.where(np.isfinite(width), width, np.maximum(np.abs(layout.start), 1e-2))
    return np.where(np.isfinite(layout.sigma), layout.sigma, rough)


def _active(theta: np.ndarray, downhill: np.ndarray, layout: UnknownVector) -> np.ndarray:
    return ((theta <= layout.low) & (downhill < 0.0)) | ((theta >= layout.high) & (downhill > 0.0))


def _demand_effect(M: np.ndarray, names: Sequence[str]) -> None:
    idle = [name for name, size in zip(names, np.diag(M)) if not size > 0.0]
    if idle:
        raise IdentificationError(
            f"no output responds to {', '.join(idle)}; leave "
            f"{'it' if len(idle) == 1 else 'them'} out, choose other outputs "
            "or add a manoeuvre that excites them"
        )


def _demand_rank(M: np.ndarray, names: Sequence[str]) -> None:
    scale = 1.0 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    if len(values) and values[0] < RANK * values[-1]:
        raise IdentificationError(
            f"the records cannot distinguish: {describe_combination(vectors[:, 0], names)} changes no "
            f"output; hold one of them, give a prior "
            "or add a manoeuvre"
        )
