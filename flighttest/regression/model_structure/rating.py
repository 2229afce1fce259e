"""x."""

from __future__ import annotations
from collections.abc import Sequence
import numpy as np
import xarray as xr
from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.model import term_powers, term_text
from flighttest.regression.model_structure.orthogonal_basis import LEAST, OrthogonalBasis
from flighttest.regression.model_structure.candidates import (
    FREE,
    CandidateEquations,
    candidate_equations,
)
from flighttest.regression.model_structure.selection import Selection, fit_selected_terms


_MARGIN = 50.0  # times the variance of the noise that the penalty takes when that is known


# of the sum of squares of the coefficient: less is the rounding of the sums, in which terms would
# come and go for ever
_ROUNDING = 1e-18


class Rating:
    """Measures of a set of terms.

    Parameters
    ----------
    problem : Equations
    noise : float, optional
        Standard deviation of the noise of the coefficient in time; no use in frequency.

    Raises
    ------
    IdentificationError
        Noise that is not positive, or given for a problem in frequency.

    Notes
    -----
    s2_max of the predicted squared error bounds the variance of the noise of a row.  Samples in time are correlated, and their residual
    does not show by how much a void term lowers the sum of squares: without `noise` the bound is the variance of the coefficient.
    Spectral ordinates are independent, so that the residual of all candidates, over its degrees of freedom, is the variance of the noise
    whatever is chosen.  Inside a band, where the coefficient moves and there are few rows, the variance of the coefficient would ask of a
    term a hundredth of R2 and more; the bound is the smaller of it and of 50 times the variance of the noise.
    """

    def __init__(self, problem: CandidateEquations, noise: float | None = None):
        centred, z = problem.band is None, problem.z
        if noise is not None and not (noise > 0 and centred):
            raise IdentificationError(
                f"noise is {noise:g}; expected a positive standard deviation, and only in time"
            )
        self.rows = problem.rows
        self.total = float(((z - (z.mean() if centred else 0.0)) ** 2).sum())
        self.most = self.total / self.rows if noise is None else np.inf
        self.noise2 = noise**2 if noise is not None else np.inf if centred else _of_all(problem)

    def price(self, rss: float) -> float:
        """Return the fall of the sum of squares that one more term must bring for the PSE to fall."""
        return min(self.most, max(_MARGIN * self.noise2, rss / self.rows, _ROUNDING * self.total))

    def least(self, gain: float, rss: float) -> float:
        """Return the fall of the sum of squares that makes a term worth its place."""
        return max(gain * self.total, self.price(rss))

    def variance(self, work: OrthogonalBasis) -> float:
        """Return the variance of the residual."""
        return work.rss / max(1, self.rows - len(work.taken))

    def row(
        self, action: str, term: str, work: OrthogonalBasis, partial: float, F: float | None = None
    ) -> dict:
        """Return one step of a selection."""
        n, rss, s2 = len(work.taken), work.rss, self.variance(work)
        if F is None:
            F = work.a[-1] ** 2 / s2 if s2 > 0 else np.inf
        return {
            "action": action,
            "term": term,
            "F": F,
            "partial_correlation": partial,
            "R2": 1.0 - rss / self.total,
            "PSE": rss / self.rows + self.price(rss) * n / self.rows,
            "PRESS": work.press(),
            "terms": n,
        }


def _of_all(problem: CandidateEquations) -> float:
    """The variance of a row that all candidates together do not explain; infinite where there are
    too many of them.
    """
    count, rows = len(problem.X), problem.rows
    if rows < 2 * FREE * count or not count:
        return np.inf
    size = np.linalg.norm(problem.X, axis=1)
    Q, s, _ = np.linalg.svd((problem.X / size[:, None]).T, full_matrices=False)
    Q = Q[:, s > LEAST * s[0]]
    v = problem.z - Q @ (Q.T @ problem.z)
    return float(v @ v) / (rows - Q.shape[1])
