"""Multivariate orthogonal functions: candidates ranked by what each adds, as many as lower the predicted squared error.

The functions are made in the order of what they add, each orthogonal to those already chosen (forward orthogonal least
squares).  Made in the order in which the candidates were written down, functions of correlated variables share their
meaning and far too many are kept.  With correlated variables an early choice may be a mixture of later ones: when
nothing more is worth taking, terms that have become void are dropped, and one is exchanged for another candidate as long
as that lowers the error.

References
----------
.. [Morelli1995] Morelli, Global nonlinear aerodynamic modeling using multivariate orthogonal functions, J. Aircraft 32, 1995.
.. [Chen1989] Chen, Billings, Luo, Orthogonal least squares methods and their application to non-linear system
   identification, Int. J. Control 50, 1989.
.. [Barron1984] Barron, Predicted squared error: a criterion for automatic model selection, in Self-Organizing Methods in
   Modeling, 1984.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from .candidates import Equations, equations
from .gram_schmidt import Working
from .selection import Selection, conclude

GAIN = 0.005  # rise of R2 that a further function must bring
_WORTH = 0.05  # of what a term must bring: the fall of the sum of squares that an exchange must bring
_MARGIN = 50.0  # times the variance of the noise that the penalty takes when that is known


def select_orthogonal(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None = None,
    gain: float = GAIN,
    noise: float | None = None,
    keep: Sequence[str] = ("1",),
    name: str = "",
) -> Selection:
    """Choose terms as multivariate orthogonal functions.

    Parameters
    ----------
    coefficient, candidates, data, band, keep, name
        As in `select_stepwise`.
    gain : float
        Rise of R2 that a further function must bring.
    noise : float, optional
        Standard deviation of the coefficient's noise where it is known, from repeats: its variance then sets the penalty
        of the predicted squared error, in place of the variance of the coefficient. [1]

    Returns
    -------
    Selection

    Raises
    ------
    IdentificationError
        Nothing explains the coefficient, or a term to keep does not move.

    Notes
    -----
    PSE = v'v/N + s2_max n/N, s2_max the variance of the coefficient, or 50 times that of the noise but never less than
    the variance of the residual.
    """
    problem = equations(coefficient, candidates, data, band)
    work = Working(problem.X, problem.z)
    kept = [problem.place(term) for term in keep if not (term == "1" and band is not None)]
    rows: list[dict] = []
    rate = Rating(problem.z, band is None, noise)
    for j in kept:
        work.take(j)
        rows.append(rate.row("kept", problem.terms[j], work, np.nan))
    while _forward(problem, work, rate, gain, rows) or _better(problem, work, rate, gain, kept, rows):
        pass
    return conclude("orthogonal functions", problem, work, rows, kept, data, name, drop=True)


def _forward(problem: Equations, work: Working, rate: Rating, gain: float, rows: list[dict]) -> bool:
    """Take the function that adds most, when it adds enough."""
    gains = work.gains()
    j = work.best(gains)
    if len(work.taken) + 2 >= rate.rows or gains[j] <= rate.least(gain, work.rss - gains[j]):
        return False
    partial = float(np.sign(work.product[j]) * np.sqrt(min(1.0, gains[j] / work.rss)))
    work.take(j)
    rows.append(rate.row("taken", problem.terms[j], work, partial))
    return True


def _better(problem: Equations, work: Working, rate: Rating, gain: float, kept: Sequence[int], rows: list[dict]) -> bool:
    """Drop a term that has become void, or exchange one; each lowers the sum of squares plus a price per term."""
    free = [k for k, j in enumerate(work.taken) if j not in kept]
    losses = work.losses()
    weakest = min(free, key=lambda k: losses[k], default=None)
    if weakest is not None and losses[weakest] < rate.least(gain, work.rss):
        gone = work.taken[weakest]
        work.start([j for j in work.taken if j != gone])
        rows.append(rate.row("dropped", problem.terms[gone], work, np.nan, losses[weakest] / rate.variance(work)))
        return True
    place, j, fall = work.exchange(free)
    if fall <= _WORTH * rate.least(gain, work.rss):
        return False
    gone = work.taken[place]
    work.start([k for k in work.taken if k != gone])
    work.take(j)
    rows.append(rate.row("for " + problem.terms[gone], problem.terms[j], work, np.nan))
    return True


class Rating:
    """Measures of a set of terms.

    Parameters
    ----------
    z : array (rows,)
    centred : bool
        Whether R2 counts from the mean of z.
    noise : float, optional
        Standard deviation of the noise of z in time; no use in frequency.

    Raises
    ------
    IdentificationError
        Noise that is not positive, or given for a problem in frequency.
    """

    def __init__(self, z: np.ndarray, centred: bool, noise: float | None = None):
        if noise is not None and not (noise > 0 and centred):
            raise IdentificationError(f"noise is {noise:g}; expected a positive standard deviation, and only in time")
        self.rows, self.noise = len(z), noise
        self.total = float(((z - (z.mean() if centred else 0.0)) ** 2).sum())

    def price(self, rss: float) -> float:
        """Return the fall of the sum of squares that one more term must bring for the PSE to fall."""
        return self.total / self.rows if self.noise is None else max(_MARGIN * self.noise**2, rss / self.rows)

    def least(self, gain: float, rss: float) -> float:
        """Return the fall of the sum of squares that makes a term worth its place."""
        return max(gain * self.total, self.price(rss))

    def variance(self, work: Working) -> float:
        """Return the variance of the residual."""
        return work.rss / max(1, self.rows - len(work.taken))

    def row(self, action: str, term: str, work: Working, partial: float, F: float | None = None) -> dict:
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
