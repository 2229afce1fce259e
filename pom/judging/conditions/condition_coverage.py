"""Flight conditions that a row wants, and which of them the cases of a report show.

Some tests are flown in several conditions, such as the Dutch roll in cruise and in approach or
landing.  One case covers one condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.errors import UnknownName
from pom.judging.conditions.configurations import CONFIGURATION_CHECKS
from pom.judging.conditions.flown_case import FlownCase, NotChecked
from pom.judging.signals import RunSignals, traces_of
from pom.result import PomResult
from pom.status import PASSED, has_departure

WANTED: dict[str, tuple[tuple[str, str], ...]] = {
    "ground_and_approach": (("ground", "ground"), ("approach", "extended")),
    "takeoff_cruise_landing": (("takeoff", "takeoff"), ("cruise", "clean"), ("landing", "landing")),
    "cruise_approach_landing": (
        ("cruise", "clean"),
        ("approach", "extended"),
        ("landing", "landing"),
    ),
    "second_segment_and_approach_or_landing": (
        ("second segment climb", "gear_up"),
        ("approach or landing", "extended"),
    ),
    "second_segment_climb;approach_or_landing": (
        ("second segment climb", "gear_up"),
        ("approach or landing", "extended"),
    ),
    "cruise_and_approach_or_landing": (
        ("cruise", "clean"),
        ("approach or landing", "extended"),
    ),
    "second_segment_cruise_approach_or_landing": (
        ("second segment climb", "gear_up"),
        ("cruise", "clean"),
        ("approach or landing", "extended"),
    ),
    "takeoff;cruise;approach_or_landing": (
        ("takeoff", "takeoff"),
        ("cruise", "clean"),
        ("approach or landing", "extended"),
    ),
    "takeoff;cruise": (("takeoff", "takeoff"), ("cruise", "clean")),
    "cruise;approach": (("cruise", "clean"), ("approach", "extended")),
    "takeoff_and_landing": (("takeoff", "takeoff"), ("landing", "landing")),
}
"""By flight condition of a row that wants several: their words, and the configuration of each
(`pom.judging.conditions.configurations.CONFIGURATION_CHECKS`).  Other rows want one condition.
"""


SHARED = "shared_flight"
"""Quantity of the remark on a flight that another case of the test has already shown
(`pom.probing.shared_flights`).
"""
SHARED_TESTS = "shared_flight_of_tests"
"""The same for a flight that a case of another test shows; it does not change the coverage."""


@dataclass(frozen=True)
class ConditionCoverage:
    """Conditions of a test: those that a case shows, and those that none shows, in words.

    Attributes
    ----------
    covered, missing : tuple of str
    unknown : str
        Why a case that could show a missing condition does not: what it does not record.
    departing : int
        Number of the covered conditions that only a case with departures shows.
    """

    covered: tuple[str, ...]
    missing: tuple[str, ...]
    unknown: str = ""
    departing: int = 0

    @property
    def text(self) -> str:
        """The coverage as a report prints it; empty for a test that wants one condition."""
        count = len(self.covered) + len(self.missing)
        if not count:
            return ""
        text = f"{len(self.covered)} of {count}"
        if self.departing:
            text += f", {self.departing} with departures"
        if not self.missing:
            return text
        if self.unknown:
            return f"{text}; not recorded: {', '.join(self.missing)} ({self.unknown})"
        return f"{text}; missing: {', '.join(self.missing)}"


def cover_conditions(results: Sequence[PomResult]) -> ConditionCoverage:
    """Return the coverage of the conditions of one test by its cases.

    Parameters
    ----------
    results : sequence of PomResult
        Of one test.  A case counts for one condition; a case that states itself as additional
        counts for none, and neither does a case without any judged row or one of a flight that
        another case has shown.
    """
    wanted = WANTED.get(_flight_condition(results[0]), ()) if results else ()
    if not wanted:
        return ConditionCoverage((), ())
    # A case without departures has the first choice of the conditions.
    counting = sorted((result for result in results if _counts(result)), key=case_departs)
    conditions = [name for _, name in wanted]
    shows: list[list[int]] = []
    unknown: dict[str, None] = {}
    for result in counting:
        places, reasons = _shown_conditions(result, conditions)
        shows.append(places)
        unknown |= dict.fromkeys(reasons)
    # condition -> case, by augmenting paths: one case may fit several conditions
    taken: dict[int, int] = {}

    def find_place(k: int, seen: set[int]) -> bool:
        for place in shows[k]:
            if place in seen:
                continue
            seen.add(place)
            if place not in taken or find_place(taken[place], seen):
                taken[place] = k
                return True
        return False

    for k in range(len(shows)):
        find_place(k, set())
    covered = tuple(words for place, (words, _) in enumerate(wanted) if place in taken)
    missing = tuple(words for place, (words, _) in enumerate(wanted) if place not in taken)
    departing = sum(case_departs(counting[k]) for k in taken.values())
    return ConditionCoverage(covered, missing, "; ".join(unknown), departing)


def case_departs(result: PomResult) -> bool:
    """Return whether a case departs from its row with each model that passes, or with all of them.

    A departure of one model alone, such as tables that it leaves, is not one of the case.
    """
    runs = list(result.runs)
    passing = [run for run in runs if result.status(run) in PASSED]
    departing = {row["run"] for row in result.rows if has_departure(row)}
    return bool(runs) and departing.issuperset(passing or runs)


def _flight_condition(result: PomResult) -> str:
    try:
        return result.case.printed_rows()[0]["flight_condition"]
    except UnknownName:
        return ""


def _counts(result: PomResult) -> bool:
    """Return whether a case can show a condition."""
    return not result.case.additional and _is_judged(result) and not _is_repeated(result)


def _is_repeated(result: PomResult) -> bool:
    """Return whether another case has already shown the flight."""
    for row in result.rows:
        for remark in row["remarks"]:
            if remark.kind == "departure" and remark.quantity == SHARED:
                return True
    return False


def _is_judged(result: PomResult) -> bool:
    return any(row["verdict"] in ("pass", "fail", "advisory") for row in result.rows)


def _shown_conditions(result: PomResult, names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the places of the configurations in which a case was flown, and what is unknown."""
    time = result.signals["time"].values
    signals = traces_of(result.signals, "flight")
    for name, item in result.inputs.data_vars.items():
        signals.setdefault(str(name), np.asarray(item.values, float))
    flown = FlownCase(result.case, RunSignals(signals, time))
    places, unknown = [], []
    for place, name in enumerate(names):
        try:
            if not CONFIGURATION_CHECKS[name](flown):
                places.append(place)
        except NotChecked as reason:
            unknown.append(str(reason))
    return places, unknown
