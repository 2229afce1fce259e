"""A first case file for a record and a row of the tolerance table.

The record gives the events, the window and the drive. The file is written only if it is a valid
case (`read_case`). An event that the record does not show gets a time that keeps the file valid, a
comment and a remark. The engineer has to set it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from flightmech.errors import OutOfRange, UnknownName
from flightmech.quantities import time_text
from flightmech.support.atomic_write import written_atomically
from flightmech.units import from_si
from flighttest.records.record import needs_names
from pom.cases.case import PomCase, read_case
from pom.cases.drafting.draft_text import Draft, draft_text
from pom.cases.drafting.drive_choice import choose_drive, offered_drives
from pom.cases.drafting.event_detection import (
    HELD_STILL,
    Movement,
    Recorded,
    find_events,
    find_movement,
    input_channels,
    on_ground,
)
from pom.cases.drafting.listed_manoeuvres import (
    WHOLE_RUNS,
    demand_fitting,
    matching_manoeuvres,
)
from pom.cases.drafting.recorded_channels import recorded_channels
from pom.cases.reference_states import read_path_states
from pom.tolerances import rows as table
from pom.tolerances.conditions import missing_claims

LEAD = 1.0  # [s] of steady flight before the input
LONGEST_LEAD = 5.0  # [s] that a row requires before its event
# Quantities that can be the critical engine parameter of Ti and Tt, the first one recorded.
_RESPONSES = ("n1", "torque", "manifold_pressure", "rpm", "thrust")
HOMES = (".", "..")  # folders of a name map and an aircraft, relative to the record
_NOT_IN_NAMES = re.compile(r"[^a-z0-9]+")

Stretch = tuple[float, float]


def init_case(
    record: str | Path,
    test: str,
    output: str | Path,
    *,
    standard: str = table.STANDARD,
    edition: str = table.EDITION,
    names: str | Path | None = None,
    aircraft: str | Path | None = None,
    window: tuple[float, float] | None = None,
    name: str = "",
    force: bool = False,
) -> tuple[PomCase, list[str]]:
    """Write a commented case file for a record and a test of the tolerance table.

    Parameters
    ----------
    record : path
        Raw flight record, or one of `aeromatch flight reconstruct`.
    test : str
        Number in the table, such as ``2.c.10``.
    output : path
        The case file.  If it exists, it is overwritten only if `force` is true.
    names, aircraft : path, optional
        Name map and aircraft; default: ``names.toml`` and ``aircraft.toml`` next to the record or
        one folder up.
    window : tuple of float, optional
        Where to search the manoeuvre.  Default: the first listed manoeuvre that fits, else the
        whole record. [s]
    name : str, optional
        Name of the case; default: the title of the test.

    Returns
    -------
    PomCase, list of str
        The case, read from its file; and remarks on events that the record does not show.

    Raises
    ------
    FileExistsError
        The output exists, and `force` is false.
    UnknownName
        The table has no such standard, edition or test.
    SchemaError
        The record needs a name map, has no controls or thrust, or lists no manoeuvre that fits.
    """
    output, record = Path(output), Path(record)
    if output.exists() and not force:
        raise FileExistsError(f"{output} exists; give another name, or --force to overwrite it")
    rows = table.rows_of_test(test, standard, edition)
    map_file = _find_name_map(record, names)
    recorded = recorded_channels(record, map_file)
    if window is None:
        demand_fitting(str(record), test, recorded.manoeuvres)
    aircraft_file = _find_next_to(record, "aircraft.toml", aircraft)
    draft = draft_case(rows, recorded, window, drives=offered_drives(aircraft_file))
    draft.case.update(standard=standard, edition=edition)
    draft.case["name"] = name or draft.case["name"]
    _write_case_file(output, draft, record=record, names=map_file, aircraft=aircraft_file)
    return read_case(output), draft.remarks


def _write_case_file(output: Path, draft: Draft, **files: Path | None) -> None:
    """Write a draft and the names of its files as a case file, but only if the case is valid."""
    for key, file in files.items():
        if file is not None:
            draft.case[key] = Path(os.path.relpath(file, output.parent)).as_posix()
    with written_atomically(output) as part:
        # The first text is read for its criteria, which the comments of the second text list.
        part.write_text(draft_text(draft, ()), encoding="utf-8")
        part.write_text(draft_text(draft, read_case(part).criteria), encoding="utf-8")
        read_case(part)


def _find_name_map(record: Path, requested: str | Path | None) -> Path | None:
    """Return the name map of a record; None if the record has canonical names."""
    map_file = _find_next_to(record, "names.toml", requested)
    if requested is not None or map_file is None:
        return map_file
    # A file of `flight convert` has canonical names. The map next to it belongs to its source.
    if read_path_states(str(record)) is None and not needs_names(record):
        return None
    return map_file


def _find_next_to(record: Path, name: str, requested: str | Path | None) -> Path | None:
    """Return the requested file, else a file next to the record or one folder up."""
    if requested is not None:
        return Path(requested)
    for home in HOMES:
        file = record.parent / home / name
        if file.is_file():
            return file
    return None


def draft_case(
    rows: Sequence[table.Row],
    recorded: Recorded,
    window: tuple[float, float] | None = None,
    drives: Collection[str] | None = None,
) -> Draft:
    """Return the draft of a case for the rows of one test.

    Parameters
    ----------
    rows : sequence of Row
        Rows of the tolerance table.
    recorded : Recorded
    window : tuple of float, optional
        As in `init_case`. [s]
    drives : collection of str, optional
        Inputs that can drive the engines (`flightmech.aircraft.engine.engine_drives`), which are
        preferred.
    """
    test, title = rows[0]["test_id"], rows[0]["title"]
    remarks: list[str] = []
    applied = [row for row in rows if not missing_claims(row["condition"], ())]
    snapshot = all(row["measure"] == "steady" for row in applied)
    search, limits = _search_stretches(test, recorded, window, remarks=remarks, snapshot=snapshot)
    movement = find_movement(recorded, input_channels(test), search)
    needed = _needed_events(applied)
    times = find_events(needed, test, recorded, manoeuvre=search, window=limits)
    span = recorded.span
    start, stop = _replay_window(applied, times, movement, limits=limits, span=span)
    if _events_of_empty_rows(applied, times, (start, stop)):
        # Some row has nothing to compare: try the whole record.
        start, stop = _replay_window(applied, times, movement, limits=span, span=span)
    # Events that still leave a row empty are proposed at the edge of the window instead.
    unusable = _events_of_empty_rows(applied, times, (start, stop))
    times = {event: time for event, time in times.items() if event not in unusable}
    events = _place_events(applied, needed, times, window=(start, stop), remarks=remarks)
    case: dict[str, object] = {
        "id": test,
        "name": _NOT_IN_NAMES.sub("_", title.lower()).strip("_"),
        "title": title,
        "description": _movement_text(movement),
        "window": [start, stop],
    }
    event_times = {event: time for event, (time, _) in events.items()}
    shortened = _shortened_text(applied, event_times, (start, stop))
    if shortened:
        case["shortened"] = shortened
        remarks.append(shortened)
    if _has_engine_response(applied):
        case["engine_parameter"] = recorded.first(_RESPONSES) or "engine1.n1"
    conditions = {}
    if recorded.latitude is not None:
        conditions["lat"] = f"{from_si(recorded.latitude, 'deg'):.6g} deg"
    drive = choose_drive(
        rows,
        recorded,
        ground=on_ground(recorded, start),
        is_engine_test=_has_engine_response(rows),
        drives=drives,
    )
    return Draft(case, drive, conditions=conditions, events=events, remarks=remarks)


def _has_engine_response(rows: Sequence[table.Row]) -> bool:
    return any(row["measure"].startswith("response_") for row in rows)


def _search_stretches(
    test: str,
    recorded: Recorded,
    window: Stretch | None,
    *,
    remarks: list[str],
    snapshot: bool,
) -> tuple[Stretch, Stretch]:
    """Return where the input is searched, and the limits of the replay. [s]"""
    low, high = recorded.span
    if window is not None:
        inside = max(low, window[0]), min(high, window[1])
        if not inside[0] < inside[1]:
            raise OutOfRange(
                f"window {time_text(window[0])} ... {time_text(window[1])} s lies outside the "
                f"record, {time_text(low)} ... {time_text(high)} s; choose one "
                f"inside"
            )
        return inside, inside
    # The last listed manoeuvre may end shortly after the record.
    inside_record = []
    for each in recorded.manoeuvres:
        if low <= each.start < each.end <= high + LEAD:
            inside_record.append(each)
    fitting = matching_manoeuvres(test, inside_record)
    if not fitting:
        return (low, high), (low, high)
    first = fitting[0]
    start, end = max(low, first.start - 0.5 * LEAD), min(high, first.end)
    if len(fitting) > 1:
        others = ", ".join(
            f"{time_text(each.start)} ... {time_text(each.end)} s" for each in fitting[1:]
        )
        remarks.append(
            f"the record lists {len(fitting)} manoeuvres that fit; the first was taken, "
            f"--window chooses another: {others}"
        )
    if test.startswith(WHOLE_RUNS):
        return (start, end), (low, high)
    if snapshot:
        return (start, end), (max(low, first.start), end)
    # The response may last to the end of the record, but not into the next manoeuvre.
    last = high
    if any(each.start >= first.end - LEAD for each in recorded.manoeuvres):
        last = end
    return (start, end), (max(low, start - LONGEST_LEAD), last)


def _needed_events(rows: Sequence[table.Row]) -> list[str]:
    """Return the events that the rows of a test need, each once."""
    needed: dict[str, None] = {}
    for row in rows:
        for bound in (row["applies_from"], row["applies_to"]):
            if bound:
                needed[_event_of_bound(bound)] = None
    if any(row["measure"] == "steady" for row in rows):
        needed["capture"] = None
    return list(needed)


def _event_of_bound(bound: str) -> str:
    """Return the event of a bound such as ``change_start-5s``."""
    # The longest one: the name of an event may start with the name of another event.
    events = [event for event in table.window_events() if bound.startswith(event)]
    return max(events, key=len)


def _replay_window(
    rows: Sequence[table.Row],
    times: dict[str, float],
    movement: Movement | None,
    *,
    limits: Stretch,
    span: Stretch,
) -> tuple[float, float]:
    """Return start and end of the replay, with a second of steady flight before the input. [s]"""
    if "capture" in times and all(row["measure"] == "steady" for row in rows):
        return times["capture"] - HELD_STILL, times["capture"] + 1.0
    starts = _bound_times(rows, "applies_from", times)
    if "release" in times:
        starts.append(times["release"] - LEAD)
    elif movement is not None:
        starts.append(movement.start - LEAD)
    if not starts:
        starts.append(limits[0])
    if "brake_release" in times:
        starts.append(times["brake_release"] - 4.0 * LEAD)
    # Without an end in every row the replay runs to the limit.
    ends = []
    if all(row["applies_to"] for row in rows):
        ends = _bound_times(rows, "applies_to", times)
    start, stop = max(min(starts), limits[0]), limits[1]
    if ends:
        stop = min(max(ends), limits[1])
    if not start < stop:
        start, stop = limits
    # Round outwards to 0.1 s, but not beyond the record.
    low, high = np.floor(start * 10.0 + 1e-6) / 10.0, np.ceil(stop * 10.0 - 1e-6) / 10.0
    if low < span[0] - 1e-9:
        low = np.ceil(span[0] * 10.0 - 1e-6) / 10.0
    if high > span[1] + 1e-9:
        high = np.floor(span[1] * 10.0 + 1e-6) / 10.0
    # Adding zero turns -0.0 into 0.0.
    return float(low) + 0.0, float(high)


def _events_of_empty_rows(
    rows: Sequence[table.Row], times: dict[str, float], window: Stretch
) -> set[str]:
    """Return the events that bound rows without anything to compare inside a window."""
    events: set[str] = set()
    for row in rows:
        first, last = _bound_time(row["applies_from"], times), _bound_time(row["applies_to"], times)
        start, stop = window
        if first is not None:
            start = max(start, first)
        if last is not None:
            stop = min(stop, last)
        if start < stop:
            continue
        for name in times:
            if row["applies_from"].startswith(name) or row["applies_to"].startswith(name):
                events.add(name)
    return events


def _bound_times(rows: Sequence[table.Row], end: str, times: dict[str, float]) -> list[float]:
    """Return the times of one end of the rows, without unknown ones. [s]"""
    bounds = [_bound_time(row[end], times) for row in rows]
    return [time for time in bounds if time is not None]


def _bound_time(bound: str, times: dict[str, float]) -> float | None:
    """Return the time of a bound of a row; None if its event has no time. [s]"""
    if not bound:
        return None
    try:
        return table.bound_time(bound, times, np.nan)
    except UnknownName:
        return None


def _place_events(
    rows: Sequence[table.Row],
    needed: Sequence[str],
    times: dict[str, float],
    *,
    window: tuple[float, float],
    remarks: list[str],
) -> dict[str, tuple[float, bool]]:
    """Return the time of every needed event, and whether the record shows it."""
    events = {}
    for name in needed:
        if name in times:
            events[name] = times[name], True
            continue
        # A time at the edge of the replay keeps the windows of the rows open.
        opens = any(row["applies_from"].startswith(name) for row in rows)
        ends = any(row["applies_to"].startswith(name) for row in rows)
        time = 0.5 * (window[0] + window[1])
        if opens and not ends:
            time = window[0]
        elif ends and not opens:
            time = window[1]
        events[name] = (round(time, 2), False)
        remarks.append(
            f"{name} was not found in the record; it stands at {time_text(events[name][0])} s, set "
            "it "
            f"by hand"
        )
    return events


def _shortened_text(
    rows: Sequence[table.Row], events: dict[str, float], window: tuple[float, float]
) -> str:
    """Return the reason for a window shorter than the rows require, or an empty text."""
    first = min(_bound_times(rows, "applies_from", events), default=window[0])
    last = max(_bound_times(rows, "applies_to", events), default=window[1])
    parts = []
    if first < window[0]:
        parts.append(f"begins {window[0] - first:.1f} s later")
    if last > window[1]:
        parts.append(f"ends {last - window[1]:.1f} s earlier")
    if not parts:
        return ""
    return f"the recorded manoeuvre {' and '.join(parts)} than the rows require"


def _movement_text(movement: Movement | None) -> str:
    if movement is None:
        return ""
    return f"{movement.channel} moves from {movement.start:.1f} to {movement.end:.1f} s."
