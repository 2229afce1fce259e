"""Node-by-node comparison of terms identified by several methods from the same data."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.errors import UnknownName


def compare_ways(found: Mapping[str, Mapping[str, xr.Dataset]], prior: xr.DataTree) -> pd.DataFrame:
    """Return the nodes of terms identified by several methods side by side.

    Parameters
    ----------
    found : mapping of str to Tabulation
        By the name of the method, such as ``{"tabulate": tabulate(...), "direct":
        regress_tables(...), "join": join_submodels(...)}``.  A term that a method did not change
        counts with its a-priori values.
    prior : DataTree
        The database before.

    Returns
    -------
    DataFrame
        Index (term, node), the node counted in the order of ``value.ravel()``.  Columns ``place``
        (breakpoints, SI), ``value prior``, ``stderr prior``; for every method ``value``, ``stderr``
        and ``source`` with its name; for every two methods ``A - B``, their difference over the
        root of the sum of their squared standard errors (0 where both are exact and equal).  The
        methods use the same flights, so that a difference of 1 is large.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """
    before = terms(prior)
    names: dict[str, None] = {}
    for leaves in found.values():
        names.update(dict.fromkeys(leaves))
    for name in names:
        if name not in before:
            raise UnknownName(name, before, "term")
    parts = []
    for name in names:
        leaf = before[name]
        columns: dict[str, Any] = {
            "place": _format_breakpoints(leaf),
            "value prior": leaf["value"].values.ravel(),
            "stderr prior": leaf["stderr"].values.ravel(),
        }
        for method, leaves in found.items():
            after = leaves.get(name, leaf)
            columns[f"value {method}"] = after["value"].values.ravel()
            columns[f"stderr {method}"] = after["stderr"].values.ravel()
            columns[f"source {method}"] = _source_names(after)
        for a, b in combinations(found, 2):
            difference = columns[f"value {a}"] - columns[f"value {b}"]
            # Exact nodes have a standard error of zero: 0 / 0 is replaced by 0.
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = difference / np.hypot(columns[f"stderr {a}"], columns[f"stderr {b}"])
            columns[f"{a} - {b}"] = np.where(difference == 0.0, 0.0, ratio)
        levels = [[name], range(leaf["value"].size)]
        index = pd.MultiIndex.from_product(levels, names=["term", "node"])
        parts.append(pd.DataFrame(columns, index=index))
    return pd.concat(parts)


def _format_breakpoints(leaf: xr.Dataset) -> list[str]:
    """Return the breakpoints of every node, such as ``alpha 0.1, mach 0.3``."""
    axes = [str(axis) for axis in leaf["value"].dims]
    texts = []
    for indices in np.ndindex(*leaf["value"].shape):
        points = [f"{axis} {float(leaf[axis].values[k]):.6g}" for axis, k in zip(axes, indices)]
        texts.append(", ".join(points))
    return texts


def _source_names(leaf: xr.Dataset) -> np.ndarray:
    """Return the name of the source of every node, empty if the term does not state it."""
    if "source" not in leaf:
        return np.full(leaf["value"].size, "")
    return np.array(_terms.SOURCES)[leaf["source"].values.ravel()]
