"""Tolerances of a case file that replace the band of a row or add a criterion."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

from pydantic import ConfigDict, Field, model_validator

from flightmech.errors import OutOfRange, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_unit
from pom.tolerances.channels import limit_to_si_factor, si_unit
from pom.tolerances.criteria import Band, Criterion, Limit

# Measures that the name of a channel selects.
_WITH_BAND = ("trace", "end_value", "steady", "change", "low_speed_end", "curve", "event_value")
_NUMBER = re.compile(r"^\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\D.*)?$")


class ToleranceOverride(Strict):
    """One entry of the table, written out."""

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    abs: float | str | None = Field(
        default=None,
        description="Half width with its unit; a bare number only for a ratio.",
        examples=["2 deg/s"],
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
        Criteria before the entry is applied.
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
    content = item if isinstance(item, dict) else {"abs": item}
    entry = validate_content(ToleranceOverride, content, "entry")
    # The name of a criterion has priority over the name of a channel.
    matching = [c for c in criteria if c.name == key]
    if not matching:
        matching = [c for c in criteria if c.channel == key and c.measure in _WITH_BAND]
    if not matching:
        return [*criteria, _override_band(_new_criterion(criteria, key, entry, window), entry)]
    changed = []
    for criterion in criteria:
        if criterion in matching:
            criterion = _override_band(criterion, entry)
        changed.append(criterion)
    return changed


def _new_criterion(
    criteria: Sequence[Criterion], key: str, entry: ToleranceOverride, window: tuple[float, float]
) -> Criterion:
    """Return a time-history criterion on a channel that no row judges."""
    try:
        lookup(key)
    except UnknownName:
        names = {c.name for c in criteria} | {c.channel for c in criteria if c.channel}
        raise UnknownName(key, names, "criterion") from None
    return Criterion(
        name=key,
        parameter="",
        channel=key,
        measure="trace",
        group=entry.group or key,
        band=Band(),
        window=entry.window or window,
        kind="time_history",
    )


def replaced_rows(criteria: Iterable[Criterion]) -> list[str]:
    """Return a problem for every band of the case file in the group of a row of the rule.

    The band would be an alternative of the row and hide that the row is invalid or not tested.
    """
    rows: dict[str, list[str]] = {}
    own: dict[str, list[str]] = {}
    for criterion in criteria:
        # a band that the case file adds has no parameter of the table
        members = rows if criterion.parameter else own
        members.setdefault(criterion.group, []).append(criterion.name)
    problems = []
    for group in own.keys() & rows.keys():
        for name in own[group]:
            problems.append(
                f"tolerance.{name}.group: {group!r} is the group of {', '.join(rows[group])}; a "
                f"band of the case file never replaces a row of the rule: leave the group out, "
                f"and the band is judged in addition to the row"
            )
    return problems


def _override_band(criterion: Criterion, entry: ToleranceOverride) -> Criterion:
    """Return a criterion with the band, group and window of an entry."""
    limits = []
    if entry.percent is not None:
        limits.append(Limit("percent", entry.percent, "%"))
    if entry.abs is not None:
        value, unit = _split_quantity(entry.abs, criterion)
        # A unit that does not fit the channel raises UnitError.
        limit_to_si_factor(criterion.measure, criterion.channel, unit)
        limits.append(Limit("absolute", value, unit))
    for limit in limits:
        # An infinite width would pass every response; a comparison with NaN is always false.
        if not 0.0 < limit.value < math.inf:
            raise OutOfRange(
                f"width {limit.value:g} is not positive and finite; a tolerance is a half width"
            )
    rule = entry.rule if len(limits) == 2 else "single"
    base = entry.base if entry.percent is not None else ""
    return replace(
        criterion,
        band=Band(tuple(limits), rule, base),
        group=entry.group or criterion.group,
        window=entry.window or criterion.window,
        provenance="case file",
        # a band of the case file supplies the number that was not read
        reason=criterion.reason if criterion.band.limits else "",
    )


def _split_quantity(item: float | str, criterion: Criterion) -> tuple[float, str]:
    """Return number and unit as written; only a ratio or a count has no unit."""
    si = si_unit(criterion.measure, criterion.channel)
    match = _NUMBER.match(str(item))
    # TOML has inf and nan as numbers, which the caller refuses with a clearer text
    if not match and not isinstance(item, str):
        return float(item), si
    if not match:
        raise UnitError(f"found {item!r}; expected a number and a unit such as '1.5 {si}'")
    value, unit = float(match.group(1)), (match.group(2) or "").strip()
    if not unit and parse_unit(si)[0] != parse_unit("1")[0]:
        raise UnitError(_bare_number_text(value, si, criterion))
    return value, unit or si


def _bare_number_text(value: float, si: str, criterion: Criterion) -> str:
    """Return the text on a width without a unit, with its ratio to the printed width."""
    unit, compared = si, ""
    for limit in criterion.band.limits:
        if limit.quantity == "absolute" and limit.value:
            unit = limit.unit
            width = limit.value * limit_to_si_factor(criterion.measure, criterion.channel, unit)
            compared = f", {value / width:.3g} times the printed {limit.text}"
    return (
        f"{value:g} has no unit: in {si} it would be a half width of {value:g} {si}{compared}; "
        f"write the number with its unit, such as '{value:g} {unit}'"
    )
