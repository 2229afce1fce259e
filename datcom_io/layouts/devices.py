"""High-lift and control devices: symmetrical flaps, ailerons."""

from __future__ import annotations

from .form import Across, Column, Layout

LAYOUTS = (
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
