"""Pitch damping of the wing itself from its planform, to compare the printed one with.

The straight-tapered wing of aspect ratio A and quarter-chord sweep L whose aerodynamic centre lies
xi mean chords behind the moment centre has at low speed [DATCOM 7.1.1.1, 7.1.1.2]

    CLq = (1/2 + 2 xi) CL_alpha
    Cmq = -0.7 cl_alpha cos L {A (xi/2 + 2 xi^2) / (A + 2 cos L)
                               + A^3 tan^2 L / (24 (A + 6 cos L)) + 1/8}

and its Mach number changes Cmq by the ratio of A^3 tan^2 L / (A B + 6 cos L) + 3/B, with
B = sqrt(1 - M^2 cos^2 L), to the same at low speed. On 64 public and own listings the print of a
wing, a wing-body, or an aeroplane less its tail's share differs from it by at most 0.9 per radian
and 16 %, for xi from -3.3 to 3.4, unless the program's own method is near its pole.
"""

from __future__ import annotations

import math

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_wing

_SECTION_SLOPE = 2.0 * math.pi  # of a thin section [1/rad]
# Up to this Mach number the correction above holds.
_LARGEST_MACH = 0.9


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
