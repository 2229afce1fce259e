"""Trees of cases and listings, and trees of program runs that differ in the deflection only.

`split_deck` makes one run per deflection; here their trees are put together.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import order_conditions, reference_quantities
from datcom_io.arrays.families import LEAVES
from datcom_io.arrays.leaves import empty_cells
from datcom_io.arrays.stacking import Stacker
from datcom_io.cells import ABSENT
from datcom_io.printout.content import PrintedCase


def case_tree(case: PrintedCase, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Case.to_datatree`."""
    # Reference quantities and the units of the cards are attributes of the case.
    root = xr.Dataset(attrs=_root_attrs(case))
    leaves = _stack_leaves(case, fill_transonic)
    return xr.DataTree.from_dict({"/": root, **leaves}, name=_node_name(case))


def listing_tree(
    cases: Iterable[PrintedCase], file: str, runs: int, *, fill_transonic: bool = False
) -> xr.DataTree:
    """Build the tree of `Listing.to_datatree`."""
    nodes = {"/": xr.Dataset(attrs={"file": file, "runs": runs})}
    for case in cases:
        leaves = _stack_leaves(case, fill_transonic)
        if not leaves:
            continue
        path = f"/{_node_name(case)}"
        if path in nodes:
            path = f"{path} ({case.ordinal})"
        nodes[path] = xr.Dataset(attrs=_root_attrs(case))
        for name, leaf in leaves.items():
            nodes[f"{path}/{name}"] = leaf
    return xr.DataTree.from_dict(nodes)


def _node_name(case: PrintedCase) -> str:
    """Return the name of a case as the name of a node: without slashes, and not dots alone."""
    if not case.name.strip("."):
        return f"case {case.ordinal}"
    return case.name.replace("/", "|")


def _stack_leaves(case: PrintedCase, fill_transonic: bool) -> dict[str, xr.Dataset]:
    """Return the leaves that the case has."""
    conditions, spots = order_conditions(case)
    stacker = Stacker(case, conditions, spots, fill_transonic)
    leaves = {}
    for name, stack in LEAVES.items():
        leaf = stack(stacker)
        if leaf is not None:
            leaves[name] = leaf.to_dataset()
    return leaves


def _root_attrs(case: PrintedCase) -> dict[str, str | float]:
    deck = case.deck
    return {
        **reference_quantities(case),
        "dim": deck.dim,
        "deriv": deck.deriv,
        "title": deck.caseid,
        "case": case.name,
        "file": case.file,
        "moment_centre": "x_cg aft and z_cg up from the drawing datum [m]",
        "messages": _join_messages(case),
    }


def _join_messages(case: PrintedCase) -> str:
    """Return the messages of a case, one line each; repeated ones once."""
    lines_by_text: dict[str, list[int]] = {}
    for message in case.messages:
        lines_by_text.setdefault(message.text, []).append(message.line)
    texts = []
    for text, lines in lines_by_text.items():
        repeats = ""
        if len(lines) > 1:
            repeats = f" and {len(lines) - 1} more"
        texts.append(f"line {lines[0]}{repeats}: {text}")
    return "\n".join(texts)


# Axes of deflection: static and downwash pages over ground have the first two, a symmetrical flap
# the last one.
AXES = ("delta_f", "delta_e", "delta")
_DIGITS = 9  # of a deflection in radians that distinguish it


def join_attributes(trees: Sequence[xr.DataTree]) -> dict[str, Any]:
    """Return the attributes of the first tree, with the texts of all trees, each once."""
    attrs: dict[str, Any] = {str(key): value for key, value in trees[0].attrs.items()}
    for key, separator in (("title", "; "), ("case", "; "), ("file", "; "), ("messages", "\n")):
        texts = [str(tree.attrs[key]) for tree in trees if tree.attrs.get(key)]
        attrs[key] = separator.join(dict.fromkeys(texts))
    return attrs


def over_deflections(trees: Sequence[xr.DataTree]) -> list[xr.DataTree]:
    """Return the trees, with those of one flap and the same flight conditions put together.

    Trees that are put together have other deflections of the flap; the other trees are returned as
    they are.  A leaf that has no axis of deflection is taken from the first tree.
    """
    groups: dict[Hashable, list[xr.DataTree]] = {}
    seen: set[tuple[Hashable, float]] = set()
    for number, tree in enumerate(trees):
        kind, deflections = _flap_of(tree)
        places = {(kind, delta) for delta in deflections}
        # Without a flap, or with a deflection that another tree gives, a tree stays alone.
        if kind is None or places & seen:
            kind = number
        seen |= places
        groups.setdefault(kind, []).append(tree)
    joined = []
    for group in groups.values():
        if len(group) > 1:
            joined.append(_join_deflections(group))
        else:
            joined.append(group[0])
    return joined


def _flap_of(tree: xr.DataTree) -> tuple[Hashable, list[float]]:
    """Return what identifies the flap and the flight conditions of a tree, and its deflections.

    The first item is None without a symmetrical flap.
    """
    if "symflp" not in tree.children:
        return None, []
    leaf = tree.children["symflp"].to_dataset(inherit=False)
    conditions = zip(leaf["mach"].values.tolist(), leaf["h"].values.tolist())
    # Leaves, surface and device, and the pairs of Mach number and altitude.
    kind = (tuple(sorted(tree.children)), tuple(sorted(leaf.attrs.items())), tuple(conditions))
    return kind, np.round(leaf["delta"].values, _DIGITS).tolist()


def _join_deflections(trees: list[xr.DataTree]) -> xr.DataTree:
    """Return one tree over the deflections of all trees."""
    leaves = {}
    for name in trees[0].children:
        parts = [tree.children[name].to_dataset(inherit=False) for tree in trees]
        axes = [axis for axis in AXES if axis in parts[0].coords]
        if axes:
            leaves[str(name)] = _join_parts(parts, axes[0])
        else:
            leaves[str(name)] = parts[0]
    root = xr.Dataset(attrs=join_attributes(trees))
    return xr.DataTree.from_dict({"/": root, **leaves})


def _join_parts(parts: list[xr.Dataset], axis: str) -> xr.Dataset:
    """Return one leaf over all deflections, NaN and ``absent`` where no part gives a number."""
    first = parts[0]
    # Rounded, because runs may print the same deflection with different last bits.
    deltas = np.concatenate([np.atleast_1d(part[axis].values) for part in parts])
    rounded, indices = np.unique(np.round(deltas, _DIGITS), return_index=True)
    count = len(rounded)
    if count == 1 and axis not in first.dims:
        return first
    # Index of the deflections of each part along the joined axis.
    places = []
    for part in parts:
        part_deltas = np.round(np.atleast_1d(part[axis].values), _DIGITS)
        places.append(np.searchsorted(rounded, part_deltas))
    joined = xr.Variable(axis, deltas[indices], first[axis].attrs)
    variables: dict[str, xr.Variable] = {axis: joined}
    for name in map(str, first.variables):
        if name == axis or name.endswith("_flag"):
            continue
        items = [_with_deflection(part, name, axis) for part in parts]
        if axis not in items[0].dims:
            # Texts that name the origin of a leaf are those of all parts.
            if items[0].dtype.kind == "U" and name in first.coords:
                variables[name] = _join_texts(items)
            else:
                variables[name] = items[0]
        elif f"{name}_flag" in first:
            flags = [_with_deflection(part, f"{name}_flag", axis) for part in parts]
            value, flag = _join_numbers(items, flags, places, count=count, axis=axis)
            variables[name], variables[f"{name}_flag"] = value, flag
        else:
            variables[name] = _spread_texts(items, places, count=count, axis=axis)
    # What was a coordinate in the parts stays one.
    coords = {}
    for name in list(variables):
        if name in first.coords or name == axis:
            coords[name] = variables.pop(name)
    return xr.Dataset(variables, coords, first.attrs)


def _with_deflection(part: xr.Dataset, name: str, axis: str) -> xr.Variable:
    """Return a variable with the deflection as a dimension, before the angle of attack.

    Only tables and the places of tables get the dimension.
    """
    variable = part.variables[name]
    is_table = name in ("lines", "notes") or ("alpha" in variable.dims and name != "alpha")
    if axis in variable.dims or axis in part.dims or not is_table:
        return variable
    k = variable.ndim
    if "alpha" in variable.dims:
        k = variable.dims.index("alpha")
    dims = (*variable.dims[:k], axis, *variable.dims[k:])
    return xr.Variable(dims, np.expand_dims(variable.values, k), variable.attrs)


def _join_numbers(
    items: list[xr.Variable],
    flags: list[xr.Variable],
    places: list[np.ndarray],
    *,
    count: int,
    axis: str,
) -> tuple[xr.Variable, xr.Variable]:
    """Return values and flags over all deflections.

    Of several cells for one place the first printed one counts.
    """
    first = items[0]
    k = first.dims.index(axis)
    value, flag = empty_cells((*first.shape[:k], count, *first.shape[k + 1 :]))
    for item, codes, positions in zip(items, flags, places):
        # The deflection is dimension k of the variable.
        index = (slice(None),) * k + (positions,)
        missing = flag[index] == ABSENT
        value[index] = np.where(missing, item.values, value[index])
        flag[index] = np.where(missing, codes.values, flag[index])
    values = xr.Variable(first.dims, value, first.attrs)
    return values, xr.Variable(first.dims, flag, flags[0].attrs)


def _spread_texts(
    items: list[xr.Variable], places: list[np.ndarray], *, count: int, axis: str
) -> xr.Variable:
    """Return texts over all deflections, empty where no part gives one, joined where several do."""
    k = items[0].dims.index(axis)
    spread = []
    for item, positions in zip(items, places):
        texts = np.full((*item.shape[:k], count, *item.shape[k + 1 :]), "", dtype=object)
        texts[(slice(None),) * k + (positions,)] = item.values
        spread.append(xr.Variable(item.dims, texts, item.attrs))
    return _join_texts(spread)


def _join_texts(items: list[xr.Variable]) -> xr.Variable:
    """Return the different texts of each place, joined."""
    joined = []
    # Places that several runs fill have the texts of all of them.
    for texts in zip(*(item.values.ravel() for item in items)):
        joined.append(", ".join(dict.fromkeys(filter(None, texts))))
    array = np.array(joined, dtype=str).reshape(items[0].shape)
    return xr.Variable(items[0].dims, array, items[0].attrs)
