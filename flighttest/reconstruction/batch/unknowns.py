"""Where the unknowns of one or many records stand: common constants, constants of single records,
starts of segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.driven_path import DrivenPath
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.problem import PER_RUN, PathProblem, invert_covariance
from flighttest.reconstruction.problem.trajectory import driven_path, driving_constants


@dataclass(frozen=True)
class BatchUnknowns:
    """Unknowns of a batch fit: constants first, then the starts of all segments.

    Attributes
    ----------
    setups : sequence of Setup
        One per record.
    names, units : tuple of str
        Constants; those of a single record carry its number when there are several, ``wind_n.2``.
    mean : array (nc,)
    covariance : array (nc, nc)
        Their prior.
    places : list of array
        Per record: places of its constants among all.
    free : array of bool (nc,)
        Constants to estimate.
    weighed : bool
        Whether the prior takes part; otherwise the free constants come from the readings alone.
    """

    setups: Sequence[Setup]
    names: tuple[str, ...]
    units: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    places: list[np.ndarray]
    free: np.ndarray
    weighed: bool

    def start_places(self, run: int) -> np.ndarray:
        """Return the places of the starts of a record among all unknowns (segments, n)."""
        first = len(self.names) + sum(self._starts(i) for i in range(run))
        return first + np.arange(self._starts(run)).reshape(-1, self.setups[run].problem.states)

    @property
    def size(self) -> int:
        """Number of unknowns, held constants included."""
        return len(self.names) + sum(self._starts(i) for i in range(len(self.setups)))

    @property
    def moving(self) -> np.ndarray:
        """Places of the unknowns that are estimated."""
        return np.append(np.flatnonzero(self.free), np.arange(len(self.names), self.size))

    def prior_information(self) -> np.ndarray:
        """Return the information of the prior on the free constants (nc, nc); zeros where it takes
        no part.
        """
        found = np.zeros((len(self.names), len(self.names)))
        if self.weighed:
            f = np.ix_(self.free, self.free)
            found[f] = invert_covariance(self.covariance[f])
        return found

    def _starts(self, run: int) -> int:
        problem = self.setups[run].problem
        return len(problem.starts) * problem.states


def layout_unknowns(setups: Sequence[Setup], free: Sequence[str] | None) -> BatchUnknowns:
    """Return the layout of the unknowns.

    Parameters
    ----------
    setups : sequence of Setup
    free : sequence of str, optional
        Constants to estimate from the readings alone; without it all, with their prior.

    Raises
    ------
    UnknownName
        `free` holds a name that no record has.
    SchemaError
        `free` is empty of names.
    """
    known = dict.fromkeys(name for setup in setups for name in setup.problem.constants.names)
    for name in free or ():
        if name not in known:
            raise UnknownName(name, known, "constant of the reconstruction")
    if free is not None and not free:
        raise SchemaError(
            "batch reconstruction",
            ["no constant to estimate; name some, or leave `free` out for all"],
        )
    numbered = len(setups) > 1
    labels = [
        [
            f"{name}.{i + 1}" if numbered and name in PER_RUN else name
            for name in setup.problem.constants.names
        ]
        for i, setup in enumerate(setups)
    ]
    names = tuple(dict.fromkeys(label for of_run in labels for label in of_run))
    places = [np.array([names.index(label) for label in of_run]) for of_run in labels]
    mean, covariance, units = (
        np.zeros(len(names)),
        np.zeros((len(names), len(names))),
        [""] * len(names),
    )
    chosen = np.zeros(len(names), bool)
    for setup, at in zip(setups, places, strict=True):
        constants = setup.problem.constants
        mean[at], covariance[np.ix_(at, at)] = constants.mean, constants.covariance
        for place, name, unit in zip(at, constants.names, constants.units, strict=True):
            units[place] = unit
            chosen[place] = free is None or name in free
    return BatchUnknowns(
        setups, names, tuple(units), mean, covariance, places, chosen, free is None
    )


@dataclass(frozen=True)
class PathSensitivities:
    """A path and its sensitivities.

    Attributes
    ----------
    x : array (N, n)
        States, as in `PathProblem`.
    X : array (N, n, n + driving)
        Derivative by the start of the segment that the sample belongs to, then by the driving
        constants.
    columns : array (driving,)
        Places of the driving constants among all constants.
    """

    x: np.ndarray
    X: np.ndarray
    columns: np.ndarray


def window_slices(problem: PathProblem) -> list[slice]:
    """Return the samples of each window."""
    edges = [*problem.starts.tolist(), len(problem.time)]
    return [slice(a, b) for a, b in pairwise(edges)]


def driven_paths(
    problem: PathProblem, c: np.ndarray, before: np.ndarray, columns: np.ndarray
) -> list[DrivenPath]:
    """Return the path of each window for constants c (nc,), what depends on it weakly from the path
    `before` (N, n).
    """
    return [driven_path(problem, before, c, columns, part) for part in window_slices(problem)]


def path_of(
    problem: PathProblem, starts: np.ndarray, c: np.ndarray, before: np.ndarray
) -> np.ndarray:
    """Return the states that follow from the starts of the segments (segments, n) and constants
    (nc,); `before` as in `driven_paths`.
    """
    x = np.empty_like(before)
    for path, part, start in zip(
        driven_paths(problem, c, before, np.zeros(0, int)),
        window_slices(problem),
        starts,
        strict=True,
    ):
        path.follow(start, x[part])
    return x


def path_sensitivities(
    problem: PathProblem, starts: np.ndarray, c: np.ndarray, before: np.ndarray, free: np.ndarray
) -> PathSensitivities:
    """Return states and sensitivities to the constants in the mask `free` (nc,); other arguments as
    `path_of`.
    """
    columns, n = driving_constants(problem, free), problem.states
    x, X = np.empty((len(before), n)), np.empty((len(before), n, n + len(columns)))
    for path, part, start in zip(
        driven_paths(problem, c, before, columns), window_slices(problem), starts, strict=True
    ):
        path.follow(start, x[part], X[part])
    return PathSensitivities(x, X, columns)
