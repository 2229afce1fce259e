"""Order of the unknowns of a batch fit: common constants, constants of one record, starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.driven_path import DrivenPath
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.driving import driven_path, driving_constants
from flighttest.reconstruction.problem.problem import PER_RUN, PathProblem, invert_covariance

# Relative difference up to which two priors are the same, for rounding.
_SAME_PRIOR = 1e-9


@dataclass(frozen=True)
class BatchUnknowns:
    """Unknowns of a batch fit: constants first, then the starts of all segments.

    Attributes
    ----------
    setups : sequence of Setup
        One per record.
    names, units : tuple of str
        Constants. If there are several records, a constant of one record has its number as suffix:
        ``wind_n.2``.
    mean : array (nc,)
        Prior mean of the constants.
    covariance : array (nc, nc)
        Prior covariance of the constants.
    places : list of array
        Per record: indices of its constants among all constants.
    free : array of bool (nc,)
        Constants to estimate.
    weighed : bool
        Whether the prior takes part. Otherwise the free constants follow from the readings alone.
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
        """Return the indices of the starts of a record among all unknowns (segments, n)."""
        # Constants come first, then the starts of the records before.
        first = len(self.names) + sum(map(_count_starts, self.setups[:run]))
        setup = self.setups[run]
        return first + np.arange(_count_starts(setup)).reshape(-1, setup.problem.states)

    @property
    def size(self) -> int:
        """Number of unknowns, fixed constants included."""
        return len(self.names) + sum(map(_count_starts, self.setups))

    @property
    def moving(self) -> np.ndarray:
        """Indices of the unknowns that are estimated."""
        return np.append(np.flatnonzero(self.free), np.arange(len(self.names), self.size))

    def prior_information(self) -> np.ndarray:
        """Return the information of the prior on the free constants (nc, nc).

        It is zero for fixed constants, and for a prior that takes no part.
        """
        information = np.zeros((len(self.names), len(self.names)))
        if self.weighed:
            free = np.ix_(self.free, self.free)
            information[free] = invert_covariance(self.covariance[free])
        return information


def _count_starts(setup: Setup) -> int:
    """Return the number of unknowns in the starts of all segments of a record."""
    return len(setup.problem.starts) * setup.problem.states


def layout_unknowns(setups: Sequence[Setup], free: Sequence[str] | None) -> BatchUnknowns:
    """Return the layout of the unknowns.

    Parameters
    ----------
    setups : sequence of Setup
        One per record.
    free : sequence of str, optional
        Constants to estimate from the readings alone. By default all constants are estimated, with
        their prior.

    Raises
    ------
    UnknownName
        `free` holds a name that no record has.
    SchemaError
        `free` holds no name, or a common constant has different priors.
    """
    _check_free(setups, free)
    labels = []
    for run, setup in enumerate(setups):
        labels.append(_label_constants(setup, run, len(setups)))
    _check_priors(setups, labels)
    names = tuple(dict.fromkeys(chain.from_iterable(labels)))
    nc = len(names)
    mean, covariance = np.zeros(nc), np.zeros((nc, nc))
    units = [""] * nc
    is_free = np.zeros(nc, bool)
    places = []
    for setup, run_labels in zip(setups, labels, strict=True):
        indices = np.array([names.index(label) for label in run_labels])
        places.append(indices)
        constants = setup.problem.constants
        mean[indices] = constants.mean
        covariance[np.ix_(indices, indices)] = constants.covariance
        for i, name, unit in zip(indices, constants.names, constants.units, strict=True):
            units[i] = unit
            is_free[i] = free is None or name in free
    return BatchUnknowns(
        setups,
        names,
        units=tuple(units),
        mean=mean,
        covariance=covariance,
        places=places,
        free=is_free,
        weighed=free is None,
    )


def _check_free(setups: Sequence[Setup], free: Sequence[str] | None) -> None:
    constants: dict[str, None] = {}
    for setup in setups:
        constants |= dict.fromkeys(setup.problem.constants.names)
    for name in free or ():
        if name not in constants:
            raise UnknownName(name, constants, "constant of the reconstruction")
    if free is not None and not free:
        raise SchemaError(
            "batch reconstruction",
            ["no constant to estimate; name some, or leave `free` out for all"],
        )


def _check_priors(setups: Sequence[Setup], labels: Sequence[Sequence[str]]) -> None:
    """Raise SchemaError if two records have different priors of a common constant."""
    first: dict[str, tuple[int, float, float]] = {}
    problems: dict[str, str] = {}
    for run, (setup, run_labels) in enumerate(zip(setups, labels, strict=True), 1):
        constants = setup.problem.constants
        sigma = np.sqrt(np.diag(constants.covariance))
        for name, mean, deviation in zip(run_labels, constants.mean, sigma, strict=True):
            before = first.setdefault(name, (run, mean, deviation))
            if not np.allclose(before[1:], (mean, deviation), rtol=_SAME_PRIOR, atol=0.0):
                problems.setdefault(
                    name,
                    f"prior of {name}: {before[1]:.6g} with standard error {before[2]:.6g} in "
                    f"record {before[0]}, {mean:.6g} with {deviation:.6g} in record {run}; give "
                    f"both records the same [instruments], or reconstruct them separately",
                )
    if problems:
        raise SchemaError("batch reconstruction", list(problems.values()))


def _label_constants(setup: Setup, run: int, runs: int) -> list[str]:
    """Return the names of the constants of a record among the constants of all records."""
    labels = []
    for name in setup.problem.constants.names:
        # Air differs from record to record, instruments do not.
        if runs > 1 and name in PER_RUN:
            name = f"{name}.{run + 1}"
        labels.append(name)
    return labels


@dataclass(frozen=True)
class PathSensitivities:
    """A path and its sensitivities.

    Attributes
    ----------
    x : array (N, n)
        States, as in `PathProblem`.
    X : array (N, n, n + driving)
        Derivative by the start of the segment of the sample, then by the driving constants.
    columns : array (driving,)
        Indices of the driving constants among the constants of the record.
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
    """Return the path of each window for constants c (nc,).

    Terms that depend weakly on the path are computed from the path `before` (N, n).
    """
    parts = window_slices(problem)
    return [driven_path(problem, before, c=c, columns=columns, part=part) for part in parts]


def path_of(
    problem: PathProblem, starts: np.ndarray, c: np.ndarray, before: np.ndarray
) -> np.ndarray:
    """Return the states (N, n) that follow from starts (segments, n) and constants (nc,).

    `before` is as in `driven_paths`.
    """
    x = np.empty_like(before)
    paths = driven_paths(problem, c, before=before, columns=np.zeros(0, int))
    for path, part, start in zip(paths, window_slices(problem), starts, strict=True):
        path.follow(start, x[part])
    return x


def path_sensitivities(
    problem: PathProblem, starts: np.ndarray, c: np.ndarray, before: np.ndarray, free: np.ndarray
) -> PathSensitivities:
    """Return states and their sensitivities to the constants in the mask `free` (nc,).

    The other arguments are as in `path_of`.
    """
    columns, n = driving_constants(problem, free), problem.states
    x = np.empty((len(before), n))
    X = np.empty((len(before), n, n + len(columns)))
    paths = driven_paths(problem, c, before=before, columns=columns)
    for path, part, start in zip(paths, window_slices(problem), starts, strict=True):
        path.follow(start, x[part], X[part])
    return PathSensitivities(x, X, columns)
