"""Functions that perform the commands ``gear``, ``ground-effect`` and ``stall``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import h5py

import aerodb
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError, UnitError
from flightmech.quantities import option_quantity
from flightmech.support.console import collect_options, print_json, show_progress
from flightmech.support.hdf5_seal import decoding_errors
from flighttest.cli.submodels import _MODELS
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.reconstruction.dynamics.saved_paths import open_path, open_states
from flighttest.reconstruction.flight_programme import open_biases
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.ground_effect.database_terms import replace_ground_effect
from flighttest.submodels.ground_effect.identification import identify_ground_effect
from flighttest.submodels.ground_effect.structure import demand_low_flight
from flighttest.submodels.landing_gear.identification import identify_landing_gear
from flighttest.submodels.landing_gear.reconstructed_loads import GroundRecord
from flighttest.submodels.stall.database_terms import add_stall, continue_attached_flow, reach_of
from flighttest.submodels.stall.figure import draw_stall
from flighttest.submodels.stall.identification import identify_stall
from flighttest.submodels.stall.model import demand_attached, demand_station


def run_gear(
    paths: tuple[str, ...],
    aircraft_file: str,
    database_file: str | None,
    errors: tuple[tuple[str, float], ...],
    flown: bool,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``gear``."""
    aircraft = read_aircraft(aircraft_file)
    records = []
    for path in paths:
        biases = open_biases(path) if _has_biases(path) else None
        records.append(GroundRecord(open_states(path), biases))
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"identify the landing gear from {len(records)} paths"):
        gear = identify_landing_gear(records, aircraft, database, dict(errors), flown=flown)
    if output:
        write_aircraft(gear.aircraft(aircraft), Path(output))
    if as_json:
        print_json(gear.as_dict() | {"file": output})
        return
    click.echo(gear.report())
    if output:
        click.echo(f"written: {output}")


def _has_biases(path: str) -> bool:
    """Return whether a file of states also holds the constants of a reconstruction."""
    expected = "a path as `aeromatch flight reconstruct -o` writes it"
    with decoding_errors(path, expected), h5py.File(path, "r") as file:
        return "biases" in file


@dataclass(frozen=True)
class GroundEffectModels:
    """Options of the models in ground effect, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    models : tuple of str
        Models of the coefficients.
    ground : tuple of str
        Terms that the ground changes, as models.
    hold : bool
        Whether free air is that of the database.
    """

    models: tuple[str, ...]
    ground: tuple[str, ...]
    hold: bool


@collect_options(options=GroundEffectModels)
def run_ground_effect(
    paths: tuple[str, ...],
    aircraft_file: str,
    options: GroundEffectModels,
    database_file: str | None,
    cutoff: float | None,
    heights: tuple[float, ...],
    output: str | None,
    tables: bool,
    as_json: bool,
) -> None:
    """Perform the command ``ground-effect``."""
    if (options.hold or output) and not database_file:
        raise SchemaError(
            "flight ground-effect", ["--hold and -o need a database; give --database"]
        )
    aircraft = read_aircraft(aircraft_file)
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"coefficients along {len(paths)} paths"):
        data = [coefficients(open_path(path), aircraft, cutoff=cutoff) for path in paths]
    demand_low_flight(data, aircraft.b)
    changed = {
        model.coefficient: model.terms for model in map(RegressionModel.parse, options.ground)
    }
    names = [Path(path).name for path in paths]
    with show_progress("identify the ground effect"):
        effect = identify_ground_effect(
            [RegressionModel.parse(text) for text in options.models or _MODELS],
            data,
            changed,
            database=database,
            hold=options.hold,
            names=names,
        )
    if output and database is not None:
        aerodb.save(replace_ground_effect(database, effect, tables), output)
    if as_json:
        print_json(effect.as_dict() | {"file": output})
        return
    click.echo(effect.report(heights))
    if output:
        click.echo(f"written: {output}")


def attached_angle(text: str) -> float:
    """Return the angle of the option ``--attached-to``. [rad]

    Raises
    ------
    UnitError
        With the name of the option.
    """
    angle = option_quantity("--attached-to", text, "rad")
    try:
        return demand_attached(angle)
    except UnitError as error:
        raise UnitError(f"--attached-to {text}: {error}") from error


def station_of_halves(text: str, span: float) -> float:
    """Return the length of the option ``--station``; a quarter of the span without it. [m]

    Raises
    ------
    UnitError
        With the name of the option.
    """
    length = option_quantity("--station", text, "m") if text else text
    try:
        return demand_station(length, span)
    except UnitError as error:
        raise UnitError(f"--station {text}: {error}") from error


@dataclass(frozen=True)
class StallModelOptions:
    """Options of the stall model, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    attached_to : str or None
        Angle of attack from which the tables of the database are continued linearly.
    station : str or None
        Station of the wing halves; None for a quarter of the span.
    over : str
        Variable of the configuration.
    names : tuple of str
        Coefficients to fit; if empty, the default of `identify_stall`.
    attached : tuple of str
        Models of the attached flow.
    """

    attached_to: str | None
    station: str | None
    over: str
    names: tuple[str, ...]
    attached: tuple[str, ...]


@collect_options(options=StallModelOptions)
def run_stall(
    paths: tuple[str, ...],
    aircraft_file: str,
    database_file: str | None,
    options: StallModelOptions,
    cutoff: float | None,
    figure: str | None,
    into: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``stall``."""
    if (into or options.attached_to) and not database_file:
        raise SchemaError("flight stall", ["--into and --attached-to need --database; give it"])
    aircraft = read_aircraft(aircraft_file)
    # options are read before the paths, which take long
    station, last = station_of_halves(options.station or "", aircraft.b), 0.0
    if options.attached_to:
        last = attached_angle(options.attached_to)
    database = aerodb.open(database_file) if database_file else None
    with show_progress(f"coefficients along {len(paths)} paths"):
        data = [coefficients(open_path(path), aircraft, cutoff=cutoff) for path in paths]
    if database is not None and options.attached_to:
        database = continue_attached_flow(database, last, reach_of(data))
    models = [RegressionModel.parse(text) for text in options.attached]
    choices: dict[str, Any] = {
        "attached": {model.coefficient: model.terms for model in models},
        "names": paths,
    }
    if options.names:
        choices["coefficients"] = options.names
    with show_progress("identify the stall"):
        stall = identify_stall(data, station, aircraft.cbar, database, options.over, **choices)
    if figure:
        draw_stall(stall, stall.records, figure)
    if into and database is not None:
        aerodb.save(add_stall(database, stall), into)
    if output:
        buffet = aircraft.stall.tables if aircraft.stall else {}
        kept = {name: leaf for name, leaf in buffet.items() if name.startswith("buffet")}
        write_aircraft(replace(aircraft, stall=stall.separation(kept)), output)
    written = [file for file in (figure, into, output) if file]
    if as_json:
        print_json(stall.as_dict() | {"files": written})
        return
    click.echo(stall.report())
    if written:
        click.echo(f"written: {', '.join(written)}")
