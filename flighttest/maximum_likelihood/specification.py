"""Output-error fit as a TOML file: model, records, outputs and unknowns.

title = "Citation II, short period"
aircraft = "citation.toml"          # files are relative to this one
database = "prior.nc"
outputs = ["alpha", "q", "theta", "az"]
constraints = ["term.Cm.qhat = 0.8*term.Cm.basic"]   # optional; numbers in SI
noise = "common"                    # or "own": a noise variance per record

[process_noise]                     # turbulence: filter error in place of output error
kind = "gusts"                      # none, process, gusts or both
angle = "vane"                      # or "inertial": source of V, alpha and beta in the records
scale = "150 m"                     # of the gusts; default: estimated

[conditions]                        # fixed values of all records; numbers in SI, texts with unit
delta_f = "0 deg"

# a path as `flight reconstruct` or `flight report --save` writes it
[[record]]
file = "path_short_period.nc"
window = [3634.0, 3645.0]
[record.conditions]
"init.h" = 1500.0

# any parameter of the model, sensor.* and factor.* of an output; with process noise also
# process.*, noise.*, gust.* and scale.*
[parameter."term.Cm.basic"]
start = 1.0                         # default: first sample of the record, or value of the model
sigma = 0.3                         # a-priori standard error; default: infinite
low = 0.2
high = 3.0
own = false                         # whether every record has a separate value
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import xarray as xr
from pydantic import Field

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.quantities import parse_quantity
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER, Simulation
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flighttest.maximum_likelihood.nonlinear.disturbances import (
    GUST_NAMES,
    START_INTENSITY,
    START_SCALE,
    Disturbances,
    choose_disturbances,
)
from flighttest.maximum_likelihood.nonlinear.kernel_flights import COORDINATES
from flighttest.maximum_likelihood.unknowns import Unknown
from flighttest.records.repeated_windows import repeated_windows

_Number = float | str
# Standard error and bounds of an unknown may be infinite: those are the defaults.
_Unbounded = Annotated[float, Field(allow_inf_nan=True)] | str
_AS_RECORDED = "init"  # parameters whose start is the first sample of the record

# unit and start value of a parameter; None if the record gives the start
Entry = tuple[str, float | None]


class RecordTable(Strict):
    """One manoeuvre."""

    file: Path
    window: tuple[float, float] | None = None
    conditions: dict[str, _Number] = Field(default_factory=dict)


class ParameterTable(Strict):
    """One unknown."""

    start: _Number | None = None
    sigma: _Unbounded = math.inf
    low: _Unbounded = -math.inf
    high: _Unbounded = math.inf
    own: bool = False


class ProcessNoiseTable(Strict):
    """Disturbance of the motion."""

    kind: Literal["none", "process", "gusts", "both"] = "none"
    angle: Literal["", "vane", "inertial"] = ""
    scale: _Number | None = None

    @property
    def needs_angle(self) -> bool:
        """Whether gusts lack the source of the angles."""
        return self.kind in ("gusts", "both") and not self.angle


class Specification(Strict):
    """A fit by output error, or by filter error with process noise."""

    title: str = ""
    aircraft: Path
    database: Path
    outputs: tuple[str, ...] = Field(min_length=1)
    noise: Literal["common", "own"] = "common"
    iterations: int = Field(default=50, ge=1)
    constraints: tuple[str, ...] = ()
    process_noise: ProcessNoiseTable = Field(default_factory=ProcessNoiseTable)
    conditions: dict[str, _Number] = Field(default_factory=dict)
    record: tuple[RecordTable, ...] = Field(min_length=1)
    parameter: dict[str, ParameterTable] = Field(min_length=1)

    def unknowns(self, sim: SimModel) -> dict[str, Unknown]:
        """Return the unknowns in SI.

        Raises
        ------
        SchemaError
            Wrong units and texts that are not a quantity. One error lists all of them.
        """
        entries = _list_entries(sim)
        problems: list[str] = []
        unknowns = {}
        for name, table in self.parameter.items():
            # Parts of tables, such as node.CL.basic[3], are in no catalogue.
            units, nominal = entries.get(name) or ("1", _table_value(sim, name))
            if name not in entries and nominal is None:
                expected = "a parameter of the model, sensor.* or factor.*"
                problems.append(str(UnknownName(name, entries, "parameter", expected)))
                continue
            try:
                start = nominal
                if table.start is not None:
                    start = parse_quantity(table.start, units)
                unknowns[name] = Unknown(
                    start=start,
                    sigma=parse_quantity(table.sigma, units),
                    low=parse_quantity(table.low, units),
                    high=parse_quantity(table.high, units),
                    own=table.own,
                )
            except UnitError as error:
                problems.append(f"parameter {name}: {error}")
        if problems:
            raise SchemaError("fit", problems)
        return unknowns

    def with_process_noise(
        self, kind: str | None, angle: str | None, scale: float | None
    ) -> Specification:
        """Return the fit with another disturbance; None keeps what the file states."""
        given = {"kind": kind, "angle": angle, "scale": scale}
        changed = {name: value for name, value in given.items() if value is not None}
        table = self.process_noise.model_copy(update=changed)
        return self.model_copy(update={"process_noise": table})

    def disturbances(self, records: Sequence[xr.Dataset]) -> Disturbances:
        """Return the disturbances of the motion.

        Raises
        ------
        SchemaError
            Gusts without the source of the angles, a scale that is not a positive length.
        UnknownName
            A signal that a record does not have.
        """
        table = self.process_noise
        try:
            scale = None if table.scale is None else parse_quantity(table.scale, "m")
            return choose_disturbances(
                table.kind, records, self.outputs, angle=table.angle, scale=scale
            )
        except (UnitError, ValueError) as error:
            raise SchemaError("process_noise", [str(error)]) from None

    def fixed_conditions(self, sim: SimModel) -> list[dict[str, float]]:
        """Return the conditions of each record in SI; errors as `unknowns`."""
        entries = _list_entries(sim)
        problems: list[str] = []
        fixed = []
        for table in self.record:
            values = _convert_conditions(self.conditions, entries, problems)
            fixed.append(values | _convert_conditions(table.conditions, entries, problems))
        if problems:
            raise SchemaError("fit", list(dict.fromkeys(problems)))
        return fixed


def _convert_conditions(
    table: Mapping[str, _Number], entries: Mapping[str, Entry], problems: list[str]
) -> dict[str, float]:
    """Return conditions in SI; append their problems."""
    values = {}
    for name, item in table.items():
        units = entries[name][0] if name in entries else "1"
        try:
            values[name] = parse_quantity(item, units)
        except UnitError as error:
            problems.append(f"conditions: {name}: {error}")
    return values


def _list_entries(sim: SimModel) -> dict[str, Entry]:
    """Return unit and start value of every input, parameter, and parameter of an instrument."""
    entries: dict[str, Entry] = {}
    for entry in sim.entries(INPUT):
        entries[entry.name] = entry.units, None
    for entry in sim.entries(OUTPUT):
        entries[f"sensor.{entry.name}"] = entry.units, 0.0
        entries[f"factor.{entry.name}"] = "1", 1.0
        entries[f"noise.{entry.name}"] = entry.units, None
        if entry.name in COORDINATES:
            entries[f"process.{entry.name}"] = "1", None
    for gust in GUST_NAMES.values():
        entries[f"gust.{gust}"] = "m s-1", START_INTENSITY
        entries[f"scale.{gust}"] = "m", START_SCALE
    for entry in sim.entries(PARAMETER):
        is_recorded = entry.name.startswith(_AS_RECORDED)
        entries[entry.name] = entry.units, None if is_recorded else entry.value
    return entries


def _table_value(sim: SimModel, name: str) -> float | None:
    """Return the value of a part of a table, which no catalogue lists; None for another name."""
    index = sim.model.find(PARAMETER, name)
    if index < 0:
        return None
    return Simulation(sim.model).parameter(index)


def read_specification(path: str | Path) -> Specification:
    """Read an output-error fit. Names of files are relative to its folder.

    Raises
    ------
    ParseError
        A file that is not TOML.
    SchemaError
        Every unknown key, missing value and missing file; a part of a record that is taken twice.
    """
    path = Path(path)
    content = _resolve_files(read_toml(path), path.parent)
    specification = validate_content(Specification, content, f"fit {path}")
    files = [specification.aircraft, specification.database]
    files += [table.file for table in specification.record]
    missing = []
    for file in files:
        if not file.is_file():
            missing.append(f"no file {file}; names are relative to the fit")
    if missing:
        raise SchemaError(f"fit {path}", missing)
    if repeated := _repeated_records(specification.record):
        raise SchemaError(f"fit {path}", repeated)
    return specification


def _repeated_records(tables: Sequence[RecordTable]) -> list[str]:
    """Return a line for each part of a record that is taken twice, also by another name."""
    spans: dict[str, list[tuple[float, float]]] = {}
    for table in tables:
        window = table.window or (-math.inf, math.inf)
        spans.setdefault(os.path.realpath(table.file), []).append(window)
    problems = []
    for file, windows in spans.items():
        problems += [f"record {Path(file).name}: {text}" for text in repeated_windows(windows)]
    return problems


def _resolve_files(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the content with the folder in front of the names of its files."""
    resolved = _resolve_keys(content, ("aircraft", "database"), folder)
    records = resolved.get("record")
    if isinstance(records, list):
        resolved["record"] = [_resolve_keys(table, ("file",), folder) for table in records]
    return resolved


def _resolve_keys(table: Any, keys: tuple[str, ...], folder: Path) -> Any:
    """Return a table with the folder in front of the texts of some keys."""
    # The content is not validated yet: a record may be something else than a table.
    if not isinstance(table, dict):
        return table
    resolved = dict(table)
    for key in keys:
        if isinstance(resolved.get(key), str):
            resolved[key] = folder / resolved[key]
    return resolved
