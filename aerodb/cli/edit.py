"""The verbs ``aeromatch db edit FILE ...``, ``history``, ``previous`` and ``forget``."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    print_json,
    print_remark,
    print_table,
)

if TYPE_CHECKING:
    import xarray as xr

_FILE = InputFile()
_note = click.option("--note", default="", help="Reason for the change; stored in the history.")
_output = click.option(
    "-o", "--output", required=True, type=NewFile(), help="The new database, netCDF-4."
)
_source = click.option(
    "--source",
    type=click.Choice(["judgement", "flight", "datcom"]),
    default="judgement",
    show_default=True,
    help="Source of the number.",
)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"^\s*((?:{_NUMBER}[\s,]+)*{_NUMBER})\s*(.*?)\s*$")


class AxisOption(click.ParamType):
    """AXIS='numbers unit', such as alpha='-4 0 4 8 deg'; without a unit SI."""

    name = "AXIS='NUMBERS UNIT'"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, list[float]]:
        """Return the axis and its breakpoints in SI."""
        from flightmech.names import lookup

        axis, sign, text = str(value).partition("=")
        if not sign:
            self.fail(
                f"{value!r} is not AXIS='NUMBERS UNIT', such as alpha='-4 0 4 8 deg'", param, ctx
            )
        return axis.strip(), _numbers(text, lookup(axis.strip()).units)


class Numbers(click.ParamType):
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


@edit.command()
@_by("Factor, or several with --over.")
def scale(
    file: str, names: tuple[str, ...], by: Any, over: tuple | None, output: str, **how: Any
) -> None:
    """Multiply terms; TERM may be a pattern such as '*/gear'."""
    from aerodb.edit.table_edits import scale as scaled

    _write(file, output, lambda db: scaled(db, names, by, dict([over]) if over else None, **how))


@edit.command()
@_by("Amount in the unit of the table, or several with --over.")
def shift(
    file: str, names: tuple[str, ...], by: Any, over: tuple | None, output: str, **how: Any
) -> None:
    """Add an amount to terms."""
    from aerodb.edit.table_edits import shift as shifted

    _write(file, output, lambda db: shifted(db, names, by, dict([over]) if over else None, **how))


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
def set_nodes(file: str, name: str, places: tuple, value: float, output: str, **how: Any) -> None:
    """Set one node of a term, or a row of nodes, to a number."""
    from aerodb.edit.table_edits import set_nodes as with_nodes

    several = [axis for axis, points in places if len(points) != 1]
    if several or len(dict(places)) != len(places):
        raise click.BadParameter(
            f"give one breakpoint for each axis, such as alpha='4 deg'; got {places}",
            param_hint="--at",
        )
    _write(
        file,
        output,
        lambda db: with_nodes(db, name, {axis: points[0] for axis, points in places}, value, **how),
    )


@edit.command()
@click.argument("name", metavar="TERM")
@_axis
@click.option(
    "--tolerance", type=float, help="Largest difference from the old table that is allowed."
)
@_note
@_output
@click.pass_obj
def regrid(
    file: str, name: str, axes: tuple, tolerance: float | None, note: str, output: str
) -> None:
    """Put a term on other breakpoints; the largest difference from the old table is printed."""
    from aerodb.edit.table_edits import regrid as regridded

    _write(file, output, lambda db: regridded(db, name, dict(axes), tolerance=tolerance, note=note))


@edit.command()
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
def extend(
    file: str, name: str, axes: tuple, how: str, values: Any, stderr: Any, note: str, output: str
) -> None:
    """Let a term reach further."""
    from aerodb.edit.table_edits import extend as extended

    axis, points = axes
    _write(
        file,
        output,
        lambda db: extended(
            db, name, axis, points, how if values is None else values, stderr=stderr, note=note
        ),
    )


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
def move_reference(
    file: str,
    x: str | None,
    y: str | None,
    z: str | None,
    tolerance: float,
    flow: str,
    note: str,
    output: str,
) -> None:
    """Take the moments about another point; the aircraft file must name the same point then."""
    from aerodb.edit.reference_point import move_reference as moved
    from flightmech.units import parse_quantity

    given = {
        key: _number(text)
        for key, text in (("x_ref", x), ("y_ref", y), ("z_ref", z))
        if text is not None
    }

    def work(db: xr.DataTree) -> xr.DataTree:
        point = [
            parse_quantity(given[key], "m") if key in given else float(db.attrs[key])
            for key in ("x_ref", "y_ref", "z_ref")
        ]
        return moved(db, point, tolerance=tolerance, flow=flow, note=note)

    _write(file, output, work)


@edit.command()
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
def blend(file: str, other: str, names: tuple[str, ...], rule: str, note: str, output: str) -> None:
    """Join terms with those of the database OTHER, each with the weight of its standard errors."""
    from aerodb.edit.blending import blend as blended
    from aerodb.edit.blending import consistency
    from aerodb.store.files import open

    second = open(other)
    chosen = names or None
    frame = consistency(open(file), second, chosen, rule)
    _write(file, output, lambda db: blended(db, second, chosen, rule, note=note))
    rows = [
        (
            name,
            row.nodes,
            f"{row.chi2:.4g}",
            f"{row.probability:.3g}",
            f"{row.worst:+.3g}",
            row.location,
        )
        for name, row in frame.iterrows()
    ]
    head = ("term", "nodes", "chi-square", "probability", "worst in std. errors", "where")
    print_table(head, rows, title="how well they agree", right=head[1:5])


@edit.command()
@click.argument("names", metavar="TERM...", nargs=-1, required=True)
@_note
@_output
@click.pass_obj
def delete(file: str, names: tuple[str, ...], note: str, output: str) -> None:
    """Take terms out; they count as zero."""
    from aerodb.edit.table_edits import delete_terms

    _write(file, output, lambda db: delete_terms(db, names, note))


@edit.command()
@click.argument("other", type=_FILE)
@click.argument("names", metavar="TERM...", nargs=-1, required=True)
@_note
@_output
@click.pass_obj
def replace(file: str, other: str, names: tuple[str, ...], note: str, output: str) -> None:
    """Take terms from the database OTHER, in place of those of the same name or in addition."""
    from aerodb.edit.table_edits import match_names, replace_terms
    from aerodb.store.files import open
    from aerodb.store.schema import terms

    second = open(other)
    theirs = terms(second)
    _write(
        file,
        output,
        lambda db: replace_terms(
            db, {name: theirs[name] for name in match_names(second, names)}, note
        ),
    )


@click.command()
@click.argument("file", type=_FILE)
@json_option
def history(file: str, as_json: bool) -> None:
    """Show the edits of a database; numbered ones can be undone."""
    from aerodb.store.files import list_edits
    from aerodb.store.undo_history import COLUMNS

    rows = list_edits(file)
    if as_json:
        print_json(
            [{"line": line, **dict(zip(COLUMNS, row))} for line, row in enumerate(rows, start=1)]
        )
        return
    print_table(
        ("edit", "what was done"),
        [("" if number is None else number, text) for number, *_, text in rows],
        right=("edit",),
    )


@click.command()
@click.argument("file", type=_FILE)
@click.option(
    "--steps", type=click.IntRange(1), default=1, show_default=True, help="Edits to undo."
)
@click.option("--edit", "number", type=int, help="Undo this edit and all later ones instead.")
@_output
def previous(file: str, steps: int, number: int | None, output: str) -> None:
    """Write the database as it was before its last edits."""
    from aerodb.store.undo_history import undo_edits as before

    _write(file, output, lambda db: before(db, steps, number), show_change=False)


@click.command()
@click.argument("file", type=_FILE)
@_output
def forget(file: str, output: str) -> None:
    """Write the database without its undo history, for a release."""
    from aerodb.store.undo_history import drop_undo_history as forgotten

    _write(file, output, forgotten, show_change=False)


def _write(file: str, output: str, work: Any, show_change: bool = True) -> None:
    """Open, work, save, and print the new line of history; warnings go to stderr."""
    import warnings

    from aerodb.store.files import open, save
    from flightmech.errors import AeromatchWarning

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        tree = work(open(file))
    save(tree, output)
    for warning in caught:
        if issubclass(warning.category, AeromatchWarning):
            print_remark(f"warning: {warning.message}")
    if show_change:
        click.echo(str(tree.attrs["history"]).rsplit("\n", 1)[-1])
    click.echo(f"written: {output}")


def _numbers(text: str, units: str) -> list[float]:
    """Return numbers with one unit behind them, '0 4 8 deg', in SI."""
    from flightmech.errors import UnitError
    from flightmech.units import to_si

    match = _NUMBERS.match(text)
    if not match:
        raise UnitError(
            f"found {text!r}; expected numbers and a unit such as '0 4 8 deg', or numbers in "
            f"{units}"
        )
    return [
        float(to_si(float(word), match.group(2) or units, units))
        for word in re.split(r"[\s,]+", match.group(1))
    ]


def _number(text: str) -> str | float:
    """Return a bare number as one, which is SI; a text with a unit stays."""
    try:
        return float(text)
    except ValueError:
        return text
