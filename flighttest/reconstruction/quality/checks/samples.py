"""Checks of single channels: clock, missing and frozen samples, jumps, saturation and noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.names import lookup
from flightmech.quantities import time_text
from flightmech.support.arrays import true_runs
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.held_values import (
    DEVICES,
    channel_faults,
    iterate_channels,
    sixth_difference_noise,
    stuck_finding,
)
from flighttest.reconstruction.quality.checks.signals import unwrap_angle
from flighttest.reconstruction.quality.finding import Finding, iterate_rows
from flighttest.records.sensors.instruments import Instruments
from flighttest.records.signals.record_flags import flags
from flighttest.records.signals.resampling import GAP, is_control
from flighttest.records.signals.sample_flags import (
    Flag,
    flag_sentences,
)

NOISY = 3.0  # times the noise that the specification gives
_ALIKE = 3.0  # quotient of a noise and the one of the aircraft file in another unit
_JUMP = 25.0  # typical steps of a channel
_LARGE_JUMP, _FULL_JUMP = 0.15, 0.8  # of the range: a jump, and a counter that wraps
_EXTREME = 0.05  # of the range, within which a wrapped counter leaves one end and enters the other
_LEVEL, _FLAT = 8, 0.3  # samples at the level before or after a jump, and share of it they may move
_RUN_TIME = 0.1  # s at an extreme value that are a saturation
_SLOPE, _BREAK = 5, 0.5  # samples of a slope, and share of the typical step at which it breaks off
_RADIO = 0.01  # share of samples at the largest value of a radio altimeter
_TIMES = {"gap", "wrap", "stray", "duplicate", "reset"}
_ENDLESS = ("psi", "lon")  # wrap round by nature
# beginnings of the names of quantities that no aeroplane changes from one sample to the next
_ATTITUDE_AND_AIR = ("phi", "theta", "h_baro", "h_gps", "hdot", "V", "mach", "q_c", "p_static")
_LASTING = (
    *_ATTITUDE_AND_AIR,
    *("temperature", "vn", "ve", "vd", "north", "east", "lat"),
    *("fuel", "n1", "n2", "itt"),
)
_SPEEDS = ("V", "mach", "q_c")  # their smallest value, at rest, is not a saturation
_REMEDY = {
    "gap": "cut manoeuvres before or after it; split the file if another flight begins there",
    "wrap": "check the clock of the recorder",
    "stray": "check the clock of the recorder",
    "duplicate": "none needed; the later sample of each pair was dropped",
    "reset": "check that the joined parts belong together; split the file if they are two flights",
    "missing": "choose windows without them",
    "outside": "extend the calibration table, or choose windows without them",
    "held": "choose windows without them; the recorder repeated its last value",
    "spike": "choose windows without them, or repair the channel",
}


def faults_of(record: xr.DataTree) -> pd.DataFrame:
    """Return the flags of a record, with its samples checked again and clock jumps as gaps.

    Returns
    -------
    DataFrame
        Columns as of `flighttest.signals.flags`.
    """
    stored = flags(record)
    # the reader alone knows the faults of the clock and of the calibration
    of_reader = stored[stored["kind"].isin(_TIMES | {"outside"})]
    table: list[dict] = [dict(row) for _, row in of_reader.iterrows()]
    for leaf, node in record.children.items():
        time, rate = node.variables["time"].values, float(node.attrs["rate"])
        faults: list[Flag] = []
        if not (stored["leaf"].eq(leaf) & stored["kind"].eq("gap")).any():
            faults += _clock_gaps(time)
        for name, x in iterate_channels(node):
            faults += channel_faults(time, x, name, rate)
        table += [{"leaf": leaf, **flag._asdict()} for flag in faults]
    return pd.DataFrame(table, columns=stored.columns)


def _clock_gaps(time: np.ndarray) -> list[Flag]:
    step = np.diff(time)
    gaps = []
    for i in np.flatnonzero(step > GAP * np.median(step)):
        gaps.append(
            Flag(
                "",
                "gap",
                float(time[i]),
                stop=float(time[i + 1]),
                samples=0,
                note=f"{step[i]:.3g} s",
            )
        )
    return gaps


def flag_findings(faults: pd.DataFrame) -> list[Finding]:
    """Return one finding for each channel and kind of flag, and for clocks with the same flags.

    A recorder that stops leaves one gap in the clocks of all its groups of channels.
    """
    rows: dict[tuple[Any, ...], tuple[list[str], pd.DataFrame]] = {}
    for (leaf, channel, _), group in faults.groupby(["leaf", "channel", "kind"], sort=False):
        listed = tuple(Flag(*row) for row in group.drop(columns="leaf").itertuples(index=False))
        key = (listed, leaf) if channel else (listed,)
        leaves, _ = rows.setdefault(key, ([], group))
        leaves.append(str(leaf))
    findings = []
    for (listed, *_), (leaves, group) in rows.items():
        channel, kind = listed[0].channel, listed[0].kind
        finding = Finding(
            "note" if kind == "duplicate" else "warning",
            str(kind),
            (str(channel),) if channel else tuple(leaves),
            text=f"{', '.join(leaves)}: {' '.join(flag_sentences(listed))}",
            remedy=_REMEDY[str(kind)],
            start=float(group["start"].min()),
            stop=float(group["stop"].max()),
            evidence={"samples": int(group["samples"].sum()), "places": len(group)},
        )
        findings.append(finding)
    return findings


def channel_table(record: xr.DataTree) -> pd.DataFrame:
    """Return the range, noise and resolution of each channel.

    Returns
    -------
    DataFrame
        ``leaf channel rate start stop minimum maximum noise resolution repeated missing units``,
        SI. ``noise`` is the white part, NaN for controls and short channels. ``resolution`` is the
        smallest step. ``repeated`` is the share of samples that equal the one before.
    """
    table: list = []
    for leaf, node in record.children.items():
        time, rate = node.variables["time"].values, float(node.attrs["rate"])
        for name, x in iterate_channels(node):
            row = {
                "leaf": leaf,
                "channel": name,
                "rate": rate,
                "start": float(time[0]),
                "stop": float(time[-1]),
                **_describe_channel(x, name),
                "units": lookup(name).units,
            }
            table.append(row)
    return pd.DataFrame(table)


def _describe_channel(x: np.ndarray, name: str) -> dict[str, float]:
    """Return the figures of the samples of a channel, NaN where there are none."""
    size = np.abs(np.diff(x))
    moving = size[np.isfinite(size) & (size > 0.0)]
    finite = x[np.isfinite(x)]
    figures = {
        "minimum": np.nan,
        "maximum": np.nan,
        "noise": _white_noise(x, name),
        "resolution": np.nan,
        "repeated": np.nan,
        "missing": int(np.isnan(x).sum()),
    }
    if len(finite):
        figures["minimum"], figures["maximum"] = float(finite.min()), float(finite.max())
    if len(moving):
        figures["resolution"] = float(moving.min())
    if len(size):
        figures["repeated"] = float(np.mean(size == 0.0))
    return figures


def channel_findings(
    record: xr.DataTree, table: pd.DataFrame, specification: Instruments | None
) -> list[Finding]:
    """Return the faults of single channels beyond their flags."""
    findings: list[Finding] = []
    # a leaf by its name, without the search of a path for each channel
    leaves = dict(record.children)
    for row in iterate_rows(table):
        variables = leaves[row.leaf].variables
        time, x = variables["time"].values, variables[row.channel].values.astype(float)
        finite = np.isfinite(x)
        stuck = stuck_finding(row.channel, x)
        if stuck is None:
            findings += _jump_finding(time[finite], x[finite], row)
            findings += _saturation_findings(time[finite], x[finite], row)
        else:
            findings += stuck
        findings += _noise_finding(row, specification)
    return findings


def _white_noise(x: np.ndarray, name: str) -> float:
    """Return the standard deviation of the white noise of a channel; NaN if not determined.

    Sixth differences contain no motion, and their median ignores bursts and steps.
    """
    if is_control(name) or name in _ENDLESS or name.startswith(DEVICES):
        return float("nan")
    return sixth_difference_noise(x)


def _jump_finding(time: np.ndarray, x: np.ndarray, row) -> list[Finding]:
    """Return the jumps of a channel to another level.

    A jump between the two ends of the range is a counter that wraps.
    """
    if not row.channel.rpartition(".")[2].startswith(_LASTING):
        return []
    # A full turn of an angle is not a jump.
    x = unwrap_angle(row.channel.rpartition(".")[2], x)
    size = np.abs(np.diff(x))
    width = row.maximum - row.minimum
    large = np.flatnonzero(size > _JUMP * np.median(size[size > 0.0]))
    jumps = [i for i in large if size[i] > _LARGE_JUMP * width and _is_lasting_jump(x, int(i))]
    if not jumps:
        return []
    ends = np.sort(np.stack([x[jumps], x[np.array(jumps) + 1]]), axis=0)
    low, high = row.minimum + _EXTREME * width, row.maximum - _EXTREME * width
    between_ends = (ends[0] < low) & (ends[1] > high)
    places = ", ".join(f"{time_text(time[i])} s" for i in jumps[:5])
    if between_ends.all() and size[jumps].min() > _FULL_JUMP * width:
        severity, kind = "error", "wrap"
        text = f"{row.channel} runs over its range of about {width:.6g} {row.units} at {places}"
        remedy = "unwrap the channel before it is read"
    else:
        severity, kind = "warning", "jump"
        height = size[jumps[0]]
        text = f"{row.channel} jumps by {height:.4g} {row.units} and stays there, at {places}"
        remedy = "cut before or after it; check for a changed datum or range"
    finding = Finding(
        severity,
        kind,
        (row.channel,),
        text=text,
        remedy=remedy,
        start=float(time[jumps[0]]),
        stop=float(time[jumps[-1] + 1]),
        evidence={"jump": float(size[jumps[0]]), "places": len(jumps)},
    )
    return [finding]


def _is_lasting_jump(x: np.ndarray, i: int) -> bool:
    """Return whether both sides of the jump after sample `i` keep their level; a spike does not."""
    before, after = x[max(0, i - _LEVEL + 1) : i + 1], x[i + 1 : i + _LEVEL + 1]
    if len(before) <= 3 or len(after) <= 3:
        return False
    height = abs(x[i + 1] - x[i])
    return bool(max(np.ptp(before), np.ptp(after)) < _FLAT * height)


def _saturation_findings(time: np.ndarray, x: np.ndarray, row) -> list[Finding]:
    """Return the runs at exactly an extreme value that the channel enters or leaves with a
    slope.
    """
    name = row.channel.rpartition(".")[2]
    if row.repeated > 0.5 or name.startswith((*DEVICES, "throttle", "pla")):
        return _radio_height_finding(x, row)
    findings = []
    for extreme, word in ((row.maximum, "largest"), (row.minimum, "smallest")):
        if word == "smallest" and name.startswith(_SPEEDS):
            continue
        runs = _saturated_runs(x, extreme, row.rate)
        if not runs:
            continue
        total = sum(stop - start for start, stop in runs)
        first, last = float(time[runs[0][0]]), float(time[runs[-1][1] - 1])
        finding = Finding(
            "warning",
            "saturation",
            (row.channel,),
            text=(
                f"{row.channel} stays at its {word} value {extreme:.5g} {row.units} exactly, "
                f"{total} samples from {time_text(first)} s"
            ),
            remedy="the end of the instrument's range, or a stop; choose windows without it",
            start=first,
            stop=last,
            evidence={"samples": total, "value": extreme},
        )
        findings.append(finding)
    return findings


def _saturated_runs(x: np.ndarray, extreme: float, rate: float) -> list[tuple[int, int]]:
    """Return the starts and stops of the runs at an extreme value that interrupt a slope."""
    needed = max(4, round(_RUN_TIME * rate))
    typical = np.median(np.abs(np.diff(x))[np.diff(x) != 0.0])
    runs = []
    for start, stop in true_runs(x == extreme):
        if stop - start >= needed and _interrupts_slope(x, start, stop, typical):
            runs.append((start, stop))
    return runs


def _interrupts_slope(x: np.ndarray, start: int, stop: int, typical: float) -> bool:
    """Return whether the channel moved, on the average of five samples, before or after a run."""
    last = stop - 1
    before, after = 0.0, 0.0
    if start >= _SLOPE:
        before = abs(x[start] - x[start - _SLOPE]) / _SLOPE
    if last + _SLOPE < len(x):
        after = abs(x[last + _SLOPE] - x[last]) / _SLOPE
    return max(before, after) > _BREAK * typical


def _radio_height_finding(x: np.ndarray, row) -> list[Finding]:
    share = np.mean(x == row.maximum)
    if row.channel != "h_radio" or share < _RADIO:
        return []
    text = f"h_radio holds its largest value, {row.maximum:.5g} m, in {share:.0%} of all samples"
    remedy = "give the altimeter's `maximum` in the aircraft file"
    return [Finding("note", "saturation", ("h_radio",), text, remedy=remedy)]


def _noise_finding(row, specification: Instruments | None) -> list[Finding]:
    if specification is None or not specification.name_of(row.channel):
        return []
    if not np.isfinite(row.noise):
        return []
    allowed = specification.noise(row.channel)
    if row.noise <= NOISY * allowed:
        return _degrees_finding(row, allowed)
    text = (
        f"noise of {row.channel} is {row.noise:.3g} {row.units}, {row.noise / allowed:.1f} "
        f"times the {allowed:.3g} of the aircraft file"
    )
    remedy = "check the sensor, or give its true noise in the aircraft file"
    evidence = {"noise": row.noise, "specified": allowed}
    return [Finding("warning", "noise", (row.channel,), text, remedy=remedy, evidence=evidence)]


def _degrees_finding(row, allowed: float) -> list[Finding]:
    """Return the warning on a noise of the aircraft file that is degrees without their unit."""
    is_angle = row.units in ("rad", "rad s-1")
    if not is_angle or not 1.0 / _ALIKE < row.noise / (allowed * DEGREE) < _ALIKE:
        return []
    text = (
        f"noise of {row.channel} is {row.noise:.3g} {row.units}, and the aircraft file has "
        f"{allowed:.3g}, as if the number were in deg"
    )
    unit = "deg" if row.units == "rad" else "deg/s"
    remedy = f"write the unit, such as '{allowed:g} {unit}': a number without one is in {row.units}"
    evidence = {"noise": row.noise, "specified": allowed}
    return [Finding("warning", "noise", (row.channel,), text, remedy, evidence=evidence)]
