"""Manoeuvres that show in the motion, and movements of levers, flaps, gear and speed brakes.

Phugoid, spiral and power change are the motion after the controls come to rest. Level
accelerations, pull-ups and sideslips are recognised by speed, load factor and side force.
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

# Rest of the controls
# A surface that stays within this angle of its first position is at rest.
_STILL = 0.6 * DEGREE
# A surface within this angle is not used to hold height or bank either.
_FIXED = 0.2 * DEGREE
# Share of the lever's travel within which a lever is at rest.
_LEVER_STILL = 0.05
# Time after its last step until a surface is at rest [s].
_SETTLED = 0.5
# Longest rest that is searched [s].
_LONGEST = 600.0

# Phugoid
# Shortest rest of a phugoid [s].
_SHORTEST = 15.0
# Excursion of the speed from peak to peak, as a share of the mean speed.
_FREE_SPEED = 0.03
# Half a period of the speed, as a share of the period at constant angle of attack.
_HALF = (0.3, 0.8)
# Largest bank of a phugoid (90 % of the samples).
_FREE_LEVEL = 10.0 * DEGREE

# Spiral: least bank, and time of free motion that the test of spiral stability needs [s].
_BANK = 8.0 * DEGREE
_SPIRAL = 20.0

# Power and configuration
# Time with constant power [s]; a chop that ends earlier is an input.
_POWER_CHANGE = 10.0
# Least response to a power change: share of the speed, or change of attitude.
_SPEED_CHANGE, _PITCH_CHANGE = 0.03, 2.0 * DEGREE
# Response to a power change that a row covers [s], [14CFR60] Table A2A 2.c.1.
_SHOWN = 15.0
# Channel, name and smallest movement of the devices that change the configuration.
_DEVICES = (
    ("delta_f", "flaps", 3.0 * DEGREE),
    ("gear", "gear", 0.5),
    ("speedbrake", "speedbrake", 0.2),
)
# Smallest movement of a lever, as a share of its travel or of the speed of the fan.
_LEVER = 0.2
# Longest time from 15 to 85 % of a chop or slam, by lever and by the speed of the fan [s].
_LEVER_TIME, _FAN_TIME = 1.5, 4.0
# Time from a chop to the slam that ends it [s]; after a longer time each is a power change.
_AGAIN = 10.0

# Level accelerations
# Largest share of the change of energy that may be potential.
_LEVEL = 0.25
# Time from 15 to 85 % of a change of speed [s]; a series of settled points takes longer.
_LASTING = (6.0, 90.0)
# Smallest change of speed, as a share of the highest speed.
_SPEED = 0.1

# Pull-ups
# Distance of the load factor from 1 that counts as rest, and the shortest rest [s].
_REST, _AT_REST = 0.05, 1.5
# Load factors of a pull-up and of a push-down, and the time beyond each of them [s].
_HIGH, _LOW, _BEYOND = 1.12, 0.88, 1.0

# Sideslips
# Shortest time of a constant rudder [s], smallest sideslip [rad] and side force [m s-2].
_HELD = 3.0
_SIDESLIP = 1.5 * DEGREE
_SIDE_FORCE = 0.3


def speed_of(signals: ResampledChannels) -> np.ndarray | None:
    """Return the true or else the calibrated speed of a record, or None. [m/s]"""
    for name in ("V", "V_cas"):
        if name in signals:
            return lowpass_if_possible(signals[name], signals.step, 0.2)
    return None


def find_phugoids(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return the intervals of free motion in which the speed oscillates as in a phugoid.

    Elevator and levers are at rest for at least one period ``pi sqrt(2) V / g``, and the wings are
    level. Movements of ailerons and rudder excite a phugoid too; the caller removes these.

    References
    ----------
    .. [Lanchester1908] F. W. Lanchester, Aerodonetics, 1908: the period at constant angle of
       attack.
    """
    speed = speed_of(signals)
    if "delta_e" not in signals or speed is None:
        return []
    phugoids = []
    for start, end in _find_rests(signals, ("delta_e",), _SHORTEST):
        a, b = np.searchsorted(signals.time, (start, end))
        mean = float(speed[a:b].mean())
        # [Lanchester1908]: period at constant angle of attack [s]
        period = np.pi * np.sqrt(2.0) * mean / G
        if end - start <= period or not _is_level(signals, int(a), int(b)):
            continue
        excursions = find_excursions(signals.time[a:b], speed[a:b], _FREE_SPEED * mean)
        crossings = [excursion.middle for excursion in excursions]
        if len(crossings) < 2:
            continue
        # two crossings of the middle are half a period apart
        if _HALF[0] < np.median(np.diff(crossings)) / period < _HALF[1]:
            phugoids.append(FoundManoeuvre("phugoid", "elevator", start, end=end, confidence=0.8))
    return phugoids


def _is_level(signals: ResampledChannels, a: int, b: int) -> bool:
    """Return whether the bank is small between two samples, or not recorded."""
    if "phi" not in signals:
        return True
    return float(np.percentile(np.abs(signals["phi"][a:b]), 90.0)) < _FREE_LEVEL


def find_spirals(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return intervals of at least 20 s in a bank in which no surface and no lever moves."""
    if "phi" not in signals or not set(SURFACES) <= set(signals.values):
        return []
    banked = signals.flying & (np.abs(signals["phi"]) > _BANK)
    samples = np.arange(len(banked))
    spirals = []
    for a, b in true_runs(banked):
        inside = replace(signals, flying=signals.flying & (samples >= a) & (samples < b))
        for start, end in _find_rests(inside, SURFACES, _SPIRAL):
            spirals.append(FoundManoeuvre("spiral", "aileron", start, end=end, confidence=0.8))
    return spirals


def _find_rests(
    signals: ResampledChannels, surfaces: Sequence[str], least: float
) -> list[tuple[float, float]]:
    """Return the intervals of flight of at least `least` without control movements. [s]"""
    rests = []
    for a, b in true_runs(signals.flying):
        start = float(signals.time[a])
        while start + least < signals.time[b - 1]:
            end = at_rest_until(signals, surfaces, start, _FIXED)
            if end - start > least:
                rests.append((start, end))
            # a moving control ends the rest at once; then the search goes on 1 s later
            start = max(end, start + 1.0)
    return rests


def mark_power_changes(
    movements: Sequence[FoundManoeuvre], signals: ResampledChannels
) -> list[FoundManoeuvre]:
    """Return chops and slams, with those that change the motion named ``power_change``.

    Power stays constant for 10 s after a power change, and the aeroplane responds.
    """
    marked = []
    for movement in movements:
        rest_end = at_rest_until(signals, (), movement.end + 2.0 * _SETTLED)
        end = min(rest_end, movement.end + _SHOWN)
        is_step = movement.kind in ("throttle_chop", "throttle_slam")
        constant = end - movement.end >= _POWER_CHANGE
        if is_step and constant and _responds(signals, movement.start, end):
            movement = replace(movement, kind="power_change", end=end)
        marked.append(movement)
    return marked


def configuration_changes(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return movements of flaps, gear and speed brakes in flight, with up to 15 s of response.

    Kinds are ``flaps_out``, ``gear_in`` and so on.
    """
    changes: list[FoundManoeuvre] = []
    last = float(signals.time[-1])
    for channel, device, least in _DEVICES:
        if channel not in signals:
            continue
        for excursion in find_excursions(signals.time, signals[channel], least):
            if not signals.flying[np.searchsorted(signals.time, excursion.middle)]:
                continue
            direction = "out" if excursion.size > 0.0 else "in"
            changes.append(
                FoundManoeuvre(
                    kind=f"{device}_{direction}",
                    control=device,
                    start=excursion.start,
                    end=min(excursion.end + _SHOWN, last),
                    confidence=1.0,
                )
            )
    return changes


def at_rest_until(
    signals: ResampledChannels, surfaces: Sequence[str], start: float, still: float = _STILL
) -> float:
    """Return the end of the rest that begins at `start`. [s]

    One of `surfaces`, a lever, or the end of the flight ends the rest.
    """
    a = int(np.searchsorted(signals.time, start))
    # the position at rest is the median of the first second
    b, c = a + round(1.0 / signals.step), a + round(_LONGEST / signals.step)
    at_rest = signals.flying[a:c].copy()
    for name, x in signals.values.items():
        if name in surfaces:
            tolerance = still
        elif name.endswith(".throttle"):
            tolerance = _LEVER_STILL
        else:
            continue
        at_rest &= np.abs(x[a:c] - np.median(x[a:b])) < tolerance
    time = signals.time[a:c]
    if at_rest.all():
        return float(time[-1])
    return float(time[np.argmin(at_rest)])


def _responds(signals: ResampledChannels, start: float, end: float) -> bool:
    """Return whether the speed or the pitch attitude changes between two times."""
    a, b = np.searchsorted(signals.time, (start, end))
    speed = speed_of(signals)
    if speed is not None and float(np.ptp(speed[a:b])) > _SPEED_CHANGE * float(speed[a]):
        return True
    if "theta" not in signals:
        return False
    theta = signals["theta"]
    return float(np.abs(theta[a:b] - theta[a]).max()) > _PITCH_CHANGE


def find_responses(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return the manoeuvres of the motion, and movements of levers and devices."""
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
    """Return chops and slams of the levers, or of the fan if the record has no lever."""
    levers = [x for name, x in signals.values.items() if name.endswith(".throttle")]
    fans = [x for name, x in signals.values.items() if name.endswith(".n1")]
    if levers:
        x, longest, weight = np.mean(levers, axis=0), _LEVER_TIME, 1.0
    elif fans:
        # the fan follows its lever with a delay, so it is slower and less certain
        x, longest, weight = np.mean(fans, axis=0), _FAN_TIME, 0.7
    else:
        return []
    manoeuvres: list[FoundManoeuvre] = []
    for movement in find_movements(signals.time, x, _LEVER):
        if movement.end - movement.start >= longest or not _is_flying(signals, movement.middle):
            continue
        confidence = min(1.0, abs(movement.size) / (2.0 * _LEVER)) * weight
        is_slam = movement.size > 0.0
        if is_slam and _ends_chop(manoeuvres, movement):
            manoeuvres[-1] = replace(
                manoeuvres[-1],
                kind="throttle_chop_and_slam",
                end=movement.end,
                confidence=min(confidence, manoeuvres[-1].confidence),
            )
            continue
        manoeuvres.append(
            FoundManoeuvre(
                kind="throttle_slam" if is_slam else "throttle_chop",
                control="throttle",
                start=movement.start,
                end=movement.end,
                confidence=confidence,
            )
        )
    return manoeuvres


def _ends_chop(manoeuvres: Sequence[FoundManoeuvre], slam: Excursion) -> bool:
    """Return whether the last manoeuvre is a chop shortly before a slam."""
    if not manoeuvres or manoeuvres[-1].kind != "throttle_chop":
        return False
    return slam.start - manoeuvres[-1].end < _AGAIN


def level_speed_changes(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return accelerations and decelerations at nearly constant height.

    The change of kinetic energy is much larger than the change of potential energy.
    """
    V = speed_of(signals)
    if V is None or "h_baro" not in signals:
        return []
    h = lowpass_if_possible(signals["h_baro"], signals.step, 0.2)
    changes: list[FoundManoeuvre] = []
    for excursion in find_excursions(signals.time, V, _SPEED * float(np.percentile(V, 90.0))):
        duration = excursion.end - excursion.start
        a, b = np.searchsorted(signals.time, (excursion.start, excursion.end))
        # energies per unit mass [m2 s-2]
        kinetic = 0.5 * abs(V[b] ** 2 - V[a] ** 2)
        potential = G * float(np.ptp(h[a : b + 1]))
        if not _LASTING[0] < duration < _LASTING[1] or potential > _LEVEL * kinetic:
            continue
        if not signals.flying[a : b + 1].all():
            continue
        # an excursion is timed from 15 to 85 %; the change begins earlier and ends later
        margin = 0.15 * duration
        changes.append(
            FoundManoeuvre(
                kind="level_acceleration" if excursion.size > 0.0 else "level_deceleration",
                control="throttle",
                start=excursion.start - margin,
                end=excursion.end + margin,
                confidence=1.0 - potential / kinetic,
            )
        )
    return changes


def pull_ups(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return pull-ups followed by push-downs with wings level, or the reverse."""
    if not {"az_imu", "phi"} <= set(signals.values):
        return []
    # load factor; the specific force along z is negative in level flight
    n = -lowpass_if_possible(signals["az_imu"], signals.step, 0.5) / G
    manoeuvres: list[FoundManoeuvre] = []
    for excursion in find_excursions(signals.time, n, 0.25):
        if not _is_flying(signals, excursion.middle):
            continue
        a, b = np.searchsorted(signals.time, (excursion.start - 3.0, excursion.end + 3.0))
        inside = n[a : b + 1]
        # time above and below level flight [s]
        high = float(np.sum(inside > _HIGH) * signals.step)
        low = float(np.sum(inside < _LOW) * signals.step)
        level = np.abs(signals["phi"][a : b + 1]).max() < 20.0 * DEGREE
        if not 1.5 < excursion.end - excursion.start < 8.0 or not level:
            continue
        # the push-down of a pull-up is a second excursion of the same manoeuvre
        repeated = bool(manoeuvres) and manoeuvres[-1].end > excursion.start - 3.0
        if min(high, low) <= _BEYOND or repeated:
            continue
        start, end = _find_disturbed_time(n, signals, excursion)
        manoeuvres.append(
            FoundManoeuvre(
                kind="pull_up_push_down",
                control="elevator",
                start=start,
                end=end,
                confidence=min(1.0, float(np.ptp(inside)) / 0.8),
            )
        )
    return manoeuvres


def _find_disturbed_time(
    n: np.ndarray, signals: ResampledChannels, excursion: Excursion
) -> tuple[float, float]:
    """Return the time around an excursion in which the load factor is not at rest near 1.

    The time begins at most 10 s before the excursion and ends at most 10 s after it.
    """
    rests = []
    for a, b in true_runs(np.abs(n - 1.0) < _REST):
        if (b - a) * signals.step > _AT_REST:
            rests.append((signals.time[a], signals.time[b - 1]))
    ends = [end for _, end in rests if end < excursion.end]
    start = max([excursion.start - 10.0, *ends])
    beginnings = [begin for begin, _ in rests if begin > max(start, excursion.start)]
    return float(start), float(min([excursion.end + 10.0, *beginnings]))


def find_sideslips(signals: ResampledChannels) -> list[FoundManoeuvre]:
    """Return intervals of constant rudder at a steady bank, with sideslip or side force."""
    if not {"delta_r", "p", "phi"} <= set(signals.values):
        return []
    rudder = lowpass_if_possible(signals["delta_r"], signals.step, 1.0)
    beta = _lowpass_channel(signals, "beta_vane")
    ay = _lowpass_channel(signals, "ay_imu")
    # deflection from trim, which is the median in flight
    deflection = rudder
    if signals.flying.any():
        deflection = rudder - np.median(rudder[signals.flying])
    deflected = (np.abs(deflection) > 2.0 * DEGREE) & signals.flying
    constant = deflected & (np.abs(np.gradient(rudder, signals.step)) < 1.0 * DEGREE)
    sideslips: list[FoundManoeuvre] = []
    for a, b in true_runs(constant):
        if (b - a) * signals.step < _HELD:
            continue
        if np.ptp(rudder[a:b]) > 0.3 * np.abs(deflection[a:b]).mean():
            continue
        slip = _departs_from_median(beta, a, b, least=_SIDESLIP)
        force = _departs_from_median(ay, a, b, least=_SIDE_FORCE)
        if (slip or force) and np.ptp(signals["phi"][a:b]) < 12.0 * DEGREE:
            sideslips.append(
                FoundManoeuvre(
                    kind="steady_sideslip",
                    control="rudder aileron",
                    start=signals.time[a] - 2.0,
                    end=signals.time[b - 1],
                    confidence=0.9 if slip and force else 0.7,
                )
            )
    return sideslips


def _lowpass_channel(signals: ResampledChannels, name: str) -> np.ndarray | None:
    if name not in signals:
        return None
    return lowpass_if_possible(signals[name], signals.step, 0.5)


def _departs_from_median(x: np.ndarray | None, a: int, b: int, *, least: float) -> bool:
    """Return whether the mean between two samples differs from the median of the record."""
    if x is None:
        return False
    return abs(float(np.mean(x[a:b]) - np.median(x))) > least


def _is_flying(signals: ResampledChannels, time: float) -> bool:
    sample = int(np.searchsorted(signals.time, time))
    return bool(signals.flying[min(sample, len(signals.flying) - 1)])
