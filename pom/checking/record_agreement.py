"""Records of one report against each other: mass by the lift, and temperature of the air.

One flight test has one aeroplane, and one model flies all of its records.  A record with a wrong
mass needs another lift than the others at the same angle of attack.  A record with a wrong
temperature is of another day.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from pom.probing.flight_consistency import LIFT_QUANTITY
from pom.result import PomResult
from pom.tolerances.bands import RowRemark

LEAST_RECORDS = 3
"""Other records that a comparison needs: their median must not be that of the faulty ones."""
LIFT_APART = 0.9
"""Share of the limit of a record alone by which its lift may differ from that of the others.

The error of the model is the same in all of them.  The 16 records of the T-37 differ by at most
0.008 from their median with the calibrated vanes of the programme, where the limit is 0.031.
"""
OTHERS = "other records"  # words of the remarks
AIR_APART = 10.0
"""The same for the temperature above that of the standard atmosphere. [K]"""


def disagreement_remarks(results: Sequence[PomResult]) -> list[dict[str, tuple[RowRemark, ...]]]:
    """Return the remarks on records that disagree with the others of a report, by model.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of dict of str to tuple of RowRemark
        Per result.  ``departure`` for a lift beyond `LIFT_APART`; ``record_warning`` for a
        temperature beyond `AIR_APART`, which is right for a record of another day.
    """
    found: list[dict[str, tuple[RowRemark, ...]]] = [{} for _ in results]
    runs = dict.fromkeys(chain.from_iterable(result.runs for result in results))
    for run in runs:
        numbers = [_lift_numbers(result, run) for result in results]
        ratios = [item.get("ratio", np.nan) for item in numbers]
        limits = [LIFT_APART * item.get("limit", np.nan) for item in numbers]
        for k, text in _outliers(results, ratios, limits).items():
            reason = (
                f"departure: lift: the flight needs {ratios[k]:.3f} of what the model has, {text}: "
                f"check the mass, the angle of attack and the airspeed of this record"
            )
            found[k][run] = (RowRemark("departure", reason, LIFT_QUANTITY),)
    # The temperature belongs to the record, so it is the same for all models.
    warmth = [_warmth(result) for result in results]
    for k, text in _outliers(results, warmth, [AIR_APART] * len(results)).items():
        reason = (
            f"record: the air is {warmth[k]:+.1f} K off the standard atmosphere, {text}: check the "
            f"temperature, unless this is the record of another day"
        )
        remark = RowRemark("record_warning", reason, "temperature")
        for run in results[k].runs:
            found[k][run] = (*found[k].get(run, ()), remark)
    return found


def _lift_numbers(result: PomResult, run: str) -> Mapping[str, float]:
    """Return the lift of flight over model of a run, and its limit; empty if not compared."""
    for row in result.rows:
        if row["run"] != run:
            continue
        for remark in row["remarks"]:
            if remark.quantity == LIFT_QUANTITY and "limit" in remark.values:
                return remark.values
    return {}


def _warmth(result: PomResult) -> float:
    """Return the temperature above that of the standard atmosphere at the start [K], or NaN."""
    case = result.case
    if case.reference != "flight" or "delta_T" in case.conditions:
        return np.nan
    return float(result.conditions.get("delta_T", np.nan))


def _outliers(
    results: Sequence[PomResult], values: Sequence[float], limits: Sequence[float]
) -> dict[int, str]:
    """Return how far a value is from the median of the other records, by its place in `values`.

    Cases of one aircraft file are compared.  A record counts once.
    """
    texts = {}
    by_aircraft: dict[str, list[int]] = {}
    for k, result in enumerate(results):
        if np.isfinite(values[k]) and result.case.aircraft:
            by_aircraft.setdefault(result.case.aircraft, []).append(k)
    for places in by_aircraft.values():
        records: dict[str, list[float]] = {}
        for k in places:
            records.setdefault(results[k].case.record, []).append(values[k])
        # Several cases of one record count once.
        medians = {record: float(np.median(items)) for record, items in records.items()}
        for k in places:
            own = results[k].case.record
            others = [value for record, value in medians.items() if record != own]
            if len(others) < LEAST_RECORDS:
                continue
            middle = float(np.median(others))
            if abs(values[k] - middle) > limits[k]:
                name = Path(own).name
                texts[k] = f"{middle:.3f} in the {len(others)} {OTHERS} ({name} differs)"
    return texts
