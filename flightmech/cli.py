"""The verb ``aeromatch fmu trim``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import InputFile, NewFile, json_option, show_progress

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.simulation.compiler import SimModel

_FILE = InputFile()
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


class NameValue(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        """Return name and text of the value."""
        name, sign, text = str(value).partition("=")
        if not (name.strip() and sign and text.strip()):
            self.fail(f"{value!r} is not NAME=VALUE, such as V='175 kt'", param, ctx)
        return name.strip(), text.strip()


@click.command()
@click.argument("aircraft", type=_FILE)
@click.argument("database", type=_FILE)
@click.option(
    "--kind",
    default="level",
    show_default=True,
    help="Kind of the steady flight: level, climb, turn, sideslip, pull_up, engine_out or ground.",
)
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    type=NameValue(),
    help="Fixed quantity as NAME=VALUE, such as V='175 kt', h='5000 ft', phi='30 deg' or "
    "engine1.failed=1; may be repeated.",
)
@click.option(
    "--free",
    "unknowns",
    multiple=True,
    help="Unknowns to solve for instead of those of the kind, one name each.",
)
@json_option
@click.pass_context
def trim(
    ctx: click.Context,
    aircraft: str,
    database: str,
    kind: str,
    fixed: tuple,
    unknowns: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find a steady flight of AIRCRAFT (TOML) with DATABASE (netCDF); exit code 1 when there is
    none inside the limits.
    """
    from flightmech.simulation.compiler import compile_files
    from flightmech.steady_flight.trim_search import start_of
    from flightmech.steady_flight.trim_search import trim as search
    from flightmech.support.console import print_json

    with show_progress("compile the model, search the steady flight"):
        sim = compile_files(aircraft, database)
        units = _units(sim)
        found = search(
            sim,
            {},
            kind,
            unknowns or None,
            {name: si_value(name, text, units) for name, text in fixed},
        )
    if as_json:
        outputs = {str(name): float(item) for name, item in found.items() if not item.dims}
        parts = {name: found[name].to_series().to_dict() for name in ("found", "left")}
        print_json({**found.attrs, **parts, "outputs": outputs, "start": start_of(found)})
    else:
        _print(sim, found)
    ctx.exit(0 if found.attrs["converged"] else 1)


def _units(sim: SimModel) -> dict[str, str]:
    """Return the units of every name that can be held, plain start values and inputs of all engines
    among them.
    """
    from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER

    rows = [row for kind in (OUTPUT, INPUT, PARAMETER) for row in sim.entries(kind)]
    plain = {
        row.name.removeprefix("init."): row.units for row in rows if row.name.startswith("init.")
    }
    engines = {
        row.name.removeprefix("engine1."): row.units
        for row in rows
        if row.name.startswith("engine1.")
    }
    return engines | plain | {row.name: row.units for row in rows}


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
    from flightmech.errors import UnitError, UnknownName
    from flightmech.units import parse_quantity

    try:
        return float(text)
    except ValueError:
        if name not in units:
            raise UnknownName(name, units, "name") from None
    try:
        return parse_quantity(text, units[name])
    except UnitError as error:
        raise UnitError(f"{name}={text}: {error}") from error


def _print(sim: SimModel, found: xr.Dataset) -> None:
    from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER
    from flightmech.support.console import print_table
    from flightmech.units import from_si

    display = {
        row.name: row.display_units
        for kind in (PARAMETER, INPUT, OUTPUT)
        for row in sim.entries(kind)
    }

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


@click.command()
@click.argument("aircraft", type=_FILE)
@click.argument("database", type=_FILE)
@click.option(
    "--inputs",
    "record",
    required=True,
    type=_FILE,
    help="CSV with headings 'time', 'delta_e [deg]' ..., or netCDF in SI.",
)
@click.option(
    "--set",
    "given",
    multiple=True,
    type=NameValue(),
    help="Parameter or constant input: init.V='175 kt', mode.trim=2, gear=1 ...",
)
@click.option(
    "--hold",
    type=click.Choice(["linear", "zero"]),
    default="linear",
    show_default=True,
    help="Inputs between samples.",
)
@click.option(
    "--terms", is_flag=True, help="Write the contribution of every term as well (netCDF only)."
)
@click.option(
    "-o", "--output", required=True, type=NewFile(), help="The history: .nc, or .csv in SI."
)
@json_option
def simulate(
    aircraft: str,
    database: str,
    record: str,
    given: tuple,
    hold: str,
    terms: bool,
    output: str,
    as_json: bool,
) -> None:
    """Fly AIRCRAFT (TOML) with DATABASE (netCDF) under recorded inputs and write the history."""
    from flightmech.simulation.compiler import compile_files
    from flightmech.simulation.run import simulate as fly
    from flightmech.support.console import print_json

    if terms and Path(output).suffix == ".csv":
        raise click.UsageError("--terms needs a netCDF file; name it .nc")
    inputs = _read(record)
    with show_progress("fly the model"):
        sim = compile_files(aircraft, database)
        found = fly(sim, inputs, _values(sim, given), hold, terms=terms)
        _write(found, output)
    summary = {
        "file": output,
        "samples": found.sizes["time"],
        "outputs": len(sim.outputs),
        "out_of_range": found.attrs["out_of_range"],
    }
    if as_json:
        print_json(summary)
        return
    click.echo(
        f"{summary['samples']} samples of {summary['outputs']} outputs; tables left: "
        f"{summary['out_of_range'] or 'none'}"
    )
    click.echo(f"written: {output}")


def _values(sim: SimModel, given: tuple) -> dict[str, float]:
    """Return the values of parameters and inputs in SI; parts of tables are taken as they stand."""
    from flightmech.simulation.kernel import INPUT, PARAMETER

    units = {row.name: row.units for kind in (INPUT, PARAMETER) for row in sim.entries(kind)}
    return {name: si_value(name, text, units) for name, text in given}


def _read(path: str) -> xr.Dataset:
    import pandas as pd
    import xarray as xr

    from flightmech.errors import ParseError, UnknownName
    from flightmech.names import lookup
    from flightmech.support.hdf5_seal import demand_self_contained
    from flightmech.units import to_si

    if Path(path).suffix == ".nc":
        demand_self_contained(path)
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
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
                "names of the vocabulary, docs/nomenclature.md",
            ) from error
        columns[name] = to_si(table[heading].to_numpy(float), unit or units, units)
    return xr.Dataset(
        {name: ("time", values) for name, values in columns.items() if name != "time"},
        {"time": columns["time"]},
    )


def _write(found: xr.Dataset, output: str) -> None:
    from flightmech.support.atomic_write import written_atomically

    with written_atomically(output) as part:
        if Path(output).suffix == ".csv":
            found.to_dataframe().to_csv(part)
        else:
            found.to_netcdf(part, engine="h5netcdf")


@click.group()
def fmu() -> None:
    """Simulation models: write them as FMUs, trim and fly them."""


@fmu.command()
@click.argument("aircraft", type=InputFile())
@click.argument("database", type=InputFile())
@click.option("-o", "--output", required=True, type=NewFile(), help="The FMU to write.")
@click.option(
    "--fmi",
    "version",
    type=click.Choice(["2.0", "3.0"]),
    default="2.0",
    show_default=True,
    help="Version of the standard.",
)
@json_option
def write(aircraft: str, database: str, output: str, version: str, as_json: bool) -> None:
    """Compile AIRCRAFT (TOML) with DATABASE (netCDF) and write the model as an FMU."""
    from flightmech.fmu_export.fmu_file import write_fmu
    from flightmech.simulation.compiler import compile_files
    from flightmech.support.console import print_json

    with show_progress("compile the model, write the FMU"):
        sim = compile_files(aircraft, database)
        path = write_fmu(sim, output, version)
    counts = {
        "inputs": len(sim.inputs),
        "outputs": len(sim.outputs),
        "parameters": len(sim.parameters),
        "terms": len(sim.terms),
    }
    if as_json:
        print_json({"file": str(path), "fmi": version, "bytes": path.stat().st_size, **counts})
    else:
        click.echo(
            f"FMI {version}, "
            f"{', '.join(f'{count} {what}' for what, count in counts.items())}, "
            f"{path.stat().st_size} bytes"
        )
        click.echo(f"written: {path}")


@fmu.command()
@click.argument("path", metavar="FMU", type=InputFile())
@json_option
def show(path: str, as_json: bool) -> None:
    """Show the variables of an FMU of any vendor, and what the standard's check finds."""
    from flightmech.fmu_export.fmu_file import read_fmu
    from flightmech.support.console import print_json, print_remark, print_table

    found = read_fmu(path)
    if as_json:
        print_json(found)
        return
    columns = ("name", "causality", "variability", "unit", "start", "description")
    rows = [
        ["" if row[column] is None else row[column] for column in columns]
        for row in found["variables"]
    ]
    print_table(
        columns,
        rows,
        title=f"{found['model']}  FMI {found['fmi']}  {' '.join(found['platforms'])}",
        right=("start",),
    )
    if not found["runs_here"]:
        print_remark(
            f"no library for this platform, {found['platform']}; the FMU runs on "
            f"{', '.join(found['platforms']) or 'none'}"
        )
    for finding in found["findings"]:
        print_remark(f"finding: {finding}")


fmu.add_command(trim)
fmu.add_command(simulate)
