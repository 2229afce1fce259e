"""The verb ``aeromatch flight gear``: struts, tyres, brakes and rolling friction from reconstructed ground runs."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress

_FILE = InputFile()


@click.command("gear")
@click.argument("paths", nargs=-1, required=True, type=_FILE)
@click.option("--aircraft", "aircraft_file", required=True, type=_FILE, help="Aircraft, TOML: places of the wheels, mass, engines.")
@click.option("--database", "database_file", type=_FILE, help="Aerodynamics near the ground; without it the air exerts no force.")
@click.option(
    "--error",
    "errors",
    type=(str, float),
    multiple=True,
    help="Standard error of an input: lift, drag, pitching, thrust, wind, mass, pedal, along, timing.",
)
@click.option("--flown/--no-flown", default=True, help="Output error on the kernel for tyres and steering.", show_default=True)
@click.option("-o", "--output", type=NewFile(), help="Write the aircraft with the identified gear.")
@json_option
def gear(paths, aircraft_file, database_file, errors, flown, output, as_json) -> None:
    """Identify the landing gear from PATHS: reconstructed taxi turns, coast-down, brake stops, landings, all together."""
    import aerodb
    from flightmech import read_aircraft, write_aircraft

    from ...dynamics.saved_paths import open_states
    from ...landing_gear.identification import identify_landing_gear
    from ...landing_gear.reconstructed_loads import GroundRecord
    from ...reconstruction.path_files import open_biases

    aircraft = read_aircraft(aircraft_file)
    records = [GroundRecord(open_states(path), open_biases(path) if _reconstructed(path) else None) for path in paths]
    database = aerodb.open(database_file) if database_file else None
    with progress(f"identify the landing gear from {len(records)} paths"):
        found = identify_landing_gear(records, aircraft, database, dict(errors), flown=flown)
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if as_json:
        document(found.as_dict() | {"file": output})
        return
    click.echo(found.report())
    if output:
        click.echo(f"written: {output}")


def _reconstructed(path: str) -> bool:
    """Whether a file of states also holds the constants of a reconstruction."""
    import h5py

    with h5py.File(path) as file:
        return "biases" in file
