"""Constraints among the unknowns of a likelihood: search over the free ones, result for all.

The elimination is that of `parameter_constraints`. A manoeuvre still predicts from all of its
unknowns; its slopes by the free ones are the slopes by all, times the matrix of the elimination. A
limit of one unknown is a bound of the search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.maximum_likelihood.likelihood import LikelihoodMaximum, Target
from flighttest.maximum_likelihood.search import RANK, invert_information
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.parameter_constraints import (
    Constraint,
    ParameterElimination,
    eliminate,
    parse_constraints,
    rate_constraints,
)

_STEP = 1e-4  # step of a difference of an eliminated unknown, of its value
_LEAST = 1e-2  # least value for this step
Covariance = Callable[[LikelihoodMaximum, UnknownVector], np.ndarray]


@dataclass(frozen=True)
class ConstrainedUnknowns:
    """Unknowns of a search, and their relation to all unknowns.

    Attributes
    ----------
    full, layout : UnknownVector
        All unknowns, and the free ones.
    elimination : ParameterElimination
    constraints : tuple of Constraint
    """

    full: UnknownVector
    layout: UnknownVector
    elimination: ParameterElimination
    constraints: tuple[Constraint, ...]

    def wrap(self, pieces: Sequence[Any], kind: type | None = None) -> list[Any]:
        """Return the manoeuvres as functions of their free unknowns.

        Parameters
        ----------
        pieces : sequence
            With ``predict`` and ``slopes`` of all their unknowns.
        kind : type, optional
            Class of the result, a `ConstrainedPiece`.
        """
        if not self.constraints:
            return list(pieces)
        wrapped = []
        for piece, full, free in zip(pieces, self.full.columns, self.layout.columns):
            T = self.elimination.matrix[np.ix_(full, free)]
            t = self.elimination.offset[full]
            chosen = kind
            if chosen is None:
                chosen = PrefetchedPiece if hasattr(piece, "expect") else ConstrainedPiece
            wrapped.append(chosen(piece, T, t))
        return wrapped

    def expand(self, estimates: xr.Dataset) -> xr.Dataset:
        """Return the estimates of all unknowns from those of the free ones.

        A value that constraints fix has the standard error zero. ``information`` is that along the
        constraints.
        """
        if not self.constraints:
            return estimates
        T, full = self.elimination.matrix, self.full
        at_bound = (np.abs(T) @ estimates["active"].values) > 0.0
        covariance = self.elimination.expand_covariance(estimates["covariance"].values)
        white = estimates["stderr_white"].values
        # The correlation of white noise is taken as that of the coloured covariance.
        correlation = estimates["correlation"].values
        by_white = np.nan_to_num(np.outer(white, white)) * correlation
        stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        size = np.where(stderr > 0.0, stderr, np.inf)
        back = np.linalg.pinv(T)
        square = ("parameter", "parameter_")
        unit = np.diag(np.where(np.isfinite(size), 0.0, 1.0))
        variables = {
            "estimate": ("parameter", self.elimination.expand(estimates["estimate"].values)),
            "stderr": ("parameter", np.where(at_bound, np.nan, stderr)),
            "stderr_white": (
                "parameter",
                np.where(at_bound, np.nan, np.sqrt(np.maximum(np.diag(T @ by_white @ T.T), 0.0))),
            ),
            "start": ("parameter", full.start),
            "prior_stderr": ("parameter", full.sigma),
            "low": ("parameter", full.low),
            "high": ("parameter", full.high),
            "active": ("parameter", at_bound.astype(np.int8)),
            "covariance": (square, covariance),
            "correlation": (square, covariance / np.outer(size, size) + unit),
            "information": (square, back.T @ estimates["information"].values @ back),
        }
        names = list(full.names)
        coordinates = {"parameter": names, "parameter_": names}
        return xr.Dataset(variables, coordinates, estimates.attrs)

    def rate(
        self, estimates: xr.Dataset, target: Target, phi: np.ndarray, covariance_of: Covariance
    ) -> xr.Dataset:
        """Return the estimates with the attribute ``constraints`` of `rate_constraints`.

        Without constraints, the first step of the search from the maximum is M^-1 g with the
        information M and the downhill gradient g of all unknowns. It shows by how much the data
        contradict them.

        Parameters
        ----------
        estimates : Dataset (parameter,)
            Of all unknowns.
        target : Target
            Cost of all unknowns.
        phi : array (free unknown,)
            Maximum.
        covariance_of : callable
            From a maximum of all unknowns to its covariance.
        """
        if not self.constraints:
            return estimates
        full, theta = self.full, self.elimination.expand(phi)
        steps = _STEP * np.maximum(np.abs(theta), _LEAST)
        residuals = target.residuals(theta)
        slopes = target.slopes(theta, steps, central=True)
        M, g = target.normal(theta, residuals, slopes)
        nothing = np.full(len(theta), np.nan), np.zeros_like(M)
        found = nothing if _is_singular(M) else None
        if found is None:
            everything = np.ones(len(theta), bool)
            maximum = LikelihoodMaximum(
                theta,
                residuals,
                slopes,
                noise=target.scatter(residuals),
                information=M,
                active=~everything,
                cost=0.0,
                iterations=0,
                stop="",
                remaining=np.zeros(len(theta)),
            )
            step = invert_information(M, everything) @ g
            found = theta + step, covariance_of(maximum, full)
        active = []
        for constraint in self.constraints:
            at_limit = abs(float(constraint.weights @ theta) - constraint.value)
            scale = abs(constraint.value) + float(np.abs(constraint.weights) @ np.abs(theta))
            if constraint.is_equality or at_limit <= 1e-12 * scale:
                active.append(constraint)
        rated = rate_constraints(self.constraints, active, *found)
        return estimates.assign_attrs(constraints=rated)


def constrain_unknowns(full: UnknownVector, texts: Sequence[str]) -> ConstrainedUnknowns:
    """Return the unknowns of a search under constraints.

    Parameters
    ----------
    full : UnknownVector
    texts : sequence of str
        As of `parse_constraints`, with the names of the unknowns.

    Raises
    ------
    SchemaError
        Constraints that cannot be read or contradict each other; an inequality of several
        unknowns; a prior or a bound of an eliminated unknown. One error lists all problems.
    """
    constraints = parse_constraints(texts, full.names)
    elimination = eliminate([item for item in constraints if item.is_equality], len(full.names))
    problems, bounded = [], full
    for constraint in constraints:
        if constraint.is_equality:
            continue
        involved = np.flatnonzero(constraint.weights)
        if len(involved) > 1:
            problems.append(
                f"{constraint.text!r}: a likelihood takes limits of single unknowns; state each "
                f"limit alone"
            )
            continue
        bounded = _limit(bounded, int(involved[0]), constraint)
    for k in np.flatnonzero(~elimination.is_free):
        has_bound = np.isfinite(bounded.low[k]) or np.isfinite(bounded.high[k])
        if np.isfinite(bounded.sigma[k]) or has_bound:
            problems.append(
                f"{full.names[k]} follows from a constraint, and has a prior or a bound as well; "
                f"state those of the parameters on the right side"
            )
    crossed = np.flatnonzero(~(bounded.low < bounded.high))
    problems += [f"{full.names[k]}: its limits leave no value" for k in crossed]
    if problems:
        raise SchemaError("constraints", list(dict.fromkeys(problems)))
    if not constraints:
        return ConstrainedUnknowns(full, full, elimination, ())
    start = np.clip(bounded.start, bounded.low, bounded.high)
    bounded = replace(bounded, start=start)
    layout = _select_free(bounded, elimination)
    expanded = replace(bounded, start=elimination.expand(start[elimination.free]))
    return ConstrainedUnknowns(expanded, layout, elimination, tuple(constraints))


def _limit(vector: UnknownVector, k: int, constraint: Constraint) -> UnknownVector:
    """Return the unknowns with a limit of one of them as a bound."""
    weight, low, high = constraint.weights[k], vector.low.copy(), vector.high.copy()
    limit = constraint.value / weight
    if weight > 0.0:
        low[k] = max(low[k], limit)
    else:
        high[k] = min(high[k], limit)
    return replace(vector, low=low, high=high)


def _select_free(full: UnknownVector, elimination: ParameterElimination) -> UnknownVector:
    """Return the free unknowns, with their positions in every manoeuvre."""
    free, T = elimination.free, elimination.matrix
    columns, bases = [], []
    for own, names in zip(full.columns, full.bases):
        used = np.flatnonzero(T[own].any(axis=0))
        columns.append(used)
        base_of = dict(zip(own.tolist(), names))
        bases.append(tuple(base_of.get(int(free[k]), full.names[free[k]]) for k in used))
    return UnknownVector(
        names=tuple(full.names[k] for k in free),
        bases=tuple(bases),
        columns=tuple(columns),
        start=full.start[free],
        sigma=full.sigma[free],
        low=full.low[free],
        high=full.high[free],
    )


def _is_singular(M: np.ndarray) -> bool:
    """Return whether the information determines no step of all unknowns."""
    size = np.diag(M)
    if not (np.isfinite(M).all() and (size > 0.0).all()):
        return True
    values = np.linalg.eigvalsh(M / np.sqrt(np.outer(size, size)))
    return bool(values[0] < RANK * values[-1])


class ConstrainedPiece:
    """One manoeuvre as a function of its free unknowns."""

    def __init__(self, piece: Any, T: np.ndarray, t: np.ndarray):
        self.piece, self.T, self.t = piece, T, t

    @property
    def measured(self) -> np.ndarray:
        """Readings of the manoeuvre."""
        return self.piece.measured

    def predict(self, values: np.ndarray) -> Any:
        """Return the prediction of the manoeuvre."""
        return self.piece.predict(self.T @ values + self.t)

    def slopes(self, values: np.ndarray, steps: np.ndarray, *central: bool) -> Any:
        """Return the slopes by the free unknowns, along the last axis."""
        all_values = self.T @ values + self.t
        S = self.piece.slopes(all_values, self.all_steps(steps), *central)
        return S @ self.T

    def all_steps(self, steps: np.ndarray) -> np.ndarray:
        """Return the steps of all unknowns; a fixed one has a step whose slope does not count."""
        largest = (np.abs(self.T) * steps).max(axis=1, initial=0.0)
        return np.where(largest > 0.0, largest, _STEP * np.maximum(np.abs(self.t), _LEAST))


class PrefetchedPiece(ConstrainedPiece):
    """One manoeuvre that simulates the slopes of its next prediction together with it."""

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Announce the slopes that follow the next prediction."""
        self.piece.expect(self.all_steps(steps), central)
