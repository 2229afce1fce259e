"""Recorded surfaces against the rigging of the aircraft file: gearing to the cockpit, and stops.

The motion of an aeroplane does not give the gain of a pick-up: half the deflection with twice the
effect is the same flight.  A second recorded position of the same control does, and so does a
surface that passes its stops.
"""

from __future__ import annotations

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import TRAVEL
from flightmech.names import lookup, value_text
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding

_FOLLOWS = 0.95  # correlation of surface and cockpit control from which their slope is a gearing
_MOVED = 0.3 * DEGREE  # standard deviation of a surface that determines the slope
_SHORTEST = 5.0  # s of samples valid in both channels
# Recorded over stated gearing, beyond which a gain is wrong.  Stretch of cables, friction and the
# differential of ailerons give 0.85 to 1.01 in the records of the T-37.
_GEARING = (0.8, 1.2)
# Share of a stop, and angle, by which a surface may pass it: zero and scale of a pick-up.
_PAST, _PAST_ANGLE = 0.08, 1.0 * DEGREE
# Of 1 rad: a largest deflection nearer to it is a position of 0 to 1 that was taken for an angle.
_FRACTION = 0.01


def rigging_findings(signals: ResampledChannels, aircraft: Aircraft) -> list[Finding]:
    """Return the warnings on surfaces that contradict gearing or stops of the aircraft file.

    Parameters
    ----------
    signals : ResampledChannels
        Surfaces with correct sign and unit [rad]; column, pedal [m] and wheel [rad], if recorded.
        Samples on the ground count.
    aircraft : Aircraft
        Its ``controls`` have the gearing, its ``limits`` the stops. [SI]

    Returns
    -------
    list of Finding
        Of kind ``scale`` for a slope of surface over cockpit control outside 0.8 to 1.2 of the
        gearing, and for a control of the limits that is 8 % and 1 deg or more past a stop.
    """
    findings = []
    for surface, (travel, _) in TRAVEL.items():
        if surface not in signals:
            continue
        control = aircraft.controls.get(surface)
        if travel in signals and control is not None and control.gearing:
            findings += _gearing_findings(signals, surface, travel, control.gearing)
    for name, stops in aircraft.limits.items():
        if name in signals:
            findings += _stop_findings(signals, name, stops)
    return findings


def past_stops(control: str, values: np.ndarray, stops: tuple[float, float]) -> str:
    """Return, in words, the stops that a recorded control passes; empty if it passes none.

    Parameters
    ----------
    control : str
        Canonical name.
    values : array (time,)
        Valid samples. [SI]
    stops : (float, float)
        Lower and upper stop. [SI]
    """
    past = []
    extremes = ("lower", stops[0], values.min()), ("upper", stops[1], values.max())
    for side, stop, extreme in extremes:
        beyond = (extreme - stop) * (1.0 if side == "upper" else -1.0)
        if beyond > max(_PAST * abs(stop), _PAST_ANGLE):
            reached, limit = (value_text(control, value, ".3g") for value in (extreme, stop))
            past.append(f"reaches {reached}, past its {side} stop of {limit}")
    if not past:
        return ""
    text = f"{control} {' and '.join(past)} in [limits] of the aircraft file"
    # a position of 0 to 1 that was taken for an angle
    largest = float(np.max(np.abs(values)))
    if lookup(control).units == "rad" and abs(largest - 1.0) < _FRACTION:
        text += (
            f", 1 rad: a position of 0 to 1; give it scale = '{value_text(control, stops[1], 'g')}'"
        )
    return text


def _gearing_findings(
    signals: ResampledChannels, surface: str, travel: str, gearing: float
) -> list[Finding]:
    """Return the warning on a slope of surface over cockpit control that is not the gearing."""
    both = signals.good[surface] & signals.good[travel]
    if both.sum() * signals.step < _SHORTEST:
        return []
    x, y = signals[travel][both], signals[surface][both]
    if np.std(y) < _MOVED or np.std(x) == 0.0:
        return []
    correlation = float(np.corrcoef(x, y)[0, 1])
    # A control of the wrong sign, or one that nothing follows, is a finding of its own.
    if correlation * np.sign(gearing) < _FOLLOWS:
        return []
    # Both are measured: the ratio of their sizes is between the slopes of the two regressions.
    slope = float(np.std(y) / np.std(x)) * np.sign(gearing)
    ratio = slope / gearing
    if _GEARING[0] <= ratio <= _GEARING[1]:
        return []
    text = (
        f"{surface} over {travel} has {ratio:.2f} of the gearing of the aircraft file "
        f"({slope:+.3g} against {gearing:+.3g} rad per {'rad' if travel == 'wheel' else 'm'})"
    )
    remedy = (
        f"check unit and scale of {surface} and {travel} against their calibration on the ground, "
        f"and the gearing in [control.{surface}]"
    )
    evidence = {"ratio": ratio, "correlation": correlation}
    return [Finding("warning", "scale", (surface, travel), text, remedy, evidence=evidence)]


def _stop_findings(
    signals: ResampledChannels, surface: str, stops: tuple[float, float]
) -> list[Finding]:
    """Return the warning on a surface that is recorded past a stop."""
    good = signals.good[surface]
    if not good.any():
        return []
    x = signals[surface][good]
    text = past_stops(surface, x, stops)
    if not text:
        return []
    remedy = f"check unit, zero and scale of {surface}, and the stops in the aircraft file"
    evidence = {"least": float(x.min()), "largest": float(x.max())}
    return [Finding("warning", "scale", (surface,), text, remedy, evidence=evidence)]
