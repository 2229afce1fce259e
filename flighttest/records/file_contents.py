"""What a file holds before anybody has mapped it: tables, clocks, columns and units, for writing a name map."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError

from ..readers.clocks import Clocks
from ..readers.headings import clear_unit
from ..readers.name_map import NameMap, read_names
from ..readers.opening import FORMATS, open_recording, recognise
from ..readers.recording import Recording
from ..readers.stamps import Settled
from ..signals.blank_cells import clocks_of_rows


def contents(path: str | Path, names: str | Path | NameMap | None = None) -> dict[str, Any]:
    """Return what a recording holds.

    Parameters
    ----------
    path : str or Path
        A file of any known format.
    names : str, Path or NameMap, optional
        Its clocks and ``[decode]`` tables are used; channels need not be mapped.

    Returns
    -------
    dict
        ``file``, ``format``, ``facts``, ``notes`` (faults that the file reports), ``tables``: per table ``table``, ``samples``,
        ``rate`` [Hz], ``start`` and ``stop`` [s], ``clock_fault`` (a text, empty when the clock is sound) and ``columns``, each
        ``column``, ``unit``, ``min`` and ``max`` in the unit of the file, and ``slower``: columns with blanks between the samples of a
        slower clock, each ``columns``, ``rate`` [Hz] and ``samples``.  For Chapter 10 also ``channels``.  ``left_out``: what is in
        the file and not in the tables, each ``name`` and ``reason``.

    Raises
    ------
    ParseError
        The file is damaged or of no known format.
    """
    path = Path(path)
    mapping = names if isinstance(names, NameMap) else read_names(names) if names is not None else NameMap({})
    kind = recognise(path)
    found: dict[str, Any] = {"file": path.name, "format": FORMATS[kind][1], "facts": {}, "notes": [], "tables": [], "left_out": []}
    if kind == "chapter10":
        from ..readers.formats.chapter10.packets import index
        from ..readers.formats.chapter10.tables import channels

        file = index(path)
        found.update(channels=channels(file), notes=list(file.notes))
        if not mapping.decode:
            return found
    everything = NameMap({}, mapping.clock, mapping.facts, mapping.source, mapping.clocks, None, mapping.decode)
    return {**found, **contents_of(open_recording(path, everything, kind), everything, path)}


def contents_of(recording: Recording, everything: NameMap, path: Path) -> dict[str, Any]:
    """Return ``facts``, ``notes``, ``tables`` and ``left_out`` of `contents` of what has been read."""
    clocks = Clocks(recording.tables, everything, path.name, recording.left_out)
    tables = clocks.with_decoded_words()
    return {
        "facts": {key: value for key, value in recording.facts.items() if isinstance(value, str | int | float)},
        "notes": [*recording.notes, *clocks.notes],
        "tables": [_table(name, clocks) for name in tables],
        "left_out": [{"name": one.place, "reason": one.reason} for one in recording.left_out],
    }


def _table(name: str, clocks: Clocks) -> dict[str, Any]:
    table = clocks.tables[name]
    about: dict[str, Any] = {"table": name, "samples": 0, "rate": None, "start": None, "stop": None, "clock_fault": "", "slower": []}
    try:
        clock = clocks.settled(name, f"{clocks.file}, table {name}")
        about.update(samples=len(clock.time), rate=clock.about["rate"], start=float(clock.time[0]), stop=float(clock.time[-1]))
    except AeromatchError as error:
        about["clock_fault"] = str(error)
    else:
        about["slower"] = _slower(table.columns, clock)
    about["columns"] = [_column(column, table.columns[column], table.units.get(column) or clear_unit(column)) for column in table.columns]
    return about


def _slower(columns: Mapping[str, np.ndarray], clock: Settled) -> list[dict[str, Any]]:
    """Return the columns whose samples form a slower clock than the rows, with rate [Hz] and number of the samples."""
    values = {name: np.asarray(column, float)[clock.keep] for name, column in columns.items()}
    found = []
    for rows, names in clocks_of_rows(clock.time, values):
        if rows is not None:
            rate = 1.0 / float(np.median(np.diff(clock.time[rows])))
            found.append({"columns": names, "rate": rate, "samples": int(rows.sum())})
    return found


def _column(name: str, values: np.ndarray, unit: str) -> dict[str, Any]:
    values = np.asarray(values, float)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    return {"column": name, "unit": unit, "min": low, "max": high}
