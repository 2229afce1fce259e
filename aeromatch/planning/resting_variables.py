"""Variables of fits that rest in all manoeuvres that identify their derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np
import pandas as pd
import xarray as xr

from aeromatch.project.project import Project
from flightmech.names import lookup
from flightmech.units import DEGREE
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.movement import (
    JUDGED,
    MOVED_LEAST,
    judged_variable,
    ranges_in_spans,
)

# Periods of the low-pass in a manoeuvre, below which its motion is filtered away.
_LEAST_PERIODS = 3.0
_NAMED = 3  # manoeuvres that move a variable and are named


class RecordMovements(Protocol):
    """Movements of the variables inside the windows of a record."""

    uses: dict[str, tuple[int, float]]

    moved: dict[str, dict[str, float]]
    movers: dict[str, list[str]]


def movements(
    states: xr.Dataset,
    table: pd.DataFrame,
    spans: Mapping[str, Sequence[tuple[float, float]]],
) -> tuple[dict[str, dict[str, float]], dict[str, list[str]]]:
    """Return the largest ranges of the variables by fit, and the manoeuvres that move each.

    Parameters
    ----------
    states : Dataset (time,)
        [SI]
    table : DataFrame
        Manoeuvres of the record: ``manoeuvre control start end``. [s]
    spans : mapping
        Windows by fit. [s]

    Returns
    -------
    moved : dict of str to dict of str to float
        [rad], [rad s-1]
    movers : dict of str to list of str
    """
    unknown = str(states.attrs.get("unknown", "")).split()
    time = states["time"].values
    columns = {}
    for name in JUDGED:
        if name in states and name not in unknown:
            columns[name] = states.variables[name].values
    moved: dict[str, dict[str, float]] = {}
    for position, windows in spans.items():
        ranges = ranges_in_spans(time, columns, windows)
        moved[position] = {}
        for name in columns if ranges else ():
            moved[position][name] = max(row[name] for row in ranges)
    movers: dict[str, list[str]] = {}
    rows = table.to_dict("records")
    marks = [(float(row["start"]), float(row["end"])) for row in rows]
    for row, ranges_of_row in zip(rows, ranges_in_spans(time, columns, marks), strict=True):
        label = f"{row['manoeuvre']} {row['control']}".strip()
        for name, size in ranges_of_row.items():
            if size >= MOVED_LEAST and label not in movers.setdefault(name, []):
                movers[name].append(label)
    return moved, movers


def _cutoff_remarks(project: Project, looks: Mapping[str, RecordMovements]) -> Iterator[str]:
    """Yield the fits of which the low-pass leaves less than three periods in a manoeuvre."""
    if project.cutoff is None:
        return
    for fit in project.fit:
        position = f"fit {fit.name!r}"
        uses = [look.uses[position] for look in looks.values() if position in look.uses]
        windows = sum(count for count, _ in uses)
        if not windows:
            continue
        duration = sum(seconds for _, seconds in uses) / windows
        if duration > 0.0 and project.cutoff * duration < _LEAST_PERIODS:
            yield (
                f"{position}: its manoeuvres last {duration:.3g} s on average, and the low-pass "
                f"cutoff = {project.cutoff:g} Hz leaves {project.cutoff * duration:.2g} periods of "
                f"them: it takes the motion away; take 2 to 3 times the frequency of the fastest "
                f"mode, such as '4 Hz'"
            )


def resting_remarks(project: Project, looks: Mapping[str, RecordMovements]) -> list[str]:
    """Return the derivatives that no fit of a project can determine, because nothing moves, and the
    fits whose motion the low-pass takes away.

    A variable may rest in one record, or in one fit, if another one determines the derivative of
    the same coefficient.

    Parameters
    ----------
    project : Project
    looks : mapping of str to RecordLook
        By record.
    """
    # by coefficient and variable: the fits with it, and its largest range in each
    ranges: dict[tuple[str, str], dict[str, float]] = {}
    for fit in project.fit:
        position = f"fit {fit.name!r}"
        seen = [look.moved[position] for look in looks.values() if position in look.moved]
        for model in map(RegressionModel.parse, fit.models):
            for name in filter(None, map(judged_variable, model.variables)):
                sizes = [moved[name] for moved in seen if name in moved]
                if not sizes:
                    continue
                entry = ranges.setdefault((model.coefficient, name), {})
                entry[position] = max(sizes)
    resting: dict[tuple[str, str, float], list[str]] = {}
    for (coefficient, name), sizes_of_fits in ranges.items():
        if max(sizes_of_fits.values()) >= MOVED_LEAST:
            continue
        for position, size in sizes_of_fits.items():
            resting.setdefault((position, name, size), []).append(coefficient)
    remarks = list(_cutoff_remarks(project, looks))
    for (position, name, size), coefficients in resting.items():
        remarks.append(_remark(position, name, size, coefficients, looks))
    return remarks


def _remark(
    position: str,
    name: str,
    size: float,
    coefficients: Sequence[str],
    looks: Mapping[str, RecordMovements],
) -> str:
    """Return the remark on a variable that rests in a fit."""
    unit = "deg/s" if lookup(name).units == "rad s-1" else "deg"
    movers: list[str] = []
    for look in looks.values():
        if position in look.moved:
            movers += look.movers.get(name, [])
    labels = list(dict.fromkeys(movers))
    advice = "none of its records has a manoeuvre that moves it: leave the term out, or fly one"
    if labels:
        advice = f"manoeuvres of its records that move it: {', '.join(labels[:_NAMED])}"
        if len(labels) > _NAMED:
            advice += f" and {len(labels) - _NAMED} more"
    return (
        f"{position}: {name} hardly moves in its manoeuvres (range {np.round(size / DEGREE, 2):g} "
        f"{unit}, {MOVED_LEAST / DEGREE:g} {unit} is a movement), and no other fit has its "
        f"derivative of {', '.join(coefficients)}: its estimate is noise; {advice}"
    )
