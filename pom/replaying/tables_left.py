"""Which tables a run left: variable, end of the range, by how much, when."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightmech.errors import AeromatchError
from flightmech.simulation.kernel import AXIS
from flightmech.units import from_si

from ..judging.evidence import flown_model
from ..judging.watch import SLOWEST
from ..tolerances.derived_channels import output_of
from ..tolerances.remarks import RowRemark

NEGLIGIBLE = 1e-3  # of the range: what a table holds there is as good as what it would be


FLOW = ("alpha", "beta")  # mean nothing on an aeroplane that stands


class TableRange(NamedTuple):
    """Range of the tables of a model over one variable. [SI]"""

    variable: str
    low: float
    high: float
    unit: str


@lru_cache(maxsize=64)
def table_ranges(fmu: str | Path, sha256: str) -> tuple[TableRange, ...]:
    """Return the ranges of the tables inside an FMU, each once; none for an FMU of another program or of another version of this one.

    Parameters
    ----------
    fmu : path
    sha256 : str
        Of its content, so that a file that was replaced is read again.
    """
    try:
        model = flown_model(fmu)
        rows = () if model is None else model.entries(AXIS)
    except AeromatchError:
        return ()
    return tuple(dict.fromkeys(TableRange(row.name, row.low, row.high, row.display_units) for row in rows))


def tables_left(time: np.ndarray, outputs: Mapping[str, np.ndarray], ranges: tuple[TableRange, ...]) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``tables_left`` for every range that a run left; none when the model counts no such step.

    Parameters
    ----------
    time : array (time,)
        [s]
    outputs : mapping of str to array (time,)
        Of one run; ``out_of_range`` counts the internal steps beyond a table, over all tables.
    ranges : tuple of TableRange
        Of the model; a variable that is no output cannot be named.
    """
    steps = float(np.fmax.reduce(outputs.get("out_of_range", np.zeros(1))))
    if not steps > 0.0:
        return ()
    seen = [(item, outputs[source]) for item in ranges if (source := output_of(item.variable, outputs)) in outputs]
    flying = outputs["V"] > SLOWEST if "V" in outputs else np.ones(time.size, bool)
    seen = [(item, np.where(flying, values, item.low) if item.variable in FLOW else values) for item, values in seen]
    found = [remark for item, values in seen if (remark := _left(time, values, item))]
    explained = any(((values < item.low) | (values > item.high)).any() for item, values in seen) or not flying.all()
    if found or explained or (ranges and len(seen) == len(ranges)):
        return tuple(found)
    return (RowRemark("tables_left", f"tables left in {steps:.0f} internal steps", values={"steps": steps}, unit="1"),)


def _left(time: np.ndarray, values: np.ndarray, item: TableRange) -> RowRemark | None:
    below, above = item.low - values, values - item.high
    beyond = np.fmax(below, above)
    out = beyond > NEGLIGIBLE * (item.high - item.low)
    if not out.any():
        return None
    worst = int(np.argmax(np.where(out, beyond, 0.0)))
    word, end = ("below", item.low) if below[worst] > above[worst] else ("above", item.high)
    unit = "" if item.unit == "1" else f" {item.unit}"
    amount, limit = (float(from_si(value, item.unit)) for value in (beyond[worst], end))
    share = 100.0 * float(out.mean())
    text = (
        f"tables over {item.variable} left: {word} {limit:.4g}{unit} by up to {amount:.2g}{unit}, at {time[worst]:.1f} s, "
        f"in {share:.0f} % of the samples; held there"
    )
    return RowRemark("tables_left", text, item.variable, {"limit": limit, "beyond": amount}, item.unit)
