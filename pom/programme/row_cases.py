"""Case of a wanted row before its flight: the manoeuvre of the catalogue on the a-priori model."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError
from flighttest.flight_programme.planning.catalogue import WantedRow
from flighttest.flight_programme.planning.pilot import PredictedFlight
from pom.cases.case import read_case
from pom.replaying.replay_case import ReplayPlan, plan_of
from pom.tolerances import rows as table
from pom.tolerances.conditions import missing_claims

# Steady flight of the replay before the manoeuvre. [s]
_BEFORE = 2.0


def plan_row(wanted: WantedRow, flight: PredictedFlight) -> tuple[ReplayPlan, list[str]]:
    """Return the replay of a wanted row on its predicted flight, and what it assumes.

    The motion of the a-priori model, without errors of instruments, takes the place of the record.
    Recorded surfaces and thrust drive the replay, from a trim at its start.

    Parameters
    ----------
    wanted : WantedRow
    flight : PredictedFlight
        Of its manoeuvre alone.

    Raises
    ------
    SchemaError, UnknownName
        The tolerance table does not have the row, or the case has another fault, as in `read_case`.
    """
    mark, motion = flight.marks[0], flight.motion
    start, end = float(mark["start"]), float(mark["end"])
    first, last = float(motion["time"][0]), float(motion["time"][-1])
    window = (max(first, start - _BEFORE), end)
    if wanted.window is not None:
        window = (start + wanted.window[0], start + wanted.window[1])
    if not first <= window[0] < window[1] <= last:
        raise SchemaError(
            f"wanted_row {wanted.name}",
            [
                f"the window {window[0] - start:g} ... {window[1] - start:g} s lies outside the "
                f"predicted flight {first - start:g} ... {last - start:g} s; choose one inside"
            ],
        )
    events, notes = _events_of(wanted, window, start=start, end=end)
    content: dict[str, Any] = {
        "case": {
            "id": wanted.row,
            "standard": wanted.standard or table.STANDARD,
            "edition": wanted.edition or table.EDITION,
            "name": "planned",
            "title": wanted.name,
            "record": "planned.nc",
            "window": list(window),
            "features": list(wanted.features),
            "mode_channel": wanted.mode_channel,
            "shortened": "predicted manoeuvre",
        },
        "drive": {"surfaces": "recorded", "engine": "thrust", "trim": True},
        "events": events,
    }
    # A case is a file next to its record.
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "planned.nc").touch()
        file = Path(folder) / "planned.toml"
        file.write_text(_case_text(content), encoding="utf-8")
        try:
            case = read_case(file)
        except SchemaError as error:
            raise SchemaError(f"wanted_row {wanted.name}", error.problems) from error
        return plan_of(case, motion), notes


def _case_text(content: Mapping[str, Mapping[str, Any]]) -> str:
    """Return tables of a case file as TOML; texts, numbers and lists are those of JSON."""
    lines = []
    for table_name, entries in content.items():
        lines.append(f"[{table_name}]")
        lines += [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in entries.items()]
    return "\n".join(lines) + "\n"


def _events_of(
    wanted: WantedRow, window: tuple[float, float], *, start: float, end: float
) -> tuple[dict[str, float], list[str]]:
    """Return the events of a case, and a note on those that are assumed. [s]

    Without a time in the catalogue, an event that begins the window of a row is at the start of the
    manoeuvre, one that ends it at the end of the manoeuvre.
    """
    given = {name: start + time for name, time in wanted.events.items()}
    standard, edition = wanted.standard or table.STANDARD, wanted.edition or table.EDITION
    assumed: dict[str, float] = {}
    for row in table.rows_of_test(wanted.row, standard, edition):
        if missing_claims(row["condition"], wanted.features):
            continue
        # A row from one event to another needs both; without a statement they are the ends of the
        # flight.
        for bound, time in ((row["applies_from"], start), (row["applies_to"], end)):
            event = table.event_of(bound)
            if event and event not in given:
                assumed.setdefault(event, time)
        if row["measure"] == "steady" and "capture" not in given:
            assumed.setdefault("capture", 0.5 * (start + end))
    notes = []
    if assumed:
        times = ", ".join(f"{name} at {time - start:.1f} s" for name, time in assumed.items())
        notes.append(f"assumed, from the start of the manoeuvre: {times}")
    return {**assumed, **given}, notes


def row_title(wanted: WantedRow) -> str:
    """Return the printed title of a row."""
    standard, edition = wanted.standard or table.STANDARD, wanted.edition or table.EDITION
    return table.rows_of_test(wanted.row, standard, edition)[0]["title"]
