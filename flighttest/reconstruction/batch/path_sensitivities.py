"""The flight path that follows from its start, the constants and the recorded rates and accelerations, with exact sensitivities.

In level axes the kinematics are sums: attitudes are products of the turns between samples, velocity and height are sums
over them.  A small change of attitude, written as a turn delta about the level axes, obeys::

    delta' = -R (change of rates),    delta_v' = delta x R a + R (change of a),    delta_h' = -delta_v_down

so the sensitivity equations are running sums as well, and the kernel takes both in one pass (`flightmech.simulation.driven_path`).
What depends on the path only weakly (Coriolis acceleration, turning of the level axes, fall of gravity with height) is
taken from the path before, and settles with the iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flightmech.simulation.driven_path import DrivenPath

from ..problem.problem import Problem
from ..problem.trajectory import driven_path, driving


@dataclass(frozen=True)
class Sweep:
    """A path and its sensitivities.

    Attributes
    ----------
    x : array (N, n)
        States, as in `Problem`.
    X : array (N, n, n + driving)
        Derivative by the start of the segment that the sample belongs to, then by the driving constants.
    columns : array (driving,)
        Places of the driving constants among all constants.
    """

    x: np.ndarray
    X: np.ndarray
    columns: np.ndarray


def segments(problem: Problem) -> list[slice]:
    """Return the samples of each window."""
    edges = [*problem.starts.tolist(), len(problem.time)]
    return [slice(a, b) for a, b in pairwise(edges)]


def driven_paths(problem: Problem, c: np.ndarray, before: np.ndarray, columns: np.ndarray) -> list[DrivenPath]:
    """Return the path of each window for constants c (nc,), what depends on it weakly from the path `before` (N, n)."""
    return [driven_path(problem, before, c, columns, part) for part in segments(problem)]


def path_of(problem: Problem, starts: np.ndarray, c: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the states that follow from the starts of the segments (segments, n) and constants (nc,); `before` as in `driven_paths`."""
    x = np.empty_like(before)
    for path, part, start in zip(driven_paths(problem, c, before, np.zeros(0, int)), segments(problem), starts, strict=True):
        path.follow(start, x[part])
    return x


def sweep(problem: Problem, starts: np.ndarray, c: np.ndarray, before: np.ndarray, free: np.ndarray) -> Sweep:
    """Return states and sensitivities to the constants in the mask `free` (nc,); other arguments as `path_of`."""
    columns, n = driving(problem, free), problem.states
    x, X = np.empty((len(before), n)), np.empty((len(before), n, n + len(columns)))
    for path, part, start in zip(driven_paths(problem, c, before, columns), segments(problem), starts, strict=True):
        path.follow(start, x[part], X[part])
    return Sweep(x, X, columns)
