"""A characteristic as one row: its number, or a text why there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

COLUMNS = ("group", "quantity", "value", "units", "remark", "absent")


class Row(NamedTuple):
    """One quantity; `value` is NaN and `absent` states why when aircraft, database or flight do not give it."""

    group: str
    quantity: str
    value: float
    units: str
    remark: str = ""
    absent: str = ""


def absent(group: str, quantities: dict[str, str], reason: str) -> list[Row]:
    """Return rows without numbers for quantities (name: unit) that share a reason."""
    return [Row(group, name, np.nan, units, absent=reason) for name, units in quantities.items()]


def frame(rows: list[Row]) -> pd.DataFrame:
    """Return rows as a table, indexed by the quantity."""
    return pd.DataFrame(rows, columns=list(COLUMNS)).set_index("quantity")
