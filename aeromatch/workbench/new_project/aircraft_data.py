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
from flightmech.quantities import number_or_text, parse_quantity
from flightmech.support.toml_quantities import CONFIRM, UNFILLED
from flighttest.records.readers.name_map import latitude_problem

_FILE = "aircraft.toml"
_SI_UNITS = {"deg": "rad"}
# Commas between two digits, commas with a space, and numbers such as 05 behind a decimal comma.
_TIGHT_COMMA, _WIDE_COMMA = re.compile(r"\d,\d"), re.compile(r"\s,|,\s")
_LEADING_ZERO = re.compile(r"[+-]?0\d")


class AircraftValue(NamedTuple):
    """A value of the page.

    Attributes
    ----------
    key : str
        Key of the aircraft file, with dots.
    label : str
    unit : str
        Unit of a number that has none, the SI unit or degrees; empty for a text.
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
    AircraftValue("latitude", "Latitude", "deg", option="--latitude"),
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
        # In the files a number is in rad, on the page in degrees.
        if text and fact.unit == "deg" and isinstance(number_or_text(text), float):
            text = f"{text} rad"
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

    The query has ``values``, a JSON object of keys and texts: a number in the unit of the page or
    with its own unit, three of them with commas or semicolons for a place. ``problem`` is empty, or
    the reason why the result has no commands.
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
        A key is unknown, or a text has another unit.
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
    parts = _split_parts(value, text)
    if len(parts) != value.size:
        raise ActionError(
            f"{value.label}: {text[:60]!r} has {len(parts)} values; write {_form_of(value)}"
        )
    if value.unit == "deg":
        parts = [f"{part} deg" if _is_number(part) else part for part in parts]
    for part in parts:
        try:
            number = parse_quantity(number_or_text(part), _SI_UNITS.get(value.unit, value.unit))
        except UnitError as error:
            raise ActionError(f"{value.label}: {error}") from error
        if not math.isfinite(number):
            raise ActionError(f"{value.label}: {part!r} is not a finite number")
        if value.key == "latitude" and latitude_problem(number):
            raise ActionError(f"{value.label}: {part!r} is not from -90 to 90 deg")
    return parts


def _is_number(part: str) -> bool:
    return isinstance(number_or_text(part), float)


def _split_parts(value: AircraftValue, text: str) -> list[str]:
    """Return the components of a text, between its semicolons or else between its commas.

    Raises
    ------
    ActionError
        A comma may be a decimal one, or a component is empty.
    """
    separator = ";" if ";" in text else ","
    parts = [part.strip() for part in text.split(separator)]
    if _is_decimal_comma(text, parts):
        raise ActionError(
            f"{value.label}: {text[:60]!r} may have a decimal comma; write the decimals with a "
            f"point, and a space behind each comma or semicolon between values"
        )
    if not all(parts):
        raise ActionError(
            f"{value.label}: {text[:60]!r} has an empty value; write {_form_of(value)}"
        )
    return parts


def _is_decimal_comma(text: str, parts: Sequence[str]) -> bool:
    """Return whether a comma of a text may be a decimal one.

    '1,5 m; 0.2 m' and '1,5 m, 0.2 m' are two values, not three; '-0,05,0' has '05' between commas.
    """
    if ";" in text:
        return "," in text
    if any(_LEADING_ZERO.match(part) for part in parts):
        return True
    has_units = not all(_is_number(part) for part in parts)
    return bool(_TIGHT_COMMA.search(text)) and (has_units or bool(_WIDE_COMMA.search(text)))


def _form_of(value: AircraftValue) -> str:
    """Return how a value is written."""
    if value.size == 1:
        form = "one value"
    else:
        form = "three values with commas: forward, right, down"
    return f"{form}, in {value.unit} or each with its unit"


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
