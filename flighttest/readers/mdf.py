"""Measurement data format (MDF 3 and 4) through asammdf: one table per channel group that has a time master."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

import numpy as np

from flightmech.errors import ParseError

from ..names_map import NameMap
from .recording import Columns, Recording, Table, guarded, needs


def read(path: Path, names: NameMap) -> Recording:
    """Return the channel groups of an MDF file as tables, called by their acquisition name or ``group0``, ``group1``, ...

    Only the channels asked for are decoded.

    Raises
    ------
    ParseError
        The file is damaged, or no group has a time master.
    AeromatchError
        asammdf is not installed.
    """
    try:
        from asammdf import MDF
    except ImportError as error:
        raise needs("asammdf", "flight", path) from error
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    with guarded(path, "a whole MDF file"):
        file = MDF(path)
        tables: dict[str, Table] = {}
        wanted = {column.rpartition("/")[2] for leaf in names.leaves.values() for channel in leaf.values() for column in channel.columns}
        for index in range(len(file.groups)):
            master = file.masters_db.get(index)
            if master is None:
                continue
            table = _table(file, index, master, wanted, str(path))
            if table.time is not None and len(table.time) > 1 and len(table.columns):
                tables[_free(_group_name(file, index), tables, index)] = table
        start = file.start_time
    if not tables:
        raise ParseError(str(path), 0, "no group of channels with a time master", "a measurement over time")
    facts = {"title": path.name.split(".")[0]}
    if start is not None:
        facts["start"] = start.isoformat()
    return Recording("mdf", tables, facts)


class _Group:
    """The channels of one group; those that the name map may ask for are decoded together, which is far cheaper than one by one."""

    def __init__(self, file, index: int, numbers: dict[str, int], wanted: set[str], path: str):
        self.file, self.index, self.numbers, self.path = file, index, numbers, path
        self.wanted = [name for name in numbers if name in wanted]
        self.read: dict[str, np.ndarray | None] = {}

    def load(self, name: str) -> np.ndarray:
        """Return the samples of one channel."""
        if name not in self.read:
            self._decode(list(dict.fromkeys([*self.wanted, name])))
        values = self.read[name]
        if values is None:
            raise ParseError(self.path, 0, f"channel {name!r} holding no numbers", "channels of numbers in the name map")
        return values

    def _decode(self, names: list[str]) -> None:
        with guarded(self.path, "a whole MDF file"):
            signals = self.file.select([(None, self.index, self.numbers[name]) for name in names])
        for name, signal in zip(names, signals, strict=True):
            values, bad = np.asarray(signal.samples), getattr(signal, "invalidation_bits", None)
            if values.dtype.kind not in "fiub" or values.ndim != 1:
                self.read[name] = None
            else:
                self.read[name] = values if bad is None else np.where(np.asarray(bad, bool), np.nan, values.astype(float))


def _table(file, index: int, master: int, wanted: set[str], path: str) -> Table:
    numbers: dict[str, int] = {}
    units = {}
    for number, channel in enumerate(file.groups[index].channels):
        if number == master or channel.name in numbers:
            continue
        numbers[channel.name] = number
        unit = getattr(channel, "unit", "") or getattr(getattr(channel, "conversion", None), "unit", "")
        if unit:
            units[channel.name] = unit
    group = _Group(file, index, numbers, wanted, path)
    return Table(Columns({name: partial(group.load, name) for name in numbers}), units, np.asarray(file.get_master(index), float))


def _group_name(file, index: int) -> str:
    group = file.groups[index].channel_group
    name = getattr(group, "acq_name", "") or ""
    return name.strip().replace("/", "_") or f"group{index}"


def _free(name: str, taken: dict[str, Table], index: int) -> str:
    return f"{name}.{index}" if name in taken else name
