"""Headings of columns that carry a unit: ``Roll Rate (deg/s)``, ``alpha [deg]``, ``Thrust, lbf``,
``Mass_lb``, ``q_deg_s``.

A unit in brackets or behind a comma is not a part of the name.  A unit at the end of the name
itself remains in the name.  It counts if it is a unit of the quantity that the name map reads from
the column: the end of ``V_c`` is not a temperature.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import is_quantity, lookup
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

# name [unit], name (unit), name {unit}
_HEAD = re.compile(r"^(.*\S)\s*[\[({]\s*([^\])}]*?)\s*[\])}]$")
# AOA °, Roll Rate °/s
_DEGREES = re.compile(r"^(.*[A-Za-z0-9])[\s_]*([°º˚]\S*)$")
# name, unit
_COMMA = re.compile(r"^(.*\S)\s*,\s*([^,\s][^,]*)$")
# The time of the three patterns grows with the square of the length. A longer heading has no unit.
_LONGEST_HEADING = 500
_WORDS = re.compile(r"[A-Z]+(?![a-z])\d*|[A-Z]?[a-z]+\d*|\d+|%")
SENSES = {
    *("teu", "ted", "tel", "ter", "lwd", "rwd", "anu", "and"),
    *("nu", "nd", "anl", "anr", "nl", "nr", "lrd", "rrd"),
}
"""Words of a heading for the positive sense of a channel, such as trailing edge up."""
# Words that are units at the end of a heading only, in lower case.
_AT_THE_END = {
    **{"ms": "m/s", "mss": "m/s2", "ms2": "m/s2", "degs": "deg/s", "degsec": "deg/s"},
    **{"rads": "rad/s", "radsec": "rad/s", "rps": "rad/s", "nm": "N m", "kgh": "kg/h"},
    **{"kgs": "kg/s", "lbh": "lb/h", "fts": "ft/s", "ftmin": "ft/min", "c": "degC"},
    **{"f": "degF", "k": "K", "n": "N", "kn": "kN"},
}
# The usual spelling of the letters that ASCII lacks.
_UMLAUTS = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"}
)
_OF_TIME = re.compile(r"^(s|sec|second|min|minute|h|hr|hour)[23]?$")
# Second factors of a product: N m, slug ft2, ft lb.
_IN_PRODUCTS = {"m", "m2", "ft", "ft2", "lb", "lbf", "in", "lbs"}
# Ends that are as often another word: an inlet, a minimum, a reference speed.
_DOUBTFUL = {
    *("in", "min", "ms", "nm", "sm", "nd", "kn", "bar", "none", "mach", "ratio", "fraction"),
    *("bool", "kgs", "gs", "mi", "hr", "mins", "degs", "rps"),
}
# Dimensions of angles, which are numbers too, and of their rates, which are frequencies too.
_AMBIGUOUS_DIMENSIONS = (parse_unit("rad")[0], parse_unit("rad/s")[0])


def split_heading(text: str) -> tuple[str, str]:
    """Return name and unit of a heading.

    The unit is empty if the brackets have none, as in ``xyz[0]`` or ``Elevator (left)``.  The
    brackets behind a canonical name always have a unit, so that an unknown unit is an error.
    ``throttle [1]`` is the dimensionless throttle, ``throttle[1]`` an element of an array.
    """
    if len(text) > _LONGEST_HEADING:
        return text, ""
    match = _HEAD.match(text)
    if match is None:
        match = _COMMA.match(text) or _DEGREES.match(text)
        if match and not match[2].isdigit() and _is_unit(match[2]):
            return match[1], match[2]
        return text, ""
    name, unit = match[1], match[2]
    unit_and_sense = _unit_with_sense(unit)
    if unit_and_sense:
        return f"{name} {unit_and_sense[1]}", unit_and_sense[0]
    if not (_is_unit(unit) or is_quantity(name)):
        return text, ""
    # A number in brackets is an index, except the unit 1 of a canonical name.
    if unit.isdigit() and not (text == f"{name} [1]" and is_quantity(name)):
        return text, ""
    return name, unit


def _unit_with_sense(text: str) -> tuple[str, str] | None:
    """Return unit and sense of brackets with both: ``deg TEU``, ``+TEU, deg``."""
    parts = re.split(r"[\s,;+]+", text.strip(" +"))
    senses = [part for part in parts if part.lower() in SENSES]
    unit = " ".join(part for part in parts if part not in senses)
    if len(senses) == 1 and unit and _is_unit(unit):
        return unit, senses[0]
    return None


def units_at_the_end(words: Sequence[str]) -> list[str]:
    """Return the units that the last words of a heading may mean.

    `words` are in lower case, without separators: ``deg s`` gives deg/s.
    """
    if not words or words[0].isdigit():
        return []
    # German for degree.  In brackets, where a unit is meant, the lower case is refused: it also
    # means gon.
    text = " ".join("deg" if word == "grad" else word for word in words)
    candidates: list[str] = []
    if len(words) == 1:
        candidates = [text, _AT_THE_END.get(text, "")]
    else:
        # deg s, deg per sec, m s 2 are quotients, kg m2 is a product.
        second = "".join(word for word in words[1:] if word != "per")
        if _OF_TIME.match(second):
            candidates = [f"{words[0]}/{second}"]
        elif second in _IN_PRODUCTS:
            candidates = [text]
    return [known_unit(unit) for unit in candidates if unit and _is_unit(unit)]


def _endings(words: Sequence[str]) -> Iterator[list[str]]:
    """Yield the last three, two and one words of a heading; at least one word is the name."""
    for length in (3, 2, 1):
        if length < len(words):
            yield list(words[-length:])


def unit_of_column(table: RecordedTable, column: str, name: str) -> str | None:
    """Return the unit of a column that shows a quantity.

    The unit that the file states has priority over the end of the heading.
    """
    stated = table.units.get(column)
    if stated:
        return stated
    units = lookup(name).units
    dimension = parse_unit(units)[0]
    for ending in _endings(column_words(column)):
        for candidate in units_at_the_end(ending):
            unit = fitted_unit(candidate, units)
            if parse_unit(unit)[0] != dimension:
                continue
            if dimension not in _AMBIGUOUS_DIMENSIONS or unit in recorder_units(name):
                return unit
    return None


def clear_unit(column: str) -> str:
    """Return the unit at the end of a heading if it cannot be another word, else an empty text."""
    for ending in _endings(column_words(column)):
        units = units_at_the_end(ending)
        if units and len(ending) > 1:
            return units[0]
        last = ending[-1]
        if units and last not in _DOUBTFUL and last.isalpha() and len(last) > 1:
            return units[0]
    return ""


def column_words(column: str) -> list[str]:
    """Return the words of a heading in lower case, without its group, index and sense.

    ``adc/ELEV_DEG_TEU`` gives elev and deg.
    """
    heading = column.rpartition("/")[2] or column
    tokens = words_of(re.sub(r"\[\d+\]$", "", heading))
    if len(tokens) > 1 and tokens[-1] in SENSES:
        return tokens[:-1]
    return tokens


def words_of(text: str) -> list[str]:
    """Return the words of a text in lower case, split at separators and capitals.

    A unit such as ``hPa`` or ``kN`` is one word.
    """
    tokens: list[str] = []
    for part in re.split(r"[^0-9A-Za-z%°]+", text.translate(_UMLAUTS)):
        if part.isalpha() and len(part) > 1 and _is_unit(part):
            tokens.append(part)
        else:
            tokens += _WORDS.findall(part)
    return [token.lower() for token in tokens]


def split_headings(texts: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return names and units of the headings of a table.

    Different headings that would share a name keep all of their text.
    """
    parts = [split_heading(text) for text in texts]
    texts_of_name: dict[str, set[str]] = {}
    for (name, _), text in zip(parts, texts, strict=True):
        texts_of_name.setdefault(name, set()).add(text)
    names: list[str] = []
    units: dict[str, str] = {}
    for (name, unit), text in zip(parts, texts, strict=True):
        if len(texts_of_name[name]) > 1:
            names.append(text)
            continue
        names.append(name)
        if unit:
            units[name] = unit
    return names, units


def with_units_of_headings(recording: Recording) -> Recording:
    """Return a recording whose units in headings are units of the columns."""
    for label, table in recording.tables.items():
        names, units = split_headings(list(table.columns))
        loaders = {}
        added = {}
        for name, text in zip(names, table.columns, strict=True):
            # A unit that the file states for the whole heading has priority.
            label_of_column = text
            if name in units and text not in table.units:
                label_of_column = name
                added[name] = units[name]
            loaders[label_of_column] = partial(table.columns.__getitem__, text)
        if added:
            recording.tables[label] = table._replace(
                columns=Columns(loaders), units={**table.units, **added}
            )
    return recording


def column_called(requested: str, table: RecordedTable) -> str | None:
    """Return the column of a table that a name map means.

    The name map may give the name of the column, or its heading with or without the brackets.
    """
    if requested in table.columns:
        return requested
    name, unit = split_heading(requested)
    if unit and name in table.columns and table.units.get(name, unit) == unit:
        return name
    columns = []
    for text in table.columns:
        match = _HEAD.match(text) if len(text) <= _LONGEST_HEADING else None
        # A number in brackets is the index of an array.
        if match and match[1] == requested and not match[2].isdigit():
            columns.append(text)
    return columns[0] if len(columns) == 1 else None


def _is_unit(text: str) -> bool:
    try:
        parse_unit(text)
    except UnitError:
        return False
    return True


def locate_column(
    recording: Recording, requested: str, path: str | Path, required: bool = True
) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Return stamps [s], recorded values and unit of a column.

    Parameters
    ----------
    recording : Recording
    requested : str
        ``COLUMN`` or ``TABLE/COLUMN``.  ``[unit]`` behind it has priority over the unit of the
        file.
    path : str or Path
        For the text of the error.
    required : bool
        Whether a missing column is an error.  Otherwise the result is None.

    Raises
    ------
    UnknownName
        The column does not exist, or several tables have it.
    SchemaError
        Its table has no clock.
    """
    name, _, unit = requested.partition("[")
    name, unit = name.strip(), unit.strip().rstrip("]").strip()
    leaf, _, heading = name.rpartition("/")
    candidates = []
    for label, table in recording.tables.items():
        # Without a table in the request, any table may have the column.
        column = heading if leaf else name
        if leaf in ("", label) and column in table.columns:
            candidates.append((label, column))
    if not candidates:
        if not required:
            return None
        allowed = _column_names(recording)
        raise UnknownName(name, allowed, what="column", hint=f"{path} does not have it")
    if len(candidates) > 1:
        raise UnknownName(
            name,
            [f"{label}/{column}" for label, column in candidates],
            what="column",
            hint=f"{path} has it in several tables; name the table",
        )
    label, column = candidates[0]
    table = recording.tables[label]
    values = np.asarray(table.columns[column], float)
    time = _stamps(table, path)
    is_finite = np.isfinite(time)
    return time[is_finite], values[is_finite], unit or table.units.get(column, "")


def _column_names(recording: Recording) -> list[str]:
    """Return the columns of a recording, with their tables if there are several."""
    names: list[str] = []
    for label, table in recording.tables.items():
        if len(recording.tables) > 1:
            names += [f"{label}/{column}" for column in table.columns]
        else:
            names += table.columns
    return names


def _stamps(table: RecordedTable, path: str | Path) -> np.ndarray:
    """Return the stamps of a table. [s]"""
    if table.time is not None:
        return np.asarray(table.time, float)
    name = clock_name(table.columns)
    if name is None:
        raise SchemaError(
            str(path), [f"no clock; expected a column {', '.join(CLOCK_NAMES)} in seconds"]
        )
    unit = table.units.get(name, "s")
    stamps = np.asarray(to_si(np.asarray(table.columns[name], float), unit, "s"))
    # A time of day may be written as hhmmss.
    seconds = seconds_of_digits(stamps)
    return stamps if seconds is None else seconds
