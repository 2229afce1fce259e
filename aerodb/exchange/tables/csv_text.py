"""CSV files with facts in comment lines: ``# key: text`` and ``# key = number`` before a header row
with units in brackets.

A text of several lines takes several comment lines with the same key; a backslash or a control
character is written ``\\\\uXXXX``. Numbers are written with all their digits, so that reading gives
the same ones.
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

Facts = Mapping[str, str | int | float]
_WITHOUT = "_without"  # words: usual attributes that a variable lacks


def flatten_attributes(leaf: xr.Dataset) -> dict[str, str | int | float]:
    """Return the attributes of a leaf, and as ``variable.key`` those of its variables that the
    vocabulary does not give.
    """
    found = {str(key): item for key, item in leaf.attrs.items()}
    missing = []
    for name, variable in leaf.variables.items():
        usual = _usual(str(name))
        found |= {
            f"{name}.{key}": item
            for key, item in variable.attrs.items()
            if usual.get(str(key)) != item
        }
        missing += [f"{name}.{key}" for key in usual if key not in variable.attrs]
    return {**found, _WITHOUT: " ".join(missing)} if missing else found


def restore_attributes(leaf: xr.Dataset, facts: Facts) -> xr.Dataset:
    """Return a leaf with the attributes that `flatten_attributes` gave."""
    found = leaf.copy()
    missing = str(facts.get(_WITHOUT, "")).split()
    found.attrs = {key: item for key, item in facts.items() if "." not in key and key != _WITHOUT}
    for name in map(str, leaf.variables):
        own = {
            key.removeprefix(f"{name}."): item
            for key, item in facts.items()
            if key.startswith(f"{name}.")
        }
        usual = {key: item for key, item in _usual(name).items() if f"{name}.{key}" not in missing}
        found[name].attrs = {**usual, **own}
    return found


def _usual(name: str) -> dict[str, str]:
    if name == "source":
        return _terms.SOURCE_ATTRS
    return quantity_attributes(name) if name in VOCABULARY else {}


Fact = str | int | float
_FACT = re.compile(r"# ([A-Za-z_][\w.]*)(?:: ?(.*)| = (.+))", re.DOTALL)
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*")
_HEAD = re.compile(r"(.*?)(?: \[(.*)\])?")
_SPECIAL = re.compile(r"[\\\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\ufeff]")
_WRITTEN = re.compile(r"\\u([0-9a-f]{4})")


class CsvTable(NamedTuple):
    """A CSV file as read: its first comment line, facts, units of the columns (empty without
    brackets), cells, lines of the rows.
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
    """Return the text of a CSV file; cells must hold no comma, quote or line end."""
    lines = [f"# {title}"]
    for key, item in facts.items():
        if isinstance(item, str):
            lines += [
                f"# {key}: {_SPECIAL.sub(lambda match: f'{chr(92)}u{ord(match[0]):04x}', line)}"
                for line in item.split("\n")
            ]
        else:
            lines.append(f"# {key} = {item.item() if isinstance(item, np.generic) else item!r}")
    return "\n".join([*lines, ",".join(header), *(",".join(row) for row in rows), ""])


def unwritable_keys(facts: Mapping[str, Fact]) -> list[str]:
    """Return the faults of facts whose keys cannot stand in a comment line."""
    return [
        f"attribute {key!r} is not a word of letters, digits and underscores; rename it"
        for key in facts
        if not _KEY.fullmatch(key)
    ]


def read_csv(path: Path) -> tuple[CsvTable, list[str]]:
    """Return a CSV file and the faults of its lines.

    Raises
    ------
    ParseError
        The file is no text in UTF-8 or UTF-16, has no header row, or a cell or a row of a size that
        no table has.
    """
    text = read_text(path, "a CSV file")
    problems: list[str] = []
    lines = list(enumerate(text.split("\n"), 1))
    comments = [(number, line) for number, line in lines if line.startswith("#")]
    body = [(number, line) for number, line in lines if line.strip() and not line.startswith("#")]
    if not body:
        raise ParseError(
            str(path), len(lines), "no header row", "a row of column names after the comment lines"
        )
    facts: dict[str, Fact] = {}
    for number, line in comments[1:]:
        _take_fact(line, facts, problems, f"{path.name}, line {number}")
    head = [
        _HEAD.fullmatch(cell.strip()) for cell in csv_rows(body[0][1], path, first=body[0][0])[0]
    ]
    names = [match[1] for match in head if match]
    columns: dict[str, list[str]] = {name: [] for name in names}
    if len(columns) < len(names):
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        problems.append(
            f"{path.name}, line {body[0][0]}: the columns {', '.join(twice)} stand twice"
        )
    kept = []
    for number, line in body[1:]:
        cells = csv_rows(line, path, first=number)[0]
        if len(cells) != len(names):
            problems.append(
                f"{path.name}, line {number}: {len(cells)} cells, the header has {len(names)}"
            )
            continue
        kept.append(number)
        for name, cell in zip(names, cells):
            columns[name].append(cell.strip())
    title = comments[0][1].removeprefix("#").strip() if comments else ""
    units = {match[1]: match[2] or "" for match in head if match}
    return CsvTable(path.name, title, facts, units, columns, kept), problems


def _take_fact(line: str, facts: dict[str, Fact], problems: list[str], place: str) -> None:
    match = _FACT.fullmatch(line)
    if match is None:
        problems.append(
            f"{place}: found {line[:60]!r}; a comment line is '# key: text' or '# key = number'"
        )
        return
    key, text, number = match.groups()
    if number is not None:
        try:
            facts[key] = int(number) if re.fullmatch(r"[-+]?\d+", number) else float(number)
        except ValueError:
            problems.append(
                f"{place}: {number!r} is no number; a text takes a colon: '# {key}: {number}'"
            )
        return
    decoded = _WRITTEN.sub(lambda match: chr(int(match[1], 16)), text)
    facts[key] = f"{facts[key]}\n{decoded}" if key in facts else decoded


def column_numbers(table: CsvTable, name: str, problems: list[str]) -> np.ndarray:
    """Return a column as numbers; each cell that is none becomes a problem."""
    found = np.full(len(table.lines), np.nan)
    for place, (cell, line) in enumerate(zip(table.columns[name], table.lines)):
        try:
            found[place] = float(cell)
        except ValueError:
            problems.append(
                f"{table.name}, line {line}: {name} is {cell!r}; a number is needed, with a "
                f"point and no thousands marks"
            )
    return found


def si_column(table: CsvTable, name: str, problems: list[str]) -> np.ndarray:
    """Return a column converted from the unit in its brackets to SI; without brackets it is taken
    as it is.
    """
    found, unit = column_numbers(table, name, problems), table.units[name]
    try:
        return to_si(found, unit, lookup(name).units) if unit else found
    except (UnitError, UnknownName) as error:
        problems.append(f"{table.name}: column {name} [{unit}]: {error}")
        return found
