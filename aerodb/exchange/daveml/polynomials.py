"""Algebra of sums of products of tables and powers of variables, as a database holds them.

All operations are exact except for rounding.  An operation whose result is not such a sum raises
`Inexact` with the reason, for example a product of two tables of one variable.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from aerodb.exchange.daveml import piecewise_linear
from aerodb.exchange.daveml.piecewise_linear import PiecewiseLinear

MAX_PRODUCTS = 1000
MAX_POWER = 16
# A coefficient below this share of its summands is the rounding of zero.
_ROUNDING = 1e-15


class Inexact(Exception):
    """An expression that is not a sum of products of multilinear tables and variables."""


# Serials of new tables. The tables of a file count from 0 in its order and sort before them.
_serial = itertools.count(10**6)


@dataclass(frozen=True, eq=False)
class GridAxis:
    """An axis of a `MultilinearTable`.

    Parameters
    ----------
    variable : str
        Model variable.
    points : array (node,)
        Breakpoints, rising. [SI]
    open_low, open_high : bool
        Whether the table continues with its end slope below or above the breakpoints.
    """

    variable: str
    points: np.ndarray
    open_low: bool = False
    open_high: bool = False


@dataclass(frozen=True, eq=False)
class MultilinearTable:
    """A multilinear table over model variables.

    Parameters
    ----------
    axes : tuple of GridAxis
        The axes.
    values : array
        Values at the nodes, one dimension per axis.
    stderr : array, optional
        Standard errors of the values, if the file states them.
    label : str
        Name of the table in messages.
    serial : int
        Position of the table in a product.
    note : str
        Accuracy of a sampled table; empty for an exact table.
    """

    axes: tuple[GridAxis, ...]
    values: np.ndarray
    stderr: np.ndarray | None = None
    label: str = ""
    serial: int = field(default_factory=lambda: next(_serial))
    note: str = ""

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables of the axes."""
        return tuple(axis.variable for axis in self.axes)

    def along(self, variable: str) -> PiecewiseLinear:
        """Return the table as a function of one of its variables."""
        index = self.variables.index(variable)
        axis, values = self.axes[index], np.moveaxis(self.values, index, 0)
        flat = np.zeros(values.shape[1:])
        points = axis.points
        if len(points) == 1:
            return PiecewiseLinear(points, values, flat, flat)
        first_slope = (values[1] - values[0]) / (points[1] - points[0])
        last_slope = (values[-1] - values[-2]) / (points[-1] - points[-2])
        # A closed end holds its value, so its slope is zero.
        left_slope = first_slope if axis.open_low else flat
        right_slope = last_slope if axis.open_high else flat
        return PiecewiseLinear(points, values, left_slope, right_slope)

    def replaced(self, variable: str, along: PiecewiseLinear) -> MultilinearTable:
        """Return the table with another function along a variable, without standard errors."""
        index = self.variables.index(variable)
        points, values, low, high = piecewise_linear.as_axis(along)
        axes = self._replace_axis(index, GridAxis(variable, points, low, high))
        return MultilinearTable(axes, np.moveaxis(values, 0, index), None, label=self.label)

    def opened(self, index: int) -> MultilinearTable:
        """Return the same table with an axis that continues with its end slope on both sides.

        A closed end gets an additional interval in which the table is constant.
        """
        axis, values = self.axes[index], np.moveaxis(self.values, index, 0)
        step = float(np.ptp(axis.points)) / max(len(axis.points) - 1, 1) or 1.0
        # `order` maps the new nodes to the nodes whose values they repeat.
        points, order = list(axis.points), list(range(len(axis.points)))
        if not axis.open_low:
            points, order = [points[0] - step, *points], [0, *order]
        if not axis.open_high or len(points) == 1:
            points, order = [*points, points[-1] + step], [*order, order[-1]]
        new_axis = GridAxis(axis.variable, np.array(points), open_low=True, open_high=True)
        stderr = None
        if self.stderr is not None:
            stderr = np.moveaxis(np.moveaxis(self.stderr, index, 0)[order], 0, index)
        return MultilinearTable(
            self._replace_axis(index, new_axis),
            np.moveaxis(values[order], 0, index),
            stderr,
            label=self.label,
        )

    def _replace_axis(self, index: int, axis: GridAxis) -> tuple[GridAxis, ...]:
        return (*self.axes[:index], axis, *self.axes[index + 1 :])


Powers = tuple[tuple[str, int], ...]
Product = tuple[tuple[MultilinearTable, ...], Powers]
ONE: Product = ((), ())


@dataclass(frozen=True, eq=False)
class Sum:
    """A sum of products.

    Parameters
    ----------
    products : mapping of Product to float
        Coefficient of each product.  A product is its tables, sorted by serial, and the powers of
        its variables, sorted by name.
    """

    products: Mapping[Product, float]

    @property
    def constant(self) -> float | None:
        """The value if the sum has no variable, else None."""
        if any(product != ONE for product in self.products):
            return None
        return self.products.get(ONE, 0.0)

    @property
    def variables(self) -> set[str]:
        """All model variables of the sum."""
        names: set[str] = set()
        for grids, powers in self.products:
            names.update(dict(powers))
            for grid in grids:
                names.update(grid.variables)
        return names


def make_constant_sum(value: float) -> Sum:
    """Return a number as a sum."""
    return Sum({ONE: float(value)} if value != 0.0 else {})


def make_variable_sum(name: str, factor: float = 1.0, offset: float = 0.0) -> Sum:
    """Return factor * variable + offset."""
    return add_sums([Sum({((), ((name, 1),)): factor}), make_constant_sum(offset)])


def make_table_sum(grid: MultilinearTable) -> Sum:
    """Return a table as a sum."""
    return Sum({((grid,), ()): 1.0})


def add_sums(sums: Iterable[Sum]) -> Sum:
    """Return the total of sums; like products are added, and cancelled products are removed."""
    total: dict[Product, float] = {}
    size: dict[Product, float] = {}
    for summand in sums:
        for product, coefficient in summand.products.items():
            total[product] = total.get(product, 0.0) + coefficient
            size[product] = size.get(product, 0.0) + abs(coefficient)
    if len(total) > MAX_PRODUCTS:
        raise Inexact(f"more than {MAX_PRODUCTS} products")
    products = {}
    # A coefficient that is small against the absolute sum of its summands is their rounding.
    for product, coefficient in total.items():
        if abs(coefficient) > _ROUNDING * size[product]:
            products[product] = coefficient
    return Sum(products)


def scale_sum(expression: Sum, factor: float) -> Sum:
    """Return a sum times a number."""
    if factor == 0.0:
        return Sum({})
    products = expression.products
    return Sum({product: coefficient * factor for product, coefficient in products.items()})


def multiply_sums(left: Sum, right: Sum) -> Sum:
    """Return the product of two sums."""
    if len(left.products) * len(right.products) > MAX_PRODUCTS:
        raise Inexact(f"more than {MAX_PRODUCTS} products")
    pairs = itertools.product(left.products.items(), right.products.items())
    return add_sums(Sum({_multiply_products(a, b): x * y}) for (a, x), (b, y) in pairs)


def _multiply_products(left: Product, right: Product) -> Product:
    # x^m x^n = x^(m + n); a power of zero is dropped.
    powers = dict(left[1])
    for name, power in right[1]:
        powers[name] = powers.get(name, 0) + power
        if abs(powers[name]) > MAX_POWER:
            raise Inexact(f"a power of {name} beyond {MAX_POWER}")
    # Tables in the order of their serials, so that equal products have equal keys.
    grids = tuple(sorted((*left[0], *right[0]), key=lambda grid: grid.serial))
    return grids, tuple(sorted((name, power) for name, power in powers.items() if power))


def invert_sum(expression: Sum) -> Sum:
    """Return 1 / sum, for a number times powers of variables."""
    if not expression.products:
        raise Inexact("division by zero")
    if len(expression.products) != 1:
        raise Inexact("division by a sum")
    ((grids, powers), coefficient) = next(iter(expression.products.items()))
    if grids:
        raise Inexact(f"division by the table {grids[0].label}")
    return Sum({((), tuple((name, -power) for name, power in powers)): 1.0 / coefficient})


def power_of_sum(expression: Sum, exponent: float) -> Sum:
    """Return a sum to a whole power."""
    if exponent != round(exponent) or abs(exponent) > MAX_POWER:
        # The expansion of a high power would exceed the limit of products.
        names = ", ".join(sorted(expression.variables))
        raise Inexact(f"the power {exponent:g} of {names} is not a sum of products")
    if exponent < 0:
        return power_of_sum(invert_sum(expression), -exponent)
    result = make_constant_sum(1.0)
    for _ in range(round(exponent)):
        result = multiply_sums(result, expression)
    return result


def as_piecewise_linear(expression: Sum) -> tuple[str, PiecewiseLinear]:
    """Return variable and function of a sum that is piecewise linear in one variable.

    The variable of a number is ``""``.

    Raises
    ------
    Inexact
        The sum depends on several variables, or it is not piecewise linear.
    """
    names = expression.variables
    if len(names) > 1:
        raise Inexact(f"it depends on {', '.join(sorted(names))} together")
    name = next(iter(names), "")
    functions = [piecewise_linear.make_line(0.0)]
    for (grids, powers), coefficient in expression.products.items():
        degree = len(grids) + sum(abs(power) for _, power in powers)
        if degree > 1 or any(power < 0 for _, power in powers):
            raise Inexact(f"it is not a piecewise-linear function of {name}")
        # A table without axes is a constant with a standard error.
        # With degree 0 or 1 the product is a table, the variable itself, or a number.
        if grids and not grids[0].axes:
            function = piecewise_linear.make_line(0.0, float(grids[0].values))
        elif grids:
            function = grids[0].along(name)
        elif powers:
            function = piecewise_linear.make_line(1.0)
        else:
            function = piecewise_linear.make_line(0.0, 1.0)
        functions.append(function.times(coefficient))
    return name, reduce(piecewise_linear.add_functions, functions)


def from_piecewise_linear(name: str, function: PiecewiseLinear, label: str = "") -> Sum:
    """Return a piecewise-linear function of one variable as a sum: a line, or a table."""
    if function.is_line:
        offset = make_constant_sum(float(function(np.zeros(1))[0]))
        if not name:
            return offset
        slope = scale_sum(make_variable_sum(name), float(function.left_slope))
        return add_sums([slope, offset])
    # A function with a bend becomes a table over its nodes.
    points, values, low, high = piecewise_linear.as_axis(function)
    axis = GridAxis(name, points, low, high)
    return make_table_sum(MultilinearTable((axis,), values, None, label=label))


def apply_piecewise_linear(outer: PiecewiseLinear, expression: Sum, label: str = "") -> Sum:
    """Return a piecewise-linear function of a sum that is piecewise linear in one variable."""
    name, inner = as_piecewise_linear(expression)
    return from_piecewise_linear(name, piecewise_linear.compose_functions(outer, inner), label)


def restrict_sum(expression: Sum, name: str, limit: float, below: bool) -> Sum:
    """Return a sum on one side of a limit of a variable, and zero on the other side.

    The products are grouped by their factors that do not depend on the variable.

    Parameters
    ----------
    expression : Sum
        The sum.
    name : str
        The variable.
    limit : float
        Value of the variable at which each group must vanish. [SI]
    below : bool
        Whether the sum stays below the limit, or above it.

    Raises
    ------
    Inexact
        A group does not vanish at the limit, or a product is not linear in the variable.
    """
    groups: dict[Product, list[tuple[MultilinearTable | None, float]]] = {}
    for (grids, powers), coefficient in expression.products.items():
        dependent = [grid for grid in grids if name in grid.variables]
        degree = dict(powers).get(name, 0)
        if len(dependent) + abs(degree) > 1 or degree < 0:
            raise Inexact(f"a condition on {name} meets a product that is not linear in it")
        other_grids = tuple(grid for grid in grids if name not in grid.variables)
        other_powers = tuple(entry for entry in powers if entry[0] != name)
        # None stands for the variable itself, a table without axes for a constant.
        factor: MultilinearTable | None = None
        if dependent:
            factor = dependent[0]
        elif not degree:
            factor = MultilinearTable((), np.ones(()))
        groups.setdefault((other_grids, other_powers), []).append((factor, coefficient))
    restricted = []
    for other_factors, parts in groups.items():
        side = _restrict_group(parts, name, limit, below=below)
        restricted.append(multiply_sums(Sum({other_factors: 1.0}), side))
    return add_sums(restricted)


def _restrict_group(
    parts: list[tuple[MultilinearTable | None, float]], name: str, limit: float, below: bool
) -> Sum:
    """Restrict a sum of tables and multiples of one variable to one side of the limit."""
    if all(grid is None or len(grid.axes) < 2 for grid, _ in parts):
        products: dict[Product, float] = {}
        for grid, coefficient in parts:
            product: Product = ONE
            if grid is None:
                product = ((), ((name, 1),))
            elif grid.axes:
                product = ((grid,), ())
            products[product] = coefficient
        _, function = as_piecewise_linear(Sum(products))
        restricted = piecewise_linear.restrict_function(function, limit, below)
        if restricted is not None:
            return from_piecewise_linear(name, restricted)
    elif len(parts) == 1:
        # One table of several variables is restricted along the axis of the condition.
        grid, coefficient = parts[0]
        assert grid is not None
        restricted = piecewise_linear.restrict_function(grid.along(name), limit, below)
        if restricted is not None:
            return scale_sum(make_table_sum(grid.replaced(name, restricted)), coefficient)
    raise Inexact(f"it jumps where {name} passes {limit:g}")


def merge_tables(expression: Sum) -> Sum:
    """Return a sum in which tables over the same variables, with the same factors, are added."""
    merged: dict[tuple[frozenset[str], Powers], MultilinearTable] = {}
    others: list[Sum] = []
    for (grids, powers), coefficient in expression.products.items():
        if len(grids) != 1 or not grids[0].axes:
            others.append(Sum({(grids, powers): coefficient}))
            continue
        # The key is the set of variables of the table and the powers that multiply it.
        key, grid = (frozenset(grids[0].variables), powers), _scale_table(grids[0], coefficient)
        merged[key] = _add_tables(merged[key], grid) if key in merged else grid
    tables = [Sum({((grid,), powers): 1.0}) for (_, powers), grid in merged.items()]
    return add_sums([*tables, *others])


def _scale_table(grid: MultilinearTable, factor: float) -> MultilinearTable:
    stderr = None if grid.stderr is None else abs(factor) * grid.stderr
    return MultilinearTable(grid.axes, factor * grid.values, stderr, label=grid.label)


def _add_tables(a: MultilinearTable, b: MultilinearTable) -> MultilinearTable:
    """Return the sum of two tables over the same variables, on the breakpoints of both."""
    # The axes of the second table take the order of the first.
    order = [b.variables.index(name) for name in a.variables]
    axes = tuple(b.axes[i] for i in order)
    b = MultilinearTable(axes, np.transpose(b.values, order), None, label=b.label)
    # Axis by axis: first the same ends, then the same breakpoints.
    for index in range(len(a.axes)):
        first, second = a.axes[index], b.axes[index]
        if (first.open_low, first.open_high) != (second.open_low, second.open_high):
            a, b = a.opened(index), b.opened(index)
        points = piecewise_linear.merge_points(a.axes[index].points, b.axes[index].points)
        a, b = _refine_table(a, index, points), _refine_table(b, index, points)
    return MultilinearTable(a.axes, a.values + b.values, None, label=a.label or b.label)


def _refine_table(grid: MultilinearTable, index: int, points: np.ndarray) -> MultilinearTable:
    """Return the same table on more breakpoints."""
    axis = grid.axes[index]
    values = np.moveaxis(grid.along(axis.variable)(points), 0, index)
    refined = GridAxis(axis.variable, points, axis.open_low, axis.open_high)
    axes = (*grid.axes[:index], refined, *grid.axes[index + 1 :])
    return MultilinearTable(axes, values, None, label=grid.label)
