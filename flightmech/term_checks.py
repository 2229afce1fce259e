"""Layout of a term leaf, and the checks of one leaf."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from flightmech.errors import UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import parse_unit

if TYPE_CHECKING:
    import xarray as xr

SOURCES = ("datcom", "flight", "judgement", "estimate")
"""Sources of nodes by code; ``estimate`` is an a-priori program or table other than DATCOM."""
_WITHOUT_ESTIMATE = SOURCES[:3]
SOURCE_ATTRS = {
    "flag_values": " ".join(map(str, range(len(_WITHOUT_ESTIMATE)))),
    "flag_meanings": " ".join(_WITHOUT_ESTIMATE),
}
"""Attributes of the codes of a leaf without nodes of an estimate (`source_attributes`)."""
# Variables of the joint covariance of the nodes. A leaf has all of them or none.
POSTERIOR = ("prior_error", "flown_distance", "posterior_factor", "posterior_sign")
TABLES = ("value", "K1", "K2")
MAX_AXES = 4
MAX_REGRESSORS = 2
MAX_EXPONENT = 10
_NUMBER = int | float | np.integer | np.floating


def source_attributes(codes: np.ndarray) -> dict[str, str]:
    """Return the attributes of the source codes of a leaf, which list the meanings it may use."""
    if not (codes == SOURCES.index("estimate")).any():
        return dict(SOURCE_ATTRS)
    values = " ".join(map(str, range(len(SOURCES))))
    return {"flag_values": values, "flag_meanings": " ".join(SOURCES)}


class HasAttributes(Protocol):
    """An object with the attributes of a leaf: a Dataset, or a group of a file."""

    attrs: dict[str, Any]


def list_regressors(leaf: HasAttributes) -> tuple[str, ...]:
    """Return the regressors of a leaf, in order."""
    return tuple(str(leaf.attrs.get("regressors", "")).split())


def check_term(leaf: xr.Dataset) -> list[str]:
    """Return all faults of a leaf as texts. The list of a valid leaf is empty."""
    if "value" not in leaf:
        names = ", ".join(map(str, leaf.data_vars)) or "nothing"
        return [f"has no variable 'value' (found: {names})"]
    problems = _check_tables(leaf)
    for name in ("stderr", "source"):
        if name in leaf:
            problems += _check_companion(leaf, name)
    problems += _check_posterior(leaf)
    problems += _check_regressors(leaf)
    problems += _check_power(leaf.attrs)
    if leaf.attrs.get("outside", "hold") not in ("hold", "linear"):
        problems.append(f"attribute outside is {leaf.attrs['outside']!r}; allowed: hold, linear")
    for key, item in leaf.attrs.items():
        # bool is a subclass of int, but netCDF has no attribute of this type
        if isinstance(item, bool) or not isinstance(item, str | _NUMBER):
            problems.append(
                f"attribute {key} is a {type(item).__name__}; only text and numbers survive "
                f"in a file"
            )
    return problems


def _check_tables(leaf: xr.Dataset) -> list[str]:
    """Return the faults of the tables and of their axes."""
    problems = []
    # A contribution is linear in the nodes of each table only if no two tables share an axis.
    table_of_axis: dict[str, str] = {}
    for name in TABLES:
        if name not in leaf:
            continue
        table = leaf.variables[name]
        if table.ndim > MAX_AXES:
            problems.append(f"{name} has {table.ndim} axes; at most {MAX_AXES} are allowed")
        for axis in map(str, table.dims):
            if axis in table_of_axis:
                problems.append(
                    f"{name} and {table_of_axis[axis]} share the axis {axis}; merge them into one "
                    f"table"
                )
            table_of_axis[axis] = name
            problems += _check_axis(leaf, axis)
        if not _is_numeric(table):
            problems.append(f"{name} holds {table.dtype}; numbers are needed")
        elif bad := int((~np.isfinite(table.values.astype(float))).sum()):
            problems.append(
                f"{name} holds {bad} NaN or infinite nodes of {table.size}; trim or fill the "
                f"table first"
            )
    return problems


def _check_regressors(leaf: xr.Dataset) -> list[str]:
    problems = []
    names = list_regressors(leaf)
    if len(names) > MAX_REGRESSORS:
        problems.append(
            f"has {len(names)} regressors ({' '.join(names)}); at most {MAX_REGRESSORS} are allowed"
        )
    for name in names:
        problems += _check_name(name, "regressor")
    return problems


def _check_axis(leaf: xr.Dataset, axis: str) -> list[str]:
    problems = _check_name(axis, "axis")
    if axis not in leaf.variables:
        return [*problems, f"axis {axis} has no breakpoints"]
    breakpoints = leaf.variables[axis]
    if not problems:
        problems = _check_units(axis, breakpoints.attrs.get("units"))
    if not _is_numeric(breakpoints):
        return [*problems, f"axis {axis} holds {breakpoints.dtype}; numbers are needed"]
    points = breakpoints.values.astype(float)
    if not np.isfinite(points).all():
        problems.append(f"axis {axis} holds NaN or infinite breakpoints")
    elif not points.size:
        problems.append(f"axis {axis} has no breakpoints")
    elif (np.diff(points) <= 0).any():
        i = int(np.flatnonzero(np.diff(points) <= 0)[0])
        problems.append(
            f"axis {axis} does not rise: {points[i]:g} is followed by {points[i + 1]:g}"
        )
    return problems


def _check_units(axis: str, units: Any) -> list[str]:
    """Return the fault of a units attribute that is not the SI unit of the axis.

    Breakpoints without the attribute count as SI.
    """
    needed = lookup(axis).units
    try:
        if units is None or parse_unit(str(units)) == parse_unit(needed):
            return []
    except UnitError:
        # an unknown unit gets the same message as a wrong one
        pass
    return [
        f"axis {axis} is given in {str(units)!r}, a term holds {needed!r}: convert the "
        f"breakpoints and set their attribute units"
    ]


def _check_companion(leaf: xr.Dataset, name: str) -> list[str]:
    """Return the faults of the standard errors or sources of the values."""
    # Variables, because xarray makes a DataArray anew at each request, and a match checks thousands
    # of terms.
    table, dims = leaf.variables[name], leaf.variables["value"].dims
    problems = []
    if table.dims != dims:
        problems.append(f"{name} has dimensions {table.dims}, value has {dims}")
    if not _is_numeric(table):
        problems.append(f"{name} holds {table.dtype}; numbers are needed")
    elif name == "stderr" and not (table.values >= 0).all():
        problems.append("stderr holds negative or NaN values")
    elif name == "source" and not np.isin(table.values, range(len(SOURCES))).all():
        codes = ", ".join(f"{code} {source}" for code, source in enumerate(SOURCES))
        problems.append(f"source holds codes other than {codes}")
    return problems


def _check_posterior(leaf: xr.Dataset) -> list[str]:
    """Return the faults of the joint covariance of the nodes."""
    present = [name for name in POSTERIOR if name in leaf]
    if not present:
        return []
    missing = [name for name in (*POSTERIOR, "stderr") if name not in leaf]
    if missing:
        return [
            f"has {present[0]} and no {', '.join(missing)}; the covariance of the nodes needs "
            f"all of {', '.join(POSTERIOR)}"
        ]
    problems = []
    dims = leaf.variables["value"].dims
    # in the order of POSTERIOR
    required_dims = (("kind", *dims), dims, ("component", *dims), ("component",))
    for name, required in zip(POSTERIOR, required_dims, strict=True):
        table = leaf.variables[name]
        if table.dims != required:
            problems.append(f"{name} has dimensions {table.dims}, {required} are needed")
        elif not _is_numeric(table) or not np.isfinite(table.values).all():
            problems.append(f"{name} holds NaN, infinite values or no numbers")
    if leaf.sizes.get("kind", 2) != 2:
        problems.append(
            f"prior_error has {leaf.sizes['kind']} parts; there are 2, the proportional and "
            f"the constant one"
        )
    if not isinstance(leaf.variables["posterior_factor"].attrs.get("origin"), str):
        problems.append(
            "posterior_factor has no attribute origin; it names the tables with which this "
            "one is jointly distributed"
        )
    return problems


def _check_power(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the faults of a power factor."""
    numbers = {key: attributes[key] for key in ("exponent", "floor") if key in attributes}
    variable = attributes.get("power", "")
    if not variable:
        if not numbers:
            return []
        return [
            f"attribute {' and '.join(numbers)} without power: name the variable in the "
            f"attribute power"
        ]
    problems = _check_name(str(variable), "power")
    for key in ("exponent", "floor"):
        if not isinstance(numbers.get(key), _NUMBER) or not math.isfinite(numbers[key]):
            problems.append(
                f"power {variable}: attribute {key} is {numbers.get(key)!r}; a finite number "
                f"is needed"
            )
        elif key == "exponent" and abs(numbers[key]) > MAX_EXPONENT:
            problems.append(
                f"power {variable}: attribute exponent is {numbers[key]:g}; allowed: "
                f"{-MAX_EXPONENT} to {MAX_EXPONENT}"
            )
        elif key == "floor" and numbers[key] <= 0:
            problems.append(
                f"power {variable}: attribute floor is {numbers[key]:g}; it must be positive, "
                f"so that the power is finite"
            )
    return problems


def _is_numeric(table: xr.DataArray | xr.Variable) -> bool:
    # signed and unsigned integers, and floating-point numbers, but not bool and complex
    return table.dtype.kind in "iuf"


def _check_name(name: str, what: str) -> list[str]:
    """Return the fault of a name that is not in the vocabulary."""
    try:
        lookup(name)
    except UnknownName as error:
        return [f"{what}: {error}"]
    return []
