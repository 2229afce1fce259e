"""Several recordings of one flight as one record: each with its own clock, brought onto the clock of the first."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import xarray as xr

from flightmech.errors import SchemaError

from ..signals.sample_flags import as_text, kept

_SAME_MOMENT = 12 * 3600.0  # s: starts further apart are not one flight


def merge(records: Sequence[xr.DataTree], offsets: Sequence[float] | None = None) -> xr.DataTree:
    """Return one record of all leaves, with times on the clock of the first.

    Parameters
    ----------
    records : sequence of DataTree
        Records of one flight, from different recorders.
    offsets : sequence of float, optional
        Seconds to add to the clock of each record after the first.  Without it the records must state when they start (``start``, from
        the file, from ``[utc]`` of the name map, or from ``[record]``).

    Returns
    -------
    DataTree
        Leaves of all records; one whose name is taken gets ``_2``, ``_3``, ...  Root attributes of the first, with ``merged`` (JSON): file
        and offset of each.

    Raises
    ------
    SchemaError
        A record without a start, starts that are not of one flight, or a channel in two of them: every problem.
    """
    starts = _offsets(records) if offsets is None else [0.0, *map(float, offsets)]
    if len(starts) != len(records):
        raise SchemaError("merge", [f"{len(starts) - 1} offsets for {len(records)} records; give one for each after the first"])
    leaves: dict[str, xr.Dataset] = {}
    origin: dict[str, str] = {}
    problems, notes, merged = [], [], []
    for record, offset in zip(records, starts, strict=True):
        file = str(record.attrs.get("source_file", record.attrs.get("title", "a record")))
        merged.append({"file": file, "offset": offset})
        notes += [f"{file}: {text}" for text in json.loads(record.attrs.get("notes", "[]"))]
        for leaf, node in record.children.items():
            data = _moved(node.to_dataset(), offset)
            for name in map(str, data.data_vars):
                if name in origin:
                    problems.append(f"{name} is in {origin[name]} and in {file}; leave it out of one name map")
                origin.setdefault(name, file)
            leaves[_free(leaf, leaves)] = data
    if problems:
        raise SchemaError("merge", problems)
    root: dict[str, Any] = {str(key): item for key, item in records[0].attrs.items()}
    root.update(notes=json.dumps(notes), merged=json.dumps(merged))
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **{f"/{leaf}": data for leaf, data in leaves.items()}})


def _offsets(records: Sequence[xr.DataTree]) -> list[float]:
    moments, problems = [], []
    for record in records:
        text = str(record.attrs.get("start", ""))
        try:
            moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
            moments.append(moment if moment.tzinfo else moment.replace(tzinfo=UTC))
        except ValueError:
            problems.append(f"{record.attrs.get('source_file', 'a record')}: start {text!r} is no date and time; pass offsets=[...]")
    if problems:
        raise SchemaError("merge", problems)
    found = [(moment - moments[0]).total_seconds() for moment in moments]
    if max(map(abs, found)) > _SAME_MOMENT:
        raise SchemaError("merge", [f"starts {max(found) - min(found):.6g} s apart are not of one flight; pass offsets=[...]"])
    return found


def _moved(data: xr.Dataset, offset: float) -> xr.Dataset:
    if not offset:
        return data
    flags = kept(data.attrs.get("flags", "[]"))
    moved = data.assign_coords(time=("time", data["time"].values + offset, data["time"].attrs))
    moved.attrs["flags"] = as_text(flag._replace(start=flag.start + offset, stop=flag.stop + offset) for flag in flags)
    return moved


def _free(leaf: str, taken: dict[str, xr.Dataset]) -> str:
    names = (leaf, *(f"{leaf}_{i}" for i in range(2, len(taken) + 3)))
    return next(name for name in names if name not in taken)
