"""Channels that repeat a value while they should move: for a time, or throughout."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from flightmech.aircraft.controls import ICE
from flightmech.names import WRAPPED, lookup
from flightmech.support.arrays import true_runs
from flighttest.reconstruction.quality.checks.signals import unwrap_angle
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.signals.resampling import is_control
from flighttest.records.signals.sample_flags import HELD_SAMPLES, HELD_TIME, Flag, sample_faults

# ratio of the noise to the typical step, above which the noise changes every sample
_RESTLESS = 0.3
_DIFFERENCE, _ENOUGH = 6, 50  # order of the differences that show noise only, and their number
_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal variable
_NEIGHBOURS = 20  # steps next to a run that show whether the channel moves there
_LIVELY = 0.3  # share of the typical step that these must have
DEVICES = (
    "gear",
    "speedbrake",
    "brake",
    "wow_",
    "delta_f",
    "delta_t",
    *("cutoff", "starter", "ignition", "flameout", "feather"),
    "mass",
    "x_cg",
    "y_cg",
    "z_cg",
    "I",
)
"""Beginnings of the names of channels that may rest for a whole flight."""


def iterate_channels(node: xr.DataTree) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the samples (time,) of each channel of a leaf. [SI]"""
    # The variables themselves: an array of xarray for each takes longer than a check of it.
    coordinates = set(node.coords)
    for name, variable in node.variables.items():
        if name not in coordinates:
            yield str(name), variable.values.astype(float)


def held_values(record: xr.DataTree) -> list[Flag]:
    """Return the values that a record holds: the flags of the kind ``held`` of `faults_of`."""
    held: list[Flag] = []
    for node in record.children.values():
        time, rate = node.variables["time"].values, float(node.attrs["rate"])
        for name, x in iterate_channels(node):
            # Most channels never rest for so long, and need no further look.
            if name in WRAPPED or _rests(x, HELD_SAMPLES - 1):
                faults = channel_faults(time, x, name, rate)
                held += [flag for flag in faults if flag.kind == "held"]
    return held


def stuck_findings(record: xr.DataTree) -> list[Finding]:
    """Return the channels of a record without a number, or with one value throughout."""
    findings: list[Finding] = []
    for node in record.children.values():
        for name, x in iterate_channels(node):
            findings += stuck_finding(name, x) or []
    return findings


def _rests(x: np.ndarray, steps: int) -> bool:
    """Return whether at least a number of steps of zero follow each other."""
    moving = np.flatnonzero(np.diff(x) != 0.0)
    if len(x) - 1 - len(moving) < steps:
        return False
    return bool(np.diff(moving, prepend=-1, append=len(x) - 1).max() > steps)


def channel_faults(time: np.ndarray, x: np.ndarray, name: str, rate: float) -> list[Flag]:
    """Return the faults of the samples of a channel, and the frozen runs among the others.

    Parameters
    ----------
    time, x : array (time,)
        Rising stamps [s] and samples. [SI]
    name : str
        Canonical name.
    rate : float
        Samples per second. [Hz]
    """
    faults = sample_faults(time, x, name, rate)
    frozen = []
    for flag in _frozen_runs(time, x, name, rate):
        if not any(_flags_overlap(flag, fault) for fault in faults):
            frozen.append(flag)
    return [*faults, *frozen]


def _frozen_runs(time: np.ndarray, x: np.ndarray, name: str, rate: float) -> list[Flag]:
    """Return the runs of equal samples in a channel whose noise changes every sample.

    Runs at the ends of the range are saturations, unless they begin or end with the record.
    """
    if name.rpartition(".")[2].startswith(DEVICES):
        return []
    size = np.abs(np.diff(x))
    needed = max(HELD_SAMPLES, HELD_TIME * rate)
    still_runs = true_runs(np.concatenate([[False], size == 0.0]))
    long_runs = [(start, stop) for start, stop in still_runs if stop - start >= needed]
    if not long_runs:
        return []
    typical = np.inf
    if (size > 0.0).any():
        typical = float(np.median(size[size > 0.0]))
    # Controls and headings may move without noise. The ones with noise do not rest for long.
    # The noise is that between the runs: a channel may be held for most of a record.
    moving = np.ones(len(x), bool)
    for start, stop in long_runs:
        moving[start:stop] = False
    noise = sixth_difference_noise(unwrap_angle(name, x[moving]))
    # the negation is true for a noise of NaN, of channels without noise
    if not noise > _RESTLESS * typical:
        return []
    inside_range = (x != np.nanmax(x)) & (x != np.nanmin(x))
    runs = []
    for start, stop in long_runs:
        is_inside = start == 1 or stop == len(x) or inside_range[start]
        if is_inside and _moves_around(size, start, stop, typical):
            # the sample before the run has the same value
            span = float(time[start - 1]), float(time[stop - 1])
            runs.append(Flag(name, "held", *span, stop - start + 1))
    return runs


def _moves_around(size: np.ndarray, start: int, stop: int, typical: float) -> bool:
    """Return whether the channel moves by its typical step before and after a run.

    The channels of a parked aeroplane are at rest before and after it. Only one side of a run
    counts that begins or ends with the record; both ends are a channel that never changes.
    """
    sides = []
    if start > 1:
        sides.append(size[max(0, start - _NEIGHBOURS - 1) : start - 1])
    if stop <= len(size):
        sides.append(size[stop : stop + _NEIGHBOURS])
    # a median of NaN is not larger than anything
    moves = [len(side) > 0 and float(np.median(side)) > _LIVELY * typical for side in sides]
    return bool(moves) and all(moves)


def _flags_overlap(first: Flag, second: Flag) -> bool:
    same_kind = second.kind == first.kind
    return same_kind and second.start <= first.stop and first.start <= second.stop


def sixth_difference_noise(x: np.ndarray) -> float:
    """Return the standard deviation of the white noise of a time history; NaN if it is short."""
    sixth = np.abs(np.diff(x, _DIFFERENCE))
    sixth = sixth[np.isfinite(sixth)]
    if len(sixth) < _ENOUGH:
        return float("nan")
    # the n-th difference of white noise has comb(2n, n) times its variance
    growth = math.sqrt(math.comb(2 * _DIFFERENCE, _DIFFERENCE))
    return float(np.median(sixth) / (_MEDIAN_OF_NORMAL * growth))


def stuck_finding(name: str, x: np.ndarray) -> list[Finding] | None:
    """Return the finding on a channel without a number, or with one value throughout.

    Parameters
    ----------
    name : str
        Canonical name.
    x : array (time,)
        Samples. [SI]

    Returns
    -------
    list of Finding or None
        One finding, none for a device that may rest, or None for a channel that changes.
    """
    finite = x[np.isfinite(x)]
    if not len(finite):
        text = f"{name} holds no number at all"
        return [Finding("error", "stuck", (name,), text, remedy="check the column of the name map")]
    if finite.min() != finite.max():
        return None
    # A whole flight may be clean or iced.
    if name == ICE or name.rpartition(".")[2].startswith(DEVICES):
        return []
    text = f"{name} never changes from {finite[0]:.6g} {lookup(name).units}"
    remedy = "check sensor, wiring and column; leave the channel out of the name map if it is dead"
    severity = "note" if is_control(name) else "error"
    return [Finding(severity, "stuck", (name,), text, remedy=remedy)]
