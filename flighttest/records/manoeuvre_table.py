"""Manoeuvres as a table in CSV or TOML, for records that carry no marks.

A row is ``record, kind, control, start, end`` and, where wanted, ``note`` and ``confidence``; a
TOML file holds the same keys in tables ``[[manoeuvre]]``.  Times are seconds of the record, or a
number with its unit (``"1.5 min"``).
"""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import BeforeValidator, Field, model_validator

from flightmech.errors import ParseError, SchemaError, UnitError
from flightmech.support.atomic_write import write_text
from flightmech.support.input_files import WESTERN, csv_rows, read_text, read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_quantity

COLUMNS = ("record", "kind", "control", "start", "end", "confidence", "note")
"""Columns of a table as it is written; ``confidence`` and ``note`` may be absent when it is read."""

_TIMES = ("start", "end")


def _text(item: object) -> object:
    return (
        str(item) if isinstance(item, int) and not isinstance(item, bool) else item
    )  # a 3-2-1-1 is a number in TOML


def _seconds(item: Any) -> float:
    try:
        return float(item)  # a cell of a CSV file is a text
    except (ValueError, TypeError):
        pass
    try:
        return parse_quantity(item, "s")
    except UnitError as error:
        raise ValueError(str(error)) from error


_Text = Annotated[str, BeforeValidator(_text)]
_Time = Annotated[float, BeforeValidator(_seconds)]


class Marked(Strict):
    """One manoeuvre of a table."""

    record: Annotated[_Text, Field(min_length=1)]
    kind: Annotated[_Text, Field(min_length=1)]
    control: str = ""
    start: _Time
    end: _Time
    confidence: str | float = ""
    note: str = ""

    @model_validator(mode="after")
    def _forward(self) -> Marked:
        if not (np.isfinite(self.start) and np.isfinite(self.end) and self.start < self.end):
            raise ValueError(
                f"start {self.start:g} s and end {self.end:g} s; the end lies after the "
                f"start, both in seconds of the record"
            )
        return self

    def as_row(self) -> dict[str, object]:
        """Return the manoeuvre as a record lists it."""
        about = {"confidence": self.confidence} if self.confidence != "" else {}
        return {
            "manoeuvre": self.kind,
            "control": self.control,
            "start": self.start,
            "end": self.end,
            "note": self.note,
            **about,
        }


class _ManoeuvreRows(Strict):
    manoeuvre: tuple[Marked, ...]


def read_manoeuvres(path: str | Path) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres of a table by the name of the record.

    Parameters
    ----------
    path : path
        A CSV file (separated by commas, or by semicolons, then with decimal points or commas; a
        line of names first), or a file ``.toml`` with tables ``[[manoeuvre]]``.

    Returns
    -------
    dict of str to DataFrame
        ``manoeuvre control start end note`` by record, as `flighttest.manoeuvres` gives them, in
        order of time. [s]

    Raises
    ------
    ParseError
        Not TOML, no line of names, a row of another length.
    SchemaError
        Unknown or missing columns, cells that are not a time, ends before their start; all of them.
    """
    return {record: pd.DataFrame(rows)[_SHOWN] for record, rows in _rows(Path(path)).items()}


_SHOWN = ["manoeuvre", "control", "start", "end", "note"]


def _rows(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the manoeuvres of a table in order of time, with their ``confidence``; empty where
    there is none.
    """
    rows = validate_content(
        _ManoeuvreRows, read_toml(path) if path.suffix.lower() == ".toml" else _csv(path), str(path)
    ).manoeuvre
    found: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: row.start):
        found.setdefault(row.record, []).append({"confidence": "", **row.as_row()})
    return found


def _csv(path: Path) -> dict[str, object]:
    """Return a CSV file as the tables of a TOML file; a row is called by its line."""
    text = read_text(path, "a CSV text with the columns " + ", ".join(COLUMNS[:5]), WESTERN)
    first = text.split("\n", 1)[0]
    separator = ";" if first.count(";") > first.count(",") else ","
    lines = csv_rows(text, path, separator)
    names = [name.strip() for name in lines[0]] if lines else []
    missing = [name for name in COLUMNS[:5] if name not in names]
    unknown = [name for name in names if name not in COLUMNS]
    if missing or unknown:
        problems = [f"no column {name!r}" for name in missing] + [
            f"unknown column {name!r}" for name in unknown
        ]
        allowed = (
            f"its line of names is {', '.join(COLUMNS[:5])}, and where wanted "
            f"{', '.join(COLUMNS[5:])}"
        )
        raise SchemaError(str(path), [f"{problem}; {allowed}" for problem in problems])
    rows: list[dict[str, str]] = []
    for number, line in enumerate(lines[1:], start=2):
        if line and len(line) != len(names):
            raise ParseError(
                str(path),
                number,
                f"{len(line)} cells",
                f"{len(names)}, as the line of names has; quote texts with commas",
            )
        if any(line):
            row = dict(zip(names, (cell.strip() for cell in line), strict=True))
            decimal = {name: row[name].replace(",", ".") for name in _TIMES if separator == ";"}
            rows.append({**row, **decimal})
    return {"manoeuvre": rows}


def write_manoeuvres(tables: dict[str, pd.DataFrame], path: str | Path) -> None:
    """Write manoeuvres as a CSV table that `read_manoeuvres` reads.

    Parameters
    ----------
    tables : dict of str to DataFrame
        By record, with the columns of `flighttest.manoeuvres`, and ``confidence`` where known.
    path : path
        Written atomically.
    """
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(COLUMNS)
    for record, table in tables.items():
        for row in table.to_dict("records"):
            times = [f"{row['start']:.10g}", f"{row['end']:.10g}"]
            confidence = row.get("confidence", "")
            shown = confidence if isinstance(confidence, str) else f"{confidence:.2f}"
            writer.writerow(
                [record, row["manoeuvre"], row["control"], *times, shown, row.get("note", "")]
            )
    write_text(path, target.getvalue())


def with_manoeuvres(record: xr.DataTree, table: pd.DataFrame) -> xr.DataTree:
    """Return a record with a list of manoeuvres in place of its own.

    Parameters
    ----------
    record : DataTree
        Flight record.
    table : DataFrame
        With the columns of `flighttest.manoeuvres`.

    Returns
    -------
    DataTree
        The data are shared with `record`.
    """
    copy = record.copy(deep=False)
    copy.attrs = {**record.attrs, "manoeuvres": json.dumps(table.to_dict("records"))}
    return copy


def edit_manoeuvres(
    path: str | Path,
    record: str,
    row: int | None,
    change: dict[str, Any] | None,
    start: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Add, change or remove one row of a table in CSV, and return the rows of its record as they
    are then.

    Parameters
    ----------
    path : path
        The table; written atomically, and made when it is not there.
    record : str
    row : int or None
        Row of the record in order of time, from 1; None adds one.
    change : dict or None
        ``kind control start end note`` as far as they change; None removes the row.
    start : DataFrame, optional
        The marks that the record carries: its first rows where the table has none of it.

    Raises
    ------
    SchemaError
        The table is TOML; no such row; a manoeuvre without a kind or a time, or that ends before it
        starts.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        raise SchemaError(str(path), ["a table in TOML is edited by hand; name a CSV file"])
    tables = _rows(path) if path.exists() else {}
    own = [] if start is None else start.to_dict("records")
    rows: list[dict[str, Any]] = tables.get(
        record,
        [{"confidence": "", **{str(name): item for name, item in one.items()}} for one in own],
    )
    if row is not None and not 1 <= row <= len(rows):
        raise SchemaError(str(path), [f"row {row} of record {record}; it has {len(rows)}"])
    if row is None and change is None:
        raise SchemaError(str(path), ["nothing to remove; give the row"])
    old = {} if row is None else rows.pop(row - 1)
    if change is not None:
        if old:
            old["kind"] = old.pop("manoeuvre")
        moved = (
            {} if {"start", "end"}.isdisjoint(change) else {"confidence": ""}
        )  # that of the search was of the old times
        about = validate_content(
            _ManoeuvreRows, {"manoeuvre": [{**old, **moved, **change, "record": record}]}, str(path)
        ).manoeuvre[0]
        rows.append({"confidence": "", **about.as_row()})
    rows.sort(key=lambda one: one["start"])
    write_manoeuvres(
        {name: pd.DataFrame(items) for name, items in {**tables, record: rows}.items() if items},
        path,
    )
    return pd.DataFrame(rows, columns=_SHOWN)
