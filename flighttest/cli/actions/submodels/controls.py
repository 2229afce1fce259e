"""Functions that perform the commands ``actuator`` and ``controls``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError
from flightmech.quantities import finite_number
from flightmech.support.console import collect_options, count_text, print_json, show_progress
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.records.record import marked_manoeuvres
from flighttest.records.sensors.instruments import pick_up_errors
from flighttest.submodels.actuators.figure import draw_actuator
from flighttest.submodels.actuators.identification import (
    IdentifiedActuator,
    identify_actuator,
    read_bench_log,
)
from flighttest.submodels.control_loading.hinge_terms import replace_hinge_moments
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.control_loading.motion import driven_and_free


@dataclass(frozen=True)
class LogColumns:
    """Columns of a bench log, each as its heading with a unit in brackets; None for the default."""

    command_column: str | None
    position: str | None
    rate: str | None
    torque: str | None

    def named(self) -> dict[str, str]:
        """Return the given columns by quantity, for `read_bench_log`."""
        columns = {
            "command": self.command_column,
            "position": self.position,
            "rate": self.rate,
            "torque": self.torque,
        }
        return {name: column for name, column in columns.items() if column}


@dataclass(frozen=True)
class ActuatorOptions:
    """Structure of an actuator, as `identify_actuator` takes it."""

    gear: float
    held: bool
    no_delay: bool
    no_limits: bool
    band: tuple[float, float] | None

    def identify(self, records: Sequence[xr.Dataset]) -> IdentifiedActuator:
        """Return the actuator identified from bench logs."""
        return identify_actuator(
            records,
            self.gear,
            not self.no_limits,
            delay=not self.no_delay,
            held=self.held,
            band=self.band,
        )


@collect_options(columns=LogColumns, options=ActuatorOptions)
def run_actuator(
    logs: tuple[str, ...],
    columns: LogColumns,
    options: ActuatorOptions,
    inertia: float | None,
    inertia_stderr: float,
    channel: str,
    figure: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``actuator``."""
    with show_progress(f"read {count_text(len(logs), 'log')}"):
        records = [read_bench_log(path, columns.named()) for path in logs]
    with show_progress("identify the actuator"):
        actuator = options.identify(records)
    if figure:
        draw_actuator(actuator, figure)
    absolute = {}
    if inertia is not None:
        absolute = actuator.with_inertia(inertia, inertia_stderr)
    entry = ""
    # Only a servo, which has a stiffness, gives a position for its command.
    if actuator.structure.stiffness:
        column = (columns.command_column or "command").partition("[")[0].strip()
        entry = actuator.channel(channel, column)
    if as_json:
        coefficients_by_name = {name: vars(value) for name, value in absolute.items()}
        document = {"with_inertia": coefficients_by_name, "channel": entry, "figure": figure}
        print_json(actuator.as_dict() | document)
        return
    click.echo(actuator.report())
    if absolute:
        click.echo("\nwith the known inertia:")
        for name, value in absolute.items():
            click.echo(f"  {name:4s} {value}")
    if entry:
        click.echo(f"\nin the name map of a flight log that records the command:\n\n{entry}")
    if figure:
        click.echo(f"\nwritten: {figure}")


@dataclass(frozen=True)
class ControlMotions:
    """Options of the motions of a control, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    paths : tuple of str
        Reconstructed paths with driven motions.
    free_files : tuple of str
        Reconstructed paths of pulses and releases.
    records : str or None
        Folder of the recordings with the manoeuvres of `paths`.
    free_names : tuple of str
        Manoeuvres in `records` that are pulses or releases.
    """

    paths: tuple[str, ...]
    free_files: tuple[str, ...]
    records: str | None
    free_names: tuple[str, ...]

    def read(self) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
        """Return the driven and the free motions."""
        flights = [open_states(path) for path in self.paths]
        free = [open_states(path) for path in self.free_files]
        if not self.records:
            return flights, free
        driven = []
        for flight, path in zip(flights, self.paths):
            record = Path(self.records) / Path(path).name
            driven_parts, free_parts = _divide_record(flight, record, self.free_names)
            driven += driven_parts
            free += free_parts
        return driven, free


@dataclass(frozen=True)
class LoadingOptions:
    """Options of the model of a control loading, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    aircraft_file : str
    item : {"column", "wheel", "pedal"}
    model : str
        Terms of the hinge moment; empty for the default of the control.
    constants : tuple of str
        Terms of the force.
    arm : float
        Distance of the ailerons from the plane of symmetry [m].
    over : str
        Variable and nodes of the tables of the hinge moment.
    order : {"2", "4"}
        Order of the mechanism.
    method : {"best", "regression", "output error"}
    prior : float or None
        Relative standard error of the circuit of the aircraft, which is joined as a prior.
    """

    aircraft_file: str
    item: str
    model: str
    constants: tuple[str, ...]
    arm: float
    over: str
    order: str
    method: str
    prior: float | None


@collect_options(motions=ControlMotions, options=LoadingOptions)
def run_controls(
    motions: ControlMotions,
    options: LoadingOptions,
    output: str | None,
    database_file: str | None,
    into: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``controls``."""
    problems = []
    if bool(database_file) != bool(into):
        problems.append("--database and --into go together; give both or none")
    if bool(motions.records) != bool(motions.free_names):
        problems.append("--records and --free-manoeuvre go together; give both or none")
    aircraft, item = read_aircraft(options.aircraft_file), options.item
    if options.prior is not None and item not in aircraft.circuits:
        problems.append(f"--prior needs [circuit.{item}] in {options.aircraft_file}; it is missing")
    if problems:
        raise SchemaError("flight controls", problems)
    loading = loading_of(
        aircraft,
        item,
        options.model,
        constants=options.constants,
        arm=options.arm,
        over=_table_nodes(options.over),
    )
    driven, free = motions.read()
    drawings: dict[str, Any] = {}
    if options.prior is not None:
        drawings = {"drawings": aircraft.circuits[item], "drawings_error": options.prior}
    with show_progress(f"identify the loading of the {item}"):
        identified = identify_control_loading(
            loading,
            driven,
            free,
            int(options.order),
            errors=pick_up_errors(aircraft.instruments),
            method=options.method,
            **drawings,
        )
    if output:
        write_aircraft(identified.aircraft(aircraft), Path(output))
    if database_file and into:
        aerodb.save(replace_hinge_moments(aerodb.open(database_file), identified), into)
    if as_json:
        print_json(identified.as_dict() | {"file": output})
        return
    click.echo(identified.report())
    for file in filter(None, (output, into)):
        click.echo(f"written: {file}")


def _table_nodes(text: str) -> tuple[str, tuple[float, ...]] | None:
    """Return variable and nodes of ``mach 0.2 0.5``; None for an empty text."""
    if not text:
        return None
    name, *numbers = text.replace(",", " ").split()
    try:
        return name, tuple(map(finite_number, numbers))
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
