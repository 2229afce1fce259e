"""Contradictions within a print: numbers that an intact listing prints twice.

The program prints the forces of a static page in two pairs of axes, the moment as centre of
pressure, and the slopes of lift and moment:

    CN = CL cos(alpha) + CD sin(alpha),    CA = CD cos(alpha) - CL sin(alpha),    CM = XCP CN,

and CL changes by the integral of its slopes. A flight-condition line holds Mach number,
velocity and temperature, of which two give the third; Mach numbers and reference
quantities are also on the input cards. On 104 intact listings (pages with power and in ground
effect among them) the forces agree within two units of the last digit and the moment within one.
A digit that was changed, a row in the wrong place or a card of another run is therefore seen.
"""

from __future__ import annotations

import math

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
_DERIVATIVES = ("CL_alpha", "Cm_alpha", "CY_beta", "Cn_beta", "Cl_beta")
_RATIO_OF_HEATS, _GAS_CONSTANT = 1.4, 287.05
_MACH_OFF = 0.02  # part of the Mach number; those of intact listings agree within the rounding
_MACH_ROUNDING, _SPEED_ROUNDING = 0.0005, 0.005


def flag_contradictions(case: Case) -> None:
    """Flag the numbers of static pages that contradict each other, and report them."""
    # CA of a body with fins lacks a part of their drag.
    places, tables = [], []
    for i, page in enumerate(case.pages):
        table = page.table("static")
        if table is not None and "WING" in page.configuration:
            places.append(i)
            tables.append(table)
    if tables:
        _flag_rows(case, places, tables)
        _flag_slopes(case, places[0], tables[0])
    _flag_conditions(case)
    for line, text in reference_contradictions(case):
        _report(case, line, text)


def _flag_rows(case: Case, places: list[int], tables: list[PrintedTable]) -> None:
    """Flag rows whose forces or moments contradict each other."""
    # All rows of the case at once: a listing may have thousands of tables.
    rows = _sound_numbers(tables)
    normal, axial = _rotate_forces(rows)
    # NaN compares false.
    is_off = (np.abs(rows["CN"] - normal) > _FORCE_OFF) | (np.abs(rows["CA"] - axial) > _FORCE_OFF)
    room = _MOMENT_OFF + _FACTOR_OFF * (np.abs(rows["xcp"]) + np.abs(rows["CN"]))
    is_moment_off = (np.abs(rows["xcp"] * rows["CN"] - rows["Cm"]) > room) & ~is_off
    if not (is_off.any() or is_moment_off.any()):
        return
    ends = np.cumsum([len(table.rows) for table in tables])
    for i, table, end in zip(places, tables, ends):
        part = slice(end - len(table.rows), end)
        page = case.pages[i]
        numbers = {name: values[part] for name, values in rows.items()}
        if is_off[part].any():
            page = with_suspects(page, "static", _FORCES, is_off[part])
            k = int(np.argmax(is_off[part]))
            _report(case, table.lines[k], _describe_forces(numbers, k, is_off[part]))
        if is_moment_off[part].any():
            page = with_suspects(page, "static", ("Cm", "xcp"), is_moment_off[part])
            k = int(np.argmax(is_moment_off[part]))
            _report(case, table.lines[k], _describe_moment(numbers, k, is_moment_off[part]))
        case.pages[i] = page


def _sound_numbers(tables: list[PrintedTable]) -> dict[str, np.ndarray]:
    """Return the columns of static tables one below the other, NaN where no number is sound."""
    names = [column.quantity for column in tables[0].columns]
    values = np.concatenate([table.values for table in tables])
    is_sound = np.concatenate([table.flags for table in tables]) == OK
    marks = []
    for table in tables:
        marks.append(table.suspect if table.suspect is not None else np.zeros(table.flags.shape))
    values = np.where(is_sound & (np.concatenate(marks) == 0), values, np.nan)
    return dict(zip(names, values.T))


def _rotate_forces(rows: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return CN and CA by CL, CD and alpha."""
    cos, sin = np.cos(np.radians(rows["alpha"])), np.sin(np.radians(rows["alpha"]))
    return rows["CL"] * cos + rows["CD"] * sin, rows["CD"] * cos - rows["CL"] * sin


def _describe_forces(rows: dict[str, np.ndarray], k: int, is_off: np.ndarray) -> str:
    normal, axial = _rotate_forces(rows)
    text = f"CL {rows['CL'][k]:g} and CD {rows['CD'][k]:g} at alpha {rows['alpha'][k]:g} deg give "
    text += f"CN {normal[k]:.3f} and CA {axial[k]:.3f}, and {rows['CN'][k]:g} and "
    return _add_rows(f"{text}{rows['CA'][k]:g} are printed", is_off)


def _describe_moment(rows: dict[str, np.ndarray], k: int, is_off: np.ndarray) -> str:
    text = f"XCP {rows['xcp'][k]:g} times CN {rows['CN'][k]:g} at alpha {rows['alpha'][k]:g} deg "
    text += f"is {rows['xcp'][k] * rows['CN'][k]:.4f}, and CM {rows['Cm'][k]:g} is printed"
    return _add_rows(text, is_off)


def _report(case: Case, line: int, text: str) -> None:
    case.messages.append(ListingMessage(line, text, "reader"))


def _flag_slopes(case: Case, i: int, table: PrintedTable) -> None:
    """Flag the derivatives of a case whose unit is another than that of card DERIV."""
    # The card holds for all pages of a case, so the first page is enough.
    sound = _sound_numbers([table])
    per_radian = 1.0
    if case.deck.deriv == "DEG":
        per_radian = math.degrees(1.0)
    alpha, text = sound["alpha"], ""
    for name, least in (("CL", _LEAST_LIFT), ("Cm", _LEAST_MOMENT)):
        is_known = np.isfinite(sound[name] + sound[f"{name}_alpha"])
        rows = np.flatnonzero((np.abs(alpha) <= _LINEAR) & is_known)
        slopes = per_radian * sound[f"{name}_alpha"][rows]
        rise, expected = _compare_slopes(alpha[rows], sound[name][rows], slopes)
        if abs(rise) < least or not expected:
            continue
        ratio = abs(expected / rise)
        if not text and _UNIT_OFF[0] <= max(ratio, 1.0 / ratio) <= _UNIT_OFF[1]:
            text = f"{name.upper()} changes by {rise:.4g} over attached flow, and by its slopes by "
            text += f"{expected:.4g}: they are per radian where card DERIV states per degree, or "
            text += "the reverse; the derivatives are flagged suspect; correct the card and "
            text += "run the deck again"
    if not text:
        return
    _report(case, table.lines[0], text)
    for k, page in enumerate(case.pages[i:], start=i):
        case.pages[k] = with_suspects(page, "static", _DERIVATIVES)


def _add_rows(text: str, is_off: np.ndarray) -> str:
    """Return a contradiction with the number of its rows, and what to do."""
    rows = "this row is"
    if is_off.sum() > 1:
        rows = f"{is_off.sum()} such rows are"
    return f"{text}: {rows} damaged or edited and flagged suspect; run the deck again"


def _compare_slopes(
    alpha: np.ndarray, values: np.ndarray, slopes: np.ndarray
) -> tuple[float, float]:
    """Return how a coefficient rises, and how much by its slopes; 0 for less than three rows."""
    if alpha.size < 3:
        return 0.0, 0.0
    return float(values[-1] - values[0]), float(np.trapezoid(slopes, np.radians(alpha)))


def _flag_conditions(case: Case) -> None:
    """Flag pages whose Mach number is not velocity over speed of sound, or not on the cards."""
    scheduled = {mach for mach, _ in case.deck.conditions() if math.isfinite(mach)}
    # Text on each heading that occurs, empty for a sound one.
    texts: dict[str, str] = {}
    for i, page in enumerate(case.pages):
        if page.kind != "static" or page.conditions is None:
            continue
        heading = page.conditions.rows[0]
        if heading not in texts:
            texts[heading] = _describe_heading(page, scheduled)
            if texts[heading]:
                _report(case, page.conditions.lines[0], texts[heading])
        if texts[heading]:
            case.pages[i] = with_suspects(page, "static", None)


def _describe_heading(page: Page, scheduled: set[float]) -> str:
    """Return what is wrong with the Mach number of a page, or nothing."""
    mach = page.condition("mach")
    text = _describe_mach(page, mach)
    if not text and scheduled and math.isfinite(mach):
        nearest = min(scheduled, key=lambda other: abs(other - mach))
        if abs(nearest - mach) > _MACH_ROUNDING * 1.01:
            cards = " ".join(f"{other:g}" for other in sorted(scheduled))
            text = f"Mach {mach:g} is not on the input cards ({cards})"
    if not text:
        return ""
    text += ": the heading of the page is damaged or edited, or belongs to another run; its "
    return text + "numbers are flagged suspect; run the deck again"


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
