"""Expressions of channels of one record, as ``az + V*q`` or ``imu.q - path.q``.

The text is parsed by `ast` and walked node by node: numbers, names of channels, ``+ - * / **`` and
the functions of `FUNCTIONS`; every other node is an error, so a text of the page cannot run code.
Values are SI and radians.  Dimensions are followed: what cannot be added is an error.
"""

from __future__ import annotations

import ast
import operator
import re
import sys
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from aeromatch.workbench.channels.dimensions import (
    ANGLE,
    NUMBER,
    Dimension,
    dimension_of_unit,
)
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.units import known_unit, to_si
from flighttest.records.signals.resampling import lowpass

_EXPECTED = "an expression of channels, as 'az + V*q', 'sqrt(p**2 + q**2)' or 'alpha - 2 deg'"
# A number with a unit.  Units stand only behind numbers: h is a height, and also an hour.
_QUANTITY = re.compile(r"(?<![\w.])((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) +([A-Za-z%]+(?:/\w+)?)")
_MOST_CHARACTERS, _MOST_POWER = 500, 8
_GAP = 1.5  # of the usual step, from which on a derivative does not cross an interval

_OPERATORS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_PERFORMED: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.true_divide,
    "**": np.power,
}
_SAME = ("abs", "mean")
_PLAIN: dict[str, tuple[Callable[..., Any], int]] = {
    "abs": (np.abs, 1),
    "sign": (np.sign, 1),
    "sqrt": (np.sqrt, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tan": (np.tan, 1),
    "asin": (np.arcsin, 1),
    "acos": (np.arccos, 1),
    "atan": (np.arctan, 1),
    "atan2": (np.arctan2, 2),
    "hypot": (np.hypot, 2),
    "minimum": (np.fmin, 2),
    "maximum": (np.fmax, 2),
    "mean": (lambda x: np.full_like(x, np.nanmean(x)), 1),
}
_OVER_TIME = ("deriv", "integral", "lowpass", "detrend")
FUNCTIONS = (*_PLAIN, *_OVER_TIME)
"""Functions of expressions; ``deriv(x)`` and ``integral(x)`` over time, ``lowpass(x, 2 Hz)``."""


class ExpressionTerm(NamedTuple):
    """Value of a part of an expression.

    Attributes
    ----------
    values : array (time,) or float
        [SI]
    dimension : Dimension or None
        None if a channel without a known unit is in it.
    is_constant : bool
        Whether it has numbers without a unit only.
    is_hertz : bool
        Whether it is a number in Hz, which counts turns where an angle is meant.
    """

    values: Any
    dimension: Dimension | None
    is_constant: bool = False
    is_hertz: bool = False


class ChannelExpression:
    """A parsed expression.

    Parameters
    ----------
    text : str

    Attributes
    ----------
    names : tuple of str
        Channels in the order of the text, each once, as they are written.

    Raises
    ------
    ParseError
        The text is not an expression of channels.
    """

    def __init__(self, text: str) -> None:
        self.text = text.strip()
        if not self.text or len(self.text) > _MOST_CHARACTERS:
            raise ParseError(
                "expression", 1, self.text[:60] or "nothing", f"{_EXPECTED}, of 1 to 500 characters"
            )
        source = _QUANTITY.sub(lambda match: f'quantity({match[1]}, "{match[2]}")', self.text)
        try:
            self._body = ast.parse(source.replace("^", "**"), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise ParseError("expression", 1, self.text, _EXPECTED) from error
        self.names = tuple(dict.fromkeys(self._list_names(self._body)))
        if not self.names:
            raise ParseError("expression", 1, self.text, f"{_EXPECTED}; name at least one channel")

    @property
    def is_channel(self) -> bool:
        """Whether the text is the name of a channel, with nothing computed."""
        return isinstance(self._body, ast.Name | ast.Attribute)

    def _list_names(self, node: ast.AST) -> list[str]:
        """Return the channels below a node, and raise for nodes that are not allowed."""
        if isinstance(node, ast.Constant):
            if isinstance(node.value, bool) or not isinstance(node.value, int | float):
                raise self._refuse(f"{node.value!r}")
            # an int has any number of digits, and a float like 1e999 is infinite
            if abs(node.value) > sys.float_info.max:
                raise self._refuse(ast.unparse(node))
            return []
        if isinstance(node, ast.Name | ast.Attribute):
            return [self._channel_name(node)]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            return self._list_names(node.operand)
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return [*self._list_names(node.left), *self._list_names(node.right)]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._names_of_call(node.func.id, node)
        raise self._refuse(ast.unparse(node))

    def _names_of_call(self, name: str, node: ast.Call) -> list[str]:
        if name == "quantity":
            return []
        if name not in FUNCTIONS:
            raise UnknownName(name, FUNCTIONS, "function of an expression")
        arity = 1
        if name == "lowpass":
            arity = 2
        elif name in _PLAIN:
            arity = _PLAIN[name][1]
        if len(node.args) != arity:
            raise self._refuse(f"{name} with {len(node.args)} arguments; it has {arity}")
        names: list[str] = []
        for argument in node.args:
            names += self._list_names(argument)
        return names

    def _channel_name(self, node: ast.AST) -> str:
        """Return a name with dots, such as ``imu.q``."""
        if isinstance(node, ast.Attribute):
            return f"{self._channel_name(node.value)}.{node.attr}"
        if isinstance(node, ast.Name):
            return node.id
        raise self._refuse(ast.unparse(node))

    def _refuse(self, part: str) -> ParseError:
        allowed = f"{_EXPECTED}; allowed are numbers, channels, + - * / **, {', '.join(FUNCTIONS)}"
        return ParseError("expression", 1, part[:80], allowed)

    def evaluate(
        self, time: np.ndarray, channels: Mapping[str, tuple[np.ndarray, Dimension | None]]
    ) -> ExpressionTerm:
        """Return the value on a clock.

        Parameters
        ----------
        time : ndarray (samples,)
            [s]
        channels : mapping of str to (ndarray (samples,), Dimension or None)
            The channels of `names` on this clock. [SI]

        Raises
        ------
        SchemaError
            Quantities that cannot be added, a function of a quantity with a unit, a power that is
            not a number.
        """
        with np.errstate(all="ignore"):
            found = self._value(self._body, time, channels)
        values = np.broadcast_to(np.asarray(found.values, float), time.shape).copy()
        # What is not defined, such as the root of a negative number, is a gap of the line.
        values[~np.isfinite(values)] = np.nan
        return ExpressionTerm(values, found.dimension)

    def _value(
        self, node: ast.AST, time: np.ndarray, channels: Mapping[str, Any]
    ) -> ExpressionTerm:
        if isinstance(node, ast.Constant):
            assert isinstance(node.value, int | float)
            return ExpressionTerm(float(node.value), NUMBER, True)
        if isinstance(node, ast.Name | ast.Attribute):
            return ExpressionTerm(*channels[self._channel_name(node)])
        if isinstance(node, ast.UnaryOp):
            term = self._value(node.operand, time, channels)
            return term._replace(values=-term.values) if isinstance(node.op, ast.USub) else term
        if isinstance(node, ast.BinOp):
            sides = [self._value(side, time, channels) for side in (node.left, node.right)]
            return self._combine(_OPERATORS[type(node.op)], *sides)
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        if node.func.id == "quantity":
            number, unit = (argument.value for argument in node.args)  # type: ignore[attr-defined]
            return ExpressionTerm(
                float(to_si(number, unit)),
                dimension_of_unit(unit),
                is_hertz=known_unit(unit) == "Hz",
            )
        terms = [self._value(argument, time, channels) for argument in node.args]
        return self._call(node.func.id, terms, time)

    def _combine(self, sign: str, left: ExpressionTerm, right: ExpressionTerm) -> ExpressionTerm:
        """Return the result of an operation on two terms."""
        a, b = left.dimension, right.dimension
        dimension: Dimension | None = None
        if sign in "+-":
            dimension = self._common_dimension(sign, left, right)
        elif sign == "**":
            power = float(right.values) if right.is_constant else np.nan
            if not abs(power) <= _MOST_POWER:
                raise SchemaError(
                    self.text, [f"a power that is not a number up to {_MOST_POWER}; write x**2"]
                )
            dimension = None if a is None else a.to_power(power)
        elif a is not None and b is not None:
            dimension = a.times(b, 1 if sign == "*" else -1)
        values = _PERFORMED[sign](left.values, right.values)
        return ExpressionTerm(values, dimension, left.is_constant and right.is_constant)

    def _common_dimension(
        self, what: str, left: ExpressionTerm, right: ExpressionTerm
    ) -> Dimension | None:
        """Return the dimension of a sum or of a function of alike quantities."""
        a, b = left.dimension, right.dimension
        if a is None or b is None:
            return None
        if not a.matches(b):
            raise SchemaError(
                self.text,
                [
                    f"{what} between {a.unit()} and {b.unit()}; only quantities of the same kind "
                    f"can be added or compared"
                ],
            )
        for number, other in ((left, b), (right, a)):
            is_bare = number.is_constant and np.any(np.asarray(number.values) != 0.0)
            if is_bare and other.angle and other.is_number:
                raise SchemaError(
                    self.text,
                    [
                        f"{what} between an angle and a number without unit; write the unit, as "
                        f"'{float(number.values):g} deg'"
                    ],
                )
        if (left.is_hertz and b.angle) or (right.is_hertz and a.angle):
            raise SchemaError(
                self.text, [f"{what} between an angular rate and Hz; write rad/s, deg/s or rpm"]
            )
        # A product such as V*q is an acceleration: the side without an angle has the unit.
        if left.is_constant or (a.angle and not b.angle):
            return b
        return a

    def _call(self, name: str, terms: list[ExpressionTerm], time: np.ndarray) -> ExpressionTerm:
        """Return the value of a function."""
        x, first = np.asarray(terms[0].values, float), terms[0].dimension
        if name in _OVER_TIME:
            return self._over_time(name, terms, time)
        function = _PLAIN[name][0]
        if len(terms) == 2:
            same = self._common_dimension(name, *terms)
            values = function(x, np.asarray(terms[1].values, float))
            return ExpressionTerm(values, ANGLE if name == "atan2" else same)
        dimension = self._dimension_of_call(name, terms)
        # A constant stays one: sqrt(2) is a number without unit.
        return ExpressionTerm(function(x), dimension, terms[0].is_constant and first == NUMBER)

    def _dimension_of_call(self, name: str, terms: list[ExpressionTerm]) -> Dimension | None:
        first = terms[0].dimension
        if name == "sqrt":
            return None if first is None else first.to_power(0.5)
        if name in _SAME:
            return first
        if name in ("sin", "cos", "tan") and terms[0].is_constant and terms[0].values != 0.0:
            raise SchemaError(self.text, [f"{name} of a number without unit; write {name}(30 deg)"])
        if first is not None and not first.is_number:
            if name == "sign":
                return NUMBER
            raise SchemaError(
                self.text, [f"{name} of a quantity in {first.unit()}; it needs a pure number"]
            )
        return ANGLE if name in ("asin", "acos", "atan") else NUMBER

    def _over_time(
        self, name: str, terms: list[ExpressionTerm], time: np.ndarray
    ) -> ExpressionTerm:
        """Return the value of a function along the clock, stretch by stretch."""
        x = np.broadcast_to(np.asarray(terms[0].values, float), time.shape)
        dimension = terms[0].dimension
        if name == "deriv":
            other = None if dimension is None else dimension.times(Dimension(second=-1))
            return ExpressionTerm(_derivative(time, x), other)
        if name == "integral":
            other = None if dimension is None else dimension.times(Dimension(second=1))
            return ExpressionTerm(_integral(time, x), other)
        if name == "detrend":
            return ExpressionTerm(_without_line(time, x), dimension)
        cutoff = terms[1]
        if cutoff.dimension is None or not (
            cutoff.dimension.is_number or cutoff.dimension.matches(Dimension(second=-1))
        ):
            raise SchemaError(self.text, ["lowpass: the second argument is a frequency, as 2 Hz"])
        frequency = float(np.ravel(cutoff.values)[0])
        return ExpressionTerm(_lowpassed(time, x, frequency), dimension)


def stretches(time: np.ndarray, is_valid: np.ndarray | None = None) -> list[slice]:
    """Return the stretches of a clock without a gap, and without a sample that is not valid."""
    if len(time) < 2:
        return [slice(0, len(time))]
    step = np.diff(time)
    is_cut = step > _GAP * float(np.median(step))
    if is_valid is not None:
        # A sample that is not valid is a stretch of its own, which is left out below.
        is_cut |= is_valid[1:] != is_valid[:-1]
    edges = [0, *(np.flatnonzero(is_cut) + 1).tolist(), len(time)]
    found = []
    for start, stop in pairwise(edges):
        if is_valid is None or is_valid[start]:
            found.append(slice(start, stop))
    return found


def _derivative(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return central differences, which no gap takes part in."""
    out = np.full(len(x), np.nan)
    for part in stretches(time, np.isfinite(x)):
        if part.stop - part.start > 1:
            out[part] = np.gradient(x[part], time[part])
    return out


def _integral(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the integral by trapezia from the first sample; gaps add nothing."""
    out, total = np.full(len(x), np.nan), 0.0
    for part in stretches(time, np.isfinite(x)):
        areas = 0.5 * (x[part][1:] + x[part][:-1]) * np.diff(time[part])
        out[part] = total + np.concatenate([[0.0], np.cumsum(areas)])
        total = float(out[part.stop - 1])
    return out


def _without_line(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return a signal less its least-squares line over time."""
    valid = np.isfinite(x)
    if valid.sum() < 2:
        return x.copy()
    t = time - time[valid].mean()
    slope, level = np.polyfit(t[valid], x[valid], 1)
    return x - (level + slope * t)


def _lowpassed(time: np.ndarray, x: np.ndarray, cutoff: float) -> np.ndarray:
    """Return the product's zero-phase low-pass of every stretch; short ones are left out."""
    out = np.full(len(x), np.nan)
    for part in stretches(time, np.isfinite(x)):
        if part.stop - part.start > 8:
            rate = 1.0 / float(np.median(np.diff(time[part])))
            out[part] = lowpass(x[part], rate, cutoff)
    return out
