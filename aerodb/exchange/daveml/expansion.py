"""The variables of a DAVE-ML model as sums of products over the quantities of the vocabulary, as
far as that is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from aerodb.exchange.daveml import piecewise_linear, polynomials
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.model import DaveFunction, DaveModel, DaveVariable, Uncertainty
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded
from aerodb.exchange.daveml.piecewise_linear import PiecewiseLinear
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.sampler import Sampler
from aerodb.exchange.daveml.vocabulary import REDUCED, VALUE

_TURNED = {"lt": "gt", "gt": "lt", "leq": "geq", "geq": "leq"}


def expand_variables(
    model: DaveModel, inputs: Mapping[str, Sum], lengths: Mapping[str, float]
) -> tuple[dict[str, Sum], dict[str, str]]:
    """Expand every variable of a model.

    Parameters
    ----------
    model : DaveModel
        The model.
    inputs : mapping of str to Sum
        Its inputs by varID, in the units of the file, as sums over quantities of the vocabulary
        [SI].
    lengths : mapping of str to float
        ``b`` and ``cbar``, where they are known. [m]

    Returns
    -------
    sums : dict of str to Sum
        What could be expanded, by varID.
    reasons : dict of str to str
        Why the others could not.
    """
    sums: dict[str, Sum] = {}
    reasons: dict[str, str] = {}
    for varID in model.order:
        try:
            one = _variable(model, varID, inputs, sums, reasons)
            if one is not inputs.get(varID) or one.variables != {
                "V"
            }:  # the reduced rates have no limit of airspeed
                one = _limited(one, model.variables[varID])
            sums[varID] = _reduced(one, lengths)
        except Inexact as error:
            reasons[varID] = str(error)
    return sums, reasons


def approximate_variable(
    sampler: Sampler,
    varID: str,
    reasons: Mapping[str, str],
    lengths: Mapping[str, float],
    weight: float = 1.0,
) -> Sum:
    """Return a variable that is no exact sum as one: its summands and factors are exact where they
    can be, the others are sampled.

    Parameters
    ----------
    sampler : Sampler
        Holds the exact sums, and keeps what is made here.
    reasons, lengths
        As in `expand_variables`.
    weight : float
        Size of what multiplies the variable on the way to a coefficient.

    Raises
    ------
    Inexact
        What can be sampled neither.
    """
    if varID not in sampler.sums:
        variable = sampler.model.variables[varID]
        if variable.calculation is None and varID not in sampler.model.functions:
            raise Inexact(reasons[varID])
        if variable.calculation is None or np.isfinite((variable.low, variable.high)).any():
            found = sampler.variable(varID, weight)
        else:
            found = _approximated(
                variable.calculation, _Approximation(sampler, varID, reasons, lengths), weight
            )
        sampler.sums[varID] = _reduced(found, lengths)
    return sampler.sums[varID]


@dataclass(frozen=True)
class _Approximation:
    """What `approximate_variable` needs on its way through the calculation of a variable."""

    sampler: Sampler
    varID: str
    reasons: Mapping[str, str]
    lengths: Mapping[str, float]


def _approximated(expression: mathml.Expression, of: _Approximation, weight: float) -> Sum:
    if isinstance(expression, mathml.Name):
        return approximate_variable(of.sampler, expression.varID, of.reasons, of.lengths, weight)
    exact = _exact(expression, of)
    if exact is not None:
        return exact
    operator = expression.operator if isinstance(expression, mathml.Apply) else ""
    if isinstance(expression, mathml.Apply) and operator in ("plus", "minus"):
        return _operation(
            operator, [_approximated(argument, of, weight) for argument in expression.arguments]
        )
    if isinstance(expression, mathml.Apply) and operator in ("times", "divide", "quotient"):
        return _product(list(_factors(expression)), of, weight)
    return of.sampler.expression(expression, of.varID, weight)


def _product(factors: list[mathml.Expression], of: _Approximation, weight: float) -> Sum:
    """Return a product whose exact factors stay exact."""
    found = [_exact(factor, of) for factor in factors]
    product = polynomials.make_constant_sum(1.0)
    for one in found:
        product = product if one is None else polynomials.multiply_sums(product, one)
    for factor, one in zip(factors, found, strict=True):
        if one is None:
            product = polynomials.multiply_sums(
                product, _approximated(factor, of, weight * of.sampler.magnitude(product))
            )
    return product


def _factors(expression: mathml.Apply) -> Iterator[mathml.Expression]:
    """Yield the factors of a product or quotient, the denominator as one over it."""
    numerator = expression.arguments if expression.operator == "times" else expression.arguments[:1]
    yield from numerator
    for denominator in expression.arguments[len(numerator) :]:
        yield mathml.Apply("power", (denominator, mathml.MathNumber(-1.0)))


def _exact(expression: mathml.Expression, of: _Approximation) -> Sum | None:
    try:
        return _expression(expression, _Lookup(of.sampler.sums, of.reasons))
    except Inexact:
        return None


def node_standard_errors(uncertainty: Uncertainty | None, values: np.ndarray) -> np.ndarray | None:
    """Return the standard errors (shape of the values) that an uncertainty states, or None when it
    states none.

    A normal distribution gives bound / numSigmas, a uniform one of half width w gives w / sqrt(3);
    bounds in per cent or as a factor count from the values.
    """
    if uncertainty is None or any(isinstance(bound, str) for bound in uncertainty.bounds):
        return None
    bounds = [np.asarray(bound, float) for bound in uncertainty.bounds]
    if any(bound.size not in (1, values.size) for bound in bounds):
        return None
    sizes = [
        bound.reshape(values.shape)
        if bound.size == values.size
        else np.broadcast_to(bound.ravel()[0], values.shape)
        for bound in bounds
    ]
    if uncertainty.effect == "absolute":
        return None if len(sizes) < 2 else np.abs(sizes[1] - sizes[0]) / np.sqrt(12.0)
    width = sizes[0] if len(sizes) == 1 else (np.abs(sizes[0]) + np.abs(sizes[1])) / 2.0
    sigma = np.abs(width) / (uncertainty.sigmas or np.sqrt(3.0))
    return (
        sigma
        * {"additive": 1.0, "percentage": np.abs(values) / 100.0, "multiplicative": np.abs(values)}[
            uncertainty.effect
        ]
    )


def _variable(
    model: DaveModel, varID: str, inputs: Mapping, sums: Mapping, reasons: Mapping
) -> Sum:
    variable = model.variables[varID]
    if varID in inputs:
        return inputs[varID]
    if variable.calculation is not None:
        return _expression(variable.calculation, _Lookup(sums, reasons))
    if varID in model.functions:
        return _function(model.functions[varID], _Lookup(sums, reasons))
    if variable.initial is None:
        raise Inexact(
            f"it is an input in {variable.units or 'no unit'} that no quantity of the "
            f"vocabulary belongs to; state one with names="
        )
    stderr = node_standard_errors(variable.uncertainty, np.asarray(variable.initial))
    if stderr is not None or variable.name.endswith(VALUE):
        return polynomials.make_table_sum(
            MultilinearTable((), np.asarray(variable.initial), stderr, varID, -1)
        )
    return polynomials.make_constant_sum(variable.initial)


def _limited(one: Sum, variable: DaveVariable) -> Sum:
    """Apply the limits of a variable."""
    if not np.isfinite((variable.low, variable.high)).any():
        return one
    value = one.constant
    if value is not None:
        return polynomials.make_constant_sum(float(np.clip(value, variable.low, variable.high)))
    try:
        return polynomials.apply_piecewise_linear(
            piecewise_linear.make_limiter(variable.low, variable.high), one, variable.varID
        )
    except Inexact as error:
        raise Inexact(
            f"it is limited to {variable.low:g} ... {variable.high:g}, and {error}"
        ) from None


def _reduced(one: Sum, lengths: Mapping[str, float]) -> Sum:
    """Write p/V as the reduced rate phat * 2/b, and so on."""
    products: dict[polynomials.Product, float] = {}
    for (grids, powers), coefficient in one.products.items():
        counts = dict(powers)
        for name, (rate, length) in REDUCED.items():
            count = min(counts.get(rate, 0), -counts.get("V", 0))
            if count <= 0:
                continue
            if length not in lengths:
                raise Inexact(
                    f"it holds {rate}/V, and the file does not state {length}; pass {length}="
                )
            counts[rate], counts["V"] = counts[rate] - count, counts["V"] + count
            counts[name] = counts.get(name, 0) + count
            coefficient *= (2.0 / lengths[length]) ** count
            coefficient = (
                round(coefficient) if abs(coefficient - round(coefficient)) < 1e-14 else coefficient
            )  # units there and back
        left = tuple(sorted((name, power) for name, power in counts.items() if power))
        products[(grids, left)] = products.get((grids, left), 0.0) + coefficient
    return Sum(products)


class _Lookup:
    """The sums of the variables so far; one that has none gives the reason."""

    def __init__(self, sums: Mapping[str, Sum], reasons: Mapping[str, str]):
        self.sums, self.reasons = sums, reasons

    def __getitem__(self, varID: str) -> Sum:
        if varID not in self.sums:
            raise Inexact(f"it uses {varID}: {self.reasons[varID]}")
        return self.sums[varID]


def _expression(expression: mathml.Expression, known: _Lookup) -> Sum:
    if isinstance(expression, mathml.MathNumber):
        return polynomials.make_constant_sum(expression.value)
    if isinstance(expression, mathml.Name):
        return known[expression.varID]
    if isinstance(expression, mathml.Choice):
        return _choice(expression, known)
    arguments = [_expression(argument, known) for argument in expression.arguments]
    numbers = [argument.constant for argument in arguments]
    if all(number is not None for number in numbers):
        with np.errstate(all="ignore"):
            value = float(
                mathml.OPERATORS[expression.operator][0](
                    *(np.asarray(number) for number in numbers)
                )
            )
        if not np.isfinite(value):
            raise Inexact(f"{expression.operator} of numbers gives {value}")
        return polynomials.make_constant_sum(value)
    return _operation(expression.operator, arguments)


def _operation(operator: str, arguments: list[Sum]) -> Sum:
    first, rest = arguments[0], arguments[1:]
    if operator == "plus":
        return polynomials.add_sums(arguments)
    if operator == "minus":
        return (
            polynomials.add_sums([first, *(polynomials.scale_sum(one, -1.0) for one in rest)])
            if rest
            else polynomials.scale_sum(first, -1.0)
        )
    if operator == "times":
        for one in rest:
            first = polynomials.multiply_sums(first, one)
        return first
    if operator in ("divide", "quotient"):
        return polynomials.multiply_sums(first, polynomials.invert_sum(rest[0]))
    if operator == "power" and rest[0].constant is not None:
        return polynomials.power_of_sum(first, rest[0].constant)
    if operator == "abs":
        return polynomials.apply_piecewise_linear(piecewise_linear.ABS, first)
    if operator in ("max", "min"):
        sign = 1.0 if operator == "max" else -1.0
        for one in rest:  # max(a, b) = a + max(b - a, 0), min(a, b) = a - max(a - b, 0)
            gap = polynomials.scale_sum(
                polynomials.add_sums([one, polynomials.scale_sum(first, -1.0)]), sign
            )
            first = polynomials.add_sums(
                [
                    first,
                    polynomials.scale_sum(
                        polynomials.apply_piecewise_linear(piecewise_linear.POSITIVE, gap), sign
                    ),
                ]
            )
        return first
    raise Inexact(f"{operator} of {_listed(*arguments)} is no sum of products")


def _listed(*sums: Sum) -> str:
    return ", ".join(sorted(set().union(*(one.variables for one in sums))))


def _choice(choice: mathml.Choice, known: _Lookup) -> Sum:
    """Return a piecewise expression whose conditions compare one variable with a number, and which
    does not jump there.
    """
    if choice.otherwise is None:
        raise Inexact("a piecewise without otherwise has no value everywhere")
    result = _expression(choice.otherwise, known)
    for value, condition in reversed(choice.pieces):
        held = _condition(condition, known)
        if held is True:
            result = _expression(value, known)
        elif held is not False:
            name, at, below = held
            gap = polynomials.add_sums(
                [_expression(value, known), polynomials.scale_sum(result, -1.0)]
            )
            result = polynomials.merge_tables(
                polynomials.add_sums([result, polynomials.restrict_sum(gap, name, at, below)])
            )
    return result


def _condition(condition: mathml.Expression, known: _Lookup) -> bool | tuple[str, float, bool]:
    """Return whether a condition always or never holds, or (variable, place, whether it holds
    below).
    """
    if (
        not isinstance(condition, mathml.Apply)
        or condition.operator not in _TURNED
        or len(condition.arguments) != 2
    ):
        value = _expression(condition, known).constant
        if value is None:
            raise Inexact("a condition that is no comparison by lt, gt, leq or geq")
        return value != 0.0
    one, other = (_expression(argument, known) for argument in condition.arguments)
    gap = polynomials.add_sums([one, polynomials.scale_sum(other, -1.0)])
    name, function = polynomials.as_piecewise_linear(gap)
    if not name:
        return bool(
            float(
                mathml.OPERATORS[condition.operator][0](np.asarray(gap.constant), np.asarray(0.0))
            )
        )
    if not function.is_line:
        raise Inexact(f"a condition that is no plain comparison of {name} with a number")
    slope = float(function.left)
    at = float(function.points[0] - function.values[0] / slope)
    return name, at, (condition.operator in ("lt", "leq")) == (slope > 0.0)


def _function(function: DaveFunction, known: _Lookup) -> Sum:
    """Return a table look-up whose inputs are each a piecewise-linear function of one variable, as
    a table over these variables.
    """
    if not isinstance(function.table, Gridded):
        raise Inexact("its table is ungridded")
    values = function.table.values
    stderr = node_standard_errors(function.uncertainty, values)
    axes: list[GridAxis] = []
    for index in reversed(range(len(function.axes))):
        axis, argument = function.axes[index], known[function.inputs[index]]
        if axis.interpolate != "linear" and len(axis.points) > 1:
            raise Inexact(
                f"its table is not linear in {function.inputs[index]} but {axis.interpolate}"
            )
        try:
            name, inner = polynomials.as_piecewise_linear(argument)
        except Inexact as error:
            raise Inexact(
                f"its input {function.inputs[index]} cannot be an axis: {error}"
            ) from None
        if any(name == other.variable for other in axes):
            raise Inexact(f"two of its inputs depend on {name}")
        made, values, stderr = _axis(axis, name, inner, values, stderr, index)
        axes = [*made, *axes]
    return polynomials.make_table_sum(
        MultilinearTable(tuple(axes), values, stderr, function.output, function.place)
    )


def _axis(
    axis: FunctionAxis,
    name: str,
    inner: PiecewiseLinear,
    values: np.ndarray,
    stderr: np.ndarray | None,
    index: int,
):
    """Return the axis (none for a number) over a variable, and values and standard errors seen over
    it.
    """
    if name and inner.is_line and not _limits(axis):
        return _straight(axis, name, inner, values, stderr, index)
    limiter = piecewise_linear.make_limiter(axis.low, axis.high)
    argument = piecewise_linear.compose_functions(limiter, inner) if _limits(axis) else inner
    plain = (GridAxis("", axis.points, axis.open_low, axis.open_high),)
    front = [None if item is None else np.moveaxis(item, index, 0) for item in (values, stderr)]
    along = [
        None if item is None else MultilinearTable((*plain, *_nameless(item)), item).along("")
        for item in front
    ]
    assert along[0] is not None
    if not name:
        at = np.array([float(argument.values[0])])
        picked = [None if one is None else one(at)[0] for one in along]
        return (), picked[0], None if picked[1] is None else np.abs(picked[1])
    points, table, low, high = piecewise_linear.as_axis(
        piecewise_linear.compose_functions(along[0], argument)
    )
    spread_there = (
        None if along[1] is None else np.moveaxis(np.abs(along[1](argument(points))), 0, index)
    )
    return (GridAxis(name, points, low, high),), np.moveaxis(table, 0, index), spread_there


def _straight(
    axis: FunctionAxis,
    name: str,
    inner: PiecewiseLinear,
    values: np.ndarray,
    stderr: np.ndarray | None,
    index: int,
):
    """Return an axis in other units, the nodes kept as they are."""
    slope, offset = float(inner.left), float(inner(np.zeros(1))[0])
    points, ends = (axis.points - offset) / slope, (axis.open_low, axis.open_high)
    if slope < 0.0:
        points, ends = points[::-1], ends[::-1]
        values, stderr = np.flip(values, index), None if stderr is None else np.flip(stderr, index)
    return (GridAxis(name, points, *ends),), values, stderr


def _limits(axis: FunctionAxis) -> bool:
    """Whether the limits of an input change what the table gives."""
    low, high = axis.points[0], axis.points[-1]
    return (axis.low > low or (axis.open_low and axis.low > -np.inf)) or (
        axis.high < high or (axis.open_high and axis.high < np.inf)
    )


def _nameless(item: np.ndarray) -> tuple[GridAxis, ...]:
    return tuple(
        GridAxis(f"axis {i}", np.arange(size, dtype=float)) for i, size in enumerate(item.shape[1:])
    )
