"""Findings on a flight record, with the lines of the name map that correct them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.names import is_quantity, lookup
from flighttest.records.readers.channel_correction import correct_channel, line_of
from flighttest.records.readers.name_map import Channel

SEVERITIES = ("error", "warning", "note")
"""An error makes results wrong. A warning affects some results. A note is information."""

# Words for the kinds of findings in front of their channels.
_TITLES = {
    "absent": "absent:",
    "axis": "axis of",
    "coarse": "coarse steps of",
    "collinear": "moved together:",
    "column": "column of",
    "column_name": "name of the column of",
    "correction": "correction of",
    "definition": "definition of",
    "duplicate": "repeated times of",
    "excitation": "little movement of",
    "gap": "gap in",
    "geometry": "position of",
    "held": "held values of",
    "inconsistent": "inconsistent:",
    "inertia": "inertia against",
    "instrument": "stated error of",
    "jump": "jump of",
    "lag": "delay of",
    "lost": "samples lost in",
    "minimum_speed": "below the least speed:",
    "missing": "missing values of",
    "missing_code": "code of a missing value in",
    "mounting": "mounting of",
    "noise": "noise of",
    "offset": "offset of",
    "outside": "beyond the calibration:",
    "range": "range of",
    "reconstruction": "reconstruction of",
    "reset": "clock set back in",
    "saturation": "end of the range of",
    "scale": "scale of",
    "sign": "sign of",
    "small_scale": "small error of scale of",
    "smoothed": "smoothing of",
    "spike": "spikes of",
    "staircase": "slow recording of",
    "stated_unit": "stated unit of",
    "stray": "stray times of",
    "stuck": "constant:",
    "undecided": "sign or delay of",
    "unit": "unit of",
    "weight": "weight against",
    "wrap": "clock that wraps in",
}
# Kinds of findings, and the kinds of faults of the same channel that cause them.
_CAUSES = {
    "noise": ("sign", "unit", "axis", "definition", "spike", "held"),
    "excitation": ("unit",),
    "scale": ("unit", "lag"),
    "range": ("unit", "axis", "definition", "spike"),
    "jump": ("held", "spike", "missing", "wrap", "lost", "correction"),
    "saturation": ("held", "unit"),
    "lag": ("staircase", "smoothed"),
    # the rate of a moment equation without its peaks, which a smoothed surface lacks too
    "smoothed": ("saturation",),
    "undecided": ("staircase", "smoothed"),
    "column_name": ("column", "axis", "definition"),
    "inconsistent": (
        "column",
        "lag",
        "held",
        "spike",
        "wrap",
        "jump",
        "offset",
        "lost",
        "correction",
        "mounting",
    ),
}
# Kinds of findings that concern all their channels; others concern the first one.
_OF_ALL_CHANNELS = ("inconsistent", "scale", "smoothed")


@dataclass(frozen=True)
class Finding:
    """A fault of a flight record, or information about it.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    kind : str
        Kind of the finding in one word. Consistency: ``sign unit axis definition inconsistent range
        scale lag``. Name map: ``column column_name stated_unit``. Inertial unit: ``mounting``.
        Aircraft file: ``geometry inertia instrument weight``. Samples: ``gap stray duplicate reset
        lost correction missing outside held spike
        jump wrap saturation stuck staircase smoothed noise``. Inputs: ``excitation collinear``.
        Information: ``absent coarse offset minimum_speed``.
    channels : tuple of str
        Canonical names of the channels; the first one is at fault.
    text : str
        Description with numbers.
    remedy : str
        Action of the user. A line of the name map replaces the present line of the channel.
    start, stop : float or None
        Interval on the clock of the record; None for the complete record. [s]
    evidence : dict
        Numbers of the finding, SI.
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
        """Kind and channels: ``sign:delta_r``."""
        return f"{self.kind}:{'+'.join(self.channels)}"

    def as_dict(self) -> dict[str, Any]:
        """Return all fields, with the name."""
        return {"name": self.name, **asdict(self)}


def describe_name(name: str) -> str:
    """Return the name of a finding as words: ``sign:delta_r`` as "sign of delta_r (rudder
    deflection)".

    A kind without words, and a channel out of the vocabulary, keep their names.
    """
    kind, _, channels = name.partition(":")
    described = []
    for channel in filter(None, channels.split("+")):
        if is_quantity(channel):
            channel += f" ({lookup(channel).long_name.partition(',')[0]})"
        described.append(channel)
    return f"{_TITLES.get(kind, kind)} {', '.join(described)}".strip()


def map_entry(record: xr.DataTree, name: str, slope: float, shift: float = 0.0) -> str:
    """Return the line of the name map that corrects a channel. It replaces the present line.

    Parameters
    ----------
    record : DataTree
        The record. The attributes of its channels have their entries of the name map.
    name : str
        Canonical name.
    slope, shift : float
        The correct channel is slope * recorded + shift. [1, SI]
    """
    leaf, channel, file_unit = map_entry_of(record, name)
    if channel is not None:
        line = line_of(name, correct_channel(channel, name, file_unit, slope, shift))
        return f"{line}   # in [{leaf}] of the name map"
    # A mean of two sides has an entry for each side.
    sides = []
    for side in (f"{name}_left", f"{name}_right"):
        if side in record[leaf].data_vars:
            sides.append(side)
    if sides and shift == 0.0:
        return "\n    ".join(map_entry(record, side, slope) for side in sides)
    calibration = record[leaf][name].attrs.get("calibration", "")
    return f"{name} = {slope:.10g} * {name} {shift:+.10g} on what it is made of: {calibration}"


def add_delay_line(
    record: xr.DataTree, name: str, *, delay: float = 0.0, lag: float = 0.0, slope: float = 1.0
) -> str:
    """Return the line of the name map of a channel with more delay or lag.

    Parameters
    ----------
    record : DataTree
    name : str
        Canonical name.
    delay, lag : float
        Additions to the present values. [s]
    slope : float
        Factor of the channel.

    Returns
    -------
    str
        Empty for a channel that is formed from other channels.
    """
    leaf, channel, file_unit = map_entry_of(record, name)
    if channel is None:
        return ""
    if slope != 1.0:
        channel = correct_channel(channel, name, file_unit, slope, 0.0)
    # milliseconds are more than the accuracy of an estimate
    changes = {}
    if delay:
        changes["delay"] = round(channel.delay + delay, 3)
    if lag:
        changes["lag"] = round(channel.lag + lag, 3)
    return f"{line_of(name, channel.changed(**changes))}   # in [{leaf}] of the name map"


def exchange_channels(record: xr.DataTree, one: str, other: str) -> str:
    """Return the lines of the name map with the entries of two channels exchanged."""
    lines = []
    for name, source in ((one, other), (other, one)):
        leaf, _, _ = map_entry_of(record, name)
        source_leaf, channel, _ = map_entry_of(record, source)
        if channel is None:
            return f"exchange the columns of {one} and {other} in the name map"
        column = channel.column
        # A column of another leaf needs its full name.
        if source_leaf != leaf and "/" not in str(column):
            column = str(record[source_leaf][source].attrs["column"])
        line = line_of(name, channel.changed(column=column))
        lines.append(f"{line}   # in [{leaf}] of the name map")
    return "\n    ".join(lines)


def map_entry_of(record: xr.DataTree, name: str) -> tuple[str, Channel | None, str | None]:
    """Return the leaf of a channel, its entry of the name map and its unit in the file.

    The entry is None for a channel that is formed from other channels.
    """
    leaf = next(leaf for leaf, node in record.children.items() if name in node.data_vars)
    attributes = record[leaf][name].attrs
    entry = attributes.get("map_entry")
    file_unit = attributes.get("file_unit") or None
    if not entry:
        return leaf, None, file_unit
    return leaf, Channel(**json.loads(entry)), file_unit


def iterate_rows(table: pd.DataFrame) -> Iterator[Any]:
    """Yield the rows of a table as named tuples."""
    yield from table.itertuples()


def without_consequences(findings: list[Finding]) -> list[Finding]:
    """Return the findings that do not follow from another finding on the same channel."""
    faults = set()
    for finding in findings:
        for channel in finding.channels:
            faults.add((finding.kind, channel))
    return [finding for finding in findings if not _is_consequence(finding, faults)]


def without_doubts(certain: list[Finding], findings: list[Finding]) -> list[Finding]:
    """Return the findings without notes on a unit that is certainly wrong."""
    channels = {finding.channels[0] for finding in certain if finding.kind == "unit"}
    kept = []
    for finding in findings:
        doubted = finding.severity == "note" and finding.kind == "unit"
        if not (doubted and finding.channels[0] in channels):
            kept.append(finding)
    return kept


def _is_consequence(finding: Finding, faults: set[tuple[str, str]]) -> bool:
    """Return whether a fault (kind, channel) causes a finding."""
    channels = finding.channels
    if finding.kind not in _OF_ALL_CHANNELS:
        channels = finding.channels[:1]
    possible_causes = product(_CAUSES.get(finding.kind, ()), channels)
    return not faults.isdisjoint(possible_causes)


def by_severity(findings: list[Finding]) -> list[Finding]:
    """Return errors first and notes last. The order within a severity does not change."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def without_explained(findings: list[Finding]) -> list[Finding]:
    """Return the findings without relations that the unit of another finding explains."""
    explained = set()
    for finding in findings:
        if finding.kind == "unit" and "relation" in finding.evidence:
            explained.add(finding.evidence["relation"])
    kept = []
    for finding in findings:
        unexplained = finding.evidence.get("relation") not in explained
        if finding.kind != "inconsistent" or unexplained:
            kept.append(finding)
    return kept


def late_channels(findings: list[Finding]) -> set[str]:
    """Return the channels with a finding on their delay."""
    channels: set[str] = set()
    for finding in findings:
        if finding.kind == "lag":
            channels.update(finding.channels)
    return channels
