"""Name maps: which column of a file is which quantity of the house, in what unit, sign and scale.

A map is a TOML file.  Every table is a leaf of the record (channels of one time base), every key in it a house name::

    [record]                                   # facts that the file does not state, optional
    latitude = "45 deg"
    [imu]
    q = "pitch_rate"                           # column name; the unit stands in the file
    az_imu = { column = "acc/nz", unit = "g", sign = -1 }
    [controls]
    delta_f = { column = "flap", scale = "40 deg" }
    [time]                                     # CSV only: the clock
    column = "t"

A channel is ``sign * scale * column + offset`` after the change of unit; a `scale` with a unit (``"40 deg"`` per one of
the column) replaces the change of unit.  `delay` is a known latency: the channel shows at t what was true at t - delay.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from flightmech.configuration import Strict, load, si, validate
from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import quantity, to_si

_ALIASES = {"-": "1", "pct": "%", "percent": "%", "deg C": "degC", "kts": "kt", "knots": "kt", "seconds": "s", "sec": "s"}


class Channel(Strict):
    """Where a channel comes from and how it becomes SI."""

    column: str
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: float | str = 1.0
    offset: float | str = 0.0
    delay: si("s") = 0.0  # type: ignore[valid-type]

    def convert(self, values, file_unit: str | None, name: str):
        """Return the column's `values` in the SI unit of the house name `name`."""
        units = lookup(name).units
        offset = quantity(self.offset, units)
        if isinstance(self.scale, str):
            return self.sign * quantity(self.scale, units) * values + offset
        unit = self.unit or file_unit
        if unit is None:
            raise UnitError(
                f'column {self.column!r} has no unit in the file; give unit = "..." for {name} in the name map (expected {units})'
            )
        return self.sign * self.scale * to_si(values, _ALIASES.get(unit, unit), units) + offset

    def calibration(self, file_unit: str | None) -> str:
        """Return in words what `convert` did."""
        scale = f"{self.scale} *" if self.scale != 1.0 else ""
        unit = "" if isinstance(self.scale, str) else f"[{self.unit or file_unit}]"
        offset = f"+ {self.offset}" if self.offset != 0.0 else ""
        return " ".join(part for part in ("-" if self.sign < 0 else "", scale, self.column, unit, offset) if part)


class Facts(Strict):
    """Facts about a record that its file may not state."""

    title: str | None = None
    start: str | None = None
    purpose: str | None = None
    latitude: si("rad") | None = None  # type: ignore[valid-type]
    runway_elevation: si("m") | None = None  # type: ignore[valid-type]


class Clock(Strict):
    """The time column of a CSV file."""

    column: str = "time"
    unit: str = "s"


@dataclass(frozen=True)
class NameMap:
    """A name map: leaves of channels, the clock, and facts about the record."""

    leaves: dict[str, dict[str, Channel]]
    clock: Clock = field(default_factory=Clock)
    facts: Facts = field(default_factory=Facts)
    source: str = "names"


def read_names(path: str | Path) -> NameMap:
    """Return the name map in a TOML file.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        With all problems: unknown keys and house names with their near names, wrong units.
    """
    content = load(path)
    what = f"name map {path}"
    problems: list[str] = []
    clock = _part(Clock, content.pop("time", {}), "time", problems)
    facts = _part(Facts, content.pop("record", {}), "record", problems)
    leaves: dict[str, dict[str, Channel]] = {}
    for leaf, table in content.items():
        if not isinstance(table, dict):
            problems.append(f"{leaf}: a leaf is a table of channels ([{leaf}]); found {table!r}")
            continue
        leaves[leaf] = _channels(leaf, table, problems)
    problems += _twice(leaves)
    if problems:
        raise SchemaError(what, problems)
    return NameMap(leaves, clock or Clock(), facts or Facts(), str(path))


def _channels(leaf: str, table: dict[str, Any], problems: list[str]) -> dict[str, Channel]:
    channels = {}
    for name, entry in _flatten(table).items():
        place = f"{leaf}.{name}"
        try:
            row = lookup(name)
        except UnknownName as error:
            problems.append(f"{place}: {error}")
            continue
        channel = _part(Channel, {"column": entry} if isinstance(entry, str) else entry, place, problems)
        if channel is None:
            continue
        for key in ("scale", "offset"):
            try:
                if isinstance(getattr(channel, key), str):
                    quantity(getattr(channel, key), row.units)
            except UnitError as error:
                problems.append(f"{place}.{key}: {error}")
        channels[name] = channel
    return channels


def _flatten(table: dict[str, Any]) -> dict[str, Any]:
    """Join the keys of engines, which TOML splits at the dot: ``engine1.thrust``."""
    flat = {}
    for name, entry in table.items():
        engine = isinstance(entry, dict) and name.startswith("engine") and "column" not in entry
        flat.update({f"{name}.{key}": item for key, item in entry.items()} if engine else {name: entry})
    return flat


def _part(model, content: Any, place: str, problems: list[str]):
    if not isinstance(content, dict):
        problems.append(f'{place}: expected a column name or a table such as {{ column = "..." }}; found {content!r}')
        return None
    try:
        return validate(model, content, place)
    except SchemaError as error:
        problems += [f"{place}.{problem}" for problem in error.problems]
        return None


def _twice(leaves: dict[str, dict[str, Channel]]) -> list[str]:
    seen: dict[str, str] = {}
    problems = []
    for leaf, channels in leaves.items():
        for name in channels:
            if name in seen:
                problems.append(f"{leaf}.{name}: already in leaf {seen[name]}; a quantity has one channel")
            seen.setdefault(name, leaf)
    return problems
