"""Specification of a test input as a TOML file.

It has the axes that move, the flight, the limits of the response, and the models.

    title = "Three axes, clean, 175 kt"
    kind = "multisine"                  # or "multistep", "sweep"
    period = "30 s"                     # multisine
    band = ["0.1 Hz", "2 Hz"]           # for all axes without a band of their own
    exclude = [["1.0 Hz", "1.1 Hz"]]
    lead_in = "1 s"

    [axis.delta_e]
    amplitude = "3 deg"
    rate_limit = "40 deg/s"             # of the actuator; a multisine or sweep is scaled down to it
    [axis.delta_a]
    amplitude = "4 deg"
    spectrum = [["0.1 Hz", 4.0], ["2 Hz", 1.0]]

    [condition]                         # needs the aircraft and its a-priori database
    kind = "level"
    fixed = { V = "175 kt", h = "5000 ft" }
    margin = 0.7
    [condition.limits]
    alpha = ["-2 deg", "10 deg"]
    nz = [0.3, 1.8]

    [accuracy]
    models = ["CL = 1 + alpha + qhat + delta_e"]
    memory = "0.3 s"

A multistep has per axis ``pattern`` (or ``widths``) and ``step`` (or ``omega``, the natural
frequency of the mode), ``rise`` and ``free``.  A sweep has ``band``, ``duration`` and ``law``.
Multisteps and sweeps of several axes follow each other with a ``pause`` between them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import xarray as xr
from pydantic import Field, field_validator, model_validator

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flighttest.flight_programme.input_design.input_shapes import (
    PATTERNS,
    in_sequence,
    multistep,
    sweep,
    unit_step,
)
from flighttest.flight_programme.input_design.input_signals import LEAD_IN, RATE, measures
from flighttest.flight_programme.input_design.multisines import InputAxis, multisine
from flighttest.flight_programme.input_design.predicted_response import scale_signal

_Time = Annotated[float, InUnits("s")]
_Frequency = Annotated[float, InUnits("Hz")]
_Band = tuple[_Frequency, _Frequency]
# Keys of an axis with a unit of the axis, and what follows this unit.
_AXIS_UNITS = {"amplitude": "", "rate_limit": " s-1"}


class AxisTable(Strict):
    """One axis; the kind of the input determines which keys it has."""

    amplitude: float
    rate_limit: float | None = None
    band: _Band | None = None
    exclude: tuple[_Band, ...] | None = None
    spectrum: tuple[tuple[_Frequency, float], ...] = ()
    harmonics: tuple[int, ...] = ()
    pattern: Literal["doublet", "1-2-1", "3-2-1-1"] | None = None
    widths: tuple[float, ...] = ()
    step: _Time | None = None
    omega: Annotated[float, InUnits("rad s-1")] | None = None
    rise: _Time = 0.0
    free: _Time = 0.0
    duration: _Time | None = None
    law: Literal["logarithmic", "linear"] = "logarithmic"


class ConditionTable(Strict):
    """The flight in which the input is played, and the limits of the response."""

    kind: str = "level"
    fixed: dict[str, float] = Field(default_factory=dict)
    unknowns: tuple[str, ...] | None = None
    limits: dict[str, tuple[float, float]] = Field(default_factory=dict)
    margin: float = Field(default=1.0, gt=0.0, le=1.0)

    @field_validator("fixed", mode="before")
    @classmethod
    def _fixed_in_si(cls, table: Any) -> Any:
        return _table_in_si(table)

    @field_validator("limits", mode="before")
    @classmethod
    def _limits_in_si(cls, table: Any) -> Any:
        # a value of another type is reported by the validation of the field
        if not isinstance(table, dict):
            return table
        limits = {}
        for name, pair in table.items():
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError(f"{name}: expected [lowest, highest]")
        for name, (low, high) in table.items():
            limits[name] = (_si(name, low), _si(name, high))
        return limits


class AccuracyTable(Strict):
    """Models whose terms the input has to determine, and the noise of the record."""

    models: tuple[str, ...] = ()
    noise: dict[str, float] = Field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    nuisance: tuple[str, ...] = ()
    outputs: dict[str, float] = Field(default_factory=dict)
    memory: _Time = 0.0

    @field_validator("outputs", mode="before")
    @classmethod
    def _outputs_in_si(cls, table: Any) -> Any:
        return _table_in_si(table)

    @model_validator(mode="after")
    def _check_pairs(self) -> AccuracyTable:
        if bool(self.parameters) != bool(self.outputs):
            raise ValueError(
                "parameters and outputs belong together: give the estimated parameters, and the "
                "noise of the compared outputs"
            )
        return self


class Design(Strict):
    """A test input, its condition and its required accuracy."""

    title: str = ""
    kind: Literal["multisine", "multistep", "sweep"]
    axis: dict[str, AxisTable] = Field(min_length=1)
    period: _Time | None = None
    band: _Band | None = None
    exclude: tuple[_Band, ...] = ()
    rate: _Frequency = RATE
    lead_in: _Time = LEAD_IN
    repeats: int = Field(default=1, ge=1)
    seed: int = 0
    pause: _Time = 0.0
    condition: ConditionTable | None = None
    accuracy: AccuracyTable | None = None

    @field_validator("axis", mode="before")
    @classmethod
    def _amplitudes_in_si(cls, axes: Any) -> Any:
        if not isinstance(axes, dict):
            return axes
        return {name: _amplitudes_in_si(name, table) for name, table in axes.items()}

    def signal(self) -> xr.Dataset:
        """Return the test input.

        Raises
        ------
        SchemaError
            A key that the kind needs is missing, or `multisine`, `multistep` or `sweep` raises.
        """
        problems = self._missing()
        if problems:
            raise SchemaError(f"design of a {self.kind}", problems)
        return self._limit_rates(self._make_signal())

    def _make_signal(self) -> xr.Dataset:
        if self.kind == "multisine":
            return multisine(
                {name: self._multisine_axis(table) for name, table in self.axis.items()},
                period=float(self.period or 0.0),
                rate=self.rate,
                lead_in=self.lead_in,
                repeats=self.repeats,
                seed=self.seed,
            )
        signals = []
        for name, table in self.axis.items():
            if self.kind == "multistep":
                signals.append(self._multistep(name, table))
            else:
                signals.append(self._sweep(name, table))
        return in_sequence(signals * self.repeats, self.pause)

    def _limit_rates(self, signal: xr.Dataset) -> xr.Dataset:
        """Return the input with the axes that are faster than their actuator made smaller.

        The edges of a multistep have to be made longer by its author.
        """
        rates = measures(signal)["rate"]
        factors, problems = {}, []
        for name, table in self.axis.items():
            limit = table.rate_limit
            if limit is None or not rates[name] > limit:
                continue
            factors[name] = limit / rates[name]
            problems.append(
                f"axis.{name}: edges of {rates[name]:.3g} per second, rate_limit {limit:.3g}; "
                "lengthen rise"
            )
        if problems and self.kind == "multistep":
            raise SchemaError("design of a multistep", problems)
        return scale_signal(signal, factors)

    def _missing(self) -> list[str]:
        """Return the faults of keys that the kind of the input needs."""
        problems = []
        if self.kind == "multisine" and self.period is None:
            problems.append("period: missing; give it")
        for name, table in self.axis.items():
            if self.kind == "multistep":
                problems += _multistep_faults(name, table)
            elif not table.harmonics and table.band is None and self.band is None:
                problems.append(f"axis.{name}.band: missing; give it here or for all axes")
            if self.kind == "sweep" and table.duration is None:
                problems.append(f"axis.{name}.duration: missing; give it")
        return problems

    def _band(self, table: AxisTable) -> tuple[float, float]:
        return table.band or self.band or (0.0, 0.0)

    def _multisine_axis(self, table: AxisTable) -> InputAxis:
        # an empty list of an axis removes the excluded bands of all axes
        exclude = table.exclude
        if exclude is None:
            exclude = self.exclude
        return InputAxis(
            table.amplitude,
            self._band(table),
            exclude=exclude,
            spectrum=dict(table.spectrum),
            harmonics=table.harmonics,
        )

    def _multistep(self, name: str, table: AxisTable) -> xr.Dataset:
        if table.step is not None:
            step = float(table.step)
        else:
            step = unit_step(str(table.pattern), float(table.omega or 0.0))
        widths: Sequence[float] = table.widths
        if table.pattern:
            widths = PATTERNS[table.pattern]
        return multistep(
            name,
            table.amplitude,
            step=step,
            widths=widths,
            rate=self.rate,
            lead_in=self.lead_in,
            rise=table.rise,
            free=table.free,
        )

    def _sweep(self, name: str, table: AxisTable) -> xr.Dataset:
        return sweep(
            name,
            table.amplitude,
            band=self._band(table),
            duration=float(table.duration or 0.0),
            rate=self.rate,
            lead_in=self.lead_in,
            law=table.law,
        )


def _multistep_faults(name: str, table: AxisTable) -> list[str]:
    problems = []
    if bool(table.pattern) == bool(table.widths):
        problems.append(f"axis.{name}: give pattern or widths, one of them")
    if (table.step is None) == (table.omega is None):
        problems.append(f"axis.{name}: give step or omega, one of them")
    if table.omega is not None and not table.pattern:
        problems.append(f"axis.{name}: omega needs a pattern; give step with widths")
    return problems


def read_design(path: str | os.PathLike) -> Design:
    """Return the design of a test input from a TOML file.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        Every unknown key, missing value and wrong unit.
    """
    return design_of(read_toml(os.fspath(path)), os.fspath(path))


def design_of(content: Mapping[str, Any], what: str = "design") -> Design:
    """Return the design of a test input from the content of its file.

    The errors are those of `read_design`.
    """
    return validate_content(Design, dict(content), what)


def _table_in_si(table: Any) -> Any:
    """Return a table of quantities in SI; a value of another type is reported by its field."""
    if not isinstance(table, dict):
        return table
    return {name: _si(name, item) for name, item in table.items()}


def _amplitudes_in_si(name: str, table: Any) -> Any:
    """Return the table of one axis with amplitude and rate limit in SI."""
    if not isinstance(table, dict):
        return table
    converted = dict(table)
    for key, per in _AXIS_UNITS.items():
        if key in table:
            converted[key] = _si(name, table[key], per)
    return converted


def _si(name: str, item: Any, per: str = "") -> float:
    """Return a quantity by name in SI, or its rate.

    Names of outputs such as ``applied.delta_e`` have the unit of their quantity. Names that are not
    quantities, such as ``engine1.failed``, have no unit.
    """
    try:
        units = lookup(name.removeprefix("applied.")).units
    except UnknownName:
        units = "1"
    try:
        return parse_quantity(item, units + per)
    except UnitError as error:
        raise ValueError(f"{name}: {error}") from error
