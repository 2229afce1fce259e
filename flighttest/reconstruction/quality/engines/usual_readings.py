"""Readings of engines and weights that no flight has: gauge manifold pressure, weight that grows.

A manifold pressure that is recorded as boost over the atmosphere is negative in most of the flight.
An aircraft that burns fuel becomes lighter.
"""

from __future__ import annotations

import re

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding

_MANIFOLD = re.compile(r"engine\d+\.manifold_pressure")
# Pa, absolute: closed throttle at height, and a large turbocharger
_LEAST, _MOST = 10e3, 400e3
# Pa, at most, of an engine that gives no power, and of one without a compressor
_IDLE, _ALOFT = 37e3, 105e3
_SINK = 1.0  # m/s of a flight without power, at least
_HEIGHTS = ("h_baro", "h_gps")
_PRESSURES = (("psi were taken as inHg", 2.036), ("inHg were taken as kPa", 3.386))
_OFTEN = 5.0  # percentile that is not a spike
# sign of the change by burning fuel
_TANKS = {"mass": -1, "fuel": -1, "fuel_used": 1}
_RISE = 0.002  # share of the mass of the aircraft
_SIGMAS = 3.0  # of the scatter about a straight line
_SHORTEST = 30.0  # s of flight
_PARTS = 6  # of the flight, of which each must lie above the one before
_ENDING = 0.75  # of the parts that must rise: a load or tanker changes the weight in one step


def manifold_findings(signals: ResampledChannels) -> list[Finding]:
    """Return the warnings on manifold pressures that are not absolute, or in another unit.

    Parameters
    ----------
    signals : ResampledChannels
        ``engine1.manifold_pressure`` and those of other engines, if recorded. [Pa]
    """
    findings = []
    for name in filter(_MANIFOLD.fullmatch, signals.values):
        pressure = signals[name][signals.mask((name,))]
        if not pressure.size:
            continue
        low, high = (float(x) for x in np.percentile(pressure, [_OFTEN, 100.0 - _OFTEN]))
        if low >= _LEAST and high <= _MOST:
            findings += _idle_finding(name, float(np.median(pressure)), signals)
            continue
        text = (
            f"{name} is {low / 1e3:.3g} to {high / 1e3:.3g} kPa in flight; an absolute manifold "
            f"pressure is {_LEAST / 1e3:g} to {_MOST / 1e3:g} kPa (30 to 100 without a compressor)"
        )
        if low < 0.0:
            text += ": it is a gauge pressure, over that of the atmosphere"
            remedy = f'give {name} offset = "29.92 inHg" in the name map, or the pressure set there'
        else:
            remedy = f"check column, unit and offset of {name} in the name map"
        evidence = {"low": low, "high": high}
        findings.append(Finding("warning", "range", (name,), text, remedy, evidence=evidence))
    return findings


def _idle_finding(name: str, usual: float, signals: ResampledChannels) -> list[Finding]:
    """Return the warning on an engine that idles by its manifold pressure while height is held.

    8 psi, read as 8 inHg, is such a pressure.
    """
    height = next((item for item in _HEIGHTS if item in signals), None)
    if height is None or usual >= _IDLE:
        return []
    mask = signals.mask((name, height))
    duration = float(mask.sum() * signals.step)
    if duration < _SHORTEST:
        return []
    values = signals[height][mask]
    sink = float(values[0] - values[-1]) / duration
    if sink > _SINK:
        return []
    text = (
        f"{name} is {usual / 1e3:.3g} kPa for half of the flight, that of an idling engine, and "
        f"the aircraft sinks by {sink:.2g} m/s only: level flight takes more "
        f"than {_IDLE / 1e3:g} kPa"
    )
    factors = [(unit, factor) for unit, factor in _PRESSURES if _IDLE < usual * factor < _ALOFT]
    if factors:
        text += f", as if {' or '.join(unit for unit, _ in factors)}"
    remedy = f"check the unit of {name} in the name map; right for a glider with its engine at idle"
    return [Finding("warning", "unit", (name,), text, remedy, evidence={"median": usual})]


def growing_findings(signals: ResampledChannels, aircraft: Aircraft) -> list[Finding]:
    """Return the warnings on weight or fuel that grows in flight, and fuel used that falls.

    Parameters
    ----------
    signals : ResampledChannels
        ``mass``, ``fuel`` and ``fuel_used``, if recorded. [kg]
    aircraft : Aircraft
        Its mass is the measure of a change. [kg]

    Notes
    -----
    The change in flight is that of a straight line. It counts from 0.2 % of the mass on, and beyond
    three times the scatter about the line.
    """
    findings = []
    for name, sign in _TANKS.items():
        if name not in signals:
            continue
        mask = signals.mask((name,))
        if mask.sum() * signals.step < _SHORTEST:
            continue
        time, amount = signals.time[mask], signals[name][mask]
        slope, start = np.polyfit(time - time[0], amount, 1)
        scatter = float(np.std(amount - start - slope * (time - time[0])))
        change = float(slope * (time[-1] - time[0]))
        wrong = -sign * change
        means = [float(np.mean(part)) for part in np.array_split(amount, _PARTS)]
        rising = np.mean(-sign * np.diff(means) > 0.0)
        if wrong < _RISE * aircraft.mass + _SIGMAS * scatter or rising < _ENDING:
            continue
        verb, way = ("falls", "grows") if sign > 0 else ("grows", "falls")
        text = (
            f"{name} {verb} by {wrong:.3g} kg in {time[-1] - time[0]:.0f} s of flight, from "
            f"{amount[0]:.5g} kg: an aircraft burns fuel, and {name} {way}"
        )
        remedy = (
            f"correct the column of {name}: fuel that was added in place of subtracted, a sign, or "
            f"times in reverse; right for an aircraft that takes fuel in flight"
        )
        evidence = {"change": change, "scatter": scatter}
        findings.append(Finding("warning", "sign", (name,), text, remedy, evidence=evidence))
    return findings
