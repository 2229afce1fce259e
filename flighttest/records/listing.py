"""Rows and sentences about a flight record, as `flight show` prints them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files import json_content
from flighttest.records.channel_groups import RecordGroup
from flighttest.records.reading import Arrays
from flighttest.records.signals.sample_flags import flag_sentences, read_stored_flags

MANOEUVRE = ("manoeuvre", "control", "start", "end", "note")
"""Columns of a list of manoeuvres or flight modes."""

# Attributes of a record that a listing prints in another form.
_NOT_FACTS = ("manoeuvres", "unmapped", "notes", "left_out")


def record_listing(record: Arrays) -> dict[str, Any]:
    """Return ``facts channels manoeuvres faults unmapped left_out`` of a record.

    Rows of ``left_out`` have ``name`` and ``reason``: parts of the file that are not channels, such
    as text and complex numbers.
    """
    attrs_of_leaf = {name: leaf.attrs for name, leaf in record.leaves.items()}
    return {
        "facts": {key: item for key, item in record.attrs.items() if key not in _NOT_FACTS},
        "channels": channel_rows(record.leaves),
        "manoeuvres": _manoeuvre_rows(record.attrs),
        "faults": fault_texts(record.attrs, attrs_of_leaf.items()),
        "unmapped": [name for name in record.attrs["unmapped"].split(", ") if name],
        "left_out": _left_out_rows(record.attrs),
    }


def _left_out_rows(attrs: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the parts that the reader has omitted; none if the attribute is of another writer."""
    try:
        rows = json.loads(attrs.get("left_out", "[]"))
        return [{"name": str(name), "reason": str(reason)} for name, reason in rows]
    except (ValueError, TypeError):
        return []


def channel_rows(leaves: Mapping[str, RecordGroup]) -> list[dict[str, Any]]:
    """Return one row per channel.

    Its keys are leaf, channel, rate [Hz], start and stop [s], smallest and largest value, units,
    calibration, and number of missing samples.
    """
    rows = []
    for leaf, group in leaves.items():
        for name, channel in group.channels.items():
            low, high = _limits(channel.values)
            row = {
                "leaf": leaf,
                "channel": name,
                "rate": float(group.attrs["rate"]),
                "start": float(group.time[0]),
                "stop": float(group.time[-1]),
                "min": low,
                "max": high,
                "units": channel.attrs["units"],
                "calibration": channel.attrs.get("calibration", ""),
                "missing": int(np.isnan(channel.values).sum()),
            }
            rows.append(row)
    return rows


def _limits(x: np.ndarray) -> tuple[float, float]:
    """Return smallest and largest value without NaN; NaN if no sample is finite."""
    # An infinite sample is a limit only of a channel that also has finite samples.
    valid = x[~np.isnan(x)]
    if not np.isfinite(valid).any():
        return math.nan, math.nan
    return float(valid.min()), float(valid.max())


def read_listed_rows(attrs: Mapping[Any, Any], key: str) -> list[dict[str, Any]]:
    """Return the rows of a list of manoeuvres or modes in the root attributes of a record.

    Parameters
    ----------
    attrs : mapping
        Root attributes.
    key : str
        ``manoeuvres`` or ``modes``.

    Returns
    -------
    list of dict
        Each with the keys of `MANOEUVRE`; a missing one is an empty text.

    Raises
    ------
    ParseError
        The attribute is not such a list.
    """
    file = str(attrs.get("source_file", "the record"))
    content = json_content(attrs.get(key, "[]"), file, f"a list of {key}")
    if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
        raise ParseError(
            file,
            line=0,
            found=f"the attribute {key} {str(content)[:40]!r}",
            expected="a list of rows in JSON; write the record again",
        )
    rows = []
    for row in content:
        rows.append({name: row.get(name, "") for name in MANOEUVRE})
    return rows


def _manoeuvre_rows(attrs: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Return the manoeuvres with the times of the table of `flighttest.records.marked_manoeuvres`.

    A column of that table has one type: integers, or floats with NaN for null.
    """
    rows = read_listed_rows(attrs, "manoeuvres")
    for key in ("start", "end"):
        times = [row[key] for row in rows]
        is_integer = all(isinstance(time, int) for time in times)
        is_number = all(time is None or isinstance(time, int | float) for time in times)
        if is_integer or not is_number:
            continue
        for row in rows:
            row[key] = math.nan if row[key] is None else float(row[key])
    return rows


def fault_texts(
    attrs: Mapping[Any, Any], leaves: Iterable[tuple[str, Mapping[Any, Any]]]
) -> list[str]:
    """Return the faults of a record as sentences.

    Parameters
    ----------
    attrs : mapping
        Root attributes, with the notes of the file.
    leaves : iterable of (str, mapping)
        Name and attributes of each leaf, with its flags.
    """
    # The notes of the file precede the flags that the reading added.
    texts = [str(note) for note in json.loads(attrs.get("notes", "[]"))]
    for leaf, leaf_attrs in leaves:
        flags = read_stored_flags(leaf_attrs.get("flags", "[]"))
        texts += [f"{leaf}: {text}" for text in flag_sentences(flags)]
    return texts
