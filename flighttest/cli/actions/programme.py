"""Functions that perform the commands of `flighttest.cli.programme`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import click
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchWarning
from flightmech.names import lookup
from flightmech.simulation.compiler import compile_files
from flightmech.support.atomic_write import write_text
from flightmech.support.console import (
    print_json,
    print_table,
    show_progress,
)
from flightmech.units import from_si
from flighttest.flight_programme.evaluation.flight_evaluation import evaluate_flight
from flighttest.flight_programme.evaluation.result import render_evaluation_page
from flighttest.flight_programme.input_design.design import Designed, design_input, save_design
from flighttest.flight_programme.input_design.specification import read_design
from flighttest.flight_programme.planning.catalogue import Catalogue, read_catalogue
from flighttest.flight_programme.planning.coverage import coverage_of, flights_of
from flighttest.flight_programme.planning.plan import plan_predicted_flights
from flighttest.flight_programme.planning.plan_files import read_order, save_plan
from flighttest.flight_programme.planning.prediction import predict, with_assumed
from flighttest.flight_programme.planning.wanted_rows import RowGradients, demand_rows, read_rows
from flighttest.reconstruction.flight_programme import reconstruct_programme
from flighttest.reconstruction.quality.assessment import assess
from flighttest.records.record import channel_leaves as homes
from flighttest.records.record import read
from flighttest.records.signals.conditioning import cut
from flighttest.remarks import is_forbidden, remark_lines, remarks_to_json
from flighttest.submodels.aircraft_properties.eigenmotion import fit_motion


def run_design(
    design_file: str,
    aircraft_file: str | None,
    database_file: str | None,
    output: str,
    as_json: bool,
) -> None:
    """Perform the command ``design``."""
    wanted = read_design(design_file)
    if wanted.condition is None:
        with show_progress("design the input"):
            made = design_input(wanted)
    elif aircraft_file and database_file:
        with show_progress("design the input"):
            made = design_input(
                wanted, compile_files(aircraft_file, database_file), read_aircraft(aircraft_file)
            )
    else:
        raise click.UsageError(
            "the design has a [condition]: give --aircraft and --database, or leave the "
            "condition out"
        )
    files = save_design(made, output, Path(design_file).stem)
    if as_json:
        print_json({**made.summary(), "files": [str(file) for file in files]})
        return
    _print(made)
    for file in files:
        click.echo(f"written: {file}")


def _print(made: Designed) -> None:

    def shown(name: str, value: float) -> str:
        return f"{float(from_si(value, lookup(name).display_units)):.4g}"

    limited = made.amplitude is not None
    rows: list[tuple[Any, ...]] = []
    for name, m in made.measures.iterrows():
        peak, rms, rate = (shown(str(name), m[key]) for key in ("peak", "rms", "rate"))
        nearest = f"{m['correlation']:.1e} {m['with']}" if m["with"] else "-"
        numbers = (
            peak,
            rms,
            lookup(str(name)).display_units,
            rate,
            f"{m['peak_factor']:.3f}",
            f"{m['low']:.2f} ... {m['high']:.2f}",
            nearest,
        )
        rows.append((name, *([f"{m['factor']:.3f}"] if limited else []), *numbers))
    heads = [
        "axis",
        *(["factor"] if limited else []),
        "peak",
        "rms",
        "unit",
        "rate /s",
        "peak factor",
        "band [Hz]",
        "correlation",
    ]
    print_table(heads, rows, made.title, right=["factor", "peak", "rms", "rate /s", "peak factor"])
    if made.amplitude is not None:
        extremes = made.amplitude.extremes
        lines = []
        for name, row in zip(extremes.index, extremes.values):
            quantity = str(name).removeprefix("applied.")
            lines.append((name, *(shown(quantity, value) for value in row)))
        click.echo()
        title = (
            f"predicted response; each axis fitted alone, then all times {made.amplitude.scale:.3f}"
        )
        print_table(["response", *extremes.columns], lines, title, right=list(extremes.columns))
        click.echo(
            f"a larger input: {made.amplitude.binding}"
            if made.amplitude.binding
            else "together they reach no limit"
        )
    for expected in made.expected:
        click.echo(f"\n{expected.report()}")


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
    catalogue, aircraft, database = (
        read_catalogue(catalogue_file),
        flightmech.read_aircraft(aircraft_file),
        aerodb.open(database_file),
    )
    rows = _read_rows(rows_file, catalogue, database)
    sim = flightmech.compile(aircraft, with_assumed(database, catalogue))
    with show_progress(
        f"fly {len(catalogue.flyable())} manoeuvres at {len(catalogue.condition)} conditions "
        f"on the a-priori model"
    ):
        prediction = predict(catalogue, sim, aircraft, jobs)
    with show_progress("choose the manoeuvres"):
        found = plan_predicted_flights(prediction, database, rows=rows, draws=draws)
    files = save_plan(found, output)
    if as_json:
        print_json({**found.summary(), "files": [str(file) for file in files]})
        return
    click.echo(found.report())
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
    catalogue, aircraft, database = (
        read_catalogue(catalogue_file),
        flightmech.read_aircraft(aircraft_file),
        aerodb.open(database_file),
    )
    planned = read_order(plan_folder)
    rows = _read_rows(rows_file, catalogue, database)
    with show_progress(f"read and reconstruct {len(record_files)} records"):
        records = {Path(file).name.split(".")[0]: read(file, names) for file in record_files}
        paths = dict(
            zip(
                records,
                reconstruct_programme(list(records.values()), aircraft, jobs=jobs),
                strict=True,
            )
        )
    with show_progress("fit what is flown, predict and choose what is not"):
        flights = flights_of(catalogue, records, paths, aircraft)
        found = coverage_of(
            catalogue, planned, flights, aircraft=aircraft, database=database, jobs=jobs, rows=rows
        )
    if as_json:
        print_json(found.summary())
    else:
        click.echo(found.report())


def _read_rows(
    rows_file: str | None, catalogue: Catalogue, database: xr.DataTree
) -> list[RowGradients]:
    """Return the gradients of the wanted rows; a row without its gradients is an error."""
    rows = [] if rows_file is None else read_rows(rows_file, catalogue, database)
    # before the flights are predicted, which takes minutes
    demand_rows(catalogue, rows)
    return rows


def report_flight(
    ctx: click.Context, plan_file: str, output: str | None, folder: str | None, as_json: bool
) -> None:
    """Perform the command ``report``."""
    with show_progress("evaluate the flight"):
        found = evaluate_flight(plan_file)
    files = [str(file) for file in found.save(folder)] if folder else []
    if output:
        write_text(output, render_evaluation_page(found))
        files.append(output)
    if as_json:
        print_json({**found.as_dict(), "files": files})
    else:
        click.echo(found.report())
        for file in files:
            click.echo(f"written: {file}")
    ctx.exit(0 if found.passed else 1)


def run_modes(
    ctx, record_file, start, stop, names, channels, inputs, aperiodic, level, as_json
) -> None:
    """Perform the command ``modes``."""
    with show_progress("read and check the record"):
        record = read(record_file, names)
        quality = assess(record)
    home = homes(record)
    rates = [
        float(record[home[name]].attrs["rate"]) for name in (*channels, *inputs) if name in home
    ]
    for finding in quality.findings:
        if finding.severity == "error" and set(finding.channels) & {*channels, *inputs}:
            warnings.warn(f"{finding.name}: {finding.text}", AeromatchWarning, stacklevel=1)
    data = cut(record, start, stop, rate=min(rates, default=50.0))
    with show_progress("fit the motion"):
        found = fit_motion(
            data, channels, "aperiodic" if aperiodic else "oscillation", inputs, not level
        )
    test = {
        "F": found.F,
        "F_terms": found.F_terms,
        "F_dof": found.F_dof,
        "F_probability": found.F_probability,
    }
    if as_json:
        values = {
            name: dict(zip(("value", "stderr", "unit"), row)) for name, row in found.values.items()
        }
        print_json(
            {
                "kind": found.kind,
                "channels": channels,
                "inputs": inputs,
                "share": found.share,
                **values,
                **test,
                "convergence": found.convergence.as_dict(),
                "remarks": remarks_to_json(found.remarks),
            }
        )
        ctx.exit(1 if is_forbidden(found.remarks) else 0)
    rows = [
        (name, f"{value:.5g}", f"{stderr:.2g}", "" if unit == "1" else unit)
        for name, (value, stderr, unit) in found.values.items()
    ]
    title = (
        f"{found.kind} in {' '.join(channels)}, {start:g} ... {stop:g} s, {found.share:.1%} "
        f"of the movement explained"
    )
    print_table(
        ["figure", "estimate", "std error", "unit"], rows, title, right=["estimate", "std error"]
    )
    click.echo(
        f"amplitudes: F({found.F_terms}, {found.F_dof:.0f}) {found.F:.4g}, probability "
        f"{found.F_probability:.2g}"
    )
    for line in remark_lines(found.remarks):
        click.echo(line)
    ctx.exit(1 if is_forbidden(found.remarks) else 0)
