"""One thing that is wrong, or worth knowing, with a flight record: named, placed, measured, and
with what to do.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import pandas as pd
import xarray as xr

from flighttest.records.readers.channel_correction import correct_channel, line_of
from flighttest.records.readers.name_map import Channel

SEVERITIES = ("error", "warning", "note")
"""An error makes numbers wrong; a warning spoils some, or should be looked at; a note is worth knowing."""


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    kind : str
        What it is, in one word: ``sign unit axis definition inconsistent range scale lag`` of
        consistency, ``column column_name stated_unit`` of the name map, ``geometry inertia weight``
        of the aircraft file, ``gap stray duplicate reset missing outside held spike jump wrap
        saturation stuck noise`` of samples, ``excitation collinear`` of the flying, ``absent coarse
        offset minimum_speed`` of what is worth knowing.
    channels : tuple of str
        Canonical names it concerns; the first one is at fault.
    text : str
        What was found, with numbers.
    remedy : str
        What to do; a line of the name map where that corrects it, to be put in the place of the one
        that stands there.
    start, stop : float or None
        Where, on the record's clock; None for the whole record. [s]
    evidence : dict
        Figures behind it, SI.
    """

    severity: str
    kind: str
    channels: tuple[str, ...]
    text: str
    remedy: str = ""
    start: float | None = None
    stop: float | None = None
    evidence: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Kind and channels in one word: ``sign:delta_r``."""
        return f"{self.kind}:{'+'.join(self.channels)}"

    def as_dict(self) -> dict[str, Any]:
        """Return all fields, with the name."""
        return {"name": self.name, **asdict(self)}


def map_entry(record: xr.DataTree, name: str, slope: float, shift: float = 0.0) -> str:
    """Return the line of the name map that corrects a channel, to be put in the place of the one
    that stands there now.

    Parameters
    ----------
    record : DataTree
        The record; its channels carry their entry of the name map.
    name : str
        Canonical name.
    slope, shift : float
        The channel as it should be is slope * recorded + shift. [1, SI]
    """
    leaf, channel, file_unit = map_entry_of(record, name)
    if channel is not None:
        return (
            f"{line_of(name, correct_channel(channel, name, file_unit, slope, shift))}   # in "
            f"[{leaf}] of the name map"
        )
    sides = [side for side in (f"{name}_left", f"{name}_right") if side in record[leaf].data_vars]
    if sides and shift == 0.0:
        return "\n    ".join(map_entry(record, side, slope) for side in sides)
    return (
        f"{name} = {slope:.10g} * {name} {shift:+.10g} on what it is made of: "
        f"{record[leaf][name].attrs.get('calibration', '')}"
    )


def add_delay_line(
    record: xr.DataTree, name: str, *, delay: float = 0.0, lag: float = 0.0, slope: float = 1.0
) -> str:
    """Return the line of the name map of a channel with more delay or lag [s], times `slope`; empty
    for one formed from others.
    """
    leaf, channel, file_unit = map_entry_of(record, name)
    if channel is None:
        return ""
    if slope != 1.0:
        channel = correct_channel(channel, name, file_unit, slope, 0.0)
    changed = {
        key: round(getattr(channel, key) + more, 3)
        for key, more in (("delay", delay), ("lag", lag))
        if more
    }
    return f"{line_of(name, channel.changed(**changed))}   # in [{leaf}] of the name map"


def exchange_channels(record: xr.DataTree, one: str, other: str) -> str:
    """Return the lines of the name map with the entries of two channels exchanged."""
    places = {name: map_entry_of(record, name) for name in (one, other)}
    lines = []
    for name, source in ((one, other), (other, one)):
        (leaf, _, _), (home, channel, _) = places[name], places[source]
        if channel is None:
            return f"exchange the columns of {one} and {other} in the name map"
        column = (
            channel.column
            if home == leaf or "/" in str(channel.column)
            else str(record[home][source].attrs["column"])
        )
        lines.append(
            f"{line_of(name, channel.changed(column=column))}   # in [{leaf}] of the name map"
        )
    return "\n    ".join(lines)


def map_entry_of(record: xr.DataTree, name: str) -> tuple[str, Channel | None, str | None]:
    """Return the leaf of a channel, its entry of the name map and the unit in the file; None where
    it was formed from others.
    """
    leaf = next(leaf for leaf, node in record.children.items() if name in node.data_vars)
    about = record[leaf][name].attrs
    entry = about.get("map_entry")
    return leaf, Channel(**json.loads(entry)) if entry else None, about.get("file_unit") or None


def iterate_rows(table: pd.DataFrame) -> Iterator[Any]:
    """Yield the rows of a table as named tuples."""
    yield from table.itertuples()


_CAUSES = {  # what follows from another fault of the same channel
    "noise": ("sign", "unit", "axis", "definition", "spike", "held"),
    "excitation": ("unit",),
    "scale": ("unit", "lag"),
    "range": ("unit", "axis", "definition", "spike"),
    "jump": ("held", "spike", "missing", "wrap"),
    "saturation": ("held", "unit"),
    "column_name": ("column", "axis"),
    "inconsistent": ("column", "lag", "held", "spike", "wrap", "jump"),
}


def without_consequences(findings: list[Finding]) -> list[Finding]:
    """Return the findings that do not merely follow from another one of the same channel."""
    causes = {(finding.kind, channel) for finding in findings for channel in finding.channels}
    return [
        finding
        for finding in findings
        if not any(
            (cause, channel) in causes
            for cause in _CAUSES.get(finding.kind, ())
            for channel in _concerned(finding)
        )
    ]


def _concerned(finding: Finding) -> tuple[str, ...]:
    return finding.channels if finding.kind in ("inconsistent", "scale") else finding.channels[:1]


def by_severity(findings: list[Finding]) -> list[Finding]:
    """Return errors first, notes last; the order within stays."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))
