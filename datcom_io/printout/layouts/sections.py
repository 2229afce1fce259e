"""Pages SECTION DEFINITION: airfoil coordinates, and what the section module computes from them.

They are printed once per case and surface.  Lift slopes are per degree whatever card DERIV states.
"""

from __future__ import annotations

import re

from datcom_io.printout.layouts.labelled import Labelled, labelled_block
from datcom_io.printout.rows import Line, PrintedColumn, cached_column_windows
from datcom_io.printout.tables import Printed, PrintedBlock, PrintedTable, TableLayout, make_values

_PAGES = ("section",)

# First page of a surface with a NACA card or coordinates on the cards: about 60 rows.
COORDINATES = TableLayout(
    "coordinates",
    "UPPER ABSCISSA UPPER ORDINATE LOWER ABSCISSA LOWER ORDINATE X-FRACTION CHORD MEAN LINE "
    "THICKNESS",
    (
        PrintedColumn(
            "UPPER ABSCISSA",
            5,
            20,
            "x_upper",
            meaning="upper surface behind the leading edge, in chords",
        ),
        PrintedColumn(
            "UPPER ORDINATE",
            24,
            39,
            "z_upper",
            meaning="upper surface above the chord line, in chords",
        ),
        PrintedColumn(
            "LOWER ABSCISSA",
            43,
            58,
            "x_lower",
            meaning="lower surface behind the leading edge, in chords",
        ),
        PrintedColumn(
            "LOWER ORDINATE",
            61,
            76,
            "z_lower",
            meaning="lower surface above the chord line, in chords",
        ),
        PrintedColumn(
            "X-FRACTION CHORD",
            81,
            96,
            "x",
            meaning="station of mean line and thickness behind the leading edge, in chords",
        ),
        PrintedColumn(
            "MEAN LINE", 100, 112, "mean_line", meaning="mean line above the chord line, in chords"
        ),
        PrintedColumn("THICKNESS", 114, 126, "thickness", meaning="thickness, in chords"),
    ),
    keys=0,
)


def _single_number(
    name: str, quantity: str, *, units: str = "1", printed_unit: str = "", meaning: str
) -> Labelled:
    """Return a line with one number; on a section page all of them have the same columns."""
    column = PrintedColumn(name, 58, 67, quantity, units, meaning=meaning)
    return Labelled(f"{name} = {printed_unit}".strip(), (column,))


# Second page of a surface.  Above the crest-critical Mach number it prints the last three lines.
SUMMARY = (
    _single_number(
        "IDEAL ANGLE OF ATTACK",
        "alpha_ideal",
        units="deg",
        printed_unit="DEG.",
        meaning="ideal angle of attack of the section",
    ),
    _single_number(
        "ZERO LIFT ANGLE OF ATTACK",
        "alpha_zero_lift",
        units="deg",
        printed_unit="DEG.",
        meaning="angle of attack of the section at zero lift",
    ),
    _single_number(
        "IDEAL LIFT COEFFICIENT",
        "CL_ideal",
        meaning="lift coefficient of the section at the ideal angle of attack",
    ),
    _single_number(
        "ZERO LIFT PITCHING MOMENT COEFFICIENT",
        "Cm_zero_lift",
        meaning="pitching-moment coefficient of the section at zero lift, about the quarter chord",
    ),
    _single_number(
        "MACH ZERO LIFT-CURVE-SLOPE",
        "CL_alpha_mach_zero",
        units="1/deg",
        printed_unit="/DEG.",
        meaning="lift-curve slope of the section at Mach 0",
    ),
    _single_number(
        "LEADING EDGE RADIUS",
        "leading_edge_radius",
        printed_unit="FRACTION CHORD",
        meaning="leading-edge radius, in chords",
    ),
    _single_number(
        "MAXIMUM AIRFOIL THICKNESS",
        "thickness_ratio",
        printed_unit="FRACTION CHORD",
        meaning="greatest thickness, in chords",
    ),
    _single_number(
        "DELTA-Y",
        "delta_y",
        units="%",
        printed_unit="PERCENT CHORD",
        meaning="difference of the upper ordinates at 6 and 0.15 % chord, in chords",
    ),
    _single_number("CREST CRITICAL MACH", "mach_crest", meaning="crest-critical Mach number"),
    _single_number(
        "LOCATION",
        "x_crest",
        printed_unit="FRACTION CHORD",
        meaning="crest behind the leading edge, in chords",
    ),
    _single_number(
        "LIFT-CURVE-SLOPE",
        "CL_alpha_crest",
        units="1/deg",
        printed_unit="/DEG.",
        meaning="lift-curve slope of the section at the crest-critical Mach number, used above it",
    ),
)

# Lines MACH= x LIFT-CURVE-SLOPE = y /DEG. XAC = z of the same page, one per subsonic Mach number.
SLOPE = TableLayout(
    "section_slope",
    "",
    (
        PrintedColumn("MACH", 32, 38, "mach_node"),
        PrintedColumn(
            "LIFT-CURVE-SLOPE",
            58,
            67,
            "CL_alpha",
            "1/deg",
            meaning="lift-curve slope of the section, absent from the crest-critical Mach number "
            "on",
        ),
        PrintedColumn(
            "XAC",
            85,
            94,
            "xac",
            meaning="aerodynamic centre of the section behind the leading edge, in chords",
        ),
    ),
    keys=1,
)
_SLOPE_LABELS = re.compile(r"[0 ] {25}MACH=.{7} LIFT-CURVE-SLOPE =.{10} /DEG\. {5} XAC =.{10}$")


def _read_slopes(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the lines of lift slope and aerodynamic centre as the rows of a table."""
    # The lines are rows of a table with labels between the columns.
    windows = cached_column_windows(SLOPE.columns, SLOPE.keys)
    numbers, rows, after = [], [], opening
    for k in range(opening, len(lines)):
        number, text = lines[k]
        if not text[1:].strip():
            continue
        # The labels stand between the windows, where a row of a table must be blank.
        if not _SLOPE_LABELS.match(text) or not windows.hold(_without_labels(text)):
            break
        numbers.append(number)
        rows.append(text)
        after = k + 1
    if not rows:
        return None
    return [PrintedTable(SLOPE, SLOPE.columns, tuple(numbers), tuple(rows))], after


def _without_labels(text: str) -> str:
    """Return a line of lift slope with blanks in place of its labels."""
    row = ""
    for column in SLOPE.columns:
        row = row.ljust(column.first - 1) + text[column.first - 1 : column.last]
    return row


_MEAN_LINE = re.compile(r" +A= ?(0?\.\d)$")


def _read_designation(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the name of a NACA section.

    The name of a 6-series section may go on with its mean line, ``A=0.5``.
    """
    number, text = lines[opening]
    items = [(number, "DESIGNATION", text[1:], "")]
    if opening + 1 < len(lines):
        mean_line = _MEAN_LINE.match(lines[opening + 1][1])
        if mean_line:
            items.append((lines[opening + 1][0], "A", mean_line[1], ""))
    return [make_values("designation", items)], opening + len(items)


LAYOUTS = (COORDINATES,)
BLOCKS = (
    PrintedBlock(("designation",), _PAGES, re.compile(r"^NACA \S"), _read_designation),
    labelled_block("section", _PAGES, SUMMARY),
    PrintedBlock(("section_slope",), _PAGES, re.compile(r"^MACH="), _read_slopes),
)
