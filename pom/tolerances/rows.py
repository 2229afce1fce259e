"""The tolerance table: rows of a test as criteria, with their windows and the conditions under which they count."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from flightmech.errors import UnknownName

from .criteria import Band, Criterion, Limit
from .event_names import MEASURED
from .parameter_channels import CHANNELS, FORCES, MODE_CHANNELS, PROGRESS, SHEAR_CHANNEL, TRAVEL, plain_id
from .row_conditions import KINDS, claimed, unclaimed

STANDARD = "FAA 14 CFR Part 60 App A Table A2A"
EDITION = "2014-01-01"
DEMONSTRATION = "a demonstration: recordings are shown and judged by pilots, the table gives no number"
_UNCHANNELLED = dict.fromkeys(("response_initial", "response_total"), "name the critical engine parameter in case.engine_parameter")
Row = Mapping[str, str]

# Rows whose measure the README of the table spells out otherwise: the spiral's bank angle is judged 20 s after release, a
# change of elevator is that between two snapshots, a force increment is over the static sweep.
_JUDGED_AS = {("2.d.4", "bank_angle", "trace"): "end_value"}
_PARAMETER_AS = {"elevator_change": "change", "dynamic_force_increment": "force_increment"}
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
    """Return every word that a case can claim; conditions that the record shows are not among them, but for the kinds of damping."""
    return {word for row in rows() for word in row["condition"].split(";") if word and (claimed(word) or word in KINDS)}


def events() -> set[str]:
    """Return every event that bounds a window; ``capture`` is the instant of a snapshot."""
    bounds = {row[end] for row in rows() for end in ("applies_from", "applies_to")} - {""}
    return set(MEASURED) | {match.group(1) if (match := _OFFSET.match(bound)) else bound for bound in bounds}


def band_of(row: Row) -> Band:
    """Return the tolerance of a row as printed."""
    if row["quantity"] in ("none", ""):
        return Band()
    limits = [Limit(row["quantity"], float(row["upper"]), row["unit"])]
    if row["alt_quantity"]:
        limits.append(Limit(row["alt_quantity"], float(row["alt_upper"]), row["alt_unit"]))
    return Band(tuple(limits), row["rule"], row["percent_base"])


def bound(text: str, times: Mapping[str, float], default: float) -> float:
    """Return the time of a bound such as ``change_start-5s``. [s]

    Raises
    ------
    UnknownName
        The case does not give the event.
    """
    if not text:
        return default
    if text in times:
        return times[text]
    match = _OFFSET.match(text)
    event, shift = (match.group(1), float(match.group(2))) if match else (text, 0.0)
    if event not in times:
        raise UnknownName(event, times, "event", "give its time in [events]")
    return times[event] + shift


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
    measure = _PARAMETER_AS.get(row["parameter"]) or _JUDGED_AS.get((row["test_id"], row["parameter"], row["measure"]), row["measure"])
    travel = TRAVEL.get(plain_id(row["test_id"]), "")
    channel = _channel(row, measure, travel, mode_channel, engine_parameter)
    missing = unclaimed(row["condition"], features)
    return Criterion(
        name=name,
        parameter=row["parameter"],
        channel=channel,
        measure=measure,
        group=row["group"],
        band=band_of(row),
        window=window,
        applies=not missing,
        reason=f"applies only with {', '.join(missing)}" if missing else "" if channel else _UNCHANNELLED.get(measure, DEMONSTRATION),
        kind=row["kind"],
        provenance=row["provenance"],
        source=row["source"],
        note=row["note"],
        condition=row["condition"],
        bounds=(row["applies_from"], row["applies_to"]),
        abscissa=_abscissa(row, measure, travel),
    )


def _abscissa(row: Row, measure: str, travel: str) -> str:
    """Return `Criterion.abscissa` of a row."""
    if measure == "elapsed":
        return PROGRESS.get(plain_id(row["test_id"]), "")
    if row["parameter"] == "trim_rate":
        return "delta_t"
    return travel if measure in ("curve", "breakout", "force_increment", "scalar") else ""


def _channel(row: Row, measure: str, travel: str, mode_channel: str, engine_parameter: str) -> str:
    """Return what a row is judged on; what a case chooses (mode, engine parameter) before what the table sets."""
    if measure in ("period", "t_half", "damping_ratio"):
        return mode_channel or MODE_CHANNELS.get(plain_id(row["test_id"]), "")
    if measure.startswith("response_"):
        return engine_parameter
    if row["parameter"] in ("breakout_force", "dynamic_force_increment"):
        return FORCES.get(travel, "")
    if row["test_id"].startswith("2.b") and travel:
        return mode_channel or travel
    if plain_id(row["test_id"]) == "2.g":
        return SHEAR_CHANNEL
    return CHANNELS.get(row["parameter"], "")


def names_of(found: list[Row]) -> list[str]:
    """Return one unique name per row: the parameter, with its measure or place when it stands more than once."""
    names: list[str] = []
    for row in found:
        choices = [row["parameter"], f"{row['parameter']} {row['measure']}"]
        choices += [f"{row['parameter']} {row['measure']} {n}" for n in range(2, len(found) + 1)]
        names.append(next(name for name in choices if name not in names))
    return names
