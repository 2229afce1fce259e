"""The verbs ``aeromatch db coefficients``, ``from-estimate`` and ``estimate``."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by


@click.command("coefficients")
@click.argument("files", nargs=-1, required=True, type=InputFile())
@click.option("--columns", type=InputFile(), help="Column map (TOML) of text tables.")
@click.option("-o", "--output", type=NewFile(), help="All numbers as CSV.")
@json_option
@performed_by("aerodb.cli.actions.estimates:print_coefficients")
def coefficients_command() -> None:
    """Show the coefficients in outputs of AVL (.st, .sb, .ft), VSPAERO (.stab, .polar), XFLR5 or
    flow5 (polars, logs), Missile DATCOM (for006.dat), Tornado (-Cx.mat) or text tables with a
    column map.

    Angles are in rad in the CSV, derivatives per rad, rates p b/2V, q cbar/2V, r b/2V; each number
    has its file and line. Signs of controls are those of the files.
    """


@click.command("from-estimate")
@click.argument("aircraft", type=InputFile())
@click.argument("files", nargs=-1, required=True, type=InputFile())
@click.option("--length-unit", help="Unit of length of the files, such as ft.")
@click.option(
    "--control",
    "controls",
    multiple=True,
    metavar="NAME=SIGN CONTROL",
    help="A control of the files and what it is, with its sign: elevator=+delta_e, "
    "rudder=-delta_r; NAME= leaves it out.",
)
@click.option("--columns", type=InputFile(), help="Column map (TOML) of text tables.")
@click.option("--S", "S", help="Wing area of files that do not state it, such as '174 ft2'.")
@click.option("--cbar", help="Mean chord of such files, such as '4.9 ft'.")
@click.option("--b", "b", help="Span of such files.")
@click.option("--x-ref", help="Moment centre of such files, aft of the origin of the drawing.")
@click.option("--mach", type=float, help="Mach number of files that do not state it.")
@click.option(
    "--CD0", "CD0", type=float, help="Friction drag added to that of an inviscid program."
)
@click.option(
    "--move-reference",
    is_flag=True,
    help="Transfer moments by more than 0.1 chord to the reference of the aircraft file.",
)
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, netCDF-4.")
@json_option
@performed_by("aerodb.cli.actions.estimates:run_from_estimate")
def from_estimate_command() -> None:
    """Build a database of AIRCRAFT from outputs of one program for one geometry, or from text
    tables with a column map.

    Programs are those of `db coefficients`. No output states the signs of its controls, and some
    state no unit of length: one --control for each control, and --length-unit, are required.
    Positive are delta_e and delta_f trailing edge down, delta_a right aileron down (rolls left),
    delta_r trailing edge left (yaws left).
    """


@click.command("estimate")
@click.argument("aircraft", type=InputFile())
@click.argument("decks", nargs=-1, type=InputFile())
@click.option(
    "--rudder",
    metavar="CHORD[,FROM,TO]",
    help="Share of the fin's chord behind the hinge, and its ends as shares of the fin's span: "
    "0.35 or 0.35,0,0.9. DATCOM has no card for a rudder.",
)
@click.option("--body", is_flag=True, help="Model the body by slender-body theory.")
@click.option("--CD0", "CD0", type=float, help="Friction drag to add; the method has none.")
@click.option(
    "--move-reference",
    is_flag=True,
    help="Transfer moments by more than 0.1 chord to the reference of the aircraft file.",
)
@click.option(
    "--errors",
    type=click.Choice(["calibrated", "guide"]),
    default="calibrated",
    help="Standard errors: calibrated on published derivatives (default), or of the guide.",
)
@click.option("-o", "--output", required=True, type=NewFile(), help="The database, netCDF-4.")
@json_option
@performed_by("aerodb.cli.actions.estimates:run_estimate")
def estimate_command() -> None:
    """Build a database from the geometry of DATCOM DECKS with a second estimator, the vortex
    lattice of AVL (package optvl, extra `estimate`).

    AIRCRAFT is an aircraft file (TOML) with its decks after it, or the first of the decks, which
    then give name, reference quantities and moment centre too. Wing, tails, elevator (SYMFLP on the
    tail), flap (SYMFLP on the wing) and aileron (ASYFLP) are those of the cards. The body is left
    out: with it the estimates of eleven aircraft are worse.
    """
