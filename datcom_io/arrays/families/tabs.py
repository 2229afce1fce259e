"""The leaf of control tabs: ``tabs``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.errors import ParseError

from ...cells import ABSENT, BLANK
from ...printout.layouts import tabs as streams
from ...printout.tables import Layout
from ..stacking import Axis, Stacker, add_variable, describe

_LONG_NAMES = {
    "F_stick": "stick force as printed; the program divides by qbar S cbar where it ought to multiply",
    "CF_stick": "stick-force coefficient",
    "Ch_tab_free": "hinge-moment coefficient of the flap, tab free",
    "Ch_tab_locked": "hinge-moment coefficient of the flap, tab locked",
    "Ch_tab_gearing": "hinge-moment coefficient of the flap due to the gearing of the tab",
    "delta_tab_trim": "deflection of the trim tab for zero stick force",
    "one_decimal": "1 where the print has one decimal only: the first value of each line",
}


def tabs(stacker: Stacker) -> xr.Dataset | None:
    """Stack the value streams of control tabs as (condition, alpha, delta), alpha and delta taken from the input cards."""
    alphas, deltas = stacker.alphas(), stacker.case.deck.schedule("SYMFLP", "DELTA", "NDELTA")
    layouts = [layout for layout in streams.LAYOUTS if stacker.placed(layout.name)]
    if not layouts or not alphas or not deltas:
        return None
    found = xr.Dataset(coords=stacker.coords([stacker.condition_axis(), Axis("alpha", alphas, "deg"), Axis("delta", deltas, "deg")]))
    for layout in layouts:
        for _, group in stacker.case.values(layout.name):
            stacker.demand(group.labels[0], group.values, deltas, group.lines)
        found = _with_stream(stacker, found, layout)
    first_of_line = np.arange(len(alphas) * len(deltas)).reshape(len(alphas), len(deltas)) % streams.PER_LINE == 0
    found["one_decimal"] = (("alpha", "delta"), first_of_line.astype(np.uint8), {"units": "1"})
    return describe(found, _LONG_NAMES)


def _with_stream(stacker: Stacker, found: xr.Dataset, layout: Layout) -> xr.Dataset:
    """Add the streams of one kind as a variable (condition, alpha, delta)."""
    column, placed = layout.columns[0], stacker.placed(layout.name)
    shape = tuple(found.sizes[name] for name in ("condition", "alpha", "delta"))
    count = shape[1] * shape[2]
    value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
    for spot, page, table in placed:
        printed = table.flags.ravel() != BLANK
        if printed.sum() != count or not printed[:count].all():
            text = f"{printed.sum()} values in the {layout.name} table"
            raise ParseError(stacker.case.file, table.lines[-1], text, f"{count} values, alphas x deflections of the input cards")
        numbers, codes = (array.ravel()[:count].reshape(shape[1:]) for array in (table.values, table.flags))
        value[spot.condition], flag[spot.condition] = stacker.si(column, page, numbers, codes), codes
    add_variable(found, column, ["condition", "alpha", "delta"], value, flag)
    lines = stacker.lines(shape[:1], [((spot.condition,), table) for spot, _, table in placed])
    return found.assign_coords({f"lines_{column.quantity}": ("condition", lines)})


LEAVES = {"tabs": tabs}
