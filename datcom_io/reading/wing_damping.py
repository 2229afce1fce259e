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
sound pages is 0.35 to 1.0 of it. In CLq wing and tail nearly cancel on some aircraft, so that the
print lies between bounds: each surface counts with a part of its own.
"""

from __future__ import annotations

import math

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_surface, measure_wing, sample_chords

_SECTION_SLOPE = 2.0 * math.pi  # of a thin section [1/rad]
# Up to this Mach number the correction above holds.
_LARGEST_MACH = 0.9
# Mach numbers of the supersonic method; beyond them the program's method is hypersonic.
_STRIPS = (1.0, 6.0)
_SURFACES = {"WGPLNF": "lift_wing", "HTPLNF": "lift_tail"}


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
        ``lift_tail`` with a tail, and ``lift_body``. Empty where the method does not hold. [1/rad]
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
        slope = 0.5 * math.pi * surface.aspect_ratio
        if mach > 1.0:
            slope = min(slope, 4.0 / math.sqrt(mach**2 - 1.0))
        front, rear = lead - x_cg, lead + chord - x_cg
        total += slope * 2.0 * float(np.trapezoid((rear**3 - front**3) / 3.0, stations))
        first_moment = 2.0 * float(np.trapezoid((rear**2 - front**2) / 2.0, stations))
        shares[lift] = 2.0 * slope * first_moment / (S * cbar)
    damping, lift_of_body = _body_shares(deck, x_cg)
    shares["surfaces"] = -2.0 * total / (S * cbar**2)
    shares["body"] = damping / (S * cbar**2)
    shares["lift_body"] = lift_of_body / (S * cbar)
    return shares


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
