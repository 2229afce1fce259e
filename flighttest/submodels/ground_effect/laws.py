"""Laws by which a ground effect decreases with the height, each with one shape parameter.

    k h^s                 [LR743] eq. (13), (14); exponent s
    k exp(-h / h0)        exponential; height h0 of a decrease by e
    k / (1 + (h / h0)^2)  images of the wing and its vortices; [McCormick1995] has h0 = b / 16

The height h is in metres.  In the last law h0 is a share of the span b, so that it is a law of h/b.

References
----------
.. [LR743] Report LR-743, 1993, section 4.5.1.
.. [McCormick1995] McCormick, Aerodynamics, Aeronautics, and Flight Mechanics, 2nd ed., 1995,
   section 7: the factor (16 h/b)^2 / (1 + (16 h/b)^2) of the induced drag.
.. [Wieselsberger1921] Wieselsberger, Wing Resistance near the Ground, NACA TM 77, 1922: the
   interference factor of Prandtl.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.expressions import parse_expression
from flighttest.regression.separable_model import SeparableModel, ShapeParameter

HEIGHT = "h_agl"
# Bounds of s: above -0.1 the ground has the same effect at all heights.
EXPONENTS = (-4.0, -0.1)
# Bounds of h0 over the lowest height of the records. Below them the effect is gone at all flown
# heights, above them it is the same at all heights near the ground.
_SCALES = (0.25, 12.0)
# Heights over the span between which Prandtl's interference factor holds, [Wieselsberger1921].
PRANDTL_RANGE = (1.0 / 15.0, 0.5)


def interference_factor(h_over_span: float) -> float:
    """Return Prandtl's interference factor of a wing and its image, [Wieselsberger1921].

    The image takes this share of the induced drag away.  Heights outside the range of the formula
    have the factor of its nearer end.
    """
    x = min(max(h_over_span, PRANDTL_RANGE[0]), PRANDTL_RANGE[1])
    return (1.0 - 1.32 * x) / (1.05 + 7.4 * x)


@dataclass(frozen=True)
class HeightLaw:
    """A factor over the height, except for its size.

    Attributes
    ----------
    name : str
        The law as a formula, which is also the name of its form.
    symbol : str
        Shape parameter.
    template : str
        Formula with the places ``{term}``, ``{h}`` and ``{shape}``.
    """

    name: str
    symbol: str
    template: str

    def shape_name(self, term: str) -> str:
        """Return the shape parameter of a term: ``s_alpha`` of alpha, ``s_0`` of 1."""
        if term == "1":
            return f"{self.symbol}_0"
        return f"{self.symbol}_" + re.sub(r"\W+", "_", term.replace("**", "")).strip("_")

    def regressor(self, term: str, shape: str | None = None) -> str:
        """Return a term times the law in the spelling of a separable model.

        `shape` is the name of the shape parameter; its default is that of the term.
        """
        text = self.template.format(term=term, h=HEIGHT, shape=shape or self.shape_name(term))
        return str(parse_expression(text.removeprefix("1*")))

    def at(self, size: str, shape: str, height: float) -> str:
        """Return the factor at one height as an expression of estimates."""
        return self.template.format(term=f"({size})", h=repr(float(height)), shape=shape)

    def bounds(self, lowest: float, exponents: tuple[float, float]) -> tuple[float, float]:
        """Return the bounds of the shape parameter for the lowest height of the records [m]."""
        if self.symbol == "s":
            return exponents
        return _SCALES[0] * lowest, _SCALES[1] * lowest

    def start(self, lowest: float) -> float | None:
        """Return the first value of the shape parameter; None for several between the bounds."""
        if self.symbol == "s":
            return None
        # The effect changes smoothly with h0, so that one start suffices.
        low, high = self.bounds(lowest, EXPONENTS)
        return math.sqrt(low * high)

    def common_form(self) -> str:
        """Return the name of the form in which all terms have one shape parameter."""
        return f"{self.name}, one {self.symbol}"


POWER = HeightLaw("k h^s", "s", "{term}*{h}^{shape}")
EXPONENTIAL = HeightLaw("k exp(-h/h0)", "h0", "{term}*exp(-{h}/{shape})")
SPAN = HeightLaw("k/(1+(h/h0)^2)", "h0", "{term}/(1+({h}/{shape})^2)")
LAWS = (POWER, EXPONENTIAL, SPAN)


def separable_spelling(term: str) -> str:
    """Return a term of a `RegressionModel` in the spelling of a separable model."""
    return str(parse_expression(term))


def model_over_ground(
    model: RegressionModel,
    ground: Sequence[str],
    law: HeightLaw = POWER,
    bounds: tuple[float, float] = EXPONENTS,
    held: bool = False,
    common: bool = False,
    starts: Mapping[str, float] | None = None,
) -> SeparableModel:
    """Return the model of a coefficient in and out of ground effect.

    Parameters
    ----------
    model : Model
        Terms in free air.
    ground : sequence of str
        Terms that the ground changes.
    law : HeightLaw
    bounds : (low, high)
        Bounds of the shape parameters.
    held : bool
        Whether the free-air terms are already subtracted from the measured coefficient.
    common : bool
        Whether all ground terms have one shape parameter, [LR743] eq. (11).
    starts : mapping of str to float, optional
        First values of shape parameters by name, from an earlier search.
    """
    common_name = law.symbol if common else None
    terms: list[str] = []
    if not held:
        terms += model.terms
    shape = {}
    for term in ground:
        name = common_name or law.shape_name(term)
        terms.append(law.regressor(term, common_name))
        shape[name] = ShapeParameter(*bounds, (starts or {}).get(name))
    return SeparableModel(model.coefficient, terms, shape)
