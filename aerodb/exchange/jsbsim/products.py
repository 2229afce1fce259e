"""Sums of products of numbers, variables and tables, the form of the functions of a JSBSim file.

An operation that does not give a product, such as a sine, a quotient of tables or a limiter, is an
`OpaqueFactor`: a factor with its variables and a function for its value.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.properties import jsbsim_unit, variable_range
from flightmech.terms import evaluate_term, make_term

# Each product becomes a term, and a few nested sums make millions of them. This many take 3 s to
# import and 0.6 s to compile.
MOST_PRODUCTS = 1024
MOST_NODES = 5_000_000  # of one table
LENGTHS = ("S", "cbar", "b")
_EXPONENTS = (1.0, 2.0, 3.0, 4.0)  # powers that are multiplied out
Values = Mapping[str, np.ndarray]


class NotAProduct(Exception):
    """Reason why a function is not a term; the import collects these."""


@dataclass(frozen=True)
class OpaqueFactor:
    """A factor that is not a table.

    Parameters
    ----------
    what : str
        Description for messages.
    variables : frozenset of str
        Its model variables.
    value : callable
        Value at conditions by variable. [SI]
    """

    what: str
    variables: frozenset[str]
    value: Callable[[Values], np.ndarray]


@dataclass(frozen=True)
class Product:
    """A product of a number, powers of symbols, tables and opaque factors.

    Parameters
    ----------
    factor : float
        The number.
    symbols : mapping of str to int
        Powers of model variables and reference quantities, in the units of JSBSim.
    tables : tuple of DataArray
        Tables; coordinates in SI.
    shared : tuple of DataArray
        Tables of functions that are used by name.
    opaque : tuple of OpaqueFactor
        Factors that are not tables.
    """

    factor: float = 1.0
    symbols: Mapping[str, int] = field(default_factory=dict)
    tables: tuple[xr.DataArray, ...] = ()
    shared: tuple[xr.DataArray, ...] = ()
    opaque: tuple[OpaqueFactor, ...] = ()

    def __mul__(self, other: Product) -> Product:
        # x^m x^n = x^(m + n); a power of zero is dropped.
        powers = Counter(self.symbols)
        powers.update(other.symbols)
        return Product(
            factor=self.factor * other.factor,
            symbols={symbol: power for symbol, power in powers.items() if power},
            tables=self.tables + other.tables,
            shared=self.shared + other.shared,
            opaque=self.opaque + other.opaque,
        )

    @property
    def constant(self) -> bool:
        """Whether the product is a number only."""
        return not (self.symbols or self.tables or self.shared or self.opaque)

    @property
    def monomial(self) -> bool:
        """Whether the product is a number and powers of symbols only."""
        return not (self.tables or self.shared or self.opaque)

    @property
    def variables(self) -> frozenset[str]:
        """The model variables of the product."""
        names = set(self.symbols) - set(LENGTHS)
        for table in (*self.tables, *self.shared):
            names.update(map(str, table.dims))
        for factor in self.opaque:
            names |= factor.variables
        return frozenset(names)


Sum = list[Product]


def combine_sums(tag: str, sums: Sequence[Sum], sizes: Mapping[str, float]) -> Sum:
    """Return an operation on sums as a sum.

    Parameters
    ----------
    tag : str
        Name of the operation in JSBSim, one of `KNOWN`.
    sums : sequence of Sum
        Its arguments, at least one.
    sizes : mapping of str to float
        ``S``, ``cbar``, ``b`` in square feet and feet.

    Raises
    ------
    NotAProduct
        The result has too many products, or the operation is not a function of model variables.
    """
    if tag in NOT_COMPUTED:
        raise NotAProduct(f"<{tag}> is not a function of model variables")
    result = None
    if tag in _EXACT:
        result = _EXACT[tag](sums)
    if result is None:
        result = _make_opaque(tag, sums, sizes)
    if len(result) > MOST_PRODUCTS:
        raise NotAProduct(f"it multiplies out to more than {MOST_PRODUCTS} products")
    return result


def scale_products(factor: float, parts: Sum) -> Sum:
    """Return a sum multiplied by a number."""
    return [replace(part, factor=part.factor * factor) for part in parts]


def absolute_value_table(parts: Sum) -> Sum | None:
    """Return the magnitude of a multiple of one variable as a table over all its values.

    The result is None for any other sum.
    """
    if len(parts) != 1 or not parts[0].monomial:
        return None
    part = parts[0]
    if part.constant:
        return [Product(abs(part.factor))]
    if len(part.symbols) != 1:
        return None
    ((variable, power),) = part.symbols.items()
    ends = variable_range(variable)
    if power != 1 or ends is None:
        return None
    # The nodes are the ends of the range and zero, where the magnitude has its bend.
    points = np.unique([0.0, *ends])
    table = xr.DataArray(np.abs(points), {variable: points}, (variable,))
    return [Product(abs(part.factor), tables=(table,))]


def reference_factor(symbols: Mapping[str, int], sizes: Mapping[str, float]) -> float:
    """Return the product of the powers of the reference quantities. [ft2, ft]"""
    return math.prod(sizes[name] ** symbols[name] for name in LENGTHS if name in symbols)


def evaluate_products(
    parts: Iterable[Product], states: Values, sizes: Mapping[str, float]
) -> np.ndarray:
    """Return a sum of products at conditions in SI."""
    return sum((_evaluate_product(part, states, sizes) for part in parts), np.zeros(()))


def _evaluate_product(part: Product, states: Values, sizes: Mapping[str, float]) -> np.ndarray:
    value = np.asarray(part.factor * reference_factor(part.symbols, sizes))
    # A symbol is in the unit of JSBSim, the conditions are in SI.
    for symbol, power in part.symbols.items():
        if symbol not in LENGTHS:
            value = value * (np.asarray(states[symbol], float) / jsbsim_unit(symbol)) ** power
    for table in (*part.tables, *part.shared):
        leaf = make_term(table.values, {str(d): table[d].values for d in table.dims})
        value = value * evaluate_term(leaf, states, "clamp")
    for factor in part.opaque:
        value = value * factor.value(states)
    return value


def _make_opaque(tag: str, sums: Sequence[Sum], sizes: Mapping[str, float]) -> Sum:
    """Return an operation that does not give a product as one factor."""

    def compute(states: Values) -> np.ndarray:
        # Sampling checks the result for values that are not finite.
        with np.errstate(all="ignore"):
            arguments = [evaluate_products(parts, states, sizes) for parts in sums]
            return np.asarray(_NONLINEAR[tag](*arguments), float)

    variables: frozenset[str] = frozenset()
    for part in itertools.chain.from_iterable(sums):
        variables |= part.variables
    if not variables:
        return [Product(float(compute({})))]
    return [Product(opaque=(OpaqueFactor(f"<{tag}>", variables, compute),))]


def _add_sums(sums: Sequence[Sum]) -> Sum:
    return list(itertools.chain.from_iterable(sums))


def _subtract_sums(sums: Sequence[Sum]) -> Sum:
    return _add_sums([sums[0], *(scale_products(-1.0, parts) for parts in sums[1:])])


def _multiply_sums(sums: Sequence[Sum]) -> Sum:
    if math.prod(map(len, sums)) > MOST_PRODUCTS:
        raise NotAProduct(f"it multiplies out to more than {MOST_PRODUCTS} products")
    return reduce(_multiply_two, sums)


def _multiply_two(a: Sum, b: Sum) -> Sum:
    return [x * y for x, y in itertools.product(a, b)]


def _divide_sums(sums: Sequence[Sum]) -> Sum | None:
    """Return a quotient as a product if the denominator is a number times powers of symbols."""
    if len(sums) != 2 or len(sums[1]) != 1:
        return None
    denominator = sums[1][0]
    if not denominator.monomial or denominator.factor == 0.0:
        return None
    powers = {symbol: -power for symbol, power in denominator.symbols.items()}
    inverse = Product(1.0 / denominator.factor, powers)
    return [part * inverse for part in sums[0]]


def _raise_sum(sums: Sequence[Sum]) -> Sum | None:
    """Return a small whole power as a product."""
    if len(sums) != 2 or len(sums[1]) != 1:
        return None
    exponent = sums[1][0]
    if not exponent.constant or exponent.factor not in _EXPONENTS:
        return None
    return _multiply_sums([sums[0]] * int(exponent.factor))


def _sign(x: np.ndarray) -> np.ndarray:
    return np.where(x < 0.0, -1.0, 1.0)


def _reduce_with(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of two arguments as one of any number of arguments."""
    return lambda *values: reduce(function, values)


# Operations whose result may be a sum of products. None means that it is not.
_EXACT: dict[str, Callable[[Sequence[Sum]], Sum | None]] = {
    "sum": _add_sums,
    "difference": _subtract_sums,
    "product": _multiply_sums,
    "quotient": _divide_sums,
    "pow": _raise_sum,
    "abs": lambda sums: absolute_value_table(sums[0]),
    "avg": lambda sums: scale_products(1.0 / len(sums), _add_sums(sums)),
    "toradians": lambda sums: scale_products(math.pi / 180.0, sums[0]),
    "todegrees": lambda sums: scale_products(180.0 / math.pi, sums[0]),
}
# Operations over arrays, for opaque factors.
_NONLINEAR: dict[str, Callable[..., Any]] = {
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
    "min": _reduce_with(np.minimum),
    "max": _reduce_with(np.maximum),
    "integer": np.trunc,
    "fraction": lambda x: x - np.trunc(x),
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "nq": np.not_equal,
    "and": _reduce_with(np.logical_and),
    "or": _reduce_with(np.logical_or),
    "not": np.logical_not,
    "ifthen": lambda test, yes, no: np.where(test != 0.0, yes, no),
}
# Operations of JSBSim that the import refuses.
NOT_COMPUTED = (
    "random",
    "urandom",
    "mod",
    "fmod",
    "floor",
    "ceil",
    "switch",
    "rotation_alpha_local",
    "rotation_beta_local",
    "rotation_gamma_local",
    "rotation_bf_to_wf",
    "rotation_wf_to_bf",
)
KNOWN = frozenset((*_EXACT, *_NONLINEAR, *NOT_COMPUTED))
