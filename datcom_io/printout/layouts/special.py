"""Controls at hypersonic speeds (HYPEFF) and the transverse jet (TRNJET).

A hypersonic page prints one of two forms: that of the original program, which one build has
switched off, and that of the single-file edition, which prints ten fields of nine columns without a
gap whatever the number of deflections is.  Both are in feet whatever card DIM states.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from datcom_io.cells import BLANK, NOT_A_NUMBER, OK, read_cell
from datcom_io.printout.rows import Across, Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    TableLayout,
    make_table,
    make_values,
    normalise_heading,
    split_label_values,
)

HYPERSONIC_FROM = 5.0
"""Mach number from which the program computes a hypersonic flap."""
_MOST_DELTAS = 10
_INFINITE = 3.39e38  # the largest single-precision number prints as 3.40E+38: force increment zero


class _Form(NamedTuple):
    """Columns of one edition of the page: ends of the first heading value, of alpha and of the
    first cell; steps between values.
    """

    delta: tuple[int, int]
    alpha: tuple[int, int]
    cell: tuple[int, int]
    step: int


_ORIGINAL = _Form((17, 21), (1, 8), (16, 24), 10)
_SINGLE_FILE = _Form((11, 19), (1, 9), (10, 18), 9)

# kind of table, words of its heading, quantity, unit
_QUANTITIES = (
    ("hypersonic_cn", "INCREMENT IN NORMAL FORCE PER SPANWISE FOOT OF CONTROL", "dCN", "1/ft"),
    ("hypersonic_ca", "INCREMENT IN AXIAL FORCE PER SPANWISE FOOT OF CONTROL", "dCA", "1/ft"),
    (
        "hypersonic_cm_cn",
        "INCREMENT IN PITCHING MOMENT DUE TO NORMAL FORCE INCREMENT PER SPANWISE FOOT OF CONTROL",
        "dCm_CN",
        "1/ft",
    ),
    (
        "hypersonic_cm_ca",
        "INCREMENT IN PITCHING MOMENT DUE TO AXIAL FORCE INCREMENT PER SPANWISE FOOT OF CONTROL",
        "dCm_CA",
        "1/ft",
    ),
    ("hypersonic_cp_cn", "CENTER-OF-PRESSURE LOCATION OF NORMAL FORCE", "xcp_CN", "1"),
    ("hypersonic_cp_ca", "CENTER-OF-PRESSURE LOCATION OF AXIAL FORCE", "zcp_CA", "1"),
)
_HEADINGS = {heading: name for name, heading, _, _ in _QUANTITIES}


def _layout(name: str, heading: str, quantity: str, units: str, form: _Form) -> TableLayout:
    return TableLayout(
        name,
        "",
        (PrintedColumn("ALPHA", *form.alpha, "alpha", "deg"),),
        keys=1,
        rows=("FLTCON", "NALPHA"),
        across=Across(
            "DELTA",
            "delta",
            *form.delta,
            PrintedColumn(heading, *form.cell, quantity, units),
            form.step,
        ),
    )


_LAYOUTS = {
    (quantity[0], form): _layout(*quantity, form)
    for form in (_ORIGINAL, _SINGLE_FILE)
    for quantity in _QUANTITIES
}
HYPERSONIC = tuple(_LAYOUTS[quantity[0], _ORIGINAL] for quantity in _QUANTITIES)

JET_ROWS = (
    "TIME (SEC)",
    "CONTROL FORCE (LB)",
    "LOCAL MACH NO.",
    "REYNOLDS NO.",
    "LOCAL PRESSURE (LB/IN2)",
    "DYNAMIC PRESSURE (LB/IN2)",
    "BOUNDARY LAYER",
    "CONTROL-FORCE COEFF.",
    "CORRECTED FORCE COEFF.",
    "SONIC AMPLIFICATION FACTOR",
    "AMPLIFICATION FACTOR",
    "VACUUM THRUST (LB)",
    "MIN. PRESSURE RATIO",
    "MIN. JET PRESSURE (LB/IN2)",
    "JET PRESSURE (LB/IN2)",
    "MASS-FLOW RATE (LB/SEC)",
    "PROPELLANT WEIGHT (LB)",
)
_JET_LABEL = slice(2, 30)
_JET_FIRST, _JET_STEP = 31, 10


def _next_text(lines: list[Line], at: int) -> int:
    """Return the index of the next line with a text."""
    while at < len(lines) and not lines[at][1][1:].strip():
        at += 1
    return at


def _read_header(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read Mach number, Reynolds number and reference quantities, which stand on the opening line
    and the next one.
    """
    units = {"REYNOLDS NO./FT": "1/ft", "REF. AREA (FT2)": "ft2", "LONG. REF. LENGTH(FT)": "ft"}
    second = _next_text(lines, at + 1)
    used = [at, second] if second < len(lines) and "REF. AREA" in lines[second][1] else [at]
    items = [
        (lines[i][0], label, text, units.get(label, ""))
        for i in used
        for label, text in split_label_values(lines[i][1][1:])
    ]
    return [make_values("hypersonic", items)], used[-1] + 1


def _read_increments(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read one of the six tables, and what the page prints behind the last deflection."""
    name = _HEADINGS[normalise_heading(lines[at][1]).strip("-")]
    at = _next_text(lines, at + 1)
    if at == len(lines):
        return None
    number, text = lines[at]
    form = _ORIGINAL if text[1:].lstrip().startswith("DELTA =") else _SINGLE_FILE
    deltas = _read_deltas(text, form)
    if deltas is None:
        return None
    rows: list[tuple[int, str, tuple[list[float], list[int]]]] = []
    after = at + 1
    for i in range(at + 1, len(lines)):
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
    return _increments(_LAYOUTS[name, form], deltas, rows, number, text), after


def _read_deltas(text: str, form: _Form) -> np.ndarray | None:
    """Return the heading values, None when the line holds none."""
    start = text.find("=") + 1
    first, last = form.delta
    if not text[1:].lstrip().startswith("DELTA") or not 0 < start < last:
        return None
    found = []
    for k in range((len(text.rstrip()) - first) // form.step + 1):
        cell = read_cell(text[max(first - 1 + k * form.step, start) : last + k * form.step])
        if cell is None or cell[1] != OK or k == _MOST_DELTAS:
            return None
        found.append(cell[0])
    return np.array(found) if found else None


def _read_cells(text: str, form: _Form, count: int) -> tuple[list[float], list[int]] | None:
    """Return values and flags of a row, alpha first; None when the line is none.  Fields touch, so
    only their columns separate them.
    """
    first, last = form.cell
    shown = max(count, -(-(len(text.rstrip()) - first + 1) // form.step))
    if shown > _MOST_DELTAS or "_" in text:
        return None
    spans = [
        slice(form.alpha[0] - 1, form.alpha[1]),
        *(slice(first - 1 + k * form.step, last + k * form.step) for k in range(shown)),
    ]
    values: list[float] = []
    flags: list[int] = []
    for k, span in enumerate(spans):
        cell = read_cell(text[span])
        if cell is None or (k == 0 and cell[1] != OK):
            return None
        value, flag = cell
        values.append(value)
        flags.append(NOT_A_NUMBER if k and flag == OK and abs(value) >= _INFINITE else flag)
    return values, flags


def _increments(
    layout: TableLayout, deltas: np.ndarray, rows: list, number: int, text: str
) -> list[Printed]:
    """Return the table, and the fields behind its last deflection as a group of their own."""
    across, count = layout.across, len(deltas)
    assert across is not None
    cells = [
        across.cell._replace(
            first=across.cell.first + k * across.step, last=across.cell.last + k * across.step
        )
        for k in range(10)
    ]
    within = [
        (line, row, (values[: count + 1], flags[: count + 1]))
        for line, row, (values, flags) in rows
    ]
    printed: list[Printed] = [
        make_table(layout, within, (*layout.columns, *cells[:count]), deltas, number, text)
    ]
    beyond = [
        (
            line,
            values[0],
            k,
            row[cells[k].first - 1 : cells[k].last].strip(),
            values[k + 1],
            flags[k + 1],
        )
        for line, row, (values, flags) in rows
        for k in range(count, len(values) - 1)
        if flags[k + 1] != BLANK
    ]
    if beyond:
        lines, alphas, places, texts, numbers, flags = zip(*beyond)
        items = [
            (line, f"{across.cell.name} DELTA({k + 1})", shown, "")
            for line, k, shown in zip(lines, places, texts)
        ]
        given = (np.array(numbers), np.array(flags, dtype=np.uint8))
        printed.append(make_values("hypersonic_unused", items, {"alpha": np.array(alphas)}, given))
    return printed


def _read_jet(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the rows of the jet page: a label and up to ten columns of time."""
    count = -(-(len(lines[at][1].rstrip()) - _JET_FIRST + 1) // _JET_STEP)
    spans = [
        slice(_JET_FIRST - 1 + k * _JET_STEP, _JET_FIRST - 1 + (k + 1) * _JET_STEP)
        for k in range(min(count, 10))
    ]
    times = [read_cell(lines[at][1][span]) for span in spans]
    if not times or None in times:
        return None
    items, after = [], at
    while at < len(lines):
        number, text = lines[at]
        at += 1
        if not text[1:].strip():
            continue
        label = text[_JET_LABEL].strip()
        if label not in JET_ROWS:
            break
        unit = re.search(r"\((.+)\)$", label)
        items += [(number, label, text[span], unit[1] if unit else "") for span in spans]
        after = at
    if not items:
        return None
    axis = [time[0] for time in times if time is not None] * (len(items) // len(spans))
    return [make_values("jet", items, {"time": np.array(axis)})], after


LAYOUTS = HYPERSONIC
BLOCKS = (
    PrintedBlock(("hypersonic",), ("hypersonic",), re.compile(r"^MACH NUMBER ?="), _read_header),
    PrintedBlock(
        (*_HEADINGS.values(), "hypersonic_unused"),
        ("hypersonic",),
        re.compile("^-?(?:" + "|".join(map(re.escape, _HEADINGS)) + ")-?$"),
        _read_increments,
    ),
    PrintedBlock(("jet",), ("special",), re.compile(r"^TIME \(SEC\)"), _read_jet),
)
