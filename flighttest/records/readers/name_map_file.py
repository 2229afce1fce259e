"""JSON schema of name maps, for editors: the tables that the reader knows, and the vocabulary in
every other one.
"""

from __future__ import annotations

from typing import Any

from flightmech.names import ITEM, VOCABULARY
from flightmech.support.toml_models import DIALECT, part_schema
from flighttest.records.readers.bus_words import KINDS
from flighttest.records.readers.name_map import TOP, Channel, Clock, Facts, Utc
from flighttest.records.sensors.instruments import Instrument

_ENGINE = r"^engine[1-9]\d*$"
_MODELS = {"Channel": Channel, "Clock": Clock, "Facts": Facts, "Utc": Utc, "Instrument": Instrument}


def name_map_schema() -> dict[str, Any]:
    """Return the schema (JSON Schema 2020-12) of name maps.

    It knows every key with its description and unit and every canonical name; units that do not
    fit, columns shown twice and calibrations without a unit the reader alone finds.
    """
    models: dict[str, Any] = {
        **_MODELS,
        **{f"decode_{kind}": model for kind, model in KINDS.items()},
    }
    definitions = {name: part_schema(model) for name, model in models.items()}
    inner = {
        name: part
        for schema in definitions.values()
        for name, part in schema.pop("$defs", {}).items()
    }
    _also(definitions["Channel"]["properties"]["table"], {"type": "string"})
    column = definitions["Channel"]["properties"]["column"]["anyOf"]
    definitions["channel"] = {"anyOf": [*column, {"$ref": "#/$defs/Channel"}]}
    definitions["leaf"] = _by_name(
        {"$ref": "#/$defs/channel"}, "channels of one time base: canonical name = column"
    )
    parts = _parts()
    return {
        "$schema": DIALECT,
        "description": "A name map: which column of a recording is which quantity, in which unit "
        "and sign, over which clock.",
        "type": "object",
        "properties": {key: parts[key] for key in TOP},
        "additionalProperties": {"$ref": "#/$defs/leaf"},
        "$defs": {**inner, **definitions},
    }


def _parts() -> dict[str, Any]:
    """Return the schemas of the keys that are not tables of channels."""
    kinds = [{"$ref": f"#/$defs/decode_{kind}"} for kind in KINDS]
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
            "additionalProperties": {"$ref": "#/$defs/Clock"},
            "description": "The clock of the file; [time.NAME] for one table of it.",
        },
        "record": {"$ref": "#/$defs/Facts", "description": "Facts that the file does not state."},
        "constants": _by_name(
            {"type": ["number", "string"]},
            "Channels that no column shows; SI, or with units.",
            {"delta_f": "0 deg"},
        ),
        "instruments": {
            "type": "object",
            "additionalProperties": {"$ref": "#/$defs/Instrument"},
            "description": "Instruments of this recorder, in place of the tables of those names "
            "in the aircraft file.",
        },
        "utc": {
            "$ref": "#/$defs/Utc",
            "description": "A column with the time of day of the world.",
        },
        "decode": {
            "type": "object",
            "additionalProperties": {"anyOf": kinds},
            "description": "Words of a bus or a frame: which bits are which parameter.",
        },
    }


def _by_name(part: dict[str, Any], text: str, *examples: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a table whose keys are canonical names."""
    own = {
        name: {**part, "description": f"{row.long_name} [{row.units}]"}
        for name, row in VOCABULARY.items()
    }
    names = "|".join(VOCABULARY)
    return {
        "type": "object",
        "description": text,
        "examples": list(examples),
        "properties": own,
        "patternProperties": {
            _ENGINE: {"type": "object", "properties": own, "additionalProperties": False},
            f"{ITEM.pattern}({names})$": part,
        },
        "additionalProperties": False,
    }


def _also(place: dict[str, Any], other: dict[str, Any]) -> None:
    """Let a key be of another kind too."""
    kinds = {key: place.pop(key) for key in ("type", "items") if key in place}
    place["anyOf"] = [kinds, other]
