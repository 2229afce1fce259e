"""TOML files through a pydantic model: every problem at once, in the wording of the package,
similar names for misspelt keys.

The JSON schemas of the files, for editors, come from the same models, so that both allow the same
keys.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from flightmech.errors import SchemaError, near_names
from flightmech.support.input_files import foreign_kind
from flightmech.support.toml_quantities import UNIT, InUnits

T = TypeVar("T", bound="Strict")

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class Strict(BaseModel):
    """Base of all file models: frozen, and an unknown key is an error."""

    # most models are parts of one that reads a file, or of a file that a command does not read:
    # each is built when it first reads something
    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, defer_build=True
    )


def make_si_type(units: str) -> Any:
    """Return the field type of a quantity: a bare number is SI, a text carries its unit (``"40
    deg"``).

    Parameters
    ----------
    units : str
        SI unit of the quantity.
    """

    return Annotated[float, InUnits(units)]


def fixed_array(items: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the JSON schema of an array with a schema for each of its items."""
    return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}


def _model_of(kind: Any) -> type[Strict]:
    """Return the model of a class of `flightmech.support.plain_tables`: its fields, and its check
    of what contradicts itself.
    """
    hints = get_type_hints(kind, include_extras=True)
    parts: dict[str, Any] = {}
    for name, (default, about) in kind.values.items():
        parts[name] = hints[name], Field(default, **about)

    def check(model: Any) -> Any:
        kind.check(model)
        return model

    rules: Any = {"check": model_validator(mode="after")(check)}
    return create_model(
        kind.__name__, __base__=Strict, __doc__=kind.__doc__, __validators__=rules, **parts
    )


model_of: Callable[[Any], type[Strict]] = cache(_model_of)


def validate_content(model: type[T], content: dict[str, Any], what: str) -> T:
    """Return `content` as a `model`.

    Raises
    ------
    SchemaError
        With all problems: place in the file, what came, what is allowed.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        kind = _other_kind(model, content)
        raise SchemaError(
            what, [kind] if kind else [_sentence(model, item) for item in error.errors()]
        ) from error


def _other_kind(model: type[BaseModel], content: dict[str, Any]) -> str:
    """Return a sentence on a file that is plainly of another kind than `model`, else nothing."""
    if not content and any(field.is_required() for field in model.model_fields.values()):
        return f"the file is empty; expected the keys {', '.join(model.model_fields)}"
    if kind := foreign_kind(content, model.model_fields):
        return f"{kind}; expected the keys {', '.join(model.model_fields)}"
    required = {name for name, field in model.model_fields.items() if field.is_required()}
    plain = {key for key, part in content.items() if not isinstance(part, dict)}
    few = 2 * len(required & set(content)) <= len(required)
    if (
        len(required) > 2 and few and not plain & set(model.model_fields)
    ):  # tables alone, as in a name map, where others are required
        expected = ", ".join(model.model_fields)
        return (
            f"no key of this kind of file, found {', '.join(content)} (a name map of records "
            f"goes with --names); expected {expected}"
        )
    return ""


def _sentence(model: type[BaseModel], item: Any) -> str:
    place = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        allowed = sorted(_fields(model, item["loc"][:-1]))
        return f"{place}: unknown key{_near(str(item['loc'][-1]), allowed)}"
    if item["type"] == "missing":
        return f"{place}: missing; give it"
    message = item["msg"].removeprefix("Value error, ")
    came = "" if message.startswith("found ") else f"; found {item['input']!r}"
    return f"{place}: {message[:1].lower()}{message[1:]}{came}"


def _near(name: str, allowed: list[str]) -> str:
    near = near_names(name, allowed, 3)
    return f"; near it: {', '.join(near)}" if near else f"; allowed: {', '.join(allowed)}"


def _fields(model: Any, loc: tuple[Any, ...]) -> set[str]:
    """Return the keys allowed at a place, by walking down the annotations."""
    for part in loc:
        if (
            isinstance(part, str)
            and isinstance(model, type)
            and issubclass(model, BaseModel)
            and part in model.model_fields
        ):
            model = _inner(model.model_fields[part].annotation)
        else:
            model = _inner(model)
    return (
        set(model.model_fields)
        if isinstance(model, type) and issubclass(model, BaseModel)
        else set()
    )


def _inner(annotation: Any) -> Any:
    """Return the model inside ``Optional``, ``tuple``, ``list`` or ``dict`` annotations."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        found = _inner(part)
        if found is not None:
            return found
    return None


def file_schema(model: type[BaseModel], text: str) -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of the files that a model reads.

    Parameters
    ----------
    model : type
        Model of the whole file.
    text : str
        What the file is.

    Returns
    -------
    dict
        Keys with description and unit, ``x-unit`` once more for programs.  TOML has no null, so the
        schema has none either; what depends on several keys at once the reader alone checks.
    """
    return {"$schema": DIALECT, **part_schema(model), "description": text}


def part_schema(model: type[Any]) -> dict[str, Any]:
    """Return the schema of one table, in the form that `file_schema` describes; models inside it
    stand in its ``$defs``.
    """
    whole = model if issubclass(model, BaseModel) else model_of(model)
    return _plain(whole.model_json_schema())


def schema_text(schema: dict[str, Any]) -> str:
    """Return a schema as the text of a file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _plain(item: Any) -> Any:
    """Return a part of a schema without null, titles and defaults that are tables; descriptions end
    with the unit.
    """
    if isinstance(item, list):
        return [_plain(part) for part in item]
    if not isinstance(item, dict):
        return item
    found: dict[str, Any] = {
        key: _table(part) if key in ("properties", "$defs") else _plain(part)
        for key, part in item.items()
        if key != "title"
    }
    if found.get("default", 0) is None or isinstance(found.get("default"), dict):
        del found["default"]
    if "anyOf" in found:
        given: list[dict[str, Any]] = [
            part for part in found.pop("anyOf") if part != {"type": "null"}
        ]
        found = {**found, "anyOf": given} if len(given) > 1 else {**given[0], **found}
    unit = unit_of(found)
    if unit not in ("", "1") and "description" in found and "]" not in found["description"]:
        found["description"] += f" [{unit}]"
    return found


def _table(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a table: their names are no words of the schema."""
    return {name: _plain(part) for name, part in properties.items()}


def unit_of(item: Any) -> str:
    """Return the unit of a quantity, of the items of an array or of the values of a table; empty
    when there is none.
    """
    if isinstance(item, list):
        return next((unit for part in item if (unit := unit_of(part))), "")
    if not isinstance(item, dict) or item.get("properties"):
        return ""
    inside = (item.get(key) for key in ("items", "prefixItems", "anyOf", "additionalProperties"))
    return item.get(UNIT) or next((unit for part in inside if (unit := unit_of(part))), "")
