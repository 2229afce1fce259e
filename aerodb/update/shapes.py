"""Identified tables with a shape that physics demands: a sign, or rising or falling along an axis.

With the posterior N(g, V) of the nodes of a coefficient and the inequalities A g >= 0, the most
probable nodes are

    g + V A' m,    m >= 0,    m' A (g + V A' m) = 0

for the multipliers m of a quadratic programme.  A shape that the flights support changes nothing;
one that they contradict moves the nodes of other terms as well, by their correlation.  ``stderr``
stays that of the flights: where the demand is true the error became smaller (the new nodes are
nearer to every point that meets it, measured by V), by how much the demand itself does not state.
What the standard errors would be with the inequalities at their bounds as exact is reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.optimize import nnls

from aerodb.update.posterior import joint_covariance
from flightmech.errors import IdentificationError, UnknownName

KINDS = ("rising", "falling", "not_negative", "not_positive")
_JITTER = 1e-10  # of the variance of a difference: neighbours of one parameter have the same


@dataclass(frozen=True)
class Shape:
    """What a table must be.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    axis : str
        Along which it rises or falls; for a sign, the axis that `low` and `high` mean.
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
        if not self.axis and (
            self.kind in ("rising", "falling") or np.isfinite([self.low, self.high]).any()
        ):
            raise IdentificationError(
                f"{self.kind}: no axis; state along which axis the table is meant"
            )


def demand_shapes(shapes: Mapping[str, Sequence[Shape]], leaves: Mapping[str, xr.Dataset]) -> None:
    """Raise `UnknownName` for a term, or an axis of a term, that there is not; `leaves` are those
    that may change.
    """
    for name, demands in shapes.items():
        if name not in leaves:
            raise UnknownName(
                name, leaves, "term with a shape", "it is held, or the database does not hold it"
            )
        for shape in demands:
            if shape.axis and shape.axis not in leaves[name]["value"].dims:
                raise UnknownName(
                    shape.axis, map(str, leaves[name]["value"].dims), f"axis of {name}"
                )


def apply_shapes(
    leaves: Mapping[str, xr.Dataset], shapes: Mapping[str, Sequence[Shape]]
) -> tuple[dict[str, xr.Dataset], dict[str, dict[str, float]]]:
    """Return the terms of one coefficient with their shapes, and the effect on each.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        Identified terms with their joint covariance (`aerodb.update.posterior`).
    shapes : mapping of str to sequence of Shape
        By term; terms that are not among `leaves` count for nothing.

    Returns
    -------
    leaves : dict of str to Dataset
    effect : dict of str to dict
        By term: ``shape_bounds``, inequalities of it at their bound, and ``shape_ratio``, rms of
        the standard errors of its nodes with all these as exact over ``stderr``.

    Raises
    ------
    IdentificationError
        Nodes with standard error zero that contradict a shape.
    """
    slices, V = joint_covariance(dict(leaves))
    rows = [
        (name, row)
        for name, demands in shapes.items()
        if name in leaves
        for row in _rows(leaves[name], demands, slices[name], len(V))
    ]
    if not rows:
        return dict(leaves), {}
    A = np.stack([row for _, row in rows])
    g = np.concatenate([leaves[name]["value"].values.ravel() for name in slices])
    m = _multipliers(A, V, g, [name for name, _ in rows])
    moved, active = g + V @ (A.T @ m), m > 0.0
    VA = V @ A[active].T
    variance = np.diag(V) - np.einsum(
        "ij,ij->i", VA @ np.linalg.pinv(A[active] @ VA, rcond=_JITTER, hermitian=True), VA
    )
    ratio2 = np.divide(
        np.maximum(variance, 0.0), np.diag(V), out=np.ones(len(V)), where=np.diag(V) > 0.0
    )
    new: dict[str, xr.Dataset] = {}
    effect: dict[str, dict[str, float]] = {}
    for name, at in slices.items():
        leaf = leaves[name]
        new[name] = leaf.assign(
            value=leaf["value"].copy(data=moved[at].reshape(leaf["value"].shape))
        )
        if name in shapes:
            count = sum(bool(one) for (owner, _), one in zip(rows, active) if owner == name)
            effect[name] = {"shape_bounds": count, "shape_ratio": float(np.sqrt(ratio2[at].mean()))}
            words = (
                f"{', '.join(' '.join(filter(None, (one.kind, one.axis))) for one in shapes[name])}: "
                f"{count} inequalities at their bound."
            )
            new[name].attrs["comment"] = f"{leaf.attrs.get('comment', '')} Shape {words}".strip()
    return new, effect


def _rows(leaf: xr.Dataset, demands: Sequence[Shape], at: slice, count: int) -> list[np.ndarray]:
    """Return the rows of A of one term."""
    places = np.arange(at.start, at.stop).reshape(leaf["value"].shape)
    rows = []
    for shape in demands:
        along = places
        if shape.axis:
            points = leaf[shape.axis].values
            kept = np.flatnonzero((points >= shape.low) & (points <= shape.high))
            along = np.moveaxis(places, leaf["value"].dims.index(shape.axis), 0)[kept]
        sign = 1.0 if shape.kind in ("rising", "not_negative") else -1.0
        ends = [along] if shape.kind.startswith("not") else [along[1:], along[:-1]]
        for group in zip(*(end.ravel() for end in ends)):
            row = np.zeros(count)
            row[list(group)] = [sign, -sign][: len(group)]
            rows.append(row)
    return rows


def _multipliers(A: np.ndarray, V: np.ndarray, g: np.ndarray, names: Sequence[str]) -> np.ndarray:

    K, slack = A @ V @ A.T, A @ g
    size = np.sqrt(np.maximum(np.diag(K), 0.0))
    free = size > 0.0
    fixed = [name for name, known, short in zip(names, ~free, slack < 0.0) if known and short]
    if fixed:
        raise IdentificationError(
            f"{fixed[0]}: nodes with standard error 0 contradict the shape demanded; give "
            f"them an error, or limit the shape"
        )
    m = np.zeros(len(A))
    if free.any():
        scale = size[free]
        L = np.linalg.cholesky(
            K[np.ix_(free, free)] / np.outer(scale, scale) + _JITTER * np.eye(len(scale))
        )
        m[free] = (
            nnls(L.T, -np.linalg.solve(L, slack[free] / scale), maxiter=100 * len(scale))[0] / scale
        )
    return m
