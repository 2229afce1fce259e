"""Products to terms: what remains when dynamic pressure and reference quantities are taken off a force or moment.

A rate over the airspeed becomes the reduced rate, p b/2V; a rate alone stays one, except those of the flow
angles, which exist reduced only: alpha_dot = alphadothat * 2V/cbar.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from flightmech.terms import MAX_AXES, MAX_REGRESSORS, make

from .products import LENGTHS, MOST_NODES, OpaqueFactor, Product, Unfit, length
from .properties import AXIS, ENGINE, FUNCTION, RANGE, RATES, unit

_MOST_TABLES = 3
_HIGHEST = 2 * MAX_REGRESSORS  # power of a symbol; dynamic pressure and lengths may stand next to regressors
_KNOWN = {*AXIS, *FUNCTION, "CL"}
Sampler = Callable[[list[OpaqueFactor], list[xr.DataArray]], tuple[xr.DataArray, str]]


def leaf(product: Product, per: Mapping[str, int], sizes: Mapping[str, float], sampler: Sampler, **text: str) -> xr.Dataset:
    """Return a product of a force, a moment or a coefficient as a term.

    Parameters
    ----------
    product : Product
        One product of a function of the file.
    per : mapping of str to int
        Powers by which a coefficient is multiplied there: ``{"qbar": 1, "S": 1, "b": 1}`` for a rolling moment.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.
    sampler : callable
        Makes one table of what is none and of the tables that share axes with it, or with each other; or raises `Unfit`.
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
        raise Unfit(f"{' x '.join(words)}: more than {MAX_REGRESSORS} regressors, and none of them bounded so that it could be an axis")
    tables = _merged(tables)
    for axis in sorted(str(axis) for table in tables for axis in table.dims):
        _demand_known(axis)
    value, K1, K2, *_ = [*(tables or [xr.DataArray(1.0)]), None, None]
    assert value is not None
    if note:
        text["comment"] = "; ".join(part for part in (text.get("comment", ""), note) if part)
    found = make((value * factor).values, _grid(value), words, K1=_like_ours(K1), K2=_like_ours(K2))
    return found.assign_attrs(text)


def _regressors(product: Product, per: Mapping[str, int], sizes: Mapping[str, float]) -> tuple[float, list[str]]:
    """Return the number and the regressors that are left when the reference quantities are taken off."""
    symbols = Counter(product.symbols)
    symbols.subtract(per)
    if symbols["qbar"] < 0:
        raise Unfit("it is not proportional to the dynamic pressure")
    if max(symbols.values(), default=0) > _HIGHEST:
        raise Unfit(f"a variable to a power above {_HIGHEST}")
    factor, words = product.factor, []
    for reduced, (rate, reference) in RATES.items():
        for _ in range(symbols.pop(rate) if symbols[rate] > 0 else 0):
            if symbols["V"] >= 0 and reduced in ("phat", "qhat", "rhat"):
                words.append(rate)
                continue
            factor *= 2.0
            symbols.update({reference: -1, "V": 1})
            words.append(reduced)
    factor *= length({name: symbols[name] for name in LENGTHS if symbols[name]}, sizes)
    for symbol, power in symbols.items():
        if symbol in LENGTHS:
            continue
        if power < 0:
            raise Unfit(f"it divides by {symbol}")
        factor /= unit(symbol) ** power
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
        raise Unfit(f"{word} is no variable of the model")


def _tables(product: Product, sampler: Sampler) -> tuple[list[xr.DataArray], str]:
    """Return tables without common axes, and what was sampled."""
    tables = [*product.tables, *product.shared]
    counts = Counter(str(axis) for table in tables for axis in table.dims)
    clash = {axis for axis, count in counts.items() if count > 1}.union(*(one.variables for one in product.opaque))
    while more := {str(axis) for table in tables if clash & set(table.dims) for axis in table.dims} - clash:
        clash |= more
    inside = [table for table in tables if clash & set(table.dims)]
    if not inside and not product.opaque:
        return tables, ""
    sampled, note = sampler(list(product.opaque), inside)
    return [sampled, *(table for table in tables if not clash & set(table.dims))], note


def _lines(words: list[str], tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Take regressors too many off `words` and return them as tables: lines over all values the variable can take."""
    found = []
    taken = {str(axis) for table in tables for axis in table.dims}
    for name in sorted(set(words) & set(RANGE), key=lambda name: (name not in ("gear", "speedbrake", "delta_f"), name)):
        if len(words) > MAX_REGRESSORS and words.count(name) == 1 and name not in taken:
            words.remove(name)
            ends = list(RANGE[name])
            found.append(xr.DataArray(ends, {name: ends}, (name,)))
    return found


def _merged(tables: list[xr.DataArray]) -> list[xr.DataArray]:
    """Return at most three tables: the smallest ones multiplied out, which is exact because they have no axis in common."""
    tables = list(tables)
    while len(tables) > _MOST_TABLES:
        small = sorted(range(len(tables)), key=lambda i: (tables[i].ndim, tables[i].size))[:2]
        first, second = sorted(small)
        if tables[first].ndim + tables[second].ndim > MAX_AXES or tables[first].size * tables[second].size > MOST_NODES:
            raise Unfit(f"a product of {len(tables)} tables")
        tables[first] = tables[first] * tables.pop(second)
    return tables


def _like_ours(table: xr.DataArray | None) -> xr.DataArray | None:
    return None if table is None else make(table.values, _grid(table))["value"]


def _grid(table: xr.DataArray) -> dict[str, np.ndarray]:
    return {str(axis): table[axis].values for axis in table.dims}
