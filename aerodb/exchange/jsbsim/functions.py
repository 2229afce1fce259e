"""Conversion of the functions of a JSBSim file to sums of products."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.inputs import Inputs
from aerodb.exchange.jsbsim.products import (
    KNOWN,
    LENGTHS,
    NOT_COMPUTED,
    NotAProduct,
    OpaqueFactor,
    Product,
    Sum,
    Values,
    absolute_value_table,
    combine_sums,
    evaluate_products,
    reference_factor,
    scale_products,
)
from aerodb.exchange.jsbsim.properties import MAGNITUDE, jsbsim_unit
from aerodb.exchange.jsbsim.terms import read_jsbsim_table
from aerodb.exchange.xml_reader import MAX_DEPTH, Element
from flightmech.aircraft.controls import DEVICE
from flightmech.terms import evaluate_term, make_term

_LONGEST_CHAIN = 20  # functions that use each other by name
_TEXT_TAGS = ("description", "documentation")


class Functions:
    """The functions of one file.

    Parameters
    ----------
    named : mapping of str to Element
        Functions that others may use by their name.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    inputs : Inputs
        Meaning of the properties.
    """

    def __init__(
        self,
        named: Mapping[str, Element],
        sizes: Mapping[str, float],
        inputs: Inputs,
    ):
        self.named, self.sizes, self.inputs = named, sizes, inputs
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
            return self._expand_table(element)
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
        value = self.inputs.value(name)
        if value is not None:
            return [Product(value.factor, dict(value.symbols))]
        if name in MAGNITUDE:
            table = absolute_value_table(self._expand_property(MAGNITUDE[name]))
            assert table is not None
            return table
        derived = self.inputs.derived(name)
        if derived is not None:
            return derived
        if name in self.inputs.constants:
            return [Product(self.inputs.constants[name])]
        if name in self.named:
            return self._expand_function(name)
        value = self.inputs.device(name)
        return [Product(value.factor, dict(value.symbols))]

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

    def _read_axis(self, name: str) -> tuple[str, float, float]:
        """Return the variable of a table axis, and scale and offset of its value in SI.

        The value is scale * property + offset.
        """
        slope, constant = None, 0.0
        for part in self._expand_property(name):
            # The reference quantities are numbers, so one variable must remain.
            powers = {key: n for key, n in part.symbols.items() if key not in LENGTHS}
            number = part.factor * reference_factor(part.symbols, self.sizes)
            is_variable = len(powers) == 1 and set(powers.values()) == {1}
            if part.monomial and not powers:
                constant += number
            elif part.monomial and is_variable and slope is None and number != 0.0:
                ((variable, _),) = powers.items()
                slope = number
            else:
                raise NotAProduct(
                    f"a table over {name}, which is not a single variable of the model"
                )
        if slope is None:
            raise NotAProduct(f"a table over {name}, which is a number")
        # property = slope * variable / unit + constant
        scale = jsbsim_unit(variable) / slope
        return variable, scale, -constant * scale

    def _expand_table(self, element: Element) -> Sum:
        """Return a table; one whose axis is a function of variables is a factor of its own."""
        names, grid, nodes = read_jsbsim_table(element)
        try:
            axes = [self._read_axis(MAGNITUDE.get(name, name)) for name in names]
        except NotAProduct:
            return self._expand_composed_table(names, grid, nodes)
        table = xr.DataArray(nodes)
        for index, (name, points) in enumerate(zip(names, grid, strict=True)):
            variable, scale, offset = axes[index]
            if variable in table.dims:
                raise NotAProduct(f"a table with {variable} on two axes")
            table = table.rename({f"dim_{index}": variable}).assign_coords({variable: points})
            if name in MAGNITUDE:
                table = _mirror_table(table, variable)
            points = table[variable].values * scale
            table = table.assign_coords({variable: points + offset if offset else points})
            # A negative scale reverses the breakpoints.
            if scale < 0.0:
                table = table.isel({variable: slice(None, None, -1)})
        return [Product(tables=(table,))]

    def _expand_composed_table(
        self, names: Sequence[str], grid: Sequence[np.ndarray], nodes: np.ndarray
    ) -> Sum:
        """Return a table over functions of variables as a factor that is a function of these."""
        # A property that is unknown raises here with its own reason.
        arguments = [self._expand_property(name) for name in names]
        # An axis needs a name of the vocabulary; it stands for the value of a function here.
        axes = [f"{DEVICE}x{i}.setting" for i in range(len(names))]
        leaf = make_term(nodes, dict(zip(axes, grid, strict=True)))
        variables: frozenset[str] = frozenset()
        for part in itertools.chain.from_iterable(arguments):
            variables |= part.variables

        def look_up(states: Values) -> np.ndarray:
            at = {}
            for axis, parts in zip(axes, arguments, strict=True):
                at[axis] = evaluate_products(parts, states, self.sizes)
            return np.asarray(evaluate_term(leaf, at, "clamp"))

        if not variables:
            return [Product(float(look_up({})))]
        label = f"table({', '.join(names)})"
        return [Product(opaque=(OpaqueFactor(label, variables, look_up),))]

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
        variable, scale, offset = self._read_axis(parts[0].text)
        if variable in tables[0].dims:
            raise NotAProduct(f"<interpolate1d> over {variable}, which is an axis of its tables")
        joined = xr.concat(tables, xr.Variable(variable, points * scale + offset))
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
