"""Terms as factors of a JSBSim product: properties for the regressors, tables in the units of its properties."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.terms import regressors

from .properties import AXIS, ENGINE, LIFT_SQUARED, OWN, REGRESSOR, throttle, thrust, unit

_LOOKUP = ("column", "row", "table", "axis4")  # from the last dimension backwards


def factors(leaf: xr.Dataset, native: bool) -> list[ET.Element]:
    """Return the factors of a term: its regressors and tables as elements of a product; `native` as in `table`."""
    words = regressors(leaf)
    found = [_text("property", LIFT_SQUARED)] if words == ("CL", "CL") else []
    for word in () if found else words:
        found += [_text("property", name) for name in REGRESSOR.get(word) or (property_of(word),)]
        if unit(word) != 1.0:
            found.append(_text("value", repr(unit(word))))
    return found + [table(leaf[name], native) for name in ("value", "K1", "K2") if name in leaf]


def property_of(variable: str) -> str:
    """Return the property that holds a variable, in the unit of `unit`."""
    engine = ENGINE.match(variable)
    if engine:
        return throttle(int(engine[1])) if engine[2] == "throttle" else thrust(int(engine[1]))
    return AXIS.get(variable, OWN + variable)


def table(values: xr.DataArray, native: bool) -> ET.Element:
    """Return a table of 0 to 4 axes as an element of a function.

    Parameters
    ----------
    values : DataArray
        The nodes; coordinates in SI.
    native : bool
        Four axes as a table of JSBSim 1.3.1; else as tables of three, interpolated over the first axis.
    """
    if values.ndim == 0:
        return _text("value", repr(float(values)))
    axes = [str(axis) for axis in values.dims]
    points = [_points(values, axis) for axis in axes]
    if values.ndim == 4 and not native:
        return _slices(values, points[0])
    element = ET.Element("table")
    if values.ndim == 1:
        element.append(_text("independentVar", property_of(axes[0]), lookup="row"))
        _data(element, _rows(points[0], values.values[:, None]))
        return element
    for axis, lookup in zip(reversed(axes), _LOOKUP):
        element.append(_text("independentVar", property_of(axis), lookup=lookup))
    _blocks(element, values.values, points)
    return element


def reaching(leaf: xr.Dataset, reach: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """Return a term that goes on linearly beyond its tables as one that holds, its tables continued to `reach`."""
    if leaf.attrs.get("outside", "hold") == "hold":
        return leaf
    tables = {name: leaf[name] for name in ("value", "K1", "K2") if name in leaf}
    for name, values in tables.items():
        for axis in map(str, values.dims):
            tables[name] = _continued(tables[name], axis, *reach[axis])
    return xr.Dataset(tables, attrs={**leaf.attrs, "outside": "hold"})


def _continued(values: xr.DataArray, axis: str, low: float, high: float) -> xr.DataArray:
    points = values[axis].values
    ends = [end for end in (low, high) if end < points[0] or end > points[-1]]
    return values.interp({axis: np.union1d(points, ends)}, kwargs={"fill_value": "extrapolate"}) if ends else values


def _points(values: xr.DataArray, axis: str) -> np.ndarray:
    points = values[axis].values / unit(axis)
    if (np.diff(points) <= 0).any():
        raise SchemaError("JSBSim table", [f"breakpoints of {axis} fall together in the unit of JSBSim; regrid the term"])
    return points


def _blocks(parent: ET.Element, values: np.ndarray, points: list[np.ndarray]) -> None:
    if values.ndim == 2:
        head = " ".join(repr(float(x)) for x in points[1])
        _data(parent, [head, *_rows(points[0], values)])
        return
    for point, part in zip(points[0], values):
        inner = ET.SubElement(parent, "tableData", breakPoint=repr(float(point)))
        if part.ndim > 2:
            _blocks(inner, part, points[1:])
        else:
            inner.text = _lines([" ".join(repr(float(x)) for x in points[2]), *_rows(points[1], part)])


def _slices(values: xr.DataArray, points: np.ndarray) -> ET.Element:
    element = ET.Element("interpolate1d")
    element.append(_text("property", property_of(str(values.dims[0]))))
    for number, point in enumerate(points):
        element.append(_text("value", repr(float(point))))
        element.append(table(values[number], native=False))
    return element


def _rows(points: np.ndarray, values: np.ndarray) -> list[str]:
    return [" ".join(repr(float(x)) for x in (point, *row)) for point, row in zip(points, values)]


def _data(parent: ET.Element, lines: list[str]) -> None:
    ET.SubElement(parent, "tableData").text = _lines(lines)


def _lines(lines: list[str]) -> str:
    return "\n" + "\n".join(lines) + "\n"


def _text(tag: str, text: str, **attributes: str) -> ET.Element:
    element = ET.Element(tag, attributes)
    element.text = text
    return element
