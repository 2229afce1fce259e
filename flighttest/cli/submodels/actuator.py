"""The verb ``aeromatch flight actuator``: a servo or motor from logs of its command and motion."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress


@click.command("actuator")
@click.argument("logs", nargs=-1, required=True, type=InputFile())
@click.option("--command", "command_column", help="Column of the command, in any unit. Default: command.")
@click.option("--position", help='Column of the position, with its unit where the file has none: "angle [deg]". Default: position.')
@click.option("--rate", help='Column of the rate: "speed [rpm]". Default: rate, where there is one.')
@click.option("--torque", help="Column of the measured torque. Default: torque, where there is one.")
@click.option("--gear", type=float, default=1.0, show_default=True, help="G, torque at the actuator per measured torque.")
@click.option("--held", is_flag=True, help="The command holds from its stamp to the next: the loop that wrote the log commands.")
@click.option("--no-delay", is_flag=True, help="The command has no dead time.")
@click.option("--no-limits", is_flag=True, help="Do not look for limits of rate and position.")
@click.option("--band", type=(float, float), help="Band of the equation error [Hz]. Default: where the motion stands above its noise.")
@click.option("--inertia", type=float, help="Known Ma [kg m2]: makes ratios absolute.")
@click.option("--inertia-stderr", type=float, default=0.0, help="Standard error of the inertia. [kg m2]")
@click.option("--channel", default="delta_e", show_default=True, help="Channel of the name map that the servo moves.")
@click.option("--figure", type=NewFile(), help="Draw motion, response and residual: png, svg or pdf.")
@json_option
def actuator(
    logs, command_column, position, rate, torque, gear, held, no_delay, no_limits, band, inertia, inertia_stderr, channel, figure, as_json
) -> None:
    """Identify a servo or motor from LOGS of its command and motion, and print what a name map can use of it."""
    from ...actuators.bench_log import read_bench_log
    from ...actuators.figure import draw_actuator
    from ...actuators.identification import identify_actuator

    given = {"command": command_column, "position": position, "rate": rate, "torque": torque}
    columns = {name: column for name, column in given.items() if column}
    with progress(f"read {len(logs)} log{'s' if len(logs) > 1 else ''}"):
        records = [read_bench_log(path, columns) for path in logs]
    with progress("identify the actuator"):
        found = identify_actuator(records, gear, not no_limits, not no_delay, held, band)
    if figure:
        draw_actuator(found, figure)
    absolute = found.with_inertia(inertia, inertia_stderr) if inertia is not None else {}
    servo = found.structure.stiffness
    entry = found.channel(channel, (command_column or "command").partition("[")[0].strip()) if servo else ""
    if as_json:
        more = {"with_inertia": {name: vars(value) for name, value in absolute.items()}, "channel": entry, "figure": figure}
        document(found.as_dict() | more)
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
