"""Numbers that a fault of the program makes wrong: their cells get the flag ``suspect``."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from datcom_io.arrays.conditions import control_surface, printed_condition
from datcom_io.cells import NA, NDM, OVERFLOW
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.tables import PrintedTable

_OVER_GROUND = ("CD", "CL", "Cm", "CN", "CA", "xcp", "CL_alpha", "Cm_alpha")
_TRIMMED = ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin")
# Q/QINF of a tail in a wake or behind a shock; the largest of sound pages is 1.1, the least 0.4.
TAIL_PRESSURE = (0.3, 1.5)
_WITH_TAIL = {
    "downwash": ("q_ratio",),
    "static": ("CD", "CL", "Cm", "CN", "CA", "CL_alpha", "Cm_alpha"),
    "dynamic": ("CL_qhat", "Cm_qhat", "CL_alphadothat", "Cm_alphadothat"),
}
# Values of STYPE that are slotted and split flaps as FTYPE.
_STYLES_LIKE_FLAPS = (3, 4, 5)


def flag_missing_angles(case: Case) -> None:
    """Flag rows of angles that NALPHA counts and ALSCHD does not give, and their effects.

    The program takes such angles as 1E-30 and prints NDM.  Its interpolation in alpha needs rising
    angles, so all rows of a page are wrong unless the angles still rise.  Increments of flaps and
    ailerons are computed angle by angle.
    """
    angles = case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")
    counted = case.deck.count("FLTCON", "NALPHA") or 0
    if not 0 < len(angles) < counted:
        return
    # 1E-30 behind negative angles still rises.
    rising = max(angles) < 0.0
    lines: list[int] = []
    for i, page in enumerate(case.pages):
        for table in page.tables:
            if table.layout.rows != ("FLTCON", "NALPHA"):
                continue
            first = 0
            if rising or table.layout.across is not None:
                first = len(angles)
            page = with_suspects(page, table.name, None, slice(first, None))
            lines += table.lines[len(angles) :]
        case.pages[i] = page
    if not lines:
        return
    rows = (
        "their rows, and all others of pages that the program interpolates over them (CL "
        "a third off),"
    )
    if rising:
        rows = "their rows"
    text = (
        f"NALPHA counts {counted} angles of attack, the input cards give {len(angles)}: "
        f"the program takes the others as 1E-30; {rows} "
        "are flagged suspect; correct NALPHA and run the deck again"
    )
    case.messages.append(ListingMessage(lines[0], text, "reader"))


def flag_order_of_angles(case: Case) -> None:
    """Flag the pages of angles of attack that do not rise.

    The program interpolates in its tables of alpha, which must rise. With 12, 8 ... -4 deg CL of a
    light jet at -4 deg is -0.03 instead of -0.23, and CLA at 12 deg is 0.73 per degree.
    """
    # A place of the list without a number counts as zero.
    angles = np.nan_to_num(case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")).tolist()
    pairs = list(pairwise(angles))
    if all(low < high for low, high in pairs):
        return
    lines: list[int] = []
    for i, page in enumerate(case.pages):
        for table in page.tables:
            # Increments of flaps and ailerons are computed angle by angle.
            if table.layout.rows == ("FLTCON", "NALPHA") and table.layout.across is None:
                page = with_suspects(page, table.name, None)
                lines += table.lines[:1]
        case.pages[i] = page
    if not lines:
        return
    first, second = next((low, high) for low, high in pairs if not low < high)
    text = (
        f"the angles of attack of the input cards do not rise ({first:g} is followed by "
        f"{second:g}): the program interpolates in them (seen: CL wrong by 0.2, CLA eight times "
        f"too large), so that all tables over alpha are flagged suspect; put ALSCHD in rising "
        f"order and run the deck again"
    )
    case.messages.append(ListingMessage(lines[0], text, "reader"))


def flag_ground_pages(case: Case) -> None:
    """Flag the pages over ground that contain the effect of an earlier deflection."""
    flagged: list[int] = []
    # Configurations and heights printed since the last page in free air.
    seen: set[tuple[str, float]] = set()
    for i, page in enumerate(case.pages):
        if page.kind != "static":
            continue
        if math.isinf(page.ground_height):
            seen = {key for key in seen if key[0] != page.configuration}
            continue
        key = (page.configuration, page.ground_height)
        if key in seen or _is_aileron_read_as_flap(case):
            case.pages[i] = with_suspects(page, "static", _OVER_GROUND)
            flagged.append(page.first)
        seen.add(key)
    if not flagged:
        return
    device = "ASYFLP"
    if "SYMFLP" in case.deck.namelists:
        device = "SYMFLP"
    text = (
        f"{len(flagged)} pages over ground hold the ground effect of the deflections of "
        f"{device} before them (seen: CL wrong by 0.28) "
        "and are flagged suspect; run one deflection at a time (datcom split makes the decks)"
    )
    case.messages.append(ListingMessage(flagged[0], text, "reader"))


def _is_aileron_read_as_flap(case: Case) -> bool:
    """Return whether the ground effect treats an ASYFLP as a wing flap, because of its STYPE."""
    style = case.deck.value("ASYFLP", "STYPE")
    if style is None:
        return False
    return round(style) in _STYLES_LIKE_FLAPS and control_surface(case.deck) == "wing"


def flag_flap_moments(case: Case, before: int) -> int:
    """Flag D(CM) of every deflection but the first of a program run, and the trim with it.

    Parameters
    ----------
    case : Case
    before : int
        Deflections of SYMFLP that the run has printed before this case.

    Returns
    -------
    int
        The same after it.
    """
    flagged: list[int] = []
    count = before
    for i, page in enumerate(case.pages):
        # The first deflection of a run has no deflection before it.
        symflp = page.table("symflp")
        if symflp is not None:
            first = 1
            if count:
                first = 0
            page = with_suspects(page, "symflp", ("dCm",), slice(first, None))
            flagged += symflp.lines[first:]
            count += len(symflp.rows)
        if count > 1:
            for name in ("trim", "trim_level"):
                page = with_suspects(page, name, _TRIMMED)
        case.pages[i] = page
    if flagged:
        text = (
            f"D(CM) of {len(flagged)} deflections, all but the first of the program run, "
            f"holds something of the deflections before "
            "(seen: elevator 2 %, plain flap 7 %) and is flagged suspect; where it counts "
            "make one run per condition and deflection"
        )
        case.messages.append(ListingMessage(flagged[0], text, "reader"))
    return count


# Slopes without a method or not applicable, and the numbers of their rows that power fills.
FILLED_BY_POWER = (
    ("Cm_alpha", ("Cm", "xcp")),
    ("CL_alpha", ("CD", "CL", "CN", "CA", "xcp")),
)


def flag_power_increments(case: Case) -> None:
    """Flag numbers of pages with power that are the increment alone.

    The program adds the increment of power to cells without a value.  Power does not act on the
    slopes, so the slopes show where a value is missing.
    """
    powered = [page for page in case.pages if page.power != "off"]
    for i, page in enumerate(case.pages):
        static = page.table("static")
        if page.power == "off" or static is None:
            continue
        quantities = [column.quantity for column in static.columns]
        for slope, filled in FILLED_BY_POWER:
            is_missing = np.isin(static.flags[:, quantities.index(slope)], (NA, NDM))
            page = with_suspects(page, "static", filled, is_missing)
        case.pages[i] = page
    if powered:
        text = (
            f"{powered[0].power} power is added to cells that have no value without power: where "
            f"the page without power shows NA or NDM, the "
            "number here is the increment alone; it is flagged suspect where the slope of "
            "its row shows NA or NDM"
        )
        case.messages.append(ListingMessage(powered[0].first, text, "reader"))


def flag_tail_pressure(case: Case) -> None:
    """Flag the numbers of an aeroplane whose tail has an impossible dynamic pressure.

    The program multiplies lift and moment of the tail by Q/QINF.  Its supersonic method prints 0, 3
    or an overflow for some aircraft, so that the tail is absent from the page, or three times as
    large.
    """
    low, high = TAIL_PRESSURE
    # Rows by Mach number and altitude; the dynamic page of a condition comes after its static one.
    wrong: dict[tuple[str, Any], np.ndarray] = {}
    first, machs, values = 0, [], []
    for i, page in enumerate(case.pages):
        table = page.table("downwash")
        if table is not None:
            column = [item.quantity for item in table.columns].index("q_ratio")
            ratio = table.values[:, column]
            mask = (ratio < low) | (ratio > high) | (table.flags[:, column] == OVERFLOW)
            if not mask.any():
                continue
            wrong[page.configuration, printed_condition(page)] = mask
            first = first or table.lines[int(np.argmax(mask))]
            machs.append(page.condition("mach"))
            values += [value for value in ratio[mask] if np.isfinite(value)]
        mask = wrong.get((page.configuration, printed_condition(page)))
        if mask is None:
            continue
        for name, quantities in _WITH_TAIL.items():
            table = page.table(name)
            if table is not None and len(table.rows) == mask.size:
                page = with_suspects(page, name, quantities, mask)
        case.pages[i] = page
    if machs:
        at = " ".join(f"{mach:g}" for mach in dict.fromkeys(machs))
        printed = "an overflow"
        if values:
            printed = f"{min(values):.3g} to {max(values):.3g}"
        text = (
            f"Q/QINF of the horizontal tail at Mach {at} is impossible ({printed}): the program "
            "multiplies lift and moment of the tail by it, so that CL, CM and the damping of these "
            "rows hold no tail or a wrong one; they are flagged suspect: move ZH or XH a little, "
            "or leave out these Mach numbers"
        )
        case.messages.append(ListingMessage(first, text, "reader"))


def with_suspects(
    page: Page,
    name: str,
    quantities: tuple[str, ...] | None,
    rows: slice | np.ndarray = slice(None),
) -> Page:
    """Return a page whose tables of a kind have the flag ``suspect`` in some columns.

    With `quantities` None all columns but the keys are flagged.
    """
    if page.table(name) is None:
        return page
    printed = []
    for item in page.printed:
        if isinstance(item, PrintedTable) and item.name == name:
            item = _flag_table(item, quantities, rows)
        printed.append(item)
    return replace(page, printed=tuple(printed))


def _flag_table(
    table: PrintedTable, quantities: tuple[str, ...] | None, rows: slice | np.ndarray
) -> PrintedTable:
    """Return a table whose cells in some columns and rows are suspect."""
    # Several faults may mark cells of one table.
    suspect = np.zeros((len(table.rows), len(table.columns)), bool)
    if table.suspect is not None:
        suspect = table.suspect.copy()
    for k, column in enumerate(table.columns):
        is_flagged = k >= table.layout.keys
        if quantities is not None:
            is_flagged = column.quantity in quantities
        if is_flagged:
            suspect[rows, k] = True
    return replace(table, suspect=suspect)


def columns_of(table: PrintedTable) -> dict[str, np.ndarray]:
    """Return the printed numbers of a table by quantity."""
    return {column.quantity: table.values[:, k] for k, column in enumerate(table.columns)}


def column_of_page(page: Page | None, name: str, quantity: str, alpha: np.ndarray) -> np.ndarray:
    """Return a quantity of another table at the same angles; NaN where it is not printed."""
    missing = np.full(alpha.shape, np.nan)
    table = None
    if page is not None:
        table = page.table(name)
    if table is None:
        return missing
    columns = columns_of(table)
    if not np.array_equal(columns["alpha"], alpha, equal_nan=True):
        return missing
    return columns[quantity]
