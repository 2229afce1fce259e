"""Multivariate orthogonal functions: candidates ranked by what each adds, as many as lower the
predicted squared error.

The functions are made in the order of what they add, each orthogonal to those already chosen
(forward orthogonal least squares).  Made in the order in which the candidates were written down,
functions of correlated variables share their meaning and far too many are kept.  With correlated
variables an early choice may be a mixture of later ones: when nothing more is worth taking, terms
that have become void are dropped, and one is exchanged for another candidate as long as that lowers
the error.

References
----------
.. [Morelli1995] Morelli, Global nonlinear aerodynamic modeling using multivariate orthogonal functions, J. Aircraft 32, 1995.
.. [Chen1989] Chen, Billings, Luo, Orthogonal least squares methods and their application to non-linear system
   identification, Int. J. Control 50, 1989.
.. [Barron1984] Barron, Predicted squared error: a criterion for automatic model selection, in Self-Organizing Methods in
   Modeling, 1984.
"""

from __future__ import annotations
from flighttest.regression.model_structure.rating import Rating

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

GAIN = 0.005  # rise of R2 that a further function must bring
_WORTH = (
    0.05  # of what a term must bring: the fall of the sum of squares that an exchange must bring
)


def select_orthogonal(
    coefficient: str,
    candidates: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float] | None = None,
    gain: float = GAIN,
    noise: float | None = None,
    keep: Sequence[str] = ("1",),
    name: str = "",
    weights: str = "equal",
) -> Selection:
    """Choose terms as multivariate orthogonal functions.

    Parameters
    ----------
    coefficient, candidates, data, band, keep, name, weights
        As in `select_stepwise`.
    gain : float
        Rise of R2 that a further function must bring.
    noise : float, optional
        Standard deviation of the coefficient's noise where it is known, from repeats: its variance
        then sets the penalty of the predicted squared error, in place of the variance of the
        coefficient. [1]

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
    the variance of the residual.  In frequency see `Rating`.
    """
    problem = candidate_equations(coefficient, candidates, data, band, weights)
    work = OrthogonalBasis(problem.X, problem.z)
    kept = [problem.place(term) for term in keep if not (term == "1" and band is not None)]
    rows: list[dict] = []
    rate = Rating(problem, noise)
    for j in kept:
        work.take(j)
        rows.append(rate.row("kept", problem.terms[j], work, np.nan))
    while _forward(problem, work, rate, gain, rows) or _better(
        problem, work, rate, gain, kept, rows
    ):
        pass
    return fit_selected_terms(
        "orthogonal functions", problem, work, rows, kept, data, name, drop=True
    )


def _forward(
    problem: CandidateEquations, work: OrthogonalBasis, rate: Rating, gain: float, rows: list[dict]
) -> bool:
    """Take the function that adds most, when it adds enough."""
    gains = work.gains()
    j = work.best(gains)
    if len(work.taken) + 2 >= rate.rows or gains[j] <= rate.least(gain, work.rss - gains[j]):
        return False
    partial = float(np.sign(work.product[j]) * np.sqrt(min(1.0, gains[j] / work.rss)))
    work.take(j)
    rows.append(rate.row("taken", problem.terms[j], work, partial))
    return True


def _better(
    problem: CandidateEquations,
    work: OrthogonalBasis,
    rate: Rating,
    gain: float,
    kept: Sequence[int],
    rows: list[dict],
) -> bool:
    """Drop a term that has become void, or exchange one; each lowers the sum of squares plus a
    price per term.
    """
    free = [k for k, j in enumerate(work.taken) if j not in kept]
    losses = work.losses()
    weakest = min(free, key=lambda k: losses[k], default=None)
    if weakest is not None and losses[weakest] < rate.least(gain, work.rss):
        gone = work.taken[weakest]
        work.start([j for j in work.taken if j != gone])
        rows.append(
            rate.row(
                "dropped", problem.terms[gone], work, np.nan, losses[weakest] / rate.variance(work)
            )
        )
        return True
    return exchange_term(problem, work, rate, gain, kept, rows)


def exchange_term(
    problem: CandidateEquations,
    work: OrthogonalBasis,
    rate: Rating,
    gain: float,
    kept: Sequence[int],
    rows: list[dict],
) -> bool:
    """Exchange one term for another candidate where that lowers the sum of squares enough; return
    whether it did.
    """
    before, taken = work.rss, work.taken
    least = _WORTH * rate.least(gain, before)
    place, j, fall = work.exchange([k for k, one in enumerate(taken) if one not in kept])
    if fall <= least:
        return False
    gone = taken[place]
    work.start([k for k in taken if k != gone])
    work.take(j)
    if (
        before - work.rss <= least
    ):  # two that do the same: `fall`, a difference of large sums, was their rounding
        work.start(taken)
        return False
    rows.append(rate.row("for " + problem.terms[gone], problem.terms[j], work, np.nan))
    return True


# partial F: the theoretical 4 for residuals that are white, and a factor of 5 because they are not
ENTER = 20.0
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
        Partial F above which a term enters and below which it leaves; default 20 and 0.9 of the
        first.
    gain : float
        Rise of R2 that a further term must bring.
    keep : sequence of str
        Terms that are in from the start and stay; in frequency ``1`` is found at the end whatever
        is given here.
    hierarchy : bool
        A product enters only after the candidates that it is a product of.
    name : str
        For reports and provenance.
    weights : {"equal", "spectrum"}
        Of the frequencies of a band, as in `regress_frequency`; the spectrum is that of the
        residual of all candidates.

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
            f"F to enter {enter:g}, to leave {leave:g}; expected 0 < leave <= enter, or "
            f"terms would come and go for ever"
        )
    problem = candidate_equations(coefficient, candidates, data, band, weights)
    kept = [problem.place(term) for term in keep if not (term == "1" and band is not None)]
    work, rate = OrthogonalBasis(problem.X, problem.z), Rating(problem)
    rows: list[dict] = []
    for j in kept:
        work.take(j)
        rows.append(rate.row("kept", problem.terms[j], work, np.nan))
    parents = _parents(problem) if hierarchy else None
    while True:
        while (best := _next(work, rate, enter, gain, parents)) is not None:
            j, partial = (
                best,
                float(
                    np.sign(work.product[best]) * np.sqrt(min(1.0, work.gains()[best] / work.rss))
                ),
            )
            work.take(j)
            rows.append(rate.row("entered", problem.terms[j], work, partial))
            while (weak := _weakest(work, rate, kept, leave)) is not None:
                place, F = weak
                work.start([k for k in work.taken if k != place])
                rows.append(rate.row("removed", problem.terms[place], work, np.nan, F))
        if hierarchy or not exchange_term(problem, work, rate, gain, kept, rows):
            break
    return fit_selected_terms("stepwise", problem, work, rows, kept, data, name, drop=False)


def _next(
    work: OrthogonalBasis, rate: Rating, enter: float, gain: float, parents: list[set[int]] | None
) -> int | None:
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
    return (
        j
        if partial_F > enter and gains[j] > gain * rate.total and gains[j] > rate.price(after)
        else None
    )


def _weakest(
    work: OrthogonalBasis, rate: Rating, kept: Sequence[int], leave: float
) -> tuple[int, float] | None:
    """The term in the model with the smallest partial F, when that is too small."""
    s2 = rate.variance(work)
    if s2 == 0.0:
        return None
    F = work.losses() / s2
    F[[j in kept for j in work.taken]] = np.inf
    k = int(np.argmin(F))
    return (work.taken[k], float(F[k])) if F[k] < leave else None


def _parents(problem: CandidateEquations) -> list[set[int]]:
    """For every candidate the candidates with one factor less."""
    places = {term: j for j, term in enumerate(problem.terms)}
    found = []
    for term in problem.terms:
        factors = term_powers(term)
        lower = [
            term_text({f: p - (f == less) for f, p in factors.items() if p - (f == less)})
            for less in factors
        ]
        found.append({places[one] for one in lower if one in places and one != "1"})
    return found
