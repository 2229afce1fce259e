"""Starts of windows of free motion that a search does not settle, and proof of its end."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from flighttest.maximum_likelihood.likelihood import (
    CONVERGED,
    STALLED,
    LikelihoodMaximum,
    Target,
)
from flighttest.maximum_likelihood.search import (
    PROVEN,
    ROUNDED,
    full_step,
    invert_information,
    maximise_likelihood,
)
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.submodels.control_loading.responses.free_response import SURFACE, TRAVEL

ADMITTED = 1.0
"""Largest remaining step of a constant with held starts, which is part of its standard error.

In standard errors. At the kinks of several windows no search may reach `ROUNDED`.
"""

# Iterations of the search with free starts of the windows, and of that with held ones.
_ITERATIONS, _HELD_ITERATIONS = 60, 60
# Most searches with free starts, each of which follows an end that is not proven.
_ROUNDS = 3


class RebuiltTarget(Target, Protocol):
    """A likelihood that can be formed again with other unknowns."""

    def with_layout(self, layout: UnknownVector) -> Target:
        """Return the likelihood with other bounds of its unknowns."""


def search_with_held_starts(
    likelihood: RebuiltTarget, begin: np.ndarray, constants: int, beyond: float
) -> tuple[LikelihoodMaximum, tuple[int, ...]]:
    """Return the end of a search, and the numbers of the windows whose starts it held.

    A search with held starts moves the constants. One with free starts follows, unless this end is
    proven: it may pass the kink at which the first one stalled.

    Parameters
    ----------
    likelihood : RebuiltTarget
    begin : array (unknown,)
        First parameters.
    constants : int
        Number of the first unknowns, which are not those of a window.
    beyond : float
        Cost above which an end that is not proven is not searched further.
    """
    count = 0
    held: tuple[int, ...] = ()
    for _ in range(_ROUNDS):
        maximum = maximise_likelihood(likelihood, _ITERATIONS, begin)
        count += maximum.iterations
        layout, held = hold_starts(likelihood.layout, maximum)
        if held:
            kept = likelihood.with_layout(layout)
            end = maximise_likelihood(kept, _HELD_ITERATIONS, maximum.theta)
            count += end.iterations
            maximum = release_starts(end, likelihood, constants)
        if maximum.converged or maximum.cost > beyond:
            break
        begin = maximum.theta
    if held and not maximum.converged and maximum.cost <= beyond:
        maximum = release_starts(end, likelihood, constants, ADMITTED)
    return replace(maximum, iterations=count), held


def hold_starts(
    layout: UnknownVector, maximum: LikelihoodMaximum
) -> tuple[UnknownVector, tuple[int, ...]]:
    """Return the unknowns with the starts of moving windows held, and these windows.

    Friction holds a control at rest: the likelihood of its start has a kink where one end begins to
    slide, and no gradient vanishes there. A search then stalls, or creeps along the kink until its
    iterations end. The other unknowns may still reach their maximum; `release_starts` proves it.
    No window is held if the search converged. The standard errors are those with free starts.
    """
    if maximum.converged:
        return layout, ()
    moves = steps_in_errors(maximum) > PROVEN
    windows = set()
    for name, is_moving in zip(layout.names, moves):
        kind, _, window = name.partition("@")
        if is_moving and kind in (TRAVEL, SURFACE):
            windows.add(int(window))
    low, high = layout.low.copy(), layout.high.copy()
    for k, name in enumerate(layout.names):
        kind, _, window = name.partition("@")
        if kind in (TRAVEL, SURFACE) and int(window) in windows:
            low[k] = high[k] = maximum.theta[k]
    return replace(layout, low=low, high=high), tuple(sorted(windows))


def release_starts(
    end: LikelihoodMaximum, likelihood: Target, constants: int, largest: float = ROUNDED
) -> LikelihoodMaximum:
    """Return the end of a search with held starts, as one with free starts.

    A start that is held away from its maximum moves the constants. The search has converged only
    if the step without damping of all unknowns moves no constant by more than `largest` standard
    errors.
    """
    step, active = full_step(likelihood, end)
    released = replace(end, remaining=step, active=active)
    share = steps_in_errors(released)[:constants].max(initial=0.0)
    is_proven = end.converged and share < largest
    return replace(released, stop=CONVERGED if is_proven else STALLED)


def steps_in_errors(maximum: LikelihoodMaximum) -> np.ndarray:
    """Return the remaining step of each unknown in standard errors; zero at a bound."""
    stderr = np.sqrt(np.diag(invert_information(maximum.information, ~maximum.active)))
    moves = stderr > 0.0
    return np.where(moves, np.abs(maximum.remaining) / np.where(moves, stderr, 1.0), 0.0)
