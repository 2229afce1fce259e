"""Readers of recordings that other packages add by entry points.

An entry point of the group ``aeromatch.record_readers`` names an object with two functions:

``recognise(path, head)``
    Whether the reader reads this file; ``head`` are its first bytes.
``read(path)``
    A mapping of table names to pandas data frames. The column ``time`` holds the stamps in seconds;
    ``frame.attrs["units"]`` maps columns to units, as far as the file states them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.plugins import RECORD_READERS, read_by_plugin
from flighttest.records.readers.recording import RecordedTable, Recording

_CLOCK = "time"


def read_foreign(path: Path, name: str) -> Recording:
    """Return the tables that the reader of an entry point returns.

    Raises
    ------
    AeromatchError
        The reader fails.
    ParseError
        It returns something else than data frames of numbers with a column ``time``.
    """
    frames = read_by_plugin(RECORD_READERS, name, path)
    if not isinstance(frames, Mapping) or not frames:
        raise ParseError(
            str(path),
            0,
            f"{type(frames).__name__} from the reader {name!r}",
            "a mapping of table names to pandas data frames",
        )
    tables = {str(key): _table_of(frame, str(key), name, path) for key, frame in frames.items()}
    return Recording(name, tables)


def _table_of(frame: Any, key: str, name: str, path: Path) -> RecordedTable:
    """Return a data frame as a table of a recording."""
    columns = [str(column) for column in getattr(frame, "columns", ())]
    if _CLOCK not in columns:
        raise ParseError(
            str(path),
            0,
            f"the table {key!r} of the reader {name!r} with columns {', '.join(columns) or 'none'}",
            f"a data frame with a column {_CLOCK!r} in seconds",
        )
    arrays = {column: frame[column].to_numpy() for column in columns}
    time = np.asarray(arrays.pop(_CLOCK), float)
    units = {str(column): str(unit) for column, unit in frame.attrs.get("units", {}).items()}
    return RecordedTable(arrays, units, time)
