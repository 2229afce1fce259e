"""Pitch damping from the planforms of a deck, to compare the printed one with.

The straight-tapered wing of aspect ratio A and quarter-chord sweep L whose aerodynamic centre lies
xi mean chords behind the moment centre has at low speed [DATCOM 7.1.1.1, 7.1.1.2]

    CLq = (1/2 + 2 xi) CL_alpha
    Cmq = -0.7 cl_alpha cos L {A (xi/2 + 2 xi^2) / (A + 2 cos L)
                               + A^3 tan^2 L / (24 (A + 6 cos L)) + 1/8}

and its Mach number changes Cmq by the ratio of A^3 tan^2 L / (A B + 6 cos L) + 3/B, with
B = sqrt(1 - M^2 cos^2 L), to the same at low speed. On 64 public and own listings the print of a
wing, a wing-body, or an aeroplane less its tail's share differs from it by at most 0.9 per radian
and 16 %, for xi from -3.3 to 3.4, unless the program's own method is near its pole.

At supersonic speed each strip of wing and tail carries the lift of thin-aerofoil theory at its own
incidence q (x - x_cg) / V, so that [DATCOM 4.1.3.2, 7.1.1.2, 7.4.1.2]

    Cmq = -2 K / (S cbar^2) sum of the integrals of (x - x_cg)^2 over wing and tail,

    CLq = 2 K / (S cbar) sum of the integrals of (x - x_cg),

with K = 4 / sqrt(M^2 - 1), at most pi A / 2 of a slender wing. The body adds slender-body theory

    Cmq = -4 / (S cbar^2) {(x_b - x_cg)^2 S_b - integral of (x - x_cg) S(x) dx}    [DATCOM 7.2.1.2]
    CLq = 4 / (S cbar) (x_b - x_cg) S_b    [DATCOM 7.2.1.1]

for its base S_b at x_b. Tips, and the downwash in which a tail flies, lower the first: the print of
sound pages is 0.35 to 1.0 of it. A wing behind the Mach cone of its apex tends to slender-wing
theory, where all lift has the incidence of the trailing edge, so that its CLq lies between that of
strips and 2 K / (S cbar) times the integral of the chord times the arm of the trailing edge. So
does that of transonic pages, whose fairing starts at the subsonic (1/2 + 2 xi) CL_alpha.

In CLq wing and tail nearly cancel on some aircraft, so that the print lies between bounds: each
surface counts with a part of its own. Two relations within the page bring the bounds together. The
damping of a tail is its CLq times its arm, so that CMQ less the part of wing and body gives the CLq
of the tail. And the lift that a pitch rate adds acts about where that of the angle of attack does,
so that CLq of a wing is about -2 Cm_alpha; it is more with a tail in downwash, which lowers
Cm_alpha alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_surface, measure_wing, sample_chords

_SECTION_SLOPE = 2.0 * math.pi  # of a thin section [1/rad]
# Up to this Mach number the correction above holds.
_LARGEST_MACH = 0.9
# Mach numbers of the supersonic method; beyond them the program's method is hypersonic.
_STRIPS = (1.0, 6.0)
_SURFACES = {"WGPLNF": "lift_wing", "HTPLNF": "lift_tail"}
# Least and largest part of CMQ and CLQ of the strips, on sound pages 0.35 to 1.1, and largest part
# of those of the body.
STRIPS_LEAST, STRIPS_MOST, BODY_MOST = 0.25, 1.2, 1.5
# Amounts per radian in the bounds of CLQ by strips, by CMQ (below and above), and by CMA.
_BY_STRIPS, _BELOW_DAMPING, _ABOVE_DAMPING, _BY_MOMENT = 1.0, 0.5, 1.0, 0.25
_ARM_OFF = 0.15  # part of the arm of a tail
_LEAST_PART = 0.7  # of -2 CMA
# Up to this Mach number static pages come from the transonic fairing, whose CMA is not linear
# theory (the largest TSMACH).
_LINEAR_THEORY = 1.4


def estimate_wing_share(deck: Deck, mach: float) -> dict[str, float]:
    """Return CLQ and CMQ of the wing of a deck, empty where the method does not hold.

    Parameters
    ----------
    deck : Deck
    mach : float
        Mach number of the page.

    Returns
    -------
    dict of str to float
        ``CL_qhat`` and ``Cm_qhat`` by the reference quantities of the deck. [1/rad]
    """
    wing, x_cg = measure_wing(deck), deck.value("SYNTHS", "XCG")
    if wing is None or x_cg is None or not mach <= _LARGEST_MACH:
        return {}
    S = deck.value("OPTINS", "SREF") or wing.area
    cbar = deck.value("OPTINS", "CBARR") or wing.mean_chord
    A, cos, tan = wing.aspect_ratio, math.cos(wing.sweep), math.tan(wing.sweep)
    xi = (wing.leading_edge + 0.25 * wing.mean_chord - x_cg) / wing.mean_chord
    B = math.sqrt(1.0 - (mach * cos) ** 2)
    # Lift-line slope with sweep [DATCOM 4.1.3.2].
    slope = 2.0 * math.pi * A / (2.0 + math.sqrt((A * B / cos) ** 2 + 4.0))
    swept = A**3 * tan**2
    arm = A * (0.5 * xi + 2.0 * xi**2) / (A + 2.0 * cos)
    damping = -0.7 * _SECTION_SLOPE * cos * (arm + swept / (24.0 * (A + 6.0 * cos)) + 0.125)
    damping *= (swept / (A * B + 6.0 * cos) + 3.0 / B) / (swept / (A + 6.0 * cos) + 3.0)
    area, chord = wing.area / S, wing.mean_chord / cbar
    return {
        "CL_qhat": (0.5 + 2.0 * xi) * slope * area * chord,
        "Cm_qhat": damping * area * chord**2,
    }


def estimate_supersonic_shares(deck: Deck, mach: float, has_tail: bool) -> dict[str, float]:
    """Return CMQ and CLQ of the surfaces and of the body of a deck at supersonic speed.

    Parameters
    ----------
    deck : Deck
    mach : float
        Mach number of the page.
    has_tail : bool
        Whether the page is that of wing and horizontal tail, not of the wing alone.

    Returns
    -------
    dict of str to float
        CMQ: ``surfaces`` by strips, an upper bound in size, and ``body``; CLQ: ``lift_wing``,
        ``lift_tail`` with a tail, ``lift_body``, and ``slender_wing``, the larger of that by strips
        and by slender-wing theory where it holds; ``wing``: CMQ of the wing alone. With a tail
        ``arm``: centroid of its area behind the moment centre [CBARR], NaN if it is nearer than one
        of its mean chords. Empty where the method does not hold. [1/rad]
    """
    x_cg, wing = deck.value("SYNTHS", "XCG"), measure_wing(deck)
    if wing is None or x_cg is None or not _STRIPS[0] <= mach <= _STRIPS[1]:
        return {}
    S = deck.value("OPTINS", "SREF") or wing.area
    cbar = deck.value("OPTINS", "CBARR") or wing.mean_chord
    total, shares = 0.0, {}
    for name, lift in list(_SURFACES.items())[: 1 + has_tail]:
        surface, sampled = measure_surface(deck, name), sample_chords(deck, name)
        if surface is None or sampled is None:
            return {}
        stations, chord, lead = sampled
        # Lift slope of slender-wing theory, pi A / 2, and of thin aerofoils at supersonic speed,
        # 4 / sqrt(M^2 - 1); the smaller one holds.
        slope = 0.5 * math.pi * surface.aspect_ratio
        if mach > 1.0:
            slope = min(slope, 4.0 / math.sqrt(mach**2 - 1.0))
        # A strip at x behind the moment centre sees the incidence x q / V. Its lift is
        # proportional to x, its moment to x^2; both are integrated over the chord in closed form.
        front, rear = lead - x_cg, lead + chord - x_cg
        total += slope * 2.0 * float(np.trapezoid((rear**3 - front**3) / 3.0, stations))
        first_moment = 2.0 * float(np.trapezoid((rear**2 - front**2) / 2.0, stations))
        shares[lift] = 2.0 * slope * first_moment / (S * cbar)
        if name == "WGPLNF":
            shares["slender_wing"] = shares[lift]
            # With a leading edge behind the Mach cone slender-wing theory holds: the lift of
            # a section follows the incidence at its trailing edge.
            is_behind = lead[-1] - lead[0] > math.sqrt(mach**2 - 1.0) * stations[-1]
            if is_behind or mach < _LINEAR_THEORY:
                moment = 2.0 * float(np.trapezoid(chord * rear, stations))
                shares["slender_wing"] = 2.0 * slope * moment / (S * cbar)
            shares["wing"] = -2.0 * total / (S * cbar**2)
        else:
            arm = first_moment / surface.area
            shares["arm"] = arm / cbar if arm >= surface.mean_chord else math.nan
    damping, lift_of_body = _body_shares(deck, x_cg)
    shares["surfaces"] = -2.0 * total / (S * cbar**2)
    shares["body"] = damping / (S * cbar**2)
    shares["lift_body"] = lift_of_body / (S * cbar)
    return shares


def bound_supersonic_lift(
    mach: float, strips: Mapping[str, float], damping: float, moment_slope: float
) -> tuple[float, float]:
    """Return the lowest and highest supersonic CLQ that fits strips, CMQ and CMA. [1/rad]

    Parameters
    ----------
    mach : float
    strips : mapping of str to float
        `estimate_supersonic_shares`; without it CMA alone is a bound.
    damping, moment_slope : float
        CMQ and CMA of the page, NaN where there is none. [1/rad]

    Returns
    -------
    tuple of float
        Infinite where nothing bounds CLQ, as at subsonic speed.
    """
    low, high = -math.inf, math.inf
    if strips:
        low, high = -_BY_STRIPS, _BY_STRIPS
        for names in (("lift_wing", "slender_wing"), ("lift_tail",)):
            lifts = [strips.get(name, 0.0) for name in names]
            low += min(STRIPS_LEAST * lifts[0], STRIPS_MOST * lifts[0])
            high += max(STRIPS_LEAST * max(lifts), STRIPS_MOST * max(lifts))
        body = BODY_MOST * strips["lift_body"]
        low, high = low + min(0.0, body), high + max(0.0, body)
        arm = strips.get("arm", math.nan)
        if math.isfinite(arm) and math.isfinite(damping):
            least, most = _bound_lift_by_damping(strips, damping, arm)
            low, high = max(low, least - _BELOW_DAMPING), min(high, most + _ABOVE_DAMPING)
    # A tail ahead of the moment centre adds less to CLQ than to -2 CMA.
    is_behind = strips.get("lift_tail", 0.0) >= 0.0
    if mach >= _LINEAR_THEORY and is_behind and math.isfinite(moment_slope):
        parts = (_LEAST_PART, 2.0 - _LEAST_PART)
        low = max(low, min(-2.0 * moment_slope * part for part in parts) - _BY_MOMENT)
    return low, high


def _bound_lift_by_damping(
    strips: Mapping[str, float], damping: float, arm: float
) -> tuple[float, float]:
    """Return the lowest and highest CLQ of wing, body and the tail that leaves `damping` of all.

    CMQ = wing + body - arm tail, so that the tail has (wing + body - CMQ) / arm of CLQ.
    """
    lows, highs = [], []
    for length in ((1.0 - _ARM_OFF) * arm, (1.0 + _ARM_OFF) * arm):
        # Wing and body count with parts that do not depend on each other.
        body = BODY_MOST * (strips["lift_body"] + strips["body"] / length)
        least = strips["lift_wing"] + strips["wing"] / length
        most = strips["slender_wing"] + strips["wing"] / length
        tail = -damping / length
        lows.append(tail + min(STRIPS_LEAST * least, STRIPS_MOST * least) + min(0.0, body))
        highs.append(tail + max(STRIPS_LEAST * most, STRIPS_MOST * most) + max(0.0, body))
    return min(lows), max(highs)


def _body_shares(deck: Deck, x_cg: float) -> tuple[float, float]:
    """Return S cbar^2 CMQ and S cbar CLQ of the body by slender-body theory, 0 without cards."""
    count = deck.count("BODY", "NX") or 0
    x = np.array(deck.values("BODY", "X")[:count])
    area = np.array(deck.values("BODY", "S")[:count])
    if not area.size:
        area = math.pi * np.array(deck.values("BODY", "R")[:count]) ** 2
    if x.size < 2 or area.size != x.size or not (np.isfinite(x) & np.isfinite(area)).all():
        return 0.0, 0.0
    base = (x[-1] - x_cg) ** 2 * area[-1]
    damping = -4.0 * float(base - np.trapezoid((x - x_cg) * area, x))
    return damping, 4.0 * float((x[-1] - x_cg) * area[-1])
