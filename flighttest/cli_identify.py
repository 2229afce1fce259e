"""The verb ``aeromatch flight identify``: reconstructed paths to estimates of a model."""

from __future__ import annotations

import click

from flightmech.console import NewFile, document, json_option, table


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False))
@click.option("--aircraft", "aircraft_file", required=True, type=click.Path(exists=True, dir_okay=False), help="Aircraft, TOML.")
@click.option("--model", "model_text", required=True, help="For example 'CL = 1 + alpha + qhat + delta_e'.")
@click.option("--window", "windows", type=(float, float), multiple=True, help="Start and stop [s]; several make one fit. Default: all.")
@click.option("--cutoff", type=float, help="Low-pass all states alike first [Hz].")
@click.option("--intercepts", type=click.Choice(["common", "separate"]), default="common", help="One constant, or one per manoeuvre.")
@click.option("-o", "--output", type=NewFile(), help="Write the fit to this netCDF file.")
@json_option
def identify(paths, aircraft_file, model_text, windows, cutoff, intercepts, output, as_json) -> None:
    """Estimate the terms of one coefficient from reconstructed paths by least squares."""
    from flightmech import read_aircraft

    from .fit import save_fit
    from .model import Model
    from .reduction import between, coefficients, open_states
    from .regression import regress

    aircraft, model = read_aircraft(aircraft_file), Model.parse(model_text)
    manoeuvres = []
    for path in paths:
        data = coefficients(open_states(path), aircraft, cutoff=cutoff)
        manoeuvres += [between(data, *window) for window in windows] or [data]
    fit = regress(model, manoeuvres, intercepts=intercepts)
    if output:
        save_fit(fit, output)
    e = fit.estimates
    if as_json:
        columns = [str(name) for name, item in e.data_vars.items() if item.dims == ("term",)]
        terms = {str(term): {name: float(e[name].sel(term=term)) for name in columns} for term in e["term"].values}
        document(
            {"model": str(model), **e.attrs, "terms": terms, "covariance": e["covariance"].values, "remarks": fit.remarks, "file": output}
        )
        return
    shown = {"estimate": "estimate", "stderr": "std error", "stderr_white": "if white", "stderr_systematic": "systematic", "vif": "VIF"}
    rows = [(str(term), *(_cell(float(e[name].sel(term=term))) for name in shown)) for term in e["term"].values]
    title = f"{model}   {e.attrs['samples']} samples, R2 {e.attrs['R2']:.4f}, residual rms {e.attrs['residual_rms']:.3g}"
    table(["term", *shown.values()], rows, title, right=list(shown.values()))
    for text in fit.remarks:
        click.echo(f"! {text}")
    if output:
        click.echo(f"written: {output}")


def _cell(value: float) -> str:
    return "-" if value != value else f"{value:.4g}"
