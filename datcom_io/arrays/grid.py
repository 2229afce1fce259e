"""Joining of trees along flight condition and deflection, and unfolding of conditions to a grid."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.trees import join_attributes, over_deflections
from datcom_io.cells import ABSENT
from flightmech.errors import SchemaError

_REFERENCE = ("S", "cbar", "b", "x_cg", "z_cg")


def join(trees: Iterable[xr.DataTree]) -> xr.DataTree:
    """Return one tree with the conditions and deflections of several trees.

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
        ``condition``; the coordinates ``lines``, ``case`` and ``file`` state the origin of each
        condition.  Airfoil sections go along ``mach``; numbers that belong to no condition must be
        the same in all trees.

    Raises
    ------
    SchemaError
        No tree, different reference quantities, or leaves whose other axes differ.

    Examples
    --------
    >>> tree = join(case.to_datatree() for case in listing)        # doctest: +SKIP
    """
    # Deflections first: runs at the same condition become one tree.
    trees = over_deflections(list(trees))
    if not trees:
        raise SchemaError("join", ["no tree was given; pass the trees of at least one case"])
    problems = _reference_problems(trees)
    # A dict keeps the order of the leaves.
    names: dict[str, None] = {}
    for tree in trees:
        names |= dict.fromkeys(tree.children)
    leaves = {}
    for name in names:
        # Not every tree has every leaf.
        sources = [tree for tree in trees if name in tree.children]
        parts = [tree.children[name].to_dataset(inherit=False) for tree in sources]
        differences = []
        for tree, part in zip(sources[1:], parts[1:]):
            differences += _list_differences(name, tree, part, parts[0])
        problems += differences
        if not differences:
            leaves[name] = _concatenate(parts)
    if problems:
        raise SchemaError("these trees cannot be joined", problems)
    attrs = join_attributes(trees)
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **leaves})


def _reference_problems(trees: Sequence[xr.DataTree]) -> list[str]:
    """Return the reference quantities that differ from those of the first tree."""
    first = trees[0]
    problems = []
    for tree in trees[1:]:
        for name in _REFERENCE:
            value, expected = tree.attrs.get(name), first.attrs.get(name)
            if not _is_same(value, expected):
                problems.append(
                    f"{name} is {value} in {_title(tree)} and {expected} in {_title(first)}"
                )
    return problems


def _title(tree: xr.DataTree) -> str:
    return f"{tree.attrs.get('file')}: {tree.attrs.get('case')}"


def _is_same(a: object, b: object) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        # Two quantities without a number count as equal.
        both_missing = math.isnan(a) and math.isnan(b)
        return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-9) or both_missing
    return a == b


def _list_differences(
    name: str, tree: xr.DataTree, part: xr.Dataset, first: xr.Dataset
) -> list[str]:
    """Return the differences of a leaf to the first one, other than along the joined dimension."""
    where = f"{name} of {_title(tree)}"
    if set(part.dims) != set(first.dims):
        axes = ", ".join(map(str, part.dims))
        first_axes = ", ".join(map(str, first.dims))
        return [f"{where} has the axes {axes}, the first tree {first_axes}"]
    differences = []
    if set(part.data_vars) != set(first.data_vars):
        names = sorted(map(str, set(part.data_vars) ^ set(first.data_vars)))
        differences.append(f"{where}: {', '.join(names)} not in all trees")
    for key in _fixed_variables(first):
        # A missing variable is reported above; a missing coordinate is not.
        if part.get(key) is None and key not in first.coords:
            continue
        if not _agrees(key, first, part):
            differences.append(f"{where}: {key} differs from that of the first tree")
    return differences


def _agrees(key: str, first: xr.Dataset, part: xr.Dataset) -> bool:
    """Return whether a variable has the same shape and values in two leaves."""
    if part.get(key) is None or part[key].shape != first[key].shape:
        return False
    return _is_equal(*_printed_in_both(key, first, part))


def _joined_dimension(part: xr.Dataset) -> str:
    """Return the dimension along which a leaf is joined.

    It is empty for a leaf that must be the same in all trees.
    """
    for name in ("condition", "mach"):
        if name in part.dims:
            return name
    return ""


def _fixed_variables(part: xr.Dataset) -> list[str]:
    """Return variables and coordinates that do not go along the joined dimension.

    Flags and lines are left out.
    """
    along = _joined_dimension(part)
    names = []
    for key, variable in part.variables.items():
        name = str(key)
        if along not in variable.dims and name != "lines" and not name.endswith("_flag"):
            names.append(name)
    return names


def _printed_in_both(
    key: str, first: xr.Dataset, part: xr.Dataset
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of a variable where both trees print it."""
    a, b = first[key].values, part[key].values
    flag = f"{key}_flag"
    if flag not in first or flag not in part or first[flag].shape != part[flag].shape:
        return a, b
    # A value that only one tree prints is not a difference.
    printed = (first[flag].values != ABSENT) & (part[flag].values != ABSENT)
    return a[printed], b[printed]


def _is_equal(a: np.ndarray, b: np.ndarray) -> bool:
    if a.dtype.kind == "f":
        return bool(np.allclose(a, b, rtol=0.0, atol=1e-9, equal_nan=True))
    return bool((a == b).all())


def _concatenate(parts: list[xr.Dataset]) -> xr.Dataset:
    """Return the parts of one leaf along the joined dimension."""
    along = _joined_dimension(parts[0])
    first = _complete_first(parts)
    if not along:
        return first
    # Variables without the dimension are equal, so those of the first part count.
    joined = xr.concat(
        [first, *parts[1:]],
        along,
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="override",
        combine_attrs="drop_conflicts",
    )
    if along == "condition":
        return joined.assign_coords(condition=np.arange(joined.sizes["condition"]))
    return joined


def _complete_first(parts: list[xr.Dataset]) -> xr.Dataset:
    """Return the first part, with fixed values that only other parts print."""
    first = parts[0]
    completed: dict[str, xr.Variable] = {}
    for key in _fixed_variables(first):
        flag = f"{key}_flag"
        # Without an absent value nothing is taken from another part.
        if flag not in first or not (first[flag].values == ABSENT).any():
            continue
        values, flags = first[key].values.copy(), first[flag].values.copy()
        for part in parts[1:]:
            missing = flags == ABSENT
            values[missing] = part[key].values[missing]
            flags[missing] = part[flag].values[missing]
        completed[key] = first.variables[key].copy(data=values)
        completed[flag] = first.variables[flag].copy(data=flags)
    return first.assign(completed)


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
        dims = ", ".join(map(str, dataset.dims))
        problem = f"the Dataset has no dimension condition (it has {dims})"
        raise SchemaError("to_grid", [problem])
    heights, machs = dataset["h"].values, dataset["mach"].values
    problems = _grid_problems(heights, machs)
    if problems:
        raise SchemaError("the conditions do not fill a grid of h and mach", problems)
    h_axis, mach_axis = np.unique(heights), np.unique(machs)
    # In the order of the grid, with Mach number in the inner loop, a reshape unfolds the axis.
    order = np.lexsort((machs, heights))
    ordered = dataset.isel(condition=order).drop_vars(["condition", "h", "mach"])
    variables, coords = {}, {}
    for name, variable in ordered.variables.items():
        unfolded = _unfold(variable, (len(h_axis), len(mach_axis)))
        if name in ordered.coords:
            coords[name] = unfolded
        else:
            variables[name] = unfolded
    coords["h"] = xr.Variable("h", h_axis, dataset["h"].attrs)
    coords["mach"] = xr.Variable("mach", mach_axis, dataset["mach"].attrs)
    return xr.Dataset(variables, coords, dataset.attrs)


def _grid_problems(heights: np.ndarray, machs: np.ndarray) -> list[str]:
    """Return the pairs of altitude and Mach number that occur twice or are missing."""
    pairs = Counter(zip(heights.tolist(), machs.tolist()))
    problems = []
    for (h, mach), count in pairs.items():
        if count > 1:
            problems.append(f"Mach {mach:g} at {h:g} m occurs {count} times; select one")
    if np.isnan(heights).any() or np.isnan(machs).any():
        problems.append("a condition has no altitude or no Mach number")
        return problems
    for h in np.unique(heights):
        for mach in np.unique(machs):
            if (h, mach) not in pairs:
                problems.append(f"Mach {mach:g} at {h:g} m is missing")
    return problems


def _unfold(variable: xr.Variable, shape: tuple[int, int]) -> xr.Variable:
    """Return a variable with the dimension ``condition`` reshaped to ``h`` and ``mach``."""
    if "condition" not in variable.dims:
        return variable
    k = variable.dims.index("condition")
    dims = (*variable.dims[:k], "h", "mach", *variable.dims[k + 1 :])
    sizes = (*variable.shape[:k], *shape, *variable.shape[k + 1 :])
    return xr.Variable(dims, variable.values.reshape(sizes), variable.attrs)
