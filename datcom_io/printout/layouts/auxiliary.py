"""Pages CONFIGURATION AUXILIARY AND PARTIAL OUTPUT (card PART).

They print properties of body and surfaces, interference factors, vortices, and increments of
dynamic derivatives.  Whatever card DERIV states, lift slopes are per degree, and derivatives with
respect to a rate are per radian.
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
    next_text_line,
    normalise_heading,
    read_printed_table,
)

_PAGES = ("auxiliary",)

# Table BASIC BODY PROPERTIES: one row.
BODY = TableLayout(
    "body",
    "WETTED AREA XCG ZCG BASE AREA ZERO LIFT DRAG BASE DRAG FRICTION DRAG PRESSURE DRAG",
    (
        PrintedColumn(
            "WETTED AREA", 12, 24, "area_wetted", "area", meaning="wetted area of the body"
        ),
        PrintedColumn(
            "XCG",
            26,
            33,
            "x_moment_centre",
            "length",
            meaning="moment centre aft of the drawing datum",
        ),
        PrintedColumn(
            "ZCG",
            35,
            42,
            "z_moment_centre",
            "length",
            meaning="moment centre above the drawing datum",
        ),
        PrintedColumn("BASE AREA", 44, 58, "area_base", "area", meaning="base area of the body"),
        PrintedColumn(
            "ZERO LIFT DRAG",
            60,
            72,
            "CD0",
            meaning="zero-lift drag coefficient of the body, on the reference area",
        ),
        PrintedColumn("BASE DRAG", 74, 86, "CD_base", meaning="base drag coefficient of the body"),
        PrintedColumn(
            "FRICTION DRAG", 88, 102, "CD_friction", meaning="friction drag coefficient of the body"
        ),
        PrintedColumn(
            "PRESSURE DRAG",
            104,
            117,
            "CD_pressure",
            meaning="pressure drag coefficient of the body",
        ),
    ),
    keys=0,
)

# One line below the body.
MAC = Labelled(
    "XCG RELATIVE TO THEORETICAL LEADING EDGE MAC=",
    (
        PrintedColumn(
            "XCG RELATIVE TO THEORETICAL LEADING EDGE MAC",
            87,
            93,
            "x_behind_mac",
            "length",
            meaning="moment centre aft of the leading edge of the theoretical mean chord, of the "
            "wing where there is one",
        ),
    ),
)

# Table BASIC PLANFORM PROPERTIES: per surface a title, then two lines per panel.  The first one
# names the panel (THEORITICAL is the program's spelling), the second one overprints its numbers.
SURFACES = ("WING", "HORIZONTAL TAIL", "VERTICAL TAIL", "VENTRAL FIN")
PANELS = (
    "THEORITICAL INBOARD",
    "EXPOSED INBOARD",
    "OUTBOARD",
    "TOTAL THEORITICAL",
    "TOTAL EXPOSED",
)
_LABEL_END = 20  # last column of the name of a panel
PLANFORM = (
    PrintedColumn("AREA", 21, 33, "area", "area", meaning="area of the panels of both sides"),
    PrintedColumn("TAPER RATIO", 34, 43, "taper_ratio", meaning="tip chord over root chord"),
    PrintedColumn(
        "ASPECT RATIO",
        44,
        57,
        "aspect_ratio",
        meaning="aspect ratio; of the theoretical inboard panel right with DIM FT only",
    ),
    PrintedColumn(
        "QUARTER CHORD SWEEP", 58, 67, "sweep_c4", "deg", meaning="sweep of the quarter-chord line"
    ),
    PrintedColumn("MAC", 68, 80, "mac", "length", meaning="mean chord"),
    PrintedColumn(
        "QUARTER CHORD X(MAC)",
        81,
        93,
        "x_c4_mac",
        "length",
        meaning="quarter chord of the mean chord aft of the drawing datum",
    ),
    PrintedColumn(
        "Y(MAC)",
        94,
        106,
        "y_mac",
        "length",
        meaning="mean chord outboard of the root of the theoretical surface",
    ),
    PrintedColumn(
        "ZERO LIFT DRAG",
        107,
        119,
        "CD0",
        meaning="zero-lift drag coefficient, on the reference area",
    ),
    PrintedColumn("FRICTION COEFFICIENT", 120, 132, "Cf", meaning="skin-friction coefficient"),
)


def _interference(letter: str) -> Labelled:
    """Return the line of the surface with a letter, W or H, and the body."""
    return Labelled(
        f"CLA-B({letter})= CLA-{letter}(B)= K-B({letter})= K-{letter}(B)= XAC/C-B({letter})=",
        (
            PrintedColumn(
                f"CLA-B({letter})",
                21,
                30,
                "CL_alpha_body",
                "1/deg",
                meaning="lift-curve slope carried over to the body by the surface, on the "
                "reference area",
            ),
            PrintedColumn(
                f"CLA-{letter}(B)",
                45,
                54,
                "CL_alpha_surface",
                "1/deg",
                meaning="lift-curve slope of the surface in the presence of the body, on the "
                "reference area",
            ),
            PrintedColumn(
                f"K-B({letter})",
                67,
                76,
                "K_body",
                meaning="lift carried over to the body over that of the exposed surface alone",
            ),
            PrintedColumn(
                f"K-{letter}(B)",
                89,
                98,
                "K_surface",
                meaning="lift of the surface in the presence of the body over that of the exposed "
                "surface alone",
            ),
            PrintedColumn(
                f"XAC/C-B({letter})",
                115,
                124,
                "xac_body",
                meaning="aerodynamic centre of the lift carried over to the body, in chords as "
                "printed",
            ),
        ),
    )


INTERFERENCE = {"WING": _interference("W"), "HORIZONTAL TAIL": _interference("H")}
SIDEWASH = Labelled(
    "SIDEWASH, (1 + D(SIGMA)/D(BETA))QV/Q =",
    (
        PrintedColumn(
            "SIDEWASH, (1 + D(SIGMA)/D(BETA))QV/Q",
            78,
            91,
            "sidewash",
            meaning="(1 + d sigma/d beta) q_v/q at the vertical tail",
        ),
    ),
)

# Vortex table; its heading takes two lines.
VORTEX = TableLayout(
    "vortex",
    "",
    (
        PrintedColumn("ALPHA", 14, 24, "alpha", "deg"),
        PrintedColumn(
            "IV-B(W)",
            27,
            41,
            "i_body_wing",
            meaning="interference factor of the body vortices on the wing",
        ),
        PrintedColumn(
            "IV-W(H)",
            44,
            58,
            "i_wing_tail",
            meaning="interference factor of the wing vortices on the horizontal tail",
        ),
        PrintedColumn(
            "IV-B(H)",
            61,
            75,
            "i_body_tail",
            meaning="interference factor of the body vortices on the horizontal tail",
        ),
        PrintedColumn(
            "GAMMA/2*PI*ALPHA*V*R",
            78,
            93,
            "gamma",
            meaning="strength of a body vortex at the wing over 2 pi alpha V r",
        ),
        PrintedColumn(
            "GAMMA/(2*PI*ALPHA*V*R)T",
            103,
            118,
            "gamma_tail",
            meaning="strength of a body vortex at the horizontal tail over 2 pi alpha V r",
        ),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)

# Title DYNAMIC DERIVATIVE INCREMENTALS: two lines of label = value, then a heading with one row.
INCREMENTS = (
    Labelled(
        "CLP(GAMMA=CL=0) = CLP(GAMMA)/CLP (GAMMA=0) = CNP/THETA =",
        (
            PrintedColumn(
                "CLP(GAMMA=CL=0)",
                28,
                38,
                "Cl_phat",
                meaning="roll damping of the wing without dihedral and lift, on theoretical wing "
                "area and span",
            ),
            PrintedColumn(
                "CLP(GAMMA)/CLP (GAMMA=0)",
                70,
                80,
                "Cl_phat_ratio_dihedral",
                meaning="roll damping with dihedral over that without",
            ),
            PrintedColumn(
                "CNP/THETA",
                98,
                108,
                "Cn_phat_twist",
                "1/deg",
                meaning="yawing moment from roll rate per twist of the wing",
            ),
        ),
    ),
    Labelled(
        "CYP/GAMMA = CYP/CL (CL=0) =",
        (
            PrintedColumn(
                "CYP/GAMMA",
                42,
                52,
                "dCY_phat_dihedral",
                meaning="side force from roll rate due to the dihedral of the wing; the label "
                "CYP/GAMMA pretends a division",
            ),
            PrintedColumn(
                "CYP/CL (CL=0)",
                88,
                98,
                "CY_phat_CL",
                meaning="side force from roll rate per lift coefficient, at zero lift",
            ),
        ),
    ),
)
DIHEDRAL_AND_TWIST = (
    PrintedColumn(
        "CLB/GAMMA",
        44,
        59,
        "Cl_beta_dihedral",
        "1/deg2",
        meaning="rolling moment from sideslip per dihedral of the wing",
    ),
    PrintedColumn(
        "(CMO/THETA)W",
        62,
        77,
        "Cm0_twist_wing",
        "1/deg",
        meaning="pitching moment at zero lift per twist of the wing",
    ),
    PrintedColumn(
        "(CMO/THETA)H",
        80,
        95,
        "Cm0_twist_tail",
        "1/deg",
        meaning="pitching moment at zero lift per twist of the horizontal tail",
    ),
)

# Title CANARD EFFECTIVE DOWNWASH.  The misspelling EPSOLN is the program's.
CANARD = TableLayout(
    "canard_downwash",
    "ALPHA (EPSOLN)EFF. D(EPSOLN)/D(ALPHA) EFF.",
    (
        PrintedColumn("ALPHA", 44, 54, "alpha", "deg"),
        PrintedColumn(
            "(EPSOLN)EFF.",
            58,
            73,
            "epsilon_effective",
            "deg",
            meaning="effective downwash angle of a canard at the wing",
        ),
        PrintedColumn(
            "D(EPSOLN)/D(ALPHA) EFF.",
            76,
            90,
            "epsilon_alpha_effective",
            meaning="slope of the effective downwash angle with alpha",
        ),
    ),
    keys=1,
    rows=("FLTCON", "NALPHA"),
)


def _read_surface(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the panels of a surface: the name of a panel, then its overprinted numbers."""
    surface = normalise_heading(lines[opening][1])
    items: list[Item] = []
    after = opening + 1
    for k in range(opening + 1, len(lines)):
        name = lines[k][1][1:_LABEL_END].strip()
        if not name:
            continue
        if name not in PANELS:
            break
        # A printer filter may have put name and numbers into one line.
        numbers_line = k + 1
        if lines[k][1][_LABEL_END:].strip():
            numbers_line = k
        if numbers_line == len(lines):
            break
        numbers = _read_panel(f"{surface} {name}", lines[numbers_line])
        if not numbers:
            break
        items += numbers
        after = numbers_line + 1
    if not items:
        return None
    return [make_values("planform", items)], after


def _read_panel(subject: str, line: Line) -> list[Item]:
    number, text = line
    row = " " * _LABEL_END + text[_LABEL_END:]
    if not cached_column_windows(PLANFORM, 0).hold(row):
        return []
    return _row_items(PLANFORM, (number, row), f"{subject} ")


def _row_items(columns: tuple[PrintedColumn, ...], line: Line, subject: str = "") -> list[Item]:
    """Return the cells of a row as labelled numbers; `subject` is put before the labels."""
    number, row = line
    items = []
    for column in columns:
        items.append((number, f"{subject}{column.name}", row[column.first - 1 : column.last], ""))
    return items


def _read_vortex(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the vortex table; its heading goes on in a second line."""
    second = next_text_line(lines, opening + 1)
    heading = "2*PI*ALPHA*V*R (2*PI*ALPHA*V*R)T"
    if second == len(lines) or normalise_heading(lines[second][1]) != heading:
        return None
    table, after = read_printed_table(VORTEX, lines, second + 1)
    if table is None:
        return None
    return [table], after


def _read_dihedral_and_twist(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the one row below the heading of the derivatives per dihedral and twist."""
    below = next_text_line(lines, opening + 1)
    if below == len(lines):
        return None
    if not cached_column_windows(DIHEDRAL_AND_TWIST, 0).hold(lines[below][1]):
        return None
    items = _row_items(DIHEDRAL_AND_TWIST, lines[below])
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
        ("increments",),
        _PAGES,
        re.compile(r"^CLB/GAMMA \(CMO/THETA\)W \(CMO/THETA\)H$"),
        _read_dihedral_and_twist,
    ),
)
