"""Contradictions within a print: numbers that an intact listing prints twice.

The program prints the forces of a static page in two pairs of axes, the moment as centre of
pressure, and the slopes of lift and moment beside them:

    CN = CL cos(alpha) + CD sin(alpha),    CA = CD cos(alpha) - CL sin(alpha),    CM = XCP CN,

and CL changes by the integral of its slopes. A flight-condition line holds Mach number,
velocity and temperature, of which two give the third; Mach numbers, altitudes and reference
quantities are also on the input cards. On 104 intact listings (pages with power and in ground
effect among them) the forces agree within two units of the last digit and the moment within one.
A digit that was changed, a row in the wrong place or a card of another run is therefore seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from datcom_io.arrays.conditions import reference_contradictions, si_factor
from datcom_io.cells import OK
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.tables import PrintedTable
from datcom_io.reading.suspects import with_suspects

_FORCES = ("CD", "CL", "CN", "CA")
_FORCE_OFF = 0.003  # three units of the last digit; intact listings have two at most
# Rounding of CM, and of XCP and CN, times four.
_MOMENT_OFF, _FACTOR_OFF = 0.0002, 0.002
# Attached flow [deg], and the least change of a coefficient over it that shows its slope.
_LINEAR, _LEAST_LIFT, _LEAST_MOMENT = 6.0, 0.1, 0.02
# Ratio of the change by the slopes to that of the coefficient where the unit is wrong, about 57.3.
_UNIT_OFF = (25.0, 130.0)
_SIDESLIP = ("CY_beta", "Cn_beta", "Cl_beta")
_RATIO_OF_HEATS, _GAS_CONSTANT = 1.4, 287.05
_MACH_OFF = 0.02  # part of the Mach number; those of intact listings agree within the rounding
_MACH_ROUNDING, _SPEED_ROUNDING = 0.0005, 0.005


def flag_contradictions(case: Case) -> None:
    """Flag the numbers of static pages that contradict each other, and report what they say."""
    for i, page in enumerate(case.pages):
        if page.kind != "static":
            continue
        table = page.table("static")
        # CA of a body with fins lacks a part of their drag.
        if table is not None and "WING" in page.configuration:
            for columns, rows, text in _find_contradictions(table, case.deck.deriv):
                page = with_suspects(page, "static", columns, rows)
                _report(case, table.lines[int(np.argmax(rows))], text)
            case.pages[i] = page
    _flag_conditions(case)
    for line, text in reference_contradictions(case):
        _report(case, line, text)


def _report(case: Case, line: int, text: str) -> None:
    case.messages.append(ListingMessage(line, text, "reader"))


def _find_contradictions(
    table: PrintedTable, deriv: str
) -> Iterator[tuple[tuple[str, ...], np.ndarray, str]]:
    """Yield columns, a mask of their rows, and a text on what contradicts what."""
    sound = {}
    for k, column in enumerate(table.columns):
        is_sound = table.flags[:, k] == OK
        if table.suspect is not None:
            is_sound = is_sound & ~table.suspect[:, k]
        sound[column.quantity] = np.where(is_sound, table.values[:, k], np.nan)
    alpha, moment = sound["alpha"], sound["Cm"]
    CD, CL, CN, CA = (sound[name] for name in _FORCES)
    cos, sin = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
    normal, axial = CL * cos + CD * sin, CD * cos - CL * sin
    # NaN compares false.
    is_off = (np.abs(CN - normal) > _FORCE_OFF) | (np.abs(CA - axial) > _FORCE_OFF)
    if is_off.any():
        k = int(np.argmax(is_off))
        text = f"CL {CL[k]:g} and CD {CD[k]:g} at alpha {alpha[k]:g} deg give CN {normal[k]:.3f} "
        text += f"and CA {axial[k]:.3f}, and {CN[k]:g} and {CA[k]:g} are printed"
        yield _FORCES, is_off, _describe(text, is_off)
    product = sound["xcp"] * CN
    room = _MOMENT_OFF + _FACTOR_OFF * (np.abs(sound["xcp"]) + np.abs(CN))
    is_moment_off = (np.abs(product - moment) > room) & ~is_off
    if is_moment_off.any():
        k = int(np.argmax(is_moment_off))
        text = f"XCP {sound['xcp'][k]:g} times CN {CN[k]:g} at alpha {alpha[k]:g} deg is "
        text += f"{product[k]:.4f}, and CM {moment[k]:g} is printed"
        yield ("Cm", "xcp"), is_moment_off, _describe(text, is_moment_off)
    per_radian = 1.0
    if deriv == "DEG":
        per_radian = math.degrees(1.0)
    is_used = (np.abs(alpha) <= _LINEAR) & ~is_off & ~is_moment_off
    for name, least in (("CL", _LEAST_LIFT), ("Cm", _LEAST_MOMENT)):
        rows = np.flatnonzero(is_used & np.isfinite(sound[name] + sound[f"{name}_alpha"] + alpha))
        slopes = per_radian * sound[f"{name}_alpha"][rows]
        rise, expected = _compare_slopes(alpha[rows], sound[name][rows], slopes)
        if abs(rise) < least or not expected:
            continue
        ratio = abs(expected / rise)
        if _UNIT_OFF[0] <= max(ratio, 1.0 / ratio) <= _UNIT_OFF[1]:
            text = f"{name.upper()} changes by {rise:.4g} over attached flow, and by its slopes by "
            text += f"{expected:.4g}: they are per radian where card DERIV states per degree, or "
            text += "the reverse; the derivatives are flagged suspect; correct the card and "
            text += "run the deck again"
            yield (f"{name}_alpha", *_SIDESLIP), np.ones(alpha.size, bool), text


def _describe(text: str, is_off: np.ndarray) -> str:
    """Return a contradiction with the number of its rows, and what to do."""
    rows = "this row is"
    if is_off.sum() > 1:
        rows = f"{is_off.sum()} such rows are"
    return f"{text}: {rows} damaged or edited and flagged suspect; run the deck again"


def _compare_slopes(
    alpha: np.ndarray, values: np.ndarray, slopes: np.ndarray
) -> tuple[float, float]:
    """Return how a coefficient rises, and how much its slopes say; 0 for less than three rows."""
    if alpha.size < 3:
        return 0.0, 0.0
    return float(values[-1] - values[0]), float(np.trapezoid(slopes, np.radians(alpha)))


def _flag_conditions(case: Case) -> None:
    """Flag pages whose Mach number is not velocity over speed of sound, or not on the cards."""
    seen: set[tuple[str, str]] = set()
    scheduled = {mach for mach, _ in case.deck.conditions() if math.isfinite(mach)}
    for i, page in enumerate(case.pages):
        if page.kind != "static" or page.conditions is None:
            continue
        mach = page.condition("mach")
        text = _describe_mach(page, mach)
        if not text and scheduled and math.isfinite(mach):
            nearest = min(scheduled, key=lambda other: abs(other - mach))
            if abs(nearest - mach) > _MACH_ROUNDING * 1.01:
                cards = " ".join(f"{other:g}" for other in sorted(scheduled))
                text = f"Mach {mach:g} is not on the input cards ({cards})"
        if not text:
            continue
        case.pages[i] = with_suspects(page, "static", None)
        key = (page.conditions.text(0, 0), text)
        if key not in seen:
            seen.add(key)
            text += ": the heading of the page is damaged or edited, or belongs to another run; "
            text += "its numbers are flagged suspect; run the deck again"
            _report(case, page.conditions.lines[0], text)


def _describe_mach(page: Page, mach: float) -> str:
    """Return how the Mach number of a page differs from velocity over speed of sound."""
    velocity = page.condition("V") * si_factor("speed", page.dim)
    temperature = page.condition("temperature") * si_factor("temperature", page.dim)
    if not (mach > 0.0 and velocity > 0.0 and temperature > 0.0):
        return ""
    expected = velocity / math.sqrt(_RATIO_OF_HEATS * _GAS_CONSTANT * temperature)
    rounding = _MACH_ROUNDING + _SPEED_ROUNDING * mach / page.condition("V")
    if abs(expected - mach) <= _MACH_OFF * mach + rounding:
        return ""
    return (
        f"Mach {mach:g}, velocity {velocity:.5g} m/s and {temperature:.5g} K contradict each "
        f"other, as they give Mach {expected:.3f}"
    )
