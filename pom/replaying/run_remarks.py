"""Remarks on a run: calibration, drift, activity of the math pilot, tables left, the runway."""

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
from flightmech.simulation.run import RUNWAY, describe_below_runway
from flightmech.support.arrays import rms
from flightmech.units import from_si, parse_unit
from pom.cases.pilot import Pilot, PilotLoop, shortest_error
from pom.cases.reference_states import CALIBRATION
from pom.judging.beyond_the_bands import flown_model
from pom.judging.signals import trace_of
from pom.judging.watched_channels import SLOWEST
from pom.result import PomResult
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of

DRIFTING = ("V_cas", "V", "h", "psi")
_COLUMNS = ("parameter", "estimate", "stderr", "unit")


def calibration(result: PomResult) -> pd.DataFrame:
    """Return the corrections in the flight data of a result.

    Returns
    -------
    DataFrame
        ``parameter estimate stderr unit``; empty without corrections.
    """
    rows = json.loads(result.signals.attrs.get(CALIBRATION, "[]"))
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def drift(result: PomResult) -> pd.DataFrame:
    """Return the drift of speed, height and heading of every model from the flight.

    Returns
    -------
    DataFrame
        ``run channel start rate spread unit``: value and slope [per s] of the line through model
        minus flight, and the standard deviation about it, over the whole window. [SI]  A slope with
        a small spread points to an error of force, of wind or of mass.
    """
    return result.once(_make_drift_table)


def _make_drift_table(result: PomResult) -> pd.DataFrame:
    time = result.signals["time"].values
    rows = []
    for name in DRIFTING:
        if name not in result.signals:
            continue
        flight = trace_of(result.signals, "flight", name)
        for run in result.runs:
            difference = trace_of(result.signals, run, name) - flight
            # A line through two samples has no spread.
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
    loops : sequence of PilotLoop
    time : array (time,)
        [s]
    moved : mapping of str to array (time,)
        Corrections of the controls, as `pom.cases.pilot.Pilot.moved`. [SI of the control]
    targets, outputs : mapping of str to array (time,)
        The controlled channels, recorded and of the model. [SI]

    Returns
    -------
    list of dict
        ``control``; ``gains``, the loops as a text; ``mean``, ``rms`` and ``largest`` correction
        (signed) and its time ``at`` [s]; ``at_limit``, the share of samples at which a loop of the
        control was at its limit; ``held``, the rms difference of each channel from its record, as
        a text. [SI]
    """
    rows = []
    limited = _samples_at_limit(loops, time, targets, outputs=outputs)
    for control, correction in moved.items():
        control_loops = [loop for loop in loops if loop.control == control]
        # A failed run has NaN after its end.
        is_finite = np.isfinite(correction)
        if not is_finite.any():
            continue
        used, used_time = correction[is_finite], time[is_finite]
        largest = int(np.argmax(np.abs(used)))
        errors = [_describe_error(loop.channel, targets, outputs) for loop in control_loops]
        rows.append(
            {
                "run": run,
                "control": control,
                "gains": "; ".join(map(_describe_gains, control_loops)),
                "mean": float(used.mean()),
                "rms": rms(used),
                "largest": float(used[largest]),
                "at": float(used_time[largest]),
                "at_limit": float(np.mean(limited[control][is_finite])),
                "held": ", ".join(errors),
            }
        )
    return rows


def pilot_activity(result: PomResult) -> pd.DataFrame:
    """Return the rows of `pilot_activity_rows` of all models; empty without a math pilot."""
    rows = json.loads(result.signals.attrs.get(PILOT, "[]"))
    return pd.DataFrame(rows, columns=list(_PILOT_COLUMNS))


def _samples_at_limit(
    loops: Sequence[PilotLoop],
    time: np.ndarray,
    targets: Mapping[str, np.ndarray],
    *,
    outputs: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Return for every control the samples at which a loop was at its limit (time,)."""
    # A result does not contain the limits, so the loops are run again on the outputs of the model.
    pilot = Pilot(loops, time, targets)
    for k in range(time.size):
        pilot.controls(k, {name: float(outputs[name][k]) for name in pilot.channels})
    return pilot.cut


def _describe_gains(loop: PilotLoop) -> str:
    """Return gains and limit of a loop as a text, in display units."""
    control_unit = lookup(loop.control).display_units
    channel_unit = lookup(loop.channel).display_units
    # A gain is in control per channel: its display unit needs the factors of both.
    size = parse_unit(channel_unit)[1] / parse_unit(control_unit)[1]
    gain_unit = f"{control_unit}/{channel_unit}"
    if "/" in channel_unit:
        gain_unit = f"{control_unit}/({channel_unit})"
    integral = ""
    if loop.integral:
        integral = f" {loop.integral * size:+.4g} {gain_unit} /s"
    return (
        f"{loop.gain * size:.4g} {gain_unit}{integral} x {loop.channel}, at most "
        f"{from_si(loop.limit, control_unit):.3g} {control_unit}"
    )


def _describe_error(
    name: str, targets: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]
) -> str:
    """Return the rms difference of a channel from its record as a text."""
    errors = np.array([shortest_error(name, error) for error in targets[name] - outputs[name]])
    unit = lookup(name).display_units
    return f"{name} {np.sqrt(np.nanmean(errors**2)) / parse_unit(unit)[1]:.3g} {unit} rms"


# of the range: so little beyond a table, its value at the end is as good as an extrapolation
NEGLIGIBLE = 1e-3
FLOW = ("alpha", "beta")  # angles without a meaning on an aeroplane at rest


class TableRange(NamedTuple):
    """Range of the tables of a model over one variable. [SI]"""

    variable: str
    low: float
    high: float
    unit: str


@lru_cache(maxsize=64)
def table_ranges(fmu: str | Path, sha256: str) -> tuple[TableRange, ...]:
    """Return the ranges of the tables inside an FMU, each once.

    The result is empty for an FMU of another program or of another version of this one.

    Parameters
    ----------
    fmu : path
    sha256 : str
        Hash of its content, so that a replaced file is read again.
    """
    try:
        model = flown_model(fmu)
        if model is None:
            return ()
        rows = model.entries(AXIS)
    except AeromatchError:
        return ()
    ranges = [TableRange(row.name, row.low, row.high, row.display_units) for row in rows]
    return tuple(dict.fromkeys(ranges))


def tables_left(
    time: np.ndarray, outputs: Mapping[str, np.ndarray], ranges: tuple[TableRange, ...]
) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``tables_left`` for every range that a run left.

    The result is empty if the model counts no such step.

    Parameters
    ----------
    time : array (time,)
        [s]
    outputs : mapping of str to array (time,)
        Of one run; ``out_of_range`` counts the internal steps beyond a table, over all tables.
    ranges : tuple of TableRange
        Of the model. A variable that is not an output has no remark of its own.
    """
    steps = float(np.fmax.reduce(outputs.get("out_of_range", np.zeros(1))))
    if not steps > 0.0:
        return ()
    is_flying = np.ones(time.size, bool)
    if "V" in outputs:
        is_flying = outputs["V"] > SLOWEST
    remarks: list[RowRemark] = []
    unseen = []
    is_explained = not is_flying.all()
    for item in ranges:
        source = output_of(item.variable, outputs)
        if source not in outputs:
            unseen.append(item.variable)
            continue
        values = outputs[source]
        # Below the least speed a flow angle counts as inside the range.
        if item.variable in FLOW:
            values = np.where(is_flying, values, item.low)
        is_explained |= bool(((values < item.low) | (values > item.high)).any())
        remark = _range_remark(time, values, item)
        if remark is not None:
            remarks.append(remark)
    # The counted steps need a remark without a variable only if no observed variable explains them.
    if remarks or is_explained or (ranges and not unseen):
        return tuple(remarks)
    text = f"tables left in {steps:.0f} integration steps, "
    if len(unseen) > 1:
        text += f"in one of {', '.join(unseen)}, which are not outputs of the model"
    elif unseen:
        text += f"in {unseen[0]}, which is not an output of the model"
    else:
        text += "the FMU does not state in which variable"
    return (RowRemark("tables_left", text, values={"steps": steps}, unit="1"),)


def below_runway(
    time: np.ndarray, outputs: Mapping[str, np.ndarray], parameters: Mapping[str, float]
) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``below_runway`` if the c.g. of a run is below the runway.

    Parameters
    ----------
    time : array (time,)
        [s]
    outputs : mapping of str to array (time,)
        Of one run; ``h`` is the height of the c.g. [SI]
    parameters : mapping of str to float
        Of the run; the elevation of the runway is 0 if they do not give it. [SI]
    """
    if "h" not in outputs:
        return ()
    height = outputs["h"] - parameters.get(RUNWAY, 0.0)
    text = describe_below_runway(time, height)
    if not text:
        return ()
    values = {"depth": -float(np.nanmin(height))}
    return (RowRemark("below_runway", text, "h", values=values, unit="m"),)


def _range_remark(time: np.ndarray, values: np.ndarray, item: TableRange) -> RowRemark | None:
    """Return the remark on a variable (time,) beyond a range; None if it is not beyond it."""
    below, above = item.low - values, values - item.high
    beyond = np.fmax(below, above)
    is_outside = beyond > NEGLIGIBLE * (item.high - item.low)
    if not is_outside.any():
        return None
    worst = int(np.argmax(np.where(is_outside, beyond, 0.0)))
    side, end = "above", item.high
    if below[worst] > above[worst]:
        side, end = "below", item.low
    unit = "" if item.unit == "1" else f" {item.unit}"
    amount = float(from_si(beyond[worst], item.unit))
    limit = float(from_si(end, item.unit))
    share = 100.0 * float(is_outside.mean())
    text = (
        f"tables over {item.variable} left: {side} {limit:.4g}{unit} by up to "
        f"{amount:.2g}{unit}, at {time[worst]:.1f} s, "
        f"in {share:.0f} % of the samples; held there"
    )
    values_by_name = {"limit": limit, "beyond": amount}
    return RowRemark("tables_left", text, item.variable, values=values_by_name, unit=item.unit)
