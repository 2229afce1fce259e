"""Manoeuvres that are recognised by what the aeroplane does after its controls came to rest:
phugoid, spiral, power change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flightmech.support.arrays import true_runs
from flightmech.units import DEGREE
from flighttest.flight_programme.manoeuvre_finding.excursions import (
    Excursion,
    FoundManoeuvre,
    find_excursions,
    find_movements,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible

G = 9.80665  # m s-2
SURFACES = ("delta_e", "delta_a", "delta_r")
_STILL = 0.6 * DEGREE  # a surface within this of where it came to rest has not been moved
_FIXED = 0.2 * DEGREE  # and one within this is not used to hold height or bank either
_LEVER_STILL = 0.05  # of the lever's travel
_SETTLED = 0.5  # s after its last step until a surface is at rest
_SHORTEST = 15.0  # s, period of the slowest phugoid
_LONGEST = 600.0  # s of rest that are looked at
_FREE_SPEED = 0.03  # excursion of a phugoid from peak to peak, of the mean speed
_HALF = (
    0.3,
    0.8,
)  # half a period of the oscillation of the speed, of the period at constant angle of attack
_FREE_LEVEL, _BANK = 10.0 * DEGREE, 8.0 * DEGREE
_SPIRAL = 20.0  # s of free motion that the test of spiral stability needs
_POWER_CHANGE = 10.0  # s with constant power; a chop that is ended earlier is an input
_SPEED_CHANGE, _PITCH_CHANGE = (
    0.03,
    2.0 * DEGREE,
)  # least response to a power change, of the speed or of the attitude
_SHOWN = 15.0  # s of the response to a power change, [14CFR60] Table A2A 2.c.1


def speed_of(signals: ResampledChannels) -> np.ndarray | None:
    """Return the speed of a record, or None. [m/s]"""
    name = next((name for name in ("V", "V_cas") if name in signals), None)
    return None if name is None else lowpass_if_possible(signals[name], signals.step, 0.2)


def find_phugoids(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return stretches in which elevator and levers are at rest for a period ``pi sqrt(2) V / g``
    at least, and the speed oscillates.

    The wings are level; what moves ailerons and rudder, and excites a phugoid as well, is left to
    the caller.

    References
    ----------
    .. [Lanchester1908] F. W. Lanchester, Aerodonetics, 1908: the period at constant angle of attack.
    """
    speed = speed_of(signals)
    if "delta_e" not in signals or speed is None:
        return []
    found = []
    for start, end in _rests(signals, ("delta_e",), _SHORTEST):
        a, b = np.searchsorted(signals.time, (start, end))
        mean = float(speed[a:b].mean())
        period = np.pi * np.sqrt(2.0) * mean / G
        crossings = [
            one.middle for one in find_excursions(signals.time[a:b], speed[a:b], _FREE_SPEED * mean)
        ]
        level = (
            "phi" not in signals
            or float(np.percentile(np.abs(signals["phi"][a:b]), 90.0)) < _FREE_LEVEL
        )
        if (
            level
            and end - start > period
            and len(crossings) > 1
            and _HALF[0] < np.median(np.diff(crossings)) / period < _HALF[1]
        ):
            found.append(FoundManoeuvre("phugoid", "elevator", start, end, 0.8))
    return found


def find_spirals(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return stretches of 20 s and more in a bank in which neither a surface nor a lever moves."""
    if "phi" not in signals or not set(SURFACES) <= set(signals.values):
        return []
    banked = signals.flying & (np.abs(signals["phi"]) > _BANK)
    found = []
    for a, b in true_runs(banked):
        inside = replace(
            signals,
            flying=signals.flying & (np.arange(len(banked)) >= a) & (np.arange(len(banked)) < b),
        )
        found += [
            FoundManoeuvre("spiral", "aileron", start, end, 0.8)
            for start, end in _rests(inside, SURFACES, _SPIRAL)
        ]
    return found


def _rests(
    signals: ResampledChannels, surfaces: Sequence[str], least: float
) -> list[tuple[float, float]]:
    """Return the stretches of flight, `least` long, in which none of `surfaces` and no lever moves.
    [s]
    """
    found = []
    for a, b in true_runs(signals.flying):
        start = float(signals.time[a])
        while start + least < signals.time[b - 1]:
            end = at_rest_until(signals, surfaces, start, _FIXED)
            if end - start > least:
                found.append((start, end))
            start = max(end, start + 1.0)
    return found


def mark_power_changes(
    moved: Sequence[FoundManoeuvre], signals: ResampledChannels
) -> list[FoundManoeuvre]:
    """Return chops and slams, those after which power stays constant for 10 s and the aeroplane
    responds as power changes.
    """
    found = []
    for one in moved:
        end = min(at_rest_until(signals, (), one.end + 2.0 * _SETTLED), one.end + _SHOWN)
        if (
            one.kind in ("throttle_chop", "throttle_slam")
            and end - one.end >= _POWER_CHANGE
            and _responds(signals, one.start, end)
        ):
            one = replace(one, kind="power_change", end=end)
        found.append(one)
    return found


def configuration_changes(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return movements of flaps, gear and speed brakes in flight, as ``flaps_out``, ``gear_in``
    ..., with 15 s of response at most.
    """
    found: list[FoundManoeuvre] = []
    for channel, word, least in (
        ("delta_f", "flaps", 3.0 * DEGREE),
        ("gear", "gear", 0.5),
        ("speedbrake", "speedbrake", 0.2),
    ):
        for one in (
            find_excursions(signals.time, signals[channel], least) if channel in signals else ()
        ):
            if signals.flying[np.searchsorted(signals.time, one.middle)]:
                kind = f"{word}_{'out' if one.size > 0.0 else 'in'}"
                found.append(
                    FoundManoeuvre(
                        kind, word, one.start, min(one.end + _SHOWN, float(signals.time[-1])), 1.0
                    )
                )
    return found


def at_rest_until(
    signals: ResampledChannels, surfaces: Sequence[str], start: float, still: float = _STILL
) -> float:
    """Return when one of `surfaces`, a lever or the end of the flight ends the rest that begins at
    `start`. [s]
    """
    a = int(np.searchsorted(signals.time, start))
    b, c = a + round(1.0 / signals.step), a + round(_LONGEST / signals.step)
    rest = signals.flying[a:c].copy()
    for name, x in signals.values.items():
        least = (
            still if name in surfaces else _LEVER_STILL if name.endswith(".throttle") else np.inf
        )
        if least < np.inf:
            rest &= np.abs(x[a:c] - np.median(x[a:b])) < least
    return float(signals.time[a:c][-1 if rest.all() else np.argmin(rest)])


def _responds(signals: ResampledChannels, start: float, end: float) -> bool:
    a, b = np.searchsorted(signals.time, (start, end))
    speed = speed_of(signals)
    slower = speed is not None and float(np.ptp(speed[a:b])) > _SPEED_CHANGE * float(speed[a])
    return slower or (
        "theta" in signals
        and float(np.abs(signals["theta"][a:b] - signals["theta"][a]).max()) > _PITCH_CHANGE
    )


_HELD = 3.0  # s
_SIDESLIP = 1.5 * DEGREE
_SIDE_FORCE = 0.3  # m s-2
_LEVER = 0.2  # of the lever's travel, or of the fan's speed
_AGAIN = 10.0  # s from a chop to the slam that ends it; after a longer time each is a power change
_LEVEL = 0.25  # largest share of the change of energy that may be potential
_REST, _AT_REST = 0.05, 1.5  # load factor about 1, s
_LASTING = (
    6.0,
    90.0,
)  # s from 15 to 85 % of a change of speed; a series of settled points takes longer
_SPEED = 0.1  # smallest change, of the highest speed


def find_responses(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return the manoeuvres that show in the motion, and movements of levers, flaps, gear and speed
    brakes.
    """
    powered = mark_power_changes(throttle_movements(signals), signals)
    return [
        *powered,
        *configuration_changes(signals),
        *find_spirals(signals),
        *level_speed_changes(signals),
        *pull_ups(signals),
        *find_sideslips(signals),
    ]


def throttle_movements(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return chops and slams; a record without levers shows them in the speed of the fan."""
    levers = [x for name, x in signals.values.items() if name.endswith(".throttle")]
    fans = [x for name, x in signals.values.items() if name.endswith(".n1")]
    if not levers and not fans:
        return []
    fastest = 1.5 if levers else 4.0  # s from 15 to 85 %
    x = np.mean(levers or fans, axis=0)
    moved = [
        one
        for one in find_movements(signals.time, x, _LEVER)
        if one.end - one.start < fastest and _flown(signals, one.middle)
    ]
    found: list[FoundManoeuvre] = []
    for one in moved:
        confidence = min(1.0, abs(one.size) / (2.0 * _LEVER)) * (1.0 if levers else 0.7)
        before = found[-1] if found else None
        if (
            one.size > 0.0
            and before is not None
            and before.kind == "throttle_chop"
            and one.start - before.end < _AGAIN
        ):
            found[-1] = FoundManoeuvre(
                "throttle_chop_and_slam",
                "throttle",
                before.start,
                one.end,
                min(confidence, before.confidence),
            )
        else:
            found.append(
                FoundManoeuvre(
                    "throttle_chop" if one.size < 0.0 else "throttle_slam",
                    "throttle",
                    one.start,
                    one.end,
                    confidence,
                )
            )
    return found


def level_speed_changes(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return accelerations and decelerations at nearly constant height, by the energy that goes
    into the speed.
    """
    speed = next((name for name in ("V", "V_cas") if name in signals), None)
    if speed is None or "h_baro" not in signals:
        return []
    V, h = (lowpass_if_possible(signals[name], signals.step, 0.2) for name in (speed, "h_baro"))
    found: list[FoundManoeuvre] = []
    for one in find_excursions(signals.time, V, _SPEED * float(np.percentile(V, 90.0))):
        a, b = np.searchsorted(signals.time, (one.start, one.end))
        kinetic, potential = 0.5 * abs(V[b] ** 2 - V[a] ** 2), G * float(np.ptp(h[a : b + 1]))
        if (
            not _LASTING[0] < one.end - one.start < _LASTING[1]
            or potential > _LEVEL * kinetic
            or not signals.flying[a : b + 1].all()
        ):
            continue
        kind = "level_acceleration" if one.size > 0.0 else "level_deceleration"
        margin = 0.15 * (one.end - one.start)
        found.append(
            FoundManoeuvre(
                kind, "throttle", one.start - margin, one.end + margin, 1.0 - potential / kinetic
            )
        )
    return found


def pull_ups(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return pull-ups followed by push-downs (or the reverse) with wings level, by the load factor."""
    if not {"az_imu", "phi"} <= set(signals.values):
        return []
    n = -lowpass_if_possible(signals["az_imu"], signals.step, 0.5) / G
    moves = [one for one in find_excursions(signals.time, n, 0.25) if _flown(signals, one.middle)]
    found: list[FoundManoeuvre] = []
    for one in moves:
        a, b = np.searchsorted(signals.time, (one.start - 3.0, one.end + 3.0))
        inside = n[a : b + 1]
        high, low = (float(np.sum(part) * signals.step) for part in (inside > 1.12, inside < 0.88))
        level = np.abs(signals["phi"][a : b + 1]).max() < 20.0 * DEGREE
        if (
            1.5 < one.end - one.start < 8.0
            and level
            and min(high, low) > 1.0
            and not (found and found[-1].end > one.start - 3.0)
        ):
            start, end = _disturbed(n, signals, one)
            found.append(
                FoundManoeuvre(
                    "pull_up_push_down",
                    "elevator",
                    start,
                    end,
                    min(1.0, float(np.ptp(inside)) / 0.8),
                )
            )
    return found


def _disturbed(n: np.ndarray, signals: ResampledChannels, one: Excursion) -> tuple[float, float]:
    """Return the time around an excursion of the load factor in which it is not at rest near 1, 10
    s before and after at most.
    """
    rest = [
        (signals.time[a], signals.time[b - 1])
        for a, b in true_runs(np.abs(n - 1.0) < _REST)
        if (b - a) * signals.step > _AT_REST
    ]
    start = max([one.start - 10.0, *(end for _, end in rest if end < one.end)])
    return float(start), float(
        min([one.end + 10.0, *(first for first, _ in rest if first > max(start, one.start))])
    )


def find_sideslips(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return stretches of held rudder at a steady bank, with sideslip or side force."""
    if not {"delta_r", "p", "phi"} <= set(signals.values):
        return []
    dr = lowpass_if_possible(signals["delta_r"], signals.step, 1.0)
    beta = (
        lowpass_if_possible(signals["beta_vane"], signals.step, 0.5)
        if "beta_vane" in signals
        else None
    )
    ay = lowpass_if_possible(signals["ay_imu"], signals.step, 0.5) if "ay_imu" in signals else None
    away = dr - np.median(dr[signals.flying]) if signals.flying.any() else dr
    held = (
        (np.abs(away) > 2.0 * DEGREE)
        & signals.flying
        & (np.abs(np.gradient(dr, signals.step)) < 1.0 * DEGREE)
    )
    found: list[FoundManoeuvre] = []
    for a, b in true_runs(held):
        if (b - a) * signals.step < _HELD or np.ptp(dr[a:b]) > 0.3 * np.abs(away[a:b]).mean():
            continue
        slip = beta is not None and abs(float(np.mean(beta[a:b]) - np.median(beta))) > _SIDESLIP
        force = ay is not None and abs(float(np.mean(ay[a:b]) - np.median(ay))) > _SIDE_FORCE
        if (slip or force) and np.ptp(signals["phi"][a:b]) < 12.0 * DEGREE:
            found.append(
                FoundManoeuvre(
                    "steady_sideslip",
                    "rudder aileron",
                    signals.time[a] - 2.0,
                    signals.time[b - 1],
                    0.9 if slip and force else 0.7,
                )
            )
    return found


def _flown(signals: ResampledChannels, time: float) -> bool:
    return bool(
        signals.flying[min(int(np.searchsorted(signals.time, time)), len(signals.flying) - 1)]
    )
