"""Plausibility of a database: signs and sizes of its derivatives as a knowledgeable reader sees
them.

A valid file can hold the numbers of no aeroplane: a derivative with the wrong sign, a wrong chord,
a table of one angle of attack. `check_plausibility` evaluates the sum of all terms in cruise
configuration at every Mach number of the tables and compares the derivatives with ranges. Each
range states its source. A finding of an unusual aeroplane is acknowledged in its aircraft file with
a reason.

The ranges of derivatives (`aerodb.store.plausible_ranges`) rest on Teper, NASA CR-96008 (1969),
Heffley and Jewell, NASA CR-2144 (1972), Roskam, Airplane Flight Dynamics, Appendix B, Seckel,
FAA-RD-71-6 (1971), and the model GTM T2 of NASA. They depend on the configuration that a database
of Digital DATCOM names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import xarray as xr

from aerodb.store.evaluation import cruise_state, evaluate_held
from aerodb.store.plausibility_findings import PlausibilityFinding, find_outside, merge_findings
from aerodb.store.plausible_ranges import (
    SUSPECT_NUMBERS,
    TAIL_PRESSURE,
    derivative_ranges,
    tailless_words,
)
from aerodb.store.schema import database_coefficients, terms
from flightmech.errors import SchemaError
from flightmech.names import VOCABULARY
from flightmech.terms import list_regressors
from flightmech.units import DEGREE

# Derivatives whose absence a reader must know, in addition to the three static coefficients.
_ESSENTIAL = (
    ("Cm", "qhat"),
    ("CY", "beta"),
    ("Cl", "beta"),
    ("Cn", "beta"),
    ("Cl", "phat"),
    ("Cn", "rhat"),
    ("Cm", "delta_e"),
    ("Cl", "delta_a"),
    ("Cn", "delta_r"),
)
_STATIC = ("CL", "CD", "Cm")
# Range of attached flow in which slopes are taken. [rad]
_LINEAR = (-4.0 * DEGREE, 6.0 * DEGREE)
_STEP = 2.0 * DEGREE  # of sideslip and controls, central difference [rad]
_RATE_STEP = 0.01  # of the reduced rates
# Mean aerodynamic over geometric mean chord: 4/3 of a pointed wing, and a tenth for a cranked one.
# A root chord in place of the mean one gives 1.5 at a taper ratio of 0.34.
_CHORD = (0.8, 1.45)
# 0.0045 of a clean swept wing prints as 0.005, or as 0.004.
_DRAG = (0.004, 0.2)
_MARGIN = (0.0, 1.0)  # chords
_SLOPE = (0.5, 1.35)  # of the slope of a straight wing
_TRANSONIC = (0.9, 1.2)
_LARGEST_TRAVEL = 1.6  # 90 deg and a little [rad]
_REFERENCE = (-0.5, 1.5)  # chords
# From here on the lag of a wing itself, of either sign, adds to that of its downwash.
_SUPERSONIC = 1.0
_RHO_0 = 1.225  # sea level [kg/m3]
# Least range of angles in which a slope is taken. [rad]
_SHORTEST = 1.5 * DEGREE
# Difference of the Mach numbers at which static coefficients end. [1]
_SAME_END = 0.05
# Ratio of the pitch damping at neighbouring Mach numbers, up to this distance and beyond it. Sound
# listings have at most 1.8 through the speed of sound.
_STEP_OF_DAMPING, _NEIGHBOUR, _FAR_STEP = 3.0, 0.5, 6.0
_LEAST = 1e-9  # below it a derivative is absent


class HasMass(Protocol):
    """The part of an aircraft that the margins need."""

    @property
    def mass(self) -> float:
        """Mass. [kg]"""

    @property
    def cg(self) -> tuple[float, float, float]:
        """Centre of gravity from the moment reference point, body axes. [m]"""


def check_plausibility(
    db: xr.DataTree,
    aircraft: HasMass | None = None,
    acknowledged: Mapping[str, str] | None = None,
) -> list[PlausibilityFinding]:
    """Return what a knowledgeable reader would question in a database.

    Parameters
    ----------
    db : DataTree
        The database.
    aircraft : Aircraft, optional
        With its mass the manoeuvre margin is checked, and both margins about its centre of gravity.
        Limits of its controls and its reference point in the chord are checked, too.
    acknowledged : mapping of str to str, optional
        Reasons by the subject of a finding; an acknowledged finding stays in the list.

    Returns
    -------
    list of PlausibilityFinding
        One for each subject, with its worst Mach number, then one for each acknowledgement that
        belongs to none of them.

    Raises
    ------
    SchemaError
        An acknowledgement without a reason.
    """
    reasons = acknowledged or {}
    problems = []
    for subject, reason in reasons.items():
        if not reason.strip():
            problems.append(f"{subject}: no reason is given; state why the value is right")
    if problems:
        raise SchemaError("acknowledged", problems)
    machs, state = _mach_numbers(db), cruise_state(db)
    findings = [*_check_lengths(db), *_check_alphas(db), *_check_mach_ends(db)]
    if clause := str(db.attrs.get(TAIL_PRESSURE, "")):
        findings.append(PlausibilityFinding("tail pressure", "implausible", source=clause))
    elif clause := str(db.attrs.get(SUSPECT_NUMBERS, "")):
        findings.append(PlausibilityFinding("print", "implausible", source=clause))
    # Without lift over several alphas no slope exists.
    if not findings or all(item.subject != "angles of attack" for item in findings):
        findings += merge_findings(_check_slopes(db, machs, state, aircraft=aircraft), machs)
    findings += merge_findings(_check_derivatives(db, machs, state), machs)
    findings += merge_findings(_check_steps_of_damping(db, machs, state), machs)
    if "Cm" in _present_coefficients(db):
        findings += merge_findings(_check_trim(db, machs, state), machs)
    findings += _find_missing(db, machs, state)
    if aircraft is not None:
        findings += _check_aircraft(aircraft)
    else:
        why = "it needs mass and centre of gravity of the aircraft: give the aircraft file"
        findings.append(PlausibilityFinding("manoeuvre margin", "not checked", source=why))
    reasoned = [replace(item, reason=reasons.get(item.subject, "")) for item in findings]
    return [*reasoned, *_find_unused(reasons, [item.subject for item in findings])]


def _find_unused(
    reasons: Mapping[str, str], subjects: Sequence[str]
) -> Iterator[PlausibilityFinding]:
    """Yield the acknowledgements whose subject is not one of `subjects`, which is often
    misspelt.
    """
    listed = ", ".join(subjects) or "none"
    for subject in reasons:
        if subject not in subjects:
            why = f"no finding of this database has the subject; its subjects are: {listed}; "
            why += "correct it, or remove the line from [acknowledged] unless another database of "
            why += "the aircraft needs it"
            yield PlausibilityFinding(f"the acknowledgement of {subject!r}", "unused", source=why)


def _mach_numbers(db: xr.DataTree) -> np.ndarray:
    """Return all Mach numbers of the tables of CL, CD and Cm; 0 alone without a Mach axis."""
    machs: set[float] = set()
    for name, leaf in terms(db).items():
        if name.split("/")[0] in (*_STATIC, "CX", "CZ") and "mach" in leaf.dims:
            machs.update(np.round(leaf["mach"].values.astype(float), 6))
    positive = sorted(mach for mach in machs if mach > 0.0)
    return np.array(positive or [0.0])


def _check_lengths(db: xr.DataTree) -> Iterator[PlausibilityFinding]:
    """Yield a chord that does not belong to the area and the span."""
    ratio = float(db.attrs["cbar"]) * float(db.attrs["b"]) / float(db.attrs["S"])
    low, high = _CHORD
    if not low <= ratio <= high:
        why = "cbar b/S is 1 for a rectangular and 1.33 for a pointed wing"
        yield PlausibilityFinding("reference lengths", "implausible", ratio, low, high, source=why)


def _check_alphas(db: xr.DataTree) -> Iterator[PlausibilityFinding]:
    """Yield a database that does not depend on alpha, or knows one angle of attack only."""
    count, has_regressor = 0, False
    for name, leaf in terms(db).items():
        if name.split("/")[0] in ("CL", "CZ"):
            if "alpha" in leaf.dims:
                count = max(count, leaf.sizes["alpha"])
            has_regressor = has_regressor or "alpha" in list_regressors(leaf)
    if count < 2 and not has_regressor:
        why = "the lift of an aeroplane depends on alpha: its tables need several angles"
        yield PlausibilityFinding(
            "angles of attack", "implausible", float(count), 2.0, np.inf, source=why
        )


def _check_mach_ends(db: xr.DataTree) -> Iterator[PlausibilityFinding]:
    """Yield a static coefficient whose tables end at a lower Mach number than those of others."""
    ends: dict[str, float] = {}
    for name, leaf in terms(db).items():
        coefficient = name.split("/")[0]
        is_static = coefficient in (*_STATIC, "CX", "CZ") and not list_regressors(leaf)
        if is_static and "mach" in leaf.dims:
            ends[coefficient] = max(ends.get(coefficient, 0.0), float(leaf["mach"].max()))
    last = max(ends.values(), default=0.0)
    for coefficient, end in ends.items():
        if end < last - _SAME_END:
            why = f"its tables end there, those of other static coefficients at Mach {last:g}"
            yield PlausibilityFinding(
                f"{coefficient}/mach", "implausible", end, last, np.inf, source=why
            )


def _check_steps_of_damping(
    db: xr.DataTree, machs: np.ndarray, base: Mapping[str, Any]
) -> Iterator[tuple[PlausibilityFinding, float]]:
    """Yield a pitch damping that jumps from one Mach number to the next."""
    values = [_derivative(db, "Cm", "qhat", mach=mach, base=base) for mach in machs]
    for k in range(1, machs.size):
        before, here = values[k - 1], values[k]
        if not before or not here or before > 0.0 or here > 0.0:
            continue
        # Neighbouring Mach numbers differ less than distant ones.
        largest = _STEP_OF_DAMPING
        if machs[k] - machs[k - 1] > _NEIGHBOUR:
            largest = _FAR_STEP
        ratio = max(before / here, here / before)
        why = f"ratio of {before:.4g} at Mach {machs[k - 1]:g} and {here:.4g}: one of both is wrong"
        yield from find_outside(
            "Cm/qhat over Mach", ratio, 0.0, high=largest, why=why, mach=machs[k]
        )


def _check_slopes(
    db: xr.DataTree, machs: np.ndarray, base: Mapping[str, Any], aircraft: HasMass | None
) -> Iterator[tuple[PlausibilityFinding, float]]:
    """Yield lift slope, margins and drag outside their ranges, with the Mach number."""
    S, b, cbar = (float(db.attrs[name]) for name in ("S", "b", "cbar"))
    present = _present_coefficients(db)
    low_alpha, high_alpha = _linear_range(db)
    if high_alpha - low_alpha < _SHORTEST:
        why = "the tables of the lift have no angles of attached flow, -4 to 6 deg"
        for subject in ("CL/alpha", "CD", "static margin", "manoeuvre margin"):
            yield PlausibilityFinding(subject, "not checked", source=why), machs[0]
        return
    alpha = np.linspace(low_alpha, high_alpha, 11)
    for mach in machs:
        state = {**base, "mach": np.full(alpha.size, mach), "alpha": alpha}
        CL, CD, Cm = (evaluate_held(db, name, state) for name in _STATIC)
        CL_alpha = float(np.polyfit(alpha, CL, 1)[0])
        Cm_alpha = float(np.polyfit(alpha, Cm, 1)[0])
        straight = _straight_wing_slope(b**2 / S, mach)
        if np.isfinite(straight):
            why = (
                f"lift-line slope of a straight wing of aspect ratio {b**2 / S:.3g}; sweep lowers "
            )
            why += "it, the tail and the body raise it"
            low, high = _SLOPE[0] * straight, _SLOPE[1] * straight
            yield from find_outside("CL/alpha", CL_alpha, low, high=high, why=why, mach=mach)
        if {"CD", "CX"} & present:
            why = "drag of an aeroplane at low lift"
            yield from find_outside("CD", float(CD.min()), *_DRAG, why, mach)
        if abs(CL_alpha) < _LEAST or "Cm" not in present:
            continue
        margin, point = -Cm_alpha / CL_alpha, "moment reference point"
        if aircraft is not None:
            # The lift acts at the reference point, x_cg behind the centre of gravity.
            margin, point = margin + aircraft.cg[0] / cbar, "centre of gravity of the aircraft file"
        why = f"a stable aeroplane about the {point}; an unstable one is acknowledged"
        yield from find_outside("static margin", margin, *_MARGIN, why, mach)
        damping = _derivative(db, "Cm", "qhat", mach=mach, base=base)
        if aircraft is not None and damping is not None:
            # h_m = h_n - (rho S cbar / 4 m) Cm_qhat, at sea level.
            manoeuvre = margin - _RHO_0 * S * cbar / (4.0 * aircraft.mass) * damping
            why = "positive elevator per g at sea level about the centre of gravity"
            yield from find_outside(
                "manoeuvre margin", manoeuvre, 0.0, high=5.0, why=why, mach=mach
            )


def _check_trim(
    db: xr.DataTree, machs: np.ndarray, base: Mapping[str, Any]
) -> Iterator[tuple[PlausibilityFinding, float]]:
    """Yield a Cm that no deflection of the elevator in its table balances at any attached alpha."""
    # Travel of the elevator: the range of the tables of Cm over it.
    travel = [np.inf, -np.inf]
    for name, leaf in terms(db).items():
        if name.split("/")[0] == "Cm" and "delta_e" in leaf.dims:
            points = leaf["delta_e"].values.astype(float)
            travel = [min(travel[0], points.min()), max(travel[1], points.max())]
    low_alpha, high_alpha = _linear_range(db)
    if travel[1] <= travel[0] or high_alpha - low_alpha < _SHORTEST:
        return
    alpha = np.linspace(low_alpha, high_alpha, 11)
    for mach in machs:
        state = {**base, "mach": np.full(alpha.size, mach), "alpha": alpha}
        # Cm is nearly linear in the elevator, so its ends bound Cm.
        ends = [evaluate_held(db, "Cm", {**state, "delta_e": np.full(11, end)}) for end in travel]
        low, high = min(map(np.min, ends)), max(map(np.max, ends))
        why = f"pitching moment over alpha {low_alpha / DEGREE:.3g} to {high_alpha / DEGREE:.3g} "
        why += f"deg and delta_e {travel[0] / DEGREE:.3g} to {travel[1] / DEGREE:.3g} deg: nowhere "
        why += "is it zero, so that the aeroplane cannot be trimmed"
        nearest = low if low > 0.0 else high
        if low > 0.0 or high < 0.0:
            yield PlausibilityFinding("trim", "implausible", nearest, source=why), mach


def _lift_at(db: xr.DataTree, mach: float, base: Mapping[str, Any]) -> float:
    """Return the lift coefficient at the angle of the derivatives."""
    if not {"CL", "CZ"} & _present_coefficients(db):
        return np.inf
    state = {**base, "mach": np.full(1, mach), "alpha": np.full(1, 2.0 * DEGREE)}
    return float(evaluate_held(db, "CL", state)[0])


def _linear_range(db: xr.DataTree) -> tuple[float, float]:
    """Return the part of the range of attached flow that the tables of the lift cover. [rad]"""
    low, high = _LINEAR
    for name, leaf in terms(db).items():
        is_lift = name.split("/")[0] in ("CL", "CZ") and not list_regressors(leaf)
        if is_lift and leaf.sizes.get("alpha", 1) > 1:
            low = max(low, float(leaf["alpha"].min()))
            high = min(high, float(leaf["alpha"].max()))
    return low, high


def _check_derivatives(
    db: xr.DataTree, machs: np.ndarray, base: Mapping[str, Any]
) -> Iterator[tuple[PlausibilityFinding, float]]:
    """Yield derivatives outside the widened spread of published ones, with the Mach number."""
    configuration = str(db.attrs.get("configuration", ""))
    for (coefficient, variable), item in derivative_ranges(configuration).items():
        for mach in machs:
            if variable == "alphadothat" and mach >= _SUPERSONIC:
                continue
            slope = _derivative(db, coefficient, variable, mach=mach, base=base)
            if slope is not None:
                subject, found = f"{coefficient}/{variable}", item.at(mach)
                if subject == "Cl/rhat":
                    found = found.at_lift(_lift_at(db, mach, base))
                why = found.source
                if not configuration:
                    why += tailless_words(subject, slope, mach)
                if variable.startswith("delta_") and found.low <= -slope <= found.high:
                    why += (
                        f"; with the other sign it is in the range: the sign of the control "
                        f"{variable} of its source is wrong"
                    )
                yield from find_outside(
                    subject, slope, found.low, high=found.high, why=why, mach=mach
                )


def _check_aircraft(aircraft: Any) -> Iterator[PlausibilityFinding]:
    """Yield numbers of an aircraft file that are in another unit than SI."""
    for name, ends in getattr(aircraft, "limits", {}).items():
        largest = max(map(abs, ends))
        if name in VOCABULARY and VOCABULARY[name].units == "rad" and largest > _LARGEST_TRAVEL:
            why = "travel of a surface; a bare number is in rad, write '20 deg'"
            yield PlausibilityFinding(
                f"limits {name}", "implausible", largest, 0.0, _LARGEST_TRAVEL, source=why
            )
    fraction = float(getattr(aircraft, "x_ref_mac", 0.25))
    low, high = _REFERENCE
    if not low <= fraction <= high:
        why = "chords behind the leading edge of the mean chord; 27 % is 0.27"
        yield PlausibilityFinding("x_ref_mac", "implausible", fraction, low, high, source=why)


def _find_missing(
    db: xr.DataTree, machs: np.ndarray, base: Mapping[str, Any]
) -> Iterator[PlausibilityFinding]:
    """Yield coefficients without a term, and essential derivatives without a source."""
    present = _present_coefficients(db)
    for coefficient in database_coefficients(db):
        if coefficient not in present:
            # An aeroplane without lift, drag or pitching moment cannot be flown.
            kind = "missing" if coefficient in ("CY", "Cl", "Cn") else "implausible"
            yield PlausibilityFinding(
                coefficient, kind, source="no term: the simulation takes it as zero"
            )
    for coefficient, variable in _ESSENTIAL:
        if coefficient not in present:
            continue
        if _derivative(db, coefficient, variable, mach=machs[0], base=base) is None:
            why = "no term depends on it: the simulation takes it as zero"
            yield PlausibilityFinding(f"{coefficient}/{variable}", "missing", source=why)


def _present_coefficients(db: xr.DataTree) -> set[str]:
    """Return the coefficients that have a term."""
    return {name.split("/")[0] for name in terms(db)}


def _straight_wing_slope(aspect_ratio: float, mach: float) -> float:
    """Return the lift slope of a straight wing, NaN in the transonic regime. [1/rad]

    2 pi A / (2 + sqrt(A^2 beta^2 + 4)) below, 4 / sqrt(M^2 - 1) above the speed of sound [DATCOM
    4.1.3.2].
    """
    if mach >= _TRANSONIC[1]:
        return 4.0 / np.sqrt(mach**2 - 1.0)
    if mach > _TRANSONIC[0]:
        return np.nan
    beta = np.sqrt(1.0 - mach**2)
    return 2.0 * np.pi * aspect_ratio / (2.0 + np.sqrt((aspect_ratio * beta) ** 2 + 4.0))


def _derivative(
    db: xr.DataTree, coefficient: str, variable: str, *, mach: float, base: Mapping[str, Any]
) -> float | None:
    """Return a central difference at alpha = 2 deg, None if no term depends on the variable.

    `base` is the result of `cruise_state`, which takes longer than the difference.
    A table that begins at zero deflection gives a one-sided difference.
    """
    step = _STEP
    if variable.endswith("hat"):
        step = _RATE_STEP
    low, high = -step, step
    for name, leaf in terms(db).items():
        if name.split("/")[0] == coefficient and variable in leaf.dims:
            points = leaf[variable].values.astype(float)
            low, high = max(low, points.min()), min(high, points.max())
    if high <= low:
        return None
    state = {**base, "mach": np.full(2, mach), "alpha": np.full(2, 2.0 * DEGREE)}
    state[variable] = np.array([low, high])
    ends = evaluate_held(db, coefficient, state)
    slope = float((ends[1] - ends[0]) / (high - low))
    if abs(slope) < _LEAST:
        return None
    return slope
