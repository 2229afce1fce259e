"""What the math pilot did: how far he moved each control, how often at his limit, and how well he
held his channels.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.simulation.kernel import AXIS
from flightmech.support.arrays import rms
from flightmech.units import from_si, parse_unit
from pom.cases.pilot import Pilot, PilotLoop, shortest_error
from pom.cases.reference_states import CALIBRATION
from pom.judging.beyond_the_bands import SLOWEST, flown_model
from pom.judging.signals import trace_of
from pom.result import PomResult
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of

DRIFTING = ("V_cas", "V", "h", "psi")
_COLUMNS = ("parameter", "estimate", "stderr", "unit")


def calibration(result: PomResult) -> pd.DataFrame:
    """Return the corrections that the flight data of a result carry: ``parameter estimate stderr
    unit``, empty when none are known.
    """
    return pd.DataFrame(
        json.loads(result.signals.attrs.get(CALIBRATION, "[]")), columns=list(_COLUMNS)
    )


def drift(result: PomResult) -> pd.DataFrame:
    """Return how speed, height and heading of every model leave those of the flight.

    Returns
    -------
    DataFrame
        ``run channel start rate spread unit``: value and slope [per s] of the line through model
        minus flight, and the standard deviation about it, over the whole window. [SI]  A slope with
        a small spread points to an error of force, of wind or of mass.
    """
    return result.once(_drift)


def _drift(result: PomResult) -> pd.DataFrame:
    time = result.signals["time"].values
    rows = []
    for name in (name for name in DRIFTING if name in result.signals):
        flight = trace_of(result.signals, "flight", name)
        for run in result.runs:
            difference = trace_of(result.signals, run, name) - flight
            if np.isfinite(difference).all() and time.size > 2:
                slope, start = np.polyfit(time - time[0], difference, 1)
                spread = float(np.std(difference - start - slope * (time - time[0])))
                rows.append((run, name, float(start), float(slope), spread, lookup(name).units))
    return pd.DataFrame(rows, columns=["run", "channel", "start", "rate", "spread", "unit"])


PILOT = "pilot"  # attribute of the signals of a result: JSON
_PILOT_COLUMNS = ("run", "control", "gains", "mean", "rms", "largest", "at", "at_limit", "held")


def pilot_activity_rows(
    run: str,
    loops: Sequence[PilotLoop],
    time: np.ndarray,
    moved: Mapping[str, np.ndarray],
    targets: Mapping[str, np.ndarray],
    outputs: Mapping[str, np.ndarray],
) -> list[dict]:
    """Return one row per control that the math pilot moved in a run.

    Parameters
    ----------
    run : str
        The model.
    moved : mapping of str to array (time,)
        His corrections, as `pom.cases.pilot.Pilot.moved`. [SI of the control]
    targets, outputs : mapping of str to array (time,)
        The channels he held, recorded and of the model. [SI]

    Returns
    -------
    list of dict
        ``control``; ``gains``, his loops in words; ``mean``, ``rms`` and ``largest`` correction
        (signed) and its time ``at`` [s]; ``at_limit``, the share of samples at which one of his
        loops was at its limit; ``held``, the rms by which each channel departed from its record, in
        words. [SI]
    """
    rows, cut = [], _cut(loops, time, targets, outputs)
    for control, correction in moved.items():
        mine = [loop for loop in loops if loop.control == control]
        known = np.isfinite(correction)
        if not known.any():
            continue
        used, when = correction[known], time[known]
        largest = int(np.argmax(np.abs(used)))
        rows.append(
            {
                "run": run,
                "control": control,
                "gains": "; ".join(_gains(loop) for loop in mine),
                "mean": float(used.mean()),
                "rms": rms(used),
                "largest": float(used[largest]),
                "at": float(when[largest]),
                "at_limit": float(np.mean(cut[control][known])),
                "held": ", ".join(_held(loop.channel, targets, outputs) for loop in mine),
            }
        )
    return rows


def pilot_activity(result: PomResult) -> pd.DataFrame:
    """Return the rows of `pilot_activity_rows` of all models of a result; empty when no math pilot flew."""
    return pd.DataFrame(
        json.loads(result.signals.attrs.get(PILOT, "[]")), columns=list(_PILOT_COLUMNS)
    )


def _cut(
    loops: Sequence[PilotLoop],
    time: np.ndarray,
    targets: Mapping[str, np.ndarray],
    outputs: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Return for every control whether a loop was at its limit: the loops once more, on what the
    model did.
    """
    pilot = Pilot(loops, time, targets)
    for k in range(time.size):
        pilot.controls(k, {name: float(outputs[name][k]) for name in pilot.channels})
    return pilot.cut


def _gains(loop: PilotLoop) -> str:
    moved, held = (lookup(name).display_units for name in (loop.control, loop.channel))
    size = parse_unit(held)[1] / parse_unit(moved)[1]
    over = f"{moved}/{held}" if "/" not in held else f"{moved}/({held})"
    integral = f" {loop.integral * size:+.4g} {over} /s" if loop.integral else ""
    return (
        f"{loop.gain * size:.4g} {over}{integral} x {loop.channel}, at most "
        f"{from_si(loop.limit, moved):.3g} {moved}"
    )


def _held(name: str, targets: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> str:
    error_of = np.array([shortest_error(name, error) for error in targets[name] - outputs[name]])
    unit = lookup(name).display_units
    return f"{name} {np.sqrt(np.nanmean(error_of**2)) / parse_unit(unit)[1]:.3g} {unit} rms"


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
    """Return the ranges of the tables inside an FMU, each once; none for an FMU of another program
    or of another version of this one.

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
    return tuple(
        dict.fromkeys(TableRange(row.name, row.low, row.high, row.display_units) for row in rows)
    )


def tables_left(
    time: np.ndarray, outputs: Mapping[str, np.ndarray], ranges: tuple[TableRange, ...]
) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``tables_left`` for every range that a run left; none when the model
    counts no such step.

    Parameters
    ----------
    time : array (time,)
        [s]
    outputs : mapping of str to array (time,)
        Of one run; ``out_of_range`` counts the internal steps beyond a table, over all tables.
    ranges : tuple of TableRange
        Of the model; a variable that is not an output cannot be named.
    """
    steps = float(np.fmax.reduce(outputs.get("out_of_range", np.zeros(1))))
    if not steps > 0.0:
        return ()
    seen = [
        (item, outputs[source])
        for item in ranges
        if (source := output_of(item.variable, outputs)) in outputs
    ]
    flying = outputs["V"] > SLOWEST if "V" in outputs else np.ones(time.size, bool)
    seen = [
        (item, np.where(flying, values, item.low) if item.variable in FLOW else values)
        for item, values in seen
    ]
    found = [remark for item, values in seen if (remark := _left(time, values, item))]
    explained = (
        any(((values < item.low) | (values > item.high)).any() for item, values in seen)
        or not flying.all()
    )
    if found or explained or (ranges and len(seen) == len(ranges)):
        return tuple(found)
    return (
        RowRemark(
            "tables_left",
            f"tables left in {steps:.0f} internal steps",
            values={"steps": steps},
            unit="1",
        ),
    )


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
        f"tables over {item.variable} left: {word} {limit:.4g}{unit} by up to "
        f"{amount:.2g}{unit}, at {time[worst]:.1f} s, "
        f"in {share:.0f} % of the samples; held there"
    )
    return RowRemark(
        "tables_left", text, item.variable, {"limit": limit, "beyond": amount}, item.unit
    )
