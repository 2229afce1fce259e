"""The command group ``aeromatch fmu``: write a simulation model as an FMU, show what an FMU offers, trim a model."""

from __future__ import annotations

import click

from ..support.console import InputFile, NewFile, brief, json_option, progress
from .simulate import simulate
from .trim import trim


@click.group()
def fmu() -> None:
    """Simulation models: write them as FMUs, trim and fly them."""


@fmu.command()
@click.argument("aircraft", type=InputFile())
@click.argument("database", type=InputFile())
@click.option("-o", "--output", required=True, type=NewFile(), help="The FMU to write.")
@click.option("--fmi", "version", type=click.Choice(["2.0", "3.0"]), default="2.0", show_default=True, help="Version of the standard.")
@json_option
def write(aircraft: str, database: str, output: str, version: str, as_json: bool) -> None:
    """Compile AIRCRAFT (TOML) with DATABASE (netCDF) and write the model as an FMU."""
    from ..fmu_export.writer import write_fmu
    from ..simulation.model_files import compile_files
    from ..support.console import document

    with progress("compile the model, write the FMU"):
        sim = compile_files(aircraft, database)
        path = write_fmu(sim, output, version)
    counts = {"inputs": len(sim.inputs), "outputs": len(sim.outputs), "parameters": len(sim.parameters), "terms": len(sim.terms)}
    if as_json:
        document({"file": str(path), "fmi": version, "bytes": path.stat().st_size, **counts})
    else:
        click.echo(f"FMI {version}, {', '.join(f'{count} {what}' for what, count in counts.items())}, {path.stat().st_size} bytes")
        click.echo(f"written: {path}")


@fmu.command()
@click.argument("path", metavar="FMU", type=InputFile())
@json_option
@brief()
def show(path: str, as_json: bool) -> None:
    """Show the variables of an FMU of any vendor, and what the standard's check finds."""
    from ..fmu_export.reading import read_fmu
    from ..support.console import document, remark, table

    found = read_fmu(path)
    if as_json:
        document(found)
        return
    columns = ("name", "causality", "variability", "unit", "start", "description")
    rows = [["" if row[column] is None else row[column] for column in columns] for row in found["variables"]]
    table(columns, rows, title=f"{found['model']}  FMI {found['fmi']}  {' '.join(found['platforms'])}", right=("start",))
    if not found["runs_here"]:
        remark(f"no library for this platform, {found['platform']}; the FMU runs on {', '.join(found['platforms']) or 'none'}")
    for finding in found["findings"]:
        remark(f"finding: {finding}")


fmu.add_command(trim)
fmu.add_command(simulate)
