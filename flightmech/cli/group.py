"""The verb ``aeromatch fmu trim``."""

from __future__ import annotations

from typing import Any

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by

_FILE = InputFile()


class NameValue(click.ParamType):  # type: ignore[type-arg]
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


@click.command("trim")
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
@performed_by("flightmech.cli.actions.group:run_trim")
def trim_command() -> None:
    """Find a steady flight of AIRCRAFT (TOML) with DATABASE (netCDF); exit code 1 when there is
    none inside the limits.
    """


@click.command("simulate")
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
@performed_by("flightmech.cli.actions.group:run_simulate")
def simulate_command() -> None:
    """Fly AIRCRAFT (TOML) with DATABASE (netCDF) under recorded inputs and write the history."""


@click.group()
def fmu() -> None:
    """Simulation models: write them as FMUs, trim and fly them."""


@fmu.command("write")
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
@performed_by("flightmech.cli.actions.group:run_write")
def write_command() -> None:
    """Compile AIRCRAFT (TOML) with DATABASE (netCDF) and write the model as an FMU."""


@fmu.command("show")
@click.argument("path", metavar="FMU", type=InputFile())
@json_option
@performed_by("flightmech.cli.actions.show:print_fmu")
def show_fmu_command() -> None:
    """Show the variables of an FMU of any vendor, and what the standard's check finds."""


fmu.add_command(trim_command)
fmu.add_command(simulate_command)
