"""Products to terms: what remains when dynamic pressure and reference quantities are taken off a
force or moment.

A rate over the airspeed becomes the reduced rate, p b/2V; a rate alone stays one, except those of
the flow angles, which exist reduced only: alpha_dot = alphadothat * 2V/cbar.
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
from aerodb.exchange.jsbsim.properties import AXIS, ENGINE, FUNCTION, RANGE, RATES, jsbsim_unit
from aerodb.exchange.xml_reader import Element
from flightmech.terms import MAX_AXES, MAX_REGRESSORS, make_term

_PLACES = ("axis4", "table", "row", "column")


def read_jsbsim_table(element: Element) -> tuple[list[str], list[np.ndarray], np.ndarray]:
    """Return the properties, breakpoints and nodes of a ``<table>``, axes from the outermost to the
    columns.
    """
    axes = element.all("independentVar")
    data = element.all("tableData")
    if not axes or not data:
        raise element.error(
            "a table without independentVar or tableData", "a table over at least one property"
        )
    if len(axes) == 1:
        points, values = _columns(data[0])
        return [axes[0].text], [points], values
    places = [axis.attributes.get("lookup", "") for axis in axes]
    order = list(_PLACES[-len(axes) :])
    if sorted(places) != sorted(order):
        raise axes[0].error(
            f"lookup {' '.join(places)!r} for {len(axes)} axes",
            f"lookup {' '.join(order)!r}, each once",
        )
    names = {place: axis.text for place, axis in zip(places, axes)}
    grid, values = _block(element, len(axes))
    return [names[place] for place in order], grid, values


def _block(parent: Element, axes: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints and nodes of the ``tableData`` in an element."""
    data = parent.all("tableData")
    if axes == 2:
        if len(data) != 1:
            raise parent.error(f"{len(data)} tableData for two axes", "one")
        return _rows(data[0])
    return _stack(data, axes, parent)


def _stack(data: list[Element], axes: int, parent: Element) -> tuple[list[np.ndarray], np.ndarray]:
    if len(data) < 2:
        raise parent.error(f"{len(data)} tableData where breakPoint counts", "at least two")
    points = [_break_point(item) for item in data]
    for item, low, high in zip(data[1:], points, points[1:]):
        if high <= low:
            raise item.error(f"breakPoint {high:g} after {low:g}", "breakpoints in rising order")
    blocks = [
        _rows(item) if axes == 3 else _stack(item.all("tableData"), axes - 1, item) for item in data
    ]
    grid = [np.unique(np.concatenate(points)) for points in zip(*(own for own, _ in blocks))]
    if len(blocks) * math.prod(map(len, grid)) > MOST_NODES:
        raise parent.error(
            "blocks with breakpoints of their own, all together too many",
            f"a table of up to {MOST_NODES} nodes",
        )
    return [np.array(points), *grid], np.stack(
        [_regridded(values, own, grid) for own, values in blocks]
    )


def _regridded(values: np.ndarray, own: list[np.ndarray], grid: list[np.ndarray]) -> np.ndarray:
    """Return a block on the breakpoints of all blocks: the same function, for it is linear between
    its own and held beyond.
    """
    for position, (points, wanted) in enumerate(zip(own, grid)):
        if len(points) != len(wanted):
            values = np.apply_along_axis(partial(np.interp, wanted, points), position, values)
    return values


def _break_point(element: Element) -> float:
    text = element.attributes.get("breakPoint", "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise element.error(f"breakPoint {text!r}", "a finite number")
    return value


def _columns(data: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return breakpoints and nodes of a table of one axis: pairs, one to a line."""
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
    _rising(data, pairs[:, 0], [line for line, _ in lines])
    return pairs[:, 0], pairs[:, 1]


def _rows(data: Element) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints of rows and columns, and nodes, of a table of two axes."""
    lines = data.numbers()
    if len(lines) < 3 or len(lines[0][1]) < 2:
        raise data.error(
            f"a table of {max(len(lines) - 1, 0)} rows",
            "a line of column breakpoints, then at least two rows",
        )
    head = lines[0][1]
    _rising(data, head, [lines[0][0]] * len(head))
    for line, numbers in lines[1:]:
        if len(numbers) != len(head) + 1:
            raise data.error(
                f"{len(numbers)} numbers",
                f"a row breakpoint and {len(head)} values, one to a column",
                line,
            )
    rows = np.array([numbers for _, numbers in lines[1:]])
    _rising(data, rows[:, 0], [line for line, _ in lines[1:]])
    return [rows[:, 0], head], rows[:, 1:]


def _rising(data: Element, points: np.ndarray, lines: Sequence[int]) -> None:
    for at in np.flatnonzero(np.diff(points) <= 0).tolist():
        raise data.error(
            f"breakpoint {points[at + 1]:g} after {points[at]:g}",
            "breakpoints in rising order",
            lines[at + 1],
        )


_MOST_TABLES = 3
_HIGHEST = (
    2 * MAX_REGRESSORS
)  # power of a symbol; dynamic pressure and lengths may stand next to regressors
_KNOWN = {*AXIS, *FUNCTION, "CL"}
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
        Powers by which a coefficient is multiplied there: ``{"qbar": 1, "S": 1, "b": 1}`` for a
        rolling moment.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    sampler : callable
        Makes one table of what is none and of the tables that share axes with it, or with each
        other; or raises `NotAProduct`.
    **text : str
        Attributes of the leaf.

    Raises
    ------
    Unfit
        With the reason.
    """
    factor, words = _regressors(product, per, sizes)
    tables, note = _tables(product, sampler)
    tables += _lines(words, tables)
    if len(words) > MAX_REGRESSORS:
        raise NotAProduct(
            f"{' x '.join(words)}: more than {MAX_REGRESSORS} regressors, and none of them "
            f"bounded so that it could be an axis"
        )
    tables = _merged(tables)
    for axis in sorted(str(axis) for table in tables for axis in table.dims):
        _demand_known(axis)
    value, K1, K2, *_ = [*(tables or [xr.DataArray(1.0)]), None, None]
    assert value is not None
    if note:
        text["comment"] = "; ".join(part for part in (text.get("comment", ""), note) if part)
    found = make_term(
        (value * factor).values, _grid(value), words, K1=_like_ours(K1), K2=_like_ours(K2)
    )
    return found.assign_attrs(text)


def _regressors(
    product: Product, per: Mapping[str, int], sizes: Mapping[str, float]
) -> tuple[float, list[str]]:
    """Return the number and the regressors that are left when the reference quantities are taken
    off.
    """
    symbols = Counter(product.symbols)
    symbols.subtract(per)
    if symbols["qbar"] < 0:
        raise NotAProduct("it is not proportional to the dynamic pressure")
    if max(symbols.values(), default=0) > _HIGHEST:
        raise NotAProduct(f"a variable to a power above {_HIGHEST}")
    factor, words = product.factor, []
    for reduced, (rate, reference) in RATES.items():
        for _ in range(symbols.pop(rate) if symbols[rate] > 0 else 0):
            if symbols["V"] >= 0 and reduced in ("phat", "qhat", "rhat"):
                words.append(rate)
                continue
            factor *= 2.0
            symbols.update({reference: -1, "V": 1})
            words.append(reduced)
    factor *= reference_factor({name: symbols[name] for name in LENGTHS if symbols[name]}, sizes)
    for symbol, power in symbols.items():
        if symbol in LENGTHS:
            continue
        if power < 0:
            raise NotAProduct(f"it divides by {symbol}")
        factor /= jsbsim_unit(symbol) ** power
        words += [symbol] * power
    for word in words:
        _demand_known(word)
    return factor, _in_order(words, product)


def _in_order(words: list[str], product: Product) -> list[str]:
    """Return regressors in the order in which the file multiplies them."""
    place = {symbol: number for number, symbol in enumerate(product.symbols)}
    rate: dict[str, str] = {reduced: name for reduced, (name, _) in RATES.items()}
    return sorted(words, key=lambda word: place.get(rate.get(word) or word, len(place)))


def _demand_known(word: str) -> None:
    if word not in _KNOWN and not ENGINE.match(word):
        raise NotAProduct(f"{word} is no variable of the model")


def _tables(product: Product, sampler: Sampler) -> tuple[list[xr.DataArray], str]:
    """Return tables without common axes, and what was sampled."""
    tables = [*product.tables, *product.shared]
    counts = Counter(str(axis) for table in tables for axis in table.dims)
    clash = {axis for axis, count in counts.items() if count > 1}.union(
        *(one.variables for one in product.opaque)
    )
    while (
        more := {str(axis) for table in tables if clash & set(table.dims) for axis in table.dims}
        - clash
    ):
        clash |= more
    inside = [table for table in tables if clash & set(table.dims)]
    if not inside and not product.opaque:
        return tables, ""
    sampled, note = sampler(list(product.opaque), inside)
    return [sampled, *(table for table in tables if not clash & set(table.dims))], note


def _lines(words: list[str], tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Take regressors too many off `words` and return them as tables: lines over all values the
    variable can take.
    """
    found = []
    taken = {str(axis) for table in tables for axis in table.dims}
    for name in sorted(
        set(words) & set(RANGE),
        key=lambda name: (name not in ("gear", "speedbrake", "delta_f"), name),
    ):
        if len(words) > MAX_REGRESSORS and words.count(name) == 1 and name not in taken:
            words.remove(name)
            ends = list(RANGE[name])
            found.append(xr.DataArray(ends, {name: ends}, (name,)))
    return found


def _merged(tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Return at most three tables: the smallest ones multiplied out, which is exact because they
    have no axis in common.
    """
    tables = list(tables)
    while len(tables) > _MOST_TABLES:
        small = sorted(range(len(tables)), key=lambda i: (tables[i].ndim, tables[i].size))[:2]
        first, second = sorted(small)
        if (
            tables[first].ndim + tables[second].ndim > MAX_AXES
            or tables[first].size * tables[second].size > MOST_NODES
        ):
            raise NotAProduct(f"a product of {len(tables)} tables")
        tables[first] = tables[first] * tables.pop(second)
    return tables


def _like_ours(table: xr.DataArray | None) -> xr.DataArray | None:
    return None if table is None else make_term(table.values, _grid(table))["value"]


def _grid(table: xr.DataArray) -> dict[str, np.ndarray]:
    return {str(axis): table[axis].values for axis in table.dims}
