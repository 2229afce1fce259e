"""The verb ``aeromatch flight engine``: governor, spools, static thrust and starting from the
records of an engine.
"""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by
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
@performed_by("flighttest.cli.actions.submodels.controls:run_actuator")
def actuator_command() -> None:
    """Identify a servo or motor from LOGS of its command and motion, and print what a name map can
    use of it.
    """


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
    "--over",
    default="",
    help="Tables of the hinge moment: variable and nodes in SI, such as 'mach 0.2 0.35 0.5'.",
)
@click.option(
    "--order",
    type=click.Choice(["2", "4"]),
    default="4",
    show_default=True,
    help="Order of the mechanism: 2 for one mass, 4 for two masses on a cable.",
)
@click.option(
    "--method",
    type=click.Choice(["best", "regression", "output error"]),
    default="best",
    show_default=True,
    help="Regressions alone, or output error of the free motion started from them; best is the "
    "output error if its search converges.",
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
@performed_by("flighttest.cli.actions.submodels.controls:run_controls")
def controls_command() -> None:
    """Identify the control loading from PATHS: slow sweeps and manoeuvres of several speeds and tab
    settings.
    """


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
@click.option(
    "--aircraft",
    "aircraft_file",
    type=_FILE,
    help="Aircraft with propellers, TOML: POWER_CHANGES are records or reconstructed paths, whose "
    "steady power identifies thrust and power, and whose power changes identify shaft and "
    "governor.",
)
@click.option(
    "--polar",
    type=float,
    nargs=2,
    help="CD0 and K of the drag polar, for --climbs and --aircraft.",
)
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
    "--rate",
    type=click.FloatRange(0.0, 10_000.0, min_open=True),
    default=25.0,
    show_default=True,
    help="Samples of the records per second.",
)
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="Write the deck, whose entry in the aircraft file is printed; with --aircraft the "
    "identified aircraft.",
)
@json_option
@performed_by("flighttest.cli.actions.submodels.engine:run_engine")
def engine_command() -> None:
    """Identify an engine from POWER_CHANGES (chops, slams, steps that begin at rest), starts,
    settled points, and whole flights; or propellers with their engines.
    """


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
@performed_by("flighttest.cli.actions.submodels.airframe:run_gear")
def gear_command() -> None:
    """Identify the landing gear from PATHS: reconstructed taxi turns, coast-down, brake stops,
    landings, all together.
    """


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
@performed_by("flighttest.cli.actions.submodels.airframe:run_ground_effect")
def ground_effect_command() -> None:
    """Identify k and s of C = C_free (1 + k h^s) from reconstructed PATHS: landings, low passes,
    and free air at the same flap.
    """


@click.command("stall")
@click.argument("paths", nargs=-1, required=True, type=_FILE)
@click.option("--aircraft", "aircraft_file", required=True, type=_FILE, help="Aircraft, TOML.")
@click.option(
    "--database",
    "database_file",
    type=_FILE,
    help="Attached flow, which is subtracted; without it the terms of the attached flow are "
    "estimated alone.",
)
@click.option(
    "--attached-to",
    help="Angle of attack such as '12 deg' from which the tables of the database are continued "
    "linearly, where they contain a stall.",
)
@click.option(
    "--station",
    help="Station of the wing halves from the plane of symmetry, such as '2.5 m'. Default: a "
    "quarter of the span.",
)
@click.option(
    "--over",
    default="",
    help="Variable of the configuration, such as delta_f, over which a1 and alpha_star are tables.",
)
@click.option(
    "--coefficient",
    "names",
    multiple=True,
    help="Coefficient to fit. Default: CL, CD, Cm, Cl and Cn.",
)
@click.option(
    "--attached",
    multiple=True,
    help="Terms of the attached flow of a coefficient, as 'CL = 1 + alpha + qhat + delta_e'.",
)
@click.option(
    "--cutoff",
    type=click.FloatRange(0.0, min_open=True),
    help="Low-pass all states alike first [Hz].",
)
@click.option(
    "--figure", type=NewFile(), help="Draw loops of the lift and the separation: png, svg or pdf."
)
@click.option(
    "--into", type=NewFile(), help="Database to write, with the terms of the separated flow."
)
@click.option("-o", "--output", type=NewFile(), help="Aircraft to write, with the separation.")
@json_option
@performed_by("flighttest.cli.actions.submodels.airframe:run_stall")
def stall_command() -> None:
    """Identify a stall from PATHS: quasi-steady and accelerated stalls of all configurations,
    reconstructed.
    """
