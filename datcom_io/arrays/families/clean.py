"""Leaves over angle of attack: ``static downwash dynamic``."""

from __future__ import annotations

from datcom_io.arrays.conditions import control_surface
from datcom_io.arrays.stacking import LeafBuilder, StackedAxis, Stacker
from datcom_io.printout.layouts import BY_NAME


def _over_alpha(stacker: Stacker, name: str) -> LeafBuilder | None:
    """Stack the tables of a kind that have one row per alpha and one page per configuration."""
    placed = stacker.placed(name)
    if not placed:
        return None
    device = "delta_e" if control_surface(stacker.case.deck) == "tail" else "delta_f"
    axes = [
        StackedAxis(
            "configuration", list(dict.fromkeys(page.configuration for _, page, _ in placed))
        )
    ]
    if name != "dynamic":
        axes.append(StackedAxis("power", list(dict.fromkeys(page.power for _, page, _ in placed))))
    axes.append(stacker.condition_axis())
    if name != "dynamic":
        axes.append(
            StackedAxis("ground_height", sorted({spot.ground_height for spot, _, _ in placed}), "m")
        )
        axes.append(StackedAxis(device, sorted({spot.delta for spot, _, _ in placed}), "deg"))
    kept = [axis for axis in axes if axis.name == "condition" or len(axis.values) > 1]
    items = []
    for spot, page, table in placed:
        key = {
            "configuration": page.configuration,
            "power": page.power,
            "condition": spot.condition,
            "ground_height": spot.ground_height,
            device: spot.delta,
        }
        items.append(([list(axis.values).index(key[axis.name]) for axis in kept], page, table))
    found = stacker.stack(
        BY_NAME[name].columns[1:], kept, stacker.axis(placed, "alpha", stacker.alphas()), items
    )
    found.coords |= {
        axis.name: stacker.coordinate(axis).squeeze() for axis in axes if axis not in kept
    }
    if not stacker.case.deck.values("SYMFLP", "DELTA"):
        found.coords.pop(device, None)
    return found


def stack_static(stacker: Stacker) -> LeafBuilder | None:
    """Stack the static pages."""
    return _over_alpha(stacker, "static")


def stack_downwash(stacker: Stacker) -> LeafBuilder | None:
    """Stack the downwash tables."""
    return _over_alpha(stacker, "downwash")


def stack_dynamic(stacker: Stacker) -> LeafBuilder | None:
    """Stack the dynamic derivatives."""
    return _over_alpha(stacker, "dynamic")


LEAVES = {"static": stack_static, "downwash": stack_downwash, "dynamic": stack_dynamic}
