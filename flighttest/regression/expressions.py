"""From a text to an expression.

    sum      product { (+|-) product }
    product  signed { (*|/) signed }
    signed   - signed | power
    power    atom [ (^|**) signed ]
    atom     number [unit] | name | function(sum, ...) | (sum) | [name of an estimate]

A number with a unit, ``12 deg``, counts in SI.  Nothing else can be written, so a text from a file
cannot run code.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy

from flightmech.errors import OutOfRange, ParseError, UnknownName
from flightmech.units import to_si


@dataclass(frozen=True)
class Pieces:
    """Stretches of samples without a gap, and the sampling interval of each [s]."""

    slices: Sequence[slice] = ()
    steps: Sequence[float] = ()


class ExpressionFunction(NamedTuple):
    """Number of arguments, and the value with its derivatives from those of the arguments and the
    pieces.
    """

    arity: int
    apply: Callable[[Sequence[Any], Pieces], tuple[np.ndarray, dict[str, np.ndarray]]]


def _by(given, partial: np.ndarray) -> dict[str, np.ndarray]:
    return {name: partial * slope for name, slope in given.by.items()}


def _plain(value: Callable, slope: Callable) -> ExpressionFunction:
    """A function of one argument from its value and its derivative, both of the argument."""
    return ExpressionFunction(
        1, lambda given, _: (value(given[0].value), _by(given[0], slope(given[0].value)))
    )


def _positive(name: str, value: Callable, slope: Callable) -> ExpressionFunction:
    """The same, of a positive argument."""

    def apply(given, _):
        x = given[0].value
        if (x <= 0.0).any():
            raise OutOfRange(f"{name} of {np.min(x):g}; it must stay positive")
        return value(x), _by(given[0], slope(x))

    return ExpressionFunction(1, apply)


def _chosen(first: Callable) -> ExpressionFunction:
    """One of two arguments, sample by sample: the first where `first` of the two values holds."""

    def apply(given, _):
        x, y = given
        choice = first(x.value, y.value)
        by = {
            name: np.where(choice, x.by.get(name, 0.0), y.by.get(name, 0.0))
            for name in sorted({*x.by, *y.by})
        }
        return np.where(choice, x.value, y.value), by

    return ExpressionFunction(2, apply)


def _ramp(given, _):
    """x - a above the knot a, zero below."""
    x, a = given
    above = x.value > a.value
    by = {
        name: np.where(above, np.subtract(x.by.get(name, 0.0), a.by.get(name, 0.0)), 0.0)
        for name in sorted({*x.by, *a.by})
    }
    return np.where(above, x.value - a.value, 0.0), by


def _lag(given, pieces: Pieces):
    """First-order lag, tau y' + y = x, from rest at the first sample of each piece; x is straight
    between samples.

    With a = exp(-dt/tau) and e = (1 - a) tau/dt:  y_k = a y_(k-1) + (e - a) x_(k-1) + (1 - e) x_k.
    """
    x, tau = given
    if tau.value.ndim or not tau.value > 0.0:
        raise OutOfRange(
            "the time constant of a lag is one positive number or parameter, as in lag(n1, tau)"
        )
    T = float(tau.value)
    size = pieces.slices[-1].stop if pieces.slices else 0
    if not size:
        raise OutOfRange("a lag needs samples in time")

    def run(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        signal = np.broadcast_to(np.asarray(signal, float), (size,))
        out, slope = np.empty(size), np.empty(size)
        for at, step in zip(pieces.slices, pieces.steps):
            out[at], slope[at] = _lagged(signal[at], step, T)
        return out, slope

    value, slope = run(x.value)
    by = {name: run(inner)[0] for name, inner in x.by.items()}
    for name, inner in tau.by.items():
        by[name] = by.get(name, 0.0) + slope * inner
    return value, by


def _lagged(x: np.ndarray, step: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    """A lagged signal and its derivative with respect to the time constant."""
    r = step / T
    a, e = np.exp(-r), -np.expm1(-r) / r
    da, de = a * r / T, (e - a) / T  # by T
    before, later = x[:-1], x[1:]
    push = (e - a) * before + (1.0 - e) * later
    y, _ = scipy.signal.lfilter([1.0], [1.0, -a], push, zi=[a * x[0]])
    y = np.concatenate([x[:1], y])
    dpush = da * y[:-1] + (de - da) * before - de * later
    return y, np.concatenate([[0.0], scipy.signal.lfilter([1.0], [1.0, -a], dpush)])


FUNCTIONS: dict[str, ExpressionFunction] = {
    "exp": _plain(np.exp, np.exp),
    "tanh": _plain(np.tanh, lambda x: 1.0 - np.tanh(x) ** 2),
    "sin": _plain(np.sin, np.cos),
    "cos": _plain(np.cos, lambda x: -np.sin(x)),
    "abs": _plain(np.abs, np.sign),
    "sign": _plain(np.sign, np.zeros_like),
    "sqrt": _positive("sqrt", np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "log": _positive("log", np.log, lambda x: 1.0 / x),
    "max": _chosen(np.greater_equal),
    "min": _chosen(np.less_equal),
    "ramp": ExpressionFunction(2, _ramp),
    "lag": ExpressionFunction(2, _lag),
}


class Slopes(NamedTuple):
    """A value along the samples, and its derivatives with respect to the parameters on which it
    depends.
    """

    value: np.ndarray
    by: dict[str, np.ndarray]


@dataclass(frozen=True)
class Scope:
    """What the names of an expression stand for: quantities along the samples, parameters, and
    where time is continuous.
    """

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
        raise UnknownName(
            name, [*scope.parameters, *map(str, scope.quantities)], "quantity or parameter"
        )
    return Slopes(np.asarray(scope.quantities[name], float), {})


def apply_chain_rule(
    value: np.ndarray, *parts: tuple[Slopes, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return a value with its derivatives by the chain rule, from the arguments and the partial
    derivatives.
    """
    by: dict[str, np.ndarray] = {}
    for given, partial in parts:
        for name, slope in given.by.items():
            by[name] = by.get(name, 0.0) + partial * slope
    return value, by


def _power(given: Sequence[Slopes], _: Pieces):
    x, y = given
    if y.by and (x.value <= 0.0).any():
        raise OutOfRange(
            f"the base of a power with an unknown exponent reaches {np.min(x.value):g}; it "
            f"must stay positive, as in max(h, 1)"
        )
    if (x.value < 0.0).any() and (y.value != np.round(y.value)).any():
        raise OutOfRange(
            f"the base of a power that is no integer reaches {np.min(x.value):g}; it must "
            f"not be negative"
        )
    if (x.value == 0.0).any() and (y.value < 0.0).any():
        raise OutOfRange("a negative power of zero")
    value = x.value**y.value
    parts = [(x, y.value * x.value ** (y.value - 1.0))] if x.by else []
    return apply_chain_rule(value, *parts, *([(y, value * np.log(x.value))] if y.by else []))


def _ratio(given: Sequence[Slopes], _: Pieces):
    x, y = given
    if (y.value == 0.0).any():
        raise OutOfRange("division by zero")
    return apply_chain_rule(x.value / y.value, (x, 1.0 / y.value), (y, -x.value / y.value**2))


_ONE = np.array(1.0)
_OPERATIONS: dict[str, Callable] = {
    "+": lambda given, _: apply_chain_rule(
        given[0].value + given[1].value, (given[0], _ONE), (given[1], _ONE)
    ),
    "-": lambda given, _: apply_chain_rule(
        given[0].value - given[1].value, (given[0], _ONE), (given[1], -_ONE)
    ),
    "*": lambda given, _: apply_chain_rule(
        given[0].value * given[1].value, (given[0], given[1].value), (given[1], given[0].value)
    ),
    "/": _ratio,
    "^": _power,
    "negative": lambda given, _: apply_chain_rule(-given[0].value, (given[0], -_ONE)),
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
    right = (
        words[1] if ranks[1] > own or (node.kind in "+*" and ranks[1] == own) else f"({words[1]})"
    )
    return f"{left}{f' {node.kind} ' if own == 1 else node.kind}{right}"


_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|(?P<name>[A-Za-z_]\w*(?:\.\w+)*)|\[(?P<estimate>[^\[\]]+)\]|(?P<sign>\*\*|[-+*/^(),]))"
)
_EXPECTED = "numbers, names, + - * / ^, parentheses and the functions " + ", ".join(FUNCTIONS)
_MOST = 60  # nested parentheses


def parse_expression(text: str) -> Expression:
    """Return the expression that a text describes.

    Raises
    ------
    ParseError
        What is no expression; the message states where reading stopped.
    UnitError
        A unit that is not known.
    """
    reader = _Parser(text)
    found = reader.sum()
    reader.demand_end()
    return found


def parse_terms(text: str) -> tuple[Expression, ...]:
    """Return the terms of a sum; a term that is subtracted is refused, since its coefficient takes
    the sign.

    Raises
    ------
    ParseError
        What is no sum of terms.
    """
    reader = _Parser(text)
    found = [reader.product()]
    while reader.accept("+"):
        found.append(reader.product())
    if reader.next == "-":
        raise ParseError(
            "<model>",
            0,
            f"{text.strip()!r}",
            "terms joined by +; the coefficient of a term takes its sign",
        )
    reader.demand_end()
    return tuple(found)


class _Parser:
    """Recursive descent over the tokens of a text."""

    def __init__(self, text: str):
        self.text, self.depth = text, 0
        self.tokens, at = [], 0
        while text[at:].strip():
            match = _TOKEN.match(text, at)
            if match is None:
                raise self.refuse(text[at:].strip())
            self.tokens.append((str(match.lastgroup), str(match[str(match.lastgroup)])))
            at = match.end()
        self.at = 0

    @property
    def next(self) -> str:
        return (
            self.tokens[self.at][1]
            if self.at < len(self.tokens) and self.tokens[self.at][0] == "sign"
            else ""
        )

    def refuse(self, found: str) -> ParseError:
        return ParseError(
            "<model>", 0, f"{found or 'the end'!r} in {self.text.strip()!r}", _EXPECTED
        )

    def accept(self, *signs: str) -> str:
        sign = self.next
        if sign not in signs:
            return ""
        self.at += 1
        return sign

    def demand(self, sign: str) -> None:
        if not self.accept(sign):
            raise self.refuse("" if self.at >= len(self.tokens) else self.tokens[self.at][1])

    def demand_end(self) -> None:
        if self.at < len(self.tokens):
            raise self.refuse(self.tokens[self.at][1])

    def sum(self) -> Expression:
        self.depth += 1
        if self.depth > _MOST:
            raise self.refuse("more than 60 nested parentheses")
        found = self.product()
        while sign := self.accept("+", "-"):
            found = Expression(sign, (found, self.product()))
        self.depth -= 1
        return found

    def product(self) -> Expression:
        found = self.signed()
        while sign := self.accept("*", "/"):
            found = Expression(sign, (found, self.signed()))
        return found

    def signed(self) -> Expression:
        signs = 0
        while self.accept("-"):
            signs += 1
        found = self.power()
        return Expression("negative", (found,)) if signs % 2 else found

    def power(self) -> Expression:
        base = self.atom()
        if not self.accept("^", "**"):
            return base
        self.depth += 1
        if self.depth > _MOST:
            raise self.refuse("more than 60 nested powers")
        found = Expression("^", (base, self.signed()))
        self.depth -= 1
        return found

    def atom(self) -> Expression:
        if self.accept("("):
            found = self.sum()
            self.demand(")")
            return found
        if self.at >= len(self.tokens) or self.tokens[self.at][0] == "sign":
            raise self.refuse(self.next)
        kind, text = self.tokens[self.at]
        self.at += 1
        if kind == "number":
            return Expression("number", content=self.number(float(text)))
        if kind == "name" and self.accept("("):
            return self.call(text)
        return Expression("name", content=text.strip())

    def number(self, value: float) -> float:
        if self.at < len(self.tokens) and self.tokens[self.at][0] == "name":
            self.at += 1
            return float(to_si(value, self.tokens[self.at - 1][1]))
        return value

    def call(self, name: str) -> Expression:
        if name not in FUNCTIONS:
            raise UnknownName(name, FUNCTIONS, "function")
        arguments = [self.sum()]
        while self.accept(","):
            arguments.append(self.sum())
        self.demand(")")
        if len(arguments) != FUNCTIONS[name].arity:
            raise ParseError(
                "<model>", 0, f"{name} of {len(arguments)} arguments", f"{FUNCTIONS[name].arity}"
            )
        return Expression(name, tuple(arguments))
