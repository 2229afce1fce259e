"""Columns of a recording by their own names, for logs that have nothing to do with the names of a flight record."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.units import to_si

from .recording import CLOCK_NAMES, Recording, Table, clock_name


def located(recording: Recording, wanted: str, path: str | Path, required: bool = True) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Return stamps [s], values as recorded and unit of a column, or None where it is not there and not required.

    Parameters
    ----------
    recording : Recording
    wanted : str
        ``COLUMN``, ``TABLE/COLUMN``, each with ``[unit]`` behind it where the file states none or another.
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
            allowed = [f"{key}/{one}" if several else one for key, table in tables.items() for one in table.columns]
            raise UnknownName(name, allowed, "column", f"{path} does not have it")
        return None
    if len(places) > 1:
        raise UnknownName(name, [f"{key}/{one}" for key, one in places], "column", f"{path} has it in several tables; name the table")
    key, one = places[0]
    table = tables[key]
    values = np.asarray(table.columns[one], float)
    time = _stamps(table, path)
    good = np.isfinite(time)
    return time[good], values[good], unit or table.units.get(one, "")


def _stamps(table: Table, path: str | Path) -> np.ndarray:
    if table.time is not None:
        return np.asarray(table.time, float)
    name = clock_name(table.columns)
    if name is None:
        raise SchemaError(str(path), [f"no clock; expected a column {', '.join(CLOCK_NAMES)} in seconds"])
    unit = table.units.get(name, "s")
    return np.asarray(to_si(np.asarray(table.columns[name], float), unit, "s"))
