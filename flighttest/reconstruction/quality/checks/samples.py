"""Checks of single channels: clock, missing and frozen samples, jumps, saturation and noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.controls import ICE
from flightmech.names import lookup
from flightmech.support.arrays import true_runs
from flighttest.reconstruction.quality.checks.signals import unwrap_angle
from flighttest.reconstruction.quality.finding import Finding, iterate_rows
from flighttest.records.sensors.instruments import Instruments
from flighttest.records.signals.record_flags import flags
from flighttest.records.signals.resampling import GAP, is_control
from flighttest.records.signals.sample_flags import (
    HELD_SAMPLES,
    HELD_TIME,
    Flag,
    flag_sentences,
    sample_faults,
)

NOISY = 3.0  # times the noise that the specification gives
# ratio of the noise to the typical step, above which the noise changes every sample
_RESTLESS = 0.3
_DIFFERENCE, _ENOUGH = 6, 50  # order of the differences that show noise only, and their number
_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal variable
_NEIGHBOURS = 20  # steps next to a run that show whether the channel moves there
_LIVELY = 0.3  # share of the typical step that these must have
_JUMP = 25.0  # typical steps of a channel
_LARGE_JUMP, _FULL_JUMP = 0.15, 0.8  # of the range: a jump, and a counter that wraps
_EXTREME = 0.05  # of the range, within which a wrapped counter leaves one end and enters the other
_LEVEL, _FLAT = 8, 0.3  # samples at the level before or after a jump, and share of it they may move
_RUN_TIME = 0.1  # s at an extreme value that are a saturation
_SLOPE, _BREAK = 5, 0.5  # samples of a slope, and share of the typical step at which it breaks off
_RADIO = 0.01  # share of samples at the largest value of a radio altimeter
_TIMES = {"gap", "wrap", "stray", "duplicate", "reset"}
_DEVICES = (
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
        data = node.to_dataset()
        faults: list[Flag] = []
        if not (stored["leaf"].eq(leaf) & stored["kind"].eq("gap")).any():
            faults += _clock_gaps(data["time"].values)
        for name in map(str, data.data_vars):
            faults += _channel_faults(data, name)
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


def _channel_faults(data: xr.Dataset, name: str) -> list[Flag]:
    """Return the faults of the samples of a channel, and the frozen runs among the others."""
    time, x = data["time"].values, data[name].values.astype(float)
    rate = float(data.attrs["rate"])
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
    size = np.abs(np.diff(x))
    typical = np.inf
    if (size > 0.0).any():
        typical = float(np.median(size[size > 0.0]))
    needed = max(HELD_SAMPLES, HELD_TIME * rate)
    still_runs = true_runs(np.concatenate([[False], size == 0.0]))
    long_runs = [(start, stop) for start, stop in still_runs if stop - start >= needed]
    # Controls and headings may move without noise. The ones with noise do not rest for long.
    # The noise is that between the runs: a channel may be held for most of a record.
    noise = np.nan
    if long_runs and not name.rpartition(".")[2].startswith(_DEVICES):
        moving = np.ones(len(x), bool)
        for start, stop in long_runs:
            moving[start:stop] = False
        noise = _sixth_difference_noise(unwrap_angle(name, x[moving]))
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
        data = node.to_dataset()
        time, rate = data["time"].values, float(data.attrs["rate"])
        for name in map(str, data.data_vars):
            row = {
                "leaf": leaf,
                "channel": name,
                "rate": rate,
                "start": float(time[0]),
                "stop": float(time[-1]),
                **_describe_channel(data[name].values.astype(float), name),
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
    for row in iterate_rows(table):
        data = record[row.leaf].to_dataset()
        time, x = data["time"].values, data[row.channel].values.astype(float)
        finite = np.isfinite(x)
        if not finite.any():
            text = f"{row.channel} holds no number at all"
            remedy = "check the column of the name map"
            findings.append(Finding("error", "stuck", (row.channel,), text, remedy=remedy))
        elif row.minimum == row.maximum:
            findings += _stuck_finding(row)
        else:
            findings += _jump_finding(time[finite], x[finite], row)
            findings += _saturation_findings(time[finite], x[finite], row)
        findings += _noise_finding(row, specification)
    return findings


def _white_noise(x: np.ndarray, name: str) -> float:
    """Return the standard deviation of the white noise of a channel; NaN if not determined.

    Sixth differences contain no motion, and their median ignores bursts and steps.
    """
    if is_control(name) or name in _ENDLESS or name.startswith(_DEVICES):
        return float("nan")
    return _sixth_difference_noise(x)


def _sixth_difference_noise(x: np.ndarray) -> float:
    """Return the standard deviation of the white noise of a time history; NaN if it is short."""
    sixth = np.abs(np.diff(x, _DIFFERENCE))
    sixth = sixth[np.isfinite(sixth)]
    if len(sixth) < _ENOUGH:
        return float("nan")
    # the n-th difference of white noise has comb(2n, n) times its variance
    growth = math.sqrt(math.comb(2 * _DIFFERENCE, _DIFFERENCE))
    return float(np.median(sixth) / (_MEDIAN_OF_NORMAL * growth))


def _stuck_finding(row) -> list[Finding]:
    # A whole flight may be clean or iced.
    if row.channel == ICE or row.channel.rpartition(".")[2].startswith(_DEVICES):
        return []
    text = f"{row.channel} never changes from {row.minimum:.6g} {row.units}"
    remedy = "check sensor, wiring and column; leave the channel out of the name map if it is dead"
    severity = "note" if is_control(row.channel) else "error"
    return [Finding(severity, "stuck", (row.channel,), text, remedy=remedy)]


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
    places = ", ".join(f"{time[i]:g} s" for i in jumps[:5])
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
    if row.repeated > 0.5 or name.startswith((*_DEVICES, "throttle", "pla")):
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
                f"{total} samples from {first:g} s"
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
        return []
    text = (
        f"noise of {row.channel} is {row.noise:.3g} {row.units}, {row.noise / allowed:.1f} "
        f"times the {allowed:.3g} of the aircraft file"
    )
    remedy = "check the sensor, or give its true noise in the aircraft file"
    evidence = {"noise": row.noise, "specified": allowed}
    return [Finding("warning", "noise", (row.channel,), text, remedy=remedy, evidence=evidence)]
