"""Functions that perform the commands of `flighttest.cli.identify`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    print_json,
    show_progress,
)
from flightmech.units import to_si
from flighttest.cli.actions.fit_output import estimate_fields, fit_fields, print_fit
from flighttest.cli.actions.manoeuvres import (
    demand_options,
    read_instruments,
    read_noise,
    read_sourced_manoeuvres,
    read_windows_of_paths,
    windows_of_paths,
)
from flighttest.maximum_likelihood.fit_job import perform_fit_job
from flighttest.maximum_likelihood.fit_page import render_fit_page as page_of
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion
from flighttest.maximum_likelihood.result import save_output_error
from flighttest.maximum_likelihood.specification import read_specification
from flighttest.maximum_likelihood.validating.used_windows import (
    Model,
    ValidationWindow,
    digest_record,
    digest_states,
    state_windows,
)
from flighttest.reconstruction.dynamics.force_coefficients import select_time
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.reconstruction.quality.manoeuvre_faults import report_faults
from flighttest.regression.combining.data_partition import fit_bins
from flighttest.regression.combining.joined_fits import join_fits
from flighttest.regression.combining.mixed_estimation import mix_with_prior, prior_of
from flighttest.regression.equation_error.fit_file import open_fit, save_fit
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.errors_in_variables.instrumental_variables import regress_instrumental
from flighttest.regression.errors_in_variables.total_least_squares import regress_total
from flighttest.regression.model_structure.best_prediction import select_by_prediction
from flighttest.regression.model_structure.candidates import monomials
from flighttest.regression.model_structure.search import select_orthogonal, select_stepwise
from flighttest.remarks import is_forbidden, remarks_to_json
from flighttest.submodels.aircraft_properties.inertia import inertia_from_flight

_WAYS_TO_SELECT: dict[str, Callable[..., Any]] = {
    "prediction": select_by_prediction,
    "orthogonal": select_orthogonal,
    "stepwise": select_stepwise,
}


def run_fit(
    ctx: click.Context,
    fit_file: str,
    output: str | None,
    page: str | None,
    database: str | None,
    process_noise: str | None,
    angle: str | None,
    scale: float | None,
    as_json: bool,
) -> None:
    """Perform the command ``fit``."""
    specification = read_specification(fit_file).with_process_noise(process_noise, angle, scale)
    if specification.process_noise.needs_angle:
        raise click.UsageError("gusts need --angle vane or --angle inertial: who measured it")
    method = "output error" if specification.process_noise.kind == "none" else "filter error"
    with show_progress(f"estimate parameters by {method}"):
        done = perform_fit_job(specification)
    files: list[str] = []
    left: list[str] = []
    if output:
        save_output_error(done.fit, output)
        files.append(output)
    if page:
        write_text(page, page_of(done))
        files.append(page)
    if database:
        left = done.write_database(database)
        files.append(database)
    if as_json:
        print_json({**done.as_dict(), "files": files, "not_in_the_database": left})
    else:
        click.echo(done.report())
        for file in files:
            click.echo(f"written: {file}")
        if left:
            click.echo(f"not in the database: {' '.join(left)}")
    ctx.exit(1 if is_forbidden([*done.fit.remarks, *done.remarks]) else 0)


def run_fit_linear(
    ctx: click.Context,
    paths: tuple[str, ...],
    motion: str,
    windows: tuple[tuple[float, float], ...],
    own_windows: tuple[tuple[str, float, float], ...],
    disturbance: str,
    angle: str | None,
    scale: float | None,
    constraints: tuple[str, ...],
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``fit-linear``."""
    if disturbance in ("gusts", "both") and not angle:
        raise click.UsageError("gusts need --angle vane or --angle inertial: who measured it")
    if scale is not None and not scale > 0.0:
        raise click.UsageError(f"--scale is {scale:g}; give a positive length in metres")
    if windows and len(paths) > 1:
        raise click.UsageError(f"{len(paths)} paths and --window; windows are those of one path")
    by_path = windows_of_paths(paths, windows, own_windows)
    records, names, used = [], [], []
    for path, spans in zip(paths, by_path, strict=True):
        states = open_states(path)
        digest = digest_states(states) if output else ""
        chosen: list[tuple[float, float] | None] = [*spans] or [None]
        for window in chosen:
            part = states if window is None else select_time(states, *window)
            records.append(part)
            names.append(Path(path).name)
            used.append(ValidationWindow(Path(path).stem, part, digest))
    report_faults(records, names)
    with show_progress(f"estimate the {motion} motion"):
        done = fit_motion(
            records,
            motion,
            disturbance,
            angle=angle or "",
            scale=scale,
            constraints=constraints,
        )
    if output:
        save_output_error(state_windows(done.fit, used), output)
    if as_json:
        print_json({**done.as_dict(), "file": output})
    else:
        click.echo(done.report())
        if output:
            click.echo(f"written: {output}")
    ctx.exit(1 if is_forbidden(done.remarks) else 0)


def run_identify(
    ctx,
    paths,
    aircraft_file,
    model_text,
    windows,
    own_windows,
    errors,
    cutoff,
    band,
    intercepts,
    weights,
    ridge,
    prior,
    method,
    noises,
    instrument_files,
    constraints,
    output,
    correlation,
    as_json,
) -> None:
    """Perform the command ``identify``."""
    model = RegressionModel.parse(model_text)
    demand_options(
        method,
        band,
        weights,
        ridge=ridge,
        prior=prior,
        noises=noises,
        instrument_files=instrument_files,
        constraints=constraints,
    )
    if instrument_files and len(instrument_files) != len(paths):
        raise SchemaError(
            "flight identify",
            [f"{len(instrument_files)} --instruments for {len(paths)} paths; give one for each"],
        )
    manoeuvres, sources = read_sourced_manoeuvres(
        paths, aircraft_file, windows, cutoff=cutoff, own_windows=own_windows, errors=errors
    )
    with show_progress(f"estimate {model}"):
        if method == "iv":
            instruments = read_instruments(instrument_files, aircraft_file, sources)
            fit = regress_instrumental(
                model,
                manoeuvres,
                intercepts=intercepts,
                instruments=instruments,
                constraints=constraints,
            )
        elif method == "tls":
            fit = regress_total(
                model,
                manoeuvres,
                read_noise(noises),
                intercepts=intercepts,
                constraints=constraints,
            )
        else:
            fit = _fit(
                model,
                manoeuvres,
                band,
                intercepts=intercepts,
                weights=weights,
                ridge=_ridge(ridge),
                constraints=constraints,
            )
    joined, remarks = None, fit.remarks
    if prior:
        joined = mix_with_prior(fit, prior_of(fit, aerodb.open(prior)))
        # The prior decides the sign of its terms: `joined` has its own remark on it.
        in_prior = joined.estimates["term"].values[np.isfinite(joined.estimates["prior"].values)]
        terms_in_prior = set(map(str, in_prior))
        remarks = [r for r in remarks if r.kind != "sign" or r.term not in terms_in_prior]
    if output:
        save_fit(_with_windows(fit, paths, manoeuvres, sources), output)
    if as_json:
        document = {**fit_fields(fit), "remarks": remarks_to_json(remarks)}
        if joined is not None:
            fields = estimate_fields(joined.estimates)
            document["with_prior"] = {**fields, "remarks": remarks_to_json(joined.remarks)}
        print_json({**document, "file": output})
    else:
        print_fit(fit, remarks, correlation)
        if joined is not None:
            click.echo(f"\n{joined.report()}")
        if output:
            click.echo(f"written: {output}")
    if joined is not None:
        remarks = [*remarks, *joined.remarks]
    ctx.exit(1 if is_forbidden(remarks) else 0)


def run_select(
    ctx,
    paths,
    aircraft_file,
    coefficient,
    variables,
    order,
    terms,
    method,
    keep,
    free,
    constraints,
    windows,
    own_windows,
    errors,
    cutoff,
    band,
    output,
    correlation,
    as_json,
) -> None:
    """Perform the command ``select``."""
    if not variables and not terms:
        raise SchemaError(
            "flight select", ["no candidates: give --variables, or --term once for each"]
        )
    candidates = [*monomials(variables.split(), order), *terms] if variables else ["1", *terms]
    manoeuvres, sources = read_sourced_manoeuvres(
        paths, aircraft_file, windows, cutoff=cutoff, own_windows=own_windows, errors=errors
    )
    with show_progress(f"select among {len(candidates)} candidates"):
        found = _WAYS_TO_SELECT[method](
            coefficient,
            [*candidates, *keep],
            manoeuvres,
            band=band,
            keep=("1", *keep),
            hierarchy=not free,
            constraints=constraints,
        )
    if output:
        save_fit(_with_windows(found.fit, paths, manoeuvres, sources), output)
    if as_json:
        print_json(
            {
                "method": found.method,
                "steps": found.steps,
                "idle": found.idle,
                "models": found.models,
                **fit_fields(found.fit),
                "file": output,
            }
        )
    else:
        click.echo(found.report(correlation))
        if output:
            click.echo(f"written: {output}")
    ctx.exit(1 if is_forbidden(found.fit.remarks) else 0)


def run_join(fits, method, as_json) -> None:
    """Perform the command ``join``."""
    found = join_fits([open_fit(file) for file in fits], method)
    if as_json:
        print_json(
            {
                **found.estimates.attrs,
                **estimate_fields(found.estimates),
                "remarks": remarks_to_json(found.remarks),
            }
        )
        return
    click.echo(found.report())


def run_partition(paths, aircraft_file, model_text, conditions, windows, cutoff, as_json) -> None:
    """Perform the command ``partition``."""
    edges = {name: _edges(name, text) for name, text in conditions}
    manoeuvres = read_windows_of_paths(paths, aircraft_file, windows, cutoff)
    with show_progress(f"estimate {model_text} bin by bin"):
        found = fit_bins(RegressionModel.parse(model_text), manoeuvres, edges)
    if as_json:
        e = found.estimates
        columns = [name for name in e.data_vars if e[name].dims == ("bin",)]
        bins = []
        for k in range(e.sizes["bin"]):
            row = {str(name): e[name].values[k] for name in columns}
            for name in ("estimate", "stderr"):
                row[name] = e[name].values[k]
            bins.append({**row, "refused": found.refused.get(k, "")})
        print_json({"model": str(found.model), "terms": e["term"].values, "bins": bins})
        return
    click.echo(found.report())


def run_inertia(ctx, paths, aircraft_file, models, scale, windows, cutoff, as_json) -> None:
    """Perform the command ``inertia``."""
    parsed = {model.coefficient: model for model in map(RegressionModel.parse, models)}
    parts = []
    for path in paths:
        states = open_states(path)
        parts += [select_time(states, *window) for window in windows] or [states]
    with show_progress("estimate moments of inertia"):
        found = inertia_from_flight(parts, read_aircraft(aircraft_file), parsed, scale, cutoff)
    if as_json:
        print_json(
            {
                **found.estimates.attrs,
                **estimate_fields(found.estimates),
                "remarks": remarks_to_json(found.remarks),
            }
        )
    else:
        click.echo(found.report())
    ctx.exit(1 if is_forbidden(found.remarks) else 0)


def _with_windows(
    fit: Model, paths: Sequence[str], manoeuvres: Sequence[xr.Dataset], sources: Sequence[int]
) -> Model:
    """Return a fit with the windows that it has used, for a validation on other windows."""
    digests = [digest_record(path) for path in paths]
    used = []
    for data, number in zip(manoeuvres, sources, strict=True):
        used.append(ValidationWindow(Path(paths[number]).stem, data, digests[number]))
    return state_windows(fit, used)


def _fit(model, manoeuvres, band, intercepts, weights, ridge, constraints=()):
    """Return the fit in time, or in frequency if a band is given."""
    if band is None:
        return regress(
            model,
            manoeuvres,
            intercepts=intercepts,
            weights=weights,
            ridge=ridge,
            constraints=constraints,
        )
    if weights != "equal":
        raise SchemaError(
            "flight identify", ["--weights goes with a fit in time; leave out --band"]
        )
    return regress_frequency(
        model, manoeuvres, band, intercepts=intercepts, ridge=ridge, constraints=constraints
    )


def _ridge(text: str) -> float | str:
    try:
        return text if text == "auto" else float(text)
    except ValueError:
        raise SchemaError(
            "flight identify", [f"--ridge is {text!r}; expected a number or auto"]
        ) from None


def _edges(name: str, text: str) -> list[float]:
    """Numbers with one unit at the end, or in SI."""

    words, units = text.split(), lookup(name).units
    try:
        float(words[-1])
    except ValueError:
        unit = words.pop()
    except IndexError:
        raise SchemaError(
            "flight partition",
            [f"no edges of {name}; expected numbers and a unit, as '0 5 10 deg'"],
        ) from None
    else:
        unit = units
    try:
        return [float(to_si(float(word), unit, units)) for word in words]
    except ValueError:
        raise SchemaError(
            "flight partition",
            [f"edges of {name} are {text!r}; expected numbers and a unit, as '0 5 10 deg'"],
        ) from None
