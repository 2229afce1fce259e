"""MathML 2 content markup: read to a small tree, evaluate over arrays, write.

Relations and logic give 1 and 0; where no piece of a ``piecewise`` holds and there is no
``otherwise`` the value is NaN, and so is a function outside its domain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np

from aerodb.exchange.daveml.document.units import parse_number
from aerodb.exchange.xml_reader import Element


@dataclass(frozen=True)
class MathNumber:
    """A constant."""

    value: float


@dataclass(frozen=True)
class Name:
    """The value of a variable, by its varID."""

    varID: str


@dataclass(frozen=True)
class Apply:
    """An operator with its arguments."""

    operator: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Choice:
    """Pieces (value, condition) of which the first that holds counts, and what counts when none
    does.
    """

    pieces: tuple[tuple[Expression, Expression], ...]
    otherwise: Expression | None


Expression = MathNumber | Name | Apply | Choice


def _chain(relation: Callable) -> Callable:
    """Relations may have more than two arguments: a < b < c."""

    def holds(*values):
        return reduce(np.logical_and, (relation(a, b) for a, b in pairwise(values))).astype(float)

    return holds


def _logic(operation: Callable) -> Callable:
    def combined(*values):
        return reduce(operation, (np.asarray(value) != 0.0 for value in values)).astype(float)

    return combined


def _root(value, degree=2.0):
    """Return the real root; the odd root of a negative number is negative."""
    odd = np.mod(degree, 2.0) == 1.0
    return np.where(
        odd & (value < 0.0), -np.power(np.abs(value), 1.0 / degree), np.power(value, 1.0 / degree)
    )


_MANY = 10**6
# operator: function over arrays, least and largest number of arguments
OPERATORS: dict[str, tuple[Callable, int, int]] = {
    "plus": (lambda *values: reduce(np.add, values), 1, _MANY),
    "minus": (lambda a, *b: a - b[0] if b else -a, 1, 2),
    "times": (lambda *values: reduce(np.multiply, values), 1, _MANY),
    "divide": (np.divide, 2, 2),
    "quotient": (
        np.divide,
        2,
        2,
    ),  # the check cases of NASA's basic_functions.dml demand the ratio, MathML its whole part
    "rem": (np.fmod, 2, 2),
    "power": (np.power, 2, 2),
    "root": (_root, 1, 2),
    "exp": (np.exp, 1, 1),
    "ln": (np.log, 1, 1),
    "log": (
        lambda value, base=10.0: (
            np.log10(value) if np.all(base == 10.0) else np.log(value) / np.log(base)
        ),
        1,
        2,
    ),
    "abs": (np.abs, 1, 1),
    "floor": (np.floor, 1, 1),
    "ceiling": (np.ceil, 1, 1),
    "min": (lambda *values: reduce(np.minimum, values), 1, _MANY),
    "max": (lambda *values: reduce(np.maximum, values), 1, _MANY),
    "sin": (np.sin, 1, 1),
    "cos": (np.cos, 1, 1),
    "tan": (np.tan, 1, 1),
    "sec": (lambda x: 1.0 / np.cos(x), 1, 1),
    "csc": (lambda x: 1.0 / np.sin(x), 1, 1),
    "cot": (lambda x: 1.0 / np.tan(x), 1, 1),
    "arcsin": (np.arcsin, 1, 1),
    "arccos": (np.arccos, 1, 1),
    "arctan": (np.arctan, 1, 1),
    "sinh": (np.sinh, 1, 1),
    "cosh": (np.cosh, 1, 1),
    "tanh": (np.tanh, 1, 1),
    "arcsinh": (np.arcsinh, 1, 1),
    "arccosh": (np.arccosh, 1, 1),
    "arctanh": (np.arctanh, 1, 1),
    "atan2": (np.arctan2, 2, 2),
    "eq": (_chain(np.equal), 2, _MANY),
    "neq": (lambda a, b: np.not_equal(a, b).astype(float), 2, 2),
    "lt": (_chain(np.less), 2, _MANY),
    "gt": (_chain(np.greater), 2, _MANY),
    "leq": (_chain(np.less_equal), 2, _MANY),
    "geq": (_chain(np.greater_equal), 2, _MANY),
    "and": (_logic(np.logical_and), 1, _MANY),
    "or": (_logic(np.logical_or), 1, _MANY),
    "xor": (_logic(np.logical_xor), 1, _MANY),
    "not": (lambda a: np.equal(a, 0.0).astype(float), 1, 1),
}
CONSTANTS = {
    "pi": np.pi,
    "exponentiale": np.e,
    "true": 1.0,
    "false": 0.0,
    "infinity": np.inf,
    "notanumber": np.nan,
}
_QUALIFIERS = {"root": "degree", "log": "logbase"}


def read_mathml(math: Element) -> Expression:
    """Return the expression of a ``math`` element.

    Raises
    ------
    ParseError
        Anything that is not one expression of the operators above, with its line.
    """
    return _expression(_only(math, math.children))


def _only(parent: Element, children: list[Element]) -> Element:
    if len(children) != 1:
        raise parent.error(f"<{parent.tag}> with {len(children)} elements", "one expression in it")
    return children[0]


def _expression(element: Element) -> Expression:
    if element.tag == "cn":
        return MathNumber(_constant(element))
    if element.tag == "ci":
        return Name(element.text)
    if element.tag in CONSTANTS:
        return MathNumber(CONSTANTS[element.tag])
    if element.tag == "piecewise":
        return _piecewise(element)
    if element.tag == "apply":
        return _apply(element)
    raise element.error(
        f"<{element.tag}>", f"apply, piecewise, cn, ci or one of {', '.join(CONSTANTS)}"
    )


def _apply(element: Element) -> Expression:
    if not element.children:
        raise element.error("an empty <apply>", "an operator and its arguments")
    head, *rest = element.children
    if head.tag == "piecewise":  # an <apply> around it, as NASA's files have it
        return _expression(_only(element, element.children))
    operator = _operator(head)
    qualifier = _QUALIFIERS.get(operator)
    qualifiers = [_only(child, child.children) for child in rest if child.tag == qualifier]
    arguments = tuple(
        _expression(child) for child in [*(c for c in rest if c.tag != qualifier), *qualifiers]
    )
    _, least, most = OPERATORS[operator]
    if not least <= len(arguments) <= most:
        wanted = (
            f"{least}"
            if least == most
            else f"{least} to {most}"
            if most < _MANY
            else f"{least} or more"
        )
        raise element.error(f"{operator} with {len(arguments)} arguments", f"{wanted}")
    return Apply(operator, arguments)


def _operator(head: Element) -> str:
    name = head.text if head.tag == "csymbol" else head.tag
    if name not in OPERATORS:
        raise head.error(
            f"the operator {name}",
            f"one of {', '.join(OPERATORS)}; rewrite the calculation with these",
        )
    return name


def _piecewise(element: Element) -> Choice:
    pieces = []
    for piece in element.all("piece"):
        if len(piece.children) != 2:
            raise piece.error(
                f"<piece> with {len(piece.children)} elements", "a value and a condition"
            )
        value, condition = (_expression(child) for child in piece.children)
        pieces.append((value, condition))
    rest = element.first("otherwise")
    if len(pieces) + (rest is not None) != len(element.children) or not pieces:
        raise element.error(
            "<piecewise> with something else than pieces and one <otherwise>",
            "one <piece> or more, then <otherwise>",
        )
    return Choice(tuple(pieces), None if rest is None else _expression(_only(rest, rest.children)))


def _constant(element: Element) -> float:
    if element.attributes.get("base", "10").strip() != "10":
        raise element.error(f"a number to the base {element.attributes['base']}", "decimal numbers")
    parts = (
        [parse_number(text, element) for text in element.text.split()]
        if element.children
        else [parse_number(element.text, element)]
    )
    if len(parts) == 1:
        return parts[0]
    kind = element.attributes.get("type", "")
    if len(parts) == 2 and kind == "e-notation":
        return parts[0] * 10.0 ** parts[1]
    if len(parts) == 2 and kind == "rational" and parts[1] != 0.0:
        return parts[0] / parts[1]
    raise element.error(
        f"<cn type={kind!r}> of {len(parts)} parts",
        "one number, or two with <sep/> of type e-notation or rational",
    )


def evaluate_mathml(expression: Expression, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the value of an expression; `values` holds the variables by varID."""
    if isinstance(expression, MathNumber):
        return np.asarray(expression.value)
    if isinstance(expression, Name):
        return values[expression.varID]
    if isinstance(expression, Apply):
        return OPERATORS[expression.operator][0](
            *(evaluate_mathml(argument, values) for argument in expression.arguments)
        )
    result = (
        np.asarray(np.nan)
        if expression.otherwise is None
        else evaluate_mathml(expression.otherwise, values)
    )
    for value, condition in reversed(expression.pieces):
        result = np.where(
            evaluate_mathml(condition, values) != 0.0, evaluate_mathml(value, values), result
        )
    return result


def expression_variables(expression: Expression) -> Iterator[str]:
    """Yield the varIDs an expression uses."""
    if isinstance(expression, Name):
        yield expression.varID
    elif isinstance(expression, Apply):
        for argument in expression.arguments:
            yield from expression_variables(argument)
    elif isinstance(expression, Choice):
        for pair in expression.pieces:
            for part in pair:
                yield from expression_variables(part)
        if expression.otherwise is not None:
            yield from expression_variables(expression.otherwise)


def write_mathml(expression: Expression, indent: str) -> list[str]:
    """Return an expression of numbers, names and operators as lines of XML."""
    if isinstance(expression, MathNumber):
        return [f"{indent}<cn>{expression.value!r}</cn>"]
    if isinstance(expression, Name):
        return [f"{indent}<ci>{escape(expression.varID)}</ci>"]
    if not isinstance(expression, Apply):
        raise TypeError(f"{type(expression).__name__} is not written; build it from operators")
    lines = [
        line for argument in expression.arguments for line in write_mathml(argument, indent + "  ")
    ]
    return [f"{indent}<apply>", f"{indent}  <{expression.operator}/>", *lines, f"{indent}</apply>"]
