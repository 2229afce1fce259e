"""Tables of a JSBSim file, and conversion of its products to terms of a database.

A term is the product without the dynamic pressure and the reference quantities of a force or
moment.  A rate over the airspeed becomes the reduced rate, p b/2V.  A rate alone stays a rate.  The
rates of the flow angles exist as reduced rates only: alpha_dot = alphadothat * 2V/cbar.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.products import (
    LENGTHS,
    MOST_NODES,
    NotAProduct,
    OpaqueFactor,
    Product,
    reference_factor,
)
from aerodb.exchange.jsbsim.properties import AXIS, ENGINE, FUNCTION, jsbsim_unit, variable_range
from aerodb.exchange.xml_reader import Element
from flightmech.aircraft.controls import CONTROLS, DEVICE
from flightmech.names import REDUCED_RATES
from flightmech.terms import MAX_AXES, MAX_REGRESSORS, PowerFactor, make_term

# Values of the attribute ``lookup``, from the outermost axis to the columns.
_LOOKUPS = ("axis4", "table", "row", "column")


def read_jsbsim_table(element: Element) -> tuple[list[str], list[np.ndarray], np.ndarray]:
    """Return properties, breakpoints and nodes of a ``<table>``, the outermost axis first."""
    axes = element.all("independentVar")
    data = element.all("tableData")
    if not axes or not data:
        raise element.error(
            "a table without independentVar or tableData", "a table over at least one property"
        )
    if len(axes) == 1:
        points, values = _read_column(data[0])
        return [axes[0].text], [points], values
    lookups = [axis.attributes.get("lookup", "") for axis in axes]
    order = list(_LOOKUPS[-len(axes) :])
    if sorted(lookups) != sorted(order):
        raise axes[0].error(
            f"lookup {' '.join(lookups)!r} for {len(axes)} axes",
            f"lookup {' '.join(order)!r}, each once",
        )
    names = {lookup: axis.text for lookup, axis in zip(lookups, axes, strict=True)}
    if len(axes) > 2:
        grid, values = _read_blocks(data, len(axes), element)
    elif len(data) != 1:
        raise element.error(f"{len(data)} tableData for two axes", "one")
    else:
        grid, values = _read_rows(data[0])
    return [names[lookup] for lookup in order], grid, values


def _read_blocks(
    data: list[Element], axes: int, parent: Element
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints and nodes of a table whose outermost axis counts the blocks."""
    if len(data) < 2:
        raise parent.error(f"{len(data)} tableData where breakPoint counts", "at least two")
    points = [_read_break_point(item) for item in data]
    for item, low, high in zip(data[1:], points, points[1:], strict=False):
        if high <= low:
            raise item.error(f"breakPoint {high:g} after {low:g}", "breakpoints in rising order")
    blocks = []
    for item in data:
        if axes == 3:
            blocks.append(_read_rows(item))
        else:
            blocks.append(_read_blocks(item.all("tableData"), axes - 1, item))
    # Each block may have breakpoints of its own. The table has those of all blocks.
    grid = []
    for block_points in zip(*(block_grid for block_grid, _ in blocks), strict=True):
        grid.append(np.unique(np.concatenate(block_points)))
    if len(blocks) * math.prod(map(len, grid)) > MOST_NODES:
        raise parent.error(
            "blocks with breakpoints of their own, all together too many",
            f"a table of up to {MOST_NODES} nodes",
        )
    values = [_refine_block(nodes, block_grid, grid) for block_grid, nodes in blocks]
    return [np.array(points), *grid], np.stack(values)


def _refine_block(
    values: np.ndarray, block_grid: list[np.ndarray], grid: list[np.ndarray]
) -> np.ndarray:
    """Return a block on the breakpoints of all blocks, without a change of the function."""
    # A block is linear between its breakpoints and constant beyond, like np.interp.
    for index, (points, all_points) in enumerate(zip(block_grid, grid, strict=True)):
        if len(points) != len(all_points):
            values = np.apply_along_axis(partial(np.interp, all_points, points), index, values)
    return values


def _read_break_point(element: Element) -> float:
    text = element.attributes.get("breakPoint", "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise element.error(f"breakPoint {text!r}", "a finite number")
    return value


def _read_column(data: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return breakpoints and nodes of a table of one axis, one pair in a line."""
    lines = data.numbers()
    for line, numbers in lines:
        if len(numbers) != 2:
            raise data.error(
                f"{len(numbers)} numbers",
                "a breakpoint and a value in each line of a table of one axis",
                line,
            )
    if len(lines) < 2:
        raise data.error(f"a table of {len(lines)} breakpoints", "at least two")
    pairs = np.array([numbers for _, numbers in lines])
    _demand_rising(data, pairs[:, 0], [line for line, _ in lines])
    return pairs[:, 0], pairs[:, 1]


def _read_rows(data: Element) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints of rows and columns, and nodes, of a table of two axes."""
    lines = data.numbers()
    if len(lines) < 3 or len(lines[0][1]) < 2:
        raise data.error(
            f"a table of {max(len(lines) - 1, 0)} rows",
            "a line of column breakpoints, then at least two rows",
        )
    # The first line holds the columns, the first number of each other line is its row.
    first_line, columns = lines[0]
    _demand_rising(data, columns, [first_line] * len(columns))
    for line, numbers in lines[1:]:
        if len(numbers) != len(columns) + 1:
            raise data.error(
                f"{len(numbers)} numbers",
                f"a row breakpoint and {len(columns)} values, one to a column",
                line,
            )
    rows = np.array([numbers for _, numbers in lines[1:]])
    _demand_rising(data, rows[:, 0], [line for line, _ in lines[1:]])
    return [rows[:, 0], columns], rows[:, 1:]


def _demand_rising(data: Element, points: np.ndarray, lines: Sequence[int]) -> None:
    """Raise at the line of the first breakpoint that does not rise."""
    falling = np.flatnonzero(np.diff(points) <= 0)
    if falling.size:
        index = int(falling[0])
        raise data.error(
            f"breakpoint {points[index + 1]:g} after {points[index]:g}",
            "breakpoints in rising order",
            lines[index + 1],
        )


_MOST_TABLES = 3
# Largest power of a symbol. Dynamic pressure and lengths may be there in addition to regressors.
_HIGHEST = 2 * MAX_REGRESSORS
_KNOWN = {*AXIS, *FUNCTION, *CONTROLS, "CL"}
# Below these values a power stays constant, so that it is finite at rest: 1 ft/s at sea level.
_FLOOR = {"V": 0.3048, "qbar": 0.057}
Sampler = Callable[[list[OpaqueFactor], list[xr.DataArray]], tuple[xr.DataArray, str]]


def term_of_product(
    product: Product,
    per: Mapping[str, int],
    sizes: Mapping[str, float],
    sampler: Sampler,
    **text: str,
) -> xr.Dataset:
    """Return a product of a force, a moment or a coefficient as a term.

    Parameters
    ----------
    product : Product
        One product of a function of the file.
    per : mapping of str to int
        Powers that multiply the coefficient: ``{"qbar": 1, "S": 1, "b": 1}`` for a rolling moment.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    sampler : callable
        Returns one table for opaque factors and the tables that share axes with them or with each
        other, and a remark; or raises `NotAProduct`.
    **text : str
        Attributes of the leaf.

    Raises
    ------
    NotAProduct
        The product is not a term; with the reason.
    """
    factor, regressors, power = _split_regressors(product, per, sizes)
    tables, note = _separate_tables(product, sampler)
    tables += _lines_for_excess(regressors, tables)
    if len(regressors) > MAX_REGRESSORS:
        raise NotAProduct(
            f"{' x '.join(regressors)}: more than {MAX_REGRESSORS} regressors, and none of them "
            f"bounded so that it could be an axis"
        )
    tables = _merge_small_tables(tables)
    for axis in sorted(_axis_names(tables)):
        _demand_variable(axis)
    # The number of the product scales the first table.
    value, *factors = tables or [xr.DataArray(1.0)]
    if note:
        text["comment"] = "; ".join(filter(None, (text.get("comment", ""), note)))
    scales = {f"K{i}": _factor_table(table) for i, table in enumerate(factors, 1)}
    leaf = make_term(
        (value * factor).values,
        _axis_points(value),
        regressors,
        power=power,
        **scales,  # type: ignore[arg-type]
    )
    return leaf.assign_attrs(text)


def _split_regressors(
    product: Product, per: Mapping[str, int], sizes: Mapping[str, float]
) -> tuple[float, list[str], PowerFactor | None]:
    """Return number, regressors and power factor of a product without its reference quantities."""
    symbols = Counter(product.symbols)
    symbols.subtract(per)
    if max(symbols.values(), default=0) > _HIGHEST:
        raise NotAProduct(f"a variable to a power above {_HIGHEST}")
    factor = product.factor
    regressors: list[str] = []
    for reduced, (rate, reference) in REDUCED_RATES.items():
        count = symbols.pop(rate) if symbols[rate] > 0 else 0
        for _ in range(count):
            # A body rate that is not divided by the airspeed stays a rate.
            if symbols["V"] >= 0 and reduced in ("phat", "qhat", "rhat"):
                regressors.append(rate)
                continue
            # rate = reduced rate * 2 V / length
            factor *= 2.0
            symbols.update({reference: -1, "V": 1})
            regressors.append(reduced)
    lengths = {name: symbols[name] for name in LENGTHS if symbols[name]}
    factor *= reference_factor(lengths, sizes)
    power_factor = None
    for symbol, power in symbols.items():
        if symbol in LENGTHS:
            continue
        if power < 0:
            # A term has one power, with a lower limit of its variable.
            if power_factor is not None or symbol not in _FLOOR:
                raise NotAProduct(_explain_division(symbol))
            factor /= jsbsim_unit(symbol) ** power
            power_factor = PowerFactor(symbol, float(power), _FLOOR[symbol])
            continue
        # The product is in the units of JSBSim, the term in SI.
        factor /= jsbsim_unit(symbol) ** power
        regressors += [symbol] * power
    for name in regressors:
        _demand_variable(name)
    return factor, _sort_like_file(regressors, product), power_factor


def _explain_division(symbol: str) -> str:
    if symbol == "qbar":
        return "it is not proportional to the dynamic pressure"
    return f"it divides by {symbol}"


def _sort_like_file(regressors: list[str], product: Product) -> list[str]:
    """Return regressors in the order in which the file multiplies them."""
    positions = {symbol: index for index, symbol in enumerate(product.symbols)}
    rate_of: dict[str, str] = {reduced: rate for reduced, (rate, _) in REDUCED_RATES.items()}
    return sorted(regressors, key=lambda n: positions.get(rate_of.get(n) or n, len(positions)))


def _demand_variable(name: str) -> None:
    if name not in _KNOWN and not ENGINE.match(name) and not name.startswith(DEVICE):
        raise NotAProduct(f"{name} is not a variable of the model")


def _axis_names(tables: Sequence[xr.DataArray]) -> list[str]:
    """Return the axes of all tables, each as often as a table has it."""
    names: list[str] = []
    for table in tables:
        names += map(str, table.dims)
    return names


def _separate_tables(product: Product, sampler: Sampler) -> tuple[list[xr.DataArray], str]:
    """Return tables without common axes, and a remark on the sampling."""
    tables = [*product.tables, *product.shared]
    counts = Counter(_axis_names(tables))
    shared = {axis for axis, count in counts.items() if count > 1}
    for factor in product.opaque:
        shared |= factor.variables
    # A table with a shared axis is sampled as a whole, so its other axes become shared as well.
    # This is repeated until no further axis is added.
    count = -1
    while count != len(shared):
        count = len(shared)
        for table in tables:
            if shared & set(table.dims):
                shared.update(map(str, table.dims))
    joined = [table for table in tables if shared & set(table.dims)]
    if not joined and not product.opaque:
        return tables, ""
    separate = [table for table in tables if not shared & set(table.dims)]
    sampled, note = sampler(list(product.opaque), joined)
    return [sampled, *separate], note


def _lines_for_excess(regressors: list[str], tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Remove excess regressors from `regressors`; return them as tables over all their values."""
    lines = []
    axes = set(_axis_names(tables))
    # Configuration variables become tables first, then the others by name.
    configuration = ("gear", "speedbrake", "delta_f")
    bounded = {name for name in regressors if variable_range(name) is not None}
    candidates = sorted(bounded, key=lambda n: (n not in configuration, n))
    for name in candidates:
        is_excess = len(regressors) > MAX_REGRESSORS
        if is_excess and regressors.count(name) == 1 and name not in axes:
            regressors.remove(name)
            ends = list(variable_range(name) or ())
            lines.append(xr.DataArray(ends, {name: ends}, (name,)))
    return lines


def _merge_small_tables(tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Return at most three tables: the smallest ones are multiplied out."""
    # The product is exact because the tables have no common axis.
    tables = list(tables)
    while len(tables) > _MOST_TABLES:
        by_size = sorted(range(len(tables)), key=lambda i: (tables[i].ndim, tables[i].size))
        first, second = sorted(by_size[:2])
        axes = tables[first].ndim + tables[second].ndim
        if axes > MAX_AXES or tables[first].size * tables[second].size > MOST_NODES:
            raise NotAProduct(f"a product of {len(tables)} tables")
        tables[first] = tables[first] * tables.pop(second)
    return tables


def _factor_table(table: xr.DataArray) -> xr.DataArray:
    """Return a table with the attributes of its axes."""
    return make_term(table.values, _axis_points(table))["value"]


def _axis_points(table: xr.DataArray) -> dict[str, np.ndarray]:
    return {str(axis): table[axis].values for axis in table.dims}
