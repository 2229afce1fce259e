"""Sums of products of numbers, variables and tables: what functions of a JSBSim file are resolved
into.

What is no product - a sine, a quotient of tables, a limiter - is kept as an `OpaqueFactor`, a
factor that knows its variables and its value.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.properties import RANGE, jsbsim_unit
from flightmech.terms import evaluate_term, make_term

MOST_PRODUCTS = 64
MOST_NODES = 5_000_000  # of one table
LENGTHS = ("S", "cbar", "b")
Values = Mapping[str, np.ndarray]


class NotAProduct(Exception):
    """Why something is no term; the import collects these."""


@dataclass(frozen=True)
class OpaqueFactor:
    """A factor that is no table: what it is, its variables, and its value at conditions in SI."""

    what: str
    variables: frozenset[str]
    value: Callable[[Values], np.ndarray]


@dataclass(frozen=True)
class Product:
    """A number times powers of symbols times tables times opaque; `shared` are tables of functions
    that are used by name.
    """

    factor: float = 1.0
    symbols: Mapping[str, int] = field(default_factory=dict)
    tables: tuple[xr.DataArray, ...] = ()
    shared: tuple[xr.DataArray, ...] = ()
    opaque: tuple[OpaqueFactor, ...] = ()

    def __mul__(self, other: Product) -> Product:
        symbols = Counter(self.symbols)
        symbols.update(other.symbols)
        return Product(
            self.factor * other.factor,
            {symbol: power for symbol, power in symbols.items() if power},
            self.tables + other.tables,
            self.shared + other.shared,
            self.opaque + other.opaque,
        )

    @property
    def constant(self) -> bool:
        """Nothing but a number."""
        return not (self.symbols or self.tables or self.shared or self.opaque)

    @property
    def monomial(self) -> bool:
        """Nothing but a number and powers of symbols."""
        return not (self.tables or self.shared or self.opaque)

    @property
    def variables(self) -> frozenset[str]:
        """The model variables in it."""
        axes = {str(axis) for table in (*self.tables, *self.shared) for axis in table.dims}
        return frozenset(axes | (set(self.symbols) - set(LENGTHS))).union(
            *(one.variables for one in self.opaque)
        )


Sum = list[Product]


def combine_sums(tag: str, sums: Sequence[Sum], sizes: Mapping[str, float]) -> Sum:
    """Return an operation on sums as a sum.

    Parameters
    ----------
    tag : str
        Name of the operation in JSBSim, one of `KNOWN`.
    sums : sequence of Sum
        What it works on, at least one.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.

    Raises
    ------
    Unfit
        It multiplies out too far, or the operation cannot be computed from model variables.
    """
    if tag in NOT_COMPUTED:
        raise NotAProduct(f"<{tag}> is no function of model variables")
    exact = _EXACT[tag](sums) if tag in _EXACT else None
    found = _opaque(tag, sums, sizes) if exact is None else exact
    if len(found) > MOST_PRODUCTS:
        raise NotAProduct(f"it multiplies out to more than {MOST_PRODUCTS} products")
    return found


def scale_products(factor: float, parts: Sum) -> Sum:
    """Return a sum multiplied by a number."""
    return [replace(part, factor=part.factor * factor) for part in parts]


def absolute_value_table(parts: Sum) -> Sum | None:
    """Return the magnitude of a multiple of one variable as a table over all values it can take;
    None for anything else.
    """
    if len(parts) != 1 or not parts[0].monomial:
        return None
    part = parts[0]
    if part.constant:
        return [Product(abs(part.factor))]
    (variable, power), *more = part.symbols.items()
    if more or power != 1 or variable not in RANGE:
        return None
    points = np.unique([0.0, *RANGE[variable]])
    return [
        Product(
            abs(part.factor),
            tables=(xr.DataArray(np.abs(points), {variable: points}, (variable,)),),
        )
    ]


def reference_factor(symbols: Mapping[str, int], sizes: Mapping[str, float]) -> float:
    """Return the part of a product that are reference quantities. [ft2, ft]"""
    return math.prod(sizes[name] ** symbols[name] for name in LENGTHS if name in symbols)


def evaluate_products(
    parts: Iterable[Product], at: Values, sizes: Mapping[str, float]
) -> np.ndarray:
    """Return a sum of products at conditions in SI."""
    return sum((_value(part, at, sizes) for part in parts), np.zeros(()))


def _value(part: Product, at: Values, sizes: Mapping[str, float]) -> np.ndarray:
    found = np.asarray(part.factor * reference_factor(part.symbols, sizes))
    for symbol, power in part.symbols.items():
        if symbol not in LENGTHS:
            found = found * (np.asarray(at[symbol], float) / jsbsim_unit(symbol)) ** power
    for table in (*part.tables, *part.shared):
        found = found * evaluate_term(
            make_term(table.values, {str(d): table[d].values for d in table.dims}), at, "clamp"
        )
    for one in part.opaque:
        found = found * one.value(at)
    return found


def _opaque(tag: str, sums: Sequence[Sum], sizes: Mapping[str, float]) -> Sum:
    """Return an operation that makes no product as one factor."""

    def compute(at: Values) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.asarray(
                _CURVED[tag](*(evaluate_products(parts, at, sizes) for parts in sums)), float
            )

    variables = frozenset().union(*(part.variables for parts in sums for part in parts))
    return (
        [Product(opaque=(OpaqueFactor(f"<{tag}>", variables, compute),))]
        if variables
        else [Product(float(compute({})))]
    )


def _sum(sums: Sequence[Sum]) -> Sum:
    return [part for parts in sums for part in parts]


def _difference(sums: Sequence[Sum]) -> Sum:
    return _sum([sums[0], *(scale_products(-1.0, parts) for parts in sums[1:])])


def _product(sums: Sequence[Sum]) -> Sum:
    if math.prod(map(len, sums)) > MOST_PRODUCTS:
        raise NotAProduct(f"it multiplies out to more than {MOST_PRODUCTS} products")
    return reduce(lambda a, b: [x * y for x in a for y in b], sums)


def _quotient(sums: Sequence[Sum]) -> Sum | None:
    """Return a quotient by numbers and powers as a product."""
    if len(sums) != 2 or len(sums[1]) != 1 or not sums[1][0].monomial or sums[1][0].factor == 0.0:
        return None
    below = Product(
        1.0 / sums[1][0].factor, {symbol: -power for symbol, power in sums[1][0].symbols.items()}
    )
    return [part * below for part in sums[0]]


def _power(sums: Sequence[Sum]) -> Sum | None:
    """Return a small whole power as a product."""
    if (
        len(sums) != 2
        or len(sums[1]) != 1
        or not sums[1][0].constant
        or sums[1][0].factor not in (1.0, 2.0, 3.0, 4.0)
    ):
        return None
    return _product([sums[0]] * int(sums[1][0].factor))


def _sign(x: np.ndarray) -> np.ndarray:
    return np.where(x < 0.0, -1.0, 1.0)


def _each(function: Callable) -> Callable:
    return lambda *values: reduce(function, values)


_EXACT: dict[str, Callable[[Sequence[Sum]], Sum | None]] = {
    "sum": _sum,
    "difference": _difference,
    "product": _product,
    "quotient": _quotient,
    "pow": _power,
    "abs": lambda sums: absolute_value_table(sums[0]),
    "avg": lambda sums: scale_products(1.0 / len(sums), _sum(sums)),
    "toradians": lambda sums: scale_products(math.pi / 180.0, sums[0]),
    "todegrees": lambda sums: scale_products(180.0 / math.pi, sums[0]),
}
_CURVED: dict[str, Callable] = {
    "quotient": operator.truediv,
    "pow": np.power,
    "abs": np.abs,
    "sign": _sign,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "ln": np.log,
    "log2": np.log2,
    "log10": np.log10,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "min": _each(np.minimum),
    "max": _each(np.maximum),
    "integer": np.trunc,
    "fraction": lambda x: x - np.trunc(x),
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "nq": np.not_equal,
    "and": _each(np.logical_and),
    "or": _each(np.logical_or),
    "not": np.logical_not,
    "ifthen": lambda test, yes, no: np.where(test != 0.0, yes, no),
}
NOT_COMPUTED = (
    *("random", "urandom", "mod", "fmod", "floor", "ceil", "switch"),
    *(
        "rotation_alpha_local",
        "rotation_beta_local",
        "rotation_gamma_local",
        "rotation_bf_to_wf",
        "rotation_wf_to_bf",
    ),
)
KNOWN = frozenset((*_EXACT, *_CURVED, *NOT_COMPUTED))
