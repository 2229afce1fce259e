"""The verb ``aeromatch fmu simulate``: a record of inputs through a model, without an FMU."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..support.console import InputFile, NewFile, json_option, progress
from .trim import Pair, si_value

if TYPE_CHECKING:
    import xarray as xr

    from ..simulation.compiler import SimModel

_FILE = InputFile()
_HEADING = re.compile(r"^\s*([A-Za-z_0-9.*]+)\s*(?:\[([^\]]*)\])?\s*$")


@click.command()
@click.argument("aircraft", type=_FILE)
@click.argument("database", type=_FILE)
@click.option("--inputs", "record", required=True, type=_FILE, help="CSV with headings 'time', 'delta_e [deg]' ..., or netCDF in SI.")
@click.option("--set", "given", multiple=True, type=Pair(), help="Parameter or constant input: init.V='175 kt', mode.trim=2, gear=1 ...")
@click.option("--hold", type=click.Choice(["linear", "zero"]), default="linear", show_default=True, help="Inputs between samples.")
@click.option("--terms", is_flag=True, help="Write the contribution of every term as well (netCDF only).")
@click.option("-o", "--output", required=True, type=NewFile(), help="The history: .nc, or .csv in SI.")
@json_option
def simulate(aircraft: str, database: str, record: str, given: tuple, hold: str, terms: bool, output: str, as_json: bool) -> None:
    """Fly AIRCRAFT (TOML) with DATABASE (netCDF) under recorded inputs and write the history."""
    from ..simulation.model_files import compile_files
    from ..simulation.run import simulate as fly
    from ..support.console import document

    if terms and Path(output).suffix == ".csv":
        raise click.UsageError("--terms needs a netCDF file; name it .nc")
    inputs = _read(record)
    with progress("fly the model"):
        sim = compile_files(aircraft, database)
        found = fly(sim, inputs, _values(sim, given), hold, terms=terms)
        _write(found, output)
    summary = {"file": output, "samples": found.sizes["time"], "outputs": len(sim.outputs), "out_of_range": found.attrs["out_of_range"]}
    if as_json:
        document(summary)
        return
    click.echo(f"{summary['samples']} samples of {summary['outputs']} outputs; tables left: {summary['out_of_range'] or 'none'}")
    click.echo(f"written: {output}")


def _values(sim: SimModel, given: tuple) -> dict[str, float]:
    """Return the values of parameters and inputs in SI; parts of tables are taken as they stand."""
    from ..simulation.kernel import INPUT, PARAMETER

    units = {row.name: row.units for kind in (INPUT, PARAMETER) for row in sim.entries(kind)}
    return {name: si_value(name, text, units) for name, text in given}


def _read(path: str) -> xr.Dataset:
    import pandas as pd
    import xarray as xr

    from ..errors import ParseError, UnknownName
    from ..names import lookup
    from ..support.input_files.self_contained import demand_self_contained
    from ..units import to_si

    if Path(path).suffix == ".nc":
        demand_self_contained(path)
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return dataset.load()
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (ValueError, UnicodeDecodeError) as error:
        raise ParseError(path, 1, str(error), "a CSV table with a line of headings") from error
    if not any(match and match[1] == "time" for match in map(_HEADING.match, map(str, table.columns))):
        raise ParseError(path, 1, ", ".join(map(str, table.columns)), "a column 'time' in s, then inputs such as 'delta_e [deg]'")
    columns = {}
    for heading in map(str, table.columns):
        match = _HEADING.match(heading)
        if match is None or not pd.api.types.is_numeric_dtype(table[heading]):
            raise ParseError(path, 1, heading, "a heading such as 'delta_e [deg]' over numbers")
        name, unit = match.groups()
        try:
            units = lookup(name).units
        except UnknownName as error:
            raise ParseError(path, 1, f"the column {heading!r} ({error})", "names of the vocabulary, docs/nomenclature.md") from error
        columns[name] = to_si(table[heading].to_numpy(float), unit or units, units)
    return xr.Dataset({name: ("time", values) for name, values in columns.items() if name != "time"}, {"time": columns["time"]})


def _write(found: xr.Dataset, output: str) -> None:
    from ..support.atomic_write import written_atomically

    with written_atomically(output) as part:
        if Path(output).suffix == ".csv":
            found.to_dataframe().to_csv(part)
        else:
            found.to_netcdf(part, engine="h5netcdf")
