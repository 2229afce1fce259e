"""Expressions of MathML 2 content markup: reading, evaluation over arrays, writing.

Relations and logic give 1 and 0.  A ``piecewise`` without ``otherwise`` is NaN where no condition
holds.  A function is NaN outside its domain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any
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
    """Pieces (value, condition), of which the first that holds counts; else ``otherwise``."""

    pieces: tuple[tuple[Expression, Expression], ...]
    otherwise: Expression | None


Expression = MathNumber | Name | Apply | Choice


def _make_relation(relation: Callable[..., Any]) -> Callable[..., Any]:
    """Return a relation of two or more arguments, such as a < b < c."""

    def holds(*values: Any) -> Any:
        return reduce(np.logical_and, (relation(a, b) for a, b in pairwise(values))).astype(float)

    return holds


def _make_logic(operation: Callable[..., Any]) -> Callable[..., Any]:
    def combined(*values: Any) -> Any:
        return reduce(operation, (np.asarray(value) != 0.0 for value in values)).astype(float)

    return combined


def _subtract(first: Any, *second: Any) -> Any:
    """Return the difference of two arguments, or the negative of one."""
    return first - second[0] if second else -first


def _root(value: Any, degree: float = 2.0) -> Any:
    """Return the real root; the odd root of a negative number is negative."""
    is_odd = np.mod(degree, 2.0) == 1.0
    negative_root = -np.power(np.abs(value), 1.0 / degree)
    return np.where(is_odd & (value < 0.0), negative_root, np.power(value, 1.0 / degree))


def _logarithm(value: Any, base: float = 10.0) -> Any:
    # np.log10 is more accurate than the quotient of two logarithms.
    if np.all(base == 10.0):
        return np.log10(value)
    return np.log(value) / np.log(base)


_MANY = 10**6  # no limit of the number of arguments
# Operator: function over arrays, least and largest number of arguments.
OPERATORS: dict[str, tuple[Callable[..., Any], int, int]] = {
    "plus": (lambda *values: reduce(np.add, values), 1, _MANY),
    "minus": (_subtract, 1, 2),
    "times": (lambda *values: reduce(np.multiply, values), 1, _MANY),
    "divide": (np.divide, 2, 2),
    # The check cases of NASA's basic_functions.dml demand the ratio, MathML its whole part.
    "quotient": (np.divide, 2, 2),
    "rem": (np.fmod, 2, 2),
    "power": (np.power, 2, 2),
    "root": (_root, 1, 2),
    "exp": (np.exp, 1, 1),
    "ln": (np.log, 1, 1),
    "log": (_logarithm, 1, 2),
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
    "eq": (_make_relation(np.equal), 2, _MANY),
    "neq": (lambda a, b: np.not_equal(a, b).astype(float), 2, 2),
    "lt": (_make_relation(np.less), 2, _MANY),
    "gt": (_make_relation(np.greater), 2, _MANY),
    "leq": (_make_relation(np.less_equal), 2, _MANY),
    "geq": (_make_relation(np.greater_equal), 2, _MANY),
    "and": (_make_logic(np.logical_and), 1, _MANY),
    "or": (_make_logic(np.logical_or), 1, _MANY),
    "xor": (_make_logic(np.logical_xor), 1, _MANY),
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
# Operators with an optional last argument in an element of its own.
_QUALIFIERS = {"root": "degree", "log": "logbase"}


def read_mathml(math: Element) -> Expression:
    """Return the expression of a ``math`` element.

    Raises
    ------
    ParseError
        The content is not one expression of the operators of `OPERATORS`; with the line.
    """
    return _read_expression(_single_child(math, math.children))


def _single_child(parent: Element, children: list[Element]) -> Element:
    if len(children) != 1:
        raise parent.error(f"<{parent.tag}> with {len(children)} elements", "one expression in it")
    return children[0]


def _read_expression(element: Element) -> Expression:
    if element.tag == "cn":
        return MathNumber(_read_number(element))
    if element.tag == "ci":
        return Name(element.text)
    if element.tag in CONSTANTS:
        return MathNumber(CONSTANTS[element.tag])
    if element.tag == "piecewise":
        return _read_piecewise(element)
    if element.tag == "apply":
        return _read_apply(element)
    raise element.error(
        f"<{element.tag}>", f"apply, piecewise, cn, ci or one of {', '.join(CONSTANTS)}"
    )


def _read_apply(element: Element) -> Expression:
    if not element.children:
        raise element.error("an empty <apply>", "an operator and its arguments")
    head, *children = element.children
    # NASA's files have an <apply> around a <piecewise>.
    if head.tag == "piecewise":
        return _read_expression(_single_child(element, element.children))
    operator = _read_operator(head)
    qualifier = _QUALIFIERS.get(operator)
    arguments, qualifiers = [], []
    for child in children:
        if child.tag == qualifier:
            qualifiers.append(_single_child(child, child.children))
        else:
            arguments.append(child)
    # The qualifier is the last argument of the function, wherever it is in the file.
    expressions = tuple(_read_expression(child) for child in [*arguments, *qualifiers])
    _, least, most = OPERATORS[operator]
    if not least <= len(expressions) <= most:
        raise element.error(
            f"{operator} with {len(expressions)} arguments", _describe_count(least, most)
        )
    return Apply(operator, expressions)


def _describe_count(least: int, most: int) -> str:
    if least == most:
        return f"{least}"
    if most < _MANY:
        return f"{least} to {most}"
    return f"{least} or more"


def _read_operator(head: Element) -> str:
    name = head.text if head.tag == "csymbol" else head.tag
    if name not in OPERATORS:
        raise head.error(
            f"the operator {name}",
            f"one of {', '.join(OPERATORS)}; rewrite the calculation with these",
        )
    return name


def _read_piecewise(element: Element) -> Choice:
    pieces = []
    for piece in element.all("piece"):
        if len(piece.children) != 2:
            raise piece.error(
                f"<piece> with {len(piece.children)} elements", "a value and a condition"
            )
        value, condition = (_read_expression(child) for child in piece.children)
        pieces.append((value, condition))
    otherwise = element.first("otherwise")
    # Together the pieces and one <otherwise> must be all children.
    if len(pieces) + (otherwise is not None) != len(element.children) or not pieces:
        raise element.error(
            "<piecewise> with something else than pieces and one <otherwise>",
            "one <piece> or more, then <otherwise>",
        )
    if otherwise is None:
        return Choice(tuple(pieces), None)
    content = _read_expression(_single_child(otherwise, otherwise.children))
    return Choice(tuple(pieces), content)


def _read_number(element: Element) -> float:
    if element.attributes.get("base", "10").strip() != "10":
        raise element.error(f"a number to the base {element.attributes['base']}", "decimal numbers")
    # A child, <sep/>, separates two parts. It leaves a blank in the text.
    texts = element.text.split() if element.children else [element.text]
    parts = [parse_number(text, element) for text in texts]
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
        function = OPERATORS[expression.operator][0]
        return function(*(evaluate_mathml(argument, values) for argument in expression.arguments))
    result = np.asarray(np.nan)
    if expression.otherwise is not None:
        result = evaluate_mathml(expression.otherwise, values)
    # The first piece that holds counts, so the pieces are applied from the last to the first.
    for value, condition in reversed(expression.pieces):
        holds = evaluate_mathml(condition, values) != 0.0
        result = np.where(holds, evaluate_mathml(value, values), result)
    return result


def expression_variables(expression: Expression) -> Iterator[str]:
    """Yield the varIDs of the variables of an expression."""
    if isinstance(expression, Name):
        yield expression.varID
    elif isinstance(expression, Apply):
        for argument in expression.arguments:
            yield from expression_variables(argument)
    elif isinstance(expression, Choice):
        for value, condition in expression.pieces:
            yield from expression_variables(value)
            yield from expression_variables(condition)
        if expression.otherwise is not None:
            yield from expression_variables(expression.otherwise)


def write_mathml(expression: Expression, indent: str) -> list[str]:
    """Return an expression of numbers, names and operators as lines of XML.

    Raises
    ------
    TypeError
        The expression contains a `Choice`.
    """
    if isinstance(expression, MathNumber):
        return [f"{indent}<cn>{expression.value!r}</cn>"]
    if isinstance(expression, Name):
        return [f"{indent}<ci>{escape(expression.varID)}</ci>"]
    if not isinstance(expression, Apply):
        raise TypeError(f"{type(expression).__name__} is not written; build it from operators")
    lines = [f"{indent}<apply>", f"{indent}  <{expression.operator}/>"]
    for argument in expression.arguments:
        lines += write_mathml(argument, indent + "  ")
    return [*lines, f"{indent}</apply>"]
