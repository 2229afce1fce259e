"""Candidate terms, and their regressors in time or in a band of frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, ParseError
from flightmech.names import lookup
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency_domain import WEIGHTS
from flighttest.regression.equation_error.model import (
    term_powers,
    term_regressors,
    term_text,
    variable_of,
)
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.equation_error.spectral_weights import whitening_weights
from flighttest.regression.equation_error.time_domain import demand_choice
from flighttest.regression.equation_error.transformed_stretches import (
    select_stretches,
    stack_complex,
    transform_columns,
)

FREE = 2  # frequencies per candidate, from which on the residual of all candidates shows the noise
IDLE = 1e-9  # variation of a column, over its size, below which it is taken for a constant


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
    found = ["1"]
    for size in range(1, order + 1):
        for pick in combinations_with_replacement(variables, size):
            found.append(term_text({name: pick.count(name) for name in dict.fromkeys(pick)}))
    return found


def spline_terms(variable: str, knots: Sequence[float | str], order: int = 1) -> list[str]:
    """Return truncated powers of a variable, one per knot: with the powers up to `order` they make
    a spline.

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
    return [
        term_text({factor: order})
        for knot in knots
        for factor in term_powers(f"ramp({variable},{knot})")
    ]


@lru_cache(maxsize=16)
def _spelled(candidates: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Terms in one spelling, each once, and their variables."""
    terms = tuple(dict.fromkeys(term_text(term_powers(term)) for term in candidates))
    return terms, tuple(
        dict.fromkeys(variable_of(factor) for term in terms for factor in term_powers(term))
    )


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
        Candidates that do not move and are left out.
    band : (low, high) or None
        Of a problem in frequency, where real parts stand above imaginary parts and there is no
        constant. [Hz]
    weights : str
        Of its frequencies, which the rows contain already.
    rows : int
        Independent ones.
    """

    coefficient: str
    terms: tuple[str, ...]
    X: np.ndarray
    z: np.ndarray
    idle: tuple[str, ...]
    band: tuple[float, float] | None
    weights: str
    rows: int

    def place(self, term: str) -> int:
        """Return the row of a candidate."""
        if term not in self.terms:
            why = "it does not move" if term in self.idle else "it is not among the candidates"
            raise IdentificationError(f"{term} is to be kept, but {why}")
        return self.terms.index(term)


def candidate_equations(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None,
    weights: str = "equal",
) -> CandidateEquations:
    """Return the regressors of candidates.

    Parameters
    ----------
    coefficient : str
    candidates : sequence of str
        Terms; ``1`` is left out in frequency.
    data : Dataset (time,) or list of them
    band : (low, high) or None
        None works in time. [Hz]
    weights : {"equal", "spectrum"}
        Of the frequencies of a band; ``spectrum`` is that of the residual of all candidates.

    Raises
    ------
    IdentificationError
        The coefficient is constant, no stretch reaches down to the band, or more candidates than
        the weights allow.
    """
    demand_choice("weights", weights, WEIGHTS if band is not None else ("equal",))
    terms, variables = _spelled(tuple(candidates))
    samples = stack_samples(coefficient, variables, data, f"the candidates of {coefficient}")
    z = samples.data[coefficient].values
    if len(z) < 2 or np.ptp(z) == 0.0:
        raise IdentificationError(
            f"{coefficient} is constant, or has no samples; look at its accelerations"
        )
    X = term_regressors(terms, samples.data)
    fixed = least_squares.intercept_mask(terms)
    top, low = X.max(axis=1), X.min(axis=1)
    moving = top - low > IDLE * np.maximum(np.abs(top), np.abs(low))
    keep, lost = moving | fixed, 0
    if band is not None:
        keep = moving & ~fixed
        parts = select_stretches(samples, band)
        Xf, zf = transform_columns(X[keep].T, parts), transform_columns(z[:, None], parts)
        if weights == "spectrum":
            if len(zf) < FREE * Xf.shape[1]:
                raise IdentificationError(
                    f"{len(zf)} frequencies for {Xf.shape[1]} candidates do not show the "
                    f"spectrum of the noise; weights='spectrum' needs "
                    f"{FREE} per candidate: give fewer candidates, widen the band, or take "
                    f"equal weights"
                )
            whitened = whitening_weights(Xf, zf[:, 0], parts)
            X, z, lost = (
                whitened.equations(Xf).T,
                whitened.equations(zf)[:, 0],
                whitened.ends.shape[1],
            )
        else:
            X, z = stack_complex(Xf).T, stack_complex(zf)[:, 0]
    elif not keep.all():
        X = X[keep]
    return CandidateEquations(
        coefficient,
        tuple(term for term, use in zip(terms, keep) if use),
        np.ascontiguousarray(X),
        z,
        tuple(
            term for term, use, constant in zip(terms, moving, fixed) if not use and not constant
        ),
        band,
        weights,
        len(z) - lost,
    )
