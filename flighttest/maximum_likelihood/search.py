"""Search for the maximum of a likelihood whose noise covariance is unknown.

For independent Gaussian noise of variance R_j on output j, the best R_j for given parameters is the
mean square of the residual. With this R_j the negative log-likelihood [Maine1985]_ becomes

    J = sum_j N_j/2 ln R_j(theta) + 1/2 (theta - theta_0)' P^-1 (theta - theta_0)

Its gradient is that of weighted least squares with the present R. The Gauss-Newton matrix
M = sum S'R^-1 S + P^-1 is its Fisher information. One Levenberg-Marquardt search therefore replaces
the usual relaxation between parameters and R [Jategaonkar]_, and J falls in every step.

A small step alone proves nothing: strong damping makes every step small. The search has converged
when the step *without* damping, M^-1 times the gradient, is below `PROVEN` standard errors of every
unknown. When no step lowers J although that step is larger than `ROUNDED`, the search has stalled.

References
----------
.. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA
   RP-1138, 1985.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.likelihood import (
    CONVERGED,
    EXHAUSTED,
    STALLED,
    LikelihoodMaximum,
    Target,
)
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.regression.uncertainty.collinearity import describe_combination

STEP = 0.05  # step of a difference, in standard errors
# Where no step lowers the cost, friction or another kink may spoil the slopes: wider differences,
# by this factor each time, average over it.
_WIDER, _WIDENINGS = 4.0, 2
SMALL, LARGE = 1e-6, 1e-2  # its limits, in sizes of the parameter
_FIRST_STEP = 1e-4  # step of the first differences, in sizes of the parameter
_LEAST_SIZE = 1e-2  # smallest size of a parameter without prior and bounds
CLOSE = 1e-2  # a step of so many standard errors is the last one
PROVEN = 0.05  # largest step without damping at a maximum, in standard errors
# Where rounding or a kink of the model ends the fall of J, the largest step that may remain, in
# standard errors: an error of this size adds 4 % to the standard error.
ROUNDED = 0.3
_NOTHING = 1e-3  # fall of J by a small step that counts as none
RANK = 1e-12  # smallest eigenvalue of the information scaled to unit diagonal
_LEAST_EIGENVALUE = 1e-14  # of the scaled information that is inverted
# damping of Levenberg and Marquardt: first value, factors of a change, and limits
_DAMPING, _RAISE, _LOWER = 1e-3, 10.0, 0.1
_LEAST_DAMPING, _STUCK = 1e-12, 1e12


class _Trial(NamedTuple):
    """Parameters to try, with the damping of their step."""

    theta: np.ndarray
    damping: float
    is_first: bool


def maximise_likelihood(
    likelihood: Target, iterations: int, start: np.ndarray | None = None
) -> LikelihoodMaximum:
    """Return the maximum of a likelihood by Levenberg-Marquardt steps inside bounds.

    Parameters
    ----------
    likelihood : Target
    iterations : int
        Largest number of iterations.
    start : array (unknown,), optional
        First parameters, instead of ``likelihood.layout.start``, which stays the prior.

    Raises
    ------
    IdentificationError
        The start cannot be simulated, an unknown has no effect, or a combination of unknowns has
        none.
    """
    search = _Search(likelihood, iterations, likelihood.layout.start if start is None else start)
    search.simulate_start()
    search.form_equations()
    while not search.stop:
        search.take_step()
        search.form_equations()
        search.judge()
    return search.result()


class _Search:
    """State of a search by Levenberg-Marquardt steps.

    Attributes
    ----------
    theta, residuals, slopes, cost
        Of the last accepted parameters.
    M, g : array (unknown, unknown), (unknown,)
        Information and downhill gradient there.
    steps : array (unknown,)
        Steps of the differences.
    active : array of bool (unknown,)
        Unknowns at a bound against which the likelihood pushes.
    """

    def __init__(self, likelihood: Target, iterations: int, start: np.ndarray):
        self.likelihood, self.iterations = likelihood, iterations
        self.layout = likelihood.layout
        self.theta, self.size = start.copy(), _parameter_sizes(self.layout)
        self.steps = _FIRST_STEP * self.size
        self.damping, self.count = _DAMPING, 0
        self.stop = "" if iterations else EXHAUSTED
        self.last_was_first = True  # the last accepted step was the first trial
        self.is_near = False  # the last step was small
        self.stuck = 0  # steps in a row that did not lower J
        self.step = STEP
        self.remaining = np.zeros(len(start))

    def simulate_start(self) -> None:
        """Simulate the start values and their slopes."""
        likelihood, is_last = self.likelihood, bool(self.stop)
        likelihood.expect(self.steps, central=is_last)
        self.residuals = likelihood.residuals(self.theta)
        self.cost = likelihood.cost(self.theta, self.residuals)
        if not np.isfinite(self.cost):
            raise IdentificationError(
                "the model cannot be flown through the records from the start values; simulate "
                "them once and look"
            )
        self.slopes = likelihood.slopes(self.theta, self.steps, central=is_last)

    def form_equations(self) -> None:
        """Form the normal equations, and set the next steps of the differences."""
        self.M, self.g = self.likelihood.normal(self.theta, self.residuals, self.slopes)
        demand_effect(self.M, self.layout.names)
        # The steps of the differences are a part of the standard errors, within limits.
        in_stderr = self.step / np.sqrt(np.diag(self.M))
        self.steps = np.clip(in_stderr, SMALL * self.size, LARGE * self.size)
        self.active = _active_bounds(self.theta, self.g, self.layout)

    def take_step(self) -> None:
        """Accept the first trial that does not raise the cost, and simulate its slopes.

        One-sided differences over part of a standard error suffice until a step is small.
        """
        self.count += 1
        self.is_near = False
        likelihood, free = self.likelihood, ~self.active
        stderr = np.where(free, np.sqrt(np.diag(invert_information(self.M, free))), np.inf)
        for trial in _damped_trials(
            self.layout, self.theta, M=self.M, g=self.g, free=free, damping=self.damping
        ):
            is_near = bool((np.abs(trial.theta - self.theta) < CLOSE * stderr).all())
            # Slopes are simulated with the trial only if it is likely to be accepted.
            if trial.is_first and self.last_was_first:
                likelihood.expect(self.steps, central=is_near or self.count == self.iterations)
            residuals = likelihood.residuals(trial.theta)
            cost = likelihood.cost(trial.theta, residuals)
            if cost <= self.cost:
                fall = self.cost - cost
                self.is_near = is_near and fall < CLOSE
                self.stuck = self.stuck + 1 if is_near and fall < _NOTHING else 0
                self.last_was_first = trial.is_first
                self.theta, self.residuals, self.cost = trial.theta, residuals, cost
                self.damping = max(_LOWER * trial.damping, _LEAST_DAMPING)
                break
        else:
            self.stuck += 1
        central = self.is_near or bool(self.stuck) or self.count == self.iterations
        self.slopes = likelihood.slopes(self.theta, self.steps, central=central)

    def judge(self) -> None:
        """Decide whether the search ends here, and why.

        The normal equations are those of central differences if the last step was small or none
        was possible.
        """
        if self.is_near or self.stuck:
            self.remaining, share = self._undamped_step()
            if share < PROVEN or (self.stuck and share < ROUNDED):
                self.stop = CONVERGED
            elif self.stuck > _WIDENINGS:
                self.stop = STALLED
            elif self.stuck:
                self.step *= _WIDER
                self.steps = np.minimum(_WIDER * self.steps, LARGE * self.size)
            # A small step may be one of strong damping: try the full step again.
            self.damping = min(self.damping, _DAMPING)
        if not self.stop and self.count == self.iterations:
            # On a flat ridge steps may stay small without becoming smaller. The last slopes are
            # central, so that they prove a maximum here too.
            self.remaining, share = self._undamped_step()
            self.stop = CONVERGED if share < PROVEN else EXHAUSTED

    def _undamped_step(self) -> tuple[np.ndarray, float]:
        """Return the step without damping, and its largest element in standard errors."""
        return _undamped_step(self.layout, self.theta, M=self.M, g=self.g, free=~self.active)

    def result(self) -> LikelihoodMaximum:
        """Return the maximum, after a check that the records determine all free unknowns."""
        free_names = []
        for name, is_active in zip(self.layout.names, self.active):
            if not is_active:
                free_names.append(name)
        demand_full_rank(self.M[np.ix_(~self.active, ~self.active)], free_names)
        return LikelihoodMaximum(
            theta=self.theta,
            residuals=self.residuals,
            slopes=self.slopes,
            noise=self.likelihood.scatter(self.residuals),
            information=self.M,
            active=self.active,
            cost=self.cost,
            iterations=self.count,
            stop=self.stop,
            remaining=self.remaining,
        )


def full_step(likelihood: Target, end: LikelihoodMaximum) -> tuple[np.ndarray, np.ndarray]:
    """Return the step without damping from the end of a search with other bounds.

    Parameters
    ----------
    likelihood : Target
        The same likelihood inside its own bounds.
    end : LikelihoodMaximum

    Returns
    -------
    step : array (unknown,)
    active : array of bool (unknown,)
        Unknowns at a bound against which the likelihood pushes.
    """
    M, g = likelihood.normal(end.theta, end.residuals, end.slopes)
    active = _active_bounds(end.theta, g, likelihood.layout)
    step, _ = _undamped_step(likelihood.layout, end.theta, M=M, g=g, free=~active)
    return step, active


def _undamped_step(
    layout: UnknownVector, theta: np.ndarray, M: np.ndarray, g: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the step M^-1 g of the free unknowns, and its largest element in standard errors."""
    covariance = invert_information(M, free)
    step = np.where(free, covariance @ np.where(free, g, 0.0), 0.0)
    # A bound that the step would pass is as far as it can go.
    step = np.clip(theta + step, layout.low, layout.high) - theta
    stderr = np.where(free, np.sqrt(np.diag(covariance)), np.inf)
    return step, float(np.max(np.abs(step) / stderr, initial=0.0))


def _damped_trials(
    layout: UnknownVector,
    theta: np.ndarray,
    M: np.ndarray,
    g: np.ndarray,
    free: np.ndarray,
    damping: float,
) -> Iterator[_Trial]:
    """Yield parameters to try, with rising damping and so ever closer to `theta`."""
    is_first = True
    while damping < _STUCK:
        step = np.zeros(len(theta))
        step[free] = _solve_damped(M[np.ix_(free, free)], g[free], damping)
        yield _Trial(np.clip(theta + step, layout.low, layout.high), damping, is_first)
        damping, is_first = _RAISE * damping, False


def _solve_damped(M: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
    """Return the step (M + damping diag(M))^-1 g, computed with a unit diagonal."""
    scale = 1.0 / np.sqrt(np.diag(M))
    return scale * np.linalg.solve(M * np.outer(scale, scale) + damping * np.eye(len(g)), scale * g)


def root_of_inverse(information: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return B with B B' the inverse of the information over the free unknowns.

    Parameters
    ----------
    information : array (unknown, unknown)
    free : array of bool (unknown,)
        The rows of the other unknowns are zero.
    """
    # Scaled to a unit diagonal, eigenvalues of different units are comparable.
    scale = np.where(free, 1.0 / np.sqrt(np.diag(information)), 0.0)
    part = (information * np.outer(scale, scale))[np.ix_(free, free)]
    values, vectors = np.linalg.eigh(part)
    root = np.zeros_like(information)
    root[np.ix_(free, free)] = vectors / np.sqrt(np.maximum(values, _LEAST_EIGENVALUE))
    return scale[:, None] * root


def invert_information(information: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the inverse of the information over the free unknowns; zero for those at a bound."""
    root = root_of_inverse(information, free)
    return root @ root.T


def _parameter_sizes(layout: UnknownVector) -> np.ndarray:
    """Return the size of each unknown: its a-priori stderr, else its range, else its value."""
    # Differences need a step in the unit of the parameter before its standard error is available.
    width = layout.high - layout.low
    by_value = np.maximum(np.abs(layout.start), _LEAST_SIZE)
    by_range = np.where(np.isfinite(width), width, by_value)
    return np.where(np.isfinite(layout.sigma), layout.sigma, by_range)


def _active_bounds(theta: np.ndarray, downhill: np.ndarray, layout: UnknownVector) -> np.ndarray:
    """Return which unknowns are at a bound against which the likelihood pushes."""
    at_low = (theta <= layout.low) & (downhill < 0.0)
    at_high = (theta >= layout.high) & (downhill > 0.0)
    return at_low | at_high


def demand_effect(M: np.ndarray, names: Sequence[str]) -> None:
    """Raise when no output responds to an unknown."""
    idle = [name for name, size in zip(names, np.diag(M)) if not size > 0.0]
    if idle:
        pronoun = "it" if len(idle) == 1 else "them"
        raise IdentificationError(
            f"no output responds to {', '.join(idle)}; leave {pronoun} out, choose other outputs "
            f"or add a manoeuvre that excites them"
        )


def demand_full_rank(M: np.ndarray, names: Sequence[str]) -> None:
    """Raise when a combination of the unknowns changes no output."""
    scale = 1.0 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    if len(values) and values[0] < RANK * values[-1]:
        combination = describe_combination(vectors[:, 0], names)
        raise IdentificationError(
            f"the records cannot distinguish: {combination} changes no output; hold one of them, "
            f"give a prior or add a manoeuvre"
        )
