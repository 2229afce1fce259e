"""Flight conditions, and the pages at angle of attack: static, downwash, dynamic."""

from __future__ import annotations

from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import TableLayout

# Flight-condition line below the words FLIGHT CONDITIONS and REFERENCE DIMENSIONS.  Every page has
# it, except hypersonic, transverse-jet and section pages.  Each window reaches from the end of one
# field to the end of the next: fields grow to the left, and words are printed inside them.
CONDITIONS = TableLayout(
    "conditions",
    "",
    (
        PrintedColumn("MACH NUMBER", 2, 8, "mach"),
        PrintedColumn("ALTITUDE", 9, 19, "h", "length"),
        PrintedColumn("VELOCITY", 20, 30, "V", "speed"),
        PrintedColumn("PRESSURE", 31, 43, "p_static", "pressure"),
        PrintedColumn("TEMPERATURE", 44, 56, "temperature", "temperature"),
        PrintedColumn("REYNOLDS NUMBER", 57, 71, "reynolds_per_m", "reynolds"),
        PrintedColumn("REF. AREA", 72, 88, "S", "area"),
        PrintedColumn("REFERENCE LENGTH LONG.", 89, 99, "cbar", "length"),
        PrintedColumn("REFERENCE LENGTH LAT.", 100, 109, "b", "length"),
        PrintedColumn("MOMENT REF. CENTER HORIZ", 110, 119, "x_cg", "length"),
        PrintedColumn("MOMENT REF. CENTER VERT", 120, 130, "z_cg", "length"),
    ),
    keys=0,
)

# Page CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP.  Only CYB and CNB are printed in the
# first row for all rows; other blank cells were not computed.
_STATIC = TableLayout(
    "static",
    "ALPHA CD CL CM CN CA XCP CLA CMA CYB CNB CLB",
    (
        PrintedColumn("ALPHA", 1, 8, "alpha", "deg"),
        PrintedColumn("CD", 9, 17, "CD"),
        PrintedColumn("CL", 18, 26, "CL"),
        PrintedColumn("CM", 27, 36, "Cm"),
        PrintedColumn("CN", 37, 44, "CN"),
        PrintedColumn("CA", 45, 53, "CA"),
        PrintedColumn("XCP", 54, 62, "xcp"),
        PrintedColumn("CLA", 63, 76, "CL_alpha", "1/angle"),
        PrintedColumn("CMA", 77, 89, "Cm_alpha", "1/angle"),
        PrintedColumn("CYB", 90, 102, "CY_beta", "1/angle", constant=True),
        PrintedColumn("CNB", 103, 115, "Cn_beta", "1/angle", constant=True),
        PrintedColumn("CLB", 116, 128, "Cl_beta", "1/angle"),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)

# Second table of a static page with a wing and a horizontal tail behind it.
_DOWNWASH = TableLayout(
    "downwash",
    "ALPHA Q/QINF EPSLON D(EPSLON)/D(ALPHA)",
    (
        PrintedColumn("ALPHA", 35, 43, "alpha", "deg"),
        PrintedColumn("Q/QINF", 44, 54, "q_ratio"),
        PrintedColumn("EPSLON", 55, 66, "epsilon", "deg"),
        PrintedColumn("D(EPSLON)/D(ALPHA)", 67, 78, "epsilon_alpha"),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)

# Page DYNAMIC DERIVATIVES, printed with card DAMP.  CNR stands before CLR, and CYR is not printed.
# The derivatives refer to q c/(2V), alpha-dot c/(2V), p b/(2V) and r b/(2V).
_DYNAMIC = TableLayout(
    "dynamic",
    "ALPHA CLQ CMQ CLAD CMAD CLP CYP CNP CNR CLR",
    (
        PrintedColumn("ALPHA", 1, 11, "alpha", "deg"),
        PrintedColumn("CLQ", 12, 24, "CL_qhat", "1/angle", constant=True),
        PrintedColumn("CMQ", 25, 37, "Cm_qhat", "1/angle", constant=True),
        PrintedColumn("CLAD", 38, 51, "CL_alphadothat", "1/angle", constant=True),
        PrintedColumn("CMAD", 52, 64, "Cm_alphadothat", "1/angle", constant=True),
        PrintedColumn("CLP", 65, 77, "Cl_phat", "1/angle", constant=True),
        PrintedColumn("CYP", 78, 90, "CY_phat", "1/angle", constant=True),
        PrintedColumn("CNP", 91, 103, "Cn_phat", "1/angle", constant=True),
        PrintedColumn("CNR", 104, 116, "Cn_rhat", "1/angle", constant=True),
        PrintedColumn("CLR", 117, 129, "Cl_rhat", "1/angle"),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)

LAYOUTS = (_STATIC, _DOWNWASH, _DYNAMIC)
