"""Standard errors of coefficients, of their derivatives and of terms at given conditions.

A contribution is linear in the nodes, c = B g (`flightmech.terms.basis`), so its variance is B V
B'.  V is the stored covariance of the tables (`aerodb.update.posterior`): after a flight the joint
covariance of all terms of a coefficient.  A table without it has the correlation of an a-priori
table (`aerodb.update.correlation`) and is independent of the others.  Factor tables K count as
exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

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

_LEAST_DRAWS = 10  # a standard deviation of fewer draws is uncertain by more than a quarter
_MODE = ("omega_n", "damping_ratio")
# Half the width of a central difference of a variable of order one: the cube root of the rounding.
_STEP = float(np.finfo(float).eps ** (1.0 / 3.0))
_CHUNK = 4096  # samples at a time, because each needs a matrix of 16 x 16 corners


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
        Characteristics of the database itself, from `flightmech.characteristics`.
    aircraft, db, condition
        As in `flightmech.characteristics`; mass, c.g., inertia and thrust count as exact.
    count : int
        Number of databases to draw, 10 or more.  Each takes as long as one call of
        `flightmech.characteristics`.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    Characteristics
        ``table`` with the column ``stderr``, ``modes`` with ``omega_n_stderr`` and
        ``damping_ratio_stderr``.  They are standard deviations over the draws in which a quantity
        exists, and NaN if these are fewer than 10.

    Raises
    ------
    SchemaError
        Fewer than 10 draws, or fewer than 10 draws that can be trimmed.
    """
    if count < _LEAST_DRAWS:
        raise SchemaError("samples", [f"{count} draws; give {_LEAST_DRAWS} or more"])
    values = draw(db, count, seed)
    tables, modes, failures = [], [], []
    for number in range(count):
        nodes = {name: draws[number] for name, draws in values.items()}
        try:
            sample = characteristics(aircraft, with_node_values(db, nodes), condition)
        except AeromatchError as error:
            failures.append(str(error))
            continue
        tables.append(sample.table["value"])
        modes.append(sample.modes.drop_duplicates("mode").set_index("mode")[list(_MODE)])
    if len(tables) < _LEAST_DRAWS:
        text = f"{len(failures)} of {count} draws cannot be evaluated; the first: {failures[0]}"
        raise SchemaError("samples", [text])
    deviations = pd.concat(tables, axis=1).apply(_standard_deviation, axis=1)
    # A mode may be absent from some draws: the columns are aligned by the name of the mode.
    mode_errors = {}
    for name in _MODE:
        by_draw = pd.concat([table[name] for table in modes], axis=1)
        deviations_by_mode = by_draw.apply(_standard_deviation, axis=1)
        mode_errors[f"{name}_stderr"] = found.modes["mode"].map(deviations_by_mode)
    table = found.table.assign(stderr=deviations.reindex(found.table.index))
    return replace(found, table=table, modes=found.modes.assign(**mode_errors))


def _standard_deviation(values: pd.Series) -> float:
    """Return the standard deviation of the finite values, NaN if they are too few."""
    numbers = values.to_numpy(float)
    finite = numbers[np.isfinite(numbers)]
    if len(finite) < _LEAST_DRAWS:
        return float("nan")
    return float(finite.std(ddof=1))


def standard_error(
    db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any], derivative: str | None = None
) -> np.ndarray:
    """Return the standard error of a coefficient or of one of its derivatives.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        Such as ``"CL"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other.  Beyond a table the rule of
        the leaf applies. [SI]
    derivative : str, optional
        One of the conditions, such as ``"alpha"``.  The result is then that of the derivative with
        respect to it, a central difference as in `flightmech.characteristics`.

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
    used: set[str] = set()
    shapes = []
    for leaf in leaves.values():
        used.update(_terms.list_model_variables(leaf))
        shapes.append(_terms.evaluate_term(leaf, conditions, "clamp").shape)
    shape = np.broadcast_shapes(*shapes)
    if derivative not in (None, *used):
        return np.zeros(shape)
    samples = {}
    for name, x in conditions.items():
        if name in used:
            samples[name] = np.broadcast_to(np.asarray(x, float), shape).ravel()
    count = int(np.prod(shape))
    parts = []
    for leaf in leaves.values():
        parts.append((_contribution_map(leaf, samples, derivative, count=count), leaf))
    return spread_of_sum(parts).reshape(shape)


def spread_of_sum(parts: Sequence[tuple[scipy.sparse.csr_array, xr.Dataset]]) -> np.ndarray:
    """Return the standard errors of sums of contributions of several terms of one coefficient.

    Parameters
    ----------
    parts : sequence of (sparse array (samples, nodes), Dataset)
        From `flightmech.terms.basis`, or a linear combination of several of them, and the term.  A
        term without ``stderr`` counts as exact.

    Returns
    -------
    array (samples,)
    """
    variance = np.zeros(parts[0][0].shape[0])
    # Changes of the sum by each component of a joint distribution, (samples, components).
    joint: dict[str, np.ndarray] = {}
    signs: dict[str, np.ndarray] = {}
    for B, leaf in parts:
        if "stderr" not in leaf:
            continue
        variance += _own_variance(B, leaf)
        mark = joint_mark(leaf)
        if mark:
            F, signs[mark] = factor_of(leaf)
            joint[mark] = joint.get(mark, 0.0) + B @ F
    for mark, change in joint.items():
        variance += change**2 @ signs[mark]
    return np.sqrt(np.maximum(variance, 0.0))


def _contribution_map(
    leaf: xr.Dataset,
    conditions: Mapping[str, np.ndarray],
    derivative: str | None,
    *,
    count: int,
) -> scipy.sparse.csr_array:
    """Return the linear map from the nodes of a term to its contribution or derivative."""
    if derivative is None:
        return repeat_rows(_terms.basis(leaf, conditions, "clamp"), count)
    ends = []
    for side in (1.0, -1.0):
        shifted = {**conditions, derivative: conditions[derivative] + side * _STEP}
        ends.append(repeat_rows(_terms.basis(leaf, shifted, "clamp"), count))
    return (ends[0] - ends[1]) / (2.0 * _STEP)


def repeat_rows(B: scipy.sparse.csr_array, count: int) -> scipy.sparse.csr_array:
    """Return a map with a row for every condition; that of a term without variables has one row."""
    if B.shape[0] == count:
        return B
    return type(B)(np.repeat(B.toarray(), count, axis=0))


def standard_errors(B: scipy.sparse.csr_array, leaf: xr.Dataset) -> np.ndarray:
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


def _own_variance(B: scipy.sparse.csr_array, leaf: xr.Dataset) -> np.ndarray:
    """Return diag(B P B') and the independent variance of an edit, (samples,)."""
    variance = np.zeros(B.shape[0])
    corners = np.diff(B.indptr)
    # Samples with the same number of corners form dense arrays: (samples, corners).
    for count in np.unique(corners):
        rows = np.flatnonzero(corners == count)
        for chunk in np.array_split(rows, -(-len(rows) // _CHUNK)):
            entries = B.indptr[chunk][:, None] + np.arange(count)
            nodes, weights = B.indices[entries], B.data[entries]
            P = covariance_between_nodes(leaf, nodes[:, :, None], nodes[:, None, :])
            variance[chunk] = np.einsum("ni,nij,nj->n", weights, P, weights)
    if joint_mark(leaf):
        variance += B.power(2) @ independent_variances(leaf)
    return variance
