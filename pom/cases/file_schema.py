"""JSON schema of case files, for editors: made from the form of the file and the words of the tolerance table.

The one that is shipped, ``case.schema.json`` next to this module, is `case_schema` as text; a test keeps it so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flightmech.names import VOCABULARY, lookup

from ..tolerances import rows
from ..tolerances.override import Entry
from .case_file import CONDITIONS, CaseFile

SHIPPED = Path(__file__).with_name("case.schema.json")


def case_schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of a case file.

    It knows every key with its description, the words of the tolerance table (tests, editions, events, conditions of
    rows) and the SI unit of every condition.  What depends on several keys at once, `read_case` checks.
    """
    schema = CaseFile.model_json_schema()
    parts = schema["$defs"]
    parts["Entry"] = _described(Entry.model_json_schema(), "Half width, percentage, base, rule, group and window.")
    case = parts["CaseTable"]["properties"]
    case["id"]["enum"] = sorted({row["test_id"] for row in rows.rows()})
    case["standard"]["enum"] = sorted({row["standard"] for row in rows.rows()})
    case["edition"]["enum"] = sorted({row["edition"] for row in rows.rows()})
    case["features"]["items"]["enum"] = sorted(rows.features())
    case["show"]["items"]["examples"] = sorted(VOCABULARY)
    top = schema["properties"]
    _only(top["conditions"], {name: _quantity(name) for name in CONDITIONS})
    _only(top["events"], {name: {"type": "number", "description": "[s] on the clock of the record"} for name in sorted(rows.events())})
    top["tolerance"]["additionalProperties"] = {"anyOf": [{"type": "number"}, {"type": "string"}, {"$ref": "#/$defs/Entry"}]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_described(schema, schema["description"])}


def schema_text() -> str:
    """Return the schema as the text of ``case.schema.json``."""
    return json.dumps(case_schema(), indent=1, ensure_ascii=False) + "\n"


def _quantity(name: str) -> dict[str, Any]:
    row = lookup(name)
    return {"anyOf": [{"type": "number"}, {"type": "string"}], "description": f"{row.long_name} [{row.units}], or a text with its unit"}


def _only(place: dict[str, Any], properties: dict[str, Any]) -> None:
    place["properties"] = properties
    place["additionalProperties"] = False


def _described(schema: dict[str, Any], text: str) -> dict[str, Any]:
    return {**schema, "description": text}
