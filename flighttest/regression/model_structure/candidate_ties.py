"""Linear constraints among the candidates of a selection.

A term that is not in a model has the parameter zero. Equalities therefore reduce the candidates
before the search: theta = T phi + t gives the regressors X T and the coefficient z - X t. A
remaining candidate stands for all terms that follow it, and these enter together. A term with a
constant t is in every model.

Inequalities act in the fit of the selected terms; the search does not use them. If zeros do not
satisfy one, its terms are in every model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttest.parameter_constraints import (
    Constraint,
    ParameterElimination,
    write_constraint,
)


@dataclass(frozen=True)
class CandidateTies:
    """Constraints of a selection, and the terms that follow each remaining candidate.

    Attributes
    ----------
    names : tuple of str
        Candidates before the elimination.
    constraints : tuple of Constraint
    elimination : ParameterElimination
        Of the equalities; its free parameters are the candidates that remain.
    """

    names: tuple[str, ...]
    constraints: tuple[Constraint, ...]
    elimination: ParameterElimination

    def followers(self, j: int) -> tuple[str, ...]:
        """Return the terms that enter with a remaining candidate, itself among them."""
        return tuple(self.names[k] for k in np.flatnonzero(self.elimination.matrix[:, j]))

    @property
    def constants(self) -> tuple[str, ...]:
        """Terms with a constant part, which are in every model."""
        return tuple(self.names[k] for k in np.flatnonzero(self.elimination.offset))

    @property
    def required(self) -> tuple[str, ...]:
        """Terms of inequalities that zeros do not satisfy."""
        found: list[str] = []
        for constraint in self.constraints:
            if not constraint.is_equality and constraint.value > 0.0:
                found += [self.names[k] for k in np.flatnonzero(constraint.weights)]
        return tuple(dict.fromkeys(found))

    def texts(self, terms: Sequence[str]) -> list[str]:
        """Return the constraints among the terms of a model; the others are zero."""
        texts = []
        for constraint in self.constraints:
            weights = [constraint.weights[self.names.index(term)] for term in terms]
            if np.count_nonzero(weights) == np.count_nonzero(constraint.weights):
                texts.append(constraint.text)
            elif np.any(weights):
                texts.append(write_constraint(constraint, terms, np.array(weights)))
        return texts

    def expand(self, chosen: Sequence[int], phi: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return the terms of a model and their parameters from those of the chosen candidates."""
        T = self.elimination.matrix[:, list(chosen)]
        theta = T @ phi + self.elimination.offset
        is_used = T.any(axis=1) | (self.elimination.offset != 0.0)
        return [name for name, flag in zip(self.names, is_used) if flag], theta[is_used]

    def project(self, chosen: Sequence[int], terms: Sequence[str], d: np.ndarray) -> np.ndarray:
        """Return the change of the parameters of a model that follows that of the free ones."""
        changes = dict(zip(terms, d))
        free = self.elimination.free[list(chosen)]
        phi = np.array([changes.get(self.names[k], 0.0) for k in free])
        moved = self.elimination.matrix[:, list(chosen)] @ phi
        return np.array([moved[self.names.index(term)] for term in terms])
