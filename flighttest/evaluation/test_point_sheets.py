"""Columns of a sheet that goes with a flight: loading, test points, points of an engine deck; CSV with a line of names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.support.configuration import Strict
from flightmech.support.input_files.text import WESTERN, csv_rows, read_text
from flightmech.units import to_si


class Column(Strict):
    """One column: its name, its unit, and a factor for what the unit cannot express (``scale = 100`` with ``unit = "in lb"``)."""

    column: str
    unit: str = ""
    scale: float = 1.0

    def of(self, sheet: Sheet, expected: str) -> np.ndarray:
        """Return the column in SI.

        Parameters
        ----------
        sheet : Sheet
        expected : str
            SI unit of the quantity.

        Raises
        ------
        SchemaError
            The unit is another quantity, or a cell is not a number; cells left empty are NaN.
        UnknownName
            No such column.
        """
        x = np.array([sheet.number(row, self.column) for row in range(len(sheet.rows))], float)
        try:
            return to_si(self.scale * x, self.unit or expected, expected)
        except UnitError as error:
            raise SchemaError(f"sheet {sheet.path}", [f"column {self.column}: {error}"]) from None


class Sheet:
    """A CSV file as text cells.

    Parameters
    ----------
    path : path

    Raises
    ------
    ParseError
        No line of names, or a row of another length.
    """

    def __init__(self, path: Path):
        self.path = path
        lines = [line for line in csv_rows(read_text(path, "a sheet in CSV with a line of names", WESTERN), path) if line]
        if len(lines) < 2:
            raise ParseError(str(path), 1, f"{len(lines)} lines", "a line of column names and a line for each row")
        self.names, self.rows = lines[0], lines[1:]
        for number, row in enumerate(self.rows, start=2):
            if len(row) != len(self.names):
                raise ParseError(str(path), number, f"{len(row)} cells", f"{len(self.names)}, as the line of names has")

    def text(self, row: int, column: str) -> str:
        """Return one cell."""
        if column not in self.names:
            raise UnknownName(column, self.names, "column", f"sheet {self.path}")
        return self.rows[row][self.names.index(column)].strip()

    def number(self, row: int, column: str) -> float:
        """Return one cell as a number, NaN where it is empty."""
        text = self.text(row, column)
        try:
            return float(text) if text else float("nan")
        except ValueError:
            raise ParseError(str(self.path), row + 2, f"{text!r} in column {column}", "a number") from None
