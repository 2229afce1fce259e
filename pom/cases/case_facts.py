"""Facts of the aircraft in a case, and their contradictions: with the case, between cases.

The aircraft file states the facts (``[facts]``), a case may state those that its aircraft file does
not.  The decision speed alone may differ from case to case, since it depends on weight and flaps.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.aircraft.facts import MASS_ROUNDING, FactsTable, FileFacts, read_facts
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from pom.cases.case_file import CaseFile
from pom.tolerances.rows import rows_of_test

if TYPE_CHECKING:
    from pom.cases.case import PomCase

REVERSIBLE = "reversible_controls"
"""Feature of cases, condition of rows and fact of the aircraft: pilot forces are judged."""

OF_CASE = ("v1",)
"""Facts that may differ from case to case."""

_SAME = 1e-3  # relative difference of two numbers that is rounding
_ENGINE = re.compile(r"^engine(\d+)\.")
_TEXTS = {"mtow": "kg", "basic_operating_weight": "kg", "v1": "m/s", "mean_chord": "m"}


def resolve_facts(
    file: CaseFile, aircraft: str, problems: list[str]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the facts of a case and its features.

    Parameters
    ----------
    file : CaseFile
    aircraft : str
        Its aircraft file; empty for none.
    problems : list of str
        Gets the contradictions between case and aircraft file.

    Returns
    -------
    (dict, tuple of str)
        Known facts by name [SI], and the features of the case with those that follow from facts.
    """
    own = _table_facts(file.facts)
    stated = file_facts(aircraft, problems)
    facts = dict(stated.facts.known()) if stated is not None else {}
    for name, value in own.items():
        known = facts.get(name)
        if known is not None and name not in OF_CASE and not is_same_fact(known, value):
            problems.append(
                f"facts.{name}: {fact_text(name, value)} contradicts {fact_text(name, known)} of "
                f"the aircraft file {aircraft}; correct one of the two"
            )
        facts[name] = value
    features = file.case.features
    if REVERSIBLE in features and facts.get(REVERSIBLE) is False:
        problems.append(
            f"case.features: {REVERSIBLE} contradicts the facts of the aircraft, whose controls "
            f"are not reversible; leave it out, or correct [facts]"
        )
    if REVERSIBLE in features:
        facts.setdefault(REVERSIBLE, True)
    elif facts.get(REVERSIBLE):
        features = (*features, REVERSIBLE)
    _check_engines(file, facts, problems)
    return facts, features


def _table_facts(table: FactsTable) -> dict[str, Any]:
    return table.facts().known()


def file_facts(aircraft: str, problems: list[str] | None = None) -> FileFacts | None:
    """Return what an aircraft file states; None without a readable file."""
    if not aircraft:
        return None
    try:
        return read_facts(aircraft)
    except SchemaError as error:
        if problems is not None:
            problems += [f"{error.what}: {text}" for text in error.problems]
    except (AeromatchError, OSError):
        # the reader of the aircraft reports a missing or damaged file
        return None
    return None


def fact_text(name: str, value: Any) -> str:
    """Return a fact as a text with its unit."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.5g} {_TEXTS.get(name, '')}".strip()
    if isinstance(value, list | tuple):
        return ", ".join(value)
    return str(value)


def is_same_fact(a: Any, b: Any) -> bool:
    """Return whether two values of a fact agree up to rounding."""
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=_SAME)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return set(a) == set(b)
    return bool(a == b)


def _check_engines(file: CaseFile, facts: Mapping[str, Any], problems: list[str]) -> None:
    """Check that a case names no engine that the aircraft does not have."""
    count = facts.get("engines")
    if count is None:
        return
    tables = (file.conditions, file.ranges, file.tolerance, file.rationale)
    names = [file.case.engine_parameter, *file.case.show]
    for table in tables:
        names += table
    for name in dict.fromkeys(names):
        match = _ENGINE.match(name)
        if match and int(match.group(1)) > count:
            problems.append(f"{name}: {_missing_engine(int(match.group(1)), count)}")


def _missing_engine(number: int, count: int) -> str:
    return (
        f"engine {number}, and the aircraft has {count} ([facts] engines); correct one of the two"
    )


def check_record_facts(case: PomCase, states: xr.Dataset) -> None:
    """Check that a record does not contradict the facts of the aircraft of its case.

    Raises
    ------
    SchemaError
        The aeroplane is heavier than its largest take-off mass, or the record has an engine that
        the aircraft does not have.
    """
    problems = []
    most = case.facts.get("mtow")
    mass = case.conditions.get("mass")
    if mass is None and "mass" in states:
        mass = float(np.atleast_1d(states["mass"].values)[0])
    if most is not None and mass is not None and mass > most * (1.0 + MASS_ROUNDING):
        problems.append(
            f"the mass at the start, {mass:.5g} kg, is above the largest take-off mass of the "
            f"aircraft, {most:.5g} kg ([facts] mtow); correct one of the two"
        )
    count = case.facts.get("engines")
    numbers = {int(match.group(1)) for match in map(_ENGINE.match, map(str, states)) if match}
    for number in sorted(numbers):
        if count is not None and number > count:
            problems.append(f"the record has {_missing_engine(number, count)}")
    if problems:
        raise SchemaError(f"case {case.name}", problems)


def contradictions(cases: Sequence[PomCase]) -> list[str]:
    """Return the contradictions between the cases of a report on facts of one aircraft.

    Cases are of one aircraft if their aircraft files have one name.  A case without an aircraft
    file is compared with all others.
    """
    problems = []
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
        rows = rows_of_test(case.id, case.standard, case.edition)
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
