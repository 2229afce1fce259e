"""Functions that perform the commands of `flighttest.cli.programme`."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchWarning
from flightmech.names import lookup
from flightmech.quantities import time_text
from flightmech.simulation.compiler import compile_files
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    collect_options,
    print_json,
    print_table,
    show_progress,
)
from flightmech.units import from_si
from flighttest.flight_programme.evaluation.flight_evaluation import evaluate_flight
from flighttest.flight_programme.evaluation.result import render_evaluation_page
from flighttest.flight_programme.input_design.design import Designed, design_input, save_design
from flighttest.flight_programme.input_design.predicted_response import Amplitude
from flighttest.flight_programme.input_design.specification import read_design
from flighttest.flight_programme.planning.catalogue import Catalogue, read_catalogue
from flighttest.flight_programme.planning.coverage import coverage_of, flights_of
from flighttest.flight_programme.planning.plan import plan_predicted_flights
from flighttest.flight_programme.planning.plan_files import read_order, save_plan
from flighttest.flight_programme.planning.prediction import predict, with_assumed
from flighttest.flight_programme.planning.wanted_rows import RowGradients, demand_rows, read_rows
from flighttest.reconstruction.flight_programme import reconstruct_programme
from flighttest.reconstruction.quality.assessment import assess
from flighttest.records.record import channel_leaves, read
from flighttest.records.signals.conditioning import cut
from flighttest.remarks import is_forbidden, remark_lines, remarks_to_json
from flighttest.submodels.aircraft_properties.eigenmotion import Eigenmotion, fit_motion


def run_design(
    design_file: str,
    aircraft_file: str | None,
    database_file: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``design``."""
    specification = read_design(design_file)
    model: tuple[Any, ...] = ()
    # Only a design with a condition predicts the response, which needs a model.
    if specification.condition is not None:
        if not aircraft_file or not database_file:
            raise click.UsageError(
                "the design has a [condition]: give --aircraft and --database, or leave the "
                "condition out"
            )
        model = (compile_files(aircraft_file, database_file), read_aircraft(aircraft_file))
    with show_progress("design the input"):
        design = design_input(specification, *model)
    files = save_design(design, output, Path(design_file).stem)
    if as_json:
        print_json({**design.summary(), "files": [str(file) for file in files]})
        return
    _print_inputs(design)
    if design.amplitude is not None:
        _print_response(design.amplitude)
    for expected in design.expected:
        click.echo(f"\n{expected.report()}")
    for file in files:
        click.echo(f"written: {file}")


def _print_inputs(design: Designed) -> None:
    """Print size, rate, band and correlation of the input of each axis."""
    headings = ["axis", "peak", "rms", "unit", "rate /s", "peak factor", "band [Hz]", "correlation"]
    has_factors = design.amplitude is not None
    if has_factors:
        headings.insert(1, "factor")
    rows = []
    for axis, measures in design.measures.iterrows():
        name = str(axis)
        row = [
            name,
            _in_display_units(name, measures["peak"]),
            _in_display_units(name, measures["rms"]),
            lookup(name).display_units,
            _in_display_units(name, measures["rate"]),
            f"{measures['peak_factor']:.3f}",
            f"{measures['low']:.2f} ... {measures['high']:.2f}",
            "-",
        ]
        # The axis with the largest correlation; a single axis has none.
        if measures["with"]:
            row[-1] = f"{measures['correlation']:.1e} {measures['with']}"
        if has_factors:
            row.insert(1, f"{measures['factor']:.3f}")
        rows.append(row)
    right = ["factor", "peak", "rms", "rate /s", "peak factor"]
    print_table(headings, rows, design.title, right=right)


def _print_response(amplitude: Amplitude) -> None:
    """Print the extremes of the predicted response, and the limit of a larger input."""
    extremes = amplitude.extremes
    rows = []
    for name, row in zip(extremes.index, extremes.values):
        quantity = str(name).removeprefix("applied.")
        rows.append((name, *(_in_display_units(quantity, value) for value in row)))
    click.echo()
    title = f"predicted response; each axis fitted alone, then all times {amplitude.scale:.3f}"
    print_table(["response", *extremes.columns], rows, title, right=list(extremes.columns))
    if amplitude.binding:
        click.echo(f"a larger input: {amplitude.binding}")
    else:
        click.echo("together they reach no limit")


def _in_display_units(name: str, value: float) -> str:
    """Return a value in the units in which its quantity is printed."""
    return f"{float(from_si(value, lookup(name).display_units)):.4g}"


def run_plan(
    catalogue_file: str,
    aircraft_file: str,
    database_file: str,
    rows_file: str | None,
    draws: int,
    jobs: int,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``plan``."""
    catalogue = read_catalogue(catalogue_file)
    aircraft, database = read_aircraft(aircraft_file), aerodb.open(database_file)
    rows = _read_rows(rows_file, catalogue, database)
    sim = flightmech.compile(aircraft, with_assumed(database, catalogue))
    with show_progress(
        f"fly {len(catalogue.flyable())} manoeuvres at {len(catalogue.condition)} conditions "
        f"on the a-priori model"
    ):
        prediction = predict(catalogue, sim, aircraft, jobs)
    with show_progress("choose the manoeuvres"):
        plan = plan_predicted_flights(prediction, database, rows=rows, draws=draws)
    files = save_plan(plan, output)
    if as_json:
        print_json({**plan.summary(), "files": [str(file) for file in files]})
        return
    click.echo(plan.report())
    click.echo(f"written: {output}")


def run_coverage(
    catalogue_file: str,
    record_files: tuple[str, ...],
    plan_folder: str,
    aircraft_file: str,
    database_file: str,
    names: str | None,
    rows_file: str | None,
    jobs: int,
    as_json: bool,
) -> None:
    """Perform the command ``coverage``."""
    catalogue = read_catalogue(catalogue_file)
    aircraft, database = read_aircraft(aircraft_file), aerodb.open(database_file)
    planned = read_order(plan_folder)
    rows = _read_rows(rows_file, catalogue, database)
    with show_progress(f"read and reconstruct {len(record_files)} records"):
        records = {Path(file).name.split(".")[0]: read(file, names) for file in record_files}
        reconstructed = reconstruct_programme(list(records.values()), aircraft, jobs=jobs)
        paths = dict(zip(records, reconstructed, strict=True))
    with show_progress("fit what is flown, predict and choose what is not"):
        flights = flights_of(catalogue, records, paths, aircraft)
        coverage = coverage_of(
            catalogue, planned, flights, aircraft=aircraft, database=database, jobs=jobs, rows=rows
        )
    if as_json:
        print_json(coverage.summary())
    else:
        click.echo(coverage.report())


def _read_rows(
    rows_file: str | None, catalogue: Catalogue, database: xr.DataTree
) -> list[RowGradients]:
    """Return the gradients of the wanted rows; a row without its gradients is an error."""
    rows = [] if rows_file is None else read_rows(rows_file, catalogue, database)
    # The prediction of the flights takes minutes, so the rows are checked before.
    demand_rows(catalogue, rows)
    return rows


def report_flight(
    ctx: click.Context, plan_file: str, output: str | None, folder: str | None, as_json: bool
) -> None:
    """Perform the command ``report``."""
    with show_progress("evaluate the flight"):
        evaluation = evaluate_flight(plan_file)
    files = [str(file) for file in evaluation.save(folder)] if folder else []
    if output:
        write_text(output, render_evaluation_page(evaluation))
        files.append(output)
    if as_json:
        print_json({**evaluation.as_dict(), "files": files})
    else:
        click.echo(evaluation.report())
        for file in files:
            click.echo(f"written: {file}")
    ctx.exit(0 if evaluation.passed else 1)


@dataclass(frozen=True)
class ModeOptions:
    """Options of a mode of motion and of the window in which it is fitted.

    Attributes
    ----------
    start, stop : float
        Window [s].
    channels : tuple of str
        Channels that show the mode.
    inputs : tuple of str
        Controls that move in the window.
    aperiodic : bool
        Whether the mode has a real root in place of an oscillation.
    level : bool
        Whether a constant lies under each channel, in place of a straight line.
    """

    start: float
    stop: float
    channels: tuple[str, ...]
    inputs: tuple[str, ...]
    aperiodic: bool
    level: bool


@collect_options(options=ModeOptions)
def run_modes(
    ctx: click.Context,
    record_file: str,
    names: str | None,
    options: ModeOptions,
    as_json: bool,
) -> None:
    """Perform the command ``modes``."""
    with show_progress("read and check the record"):
        record = read(record_file, names)
        quality = assess(record)
    used = {*options.channels, *options.inputs}
    for finding in quality.findings:
        if finding.severity == "error" and used.intersection(finding.channels):
            warnings.warn(f"{finding.name}: {finding.text}", AeromatchWarning, stacklevel=1)
    # All channels get the lowest of their own rates.
    leaves = channel_leaves(record)
    rates = [float(record[leaves[name]].attrs["rate"]) for name in used if name in leaves]
    data = cut(record, options.start, options.stop, rate=min(rates, default=50.0))
    kind = "aperiodic" if options.aperiodic else "oscillation"
    with show_progress("fit the motion"):
        motion = fit_motion(data, options.channels, kind, options.inputs, not options.level)
    if as_json:
        print_json(_mode_document(motion, options))
    else:
        _print_mode(motion, options)
    ctx.exit(1 if is_forbidden(motion.remarks) else 0)


def _mode_document(motion: Eigenmotion, options: ModeOptions) -> dict[str, Any]:
    """Return a fitted mode for JSON."""
    values = {}
    for name, row in motion.values.items():
        values[name] = dict(zip(("value", "stderr", "unit"), row))
    return {
        "kind": motion.kind,
        "channels": options.channels,
        "inputs": options.inputs,
        "share": motion.share,
        **values,
        "F": motion.F,
        "F_terms": motion.F_terms,
        "F_dof": motion.F_dof,
        "F_probability": motion.F_probability,
        "convergence": motion.convergence.as_dict(),
        "remarks": remarks_to_json(motion.remarks),
    }


def _print_mode(motion: Eigenmotion, options: ModeOptions) -> None:
    """Print a fitted mode, its F test and its remarks."""
    rows = []
    for name, (value, stderr, unit) in motion.values.items():
        rows.append((name, f"{value:.5g}", f"{stderr:.2g}", "" if unit == "1" else unit))
    title = (
        f"{motion.kind} in {' '.join(options.channels)}, {time_text(options.start)} ... "
        f"{time_text(options.stop)} s, "
        f"{motion.share:.1%} of the movement explained"
    )
    right = ["estimate", "std error"]
    print_table(["figure", "estimate", "std error", "unit"], rows, title, right=right)
    click.echo(
        f"amplitudes: F({motion.F_terms}, {motion.F_dof:.0f}) {motion.F:.4g}, probability "
        f"{motion.F_probability:.2g}"
    )
    for line in remark_lines(motion.remarks):
        click.echo(line)
