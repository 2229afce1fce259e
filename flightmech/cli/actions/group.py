"""Functions that perform the commands of `flightmech.cli.group`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import pandas as pd
import xarray as xr

from flightmech.errors import ParseError, UnitError, UnknownName
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.names import lookup
from flightmech.quantities import finite_number, number_or_text, parse_quantity
from flightmech.simulation.compiler import SimModel, compile_files
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER
from flightmech.simulation.run import simulate as fly
from flightmech.simulation.run import units_of_names
from flightmech.simulation.stated_values.odd_values import describe_bare_numbers, warn_of_odd_time
from flightmech.steady_flight.stated_speeds.odd_speeds import warn_of_odd_speed
from flightmech.steady_flight.trim_findings import describe_limits_beyond_tables
from flightmech.steady_flight.trim_search import start_of
from flightmech.steady_flight.trim_search import trim as search
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.console import print_json, print_table, show_progress
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flightmech.units import from_si, to_si

_DIGITS = 9  # behind the point: less than that is rounding
_SHOWN = (
    "V",
    "V_cas",
    "mach",
    "h",
    "alpha",
    "beta",
    "theta",
    "phi",
    "gamma",
    "hdot",
    "p",
    "q",
    "r",
    "nz",
    "ax",
    "ay",
)


def run_trim(
    ctx: click.Context,
    aircraft: str,
    database: str,
    kind: str,
    fixed: tuple[Any, ...],
    unknowns: tuple[str, ...],
    as_json: bool,
) -> None:
    """Perform the command ``trim``."""
    with show_progress("compile the model, search the steady flight"):
        sim = compile_files(aircraft, database)
        units = units_of_names(sim)
        values = {name: si_value(name, text, units) for name, text in fixed}
        found = search(sim, {}, kind, unknowns or None, values)
    if as_json:
        outputs = {str(name): float(item) for name, item in found.items() if not item.dims}
        parts = {name: found[name].to_series().to_dict() for name in ("found", "left")}
        print_json({**found.attrs, **parts, "outputs": outputs, "start": start_of(found)})
    else:
        _print(sim, found)
        _echo_bare_numbers(fixed)
    ctx.exit(0 if found.attrs["converged"] else 1)


def si_value(name: str, text: str, units: Mapping[str, str]) -> float:
    """Return the SI value of ``name=text``; a bare number is SI, and its name is judged by who
    takes it.

    Raises
    ------
    UnknownName
        A value with a unit for a name that has none.
    UnitError
        With the name.
    """

    try:
        return finite_number(text)
    except ValueError:
        if name not in units:
            raise UnknownName(name, units, "name") from None
    try:
        return parse_quantity(text, units[name])
    except UnitError as error:
        raise UnitError(f"{name}={text}: {error}") from error


def _echo_bare_numbers(given: tuple[tuple[str, str], ...]) -> None:
    """Print in which unit the values were taken that have none."""
    numbers = {name: number_or_text(text) for name, text in given}
    bare = {name: value for name, value in numbers.items() if not isinstance(value, str)}
    if line := describe_bare_numbers(bare):
        click.echo(line)


def _print(sim: SimModel, found: xr.Dataset) -> None:

    entries = [*sim.entries(PARAMETER), *sim.entries(INPUT), *sim.entries(OUTPUT)]
    display = {row.name: row.display_units for row in entries}

    def line(name: str, value: float, units: str) -> tuple[str, str, str]:
        unit = (
            display.get(name)
            or display.get(f"init.{name}")
            or display.get(f"engine1.{name}", units)
        )
        return name, f"{round(from_si(value, unit), _DIGITS) + 0.0:.6g}", unit

    unknowns = zip(
        found["unknown"].values,
        found["found"].values,
        found["unknown_units"].values,
        found["limit"].values,
        strict=True,
    )
    rows = [
        (
            *line(str(name), float(value), str(units)),
            {-1: "at its lower limit", 0: "", 1: "at its upper limit"}[int(side)],
        )
        for name, value, units, side in unknowns
    ]
    print_table(
        ("unknown", "value", "unit", "limit"),
        rows,
        title=f"{found.attrs['title']}, {found.attrs['kind']}: {found.attrs['verdict']}",
        right=("value",),
    )
    if found.attrs["advice"]:
        click.echo(found.attrs["advice"])
    click.echo()
    names = [
        *_SHOWN,
        *(name for name in sim.outputs if name.startswith("engine") and name.endswith(".thrust")),
    ]
    print_table(
        ("state", "value", "unit"),
        [line(name, float(found[name]), str(found[name].attrs["units"])) for name in names],
        right=("value",),
    )


_HEADING = re.compile(r"^\s*([A-Za-z_0-9.*]+)\s*(?:\[([^\]]*)\])?\s*$")


def run_simulate(
    aircraft: str,
    database: str,
    record: str,
    given: tuple[Any, ...],
    hold: str,
    terms: bool,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``simulate``."""
    if terms and Path(output).suffix == ".csv":
        raise click.UsageError("--terms needs a netCDF file; name it .nc")
    inputs = _read(record)
    with show_progress("fly the model"):
        sim = compile_files(aircraft, database)
        values = _values(sim, given)
        warn_of_odd_time(inputs["time"].values)
        if values.get("mode.trim"):
            warn_of_odd_speed(sim, values)
        found = fly(sim, inputs, values, hold, terms=terms)
        _write(found, output)
    summary = {
        "file": output,
        "samples": found.sizes["time"],
        "outputs": len(sim.outputs),
        "out_of_range": found.attrs["out_of_range"],
        "below_runway": found.attrs["below_runway"],
    }
    if as_json:
        print_json(summary)
        return
    click.echo(
        f"{summary['samples']} samples of {summary['outputs']} outputs; tables left: "
        f"{summary['out_of_range'] or 'none'}"
    )
    if summary["below_runway"]:
        click.echo(summary["below_runway"])
    _echo_bare_numbers(given)
    click.echo(f"written: {output}")


def _values(sim: SimModel, given: tuple[Any, ...]) -> dict[str, float]:
    """Return the values of parameters and inputs in SI; parts of tables are taken as they stand."""

    rows = [*sim.entries(INPUT), *sim.entries(PARAMETER)]
    units = {row.name: row.units for row in rows}
    return {name: si_value(name, text, units) for name, text in given}


def _read(path: str) -> xr.Dataset:

    if Path(path).suffix == ".nc":
        demand_self_contained(path)
        with (
            decoding_errors(path, "a netCDF-4 file of time histories"),
            xr.open_dataset(path, engine="h5netcdf", phony_dims="access") as dataset,
        ):
            return dataset.load()
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (ValueError, UnicodeDecodeError) as error:
        raise ParseError(path, 1, str(error), "a CSV table with a line of headings") from error
    if not any(
        match and match[1] == "time" for match in map(_HEADING.match, map(str, table.columns))
    ):
        raise ParseError(
            path,
            1,
            ", ".join(map(str, table.columns)),
            "a column 'time' in s, then inputs such as 'delta_e [deg]'",
        )
    columns = {}
    for heading in map(str, table.columns):
        match = _HEADING.match(heading)
        if match is None or not pd.api.types.is_numeric_dtype(table[heading]):
            raise ParseError(path, 1, heading, "a heading such as 'delta_e [deg]' over numbers")
        name, unit = match.groups()
        try:
            units = lookup(name).units
        except UnknownName as error:
            raise ParseError(
                path,
                1,
                f"the column {heading!r} ({error})",
                "names of the vocabulary, page reference/nomenclature of `./run docs`",
            ) from error
        columns[name] = to_si(table[heading].to_numpy(float), unit or units, units)
    return xr.Dataset(
        {name: ("time", values) for name, values in columns.items() if name != "time"},
        {"time": columns["time"]},
    )


def _write(found: xr.Dataset, output: str) -> None:

    with written_atomically(output) as part:
        if Path(output).suffix == ".csv":
            found.to_dataframe().to_csv(part)
        else:
            write_netcdf(found, part)


def run_write(aircraft: str, database: str, output: str, version: str, as_json: bool) -> None:
    """Perform the command ``write``."""
    with show_progress("compile the model, write the FMU"):
        sim = compile_files(aircraft, database)
        path = write_fmu(sim, output, version)
    beyond = describe_limits_beyond_tables(sim)
    counts = {
        "inputs": len(sim.inputs),
        "outputs": len(sim.outputs),
        "parameters": len(sim.parameters),
        "terms": len(sim.terms),
    }
    if as_json:
        summary = {"file": str(path), "fmi": version, "bytes": path.stat().st_size}
        print_json({**summary, **counts, "limits_beyond_tables": beyond})
    else:
        click.echo(
            f"FMI {version}, "
            f"{', '.join(f'{count} {what}' for what, count in counts.items())}, "
            f"{path.stat().st_size} bytes"
        )
        for text in beyond:
            click.echo(f"{text}; the effect of the control stays as it is there")
        click.echo(f"written: {path}")
