"""Model that is linear in its parameters: a coefficient as a sum of regressors [LR743]_ eq. (12).

A term is ``1`` or a product of powers of model variables: ``alpha``, ``alpha**2``,
``delta_f*alpha``, ``qhat*gear``. A factor may be a truncated power. ``ramp(alpha,0.21)`` is
alpha - 0.21 above the knot 0.21 rad and zero below, and ``ramp(alpha,12 deg)**2`` is the square of
a ramp. A sum of ramps is a spline of first or second order.

References
----------
.. [LR743] Report LR-743, 1993.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from math import comb
from typing import Any, overload

import numpy as np
import xarray as xr

from flightmech.errors import ParseError, UnknownName
from flightmech.names import COEFFICIENTS, lookup
from flightmech.quantities import parse_quantity
from flightmech.support.arrays import columns_with_count
from flighttest.regression.separable_model import SeparableModel, ShapeParameter

MEASURED = (*COEFFICIENTS, "CX", "CZ")
_FACTOR = re.compile(r"^([A-Za-z_][\w.]*(?:\([^()]*\))?)(?:(?:\*\*|\^)([1-9]))?$")
_NUMBER = re.compile(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?")
_RAMP = re.compile(r"^ramp\(([A-Za-z_][\w.]*),([^()]+)\)$")
_EXPECTED = (
    "'1' or a product of names, ramps and powers, such as 'delta_f*alpha**2' or "
    "'ramp(alpha,12 deg)'"
)


@dataclass(frozen=True)
class RegressionModel:
    """A coefficient as a sum of terms, each with one unknown parameter.

    Parameters
    ----------
    coefficient : str
        The measured quantity: a coefficient such as CL or CX, or another name of the vocabulary,
        such as Ch_e. [unit of the vocabulary]
    terms : sequence of str
        ``"1"`` or products of powers of vocabulary names and ramps; ``^`` may stand for ``**``.
    reference : mapping, optional
        Value that is subtracted from a variable before it enters a regressor. It does not move the
        knot of a ramp. [SI]

    Raises
    ------
    UnknownName
        A variable or coefficient that is not in the vocabulary.
    ParseError
        A term that is not valid, or that occurs twice.

    Examples
    --------
    >>> RegressionModel("CL", ["1", "alpha", "alpha^2"]).terms
    ('1', 'alpha', 'alpha**2')
    """

    coefficient: str
    terms: Sequence[str]
    reference: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        if self.coefficient not in MEASURED:
            try:
                lookup(self.coefficient)
            except UnknownName:
                raise UnknownName(
                    self.coefficient, MEASURED, "coefficient", "or any quantity of the vocabulary"
                ) from None
        names = tuple(term_text(term_powers(term)) for term in self.terms)
        if not names:
            raise ParseError("<model>", 0, "no term", "at least one, such as '1'")
        for k, name in enumerate(names):
            if name in names[:k]:
                raise ParseError("<model>", 0, f"the term {name} more than once", "each term once")
        # A frozen dataclass: the terms in their one spelling are set once, here.
        object.__setattr__(self, "terms", names)
        for name in self.reference:
            if name not in self.variables:
                raise UnknownName(
                    name, self.variables, "reference", "it must be a variable of the model"
                )

    @overload
    @classmethod
    def parse(cls, text: str) -> RegressionModel: ...

    @overload
    @classmethod
    def parse(
        cls,
        text: str,
        parameters: Mapping[str, ShapeParameter | tuple],
        units: Mapping[str, str] | None = None,
    ) -> SeparableModel: ...

    @overload
    @classmethod
    def parse(cls, text: str, *, units: Mapping[str, str]) -> SeparableModel: ...

    @classmethod
    def parse(
        cls,
        text: str,
        parameters: Mapping[str, ShapeParameter | tuple] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> RegressionModel | SeparableModel:
        """Return the model that a text such as ``"CL = 1 + alpha + qhat + delta_e"`` describes.

        Parameters
        ----------
        text : str
        parameters : mapping of str to ShapeParameter or (low, high), optional
            Shape parameters, in which the terms are nonlinear. The model is then a
            `SeparableModel`, for `regress_separable`.
        units : mapping of str to str, optional
            Units of quantities that are not in the vocabulary. The model is then a
            `SeparableModel`.

        Examples
        --------
        >>> RegressionModel.parse("CL = 1 + alpha + alpha*h_agl^s", {"s": (-4.0, -0.1)}).variables
        ('alpha', 'h_agl')
        """
        if parameters is not None or units is not None:
            return SeparableModel.parse(text, parameters, units)
        coefficient, sign, terms = text.partition("=")
        if not sign or not terms.strip():
            raise ParseError("<model>", 0, repr(text), "'CL = 1 + alpha + qhat + delta_e'")
        return cls(coefficient.strip(), [term.strip() for term in terms.split("+")])

    def __str__(self) -> str:
        return f"{self.coefficient} = {' + '.join(self.terms)}"

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the model variables, in order of appearance."""
        names: dict[str, None] = {}
        for term in self.terms:
            names.update(dict.fromkeys(map(variable_of, term_powers(term))))
        return tuple(names)

    def design(self, data: xr.Dataset | Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the regressors, (samples, terms).

        Parameters
        ----------
        data : Dataset (time,) or (sample,), or mapping of str to array (sample,)
            Contains every variable of the model; scalars are allowed.

        Raises
        ------
        UnknownName
            A variable that `data` does not hold.
        """
        return term_regressors(self.terms, data, self.reference).T

    def absolute(self) -> tuple[RegressionModel, np.ndarray]:
        """Return the same model without reference values, and the matrix of its parameters.

        Returns
        -------
        model : RegressionModel
            Model in absolute variables, with the lower powers of the expansion.
        matrix : array (terms of model, terms of self)
            parameters = matrix @ centred parameters; covariance = matrix @ covariance @ matrix.T.
        """
        expansions = [_expand_powers(term_powers(term), self.reference) for term in self.terms]
        names = dict.fromkeys(self.terms)
        for expansion in expansions:
            names.update(dict.fromkeys(expansion))
        rows = list(names)
        matrix = np.zeros((len(rows), len(self.terms)))
        for j, expansion in enumerate(expansions):
            for name, factor in expansion.items():
                matrix[rows.index(name), j] = factor
        return RegressionModel(self.coefficient, rows), matrix


def term_regressors(
    terms: Sequence[str],
    data: xr.Dataset | Mapping[str, np.ndarray],
    reference: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Return the regressors of terms, one row each, (terms, samples).

    Parameters
    ----------
    terms : sequence of str
    data : Dataset (time,) or (sample,), or mapping of str to array (sample,)
        Contains every variable of the terms; scalars are allowed.
    reference : mapping, optional
        Value that is subtracted from a variable, but not from the variable of a ramp. [SI]

    Raises
    ------
    UnknownName
        A variable that `data` does not hold.
    """
    columns, size = columns_with_count(data)
    rows = np.empty((len(terms), size))
    powers = _FactorPowers(columns, reference or {})
    for row, term in zip(rows, terms):
        factors = [
            powers.evaluate(factor, power, term) for factor, power in term_powers(term).items()
        ]
        row[:] = factors[0] if factors else 1.0
        for factor in factors[1:]:
            row *= factor
    return rows


class _FactorPowers:
    """Powers of factors at the samples, each computed once."""

    def __init__(self, columns: Mapping[Any, Any], reference: Mapping[str, float]):
        self.columns, self.reference = columns, reference
        self.computed: dict[tuple[str, int], np.ndarray] = {}

    def evaluate(self, factor: str, power: int, term: str) -> np.ndarray:
        """Return a power of a factor; `term` is for the error message."""
        key = factor, power
        if key not in self.computed:
            if power > 1:
                lower = self.evaluate(factor, power - 1, term)
                self.computed[key] = lower * self.evaluate(factor, 1, term)
            else:
                self.computed[key] = self._read_factor(factor, term)
        return self.computed[key]

    def _read_factor(self, factor: str, term: str) -> np.ndarray:
        """Return a variable less its reference, or a ramp of it."""
        name = variable_of(factor)
        if name not in self.columns:
            raise UnknownName(
                name,
                map(str, self.columns),
                "model variable",
                f"the data do not hold it; the term {term} needs it",
            )
        x = np.asarray(self.columns[name], float)
        if factor == name:
            return x - self.reference.get(name, 0.0)
        return np.maximum(x - knot_of(factor), 0.0)


def term_powers(term: str) -> dict[str, int]:
    """Return the factors of a term, variables and ramps, and their powers.

    The term ``"1"`` has no factors.

    Examples
    --------
    >>> term_powers("delta_f*alpha**2")
    {'delta_f': 1, 'alpha': 2}
    >>> term_powers("ramp(h, 100 ft)")
    {'ramp(h,30.48)': 1}
    """
    return dict(_parse_powers(term))


@lru_cache(maxsize=4096)
def _parse_powers(term: str) -> tuple[tuple[str, int], ...]:
    """Return the factors of a term and their powers."""
    text = re.sub(r"\s+", "", term)
    if text == "1":
        return ()
    powers: dict[str, int] = {}
    # A single * joins factors; ** is a power.
    for part in re.split(r"(?<!\*)\*(?!\*)", text):
        match = _FACTOR.match(part)
        if not match:
            raise ParseError("<model>", 0, f"the term {term!r}", _EXPECTED)
        factor = _parse_factor(match.group(1), term)
        powers[factor] = powers.get(factor, 0) + int(match.group(2) or 1)
    return tuple(powers.items())


def variable_of(factor: str) -> str:
    """Return the variable of a factor from `term_powers`.

    It is ``"alpha"`` for ``"alpha"`` and for ``"ramp(alpha,0.2)"``.
    """
    match = _RAMP.match(factor)
    if match is None:
        return factor
    return match.group(1)


def knot_of(factor: str) -> float:
    """Return the knot of a ramp from `term_powers`. [SI]"""
    match = _RAMP.match(factor)
    if not match:
        raise ParseError("<model>", 0, f"the factor {factor!r}", "a ramp such as 'ramp(alpha,0.2)'")
    return float(match.group(2))


def _parse_factor(text: str, term: str) -> str:
    """Return a variable, or a ramp with its knot in SI."""
    if "(" not in text:
        lookup(text)
        return text
    match = _RAMP.match(text)
    if not match:
        raise ParseError("<model>", 0, f"the term {term!r}", _EXPECTED)
    variable, knot = match.groups()
    # A number without unit is in SI.
    value: float | str = knot
    if _NUMBER.fullmatch(knot):
        value = float(knot)
    return f"ramp({variable},{parse_quantity(value, lookup(variable).units):.10g})"


def term_text(factors: Mapping[str, int]) -> str:
    """Return the term of factors and their powers, the inverse of `term_powers`."""
    if not factors:
        return "1"
    return "*".join(name if power == 1 else f"{name}**{power}" for name, power in factors.items())


def _expand_powers(factors: Mapping[str, int], reference: Mapping[str, float]) -> dict[str, float]:
    """Return the product of (x - reference)**power as factors of absolute terms."""
    # Binomial theorem: for each factor its powers k with their coefficients.
    choices = []
    for name, power in factors.items():
        if not reference.get(name):
            choices.append([(name, power, 1.0)])
            continue
        expansion = []
        for k in range(power, -1, -1):
            expansion.append((name, k, comb(power, k) * (-reference[name]) ** (power - k)))
        choices.append(expansion)
    # The product of the sums: every combination of one power per factor.
    total: dict[str, float] = {}
    for combination in product(*choices):
        name = term_text({variable: k for variable, k, _ in combination if k})
        coefficient = float(np.prod([factor for *_, factor in combination]))
        total[name] = total.get(name, 0.0) + coefficient
    return total
