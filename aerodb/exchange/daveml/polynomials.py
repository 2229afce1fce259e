"""Sums of products of tables and powers of model variables: what a database can hold, and the
algebra that stays inside it.

Everything here is exact but for rounding.  What would leave the class, such as a product of two
tables of one variable, raises `Inexact` with the reason.
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
_ROUNDING = 1e-15


class Inexact(Exception):
    """An expression that is no sum of products of multilinear tables and variables; the text states
    why.
    """


_serial = itertools.count(10**6)  # tables that are made; those of a file count from 0, in its order


@dataclass(frozen=True, eq=False)
class GridAxis:
    """An axis of a `MultilinearTable`: model variable, rising points [SI], and whether the table goes on with
    its end slope below and above.
    """

    variable: str
    points: np.ndarray
    open_low: bool = False
    open_high: bool = False


@dataclass(frozen=True, eq=False)
class MultilinearTable:
    """A multilinear table over model variables, with the standard error of its nodes where the file
    states it.

    ``note`` states how well a table stands for what it was sampled from; empty for an exact one.
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
        if len(axis.points) == 1:
            return PiecewiseLinear(axis.points, values, flat, flat)
        slopes = (
            (values[1] - values[0]) / (axis.points[1] - axis.points[0]),
            (values[-1] - values[-2]) / (axis.points[-1] - axis.points[-2]),
        )
        return PiecewiseLinear(
            axis.points,
            values,
            slopes[0] if axis.open_low else flat,
            slopes[1] if axis.open_high else flat,
        )

    def replaced(self, variable: str, along: PiecewiseLinear) -> MultilinearTable:
        """Return the table with another function along one of its variables, without standard
        errors.
        """
        index = self.variables.index(variable)
        points, values, low, high = piecewise_linear.as_axis(along)
        axes = (*self.axes[:index], GridAxis(variable, points, low, high), *self.axes[index + 1 :])
        return MultilinearTable(axes, np.moveaxis(values, 0, index), None, self.label)

    def opened(self, index: int) -> MultilinearTable:
        """Return the same table with an axis that goes on with its end slope on both sides: held
        ends get a flat piece.
        """
        axis, values = self.axes[index], np.moveaxis(self.values, index, 0)
        stderr = None if self.stderr is None else np.moveaxis(self.stderr, index, 0)
        step = float(np.ptp(axis.points)) / max(len(axis.points) - 1, 1) or 1.0
        points, order = list(axis.points), list(range(len(axis.points)))
        if not axis.open_low:
            points, order = [points[0] - step, *points], [0, *order]
        if not axis.open_high or len(points) == 1:
            points, order = [*points, points[-1] + step], [*order, order[-1]]
        axes = (
            *self.axes[:index],
            GridAxis(axis.variable, np.array(points), True, True),
            *self.axes[index + 1 :],
        )
        put = [
            None if item is None else np.moveaxis(item[order], 0, index)
            for item in (values, stderr)
        ]
        assert put[0] is not None
        return MultilinearTable(axes, put[0], put[1], self.label)


Powers = tuple[tuple[str, int], ...]
Product = tuple[tuple[MultilinearTable, ...], Powers]
ONE: Product = ((), ())


@dataclass(frozen=True, eq=False)
class Sum:
    """A sum of products: coefficient by product of grids, in the order of their making, and powers
    of variables, by name.
    """

    products: Mapping[Product, float]

    @property
    def constant(self) -> float | None:
        """The value when there is no variable in the sum, else None."""
        if any(product != ONE for product in self.products):
            return None
        return self.products.get(ONE, 0.0)

    @property
    def variables(self) -> set[str]:
        """All model variables of the sum."""
        return {
            name
            for grids, powers in self.products
            for name in (*(v for grid in grids for v in grid.variables), *dict(powers))
        }


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
    """Return the sum of sums; like products are joined, and those that cancel but for rounding are
    gone.
    """
    total: dict[Product, float] = {}
    size: dict[Product, float] = {}
    for one in sums:
        for product, coefficient in one.products.items():
            total[product] = total.get(product, 0.0) + coefficient
            size[product] = size.get(product, 0.0) + abs(coefficient)
    if len(total) > MAX_PRODUCTS:
        raise Inexact(f"more than {MAX_PRODUCTS} products")
    return Sum(
        {
            product: coefficient
            for product, coefficient in total.items()
            if abs(coefficient) > _ROUNDING * size[product]
        }
    )


def scale_sum(one: Sum, factor: float) -> Sum:
    """Return a sum times a number."""
    return Sum(
        {product: coefficient * factor for product, coefficient in one.products.items()}
        if factor != 0.0
        else {}
    )


def multiply_sums(one: Sum, other: Sum) -> Sum:
    """Return the product of two sums."""
    if len(one.products) * len(other.products) > MAX_PRODUCTS:
        raise Inexact(f"more than {MAX_PRODUCTS} products")
    return add_sums(
        Sum({_joined(a, b): x * y})
        for a, x in one.products.items()
        for b, y in other.products.items()
    )


def _joined(a: Product, b: Product) -> Product:
    powers = dict(a[1])
    for name, power in b[1]:
        powers[name] = powers.get(name, 0) + power
        if abs(powers[name]) > MAX_POWER:
            raise Inexact(f"a power of {name} beyond {MAX_POWER}")
    grids = tuple(sorted((*a[0], *b[0]), key=lambda grid: grid.serial))
    return grids, tuple(sorted((name, power) for name, power in powers.items() if power))


def invert_sum(one: Sum) -> Sum:
    """Return 1 / sum, for a number times powers of variables."""
    if len(one.products) != 1:
        raise Inexact("division by a sum" if one.products else "division by zero")
    ((grids, powers), coefficient) = next(iter(one.products.items()))
    if grids:
        raise Inexact(f"division by the table {grids[0].label}")
    return Sum({((), tuple((name, -power) for name, power in powers)): 1.0 / coefficient})


def power_of_sum(one: Sum, exponent: float) -> Sum:
    """Return a sum to a whole power."""
    if exponent != round(exponent) or abs(exponent) > MAX_POWER:
        raise Inexact(
            f"the power {exponent:g} of {', '.join(sorted(one.variables))} is no sum of products"
        )
    if exponent < 0:
        return power_of_sum(invert_sum(one), -exponent)
    result = make_constant_sum(1.0)
    for _ in range(round(exponent)):
        result = multiply_sums(result, one)
    return result


def as_piecewise_linear(one: Sum) -> tuple[str, PiecewiseLinear]:
    """Return a sum that is a piecewise-linear function of one variable as that variable and
    function; a number has no variable, ``""``.
    """
    names = one.variables
    if len(names) > 1:
        raise Inexact(f"it depends on {', '.join(sorted(names))} together")
    name = next(iter(names), "")
    shapes = [piecewise_linear.make_line(0.0)]
    for (grids, powers), coefficient in one.products.items():
        degree = len(grids) + sum(abs(power) for _, power in powers)
        if degree > 1 or any(power < 0 for _, power in powers):
            raise Inexact(f"it is no piecewise-linear function of {name}")
        shape = (
            grids[0].along(name)
            if grids and name in grids[0].variables
            else piecewise_linear.make_line(1.0)
            if powers
            else piecewise_linear.make_line(0.0, 1.0)
        )
        if grids and not grids[0].axes:
            shape = piecewise_linear.make_line(0.0, float(grids[0].values))
        shapes.append(shape.times(coefficient))
    return name, reduce(piecewise_linear.add_functions, shapes)


def from_piecewise_linear(name: str, function: PiecewiseLinear, label: str = "") -> Sum:
    """Return a piecewise-linear function of one variable as a sum: a line, or a table."""
    if function.is_line:
        offset = float(function(np.zeros(1))[0])
        return (
            add_sums(
                [
                    scale_sum(make_variable_sum(name), float(function.left)),
                    make_constant_sum(offset),
                ]
            )
            if name
            else make_constant_sum(offset)
        )
    points, values, low, high = piecewise_linear.as_axis(function)
    return make_table_sum(
        MultilinearTable((GridAxis(name, points, low, high),), values, None, label)
    )


def apply_piecewise_linear(outer: PiecewiseLinear, one: Sum, label: str = "") -> Sum:
    """Return a piecewise-linear function of a sum, which must be one of a single variable itself."""
    name, inner = as_piecewise_linear(one)
    return from_piecewise_linear(name, piecewise_linear.compose_functions(outer, inner), label)


def restrict_sum(one: Sum, name: str, at: float, below: bool) -> Sum:
    """Return a sum where a variable is on one side of a place, and zero on the other; it must
    vanish at the place.

    The products are gathered by what else they hold; each gathering must vanish by itself.
    """
    gathered: dict[Product, list[tuple[MultilinearTable | None, float]]] = {}
    for (grids, powers), coefficient in one.products.items():
        own = [grid for grid in grids if name in grid.variables]
        degree = dict(powers).get(name, 0)
        if len(own) + abs(degree) > 1 or degree < 0:
            raise Inexact(f"a condition on {name} meets a product that is not linear in it")
        rest = (
            tuple(grid for grid in grids if name not in grid.variables),
            tuple(p for p in powers if p[0] != name),
        )
        shape = own[0] if own else None if degree else MultilinearTable((), np.ones(()))
        gathered.setdefault(rest, []).append((shape, coefficient))
    return add_sums(
        multiply_sums(Sum({rest: 1.0}), _side(parts, name, at, below))
        for rest, parts in gathered.items()
    )


def _side(
    parts: list[tuple[MultilinearTable | None, float]], name: str, at: float, below: bool
) -> Sum:
    flat = Sum(
        {
            (
                (grid,) if grid is not None and grid.axes else (),
                () if grid is not None else ((name, 1),),
            ): c
            for grid, c in parts
        }
    )
    if all(grid is None or len(grid.axes) < 2 for grid, _ in parts):
        _, function = as_piecewise_linear(flat)
        cut = piecewise_linear.restrict_function(function, at, below)
        if cut is not None:
            return from_piecewise_linear(name, cut)
    elif len(parts) == 1:
        grid, coefficient = parts[0]
        assert grid is not None
        cut = piecewise_linear.restrict_function(grid.along(name), at, below)
        if cut is not None:
            return scale_sum(make_table_sum(grid.replaced(name, cut)), coefficient)
    raise Inexact(f"it jumps where {name} passes {at:g}")


def merge_tables(one: Sum) -> Sum:
    """Return a sum in which tables over the same variables, with the same factors, are one table."""
    kept: dict[tuple[frozenset[str], Powers], MultilinearTable] = {}
    rest: list[Sum] = []
    for (grids, powers), coefficient in one.products.items():
        if len(grids) != 1 or not grids[0].axes:
            rest.append(Sum({(grids, powers): coefficient}))
            continue
        key, grid = (frozenset(grids[0].variables), powers), _scaled(grids[0], coefficient)
        kept[key] = _total(kept[key], grid) if key in kept else grid
    return add_sums([*(Sum({((grid,), powers): 1.0}) for (_, powers), grid in kept.items()), *rest])


def _scaled(grid: MultilinearTable, factor: float) -> MultilinearTable:
    stderr = None if grid.stderr is None else abs(factor) * grid.stderr
    return MultilinearTable(grid.axes, factor * grid.values, stderr, grid.label)


def _total(a: MultilinearTable, b: MultilinearTable) -> MultilinearTable:
    """Return the sum of two tables over the same variables, on the breakpoints of both."""
    order = [b.variables.index(name) for name in a.variables]
    b = MultilinearTable(
        tuple(b.axes[i] for i in order), np.transpose(b.values, order), None, b.label
    )
    for index in range(len(a.axes)):
        flags = [(grid.axes[index].open_low, grid.axes[index].open_high) for grid in (a, b)]
        if flags[0] != flags[1]:
            a, b = a.opened(index), b.opened(index)
        points = piecewise_linear.merge_points(a.axes[index].points, b.axes[index].points)
        a, b = _refined(a, index, points), _refined(b, index, points)
    return MultilinearTable(a.axes, a.values + b.values, None, a.label or b.label)


def _refined(grid: MultilinearTable, index: int, points: np.ndarray) -> MultilinearTable:
    """Return the same table on more breakpoints."""
    axis = grid.axes[index]
    values = np.moveaxis(grid.along(axis.variable)(points), 0, index)
    axes = (
        *grid.axes[:index],
        GridAxis(axis.variable, points, axis.open_low, axis.open_high),
        *grid.axes[index + 1 :],
    )
    return MultilinearTable(axes, values, None, grid.label)
