"""Hierarchy of candidate terms, and the damping term of a moment.

A product or a power needs its factors: without them its estimate depends on the origin of the
variables, and it takes up the effect of a factor that is missing [Peixoto1987]_. A ramp needs the
same power of its variable, because both together form a spline.

References
----------
.. [Peixoto1987] Peixoto, Hierarchical variable selection in polynomial regression models, The
   American Statistician 41, 1987.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from flighttest.regression.equation_error.model import term_powers, term_text, variable_of
from flighttest.regression.equation_error.structure_remarks import DAMPING
from flighttest.regression.model_structure.candidates import CandidateEquations


def factors_of(term: str) -> list[str]:
    """Return the terms that a term needs at once: those with one factor less.

    Examples
    --------
    >>> factors_of("alpha**2*qhat")
    ['alpha*qhat', 'alpha**2']
    >>> factors_of("ramp(alpha,0.2)**2")
    ['alpha**2']
    """
    powers = term_powers(term)
    needed = []
    for factor, power in powers.items():
        name = variable_of(factor)
        lower = dict(powers)
        if factor != name:
            # A ramp is replaced by the same power of its variable.
            del lower[factor]
            lower[name] = lower.get(name, 0) + power
        else:
            lower[factor] -= 1
        text = term_text({key: value for key, value in lower.items() if value})
        if text != "1":
            needed.append(text)
    return needed


def _key_of(term: str) -> frozenset[tuple[str, int]]:
    """Return what two spellings of one product share."""
    return frozenset(term_powers(term).items())


def add_factors(candidates: Iterable[str]) -> list[str]:
    """Return candidates with all terms that they need, factors first, each product once.

    Examples
    --------
    >>> add_factors(["1", "alpha*qhat"])
    ['1', 'qhat', 'alpha', 'alpha*qhat']
    """
    terms: dict[frozenset[tuple[str, int]], str] = {}
    for candidate in candidates:
        if _key_of(candidate) in terms:
            continue
        for needed in add_factors(factors_of(candidate)):
            terms.setdefault(_key_of(needed), needed)
        terms[_key_of(candidate)] = term_text(term_powers(candidate))
    return list(terms.values())


def list_ancestors(terms: Sequence[str]) -> list[frozenset[int]]:
    """Return for each term the positions of all terms that it needs, as far as they are there.

    A factor that does not move is not among the terms, and not needed.
    """
    position = {_key_of(term): k for k, term in enumerate(terms)}
    ancestors = []
    for k, term in enumerate(terms):
        needed = [position.get(_key_of(name), k) for name in add_factors([term])]
        ancestors.append(frozenset(needed) - {k})
    return ancestors


class TermHierarchy:
    """What the hierarchy requires of a model, or nothing if it is free.

    Parameters
    ----------
    problem : CandidateEquations
    keep : sequence of str
        Terms that every model has.
    is_free : bool
        Whether a product may enter without its factors, and a moment may lose its damping.

    Attributes
    ----------
    ancestors : list of frozenset of int
        Candidates that each candidate needs.
    required : list of int
        Candidates that every model has, factors first: kept terms, what they need, and the damping
        term of a moment.

    Raises
    ------
    IdentificationError
        A term to keep is not a candidate, or does not move.
    """

    def __init__(self, problem: CandidateEquations, keep: Sequence[str], is_free: bool):
        self.ancestors = list_ancestors(problem.terms)
        if is_free:
            self.ancestors = [frozenset()] * len(problem.terms)
        # The constant of a model in frequency is estimated at the end.
        kept = [term for term in keep if term != "1" or problem.band is None]
        damping = DAMPING.get(problem.coefficient, "")
        if damping in problem.terms and not is_free:
            kept.append(damping)
        required: dict[int, None] = {}
        for term in kept:
            j = problem.place(term)
            required.update(dict.fromkeys([*sorted(self.ancestors[j]), j]))
        self.required = list(required)

    def missing(self, j: int, chosen: Collection[int]) -> list[int]:
        """Return the candidates that a candidate needs in addition to the chosen ones."""
        return [k for k in sorted(self.ancestors[j]) if k not in chosen]

    def removable(self, chosen: Sequence[int]) -> list[int]:
        """Return the positions of the chosen candidates that no other one needs."""
        needed = set(self.required).union(*(self.ancestors[j] for j in chosen))
        return [k for k, j in enumerate(chosen) if j not in needed]

    def exchanges(self, chosen: Sequence[int], positions: Sequence[int]) -> np.ndarray:
        """Return which candidate may replace the chosen one at which position.

        The result is an array of bool (candidates, positions).
        """
        allowed = np.empty((len(self.ancestors), len(positions)), bool)
        for column, position in enumerate(positions):
            left = set(chosen) - {chosen[position]}
            allowed[:, column] = [needed <= left for needed in self.ancestors]
        return allowed


def missing_damping(problem: CandidateEquations) -> dict[str, str]:
    """Return the attribute of a selection that cannot have its damping term, with the reason."""
    damping = DAMPING.get(problem.coefficient, "")
    if not damping or damping in problem.terms:
        return {}
    if damping in problem.idle:
        return {"without_damping": "it does not move"}
    return {"without_damping": "it is not among the candidates"}
