"""Functions that perform the commands of `flighttest.cli.submodels`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import h5py
import numpy as np
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.propulsion.engine_deck import open_tables
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError
from flightmech.support.console import print_json, show_progress
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flightmech.units import parse_quantity
from flighttest.cli.actions.propeller import run_propeller
from flighttest.cli.submodels import _MODELS
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.reconstruction.dynamics.saved_paths import open_path, open_states
from flighttest.reconstruction.flight_programme import open_biases
from flighttest.records.record import marked_manoeuvres, read
from flighttest.records.sensors.instruments import pick_up_errors
from flighttest.records.signals.conditioning import cut_whole
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.actuators.figure import draw_actuator
from flighttest.submodels.actuators.identification import identify_actuator, read_bench_log
from flighttest.submodels.control_loading.hinge_terms import replace_hinge_moments
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading, loading_of
from flighttest.submodels.control_loading.motion import driven_and_free
from flighttest.submodels.engine.records import engine_channels, read_points
from flighttest.submodels.engine.result import comparison_text, identify_engine
from flighttest.submodels.engine.static_thrust import Polar
from flighttest.submodels.engine.tables import EngineStructure, read_structure
from flighttest.submodels.ground_effect.database_terms import replace_ground_effect
from flighttest.submodels.ground_effect.identification import identify_ground_effect
from flighttest.submodels.landing_gear.identification import identify_landing_gear
from flighttest.submodels.landing_gear.reconstructed_loads import GroundRecord
from flighttest.submodels.stall.database_terms import add_stall, continue_attached_flow, reach_of
from flighttest.submodels.stall.figure import draw_stall
from flighttest.submodels.stall.identification import identify_stall
from flighttest.submodels.stall.model import demand_attached


def run_actuator(
    logs,
    command_column,
    position,
    rate,
    torque,
    gear,
    held,
    no_delay,
    no_limits,
    band,
    inertia,
    inertia_stderr,
    channel,
    figure,
    as_json,
) -> None:
    """Perform the command ``actuator``."""
    options = {"command": command_column, "position": position, "rate": rate, "torque": torque}
    columns = {name: column for name, column in options.items() if column}
    with show_progress(f"read {len(logs)} log{'s' if len(logs) > 1 else ''}"):
        records = [read_bench_log(path, columns) for path in logs]
    with show_progress("identify the actuator"):
        found = identify_actuator(
            records, gear, not no_limits, delay=not no_delay, held=held, band=band
        )
    if figure:
        draw_actuator(found, figure)
    absolute = {}
    if inertia is not None:
        absolute = found.with_inertia(inertia, inertia_stderr)
    entry = ""
    # Only a servo, which has a stiffness, gives a position for its command.
    if found.structure.stiffness:
        column = (command_column or "command").partition("[")[0].strip()
        entry = found.channel(channel, column)
    if as_json:
        coefficients_by_name = {name: vars(value) for name, value in absolute.items()}
        document = {"with_inertia": coefficients_by_name, "channel": entry, "figure": figure}
        print_json(found.as_dict() | document)
        return
    click.echo(found.report())
    if absolute:
        click.echo("\nwith the known inertia:")
        for name, value in absolute.items():
            click.echo(f"  {name:4s} {value}")
    if entry:
        click.echo(f"\nin the name map of a flight log that records the command:\n\n{entry}")
    if figure:
        click.echo(f"\nwritten: {figure}")


def run_controls(
    paths,
    free_files,
    records,
    free_names,
    prior,
    aircraft_file,
    item,
    model,
    constants,
    arm,
    over,
    order,
    method,
    output,
    database_file,
    into,
    as_json,
) -> None:
    """Perform the command ``controls``."""
    problems = []
    if bool(database_file) != bool(into):
        problems.append("--database and --into go together; give both or none")
    if bool(records) != bool(free_names):
        problems.append("--records and --free-manoeuvre go together; give both or none")
    aircraft = read_aircraft(aircraft_file)
    if prior is not None and item not in aircraft.circuits:
        problems.append(f"--prior needs [circuit.{item}] in {aircraft_file}; it is missing")
    if problems:
        raise SchemaError("flight controls", problems)
    loading: ControlLoading = loading_of(
        aircraft, item, model, constants=constants, arm=arm, over=_table_nodes(over)
    )
    driven = [open_states(path) for path in paths]
    free = [open_states(path) for path in free_files]
    if records:
        flights, driven = driven, []
        for flight, path in zip(flights, paths):
            record = Path(records) / Path(path).name
            driven_parts, free_parts = _divide_record(flight, record, free_names)
            driven += driven_parts
            free += free_parts
    drawings = {}
    if prior is not None:
        drawings = {"drawings": aircraft.circuits[item], "drawings_error": prior}
    with show_progress(f"identify the loading of the {item}"):
        found = identify_control_loading(
            loading,
            driven,
            free,
            int(order),
            errors=pick_up_errors(aircraft.instruments),
            method=method,
            **drawings,
        )
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if into:
        aerodb.save(replace_hinge_moments(aerodb.open(database_file), found), into)
    if as_json:
        print_json(found.as_dict() | {"file": output})
        return
    click.echo(found.report())
    for file in filter(None, (output, into)):
        click.echo(f"written: {file}")


def _table_nodes(text: str) -> tuple[str, tuple[float, ...]] | None:
    """Return variable and nodes of ``mach 0.2 0.5``; None for an empty text."""
    if not text:
        return None
    name, *numbers = text.replace(",", " ").split()
    try:
        return name, tuple(map(float, numbers))
    except ValueError:
        problem = f"--over is {text!r}; give a variable and its nodes, such as 'mach 0.2 0.5'"
        raise SchemaError("flight controls", [problem]) from None


def _divide_record(
    states: xr.Dataset, record: Path, free_names: Sequence[str]
) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return the driven stretches of a record and its free motion.

    A record without a manoeuvre of these names is driven.
    """
    demand_self_contained(record)
    with (
        decoding_errors(record, "a flight record, netCDF-4"),
        xr.open_datatree(
            record, engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as tree,
    ):
        listed = marked_manoeuvres(tree)
    if set(free_names) & set(listed["manoeuvre"]):
        return driven_and_free(states, listed, free_names)
    return [states], []


def run_engine(
    power_changes, names, whole, structure_file, compared, starts, points_file, climbs_file,
    prior_file, aircraft_file, polar, polar_stderr, area, numbers, pla, rate, output, as_json,
):  # fmt: skip
    """Perform the command ``engine``."""
    if aircraft_file:
        unused = {"--flights": whole, "--structure": structure_file, "--compare": compared}
        unused |= {"--start": starts, "--points": points_file, "--climbs": climbs_file}
        unused |= {"--prior": prior_file, "--area": area}
        run_propeller(
            power_changes, names, aircraft_file, polar and Polar(*polar, *polar_stderr), rate,
            output=output, as_json=as_json, unused=[name for name, given in unused.items() if given],
        )  # fmt: skip
        return
    angles = tuple(np.radians(pla)) if pla else None
    structure = read_structure(structure_file) if structure_file else EngineStructure()

    def channels(path: str):
        flown = cut_whole(read(path, names), rate)
        return engine_channels(flown, numbers, angles, structure.height).assign_attrs(
            record=Path(path).stem
        )

    with show_progress("read the records of the engine"):
        flown = [channels(path) for path in power_changes]
        started = [channels(path) for path in starts]
    with show_progress("identify the engine"):
        found = identify_engine(
            () if whole else flown,
            started,
            read_points(points_file) if points_file else None,
            equilibrium=read_points(climbs_file) if climbs_file else None,
            prior=_tables(Path(prior_file)) if prior_file else None,
            polar=Polar(*polar, *polar_stderr) if polar else None,
            S=area,
            engines=len(numbers),
            flights=flown if whole else (),
            **structure.keywords(),
        )
    entry = found.write(output, angles or (0.0, 1.0)) if output else None
    other = [channels(path) for path in compared]
    against = (
        found.compare([*(flown if whole else ()), *other], angles or (0.0, 1.0))
        if whole or other
        else None
    )
    if as_json:
        rows = against.to_dataframe().to_dict("index") if against is not None else {}
        print_json(found.as_dict() | {"file": output, "compared": rows})
        return
    click.echo(found.report())
    if against is not None:
        click.echo(f"\n{comparison_text(against)}")
    if entry:
        click.echo(f"\nwritten: {output}; in the aircraft file, below [[engine]]:\n\n{entry}")


def _tables(path: Path):
    """Return the tables of an a-priori deck."""
    if path.suffix != ".toml":
        return open_tables(path)
    engines = read_aircraft(path).engines
    if not engines or engines[0].deck is None:
        raise click.UsageError(
            f"{path}: the first engine has no deck; give a deck file, or an aircraft with "
            f"[engine.deck]"
        )
    return dict(engines[0].deck.tables)


def run_gear(paths, aircraft_file, database_file, errors, flown, output, as_json) -> None:
    """Perform the command ``gear``."""
    aircraft = read_aircraft(aircraft_file)
    records = []
    for path in paths:
        biases = open_biases(path) if _has_biases(path) else None
        records.append(GroundRecord(open_states(path), biases))
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"identify the landing gear from {len(records)} paths"):
        found = identify_landing_gear(records, aircraft, database, dict(errors), flown=flown)
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if as_json:
        print_json(found.as_dict() | {"file": output})
        return
    click.echo(found.report())
    if output:
        click.echo(f"written: {output}")


def _has_biases(path: str) -> bool:
    """Return whether a file of states also holds the constants of a reconstruction."""
    expected = "a path as `aeromatch flight reconstruct -o` writes it"
    with decoding_errors(path, expected), h5py.File(path, "r") as file:
        return "biases" in file


def ground_effect(
    paths,
    aircraft_file,
    models,
    ground,
    database_file,
    hold,
    cutoff,
    heights,
    output,
    tables,
    as_json,
) -> None:
    """Perform the command ``ground-effect``."""
    if (hold or output) and not database_file:
        raise SchemaError(
            "flight ground-effect", ["--hold and -o need a database; give --database"]
        )
    aircraft = read_aircraft(aircraft_file)
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"coefficients along {len(paths)} paths"):
        data = [coefficients(open_path(path), aircraft, cutoff=cutoff) for path in paths]
    changed = {model.coefficient: model.terms for model in map(RegressionModel.parse, ground)}
    names = [Path(path).name for path in paths]
    with show_progress("identify the ground effect"):
        found = identify_ground_effect(
            [RegressionModel.parse(text) for text in models or _MODELS],
            data,
            changed,
            database=database,
            hold=hold,
            names=names,
        )
    if output and database is not None:
        aerodb.save(replace_ground_effect(database, found, tables), output)
    if as_json:
        print_json(found.as_dict() | {"file": output})
        return
    click.echo(found.report(heights))
    if output:
        click.echo(f"written: {output}")


def run_stall(
    paths,
    aircraft_file,
    database_file,
    attached_to,
    station,
    over,
    names,
    attached,
    cutoff,
    figure,
    into,
    output,
    as_json,
) -> None:
    """Perform the command ``stall``."""
    if (into or attached_to) and not database_file:
        raise SchemaError("flight stall", ["--into and --attached-to need --database; give it"])
    aircraft = read_aircraft(aircraft_file)
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"coefficients along {len(paths)} paths"):
        data = [coefficients(open_path(path), aircraft, cutoff=cutoff) for path in paths]
    if database is not None and attached_to:
        last = demand_attached(attached_to)
        database = continue_attached_flow(database, last, reach_of(data))
    terms = {model.coefficient: model.terms for model in map(RegressionModel.parse, attached)}
    half = parse_quantity(station, "m") if station else 0.25 * aircraft.b
    chosen = {"coefficients": names} if names else {}
    with show_progress("identify the stall"):
        found = identify_stall(data, half, aircraft.cbar, database, over, attached=terms, **chosen)
    if figure:
        draw_stall(found, found.records, figure)
    if into and database is not None:
        aerodb.save(add_stall(database, found), into)
    if output:
        buffet = aircraft.stall.tables if aircraft.stall else {}
        kept = {name: leaf for name, leaf in buffet.items() if name.startswith("buffet")}
        write_aircraft(replace(aircraft, stall=found.separation(kept)), output)
    written = [file for file in (figure, into, output) if file]
    if as_json:
        print_json(found.as_dict() | {"files": written})
        return
    click.echo(found.report())
    if written:
        click.echo(f"written: {', '.join(written)}")
