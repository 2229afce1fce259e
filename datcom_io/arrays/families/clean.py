"""Leaves over angle of attack: ``static downwash dynamic``."""

from __future__ import annotations

from typing import Any

from datcom_io.arrays.conditions import control_surface
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.arrays.stacking import StackedAxis, Stacker
from datcom_io.printout.layouts import BY_NAME


def _stack_pages(stacker: Stacker, name: str) -> LeafBuilder | None:
    """Stack the tables of a kind that have one row per alpha and one page per configuration."""
    placed = stacker.placed_tables(name)
    if not placed:
        return None
    deck = stacker.case.deck
    device = "delta_f"
    if control_surface(deck) == "tail":
        device = "delta_e"

    # Coordinates of each page along the possible axes.
    keys = []
    for spot, page, _ in placed:
        key = {
            "configuration": page.configuration,
            "power": page.power,
            "condition": spot.condition,
            "ground_height": spot.ground_height,
            device: spot.delta,
        }
        keys.append(key)

    axes = _page_axes(stacker, keys, device, over_ground=name != "dynamic")
    # An axis of one value becomes a scalar coordinate; conditions always stay an axis.
    dims = [axis for axis in axes if axis.name == "condition" or len(axis.values) > 1]
    items = []
    for key, (_, page, table) in zip(keys, placed):
        index = [list(axis.values).index(key[axis.name]) for axis in dims]
        items.append((index, page, table))
    # The angles of all pages must agree with the input cards.
    alphas = stacker.row_axis(placed, "alpha", stacker.alphas())
    leaf = stacker.stack(BY_NAME[name].columns[1:], dims, rows=alphas, items=items)
    for axis in axes:
        if axis not in dims:
            leaf.coords[axis.name] = stacker.make_coordinate(axis).squeeze()
    # Without SYMFLP the deflection is that of a hypersonic flap, or there is none.
    if not deck.values("SYMFLP", "DELTA") and device not in {axis.name for axis in dims}:
        leaf.coords.pop(device, None)
    return leaf


def _page_axes(
    stacker: Stacker, keys: list[dict[str, Any]], device: str, *, over_ground: bool
) -> list[StackedAxis]:
    """Return the axes of pages; dynamic pages have no power, ground height and deflection."""
    configurations = dict.fromkeys(key["configuration"] for key in keys)
    axes = [StackedAxis("configuration", list(configurations))]
    if not over_ground:
        return [*axes, stacker.condition_axis()]
    powers = dict.fromkeys(key["power"] for key in keys)
    heights = {key["ground_height"] for key in keys}
    deltas = {key[device] for key in keys}
    return [
        *axes,
        StackedAxis("power", list(powers)),
        stacker.condition_axis(),
        StackedAxis("ground_height", sorted(heights), "m"),
        StackedAxis(device, sorted(deltas), "deg"),
    ]


def stack_static(stacker: Stacker) -> LeafBuilder | None:
    """Stack the static pages."""
    return _stack_pages(stacker, "static")


def stack_downwash(stacker: Stacker) -> LeafBuilder | None:
    """Stack the downwash tables."""
    return _stack_pages(stacker, "downwash")


def stack_dynamic(stacker: Stacker) -> LeafBuilder | None:
    """Stack the dynamic derivatives."""
    return _stack_pages(stacker, "dynamic")


LEAVES = {"static": stack_static, "downwash": stack_downwash, "dynamic": stack_dynamic}
