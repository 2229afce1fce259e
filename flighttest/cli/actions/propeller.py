"""The command ``engine`` for aircraft with propellers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import h5py
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError
from flightmech.support.console import print_json, show_progress
from flightmech.support.hdf5_seal import decoding_errors
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.records.record import read
from flighttest.records.signals.conditioning import cut_whole
from flighttest.remarks import is_forbidden
from flighttest.submodels.engine.propellers.identification import identify_propeller
from flighttest.submodels.engine.static_thrust import Polar

# First bytes of an HDF5 file.
_HDF5 = b"\x89HDF"


def run_propeller(
    paths: Sequence[str],
    names: str | None,
    aircraft_file: str,
    polar: Polar | None,
    rate: float,
    *,
    output: str | None,
    as_json: bool,
    pla: tuple[float, float] | None = None,
    unused: Sequence[str] = (),
) -> None:
    """Perform the command ``engine`` with an aircraft that has propellers.

    Parameters
    ----------
    paths : sequence of str
        Records, or paths as `aeromatch flight reconstruct -o` writes them.
    names : str or None
        Name map of the records.
    aircraft_file : str
        A-priori aircraft.
    polar : Polar or None
        Drag polar with standard errors.
    rate : float
        Samples of the records per second.
    output : str or None
        Aircraft to write.
    as_json : bool
        Print JSON.
    pla : (idle, full), optional
        Lever angles of idle and full power, where the records have angles. [rad]
    unused : sequence of str
        Options that only a jet uses and that were given.

    Raises
    ------
    SchemaError
        No polar, no records, or options that only a jet uses.
    """
    problems = [f"{name} belongs to a jet; leave it out with --aircraft" for name in unused]
    if polar is None:
        problems.append("thrust is identified together with the drag; give --polar CD0 K")
    if not paths:
        problems.append("no records; give records or reconstructed paths")
    if problems or polar is None:
        raise SchemaError("flight engine", problems)
    aircraft = read_aircraft(aircraft_file)
    with show_progress(f"read {len(paths)} record{'s' if len(paths) > 1 else ''}"):
        records = [_read_record(path, names, rate) for path in paths]
    with show_progress("identify propeller and engine"):
        found = identify_propeller(records, aircraft, polar, power_changes=records, pla=pla)
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if as_json:
        print_json(found.as_dict() | {"file": output})
    else:
        click.echo(found.report())
        if output:
            click.echo(f"\nwritten: {output}")
    click.get_current_context().exit(1 if is_forbidden(found.remarks) else 0)


def _read_record(path: str, names: str | None, rate: float) -> xr.Dataset:
    """Return the states of a path, or the channels of a record on a uniform clock."""
    name = Path(path).stem
    if not names and Path(path).read_bytes()[:4] == _HDF5 and _is_path(path):
        return open_states(path).assign_attrs(record=name)
    return cut_whole(read(path, names), rate).assign_attrs(record=name)


def _is_path(path: str) -> bool:
    """Return whether an HDF5 file holds reconstructed states."""
    expected = "a path as `aeromatch flight reconstruct -o` writes it, or a record"
    with decoding_errors(path, expected), h5py.File(path, "r") as file:
        return "states" in file or "V" in file
