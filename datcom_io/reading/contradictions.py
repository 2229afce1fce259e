"""Contradictions within a print: numbers that an intact listing prints twice.

The program prints the forces of a static page in two pairs of axes, the moment as centre of
pressure, and the slopes of lift and moment:

    CN = CL cos(alpha) + CD sin(alpha),    CA = CD cos(alpha) - CL sin(alpha),    CM = XCP CN,

and CL changes by the integral of its slopes. A flight-condition line holds Mach number,
velocity and temperature, of which two give the third, and an altitude with the pressure and
temperature of the standard atmosphere; Mach numbers, altitudes and reference quantities are also on
the input cards. On 104 intact listings (pages with power and in ground
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
from flightmech.air import atmosphere

_FORCES = ("CD", "CL", "CN", "CA")
_FORCE_OFF = 0.003  # three units of the last digit; intact listings have two at most
_ALPHA_OFF = math.radians(0.05)  # rounding of the angle, which has one decimal
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
# Part of pressure and temperature; to 32 km intact listings agree within 0.002 with the atmosphere.
_AIR_OFF, _HIGHEST = 0.01, 32000.0
_ALTITUDE_ROUNDING = 0.005  # in the unit of the page


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
    room = _FORCE_OFF + _ALPHA_OFF * np.hypot(rows["CL"], rows["CD"])
    is_off = (np.abs(rows["CN"] - normal) > room) | (np.abs(rows["CA"] - axial) > room)
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
    """Flag pages whose Mach number, velocity, altitude and air, or cards contradict each other."""
    conditions = case.deck.conditions()
    machs = {mach for mach, _ in conditions if math.isfinite(mach)}
    heights = {h for _, h in conditions if math.isfinite(h)}
    # The cards may give any pressure and temperature at an altitude.
    is_standard = not (case.deck.values("FLTCON", "PINF") or case.deck.values("FLTCON", "TINF"))
    # Text on each heading that occurs, empty for a sound one.
    texts: dict[str, str] = {}
    for i, page in enumerate(case.pages):
        if page.kind != "static" or page.conditions is None:
            continue
        heading = page.conditions.rows[0]
        if heading not in texts:
            texts[heading] = _describe_heading(page, machs, heights, is_standard)
            if texts[heading]:
                _report(case, page.conditions.lines[0], texts[heading])
        if texts[heading]:
            case.pages[i] = with_suspects(page, "static", None)


def _describe_heading(page: Page, machs: set[float], heights: set[float], is_standard: bool) -> str:
    """Return what is wrong with Mach number or altitude of a page, or nothing."""
    mach = page.condition("mach")
    text = _describe_mach(page, mach)
    if not text and is_standard:
        text = _describe_altitude(page)
    if not text:
        text = _describe_cards(f"Mach {mach:g}", mach, machs, _MACH_ROUNDING)
    if not text:
        h = page.condition("h")
        text = _describe_cards(f"altitude {h:g}", h, heights, _ALTITUDE_ROUNDING)
    if not text:
        return ""
    text += ": the heading of the page is damaged or edited, or belongs to another run; its "
    return text + "numbers are flagged suspect; run the deck again"


def _describe_cards(words: str, value: float, scheduled: set[float], rounding: float) -> str:
    """Return a printed Mach number or altitude that is not on the cards, or nothing."""
    if not scheduled or not math.isfinite(value):
        return ""
    nearest = min(scheduled, key=lambda other: abs(other - value))
    # The program holds seven digits.
    if abs(nearest - value) <= rounding * 1.01 + 1e-6 * abs(value):
        return ""
    cards = " ".join(f"{other:g}" for other in sorted(scheduled))
    return f"{words} is not on the input cards ({cards})"


def _describe_altitude(page: Page) -> str:
    """Return how pressure and temperature of a page differ from those of its altitude."""
    h, p, T = (
        page.condition(name) * si_factor(units, page.dim)
        for name, units in (
            ("h", "length"),
            ("p_static", "pressure"),
            ("temperature", "temperature"),
        )
    )
    if not (p > 0.0 and T > 0.0 and h <= _HIGHEST):
        return ""
    air = atmosphere(h)
    expected = float(air.p_static), float(air.temperature)
    if max(abs(p / expected[0] - 1.0), abs(T / expected[1] - 1.0)) <= _AIR_OFF:
        return ""
    return (
        f"altitude {page.condition('h'):g} has {expected[0]:.5g} Pa and {expected[1]:.5g} K in the "
        f"standard atmosphere, and {p:.5g} Pa and {T:.5g} K are printed"
    )


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
