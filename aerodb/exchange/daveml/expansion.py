"""Exact expansion of the variables of a DAVE-ML model into sums of products over quantities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerodb.exchange.daveml import piecewise_linear, polynomials
from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.elements import DaveFunction, DaveVariable, Uncertainty
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.document.tables import FunctionAxis, Gridded
from aerodb.exchange.daveml.piecewise_linear import PiecewiseLinear
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.vocabulary import VALUE
from aerodb.exchange.spelling import spell
from flightmech.names import REDUCED_RATES

_COMPARISONS = ("lt", "gt", "leq", "geq")
# Unit factors that multiply to a whole number except for rounding are that whole number.
_WHOLE_NUMBER = 1e-14


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
        ``b`` and ``cbar``, where the file or the caller states them. [m]

    Returns
    -------
    sums : dict of str to Sum
        Expanded variables, by varID.
    reasons : dict of str to str
        Why the others could not be expanded.
    """
    sums: dict[str, Sum] = {}
    reasons: dict[str, str] = {}
    for varID in model.order:
        try:
            expanded = _expand_variable(model, varID, inputs, ExpandedVariables(sums, reasons))
            # The limits of an airspeed input are ignored: reduced rates have no such limit.
            is_airspeed_input = expanded is inputs.get(varID) and expanded.variables == {"V"}
            if not is_airspeed_input:
                expanded = _apply_limits(expanded, model.variables[varID])
            sums[varID] = to_reduced_rates(expanded, lengths)
        except Inexact as error:
            reasons[varID] = str(error)
    return sums, reasons


class ExpandedVariables:
    """Sums of the variables expanded so far; the look-up of another variable raises its reason."""

    def __init__(self, sums: Mapping[str, Sum], reasons: Mapping[str, str]):
        self.sums, self.reasons = sums, reasons

    def __getitem__(self, varID: str) -> Sum:
        if varID not in self.sums:
            raise Inexact(f"it uses {varID}: {self.reasons[varID]}")
        return self.sums[varID]


def node_standard_errors(uncertainty: Uncertainty | None, values: np.ndarray) -> np.ndarray | None:
    """Return the standard errors that an uncertainty states, or None if it states none.

    A normal distribution gives bound / numSigmas.  A uniform distribution of half width w gives
    w / sqrt(3).  Bounds in per cent or as a factor are relative to the values.

    Parameters
    ----------
    uncertainty : Uncertainty or None
        Uncertainty of the values.
    values : array
        Values at the nodes.

    Returns
    -------
    array or None
        Standard errors, of the shape of the values.
    """
    if uncertainty is None or any(isinstance(bound, str) for bound in uncertainty.bounds):
        return None
    bounds = [np.asarray(bound, float) for bound in uncertainty.bounds]
    if any(bound.size not in (1, values.size) for bound in bounds):
        return None
    widths = [_fill_shape(bound, values) for bound in bounds]
    if uncertainty.effect == "absolute":
        if len(widths) < 2:
            return None
        # A uniform distribution between two bounds has the variance (b - a)^2 / 12.
        return np.abs(widths[1] - widths[0]) / np.sqrt(12.0)
    half_width = widths[0]
    if len(widths) > 1:
        half_width = (np.abs(widths[0]) + np.abs(widths[1])) / 2.0
    sigma = np.abs(half_width) / (uncertainty.sigmas or np.sqrt(3.0))
    scales = {
        "additive": 1.0,
        "percentage": np.abs(values) / 100.0,
        "multiplicative": np.abs(values),
    }
    return sigma * scales[uncertainty.effect]


def _fill_shape(bound: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a bound at every node."""
    if bound.size == values.size:
        return bound.reshape(values.shape)
    return np.broadcast_to(bound.ravel()[0], values.shape)


def _expand_variable(
    model: DaveModel, varID: str, inputs: Mapping[str, Sum], expanded: ExpandedVariables
) -> Sum:
    variable = model.variables[varID]
    if varID in inputs:
        return inputs[varID]
    if variable.calculation is not None:
        return expand_expression(variable.calculation, expanded)
    if varID in model.functions:
        return _expand_function(model.functions[varID], expanded)
    if variable.initial is None:
        raise Inexact(
            f"it is an input in {variable.units or 'no unit'} that no quantity of the "
            f"vocabulary belongs to; state one with {spell('names=', '--names')}, or fix it with "
            f"{spell('at=', '--at')}"
        )
    stderr = node_standard_errors(variable.uncertainty, np.asarray(variable.initial))
    if stderr is not None or variable.name.endswith(VALUE):
        # A table without axes keeps the standard error. Serial -1 sorts it before all tables.
        return polynomials.make_table_sum(
            MultilinearTable((), np.asarray(variable.initial), stderr, label=varID, serial=-1)
        )
    return polynomials.make_constant_sum(variable.initial)


def _apply_limits(expanded: Sum, variable: DaveVariable) -> Sum:
    """Limit a sum to the range of its variable."""
    if not np.isfinite((variable.low, variable.high)).any():
        return expanded
    value = expanded.constant
    if value is not None:
        return polynomials.make_constant_sum(float(np.clip(value, variable.low, variable.high)))
    try:
        return polynomials.apply_piecewise_linear(
            piecewise_linear.make_limiter(variable.low, variable.high), expanded, variable.varID
        )
    except Inexact as error:
        raise Inexact(
            f"it is limited to {variable.low:g} ... {variable.high:g}, and {error}"
        ) from None


def to_reduced_rates(expanded: Sum, lengths: Mapping[str, float]) -> Sum:
    """Replace rate / V by the reduced rate: p/V = phat 2/b, and so on for the other rates."""
    products: dict[polynomials.Product, float] = {}
    for (grids, powers), coefficient in expanded.products.items():
        counts = dict(powers)
        for name, (rate, length) in REDUCED_RATES.items():
            # Number of factors rate/V in the product.
            count = min(counts.get(rate, 0), -counts.get("V", 0))
            if count <= 0:
                continue
            if length not in lengths:
                raise Inexact(
                    f"it holds {rate}/V, and the file does not state {length}; pass {length}="
                )
            counts[rate] -= count
            counts["V"] += count
            counts[name] = counts.get(name, 0) + count
            coefficient *= (2.0 / lengths[length]) ** count
            # The file computes p b / 2V, so its factor b/2 cancels here except for rounding.
            if abs(coefficient - round(coefficient)) < _WHOLE_NUMBER:
                coefficient = round(coefficient)
        reduced_powers = tuple(sorted((name, power) for name, power in counts.items() if power))
        key = (grids, reduced_powers)
        products[key] = products.get(key, 0.0) + coefficient
    return Sum(products)


def expand_expression(expression: mathml.Expression, expanded: ExpandedVariables) -> Sum:
    """Return an expression as a sum, or raise `Inexact`."""
    if isinstance(expression, mathml.MathNumber):
        return polynomials.make_constant_sum(expression.value)
    if isinstance(expression, mathml.Name):
        return expanded[expression.varID]
    if isinstance(expression, mathml.Choice):
        return _expand_choice(expression, expanded)
    arguments = [expand_expression(argument, expanded) for argument in expression.arguments]
    numbers = [argument.constant for argument in arguments]
    if all(number is not None for number in numbers):
        value = _evaluate_operator(expression.operator, numbers)
        if not np.isfinite(value):
            raise Inexact(f"{expression.operator} of numbers gives {value}")
        return polynomials.make_constant_sum(value)
    return combine_sums(expression.operator, arguments)


def _evaluate_operator(operator: str, numbers: list[Any]) -> float:
    function = mathml.OPERATORS[operator][0]
    with np.errstate(all="ignore"):
        return float(function(*map(np.asarray, numbers)))


def combine_sums(operator: str, arguments: list[Sum]) -> Sum:
    """Return an operator of sums as a sum, or raise `Inexact`."""
    first, others = arguments[0], arguments[1:]
    if operator == "plus":
        return polynomials.add_sums(arguments)
    if operator == "minus":
        if not others:
            return polynomials.scale_sum(first, -1.0)
        return polynomials.add_sums([first, *(polynomials.scale_sum(s, -1.0) for s in others)])
    if operator == "times":
        for factor in others:
            first = polynomials.multiply_sums(first, factor)
        return first
    if operator in ("divide", "quotient"):
        return polynomials.multiply_sums(first, polynomials.invert_sum(others[0]))
    if operator == "power" and others[0].constant is not None:
        return polynomials.power_of_sum(first, others[0].constant)
    if operator == "abs":
        return polynomials.apply_piecewise_linear(piecewise_linear.ABS, first)
    if operator in ("max", "min"):
        return _expand_extreme(operator, first, others)
    variables: set[str] = set().union(*(argument.variables for argument in arguments))
    raise Inexact(f"{operator} of {', '.join(sorted(variables))} is not a sum of products")


def _expand_extreme(operator: str, first: Sum, others: list[Sum]) -> Sum:
    """Return the maximum or minimum of sums."""
    # max(a, b) = a + max(b - a, 0) and min(a, b) = a - max(a - b, 0)
    sign = 1.0 if operator == "max" else -1.0
    for argument in others:
        difference = polynomials.add_sums([argument, polynomials.scale_sum(first, -1.0)])
        gap = polynomials.scale_sum(difference, sign)
        positive = polynomials.apply_piecewise_linear(piecewise_linear.POSITIVE, gap)
        first = polynomials.add_sums([first, polynomials.scale_sum(positive, sign)])
    return first


@dataclass(frozen=True)
class _HalfLine:
    """The condition that a variable is below a limit, or above it."""

    variable: str
    limit: float
    below: bool


def _expand_choice(choice: mathml.Choice, expanded: ExpandedVariables) -> Sum:
    """Return a continuous piecewise expression whose conditions compare a variable and a number."""
    if choice.otherwise is None:
        raise Inexact("a piecewise without otherwise has no value everywhere")
    result = expand_expression(choice.otherwise, expanded)
    # The first piece that holds counts, so the pieces are laid over the result from the last on.
    for value, condition in reversed(choice.pieces):
        region = _condition_region(condition, expanded)
        if region is False:
            continue
        piece = expand_expression(value, expanded)
        if region is True:
            result = piece
            continue
        # result + (piece - result) on the half line; the difference must vanish at its limit.
        gap = polynomials.add_sums([piece, polynomials.scale_sum(result, -1.0)])
        restricted = polynomials.restrict_sum(
            gap, region.variable, region.limit, below=region.below
        )
        result = polynomials.merge_tables(polynomials.add_sums([result, restricted]))
    return result


def _condition_region(
    condition: mathml.Expression, expanded: ExpandedVariables
) -> bool | _HalfLine:
    """Return whether a condition always or never holds, or the half line on which it holds."""
    is_comparison = (
        isinstance(condition, mathml.Apply)
        and condition.operator in _COMPARISONS
        and len(condition.arguments) == 2
    )
    if not is_comparison:
        value = expand_expression(condition, expanded).constant
        if value is None:
            raise Inexact("a condition that is not a comparison by lt, gt, leq or geq")
        return value != 0.0
    assert isinstance(condition, mathml.Apply)
    first, second = (expand_expression(argument, expanded) for argument in condition.arguments)
    gap = polynomials.add_sums([first, polynomials.scale_sum(second, -1.0)])
    name, function = polynomials.as_piecewise_linear(gap)
    if not name:
        compare = mathml.OPERATORS[condition.operator][0]
        return bool(float(compare(np.asarray(gap.constant), np.asarray(0.0))))
    if not function.is_line:
        raise Inexact(f"a condition that is not a plain comparison of {name} with a number")
    # The line first - second is zero at the limit. A negative slope reverses the comparison.
    slope = float(function.left_slope)
    limit = float(function.points[0] - function.values[0] / slope)
    below = (condition.operator in ("lt", "leq")) == (slope > 0.0)
    return _HalfLine(name, limit, below)


def _expand_function(function: DaveFunction, expanded: ExpandedVariables) -> Sum:
    """Return a look-up whose inputs are piecewise linear in one variable each, as a table."""
    if not isinstance(function.table, Gridded):
        raise Inexact("its table is ungridded")
    values = function.table.values
    stderr = node_standard_errors(function.uncertainty, values)
    axes: list[GridAxis] = []
    # A constant input removes its axis. From the last axis on, the earlier indices stay valid.
    for index in reversed(range(len(function.axes))):
        axis, input_name = function.axes[index], function.inputs[index]
        argument = expanded[input_name]
        if axis.interpolate != "linear" and len(axis.points) > 1:
            raise Inexact(f"its table is not linear in {input_name} but {axis.interpolate}")
        try:
            name, inner = polynomials.as_piecewise_linear(argument)
        except Inexact as error:
            raise Inexact(f"its input {input_name} cannot be an axis: {error}") from None
        if any(name == earlier.variable for earlier in axes):
            raise Inexact(f"two of its inputs depend on {name}")
        view = _TableView(values, stderr, index)
        if name and inner.is_line and not _has_effective_limits(axis):
            view, new_axes = _convert_axis_units(axis, name, inner, view)
        else:
            view, new_axes = _compose_axis(axis, name, inner, view)
        values, stderr = view.values, view.stderr
        axes = [*new_axes, *axes]
    return polynomials.make_table_sum(
        MultilinearTable(tuple(axes), values, stderr, label=function.output, serial=function.index)
    )


@dataclass(frozen=True)
class _TableView:
    """Values and standard errors of a table, with the index of the axis that is replaced."""

    values: np.ndarray
    stderr: np.ndarray | None
    index: int


def _convert_axis_units(
    axis: FunctionAxis, name: str, inner: PiecewiseLinear, view: _TableView
) -> tuple[_TableView, list[GridAxis]]:
    """Return a table over the variable if the input is a line in it; the nodes stay the same."""
    slope, offset = float(inner.left_slope), float(inner(np.zeros(1))[0])
    points = (axis.points - offset) / slope
    open_low, open_high = axis.open_low, axis.open_high
    values, stderr = view.values, view.stderr
    if slope < 0.0:
        # The points fall, so the axis and the table are reversed.
        points = points[::-1]
        open_low, open_high = open_high, open_low
        values = np.flip(values, view.index)
        if stderr is not None:
            stderr = np.flip(stderr, view.index)
    return _TableView(values, stderr, view.index), [GridAxis(name, points, open_low, open_high)]


def _compose_axis(
    axis: FunctionAxis, name: str, inner: PiecewiseLinear, view: _TableView
) -> tuple[_TableView, list[GridAxis]]:
    """Return a table over the variable, or without the axis if the input is a constant."""
    limiter = piecewise_linear.make_limiter(axis.low, axis.high)
    argument = inner
    if _has_effective_limits(axis):
        argument = piecewise_linear.compose_functions(limiter, inner)
    index = view.index
    along = _as_function_of_axis(axis, np.moveaxis(view.values, index, 0))
    spread = None
    if view.stderr is not None:
        spread = _as_function_of_axis(axis, np.moveaxis(view.stderr, index, 0))
    if not name:
        node = np.array([float(argument.values[0])])
        stderr = None if spread is None else np.abs(spread(node)[0])
        return _TableView(along(node)[0], stderr, index), []
    points, table, open_low, open_high = piecewise_linear.as_axis(
        piecewise_linear.compose_functions(along, argument)
    )
    stderr = None
    if spread is not None:
        stderr = np.moveaxis(np.abs(spread(argument(points))), 0, index)
    composed = _TableView(np.moveaxis(table, 0, index), stderr, index)
    return composed, [GridAxis(name, points, open_low, open_high)]


def _has_effective_limits(axis: FunctionAxis) -> bool:
    """Return whether the limits of an input change the result of the table."""
    low, high = axis.points[0], axis.points[-1]
    cuts_low = axis.low > low or (axis.open_low and axis.low > -np.inf)
    cuts_high = axis.high < high or (axis.open_high and axis.high < np.inf)
    return cuts_low or cuts_high


def _as_function_of_axis(axis: FunctionAxis, table: np.ndarray) -> PiecewiseLinear:
    """Return a table as a function of its first axis."""
    first = GridAxis("", axis.points, axis.open_low, axis.open_high)
    # The names and points of the other axes do not matter.
    others = [
        GridAxis(f"axis {i}", np.arange(size, dtype=float))
        for i, size in enumerate(table.shape[1:])
    ]
    return MultilinearTable((first, *others), table).along("")
