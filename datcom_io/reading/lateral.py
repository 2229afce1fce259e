"""Size and sign of CLB, CYP and CNP of one page, by its other numbers and the planforms.

CLB of a wing with dihedral G and of a fin at height z is about [strip theory; DATCOM 5.1.2.1,
5.3.1.1]

    CLB = -G CL_alpha integral of c y / (S b) - a_v S_v z / (S b).

On 544 pages of listings where this is -0.03 per radian or more, and no part is above zero, the
print reaches 0.22 of it at some angle of attack up to 6 deg. In the same range no print exceeds
0.8 (0.25 + 0.6 |CL|) per radian. A CLB off by 57.3 is outside of one of the two. All limits hold
for numbers by the area and span of the main wing, whatever SREF and BLREF are.

At subsonic speed CYP of sound pages is at most 0.4 of |CLP| + |CYB|. CNP of a wing is
about -CL / 8 and CNP of the fin is constant, so that CNP falls with CL [DATCOM 7.1.2.3]. It rises
on pages without suction at the leading edge: of wings with an aspect ratio below 3, and of
one page at 60 km with half the lift slope of its wing. At supersonic speed it has either sign.

What this cannot show: a sign of CLB or CYP, which depend on dihedral, sweep and the height of the
wing; a CYP that is too small, as it crosses zero; CNP of a wing of small aspect ratio or at
supersonic speed; CLB of a wing without dihedral and fin that is too small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from datcom_io.arrays.conditions import printed_condition
from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_wing, planform_nodes, sample_chords
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.reading.suspects import column_of_page, columns_of, with_suspects
from datcom_io.reading.wing_scales import scale_by_wing

_LINEAR = 6.0  # attached flow [deg]
# Largest CLB: constant part, and part of CL. [1/rad]
_MOST_CLB, _MOST_CLB_LIFT = 0.25, 0.6
# Size of the estimate from which CLB is compared with it, and least part of it. [1/rad]
_LEAST_ESTIMATE, _LEAST_PART = 0.03, 0.1
_LARGEST_SMALL = 0.1  # CLB from which it is not compared with the estimate [1/rad]
_FIN_SLOPE = 2.0  # of the lift of a fin [1/rad]
_MOST_CYP = 0.6  # part of |CLP| + |CYB|
_LARGEST_CLP, _LARGEST_CYB = 3.0, 5.0  # larger values are not compared [1/rad]
# Slope of CNP over CL that rises, change of CL that shows it, and wings on which it falls: aspect
# ratio, and lift slope by the area of the wing.
_RISING, _LEAST_LIFT, _SLENDER, _LEAST_SLOPE = 0.01, 0.1, 4.0, 3.0
_SOUND_SPEED = 1.0  # Mach number


@dataclass(frozen=True)
class _LateralPlanform:
    """What wing and fin of a deck add to CLB, by the reference quantities of the deck.

    Attributes
    ----------
    aspect_ratio, sweep : float
        Of the wing; the sweep of its quarter-chord line. [1, rad]
    dihedral : float
        CLB by dihedral over the lift slope of the wing, negative. [1]
    fin : float
        CLB of the fin, negative. [1/rad]
    """

    aspect_ratio: float
    sweep: float
    dihedral: float
    fin: float


def flag_lateral_derivatives(case: Case) -> None:
    """Flag CLB, CYP and CNP of pages with a wing whose size or sign is impossible."""
    per_radian = 1.0
    if case.deck.deriv == "DEG":
        per_radian = math.degrees(1.0)
    places = []
    for i, page in enumerate(case.pages):
        is_free = page.kind == "static" and math.isinf(page.ground_height)
        if is_free and "WING" in page.configuration and page.table("static") is not None:
            places.append(i)
    if not places:
        return
    planform = _measure_planform(case.deck)
    scales = scale_by_wing(case.deck)
    findings = _judge_sideslip(planform, [case.pages[i] for i in places], per_radian, scales)
    for number, finding in findings:
        i = places[number]
        case.pages[i] = with_suspects(case.pages[i], "static", (finding.name,), finding.rows)
    found = [(places[number], finding) for number, finding in findings]
    static_pages = {
        (case.pages[i].configuration, printed_condition(case.pages[i])): case.pages[i]
        for i in places
    }
    for i, page in enumerate(case.pages):
        static = static_pages.get((page.configuration, printed_condition(page)))
        if static is None or page.table("dynamic") is None:
            continue
        for finding in _judge_rates(planform, static, page, per_radian, scales):
            case.pages[i] = with_suspects(case.pages[i], "dynamic", (finding.name,), finding.rows)
            found.append((i, finding))
    _report(case, found)


class _Finding(NamedTuple):
    """A quantity whose numbers in some rows are impossible, with the reason."""

    name: str
    rows: np.ndarray
    text: str


def _report(case: Case, found: list[tuple[int, _Finding]]) -> None:
    """Report each derivative once by configuration, with its first number and all Mach numbers."""
    reports: dict[tuple[str, str], tuple[int, str, list[float]]] = {}
    for i, finding in found:
        page = case.pages[i]
        key = (page.configuration, finding.name)
        _, _, machs = reports.setdefault(key, (page.first, finding.text, []))
        machs.append(page.condition("mach"))
    for (configuration, name), (line, text, machs) in reports.items():
        at = " ".join(f"{mach:g}" for mach in dict.fromkeys(machs))
        sentence = f"{name} of {configuration} is impossible in sign or size at Mach {at} ({text}) "
        sentence += "and is flagged suspect; compare with a neighbouring Mach number, check BLREF, "
        sentence += "card DERIV and the planforms of the deck, and run it again"
        case.messages.append(ListingMessage(line, sentence, "reader"))


def _measure_planform(deck: Deck) -> _LateralPlanform | None:
    """Return wing and fin of a deck, None without planform cards of the wing.

    A part that would raise CLB makes both 0: the parts then cancel, and CLB may be small.
    """
    wing, sampled = measure_wing(deck), sample_chords(deck, "WGPLNF")
    if wing is None or sampled is None:
        return None
    stations, chord, _ = sampled
    S = deck.value("OPTINS", "SREF") or wing.area
    b = deck.value("OPTINS", "BLREF") or wing.span
    angles = [deck.value("WGPLNF", key) or 0.0 for key in ("DHDADI", "DHDADO")]
    moment = 2.0 * float(np.trapezoid(chord * stations, stations))
    dihedral, fin = -math.radians(angles[0]) * moment / (S * b), 0.0
    nodes = planform_nodes(deck, "VTPLNF")
    if nodes is not None:
        height, chord, _ = nodes
        above = (deck.value("SYNTHS", "ZV") or 0.0) - (deck.value("SYNTHS", "ZCG") or 0.0)
        fin = -_FIN_SLOPE * float(np.trapezoid(chord * (height + above), height)) / (S * b)
    if min(angles) < 0.0 or fin > 0.0:
        dihedral = fin = 0.0
    return _LateralPlanform(
        aspect_ratio=wing.aspect_ratio,
        sweep=wing.sweep,
        dihedral=dihedral,
        fin=fin,
    )


def _estimate_CLB(planform: _LateralPlanform, mach: float, has_fin: bool) -> float:
    """Return CLB by dihedral and fin. [1/rad]"""
    A, cos = planform.aspect_ratio, math.cos(planform.sweep)
    slope = 2.0 * math.pi * A / (2.0 + math.sqrt((A / cos) ** 2 + 4.0))
    if mach > _SOUND_SPEED:
        slope = min(0.5 * math.pi * A, 4.0 / math.sqrt(mach**2 - 1.0))
    return slope * planform.dihedral + has_fin * planform.fin


def _judge_sideslip(
    planform: _LateralPlanform | None,
    pages: list[Page],
    per_radian: float,
    scales: Mapping[str, float],
) -> list[tuple[int, _Finding]]:
    """Return each page whose CLB is too large or too small, by its number."""
    # All rows of the case at once: a listing may have thousands of tables.
    tables = [table for page in pages if (table := page.table("static")) is not None]
    names = [column.quantity for column in tables[0].columns]
    values = dict(zip(names, np.concatenate([table.values for table in tables]).T))
    counts = [len(table.rows) for table in tables]
    ends = np.cumsum(np.array(counts, dtype=np.intp))
    CLB, alpha, scale = per_radian * values["Cl_beta"], values["alpha"], scales["Cl_beta"]
    is_judged = np.isfinite(CLB) & (np.abs(alpha) <= _LINEAR)
    # limits by the main wing, divided by the scale to those of the print
    lift = scales["CL"] * np.abs(np.nan_to_num(values["CL"]))
    largest = (_MOST_CLB + _MOST_CLB_LIFT * lift) / scale
    is_large = is_judged & (np.abs(CLB) > largest)
    found = []
    for number in np.unique(np.searchsorted(ends, np.flatnonzero(is_large), side="right")):
        part = slice(ends[number] - counts[number], ends[number])
        k = part.start + int(np.argmax(is_large[part]))
        text = f"{CLB[k]:.4g} per radian at alpha {alpha[k]:g} deg, where at most {largest[k]:.2g} "
        rows = _spread(is_large[part], is_judged[part], np.isfinite(CLB[part]))
        found.append((int(number), _Finding("Cl_beta", rows, f"{text}is possible")))
    if planform is None or not min(counts):
        return found
    sizes = np.where(is_judged, np.abs(CLB), -np.inf)
    most = np.maximum.reduceat(sizes, ends - counts)
    for number in np.flatnonzero((most >= 0.0) & (most < _LARGEST_SMALL / scale)):
        page = pages[number]
        has_fin = "VERTICAL TAIL" in page.configuration
        estimate = _estimate_CLB(planform, page.condition("mach"), has_fin)
        if estimate < -_LEAST_ESTIMATE / scale and most[number] < -_LEAST_PART * estimate:
            rows = np.isfinite(CLB[ends[number] - counts[number] : ends[number]])
            text = f"at most {most[number]:.2g} per radian up to {_LINEAR:g} deg, where dihedral "
            text += f"and fin of the cards give about {estimate:.2g}"
            found.append((int(number), _Finding("Cl_beta", rows, text)))
    return found


def _spread(is_wrong: np.ndarray, is_judged: np.ndarray, is_printed: np.ndarray) -> np.ndarray:
    """Return the wrong rows, or all printed ones where more than half of the judged are wrong."""
    if 2 * is_wrong.sum() > is_judged.sum():
        return is_printed
    return is_wrong


def _judge_rates(
    planform: _LateralPlanform | None,
    static: Page,
    dynamic: Page,
    per_radian: float,
    scales: Mapping[str, float],
) -> Iterator[_Finding]:
    """Yield CYP if it is too large, and CNP if it has the wrong sign."""
    table = dynamic.table("dynamic")
    assert table is not None
    if not static.condition("mach") < _SOUND_SPEED:
        return
    columns = columns_of(table)
    alpha = columns["alpha"]
    is_linear = np.abs(alpha) <= _LINEAR
    # by area and span of the main wing
    CYP = per_radian * scales["CY_phat"] * columns["CY_phat"]
    CLP = per_radian * scales["Cl_phat"] * columns["Cl_phat"]
    CYB = column_of_page(static, "static", "CY_beta", alpha)
    CYB = per_radian * scales["CY_beta"] * np.abs(CYB)
    known = CLP[is_linear & np.isfinite(CLP)]
    if known.size:
        roll, side = float(np.abs(np.median(known))), float(np.nanmax(CYB, initial=0.0))
        largest = _MOST_CYP * (roll + side)
        is_large = is_linear & (np.abs(CYP) > largest)
        if is_large.any() and roll <= _LARGEST_CLP and side <= _LARGEST_CYB:
            k, scale = int(np.argmax(is_large)), scales["CY_phat"]
            text = f"{CYP[k] / scale:.4g} per radian at alpha {alpha[k]:g} deg, where CLP and CYB "
            text += f"of the page allow {largest / scale:.2g}"
            is_printed = np.isfinite(CYP)
            rows = _spread(is_large, is_linear & is_printed, is_printed)
            yield _Finding("CY_phat", rows, text)
    lift = scales["CL"] * column_of_page(static, "static", "CL", alpha)
    CNP = per_radian * scales["Cn_phat"] * columns["Cn_phat"]
    rows = is_linear & np.isfinite(CNP + lift)
    if planform is None or planform.aspect_ratio < _SLENDER or rows.sum() < 2:
        return
    if np.ptp(lift[rows]) < _LEAST_LIFT:
        return
    lift_slope = float(np.polyfit(np.radians(alpha[rows]), lift[rows], 1)[0])
    slope = float(np.polyfit(lift[rows], CNP[rows], 1)[0])
    if slope > _RISING and lift_slope > _LEAST_SLOPE:
        text = f"it rises by {slope:.2g} per radian for each unit of CL, and falls on all wings of "
        text += f"aspect ratio {_SLENDER:g} or more"
        yield _Finding("Cn_phat", np.isfinite(CNP), text)
