"""A leaf of a tree in the making: variables by name, made a Dataset once all of them are there.

Every assignment to a Dataset aligns and copies what it holds already; that took two thirds of the time of `Case.to_datatree`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.names import VOCABULARY, attrs

from ..cells import FLAGS
from ..printout.columns import Column

OF_DIM = {"length": "m", "area": "m2", "speed": "m s-1", "pressure": "Pa", "temperature": "K", "reynolds": "m-1"}  # unit of card DIM
_SI = {"deg": "rad", "lbf": "N", **OF_DIM}
LONG_NAMES = {
    "CN": "normal-force coefficient, body axes",
    "CA": "axial-force coefficient, body axes, positive aft",
    "xcp": "centre of pressure forward of the moment centre, in chords: CM/CN, and CMA/CLA from the first row without CM or CN on",
    "ground_height": "height of the drawing datum (z = 0) over the ground, infinite in free air",
    "q_ratio": "dynamic pressure at the horizontal tail over that of the free stream",
    "epsilon": "downwash angle at the horizontal tail",
    "epsilon_alpha": "slope of the downwash angle with alpha",
}
_FLAG_ATTRS = {"flag_values": " ".join(map(str, range(len(FLAGS)))), "flag_meanings": " ".join(FLAGS)}


class Leaf:
    """Variables and coordinates by name, and attributes.

    Parameters
    ----------
    coords : mapping of str to Variable, optional
    """

    def __init__(self, coords: Mapping[str, xr.Variable] | None = None):
        self.variables: dict[str, xr.Variable] = {}
        self.coords = dict(coords or {})
        self.attrs: dict[str, str | float] = {}

    def __getitem__(self, name: str) -> xr.Variable:
        """Return a variable or a coordinate."""
        return self.variables[name] if name in self.variables else self.coords[name]

    def add(self, column: Column, dims: Sequence[str], value: np.ndarray, flag: np.ndarray) -> None:
        """Add the numbers of a column [SI] and the variable of their flags."""
        known = attrs(column.quantity) if column.quantity in VOCABULARY else {"units": _SI.get(column.units, "1")}
        if column.quantity in LONG_NAMES:
            known["long_name"] = LONG_NAMES[column.quantity]
        if column.units in ("1/angle", "1/deg"):
            known["per"] = "radian"
        self.variables[column.quantity] = xr.Variable(dims, value, {**known, "printed_as": column.name})
        self.variables[f"{column.quantity}_flag"] = xr.Variable(dims, flag, _FLAG_ATTRS)

    def add_renamed(self, other: Leaf, names: Mapping[str, str]) -> None:
        """Add the variables and coordinates of another leaf over the same axes, some under other names; what is there stays."""
        for own, others in ((self.variables, other.variables), (self.coords, other.coords)):
            for name, variable in others.items():
                own.setdefault(names.get(name, name), variable)

    def described(self, long_names: Mapping[str, str], **attributes: str | float) -> Leaf:
        """Give variables and coordinates their long names, those that are there, and the leaf its attributes; return the leaf."""
        for name, text in long_names.items():
            if name in self.variables or name in self.coords:
                self[name].attrs["long_name"] = text
        self.attrs |= attributes
        return self

    def dataset(self) -> xr.Dataset:
        """Return the leaf as a Dataset."""
        return xr.Dataset({**self.coords, **self.variables}, attrs=self.attrs).set_coords(list(self.coords))
