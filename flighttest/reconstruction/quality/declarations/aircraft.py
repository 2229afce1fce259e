"""Mass and wing area against the lift that carries the aeroplane.

Lift balances weight times load factor.  With the mass and the area that are stated, the lift curve
that a record shows must have about the slope that a wing of this aspect ratio has, or that of an
a-priori database.  A mass in kg read as lb, or an area in another unit, changes it by 2.2 or 10.8;
upwash at the vane, sweep and the errors of DATCOM together stay within the limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import atan2, degrees, log, radians, sqrt
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.evaluation import evaluate
from aerodb.store.schema import terms
from flightmech.air import GAMMA, R_AIR
from flightmech.aircraft.aircraft import Aircraft, inertia_tensor
from flightmech.axes import lift_drag
from flightmech.build_up import used_coefficients
from flightmech.errors import AeromatchError
from flightmech.units import DEGREE, FOOT, G0, POUND, SLUG
from flighttest.reconstruction.quality.checks.control_response import SIGNIFICANT
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, lowpass_if_possible
from flighttest.reconstruction.quality.declarations.airship import (
    CARRIED,
    airship_findings,
    floats,
)
from flighttest.reconstruction.quality.finding import Finding, map_entry
from flighttest.records.signals.differentiation import derivative
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

# S/(b cbar) is 0.96 to 1.0 for straight wings, 0.75 for a delta; chords of other definitions reach
# 0.5 (Concorde), biplanes 2
_RATIO, _RATIO_CERTAIN = (0.65, 1.45), (0.42, 2.3)
_ASPECT, _ASPECT_CERTAIN = (0.9, 45.0), (0.45, 70.0)
_USUAL_RATIO, _RATIO_SPREAD = 0.92, 0.15  # and its spread, of the natural log
_USUAL_ASPECT, _ASPECT_SPREAD = 7.0, 0.7
_USUAL_LOADING, _LOADING_SPREAD = (
    90.0,
    0.8,
)  # kg/m2 at 1000 kg, growing with the cube root of the mass; decides between S and lengths
_PER_MISTAKE = 8.0  # of the squared deviations: what a further mistake must explain
_TIE = 6.0
_AREA = (("ft2", "m2", FOOT**2), ("m2", "ft2", FOOT**-2))
_LENGTH = (("ft", "m", FOOT), ("m", "ft", 1.0 / FOOT))
_ROLL, _OTHERS = (0.08, 0.6), (0.09, 2.2)  # radii of gyration over half the span
_INCLINED = radians(
    25.0
)  # of the principal axis from the body axis; aeroplanes have 0 to 6 deg, small ones up to 16
_MAIN = ("Ixx", "Iyy", "Izz")
_INERTIA = (("lb ft2", "kg m2", POUND * FOOT**2), ("kg m2", "lb ft2", 1.0 / (POUND * FOOT**2)))
_TRIANGLE, _TRIANGLE_CERTAIN = (
    0.01,
    0.1,
)  # by which Izz may exceed Ixx + Iyy: moments of inertia are estimates
_YAW = 0.85  # of the largest other moment that Izz must reach; long fuselages have Izz near Iyy


@dataclass(frozen=True)
class _Cure:
    """Numbers of the geometry corrected, and in words what was wrong with them."""

    names: tuple[str, ...]
    text: str
    misfit: float


def geometry_findings(aircraft: Aircraft) -> list[Finding]:
    """Return what is wrong with area, chord and span of an aircraft, with the mistake that explains
    it.

    Parameters
    ----------
    aircraft : Aircraft
        Its S [m2], cbar [m] and b [m] are read.
    """
    if _is_airship(aircraft):
        return airship_findings(aircraft)
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    ratio, aspect = S / (b * cbar), b**2 / S
    if _is_usual(S, cbar, b) and cbar <= b:
        return []
    faults = (
        [f"S/(b cbar) is {ratio:.3g} (wings have {_RATIO[0]:g} to {_RATIO[1]:g})"]
        if not _RATIO[0] <= ratio <= _RATIO[1]
        else []
    )
    if not _ASPECT[0] <= aspect <= _ASPECT[1]:
        faults.append(f"the aspect ratio b2/S is {aspect:.3g}")
    if cbar > b:
        faults.append(f"the chord cbar ({cbar:.4g} m) is longer than the span b ({b:.4g} m)")
    certain = not (
        _RATIO_CERTAIN[0] <= ratio <= _RATIO_CERTAIN[1]
        and _ASPECT_CERTAIN[0] <= aspect <= _ASPECT_CERTAIN[1]
    )
    cures = _cures(S, cbar, b, aircraft.mass)
    names = cures[0].names if cures else ("S", "cbar", "b")
    explained = f"; {' or '.join(cure.text for cure in cures)}" if cures else ""
    text = f"S = {S:.4g} m2, cbar = {cbar:.4g} m, b = {b:.4g} m: {', '.join(faults)}{explained}"
    remedy = "correct S, cbar and b in the aircraft file; a number without a unit is SI"
    evidence = {"ratio": ratio, "aspect": aspect}
    return [
        Finding(
            "error" if certain else "warning", "geometry", names, text, remedy, evidence=evidence
        )
    ]


def _is_usual(S: float, cbar: float, b: float) -> bool:
    return _RATIO[0] <= S / (b * cbar) <= _RATIO[1] and _ASPECT[0] <= b**2 / S <= _ASPECT[1]


def _is_airship(aircraft: Aircraft) -> bool:
    """Whether an aircraft floats and its lengths are not those of a wing."""
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    return not (_is_usual(S, cbar, b) and cbar < b) and floats(aircraft)


def inertia_findings(aircraft: Aircraft) -> list[Finding]:
    """Return moments of inertia that no body of this mass and span has."""
    found: list[Finding] = []
    moments = {name: float(getattr(aircraft, name)) for name in _MAIN}
    principal = np.sort(np.linalg.eigvalsh(inertia_tensor(aircraft)))
    excess = float(principal[2] / (principal[0] + principal[1]) - 1.0)
    shown = ", ".join(f"{name} = {moment:.4g}" for name, moment in moments.items())
    remedy = "correct the moments of inertia in the aircraft file; a number without a unit is kg m2"
    odd = list(_odd_radii(aircraft, moments))
    if odd:
        names = tuple(name for name, _ in odd)
        text = (
            f"{shown} kg m2 for {aircraft.mass:.4g} kg and a span of {aircraft.b:.4g} m: "
            f"{'; '.join(text for _, text in odd)}"
        )
        found.append(Finding("warning", "inertia", names, text, remedy))
    if excess > _TRIANGLE:
        likely = [
            (name, *unit)
            for name in _MAIN
            for unit in _INERTIA
            if _is_body(aircraft, moments | {name: unit[2] * moments[name]})
        ]
        largest, smallest = max(_MAIN, key=moments.__getitem__), min(_MAIN, key=moments.__getitem__)
        names = (likely[0][0],) if likely else (largest, smallest)
        text = (
            f"{shown} kg m2: {largest} exceeds the sum of the two others by {excess:.1%}, "
            f"which no body has"
        )
        text += "".join(
            f"; as if {name} were in {wrong} and taken as {right}"
            for name, wrong, right, _ in likely
        )
        found.append(
            Finding(
                "error" if excess > _TRIANGLE_CERTAIN else "note", "inertia", names, text, remedy
            )
        )
    elif moments["Izz"] < _YAW * max(moments["Ixx"], moments["Iyy"]):
        text = (
            f"{shown} kg m2: Izz is the largest moment of inertia of an aeroplane; two of "
            f"them may stand in each other's place"
        )
        found.append(Finding("warning", "inertia", ("Izz",), text, remedy))
    inclined = 0.5 * atan2(2.0 * aircraft.Ixz, moments["Izz"] - moments["Ixx"])
    if moments["Izz"] > moments["Ixx"] and abs(inclined) > _INCLINED:
        text = (
            f"Ixz = {aircraft.Ixz:.4g} kg m2 inclines the principal axis of inertia by "
            f"{degrees(inclined):.0f} deg from the body axis"
        )
        found.append(Finding("warning", "inertia", ("Ixz",), text, remedy))
    return found


def _is_body(aircraft: Aircraft, moments: dict[str, float]) -> bool:
    """Whether moments of inertia are those of an aeroplane."""
    Ixx, Iyy, Izz = (moments[name] for name in _MAIN)
    return _YAW * max(Ixx, Iyy) <= Izz <= (1.0 + _TRIANGLE) * (Ixx + Iyy) and not list(
        _odd_radii(aircraft, moments)
    )


def _odd_radii(aircraft: Aircraft, moments: dict[str, float]) -> Iterator[tuple[str, str]]:
    half = 0.5 * max(aircraft.b, aircraft.cbar)  # of an airship the length
    for name, moment in moments.items():
        low, high = _ROLL if name == "Ixx" else _OTHERS
        radius = sqrt(moment / aircraft.mass) / half
        if low <= radius <= high:
            continue
        text = (
            f"the radius of gyration of {name} is {radius:.2g} of half the span (aeroplanes "
            f"have {low:g} to {high:g})"
        )
        for wrong, right, factor in _INERTIA:
            if low <= radius * sqrt(factor) <= high:
                text += f", as if {name} were in {wrong} and taken as {right}"
        yield name, text


def _cures(S: float, cbar: float, b: float, mass: float) -> list[_Cure]:
    """Return the mistakes that explain a geometry, the likeliest first, and those that explain it
    as well.
    """
    misfit = _misfit(S, cbar, b, mass)
    tried = [
        _Cure(
            ("cbar", "b"),
            "cbar and b stand in each other's place",
            _misfit(S, b, cbar, mass) + _PER_MISTAKE,
        )
    ]
    single = {"S": _AREA, "cbar": _LENGTH, "b": _LENGTH}
    changes = [(name, *unit) for name, units in single.items() for unit in units]
    for count in (1, 2):
        for chosen in combinations(changes, count):
            names = tuple(change[0] for change in chosen)
            if len(set(names)) < count:
                continue
            numbers = {"S": S, "cbar": cbar, "b": b} | {
                name: _corrected(name, factor, S, cbar, b) for name, _, _, factor in chosen
            }
            text = " and ".join(
                f"{name} is in {wrong} and was taken as {right}" for name, wrong, right, _ in chosen
            )
            tried.append(_Cure(names, text, _misfit(**numbers, mass=mass) + count * _PER_MISTAKE))
    tried.sort(key=lambda cure: cure.misfit)
    likely = [cure for cure in tried if cure.misfit < min(misfit, tried[0].misfit + _TIE)]
    return likely[:3]


def _corrected(name: str, factor: float, S: float, cbar: float, b: float) -> float:
    return factor * {"S": S, "cbar": cbar, "b": b}[name]


def _misfit(S: float, cbar: float, b: float, mass: float) -> float:
    """Return how far a geometry is from that of usual wings: squares of deviations over spreads, of
    the logarithms.
    """
    loading = log(mass / S / (_USUAL_LOADING * (mass / 1000.0) ** (1.0 / 3.0))) / _LOADING_SPREAD
    ratio = log(S / (b * cbar) / _USUAL_RATIO) / _RATIO_SPREAD
    aspect = log(b**2 / S / _USUAL_ASPECT) / _ASPECT_SPREAD
    return ratio**2 + aspect**2 + loading**2


_KNOWN = (
    3.0  # standard errors within which the coefficient of p r must be that of the aircraft file
)
_SHARP = 0.25  # its standard error, and its difference from that, over itself
_OTHER_SIGN = (
    3.0  # standard errors within which the estimate is that of the file with the other sign
)
_INERTIA_RATIO = 0.5  # and part of it
_TRIM, _BAND, _MEMORY = (
    0.3,
    1.5,
    2.0,
)  # Hz between which it is compared; s over which residuals are correlated
_COUPLING_CHANNELS = ("p", "q", "r", "alpha_vane", "delta_e")
_LATERAL = ("beta_vane", "delta_a", "delta_r")


def product_findings(signals: ResampledChannels, aircraft: Aircraft) -> tuple[list[Finding], str]:
    """Return whether Ixz of the aircraft file has the wrong sign, and why it was not checked.

    Parameters
    ----------
    signals : Signals
        Mistakes undone, sensors at the c.g.
    aircraft : Aircraft
        Ixx, Iyy, Izz, Ixz. [kg m2]
    """
    if aircraft.Ixz == 0.0:
        return [], ""
    missing = [name for name in _COUPLING_CHANNELS if name not in signals]
    if missing:
        return [], f"not recorded: {'; '.join(missing)}"
    fit = _coupling(signals, aircraft)
    if fit is None:
        return [], "too little motion"
    Ixz, stderr, known, known_stderr = fit
    if abs(aircraft.Ixz) < SIGNIFICANT * stderr:
        return (
            [],
            f"the motion shows Ixz to {stderr:.2g} kg m2 only, the aircraft file has "
            f"{aircraft.Ixz:.3g} kg m2",
        )
    true = (aircraft.Izz - aircraft.Ixx) / aircraft.Iyy
    off = abs(known - true)
    if max(known_stderr, off) > _SHARP * abs(true) or off > _KNOWN * known_stderr:
        return (
            [],
            f"the coupling of roll and yaw into pitch, known to be {true:.2f}, is seen as "
            f"{known:.2f} (standard error {known_stderr:.2f})",
        )
    opposite = abs(Ixz + aircraft.Ixz) < max(
        _OTHER_SIGN * stderr, _INERTIA_RATIO * abs(aircraft.Ixz)
    )
    if Ixz * aircraft.Ixz > 0.0 or abs(Ixz) < SIGNIFICANT * stderr or not opposite:
        return [], ""
    text = (
        f"Ixz has the wrong sign: the aircraft file has {aircraft.Ixz:.4g} kg m2, and "
        f"rolling pitches the aeroplane as "
        f"{Ixz:.4g} kg m2 does (standard error {stderr:.2g}); Ixz is the integral of x z dm"
    )
    remedy = f'Ixz = "{-aircraft.Ixz:.10g} kg m2" in the aircraft file'
    return [
        Finding("error", "inertia", ("Ixz",), text, remedy, evidence={"Ixz": Ixz, "stderr": stderr})
    ], ""


def _coupling(
    signals: ResampledChannels, aircraft: Aircraft
) -> tuple[float, float, float, float] | None:
    """Return Ixz and the coefficient of p r, each with its standard error."""
    signals = signals.completed(("V",))
    lateral = [name for name in _LATERAL if name in signals and np.ptp(signals[name]) > 0.0]
    mask = signals.mask((*_COUPLING_CHANNELS, *lateral))
    if mask.sum() * signals.step < 5.0:
        return None
    speed = np.ones_like(signals.time)
    if "V" in signals:
        middle = float(np.median(signals["V"][mask]))
        speed = np.maximum(signals["V"], 0.3 * middle) / middle
    p, q, r = (signals[name] for name in "pqr")
    # aerodynamic moments over dynamic pressure: linear in angles, controls and dimensionless rates,
    # even in sideslip and its controls
    sides = [signals[name] for name in lateral]
    aerodynamic = [
        signals["alpha_vane"],
        signals["delta_e"],
        q / speed,
        p / speed,
        r / speed,
        *sides,
        *(x**2 for x in sides),
    ]
    columns = [*aerodynamic, p * r / speed**2, (p**2 - r**2) / speed**2]
    y = derivative(q, signals.step, 5, 4 if signals.step < 0.15 else 2) / speed**2
    y, *columns = (_quick(x, signals.step)[mask] for x in (y, *columns))
    X = np.stack([x for x in columns if np.std(x) > 0.0], axis=1)
    if len(y) < 10 * X.shape[1] or min(np.std(x) for x in columns[-2:]) == 0.0:
        return None
    return _last_two(X, y, mask, signals.step, aircraft.Iyy)


def _quick(x: np.ndarray, step: float) -> np.ndarray:
    """Return what lies between trim and the band of the signals, of both sides of the equation
    alike.
    """
    return lowpass_if_possible(x, step, _BAND) - lowpass_if_possible(x, step, _TRIM)


def _last_two(
    X: np.ndarray, y: np.ndarray, mask: np.ndarray, step: float, Iyy: float
) -> tuple[float, float, float, float] | None:
    """Return the last two coefficients of a regression with coloured residuals, as Ixz and the
    coefficient of p r.
    """
    size = X.std(axis=0)
    scaled = X / size
    if np.linalg.cond(scaled) > 1e6:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    edges = [0, *(np.flatnonzero(np.diff(np.flatnonzero(mask)) > 1) + 1).tolist(), len(y)]
    pieces = [slice(a, b) for a, b in pairwise(edges)]
    covariance = coloured_covariance_of(
        scaled, y - scaled @ theta, pieces, [step] * len(pieces), lag=_MEMORY
    ).covariance
    (known, product), (known_stderr, stderr) = (
        theta[-2:] / size[-2:],
        np.sqrt(np.diag(covariance)[-2:]) / size[-2:],
    )
    return float(-product * Iyy), float(stderr * Iyy), float(known), float(known_stderr)


SLOPE = (0.55, 1.55)  # of the expected slope; measured: 0.79 to 1.05 on T-37, C182 and Citation II
_CERTAIN = (0.50, 1.75)
_RESTORED = (0.7, 1.25)  # where a change of unit must bring the slope
_CORRELATION = 0.95
_ENOUGH, _MOVES = (
    5.0,
    0.2 * DEGREE,
)  # s of flight; standard deviation of angle of attack that shows a slope
_LEVEL, _PART = (
    0.15,
    0.35,
)  # lift coefficient, and part of it, by which a prior with a biased vane may be wrong
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
    signals: ResampledChannels,
    aircraft: Aircraft,
    record: xr.DataTree,
    database: xr.DataTree | None = None,
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
    slope, level, why = (
        (None, None, CARRIED) if _is_airship(aircraft) else _lift(signals, aircraft, database)
    )
    recorded = (
        float(np.median(signals["mass"][signals.flying]))
        if "mass" in signals and signals.flying.any()
        else 0.0
    )
    if recorded > 0.0:
        found = _against_lift(slope, level, "mass", record)
        stated = aircraft.mass / recorded
        if not _MASSES[0] <= stated <= _MASSES[1]:
            found += _two_masses(stated, aircraft.mass, recorded, bool(found), slope)
        return found, why
    return _against_lift(slope, level, "", record), why


def _lift(
    signals: ResampledChannels, aircraft: Aircraft, database: xr.DataTree | None
) -> tuple[float | None, float | None, str]:
    """Return the slope and the level of the lift of the record over those expected; None with the
    reason where it shows none.
    """
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
    lift = (
        mass
        * (along * np.sin(alpha) - full["az_imu"][mask] * np.cos(alpha))
        / (pressure * aircraft.S)
    )
    prior = _prior_lift(full, mask, mach, aircraft, database)
    level = None if prior is None else _level(lift, prior)
    expected = _slope_of_wing(aircraft, mach) * alpha if prior is None else prior
    if (
        np.std(alpha) < _MOVES
        or abs(correlation := float(np.corrcoef(expected, lift)[0, 1])) < _CORRELATION
    ):
        return (
            None,
            level,
            "" if level is not None else "angle of attack moves too little for a lift curve",
        )
    return float(np.sign(correlation) * np.std(lift) / np.std(expected)), level, ""


def _slope_of_wing(aircraft: Aircraft, mach: np.ndarray) -> np.ndarray:
    """Return the lift curve slope of an unswept wing by Helmbold's equation, with the
    Prandtl-Glauert rule. [1/rad]
    """
    aspect = aircraft.b**2 / aircraft.S
    return 2.0 * np.pi * aspect / (2.0 + np.sqrt(4.0 + aspect**2 * np.maximum(1.0 - mach**2, 0.1)))


def _level(lift: np.ndarray, prior: np.ndarray) -> float | None:
    """Return lift over that of the prior in the middle of the record, one where they agree within
    what a prior and a vane are wrong by.
    """
    one, other = float(np.median(lift)), float(np.median(prior))
    if abs(one - other) < _LEVEL + _PART * abs(other):
        return 1.0
    return one / other if other > _LEVEL else None


def _prior_lift(
    full: ResampledChannels,
    mask: np.ndarray,
    mach: np.ndarray,
    aircraft: Aircraft,
    database: xr.DataTree | None,
) -> np.ndarray | None:
    """Return the lift coefficient of a database along the record; None without one, or where it
    needs what the record lacks.
    """
    if database is None:
        return None

    V = full["V"][mask]
    given: dict[str, Any] = {name: full[name][mask] for name in full.values}
    given |= {"mach": mach, "alpha": full["alpha_vane"][mask]}
    given["beta"] = given.get("beta_vane", 0.0)
    for rate, length in (("p", aircraft.b), ("q", aircraft.cbar), ("r", aircraft.b)):
        given[f"{rate}hat"] = 0.5 * length / V * given[rate] if rate in given else 0.0
    parts = ("CL",) if any(term.startswith("CL/") for term in terms(database)) else ("CX", "CZ")
    needed = {
        name
        for term, leaf in terms(database).items()
        if term.split("/")[0] in parts
        for name in used_coefficients(leaf)
    }
    still = {
        name: 0.0
        for name in needed
        if name not in given
        and (name.startswith(("delta_", "gear", "speedbrake")) or name.endswith("hat"))
    }
    try:
        found = [evaluate(database, part, "clamp", **given, **still) for part in parts]
    except AeromatchError:
        return None
    lift = found[0] if len(found) == 1 else lift_drag(found[0], found[1], given["alpha"])[0]
    return np.broadcast_to(lift, mach.shape)


def _against_lift(
    slope: float | None, level: float | None, channel: str, record: xr.DataTree
) -> list[Finding]:
    measure, what = (
        (slope, "slope of the lift curve") if slope is not None else (level, "lift coefficient")
    )
    if measure is None or measure <= 0.0 or SLOPE[0] <= measure <= SLOPE[1]:
        return []
    likely = [unit for unit in _UNITS if _RESTORED[0] <= measure * unit[2] <= _RESTORED[1]]
    certain = bool(likely) and not _CERTAIN[0] <= measure <= _CERTAIN[1]
    where = "the recorded mass" if channel else "the mass of the aircraft file"
    text = (
        f"with {where} the {what} is {measure:.2f} of what this wing has (limits {SLOPE[0]:g} "
        f"to {SLOPE[1]:g})"
    )
    for wrong, right, _ in likely:
        text += (
            f"{': ' if wrong == likely[0][0] else ' or '}mass is in {wrong} and was taken as "
            f"{right}"
        )
    if any(
        _RESTORED[0] <= measure * factor <= _RESTORED[1]
        for factor in (_LIFT_AREA, 1.0 / _LIFT_AREA)
    ):
        text += "; or S, cbar and b are all in another unit"
    text += "; or height or airspeed, on which dynamic pressure rests, is wrong"
    remedy = 'correct the mass in the aircraft file, with its unit: mass = "... kg"'
    if channel and likely:
        remedy = map_entry(record, channel, likely[0][2])
    return [
        Finding(
            "error" if certain else "warning",
            "weight",
            ("mass",),
            text,
            remedy,
            evidence={"ratio": measure},
        )
    ]


def _two_masses(
    stated: float, mass: float, recorded: float, wrong: bool, slope: float | None
) -> list[Finding]:
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
    return [
        Finding(
            "error" if certain else "warning",
            "weight",
            ("mass",),
            text,
            remedy,
            evidence={"ratio": stated},
        )
    ]
