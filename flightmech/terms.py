"""Terms of an aerodynamic model: the leaves of a model tree, and their evaluation.

The contribution of a term to its coefficient is

    K1(...) * K2(...) * value(axes) * v1 * v2                       [LR743] eq. (1)-(11)

`value` is a table of 0 to 4 axes. `K1` and `K2` are optional tables over axes that `value` does not
have. `v1` and `v2` are the optional regressors, model variables such as ``qhat`` or ``delta_e``.
Tables are multilinear between breakpoints, so the contribution is *linear in the node values*:
`basis` returns this linear map, which simulation, regression and comparison use. A term may have a
power of one more variable as a factor,

    max(v, floor) ** exponent                                       [LR743] eq. (13) and (14): h^s

The contribution is not linear in the exponent, but it remains linear in the nodes.

A leaf is an ``xarray.Dataset``:

==============  ====================================================================================
``value``       the table. Its dimensions are axes, their coordinates are rising breakpoints
``K1``, ``K2``  optional factor tables, over other axes
``stderr``      optional, shape of ``value``: standard error of each node
``source``      optional, shape of ``value``: 0 datcom, 1 flight, 2 judgement, 3 estimate
`POSTERIOR`     optional: joint covariance of the nodes after a flight (`aerodb.update.posterior`)
==============  ====================================================================================

Its attributes are ``regressors`` (names), ``outside`` (``hold`` or ``linear``, the rule of the
simulation beyond the last breakpoint), ``references``, ``history`` and ``comment``. A power factor
has the attributes ``power`` (the variable), ``exponent`` (-10 to 10) and ``floor`` (positive, in
the unit of the variable).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flightmech.support.array_files.labelled_arrays import make_dataset, make_variable
from flightmech.support.arrays import (
    Place,
    demand_inside,
    interpolate_multilinear,
    is_inside_axis,
    locate_breakpoints,
)

# some of these names are public names of this module
from flightmech.term_checks import MAX_AXES as MAX_AXES
from flightmech.term_checks import MAX_REGRESSORS as MAX_REGRESSORS
from flightmech.term_checks import POSTERIOR as POSTERIOR
from flightmech.term_checks import SOURCE_ATTRS as SOURCE_ATTRS
from flightmech.term_checks import SOURCES as SOURCES
from flightmech.term_checks import TABLES as TABLES
from flightmech.term_checks import HasAttributes as HasAttributes
from flightmech.term_checks import check_term as check_term
from flightmech.term_checks import list_regressors as list_regressors
from flightmech.term_checks import source_attributes as source_attributes

if TYPE_CHECKING:
    import xarray as xr
    from scipy.sparse import csr_array


class PowerFactor(NamedTuple):
    """The factor max(variable, floor) ** exponent of a term.

    `floor` is positive, in the unit of the variable.
    """

    variable: str
    exponent: float
    floor: float

    def at(self, v: Any) -> np.ndarray:
        """Return the factor at values of the variable. [unit of the variable ** exponent]"""
        return np.maximum(np.asarray(v, float), self.floor) ** self.exponent

    def __str__(self) -> str:
        return f"max({self.variable}, {self.floor:.12g})^{self.exponent:.12g}"


def make_term(
    value: Any,
    axes: Mapping[str, Any] | None = None,
    regressors: Sequence[str] = (),
    *,
    stderr: Any = None,
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
        Node values, with the dimensions in the order of `axes`. [1, or per unit of the regressors]
    axes : mapping of str to array, optional
        Rising breakpoints of each axis, a quantity of the vocabulary. [SI]
    regressors : sequence of str
        Up to two model variables that multiply the table. ``("alpha", "alpha")`` is a square.
    stderr : array or float, optional
        Standard error of the nodes, broadcast to the shape of `value`.
    source : {"datcom", "flight", "judgement", "estimate"}, optional
        Source of the nodes.
    K1, K2 : DataArray, optional
        Factor tables over axes that `value` does not have.
    power : PowerFactor, optional
        Power of a variable that multiplies the table.
    outside : {"hold", "linear"}
        Rule of the simulation beyond the last breakpoint.
    **text : str
        Further attributes: ``references``, ``history``, ``comment``.

    Raises
    ------
    SchemaError
        With all faults of the leaf.
    """
    leaf = _make_value_table(value, axes or {})
    array = leaf["value"].values
    for name, table in (("K1", K1), ("K2", K2)):
        if table is not None:
            leaf[name] = table
    if stderr is not None:
        errors = np.broadcast_to(np.asarray(stderr, float), array.shape).copy()
        leaf["stderr"] = make_variable(leaf["value"].dims, errors)
    if source is not None:
        sources = np.full(array.shape, SOURCES.index(source), np.uint8)
        leaf["source"] = make_variable(leaf["value"].dims, sources)
        leaf["source"].attrs = source_attributes(sources)
    leaf.attrs = {"regressors": " ".join(regressors), "outside": outside, **text}
    if power is not None:
        exponent, floor = float(power.exponent), float(power.floor)
        leaf.attrs |= {"power": power.variable, "exponent": exponent, "floor": floor}
    # A term is checked when it is made, so that no file holds a wrong one.
    problems = check_term(leaf)
    if problems:
        raise SchemaError("term", problems)
    return leaf


# the public name until 0.1
make = make_term


def _make_value_table(value: Any, axes: Mapping[str, Any]) -> xr.Dataset:
    points = {}
    for name, nodes in axes.items():
        points[name] = make_variable(name, np.asarray(nodes, float), quantity_attributes(name))
    values = make_variable(tuple(points), np.asarray(value, float))
    return make_dataset({"value": values}, points)


def power_factor(leaf: HasAttributes) -> PowerFactor | None:
    """Return the power factor of a leaf, or None."""
    attributes = leaf.attrs
    if not attributes.get("power"):
        return None
    return PowerFactor(
        variable=str(attributes["power"]),
        exponent=float(attributes["exponent"]),
        floor=float(attributes["floor"]),
    )


def list_multipliers(leaf: xr.Dataset) -> tuple[str, ...]:
    """Return the regressors and the power factor of a leaf as sorted texts.

    The tables of two leaves are comparable if their multipliers are equal.

    Examples
    --------
    >>> power = PowerFactor("h_agl", -1.09, 1.0)
    >>> list_multipliers(make_term(-0.078, regressors=["phi", "CL"], power=power))
    ('CL', 'max(h_agl, 1)^-1.09', 'phi')
    """
    factor = power_factor(leaf)
    multipliers = list(list_regressors(leaf))
    if factor is not None:
        multipliers.append(str(factor))
    return tuple(sorted(multipliers))


def without_multipliers(leaf: xr.Dataset) -> xr.Dataset:
    """Return a leaf that has the same tables, but no regressors and no power factor."""
    power = ("power", "exponent", "floor")
    attributes = {key: item for key, item in leaf.attrs.items() if key not in power}
    tables = leaf.copy(deep=False)
    tables.attrs = {**attributes, "regressors": ""}
    return tables


def list_model_variables(leaf: xr.Dataset) -> set[str]:
    """Return the model variables of a leaf: axes, regressors and the variable of the power."""
    names = set(list_regressors(leaf))
    for table in TABLES:
        if table in leaf:
            names.update(map(str, leaf.variables[table].dims))
    factor = power_factor(leaf)
    if factor is not None:
        names.add(factor.variable)
    return names


def evaluate_term(
    leaf: xr.Dataset,
    conditions: Mapping[str, Any],
    outside: str = "raise",
    places: dict[Any, Place] | None = None,
) -> np.ndarray:
    """Return the contribution of a term at conditions.

    Parameters
    ----------
    leaf : Dataset
        The term.
    conditions : mapping of str to array
        Model variables by name, broadcast against each other, for example the Dataset of a
        manoeuvre. [SI]
    outside : {"raise", "clamp"}
        Beyond the table: raise, or apply the attribute ``outside`` of the leaf as the simulation
        does.
    places : dict, optional
        Cache of the positions between breakpoints. Start with an empty one, and pass it with all
        terms that are evaluated at the same conditions.

    Returns
    -------
    array (broadcast shape of the variables of the term)

    Raises
    ------
    OutOfRange
        A value lies outside the table and `outside` is ``"raise"``. ``mask`` flags the samples.
    UnknownName
        A variable of the term is missing in `conditions`.

    Notes
    -----
    The result is ``basis @ value``, except for rounding. The matrix is not formed.
    """
    if places is None:
        places = {}
    product = np.ones(())
    for name in TABLES:
        if name in leaf:
            product = product * _interpolate_table(leaf, name, conditions, outside, places=places)
    for name in list_regressors(leaf):
        product = product * np.asarray(_get_condition(name, conditions), float)
    factor = power_factor(leaf)
    if factor is not None:
        product = product * factor.at(_get_condition(factor.variable, conditions))
    return np.asarray(product)


def basis(leaf: xr.Dataset, conditions: Mapping[str, Any], outside: str = "raise") -> csr_array:
    """Return the linear map from the nodes of ``value`` to the contribution of the term.

    Parameters
    ----------
    leaf, conditions, outside
        As in `evaluate_term`.

    Returns
    -------
    sparse array (samples, nodes)
        ``basis @ value.ravel()`` is the contribution. The map includes the factors ``K1`` and
        ``K2``, the regressors and the power.
    """
    from scipy.sparse import csr_array

    shape = _common_shape(leaf, conditions)
    rule = leaf.attrs.get("outside", "hold")
    columns, weights = _corner_weights(leaf, "value", conditions, shape, outside, rule=rule)
    # weights (samples, corners) times one factor per sample
    for name in ("K1", "K2"):
        if name in leaf:
            corners, shares = _corner_weights(leaf, name, conditions, shape, outside, rule=rule)
            nodes = leaf.variables[name].values.ravel()
            weights = weights * (shares * nodes[corners]).sum(axis=1)[:, None]
    for name in list_regressors(leaf):
        weights = weights * _flat_condition(name, conditions, shape)[:, None]
    factor = power_factor(leaf)
    if factor is not None:
        weights = weights * factor.at(_flat_condition(factor.variable, conditions, shape))[:, None]
    rows = np.repeat(np.arange(len(columns)), columns.shape[1])
    return csr_array(
        (weights.ravel(), (rows, columns.ravel())),
        shape=(len(columns), leaf.variables["value"].size),
    )


def _common_shape(leaf: xr.Dataset, conditions: Mapping[str, Any]) -> tuple[int, ...]:
    """Return the broadcast shape of all model variables of a leaf."""
    names = sorted(list_model_variables(leaf))
    return np.broadcast_shapes(*(np.shape(_get_condition(name, conditions)) for name in names), ())


def _get_condition(name: str, conditions: Mapping[str, Any]) -> Any:
    if name not in conditions:
        raise UnknownName(
            name,
            map(str, conditions),
            what="condition",
            hint="the term needs it; pass it with the conditions",
        )
    item = conditions[name]
    # the array of a DataArray, or of a variable of a Dataset
    return item.values if hasattr(item, "dims") else item


def _flat_condition(name: str, conditions: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Return one model variable at all samples, (samples,)."""
    values = np.asarray(_get_condition(name, conditions), float)
    return np.broadcast_to(values, shape).ravel()


def _corner_weights(
    leaf: xr.Dataset,
    name: str,
    conditions: Any,
    shape: tuple[int, ...],
    outside: str,
    *,
    rule: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Return flat node indices and weights (samples, 2**axes) of the interpolation of a table."""
    _demand_choice(outside)
    count = int(np.prod(shape))
    columns, weights = np.zeros((count, 1), np.intp), np.ones((count, 1))
    # Variables, because xarray makes a DataArray anew at each request.
    for axis in map(str, leaf.variables[name].dims):
        points = leaf.variables[axis].values.astype(float)
        x = _flat_condition(axis, conditions, shape)
        if outside == "raise":
            demand_inside(axis, points, x)
        low, fraction = locate_breakpoints(points, x, rule)
        # an axis of one breakpoint has the same node at both ends
        step = int(len(points) > 1)
        ends = np.stack([low, low + step], axis=1)
        shares = np.stack([1.0 - fraction, fraction], axis=1)
        # Each corner so far splits into the two ends of this axis: (samples, corners, 2).
        columns = (columns * len(points))[:, :, None] + ends[:, None, :]
        weights = weights[:, :, None] * shares[:, None, :]
        columns, weights = columns.reshape(count, -1), weights.reshape(count, -1)
    return columns, weights


def _interpolate_table(
    leaf: xr.Dataset, name: str, conditions: Any, outside: str, places: dict[Any, Place]
) -> np.ndarray:
    """Return one table at conditions, in the broadcast shape of the axes of the table."""
    _demand_choice(outside)
    table = leaf.variables[name]
    nodes, shape = table.values.astype(float), ()
    # positions along the axes whose variable is not constant
    varying: list[Place] = []
    rule = leaf.attrs.get("outside", "hold")
    for axis in map(str, table.dims):
        points = leaf.variables[axis].values.astype(float)
        x = np.asarray(_get_condition(axis, conditions), float)
        shape = np.broadcast_shapes(shape, x.shape)
        key = (axis, points.tobytes(), outside, rule)
        if key not in places:
            if outside == "raise" and not is_inside_axis(points, x).all():
                # at all samples of the term, so that the mask of the error fits them
                samples = _flat_condition(axis, conditions, _common_shape(leaf, conditions))
                demand_inside(axis, points, samples)
            places[key] = locate_breakpoints(points, x, rule)
        low, fraction = places[key]
        if len(points) == 1:
            nodes = nodes.take(0, axis=len(varying))
        elif x.size == 1:
            # One value for all samples: interpolate here, which removes the axis from the table.
            i = int(low.item())
            below = nodes.take(i, axis=len(varying))
            above = nodes.take(i + 1, axis=len(varying))
            nodes = below + fraction.item() * (above - below)
        else:
            varying.append((low, fraction))
    if not varying:
        return np.full(shape, nodes)
    flat = []
    for low, fraction in varying:
        flat.append((np.broadcast_to(low, shape).ravel(), np.broadcast_to(fraction, shape).ravel()))
    return interpolate_multilinear(nodes, flat).reshape(shape)


def _demand_choice(outside: str) -> None:
    if outside not in ("raise", "clamp"):
        raise ValueError(f"outside is {outside!r}; allowed: raise, clamp")
