"""Mass and wing area against the lift that carries the aeroplane.

Lift balances weight times load factor.  The lift curve of a record follows from the stated mass and
area.  Its slope must be about that of a wing of this aspect ratio, or that of an a-priori database.
A mass in kg read as lb changes it by 2.2, an area in ft2 read as m2 by 10.8.  Upwash at the vane,
sweep and the errors of DATCOM together stay within the limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.evaluation import evaluate
from aerodb.store.overview import FREE_AIR
from aerodb.store.schema import terms
from flightmech.air import GAMMA, R_AIR, pressure_altitude
from flightmech.aircraft.aircraft import Aircraft
from flightmech.axes import lift_drag
from flightmech.errors import AeromatchError
from flightmech.terms import list_model_variables
from flightmech.units import DEGREE, FOOT, G0, POUND, SLUG
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.airship import CARRIED
from flighttest.reconstruction.quality.declarations.geometry import is_airship
from flighttest.reconstruction.quality.finding import Finding, map_entry

SLOPE = (0.55, 1.55)  # of the expected slope; measured: 0.79 to 1.05 on T-37, C182 and Citation II
_CERTAIN = (0.50, 1.75)  # limits of the slope beyond which a wrong unit is an error
_RESTORED = (0.7, 1.25)  # limits of the slope after a change of unit that explains it
_CORRELATION = 0.95  # of a lift curve
_ENOUGH = 5.0  # s of flight
_MOVES = 0.2 * DEGREE  # standard deviation of the angle of attack that determines a slope
# lift coefficient, and share of it, by which a prior with a biased vane may be wrong
_LEVEL, _PART = 0.15, 0.35
_MASSES = (0.5, 2.0)  # mass of the aircraft file over the recorded one: fuel and load stay within
# difference of both masses that is a note, and a warning unless burnt fuel explains it: fuel and
# load move the mass of one aeroplane by a fifth, and its moments of inertia with it
_OTHER_LOADING, _OTHER_MASS = 0.05, 0.2
_INERTIAS = ("Ixx", "Iyy", "Izz")
MASS_LEVEL = (
    "the lift curve shows errors of a third and more, or, with a database, of a sixth and more of "
    "the mass: compare with the loading sheet and the fuel"
)
_SAME_MASS = (0.75, 1.35)  # the same ratio after a change of unit that explains it
_NEEDS = ("alpha_vane", "az_imu", "V", "p_static", "temperature")
_UNITS = (
    ("lb", "kg", POUND),
    ("kg", "lb", 1.0 / POUND),
    ("N", "kg", 1.0 / G0),
    ("slug", "kg", SLUG),
    ("kg", "slug", 1.0 / SLUG),
)
_LIFT_AREA = FOOT**2
_REMEDY = 'correct the mass in the aircraft file, with its unit: mass = "... kg"'


def weight_findings(
    signals: ResampledChannels,
    aircraft: Aircraft,
    record: xr.DataTree,
    database: xr.DataTree | None = None,
) -> tuple[list[Finding], str]:
    """Return the findings on mass and area.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes, sensors at the c.g.
    aircraft : Aircraft
        Mass [kg], S [m2], b [m]; a recorded mass has priority over the mass of the aircraft.
    record : DataTree
    database : DataTree, optional
        A-priori database; its lift is expected instead of that of a wing of the same aspect ratio.

    Returns
    -------
    findings : list of Finding
    not_checked : str
        Reason for which the lift shows nothing; empty if it does.
    """
    if is_airship(aircraft):
        slope, level, reason = None, None, CARRIED
    else:
        slope, level, reason = _compare_lift(signals, aircraft, database)
    recorded = 0.0
    if "mass" in signals and signals.flying.any():
        recorded = float(np.median(signals["mass"][signals.flying]))
    if not recorded > 0.0:
        return _lift_findings(slope, level, "", record=record), reason
    findings = _lift_findings(slope, level, "mass", record=record)
    ratio = aircraft.mass / recorded
    # A finding on the recorded mass explains the difference as well.
    if not findings and not _MASSES[0] <= ratio <= _MASSES[1]:
        findings.append(_two_masses_finding(ratio, aircraft.mass, recorded, slope=slope))
    elif not findings and abs(1.0 / ratio - 1.0) > _OTHER_LOADING:
        findings.append(_loading_finding(aircraft, recorded, set(_INERTIAS) <= set(signals.values)))
    return findings, reason


def _loading_finding(aircraft: Aircraft, recorded: float, has_inertias: bool) -> Finding:
    """Return that the record was flown at another mass than that of the aircraft file."""
    mass = aircraft.mass
    difference = recorded / mass - 1.0
    burnt = aircraft.fuel.mass / mass if aircraft.fuel else 0.0
    usual = -max(burnt, _OTHER_MASS) <= difference <= _OTHER_MASS
    text = (
        f"the record has a mass of {recorded:.5g} kg, which differs by {difference:+.1%} from the "
        f"{mass:.5g} kg of the aircraft file"
    )
    remedy = "check both against the loading sheet"
    if not has_inertias:
        text += "; the moments of inertia of the file belong to its own mass"
        remedy += "; give mass and moments of inertia of this flight, or record them"
    severity = "note" if usual else "warning"
    evidence = {"ratio": mass / recorded}
    return Finding(severity, "weight", ("mass",), text, remedy=remedy, evidence=evidence)


def _compare_lift(
    signals: ResampledChannels, aircraft: Aircraft, database: xr.DataTree | None
) -> tuple[float | None, float | None, str]:
    """Return slope and level of the lift over the expected ones, and a reason.

    A slope or level that the record does not determine is None. The reason states why.
    """
    full = signals.completed(("V", "p_static", "temperature"))
    missing = [name for name in _NEEDS if name not in full]
    if missing:
        return None, None, f"not recorded: {'; '.join(missing)}"
    mask = full.mask(_NEEDS)
    if mask.sum() * full.step < _ENOUGH:
        return None, None, f"less than {_ENOUGH:g} s of flight"
    alpha, V, temperature = full["alpha_vane"][mask], full["V"][mask], full["temperature"][mask]
    mach = V / np.sqrt(GAMMA * R_AIR * temperature)
    lift = _lift_coefficient(full, mask, aircraft)
    prior = _prior_lift(full, mask, mach, aircraft=aircraft, database=database)
    if prior is None:
        level, expected = None, _slope_of_wing(aircraft, mach) * alpha
    else:
        level, expected = _level_ratio(lift, prior), prior
    # Only an angle of attack that moves determines a slope. `not <` also refuses NaN.
    correlation = 0.0
    if not np.std(alpha) < _MOVES:
        correlation = float(np.corrcoef(expected, lift)[0, 1])
    if abs(correlation) < _CORRELATION:
        reason = ""
        if level is None:
            reason = "angle of attack moves too little for a lift curve"
        return None, level, reason
    return float(np.sign(correlation) * np.std(lift) / np.std(expected)), level, ""


def _lift_coefficient(full: ResampledChannels, mask: np.ndarray, aircraft: Aircraft) -> np.ndarray:
    """Return the lift coefficient of the accelerometers. [1]"""
    alpha, V, temperature = full["alpha_vane"][mask], full["V"][mask], full["temperature"][mask]
    pressure = 0.5 * full["p_static"][mask] / (R_AIR * temperature) * V**2
    mass = full["mass"][mask] if "mass" in full else aircraft.mass
    forward = full["ax_imu"][mask] if "ax_imu" in full else 0.0
    # lift is normal to the air flow; az is positive down
    acceleration = forward * np.sin(alpha) - full["az_imu"][mask] * np.cos(alpha)
    return mass * acceleration / (pressure * aircraft.S)


def _slope_of_wing(aircraft: Aircraft, mach: np.ndarray) -> np.ndarray:
    """Return the lift curve slope of an unswept wing. [1/rad]

    Helmbold's equation, with the Prandtl-Glauert rule.
    """
    aspect = aircraft.b**2 / aircraft.S
    return 2.0 * np.pi * aspect / (2.0 + np.sqrt(4.0 + aspect**2 * np.maximum(1.0 - mach**2, 0.1)))


def _level_ratio(lift: np.ndarray, prior: np.ndarray) -> float | None:
    """Return the median of the lift over that of the prior; None for a prior without lift.

    The ratio is one if they agree within the errors of a prior and a vane.
    """
    middle, expected = float(np.median(lift)), float(np.median(prior))
    if abs(middle - expected) < _LEVEL + _PART * abs(expected):
        return 1.0
    if expected > _LEVEL:
        return middle / expected
    return None


def _prior_lift(
    full: ResampledChannels,
    mask: np.ndarray,
    mach: np.ndarray,
    *,
    aircraft: Aircraft,
    database: xr.DataTree | None,
) -> np.ndarray | None:
    """Return the lift coefficient of a database along the record.

    The result is None without a database, or if the record lacks a quantity of it.
    """
    if database is None:
        return None
    V = full["V"][mask]
    inputs: dict[str, Any] = {name: full[name][mask] for name in full.values}
    inputs |= {"mach": mach, "alpha": full["alpha_vane"][mask]}
    inputs["beta"] = inputs.get("beta_vane", 0.0)
    inputs["h_agl"] = inputs.get("h_radio", FREE_AIR)
    inputs["h"] = pressure_altitude(np.clip(full["p_static"][mask], 1e3, 1.2e5))
    for rate, length in (("p", aircraft.b), ("q", aircraft.cbar), ("r", aircraft.b)):
        inputs[f"{rate}hat"] = 0.0
        if rate in inputs:
            inputs[f"{rate}hat"] = 0.5 * length / V * inputs[rate]
    coefficients: tuple[str, ...] = ("CX", "CZ")
    if any(term.startswith("CL/") for term in terms(database)):
        coefficients = ("CL",)
    # controls and rates without a record are zero; any other quantity must be recorded
    for term, leaf in terms(database).items():
        if term.split("/")[0] not in coefficients:
            continue
        for name in list_model_variables(leaf):
            is_control = name.startswith(("delta_", "gear", "speedbrake")) or name.endswith("hat")
            if name not in inputs and is_control:
                inputs[name] = 0.0
    try:
        values = [evaluate(database, name, "clamp", **inputs) for name in coefficients]
    except AeromatchError:
        return None
    lift = values[0]
    if len(values) == 2:
        lift = lift_drag(values[0], values[1], inputs["alpha"])[0]
    return np.broadcast_to(lift, mach.shape)


def _lift_findings(
    slope: float | None, level: float | None, channel: str, *, record: xr.DataTree
) -> list[Finding]:
    """Return the finding on a mass that the lift contradicts; `channel` is a recorded mass."""
    measure, quantity = slope, "slope of the lift curve"
    if slope is None:
        measure, quantity = level, "lift coefficient"
    if measure is None or measure <= 0.0 or SLOPE[0] <= measure <= SLOPE[1]:
        return []
    likely = [unit for unit in _UNITS if _RESTORED[0] <= measure * unit[2] <= _RESTORED[1]]
    source = "the recorded mass" if channel else "the mass of the aircraft file"
    text = (
        f"with {source} the {quantity} is {measure:.2f} of what this wing has (limits "
        f"{SLOPE[0]:g} to {SLOPE[1]:g})"
    )
    if likely:
        units = [f"mass is in {wrong} and was taken as {right}" for wrong, right, _ in likely]
        text += f": {' or '.join(units)}"
    areas = (measure * _LIFT_AREA, measure * (1.0 / _LIFT_AREA))
    if any(_RESTORED[0] <= ratio <= _RESTORED[1] for ratio in areas):
        text += "; or S, cbar and b are all in another unit"
    # The record of another aeroplane has a lift curve of its own mass and wing.
    text += (
        "; or the record is of another aeroplane; or height or airspeed, on which dynamic "
        "pressure rests, is wrong"
    )
    remedy = _REMEDY
    if channel and likely:
        remedy = map_entry(record, channel, likely[0][2])
    is_certain = bool(likely) and not _CERTAIN[0] <= measure <= _CERTAIN[1]
    severity = "error" if is_certain else "warning"
    evidence = {"ratio": measure}
    return [Finding(severity, "weight", ("mass",), text, remedy=remedy, evidence=evidence)]


def _two_masses_finding(
    ratio: float, mass: float, recorded: float, *, slope: float | None
) -> Finding:
    """Return that the mass of the aircraft file and the recorded one are not of one aeroplane."""
    likely = [unit for unit in _UNITS if _SAME_MASS[0] <= ratio * unit[2] <= _SAME_MASS[1]]
    # A slope without a finding means that the lift agrees with the recorded mass.
    is_certain = slope is not None and bool(likely)
    text = f"the aircraft file has a mass of {mass:.5g} kg and the record one of {recorded:.5g} kg"
    if likely:
        culprit = "the first" if is_certain else "one of them is wrong; the first"
        text += f": {culprit} is in {likely[0][0]} and was taken as {likely[0][1]}"
    severity = "error" if is_certain else "warning"
    evidence = {"ratio": ratio}
    return Finding(severity, "weight", ("mass",), text, remedy=_REMEDY, evidence=evidence)
