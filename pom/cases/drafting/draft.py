"""A first case file for a record and a row of the tolerance table: what the record shows is filled
in, the rest is reported.

The file is written only when it is a sound case (`read_case`).  Events that the record does not
show get a place that keeps the file sound, a comment and a remark: they are for the engineer to
set.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

import flighttest
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.support.atomic_write import written_atomically
from flightmech.units import from_si
from flighttest.records.record import needs_names
from pom.cases.case import PRIMARY, PomCase, read_case
from pom.cases.drafting.event_detection import (
    HELD_STILL,
    WHOLE_RUNS,
    Movement,
    Recorded,
    RecordedManoeuvre,
    demand_fitting,
    find_events,
    find_movement,
    input_channels,
    matching_manoeuvres,
    on_ground,
)
from pom.cases.reference_states import read_path_states
from pom.tolerances import rows as table
from pom.tolerances.criteria import Criterion
from pom.tolerances.rows import missing_claims


@dataclass(frozen=True)
class Draft:
    """What goes into a new case file, and what its author has to know.

    Attributes
    ----------
    case : dict
        Table ``[case]``: key to value.
    drive : dict
        Table ``[drive]``.
    conditions : dict of str to str
        Values with units.
    events : dict of str to (time [s], whether it was found)
    remarks : list of str
        What the record does not show.
    """

    case: dict[str, object]
    drive: dict[str, object]
    conditions: dict[str, str] = field(default_factory=dict)
    events: dict[str, tuple[float, bool]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


_COMMENTS = {
    "name": "for files and links",
    "window": "[s] on the clock of the record; start in a steady state",
    "engine_parameter": "critical engine parameter of Ti and Tt",
    "surfaces": "recorded: surface positions; cockpit: column, wheel, pedals; force: pilot "
    "forces; pilot: loops of [[drive.pilot]]",
    "engine": "thrust: recorded thrust; n1: recorded fan speed; throttle: recorded lever",
    "trim": 'true: trimmed to the flight condition; false; "ground": on its wheels',
}
_OPTIONAL = """
# Of the optional tables, with invented values; docs/explanation/proof-of-match/cases.md has them all.
# [conditions]                 # against the record: inputs held constant, initial state, mass, air
# delta_f = "40 deg"
# [tolerance]                  # replaces the band of a row, or adds one
# theta = "1.5 deg"
# [rationale]                  # by criterion or channel, printed in the report
# theta = "why it leaves the band"
# [source]
# document = "flight-test report, page"
"""


def draft_text(draft: Draft, criteria: Sequence[Criterion]) -> str:
    """Return a draft as the text of a case file.

    Parameters
    ----------
    draft : Draft
    criteria : sequence of Criterion
        Of the very case, for the comments.
    """
    lines = [
        "#:schema case.schema.json",
        "# `aeromatch pom schema` writes this schema; an editor that knows it completes and "
        "checks the keys.",
        "",
    ]
    lines += ["[case]", *(_line(key, draft.case[key]) for key in _ORDER if key in draft.case)]
    if criteria:
        words = sorted(
            {
                word
                for c in criteria
                if not c.applies
                for word in c.reason.removeprefix("applies only with ").split(", ")
            }
        )
        lines += (
            [f"# features = [...]   rows that wait for a condition: {', '.join(words)}"]
            if words
            else []
        )
    lines += ["", "[drive]", *(_line(key, value) for key, value in draft.drive.items())]
    if draft.conditions:
        lines += [
            "",
            "[conditions]",
            *(_line(key, value) for key, value in draft.conditions.items()),
        ]
    if draft.events:
        lines += ["", "[events]  # [s]"]
        lines += [
            f"{_key(key)} = {time:g}{'' if found else '   # NOT FOUND in the record: set it'}"
            for key, (time, found) in draft.events.items()
        ]
    return "\n".join(lines) + "\n" + _rows(criteria) + _OPTIONAL


_ORDER = (
    *(
        "id",
        "standard",
        "edition",
        "name",
        "title",
        "description",
        "record",
        "names",
        "aircraft",
        "window",
        "shortened",
    ),
    "engine_parameter",
)


def _line(key: str, value: object) -> str:
    comment = f"   # {_COMMENTS[key]}" if key in _COMMENTS else ""
    return f"{key} = {json.dumps(value, ensure_ascii=False)}{comment}"


def _key(name: str) -> str:
    return name if name.replace("_", "").isalpha() else json.dumps(name)


def _rows(criteria: Sequence[Criterion]) -> str:
    """Return the rows that will be judged, as comments."""
    if not criteria:
        return ""
    lines = [
        "",
        "# What is judged (rows of one group are alternatives, different groups must all pass):",
    ]
    for c in criteria:
        window = f"{c.window[0]:g} ... {c.window[1]:g} s"
        lines.append(
            f"#   {c.name}: {c.band.text or 'no number'}, {c.measure} of "
            f"{c.channel or 'no channel'}, {window}, group {c.group}"
        )
        lines.append(
            f"#       {c.provenance}: "
            f"{c.source}{'; ' + c.note if c.note else ''}{'; ' + c.reason if c.reason else ''}"
        )
    return "\n".join(lines) + "\n"


LEAD = 1.0  # [s] of steady flight before the input
HOMES = (
    ".",
    "..",
)  # next to the record: folders in which its name map and its aircraft are looked for
LONGEST_LEAD = 5.0  # [s] that a row requires before its event
_SPOILED = re.compile(r"[^a-z0-9]+")


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
        The case file.
    names, aircraft : path, optional
        Name map and aircraft; without them ``names.toml`` and ``aircraft.toml`` next to the record
        or one folder up.
    window : tuple of float, optional
        Where to look for the manoeuvre. [s]  Without it: where the record lists one that fits, else
        all of it.
    name : str, optional
        Of the case; by default that of the test.
    force : bool
        Overwrite an older file.

    Returns
    -------
    case : PomCase
        What was written, read again.
    remarks : list of str
        What the record does not show, and was given a place that keeps the file sound.

    Raises
    ------
    FileExistsError
        `output` is there and `force` is not given.
    UnknownName
        No such standard, edition or test.
    SchemaError
        The record cannot be read without a name map, has nothing that drives a model, or lists
        manoeuvres of which none fits the row.
    """
    output = Path(output)
    if output.exists() and not force:
        raise FileExistsError(
            f"{output} is there already; give another name, or --force to overwrite it"
        )
    rows = table.rows_of_test(test, standard, edition)
    record = Path(record)
    map_file = _next_to(record, "names.toml", names)
    if (
        names is None
        and map_file is not None
        and read_path_states(str(record)) is None
        and not needs_names(record)
    ):
        map_file = None  # a file of `flight convert`: the map next to it is that of the recording
    files = {
        "record": record,
        "names": map_file,
        "aircraft": _next_to(record, "aircraft.toml", aircraft),
    }
    recorded = recorded_channels(record, files["names"])
    if window is None:
        demand_fitting(str(record), test, recorded.manoeuvres)
    draft = draft_case(rows, recorded, window)
    draft.case.update(standard=standard, edition=edition)
    if name:
        draft.case["name"] = name
    for key, file in files.items():
        if file is not None:
            draft.case[key] = Path(os.path.relpath(file, output.parent)).as_posix()
    with written_atomically(output) as part:
        part.write_text(draft_text(draft, ()), encoding="utf-8")
        part.write_text(draft_text(draft, read_case(part).criteria), encoding="utf-8")
        read_case(part)
    return read_case(output), draft.remarks


def _next_to(record: Path, name: str, given: str | Path | None) -> Path | None:
    if given is not None:
        return Path(given)
    places = [record.parent / home / name for home in HOMES]
    return next((place for place in places if place.is_file()), None)


def recorded_channels(record: Path, names: Path | None) -> Recorded:
    """Return the channels of a raw record or of a reconstructed path.

    Raises
    ------
    ParseError, SchemaError, UnknownName
        As `flighttest.read`: not a record, or columns that no name map explains.
    """
    states = read_path_states(str(record))
    if states is not None:
        time = states["time"].values.astype(float)
        found = {
            str(name): (time, item.values.astype(float))
            for name, item in states.data_vars.items()
            if item.dims == ("time",)
        }
        return Recorded(found, (float(time[0]), float(time[-1])))
    tree = flighttest.read(str(record), names=str(names) if names else None)
    return Recorded(_leaves(tree), _span(tree), _listed(tree), tree.attrs.get("latitude"))


def _leaves(tree: xr.DataTree) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for leaf in tree.children.values():
        node = leaf.to_dataset()
        for name, item in node.data_vars.items():
            known = np.isfinite(item.values.astype(float))
            if item.dims == ("time",) and known.any():
                found[str(name)] = (
                    node["time"].values[known].astype(float),
                    item.values[known].astype(float),
                )
    return found


def _span(tree: xr.DataTree) -> tuple[float, float]:
    """Return what a reconstruction covers: the clock of the gyros, else what all leaves share. [s]"""
    leaves = [leaf.to_dataset() for leaf in tree.children.values()]
    clocks = [leaf["time"].to_numpy() for leaf in leaves if "p" in leaf] or [
        leaf["time"].to_numpy() for leaf in leaves
    ]
    return max(float(clock[0]) for clock in clocks), min(float(clock[-1]) for clock in clocks)


def _listed(tree: xr.DataTree) -> list[RecordedManoeuvre]:
    rows = flighttest.manoeuvres(tree)
    return [
        RecordedManoeuvre(
            float(row["start"]),
            float(row["end"]),
            str(row.get("control", "")),
            str(row["manoeuvre"]),
        )
        for row in rows.to_dict("records")
    ]


def draft_case(
    rows: Sequence[table.Row], recorded: Recorded, window: tuple[float, float] | None = None
) -> Draft:
    """Return the draft of a case for the rows of one test."""
    test, title = rows[0]["test_id"], rows[0]["title"]
    remarks: list[str] = []
    snapshot = all(
        row["measure"] == "steady" for row in rows if not missing_claims(row["condition"], ())
    )
    search, limits = _search(test, recorded, window, remarks, snapshot)
    moved = find_movement(recorded, input_channels(test), search)
    applied = [row for row in rows if not missing_claims(row["condition"], ())]
    wanted = _wanted(applied)
    found = find_events(wanted, test, recorded, search, limits)
    start, stop = _window(applied, found, moved, limits, recorded.span)
    if _closed(applied, found, (start, stop)):
        start, stop = _window(applied, found, moved, recorded.span, recorded.span)
    found = {
        name: time
        for name, time in found.items()
        if name not in _closed(applied, found, (start, stop))
    }
    events = _placed(applied, wanted, found, (start, stop), remarks)
    ground = on_ground(recorded, start)
    drive = _drive(rows, recorded, ground)
    case: dict[str, object] = {
        "id": test,
        "name": _SPOILED.sub("_", title.lower()).strip("_"),
        "title": title,
        "description": _described(moved),
        "window": [start, stop],
    }
    short = _shortened(applied, {name: time for name, (time, _) in events.items()}, (start, stop))
    if short:
        case["shortened"] = short
        remarks.append(short)
    if any(row["measure"].startswith("response_") for row in applied):
        case["engine_parameter"] = recorded.first(("n1", "thrust")) or "engine1.n1"
    latitude = (
        {} if recorded.latitude is None else {"lat": f"{from_si(recorded.latitude, 'deg'):.6g} deg"}
    )
    return Draft(case, drive, latitude, events, remarks)


Stretch = tuple[float, float]


def _search(
    test: str,
    recorded: Recorded,
    window: Stretch | None,
    remarks: list[str],
    snapshot: bool = False,
) -> tuple[Stretch, Stretch]:
    """Return where events are looked for, and what the replay may cover: as asked, about the first
    manoeuvre that fits, or all. [s]
    """
    low, high = recorded.span
    if window is not None:
        inside = max(low, window[0]), min(high, window[1])
        if not inside[0] < inside[1]:
            raise OutOfRange(
                f"window {window[0]:g} ... {window[1]:g} s lies outside the record, {low:g} "
                f"... {high:g} s; choose one inside"
            )
        return inside, inside
    inside_record = [
        each for each in recorded.manoeuvres if low <= each.start < each.end <= high + LEAD
    ]
    found = matching_manoeuvres(test, inside_record)
    if not found:
        return (low, high), (low, high)
    start, end = max(low, found[0].start - 0.5 * LEAD), min(high, found[0].end)
    if len(found) > 1:
        others = ", ".join(f"{each.start:g} ... {each.end:g} s" for each in found[1:])
        remarks.append(
            f"the record lists {len(found)} manoeuvres that fit; the first was taken, "
            f"--window chooses another: {others}"
        )
    if test.startswith(WHOLE_RUNS):
        return (start, end), (low, high)
    if snapshot:
        return (start, end), (max(low, found[0].start), end)
    followed = any(each.start >= found[0].end - LEAD for each in recorded.manoeuvres)
    return (start, end), (max(low, start - LONGEST_LEAD), end if followed else high)


def _wanted(rows: Sequence[table.Row]) -> list[str]:
    """Return the events that the rows of a test need."""
    bounds = [row[end] for row in rows for end in ("applies_from", "applies_to") if row[end]]
    needed = [
        next(
            event
            for event in sorted(table.window_events(), key=len, reverse=True)
            if bound.startswith(event)
        )
        for bound in bounds
    ]
    return list(
        dict.fromkeys(
            [*needed, *(["capture"] if any(row["measure"] == "steady" for row in rows) else [])]
        )
    )


def _window(
    rows: Sequence[table.Row],
    found: dict[str, float],
    moved: Movement | None,
    limits: Stretch,
    span: Stretch,
) -> tuple[float, float]:
    """Return start and end of the replay: what the rows require, with a second of steady flight
    before the input. [s]
    """
    if "capture" in found and all(row["measure"] == "steady" for row in rows):
        return found["capture"] - HELD_STILL, found["capture"] + 1.0
    bounds = [[_bound(row[end], found) for row in rows] for end in ("applies_from", "applies_to")]
    first = [time for time in bounds[0] if time is not None]
    if "release" in found:
        first.append(found["release"] - LEAD)
    elif moved is not None:
        first.append(moved.start - LEAD)
    starts = first or [limits[0]]
    if "brake_release" in found:
        starts.append(found["brake_release"] - 4.0 * LEAD)
    ends = (
        [time for time in bounds[1] if time is not None]
        if all(row["applies_to"] for row in rows)
        else []
    )
    start = max(min(starts), limits[0])
    stop = min(max(ends), limits[1]) if ends else limits[1]
    if not start < stop:
        start, stop = limits
    low, high = np.floor(start * 10.0 + 1e-6) / 10.0, np.ceil(stop * 10.0 - 1e-6) / 10.0
    if low < span[0] - 1e-9:
        low = np.ceil(span[0] * 10.0 - 1e-6) / 10.0
    if high > span[1] + 1e-9:
        high = np.floor(span[1] * 10.0 + 1e-6) / 10.0
    return float(low) + 0.0, float(high)


def _closed(rows: Sequence[table.Row], found: dict[str, float], window: Stretch) -> set[str]:
    """Return the events of rows that have nothing left to compare inside a window."""
    spoiled: set[str] = set()
    for row in rows:
        first, last = (_bound(row[end], found) for end in ("applies_from", "applies_to"))
        if not max(window[0], window[0] if first is None else first) < min(
            window[1], window[1] if last is None else last
        ):
            spoiled |= {
                name
                for name in found
                if row["applies_from"].startswith(name) or row["applies_to"].startswith(name)
            }
    return spoiled


def _bound(bound: str, found: dict[str, float]) -> float | None:
    try:
        return table.bound_time(bound, found, np.nan) if bound else None
    except UnknownName:
        return None


def _placed(
    rows: Sequence[table.Row],
    wanted: Sequence[str],
    found: dict[str, float],
    window: tuple[float, float],
    remarks: list[str],
) -> dict[str, tuple[float, bool]]:
    """Return every wanted event, those that were not found where they keep the windows of the rows
    open.
    """
    events = {}
    for name in wanted:
        if name in found:
            events[name] = found[name], True
            continue
        # at the edge of the replay it keeps the windows of its rows open
        opens = any(row["applies_from"].startswith(name) for row in rows)
        ends = any(row["applies_to"].startswith(name) for row in rows)
        middle = 0.5 * (window[0] + window[1])
        events[name] = (
            round(middle if opens == ends else window[0] if opens else window[1], 2),
            False,
        )
        remarks.append(
            f"{name} was not found in the record; it stands at {events[name][0]:g} s, set it "
            f"by hand"
        )
    return events


def _shortened(
    rows: Sequence[table.Row], events: dict[str, float], window: tuple[float, float]
) -> str:
    """Return the words for a window that is shorter than the rows ask; empty when none is."""
    asked = [[_bound(row[end], events) for row in rows] for end in ("applies_from", "applies_to")]
    first = min([time for time in asked[0] if time is not None], default=window[0])
    last = max([time for time in asked[1] if time is not None], default=window[1])
    parts = []
    if first < window[0]:
        parts.append(f"begins {window[0] - first:.1f} s later")
    if last > window[1]:
        parts.append(f"ends {last - window[1]:.1f} s earlier")
    return f"the recorded manoeuvre {' and '.join(parts)} than the rows require" if parts else ""


def _drive(rows: Sequence[table.Row], recorded: Recorded, ground: bool) -> dict[str, object]:
    """Return the levels of drive that the record can feed; forces first where the controls
    themselves are tested.
    """
    order = (
        ("force", "cockpit", "recorded")
        if rows[0]["test_id"].startswith(("2.a", "2.b"))
        else ("recorded", "cockpit", "force")
    )
    level = next((level for level in order if set(PRIMARY[level]) <= set(recorded.channels)), "")
    if not level:
        raise SchemaError(
            "record",
            [
                "no complete set of controls: needs delta_e, delta_a, delta_r, or column, "
                "wheel, pedal, or their forces"
            ],
        )
    engine = [row for row in rows if row["measure"].startswith("response_")]
    powers = ("throttle", "n1") if engine else ("thrust", "n1", "throttle")
    power = next((name for name in powers if f"engine1.{name}" in recorded.channels), "")
    if not power:
        raise SchemaError(
            "record",
            [f"no engine1.{', engine1.'.join(powers)}: one of them drives the engines; map it"],
        )
    return {"surfaces": level, "engine": power, "trim": "ground" if ground else True}


def _described(moved: Movement | None) -> str:
    return (
        ""
        if moved is None
        else f"{moved.channel} moves from {moved.start:.1f} to {moved.end:.1f} s."
    )
