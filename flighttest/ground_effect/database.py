"""Identified ground effect as terms of a database, in the place of the handbook's.

Each identified factor multiplies the terms of the database in free air to which it belongs, so that flaps, Mach number and
gear have their share: (1 + k h^s) of ``1`` and ``alpha`` the tables over angle of attack, split at zero; of ``qhat`` the
rates of pitch and of angle of attack, which one estimate holds; of a control its tables.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.names import attrs

from .result import CoefficientOverGround, GroundEffect
from .structure import BANK, HEIGHT

_CONFIGURATION = {"gear", "speedbrake", "delta_f", "delta_f_left", "delta_f_right", "i_h", "mach", "h", "alpha", "CT", "qbar", "x_cg"}
_TOGETHER = {"alphadothat": "qhat"}  # estimated in one


def replace_ground_effect(database: xr.DataTree, found: GroundEffect, tables: bool = False) -> xr.DataTree:
    """Return a database with the identified ground effect in the place of the terms over height that it had.

    Parameters
    ----------
    database : DataTree
        With the terms in free air; it is left as it is.
    found : GroundEffect
        Coefficients whose evidence chose ``database`` or ``none`` keep what they have.
    tables : bool
        Write factors K(h) in place of the closed form k h^s, for exports that take no formula.

    Returns
    -------
    DataTree

    Raises
    ------
    SchemaError
        A factor to which no term of the database belongs, or a term without room for it.
    """
    from aerodb import delete_terms, replace_terms
    from aerodb.store.schema import terms

    new: dict[str, xr.Dataset] = {}
    old: list[str] = []
    for name, one in found.coefficients.items():
        if one.form in ("none", "database"):
            continue
        old += [term for term, leaf in terms(database).items() if term.startswith(f"{name}/") and HEIGHT in _terms.variables(leaf)]
        new |= {f"{name}/{contribution}": leaf for contribution, leaf in ground_terms_of(one, database, tables).items()}
    note = "ground effect identified from flight"
    gone = [term for term in old if term not in new]
    left = delete_terms(database, gone, note) if gone else database
    return replace_terms(left, new, note) if new else left


def ground_terms_of(one: CoefficientOverGround, database: xr.DataTree, tables: bool = False) -> dict[str, xr.Dataset]:
    """Return the terms of one coefficient over the ground by contribution, in the form that the evidence chose.

    Parameters
    ----------
    one : CoefficientOverGround
    database : DataTree
        With the terms in free air.
    tables : bool
        K(h) in place of k h^s.

    Returns
    -------
    dict of str to Dataset
        ``ground_<term in free air>``, of a part of it ``ground_<term>_alpha``; ``ground`` for the rolling moment of bank.
    """
    from aerodb.store.schema import terms
    from aerodb.update.posterior import without_posterior

    name = one.model.coefficient
    free = {  # a multiple of a table is not one more table that was estimated with it
        term.partition("/")[2]: without_posterior(leaf)
        for term, leaf in terms(database).items()
        if term.startswith(f"{name}/") and HEIGHT not in _terms.variables(leaf)
    }
    found: dict[str, xr.Dataset] = {}
    for term in one.table.terms if one.form == "table" and one.table is not None else one.ground:
        parts = {"ground": _terms.make(1.0, regressors=("CL", "phi"))} if term == BANK else dict(_parts(term, free))
        if not parts:
            raise SchemaError("ground effect", [f"{name}: no term of the database in free air belongs to {term}; it has {' '.join(free)}"])
        found |= {label: _over_ground(leaf, one, term, tables) for label, leaf in parts.items()}
    return found


def _parts(term: str, free: dict[str, xr.Dataset]) -> Iterator[tuple[str, xr.Dataset]]:
    """Terms in free air, or parts of them, that a term of the local model stands for."""
    for name, leaf in free.items():
        variables = _terms.variables(leaf)
        movers = sorted({_TOGETHER.get(v, v) for v in variables - _CONFIGURATION})
        if movers:
            if "*".join(movers) == term:
                yield f"ground_{name}", leaf
            continue
        sloped = "alpha" in _terms.regressors(leaf)
        if term == "1" and not sloped:
            yield f"ground_{name}", _at_zero(leaf)
        if term == "alpha" and (sloped or "alpha" in variables):
            yield f"ground_{name}_alpha", leaf if sloped else _beyond_zero(leaf)


def _at_zero(leaf: xr.Dataset) -> xr.Dataset:
    """A term at zero angle of attack."""
    if "alpha" not in leaf["value"].dims:
        return leaf
    at = float(np.clip(0.0, leaf["alpha"].values[0], leaf["alpha"].values[-1]))
    kept = leaf.drop_vars("source", errors="ignore")
    found = kept.interp(alpha=at).drop_vars("alpha")
    return found.assign({name: found[name].astype(float) for name in found.data_vars})


def _beyond_zero(leaf: xr.Dataset) -> xr.Dataset:
    """A term less its value at zero angle of attack."""
    if "alpha" not in leaf["value"].dims:
        raise SchemaError("ground effect", ["alpha is an axis of a factor K1 or K2; multiply it into the table first"])
    found = leaf.drop_vars("source", errors="ignore").copy()
    found["value"] = (leaf["value"] - _at_zero(leaf)["value"]).transpose(*leaf["value"].dims)
    return found


def _over_ground(leaf: xr.Dataset, one: CoefficientOverGround, term: str, tables: bool) -> xr.Dataset:
    """A term in free air times its factor over the ground, as a power of the height or as a table over it."""
    floor, top = one.heights
    if one.form == "table":
        heights, K, stderr = one.tabled(term)
        leaf = _with_factor(leaf, heights, K)
        share = _share(K, stderr)
    else:
        from aerodb.transform import in_ground_effect, with_height_table

        common = one.form == "k h^s, one s"
        row = one.row(term, common)
        at_floor = one.factor(term, [floor], common)
        share = _share(at_floor["K"].values, at_floor["stderr"].values)
        leaf = in_ground_effect(leaf, row.k, row.s, floor)
        leaf = with_height_table(leaf, top) if tables else leaf
    own = leaf["stderr"].values if "stderr" in leaf else 0.0
    size = leaf["value"].values * float(np.abs(leaf["K1"].values).max() if "K1" in leaf and HEIGHT in leaf["K1"].dims else 1.0)
    leaf = leaf.assign(stderr=(leaf["value"].dims, np.hypot(own, share * np.abs(size))))
    leaf = leaf.assign(source=(leaf["value"].dims, np.full(leaf["value"].shape, _terms.SOURCES.index("flight"), np.uint8)))
    leaf["source"].attrs = dict(_terms.SOURCE_ATTRS)
    return leaf.assign_attrs(references="[LR743] eq. (14)" if term == BANK else "[LR743] eq. (13)", comment=_comment(one, term))


def _share(K: np.ndarray, stderr: np.ndarray) -> float:
    """Relative standard error of a factor where it is largest."""
    at = int(np.argmax(np.abs(K)))
    return float(stderr[at] / abs(K[at])) if K[at] else 0.0


def _with_factor(leaf: xr.Dataset, heights: np.ndarray, K: np.ndarray) -> xr.Dataset:
    """A term times a table over the height."""
    name = next((key for key in ("K1", "K2") if key not in leaf), None)
    if name is None:
        raise SchemaError("ground effect", ["a term with two factors has no room for one over the height"])
    return leaf.assign({name: xr.DataArray(K, {HEIGHT: (HEIGHT, heights, attrs(HEIGHT))}, HEIGHT)})


def _comment(one: CoefficientOverGround, term: str) -> str:
    note = f"identified from {one.heights[0]:.3g} m up, form: {one.form}"
    if one.form == "table":
        return note
    row = one.row(term, one.form == "k h^s, one s")
    return f"{note}; k {row.k:.4g} ({row.k_stderr:.2g}), s {row.s:.4g} ({row.s_stderr:.2g}), correlation {row.correlation:.2f}, h in metres"
