"""Values of a drafted aircraft file that its author gives or confirms, and facts of the records."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError

from aeromatch.drafting.previous import DRAFT_FOLDER, read_answers
from aeromatch.workbench.allowed_actions import PROJECT, ActionError
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import UnitError
from flightmech.support.toml_quantities import CONFIRM, UNFILLED
from flightmech.units import number_or_text, parse_quantity

_FILE = "aircraft.toml"


class AircraftValue(NamedTuple):
    """A value of the page.

    Attributes
    ----------
    key : str
        Key of the aircraft file, with dots.
    label : str
    unit : str
        SI unit; empty for a text.
    size : int
        Number of components.
    option : str
        Option of ``aeromatch init`` that gives the value; empty without one.
    """

    key: str
    label: str
    unit: str
    size: int = 1
    option: str = ""


_VALUES = (
    AircraftValue("name", "Name of the aircraft", "", option="--name"),
    AircraftValue("S", "Reference area S", "m2"),
    AircraftValue("cbar", "Reference chord cbar", "m"),
    AircraftValue("b", "Reference span b", "m"),
    AircraftValue("reference", "Moment reference point, from the drawing datum", "m", 3),
    AircraftValue("mass", "Gross mass", "kg", option="--mass"),
    AircraftValue("Ixx", "Moment of inertia in roll, Ixx", "kg m2", option="--Ixx"),
    AircraftValue("Iyy", "Moment of inertia in pitch, Iyy", "kg m2", option="--Iyy"),
    AircraftValue("Izz", "Moment of inertia in yaw, Izz", "kg m2", option="--Izz"),
    AircraftValue("Ixz", "Product of inertia Ixz", "kg m2", option="--Ixz"),
    AircraftValue("cg", "Centre of gravity, from the moment reference point", "m", 3, "--cg"),
)
_IMU = AircraftValue(
    "instruments.imu.position",
    "Inertial unit, from the moment reference point",
    "m",
    3,
    "--imu",
)
_FACTS = (
    AircraftValue("temperature", "Outside air temperature", "K", option="--temperature"),
    AircraftValue("latitude", "Latitude", "rad", option="--latitude"),
    AircraftValue("runway_elevation", "Runway elevation", "m", option="--runway-elevation"),
)


def aircraft_rows(folder: Path) -> list[dict[str, Any]]:
    """Return the values of the aircraft file of a folder; none without a file that can be read.

    A row has ``key label unit size``, the ``text`` as in the file, the ``source`` from the comment
    behind it, and ``open``: the author has to give or to confirm it.
    """
    document = _read_toml(folder / _FILE)
    rows = []
    for value in _values_of(document):
        item = _item_at(document, value.key)
        comment = "" if item is None or item is document else item.trivia.comment
        plain = item.unwrap() if item is not None else None
        row = value._asdict() | {
            "text": _text_of(plain),
            "source": comment.removeprefix("#").strip(),
            "open": plain == UNFILLED or CONFIRM in comment,
        }
        rows.append(row)
    return rows


def fact_rows(folder: Path) -> list[dict[str, Any]]:
    """Return the facts of the recordings in the name map of a folder, in the form of the rows of
    `aircraft_rows`.
    """
    record = _read_toml(folder / "names.toml").get("record", {})
    answers = read_answers(folder).facts.values
    rows = []
    for fact in _FACTS:
        text = _text_of(record.get(fact.key)) or str(answers.get(fact.key, ""))
        rows.append(fact._asdict() | {"text": text, "source": "", "open": False})
    return rows


def _values_of(document: Mapping[str, Any]) -> list[AircraftValue]:
    """Return the values that an aircraft file has or must have."""
    if not document:
        return []
    values = list(_VALUES)
    for number in range(len(document.get("engine", ()))):
        label = f"Engine {number + 1}: where the thrust acts, from the moment reference point"
        values.append(AircraftValue(f"engine.{number}.position", label, "m", 3))
    for name in document.get("instruments", {}):
        if name == "imu":
            values.append(_IMU)
        elif "position" in document["instruments"][name]:
            label = f"{name.replace('_', ' ').capitalize()}, from the moment reference point"
            values.append(AircraftValue(f"instruments.{name}.position", label, "m", 3))
    return values


def _read_toml(file: Path) -> Any:
    """Return the content of a file with its comments; empty if it cannot be read."""
    try:
        return tomlkit.parse(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, TOMLKitError):
        return tomlkit.document()


def _item_at(document: Any, key: str) -> Any:
    item = document
    for part in key.split("."):
        try:
            item = item[int(part)] if part.isdecimal() else item[part]
        except (KeyError, IndexError, TypeError):
            return None
    return item


def _text_of(plain: Any) -> str:
    """Return a value as its author types it; a placeholder is empty."""
    if plain is None or plain == UNFILLED:
        return ""
    if isinstance(plain, list):
        return ", ".join(_text_of(item) for item in plain)
    return plain if isinstance(plain, str) else f"{plain:.10g}"


def give_values(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the commands that write values: `set`, then one `init` that also checks them.

    The query has ``values``, a JSON object of keys and texts: a number in the SI unit or with its
    own unit, three of them with commas for a place. ``problem`` is empty, or states why there are
    no commands.
    """
    try:
        return {
            "commands": _commands_of(opened.file.parent, query.get("values", "")),
            "problem": "",
        }
    except ActionError as error:
        return {"commands": [], "problem": str(error)}


def _commands_of(folder: Path, given: str) -> list[list[str]]:
    """Return the commands for a JSON object of keys and texts.

    Raises
    ------
    ActionError
        There is no such value, or the text has another unit.
    """
    document = _read_toml(folder / _FILE)
    values = {value.key: value for value in (*_values_of(document), *_FACTS)}
    changes: list[list[str]] = []
    options: list[str] = []
    for key, text in _parse_texts(given).items():
        if key not in values:
            raise ActionError(f"no value {key[:40]!r}; there are: {', '.join(values)}")
        value = values[key]
        parts = _parse_parts(value, text)
        if value.option and (value in _FACTS or _is_drafted(folder, document, key)):
            options += [value.option, *parts]
        else:
            content = _toml_text(parts) if value.unit else tomlkit.item(parts[0]).as_string()
            changes.append(["set", f"{PROJECT}/{_FILE}", key, content])
    return [*changes, ["init", PROJECT, *options, "--json"]]


def _parse_texts(given: str) -> dict[str, str]:
    try:
        texts = json.loads(given)
    except (ValueError, RecursionError):
        texts = None
    if not isinstance(texts, dict) or not all(isinstance(text, str) for text in texts.values()):
        raise ActionError(f"{given[:40]!r} is not an object of keys and texts")
    return texts


def _parse_parts(value: AircraftValue, text: str) -> list[str]:
    """Return the components of a text, each checked for its unit."""
    if not value.unit:
        if not text.strip():
            raise ActionError(f"{value.label}: write a name")
        return [text.strip()]
    parts = [part for part in re.split(r"\s*[,;]\s*", text.strip()) if part]
    if len(parts) != value.size:
        form = "one value" if value.size == 1 else "three values with commas: forward, right, down"
        raise ActionError(
            f"{value.label}: {text[:60]!r} has {len(parts)} values; write {form}, in "
            f"{value.unit} or each with its unit"
        )
    for part in parts:
        try:
            number = parse_quantity(number_or_text(part), value.unit)
        except UnitError as error:
            raise ActionError(f"{value.label}: {error}") from error
        if not math.isfinite(number):
            raise ActionError(f"{value.label}: {part!r} is not a finite number")
    return parts


def _toml_text(parts: Sequence[str]) -> str:
    """Return one or three quantities as a value of TOML."""
    items = [number_or_text(part) for part in parts]
    return tomlkit.item(items[0] if len(items) == 1 else items).as_string()


def _is_drafted(folder: Path, document: Any, key: str) -> bool:
    """Return whether a value is that of the last draft, so that an option of `init` changes it."""
    before = _read_toml(folder / DRAFT_FOLDER / _FILE)
    return bool(before) and _plain_at(before, key) == _plain_at(document, key)


def _plain_at(document: Any, key: str) -> Any:
    item = _item_at(document, key)
    return None if item is None else item.unwrap()


ROUTES = {("GET", "/api/new/values"): give_values}
"""Requests of the form of aircraft data, in the form of `records.ROUTES`."""
