"""The moment reference point of a whole database moved.

A force term contributes c e to the force in body axes, e the direction that its coefficient stands
for, so about a point from which the old one lies at d the moment coefficients take d x e c / length
more.  Every force term does so by itself: increments, controls and derivatives with respect to
rates as well, whatever multiplies them.  In stability axes e turns with alpha and in wind axes with
alpha and beta; what a table cannot follow between its breakpoints is bounded, and breakpoints are
put in until the bound holds:

    |f - multilinear| <= h^2/8 max|f''|,   |f''| <= (2 |T'| + |T|) R,   R = |d| / length, T the table of the force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.store.effects import Effect, rate_shift
from aerodb.store.grids import (
    add_leaves,
    factor_axes,
    fold_factors,
    merge_breakpoints,
    regrid_leaf,
    same_factors,
    union_axes,
    value_breakpoints,
    with_table,
    without_formula,
)
from aerodb.store.schema import FORCE_AXES, terms
from aerodb.store.undo_history import (
    add_history_line,
    last_edit,
    note_suffix,
    record_edit,
    undo_edits,
    update_absent,
)
from flightmech import terms as _terms
from flightmech.errors import SchemaError

_MOMENTS = ("Cl", "Cm", "Cn")
_LENGTHS = {"Cl": "b", "Cm": "cbar", "Cn": "b"}
_KEYS = ("x_ref", "y_ref", "z_ref")
_FULL = np.array([-0.5 * np.pi, 0.5 * np.pi])  # range of an angle that no table of the database has
_VERB = "move_reference"


def move_reference(
    db: xr.DataTree,
    point: Sequence[float],
    *,
    tolerance: float = 1e-3,
    flow: str = "kept",
    note: str = "",
) -> xr.DataTree:
    """Return a database with its moments about another point.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    point : (3,)
        The new moment reference point from the drawing datum: x forward, y right, z down, as
        ``x_ref y_ref z_ref``. [m]
    tolerance : float
        How far the moment that a force term adds may be off between breakpoints, as a share of what
        the largest force of its kind (same coefficient, same regressors) can have as moment about
        the new point.  At breakpoints it is exact.
    flow : {"kept", "moved"}
        Whether V, alpha and beta still mean what they meant, those at the c.g. (a pure change of
        moments; a simulation of the same aeroplane is not changed by it), or from now on those at
        the new point, as `from_datcom` understands them.  Then the derivatives by ``qhat``,
        ``phat`` and ``rhat`` also take what `aerodb.store.effects.rate_shift` gives for the terms
        ``basic`` and ``beta``.
    note : str, optional
        Why, for the history.

    Returns
    -------
    DataTree
        Moments of a force term go to the term of the same name of Cl, Cm, Cn; where there is none
        it is made, and where its regressors differ a term with ``_moved`` behind its name.
        Standard errors of force and moment count as independent.  The breakpoints of ``h_agl`` move
        by the change in height of the point on a level aeroplane.  Hinge moments stay.

    Raises
    ------
    SchemaError
        A point that is not three finite numbers, a table that would have too many axes, a power of
        the height over the runway when the point changes its height, an unknown `flow`, or
        ``"moved"`` with other than stability axes, or out of the plane of symmetry.

    Notes
    -----
    A move right after others starts from the tables before them, as long as they are kept: moves do not pile up breakpoints and standard
    errors, and a move back restores the tables to the last bit.  The aircraft file must name the same point, and all its
    positions count from there.
    """
    new, old = _checked(db, point, tolerance, flow), _point(db)
    base = _before_moves(db, flow)
    d, leaves = _point(base) - new, terms(base)
    summary = (
        f"from ({_metres(old)}) to ({_metres(new)}) "
        f"m{', flow angles with it' if flow == 'moved' else ''}"
    )
    _demand_countable(leaves, float(d[2]))
    if d.any():
        whole = _moved(leaves, base.attrs, d, tolerance)
        if flow == "moved":
            whole = _with_rates(whole, base.attrs, d)
        whole = {name: _raised(leaf, float(d[2])) for name, leaf in whole.items()}
        line = f"{_VERB}: {summary}{note_suffix(note)}"
        leaves = {
            name: leaf if leaf is leaves.get(name) else add_history_line(leaf, line)
            for name, leaf in whole.items()
        }
    place = {key: base.attrs[key] for key in ("absent",) if key in base.attrs} | update_absent(
        base, without=leaves
    )
    return record_edit(
        db, leaves, _VERB, summary, note, place | dict(zip(_KEYS, map(float, new))), flow=flow
    )


def _before_moves(db: xr.DataTree, flow: str) -> xr.DataTree:
    """Return a database before the moves of the same kind that were its last edits."""
    while last_edit(db).get("verb") == _VERB and last_edit(db)["flow"] == flow:
        db = undo_edits(db)
    return db


def _checked(db: xr.DataTree, point: Sequence[float], tolerance: float, flow: str) -> np.ndarray:
    new = np.asarray(point, float)
    problems = []
    if new.shape != (3,) or not np.isfinite(new).all():
        problems.append(
            f"point is {point!r}; give x, y, z from the drawing datum, three finite numbers in m"
        )
    if not 0.0 < tolerance < 1.0:
        problems.append(
            f"tolerance is {tolerance!r}; give a share of the moment between 0 and 1, such as 1e-3"
        )
    if flow not in ("kept", "moved"):
        problems.append(f"flow is {flow!r}; allowed: kept, moved")
    if flow == "moved" and db.attrs["force_axes"] != "stability":
        problems.append(
            f"flow='moved' is for force axes 'stability', the database has "
            f"{db.attrs['force_axes']!r}"
        )
    if flow == "moved" and not problems and new[1] != _point(db)[1]:
        problems.append(
            "flow='moved' is for points in one plane parallel to that of symmetry; keep y"
        )
    if problems:
        raise SchemaError(_VERB, problems)
    return new


def _moved(
    leaves: Mapping[str, xr.Dataset], root: Mapping, d: np.ndarray, tolerance: float
) -> dict[str, xr.Dataset]:
    """Return all terms with the moments of the forces about the new point."""
    axes = str(root["force_axes"])
    reach = {angle: _reach(leaves, angle) for angle in ("alpha", "beta")}
    largest: dict[tuple, float] = {}
    for name, leaf in leaves.items():
        largest[_kind(name, leaf)] = max(largest.get(_kind(name, leaf), 0.0), _size(leaf))
    new, problems = dict(leaves), []
    for name, leaf in leaves.items():
        force, contribution = name.split("/")
        if force not in FORCE_AXES[axes][:3]:
            continue
        allowed = tolerance * largest[_kind(name, leaf)]
        for moment in _MOMENTS:
            try:
                more = _moment(
                    leaf, axes, force, moment, d / float(root[_LENGTHS[moment]]), reach, allowed
                )
                if more is not None:
                    _put(
                        new,
                        moment,
                        contribution,
                        more.assign_attrs(
                            comment=f"moment of {name} about the moment reference point"
                        ),
                    )
            except SchemaError as error:
                problems += [f"{moment} of {name}: {fault}" for fault in error.problems]
    if problems:
        raise SchemaError(_VERB, problems)
    return new


def _moment(
    leaf: xr.Dataset,
    axes: str,
    force: str,
    moment: str,
    arm: np.ndarray,
    reach: Mapping[str, np.ndarray],
    allowed: float,
) -> xr.Dataset | None:
    """Return what a force term adds to a moment coefficient, d / length being `arm`; None where it
    has no moment.

    Times the length of `arm`, `allowed` is how far it may be off between breakpoints.
    """
    angles = _angles(axes, force, moment, arm)
    if angles is None:
        return None
    if factor_axes(leaf) & set(angles):
        leaf = fold_factors(leaf)
    points = value_breakpoints(leaf)
    for angle in angles:
        if len(points.get(angle, ())) < 2:
            points[angle] = (
                merge_breakpoints(points[angle], reach[angle]) if angle in points else reach[angle]
            )
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "table",
            [f"would have the axes {' '.join(points)}; at most {_terms.MAX_AXES} are allowed"],
        )
    coarse = regrid_leaf(leaf, points)
    for angle in angles:
        points[angle] = _refined(coarse, angle, allowed / len(angles))
    force_there = regrid_leaf(leaf, points)
    mesh = dict(zip(points, np.meshgrid(*points.values(), indexing="ij"))) if points else {}
    times = _lever(axes, force, moment, arm, mesh.get("alpha", 0.0), mesh.get("beta", 0.0))
    stderr = force_there["stderr"].values * np.abs(times) if "stderr" in leaf else None
    source = force_there["source"].values if "source" in leaf else None
    return with_table(force_there, points, force_there["value"].values * times, stderr, source)


def _angles(axes: str, force: str, moment: str, arm: np.ndarray) -> list[str] | None:
    """Return the angles that the lever of a force coefficient depends on; None where it has no
    lever at all.
    """
    some = np.linspace(-1.5, 1.5, 7)
    lever = np.broadcast_to(_lever(axes, force, moment, arm, some[:, None], some), (7, 7))
    nothing = 1e-12 * float(np.linalg.norm(arm))
    if not (np.abs(lever) > nothing).any():
        return None
    return [
        angle
        for axis, angle in enumerate(("alpha", "beta"))
        if np.ptp(lever, axis=axis).max() > nothing
    ]


def _lever(axes: str, force: str, moment: str, arm: np.ndarray, alpha, beta) -> np.ndarray:
    """Return the component of arm x e, e the direction that a force coefficient stands for in body
    axes.
    """
    sa, ca = np.sin(alpha), np.cos(alpha)
    sb, cb = (np.sin(beta), np.cos(beta)) if axes == "wind" else (0.0, 1.0)
    e = {
        "CL": (sa, 0.0, -ca),
        "CD": (-ca * cb, -sb, -sa * cb),
        "CY": (-ca * sb, cb, -sa * sb),
        "CX": (1.0, 0.0, 0.0),
        "CZ": (0.0, 0.0, 1.0),
    }[force]
    i = _MOMENTS.index(moment)
    j, k = (i + 1) % 3, (i + 2) % 3
    return np.asarray(arm[j] * e[k] - arm[k] * e[j])


def _refined(leaf: xr.Dataset, angle: str, allowed: float) -> np.ndarray:
    """Return the breakpoints of an angle with as many put between them as the product with its
    sines needs.
    """
    own = leaf[angle].values
    T = np.moveaxis(leaf["value"].values, leaf["value"].dims.index(angle), -1).reshape(-1, len(own))
    factors = _size(leaf) / max(float(np.abs(T).max()), np.finfo(float).tiny)
    width = np.diff(own)
    slope = (np.abs(np.diff(T)) / width).max(axis=0)
    top = np.maximum(np.abs(T[:, 1:]), np.abs(T[:, :-1])).max(axis=0)
    curvature = factors * (2.0 * slope + top)
    parts = np.ceil(
        width
        * np.sqrt(
            np.divide(curvature, 8.0 * allowed, out=np.zeros_like(width), where=curvature > 0)
        )
    ).astype(int)
    cells = [np.linspace(a, b, max(n, 1), endpoint=False) for a, b, n in zip(own, own[1:], parts)]
    return np.concatenate([*cells, own[-1:]])


def _kind(name: str, leaf: xr.Dataset) -> tuple[str, ...]:
    """Return the key by which terms are compared: the coefficient and what multiplies the table."""
    return (name.split("/")[0], *_terms.list_multipliers(leaf))


def _size(leaf: xr.Dataset) -> float:
    """Return the largest value of table and factors together."""
    return float(
        np.prod([np.abs(leaf[key].values).max() for key in ("value", "K1", "K2") if key in leaf])
    )


def _put(leaves: dict[str, xr.Dataset], moment: str, contribution: str, more: xr.Dataset) -> None:
    """Add a leaf to the term of its name, or as a further term where the two cannot be one table."""
    name = f"{moment}/{contribution}"
    while name in leaves and not _joins(leaves[name], more):
        name += "_moved"
    leaves[name] = add_leaves(leaves[name], more) if name in leaves else more


def _joins(leaf: xr.Dataset, more: xr.Dataset) -> bool:
    if _terms.list_multipliers(leaf) != _terms.list_multipliers(more):
        return False
    axes = set(union_axes(leaf, more))
    return (
        len(axes if same_factors(leaf, more) else axes | factor_axes(leaf) | factor_axes(more))
        <= _terms.MAX_AXES
    )


def _with_rates(
    leaves: dict[str, xr.Dataset], root: Mapping, d: np.ndarray
) -> dict[str, xr.Dataset]:
    """Return all terms with what the flow angles at the new point add to the derivatives with
    respect to rates.
    """
    basic = _effect(leaves, "basic", ("CL", "CD", "Cm"), "")
    beta = _effect(leaves, "beta", ("CY", "Cl", "Cn"), "beta")
    if "alpha" not in getattr(basic.tables.get("CL"), "dims", ()):
        raise SchemaError(
            _VERB,
            ["flow='moved' needs the terms basic over alpha; without them keep the flow angles"],
        )
    new = dict(leaves)
    for rate, tables in rate_shift(
        basic, beta, tuple(d), float(root["cbar"]), float(root["b"])
    ).items():
        if not any(f"{coefficient}/{rate}" in leaves for coefficient in FORCE_AXES["stability"]):
            continue
        for coefficient, table in tables.items():
            origin = leaves[f"{coefficient}/{'basic' if rate == 'qhat' else 'beta'}"]
            _put(new, coefficient, rate, _as_leaf(table, origin, rate))
    return new


def _effect(
    leaves: Mapping[str, xr.Dataset], name: str, coefficients: Sequence[str], regressor: str
) -> Effect:
    """Return terms of one name as an effect, over their common breakpoints."""
    own = {c: fold_factors(leaves[f"{c}/{name}"]) for c in coefficients if f"{c}/{name}" in leaves}
    own = {
        c: leaf for c, leaf in own.items() if " ".join(_terms.list_multipliers(leaf)) == regressor
    }
    points = union_axes(*own.values()) if own else {}
    return Effect(
        name, {c: regrid_leaf(leaf, points)["value"] for c, leaf in own.items()}, regressor
    )


def _as_leaf(table: xr.DataArray, origin: xr.Dataset, rate: str) -> xr.Dataset:
    """Return a table that came from another one as a leaf: the same relative error, the same
    source.
    """
    points = {str(axis): table[axis].values for axis in table.dims}
    there = regrid_leaf(fold_factors(origin), points)
    stderr = None
    if "stderr" in there:
        share = np.sqrt(
            (there["stderr"].values ** 2).mean()
            / max((there["value"].values ** 2).mean(), np.finfo(float).tiny)
        )
        stderr = share * np.abs(table.values)
    source = there["source"].values if "source" in there else None
    leaf = with_table(
        there.drop_vars(["K1", "K2"], errors="ignore"), points, table.values, stderr, source
    )
    return leaf.assign_attrs(
        regressors=rate, comment="what the flow angles at the moment reference point add"
    )


def _demand_countable(leaves: Mapping[str, xr.Dataset], by: float) -> None:
    """Raise when a power of a height would have to be counted from another point: (h + c)^s is no
    h^s.
    """
    powers = {name: _terms.power_factor(leaf) for name, leaf in leaves.items()}
    problems = [
        f"{name}: the factor {power} cannot be counted from a point {by:.4g} m lower; "
        "make it a table first (aerodb.transform.with_height_table)"
        for name, power in powers.items()
        if power is not None and power.variable == "h_agl" and by != 0.0
    ]
    if problems:
        raise SchemaError(_VERB, problems)


def _raised(leaf: xr.Dataset, by: float) -> xr.Dataset:
    """Return a leaf with its heights over the runway counted from another point."""
    if "h_agl" not in leaf.coords or by == 0.0:
        return leaf
    attributes = leaf["h_agl"].attrs
    new = leaf.assign_coords(h_agl=leaf["h_agl"].values + by)
    new["h_agl"].attrs = attributes
    return without_formula(new)


def _reach(leaves: Mapping[str, xr.Dataset], angle: str) -> np.ndarray:
    """Return the range that the tables of a database have of an angle."""
    ends = [leaf[angle].values[[0, -1]] for leaf in leaves.values() if angle in leaf.coords]
    low, high = (np.min(ends), np.max(ends)) if ends else _FULL
    return np.array([low, high]) if high > low else _FULL


def _point(db: xr.DataTree) -> np.ndarray:
    return np.array([float(db.attrs[key]) for key in _KEYS])


def _metres(point: np.ndarray) -> str:
    return ", ".join(f"{x:.4f}" for x in point)
