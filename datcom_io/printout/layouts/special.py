"""Controls at hypersonic speeds (HYPEFF) and the transverse jet (TRNJET).

A hypersonic page has one of two forms.  The original program has the first one, which one build
switches off.  The single-file edition prints ten fields of nine columns without a gap, whatever the
number of deflections is.  Both are in feet whatever card DIM states.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from datcom_io.cells import BLANK, NOT_A_NUMBER, OK, read_cell
from datcom_io.printout.rows import Cells, HeadingAxis, Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    PrintedValues,
    TableLayout,
    make_table,
    make_values,
    next_text_line,
    normalise_heading,
    split_label_values,
    value_columns,
)

HYPERSONIC_FROM = 5.0
"""Mach number from which the program computes a hypersonic flap."""
_MOST_DELTAS = 10
# The largest single-precision number prints as 3.40E+38: the force increment is zero.
_INFINITE = 3.39e38


class _Form(NamedTuple):
    """Columns of one edition of the hypersonic page.

    ``delta``, ``alpha`` and ``cell`` bound the first heading value, alpha and the first value;
    ``step`` is the distance between values.
    """

    delta: tuple[int, int]
    alpha: tuple[int, int]
    cell: tuple[int, int]
    step: int


_ORIGINAL = _Form(delta=(17, 21), alpha=(1, 8), cell=(16, 24), step=10)
_SINGLE_FILE = _Form(delta=(11, 19), alpha=(1, 9), cell=(10, 18), step=9)


class _Increment(NamedTuple):
    """One of the six tables of a hypersonic page."""

    name: str
    heading: str
    quantity: str
    units: str
    meaning: str


# Page AERODYNAMIC CONTROL EFFECTIVENESS AT HYPERSONIC SPEEDS.  Values are per foot of span.
_INCREMENTS = (
    _Increment(
        "hypersonic_cn",
        "INCREMENT IN NORMAL FORCE PER SPANWISE FOOT OF CONTROL",
        "dCN",
        "1/ft",
        "increment of the normal-force coefficient per span of the control",
    ),
    _Increment(
        "hypersonic_ca",
        "INCREMENT IN AXIAL FORCE PER SPANWISE FOOT OF CONTROL",
        "dCA",
        "1/ft",
        "increment of the axial-force coefficient per span of the control",
    ),
    _Increment(
        "hypersonic_cm_cn",
        "INCREMENT IN PITCHING MOMENT DUE TO NORMAL FORCE INCREMENT PER SPANWISE FOOT OF CONTROL",
        "dCm_CN",
        "1/ft",
        "pitching moment of the normal-force increment about the hinge line, per span of the "
        "control",
    ),
    _Increment(
        "hypersonic_cm_ca",
        "INCREMENT IN PITCHING MOMENT DUE TO AXIAL FORCE INCREMENT PER SPANWISE FOOT OF CONTROL",
        "dCm_CA",
        "1/ft",
        "pitching moment of the axial-force increment about the hinge line, per span of the "
        "control",
    ),
    _Increment(
        "hypersonic_cp_cn",
        "CENTER-OF-PRESSURE LOCATION OF NORMAL FORCE",
        "xcp_CN",
        "1",
        "centre of pressure of the normal-force increment forward of the hinge line, in chords",
    ),
    _Increment(
        "hypersonic_cp_ca",
        "CENTER-OF-PRESSURE LOCATION OF AXIAL FORCE",
        "zcp_CA",
        "1",
        "centre of pressure of the axial-force increment below the hinge line, in chords",
    ),
)
_NAME_BY_HEADING = {table.heading: table.name for table in _INCREMENTS}


def _increment_layout(table: _Increment, form: _Form) -> TableLayout:
    """Return the layout of a table in one edition of the page."""
    cell = PrintedColumn(
        table.heading, *form.cell, table.quantity, table.units, meaning=table.meaning
    )
    return TableLayout(
        table.name,
        "",
        (PrintedColumn("ALPHA", *form.alpha, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=HeadingAxis(
            "DELTA",
            "delta",
            *form.delta,
            cell=cell,
            step=form.step,
            counted=("HYPEFF", "HNDLTA"),
        ),
    )


HYPERSONIC = tuple(_increment_layout(table, _ORIGINAL) for table in _INCREMENTS)
_SINGLE_FILE_TABLES = tuple(_increment_layout(table, _SINGLE_FILE) for table in _INCREMENTS)
_LAYOUTS = {
    _ORIGINAL: {layout.name: layout for layout in HYPERSONIC},
    _SINGLE_FILE: {layout.name: layout for layout in _SINGLE_FILE_TABLES},
}


class JetRow(NamedTuple):
    """One row of the transverse-jet page: its label, and the variable it becomes.

    The unit ``pressure`` depends on the cards, see `datcom_io.arrays.families.special`.
    """

    label: str
    quantity: str
    units: str = "1"
    meaning: str = ""


# Page TRANSVERSE-JET CONTROL EFFECTIVENESS: 17 rows with up to ten columns, one for each time.
JET_TIME = JetRow("TIME (SEC)", "time", "s")
JET_LAYER = JetRow("BOUNDARY LAYER", "boundary_layer", "text")
JET_NUMBERS = (
    JetRow("CONTROL FORCE (LB)", "F_control", "lbf", "control force wanted"),
    JetRow(
        "LOCAL MACH NO.", "mach_local", meaning="Mach number of the surface flow ahead of the jet"
    ),
    JetRow(
        "REYNOLDS NO.",
        "reynolds_local",
        meaning="Reynolds number of the surface flow on the length of the plate ahead of the jet",
    ),
    JetRow(
        "LOCAL PRESSURE (LB/IN2)",
        "p_local",
        "pressure",
        "pressure of the surface flow ahead of the jet",
    ),
    JetRow(
        "DYNAMIC PRESSURE (LB/IN2)",
        "qbar_local",
        "pressure",
        "dynamic pressure of the surface flow ahead of the jet",
    ),
    JetRow("CONTROL-FORCE COEFF.", "C_control", meaning="coefficient of the control force"),
    JetRow(
        "CORRECTED FORCE COEFF.",
        "C_control_corrected",
        meaning="coefficient of the control force, corrected for the gas of the jet",
    ),
    JetRow(
        "SONIC AMPLIFICATION FACTOR",
        "amplification_sonic",
        meaning="control force over vacuum thrust, sonic nozzle",
    ),
    JetRow("AMPLIFICATION FACTOR", "amplification", meaning="control force over vacuum thrust"),
    JetRow("VACUUM THRUST (LB)", "F_vacuum", "lbf", "vacuum thrust of the jet"),
    JetRow(
        "MIN. PRESSURE RATIO",
        "p_jet_ratio_min",
        meaning="smallest ratio of jet stagnation pressure to local pressure",
    ),
    JetRow(
        "MIN. JET PRESSURE (LB/IN2)",
        "p_jet_min",
        "pressure",
        "smallest stagnation pressure of the jet",
    ),
    JetRow("JET PRESSURE (LB/IN2)", "p_jet", "pressure", "stagnation pressure of the jet"),
    JetRow("MASS-FLOW RATE (LB/SEC)", "mass_flow", "lb/s", "mass flow of the jet"),
    JetRow(
        "PROPELLANT WEIGHT (LB)", "propellant_mass", "lb", "propellant used since the first time"
    ),
)
JET_ROWS = (JET_TIME, JET_LAYER, *JET_NUMBERS)

_JET_LABELS = {row.label for row in JET_ROWS}
_JET_LABEL = slice(2, 30)
_JET_FIRST, _JET_STEP = 31, 10
_MOST_TIMES = 10
_UNIT_IN_LABEL = re.compile(r"\((.+)\)$")

# Units that labels of the heading of a hypersonic page state.
_HEADER_UNITS = {"REYNOLDS NO./FT": "1/ft", "REF. AREA (FT2)": "ft2", "LONG. REF. LENGTH(FT)": "ft"}


def _read_header(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read Mach number, Reynolds number and reference quantities of a hypersonic page.

    They stand on the opening line and the next one.
    """
    header = [opening]
    second = next_text_line(lines, opening + 1)
    if second < len(lines) and "REF. AREA" in lines[second][1]:
        header.append(second)
    items = []
    for index in header:
        number, line = lines[index]
        for label, text in split_label_values(line[1:]):
            items.append((number, label, text, _HEADER_UNITS.get(label, "")))
    return [make_values("hypersonic", items)], header[-1] + 1


def _read_increments(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read one of the six tables, and the fields behind its last deflection."""
    name = _NAME_BY_HEADING[normalise_heading(lines[opening][1]).strip("-")]
    heading = next_text_line(lines, opening + 1)
    if heading == len(lines):
        return None
    number, text = lines[heading]
    form = _SINGLE_FILE
    if text[1:].lstrip().startswith("DELTA ="):
        form = _ORIGINAL
    deltas = _read_deltas(text, form)
    if deltas is None:
        return None
    rows: list[tuple[int, str, Cells]] = []
    after = heading + 1
    # The line ALPHA may stand above the first row, in small letters too.
    for i in range(heading + 1, len(lines)):
        line, row = lines[i]
        if not row[1:].strip() or (not rows and row[1:].strip().upper() == "ALPHA"):
            continue
        cells = _read_cells(row, form, len(deltas))
        if cells is None:
            break
        rows.append((line, row, cells))
        after = i + 1
    if not rows:
        return None
    layout = _LAYOUTS[form][name]
    count = len(deltas)
    assert layout.across is not None
    columns = (*layout.columns, *value_columns(layout.across, count))
    within = []
    for line, row, (values, flags) in rows:
        within.append((line, row, (values[: count + 1], flags[: count + 1])))
    printed: list[Printed] = [
        make_table(layout, within, columns, across=deltas, across_line=number, across_row=text)
    ]
    unused = _unused_fields(layout.across, rows, count)
    if unused:
        printed.append(unused)
    return printed, after


def _read_deltas(text: str, form: _Form) -> np.ndarray | None:
    """Return the heading values, None when the line does not hold any."""
    start = text.find("=") + 1
    first, last = form.delta
    if not text[1:].lstrip().startswith("DELTA") or not 0 < start < last:
        return None
    deltas = []
    for k in range((len(text.rstrip()) - first) // form.step + 1):
        shift = k * form.step
        cell = read_cell(text[max(first - 1 + shift, start) : last + shift])
        if cell is None or cell[1] != OK or k == _MOST_DELTAS:
            return None
        deltas.append(cell[0])
    if not deltas:
        return None
    return np.array(deltas)


def _read_cells(text: str, form: _Form, count: int) -> Cells | None:
    """Return values and flags of a row, alpha first; None when the line is not a row.

    Fields touch, so only their columns separate them.
    """
    first, last = form.cell
    # Number of fields up to the end of the line, rounded up.
    fields = -(-(len(text.rstrip()) - first + 1) // form.step)
    fields = max(count, fields)
    if fields > _MOST_DELTAS or "_" in text:
        return None
    alpha = read_cell(text[form.alpha[0] - 1 : form.alpha[1]])
    if alpha is None or alpha[1] != OK:
        return None
    values, flags = [alpha[0]], [alpha[1]]
    for k in range(fields):
        shift = k * form.step
        cell = read_cell(text[first - 1 + shift : last + shift])
        if cell is None:
            return None
        value, flag = cell
        if flag == OK and abs(value) >= _INFINITE:
            flag = NOT_A_NUMBER
        values.append(value)
        flags.append(flag)
    return values, flags


def _unused_fields(
    across: HeadingAxis, rows: list[tuple[int, str, Cells]], count: int
) -> PrintedValues | None:
    """Return the fields behind the last deflection as a group of their own, None without any."""
    # The single-file edition prints all ten fields.
    columns = value_columns(across, _MOST_DELTAS)
    items, numbers, codes, alphas = [], [], [], []
    for line, row, (values, flags) in rows:
        for k in range(count, len(values) - 1):
            if flags[k + 1] == BLANK:
                continue
            text = row[columns[k].first - 1 : columns[k].last].strip()
            items.append((line, f"{across.cell.name} DELTA({k + 1})", text, ""))
            numbers.append(values[k + 1])
            codes.append(flags[k + 1])
            alphas.append(values[0])
    if not items:
        return None
    cells = (np.array(numbers), np.array(codes, dtype=np.uint8))
    return make_values("hypersonic_unused", items, {"alpha": np.array(alphas)}, given=cells)


def _read_jet(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the rows of the transverse-jet page: a label and up to ten columns of time."""
    # Number of columns up to the end of the line, rounded up.
    count = -(-(len(lines[opening][1].rstrip()) - _JET_FIRST + 1) // _JET_STEP)
    spans = []
    for k in range(min(count, _MOST_TIMES)):
        start = _JET_FIRST - 1 + k * _JET_STEP
        spans.append(slice(start, start + _JET_STEP))
    times = []
    for span in spans:
        cell = read_cell(lines[opening][1][span])
        if cell is None:
            return None
        times.append(cell[0])
    # Each row has a label and one field for each time.
    items, after = [], opening
    for index in range(opening, len(lines)):
        number, text = lines[index]
        if not text[1:].strip():
            continue
        label = text[_JET_LABEL].strip()
        if label not in _JET_LABELS:
            break
        unit = _UNIT_IN_LABEL.search(label)
        for span in spans:
            items.append((number, label, text[span], unit[1] if unit else ""))
        after = index + 1
    if not items:
        return None
    axis = times * (len(items) // len(spans))
    return [make_values("jet", items, {"time": np.array(axis)})], after


LAYOUTS = HYPERSONIC
BLOCKS = (
    PrintedBlock(("hypersonic",), ("hypersonic",), re.compile(r"^MACH NUMBER ?="), _read_header),
    PrintedBlock(
        (*_NAME_BY_HEADING.values(), "hypersonic_unused"),
        ("hypersonic",),
        re.compile("^-?(?:" + "|".join(map(re.escape, _NAME_BY_HEADING)) + ")-?$"),
        _read_increments,
    ),
    PrintedBlock(("jet",), ("special",), re.compile(r"^TIME \(SEC\)"), _read_jet),
)
