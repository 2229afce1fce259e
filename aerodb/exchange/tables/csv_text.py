"""CSV files with facts in comment lines: ``# key: text`` and ``# key = number``.

The comment lines precede a header row with units in brackets.  A text of several lines has several
comment lines with the same key.  A backslash or a control character is written ``\\\\uXXXX``.
Numbers have all their digits, so that reading gives the same numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import ParseError, UnitError, UnknownName
from flightmech.names import VOCABULARY, lookup, quantity_attributes
from flightmech.support.input_files import csv_rows, read_text
from flightmech.units import to_si

Fact = str | int | float
Facts = Mapping[str, Fact]
_WITHOUT = "_without"  # key of the usual attributes that a variable lacks
_MOST_CHARACTERS = 60  # of a faulty line in a message

_FACT = re.compile(r"# ([A-Za-z_][\w.]*)(?:: ?(.*)| = (.+))", re.DOTALL)
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*")
_HEAD = re.compile(r"(.*?)(?: \[(.*)\])?")
# Backslash, control characters except the line feed, and other characters that end a line.
_SPECIAL = re.compile(r"[\\\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\ufeff]")
_WRITTEN = re.compile(r"\\u([0-9a-f]{4})")


def flatten_attributes(leaf: xr.Dataset) -> dict[str, Fact]:
    """Return the attributes of a leaf, and those of its variables as ``variable.key``.

    Attributes of variables that equal those of the vocabulary are left out.
    """
    facts = {str(key): value for key, value in leaf.attrs.items()}
    missing = []
    for name, variable in leaf.variables.items():
        usual = _usual_attributes(str(name))
        for key, value in variable.attrs.items():
            if usual.get(str(key)) != value:
                facts[f"{name}.{key}"] = value
        missing += [f"{name}.{key}" for key in usual if key not in variable.attrs]
    if missing:
        facts[_WITHOUT] = " ".join(missing)
    return facts


def restore_attributes(leaf: xr.Dataset, facts: Facts) -> xr.Dataset:
    """Return a leaf with the attributes that `flatten_attributes` gave."""
    restored = leaf.copy()
    missing = str(facts.get(_WITHOUT, "")).split()
    # A key with a point belongs to a variable, any other key to the leaf.
    restored.attrs = {
        key: value for key, value in facts.items() if "." not in key and key != _WITHOUT
    }
    for name in map(str, leaf.variables):
        attributes: dict[str, Fact] = {}
        for key, usual in _usual_attributes(name).items():
            if f"{name}.{key}" not in missing:
                attributes[key] = usual
        for key, value in facts.items():
            if key.startswith(f"{name}."):
                attributes[key.removeprefix(f"{name}.")] = value
        restored[name].attrs = attributes
    return restored


def _usual_attributes(name: str) -> dict[str, str]:
    """Return the attributes that every variable of a name has."""
    if name == "source":
        return _terms.SOURCE_ATTRS
    return quantity_attributes(name) if name in VOCABULARY else {}


class CsvTable(NamedTuple):
    """Content of a CSV file.

    Parameters
    ----------
    name : str
        Name of the file.
    title : str
        Its first comment line.
    facts : dict of str to str, int or float
        Facts of the other comment lines.
    units : dict of str to str
        Unit of each column; empty without brackets.
    columns : dict of str to list of str
        Cells of each column.
    lines : list of int
        Line number of each row.
    """

    name: str
    title: str
    facts: dict[str, Fact]
    units: dict[str, str]
    columns: dict[str, list[str]]
    lines: list[int]


def written_csv(
    title: str, facts: Mapping[str, Fact], header: Sequence[str], rows: Sequence[Sequence[str]]
) -> str:
    """Return the text of a CSV file; cells must not contain a comma, a quote or a line end."""
    lines = [f"# {title}"]
    for key, value in facts.items():
        if isinstance(value, str):
            lines += [f"# {key}: {_escape_line(line)}" for line in value.split("\n")]
        elif isinstance(value, np.generic):
            lines.append(f"# {key} = {value.item()!r}")
        else:
            lines.append(f"# {key} = {value!r}")
    lines.append(",".join(header))
    lines += [",".join(row) for row in rows]
    # The last, empty line ends the file with a line feed.
    return "\n".join([*lines, ""])


def _escape_line(line: str) -> str:
    return _SPECIAL.sub(lambda match: f"\\u{ord(match[0]):04x}", line)


def unwritable_keys(facts: Mapping[str, Fact]) -> list[str]:
    """Return a problem for every key of the facts that a comment line cannot contain."""
    problems = []
    for key in facts:
        if not _KEY.fullmatch(key):
            problems.append(
                f"attribute {key!r} is not a word of letters, digits and underscores; rename it"
            )
    return problems


def read_csv(path: Path) -> tuple[CsvTable, list[str]]:
    """Return a CSV file and the faults of its lines.

    Raises
    ------
    ParseError
        The file is not a text in UTF-8 or UTF-16, has no header row, or has a cell or a row that is
        larger than any table.
    """
    text = read_text(path, "a CSV file")
    problems: list[str] = []
    comments: list[tuple[int, str]] = []
    body: list[tuple[int, str]] = []
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        if line.startswith("#"):
            comments.append((number, line))
        elif line.strip():
            body.append((number, line))
    if not body:
        raise ParseError(
            str(path), len(lines), "no header row", "a row of column names after the comment lines"
        )
    # The first comment line is the title.
    title = comments[0][1].removeprefix("#").strip() if comments else ""
    facts: dict[str, Fact] = {}
    for number, line in comments[1:]:
        _add_fact(line, facts, problems, location=f"{path.name}, line {number}")
    header_line, header_text = body[0]
    names, units = _parse_header(csv_rows(header_text, path, first=header_line)[0])
    columns: dict[str, list[str]] = {name: [] for name in names}
    if len(columns) < len(names):
        repeated = sorted(name for name, count in Counter(names).items() if count > 1)
        problems.append(
            f"{path.name}, line {header_line}: the columns {', '.join(repeated)} stand twice"
        )
    # A row with a wrong number of cells is a fault and has no place in the columns.
    row_lines = []
    for number, line in body[1:]:
        cells = csv_rows(line, path, first=number)[0]
        if len(cells) != len(names):
            problems.append(
                f"{path.name}, line {number}: {len(cells)} cells, the header has {len(names)}"
            )
            continue
        row_lines.append(number)
        for name, cell in zip(names, cells, strict=True):
            columns[name].append(cell.strip())
    return CsvTable(
        path.name, title, facts, units=units, columns=columns, lines=row_lines
    ), problems


def _parse_header(cells: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the names of the columns, and their units in brackets."""
    names, units = [], {}
    for cell in cells:
        match = _HEAD.fullmatch(cell.strip())
        if match:
            names.append(match[1])
            units[match[1]] = match[2] or ""
    return names, units


def _add_fact(line: str, facts: dict[str, Fact], problems: list[str], location: str) -> None:
    """Add the fact of a comment line to `facts`, or its fault to `problems`."""
    match = _FACT.fullmatch(line)
    if match is None:
        problems.append(
            f"{location}: found {line[:_MOST_CHARACTERS]!r}; a comment line is '# key: text' or "
            f"'# key = number'"
        )
        return
    key, text, number = match.groups()
    if number is not None:
        try:
            facts[key] = int(number) if re.fullmatch(r"[-+]?\d+", number) else float(number)
        except ValueError:
            problems.append(
                f"{location}: {number!r} is not a number; a text takes a colon: '# {key}: {number}'"
            )
        return
    # A repeated key continues its text on a new line.
    decoded = _WRITTEN.sub(lambda match: chr(int(match[1], 16)), text)
    facts[key] = f"{facts[key]}\n{decoded}" if key in facts else decoded


def column_numbers(table: CsvTable, name: str, problems: list[str]) -> np.ndarray:
    """Return a column as numbers; every other cell is NaN and becomes a problem."""
    numbers = np.full(len(table.lines), np.nan)
    for i, (cell, line) in enumerate(zip(table.columns[name], table.lines, strict=False)):
        try:
            numbers[i] = float(cell)
        except ValueError:
            problems.append(
                f"{table.name}, line {line}: {name} is {cell!r}; a number is needed, with a "
                f"point and no thousands marks"
            )
    return numbers


def si_column(table: CsvTable, name: str, problems: list[str]) -> np.ndarray:
    """Return a column in SI; a column without a unit in brackets is not converted."""
    numbers, unit = column_numbers(table, name, problems), table.units[name]
    if not unit:
        return numbers
    try:
        return to_si(numbers, unit, lookup(name).units)
    except (UnitError, UnknownName) as error:
        problems.append(f"{table.name}: column {name} [{unit}]: {error}")
        return numbers
