"""Classes that hold a table of a TOML file: plain dataclasses whose values are checked when one is made.

A value that is plainly of the kind of its field is taken as it is.  All others are left to the model of pydantic that
`flightmech.support.configuration.model_of` makes of the same class: it converts them, or states what is wrong with them.  So pydantic is
imported for unusual and for wrong tables only, and the class is the one place that defines what a table may hold.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from .toml_files.quantities import Above, InUnits

P = TypeVar("P", bound="Plain")


class Plain:
    """Base of the classes: frozen dataclasses whose fields carry ``description`` and ``examples`` as metadata."""

    def __post_init__(self) -> None:
        """Check and convert the values; raises ValueError, that of pydantic with one sentence for each of them."""
        given = {name: getattr(self, name) for name in _fields(type(self))}
        try:
            found = {
                name: _fitted(given[name], kind) for name, (kind, default) in _fields(type(self)).items() if given[name] is not default
            }
        except _OtherKind:
            from .configuration import model_of

            found = dict(model_of(type(self)).model_validate(given))
        for name, item in found.items():
            object.__setattr__(self, name, item)
        self.check()

    def check(self) -> None:
        """Raise ValueError when values contradict each other."""


def made(kind: type[P], content: Mapping[str, Any], what: str) -> P:
    """Return a table of a file as an object of a class.

    Raises
    ------
    SchemaError
        With all problems: place in the file, what came, what is allowed.
    """
    try:
        return kind(**content)
    except (TypeError, ValueError):  # a key that is unknown or missing; a value
        from .configuration import model_of, validate

        return kind(**dict(validate(model_of(kind), dict(content), what)))


def stated(item: Plain) -> dict[str, Any]:
    """Return the values that differ from their defaults, by name."""
    found = {name: (getattr(item, name), default) for name, (_, default) in _fields(type(item)).items()}
    return {name: value for name, (value, default) in found.items() if value != default}


class _OtherKind(Exception):
    """A value that is not plainly of the kind of its field."""


def _fields_of(kind: Any) -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of each field of a class; MISSING for a value that must be given."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: (hints[field.name], field.default) for field in fields(kind)}


_fields: Callable[[Any], dict[str, tuple[Any, Any]]] = cache(_fields_of)


def _fitted(item: Any, kind: Any) -> Any:
    """Return a value as the field holds it: whole numbers as fractions where these are meant, arrays as tuples."""
    if type(item) is kind or (item is None and kind is types.NoneType):
        return item
    if kind is float and type(item) is int and abs(item) < 2**63:
        return float(item)
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _as_annotated(item, parts)
    if origin is Literal and any(type(item) is type(part) and item == part for part in parts):
        return item
    if origin is tuple and type(item) in (list, tuple):
        each = (parts[0],) * len(item) if parts[-1] is Ellipsis else parts
        if len(each) == len(item):
            return tuple(_fitted(one, part) for one, part in zip(item, each, strict=True))
    if origin in (Union, types.UnionType):
        for part in parts:
            try:
                return _fitted(item, part)
            except _OtherKind:
                continue
    raise _OtherKind


def _as_annotated(item: Any, parts: tuple[Any, ...]) -> Any:
    """Return a value that passes the rules of its annotation."""
    kind, *rules = parts
    for rule in rules:
        if isinstance(rule, InUnits):
            if type(item) not in (str, int, float):
                raise _OtherKind
            try:
                item = rule.convert(item)
            except ValueError:
                raise _OtherKind from None
        elif not (isinstance(rule, Above) and item > rule.low):
            raise _OtherKind
    return _fitted(item, kind)
