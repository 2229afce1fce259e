"""Name maps: which column of a file is which quantity of the vocabulary, in what unit, sign and
scale, over which clock.

A map is a TOML file.  Every table is a leaf of the record (channels of one time base), every key in it a canonical name::

    extends = "px4"                            # a shipped map, or another file; what stands here goes before it
    [record]                                   # facts that the file does not state, optional
    latitude = "45 deg"
    [constants]                                # channels that no column shows and that did not change
    delta_f = "0 deg"
    [instruments.boom]                         # instruments of this recorder, as in the aircraft file, in place of its table of that name
    position = [4.1, 0.0, 0.1]
    [time]                                     # the clock; [time.NAME] for one table (group, topic) of the file
    column = "t"
    [imu]
    q = "pitch_rate"                           # column name; the unit stands in the file
    az_imu = { column = "acc/nz", unit = "g", sign = -1 }
    [controls]
    delta_f = { column = "flap", scale = "40 deg" }
    delta_e = { column = "pot_3", unit = "deg", polynomial = [-12.1, 0.0321, 1.2e-6] }
    delta_r = { column = "pot_5", unit = "deg", table = [[112, -25], [530, 0], [980, 25]] }
    [decode.adc]                               # words of a bus or frame, see flighttest.records.readers.bus_words

A channel is ``sign * scale * column + offset`` after calibration and change of unit.  `polynomial`
(ascending powers of the raw column) or `table` (raw, value; linear between, NaN and flagged beyond)
give the value in `unit`; a `scale` with a unit (``"40 deg"`` per one of the column) replaces the
change of unit.  `column` may be a list: the first that the file holds is taken.  `optional = true`
leaves a channel out where the file has no such column.  `delay` is a known latency: the channel
shows at t what was true at t - delay. `lag` is a known time constant: the channel follows the truth
as a first-order lag; a negative one makes a recorded command the position of an actuator that
follows it with that time constant.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import WESTERN, foreign_kind, read_text, read_toml
from flightmech.support.plain_tables import Plain, define_field, read_plain_table
from flightmech.support.toml_models import validate_content
from flightmech.support.toml_quantities import Above, InUnits
from flightmech.units import G0, fitted_unit, known_unit, parse_quantity, parse_unit, to_si
from flighttest.records.readers.bus_words import KINDS, Arinc429, Decode
from flighttest.records.sensors.instruments import Instrument

T = TypeVar("T")
P = TypeVar("P", bound=Plain)

MAPS = Path(__file__).parent / "maps"
TOP = ("extends", "optional", "time", "record", "constants", "instruments", "utc", "decode")


class Channel(Plain):
    """Where a channel comes from and how it becomes SI."""

    column: str | tuple[str, ...] = define_field(
        description="Column of the file, TABLE/COLUMN where there are several tables; of a list "
        "the first that the file holds."
    )
    unit: str | None = define_field(
        default=None,
        description="Unit of the column, where the file does not state it or states another.",
    )
    sign: Literal[1, -1] = define_field(
        default=1, description="-1 where the recorder's positive sense is the opposite one."
    )
    scale: float | str = define_field(
        default=1.0,
        description='Factor of the column; with a unit ("40 deg") it replaces the change of unit.',
    )
    offset: float | str = define_field(default=0.0, description="Added last: SI, or with its unit.")
    polynomial: tuple[float, ...] | None = define_field(
        default=None,
        examples=[[-12.1, 0.0321, 1.2e-06]],
        description="Calibration: coefficients of the raw column by ascending power, giving the "
        "value in unit.",
    )
    table: tuple[tuple[float, float], ...] | None = define_field(
        default=None,
        examples=[[[112, -25], [530, 0], [980, 25]]],
        description="Calibration: rows [raw, value] in unit, or a CSV file of two columns; linear "
        "between, NaN and flagged beyond.",
    )
    delay: Annotated[float, InUnits("s")] = define_field(
        default=0.0,
        examples=["60 ms"],
        description="Known latency: the channel shows at t what was true at t - delay.",
    )
    lag: Annotated[float, InUnits("s")] = define_field(
        default=0.0,
        examples=["-0.05 s"],
        description="Known time constant of a first-order lag behind the truth; negative: of a "
        "command, that of the actuator.",
    )
    rate_limit: float | str | None = define_field(
        default=None,
        examples=["300 deg/s"],
        description="Of a command: the highest rate of the actuator that follows it, in SI or "
        "with its unit.",
    )
    stops: tuple[float | str, float | str] | None = define_field(
        default=None,
        examples=[["-25 deg", "20 deg"]],
        description="Of a command: lowest and highest position of the actuator, in SI or with "
        "their unit.",
    )
    optional: bool = define_field(
        default=False,
        description="Whether the channel is left out where the file has no such column.",
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns in the order in which they are looked for."""
        return (self.column,) if isinstance(self.column, str) else self.column

    def check(self) -> None:
        """Raise ValueError for limits of an actuator without one."""
        if (self.rate_limit is not None or self.stops is not None) and self.lag > 0.0:
            raise ValueError(
                f"rate_limit and stops belong to an actuator behind a recorded command: its "
                f"lag is negative or zero; lag is {self.lag:g} s"
            )

    def limits(self, name: str) -> tuple[float, tuple[float, float]] | None:
        """Return rate limit and stops of the actuator behind a command, in SI; None without any.

        Raises
        ------
        UnitError
            A unit that is none of the channel `name`.
        SchemaError
            A rate that is not positive, or stops in the wrong order.
        """
        if self.rate_limit is None and self.stops is None:
            return None
        units = lookup(name).units
        rate = (
            math.inf if self.rate_limit is None else parse_quantity(self.rate_limit, f"{units} s-1")
        )
        low, high = (
            (-math.inf, math.inf)
            if self.stops is None
            else (parse_quantity(stop, units) for stop in self.stops)
        )
        if not (rate > 0.0 and low < high):
            raise SchemaError(
                f"name map, {name}",
                [
                    f"rate_limit {rate:g}, stops {low:g} to {high:g}; a positive rate and "
                    f"stops that rise are needed"
                ],
            )
        return rate, (low, high)

    def convert(self, values, file_unit: str | None, name: str):
        """Return the column's `values` in the SI unit of the canonical name `name`; beyond a
        calibration table NaN.
        """
        units = lookup(name).units
        offset = parse_quantity(self.offset, units)
        values = self._calibrated(values)
        if isinstance(self.scale, str):
            return _line(values, self.sign * parse_quantity(self.scale, units), offset)
        unit = self.unit or file_unit
        if unit is None:
            raise UnitError(
                f'column {self.columns[0]!r} has no unit in the file; give unit = "..." for '
                f"{name} in the name map (expected {units})"
            )
        unit = fitted_unit(unit, units)
        zero = float(to_si(0.0, unit, units))
        factor = parse_unit(unit)[1]
        return _line(
            values, self.sign * self.scale * factor, self.sign * self.scale * zero + offset
        )

    def _calibrated(self, values):
        if self.polynomial is not None:
            return np.polynomial.polynomial.polyval(values, self.polynomial)
        if self.table is not None:
            raw, value = np.array(sorted(self.table)).T
            return np.interp(values, raw, value, left=np.nan, right=np.nan)
        return values

    def calibration(self, file_unit: str | None, column: str | None = None) -> str:
        """Return in words what `convert` did."""
        scale = f"{self.scale} *" if self.scale != 1.0 else ""
        source = column or self.columns[0]
        if self.polynomial is not None:
            source = f"polynomial {list(self.polynomial)} of {source}"
        elif self.table is not None:
            source = (
                f"table of {len(self.table)} points, {self.table[0]} to {self.table[-1]}, "
                f"of {source}"
            )
        unit = "" if isinstance(self.scale, str) else f"[{self.unit or file_unit}]"
        offset = f"+ {self.offset}" if self.offset != 0.0 else ""
        return " ".join(
            part for part in ("-" if self.sign < 0 else "", scale, source, unit, offset) if part
        )


def _line(values, factor: float, offset: float):
    """Return factor * values + offset without passes over the data that change nothing."""
    scaled = values if factor == 1.0 else factor * values
    return scaled if offset == 0.0 else scaled + offset


class Facts(Plain):
    """Facts about a record that its file may not state."""

    title: str | None = define_field(
        default=None, examples=["Flight 12, clean, 5000 ft"], description="Title of the record."
    )
    start: str | None = define_field(
        default=None,
        examples=["2024-05-17T09:30:00Z"],
        description="Start of the record in the time of the world.",
    )
    purpose: str | None = define_field(
        default=None,
        examples=["stability and control"],
        description="What the record was flown for.",
    )
    latitude: Annotated[float, InUnits("rad")] | None = define_field(
        default=None, description="Latitude of the flight; gives gravity and the rate of the Earth."
    )
    runway_elevation: Annotated[float, InUnits("m")] | None = define_field(
        default=None, examples=["120 m"], description="Elevation of the runway over mean sea level."
    )
    temperature: Annotated[float, InUnits("K"), Above(100.0)] | None = define_field(
        default=None,
        examples=["12 degC"],
        description="Constant temperature of the outside air, where none is recorded.",
    )
    wind_down_sigma: Annotated[float, InUnits("m s-1"), Above(0.0)] | None = define_field(
        default=None,
        examples=[0.2],
        description="Standard error of the mean vertical wind before the reconstruction.",
    )


class Clock(Plain):
    """The clock of a file or of one of its tables.

    `column` holds the stamps, in `unit` (the file's own without it, else seconds).  A counter that
    starts again after `wrap` is unrolled. `rate` makes even stamps from the first one on, for files
    that state a sampling rate only or stamps too coarse for their samples. The clock runs fast by
    `drift` seconds per second, counted from its first stamp; `offset` is added last and brings it
    onto the clock of the record.  `reset = true` moves what follows a backward step behind what
    went before.
    """

    column: str | None = define_field(
        default=None, examples=["adc/time"], description="Column of the stamps."
    )
    unit: str | None = define_field(
        default=None,
        examples=["us"],
        description="Unit of the stamps, us and ns as well; the file's own without it, else s.",
    )
    wrap: Annotated[float, InUnits("s")] | None = define_field(
        default=None,
        examples=["65.536 s"],
        description="Where a counter starts again; it is unrolled.",
    )
    rate: Annotated[float, InUnits("Hz")] | None = define_field(
        default=None,
        examples=["50 Hz"],
        description="Sampling rate: even stamps from the first one on.",
    )
    offset: Annotated[float, InUnits("s")] = define_field(
        default=0.0,
        examples=["0.12 s"],
        description="Added last; brings the clock onto that of the record.",
    )
    drift: float = define_field(
        default=0.0, examples=[2e-05], description="Seconds that the clock runs fast per second."
    )
    reset: bool = define_field(
        default=False,
        examples=[True],
        description="Whether what follows a backward step is moved behind what went before.",
    )

    def seconds(self, file_unit: str | None) -> float:
        """Return the seconds in one unit of the clock's column."""
        return float(to_si(1.0, self.unit or file_unit or "s", "s"))


class Utc(Plain):
    """A column that shows the time of day of the world: it names the start of the record and
    measures the drift of its clock.

    `epoch` is what the column counts from: ``unix`` (1970-01-01, UTC) or ``gps`` (1980-01-06, ahead
    of UTC by `leap_seconds`).
    """

    column: str = define_field(
        examples=["gps/utc"], description="Column with the time of day of the world."
    )
    unit: str = define_field(default="s", description="Its unit.")
    epoch: Literal["unix", "gps"] = define_field(
        default="unix",
        description="What it counts from: 1970-01-01 (unix), or 1980-01-06 without leap seconds "
        "(gps).",
    )
    leap_seconds: int = define_field(
        default=18, examples=[18], description="By which gps is ahead of UTC."
    )
    optional: bool = define_field(
        default=False, description="Whether it is left out where the file has no such column."
    )


@dataclass(frozen=True)
class NameMap:
    """A name map: leaves of channels, the clocks, facts about the record, what to take out of bus
    words, and channels that stood still.

    `constants` holds the value of each channel that no column shows [SI], `instruments` those that
    go before the aircraft file's.
    """

    leaves: dict[str, dict[str, Channel]]
    clock: Clock = field(default_factory=Clock)
    facts: Facts = field(default_factory=Facts)
    source: str = "names"
    clocks: dict[str, Clock] = field(default_factory=dict)
    utc: Utc | None = None
    decode: dict[str, Decode] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    instruments: dict[str, Instrument] = field(default_factory=dict)

    def clock_of(self, table: str) -> Clock:
        """Return the clock of a table of the file."""
        return self.clocks.get(table, self.clock)

    def requested_columns(self) -> list[str]:
        """Return the columns that channels, ``[utc]`` and ``[decode]`` read."""
        columns: list[str] = []
        for channels in self.leaves.values():
            for channel in channels.values():
                columns += channel.columns
        if self.utc is not None:
            columns.append(self.utc.column)
        for spec in self.decode.values():
            if isinstance(spec, Arinc429) and spec.column:
                columns.append(spec.column)
        return columns


def shipped_maps() -> list[str]:
    """Return the names of the maps that come with the product; each is a readable file in
    `flighttest/readers/maps`.
    """
    return sorted(file.stem for file in MAPS.glob("*.toml"))


def read_names(path: str | Path) -> NameMap:
    """Return the name map in a TOML file, or a shipped one by its name.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        With all problems: unknown keys and canonical names with their near names, wrong units.
    """
    path = _place(path, Path())
    problems: list[str] = []
    mapping = _parsed(_extended(path, ()), str(path), path.parent, problems)
    if problems:
        raise SchemaError(f"name map {path}", problems)
    return mapping


def _place(path: str | Path, folder: Path) -> Path:
    shipped = MAPS / f"{path}.toml"
    found = folder / path
    if found.exists() or not shipped.exists():
        if not found.exists() and not found.suffix:
            raise UnknownName(
                str(path),
                shipped_maps(),
                "name map",
                "give a TOML file or the name of a shipped map",
            )
        return found
    return shipped


def _extended(path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    """Return the content of a map with what it extends beneath it."""
    content = read_toml(path)
    if kind := foreign_kind(content):
        raise SchemaError(
            f"name map {path}",
            [f"{kind}; a name map has a table of channels for each clock, such as [air_data]"],
        )
    leaves = [(leaf, table) for leaf, table in content.items() if isinstance(table, dict)]
    twice = [
        f"{leaf}.{name}: stands there twice, with quotes and without; take one out"
        for leaf, table in leaves
        for name in _twice_written(table)
    ]
    if twice:
        raise SchemaError(f"name map {path}", twice)
    if content.get("optional") is True:
        content = {
            key: item if key in TOP else _as_optional(item)
            for key, item in content.items()
            if key != "optional"
        }
    base = content.pop("extends", None)
    if base is None:
        return content
    below = _place(str(base), path.parent)
    if below in (*above, path):
        raise SchemaError(
            f"name map {path}", [f"extends: {base} extends this map in turn; take one of them out"]
        )
    return _laid_over(content, _extended(below, (*above, path)))


def _as_optional(leaf: Any) -> Any:
    if not isinstance(leaf, dict):
        return leaf
    return {
        name: {"optional": True, **entry}
        if isinstance(entry, dict)
        else {"optional": True, "column": entry}
        for name, entry in _flatten(leaf).items()
    }


def _laid_over(content: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """Return both maps: tables are joined, and a quantity named in `content` leaves every leaf of
    `base`.
    """
    named = {
        name
        for leaf, table in content.items()
        if leaf not in TOP and isinstance(table, dict)
        for name in _flatten(table)
    }
    joined = {
        leaf: {name: entry for name, entry in _flatten(table).items() if name not in named}
        if leaf not in TOP and isinstance(table, dict)
        else table
        for leaf, table in base.items()
    }
    for leaf, table in content.items():
        joined[leaf] = (
            {**joined.get(leaf, {}), **_flatten(table)} if isinstance(table, dict) else table
        )
    return joined


def _parsed(content: dict[str, Any], source: str, folder: Path, problems: list[str]) -> NameMap:
    own: dict[str, Any] = {}
    others: dict[str, Any] = {}
    time = content.pop("time", {})
    if not isinstance(time, dict):
        time = _part(_made(Clock), time, "time", problems) or {}
    for key, item in time.items():
        (others if isinstance(item, dict) else own)[key] = item
    clock = _clock(own, "time", problems)
    clocks = {
        name: _clock({**own, **item}, f"time.{name}", problems) for name, item in others.items()
    }
    facts = _part(_made(Facts), content.pop("record", {}), "record", problems)
    utc = _part(_made(Utc), content.pop("utc"), "utc", problems) if "utc" in content else None
    decode = _decoded(content.pop("decode", {}), problems)
    specified = _instruments(content.pop("instruments", {}), problems)
    constants = _constants(content.pop("constants", {}), problems)
    leaves: dict[str, dict[str, Channel]] = {}
    for leaf, table in content.items():
        if not isinstance(table, dict):
            problems.append(f"{leaf}: a leaf is a table of channels ([{leaf}]); found {table!r}")
            continue
        leaves[leaf] = _channels(leaf, table, folder, problems)
    problems += _twice(leaves)
    shown = {
        name
        for channels in leaves.values()
        for name, channel in channels.items()
        if not channel.optional
    }
    problems += [
        f"constants.{name}: a column shows it too; take one of them out"
        for name in constants
        if name in shown
    ]
    return NameMap(
        leaves, clock, facts or Facts(), source, clocks, utc, decode, constants, specified
    )


def _instruments(tables: Any, problems: list[str]) -> dict[str, Instrument]:
    if not isinstance(tables, dict):
        problems.append(f"instruments: expected tables [instruments.NAME]; found {tables!r}")
        return {}
    if not tables:
        return {}

    read = partial(validate_content, Instrument)
    found = {
        name: _part(read, table, f"instruments.{name}", problems) for name, table in tables.items()
    }
    return {name: item for name, item in found.items() if item is not None}


def _constants(table: Any, problems: list[str]) -> dict[str, float]:
    """Return channels that stood still. [SI]"""
    if not isinstance(table, dict):
        problems.append(
            f'constants: expected a table such as {{ delta_f = "0 deg" }}; found {table!r}'
        )
        return {}
    found = {}
    for name, item in _flatten(table).items():
        try:
            found[name] = parse_quantity(item, lookup(name).units)
        except (UnknownName, UnitError) as error:
            problems.append(f"constants.{name}: {error}")
    return found


def _clock(content: dict[str, Any], place: str, problems: list[str]) -> Clock:
    clock = _part(_made(Clock), content, place, problems) or Clock()
    if clock.unit is not None:
        try:
            clock.seconds(None)
        except UnitError as error:
            problems.append(f"{place}.unit: {error}")
    for key in ("rate", "wrap"):
        if getattr(clock, key) is not None and not getattr(clock, key) > 0.0:
            problems.append(f"{place}.{key}: must be positive; found {getattr(clock, key)!r}")
    return clock


def _decoded(content: Any, problems: list[str]) -> dict[str, Decode]:
    found: dict[str, Decode] = {}
    if not isinstance(content, dict) or not content:
        return found

    for name, table in content.items():
        kind = table.get("kind") if isinstance(table, dict) else None
        if kind not in KINDS:
            problems.append(f"decode.{name}.kind: found {kind!r}; allowed: {', '.join(KINDS)}")
            continue
        part: Decode | None = _part(
            partial(validate_content, KINDS[kind]), table, f"decode.{name}", problems
        )
        if part is not None:
            problems += [f"decode.{name}.{text}" for text in part.problems()]
            found[name] = part
    return found


def _channels(
    leaf: str, table: dict[str, Any], folder: Path, problems: list[str]
) -> dict[str, Channel]:
    channels = {}
    for name, entry in _flatten(table).items():
        place = f"{leaf}.{name}"
        try:
            row = lookup(name)
        except UnknownName as error:
            problems.append(f"{place}: {error}")
            continue
        if isinstance(entry, dict) and isinstance(entry.get("table"), str):
            entry = {**entry, "table": _table_file(folder / entry["table"], place, problems)}
        channel = _part(
            _made(Channel),
            {"column": entry} if isinstance(entry, str | list) else entry,
            place,
            problems,
        )
        if channel is None:
            continue
        problems += [f"{place}.{text}" for text in _faults(channel, row.units)]
        channels[name] = channel
    return channels


def _faults(channel: Channel, units: str) -> list[str]:
    """Return what is wrong in a channel beyond the kinds of its values."""
    found = []
    for key in ("scale", "offset"):
        try:
            if isinstance(getattr(channel, key), str):
                parse_quantity(getattr(channel, key), units)
        except UnitError as error:
            found.append(f"{key}: {error}")
    if channel.unit is not None:
        unit = fitted_unit(channel.unit, units)
        try:
            if parse_unit(unit)[0] != parse_unit(units)[0]:
                raise UnitError(
                    f"{channel.unit!r} cannot be converted to {units!r}; give a unit of the "
                    f"same quantity"
                )
        except UnitError as error:
            found.append(f"unit: {error}")
    if not channel.columns:
        found.append("column: an empty list; name a column")
    calibrated = channel.polynomial is not None or channel.table is not None
    if channel.polynomial is not None and channel.table is not None:
        found.append("table: stands next to a polynomial; give one of them")
    if calibrated and channel.unit is None and not isinstance(channel.scale, str):
        found.append(
            f'unit: a calibration needs the unit of its values; give unit = "..." (of the '
            f"kind of {units})"
        )
    if channel.polynomial is not None and not channel.polynomial:
        found.append("polynomial: empty; give the coefficients by ascending power")
    if channel.table is not None and (
        len(channel.table) < 2 or len({raw for raw, _ in channel.table}) < len(channel.table)
    ):
        found.append("table: needs two rows [raw, value] or more, each raw value once")
    return found


def _table_file(path: Path, place: str, problems: list[str]) -> list[list[float]]:
    """Return a calibration table kept in a CSV file: two columns, raw and value; other lines than
    numbers may head it.
    """
    try:
        lines = read_text(path, "two columns of numbers, raw and value", WESTERN).splitlines()
    except (OSError, ParseError) as error:
        problems.append(f"{place}.table: {path} cannot be read ({error})")
        return [[0.0, 0.0], [1.0, 0.0]]
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            raw, value = (float(cell) for cell in line.split(","))
            rows.append([raw, value])
        except ValueError:
            if rows:
                problems.append(
                    f"{place}.table: {path}, line {number}: found {line!r}; expected two "
                    f"numbers, raw and value"
                )
    return rows


def _flatten(table: Mapping[str, Any]) -> dict[str, Any]:
    """Join the keys of engines, which TOML splits at the dot: ``engine1.thrust``."""
    flat = {}
    for name, entry in table.items():
        engine = isinstance(entry, dict) and name.startswith("engine") and "column" not in entry
        flat.update(
            {f"{name}.{key}": item for key, item in entry.items()} if engine else {name: entry}
        )
    return flat


def _made(kind: type[P]) -> Callable[[dict[str, Any], str], P]:
    return partial(read_plain_table, kind)


def _twice_written(table: Mapping[str, Any]) -> list[str]:
    """Return the names with a dot that stand in a leaf both as one key, in quotes, and as a table
    in a table.
    """
    parts = (
        (name, key) for name, entry in table.items() if isinstance(entry, dict) for key in entry
    )
    return [f"{name}.{key}" for name, key in parts if f"{name}.{key}" in table]


def _part(
    read: Callable[[dict[str, Any], str], T], content: Any, place: str, problems: list[str]
) -> T | None:
    if not isinstance(content, dict):
        problems.append(
            f'{place}: expected a column name or a table such as {{ column = "..." }}; found '
            f"{content!r}"
        )
        return None
    try:
        return read(content, place)
    except SchemaError as error:
        problems += [f"{place}.{problem}" for problem in error.problems]
        return None


def _twice(leaves: dict[str, dict[str, Channel]]) -> list[str]:
    seen: dict[str, str] = {}
    problems = []
    for leaf, channels in leaves.items():
        for name in channels:
            if name in seen:
                problems.append(
                    f"{leaf}.{name}: already in leaf {seen[name]}; a quantity has one channel"
                )
            seen.setdefault(name, leaf)
    return problems


# units of recorders, the SI unit of the vocabulary before the others of its quantity
UNITS = (
    "rad",
    "deg",
    "1",
    "%",
    "rad/s",
    "deg/s",
    "m/s2",
    "g",
    "ft/s2",
    "m/s",
    "kt",
    "ft/s",
    "km/h",
    "ft/min",
    "m",
    "ft",
    "cm",
    "in",
) + (
    *(
        "Pa",
        "hPa",
        "kPa",
        "psf",
        "psi",
        "K",
        "degC",
        "degF",
        "N",
        "lbf",
        "kg",
        "lb",
        "kg/s",
        "kg/h",
        "lb/h",
        "N m",
    ),
)
_EQUAL = 1e-9


def recorder_units(name: str) -> tuple[str, ...]:
    """Return the units of recorders in which a quantity may stand, the SI unit first."""
    dimension = parse_unit(lookup(name).units)[0]
    found = [unit for unit in UNITS if parse_unit(unit)[0] == dimension]
    if dimension == (0, 0, 0, 0):  # angles and fractions
        wanted = ("rad", "deg") if lookup(name).units == "rad" else ("1", "%")
        found = [unit for unit in found if unit in wanted]
    if dimension == (0, 0, -1, 0):
        found = [unit for unit in found if unit in ("rad/s", "deg/s")]
    return tuple(found)


def entry_of(channel: Channel) -> dict[str, Any]:
    """Return the keys of a channel that differ from their defaults, the column first."""
    return channel.stated()


def line_of(name: str, channel: Channel) -> str:
    """Return the line of a name map that states a channel."""
    entry = entry_of(channel)
    key = name if name.startswith("engine") or name.isidentifier() else json.dumps(name)
    if set(entry) == {"column"}:
        return f"{key} = {_toml(entry['column'])}"
    return f"{key} = {{ {', '.join(f'{word} = {_toml(item)}' for word, item in entry.items())} }}"


def correct_channel(
    channel: Channel, name: str, file_unit: str | None, slope: float, shift: float
) -> Channel:
    """Return a channel with a correction of its converted values.

    Parameters
    ----------
    channel : Channel
        As it stands in the name map.
    name : str
        Canonical name.
    file_unit : str or None
        Unit that the file states for the column.
    slope, shift : float
        Corrected value = slope * value + shift. [1, SI]
    """
    units = lookup(name).units
    offset = slope * parse_quantity(channel.offset, units) + shift
    sign = channel.sign if slope > 0.0 else -channel.sign
    if isinstance(channel.scale, str):
        per_one = (
            channel.scale
            if abs(slope) == 1.0
            else f"{abs(slope) * parse_quantity(channel.scale, units):.10g} {units}"
        )
        return channel.changed(sign=sign, scale=per_one, offset=_offset(offset, units))
    unit = known_unit(channel.unit or file_unit or units)
    old_zero = float(to_si(0.0, unit, units))
    offset += slope * channel.sign * channel.scale * old_zero
    wanted = abs(slope) * parse_unit(unit)[1]
    candidates = [unit, *recorder_units(name)]
    new = next(
        (
            one
            for one in candidates
            if abs(parse_unit(one)[1] - wanted) <= _EQUAL * wanted
            and _fits(one, sign, channel, offset)
        ),
        None,
    )
    new = new or next(
        (one for one in candidates if abs(parse_unit(one)[1] - wanted) <= _EQUAL * wanted), None
    )
    scale = channel.scale if new else channel.scale * abs(slope)
    new = new or unit
    offset -= sign * scale * float(to_si(0.0, new, units))
    own = (
        None
        if channel.unit is None and file_unit is not None and known_unit(file_unit) == new
        else new
    )
    return channel.changed(unit=own, sign=sign, scale=scale, offset=_offset(offset, units))


def _fits(unit: str, sign: int, channel: Channel, offset: float) -> bool:
    """Return whether a unit explains the offset too, as that of a temperature scale does."""
    return abs(offset - sign * float(channel.scale) * float(to_si(0.0, unit))) < _EQUAL * max(
        abs(offset), 1.0
    )


def _offset(offset: float, units: str) -> float | str:
    """Return an offset in SI, one of whole g as such."""
    if abs(offset) < _EQUAL:
        return 0.0
    in_g = offset / G0
    return (
        f"{round(in_g)} g"
        if units == "m s-2" and abs(in_g - round(in_g)) < _EQUAL
        else float(f"{offset:.10g}")
    )


def _toml(item: Any) -> str:
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_toml, item))}]"
    if isinstance(item, bool):
        return "true" if item else "false"
    return (
        json.dumps(item, ensure_ascii=False)
        if isinstance(item, str)
        else f"{item:.10g}"
        if isinstance(item, float)
        else str(item)
    )
