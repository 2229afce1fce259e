"""Two databases of one aircraft joined, each with the weight that its standard errors give it.

Rule ``inverse_variance`` takes every node of the union of the breakpoints by itself: with values v
and standard errors s,

    v = v_1 + s_1^2/(s_1^2 + s_2^2) (v_2 - v_1),    1/s^2 = 1/s_1^2 + 1/s_2^2,    chi2 = sum (v_2 - v_1)^2/(s_1^2 + s_2^2),

and rule ``correlated`` all nodes of a table together (mixed estimation [Theil1961]): the second
table's own nodes are independent observations y = H v, R = diag(s_2^2), of the first, whose errors
have the covariance P of `aerodb.update.correlation`,

    G = P H' (H P H' + R)^-1,    v = v_1 + G (y - H v_1),    cov = P - G H P,    chi2 = (y - H v_1)' (H P H' + R)^-1 (y - H v_1).

The first assumes that DATCOM is in error at each node on its own; the second, that it is in error
along the table, so that a correction reaches nodes that the second database does not have.  Along
an axis that only the first has, a node of the second is compared with the mean of the first (in H),
not counted once per breakpoint.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from scipy.stats import chi2 as chi2_distribution

from aerodb.edit.table_edits import match_names
from aerodb.store.grids import (
    fold_factors,
    is_within,
    known_source,
    node_text,
    regrid_leaf,
    same_factors,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.store.schema import terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit
from aerodb.update.correlation import prior_covariance
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName

RULES = ("inverse_variance", "correlated")
UNLIKELY = (
    0.01  # probability of a chi-square below which two tables disagree by more than their errors
)
COUNTED = 0.9  # a node is of the second source where it brought the standard error below this share
_SAME = ("S", "cbar", "b", "x_ref", "y_ref", "z_ref", "force_axes")
_AGREE = 1e-6
COLUMNS = ("nodes", "chi2", "probability", "worst", "location")


def blend(
    db: xr.DataTree,
    other: xr.DataTree,
    names: str | Iterable[str] | None = None,
    rule: str = "inverse_variance",
    *,
    note: str = "",
) -> xr.DataTree:
    """Return a database with terms joined with those of another one, by their standard errors.

    Parameters
    ----------
    db : DataTree
        The database, such as the prior; it is left as it is.
    other : DataTree
        New knowledge of the same terms, independent of `db`: a result of `tabulate` already holds
        its prior and does not belong here.
    names : str or iterable of str, optional
        Terms, or patterns; every term that both have unless given.
    rule : {"inverse_variance", "correlated"}
        Nodes by themselves, or all nodes of a table together with the correlations of
        `aerodb.update.correlation` for `db`.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        Tables over the union of the breakpoints.  A standard error of zero means exact.  Where only
        one table has a node it stands alone (with ``correlated``, corrected by its neighbours);
        beyond both, `db` as the simulation continues it.  A node has the source of `other` where
        that brought its standard error below 0.9 of the former one, else that of `db`.

    Raises
    ------
    UnknownName
        A term that one of the two does not have, or an unknown rule.
    SchemaError
        Reference quantities or axes differ, terms have other regressors or no standard errors, or
        both are exact and differ; all faults.

    Warns
    -----
    AeromatchWarning
        Terms that disagree by more than their errors: chi-square with a probability below 0.01.

    References
    ----------
    .. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int. Econ. Rev. 2, 1961.
    """
    pairs = _pairs(db, other, names, rule)
    frame = _frame(pairs, rule)
    leaves, problems = terms(db), []
    for name, pair in pairs.items():
        try:
            new = _blended(pair, rule)
        except SchemaError as error:
            problems += [f"{name}: {fault}" for fault in error.problems]
            continue
        row = frame.loc[name]
        leaves[name] = add_history_line(
            new, f"blend: {rule}, chi-square {row.chi2:.4g} of {row.nodes} nodes{note_suffix(note)}"
        )
    if problems:
        raise SchemaError("blend", problems)
    unlike = frame[frame["probability"] < UNLIKELY]
    if len(unlike):
        summary = [
            f"{name} (chi-square {row.chi2:.4g} of {row.nodes} nodes, {row.worst:.3g} at "
            f"{row.location})"
            for name, row in unlike.iterrows()
        ]
        text = f"blend: tables disagree by more than their standard errors: {'; '.join(summary)}"
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    title = str(other.attrs["title"])
    return record_edit(db, leaves, "blend", f"{' '.join(pairs)} with {title!r}, {rule}", note)


def consistency(
    db: xr.DataTree,
    other: xr.DataTree,
    names: str | Iterable[str] | None = None,
    rule: str = "inverse_variance",
) -> pd.DataFrame:
    """Return how well two databases agree within their standard errors, before they are joined.

    Parameters
    ----------
    db, other, names, rule
        As in `blend`.

    Returns
    -------
    DataFrame, index ``term``
        ``nodes`` (those of `other` within the table of `db`, unless both are exact there),
        ``chi2``, its ``probability`` for as many nodes (which errors of `db` that go together along
        a table make too small or too large unless the rule is ``correlated``), ``worst``, the
        largest difference other - db in its standard error, signed, and ``location``.

    Raises
    ------
    UnknownName, SchemaError
        As in `blend`.
    """
    return _frame(_pairs(db, other, names, rule), rule)


@dataclass(frozen=True)
class _Pair:
    """A term as both have it, factors alike."""

    ours: xr.Dataset
    theirs: xr.Dataset


def _pairs(
    db: xr.DataTree, other: xr.DataTree, names: str | Iterable[str] | None, rule: str
) -> dict[str, _Pair]:
    if rule not in RULES:
        raise UnknownName(rule, RULES, "rule")
    ours, theirs = terms(db), terms(other)
    chosen = [name for name in ours if name in theirs] if names is None else match_names(db, names)
    problems = [
        f"{key} is {db.attrs[key]!r} here and {other.attrs[key]!r} there"
        for key in _SAME
        if not _agree(db.attrs[key], other.attrs[key])
    ]
    if not chosen:
        problems.append("the two have no term in common")
    found = {}
    for name in chosen:
        if name not in theirs:
            raise UnknownName(name, theirs, "term", "the other database does not have it")
        pair = (ours[name], theirs[name])
        problems += [
            f"{name}: no stderr {where}; give one to every node"
            for leaf, where in zip(pair, ("here", "there"))
            if "stderr" not in leaf
        ]
        words = [" ".join(_terms.list_multipliers(leaf)) or "none" for leaf in pair]
        if words[0] != words[1]:
            problems.append(
                f"{name}: regressors {words[0]} here and {words[1]} there; only tables of "
                f"the same meaning can be joined"
            )
        found[name] = (
            _Pair(*pair)
            if same_factors(*pair)
            else _Pair(fold_factors(pair[0]), fold_factors(pair[1]))
        )
    if problems:
        raise SchemaError("blend", problems)
    return found


def _agree(first, second) -> bool:
    return (
        first == second
        if isinstance(first, str)
        else bool(np.isclose(float(first), float(second), rtol=_AGREE, atol=_AGREE))
    )


def _frame(pairs: dict[str, _Pair], rule: str) -> pd.DataFrame:
    rows = {name: _row(pair, rule) for name, pair in pairs.items()}
    return pd.DataFrame.from_dict(rows, orient="index", columns=list(COLUMNS)).rename_axis("term")


@dataclass(frozen=True)
class _Observed:
    """The nodes of theirs within ours as observations of ours: y = H g + e, cov(e) = diag(s^2), g
    the nodes of a table.
    """

    points: dict[str, np.ndarray]
    H: np.ndarray  # (observations, nodes)
    y: np.ndarray
    s: np.ndarray


def _observed(table: xr.Dataset, pair: _Pair) -> _Observed:
    """Return what theirs holds for `table`, which is ours on any grid."""
    own, theirs = value_breakpoints(pair.ours), value_breakpoints(pair.theirs)
    points = {axis: p[is_within(own[axis], p)] if axis in own else p for axis, p in theirs.items()}
    rest = {axis: p for axis, p in value_breakpoints(table).items() if axis not in points}
    count, nodes = (int(np.prod([len(p) for p in part.values()])) for part in (points, rest))
    size = table["value"].size
    if not count:
        return _Observed(points, np.zeros((0, size)), np.zeros(0), np.zeros(0))
    mesh = (
        dict(zip([*points, *rest], np.meshgrid(*points.values(), *rest.values(), indexing="ij")))
        if points or rest
        else {}
    )
    flat = {axis: grid.ravel() for axis, grid in mesh.items()}
    B = _terms.basis(_terms.without_multipliers(table[["value"]]), flat, "clamp").toarray()
    H = np.broadcast_to(B, (count * nodes, size)).reshape(count, nodes, size).mean(axis=1)
    there = pair.theirs.sel(points)
    return _Observed(points, H, there["value"].values.ravel(), there["stderr"].values.ravel())


def _row(pair: _Pair, rule: str) -> tuple[int, float, float, float, str]:

    seen = _observed(pair.ours, pair)
    r = seen.y - seen.H @ pair.ours["value"].values.ravel()
    total = (seen.H @ pair.ours["stderr"].values.ravel()) ** 2 + seen.s**2
    known = total > 0.0
    if not known.any():
        return 0, 0.0, 1.0, float("nan"), ""
    in_errors = np.divide(r, np.sqrt(total), out=np.zeros_like(r), where=known)
    worst = int(np.argmax(np.abs(in_errors)))
    if rule == "correlated":
        H = seen.H[known]
        A = H @ prior_covariance(pair.ours) @ H.T + np.diag(seen.s[known] ** 2)
        chi2 = float(r[known] @ _inverse(A) @ r[known])
    else:
        chi2 = float((in_errors**2).sum())
    count = int(known.sum())
    at = np.unravel_index(worst, [len(p) for p in seen.points.values()]) if seen.points else ()
    return (
        count,
        chi2,
        float(chi2_distribution.sf(chi2, count)),
        float(in_errors[worst]),
        node_text(seen.points, [int(i) for i in at]),
    )


def _blended(pair: _Pair, rule: str) -> xr.Dataset:
    points = union_axes(pair.ours, pair.theirs)
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "blend",
            [f"the axes {' '.join(points)} of the two together are more than {_terms.MAX_AXES}"],
        )
    ours, theirs = regrid_leaf(pair.ours, points), regrid_leaf(pair.theirs, points)
    inside = [_inside(leaf, points) for leaf in (pair.ours, pair.theirs)]
    both, alone = inside[0] & inside[1], inside[1] & ~inside[0]
    v1, v2 = (leaf["value"].values for leaf in (ours, theirs))
    s1, s2 = (leaf["stderr"].values for leaf in (ours, theirs))
    off = both & (s1 == 0.0) & (s2 == 0.0) & ~np.isclose(v1, v2, rtol=_AGREE, atol=1e-12)
    if off.any():
        at = node_text(points, [int(i) for i in np.argwhere(off)[0]])
        raise SchemaError(
            "blend",
            [
                f"both are exact (standard error 0) and differ at {at} and "
                f"{int(off.sum()) - 1} more nodes"
            ],
        )
    joined = _together(ours, pair) if rule == "correlated" else _apart(both, v2 - v1, s1, s2)
    value = np.where(alone, v2, v1 + joined[0])
    stderr = np.where(alone, s2, joined[1])
    source = np.where(
        alone | (both & (stderr < COUNTED * s1)), known_source(theirs), known_source(ours)
    )
    return with_table(ours, points, value, stderr, source)


def _apart(
    both: np.ndarray, r: np.ndarray, s1: np.ndarray, s2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return correction and standard error of nodes by themselves; outside `both` none and the
    first.
    """
    total = s1**2 + s2**2
    share = np.divide(s1**2, total, out=np.zeros_like(r), where=both & (total > 0.0))
    return share * r, np.where(both, np.sqrt(share) * s2, s1)


def _together(ours: xr.Dataset, pair: _Pair) -> tuple[np.ndarray, np.ndarray]:
    """Return correction and standard error of all nodes of a table at once."""
    P, seen, shape = prior_covariance(ours), _observed(ours, pair), ours["value"].shape
    A = seen.H @ P @ seen.H.T + np.diag(seen.s**2)
    known = np.diag(A) > 0.0
    G = P @ seen.H[known].T @ _inverse(A[np.ix_(known, known)])
    step = G @ (seen.y - seen.H @ ours["value"].values.ravel())[known]
    variance = np.diag(P) - np.einsum("ij,ij->i", G, P @ seen.H[known].T)
    return step.reshape(shape), np.sqrt(np.maximum(variance, 0.0)).reshape(shape)


def _inverse(A: np.ndarray) -> np.ndarray:
    """Inverse of a covariance that may be singular, scaled to unit diagonal first."""
    sd = np.sqrt(np.diag(A))
    return np.linalg.pinv(A / np.outer(sd, sd), rcond=1e-12, hermitian=True) / np.outer(sd, sd)


def _inside(leaf: xr.Dataset, points: dict[str, np.ndarray]) -> np.ndarray:
    """Return which nodes of a grid lie within the table of a leaf."""
    found = np.ones([len(p) for p in points.values()], bool)
    for at, (axis, p) in enumerate(points.items()):
        if axis in leaf["value"].dims:
            found &= is_within(value_breakpoints(leaf)[axis], p).reshape(
                [-1 if i == at else 1 for i in range(len(points))]
            )
    return found
