"""The verbs ``aeromatch db edit FILE ...``, ``history``, ``previous`` and ``forget``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import click

from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    performed_by,
)
from flightmech.units import to_si

_FILE = InputFile()
_note = click.option("--note", default="", help="Reason for the change; stored in the history.")
_output = click.option(
    "-o", "--output", required=True, type=NewFile(), help="The new database, netCDF-4."
)
# of commands whose own argument is the database; `edit` has it before their name
_edited = click.option(
    "-o",
    "--output",
    required=True,
    type=NewFile(may_replace=True),
    help="The new database, netCDF-4.",
)
_source = click.option(
    "--source",
    type=click.Choice(["judgement", "flight", "datcom", "estimate"]),
    default="judgement",
    show_default=True,
    help="Source of the number.",
)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"^\s*((?:{_NUMBER}[\s,]+)*{_NUMBER})\s*(.*?)\s*$")


class AxisOption(click.ParamType):  # type: ignore[type-arg]
    """AXIS='numbers unit', such as alpha='-4 0 4 8 deg'; without a unit SI."""

    name = "AXIS='NUMBERS UNIT'"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, list[float]]:
        """Return the axis and its breakpoints in SI."""
        name, sign, text = str(value).partition("=")
        if not sign:
            self.fail(
                f"{value!r} is not AXIS='NUMBERS UNIT', such as alpha='-4 0 4 8 deg'", param, ctx
            )
        axis = name.strip()
        points = _numbers(text, lookup(axis).units)
        # Only a number without a unit can be a slip: a full-envelope table reaches 180 deg.
        if not _states_unit(text) and (odd := _odd_breakpoint(axis, points)):
            self.fail(odd, param, ctx)
        return axis, points


def _odd_breakpoint(axis: str, points: list[float]) -> str:
    """Return what is odd of the first breakpoint that no flight reaches, empty without one."""
    # it imports the simulation, which takes longer than a page of help
    from flightmech.simulation.stated_values.odd_values import describe_odd_quantity

    for point in points:
        if odd := describe_odd_quantity(axis, point):
            units = lookup(axis).units
            return odd if units == "1" else f"{odd}, or '{point:g} {units}' if it is right"
    return ""


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """One number or several: '1.2', '1.0 1.1 1.2'."""

    name = "NUMBERS"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | list[float]:
        """Return the number, or the list."""
        found = _numbers(str(value), "1")
        return found[0] if len(found) == 1 else found


_axis = click.option(
    "--axis",
    "axes",
    multiple=True,
    required=True,
    type=AxisOption(),
    help="Breakpoints, such as alpha='-4 0 4 8 deg'.",
)


def _by(words: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator: the arguments of a verb that changes terms by a number, or by a table
    over an axis.
    """
    arguments = (
        click.argument("names", metavar="TERM...", nargs=-1, required=True),
        click.option("--by", required=True, type=Numbers(), help=words),
        click.option(
            "--over",
            type=AxisOption(),
            help="Axis and breakpoints of several numbers, such as alpha='0 8 deg'.",
        ),
        click.option(
            "--stderr", type=Numbers(), default="0", help="Standard error of the numbers of --by."
        ),
        _source,
        _note,
        _output,
        click.pass_obj,
    )

    def decorated(verb: Callable[..., None]) -> Callable[..., None]:
        for argument in reversed(arguments):
            verb = argument(verb)
        return verb

    return decorated


@click.group()
@click.argument("file", type=_FILE)
@click.pass_context
def edit(ctx: click.Context, file: str) -> None:
    """Change a database FILE: what is replaced stays in the undo history of the new file."""
    ctx.obj = file


@edit.command("scale")
@_by("Factor, or several with --over.")
@performed_by("aerodb.cli.actions.edit:run_scale")
def scale_command() -> None:
    """Multiply terms; TERM may be a pattern such as '*/gear'."""


@edit.command("shift")
@_by("Amount in the unit of the table, or several with --over.")
@performed_by("aerodb.cli.actions.edit:run_shift")
def shift_command() -> None:
    """Add an amount to terms."""


@edit.command("set")
@click.argument("name", metavar="TERM")
@click.option(
    "--at",
    "places",
    multiple=True,
    type=AxisOption(),
    help="A breakpoint, such as alpha='4 deg'; an axis left out means all of its nodes.",
)
@click.option("--value", required=True, type=float, help="The number, in the unit of the table.")
@click.option(
    "--stderr", type=float, help="Standard error of the value; without it the nodes keep theirs."
)
@_source
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_set_nodes")
def set_nodes_command() -> None:
    """Set one node of a term, or a row of nodes, to a number."""


@edit.command("regrid")
@click.argument("name", metavar="TERM")
@_axis
@click.option(
    "--tolerance", type=float, help="Largest difference from the old table that is allowed."
)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_regrid")
def regrid_command() -> None:
    """Put a term on other breakpoints; the largest difference from the old table is printed."""


@edit.command("extend")
@click.argument("name", metavar="TERM")
@click.option(
    "--axis",
    "axes",
    required=True,
    type=AxisOption(),
    help="Breakpoints beyond the table, such as alpha='24 28 deg'.",
)
@click.option(
    "--how",
    type=click.Choice(["hold", "linear"]),
    default="hold",
    show_default=True,
    help="Values beyond the old ends: held, or on the line of the last two nodes.",
)
@click.option("--values", type=Numbers(), help="The values instead, along the axis.")
@click.option("--stderr", type=Numbers(), help="Standard error of the new nodes.")
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_extend")
def extend_command() -> None:
    """Let a term reach further."""


@edit.command("move-reference")
@click.option(
    "--x",
    help="Forward of the drawing datum, such as '-9.5 ft' or -2.9 [m]; each stays unless given.",
)
@click.option("--y", help="Right of it.")
@click.option("--z", help="Below it.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-3,
    show_default=True,
    help="Share of the moment that may be lost between breakpoints.",
)
@click.option(
    "--flow",
    type=click.Choice(["kept", "moved"]),
    default="kept",
    show_default=True,
    help="Flow at the new point: V, alpha and beta kept as they are, or moved with the point.",
)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_move_reference")
def move_reference_command() -> None:
    """Take the moments about another point; the aircraft file must name the same point then."""


@edit.command("blend")
@click.argument("other", type=_FILE)
@click.argument("names", metavar="[TERM]...", nargs=-1)
@click.option(
    "--rule",
    type=click.Choice(["inverse_variance", "correlated"]),
    default="inverse_variance",
    show_default=True,
    help="Weights of the two databases.",
)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_blend")
def blend_command() -> None:
    """Join terms with those of the database OTHER, each with the weight of its standard errors."""


@edit.command("ice")
@click.argument("ice_file", metavar="ICE", type=_FILE)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_ice")
def ice_command() -> None:
    """Add the differences of terms by ice in the file ICE (TOML or CSV), as terms that act with
    device.ice.setting; the clean terms stay.
    """


@edit.command("delete")
@click.argument("names", metavar="TERM...", nargs=-1, required=True)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_delete")
def delete_command() -> None:
    """Take terms out; they count as zero."""


@edit.command("replace")
@click.argument("other", type=_FILE)
@click.argument("names", metavar="TERM...", nargs=-1, required=True)
@_note
@_output
@click.pass_obj
@performed_by("aerodb.cli.actions.edit:run_replace")
def replace_command() -> None:
    """Take terms from the database OTHER, in place of those of the same name or in addition."""


@click.command("history")
@click.argument("file", type=_FILE)
@json_option
@performed_by("aerodb.cli.actions.show:print_history")
def history_command() -> None:
    """Show the edits of a database; numbered ones can be undone."""


@click.command("previous")
@click.argument("file", type=_FILE)
@click.option(
    "--steps", type=click.IntRange(1), default=1, show_default=True, help="Edits to undo."
)
@click.option("--edit", "number", type=int, help="Undo this edit and all later ones instead.")
@_edited
@performed_by("aerodb.cli.actions.edit:run_previous")
def previous_command() -> None:
    """Write the database as it was before its last edits."""


@click.command("forget")
@click.argument("file", type=_FILE)
@_edited
@performed_by("aerodb.cli.actions.edit:run_forget")
def forget_command() -> None:
    """Write the database without its undo history, for a release."""


def _states_unit(text: str) -> bool:
    """Return whether a unit is behind the numbers of a text."""
    match = _NUMBERS.match(text)
    return match is not None and bool(match.group(2))


def _numbers(text: str, units: str) -> list[float]:
    """Return numbers with one unit behind them, '0 4 8 deg', in SI."""
    match = _NUMBERS.match(text)
    if not match:
        raise UnitError(
            f"found {text!r}; expected numbers and a unit such as '0 4 8 deg', or numbers in "
            f"{units}"
        )
    numbers = [
        float(to_si(float(word), match.group(2) or units, units))
        for word in re.split(r"[\s,]+", match.group(1))
    ]
    if not all(map(math.isfinite, numbers)):
        raise UnitError(f"found {text!r}, which is infinite; give finite numbers")
    return numbers
