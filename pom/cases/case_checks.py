"""Checks of a case file that need its rows: names of events, channels, criteria and parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from flightmech.errors import UnknownName
from flightmech.names import lookup
from pom.cases import resolve as parts
from pom.cases.case_file import WIND, CaseFile
from pom.tolerances import rows
from pom.tolerances.criteria import Criterion


def check_case_names(file: CaseFile, own_rows: Sequence[rows.Row], problems: list[str]) -> None:
    """Check the events, channels, features and the share that a case file names."""
    parts.check_events(file.events, problems, own_rows)
    parts.check_event_times(file.events, file.case.window, problems)
    if math.isnan(parts.tolerance_fraction(file)):
        problems.append(
            f"case.fraction: missing; the share of the tolerance for a reference of an engineering "
            f"simulator follows from the year of the edition, and {file.case.edition!r} does not "
            f"begin with one"
        )
    for name in file.case.show:
        parts.collect_case_problems(problems, "case.show", lookup, name)
    for feature in file.case.features:
        if feature not in rows.claimable_features(own_rows):
            error = UnknownName(feature, rows.claimable_features(own_rows), "condition")
            problems.append(f"case.features: {error}")


def check_table_names(file: CaseFile, criteria: Sequence[Criterion], problems: list[str]) -> None:
    """Check the keys of tables by criterion, and the tables that contradict the drive."""
    names = {criterion.name for criterion in criteria}
    # a rationale may also be for a shown channel, or for the trim
    channels = {criterion.channel for criterion in criteria} | set(file.case.show)
    parameters = {criterion.parameter for criterion in criteria}
    trim = {f"trim.{name}" for name in parts.LIMIT_UNITS}
    parts.check_names("ticks", file.ticks, allowed=names, what="criterion", problems=problems)
    parts.check_names(
        "rationale",
        file.rationale,
        allowed=names | channels | trim,
        what="criterion, channel or trim quantity",
        problems=problems,
    )
    parts.check_names(
        "certified", file.certified, allowed=parameters, what="parameter", problems=problems
    )
    for name in file.conditions:
        if name in WIND and file.drive.wind == "none":
            problems.append(
                f'conditions.{name}: drive.wind is "none", calm air; give one of the two'
            )
    if file.control_law is not None and file.drive.surfaces != "recorded":
        problems.append(
            f"control_law: it drives surfaces, and drive.surfaces is "
            f'"{file.drive.surfaces}"; make it "recorded"'
        )


def loose_problems(content: dict[str, Any]) -> list[str]:
    """Return the problems of the free tables of a file whose form is wrong elsewhere."""
    problems: list[str] = []
    conditions, events = content.get("conditions"), content.get("events")
    if isinstance(conditions, dict):
        parts.resolve_conditions(conditions, problems)
    if isinstance(events, dict):
        # which table the case names is part of the wrong form: events are not checked here
        own_names = isinstance(content.get("case"), dict) and "tolerances" in content["case"]
        if not own_names:
            parts.check_events(events, problems)
    return problems
