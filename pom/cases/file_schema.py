"""JSON schema of case files, for editors: made from the form of the file and the words of the tolerance table.

`aeromatch pom schema` and `aeromatch schema case` write it.
"""

from __future__ import annotations

from typing import Any

from flightmech.names import VOCABULARY, lookup
from flightmech.support.configuration import file_schema, part_schema
from flightmech.support.toml_files.quantities import quantity_schema

from ..tolerances import rows
from ..tolerances.override import Entry
from .case_file import CONDITIONS, CaseFile


def case_schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of a case file.

    It knows every key with its description, the words of the tolerance table (tests, editions, events, conditions of
    rows) and the SI unit of every condition.  What depends on several keys at once, `read_case` checks.
    """
    schema = file_schema(CaseFile, CaseFile.__doc__ or "")
    parts = schema["$defs"]
    parts["Entry"] = {**part_schema(Entry), "description": "Half width, percentage, base, rule, group and window."}
    case = parts["CaseTable"]["properties"]
    case["id"]["enum"] = sorted({row["test_id"] for row in rows.rows()})
    case["standard"]["enum"] = sorted({row["standard"] for row in rows.rows()})
    case["edition"]["enum"] = sorted({row["edition"] for row in rows.rows()})
    case["features"]["items"]["enum"] = sorted(rows.features())
    case["show"]["items"]["examples"] = sorted(VOCABULARY)
    top = schema["properties"]
    _only(top["conditions"], {name: _quantity(name) for name in CONDITIONS})
    _only(
        top["events"],
        {name: {"type": "number", "description": "[s] on the clock of the record", "examples": [12.5]} for name in sorted(rows.events())},
    )
    top["tolerance"]["additionalProperties"] = {"anyOf": [{"type": "number"}, {"type": "string"}, {"$ref": "#/$defs/Entry"}]}
    return schema


def _quantity(name: str) -> dict[str, Any]:
    row = lookup(name)
    example = 1.0 if row.units == "1" else f"1 {row.display_units}"
    return {**quantity_schema(row.units), "description": f"{row.long_name} [{row.units}], or a text with its unit", "examples": [example]}


def _only(place: dict[str, Any], properties: dict[str, Any]) -> None:
    place["properties"] = properties
    place["additionalProperties"] = False
