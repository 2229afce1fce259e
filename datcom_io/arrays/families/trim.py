"""Leaves of trim: ``trim`` with a control device, ``trim_stabilizer`` with an all-movable
stabilizer.
"""

from __future__ import annotations

import numpy as np

from datcom_io.arrays.conditions import control_surface
from datcom_io.arrays.families.devices import LONG_NAMES
from datcom_io.arrays.stacking import LeafBuilder, Stacker
from datcom_io.cells import ABSENT, NA, OK, SENTINEL
from datcom_io.printout.layouts import BY_NAME

_AT_TRIM = ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin", "Ch_delta")
_UNDEFINED_IN_LEVEL_FLIGHT = (
    "dCDi",
    "Ch_alpha",
    "Ch_delta",
)  # the program writes variables there that it never sets
_TRIM_NAMES = LONG_NAMES | {
    "CL": "lift coefficient, untrimmed",
    "CD": "drag coefficient, untrimmed",
    "Cm": "pitching-moment coefficient, untrimmed",
    "delta_trim": "deflection of the control that trims",
    "dCL": "increment of the lift coefficient at trim",
    "dCLmax": "increment of the largest lift coefficient at trim",
    "dCDi": "increment of the induced-drag coefficient at trim",
    "dCDmin": "increment of the smallest drag coefficient at trim",
}
_STABILIZER_NAMES = {
    "CD_tail": "drag coefficient of the horizontal tail, untrimmed",
    "CL_tail": "lift coefficient of the horizontal tail, untrimmed",
    "Cm_tail": "pitching-moment coefficient of the horizontal tail, untrimmed",
    "Ch_tail": "hinge-moment coefficient of the stabilizer about its axis, on S and cbar, untrimmed",
    "i_tail": "incidence of the stabilizer that trims",
    "CD_tail_trim": "drag coefficient of the horizontal tail at trim",
    "CL_tail_trim": "lift coefficient of the horizontal tail at trim",
    "Cm_tail_trim": "pitching-moment coefficient of the horizontal tail at trim",
    "Ch_tail_trim": "hinge-moment coefficient of the stabilizer about its axis, on S and cbar, at "
    "trim",
    "CD": "drag coefficient of the aircraft at trim",
    "CL": "lift coefficient of the aircraft at trim",
}


def stack_trim(stacker: Stacker) -> LeafBuilder | None:
    """Stack trim with a control device; a row whose CM is NA is no solution, whatever stands behind
    it.
    """
    placed = stacker.placed("trim")
    if not placed:
        return None
    found = stacker.over_alpha(placed, stacker.axis(placed, "alpha", stacker.alphas()))
    unsolved = found["Cm_flag"].values == NA
    for name in _AT_TRIM:
        found[name].values[unsolved] = np.nan
        found[f"{name}_flag"].values[unsolved] = NA
        found[name].attrs["comment"] = "NA where CM is NA: the number printed there is no solution"
    _add_level_flight(stacker, found, "trim_level", _UNDEFINED_IN_LEVEL_FLIGHT)
    return found.described(_level_names(_TRIM_NAMES), surface=control_surface(stacker.case.deck))


def trim_stabilizer(stacker: Stacker) -> LeafBuilder | None:
    """Stack trim with an all-movable stabilizer: the tail alone, and the aircraft at trim."""
    placed, aircraft = stacker.placed("trim_stabilizer"), stacker.placed("trim_stabilizer_aircraft")
    if not placed:
        return None
    alphas = stacker.axis([*placed, *aircraft], "alpha", stacker.alphas())
    found = stacker.over_alpha(placed, alphas)
    leaked = (
        (found["Cm_tail_flag"].values == OK)
        & (found["Cm_tail"].values == 0.0)
        & (found["CL_tail"].values != 0.0)
    )
    found["Cm_tail"].values[leaked] = np.nan
    found["Cm_tail_flag"].values[leaked] = SENTINEL
    found["Cm_tail"].attrs["comment"] = (
        "sentinel where 0.0000 is printed for a tail with lift: the code of a missing number "
        "in four decimals"
    )
    if aircraft:
        found.add_renamed(
            stacker.over_alpha(aircraft, alphas), {"lines": "lines_aircraft"}
        )  # notes of the same pages
    _add_level_flight(stacker, found, "trim_stabilizer_level")
    return found.described(_level_names(_STABILIZER_NAMES), surface="tail")


def _add_level_flight(
    stacker: Stacker, found: LeafBuilder, name: str, left_out: tuple[str, ...] = ()
) -> None:
    """Add the row of level flight as variables (condition) called ``<name>_level``."""
    placed = stacker.placed(name)
    if not placed:
        return
    for column in BY_NAME[name].columns:
        if column.quantity in left_out:
            continue
        value, flag = (
            np.full(len(stacker.conditions), np.nan),
            np.full(len(stacker.conditions), ABSENT, np.uint8),
        )
        for spot, page, table in placed:
            row_value, row_flag = stacker.column(column, page, table)
            value[spot.condition], flag[spot.condition] = row_value[0], row_flag[0]
        found.add(column._replace(quantity=f"{column.quantity}_level"), ("condition",), value, flag)
    found.coords["lines_level"] = stacker.lines_of_conditions(placed)


def _level_names(names: dict[str, str]) -> dict[str, str]:
    level = {f"{name}_level": f"{text}, in level flight" for name, text in names.items()}
    return {**names, **level, "alpha_level": "angle of attack in level flight"}


LEAVES = {"trim": stack_trim, "trim_stabilizer": trim_stabilizer}
