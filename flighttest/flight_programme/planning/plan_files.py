"""Files of a plan: tables, test inputs and test cards in one folder."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import ParseError
from flightmech.support.atomic_write import folder_written_atomically, write_text
from flighttest.flight_programme.input_design.input_signals import axes_of
from flighttest.flight_programme.input_design.timetable import save_csv, save_timetable
from flighttest.flight_programme.planning.cards import card_page
from flighttest.flight_programme.planning.expected_range import RANGE_COLUMNS
from flighttest.flight_programme.planning.plan import ProgrammePlan
from flighttest.flight_programme.planning.prediction import Item
from flighttest.records.text_tables import read_text_table

# Files and folders that a plan replaces.
_OURS = ("order.csv", "nodes.csv", "rows.csv", "expected.csv", "plan.txt", "inputs", "cards")


def save_plan(plan: ProgrammePlan, folder: str | os.PathLike) -> list[Path]:
    """Write a plan into a folder; the files of an earlier plan are replaced, other files stay.

    Parameters
    ----------
    plan : ProgrammePlan
    folder : path
        Folder for ``order.csv``, ``nodes.csv`` (the wanted nodes), ``rows.csv`` (the wanted
        rows, if any), ``expected.csv`` (all nodes), ``plan.txt``, ``inputs/`` with a CSV
        file and a time table for every test input, and ``cards/`` with a PDF page for every
        manoeuvre.

    Returns
    -------
    list of Path
        All files of the folder.

    Raises
    ------
    SchemaError
        Typst is not installed, or reports an error; its message is included.
    """
    with folder_written_atomically(Path(folder), _OURS.__contains__) as part:
        plan.order.to_csv(part / "order.csv", float_format="%.6g")
        plan.nodes.to_csv(part / "nodes.csv", index=False, float_format="%.6g")
        expected_table(plan).to_csv(part / "expected.csv", index=False, float_format="%.6g")
        if len(plan.rows):
            plan.rows.to_csv(part / "rows.csv", index=False, float_format="%.6g")
        write_text(part / "plan.txt", plan.report() + "\n")
        (part / "inputs").mkdir()
        (part / "cards").mkdir()
        # One card per item, and a file of its input.
        for number, item in enumerate(plan.items, 1):
            name = card_name(number, item)
            signal = plan.prediction.candidates[item].signal
            if signal is not None:
                _save_input(signal, part / "inputs" / name, title=", ".join(item))
            (part / "cards" / f"{name}.pdf").write_bytes(card_page(plan, number, name))
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())


def _save_input(signal: xr.Dataset, path: Path, *, title: str) -> None:
    """Write a test input as CSV and as a time table; a time table has no resting axis."""
    save_csv(signal, f"{path}.csv")
    resting = [name for name in axes_of(signal) if not signal[name].any()]
    save_timetable(signal.drop_vars(resting), f"{path}.table", title=title)


def read_order(folder: str | os.PathLike) -> list[Item]:
    """Return condition and manoeuvre of the cards of a plan from its folder.

    Raises
    ------
    ParseError
        The folder has no ``order.csv`` with columns ``condition`` and ``manoeuvre``.
    """
    file = Path(folder) / "order.csv"
    expected = "the order of a plan as `aeromatch flight plan` writes it"
    if not file.is_file():
        raise ParseError(str(file), 0, "no such file", expected)
    table = read_text_table(file, expected)
    if not {"condition", "manoeuvre"} <= set(table.names):
        raise ParseError(str(file), 1, f"columns {', '.join(table.names)}", expected)
    items = []
    for row in range(len(table.rows)):
        items.append((table.text(row, "condition"), table.text(row, "manoeuvre")))
    return items


def card_name(number: int, item: Item) -> str:
    """Return the name of the files of a card, such as ``03_clean-cruise_multisine``."""
    parts = [re.sub(r"[^0-9A-Za-z]+", "-", part).strip("-").lower() for part in item]
    return "_".join([f"{number:02d}", *parts])


def expected_table(plan: ProgrammePlan) -> pd.DataFrame:
    """Return the expected standard errors of all nodes.

    The columns are ``term``, ``place`` (indices of the node along the axes) and ``expected``, and
    with draws the range ``low``, ``median``, ``high``.
    """
    rows: list[tuple[Any, ...]] = []
    columns = ["term", "place", "expected"]
    if plan.ranges:
        columns += RANGE_COLUMNS
    for name, stderr in plan.expected.items():
        tables = []
        for key in columns[3:]:
            # a term that no fit informs keeps its error in all draws
            tables.append(plan.ranges[name][key].values if name in plan.ranges else stderr)
        for node, value in np.ndenumerate(stderr):
            if np.isfinite(value):
                place = " ".join(map(str, node))
                rows.append((name, place, value, *(float(table[node]) for table in tables)))
    return pd.DataFrame(rows, columns=columns)
