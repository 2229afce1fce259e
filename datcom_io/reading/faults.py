"""Faults of the program and gaps that can be seen in a listing: reported, never repaired.

Both known builds (the source of January 1996 with the corrections of 2011, and the single-file
edition) show them.
"""

from __future__ import annotations

import math
import re
from typing import Any

from datcom_io.arrays.conditions import control_surface, printed_condition
from datcom_io.cells import OK
from datcom_io.decks.deck import Deck
from datcom_io.listing import Case
from datcom_io.printout.content import ListingMessage
from datcom_io.printout.layouts.special import HYPERSONIC_FROM
from datcom_io.printout.tables import PrintedTable
from datcom_io.reading.attached_flow import flag_attached_flow
from datcom_io.reading.contradictions import flag_contradictions
from datcom_io.reading.damping import flag_damping
from datcom_io.reading.lateral import flag_lateral_derivatives
from datcom_io.reading.suspects import (
    flag_flap_moments,
    flag_ground_pages,
    flag_missing_angles,
    flag_order_of_angles,
    flag_power_increments,
    flag_tail_pressure,
)

# Text of a failed computation in a row: NaN, Infinity, 1.#IND.
_FAILED = re.compile("NaN|Inf|#")


class Observer:
    """Sees the cases of a file in order and adds the messages of the reader to them."""

    def __init__(self) -> None:
        self.run = 0
        self.control_tables = 0  # of the run so far
        self.deflections = 0  # of SYMFLP in the run so far

    def report(self, case: Case) -> None:
        """Add the messages of the reader about faults of the program to a case."""
        self._report_drift_of_moments(case)
        _report_last_mach(case)
        _report_control_pressure(case)
        _report_weight(case)
        flag_missing_angles(case)
        flag_order_of_angles(case)
        flag_ground_pages(case)
        _report_flaps_in_ground_effect(case)
        flag_power_increments(case)
        flag_tail_pressure(case)
        flag_contradictions(case)
        flag_damping(case)
        flag_lateral_derivatives(case)
        flag_attached_flow(case)
        _report_stick_force(case)
        _report_lost_flap_moment(case)
        _report_failed_arithmetic(case)
        _report_differing_dynamic_pages(case)
        _report_differing_references(case)
        _report_panel_aspect_ratio(case)
        _report_missing_conditions(case)
        _report_missing_hypersonic_page(case)
        _report_jet_pressures(case)

    def _report_drift_of_moments(self, case: Case) -> None:
        """The program keeps a part of D(CM) from one condition of a run to the next."""
        if case.run != self.run:
            self.run, self.control_tables, self.deflections = case.run, 0, 0
        self.deflections = flag_flap_moments(case, self.deflections)
        tables = [table for _, table in case.tables("symflp")]
        self.control_tables += len(tables)
        if tables and self.control_tables > 1:
            _add_report(
                case,
                tables[-1].lines[0],
                f"D(CM) of {self.control_tables} conditions from one program run: the "
                f"program carries it from condition to condition and "
                "it drifts (by 40 % after 18 conditions); for D(CM) that counts make one run "
                "per condition",
            )


def _add_report(case: Case, line: int, text: str) -> None:
    case.messages.append(ListingMessage(line, text, "reader"))


# Flight conditions.


def _report_last_mach(case: Case) -> None:
    """Static pages carry something of the last Mach number of a case."""
    machs = {page.condition("mach") for page, _ in case.tables("static")}
    if len(machs) > 1:
        _add_report(
            case,
            case.line,
            f"{len(machs)} Mach numbers in one case: static pages carry something of the last one "
            "(seen: CL off by 0.007, CM by 0.003, CLA by 0.02 per radian); one run per Mach "
            "number is clean",
        )


def _report_control_pressure(case: Case) -> None:
    """High-lift and control pages convert pressure and the like the wrong way unless in feet."""
    right_pressure = {}
    for page in case.pages:
        if page.kind == "static":
            right_pressure[printed_condition(page)] = page.condition("p_static")
    for page in case.pages:
        if page.kind != "high-lift" or page.conditions is None:
            continue
        pressure = page.condition("p_static")
        expected = right_pressure.get(printed_condition(page), math.nan)
        if abs(pressure - expected) > 1e-3 * abs(expected):
            _add_report(
                case,
                page.conditions.lines[0],
                f"pressure {pressure:g} on a control page, {expected:g} on the static page of "
                f"the same condition: "
                f"with DIM {page.dim} the program converts pressure, temperature and "
                f"Reynolds number the wrong way there; "
                "those of the static page are used",
            )
            return


def _report_weight(case: Case) -> None:
    """With DIM M or CM the program converts the weight again at every condition."""
    if case.deck.dim not in ("M", "CM"):
        return
    for page in case.pages:
        for note in page.notes:
            if "VEHICLE WEIGHT" in note.text:
                _add_report(
                    case,
                    note.line,
                    f"with DIM {case.deck.dim} the program divides the weight by 0.2248 again at "
                    f"every condition: "
                    "do not use the printed weights and level-flight lift coefficients",
                )
                return


def _report_missing_conditions(case: Case) -> None:
    """The program leaves out conditions, or pages are lost."""
    expected_pairs = set()
    for pair in case.deck.conditions():
        if not _has_hypersonic_page(case.deck, pair[0]):
            expected_pairs.add(pair)
    printed = {printed_condition(page) for page, _ in case.tables("static")}
    if 0 < len(printed) < len(expected_pairs):
        _add_report(
            case,
            case.line,
            f"{len(expected_pairs)} flight conditions in the input cards, {len(printed)} in the "
            f"listing: the program left some out, or pages are lost",
        )


def _report_differing_references(case: Case) -> None:
    """One case has one set of reference quantities, but a low-aspect-ratio body brings its own."""
    first_lines: dict[tuple[str, ...], int] = {}
    for page, _ in case.tables("static"):
        if page.conditions is not None:
            # Columns 6 to 10 of the flight-condition line are the reference quantities.
            references = tuple(page.conditions.text(0, i) for i in range(6, 11))
            first_lines.setdefault(references, page.first)
    if len(first_lines) > 1:
        texts = [f"line {line}: {' '.join(texts)}" for texts, line in first_lines.items()]
        _add_report(
            case,
            min(first_lines.values()),
            f"the pages differ in reference quantities; the tree has those of the first "
            f"page: {'; '.join(texts)}",
        )


# Ground effect and dynamic pages.


def _report_flaps_in_ground_effect(case: Case) -> None:
    """Ground pages with wing flaps lack the flap increment of free air."""
    pages = [page for page in case.pages if math.isfinite(page.ground_height)]
    if pages and "SYMFLP" in case.deck.namelists and control_surface(case.deck) == "wing":
        _add_report(
            case,
            pages[0].first,
            "ground pages with flaps hold the clean configuration and the ground increment "
            "with flaps: "
            "the flap increment of free air is not in them and must be added",
        )


def _report_differing_dynamic_pages(case: Case) -> None:
    """The dynamic page is printed again after every ground page; it must be the same one."""
    if not any(math.isfinite(page.ground_height) for page in case.pages):
        return
    first_rows: dict[tuple[Any, ...], list[list[str]]] = {}
    for page, table in case.tables("dynamic"):
        rows = [row.split() for row in table.rows]
        key = (page.configuration, *printed_condition(page))
        if first_rows.setdefault(key, rows) != rows:
            _add_report(
                case,
                table.lines[0],
                "this dynamic page differs from the one before for the same condition; the "
                "first one is used",
            )
            return


# Control tabs.


def _report_stick_force(case: Case) -> None:
    """The stick force is a coefficient divided by qbar S cbar."""
    for _, table in case.tables("tab_force"):
        largest = max(abs(table.values[table.flags == OK]), default=0.0)
        _add_report(
            case,
            table.lines[0],
            f"stick forces up to {largest:.3g} lb: the program divides the coefficient by "
            f"qbar S cbar where it ought to multiply; "
            "use the hinge moments, not F(C)",
        )
        return


def _report_lost_flap_moment(case: Case) -> None:
    """With CONTAB one build loses D(CM) of the flap."""
    if "CONTAB" not in case.deck.namelists:
        return
    for _, table in case.tables("symflp"):
        lift, moment = table.values[:, 1], table.values[:, 2]
        if not moment.any() and (abs(lift) > 0.01).any():
            _add_report(
                case,
                table.lines[0],
                "D(CM) is 0.0000 at every deflection though D(CL) is not: one build of the "
                "program loses it with CONTAB, and its D(CDI) "
                "is wrong as well; run the case without CONTAB for both",
            )


# Arithmetic and units.


def _report_failed_arithmetic(case: Case) -> None:
    """The arithmetic of the program fails, for canards and propellers at high angles of attack."""
    lines: list[int] = []
    for page in case.pages:
        for table in page.tables:
            lines += _failed_lines(table)
    if not lines:
        return
    rows = "row holds"
    if len(lines) > 1:
        rows = "rows hold"
    _add_report(
        case,
        lines[0],
        f"{len(lines)} {rows} NaN: the program's arithmetic failed there "
        "(seen: canards, propellers at high angles of attack); other numbers of the page "
        "may be wrong too",
    )


def _failed_lines(table: PrintedTable) -> list[int]:
    """Return the lines of rows with a failed computation."""
    # Rows without such a letter are the rule; the search of each row is slow.
    text = "".join(table.rows)
    if "a" not in text and "f" not in text and "#" not in text:
        return []
    return [line for line, row in zip(table.lines, table.rows) if _FAILED.search(row)]


def _report_panel_aspect_ratio(case: Case) -> None:
    """The planform properties of a cranked surface mix a span in feet with the printed area."""
    for page, group in case.values("planform"):
        if page.dim == "FT":
            continue
        for k, label in enumerate(group.labels):
            if label.endswith("THEORITICAL INBOARD ASPECT RATIO"):
                _add_report(
                    case,
                    group.lines[k],
                    f"aspect ratio {group.texts[k]} of the theoretical inboard panel: "
                    f"with DIM {page.dim} the program divides the "
                    "square of a span in feet by an area in the unit of the print; do not use it",
                )
                return


# Special pages.


def _has_hypersonic_page(deck: Deck, mach: float) -> bool:
    """Return whether the program computes a hypersonic flap at a Mach number, and nothing else."""
    return (
        "HYPEFF" in deck.namelists
        and deck.value("FLTCON", "HYPERS") == 1.0
        and mach >= HYPERSONIC_FROM
    )


def _report_missing_hypersonic_page(case: Case) -> None:
    """One build computes a hypersonic flap and prints nothing."""
    machs = case.deck.schedule("FLTCON", "MACH", "NMACH")
    expected = any(_has_hypersonic_page(case.deck, mach) for mach in machs)
    if expected and not any(page.kind == "hypersonic" for page in case.pages):
        _add_report(
            case,
            case.line,
            "HYPEFF is given and nothing of it is printed: one build of the program has that "
            "page switched off",
        )


def _report_jet_pressures(case: Case) -> None:
    """The method of the jet expects pounds per square inch and gets pounds per square foot."""
    lines = [group.lines[0] for _, group in case.values("jet")]
    if lines and not case.deck.values("FLTCON", "PINF"):
        _add_report(
            case,
            lines[0],
            "the transverse-jet method wants pressures in LB/IN2 and gets that of the "
            "altitude in LB/FT2: the pressures of the page are "
            "LB/FT2 in spite of their label, and the control-force coefficients, with all "
            "that follows from them, are too small by 144",
        )
