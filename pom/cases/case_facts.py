"""Facts of the aircraft in a case, and their contradictions with the case.

The aircraft file states the facts (``[facts]``), a case may state those that its aircraft file does
not.  The decision speed alone may differ from case to case, since it depends on weight and flaps.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from flightmech.aircraft.facts import MASS_ROUNDING, FactsTable, FileFacts, read_facts
from flightmech.errors import AeromatchError, SchemaError, UnitError
from flightmech.names import lookup, value_text
from flightmech.quantities import parse_quantity
from pom.cases.case_file import CaseFile

REVERSIBLE = "reversible_controls"
"""Feature of cases, condition of rows and fact of the aircraft: pilot forces are judged."""

OF_CASE = ("v1",)
"""Facts that may differ from case to case."""

_SAME = 1e-3  # relative difference of two numbers that is rounding
_CONTROL_SLACK = 0.01  # of the travel: rounding
ENGINE = re.compile(r"^engine(\d+)\.")
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
    loaded = stated.hinge_loaded if stated is not None else ()
    if facts.get(REVERSIBLE) is False and loaded:
        problems.append(
            f"facts.{REVERSIBLE}: no, and [circuit.{loaded[0]}] of the aircraft file {aircraft} "
            "has "
            f"no centring spring, so the hinge moment of the surface is all that the pilot feels; "
            f"correct one of the two"
        )
    if REVERSIBLE in features:
        facts.setdefault(REVERSIBLE, True)
    elif facts.get(REVERSIBLE):
        features = (*features, REVERSIBLE)
    _check_engines(file, facts, problems)
    _check_mass(file, facts, problems)
    if stated is not None:
        _check_controls(file, stated.limits, problems)
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
    if count and file.drive.engine == "none":
        problems.append(
            f'drive.engine: "none" is for an aircraft without engines, and this one has {count}; '
            f'write what was recorded of them, such as "thrust", "n1" or "throttle"'
        )
    if count == 0 and file.drive.engine != "none":
        problems.append(
            f'drive.engine: "{file.drive.engine}" drives engines, and the aircraft has none '
            f'([facts] engines); write drive.engine = "none"'
        )
    tables = (file.conditions, file.ranges, file.tolerance, file.rationale)
    names = [file.case.engine_parameter, *file.case.show]
    for table in tables:
        names += table
    for name in dict.fromkeys(names):
        match = ENGINE.match(name)
        if match and int(match.group(1)) > count:
            problems.append(f"{name}: {missing_engine_text(int(match.group(1)), count)}")


def _check_mass(file: CaseFile, facts: Mapping[str, Any], problems: list[str]) -> None:
    """Check that the mass of the conditions is not above the largest take-off mass."""
    if "mass" not in file.conditions or "mtow" not in facts:
        return
    try:
        mass = parse_quantity(file.conditions["mass"], "kg")
    except UnitError:
        # the conditions report it
        return
    problem = overweight_text(mass, facts["mtow"])
    if problem:
        problems.append(f"conditions.mass: {problem}")


def _check_controls(file: CaseFile, limits: Mapping[str, Any], problems: list[str]) -> None:
    """Check that the conditions hold no control beyond the limits of the aircraft file."""
    for name in file.conditions.keys() & limits.keys():
        try:
            units = lookup(name).units
            low, high = (parse_quantity(limit, units) for limit in limits[name])
            value = parse_quantity(file.conditions[name], units)
        except (AeromatchError, TypeError, ValueError):
            # the conditions and the reader of the aircraft report it
            continue
        slack = _CONTROL_SLACK * (high - low)
        if not low - slack <= value <= high + slack:
            problems.append(
                f"conditions.{name}: {value_text(name, value)} is beyond the limits of the "
                f"aircraft file, {value_text(name, low)} to {value_text(name, high)}; a number "
                f"without a unit is in {units}: correct the value, or [limits]"
            )


def overweight_text(mass: float, most: float) -> str:
    """Return the text on a mass above the largest take-off mass; empty for one below. [kg]"""
    if mass <= most * (1.0 + MASS_ROUNDING):
        return ""
    return (
        f"the mass at the start, {mass:.5g} kg, is above the largest take-off mass of the "
        f"aircraft, {most:.5g} kg ([facts] mtow); correct one of the two"
    )


def missing_engine_text(number: int, count: int) -> str:
    """Return the text on an engine that the aircraft does not have."""
    return (
        f"engine {number}, and the aircraft has {count} ([facts] engines); correct one of the two"
    )
