"""Constant errors of gyros, accelerometers, attitude and flow angles.

Relations of kinematics compare changes; a constant error of a channel shows in the mean of their
two sides.  Limits lie above the constant errors of ordinary instruments, which a reconstruction
estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE, G0
from flighttest.reconstruction.quality.checks.relation_sides import (
    bank_rate,
    heading_rate,
    pitch_rate,
)
from flighttest.reconstruction.quality.checks.relations import RELATIONS
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, map_entry
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked

# offsets that are reported; T-37, C182 and Citation flights have up to 0.06 deg/s, 0.16 and
# 0.13 m/s2 (upwash: 1.4 deg)
GYRO, FORCE, VERTICAL, FLOW = 0.5 * DEGREE, 0.35, 0.5, 2.5 * DEGREE  # rad/s, m/s2, m/s2, rad
_SIGMAS = 3.0
_BLOCKS = 8  # of the jackknife
_SAME = 0.35  # share of an offset within which two relations show the same one
_MOST_TILT = 20.0 * DEGREE  # of accelerometers in their mounting
_LEAST_SLIP = 0.5 * DEGREE  # standard deviation of sideslip that determines its zero
_SLIP_CORRELATION = 0.9
# standard error of the slope of az up to which it shows the cause, and difference that is none:
# T-37 and C182 flights have slopes of 0.97 to 1.01
_KNOWN_SLOPE, _LEAST_SLOPE = 0.05, 0.015
_EULER = {"phi_rate": bank_rate, "theta_rate": pitch_rate, "psi_rate": heading_rate}


def gyro_offsets(signals: ResampledChannels) -> dict[str, tuple[float, float]]:
    """Return the constant errors of the gyros that are larger than ordinary ones.

    Parameters
    ----------
    signals : ResampledChannels
        As recorded. A wrong sign, unit or axis must be corrected first: nothing is returned while a
        relation of attitude and rates does not hold.

    Returns
    -------
    dict of (float, float)
        By gyro: reading less true rate, and its standard error. [rad/s]
    """
    relations = {relation.name: relation for relation in RELATIONS}
    checks = {name: relations[name].compare(signals) for name in _EULER}
    used = [name for name, check in checks.items() if check is not None]
    # a reversed rate is an offset in the mean of the other relations
    if not used or any(check is not None and not check.consistent for check in checks.values()):
        return {}
    needs: set[str] = set()
    for name in used:
        needs.update(relations[name].needs)
    mask = signals.mask(tuple(sorted(needs)))
    sf, cf = np.sin(signals["phi"][mask]), np.cos(signals["phi"][mask])
    tangent, cosine = np.tan(signals["theta"][mask]), np.cos(signals["theta"][mask])
    # rate of an Euler angle less that of the gyros = - row . (bias of p, q, r)
    zero = np.zeros_like(sf)
    rows = {
        "phi_rate": (zero + 1.0, sf * tangent, cf * tangent),
        "theta_rate": (zero, cf, -sf),
        "psi_rate": (zero, sf / cosine, cf / cosine),
    }
    blocks = np.array_split(np.arange(mask.sum()), _BLOCKS)
    normal, right = np.zeros((_BLOCKS, 3, 3)), np.zeros((_BLOCKS, 3))
    for name in used:
        first, second = _EULER[name](signals)
        difference = (second - first)[mask]
        X = np.stack(rows[name], axis=1)
        for i, block in enumerate(blocks):
            normal[i] += X[block].T @ X[block]
            right[i] += X[block].T @ difference[block]
    bias = np.linalg.lstsq(normal.sum(axis=0), right.sum(axis=0), rcond=1e-4)[0]
    left_out = []
    for i in range(_BLOCKS):
        matrix, vector = normal.sum(axis=0) - normal[i], right.sum(axis=0) - right[i]
        left_out.append(np.linalg.lstsq(matrix, vector, rcond=1e-4)[0])
    stderr = np.sqrt((_BLOCKS - 1) * np.var(left_out, axis=0))
    offsets = {}
    for name, value, error in zip("pqr", bias.tolist(), stderr.tolist(), strict=True):
        if name in signals and abs(value) > GYRO + _SIGMAS * error:
            offsets[name] = (value, error)
    return offsets


def without_offsets(
    signals: ResampledChannels, offsets: Mapping[str, tuple[float, float]]
) -> ResampledChannels:
    """Return the signals without constant errors of channels."""
    changed = {name: signals[name] - value for name, (value, _) in offsets.items()}
    return signals.with_values(changed) if changed else signals


def gyro_findings(offsets: Mapping[str, tuple[float, float]], record: xr.DataTree) -> list[Finding]:
    """Return the findings on the constant errors of `gyro_offsets`."""
    findings = []
    for name, (value, error) in offsets.items():
        text = (
            f"{name} reads {abs(value) / DEGREE:.2f} deg/s too {_side(value)} throughout (standard "
            f"error {error / DEGREE:.2f} deg/s), by the rates of the attitude"
        )
        findings.append(_offset_finding((name,), value, text, record))
    return findings


def offset_findings(
    table: pd.DataFrame, signals: ResampledChannels, record: xr.DataTree
) -> list[Finding]:
    """Return the findings on constant errors of accelerometers, attitude and flow angles.

    Parameters
    ----------
    table : DataFrame
        Result of `kinematic_table`, sensors at the c.g.
    signals : ResampledChannels
        As `table`.
    record : DataTree
    """
    offsets = {}
    for relation, offset, rms in zip(table["relation"], table["offset"], table["rms"], strict=True):
        # sides that differ by more than their mean have no constant error
        if rms < abs(offset):
            offsets[relation] = float(offset)
    present = set(table["relation"])
    findings = _pitch_findings(offsets, present, record)
    sideways = offsets.get("force_y", 0.0)
    if abs(sideways) > FORCE:
        angle = sideways / G0
        text = (
            f"ay_imu reads {abs(sideways):.2f} m/s2 too {_side(sideways)} throughout by the ground "
            f"velocity; or phi reads {abs(angle) / DEGREE:.1f} deg too {_side(angle)}"
        )
        text += _tilt_text(sideways, "right side up", "right side down")
        finding = _offset_finding(("ay_imu", "phi"), sideways, text, record)
        findings.append(
            replace(finding, remedy=f"{finding.remedy}; or {map_entry(record, 'phi', 1.0, -angle)}")
        )
    relation, limit = ("force_z", FORCE) if "force_z" in present else ("vertical", VERTICAL)
    downwards = offsets.get(relation, 0.0)
    if abs(downwards) > limit:
        findings.append(_vertical_finding(downwards, table, signals, record))
    # an error of ay moves the sideslip at which it reads zero
    if abs(sideways) > FORCE:
        return findings
    return findings + _slip_findings(signals, record, _side_force_error(table))


def slip_not_checked(table: pd.DataFrame, signals: ResampledChannels) -> Unchecked:
    """Return the row on a beta vane whose zero an error of the side force hides.

    Parameters
    ----------
    table : DataFrame
        As in `offset_findings`.
    signals : ResampledChannels
        As `table`.
    """
    zero, error = _fit_slip(signals), _side_force_error(table)
    if zero is None or error is None:
        return []
    hidden = abs(error / zero.slope)
    if abs(error) > FORCE:
        limit = "no constant error of the vane is reported"
    elif zero.least < abs(zero.value) <= zero.least + hidden:
        limit = (
            f"a constant error of the vane below {(zero.least + hidden) / DEGREE:.1f} deg is not "
            f"reported"
        )
    else:
        return []
    reason = (
        f"ay_imu reads {abs(error):.2f} m/s2 too {_side(error)} by the ground velocity, which "
        f"looks like {hidden / DEGREE:.1f} deg of the vane: {limit} before ay_imu or phi is "
        "corrected"
    )
    return [("zero_of_beta_vane", "zero of the beta vane", (), reason)]


def _side_force_error(table: pd.DataFrame) -> float | None:
    """Return the mean of ay less the force of the ground velocity; None without it. [m s-2]"""
    return dict(zip(table["relation"], table["offset"], strict=True)).get("force_y")


def without_constant_errors(
    signals: ResampledChannels, findings: list[Finding]
) -> ResampledChannels:
    """Return the signals without the errors of findings on their first channels."""
    changed = {}
    for finding in findings:
        name = finding.channels[0]
        if "scale" in finding.evidence:
            changed[name] = signals[name] / finding.evidence["scale"]
        else:
            changed[name] = signals[name] - finding.evidence["offset"]
    return signals.with_values(changed)


def _pitch_findings(
    offsets: Mapping[str, float], present: set[str], record: xr.DataTree
) -> list[Finding]:
    """Return the finding on pitch attitude, forward force and angle of attack.

    A pitch attitude too large by d shifts the forward force by -g d and the vane, against attitude
    less climb, by -d.
    """
    forward, flow = offsets.get("force_x", 0.0), offsets.get("vane", 0.0)
    by_force, by_flow = -forward / G0, -flow
    large = abs(forward) > FORCE
    if large and "vane" in present and abs(by_force - by_flow) < _SAME * abs(by_force):
        text = (
            f"theta reads {abs(by_force) / DEGREE:.1f} deg too {_side(by_force)} throughout, by "
            f"the forward force and by the alpha vane"
        )
        return [_offset_finding(("theta",), by_force, text, record)]
    findings = []
    if large:
        text = f"ax_imu reads {abs(forward):.2f} m/s2 too {_side(forward)} throughout"
        text += _tilt_text(forward, "nose up", "nose down")
        if "vane" not in present:
            text += f"; or theta reads {abs(by_force) / DEGREE:.1f} deg too {_side(by_force)}"
        findings.append(_offset_finding(("ax_imu", "theta"), forward, text, record))
    if abs(flow) > FLOW:
        text = (
            f"alpha_vane reads {abs(flow) / DEGREE:.1f} deg too {_side(flow)} throughout against "
            f"attitude less climb"
        )
        if "force_x" not in present:
            text += f"; or theta reads {abs(flow) / DEGREE:.1f} deg too {_side(-flow)}"
        findings.append(_offset_finding(("alpha_vane", "theta"), flow, text, record))
    return findings


def _vertical_finding(
    offset: float, table: pd.DataFrame, signals: ResampledChannels, record: xr.DataTree
) -> Finding:
    """Return the finding on az: a constant error, an error of scale, or either.

    `offset` is the mean of az less the reference. [m s-2]
    """
    level = float(np.mean(signals["az_imu"][signals.mask(("az_imu",))]))
    scale = level / (level - offset)
    constant = f"az_imu reads {abs(offset):.2f} m/s2 too {_side(offset)} throughout"
    scaled = f"{scale:.3f} times the true value"
    finding = _offset_finding(("az_imu",), offset, constant, record)
    rescale = map_entry(record, "az_imu", 1.0 / scale)
    cause, reason = _cause_of_vertical(scale, table)
    if cause == "constant":
        return replace(finding, text=f"{constant}: {reason}, so that the scale is right")
    if cause == "scale":
        evidence = {"offset": offset, "scale": scale}
        text = f"az_imu reads {scaled}: {reason}, so that the error is one of scale"
        return replace(finding, text=text, remedy=rescale, evidence=evidence)
    text = f"{constant}, or {scaled}: {reason}"
    return replace(finding, text=text, remedy=f"{finding.remedy}; or {rescale}")


def _cause_of_vertical(scale: float, table: pd.DataFrame) -> tuple[str, str]:
    """Return ``constant``, ``scale`` or ``either``, and the reason in words.

    The slope of az over the force of the ground velocity is 1 with a constant error, and `scale`
    with an error of scale.  The acceleration of pressure height has too much noise for a slope.
    """
    rows = table[table["relation"] == "force_z"]
    if rows.empty:
        return "either", "no ground velocity shows which of them"
    slope, stderr = float(rows["slope"].iloc[0]), float(rows["slope_stderr"].iloc[0])
    if not stderr < _KNOWN_SLOPE:
        return "either", "in 1 g a constant error and an error of scale are the same"
    measured = (
        f"its slope over the force of the ground velocity is {slope:.3f} (standard error "
        f"{stderr:.3f})"
    )
    within = max(_SIGMAS * stderr, _LEAST_SLOPE)
    is_constant, is_scaled = abs(slope - 1.0) < within, abs(slope - scale) < within
    if is_constant != is_scaled:
        return "constant" if is_constant else "scale", measured
    share = "agrees with both" if is_constant else "agrees with neither alone"
    return "either", f"{measured}, which {share}"


@dataclass(frozen=True)
class _SlipZero:
    """Reading of the beta vane without side force.

    `value` and `stderr` are in rad, `force` is the side force at zero reading [m s-2], `slope` the
    side force per reading [m s-2 rad-1].
    """

    value: float
    stderr: float
    force: float
    slope: float

    @property
    def least(self) -> float:
        """Reading that is reported if the side force has no constant error. [rad]"""
        return FLOW + _SIGMAS * self.stderr


def _slip_findings(
    signals: ResampledChannels, record: xr.DataTree, force_error: float | None
) -> list[Finding]:
    """Return the finding on a beta vane that does not read zero where the side force is zero.

    Parameters
    ----------
    signals : ResampledChannels
    record : DataTree
    force_error : float or None
        Constant error of the side force by the ground velocity; None without ground velocity, where
        vane and accelerometer are both named. [m s-2]
    """
    zero = _fit_slip(signals)
    if zero is None:
        return []
    if not abs(zero.value) > zero.least + abs((force_error or 0.0) / zero.slope):
        return []
    text = (
        f"beta_vane reads {abs(zero.value) / DEGREE:.1f} deg too {_side(zero.value)} throughout "
        f"(standard error {zero.stderr / DEGREE:.1f} deg)"
    )
    if force_error is not None:
        text += ": that is its reading without side force"
        return [_offset_finding(("beta_vane", "ay_imu"), zero.value, text, record)]
    text += (
        f", or ay_imu {abs(zero.force):.2f} m/s2 too {_side(zero.force)}: the vane does not read "
        f"zero without side force, and no ground velocity shows which of them is wrong"
    )
    finding = _offset_finding(("beta_vane", "ay_imu"), zero.value, text, record)
    other = map_entry(record, "ay_imu", 1.0, -zero.force)
    return [replace(finding, remedy=f"{finding.remedy}; or {other}")]


def _fit_slip(signals: ResampledChannels) -> _SlipZero | None:
    """Return the reading of the beta vane without side force; None if it is not determined."""
    needs = ("beta_vane", "ay_imu")
    if not set(needs) <= set(signals.values):
        return None
    others = [name for name in ("p", "r", "delta_a", "delta_r") if name in signals]
    mask = signals.mask((*needs, *others))
    slip = signals["beta_vane"][mask]
    if len(slip) < 10 * _BLOCKS or not np.std(slip) > _LEAST_SLIP:
        return None
    y = signals["ay_imu"][mask]
    columns = [signals[name][mask] for name in others]
    X = np.stack([np.ones_like(slip), slip, *columns], axis=1)
    zeros = []
    for block in np.array_split(np.arange(len(y)), _BLOCKS):
        zeros.append(_slip_at_no_force(np.delete(X, block, axis=0), np.delete(y, block)))
    theta = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    explained = 1.0 - float(np.var(y - X @ theta) / max(np.var(y), 1e-300))
    # side force opposes sideslip
    if theta[1] >= 0.0 or explained < _SLIP_CORRELATION:
        return None
    stderr = float(np.sqrt((_BLOCKS - 1) * np.var(zeros)))
    return _SlipZero(_slip_at_no_force(X, y), stderr, float(theta[0]), float(theta[1]))


def _slip_at_no_force(X: np.ndarray, y: np.ndarray) -> float:
    theta = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    return float(-theta[0] / theta[1]) if theta[1] else 0.0


def _tilt_text(offset: float, positive: str, negative: str) -> str:
    """Return the tilt of the accelerometers that makes a constant error; empty if none does.

    In level flight a horizontal axis that is tilted by an angle shows g times its sine.
    """
    if not abs(offset) < G0 * np.sin(_MOST_TILT):
        return ""
    angle = float(np.arcsin(abs(offset) / G0)) / DEGREE
    way = positive if offset > 0.0 else negative
    return (
        f"; or the accelerometers are mounted {angle:.1f} deg {way} and show g times the sine of "
        f"that angle: measure the mounting, and then turn the columns in place of the offset"
    )


def _side(value: float) -> str:
    return "high" if value > 0.0 else "low"


def _offset_finding(
    channels: tuple[str, ...], value: float, text: str, record: xr.DataTree
) -> Finding:
    name = channels[0]
    remedy = map_entry(record, name, 1.0, -value)
    return Finding("warning", "offset", channels, text, remedy, evidence={"offset": value})
