"""High-lift and control devices: symmetrical flaps, ailerons, differential tail, spoilers."""

from __future__ import annotations

import re

from datcom_io.printout.rows import Across, Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    TableLayout,
    Values,
    make_values,
    normalise_heading,
)

_DIFFERENCE = Across(
    "(DELTAL-DELTAR)", "delta_difference", 18, 23, PrintedColumn("CN", 14, 25, "Cn"), 12
)
_NO_OUTPUT = "*NOTE* NO OUTPUT AVAILABLE"

LAYOUTS = (
    TableLayout(
        "symflp",
        "DELTA D(CL) D(CM) D(CL MAX) D(CD MIN) (CLA)D (CH)A (CH)D",
        (
            PrintedColumn("DELTA", 1, 13, "delta", "deg"),
            PrintedColumn("D(CL)", 14, 23, "dCL"),
            PrintedColumn("D(CM)", 24, 34, "dCm"),
            PrintedColumn("D(CL MAX)", 35, 45, "dCLmax"),
            PrintedColumn("D(CD MIN)", 46, 62, "dCDmin"),
            PrintedColumn("(CLA)D", 63, 81, "CL_alpha_delta", "1/deg"),
            PrintedColumn("(CH)A", 82, 93, "Ch_alpha", "1/deg", constant=True),
            PrintedColumn("(CH)D", 94, 105, "Ch_delta", "1/deg"),
        ),
        keys=1,
        rows=("SYMFLP", "NDELTA"),
    ),
    TableLayout(
        "dcdi",
        "INDUCED DRAG COEFFICIENT INCREMENT , D(CDI) , DUE TO DEFLECTION",
        (PrintedColumn("ALPHA", 2, 9, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=Across("DELTA", "delta", 16, 22, PrintedColumn("D(CDI)", 15, 24, "dCDi"), 10),
    ),
    TableLayout(
        "asyflp_cn",
        "YAWING MOMENT COEFFICIENT,CN,DUE TO CONTROL DEFLECTION",
        (PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=_DIFFERENCE,
    ),
    TableLayout(
        "asyflp_tail",
        "ROLLING-MOMENT COEFFICIENT DUE TO DEFLECTION",
        (PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=_DIFFERENCE._replace(cell=PrintedColumn("(CL)ROLL", 14, 25, "Cl")),
    ),
    TableLayout(
        "asyflp_roll",
        "DELTAL DELTAR (CL)ROLL",
        (
            PrintedColumn("DELTAL", 43, 52, "delta_left", "deg"),
            PrintedColumn("DELTAR", 58, 68, "delta_right", "deg"),
            PrintedColumn("(CL)ROLL", 75, 89, "Cl"),
        ),
        keys=2,
        rows=("ASYFLP", "NDELTA"),
    ),
    TableLayout(
        "spoiler",
        "XS/C HS/C DS/C (CL)ROLL CN",
        (
            PrintedColumn("XS/C", 32, 43, "xs_c"),
            PrintedColumn("HS/C", 44, 55, "hs_c"),
            PrintedColumn("DS/C", 56, 67, "ds_c"),
            PrintedColumn("(CL)ROLL", 68, 83, "Cl"),
            PrintedColumn("CN", 84, 99, "Cn"),
        ),
        keys=3,
        rows=("ASYFLP", "NDELTA"),
    ),
    TableLayout(
        "spoiler_slot",
        "XS/C HS/C DD/C DS/C (CL)ROLL CN",
        (
            PrintedColumn("XS/C", 26, 37, "xs_c"),
            PrintedColumn("HS/C", 38, 49, "hs_c"),
            PrintedColumn("DD/C", 50, 61, "dd_c"),
            PrintedColumn("DS/C", 62, 73, "ds_c"),
            PrintedColumn("(CL)ROLL", 74, 89, "Cl"),
            PrintedColumn("CN", 90, 105, "Cn"),
        ),
        keys=4,
        rows=("ASYFLP", "NDELTA"),
    ),
    TableLayout(
        "spoiler_supersonic",
        "DS/C (CL)ROLL CN",
        (
            PrintedColumn("DS/C", 43, 54, "ds_c"),
            PrintedColumn("(CL)ROLL", 55, 72, "Cl"),
            PrintedColumn("CN", 73, 89, "Cn"),
        ),
        keys=1,
        rows=("ASYFLP", "NDELTA"),
    ),
)


def heading_values(name: str, across: Across, line: Line) -> Values | None:
    """Return the values of a heading line as a group; None when it is another line."""
    number, text = line
    if not text[1:].lstrip().startswith(across.name) or "=" not in text[: across.first]:
        return None
    start = text.index("=") + 1  # the first value may touch it
    starts = range(across.first - 1, len(text.rstrip()), across.step)
    width = across.last - across.first + 1
    texts = [text[max(first, start) : first + width] for first in starts]
    group = make_values(name, [(number, across.name, field, "deg") for field in texts])
    group.axes[across.quantity] = group.values
    return group


def _read_without_method(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the headings of an aileron table that stays empty, because there is no method at this
    Mach number.
    """
    below = [i for i in range(at + 1, len(lines)) if lines[i][1][1:].strip()][:3]
    if (
        len(below) < 3
        or normalise_heading(lines[below[1]][1]) != "ALPHA"
        or not lines[below[2]][1][1:].lstrip().startswith(_NO_OUTPUT)
    ):
        return None
    group = heading_values("asyflp_cn", _DIFFERENCE, lines[below[0]])
    return None if group is None else ([group], below[2])


BLOCKS = (
    PrintedBlock(
        ("asyflp_cn",),
        ("high-lift",),
        re.compile("^YAWING MOMENT COEFFICIENT,CN,DUE TO CONTROL DEFLECTION$"),
        _read_without_method,
    ),
)
