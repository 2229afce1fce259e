"""Headings of columns that carry a unit in brackets: ``Roll Rate (deg/s)``, ``alpha [deg]``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial

from flightmech.errors import UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import parse

from .name_map import known_unit
from .recording import Columns, Recording, Table

_HEAD = re.compile(r"^(.*\S)\s*[\[(]\s*([^\])]*?)\s*[\])]$")


def split_heading(text: str) -> tuple[str, str]:
    """Return name and unit of a heading; no unit where the brackets hold none, as in ``xyz[0]`` or ``Elevator (left)``.

    What stands behind a canonical name is taken for its unit, so that an unknown one is an error of its own; ``throttle [1]`` is the
    dimensionless throttle, ``throttle[1]`` an element of an array.
    """
    match = _HEAD.match(text)
    if match is None or not (_is_unit(match[2]) or _is_canonical(match[1])):
        return text, ""
    if match[2].isdigit() and not (text == f"{match[1]} [1]" and _is_canonical(match[1])):  # an index
        return text, ""
    return match[1], match[2]


def split_headings(texts: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return names and units of the headings of a table; headings that would share a name keep all of their text."""
    parts = [split_heading(text) for text in texts]
    short = [name for name, _ in parts]
    names = [name if short.count(name) == 1 else text for (name, _), text in zip(parts, texts, strict=True)]
    return names, {name: unit for (name, unit), own in zip(parts, names, strict=True) if unit and name == own}


def with_units_of_headings(recording: Recording) -> Recording:
    """Return a recording whose columns are named without the unit in brackets, which becomes their unit."""
    for label, table in recording.tables.items():
        names, units = split_headings(list(table.columns))
        stated = {name: text for name, text in zip(names, table.columns, strict=True) if name in units and text not in table.units}
        if not stated:
            continue
        columns = {(name if name in stated else text): text for name, text in zip(names, table.columns, strict=True)}
        loaders = {name: partial(table.columns.__getitem__, text) for name, text in columns.items()}
        added = {name: units[name] for name in stated}
        recording.tables[label] = Table(Columns(loaders), {**table.units, **added}, table.time, table.flags)
    return recording


def column_called(wanted: str, table: Table) -> str | None:
    """Return the column of a table that a name map means: by its name, or by its heading with or without what stands in brackets."""
    if wanted in table.columns:
        return wanted
    name, unit = split_heading(wanted)
    if unit and name in table.columns and table.units.get(name, unit) == unit:
        return name
    found = [text for text in table.columns if (match := _HEAD.match(text)) and match[1] == wanted and not match[2].isdigit()]
    return found[0] if len(found) == 1 else None


def _is_unit(text: str) -> bool:
    try:
        parse(known_unit(text))
    except UnitError:
        return text in ("us", "µs", "ns")
    return True


def _is_canonical(name: str) -> bool:
    try:
        return bool(lookup(name))
    except UnknownName:
        return False
