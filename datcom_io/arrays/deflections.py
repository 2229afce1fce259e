"""Putting together the trees of program runs that differ in the deflection only: one run per deflection, as `split_deck` makes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from ..cells import ABSENT

AXES = ("delta_f", "delta_e", "delta")  # of static and downwash pages over ground, and of symmetrical flaps
_NEAR = 1e-9  # [rad]


def over_deflections(trees: Sequence[xr.DataTree]) -> list[xr.DataTree]:
    """Return the trees with those of the same flap and flight conditions and other deflections put together; others as they are.

    A leaf that has no axis of deflection is taken from the first tree.
    """
    groups: list[list[xr.DataTree]] = []
    for tree in trees:
        group = next((group for group in groups if _extends(tree, group)), None)
        if group is None:
            groups.append([tree])
        else:
            group.append(tree)
    return [_together(group) if len(group) > 1 else group[0] for group in groups]


def _extends(tree: xr.DataTree, group: list[xr.DataTree]) -> bool:
    """Return whether a tree gives the conditions and the kind of flap of a group, and only deflections that none of the group gives."""
    if set(tree.children) != set(group[0].children) or "symflp" not in tree.children:
        return False
    own, first, *others = (part.children["symflp"].to_dataset(inherit=False) for part in (tree, *group))
    alike = own.attrs == first.attrs and _conditions(own) == _conditions(first)
    return alike and not any(_deflections(own) & _deflections(other) for other in (first, *others))


def _conditions(leaf: xr.Dataset) -> list[tuple[float, float]]:
    return list(zip(leaf["mach"].values.tolist(), leaf["h"].values.tolist()))


def _deflections(leaf: xr.Dataset) -> set[float]:
    return set(np.round(leaf["delta"].values, 9).tolist())


def _together(trees: list[xr.DataTree]) -> xr.DataTree:
    root = dict(trees[0].attrs)
    for key, between in (("title", "; "), ("case", "; "), ("file", "; "), ("messages", "\n")):
        root[key] = between.join(dict.fromkeys(str(tree.attrs[key]) for tree in trees if tree.attrs.get(key)))
    leaves = {}
    for name in trees[0].children:
        parts = [tree.children[name].to_dataset(inherit=False) for tree in trees]
        axis = next((axis for axis in AXES if axis in parts[0].coords), "")
        leaves[str(name)] = _merged(parts, axis) if axis else parts[0]
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **leaves})


def _merged(parts: list[xr.Dataset], axis: str) -> xr.Dataset:
    """Return one leaf over all deflections, NaN and ``absent`` where no part gives them."""
    every = np.concatenate([np.atleast_1d(part[axis].values) for part in parts])
    rising = np.sort(every)
    values = rising[np.concatenate([[True], np.diff(rising) > _NEAR])]
    if len(values) == 1 and axis not in parts[0].dims:
        return parts[0]
    first, *others = [_spread(part, axis, values) for part in parts]
    for other in others:
        first = _completed(first, other)
    return first


def _spread(part: xr.Dataset, axis: str, values: np.ndarray) -> xr.Dataset:
    """Return a leaf on more deflections than it gives."""
    part = part if axis in part.dims else _with_dimension(part, axis)
    fill = {
        name: np.uint8(ABSENT) if str(name).endswith("_flag") else "" if item.dtype.kind == "U" else np.nan
        for name, item in part.variables.items()
        if axis in item.dims and name != axis
    }
    return part.reindex({axis: values}, method="nearest", tolerance=_NEAR, fill_value=fill)


def _with_dimension(part: xr.Dataset, axis: str) -> xr.Dataset:
    """Return a leaf with its only deflection as a dimension of the tables and of what names their place, before the angle of attack."""
    wide = part.drop_vars(axis)
    for name in (name for name, item in part.variables.items() if name in ("lines", "notes") or ("alpha" in item.dims and name != "alpha")):
        item = part[name].variable
        at = item.dims.index("alpha") if "alpha" in item.dims else item.ndim
        wide[name] = xr.Variable((*item.dims[:at], axis, *item.dims[at:]), np.expand_dims(item.values, at), item.attrs)
    return wide.assign_coords({axis: (axis, [float(part[axis])], part[axis].attrs)})


def _completed(first: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Return the first leaf with the cells of another one where it has none."""
    first = first.copy()
    for name in (str(name) for name in first.data_vars if not str(name).endswith("_flag") and name in other):
        flag = f"{name}_flag"
        missing = first[flag].values == ABSENT
        for key in (name, flag):
            first[key] = first[key].copy(data=np.where(missing, other[key].transpose(*first[key].dims).values, first[key].values))
    for name in (str(name) for name, item in first.coords.items() if item.dtype.kind == "U" and name in other.coords):
        texts = zip(first[name].values.ravel(), other[name].transpose(*first[name].dims).values.ravel())
        joined = [", ".join(dict.fromkeys(text for text in pair if text)) for pair in texts]
        first[name] = first[name].copy(data=np.array(joined, dtype=str).reshape(first[name].shape))
    return first
