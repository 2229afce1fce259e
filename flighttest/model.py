"""A model that is linear in its parameters: a coefficient as a sum of regressors, as in [LR743] eq. (12).

A term is ``1`` or a product of powers of model variables: ``alpha``, ``alpha**2``, ``delta_f*alpha``, ``qhat*gear``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import comb

import numpy as np
import xarray as xr

from flightmech.errors import ParseError, UnknownName
from flightmech.names import COEFFICIENTS, lookup

MEASURED = (*COEFFICIENTS, "CX", "CZ")
_FACTOR = re.compile(r"^([A-Za-z_][\w.]*)(?:(?:\*\*|\^)([1-9]))?$")


@dataclass(frozen=True)
class Model:
    """A coefficient as a sum of terms, each with one unknown parameter.

    Parameters
    ----------
    coefficient : str
        One of CL, CD, CY, Cl, Cm, Cn, CX, CZ.
    terms : sequence of str
        ``"1"`` or products of powers of vocabulary names; ``^`` may stand for ``**``.
    reference : mapping, optional
        Value that is taken from a variable before it enters a regressor. [SI]

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
            raise UnknownName(self.coefficient, MEASURED, "coefficient")
        names = tuple(_word(powers(term)) for term in self.terms)
        for name in names:
            if names.count(name) > 1:
                raise ParseError("<model>", 0, f"the term {name} more than once", "each term once")
        if not names:
            raise ParseError("<model>", 0, "no term", "at least one, such as '1'")
        object.__setattr__(self, "terms", names)
        for name in self.reference:
            if name not in self.variables:
                raise UnknownName(name, self.variables, "reference", "it must be a variable of the model")

    @classmethod
    def parse(cls, text: str) -> Model:
        """Return the model that a text such as ``"CL = 1 + alpha + qhat + delta_e"`` describes."""
        left, sign, right = text.partition("=")
        if not sign or not right.strip():
            raise ParseError("<model>", 0, repr(text), "'CL = 1 + alpha + qhat + delta_e'")
        return cls(left.strip(), [part.strip() for part in right.split("+")])

    def __str__(self) -> str:
        return f"{self.coefficient} = {' + '.join(self.terms)}"

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the model variables, in order of appearance."""
        return tuple(dict.fromkeys(name for term in self.terms for name in powers(term)))

    def design(self, data: xr.Dataset) -> np.ndarray:
        """Return the regressors, (samples, terms).

        Parameters
        ----------
        data : Dataset (time,) or (sample,)
            Holds every variable of the model; scalars are allowed.

        Raises
        ------
        UnknownName
            A variable that `data` does not hold.
        """
        size = max(data.sizes.values(), default=1)
        columns = [np.ones(size) for _ in self.terms]
        for column, term in zip(columns, self.terms):
            for name, power in powers(term).items():
                if name not in data:
                    raise UnknownName(name, map(str, data.data_vars), "model variable", f"the data do not hold it; term {term} of {self}")
                column *= (np.asarray(data[name].values, float) - self.reference.get(name, 0.0)) ** power
        return np.stack(columns, axis=1)

    def absolute(self) -> tuple[Model, np.ndarray]:
        """Return the same model without reference values, and the matrix that turns its parameters into those.

        Returns
        -------
        model : Model
            Absolute variables; has the lower powers that the expansion brings in.
        matrix : array (terms of model, terms of self)
            parameters = matrix @ centred parameters; covariance = matrix @ covariance @ matrix.T.
        """
        expansions = [_expand(powers(term), self.reference) for term in self.terms]
        names = tuple(dict.fromkeys([*self.terms, *(name for expansion in expansions for name in expansion)]))
        matrix = np.zeros((len(names), len(self.terms)))
        for j, expansion in enumerate(expansions):
            for name, factor in expansion.items():
                matrix[names.index(name), j] = factor
        return Model(self.coefficient, names), matrix


def powers(term: str) -> dict[str, int]:
    """Return the variables of a term and their powers; an empty dict for ``"1"``.

    Examples
    --------
    >>> powers("delta_f*alpha**2")
    {'delta_f': 1, 'alpha': 2}
    """
    text = re.sub(r"\s+", "", term)
    if text == "1":
        return {}
    found: dict[str, int] = {}
    for part in re.split(r"(?<!\*)\*(?!\*)", text):
        match = _FACTOR.match(part)
        if not match:
            raise ParseError("<model>", 0, f"the term {term!r}", "'1' or a product of names and powers, such as 'delta_f*alpha**2'")
        lookup(match.group(1))
        found[match.group(1)] = found.get(match.group(1), 0) + int(match.group(2) or 1)
    return found


def _word(factors: Mapping[str, int]) -> str:
    return "*".join(name if power == 1 else f"{name}**{power}" for name, power in factors.items()) or "1"


def _expand(factors: Mapping[str, int], reference: Mapping[str, float]) -> dict[str, float]:
    """The product of (x - reference)**power, multiplied out."""
    choices = [
        [(name, k, comb(power, k) * (-reference[name]) ** (power - k)) for k in range(power, -1, -1)]
        if reference.get(name)
        else [(name, power, 1.0)]
        for name, power in factors.items()
    ]
    total: dict[str, float] = {}
    for pick in product(*choices):
        name = _word({name: k for name, k, _ in pick if k})
        total[name] = total.get(name, 0.0) + float(np.prod([factor for *_, factor in pick]))
    return total
