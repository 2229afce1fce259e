"""The verbs ``compare`` and ``plot`` of ``aeromatch db``."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    performed_by,
)

_FILE = InputFile()
_ALONG = "netCDF-4 with states over time, as `aeromatch flight reconstruct` writes it."


@click.command("compare")
@click.argument("first", metavar="A", type=_FILE)
@click.argument("second", metavar="B", type=_FILE)
@click.option("--along", type=_FILE, help=f"Compare along a flight instead of a grid: {_ALONG}")
@click.option(
    "--coefficient",
    "wanted",
    multiple=True,
    help="Only this coefficient and its terms, such as CL; may be repeated.",
)
@click.option(
    "--figures",
    type=click.Path(file_okay=False),
    help="New folder for figures of all shared terms and coefficients.",
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["svg", "png", "pdf"]),
    default="svg",
    show_default=True,
    help="File format of the figures.",
)
@json_option
@performed_by("aerodb.cli.actions.compare:run_compare")
def compare_command() -> None:
    """Compare two databases, B less A, by coefficient and by term: largest and rms difference,
    where, in standard errors.
    """


@click.command("plot")
@click.argument("file", type=_FILE)
@click.option("--term", required=True, help="Such as CL/basic; a coefficient, CL, will do as well.")
@click.option("--family", help="Variable that distinguishes the curves, such as mach or delta_f.")
@click.option("--over", help="The abscissa; alpha unless given, where the term has it.")
@click.option(
    "--at",
    "held",
    multiple=True,
    metavar="NAME=VALUE",
    help="Value of another variable: delta_f='40 deg', mach=0.3 and so on.",
)
@click.option("--along", type=_FILE, help=f"Mark where flight samples lie: {_ALONG}")
@click.option(
    "-o", "--output", required=True, type=NewFile(), help="The figure: .svg, .png or .pdf."
)
@performed_by("aerodb.cli.actions.compare:run_plot_term")
def plot_term_command() -> None:
    """Draw a term of a database: a family of curves with standard errors and the sources of its
    nodes.
    """


_FIGURE_FILE = InputFile(path_type=Path)


@click.command("figures")
@click.argument(
    "places",
    metavar="FOLDER | DB [DB]",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, path_type=Path),
)
@click.option(
    "--lr743",
    "set_of_it",
    is_flag=True,
    help="Figures 1 to 4 and 9 to 17, tables 1 and 2, and drag polars.",
)
@click.option(
    "--aircraft",
    type=_FIGURE_FILE,
    help="Aircraft file (TOML) of all databases, for stall and trimmed polars.",
)
@click.option(
    "--flown",
    "flown_file",
    type=_FIGURE_FILE,
    help="File flown.nc as `aeromatch match` writes it: test points, sweeps, local estimates.",
)
@click.option(
    "--buffet", type=_FIGURE_FILE, help="Buffet boundary, clean: CSV with the columns mach and CL."
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["svg", "png", "pdf"]),
    default="svg",
    show_default=True,
    help="File format of the figures.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="New folder for the set.",
)
@json_option
@performed_by("aerodb.cli.actions.compare:run_figures")
def figures_command() -> None:
    """Write the figures and tables of LR-743 from data, and state of each that cannot be made what
    is missing.

    FOLDER is one that `aeromatch match` or `aeromatch demo` wrote: its a-priori and final database,
    their aircraft and flown.nc are taken. Or give one DB, or the a-priori and the final one.
    """
