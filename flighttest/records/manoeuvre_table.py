"""Tables of manoeuvres in CSV or TOML, for records without a list of manoeuvres.

A row has ``record, kind, control, start, end`` and optionally ``note`` and ``confidence``.  A TOML
file has the same keys in tables ``[[manoeuvre]]``.  Times are seconds of the record, or a number
with its unit (``"1.5 min"``).
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from flightmech.errors import SchemaError, UnitError
from flightmech.quantities import parse_quantity, time_text
from flightmech.support.atomic_write import ContentAsRead, write_text
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flighttest.records.text_tables import read_text_table

COLUMNS = ("record", "kind", "control", "start", "end", "confidence", "note")
"""Columns of a table; ``confidence`` and ``note`` are optional."""

_REQUIRED, _OPTIONAL = COLUMNS[:5], COLUMNS[5:]
_TIMES = ("start", "end")
# Columns of the table of a record.
_RECORD_COLUMNS = ["manoeuvre", "control", "start", "end", "note"]


def _to_text(item: object) -> object:
    """Return an integer as text: a 3-2-1-1 without quotes is a number in TOML."""
    if isinstance(item, int) and not isinstance(item, bool):
        return str(item)
    return item


def _to_seconds(item: Any) -> float:
    """Return a time in seconds."""
    try:
        # A cell of a CSV file is a text.
        return float(item)
    except (ValueError, TypeError):
        pass
    try:
        return parse_quantity(item, "s")
    except UnitError as error:
        raise ValueError(str(error)) from error


_Text = Annotated[str, BeforeValidator(_to_text)]
_Time = Annotated[float, BeforeValidator(_to_seconds)]


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
    def _check_order(self) -> Marked:
        is_finite = np.isfinite(self.start) and np.isfinite(self.end)
        if not (is_finite and self.start < self.end):
            raise ValueError(
                f"start {time_text(self.start)} s and end {time_text(self.end)} s; the end lies "
                "after the "
                f"start, both in seconds of the record"
            )
        return self

    def as_row(self) -> dict[str, object]:
        """Return the manoeuvre as a row of the list of a record."""
        row: dict[str, object] = {
            "manoeuvre": self.kind,
            "control": self.control,
            "start": self.start,
            "end": self.end,
            "note": self.note,
        }
        if self.confidence != "":
            row["confidence"] = self.confidence
        return row


class _ManoeuvreRows(Strict):
    manoeuvre: tuple[Marked, ...]


def read_manoeuvres(path: str | Path) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres of a table by the name of the record.

    Parameters
    ----------
    path : path
        A CSV file, or a file ``.toml`` with tables ``[[manoeuvre]]``.  The first line of a CSV file
        has the names of the columns.  The separator is the comma, or the semicolon with decimal
        points or commas.

    Returns
    -------
    dict of str to DataFrame
        ``manoeuvre control start end note`` by record, as in
        `flighttest.records.marked_manoeuvres`, in order of time. [s]

    Raises
    ------
    ParseError
        Not TOML, no line of names, a row of another length.
    SchemaError
        Unknown or missing columns, cells that are not a time, ends before their start; all of them.
    """
    return _tables_of(_read_rows(Path(path)))


def _tables_of(rows: dict[str, list[dict[str, Any]]]) -> dict[str, pd.DataFrame]:
    """Return the rows of each record as a table without confidence."""
    return {record: pd.DataFrame(items)[_RECORD_COLUMNS] for record, items in rows.items()}


def read_sound_manoeuvres(
    path: str | Path,
) -> tuple[dict[str, pd.DataFrame], dict[str, set[str]], list[str]]:
    """Return the manoeuvres of the rows without a fault, and what is wrong with the others.

    Parameters
    ----------
    path : path
        As for `read_manoeuvres`.

    Returns
    -------
    tables : dict of str to DataFrame
        As of `read_manoeuvres`. [s]
    faulty : dict of str to set of str
        Names of the manoeuvres of faulty rows by record: the kind, and kind and control.
    problems : list of str
        Those of `read_manoeuvres`.

    Raises
    ------
    ParseError, SchemaError
        No row can be read: as of `read_manoeuvres`.
    """
    try:
        return read_manoeuvres(path), {}, []
    except SchemaError as error:
        content = _read_content(Path(path))
        rows = content.get("manoeuvre")
        if not isinstance(rows, list | tuple) or not all(isinstance(row, dict) for row in rows):
            raise
        problems = error.problems
    sound: list[Marked] = []
    faulty: dict[str, set[str]] = {}
    for row in rows:
        try:
            sound.append(Marked.model_validate(row))
        except ValidationError:
            kind = str(row.get("kind", ""))
            names = faulty.setdefault(str(row.get("record", "")), set())
            names |= {kind, f"{kind} {row.get('control', '')}".strip()}
    return _tables_of(_rows_by_record(sound)), faulty, problems


def _read_rows(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of each record in order of time.

    A row without a confidence has an empty text.
    """
    content = _read_content(path)
    return _rows_by_record(validate_content(_ManoeuvreRows, content, str(path)).manoeuvre)


def _read_content(path: Path) -> dict[str, Any]:
    """Return the content of a table, CSV as that of a TOML file."""
    return read_toml(path) if path.suffix.lower() == ".toml" else _read_csv(path)


def _rows_by_record(manoeuvres: Iterable[Marked]) -> dict[str, list[dict[str, Any]]]:
    """Return manoeuvres as rows of each record in order of time."""
    rows: dict[str, list[dict[str, Any]]] = {}
    for manoeuvre in sorted(manoeuvres, key=lambda manoeuvre: manoeuvre.start):
        row = {"confidence": "", **manoeuvre.as_row()}
        rows.setdefault(manoeuvre.record, []).append(row)
    return rows


def _read_csv(path: Path) -> dict[str, object]:
    """Return a CSV file as the content of a TOML file."""
    table = read_text_table(path, "a CSV text with the columns " + ", ".join(_REQUIRED))
    _check_columns(table.names, path)
    rows: list[dict[str, str]] = []
    for cells in table.rows:
        row = dict(zip(table.names, cells, strict=True))
        for name in _TIMES:
            row[name] = table.with_point(row[name])
        rows.append(row)
    return {"manoeuvre": rows}


def _check_columns(names: list[str], path: Path) -> None:
    """Raise for missing and unknown columns of a CSV file."""
    problems = [f"no column {name!r}" for name in _REQUIRED if name not in names]
    problems += [f"unknown column {name!r}" for name in names if name not in COLUMNS]
    if problems:
        allowed = (
            f"its line of names is {', '.join(_REQUIRED)}, and where wanted {', '.join(_OPTIONAL)}"
        )
        raise SchemaError(str(path), [f"{problem}; {allowed}" for problem in problems])


def write_manoeuvres(
    tables: dict[str, pd.DataFrame],
    path: str | Path,
    before: Callable[[Path], None] | None = None,
) -> None:
    """Write manoeuvres as a CSV table that `read_manoeuvres` reads.

    Parameters
    ----------
    tables : dict of str to DataFrame
        By record, with the columns of `flighttest.records.marked_manoeuvres`, and ``confidence``
        where known.
    path : path
        Written atomically.
    before : callable, optional
        As in `flightmech.support.atomic_write.written_atomically`.
    """
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(COLUMNS)
    for record, table in tables.items():
        for row in table.to_dict("records"):
            times = [f"{row['start']:.10g}", f"{row['end']:.10g}"]
            confidence = row.get("confidence", "")
            if not isinstance(confidence, str):
                confidence = f"{confidence:.2f}"
            note = row.get("note", "")
            writer.writerow([record, row["manoeuvre"], row["control"], *times, confidence, note])
    write_text(path, target.getvalue(), before=before)


def with_manoeuvres(record: xr.DataTree, table: pd.DataFrame) -> xr.DataTree:
    """Return a record with another list of manoeuvres.

    Parameters
    ----------
    record : DataTree
        Flight record.
    table : DataFrame
        With the columns of `flighttest.records.marked_manoeuvres`.

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
    """Add, change or remove one row of a CSV table, and return the rows of its record.

    Parameters
    ----------
    path : path
        The table.  It is written atomically, and created if it does not exist.
    record : str
        Name of the record.
    row : int or None
        Row of the record in order of time, from 1.  None adds a row.
    change : dict or None
        New values of ``kind control start end note``.  None removes the row.
    start : DataFrame, optional
        Manoeuvres of the record.  They are its first rows if the table has no row of it.

    Raises
    ------
    SchemaError
        The table is TOML, or has no such row.  A manoeuvre has no kind or time, or ends before it
        starts.  Another program changed the table in the meantime.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        raise SchemaError(str(path), ["a table in TOML is edited by hand; name a CSV file"])
    # Another program may change the table between reading and writing.
    as_read = ContentAsRead(path)
    tables = _read_rows(path) if path.exists() else {}
    rows = tables.get(record)
    if rows is None:
        rows = [] if start is None else _rows_of_record(start)
    if row is not None and not 1 <= row <= len(rows):
        raise SchemaError(str(path), [f"row {row} of record {record}; it has {len(rows)}"])
    if row is None and change is None:
        raise SchemaError(str(path), ["nothing to remove; give the row"])
    # A changed row is removed and added again, so that the rows stay in order of time.
    old = {} if row is None else rows.pop(row - 1)
    if change is not None:
        rows.append(_change_row(old, change, record, path))
    rows.sort(key=lambda item: item["start"])
    tables[record] = rows
    marked = {name: pd.DataFrame(items) for name, items in tables.items() if items}
    write_manoeuvres(marked, path, as_read.demand_unchanged)
    return pd.DataFrame(rows, columns=_RECORD_COLUMNS)


def _rows_of_record(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the manoeuvres that a record lists, as rows of a table."""
    rows = []
    for row in table.to_dict("records"):
        cells = {str(name): cell for name, cell in row.items()}
        rows.append({"confidence": "", **cells})
    return rows


def _change_row(
    old: dict[str, Any], change: dict[str, Any], record: str, path: Path
) -> dict[str, Any]:
    """Return a row with other values; `old` is empty for a new row."""
    cells = dict(old)
    if cells:
        cells["kind"] = cells.pop("manoeuvre")
    # The confidence of the search applies to the times that it found.
    if "start" in change or "end" in change:
        cells["confidence"] = ""
    content = {"manoeuvre": [{**cells, **change, "record": record}]}
    manoeuvre = validate_content(_ManoeuvreRows, content, str(path)).manoeuvre[0]
    return {"confidence": "", **manoeuvre.as_row()}
