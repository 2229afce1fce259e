"""Resolution of the parts of a case file.

Every function adds the problems of its part to a list, so that one error reports all of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from flightmech.aircraft.controls import DEVICE
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import is_quantity, lookup
from flightmech.quantities import parse_quantity, time_text
from flightmech.simulation.stated_values.odd_values import describe_odd_quantity
from pom.cases.case_file import CONDITIONS, ENGINE_LEVER, FORCES, FUEL_SWITCH, CaseFile
from pom.tolerances import rows as table
from pom.tolerances.conditions import missing_claims
from pom.tolerances.criteria import Criterion
from pom.tolerances.overrides import apply_override, replaced_rows
from pom.tolerances.own_tables import needs_mode_channel

T = TypeVar("T")
BIASES = ("delta_e", "delta_a", "delta_r", "thrust", "throttle", *FORCES)
REMAINDERS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
LIMIT_UNITS = (
    {name: lookup(name).units for name in BIASES}
    | {name: "m s-2" for name in REMAINDERS[:3]}
    | dict.fromkeys(REMAINDERS[3:], "rad s-2")
)
"""SI units of the biases and residual accelerations of a trim.

The names are the keys of ``drive.limits`` and the outputs ``trim.*`` of a model.
"""

SEGMENTS = ("elapsed", "segment_mean", "floor")
"""Measures over a segment.

The events ``segment_start`` and ``segment_end`` bound their rows if a row names no events.
"""

EQUIPMENT = frozenset(
    {
        "spoiler",
        "stabilizer",
        "rudder_tab",
        "tiller_force",
        "prop_lever",
        "epr",
        "torque",
        "manifold_pressure",
        "brake_pressure",
    }
)
"""Parameters of optional equipment.  ``case.absent`` removes them from the judgement of a case."""


def collect_case_problems(
    problems: list[str], key: str, act: Callable[..., T], *items: Any
) -> T | None:
    """Return ``act(*items)``; if it raises, add a problem of the key and return None."""
    try:
        return act(*items)
    except SchemaError as error:
        problems += [f"{key}: {text}" for text in error.problems]
        return None
    except AeromatchError as error:
        problems.append(f"{key}: {error}")
        return None


_BEARING = {"id", "standard", "edition", "window", "features", "shortened", "record"}
"""Keys of ``[case]`` on which the checks of the other tables depend."""


def sound_rest(content: Mapping[str, Any]) -> CaseFile | None:
    """Return a case file without its wrong keys, so that the other keys can be checked.

    None if windows and rows depend on a wrong key.
    """
    sound = deepcopy(dict(content))
    try:
        return CaseFile.model_validate(sound)
    except ValidationError as error:
        for item in error.errors():
            location = item["loc"]
            if _is_bearing(location):
                return None
            if item["type"] != "missing":
                _remove_key(sound, location)
    # A missing name or title does not affect the other checks.
    try:
        named = {**sound, "case": {"name": "", "title": "", **sound["case"]}}
        return CaseFile.model_validate(named)
    except ValidationError:
        return None


def _is_bearing(location: tuple[int | str, ...]) -> bool:
    if location[0] == "case":
        return len(location) == 1 or location[1] in _BEARING
    return location[0] == "events"


def _remove_key(content: Any, location: tuple[int | str, ...]) -> None:
    """Remove the deepest key of a location from nested tables."""
    *parents, last = location
    for key in parents:
        if not isinstance(content, dict):
            return
        child = content.get(key)
        if not isinstance(child, dict):
            # The location goes on inside an array or names a type of a union: remove the value.
            last = key
            break
        content = child
    if isinstance(content, dict):
        content.pop(last, None)


def resolve_quantities(
    key: str,
    entries: Mapping[str, Any],
    units: Mapping[str, str],
    *,
    what: str,
    problems: list[str],
) -> dict[str, float]:
    """Return the SI values of a table of the case file; `units` holds the allowed names."""
    values = {}
    for name, item in entries.items():
        if name not in units:
            problems.append(f"{key}: {UnknownName(name, units, what)}")
            continue
        value = collect_case_problems(problems, f"{key}.{name}", parse_quantity, item, units[name])
        if value is None:
            continue
        if not math.isfinite(value):
            problems.append(f"{key}.{name}: {value:g} is not finite; give a number with its unit")
            continue
        values[name] = value
    return values


def resolve_conditions(entries: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[conditions]`` in SI; further controls of the tables are allowed, too."""
    units = {name: lookup(name).units for name in CONDITIONS}
    devices = [name for name in entries if name.startswith(DEVICE) and is_quantity(name)]
    levers = [name for name in entries if ENGINE_LEVER.match(name)]
    fuel = [name for name in entries if FUEL_SWITCH.match(name)]
    units |= {name: lookup(name).units for name in (*devices, *levers, *fuel)}
    values = resolve_quantities(
        "conditions", entries, units=units, what="condition", problems=problems
    )
    for name, value in values.items():
        # a bare number in degrees or feet makes a flight that no aeroplane has
        if odd := describe_odd_quantity(name, value):
            problems.append(f"conditions.{name}: {odd}")
    return values


def resolve_trim_limits(entries: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``drive.limits`` in SI, all positive."""
    values = resolve_quantities(
        "drive.limits", entries, units=LIMIT_UNITS, what="bias of the trim", problems=problems
    )
    for name, value in values.items():
        if not value > 0.0:
            problems.append(
                f"drive.limits.{name}: {value:g} is not positive; a limit is a largest size"
            )
    return values


def resolve_ranges(entries: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[ranges]`` in SI."""
    units = {}
    for name in entries:
        entry = collect_case_problems(problems, "ranges", lookup, name)
        if entry is not None:
            units[name] = entry.units
    # unknown names are already among the problems
    named = {name: entries[name] for name in units}
    return resolve_quantities("ranges", named, units=units, what="channel", problems=problems)


def check_events(
    events: Mapping[str, Any], problems: list[str], own_rows: Sequence[table.Row] = ()
) -> None:
    """Check the names of ``[events]``; `own_rows` are those of a table of the user."""
    allowed = table.window_events(own_rows)
    for name in events:
        if name not in allowed:
            problems.append(f"events: {UnknownName(name, allowed, 'event')}")
        if name.endswith("_start"):
            _check_event_order(events, name, f"{name.removesuffix('_start')}_end", problems)


def check_event_times(
    events: Mapping[str, float], window: tuple[float, float], problems: list[str]
) -> None:
    """Add the events that lie farther outside of the window of a case than the window is long."""
    start, stop = window
    for name, time in events.items():
        outside = max(start - time, time - stop)
        if outside > stop - start:
            problems.append(
                f"events.{name}: {time_text(time)} s lies far outside of the window of the case, "
                f"{time_text(start)} ... {time_text(stop)} s; events count in seconds on the clock "
                f"of the record: correct it"
            )


def check_names(
    key: str, names: Iterable[str], *, allowed: set[str], what: str, problems: list[str]
) -> None:
    """Check the names in a table of the case file."""
    for name in names:
        if name not in allowed:
            problems.append(f"{key}: {UnknownName(name, allowed, what)}")


def resolve_named_file(path: Path, name: str, *, key: str, problems: list[str]) -> str:
    """Return the path of a file that a case names relative to the case file; empty for none."""
    if not name:
        return ""
    file = path.parent / name
    if not file.is_file():
        problems.append(f"{key}: no file {file}; the name is relative to the case file")
    return os.path.normpath(file)


def resolve_criteria(
    file: CaseFile,
    problems: list[str],
    equipment: Iterable[str] = (),
    own_rows: Sequence[table.Row] = (),
) -> list[Criterion]:
    """Return the rows of the test as criteria, with the bands of the case file applied.

    `equipment` is missing by the facts of the aircraft, whose file serves all tests.  `own_rows`
    are those of a table of the user, in place of ``tolerances.csv``.
    """
    case = file.case
    find_rows = partial(table.rows_of_test, case.id, case.standard, case.edition, own_rows)
    rows = collect_case_problems(problems, "case.id", find_rows)
    # an unknown test has no rows
    rows = rows or []
    optional = sorted({row["parameter"] for row in rows} & EQUIPMENT)
    for name in equipment:
        if name not in EQUIPMENT:
            problems.append(f"facts.without: {UnknownName(name, EQUIPMENT, 'equipment')}")
    for name in case.absent:
        if name not in optional and name not in equipment:
            error = UnknownName(name, optional, "equipment of this test")
            problems.append(f"case.absent: {error}")
    criteria = []
    for row, name in zip(rows, table.names_of(rows), strict=True):
        criterion = _make_criterion(row, name, file=file, problems=problems)
        _check_criterion(criterion, name, file=file, problems=problems)
        if own_rows and criterion.applies and needs_mode_channel(row) and not criterion.channel:
            problems.append(
                f"case.mode_channel: missing; row {name} of the own table needs the channel on "
                f"which the mode is measured, such as V_cas or r"
            )
        criteria.append(criterion)
    # An entry with a problem leaves the criteria as they are, so that the others are checked.
    for key, override in file.tolerance.items():
        override_band = partial(apply_override, criteria, key, override, case.window)
        overridden = collect_case_problems(problems, f"tolerance.{key}", override_band)
        if overridden is not None:
            criteria = overridden
    problems += replaced_rows(criteria)
    return criteria


def _make_criterion(row: table.Row, name: str, *, file: CaseFile, problems: list[str]) -> Criterion:
    """Return the criterion of a row; it does not apply if the aeroplane lacks its equipment."""
    case = file.case
    criterion = table.make_criterion(
        row,
        name,
        window=_resolve_window(row, name, file=file, problems=problems),
        features=case.features,
        mode_channel=case.mode_channel,
        engine_parameter=case.engine_parameter,
    )
    if row["parameter"] in case.absent:
        reason = f"the aeroplane has no {row['parameter']}"
        return replace(criterion, applies=False, reason=reason)
    return criterion


def _check_criterion(
    criterion: Criterion, name: str, *, file: CaseFile, problems: list[str]
) -> None:
    """Check that the case file has the keys that a criterion needs."""
    if not criterion.applies:
        return
    if criterion.measure.startswith("response_") and not criterion.channel:
        problems.append(
            f"case.engine_parameter: missing; row {name} needs the channel of the critical engine "
            f"parameter"
        )
    if criterion.measure == "steady" and "capture" not in file.events:
        problems.append(f"events.capture: missing; row {name} is a snapshot and needs its instant")


def _resolve_window(
    row: table.Row, name: str, *, file: CaseFile, problems: list[str]
) -> tuple[float, float]:
    """Return the window of a row; it exceeds the window of the case only with a stated reason."""
    start, stop = file.case.window
    if missing_claims(row["condition"], file.case.features):
        # the row does not apply, so its events may be missing
        return file.case.window
    defaults = (start, stop)
    if row["measure"] in SEGMENTS:
        defaults = file.events.get("segment_start", start), file.events.get("segment_end", stop)
    # without an event, a bound is the default
    bounds = []
    for bound, default in zip((row["applies_from"], row["applies_to"]), defaults, strict=True):
        try:
            bounds.append(float(table.bound_time(bound, file.events, default)))
        except UnknownName as error:
            bounds.append(default)
            _add_missing_event(error.name, name, file.events, problems)
    named = [table.event_of(row[key]) for key in ("applies_from", "applies_to")]
    _check_event_order(file.events, named[0], named[1], problems)
    first, last = bounds
    required = f"{time_text(first)} ... {time_text(last)} s"
    inside = max(first, start), min(last, stop)
    if not inside[0] < inside[1]:
        problems.append(
            f"events: row {name} requires {required}, outside the case window "
            f"{time_text(start)} ... {time_text(stop)} s"
        )
    elif inside != (first, last) and not file.case.shortened:
        problems.append(
            f"case.window: {time_text(start)} ... {time_text(stop)} s is shorter than row {name} "
            "asks "
            f"({required}, {row['applies_from']} to {row['applies_to'] or 'the end'}); widen it, "
            f"or give the reason in case.shortened"
        )
    return inside


def _add_missing_event(
    event: str, row: str, events: Mapping[str, float], problems: list[str]
) -> None:
    """Add the problem of an event that bounds a row and has no time; once for all rows."""
    start = f"events.{event}: missing; "
    if any(problem.startswith(start) for problem in problems):
        return
    given = ", ".join(events) or "no events"
    problems.append(
        f"{start}row {row} is judged from or to this event, and the case has {given}; write its "
        f"time on the clock of the record, such as [events] {event} = 6.0"
    )


def _check_event_order(
    events: Mapping[str, Any], first: str, last: str, problems: list[str]
) -> None:
    """Add the problem of an event that is not before the event that follows it."""
    # an event of another form is already among the problems
    times = [events.get(name) for name in (first, last)]
    numbers = [time for time in times if isinstance(time, int | float)]
    if first == last or len(numbers) < 2 or numbers[0] < numbers[1]:
        return
    text = (
        f"events: {first} {time_text(numbers[0])} s is not before {last} {time_text(numbers[1])} "
        "s, which follows "
        f"it; exchange or correct the two times"
    )
    if text not in problems:
        problems.append(text)


def scale_tolerances(
    criteria: Sequence[Criterion], fraction: float, largest: Mapping[str, float]
) -> tuple[Criterion, ...]:
    """Return criteria with the share of the tolerance and the largest values in service."""
    scaled = []
    for criterion in criteria:
        largest_value = largest.get(criterion.channel)
        scaled.append(replace(criterion, fraction=fraction, largest=largest_value))
    return tuple(scaled)


def tolerance_fraction(file: CaseFile) -> float:
    """Return the share of the tolerance that is applied.

    Without ``case.fraction`` it follows from reference and edition (rule R9 of the table).
    """
    if file.case.fraction is not None:
        return file.case.fraction
    return table.usual_fraction(file.case.reference, file.case.edition)


def certified_values(entries: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[certified]``: fractions, for example climb gradients."""
    units = dict.fromkeys(entries, "1")
    return resolve_quantities(
        "certified", entries, units=units, what="parameter", problems=problems
    )
