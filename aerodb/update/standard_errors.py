"""Standard errors of coefficients, of their derivatives and of terms at conditions, from the joint
covariance of the nodes.

A contribution is linear in the nodes, c = B g (`flightmech.terms.basis`), so its variance is B V
B'.  V is the covariance that the tables hold (`aerodb.update.posterior`): after a flight the joint
one of all terms of a coefficient.  A table without it has the correlation that
`aerodb.update.correlation` gives an a-priori table, and is independent of the others.  Factor
tables K are taken as known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.sparse import csr_array

from aerodb.store.schema import terms
from aerodb.update.posterior import (
    covariance_between_nodes,
    draw,
    factor_of,
    independent_variances,
    joint_mark,
    with_node_values,
)
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.flying_qualities.evaluation import Characteristics, characteristics

_LEAST = 10  # draws: a standard deviation of fewer is uncertain by more than a quarter
_MODE = ("omega_n", "damping_ratio")


def with_standard_errors(
    found: Characteristics,
    aircraft: Aircraft,
    db: xr.DataTree,
    condition: Mapping[str, float],
    count: int = 50,
    seed: int = 1,
) -> Characteristics:
    """Return characteristics with the standard errors that follow from those of the database.

    Parameters
    ----------
    found : Characteristics
        Of the database itself, from `flightmech.characteristics`.
    aircraft, db, condition
        As there; mass, c.g., inertia and thrust count as known.
    count : int
        Databases to draw, 10 or more; each takes as long as one call of
        `flightmech.characteristics`.
    seed : int
        Of the random numbers.

    Returns
    -------
    Characteristics
        ``table`` with the column ``stderr``, ``modes`` with ``omega_n_stderr`` and
        ``damping_ratio_stderr``: standard deviations over the draws in which a quantity exists; NaN
        when these are fewer than 10.

    Raises
    ------
    SchemaError
        Fewer than 10 draws, or draws that cannot be trimmed and leave fewer.
    """
    if count < _LEAST:
        raise SchemaError("samples", [f"{count} draws; give {_LEAST} or more"])

    values = draw(db, count, seed)
    tables, modes, failures = [], [], []
    for k in range(count):
        try:
            one = characteristics(
                aircraft,
                with_node_values(db, {name: nodes[k] for name, nodes in values.items()}),
                condition,
            )
        except AeromatchError as error:
            failures.append(str(error))
            continue
        tables.append(one.table["value"])
        modes.append(one.modes.drop_duplicates("mode").set_index("mode")[list(_MODE)])
    if len(tables) < _LEAST:
        raise SchemaError(
            "samples",
            [f"{len(failures)} of {count} draws cannot be evaluated; the first: {failures[0]}"],
        )
    spread = pd.concat(tables, axis=1).apply(_deviation, axis=1)
    of_modes = {
        name: pd.concat([one[name] for one in modes], axis=1).apply(_deviation, axis=1)
        for name in _MODE
    }
    errors = {
        f"{name}_stderr": found.modes["mode"].map(deviations)
        for name, deviations in of_modes.items()
    }
    return replace(
        found,
        table=found.table.assign(stderr=spread.reindex(found.table.index)),
        modes=found.modes.assign(**errors),
    )


def _deviation(values: pd.Series) -> float:
    known = values.to_numpy(float)
    known = known[np.isfinite(known)]
    return float(known.std(ddof=1)) if len(known) >= _LEAST else float("nan")


_STEP = float(
    np.finfo(float).eps ** (1.0 / 3.0)
)  # half the width of a central difference, of a variable of the size of one
_CHUNK = 4096  # samples at a time: 16 x 16 corners of each


def standard_error(
    db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any], derivative: str | None = None
) -> np.ndarray:
    """Return the standard error of a coefficient, or of one of its derivatives, at given
    conditions.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        Such as ``"CL"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other; beyond a table the rule of the
        leaf. [SI]
    derivative : str, optional
        One of the conditions, such as ``"alpha"``: that of the derivative with respect to it, a
        central difference as the derivatives of `flightmech.characteristics` are.

    Returns
    -------
    array (broadcast shape of the conditions used)
        Root of the variance of the sum of all terms; a term without ``stderr`` counts as exact.
        [1, or 1 per unit of the variable]

    Raises
    ------
    UnknownName
        The database has no term of the coefficient, or a variable is missing in `conditions`.
    """
    leaves = {name: leaf for name, leaf in terms(db).items() if name.split("/")[0] == coefficient}
    if not leaves:
        raise UnknownName(coefficient, {name.split("/")[0] for name in terms(db)}, "coefficient")
    if derivative is not None and derivative not in conditions:
        raise UnknownName(derivative, conditions, "condition")
    shape = np.broadcast_shapes(
        *(_terms.evaluate_term(leaf, conditions, "clamp").shape for leaf in leaves.values())
    )
    used = {name for leaf in leaves.values() for name in _terms.list_model_variables(leaf)}
    whole = {
        name: np.broadcast_to(np.asarray(x, float), shape).ravel()
        for name, x in conditions.items()
        if name in used
    }
    if derivative not in (None, *used):
        return np.zeros(shape)
    count = int(np.prod(shape))
    return spread_of_sum(
        [(_map(leaf, whole, derivative, count), leaf) for leaf in leaves.values()]
    ).reshape(shape)


def spread_of_sum(parts: Sequence[tuple[csr_array, xr.Dataset]]) -> np.ndarray:
    """Return the standard errors of sums of linear combinations of the nodes of several terms of
    one coefficient.

    Parameters
    ----------
    parts : sequence of (sparse array (samples, nodes), Dataset)
        From `flightmech.terms.basis`, or a linear combination of several of them, and the term; one
        without ``stderr`` counts as exact.

    Returns
    -------
    array (samples,)
    """
    variance = np.zeros(parts[0][0].shape[0])
    joint: dict[str, np.ndarray] = {}
    signs: dict[str, np.ndarray] = {}
    for B, leaf in ((B, leaf) for B, leaf in parts if "stderr" in leaf):
        variance += _own_variance(B, leaf)
        if mark := joint_mark(leaf):
            F, signs[mark] = factor_of(leaf)
            joint[mark] = joint.get(mark, 0.0) + B @ F
    for mark, moved in joint.items():
        variance += moved**2 @ signs[mark]
    return np.sqrt(np.maximum(variance, 0.0))


def _map(
    leaf: xr.Dataset, conditions: Mapping[str, np.ndarray], derivative: str | None, count: int
) -> csr_array:
    """Return the linear map from the nodes of a term to its contribution at every condition, or to
    the derivative of it.
    """
    if derivative is None:
        return repeat_rows(_terms.basis(leaf, conditions, "clamp"), count)
    steps = [
        {**conditions, derivative: conditions[derivative] + side * _STEP} for side in (1.0, -1.0)
    ]
    after, before = (repeat_rows(_terms.basis(leaf, at, "clamp"), count) for at in steps)
    return (after - before) / (2.0 * _STEP)


def repeat_rows(B: csr_array, count: int) -> csr_array:
    """Return a map with a row for every condition: that of a term without variables has a single
    one.
    """
    return B if B.shape[0] == count else type(B)(np.repeat(B.toarray(), count, axis=0))


def standard_errors(B: csr_array, leaf: xr.Dataset) -> np.ndarray:
    """Return the standard errors of linear combinations of the nodes of a term.

    Parameters
    ----------
    B : sparse array (samples, nodes)
        From `flightmech.terms.basis`.
    leaf : Dataset
        The term; without ``stderr`` the errors are zero.

    Returns
    -------
    array (samples,)
    """
    return spread_of_sum([(B, leaf)])


def _own_variance(B: csr_array, leaf: xr.Dataset) -> np.ndarray:
    """Return B P B' sample by sample, and what ``stderr`` has beyond the stored covariance."""
    variance = np.zeros(B.shape[0])
    corners = np.diff(B.indptr)
    for count in np.unique(corners):
        rows = np.flatnonzero(corners == count)
        for part in np.array_split(rows, -(-len(rows) // _CHUNK)):
            at = B.indptr[part][:, None] + np.arange(count)
            nodes, weights = B.indices[at], B.data[at]
            P = covariance_between_nodes(leaf, nodes[:, :, None], nodes[:, None, :])
            variance[part] = np.einsum("ni,nij,nj->n", weights, P, weights)
    if joint_mark(leaf):
        variance += B.power(2) @ independent_variances(leaf)
    return variance
