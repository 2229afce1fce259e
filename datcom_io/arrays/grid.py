"""Joining trees of several runs along flight condition and deflection, and unfolding conditions to
a grid of altitude and Mach number.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

import numpy as np
import xarray as xr

from datcom_io.arrays.trees import over_deflections
from datcom_io.cells import ABSENT
from flightmech.errors import SchemaError

_REFERENCE = ("S", "cbar", "b", "x_cg", "z_cg")


def join(trees: Iterable[xr.DataTree]) -> xr.DataTree:
    """Return one tree holding the conditions and deflections of several.

    Parameters
    ----------
    trees : iterable of DataTree
        As `Case.to_datatree` returns them: the same tables at other flight conditions, or for other
        deflections of the same symmetrical flap at the same conditions, for example one program run
        per Mach number and deflection.

    Returns
    -------
    DataTree
        Every group that occurs in any tree, over all deflections and concatenated along
        ``condition``; the coordinates ``lines``, ``case`` and ``file`` give where each condition
        comes from.  Airfoil sections go along ``mach``; what belongs to no condition must be the
        same in all.

    Raises
    ------
    SchemaError
        No tree, different reference quantities, or leaves whose other axes differ.

    Examples
    --------
    >>> tree = join(case.to_datatree() for case in listing)        # doctest: +SKIP
    """
    trees = over_deflections(list(trees))
    if not trees:
        raise SchemaError("join", ["no tree was given; pass the trees of at least one case"])
    first = trees[0]
    problems = [
        f"{name} is {tree.attrs.get(name)} in {_title(tree)} and {first.attrs.get(name)} in "
        f"{_title(first)}"
        for tree in trees[1:]
        for name in _REFERENCE
        if not _same(tree.attrs.get(name), first.attrs.get(name))
    ]
    names = dict.fromkeys(name for tree in trees for name in tree.children)
    leaves = {}
    for name in names:
        parts = [
            (tree, tree.children[name].to_dataset(inherit=False))
            for tree in trees
            if name in tree.children
        ]
        faults = [
            fault
            for tree, part in parts[1:]
            for fault in _differences(name, tree, part, parts[0][1])
        ]
        problems += faults
        if not faults:
            leaves[name] = _concatenate([part for _, part in parts])
    if problems:
        raise SchemaError("these trees cannot be joined", problems)
    root = dict(first.attrs)
    for key in ("title", "case", "file", "messages"):
        root[key] = ("\n" if key == "messages" else "; ").join(
            dict.fromkeys(str(tree.attrs[key]) for tree in trees if tree.attrs.get(key))
        )
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **leaves})


def _title(tree: xr.DataTree) -> str:
    return f"{tree.attrs.get('file')}: {tree.attrs.get('case')}"


def _same(a, b) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9) or (math.isnan(a) and math.isnan(b))
    return a == b


def _differences(name: str, tree: xr.DataTree, part: xr.Dataset, first: xr.Dataset) -> list[str]:
    """Return what differs other than along the joined dimension."""
    found = []
    if set(part.dims) != set(first.dims):
        return [
            f"{name} of {_title(tree)} has the axes {', '.join(map(str, part.dims))}, the "
            f"first tree {', '.join(map(str, first.dims))}"
        ]
    if set(part.data_vars) != set(first.data_vars):
        other = sorted(map(str, set(part.data_vars) ^ set(first.data_vars)))
        found.append(f"{name} of {_title(tree)}: {', '.join(other)} not in all trees")
    for key in _fixed(first):
        item, other_item = first[key], part.get(key)
        if other_item is None and key not in first.coords:
            continue
        if (
            other_item is None
            or other_item.shape != item.shape
            or not _equal(*_in_both(key, first, part))
        ):
            found.append(f"{name} of {_title(tree)}: {key} differs from that of the first tree")
    return found


def _joined_dimension(part: xr.Dataset) -> str:
    """Return the dimension along which a leaf is joined, empty for one that must be the same in all
    trees.
    """
    return next((name for name in ("condition", "mach") if name in part.dims), "")


def _fixed(part: xr.Dataset) -> list[str]:
    """Return variables and coordinates that do not go along the joined dimension, without flags and
    lines.
    """
    along = _joined_dimension(part)
    return [
        str(key)
        for key, item in part.variables.items()
        if along not in item.dims and key != "lines" and not str(key).endswith("_flag")
    ]


def _in_both(key: str, first: xr.Dataset, part: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of a variable where both trees print it."""
    a, b = first[key].values, part[key].values
    flag = f"{key}_flag"
    if flag not in first or flag not in part or first[flag].shape != part[flag].shape:
        return a, b
    there = (first[flag].values != ABSENT) & (part[flag].values != ABSENT)
    return a[there], b[there]


def _equal(a: np.ndarray, b: np.ndarray) -> bool:
    return (
        bool(np.allclose(a, b, rtol=0.0, atol=1e-9, equal_nan=True))
        if a.dtype.kind == "f"
        else bool((a == b).all())
    )


def _concatenate(parts: list[xr.Dataset]) -> xr.Dataset:
    along = _joined_dimension(parts[0])
    first = _completed(parts)
    if not along:
        return first
    joined = xr.concat(
        [first, *parts[1:]],
        along,
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="override",
        combine_attrs="drop_conflicts",
    )
    return (
        joined.assign_coords(condition=np.arange(joined.sizes["condition"]))
        if along == "condition"
        else joined
    )


def _completed(parts: list[xr.Dataset]) -> xr.Dataset:
    """Return the first part, with the values that belong to no condition and that only others
    print.
    """
    first = parts[0].copy()
    for key in _fixed(first):
        flag = f"{key}_flag"
        if flag not in first:
            continue
        values, flags = first[key].values.copy(), first[flag].values.copy()
        for part in parts[1:]:
            missing = flags == ABSENT
            values[missing], flags[missing] = part[key].values[missing], part[flag].values[missing]
        first[key], first[flag] = first[key].copy(data=values), first[flag].copy(data=flags)
    return first


def to_grid(dataset: xr.Dataset) -> xr.Dataset:
    """Unfold ``condition`` into ``h`` and ``mach``, both rising.

    Parameters
    ----------
    dataset : Dataset
        A leaf with the dimension ``condition`` and its coordinates ``h`` [m] and ``mach`` [1].

    Returns
    -------
    Dataset
        Dimensions ``h`` and ``mach`` instead of ``condition``; ``V``, ``p_static`` and the other
        coordinates of a condition over both.

    Raises
    ------
    SchemaError
        The pairs do not fill a grid, or one occurs twice.
    """
    if "condition" not in dataset.dims:
        raise SchemaError(
            "to_grid",
            [
                f"the Dataset has no dimension condition (it has "
                f"{', '.join(map(str, dataset.dims))})"
            ],
        )
    heights, machs = dataset["h"].values, dataset["mach"].values
    pairs = Counter(zip(heights.tolist(), machs.tolist()))
    problems = [
        f"Mach {mach:g} at {h:g} m occurs {count} times; select one"
        for (h, mach), count in pairs.items()
        if count > 1
    ]
    if np.isnan(heights).any() or np.isnan(machs).any():
        problems.append("a condition has no altitude or no Mach number")
    else:
        problems += [
            f"Mach {m:g} at {h:g} m is missing"
            for h in np.unique(heights)
            for m in np.unique(machs)
            if (h, m) not in pairs
        ]
    if problems:
        raise SchemaError("the conditions do not fill a grid of h and mach", problems)
    h_axis, mach_axis = np.unique(heights), np.unique(machs)
    order = np.lexsort((machs, heights))
    ordered = dataset.isel(condition=order).drop_vars(["condition", "h", "mach"])
    shape = (len(h_axis), len(mach_axis))
    grid = {}
    for name, item in ordered.variables.items():
        if "condition" not in item.dims:
            grid[name] = item
            continue
        at = item.dims.index("condition")
        dims = (*item.dims[:at], "h", "mach", *item.dims[at + 1 :])
        grid[name] = xr.Variable(
            dims, item.values.reshape(*item.shape[:at], *shape, *item.shape[at + 1 :]), item.attrs
        )
    grid["h"] = xr.Variable("h", h_axis, dataset["h"].attrs)
    grid["mach"] = xr.Variable("mach", mach_axis, dataset["mach"].attrs)
    names = {*ordered.coords, "h", "mach"}
    return xr.Dataset(
        {k: v for k, v in grid.items() if k not in names},
        {k: v for k, v in grid.items() if k in names},
        dataset.attrs,
    )
