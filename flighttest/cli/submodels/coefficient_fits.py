"""What the verbs of balance and multibody vehicles share: options of the fits, fits in time and frequency, their print."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import table


def fit_options(over: str, order: int, weights: str) -> Callable:
    """Return a decorator with the options that say what is fitted."""

    def add(verb: Callable) -> Callable:
        for option in (
            click.option(
                "--weights",
                type=click.Choice(["equal", "spectrum"]),
                default=weights,
                show_default=True,
                help="Weights of the frequencies of --band: spectrum, for noise that grows with frequency.",
            ),
            click.option(
                "--select-in",
                "domain",
                type=click.Choice(["time", "frequency"]),
                default="time",
                show_default=True,
                help="Domain in which --select works; in frequency inside --band.",
            ),
            click.option("--band", type=(float, float), help="Fit in frequency as well [Hz], and average both with weights 1/s."),
            click.option(
                "--gain", type=float, default=0.0, show_default=True, help="Rise of R2 that a further term of --select must bring."
            ),
            click.option("--enter", type=float, default=20.0, show_default=True, help="Partial F above which --select takes a term."),
            click.option("--order", type=int, default=order, show_default=True, help="Highest order of a product of --select."),
            click.option("--over", default=over, show_default=True, help="Variables of --select, whose products are candidates."),
            click.option("--candidates", default="", help="Terms that --select chooses from, in place of products of --over."),
            click.option("--select", "selected", multiple=True, help="Coefficient whose terms are chosen by stepwise regression."),
            click.option("--model", "models", multiple=True, help="Terms of a coefficient, such as 'CL = 1 + alpha + alpha*beta'."),
        ):
            verb = option(verb)
        return verb

    return add


def coefficient_fits(
    models: Sequence[Any], selected: Sequence[str], candidates: Sequence[str], rule: Mapping[str, Any], band: Any, weights: str, name: str,
    prepared: Callable[[Any], Sequence[Any]],
) -> tuple[list[Any], list[Any]]:  # fmt: skip
    """Return the fits in time, and those in frequency where a band is given.

    `rule` is that of `select_stepwise`, with ``domain``; `prepared` gives the data for the fit of a model.
    """
    from ...equation_error.frequency_domain import regress_frequency
    from ...equation_error.model import Model
    from ...equation_error.time_domain import regress
    from ...model_structure.stepwise import select_stepwise

    how = {key: value for key, value in rule.items() if key != "domain"}
    if rule["domain"] == "frequency":
        if not band:
            raise click.UsageError("--select-in frequency needs --band LOW HIGH [Hz]")
        how |= {"band": band, "weights": weights}
    wanted = list(models)
    for one in selected:
        wanted.append(select_stepwise(one, candidates, prepared(Model(one, candidates)), name=name, **how).fit.model)
    fits, spectral = [], []
    for model in wanted:
        clean = prepared(model)
        fits.append(regress(model, clean, name=name))
        if band:
            spectral.append(regress_frequency(model, clean, band, name=name, weights=weights))
    return fits, spectral


def candidates_of(candidates: str, over: str, order: int) -> list[str]:
    """Return the terms to choose from: those of ``--candidates``, else all products of ``--over``."""
    from ...model_structure.candidates import monomials

    return candidates.split() or monomials(over.split(), order)


def averages_of(fits: Sequence[Any], spectral: Sequence[Any]) -> list[Any]:
    """Return the averages of time and frequency with weights 1/s, one table per coefficient."""
    from ...combining.pooling import pool_fits

    return [pool_fits(pair, "inverse_sigma") for pair in zip(fits, spectral)]


def save_fits(fits: Sequence[Any], folder: str | Path) -> None:
    """Write a file per coefficient."""
    from ...equation_error.fit import save_fit

    Path(folder).mkdir(parents=True, exist_ok=True)
    for fit in fits:
        save_fit(fit, Path(folder) / f"{fit.model.coefficient}.nc")


def as_rows(fits: Sequence[Any], averages: Sequence[Any]) -> dict[str, Any]:
    """Return the fits for a JSON document."""
    rows = {fit.model.coefficient: fit.estimates[["estimate", "stderr"]].to_dataframe().to_dict("index") for fit in fits}
    return {"fits": rows, "averages": {fit.model.coefficient: one.to_dict("index") for fit, one in zip(fits, averages)}}


def print_fits(fits: Sequence[Any], spectral: Sequence[Any], averages: Sequence[Any]) -> None:
    """Print reports, and time next to frequency."""
    for k, fit in enumerate(fits):
        click.echo(fit.report())
        click.echo()
        if spectral:
            cells = []
            for term, row in averages[k].iterrows():
                own = [float(one.estimates[key].sel(term=term)) for one in (fit, spectral[k]) for key in ("estimate", "stderr")]
                numbers = [f"{x:.4f}" for x in (*own, row["value"], row["stderr"])]
                cells.append((str(term), *numbers, "contradictory" if row["contradictory"] else ""))
            heads = ["term", "time", "std. error", "frequency", "std. error ", "average 1/s", "std. error  "]
            table([*heads, ""], cells, right=heads[1:])
            click.echo()
