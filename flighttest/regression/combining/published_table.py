"""Published local models from a CSV file.

Each row has a value with its standard error. Columns contain the conditions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flightmech.errors import AeromatchError, SchemaError
from flightmech.names import lookup
from flightmech.units import parse_unit, to_si
from flighttest.records.text_tables import read_text_table
from flighttest.regression.combining.published import Condition, published_fit
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of

NEEDED = ("model", "coefficient", "term", "value", "stderr")
_TEXTS = {"model", "coefficient", "term"}  # columns in which a comma is not a decimal comma
_UNIT = "unit"
_REFERENCE = "reference"  # "alpha reference [deg]": the point about which the model is an expansion
_HEAD = re.compile(r"(.*?)\s*(?:\[(.*)\])?")  # name and unit of a column
_RANGE = re.compile(r"\s*\.\.\.?\s*")  # 2 .. 6
_NAME = re.compile(r"[A-Za-z_][\w.]*")


class _Row(NamedTuple):
    """One line of the file."""

    line: int
    term: str
    value: float
    stderr: float
    conditions: dict[str, Condition]
    reference: dict[str, float]


def read_published(path: str | Path) -> list[Fit]:
    """Return the local models of a CSV file as fits, for `aerodb.tabulate` and `join_fits`.

    The fits have no samples.

    Parameters
    ----------
    path : path
        Separated by commas, or by semicolons, then with decimal points or commas. The first line
        contains the names of the columns:

        - ``model``: name of the local model, which may have one row for each of its terms;
          ``coefficient``, ``term`` (``1``, ``alpha``, ``alpha**2``), ``value``, ``stderr``;
        - ``unit`` if value and standard error are not in SI, such as ``1/deg``;
        - any variable with its unit, ``alpha [deg]``: the condition, a number or a range ``2 .. 6``
          in which the model holds, or the name of the variable that it moves with. An empty cell
          states nothing. The other cells of one model must agree;
        - ``alpha reference [deg]``: the point about which the model is an expansion.

    Returns
    -------
    list of Fit
        One per model and coefficient in the order of the file, as from `published_fit`, named by
        the column ``model``.

    Raises
    ------
    ParseError
        No line of names, or a row of another length.
    SchemaError
        Unknown or missing columns, cells that are not numbers, conditions that contradict each
        other, and every problem that `published_fit` reports for a model. One error lists all of
        them, with the line.
    """
    path = Path(path)
    table = read_text_table(path, "a CSV text with the columns " + ", ".join(NEEDED))
    columns = _read_heads(path, table.names)
    problems: list[str] = []
    groups: dict[tuple[str, str], list[_Row]] = {}
    for line, cells in zip(table.lines, table.rows, strict=True):
        cell_of = dict(zip(columns, cells, strict=True))
        for name in cell_of.keys() - _TEXTS:
            cell_of[name] = table.with_point(cell_of[name])
        row = _read_row(line, cell_of, columns=columns, problems=problems)
        groups.setdefault((cell_of["model"], cell_of["coefficient"]), []).append(row)
    fits = []
    for (name, coefficient), rows in groups.items():
        fit = _make_fit(name, coefficient, rows=rows, problems=problems)
        if fit is not None:
            fits.append(fit)
    if not groups:
        problems.append("no row below the line of names")
    if problems:
        raise SchemaError(str(path), problems)
    return fits


def _read_heads(path: Path, heads: list[str]) -> dict[str, str]:
    """Return the name of every column, with its unit; raise with every problem."""
    units: dict[str, str] = {}
    problems, repeated = [], []
    for head in heads:
        name, unit = head, ""
        match = _HEAD.fullmatch(head)
        if match:
            name, unit = match.group(1), match.group(2) or ""
        if name in units:
            repeated.append(f"the column {name!r} stands twice")
        units[name] = unit
    for name in NEEDED:
        if name not in units:
            problems.append(f"no column {name!r}; needed are {', '.join(NEEDED)}")
    problems.extend(dict.fromkeys(repeated))
    for name, unit in units.items():
        if name in (*NEEDED, _UNIT):
            continue
        try:
            variable = lookup(name.removesuffix(_REFERENCE).strip())
            to_si(0.0, unit or variable.units, variable.units)
        except AeromatchError as error:
            problems.append(f"column {name!r}: {error}")
    if problems:
        raise SchemaError(str(path), problems)
    return units


def _read_row(
    line: int, cell_of: Mapping[str, str], columns: Mapping[str, str], problems: list[str]
) -> _Row:
    """Return one row in SI; append its problems."""
    scale = _unit_factor(line, cell_of, problems)
    value = scale * _read_number(line, "value", cell=cell_of["value"], problems=problems)
    stderr = scale * _read_number(line, "stderr", cell=cell_of["stderr"], problems=problems)
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    for name, cell in cell_of.items():
        if name in (*NEEDED, _UNIT) or not cell:
            continue
        # "alpha reference" belongs to the variable alpha.
        variable = name.removesuffix(_REFERENCE).strip()
        unit = columns[name] or lookup(variable).units
        if variable != name:
            number = _read_number(line, name, cell=cell, problems=problems)
            reference[variable] = to_si(number, unit)
        elif _NAME.fullmatch(cell):
            conditions[name] = cell
        else:
            ends = []
            for part in _RANGE.split(cell):
                ends.append(to_si(_read_number(line, name, cell=part, problems=problems), unit))
            conditions[name] = _make_condition(line, name, cell=cell, ends=ends, problems=problems)
    return _Row(
        line, cell_of["term"], value, stderr=stderr, conditions=conditions, reference=reference
    )


def _make_condition(
    line: int, name: str, cell: str, ends: Sequence[float], problems: list[str]
) -> Condition:
    """Return a number or a range from the numbers of a cell; append a problem for more of them."""
    if len(ends) == 1:
        return ends[0]
    if len(ends) == 2:
        return ends[0], ends[1]
    return _report_cell(line, name, cell=cell, problems=problems)


def _read_number(line: int, name: str, cell: str, problems: list[str]) -> float:
    """Return the number of a cell; append a problem and return NaN if it is not a number."""
    try:
        return float(cell)
    except ValueError:
        return _report_cell(line, name, cell=cell, problems=problems)


def _report_cell(line: int, name: str, cell: str, problems: list[str]) -> float:
    """Append the problem of an invalid cell; return NaN."""
    allowed = "a number, a range such as 2 .. 6, or the name of a variable"
    if name in NEEDED:
        allowed = "a number"
    problems.append(f"line {line}: {name} is {cell!r}; give {allowed}")
    return float("nan")


def _unit_factor(line: int, cell_of: Mapping[str, str], problems: list[str]) -> float:
    """Return the factor to SI of the unit of a row."""
    unit = cell_of.get(_UNIT)
    if not unit:
        return 1.0
    try:
        # The SI unit of a term's value is one over the units of its factors.
        units = ["1"]
        for factor, power in term_powers(cell_of["term"]).items():
            if factor != "1":
                units += power * [lookup(variable_of(factor)).units]
        to_si(0.0, unit, "/".join(units))
        return parse_unit(unit)[1]
    except AeromatchError as error:
        problems.append(f"line {line}: {error}")
        return float("nan")


def _merge_conditions(
    merged: dict[str, Any], row: Mapping[str, Any], model: str, line: int
) -> list[str]:
    """Add the conditions of a row to those of its model; return the contradictions."""
    contradictions = []
    for name, condition in row.items():
        if merged.setdefault(name, condition) != condition:
            contradictions.append(
                f"{model}: {name} is {merged[name]} and in line {line} {condition}; a model has "
                f"one condition"
            )
    return contradictions


def _make_fit(name: str, coefficient: str, rows: list[_Row], problems: list[str]) -> Fit | None:
    """Return the local model of its rows; append its problems and return None if it is faulty."""
    label = f"{name or 'model without a name'}, {coefficient}, line {rows[0].line}"
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    faults = []
    has_numbers = True
    for row in rows:
        faults += _merge_conditions(conditions, row.conditions, model=label, line=row.line)
        faults += _merge_conditions(reference, row.reference, model=label, line=row.line)
        # The problem of a missing number was reported when the row was read.
        has_numbers = has_numbers and not (math.isnan(row.value) or math.isnan(row.stderr))
    terms = [row.term for row in rows]
    for term in dict.fromkeys(terms):
        if terms.count(term) > 1:
            faults.append(f"{label}: the term {term} stands twice")
    problems += faults
    if faults or not has_numbers:
        return None
    try:
        model = RegressionModel(coefficient, terms, reference)
        values, stderr = {}, {}
        for term, row in zip(model.terms, rows):
            values[term], stderr[term] = float(row.value), float(row.stderr)
        return published_fit(model, values, stderr=stderr, conditions=conditions, name=name)
    except SchemaError as error:
        problems += [f"{label}: {text}" for text in error.problems]
    except AeromatchError as error:
        problems.append(f"{label}: {error}")
    return None
