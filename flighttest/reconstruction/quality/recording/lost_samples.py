"""Samples lost by a recorder whose clock was then renumbered.

Attitude, height and velocity are continuous.  Where samples are missing and the clock does not show
it, those that move jump at one instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import unwrap_angle
from flighttest.reconstruction.quality.finding import Finding
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked
from flighttest.records.signals.resampling import GAP

_ATTITUDE = ("phi", "theta", "psi")
_NAVIGATED = ("vn", "ve", "vd", "h_gps", "hdot")
_INERTIAL = (*_ATTITUDE, *_NAVIGATED, "h_baro")
_CONTINUOUS = (*_INERTIAL, "V", "V_cas", "mach", "alpha_vane", "beta_vane")
# No correction moves these.  A shock does, so that alone they show no loss.
_MOTION = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
_CHANNELS = (*_CONTINUOUS, *_MOTION)
_SIDE = 4  # samples of the straight line on either side
_AROUND = 4.0  # s of neighbours whose scatter a jump is compared with
# multiples of the scatter, and channels that jump together; two of motion suffice if they are clear
_SIGNIFICANT, _TOGETHER = 6.0, 3
_CLEAR, _PAIR = 8.0, 2
_OUTSTANDING = 2.0  # times the largest neighbouring step
_TO_SIGMA = 1.4826  # standard deviation of a normal variable over its median absolute value
_NEAR = 2.0  # samples between jumps of one instant
# Share of samples of a channel that repeat the one before. At half the rate of the clock it is
# half, give or take one sample; such a channel still shows jumps.
_MOST_REPEATED = 0.55
_MOST_NAMED = 5
_MOST_CHANNELS = 0.6  # share of the continuous channels that jump where another flight begins
# least jump that is another flight, its unit and its size
_OTHER_FLIGHT = {
    "h_baro": (10.0, "m", 1.0),
    "h_gps": (10.0, "m", 1.0),
    "V": (3.0, "m/s", 1.0),
    "V_cas": (3.0, "m/s", 1.0),
    "psi": (10.0 * DEGREE, "deg", DEGREE),
}


@dataclass(frozen=True)
class ClockJumps:
    """Jumps of the channels of one clock.

    Attributes
    ----------
    leaves : list of str
    names : list of str
        Channels that can show a jump.
    values : array (channel, time)
        These channels. [SI]
    time : array (time,)
        [s]
    scores : array (channel, time)
        Jumps after each sample over their scatter.
    """

    leaves: list[str]
    names: list[str]
    values: np.ndarray
    time: np.ndarray
    scores: np.ndarray

    def jumping(self, time: float) -> list[str]:
        """Return the channels that jump within a few samples of an instant. [s]"""
        reach = 1.5 * _NEAR * float(np.median(np.diff(self.time)))
        near = np.abs(self.time - time) < reach
        if not near.any():
            return []
        largest = self.scores[:, near].max(axis=1)
        pairs = zip(self.names, largest.tolist(), strict=True)
        return [name for name, score in pairs if score > _SIGNIFICANT]


def lost_samples(record: xr.DataTree, faults: pd.DataFrame) -> tuple[list[Finding], pd.DataFrame]:
    """Return the findings on lost samples and on corrections, and flags of their instants.

    Lost samples move attitude, trajectory, and rates or specific force. A jump of the attitude
    alone, or of the trajectory alone, is a correction of the unit that measures it, if the others
    have the same clock. A recorder on a clock of its own loses its samples alone.

    Parameters
    ----------
    record : DataTree
    faults : DataFrame
        Result of `faults_of`. Jumps at a fault of the clock or of samples are not reported again.

    Returns
    -------
    findings : list of Finding
        An error for each clock with lost samples, a warning for corrections.
    flags : DataFrame
        Rows with the columns of `faults`, of the kind ``lost`` or ``correction``.
    """
    clocks = []
    for leaves in _leaves_by_clock(record):
        signals = _moving_channels(record, leaves)
        time = _clock_of(record, leaves[0])
        if signals and len(time) >= 8 * _SIDE:
            values = np.stack(list(signals.values()))
            scores = _jump_scores(signals, time)
            clocks.append(ClockJumps(leaves, list(signals), values, time=time, scores=scores))
    findings, flags = [], []
    for clock in clocks:
        known = faults[faults["leaf"].isin(clock.leaves) & (faults["kind"] != "duplicate")]
        jumps: dict[str, list[tuple[int, list[str]]]] = {}
        for i in _simultaneous(clock.scores, clock.names, clock.time, known):
            instant = float(clock.time[i])
            # the channels of a recorder may have several clocks
            names = list(chain.from_iterable(other.jumping(instant) for other in clocks))
            kind = _kind_of_jump(names, clock.names)
            jumps.setdefault(kind, []).append((i, names))
            flag = "lost" if kind == "lost" else "correction"
            stop = float(clock.time[i + 1])
            for leaf in clock.leaves:
                flags.append((leaf, "", flag, instant, stop, 0, ""))
        for kind, places in jumps.items():
            findings.append(_jump_finding(kind, places, clock))
    return findings, pd.DataFrame(flags, columns=faults.columns)


def lost_not_checked(record: xr.DataTree) -> Unchecked:
    """Return the row on lost samples that no jump shows."""
    held = []
    for node in record.children.values():
        channels = node.to_dataset()
        for name in _CONTINUOUS:
            if name in channels and _is_held(channels[name].values):
                held.append(name)
    reason = "attitude, height and speed do not jump there: compare the length with another clock"
    if held:
        reason += f"; {', '.join(held)} cannot jump, since they repeat most of their samples"
    return [("lost_samples", "samples lost in steady flight", (), reason)]


def _moving_channels(record: xr.DataTree, leaves: list[str]) -> dict[str, np.ndarray]:
    """Return the channels of leaves that can show a jump.

    A channel that repeats most of its samples jumps at each new one.
    """
    signals = {}
    for leaf in leaves:
        data = record[leaf].to_dataset()
        for name in _CHANNELS:
            if name in data and not _is_held(data[name].values):
                signals[name] = data[name].values.astype(float)
    return signals


def _is_held(recorded: np.ndarray) -> bool:
    """Return whether most samples of a channel repeat the one before."""
    return bool(np.mean(np.diff(recorded.astype(float)) == 0.0) > _MOST_REPEATED)


def _groups_of(names: list[str]) -> set[str]:
    """Return which of ``attitude``, ``trajectory`` and ``motion`` channels belong to."""
    groups = set()
    for name in names:
        if name in _ATTITUDE:
            groups.add("attitude")
        else:
            groups.add("motion" if name in _MOTION else "trajectory")
    return groups


def _kind_of_jump(names: list[str], recorded: list[str]) -> str:
    """Return ``lost``, or what was corrected: ``attitude``, ``navigation`` or ``air``.

    Parameters
    ----------
    names : list of str
        Channels that jump.
    recorded : list of str
        Channels of the clock. A channel of another clock does not lose the same samples, so that
        its rest shows nothing.
    """
    jumping = _groups_of(names)
    if len(jumping) >= 2 or _groups_of(recorded) <= jumping:
        return "lost"
    if "attitude" in jumping:
        return "attitude"
    return "navigation" if any(name in _NAVIGATED for name in names) else "air"


def _jump_finding(kind: str, places: list[tuple[int, list[str]]], clock: ClockJumps) -> Finding:
    """Return the finding on jumps of one kind after samples of a clock."""
    time, groups = clock.time, _groups_of(clock.names)
    indices = [i for i, _ in places]
    channels = tuple(dict.fromkeys(chain.from_iterable(names for _, names in places)))
    listed = ", ".join(f"{time[i]:.2f} s" for i in indices[:_MOST_NAMED])
    if len(indices) > _MOST_NAMED:
        listed += f" and {len(indices) - _MOST_NAMED} more"
    subject = ", ".join(channels)
    remedy = "cut manoeuvres before or after the instant"
    if kind == "lost":
        severity, name = "error", "lost"
        text = f"samples lost at t = {listed}: {subject} jump at one instant, and the clock runs on"
        if len(groups) == 1 and groups == _groups_of(list(channels)):
            text += "; or their unit was corrected: the clock has no other channels that show it"
        remedy = f"restore the clock of the recorder; else {remedy}"
        flights = _flights_text(clock, indices)
        if flights:
            text += f"; or another flight begins there: {flights}"
            remedy += ", and split a file that holds two flights there"
    else:
        severity, name = "warning", "correction"
        cause = (
            "a fault of the air data" if kind == "air" else "a correction of the navigation unit"
        )
        witness = "trajectory" if kind == "attitude" else "attitude"
        steady = "height and speed" if kind == "attitude" else "attitude"
        other = f"{'height and speed do' if kind == 'attitude' else 'the attitude does'} not"
        if witness not in groups:
            # rates alone do not jump where samples are lost in a steady turn
            cause = f"{cause}, or lost samples"
            other = f"no {steady} of this clock shows which it is"
        text = f"{subject} jump at t = {listed}, and {other}: {cause}"
        remedy += (
            f"; samples lost at steady {steady} look the same, so compare the length of the record "
            f"with another clock"
        )
    return Finding(
        severity,
        name,
        channels,
        text,
        remedy=remedy,
        start=float(time[indices[0]]),
        stop=float(time[indices[-1] + 1]),
        evidence={"places": len(indices)},
    )


def _flights_text(clock: ClockJumps, indices: list[int]) -> str:
    """Return the jumps that a few lost samples do not make; empty without them.

    Most channels jump, and one of height, speed and heading by more than it moves in seconds.
    """
    shown = []
    for i in indices:
        jumping = clock.scores[:, max(i - 1, 0) : i + 2].max(axis=1) > _SIGNIFICANT
        able = np.array([name in _CONTINUOUS for name in clock.names])
        if np.mean(jumping[able]) < _MOST_CHANNELS:
            continue
        for name, (least, unit, size) in _OTHER_FLIGHT.items():
            if name not in clock.names:
                continue
            x = unwrap_angle(name, clock.values[clock.names.index(name)])
            step = float(x[i + 1] - x[i])
            if name == "psi":
                step = float((step + np.pi) % (2.0 * np.pi) - np.pi)
            if abs(step) > least:
                shown.append(f"{name} by {step / size:+.3g} {unit} at {clock.time[i]:.2f} s")
    return ", ".join(shown[:_MOST_NAMED])


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
    rows = [i for i, name in enumerate(names) if name in _CONTINUOUS]
    if len(rows) < _TOGETHER:
        return []
    scores, names = scores[rows], [names[i] for i in rows]
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
