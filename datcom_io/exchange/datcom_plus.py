"""Tables that DATCOM+ writes as CSV with the print file.

The file has small blocks, each under a line that names its axis and its column, between banners of
asterisks::

    Alpha, Cd
      -2.0, .1981E-01
       0.0, .1850E-01

    Alpha, DeltaFlap
          , 0.0, 15.0, 40.0
      -2.0, .1000E-29, .2113E-02, .6015E-02

A block with two axes is the increment of induced drag.  Numbers are those of the program, per
degree or per radian as card DERIV of the deck states, which the file does not repeat; its codes for
a missing number, 1E-30, 2E-30 and -1E-30, stand in it as numbers.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.cells import BLANK, FILLED, NA, NDM, OK, SENTINEL, read_cell
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from flightmech.errors import ParseError, UnknownName
from flightmech.support.input_files import read_bytes
from flightmech.units import DEGREE

_MARKS = {1.0e-30: NDM, 2.0e-30: NA, -1.0e-30: BLANK}
_HEADING = re.compile(r"([A-Za-z]\w*) *, *([A-Za-z]\w*) *,?")
_COLUMNS: dict[str, PrintedColumn] = {}
for _name in ("static", "downwash", "dynamic", "symflp"):
    _COLUMNS |= {column.quantity: column for column in BY_NAME[_name].columns}
_DCDI = PrintedColumn("D(CDI)", 0, 0, "dCDi")
# Leaf and quantity of a block, by the words of its heading: axis, column.
_PLACES = {
    ("Alpha", "Cd"): ("static", "CD"),
    ("Alpha", "CL"): ("static", "CL"),
    ("Alpha", "Cm"): ("static", "Cm"),
    ("Alpha", "Cyb"): ("static", "CY_beta"),
    ("Alpha", "Cnb"): ("static", "Cn_beta"),
    ("Alpha", "Clb"): ("static", "Cl_beta"),
    ("Alpha", "Q_Qinf"): ("downwash", "q_ratio"),
    ("Alpha", "Epslon"): ("downwash", "epsilon"),
    ("Alpha", "d_Epslon"): ("downwash", "epsilon_alpha"),
    ("Alpha", "CLq"): ("dynamic", "CL_qhat"),
    ("Alpha", "Cmq"): ("dynamic", "Cm_qhat"),
    ("Alpha", "CLad_Basic"): ("dynamic", "CL_alphadothat"),
    ("Alpha", "Cmad_Basic"): ("dynamic", "Cm_alphadothat"),
    ("Alpha", "Clp"): ("dynamic", "Cl_phat"),
    ("Alpha", "Cyp"): ("dynamic", "CY_phat"),
    ("Alpha", "Cnp"): ("dynamic", "Cn_phat"),
    ("Alpha", "Cnr"): ("dynamic", "Cn_rhat"),
    ("Alpha", "Clr"): ("dynamic", "Cl_rhat"),
    ("DeltaFlap", "CL"): ("flap", "dCL"),
    ("DeltaFlap", "Cm"): ("flap", "dCm"),
    ("Alpha", "DeltaFlap"): ("flap", "dCDi"),
    ("DeltaElev", "CL_Elev"): ("elevator", "dCL"),
    ("DeltaElev", "Cm_Elev"): ("elevator", "dCm"),
    ("DeltaElev", "CLa_Elev"): ("elevator", "CL_alpha_delta"),
    ("DeltaElev", "Cha_Elev"): ("elevator", "Ch_alpha"),
    ("DeltaElev", "Chd_Elev"): ("elevator", "Ch_delta"),
    ("Alpha", "DeltaElev"): ("elevator", "dCDi"),
}

Cell = tuple[float, int] | None
"""Value and flag of a cell, None for an empty one."""


@dataclass(eq=False)
class _Block:
    """A block as written: heading, line of the heading, and rows of cells with their lines."""

    axis: str
    column: str
    line: int
    rows: list[tuple[int, list[Cell]]] = field(default_factory=list)


def read_datcom_plus_csv(
    path: str | os.PathLike[str], *, deriv: Literal["DEG", "RAD"]
) -> xr.DataTree:
    """Read the CSV file of DATCOM+ for a case.

    Parameters
    ----------
    path : path
    deriv : {"DEG", "RAD"}
        Card DERIV of the deck; without the card the program works per degree.

    Returns
    -------
    DataTree
        Leaves ``static downwash dynamic`` (alpha), ``flap elevator`` (delta; ``dCDi`` over alpha
        and delta), those that the file has, in SI and radians with flags; ``other`` holds blocks of
        other names as written.  Attribute ``remarks``: all lines that are not in a block.  Lift
        slopes and hinge moments of the elevator are read as per degree, as on the print.

    Raises
    ------
    ParseError
        No block in the file, a cell that is not a number, or blocks whose angles differ.
    """
    if deriv not in ("DEG", "RAD"):
        raise UnknownName(str(deriv), ("DEG", "RAD"), "unit of the derivatives")
    file = Path(path).name
    # Any byte may stand in a remark.
    lines = read_bytes(path, "a CSV file of DATCOM+").decode("latin-1").splitlines()
    blocks, remarks = _read_blocks(file, lines)
    leaves: dict[str, LeafBuilder] = {}
    others = []
    for block in blocks:
        name, quantity = _PLACES.get((block.axis, block.column), ("", ""))
        if not name:
            others.append(block)
            continue
        leaf = leaves.setdefault(name, LeafBuilder())
        # A file holds one case, so each block comes once.
        if quantity in leaf.variables:
            raise ParseError(
                file,
                block.line,
                f"a second block {block.axis}, {block.column}",
                "one case in a file; split it",
            )
        if quantity == "dCDi":
            _add_two_way(file, leaf, block)
        else:
            _add_one_way(file, leaf, block, quantity, per_degree=deriv == "DEG")
    if "elevator" in leaves:
        leaves["elevator"].attrs["surface"] = "tail"
    datasets = {name: leaf.to_dataset() for name, leaf in leaves.items()}
    if others:
        datasets["other"] = _unnamed_blocks(others)
    root = xr.Dataset(attrs={"file": file, "deriv": deriv, "remarks": "\n".join(remarks)})
    return xr.DataTree.from_dict({"/": root, **datasets})


def _read_blocks(file: str, lines: Sequence[str]) -> tuple[list[_Block], list[str]]:
    """Return the blocks, and the lines that belong to none."""
    blocks: list[_Block] = []
    remarks = []
    is_open = False
    for number, line in enumerate(lines, 1):
        text = line.strip(" \t\x1a")
        heading = _HEADING.fullmatch(text)
        cells = text.split(",")
        if heading:
            blocks.append(_Block(heading[1], heading[2], number))
            is_open = True
        elif not text:
            # A blank line may stand below a heading.
            is_open = is_open and not blocks[-1].rows
        elif text.startswith("*"):
            is_open = False
            banner = text.strip("* ")
            if banner:
                remarks.append(f"line {number}: {banner}")
        elif is_open and len(cells) > 1:
            row = [_read_csv_cell(file, number, cell) for cell in cells]
            blocks[-1].rows.append((number, row))
        elif all(not cell.strip() or read_cell(cell) for cell in cells):
            raise ParseError(
                file,
                number,
                f"{text!r} outside a block",
                "numbers only in rows below a heading such as 'Alpha, Cd'",
            )
        else:
            is_open = False
            remarks.append(f"line {number}: {text}")
    _require_rows(file, blocks)
    return blocks, remarks


def _require_rows(file: str, blocks: list[_Block]) -> None:
    """Raise if there is no block, or one without a row."""
    if not any(block.rows for block in blocks):
        raise ParseError(
            file,
            0,
            "no block of numbers",
            "a CSV file of DATCOM+, with headings such as 'Alpha, Cd'",
        )
    for block in blocks:
        if not block.rows:
            raise ParseError(
                file,
                block.line,
                f"the heading {block.axis}, {block.column} without numbers",
                "at least one row below it",
            )


def _read_csv_cell(file: str, line: int, text: str) -> Cell:
    if not text.strip():
        return None
    cell = read_cell(text)
    if cell is None:
        raise ParseError(file, line, f"{text.strip()!r}", "a number")
    value, flag = cell
    if flag == OK:
        return value, flag
    # The codes of the program for a missing number are written as numbers.
    if flag == SENTINEL:
        flag = _MARKS.get(value, SENTINEL)
    return float("nan"), flag


def _make_matrix(
    file: str, block: _Block, rows: list[tuple[int, list[Cell]]], width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and flags (row, cell) of the first `width` cells of rows.

    All of them must have a number, and no cell after them.
    """
    values, flags = [], []
    for line, row in rows:
        cells = [cell for cell in row[:width] if cell is not None]
        has_more = any(cell is not None for cell in row[width:])
        if len(cells) < width or has_more:
            count = sum(cell is not None for cell in row)
            raise ParseError(
                file,
                line,
                f"{count} numbers in a row of the block {block.axis}, {block.column}",
                f"{width}",
            )
        values.append([value for value, _ in cells])
        flags.append([flag for _, flag in cells])
    return np.array(values), np.array(flags, np.uint8)


def _add_one_way(
    file: str, leaf: LeafBuilder, block: _Block, quantity: str, *, per_degree: bool
) -> None:
    """Add a block over alpha or deflection; `per_degree` is the unit of its slopes."""
    values, flags = _make_matrix(file, block, block.rows, 2)
    axis = "delta"
    if block.axis == "Alpha":
        axis = "alpha"
    _add_axis(file, leaf, block, axis=axis, degrees=values[:, 0])
    column = _COLUMNS[quantity]
    value, flag = values[:, 1].copy(), flags[:, 1].copy()
    # A column that is constant in alpha is filled downwards, as for the print file.
    if column.constant and len(flag) > 1 and flag[0] == OK and (flag[1:] == BLANK).all():
        value[1:], flag[1:] = value[0], FILLED
    factor = 1.0
    if column.units == "deg":
        factor = DEGREE
    elif column.units == "1/deg" or (column.units == "1/angle" and per_degree):
        factor = 1.0 / DEGREE
    leaf.add(column._replace(name=block.column), (axis,), value * factor, flag)


def _add_two_way(file: str, leaf: LeafBuilder, block: _Block) -> None:
    """Add the block of induced drag over alpha and deflection."""
    (line, head), *rows = block.rows
    # The first row holds the deflections behind an empty cell.
    filled = [i for i, cell in enumerate(head) if cell is not None]
    width = max(filled, default=0)
    if head[0] is not None:
        raise ParseError(
            file,
            line,
            "a number above the angles of attack",
            "a row of deflections with an empty first cell",
        )
    if not rows or not width:
        raise ParseError(
            file,
            line,
            f"{width} deflections and {len(rows)} rows",
            "deflections, and rows of angles of attack below them",
        )
    deltas = [cell[0] for cell in head[1 : width + 1] if cell is not None]
    values, flags = _make_matrix(file, block, rows, width + 1)
    _add_axis(file, leaf, block, axis="alpha", degrees=values[:, 0])
    _add_axis(file, leaf, block, axis="delta", degrees=np.array(deltas))
    leaf.add(_DCDI, ("alpha", "delta"), values[:, 1:], flags[:, 1:])


def _add_axis(
    file: str, leaf: LeafBuilder, block: _Block, *, axis: str, degrees: np.ndarray
) -> None:
    """Add an axis to a leaf; all blocks of the leaf must agree with it."""
    if axis in leaf.coords and not np.array_equal(leaf[axis].values, degrees * DEGREE):
        raise ParseError(
            file,
            block.line,
            f"other angles of {axis} in {block.axis}, {block.column}",
            "those of the blocks before",
        )
    leaf.coords[axis] = xr.Variable(axis, degrees * DEGREE, {"units": "rad"})


def _unnamed_blocks(blocks: list[_Block]) -> xr.Dataset:
    """Return blocks of other names as arrays (row, cell), in the units of the file."""
    dataset = xr.Dataset()
    for block in blocks:
        # Rows of such a block may differ in length.
        width = max(len(row) for _, row in block.rows)
        value = np.full((len(block.rows), width), np.nan)
        for i, (_, row) in enumerate(block.rows):
            for k, cell in enumerate(row):
                if cell is not None:
                    value[i, k] = cell[0]
        dims = (f"row_{block.line}", f"cell_{block.line}")
        attrs = {"heading": f"{block.axis}, {block.column}", "line": block.line}
        dataset[f"{block.axis}_{block.column}_{block.line}"] = (dims, value, attrs)
    return dataset
