"""Flags of all leaves of a record as a table, and further flags on a leaf."""

from __future__ import annotations

import json
from collections.abc import Iterable

import pandas as pd
import xarray as xr

from flightmech.errors import UnknownName
from flighttest.records.signals.sample_flags import KINDS, Flag, as_text, read_stored_flags


def flags(record: xr.DataTree) -> pd.DataFrame:
    """Return every flag of a record.

    Returns
    -------
    DataFrame
        Columns ``leaf channel kind start stop samples note``; times in seconds.  ``channel`` is
        empty for flags of the clock.
    """
    rows = []
    for leaf, node in record.children.items():
        for row in json.loads(node.attrs.get("flags", "[]")):
            rows.append({"leaf": leaf, **Flag(*row)._asdict()})
    return pd.DataFrame(rows, columns=["leaf", *Flag._fields])


def add_flags(record: xr.DataTree, leaf: str, added: Iterable[Flag]) -> xr.DataTree:
    """Return the record with more flags on a leaf. Equal flags are stored once.

    Raises
    ------
    UnknownName
        The record has no such leaf or channel, or the kind is unknown.
    """
    if leaf not in record.children:
        raise UnknownName(leaf, record.children, "leaf")
    added = list(added)
    channels = [str(name) for name in record.children[leaf].data_vars]
    for flag in added:
        if flag.kind not in KINDS:
            raise UnknownName(flag.kind, KINDS, "kind of flag")
        if flag.channel and flag.channel not in channels:
            raise UnknownName(flag.channel, channels, "channel")
    flagged = record.copy()
    attrs = flagged[leaf].attrs
    stored = read_stored_flags(attrs.get("flags", "[]"))
    attrs["flags"] = as_text(dict.fromkeys([*stored, *added]))
    return flagged
