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


_TIE = 1e-9
LEAST = 1e-4  # of a candidate's size that must be left for it to be taken


class OrthogonalBasis:
    """State of a forward selection.

    Parameters
    ----------
    X : array (candidates, rows)
    z : array (rows,)
    """

    def __init__(self, X: np.ndarray, z: np.ndarray):
        self.X, self.z = X, z
        self.size2 = np.einsum("ij,ij->i", X, X)
        self.start(())

    def start(self, taken: Sequence[int]) -> None:
        """Begin anew with given candidates."""
        self.taken: list[int] = []
        self.Q = np.empty((8, len(self.z)))
        self.R: list[np.ndarray] = []
        self.a: list[float] = []
        self.left2 = self.size2.copy()
        self.residual = self.z.copy()
        self.product = self.X @ self.z
        for j in taken:
            self.take(j)

    @property
    def rss(self) -> float:
        """Sum of the squares of the residual."""
        return float(self.residual @ self.residual)

    def gains(self) -> np.ndarray:
        """Return by how much each candidate would lower the sum of squares, (candidates,); zero for
        those it cannot be computed for.
        """
        usable = self.left2 > LEAST**2 * self.size2
        usable[self.taken] = False
        return np.where(usable, self.product**2 / np.where(usable, self.left2, 1.0), 0.0)

    @staticmethod
    def best(gains: np.ndarray) -> int:
        """Return the candidate with the largest gain; of equal ones the first, which a list by
        order has as the simplest.
        """
        return int(np.flatnonzero(gains >= (1.0 - _TIE) * gains.max())[0])

    def take(self, j: int) -> None:
        """Add a candidate; made orthogonal twice, so that rounding does not add up."""
        n = len(self.taken)
        if n == len(self.Q):
            self.Q = np.concatenate([self.Q, np.empty_like(self.Q)])
        known, q, r = self.Q[:n], self.X[j].copy(), np.zeros(n + 1)
        for _ in range(2):
            share = known @ q
            q -= share @ known
            r[:n] += share
        r[n] = np.linalg.norm(q)
        self.Q[n] = q / r[n]
        a = float(self.Q[n] @ self.residual)
        shadow = self.X @ self.Q[n]
        self.left2 -= shadow**2
        self.product -= a * shadow
        self.residual -= a * self.Q[n]
        self.taken.append(j)
        self.R.append(r)
        self.a.append(a)

    @property
    def functions(self) -> np.ndarray:
        """The orthonormal functions, (rows, taken)."""
        return self.Q[: len(self.taken)].T

    @property
    def triangle(self) -> np.ndarray:
        """R with X_taken = Q R, (taken, taken)."""
        n = len(self.taken)
        R = np.zeros((n, n))
        for k, column in enumerate(self.R):
            R[: k + 1, k] = column
        return R

    def estimates(self) -> np.ndarray:
        """Return the parameters of the terms taken, of the orthogonal functions turned back into
        terms.
        """
        return np.linalg.solve(self.triangle, np.array(self.a)) if self.taken else np.zeros(0)

    def losses(self) -> np.ndarray:
        """Return by how much the sum of squares would rise without each of the terms taken,
        (taken,).
        """
        if not self.taken:
            return np.zeros(0)
        return self.estimates() ** 2 / (np.linalg.inv(self.triangle) ** 2).sum(axis=1)

    def exchange(self, places: Sequence[int]) -> tuple[int, int, float]:
        """Return the best exchange of one term taken for one candidate.

        Parameters
        ----------
        places : sequence of int
            Terms taken that may go, by their place in `taken`.

        Returns
        -------
        place, candidate, gain : int, int, float
            The sum of squares would fall by `gain`; zero when no exchange helps.

        Notes
        -----
        A term that goes gives back one direction: the remainder of it when all others are removed.  Along it every
        candidate and the residual have something to regain.
        """
        if not len(places):
            return 0, 0, 0.0
        inverse = np.linalg.inv(self.triangle)[places]
        directions = (inverse / np.linalg.norm(inverse, axis=1, keepdims=True)) @ self.Q[
            : len(self.taken)
        ]
        along, regained = self.X @ directions.T, directions @ self.z
        left2 = self.left2[:, None] + along**2
        usable = left2 > LEAST**2 * self.size2[:, None]
        usable[self.taken] = False
        product = self.product[:, None] + along * regained
        gains = np.where(usable, product**2 / np.where(usable, left2, 1.0), 0.0) - regained**2
        j, k = (int(at) for at in np.unravel_index(int(np.argmax(gains)), gains.shape))
        return places[k], j, max(0.0, float(gains[j, k]))

    def press(self) -> float:
        """Return the sum of squares of the residuals with each row left out in turn, divided by the
        rows.
        """
        leverage = np.einsum("ij,ij->j", self.Q[: len(self.taken)], self.Q[: len(self.taken)])
        return float(np.mean((self.residual / np.maximum(1e-9, 1.0 - leverage)) ** 2))
