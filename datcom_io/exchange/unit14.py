"""The small plot file of some builds (unit 14), in the manner of Missile DATCOM: one short table
per configuration and condition.

::

    RUN   1  4  M BODY-WING-HT-VT-VF
       0.30000  2120470.                                            Mach number, Reynolds number per foot
     260.48663   6.63386  43.83202  20.66929   0.00000   2.50000    area, chord, span, moment centre, two more; feet
      -2.00000  -0.04119   0.09574   0.01502  -0.01367 ...          alpha, CN, CM, CA, CYB, CNB, CLB; per degree
    R

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
    while lines and not lines[-1].strip("\x1a "):
        lines.pop()
    runs, at = [], 0
    while at < len(lines):
        run, at = _read_run(file, lines, at)
        runs.append(run)
    if not runs:
        raise ParseError(
            file, 0, "no table", "a plot file of unit 14, whose first line begins with RUN"
        )
    cases: list[list[_Unit14Run]] = []
    for run in runs:
        alike = (
            cases
            and cases[-1][0].reference == run.reference
            and np.array_equal(cases[-1][0].rows[:, 0], run.rows[:, 0])
        )
        cases[-1].append(run) if alike else cases.append([run])
    root = xr.DataTree(xr.Dataset(attrs={"file": file}))
    for number, case in enumerate(cases, 1):
        root[f"case {number}"] = xr.DataTree.from_dict(
            {"/": xr.Dataset(attrs=_attrs(case[0], file, number)), "static": _static(case)}
        )
    return root


def _read_run(file: str, lines: list[str], at: int) -> tuple[_Unit14Run, int]:
    head = _RUN.fullmatch(lines[at].rstrip())
    if head is None:
        raise ParseError(
            file,
            at + 1,
            repr(lines[at][:40]),
            "a line RUN, number, angles of attack, unit, configuration",
        )
    first, count = at + 1, int(head[1])
    if count == 0 or at + 3 + count >= len(lines):
        raise ParseError(
            file,
            len(lines),
            f"the end of a table of {count} rows",
            "at least one row, and R after the last; run again",
        )
    (mach, reynolds), _ = _numbers(file, at + 2, lines[at + 1], 2)
    reference, _ = _numbers(file, at + 3, lines[at + 2], 6)
    rows = [_numbers(file, at + 4 + i, lines[at + 3 + i], 1 + len(_NAMES)) for i in range(count)]
    at += 3 + count
    if lines[at].strip() != "R":
        raise ParseError(file, at + 1, repr(lines[at][:40]), f"R after {count} rows")
    words = head[2].replace(
        "VT-VF", "VT"
    )  # VF is written with every VT, whether there is a ventral fin or not
    made_of = frozenset(_WORDS[word] for word in re.split("[- ]", words) if word in _WORDS)
    if not made_of:
        raise ParseError(
            file, first, f"the configuration {head[2]!r}", f"one made of {' '.join(_WORDS)}"
        )
    values, flags = (
        np.array([values for values, _ in rows]),
        np.array([flags for _, flags in rows], np.uint8),
    )
    return _Unit14Run(
        first, printed_name(made_of), mach, reynolds, tuple(reference), values, flags
    ), at + 1


def _numbers(file: str, line: int, text: str, count: int) -> tuple[list[float], list[int]]:
    cells = [text[k * _WIDTH : (k + 1) * _WIDTH] for k in range(count)]
    values, flags = [], []
    for cell in cells:
        found = read_cell(cell)
        if found is None or not cell.strip():
            raise ParseError(
                file, line, f"{cell.strip()!r} in a field of {_WIDTH} columns", f"{count} numbers"
            )
        value, flag = found
        zero = flag == OK and value == 0.0
        values.append(value)
        flags.append(flag if not zero else BLANK if cell.strip().startswith("-") else SENTINEL)
    return values, flags


def _attrs(run: _Unit14Run, file: str, number: int) -> dict[str, str | float]:
    area, chord, span, centre, *rest = run.reference
    return {
        "S": area * FOOT**2,
        "cbar": chord * FOOT,
        "b": span * FOOT,
        "x_cg": centre * FOOT,
        "unidentified": " ".join(f"{value:g}" for value in rest),
        "case": f"case {number}",
        "file": file,
    }


def _static(runs: list[_Unit14Run]) -> xr.Dataset:
    found = LeafBuilder(
        {
            "run": xr.Variable("run", np.arange(len(runs))),
            "configuration": xr.Variable("run", [run.configuration for run in runs]),
            "mach": xr.Variable("run", [run.mach for run in runs], {"units": "1"}),
            "reynolds_per_m": xr.Variable(
                "run", [run.reynolds / FOOT for run in runs], {"units": "m-1"}
            ),
            "line": xr.Variable("run", [run.line for run in runs]),
            "alpha": xr.Variable(
                "alpha",
                runs[0].rows[:, 0] * DEGREE,
                {"units": "rad", "sign": "ANU", "long_name": "angle of attack"},
            ),
        }
    )
    for k, name in enumerate(_NAMES, 1):
        column = _COLUMNS[name]
        value, flag = (
            np.array([run.rows[:, k] for run in runs]),
            np.array([run.flags[:, k] for run in runs]),
        )
        value[flag != OK] = np.nan
        if column.constant and flag.shape[1] > 1:
            constant = (flag[:, 0] == OK) & (flag[:, 1:] == BLANK).all(axis=1)
            value[constant, 1:], flag[constant, 1:] = value[constant, :1], FILLED
        flag[flag == BLANK] = SENTINEL
        found.add(
            column, ("run", "alpha"), value / (DEGREE if column.units == "1/angle" else 1.0), flag
        )
    return found.to_dataset()
