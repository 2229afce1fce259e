"""Immutable classes for TOML tables. Values are validated at construction.

A value that has the type of its field is used without a conversion. For all other values
`flightmech.support.toml_models.model_of` makes a model of pydantic from the same class, which
converts the values or reports the problems. The model is only made for such values, because it
takes long to make. The methods are defined once in the base class, because a frozen dataclass
compiles the methods of each class in each process.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from contextlib import suppress
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
    """Default of a field, and its description for the JSON schema.

    The default of a field that must be given is an ellipsis.
    """

    default: Any
    about: dict[str, Any]


def define_field(*, default: Any = ..., **about: Any) -> Any:
    """Return the definition of a field.

    Parameters
    ----------
    default : object
        Without a default the value must be given.
    **about
        ``description`` and ``examples`` for the JSON schema.
    """
    return FieldDefinition(default, about)


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(define_field,))
class Plain:
    """Base of the classes. The arguments of the constructor are keywords."""

    values: ClassVar[Mapping[str, FieldDefinition]]

    def __init_subclass__(cls) -> None:
        """Move the definitions of the fields from the attributes of the class to `values`."""
        attributes = vars(cls).items()
        cls.values = {name: item for name, item in attributes if isinstance(item, FieldDefinition)}
        for name in cls.values:
            delattr(cls, name)

    def __init__(self, **arguments: Any) -> None:
        """Check and convert the values.

        Raises
        ------
        TypeError
            An unknown field, or a missing value.
        ValueError
            An invalid value. The error of pydantic has one sentence for each of them.
        """
        values = {name: item.default for name, item in self.values.items()} | arguments
        if values.keys() != self.values.keys() or any(item is ... for item in values.values()):
            raise TypeError(
                f"{type(self).__name__}: given {', '.join(arguments)}; expected "
                f"{', '.join(self.values)}"
            )
        try:
            types = _field_types(type(self))
            for name, item in arguments.items():
                values[name] = _convert(item, types[name])
        except _OtherType:
            values = dict(model_of(type(self)).model_validate(arguments))
        # past __setattr__, which does not allow changes
        self.__dict__.update(values)
        self.check()

    def check(self) -> None:
        """Raise ValueError if values contradict each other."""

    def changed(self: P, **others: Any) -> P:
        """Return a copy with other values."""
        return type(self)(**{**vars(self), **others})

    def stated(self) -> dict[str, Any]:
        """Return the values that differ from their defaults, by name."""
        values = vars(self).items()
        return {name: item for name, item in values if item != self.values[name].default}

    def __setattr__(self, name: str, item: Any) -> NoReturn:
        """Raise, because values cannot be changed."""
        raise AttributeError(
            f"{type(self).__name__}.{name} cannot be changed; `changed` gives a copy with "
            f"another value"
        )

    def __eq__(self, other: object) -> bool:
        """Return whether type and values are equal."""
        return type(other) is type(self) and vars(other) == vars(self)

    def __hash__(self) -> int:
        """Return the hash of the values."""
        return hash((type(self), *vars(self).values()))

    def __repr__(self) -> str:
        """Return the call that makes an equal object."""
        arguments = [f"{name}={item!r}" for name, item in self.stated().items()]
        return f"{type(self).__name__}({', '.join(arguments)})"


def read_plain_table(kind: type[P], content: Mapping[str, Any], what: str) -> P:
    """Return a table of a file as an object of a class.

    Raises
    ------
    SchemaError
        With all problems: position in the file, the value, the allowed values.
    """
    try:
        return kind(**content)
    except (TypeError, ValueError):
        # the model reports all problems
        return kind(**dict(validate_content(model_of(kind), dict(content), what)))


class _OtherType(Exception):
    """A value does not have the type of its field."""


def _read_annotations(kind: Any) -> dict[str, Any]:
    return _hints(kind, include_extras=True)


_field_types: Callable[[Any], dict[str, Any]] = cache(_read_annotations)


def _convert(item: Any, kind: Any) -> Any:
    """Return a value of the type `kind`: an integer as float, an array as tuple.

    Raise `_OtherType` if pydantic must convert the value.
    """
    if type(item) is kind or (item is None and kind is types.NoneType):
        return item
    # larger integers are errors
    if kind is float and type(item) is int and abs(item) < 2**63:
        return float(item)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _apply_rules(item, arguments)
    if origin is tuple and type(item) in (list, tuple):
        return _convert_tuple(item, arguments)
    # the types are compared, because True == 1
    if origin is Literal and any(type(item) is type(x) and item == x for x in arguments):
        return item
    if origin in (Union, types.UnionType):
        for choice in arguments:
            with suppress(_OtherType):
                return _convert(item, choice)
    raise _OtherType


def _convert_tuple(items: Any, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    if arguments[-1] is Ellipsis:
        arguments = (arguments[0],) * len(items)
    if len(arguments) != len(items):
        raise _OtherType
    return tuple(_convert(item, kind) for item, kind in zip(items, arguments, strict=True))


def _apply_rules(item: Any, arguments: tuple[Any, ...]) -> Any:
    """Return a value after the rules `InUnits` and `Above` of its annotation."""
    kind, *rules = arguments
    for rule in rules:
        if isinstance(rule, InUnits):
            if type(item) not in (str, int, float):
                raise _OtherType
            try:
                item = rule.convert(item)
            except ValueError:
                raise _OtherType from None
        elif not (isinstance(rule, Above) and item > rule.low):
            raise _OtherType
    return _convert(item, kind)
