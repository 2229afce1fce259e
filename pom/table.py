"""The tolerance table: rows of a test as criteria, with their windows and the conditions under which they count."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from flightmech.errors import UnknownName

from .channels import CHANNELS, MODE_CHANNELS
from .criteria import Band, Criterion, Limit

STANDARD = "FAA 14 CFR Part 60 App A Table A2A"
EDITION = "2014-01-01"
Row = Mapping[str, str]

# Measures that are judged; a row with another one is listed as not tested.
JUDGED = frozenset(
    {
        "trace",
        "end_value",
        "steady",
        "period",
        "t_half",
        "damping_ratio",
        "peak_lag",
        "response_initial",
        "response_total",
        "trend",
    }
)
# The spiral's bank angle is judged 20 s after release (section 4 of the table's README); the row reads as a time history.
_JUDGED_AS = {("2.d.4", "bank_angle", "trace"): "end_value"}
_OFFSET = re.compile(r"^(\w+?)([+-]\d+(?:\.\d+)?)s$")


@cache
def rows() -> tuple[Row, ...]:
    """Return every row of ``tolerances.csv``."""
    with (Path(__file__).parent / "tolerances.csv").open(newline="", encoding="utf-8") as file:
        return tuple(csv.DictReader(file))


def rows_of(id: str, standard: str = STANDARD, edition: str = EDITION) -> list[Row]:
    """Return the rows of one test.

    Raises
    ------
    UnknownName
        No such standard, edition or test; with the near ones.
    """
    found = [row for row in rows() if row["standard"] == standard]
    if not found:
        raise UnknownName(standard, {row["standard"] for row in rows()}, "standard")
    editions = {row["edition"] for row in found}
    if edition not in editions:
        raise UnknownName(edition, editions, f"edition of {standard!r}")
    found = [row for row in found if row["edition"] == edition]
    chosen = [row for row in found if row["test_id"] == id]
    if not chosen:
        raise UnknownName(id, {row["test_id"] for row in found}, f"test of {standard!r}, {edition}")
    return chosen


def features() -> set[str]:
    """Return every word that a row can demand as its condition."""
    return {word for row in rows() for word in row["condition"].split(";") if word}


def events() -> set[str]:
    """Return every event that bounds a window; ``capture`` is the instant of a snapshot."""
    marks = {row[end] for row in rows() for end in ("applies_from", "applies_to")} - {""}
    return {"capture"} | {match.group(1) if (match := _OFFSET.match(mark)) else mark for mark in marks}


def band_of(row: Row) -> Band:
    """Return the tolerance of a row as printed."""
    if row["quantity"] in ("none", ""):
        return Band()
    limits = [Limit(row["quantity"], float(row["upper"]), row["unit"])]
    if row["alt_quantity"]:
        limits.append(Limit(row["alt_quantity"], float(row["alt_upper"]), row["alt_unit"]))
    return Band(tuple(limits), row["rule"], row["percent_base"])


def bound(mark: str, marked: Mapping[str, float], default: float) -> float:
    """Return the time of a bound such as ``change_start-5s``. [s]

    Raises
    ------
    UnknownName
        The event is not marked in the case.
    """
    if not mark:
        return default
    if mark in marked:
        return marked[mark]
    match = _OFFSET.match(mark)
    event, shift = (match.group(1), float(match.group(2))) if match else (mark, 0.0)
    if event not in marked:
        raise UnknownName(event, marked, "event", "mark its time in [events]")
    return marked[event] + shift


def criterion(
    row: Row,
    name: str,
    window: tuple[float, float],
    features: tuple[str, ...] = (),
    mode_channel: str = "",
    engine_parameter: str = "",
) -> Criterion:
    """Return a row as a criterion of a case.

    Parameters
    ----------
    row : mapping
        A row of the table.
    name : str
        Unique within the case.
    window : tuple of float
        As bounded by the row's events. [s]
    features : tuple of str
        Conditions that hold for the case.
    mode_channel, engine_parameter : str
        Channel of modal and of engine response measures.
    """
    measure = _JUDGED_AS.get((row["test_id"], row["parameter"], row["measure"]), row["measure"])
    if measure in ("period", "t_half", "damping_ratio"):
        channel = mode_channel or MODE_CHANNELS.get(row["test_id"], "")
    elif measure.startswith("response_"):
        channel = engine_parameter
    else:
        channel = CHANNELS.get(row["parameter"], "")
    missing = [word for word in row["condition"].split(";") if word and word not in features]
    return Criterion(
        name=name,
        parameter=row["parameter"],
        channel=channel,
        measure=measure,
        group=row["group"],
        band=band_of(row),
        window=window,
        applies=not missing,
        reason=f"applies only with {', '.join(missing)}" if missing else _unjudged(measure, channel),
        kind=row["kind"],
        provenance=row["provenance"],
        source=row["source"],
        note=row["note"],
    )


def _unjudged(measure: str, channel: str) -> str:
    if measure not in JUDGED:
        return f"measure {measure} is not evaluated yet"
    return "" if channel else "no channel of the house holds this parameter"


def names_of(found: list[Row]) -> list[str]:
    """Return one unique name per row: the parameter, with its measure or place when it stands more than once."""
    names: list[str] = []
    for row in found:
        choices = [row["parameter"], f"{row['parameter']} {row['measure']}"]
        choices += [f"{row['parameter']} {row['measure']} {n}" for n in range(2, len(found) + 1)]
        names.append(next(name for name in choices if name not in names))
    return names
