"""Search for the maximum of a likelihood with kinks whose places are known.

Friction holds a control at rest up to its own size.  Where the load at the start of a window is as
large as the friction of an end, that end begins to slide: the likelihood has a kink, with other
derivatives on both sides.  Its maximum often lies there, because a hand releases a control where
friction stopped it.  No gradient vanishes at a kink, so a search without knowledge of it zigzags
across until rounding decides where it ends.

Here each kink is a surface y(theta) = -1 or 1 of a ratio y.  A step that would cross one ends on
it.  An iterate on a surface stays there while the derivatives of both sides push towards it; else
it leaves on the side that falls.  On the surfaces the likelihood is smooth, so that Gauss-Newton
steps converge.  Bounds of unknowns are treated alike.  Every step minimises the quadratic model
of the cost with these constraints, an active set [Fletcher1987]_.

References
----------
.. [Fletcher1987] R. Fletcher, Practical methods of optimization, 2nd ed., Wiley 1987, ch. 10, 14.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.likelihood import (
    CONVERGED,
    EXHAUSTED,
    STALLED,
    STATIONARY,
    LikelihoodMaximum,
    Target,
)
from flighttest.maximum_likelihood.search import (
    PROVEN,
    demand_effect,
    demand_full_rank,
    invert_information,
)
from flighttest.submodels.control_loading.responses.direct_search import (
    NEGLIGIBLE,
    look_around,
)
from flighttest.submodels.control_loading.responses.quadratic_model import (
    QuadraticModel,
    updated_bend,
)

# Step without damping at which a search ends, in standard errors: what rounding moves is less.
_SETTLED = 1e-7
# Step below which a fall of the cost is not required, because rounding hides it.
_CLOSE = 1e-3
# Least fall of the cost over that of the quadratic model with which a step is taken at once.
_GOOD = 0.25
# Grid of the unknowns far from the end, in standard errors: the first one, and the factor of a
# finer one where no step on the grid lowers the cost.
_GRID, _FINER, _FINEST = 1e-3, 2.0**-5, 1e-8
# Parts of the full step that are tried.
_PARTS = (0.3, 0.1)
# Iterations after which a search that promises too little ends.
_FAIR = 15
# Damping of Levenberg and Marquardt: first value, factor of a change, least and largest value.
_DAMPING, _RAISE, _LEAST_DAMPING, _STUCK = 1e-3, 10.0, 1e-9, 1e10
# Most rounds in which a step finds the surfaces that it would cross.
_LANDINGS = 8
# Most searches that start where a direct search found a lower cost.
_RESTARTS = 5


class Sides(NamedTuple):
    """Derivatives on both sides of kinks: ratios that have one at -1 and 1.

    Attributes
    ----------
    ratio : array (kink,)
    by_unknown : array (kink, unknowns)
        Derivatives of the ratios.
    pieces : any
        Slopes of the pieces on both sides, private to the likelihood.
    """

    ratio: np.ndarray
    by_unknown: np.ndarray
    pieces: Any


class KinkedTarget(Target, Protocol):
    """A likelihood with kinks."""

    def sides(self, theta: np.ndarray) -> Sides:
        """Return the derivatives on both sides of all kinks."""

    def join_sides(self, sides: Sides, inside: np.ndarray) -> Any:
        """Return the slopes on one side of each kink; `inside` is true for that below 1."""

    def pushes(self, sides: Sides, residuals: Any) -> np.ndarray:
        """Return the downhill derivative by each ratio (kink,) of what acts inside alone."""

    def place(self, theta: np.ndarray, held: Mapping[int, float]) -> np.ndarray:
        """Return unknowns moved so that the ratios of these numbers have these values."""


class _KinkedTrial(NamedTuple):
    """Unknowns to try: the ratios held there, and the fall of the quadratic model."""

    theta: np.ndarray
    held: dict[int, float]
    step: np.ndarray
    expected: float
    damping: float


def maximise_kinked(
    likelihood: KinkedTarget, iterations: int, start: np.ndarray, beyond: float = np.inf
) -> LikelihoodMaximum:
    """Return the maximum of a likelihood with kinks, inside bounds.

    Parameters
    ----------
    likelihood : KinkedTarget
    iterations : int
        Largest number of iterations.
    start : array (unknown,)
        First unknowns.
    beyond : float
        Cost above which a search ends early if no step promises less.

    Returns
    -------
    LikelihoodMaximum
        Its slopes at a kink are those inside, where the control is held.

    Raises
    ------
    IdentificationError
        The start cannot be simulated, an unknown has no effect, or a combination of unknowns has
        none.
    """
    search = _KinkedSearch(likelihood, start)
    while not search.stop:
        search.take_step(iterations, beyond)
    return search.result()


class _KinkedSearch:
    """State of a search.

    Attributes
    ----------
    theta, residuals, cost
        Of the last accepted unknowns.
    held : dict of int to float
        Ratios at a kink, with its side.
    """

    def __init__(self, likelihood: KinkedTarget, start: np.ndarray):
        self.likelihood, self.layout = likelihood, likelihood.layout
        self.theta = start.copy()
        self.residuals = likelihood.residuals(start)
        self.cost = likelihood.cost(start, self.residuals)
        if not np.isfinite(self.cost):
            raise IdentificationError(
                "the model cannot be flown through the records from the start values; simulate "
                "them once and look"
            )
        self.held: dict[int, float] = {}
        self.damping, self.count, self.stop = _DAMPING, 0, ""
        self.grid = _GRID
        self.last_share = np.inf
        self.restarts, self.width = 0, np.zeros(0)
        self.bend = np.zeros((len(start), len(start)))
        self.sides = likelihood.sides(start)
        self.plan = self._settle()

    def take_step(self, iterations: int, beyond: float) -> None:
        """Judge the iterate, and take one step if it is not the end."""
        free = self._free()
        self.errors = self._errors(free)
        self.is_near = False
        full = self._trial(0.0)
        step = self._inside(self.theta + full.step) - self.theta
        self.remaining = np.where(free, step, 0.0)
        share = float(np.max(np.abs(self.remaining) / self.errors, initial=0.0))
        self.is_near = share < _CLOSE
        promised = self.cost - max(full.expected, 0.0)
        hopeless = self.count >= _FAIR and promised > beyond
        if share < _SETTLED:
            self.stop = CONVERGED
        elif self.count == iterations or hopeless:
            self.stop = CONVERGED if share < PROVEN else EXHAUSTED
        if self.stop:
            return
        self.count += 1
        if self.is_near and share < self.last_share:
            # Rounding hides the fall of so small a step; that steps become smaller proves it.
            accepted: _KinkedTrial | None = self._trial(0.0)
        else:
            accepted = self._search_line(full)
        self.last_share = share if self.is_near else np.inf
        if accepted is None and self.grid > _FINEST:
            self.grid *= _FINER
        elif accepted is None and share < PROVEN:
            self.stop = CONVERGED
        elif accepted is None:
            self._look_around(free, beyond)
        else:
            self._accept(accepted)

    def _look_around(self, free: np.ndarray, beyond: float) -> None:
        """Continue from a lower place near a stalled search, or state what its end is.

        Sharp bends at unknown places, as of friction by a small rate, can end a search by
        derivatives.
        """
        self.stop = STALLED
        if self.cost > beyond:
            return

        def cost_at(theta: np.ndarray) -> float:
            return self._cost(self._inside(theta))

        around = look_around(cost_at, self.theta, self.cost, self.plan.M, free)
        if around.is_stationary:
            self.stop, self.width = STATIONARY, around.width
        elif around.fall > NEGLIGIBLE and self.restarts < _RESTARTS:
            self.stop = ""
            self.restarts += 1
            self.theta, self.held = self._inside(around.theta), {}
            self.bend[:] = 0.0
            self.damping, self.grid, self.last_share = _DAMPING, _GRID, np.inf
            self._simulate()
            self.plan = self._settle()

    def _accept(self, trial: _KinkedTrial) -> None:
        before, step = self.plan, trial.theta - self.theta
        self.theta, self.held = trial.theta, trial.held
        self._simulate()
        self.plan = self._settle()
        if np.array_equal(before.inside, self.plan.inside):
            change = before.g - self.plan.g
            self.bend = updated_bend(self.plan.M, self.bend, step, change)
            self.plan = self._settle()

    def _simulate(self) -> None:
        self.residuals = self.likelihood.residuals(self.theta)
        self.cost = self.likelihood.cost(self.theta, self.residuals)
        self.sides = self.likelihood.sides(self.theta)

    def _search_line(self, full: _KinkedTrial) -> _KinkedTrial | None:
        """Return the best of a few steps, or the first damped one that lowers the cost."""
        best, least = None, self.cost
        for trial in self._candidates(full):
            cost = self._cost(trial.theta)
            if cost < least:
                best, least = trial, cost
            if self.cost - cost > _GOOD * trial.expected:
                break
        damping = _RAISE * self.damping
        while best is None and damping < _STUCK:
            trial = self._trial(damping)
            if self._cost(trial.theta) < self.cost:
                best = trial
            damping *= _RAISE
        if best is not None and best.damping > 0.0:
            self.damping = max(best.damping / _RAISE, _LEAST_DAMPING)
        return best

    def _candidates(self, full: _KinkedTrial) -> Iterator[_KinkedTrial]:
        """Yield the full step, the same across all kinks, parts of it, and a damped step."""
        yield full
        across = self._trial(0.0, lands=False)
        if across.held != full.held:
            yield across
        kinks = self.plan.kinks
        for part in _PARTS:
            theta = self._reach(part * across.step, self.plan.bounds, kinks)
            yield _KinkedTrial(theta, kinks, part * across.step, part * across.expected, 0.0)
        yield self._trial(self.damping)

    def _reach(
        self, step: np.ndarray, bounds: Mapping[int, float], held: Mapping[int, float]
    ) -> np.ndarray:
        """Return the unknowns after a step, with these at bounds and these ratios at kinks.

        Far from the end they are rounded to a grid: otherwise the rounding of the linear algebra,
        which grows from step to step, would choose between neighbouring maxima.
        """
        theta = self.theta + step
        if not self.is_near:
            free = np.isfinite(self.errors)
            grid = np.exp2(np.round(np.log2(self.grid * self.errors[free])))
            theta[free] = grid * np.round(theta[free] / grid)
        # Rounding must not move an unknown off its bound.
        theta[list(bounds)] = list(bounds.values())
        return self.likelihood.place(self._inside(theta), held)

    def _cost(self, theta: np.ndarray) -> float:
        """Return the cost; infinite where no start places a ratio at its kink."""
        if not np.isfinite(theta).all():
            return np.inf
        return self.likelihood.cost(theta, self.likelihood.residuals(theta))

    def _inside(self, theta: np.ndarray) -> np.ndarray:
        return np.clip(theta, self.layout.low, self.layout.high)

    def _free(self) -> np.ndarray:
        free = np.ones(len(self.theta), bool)
        free[list(self.plan.bounds)] = False
        return free

    def _errors(self, free: np.ndarray) -> np.ndarray:
        """Return the standard errors of the free unknowns; infinite for those at a bound."""
        covariance = invert_information(self.plan.M, free)
        return np.where(free, np.sqrt(np.diag(covariance)), np.inf)

    def _settle(self) -> QuadraticModel:
        """Return what holds at the iterate: bounds and kinks from which no side leads down.

        One at a time is left, that with the largest multiplier.
        """
        low, high = self.layout.low, self.layout.high
        bounds = {}
        at_bound = np.flatnonzero((self.theta <= low) | (self.theta >= high))
        for number in at_bound.tolist():
            bounds[number] = float(self.theta[number])
        kinks, sides = dict(self.held), self.sides
        inside = np.abs(sides.ratio) < 1.0
        inside[list(kinks)] = True
        pushes = self.likelihood.pushes(sides, self.residuals)
        for _ in range(1 + len(bounds) + len(kinks)):
            plan = self._model(bounds, kinks, inside)
            A, b = self._rows(bounds, kinks)
            _, multipliers, size = plan.solve(A, b, 0.0)
            worst, largest, leaves_outside = None, 0.0, False
            for row, (k, side) in enumerate([*bounds.items(), *kinks.items()]):
                if row < len(bounds):
                    # the multiplier of a lower bound is positive while it holds
                    sign = 1.0 if self.theta[k] <= low[k] else -1.0
                    inwards = outwards = -sign * multipliers[row]
                    if low[k] == high[k]:
                        continue
                else:
                    inwards = side * multipliers[row]
                    outwards = -side * (multipliers[row] + pushes[k])
                pull = max(inwards, outwards) * size[row]
                if pull > largest:
                    worst, largest, leaves_outside = row, pull, outwards > inwards
            if worst is None:
                break
            if worst < len(bounds):
                bounds.pop(list(bounds)[worst])
            else:
                k = list(kinks)[worst - len(bounds)]
                kinks.pop(k)
                inside[k] = not leaves_outside
        return plan

    def _model(
        self, bounds: dict[int, float], kinks: dict[int, float], inside: np.ndarray
    ) -> QuadraticModel:
        """Return the quadratic model on one side of each kink."""
        slopes = self.likelihood.join_sides(self.sides, inside)
        M, g = self.likelihood.normal(self.theta, self.residuals, slopes)
        demand_effect(M, self.layout.names)
        scale = 1.0 / np.sqrt(np.diag(M))
        B = M + self.bend
        values, vectors = np.linalg.eigh(B * np.outer(scale, scale))
        return QuadraticModel(
            slopes,
            M,
            g,
            scale=scale,
            values=values,
            vectors=vectors,
            bounds=bounds,
            kinks=kinks,
            inside=inside,
        )

    def _rows(
        self, bounds: Mapping[int, float], kinks: Mapping[int, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return A and b of the constraints A d = b that bring unknowns and ratios to these."""
        A = np.zeros((len(bounds) + len(kinks), len(self.theta)))
        b = np.zeros(len(A))
        for row, (k, value) in enumerate(bounds.items()):
            A[row, k], b[row] = 1.0, value - self.theta[k]
        for row, (k, value) in enumerate(kinks.items(), start=len(bounds)):
            A[row], b[row] = self.sides.by_unknown[k], value - self.sides.ratio[k]
        return A, b

    def _trial(self, damping: float, lands: bool = True) -> _KinkedTrial:
        """Return the step of the quadratic model that ends on the surfaces it would cross."""
        plan, sides = self.plan, self.sides
        bounds, kinks = dict(plan.bounds), dict(plan.kinks)
        for _ in range(_LANDINGS):
            step, _, _ = plan.solve(*self._rows(bounds, kinks), damping)
            reached = self._inside(self.theta + step)
            passed = np.flatnonzero(reached != self.theta + step)
            fresh = {int(k): float(reached[k]) for k in passed if int(k) not in bounds}
            ratio = sides.ratio + sides.by_unknown @ step
            crossed = {}
            for k in range(len(ratio) if lands else 0):
                side = float(np.sign(ratio[k] if plan.inside[k] else sides.ratio[k]))
                beyond = side * ratio[k] > 1.0
                if k not in kinks and beyond == plan.inside[k]:
                    crossed[k] = side
            if not fresh and not crossed:
                break
            bounds |= fresh
            kinks |= crossed
        expected = float(plan.g @ step - 0.5 * step @ (plan.M + self.bend) @ step)
        return _KinkedTrial(self._reach(step, bounds, kinks), kinks, step, expected, damping)

    def result(self) -> LikelihoodMaximum:
        """Return the maximum, after a check that the records determine all free unknowns."""
        inside = self.plan.inside.copy()
        inside[list(self.held)] = True
        slopes = self.likelihood.join_sides(self.sides, inside)
        M, _ = self.likelihood.normal(self.theta, self.residuals, slopes)
        free = self._free()
        names = [name for name, is_free in zip(self.layout.names, free) if is_free]
        demand_full_rank(M[np.ix_(free, free)], names)
        return LikelihoodMaximum(
            theta=self.theta,
            residuals=self.residuals,
            slopes=slopes,
            noise=self.likelihood.scatter(self.residuals),
            information=M,
            active=~free,
            cost=self.cost,
            iterations=self.count,
            stop=self.stop,
            remaining=self.remaining,
            width=self.width,
        )
