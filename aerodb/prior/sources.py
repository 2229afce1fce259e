"""From DATCOM case trees to gridded tables: conditions to Mach and altitude, missing cells cut
away, references kept.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import datcom_io
from aerodb.prior.prior_errors import STMACH, TSMACH
from datcom_io.decks.deck import Deck
from flightmech.errors import AeromatchWarning, SchemaError

REFERENCES = ("S", "cbar", "b", "x_cg", "z_cg")
_WITHOUT_POWER = (
    "give the case without JETPWR and PROPWR at the same conditions here and this one as "
    "power, or state `powered` (--powered) to use "
    "these pages with the thrust taken off and wider standard errors"
)
_SHOWN = 3  # differences of cases that are listed
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
    decks : tuple of Deck
        Input cards of the cases; empty where only trees were given.
    powered : bool
        Whether its pages are those with power effects.
    """

    role: str
    tree: xr.DataTree
    reference: dict[str, float]
    looped: frozenset[str]
    decks: tuple[Deck, ...] = ()
    powered: bool = False

    @property
    def file(self) -> str:
        """Name of the file, or the names."""
        return str(self.tree.attrs.get("file", ""))

    def has(self, leaf: str) -> bool:
        """Return whether a leaf is there."""
        return leaf in self.tree.children

    def place(self, leaf: str) -> str:
        """Return files and lines where the tables of a leaf stand."""
        lines = self.tree[leaf].coords.get("lines")
        ends = [
            int(end)
            for text in (lines.values.ravel() if lines is not None else ())
            for end in re.findall(r"\d+", str(text))
        ]
        return f"{self.file}, lines {min(ends)}-{max(ends)}" if ends else self.file

    def card(self, namelist: str, variable: str, default: float | None = None) -> float:
        """Return a number of the input cards, the same in all cases. [as in the deck]

        Raises
        ------
        SchemaError
            No cards came with the tables, the number is not given, or the cases differ in it.
        """
        found = {
            default if value is None else value
            for value in (deck.value(namelist, variable) for deck in self.decks)
        }
        if len(found) == 1 and (value := found.pop()) is not None:
            return value
        name = f"{namelist} {variable}"
        if not self.decks:
            raise SchemaError(
                self.role,
                [
                    f"{name} is needed and the trees hold no input cards; give the Listing "
                    f"or the Case itself"
                ],
            )
        raise SchemaError(
            self.role,
            [
                f"the input cards give {'no' if not found else 'several values of'} {name}; "
                f"give cases of one deck"
            ],
        )

    @property
    def regimes(self) -> tuple[float, float]:
        """Last Mach number of the subsonic methods and first one of the supersonic methods."""
        if not self.decks:
            return STMACH, TSMACH
        return self.card("FLTCON", "STMACH", STMACH), self.card("FLTCON", "TSMACH", TSMACH)

    @property
    def configuration(self) -> str:
        """Configuration of the static pages that are used, as printed: ``WING-BODY``; empty where
        none is known.
        """
        if not self.has("static"):
            return ""
        pages = self._of_most_components("static")
        return str(pages["configuration"].item()) if "configuration" in pages.coords else ""

    def grid(self, leaf: str) -> xr.Dataset:
        """Return a leaf over ``mach`` and ``h`` instead of ``condition``, of the configuration with
        the most components.

        Raises
        ------
        SchemaError
            There is no such leaf, its pages are computed with power where those without are needed
            (or the reverse), or its conditions fill no grid.
        """
        if not self.has(leaf):
            raise SchemaError(
                self.role,
                [f"the listing {self.file} holds no {leaf} table; give the case that prints it"],
            )
        dataset = self._with_power(self._of_most_components(leaf))
        try:
            found = datcom_io.to_grid(_along_mach(dataset))
        except SchemaError as error:
            raise SchemaError(
                f"{self.role}, {leaf}",
                [*error.problems, "run the deck with LOOP=2 and every Mach number once"],
            ) from None
        return found.drop_vars(
            [name for name in found.coords if name not in found.dims and name not in _KEPT]
        )

    def _of_most_components(self, leaf: str) -> xr.Dataset:
        dataset = self.tree.children[leaf].to_dataset(inherit=False)
        if "configuration" not in dataset.dims:
            return dataset
        parts = [len(str(name).split("-")) for name in dataset["configuration"].values]
        return dataset.isel(configuration=int(np.argmax(parts)))

    def _with_power(self, dataset: xr.Dataset) -> xr.Dataset:
        if "power" not in dataset.coords:
            return dataset
        kinds = [str(kind) for kind in np.atleast_1d(dataset["power"].values)]
        wanted = [kind for kind in kinds if (kind != "off") == self.powered]
        if len(wanted) != 1:
            found = f"the pages of {self.file} are computed with power {' and '.join(kinds)}"
            wish = "give one case with JETPWR or PROPWR" if self.powered else _WITHOUT_POWER
            raise SchemaError(self.role, [f"{found}; {wish}"])
        return (
            dataset.sel(power=wanted[0], drop=True)
            if "power" in dataset.dims
            else dataset.drop_vars("power")
        )


def collect_source(role: str, given: Any, powered: bool = False) -> Source:
    """Return what a listing, a case, a case tree or several of them hold; `powered`: its pages with
    power effects are wanted.

    Raises
    ------
    SchemaError
        Reference quantities are missing, or cases differ in them or in their axes.
    """
    parts = [(tree, deck) for tree, deck in _parts(given) if tree.children]
    trees = [tree for tree, _ in parts]
    if not trees:
        raise SchemaError(
            role,
            [
                "no case with tables was given; give a Listing, a Case, a case tree or a "
                "list of them"
            ],
        )
    problems = [
        f"case {tree.attrs.get('case')} has no reference quantity {key}; give OPTINS and "
        f"SYNTHS in the deck"
        for tree in trees
        for key in REFERENCES
        if not np.isfinite(float(tree.attrs.get(key, np.nan)))
    ]
    if problems:
        raise SchemaError(role, problems)
    try:
        joined = datcom_io.join(trees)
    except SchemaError as error:
        hint = (
            "give cases of one kind and one aircraft (FILE:CASE), or let the roles be found "
            "from the listings (db build AIRCRAFT FILE)"
        )
        raise SchemaError(
            f"{role}: {len(trees)} cases cannot be joined", [*error.problems[:_SHOWN], hint]
        ) from None
    decks = tuple(deck for _, deck in parts if deck is not None)
    looped = {
        name
        for tree in trees
        for name, leaf in tree.children.items()
        if leaf.sizes.get("condition", 1) > 1
    }
    if role == "clean" and "static" in joined.children:
        _report_pairs(role, joined.children["static"].to_dataset(inherit=False))
        _report_suspects(role, joined)
    return Source(
        role,
        joined,
        {key: float(joined.attrs[key]) for key in REFERENCES},
        frozenset(looped),
        decks,
        powered,
    )


def split_powered(given: Any) -> tuple[list[Any], list[Any]]:
    """Return the cases or case trees without power effects, and those with."""
    found: tuple[list[Any], list[Any]] = ([], [])
    for item in _items(given):
        found[_is_powered(item)].append(item)
    return found


def _is_powered(item: Any) -> bool:
    if isinstance(item, xr.DataTree):
        static = (
            item.children["static"].to_dataset(inherit=False)
            if "static" in item.children
            else xr.Dataset()
        )
        return "power" in static.coords and bool((static["power"] != "off").any())
    return any(page.power != "off" for page in item.pages)


def _along_mach(dataset: xr.Dataset) -> xr.Dataset:
    """Return a leaf whose Mach numbers stand at an altitude each as if they stood at one, and any
    other one as it is.
    """
    heights = dataset["h"].values
    if not _paired(dataset):
        return dataset
    return dataset.assign_coords(
        h=(
            "condition",
            np.full(len(heights), np.sort(heights)[len(heights) // 2]),
            dataset["h"].attrs,
        )
    )


def _paired(dataset: xr.Dataset) -> bool:
    """Return whether every Mach number occurs once, and not all at one altitude."""
    machs, heights = dataset["mach"].values, dataset["h"].values
    return (
        len(np.unique(machs)) == len(machs)
        and len(np.unique(heights)) > 1
        and bool(np.isfinite(heights).all())
    )


def _report_pairs(role: str, static: xr.Dataset) -> None:
    if _paired(static):
        places = ", ".join(
            f"{mach:g} at {h:.0f} m" for mach, h in zip(static["mach"].values, static["h"].values)
        )
        warn_user(
            f"{role}: every Mach number stands at an altitude of its own ({places}); the "
            f"tables go over Mach number alone"
        )


def _report_suspects(role: str, joined: xr.DataTree) -> None:
    """Warn of pages in free air without power that hold suspect cells; of those with power they are
    taken out (`power`).
    """
    suspect = datcom_io.FLAGS.index("suspect")
    leaves = [
        joined.children[name].to_dataset(inherit=False)
        for name in ("static", "dynamic")
        if name in joined.children
    ]
    leaves = [
        leaf.sel(ground_height=np.inf) if "ground_height" in leaf.dims else leaf for leaf in leaves
    ]
    leaves = [
        leaf
        for leaf in leaves
        if "power" not in leaf.coords or bool((leaf["power"] == "off").all())
    ]
    count = sum(
        int((leaf[name] == suspect).sum())
        for leaf in leaves
        for name in leaf.data_vars
        if str(name).endswith("_flag")
    )
    if count:
        warn_user(
            f"{role}: {count} numbers of {joined.attrs.get('file')} are suspect; its "
            f"messages state why (datcom show)"
        )


def drop_empty_tables(tables: Mapping[str, xr.DataArray]) -> dict[str, xr.DataArray]:
    """Return the tables that hold any number."""
    return {name: table for name, table in tables.items() if bool(table.notnull().any())}


def _parts(given: Any) -> Iterator[tuple[xr.DataTree, Deck | None]]:
    """Yield the case trees, with their input cards where they come from a listing."""
    for item in _items(given):
        yield (item, None) if isinstance(item, xr.DataTree) else (item.to_datatree(), item.deck)


def _items(given: Any) -> Iterator[Any]:
    """Yield the cases and case trees."""
    if isinstance(given, xr.DataTree) or (
        hasattr(given, "to_datatree") and not hasattr(given, "cases")
    ):
        yield given
    elif isinstance(given, Iterable):
        for item in given:
            yield from _items(item)
    else:
        raise SchemaError(
            "source",
            [
                f"found an object of type {type(given).__name__}; give a Listing, a Case, a "
                f"case tree or a list of them"
            ],
        )


def warn_user(text: str) -> None:
    """Warn the user of something that does not stop the work."""
    warnings.warn(text, AeromatchWarning, stacklevel=3)
