"""The small plot file of some builds (unit 14), in the manner of Missile DATCOM.

It has one short table per configuration and condition.

::

    RUN   1  4  M BODY-WING-HT-VT-VF
       0.30000  2120470.
     260.48663   6.63386  43.83202  20.66929   0.00000   2.50000
      -2.00000  -0.04119   0.09574   0.01502  -0.01367 ...
    R

The second line has Mach number and Reynolds number per foot.  The third one has area, chord, span,
moment centre and two unidentified numbers, in feet.  A row has alpha, CN, CM, CA, CYB, CNB and CLB,
slopes per degree.
The letter before the configuration is that of card DIM, the numbers are in feet all the same.  A
missing number is written as zero: as ``-0.00000`` where the print has a blank, as ``0.00000`` where
it has NDM or NA, which a true zero is too.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import printed_name
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.cells import BLANK, FILLED, OK, SENTINEL, read_cell
from datcom_io.printout.layouts import BY_NAME
from flightmech.errors import ParseError
from flightmech.support.input_files import read_bytes
from flightmech.units import DEGREE, FOOT

_RUN = re.compile(r"RUN *\d{1,6} +(\d{1,4}) +\w{1,8} +(\S.*)")
_WIDTH = 10
_COLUMNS = {column.quantity: column for column in BY_NAME["static"].columns}
_NAMES = ("CN", "Cm", "CA", "CY_beta", "Cn_beta", "Cl_beta")
_WORDS = {"BODY": "body", "WING": "wing", "HT": "horizontal", "VT": "vertical", "VF": "fin"}


class _Unit14Run(NamedTuple):
    """One table: its heading as written, rows (alpha, column) and their flags."""

    line: int
    configuration: str
    mach: float
    reynolds: float
    reference: tuple[float, ...]
    rows: np.ndarray
    flags: np.ndarray


def read_for014(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read the small plot file (unit 14).

    Parameters
    ----------
    path : path
        ``for014.dat``, written by some builds in a run with card PLOT.

    Returns
    -------
    DataTree
        One child per case, ``case 1`` ... (runs in a row with the same angles of attack and
        references), with a leaf ``static`` (run, alpha): ``CN Cm CA CY_beta Cn_beta Cl_beta``, SI,
        radians, flags.  Every zero is flagged ``sentinel`` and has no value, because the file does
        not distinguish a missing number from zero; unit 13 does.

    Raises
    ------
    ParseError
        The file is not of this kind, or ends within a table.
    """
    file = Path(path).name
    lines = read_bytes(path, "a plot file (unit 14)").decode("latin-1").splitlines()
    # Tools of DOS end a file with 0x1A.
    while lines and not lines[-1].strip("\x1a "):
        lines.pop()
    runs: list[_Unit14Run] = []
    start = 0
    while start < len(lines):
        run, start = _read_run(file, lines, start)
        runs.append(run)
    if not runs:
        raise ParseError(
            file, 0, "no table", "a plot file of unit 14, whose first line begins with RUN"
        )
    root = xr.DataTree(xr.Dataset(attrs={"file": file}))
    for number, case in enumerate(_group_cases(runs), 1):
        attrs = xr.Dataset(attrs=_case_attrs(case[0], file, number))
        root[f"case {number}"] = xr.DataTree.from_dict({"/": attrs, "static": _static_leaf(case)})
    return root


def _group_cases(runs: list[_Unit14Run]) -> list[list[_Unit14Run]]:
    """Return runs in a row with the same angles of attack and references as one case."""
    cases: list[list[_Unit14Run]] = []
    for run in runs:
        if cases and _is_same_case(cases[-1][0], run):
            cases[-1].append(run)
        else:
            cases.append([run])
    return cases


def _is_same_case(first: _Unit14Run, run: _Unit14Run) -> bool:
    return first.reference == run.reference and np.array_equal(first.rows[:, 0], run.rows[:, 0])


def _read_run(file: str, lines: list[str], start: int) -> tuple[_Unit14Run, int]:
    """Return the table that begins at an index, and the index of the line after it."""
    head = _RUN.fullmatch(lines[start].rstrip())
    if head is None:
        raise ParseError(
            file,
            start + 1,
            repr(lines[start][:40]),
            "a line RUN, number, angles of attack, unit, configuration",
        )
    # Two lines of numbers, the rows, and a line R.
    count = int(head[1])
    first_row = start + 3
    end = first_row + count
    if count == 0 or end >= len(lines):
        raise ParseError(
            file,
            len(lines),
            f"the end of a table of {count} rows",
            "at least one row, and R after the last; run again",
        )
    (mach, reynolds), _ = _read_numbers(file, start + 2, lines[start + 1], 2)
    reference, _ = _read_numbers(file, start + 3, lines[start + 2], 6)
    values, flags = [], []
    for index in range(first_row, end):
        row, row_flags = _read_numbers(file, index + 1, lines[index], 1 + len(_NAMES))
        values.append(row)
        flags.append(row_flags)
    if lines[end].strip() != "R":
        raise ParseError(file, end + 1, repr(lines[end][:40]), f"R after {count} rows")
    run = _Unit14Run(
        line=start + 1,
        configuration=_read_configuration(file, start + 1, head[2]),
        mach=mach,
        reynolds=reynolds,
        reference=tuple(reference),
        rows=np.array(values),
        flags=np.array(flags, np.uint8),
    )
    return run, end + 1


def _read_configuration(file: str, line: int, text: str) -> str:
    """Return the printed name of a configuration such as ``BODY-WING-HT-VT-VF``."""
    # VF is written with every VT, whether there is a ventral fin or not.
    names = re.split("[- ]", text.replace("VT-VF", "VT"))
    made_of = frozenset(_WORDS[name] for name in names if name in _WORDS)
    if not made_of:
        expected = f"one made of {' '.join(_WORDS)}"
        raise ParseError(file, line, f"the configuration {text!r}", expected)
    return printed_name(made_of)


def _read_numbers(file: str, line: int, text: str, count: int) -> tuple[list[float], list[int]]:
    """Return values and flags of the fields of a line."""
    values, flags = [], []
    for k in range(count):
        field = text[k * _WIDTH : (k + 1) * _WIDTH].strip()
        cell = read_cell(field)
        if cell is None or not field:
            problem = f"{field!r} in a field of {_WIDTH} columns"
            raise ParseError(file, line, problem, f"{count} numbers")
        value, flag = cell
        # A missing number is written as zero; the sign marks a blank of the print.
        if flag == OK and value == 0.0:
            flag = SENTINEL
            if field.startswith("-"):
                flag = BLANK
        values.append(value)
        flags.append(flag)
    return values, flags


def _case_attrs(run: _Unit14Run, file: str, number: int) -> dict[str, str | float]:
    """Return the attributes of a case; the file is in feet whatever unit it states."""
    area, chord, span, centre, *unidentified = run.reference
    return {
        "S": area * FOOT**2,
        "cbar": chord * FOOT,
        "b": span * FOOT,
        "x_cg": centre * FOOT,
        "unidentified": " ".join(f"{value:g}" for value in unidentified),
        "case": f"case {number}",
        "file": file,
    }


def _static_leaf(runs: list[_Unit14Run]) -> xr.Dataset:
    """Return the coefficients of a case over run and alpha."""
    configurations = [run.configuration for run in runs]
    reynolds = [run.reynolds / FOOT for run in runs]
    alpha_attrs = {"units": "rad", "sign": "ANU", "long_name": "angle of attack"}
    leaf = LeafBuilder(
        {
            "run": xr.Variable("run", np.arange(len(runs))),
            "configuration": xr.Variable("run", configurations),
            "mach": xr.Variable("run", [run.mach for run in runs], {"units": "1"}),
            "reynolds_per_m": xr.Variable("run", reynolds, {"units": "m-1"}),
            "line": xr.Variable("run", [run.line for run in runs]),
            "alpha": xr.Variable("alpha", runs[0].rows[:, 0] * DEGREE, alpha_attrs),
        }
    )
    for k, name in enumerate(_NAMES, 1):
        column = _COLUMNS[name]
        value = np.array([run.rows[:, k] for run in runs])
        flag = np.array([run.flags[:, k] for run in runs])
        value[flag != OK] = np.nan
        # A column that is constant in alpha is filled downwards, as for the print file.
        if column.constant and flag.shape[1] > 1:
            constant = (flag[:, 0] == OK) & (flag[:, 1:] == BLANK).all(axis=1)
            value[constant, 1:] = value[constant, :1]
            flag[constant, 1:] = FILLED
        flag[flag == BLANK] = SENTINEL
        scale = 1.0
        if column.units == "1/angle":
            scale = DEGREE
        leaf.add(column, ("run", "alpha"), value / scale, flag)
    return leaf.to_dataset()
