"""Direct search around a place where a search stalled: no derivative is used.

Where a likelihood has sharp bends at unknown places, as with friction by a small rate, its
derivatives need not predict it: no step may lower the cost although the gradient does not vanish.
The cost is then computed at both sides of the place, along every unknown, along every unknown while
the others follow it by regression, and along the eigenvectors of the information.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from flighttest.maximum_likelihood.search import root_of_inverse

# Distances at which the cost is computed, in standard errors. At a smooth maximum, that in the
# middle raises the cost by 0.06.
DISTANCES = (0.05, 0.35, 1.0)
# Change of the cost that does not matter. [nats]
NEGLIGIBLE = 0.05


class CostNeighbourhood(NamedTuple):
    """Cost around a place.

    Attributes
    ----------
    theta : array (unknown,)
        The lowest place that was found, the first one included.
    fall : float
        By how much its cost is lower. [nats]
    width : array (unknown,)
        Largest change of each unknown within which the cost is not higher by more than
        `NEGLIGIBLE`, in standard errors: the next distance at which it is, so an upper limit.
        Infinite if the cost is not higher at the largest distance in some direction.
    """

    theta: np.ndarray
    fall: float
    width: np.ndarray

    @property
    def is_stationary(self) -> bool:
        """Whether no cost is lower, and the cost rises on all sides."""
        return self.fall <= NEGLIGIBLE and bool(np.isfinite(self.width).all())


def look_around(
    cost_at: Callable[[np.ndarray], float],
    theta: np.ndarray,
    cost: float,
    information: np.ndarray,
    free: np.ndarray,
) -> CostNeighbourhood:
    """Return the cost around a place.

    Parameters
    ----------
    cost_at : callable
        Cost of unknowns; infinite where they are not possible.
    theta : array (unknown,)
        The place.
    cost : float
        Its cost.
    information : array (unknown, unknown)
        Information there, which gives the standard errors.
    free : array of bool (unknown,)
        Unknowns that can move.
    """
    best, least = theta, cost
    root = root_of_inverse(information, free)
    stderr = np.where(free, np.sqrt((root**2).sum(axis=1)), np.inf)
    width = np.full(len(theta), DISTANCES[0])
    for direction in _directions(information, root, free):
        for sense in (1.0, -1.0):
            reach = 0.0
            for part, beyond in zip(DISTANCES, (*DISTANCES[1:], np.inf)):
                there = theta + sense * part * direction
                found = cost_at(there)
                if found < least:
                    best, least = there, found
                if found <= cost + NEGLIGIBLE:
                    reach = beyond
            if reach == np.inf:
                width[:] = np.inf
            else:
                width = np.maximum(width, reach * np.abs(direction) / stderr)
        # a lower place is the start of a further search, whatever else there is
        if cost - least > NEGLIGIBLE:
            break
    return CostNeighbourhood(best, cost - least, width)


def _directions(
    information: np.ndarray, root: np.ndarray, free: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield steps of one standard error each; `root` is that of the inverse of the information."""
    covariance = root @ root.T
    for k in np.flatnonzero(free):
        yield covariance[:, k] / np.sqrt(covariance[k, k])
    for k in np.flatnonzero(free):
        alone = np.zeros(len(free))
        alone[k] = 1.0 / np.sqrt(information[k, k])
        yield alone
    yield from root[:, free].T
