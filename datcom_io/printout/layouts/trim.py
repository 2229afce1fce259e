"""Trim pages: with a control device on wing or tail, and with an all-movable stabilizer.

The columns have group headings above them.  A trim table may stop early, with a note.  With a
weight on the cards, one more row follows after an empty line: the equilibrium in level flight.
"""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise

from datcom_io.printout.rows import Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    PrintedTable,
    TableLayout,
    normalise_heading,
    read_printed_table,
)

_STOPS = "TRIM RESULTS"  # ... HAVE BEEN TERMINATED DUE TO ..., ... TERMINATED BECAUSE ...
_CONTROL = (
    PrintedColumn("ALPHA", 1, 11, "alpha", "deg"),
    PrintedColumn("CL", 12, 21, "CL"),
    PrintedColumn("CD", 22, 31, "CD"),
    PrintedColumn("CM", 32, 41, "Cm"),
    PrintedColumn("DELTAT", 42, 49, "delta_trim", "deg"),
    PrintedColumn("D(CL)", 50, 58, "dCL"),
    PrintedColumn("D(CL MAX)", 59, 70, "dCLmax"),
    PrintedColumn("D(CDI)", 71, 82, "dCDi"),
    PrintedColumn("D(CD MIN)", 83, 92, "dCDmin"),
    PrintedColumn("CH(A)", 93, 105, "Ch_alpha", "1/deg", constant=True),
    PrintedColumn("CH(D)", 106, 118, "Ch_delta", "1/deg"),
)
_STABILIZER = (
    PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),
    PrintedColumn("UNTRIMMED CD", 9, 17, "CD_tail"),
    PrintedColumn("UNTRIMMED CL", 18, 26, "CL_tail"),
    PrintedColumn("UNTRIMMED CM", 27, 36, "Cm_tail"),
    PrintedColumn("UNTRIMMED HM", 37, 50, "Ch_tail"),
    PrintedColumn("ALIHT", 80, 88, "i_tail", "deg"),
    PrintedColumn("AT TRIM INCIDENCE CD", 89, 96, "CD_tail_trim"),
    PrintedColumn("AT TRIM INCIDENCE CL", 97, 105, "CL_tail_trim"),
    PrintedColumn("AT TRIM INCIDENCE CM", 106, 115, "Cm_tail_trim"),
    PrintedColumn("AT TRIM INCIDENCE HM", 116, 128, "Ch_tail_trim"),
)
_AIRCRAFT = (
    PrintedColumn("ALPHA", 51, 59, "alpha", "deg"),
    PrintedColumn("CD", 60, 68, "CD"),
    PrintedColumn("CL", 69, 78, "CL"),
)
# the program's WRITE names CL first, so that it stands below the heading CD
_AIRCRAFT_LEVEL = (
    _AIRCRAFT[0],
    _AIRCRAFT[1]._replace(name="CL", quantity="CL"),
    _AIRCRAFT[2]._replace(name="CD", quantity="CD"),
)
_ROWS = ("FLTCON", "NALPHA")

TRIM = TableLayout("trim", "", _CONTROL, keys=1, rows=_ROWS, stops=_STOPS)
TRIM_LEVEL = TableLayout("trim_level", "", _CONTROL, keys=1)
STABILIZER = TableLayout("trim_stabilizer", "", _STABILIZER, keys=1, rows=_ROWS, stops=_STOPS)
AIRCRAFT = TableLayout("trim_stabilizer_aircraft", "", _AIRCRAFT, keys=1, rows=_ROWS, stops=_STOPS)
AIRCRAFT_LEVEL = TableLayout("trim_stabilizer_level", "", _AIRCRAFT_LEVEL, keys=1)
LAYOUTS = (TRIM, TRIM_LEVEL, STABILIZER, AIRCRAFT, AIRCRAFT_LEVEL)


def _read(
    layout: TableLayout, columns: str, level: TableLayout | None, lines: list[Line], at: int
) -> tuple[list[Printed], int] | None:
    """Read a table with a group heading, the line of `columns` and the rows up to a gap, and a row
    of level flight behind it.
    """
    filled = [i for i in range(at + 1, len(lines)) if lines[i][1][1:].strip()]
    if not filled or normalise_heading(lines[filled[0]][1]) != columns:
        return None
    start = filled[0] + 1
    gap = next((i + 1 for i, j in pairwise(filled[1:]) if j != i + 1), len(lines))
    table, after = read_printed_table(layout, lines[:gap], start)
    printed: list[Printed] = [table] if table else []
    behind = [i for i in filled if i >= max(after, start)][:2]
    if table is None and not (behind and lines[behind[0]][1][1:].startswith("*")):
        return None
    if level and behind and (row := _level_row(level, [lines[i] for i in behind])):
        return [*printed, row], behind[0] + 1
    return printed, max(after, start)


def _level_row(level: TableLayout, lines: list[Line]) -> PrintedTable | None:
    """Return the first of two lines as the row of level flight; None when it is no row, or one of
    several.
    """
    rows = [
        read_printed_table(level, [(number, " " + text[1:])], 0)[0] for number, text in lines
    ]  # a stabilizer's has a 0 in front
    return None if any(rows[1:]) else rows[0]


def _block(
    names: tuple[str, ...],
    opens: str,
    layout: TableLayout,
    columns: str,
    level: TableLayout | None = None,
) -> PrintedBlock:
    return PrintedBlock(
        names, ("high-lift",), re.compile(f"^{opens}$"), partial(_read, layout, columns, level)
    )


BLOCKS = (
    _block(
        ("trim", "trim_level"),
        "UNTRIMMED AT TRIM DEFLECTION",
        TRIM,
        "ALPHA CL CD CM DELTAT D(CL) D(CL MAX) D(CDI) D(CD MIN) CH(A) CH(D)",
        TRIM_LEVEL,
    ),
    _block(
        ("trim_stabilizer",),
        "UNTRIMMED HORIZONTAL STABILIZER COEFFICIENTS AT TRIM INCIDENCE",
        STABILIZER,
        "ALPHA CD CL CM HM ALIHT CD CL CM HM",
    ),
    _block(
        ("trim_stabilizer_aircraft", "trim_stabilizer_level"),
        "WING-BODY-TAIL COEFFICIENTS AT TRIM INCIDENCE",
        AIRCRAFT,
        "ALPHA CD CL",
        AIRCRAFT_LEVEL,
    ),
)
