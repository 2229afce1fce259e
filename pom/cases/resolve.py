"""The parts of a case file resolved one by one; what is wrong is added to a list of problems, so
that all are reported at once.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.units import parse_quantity
from pom.cases.case_file import BRAKES, CONDITIONS, FORCES, SURFACES, TRAVEL, CaseFile, LoopTable
from pom.cases.pilot import PilotLoop
from pom.tolerances import rows as table
from pom.tolerances.conditions import missing_claims
from pom.tolerances.criteria import Criterion
from pom.tolerances.overrides import apply_override
from pom.tolerances.rows import required_signals

T = TypeVar("T")

MOVABLE = (*SURFACES, *TRAVEL, *FORCES, "throttle", "speedbrake", "delta_nw", *BRAKES)
"""Controls that a loop of the math pilot may move; ``throttle`` moves the levers of all engines alike."""

BIASES = ("delta_e", "delta_a", "delta_r", "thrust", "throttle", *FORCES)
REMAINDERS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
LIMIT_UNITS = (
    {name: lookup(name).units for name in BIASES}
    | {name: "m s-2" for name in REMAINDERS[:3]}
    | dict.fromkeys(REMAINDERS[3:], "rad s-2")
)
"""What a trim finds and leaves, with its SI unit: keys of ``drive.limits``, outputs ``trim.*`` of a model."""

SEGMENTS = ("elapsed", "segment_mean", "floor")
"""Measures over a segment: rows that name no events of their own may be bounded by ``segment_start`` and ``segment_end``."""

EQUIPMENT = frozenset(
    {
        *("spoiler", "stabilizer", "rudder_tab", "tiller_force", "prop_lever"),
        *("epr", "torque", "manifold_pressure", "brake_pressure"),
    }
)
"""Parameters that an aeroplane need not have; a case that states so in ``case.absent`` is not judged on them."""

KINDRED = (
    {"V", "V_cas", "V_eas", "V_ground", "mach", "qbar", "u", "distance"},
    {"theta", "q", "q_dot"},
    {"phi", "p", "p_dot"},
    {"psi", "r", "r_dot", "psi_dot", "y_runway"},
    {"h", "h_agl", "h_baro", "hdot", "gamma"},
    {"alpha", "w", "alpha_dot"},
    {"beta", "v", "beta_dot", "ay"},
    {"nz", "az", "dnz"},
)
"""Channels that cannot be held without holding each other: an integral or a derivative apart."""


def collect_case_problems(
    problems: list[str], place: str, act: Callable[..., T], *items: Any
) -> T | None:
    """Return ``act(*items)``; an error of the package becomes one more problem."""
    try:
        return act(*items)
    except SchemaError as error:
        problems += [f"{place}: {text}" for text in error.problems]
        return None
    except AeromatchError as error:
        problems.append(f"{place}: {error}")
        return None


_BEARING = {"id", "standard", "edition", "window", "features", "shortened", "record"}
"""Keys of ``[case]`` without which the rest cannot be checked."""


def sound_rest(content: Mapping[str, Any]) -> CaseFile | None:
    """Return a case file of wrong form without the keys that are wrong, so that all else can be
    looked at in the same go.

    None when windows and rows depend on what is wrong.
    """
    rest = deepcopy(dict(content))
    try:
        return CaseFile.model_validate(rest)
    except ValidationError as error:
        for item in error.errors():
            place = item["loc"]
            if place[0] == "events" or (
                place[0] == "case" and (len(place) == 1 or place[1] in _BEARING)
            ):
                return None
            if item["type"] != "missing":
                _remove(rest, place)
    try:
        return CaseFile.model_validate({**rest, "case": {"name": "", "title": "", **rest["case"]}})
    except ValidationError:
        return None


def _remove(content: Any, place: tuple[int | str, ...]) -> None:
    """Take the deepest part of a place that the content has out of it."""
    *above, last = place
    for key in above:
        below = content.get(key) if isinstance(content, dict) else None
        if not isinstance(below, dict):
            last = key
            break
        content = below
    if isinstance(content, dict):
        content.pop(last, None)


def resolve_quantities(
    place: str, found: Mapping[str, Any], units: Mapping[str, str], what: str, problems: list[str]
) -> dict[str, float]:
    """Return the SI values of a table whose keys are those of `units`."""
    values = {}
    for name, item in found.items():
        if name not in units:
            problems.append(f"{place}: {UnknownName(name, units, what)}")
            continue
        value = collect_case_problems(
            problems, f"{place}.{name}", parse_quantity, item, units[name]
        )
        if value is None:
            continue
        if not math.isfinite(value):
            problems.append(f"{place}.{name}: {value:g} is not finite; give a number with its unit")
            continue
        values[name] = value
    return values


def resolve_conditions(found: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[conditions]`` in SI."""
    return resolve_quantities(
        "conditions",
        found,
        {name: lookup(name).units for name in CONDITIONS},
        "condition",
        problems,
    )


def resolve_trim_limits(found: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``drive.limits`` in SI, all positive."""
    values = resolve_quantities("drive.limits", found, LIMIT_UNITS, "bias of the trim", problems)
    problems += [
        f"drive.limits.{name}: {value:g} is not positive; a limit is a largest size"
        for name, value in values.items()
        if not value > 0.0
    ]
    return values


def resolve_ranges(found: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[ranges]`` in SI."""
    units = {}
    for name in found:
        row = collect_case_problems(problems, "ranges", lookup, name)
        if row is not None:
            units[name] = row.units
    return resolve_quantities(
        "ranges", {name: found[name] for name in units}, units, "channel", problems
    )


def check_events(found: Mapping[str, Any], problems: list[str]) -> None:
    """Check the names of ``[events]``."""
    for name in found:
        if name not in table.window_events():
            problems.append(f"events: {UnknownName(name, table.window_events(), 'event')}")


def check_names(
    place: str, found: Mapping[str, Any], allowed: set[str], what: str, problems: list[str]
) -> None:
    """Check the keys of a table of texts."""
    problems += [
        f"{place}: {UnknownName(name, allowed, what)}" for name in found if name not in allowed
    ]


def resolve_named_file(path: Path, name: str, key: str, problems: list[str]) -> str:
    """Return a file that a case names, relative to the case file; empty for none."""
    if not name:
        return ""
    found = path.parent / name
    if not found.is_file():
        problems.append(f"{key}: no file {found}; the name is relative to the case file")
    return os.path.normpath(found)


def resolve_criteria(file: CaseFile, problems: list[str]) -> list[Criterion]:
    """Return the rows of the test as criteria, with what the case file sets for bands."""
    case = file.case
    rows = (
        collect_case_problems(
            problems, "case.id", table.rows_of_test, case.id, case.standard, case.edition
        )
        or []
    )
    optional = sorted({row["parameter"] for row in rows} & EQUIPMENT)
    problems += [
        f"case.absent: {UnknownName(name, optional, 'equipment of this test')}"
        for name in case.absent
        if name not in optional
    ]
    found = []
    for row, name in zip(rows, table.names_of(rows), strict=True):
        window = _window(row, name, file, problems)
        criterion = table.make_criterion(
            row, name, window, case.features, case.mode_channel, case.engine_parameter
        )
        if row["parameter"] in case.absent:
            criterion = replace(
                criterion,
                applies=False,
                reason=f"the aeroplane has no {row['parameter']}: case.absent of the case file",
            )
        if (
            criterion.applies
            and criterion.measure.startswith("response_")
            and not criterion.channel
        ):
            problems.append(
                f"case.engine_parameter: missing; row {name} needs the channel of the "
                f"critical engine parameter"
            )
        if criterion.applies and criterion.measure == "steady" and "capture" not in file.events:
            problems.append(
                f"events.capture: missing; row {name} is a snapshot and needs its instant"
            )
        found.append(criterion)
    for key, item in file.tolerance.items():
        changed = collect_case_problems(
            problems, f"tolerance.{key}", apply_override, found, key, item, case.window
        )
        found = changed if changed is not None else found
    return found


def _window(row: table.Row, name: str, file: CaseFile, problems: list[str]) -> tuple[float, float]:
    """Return the window of a row; longer than the case's window only with a stated reason."""
    start, stop = file.case.window
    if missing_claims(row["condition"], file.case.features):
        return file.case.window
    found = []
    ends = (start, stop)
    if row["measure"] in SEGMENTS:
        ends = file.events.get("segment_start", start), file.events.get("segment_end", stop)
    for bound, default in zip((row["applies_from"], row["applies_to"]), ends, strict=True):
        time = collect_case_problems(
            problems, f"events, row {name}", table.bound_time, bound, file.events, default
        )
        found.append(default if time is None else float(time))
    asked = f"{found[0]:g} ... {found[1]:g} s"
    inside = max(found[0], start), min(found[1], stop)
    if not inside[0] < inside[1]:
        problems.append(
            f"events: row {name} requires {asked}, outside the case window {start:g} ... {stop:g} s"
        )
    elif inside != (found[0], found[1]) and not file.case.shortened:
        problems.append(
            f"case.window: {start:g} ... {stop:g} s is shorter than row {name} asks "
            f"({asked}, {row['applies_from']} to "
            f"{row['applies_to'] or 'the end'}); widen it, or give the reason in case.shortened"
        )
    return inside


def scale_tolerances(
    found: Sequence[Criterion], fraction: float, largest: Mapping[str, float]
) -> tuple[Criterion, ...]:
    """Return criteria with the share of the tolerance that is applied and the largest values in
    service.
    """
    return tuple(replace(c, fraction=fraction, largest=largest.get(c.channel)) for c in found)


def tolerance_fraction(file: CaseFile) -> float:
    """Return the share of the tolerance: as written, else by reference and edition (rule R9 of the
    table).
    """
    if file.case.fraction is not None:
        return file.case.fraction
    if file.case.reference != "engineering":
        return 1.0
    return 0.2 if file.case.edition[:4] < "2016" else 0.4


def resolve_pilot_loops(file: CaseFile, problems: list[str]) -> tuple[PilotLoop, ...]:
    """Return the loops of the math pilot in SI."""
    tables = file.drive.pilot
    if bool(tables) != (file.drive.surfaces == "pilot"):
        problems.append('drive.pilot: loops and surfaces = "pilot" go together; give both, or none')
    found = [_loop(item, f"drive.pilot.{i}", problems) for i, item in enumerate(tables)]
    levels = {drive_level(item.control) for item in tables} - {""}
    if len(levels) > 1:
        problems.append(
            f"drive.pilot: the loops move controls of {len(levels)} levels "
            f"({', '.join(sorted(levels))}); one level drives a model"
        )
    return tuple(loop for loop in found if loop is not None)


def drive_level(control: str) -> str:
    """Return the level of drive that a control belongs to; empty for those that belong to all."""
    level = {name: "recorded" for name in ("delta_e", "delta_a", "delta_r")}
    return (level | dict.fromkeys(TRAVEL, "cockpit") | dict.fromkeys(FORCES, "force")).get(
        control, ""
    )


def _loop(item: LoopTable, where: str, problems: list[str]) -> PilotLoop | None:
    if item.control not in MOVABLE:
        problems.append(f"{where}.control: {UnknownName(item.control, MOVABLE, 'control')}")
        return None
    channel = collect_case_problems(problems, f"{where}.channel", lookup, item.channel)
    if channel is None:
        return None
    moved, held = lookup(item.control).units, channel.units
    units = {"gain": f"{moved}/{held}", "integral": f"{moved}/{held} s", "limit": moved}
    given = {key: getattr(item, key) for key in units}
    before = len(problems)
    values = resolve_quantities(where, given, units, "key", problems)
    if values.get("limit", 1.0) <= 0.0:
        problems.append(
            f"{where}.limit: {values['limit']:g} is not positive; a limit is the largest correction"
        )
    return PilotLoop(item.control, item.channel, **values) if len(problems) == before else None


def forbid_judged(
    loops: Sequence[PilotLoop], found: Sequence[Criterion], problems: list[str]
) -> None:
    """Report every loop that holds what is judged: qtg-report practice, section 5; a controller
    would pass any model.
    """
    for loop in loops:
        kindred = {loop.channel}.union(*(group for group in KINDRED if loop.channel in group))
        judged = [
            c for c in found if c.applies and not c.reason and kindred & set(required_signals(c))
        ]
        if judged:
            rows = ", ".join(f"{c.name} ({', '.join(required_signals(c))})" for c in judged)
            problems.append(
                f"drive.pilot: the loop of {loop.control} holds {loop.channel}, on which "
                f"{rows} is judged; a math pilot may not fly "
                "what is judged: hold another channel, or drop the loop"
            )


def certified_values(found: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    """Return ``[certified]``: fractions, such as climb gradients."""
    return resolve_quantities("certified", found, dict.fromkeys(found, "1"), "parameter", problems)
