"""Conditions of a row that need several cases of one test: speeds, directions, rudder positions."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flightmech.aircraft.controls import ICE
from flightmech.units import DEGREE, KNOT
from pom.cases.case import PomCase
from pom.judging.conditions.flown_case import NotChecked, control_travel
from pom.judging.conditions.stall_checks import LEVEL_BANK
from pom.judging.signals import RunSignals
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import plain_id
from pom.tolerances.stated_conditions import CONDITIONS, STATED

VALUES = "row_conditions"  # attribute of the signals of a result: JSON
MEASURED_AT = {
    "taxi_speeds": ("V_ground", "capture"),
    "both_directions": ("phi", "release"),
    "speeds_about_trim": ("V_cas", "capture"),
    "rudder_positions": ("delta_r", "capture"),
    "stall_entries": ("phi", "stall_warning"),
    "clean_and_iced": (ICE, ""),
}
"""By condition: the channel that shows it, and the event of the case at which it is read; no event:
the start, and a control without a record is at zero.
"""

TAXI_SPEEDS = 5.0 * KNOT  # test 1.a.2
SPEEDS = 2.0 * KNOT  # our number: nearer airspeeds are one speed
FULL_RUDDER = 0.8  # of the travel; our number for "near maximum"
TURNING = 25.0 * DEGREE  # our number for the entry of a stall in a turn of 30 deg


def has_report_conditions(case: PomCase) -> bool:
    """Return whether the cases of a test have to show a condition together."""
    names = STATED.get(plain_id(case.id), ())
    return case.reference != "footprint" and any(name in REPORT_CHECKS for name in names)


def with_report_conditions(results: Sequence[PomResult]) -> list[PomResult]:
    """Return results that state which conditions the cases of their test do not meet together.

    Parameters
    ----------
    results : sequence of PomResult
        All cases of a report.

    Returns
    -------
    list of PomResult
        Every row of a test with such a condition has a remark ``departure`` if the cases of the
        test in the report do not meet it or do not show it.
    """
    groups: dict[tuple[str, str, str], list[PomResult]] = {}
    for result in results:
        case = result.case
        groups.setdefault((case.standard, case.edition, case.id), []).append(result)
    remarks = {key: _group_remarks(group) for key, group in groups.items()}
    stated = []
    for result in results:
        case = result.case
        more = remarks[case.standard, case.edition, case.id]
        stated.append(_with_remarks(result, more))
    return stated


def _with_remarks(result: PomResult, more: tuple[RowRemark, ...]) -> PomResult:
    if not more or result.case.reference == "footprint":
        return result
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]


def _group_remarks(results: Sequence[PomResult]) -> tuple[RowRemark, ...]:
    """Return the remarks on the conditions over the cases of one test."""
    remarks = []
    for name in STATED.get(plain_id(results[0].case.id), ()):
        if name not in REPORT_CHECKS:
            continue
        condition = CONDITIONS[name]
        try:
            failure = REPORT_CHECKS[name](results)
        except NotChecked as reason:
            remarks.append(reason.remark(condition.text, name))
            continue
        if failure:
            remarks.append(RowRemark("departure", f"departure: {failure}", name))
    return tuple(remarks)


def report_values(case: PomCase, flight: RunSignals) -> str:
    """Return what the flight of a case shows of the conditions over several cases, as JSON.

    Every condition has its number [SI], or a text that states what is missing.  The text is the
    attribute `VALUES` of the signals of the result.
    """
    values: dict[str, float | str] = {}
    for name in STATED.get(plain_id(case.id), ()):
        if name not in MEASURED_AT:
            continue
        channel, event = MEASURED_AT[name]
        instant = case.events.get(event)
        if not event:
            held = float(flight[channel][0]) if channel in flight else 0.0
            values[name] = float(case.conditions.get(channel, held))
        elif instant is None:
            values[name] = f"case {case.name} does not give the event {event}"
        elif channel not in flight:
            values[name] = f"the record of case {case.name} has no {channel}"
        else:
            values[name] = float(np.interp(instant, flight.time, flight[channel]))
    return json.dumps(values) if values else ""


def _values(results: Sequence[PomResult], name: str) -> np.ndarray:
    """Return the number of every case for a condition (cases,). [SI]"""
    found = []
    for result in results:
        stored = json.loads(result.signals.attrs.get(VALUES, "{}"))
        value = stored.get(name, f"the result of case {result.case.name} is of an older version")
        if isinstance(value, str):
            raise NotChecked(value)
        found.append(value)
    return np.array(found)


def _check_taxi_speeds(results: Sequence[PomResult]) -> str:
    speeds = _values(results, "taxi_speeds")
    span = float(np.ptp(speeds))
    # 5 kt apart, as printed to a tenth of a knot
    if span >= 0.99 * TAXI_SPEEDS:
        return ""
    listed = ", ".join(f"{speed / KNOT:.3g} kt" for speed in np.sort(speeds))
    return f"taxi speeds of the test in this report: {listed}; the row has two, 5 kt apart"


def _check_directions(results: Sequence[PomResult]) -> str:
    bank = _values(results, "both_directions")
    if (bank > 0.0).any() and (bank < 0.0).any():
        return ""
    side = "right" if bank[0] > 0.0 else "left"
    return f"releases to the {side} only in this report; the row has both directions"


def _count_apart(values: np.ndarray, least: float) -> int:
    """Return how many values are at least that far from the next smaller counted one."""
    count, last = 0, -np.inf
    for value in np.sort(values):
        if value - last >= least:
            count, last = count + 1, value
    return count


def _check_speeds(results: Sequence[PomResult]) -> str:
    count = _count_apart(_values(results, "speeds_about_trim"), SPEEDS)
    if count >= 4:
        return ""
    plural = "s" if count != 1 else ""
    return f"{count} airspeed{plural} of the test in this report; the row has two each side of trim"


def _check_rudder(results: Sequence[PomResult]) -> str:
    angles = np.abs(_values(results, "rudder_positions"))
    count = _count_apart(angles, 1.0 * DEGREE)
    largest = float(angles.max())
    travel = control_travel(results[0].case, "delta_r")
    if count >= 2 and largest >= FULL_RUDDER * travel:
        return ""
    plural = "s" if count != 1 else ""
    return (
        f"{count} rudder position{plural} of the test in this report, the largest "
        f"{largest / DEGREE:.3g} deg of {travel / DEGREE:.3g} deg; the row has two, one near "
        "maximum"
    )


def _check_stall_entries(results: Sequence[PomResult]) -> str:
    bank = np.abs(_values(results, "stall_entries"))
    if (bank <= LEVEL_BANK).any() and (bank >= TURNING).any():
        return ""
    listed = ", ".join(f"{angle / DEGREE:.2g} deg" for angle in np.sort(bank))
    return f"stalls of the test in this report at a bank of {listed}; wings level and turning asked"


def _check_ice(results: Sequence[PomResult]) -> str:
    setting = _values(results, "clean_and_iced")
    if (setting == 0.0).any() and (setting > 0.0).any():
        return ""
    return f"{'clean' if not setting.any() else 'iced'} runs only in this report; the row has both"


REPORT_CHECKS: dict[str, Callable[[Sequence[PomResult]], str]] = {
    "taxi_speeds": _check_taxi_speeds,
    "both_directions": _check_directions,
    "speeds_about_trim": _check_speeds,
    "rudder_positions": _check_rudder,
    "stall_entries": _check_stall_entries,
    "clean_and_iced": _check_ice,
}
"""By condition: returns a text if the cases of a test do not meet it together."""
