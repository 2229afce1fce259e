"""Tables that DATCOM+ writes as CSV with the print file.

The file is a row of small blocks, each under a line that names its axis and its column, between banners of asterisks::

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
_COLUMNS = {
    column.quantity: column
    for name in ("static", "downwash", "dynamic", "symflp")
    for column in BY_NAME[name].columns
}
_DCDI = PrintedColumn("D(CDI)", 0, 0, "dCDi")
# axis and column of the file: leaf, quantity
_ALPHA = {
    "static": {
        "Cd": "CD",
        "CL": "CL",
        "Cm": "Cm",
        "Cyb": "CY_beta",
        "Cnb": "Cn_beta",
        "Clb": "Cl_beta",
    },
    "downwash": {"Q_Qinf": "q_ratio", "Epslon": "epsilon", "d_Epslon": "epsilon_alpha"},
    "dynamic": {
        "CLq": "CL_qhat",
        "Cmq": "Cm_qhat",
        "CLad_Basic": "CL_alphadothat",
        "Cmad_Basic": "Cm_alphadothat",
    }
    | {"Clp": "Cl_phat", "Cyp": "CY_phat", "Cnp": "Cn_phat", "Cnr": "Cn_rhat", "Clr": "Cl_rhat"},
}
_DEVICES = {
    "DeltaFlap": ("flap", {"CL": "dCL", "Cm": "dCm"}),
    "DeltaElev": (
        "elevator",
        {
            "CL_Elev": "dCL",
            "Cm_Elev": "dCm",
            "CLa_Elev": "CL_alpha_delta",
            "Cha_Elev": "Ch_alpha",
            "Chd_Elev": "Ch_delta",
        },
    ),
}
_PLACES = {
    ("Alpha", word): (leaf, quantity)
    for leaf, words in _ALPHA.items()
    for word, quantity in words.items()
}
_PLACES |= {
    (axis, word): (leaf, quantity)
    for axis, (leaf, words) in _DEVICES.items()
    for word, quantity in words.items()
}
_PLACES |= {("Alpha", axis): (leaf, "dCDi") for axis, (leaf, _) in _DEVICES.items()}


@dataclass(eq=False)
class _Block:
    """A block as it stands: heading, line of the heading, rows of value and flag per cell, None for
    an empty cell.
    """

    axis: str
    column: str
    line: int
    rows: list[tuple[int, list[tuple[float, int] | None]]] = field(default_factory=list)


def read_datcom_plus_csv(
    path: str | os.PathLike[str], *, deriv: Literal["DEG", "RAD"]
) -> xr.DataTree:
    """Read the CSV file that DATCOM+ writes for a case.

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
        other names as they stand.  Attribute ``remarks``: all lines that are no block.  Lift slopes
        and hinge moments of the elevator are taken as per degree, as on the print.

    Raises
    ------
    ParseError
        No block in the file, a cell that is no number, or blocks whose angles differ.
    """
    if deriv not in ("DEG", "RAD"):
        raise UnknownName(str(deriv), ("DEG", "RAD"), "unit of the derivatives")
    file = Path(path).name
    blocks, remarks = _blocks(
        file, read_bytes(path, "a CSV file of DATCOM+").decode("latin-1").splitlines()
    )
    leaves: dict[str, LeafBuilder] = {}
    other = []
    for block in blocks:
        leaf, quantity = _PLACES.get((block.axis, block.column), ("", ""))
        if not leaf:
            other.append(block)
            continue
        found = leaves.setdefault(leaf, LeafBuilder())
        if quantity in found.variables:
            raise ParseError(
                file,
                block.line,
                f"a second block {block.axis}, {block.column}",
                "one case in a file; split it",
            )
        add = _two_way if quantity == "dCDi" else _one_way
        add(file, found, block, quantity, deriv)
    if "elevator" in leaves:
        leaves["elevator"].attrs["surface"] = "tail"
    made = {name: leaf.to_dataset() for name, leaf in leaves.items()}
    if other:
        made["other"] = _others(other)
    root = xr.Dataset(attrs={"file": file, "deriv": deriv, "remarks": "\n".join(remarks)})
    return xr.DataTree.from_dict({"/": root, **made})


def _blocks(file: str, lines: Sequence[str]) -> tuple[list[_Block], list[str]]:
    """Return the blocks, and the lines that belong to none."""
    blocks: list[_Block] = []
    remarks = []
    opened = False
    for number, line in enumerate(lines, 1):
        text = line.strip(" \t\x1a")
        if heading := _HEADING.fullmatch(text):
            blocks.append(_Block(heading[1], heading[2], number))
            opened = True
        elif not text or text.startswith("*"):
            opened = (
                opened and not text and not blocks[-1].rows
            )  # a blank line may stand below a heading
            remarks += [f"line {number}: {text.strip('* ')}"] if text.strip("* ") else []
        elif opened and "," in text:
            blocks[-1].rows.append(
                (number, [_cell(file, number, cell) for cell in text.split(",")])
            )
        elif all(not cell.strip() or read_cell(cell) for cell in text.split(",")):
            raise ParseError(
                file,
                number,
                f"{text!r} outside a block",
                "numbers only in rows below a heading such as 'Alpha, Cd'",
            )
        else:
            opened = False
            remarks.append(f"line {number}: {text}")
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
    return blocks, remarks


def _cell(file: str, line: int, text: str) -> tuple[float, int] | None:
    if not text.strip():
        return None
    found = read_cell(text)
    if found is None:
        raise ParseError(file, line, f"{text.strip()!r}", "a number")
    value, flag = found
    return (value if flag == OK else float("nan")), _MARKS.get(
        value, SENTINEL
    ) if flag == SENTINEL else flag


def _matrix(
    file: str, block: _Block, rows: list[tuple[int, list[tuple[float, int] | None]]], width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and flags (row, cell) of rows with a number in each of the first `width` cells
    and nothing after them.
    """
    for line, row in rows:
        if len(row) < width or None in row[:width] or any(cell is not None for cell in row[width:]):
            count = sum(cell is not None for cell in row)
            raise ParseError(
                file,
                line,
                f"{count} numbers in a row of the block {block.axis}, {block.column}",
                f"{width}",
            )
    cells = [[cell for cell in row[:width] if cell is not None] for _, row in rows]
    return np.array([[value for value, _ in row] for row in cells]), np.array(
        [[flag for _, flag in row] for row in cells], np.uint8
    )


def _one_way(file: str, found: LeafBuilder, block: _Block, quantity: str, deriv: str) -> None:
    values, flags = _matrix(file, block, block.rows, 2)
    axis = "alpha" if block.axis == "Alpha" else "delta"
    _add_axis(file, found, block, axis, values[:, 0])
    column, value, flag = _COLUMNS[quantity], values[:, 1].copy(), flags[:, 1].copy()
    if column.constant and len(flag) > 1 and flag[0] == OK and (flag[1:] == BLANK).all():
        value[1:], flag[1:] = value[0], FILLED
    per_degree = column.units == "1/deg" or (column.units == "1/angle" and deriv == "DEG")
    factor = DEGREE if column.units == "deg" else 1.0 / DEGREE if per_degree else 1.0
    found.add(column._replace(name=block.column), (axis,), value * factor, flag)


def _two_way(file: str, found: LeafBuilder, block: _Block, quantity: str, deriv: str) -> None:
    (line, head), *rows = block.rows
    width = max((i for i, cell in enumerate(head) if cell is not None), default=0)
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
    values, flags = _matrix(file, block, rows, width + 1)
    _add_axis(file, found, block, "alpha", values[:, 0])
    _add_axis(file, found, block, "delta", np.array(deltas))
    found.add(_DCDI, ("alpha", "delta"), values[:, 1:], flags[:, 1:])


def _add_axis(file: str, found: LeafBuilder, block: _Block, axis: str, degrees: np.ndarray) -> None:
    if axis in found.coords and not np.array_equal(found[axis].values, degrees * DEGREE):
        raise ParseError(
            file,
            block.line,
            f"other angles of {axis} in {block.axis}, {block.column}",
            "those of the blocks before",
        )
    found.coords[axis] = xr.Variable(axis, degrees * DEGREE, {"units": "rad"})


def _others(blocks: list[_Block]) -> xr.Dataset:
    """Return blocks that have no place as arrays (row, cell) named by their headings, in the units
    of the file.
    """
    found = xr.Dataset()
    for block in blocks:
        width = max(len(row) for _, row in block.rows)
        value = np.full((len(block.rows), width), np.nan)
        for i, (_, row) in enumerate(block.rows):
            value[i, : len(row)] = [np.nan if cell is None else cell[0] for cell in row]
        name = f"{block.axis}_{block.column}_{block.line}"
        found[name] = (
            (f"row_{block.line}", f"cell_{block.line}"),
            value,
            {"heading": f"{block.axis}, {block.column}", "line": block.line},
        )
    return found
