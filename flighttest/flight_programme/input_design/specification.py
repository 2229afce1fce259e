"""The design of a test input as a TOML file: what moves, in which flight, inside which limits, for
which model.

    title = "Three axes, clean, 175 kt"
    kind = "multisine"                  # or "multistep", "sweep"
    period = "30 s"                     # multisine
    band = ["0.1 Hz", "2 Hz"]           # for all axes that do not specify otherwise
    exclude = [["1.0 Hz", "1.1 Hz"]]
    lead_in = "1 s"

    [axis.delta_e]
    amplitude = "3 deg"
    rate_limit = "40 deg/s"             # of the actuator: a multisine or sweep is made smaller to stay below it
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

A multistep names per axis ``pattern`` (or ``widths``) and ``step`` (or ``omega``, the natural
frequency of the mode), ``rise``, ``free``; a sweep ``band``, ``duration``, ``law``.  Multisteps and
sweeps of several axes follow each other, ``pause`` apart.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import xarray as xr
from pydantic import Field, field_validator, model_validator

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import parse_quantity
from flighttest.flight_programme.input_design.input_shapes import (
    PATTERNS,
    InputAxis,
    in_sequence,
    multisine,
    multistep,
    sweep,
    unit_step,
)
from flighttest.flight_programme.input_design.input_signals import LEAD_IN, RATE, measures
from flighttest.flight_programme.input_design.predicted_response import scale_signal

_Time = Annotated[float, InUnits("s")]
_Frequency = Annotated[float, InUnits("Hz")]
_Band = tuple[_Frequency, _Frequency]


class AxisTable(Strict):
    """One axis; which keys it takes depends on the kind."""

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
    """The flight in which the input is played, and its limits."""

    kind: str = "level"
    fixed: dict[str, float] = Field(default_factory=dict)
    unknowns: tuple[str, ...] | None = None
    limits: dict[str, tuple[float, float]] = Field(default_factory=dict)
    margin: float = Field(default=1.0, gt=0.0, le=1.0)

    @field_validator("fixed", mode="before")
    @classmethod
    def _fixed_in_si(cls, table: Any) -> Any:
        return (
            {name: _si(name, item) for name, item in table.items()}
            if isinstance(table, dict)
            else table
        )

    @field_validator("limits", mode="before")
    @classmethod
    def _limits_in_si(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        for name, pair in table.items():
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError(f"{name}: expected [lowest, highest]")
        return {name: tuple(_si(name, item) for item in pair) for name, pair in table.items()}


class AccuracyTable(Strict):
    """Whose terms are to be determined, and against what noise."""

    models: tuple[str, ...] = ()
    noise: dict[str, float] = Field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    nuisance: tuple[str, ...] = ()
    outputs: dict[str, float] = Field(default_factory=dict)
    memory: _Time = 0.0

    @field_validator("outputs", mode="before")
    @classmethod
    def _outputs_in_si(cls, table: Any) -> Any:
        return (
            {name: _si(name, item) for name, item in table.items()}
            if isinstance(table, dict)
            else table
        )

    @model_validator(mode="after")
    def _whole(self) -> AccuracyTable:
        if bool(self.parameters) != bool(self.outputs):
            raise ValueError(
                "parameters and outputs belong together: what is estimated, and the noise of "
                "what is compared"
            )
        return self


class Design(Strict):
    """A test input, its condition and its purpose."""

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
        changed = {}
        for name, table in axes.items():
            units = {"amplitude": "", "rate_limit": " s-1"}
            known = units.keys() & table.keys() if isinstance(table, dict) else set()
            changed[name] = (
                {**table, **{key: _si(name, table[key], units[key]) for key in known}}
                if known
                else table
            )
        return changed

    def signal(self) -> xr.Dataset:
        """Return the test input.

        Raises
        ------
        SchemaError
            Keys that the kind needs and that are missing, or a fault that `multisine`, `multistep`
            or `sweep` finds.
        """
        if problems := self._missing():
            raise SchemaError(f"design of a {self.kind}", problems)
        if self.kind == "multisine":
            axes = {name: self._multisine_axis(table) for name, table in self.axis.items()}
            return self._slow_enough(
                multisine(
                    axes,
                    float(self.period or 0.0),
                    self.rate,
                    self.lead_in,
                    self.repeats,
                    self.seed,
                )
            )
        make = self._multistep if self.kind == "multistep" else self._sweep
        return self._slow_enough(
            in_sequence(
                [make(name, table) for name, table in self.axis.items()] * self.repeats, self.pause
            )
        )

    def _slow_enough(self, signal: xr.Dataset) -> xr.Dataset:
        """The input with axes made smaller where they would outrun their actuator; edges of steps
        are made longer by hand.
        """
        rates = measures(signal)["rate"]
        limits = {
            name: table.rate_limit
            for name, table in self.axis.items()
            if table.rate_limit is not None
        }
        factors = {
            name: limit / rates[name] for name, limit in limits.items() if rates[name] > limit
        }
        if factors and self.kind == "multistep":
            lines = [
                f"axis.{name}: edges of {rates[name]:.3g} per second, rate_limit "
                f"{limits[name]:.3g}; lengthen rise"
                for name in factors
            ]
            raise SchemaError("design of a multistep", lines)
        return scale_signal(signal, factors)

    def _missing(self) -> list[str]:
        problems = []
        if self.kind == "multisine" and self.period is None:
            problems.append("period: missing; give it")
        for name, table in self.axis.items():
            if self.kind == "multistep":
                if bool(table.pattern) == bool(table.widths):
                    problems.append(f"axis.{name}: give pattern or widths, one of them")
                if (table.step is None) == (table.omega is None):
                    problems.append(f"axis.{name}: give step or omega, one of them")
                if table.omega is not None and not table.pattern:
                    problems.append(
                        f"axis.{name}: omega goes with a pattern; give step with widths"
                    )
            elif not table.harmonics and table.band is None and self.band is None:
                problems.append(f"axis.{name}.band: missing; give it here or for all axes")
            if self.kind == "sweep" and table.duration is None:
                problems.append(f"axis.{name}.duration: missing; give it")
        return problems

    def _multisine_axis(self, table: AxisTable) -> InputAxis:
        band = table.band or self.band or (0.0, 0.0)
        exclude = self.exclude if table.exclude is None else table.exclude
        return InputAxis(table.amplitude, band, exclude, dict(table.spectrum), table.harmonics)

    def _multistep(self, name: str, table: AxisTable) -> xr.Dataset:
        step = (
            float(table.step)
            if table.step is not None
            else unit_step(str(table.pattern), float(table.omega or 0.0))
        )
        widths = PATTERNS[table.pattern] if table.pattern else table.widths
        return multistep(
            name, table.amplitude, step, widths, self.rate, self.lead_in, table.rise, table.free
        )

    def _sweep(self, name: str, table: AxisTable) -> xr.Dataset:
        band = table.band or self.band or (0.0, 0.0)
        return sweep(
            name,
            table.amplitude,
            band,
            float(table.duration or 0.0),
            self.rate,
            self.lead_in,
            table.law,
        )


def read_design(path: str | os.PathLike) -> Design:
    """Return the design of a test input from a TOML file.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        Every unknown key, missing value and wrong unit.
    """
    return design_of(read_toml(os.fspath(path)), os.fspath(path))


def design_of(content: Mapping[str, Any], what: str = "design") -> Design:
    """Return the design of a test input from the content of such a file; errors as in
    `read_design`.
    """
    return validate_content(Design, dict(content), what)


def _si(name: str, item: Any, per: str = "") -> float:
    """Return a quantity by name in SI, or its rate; ``applied.delta_e`` and ``engine1.failed`` are
    known as well.
    """
    try:
        units = lookup(name.removeprefix("applied.")).units
    except UnknownName:
        units = "1"
    try:
        return parse_quantity(item, units + per)
    except UnitError as error:
        raise ValueError(f"{name}: {error}") from error
