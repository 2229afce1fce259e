"""An output-error fit as a TOML file: model, records, outputs, and what is estimated.

title = "Citation II, short period"
aircraft = "citation.toml"          # files are relative to this one
database = "prior.nc"
outputs = ["alpha", "q", "theta", "az"]
noise = "common"                    # or "own": a noise variance per record

[conditions]                        # held, for all records; numbers are SI, texts carry their unit
delta_f = "0 deg"

[[record]]                          # a path as `flight reconstruct` or `flight report --save` writes it
file = "path_short_period.nc"
window = [3634.0, 3645.0]
[record.conditions]
"init.h" = 1500.0

[parameter."term.Cm.basic"]         # any parameter of the model, sensor.* and factor.* of an output
start = 1.0                         # left out: what the record gives at its first sample, or the model
sigma = 0.3                         # standard error of what is known before; left out: nothing is
low = 0.2
high = 3.0
own = false                         # one value per record
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER, Simulation
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_quantity
from flighttest.maximum_likelihood.unknowns import Unknown

_Number = float | str
_AS_RECORDED = "init"


class RecordTable(Strict):
    """One manoeuvre."""

    file: Path
    window: tuple[float, float] | None = None
    conditions: dict[str, _Number] = Field(default_factory=dict)


class ParameterTable(Strict):
    """One unknown."""

    start: _Number | None = None
    sigma: _Number = math.inf
    low: _Number = -math.inf
    high: _Number = math.inf
    own: bool = False


class Specification(Strict):
    """An output-error fit."""

    title: str = ""
    aircraft: Path
    database: Path
    outputs: tuple[str, ...] = Field(min_length=1)
    noise: Literal["common", "own"] = "common"
    iterations: int = Field(default=50, ge=1)
    conditions: dict[str, _Number] = Field(default_factory=dict)
    record: tuple[RecordTable, ...] = Field(min_length=1)
    parameter: dict[str, ParameterTable] = Field(min_length=1)

    def unknowns(self, sim: SimModel) -> dict[str, Unknown]:
        """Return the unknowns in SI.

        Raises
        ------
        SchemaError
            Wrong units and texts that are no quantity; all at once.
        """
        entries, problems, found = _entries(sim), [], {}
        for name, table in self.parameter.items():
            units, nominal = entries.get(name) or ("1", _of_table(sim, name))
            if name not in entries and nominal is None:
                problems.append(
                    str(
                        UnknownName(
                            name,
                            entries,
                            "parameter",
                            "a parameter of the model, sensor.* or factor.*",
                        )
                    )
                )
                continue
            try:
                start = nominal if table.start is None else parse_quantity(table.start, units)
                sigma, low, high = (
                    parse_quantity(item, units) for item in (table.sigma, table.low, table.high)
                )
            except UnitError as error:
                problems.append(f"parameter {name}: {error}")
                continue
            found[name] = Unknown(None if start is None else start, sigma, low, high, table.own)
        if problems:
            raise SchemaError("fit", problems)
        return found

    def held(self, sim: SimModel) -> list[dict[str, float]]:
        """Return the conditions of each record in SI; errors as `unknowns`."""
        entries, problems = _entries(sim), []

        def converted(table: Mapping[str, _Number]) -> dict[str, float]:
            values = {}
            for name, item in table.items():
                try:
                    values[name] = parse_quantity(item, entries.get(name, ("1", None))[0])
                except UnitError as error:
                    problems.append(f"conditions: {name}: {error}")
            return values

        found = [
            {**converted(self.conditions), **converted(table.conditions)} for table in self.record
        ]
        if problems:
            raise SchemaError("fit", list(dict.fromkeys(problems)))
        return found


def _entries(sim: SimModel) -> dict[str, tuple[str, float | None]]:
    """Return unit and first value of everything that can be named; no first value where the record
    is asked.
    """
    found: dict[str, tuple[str, float | None]] = {}
    for entry in sim.entries(INPUT):
        found[entry.name] = entry.units, None
    for entry in sim.entries(OUTPUT):
        found |= {f"sensor.{entry.name}": (entry.units, 0.0), f"factor.{entry.name}": ("1", 1.0)}
    for entry in sim.entries(PARAMETER):
        found[entry.name] = (
            entry.units,
            None if entry.name.startswith(_AS_RECORDED) else entry.value,
        )
    return found


def _of_table(sim: SimModel, name: str) -> float | None:
    """Return the present value of a part of a table, which is in no catalogue; None of what the
    model does not know.
    """
    index = sim.model.find(PARAMETER, name)
    return None if index < 0 else Simulation(sim.model).parameter(index)


def read_specification(path: str | Path) -> Specification:
    """Read an output-error fit; names of files become relative to it.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        Every unknown key, missing value and absent file.
    """
    path = Path(path)
    found = validate_content(Specification, _placed(read_toml(path), path.parent), f"fit {path}")
    files = [found.aircraft, found.database, *(table.file for table in found.record)]
    absent = [
        f"no file {file}; names are relative to the fit" for file in files if not file.is_file()
    ]
    if absent:
        raise SchemaError(f"fit {path}", absent)
    return found


def _placed(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the content with the names of its files put behind the folder."""

    def placed(table: Any, *keys: str) -> Any:
        if not isinstance(table, dict):
            return table
        return {
            key: folder / item if key in keys and isinstance(item, str) else item
            for key, item in table.items()
        }

    found = placed(content, "aircraft", "database")
    if isinstance(found.get("record"), list):
        found["record"] = [placed(table, "file") for table in found["record"]]
    return found
