"""Engines of a record and of an aircraft file: levers, sign and size of the thrust, places.

Thrust pushes forward: the force along the body axis follows it with the slope one, drag being a
parabola of the angle of attack.  A thrust of the wrong sign, in lbf for N, or of one engine of two
has another slope.
"""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import xarray as xr

from flightmech.air import R_AIR
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.units import POUND_FORCE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.air_temperature import first_coefficient
from flighttest.reconstruction.quality.engines.engine_sides import side_findings
from flighttest.reconstruction.quality.engines.fuel import fuel_findings
from flighttest.reconstruction.quality.engines.fuel_on_board import fuel_on_board_findings
from flighttest.reconstruction.quality.engines.lever_roles import role_findings
from flighttest.reconstruction.quality.engines.table_ranges import range_findings
from flighttest.reconstruction.quality.engines.tanks import tank_findings
from flighttest.reconstruction.quality.engines.torque import torque_findings
from flighttest.reconstruction.quality.engines.usual_readings import (
    growing_findings,
    manifold_findings,
)
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes
from flighttest.reconstruction.quality.finding import Finding
from flighttest.regression.uncertainty.jackknife import block_jackknife

_LEVER_WORDS = re.compile(r"throttle|lever|thrust.?cmd|\bpla\b|\btla\b|power.?set", re.IGNORECASE)
_OUTPUTS = ("thrust", "n1", "fuel_flow", "n2", "torque", "rpm")
_SPLIT = 0.1  # rms difference of two engines over the range of both that two levers explain
_SLOPE = (0.75, 1.3)  # of force over thrust; 0.93 to 1.01 on T-37 and C182
_KNOWN, _SIGMAS = 0.08, 3.0  # largest standard error of that slope, and standard errors on it
_BLOCKS, _FEWEST = 8, 10.0  # of the jackknife; s of flight
_UNIT = 0.12  # of the slope, within which a factor of units explains it
_UNITS = (("lbf", "N", POUND_FORCE), ("N", "lbf", 1.0 / POUND_FORCE), ("kN", "N", 1000.0))
_EQUAL = (0.6, 1.67)  # thrust of one engine over that of the others, of one unit
_OFTEN = 95.0  # percentile of a speed that is not a spike
_OVERSPEED = 1.35  # of the rated speed: a fixed-pitch propeller in a dive stays below
_GOVERNED = 1.1  # of the highest speed of a governor: overshoots end within 5 % of the samples
_DEVICES = ("gear", "speedbrake", "delta_f")
_MOVES = 0.01  # range of a device that moves
_SIDE = 0.05  # of the thrust of both engines, by which they must differ to show their sides
_SLOPE_ROW = ("thrust", "sign and size of the thrust")

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


def lever_findings(record: xr.DataTree, signals: ResampledChannels) -> list[Finding]:
    """Return the findings on levers of two engines that have the same samples.

    Parameters
    ----------
    record : DataTree
        Its attribute ``unmapped`` lists columns that the name map does not use.
    signals : ResampledChannels
    """
    findings = []
    levers = [name for name in signals.values if name.endswith(".throttle")]
    for first, second in combinations(sorted(levers), 2):
        x, y = signals[first], signals[second]
        if not np.ptp(x) > 0.0 or not np.array_equal(x, y):
            continue
        severity, reason = "note", "right for one lever, or for a simulated one only"
        unused = re.findall(r"[^,]*\S", str(record.attrs.get("unmapped", "")))
        spare = [name.strip() for name in unused if _LEVER_WORDS.search(name)]
        split = _split_output(first, second, signals)
        if spare:
            severity, reason = (
                "warning",
                f"the file also has {', '.join(spare)}, which is not mapped",
            )
        elif split:
            severity, reason = "warning", f"{split} of the two engines differ"
        text = f"{first} and {second} have the same samples: {reason}"
        remedy = f"give {second} its own column in the name map, or leave it out"
        findings.append(Finding(severity, "column", (second, first), text, remedy))
    return findings


def engine_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on the engines of a record and an aircraft, and what was not checked.

    Parameters
    ----------
    signals, aircraft
        As for `thrust_findings`.
    """
    findings: list[Finding] = []
    unchecked: Unchecked = []
    checks = (
        thrust_findings,
        side_findings,
        fuel_findings,
        fuel_on_board_findings,
        tank_findings,
        torque_findings,
    )
    for check in checks:
        found, reasons = check(signals, aircraft)
        findings += found
        unchecked += reasons
    findings += shaft_findings(signals, aircraft)
    sizes = unusual_sizes(aircraft)
    for size in sizes:
        findings.append(Finding("warning", "unit", (size.name,), size.text, size.remedy))
    complete = signals.completed(("V",))
    in_flight = {name: x[complete.flying] for name, x in complete.values.items()}
    findings += range_findings(in_flight, aircraft, {size.name for size in sizes})
    findings += role_findings(signals)
    findings += manifold_findings(signals) + growing_findings(signals, aircraft)
    return findings, unchecked


def thrust_findings(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on sign, size and direction of the thrust, and what was not checked.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, accelerometers at the c.g.
    aircraft : Aircraft
        Engines, mass [kg] and S [m2].
    """
    findings = _direction_findings(aircraft)
    names = sorted(name for name in signals.values if name.endswith(".thrust"))
    needs = ("ax_imu", "alpha_vane", "V", "p_static", "temperature")
    full = signals.completed(needs)
    missing = tuple(name for name in needs if name not in full)
    if not names and not aircraft.engines:
        return [], []  # a glider
    if not names:
        missing = ("thrust", *missing)
    unchecked: Unchecked = []
    if missing:
        reason = f"not recorded: {'; '.join(missing)}"
        return findings, [(*_SLOPE_ROW, missing, reason), *_sides_row(signals, names, aircraft)]
    slope = _thrust_slope(full, names, aircraft)
    if slope is None or not slope[1] < _KNOWN:
        unchecked.append(
            (*_SLOPE_ROW, (), "the thrust changes too little: chop or slam the levers")
        )
    else:
        findings += _one_engine_finding(full, names, aircraft, slope=slope[0]) or _slope_findings(
            *slope, tuple(names)
        )
    return findings, [*unchecked, *_sides_row(signals, names, aircraft)]


def shaft_findings(signals: ResampledChannels, aircraft: Aircraft) -> list[Finding]:
    """Return the findings on the speed of the propellers.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes.
    aircraft : Aircraft
        Its propellers have ``rpm_high`` [rad s-1] and ``gear_ratio``.
    """
    findings: list[Finding] = []
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}.rpm"
        if engine.propeller is None or name not in signals.values:
            continue
        speed = signals[name][np.isfinite(signals[name])]
        fastest = float(np.percentile(speed, _OFTEN)) if speed.size else 0.0
        ratio = fastest / engine.propeller.rpm_high
        limit = _GOVERNED if engine.propeller.governed else _OVERSPEED
        if ratio > limit:
            finding = _overspeed_finding(name, fastest, engine.propeller)
            # a governor set otherwise than the aircraft file states explains a little
            severity = "error" if ratio > _OVERSPEED else "warning"
            findings.append(replace(finding, severity=severity))
    return findings


def _overspeed_finding(name: str, fastest: float, propeller: Propeller) -> Finding:
    """Return the error of a propeller that turns faster than it can."""
    ratio = fastest / propeller.rpm_high
    tip = 0.5 * propeller.diameter * fastest
    text = (
        f"{name} reaches {fastest:.4g} rad/s, {ratio:.2f} times rpm_high of the propeller, "
        f"{propeller.rpm_high:.4g} rad/s, with a tip speed of {tip:.0f} m/s: it is the speed of "
        f"the crankshaft or turbine, in another unit, or another quantity"
    )
    remedy = (
        "map the speed of the propeller, or give the column a scale: one over the ratio of the "
        "gearbox, or that of the unit; else correct rpm_high"
    )
    evidence = {"ratio": ratio, "tip_speed": tip}
    return Finding("error", "unit", (name,), text, remedy=remedy, evidence=evidence)


def _one_engine_finding(
    full: ResampledChannels, names: list[str], aircraft: Aircraft, *, slope: float
) -> list[Finding]:
    """Return the finding that the thrust of one engine is in another unit than that of the others.

    Its unit must restore both the equality of the engines and the slope of the force.
    """
    if _SLOPE[0] < slope < _SLOPE[1]:
        return []
    levels = {name: float(np.median(np.abs(full[name][full.flying]))) for name in names}
    for name in names:
        others = [level for other, level in levels.items() if other != name]
        if not others or not min(others) > 0.0:
            continue
        usual = float(np.median(others))
        for wrong, right, factor in _UNITS:
            corrected = _thrust_slope(
                full.with_values({name: factor * full[name]}), names, aircraft
            )
            ratio = levels[name] / usual
            equal = _EQUAL[0] < factor * ratio < _EQUAL[1]
            if corrected is None or not equal or _EQUAL[0] < ratio < _EQUAL[1]:
                continue
            if _SLOPE[0] < corrected[0] < _SLOPE[1]:
                text = (
                    f"{name} is in {wrong} and was taken as {right}: it is {ratio:.3g} of the "
                    f"thrust of the other engine throughout, and with its unit corrected the force "
                    f"along x changes by {corrected[0]:.2f} of the thrust instead of {slope:.2f}"
                )
                remedy = f'give {name} unit = "{wrong}" in the name map'
                evidence = {"slope": slope, "ratio": ratio}
                return [Finding("error", "unit", (name,), text, remedy, evidence=evidence)]
    return []


def _split_output(first: str, second: str, signals: ResampledChannels) -> str:
    """Return the output of two engines that differs more than one lever explains; or nothing."""
    engines = first.partition(".")[0], second.partition(".")[0]
    for output in _OUTPUTS:
        names = [f"{engine}.{output}" for engine in engines]
        if not all(name in signals for name in names):
            continue
        x, y = (signals[name] for name in names)
        size = max(float(np.ptp(x)), float(np.ptp(y)))
        # different levels are those of two engines, different changes those of two levers
        difference = (x - x.mean()) - (y - y.mean())
        if size > 0.0 and float(np.std(difference)) > _SPLIT * size:
            return output
    return ""


def _direction_findings(aircraft: Aircraft) -> list[Finding]:
    """Return the findings on engines that push backwards, and on two engines on one side."""
    findings = []
    for number, engine in enumerate(aircraft.engines, start=1):
        if engine.direction[0] < 0.0:
            text = (
                f"engine {number} of the aircraft file pushes backwards: direction = "
                f"{[float(part) for part in engine.direction]}; x is forward, [1, 0, 0] pushes "
                "forward"
            )
            remedy = "turn the direction of the engine in the aircraft file"
            findings.append(Finding("error", "sign", ("engine_direction",), text, remedy))
    sides = [engine.position[1] for engine in aircraft.engines]
    if len(sides) > 1 and (min(sides) > 0.0 or max(sides) < 0.0):
        text = f"all engines of the aircraft file are on one side: y = {sides} m, right positive"
        remedy = "correct the places of the engines in the aircraft file"
        findings.append(Finding("warning", "sign", ("engine_position",), text, remedy))
    if len(sides) == 2 and sides[0] > 0.0 > sides[1]:
        text = "engine 1 of the aircraft file is the right one; y is positive to the right"
        remedy = "if the channels engine1 are those of the left engine, exchange the places"
        findings.append(Finding("note", "axis", ("engine_position",), text, remedy))
    return findings


def _sides_row(signals: ResampledChannels, names: list[str], aircraft: Aircraft) -> Unchecked:
    """Return what the thrust does not show of the places of the engines."""
    rows: Unchecked = []
    if not aircraft.engines:
        return rows
    height = (
        "a change of power pitches the aeroplane by its thrust line, slipstream and trim together"
    )
    rows.append(("thrust_line", "height of the thrust line", (), height))
    if len(aircraft.engines) == 2 and len(names) < 2:
        reason = "not recorded: the thrust of both engines"
        rows.append(("engine_sides", "left and right engine", ("thrust",), reason))
    elif len(aircraft.engines) == 2:
        first, second = (signals[name] for name in names[:2])
        largest = float(np.max(np.abs(first + second)))
        if float(np.max(np.abs(first - second))) < _SIDE * largest:
            reason = "both engines have the same thrust throughout: one lever alone shows it"
        else:
            reason = "yawing by unequal thrust is not compared with the places of the engines"
        rows.append(("engine_sides", "left and right engine", (), reason))
    return rows


def _thrust_slope(
    full: ResampledChannels, names: list[str], aircraft: Aircraft
) -> tuple[float, float] | None:
    """Return the slope of the force along x over the thrust, and its standard error.

    m ax/(q S) = slope T/(q S) + c0 + c1 alpha + c2 alpha^2 + devices, q the dynamic pressure.
    """
    mask = full.mask(("ax_imu", "alpha_vane", "V", "p_static", "temperature", *names))
    if float(mask.sum()) * full.step < _FEWEST:
        return None
    density = full["p_static"] / (R_AIR * full["temperature"])
    force = 0.5 * density * full["V"] ** 2 * aircraft.S
    mass = full.values.get("mass", aircraft.mass)
    thrust = np.sum([full[name] for name in names], axis=0)
    alpha = full["alpha_vane"]
    columns = [thrust / force, np.ones_like(alpha), alpha, alpha**2]
    for name in _DEVICES:
        if name in full and np.ptp(full[name][mask]) > _MOVES:
            columns.append(full[name])
    X, y = np.stack(columns, axis=1)[mask], (mass * full["ax_imu"] / force)[mask]
    if not np.std(X[:, 0]) > 0.0:
        return None
    slope = first_coefficient(X, y)
    error = block_jackknife(lambda kept: first_coefficient(X[kept], y[kept]), len(y), _BLOCKS)
    # a slope of a thrust in another unit has an error of the same proportion
    return slope, float(error) / max(abs(slope), 1.0)


def _slope_findings(slope: float, stderr: float, names: tuple[str, ...]) -> list[Finding]:
    margin = _SIGMAS * stderr * max(abs(slope), 1.0)
    if _SLOPE[0] - margin < slope < _SLOPE[1] + margin:
        return []
    text = (
        f"the force along x changes by {slope:.2f} of the thrust (standard error {stderr:.2f}; "
        f"{_SLOPE[0]:g} to {_SLOPE[1]:g} are usual): "
    )
    severity, kind = "warning", "scale"
    remedy = f"check sign, unit and columns of {', '.join(names)}, and the mass"
    # A slope near a ratio of units shows that unit.
    likely = [unit for unit in _UNITS if abs(slope / unit[2] - 1.0) < _UNIT]
    if slope < 0.0:
        severity, kind = "error", "sign"
        text += "the thrust has the wrong sign; it is positive forward"
        remedy = f"give {names[0]} sign = -1 in the name map, and the other engines too"
    elif likely:
        severity, kind = "error", "unit"
        text += f"it is in {likely[0][0]} and was taken as {likely[0][1]}"
        remedy = f'give {names[0]} unit = "{likely[0][0]}" in the name map'
    elif abs(slope - 2.0) < 2.0 * _UNIT:
        text += "as if one of two engines were missing, or the thrust were that of one engine"
    else:
        text += "the thrust, the mass or the accelerometer is of another scale"
    evidence = {"slope": slope, "stderr": stderr}
    return [Finding(severity, kind, names, text, remedy, evidence=evidence)]
