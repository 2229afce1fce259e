"""Leaves of high-lift and control devices: ``symflp asyflp spoiler``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import PagePlace, control_surface
from datcom_io.arrays.stacking import HALF_UNIT, LeafBuilder, StackedAxis, Stacker
from datcom_io.cells import ABSENT
from datcom_io.decks.deck import Deck
from datcom_io.printout.content import Page
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.tables import PrintedTable
from flightmech.units import DEGREE

_Placed = list[tuple[PagePlace, Page, PrintedTable]]

LONG_NAMES = {
    "dCL": "increment of the lift coefficient, constant in alpha",
    "dCm": "increment of the pitching-moment coefficient",
    "dCLmax": "increment of the largest lift coefficient",
    "dCDmin": "increment of the smallest drag coefficient",
    "dCDi": "increment of the induced-drag coefficient",
    "CL_alpha_delta": "lift-curve slope of the surface with the device deflected",
    "Ch_alpha": "hinge-moment coefficient per alpha, on twice the area moment of the control "
    "about its hinge line",
    "Ch_delta": "hinge-moment coefficient per deflection, on twice the area moment of the control "
    "about its hinge line",
    "Cl_transonic": "rolling-moment coefficient, where the program prints one for all alphas",
    "delta_difference": "deflection of the left side less that of the right",
    "xs_c": "spoiler lip behind the leading edge of the wing, in local chords",
    "hs_c": "height of the spoiler over the mean line of the airfoil, in local chords",
    "dd_c": "height of the deflector of a spoiler-slot-deflector, in local chords",
    "ds_c": "projected height of the spoiler, in local chords",
}
_DEVICES = (
    "plain trailing-edge flap",
    "single-slotted flap",
    "fowler flap",
    "double-slotted flap",
    "split flap",
    "leading-edge flap",
    "leading-edge slat",
    "krueger flap",
)  # FTYPE 1 to 8; for the last one no heading is printed
_SPOILERS = ("spoiler", "spoiler_slot", "spoiler_supersonic")
_SPOILER_CARDS = {"xs_c": "XSOC", "hs_c": "HSOC", "dd_c": "DELTAD", "ds_c": "DELTAS"}
_HALF_UNIT_OF_DIFFERENCE = 2 * HALF_UNIT  # both angles are rounded
_HALF_UNIT_OF_CHORD = 5.01e-5  # of spoiler heights, printed with four decimals


def stack_symflp(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of a symmetrical device, hinge moments and induced drag."""
    placed = stacker.placed("symflp")
    if not placed:
        return None
    deltas = stacker.axis(placed, "delta", stacker.case.deck.schedule("SYMFLP", "DELTA", "NDELTA"))
    items = [([spot.condition], page, table) for spot, page, table in placed]
    found = stacker.stack(BY_NAME["symflp"].columns[1:], [stacker.condition_axis()], deltas, items)
    if drag := stacker.placed("dcdi"):
        stacker.with_two_way(found, drag, deltas)
    surface, device = _device(placed[0][1].configuration, stacker.case.deck)
    return found.described(LONG_NAMES, surface=surface, device=device)


def _device(configuration: str, deck: Deck) -> tuple[str, str]:
    """Return surface and device by the heading, or by the cards where the heading does not name
    them.
    """
    surface, _, device = configuration.lower().partition(" ")
    if surface in ("wing", "tail") and device in _DEVICES:
        return surface, device
    kind = int(deck.value("SYMFLP", "FTYPE") or 0)
    return control_surface(deck), _DEVICES[kind - 1] if 0 < kind <= len(_DEVICES) else ""


def stack_asyflp(stacker: Stacker) -> LeafBuilder | None:
    """Stack rolling and yawing moment of ailerons, or the rolling moment of a differential tail."""
    roll, tail = stacker.placed("asyflp_roll"), stacker.placed("asyflp_tail")
    if not roll and not tail:
        return None
    words = (roll or tail)[0][1].configuration
    surface = "tail" if tail or "STABILIZER" in words else "wing"
    left, right = _sides(stacker, roll)
    difference = [one - other for one, other in zip(left, right)] or _printed_difference(tail)
    pairs = StackedAxis("delta_pair", list(range(len(difference))))
    if surface == "tail":
        found = _differential_tail(stacker, roll, tail, pairs, difference)
    else:
        found = _rolling(stacker, roll, pairs)
        if yaw := stacker.placed("asyflp_cn"):
            stacker.with_two_way(found, yaw, pairs, difference, _HALF_UNIT_OF_DIFFERENCE)
    sides = (
        {"delta_left": left, "delta_right": right}
        if left and right
        else {"delta_difference": difference}
    )
    for name, side in sides.items():
        degrees = np.array(side[: len(difference)])
        found.coords[name] = xr.Variable(
            "delta_pair", degrees * DEGREE, {"units": "rad", "sign": "TED"}
        )
    return found.described(LONG_NAMES, surface=surface, device=words.removeprefix("WING ").lower())


def _differential_tail(
    stacker: Stacker, roll: _Placed, tail: _Placed, pairs: StackedAxis, difference: list[float]
) -> LeafBuilder:
    """Return the rolling moment by alpha, and the transonic one, which the program prints without
    alpha.
    """
    found = LeafBuilder(stacker.coords([stacker.condition_axis(), pairs]))
    if tail:
        stacker.with_two_way(found, tail, pairs, difference, _HALF_UNIT_OF_DIFFERENCE)
    if roll:
        names = {
            "Cl": "Cl_transonic",
            "Cl_flag": "Cl_transonic_flag",
            "lines": "lines_Cl_transonic",
        }
        found.add_renamed(_rolling(stacker, roll, pairs), names)
    return found


def _sides(stacker: Stacker, roll: _Placed) -> tuple[list[float], list[float]]:
    """Return the deflections of left and right by the cards, checked against the printed pairs, or
    those. [deg]
    """
    sides = []
    for k, (name, variable) in enumerate((("delta_left", "DELTAL"), ("delta_right", "DELTAR"))):
        exact = stacker.case.deck.schedule("ASYFLP", variable, "NDELTA")
        sides.append(list(stacker.axis(roll, name, exact, column=k).values) if roll else exact)
    return sides[0], sides[1]


def _printed_difference(tail: _Placed) -> list[float]:
    across = tail[0][2].across
    assert across is not None
    return [float(x) for x in across]


def _rolling(stacker: Stacker, roll: _Placed, pairs: StackedAxis) -> LeafBuilder:
    items = [([spot.condition], page, table) for spot, page, table in roll]
    return stacker.stack(
        BY_NAME["asyflp_roll"].columns[2:], [stacker.condition_axis()], pairs, items
    )


def stack_spoiler(stacker: Stacker) -> LeafBuilder | None:
    """Stack rolling and yawing moment of spoilers; their heights are coordinates of the deflection."""
    placed = [item for name in _SPOILERS for item in stacker.placed(name)]
    if not placed:
        return None
    count = max(len(table.rows) for _, _, table in placed)
    deflections = StackedAxis("deflection", list(range(count)))
    axes = [stacker.condition_axis(), deflections]
    found = LeafBuilder(stacker.coords(axes))
    for column in BY_NAME["spoiler"].columns[3:]:
        value, flag = (
            np.full((len(stacker.conditions), count), np.nan),
            np.full((len(stacker.conditions), count), ABSENT, np.uint8),
        )
        for spot, page, table in placed:
            own = next(other for other in table.columns if other.quantity == column.quantity)
            rows = len(table.rows)
            value[spot.condition, :rows], flag[spot.condition, :rows] = stacker.column(
                own, page, table
            )
        found.add(column, ("condition", "deflection"), value, flag)
    found.coords["lines"] = stacker.lines_of_conditions(placed)
    found.coords |= _heights(stacker, [table for _, _, table in placed], count)
    words = placed[0][1].configuration
    return found.described(
        LONG_NAMES, surface="wing", device=words.removeprefix("WING WITH ").lower()
    )


def _heights(stacker: Stacker, tables: list[PrintedTable], count: int) -> dict[str, xr.Variable]:
    """Return what names a deflection, by the cards, checked against every table that prints it; or
    as printed.
    """
    found: dict[str, xr.Variable] = {}
    for quantity, variable in _SPOILER_CARDS.items():
        exact = stacker.case.deck.schedule("ASYFLP", variable, "NDELTA")
        for table in tables:
            at = next(
                (k for k, column in enumerate(table.columns) if column.quantity == quantity), None
            )
            if at is None:
                continue
            exact = exact or [float(x) for x in table.values[:, at]]
            stacker.demand(
                table.columns[at].name,
                table.values[:, at],
                exact,
                table.lines,
                _HALF_UNIT_OF_CHORD,
                "1",
            )
            values = [*exact, *[np.nan] * count][:count]
            found[quantity] = xr.Variable(
                "deflection", np.array(values), {"units": "1", "printed_as": table.columns[at].name}
            )
    return found


LEAVES = {"symflp": stack_symflp, "asyflp": stack_asyflp, "spoiler": stack_spoiler}
