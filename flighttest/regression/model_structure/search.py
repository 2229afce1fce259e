"""Selection of terms: multivariate orthogonal functions, and stepwise regression.

Multivariate orthogonal functions [Morelli1995]_ rank the candidates by the decrease of the sum of
squares. As many terms are chosen as lower the predicted squared error [Barron1984]_. The functions
are formed in the order of their gain, each orthogonal to the chosen ones (forward orthogonal least
squares [Chen1989]_). If they were formed in the order of the candidate list, functions of
correlated variables would share their content, and far too many would be chosen.

With correlated variables an early choice may be a mixture of later ones. If no further candidate is
worth its price, void terms are dropped, and one term is exchanged for another candidate as long as
this lowers the error.

A product enters together with the factors that it needs, and a moment keeps its damping term,
unless the hierarchy is switched off. Both ways return one structure and nothing about its rivals;
`select_by_prediction` compares them.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.model_structure.candidates import (
    CandidateEquations,
    candidate_equations,
)
from flighttest.regression.model_structure.hierarchy import TermHierarchy, add_factors
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.rating import Rating
from flighttest.regression.model_structure.selection import Selection, fit_selected_terms

GAIN = 0.005  # rise of R2 that a further function must bring
# decrease of the sum of squares that an exchange must bring, of that which a new term must bring
_WORTH = 0.05
# partial F: the theoretical 4 for residuals that are white, and a factor of 5 because they are not
ENTER = 20.0
LEAVE = 0.9  # of the threshold to enter


@dataclass(frozen=True)
class StepwiseThresholds:
    """Thresholds of the partial F of a stepwise regression.

    Attributes
    ----------
    enter : float
        Partial F above which a term enters.
    leave : float or None
        Partial F below which a term leaves; None for `LEAVE` of `enter`.
    """

    enter: float = ENTER
    leave: float | None = None

    def least_to_stay(self) -> float:
        """Return the partial F below which a term leaves.

        Raises
        ------
        IdentificationError
            It is not between zero and `enter`: terms would enter and leave without end.
        """
        leave = LEAVE * self.enter if self.leave is None else self.leave
        if not 0.0 < leave <= self.enter:
            raise IdentificationError(
                f"F to enter {self.enter:g}, to leave {leave:g}; expected 0 < leave <= enter, or "
                f"terms would come and go for ever"
            )
        return leave


class _StructureSearch:
    """State of a selection: the basis, its steps, and the hierarchy of the terms."""

    def __init__(
        self,
        problem: CandidateEquations,
        hierarchy: TermHierarchy,
        gain: float,
        noise: float | None = None,
    ):
        self.problem, self.hierarchy, self.gain = problem, hierarchy, gain
        self.basis = OrthogonalBasis(problem.X, problem.z)
        self.steps: list[dict[str, Any]] = []
        self.required = hierarchy.required
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

    def enter_best(self, action: str, is_worth: Callable[[float], bool]) -> bool:
        """Add the candidate with the largest gain and the factors that it needs.

        Parameters
        ----------
        action : str
        is_worth : callable
            Whether a decrease of the sum of squares is worth a term. It counts for the candidate
            after its factors have entered.

        Returns
        -------
        bool
            Whether a candidate was worth it.
        """
        basis = self.basis
        gains = basis.gains()
        while not self.is_full:
            j = basis.best_candidate(gains)
            if not is_worth(float(gains[j])):
                return False
            steps, chosen = len(self.steps), list(basis.chosen)
            # A factor that the chosen terms determine already is not needed.
            for k in self.hierarchy.missing(j, chosen):
                if (gain := float(basis.gains()[k])) > 0.0:
                    self.add("factor", k, gain)
            gain = float(basis.gains()[j])
            if is_worth(gain):
                self.add(action, j, gain)
                return True
            gains[j] = 0.0
            if len(basis.chosen) > len(chosen):
                basis.restart(chosen)
                del self.steps[steps:]
        return False

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
        return self.hierarchy.removable(self.basis.chosen)

    def exchange(self) -> bool:
        """Exchange one term for another candidate if it is worth it; return whether it is."""
        basis, rss, chosen = self.basis, self.basis.rss, self.basis.chosen
        least = _WORTH * self.rating.least(self.gain, rss)
        positions = self.removable
        allowed = self.hierarchy.exchanges(chosen, positions)
        position, j, gain = basis.best_exchange(positions, allowed)
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
    hierarchy: bool = True,
    name: str = "",
    weights: str = "equal",
    constraints: Sequence[str] = (),
) -> Selection:
    """Select terms as multivariate orthogonal functions.

    Parameters
    ----------
    coefficient, candidates, data, band, keep, hierarchy, name, weights, constraints
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
    if hierarchy:
        candidates = add_factors(candidates, coefficient)
    problem = candidate_equations(
        coefficient, candidates, data, band=band, weights=weights, constraints=constraints
    )
    rules = TermHierarchy(problem, keep, is_free=not hierarchy)
    search = _StructureSearch(problem, rules, gain=gain, noise=noise)
    while _add_function(search) or _drop_void_term(search) or search.exchange():
        pass
    chosen = search.basis.chosen
    needed = set(chosen) - {chosen[k] for k in search.removable}
    return fit_selected_terms(
        "orthogonal functions",
        problem,
        work=search.basis,
        rows=search.steps,
        keep=sorted(needed),
        data=data,
        name=name,
        drop=True,
    )


def _add_function(search: _StructureSearch) -> bool:
    """Add the function with the largest gain if it is worth it; return whether it is."""

    def is_worth(gain: float) -> bool:
        return gain > search.rating.least(search.gain, search.basis.rss - gain)

    return search.enter_best("taken", is_worth)


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
    thresholds: StepwiseThresholds | None = None,
    gain: float = GAIN,
    keep: Sequence[str] = ("1",),
    hierarchy: bool = True,
    name: str = "",
    weights: str = "equal",
    constraints: Sequence[str] = (),
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
    thresholds : StepwiseThresholds, optional
        Partial F to enter and to leave.
    gain : float
        Rise of R2 that a further term must bring.
    keep : sequence of str
        Terms that are in the model from the start and stay. In frequency ``1`` is always estimated
        at the end.
    hierarchy : bool
        A product or power enters with the factors that it needs, and a moment keeps its damping
        term. Factors that are not among the candidates are added.
    name : str
        Name in reports and in the provenance.
    weights : {"equal", "spectrum"}
        Weights of the frequencies of a band, as in `regress_frequency`. The spectrum is that of the
        residual of all candidates.
    constraints : sequence of str
        Linear constraints among the candidates, as of `regress`; a term that is not in the model is
        zero. Equalities hold throughout the search: terms that follow one another enter together,
        and a term with a constant is in every model. Inequalities act in the fit of the selected
        terms.

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
    leave without end.

    References
    ----------
    .. [Miller1984] Miller, Selection of subsets of regression variables, J. Royal Statistical
       Society A 147, 1984.
    """
    thresholds = thresholds or StepwiseThresholds()
    leave = thresholds.least_to_stay()
    if hierarchy:
        candidates = add_factors(candidates, coefficient)
    problem = candidate_equations(
        coefficient, candidates, data, band=band, weights=weights, constraints=constraints
    )
    search = _StructureSearch(
        problem, TermHierarchy(problem, keep, is_free=not hierarchy), gain=gain
    )
    while True:
        while _enter_term(search, thresholds.enter):
            while _remove_weakest(search, leave):
                pass
        if not search.exchange():
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


def _enter_term(search: _StructureSearch, enter: float) -> bool:
    """Enter the best candidate if its partial F is large enough; return whether it is."""
    basis, rating = search.basis, search.rating

    def is_worth(gain: float) -> bool:
        rss = basis.rss - gain
        partial_F = np.inf
        if rss > 0:
            partial_F = gain / (rss / (rating.rows - len(basis.chosen) - 1))
        is_gain = gain > search.gain * rating.total and gain > rating.price(rss)
        return partial_F > enter and is_gain

    return basis.rss > 0.0 and search.enter_best("entered", is_worth)


def _remove_weakest(search: _StructureSearch, leave: float) -> bool:
    """Remove the term with the smallest partial F if it is too small; return whether it is."""
    basis = search.basis
    s2 = search.rating.variance(basis)
    if s2 == 0.0:
        return False
    F = basis.losses() / s2
    weakest = min(search.removable, key=lambda k: F[k], default=None)
    if weakest is None or not F[weakest] < leave:
        return False
    search.remove("removed", basis.chosen[weakest], float(F[weakest]))
    return True
