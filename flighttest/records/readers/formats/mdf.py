"""Measurement data format (MDF 3 and 4) through asammdf: one table per channel group that has a
time master.

asammdf decodes in C and can bring its process down on damaged bytes, so it works in a child process
(`mdf_child`), which also keeps its second of import out of this one.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from flightmech.errors import ParseError
from flighttest.records.readers.bus_words import Arinc429
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    Columns,
    LeftOut,
    RecordedTable,
    Recording,
    missing_package,
)

_EXPECTED = "a whole MDF file"
_REMEDY = "map a channel of numbers in a group with a time master"


def read(path: Path, names: NameMap) -> Recording:
    """Return the channel groups of an MDF file as tables, called by their acquisition name or
    ``group0``, ``group1``, ...

    Only the channels that the name map may require are decoded; without a map all of them.

    Raises
    ------
    ParseError
        The file is damaged, or no group has a time master.
    AeromatchError
        asammdf is not installed.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise missing_package("asammdf", "flight", path)
    command = [
        sys.executable,
        "-m",
        f"{__package__}.mdf_child",
        str(path),
        json.dumps(_wanted(names)),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as child:
        assert child.stdout is not None
        try:
            head, tables = _received(child.stdout, path)
        except (ValueError, EOFError, KeyError) as error:
            child.kill()
            raise ParseError(
                str(path), 0, "bytes on which the decoder asammdf broke down", _EXPECTED
            ) from error
    if head["fault"]:
        raise ParseError(str(path), 0, head["fault"], _EXPECTED)
    if not tables:
        raise ParseError(
            str(path), 0, "no group of channels with a time master", "a measurement over time"
        )
    facts = {"title": path.name.split(".")[0], **head["facts"]}
    left_out = [LeftOut(place, reason, _REMEDY) for place, reason in head["left_out"]]
    return Recording("mdf", tables, facts, left_out=tuple(left_out))


def _wanted(names: NameMap) -> list[str]:
    """Return the channels that the map may require, without their group."""
    columns = [
        column
        for leaf in names.leaves.values()
        for channel in leaf.values()
        for column in channel.columns
    ]
    columns += [
        spec.column for spec in names.decode.values() if isinstance(spec, Arinc429) and spec.column
    ]
    columns += [names.utc.column] if names.utc else []
    if columns:
        columns += [clock.column for clock in (names.clock, *names.clocks.values()) if clock.column]
    return sorted({column.rpartition("/")[2] for column in columns})


def _received(stream: IO[bytes], path: Path) -> tuple[dict[str, Any], dict[str, RecordedTable]]:
    """Return the head and the tables that the decoder sends: a line of JSON, then the arrays as
    they are.
    """
    head = json.loads(stream.readline())
    tables = {}
    for group in head["groups"]:
        time = _array(stream, "<f8", group["samples"])
        arrays = {
            name: _array(stream, kind, group["samples"]) for name, kind in group["decoded"].items()
        }
        columns = Columns(
            {name: partial(_column, name, arrays, str(path)) for name in group["channels"]}
        )
        tables[group["name"]] = RecordedTable(columns, group["units"], time)
    return head, tables


def _array(stream: IO[bytes], kind: str, length: int) -> np.ndarray:
    dtype = np.dtype(kind)
    raw = stream.read(dtype.itemsize * length)
    if len(raw) < dtype.itemsize * length:
        raise EOFError("the decoder ended early")
    return np.frombuffer(raw, dtype)


def _column(name: str, arrays: dict[str, np.ndarray], path: str) -> np.ndarray:
    if name not in arrays:
        raise ParseError(
            path, 0, f"channel {name!r} holding no numbers", "channels of numbers in the name map"
        )
    return arrays[name]
