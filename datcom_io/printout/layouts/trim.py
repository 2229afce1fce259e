"""Trim pages: with a control device on wing or tail, and with an all-movable stabilizer.

The columns have group headings above them.  A trim table may stop early, with a note.  If the cards
give a weight, one more row follows after an empty line: the equilibrium in level flight.
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

# ... HAVE BEEN TERMINATED DUE TO ..., ... TERMINATED BECAUSE ...
_STOPS = "TRIM RESULTS"
_ROWS = ("FLTCON", "NALPHA")
_HINGE = "on twice the area moment of the control about its hinge line"
_STABILIZER_HINGE = "hinge-moment coefficient of the stabilizer about its axis, on S and cbar"

# Page TRIM WITH CONTROL DEVICE ON WING or ON TAIL, subsonic only.  CL stands before CD here.  CL,
# CD and CM are untrimmed; the other columns hold at the trim deflection DELTAT.
_CONTROL = (
    PrintedColumn("ALPHA", 1, 11, "alpha", "deg"),
    PrintedColumn("CL", 12, 21, "CL", meaning="lift coefficient, untrimmed"),
    PrintedColumn("CD", 22, 31, "CD", meaning="drag coefficient, untrimmed"),
    PrintedColumn("CM", 32, 41, "Cm", meaning="pitching-moment coefficient, untrimmed"),
    PrintedColumn(
        "DELTAT", 42, 49, "delta_trim", "deg", meaning="deflection of the control that trims"
    ),
    PrintedColumn("D(CL)", 50, 58, "dCL", meaning="increment of the lift coefficient at trim"),
    PrintedColumn(
        "D(CL MAX)", 59, 70, "dCLmax", meaning="increment of the largest lift coefficient at trim"
    ),
    PrintedColumn(
        "D(CDI)", 71, 82, "dCDi", meaning="increment of the induced-drag coefficient at trim"
    ),
    PrintedColumn(
        "D(CD MIN)", 83, 92, "dCDmin", meaning="increment of the smallest drag coefficient at trim"
    ),
    PrintedColumn(
        "CH(A)",
        93,
        105,
        "Ch_alpha",
        "1/deg",
        constant=True,
        meaning=f"hinge-moment coefficient per alpha, {_HINGE}",
    ),
    PrintedColumn(
        "CH(D)",
        106,
        118,
        "Ch_delta",
        "1/deg",
        meaning=f"hinge-moment coefficient per deflection, {_HINGE}",
    ),
)

# Page ALL MOVABLE HORIZONTAL STABILIZER TRIM, first table: the tail alone, untrimmed and at the
# incidence ALIHT that trims.  A row without solution has only the untrimmed numbers.
_STABILIZER = (
    PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),
    PrintedColumn(
        "UNTRIMMED CD",
        9,
        17,
        "CD_tail",
        meaning="drag coefficient of the horizontal tail, untrimmed",
    ),
    PrintedColumn(
        "UNTRIMMED CL",
        18,
        26,
        "CL_tail",
        meaning="lift coefficient of the horizontal tail, untrimmed",
    ),
    PrintedColumn(
        "UNTRIMMED CM",
        27,
        36,
        "Cm_tail",
        meaning="pitching-moment coefficient of the horizontal tail, untrimmed",
    ),
    PrintedColumn("UNTRIMMED HM", 37, 50, "Ch_tail", meaning=f"{_STABILIZER_HINGE}, untrimmed"),
    PrintedColumn(
        "ALIHT", 80, 88, "i_tail", "deg", meaning="incidence of the stabilizer that trims"
    ),
    PrintedColumn(
        "AT TRIM INCIDENCE CD",
        89,
        96,
        "CD_tail_trim",
        meaning="drag coefficient of the horizontal tail at trim",
    ),
    PrintedColumn(
        "AT TRIM INCIDENCE CL",
        97,
        105,
        "CL_tail_trim",
        meaning="lift coefficient of the horizontal tail at trim",
    ),
    PrintedColumn(
        "AT TRIM INCIDENCE CM",
        106,
        115,
        "Cm_tail_trim",
        meaning="pitching-moment coefficient of the horizontal tail at trim",
    ),
    PrintedColumn(
        "AT TRIM INCIDENCE HM", 116, 128, "Ch_tail_trim", meaning=f"{_STABILIZER_HINGE}, at trim"
    ),
)

# Second table of the same page: WING-BODY-TAIL COEFFICIENTS AT TRIM INCIDENCE.
_AIRCRAFT = (
    PrintedColumn("ALPHA", 51, 59, "alpha", "deg"),
    PrintedColumn("CD", 60, 68, "CD", meaning="drag coefficient of the aircraft at trim"),
    PrintedColumn("CL", 69, 78, "CL", meaning="lift coefficient of the aircraft at trim"),
)
# In the row of level flight the program writes CL first, so CL stands below the heading CD.
_AIRCRAFT_LEVEL = (
    _AIRCRAFT[0],
    _AIRCRAFT[2]._replace(first=60, last=68),
    _AIRCRAFT[1]._replace(first=69, last=78),
)

_SECOND_TABLE = "WING-BODY-TAIL COEFFICIENTS AT TRIM INCIDENCE"
TRIM = TableLayout("trim", "", _CONTROL, keys=1, rows=_ROWS, stops=_STOPS)
TRIM_LEVEL = TableLayout("trim_level", "", _CONTROL, keys=1)
STABILIZER = TableLayout("trim_stabilizer", "", _STABILIZER, keys=1, rows=_ROWS, stops=_STOPS)
AIRCRAFT = TableLayout("trim_stabilizer_aircraft", "", _AIRCRAFT, keys=1, rows=_ROWS, stops=_STOPS)
AIRCRAFT_LEVEL = TableLayout("trim_stabilizer_level", "", _AIRCRAFT_LEVEL, keys=1)
LAYOUTS = (TRIM, TRIM_LEVEL, STABILIZER, AIRCRAFT, AIRCRAFT_LEVEL)


def _read_trim_table(
    layout: TableLayout, columns: str, level: TableLayout | None, lines: list[Line], opening: int
) -> tuple[list[Printed], int] | None:
    """Read a table with a group heading, and the row of level flight behind it.

    The line of `columns` follows the group heading; the rows reach to the first empty line.
    """
    filled = [i for i in range(opening + 1, len(lines)) if lines[i][1][1:].strip()]
    if not filled or normalise_heading(lines[filled[0]][1]) != columns:
        return None
    start = filled[0] + 1
    table, after = read_printed_table(layout, lines[: _end_of_rows(filled, len(lines))], start)
    behind = [i for i in filled if i >= max(after, start)][:2]
    printed: list[Printed] = []
    if table:
        printed.append(table)
    # Without a row only a note or the next table may follow; any other line means another form of
    # page.
    elif not behind or not _follows_empty_table(lines[behind[0]][1]):
        return None
    if level and behind:
        row = _read_level_row(level, [lines[i] for i in behind])
        if row:
            return [*printed, row], behind[0] + 1
    return printed, max(after, start)


def _follows_empty_table(line: str) -> bool:
    """Return whether a line is a note or the heading of the second table."""
    return line[1:].startswith("*") or normalise_heading(line) == _SECOND_TABLE


def _end_of_rows(filled: list[int], end: int) -> int:
    """Return the index behind the last row before an empty line, or the end of the page.

    `filled` holds the lines with a text; the first one names the columns.
    """
    for line, following in pairwise(filled[1:]):
        if following != line + 1:
            return line + 1
    return end


def _read_level_row(level: TableLayout, lines: list[Line]) -> PrintedTable | None:
    """Return the first of two lines as the row of level flight.

    The result is None when it is not a row, or when the second line is a row too.
    """
    rows = []
    for number, text in lines:
        # On the page of a stabilizer the row has the carriage control 0.
        rows.append(read_printed_table(level, [(number, " " + text[1:])], 0)[0])
    if any(rows[1:]):
        return None
    return rows[0]


def _trim_block(
    names: tuple[str, ...],
    opens: str,
    layout: TableLayout,
    columns: str,
    level: TableLayout | None = None,
) -> PrintedBlock:
    return PrintedBlock(
        names,
        ("high-lift",),
        re.compile(f"^{opens}$"),
        partial(_read_trim_table, layout, columns, level),
    )


BLOCKS = (
    _trim_block(
        ("trim", "trim_level"),
        opens="UNTRIMMED AT TRIM DEFLECTION",
        layout=TRIM,
        columns="ALPHA CL CD CM DELTAT D(CL) D(CL MAX) D(CDI) D(CD MIN) CH(A) CH(D)",
        level=TRIM_LEVEL,
    ),
    _trim_block(
        ("trim_stabilizer",),
        opens="UNTRIMMED HORIZONTAL STABILIZER COEFFICIENTS AT TRIM INCIDENCE",
        layout=STABILIZER,
        columns="ALPHA CD CL CM HM ALIHT CD CL CM HM",
    ),
    _trim_block(
        ("trim_stabilizer_aircraft", "trim_stabilizer_level"),
        opens=_SECOND_TABLE,
        layout=AIRCRAFT,
        columns="ALPHA CD CL",
        level=AIRCRAFT_LEVEL,
    ),
)
