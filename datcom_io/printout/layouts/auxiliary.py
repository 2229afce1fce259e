"""Pages of card PART: body and planform properties, interference factors, vortices, increments of
dynamic derivatives.

Nothing on them depends on card DERIV: lift slopes are per degree, derivatives with a rate per
radian of it.
"""

from __future__ import annotations

import re

from datcom_io.printout.layouts.labelled import Item, Labelled, labelled_block, title_block
from datcom_io.printout.rows import Line, PrintedColumn, cached_column_windows
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    TableLayout,
    make_values,
    normalise_heading,
    read_printed_table,
)

_PAGES = ("auxiliary",)
SURFACES = ("WING", "HORIZONTAL TAIL", "VERTICAL TAIL", "VENTRAL FIN")
PANELS = (
    "THEORITICAL INBOARD",
    "EXPOSED INBOARD",
    "OUTBOARD",
    "TOTAL THEORITICAL",
    "TOTAL EXPOSED",
)
_LABEL_END = 20  # last column of a panel's name

BODY = TableLayout(
    "body",
    "WETTED AREA XCG ZCG BASE AREA ZERO LIFT DRAG BASE DRAG FRICTION DRAG PRESSURE DRAG",
    (
        PrintedColumn("WETTED AREA", 12, 24, "area_wetted", "area"),
        PrintedColumn("XCG", 26, 33, "x_moment_centre", "length"),
        PrintedColumn("ZCG", 35, 42, "z_moment_centre", "length"),
        PrintedColumn("BASE AREA", 44, 58, "area_base", "area"),
        PrintedColumn("ZERO LIFT DRAG", 60, 72, "CD0"),
        PrintedColumn("BASE DRAG", 74, 86, "CD_base"),
        PrintedColumn("FRICTION DRAG", 88, 102, "CD_friction"),
        PrintedColumn("PRESSURE DRAG", 104, 117, "CD_pressure"),
    ),
    keys=0,
)
MAC = Labelled(
    "XCG RELATIVE TO THEORETICAL LEADING EDGE MAC=",
    (
        PrintedColumn(
            "XCG RELATIVE TO THEORETICAL LEADING EDGE MAC", 87, 93, "x_behind_mac", "length"
        ),
    ),
)
PLANFORM = (
    PrintedColumn("AREA", 21, 33, "area", "area"),
    PrintedColumn("TAPER RATIO", 34, 43, "taper_ratio"),
    PrintedColumn("ASPECT RATIO", 44, 57, "aspect_ratio"),
    PrintedColumn("QUARTER CHORD SWEEP", 58, 67, "sweep_c4", "deg"),
    PrintedColumn("MAC", 68, 80, "mac", "length"),
    PrintedColumn("QUARTER CHORD X(MAC)", 81, 93, "x_c4_mac", "length"),
    PrintedColumn("Y(MAC)", 94, 106, "y_mac", "length"),
    PrintedColumn("ZERO LIFT DRAG", 107, 119, "CD0"),
    PrintedColumn("FRICTION COEFFICIENT", 120, 132, "Cf"),
)


def _interference(letter: str) -> Labelled:
    """Return the line of the surface with a letter, W or H, and the body."""
    return Labelled(
        f"CLA-B({letter})= CLA-{letter}(B)= K-B({letter})= K-{letter}(B)= XAC/C-B({letter})=",
        (
            PrintedColumn(f"CLA-B({letter})", 21, 30, "CL_alpha_body", "1/deg"),
            PrintedColumn(f"CLA-{letter}(B)", 45, 54, "CL_alpha_surface", "1/deg"),
            PrintedColumn(f"K-B({letter})", 67, 76, "K_body"),
            PrintedColumn(f"K-{letter}(B)", 89, 98, "K_surface"),
            PrintedColumn(f"XAC/C-B({letter})", 115, 124, "xac_body"),
        ),
    )


INTERFERENCE = {"WING": _interference("W"), "HORIZONTAL TAIL": _interference("H")}
SIDEWASH = Labelled(
    "SIDEWASH, (1 + D(SIGMA)/D(BETA))QV/Q =",
    (PrintedColumn("SIDEWASH, (1 + D(SIGMA)/D(BETA))QV/Q", 78, 91, "sidewash"),),
)
VORTEX = TableLayout(
    "vortex",
    "",
    (
        PrintedColumn("ALPHA", 14, 24, "alpha", "deg"),
        PrintedColumn("IV-B(W)", 27, 41, "i_body_wing"),
        PrintedColumn("IV-W(H)", 44, 58, "i_wing_tail"),
        PrintedColumn("IV-B(H)", 61, 75, "i_body_tail"),
        PrintedColumn("GAMMA/2*PI*ALPHA*V*R", 78, 93, "gamma"),
        PrintedColumn("GAMMA/(2*PI*ALPHA*V*R)T", 103, 118, "gamma_tail"),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)
INCREMENTS = (
    Labelled(
        "CLP(GAMMA=CL=0) = CLP(GAMMA)/CLP (GAMMA=0) = CNP/THETA =",
        (
            PrintedColumn("CLP(GAMMA=CL=0)", 28, 38, "Cl_phat"),
            PrintedColumn("CLP(GAMMA)/CLP (GAMMA=0)", 70, 80, "Cl_phat_ratio_dihedral"),
            PrintedColumn("CNP/THETA", 98, 108, "Cn_phat_twist", "1/deg"),
        ),
    ),
    Labelled(
        "CYP/GAMMA = CYP/CL (CL=0) =",
        (
            PrintedColumn("CYP/GAMMA", 42, 52, "dCY_phat_dihedral"),
            PrintedColumn("CYP/CL (CL=0)", 88, 98, "CY_phat_CL"),
        ),
    ),
)
DIHEDRAL_AND_TWIST = (
    PrintedColumn("CLB/GAMMA", 44, 59, "Cl_beta_dihedral", "1/deg2"),
    PrintedColumn("(CMO/THETA)W", 62, 77, "Cm0_twist_wing", "1/deg"),
    PrintedColumn("(CMO/THETA)H", 80, 95, "Cm0_twist_tail", "1/deg"),
)
CANARD = TableLayout(
    "canard_downwash",
    "ALPHA (EPSOLN)EFF. D(EPSOLN)/D(ALPHA) EFF.",
    (
        PrintedColumn("ALPHA", 44, 54, "alpha", "deg"),
        PrintedColumn("(EPSOLN)EFF.", 58, 73, "epsilon_effective", "deg"),
        PrintedColumn("D(EPSOLN)/D(ALPHA) EFF.", 76, 90, "epsilon_alpha_effective"),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)


def _read_surface(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the panels of a surface: a line with the panel's name, and the numbers printed over it
    (``+``).
    """
    surface, items = normalise_heading(lines[at][1]), []
    after = at + 1
    for k in range(at + 1, len(lines)):
        name = lines[k][1][1:_LABEL_END].strip()
        if name and name not in PANELS:
            break
        if not name:
            continue
        over = (
            k if lines[k][1][_LABEL_END:].strip() else k + 1
        )  # a printer filter has put both lines into one
        found = _panel(f"{surface} {name}", lines[over]) if over < len(lines) else []
        if not found:
            break
        items += found
        after = over + 1
    return ([make_values("planform", items)], after) if items else None


def _panel(subject: str, line: Line) -> list[Item]:
    number, text = line
    row = " " * _LABEL_END + text[_LABEL_END:]
    if not cached_column_windows(PLANFORM, 0).hold(row):
        return []
    return [
        (number, f"{subject} {column.name}", row[column.first - 1 : column.last], "")
        for column in PLANFORM
    ]


def _read_vortex(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the vortex table; its heading goes on in a second line."""
    second = next((k for k in range(at + 1, len(lines)) if lines[k][1][1:].strip()), at)
    if normalise_heading(lines[second][1]) != "2*PI*ALPHA*V*R (2*PI*ALPHA*V*R)T":
        return None
    table, after = read_printed_table(VORTEX, lines, second + 1)
    return ([table], after) if table else None


def _read_row(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the one row below the heading of the derivatives per dihedral and twist."""
    below = next((k for k in range(at + 1, len(lines)) if lines[k][1][1:].strip()), at)
    number, row = lines[below]
    if below == at or not cached_column_windows(DIHEDRAL_AND_TWIST, 0).hold(row):
        return None
    items = [
        (number, column.name, row[column.first - 1 : column.last], "")
        for column in DIHEDRAL_AND_TWIST
    ]
    return [make_values("increments", items)], below + 1


LAYOUTS = (BODY, CANARD)
BLOCKS = (
    title_block(
        _PAGES,
        "BASIC BODY PROPERTIES",
        "BASIC PLANFORM PROPERTIES",
        "TAPER ASPECT QUARTER CHORD QUARTER CHORD ZERO LIFT FRICTION",
        "AREA RATIO RATIO SWEEP MAC X(MAC) Y(MAC) DRAG COEFFICIENT",
        "DYNAMIC DERIVATIVE INCREMENTALS",
        "CANARD EFFECTIVE DOWNWASH",
    ),
    labelled_block("mac", _PAGES, (MAC,)),
    PrintedBlock(("planform",), _PAGES, re.compile(f"^(?:{'|'.join(SURFACES)})$"), _read_surface),
    labelled_block("interference", _PAGES, (*INTERFERENCE.values(), SIDEWASH)),
    PrintedBlock(
        ("vortex",),
        _PAGES,
        re.compile(r"^ALPHA IV-B\(W\) IV-W\(H\) IV-B\(H\) GAMMA/ GAMMA/$"),
        _read_vortex,
    ),
    labelled_block("increments", _PAGES, INCREMENTS),
    PrintedBlock(
        ("increments",), _PAGES, re.compile(r"^CLB/GAMMA \(CMO/THETA\)W \(CMO/THETA\)H$"), _read_row
    ),
)
