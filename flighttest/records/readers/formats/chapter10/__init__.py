"""IRIG 106 Chapter 10 recordings, with a module for packets, time and each kind of data."""

from __future__ import annotations

from pathlib import Path

from flighttest.records.readers.formats.chapter10.tables import read_chapter10_tables as read_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording


def read(path: Path, names: NameMap) -> Recording:
    """Return the parameters that ``[decode]`` of the name map defines.

    See `tables.read_chapter10_tables`.
    """

    return read_tables(path, names)
