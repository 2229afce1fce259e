"""From a text to an expression.

    sum      product { (+|-) product }
    product  signed { (*|/) signed }
    signed   - signed | power
    power    atom [ (^|**) signed ]
    atom     number [unit] | name | function(sum, ...) | (sum) | [name of an estimate]

A number with a unit, ``12 deg``, counts in SI.  Nothing else can be written, so a text from a file cannot run code.
"""

from __future__ import annotations

import re

from flightmech.errors import ParseError, UnknownName
from flightmech.units import to_si

from .expression import Expression
from .functions import FUNCTIONS

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|(?P<name>[A-Za-z_]\w*(?:\.\w+)*)|\[(?P<estimate>[^\[\]]+)\]|(?P<sign>\*\*|[-+*/^(),]))"
)
_EXPECTED = "numbers, names, + - * / ^, parentheses and the functions " + ", ".join(FUNCTIONS)
_MOST = 60  # nested parentheses


def parse(text: str) -> Expression:
    """Return the expression that a text describes.

    Raises
    ------
    ParseError
        What is no expression; the message states where reading stopped.
    UnitError
        A unit that is not known.
    """
    reader = _Reader(text)
    found = reader.sum()
    reader.demand_end()
    return found


def parse_terms(text: str) -> tuple[Expression, ...]:
    """Return the terms of a sum; a term that is subtracted is refused, since its coefficient takes the sign.

    Raises
    ------
    ParseError
        What is no sum of terms.
    """
    reader = _Reader(text)
    found = [reader.product()]
    while reader.accept("+"):
        found.append(reader.product())
    if reader.next == "-":
        raise ParseError("<model>", 0, f"{text.strip()!r}", "terms joined by +; the coefficient of a term takes its sign")
    reader.demand_end()
    return tuple(found)


class _Reader:
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
        return self.tokens[self.at][1] if self.at < len(self.tokens) and self.tokens[self.at][0] == "sign" else ""

    def refuse(self, found: str) -> ParseError:
        return ParseError("<model>", 0, f"{found or 'the end'!r} in {self.text.strip()!r}", _EXPECTED)

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
            raise ParseError("<model>", 0, f"{name} of {len(arguments)} arguments", f"{FUNCTIONS[name].arity}")
        return Expression(name, tuple(arguments))
