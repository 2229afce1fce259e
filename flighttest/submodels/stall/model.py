"""Model of a coefficient with terms over the flow separation.

A separated term is a loss, which vanishes in attached flow: a product of regressors and 1 - X or
1 - X_lift, or of regressors and a difference between the wing halves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from flightmech.errors import UnitError
from flightmech.names import SEPARATION
from flightmech.quantities import parse_quantity
from flightmech.units import DEGREE
from flighttest.regression.expression_functions import Pieces
from flighttest.regression.expressions import Expression, Scope, parse_terms
from flighttest.regression.separable_model import SeparableModel, Slope, evaluate_columns
from flighttest.submodels.stall.flow import LOSSES, UNITS, SeparationFlow

_FLOW = {*SEPARATION, *LOSSES}
COEFFICIENTS = ("CL", "CD", "Cm", "CY", "Cl", "Cn")
"""Coefficients that may have terms over the separation."""
_STEEPEST = np.radians(60.0)  # beyond any attached flow


def demand_attached(alpha: float | str) -> float:
    """Return the last angle of attack of attached flow. [rad]

    Raises
    ------
    UnitError
        It is not an angle, or not between 0 and 60 deg.
    """
    value = parse_quantity(alpha, "rad")
    if not 0.0 < value < _STEEPEST:
        found = f"{alpha!r}"
        if not isinstance(alpha, str):
            found = f"{alpha:g} rad, which is {value / DEGREE:.4g} deg"
        raise UnitError(
            f"found {found}; give an angle of attack between 0 and 60 deg, such as '8 deg'"
        )
    return value


def demand_station(station: float | str, span: float = np.inf) -> float:
    """Return the distance of the stations of the wing halves from the plane of symmetry. [m]

    Parameters
    ----------
    station : float or str
        A number in metres, a text with its unit, or an empty text for a quarter of the span.
    span : float
        Span of the wing. Default: the station is not compared with it. [m]

    Raises
    ------
    UnitError
        It is not a length, negative, or beyond the wing tip.
    """
    value = 0.25 * span if station == "" else parse_quantity(station, "m")
    if not value >= 0.0:
        raise UnitError(
            f"found {value:.4g} m; give a distance from the plane of symmetry, which holds for "
            "both wing halves: zero or a positive length, such as '2.5 m'"
        )
    if value > 0.5 * span:
        raise UnitError(
            f"found {value:.4g} m, beyond the wing tip at {0.5 * span:.4g} m; give a length up to "
            "that, with its unit, such as '2.5 m' or '8 ft'"
        )
    return value


class SeparatedTerm(NamedTuple):
    """A term that vanishes in attached flow.

    Attributes
    ----------
    regressors : tuple of str
        Model variables that multiply it, such as ``alpha``, or a difference ``X_lift_diff``.
    loss : str
        ``X`` or ``X_lift``: the term is over 1 less this variable; empty for a difference.
    """

    regressors: tuple[str, ...] = ()
    loss: str = ""

    @property
    def text(self) -> str:
        """Text of the term: ``alpha*X_lift_loss``, in which ``X_lift_loss`` is 1 - X_lift."""
        factors = [*self.regressors]
        if self.loss:
            factors.append(f"{self.loss}_loss")
        return "*".join(factors)

    @property
    def is_difference(self) -> bool:
        """Whether it is over a difference between the wing halves."""
        return any(name.startswith("X_") for name in self.regressors)

    @property
    def contribution(self) -> str:
        """Name of the contribution in a database: ``stall_alpha``."""
        return "_".join(["stall", *self.regressors])


def term_label(coefficient: str, text: str, count: int) -> str:
    """Return the name of a term in a fit of `count` coefficients."""
    return f"{coefficient}: {text}" if count > 1 else text


@dataclass(frozen=True)
class SeparatedModel(SeparableModel):
    """A separable model whose shape parameters are those of a flow separation.

    Parameters
    ----------
    flow : SeparationFlow
        Separation points along the samples; `parameters` are those that it does not fix.
    """

    flow: SeparationFlow = field(default_factory=SeparationFlow)

    def __post_init__(self):
        expressions: list[Expression] = []
        for text in self.terms:
            expressions.extend(parse_terms(text))
        fields = {
            "terms": tuple(map(str, expressions)),
            "expressions": tuple(expressions),
            "parameters": MappingProxyType(dict(self.parameters)),
            "units": MappingProxyType({**UNITS, **self.units}),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the quantities in the terms and of those that the separation needs."""
        own = [name for name in self._names if name not in _FLOW]
        return tuple(dict.fromkeys([*own, *self.flow.quantities]))

    @property
    def shapes(self) -> dict[str, tuple[str, ...]]:
        """The parameters of the separation of each term that depends on it, by term."""
        shapes = {}
        for term, expression in zip(self.terms, self.expressions, strict=True):
            separated = set(expression.names()) & _FLOW
            shapes[term] = tuple(self.parameters) if separated else ()
        return shapes

    def columns(
        self,
        quantities: Mapping[str, np.ndarray],
        size: int,
        parameters: Mapping[str, float],
        pieces: Pieces | None = None,
    ) -> tuple[np.ndarray, list[Slope]]:
        """Return regressors (size, terms) and their derivatives by the parameters."""
        pieces = pieces or Pieces()
        flow = self.flow.evaluate(quantities, parameters, pieces)
        scope = Scope({**quantities, **flow}, {}, pieces)
        return evaluate_columns(self.expressions, scope, size)
