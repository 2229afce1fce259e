"""Model of a measured quantity with linear coefficients and nonlinear shape parameters."""

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
from flighttest.regression.expression_functions import FUNCTIONS, Pieces
from flighttest.regression.expressions import Expression, Scope, parse_terms

_NAME = re.compile(r"^[A-Za-z_]\w*(\.\w+)*$")


class ShapeParameter(NamedTuple):
    """A nonlinear parameter of a term: an exponent, a time constant, a knot.

    Attributes
    ----------
    low, high : float
        Bounds of the search. [SI]
    start : float, optional
        Start value, and the a-priori value if `sigma` is finite. Without it the search starts from
        several values between the bounds.
    sigma : float
        Standard error of the a-priori value `start`; infinite without a-priori value.
    """

    low: float
    high: float
    start: float | None = None
    sigma: float = float("inf")

    @property
    def spread(self) -> float:
        """Standard deviation before the flights.

        The smaller of `sigma` and range/sqrt(12), that of a uniform distribution in the bounds.
        """
        return min(self.sigma, (self.high - self.low) / np.sqrt(12.0))


class Slope(NamedTuple):
    """Derivative of the regressor of one term by one shape parameter, (samples,)."""

    parameter: str
    term: int
    values: np.ndarray


@dataclass(frozen=True)
class SeparableModel:
    """A quantity as a sum of terms, each with one unknown coefficient.

    The terms may contain shape parameters, in which the model is nonlinear.

    Parameters
    ----------
    target : str
        The measured quantity: a name of the vocabulary, or a name that `units` declares.
    terms : sequence of str
        Expressions of quantities and parameters, each with one coefficient: ``1``, ``alpha``,
        ``alpha*h_agl^s``, ``Fz*tanh(g*slip)``, ``lag(n1, tau)``; see `expressions` for the grammar.
    parameters : mapping of str to ShapeParameter or tuple
        The shape parameters by name. A tuple contains the fields of `ShapeParameter`:
        ``{"s": (-4.0, -0.1)}``.
    units : mapping of str to str, optional
        Units of quantities that are not in the vocabulary: ``{"slip": "rad", "Fz": "N"}``.

    Raises
    ------
    UnknownName
        A name that is neither in the vocabulary nor declared.
    ParseError
        A term that is not valid, or that occurs twice.
    SchemaError
        Parameters with invalid bounds or start, parameters that no term contains, and names with
        two meanings. One error lists all of them.

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
        expressions: list[Expression] = []
        for text in self.terms:
            expressions.extend(parse_terms(text))
        names = tuple(map(str, expressions))
        _demand_terms(names)
        parameters = {}
        for name, item in self.parameters.items():
            if not isinstance(item, ShapeParameter):
                item = ShapeParameter(*item)
            parameters[name] = item
        # A frozen dataclass: its fields are set once, here.
        fields = {
            "terms": names,
            "expressions": tuple(expressions),
            "parameters": MappingProxyType(parameters),
            "units": MappingProxyType(dict(self.units)),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        problems = []
        for name, item in parameters.items():
            problems.extend(_list_faults(name, item, self._names))
        for name in parameters:
            if name in self.units:
                problems.append(f"the parameter {name} is also a quantity with a unit; rename it")
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
        >>> units = {"Fy": "N", "Fz": "N", "slip": "rad"}
        >>> SeparableModel.parse("Fy = Fz*tanh(g*slip)", {"g": (1.0, 50.0)}, units).terms
        ('Fz*tanh(g*slip)',)
        """
        target, sign, terms = text.partition("=")
        if not sign or not terms.strip():
            raise ParseError("<model>", 0, repr(text), "'CL = 1 + alpha + h_agl^s'")
        return cls(target.strip(), [terms], parameters=parameters or {}, units=units or {})

    def __str__(self) -> str:
        return f"{self.target} = {' + '.join(self.terms)}"

    @property
    def _names(self) -> tuple[str, ...]:
        """All names in the terms, each once, in order of appearance."""
        names: dict[str, None] = {}
        for expression in self.expressions:
            names.update(dict.fromkeys(expression.names()))
        return tuple(names)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the quantities in the terms, in order of appearance."""
        return tuple(name for name in self._names if name not in self.parameters)

    @property
    def shapes(self) -> dict[str, tuple[str, ...]]:
        """The shape parameters in each term, by term."""
        shapes = {}
        for term, expression in zip(self.terms, self.expressions):
            names = set(expression.names())
            shapes[term] = tuple(name for name in self.parameters if name in names)
        return shapes

    def unit(self, name: str) -> str:
        """Return the unit of the target or of a variable.

        Raises
        ------
        UnknownName
            A name that is neither in the vocabulary nor declared.
        UnitError
            A declared unit that is not defined.
        """
        # A declared unit has priority over the vocabulary; parsing validates it.
        if name in self.units:
            parse_unit(self.units[name])
            return self.units[name]
        try:
            return lookup(name).units
        except UnknownName:
            raise UnknownName(
                name,
                [*VOCABULARY, *self.units, *self.parameters],
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
            Contains every variable of the model; scalars are allowed.
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
            A power, root, logarithm or lag that is not defined for the values.
        """
        columns, size = columns_with_count(data)
        quantities = {}
        for name in self.variables:
            if name in columns:
                quantities[name] = np.asarray(columns[name])
        return self.columns(quantities, size, parameters=parameters, pieces=pieces)

    def columns(
        self,
        quantities: Mapping[str, np.ndarray],
        size: int,
        parameters: Mapping[str, float],
        pieces: Pieces | None = None,
    ) -> tuple[np.ndarray, list[Slope]]:
        """Return the result of `design` for arrays (size,) by name."""
        # A lag needs the stretches without a gap; other terms ignore them.
        scope = Scope(quantities, dict(parameters), pieces or Pieces())
        return evaluate_columns(self.expressions, scope, size)


def _demand_terms(names: Sequence[str]) -> None:
    """Raise when there is no term, or when a term occurs twice."""
    if not names:
        raise ParseError("<model>", 0, "no term", "at least one, such as '1'")
    for k, name in enumerate(names):
        if name in names[:k]:
            raise ParseError("<model>", 0, f"the term {name} more than once", "each term once")


def _list_faults(name: str, item: ShapeParameter, used: Sequence[str]) -> list[str]:
    """Return the faults of a shape parameter; `used` are the names in the terms."""
    faults = []
    if not _NAME.match(name) or name in FUNCTIONS:
        faults.append(f"{name!r} is not a name for a parameter; take letters and digits")
    if name in VOCABULARY:
        faults.append(
            f"the parameter {name} has the name of a quantity "
            f"({VOCABULARY[name].long_name}); rename it"
        )
    if name not in used:
        faults.append(f"no term has the parameter {name}")
    if not (np.isfinite([item.low, item.high]).all() and item.low < item.high):
        faults.append(
            f"{name}: bounds {item.low:g} ... {item.high:g}; give two finite numbers, the "
            f"lower first"
        )
    elif item.start is not None and not item.low <= item.start <= item.high:
        faults.append(
            f"{name}: start {item.start:g} is outside its bounds {item.low:g} ... {item.high:g}"
        )
    if not item.sigma > 0.0 or (item.start is None and np.isfinite(item.sigma)):
        faults.append(
            f"{name}: a standard error of {item.sigma:g}; it must be positive and needs a start"
        )
    return faults


def evaluate_columns(
    expressions: Sequence[Expression], scope: Scope, size: int
) -> tuple[np.ndarray, list[Slope]]:
    """Return regressors (size, terms), and their derivatives by the shape parameters."""
    X = np.empty((size, len(expressions)))
    slopes: list[Slope] = []
    # Overflow gives infinite regressors, which the projection refuses.
    with np.errstate(over="ignore", invalid="ignore"):
        for j, expression in enumerate(expressions):
            value, derivatives = expression.at(scope)
            X[:, j] = value
            for name, slope in derivatives.items():
                slopes.append(Slope(name, j, np.broadcast_to(slope, (size,))))
    return X, slopes
