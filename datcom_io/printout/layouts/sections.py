"""Airfoil sections: coordinates, and what the section module computes from them; once per case and
surface.

Lift slopes are per degree whatever card DERIV states.
"""

from __future__ import annotations

import re

from datcom_io.printout.layouts.labelled import Labelled, labelled_block
from datcom_io.printout.rows import Line, PrintedColumn, cached_column_windows
from datcom_io.printout.tables import Printed, PrintedBlock, PrintedTable, TableLayout, make_values

_PAGES = ("section",)

COORDINATES = TableLayout(
    "coordinates",
    "UPPER ABSCISSA UPPER ORDINATE LOWER ABSCISSA LOWER ORDINATE X-FRACTION CHORD MEAN LINE "
    "THICKNESS",
    (
        PrintedColumn("UPPER ABSCISSA", 5, 20, "x_upper"),
        PrintedColumn("UPPER ORDINATE", 24, 39, "z_upper"),
        PrintedColumn("LOWER ABSCISSA", 43, 58, "x_lower"),
        PrintedColumn("LOWER ORDINATE", 61, 76, "z_lower"),
        PrintedColumn("X-FRACTION CHORD", 81, 96, "x"),
        PrintedColumn("MEAN LINE", 100, 112, "mean_line"),
        PrintedColumn("THICKNESS", 114, 126, "thickness"),
    ),
    keys=0,
)


def _alone(name: str, quantity: str, units: str = "1", printed_unit: str = "") -> Labelled:
    """Return a line with one number; on a section page they all stand in the same columns."""
    return Labelled(
        f"{name} = {printed_unit}".strip(), (PrintedColumn(name, 58, 67, quantity, units),)
    )


SUMMARY = (
    _alone("IDEAL ANGLE OF ATTACK", "alpha_ideal", "deg", "DEG."),
    _alone("ZERO LIFT ANGLE OF ATTACK", "alpha_zero_lift", "deg", "DEG."),
    _alone("IDEAL LIFT COEFFICIENT", "CL_ideal"),
    _alone("ZERO LIFT PITCHING MOMENT COEFFICIENT", "Cm_zero_lift"),
    _alone("MACH ZERO LIFT-CURVE-SLOPE", "CL_alpha_mach_zero", "1/deg", "/DEG."),
    _alone("LEADING EDGE RADIUS", "leading_edge_radius", "1", "FRACTION CHORD"),
    _alone("MAXIMUM AIRFOIL THICKNESS", "thickness_ratio", "1", "FRACTION CHORD"),
    _alone("DELTA-Y", "delta_y", "%", "PERCENT CHORD"),
    _alone("CREST CRITICAL MACH", "mach_crest"),
    _alone("LOCATION", "x_crest", "1", "FRACTION CHORD"),
    _alone("LIFT-CURVE-SLOPE", "CL_alpha_crest", "1/deg", "/DEG."),
)
SLOPE = TableLayout(
    "section_slope",
    "",
    (
        PrintedColumn("MACH", 32, 38, "mach_node"),
        PrintedColumn("LIFT-CURVE-SLOPE", 58, 67, "CL_alpha", "1/deg"),
        PrintedColumn("XAC", 85, 94, "xac"),
    ),
    keys=1,
)
_SLOPE_LABELS = re.compile(r"[0 ] {25}MACH=.{7} LIFT-CURVE-SLOPE =.{10} /DEG\. {5} XAC =.{10}$")


def _read_slopes(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the lines of lift slope and aerodynamic centre, one per Mach number, as the rows of a
    table.
    """
    numbers, rows, after = [], [], at
    for k in range(at, len(lines)):
        number, text = lines[k]
        if not text[1:].strip():
            continue
        # the labels stand between the windows, where a row must be blank
        if not _SLOPE_LABELS.match(text) or not cached_column_windows(
            SLOPE.columns, SLOPE.keys
        ).hold(_numbers_only(text)):
            break
        numbers.append(number)
        rows.append(text)
        after = k + 1
    return (
        ([PrintedTable(SLOPE, SLOPE.columns, tuple(numbers), tuple(rows))], after) if rows else None
    )


def _numbers_only(text: str) -> str:
    row = ""
    for column in SLOPE.columns:
        row = row.ljust(column.first - 1) + text[column.first - 1 : column.last]
    return row


def _read_designation(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the name of a NACA section; that of a 6-series section may go on with its mean line,
    ``A=0.5``.
    """
    number, text = lines[at]
    items = [(number, "DESIGNATION", text[1:], "")]
    if at + 1 < len(lines) and (mean_line := _MEAN_LINE.match(lines[at + 1][1])):
        items.append((lines[at + 1][0], "A", mean_line[1], ""))
    return [make_values("designation", items)], at + len(items)


_MEAN_LINE = re.compile(r" +A= ?(0?\.\d)$")

LAYOUTS = (COORDINATES,)
BLOCKS = (
    PrintedBlock(("designation",), _PAGES, re.compile(r"^NACA \S"), _read_designation),
    labelled_block("section", _PAGES, SUMMARY),
    PrintedBlock(("section_slope",), _PAGES, re.compile(r"^MACH="), _read_slopes),
)
