"""Construction of one leaf of a tree: variables with their flags, coordinates, attributes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
import xarray as xr

from datcom_io.cells import ABSENT, FLAGS
from datcom_io.printout.rows import PrintedColumn
from flightmech.names import VOCABULARY, quantity_attributes
from flightmech.units import parse_unit

# SI unit of a quantity whose printed unit depends on card DIM.
OF_DIM = {
    "length": "m",
    "area": "m2",
    "speed": "m s-1",
    "pressure": "Pa",
    "temperature": "K",
    "reynolds": "m-1",
}
_SI = {"deg": "rad", "lbf": "N", **OF_DIM}
# Quantities of the print that the vocabulary of the product does not describe.
LONG_NAMES = {
    "CN": "normal-force coefficient, body axes",
    "CA": "axial-force coefficient, body axes, positive aft",
    "xcp": "centre of pressure forward of the moment centre, in chords: CM/CN, and CMA/CLA from "
    "the first row without CM or CN on",
    "ground_height": "height of the drawing datum (z = 0) over the ground, infinite in free air",
    "q_ratio": "dynamic pressure at the horizontal tail over that of the free stream",
    "epsilon": "downwash angle at the horizontal tail",
    "epsilon_alpha": "slope of the downwash angle with alpha",
}
_FLAG_ATTRS = {
    "flag_values": " ".join(map(str, range(len(FLAGS)))),
    "flag_meanings": " ".join(FLAGS),
}


@lru_cache
def unit_factor(units: str) -> float:
    """Return the factor from a unit to SI."""
    return parse_unit(units)[1]


def empty_cells(shape: int | tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return values NaN and flags ``absent`` of a shape, to be filled from the print."""
    return np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)


def describe_quantity(name: str, units: str) -> dict[str, str]:
    """Return the attributes of a quantity: those of the vocabulary, or else its unit and long name.

    `units` is the SI unit of a quantity that the vocabulary does not have; it may be empty.
    """
    attrs: dict[str, str] = {}
    if name in VOCABULARY:
        attrs = quantity_attributes(name)
    elif units:
        attrs = {"units": units}
    if name in LONG_NAMES:
        attrs["long_name"] = LONG_NAMES[name]
    return attrs


class LeafBuilder:
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
        if name in self.variables:
            return self.variables[name]
        return self.coords[name]

    def add(
        self, column: PrintedColumn, dims: Sequence[str], value: np.ndarray, flag: np.ndarray
    ) -> None:
        """Add the numbers of a column [SI] and the variable of their flags."""
        # Slopes become per radian, whatever the print is.
        attrs = describe_quantity(column.quantity, _SI.get(column.units, "1"))
        if column.units in ("1/angle", "1/deg"):
            attrs["per"] = "radian"
        attrs["printed_as"] = column.name
        self.variables[column.quantity] = xr.Variable(dims, value, attrs)
        self.variables[f"{column.quantity}_flag"] = xr.Variable(dims, flag, _FLAG_ATTRS)

    def add_described(
        self, column: PrintedColumn, dims: Sequence[str], value: np.ndarray, flag: np.ndarray
    ) -> None:
        """Add the numbers of a column [SI] and their flags, with the meaning of the column."""
        self.add(column, dims, value, flag)
        if column.meaning:
            self.variables[column.quantity].attrs["long_name"] = column.meaning

    def add_renamed(self, leaf: LeafBuilder, names: Mapping[str, str]) -> None:
        """Add variables and coordinates of another leaf over the same axes, some under other names.

        A variable or coordinate that is already there stays.
        """
        for name, variable in leaf.variables.items():
            self.variables.setdefault(names.get(name, name), variable)
        for name, variable in leaf.coords.items():
            self.coords.setdefault(names.get(name, name), variable)

    def describe(self, long_names: Mapping[str, str], **attributes: str | float) -> LeafBuilder:
        """Set long names of variables and coordinates, and attributes of the leaf; return the leaf.

        Names that the leaf does not have are ignored.
        """
        for name, text in long_names.items():
            if name in self.variables or name in self.coords:
                self[name].attrs["long_name"] = text
        self.attrs |= attributes
        return self

    def to_dataset(self) -> xr.Dataset:
        """Return the leaf as a Dataset."""
        dataset = xr.Dataset({**self.coords, **self.variables}, attrs=self.attrs)
        return dataset.set_coords(list(self.coords))
