"""Rows of the tolerance table as criteria, with their windows and the signals that they need."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

from flightmech.errors import UnknownName
from pom.tolerances.channels import (
    CHANNELS,
    FORCES,
    MODE_CHANNELS,
    PROGRESS,
    SHEAR_CHANNEL,
    TRAVEL,
    plain_id,
    source_signals,
)
from pom.tolerances.conditions import KINDS, condition_channels, is_claim, missing_claims
from pom.tolerances.criteria import (
    DISCRETES,
    LEVELS,
    MEASURED,
    OF_PARAMETER,
    Band,
    Criterion,
    Limit,
)

_MOST_ENGINES = 4  # whose fuel flow is read


def required_quantities(criterion: Criterion) -> tuple[str, ...]:
    """Return the quantities that a criterion needs; some are derived from signals."""
    channel, abscissa = criterion.channel, criterion.abscissa
    match criterion.measure:
        case "demonstration":
            return ()
        case "peak_lag":
            return ("phi", "beta")
        case "segment_mean":
            # A mean rate of climb is a height difference over time.
            return ("h",) if channel == "hdot" else (channel,)
        case "floor":
            return ("h", "V")
        case "curve" | "breakout" | "force_increment":
            return (channel, abscissa)
        case "scalar":
            by_parameter = {"turn_radius": ("distance", "psi"), "trim_rate": (abscissa,)}
            return by_parameter.get(criterion.parameter, (channel, abscissa))
        case "elapsed":
            # the signal that passes the level of the last event
            level = LEVELS.get(criterion.bounds[1], ("",))[0]
            return tuple(filter(None, (channel, abscissa, level)))
    return (channel,)


def required_signals(criterion: Criterion) -> tuple[str, ...]:
    """Return the signals that a criterion needs; a model must have them."""
    return _sources_of(required_quantities(criterion))


def helpful_signals(criterion: Criterion) -> tuple[str, ...]:
    """Return the signals of the events and conditions of a criterion, which are optional."""
    channels: list[str] = []
    # the event of a value, and the bounds of the row
    events = ["", *criterion.bounds]
    if criterion.measure in ("event_value", "setup"):
        events[0] = OF_PARAMETER.get(criterion.parameter, "")
    for event in events:
        channels += DISCRETES.get(event, ())
        channels += LEVELS.get(event, ())[:1]
    channels += condition_channels(criterion.condition)
    if criterion.channel == "fuel_used":
        channels += [f"engine{n}.fuel_flow" for n in range(1, _MOST_ENGINES + 1)]
    return _sources_of(channels)


def _sources_of(channels: Iterable[str]) -> tuple[str, ...]:
    """Return the signals from which channels are formed, each once."""
    signals: dict[str, None] = {}
    for channel in channels:
        signals |= dict.fromkeys(source_signals(channel))
    return tuple(signals)


STANDARD = "FAA 14 CFR Part 60 App A Table A2A"
EDITION = "2014-01-01"
DEMONSTRATION = (
    "a demonstration: the curves are shown and judged by people; no tolerance applies, and it is "
    "not a pass"
)
NUMBER_NOT_READ = (
    "the number of this row was not read in this edition; give the printed band in [tolerance]"
)
# By measure: the reason for a row without a channel.
_UNCHANNELLED = dict.fromkeys(
    ("response_initial", "response_total"),
    "name the critical engine parameter in case.engine_parameter",
)
Row = Mapping[str, str]

# Rows whose measure the README of the table defines: the bank angle of the spiral is judged 20 s
# after release. A change of the elevator is between two snapshots. A force increment is the force
# above the static sweep.
_JUDGED_AS = {("2.d.4", "bank_angle", "trace"): "end_value"}
_PARAMETER_AS = {"elevator_change": "change", "dynamic_force_increment": "force_increment"}
_OFFSET = re.compile(r"^(\w+?)([+-]\d+(?:\.\d+)?)s$")


@cache
def tolerance_rows() -> tuple[Row, ...]:
    """Return every row of ``tolerances.csv``."""
    with (Path(__file__).parent / "tolerances.csv").open(newline="", encoding="utf-8") as file:
        return tuple(csv.DictReader(file))


def rows_of_test(
    id: str, standard: str = STANDARD, edition: str = EDITION, table: Sequence[Row] = ()
) -> list[Row]:
    """Return the rows of one test.

    `table` holds the rows of a table of the user; empty for ``tolerances.csv``.

    Raises
    ------
    UnknownName
        The table has no such standard, edition or test; with similar names.
    """
    table = table or tolerance_rows()
    of_standard = [row for row in table if row["standard"] == standard]
    if not of_standard:
        raise UnknownName(standard, {row["standard"] for row in table}, "standard")
    editions = {row["edition"] for row in of_standard}
    if edition not in editions:
        raise UnknownName(edition, editions, f"edition of {standard!r}")
    of_edition = [row for row in of_standard if row["edition"] == edition]
    rows = [row for row in of_edition if row["test_id"] == id]
    if not rows:
        tests = {row["test_id"] for row in of_edition}
        hint = "give the number of a test of the table, such as 2.c.9"
        raise UnknownName(id, tests, f"test of {standard!r}, {edition}", hint=hint)
    return rows


def claimable_features(table: Sequence[Row] = ()) -> set[str]:
    """Return every word that a case can claim, with those of a further table.

    The record shows the other conditions. The record also shows the kinds of damping, but a case
    may claim them.
    """
    features = set()
    for row in (*tolerance_rows(), *table):
        for word in row["condition"].split(";"):
            if word and (is_claim(word) or word in KINDS):
                features.add(word)
    return features


def window_events(table: Sequence[Row] = ()) -> set[str]:
    """Return every event that bounds a window, with those of a further table.

    ``capture`` is the instant of a snapshot.
    """
    events = set(MEASURED)
    for row in (*tolerance_rows(), *table):
        for bound in (row["applies_from"], row["applies_to"]):
            if bound:
                events.add(_split_bound(bound)[0])
    return events


def usual_fraction(reference: str, edition: str) -> float:
    """Return the share of the tolerance that the rule applies to a reference (rule R9).

    NaN for an edition whose name does not begin with its year: the case has to state the share.
    """
    if reference != "engineering":
        return 1.0
    if not edition[:4].isdigit():
        return math.nan
    # R9: 20 % in editions before 2016, 40 % from then on
    if edition[:4] < "2016":
        return 0.2
    return 0.4


def band_of(row: Row) -> Band:
    """Return the tolerance of a row as printed."""
    if row["quantity"] in ("none", ""):
        return Band()
    # the second limit of a rule such as "10 % or 2 deg, the greater" is the alternative
    limits = [Limit(row["quantity"], float(row["upper"]), row["unit"])]
    if row["alt_quantity"]:
        limits.append(Limit(row["alt_quantity"], float(row["alt_upper"]), row["alt_unit"]))
    return Band(tuple(limits), row["rule"], row["percent_base"])


def bound_time(text: str, times: Mapping[str, float], default: float) -> float:
    """Return the time of a bound such as ``change_start-5s``. [s]

    Raises
    ------
    UnknownName
        The case does not give the event.
    """
    if not text:
        return default
    # a bound without a shift
    if text in times:
        return times[text]
    event, shift = _split_bound(text)
    if event not in times:
        raise UnknownName(event, times, "event", "give its time in [events]")
    return times[event] + shift


def event_of(bound: str) -> str:
    """Return the event of a bound such as ``change_start-5s``; empty for a row without it."""
    return _split_bound(bound)[0]


def _split_bound(text: str) -> tuple[str, float]:
    """Return the event of a bound, and its shift. [s]"""
    match = _OFFSET.match(text)
    if not match:
        return text, 0.0
    return match.group(1), float(match.group(2))


def make_criterion(
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
        Between the events that bound the row. [s]
    features : tuple of str
        Conditions that the case claims.
    mode_channel, engine_parameter : str
        Channel of modal and of engine response measures.
    """
    measure = _measure_of(row)
    travel = TRAVEL.get(plain_id(row["test_id"]), "")
    channel = _channel_of(
        row, measure, travel=travel, mode_channel=mode_channel, engine_parameter=engine_parameter
    )
    # The first reason against a judgement counts.
    missing = missing_claims(row["condition"], features)
    reason = ""
    if missing:
        reason = f"applies only with {', '.join(missing)}"
    elif not channel and measure != "demonstration":
        reason = _UNCHANNELLED.get(measure, f"{row['parameter']} has no channel")
    elif row["quantity"] == "none" and measure in ("trace", "vibration"):
        reason = NUMBER_NOT_READ
    return Criterion(
        name=name,
        parameter=row["parameter"],
        channel=channel,
        measure=measure,
        group=row["group"],
        band=band_of(row),
        window=window,
        applies=not missing,
        reason=reason,
        kind=row["kind"],
        provenance=row["provenance"],
        source=row["source"],
        note=row["note"],
        condition=row["condition"],
        bounds=(row["applies_from"], row["applies_to"]),
        abscissa=_abscissa_of(row, measure, travel),
    )


def channel_of_row(row: Row) -> str:
    """Return the channel of a row without a choice of the case; empty if the case has to choose."""
    travel = TRAVEL.get(plain_id(row["test_id"]), "")
    measure = _measure_of(row)
    return _channel_of(row, measure, travel=travel, mode_channel="", engine_parameter="")


def _measure_of(row: Row) -> str:
    """Return the measure of a row: of its parameter, of the row, else as printed."""
    if row["parameter"] in _PARAMETER_AS:
        return _PARAMETER_AS[row["parameter"]]
    key = (row["test_id"], row["parameter"], row["measure"])
    return _JUDGED_AS.get(key, row["measure"])


def _abscissa_of(row: Row, measure: str, travel: str) -> str:
    """Return `Criterion.abscissa` of a row."""
    if measure == "elapsed":
        return PROGRESS.get(plain_id(row["test_id"]), "")
    if row["parameter"] == "trim_rate":
        return "delta_t"
    if measure in ("curve", "breakout", "force_increment", "scalar"):
        return travel
    return ""


def _channel_of(
    row: Row, measure: str, *, travel: str, mode_channel: str, engine_parameter: str
) -> str:
    """Return the channel of a row; the choice of the case precedes that of the table."""
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


def names_of(rows: list[Row]) -> list[str]:
    """Return one unique name per row: its parameter, with measure and number where needed."""
    names: list[str] = []
    for row in rows:
        name = row["parameter"]
        if name in names:
            name = with_measure = f"{row['parameter']} {row['measure']}"
            number = 2
            while name in names:
                name = f"{with_measure} {number}"
                number += 1
        names.append(name)
    return names
