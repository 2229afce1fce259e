"""The verb ``aeromatch flight controls``: friction, masses, cable and hinge moments of a control from states with cockpit channels."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress

_FILE = InputFile()


@click.command("controls")
@click.argument("paths", nargs=-1, required=True, type=_FILE)
@click.option("--free", "free_files", multiple=True, type=_FILE, help="States of pulses and releases.")
@click.option(
    "--records", type=click.Path(exists=True, file_okay=False), help="Folder of the recordings, named as PATHS: their manoeuvres."
)
@click.option(
    "--free-manoeuvre", "free_names", multiple=True, help="Manoeuvre in --records that is a pulse or release, such as release_column."
)
@click.option("--prior", type=float, default=None, help="Join with the circuit of the aircraft; standard error over value, such as 0.25.")
@click.option("--aircraft", "aircraft_file", required=True, type=_FILE, help="Aircraft, TOML: hinge geometry and gearing.")
@click.option("--item", type=click.Choice(["column", "wheel", "pedal"]), default="column", show_default=True, help="Control.")
@click.option("--model", default="", help="Terms of the hinge moment. Default for the column: 'Ch_e = 1 + alpha + delta_e + delta_t'.")
@click.option("--constant", "constants", multiple=True, help="Terms of the force, such as offset or friction. Default: by control.")
@click.option("--arm", type=float, default=0.0, help="Ailerons from the plane of symmetry [m], for p arm / V.")
@click.option(
    "--order",
    type=click.Choice(["2", "4"]),
    default="4",
    show_default=True,
    help="Order of the mechanism: 2 for one mass, 4 for two masses on a cable.",
)
@click.option("-o", "--output", type=NewFile(), help="Write the aircraft with the identified circuit; it needs one already, for the stops.")
@click.option("--database", "database_file", type=_FILE, help="Put the hinge moments into this database; see --into.")
@click.option("--into", type=NewFile(), help="Database to write, with the hinge moments.")
@json_option
def controls(
    paths, free_files, records, free_names, prior, aircraft_file, item, model, constants, arm, order, output, database_file, into, as_json
) -> None:
    """Identify the control loading from PATHS: slow sweeps and manoeuvres of several speeds and tab settings."""
    from flightmech import read_aircraft, write_aircraft
    from flightmech.errors import SchemaError

    from ...control_loading.database import replace_hinge_moments
    from ...control_loading.identification import identify_control_loading
    from ...control_loading.loading import ControlLoading, loading_of
    from ...dynamics.saved_paths import open_states
    from ...sensors.instruments import pick_up_errors

    pairs = {"--database and --into": (database_file, into), "--records and --free-manoeuvre": (records, free_names)}
    problems = [f"{names} go together; give both or none" for names, (a, b) in pairs.items() if bool(a) != bool(b)]
    aircraft = read_aircraft(aircraft_file)
    if prior is not None and item not in aircraft.circuits:
        problems.append(f"--prior needs [circuit.{item}] in {aircraft_file}; it is missing")
    if problems:
        raise SchemaError("flight controls", problems)
    loading: ControlLoading = loading_of(aircraft, item, model, constants, arm)
    states, free = ([open_states(path) for path in group] for group in (paths, free_files))
    if records:
        divided = [_divided(one, Path(records) / Path(path).name, free_names) for one, path in zip(states, paths)]
        states, free = [x for driven, _ in divided for x in driven], [*free, *(x for _, own in divided for x in own)]
    drawings = {} if prior is None else {"drawings": aircraft.circuits[item], "drawings_error": prior}
    with progress(f"identify the loading of the {item}"):
        found = identify_control_loading(loading, states, free, int(order), errors=pick_up_errors(aircraft.instruments), **drawings)
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if into:
        import aerodb

        aerodb.save(replace_hinge_moments(aerodb.open(database_file), found), into)
    if as_json:
        rows = {str(name): found.value(str(name)) for name in found.estimates["term"].values}
        totals = {name: found.total(name) for name in ("friction", "damping", "mass") if name in loading.constants}
        document({"item": item, "order": found.order, "estimates": rows, "both_ends": totals, "collinear": found.collinear, "file": output})
        return
    click.echo(found.report())
    for file in filter(None, (output, into)):
        click.echo(f"written: {file}")


def _divided(states, record: Path, free_names) -> tuple[list, list]:
    """Stretches of a record that are driven, and its free motion; a record without such a manoeuvre is driven."""
    import xarray as xr

    from ...control_loading.division import driven_and_free
    from ...records.record import manoeuvres

    with xr.open_datatree(record, engine="h5netcdf", decode_timedelta=False) as tree:
        listed = manoeuvres(tree)
    return driven_and_free(states, listed, free_names) if set(free_names) & set(listed["manoeuvre"]) else ([states], [])
