"""The tolerance table: rows of a test as criteria, with their windows and the conditions under
which they count.
"""

from __future__ import annotations

import csv
import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from flightmech.errors import OutOfRange, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_quantity
from pom.tolerances.bands import NotJudged
from pom.tolerances.channels import (
    CHANNELS,
    FORCES,
    MODE_CHANNELS,
    PROGRESS,
    SHEAR_CHANNEL,
    TRAVEL,
    limit_to_si_factor,
    plain_id,
    si_unit,
    source_signals,
)
from pom.tolerances.criteria import (
    DISCRETES,
    LEVELS,
    MEASURED,
    OF_PARAMETER,
    PARTS,
    Band,
    Criterion,
    Limit,
)

_RELATION = re.compile(r"^(speed|groundspeed|distance)(<=|>=|<|>)(.+)$")
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_CHANNEL = {"speed": "V_cas", "groundspeed": "V_ground", "distance": "distance"}
_WARNING = re.compile(r"^(?:stick_shaker|stall_warning|warning)_or_initial_buffet$")
KINDS = ("underdamped", "overdamped")
"""Kinds of a control's motion after release; taken from the flight unless the case states it."""

SWEEPS = "alternate_method_moderate_or_rapid_sweep"
"""Control dynamics by sweeps, without a release."""


def is_claim(word: str) -> bool:
    """Whether a condition is one that the case has to claim; the others are seen in the record."""
    return not (word in PARTS or word in KINDS or is_relation(word))


def missing_claims(condition: str, features: tuple[str, ...]) -> list[str]:
    """Return the words of a condition that the case would have to claim and does not."""
    missing = []
    for word in filter(None, condition.split(";")):
        if word in KINDS and SWEEPS in features:
            missing.append("a release instead of sweeps")
        elif word not in features and (
            is_claim(word) or (word in KINDS and set(KINDS) & set(features))
        ):
            missing.append(word)
    return missing


def is_relation(word: str) -> bool:
    """Whether a condition is a relation such as ``groundspeed<40kt``."""
    return _RELATION.match(word) is not None


def condition_channels(condition: str) -> list[str]:
    """Return the channels that the relations of a condition speak of."""
    return [
        _CHANNEL[match.group(1)]
        for word in condition.split(";")
        if (match := _RELATION.match(word))
    ]


def satisfies_relation(word: str, value: Any) -> Any:
    """Return whether a value, or each of an array, fulfils a relation with a number. [SI]"""
    name, relation, text = _RELATION.match(word).groups()  # type: ignore[union-attr]
    unit = "m" if name == "distance" else "m s-1"
    return _COMPARE[relation](value, parse_quantity(re.sub(r"(?<=\d)(?=[a-z])", " ", text), unit))


def sample_mask(
    condition: str, events: Mapping[str, float], time: np.ndarray, flight: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the samples at which the flight fulfils the relations of a condition, such as
    ``groundspeed<40kt``.

    ``speed>stick_shaker_or_initial_buffet``: faster than the flight is at the first of the two
    events.

    Raises
    ------
    NotJudged
        The flight lacks the channel, or the case the events, that the relation speaks of.
    """
    mask = np.ones(time.size, bool)
    for word in condition.split(";"):
        match = _RELATION.match(word)
        if not match or match.group(1) == "distance":
            continue
        channel = _CHANNEL[match.group(1)]
        if channel not in flight:
            raise NotJudged(f"the flight record has no {channel}, which {word} requires")
        if _WARNING.match(match.group(3)):
            times = [
                events[event] for event in ("stall_warning", "initial_buffet") if event in events
            ]
            if not times:
                raise NotJudged(
                    f"give the event stall_warning or initial_buffet in [events]: the row "
                    f"counts only with {word}"
                )
            mask &= flight[channel] > np.interp(min(times), time, flight[channel])
        else:
            mask &= satisfies_relation(word, flight[channel])
    return mask


_WITH_BAND = ("trace", "end_value", "steady", "change", "low_speed_end", "curve", "event_value")
_NUMBER = re.compile(r"^\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\D.*)?$")


class ToleranceOverride(Strict):
    """One entry of the table, written out."""

    abs: float | str | None = Field(
        default=None, description="Half width: SI, or with its unit.", examples=["2 deg/s"]
    )
    percent: float | None = Field(
        default=None, description="Half width as a percentage of base.", examples=[10.0]
    )
    base: Literal["ref_local", "ref_peak", "ref_scalar", "range_max"] = Field(
        default="ref_local",
        description="What percent refers to: the flight at each instant, its peak, its value at "
        "the event, the largest value in service.",
        examples=["ref_peak"],
    )
    rule: Literal["greater_of", "lesser_of"] = Field(
        default="greater_of", description="Which of two widths counts.", examples=["lesser_of"]
    )
    group: str = Field(
        default="",
        description="Rows of one group are alternatives, different groups must all pass.",
        examples=["a"],
    )
    window: tuple[float, float] | None = Field(
        default=None,
        description="[start, end] on the clock of the record that is judged.",
        examples=[[2.0, 12.0]],
    )

    @model_validator(mode="after")
    def _has_width(self) -> ToleranceOverride:
        if self.abs is None and self.percent is None:
            raise ValueError("has no width; give abs, percent or both")
        return self


def apply_override(
    criteria: Sequence[Criterion], key: str, item: Any, window: tuple[float, float]
) -> list[Criterion]:
    """Return the criteria with one entry of ``[tolerance]`` applied.

    Parameters
    ----------
    criteria : sequence of Criterion
        Those found so far.
    key : str
        Name of a criterion (``pitch_angle``, ``period``) or a channel (``theta``).
    item : number, str or table
        ``"1.5 deg"``, or ``{ abs = "2 deg/s", percent = 10, base = "ref_local", rule = "greater_of"
        }``.
    window : tuple of float
        Window of a criterion that is added. [s]

    Raises
    ------
    UnknownName, UnitError, OutOfRange, SchemaError
        Key, unit, width or keys of the entry are wrong.
    """
    entry = validate_content(
        ToleranceOverride, item if isinstance(item, dict) else {"abs": item}, "entry"
    )
    matching = [c for c in criteria if c.name == key] or [
        c for c in criteria if c.channel == key and c.measure in _WITH_BAND
    ]
    if not matching:
        try:
            lookup(key)
        except UnknownName:
            raise UnknownName(
                key,
                {c.name for c in criteria} | {c.channel for c in criteria if c.channel},
                "criterion",
            ) from None
        new = Criterion(
            key,
            "",
            key,
            "trace",
            entry.group or key,
            Band(),
            entry.window or window,
            kind="time_history",
        )
        return [*criteria, _changed(new, entry)]
    return [_changed(c, entry) if c in matching else c for c in criteria]


def _changed(criterion: Criterion, entry: ToleranceOverride) -> Criterion:
    limits = []
    if entry.percent is not None:
        limits.append(Limit("percent", entry.percent, "%"))
    if entry.abs is not None:
        value, unit = _printed(entry.abs, si_unit(criterion.measure, criterion.channel))
        limit_to_si_factor(criterion.measure, criterion.channel, unit)
        limits.append(Limit("absolute", value, unit))
    if any(limit.value <= 0.0 for limit in limits):
        raise OutOfRange(
            f"width {min(limit.value for limit in limits):g} is not positive; a tolerance is "
            f"a half width"
        )
    band = Band(
        tuple(limits),
        entry.rule if len(limits) == 2 else "single",
        entry.base if entry.percent is not None else "",
    )
    return replace(
        criterion,
        band=band,
        group=entry.group or criterion.group,
        window=entry.window or criterion.window,
        provenance="case file",
    )


def _printed(item: float | str, si: str) -> tuple[float, str]:
    """Return number and unit as written; without a unit the number is SI."""
    if not isinstance(item, str):
        return float(item), si
    match = _NUMBER.match(item)
    if not match:
        raise UnitError(f"found {item!r}; expected a number and a unit such as '1.5 {si}'")
    return float(match.group(1)), (match.group(2) or si).strip()


def required_quantities(criterion: Criterion) -> tuple[str, ...]:
    """Return the quantities a criterion is computed from, formed ones among them."""
    match criterion.measure:
        case "peak_lag":
            return ("phi", "beta")
        case "segment_mean":
            return ("h",) if criterion.channel == "hdot" else (criterion.channel,)
        case "floor":
            return ("h", "V")
        case "curve" | "breakout" | "force_increment":
            return (criterion.channel, criterion.abscissa)
        case "scalar":
            return {"turn_radius": ("distance", "psi"), "trim_rate": (criterion.abscissa,)}.get(
                criterion.parameter, (criterion.channel, criterion.abscissa)
            )
        case "elapsed":
            return tuple(
                filter(
                    None,
                    (
                        criterion.channel,
                        criterion.abscissa,
                        LEVELS.get(criterion.bounds[1], ("",))[0],
                    ),
                )
            )
    return (criterion.channel,)


def required_signals(criterion: Criterion) -> tuple[str, ...]:
    """Return the signals that a criterion is computed from; a model has to have them."""
    return tuple(
        dict.fromkeys(
            name for channel in required_quantities(criterion) for name in source_signals(channel)
        )
    )


def helpful_signals(criterion: Criterion) -> tuple[str, ...]:
    """Return signals that show the events and conditions of a criterion; a model may have them."""
    event = (
        OF_PARAMETER.get(criterion.parameter, "")
        if criterion.measure in ("event_value", "setup")
        else ""
    )
    showing = [
        name
        for each in (event, *criterion.bounds)
        for name in (*DISCRETES.get(each, ()), *LEVELS.get(each, ())[:1])
    ]
    flows = (
        [f"engine{n}.fuel_flow" for n in range(1, 5)] if criterion.channel == "fuel_used" else []
    )
    return tuple(
        dict.fromkeys(
            name
            for channel in (*showing, *condition_channels(criterion.condition), *flows)
            for name in source_signals(channel)
        )
    )


STANDARD = "FAA 14 CFR Part 60 App A Table A2A"
EDITION = "2014-01-01"
DEMONSTRATION = (
    "a demonstration: recordings are shown and judged by pilots, the table gives no number"
)
_UNCHANNELLED = dict.fromkeys(
    ("response_initial", "response_total"),
    "name the critical engine parameter in case.engine_parameter",
)
Row = Mapping[str, str]

# Rows whose measure the README of the table spells out otherwise: the spiral's bank angle is judged
# 20 s after release, a
# change of elevator is that between two snapshots, a force increment is over the static sweep.
_JUDGED_AS = {("2.d.4", "bank_angle", "trace"): "end_value"}
_PARAMETER_AS = {"elevator_change": "change", "dynamic_force_increment": "force_increment"}
_OFFSET = re.compile(r"^(\w+?)([+-]\d+(?:\.\d+)?)s$")


@cache
def tolerance_rows() -> tuple[Row, ...]:
    """Return every row of ``tolerances.csv``."""
    with (Path(__file__).parent / "tolerances.csv").open(newline="", encoding="utf-8") as file:
        return tuple(csv.DictReader(file))


def rows_of_test(id: str, standard: str = STANDARD, edition: str = EDITION) -> list[Row]:
    """Return the rows of one test.

    Raises
    ------
    UnknownName
        No such standard, edition or test; with the near ones.
    """
    found = [row for row in tolerance_rows() if row["standard"] == standard]
    if not found:
        raise UnknownName(standard, {row["standard"] for row in tolerance_rows()}, "standard")
    editions = {row["edition"] for row in found}
    if edition not in editions:
        raise UnknownName(edition, editions, f"edition of {standard!r}")
    found = [row for row in found if row["edition"] == edition]
    chosen = [row for row in found if row["test_id"] == id]
    if not chosen:
        raise UnknownName(id, {row["test_id"] for row in found}, f"test of {standard!r}, {edition}")
    return chosen


def claimable_features() -> set[str]:
    """Return every word that a case can claim; conditions that the record shows are not among them,
    but for the kinds of damping.
    """
    return {
        word
        for row in tolerance_rows()
        for word in row["condition"].split(";")
        if word and (is_claim(word) or word in KINDS)
    }


def window_events() -> set[str]:
    """Return every event that bounds a window; ``capture`` is the instant of a snapshot."""
    bounds = {row[end] for row in tolerance_rows() for end in ("applies_from", "applies_to")} - {""}
    return set(MEASURED) | {
        match.group(1) if (match := _OFFSET.match(bound)) else bound for bound in bounds
    }


def band_of(row: Row) -> Band:
    """Return the tolerance of a row as printed."""
    if row["quantity"] in ("none", ""):
        return Band()
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
    if text in times:
        return times[text]
    match = _OFFSET.match(text)
    event, shift = (match.group(1), float(match.group(2))) if match else (text, 0.0)
    if event not in times:
        raise UnknownName(event, times, "event", "give its time in [events]")
    return times[event] + shift


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
        As bounded by the row's events. [s]
    features : tuple of str
        Conditions that hold for the case.
    mode_channel, engine_parameter : str
        Channel of modal and of engine response measures.
    """
    measure = _PARAMETER_AS.get(row["parameter"]) or _JUDGED_AS.get(
        (row["test_id"], row["parameter"], row["measure"]), row["measure"]
    )
    travel = TRAVEL.get(plain_id(row["test_id"]), "")
    channel = _channel(row, measure, travel, mode_channel, engine_parameter)
    missing = missing_claims(row["condition"], features)
    return Criterion(
        name=name,
        parameter=row["parameter"],
        channel=channel,
        measure=measure,
        group=row["group"],
        band=band_of(row),
        window=window,
        applies=not missing,
        reason=f"applies only with {', '.join(missing)}"
        if missing
        else ""
        if channel
        else _UNCHANNELLED.get(measure, DEMONSTRATION),
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
    """Return what a row is judged on; what a case chooses (mode, engine parameter) before what the
    table sets.
    """
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
    """Return one unique name per row: the parameter, with its measure or place when it stands more
    than once.
    """
    names: list[str] = []
    for row in found:
        choices = [row["parameter"], f"{row['parameter']} {row['measure']}"]
        choices += [f"{row['parameter']} {row['measure']} {n}" for n in range(2, len(found) + 1)]
        names.append(next(name for name in choices if name not in names))
    return names
