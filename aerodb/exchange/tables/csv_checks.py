"""Tables of check cases of a database as CSV files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.exchange.tables.csv_text import read_csv, si_column, written_csv
from aerodb.store.evaluation import (
    SEED,
    TOLERANCE,
    check_case_inputs,
    compare_output,
    outputs_at,
    random_states,
)
from aerodb.store.schema import require_valid
from flightmech.errors import ParseError, SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import write_text

CHECK_FORMAT = "aeromatch check cases, format 1"
_COUNT = 200


def export_checkcases(
    db: xr.DataTree, path: str | os.PathLike[str], count: int = _COUNT, seed: int = SEED
) -> None:
    """Write a table of check cases: states in SI, contributions ``CL/basic``, coefficients ``CL``.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        CSV file to write, atomically.
    count : int
        Number of cases.
    seed : int
        Seed of the random numbers.  The same seed gives the same cases.
    """
    require_valid(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    # Columns with a unit are inputs, columns without are outputs.
    header = ["case", *(f"{name} [{lookup(name).units}]" for name in inputs), *outputs]
    columns = [map(repr, values.tolist()) for values in (*inputs.values(), *outputs.values())]
    facts: dict[str, Any] = {}
    for key in ("title", "aircraft", "force_axes", "S", "cbar", "b"):
        facts[key] = db.attrs[key]
    facts["agreement"] = (
        f"no output differs by more than {TOLERANCE:g} of the largest magnitude of its column"
    )
    facts["beyond_a_table"] = (
        "the end value holds, or the last line goes on where the term has outside = linear"
    )
    facts |= {"count": count, "seed": seed}
    rows = []
    for number, cells in enumerate(zip(*columns, strict=True), 1):
        rows.append([str(number), *cells])
    write_text(path, written_csv(CHECK_FORMAT, facts, header, rows))


def run_checkcases(db: xr.DataTree, path: str | os.PathLike[str]) -> pd.DataFrame:
    """Compare a database with a table of check cases.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        CSV file of `export_checkcases`.

    Returns
    -------
    DataFrame, index ``output``
        ``largest_difference`` (database minus table, signed), ``case`` (where it is),
        ``tolerance``, ``failed`` (number of cases beyond it), ``agrees``.  A term that the database
        lacks counts as zero.

    Raises
    ------
    ParseError
        The file is not a table of check cases.
    SchemaError
        Columns or cells that cannot be read; all of them, with file and line.
    """
    path = Path(path)
    table, problems = read_csv(path)
    if table.title != CHECK_FORMAT:
        raise ParseError(
            str(path),
            1,
            repr(table.title),
            f"'# {CHECK_FORMAT}' as aerodb.exchange.export_checkcases writes it",
        )
    # All faulty columns are listed in one error.
    inputs, expected = {}, {}
    for name in table.columns:
        if table.units[name]:
            inputs[name] = si_column(table, name, problems)
    for name in table.columns:
        if not table.units[name] and name != "case":
            expected[name] = si_column(table, name, problems)
    for name in check_case_inputs(db):
        if name not in inputs:
            problems.append(
                f"{path.name}: no column {name} [{lookup(name).units}], which the database needs"
            )
    if problems:
        raise SchemaError(str(path), problems)
    # A term that the database lacks is zero.
    outputs = outputs_at(db, inputs, len(table.lines))
    rows = {}
    for name, column in expected.items():
        rows[name] = compare_output(outputs.get(name, np.zeros(len(table.lines))), column)
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("output")
