"""Gaps in the clocks of a record before a match: what they take from fits, submodels and cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import xarray as xr

from flighttest.records.sensors.measurements import inertial_channels
from flighttest.records.signals.clock_gaps import channel_gaps, gap_text, gaps_in, sample_gaps
from pom.cases.case import PomCase
from pom.cases.reference_states import GAP_REMEDY, drives

Spans = Sequence[tuple[float, float]]
_MOTION = "p"
"""Channel of the inertial unit: its clock is the clock of the states."""


def gap_departures(
    name: str, record: xr.DataTree, cases: Sequence[PomCase], spans: Mapping[str, Spans]
) -> list[str]:
    """Return a line for every gap of a record that takes something from its users.

    The match runs with gaps: a fit leaves them out, the states are reconstructed on both sides,
    and a case across one has invalid rows.

    Parameters
    ----------
    name : str
        Name of the record.
    record : DataTree
    cases : sequence of PomCase
        Cases that replay the record.
    spans : mapping of str to sequence of (float, float)
        Windows that identify something, by fit or position of a submodel. [s]
    """
    channels: dict[tuple[float, float], list[str]] = {}
    leaves: dict[tuple[float, float], list[str]] = {}
    for leaf, node in record.children.items():
        data = node.to_dataset()
        names = list(map(str, data.data_vars))
        # the windows of the reconstruction end where all inertial channels do
        counted = inertial_channels(data) if _MOTION in data else names
        shared = sample_gaps(data, counted)
        for gap in shared:
            leaves.setdefault(gap, []).append(str(leaf))
            channels.setdefault(gap, []).extend(names)
        # A control can be blank while the other channels of its clock have values. An inertial
        # channel that is blank alone is an error of the reconstruction.
        inertial = inertial_channels(data)
        for channel in (item for item in names if item not in inertial):
            for gap in channel_gaps(data, channel):
                if gap not in shared:
                    leaves.setdefault(gap, []).append(f"{leaf}/{channel}")
                    channels.setdefault(gap, []).append(channel)
    lines = []
    for gap in sorted(leaves):
        effects = _effects(gap, channels[gap], cases, spans)
        if not effects:
            continue
        if _MOTION in channels[gap]:
            effects.insert(0, "the states are reconstructed on both sides by themselves")
        line = f"record {name}: {gap_text(gap)} ({', '.join(leaves[gap])})"
        lines.append("; ".join([line, *effects, GAP_REMEDY]))
    return lines


def _effects(
    gap: tuple[float, float],
    channels: Sequence[str],
    cases: Sequence[PomCase],
    spans: Mapping[str, Spans],
) -> list[str]:
    """Return what a gap takes from the users of its record; `channels` are those with the gap."""
    effects = []
    for case in cases:
        if not gaps_in(case.window, [gap]):
            continue
        effect = "reads these channels from a line across it"
        if _MOTION in channels or any(drives(case, name) for name in channels):
            effect = "is not flown across it, and its rows are invalid"
        effects.append(f"case {case.name} {effect}")
    for position, windows in spans.items():
        if any(gaps_in(window, [gap]) for window in windows):
            effects.append(f"{position} has it in a window")
    return effects
