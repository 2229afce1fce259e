"""Leaves of high-lift and control devices: ``symflp asyflp spoiler``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import control_surface
from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.arrays.stacking import HALF_UNIT, PlacedTable, StackedAxis, Stacker
from datcom_io.decks.deck import Deck
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable
from flightmech.units import DEGREE

# FTYPE 1 to 8; for the last one the program does not print a heading.
_DEVICES = (
    "plain trailing-edge flap",
    "single-slotted flap",
    "fowler flap",
    "double-slotted flap",
    "split flap",
    "leading-edge flap",
    "leading-edge slat",
    "krueger flap",
)


def stack_symflp(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of a symmetrical device, hinge moments and induced drag."""
    placed = stacker.placed_tables("symflp")
    if not placed:
        return None
    deck = stacker.case.deck
    exact = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    deltas = stacker.row_axis(placed, "delta", exact)
    leaf = stacker.stack_over_rows(BY_NAME["symflp"].columns[1:], placed, deltas)
    # A subsonic page also prints the induced drag over alpha and deflection.
    drag = stacker.placed_tables("dcdi")
    if drag:
        stacker.add_two_way(leaf, drag, deltas)
    surface, device = _surface_and_device(placed[0][1].configuration, deck)
    return leaf.describe({}, surface=surface, device=device)


def _surface_and_device(configuration: str, deck: Deck) -> tuple[str, str]:
    """Return surface and device by the heading, or by the cards where the heading lacks them."""
    surface, _, device = configuration.lower().partition(" ")
    if surface in ("wing", "tail") and device in _DEVICES:
        return surface, device
    kind = int(deck.value("SYMFLP", "FTYPE") or 0)
    if not 0 < kind <= len(_DEVICES):
        return control_surface(deck), ""
    return control_surface(deck), _DEVICES[kind - 1]


# The difference of two angles has the rounding of both.
_HALF_UNIT_OF_DIFFERENCE = 2 * HALF_UNIT
_ASYFLP_NAMES = {
    "Cl_transonic": "rolling-moment coefficient, where the program prints one for all alphas",
    "delta_difference": "deflection of the left side less that of the right",
}


def stack_asyflp(stacker: Stacker) -> LeafBuilder | None:
    """Stack rolling and yawing moment of ailerons, or the rolling moment of a differential tail."""
    roll = stacker.placed_tables("asyflp_roll")
    tail = stacker.placed_tables("asyflp_tail")
    if not roll and not tail:
        return None
    configuration = (roll or tail)[0][1].configuration
    # The first table has the difference of both sides, the second one the pair.
    deltas_left, deltas_right = _side_deflections(stacker, roll)
    difference = [delta_l - delta_r for delta_l, delta_r in zip(deltas_left, deltas_right)]
    if not difference:
        difference = _printed_difference(tail)
    pairs = StackedAxis("delta_pair", list(range(len(difference))))
    if tail or "STABILIZER" in configuration:
        surface = "tail"
        leaf = _stack_differential_tail(stacker, roll, tail, pairs=pairs, difference=difference)
    else:
        surface = "wing"
        leaf = _stack_roll(stacker, roll, pairs)
        yaw = stacker.placed_tables("asyflp_cn")
        if yaw:
            stacker.add_two_way(leaf, yaw, pairs, difference, half_unit=_HALF_UNIT_OF_DIFFERENCE)
    # Without a pair of deflections the difference alone is known.
    sides = {"delta_difference": difference}
    if deltas_left and deltas_right:
        sides = {"delta_left": deltas_left, "delta_right": deltas_right}
    for name, deflections in sides.items():
        values = np.array(deflections[: len(difference)]) * DEGREE
        leaf.coords[name] = xr.Variable("delta_pair", values, {"units": "rad", "sign": "TED"})
    device = configuration.removeprefix("WING ").lower()
    return leaf.describe(_ASYFLP_NAMES, surface=surface, device=device)


def _stack_differential_tail(
    stacker: Stacker,
    roll: list[PlacedTable],
    tail: list[PlacedTable],
    pairs: StackedAxis,
    difference: list[float],
) -> LeafBuilder:
    """Return the rolling moment by alpha, and the transonic one.

    On a transonic page the program prints one rolling moment for all alphas.
    """
    leaf = LeafBuilder(stacker.make_coords([stacker.condition_axis(), pairs]))
    if tail:
        stacker.add_two_way(leaf, tail, pairs, difference, half_unit=_HALF_UNIT_OF_DIFFERENCE)
    if roll:
        names = {
            "Cl": "Cl_transonic",
            "Cl_flag": "Cl_transonic_flag",
            "lines": "lines_Cl_transonic",
        }
        leaf.add_renamed(_stack_roll(stacker, roll, pairs), names)
    return leaf


def _side_deflections(stacker: Stacker, roll: list[PlacedTable]) -> tuple[list[float], list[float]]:
    """Return the deflections of left and right. [deg]

    They are those of the cards, checked against the printed pairs, or the printed ones.
    """
    sides = []
    for k, (name, variable) in enumerate((("delta_left", "DELTAL"), ("delta_right", "DELTAR"))):
        deflections = stacker.case.deck.schedule("ASYFLP", variable, "NDELTA")
        if roll:
            deflections = list(stacker.row_axis(roll, name, deflections, column=k).values)
        sides.append(deflections)
    return sides[0], sides[1]


def _printed_difference(tail: list[PlacedTable]) -> list[float]:
    across = tail[0][2].across
    assert across is not None
    return [float(x) for x in across]


def _stack_roll(stacker: Stacker, roll: list[PlacedTable], pairs: StackedAxis) -> LeafBuilder:
    # The first two columns are the deflections of a pair.
    return stacker.stack_over_rows(BY_NAME["asyflp_roll"].columns[2:], roll, pairs)


# The columns of spoiler heights and the variables of ASYFLP that they print.
_SPOILERS = ("spoiler", "spoiler_slot", "spoiler_supersonic")
_SPOILER_CARDS = {"xs_c": "XSOC", "hs_c": "HSOC", "dd_c": "DELTAD", "ds_c": "DELTAS"}
_HALF_UNIT_OF_CHORD = 5.01e-5  # heights are printed with four decimals


def stack_spoiler(stacker: Stacker) -> LeafBuilder | None:
    """Stack rolling and yawing moment of spoilers over the number of the deflection.

    The heights of the spoiler are coordinates of the deflection.
    """
    placed: list[PlacedTable] = []
    for name in _SPOILERS:
        placed += stacker.placed_tables(name)
    if not placed:
        return None
    count = max(len(table.rows) for _, _, table in placed)
    deflections = StackedAxis("deflection", list(range(count)))
    leaf = LeafBuilder(stacker.make_coords([stacker.condition_axis(), deflections]))
    # All three layouts print rolling and yawing moment; their columns differ.
    for column in BY_NAME["spoiler"].columns[3:]:
        value, flag = empty_cells((len(stacker.conditions), count))
        for spot, page, table in placed:
            printed = _column_of(table, column.quantity)
            assert printed is not None
            rows = len(table.rows)
            numbers, codes = stacker.read_column(printed, page, table)
            value[spot.condition, :rows] = numbers
            flag[spot.condition, :rows] = codes
        leaf.add(column, ("condition", "deflection"), value, flag)
    leaf.coords["lines"] = stacker.line_ranges_by_condition(placed)
    leaf.coords |= _height_coords(stacker, [table for _, _, table in placed], count)
    device = placed[0][1].configuration.removeprefix("WING WITH ").lower()
    return leaf.describe({}, surface="wing", device=device)


def _column_of(table: PrintedTable, quantity: str) -> PrintedColumn | None:
    """Return the column of a quantity, None where the table does not print it."""
    for column in table.columns:
        if column.quantity == quantity:
            return column
    return None


def _height_coords(
    stacker: Stacker, tables: list[PrintedTable], count: int
) -> dict[str, xr.Variable]:
    """Return the spoiler heights of each deflection.

    They are those of the cards, checked against every table that prints them, or the printed ones.
    """
    coords: dict[str, xr.Variable] = {}
    for quantity, variable in _SPOILER_CARDS.items():
        heights = stacker.case.deck.schedule("ASYFLP", variable, "NDELTA")
        for table in tables:
            column = _column_of(table, quantity)
            if column is None:
                continue
            printed = table.values[:, table.columns.index(column)]
            if not heights:
                heights = [float(x) for x in printed]
            stacker.check_axis(
                column.name,
                printed,
                exact=heights,
                lines=table.lines,
                half_unit=_HALF_UNIT_OF_CHORD,
                units="1",
            )
            # A table may have fewer deflections than the longest one.
            values = np.array([*heights, *[np.nan] * count][:count])
            attrs = {"units": "1", "printed_as": column.name, "long_name": column.meaning}
            coords[quantity] = xr.Variable("deflection", values, attrs)
    return coords


LEAVES = {"symflp": stack_symflp, "asyflp": stack_asyflp, "spoiler": stack_spoiler}
