"""Conversion of the functions of a JSBSim file to sums of products."""

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
_LONGEST_CHAIN = 20  # functions that use each other by name
_TEXT_TAGS = ("description", "documentation")
_FIRST = 5  # initial breakpoints of an axis that no table has


def _engine_properties() -> dict[str, str]:
    """Return the variables of lever and thrust by property."""
    variables = {"propulsion/engine/thrust-lbs": "engine1.thrust"}
    for i in range(1, _MOST_ENGINES + 1):
        variables[throttle_property(i)] = f"engine{i}.throttle"
        variables[thrust_property(i)] = f"engine{i}.thrust"
        # JSBSim counts the engines from 0.
        variables[f"propulsion/engine[{i - 1}]/thrust-lbs"] = f"engine{i}.thrust"
    return variables


_ENGINES = _engine_properties()


class Functions:
    """The functions of one file.

    Parameters
    ----------
    named : mapping of str to Element
        Functions that others may use by their name.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    travel : mapping of str to float
        Deflection at which a normalised position is 1, by variable. [rad]
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
        # Results of named functions, and the names whose expansion is in progress.
        self.expanded: dict[str, Sum] = {}
        self.in_progress: list[str] = []
        self.depth = 0

    def products(self, function: Element) -> Sum:
        """Return the value of a ``<function>``.

        Raises
        ------
        ParseError
            JSBSim would not read it.
        NotAProduct
            It uses a property that is not a variable of the model.
        """
        parts = _operands(function)
        if len(parts) != 1:
            raise function.error(
                f"a function of {len(parts)} values",
                "one value, table or operation; put them into a <product> or <sum>",
            )
        return self._expand(parts[0])

    def _expand(self, element: Element) -> Sum:
        """Return the value of an element, up to a depth of nesting."""
        # Nested elements and functions used by name count together against the limit.
        if self.depth >= MAX_DEPTH:
            raise element.error(
                f"operations nested more than {MAX_DEPTH} deep",
                "a flatter function; divide it, or use tables",
            )
        self.depth += 1
        try:
            return self._expand_element(element)
        finally:
            self.depth -= 1

    def _expand_element(self, element: Element) -> Sum:
        tag = element.tag
        if tag in ("value", "v"):
            return [Product(element.number)]
        if tag in ("property", "p"):
            return self._expand_property(element.text)
        if tag in ("table", "t"):
            return [Product(tables=(self._read_table(element),))]
        if tag == "pi":
            return [Product(math.pi)]
        parts = _operands(element)
        if tag not in (*KNOWN, "interpolate1d"):
            raise element.error(
                f"<{tag}> in a function",
                "an operation of JSBSim, such as <product>, <sum> or <table>",
            )
        if tag == "interpolate1d":
            return self._join_tables(element, parts)
        if not parts and tag not in NOT_COMPUTED:
            raise element.error(f"<{tag}> without anything in it", "what it works on")
        return combine_sums(tag, [self._expand(part) for part in parts], self.sizes)

    def _expand_property(self, name: str) -> Sum:
        if name.startswith("-"):
            return scale_products(-1.0, self._expand_property(name[1:]))
        value = self._property_value(name)
        if value is not None:
            return [Product(value.factor, dict(value.symbols))]
        if name in MAGNITUDE:
            table = absolute_value_table(self._expand_property(MAGNITUDE[name]))
            assert table is not None
            return table
        if name in self.constants:
            return [Product(self.constants[name])]
        if name in self.named:
            return self._expand_function(name)
        raise NotAProduct(self._explain_unknown(name))

    def _property_value(self, name: str) -> PropertyValue | None:
        """Return a property as powers of symbols, or None if it is not of this form."""
        if name in PROPERTY:
            return PROPERTY[name]
        if name in _ENGINES:
            return PropertyValue(1.0, {_ENGINES[name]: 1})
        variable, sense = NORMALISED.get(name, ("", 1.0))
        if variable in self.travel:
            return PropertyValue(sense / self.travel[variable], {variable: 1})
        return None

    def _explain_unknown(self, name: str) -> str:
        if name in NORMALISED:
            variable = NORMALISED[name][0]
            return (
                f"{name} is a fraction and the file does not state of which angle; give "
                f"travel = {{{variable!r}: angle where it is 1}}"
            )
        return f"{name} is not a variable of the model"

    def _expand_function(self, name: str) -> Sum:
        """Return a function that is used by its name, with its tables marked as shared."""
        if name in self.expanded:
            return self.expanded[name]
        element = self.named[name]
        if len(self.in_progress) > _LONGEST_CHAIN:
            raise element.error(
                "functions that use each other", f"at most {_LONGEST_CHAIN} of them in a row"
            )
        if name in self.in_progress:
            raise element.error(
                f"the function {name}, which uses itself",
                "functions that do not go round in a circle",
            )
        self.in_progress.append(name)
        try:
            parts = self.products(element)
        finally:
            self.in_progress.pop()
        shared_parts = []
        for part in parts:
            shared_parts.append(replace(part, tables=(), shared=part.shared + part.tables))
        self.expanded[name] = shared_parts
        return shared_parts

    def _read_axis(self, name: str) -> tuple[str, float]:
        """Return the variable of a table axis, and its value in SI per unit of the property."""
        property_name = name.lstrip("-")
        value = self._property_value(property_name)
        if value is None:
            raise NotAProduct(f"a table over {name}: {self._explain_unknown(property_name)}")
        # The reference quantities are numbers, so one variable must remain.
        powers = {symbol: power for symbol, power in value.symbols.items() if symbol not in LENGTHS}
        if len(powers) != 1 or set(powers.values()) != {1}:
            raise NotAProduct(f"a table over {name}, which is not a single variable of the model")
        (variable,) = powers
        sense = -1.0 if name.startswith("-") else 1.0
        scale = value.factor * reference_factor(value.symbols, self.sizes)
        return variable, sense * jsbsim_unit(variable) / scale

    def _read_table(self, element: Element) -> xr.DataArray:
        """Return a table in SI, axes from the outermost to the columns."""
        names, grid, nodes = read_jsbsim_table(element)
        table = xr.DataArray(nodes)
        for index, (name, points) in enumerate(zip(names, grid, strict=True)):
            variable, scale = self._read_axis(MAGNITUDE.get(name, name))
            if variable in table.dims:
                raise NotAProduct(f"a table with {variable} on two axes")
            table = table.rename({f"dim_{index}": variable}).assign_coords({variable: points})
            if name in MAGNITUDE:
                table = _mirror_table(table, variable)
            table = table.assign_coords({variable: table[variable].values * scale})
            # A negative scale reverses the breakpoints.
            if scale < 0.0:
                table = table.isel({variable: slice(None, None, -1)})
        return table

    def _join_tables(self, element: Element, parts: Sequence[Element]) -> Sum:
        """Return ``<interpolate1d>`` between tables of the same axes as one table."""
        # The parts are a property, then pairs of a breakpoint and a table.
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
        tables = [_single_table(self._expand(part)) for part in parts[2::2]]
        for table in tables[1:]:
            if not _have_same_axes(table, tables[0]):
                raise NotAProduct("<interpolate1d> between tables of different axes")
        variable, scale = self._read_axis(parts[0].text)
        if variable in tables[0].dims:
            raise NotAProduct(f"<interpolate1d> over {variable}, which is an axis of its tables")
        joined = xr.concat(tables, xr.Variable(variable, points * scale))
        return [Product(tables=(joined.sortby(variable),))]


def _operands(element: Element) -> list[Element]:
    return [child for child in element.children if child.tag not in _TEXT_TAGS]


def _have_same_axes(a: xr.DataArray, b: xr.DataArray) -> bool:
    return a.dims == b.dims and all(a[d].equals(b[d]) for d in a.dims)


def _mirror_table(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return a table over the magnitude of a variable as a table over the variable."""
    points = table[axis].values
    # The side of positive values, from zero on. Below its first breakpoint the table is constant.
    side_points = np.union1d([0.0], points[points > 0.0])
    positive = table.interp({axis: np.clip(side_points, points[0], points[-1])})
    positive = positive.assign_coords({axis: side_points})
    # The side of negative values in rising order, without zero.
    negative = positive.isel({axis: slice(None, 0, -1)})
    negative = negative.assign_coords({axis: -negative[axis].values})
    return xr.concat([negative, positive], axis)


def _single_table(parts: Sum) -> xr.DataArray:
    """Return a sum that is one table, or one number, as a table."""
    message = "<interpolate1d> between values that are not tables"
    if len(parts) != 1:
        raise NotAProduct(message)
    part = parts[0]
    tables = (*part.tables, *part.shared)
    if part.symbols or part.opaque or len(tables) > 1:
        raise NotAProduct(message)
    return tables[0] * part.factor if tables else xr.DataArray(part.factor)


def sample_product(
    opaque: Sequence[OpaqueFactor],
    tables: Sequence[xr.DataArray],
    bound: float | None,
    box: Mapping[str, tuple[float, float]],
) -> tuple[xr.DataArray, str]:
    """Return a product of functions and tables as one table, and a remark on its accuracy.

    Parameters
    ----------
    opaque, tables : sequences
        The factors.
    bound : float, optional
        Largest difference between the product and the table inside the box.  None refuses the
        product.
    box : mapping of str to (low, high)
        Range of variables.  The default is the range of the tables that have the axis. [SI]

    Raises
    ------
    NotAProduct
        The bound or the range of a variable is missing, the table has too many axes or nodes, or
        the product is not finite.
    """
    labels = [factor.what for factor in opaque]
    variable_names: set[str] = set()
    for table in tables:
        labels.append(f"table({', '.join(map(str, table.dims))})")
        variable_names.update(map(str, table.dims))
    for factor in opaque:
        variable_names |= factor.variables
    label, variables = " x ".join(labels), sorted(variable_names)
    if bound is None:
        raise NotAProduct(
            f"{label} is not a product of tables without common axes; give sample = largest "
            f"difference to put it onto one table"
        )
    if len(variables) > MAX_AXES:
        raise NotAProduct(
            f"{label} depends on {', '.join(variables)}; a table has at most {MAX_AXES} axes"
        )
    leaves = []
    for table in tables:
        leaves.append(make_term(table.values, {str(d): table[d].values for d in table.dims}))

    def evaluate(states: Mapping[str, np.ndarray]) -> np.ndarray:
        value = np.ones(())
        for leaf in leaves:
            value = value * evaluate_term(leaf, states, "clamp")
        for factor in opaque:
            value = value * factor.value(states)
        if not np.isfinite(value).all():
            raise NotAProduct(
                f"{label} is not finite inside its box; give box = {{variable: (low, high)}} "
                f"to narrow it"
            )
        return value

    starts = {name: _initial_points(name, tables, box) for name in variables}
    try:
        sampled = tabulate_function(evaluate, starts, bound)
    except SamplingError as error:
        raise NotAProduct(f"{label}: {error}") from None
    # The refinement looks at one axis after the other, so the total difference is measured.
    worst = largest_difference(evaluate, sampled)
    if worst > bound:
        raise NotAProduct(
            f"{label} on {sampled.size} nodes differs by {worst:.2g}, more than {bound:.2g}; "
            f"give a wider bound or a narrower box"
        )
    remark = f"{label} sampled on {sampled.size} nodes: largest difference seen {worst:.2g}"
    return sampled, remark


def _initial_points(
    name: str, tables: Sequence[xr.DataArray], box: Mapping[str, tuple[float, float]]
) -> np.ndarray:
    """Return the breakpoints of all tables over an axis inside its range."""
    axes = [table[name].values for table in tables if name in table.dims]
    points = np.unique(np.concatenate(axes or [np.array([])]))
    if name in box:
        low, high = box[name]
        points = np.union1d(points[(points > low) & (points < high)], [low, high])
    if len(points) < 2:
        raise NotAProduct(
            f"no table states how far {name} goes; give box = {{{name!r}: (low, high)}}"
        )
    if len(points) == 2:
        return np.linspace(points[0], points[-1], _FIRST)
    return points
