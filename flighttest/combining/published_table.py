"""Published local models from a CSV file: a row per value with its standard error, columns for the conditions."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.names import lookup
from flightmech.support.input_files.text import WESTERN, csv_rows, read_text
from flightmech.units import parse, to_si

from ..equation_error.fit import Fit
from ..equation_error.model import Model, powers, variable_of
from .published import published_fit

NEEDED = ("model", "coefficient", "term", "value", "stderr")
_UNIT = "unit"
_REFERENCE = "reference"  # "alpha reference [deg]": the point about which the model is an expansion
_HEAD = re.compile(r"(.*?)\s*(?:\[(.*)\])?")
_RANGE = re.compile(r"\s*\.\.\.?\s*")  # 2 .. 6

Condition = float | tuple[float, float] | str


class _Row(NamedTuple):
    """One line of the file."""

    line: int
    term: str
    value: float
    stderr: float
    conditions: dict[str, Condition]
    reference: dict[str, float]


def read_published(path: str | Path) -> list[Fit]:
    """Return the local models of a CSV file as fits, for `aerodb.tabulate` and `join_fits`; no samples are invented.

    Parameters
    ----------
    path : path
        Separated by commas, or by semicolons, then with decimal points or commas; a line of names first.  Columns:

        - ``model``: name of the local model, which may have one row for each of its terms; ``coefficient``, ``term`` (``1``, ``alpha``,
          ``alpha**2``), ``value``, ``stderr``;
        - ``unit`` where value and standard error are not in SI, such as ``1/deg``;
        - any variable with its unit, ``alpha [deg]``: the condition, a number or a range ``2 .. 6`` over which the model holds, or the
          name of the variable that it moves with.  An empty cell states nothing; cells of one model must agree where they are filled;
        - ``alpha reference [deg]``: the point about which the model is an expansion.

    Returns
    -------
    list of Fit
        One per model and coefficient in the order of the file, as from `published_fit`, named by the column ``model``.

    Raises
    ------
    ParseError
        No line of names, or a row of another length.
    SchemaError
        Unknown or missing columns, cells that are no numbers, conditions that contradict each other, and every problem that
        `published_fit` finds in a model; all of them, with the line.
    """
    path = Path(path)
    text = read_text(path, "a CSV text with the columns " + ", ".join(NEEDED), WESTERN)
    first = text.split("\n", 1)[0]
    separator = ";" if first.count(";") > first.count(",") else ","
    lines = csv_rows(text, path, separator)
    columns = _columns(path, [cell.strip() for cell in lines[0]] if lines else [])
    problems: list[str] = []
    groups: dict[tuple[str, str], list[_Row]] = {}
    for number, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(lines[0]):
            raise ParseError(
                str(path), number, f"{len(cells)} cells", f"{len(lines[0])}, as the line of names has; quote texts with commas"
            )
        row = {name: cell.strip() for name, cell in zip(columns, cells, strict=True)}
        if separator == ";":
            row = {name: cell if name in ("model", "coefficient", "term") else cell.replace(",", ".") for name, cell in row.items()}
        read = _row(number, row, columns, problems)
        groups.setdefault((row["model"], row["coefficient"]), []).append(read)
    fits = [fit for (name, coefficient), rows in groups.items() if (fit := _fit(name, coefficient, rows, problems)) is not None]
    if not groups:
        problems.append("no row below the line of names")
    if problems:
        raise SchemaError(str(path), problems)
    return fits


def _columns(path: Path, heads: list[str]) -> dict[str, str]:
    """Return the name of every column, with its unit."""
    split = [match.groups() if (match := _HEAD.fullmatch(head)) else (head, None) for head in heads]
    names = [name for name, _ in split]
    problems = [f"no column {name!r}; needed are {', '.join(NEEDED)}" for name in NEEDED if name not in names]
    problems += [f"the column {name!r} stands twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    for name, unit in split:
        if name in (*NEEDED, _UNIT):
            continue
        try:
            variable = lookup(name.removesuffix(_REFERENCE).strip())
            to_si(0.0, unit or variable.units, variable.units)
        except AeromatchError as error:
            problems.append(f"column {name!r}: {error}")
    if problems:
        raise SchemaError(str(path), problems)
    return {name: unit or "" for name, unit in split}


def _row(line: int, cells: Mapping[str, str], columns: Mapping[str, str], problems: list[str]) -> _Row:
    scale = _scale(line, cells, problems)
    value, stderr = (scale * _number(line, key, cells[key], problems) for key in ("value", "stderr"))
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    for name, cell in cells.items():
        if name in (*NEEDED, _UNIT) or not cell:
            continue
        variable = name.removesuffix(_REFERENCE).strip()
        unit = columns[name] or lookup(variable).units
        if variable != name:
            reference[variable] = to_si(_number(line, name, cell, problems), unit)
        elif re.fullmatch(r"[A-Za-z_][\w.]*", cell):
            conditions[name] = cell
        else:
            ends = [to_si(_number(line, name, part, problems), unit) for part in _RANGE.split(cell)]
            conditions[name] = ends[0] if len(ends) == 1 else (ends[0], ends[1]) if len(ends) == 2 else _none(line, name, cell, problems)
    return _Row(line, cells["term"], value, stderr, conditions, reference)


def _number(line: int, name: str, cell: str, problems: list[str]) -> float:
    try:
        return float(cell)
    except ValueError:
        return _none(line, name, cell, problems)


def _none(line: int, name: str, cell: str, problems: list[str]) -> float:
    what = "a number" if name in NEEDED else "a number, a range such as 2 .. 6, or the name of a variable"
    problems.append(f"line {line}: {name} is {cell!r}; give {what}")
    return float("nan")


def _scale(line: int, cells: Mapping[str, str], problems: list[str]) -> float:
    """Return the factor of the unit that a row states."""
    if not cells.get(_UNIT):
        return 1.0
    try:
        variables = [variable_of(factor) for factor, power in powers(cells["term"]).items() for _ in range(power) if factor != "1"]
        expected = "/".join(["1", *(lookup(name).units for name in variables)])
        to_si(0.0, cells[_UNIT], expected)
        return parse(cells[_UNIT])[1]
    except AeromatchError as error:
        problems.append(f"line {line}: {error}")
        return float("nan")


def _taken(known: dict, given: Mapping, place: str, line: int) -> list[str]:
    """Add the conditions of a row to those of its model; return those that contradict an earlier row."""
    return [
        f"{place}: {key} is {known[key]} and in line {line} {item}; a model has one condition"
        for key, item in given.items()
        if known.setdefault(key, item) != item
    ]


def _fit(name: str, coefficient: str, rows: list[_Row], problems: list[str]) -> Fit | None:
    """Return the local model of its rows, None when it is faulty."""
    place = f"{name or 'model without a name'}, {coefficient}, line {rows[0].line}"
    conditions: dict[str, Condition] = {}
    reference: dict[str, float] = {}
    before = len(problems)
    for row in rows:
        problems += _taken(conditions, row.conditions, place, row.line)
        problems += _taken(reference, row.reference, place, row.line)
    terms = [row.term for row in rows]
    problems += [f"{place}: the term {term} stands twice" for term in dict.fromkeys(terms) if terms.count(term) > 1]
    if len(problems) > before or any(math.isnan(row.value) or math.isnan(row.stderr) for row in rows):
        return None
    try:
        model = Model(coefficient, terms, reference)
        values, stderr = (
            {term: float(item) for term, item in zip(model.terms, column)} for column in zip(*((r.value, r.stderr) for r in rows))
        )
        return published_fit(model, values, stderr, conditions, name=name)
    except SchemaError as error:
        problems += [f"{place}: {text}" for text in error.problems]
    except AeromatchError as error:
        problems.append(f"{place}: {error}")
    return None
