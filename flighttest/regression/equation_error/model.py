"""A model that is linear in its parameters: a coefficient as a sum of regressors, as in [LR743] eq.
(12).

A term is ``1`` or a product of powers of model variables: ``alpha``, ``alpha**2``,
``delta_f*alpha``, ``qhat*gear``. A factor may be a truncated power: ``ramp(alpha,0.21)`` is alpha -
0.21 above the knot 0.21 rad and zero below, ``ramp(alpha,12 deg)**2`` its square; a sum of them is
a spline of first or second order.
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
from flightmech.support.arrays import columns_with_count
from flightmech.units import parse_quantity
from flighttest.regression.separable_model import SeparableModel, ShapeParameter

MEASURED = (*COEFFICIENTS, "CX", "CZ")
_FACTOR = re.compile(r"^([A-Za-z_][\w.]*(?:\([^()]*\))?)(?:(?:\*\*|\^)([1-9]))?$")
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
        The measured quantity: a coefficient such as CL or CX, or any other name of the vocabulary,
        such as Ch_e. [its unit]
    terms : sequence of str
        ``"1"`` or products of powers of vocabulary names and ramps; ``^`` may stand for ``**``.
    reference : mapping, optional
        Value that is taken from a variable before it enters a regressor; the knot of a ramp stays
        where it is. [SI]

    Raises
    ------
    UnknownName
        A variable or coefficient that is not in the vocabulary.
    ParseError
        A term that cannot be read, or that stands twice.

    Examples
    --------
    >>> Model("CL", ["1", "alpha", "alpha^2"]).terms
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
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ParseError("<model>", 0, f"the term {twice} more than once", "each term once")
        if not names:
            raise ParseError("<model>", 0, "no term", "at least one, such as '1'")
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
            Parameters on which the terms do not depend linearly; the model is a `SeparableModel`
            then, for `regress_separable`.
        units : mapping of str to str, optional
            Units of quantities that the vocabulary does not have; the model is a `SeparableModel`
            then.

        Examples
        --------
        >>> Model.parse("CL = 1 + alpha + alpha*h_agl^s", {"s": (-4.0, -0.1)}).variables
        ('alpha', 'h_agl')
        """
        if parameters is not None or units is not None:
            return SeparableModel.parse(text, parameters, units)
        left, sign, right = text.partition("=")
        if not sign or not right.strip():
            raise ParseError("<model>", 0, repr(text), "'CL = 1 + alpha + qhat + delta_e'")
        return cls(left.strip(), [part.strip() for part in right.split("+")])

    def __str__(self) -> str:
        return f"{self.coefficient} = {' + '.join(self.terms)}"

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the model variables, in order of appearance."""
        return tuple(
            dict.fromkeys(
                variable_of(factor) for term in self.terms for factor in term_powers(term)
            )
        )

    def design(self, data: xr.Dataset | Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the regressors, (samples, terms).

        Parameters
        ----------
        data : Dataset (time,) or (sample,), or mapping of str to array (sample,)
            Holds every variable of the model; scalars are allowed.

        Raises
        ------
        UnknownName
            A variable that `data` does not hold.
        """
        return term_regressors(self.terms, data, self.reference).T

    def absolute(self) -> tuple[RegressionModel, np.ndarray]:
        """Return the same model without reference values, and the matrix that turns its parameters
        into those.

        Returns
        -------
        model : Model
            Absolute variables; has the lower powers that the expansion brings in.
        matrix : array (terms of model, terms of self)
            parameters = matrix @ centred parameters; covariance = matrix @ covariance @ matrix.T.
        """
        expansions = [_expand(term_powers(term), self.reference) for term in self.terms]
        names = tuple(
            dict.fromkeys([*self.terms, *(name for expansion in expansions for name in expansion)])
        )
        matrix = np.zeros((len(names), len(self.terms)))
        for j, expansion in enumerate(expansions):
            for name, factor in expansion.items():
                matrix[names.index(name), j] = factor
        return RegressionModel(self.coefficient, names), matrix


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
        Holds every variable of the terms; scalars are allowed.
    reference : mapping, optional
        Value that is taken from a variable, but not from that of a ramp. [SI]

    Raises
    ------
    UnknownName
        A variable that `data` does not hold.
    """
    columns, size = columns_with_count(data)
    rows = np.empty((len(terms), size))
    known: dict[tuple[str, int], np.ndarray] = {}
    for row, term in zip(rows, terms):
        factors = [
            _power(factor, power, term, columns, reference or {}, known)
            for factor, power in term_powers(term).items()
        ]
        row[:] = factors[0] if factors else 1.0
        for factor in factors[1:]:
            row *= factor
    return rows


def _power(
    factor: str,
    power: int,
    term: str,
    columns: Mapping[Any, Any],
    reference: Mapping[str, float],
    known: dict,
) -> np.ndarray:
    """A power of a factor, each worked out once."""
    if (factor, power) not in known:
        if power > 1:
            found = _power(factor, power - 1, term, columns, reference, known) * _power(
                factor, 1, term, columns, reference, known
            )
        else:
            name = variable_of(factor)
            if name not in columns:
                raise UnknownName(
                    name,
                    map(str, columns),
                    "model variable",
                    f"the data do not hold it; the term {term} needs it",
                )
            x = np.asarray(columns[name], float)
            found = (
                x - reference.get(name, 0.0)
                if factor == name
                else np.maximum(x - knot_of(factor), 0.0)
            )
        known[factor, power] = found
    return known[factor, power]


def term_powers(term: str) -> dict[str, int]:
    """Return the factors of a term, variables and ramps, and their powers; an empty dict for
    ``"1"``.

    Examples
    --------
    >>> powers("delta_f*alpha**2")
    {'delta_f': 1, 'alpha': 2}
    >>> powers("ramp(h, 100 ft)")
    {'ramp(h,30.48)': 1}
    """
    return dict(_powers(term))


@lru_cache(maxsize=4096)
def _powers(term: str) -> tuple[tuple[str, int], ...]:
    text = re.sub(r"\s+", "", term)
    if text == "1":
        return ()
    found: dict[str, int] = {}
    for part in re.split(r"(?<!\*)\*(?!\*)", text):
        match = _FACTOR.match(part)
        if not match:
            raise ParseError("<model>", 0, f"the term {term!r}", _EXPECTED)
        factor = _factor(match.group(1), term)
        found[factor] = found.get(factor, 0) + int(match.group(2) or 1)
    return tuple(found.items())


def variable_of(factor: str) -> str:
    """Return the variable of a factor as `term_powers` gives it: ``"alpha"`` of ``"alpha"`` and of
    ``"ramp(alpha,0.2)"``.
    """
    match = _RAMP.match(factor)
    return match.group(1) if match else factor


def knot_of(factor: str) -> float:
    """Return the knot of a ramp as `term_powers` gives it. [SI]"""
    match = _RAMP.match(factor)
    if not match:
        raise ParseError("<model>", 0, f"the factor {factor!r}", "a ramp such as 'ramp(alpha,0.2)'")
    return float(match.group(2))


def _factor(word: str, term: str) -> str:
    """A variable, or a ramp with its knot in SI."""
    if "(" not in word:
        lookup(word)
        return word
    match = _RAMP.match(word)
    if not match:
        raise ParseError("<model>", 0, f"the term {term!r}", _EXPECTED)
    text, units = match.group(2), lookup(match.group(1)).units
    bare = re.fullmatch(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?", text)
    return f"ramp({match.group(1)},{parse_quantity(float(text) if bare else text, units):.10g})"


def term_text(factors: Mapping[str, int]) -> str:
    """Return the term made of factors and their powers, the inverse of `term_powers`."""
    return (
        "*".join(name if power == 1 else f"{name}**{power}" for name, power in factors.items())
        or "1"
    )


def _expand(factors: Mapping[str, int], reference: Mapping[str, float]) -> dict[str, float]:
    """The product of (x - reference)**power, multiplied out."""
    choices = [
        [
            (name, k, comb(power, k) * (-reference[name]) ** (power - k))
            for k in range(power, -1, -1)
        ]
        if reference.get(name)
        else [(name, power, 1.0)]
        for name, power in factors.items()
    ]
    total: dict[str, float] = {}
    for pick in product(*choices):
        name = term_text({name: k for name, k, _ in pick if k})
        total[name] = total.get(name, 0.0) + float(np.prod([factor for *_, factor in pick]))
    return total
