"""Ice as a difference of terms, which acts with the setting of the ice.

P is the clean table of a term, k the factor, d the offset and eta the setting (0 clean, 1 the ice
of the file):

    P_iced = P + eta [(k - 1) (P - P_0) + d],    P_0 = P(about), zero without `about`

The bracket becomes a term of its own, ``Cm/elevator_ice``, with `ICE` among its multipliers.  The
clean terms do not change, so that a flight with eta = 0 is that of the clean database.  Such a term
has a standard error, is estimated from flight, exchanged and proven as every other one.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from aerodb.edit.ice_direction import improvements
from aerodb.edit.ice_file import IceDifference, IceFile
from aerodb.store.grids import (
    add_leaves,
    is_within,
    node_text,
    regrid_leaf,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.store.overview import ORIGIN
from aerodb.store.schema import terms
from aerodb.store.undo_history import note_suffix, record_edit, update_absent
from aerodb.update.cautions.notices import with_notices
from flightmech import terms as _terms
from flightmech.aircraft.controls import ICE
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.units import DEGREE

SUFFIX = "_ice"
# Attributes of a clean term that its difference keeps: how its table contributes.
_RULES = ("regressors", "outside", "power", "exponent", "floor")


def add_ice(db: xr.DataTree, ice: IceFile, *, note: str = "") -> xr.DataTree:
    """Return a database with the differences of its terms by ice.

    Parameters
    ----------
    db : DataTree
        The clean database; it does not change.
    ice : IceFile
        Differences by term, from `read_ice`.
    note : str, optional
        Reason for the change; stored in the history.

    Returns
    -------
    DataTree
        With a term ``..._ice`` for each difference.  Its standard error is
        hypot(s_k |P - P_0|, |k - 1| s_P, s_d); its nodes have the source ``estimate``.  Its notice
        states the ice, its document, and the conditions for which it is valid.

    Raises
    ------
    UnknownName
        A difference of a term that the database does not have.
    SchemaError
        The database has ice, a term has no alpha axis for `about`, an offset acts where a term is
        zero by definition, an angle is beyond its range, or a term has too many multipliers or
        axes; all faults.

    Warns
    -----
    AeromatchWarning
        The ice improves the aeroplane: less drag, more lift, control power or damping.
    """
    leaves = terms(db)
    problems = []
    present = [name for name in leaves if name.endswith(SUFFIX)]
    if present:
        problems.append(
            f"{', '.join(present[:3])}: the database has ice already; give the clean database"
        )
    new: dict[str, xr.Dataset] = {}
    for name, difference in ice.terms.items():
        if name not in leaves:
            raise UnknownName(name, leaves, "term", f"ice: {ice.title}")
        try:
            new[name + SUFFIX] = _difference_leaf(leaves[name], difference, ice)
        except SchemaError as error:
            problems += [f"{name}: {fault}" for fault in error.problems]
    if problems:
        raise SchemaError("ice", problems)
    for text in _improvements(leaves, new):
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    notice = (
        f"ice: {', '.join(new)} hold a difference by ice ({ice.title}; {ice.reference}), which "
        f"acts with {ICE}; valid for {ice.valid}"
    )
    summary = f"{', '.join(new)}: {ice.title}; {ice.reference}; valid for {ice.valid}"
    line = f"ice: {ice.title}{note_suffix(note)}"
    leaves |= {name: leaf.assign_attrs(history=line) for name, leaf in new.items()}
    attributes = {**update_absent(db, without=new), **with_notices(db.attrs, [notice])}
    return record_edit(db, leaves, "ice", summary=summary, note=note, attributes=attributes)


def _improvements(leaves: Mapping[str, xr.Dataset], new: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield how differences of terms improve the aeroplane."""
    for name, leaf in new.items():
        clean = leaves[name.removesuffix(SUFFIX)]
        # an offset may have further axes
        points = union_axes(clean, leaf)
        whole, part = regrid_leaf(clean, points), regrid_leaf(leaf, points)
        order = whole["value"].dims
        change = part["value"].broadcast_like(whole["value"]).transpose(*order).values
        yield from improvements(name.removesuffix(SUFFIX), whole, whole["value"].values + change)


def _difference_leaf(clean: xr.Dataset, difference: IceDifference, ice: IceFile) -> xr.Dataset:
    """Return the term of a difference by ice."""
    parts = []
    if difference.factor is not None:
        parts.append(_factor_part(clean, difference))
    if difference.offset is not None:
        parts.append(_offset_part(clean, difference))
    leaf = parts[0]
    for part in parts[1:]:
        leaf = add_leaves(leaf, part)
    code = np.full(leaf["value"].shape, _terms.SOURCES.index("estimate"), np.uint8)
    leaf = leaf.assign(source=(leaf["value"].dims, code, _terms.source_attributes(code)))
    texts = {"references": ice.reference, "comment": f"{ice.title}; valid for {ice.valid}"}
    kept = {key: item for key, item in clean.attrs.items() if key in _RULES}
    leaf.attrs = {**kept, **texts, ORIGIN: ice.title}
    return _with_setting(leaf)


def _factor_part(clean: xr.Dataset, difference: IceDifference) -> xr.Dataset:
    """Return (k - 1) (P - P_0) with its standard error."""
    assert difference.factor is not None
    assert difference.factor_stderr is not None
    change = clean["value"].values
    if difference.about is not None:
        if "alpha" not in clean["value"].dims:
            raise SchemaError("ice", ["about needs a table over alpha; leave it out"])
        if not is_within(clean["alpha"].values, np.array([difference.about])).all():
            raise SchemaError("ice", ["about lies beyond the alpha of the table; give one within"])
        points = value_breakpoints(clean) | {"alpha": np.array([difference.about])}
        level = regrid_leaf(clean, points)["value"].values
        change = change - level
    # Errors of factor and table are independent.
    less = difference.factor - 1.0
    own = np.zeros_like(change)
    if "stderr" in clean:
        own = clean["stderr"].values
    stderr = np.hypot(difference.factor_stderr * np.abs(change), abs(less) * own)
    return _bare(clean, clean["value"].dims, less * change, stderr)


def _offset_part(clean: xr.Dataset, difference: IceDifference) -> xr.Dataset:
    """Return the offset as a table over its axis, with the factors of the clean term."""
    offset, stderr = difference.filled_offset()
    points = difference.breakpoints()
    for name, nodes in points.items():
        # 4 and 8 without a unit are radians, and no angle of an aeroplane's table
        if lookup(name).units == "rad" and np.abs(nodes).max() > np.pi / 2.0:
            largest = np.abs(nodes).max() / DEGREE
            raise SchemaError("ice", [f"{name} reaches {largest:.4g} deg; give it as '8 deg'"])
    leaf = _terms.make_term(offset, points, stderr=stderr, source="estimate")
    _demand_zeros(clean, leaf)
    if clean.attrs.get("outside", "hold") == "linear":
        held = {name: _with_flat_ends(name, nodes) for name, nodes in points.items()}
        leaf = regrid_leaf(leaf, held)
    factors = {key: clean[key] for key in ("K1", "K2") if key in clean}
    return leaf.assign(factors).assign_attrs(clean.attrs)


def _with_flat_ends(name: str, points: np.ndarray) -> np.ndarray:
    """Return breakpoints with one more beyond each end, where a held value is held again.

    A linear continuation then holds the end value, as nothing is known of the ice beyond it.  An
    axis of no angle that begins at zero, such as Mach number, is not extended below it.
    """
    ends = points[[0, -1]]
    distance = np.full(2, DEGREE) if lookup(name).units == "rad" else 0.5 * np.abs(ends)
    return np.unique(np.concatenate([points, ends + distance * [-1.0, 1.0]]))


def _demand_zeros(clean: xr.Dataset, offset: xr.Dataset) -> None:
    """Raise if an offset acts where the clean term is zero by definition, without its cause."""
    if "stderr" not in clean:
        return
    is_zero = (clean["value"].values == 0.0) & (clean["stderr"].values == 0.0)
    union = union_axes(clean, offset)
    zeros = with_table(clean, value_breakpoints(clean), value=is_zero.astype(float))
    # A node of the union is zero by definition if all surrounding clean nodes are.
    at_zero = regrid_leaf(zeros, union)["value"].values == 1.0
    there = regrid_leaf(offset, union)
    acts = (there["value"].values != 0.0) | (there["stderr"].values != 0.0)
    if (at_zero & acts).any():
        node = list(map(int, np.argwhere(at_zero & acts)[0]))
        raise SchemaError(
            "ice",
            [
                f"the offset acts at {node_text(union, node)}, where the term is zero by "
                f"definition; give a factor, or an offset over that axis which is zero there"
            ],
        )


def _bare(
    clean: xr.Dataset, dims: tuple[object, ...], value: np.ndarray, stderr: np.ndarray
) -> xr.Dataset:
    """Return a leaf of the clean term with another table, without a joint covariance."""
    names = [name for name in clean.data_vars if name in ("K1", "K2")]
    coords = {name: clean[name] for name in clean.coords}
    leaf = xr.Dataset({"value": (dims, value), "stderr": (dims, stderr)}, coords, clean.attrs)
    leaf["source"] = dims, np.full(value.shape, _terms.SOURCES.index("estimate"), np.uint8)
    return leaf.assign({name: clean[name] for name in names})


def _with_setting(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term that is multiplied by the setting of the ice.

    With two regressors already, the setting is a factor table from 0 to 1.
    """
    regressors = _terms.list_regressors(leaf)
    if len(regressors) < _terms.MAX_REGRESSORS:
        return leaf.assign_attrs(regressors=" ".join([*regressors, ICE]))
    for key in ("K1", "K2"):
        if key not in leaf:
            factor = xr.DataArray([0.0, 1.0], {ICE: [0.0, 1.0]}, ICE)
            return leaf.assign({key: factor})
    raise SchemaError("ice", ["the term has two regressors and two factors; fold one of them"])
