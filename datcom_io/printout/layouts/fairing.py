"""Transonic data fairing (card PART): numbers between which the program interpolates.

The second-level methods join subsonic and supersonic derivatives.  Lift slopes, ``CLB/CL`` and
``CNA`` are per degree whatever card DERIV states.
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
WHOLE_AIRCRAFT = "BODY-WING-HORIZONTAL TAIL"
"""Subject of the block with the drag-divergence Mach number and the drag rise."""

_ROLL_PER_LIFT = "rolling moment from sideslip per lift coefficient"

# Blocks *** WING DATA FAIRING *** and *** HORIZONTAL TAIL DATA FAIRING ***.
SURFACE = (
    Labelled(
        "CDL/CL**2 = CLB/CL =",
        (
            PrintedColumn(
                "CDL/CL**2",
                51,
                61,
                "CDL_CL2",
                meaning="drag due to lift over the square of the lift coefficient",
            ),
            PrintedColumn("CLB/CL", 75, 85, "Cl_beta_CL", "1/deg", meaning=_ROLL_PER_LIFT),
        ),
    ),
    Labelled(
        "FORCE BREAK MACH NUMBER (ZERO SWEEP) = FORCE BREAK MACH NUMBER (WITH SWEEP) =",
        (
            PrintedColumn(
                "FORCE BREAK MACH NUMBER (ZERO SWEEP)",
                51,
                61,
                "mach_break_unswept",
                meaning="force-break Mach number without sweep",
            ),
            PrintedColumn(
                "FORCE BREAK MACH NUMBER (WITH SWEEP)",
                105,
                115,
                "mach_break",
                meaning="force-break Mach number with sweep",
            ),
        ),
    ),
    Labelled(
        "MACH(A) = CLA(A) = MACH(B) = CLA(B) =",
        (
            PrintedColumn(
                "MACH(A)", 32, 37, "mach_a", meaning="Mach number 0.07 above the force break"
            ),
            PrintedColumn(
                "CLA(A)", 51, 61, "CL_alpha_a", "1/deg", meaning="lift-curve slope at mach_a"
            ),
            PrintedColumn(
                "MACH(B)", 76, 81, "mach_b", meaning="Mach number 0.14 above the force break"
            ),
            PrintedColumn(
                "CLA(B)", 95, 105, "CL_alpha_b", "1/deg", meaning="lift-curve slope at mach_b"
            ),
        ),
    ),
    Labelled(
        "(CLB/CL)M=0.6 = (CLB/CL)M=1.4 =",
        (
            PrintedColumn(
                "(CLB/CL)M=0.6",
                64,
                74,
                "Cl_beta_CL_mach_06",
                "1/deg",
                meaning=f"{_ROLL_PER_LIFT} at Mach 0.6",
            ),
            PrintedColumn(
                "(CLB/CL)M=1.4",
                95,
                105,
                "Cl_beta_CL_mach_14",
                "1/deg",
                meaning=f"{_ROLL_PER_LIFT} at Mach 1.4",
            ),
        ),
    ),
)

# Blocks *** WING-BODY DATA FAIRING *** and *** HORIZONTAL TAIL-BODY DATA FAIRING ***.
WITH_BODY = (
    Labelled(
        "CLB/CL = (CLB/CL)MFB = (CLB/CL)M=1.4 = (CNA)M=1.4 =",
        (
            PrintedColumn("CLB/CL", 21, 31, "Cl_beta_CL", "1/deg", meaning=_ROLL_PER_LIFT),
            PrintedColumn(
                "(CLB/CL)MFB",
                50,
                60,
                "Cl_beta_CL_break",
                "1/deg",
                meaning=f"{_ROLL_PER_LIFT} at the force-break Mach number",
            ),
            PrintedColumn(
                "(CLB/CL)M=1.4",
                81,
                91,
                "Cl_beta_CL_mach_14",
                "1/deg",
                meaning=f"{_ROLL_PER_LIFT} at Mach 1.4",
            ),
            PrintedColumn(
                "(CNA)M=1.4",
                109,
                119,
                "CN_alpha_mach_14",
                "1/deg",
                meaning="normal-force slope at Mach 1.4",
            ),
        ),
    ),
)

# Block *** BODY-WING-HORIZONTAL TAIL DATA FAIRING ***.
DIVERGENCE = (
    Labelled(
        "DRAG DIVERGENCE MACH NUMBER =",
        (
            PrintedColumn(
                "DRAG DIVERGENCE MACH NUMBER",
                78,
                83,
                "mach_divergence",
                meaning="drag-divergence Mach number",
            ),
        ),
    ),
)
FORMS = (*SURFACE, *WITH_BODY, *DIVERGENCE)


def _slope_table(name: str) -> TableLayout:
    """Return the five-row table of the lift slope of a surface over Mach number."""
    return TableLayout(
        name,
        "",
        (
            PrintedColumn(
                "MACH",
                50,
                61,
                "mach_node",
                meaning="Mach numbers between which the lift-curve slope is interpolated",
            ),
            PrintedColumn(
                "CL-ALPHA",
                70,
                86,
                "CL_alpha",
                "1/deg",
                meaning="lift-curve slope at these Mach numbers",
            ),
        ),
        keys=1,
    )


# The Mach numbers of these tables are not those of the flight condition.
SLOPES = {
    "WING": _slope_table("slope_wing"),
    "HORIZONTAL TAIL": _slope_table("slope_horizontal_tail"),
}
DRAG = TableLayout(
    "drag_rise",
    "",
    (
        PrintedColumn(
            "MACH",
            50,
            61,
            "mach_node",
            meaning="Mach numbers between which the zero-lift drag is interpolated",
        ),
        PrintedColumn(
            "CDO", 70, 86, "CD0", meaning="zero-lift drag coefficient at these Mach numbers"
        ),
    ),
    keys=1,
)
_TITLE = re.compile(r"^\*\*\* (\S.*\S) DATA FAIRING \*\*\*$")
_SLOPE_TITLE = "LIFT-CURVE-SLOPE INTERPOLATION TABLE"


def _read_subject(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the lines of ``label = value`` of one subject, then its table over Mach numbers."""
    title = _TITLE.search(normalise_heading(lines[opening][1]))
    if title is None:
        return None
    subject = title[1]
    # Labels repeat in every block, so the subject is put before them.
    items, after = read_lines(FORMS, lines, opening + 1, subject)
    printed: list[Printed] = []
    if items:
        printed.append(make_values("fairing", items))
    while after < len(lines) and normalise_heading(lines[after][1]) in ("", _SLOPE_TITLE):
        after += 1
    layout = None
    if after < len(lines):
        # Surfaces print a lift slope, the whole aircraft a drag rise.
        headings = {"MACH CL-ALPHA": SLOPES.get(subject), "MACH CDO": DRAG}
        layout = headings.get(normalise_heading(lines[after][1]))
    if layout:
        table, end = read_printed_table(layout, lines, after + 1)
        if table:
            return [*printed, table], end
    return printed, after


LAYOUTS = ()
BLOCKS = (
    PrintedBlock(
        ("fairing", *(layout.name for layout in SLOPES.values()), DRAG.name),
        _PAGES,
        _TITLE,
        _read_subject,
    ),
    title_block(_PAGES, _SLOPE_TITLE),
)
