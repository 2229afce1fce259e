"""Functions that perform the commands of `aerodb.cli.edit`."""

from __future__ import annotations

import warnings
from typing import Any

import click
import xarray as xr

from aerodb.edit.blending import blend as blended
from aerodb.edit.blending import consistency
from aerodb.edit.breakpoint_edits import extend as extended
from aerodb.edit.breakpoint_edits import regrid as regridded
from aerodb.edit.ice import add_ice
from aerodb.edit.ice_file import read_ice
from aerodb.edit.reference_point import move_reference as moved
from aerodb.edit.table_edits import scale as scaled
from aerodb.edit.table_edits import set_nodes as with_nodes
from aerodb.edit.table_edits import shift as shifted
from aerodb.edit.term_edits import delete_terms, match_names, replace_terms
from aerodb.store.files import open as open_database
from aerodb.store.files import save
from aerodb.store.schema import terms
from aerodb.store.undo_history import drop_undo_history as forgotten
from aerodb.store.undo_history import undo_edits as before
from flightmech.errors import AeromatchWarning
from flightmech.quantities import number_or_text, parse_quantity
from flightmech.support.console import print_remark, print_table


def run_scale(
    file: str,
    names: tuple[str, ...],
    by: Any,
    over: tuple[Any, ...] | None,
    output: str,
    **how: Any,
) -> None:
    """Perform the command ``scale``."""
    _write(file, output, lambda db: scaled(db, names, by, dict([over]) if over else None, **how))


def run_shift(
    file: str,
    names: tuple[str, ...],
    by: Any,
    over: tuple[Any, ...] | None,
    output: str,
    **how: Any,
) -> None:
    """Perform the command ``shift``."""
    _write(file, output, lambda db: shifted(db, names, by, dict([over]) if over else None, **how))


def run_set_nodes(
    file: str, name: str, places: tuple[Any, ...], value: float, output: str, **how: Any
) -> None:
    """Perform the command ``set``."""
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


def run_regrid(
    file: str, name: str, axes: tuple[Any, ...], tolerance: float | None, note: str, output: str
) -> None:
    """Perform the command ``regrid``."""
    _write(file, output, lambda db: regridded(db, name, dict(axes), tolerance=tolerance, note=note))


def run_extend(
    file: str,
    name: str,
    axes: tuple[Any, ...],
    how: str,
    values: Any,
    stderr: Any,
    note: str,
    output: str,
) -> None:
    """Perform the command ``extend``."""
    axis, points = axes
    _write(
        file,
        output,
        lambda db: extended(
            db, name, axis, points, how if values is None else values, stderr=stderr, note=note
        ),
    )


def run_move_reference(
    file: str,
    x: str | None,
    y: str | None,
    z: str | None,
    tolerance: float,
    flow: str,
    note: str,
    output: str,
) -> None:
    """Perform the command ``move-reference``."""
    given = {
        key: number_or_text(text)
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


def run_blend(
    file: str, other: str, names: tuple[str, ...], rule: str, note: str, output: str
) -> None:
    """Perform the command ``blend``."""
    second = open_database(other)
    chosen = names or None
    frame = consistency(open_database(file), second, chosen, rule)
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


def run_ice(file: str, ice_file: str, note: str, output: str) -> None:
    """Perform the command ``ice``."""
    ice = read_ice(ice_file)
    _write(file, output, lambda db: add_ice(db, ice, note=note))


def run_delete(file: str, names: tuple[str, ...], note: str, output: str) -> None:
    """Perform the command ``delete``."""
    _write(file, output, lambda db: delete_terms(db, names, note))


def run_replace(file: str, other: str, names: tuple[str, ...], note: str, output: str) -> None:
    """Perform the command ``replace``."""
    second = open_database(other)
    theirs = terms(second)
    _write(
        file,
        output,
        lambda db: replace_terms(
            db, {name: theirs[name] for name in match_names(second, names)}, note
        ),
    )


def run_previous(file: str, steps: int, number: int | None, output: str) -> None:
    """Perform the command ``previous``."""
    _write(file, output, lambda db: before(db, steps, number), show_change=False)


def run_forget(file: str, output: str) -> None:
    """Perform the command ``forget``."""
    _write(file, output, forgotten, show_change=False)


def _write(file: str, output: str, work: Any, show_change: bool = True) -> None:
    """Open, work, save, and print the new line of history; warnings go to stderr."""

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        tree = work(open_database(file))
    save(tree, output)
    for warning in caught:
        if issubclass(warning.category, AeromatchWarning):
            print_remark(f"warning: {warning.message}")
    if show_change:
        click.echo(str(tree.attrs["history"]).rsplit("\n", 1)[-1])
    click.echo(f"written: {output}")
