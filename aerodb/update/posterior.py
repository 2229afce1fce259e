"""The joint covariance of the nodes of an identified database: what is stored, and what is computed
from it.

After `aerodb.tabulate` the nodes of all terms of one coefficient have the covariance

    V = P - W W' + Z Z'

with P the a-priori covariance with the learnt weights (terms independent of each other), W what the
fits took from it and Z what the errors common to all fits added.  Flights determine sums of terms
better than each term: the standard errors of single nodes do not show it, V does. Each term table
keeps its rows of V in four variables:

===================  ======================  =====================================================================================
``prior_error``      (``kind``, axes)        a-priori standard error of each node with its sign: the part that is proportional to the
                                             value, and the constant part
                                             (`aerodb.update.correlation`)
``flown_distance``   (axes)                  distance of each node from the flown region, in correlation lengths
``posterior_factor`` (``component``, axes)   W and Z side by side
``posterior_sign``   (``component``)         -1 for a column of W, 1 for one of Z; attribute ``errors``: names of the columns of Z
===================  ======================  =====================================================================================

The attributes of ``prior_error`` are the weights of the parts of P and the correlation lengths.
``posterior_factor`` has the attribute ``origin``: term tables with one origin are jointly
distributed, all others are independent of each other.  A table without these variables has the
a-priori correlation of `aerodb.update.correlation.prior_covariance`; so has one whose breakpoints
or values were edited in a way that the covariance cannot follow (factors and shifts are followed).
Where ``stderr`` is larger than V states, as after an edit with an error of its own, the rest is
independent from node to node.
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
    covariance_between,
    error_kinds,
    node_correlation,
    prior_covariance,
)
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

ERRORS = "errors"
"""Attribute of ``posterior_sign``: one line for each of the last components, the name of the error common to all fits that makes it."""
_ROUNDING = 1e-6  # of a variance
# of the variance of a node: the parts of P that are common to a whole table leave directions
# without variance
_JITTER = 1e-10


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
        Of each node from the flown region, in correlation lengths.
    lengths : mapping of str to float
        Correlation lengths by axis. [SI]
    W, Z : array (nodes, components)
        Rows of the nodes of this term.
    errors : sequence of str
        Name of the error that makes each column of Z, such as ``mass``; empty for one without a
        name.
    """
    dims, shape = after["value"].dims, after["value"].shape
    axes = [str(axis) for axis in dims]
    attributes = {
        **dict(zip(PARTS, map(float, weights))),
        **{f"length_{axis}": float(lengths.get(axis, np.inf)) for axis in axes},
    }
    factor = np.hstack([W, Z]).T
    sign = np.repeat([-1.0, 1.0], [W.shape[1], Z.shape[1]])
    after = after.drop_dims(["component", "kind"], errors="ignore")  # those of an earlier update
    return after.assign_coords(
        component=np.arange(len(sign), dtype=float), kind=np.arange(2.0)
    ).assign(
        prior_error=(("kind", *dims), error_kinds(before).reshape(2, *shape), attributes),
        flown_distance=(dims, distance.reshape(shape)),
        posterior_factor=(("component", *dims), factor.reshape(len(sign), *shape)),
        posterior_sign=("component", sign, {ERRORS: "\n".join(errors)}),
    )


def mark_joint(leaves: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return term tables with the mark that their nodes are jointly distributed: a digest of the
    factors of all of them.
    """
    digest = hashlib.sha256()
    for leaf in leaves.values():
        digest.update(np.ascontiguousarray(leaf["posterior_factor"].values, "<f8").tobytes())
    marked = {}
    for name, leaf in leaves.items():
        marked[name] = leaf.assign(
            posterior_factor=leaf["posterior_factor"].assign_attrs(origin=digest.hexdigest()[:16])
        )
    return marked


def joint_mark(leaf: xr.Dataset) -> str | None:
    """Return the mark of the joint distribution that the nodes of a term table belong to, None
    without one.
    """
    return str(leaf["posterior_factor"].attrs["origin"]) if "posterior_factor" in leaf else None


def without_posterior(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term table that no longer belongs to a joint distribution."""
    return leaf.drop_vars([*_terms.POSTERIOR, "component", "kind"], errors="ignore")


def carry_covariance(
    old: xr.Dataset, new: xr.Dataset, times: np.ndarray | float = 1.0
) -> xr.Dataset:
    """Return an edited term table with the joint covariance of the one before, where its nodes are
    `times` those of it.

    The covariance is dropped where the breakpoints changed, and a table that has none gets none.
    """
    new = without_posterior(new)
    same = old["value"].dims == new["value"].dims and all(
        np.array_equal(old[axis], new[axis]) for axis in old["value"].dims
    )
    if not (joint_mark(old) and same and "stderr" in new):
        return new
    kept = {name: old[name] for name in _terms.POSTERIOR}
    for name in ("prior_error", "posterior_factor"):
        kept[name] = old[name].copy(data=old[name].values * times)
    return new.assign(kept)


def factor_of(leaf: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the factor (nodes, components) and the signs (components,) of a term table that has
    them.
    """
    return leaf["posterior_factor"].values.reshape(leaf.sizes["component"], -1).T, leaf[
        "posterior_sign"
    ].values


def covariance_between_nodes(leaf: xr.Dataset, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return P of single pairs of nodes of a term table: the a-priori covariance, with the learnt
    weights where it has them.

    Parameters
    ----------
    leaf : Dataset
        The term, with ``stderr``.
    i, j : array of int
        Places of the nodes in ``value.ravel()``, broadcast against each other.
    """
    if "posterior_factor" not in leaf:
        return covariance_between(leaf, i, j)
    axes = [str(axis) for axis in leaf["value"].dims]
    known = _numbers(leaf["prior_error"], [*PARTS, *(f"length_{axis}" for axis in axes)])
    lengths = {axis: known[f"length_{axis}"] for axis in axes}
    parts = node_correlation(leaf["value"], leaf["flown_distance"].values.ravel(), i, j, lengths)
    proportional, constant = leaf["prior_error"].values.reshape(2, -1)
    alike = proportional[i] * proportional[j] + constant[i] * constant[j]
    return alike * sum(known[name] * part for name, part in zip(PARTS, parts, strict=True))


def independent_variances(leaf: xr.Dataset) -> np.ndarray:
    """Return what the variances of the nodes have beyond the stored covariance, (nodes,): errors
    that an edit has added.
    """
    nodes = np.arange(leaf["value"].size)
    F, sign = factor_of(leaf)
    stored = covariance_between_nodes(leaf, nodes, nodes) + F**2 @ sign
    stated = leaf["stderr"].values.ravel() ** 2
    return np.where(stated > (1.0 + _ROUNDING) * stored, stated - np.maximum(stored, 0.0), 0.0)


def _numbers(table: xr.DataArray, names: Sequence[str]) -> dict[str, float]:
    """Return attributes that are numbers; all that are not are one `SchemaError`."""
    bad = [
        name
        for name in names
        if not isinstance(table.attrs.get(name), int | float | np.integer | np.floating)
    ]
    if bad:
        raise SchemaError(
            "posterior",
            [
                f"attribute {name} of {table.name} is {table.attrs.get(name)!r}; a number is needed"
                for name in bad
            ],
        )
    return {name: float(table.attrs[name]) for name in names}


def covariance(db: xr.DataTree, coefficient: str) -> tuple[dict[str, slice], np.ndarray]:
    """Return the covariance of the nodes of all terms of a coefficient.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        Such as ``"CL"``.

    Returns
    -------
    slices : dict of str to slice
        The rows of every term with ``stderr``, in the order of ``value.ravel()``.
    V : array (nodes, nodes)
        Of all nodes of these terms. [square of the units of the nodes]

    Raises
    ------
    UnknownName
        The database has no term of the coefficient.
    """
    leaves = {name: leaf for name, leaf in terms(db).items() if name.startswith(f"{coefficient}/")}
    if not leaves:
        raise UnknownName(coefficient, {name.split("/")[0] for name in terms(db)}, "coefficient")
    return joint_covariance({name: leaf for name, leaf in leaves.items() if "stderr" in leaf})


def joint_covariance(leaves: Mapping[str, xr.Dataset]) -> tuple[dict[str, slice], np.ndarray]:
    """Return the rows of every term and the covariance of the nodes of all of them; each needs
    ``stderr``.
    """
    ends = np.cumsum([leaf["value"].size for leaf in leaves.values()], dtype=int)
    slices = {
        name: slice(int(end) - leaf["value"].size, int(end))
        for (name, leaf), end in zip(leaves.items(), ends)
    }
    V = np.zeros((ends[-1], ends[-1])) if leaves else np.zeros((0, 0))
    for name, leaf in leaves.items():
        nodes = np.arange(leaf["value"].size)
        V[slices[name], slices[name]] = (
            covariance_between_nodes(leaf, nodes[:, None], nodes)
            if joint_mark(leaf)
            else prior_covariance(leaf)
        )
    for joint in {joint_mark(leaf): None for leaf in leaves.values() if joint_mark(leaf)}:
        members = {name: leaf for name, leaf in leaves.items() if joint_mark(leaf) == joint}
        rows = np.concatenate([np.arange(V.shape[0])[slices[name]] for name in members])
        F = np.vstack([factor_of(leaf)[0] for leaf in members.values()])
        V[np.ix_(rows, rows)] += (F * factor_of(next(iter(members.values())))[1]) @ F.T
    for name, leaf in leaves.items():
        if joint_mark(leaf):
            at = np.arange(len(V))[slices[name]]
            V[at, at] += independent_variances(leaf)
    return slices, V


def draw(
    db: xr.DataTree,
    count: int,
    seed: int,
    names: Sequence[str] | None = None,
    common: Mapping[str, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return node values drawn from the distribution that a database states: its values, standard
    errors and correlation.

    Parameters
    ----------
    db : DataTree
        The database.
    count : int
        Number of draws.
    seed : int
        Of the random numbers; the same seed gives the same draws.
    names : sequence of str, optional
        Coefficients to draw, such as ``["CL", "Cm"]``; by default all.  The draws of a coefficient
        do not depend on which others are drawn.
    common : mapping of str to array (count,), optional
        Standard normal numbers of errors common to all fits, such as ``mass`` (`common_errors`), in
        place of drawn ones: truth less reading, in standard errors.

    Returns
    -------
    dict of str to array (count, shape of the table)
        Of every term with ``stderr``; nodes with ``stderr`` zero keep their values.

    Raises
    ------
    UnknownName
        The database has no term of a coefficient.
    """
    present = list(dict.fromkeys(name.split("/")[0] for name in terms(db)))
    for name in names or ():
        if name not in present:
            raise UnknownName(name, present, "coefficient")
    found: dict[str, np.ndarray] = {}
    leaves = terms(db)
    for coefficient in present if names is None else names:
        slices, V = covariance(db, coefficient)
        # a stream of its own for each coefficient
        random = np.random.default_rng([seed, *coefficient.encode()])
        G, z = _made_by(common or {}, leaves, slices)
        errors = random.standard_normal((count, len(V))) @ _root(V - G @ G.T).T + z.T @ G.T
        for name, rows in slices.items():
            value = leaves[name]["value"].values
            found[name] = value + errors[:, rows].reshape(count, *value.shape)
    return found


def common_errors(db: xr.DataTree) -> list[str]:
    """Return the names of the errors common to all fits (``mass``, ``bias.delta_e``) that the joint
    covariance of the nodes holds.
    """
    return sorted({error for leaf in terms(db).values() for error in _errors(leaf) if error})


def _errors(leaf: xr.Dataset) -> list[str]:
    """Return the names of the errors that make the last components of a term table; empty for those
    without a name.
    """
    return str(leaf["posterior_sign"].attrs.get(ERRORS, "")).split("\n") if joint_mark(leaf) else []


def _made_by(
    common: Mapping[str, np.ndarray], leaves: Mapping[str, xr.Dataset], slices: Mapping[str, slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Return what one standard error of common errors makes of the nodes, (nodes, errors), and
    their numbers (errors, draws).
    """
    nodes = max((rows.stop for rows in slices.values()), default=0)
    columns: dict[str, np.ndarray] = {}
    for name, rows in slices.items():
        leaf = leaves[name]
        made = _errors(leaf)
        for k, error in enumerate(made, -len(made)):
            if error in common:
                columns.setdefault(error, np.zeros(nodes))[rows] = factor_of(leaf)[0][:, k]
    G = np.stack(list(columns.values()), axis=1) if columns else np.zeros((nodes, 0))
    return G, np.array([common[name] for name in columns]) if columns else np.zeros((0, 1))


def with_node_values(db: xr.DataTree, values: Mapping[str, np.ndarray]) -> xr.DataTree:
    """Return a database with other node values, such as one of the draws of `draw`; standard errors
    and sources stay as they are.
    """
    leaves = terms(db)
    tree = db.copy()
    for name, value in values.items():
        tree[name] = xr.DataTree(leaves[name].assign(value=leaves[name]["value"].copy(data=value)))
    return tree


def _root(V: np.ndarray) -> np.ndarray:
    """Return the lower Cholesky factor of a covariance, with zero rows for nodes without variance."""
    sd = np.sqrt(np.maximum(np.diag(V), 0.0))
    free = sd > 0
    R = V[np.ix_(free, free)] / np.outer(sd[free], sd[free])
    L = np.zeros_like(V)
    if free.any():
        L[np.ix_(free, free)] = sd[free, None] * _cholesky(R)
    return L


def _cholesky(R: np.ndarray) -> np.ndarray:
    for jitter in _JITTER * 10.0 ** np.arange(6):
        with contextlib.suppress(np.linalg.LinAlgError):
            return np.linalg.cholesky(R + jitter * np.eye(len(R)))
    raise SchemaError(
        "posterior",
        [
            "the covariance of the nodes is not positive semidefinite; write the database "
            "again from its fits"
        ],
    )
