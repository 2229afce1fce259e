"""Numbers that hold something of a page printed earlier in the same program run: flagged ``suspect``, never repaired.

Found with the program (docs/datcom.md, "Place in a run") and traced in its source:

* ``GRDEFF`` stores the aeroplane in free air at the first height of every deflection, and from the second deflection on it stores the
  pages over ground of the deflection before, at their last height: every block of heights adds its ground effect to that of all
  blocks before it.  Ailerons on a wing are taken for flaps of the type that their STYPE has the number of.
* ``FLAPCM`` overwrites its table of spanwise stations by the ends of the flap (from condition to condition and case to case), and does
  not set back the counter that distinguishes stations inboard of the flap (from deflection to deflection): D(CM), and the
  trim that is computed from it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..arrays.conditions import control_surface
from ..listing import Case
from ..printout.content import Message, Page
from ..printout.tables import Table

_OVER_GROUND = ("CD", "CL", "Cm", "CN", "CA", "xcp", "CL_alpha", "Cm_alpha")
_TRIMMED = ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin")
_TAKEN_FOR_FLAPS = (3, 4, 5)  # values of STYPE that are slotted and split flaps as FTYPE


def flag_missing_angles(case: Case) -> None:
    """Flag the rows of angles of attack that NALPHA counts and ALSCHD does not give, and what the program interpolates over them.

    The program takes them as 1E-30 and prints NDM; its interpolation in alpha needs rising angles.  Increments of flaps and ailerons
    are computed angle by angle.
    """
    given = case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")
    counted = case.deck.count("FLTCON", "NALPHA") or 0
    if not 0 < len(given) < counted:
        return
    rising = max(given) < 0.0
    lines: list[int] = []
    for i, page in enumerate(case.pages):
        for table in page.tables:
            if table.layout.rows == ("FLTCON", "NALPHA"):
                first = len(given) if rising or table.layout.across is not None else 0
                page = with_suspects(page, table.name, None, slice(first, None))
                lines += table.lines[len(given) :]
        case.pages[i] = page
    if lines:
        what = "their rows" if rising else "their rows, and all others of pages that the program interpolates over them (CL a third off),"
        text = (
            f"NALPHA counts {counted} angles of attack, the input cards give {len(given)}: the program takes the others as 1E-30; {what} "
            "are flagged suspect; correct NALPHA and run the deck again"
        )
        case.messages.append(Message(lines[0], text, "reader"))


def flag_ground_pages(case: Case) -> None:
    """Flag the pages over ground that the effect of an earlier deflection is in."""
    flagged: list[int] = []
    seen: set[tuple[str, float]] = set()
    for i, page in enumerate(case.pages):
        if page.kind != "static":
            continue
        if math.isinf(page.ground_height):
            seen = {place for place in seen if place[0] != page.configuration}
            continue
        place = (page.configuration, page.ground_height)
        if place in seen or _is_aileron_taken_for_flap(case):
            case.pages[i] = with_suspects(page, "static", _OVER_GROUND)
            flagged.append(page.first)
        seen.add(place)
    if flagged:
        device = "SYMFLP" if "SYMFLP" in case.deck.namelists else "ASYFLP"
        text = (
            f"{len(flagged)} pages over ground hold the ground effect of the deflections of {device} before them (seen: CL wrong by 0.28) "
            "and are flagged suspect; run one deflection at a time (datcom split makes the decks)"
        )
        case.messages.append(Message(flagged[0], text, "reader"))


def _is_aileron_taken_for_flap(case: Case) -> bool:
    style = case.deck.value("ASYFLP", "STYPE")
    return style is not None and round(style) in _TAKEN_FOR_FLAPS and control_surface(case.deck) == "wing"


def flag_flap_moments(case: Case, before: int) -> int:
    """Flag D(CM) of every deflection but the first of a program run, and what is trimmed with it.

    Parameters
    ----------
    before : int
        Deflections of SYMFLP that the run has printed before this case.

    Returns
    -------
    int
        The same after it.
    """
    flagged: list[int] = []
    for i, page in enumerate(case.pages):
        symflp = page.table("symflp")
        if symflp is not None:
            first = 0 if before else 1
            page = with_suspects(page, "symflp", ("dCm",), slice(first, None))
            flagged += symflp.lines[first:]
            before += len(symflp.rows)
        if before > 1:
            for name in ("trim", "trim_level"):
                page = with_suspects(page, name, _TRIMMED)
        case.pages[i] = page
    if flagged:
        text = (
            f"D(CM) of {len(flagged)} deflections, all but the first of the program run, holds something of the deflections before "
            "(seen: elevator 2 %, plain flap 7 %) and is flagged suspect; where it counts make one run per condition and deflection"
        )
        case.messages.append(Message(flagged[0], text, "reader"))
    return before


def with_suspects(page: Page, name: str, quantities: tuple[str, ...] | None, rows: slice | np.ndarray = slice(None)) -> Page:
    """Return a page whose tables of a kind have the flag ``suspect`` in some columns, all but the keys with None."""
    if page.table(name) is None:
        return page
    printed = tuple(_flagged(item, quantities, rows) if isinstance(item, Table) and item.name == name else item for item in page.printed)
    return replace(page, printed=printed)


def _flagged(table: Table, quantities: tuple[str, ...] | None, rows: slice | np.ndarray) -> Table:
    suspect = np.zeros((len(table.rows), len(table.columns)), bool) if table.suspect is None else table.suspect.copy()
    for k, column in enumerate(table.columns):
        if k >= table.layout.keys if quantities is None else column.quantity in quantities:
            suspect[rows, k] = True
    return replace(table, suspect=suspect)
