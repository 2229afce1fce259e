"""Expressions of terms, parsed from text.

    sum      product { (+|-) product }
    product  signed { (*|/) signed }
    signed   - signed | power
    power    atom [ (^|**) signed ]
    atom     number [unit] | name | function(sum, ...) | (sum) | [name of an estimate]

A number with a unit, ``12 deg``, is converted to SI. The grammar has nothing else, so a text from a
file cannot run code.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from flightmech.errors import OutOfRange, ParseError, UnknownName
from flightmech.units import to_si
from flighttest.regression.expression_functions import FUNCTIONS, OPERATIONS, Pieces, Slopes


@dataclass(frozen=True)
class Scope:
    """Values of the names of an expression.

    Attributes
    ----------
    quantities : mapping of str to array (samples,), or Slopes of a quantity with derivatives
    parameters : mapping of str to float
    pieces : Pieces
        Stretches in which time is continuous.
    """

    quantities: Mapping[str, np.ndarray | Slopes]
    parameters: Mapping[str, float]
    pieces: Pieces = field(default_factory=Pieces)


@dataclass(frozen=True)
class Expression:
    """A node of an expression: a number, a name, or an operation on other nodes.

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
            A name that is neither a quantity nor a parameter.
        OutOfRange
            A power, root or logarithm of a value that is not positive, or a time constant that is
            not positive.
        """
        if self.kind == "number":
            return Slopes(np.array(float(self.content)), {})
        if self.kind == "name":
            return _look_up_name(str(self.content), scope)
        arguments = [argument.at(scope) for argument in self.arguments]
        operation = OPERATIONS.get(self.kind) or FUNCTIONS[self.kind].apply
        try:
            return Slopes(*operation(arguments, scope.pieces))
        except OutOfRange as error:
            raise OutOfRange(f"{self}: {error}") from None

    def __str__(self) -> str:
        return _write_expression(self)


def _look_up_name(name: str, scope: Scope) -> Slopes:
    """Return the value of a name; a parameter has the derivative one by itself."""
    if name in scope.parameters:
        return Slopes(np.array(float(scope.parameters[name])), {name: np.array(1.0)})
    if name not in scope.quantities:
        raise UnknownName(
            name, [*scope.parameters, *map(str, scope.quantities)], "quantity or parameter"
        )
    quantity = scope.quantities[name]
    if isinstance(quantity, Slopes):
        return quantity
    return Slopes(np.asarray(quantity, float), {})


# binding strength of the operations; numbers, names and functions bind strongest
_RANK = {"+": 1, "-": 1, "*": 2, "/": 2, "negative": 3, "^": 4}
_ATOM_RANK = 5


def _write_expression(node: Expression) -> str:
    """Return the one spelling of an expression, with the fewest parentheses."""
    if node.kind == "number":
        return f"{node.content:.12g}"
    if node.kind == "name":
        return str(node.content)
    if node.kind not in _RANK:
        return f"{node.kind}({','.join(map(_write_expression, node.arguments))})"
    rank = _RANK[node.kind]
    if node.kind == "negative":
        return f"-{_write_argument(node.arguments[0], rank)}"
    first, second = node.arguments
    if node.kind == "^":
        # a^b^c is a^(b^c): the base needs a higher rank, the exponent may be negative
        return f"{_write_argument(first, rank + 1)}^{_write_argument(second, _RANK['negative'])}"
    # a - b - c is (a - b) - c: the second argument of - and / needs a higher rank
    least_second = rank if _commutes(node, second) else rank + 1
    sign = f" {node.kind} " if rank == 1 else node.kind
    return f"{_write_argument(first, rank)}{sign}{_write_argument(second, least_second)}"


def _commutes(node: Expression, second: Expression) -> bool:
    """Return whether the second argument of + or * needs no parentheses at equal rank."""
    return node.kind in "+*" and _RANK.get(second.kind, _ATOM_RANK) == _RANK[node.kind]


def _write_argument(argument: Expression, least_rank: int) -> str:
    """Return an argument, in parentheses if it binds less than `least_rank`."""
    text = _write_expression(argument)
    if _RANK.get(argument.kind, _ATOM_RANK) >= least_rank:
        return text
    return f"({text})"


_TOKEN = re.compile(
    r"\s*(?:"
    r"(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\.\w+)*)"
    r"|\[(?P<estimate>[^\[\]]+)\]"
    r"|(?P<sign>\*\*|[-+*/^(),])"
    r")"
)
_EXPECTED = "numbers, names, + - * / ^, parentheses and the functions " + ", ".join(FUNCTIONS)
_MOST = 60  # nested parentheses


def parse_expression(text: str) -> Expression:
    """Return the expression that a text describes.

    Raises
    ------
    ParseError
        A text that is not an expression; the message states where reading stopped.
    UnitError
        A unit that is not defined.
    """
    parser = _Parser(text)
    expression = parser.parse_sum()
    parser.demand_end()
    return expression


def parse_terms(text: str) -> tuple[Expression, ...]:
    """Return the terms of a sum. Terms are joined by +, because a coefficient has the sign.

    Raises
    ------
    ParseError
        A text that is not a sum of terms.
    """
    parser = _Parser(text)
    terms = [parser.parse_product()]
    while parser.accept("+"):
        terms.append(parser.parse_product())
    if parser.next_sign == "-":
        raise ParseError(
            "<model>",
            0,
            f"{text.strip()!r}",
            "terms joined by +; the coefficient of a term takes its sign",
        )
    parser.demand_end()
    return tuple(terms)


class _Parser:
    """Recursive-descent parser of the tokens of a text; one method per rule of the grammar."""

    def __init__(self, text: str):
        self.text, self.depth = text, 0
        self.tokens: list[tuple[str, str]] = []  # kind and text
        start = 0
        while text[start:].strip():
            match = _TOKEN.match(text, start)
            if match is None:
                raise self.make_error(text[start:].strip())
            self.tokens.append((str(match.lastgroup), str(match[str(match.lastgroup)])))
            start = match.end()
        self.position = 0

    @property
    def next_kind(self) -> str:
        """Kind of the next token; empty at the end."""
        if self.position == len(self.tokens):
            return ""
        return self.tokens[self.position][0]

    @property
    def next_text(self) -> str:
        """Text of the next token; empty at the end."""
        if self.position == len(self.tokens):
            return ""
        return self.tokens[self.position][1]

    @property
    def next_sign(self) -> str:
        """The next token if it is a sign, otherwise an empty text."""
        if self.next_kind != "sign":
            return ""
        return self.next_text

    def make_error(self, text: str) -> ParseError:
        """Return the error of an unexpected text."""
        return ParseError(
            "<model>", 0, f"{text or 'the end'!r} in {self.text.strip()!r}", _EXPECTED
        )

    def accept(self, *signs: str) -> str:
        """Return the next sign and go past it, if it is one of `signs`."""
        sign = self.next_sign
        if sign not in signs:
            return ""
        self.position += 1
        return sign

    def demand(self, sign: str) -> None:
        """Go past a sign; raise if another token comes."""
        if not self.accept(sign):
            raise self.make_error(self.next_text)

    def demand_end(self) -> None:
        """Raise if a token follows."""
        if self.next_kind:
            raise self.make_error(self.next_text)

    def parse_sum(self) -> Expression:
        self.depth += 1
        if self.depth > _MOST:
            raise self.make_error("more than 60 nested parentheses")
        expression = self.parse_product()
        while sign := self.accept("+", "-"):
            expression = Expression(sign, (expression, self.parse_product()))
        self.depth -= 1
        return expression

    def parse_product(self) -> Expression:
        expression = self.parse_signed()
        while sign := self.accept("*", "/"):
            expression = Expression(sign, (expression, self.parse_signed()))
        return expression

    def parse_signed(self) -> Expression:
        # Signs are counted, not nested: two of them cancel.
        signs = 0
        while self.accept("-"):
            signs += 1
        expression = self.parse_power()
        if signs % 2 == 0:
            return expression
        return Expression("negative", (expression,))

    def parse_power(self) -> Expression:
        base = self.parse_atom()
        if not self.accept("^", "**"):
            return base
        self.depth += 1
        if self.depth > _MOST:
            raise self.make_error("more than 60 nested powers")
        expression = Expression("^", (base, self.parse_signed()))
        self.depth -= 1
        return expression

    def parse_atom(self) -> Expression:
        if self.accept("("):
            expression = self.parse_sum()
            self.demand(")")
            return expression
        if self.next_kind in ("", "sign"):
            raise self.make_error(self.next_text)
        kind, text = self.next_kind, self.next_text
        self.position += 1
        if kind == "number":
            return Expression("number", content=self.convert_number(float(text)))
        if kind == "name" and self.accept("("):
            return self.parse_call(text)
        return Expression("name", content=text.strip())

    def convert_number(self, value: float) -> float:
        """Return a number in SI, from the unit that follows it."""
        if self.next_kind != "name":
            return value
        unit = self.next_text
        self.position += 1
        return float(to_si(value, unit))

    def parse_call(self, name: str) -> Expression:
        if name not in FUNCTIONS:
            raise UnknownName(name, FUNCTIONS, "function")
        arguments = [self.parse_sum()]
        while self.accept(","):
            arguments.append(self.parse_sum())
        self.demand(")")
        if len(arguments) != FUNCTIONS[name].arity:
            raise ParseError(
                "<model>", 0, f"{name} of {len(arguments)} arguments", f"{FUNCTIONS[name].arity}"
            )
        return Expression(name, tuple(arguments))
