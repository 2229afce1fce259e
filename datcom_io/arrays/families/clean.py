"""Leaves over angle of attack: ``static downwash dynamic``."""

from __future__ import annotations

import xarray as xr

from ...printout.layouts import BY_NAME
from ..conditions import control_surface
from ..stacking import Axis, Stacker


def _over_alpha(stacker: Stacker, name: str) -> xr.Dataset | None:
    """Stack the tables of a kind that have one row per alpha and one page per configuration."""
    placed = stacker.placed(name)
    if not placed:
        return None
    device = "delta_e" if control_surface(stacker.case.deck) == "tail" else "delta_f"
    axes = [Axis("configuration", list(dict.fromkeys(page.configuration for _, page, _ in placed)))]
    if name != "dynamic":
        axes.append(Axis("power", list(dict.fromkeys(page.power for _, page, _ in placed))))
    axes.append(stacker.condition_axis())
    if name != "dynamic":
        axes.append(Axis("ground_height", sorted({spot.ground_height for spot, _, _ in placed}), "m"))
        axes.append(Axis(device, sorted({spot.delta for spot, _, _ in placed}), "deg"))
    items = []
    for spot, page, table in placed:
        key = {
            "configuration": page.configuration,
            "power": page.power,
            "condition": spot.condition,
            "ground_height": spot.ground_height,
            device: spot.delta,
        }
        items.append(([list(axis.values).index(key[axis.name]) for axis in axes], page, table))
    found = stacker.stack(BY_NAME[name].columns[1:], axes, stacker.axis(placed, "alpha", stacker.alphas()), items)
    found = found.squeeze([axis.name for axis in axes if axis.name != "condition" and len(axis.values) == 1])
    return found if stacker.case.deck.values("SYMFLP", "DELTA") else found.drop_vars(device, errors="ignore")


def static(stacker: Stacker) -> xr.Dataset | None:
    """Stack the static pages."""
    return _over_alpha(stacker, "static")


def downwash(stacker: Stacker) -> xr.Dataset | None:
    """Stack the downwash tables."""
    return _over_alpha(stacker, "downwash")


def dynamic(stacker: Stacker) -> xr.Dataset | None:
    """Stack the dynamic derivatives."""
    return _over_alpha(stacker, "dynamic")


LEAVES = {"static": static, "downwash": downwash, "dynamic": dynamic}
