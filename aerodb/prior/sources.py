"""Gridded tables of DATCOM cases over Mach number and altitude, with their references."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import datcom_io
from aerodb.prior.clean_cases import join_chains, require_one_reynolds_number
from aerodb.prior.prior_errors import STMACH, TSMACH
from datcom_io.decks.aircraft_rules import has_thrust
from datcom_io.decks.deck import Deck
from datcom_io.reading.suspects import FILLED_BY_POWER
from flightmech.errors import AeromatchWarning, SchemaError

REFERENCES = ("S", "cbar", "b", "x_cg", "z_cg")
_WITHOUT_POWER = (
    "give the case without JETPWR and PROPWR at the same conditions here and this one as "
    "power, or state `powered` (--powered) to use "
    "these pages with the thrust taken off and wider standard errors"
)
_MOST_DIFFERENCES = 3  # differences of cases that a message lists
# Coordinates of a grid that are needed later.
_PAIR_COORDINATES = ("delta_left", "delta_right")


@dataclass(frozen=True)
class Source:
    """The joined cases of one role.

    Attributes
    ----------
    role : str
        ``clean``, ``flaps`` ...
    tree : DataTree
        All conditions, as `datcom_io.join` returns them.
    reference : dict
        ``S`` [m2], ``cbar``, ``b``, ``x_cg`` (aft), ``z_cg`` (up) [m].
    looped : frozenset of str
        Leaves with several flight conditions from one program run.
    decks : tuple of Deck
        Input cards of the cases; empty if only trees were given.
    powered : bool
        Whether the pages with power effects are used.
    idle : str
        ``jet`` or ``propeller`` if the pages are those of engines without thrust.
    """

    role: str
    tree: xr.DataTree
    reference: dict[str, float]
    looped: frozenset[str]
    decks: tuple[Deck, ...] = ()
    powered: bool = False
    idle: str = ""

    @property
    def file(self) -> str:
        """Name of the file, or the names."""
        return str(self.tree.attrs.get("file", ""))

    def has(self, leaf: str) -> bool:
        """Return whether the cases have a leaf."""
        return leaf in self.tree.children

    def place(self, leaf: str) -> str:
        """Return files and lines of the tables of a leaf."""
        lines = self.tree[leaf].coords.get("lines")
        if lines is None:
            return self.file
        # A text of lines is a range such as 120-180.
        numbers: list[int] = []
        for text in lines.values.ravel():
            numbers += map(int, re.findall(r"\d+", str(text)))
        if not numbers:
            return self.file
        return f"{self.file}, lines {min(numbers)}-{max(numbers)}"

    def card(self, namelist: str, variable: str, default: float | None = None) -> float:
        """Return a number of the input cards that is the same in all cases. [as in the deck]

        Raises
        ------
        SchemaError
            The tables have no cards, the number is missing, or the cases differ in it.
        """
        # Cases without the number have the default.
        values = set()
        for deck in self.decks:
            value = deck.value(namelist, variable)
            if value is None:
                value = default
            values.add(value)
        if len(values) == 1:
            (value,) = values
            if value is not None:
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
        number = "several values of"
        if values == {None}:
            number = "no"
        raise SchemaError(
            self.role, [f"the input cards give {number} {name}; give cases of one deck"]
        )

    @property
    def regimes(self) -> tuple[float, float]:
        """Last Mach number of the subsonic methods and first one of the supersonic methods."""
        if not self.decks:
            return STMACH, TSMACH
        return self.card("FLTCON", "STMACH", STMACH), self.card("FLTCON", "TSMACH", TSMACH)

    @property
    def has_altitude(self) -> bool:
        """Whether a static page states its altitude; a deck with Reynolds numbers gives none."""
        return not _is_without_altitude(self._fullest_configuration("static"))

    @property
    def configuration(self) -> str:
        """Configuration of the static pages, such as ``WING-BODY``; empty without any."""
        if not self.has("static"):
            return ""
        pages = self._fullest_configuration("static")
        if "configuration" not in pages.coords:
            return ""
        return str(pages["configuration"].item())

    def grid(self, leaf: str) -> xr.Dataset:
        """Return a leaf over ``mach`` and ``h`` in place of ``condition``.

        It is that of the configuration with the most components.

        Raises
        ------
        SchemaError
            The leaf is missing, its pages have power effects and those without are needed (or the
            reverse), or its conditions do not fill a grid.
        """
        if not self.has(leaf):
            raise SchemaError(
                self.role,
                [f"the listing {self.file} holds no {leaf} table; give the case that prints it"],
            )
        # Mach number and altitude become axes of the grid.
        dataset = self._fullest_configuration(leaf)
        require_one_reynolds_number(self.role, dataset)
        if leaf == "static":
            dataset = self._select_power(dataset)
        elif "power" in dataset.dims:
            # Only the static pages contain effects of power.
            dataset = dataset.isel(power=0, drop=True)
        try:
            grid = datcom_io.to_grid(_along_mach(dataset))
        except SchemaError as error:
            raise SchemaError(
                f"{self.role}, {leaf}",
                [*error.problems, "run the deck with LOOP=2 and every Mach number once"],
            ) from None
        unused = []
        for name in grid.coords:
            if name not in grid.dims and name not in _PAIR_COORDINATES:
                unused.append(name)
        return grid.drop_vars(unused)

    def _fullest_configuration(self, leaf: str) -> xr.Dataset:
        """Return a leaf of the configuration with the most components."""
        dataset = self.tree.children[leaf].to_dataset(inherit=False)
        if "configuration" not in dataset.dims:
            return dataset
        # Components are separated by dashes: WING-BODY has two.
        components = [len(str(name).split("-")) for name in dataset["configuration"].values]
        return dataset.isel(configuration=int(np.argmax(components)))

    def _select_power(self, dataset: xr.Dataset) -> xr.Dataset:
        """Return the pages with or without power effects, as `powered` states."""
        if "power" not in dataset.coords:
            return dataset
        # A leaf has one kind of power, or an axis of several.
        kinds = [str(kind) for kind in np.atleast_1d(dataset["power"].values)]
        matching = [kind for kind in kinds if (kind != "off") == self.powered]
        if len(matching) != 1:
            advice = _WITHOUT_POWER
            if self.powered:
                advice = "give one case with JETPWR or PROPWR"
            pages = f"the pages of {self.file} are computed with power {' and '.join(kinds)}"
            raise SchemaError(self.role, [f"{pages}; {advice}"])
        if "power" in dataset.dims:
            return dataset.sel(power=matching[0], drop=True)
        return dataset.drop_vars("power")


def collect_source(role: str, given: Any, powered: bool = False) -> Source:
    """Return the joined tables of a listing, a case, a case tree or several of them.

    Parameters
    ----------
    role : str
        Role of the cases, for messages.
    given : Listing, Case, case tree or nested list of them
    powered : bool
        Whether to use the pages with power effects.

    Raises
    ------
    SchemaError
        Reference quantities are missing, or cases differ in them or in their axes.
    """
    trees, decks = [], []
    idle = ""
    for tree, deck in _case_trees(given):
        if not tree.children:
            continue
        if deck is not None and not has_thrust(deck):
            idle = idle or _kind_of_power(tree)
            tree = _without_idle_power(tree)
        trees.append(tree)
        if deck is not None:
            decks.append(deck)
    if not trees:
        raise SchemaError(
            role,
            [
                "no case with tables was given; give a Listing, a Case, a case tree or a "
                "list of them"
            ],
        )
    _require_reference_quantities(role, trees)
    if role == "clean":
        trees = join_chains(trees)
    joined = _join_trees(role, trees)
    # Leaves of several conditions of one run: some results drift along them.
    looped: set[str] = set()
    for tree in trees:
        for name, leaf in tree.children.items():
            if leaf.sizes.get("condition", 1) > 1:
                looped.add(name)
    if role == "clean" and "static" in joined.children:
        _warn_of_pairs(role, joined.children["static"].to_dataset(inherit=False))
        _warn_of_suspects(role, joined)
    return Source(
        role=role,
        tree=joined,
        reference={key: float(joined.attrs[key]) for key in REFERENCES},
        looped=frozenset(looped),
        decks=tuple(decks),
        powered=powered,
        idle=idle,
    )


def _kind_of_power(tree: xr.DataTree) -> str:
    """Return the kind of power of the static pages, empty without any."""
    if "static" not in tree.children:
        return ""
    static = tree.children["static"].to_dataset(inherit=False)
    if "power" not in static.coords:
        return ""
    kinds = {str(kind) for kind in np.atleast_1d(static["power"].values)} - {"off"}
    return min(kinds, default="")


def _without_idle_power(tree: xr.DataTree) -> xr.DataTree:
    """Return the tables of engines without thrust as those without power.

    Numbers of cells that have no value without power are removed: they are increments.
    """
    if not _kind_of_power(tree):
        return tree
    tree = tree.copy()
    for name, leaf in tree.children.items():
        dataset = leaf.to_dataset(inherit=False)
        if "power" not in dataset.coords or "power" in dataset.dims:
            continue
        dataset = dataset.drop_vars("power")
        for slope, filled in FILLED_BY_POWER:
            if name != "static" or slope not in dataset:
                continue
            for quantity in filled:
                if quantity in dataset:
                    dataset[quantity] = dataset[quantity].where(dataset[slope].notnull())
        leaf.dataset = dataset
    return tree


def _require_reference_quantities(role: str, trees: Iterable[xr.DataTree]) -> None:
    """Raise if a case lacks a reference quantity; all of them."""
    problems = []
    for tree in trees:
        for key in REFERENCES:
            if not np.isfinite(float(tree.attrs.get(key, np.nan))):
                problems.append(
                    f"case {tree.attrs.get('case')} has no reference quantity {key}; give OPTINS "
                    f"and SYNTHS in the deck"
                )
    if problems:
        raise SchemaError(role, problems)


def _join_trees(role: str, trees: list[xr.DataTree]) -> xr.DataTree:
    """Return the joined cases; raise with advice if they do not fit."""
    try:
        return datcom_io.join(trees)
    except SchemaError as error:
        hint = (
            "give cases of one kind and one aircraft (FILE:CASE), or let the roles be found "
            "from the listings (db build AIRCRAFT FILE)"
        )
        raise SchemaError(
            f"{role}: {len(trees)} cases cannot be joined",
            [*error.problems[:_MOST_DIFFERENCES], hint],
        ) from None


def split_powered(given: Any) -> tuple[list[Any], list[Any]]:
    """Return the cases or case trees without power effects, and those with them."""
    without_power, with_power = [], []
    for item in _flatten_cases(given):
        if _is_powered(item):
            with_power.append(item)
        else:
            without_power.append(item)
    return without_power, with_power


def _is_powered(item: Any) -> bool:
    """Return whether a case or case tree has pages with power effects."""
    if not isinstance(item, xr.DataTree):
        return has_thrust(item.deck) and any(page.power != "off" for page in item.pages)
    if "static" not in item.children:
        return False
    static = item.children["static"].to_dataset(inherit=False)
    return "power" in static.coords and bool((static["power"] != "off").any())


def _along_mach(dataset: xr.Dataset) -> xr.Dataset:
    """Return a leaf at one altitude if each Mach number has its own or none; else unchanged."""
    if _is_without_altitude(dataset):
        # A table over Mach number needs no altitude.
        h = ("condition", np.zeros(dataset.sizes["condition"]), dataset["h"].attrs)
        return dataset.assign_coords(h=h)
    if not _has_own_altitudes(dataset):
        return dataset
    # The middle altitude represents all of them.
    heights = dataset["h"].values
    middle = np.sort(heights)[len(heights) // 2]
    h = ("condition", np.full(len(heights), middle), dataset["h"].attrs)
    return dataset.assign_coords(h=h)


def _is_without_altitude(dataset: xr.Dataset) -> bool:
    """Return whether no condition has an altitude, and every Mach number occurs once."""
    machs = dataset["mach"].values
    return len(np.unique(machs)) == len(machs) and bool(np.isnan(dataset["h"].values).all())


def _has_own_altitudes(dataset: xr.Dataset) -> bool:
    """Return whether every Mach number occurs once, and not all at one altitude."""
    machs, heights = dataset["mach"].values, dataset["h"].values
    if len(np.unique(machs)) != len(machs) or len(np.unique(heights)) <= 1:
        return False
    return bool(np.isfinite(heights).all())


def _warn_of_pairs(role: str, static: xr.Dataset) -> None:
    """Warn if each Mach number has its own altitude."""
    if _has_own_altitudes(static):
        pairs = zip(static["mach"].values, static["h"].values)
        conditions = ", ".join(f"{mach:g} at {h:.0f} m" for mach, h in pairs)
        warn_user(
            f"{role}: every Mach number stands at an altitude of its own ({conditions}); the "
            f"tables go over Mach number alone"
        )


def _warn_of_suspects(role: str, joined: xr.DataTree) -> None:
    """Warn of suspect cells of pages in free air without power.

    Those with power are removed elsewhere (`aerodb.prior.power`).
    """
    suspect = datcom_io.FLAGS.index("suspect")
    count = 0
    for leaf in ("static", "dynamic"):
        if leaf not in joined.children:
            continue
        pages = joined.children[leaf].to_dataset(inherit=False)
        # Only pages in free air without power are counted.
        if "ground_height" in pages.dims:
            pages = pages.sel(ground_height=np.inf)
        if "power" in pages.coords and not bool((pages["power"] == "off").all()):
            continue
        for name in pages.data_vars:
            if str(name).endswith("_flag"):
                count += int((pages[name] == suspect).sum())
    if count:
        warn_user(
            f"{role}: {count} numbers of {joined.attrs.get('file')} are suspect; its "
            f"messages state why (datcom show)"
        )


def drop_empty_tables(tables: Mapping[str, xr.DataArray]) -> dict[str, xr.DataArray]:
    """Return the tables that contain at least one number."""
    return {name: table for name, table in tables.items() if bool(table.notnull().any())}


def _case_trees(given: Any) -> Iterator[tuple[xr.DataTree, Deck | None]]:
    """Yield the case trees, with the input cards of those that come from a listing."""
    for item in _flatten_cases(given):
        if isinstance(item, xr.DataTree):
            yield item, None
        else:
            yield item.to_datatree(), item.deck


def _flatten_cases(given: Any) -> Iterator[Any]:
    """Yield the cases and case trees of nested lists and listings."""
    # A listing has cases and a tree of all of them: its cases are used.
    is_case = hasattr(given, "to_datatree") and not hasattr(given, "cases")
    if isinstance(given, xr.DataTree) or is_case:
        yield given
    elif isinstance(given, Iterable):
        for item in given:
            yield from _flatten_cases(item)
    else:
        raise SchemaError(
            "source",
            [
                f"found an object of type {type(given).__name__}; give a Listing, a Case, a "
                f"case tree or a list of them"
            ],
        )


def warn_user(text: str) -> None:
    """Issue an `AeromatchWarning` at the caller of the calling function."""
    warnings.warn(text, AeromatchWarning, stacklevel=3)
