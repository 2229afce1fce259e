"""Functions of a JSBSim file to sums of products, `products`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.products import (
    KNOWN,
    LENGTHS,
    NOT_COMPUTED,
    NotAProduct,
    OpaqueFactor,
    Product,
    Sum,
    absolute_value_table,
    combine_sums,
    reference_factor,
    scale_products,
)
from aerodb.exchange.jsbsim.properties import (
    MAGNITUDE,
    NORMALISED,
    PROPERTY,
    PropertyValue,
    jsbsim_unit,
    throttle_property,
    thrust_property,
)
from aerodb.exchange.jsbsim.terms import read_jsbsim_table
from aerodb.exchange.sampling import SamplingError, largest_difference, tabulate_function
from aerodb.exchange.xml_reader import MAX_DEPTH, Element
from flightmech.terms import MAX_AXES, evaluate_term, make_term

_MOST_ENGINES = 8
_ENGINES = {
    **{throttle_property(i): f"engine{i}.throttle" for i in range(1, _MOST_ENGINES + 1)},
    **{thrust_property(i): f"engine{i}.thrust" for i in range(1, _MOST_ENGINES + 1)},
    **{
        f"propulsion/engine[{i - 1}]/thrust-lbs": f"engine{i}.thrust"
        for i in range(1, _MOST_ENGINES + 1)
    },
    "propulsion/engine/thrust-lbs": "engine1.thrust",
}
_DEEPEST = 20
_WORDS = ("description", "documentation")


class Functions:
    """The functions of one file.

    Parameters
    ----------
    named : mapping of str to Element
        Functions that others may use by their name.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    travel : mapping of str to float
        Deflection by variable where JSBSim counts 1. [rad]
    constants : mapping of str to float
        Properties that are numbers.
    """

    def __init__(
        self,
        named: Mapping[str, Element],
        sizes: Mapping[str, float],
        travel: Mapping[str, float],
        constants: Mapping[str, float],
    ):
        self.named, self.sizes, self.travel, self.constants = named, sizes, travel, constants
        self.known: dict[str, Sum] = {}
        self.entered: list[str] = []
        self.depth = 0

    def products(self, function: Element) -> Sum:
        """Return the value of a ``<function>``.

        Raises
        ------
        ParseError
            It is not what JSBSim reads.
        Unfit
            It uses something that is no variable of the model.
        """
        parts = _operands(function)
        if len(parts) != 1:
            raise function.error(
                f"a function of {len(parts)} values",
                "one value, table or operation; put them into a <product> or <sum>",
            )
        return self._expand(parts[0])

    def _expand(self, element: Element) -> Sum:
        """Return the value of an element; nested elements and functions used by their names count
        together against the limit.
        """
        if self.depth >= MAX_DEPTH:
            raise element.error(
                f"operations nested more than {MAX_DEPTH} deep",
                "a flatter function; divide it, or use tables",
            )
        self.depth += 1
        try:
            return self._value(element)
        finally:
            self.depth -= 1

    def _value(self, element: Element) -> Sum:
        tag = element.tag
        if tag in ("value", "v"):
            return [Product(element.number)]
        if tag in ("property", "p"):
            return self._property(element.text)
        if tag in ("table", "t"):
            return [Product(tables=(self._table(element),))]
        if tag == "pi":
            return [Product(math.pi)]
        parts = _operands(element)
        if tag not in (*KNOWN, "interpolate1d"):
            raise element.error(
                f"<{tag}> in a function",
                "an operation of JSBSim, such as <product>, <sum> or <table>",
            )
        if tag == "interpolate1d":
            return self._interpolated(element, parts)
        if not parts and tag not in NOT_COMPUTED:
            raise element.error(f"<{tag}> without anything in it", "what it works on")
        return combine_sums(tag, [self._expand(part) for part in parts], self.sizes)

    def _property(self, name: str) -> Sum:
        if name.startswith("-"):
            return scale_products(-1.0, self._property(name[1:]))
        power = self._power(name)
        if power is not None:
            return [Product(power.factor, dict(power.symbols))]
        if name in MAGNITUDE:
            found = absolute_value_table(self._property(MAGNITUDE[name]))
            assert found is not None
            return found
        if name in self.constants:
            return [Product(self.constants[name])]
        if name in self.named:
            return self._function(name)
        raise NotAProduct(self._unknown(name))

    def _power(self, name: str) -> PropertyValue | None:
        """Return a property as powers of symbols, None when it is none."""
        if name in PROPERTY:
            return PROPERTY[name]
        if name in _ENGINES:
            return PropertyValue(1.0, {_ENGINES[name]: 1})
        variable, sense = NORMALISED.get(name, ("", 1.0))
        return (
            PropertyValue(sense / self.travel[variable], {variable: 1})
            if variable in self.travel
            else None
        )

    def _unknown(self, name: str) -> str:
        if name in NORMALISED:
            variable = NORMALISED[name][0]
            return (
                f"{name} is a fraction and the file does not state of which angle; give "
                f"travel = {{{variable!r}: angle where it is 1}}"
            )
        return f"{name} is no variable of the model"

    def _function(self, name: str) -> Sum:
        """Return a function that is used by its name, its tables marked as shared."""
        if name not in self.known:
            if len(self.entered) > _DEEPEST:
                raise self.named[name].error(
                    "functions that use each other", f"at most {_DEEPEST} of them in a row"
                )
            if name in self.entered:
                raise self.named[name].error(
                    f"the function {name}, which uses itself",
                    "functions that do not go round in a circle",
                )
            self.entered.append(name)
            try:
                found = self.products(self.named[name])
            finally:
                self.entered.pop()
            self.known[name] = [
                replace(part, tables=(), shared=part.shared + part.tables) for part in found
            ]
        return self.known[name]

    def _axis(self, name: str) -> tuple[str, float]:
        """Return the variable that a table looks up, and its value in SI per unit of the property."""
        power = self._power(name.lstrip("-"))
        if power is None:
            raise NotAProduct(f"a table over {name}: {self._unknown(name.lstrip('-'))}")
        variables = {
            symbol: exponent for symbol, exponent in power.symbols.items() if symbol not in LENGTHS
        }
        if len(variables) != 1 or set(variables.values()) != {1}:
            raise NotAProduct(f"a table over {name}, which is no single variable of the model")
        (variable,) = variables
        return variable, (-1.0 if name.startswith("-") else 1.0) * jsbsim_unit(variable) / (
            power.factor * reference_factor(power.symbols, self.sizes)
        )

    def _table(self, element: Element) -> xr.DataArray:
        """Return a table, axes from the outermost to the columns, in SI."""
        names, grid, nodes = read_jsbsim_table(element)
        found = xr.DataArray(nodes)
        for position, (name, points) in enumerate(zip(names, grid)):
            variable, scale = self._axis(MAGNITUDE.get(name, name))
            if variable in found.dims:
                raise NotAProduct(f"a table with {variable} on two axes")
            found = found.rename({f"dim_{position}": variable}).assign_coords({variable: points})
            if name in MAGNITUDE:
                found = _mirrored(found, variable)
            found = found.assign_coords({variable: found[variable].values * scale})
            if scale < 0.0:
                found = found.isel({variable: slice(None, None, -1)})
        return found

    def _interpolated(self, element: Element, parts: Sequence[Element]) -> Sum:
        """Return ``<interpolate1d>`` over tables of the same axes as one table with an axis more."""
        if len(parts) < 5 or len(parts) % 2 == 0 or parts[0].tag not in ("property", "p"):
            raise element.error(
                f"<interpolate1d> of {len(parts)} values",
                "a property, then at least two pairs of a number and a value",
            )
        points = np.array([part.number for part in parts[1::2]])
        if (np.diff(points) <= 0).any():
            raise element.error(
                "points of <interpolate1d> that do not rise", "points in rising order"
            )
        tables = [_tabulated(self._expand(part)) for part in parts[2::2]]
        if any(
            table.dims != tables[0].dims
            or not all(table[d].equals(tables[0][d]) for d in table.dims)
            for table in tables[1:]
        ):
            raise NotAProduct("<interpolate1d> between tables of different axes")
        variable, scale = self._axis(parts[0].text)
        if variable in tables[0].dims:
            raise NotAProduct(f"<interpolate1d> over {variable}, which is an axis of its tables")
        joined = xr.concat(tables, xr.Variable(variable, points * scale))
        return [Product(tables=(joined.sortby(variable),))]


def _operands(element: Element) -> list[Element]:
    return [child for child in element.children if child.tag not in _WORDS]


def _mirrored(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return a table over the magnitude of a variable as one over the variable."""
    points = table[axis].values
    kept = np.union1d([0.0], points[points > 0.0])
    right = table.interp({axis: np.clip(kept, points[0], points[-1])}).assign_coords({axis: kept})
    left = right.isel({axis: slice(None, 0, -1)})
    return xr.concat([left.assign_coords({axis: -left[axis].values}), right], axis)


def _tabulated(parts: Sum) -> xr.DataArray:
    """Return a sum that is one table, or one number."""
    part = parts[0] if len(parts) == 1 else Product(symbols={"": 1})
    tables = (*part.tables, *part.shared)
    if part.symbols or part.opaque or len(tables) > 1:
        raise NotAProduct("<interpolate1d> between values that are no tables")
    return tables[0] * part.factor if tables else xr.DataArray(part.factor)


_FIRST = 5  # breakpoints of an axis that no table has


def sample_product(
    opaque: Sequence[OpaqueFactor],
    tables: Sequence[xr.DataArray],
    bound: float | None,
    box: Mapping[str, tuple[float, float]],
) -> tuple[xr.DataArray, str]:
    """Return a product of functions and tables as one table, and a text that states how well.

    Parameters
    ----------
    opaque, tables : sequences
        The factors.
    bound : float, optional
        Largest difference between the product and the table inside the box; None: refuse.
    box : mapping of str to (low, high)
        Range of variables; without an entry, the range of the tables that have the axis. [SI]

    Raises
    ------
    Unfit
        With what to do: no bound, no range of a variable, too many axes or nodes, or not finite.
    """
    what = " x ".join(
        [
            *(one.what for one in opaque),
            *(f"table({', '.join(map(str, table.dims))})" for table in tables),
        ]
    )
    if bound is None:
        raise NotAProduct(
            f"{what} is no product of tables without common axes; give sample = largest "
            f"difference to put it onto one table"
        )
    variables = sorted(
        {str(d) for table in tables for d in table.dims}.union(*(one.variables for one in opaque))
    )
    if len(variables) > MAX_AXES:
        raise NotAProduct(
            f"{what} depends on {', '.join(variables)}; a table has at most {MAX_AXES} axes"
        )
    leaves = [
        make_term(table.values, {str(d): table[d].values for d in table.dims}) for table in tables
    ]

    def function(at: Mapping[str, np.ndarray]) -> np.ndarray:
        found = np.ones(())
        for leaf in leaves:
            found = found * evaluate_term(leaf, at, "clamp")
        for one in opaque:
            found = found * one.value(at)
        if not np.isfinite(found).all():
            raise NotAProduct(
                f"{what} is not finite inside its box; give box = {{variable: (low, high)}} "
                f"to narrow it"
            )
        return found

    try:
        table = tabulate_function(
            function, {name: _start(name, tables, box) for name in variables}, bound
        )
    except SamplingError as error:
        raise NotAProduct(f"{what}: {error}") from None
    worst = largest_difference(function, table)
    if worst > bound:
        raise NotAProduct(
            f"{what} on {table.size} nodes differs by {worst:.2g}, more than {bound:.2g}; "
            f"give a wider bound or a narrower box"
        )
    return table, f"{what} sampled on {table.size} nodes: largest difference seen {worst:.2g}"


def _start(
    name: str, tables: Sequence[xr.DataArray], box: Mapping[str, tuple[float, float]]
) -> np.ndarray:
    """Return the breakpoints of all tables over an axis inside its range."""
    points = np.unique(
        np.concatenate(
            [table[name].values for table in tables if name in table.dims] or [np.array([])]
        )
    )
    if name in box:
        low, high = box[name]
        points = np.union1d(points[(points > low) & (points < high)], [low, high])
    if len(points) < 2:
        raise NotAProduct(
            f"no table states how far {name} goes; give box = {{{name!r}: (low, high)}}"
        )
    return points if len(points) > 2 else np.linspace(points[0], points[-1], _FIRST)
