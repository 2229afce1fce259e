"""Flight conditions, and the pages at angle of attack: static, downwash, dynamic."""

from __future__ import annotations

from datcom_io.printout.rows import Column
from datcom_io.printout.tables import Layout

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
)
