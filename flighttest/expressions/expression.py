"""Expressions of measured quantities and named parameters, with their exact derivatives with respect to the parameters.

Derivatives are carried along with the values (forward mode); `lag` and its derivative are run piece by piece in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightmech.errors import OutOfRange, UnknownName

from .functions import FUNCTIONS, Pieces


class Slopes(NamedTuple):
    """A value along the samples, and its derivatives with respect to the parameters on which it depends."""

    value: np.ndarray
    by: dict[str, np.ndarray]


@dataclass(frozen=True)
class Scope:
    """What the names of an expression stand for: quantities along the samples, parameters, and where time is continuous."""

    quantities: Mapping[str, np.ndarray]
    parameters: Mapping[str, float]
    pieces: Pieces = field(default_factory=Pieces)


@dataclass(frozen=True)
class Expression:
    """A node of an expression: a number, a name, or an operation on others.

    Attributes
    ----------
    kind : str
        ``number``, ``name``, or the operation: ``+ - * / ^``, ``negative``, or a function.
    arguments : tuple of Expression
    content : float or str
        The number or the name.
    """

    kind: str
    arguments: tuple[Expression, ...] = ()
    content: float | str = ""

    def names(self) -> Iterator[str]:
        """Yield the names in the expression, in order."""
        if self.kind == "name":
            yield str(self.content)
        for argument in self.arguments:
            yield from argument.names()

    def at(self, scope: Scope) -> Slopes:
        """Return the value and its derivatives.

        Raises
        ------
        UnknownName
            A name that stands for nothing.
        OutOfRange
            A power, root or logarithm of what is not positive, a lag that is not positive.
        """
        if self.kind == "number":
            return Slopes(np.array(float(self.content)), {})
        if self.kind == "name":
            return _named(str(self.content), scope)
        given = [argument.at(scope) for argument in self.arguments]
        operation = _OPERATIONS.get(self.kind) or FUNCTIONS[self.kind].apply
        try:
            return Slopes(*operation(given, scope.pieces))
        except OutOfRange as error:
            raise OutOfRange(f"{self}: {error}") from None

    def __str__(self) -> str:
        return _written(self)


def _named(name: str, scope: Scope) -> Slopes:
    if name in scope.parameters:
        return Slopes(np.array(float(scope.parameters[name])), {name: np.array(1.0)})
    if name not in scope.quantities:
        raise UnknownName(name, [*scope.parameters, *map(str, scope.quantities)], "quantity or parameter")
    return Slopes(np.asarray(scope.quantities[name], float), {})


def chained(value: np.ndarray, *parts: tuple[Slopes, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return a value with its derivatives by the chain rule, from the arguments and the partial derivatives."""
    by: dict[str, np.ndarray] = {}
    for given, partial in parts:
        for name, slope in given.by.items():
            by[name] = by.get(name, 0.0) + partial * slope
    return value, by


def _power(given: Sequence[Slopes], _: Pieces):
    x, y = given
    if y.by and (x.value <= 0.0).any():
        raise OutOfRange(
            f"the base of a power with an unknown exponent reaches {np.min(x.value):g}; it must stay positive, as in max(h, 1)"
        )
    if (x.value < 0.0).any() and (y.value != np.round(y.value)).any():
        raise OutOfRange(f"the base of a power that is no integer reaches {np.min(x.value):g}; it must not be negative")
    if (x.value == 0.0).any() and (y.value < 0.0).any():
        raise OutOfRange("a negative power of zero")
    value = x.value**y.value
    parts = [(x, y.value * x.value ** (y.value - 1.0))] if x.by else []
    return chained(value, *parts, *([(y, value * np.log(x.value))] if y.by else []))


def _ratio(given: Sequence[Slopes], _: Pieces):
    x, y = given
    if (y.value == 0.0).any():
        raise OutOfRange("division by zero")
    return chained(x.value / y.value, (x, 1.0 / y.value), (y, -x.value / y.value**2))


_ONE = np.array(1.0)
_OPERATIONS: dict[str, Callable] = {
    "+": lambda given, _: chained(given[0].value + given[1].value, (given[0], _ONE), (given[1], _ONE)),
    "-": lambda given, _: chained(given[0].value - given[1].value, (given[0], _ONE), (given[1], -_ONE)),
    "*": lambda given, _: chained(given[0].value * given[1].value, (given[0], given[1].value), (given[1], given[0].value)),
    "/": _ratio,
    "^": _power,
    "negative": lambda given, _: chained(-given[0].value, (given[0], -_ONE)),
}
_RANK = {"+": 1, "-": 1, "*": 2, "/": 2, "negative": 3, "^": 4}


def _written(node: Expression) -> str:
    """One spelling of each expression, with no more parentheses than it needs."""
    if node.kind == "number":
        return f"{node.content:.12g}"
    if node.kind == "name":
        return str(node.content)
    if node.kind not in _RANK:
        return f"{node.kind}({','.join(map(_written, node.arguments))})"
    own = _RANK[node.kind]
    words = [_written(argument) for argument in node.arguments]
    ranks = [_RANK.get(argument.kind, 5) for argument in node.arguments]
    if node.kind == "negative":
        return f"-{words[0]}" if ranks[0] >= 3 else f"-({words[0]})"
    if node.kind == "^":
        return f"{words[0] if ranks[0] > own else f'({words[0]})'}^{words[1] if ranks[1] >= 3 else f'({words[1]})'}"
    left = words[0] if ranks[0] >= own else f"({words[0]})"
    right = words[1] if ranks[1] > own or (node.kind in "+*" and ranks[1] == own) else f"({words[1]})"
    return f"{left}{f' {node.kind} ' if own == 1 else node.kind}{right}"
