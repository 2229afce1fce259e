"""Validation of TOML files with models of pydantic, and the JSON schemas of the files.

An error has all problems of a file, with similar names for misspelt keys. The JSON schemas, for
editors, come from the same models, so that both allow the same keys.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from flightmech.errors import SchemaError, near_names
from flightmech.support.file_kinds import foreign_kind
from flightmech.support.toml_quantities import UNIT

T = TypeVar("T", bound="Strict")

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class Strict(BaseModel):
    """Base of all models of files. Objects are immutable; unknown keys, nan and inf are errors, and
    so are true and false in the place of a number.
    """

    # A command uses few of the models, so a validator is built on first use of its model.
    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=True,
        defer_build=True,
        allow_inf_nan=False,
    )

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_truth_values(cls, value: Any, info: ValidationInfo) -> Any:
        # pydantic takes true for 1.0; its strict mode would also refuse 3 for 3.0
        if _has_truth_value(value):
            annotation = cls.model_fields[str(info.field_name)].annotation
            if not _may_be_true(annotation):
                raise ValueError(f"found {value!r}; expected numbers or texts, not true or false")
        return value


def _has_truth_value(value: Any) -> bool:
    """Return whether a value of TOML is true or false, or an array or table that has one."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return any(map(_has_truth_value, value))
    return isinstance(value, bool)


def _may_be_true(annotation: Any) -> bool:
    """Return whether an annotation has truth values, or has parts whose own validators decide."""
    if annotation in (bool, Any) or _is_model(annotation):
        return True
    return any(map(_may_be_true, getattr(annotation, "__args__", ())))


def fixed_array(items: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the JSON schema of an array of fixed length, with one schema per item."""
    return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}


# Largest number of problems of a file with a sentence; of the others the position is given.
_MOST_DESCRIBED = 200


def validate_content(model: type[T], content: dict[str, Any], what: str, context: Any = None) -> T:
    """Return `content` as an object of `model`.

    Parameters
    ----------
    model : type
    content : dict
        Content of a TOML file, or of one table.
    what : str
        Name of the file, for an error.
    context : object, optional
        Context of the validators of `model`.

    Raises
    ------
    SchemaError
        With all problems: position in the file, the value, the allowed values.
    """
    try:
        return model.model_validate(content, context=context)
    except ValidationError as error:
        # a file of another kind gets one sentence instead of a problem for each key
        if kind := _describe_other_kind(model, content):
            problems = [kind]
        else:
            found = error.errors()
            problems = [_describe_problem(model, item) for item in found[:_MOST_DESCRIBED]]
            # the search for similar names takes minutes for 100 000 unknown keys
            problems += [position_text(item["loc"]) for item in found[_MOST_DESCRIBED:]]
        raise SchemaError(what, problems) from error


def _describe_other_kind(model: type[BaseModel], content: dict[str, Any]) -> str:
    """Return a sentence if a file is of another kind than `model`, else an empty text."""
    keys = model.model_fields
    required = {name for name, field in keys.items() if field.is_required()}
    if not content and required:
        return f"the file is empty; expected the keys {', '.join(keys)}"
    if kind := foreign_kind(content, keys):
        return f"{kind}; expected the keys {', '.join(keys)}"
    # Tables only, as in a name map, while this kind of file requires other keys.
    values = {key for key, item in content.items() if not isinstance(item, dict)}
    has_few = 2 * len(required & set(content)) <= len(required)
    if len(required) > 2 and has_few and not values & set(keys):
        return (
            f"no key of this kind of file, found {', '.join(content)} (a name map of records "
            f"goes with --names); expected {', '.join(keys)}"
        )
    return ""


def position_text(location: Sequence[str | int]) -> str:
    """Return the position of a key in a file, ``engine.1.position``.

    Engines count from 1, as in the names of channels and terms: ``engine1.thrust``.

    Examples
    --------
    >>> position_text(("engine", 0, "position", 2)), position_text(("fit", 0, "models"))
    ('engine.1.position.2', 'fit.0.models')
    """
    parts = list(location)
    if len(parts) > 1 and parts[0] == "engine" and isinstance(parts[1], int):
        parts[1] += 1
    return ".".join(map(str, parts))


def _describe_problem(model: type[BaseModel], item: Any) -> str:
    """Return the sentence of a problem that pydantic reports."""
    position = position_text(item["loc"])
    if item["type"] == "extra_forbidden":
        allowed = sorted(_allowed_keys(model, item["loc"][:-1]))
        near = near_names(str(item["loc"][-1]), allowed, 3)
        if near:
            return f"{position}: unknown key; near it: {', '.join(near)}"
        return f"{position}: unknown key; allowed: {', '.join(allowed)}"
    if item["type"] == "missing":
        return f"{position}: missing; give it"
    if item["type"] in ("model_type", "model_attributes_type"):
        keys = sorted(_allowed_keys(model, item["loc"]))
        return (
            f"{position}: expected a table {{ ... }} of {', '.join(keys)}; found {item['input']!r}"
        )
    if item["type"] in ("tuple_type", "list_type"):
        return f"{position}: expected a list, as [a, b]; found {item['input']!r}"
    message = item["msg"].removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    if not message.startswith("found "):
        message += f"; found {item['input']!r}"
    return f"{position}: {message}"


def _allowed_keys(model: Any, loc: tuple[Any, ...]) -> set[str]:
    """Return the keys that are allowed at a position, from the annotations."""
    for part in loc:
        if _is_model(model) and part in model.model_fields:
            model = _inner_model(model.model_fields[part].annotation)
        else:
            # an index of an array, or a free key of a table
            model = _inner_model(model)
    return set(model.model_fields) if _is_model(model) else set()


def _inner_model(annotation: Any) -> Any:
    """Return the model inside ``Optional``, ``tuple``, ``list`` or ``dict`` annotations."""
    if _is_model(annotation):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        model = _inner_model(argument)
        if model is not None:
            return model
    return None


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def file_schema(model: type[BaseModel], text: str) -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of the files of a model.

    Parameters
    ----------
    model : type
        Model of the whole file.
    text : str
        Description of the file.

    Returns
    -------
    dict
        Keys with description and unit, and the unit as ``x-unit`` for programs. TOML has no null,
        so the schema has no null. Conditions between several keys are not in the schema.
    """
    return {"$schema": DIALECT, **part_schema(model), "description": text}


def part_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of one table in the form of `file_schema`, with inner models in
    ``$defs``.
    """
    return _simplify(model.model_json_schema())


def schema_text(schema: dict[str, Any]) -> str:
    """Return a schema as the text of a file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _simplify(item: Any) -> Any:
    """Return a part of a schema without null, titles and defaults that are tables.

    The unit is added to the descriptions.
    """
    if isinstance(item, list):
        return [_simplify(part) for part in item]
    if not isinstance(item, dict):
        return item
    schema: dict[str, Any] = {}
    for key, part in item.items():
        if key in ("properties", "$defs"):
            # the keys of this table are names and not keywords of JSON Schema
            schema[key] = {name: _simplify(inner) for name, inner in part.items()}
        elif key != "title":
            schema[key] = _simplify(part)
    if schema.get("default", 0) is None or isinstance(schema.get("default"), dict):
        del schema["default"]
    if "anyOf" in schema:
        choices = [choice for choice in schema.pop("anyOf") if choice != {"type": "null"}]
        if len(choices) > 1:
            schema["anyOf"] = choices
        else:
            schema = {**choices[0], **schema}
    unit = unit_of(schema)
    if unit not in ("", "1") and "description" in schema and "]" not in schema["description"]:
        schema["description"] += f" [{unit}]"
    return schema


def unit_of(item: Any) -> str:
    """Return the unit in the schema of a quantity, an array or a table of free keys.

    Without a unit the result is an empty text.
    """
    if isinstance(item, list):
        return _first_unit(item)
    if not isinstance(item, dict) or item.get("properties"):
        return ""
    if unit := item.get(UNIT):
        return unit
    keywords = ("items", "prefixItems", "anyOf", "additionalProperties")
    return _first_unit([item.get(keyword) for keyword in keywords])


def _first_unit(items: list[Any]) -> str:
    for item in items:
        if unit := unit_of(item):
            return unit
    return ""
