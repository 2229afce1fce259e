"""A listing as the structure of MATLAB's ``datcomimport``, in a MAT file of version 5."""

from __future__ import annotations

import os
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.io import savemat

from datcom_io.arrays.conditions import control_surface, parse_configuration
from datcom_io.cells import ABSENT, BLANK, FILLED, FLAGS, OK, SUSPECT
from datcom_io.decks.deck import Deck
from datcom_io.exchange.matlab_fields import (
    BUILD,
    MISSING,
    Field,
    Units,
    field_dimension,
    select_fields,
)
from datcom_io.listing import Case, Listing
from flightmech.support.atomic_write import written_atomically

_SURFACES = {
    "body": "BODY",
    "wing": "WGPLNF",
    "htail": "HTPLNF",
    "vtail": "VTPLNF",
    "vfin": "VFPLNF",
}
_UPRIGHT = frozenset(("fin", "panels"))
_NUMBER = (OK, FILLED, SUSPECT)
_NOT_THERE = (ABSENT, BLANK)
_EMPTY = np.zeros((0, 0))
_NO_FIELD = (
    "velocity, pressure, temperature and Reynolds number of the flight conditions, the "
    "moment centre, notes, messages, "
    "line numbers and airfoil pages have no field"
)


class MachAltitudeGrid(NamedTuple):
    """Mach numbers, altitudes [unit of the deck], how they step, and index of both for every flight
    condition in order.
    """

    machs: list[float]
    alts: list[float]
    loop: int
    places: list[tuple[int, int]]


def write_matlab(
    listing: Listing, path: str | os.PathLike[str], *, usenan: bool = True
) -> list[str]:
    """Write a listing as the structure that MATLAB's ``datcomimport`` returns.

    Parameters
    ----------
    listing : Listing
    path : path
        MAT file (version 5) to write atomically: variable ``aero``, a cell array with one structure
        per case, and ``history``, a text that states what was done and what was left out.
    usenan : bool
        NaN, otherwise 0, where the program prints NDM, NA or no number.  A place without a page
        holds 99999.

    Returns
    -------
    list of str
        What the structure has no room for; nothing is left out silently.

    Notes
    -----
    Numbers are as printed: units of card DIM, slopes per degree or radian by card DERIV.  Columns that the program prints in the
    first row only, because they are constant in alpha, hold their value in every row.  ``grndht`` holds the heights in the unit
    of card DIM and Inf for free air, last.
    """
    cells = np.empty((1, len(listing)), object)
    left_out = [_NO_FIELD]
    for k, case in enumerate(listing):
        cells[0, k], lost = make_case_structure(case, usenan=usenan)
        left_out += [f"{case.name}: {text}" for text in lost]
    if listing.unparsed:
        left_out.append(f"{len(listing.unparsed)} pages that are located only")
    history = "\n".join(
        [
            f"written from {listing.file} by aeromatch; constant columns stand in every row; "
            f"left out:",
            *left_out,
        ]
    )
    with written_atomically(path) as part:
        savemat(
            part,
            {"aero": cells, "history": history},
            appendmat=False,
            format="5",
            long_field_names=True,
            oned_as="row",
        )
    return left_out


def make_case_structure(case: Case, *, usenan: bool = True) -> tuple[dict[str, Any], list[str]]:
    """Return the structure of one case as a dict, and what it has no room for."""
    tree = case.to_datatree()
    units = Units(
        case.deck.dim, case.deck.deriv, "psi" if case.deck.values("FLTCON", "PINF") else "psf"
    )
    grid = _grid(case, tree, units)
    clean = [leaf for name, leaf in tree.children.items() if name in ("static", "dynamic")]
    build = (
        10 if case.deck.has("BUILD") or any("configuration" in leaf.dims for leaf in clean) else 1
    )
    found, lost = _scalars(case, tree, grid, build, units), _Lost(tree, grid)
    device = "delta_e" if control_surface(case.deck) == "tail" else "delta_f"
    arrays = _Arrays(grid, build, device, _deltas(case.deck), units, usenan, lost)
    for field in select_fields(int(case.deck.value("ASYFLP", "STYPE") or 0)):
        leaf = tree.children.get(field.leaf)
        quantity = (
            "CF_stick"
            if leaf is not None and field.name == "fc_con" and "CF_stick" in leaf
            else field.quantity
        )
        if leaf is None or quantity not in leaf.variables:
            continue
        field = field._replace(
            quantity=quantity, units="1" if quantity == "CF_stick" else field.units
        )
        array = arrays.array(field, leaf.to_dataset(inherit=False))
        if array is not None:
            found[field.name] = _trimmed(array)
    return found, lost.texts()


def _grid(case: Case, tree: xr.DataTree, units: Units) -> MachAltitudeGrid:
    """Return where each flight condition stands: by the input cards, or as pairs where they do not
    state it.
    """
    deck = case.deck
    leaf = next((leaf for leaf in tree.children.values() if "condition" in leaf.dims), None)
    schedule = deck.conditions()
    count = len(schedule) if leaf is None else leaf.sizes["condition"]
    machs, alts = deck.schedule("FLTCON", "MACH", "NMACH"), deck.schedule("FLTCON", "ALT", "NALT")
    if leaf is not None and len(schedule) != count:
        conditions = leaf.to_dataset(inherit=False)
        machs = conditions["mach"].values.tolist()
        alts = np.round(conditions["h"].values / units.factor("length"), 6).tolist()
        alts = [] if np.isnan(alts).all() else alts
        return MachAltitudeGrid(machs, alts, 1, [(k, k if alts else 0) for k in range(count)])
    if deck.loop == 1:
        return MachAltitudeGrid(
            machs[:count], alts[:count], 1, [(k, k if alts else 0) for k in range(count)]
        )
    if deck.loop == 2:
        return MachAltitudeGrid(
            machs, alts, 2, [(k % len(machs), k // len(machs)) for k in range(count)]
        )
    each = max(len(alts), 1)
    return MachAltitudeGrid(machs, alts, 3, [(k // each, k % each) for k in range(count)])


def _scalars(
    case: Case, tree: xr.DataTree, grid: MachAltitudeGrid, build: int, units: Units
) -> dict[str, Any]:
    """Return what stands before the tables."""
    deck = case.deck

    def reference(name: str, kind: str, variable: str) -> Any:
        found = tree.attrs.get(name)
        given = deck.value("OPTINS", variable)
        value = round(float(found) / units.factor(kind), 9) if found is not None else given
        return _EMPTY if value is None else value

    def flag(*namelists: str) -> bool:
        return any(name in deck.namelists for name in namelists)

    def number(namelist: str, variable: str, default: Any) -> Any:
        found = deck.value(namelist, variable)
        return default if found is None else found

    deltas = _deltas(deck)
    left, right = (deck.schedule("ASYFLP", name, "NDELTA") for name in ("DELTAL", "DELTAR"))
    heights = _heights(tree, units.factor("length"))
    return {
        "case": deck.caseid or _EMPTY,
        "mach": _row(grid.machs),
        "alt": _row(grid.alts),
        "alpha": _row(deck.schedule("FLTCON", "ALSCHD", "NALPHA") or _alphas(tree)),
        "nmach": float(len(grid.machs)),
        "nalt": float(len(grid.alts)),
        "nalpha": float(len(deck.schedule("FLTCON", "ALSCHD", "NALPHA") or _alphas(tree))),
        "rnnub": _row(deck.values("FLTCON", "RNNUB")),
        "hypers": bool(deck.value("FLTCON", "HYPERS")),
        "loop": float(grid.loop),
        "sref": reference("S", "area", "SREF"),
        "cbar": reference("cbar", "length", "CBARR"),
        "blref": reference("b", "length", "BLREF"),
        "dim": deck.dim.lower(),
        "deriv": deck.deriv.lower(),
        "stmach": number("FLTCON", "STMACH", 0.6),
        "tsmach": number("FLTCON", "TSMACH", 1.4),
        "save": deck.has("SAVE"),
        "stype": number("ASYFLP", "STYPE", _EMPTY),
        "trim": deck.has("TRIM"),
        "damp": deck.has("DAMP"),
        "build": float(build),
        "part": deck.has("PART"),
        "highsym": flag("SYMFLP"),
        "highasy": flag("ASYFLP"),
        "highcon": flag("CONTAB"),
        "tjet": flag("TRNJET"),
        "hypeff": flag("HYPEFF"),
        "lb": flag("LARWB"),
        "pwr": flag("PROPWR", "JETPWR"),
        "grnd": flag("GRNDEF"),
        "wsspn": number("WGPLNF", "SSPN", 1.0),
        "hsspn": number("HTPLNF", "SSPN", 1.0),
        "ndelta": float(max(len(deltas), len(left), int(deck.value("ASYFLP", "NDELTA") or 0))),
        "delta": _row(deltas),
        "deltal": _row(left),
        "deltar": _row(right),
        "ngh": float(max(len(heights) - 1, 0)),
        "grndht": _row(heights),
        "config": {name: flag(namelist) for name, namelist in _SURFACES.items()},
        "version": 1976.0,
    }


def _row(values: list[float]) -> np.ndarray:
    return np.array(values, float).reshape(1, -1) if values else _EMPTY


def _deltas(deck: Deck) -> list[float]:
    """Return the deflections of a symmetric device on the cards. [deg]"""
    return deck.schedule("SYMFLP", "DELTA", "NDELTA") or deck.schedule("HYPEFF", "HDELTA", "HNDLTA")


def _alphas(tree: xr.DataTree) -> list[float]:
    """Return printed angles of attack of a case without cards. [deg]"""
    leaf = next(
        (leaf.to_dataset(inherit=False) for leaf in tree.children.values() if "alpha" in leaf.dims),
        None,
    )
    return [] if leaf is None else np.round(np.rad2deg(leaf["alpha"].values), 9).tolist()


def _heights(tree: xr.DataTree, unit: float) -> list[float]:
    static = tree.children.get("static")
    if static is None or "ground_height" not in static.dims:
        return []
    return np.round(static.to_dataset(inherit=False)["ground_height"].values / unit, 9).tolist()


class _Arrays(NamedTuple):
    """Makes the arrays of a case."""

    grid: MachAltitudeGrid
    build: int
    device: str
    deltas: list[float]
    units: Units
    usenan: bool
    lost: _Lost

    def array(self, field: Field, leaf: xr.Dataset) -> np.ndarray | None:
        """Return one field with its indices in order, None where nothing of it is printed."""
        for axis, label in field.at:
            if axis in leaf.dims and label in leaf[axis].values:
                leaf = leaf.sel({axis: label})
            elif axis in leaf.dims or str(leaf[axis].values) != label:
                return None
        leaf = self._of_the_cards(leaf, field.leaf)
        value = leaf[field.quantity]
        flag = (
            leaf[f"{field.quantity}_flag"]
            if f"{field.quantity}_flag" in leaf
            else xr.zeros_like(value, dtype=np.uint8)
        )
        if "power" in value.dims:
            kept = next((i for i, name in enumerate(leaf["power"].values) if name == "off"), 0)
            self.lost.power(field.leaf, leaf["power"].values.tolist(), kept)
            value, flag = value.isel(power=kept), flag.isel(power=kept)
        others = [axis for axis in field.axes if axis not in ("mach", "alt")]
        dims = ["condition", *(field_dimension(field, axis, self.device) for axis in others)]
        numbers, flags = (_with_dims(item, dims, leaf.sizes["condition"]) for item in (value, flag))
        self.lost.taken(field, flags)
        if (flags == ABSENT).all():
            return None
        printed = numbers if field.units == "text" else self._as_printed(field, numbers, flags)
        if "build" in others:
            names = np.atleast_1d(leaf["configuration"].values).tolist()
            self.lost.more |= {
                f"the words TWIN VERTICAL PANEL in configuration {name}"
                for name in names
                if "panels" in parse_configuration(name)
            }
            if self.build == len(BUILD):
                printed = _along_build(
                    printed, others.index("build") + 1, names, field.leaf, self.lost
                )
        out = self._over_grid(printed, leaf, field)
        order = ["mach", "alt", *others]
        if "alt" not in field.axes:
            there = [j for j in range(out.shape[1]) if (out[:, j] != MISSING).any()]
            self.lost.more |= {
                f"leaf {field.leaf} at altitude {self.grid.alts[j]:g}" for j in there[1:]
            }
            out = out[:, there[0] if there else 0]
            order.remove("alt")
        return out.transpose([order.index(axis) for axis in field.axes])

    def _of_the_cards(self, leaf: xr.Dataset, name: str) -> xr.Dataset:
        """Return a leaf with the deflections of the cards: the structure has no room for the clean
        page of a run in ground effect.
        """
        if self.device not in leaf.dims or leaf.sizes[self.device] <= max(len(self.deltas), 1):
            return leaf
        printed = np.round(np.rad2deg(leaf[self.device].values), 6)
        kept = np.isin(printed, np.round(self.deltas, 6))
        self.lost.more |= {
            f"{self.device} {angle:g} deg of leaf {name}" for angle in printed[~kept]
        }
        return leaf.isel({self.device: kept})

    def _as_printed(self, field: Field, numbers: np.ndarray, flags: np.ndarray) -> np.ndarray:
        without = np.where(np.isin(flags, _NOT_THERE), MISSING, np.nan if self.usenan else 0.0)
        return np.where(np.isin(flags, _NUMBER), numbers / self.units.factor(field.units), without)

    def _over_grid(self, printed: np.ndarray, leaf: xr.Dataset, field: Field) -> np.ndarray:
        """Return an array (mach, alt, ...) of one along conditions."""
        empty = "" if field.units == "text" else MISSING
        shape = (len(self.grid.machs), max(len(self.grid.alts), 1), *printed.shape[1:])
        out = np.full(shape, empty, object if field.units == "text" else float)
        for k, place in enumerate(self._places(leaf)):
            if place is None:
                self.lost.more.add(
                    f"condition {k} of leaf {field.leaf}: its Mach number and altitude are "
                    f"not those of the cards"
                )
            else:
                out[place] = printed[k]
        return out

    def _places(self, leaf: xr.Dataset) -> list[tuple[int, int] | None]:
        """Return the place of each condition of a leaf: all leaves have those of the case, but for
        special pages.
        """
        if leaf.sizes["condition"] == len(self.grid.places):
            return list(self.grid.places)
        known = {
            (self.grid.machs[i], round(self.grid.alts[j], 6) if self.grid.alts else None): (i, j)
            for i, j in self.grid.places
        }
        heights = np.round(leaf["h"].values / self.units.factor("length"), 6).tolist()
        machs = leaf["mach"].values.tolist()
        return [
            known.get((mach, height if self.grid.alts else None))
            for mach, height in zip(machs, heights)
        ]


def _with_dims(item: xr.DataArray, dims: list[str], count: int) -> np.ndarray:
    """Return an array with its dimensions in order, those it does not have with length one; a value
    for all conditions repeated.
    """
    found = item.expand_dims([dim for dim in dims if dim not in item.dims]).transpose(*dims).values
    return found if "condition" in item.dims else np.repeat(found, count, axis=0)


def configuration_index(configuration: str) -> int | None:
    """Return the place of a configuration along ``build``, None where it has none."""
    made_of = parse_configuration(configuration)
    if made_of & _UPRIGHT and made_of - _UPRIGHT:
        made_of = (made_of - _UPRIGHT) | {"vertical"}
    return BUILD.index(made_of) if made_of in BUILD else None


def _along_build(
    numbers: np.ndarray, axis: int, names: list[str], leaf: str, lost: _Lost
) -> np.ndarray:
    shape = list(numbers.shape)
    shape[axis] = len(BUILD)
    out, used = np.moveaxis(np.full(shape, MISSING), axis, 0), set()
    for i, name in enumerate(names):
        place = configuration_index(name)
        if place is None or place in used:
            lost.configurations.setdefault(name, set()).add(leaf)
            continue
        used.add(place)
        out[place] = np.moveaxis(numbers, axis, 0)[i]
    return np.moveaxis(out, 0, axis)


def _trimmed(array: np.ndarray) -> np.ndarray:
    """Return an array without the trailing indices of length one, which MATLAB does not keep."""
    while array.ndim > 2 and array.shape[-1] == 1:
        array = array[..., 0]
    return array.reshape(-1, 1) if array.ndim == 1 else array


class _Lost:
    """What of a case has no room in the structure."""

    def __init__(self, tree: xr.DataTree, grid: MachAltitudeGrid):
        self.tree, self.grid = tree, grid
        self.written: set[tuple[str, str]] = set()
        self.flag_counts: Counter[str] = Counter()
        self.configurations: dict[str, set[str]] = {}
        self.more: set[str] = set()

    def taken(self, field: Field, flags: np.ndarray) -> None:
        """Count the flags of a field that is written."""
        self.written.add((field.leaf, field.quantity))
        codes = np.bincount(flags.ravel(), minlength=len(FLAGS))
        self.flag_counts.update(
            {
                FLAGS[code]: int(count)
                for code, count in enumerate(codes)
                if count and code not in (OK, ABSENT)
            }
        )

    def power(self, leaf: str, settings: list[str], kept: int) -> None:
        """Note the pages with another power setting."""
        self.more |= {
            f"{leaf} pages with power {name}" for i, name in enumerate(settings) if i != kept
        }

    def texts(self) -> list[str]:
        """Return one line for each thing left out."""
        found = []
        for name, leaf in self.tree.children.items():
            names = [str(key) for key in leaf.data_vars if not str(key).endswith("_flag")]
            without = [key for key in names if (name, key) not in self.written]
            if without:
                found.append(
                    f"leaf {name}"
                    if len(without) == len(names)
                    else f"leaf {name}: {' '.join(without)}"
                )
        found += [
            f"configuration {name} of {' and '.join(sorted(leaves))}"
            for name, leaves in self.configurations.items()
        ]
        found += sorted(self.more)
        found += [
            f"leaf tabs: whether fc_con is {name}"
            for leaf, name in self.written
            if leaf == "tabs" and name in ("F_stick", "CF_stick")
        ]
        if self.flag_counts:
            counts = ", ".join(
                f"{count} {name}" for name, count in sorted(self.flag_counts.items())
            )
            found.append(f"which cells are what: {counts}")
        if "jet" in self.tree.children and "alpha" in self.tree["jet"].coords:
            found.append("leaf jet: the angle of attack at each time")
        for name, values in (("mach", self.grid.machs), ("alt", self.grid.alts)):
            if not (np.diff(values) > 0).all():
                found.append(
                    f"(nothing lost) {name} does not rise, as Simulink's block wants it to"
                )
        return found
