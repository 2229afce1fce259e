"""Stepwise regression: the term with the largest partial correlation enters, terms that have become weak leave, one is exchanged.

A term that enters early may stand for one that is right only next to others: alpha**4 for alpha**3 while a product is still missing.  When
nothing enters or leaves any more, a term is exchanged for another candidate as long as that lowers the sum of squares [Miller1984]_.

References
----------
.. [Miller1984] Miller, Selection of subsets of regression variables, J. Royal Statistical Society A 147, 1984.
.. [Klein1981] Klein, Batterson, Murphy, Determination of airplane model structure from flight data by using modified
   stepwise regression, NASA TP-1916, 1981.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error.model import powers, word
from .candidates import Equations, equations
from .gram_schmidt import Working
from .orthogonal_functions import GAIN, Rating, exchanged
from .selection import Selection, conclude

ENTER = 20.0  # partial F: the theoretical 4 for residuals that are white, and a factor of 5 because they are not
LEAVE = 0.9  # of the threshold to enter


def select_stepwise(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None = None,
    enter: float = ENTER,
    leave: float | None = None,
    gain: float = GAIN,
    keep: Sequence[str] = ("1",),
    hierarchy: bool = False,
    name: str = "",
    weights: str = "equal",
) -> Selection:
    """Choose terms by stepwise regression.

    Parameters
    ----------
    coefficient : str
        Measured coefficient.
    candidates : sequence of str
        Terms; `monomials` and `spline_terms` make lists of them.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them.
    band : (low, high), optional
        Work in frequency, inside this band; default in time. [Hz]
    enter, leave : float
        Partial F above which a term enters and below which it leaves; default 20 and 0.9 of the first.
    gain : float
        Rise of R2 that a further term must bring.
    keep : sequence of str
        Terms that are in from the start and stay; in frequency ``1`` is found at the end whatever is given here.
    hierarchy : bool
        A product enters only after the candidates that it is a product of.
    name : str
        For reports and provenance.
    weights : {"equal", "spectrum"}
        Of the frequencies of a band, as in `regress_frequency`; the spectrum is that of the residual of all candidates.

    Returns
    -------
    Selection

    Raises
    ------
    IdentificationError
        Nothing explains the coefficient, thresholds that are none, or a term to keep does not move.

    Notes
    -----
    F = (fall of the sum of squares)/s^2 with the s^2 of the larger model; partial correlation of a candidate and the
    coefficient, both freed from the terms that are in.  It ends when nothing moves, when R2 rises by less than `gain`, or
    when the predicted squared error would rise; see `Rating`.  As F to leave is at most F to enter, terms cannot come and go for ever
    [Miller1984]_.  With `hierarchy` nothing is exchanged.
    """
    leave = LEAVE * enter if leave is None else leave
    if not 0.0 < leave <= enter:
        raise IdentificationError(
            f"F to enter {enter:g}, to leave {leave:g}; expected 0 < leave <= enter, or terms would come and go for ever"
        )
    problem = equations(coefficient, candidates, data, band, weights)
    kept = [problem.place(term) for term in keep if not (term == "1" and band is not None)]
    work, rate = Working(problem.X, problem.z), Rating(problem)
    rows: list[dict] = []
    for j in kept:
        work.take(j)
        rows.append(rate.row("kept", problem.terms[j], work, np.nan))
    parents = _parents(problem) if hierarchy else None
    while True:
        while (best := _next(work, rate, enter, gain, parents)) is not None:
            j, partial = best, float(np.sign(work.product[best]) * np.sqrt(min(1.0, work.gains()[best] / work.rss)))
            work.take(j)
            rows.append(rate.row("entered", problem.terms[j], work, partial))
            while (weak := _weakest(work, rate, kept, leave)) is not None:
                place, F = weak
                work.start([k for k in work.taken if k != place])
                rows.append(rate.row("removed", problem.terms[place], work, np.nan, F))
        if hierarchy or not exchanged(problem, work, rate, gain, kept, rows):
            break
    return conclude("stepwise", problem, work, rows, kept, data, name, drop=False)


def _next(work: Working, rate: Rating, enter: float, gain: float, parents: list[set[int]] | None) -> int | None:
    """The candidate to enter, or None."""
    if len(work.taken) + 2 >= rate.rows or work.rss <= 0.0:
        return None
    gains = work.gains()
    if parents is not None:
        have = set(work.taken)
        gains[[not need <= have for need in parents]] = 0.0
    j = work.best(gains)
    after = work.rss - gains[j]
    partial_F = gains[j] / (after / (rate.rows - len(work.taken) - 1)) if after > 0 else np.inf
    return j if partial_F > enter and gains[j] > gain * rate.total and gains[j] > rate.price(after) else None


def _weakest(work: Working, rate: Rating, kept: Sequence[int], leave: float) -> tuple[int, float] | None:
    """The term in the model with the smallest partial F, when that is too small."""
    s2 = rate.variance(work)
    if s2 == 0.0:
        return None
    F = work.losses() / s2
    F[[j in kept for j in work.taken]] = np.inf
    k = int(np.argmin(F))
    return (work.taken[k], float(F[k])) if F[k] < leave else None


def _parents(problem: Equations) -> list[set[int]]:
    """For every candidate the candidates with one factor less."""
    places = {term: j for j, term in enumerate(problem.terms)}
    found = []
    for term in problem.terms:
        factors = powers(term)
        lower = [word({f: p - (f == less) for f, p in factors.items() if p - (f == less)}) for less in factors]
        found.append({places[one] for one in lower if one in places and one != "1"})
    return found
