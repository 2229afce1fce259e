"""Ranges of plausible derivatives for the configuration of an aeroplane.

Most ranges are the spread of published derivatives of nine aeroplanes with a wing, a tail behind it
and a fin, from a light single to a jet fighter, widened three times towards either side with the
sign kept (`aerodb.store.plausibility` lists the reports). A database of Digital DATCOM names its
configuration; surfaces that it does not have, and a tail ahead of the wing, change the ranges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_PUBLISHED = "three times the spread of nine published aeroplanes"
# Published lowest and highest value by coefficient and variable, signs of this product (delta_a
# positive rolls left). [1/rad; rates by pb/2V, qc/2V, rb/2V]
_SPREAD = {
    ("CL", "qhat"): (3.8, 24.97),
    ("Cm", "qhat"): (-41.63, -3.708),
    ("Cm", "alphadothat"): (-11.4, -1.0988),
    ("CY", "beta"): (-1.0107, -0.393),
    ("Cl", "beta"): (-0.142, -0.067),
    ("Cn", "beta"): (0.049, 0.2176),
    ("Cl", "phat"): (-0.57, -0.3076),
    ("Cl", "rhat"): (0.069, 0.28),
    ("Cn", "rhat"): (-0.383, -0.088),
    ("CL", "delta_e"): (0.34, 0.77),
    ("Cm", "delta_e"): (-2.16, -0.5343),
    ("Cl", "delta_a"): (-0.229, -0.057),
    ("CY", "delta_r"): (0.157, 0.338),
    ("Cn", "delta_r"): (-0.1694, -0.0717),
}
_WIDENED = 3.0
# sqrt(M^2 - 1) is 1 here; below it derivatives have the size of subsonic ones.
_SUBSONIC_SIZE = math.sqrt(2.0)
# Marks in the attribute ``configuration``: HTPLNF is ahead of WGPLNF, or it is the larger surface
# behind, so that WGPLNF is the canard.
CANARD = "(canard)"
REAR_WING = "(rear wing)"
# Root attribute with a clause on Mach numbers at which the print holds no tail.
TAIL_PRESSURE = "tail_pressure"
# Root attribute with a clause on static numbers of the print that are suspect.
SUSPECT_NUMBERS = "suspect_numbers"
_FINS = ("VERTICAL", "FIN", "PANEL")
# Cmq = -0.7 cl_alpha cos L {... + 1/8} of a wing about its own aerodynamic centre is -0.55 without
# sweep and -0.27 at 60 deg; aspect ratio 15 and 35 deg of sweep give -13 [DATCOM 7.1.1.2].
_WING_DAMPING = (-15.0, -0.25)
_WING_ONLY = "no horizontal tail: pitch damping of a wing up to 60 deg of sweep, DATCOM 7.1.1.2"
_WING_LIFT = (-5.0, 20.0)
_WING_LIFT_WHY = "no horizontal tail: (1/2 + 2 xi) CL_alpha of a wing, DATCOM 7.1.1.1"
# The fin of an aeroplane without tail stands near the centre of gravity.
_SHORT_ARM = {
    ("Cn", "beta"): (0.0, 0.6528, "no horizontal tail: weathercock stability, fin of short arm"),
    ("Cn", "rhat"): (-1.149, -0.001, "no horizontal tail: damping, fin of short arm"),
}
# Lift from which the published range of Cl_rhat holds: that of a wing is a quarter of CL.
_LIFTING = 0.3
# Sideslip derivatives of a wing and a body alone: the fin makes most of those published.
_NO_FIN = {
    ("CY", "beta"): (-3.032, 0.05, "no fin: the side force of a body, of small size"),
    ("Cn", "beta"): (0.0, 0.6528, "no fin: weathercock stability alone; a body turns away"),
    ("Cn", "rhat"): (-1.149, 0.01, "no fin: a wing damps yaw by its drag, nearly zero"),
}
_EITHER_SIGN = "a tail ahead of the wing acts against the wing, so that both signs occur"


@dataclass(frozen=True)
class PlausibleRange:
    """Range of a derivative, ends included, and its source. [1/rad]"""

    low: float
    high: float
    source: str

    def at_lift(self, CL: float) -> PlausibleRange:
        """Return a positive range of a derivative that is a part of the lift, as Cl_rhat is."""
        if CL >= _LIFTING:
            return self
        why = f"{self.source}; a wing has a quarter of CL, here {CL:.2g}"
        return PlausibleRange(0.25 * min(CL, 0.0) - self.low, self.high, why)

    def at(self, mach: float) -> PlausibleRange:
        """Return the range at a Mach number: the published derivatives are subsonic ones.

        At supersonic speed a derivative is that of linear theory, as 1 / sqrt(M^2 - 1), so that the
        end next to zero moves towards it.
        """
        if mach <= _SUBSONIC_SIZE:
            return self
        factor = 1.0 / math.sqrt(mach**2 - 1.0)
        why = f"{self.source}; times 1 / sqrt(M^2 - 1) towards zero at supersonic speed"
        if self.low > 0.0:
            return PlausibleRange(self.low * factor, self.high, why)
        if self.high < 0.0:
            return PlausibleRange(self.low, self.high * factor, why)
        return self


def derivative_ranges(configuration: str) -> dict[tuple[str, str], PlausibleRange]:
    """Return the range of each derivative by coefficient and variable.

    Parameters
    ----------
    configuration : str
        Surfaces as Digital DATCOM prints them, such as ``WING-BODY``, and `CANARD` or
        `REAR_WING`; an empty text stands for an aeroplane with a tail behind its wing and a fin.
    """
    ranges = {}
    for key, (lowest, highest) in _SPREAD.items():
        low, high = _widen(lowest, highest)
        why = f"{_PUBLISHED}, {lowest:g} to {highest:g} per radian"
        if key in (("CL", "qhat"), ("Cm", "qhat")):
            why += "; a value far outside means a wrong chord or reference point"
        if key == ("Cl", "beta"):
            # The wing of a low-wing aeroplane without dihedral cancels the fin.
            high = -high
            why += "; about zero for a low wing without dihedral"
        ranges[key] = PlausibleRange(low, high, why)
    if configuration and "HORIZONTAL" not in configuration:
        ranges[("Cm", "qhat")] = PlausibleRange(*_WING_DAMPING, _WING_ONLY)
        ranges[("CL", "qhat")] = PlausibleRange(*_WING_LIFT, _WING_LIFT_WHY)
        # A wing without tail has the lag of its own flow alone, of either sign.
        del ranges[("Cm", "alphadothat")]
        for key, (low, high, why) in _SHORT_ARM.items():
            ranges[key] = PlausibleRange(low, high, why)
        # An elevon is nearer to the centre of gravity than an elevator.
        elevon = ranges[("Cm", "delta_e")]
        why = f"{elevon.source}; an elevon down to a third of that"
        ranges[("Cm", "delta_e")] = PlausibleRange(elevon.low, elevon.high / _WIDENED, why)
    if CANARD in configuration or REAR_WING in configuration:
        for key in (("CL", "qhat"), ("Cm", "alphadothat")):
            size = max(abs(ranges[key].low), abs(ranges[key].high))
            ranges[key] = PlausibleRange(-size, size, f"{ranges[key].source}; {_EITHER_SIGN}")
    if CANARD in configuration:
        elevator = ranges[("Cm", "delta_e")]
        why = f"{elevator.source}; a surface ahead of the wing lifts the nose"
        ranges[("Cm", "delta_e")] = PlausibleRange(-elevator.high, -elevator.low, why)
    if configuration and not any(word in configuration for word in _FINS):
        for key, (low, high, why) in _NO_FIN.items():
            ranges[key] = PlausibleRange(low, high, why)
    return ranges


def _widen(lowest: float, highest: float) -> tuple[float, float]:
    """Return a range three times as wide towards either side; its sign stays."""
    if lowest < 0.0:
        return lowest * _WIDENED, highest / _WIDENED
    return lowest / _WIDENED, highest * _WIDENED


def tailless_words(subject: str, slope: float, mach: float) -> str:
    """Return the words on a value that an aircraft without horizontal tail may have.

    An imported database does not state its surfaces, and a tail with this value is wrong.
    """
    coefficient, _, variable = subject.partition("/")
    other = derivative_ranges("WING-BODY").get((coefficient, variable))
    if other is None or variable != "qhat":
        return ""
    low, high = other.at(mach).low, other.at(mach).high
    if not low <= slope <= high:
        return ""
    return (
        f"; the database does not state its surfaces. Without horizontal tail {low:.3g} to "
        f"{high:.3g} is usual: if the aircraft has none, write "
        f'"{subject}" = "no horizontal tail: ..." below [acknowledged] of the aircraft file; '
        f"with a tail the value is too small"
    )
