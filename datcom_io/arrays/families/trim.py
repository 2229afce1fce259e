"""Leaves of trim.

They are ``trim`` with a control device, and ``trim_stabilizer`` with an all-movable stabilizer.
"""

from __future__ import annotations

import numpy as np

from datcom_io.arrays.conditions import control_surface
from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.arrays.stacking import Stacker
from datcom_io.cells import NA, OK, SENTINEL
from datcom_io.printout.layouts.trim import AIRCRAFT, AIRCRAFT_LEVEL, STABILIZER, TRIM, TRIM_LEVEL
from datcom_io.printout.tables import TableLayout

_AT_TRIM = ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin", "Ch_delta")
# In the row of level flight the program prints variables here that it never sets.
_UNDEFINED_IN_LEVEL_FLIGHT = ("dCDi", "Ch_alpha", "Ch_delta")


def stack_trim(stacker: Stacker) -> LeafBuilder | None:
    """Stack trim with a control device.

    A row whose CM is NA is not a solution, whatever numbers it prints at trim.
    """
    placed = stacker.placed_tables(TRIM.name)
    if not placed:
        return None
    alphas = stacker.row_axis(placed, "alpha", stacker.alphas())
    leaf = stacker.stack_over_alpha(placed, alphas)
    unsolved = leaf["Cm_flag"].values == NA
    for name in _AT_TRIM:
        leaf[name].values[unsolved] = np.nan
        leaf[f"{name}_flag"].values[unsolved] = NA
        leaf[name].attrs["comment"] = "NA where CM is NA: the number printed there is no solution"
    _add_level_flight(stacker, leaf, TRIM_LEVEL, undefined=_UNDEFINED_IN_LEVEL_FLIGHT)
    return leaf.describe({}, surface=control_surface(stacker.case.deck))


def trim_stabilizer(stacker: Stacker) -> LeafBuilder | None:
    """Stack trim with an all-movable stabilizer: the tail alone, and the aircraft at trim."""
    placed = stacker.placed_tables(STABILIZER.name)
    if not placed:
        return None
    aircraft = stacker.placed_tables(AIRCRAFT.name)
    alphas = stacker.row_axis([*placed, *aircraft], "alpha", stacker.alphas())
    leaf = stacker.stack_over_alpha(placed, alphas)
    # These pages print the sentinel of a missing number in four decimals, as 0.0000.
    moment, moment_flag = leaf["Cm_tail"], leaf["Cm_tail_flag"]
    is_zero = (moment_flag.values == OK) & (moment.values == 0.0)
    is_sentinel = is_zero & (leaf["CL_tail"].values != 0.0)
    moment.values[is_sentinel] = np.nan
    moment_flag.values[is_sentinel] = SENTINEL
    moment.attrs["comment"] = (
        "sentinel where 0.0000 is printed for a tail with lift: the code of a missing number "
        "in four decimals"
    )
    if aircraft:
        # The notes of both tables are those of the same pages.
        leaf.add_renamed(stacker.stack_over_alpha(aircraft, alphas), {"lines": "lines_aircraft"})
    _add_level_flight(stacker, leaf, AIRCRAFT_LEVEL)
    return leaf.describe({}, surface="tail")


def _add_level_flight(
    stacker: Stacker, leaf: LeafBuilder, layout: TableLayout, undefined: tuple[str, ...] = ()
) -> None:
    """Add the row of level flight as variables (condition) called ``<name>_level``."""
    placed = stacker.placed_tables(layout.name)
    if not placed:
        return
    # Level flight has its own alpha, so alpha becomes a variable too.
    for column in layout.columns:
        if column.quantity in undefined:
            continue
        value, flag = empty_cells(len(stacker.conditions))
        for spot, page, table in placed:
            row_value, row_flag = stacker.read_column(column, page, table)
            value[spot.condition], flag[spot.condition] = row_value[0], row_flag[0]
        meaning = f"{column.meaning}, in level flight"
        if column.quantity == "alpha":
            meaning = "angle of attack in level flight"
        level = column._replace(quantity=f"{column.quantity}_level", meaning=meaning)
        leaf.add_described(level, ("condition",), value, flag)
    leaf.coords["lines_level"] = stacker.line_ranges_by_condition(placed)


LEAVES = {"trim": stack_trim, "trim_stabilizer": trim_stabilizer}
