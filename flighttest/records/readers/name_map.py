"""Name maps, which relate the columns of a file to the quantities of the vocabulary.

A map states unit, sign, scale and clock of each column.  It is a TOML file.  Every table is a leaf
of the record (channels of one time base), every key in it a canonical name::

    # A shipped map, or another file.  Entries of this file replace its entries.
    extends = "px4"
    # Facts that the file does not state, optional.
    [record]
    latitude = "45 deg"
    # Constant channels that no column shows.
    [constants]
    delta_f = "0 deg"
    # Instruments of this recorder, as in the aircraft file.  They replace its table of that name.
    [instruments.boom]
    position = [4.1, 0.0, 0.1]
    # The clock; [time.NAME] for one table (group, topic) of the file.
    [time]
    column = "t"
    # Column name alone: the unit is in the file.
    [imu]
    q = "pitch_rate"
    az_imu = { column = "acc/nz", unit = "g", sign = -1 }
    [controls]
    delta_f = { column = "flap", scale = "40 deg" }
    delta_e = { column = "pot_3", unit = "deg", polynomial = [-12.1, 0.0321, 1.2e-6] }
    delta_r = { column = "pot_5", unit = "deg", table = [[112, -25], [530, 0], [980, 25]] }
    # Words of a bus or frame, see flighttest.records.readers.bus_words.
    [decode.adc]

A channel is ``sign * scale * column + offset`` after calibration and change of unit.

- `polynomial` (ascending powers of the raw column) or `table` (raw, value) give the value in
  `unit`.  The table is linear between its rows; beyond them the value is NaN and flagged.
- A `scale` with a unit (``"40 deg"`` per one of the column) replaces the change of unit.
- `column` may be a list.  The first column that the file has is read.
- `optional = true` omits a channel if the file has no such column.
- `delay` is a known latency: the channel shows at t the value that was true at t - delay.
- `lag` is a known time constant: the channel follows the true value as a first-order lag.  A
  negative lag converts a recorded command to the position of an actuator that follows it with that
  time constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.errors import SchemaError, UnitError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import Above, InUnits
from flightmech.units import fitted_unit, parse_unit, to_si
from flighttest.records.readers.bus_words import Arinc429, Decode
from flighttest.records.sensors.instruments import (
    LONGEST_DELAY,
    LONGEST_LAG,
    Instrument,
    demand_possible_time,
)

TOP = ("extends", "optional", "time", "record", "constants", "instruments", "utc", "decode")


class _Table(Strict):
    """A table of a name map."""

    # nan and inf are answered with the name of the quantity when the file is resolved
    model_config = ConfigDict(allow_inf_nan=True)

    def changed(self, **values: Any) -> Self:
        """Return a copy with other values, which are validated."""
        return type(self)(**{**dict(self), **values})

    def stated(self) -> dict[str, Any]:
        """Return the values that differ from their defaults, by name."""
        return self.model_dump(exclude_defaults=True)


class Channel(_Table):
    """Where a channel comes from and how it becomes SI."""

    column: str | tuple[str, ...] = Field(
        description="Column of the file, TABLE/COLUMN where there are several tables; of a list "
        "the first that the file holds."
    )
    unit: str | None = Field(
        default=None,
        description="Unit of the column, where the file does not state it or states another.",
    )
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where the recorder's positive sense is the opposite one."
    )
    scale: float | str = Field(
        default=1.0,
        description='Factor of the column; with a unit ("40 deg") it replaces the change of unit.',
    )
    offset: float | str = Field(default=0.0, description="Added last: SI, or with its unit.")
    polynomial: tuple[float, ...] | None = Field(
        default=None,
        examples=[[-12.1, 0.0321, 1.2e-06]],
        description="Calibration: coefficients of the raw column by ascending power, giving the "
        "value in unit.",
    )
    table: tuple[tuple[float, float], ...] | None = Field(
        default=None,
        examples=[[[112, -25], [530, 0], [980, 25]]],
        description="Calibration: rows [raw, value] in unit, or a CSV file of two columns; linear "
        "between, NaN and flagged beyond.",
    )
    missing: tuple[float, ...] | None = Field(
        default=None,
        examples=[[-999, 9999]],
        description="Raw numbers that are missing values; without it -999, 9999 and the like.",
    )
    delay: Annotated[float, InUnits("s")] = Field(
        default=0.0,
        examples=["60 ms"],
        description="Known latency: the channel shows at t what was true at t - delay.",
    )
    lag: Annotated[float, InUnits("s")] = Field(
        default=0.0,
        examples=["-0.05 s"],
        description="Known time constant of a first-order lag behind the truth; negative: of a "
        "command, that of the actuator.",
    )
    rate_limit: float | str | None = Field(
        default=None,
        examples=["300 deg/s"],
        description="Of a command: the highest rate of its actuator, in SI or with its unit.",
    )
    stops: tuple[float | str, float | str] | None = Field(
        default=None,
        examples=[["-25 deg", "20 deg"]],
        description="Of a command: lowest and highest position of its actuator.",
    )
    optional: bool = Field(
        default=False,
        description="Whether the channel is left out where the file has no such column.",
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns in the order of the search."""
        if isinstance(self.column, str):
            return (self.column,)
        return self.column

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        """Raise ValueError for impossible times, and limits that do not belong to a command."""
        demand_possible_time("delay", self.delay, LONGEST_DELAY)
        demand_possible_time("lag", self.lag, LONGEST_LAG)
        if (self.rate_limit is not None or self.stops is not None) and self.lag > 0.0:
            raise ValueError(
                f"rate_limit and stops belong to an actuator behind a recorded command: its "
                f"lag is negative or zero; lag is {self.lag:g} s"
            )
        return self

    def limits(self, name: str) -> tuple[float, tuple[float, float]] | None:
        """Return rate limit and stops of the actuator behind a command [SI]; None without one.

        Raises
        ------
        UnitError
            A unit does not fit the channel `name`.
        SchemaError
            The rate is not positive, or the stops are in the wrong order.
        """
        if self.rate_limit is None and self.stops is None:
            return None
        units = lookup(name).units
        rate, low, high = math.inf, -math.inf, math.inf
        if self.rate_limit is not None:
            rate = parse_quantity(self.rate_limit, f"{units} s-1")
        if self.stops is not None:
            low, high = (parse_quantity(stop, units) for stop in self.stops)
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
        """Return the values of the column in the SI unit of a canonical name.

        Values beyond a calibration table are NaN.
        """
        units = lookup(name).units
        offset = parse_quantity(self.offset, units)
        values = self._calibrate(values)
        if isinstance(self.scale, str):
            factor = self.sign * parse_quantity(self.scale, units)
            return _scale_and_shift(values, factor, offset)
        unit = self.unit or file_unit
        if unit is None:
            raise UnitError(
                f'column {self.columns[0]!r} has no unit in the file; give unit = "..." for '
                f"{name} in the name map (expected {units})"
            )
        # A load factor counts in g, and has no dimension.
        if name == "nz" and unit == "g":
            unit = units
        # A unit such as degC has a zero point besides its factor.
        unit = fitted_unit(unit, units)
        zero = float(to_si(0.0, unit, units))
        factor = parse_unit(unit)[1]
        return _scale_and_shift(
            values, self.sign * self.scale * factor, self.sign * self.scale * zero + offset
        )

    def _calibrate(self, values):
        """Return the values of the calibration, in the unit of the channel."""
        if self.polynomial is not None:
            return np.polynomial.polynomial.polyval(values, self.polynomial)
        if self.table is not None:
            raw, value = np.array(sorted(self.table)).T
            return np.interp(values, raw, value, left=np.nan, right=np.nan)
        return values

    def calibration(self, file_unit: str | None, column: str | None = None) -> str:
        """Return a description of the conversion by `convert`."""
        parts = []
        if self.sign < 0:
            parts.append("-")
        if self.scale != 1.0:
            parts.append(f"{self.scale} *")
        source = column or self.columns[0]
        if self.polynomial is not None:
            source = f"polynomial {list(self.polynomial)} of {source}"
        elif self.table is not None:
            source = (
                f"table of {len(self.table)} points, {self.table[0]} to {self.table[-1]}, "
                f"of {source}"
            )
        parts.append(source)
        if not isinstance(self.scale, str):
            parts.append(f"[{self.unit or file_unit}]")
        if self.offset != 0.0:
            parts.append(f"+ {self.offset}")
        return " ".join(part for part in parts if part)


def _scale_and_shift(values, factor: float, offset: float):
    """Return factor * values + offset."""
    # A factor of 1 and an offset of 0 need no pass over the data.
    if factor != 1.0:
        values = factor * values
    if offset != 0.0:
        values = values + offset
    return values


def latitude_problem(latitude: float) -> str:
    """Return why a latitude [rad] does not exist on the Earth; empty if it does.

    Degrees without their unit are taken as radians, and their sine is gravity elsewhere.
    """
    if abs(latitude) <= 0.5 * math.pi:
        return ""
    text = (
        f"latitude {latitude:.6g} rad is {math.degrees(latitude):.6g} deg; a latitude is from -90 "
        f"to 90 deg"
    )
    # Up to 360 deg the number had a unit, or it is a latitude near the equator.
    if abs(latitude) <= 2.0 * math.pi:
        return f"{text}; correct it"
    return f"{text}, and a number without a unit is in rad: write '{latitude:.6g} deg' for degrees"


class Facts(_Table):
    """Facts about a record that its file may not state."""

    title: str | None = Field(
        default=None, examples=["Flight 12, clean, 5000 ft"], description="Title of the record."
    )
    start: str | None = Field(
        default=None,
        examples=["2024-05-17T09:30:00Z"],
        description="Start of the record in the time of the world.",
    )
    purpose: str | None = Field(
        default=None,
        examples=["stability and control"],
        description="What the record was flown for.",
    )
    latitude: Annotated[float, InUnits("rad")] | None = Field(
        default=None, description="Latitude of the flight; gives gravity and the rate of the Earth."
    )
    runway_elevation: Annotated[float, InUnits("m")] | None = Field(
        default=None, examples=["120 m"], description="Elevation of the runway over mean sea level."
    )
    temperature: Annotated[float, InUnits("K"), Above(100.0)] | None = Field(
        default=None,
        examples=["12 degC"],
        description="Constant temperature of the outside air, where none is recorded.",
    )
    wind_down_sigma: Annotated[float, InUnits("m s-1"), Above(0.0)] | None = Field(
        default=None,
        examples=[0.2],
        description="Standard error of the mean vertical wind before the reconstruction.",
    )

    @field_validator("latitude")
    @classmethod
    def _check_latitude(cls, latitude: float | None) -> float | None:
        """Raise ValueError for a latitude beyond the poles."""
        problem = "" if latitude is None else latitude_problem(latitude)
        if problem:
            raise ValueError(problem)
        return latitude


class Clock(_Table):
    """The clock of a file or of one of its tables.

    `column` holds the stamps in `unit`.  The default is the unit that the file states, else
    seconds.  A counter that starts again after `wrap` is unrolled.

    `rate` makes even stamps from the first stamp on.  It serves files that state only a sampling
    rate, or stamps too coarse for their samples.

    The clock runs fast by `drift` seconds per second, counted from its first stamp; for the tables
    of one clock from the earliest of theirs.  `offset` is added last and converts the clock to the
    clock of the record.  With `reset = true`, samples
    after a backward step are moved behind the samples before it.
    """

    column: str | None = Field(
        default=None, examples=["adc/time"], description="Column of the stamps."
    )
    unit: str | None = Field(
        default=None,
        examples=["us"],
        description="Unit of the stamps, us and ns as well; the file's own without it, else s.",
    )
    wrap: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["65.536 s"],
        description="Where a counter starts again; it is unrolled.",
    )
    rate: Annotated[float, InUnits("Hz")] | None = Field(
        default=None,
        examples=["50 Hz"],
        description="Sampling rate: even stamps from the first one on.",
    )
    offset: Annotated[float, InUnits("s")] = Field(
        default=0.0,
        examples=["0.12 s"],
        description="Added last; brings the clock onto that of the record.",
    )
    drift: float = Field(
        default=0.0, examples=[2e-05], description="Seconds that the clock runs fast per second."
    )
    reset: bool = Field(
        default=False,
        examples=[True],
        description="Whether what follows a backward step is moved behind what went before.",
    )

    def seconds(self, file_unit: str | None) -> float:
        """Return the seconds in one unit of the column of stamps."""
        return float(to_si(1.0, self.unit or file_unit or "s", "s"))


class Utc(_Table):
    """A column of coordinated universal time.

    It gives the start of the record and the drift of its clock.  `epoch` is the origin of the
    column: ``unix`` (1970-01-01, UTC) or ``gps`` (1980-01-06, ahead of UTC by `leap_seconds`).
    """

    column: str = Field(
        examples=["gps/utc"], description="Column with the time of day of the world."
    )
    unit: str = Field(default="s", description="Its unit.")
    epoch: Literal["unix", "gps"] = Field(
        default="unix",
        description="What it counts from: 1970-01-01 (unix), or 1980-01-06 without leap seconds "
        "(gps).",
    )
    leap_seconds: int = Field(
        default=18, examples=[18], description="By which gps is ahead of UTC."
    )
    optional: bool = Field(
        default=False, description="Whether it is left out where the file has no such column."
    )


@dataclass(frozen=True)
class NameMap(ShortText):
    """A name map.

    Attributes
    ----------
    leaves : dict of str to dict of str to Channel
        Leaf -> canonical name -> channel.
    clock : Clock
        Clock of all tables that have no entry in `clocks`.
    facts : Facts
    source : str
        File of the map.
    clocks : dict of str to Clock
        By the table of the file.
    utc : Utc or None
    decode : dict of str to Decode
        Parameters in the words of buses and frames.
    constants : dict of str to float
        Values of channels that no column shows. [SI]
    instruments : dict of str to Instrument
        They replace the instruments of that name in the aircraft file.
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
