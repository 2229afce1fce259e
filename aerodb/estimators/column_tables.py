"""Tables of coefficients of wind tunnels and CFD, as text files with a column map.

The separator is a semicolon or a tab (decimal commas may be), a comma or white space. Lines
before the heading and lines that begin with ``#`` are not read, and so are lines of units below the
heading.
An empty cell is a missing number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerodb.estimators.coefficient_set import CoefficientSet, make_numbers
from aerodb.estimators.column_map import (
    COEFFICIENTS,
    ColumnMap,
    MappedQuantity,
    parse_quantity_of_column,
)
from flightmech.errors import ParseError
from flightmech.support.input_files import decode_text, read_bytes, with_line_feeds

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?$")
_NUMBERS = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[Ee][-+]?\d+)?")
_FILLED = re.compile(r"[-+]?9{3,}(?:\.[09]*)?$")
_CONDITIONS = ("mach", "alpha", "beta")
_NAMES = ("coefficient", "value")
_EXPECTED = "a text table of coefficients"
_MOST_COLUMNS = 5000


def read_table(path: str | Path, columns: ColumnMap) -> CoefficientSet:
    """Return the numbers of a table.

    Parameters
    ----------
    path : str or Path
    columns : ColumnMap

    Raises
    ------
    ParseError
        No line is the heading of the mapped columns, a row has another number of cells than the
        heading, or a cell is not a number.
    """
    file = Path(path)
    raw = read_bytes(file, _EXPECTED)
    lines = with_line_feeds(decode_text(raw, file, _EXPECTED)).split("\n")
    if columns.layout == "matrix":
        rows, controls = _read_matrix(file, lines, columns)
    else:
        rows, controls = _read_columns(file, lines, columns)
    if not rows:
        raise ParseError(str(file), len(lines), "a heading without a row", "rows of numbers")
    return CoefficientSet(
        columns.program,
        (file.name,),
        force_axes=columns.force_axes,
        moment_axes=columns.moment_axes,
        control_axes=columns.moment_axes,
        reference=columns.reference.to_reference(),
        controls=tuple(controls),
        numbers=make_numbers(rows, controls),
        unit_stated=True,
    )


def _split(line: str) -> tuple[list[str], bool]:
    """Return the cells of a line, and whether a decimal comma may stand in them."""
    for separator in (";", "\t", ","):
        if separator in line:
            cells = [cell.strip().strip('"') for cell in line.split(separator)]
            return cells, separator != ","
    return line.split(), False


def _is_skipped(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _is_units(cells: Sequence[str]) -> bool:
    """Return whether the cells are units in brackets."""
    return all(not cell or (cell[0] in "[(" and cell[-1] in "])") for cell in cells)


def _read_number(file: Path, line: int, cell: str, decimal_comma: bool) -> float | None:
    """Return the number of a cell; None for an empty one."""
    text = cell.strip()
    if not text:
        return None
    if decimal_comma:
        text = text.replace(",", ".")
    if not _NUMBER.match(text):
        raise ParseError(
            str(file), line, repr(cell), "a number, or an empty cell for a missing one"
        )
    value = float(text.replace("D", "E").replace("d", "e"))
    if not math.isfinite(value):
        raise ParseError(str(file), line, repr(cell), "a finite number")
    if _FILLED.match(text):
        raise ParseError(
            str(file), line, f"{cell!r}, a mark of a missing number", "an empty cell for it"
        )
    return value


def _read_columns(
    file: Path, lines: Sequence[str], columns: ColumnMap
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows of the layouts runs and long, and the names of the controls."""
    wanted = {name: parse_quantity_of_column(text) for name, text in columns.columns.items()}
    position, head = _find_heading(file, lines, wanted)
    controls = []
    for quantity in wanted.values():
        if quantity.unit and quantity.name not in _CONDITIONS:
            controls.append(quantity.name)
    rows: list[dict[str, Any]] = []
    for number in range(position + 1, len(lines)):
        if _is_skipped(lines[number]):
            continue
        cells, decimal_comma = _split(lines[number])
        if _is_units(cells):
            continue
        if len(cells) != len(head):
            raise ParseError(
                str(file), number + 1, f"{len(cells)} cells", f"{len(head)}, as the heading has"
            )
        given = dict(zip(head, cells))
        rows += _row_numbers(
            file, number + 1, given, wanted=wanted, mach=columns.mach, decimal_comma=decimal_comma
        )
    return rows, controls


def _find_heading(
    file: Path, lines: Sequence[str], wanted: Mapping[str, MappedQuantity]
) -> tuple[int, list[str]]:
    """Return the position of the heading and its cells."""
    best: list[str] = []
    for number, line in enumerate(lines):
        if _is_skipped(line):
            continue
        cells, _ = _split(line)
        if set(wanted) <= set(cells):
            twice = [name for name in wanted if cells.count(name) > 1]
            if twice:
                raise ParseError(
                    str(file), number + 1, f"two columns {', '.join(twice)}", "one of each"
                )
            return number, cells
        if len(set(wanted) & set(cells)) > len(set(wanted) & set(best)):
            best = cells
    missing = [name for name in wanted if name not in best]
    raise ParseError(
        str(file),
        1,
        f"no heading with {', '.join(missing)}",
        f"the mapped columns {', '.join(wanted)}",
    )


def _row_numbers(
    file: Path,
    line: int,
    given: Mapping[str, str],
    wanted: Mapping[str, MappedQuantity],
    mach: float | None,
    decimal_comma: bool,
) -> list[dict[str, Any]]:
    """Return the numbers of one row."""
    place: dict[str, Any] = {"file": file.name, "line": line, "variable": "", "mach": mach}
    values: dict[str, float | None] = {}
    name_of_row = ""
    for column, quantity in wanted.items():
        if quantity.name == "coefficient":
            name_of_row = given[column]
            continue
        number = _read_number(file, line, given[column], decimal_comma)
        is_condition = quantity.unit or quantity.name == "mach"
        if not is_condition:
            values[quantity.name] = number
        elif number is None:
            raise ParseError(
                str(file), line, f"an empty cell of {column}", "a number: it states the condition"
            )
        else:
            place[quantity.name] = quantity.in_si(number)
    if "value" in values:
        if name_of_row not in COEFFICIENTS:
            raise ParseError(
                str(file),
                line,
                f"the coefficient {name_of_row!r}",
                f"one of {', '.join(COEFFICIENTS)}",
            )
        values = {name_of_row: values["value"]}
    rows = []
    for coefficient, value in values.items():
        if value is not None:
            rows.append(place | {"coefficient": coefficient, "value": value})
    return rows


def _read_matrix(
    file: Path, lines: Sequence[str], columns: ColumnMap
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows of one coefficient over two quantities, and the names of the controls."""
    down = parse_quantity_of_column(str(columns.rows))
    across = parse_quantity_of_column(str(columns.across))
    heads: list[float] = []
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(lines, 1):
        if _is_skipped(line):
            continue
        cells, decimal_comma = _split(line)
        if _is_units(cells):
            continue
        # The first line with numbers holds the values across.
        if not heads:
            heads = _read_heads(cells)
            continue
        if len(cells) != 1 + len(heads):
            raise ParseError(
                str(file), number, f"{len(cells)} cells", f"{1 + len(heads)}, as the heading has"
            )
        first, *values = [_read_number(file, number, cell, decimal_comma) for cell in cells]
        if first is None:
            raise ParseError(str(file), number, "an empty first cell", f"{down.name} of the row")
        for head, value in zip(heads, values):
            if value is None:
                continue
            place = {"mach": columns.mach, down.name: down.in_si(first)}
            place[across.name] = across.in_si(head)
            found = {"coefficient": columns.coefficient, "variable": "", "value": value}
            rows.append(place | found | {"file": file.name, "line": number})
    controls = []
    for quantity in (down, across):
        if quantity.unit and quantity.name not in _CONDITIONS:
            controls.append(quantity.name)
    return rows, controls


def _read_heads(cells: Sequence[str]) -> list[float]:
    """Return the numbers in the heading of a matrix; empty if the line is not one."""
    if len(cells) < 3 or len(cells) > _MOST_COLUMNS or _NUMBER.match(cells[0]):
        return []
    heads = []
    for cell in cells[1:]:
        # A heading may name the run or the control before the number: "V40 de=-10 deg".
        found = _NUMBERS.findall(cell)
        if not found:
            return []
        heads.append(float(found[-1].replace(",", ".")))
    return heads
