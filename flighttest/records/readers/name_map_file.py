"""JSON schema of name maps, for editors.

The schema has the tables of the reader, and the vocabulary in every other table.
"""

from __future__ import annotations

from typing import Any

from flightmech.names import ITEM, VOCABULARY
from flightmech.support.toml_models import DIALECT, Strict, part_schema
from flighttest.records.readers.bus_words import KINDS
from flighttest.records.readers.name_map import TOP, Channel, Clock, Facts, Utc
from flighttest.records.sensors.instruments import Instrument

_ENGINE = r"^engine[1-9]\d*$"
_NAMED_PARTS = r"^(joint|device|tank|transfer)$"  # tank.left.fuel
_MODELS: dict[str, type[Strict]] = {
    "Channel": Channel,
    "Clock": Clock,
    "Facts": Facts,
    "Utc": Utc,
    "Instrument": Instrument,
}


def name_map_schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of name maps.

    It has every key with its description and unit, and every canonical name.  Units that do not
    fit, repeated columns and calibrations without a unit are errors of the reader only.
    """
    definitions = {name: part_schema(model) for name, model in _MODELS.items()}
    for kind, model in KINDS.items():
        definitions[f"decode_{kind}"] = part_schema(model)
    # One schema has one table of definitions.
    inner: dict[str, Any] = {}
    for schema in definitions.values():
        inner.update(schema.pop("$defs", {}))
    # The table of a channel may be the name of a CSV file, and a channel may be a column alone.
    channel = definitions["Channel"]["properties"]
    channel["table"] = _allow_text(channel["table"])
    definitions["channel"] = {"anyOf": [*channel["column"]["anyOf"], _reference("Channel")]}
    definitions["leaf"] = _table_of_names(
        _reference("channel"), "channels of one time base: canonical name = column"
    )
    special = _special_tables()
    return {
        "$schema": DIALECT,
        "description": "A name map: which column of a recording is which quantity, in which unit "
        "and sign, over which clock.",
        "type": "object",
        "properties": {key: special[key] for key in TOP},
        "additionalProperties": _reference("leaf"),
        "$defs": {**inner, **definitions},
    }


def _reference(name: str) -> dict[str, Any]:
    return {"$ref": f"#/$defs/{name}"}


def _special_tables() -> dict[str, Any]:
    """Return the schemas of the keys that are not tables of channels."""
    kinds = [_reference(f"decode_{kind}") for kind in KINDS]
    clock = part_schema(Clock)
    return {
        "extends": {
            "type": "string",
            "description": "A shipped map or another file; what stands here goes before it.",
            "examples": ["px4"],
        },
        "optional": {
            "type": "boolean",
            "description": "Whether channels without a column are left out.",
            "default": False,
        },
        "time": {
            **clock,
            "additionalProperties": _reference("Clock"),
            "description": "The clock of the file; [time.NAME] for one table of it.",
        },
        "record": {**_reference("Facts"), "description": "Facts that the file does not state."},
        "constants": _table_of_names(
            {"type": ["number", "string"]},
            "Channels that no column shows; SI, or with units.",
            {"delta_f": "0 deg"},
        ),
        "instruments": {
            "type": "object",
            "additionalProperties": _reference("Instrument"),
            "description": "Instruments of this recorder, in place of the tables of those names "
            "in the aircraft file.",
        },
        "utc": {
            **_reference("Utc"),
            "description": "A column with the time of day of the world.",
        },
        "decode": {
            "type": "object",
            "additionalProperties": {"anyOf": kinds},
            "description": "Words of a bus or a frame: which bits are which parameter.",
        },
    }


def _table_of_names(part: dict[str, Any], text: str, *examples: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a table whose keys are canonical names."""
    properties = {}
    for name, row in VOCABULARY.items():
        properties[name] = {**part, "description": f"{row.long_name} [{row.units}]"}
    names = "|".join(VOCABULARY)
    # TOML splits engine1.thrust into a table of an engine, unless the key has quotes.
    engine = {"type": "object", "properties": properties, "additionalProperties": False}
    return {
        "type": "object",
        "description": text,
        "examples": list(examples),
        "properties": properties,
        "patternProperties": {
            _ENGINE: engine,
            _NAMED_PARTS: {"type": "object"},
            f"{ITEM.pattern}({names})$": part,
        },
        "additionalProperties": False,
    }


def _allow_text(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of an array that may also be a text."""
    array = {key: schema[key] for key in ("type", "items") if key in schema}
    remainder = {key: item for key, item in schema.items() if key not in array}
    return {**remainder, "anyOf": [array, {"type": "string"}]}
