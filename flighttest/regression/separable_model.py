"""A measured quantity as a sum of terms, each with one unknown coefficient and a form that few
parameters shape.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import VOCABULARY, lookup
from flightmech.support.arrays import columns_with_count
from flightmech.units import parse_unit
from flighttest.regression.expressions import FUNCTIONS, Expression, Pieces, Scope, parse_terms

_NAME = re.compile(r"^[A-Za-z_]\w*(\.\w+)*$")


class ShapeParameter(NamedTuple):
    """A parameter on which a term does not depend linearly: an exponent, a time constant, a knot.

    Attributes
    ----------
    low, high : float
        Bounds of the search. [as the expression needs it, SI]
    start : float, optional
        First value; without it the search starts from several values between the bounds. With
        `sigma` the a-priori value.
    sigma : float
        Standard error of the a-priori value `start`; infinite when nothing is known.
    """

    low: float
    high: float
    start: float | None = None
    sigma: float = float("inf")

    @property
    def spread(self) -> float:
        """Standard deviation before the flights: `sigma`, or that of a uniform distribution between
        the bounds.
        """
        return min(self.sigma, (self.high - self.low) / np.sqrt(12.0))


class Slope(NamedTuple):
    """Derivative of the regressor of one term by one shape parameter, (samples,)."""

    parameter: str
    term: int
    values: np.ndarray


@dataclass(frozen=True)
class SeparableModel:
    """A quantity as a sum of terms that are linear in their coefficients and nonlinear in few shape
    parameters.

    Parameters
    ----------
    target : str
        The measured quantity: a name of the vocabulary, or one that `units` declares.
    terms : sequence of str
        Expressions of quantities and parameters, each with a coefficient of its own: ``1``,
        ``alpha``, ``alpha*h_agl^s``, ``Fz*tanh(g*slip)``, ``lag(n1, tau)``; see `reading` for the
        grammar.
    parameters : mapping of str to ShapeParameter or tuple
        The shape parameters by name; a tuple holds the fields of `ShapeParameter`: ``{"s": (-4.0,
        -0.1)}``.
    units : mapping of str to str, optional
        Quantities that the vocabulary does not have, and their units: ``{"slip": "rad", "Fz":
        "N"}``.

    Raises
    ------
    UnknownName
        A name that is neither in the vocabulary nor declared.
    ParseError
        A term that cannot be read, or that stands twice.
    SchemaError
        Parameters with impossible bounds or start, or that no term has; names that mean two things;
        all at once.

    Examples
    --------
    >>> model = SeparableModel("CL", ["1", "alpha", "alpha * h_agl^s"], {"s": (-4.0, -0.1)})
    >>> model.terms, model.variables
    (('1', 'alpha', 'alpha*h_agl^s'), ('alpha', 'h_agl'))
    """

    target: str
    terms: Sequence[str]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    expressions: tuple[Expression, ...] = field(init=False, repr=False, compare=False, default=())

    def __post_init__(self):
        expressions = tuple(term for text in self.terms for term in parse_terms(text))
        names = tuple(map(str, expressions))
        if not names:
            raise ParseError("<model>", 0, "no term", "at least one, such as '1'")
        if len(set(names)) < len(names):
            raise ParseError(
                "<model>",
                0,
                f"the term {next(n for n in names if names.count(n) > 1)} more than once",
                "each term once",
            )
        parameters = {
            name: item if isinstance(item, ShapeParameter) else ShapeParameter(*item)
            for name, item in self.parameters.items()
        }
        for name, value in (("terms", names), ("expressions", expressions)):
            object.__setattr__(self, name, value)
        for name, mapping in (("parameters", parameters), ("units", dict(self.units))):
            object.__setattr__(self, name, MappingProxyType(mapping))
        problems = [
            text for name, item in parameters.items() for text in _faults(name, item, self._names)
        ]
        problems += [
            f"the parameter {name} is also a quantity with a unit; rename it"
            for name in parameters
            if name in self.units
        ]
        if problems:
            raise SchemaError(str(self), problems)
        for name in (self.target, *self.variables):
            self.unit(name)

    @classmethod
    def parse(
        cls,
        text: str,
        parameters: Mapping[str, ShapeParameter | tuple] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> SeparableModel:
        """Return the model that a text such as ``"CL = 1 + alpha + h_agl^s"`` describes.

        Examples
        --------
        >>> SeparableModel.parse("Fy = Fz*tanh(g*slip)", {"g": (1.0, 50.0)}, {"Fy": "N", "Fz": "N", "slip": "rad"}).terms
        ('Fz*tanh(g*slip)',)
        """
        left, sign, right = text.partition("=")
        if not sign or not right.strip():
            raise ParseError("<model>", 0, repr(text), "'CL = 1 + alpha + h_agl^s'")
        return cls(left.strip(), [right], parameters or {}, units or {})

    def __str__(self) -> str:
        return f"{self.target} = {' + '.join(self.terms)}"

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(
            dict.fromkeys(name for expression in self.expressions for name in expression.names())
        )

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the quantities in the terms, in order of appearance."""
        return tuple(name for name in self._names if name not in self.parameters)

    @property
    def shapes(self) -> dict[str, tuple[str, ...]]:
        """The parameters that shape each term, by term."""
        return {
            term: tuple(n for n in self.parameters if n in set(e.names()))
            for term, e in zip(self.terms, self.expressions)
        }

    def unit(self, name: str) -> str:
        """Return the unit of the target or of a variable.

        Raises
        ------
        UnknownName
            A name that is neither in the vocabulary nor declared.
        UnitError
            A declared unit that is not known.
        """
        if name in self.units:
            parse_unit(self.units[name])
            return self.units[name]
        try:
            return lookup(name).units
        except UnknownName:
            known = [*VOCABULARY, *self.units, *self.parameters]
            raise UnknownName(
                name,
                known,
                "quantity",
                "declare its unit in `units`, or its bounds in `parameters`",
            ) from None

    def design(
        self,
        data: xr.Dataset | Mapping[str, np.ndarray],
        parameters: Mapping[str, float],
        pieces: Pieces | None = None,
    ) -> tuple[np.ndarray, list[Slope]]:
        """Return the regressors and their derivatives with respect to the shape parameters.

        Parameters
        ----------
        data : Dataset (sample,) or (time,), or mapping of str to array (sample,)
            Holds every variable of the model; scalars are allowed.
        parameters : mapping of str to float
            Values of all shape parameters.
        pieces : Pieces, optional
            Stretches of samples without a gap; only a model with a lag needs them.

        Returns
        -------
        X : array (samples, terms)
        slopes : list of Slope
            Derivatives of single regressors by single parameters; all others are zero.

        Raises
        ------
        UnknownName
            A variable that the data do not hold.
        OutOfRange
            A power, root, logarithm or lag of values for which there is none, or numbers beyond all
            bounds.
        """
        columns, size = columns_with_count(data)
        quantities = {
            str(name): np.asarray(columns[name]) for name in self.variables if name in columns
        }
        return self.columns(quantities, size, parameters, pieces)

    def columns(
        self,
        quantities: Mapping[str, np.ndarray],
        size: int,
        parameters: Mapping[str, float],
        pieces: Pieces | None = None,
    ) -> tuple[np.ndarray, list[Slope]]:
        """Return what `design` does, of arrays (size,) by name."""
        scope = Scope(quantities, dict(parameters), pieces or Pieces())
        X, slopes = np.empty((size, len(self.terms))), []
        with np.errstate(over="ignore", invalid="ignore"):
            for j, expression in enumerate(self.expressions):
                value, by = expression.at(scope)
                X[:, j] = value
                slopes += [
                    Slope(name, j, np.broadcast_to(slope, (size,))) for name, slope in by.items()
                ]
        return X, slopes


def _faults(name: str, item: ShapeParameter, used: Sequence[str]) -> list[str]:
    problems = (
        []
        if _NAME.match(name) and name not in FUNCTIONS
        else [f"{name!r} is no name for a parameter; take letters and digits"]
    )
    if name in VOCABULARY:
        problems.append(
            f"the parameter {name} has the name of a quantity "
            f"({VOCABULARY[name].long_name}); rename it"
        )
    if name not in used:
        problems.append(f"no term has the parameter {name}")
    if not (np.isfinite([item.low, item.high]).all() and item.low < item.high):
        problems.append(
            f"{name}: bounds {item.low:g} ... {item.high:g}; give two finite numbers, the "
            f"lower first"
        )
    elif item.start is not None and not item.low <= item.start <= item.high:
        problems.append(
            f"{name}: start {item.start:g} is outside its bounds {item.low:g} ... {item.high:g}"
        )
    if not item.sigma > 0.0 or (item.start is None and np.isfinite(item.sigma)):
        problems.append(
            f"{name}: a standard error of {item.sigma:g}; it must be positive and goes with a start"
        )
    return problems
