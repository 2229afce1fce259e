"""Lift slope and roll damping of subsonic pages, by lifting-line theory of the wing.

With A the aspect ratio, L the sweep of the quarter-chord line and B = sqrt(1 - (M cos L)^2), a wing
has the slopes [DATCOM 4.1.3.2; each half as a wing of A / 2, 7.1.2.2]

    CL_alpha = 2 pi A / (2 + sqrt((A B / cos L)^2 + 4)),
    a_roll   = 2 pi A / (4 + sqrt((A B / cos L)^2 + 16)),
    CLP      = -4 a_roll / (S b^2) integral of c y^2 dy over the half span.

Up to Mach 0.6 the change of CL with alpha on 61 listings and 92 random aircraft is 0.67 to 1.31 of
the first, tail and power included; CLP on 37 listings and 110 random aircraft is 0.63 to 1.42 of
the last. Two faults of the program are outside.

*Cranked wings*: with TYPE=2 or 3 most wings lose half of their lift or more.

*The angle of zero lift*: the program looks it up in CL of the wing-body as a table that must rise.
Behind the stall CL falls, and the angle may be any. CLP is divided by the lift slope there, and
CYP and CNP use the angle: CLP of a light jet is -0.43 with angles of attack up to 16 deg, +0.99 up
to 32 deg and -1.38 up to 60 deg. A list that starts above zero lift extrapolates.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from datcom_io.arrays.conditions import printed_condition
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_main_wing, measure_surface, sample_chords
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.reading.suspects import columns_of, with_suspects

SUBSONIC = 0.6
"""Mach number up to which the methods are subsonic, the default of STMACH."""
_LINEAR = 6.0  # attached flow [deg]
_LEAST_SPAN = 2.0  # of the angles of attack that give a slope [deg]
# Least and largest part of the estimates; a tail adds its part of the area to the second of lift.
_LIFT_PARTS, _ROLL_PARTS = (0.55, 1.7), (0.5, 1.6)
_BY_LIFT: tuple[str, ...] = ("CD", "CL", "Cm", "CN", "CA", "xcp", "CL_alpha", "Cm_alpha")
_BY_ROLL: tuple[str, ...] = ("Cl_phat", "CY_phat", "Cn_phat")


class WingSlopes(NamedTuple):
    """Lift slope and roll damping of a wing by the reference quantities of a deck. [1/rad]"""

    lift: float
    roll: float


def estimate_wing_slopes(deck: Deck, mach: float) -> WingSlopes | None:
    """Return lift slope and roll damping of the wing of a deck, None without its planform cards.

    Parameters
    ----------
    deck : Deck
    mach : float
        Mach number, below 1.

    Returns
    -------
    WingSlopes or None
        CL_alpha, positive, and CLP, negative. [1/rad]
    """
    wing, sampled = measure_surface(deck, "WGPLNF"), sample_chords(deck, "WGPLNF")
    if wing is None or sampled is None:
        return None
    stations, chord, _ = sampled
    S = deck.value("OPTINS", "SREF") or wing.area
    b = deck.value("OPTINS", "BLREF") or wing.span
    A, cos = wing.aspect_ratio, math.cos(wing.sweep)
    effective = (A / cos) ** 2 * (1.0 - (mach * cos) ** 2)
    lift = 2.0 * math.pi * A / (2.0 + math.sqrt(effective + 4.0))
    rolling = 2.0 * math.pi * A / (4.0 + math.sqrt(effective + 16.0))
    moment = float(np.trapezoid(chord * stations**2, stations))
    return WingSlopes(lift * wing.area / S, -4.0 * rolling * moment / (S * b**2))


def flag_attached_flow(case: Case) -> None:
    """Flag lift, and derivatives with roll rate, that the wing of the cards cannot have."""
    if measure_surface(case.deck, "WGPLNF") is None:
        return
    # Limits hold for the larger surface; that of a canard configuration may be HTPLNF.
    wing, tail = measure_surface(case.deck, "WGPLNF"), measure_surface(case.deck, "HTPLNF")
    is_main = measure_main_wing(case.deck) == wing
    more = 1.0
    if wing is not None and tail is not None:
        more += tail.area / wing.area
    reports: dict[tuple[str, str], tuple[int, str, list[float]]] = {}
    stalled: set[tuple[str, object]] = set()
    for i, page in enumerate(case.pages):
        has_tail = "HORIZONTAL" in page.configuration
        if "WING" not in page.configuration or (has_tail and not is_main):
            continue
        if page.kind not in ("static", "dynamic") or not page.condition("mach") <= SUBSONIC:
            continue
        slopes = estimate_wing_slopes(case.deck, page.condition("mach"))
        if slopes is None:
            continue
        key = (page.configuration, printed_condition(page))
        if page.kind == "static":
            if _falls(page):
                stalled.add(key)
            # Ground effect raises the slope.
            text = ""
            if math.isinf(page.ground_height):
                text = _judge_lift(page, slopes.lift, more if has_tail else 1.0)
            table, names, name = "static", _BY_LIFT, "CL"
        else:
            text = _judge_roll(page, slopes.roll, case.deck.deriv, key in stalled)
            table, names, name = "dynamic", _BY_ROLL, "CLP"
        if text:
            case.pages[i] = with_suspects(page, table, names)
            first = (page.first, text, list[float]())
            reports.setdefault((page.configuration, name), first)[2].append(page.condition("mach"))
    for (configuration, name), (line, text, machs) in reports.items():
        at = " ".join(f"{mach:g}" for mach in dict.fromkeys(machs))
        sentence = f"{name} of {configuration} does not fit the planform at Mach {at}: {text}"
        case.messages.append(ListingMessage(line, sentence, "reader"))


def _falls(page: Page) -> bool:
    """Return whether CL falls somewhere with the angle of attack."""
    table = page.table("static")
    if table is None:
        return False
    lift = columns_of(table)["CL"]
    return bool((np.diff(lift[np.isfinite(lift)]) < 0.0).any())


def _judge_lift(page: Page, estimate: float, more: float) -> str:
    """Return what is wrong with the slope of CL in attached flow, nothing if it is possible."""
    table = page.table("static")
    if table is None:
        return ""
    columns = columns_of(table)
    alpha, lift = columns["alpha"], columns["CL"]
    rows = (np.abs(alpha) <= _LINEAR) & np.isfinite(lift)
    if rows.sum() < 2 or np.ptp(alpha[rows]) < _LEAST_SPAN:
        return ""
    slope = float(np.polyfit(np.radians(alpha[rows]), lift[rows], 1)[0])
    low, high = _LIFT_PARTS[0] * estimate, _LIFT_PARTS[1] * more * estimate
    if low <= slope <= high:
        return ""
    return (
        f"it changes by {slope:.3g} per radian up to {_LINEAR:g} deg, where the wing has about "
        f"{estimate:.3g}; the forces, moments and slopes of the page are flagged suspect; use "
        f"TYPE=1.0 for a cranked wing (TYPE=3.0 loses most of the lift), or check the planforms, "
        f"SREF and the sections"
    )


def _judge_roll(page: Page, estimate: float, deriv: str, has_stall: bool) -> str:
    """Return what is wrong with CLP in attached flow, nothing if it is possible."""
    table = page.table("dynamic")
    if table is None:
        return ""
    columns = columns_of(table)
    damping = columns["Cl_phat"]
    rows = (np.abs(columns["alpha"]) <= _LINEAR) & np.isfinite(damping)
    if not rows.any():
        return ""
    value = float(np.median(damping[rows]))
    if deriv == "DEG":
        value *= math.degrees(1.0)
    least, most = _ROLL_PARTS
    if least <= value / estimate <= most:
        return ""
    advice = "check SREF, BLREF, card DERIV and the planforms"
    if has_stall:
        advice = (
            "CL of the page falls with alpha, and the program looks up the angle of zero lift in "
            "CL: leave out the angles of attack behind the stall, and run the deck again"
        )
    return (
        f"it is {value:.3g} per radian up to {_LINEAR:g} deg, where the wing has about "
        f"{estimate:.3g}; CLP, CYP and CNP of the page are flagged suspect; {advice}"
    )
