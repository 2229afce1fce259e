"""The files of a plan: tables, inputs to play, test cards."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pandas as pd

from flightmech.errors import ParseError
from flightmech.support.atomic_write import folder_written_atomically, write_text

from ..input_design.timetable import save_csv, save_timetable
from .cards import card_page
from .plan import Plan
from .prediction import Item

_OURS = ("order.csv", "nodes.csv", "expected.csv", "plan.txt", "inputs", "cards")


def save_plan(plan: Plan, folder: str | os.PathLike) -> list[Path]:
    """Write a plan into a folder; what an earlier plan wrote there is replaced, other files stay.

    Parameters
    ----------
    plan : Plan
    folder : path
        Gets ``order.csv``, ``nodes.csv`` (the wanted ones), ``expected.csv`` (all nodes), ``plan.txt``, ``inputs/`` with a CSV file and a
        time table for every test input, and ``cards/`` with a PDF page for every manoeuvre.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    SchemaError
        Typst is not installed, or cannot set a card, with its words.
    """
    with folder_written_atomically(Path(folder), _OURS.__contains__) as part:
        plan.order.to_csv(part / "order.csv", float_format="%.6g")
        plan.nodes.to_csv(part / "nodes.csv", index=False, float_format="%.6g")
        expected_table(plan).to_csv(part / "expected.csv", index=False, float_format="%.6g")
        write_text(part / "plan.txt", plan.report() + "\n")
        (part / "inputs").mkdir()
        for number, item in enumerate(plan.items, 1):
            signal = plan.prediction.candidates[item].signal
            if signal is not None:
                save_csv(signal, part / "inputs" / f"{card_name(number, item)}.csv")
                moving = signal.drop_vars([name for name in signal.data_vars if signal[name].dims == ("time",) and not signal[name].any()])
                save_timetable(moving, part / "inputs" / f"{card_name(number, item)}.table", ", ".join(item))
        (part / "cards").mkdir()
        for number, item in enumerate(plan.items, 1):
            name = card_name(number, item)
            (part / "cards" / f"{name}.pdf").write_bytes(card_page(plan, number, name))
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())


def read_order(folder: str | os.PathLike) -> list[Item]:
    """Return condition and manoeuvre of the cards of a plan from its folder.

    Raises
    ------
    ParseError
        The folder holds no ``order.csv`` with columns ``condition`` and ``manoeuvre``.
    """
    file = Path(folder) / "order.csv"
    try:
        table = pd.read_csv(file, dtype=str)
        return list(zip(table["condition"], table["manoeuvre"], strict=True))
    except (OSError, ValueError, KeyError) as error:
        raise ParseError(str(file), 0, str(error), "the order of a plan as `aeromatch flight plan` writes it") from error


def card_name(number: int, item: Item) -> str:
    """Return the name of the files of a card, such as ``03_clean-cruise_multisine``."""
    return "_".join([f"{number:02d}", *(re.sub(r"[^0-9A-Za-z]+", "-", part).strip("-").lower() for part in item)])


def expected_table(plan: Plan) -> pd.DataFrame:
    """Return the expected standard errors of all nodes: ``term``, its axes as text, ``expected``."""
    rows = []
    for name, stderr in plan.expected.items():
        for place, value in np.ndenumerate(stderr):
            if np.isfinite(value):
                rows.append({"term": name, "place": " ".join(map(str, place)), "expected": value})
    return pd.DataFrame(rows, columns=["term", "place", "expected"])
