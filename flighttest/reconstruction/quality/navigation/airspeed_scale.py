"""Scale of the airspeed against inertial motion and against the ground velocity.

The rate of the airspeed is the acceleration along the path, whatever the wind.  In a turn, or at
several speeds, the ground velocity is the air velocity times one factor, plus one wind.  Both give
the factor by which an airspeed is wrong: 1.05 for an impact pressure 10 % too large.
"""

from __future__ import annotations

import numpy as np

from flightmech.units import FOOT, KNOT
from flighttest.reconstruction.quality.checks.formed_channels import source_channels
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.finding import Finding, map_entry_of
from flighttest.reconstruction.quality.navigation.airspeed_definition import definition_finding
from flighttest.reconstruction.quality.navigation.inertial_motion import (
    MotionFits,
    alone_names,
    velocity_axes,
)
from flighttest.reconstruction.quality.navigation.motion_delays import Unchecked, is_determined
from flighttest.regression.uncertainty.jackknife import block_jackknife

# deviations from one that are a note and a warning: position errors reach 2 % of the airspeed
_NOTE, _WARNING, _SIGMAS = 0.01, 0.025, 3.0
_LEAST_ERROR = 0.002  # of one estimate
_KNOWN = 0.006  # standard error up to which the scale counts as checked
_BAND = 0.2  # Hz, of air and ground velocity
_CLOCK = 0.5  # s between the samples of the wind triangle
_BLOCKS, _FEWEST = 12, 60  # of the jackknife; samples of a wind triangle
_CLIMB = 20.0  # m of height, from which on the wind may change with it
_UNIT = 0.03  # logarithm within which a factor of units explains a scale
_MPH = 1609.344 / 3600.0
_SPEED_UNITS = (
    ("mph", "kt", _MPH / KNOT),
    ("kt", "mph", KNOT / _MPH),
    ("mph", "m/s", _MPH),
    ("kt", "m/s", KNOT),
    ("kt", "km/h", 3.6 * KNOT),
    ("km/h", "kt", 1.0 / (3.6 * KNOT)),
    ("mph", "km/h", 3.6 * _MPH),
    ("km/h", "mph", 1.0 / (3.6 * _MPH)),
    ("ft/s", "kt", FOOT / KNOT),
    ("kt", "ft/s", KNOT / FOOT),
)
_ROW = ("airspeed_scale", "scale of the airspeed")


def airspeed_findings(
    fits: MotionFits, signals: ResampledChannels, record
) -> tuple[list[Finding], Unchecked]:
    """Return the finding on the scale of the airspeed, and what was not checked.

    Parameters
    ----------
    fits : MotionFits
        Of the airspeeds.
    signals : ResampledChannels
        Without mistakes and delays.
    record : DataTree
    """
    completed = signals.completed(("V",))
    if "V" not in completed:
        return [], []
    channel = "V"
    if "V" not in signals:
        channel = source_channels("V", alone_names(completed))[0]
    # Two independent estimates: acceleration along the path, and wind triangle.
    estimates = []
    fit = fits.air.get(channel)
    if fit is not None and is_determined(fit):
        estimates.append((float(fit.scales[0]), float(fit.errors[0])))
    triangle = _wind_triangle(completed)
    if triangle is not None:
        estimates.append(triangle)
    scale, stderr = _combine(estimates)
    if not stderr < _KNOWN:
        missing = tuple(name for name in ("vn", "ve", "psi") if name not in signals)
        known = f"known to {stderr:.1%} only" if np.isfinite(stderr) else "not determined"
        reason = f"{known}: acceleration and deceleration, or a turn, in calm air"
        if missing:
            reason += f"; {', '.join(missing)} would show it in a turn"
        return [], [(*_ROW, missing, reason)]
    deviation = abs(scale - 1.0) - _SIGMAS * stderr
    if deviation < _NOTE:
        return [], []
    unit = explaining_unit(scale)
    definition = definition_finding(channel, scale, stderr, signals=signals, record=record)
    # a factor of units at the same place needs a heading that settles it
    if definition is not None and (unit is None or definition.evidence["heading"]):
        return [definition], []
    severity = "warning" if deviation > _WARNING else "note"
    return [_scale_finding(channel, scale, stderr, severity=severity, record=record)], []


def _scale_finding(channel: str, scale: float, stderr: float, *, severity: str, record) -> Finding:
    text = (
        f"{channel} shows {scale:.3f} of the airspeed that accelerations and ground velocity give "
        f"(standard error {stderr:.3f}): "
    )
    unit = explaining_unit(scale)
    kind = "scale"
    if unit:
        kind, severity = "unit", "error"
        text += f"it is in {unit[0]} and was taken as {unit[1]}"
        remedy = f"correct the unit of {channel} in the name map"
        leaf, entry, _ = map_entry_of(record, channel)
        if entry is not None:
            remedy = f'give {channel} unit = "{unit[0]}" in [{leaf}] of the name map'
    else:
        pressure = scale**2 - 1.0
        text += (
            f"as if the impact pressure were {pressure:+.1%} wrong, or the static temperature, "
            f"where the airspeed is formed from it, {pressure:+.1%} of its value in K"
        )
        remedy = (
            "check unit, calibration and position error of the pitot tube; give static_error in "
            "the aircraft file"
        )
    evidence = {"slope": scale, "stderr": stderr}
    return Finding(severity, kind, (channel,), text, remedy, evidence=evidence)


def explaining_unit(scale: float) -> tuple[str, str] | None:
    """Return the unit, and the unit assumed by mistake, that explain a scale."""
    for wrong, right, factor in _SPEED_UNITS:
        # a channel in `wrong` that was taken as `right` is too large by 1/factor
        if abs(np.log(scale * factor)) < _UNIT:
            return wrong, right
    return None


def _combine(estimates: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the weighted mean of estimates and its error, with the Birge ratio."""
    if not estimates:
        return 1.0, np.inf
    values = np.array([value for value, _ in estimates])
    errors = np.maximum([error for _, error in estimates], _LEAST_ERROR)
    weights = errors**-2.0
    mean = float(weights @ values / weights.sum())
    chi = float(weights @ (values - mean) ** 2)
    return mean, float(np.sqrt(max(1.0, chi) / weights.sum()))


def _wind_triangle(signals: ResampledChannels) -> tuple[float, float] | None:
    """Return the airspeed over the true one, and its standard error; None if not determined.

    (vn, ve) = k R(d) (n, e) + wind, with the horizontal air velocity (n, e) of airspeed, vanes and
    attitude, turned by a constant error d of heading or sideslip. Linear in k cos(d), k sin(d) and
    the wind, which may change linearly with height.
    """
    needs = ("vn", "ve", "V", "psi", "phi", "theta")
    if not set(needs) <= set(signals.values):
        return None
    V = signals["V"]
    alpha, beta = (
        signals.values.get(name, np.zeros_like(V)) for name in ("alpha_vane", "beta_vane")
    )
    # Velocity against the air in body axes, then turned by the attitude into north and east.
    body = (V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta))
    ahead, right, _ = velocity_axes(signals, body)
    sp, cp = np.sin(signals["psi"]), np.cos(signals["psi"])
    tracks = (cp * ahead - sp * right, sp * ahead + cp * right, signals["vn"], signals["ve"])
    every = max(1, round(_CLOCK / signals.step))
    samples = np.flatnonzero(signals.mask(needs))[::every]
    if len(samples) < _FEWEST:
        return None
    # All tracks have the same low-pass, so that delays of single channels count less.
    n, e, vn, ve = (lowpass_if_possible(x, signals.step, _BAND)[samples] for x in tracks)
    # The wind is constant, or linear in height where the record climbs.
    winds = [np.ones_like(n)]
    height = signals.values.get("h_baro", signals.values.get("h_gps"))
    if height is not None and np.ptp(height[samples]) > _CLIMB:
        winds.append((height[samples] - height[samples].mean()) / np.ptp(height[samples]))
    wind, still = np.stack(winds, axis=1), np.zeros((len(n), len(winds)))
    # vn = f (n cos d - e sin d) + wind and ve likewise: f is the factor, d an error of the heading.
    X = np.stack([np.column_stack([n, -e, wind, still]), np.column_stack([e, n, still, wind])])
    y = np.stack([vn, ve])
    if not np.linalg.cond(np.concatenate(X)) < 1e4:
        return None
    stderr = block_jackknife(lambda kept: _factor(X[:, kept], y[:, kept]), len(samples), _BLOCKS)
    return 1.0 / _factor(X, y), float(stderr)


def _factor(X: np.ndarray, y: np.ndarray) -> float:
    """Return k of the wind triangle."""
    coefficients = np.linalg.lstsq(np.concatenate(X), np.concatenate(y), rcond=None)[0]
    return max(float(np.hypot(coefficients[0], coefficients[1])), 1e-3)
