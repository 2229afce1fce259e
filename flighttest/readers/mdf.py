"""Measurement data format (MDF 3 and 4) through asammdf: one table per channel group that has a time master."""

from __future__ import annotations

import functools
import logging
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
        raise needs("asammdf", "mdf", path) from error
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    with guarded(path, "a whole MDF file"):
        file = MDF(path)
        tables: dict[str, Table] = {}
        for index in range(len(file.groups)):
            master = file.masters_db.get(index)
            if master is None:
                continue
            table = _table(file, index, master, str(path))
            if table.time is not None and len(table.time) > 1 and len(table.columns):
                tables[_free(_group_name(file, index), tables, index)] = table
        start = file.start_time
    if not tables:
        raise ParseError(str(path), 0, "no group of channels with a time master", "a measurement over time")
    facts = {"title": path.name.split(".")[0]}
    if start is not None:
        facts["start"] = start.isoformat()
    return Recording("mdf", tables, facts)


def _table(file, index: int, master: int, path: str) -> Table:
    loaders, units = {}, {}
    for number, channel in enumerate(file.groups[index].channels):
        name = channel.name
        if number == master or name in loaders:
            continue
        loaders[name] = functools.partial(_samples, file, index, number, path)
        unit = getattr(channel, "unit", "") or getattr(getattr(channel, "conversion", None), "unit", "")
        if unit:
            units[name] = unit
    return Table(Columns(loaders), units, np.asarray(file.get_master(index), float))


def _samples(file, index: int, number: int, path: str) -> np.ndarray:
    with guarded(path, "a whole MDF file"):
        signal = file.get(group=index, index=number)
        values = np.asarray(signal.samples)
        if values.dtype.kind not in "fiub" or values.ndim != 1:
            raise ParseError(path, 0, f"channel {signal.name!r} holding no numbers", "channels of numbers in the name map")
        bad = getattr(signal, "invalidation_bits", None)
        return values if bad is None else np.where(np.asarray(bad, bool), np.nan, values.astype(float))


def _group_name(file, index: int) -> str:
    group = file.groups[index].channel_group
    name = getattr(group, "acq_name", "") or ""
    return name.strip().replace("/", "_") or f"group{index}"


def _free(name: str, taken: dict[str, Table], index: int) -> str:
    return f"{name}.{index}" if name in taken else name
