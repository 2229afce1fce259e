"""Models that the evidence allows: search, rating and weights.

The search looks forward and back. It expands the best model that it has not expanded yet: it adds a
term with its factors, drops a term with the products that need it, or exchanges one for another. It
ends if every model within `WINDOW` of the best one is expanded.

The rating of a model is the logarithm of the density that `HeldOutPrediction` gives to all left-out
parts, less `PRICE` for each term. The price is a prior: without it a void term would enter in one
record of six, because prediction alone is a weak judge of void terms [Shao1993]_.

The difference d of two ratings has a standard error s, from the differences part by part. A model
is in the set if d/sqrt(1 + pi s^2/8) is below `WORSE`, and its weight is the exponential of it. The
divisor is the mean of the weight over the error of d [MacKay1992]_. A model that has two terms more
than a better one inside it is left out: sets would otherwise consist of combinations of void terms.
Both rules are those of Occam's window [Madigan1994]_; the second one is milder here, so that a term
that is too weak for the record is not excluded.

References
----------
.. [Shao1993] Shao, Linear model selection by cross-validation, J. American Statistical Association
   88, 1993.
.. [MacKay1992] MacKay, The evidence framework applied to classification networks, Neural
   Computation 4, 1992.
.. [Madigan1994] Madigan, Raftery, Model selection and accounting for model uncertainty in graphical
   models using Occam's window, J. American Statistical Association 89, 1994.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flighttest.regression.model_structure.candidates import CandidateEquations
from flighttest.regression.model_structure.hierarchy import TermHierarchy
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.prediction import HeldOutPrediction, whiten_rows

MOST_CANDIDATES = 24  # candidates that enter the comparison: those with the largest gain
WINDOW = 6.0  # difference of ln density from the best model up to which a model is expanded
WORSE = 3.0  # difference up to which a model is in the set: one twentieth of the weight of the best
# fall of the rating by each term: the left-out parts must be seven times as probable with it
PRICE = 2.0
MOST_MODELS = 4000  # rated models at which the search ends
_DISTINCT = 1e-5  # least independent part of the movement of a candidate, of its square
_MOST_ALLOWED = 200  # models of a set, those with the largest weights
_SURPLUS = 2  # terms more than a better model inside it with which a model is left out
_EQUAL = 1e-6  # difference of two ratings that is rounding
_ROWS_PER_TERM = 5  # rows of the comparison for each term

Model = frozenset[int]


class AllowedModel(NamedTuple):
    """One model of the set.

    Attributes
    ----------
    terms : tuple of int
        Candidates, in their order.
    rating, difference, stderr, weight : float
        Columns of `Selection.models`.
    """

    terms: tuple[int, ...]
    rating: float
    difference: float
    stderr: float
    weight: float


def choose_pool(problem: CandidateEquations, hierarchy: TermHierarchy) -> list[int]:
    """Return the candidates that are compared: required ones, then those with the largest gain.

    Candidates that the data cannot distinguish from earlier ones are left out, and products whose
    factors are left out.
    """
    basis = OrthogonalBasis(problem.X, problem.z)
    # A candidate that is nearly a sum of chosen ones, compared with its own movement, is refused.
    # A spectrum has no mean.
    mean = problem.X.mean(axis=1) if problem.band is None else np.zeros(len(problem.X))
    moving2 = basis.size2 - len(problem.z) * mean**2
    for j in hierarchy.required:
        basis.add(j)
    refused: set[int] = set()
    limit = min(MOST_CANDIDATES, problem.rows // _ROWS_PER_TERM)
    while len(basis.chosen) < limit:
        gains = basis.gains()
        gains[list(refused)] = 0.0
        gains[basis.remainder2 <= _DISTINCT * moving2] = 0.0
        if not gains.max() > 0.0:
            break
        j = basis.best_candidate(gains)
        # A product enters with its factors, all of them or none.
        family = hierarchy.missing(j, basis.chosen)
        if refused.intersection(family) or len(basis.chosen) + len(family) >= limit:
            refused.add(j)
            continue
        for k in [*family, j]:
            if basis.remainder2[k] > _DISTINCT * moving2[k]:
                basis.add(k)
            else:
                refused.update({k, j})
                break
    return basis.chosen


def _is_surplus(model: Model, ratings: dict[Model, float]) -> bool:
    """Return whether a rated model with `_SURPLUS` terms fewer is inside a model and better."""
    rating, most = ratings[model], len(model) - _SURPLUS
    return any(
        value >= rating and len(other) <= most and other < model for other, value in ratings.items()
    )


class ModelComparison:
    """Models of a pool of candidates, rated by the prediction of left-out parts.

    Parameters
    ----------
    problem : CandidateEquations
    hierarchy : TermHierarchy

    Attributes
    ----------
    pool : list of int
        Candidates that are compared.
    is_complete : bool
        Whether the search has expanded all models within `WINDOW` of the best one.
    """

    def __init__(self, problem: CandidateEquations, hierarchy: TermHierarchy):
        self.pool = choose_pool(problem, hierarchy)
        place = {j: k for k, j in enumerate(self.pool)}
        self.required = frozenset(place[j] for j in hierarchy.required)
        self.ancestors = []
        for j in self.pool:
            self.ancestors.append(frozenset(place[i] for i in hierarchy.ancestors[j] if i in place))
        self.prediction = HeldOutPrediction(whiten_rows(problem, self.pool))
        self.is_complete = True

    def allowed(self) -> list[AllowedModel]:
        """Return the models that the evidence allows, the best first."""
        ratings = self._search()
        limit = max(ratings.values()) - _EQUAL
        # Of equal models the one with fewer terms, and with earlier candidates, is the best.
        best = min((m for m in ratings if ratings[m] >= limit), key=lambda m: (len(m), sorted(m)))
        densities = self.prediction.densities(sorted(best))
        found = []
        for model, rating in ratings.items():
            apart = densities - self.prediction.densities(sorted(model))
            variance = len(apart) * float(apart.var(ddof=1))
            difference = max(0.0, ratings[best] - rating)
            shrunk = difference / math.sqrt(1.0 + math.pi * variance / 8.0)
            if shrunk <= WORSE and not _is_surplus(model, ratings):
                terms = tuple(sorted(self.pool[k] for k in model))
                weight = math.exp(-shrunk)
                found.append(AllowedModel(terms, rating, difference, math.sqrt(variance), weight))
        first = tuple(sorted(self.pool[k] for k in best))
        found.sort(key=lambda m: (m.terms != first, -m.weight, len(m.terms), m.terms))
        del found[_MOST_ALLOWED:]
        total = sum(model.weight for model in found)
        return [model._replace(weight=model.weight / total) for model in found]

    def _rate(self, model: Model) -> float:
        """Return ln of the density of all left-out parts, less the price of the terms."""
        return float(self.prediction.densities(sorted(model)).sum()) - PRICE * len(model)

    def _search(self) -> dict[Model, float]:
        """Return all models that were rated, and their ratings."""
        # Both ends are starts: the required terms alone, and all candidates.
        starts = (self.required, frozenset(range(len(self.pool))))
        ratings = {model: self._rate(model) for model in starts}
        waiting = set(starts)
        while waiting and len(ratings) < MOST_MODELS:
            model = max(waiting, key=lambda m: (ratings[m], -len(m), sorted(m, reverse=True)))
            if ratings[model] < max(ratings.values()) - WINDOW and waiting.isdisjoint(starts):
                return ratings
            waiting.remove(model)
            if _is_surplus(model, ratings) and model not in starts:
                continue
            for neighbour in self._neighbours(model):
                if neighbour not in ratings:
                    ratings[neighbour] = self._rate(neighbour)
                    waiting.add(neighbour)
        self.is_complete = not waiting
        return ratings

    def _neighbours(self, model: Model) -> set[Model]:
        """Return the models that differ by one term and what belongs to it, or by an exchange."""
        absent = [k for k in range(len(self.pool)) if k not in model]
        larger = [self._with_term(model, k) for k in absent]
        smaller = []
        for k in sorted(model - self.required):
            removed = self._without_term(model, k)
            if self.required <= removed:
                smaller.append(removed)
        exchanged = []
        for removed in smaller:
            exchanged += [self._with_term(removed, k) for k in absent]
        return {*larger, *smaller, *exchanged}

    def _with_term(self, model: Model, k: int) -> Model:
        return model | {k} | self.ancestors[k]

    def _without_term(self, model: Model, k: int) -> Model:
        return frozenset(j for j in model if j != k and k not in self.ancestors[j])
