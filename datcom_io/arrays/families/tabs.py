"""The leaf of control tabs: ``tabs``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.stacking import LeafBuilder, StackedAxis, Stacker
from datcom_io.cells import ABSENT, BLANK
from datcom_io.printout.layouts import tabs as streams
from datcom_io.printout.tables import TableLayout
from flightmech.errors import ParseError

_LONG_NAMES = {
    "F_stick": "stick force as printed; the program divides by qbar S cbar where it ought to "
    "multiply",
    "CF_stick": "stick-force coefficient",
    "Ch_tab_free": "hinge-moment coefficient of the flap, tab free",
    "Ch_tab_locked": "hinge-moment coefficient of the flap, tab locked",
    "Ch_tab_gearing": "hinge-moment coefficient of the flap due to the gearing of the tab",
    "delta_tab_trim": "deflection of the trim tab for zero stick force",
    "one_decimal": "1 where the print has one decimal only: the first value of each line",
}


def stack_tabs(stacker: Stacker) -> LeafBuilder | None:
    """Stack the value streams of control tabs as (condition, alpha, delta), alpha and delta taken
    from the input cards.
    """
    alphas, deltas = stacker.alphas(), stacker.case.deck.schedule("SYMFLP", "DELTA", "NDELTA")
    layouts = [layout for layout in streams.LAYOUTS if stacker.placed(layout.name)]
    if not layouts or not alphas or not deltas:
        return None
    found = LeafBuilder(
        stacker.coords(
            [
                stacker.condition_axis(),
                StackedAxis("alpha", alphas, "deg"),
                StackedAxis("delta", deltas, "deg"),
            ]
        )
    )
    for layout in layouts:
        for _, group in stacker.case.values(layout.name):
            stacker.demand(group.labels[0], group.values, deltas, group.lines)
        _add_stream(stacker, found, layout, (len(stacker.conditions), len(alphas), len(deltas)))
    first_of_line = (
        np.arange(len(alphas) * len(deltas)).reshape(len(alphas), len(deltas)) % streams.PER_LINE
        == 0
    )
    found.variables["one_decimal"] = xr.Variable(
        ("alpha", "delta"), first_of_line.astype(np.uint8), {"units": "1"}
    )
    return found.described(_LONG_NAMES)


def _add_stream(
    stacker: Stacker, found: LeafBuilder, layout: TableLayout, shape: tuple[int, int, int]
) -> None:
    """Add the streams of one kind as a variable (condition, alpha, delta)."""
    column, placed = layout.columns[0], stacker.placed(layout.name)
    count = shape[1] * shape[2]
    wanted = max(shape[1], stacker.case.deck.count("FLTCON", "NALPHA") or 0) * shape[2]
    value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
    for spot, page, table in placed:
        printed = table.flags.ravel() != BLANK
        if printed.sum() != wanted or not printed[:count].all():
            text = f"{printed.sum()} values in the {layout.name} table"
            raise ParseError(
                stacker.case.file,
                table.lines[-1],
                text,
                f"{wanted} values, alphas x deflections of the input cards",
            )
        numbers, codes = (
            array.ravel()[:count].reshape(shape[1:]) for array in (table.values, table.flags)
        )
        value[spot.condition], flag[spot.condition] = (
            stacker.si(column, page, numbers, codes),
            codes,
        )
    found.add(column, ("condition", "alpha", "delta"), value, flag)
    found.coords[f"lines_{column.quantity}"] = stacker.lines_of_conditions(placed)


LEAVES = {"tabs": stack_tabs}
