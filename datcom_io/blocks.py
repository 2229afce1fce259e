"""The column layout of every printed table, one entry each.

Columns are 1-based and count the carriage-control column.  The windows are wider than the printed numbers, because
a word (``NDM``, ``NA``) starts up to four columns after the left edge of its field.
"""

from __future__ import annotations

import re
from typing import NamedTuple


class Column(NamedTuple):
    """One printed column.

    ``units`` is that of the print: ``deg``, ``1``, ``1/deg``, or ``1/angle`` where card DERIV decides between degree and
    radian.  ``house`` is the name in the DataTree.  ``constant`` marks a column whose first row may hold for all rows.
    """

    name: str
    first: int
    last: int
    house: str = ""
    units: str = "1"
    constant: bool = False


class Across(NamedTuple):
    """The second axis of a two-way table: its values stand in a heading line, one value column under each.

    ``first`` and ``last`` bound the first heading value, ``cell`` the first value column; both repeat every ``step`` columns.
    """

    name: str
    house: str
    first: int
    last: int
    cell: Column
    step: int


class Layout(NamedTuple):
    """One kind of table.

    ``heading`` holds the words of the line that opens it, with single blanks and without dashes.  The first ``keys`` columns are the
    row's axes.  ``rows`` names the namelist variable that tells how many rows there must be.
    """

    name: str
    heading: str
    columns: tuple[Column, ...]
    keys: int
    rows: tuple[str, str]
    across: Across | None = None


CONDITIONS = Layout(
    "conditions",
    "",
    (
        Column("MACH NUMBER", 2, 8, "mach"),
        Column("ALTITUDE", 9, 19, "h", "length"),
        Column("VELOCITY", 20, 30, "V", "speed"),
        Column("PRESSURE", 31, 43, "p_static", "pressure"),
        Column("TEMPERATURE", 44, 56, "temperature", "temperature"),
        Column("REYNOLDS NUMBER", 57, 71, "reynolds_per_m", "reynolds"),
        Column("REF. AREA", 72, 88, "S", "area"),
        Column("REFERENCE LENGTH LONG.", 89, 99, "cbar", "length"),
        Column("REFERENCE LENGTH LAT.", 100, 109, "b", "length"),
        Column("MOMENT REF. CENTER HORIZ", 110, 119, "x_cg", "length"),
        Column("MOMENT REF. CENTER VERT", 120, 130, "z_cg", "length"),
    ),
    keys=0,
    rows=("", ""),
)

LAYOUTS = (
    Layout(
        "static",
        "ALPHA CD CL CM CN CA XCP CLA CMA CYB CNB CLB",
        (
            Column("ALPHA", 1, 8, "alpha", "deg"),
            Column("CD", 9, 17, "CD"),
            Column("CL", 18, 26, "CL"),
            Column("CM", 27, 36, "Cm"),
            Column("CN", 37, 44, "CN"),
            Column("CA", 45, 53, "CA"),
            Column("XCP", 54, 62, "xcp"),
            Column("CLA", 63, 76, "CL_alpha", "1/angle"),
            Column("CMA", 77, 89, "Cm_alpha", "1/angle"),
            Column("CYB", 90, 102, "CY_beta", "1/angle", constant=True),
            Column("CNB", 103, 115, "Cn_beta", "1/angle", constant=True),
            Column("CLB", 116, 128, "Cl_beta", "1/angle"),
        ),
        keys=1,
        rows=("FLTCON", "NALPHA"),
    ),
    Layout(
        "downwash",
        "ALPHA Q/QINF EPSLON D(EPSLON)/D(ALPHA)",
        (
            Column("ALPHA", 35, 43, "alpha", "deg"),
            Column("Q/QINF", 44, 54, "q_ratio"),
            Column("EPSLON", 55, 66, "epsilon", "deg"),
            Column("D(EPSLON)/D(ALPHA)", 67, 78, "epsilon_alpha"),
        ),
        keys=1,
        rows=("FLTCON", "NALPHA"),
    ),
    Layout(
        "dynamic",
        "ALPHA CLQ CMQ CLAD CMAD CLP CYP CNP CNR CLR",
        (
            Column("ALPHA", 1, 11, "alpha", "deg"),
            Column("CLQ", 12, 24, "CL_qhat", "1/angle", constant=True),
            Column("CMQ", 25, 37, "Cm_qhat", "1/angle", constant=True),
            Column("CLAD", 38, 51, "CL_alphadothat", "1/angle", constant=True),
            Column("CMAD", 52, 64, "Cm_alphadothat", "1/angle", constant=True),
            Column("CLP", 65, 77, "Cl_phat", "1/angle", constant=True),
            Column("CYP", 78, 90, "CY_phat", "1/angle", constant=True),
            Column("CNP", 91, 103, "Cn_phat", "1/angle", constant=True),
            Column("CNR", 104, 116, "Cn_rhat", "1/angle", constant=True),
            Column("CLR", 117, 129, "Cl_rhat", "1/angle"),
        ),
        keys=1,
        rows=("FLTCON", "NALPHA"),
    ),
    Layout(
        "symflp",
        "DELTA D(CL) D(CM) D(CL MAX) D(CD MIN) (CLA)D (CH)A (CH)D",
        (
            Column("DELTA", 1, 13, "delta", "deg"),
            Column("D(CL)", 14, 23, "dCL"),
            Column("D(CM)", 24, 34, "dCm"),
            Column("D(CL MAX)", 35, 45, "dCLmax"),
            Column("D(CD MIN)", 46, 62, "dCDmin"),
            Column("(CLA)D", 63, 81, "CL_alpha_delta", "1/deg"),
            Column("(CH)A", 82, 93, "Ch_alpha", "1/deg", constant=True),
            Column("(CH)D", 94, 105, "Ch_delta", "1/deg"),
        ),
        keys=1,
        rows=("SYMFLP", "NDELTA"),
    ),
    Layout(
        "dcdi",
        "INDUCED DRAG COEFFICIENT INCREMENT , D(CDI) , DUE TO DEFLECTION",
        (Column("ALPHA", 2, 9, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=Across("DELTA", "delta", 16, 22, Column("D(CDI)", 15, 24, "dCDi"), 10),
    ),
    Layout(
        "asyflp_cn",
        "YAWING MOMENT COEFFICIENT,CN,DUE TO CONTROL DEFLECTION",
        (Column("ALPHA", 1, 8, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=Across("(DELTAL-DELTAR)", "delta_difference", 18, 23, Column("CN", 14, 25, "Cn"), 12),
    ),
    Layout(
        "asyflp_roll",
        "DELTAL DELTAR (CL)ROLL",
        (
            Column("DELTAL", 43, 52, "delta_left", "deg"),
            Column("DELTAR", 58, 68, "delta_right", "deg"),
            Column("(CL)ROLL", 75, 89, "Cl"),
        ),
        keys=2,
        rows=("ASYFLP", "NDELTA"),
    ),
)

_DASHES = re.compile("-{2,}")
BY_HEADING = {layout.heading: layout for layout in LAYOUTS}
BY_NAME = {layout.name: layout for layout in (CONDITIONS, *LAYOUTS)}


def heading_words(line: str) -> str:
    """Return a heading line as `Layout.heading` holds it."""
    return " ".join(_DASHES.sub(" ", line[1:]).split())
