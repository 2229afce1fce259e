"""Approximation of DAVE-ML variables that are not exact sums: the inexact parts are sampled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from aerodb.exchange.daveml import polynomials
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.expansion import (
    ExpandedVariables,
    combine_sums,
    expand_expression,
    to_reduced_rates,
)
from aerodb.exchange.daveml.polynomials import Inexact, Sum
from aerodb.exchange.daveml.sampler import Sampler


def approximate_variable(
    sampler: Sampler,
    varID: str,
    reasons: Mapping[str, str],
    lengths: Mapping[str, float],
    weight: float = 1.0,
) -> Sum:
    """Return a variable as a sum: exact summands and factors stay exact, others are sampled.

    Parameters
    ----------
    sampler : Sampler
        Holds the exact sums, and stores the result.
    varID : str
        The variable.
    reasons, lengths
        As in `expand_variables`.
    weight : float
        Largest size of the factors that multiply the variable in a coefficient.

    Returns
    -------
    Sum
        The variable in the unit of the file.

    Raises
    ------
    Inexact
        A part is neither exact nor can it be sampled.
    """
    if varID in sampler.sums:
        return sampler.sums[varID]
    variable = sampler.model.variables[varID]
    if variable.calculation is None and varID not in sampler.model.functions:
        raise Inexact(reasons[varID])
    # A limited variable is sampled as a whole, because the limits act on the total.
    is_limited = np.isfinite((variable.low, variable.high)).any()
    if variable.calculation is None or is_limited:
        approximation = sampler.variable(varID, weight)
    else:
        scope = _Scope(sampler, varID, reasons, lengths)
        approximation = _approximate_expression(variable.calculation, scope, weight)
    sampler.sums[varID] = to_reduced_rates(approximation, lengths)
    return sampler.sums[varID]


@dataclass(frozen=True)
class _Scope:
    """Arguments of `approximate_variable` for the parts of the calculation of a variable."""

    sampler: Sampler
    varID: str
    reasons: Mapping[str, str]
    lengths: Mapping[str, float]


def _approximate_expression(expression: mathml.Expression, scope: _Scope, weight: float) -> Sum:
    if isinstance(expression, mathml.Name):
        return approximate_variable(
            scope.sampler,
            expression.varID,
            reasons=scope.reasons,
            lengths=scope.lengths,
            weight=weight,
        )
    exact = _expand_exactly(expression, scope)
    if exact is not None:
        return exact
    if isinstance(expression, mathml.Apply):
        # A sum or a product is taken apart, so that only its inexact parts are sampled.
        if expression.operator in ("plus", "minus"):
            summands = [
                _approximate_expression(argument, scope, weight)
                for argument in expression.arguments
            ]
            return combine_sums(expression.operator, summands)
        if expression.operator in ("times", "divide", "quotient"):
            return _approximate_product(list(_split_factors(expression)), scope, weight)
    return scope.sampler.expression(expression, scope.varID, weight)


def _approximate_product(factors: list[mathml.Expression], scope: _Scope, weight: float) -> Sum:
    """Return a product in which the exact factors stay exact."""
    product = polynomials.make_constant_sum(1.0)
    inexact = []
    for factor in factors:
        exact = _expand_exactly(factor, scope)
        if exact is None:
            inexact.append(factor)
        else:
            product = polynomials.multiply_sums(product, exact)
    for factor in inexact:
        # The size of the product so far scales the error of the next factor.
        factor_weight = weight * scope.sampler.magnitude(product)
        approximation = _approximate_expression(factor, scope, factor_weight)
        product = polynomials.multiply_sums(product, approximation)
    return product


def _split_factors(expression: mathml.Apply) -> Iterator[mathml.Expression]:
    """Yield the factors of a product or quotient; a denominator has the power -1."""
    # A quotient has one factor in the numerator.
    count = 1
    if expression.operator == "times":
        count = len(expression.arguments)
    yield from expression.arguments[:count]
    for denominator in expression.arguments[count:]:
        yield mathml.Apply("power", (denominator, mathml.MathNumber(-1.0)))


def _expand_exactly(expression: mathml.Expression, scope: _Scope) -> Sum | None:
    """Return the exact sum of an expression, or None if there is none."""
    try:
        return expand_expression(expression, ExpandedVariables(scope.sampler.sums, scope.reasons))
    except Inexact:
        return None
