"""From DATCOM case trees to gridded tables: conditions to Mach and altitude, missing cells cut away, references kept."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import datcom_io
from flightmech.errors import AeromatchWarning, SchemaError

REFERENCES = ("S", "cbar", "b", "x_cg", "z_cg")
_KEPT = ("delta_left", "delta_right")


@dataclass(frozen=True)
class Source:
    """The cases that were given in one role, joined.

    Attributes
    ----------
    role : str
        ``clean``, ``flaps`` ...
    tree : DataTree
        All conditions, as `datcom_io.join` returns them.
    reference : dict
        ``S`` [m2], ``cbar``, ``b``, ``x_cg`` (aft), ``z_cg`` (up) [m].
    looped : frozenset of str
        Leaves of which one program run computed several flight conditions.
    """

    role: str
    tree: xr.DataTree
    reference: dict[str, float]
    looped: frozenset[str]

    @property
    def file(self) -> str:
        """Name of the file, or the names."""
        return str(self.tree.attrs.get("file", ""))

    def has(self, leaf: str) -> bool:
        """Tell whether a leaf is there."""
        return leaf in self.tree.children

    def place(self, leaf: str) -> str:
        """Return files and lines where the tables of a leaf stand."""
        lines = self.tree[leaf].coords.get("lines")
        ends = [int(end) for text in (lines.values.ravel() if lines is not None else ()) for end in str(text).split("-") if end.isdigit()]
        return f"{self.file}, lines {min(ends)}-{max(ends)}" if ends else self.file

    def grid(self, leaf: str) -> xr.Dataset:
        """Return a leaf over ``mach`` and ``h`` instead of ``condition``, of the configuration with the most components, without power."""
        if not self.has(leaf):
            raise SchemaError(self.role, [f"the listing {self.file} holds no {leaf} table; give the case that prints it"])
        dataset = self.tree.children[leaf].to_dataset(inherit=False)
        if "configuration" in dataset.dims:
            parts = [len(str(name).split("-")) for name in dataset["configuration"].values]
            dataset = dataset.isel(configuration=int(np.argmax(parts)))
        if "power" in dataset.dims:
            dataset = dataset.sel(power="off")
        try:
            found = datcom_io.to_grid(dataset)
        except SchemaError as error:
            raise SchemaError(f"{self.role}, {leaf}", [*error.problems, "run the deck with LOOP=2 and every Mach number once"]) from None
        return found.drop_vars([name for name in found.coords if name not in found.dims and name not in _KEPT])


def source(role: str, given: Any) -> Source:
    """Return what a listing, a case, a case tree or several of them hold.

    Raises
    ------
    SchemaError
        Reference quantities are missing, or cases differ in them or in their axes.
    """
    trees = [tree for tree in _trees(given) if tree.children]
    if not trees:
        raise SchemaError(role, ["no case with tables was given; give a Listing, a Case, a case tree or a list of them"])
    problems = [
        f"case {tree.attrs.get('case')} has no reference quantity {key}; give OPTINS and SYNTHS in the deck"
        for tree in trees
        for key in REFERENCES
        if not np.isfinite(float(tree.attrs.get(key, np.nan)))
    ]
    if problems:
        raise SchemaError(role, problems)
    joined = datcom_io.join(trees)
    looped = {name for tree in trees for name, leaf in tree.children.items() if leaf.sizes.get("condition", 1) > 1}
    return Source(role, joined, {key: float(joined.attrs[key]) for key in REFERENCES}, frozenset(looped))


def known(tables: Mapping[str, xr.DataArray]) -> dict[str, xr.DataArray]:
    """Return the tables that hold any number."""
    return {name: table for name, table in tables.items() if bool(table.notnull().any())}


def _trees(given: Any) -> Iterable[xr.DataTree]:
    if isinstance(given, xr.DataTree):
        yield given
    elif hasattr(given, "to_datatree") and not hasattr(given, "cases"):
        yield given.to_datatree()
    elif isinstance(given, Iterable):
        for item in given:
            yield from _trees(item)
    else:
        raise SchemaError(
            "source", [f"found an object of type {type(given).__name__}; give a Listing, a Case, a case tree or a list of them"]
        )


def warn(text: str) -> None:
    """Tell the user something that does not stop the work."""
    warnings.warn(text, AeromatchWarning, stacklevel=3)
