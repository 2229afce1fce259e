"""JSON schemas of TOML files, for editors: made from the models that read the files, so that both allow the same keys."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel

from .configuration import UNIT

DIALECT = "https://json-schema.org/draft/2020-12/schema"


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
        Keys with description and unit, ``x-unit`` once more for programs.  TOML has no null, so the schema has none either; what
        depends on several keys at once the reader alone checks.
    """
    return {"$schema": DIALECT, **part_schema(model), "description": text}


def part_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of one table, in the form that `file_schema` describes; models inside it stand in its ``$defs``."""
    return _plain(model.model_json_schema())


def schema_text(schema: dict[str, Any]) -> str:
    """Return a schema as the text of a file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _plain(item: Any) -> Any:
    """Return a part of a schema without null, titles and defaults that are tables; descriptions end with the unit."""
    if isinstance(item, list):
        return [_plain(part) for part in item]
    if not isinstance(item, dict):
        return item
    found: dict[str, Any] = {
        key: _table(part) if key in ("properties", "$defs") else _plain(part) for key, part in item.items() if key != "title"
    }
    if found.get("default", 0) is None or isinstance(found.get("default"), dict):
        del found["default"]
    if "anyOf" in found:
        given: list[dict[str, Any]] = [part for part in found.pop("anyOf") if part != {"type": "null"}]
        found = {**found, "anyOf": given} if len(given) > 1 else {**given[0], **found}
    unit = unit_of(found)
    if unit not in ("", "1") and "description" in found and "]" not in found["description"]:
        found["description"] += f" [{unit}]"
    return found


def _table(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a table: their names are no words of the schema."""
    return {name: _plain(part) for name, part in properties.items()}


def unit_of(item: Any) -> str:
    """Return the unit of a quantity, of the items of an array or of the values of a table; empty when there is none."""
    if isinstance(item, list):
        return next((unit for part in item if (unit := unit_of(part))), "")
    if not isinstance(item, dict) or item.get("properties"):
        return ""
    inside = (item.get(key) for key in ("items", "prefixItems", "anyOf", "additionalProperties"))
    return item.get(UNIT) or next((unit for part in inside if (unit := unit_of(part))), "")
