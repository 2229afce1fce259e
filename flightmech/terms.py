"""The term: one leaf of a model tree, and the one place that defines what it computes.

A term's contribution to its coefficient is

    K1(...) * K2(...) * value(axes) * v1 * v2                       [LR743] eq. (1)-(11)

with `value` a table (of 0 to 4 axes), `K1` and `K2` optional tables over axes that `value` does not
have, and `v1`, `v2` the optional regressors, model variables such as ``qhat`` or ``delta_e``.
Tables are multilinear between breakpoints, so a contribution is *linear in the node values*:
`basis` returns that linear map, and simulation, regression and comparison all rest on it.  A term
may carry a power of one more variable as a factor,

    max(v, floor) ** exponent                                       [LR743] eq. (13) and (14): h^s

which is where a contribution is not linear: the exponent is a parameter of its own, the nodes stay
linear.

A leaf is a plain ``xarray.Dataset``:

==============  ====================================================================================
``value``       the table; its dimensions are axes, their coordinates the breakpoints (rising)
``K1``, ``K2``  optional factor tables, over other axes
``stderr``      optional, shape of ``value``: standard error of each node
``source``      optional, shape of ``value``: 0 datcom, 1 flight, 2 judgement
`POSTERIOR`     optional: the joint covariance of the nodes after a flight (`aerodb.update.posterior`)
==============  ====================================================================================

Attributes: ``regressors`` (names), ``outside`` (``hold`` or ``linear``: what the simulation does
beyond the last breakpoint), ``references``, ``history``, ``comment``; of the power factor ``power``
(the variable) and the numbers ``exponent`` (-10 to 10) and ``floor`` (positive, in the unit of the
variable).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup, quantity_attributes
from flightmech.support.arrays import (
    Place,
    demand_inside,
    interpolate_multilinear,
    is_inside_axis,
    locate_breakpoints,
)
from flightmech.units import parse_unit

if TYPE_CHECKING:
    import xarray as xr
    from scipy.sparse import csr_array

SOURCES = ("datcom", "flight", "judgement")
SOURCE_ATTRS = {
    "flag_values": " ".join(str(code) for code, _ in enumerate(SOURCES)),
    "flag_meanings": " ".join(SOURCES),
}
POSTERIOR = (
    "prior_error",
    "flown_distance",
    "posterior_factor",
    "posterior_sign",
)  # all or none of them
MAX_AXES = 4
MAX_REGRESSORS = 2
MAX_EXPONENT = 10
_TABLES = ("value", "K1", "K2")
_NUMBER = int | float | np.integer | np.floating


class _Marked(Protocol):
    """A Dataset, or a leaf as it stands in a file: what its attributes say is read of either."""

    attrs: dict


class PowerFactor(NamedTuple):
    """The factor max(variable, floor) ** exponent of a term; `floor` is positive, in the unit of
    the variable.
    """

    variable: str
    exponent: float
    floor: float

    def at(self, v) -> np.ndarray:
        """Return the factor at values of the variable. [unit of the variable to the power
        `exponent`]
        """
        return np.maximum(np.asarray(v, float), self.floor) ** self.exponent

    def __str__(self) -> str:
        return f"max({self.variable}, {self.floor:.12g})^{self.exponent:.12g}"


def make_term(
    value,
    axes: Mapping[str, Any] | None = None,
    regressors: Sequence[str] = (),
    *,
    stderr=None,
    source: str | None = None,
    K1: xr.DataArray | None = None,
    K2: xr.DataArray | None = None,
    power: PowerFactor | None = None,
    outside: str = "hold",
    **text: str,
) -> xr.Dataset:
    """Return a term leaf.

    Parameters
    ----------
    value : array
        Node values; dimension order as `axes`. [1, or per unit of the regressors]
    axes : mapping of str to array, optional
        Axis name (a quantity of the vocabulary) to breakpoints, rising. [SI]
    regressors : sequence of str
        Up to two model variables that multiply the table; ``("alpha", "alpha")`` is a square.
    stderr : array or float, optional
        Standard error of the nodes, broadcast to the shape of `value`.
    source : {"datcom", "flight", "judgement"}, optional
        Where the nodes come from.
    K1, K2 : DataArray, optional
        Factor tables over axes that `value` does not have.
    power : Power, optional
        Power of a variable that multiplies the table.
    outside : {"hold", "linear"}
        Value beyond the last breakpoint in simulation.
    **text : str
        Further attributes: ``references``, ``history``, ``comment``.

    Raises
    ------
    SchemaError
        With all faults of the leaf.
    """
    import xarray as xr

    coords = {name: np.asarray(points, float) for name, points in (axes or {}).items()}
    array = np.asarray(value, float)
    leaf = xr.Dataset({"value": (tuple(coords), array)}, coords=coords)
    for name in coords:
        leaf[name].attrs.update(quantity_attributes(name))
    for name, table in (("K1", K1), ("K2", K2)):
        if table is not None:
            leaf[name] = table
    if stderr is not None:
        leaf["stderr"] = (
            leaf["value"].dims,
            np.broadcast_to(np.asarray(stderr, float), array.shape).copy(),
        )
    if source is not None:
        leaf["source"] = leaf["value"].dims, np.full(array.shape, SOURCES.index(source), np.uint8)
        leaf["source"].attrs = dict(SOURCE_ATTRS)
    leaf.attrs = {"regressors": " ".join(regressors), "outside": outside, **text}
    if power is not None:
        leaf.attrs |= {
            "power": power.variable,
            "exponent": float(power.exponent),
            "floor": float(power.floor),
        }
    problems = check_term(leaf)
    if problems:
        raise SchemaError("term", problems)
    return leaf


make = make_term  # the public name until 0.1


def list_regressors(leaf: _Marked) -> tuple[str, ...]:
    """Return the regressors of a leaf, in order."""
    return tuple(str(leaf.attrs.get("regressors", "")).split())


def power_factor(leaf: _Marked) -> PowerFactor | None:
    """Return the power factor of a leaf, or None."""
    if not leaf.attrs.get("power"):
        return None
    return PowerFactor(
        str(leaf.attrs["power"]), float(leaf.attrs["exponent"]), float(leaf.attrs["floor"])
    )


def list_multipliers(leaf: xr.Dataset) -> tuple[str, ...]:
    """Return what multiplies the tables of a leaf, as texts and sorted: tables are comparable when
    these are equal.

    Examples
    --------
    >>> multipliers(make(-0.078, regressors=["phi", "CL"], power=Power("h_agl", -1.09, 1.0)))
    ('CL', 'max(h_agl, 1)^-1.09', 'phi')
    """
    factor = power_factor(leaf)
    return tuple(sorted((*list_regressors(leaf), *(() if factor is None else (str(factor),)))))


def without_multipliers(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf without regressors and power factor: its tables alone."""
    attributes = {
        key: item for key, item in leaf.attrs.items() if key not in ("power", "exponent", "floor")
    }
    found = leaf.copy(deep=False)
    found.attrs = {**attributes, "regressors": ""}
    return found


def check_term(leaf: xr.Dataset) -> list[str]:
    """Return every fault of a leaf as a text; an empty list means it is sound."""
    if "value" not in leaf:
        return [
            f"has no variable 'value' (found: {', '.join(map(str, leaf.data_vars)) or 'nothing'})"
        ]
    problems = []
    seen: dict[str, str] = {}
    for name in _TABLES:
        if name not in leaf:
            continue
        table = leaf.variables[name]
        if table.ndim > MAX_AXES:
            problems.append(f"{name} has {table.ndim} axes; at most {MAX_AXES} are allowed")
        for axis in map(str, table.dims):
            if axis in seen:
                problems.append(
                    f"{name} and {seen[axis]} share the axis {axis}; merge them into one table"
                )
            seen[axis] = name
            problems += _check_axis(leaf, axis)
        if not _numeric(table):
            problems.append(f"{name} holds {table.dtype}; numbers are needed")
        elif bad := int((~np.isfinite(table.values.astype(float))).sum()):
            problems.append(
                f"{name} holds {bad} NaN or infinite nodes of {table.size}; trim or fill the "
                f"table first"
            )
    for name in ("stderr", "source"):
        if name in leaf:
            problems += _check_companion(leaf, name)
    problems += _check_posterior(leaf)
    names = list_regressors(leaf)
    if len(names) > MAX_REGRESSORS:
        problems.append(
            f"has {len(names)} regressors ({' '.join(names)}); at most {MAX_REGRESSORS} are allowed"
        )
    for name in names:
        problems += _unknown(name, "regressor")
    problems += _check_power(leaf.attrs)
    if leaf.attrs.get("outside", "hold") not in ("hold", "linear"):
        problems.append(f"attribute outside is {leaf.attrs['outside']!r}; allowed: hold, linear")
    for key, item in leaf.attrs.items():
        if isinstance(item, bool) or not isinstance(item, str | _NUMBER):
            problems.append(
                f"attribute {key} is a {type(item).__name__}; only text and numbers survive "
                f"in a file"
            )
    return problems


def _numeric(table: xr.DataArray | xr.Variable) -> bool:
    return table.dtype.kind in "iuf"


def _check_companion(leaf: xr.Dataset, name: str) -> list[str]:
    """Return the faults of the standard errors or sources of the values."""
    table = leaf[name]
    problems = []
    if table.dims != leaf["value"].dims:
        problems.append(f"{name} has dimensions {table.dims}, value has {leaf['value'].dims}")
    if not _numeric(table):
        problems.append(f"{name} holds {table.dtype}; numbers are needed")
    elif name == "stderr" and not (table.values >= 0).all():
        problems.append("stderr holds negative or NaN values")
    elif name == "source" and not np.isin(table.values, range(len(SOURCES))).all():
        codes = ", ".join(f"{code} {name}" for code, name in enumerate(SOURCES))
        problems.append(f"source holds codes other than {codes}")
    return problems


def _check_posterior(leaf: xr.Dataset) -> list[str]:
    """Return the faults of the joint covariance of the nodes."""
    held = [name for name in POSTERIOR if name in leaf]
    if not held:
        return []
    missing = [name for name in (*POSTERIOR, "stderr") if name not in leaf]
    if missing:
        return [
            f"has {held[0]} and no {', '.join(missing)}; the covariance of the nodes needs "
            f"all of {', '.join(POSTERIOR)}"
        ]
    problems = []
    dims = leaf["value"].dims
    for name, wanted in zip(
        POSTERIOR, (("kind", *dims), dims, ("component", *dims), ("component",)), strict=True
    ):
        if leaf[name].dims != wanted:
            problems.append(f"{name} has dimensions {leaf[name].dims}, {wanted} are needed")
        elif not _numeric(leaf[name]) or not np.isfinite(leaf[name].values).all():
            problems.append(f"{name} holds NaN, infinite values or no numbers")
    if leaf.sizes.get("kind", 2) != 2:
        problems.append(
            f"prior_error has {leaf.sizes['kind']} parts; there are 2, the proportional and "
            f"the constant one"
        )
    if not isinstance(leaf["posterior_factor"].attrs.get("origin"), str):
        problems.append(
            "posterior_factor has no attribute origin; it names the tables with which this "
            "one is jointly distributed"
        )
    return problems


def _check_power(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the faults of a power factor."""
    parts = {key: attributes[key] for key in ("exponent", "floor") if key in attributes}
    variable = attributes.get("power", "")
    if not variable:
        return (
            [
                f"attribute {' and '.join(parts)} without power: name the variable in the "
                f"attribute power"
            ]
            if parts
            else []
        )
    problems = _unknown(str(variable), "power")
    for key in ("exponent", "floor"):
        if not isinstance(parts.get(key), _NUMBER) or not math.isfinite(parts[key]):
            problems.append(
                f"power {variable}: attribute {key} is {parts.get(key)!r}; a finite number "
                f"is needed"
            )
        elif key == "exponent" and abs(parts[key]) > MAX_EXPONENT:
            problems.append(
                f"power {variable}: attribute exponent is {parts[key]:g}; allowed: "
                f"{-MAX_EXPONENT} to {MAX_EXPONENT}"
            )
        elif key == "floor" and parts[key] <= 0:
            problems.append(
                f"power {variable}: attribute floor is {parts[key]:g}; it must be positive, "
                f"so that the power is finite"
            )
    return problems


def _check_axis(leaf: xr.Dataset, axis: str) -> list[str]:
    problems = _unknown(axis, "axis")
    if axis not in leaf.variables:
        return [*problems, f"axis {axis} has no breakpoints"]
    breakpoints = leaf.variables[axis]
    if not problems:
        problems = _check_units(axis, breakpoints.attrs.get("units"))
    if not _numeric(breakpoints):
        return [*problems, f"axis {axis} holds {breakpoints.dtype}; numbers are needed"]
    points = breakpoints.values.astype(float)
    if not np.isfinite(points).all():
        problems.append(f"axis {axis} holds NaN or infinite breakpoints")
    elif not points.size:
        problems.append(f"axis {axis} has no breakpoints")
    elif (np.diff(points) <= 0).any():
        at = int(np.flatnonzero(np.diff(points) <= 0)[0])
        problems.append(
            f"axis {axis} does not rise: {points[at]:g} is followed by {points[at + 1]:g}"
        )
    return problems


def _check_units(axis: str, given: Any) -> list[str]:
    """Return the fault of a units attribute that contradicts the vocabulary; without one the
    breakpoints count as SI.
    """
    needed = lookup(axis).units
    try:
        if given is None or parse_unit(str(given)) == parse_unit(needed):
            return []
    except UnitError:
        pass
    return [
        f"axis {axis} is given in {str(given)!r}, a term holds {needed!r}: convert the "
        f"breakpoints and set their attribute units"
    ]


def _unknown(name: str, what: str) -> list[str]:
    try:
        lookup(name)
    except UnknownName as error:
        return [f"{what}: {error}"]
    return []


def list_model_variables(leaf: xr.Dataset) -> set[str]:
    """Return the names of all model variables a leaf needs: axes of all its tables, regressors,
    variable of the power.
    """
    axes = {str(d) for name in _TABLES if name in leaf for d in leaf.variables[name].dims}
    factor = power_factor(leaf)
    return axes | set(list_regressors(leaf)) | (set() if factor is None else {factor.variable})


def evaluate_term(
    leaf: xr.Dataset,
    conditions: Mapping[str, Any],
    outside: str = "raise",
    places: dict[Any, Place] | None = None,
) -> np.ndarray:
    """Return the contribution of a term at given conditions.

    Parameters
    ----------
    leaf : Dataset
        The term.
    conditions : mapping of str to array
        Model variables by name, broadcast against each other; a Dataset of a manoeuvre will do.
        [SI]
    outside : {"raise", "clamp"}
        What to do beyond the table: raise, or follow the leaf's own rule as the simulation does.
    places : dict, optional
        Empty at first and passed with every term evaluated at the same conditions: where these lie
        between breakpoints is then found once for all tables that share them.

    Returns
    -------
    array (broadcast shape of the variables used)

    Raises
    ------
    OutOfRange
        A value lies outside the table and `outside` is ``"raise"``; ``mask`` flags the samples.
    UnknownName
        A variable of the term is missing in `conditions`.

    Notes
    -----
    The same number as ``basis @ value``, but for rounding, without the matrix.
    """
    found = np.ones(())
    for name in _TABLES:
        if name in leaf:
            found = found * _interpolated(
                leaf, name, conditions, outside, {} if places is None else places
            )
    for name in list_regressors(leaf):
        found = found * np.asarray(_get(name, conditions), float)
    factor = power_factor(leaf)
    if factor is not None:
        found = found * factor.at(_get(factor.variable, conditions))
    return np.asarray(found)


def basis(leaf: xr.Dataset, conditions: Mapping[str, Any], outside: str = "raise") -> csr_array:
    """Return the linear map from the nodes of ``value`` to the contribution of the term.

    Parameters
    ----------
    leaf, conditions, outside
        As in `evaluate_term`.

    Returns
    -------
    sparse array (samples, nodes)
        ``basis @ value.ravel()`` is the contribution; factors ``K1``, ``K2``, regressors and power
        are inside.
    """
    from scipy.sparse import csr_array

    shape = _shape(leaf, conditions)
    columns, weights = _corners(
        leaf["value"], conditions, shape, outside, leaf.attrs.get("outside", "hold")
    )
    for name in ("K1", "K2"):
        if name in leaf:
            at, share = _corners(
                leaf[name], conditions, shape, outside, leaf.attrs.get("outside", "hold")
            )
            weights = weights * (share * leaf[name].values.ravel()[at]).sum(axis=1)[:, None]
    for name in list_regressors(leaf):
        weights = weights * _values(name, conditions, shape)[:, None]
    factor = power_factor(leaf)
    if factor is not None:
        weights = weights * factor.at(_values(factor.variable, conditions, shape))[:, None]
    rows = np.repeat(np.arange(len(columns)), columns.shape[1])
    return csr_array(
        (weights.ravel(), (rows, columns.ravel())), shape=(len(columns), leaf["value"].size)
    )


def _shape(leaf: xr.Dataset, conditions: Mapping[str, Any]) -> tuple[int, ...]:
    return np.broadcast_shapes(
        *(np.shape(_get(name, conditions)) for name in sorted(list_model_variables(leaf))), ()
    )


def _get(name: str, conditions: Mapping[str, Any]):
    if name not in conditions:
        raise UnknownName(
            name,
            map(str, conditions),
            "condition",
            "the term needs it; pass it with the conditions",
        )
    item = conditions[name]
    return (
        item.values if hasattr(item, "dims") else item
    )  # of a DataArray or a variable of a Dataset


def _values(name: str, conditions: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    return np.broadcast_to(np.asarray(_get(name, conditions), float), shape).ravel()


def _corners(
    table: xr.DataArray, conditions, shape: tuple[int, ...], outside: str, rule: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return flat node indices and weights (samples, 2**axes) of multilinear interpolation."""
    _demand_choice(outside)
    count = int(np.prod(shape))
    columns, weights = np.zeros((count, 1), np.intp), np.ones((count, 1))
    for axis in map(str, table.dims):
        points = table[axis].values.astype(float)
        x = _values(axis, conditions, shape)
        if outside == "raise":
            demand_inside(axis, points, x)
        low, fraction = locate_breakpoints(points, x, rule)
        step = int(len(points) > 1)
        columns = (columns * len(points))[:, :, None] + np.stack([low, low + step], axis=1)[
            :, None, :
        ]
        weights = weights[:, :, None] * np.stack([1.0 - fraction, fraction], axis=1)[:, None, :]
        columns, weights = columns.reshape(count, -1), weights.reshape(count, -1)
    return columns, weights


def _interpolated(
    leaf: xr.Dataset, name: str, conditions, outside: str, places: dict[Any, Place]
) -> np.ndarray:
    """Return one table at conditions, in the broadcast shape of its own axes."""
    _demand_choice(outside)
    table = leaf.variables[name]
    nodes, shape = table.values.astype(float), ()
    varying: list[Place] = []
    rule = leaf.attrs.get("outside", "hold")
    for axis in map(str, table.dims):
        points = leaf.variables[axis].values.astype(float)
        x = np.asarray(_get(axis, conditions), float)
        shape = np.broadcast_shapes(shape, x.shape)
        key = (axis, points.tobytes(), outside, rule)
        if key not in places:
            if outside == "raise" and not is_inside_axis(points, x).all():
                demand_inside(axis, points, _values(axis, conditions, _shape(leaf, conditions)))
            places[key] = locate_breakpoints(points, x, rule)
        low, fraction = places[key]
        if len(points) == 1:
            nodes = nodes.take(0, axis=len(varying))
        elif x.size == 1:  # the same for all samples: a table with one axis less
            first = int(low.item())
            below, above = (nodes.take(first + step, axis=len(varying)) for step in (0, 1))
            nodes = below + fraction.item() * (above - below)
        else:
            varying.append((low, fraction))
    if not varying:
        return np.full(shape, nodes)
    spread = [
        (np.broadcast_to(low, shape).ravel(), np.broadcast_to(fraction, shape).ravel())
        for low, fraction in varying
    ]
    return interpolate_multilinear(nodes, spread).reshape(shape)


def _demand_choice(outside: str) -> None:
    if outside not in ("raise", "clamp"):
        raise ValueError(f"outside is {outside!r}; allowed: raise, clamp")
