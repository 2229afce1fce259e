"""Functions that perform the commands of `flighttest.cli.identify`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

import aerodb
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    collect_options,
    print_json,
    print_remark,
    show_progress,
)
from flightmech.units import to_si
from flighttest.cli.actions.estimators import EstimatorOptions
from flighttest.cli.actions.fit_output import estimate_fields, fit_fields, print_fit
from flighttest.cli.actions.manoeuvres import ManoeuvreOptions, assign_windows
from flighttest.maximum_likelihood.fit_job import perform_fit_job
from flighttest.maximum_likelihood.fit_page import render_fit_page as page_of
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion
from flighttest.maximum_likelihood.result import save_output_error
from flighttest.maximum_likelihood.specification import read_specification
from flighttest.maximum_likelihood.validating.used_windows import (
    ValidationWindow,
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
from flighttest.regression.equation_error.model import RegressionModel
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
    kind = specification.process_noise.kind
    _demand_gusts("--process-noise", kind, {"--angle": angle, "--scale": scale})
    if specification.process_noise.needs_angle:
        raise click.UsageError("gusts need --angle vane or --angle inertial: who measured it")
    method = "output error" if kind == "none" else "filter error"
    with show_progress(f"estimate parameters by {method}"):
        done = perform_fit_job(specification)
    for text in done.unreproduced():
        print_remark(f"warning: {text}")
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


def _demand_gusts(option: str, kind: str, values: dict[str, Any]) -> None:
    """Raise UsageError if options that only gusts use are given with another disturbance."""
    given = [name for name, value in values.items() if value is not None]
    if given and kind not in ("gusts", "both"):
        raise click.UsageError(
            f"{', '.join(given)} with {option} {kind}: only gusts use it; give {option} gusts or "
            f"both"
        )


@dataclass(frozen=True)
class DisturbanceOptions:
    """Options of the disturbance of a linear motion.

    Attributes
    ----------
    disturbance : {"none", "process", "gusts", "both"}
    angle : {"vane", "inertial"} or None
        Source of alpha or beta; gusts need it.
    scale : float or None
        Scale of the gusts [m]; None if it is estimated.
    span : float
        Span by which the air of the gusts also rotates [m]; zero: it does not.
    """

    disturbance: str
    angle: str | None
    scale: float | None
    span: float

    def check(self) -> None:
        """Raise UsageError for options that only gusts use, gusts without the source of the angle,
        and a wrong scale.
        """
        given = {"--angle": self.angle, "--scale": self.scale, "--span": self.span or None}
        _demand_gusts("--disturbance", self.disturbance, given)
        if self.disturbance in ("gusts", "both") and not self.angle:
            raise click.UsageError("gusts need --angle vane or --angle inertial: who measured it")
        if self.scale is not None and not self.scale > 0.0:
            raise click.UsageError(f"--scale is {self.scale:g}; give a positive length in metres")


@collect_options(gusts=DisturbanceOptions)
def run_fit_linear(
    ctx: click.Context,
    paths: tuple[str, ...],
    motion: str,
    gusts: DisturbanceOptions,
    windows: tuple[tuple[float, float], ...],
    own_windows: tuple[tuple[str, float, float], ...],
    constraints: tuple[str, ...],
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``fit-linear``."""
    gusts.check()
    if windows and len(paths) > 1:
        raise click.UsageError(f"{len(paths)} paths and --window; windows are those of one path")
    windows_by_path = assign_windows(paths, windows, own_windows)
    records, names, used = [], [], []
    for path, spans in zip(paths, windows_by_path, strict=True):
        states = open_states(path)
        digest = digest_states(states) if output else ""
        parts = [select_time(states, *window) for window in spans] or [states]
        for part in parts:
            records.append(part)
            names.append(Path(path).name)
            used.append(ValidationWindow(Path(path).stem, part, digest))
    report_faults(records, names)
    with show_progress(f"estimate the {motion} motion"):
        done = fit_motion(
            records,
            motion,
            gusts.disturbance,
            angle=gusts.angle or "",
            scale=gusts.scale,
            constraints=constraints,
            span=gusts.span,
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


@collect_options(source=ManoeuvreOptions, estimator=EstimatorOptions)
def run_identify(
    ctx: click.Context,
    source: ManoeuvreOptions,
    model_text: str,
    estimator: EstimatorOptions,
    output: str | None,
    correlation: bool,
    as_json: bool,
) -> None:
    """Perform the command ``identify``."""
    model = RegressionModel.parse(model_text)
    estimator.check(len(source.paths))
    manoeuvres = source.read()
    with show_progress(f"estimate {model}"):
        fit = estimator.fit(model, manoeuvres, source.aircraft_file)
    joined, remarks = None, fit.remarks
    if estimator.prior:
        joined = mix_with_prior(fit, prior_of(fit, aerodb.open(estimator.prior)))
        # The prior decides the sign of its terms: `joined` has its own remark on it.
        in_prior = joined.estimates["term"].values[np.isfinite(joined.estimates["prior"].values)]
        terms_in_prior = set(map(str, in_prior))
        remarks = [r for r in remarks if r.kind != "sign" or r.term not in terms_in_prior]
    if output:
        save_fit(state_windows(fit, manoeuvres.as_validation_windows()), output)
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


@dataclass(frozen=True)
class SelectionOptions:
    """Options of the selection of terms.

    Attributes
    ----------
    coefficient : str
    variables : str or None
        Variables whose products are candidates, separated by blanks.
    order : int
        Highest order of the products.
    terms : tuple of str
        Further candidates.
    method : {"prediction", "orthogonal", "stepwise"}
    keep : tuple of str
        Candidates that are in the model from the start.
    free : bool
        Whether a product may lack its factors, and a moment its damping.
    constraints : tuple of str
        Constraints among the parameters.
    band : (float, float) or None
        Band of a selection in frequency [Hz].
    """

    coefficient: str
    variables: str | None
    order: int
    terms: tuple[str, ...]
    method: str
    keep: tuple[str, ...]
    free: bool
    constraints: tuple[str, ...]
    band: tuple[float, float] | None

    def list_candidates(self) -> list[str]:
        """Return the candidates; raise SchemaError if no option names one."""
        if self.variables:
            return [*monomials(self.variables.split(), self.order), *self.terms]
        if not self.terms:
            raise SchemaError(
                "flight select", ["no candidates: give --variables, or --term once for each"]
            )
        return ["1", *self.terms]


@collect_options(source=ManoeuvreOptions, selection=SelectionOptions)
def run_select(
    ctx: click.Context,
    source: ManoeuvreOptions,
    selection: SelectionOptions,
    output: str | None,
    correlation: bool,
    as_json: bool,
) -> None:
    """Perform the command ``select``."""
    candidates = selection.list_candidates()
    manoeuvres = source.read()
    with show_progress(f"select among {len(candidates)} candidates"):
        result = _WAYS_TO_SELECT[selection.method](
            selection.coefficient,
            [*candidates, *selection.keep],
            manoeuvres.coefficients,
            band=selection.band,
            keep=("1", *selection.keep),
            hierarchy=not selection.free,
            constraints=selection.constraints,
        )
    if output:
        save_fit(state_windows(result.fit, manoeuvres.as_validation_windows()), output)
    if as_json:
        print_json(
            {
                "method": result.method,
                "steps": result.steps,
                "idle": result.idle,
                "models": result.models,
                **fit_fields(result.fit),
                "file": output,
            }
        )
    else:
        click.echo(result.report(correlation))
        if output:
            click.echo(f"written: {output}")
    ctx.exit(1 if is_forbidden(result.fit.remarks) else 0)


def run_join(fits, method, as_json) -> None:
    """Perform the command ``join``."""
    joined = join_fits([open_fit(file) for file in fits], method)
    if as_json:
        print_json(
            {
                **joined.estimates.attrs,
                **estimate_fields(joined.estimates),
                "remarks": remarks_to_json(joined.remarks),
            }
        )
        return
    click.echo(joined.report())


def run_partition(paths, aircraft_file, model_text, conditions, windows, cutoff, as_json) -> None:
    """Perform the command ``partition``."""
    edges = {name: _edges(name, text) for name, text in conditions}
    manoeuvres = ManoeuvreOptions(paths, aircraft_file, windows, cutoff).read()
    with show_progress(f"estimate {model_text} bin by bin"):
        partition = fit_bins(RegressionModel.parse(model_text), manoeuvres.coefficients, edges)
    if as_json:
        e = partition.estimates
        columns = [name for name in e.data_vars if e[name].dims == ("bin",)]
        bins = []
        for k in range(e.sizes["bin"]):
            row = {str(name): e[name].values[k] for name in columns}
            for name in ("estimate", "stderr"):
                row[name] = e[name].values[k]
            bins.append({**row, "refused": partition.refused.get(k, "")})
        print_json({"model": str(partition.model), "terms": e["term"].values, "bins": bins})
        return
    click.echo(partition.report())


def run_inertia(ctx, paths, aircraft_file, models, scale, windows, cutoff, as_json) -> None:
    """Perform the command ``inertia``."""
    parsed = {model.coefficient: model for model in map(RegressionModel.parse, models)}
    parts = []
    for path, spans in zip(paths, assign_windows(paths, windows), strict=True):
        states = open_states(path)
        parts += [select_time(states, *window) for window in spans] or [states]
    with show_progress("estimate moments of inertia"):
        moments = inertia_from_flight(parts, read_aircraft(aircraft_file), parsed, scale, cutoff)
    if as_json:
        print_json(
            {
                **moments.estimates.attrs,
                **estimate_fields(moments.estimates),
                "remarks": remarks_to_json(moments.remarks),
            }
        )
    else:
        click.echo(moments.report())
    ctx.exit(1 if is_forbidden(moments.remarks) else 0)


def _edges(name: str, text: str) -> list[float]:
    """Return the edges of the bins in SI from numbers, with one unit at the end or in SI."""
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
        edges = [float(to_si(float(word), unit, units)) for word in words]
    except ValueError:
        edges = []
    if not edges or not np.isfinite(edges).all():
        raise SchemaError(
            "flight partition",
            [f"edges of {name} are {text!r}; expected finite numbers and a unit, as '0 5 10 deg'"],
        )
    return edges
