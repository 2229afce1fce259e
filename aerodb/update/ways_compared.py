"""Identified terms of several ways from the same data, compared node by node."""

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
    """Return the nodes of identified terms as several ways found them, side by side.

    Parameters
    ----------
    found : mapping of str to Tabulation
        By the name of the way, such as ``{"tabulate": tabulate(...), "direct": regress_tables(...),
        "join": join_submodels(...)}``; a term that one of them did not change counts with its
        a-priori values.
    prior : DataTree
        The database before.

    Returns
    -------
    DataFrame
        Index (term, node), the node counted in the order of ``value.ravel()``.  Columns ``place``
        (breakpoints, SI), ``value prior``, ``stderr prior``; for every way ``value``, ``stderr``
        and ``source`` with its name; for every two ways ``A - B``, their difference over the root
        of the sum of their squared standard errors (0 where both are exact and equal).  They rest
        on the same flights, so that a difference of one is large.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """
    before = terms(prior)
    names = dict.fromkeys(name for way in found.values() for name in way)
    for name in names:
        if name not in before:
            raise UnknownName(name, before, "term")
    parts = []
    for name in names:
        leaf = before[name]
        columns: dict[str, Any] = {
            "place": _places(leaf),
            "value prior": leaf["value"].values.ravel(),
            "stderr prior": leaf["stderr"].values.ravel(),
        }
        for way, leaves in found.items():
            after = leaves.get(name, leaf)
            columns |= {
                f"value {way}": after["value"].values.ravel(),
                f"stderr {way}": after["stderr"].values.ravel(),
            }
            columns[f"source {way}"] = _sources(after)
        for a, b in combinations(found, 2):
            apart = columns[f"value {a}"] - columns[f"value {b}"]
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = apart / np.hypot(columns[f"stderr {a}"], columns[f"stderr {b}"])
            columns[f"{a} - {b}"] = np.where(apart == 0.0, 0.0, ratio)
        index = pd.MultiIndex.from_product(
            [[name], range(leaf["value"].size)], names=["term", "node"]
        )
        parts.append(pd.DataFrame(columns, index=index))
    return pd.concat(parts)


def _places(leaf: xr.Dataset) -> list[str]:
    axes = [str(axis) for axis in leaf["value"].dims]
    return [
        ", ".join(f"{axis} {float(leaf[axis].values[k]):.6g}" for axis, k in zip(axes, at))
        for at in np.ndindex(*leaf["value"].shape)
    ]


def _sources(leaf: xr.Dataset) -> np.ndarray:
    if "source" not in leaf:
        return np.full(leaf["value"].size, "")
    return np.array(_terms.SOURCES)[leaf["source"].values.ravel()]
