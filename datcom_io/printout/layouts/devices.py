"""High-lift and control devices: symmetrical flaps, ailerons, differential tail, spoilers.

All tables belong to pages CHARACTERISTICS OF HIGH LIFT AND CONTROL DEVICES.  Slopes on these pages
are per degree whatever card DERIV states.
"""

from __future__ import annotations

import re

from datcom_io.printout.rows import HeadingAxis, Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    PrintedValues,
    TableLayout,
    make_values,
    normalise_heading,
)

_HINGE = "on twice the area moment of the control about its hinge line"
_XS_C = "spoiler lip behind the leading edge of the wing, in local chords"
_HS_C = "height of the spoiler over the mean line of the airfoil, in local chords"
_DD_C = "height of the deflector of a spoiler-slot-deflector, in local chords"
_DS_C = "projected height of the spoiler, in local chords"

# Page of a SYMFLP: one row per deflection.  (CH)A is printed in the first row for all rows.
_SYMFLP = TableLayout(
    "symflp",
    "DELTA D(CL) D(CM) D(CL MAX) D(CD MIN) (CLA)D (CH)A (CH)D",
    (
        PrintedColumn("DELTA", 1, 13, "delta", "deg"),
        PrintedColumn(
            "D(CL)", 14, 23, "dCL", meaning="increment of the lift coefficient, constant in alpha"
        ),
        PrintedColumn(
            "D(CM)", 24, 34, "dCm", meaning="increment of the pitching-moment coefficient"
        ),
        PrintedColumn(
            "D(CL MAX)", 35, 45, "dCLmax", meaning="increment of the largest lift coefficient"
        ),
        PrintedColumn(
            "D(CD MIN)", 46, 62, "dCDmin", meaning="increment of the smallest drag coefficient"
        ),
        PrintedColumn(
            "(CLA)D",
            63,
            81,
            "CL_alpha_delta",
            "1/deg",
            meaning="lift-curve slope of the surface with the device deflected",
        ),
        PrintedColumn(
            "(CH)A",
            82,
            93,
            "Ch_alpha",
            "1/deg",
            constant=True,
            meaning=f"hinge-moment coefficient per alpha, {_HINGE}",
        ),
        PrintedColumn(
            "(CH)D",
            94,
            105,
            "Ch_delta",
            "1/deg",
            meaning=f"hinge-moment coefficient per deflection, {_HINGE}",
        ),
    ),
    keys=1,
    rows=("SYMFLP", "NDELTA"),
)

# Second table of a subsonic SYMFLP page: induced drag over alpha and deflection.
_DCDI = TableLayout(
    "dcdi",
    "INDUCED DRAG COEFFICIENT INCREMENT , D(CDI) , DUE TO DEFLECTION",
    (PrintedColumn("ALPHA", 2, 9, "alpha", "deg"),),
    keys=1,
    rows=("FLTCON", "NALPHA"),
    across=HeadingAxis(
        "DELTA",
        "delta",
        first=16,
        last=22,
        cell=PrintedColumn(
            "D(CDI)", 15, 24, "dCDi", meaning="increment of the induced-drag coefficient"
        ),
        step=10,
    ),
)

# Page of an ASYFLP with plain ailerons (STYPE 4): yawing moment over alpha and the difference of
# left and right deflection, then the rolling moment for each pair of deflections.
_DIFFERENCE = HeadingAxis(
    "(DELTAL-DELTAR)",
    "delta_difference",
    first=18,
    last=23,
    cell=PrintedColumn("CN", 14, 25, "Cn"),
    step=12,
    counted=("ASYFLP", "NDELTA"),
)
_ASYFLP_CN = TableLayout(
    "asyflp_cn",
    "YAWING MOMENT COEFFICIENT,CN,DUE TO CONTROL DEFLECTION",
    (PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),),
    keys=1,
    rows=("FLTCON", "NALPHA"),
    across=_DIFFERENCE,
)
_ASYFLP_ROLL = TableLayout(
    "asyflp_roll",
    "DELTAL DELTAR (CL)ROLL",
    (
        PrintedColumn("DELTAL", 43, 52, "delta_left", "deg"),
        PrintedColumn("DELTAR", 58, 68, "delta_right", "deg"),
        PrintedColumn("(CL)ROLL", 75, 89, "Cl"),
    ),
    keys=2,
    rows=("ASYFLP", "NDELTA"),
)

# Page of a differential tail (ASYFLP, STYPE 5).  A transonic page has the table DELTAL DELTAR
# (CL)ROLL instead.
_ASYFLP_TAIL = TableLayout(
    "asyflp_tail",
    "ROLLING-MOMENT COEFFICIENT DUE TO DEFLECTION",
    (PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),),
    keys=1,
    rows=("FLTCON", "NALPHA"),
    across=_DIFFERENCE._replace(cell=PrintedColumn("(CL)ROLL", 14, 25, "Cl")),
)

# Pages of flap and plug spoilers (STYPE 1 and 2), of a spoiler-slot-deflector (STYPE 3), and of any
# spoiler at supersonic speed.
_SPOILER = TableLayout(
    "spoiler",
    "XS/C HS/C DS/C (CL)ROLL CN",
    (
        PrintedColumn("XS/C", 32, 43, "xs_c", meaning=_XS_C),
        PrintedColumn("HS/C", 44, 55, "hs_c", meaning=_HS_C),
        PrintedColumn("DS/C", 56, 67, "ds_c", meaning=_DS_C),
        PrintedColumn("(CL)ROLL", 68, 83, "Cl"),
        PrintedColumn("CN", 84, 99, "Cn"),
    ),
    keys=3,
    rows=("ASYFLP", "NDELTA"),
)
_SPOILER_SLOT = TableLayout(
    "spoiler_slot",
    "XS/C HS/C DD/C DS/C (CL)ROLL CN",
    (
        PrintedColumn("XS/C", 26, 37, "xs_c", meaning=_XS_C),
        PrintedColumn("HS/C", 38, 49, "hs_c", meaning=_HS_C),
        PrintedColumn("DD/C", 50, 61, "dd_c", meaning=_DD_C),
        PrintedColumn("DS/C", 62, 73, "ds_c", meaning=_DS_C),
        PrintedColumn("(CL)ROLL", 74, 89, "Cl"),
        PrintedColumn("CN", 90, 105, "Cn"),
    ),
    keys=4,
    rows=("ASYFLP", "NDELTA"),
)
_SPOILER_SUPERSONIC = TableLayout(
    "spoiler_supersonic",
    "DS/C (CL)ROLL CN",
    (
        PrintedColumn("DS/C", 43, 54, "ds_c", meaning=_DS_C),
        PrintedColumn("(CL)ROLL", 55, 72, "Cl"),
        PrintedColumn("CN", 73, 89, "Cn"),
    ),
    keys=1,
    rows=("ASYFLP", "NDELTA"),
)

LAYOUTS = (
    _SYMFLP,
    _DCDI,
    _ASYFLP_CN,
    _ASYFLP_TAIL,
    _ASYFLP_ROLL,
    _SPOILER,
    _SPOILER_SLOT,
    _SPOILER_SUPERSONIC,
)


def heading_values(name: str, across: HeadingAxis, line: Line) -> PrintedValues | None:
    """Return the values of a heading line as a group; None when it is another line."""
    number, text = line
    if not text[1:].lstrip().startswith(across.name) or "=" not in text[: across.first]:
        return None
    # The first value may touch the sign of equality.
    start = text.index("=") + 1
    width = across.last - across.first + 1
    items = []
    for first in range(across.first - 1, len(text.rstrip()), across.step):
        items.append((number, across.name, text[max(first, start) : first + width], "deg"))
    group = make_values(name, items)
    group.axes[across.quantity] = group.values
    return group


_NO_OUTPUT = "*NOTE* NO OUTPUT AVAILABLE"


def _read_without_method(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the headings of an aileron table without rows.

    The program prints the headings and a note where it has no method at this Mach number.
    """
    # Three lines that are not empty: deflections, ALPHA, and the note.
    below = [i for i in range(opening + 1, len(lines)) if lines[i][1][1:].strip()][:3]
    if len(below) < 3:
        return None
    deflections, alpha, note = below
    if normalise_heading(lines[alpha][1]) != "ALPHA":
        return None
    if not lines[note][1][1:].lstrip().startswith(_NO_OUTPUT):
        return None
    group = heading_values("asyflp_cn", _DIFFERENCE, lines[deflections])
    if group is None:
        return None
    return [group], note


BLOCKS = (
    PrintedBlock(
        ("asyflp_cn",),
        ("high-lift",),
        re.compile("^YAWING MOMENT COEFFICIENT,CN,DUE TO CONTROL DEFLECTION$"),
        _read_without_method,
    ),
)
