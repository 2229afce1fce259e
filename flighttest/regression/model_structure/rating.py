"""Predicted squared error and the other measures of a set of terms.

References
----------
.. [Barron1984] Barron, Predicted squared error: a criterion for automatic model selection, in
   Self-Organizing Methods in Modeling, 1984.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.regression.model_structure.candidates import FREE, CandidateEquations
from flighttest.regression.model_structure.orthogonal_basis import LEAST, OrthogonalBasis

_MARGIN = 50.0  # times the variance of the noise: the penalty if the noise is known
# least fall of the sum of squares, of that of the coefficient: below, rounding would exchange terms
# without end
_ROUNDING = 1e-18


class Rating:
    """Measures of a set of terms.

    Parameters
    ----------
    problem : CandidateEquations
    noise : float, optional
        Standard deviation of the noise of the coefficient in time; not allowed in frequency.

    Attributes
    ----------
    rows : int
        Independent rows.
    total : float
        Sum of squares of the coefficient, about its mean in time.
    most : float
        Largest variance of the noise of a row.
    noise2 : float
        Variance of the noise of a row; infinite if it is not known.

    Raises
    ------
    IdentificationError
        Noise that is not positive, or noise of a problem in frequency.

    Notes
    -----
    The predicted squared error [Barron1984]_ is PSE = v'v/N + s2_max n/N, where s2_max bounds the
    variance of the noise of a row.

    Samples in time are correlated. Their residual does not show by how much a void term lowers the
    sum of squares. Without `noise` the bound is the variance of the coefficient.

    Spectral ordinates are independent. The residual of all candidates, over its degrees of freedom,
    is therefore the variance of the noise for every selection. Inside a band the coefficient moves
    and the rows are few. The variance of the coefficient would require a hundredth of R2 and more
    from a term. The bound is the smaller of this variance and 50 times the variance of the noise.
    """

    def __init__(self, problem: CandidateEquations, noise: float | None = None):
        is_in_time, z = problem.band is None, problem.z
        if noise is not None and not (noise > 0 and is_in_time):
            raise IdentificationError(
                f"noise is {noise:g}; expected a positive standard deviation, and only in time"
            )
        self.rows = problem.rows
        mean = z.mean() if is_in_time else 0.0
        self.total = float(((z - mean) ** 2).sum())
        self.most, self.noise2 = self.total / self.rows, np.inf
        if noise is not None:
            self.most, self.noise2 = np.inf, noise**2
        elif not is_in_time:
            self.noise2 = _unexplained_variance(problem)

    def price(self, rss: float) -> float:
        """Return the decrease of the sum of squares with which one more term keeps the PSE."""
        variance = max(_MARGIN * self.noise2, rss / self.rows, _ROUNDING * self.total)
        return min(self.most, variance)

    def least(self, gain: float, rss: float) -> float:
        """Return the least decrease of the sum of squares of a term; `gain` is a rise of R2."""
        return max(gain * self.total, self.price(rss))

    def variance(self, basis: OrthogonalBasis) -> float:
        """Return the variance of the residual."""
        return basis.rss / max(1, self.rows - len(basis.chosen))

    def make_row(
        self,
        action: str,
        term: str,
        basis: OrthogonalBasis,
        partial: float = np.nan,
        F: float | None = None,
    ) -> dict[str, Any]:
        """Return one step of a selection.

        Parameters
        ----------
        action, term : str
        basis : OrthogonalBasis
            State after the step.
        partial : float
            Partial correlation of the term and the coefficient.
        F : float, optional
            Partial F of the term; default that of the last function.
        """
        n, rss, s2 = len(basis.chosen), basis.rss, self.variance(basis)
        if F is None:
            F = basis.a[-1] ** 2 / s2 if s2 > 0 else np.inf
        return {
            "action": action,
            "term": term,
            "F": F,
            "partial_correlation": partial,
            "R2": 1.0 - rss / self.total,
            "PSE": rss / self.rows + self.price(rss) * n / self.rows,
            "PRESS": basis.press(),
            "terms": n,
        }


def _unexplained_variance(problem: CandidateEquations) -> float:
    """Return the residual variance of a row with all candidates; infinite for too many of them."""
    count, rows = len(problem.X), problem.rows
    if rows < 2 * FREE * count or not count:
        return np.inf
    size = np.linalg.norm(problem.X, axis=1)
    Q, s, _ = np.linalg.svd((problem.X / size[:, None]).T, full_matrices=False)
    Q = Q[:, s > LEAST * s[0]]
    v = problem.z - Q @ (Q.T @ problem.z)
    return float(v @ v) / (rows - Q.shape[1])
