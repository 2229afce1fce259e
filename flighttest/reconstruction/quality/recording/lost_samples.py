"""Samples lost by a recorder whose clock was then renumbered.

Attitude, height and velocity are continuous.  Where samples are missing and the clock does not show
it, those that move jump at one instant.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from flighttest.reconstruction.quality.checks.signals import unwrap_angle
from flighttest.reconstruction.quality.finding import Finding
from flighttest.records.signals.resampling import GAP

_INERTIAL = ("phi", "theta", "psi", "vn", "ve", "vd", "h_gps", "h_baro", "hdot")
_CHANNELS = (*_INERTIAL, "V", "V_cas", "mach", "alpha_vane", "beta_vane")
_SIDE = 4  # samples of the straight line on either side
_AROUND = 4.0  # s of neighbours whose scatter a jump is compared with
# multiples of the scatter, and channels that jump together; two of motion suffice if they are clear
_SIGNIFICANT, _TOGETHER = 6.0, 3
_CLEAR, _PAIR = 8.0, 2
_OUTSTANDING = 2.0  # times the largest neighbouring step
_TO_SIGMA = 1.4826  # standard deviation of a normal variable over its median absolute value
_MOST_NAMED = 5


def lost_samples(record: xr.DataTree, faults: pd.DataFrame) -> tuple[list[Finding], pd.DataFrame]:
    """Return the finding on lost samples of each clock, and flags of their instants.

    Parameters
    ----------
    record : DataTree
    faults : DataFrame
        Result of `faults_of`. Jumps at a fault of the clock or of samples are not reported again.

    Returns
    -------
    findings : list of Finding
    flags : DataFrame
        Rows with the columns of `faults`, of the kind ``lost``.
    """
    findings, flags = [], []
    for leaves in _leaves_by_clock(record):
        signals = {}
        for leaf in leaves:
            data = record[leaf].to_dataset()
            for name in _CHANNELS:
                if name in data:
                    signals[name] = data[name].values.astype(float)
        names, time = list(signals), _clock_of(record, leaves[0])
        if len(names) < _TOGETHER or len(time) < 8 * _SIDE:
            continue
        scores = _jump_scores(signals, time)
        known = faults[faults["leaf"].isin(leaves) & (faults["kind"] != "duplicate")]
        places = _simultaneous(scores, names, time, known)
        if not places:
            continue
        channels = tuple(
            name for name, row in zip(names, scores, strict=True) if max(row[places]) > _SIGNIFICANT
        )
        parts = []
        for i in places:
            parts.append(f"{time[i]:.2f} s")
            for leaf in leaves:
                flags.append((leaf, "", "lost", float(time[i]), float(time[i + 1]), 0, ""))
        text = (
            f"samples lost at t = {', '.join(parts[:_MOST_NAMED])}: {', '.join(channels)} jump at "
            f"one instant, and the clock runs on"
        )
        remedy = (
            "restore the clock of the recorder; else cut manoeuvres before or after the instant"
        )
        start, stop = float(time[places[0]]), float(time[places[-1] + 1])
        evidence = {"places": len(places)}
        findings.append(
            Finding("error", "lost", channels, text, remedy, start, stop, evidence=evidence)
        )
    return findings, pd.DataFrame(flags, columns=faults.columns)


def _leaves_by_clock(record: xr.DataTree) -> list[list[str]]:
    """Return the names of the leaves, those with the same times together."""
    groups: list[list[str]] = []
    for leaf in record.children:
        time = _clock_of(record, leaf)
        for group in groups:
            if np.array_equal(_clock_of(record, group[0]), time):
                group.append(leaf)
                break
        else:
            groups.append([leaf])
    return groups


def _clock_of(record: xr.DataTree, leaf: str) -> np.ndarray:
    """Return the times of a leaf. [s]"""
    return record[leaf].to_dataset()["time"].values


def _jump_scores(signals: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Return the jumps after each sample over their scatter (channel, time).

    A jump is the distance between straight lines through the samples on both sides.
    """
    step = float(np.median(np.diff(time)))
    width = 2 * round(0.5 * _AROUND / step) + 1
    scores = np.zeros((len(signals), len(time)))
    for row, (name, recorded) in enumerate(signals.items()):
        x = unwrap_angle(name, recorded)
        jump = _line_jumps(x)
        size = pd.Series(np.abs(jump)).rolling(width, center=True, min_periods=_SIDE).median()
        moving = np.abs(np.diff(x))
        moving = moving[moving > 0.0]
        # a coarse channel jumps by its resolution
        least = float(moving.min()) if len(moving) else np.inf
        scatter = _TO_SIGMA * size.to_numpy() + 0.3 * least
        with np.errstate(invalid="ignore", divide="ignore"):
            score = np.nan_to_num(np.abs(jump) / scatter, posinf=0.0)
        # a manoeuvre that begins bends the lines; its steps grow gradually
        scores[row] = np.where(_stands_out(x), score, 0.0)
    return scores


def _stands_out(x: np.ndarray) -> np.ndarray:
    """Return whether the step after each sample is far larger than all steps next to it (time,)."""
    size = np.abs(np.diff(x, append=x[-1]))
    largest = np.zeros(len(x))
    for shift in (*range(-_SIDE + 1, 0), *range(1, _SIDE)):
        largest = np.maximum(largest, np.roll(size, shift))
    return size > _OUTSTANDING * largest


def _line_jumps(x: np.ndarray) -> np.ndarray:
    """Return the jump after each sample; NaN at the ends."""
    jump = np.full(len(x), np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(x, _SIDE)
    centred = np.arange(_SIDE) - 0.5 * (_SIDE - 1)
    mean, rise = windows.mean(axis=1), windows @ centred / (centred @ centred)
    # the lines are extended by half a step, to the middle between both samples
    reach = 0.5 * _SIDE
    before, after = slice(0, len(mean) - _SIDE), slice(_SIDE, len(mean))
    inside = slice(_SIDE - 1, len(x) - _SIDE)
    jump[inside] = mean[after] - reach * rise[after] - mean[before] - reach * rise[before]
    return jump


def _simultaneous(
    scores: np.ndarray, names: list[str], time: np.ndarray, known: pd.DataFrame
) -> list[int]:
    """Return the samples after which enough channels jump, the clearest one of neighbours."""
    large = scores > _SIGNIFICANT
    inertial = np.array([name in _INERTIAL for name in names])
    together = (large.sum(axis=0) >= _TOGETHER) & large[inertial].any(axis=0)
    together |= (scores[inertial] > _CLEAR).sum(axis=0) >= _PAIR
    step = np.diff(time, append=time[-1])
    together &= step < GAP * np.median(step)
    clear = np.sort(scores, axis=0)[-_PAIR]
    places: list[int] = []
    for i in np.flatnonzero(together):
        at_fault = (known["start"] - 1.0 < time[i]) & (time[i] < known["stop"] + 1.0)
        if at_fault.any():
            continue
        if places and i - places[-1] <= 2 * _SIDE:
            if clear[i] > clear[places[-1]]:
                places[-1] = int(i)
        else:
            places.append(int(i))
    return places
