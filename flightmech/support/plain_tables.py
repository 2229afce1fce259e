"""Classes that hold a table of a TOML file: values of stated kinds, which are checked when an
object is made and then stay.

A value that is plainly of the kind of its field is taken as it is.  All others are left to the
model of pydantic that `flightmech.support.toml_models.model_of` makes of the same class: it
converts them, or states what is wrong with them.  So pydantic is imported for unusual and for wrong
tables only, and the class is the one place that defines what a table may hold.  Its methods are
written once, here; a frozen dataclass compiles those of each class anew, in every process.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from functools import cache
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    NoReturn,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)
from typing import get_type_hints as _hints

from flightmech.support.toml_models import model_of, validate_content
from flightmech.support.toml_quantities import Above, InUnits

P = TypeVar("P", bound="Plain")


class FieldDefinition(NamedTuple):
    """What the definition of a field states besides its kind; the default is an ellipsis where the
    value must be given.
    """

    default: Any
    about: dict[str, Any]


def define_field(*, default: Any = ..., **about: Any) -> Any:
    """Return the definition of a field: its default, and its ``description`` and ``examples`` for
    the JSON schema.
    """
    return FieldDefinition(default, about)


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(define_field,))
class Plain:
    """Base of the classes; their values are given by name."""

    values: ClassVar[Mapping[str, FieldDefinition]]

    def __init_subclass__(cls) -> None:
        """Take the definitions of the fields, each a `define_field`."""
        cls.values = {
            name: item for name, item in vars(cls).items() if isinstance(item, FieldDefinition)
        }
        for name in cls.values:
            delattr(cls, name)

    def __init__(self, **given: Any) -> None:
        """Check and convert the values.

        Raises
        ------
        TypeError
            A name that is none of the fields, or none for one that must be given.
        ValueError
            That of pydantic, with one sentence for each value that is wrong.
        """
        found = {name: given.get(name, item.default) for name, item in self.values.items()}
        if given.keys() - found.keys() or any(item is ... for item in found.values()):
            raise TypeError(
                f"{type(self).__name__}: given {', '.join(given)}; expected "
                f"{', '.join(self.values)}"
            )
        try:
            kinds = _kinds(type(self))
            found |= {name: _fitted(item, kinds[name]) for name, item in given.items()}
        except _OtherKind:
            found = dict(model_of(type(self)).model_validate(given))
        self.__dict__.update(found)
        self.check()

    def check(self) -> None:
        """Raise ValueError when values contradict each other."""

    def changed(self: P, **others: Any) -> P:
        """Return a copy with other values."""
        return type(self)(**{**vars(self), **others})

    def stated(self) -> dict[str, Any]:
        """Return the values that differ from their defaults, by name."""
        return {
            name: item for name, item in vars(self).items() if item != self.values[name].default
        }

    def __setattr__(self, name: str, item: Any) -> NoReturn:
        """Refuse to change a value."""
        raise AttributeError(
            f"{type(self).__name__}.{name} cannot be changed; `changed` gives a copy with "
            f"another value"
        )

    def __eq__(self, other: object) -> bool:
        """Return whether the values are the same."""
        return type(other) is type(self) and vars(other) == vars(self)

    def __hash__(self) -> int:
        """Return the hash of the values."""
        return hash((type(self), *vars(self).values()))

    def __repr__(self) -> str:
        """Return the call that makes an equal object."""
        return f"{type(self).__name__}({', '.join(f'{name}={item!r}' for name, item in self.stated().items())})"


def read_plain_table(kind: type[P], content: Mapping[str, Any], what: str) -> P:
    """Return a table of a file as an object of a class.

    Raises
    ------
    SchemaError
        With all problems: place in the file, what came, what is allowed.
    """
    try:
        return kind(**content)
    except (TypeError, ValueError):  # a key that is unknown or missing; a value
        return kind(**dict(validate_content(model_of(kind), dict(content), what)))


class _OtherKind(Exception):
    """A value that is not plainly of the kind of its field."""


def _annotations(kind: Any) -> dict[str, Any]:
    return _hints(kind, include_extras=True)


_kinds: Callable[[Any], dict[str, Any]] = cache(_annotations)


def _fitted(item: Any, kind: Any) -> Any:
    """Return a value as the field holds it: whole numbers as fractions where these are meant,
    arrays as tuples.
    """
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
