"""Readers of recordings that other packages add by entry points.

An entry point of the group ``aeromatch.record_readers`` names an object with two functions:

``recognise(path, head)``
    Whether the reader reads this file; ``head`` are its first bytes.
``read(path)``
    A mapping of table names to pandas data frames. The column ``time`` holds the stamps in seconds;
    ``frame.attrs["units"]`` maps columns to units, as far as the file states them.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError, AeromatchWarning, ParseError
from flightmech.plugins import RECORD_READERS, find_plugins, load_plugin
from flighttest.records.readers.recording import RecordedTable, Recording

_CLOCK = "time"


def recognise_foreign(path: str | Path, head: bytes, own: Mapping[str, Any]) -> str:
    """Return the name of the first entry point that reads a file, empty without one.

    Parameters
    ----------
    path : str or Path
    head : bytes
        First bytes of the file.
    own : mapping
        Formats of the product by name, which an entry point cannot replace.

    Warns
    -----
    AeromatchWarning
        An entry point cannot be loaded, or fails while it looks at the file. It is left out, so
        that one broken package does not stop the reading of every recording.
    """
    for name, point in find_plugins(RECORD_READERS, own).items():
        try:
            is_recognised = bool(load_plugin(point).recognise(Path(path), head))
        except AeromatchError as error:
            warnings.warn(f"left out: {error}", AeromatchWarning, stacklevel=2)
            continue
        except Exception as error:
            warnings.warn(
                f"left out: {_failure(name, path, error)}", AeromatchWarning, stacklevel=2
            )
            continue
        if is_recognised:
            return name
    return ""


def read_foreign(path: Path, name: str) -> Recording:
    """Return the tables that the reader of an entry point returns.

    Raises
    ------
    AeromatchError
        The reader fails.
    ParseError
        It returns something else than data frames of numbers with a column ``time``.
    """
    reader = load_plugin(find_plugins(RECORD_READERS)[name])
    try:
        frames = reader.read(path)
    except Exception as error:
        raise _failure(name, path, error) from error
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


def _failure(name: str, path: str | Path, error: Exception) -> AeromatchError:
    return AeromatchError(
        f"the reader {name!r} of another package fails at {path}: {type(error).__name__}: "
        f"{error}; repair or uninstall that package"
    )
