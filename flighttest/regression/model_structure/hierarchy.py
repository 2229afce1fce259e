"""Hierarchy of candidate terms, and the damping term of a moment.

A product or a power needs its factors: without them its estimate depends on the origin of the
variables, and it takes up the effect of a factor that is missing [Peixoto1987]_. A ramp needs the
same power of its variable, because both together form a spline.

The plane of symmetry gives the lateral variables an origin. A coefficient in the plane is even in
all of them together, a lateral one is odd. A term of the right symmetry needs only factors of the
right symmetry: beta**2 in CL does not need beta, alpha*beta in CY does not need alpha.

References
----------
.. [Peixoto1987] Peixoto, Hierarchical variable selection in polynomial regression models, The
   American Statistician 41, 1987.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import product

import numpy as np

from flighttest.regression.equation_error.model import term_powers, term_text, variable_of
from flighttest.regression.equation_error.structure_remarks import DAMPING
from flighttest.regression.model_structure.candidates import CandidateEquations

_LATERAL = {"beta", "phat", "rhat", "p", "r", "betadothat", "delta_a", "delta_r", "delta_d"}
_EVEN = {"CL", "CD", "CX", "CZ", "Cm"}
_ODD = {"CY", "Cl", "Cn"}

Powers = frozenset[tuple[str, int]]


def factors_of(term: str, coefficient: str = "") -> list[str]:
    """Return the terms that a term needs: the products of lower powers of its factors.

    Parameters
    ----------
    term : str
    coefficient : str
        Coefficient whose symmetry counts; without it every lower product is needed.

    Examples
    --------
    >>> factors_of("alpha**2*qhat")
    ['qhat', 'alpha', 'alpha*qhat', 'alpha**2']
    >>> factors_of("alpha*beta**2", "CL")
    ['beta**2', 'alpha']
    >>> factors_of("ramp(alpha,0.2)**2")
    ['alpha', 'alpha**2']
    """
    powers = term_powers(term)
    choices = [_lower_powers(factor, power) for factor, power in powers.items()]
    needed: dict[str, None] = {}
    for choice in product(*choices):
        lower: dict[str, int] = {}
        for factor, power in choice:
            lower[factor] = lower.get(factor, 0) + power
        text = term_text({factor: power for factor, power in lower.items() if power})
        needed[text] = None
    has_symmetry = _is_symmetric(term, coefficient)
    found = []
    for text in needed:
        is_itself = _key_of(text) == _key_of(term)
        if text != "1" and not is_itself and (_is_symmetric(text, coefficient) or not has_symmetry):
            found.append(text)
    return found


def _lower_powers(factor: str, power: int) -> list[tuple[str, int]]:
    """Return the powers of a factor up to the given one; a ramp has those of its variable too."""
    name = variable_of(factor)
    choices = [(name, k) for k in range(power + 1)]
    if name != factor:
        choices.append((factor, power))
    return choices


def _is_symmetric(term: str, coefficient: str) -> bool:
    """Return whether a term has the symmetry of a coefficient; true for one without symmetry."""
    lateral = 0
    for factor, power in term_powers(term).items():
        lateral += power * (variable_of(factor) in _LATERAL)
    if coefficient in _EVEN:
        return lateral % 2 == 0
    return coefficient not in _ODD or lateral % 2 == 1


def _key_of(term: str) -> Powers:
    """Return what two spellings of one product share."""
    return frozenset(term_powers(term).items())


def add_factors(candidates: Iterable[str], coefficient: str = "") -> list[str]:
    """Return candidates with all terms that they need, factors first, each product once.

    Examples
    --------
    >>> add_factors(["1", "alpha*qhat"])
    ['1', 'qhat', 'alpha', 'alpha*qhat']
    """
    terms: dict[Powers, str] = {}
    for candidate in candidates:
        for needed in factors_of(candidate, coefficient):
            terms.setdefault(_key_of(needed), needed)
        terms.setdefault(_key_of(candidate), term_text(term_powers(candidate)))
    return list(terms.values())


def list_ancestors(
    terms: Sequence[str], coefficient: str = "", followers: Sequence[Sequence[str]] | None = None
) -> list[frozenset[int]]:
    """Return for each term the positions of all terms that it needs, as far as they are there.

    A factor that does not move is not among the terms, and not needed.

    Parameters
    ----------
    terms : sequence of str
    coefficient : str
        As of `factors_of`.
    followers : sequence of sequence of str, optional
        All terms that enter with each of `terms`; the default is the term alone.
    """
    if followers is None:
        followers = [(term,) for term in terms]
    position: dict[Powers, int] = {}
    for k, together in enumerate(followers):
        for term in together:
            position.setdefault(_key_of(term), k)
    ancestors = []
    for k, together in enumerate(followers):
        needed: set[int] = set()
        for term in together:
            lower = factors_of(term, coefficient)
            needed.update(position.get(_key_of(name), k) for name in lower)
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
        followers = [problem.followers(j) for j in range(len(problem.terms))]
        self.ancestors = list_ancestors(problem.terms, problem.coefficient, followers)
        if is_free:
            self.ancestors = [frozenset()] * len(problem.terms)
        # The constant of a model in frequency is estimated at the end.
        kept = [term for term in keep if term != "1" or problem.band is None]
        damping = DAMPING.get(problem.coefficient, "")
        if damping in problem.available and not is_free:
            kept.append(damping)
        required: dict[int, None] = {}
        for term in [*kept, *problem.required]:
            # A constraint gives it a number.
            if term in problem.fixed:
                continue
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
    if not damping or damping in problem.available or damping in problem.constants:
        return {}
    if damping in problem.fixed:
        return {"without_damping": "a constraint makes it zero"}
    if damping in problem.idle:
        return {"without_damping": "it does not move"}
    return {"without_damping": "it is not among the candidates"}
