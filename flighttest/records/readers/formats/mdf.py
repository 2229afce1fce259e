"""Measurement data files (MDF 3 and 4) as one table per channel group with a time master.

The package asammdf decodes the file in C and may crash its process on damaged bytes.  It runs in a
child process (`mdf_child`), so that a crash is an ordinary error here and this process does not
import the package.
"""

from __future__ import annotations

import importlib.util
import json
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.foreign_code.process import (
    ForeignProcess,
    RunLimits,
    module_command,
    sandbox_for,
)
from flightmech.support.foreign_code.sandbox import read_sandbox_mode, uses_sandbox
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    Columns,
    LeftOut,
    RecordedTable,
    Recording,
    missing_package,
)

# Limits of the decoder: time of its start [s], rate of reading [byte s-1], address space [byte].
_SECONDS, _RATE, _MEMORY = 60.0, 2e6, 16_000_000_000
_PART, _LONGEST_HEAD = 1 << 24, 1 << 26  # bytes that are read at once, and of the head
_EXPECTED = "a whole MDF file"
_REMEDY = "map a channel of numbers in a group with a time master"


def read(path: Path, names: NameMap) -> Recording:
    """Return the channel groups of an MDF file as tables.

    A table has the acquisition name of its group, else ``group0``, ``group1``, ...  Only the
    channels that the name map may read are decoded, without a map all channels.

    Raises
    ------
    ParseError
        The file is damaged, or no group has a time master.
    AeromatchError
        asammdf is not installed.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise missing_package("asammdf", "flight", path)
    file = str(path.resolve())
    child = ForeignProcess(
        module_command(f"{__package__}.mdf_child", file, json.dumps(_requested_channels(names))),
        RunLimits(memory=_MEMORY),
        sandbox=sandbox_for(uses_sandbox(read_sandbox_mode()), [file]),
    )
    timer = child.limit_time(_SECONDS + path.stat().st_size / _RATE)
    try:
        head, tables = _receive_tables(child.stdout, path)
    except (ValueError, EOFError, KeyError, TypeError, AttributeError) as error:
        raise ParseError(
            str(path),
            0,
            found="bytes on which the decoder asammdf broke down",
            expected=_EXPECTED,
        ) from error
    finally:
        timer.cancel()
        child.close()
    if head["fault"]:
        raise ParseError(str(path), 0, found=head["fault"], expected=_EXPECTED)
    if not tables:
        raise ParseError(
            str(path),
            0,
            found="no group of channels with a time master",
            expected="a measurement over time",
        )
    facts = {"title": path.name.split(".")[0], **head["facts"]}
    left_out = [LeftOut(channel, reason, _REMEDY) for channel, reason in head["left_out"]]
    return Recording("mdf", tables, facts, left_out=tuple(left_out))


def _requested_channels(names: NameMap) -> list[str]:
    """Return the channels that the map may read, without their group; empty for all channels."""
    columns = names.requested_columns()
    if columns:
        # The clocks of the map are channels too.
        clocks = (names.clock, *names.clocks.values())
        columns += [clock.column for clock in clocks if clock.column]
    return sorted({column.rpartition("/")[2] for column in columns})


def _receive_tables(
    stream: IO[bytes], path: Path
) -> tuple[dict[str, Any], dict[str, RecordedTable]]:
    """Return the head and the tables of the decoder, which sends a line of JSON and the arrays."""
    head = json.loads(stream.readline(_LONGEST_HEAD))
    tables = {}
    for group in head["groups"]:
        # The order of the arrays in the stream is the stamps, then the decoded channels.
        samples = group["samples"]
        time = _read_array(stream, "<f8", samples)
        arrays = {}
        for name, kind in group["decoded"].items():
            arrays[name] = _read_array(stream, kind, samples)
        # A channel without numbers is an error only when it is read.
        loaders = {}
        for name in group["channels"]:
            loaders[name] = partial(_load_column, name, arrays, path=str(path))
        tables[group["name"]] = RecordedTable(Columns(loaders), group["units"], time)
    return head, tables


def _read_array(stream: IO[bytes], kind: str, length: int) -> np.ndarray:
    """Return the next array of the stream."""
    dtype = np.dtype(kind)
    if dtype.kind not in "fiub" or length < 0:
        raise ValueError(f"no array of numbers: {kind}, {length}")
    size = dtype.itemsize * length
    raw = bytearray()
    # A pipe returns what it has.
    while len(raw) < size:
        part = stream.read(min(size - len(raw), _PART))
        if not part:
            raise EOFError("the decoder ended early")
        raw += part
    return np.frombuffer(raw, dtype)


def _load_column(name: str, arrays: dict[str, np.ndarray], path: str) -> np.ndarray:
    """Return the numbers of a channel."""
    if name not in arrays:
        raise ParseError(
            path,
            0,
            found=f"channel {name!r} holding no numbers",
            expected="channels of numbers in the name map",
        )
    return arrays[name]
