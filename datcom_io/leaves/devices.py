"""Leaves of high-lift and control devices: ``symflp asyflp``."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.units import DEGREE

from ..arrange import control_surface
from ..layouts import BY_NAME
from ..stacking import HALF_UNIT, Axis, Stacker


def symflp(stacker: Stacker) -> xr.Dataset | None:
    """Stack the increments of a symmetrical device, hinge moments and induced drag."""
    placed = stacker.placed("symflp")
    if not placed:
        return None
    deltas = stacker.axis(placed, "delta", stacker.case.deck.schedule("SYMFLP", "DELTA", "NDELTA"))
    items = [([spot.condition], page, table) for spot, page, table in placed]
    found = stacker.stack(BY_NAME["symflp"].columns[1:], [stacker.condition_axis()], deltas, items)
    if drag := stacker.placed("dcdi"):
        found = stacker.with_two_way(found, drag, deltas)
    words = placed[0][1].configuration.split(None, 1)
    surface = words[0].lower() if words and words[0] in ("WING", "TAIL") else control_surface(stacker.case.deck)
    return found.assign_attrs(surface=surface, device=words[1].lower() if len(words) > 1 else "")


def asyflp(stacker: Stacker) -> xr.Dataset | None:
    """Stack rolling and yawing moment of ailerons."""
    placed = stacker.placed("asyflp_roll")
    if not placed:
        return None
    sides = []
    for k, (name, variable) in enumerate((("delta_left", "DELTAL"), ("delta_right", "DELTAR"))):
        sides.append(stacker.axis(placed, name, stacker.case.deck.schedule("ASYFLP", variable, "NDELTA"), column=k))
    pairs = Axis("delta_pair", list(range(len(sides[0].values))))
    items = [([spot.condition], page, table) for spot, page, table in placed]
    found = stacker.stack(BY_NAME["asyflp_roll"].columns[2:], [stacker.condition_axis()], pairs, items)
    if yaw := stacker.placed("asyflp_cn"):
        difference = [left - right for left, right in zip(sides[0].values, sides[1].values)]
        # each angle is rounded, so their difference may be off by two half units
        found = stacker.with_two_way(found, yaw, pairs, difference, 2 * HALF_UNIT)
    for side in sides:
        found = found.assign_coords({side.name: ("delta_pair", np.array(side.values) * DEGREE, {"units": "rad", "sign": "TED"})})
    words = placed[0][1].configuration
    surface = "tail" if "STABILIZER" in words else "wing"
    return found.assign_attrs(surface=surface, device=words.removeprefix("WING ").lower())


LEAVES = {"symflp": symflp, "asyflp": asyflp}
