"""Candidate terms, and their regressors in time or in a frequency band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, ParseError
from flightmech.names import lookup
from flighttest.parameter_constraints import eliminate, parse_constraints
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency.frequency_domain import WEIGHTS
from flighttest.regression.equation_error.frequency.spectral_weights import whitening_weights
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    select_stretches,
    stack_complex,
    transform_columns,
)
from flighttest.regression.equation_error.model import (
    term_powers,
    term_regressors,
    term_text,
    variable_of,
)
from flighttest.regression.equation_error.problem import demand_choice, spell_term
from flighttest.regression.equation_error.samples import RegressionSamples, stack_samples
from flighttest.regression.model_structure.candidate_ties import CandidateTies

FREE = 2  # frequencies per candidate, from which on the residual of all candidates is the noise
IDLE = 1e-9  # variation of a column, over its size, up to which it counts as a constant


def monomials(variables: Sequence[str], order: int) -> list[str]:
    """Return all products of variables up to a total order, the constant first.

    Parameters
    ----------
    variables : sequence of str
        Vocabulary names.
    order : int
        Highest sum of powers, 1 to 9.

    Examples
    --------
    >>> monomials(["alpha", "qhat"], 2)
    ['1', 'alpha', 'qhat', 'alpha**2', 'alpha*qhat', 'qhat**2']
    """
    if not 1 <= order <= 9:
        raise IdentificationError(f"order is {order}; allowed: 1 to 9")
    for name in variables:
        lookup(name)
    terms = ["1"]
    for size in range(1, order + 1):
        for factors in combinations_with_replacement(variables, size):
            powers = {name: factors.count(name) for name in dict.fromkeys(factors)}
            terms.append(term_text(powers))
    return terms


def spline_terms(variable: str, knots: Sequence[float | str], order: int = 1) -> list[str]:
    """Return truncated powers of a variable, one per knot.

    Together with the powers up to `order` they form a spline [Klein2006]_.

    Parameters
    ----------
    variable : str
        Vocabulary name.
    knots : sequence of float or str
        Numbers in SI, or texts such as ``"12 deg"``.
    order : {1, 2}
        1 changes the slope at a knot, 2 the curvature.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, 5.3 (splines).

    Examples
    --------
    >>> spline_terms("alpha", [0.1, "12 deg"])
    ['ramp(alpha,0.1)', 'ramp(alpha,0.2094395102)']
    """
    if order not in (1, 2):
        raise ParseError("<model>", 0, f"order {order} of a spline", "1 or 2")
    terms = []
    for knot in knots:
        # The parser converts the knot to SI.
        (ramp,) = term_powers(f"ramp({variable},{knot})")
        terms.append(term_text({ramp: order}))
    return terms


@lru_cache(maxsize=16)
def _parse_candidates(candidates: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the terms in one spelling, each once, and their variables."""
    terms: dict[str, None] = {}
    variables: dict[str, None] = {}
    for candidate in candidates:
        powers = term_powers(candidate)
        terms[term_text(powers)] = None
        variables.update(dict.fromkeys(map(variable_of, powers)))
    return tuple(terms), tuple(variables)


@dataclass(frozen=True)
class CandidateEquations:
    """Candidates and the coefficient as rows of real equations.

    Attributes
    ----------
    coefficient : str
    terms : tuple of str
        Candidates that move.
    X : array (candidates, rows)
    z : array (rows,)
    idle : tuple of str
        Candidates that do not move and are not in `terms`.
    band : (low, high) or None
        Band of a problem in frequency. Its rows are real parts above imaginary parts, and it has
        no constant. [Hz]
    weights : str
        Weights of the frequencies, which the rows contain already.
    rows : int
        Number of independent rows.
    samples : RegressionSamples
        Samples of the rows in time.
    ties : CandidateTies or None
        Constraints among the candidates.
    """

    coefficient: str
    terms: tuple[str, ...]
    X: np.ndarray
    z: np.ndarray
    idle: tuple[str, ...]
    band: tuple[float, float] | None
    weights: str
    rows: int
    samples: RegressionSamples
    ties: CandidateTies | None = None

    def place(self, term: str) -> int:
        """Return the row of a candidate, or of the first one that a term follows."""
        for j in range(len(self.terms)):
            if term in self.followers(j):
                return j
        reason = "it does not move" if term in self.idle else "it is not among the candidates"
        raise IdentificationError(f"{term} is to be kept, but {reason}")

    def followers(self, j: int) -> tuple[str, ...]:
        """Return the terms that enter with a candidate, itself among them."""
        return (self.terms[j],) if self.ties is None else self.ties.followers(j)

    @property
    def available(self) -> set[str]:
        """Terms that a model may have: candidates, and terms that follow them."""
        found: set[str] = set()
        for j in range(len(self.terms)):
            found.update(self.followers(j))
        return found

    @property
    def fixed(self) -> set[str]:
        """Terms with a number that constraints give."""
        return set() if self.ties is None else set(self.ties.names) - self.available

    @property
    def constants(self) -> tuple[str, ...]:
        """Terms that a constraint puts into every model."""
        return () if self.ties is None else self.ties.constants

    @property
    def required(self) -> tuple[str, ...]:
        """Terms that a constraint does not allow to be zero."""
        return () if self.ties is None else self.ties.required

    def model_terms(self, chosen: Sequence[int]) -> list[str]:
        """Return the terms of the model of some candidates."""
        if self.ties is None:
            return [self.terms[j] for j in chosen]
        terms = list(self.constants)
        for j in chosen:
            terms += self.followers(j)
        return list(dict.fromkeys(terms))

    def expand(self, chosen: Sequence[int], phi: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return the terms of the model of some candidates, and their parameters."""
        if self.ties is None:
            return [self.terms[j] for j in chosen], phi
        return self.ties.expand(chosen, phi)


def candidate_equations(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None,
    weights: str = "equal",
    constraints: Sequence[str] = (),
) -> CandidateEquations:
    """Return the regressors of candidates.

    Parameters
    ----------
    coefficient : str
    candidates : sequence of str
        Terms; ``1`` is ignored in frequency.
    data : Dataset (time,) or list of them
    band : (low, high) or None
        Band of a problem in frequency; None for time. [Hz]
    weights : {"equal", "spectrum"}
        Weights of the frequencies of a band; ``spectrum`` is that of the residual of all
        candidates.
    constraints : sequence of str
        Constraints among the candidates, as of `regress`; see `CandidateTies`.

    Raises
    ------
    IdentificationError
        The coefficient is constant, no stretch reaches down to the band, more candidates than the
        weights allow, or a constraint on a candidate that does not move.
    SchemaError
        Constraints that cannot be read, or that contradict each other.
    """
    demand_choice("weights", weights, WEIGHTS if band is not None else ("equal",))
    terms, variables = _parse_candidates(tuple(candidates))
    samples = stack_samples(
        coefficient, variables, data, purpose=f"the candidates of {coefficient}"
    )
    z = samples.data[coefficient].values
    if len(z) < 2 or np.ptp(z) == 0.0:
        raise IdentificationError(
            f"{coefficient} is constant, or has no samples; look at its accelerations"
        )
    X = term_regressors(terms, samples.data)
    is_constant = least_squares.intercept_mask(terms)
    high, low = X.max(axis=1), X.min(axis=1)
    # The limit is relative: a large constant with rounding noise does not move.
    is_moving = high - low > IDLE * np.maximum(np.abs(high), np.abs(low))
    is_used = is_moving | is_constant
    rows = len(z)
    if band is not None:
        is_used = is_moving & ~is_constant
        X, z, rows = _transform_equations(
            X[is_used], z, samples=samples, band=band, weights=weights
        )
    elif not is_used.all():
        X = X[is_used]
    problem = CandidateEquations(
        coefficient=coefficient,
        terms=_select_terms(terms, is_used),
        X=np.ascontiguousarray(X),
        z=z,
        idle=_select_terms(terms, ~is_moving & ~is_constant),
        band=band,
        weights=weights,
        rows=rows,
        samples=samples,
    )
    return _constrain(problem, constraints) if constraints else problem


def _select_terms(terms: Sequence[str], mask: np.ndarray) -> tuple[str, ...]:
    return tuple(term for term, flag in zip(terms, mask) if flag)


def _transform_equations(
    X: np.ndarray,
    z: np.ndarray,
    samples: RegressionSamples,
    band: tuple[float, float],
    weights: str,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return candidates (candidates, rows) and coefficient (rows,) in frequency.

    The third result is the number of independent rows.
    """
    # Complex rows, one per frequency, become two real rows.
    parts = select_stretches(samples, band)
    Xf, zf = transform_columns(X.T, parts), transform_columns(z[:, None], parts)
    if weights == "equal":
        z = stack_complex(zf)[:, 0]
        return stack_complex(Xf).T, z, len(z)
    if len(zf) < FREE * Xf.shape[1]:
        raise IdentificationError(
            f"{len(zf)} frequencies for {Xf.shape[1]} candidates do not show the spectrum of the "
            f"noise; weights='spectrum' needs {FREE} per candidate: give fewer candidates, widen "
            f"the band, or take equal weights"
        )
    whitened = whitening_weights(Xf, zf[:, 0], parts)
    z = whitened.equations(zf)[:, 0]
    # The leakage of the ends of the stretches takes as many rows as it has unknowns.
    return whitened.equations(Xf).T, z, len(z) - whitened.ends.shape[1]


def _constrain(problem: CandidateEquations, constraints: Sequence[str]) -> CandidateEquations:
    """Return the equations of the candidates that equalities leave free."""
    moving = list(problem.terms)
    names = [*moving, *problem.idle]
    parsed = parse_constraints(
        constraints, names, lambda name: spell_term(name, problem.coefficient)
    )
    for constraint in parsed:
        for k in np.flatnonzero(constraint.weights):
            if names[k] in problem.idle:
                raise IdentificationError(
                    f"{names[k]} does not move, and the constraint {constraint.text!r} needs it; "
                    f"leave out the constraint, or give manoeuvres in which it moves"
                )
    parsed = [replace(one, weights=one.weights[: len(moving)]) for one in parsed]
    equalities = [constraint for constraint in parsed if constraint.is_equality]
    held = eliminate(equalities, len(moving))
    X = held.matrix.T @ problem.X
    z = problem.z - held.offset @ problem.X
    is_moving = np.ptp(X, axis=1) > IDLE * np.abs(X).max(axis=1)
    is_constant = least_squares.intercept_mask([moving[k] for k in held.free])
    lost = [moving[k] for k in held.free[~(is_moving | is_constant)]]
    if lost:
        raise IdentificationError(
            f"with the constraints {', '.join(lost)} does not move; leave one of them out"
        )
    return replace(
        problem,
        terms=tuple(moving[k] for k in held.free),
        X=np.ascontiguousarray(X),
        z=z,
        ties=CandidateTies(tuple(moving), tuple(parsed), held),
    )
