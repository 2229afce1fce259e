"""Channels of a case that a replay reads, shows and judges."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.judging.applicability import reason_not_judged
from pom.tolerances.rows import helpful_signals, required_signals

Traces = Mapping[str, np.ndarray]


def sampled_channels(states: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the channels of a flight, per sample. [SI]"""
    count = states.sizes["time"]
    channels: dict[str, np.ndarray] = {}
    for name in states.data_vars:
        item = states.variables[name]
        # Scalars are constants over the window. Arrays with more than one axis are not channels.
        if item.ndim < 2:
            channels[str(name)] = np.broadcast_to(item.values, count)
    return channels


def moved_controls(job: ReplayJob) -> set[str]:
    """Return the controls that the math pilot or the control law moves."""
    controls = {loop.control for loop in job.pilot}
    if job.law is not None:
        controls.update(job.law.moves)
    return controls


def judged_channels(case: PomCase) -> list[str]:
    """Return the channels that the criteria of a case are computed from."""
    channels: dict[str, None] = {}
    for criterion in case.criteria:
        if criterion.applies and not reason_not_judged(case, criterion):
            channels |= dict.fromkeys(required_signals(criterion))
    return list(channels)


def shown_channels(case: PomCase, states: xr.Dataset) -> list[str]:
    """Return every channel of the result.

    They are the judged and the requested channels, the controls that the math pilot or the control
    law moves, and the thrust of each engine.
    """
    controls = [*(loop.control for loop in case.drive.pilot), *case.law_moves]
    names = map(str, states.data_vars)
    engines = [name for name in names if name.startswith("engine") and name.endswith(".thrust")]
    channels = [
        *judged_channels(case),
        *case.show,
        *controls,
        *sorted(engines),
        *helping_channels(case),
    ]
    return list(dict.fromkeys(channels))


def helping_channels(case: PomCase) -> list[str]:
    """Return the signals that show the events and conditions of the criteria of a case.

    A model may lack them.
    """
    channels: list[str] = []
    for criterion in case.criteria:
        if criterion.applies and not reason_not_judged(case, criterion):
            channels += helpful_signals(criterion)
    return channels


def unwrapped_near(angle: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """Return an angle (time,) without jumps, which starts within half a turn of the flight.
    [rad]
    """
    if not np.isfinite(angle).all() or not np.isfinite(flight[0]):
        return angle
    smooth = np.unwrap(angle)
    return smooth - 2.0 * np.pi * np.round((smooth[0] - flight[0]) / (2.0 * np.pi))
