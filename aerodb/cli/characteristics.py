"""The verbs ``characteristics``, ``rescale`` and ``scheme`` of ``aeromatch db``."""

from __future__ import annotations

from typing import Any

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by

_FILE = InputFile()


class Pairs(click.ParamType):  # type: ignore[type-arg]
    """An option of the form NAME=VALUE, as the pair of name and text of the value."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        """Return name and text of the value."""
        name, sign, text = str(value).partition("=")
        if not (name.strip() and sign and text.strip()):
            self.fail(f"{value!r} is not NAME=VALUE, such as delta_f='20 deg'", param, ctx)
        return name.strip(), text.strip()


@click.command("characteristics")
@click.argument("database", metavar="DB", type=_FILE)
@click.argument("aircraft", type=_FILE)
@click.option("--speed", help="True airspeed, such as '175 kt' or 90 [m/s].")
@click.option("--cas", help="Calibrated airspeed instead.")
@click.option("--mach", type=float, help="Mach number instead.")
@click.option("--altitude", default="0", show_default=True, help="Height, such as '5000 ft'.")
@click.option(
    "--set",
    "further",
    multiple=True,
    type=Pairs(),
    help="More of the condition: delta_f='20 deg', gear=1, mass=2400, x_cg_b=-0.05 ...",
)
@click.option(
    "--samples",
    type=int,
    default=0,
    help="Draw so many databases from the standard errors of DB, 10 or more; adds standard errors.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random draws.")
@json_option
@performed_by("aerodb.cli.actions.characteristics:run_characteristics")
def characteristics_command() -> None:
    """Compute the flying qualities and performance of AIRCRAFT (TOML) with DB (netCDF) at one
    condition.
    """


@click.command("rescale")
@click.argument("database", metavar="DB", type=_FILE)
@click.argument("aircraft", type=_FILE)
@click.option("--length-ratio", required=True, type=float, help="New length over known length.")
@click.option(
    "--mass-ratio",
    type=float,
    help="New mass over known mass; the cube of the length ratio unless given.",
)
@click.option(
    "--law",
    "laws",
    multiple=True,
    type=Pairs(),
    help="Factor in place of a law: thrust=1.4, inertia=2.1 ...",
)
@click.option(
    "--factor",
    "factors",
    multiple=True,
    type=Pairs(),
    help="Factor on terms: horizontal_tail=1.1, Cm/elevator=0.9 ...",
)
@click.option("--name", default="", help="Name of the new aircraft.")
@click.option("-o", "--output", required=True, type=NewFile(), help="The new database, netCDF-4.")
@click.option(
    "--aircraft-output", required=True, type=NewFile(), help="The new aircraft file, TOML."
)
@json_option
@performed_by("aerodb.cli.actions.characteristics:run_rescale")
def rescale_command() -> None:
    """Make a similar aircraft and its database from AIRCRAFT (TOML) and DB (netCDF) by the laws of
    similarity.
    """


@click.command("scheme")
@click.argument("coefficient", required=False)
@json_option
@performed_by("aerodb.cli.actions.characteristics:run_scheme")
def scheme_command() -> None:
    """Print the build-up of LR-743, equations (1) to (11): what each term is and where it can come
    from.
    """
