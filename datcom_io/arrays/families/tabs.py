"""The leaf of control tabs: ``tabs``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.arrays.stacking import StackedAxis, Stacker
from datcom_io.cells import BLANK
from datcom_io.printout.layouts import tabs as streams
from datcom_io.printout.tables import TableLayout
from flightmech.errors import ParseError

_ONE_DECIMAL = "1 where the print has one decimal only: the first value of each line"


def stack_tabs(stacker: Stacker) -> LeafBuilder | None:
    """Stack the value streams of control tabs as (condition, alpha, delta).

    The print does not show alpha, so alpha and delta come from the input cards.
    """
    alphas = stacker.alphas()
    deltas = stacker.case.deck.schedule("SYMFLP", "DELTA", "NDELTA")
    layouts = [layout for layout in streams.LAYOUTS if stacker.placed_tables(layout.name)]
    if not layouts or not alphas or not deltas:
        return None
    axes = [
        stacker.condition_axis(),
        StackedAxis("alpha", alphas, "deg"),
        StackedAxis("delta", deltas, "deg"),
    ]
    leaf = LeafBuilder(stacker.make_coords(axes))
    for layout in layouts:
        for _, group in stacker.case.values(layout.name):
            stacker.check_axis(group.labels[0], group.values, exact=deltas, lines=group.lines)
        _add_stream(stacker, leaf, layout, (len(stacker.conditions), len(alphas), len(deltas)))
    # The stream has delta in the inner loop and `PER_LINE` values on a line.
    position = np.arange(len(alphas) * len(deltas)).reshape(len(alphas), len(deltas))
    first_of_line = position % streams.PER_LINE == 0
    attrs = {"units": "1", "long_name": _ONE_DECIMAL}
    leaf.variables["one_decimal"] = xr.Variable(
        ("alpha", "delta"), first_of_line.astype(np.uint8), attrs
    )
    return leaf


def _add_stream(
    stacker: Stacker, leaf: LeafBuilder, layout: TableLayout, shape: tuple[int, int, int]
) -> None:
    """Add the streams of one kind as a variable (condition, alpha, delta)."""
    column = layout.columns[0]
    placed = stacker.placed_tables(layout.name)
    _, alphas, deltas = shape
    used = alphas * deltas
    # The stream also has values for angles that NALPHA counts and the cards do not give.
    expected = max(alphas, stacker.case.deck.count("FLTCON", "NALPHA") or 0) * deltas
    value, flag = empty_cells(shape)
    for spot, page, table in placed:
        printed = table.flags.ravel() != BLANK
        if printed.sum() != expected or not printed[:used].all():
            raise ParseError(
                stacker.case.file,
                table.lines[-1],
                f"{printed.sum()} values in the {layout.name} table",
                f"{expected} values, alphas x deflections of the input cards",
            )
        # The stream is flat: values of the lines follow each other.
        numbers = table.values.ravel()[:used].reshape(shape[1:])
        codes = table.flags.ravel()[:used].reshape(shape[1:])
        value[spot.condition] = stacker.to_si(column, page, numbers, codes)
        flag[spot.condition] = codes
    leaf.add_described(column, ("condition", "alpha", "delta"), value, flag)
    leaf.coords[f"lines_{column.quantity}"] = stacker.line_ranges_by_condition(placed)


LEAVES = {"tabs": stack_tabs}
