"""Putting together the trees of program runs that differ in the deflection only: one run per
deflection, as `split_deck` makes them.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import order_conditions, reference_quantities
from datcom_io.arrays.families import LEAVES
from datcom_io.arrays.stacking import Stacker
from datcom_io.cells import ABSENT
from datcom_io.printout.content import PrintedCase


def case_tree(case: PrintedCase, *, fill_transonic: bool = False) -> xr.DataTree:
    """Build the tree of `Case.to_datatree`."""
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs=_root_attrs(case)), **_leaves(case, fill_transonic)},
        name=_node_name(case),
    )


def listing_tree(
    cases: Iterable[PrintedCase], file: str, runs: int, *, fill_transonic: bool = False
) -> xr.DataTree:
    """Build the tree of `Listing.to_datatree`."""
    nodes = {"/": xr.Dataset(attrs={"file": file, "runs": runs})}
    for case in cases:
        if leaves := _leaves(case, fill_transonic):
            path = f"/{_node_name(case)}"
            path = f"{path} ({case.ordinal})" if path in nodes else path
            nodes[path] = xr.Dataset(attrs=_root_attrs(case))
            nodes |= {f"{path}/{leaf}": dataset for leaf, dataset in leaves.items()}
    return xr.DataTree.from_dict(nodes)


def _node_name(case: PrintedCase) -> str:
    """Return the name of a case without what makes a path of it."""
    return case.name.replace("/", "|") if case.name.strip(".") else f"case {case.ordinal}"


def _leaves(case: PrintedCase, fill_transonic: bool) -> dict[str, xr.Dataset]:
    """Return the leaves that the case has."""
    conditions, spots = order_conditions(case)
    stacker = Stacker(case, conditions, spots, fill_transonic)
    return {
        name: leaf.dataset() for name, make in LEAVES.items() if (leaf := make(stacker)) is not None
    }


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
        "messages": _messages(case),
    }


def _messages(case: PrintedCase) -> str:
    """Return the messages of a case, one line each; repeated ones once."""
    lines: dict[str, list[int]] = {}
    for message in case.messages:
        lines.setdefault(message.text, []).append(message.line)
    return "\n".join(
        f"line {at[0]}{f' and {len(at) - 1} more' if at[1:] else ''}: {text}"
        for text, at in lines.items()
    )


AXES = (
    "delta_f",
    "delta_e",
    "delta",
)  # of static and downwash pages over ground, and of symmetrical flaps
_DIGITS = 9  # of a deflection in radians that distinguish it


def over_deflections(trees: Sequence[xr.DataTree]) -> list[xr.DataTree]:
    """Return the trees with those of the same flap and flight conditions and other deflections put
    together; others as they are.

    A leaf that has no axis of deflection is taken from the first tree.
    """
    groups: dict[Hashable, list[xr.DataTree]] = {}
    seen: set[tuple[Hashable, float]] = set()
    for number, tree in enumerate(trees):
        kind, deflections = _kind(tree)
        places = {(kind, delta) for delta in deflections}
        if kind is None or places & seen:  # no flap, or a deflection that another tree gives
            kind = number
        seen |= places
        groups.setdefault(kind, []).append(tree)
    return [_together(group) if len(group) > 1 else group[0] for group in groups.values()]


def _kind(tree: xr.DataTree) -> tuple[Hashable, list[float]]:
    """Return what trees of one flap at the same flight conditions have in common, and the
    deflections; None without symmetrical flap.
    """
    if "symflp" not in tree.children:
        return None, []
    leaf = tree.children["symflp"].to_dataset(inherit=False)
    conditions = zip(leaf["mach"].values.tolist(), leaf["h"].values.tolist())
    kind = (tuple(sorted(tree.children)), tuple(sorted(leaf.attrs.items())), tuple(conditions))
    return kind, np.round(leaf["delta"].values, _DIGITS).tolist()


def _together(trees: list[xr.DataTree]) -> xr.DataTree:
    root = dict(trees[0].attrs)
    for key, between in (("title", "; "), ("case", "; "), ("file", "; "), ("messages", "\n")):
        root[key] = between.join(
            dict.fromkeys(str(tree.attrs[key]) for tree in trees if tree.attrs.get(key))
        )
    leaves = {}
    for name in trees[0].children:
        parts = [tree.children[name].to_dataset(inherit=False) for tree in trees]
        axis = next((axis for axis in AXES if axis in parts[0].coords), "")
        leaves[str(name)] = _merged(parts, axis) if axis else parts[0]
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **leaves})


def _merged(parts: list[xr.Dataset], axis: str) -> xr.Dataset:
    """Return one leaf over all deflections, NaN and ``absent`` where no part gives them."""
    given = np.concatenate([np.atleast_1d(part[axis].values) for part in parts])
    every, at = np.unique(np.round(given, _DIGITS), return_index=True)
    first = parts[0]
    if len(every) == 1 and axis not in first.dims:
        return first
    places = [
        np.searchsorted(every, np.round(np.atleast_1d(part[axis].values), _DIGITS))
        for part in parts
    ]
    variables: dict[str, xr.Variable] = {axis: xr.Variable(axis, given[at], first[axis].attrs)}
    for name in map(str, first.variables):
        if name == axis or name.endswith("_flag"):
            continue
        items = [_over(part, name, axis) for part in parts]
        if axis not in items[0].dims:
            variables[name] = (
                _texts_joined(items)
                if items[0].dtype.kind == "U" and name in first.coords
                else items[0]
            )
        elif f"{name}_flag" in first:
            flags = [_over(part, f"{name}_flag", axis) for part in parts]
            variables[name], variables[f"{name}_flag"] = _filled(
                items, flags, places, len(every), axis
            )
        else:
            variables[name] = _placed_texts(items, places, len(every), axis)
    coords = {
        name: variables.pop(name)
        for name in list(variables)
        if name in first.coords or name == axis
    }
    return xr.Dataset(variables, coords, first.attrs)


def _over(part: xr.Dataset, name: str, axis: str) -> xr.Variable:
    """Return a variable with the deflection as a dimension, before the angle of attack, where it is
    a table or names the place of one.
    """
    item = part.variables[name]
    tabled = name in ("lines", "notes") or ("alpha" in item.dims and name != "alpha")
    if axis in item.dims or axis in part.dims or not tabled:
        return item
    at = item.dims.index("alpha") if "alpha" in item.dims else item.ndim
    return xr.Variable(
        (*item.dims[:at], axis, *item.dims[at:]), np.expand_dims(item.values, at), item.attrs
    )


def _filled(
    items: list[xr.Variable],
    flags: list[xr.Variable],
    places: list[np.ndarray],
    count: int,
    axis: str,
) -> tuple[xr.Variable, xr.Variable]:
    """Return values and flags over all deflections; of several cells for one place the first that
    is printed counts.
    """
    at = items[0].dims.index(axis)
    shape = (*items[0].shape[:at], count, *items[0].shape[at + 1 :])
    value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
    for item, codes, place in zip(items, flags, places):
        where = (slice(None),) * at + (place,)
        missing = flag[where] == ABSENT
        value[where] = np.where(missing, item.values, value[where])
        flag[where] = np.where(missing, codes.values, flag[where])
    return xr.Variable(items[0].dims, value, items[0].attrs), xr.Variable(
        items[0].dims, flag, flags[0].attrs
    )


def _placed_texts(
    items: list[xr.Variable], places: list[np.ndarray], count: int, axis: str
) -> xr.Variable:
    """Return texts over all deflections, empty where no part gives one, joined where several do."""
    at = items[0].dims.index(axis)
    spread = []
    for item, place in zip(items, places):
        texts = np.full((*item.shape[:at], count, *item.shape[at + 1 :]), "", dtype=object)
        texts[(slice(None),) * at + (place,)] = item.values
        spread.append(xr.Variable(item.dims, texts, item.attrs))
    return _texts_joined(spread)


def _texts_joined(items: list[xr.Variable]) -> xr.Variable:
    """Return the different texts of each place."""
    rows = zip(*(item.values.ravel() for item in items))
    joined = [", ".join(dict.fromkeys(text for text in row if text)) for row in rows]
    return xr.Variable(
        items[0].dims, np.array(joined, dtype=str).reshape(items[0].shape), items[0].attrs
    )
