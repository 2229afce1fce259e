"""Headings of columns that carry a unit: ``Roll Rate (deg/s)``, ``alpha [deg]``, ``Thrust, lbf``,
``Mass_lb``, ``q_deg_s``.

A unit in brackets or behind a comma is not a part of the name.  A unit at the end of the name
itself remains there, and counts where it is one of the quantity that the name map reads from the
column: the end of ``V_c`` is not a temperature.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import fitted_unit, known_unit, parse_unit, to_si
from flighttest.records.readers.channel_correction import recorder_units
from flighttest.records.readers.recording import (
    CLOCK_NAMES,
    Columns,
    RecordedTable,
    Recording,
    clock_name,
)
from flighttest.records.readers.times_of_day import seconds_of_digits

_HEAD = re.compile(r"^(.*\S)\s*[\[({]\s*([^\])}]*?)\s*[\])}]$")
_DEGREES = re.compile(r"^(.*[A-Za-z0-9])[\s_]*([°º˚]\S*)$")  # AOA °, Roll Rate °/s
_COMMA = re.compile(r"^(.*\S)\s*,\s*([^,\s][^,]*)$")
_WORDS = re.compile(r"[A-Z]+(?![a-z])\d*|[A-Z]?[a-z]+\d*|\d+|%")
SENSES = {
    "teu",
    "ted",
    "tel",
    "ter",
    "lwd",
    "rwd",
    "anu",
    "and",
    "nu",
    "nd",
    "anl",
    "anr",
    "nl",
    "nr",
}
"""Words of a heading for the positive sense of a channel, such as trailing edge up."""
# words that are units at the end of a heading only, in lower case
_AT_THE_END = {
    "ms": "m/s", "mss": "m/s2", "ms2": "m/s2", "degs": "deg/s", "degsec": "deg/s", "rads": "rad/s", "radsec": "rad/s", "rps": "rad/s",
    "nm": "N m", "kgh": "kg/h", "kgs": "kg/s", "lbh": "lb/h", "fts": "ft/s", "ftmin": "ft/min", "c": "degC", "f": "degF", "k": "K",
    "n": "N", "kn": "kN",
}  # fmt: skip
_OF_TIME = re.compile(r"^(s|sec|second|min|minute|h|hr|hour)[23]?$")
_IN_PRODUCTS = {"m", "m2", "ft", "ft2", "lb", "lbf", "in", "lbs"}  # N m, slug ft2, ft lb
# ends that are as often another word: an inlet, a minimum, a reference speed
_DOUBTFUL = {
    "in", "min", "ms", "nm", "sm", "nd", "kn", "bar", "none", "mach", "ratio", "fraction", "bool", "kgs", "gs", "mi", "hr", "mins", "degs",
    "rps",
}  # fmt: skip


def split_heading(text: str) -> tuple[str, str]:
    """Return name and unit of a heading; no unit where the brackets hold none, as in ``xyz[0]`` or
    ``Elevator (left)``.

    What stands behind a canonical name is taken for its unit, so that an unknown one is an error of
    its own; ``throttle [1]`` is the dimensionless throttle, ``throttle[1]`` an element of an array.
    """
    match = _HEAD.match(text)
    if match is None:
        match = _COMMA.match(text) or _DEGREES.match(text)
        return (
            (match[1], match[2])
            if match and not match[2].isdigit() and _is_unit(match[2])
            else (text, "")
        )
    if sense := _unit_with_sense(match[2]):
        return f"{match[1]} {sense[1]}", sense[0]
    if not (_is_unit(match[2]) or _is_canonical(match[1])):
        return text, ""
    if match[2].isdigit() and not (
        text == f"{match[1]} [1]" and _is_canonical(match[1])
    ):  # an index
        return text, ""
    return match[1], match[2]


def _unit_with_sense(text: str) -> tuple[str, str] | None:
    """Return unit and sense of brackets that hold both: ``deg TEU``, ``+TEU, deg``."""
    words = re.split(r"[\s,;+]+", text.strip(" +"))
    senses = [word for word in words if word.lower() in SENSES]
    unit = " ".join(word for word in words if word not in senses)
    return (unit, senses[0]) if len(senses) == 1 and unit and _is_unit(unit) else None


def units_at_the_end(words: Sequence[str]) -> list[str]:
    """Return the units that the last words of a heading may mean, in lower case without what
    separates them: ``deg s`` -> deg/s.
    """
    if not words or words[0].isdigit():
        return []
    text = " ".join(words)
    if len(words) == 1:
        candidates = [text, _AT_THE_END.get(text, "")]
    else:  # deg s, deg per sec, m s 2, kg m2
        first, rest = words[0], "".join(word for word in words[1:] if word != "per")
        candidates = (
            [f"{first}/{rest}"] if _OF_TIME.match(rest) else [text] if rest in _IN_PRODUCTS else []
        )
    return [known_unit(unit) for unit in candidates if unit and _is_unit(unit)]


def unit_of_column(table: RecordedTable, column: str, name: str) -> str | None:
    """Return the unit of a column that shows a quantity: as the file states it, else by the end of
    its heading.
    """
    if stated := table.units.get(column):
        return stated
    wanted = lookup(name).units
    words = column_words(column)
    for length in (3, 2, 1):
        for unit in units_at_the_end(words[-length:]) if length < len(words) else []:
            unit = fitted_unit(unit, wanted)
            plain = parse_unit(unit)[0] in (
                (0, 0, 0, 0),
                (0, 0, -1, 0),
            )  # angles are numbers too, and rates of angles frequencies
            if parse_unit(unit)[0] == parse_unit(wanted)[0] and (
                not plain or unit in recorder_units(name)
            ):
                return unit
    return None


def clear_unit(column: str) -> str:
    """Return the unit at the end of a heading where it can be nothing else, whatever the column
    shows; empty without one.
    """
    words = column_words(column)
    for length in (3, 2, 1):
        units = units_at_the_end(words[-length:]) if length < len(words) else []
        if units and length > 1:
            return units[0]
        if units and words[-1] not in _DOUBTFUL and words[-1].isalpha() and len(words[-1]) > 1:
            return units[0]
    return ""


def column_words(column: str) -> list[str]:
    """Return the words of a heading in lower case, without its group, index and sense:
    ``adc/ELEV_DEG_TEU`` -> elev deg.
    """
    words = words_of(re.sub(r"\[\d+\]$", "", column.rpartition("/")[2] or column))
    return words[:-1] if len(words) > 1 and words[-1] in SENSES else words


def words_of(text: str) -> list[str]:
    """Return the words of a text in lower case, split at separators and capitals; a unit such as
    ``hPa`` or ``kN`` is one word.
    """
    words: list[str] = []
    for part in re.split(r"[^0-9A-Za-z%°]+", text):
        whole = part.isalpha() and len(part) > 1 and _is_unit(part)
        words += [part] if whole else _WORDS.findall(part)
    return [word.lower() for word in words]


def split_headings(texts: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return names and units of the headings of a table; different headings that would share a name
    keep all of their text.
    """
    parts = [split_heading(text) for text in texts]
    written: dict[str, set[str]] = {}
    for (name, _), text in zip(parts, texts, strict=True):
        written.setdefault(name, set()).add(text)
    names = [
        name if len(written[name]) == 1 else text
        for (name, _), text in zip(parts, texts, strict=True)
    ]
    return names, {
        name: unit for (name, unit), own in zip(parts, names, strict=True) if unit and name == own
    }


def with_units_of_headings(recording: Recording) -> Recording:
    """Return a recording whose columns are named without the unit in brackets, which becomes their
    unit.
    """
    for label, table in recording.tables.items():
        names, units = split_headings(list(table.columns))
        stated = {
            name: text
            for name, text in zip(names, table.columns, strict=True)
            if name in units and text not in table.units
        }
        if not stated:
            continue
        columns = {
            (name if name in stated else text): text
            for name, text in zip(names, table.columns, strict=True)
        }
        loaders = {name: partial(table.columns.__getitem__, text) for name, text in columns.items()}
        added = {name: units[name] for name in stated}
        recording.tables[label] = table._replace(
            columns=Columns(loaders), units={**table.units, **added}
        )
    return recording


def column_called(wanted: str, table: RecordedTable) -> str | None:
    """Return the column of a table that a name map means: by its name, or by its heading with or
    without what stands in brackets.
    """
    if wanted in table.columns:
        return wanted
    name, unit = split_heading(wanted)
    if unit and name in table.columns and table.units.get(name, unit) == unit:
        return name
    found = [
        text
        for text in table.columns
        if (match := _HEAD.match(text)) and match[1] == wanted and not match[2].isdigit()
    ]
    return found[0] if len(found) == 1 else None


def _is_unit(text: str) -> bool:
    try:
        parse_unit(text)
    except UnitError:
        return False
    return True


def _is_canonical(name: str) -> bool:
    try:
        return bool(lookup(name))
    except UnknownName:
        return False


def locate_column(
    recording: Recording, wanted: str, path: str | Path, required: bool = True
) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Return stamps [s], values as recorded and unit of a column, or None where it is not there and
    not required.

    Parameters
    ----------
    recording : Recording
    wanted : str
        ``COLUMN``, ``TABLE/COLUMN``, each with ``[unit]`` behind it where the file states none or
        another.
    path : str or Path
        For the text of the error.
    required : bool
        Whether a missing column is an error.

    Raises
    ------
    UnknownName
        No such column, or several tables have it.
    SchemaError
        Its table has no clock.
    """
    name, _, unit = wanted.partition("[")
    name, unit = name.strip(), unit.strip().rstrip("]").strip()
    leaf, _, column = name.rpartition("/")
    tables = recording.tables
    places = [(key, column if leaf else name) for key in tables if leaf in ("", key)]
    places = [(key, one) for key, one in places if one in tables[key].columns]
    if not places:
        if required:
            several = len(tables) > 1
            allowed = [
                f"{key}/{one}" if several else one
                for key, table in tables.items()
                for one in table.columns
            ]
            raise UnknownName(name, allowed, "column", f"{path} does not have it")
        return None
    if len(places) > 1:
        raise UnknownName(
            name,
            [f"{key}/{one}" for key, one in places],
            "column",
            f"{path} has it in several tables; name the table",
        )
    key, one = places[0]
    table = tables[key]
    values = np.asarray(table.columns[one], float)
    time = _stamps(table, path)
    good = np.isfinite(time)
    return time[good], values[good], unit or table.units.get(one, "")


def _stamps(table: RecordedTable, path: str | Path) -> np.ndarray:
    if table.time is not None:
        return np.asarray(table.time, float)
    name = clock_name(table.columns)
    if name is None:
        raise SchemaError(
            str(path), [f"no clock; expected a column {', '.join(CLOCK_NAMES)} in seconds"]
        )
    unit = table.units.get(name, "s")
    stamps = np.asarray(to_si(np.asarray(table.columns[name], float), unit, "s"))
    seconds = seconds_of_digits(stamps)
    return stamps if seconds is None else seconds
