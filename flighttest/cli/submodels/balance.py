"""The verb ``aeromatch flight balance``: points of a wind-tunnel balance to fits for the database."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFolder, document, json_option, progress, table


@click.command("balance")
@click.argument("points", nargs=-1, required=True, type=InputFile())
@click.option("--setup", "setup_file", required=True, type=InputFile(), help="TOML file: reference, balance, columns, errors, nuisance.")
@click.option("--model", "models", multiple=True, help="Terms of a coefficient, such as 'CL = 1 + alpha + alpha*beta'.")
@click.option("--select", "selected", multiple=True, help="Coefficient whose terms are chosen by stepwise regression.")
@click.option("--over", default="alpha beta", show_default=True, help="Variables of --select.")
@click.option("--order", type=int, default=4, show_default=True, help="Highest order of a product of --select.")
@click.option("--gain", type=float, default=0.0, show_default=True, help="Rise of R2 that a further term of --select must bring.")
@click.option("--band", type=(float, float), help="Fit in frequency as well [Hz], and average both with weights 1/s.")
@click.option("-o", "--output", type=NewFolder(), help="Folder for the fits, one file per coefficient, for flight tabulate.")
@json_option
def balance(points, setup_file, models, selected, over, order, gain, band, output, as_json) -> None:
    """Reduce POINTS of a wind-tunnel balance to coefficients, take tare and interference off, and fit models."""
    from flightmech.errors import SchemaError

    from ...combining.pooling import pool_fits
    from ...equation_error.fit import save_fit
    from ...equation_error.frequency_domain import regress_frequency
    from ...equation_error.model import Model
    from ...equation_error.time_domain import regress
    from ...model_structure.candidates import monomials
    from ...model_structure.stepwise import select_stepwise
    from ...wind_tunnel.reduction import balance_coefficients, without_nuisance
    from ...wind_tunnel.setup import read_setup

    if not models and not selected:
        raise SchemaError("flight balance", ["nothing to fit; give --model 'CL = 1 + alpha' or --select CL"])
    setup = read_setup(setup_file)
    with progress("reduce the points"):
        data = [balance_coefficients(path, setup) for path in points]
    wanted = [Model.parse(text) for text in models]
    with progress("fit the coefficients"):
        for name in selected:
            candidates = monomials(over.split(), order)
            clean = without_nuisance(data, Model(name, candidates), setup)
            wanted.append(select_stepwise(name, candidates, clean, gain=gain, name=Path(points[0]).stem).fit.model)
        fits, spectral = [], []
        for model in wanted:
            clean = without_nuisance(data, model, setup)
            fits.append(regress(model, clean, name=Path(points[0]).stem))
            if band:
                spectral.append(regress_frequency(model, clean, band, name=Path(points[0]).stem))
    if output:
        Path(output).mkdir(parents=True, exist_ok=True)
        for fit in fits:
            save_fit(fit, Path(output) / f"{fit.model.coefficient}.nc")
    averages = [pool_fits(pair, "inverse_sigma") for pair in zip(fits, spectral)]
    if as_json:
        rows = {fit.model.coefficient: fit.estimates[["estimate", "stderr"]].to_dataframe().to_dict("index") for fit in fits}
        means = {fit.model.coefficient: one.to_dict("index") for fit, one in zip(fits, averages)}
        document({"fits": rows, "averages": means, "folder": output})
        return
    for k, fit in enumerate(fits):
        click.echo(fit.report())
        click.echo()
        if band:
            cells = []
            for term, row in averages[k].iterrows():
                own = [float(one.estimates[key].sel(term=term)) for one in (fit, spectral[k]) for key in ("estimate", "stderr")]
                numbers = [f"{x:.4f}" for x in (*own, row["value"], row["stderr"])]
                cells.append((str(term), *numbers, "contradictory" if row["contradictory"] else ""))
            heads = ["term", "time", "std. error", "frequency", "std. error ", "average 1/s", "std. error  "]
            table([*heads, ""], cells, right=heads[1:])
            click.echo()
    if output:
        click.echo(f"written: {len(fits)} fits in {output}")
