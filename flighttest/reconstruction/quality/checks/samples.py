"""Each channel by itself: clock, missing, held and wild samples, wrap-around, saturation, a dead
sensor, noise and resolution.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.names import lookup
from flightmech.units import DEGREE, KNOT
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, iterate_rows
from flighttest.records.sensors.instruments import Instruments
from flighttest.records.signals.conditioning import GAP, is_control
from flighttest.records.signals.sample_flags import (
    HELD_SAMPLES,
    HELD_TIME,
    Flag,
    flag_sentences,
    flags,
    sample_faults,
)

COARSE = 0.4  # share of samples that repeat the one before
_ABSENT = (  # any one of these is enough, what it is for
    (("psi",), "heading: wind and heading rate cannot be checked"),
    (("beta_vane", "beta"), "sideslip: it follows from side force and rates only"),
    (("alpha_vane", "alpha"), "angle of attack: it follows from attitude, climb and airspeed only"),
    (
        ("vn", "north", "lat"),
        "ground velocity: wind and specific force cannot be checked against it",
    ),
    (("ax_imu", "ax"), "specific force: no force coefficients without it"),
    (("temperature",), "temperature: density and true airspeed rest on an assumption"),
    (("V", "V_cas", "mach", "q_c"), "airspeed"),
    (("delta_f",), "flaps"),
)
_OFF_CENTRE = 0.8 * DEGREE
_STRAIGHT_BANK, _STRAIGHT_RATE = 5.0 * DEGREE, 0.5 * DEGREE  # rad, rad/s
_CLOSE = 4.0 * DEGREE  # rms within which a vane means something
_BIN = 5.0  # m/s


def quality_remarks(
    signals: ResampledChannels,
    table: pd.DataFrame,
    comparisons: dict[str, RelationCheck],
    recorded: ResampledChannels,
) -> list[Finding]:
    """Return notes on a record.

    Parameters
    ----------
    signals : Signals
        Mistakes undone.
    table : DataFrame
        Of `channel_table`.
    comparisons : dict of Comparison
        Of `explain`.
    recorded : Signals
        As recorded.
    """
    return (
        _absent(recorded)
        + _coarse(table)
        + _off_centre(signals)
        + _minimum_speed(signals, comparisons)
    )


def _absent(signals: ResampledChannels) -> list[Finding]:
    missing = [(names, why) for names, why in _ABSENT if not any(name in signals for name in names)]
    if not missing:
        return []
    text = "not in the record: " + "; ".join(why for _, why in missing)
    return [
        Finding(
            "note",
            "absent",
            tuple(names[0] for names, _ in missing),
            text,
            "check the name map if the file has them",
        )
    ]


def _coarse(table: pd.DataFrame) -> list[Finding]:
    found = []
    for row in iterate_rows(table):
        if np.isfinite(row.noise) and COARSE < row.repeated < 1.0:
            text = (
                f"{row.channel} repeats {row.repeated:.0%} of its samples: it is recorded at "
                f"{row.rate:g} Hz "
                "and changes far less often, or in coarse steps"
            )
            found.append(
                Finding(
                    "note",
                    "coarse",
                    (row.channel,),
                    text,
                    "do not differentiate it; its bandwidth is below that of the recorder",
                )
            )
    return found


def _off_centre(signals: ResampledChannels) -> list[Finding]:
    """Mean of aileron and rudder in straight, level flight."""
    if not {"phi", "p", "r"} <= set(signals.values):
        return []
    found = []
    for name in {"delta_a", "delta_r"} & set(signals.values):
        mask = signals.mask((name, "phi", "p", "r"))
        mask &= (np.abs(signals["phi"]) < _STRAIGHT_BANK) & (
            np.hypot(signals["p"], signals["r"]) < _STRAIGHT_RATE
        )
        if (
            mask.sum() * signals.step < 30.0
            or abs(middle := float(np.median(signals[name][mask]))) < _OFF_CENTRE
        ):
            continue
        text = (
            f"{name} stands at {middle / DEGREE:+.1f} deg in straight flight: bias of the "
            f"pick-up, trim or an asymmetry"
        )
        remedy = "let regressions have an intercept; calibrate the pick-up with the surface centred"
        found.append(Finding("note", "offset", (name,), text, remedy, evidence={"offset": middle}))
    return found


def _minimum_speed(
    signals: ResampledChannels, comparisons: dict[str, RelationCheck]
) -> list[Finding]:
    """Speed below which the alpha vane does not follow attitude and climb, on the ground included."""
    if "vane" not in comparisons:
        return []
    c = comparisons["vane"]
    apart, speed = np.abs(c.first - c.second - c.offset), signals.completed(("V",))["V"]
    limit = 0.0
    for edge in np.arange(0.0, float(np.percentile(speed, 99.0)), _BIN):
        inside = (speed >= edge) & (speed < edge + _BIN)
        if inside.any() and np.sqrt(np.mean(apart[inside] ** 2)) < _CLOSE:
            break
        limit = edge + _BIN
    if not limit or limit > 0.6 * float(np.median(speed[signals.flying])):
        return []
    text = (
        f"alpha_vane means nothing below about {limit:.0f} m/s ({limit / KNOT:.0f} kt): it "
        f"does not follow attitude and climb there"
    )
    return [
        Finding(
            "note",
            "minimum_speed",
            ("alpha_vane",),
            text,
            "give minimum_speed of the vane in the aircraft file",
            evidence={"speed": limit},
        )
    ]


NOISY = 3.0  # times the noise that the specification gives
_RESTLESS = (
    0.3  # noise over the typical step in a channel that moves by its noise from sample to sample
)
_DIFFERENCE, _ENOUGH = 6, 50  # order of the differences that show noise only, and how many of them
_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal variable
_JUMP = 25.0  # typical steps of a channel
_EXTREME = 0.05  # of the range: so near its ends a wrapped counter leaves and comes back
_TIMES = {"gap", "wrap", "stray", "duplicate", "reset"}
_DEVICES = (
    "gear",
    "speedbrake",
    "brake",
    "wow_",
    "delta_f",
    "delta_t",
    "mass",
    "x_cg",
    "y_cg",
    "z_cg",
    "I",
)
_ENDLESS = ("psi", "lon")  # wrap round by nature
_LASTING = (  # what no aeroplane changes from one sample to the next
    "phi", "theta", "h_baro", "h_gps", "hdot", "V", "mach", "q_c", "p_static", "temperature", "vn", "ve", "vd", "north", "east", "lat",
    "fuel", "n1", "n2", "itt",
)  # fmt: skip
_SPEEDS = ("V", "mach", "q_c")  # their smallest value, at rest, means nothing
_REMEDY = {
    "gap": "cut manoeuvres before or after it",
    "wrap": "check the clock of the recorder",
    "stray": "check the clock of the recorder",
    "duplicate": "none needed; the later sample of each pair was dropped",
    "reset": "check that the joined parts belong together",
    "missing": "choose windows without them",
    "outside": "extend the calibration table, or choose windows without them",
    "held": "choose windows without them; the recorder repeated its last value",
    "spike": "choose windows without them, or repair the channel",
}


def faults_of(record: xr.DataTree) -> pd.DataFrame:
    """Return the flags of a record, those of its samples found anew, with jumps of the clock as
    gaps.

    Returns
    -------
    DataFrame
        Columns as of `flighttest.signals.flags`.
    """
    known = flags(record)
    table: list[dict] = [
        dict(row) for _, row in known[known["kind"].isin(_TIMES | {"outside"})].iterrows()
    ]
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values
        step = np.diff(time)
        if not (known["leaf"].eq(leaf) & known["kind"].eq("gap")).any():
            wide = np.flatnonzero(step > GAP * np.median(step))
            gaps = [
                Flag("", "gap", float(time[i]), float(time[i + 1]), 0, f"{step[i]:.3g} s")
                for i in wide
            ]
            table += [{"leaf": leaf, **flag._asdict()} for flag in gaps]
        for name in map(str, data.data_vars):
            x, rate = data[name].values.astype(float), float(data.attrs["rate"])
            found = sample_faults(time, x, name, rate)
            frozen = [
                flag
                for flag in _frozen(time, x, name, rate)
                if not any(_overlap(flag, other) for other in found)
            ]
            table += [{"leaf": leaf, **flag._asdict()} for flag in [*found, *frozen]]
    return pd.DataFrame(table, columns=known.columns)


def _frozen(time: np.ndarray, x: np.ndarray, name: str, rate: float) -> list[Flag]:
    """Return the runs of equal samples in a channel whose noise never lets it rest; its ends of
    range are another matter.
    """
    size = np.abs(np.diff(x))
    typical = float(np.median(size[size > 0.0])) if (size > 0.0).any() else np.inf
    if not _noise(x, name) > _RESTLESS * typical:
        return []
    still = np.concatenate([[False], size == 0.0]) & (x != np.nanmax(x)) & (x != np.nanmin(x))
    needed = max(HELD_SAMPLES, HELD_TIME * rate)
    return [
        Flag(name, "held", float(time[a - 1]), float(time[b - 1]), b - a + 1)
        for a, b in _runs(still)
        if b - a >= needed and _lively(size, a, b, typical)
    ]


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return first sample and first sample behind of every run of a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]


def _lively(size: np.ndarray, start: int, stop: int, typical: float) -> bool:
    """Whether the channel moves as it always does on both sides of a run: a parked aeroplane rests
    before and after, too.
    """
    return all(
        len(part) > 0 and float(np.median(part)) > 0.3 * typical
        for part in (size[max(0, start - 21) : start - 1], size[stop : stop + 20])
    )


def _overlap(one: Flag, other: Flag) -> bool:
    return other.kind == one.kind and other.start <= one.stop and one.start <= other.stop


def flag_findings(faults: pd.DataFrame) -> list[Finding]:
    """Return one finding for each channel (or clock) and kind of flag."""
    found = []
    for (leaf, channel, kind), group in faults.groupby(["leaf", "channel", "kind"], sort=False):
        listed = [Flag(*row) for row in group.drop(columns="leaf").itertuples(index=False)]
        text = f"{leaf}: {' '.join(flag_sentences(listed))}"
        severity = "note" if kind == "duplicate" else "warning"
        span = float(group["start"].min()), float(group["stop"].max())
        evidence = {"samples": int(group["samples"].sum()), "places": len(group)}
        found.append(
            Finding(
                severity,
                str(kind),
                (str(channel or leaf),),
                text,
                _REMEDY[str(kind)],
                *span,
                evidence,
            )
        )
    return found


def channel_table(record: xr.DataTree) -> pd.DataFrame:
    """Return one row per channel: ``leaf channel rate start stop minimum maximum noise resolution
    repeated missing units``.

    ``noise`` is what is white, NaN for controls and short channels; ``resolution`` the smallest
    step, ``repeated`` the share of samples that equal the one before.  All SI.
    """
    table: list = []
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time, rate = data["time"].values, float(data.attrs["rate"])
        for name in map(str, data.data_vars):
            x = data[name].values.astype(float)
            size = np.abs(np.diff(x))
            moving = size[np.isfinite(size) & (size > 0.0)]
            finite = x[np.isfinite(x)]
            table.append(
                {
                    "leaf": leaf, "channel": name, "rate": rate, "start": float(time[0]), "stop": float(time[-1]),
                    "minimum": float(finite.min()) if len(finite) else np.nan,
                    "maximum": float(finite.max()) if len(finite) else np.nan,
                    "noise": _noise(x, name),
                    "resolution": float(moving.min()) if len(moving) else np.nan,
                    "repeated": float(np.mean(size == 0.0)) if len(size) else np.nan,
                    "missing": int(np.isnan(x).sum()),
                    "units": lookup(name).units,
                }
            )  # fmt: skip
    return pd.DataFrame(table)


def channel_findings(
    record: xr.DataTree, table: pd.DataFrame, specification: Instruments | None
) -> list[Finding]:
    """Return what is wrong with single channels beyond their flags."""
    found: list[Finding] = []
    for row in iterate_rows(table):
        data = record[row.leaf].to_dataset()
        time, x = data["time"].values, data[row.channel].values.astype(float)
        whole = np.isfinite(x)
        if not whole.any():
            found.append(
                Finding(
                    "error",
                    "stuck",
                    (row.channel,),
                    f"{row.channel} holds no number at all",
                    "check the column of the name map",
                )
            )
        elif row.minimum == row.maximum:
            found += _stuck(row)
        else:
            found += _wrap(time[whole], x[whole], row) + _saturation(time[whole], x[whole], row)
        found += _noisy(row, specification)
    return found


def _noise(x: np.ndarray, name: str) -> float:
    """Return the size of white noise from sixth differences, by their median: motion, its bursts
    and steps have no part in it.
    """
    if is_control(name) or name in _ENDLESS or name.startswith(_DEVICES):
        return float("nan")
    sixth = np.abs(np.diff(x, _DIFFERENCE))
    sixth = sixth[np.isfinite(sixth)]
    if len(sixth) < _ENOUGH:
        return float("nan")
    return float(
        np.median(sixth) / (_MEDIAN_OF_NORMAL * math.sqrt(math.comb(2 * _DIFFERENCE, _DIFFERENCE)))
    )


def _stuck(row) -> list[Finding]:
    if row.channel.rpartition(".")[2].startswith(_DEVICES):
        return []
    text = f"{row.channel} never changes from {row.minimum:.6g} {row.units}"
    remedy = "check sensor, wiring and column; leave the channel out of the name map if it is dead"
    return [
        Finding(
            "note" if is_control(row.channel) else "error", "stuck", (row.channel,), text, remedy
        )
    ]


def _wrap(time: np.ndarray, x: np.ndarray, row) -> list[Finding]:
    """A jump between the two ends of the range is a counter that ran over; any other one that stays
    is a jump.
    """
    if not row.channel.rpartition(".")[2].startswith(_LASTING):
        return []
    step = np.diff(x)
    size = np.abs(step)
    at = np.flatnonzero(size > _JUMP * np.median(size[size > 0.0]))
    width = row.maximum - row.minimum
    kept = [int(i) for i in at if size[i] > 0.15 * width and _stays(x, int(i))]
    if not kept:
        return []
    at = np.array(kept)
    low, high = row.minimum + _EXTREME * width, row.maximum - _EXTREME * width
    ends = np.sort(np.stack([x[at], x[at + 1]]), axis=0)
    around = (ends[0] < low) & (ends[1] > high)
    places = ", ".join(f"{time[i]:g} s" for i in at[:5])
    evidence = {"jump": float(size[at[0]]), "places": len(at)}
    span = float(time[at[0]]), float(time[at[-1] + 1])
    if around.all() and size[at].min() > 0.8 * width:
        text = f"{row.channel} runs over its range of about {width:.6g} {row.units} at {places}"
        return [
            Finding(
                "error",
                "wrap",
                (row.channel,),
                text,
                "unwrap the channel before it is read",
                *span,
                evidence,
            )
        ]
    text = f"{row.channel} jumps by {size[at[0]]:.4g} {row.units} and stays there, at {places}"
    return [
        Finding(
            "warning",
            "jump",
            (row.channel,),
            text,
            "cut before or after it; check for a changed datum or range",
            *span,
            evidence,
        )
    ]


def _stays(x: np.ndarray, i: int) -> bool:
    """Whether a jump after sample `i` is no spike: both sides keep their level for eight samples."""
    before, after = x[max(0, i - 7) : i + 1], x[i + 1 : i + 9]
    apart = abs(x[i + 1] - x[i])
    return bool(
        len(before) > 3 and len(after) > 3 and max(np.ptp(before), np.ptp(after)) < 0.3 * apart
    )


def _saturation(time: np.ndarray, x: np.ndarray, row) -> list[Finding]:
    """Runs at exactly the largest or smallest value, entered with a slope that then breaks off."""
    name = row.channel.rpartition(".")[2]
    if row.repeated > 0.5 or name.startswith((*_DEVICES, "throttle", "pla")):
        return _radio(x, row)
    needed = max(4, round(0.1 * row.rate))
    typical = np.median(np.abs(np.diff(x))[np.diff(x) != 0.0])
    found = []
    for extreme, word in ((row.maximum, "largest"), (row.minimum, "smallest")):
        runs = [
            (a, b) for a, b in _runs(x == extreme) if b - a >= needed and _breaks(x, a, b, typical)
        ]
        if not runs or (word == "smallest" and name.startswith(_SPEEDS)):
            continue
        total, first, last = (
            sum(b - a for a, b in runs),
            float(time[runs[0][0]]),
            float(time[runs[-1][1] - 1]),
        )
        text = (
            f"{row.channel} stays at its {word} value {extreme:.5g} {row.units} exactly, "
            f"{total} samples from {first:g} s"
        )
        remedy = "the end of the instrument's range, or a stop; choose windows without it"
        evidence = {"samples": total, "value": extreme}
        found.append(
            Finding("warning", "saturation", (row.channel,), text, remedy, first, last, evidence)
        )
    return found


def _breaks(x: np.ndarray, first: int, behind: int, typical: float) -> bool:
    """Whether the channel moved, on the average of five samples, when it reached a run or when it
    left it.
    """
    last = behind - 1
    before = abs(x[first] - x[first - 5]) / 5.0 if first >= 5 else 0.0
    after = abs(x[last + 5] - x[last]) / 5.0 if last + 5 < len(x) else 0.0
    return max(before, after) > 0.5 * typical


def _radio(x: np.ndarray, row) -> list[Finding]:
    if row.channel != "h_radio" or np.mean(x == row.maximum) < 0.01:
        return []
    text = (
        f"h_radio holds its largest value, {row.maximum:.5g} m, in "
        f"{np.mean(x == row.maximum):.0%} of all samples"
    )
    return [
        Finding(
            "note",
            "saturation",
            ("h_radio",),
            text,
            "give the altimeter's `maximum` in the aircraft file",
        )
    ]


def _noisy(row, specification: Instruments | None) -> list[Finding]:
    if (
        specification is None
        or not specification.name_of(row.channel)
        or not np.isfinite(row.noise)
    ):
        return []
    allowed = specification.noise(row.channel)
    if row.noise <= NOISY * allowed:
        return []
    text = (
        f"noise of {row.channel} is {row.noise:.3g} {row.units}, {row.noise / allowed:.1f} "
        f"times the {allowed:.3g} of the aircraft file"
    )
    evidence = {"noise": row.noise, "specified": allowed}
    return [
        Finding(
            "warning",
            "noise",
            (row.channel,),
            text,
            "check the sensor, or give its true noise in the aircraft file",
            None,
            None,
            evidence,
        )
    ]
