"""Check cases: states in, the contribution of every term and every coefficient out, for any other implementation of a database.

The cases lie inside the cells of the tables, on breakpoints and beyond the ends, where the rule of each term holds (attribute
``outside``).  An implementation agrees when no output differs by more than 1e-9 of the largest magnitude of its column: room for
another order of the operations, none for another formula.  The cases may also travel in the group ``/checks`` of a database,
inputs and coefficients there, with a ``CL_tolerance`` where another source of the cases gave one, contributions in
``/checks/terms/<coefficient>``; saving and opening run them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import ParseError, SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import write_text

from ...store.schema import require
from ...store.stored_checks import SEED, TOLERANCE, agreement, needed_inputs, outputs_at, random_states
from .csv_text import read_csv, si_column, written_csv

CHECK_FORMAT = "aeromatch check cases, format 1"
_COUNT = 200


def export_checkcases(db: xr.DataTree, path: str | os.PathLike, count: int = _COUNT, seed: int = SEED) -> None:
    """Write a table of check cases: states in SI, contributions as ``CL/basic``, coefficients as ``CL``.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        CSV file to write, atomically.
    count : int
        Number of cases.
    seed : int
        Of the random numbers; the same seed gives the same cases.
    """
    require(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    header = ["case", *(f"{name} [{lookup(name).units}]" for name in inputs), *outputs]
    columns = [map(repr, values.tolist()) for values in (*inputs.values(), *outputs.values())]
    facts: dict[str, Any] = {key: db.attrs[key] for key in ("title", "aircraft", "force_axes", "S", "cbar", "b")}
    facts["agreement"] = f"no output differs by more than {TOLERANCE:g} of the largest magnitude of its column"
    facts["beyond_a_table"] = "the end value holds, or the last line goes on where the term has outside = linear"
    facts |= {"count": count, "seed": seed}
    rows = [[str(number), *cells] for number, cells in enumerate(zip(*columns), 1)]
    write_text(path, written_csv(CHECK_FORMAT, facts, header, rows))


def run_checkcases(db: xr.DataTree, path: str | os.PathLike) -> pd.DataFrame:
    """Return how a database agrees with a table of check cases.

    Returns
    -------
    DataFrame, index ``output``
        ``largest_difference`` (database minus table, signed), ``case`` (where it is), ``tolerance``, ``failed`` (number of cases beyond
        it), ``agrees``.  A term that the database lacks counts as zero.

    Raises
    ------
    ParseError
        Not a table of check cases.
    SchemaError
        Columns or cells that cannot be read; all of them, with file and line.
    """
    table, problems = read_csv(Path(path))
    if table.title != CHECK_FORMAT:
        raise ParseError(str(path), 1, repr(table.title), f"'# {CHECK_FORMAT}' as aerodb.exchange.export_checkcases writes it")
    inputs = {name: si_column(table, name, problems) for name in table.columns if table.units[name]}
    expected = {name: si_column(table, name, problems) for name in table.columns if not table.units[name] and name != "case"}
    missing = [name for name in needed_inputs(db) if name not in inputs]
    problems += [f"{Path(path).name}: no column {name} [{lookup(name).units}], which the database needs" for name in missing]
    if problems:
        raise SchemaError(str(path), problems)
    found = outputs_at(db, inputs, len(table.lines))
    rows = {name: agreement(found.get(name, np.zeros(len(table.lines))), column) for name, column in expected.items()}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("output")
