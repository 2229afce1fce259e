"""Notes on a record: absent channels, coarse channels, offset surfaces and slow vanes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE, KNOT
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, iterate_rows

COARSE = 0.4  # share of samples that repeat the one before
_ABSENT = (  # channels of which one is enough, and what they are for
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
_STRAIGHT_TIME = 30.0  # s of straight flight that determine the centre of a surface
_CLOSE = 4.0 * DEGREE  # rms difference within which a vane is useful
_BIN = 5.0  # m/s
MISSING_CODE = "missing_code"
"""Kind of the note on a number that stands for a missing value."""
_LARGEST_SHARE = 0.6  # of the median speed in flight, below which a vane must become useful


def quality_remarks(
    signals: ResampledChannels,
    table: pd.DataFrame,
    comparisons: dict[str, RelationCheck],
    recorded: ResampledChannels,
    record: xr.DataTree,
) -> list[Finding]:
    """Return the notes on a record.

    Parameters
    ----------
    signals : ResampledChannels
        Without the mistakes that the checks found.
    table : DataFrame
        Result of `channel_table`.
    comparisons : dict of RelationCheck
        Result of `find_mistakes`.
    recorded : ResampledChannels
        As recorded.
    record : DataTree
        Its channels state the codes of missing values that the reader replaced.
    """
    return (
        note_missing_codes(record)
        + _note_absent_channels(recorded)
        + _note_coarse_channels(table)
        + _note_offset_surfaces(signals)
        + _note_minimum_speed(signals, comparisons)
    )


def note_missing_codes(record: xr.DataTree) -> list[Finding]:
    """Return a note on each channel of a record with numbers that were read as missing values.

    Parameters
    ----------
    record : DataTree
        With the attribute ``missing_codes`` of such channels, as `flighttest.read` sets it.
    """
    findings = []
    for node in record.children.values():
        for name, channel in node.data_vars.items():
            codes = channel.attrs.get("missing_codes")
            if not codes:
                continue
            text = (
                f"{name}: {codes} of column {channel.attrs.get('column', '')} stands for a missing "
                f"value, and these samples have no value"
            )
            remedy = f"if it is a reading, give missing = [] for {name} in the name map"
            findings.append(Finding("note", MISSING_CODE, (str(name),), text, remedy=remedy))
    return findings


def _note_absent_channels(signals: ResampledChannels) -> list[Finding]:
    channels, purposes = [], []
    for names, purpose in _ABSENT:
        if not any(name in signals for name in names):
            channels.append(names[0])
            purposes.append(purpose)
    if not channels:
        return []
    text = "not in the record: " + "; ".join(purposes)
    remedy = "check the name map if the file has them"
    return [Finding("note", "absent", tuple(channels), text, remedy=remedy)]


def _note_coarse_channels(table: pd.DataFrame) -> list[Finding]:
    findings = []
    for row in iterate_rows(table):
        if np.isfinite(row.noise) and COARSE < row.repeated < 1.0:
            text = (
                f"{row.channel} repeats {row.repeated:.0%} of its samples: it is recorded at "
                f"{row.rate:g} Hz "
                "and changes far less often, or in coarse steps"
            )
            remedy = "do not differentiate it; its bandwidth is below that of the recorder"
            findings.append(Finding("note", "coarse", (row.channel,), text, remedy=remedy))
    return findings


def _note_offset_surfaces(signals: ResampledChannels) -> list[Finding]:
    """Return the notes on aileron and rudder that are not centred in straight flight."""
    if not {"phi", "p", "r"} <= set(signals.values):
        return []
    findings = []
    for name in {"delta_a", "delta_r"} & set(signals.values):
        mask = signals.mask((name, "phi", "p", "r"))
        straight = np.hypot(signals["p"], signals["r"]) < _STRAIGHT_RATE
        mask &= (np.abs(signals["phi"]) < _STRAIGHT_BANK) & straight
        if mask.sum() * signals.step < _STRAIGHT_TIME:
            continue
        middle = float(np.median(signals[name][mask]))
        if abs(middle) < _OFF_CENTRE:
            continue
        text = (
            f"{name} stands at {middle / DEGREE:+.1f} deg in straight flight: bias of the "
            f"pick-up, trim or an asymmetry"
        )
        remedy = "let regressions have an intercept; calibrate the pick-up with the surface centred"
        evidence = {"offset": middle}
        finding = Finding("note", "offset", (name,), text, remedy=remedy, evidence=evidence)
        findings.append(finding)
    return findings


def _note_minimum_speed(
    signals: ResampledChannels, comparisons: dict[str, RelationCheck]
) -> list[Finding]:
    """Return the speed below which the alpha vane does not follow attitude and climb."""
    if "vane" not in comparisons:
        return []
    check = comparisons["vane"]
    difference = np.abs(check.first - check.second - check.offset)
    speed = signals.completed(("V",))["V"]
    # bins from zero speed upwards, so that the ground counts too; empty bins are passed over
    limit = 0.0
    for edge in np.arange(0.0, float(np.percentile(speed, 99.0)), _BIN):
        inside = (speed >= edge) & (speed < edge + _BIN)
        if inside.any() and np.sqrt(np.mean(difference[inside] ** 2)) < _CLOSE:
            break
        limit = edge + _BIN
    if not limit or limit > _LARGEST_SHARE * float(np.median(speed[signals.flying])):
        return []
    text = (
        f"alpha_vane means nothing below about {limit:.0f} m/s ({limit / KNOT:.0f} kt): it "
        f"does not follow attitude and climb there"
    )
    remedy = "give minimum_speed of the vane in the aircraft file"
    channels, evidence = ("alpha_vane",), {"speed": limit}
    return [Finding("note", "minimum_speed", channels, text, remedy=remedy, evidence=evidence)]
