"""Flight conditions of a case of a plot file (unit 13), in the order of the run.

The record FLC is written before the run of the case.  Mach number and altitude of each condition
follow from its lists and from LOOP as in the main program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datcom_io.cells import OK
from datcom_io.exchange.plot_files.plot_records import PlotRecord

MOST_ANGLES = 20  # in a block, and Mach numbers and altitudes in a case
_MOST_HEIGHTS = 10
# Speed of sound of the program: 49.01685 ft/s times the root of the temperature [degR].
_SOUND = 49.01685
# Five digits of a Mach number, of a limit, of a speed and of a temperature.
_ROUNDING = 2e-4
# Program limits of a case that states none.
_STMACH, _TSMACH = 0.6, 1.4


@dataclass(frozen=True)
class ScheduledCondition:
    """A flight condition that the program runs.

    Attributes
    ----------
    mach, height : float
        Mach number and altitude [ft]; NaN where the file has none.
    is_first : bool
        First Mach number at the first altitude.
    regimes : tuple of str
        ``subsonic``, ``transonic``, ``supersonic``: the regime, or two of them where five digits do
        not decide.
    """

    mach: float
    height: float
    is_first: bool
    regimes: tuple[str, ...]


def is_number_missing(record: PlotRecord, index: int) -> bool:
    """Return whether a number, counted from 1, has the code that no card gives it."""
    return int(record.numbers(index, index)[1][0]) != OK


def run_schedule(flight: PlotRecord) -> list[ScheduledCondition]:
    """Return the flight conditions in the order of the run."""
    # FLC: 1 NMACH, 159 NALT, 160 LOOP.
    machs, heights = flight.count(1, MOST_ANGLES), flight.count(159, MOST_ANGLES)
    loop = flight.number(160)
    if loop == 2.0:
        pairs = [divmod(place, machs)[::-1] for place in range(machs * heights)]
    elif loop == 3.0:
        pairs = [divmod(place, heights) for place in range(machs * heights)]
    else:
        # Both lists step together.
        pairs = [(place, place) for place in range(machs)]
    return [_condition(flight, *pair) for pair in pairs]


def _condition(flight: PlotRecord, i: int, k: int) -> ScheduledCondition:
    """Return the condition of Mach number `i` and altitude `k`, both counted from 0."""
    # FLC: 3 MACH(20), 97 ALT(20), 117 TINF(20), 137 VINF(20).
    mach = flight.number(3 + i)
    is_exact = not is_number_missing(flight, 3)
    if not is_exact:
        # The program computes it when it comes to the condition, after it wrote FLC.
        mach = flight.number(137 + i) / (_SOUND * np.sqrt(flight.number(117 + k)))
    regimes = _regimes(flight, mach, is_exact)
    return ScheduledCondition(float(mach), flight.number(97 + k), i == 0 and k == 0, regimes)


def _regimes(flight: PlotRecord, mach: float, is_exact: bool) -> tuple[str, ...]:
    """Return the regimes that a Mach number may be in."""
    if np.isnan(mach):
        return ("subsonic", "transonic", "supersonic")
    # FLC: 94 STMACH, 95 TSMACH.
    low, high = flight.number(94), flight.number(95)
    low, high = (_STMACH if np.isnan(low) else low), (_TSMACH if np.isnan(high) else high)
    if mach <= low:
        likely = "subsonic"
    elif mach >= high:
        likely = "supersonic"
    else:
        likely = "transonic"
    regimes = [likely]
    margin = 0.0 if is_exact else _ROUNDING * mach
    # A number with more than five digits may round to the limit.
    if abs(mach - low) <= margin:
        regimes += ["subsonic", "transonic"]
    if abs(mach - high) <= margin:
        regimes += ["supersonic", "transonic"]
    return tuple(dict.fromkeys(regimes))


def ground_heights(flight: PlotRecord) -> np.ndarray:
    """Return the heights over ground. [ft]"""
    # FLC: 63 NGH, 64 GRDHT(10).
    return flight.numbers(64, 73)[0][: flight.count(63, _MOST_HEIGHTS)]


def angles_of_attack(flight: PlotRecord) -> np.ndarray:
    """Return the angles of attack. [deg]"""
    # FLC: 2 NALPHA, 23 ALSCHD(20).
    return flight.numbers(23, 42)[0][: flight.count(2, MOST_ANGLES)]
