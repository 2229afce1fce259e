"""Linear constraints among the parameters of an estimator, and their elimination.

A constraint is a text with the name of a parameter on its left side:

    alpha = 5.2                  a fixed value, in SI
    qhat = 1.2*alphadothat       proportional parameters
    delta_t = 0.4*delta_e - 0.1  any linear equality
    delta_e < 0                  a sign, or another limit

Equalities are eliminated. All parameters are a linear function of the free ones, theta = T phi + t,
and the estimator finds phi. Regression, instrumental variables, total least squares, output error
and filter error use this one elimination. An inequality that an estimate violates becomes an
equality [Lawson1974]_.

References
----------
.. [Lawson1974] Lawson, Hanson, Solving least squares problems, 1974, chapters 20 and 23.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from flightmech.errors import SchemaError
from flighttest.remarks import Remark

CONTRADICTED = 3.0  # standard errors between data and constraint above which it is remarked
_RELATION = re.compile(r"^(.*?)(>=|<=|=|>|<)(.*)$")
_TWO_WORDS = re.compile(r"[\w.)\]]\s+[\w.(]")
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FACTOR = r"[A-Za-z_][\w.]*(?:\([^()]*\))?(?:\[[^\[\]]*\])?(?:@\d+)?(?:\*\*\d)?"
_NAME = rf"{_FACTOR}(?:\*{_FACTOR})*"
_PIECE = re.compile(rf"([+-]?)(?:({_NUMBER})(?:\*({_NAME}))?|({_NAME}))")
_EXPECTED = (
    "expected a name, one of = > < >= <=, and numbers and names with factors, as "
    "'qhat = 1.2*alphadothat' or 'delta_e < 0'"
)
# coefficient of an equality, of its largest, that is rounding of the substitutions before it
_ROUNDING = 1e-12
_DEPENDENT = 1e-9  # singular value of limits of unit length below which they depend on each other
_SOLVED = 1e-9  # share of the distance to an estimate with active limits that is rounding of it
_MOST_LIMITS = 10  # inequalities: every combination of violated ones is tried


@dataclass(frozen=True)
class Constraint:
    """One linear constraint, weights . theta = value, or >= value.

    Attributes
    ----------
    text : str
        As it was written.
    is_equality : bool
    weights : array (parameter,)
    value : float
    left : int
        Position of the parameter on the left side.
    """

    text: str
    is_equality: bool
    weights: np.ndarray
    value: float
    left: int


@dataclass(frozen=True)
class ParameterElimination:
    """All parameters as a linear function of the free ones: theta = matrix @ phi + offset.

    Attributes
    ----------
    matrix : array (parameter, free parameter)
    offset : array (parameter,)
    free : array of int (free parameter,)
        Positions of the free parameters.
    """

    matrix: np.ndarray
    offset: np.ndarray
    free: np.ndarray

    @property
    def is_free(self) -> np.ndarray:
        """Mask of the free parameters, (parameter,)."""
        mask = np.zeros(len(self.offset), bool)
        mask[self.free] = True
        return mask

    @property
    def is_fixed(self) -> np.ndarray:
        """Mask of the parameters that no free parameter changes, (parameter,)."""
        return np.asarray(~self.matrix.any(axis=1))

    def expand(self, phi: np.ndarray) -> np.ndarray:
        """Return all parameters."""
        return self.matrix @ phi + self.offset

    def expand_covariance(self, covariance: np.ndarray) -> np.ndarray:
        """Return the covariance of all parameters from that of the free ones."""
        return self.matrix @ covariance @ self.matrix.T


def parse_constraints(
    texts: Iterable[str],
    names: Sequence[str],
    spell: Callable[[str], str] = str,
) -> list[Constraint]:
    """Return the constraints that texts describe.

    Parameters
    ----------
    texts : iterable of str
    names : sequence of str
        Parameters of the estimator.
    spell : callable, optional
        Returns the spelling of `names` for a name as it was written.

    Raises
    ------
    SchemaError
        A text that is not a constraint, or a name that is not a parameter. One error lists all.
    """
    constraints, problems = [], []
    for text in texts:
        try:
            constraints.append(_parse(text, list(names), spell))
        except ValueError as error:
            problems.append(f"{text!r}: {error}")
    limits = sum(not constraint.is_equality for constraint in constraints)
    if limits > _MOST_LIMITS:
        problems.append(f"{limits} inequalities; at most {_MOST_LIMITS} are allowed")
    if problems:
        raise SchemaError("constraints", problems)
    return constraints


def write_constraint(constraint: Constraint, names: Sequence[str], weights: np.ndarray) -> str:
    """Return a constraint among some of its parameters as a text; the other parameters are zero.

    Parameters
    ----------
    constraint : Constraint
    names : sequence of str
    weights : array (names,)
        One of them at least is not zero.
    """
    left = int(np.flatnonzero(weights)[0])
    # theta_left = (value - sum of the other weights theta) / weight
    pieces = []
    for name, weight in zip(names, -weights / weights[left]):
        if weight and name != names[left]:
            pieces.append(f"{weight:+.17g}*{name}")
    value = constraint.value / weights[left]
    if value or not pieces:
        pieces.append(f"{value:+.17g}")
    relation = "="
    if not constraint.is_equality:
        relation = ">" if weights[left] > 0.0 else "<"
    return f"{names[left]} {relation} {' '.join(pieces)}"


def _parse(text: str, names: list[str], spell: Callable[[str], str]) -> Constraint:
    """Return one constraint; raise ValueError with the problem."""
    # Two words without an operator: without the space they would read as one.
    if _TWO_WORDS.search(re.sub(r"\([^()]*\)", "()", text)):
        raise ValueError(f"two words without an operator between them; {_EXPECTED}")
    match = _RELATION.match(re.sub(r"\s+", "", text))
    if not match:
        raise ValueError(f"no relation; {_EXPECTED}")
    left_name, relation, right = match.groups()
    left = _find(left_name, names, spell)
    weights, value = np.zeros(len(names)), 0.0
    weights[left] = 1.0
    position = 0
    while position < len(right) or not right:
        piece = _PIECE.match(right, position)
        if not piece or (position and not piece.group(1)):
            raise ValueError(f"{right[position:]!r} after {relation}; {_EXPECTED}")
        sign, number, scaled, single = piece.groups()
        size = float(number or 1.0) * (-1.0 if sign == "-" else 1.0)
        if scaled or single:
            weights[_find(scaled or single, names, spell)] -= size
        else:
            value += size
        position = piece.end()
    if not (weights.any() and np.isfinite(weights).all() and math.isfinite(value)):
        raise ValueError(f"no finite relation among parameters; {_EXPECTED}")
    if relation in ("<", "<="):
        weights, value = -weights, -value
    return Constraint(text.strip(), relation == "=", weights, value, left)


def _find(name: str, names: list[str], spell: Callable[[str], str]) -> int:
    """Return the position of a parameter; raise ValueError if there is none of the name."""
    for candidate in (name, spell(name)):
        if candidate in names:
            return names.index(candidate)
    raise ValueError(f"no parameter {name!r}; there are {', '.join(names)}")


def eliminate(constraints: Iterable[Constraint], parameters: int) -> ParameterElimination:
    """Return the elimination of all constraints, each taken as an equality.

    The parameter on the left side is eliminated if an earlier constraint leaves it free.

    Parameters
    ----------
    constraints : iterable of Constraint
    parameters : int
        Number of parameters.

    Raises
    ------
    SchemaError
        A constraint that contradicts earlier ones, or no free parameter.
    """
    T, t = np.eye(parameters), np.zeros(parameters)
    for constraint in constraints:
        # In the free parameters phi the constraint is row . phi = remainder.
        row = constraint.weights @ T
        remainder = constraint.value - float(constraint.weights @ t)
        scale = float(np.abs(constraint.weights).max())
        row[np.abs(row) < _ROUNDING * scale] = 0.0
        if not row.any():
            reference = abs(constraint.value) + float(np.abs(constraint.weights * t).max())
            # Zero on the left side: the constraint follows from the others, or contradicts them.
            if abs(remainder) <= _ROUNDING * reference:
                continue
            raise SchemaError(
                "constraints",
                [f"{constraint.text!r} contradicts the constraints before it; leave one out"],
            )
        pivot = constraint.left if row[constraint.left] else int(np.abs(row).argmax())
        # theta_p = (remainder - sum of the other row_j theta_j) / row_p
        share = -row / row[pivot]
        column = T[:, pivot].copy()
        t += column * remainder / row[pivot]
        share[pivot] = -1.0
        T += np.outer(column, share)
        T[:, pivot] = 0.0
    free = np.flatnonzero(np.abs(T).any(axis=0))
    if not len(free):
        raise SchemaError("constraints", ["no parameter is left to estimate; leave one out"])
    return ParameterElimination(T[:, free], t, free)


def choose_active(
    constraints: Sequence[Constraint],
    held: ParameterElimination,
    phi: np.ndarray,
    information: np.ndarray,
) -> list[Constraint]:
    """Return the inequalities that hold as equalities at the constrained estimate.

    Parameters
    ----------
    constraints : sequence of Constraint
        Inequalities.
    held : ParameterElimination
        Of the equalities.
    phi : array (free parameter,)
        Estimate without the inequalities.
    information : array (free parameter, free parameter)
        Matrix of the quadratic cost (phi - x)' information (phi - x) that the estimate minimises.

    Raises
    ------
    SchemaError
        No estimate satisfies all of them.
    """
    G = np.array([constraint.weights for constraint in constraints]).reshape(-1, len(held.offset))
    h = np.array([constraint.value for constraint in constraints]) - G @ held.offset
    G = G @ held.matrix
    # In y = root (x - phi), with root'root = information, the cost is y'y. Parameters of any size
    # and rows of any scale become comparable there.
    scale = np.sqrt(np.diag(information))
    squares, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    A = (G / scale) @ vectors / np.sqrt(np.maximum(squares, _ROUNDING * squares[-1]))
    size = np.linalg.norm(A, axis=1)
    size[size == 0.0] = 1.0
    slack = _ROUNDING * (np.abs(h) + np.abs(G) @ np.abs(phi)) / size
    A, missing = A / size[:, None], (h - G @ phi) / size
    # Every combination of limits is solved as equalities; the cheapest that satisfies all is taken.
    best, lowest = None, np.inf
    for count in range(len(A) + 1):
        for rows in map(list, combinations(range(len(A)), count)):
            y, _, rank, _ = np.linalg.lstsq(A[rows], missing[rows], rcond=_DEPENDENT)
            if rank < count:
                continue
            cost = float(y @ y)
            inactive = np.setdiff1d(np.arange(len(A)), rows)
            # The active rows hold by construction; only their rounding could contradict them.
            reached = A[inactive] @ y + slack[inactive] + _SOLVED * np.sqrt(cost)
            if (reached >= missing[inactive]).all() and cost < lowest:
                best, lowest = rows, cost
    if best is None:
        raise SchemaError(
            "constraints", ["they contradict each other; leave out one of those that do"]
        )
    return [constraints[k] for k in best]


def rate_constraints(
    constraints: Sequence[Constraint],
    active: Sequence[Constraint],
    theta: np.ndarray,
    covariance: np.ndarray,
) -> str:
    """Return the constraints with their contradiction by the data, as JSON for an attribute.

    Parameters
    ----------
    constraints : sequence of Constraint
    active : sequence of Constraint
        Those that hold as equalities.
    theta : array (parameter,)
        Estimate without constraints; NaN if the data do not determine it.
    covariance : array (parameter, parameter)

    Returns
    -------
    str
        List of ``text``, ``active`` and ``t``: standard errors by which the data contradict it,
        zero for an inequality that they satisfy, null if it was not tested.
    """
    rows = []
    for constraint in constraints:
        distance = float(constraint.weights @ theta) - constraint.value
        variance = float(constraint.weights @ covariance @ constraint.weights)
        t = None
        if math.isfinite(distance) and variance > 0.0:
            t = distance / math.sqrt(variance)
            if not constraint.is_equality:
                t = min(t, 0.0)
        is_active = any(constraint is item for item in active)
        rows.append({"text": constraint.text, "active": is_active, "t": t})
    return json.dumps(rows)


def constraint_remarks(stored: str) -> list[Remark]:
    """Return remarks on constraints that the data contradict, or that were not tested.

    Parameters
    ----------
    stored : str
        As from `rate_constraints`; empty without constraints.
    """
    remarks = []
    for row in json.loads(stored or "[]"):
        text, t = row["text"], row["t"]
        if t is None:
            message = (
                f"constraint {text} was not tested: without it the data do not determine the "
                f"parameters"
            )
            remarks.append(Remark("constraint", message, severity="note"))
        elif abs(t) > CONTRADICTED:
            message = (
                f"the data contradict the constraint {text} by {abs(t):.1f} standard errors; the "
                f"other estimates follow it: check its number, or leave it out"
            )
            remarks.append(Remark("constraint", message, "", float(t), CONTRADICTED))
    return remarks


def is_constrained(stored: str) -> bool:
    """Return whether one of the constraints of `rate_constraints` holds as an equality."""
    return any(row["active"] for row in json.loads(stored or "[]"))


def demand_unconstrained(stored: str, purpose: str) -> None:
    """Raise SchemaError if one of the constraints of `rate_constraints` holds as an equality.

    Parameters
    ----------
    stored : str
    purpose : str
        What needs estimates without constraints.
    """
    if is_constrained(stored):
        raise SchemaError(
            purpose,
            ["a fit holds constraints, and its covariance is singular; fit it without constraints"],
        )


def constraints_to_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes of estimates with the constraints as a list in place of their text."""
    if "constraints" not in attributes:
        return dict(attributes)
    return {**attributes, "constraints": json.loads(str(attributes["constraints"]))}


def describe_constraints(stored: str) -> list[str]:
    """Return the constraints of `rate_constraints` as lines of a report."""
    lines = []
    for row in json.loads(stored or "[]"):
        state = "holds" if row["active"] else "satisfied without it"
        test = "not tested" if row["t"] is None else f"data differ by {row['t']:.2g} std errors"
        lines.append(f"constraint {row['text']}: {state}, {test}")
    return lines
