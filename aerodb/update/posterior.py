"""The joint covariance of the nodes of an identified database, and results computed from it.

After `aerodb.tabulate` the nodes of all terms of one coefficient have the covariance

    V = P - W W' + Z Z'

P is the a-priori covariance with the learnt weights (terms independent of each other).  W W' is the
reduction by the fits.  Z Z' is the contribution of the errors common to all fits.  Flights
determine sums of terms better than each term.  The standard errors of single nodes do not show it,
V does. Each term table stores its rows of V in four variables:

``prior_error`` (``kind``, axes)
    A-priori standard error of each node with its sign: the part that is proportional to the value,
    and the constant part (`aerodb.update.correlation`).
``flown_distance`` (axes)
    Distance of each node from the flown region, in correlation lengths.
``posterior_factor`` (``component``, axes)
    W and Z side by side.
``posterior_sign`` (``component``)
    -1 for a column of W, 1 for a column of Z; attribute ``errors``: names of the columns of Z.

The attributes of ``prior_error`` are the weights of the parts of P, the correlation lengths, and
the length over which `reach` fades.
``posterior_factor`` has the attribute ``origin``.  Term tables with the same origin are jointly
distributed; all others are independent of each other.

A table without these variables has the a-priori correlation of
`aerodb.update.correlation.prior_covariance`.  An edit of breakpoints or values removes the
variables if the covariance cannot follow it; it follows factors and shifts.  Where ``stderr`` is
larger than V states, as after an edit with its own error, the difference is independent from node
to node.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.correlation import (
    PARTS,
    REACH,
    covariance_between,
    error_kinds,
    node_correlation,
    prior_covariance,
)
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

ERRORS = "errors"
"""Attribute of ``posterior_sign``: names of the errors of the last components, one a line."""
# Attribute of ``prior_error``: length over which `reach` fades.  Databases without it have 0.5.
_REACH_LENGTH, _EARLIER_REACH = "reach_length", 0.5
# Part of the a-priori covariance that earlier databases do not have.  Their `long` fades as
# `reach`.
_LATER_PART = "medium"
_ROUNDING = 1e-6  # difference of variances, relative to the variance, that is rounding
# Least variance added to the unit diagonal before a Cholesky factorisation.  Parts of P that are
# common to a whole table leave directions without variance.
_JITTER = 1e-10
_JITTER_STEPS = 6  # the jitter grows by 10 from step to step


def with_posterior(
    before: xr.Dataset,
    after: xr.Dataset,
    weights: np.ndarray,
    distance: np.ndarray,
    lengths: Mapping[str, float],
    W: np.ndarray,
    Z: np.ndarray,
    errors: Sequence[str],
) -> xr.Dataset:
    """Return a term table with its rows of the joint covariance.

    Parameters
    ----------
    before, after : Dataset
        The term a priori, and with the new nodes and standard errors.
    weights : array (`PARTS`,)
        Learnt weights of the parts of the a-priori covariance.
    distance : array (nodes,)
        Distance of each node from the flown region, in correlation lengths.
    lengths : mapping of str to float
        Correlation lengths by axis. [SI]
    W, Z : array (nodes, components)
        Rows of the nodes of this term.
    errors : sequence of str
        Name of the error of each column of Z, such as ``mass``; empty if it has no name.
    """
    dims, shape = after["value"].dims, after["value"].shape
    attributes = dict(zip(PARTS, map(float, weights)))
    attributes[_REACH_LENGTH] = REACH
    for axis in map(str, dims):
        attributes[f"length_{axis}"] = float(lengths.get(axis, np.inf))
    factor = np.hstack([W, Z]).T
    sign = np.repeat([-1.0, 1.0], [W.shape[1], Z.shape[1]])
    # The components of an earlier update are replaced.
    after = after.drop_dims(["component", "kind"], errors="ignore")
    after = after.assign_coords(component=np.arange(len(sign), dtype=float), kind=np.arange(2.0))
    return after.assign(
        prior_error=(("kind", *dims), error_kinds(before).reshape(2, *shape), attributes),
        flown_distance=(dims, distance.reshape(shape)),
        posterior_factor=(("component", *dims), factor.reshape(len(sign), *shape)),
        posterior_sign=("component", sign, {ERRORS: "\n".join(errors)}),
    )


def mark_joint(leaves: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return term tables with the mark of a joint distribution, a digest of all their factors."""
    digest = hashlib.sha256()
    for leaf in leaves.values():
        digest.update(np.ascontiguousarray(leaf["posterior_factor"].values, "<f8").tobytes())
    marked = {}
    for name, leaf in leaves.items():
        factor = leaf["posterior_factor"].assign_attrs(origin=digest.hexdigest()[:16])
        marked[name] = leaf.assign(posterior_factor=factor)
    return marked


def joint_mark(leaf: xr.Dataset) -> str | None:
    """Return the mark of the joint distribution of the nodes of a term table, None without it."""
    if "posterior_factor" not in leaf:
        return None
    return str(leaf["posterior_factor"].attrs["origin"])


def without_posterior(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term table without the variables of its joint distribution."""
    return leaf.drop_vars([*_terms.POSTERIOR, "component", "kind"], errors="ignore")


def carry_covariance(
    old: xr.Dataset, new: xr.Dataset, times: np.ndarray | float = 1.0
) -> xr.Dataset:
    """Return an edited term table with the joint covariance of the table before the edit.

    Parameters
    ----------
    old, new : Dataset
        The term before and after the edit.  If the breakpoints differ, or `old` has no joint
        covariance, the result has none either.
    times : array or float
        Factor of the edit on the nodes, in the shape of the table.
    """
    new = without_posterior(new)
    if not joint_mark(old) or "stderr" not in new or not _has_same_axes(old, new):
        return new
    variables = {name: old[name] for name in _terms.POSTERIOR}
    for name in ("prior_error", "posterior_factor"):
        variables[name] = old[name].copy(data=old[name].values * times)
    return new.assign(variables)


def _has_same_axes(old: xr.Dataset, new: xr.Dataset) -> bool:
    """Return whether two tables have the same axes and breakpoints."""
    axes = old["value"].dims
    if axes != new["value"].dims:
        return False
    return all(np.array_equal(old[axis], new[axis]) for axis in axes)


def factor_of(leaf: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the factor (nodes, components) and the signs (components,) of a term table.

    The table must have them.
    """
    factor = leaf.variables["posterior_factor"].values.reshape(leaf.sizes["component"], -1).T
    return factor, leaf.variables["posterior_sign"].values


def covariance_between_nodes(leaf: xr.Dataset, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return the a-priori covariance P of pairs of nodes of a term table.

    It has the learnt weights if the table stores them.

    Parameters
    ----------
    leaf : Dataset
        The term, with ``stderr``.
    i, j : array of int
        Positions of the nodes in ``value.ravel()``, broadcast against each other.
    """
    if "posterior_factor" not in leaf:
        return covariance_between(leaf, i, j)
    axes = [str(axis) for axis in leaf["value"].dims]
    attributes = leaf["prior_error"].attrs
    names = [*PARTS, *(f"length_{axis}" for axis in axes)]
    is_earlier = _LATER_PART not in attributes
    if is_earlier:
        names.remove(_LATER_PART)
    if _REACH_LENGTH in attributes:
        names.append(_REACH_LENGTH)
    stored = {_LATER_PART: 0.0, **_number_attributes(leaf["prior_error"], names)}
    lengths = {axis: stored[f"length_{axis}"] for axis in axes}
    distance = leaf["flown_distance"].values.ravel()
    reach = stored.get(_REACH_LENGTH, _EARLIER_REACH)
    parts = node_correlation(
        leaf["value"],
        distance,
        i=i,
        j=j,
        lengths=lengths,
        reach=reach,
        long_fade=reach if is_earlier else np.inf,
    )
    # P_ij = s_i s_j c_ij sum_k w_k part_k.  The product s_i s_j c_ij is a scalar product of errors.
    proportional, constant = leaf["prior_error"].values.reshape(2, -1)
    products = proportional[i] * proportional[j] + constant[i] * constant[j]
    return products * sum(stored[name] * part for name, part in zip(PARTS, parts, strict=True))


def independent_variances(leaf: xr.Dataset) -> np.ndarray:
    """Return the variances of the nodes that an edit has added to the stored ones, (nodes,)."""
    nodes = np.arange(leaf["value"].size)
    F, sign = factor_of(leaf)
    stored = covariance_between_nodes(leaf, nodes, nodes) + F**2 @ sign
    stated = leaf["stderr"].values.ravel() ** 2
    return np.where(stated > (1.0 + _ROUNDING) * stored, stated - np.maximum(stored, 0.0), 0.0)


def _number_attributes(table: xr.DataArray, names: Sequence[str]) -> dict[str, float]:
    """Return attributes that are numbers; raise `SchemaError` with all that are not."""
    numbers, problems = {}, []
    for name in names:
        value = table.attrs.get(name)
        if isinstance(value, int | float | np.integer | np.floating):
            numbers[name] = float(value)
        else:
            problems.append(f"attribute {name} of {table.name} is {value!r}; a number is needed")
    if problems:
        raise SchemaError("posterior", problems)
    return numbers


def covariance(db: xr.DataTree, coefficient: str) -> tuple[dict[str, slice], np.ndarray]:
    """Return the covariance of the nodes of all terms of a coefficient.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        Name of the coefficient, such as ``"CL"``.

    Returns
    -------
    slices : dict of str to slice
        The rows of every term with ``stderr``, in the order of ``value.ravel()``.
    V : array (nodes, nodes)
        Covariance of all nodes of these terms. [square of the units of the nodes]

    Raises
    ------
    UnknownName
        The database has no term of the coefficient.
    """
    uncertain, all_coefficients = {}, []
    for name, leaf in terms(db).items():
        all_coefficients.append(name.split("/")[0])
        if all_coefficients[-1] == coefficient and "stderr" in leaf:
            uncertain[name] = leaf
    if coefficient not in all_coefficients:
        raise UnknownName(coefficient, set(all_coefficients), "coefficient")
    return joint_covariance(uncertain)


def joint_covariance(leaves: Mapping[str, xr.Dataset]) -> tuple[dict[str, slice], np.ndarray]:
    """Return the rows of every term and the covariance of the nodes of all of them.

    Each term needs ``stderr``.
    """
    slices, count = {}, 0
    for name, leaf in leaves.items():
        slices[name] = slice(count, count + leaf["value"].size)
        count += leaf["value"].size
    V = np.zeros((count, count))
    joint: dict[str, list[str]] = {}
    # P of every term; terms are independent a priori.
    for name, leaf in leaves.items():
        block, nodes = slices[name], np.arange(leaf["value"].size)
        mark = joint_mark(leaf)
        if not mark:
            V[block, block] = prior_covariance(leaf)
        else:
            V[block, block] = covariance_between_nodes(leaf, nodes[:, None], nodes)
            joint.setdefault(mark, []).append(name)
    # - W W' + Z Z' of all terms of one origin.
    for members in joint.values():
        rows = np.concatenate([np.arange(count)[slices[name]] for name in members])
        F = np.vstack([factor_of(leaves[name])[0] for name in members])
        sign = factor_of(leaves[members[0]])[1]
        V[np.ix_(rows, rows)] += (F * sign) @ F.T
    # Errors that edits have added are independent from node to node.
    for members in joint.values():
        for name in members:
            diagonal = np.arange(count)[slices[name]]
            V[diagonal, diagonal] += independent_variances(leaves[name])
    return slices, V


def draw(
    db: xr.DataTree,
    count: int,
    seed: int,
    names: Sequence[str] | None = None,
    common: Mapping[str, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return node values drawn from the distribution that a database states.

    The distribution has the values, standard errors and correlation of the database.

    Parameters
    ----------
    db : DataTree
        The database.
    count : int
        Number of draws.
    seed : int
        Seed of the random numbers; the same seed gives the same draws.
    names : sequence of str, optional
        Coefficients to draw, such as ``["CL", "Cm"]``; the default is all.  The draws of a
        coefficient do not depend on which others are drawn.
    common : mapping of str to array (count,), optional
        Standard normal numbers of errors common to all fits, such as ``mass`` (`common_errors`).
        They replace drawn numbers.  Sign: truth less reading, in standard errors.

    Returns
    -------
    dict of str to array (count, shape of the table)
        Draws of every term with ``stderr``; nodes with ``stderr`` zero keep their values.

    Raises
    ------
    UnknownName
        The database has no term of a coefficient.
    """
    leaves = terms(db)
    present = list(dict.fromkeys(name.split("/")[0] for name in leaves))
    selected = present
    if names is not None:
        selected = list(names)
    for name in selected:
        if name not in present:
            raise UnknownName(name, present, "coefficient")
    draws: dict[str, np.ndarray] = {}
    for coefficient in selected:
        slices, V = covariance(db, coefficient)
        # Each coefficient has its own stream of random numbers.
        random = np.random.default_rng([seed, *coefficient.encode()])
        G, z = _common_changes(common or {}, leaves, slices)
        # Nodes = G z + independent draws of the covariance without the common errors.
        independent = random.standard_normal((count, len(V))) @ _covariance_root(V - G @ G.T).T
        errors = independent + z.T @ G.T
        for name, rows in slices.items():
            value = leaves[name]["value"].values
            draws[name] = value + errors[:, rows].reshape(count, *value.shape)
    return draws


def common_errors(db: xr.DataTree) -> list[str]:
    """Return the names of the errors common to all fits in the joint covariance of the nodes.

    Examples are ``mass`` and ``bias.delta_e``.
    """
    names: set[str] = set()
    for leaf in terms(db).values():
        names.update(_component_errors(leaf))
    return sorted(names - {""})


def _component_errors(leaf: xr.Dataset) -> list[str]:
    """Return the names of the common errors of the last components; empty without a name."""
    if not joint_mark(leaf):
        return []
    return str(leaf["posterior_sign"].attrs.get(ERRORS, "")).split("\n")


def _common_changes(
    common: Mapping[str, np.ndarray], leaves: Mapping[str, xr.Dataset], slices: Mapping[str, slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the changes of the nodes by common errors, (nodes, errors), and their numbers."""
    nodes = max((rows.stop for rows in slices.values()), default=0)
    columns: dict[str, np.ndarray] = {}
    for name, rows in slices.items():
        errors = _component_errors(leaves[name])
        # The components of the common errors are the last ones: negative indices.
        for component, error in enumerate(errors, -len(errors)):
            if error in common:
                factor = factor_of(leaves[name])[0]
                columns.setdefault(error, np.zeros(nodes))[rows] = factor[:, component]
    if not columns:
        return np.zeros((nodes, 0)), np.zeros((0, 1))
    return np.stack(list(columns.values()), axis=1), np.array([common[name] for name in columns])


def with_node_values(db: xr.DataTree, values: Mapping[str, np.ndarray]) -> xr.DataTree:
    """Return a database with other node values, such as one of the draws of `draw`.

    Standard errors and sources do not change.
    """
    leaves = terms(db)
    tree = db.copy()
    for name, value in values.items():
        tree[name] = xr.DataTree(leaves[name].assign(value=leaves[name]["value"].copy(data=value)))
    return tree


def _covariance_root(V: np.ndarray) -> np.ndarray:
    """Return the lower Cholesky factor of a covariance, with zero rows where it has no variance."""
    sd = np.sqrt(np.maximum(np.diag(V), 0.0))
    free = sd > 0
    L = np.zeros_like(V)
    if free.any():
        correlation = V[np.ix_(free, free)] / np.outer(sd[free], sd[free])
        L[np.ix_(free, free)] = sd[free, None] * _factor_correlation(correlation)
    return L


def _factor_correlation(R: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of a correlation matrix with the least jitter that works."""
    for jitter in _JITTER * 10.0 ** np.arange(_JITTER_STEPS):
        with contextlib.suppress(np.linalg.LinAlgError):
            return np.linalg.cholesky(R + jitter * np.eye(len(R)))
    raise SchemaError(
        "posterior",
        [
            "the covariance of the nodes is not positive semidefinite; write the database "
            "again from its fits"
        ],
    )
