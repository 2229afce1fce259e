"""Identified tables with a shape that physics demands: a sign, or a direction along an axis.

With the posterior N(g, V) of the nodes of a coefficient and the inequalities A g >= 0, the most
probable nodes are

    g + V A' m,    m >= 0,    m' A (g + V A' m) = 0

for the multipliers m of a quadratic programme.  A shape that the flights support does not change
the nodes.  A shape that they contradict moves the nodes of other terms as well, by their
correlation.

``stderr`` stays that of the flights.  Where the demand is true the error became smaller: the new
nodes are nearer to every point that satisfies the demand, measured by V.  The demand does not state
by how much.  The standard errors that follow if the inequalities at their bounds are exact are
reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from aerodb.update.posterior import joint_covariance
from flightmech.errors import IdentificationError, UnknownName

KINDS = ("rising", "falling", "not_negative", "not_positive")
# Added to the unit variances of the inequalities: neighbours that share a parameter have equal
# rows.
_JITTER = 1e-10


@dataclass(frozen=True)
class Shape:
    """Demand on the shape of a table.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    axis : str
        Axis along which the table rises or falls.  For a sign, the axis of `low` and `high`.
    low, high : float
        Breakpoints of the axis to which the demand is limited, such as incidence below the stall.
        [SI]
    """

    kind: str
    axis: str = ""
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UnknownName(self.kind, KINDS, "kind of shape")
        is_limited = np.isfinite([self.low, self.high]).any()
        if not self.axis and (self.kind in ("rising", "falling") or is_limited):
            raise IdentificationError(
                f"{self.kind}: no axis; state along which axis the table is meant"
            )


def demand_shapes(shapes: Mapping[str, Sequence[Shape]], leaves: Mapping[str, xr.Dataset]) -> None:
    """Raise `UnknownName` for a shape whose term or axis does not exist.

    Parameters
    ----------
    shapes : mapping of str to sequence of Shape
        By term.
    leaves : mapping of str to Dataset
        The terms that may change.
    """
    for name, demands in shapes.items():
        if name not in leaves:
            reason = "it is held, or the database does not hold it"
            raise UnknownName(name, leaves, "term with a shape", reason)
        axes = list(map(str, leaves[name]["value"].dims))
        for shape in demands:
            if shape.axis and shape.axis not in axes:
                raise UnknownName(shape.axis, axes, f"axis of {name}")


def apply_shapes(
    leaves: Mapping[str, xr.Dataset], shapes: Mapping[str, Sequence[Shape]]
) -> tuple[dict[str, xr.Dataset], dict[str, dict[str, float]]]:
    """Return the terms of one coefficient with their shapes, and the effect on each.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        Identified terms with their joint covariance (`aerodb.update.posterior`).
    shapes : mapping of str to sequence of Shape
        By term; terms that are not among `leaves` are ignored.

    Returns
    -------
    leaves : dict of str to Dataset
    effect : dict of str to dict
        By term: ``shape_bounds``, number of its inequalities at their bound, and ``shape_ratio``,
        rms of the standard errors of its nodes with these inequalities as exact over ``stderr``.

    Raises
    ------
    IdentificationError
        Nodes with standard error zero that contradict a shape.
    """
    slices, V = joint_covariance(dict(leaves))
    owners, rows = [], []
    for name, demands in shapes.items():
        if name in leaves:
            term_rows = _inequality_rows(leaves[name], demands, slices[name], len(V))
            owners += [name] * len(term_rows)
            rows += term_rows
    if not rows:
        return dict(leaves), {}
    A = np.stack(rows)
    g = np.concatenate([leaves[name]["value"].values.ravel() for name in slices])
    m = _solve_multipliers(A, V, g, owners)
    nodes, active = g + V @ (A.T @ m), m > 0.0
    variance_ratio = _variance_ratio(A[active], V)
    at_bound = [name for name, is_active in zip(owners, active) if is_active]
    new: dict[str, xr.Dataset] = {}
    effect: dict[str, dict[str, float]] = {}
    for name, rows_of_term in slices.items():
        leaf = leaves[name]
        value = nodes[rows_of_term].reshape(leaf["value"].shape)
        new[name] = leaf.assign(value=leaf["value"].copy(data=value))
        if name not in shapes:
            continue
        count = at_bound.count(name)
        ratio = float(np.sqrt(variance_ratio[rows_of_term].mean()))
        effect[name] = {"shape_bounds": count, "shape_ratio": ratio}
        text = f"{_list_shapes(shapes[name])}: {count} inequalities at their bound."
        new[name].attrs["comment"] = f"{leaf.attrs.get('comment', '')} Shape {text}".strip()
    return new, effect


def _list_shapes(demands: Sequence[Shape]) -> str:
    """Return the kinds and axes of shapes, such as ``rising alpha, not_negative``."""
    return ", ".join(f"{shape.kind} {shape.axis}".strip() for shape in demands)


def _variance_ratio(A: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return the factor on the variances of nodes if the inequalities A are exact."""
    # diag(V - V A' (A V A')^+ A V), relative to diag(V).
    VA = V @ A.T
    reduction = np.einsum(
        "ij,ij->i", VA @ np.linalg.pinv(A @ VA, rcond=_JITTER, hermitian=True), VA
    )
    variance = np.maximum(np.diag(V) - reduction, 0.0)
    return np.divide(variance, np.diag(V), out=np.ones(len(V)), where=np.diag(V) > 0.0)


def _inequality_rows(
    leaf: xr.Dataset, demands: Sequence[Shape], nodes: slice, count: int
) -> list[np.ndarray]:
    """Return the rows of A of one term, each (count,)."""
    numbers = np.arange(nodes.start, nodes.stop).reshape(leaf["value"].shape)
    rows = []
    for shape in demands:
        selected = numbers
        if shape.axis:
            points = leaf[shape.axis].values
            inside = np.flatnonzero((points >= shape.low) & (points <= shape.high))
            selected = np.moveaxis(numbers, leaf["value"].dims.index(shape.axis), 0)[inside]
        # A sign is an inequality of each node, a direction one of each pair of neighbours.
        sign = -1.0
        if shape.kind in ("rising", "not_negative"):
            sign = 1.0
        if shape.kind.startswith("not"):
            ends = [selected]
        else:
            ends = [selected[1:], selected[:-1]]
        for group in zip(*map(np.ravel, ends)):
            row = np.zeros(count)
            row[list(group)] = [sign, -sign][: len(group)]
            rows.append(row)
    return rows


def _solve_multipliers(
    A: np.ndarray, V: np.ndarray, g: np.ndarray, owners: Sequence[str]
) -> np.ndarray:
    """Return the multipliers m of the inequalities; `owners` is the term of each."""
    K, slack = A @ V @ A.T, A @ g
    size = np.sqrt(np.maximum(np.diag(K), 0.0))
    free = size > 0.0
    for name, is_free, margin in zip(owners, free, slack):
        if not is_free and margin < 0.0:
            raise IdentificationError(
                f"{name}: nodes with standard error 0 contradict the shape demanded; give "
                f"them an error, or limit the shape"
            )
    m = np.zeros(len(A))
    if free.any():
        # minimise 1/2 m' K m + slack' m for m >= 0, as the non-negative least squares problem
        # |L' x + L^-1 slack|^2 with K = L L' scaled to a unit diagonal.
        scale = size[free]
        correlation = K[np.ix_(free, free)] / np.outer(scale, scale)
        L = np.linalg.cholesky(correlation + _JITTER * np.eye(len(scale)))
        target = -np.linalg.solve(L, slack[free] / scale)
        m[free] = scipy.optimize.nnls(L.T, target, maxiter=100 * len(scale))[0] / scale
    return m
