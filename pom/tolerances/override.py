"""The table ``[tolerance]`` of a case file: bands that replace those of the row or add to them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

from pydantic import Field, model_validator

from flightmech.errors import OutOfRange, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.configuration import Strict, validate

from .criteria import Band, Criterion, Limit
from .parameter_channels import factor, si_unit

_WITH_BAND = ("trace", "end_value", "steady", "change", "low_speed_end", "curve", "event_value")
_NUMBER = re.compile(r"^\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\D.*)?$")


class Entry(Strict):
    """One entry of the table, written out."""

    abs: float | str | None = Field(default=None, description="Half width: SI, or with its unit.", examples=["2 deg/s"])
    percent: float | None = Field(default=None, description="Half width as a percentage of base.", examples=[10.0])
    base: Literal["ref_local", "ref_peak", "ref_scalar", "range_max"] = Field(
        default="ref_local",
        description="What percent refers to: the flight at each instant, its peak, its value at the event, the largest value in service.",
        examples=["ref_peak"],
    )
    rule: Literal["greater_of", "lesser_of"] = Field(
        default="greater_of", description="Which of two widths counts.", examples=["lesser_of"]
    )
    group: str = Field(default="", description="Rows of one group are alternatives, different groups must all pass.", examples=["a"])
    window: tuple[float, float] | None = Field(
        default=None, description="[start, end] on the clock of the record that is judged.", examples=[[2.0, 12.0]]
    )

    @model_validator(mode="after")
    def _has_width(self) -> Entry:
        if self.abs is None and self.percent is None:
            raise ValueError("has no width; give abs, percent or both")
        return self


def override(criteria: Sequence[Criterion], key: str, item: Any, window: tuple[float, float]) -> list[Criterion]:
    """Return the criteria with one entry of ``[tolerance]`` applied.

    Parameters
    ----------
    criteria : sequence of Criterion
        Those found so far.
    key : str
        Name of a criterion (``pitch_angle``, ``period``) or a channel (``theta``).
    item : number, str or table
        ``"1.5 deg"``, or ``{ abs = "2 deg/s", percent = 10, base = "ref_local", rule = "greater_of" }``.
    window : tuple of float
        Window of a criterion that is added. [s]

    Raises
    ------
    UnknownName, UnitError, OutOfRange, SchemaError
        Key, unit, width or keys of the entry are wrong.
    """
    entry = validate(Entry, item if isinstance(item, dict) else {"abs": item}, "entry")
    matching = [c for c in criteria if c.name == key] or [c for c in criteria if c.channel == key and c.measure in _WITH_BAND]
    if not matching:
        try:
            lookup(key)
        except UnknownName:
            raise UnknownName(key, {c.name for c in criteria} | {c.channel for c in criteria if c.channel}, "criterion") from None
        new = Criterion(key, "", key, "trace", entry.group or key, Band(), entry.window or window, kind="time_history")
        return [*criteria, _changed(new, entry)]
    return [_changed(c, entry) if c in matching else c for c in criteria]


def _changed(criterion: Criterion, entry: Entry) -> Criterion:
    limits = []
    if entry.percent is not None:
        limits.append(Limit("percent", entry.percent, "%"))
    if entry.abs is not None:
        value, unit = _printed(entry.abs, si_unit(criterion.measure, criterion.channel))
        factor(criterion.measure, criterion.channel, unit)
        limits.append(Limit("absolute", value, unit))
    if any(limit.value <= 0.0 for limit in limits):
        raise OutOfRange(f"width {min(limit.value for limit in limits):g} is not positive; a tolerance is a half width")
    band = Band(tuple(limits), entry.rule if len(limits) == 2 else "single", entry.base if entry.percent is not None else "")
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
