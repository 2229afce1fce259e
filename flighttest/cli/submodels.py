"""The verb ``aeromatch flight engine``: governor, spools, static thrust and starting from the
records of an engine.
"""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, json_option, print_json, show_progress
from flighttest.cli.group import names_option


@click.command("actuator")
@click.argument("logs", nargs=-1, required=True, type=InputFile())
@click.option(
    "--command", "command_column", help="Column of the command, in any unit. Default: command."
)
@click.option(
    "--position",
    help='Column of the position, with its unit where the file has none: "angle [deg]". Default: '
    "position.",
)
@click.option(
    "--rate", help='Column of the rate: "speed [rpm]". Default: rate, where there is one.'
)
@click.option(
    "--torque", help="Column of the measured torque. Default: torque, where there is one."
)
@click.option(
    "--gear",
    type=float,
    default=1.0,
    show_default=True,
    help="G, torque at the actuator per measured torque.",
)
@click.option(
    "--held",
    is_flag=True,
    help="The command holds from its stamp to the next: the loop that wrote the log commands.",
)
@click.option("--no-delay", is_flag=True, help="The command has no dead time.")
@click.option("--no-limits", is_flag=True, help="Do not look for limits of rate and position.")
@click.option(
    "--band",
    type=(float, float),
    help="Band of the equation error [Hz]. Default: where the motion stands above its noise.",
)
@click.option("--inertia", type=float, help="Known Ma [kg m2]: makes ratios absolute.")
@click.option(
    "--inertia-stderr", type=float, default=0.0, help="Standard error of the inertia. [kg m2]"
)
@click.option(
    "--channel",
    default="delta_e",
    show_default=True,
    help="Channel of the name map that the servo moves.",
)
@click.option(
    "--figure", type=NewFile(), help="Draw motion, response and residual: png, svg or pdf."
)
@json_option
def actuator(
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
    """Identify a servo or motor from LOGS of its command and motion, and print what a name map can
    use of it.
    """
    from flighttest.submodels.actuators.identification import identify_actuator, read_bench_log
    from flighttest.submodels.actuators.result import draw_actuator

    given = {"command": command_column, "position": position, "rate": rate, "torque": torque}
    columns = {name: column for name, column in given.items() if column}
    with show_progress(f"read {len(logs)} log{'s' if len(logs) > 1 else ''}"):
        records = [read_bench_log(path, columns) for path in logs]
    with show_progress("identify the actuator"):
        found = identify_actuator(records, gear, not no_limits, not no_delay, held, band)
    if figure:
        draw_actuator(found, figure)
    absolute = found.with_inertia(inertia, inertia_stderr) if inertia is not None else {}
    servo = found.structure.stiffness
    entry = (
        found.channel(channel, (command_column or "command").partition("[")[0].strip())
        if servo
        else ""
    )
    if as_json:
        more = {
            "with_inertia": {name: vars(value) for name, value in absolute.items()},
            "channel": entry,
            "figure": figure,
        }
        print_json(found.as_dict() | more)
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


_FILE = InputFile()


@click.command("controls")
@click.argument("paths", nargs=-1, required=True, type=_FILE)
@click.option(
    "--free", "free_files", multiple=True, type=_FILE, help="States of pulses and releases."
)
@click.option(
    "--records",
    type=click.Path(exists=True, file_okay=False),
    help="Folder of the recordings, named as PATHS: their manoeuvres.",
)
@click.option(
    "--free-manoeuvre",
    "free_names",
    multiple=True,
    help="Manoeuvre in --records that is a pulse or release, such as release_column.",
)
@click.option(
    "--prior",
    type=float,
    default=None,
    help="Join with the circuit of the aircraft; standard error over value, such as 0.25.",
)
@click.option(
    "--aircraft",
    "aircraft_file",
    required=True,
    type=_FILE,
    help="Aircraft, TOML: hinge geometry and gearing.",
)
@click.option(
    "--item",
    type=click.Choice(["column", "wheel", "pedal"]),
    default="column",
    show_default=True,
    help="Control.",
)
@click.option(
    "--model",
    default="",
    help="Terms of the hinge moment. Default for the column: 'Ch_e = 1 + alpha + delta_e + "
    "delta_t'.",
)
@click.option(
    "--constant",
    "constants",
    multiple=True,
    help="Terms of the force, such as offset or friction. Default: by control.",
)
@click.option(
    "--arm", type=float, default=0.0, help="Ailerons from the plane of symmetry [m], for p arm / V."
)
@click.option(
    "--order",
    type=click.Choice(["2", "4"]),
    default="4",
    show_default=True,
    help="Order of the mechanism: 2 for one mass, 4 for two masses on a cable.",
)
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Write the aircraft with the identified circuit; it needs one already, for the stops.",
)
@click.option(
    "--database",
    "database_file",
    type=_FILE,
    help="Put the hinge moments into this database; see --into.",
)
@click.option("--into", type=NewFile(), help="Database to write, with the hinge moments.")
@json_option
def controls(
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
    order,
    output,
    database_file,
    into,
    as_json,
) -> None:
    """Identify the control loading from PATHS: slow sweeps and manoeuvres of several speeds and tab
    settings.
    """
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.aircraft.writing import write_aircraft
    from flightmech.errors import SchemaError
    from flighttest.reconstruction.dynamics.saved_paths import open_states
    from flighttest.records.sensors.instruments import pick_up_errors
    from flighttest.submodels.control_loading.identification import identify_control_loading
    from flighttest.submodels.control_loading.loading import ControlLoading, loading_of
    from flighttest.submodels.control_loading.result import replace_hinge_moments

    pairs = {
        "--database and --into": (database_file, into),
        "--records and --free-manoeuvre": (records, free_names),
    }
    problems = [
        f"{names} go together; give both or none"
        for names, (a, b) in pairs.items()
        if bool(a) != bool(b)
    ]
    aircraft = read_aircraft(aircraft_file)
    if prior is not None and item not in aircraft.circuits:
        problems.append(f"--prior needs [circuit.{item}] in {aircraft_file}; it is missing")
    if problems:
        raise SchemaError("flight controls", problems)
    loading: ControlLoading = loading_of(aircraft, item, model, constants, arm)
    states, free = ([open_states(path) for path in group] for group in (paths, free_files))
    if records:
        divided = [
            _divided(one, Path(records) / Path(path).name, free_names)
            for one, path in zip(states, paths)
        ]
        states, free = (
            [x for driven, _ in divided for x in driven],
            [*free, *(x for _, own in divided for x in own)],
        )
    drawings = (
        {} if prior is None else {"drawings": aircraft.circuits[item], "drawings_error": prior}
    )
    with show_progress(f"identify the loading of the {item}"):
        found = identify_control_loading(
            loading,
            states,
            free,
            int(order),
            errors=pick_up_errors(aircraft.instruments),
            **drawings,
        )
    if output:
        write_aircraft(found.aircraft(aircraft), Path(output))
    if into:
        import aerodb

        aerodb.save(replace_hinge_moments(aerodb.open(database_file), found), into)
    if as_json:
        rows = {str(name): found.value(str(name)) for name in found.estimates["term"].values}
        totals = {
            name: found.total(name)
            for name in ("friction", "damping", "mass")
            if name in loading.constants
        }
        print_json(
            {
                "item": item,
                "order": found.order,
                "estimates": rows,
                "both_ends": totals,
                "collinear": found.collinear,
                "file": output,
            }
        )
        return
    click.echo(found.report())
    for file in filter(None, (output, into)):
        click.echo(f"written: {file}")


def _divided(states, record: Path, free_names) -> tuple[list, list]:
    """Stretches of a record that are driven, and its free motion; a record without such a manoeuvre
    is driven.
    """
    import xarray as xr

    from flighttest.records.record import manoeuvres
    from flighttest.submodels.control_loading.motion import driven_and_free

    with xr.open_datatree(record, engine="h5netcdf", decode_timedelta=False) as tree:
        listed = manoeuvres(tree)
    return (
        driven_and_free(states, listed, free_names)
        if set(free_names) & set(listed["manoeuvre"])
        else ([states], [])
    )


@click.command("engine")
@click.argument("power_changes", nargs=-1, type=_FILE)
@names_option
@click.option(
    "--flights",
    "whole",
    is_flag=True,
    help="POWER_CHANGES are whole flights: power changes are cut out of them, tables estimated.",
)
@click.option(
    "--structure",
    "structure_file",
    type=_FILE,
    help="TOML file of what the tables depend on: limits, fan, over, tables ...",
)
@click.option(
    "--compare",
    "compared",
    multiple=True,
    type=_FILE,
    help="Further record that the deck is compared with.",
)
@click.option(
    "--start", "starts", multiple=True, type=_FILE, help="Record of a start and shut-down."
)
@click.option(
    "--points",
    "points_file",
    type=_FILE,
    help="CSV of settled points with recorded thrust: n1 mach h thrust, SI.",
)
@click.option(
    "--climbs",
    "climbs_file",
    type=_FILE,
    help="CSV of climbs and level accelerations: n1 mach h mass V V_dot h_dot CL, SI.",
)
@click.option(
    "--prior",
    "prior_file",
    type=_FILE,
    help="A-priori deck, netCDF, or that of the first engine of an aircraft file.",
)
@click.option("--polar", type=float, nargs=2, help="CD0 and K of the drag polar, for --climbs.")
@click.option(
    "--polar-stderr",
    type=float,
    nargs=2,
    default=(0.0, 0.0),
    help="Standard errors of CD0 and K; zero holds them.",
)
@click.option("--area", type=float, default=0.0, help="Reference area [m2], for --climbs.")
@click.option(
    "--engine",
    "numbers",
    type=int,
    multiple=True,
    default=(1,),
    help="Engines of the records, averaged; and sharing the climbs.",
)
@click.option(
    "--pla",
    type=float,
    nargs=2,
    help="Lever angles of idle and full power [deg], where the records have angles.",
)
@click.option(
    "--rate", type=float, default=25.0, show_default=True, help="Samples of the records per second."
)
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Write the deck; its entry in the aircraft file is printed.",
)
@json_option
def engine(
    power_changes, names, whole, structure_file, compared, starts, points_file, climbs_file, prior_file, polar, polar_stderr, area, numbers,
    pla, rate, output, as_json,
):  # fmt: skip
    """Identify an engine from POWER_CHANGES (chops, slams, steps that begin at rest), starts,
    settled points, and whole flights.
    """
    import numpy as np

    from flighttest.records.record import read
    from flighttest.records.signals.conditioning import cut
    from flighttest.submodels.engine.records import engine_channels, read_points
    from flighttest.submodels.engine.result import comparison_text, identify_engine
    from flighttest.submodels.engine.static_thrust import Polar
    from flighttest.submodels.engine.tables import EngineStructure, read_structure

    angles = tuple(np.radians(pla)) if pla else None
    structure = read_structure(structure_file) if structure_file else EngineStructure()

    def channels(path: str):
        record = read(path, names)
        clocks = [leaf.to_dataset()["time"].values for leaf in record.children.values()]
        begin, end = (
            max(float(clock[0]) for clock in clocks),
            min(float(clock[-1]) for clock in clocks),
        )
        return engine_channels(
            cut(record, begin, end, rate=rate), numbers, angles, structure.height
        ).assign_attrs(record=Path(path).stem)

    with show_progress("read the records of the engine"):
        flown = [channels(path) for path in power_changes]
        started = [channels(path) for path in starts]
    with show_progress("identify the engine"):
        found = identify_engine(
            () if whole else flown,
            started,
            read_points(points_file) if points_file else None,
            read_points(climbs_file) if climbs_file else None,
            _tables(Path(prior_file)) if prior_file else None,
            Polar(*polar, *polar_stderr) if polar else None,
            area,
            len(numbers),
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
    """Tables of an a-priori deck."""
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.aircraft.engine_deck import open_tables

    if path.suffix != ".toml":
        return open_tables(path)
    engines = read_aircraft(path).engines
    if not engines or engines[0].deck is None:
        raise click.UsageError(
            f"{path}: the first engine has no deck; give a deck file, or an aircraft with "
            f"[engine.deck]"
        )
    return dict(engines[0].deck.tables)


@click.command("gear")
@click.argument("paths", nargs=-1, required=True, type=_FILE)
@click.option(
    "--aircraft",
    "aircraft_file",
    required=True,
    type=_FILE,
    help="Aircraft, TOML: places of the wheels, mass, engines.",
)
@click.option(
    "--database",
    "database_file",
    type=_FILE,
    help="Aerodynamics near the ground; without it the air exerts no force.",
)
@click.option(
    "--error",
    "errors",
    type=(str, float),
    multiple=True,
    help="Standard error of an input: lift, drag, pitching, thrust, wind, mass, pedal, along, "
    "timing.",
)
@click.option(
    "--flown/--no-flown",
    default=True,
    help="Output error on the kernel for tyres and steering.",
    show_default=True,
)
@click.option("-o", "--output", type=NewFile(), help="Write the aircraft with the identified gear.")
@json_option
def gear(paths, aircraft_file, database_file, errors, flown, output, as_json) -> None:
    """Identify the landing gear from PATHS: reconstructed taxi turns, coast-down, brake stops,
    landings, all together.
    """
    import aerodb
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.aircraft.writing import write_aircraft
    from flighttest.reconstruction.dynamics.saved_paths import open_states
    from flighttest.reconstruction.flight_programme import open_biases
    from flighttest.submodels.landing_gear.identification import identify_landing_gear
    from flighttest.submodels.landing_gear.reconstructed_loads import GroundRecord

    aircraft = read_aircraft(aircraft_file)
    records = [
        GroundRecord(open_states(path), open_biases(path) if _reconstructed(path) else None)
        for path in paths
    ]
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


def _reconstructed(path: str) -> bool:
    """Whether a file of states also holds the constants of a reconstruction."""
    import h5py

    with h5py.File(path) as file:
        return "biases" in file


_MODELS = (
    "CL = 1 + alpha + qhat + delta_e",
    "CD = 1 + alpha + alpha**2",
    "Cm = 1 + alpha + qhat + delta_e",
)


@click.command("ground-effect")
@click.argument("paths", nargs=-1, required=True, type=InputFile())
@click.option(
    "--aircraft", "aircraft_file", required=True, type=InputFile(), help="Aircraft, TOML."
)
@click.option(
    "--model",
    "models",
    multiple=True,
    help="Free-air terms of a coefficient. Default: " + "; ".join(f"'{m}'" for m in _MODELS) + ".",
)
@click.option(
    "--ground",
    multiple=True,
    help="Terms that the ground may change, as 'CL = 1 + alpha'. Default: all; CL*phi of Cl.",
)
@click.option(
    "--database",
    "database_file",
    type=InputFile(),
    help="Database whose ground effect takes part in the comparison.",
)
@click.option(
    "--hold",
    is_flag=True,
    help="Hold the free-air terms at the database. Default: they are estimated along.",
)
@click.option(
    "--cutoff",
    type=click.FloatRange(0.0, min_open=True),
    help="Low-pass all states alike first [Hz].",
)
@click.option(
    "--height", "heights", type=float, multiple=True, help="Height at which K(h) is printed [m]."
)
@click.option(
    "-o", "--output", type=NewFile(), help="Write the database with the ground effect in it."
)
@click.option("--tables", is_flag=True, help="Write K(h) as tables in place of k h^s.")
@json_option
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
    """Identify k and s of C = C_free (1 + k h^s) from reconstructed PATHS: landings, low passes,
    and free air at the same flap.
    """
    import aerodb
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.errors import SchemaError
    from flighttest.reconstruction.dynamics.force_coefficients import coefficients
    from flighttest.reconstruction.dynamics.saved_paths import open_path
    from flighttest.regression.equation_error.model import RegressionModel
    from flighttest.submodels.ground_effect.identification import identify_ground_effect
    from flighttest.submodels.ground_effect.result import replace_ground_effect

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
            database,
            hold,
            names,
        )
    if output and database is not None:
        aerodb.save(replace_ground_effect(database, found, tables), output)
    if as_json:
        print_json({**_as_dict(found), "file": output})
        return
    click.echo(found.report(heights))
    if output:
        click.echo(f"written: {output}")


def _as_dict(found) -> dict:
    """The result as a document."""
    return {
        "held": found.held,
        "not_identified": found.not_identified,
        "coefficients": {
            name: {
                "form": one.form,
                "heights": one.heights,
                "terms": [row._asdict() for row in one.rows()],
                "evidence": one.evidence.to_dict("index"),
            }
            for name, one in found.coefficients.items()
        },
    }
