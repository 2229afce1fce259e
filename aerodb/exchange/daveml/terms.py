"""Conversion of products of tables and variables to the terms of a database."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from aerodb.exchange.daveml.document import mathml
from aerodb.exchange.daveml.document.elements import DaveFunction
from aerodb.exchange.daveml.document.model import DaveModel
from aerodb.exchange.daveml.polynomials import GridAxis, Inexact, MultilinearTable, Sum
from aerodb.exchange.daveml.vocabulary import source_codes, unpack_attributes
from flightmech.aircraft.controls import DEVICE
from flightmech.names import lookup, quantity_attributes
from flightmech.terms import MAX_AXES, MAX_REGRESSORS, make_term, source_attributes

# Name of the contribution of a regressor. Another regressor gives its own name.
_WORDS = {
    "delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder", "delta_f": "flap",
    "delta_t": "tab", "delta_ta": "tab_aileron", "delta_tr": "tab_rudder", "delta_s": "spoiler",
    "delta_d": "differential_tail", "dnz": "load_factor", "CT": "power", "h_agl": "ground",
}  # fmt: skip
_FLOW = {"alpha", "beta", "mach", "h"}
# Half width of a table that stands for its variable, by unit.
_SPAN = {"rad": math.pi, "m s-1": 1000.0, "m": 1e5, "Pa": 1e6}
_OTHER_SPAN = 10.0  # half width for all other units
_TABLES = 1 + 2  # value, K1, K2

Factors = tuple[list[MultilinearTable], dict[str, int]]
"""Tables of a product, and the powers of its variables."""

Join = Callable[[list[MultilinearTable], Mapping[str, int], float], Iterator[Factors]]


@dataclass(frozen=True)
class CoefficientPart:
    """A part of a coefficient.

    Parameters
    ----------
    name : str
        Name of the contribution in the file, or ``""``.
    sum : Sum
        The part as a sum.
    order : tuple of str
        Variables that multiply the part, in the order of the file.
    texts : mapping of str to str or float
        Attributes of the term.
    """

    name: str
    sum: Sum
    order: tuple[str, ...] = ()
    texts: Mapping[str, str | float] = field(default_factory=dict)


def parts_of(
    model: DaveModel, coefficient: str, varID: str, sums: Mapping[str, Sum]
) -> list[CoefficientPart]:
    """Return the parts of a coefficient, or one part without a name.

    The parts are the summands, if the file names every summand like ``CL/flap``.

    Parameters
    ----------
    model : DaveModel
        The model.
    coefficient : str
        The coefficient.
    varID : str
        The output that gives the coefficient.
    sums : mapping of str to Sum
        Variables of the model, by varID.
    """
    summands = _summand_names(model.variables[varID].calculation)
    pattern = re.compile(rf"{coefficient}/([A-Za-z][A-Za-z0-9_]*)")
    matches = [pattern.fullmatch(model.variables[name].name) for name in summands]
    if not all(matches):
        return [CoefficientPart("", sums[varID])]
    parts = []
    for name, match in zip(summands, matches, strict=True):
        assert match is not None
        order = _multiplying_variables(model, name, sums)
        texts = unpack_attributes(model.variables[name].description)
        parts.append(CoefficientPart(match[1], sums[name], order, texts))
    return parts or [CoefficientPart("", sums[varID])]


def _summand_names(calculation: mathml.Expression | None) -> list[str]:
    """Return the variables of a plain sum; empty for any other calculation."""
    if isinstance(calculation, mathml.Name):
        return [calculation.varID]
    if not isinstance(calculation, mathml.Apply) or calculation.operator != "plus":
        return []
    names = []
    for argument in calculation.arguments:
        if not isinstance(argument, mathml.Name):
            return []
        names.append(argument.varID)
    return names


def _multiplying_variables(
    model: DaveModel, varID: str, sums: Mapping[str, Sum]
) -> tuple[str, ...]:
    """Return the variables that multiply a term, in the order of the file."""
    calculation = model.variables[varID].calculation
    if not isinstance(calculation, mathml.Apply) or calculation.operator != "times":
        return ()
    names = []
    for argument in calculation.arguments:
        if not isinstance(argument, mathml.Name):
            continue
        products = sums[argument.varID].products
        _, powers = next(iter(products), ((), ()))
        # A factor with several variables, or none, does not determine the order.
        if len(powers) == 1:
            names.append(powers[0][0])
    return tuple(names)


def leaves_from_parts(
    model: DaveModel, coefficient: str, parts: Sequence[CoefficientPart], join: Join | None = None
) -> dict[str, xr.Dataset]:
    """Return the terms of a coefficient by name.

    Parameters
    ----------
    model : DaveModel
        The model.
    coefficient : str
        The coefficient.
    parts : sequence of CoefficientPart
        Its parts.
    join : callable, optional
        Yields a product that is not a term with some of its factors on one table, in the order of
        the attempts.  Without it such a product is refused.

    Raises
    ------
    Inexact
        A product is not a term: more factors than a term has, two tables of one variable, a
        division by a variable.
    """
    leaves: dict[str, xr.Dataset] = {}
    for part in parts:
        # A coefficient that is zero has a term with the value zero.
        products = part.sum.products or {((), ()): 0.0}
        for (grids, powers), factor in products.items():
            product = _Product(list(grids), dict(powers), factor)
            leaf = _make_leaf_or_join(model, product, part, join)
            labels = [grid.label for grid in grids]
            preferred = part.name or _contribution_name(leaf)
            name = _unused_name(preferred, labels, leaves, coefficient=coefficient)
            leaves[f"{coefficient}/{name}"] = leaf
    return leaves


@dataclass(frozen=True)
class _Product:
    """Factors of a term: tables, powers of variables, a number."""

    grids: list[MultilinearTable]
    powers: dict[str, int]
    factor: float


def _make_leaf_or_join(
    model: DaveModel, product: _Product, part: CoefficientPart, join: Join | None
) -> xr.Dataset:
    """Return a product as a term, if necessary with joined factors."""
    try:
        return _make_leaf(model, product, part)
    except Inexact as error:
        reason = error
    if join is not None:
        for grids, powers in join(product.grids, product.powers, product.factor):
            try:
                return _make_leaf(model, _Product(grids, powers, product.factor), part)
            except Inexact as error:
                reason = error
    raise reason


def _make_leaf(model: DaveModel, product: _Product, part: CoefficientPart) -> xr.Dataset:
    # Functions of the file become references, remarks on sampling become an attribute.
    labels = [grid.label for grid in product.grids if grid.label in model.functions]
    notes = [grid.note for grid in product.grids if grid.note]
    regressors = _repeat_powers(product.powers, part.order)
    tables, regressors = _fit_factors(product.grids, regressors, named=bool(part.name))
    _demand_disjoint(tables)
    outside, tables = unify_rules(tables)
    value, *factors = tables or [MultilinearTable((), np.ones(()))]
    texts = dict(part.texts) if part.name else _texts_of_functions(model, labels)
    source = str(texts.pop("source", ""))

    # The number of the product scales the first table.
    factor, values, stderr = product.factor, value.values, value.stderr
    if factor != 1.0:
        values = factor * values
    if stderr is not None:
        stderr = abs(factor) * stderr
    scales = {f"K{i}": _table_array(grid) for i, grid in enumerate(factors, 1)}
    leaf = make_term(
        values,
        {axis.variable: axis.points for axis in value.axes},
        regressors,
        stderr=stderr,
        outside=outside,
        **scales,  # type: ignore[arg-type]
    )
    # The source of the nodes is stored only if it fits the shape of the table.
    flags = source_codes(source, value.values.shape) if source else None
    if flags is not None:
        attributes = source_attributes(flags)
        leaf["source"] = (leaf["value"].dims, flags, attributes)
    leaf.attrs |= texts
    if notes:
        leaf.attrs["sampled"] = "; ".join(notes)
    return leaf


def _repeat_powers(powers: Mapping[str, int], order: Sequence[str]) -> list[str]:
    """Return each variable as often as its power, in the order of the file."""
    names = []
    for name, power in powers.items():
        if power < 0:
            raise Inexact(f"it divides by {name}")
        names += [name] * power
    return sorted(names, key=lambda name: order.index(name) if name in order else len(order))


def _fit_factors(
    grids: list[MultilinearTable], regressors: list[str], named: bool
) -> tuple[list[MultilinearTable], list[str]]:
    """Return at most three tables and two regressors with the same product."""
    if not named:
        grids = _absorb_scalars(grids)
    axis_names: set[str] = set()
    for grid in grids:
        axis_names |= set(grid.variables)
    # A regressor too many becomes a table of itself.
    for name in dict.fromkeys(regressors):
        if len(regressors) > MAX_REGRESSORS and name not in axis_names:
            regressors.remove(name)
            grids = [*grids, _identity_table(name)]
    if len(regressors) > MAX_REGRESSORS:
        raise Inexact(
            f"it is a product of {' '.join(regressors)}; a term has at most {MAX_REGRESSORS} such "
            f"factors"
        )
    _demand_disjoint(grids)
    # Too many tables: the two with the fewest axes become one table, their outer product.
    while len(grids) > _TABLES:
        a, b, *others = sorted(grids, key=lambda grid: len(grid.axes))
        if len(a.axes) + len(b.axes) > MAX_AXES:
            raise Inexact(f"it multiplies {len(grids)} tables; a term has at most {_TABLES}")
        values = np.multiply.outer(a.values, b.values)
        joined = MultilinearTable((*a.axes, *b.axes), values, None, label=a.label)
        grids = [*others, joined]
    for grid in grids:
        if len(grid.axes) > MAX_AXES:
            raise Inexact(
                f"the table {grid.label} has {len(grid.axes)} axes; a term has at most {MAX_AXES}"
            )
    return grids, regressors


def _absorb_scalars(grids: list[MultilinearTable]) -> list[MultilinearTable]:
    """Multiply uncertain constants into the first table, or into the first constant."""
    tables = [grid for grid in grids if grid.axes]
    scalars = [grid for grid in grids if not grid.axes]
    if not tables:
        tables, scalars = scalars[:1], scalars[1:]
    for scalar in scalars:
        table, constant = tables[0], float(scalar.values)
        table_spread = np.zeros(()) if table.stderr is None else table.stderr
        scalar_spread = np.zeros(()) if scalar.stderr is None else scalar.stderr
        # Error of a product to first order, independent errors: (c s_t)^2 + (t s_c)^2.
        stderr = np.hypot(constant * table_spread, table.values * scalar_spread)
        tables[0] = MultilinearTable(
            table.axes, constant * table.values, stderr, label=table.label, serial=table.serial
        )
    return tables


def _identity_table(name: str) -> MultilinearTable:
    """Return a table whose value is its variable."""
    span = _SPAN.get(lookup(name).units, _OTHER_SPAN)
    points = np.array([-span, span])
    axis = GridAxis(name, points, open_low=True, open_high=True)
    return MultilinearTable((axis,), points.copy())


def _demand_disjoint(grids: Sequence[MultilinearTable]) -> None:
    """Raise if two tables have the same variable."""
    table_of: dict[str, MultilinearTable] = {}
    for grid in grids:
        for name in grid.variables:
            if name in table_of:
                raise Inexact(
                    f"it multiplies two tables of {name}, {table_of[name].label} and {grid.label}"
                )
            table_of[name] = grid


def unify_rules(tables: Sequence[MultilinearTable]) -> tuple[str, list[MultilinearTable]]:
    """Return the rule outside the tables that holds for all axes, and tables that follow it.

    A term has one rule, ``hold`` or ``linear``, for all axes.  If some ends are open and others
    closed, the rule is ``linear``, and a closed end gets an interval in which the table is
    constant.
    """
    ends = set()
    for grid in tables:
        for axis in grid.axes:
            if len(axis.points) > 1:
                ends |= {axis.open_low, axis.open_high}
    if True not in ends:
        return "hold", list(tables)
    if False not in ends:
        return "linear", list(tables)
    opened = []
    for grid in tables:
        for index, axis in enumerate(grid.axes):
            if not (axis.open_low and axis.open_high):
                grid = grid.opened(index)
        opened.append(grid)
    return "linear", opened


def _table_array(grid: MultilinearTable) -> xr.DataArray:
    points = {axis.variable: axis.points for axis in grid.axes}
    array = xr.DataArray(grid.values, points, grid.variables)
    for name in grid.variables:
        array[name].attrs.update(quantity_attributes(name))
    return array


def _texts_of_functions(model: DaveModel, labels: Sequence[str]) -> dict[str, str | float]:
    """Return references and comment of a term from the functions of a foreign file."""
    functions = [model.functions[label] for label in labels]
    file = Path(model.file).name
    references = [_cite_function(file, function) for function in functions]
    comments = [" ".join(f.description.split()) for f in functions if f.description]
    return {"references": "; ".join(references) or file, "comment": "; ".join(comments)}


def _cite_function(file: str, function: DaveFunction) -> str:
    text = f"{file}, line {function.line}: function {function.name}"
    if function.provenance and function.provenance.references:
        text += f" ({', '.join(function.provenance.references)})"
    return text


def _contribution_name(leaf: xr.Dataset) -> str:
    """Return the name of a term without a name, from its regressors, or else from its axes."""
    regressors = str(leaf.attrs["regressors"]).split()
    if regressors:
        return "_".join(_contribution_word(name) for name in regressors)
    axes = [str(axis) for axis in leaf.dims]
    configuration = [axis for axis in axes if axis not in _FLOW]
    # A table over the flow angles is the basic contribution, whatever its other axes.
    if not configuration or (set(axes) & {"alpha", "beta"}):
        return "basic"
    return _contribution_word(configuration[0])


def _contribution_word(variable: str) -> str:
    """Return the usual name of a contribution, the name of a device, or the variable."""
    default = variable.split(".")[1] if variable.startswith(DEVICE) else variable
    return _WORDS.get(variable, default)


def _unused_name(
    name: str, labels: Sequence[str], leaves: Mapping[str, xr.Dataset], coefficient: str
) -> str:
    """Return the name, or the name with the varID of a table or with a number."""
    candidates = [name]
    for label in labels:
        if label:
            candidates.append(f"{name}_{re.sub('[^A-Za-z0-9_]', '_', label)}")
    # With len(leaves) + 1 numbers at least one candidate is free.
    for number in range(2, len(leaves) + 3):
        candidates.append(f"{name}_{number}")
    return next(text for text in candidates if f"{coefficient}/{text}" not in leaves)
