"""Mass and wing area against the lift that carries the aeroplane.

Lift balances weight times load factor.  With the mass and the area that are stated, the lift curve that a record shows must have about
the slope that a wing of this aspect ratio has, or that of an a-priori database.  A mass in kg read as lb, or an area in another unit,
changes it by 2.2 or 10.8; upwash at the vane, sweep and the errors of DATCOM together stay within the limits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR
from flightmech.axes import lift_drag
from flightmech.build_up import used
from flightmech.errors import AeromatchError
from flightmech.units import DEGREE, FOOT, G0, POUND, SLUG

from ..checks.signals import Signals
from ..finding import Finding, map_entry

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

SLOPE = (0.55, 1.55)  # of the expected slope; measured: 0.79 to 1.05 on T-37, C182 and Citation II
_CERTAIN = (0.50, 1.75)
_RESTORED = (0.7, 1.25)  # where a change of unit must bring the slope
_CORRELATION = 0.95
_ENOUGH, _MOVES = 5.0, 0.2 * DEGREE  # s of flight; standard deviation of angle of attack that shows a slope
_LEVEL, _PART = 0.15, 0.35  # lift coefficient, and part of it, by which a prior with a biased vane may be wrong
_MASSES = (0.5, 2.0)  # mass of the aircraft file over the recorded one: fuel and load stay within
_NEEDS = ("alpha_vane", "az_imu", "V", "p_static", "temperature")
_UNITS = (
    ("lb", "kg", POUND),
    ("kg", "lb", 1.0 / POUND),
    ("N", "kg", 1.0 / G0),
    ("slug", "kg", SLUG),
    ("kg", "slug", 1.0 / SLUG),
)
_LIFT_AREA = FOOT**2


def weight_findings(
    signals: Signals, aircraft: Aircraft, record: xr.DataTree, database: xr.DataTree | None = None
) -> tuple[list[Finding], str]:
    """Return whether mass and area are those of the aeroplane that flew.

    Parameters
    ----------
    signals : Signals
        Mistakes undone, sensors at the c.g.
    aircraft : Aircraft
        Mass [kg], S [m2], b [m]; a recorded mass goes before the first.
    record : DataTree
    database : DataTree, optional
        A-priori database; its lift is expected instead of that of a wing of the same aspect ratio.

    Returns
    -------
    findings : list of Finding
    not_checked : str
        Why the lift shows nothing, empty where it does.
    """
    slope, level, why = _lift(signals, aircraft, database)
    recorded = float(np.median(signals["mass"][signals.flying])) if "mass" in signals and signals.flying.any() else 0.0
    if recorded > 0.0:
        found = _against_lift(slope, level, "mass", record)
        stated = aircraft.mass / recorded
        if not _MASSES[0] <= stated <= _MASSES[1]:
            found += _two_masses(stated, aircraft.mass, recorded, bool(found), slope)
        return found, why
    return _against_lift(slope, level, "", record), why


def _lift(signals: Signals, aircraft: Aircraft, database: xr.DataTree | None) -> tuple[float | None, float | None, str]:
    """Return the slope and the level of the lift of the record over those expected; None with the reason where it shows none."""
    full = signals.completed(("V", "p_static", "temperature"))
    missing = [name for name in _NEEDS if name not in full]
    if missing:
        return None, None, f"not recorded: {'; '.join(missing)}"
    mask = full.mask(_NEEDS)
    if mask.sum() * full.step < _ENOUGH:
        return None, None, f"less than {_ENOUGH:g} s of flight"
    alpha, V, T = (full[name][mask] for name in ("alpha_vane", "V", "temperature"))
    pressure = 0.5 * full["p_static"][mask] / (R_AIR * T) * V**2
    mach = V / np.sqrt(GAMMA * R_AIR * T)
    mass = full["mass"][mask] if "mass" in full else aircraft.mass
    along = full["ax_imu"][mask] if "ax_imu" in full else 0.0
    lift = mass * (along * np.sin(alpha) - full["az_imu"][mask] * np.cos(alpha)) / (pressure * aircraft.S)
    prior = _prior_lift(full, mask, mach, aircraft, database)
    level = None if prior is None else _level(lift, prior)
    expected = _slope_of_wing(aircraft, mach) * alpha if prior is None else prior
    if np.std(alpha) < _MOVES or abs(correlation := float(np.corrcoef(expected, lift)[0, 1])) < _CORRELATION:
        return None, level, "" if level is not None else "angle of attack moves too little for a lift curve"
    return float(np.sign(correlation) * np.std(lift) / np.std(expected)), level, ""


def _slope_of_wing(aircraft: Aircraft, mach: np.ndarray) -> np.ndarray:
    """Return the lift curve slope of an unswept wing by Helmbold's equation, with the Prandtl-Glauert rule. [1/rad]"""
    aspect = aircraft.b**2 / aircraft.S
    return 2.0 * np.pi * aspect / (2.0 + np.sqrt(4.0 + aspect**2 * np.maximum(1.0 - mach**2, 0.1)))


def _level(lift: np.ndarray, prior: np.ndarray) -> float | None:
    """Return lift over that of the prior in the middle of the record, one where they agree within what a prior and a vane are wrong by."""
    one, other = float(np.median(lift)), float(np.median(prior))
    if abs(one - other) < _LEVEL + _PART * abs(other):
        return 1.0
    return one / other if other > _LEVEL else None


def _prior_lift(full: Signals, mask: np.ndarray, mach: np.ndarray, aircraft: Aircraft, database: xr.DataTree | None) -> np.ndarray | None:
    """Return the lift coefficient of a database along the record; None without one, or where it needs what the record lacks."""
    if database is None:
        return None
    from aerodb.store.evaluation import evaluate
    from aerodb.store.schema import terms

    V = full["V"][mask]
    given: dict[str, Any] = {name: full[name][mask] for name in full.values}
    given |= {"mach": mach, "alpha": full["alpha_vane"][mask]}
    given["beta"] = given.get("beta_vane", 0.0)
    for rate, length in (("p", aircraft.b), ("q", aircraft.cbar), ("r", aircraft.b)):
        given[f"{rate}hat"] = 0.5 * length / V * given[rate] if rate in given else 0.0
    parts = ("CL",) if any(term.startswith("CL/") for term in terms(database)) else ("CX", "CZ")
    needed = {name for term, leaf in terms(database).items() if term.split("/")[0] in parts for name in used(leaf)}
    still = {
        name: 0.0 for name in needed if name not in given and (name.startswith(("delta_", "gear", "speedbrake")) or name.endswith("hat"))
    }
    try:
        found = [evaluate(database, part, "clamp", **given, **still) for part in parts]
    except AeromatchError:
        return None
    lift = found[0] if len(found) == 1 else lift_drag(found[0], found[1], given["alpha"])[0]
    return np.broadcast_to(lift, mach.shape)


def _against_lift(slope: float | None, level: float | None, channel: str, record: xr.DataTree) -> list[Finding]:
    measure, what = (slope, "slope of the lift curve") if slope is not None else (level, "lift coefficient")
    if measure is None or measure <= 0.0 or SLOPE[0] <= measure <= SLOPE[1]:
        return []
    likely = [unit for unit in _UNITS if _RESTORED[0] <= measure * unit[2] <= _RESTORED[1]]
    certain = bool(likely) and not _CERTAIN[0] <= measure <= _CERTAIN[1]
    where = "the recorded mass" if channel else "the mass of the aircraft file"
    text = f"with {where} the {what} is {measure:.2f} of what this wing has (limits {SLOPE[0]:g} to {SLOPE[1]:g})"
    for wrong, right, _ in likely:
        text += f"{': ' if wrong == likely[0][0] else ' or '}mass is in {wrong} and was taken as {right}"
    if any(_RESTORED[0] <= measure * factor <= _RESTORED[1] for factor in (_LIFT_AREA, 1.0 / _LIFT_AREA)):
        text += "; or S, cbar and b are all in another unit"
    text += "; or height or airspeed, on which dynamic pressure rests, is wrong"
    remedy = 'correct the mass in the aircraft file, with its unit: mass = "... kg"'
    if channel and likely:
        remedy = map_entry(record, channel, likely[0][2])
    return [Finding("error" if certain else "warning", "weight", ("mass",), text, remedy, evidence={"ratio": measure})]


def _two_masses(stated: float, mass: float, recorded: float, wrong: bool, slope: float | None) -> list[Finding]:
    """Return that the mass of the aircraft file and the recorded one are not of one aeroplane."""
    if wrong:
        return []  # the recorded one is named already
    likely = [unit for unit in _UNITS if 0.75 <= stated * unit[2] <= 1.35]
    certain = slope is not None and bool(likely)
    text = f"the aircraft file has a mass of {mass:.5g} kg and the record one of {recorded:.5g} kg"
    if likely:
        culprit = "the first" if certain else "one of them is wrong; the first"
        text += f": {culprit} is in {likely[0][0]} and was taken as {likely[0][1]}"
    remedy = 'correct the mass in the aircraft file, with its unit: mass = "... kg"'
    return [Finding("error" if certain else "warning", "weight", ("mass",), text, remedy, evidence={"ratio": stated})]
