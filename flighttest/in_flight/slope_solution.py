"""Complex least-squares estimates of the terms of a stream, with constraints among them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.parameter_constraints import (
    Constraint,
    ParameterElimination,
    choose_active,
    eliminate,
    rate_constraints,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency.frequency_slopes import demand_frequencies
from flighttest.regression.equation_error.frequency.slope_errors import estimate_slope_errors
from flighttest.regression.equation_error.frequency.spectral_weights import equal_weights
from flighttest.regression.equation_error.frequency.transformed_stretches import TransformedStretch


@dataclass(frozen=True)
class StreamRows:
    """Transforms of all kept samples.

    Attributes
    ----------
    label : str
        Name of the coefficient, for errors.
    terms : sequence of str
    rows : complex array (rows, 1 + terms)
        The coefficient, then the regressors.
    parts : list of TransformedStretch
    largest : array (1 + terms,)
        Largest values of the samples.
    """

    label: str
    terms: Sequence[str]
    rows: np.ndarray
    parts: list[TransformedStretch]
    largest: np.ndarray


@dataclass(frozen=True)
class SlopeSolution:
    """Estimates of some terms.

    Attributes
    ----------
    used : list of int
        Positions of the terms.
    theta : array (used,)
    covariance : array (used, used)
        For the spectrum of the residual, with Student's factor.
    factor : array (used,)
        Student's factor; zero for a term that follows others.
    v : complex array (rows,)
        Residual.
    R2 : float
        Inside the band.
    elimination : ParameterElimination
    information : array (free, free)
    active : list of Constraint
        Constraints that hold as equalities.
    """

    used: list[int]
    theta: np.ndarray
    covariance: np.ndarray
    factor: np.ndarray
    v: np.ndarray
    R2: float
    elimination: ParameterElimination
    information: np.ndarray
    active: list[Constraint]

    @property
    def t_of_last(self) -> float:
        """Estimate of the last term over its standard error, zero if it follows others."""
        if self.factor[-1] == 0.0:
            return 0.0
        stderr = np.sqrt(self.covariance[-1, -1]) / self.factor[-1]
        return float(self.theta[-1] / stderr) if stderr > 0.0 else np.inf


def solve_slopes(
    stream: StreamRows, used: list[int], constraints: Sequence[Constraint]
) -> SlopeSolution:
    """Return the estimates of some terms under constraints, as `regress_frequency` with equal
    weights.

    Parameters
    ----------
    stream : StreamRows
    used : list of int
    constraints : sequence of Constraint
        Among all terms of the stream; a term that is not used is zero.

    Raises
    ------
    IdentificationError
        The rows do not determine the free terms, or the coefficient is constant.
    SchemaError
        No estimate satisfies the constraints.
    """
    among = []
    for constraint in constraints:
        weights = constraint.weights[used]
        if weights.any():
            left = int(np.abs(weights).argmax())
            if constraint.left in used:
                left = used.index(constraint.left)
            among.append(replace(constraint, weights=weights, left=left))
    equalities = [constraint for constraint in among if constraint.is_equality]
    limits = [constraint for constraint in among if not constraint.is_equality]
    held = eliminate(equalities, len(used))
    found = _solve_free(stream, used, held, equalities)
    if limits:
        phi = found.theta[held.free]
        violated = choose_active(limits, held, phi, found.information)
        if violated:
            active = [*equalities, *violated]
            found = _solve_free(stream, used, eliminate(active, len(used)), active)
    return found


def rate_solution(
    stream: StreamRows,
    found: SlopeSolution,
    constraints: Sequence[Constraint],
    refused: Sequence[SlopeSolution] = (),
) -> str:
    """Return the constraints with their contradiction by the stream, as `rate_constraints`.

    Parameters
    ----------
    stream : StreamRows
    found : SlopeSolution
    constraints : sequence of Constraint
    refused : sequence of SlopeSolution
        Trials of further terms that a limit holds out of the model. A constraint that `found` does
        not test is rated by the first of them that does.
    """
    rows = json.loads(_rate_terms(stream, found, constraints))
    for trial in refused:
        for row, tried in zip(rows, json.loads(_rate_terms(stream, trial, constraints))):
            if row["t"] is None and tried["active"]:
                row.update(tried)
    return json.dumps(rows)


def _rate_terms(stream: StreamRows, found: SlopeSolution, constraints: Sequence[Constraint]) -> str:
    """Return the constraints with their contradiction by the terms of one solution."""
    count = len(stream.terms)
    theta, covariance = np.zeros(count), np.zeros((count, count))
    used = found.used
    try:
        alone = _solve_free(stream, used, eliminate([], len(used)), [])
        theta[used], covariance[np.ix_(used, used)] = alone.theta, alone.covariance
    except IdentificationError:
        theta[used] = np.nan
    texts = {constraint.text for constraint in found.active}
    active = [constraint for constraint in constraints if constraint.text in texts]
    return rate_constraints(constraints, active, theta, covariance)


def _solve_free(
    stream: StreamRows,
    used: list[int],
    elimination: ParameterElimination,
    active: list[Constraint],
) -> SlopeSolution:
    """Return the complex least-squares estimate of the free terms, and of those that follow."""
    T = elimination.matrix
    columns = [1 + k for k in used]
    zf, Xf = stream.rows[:, 0], stream.rows[:, columns]
    if not zf.any():
        raise IdentificationError("the coefficient is constant; look at its accelerations")
    demand_frequencies(
        stream.label,
        Xf @ T,
        X=stream.largest[None, columns] @ np.abs(T),
        parts=stream.parts,
        terms=[stream.terms[used[k]] for k in elimination.free],
    )
    whitened = equal_weights(len(zf))
    # The terms follow the free ones: z - X t = X T phi + v.
    z_free, X_free = zf - Xf @ elimination.offset, Xf @ T
    X, z = whitened.equations(X_free), whitened.equations(z_free[:, None])[:, 0]
    phi, E = least_squares.solve_least_squares(X, z)
    v = whitened.residual(z_free, X_free, phi)
    D = least_squares.estimator_matrix(E)
    errors = estimate_slope_errors(v, E, D=D, whitened=whitened, parts=stream.parts)
    factor = np.zeros(len(used))
    factor[elimination.free] = errors.factor
    return SlopeSolution(
        used=used,
        theta=elimination.expand(phi),
        covariance=elimination.expand_covariance(errors.covariance),
        factor=factor,
        v=v,
        R2=1.0 - float((np.abs(v) ** 2).sum() / (np.abs(zf) ** 2).sum()),
        elimination=elimination,
        information=X.T @ X,
        active=active,
    )


def most_explaining(stream: StreamRows, remaining: list[int], found: SlopeSolution) -> int:
    """Return the remaining term that reduces the residual of a solution most."""
    rows, whitened = stream.rows, equal_weights(len(found.v))
    X = rows[:, [1 + k for k in found.used]] @ found.elimination.matrix
    Q = np.linalg.qr(whitened.equations(X))[0]
    residual = whitened.equations(found.v[:, None])[:, 0]
    gains = []
    for k in remaining:
        x = whitened.equations(rows[:, 1 + k, None])[:, 0]
        own = x - Q @ (Q.T @ x)
        size = float(own @ own)
        # A candidate that the terms in the model explain has nothing of its own.
        is_own = size > 1e-12 * float(x @ x)
        gains.append(float(own @ residual) ** 2 / size if is_own else 0.0)
    return remaining[int(np.argmax(gains))]
