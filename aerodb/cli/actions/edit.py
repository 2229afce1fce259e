"""Functions that perform the commands of `aerodb.cli.edit`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import click
import xarray as xr

from aerodb.edit import blending, breakpoint_edits, reference_point, table_edits
from aerodb.edit.ice import add_ice
from aerodb.edit.ice_file import read_ice
from aerodb.edit.term_edits import delete_terms, match_names, replace_terms
from aerodb.store.files import open as open_database
from aerodb.store.files import save
from aerodb.store.plausibility import check_plausibility
from aerodb.store.plausibility_findings import PlausibilityFinding
from aerodb.store.schema import terms
from aerodb.store.undo_history import drop_undo_history, undo_edits
from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.quantities import option_quantity
from flightmech.support.console import print_remark, print_table

MOST_CHORDS = 1.0
"""Distance of a moved reference point that is stated as unusual, in chords."""


def run_scale(
    file: str,
    names: tuple[str, ...],
    by: Any,
    over: tuple[Any, ...] | None,
    output: str,
    **how: Any,
) -> None:
    """Perform the command ``scale``."""
    axes = _axes_of(over)
    _write(file, output, lambda db: table_edits.scale(db, names, by, axes, **how))


def run_shift(
    file: str,
    names: tuple[str, ...],
    by: Any,
    over: tuple[Any, ...] | None,
    output: str,
    **how: Any,
) -> None:
    """Perform the command ``shift``."""
    axes = _axes_of(over)
    _write(file, output, lambda db: table_edits.shift(db, names, by, axes, **how))


def _axes_of(over: tuple[Any, ...] | None) -> dict[str, Any] | None:
    """Return the axis of an option ``--over`` with its breakpoints, or None without the option."""
    return dict([over]) if over else None


def run_set_nodes(
    file: str, name: str, places: tuple[Any, ...], value: float, output: str, **how: Any
) -> None:
    """Perform the command ``set``."""
    is_single = all(len(points) == 1 for _, points in places)
    if not is_single or len(dict(places)) != len(places):
        raise click.BadParameter(
            f"give one breakpoint for each axis, such as alpha='4 deg'; got {places}",
            param_hint="--at",
        )
    node = {axis: points[0] for axis, points in places}
    _write(file, output, lambda db: table_edits.set_nodes(db, name, node, value, **how))


def run_regrid(
    file: str, name: str, axes: tuple[Any, ...], tolerance: float | None, note: str, output: str
) -> None:
    """Perform the command ``regrid``."""

    def edit(db: xr.DataTree) -> xr.DataTree:
        return breakpoint_edits.regrid(db, name, dict(axes), tolerance=tolerance, note=note)

    _write(file, output, edit)


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
    # Values on the command line take the place of the rule.
    rule = how if values is None else values

    def edit(db: xr.DataTree) -> xr.DataTree:
        return breakpoint_edits.extend(db, name, axis, points, rule, stderr=stderr, note=note)

    _write(file, output, edit)


def _warn_far_point(db: xr.DataTree, point: Sequence[float]) -> None:
    """Warn of a reference point more than `MOST_CHORDS` from the former one."""
    old = [float(db.attrs[key]) for key in ("x_ref", "y_ref", "z_ref")]
    chords = math.dist(old, point) / float(db.attrs["cbar"])
    if chords > MOST_CHORDS:
        places = []
        for place in (old, point):
            places.append(", ".join(f"{value:.4g}" for value in place))
        warnings.warn(
            f"the moment reference point moves by {chords:.3g} chords, from ({places[0]}) to "
            f"({places[1]}) m; more than {MOST_CHORDS:g} is unusual: check the sign (x is forward "
            f"of the datum of the drawing, so a point behind it is negative) and the unit",
            AeromatchWarning,
            stacklevel=2,
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
    options = {"x_ref": x, "y_ref": y, "z_ref": z}

    def edit(db: xr.DataTree) -> xr.DataTree:
        # A coordinate without an option stays. [m]
        point = []
        for key, text in options.items():
            if text is None:
                point.append(float(db.attrs[key]))
            else:
                point.append(option_quantity(key, text, "m"))
        _warn_far_point(db, point)
        return reference_point.move_reference(db, point, tolerance=tolerance, flow=flow, note=note)

    _write(file, output, edit)


def run_blend(
    file: str, other: str, names: tuple[str, ...], rule: str, note: str, output: str
) -> None:
    """Perform the command ``blend``."""
    second = open_database(other)
    chosen = names or None
    # The agreement is that before the blend: the output may be the file itself.
    table = blending.consistency(open_database(file), second, chosen, rule)
    _write(file, output, lambda db: blending.blend(db, second, chosen, rule, note=note))
    rows = []
    for name, row in table.iterrows():
        numbers = (f"{row.chi2:.4g}", f"{row.probability:.3g}", f"{row.worst:+.3g}")
        rows.append((name, row.nodes, *numbers, row.location))
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
    leaves = terms(second)
    replacements = {name: leaves[name] for name in match_names(second, names)}
    _write(file, output, lambda db: replace_terms(db, replacements, note))


def run_previous(file: str, steps: int, number: int | None, output: str) -> None:
    """Perform the command ``previous``."""
    _write(file, output, lambda db: undo_edits(db, steps, number), show_change=False)


def run_forget(file: str, output: str) -> None:
    """Perform the command ``forget``."""
    _write(file, output, drop_undo_history, show_change=False)


def _new_doubts(before: xr.DataTree, after: xr.DataTree) -> list[str]:
    """Return the implausible values that an edit brings into a database, a line each."""
    try:
        known = {finding.subject for finding in check_plausibility(before) if _is_doubt(finding)}
        findings = check_plausibility(after)
    except AeromatchError:
        # a database without the tables of the check
        return []
    return [str(item) for item in findings if _is_doubt(item) and item.subject not in known]


def _is_doubt(finding: PlausibilityFinding) -> bool:
    return finding.kind == "implausible"


def _write(
    file: str,
    output: str,
    edit: Callable[[xr.DataTree], xr.DataTree],
    show_change: bool = True,
) -> None:
    """Open a database, edit it, save it, and print its new line of history.

    Warnings go to stderr after the file is written: a remark on a file that was not written would
    mislead.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AeromatchWarning)
        before = open_database(file)
        tree = edit(before)
    save(tree, output)
    for warning in caught:
        if issubclass(warning.category, AeromatchWarning):
            print_remark(f"warning: {warning.message}")
    for text in _new_doubts(before, tree):
        print_remark(f"warning: {text}")
    if show_change:
        click.echo(str(tree.attrs["history"]).rsplit("\n", 1)[-1])
    click.echo(f"written: {output}")
