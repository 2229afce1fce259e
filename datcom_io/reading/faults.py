"""Faults of the program and gaps that can be seen in a listing: reported, never repaired.

Both known builds (the source of January 1996 with the corrections of 2011, and the single-file
edition) show them.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from datcom_io.arrays.conditions import control_surface, printed_condition
from datcom_io.cells import NA, NDM, OK
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage, Page
from datcom_io.printout.layouts.special import HYPERSONIC_FROM
from datcom_io.printout.tables import PrintedTable

_OVER_GROUND = ("CD", "CL", "Cm", "CN", "CA", "xcp", "CL_alpha", "Cm_alpha")
_TRIMMED = ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin")
_TAKEN_FOR_FLAPS = (3, 4, 5)  # values of STYPE that are slotted and split flaps as FTYPE


def flag_missing_angles(case: Case) -> None:
    """Flag the rows of angles of attack that NALPHA counts and ALSCHD does not give, and what the
    program interpolates over them.

    The program takes them as 1E-30 and prints NDM; its interpolation in alpha needs rising angles.
    Increments of flaps and ailerons are computed angle by angle.
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
        what = (
            "their rows"
            if rising
            else "their rows, and all others of pages that the program interpolates over them (CL "
            "a third off),"
        )
        text = (
            f"NALPHA counts {counted} angles of attack, the input cards give {len(given)}: "
            f"the program takes the others as 1E-30; {what} "
            "are flagged suspect; correct NALPHA and run the deck again"
        )
        case.messages.append(ListingMessage(lines[0], text, "reader"))


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
            f"{len(flagged)} pages over ground hold the ground effect of the deflections of "
            f"{device} before them (seen: CL wrong by 0.28) "
            "and are flagged suspect; run one deflection at a time (datcom split makes the decks)"
        )
        case.messages.append(ListingMessage(flagged[0], text, "reader"))


def _is_aileron_taken_for_flap(case: Case) -> bool:
    style = case.deck.value("ASYFLP", "STYPE")
    return (
        style is not None
        and round(style) in _TAKEN_FOR_FLAPS
        and control_surface(case.deck) == "wing"
    )


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
            f"D(CM) of {len(flagged)} deflections, all but the first of the program run, "
            f"holds something of the deflections before "
            "(seen: elevator 2 %, plain flap 7 %) and is flagged suspect; where it counts "
            "make one run per condition and deflection"
        )
        case.messages.append(ListingMessage(flagged[0], text, "reader"))
    return before


def with_suspects(
    page: Page,
    name: str,
    quantities: tuple[str, ...] | None,
    rows: slice | np.ndarray = slice(None),
) -> Page:
    """Return a page whose tables of a kind have the flag ``suspect`` in some columns, all but the
    keys with None.
    """
    if page.table(name) is None:
        return page
    printed = tuple(
        _flagged(item, quantities, rows)
        if isinstance(item, PrintedTable) and item.name == name
        else item
        for item in page.printed
    )
    return replace(page, printed=printed)


def _flagged(
    table: PrintedTable, quantities: tuple[str, ...] | None, rows: slice | np.ndarray
) -> PrintedTable:
    suspect = (
        np.zeros((len(table.rows), len(table.columns)), bool)
        if table.suspect is None
        else table.suspect.copy()
    )
    for k, column in enumerate(table.columns):
        if k >= table.layout.keys if quantities is None else column.quantity in quantities:
            suspect[rows, k] = True
    return replace(table, suspect=suspect)


_FAILED = re.compile("NaN|Inf|#")


class Observer:
    """Sees the cases of a file in order and adds the reader's messages to them."""

    def __init__(self) -> None:
        self.run, self.control_tables, self.deflections = 0, 0, 0

    def report(self, case: Case) -> None:
        """Add the reader's messages about the program's faults to a case."""
        self._drift_of_control_moments(case)
        _last_mach_in_static_pages(case)
        _pressure_on_control_pages(case)
        _weight(case)
        flag_missing_angles(case)
        flag_ground_pages(case)
        _flaps_in_ground_effect(case)
        _power_on_missing_cells(case)
        _control_tabs(case)
        _failed_arithmetic(case)
        _dynamic_pages_repeated(case)
        _reference_quantities(case)
        _aspect_ratio_of_inboard_panels(case)
        _conditions_missing(case)
        _hypersonic_flap(case)
        _transverse_jet(case)

    def _drift_of_control_moments(self, case: Case) -> None:
        """The program keeps a part of D(CM) from one condition of a run to the next."""
        if case.run != self.run:
            self.run, self.control_tables, self.deflections = case.run, 0, 0
        self.deflections = flag_flap_moments(case, self.deflections)
        tables = [table for _, table in case.tables("symflp")]
        self.control_tables += len(tables)
        if tables and self.control_tables > 1:
            _report(
                case,
                tables[-1].lines[0],
                f"D(CM) of {self.control_tables} conditions from one program run: the "
                f"program carries it from condition to condition and "
                "it drifts (by 40 % after 18 conditions); for D(CM) that counts make one run "
                "per condition",
            )


def _report(case: Case, line: int, text: str) -> None:
    case.messages.append(ListingMessage(line, text, "reader"))


def _last_mach_in_static_pages(case: Case) -> None:
    machs = {page.condition("mach") for page, _ in case.tables("static")}
    if len(machs) > 1:
        _report(
            case,
            case.line,
            f"{len(machs)} Mach numbers in one case: static pages carry something of the last one "
            "(seen: CL off by 0.007, CM by 0.003, CLA by 0.02 per radian); one run per Mach "
            "number is clean",
        )


def _pressure_on_control_pages(case: Case) -> None:
    """With DIM M, CM or IN the high-lift and control pages convert pressure, temperature and
    Reynolds number the wrong way.
    """
    right = {
        printed_condition(page): page.condition("p_static")
        for page in case.pages
        if page.kind == "static"
    }
    for page in case.pages:
        if page.kind != "high-lift" or page.conditions is None:
            continue
        pressure, wanted = page.condition("p_static"), right.get(printed_condition(page), math.nan)
        if abs(pressure - wanted) > 1e-3 * abs(wanted):
            _report(
                case,
                page.conditions.lines[0],
                f"pressure {pressure:g} on a control page, {wanted:g} on the static page of "
                f"the same condition: "
                f"with DIM {page.dim} the program converts pressure, temperature and "
                f"Reynolds number the wrong way there; "
                "those of the static page are used",
            )
            return


def _weight(case: Case) -> None:
    notes = [note for page in case.pages for note in page.notes if "VEHICLE WEIGHT" in note.text]
    if notes and case.deck.dim in ("M", "CM"):
        _report(
            case,
            notes[0].line,
            f"with DIM {case.deck.dim} the program divides the weight by 0.2248 again at "
            f"every condition: "
            "do not use the printed weights and level-flight lift coefficients",
        )


def _flaps_in_ground_effect(case: Case) -> None:
    pages = [page for page in case.pages if math.isfinite(page.ground_height)]
    if pages and "SYMFLP" in case.deck.namelists and control_surface(case.deck) == "wing":
        _report(
            case,
            pages[0].first,
            "ground pages with flaps hold the clean configuration and the ground increment "
            "with flaps: "
            "the flap increment of free air is not in them and must be added",
        )


def _power_on_missing_cells(case: Case) -> None:
    """Flag numbers of pages with power that are the increment alone: power has no part in the
    slopes, which show what is missing.
    """
    first = next((page for page in case.pages if page.power != "off"), None)
    for i, page in enumerate(case.pages):
        static = page.table("static")
        if page.power == "off" or static is None:
            continue
        slopes = {column.quantity: static.flags[:, k] for k, column in enumerate(static.columns)}
        for slope, quantities in (
            ("Cm_alpha", ("Cm", "xcp")),
            ("CL_alpha", ("CD", "CL", "CN", "CA", "xcp")),
        ):
            page = with_suspects(page, "static", quantities, np.isin(slopes[slope], (NA, NDM)))
        case.pages[i] = page
    if first is not None:
        _report(
            case,
            first.first,
            f"{first.power} power is added to cells that have no value without power: where "
            f"the page without power shows NA or NDM, the "
            "number here is the increment alone; it is flagged suspect where the slope of "
            "its row shows NA or NDM",
        )


def _control_tabs(case: Case) -> None:
    """With CONTAB the stick force is a coefficient divided by qbar S cbar, and one build loses
    D(CM) of the flap.
    """
    force = next((table for _, table in case.tables("tab_force")), None)
    if force is not None:
        largest = max(abs(force.values[force.flags == OK]), default=0.0)
        _report(
            case,
            force.lines[0],
            f"stick forces up to {largest:.3g} lb: the program divides the coefficient by "
            f"qbar S cbar where it ought to multiply; "
            "use the hinge moments, not F(C)",
        )
    for _, table in case.tables("symflp") if "CONTAB" in case.deck.namelists else ():
        lift, moment = table.values[:, 1], table.values[:, 2]
        if not moment.any() and (abs(lift) > 0.01).any():
            _report(
                case,
                table.lines[0],
                "D(CM) is 0.0000 at every deflection though D(CL) is not: one build of the "
                "program loses it with CONTAB, and its D(CDI) "
                "is wrong as well; run the case without CONTAB for both",
            )


def _failed_arithmetic(case: Case) -> None:
    texts = ((table, "".join(table.rows)) for page in case.pages for table in page.tables)
    tables = (
        table for table, text in texts if "a" in text or "f" in text or "#" in text
    )  # no other row has such letters
    rows = [
        line
        for table in tables
        for line, row in zip(table.lines, table.rows)
        if _FAILED.search(row)
    ]
    if rows:
        _report(
            case,
            rows[0],
            f"{len(rows)} row{'s hold' if len(rows) > 1 else ' holds'} NaN: the program's "
            f"arithmetic failed there "
            "(seen: canards, propellers at high angles of attack); other numbers of the page "
            "may be wrong too",
        )


def _dynamic_pages_repeated(case: Case) -> None:
    """The dynamic page is printed again after every ground page; it must be the same one."""
    if not any(math.isfinite(page.ground_height) for page in case.pages):
        return
    first: dict[tuple, tuple] = {}
    for page, table in case.tables("dynamic"):
        rows = tuple(row.split() for row in table.rows)
        if first.setdefault((page.configuration, *printed_condition(page)), rows) != rows:
            _report(
                case,
                table.lines[0],
                "this dynamic page differs from the one before for the same condition; the "
                "first one is used",
            )
            return


def _reference_quantities(case: Case) -> None:
    """One case has one set of reference quantities, but a low-aspect-ratio body brings its own."""
    found: dict[tuple[str, ...], int] = {}
    for page, _ in case.tables("static"):
        if page.conditions is not None:
            found.setdefault(tuple(page.conditions.text(0, i) for i in range(6, 11)), page.first)
    if len(found) > 1:
        texts = "; ".join(f"line {line}: {' '.join(words)}" for words, line in found.items())
        _report(
            case,
            min(found.values()),
            f"the pages differ in reference quantities; the tree has those of the first "
            f"page: {texts}",
        )


def _aspect_ratio_of_inboard_panels(case: Case) -> None:
    """The planform properties of a cranked surface take its span in feet, its area as it is
    printed.
    """
    for page, group in case.values("planform"):
        panels = [
            k
            for k, label in enumerate(group.labels)
            if label.endswith("THEORITICAL INBOARD ASPECT RATIO")
        ]
        if panels and page.dim != "FT":
            _report(
                case,
                group.lines[panels[0]],
                f"aspect ratio {group.texts[panels[0]]} of the theoretical inboard panel: "
                f"with DIM {page.dim} the program divides the "
                "square of a span in feet by an area in the unit of the print; do not use it",
            )
            return


def _conditions_missing(case: Case) -> None:
    wanted = len(
        {pair for pair in case.deck.conditions() if not _has_hypersonic_page(case, pair[0])}
    )
    found = len({printed_condition(page) for page, _ in case.tables("static")})
    if 0 < found < wanted:
        _report(
            case,
            case.line,
            f"{wanted} flight conditions in the input cards, {found} in the listing: the "
            f"program left some out, or pages are lost",
        )


def _has_hypersonic_page(case: Case, mach: float) -> bool:
    """Return whether the program computes a hypersonic flap at a Mach number, and nothing else."""
    return (
        "HYPEFF" in case.deck.namelists
        and case.deck.value("FLTCON", "HYPERS") == 1.0
        and mach >= HYPERSONIC_FROM
    )


def _hypersonic_flap(case: Case) -> None:
    """One build computes a hypersonic flap and prints nothing."""
    wanted = any(
        _has_hypersonic_page(case, mach) for mach in case.deck.schedule("FLTCON", "MACH", "NMACH")
    )
    if wanted and not any(page.kind == "hypersonic" for page in case.pages):
        _report(
            case,
            case.line,
            "HYPEFF is given and nothing of it is printed: one build of the program has that "
            "page switched off",
        )


def _transverse_jet(case: Case) -> None:
    """The method counts in pounds per square inch, the program's atmosphere in pounds per square
    foot.
    """
    lines = [group.lines[0] for _, group in case.values("jet")]
    if lines and not case.deck.values("FLTCON", "PINF"):
        _report(
            case,
            lines[0],
            "the transverse-jet method wants pressures in LB/IN2 and gets that of the "
            "altitude in LB/FT2: the pressures of the page are "
            "LB/FT2 in spite of their label, and the control-force coefficients, with all "
            "that follows from them, are too small by 144",
        )
