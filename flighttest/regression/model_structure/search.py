"""Selection of terms: multivariate orthogonal functions, and stepwise regression.

Multivariate orthogonal functions [Morelli1995]_ rank the candidates by the decrease of the sum of
squares. As many terms are chosen as lower the predicted squared error [Barron1984]_. The functions
are formed in the order of their gain, each orthogonal to the chosen ones (forward orthogonal least
squares [Chen1989]_). If they were formed in the order of the candidate list, functions of
correlated variables would share their content, and far too many would be chosen.

With correlated variables an early choice may be a mixture of later ones. If no further candidate is
worth its price, void terms are dropped, and one term is exchanged for another candidate as long as
this lowers the error.

References
----------
.. [Morelli1995] Morelli, Global nonlinear aerodynamic modeling using multivariate orthogonal
   functions, J. Aircraft 32, 1995.
.. [Chen1989] Chen, Billings, Luo, Orthogonal least squares methods and their application to
   non-linear system identification, Int. J. Control 50, 1989.
.. [Barron1984] Barron, Predicted squared error: a criterion for automatic model selection, in
   Self-Organizing Methods in Modeling, 1984.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.model import term_powers, term_text
from flighttest.regression.model_structure.candidates import (
    CandidateEquations,
    candidate_equations,
)
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.rating import Rating
from flighttest.regression.model_structure.selection import Selection, fit_selected_terms

GAIN = 0.005  # rise of R2 that a further function must bring
# decrease of the sum of squares that an exchange must bring, of that which a new term must bring
_WORTH = 0.05
# partial F: the theoretical 4 for residuals that are white, and a factor of 5 because they are not
ENTER = 20.0
LEAVE = 0.9  # of the threshold to enter


class _StructureSearch:
    """State of a selection: the basis, its steps, and the terms that must stay."""

    def __init__(
        self,
        problem: CandidateEquations,
        keep: Sequence[str],
        gain: float,
        noise: float | None = None,
    ):
        self.problem, self.gain = problem, gain
        self.basis = OrthogonalBasis(problem.X, problem.z)
        self.steps: list[dict[str, Any]] = []
        self.required: list[int] = []
        for term in keep:
            # The constant of a model in frequency is estimated at the end.
            if term != "1" or problem.band is None:
                self.required.append(problem.place(term))
        self.rating = Rating(problem, noise)
        for j in self.required:
            self.basis.add(j)
            self.note("kept", j)

    def note(self, action: str, j: int, partial: float = np.nan, F: float | None = None) -> None:
        """Record a step that the basis has made."""
        term = self.problem.terms[j]
        self.steps.append(
            self.rating.make_row(action, term, basis=self.basis, partial=partial, F=F)
        )

    def add(self, action: str, j: int, gain: float) -> None:
        """Add a candidate with its partial correlation."""
        basis = self.basis
        # partial correlation of candidate and coefficient, both without the chosen terms
        partial = float(np.sign(basis.product[j]) * np.sqrt(min(1.0, gain / basis.rss)))
        basis.add(j)
        self.note(action, j, partial)

    def remove(self, action: str, j: int, F: float) -> None:
        """Remove a chosen term."""
        self.basis.restart([chosen for chosen in self.basis.chosen if chosen != j])
        self.note(action, j, F=F)

    @property
    def is_full(self) -> bool:
        """Whether the rows do not allow a further term."""
        return len(self.basis.chosen) + 2 >= self.rating.rows

    @property
    def removable(self) -> list[int]:
        """Positions of the chosen terms that may be removed."""
        return [k for k, j in enumerate(self.basis.chosen) if j not in self.required]

    def exchange(self) -> bool:
        """Exchange one term for another candidate if it is worth it; return whether it is."""
        basis, rss, chosen = self.basis, self.basis.rss, self.basis.chosen
        least = _WORTH * self.rating.least(self.gain, rss)
        position, j, gain = basis.best_exchange(self.removable)
        if gain <= least:
            return False
        removed = chosen[position]
        basis.restart([k for k in chosen if k != removed])
        basis.add(j)
        # `gain` is a difference of large sums. For two terms with the same effect it is rounding.
        if rss - basis.rss <= least:
            basis.restart(chosen)
            return False
        self.note("for " + self.problem.terms[removed], j)
        return True


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
    """Select terms as multivariate orthogonal functions.

    Parameters
    ----------
    coefficient, candidates, data, band, keep, name, weights
        As in `select_stepwise`.
    gain : float
        Rise of R2 that a further function must bring.
    noise : float, optional
        Standard deviation of the coefficient's noise, if it is known from repeats. Its variance
        then sets the penalty of the predicted squared error, in place of the variance of the
        coefficient. [1]

    Returns
    -------
    Selection

    Raises
    ------
    IdentificationError
        No candidate explains the coefficient, or a term to keep does not move.

    Notes
    -----
    PSE = v'v/N + s2_max n/N. s2_max is the variance of the coefficient, or 50 times that of the
    noise but never less than the variance of the residual. For frequency see `Rating`.
    """
    problem = candidate_equations(coefficient, candidates, data, band=band, weights=weights)
    search = _StructureSearch(problem, keep, gain=gain, noise=noise)
    while _add_function(search) or _drop_void_term(search) or search.exchange():
        pass
    return fit_selected_terms(
        "orthogonal functions",
        problem,
        work=search.basis,
        rows=search.steps,
        keep=search.required,
        data=data,
        name=name,
        drop=True,
    )


def _add_function(search: _StructureSearch) -> bool:
    """Add the function with the largest gain if it is worth it; return whether it is."""
    basis = search.basis
    gains = basis.gains()
    j = basis.best_candidate(gains)
    if search.is_full or gains[j] <= search.rating.least(search.gain, basis.rss - gains[j]):
        return False
    search.add("taken", j, gains[j])
    return True


def _drop_void_term(search: _StructureSearch) -> bool:
    """Drop the weakest term if it is not worth its price; return whether it was dropped."""
    basis, rating = search.basis, search.rating
    losses = basis.losses()
    weakest = min(search.removable, key=lambda k: losses[k], default=None)
    if weakest is None or not losses[weakest] < rating.least(search.gain, basis.rss):
        return False
    j, loss = basis.chosen[weakest], losses[weakest]
    basis.restart([chosen for chosen in basis.chosen if chosen != j])
    search.note("dropped", j, F=loss / rating.variance(basis))
    return True


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
    """Select terms by stepwise regression.

    Parameters
    ----------
    coefficient : str
        Measured coefficient.
    candidates : sequence of str
        Terms; `monomials` and `spline_terms` make lists of them.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them.
    band : (low, high), optional
        Band of a selection in frequency; default in time. [Hz]
    enter, leave : float
        Partial F above which a term enters and below which it leaves; default 20 and 0.9 of the
        first.
    gain : float
        Rise of R2 that a further term must bring.
    keep : sequence of str
        Terms that are in the model from the start and stay. In frequency ``1`` is always estimated
        at the end.
    hierarchy : bool
        A product enters only after the candidates that it is a product of.
    name : str
        Name in reports and in the provenance.
    weights : {"equal", "spectrum"}
        Weights of the frequencies of a band, as in `regress_frequency`. The spectrum is that of the
        residual of all candidates.

    Returns
    -------
    Selection

    Raises
    ------
    IdentificationError
        No candidate explains the coefficient, invalid thresholds, or a term to keep does not move.

    Notes
    -----
    F = (fall of the sum of squares)/s^2 with the s^2 of the larger model. The partial correlation
    is that of a candidate and the coefficient, both without the chosen terms. The search ends if no
    term enters or leaves, if R2 rises by less than `gain`, or if the predicted squared error would
    rise; see `Rating`. F to leave is at most F to enter so terms cannot enter and
    leave without end. With `hierarchy` no term is exchanged.

    References
    ----------
    .. [Miller1984] Miller, Selection of subsets of regression variables, J. Royal Statistical
       Society A 147, 1984.
    """
    leave = LEAVE * enter if leave is None else leave
    if not 0.0 < leave <= enter:
        raise IdentificationError(
            f"F to enter {enter:g}, to leave {leave:g}; expected 0 < leave <= enter, or "
            f"terms would come and go for ever"
        )
    problem = candidate_equations(coefficient, candidates, data, band=band, weights=weights)
    search = _StructureSearch(problem, keep, gain=gain)
    parents = _list_parents(problem) if hierarchy else None
    while True:
        while _enter_term(search, enter, parents):
            while _remove_weakest(search, leave):
                pass
        if hierarchy or not search.exchange():
            break
    return fit_selected_terms(
        "stepwise",
        problem,
        work=search.basis,
        rows=search.steps,
        keep=search.required,
        data=data,
        name=name,
        drop=False,
    )


def _enter_term(search: _StructureSearch, enter: float, parents: list[set[int]] | None) -> bool:
    """Enter the best candidate if its partial F is large enough; return whether it is."""
    basis, rating = search.basis, search.rating
    if search.is_full or basis.rss <= 0.0:
        return False
    gains = basis.gains()
    if parents is not None:
        chosen = set(basis.chosen)
        gains[[not needed <= chosen for needed in parents]] = 0.0
    j = basis.best_candidate(gains)
    rss = basis.rss - gains[j]
    partial_F = np.inf
    if rss > 0:
        partial_F = gains[j] / (rss / (rating.rows - len(basis.chosen) - 1))
    is_worth = gains[j] > search.gain * rating.total and gains[j] > rating.price(rss)
    if not (partial_F > enter and is_worth):
        return False
    search.add("entered", j, gains[j])
    return True


def _remove_weakest(search: _StructureSearch, leave: float) -> bool:
    """Remove the term with the smallest partial F if it is too small; return whether it is."""
    basis = search.basis
    s2 = search.rating.variance(basis)
    if s2 == 0.0:
        return False
    F = basis.losses() / s2
    F[[j in search.required for j in basis.chosen]] = np.inf
    k = int(np.argmin(F))
    if not F[k] < leave:
        return False
    search.remove("removed", basis.chosen[k], float(F[k]))
    return True


def _list_parents(problem: CandidateEquations) -> list[set[int]]:
    """Return for every candidate the candidates with one factor less."""
    row_of = {term: j for j, term in enumerate(problem.terms)}
    parents = []
    for term in problem.terms:
        powers = term_powers(term)
        lower = set()
        for factor in powers:
            reduced = {**powers, factor: powers[factor] - 1}
            name = term_text({key: power for key, power in reduced.items() if power})
            if name in row_of and name != "1":
                lower.add(row_of[name])
        parents.append(lower)
    return parents
