"""The leaf of control tabs: ``tabs``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from ..cells import ABSENT
from ..layouts import tabs as streams
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
    deck = stacker.case.deck
    alphas, deltas = stacker.alphas(), deck.schedule("SYMFLP", "DELTA", "NDELTA")
    layouts = [layout for layout in streams.LAYOUTS if stacker.placed(layout.name)]
    if not layouts or not alphas or not deltas:
        return None
    axes = [stacker.condition_axis(), Axis("alpha", alphas, "deg"), Axis("delta", deltas, "deg")]
    shape, count = tuple(len(axis.values) for axis in axes), len(alphas) * len(deltas)
    found = xr.Dataset(coords=stacker.coords(axes))
    for layout in layouts:
        column = layout.columns[0]
        placed = stacker.placed(layout.name)
        for _, group in stacker.case.values(layout.name):
            stacker.demand(group.labels[0], group.values, deltas, group.lines)
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        for spot, page, table in placed:
            flag[spot.condition].flat[:] = table.flags.ravel()[:count]
            value[spot.condition] = stacker.si(column, page, table.values.ravel()[:count].reshape(shape[1:]), flag[spot.condition])
        add_variable(found, column, ["condition", "alpha", "delta"], value, flag)
        lines = stacker.lines(shape[:1], [((spot.condition,), table) for spot, _, table in placed])
        found = found.assign_coords({f"lines_{column.house}": ("condition", lines)})
    first_of_line = np.arange(count).reshape(shape[1:]) % streams.PER_LINE == 0
    found["one_decimal"] = (("alpha", "delta"), first_of_line.astype(np.uint8), {"units": "1"})
    return describe(found, _LONG_NAMES)


LEAVES = {"tabs": tabs}
