"""CSV files of texts and numbers, typed or exported by people: a line of names, then rows.

Cells are separated by commas, or by semicolons if the line of names has more of them. With
semicolons, a comma inside a number is a decimal comma.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from flightmech.errors import ParseError, UnknownName
from flightmech.support.input_files import WESTERN, csv_rows, read_text


@dataclass(frozen=True)
class TextTable:
    """Cells of a CSV file, without the blanks around them.

    Attributes
    ----------
    path : Path
    names : list of str
        Cells of the first line.
    rows : list of list of str
        Rows with text in any cell, each with as many cells as `names`.
    lines : list of int
        Line of each row in the file.
    has_decimal_comma : bool
        Whether a comma in a number is a decimal comma.
    """

    path: Path
    names: list[str]
    rows: list[list[str]]
    lines: list[int]
    has_decimal_comma: bool

    def text(self, row: int, column: str) -> str:
        """Return one cell.

        Raises
        ------
        UnknownName
            The table does not have the column.
        """
        if column not in self.names:
            raise UnknownName(column, self.names, "column", f"sheet {self.path}")
        return self.rows[row][self.names.index(column)]

    def number(self, row: int, column: str) -> float:
        """Return one cell as a number, NaN if it is empty.

        Raises
        ------
        ParseError
            The cell is not a number.
        UnknownName
            The table does not have the column.
        """
        text = self.text(row, column)
        if not text:
            return math.nan
        try:
            return float(self.with_point(text))
        except ValueError:
            found = f"{text!r} in column {column}"
            raise ParseError(str(self.path), self.lines[row], found, "a number") from None

    def with_rows(self, indices: Sequence[int]) -> TextTable:
        """Return the table with some of its rows."""
        rows, lines = [self.rows[row] for row in indices], [self.lines[row] for row in indices]
        return replace(self, rows=rows, lines=lines)

    def with_point(self, cell: str) -> str:
        """Return the cell of a number with a decimal point."""
        return cell.replace(",", ".") if self.has_decimal_comma else cell


def read_text_table(path: str | os.PathLike[str], expected: str) -> TextTable:
    """Return the cells of a CSV file.

    Parameters
    ----------
    path : path
    expected : str
        Expected content of the file, for an error.

    Raises
    ------
    OSError
        The file does not exist, or cannot be read.
    ParseError
        The file is not a text, or a row has another number of cells than the line of names.
    """
    text = read_text(path, expected, WESTERN)
    head = text.split("\n", 1)[0]
    separator = ";" if head.count(";") > head.count(",") else ","
    cells = csv_rows(text, path, separator)
    names = [name.strip() for name in cells[0]] if cells else []
    rows, lines = [], []
    for line, row in enumerate(cells[1:], start=2):
        stripped = [cell.strip() for cell in row]
        if not any(stripped):
            continue
        if len(row) != len(names):
            raise ParseError(
                str(path),
                line,
                found=f"{len(row)} cells",
                expected=f"{len(names)}, as the line of names has; quote texts with commas",
            )
        rows.append(stripped)
        lines.append(line)
    return TextTable(Path(path), names, rows, lines, separator == ";")
