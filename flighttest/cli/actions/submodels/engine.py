"""Function that performs the command ``engine``, and its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import xarray as xr
from click.core import ParameterSource

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.propulsion.engine_deck import open_tables
from flightmech.support.console import collect_options, print_json, show_progress
from flighttest.cli.actions.propeller import run_propeller
from flighttest.records.record import read
from flighttest.records.signals.conditioning import cut_whole
from flighttest.submodels.engine.records import engine_channels, read_points
from flighttest.submodels.engine.result import comparison_text, identify_engine
from flighttest.submodels.engine.static_thrust import Polar
from flighttest.submodels.engine.tables import EngineStructure, read_structure


@dataclass(frozen=True)
class EngineRecords:
    """Options of the records of an engine, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    power_changes : tuple of str
        Records of power changes, or whole flights.
    whole : bool
        Whether `power_changes` are whole flights.
    starts, compared : tuple of str
        Records of starts, and records that the deck is compared with.
    names : str or None
        Name map of the records.
    numbers : tuple of int
        Numbers of the engines.
    pla : (float, float) or None
        Lever angles of idle and full throttle [deg].
    rate : float
        Samples per second.
    """

    power_changes: tuple[str, ...]
    whole: bool
    starts: tuple[str, ...]
    compared: tuple[str, ...]
    names: str | None
    numbers: tuple[int, ...]
    pla: tuple[float, float] | None
    rate: float

    @property
    def lever_angles(self) -> tuple[float, float] | None:
        """Lever angles of idle and full throttle; None if the records hold the throttle. [rad]"""
        if not self.pla:
            return None
        idle, full = np.radians(self.pla)
        return float(idle), float(full)

    def read(self, paths: Sequence[str], height: str | None) -> list[xr.Dataset]:
        """Return the engine channels of records; `height` is the channel of the height."""
        records = []
        for path in paths:
            flight = cut_whole(read(path, self.names), self.rate)
            channels = engine_channels(flight, self.numbers, self.lever_angles, height)
            records.append(channels.assign_attrs(record=Path(path).stem))
        return records


@dataclass(frozen=True)
class ThrustOptions:
    """Options of the static thrust, by the names of `flighttest.cli.submodels`.

    Attributes
    ----------
    points_file, climbs_file : str or None
        Points with recorded thrust, and partial climbs.
    prior_file : str or None
        A-priori deck, or aircraft with one.
    polar, polar_stderr : (float, float)
        CD0 and K of the drag polar, and their standard errors; `polar` may be None.
    area : float
        Reference area [m2].
    """

    points_file: str | None
    climbs_file: str | None
    prior_file: str | None
    polar: tuple[float, float] | None
    polar_stderr: tuple[float, float]
    area: float

    def drag_polar(self) -> Polar | None:
        """Return the drag polar; None without the option."""
        return Polar(*self.polar, *self.polar_stderr) if self.polar else None


@collect_options(records=EngineRecords, thrust=ThrustOptions)
def run_engine(
    records: EngineRecords,
    thrust: ThrustOptions,
    structure_file: str | None,
    aircraft_file: str | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``engine``."""
    if aircraft_file:
        jet_options = {
            "--flights": records.whole,
            "--structure": structure_file,
            "--compare": records.compared,
            "--start": records.starts,
            "--points": thrust.points_file,
            "--climbs": thrust.climbs_file,
            "--prior": thrust.prior_file,
            "--area": thrust.area,
            "--engine": _is_given("numbers"),  # all engines of the aircraft file are identified
        }
        run_propeller(
            records.power_changes,
            records.names,
            aircraft_file,
            thrust.drag_polar(),
            records.rate,
            output=output,
            as_json=as_json,
            pla=records.lever_angles,
            unused=[name for name, value in jet_options.items() if value],
        )
        return
    structure = read_structure(structure_file) if structure_file else EngineStructure()
    with show_progress("read the records of the engine"):
        flights = records.read(records.power_changes, structure.height)
        starts = records.read(records.starts, structure.height)
    with show_progress("identify the engine"):
        engine = identify_engine(
            () if records.whole else flights,
            starts,
            read_points(thrust.points_file) if thrust.points_file else None,
            equilibrium=read_points(thrust.climbs_file) if thrust.climbs_file else None,
            prior=_read_deck(Path(thrust.prior_file)) if thrust.prior_file else None,
            polar=thrust.drag_polar(),
            S=thrust.area,
            engines=len(records.numbers),
            flights=flights if records.whole else (),
            structure=structure,
        )
    angles = records.lever_angles or (0.0, 1.0)
    entry = engine.write(output, angles) if output else None
    # Whole flights are compared too: the deck was identified from parts of them.
    compared = records.read(records.compared, structure.height)
    if records.whole:
        compared = [*flights, *compared]
    comparison = engine.compare(compared, angles) if compared else None
    if as_json:
        rows = comparison.to_dataframe().to_dict("index") if comparison is not None else {}
        print_json(engine.as_dict() | {"file": output, "compared": rows})
        return
    click.echo(engine.report())
    if comparison is not None:
        click.echo(f"\n{comparison_text(comparison)}")
    if entry:
        click.echo(f"\nwritten: {output}; in the aircraft file, below [[engine]]:\n\n{entry}")


def _is_given(parameter: str) -> bool:
    """Return whether the command line states a parameter that has a default."""
    source = click.get_current_context().get_parameter_source(parameter)
    return source is not ParameterSource.DEFAULT


def _read_deck(path: Path) -> dict[str, xr.Dataset]:
    """Return the tables of an a-priori deck, or of the first engine of an aircraft."""
    if path.suffix != ".toml":
        return open_tables(path)
    engines = read_aircraft(path).engines
    if not engines or engines[0].deck is None:
        raise click.UsageError(
            f"{path}: the first engine has no deck; give a deck file, or an aircraft with "
            f"[engine.deck]"
        )
    return dict(engines[0].deck.tables)
