"""What a record holds, as rows of plain values: its channels, its manoeuvres, and what is wrong with its clocks and samples."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files.text import json_content

from ..signals.sample_flags import in_words, kept
from .reading import Arrays, Leaf

MANOEUVRE = ("manoeuvre", "control", "start", "end", "note")


def listing(record: Arrays) -> dict[str, Any]:
    """Return what `flight show` prints of a record: ``facts channels manoeuvres faults unmapped``."""
    return {
        "facts": {key: value for key, value in record.attrs.items() if key not in ("manoeuvres", "unmapped", "notes", "left_out")},
        "channels": channel_rows(record.leaves),
        "manoeuvres": flown_rows(record.attrs),
        "faults": fault_texts(record.attrs, ((name, leaf.attrs) for name, leaf in record.leaves.items())),
        "unmapped": [name for name in record.attrs["unmapped"].split(", ") if name],
    }


def channel_rows(leaves: Mapping[str, Leaf]) -> list[dict[str, Any]]:
    """Return one row per channel: leaf, rate, span, smallest and largest value, unit, calibration, faults."""
    return [_channel_row(name, leaf, channel) for name, leaf in leaves.items() for channel in leaf.channels]


def _channel_row(name: str, leaf: Leaf, channel: str) -> dict[str, Any]:
    x, about = leaf.channels[channel]
    lost = np.isnan(x)
    good = x[~lost] if lost.any() else x
    known = bool(np.isfinite(good).any())
    return {
        "leaf": name,
        "channel": channel,
        "rate": float(leaf.attrs["rate"]),
        "start": float(leaf.time[0]),
        "stop": float(leaf.time[-1]),
        "min": float(good.min()) if known else math.nan,
        "max": float(good.max()) if known else math.nan,
        "units": about["units"],
        "calibration": about.get("calibration", ""),
        "missing": int(lost.sum()),
    }


def listed(attrs: Mapping[Any, Any], key: str) -> list[dict[str, Any]]:
    """Return the rows of a list of manoeuvres or modes in the root attributes of a record: ``manoeuvre control start end note``.

    Raises
    ------
    ParseError
        The attribute is no such list.
    """
    file = str(attrs.get("source_file", "the record"))
    found = json_content(attrs.get(key, "[]"), file, f"a list of {key}")
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise ParseError(file, 0, f"the attribute {key} {str(found)[:40]!r}", "a list of rows in JSON; write the record again")
    return [{name: row.get(name, "") for name in MANOEUVRE} for row in found]


def flown_rows(attrs: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Return the list of manoeuvres as the table of `flighttest.records.record.manoeuvres` holds it: times of one kind in a column."""
    found = listed(attrs, "manoeuvres")
    for key in ("start", "end"):
        times = [row[key] for row in found]
        if all(time is None or isinstance(time, int | float) for time in times) and not all(isinstance(time, int) for time in times):
            found = [{**row, key: math.nan if row[key] is None else float(row[key])} for row in found]
    return found


def fault_texts(attrs: Mapping[Any, Any], leaves: Iterable[tuple[str, Mapping[Any, Any]]]) -> list[str]:
    """Return in words what is wrong, from the attributes of the root and of each leaf."""
    found = [str(note) for note in json.loads(attrs.get("notes", "[]"))]
    for leaf, about in leaves:
        found += [f"{leaf}: {text}" for text in in_words(kept(about.get("flags", "[]")))]
    return found
