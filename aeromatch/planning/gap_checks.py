"""Gaps in the clocks of a record before a match: what they take from fits, submodels and cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import xarray as xr

from flighttest.records.signals.clock_gaps import clock_gaps, gap_text, gaps_in
from pom.cases.case import PomCase
from pom.cases.reference_states import GAP_REMEDY

Spans = Sequence[tuple[float, float]]
_MOTION = "p"
"""Channel of the inertial unit: its clock is the clock of the states."""


def gap_departures(
    name: str, record: xr.DataTree, cases: Sequence[PomCase], spans: Mapping[str, Spans]
) -> list[str]:
    """Return a line for every gap of a record, with what it takes from its users.

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
    leaves: dict[tuple[float, float], list[str]] = {}
    moving: set[tuple[float, float]] = set()
    for leaf, node in record.children.items():
        data = node.to_dataset()
        for gap in clock_gaps(data["time"].values):
            leaves.setdefault(gap, []).append(str(leaf))
            if _MOTION in data:
                moving.add(gap)
    lines = []
    for gap in sorted(leaves):
        effects = _effects(gap, gap in moving, cases, spans)
        line = f"record {name}: {gap_text(gap)} ({', '.join(leaves[gap])})"
        lines.append("; ".join([line, *effects, GAP_REMEDY]))
    return lines


def _effects(
    gap: tuple[float, float], moving: bool, cases: Sequence[PomCase], spans: Mapping[str, Spans]
) -> list[str]:
    """Return what a gap takes from the users of its record.

    `moving` states whether the inertial unit has the gap, else other channels alone.
    """
    effects = []
    if moving:
        effects.append("the states are reconstructed on both sides by themselves")
    for case in cases:
        if not gaps_in(case.window, [gap]):
            continue
        effect = "is not flown across it, and its rows are invalid"
        if not moving:
            effect = "reads these channels from a line across it"
        effects.append(f"case {case.name} {effect}")
    for position, windows in spans.items():
        if any(gaps_in(window, [gap]) for window in windows):
            effects.append(f"{position} has it in a window")
    return effects
