"""Contradictions on facts of the aircraft: of a record with its case, and between cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from pom.cases.case import PomCase
from pom.cases.case_facts import (
    ENGINE,
    OF_CASE,
    REVERSIBLE,
    fact_text,
    file_facts,
    is_same_fact,
    missing_engine_text,
    overweight_text,
)


def check_record_facts(case: PomCase, states: xr.Dataset) -> None:
    """Check that a record does not contradict the facts of the aircraft of its case.

    Raises
    ------
    SchemaError
        The aeroplane is heavier than its largest take-off mass, or the record has an engine that
        the aircraft does not have.
    """
    problems: list[str] = []
    most = case.facts.get("mtow")
    mass = case.conditions.get("mass")
    if mass is None and "mass" in states:
        mass = float(np.atleast_1d(states["mass"].values)[0])
    if most is not None and mass is not None and overweight_text(mass, most):
        problems.append(overweight_text(mass, most))
    count = case.facts.get("engines")
    numbers = {int(match.group(1)) for match in map(ENGINE.match, map(str, states)) if match}
    for number in sorted(numbers):
        if count is not None and number > count:
            problems.append(f"the record has {missing_engine_text(number, count)}")
    if problems:
        raise SchemaError(f"case {case.name}", problems)


def contradictions(cases: Sequence[PomCase]) -> list[str]:
    """Return the contradictions between the cases of a report on facts of one aircraft.

    Cases are of one aircraft if their aircraft files have one name.  A case without an aircraft
    file is compared with all others.
    """
    problems: list[str] = []
    names = {case.aircraft: _aircraft_name(case.aircraft) for case in cases}
    by_facts: dict[Any, tuple[PomCase, str]] = {}
    # cases of equal facts contradict the others alike, so one of them stands for all
    for case in cases:
        key = names[case.aircraft], _key(case), _is_asked(case)
        by_facts.setdefault(key, (case, names[case.aircraft]))
    for (first, name), (second, other) in combinations(by_facts.values(), 2):
        if name and other and name != other:
            continue
        problems += _pair_problems(first, second)
    return list(dict.fromkeys(problems))


def _aircraft_name(aircraft: str) -> str:
    stated = file_facts(aircraft)
    return stated.name if stated is not None else ""


def _key(case: PomCase) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((name, repr(value)) for name, value in case.facts.items()))


def _is_asked(case: PomCase) -> bool:
    """Return whether rows of the test depend on reversible controls."""
    try:
        rows = case.printed_rows()
    except UnknownName:
        return False
    return any(REVERSIBLE in row["condition"].split(";") for row in rows)


def _pair_problems(first: PomCase, second: PomCase) -> Iterable[str]:
    for name in first.facts.keys() & second.facts.keys():
        if name in OF_CASE or is_same_fact(first.facts[name], second.facts[name]):
            continue
        yield (
            f"case {first.path}: {name} is {fact_text(name, first.facts[name])}, and case "
            f"{second.path} has {fact_text(name, second.facts[name])}; it is a fact of the "
            f"aircraft: state it once, in [facts] of the aircraft file"
        )
    for claims, silent in ((first, second), (second, first)):
        if claims.facts.get(REVERSIBLE) and REVERSIBLE not in silent.facts and _is_asked(silent):
            yield (
                f"case {silent.path}: {claims.path} claims {REVERSIBLE} and this case does not; "
                f"it is a fact of the aircraft: state it once, in [facts] of the aircraft file"
            )


def demand_agreement(cases: Sequence[PomCase]) -> None:
    """Raise if cases of a report contradict each other on facts of the aircraft.

    Raises
    ------
    SchemaError
        With every contradiction.
    """
    problems = contradictions(cases)
    if problems:
        raise SchemaError("cases", problems)
