"""Transonic data fairing (card PART): how the second-level methods join the subsonic to the
supersonic derivatives.

Lift slopes, ``CLB/CL`` and ``CNA`` are per degree whatever card DERIV states.
"""

from __future__ import annotations

import re

from datcom_io.printout.layouts.labelled import Labelled, read_lines, title_block
from datcom_io.printout.rows import Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    TableLayout,
    make_values,
    normalise_heading,
    read_printed_table,
)

_PAGES = ("auxiliary",)
SUBJECTS = ("WING", "WING-BODY", "HORIZONTAL TAIL", "HORIZONTAL TAIL-BODY")

SURFACE = (
    Labelled(
        "CDL/CL**2 = CLB/CL =",
        (
            PrintedColumn("CDL/CL**2", 51, 61, "CDL_CL2"),
            PrintedColumn("CLB/CL", 75, 85, "Cl_beta_CL", "1/deg"),
        ),
    ),
    Labelled(
        "FORCE BREAK MACH NUMBER (ZERO SWEEP) = FORCE BREAK MACH NUMBER (WITH SWEEP) =",
        (
            PrintedColumn("FORCE BREAK MACH NUMBER (ZERO SWEEP)", 51, 61, "mach_break_unswept"),
            PrintedColumn("FORCE BREAK MACH NUMBER (WITH SWEEP)", 105, 115, "mach_break"),
        ),
    ),
    Labelled(
        "MACH(A) = CLA(A) = MACH(B) = CLA(B) =",
        (
            PrintedColumn("MACH(A)", 32, 37, "mach_a"),
            PrintedColumn("CLA(A)", 51, 61, "CL_alpha_a", "1/deg"),
            PrintedColumn("MACH(B)", 76, 81, "mach_b"),
            PrintedColumn("CLA(B)", 95, 105, "CL_alpha_b", "1/deg"),
        ),
    ),
    Labelled(
        "(CLB/CL)M=0.6 = (CLB/CL)M=1.4 =",
        (
            PrintedColumn("(CLB/CL)M=0.6", 64, 74, "Cl_beta_CL_mach_06", "1/deg"),
            PrintedColumn("(CLB/CL)M=1.4", 95, 105, "Cl_beta_CL_mach_14", "1/deg"),
        ),
    ),
)
WITH_BODY = (
    Labelled(
        "CLB/CL = (CLB/CL)MFB = (CLB/CL)M=1.4 = (CNA)M=1.4 =",
        (
            PrintedColumn("CLB/CL", 21, 31, "Cl_beta_CL", "1/deg"),
            PrintedColumn("(CLB/CL)MFB", 50, 60, "Cl_beta_CL_break", "1/deg"),
            PrintedColumn("(CLB/CL)M=1.4", 81, 91, "Cl_beta_CL_mach_14", "1/deg"),
            PrintedColumn("(CNA)M=1.4", 109, 119, "CN_alpha_mach_14", "1/deg"),
        ),
    ),
)
DIVERGENCE = (
    Labelled(
        "DRAG DIVERGENCE MACH NUMBER =",
        (PrintedColumn("DRAG DIVERGENCE MACH NUMBER", 78, 83, "mach_divergence"),),
    ),
)
FORMS = (*SURFACE, *WITH_BODY, *DIVERGENCE)


def _over_mach(name: str, column: PrintedColumn) -> TableLayout:
    """Return a table over Mach numbers of its own, which are not the flight condition's."""
    return TableLayout(name, "", (PrintedColumn("MACH", 50, 61, "mach_node"), column), keys=1)


SLOPES = {
    subject: _over_mach(
        f"slope_{subject.lower().replace(' ', '_')}",
        PrintedColumn("CL-ALPHA", 70, 86, "CL_alpha", "1/deg"),
    )
    for subject in ("WING", "HORIZONTAL TAIL")
}
DRAG = _over_mach("drag_rise", PrintedColumn("CDO", 70, 86, "CD0"))
_TITLE = re.compile(r"^\*\*\* (\S.*\S) DATA FAIRING \*\*\*$")
_SLOPE_TABLE = "LIFT-CURVE-SLOPE INTERPOLATION TABLE"


def _read_subject(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read what stands below the title of one subject: lines of ``label = value``, then a table
    over Mach numbers.
    """
    title = _TITLE.search(normalise_heading(lines[at][1]))
    if title is None:
        return None
    subject = title[1]
    items, at = read_lines(FORMS, lines, at + 1, subject)
    found: list[Printed] = [make_values("fairing", items)] if items else []
    while at < len(lines) and (
        not (words := normalise_heading(lines[at][1])) or words == _SLOPE_TABLE
    ):
        at += 1
    layout = (
        {"MACH CL-ALPHA": SLOPES.get(subject), "MACH CDO": DRAG}.get(
            normalise_heading(lines[at][1])
        )
        if at < len(lines)
        else None
    )
    if layout:
        table, after = read_printed_table(layout, lines, at + 1)
        if table:
            return [*found, table], after
    return found, at


LAYOUTS = ()
BLOCKS = (
    PrintedBlock(
        ("fairing", *(layout.name for layout in SLOPES.values()), DRAG.name),
        _PAGES,
        _TITLE,
        _read_subject,
    ),
    title_block(_PAGES, _SLOPE_TABLE),
)
