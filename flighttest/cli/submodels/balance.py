"""The verb ``aeromatch flight balance``: points of a wind-tunnel balance to fits for the database."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, NewFolder, document, json_option, progress

from .coefficient_fits import as_rows, averages_of, candidates_of, coefficient_fits, fit_options, print_fits, save_fits


@click.command("balance")
@click.argument("points", nargs=-1, required=True, type=InputFile())
@click.option("--setup", "setup_file", required=True, type=InputFile(), help="TOML file: reference, balance, columns, errors, nuisance.")
@fit_options(over="alpha beta", order=4, weights="equal")
@click.option("--figure", type=NewFile(), help="Draw the fits over alpha and beta with the points: png, svg or pdf.")
@click.option("-o", "--output", type=NewFolder(), help="Folder for the fits, one file per coefficient, for flight tabulate.")
@json_option
def balance(
    points, setup_file, models, selected, candidates, over, order, gain, enter, band, domain, weights, figure, output, as_json
) -> None:
    """Reduce POINTS of a wind-tunnel balance to coefficients, take tare and interference off, and fit models."""
    from flightmech.errors import SchemaError

    from ...equation_error.model import Model
    from ...wind_tunnel.figure import draw_surfaces
    from ...wind_tunnel.reduction import balance_coefficients, without_nuisance
    from ...wind_tunnel.setup import read_setup

    if not models and not selected:
        raise SchemaError("flight balance", ["nothing to fit; give --model 'CL = 1 + alpha' or --select CL"])
    setup = read_setup(setup_file)
    with progress("reduce the points"):
        data = [balance_coefficients(path, setup) for path in points]
    wanted = [Model.parse(text) for text in models]
    with progress("fit the coefficients"):
        fits, spectral = coefficient_fits(
            wanted,
            selected,
            candidates_of(candidates, over, order),
            {"gain": gain, "enter": enter, "domain": domain},
            band,
            weights,
            Path(points[0]).stem,
            lambda model: without_nuisance(data, model, setup),
        )
    if figure:
        draw_surfaces(fits, figure)
    if output:
        save_fits(fits, output)
    averages = averages_of(fits, spectral)
    if as_json:
        document({**as_rows(fits, averages), "folder": output})
        return
    print_fits(fits, spectral, averages)
    if output:
        click.echo(f"written: {len(fits)} fits in {output}")
