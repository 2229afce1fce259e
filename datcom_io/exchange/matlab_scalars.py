"""Scalars and breakpoints of the structure that MATLAB's ``datcomimport`` returns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from datcom_io.decks.deck import Deck
from datcom_io.exchange.matlab_fields import Units
from datcom_io.listing import Case

# Field of the structure ``config`` to the namelist of the surface.
_SURFACES = {
    "body": "BODY",
    "wing": "WGPLNF",
    "htail": "HTPLNF",
    "vtail": "VTPLNF",
    "vfin": "VFPLNF",
}
_EMPTY = np.zeros((0, 0))


class MachAltitudeGrid(NamedTuple):
    """Mach numbers and altitudes [unit of the deck] of a case.

    ``loop`` is how they step, as card LOOP states; ``indices`` are those of Mach number and
    altitude for every flight condition in order.
    """

    machs: list[float]
    alts: list[float]
    loop: int
    indices: list[tuple[int, int]]


def case_scalars(
    case: Case, tree: xr.DataTree, grid: MachAltitudeGrid, *, build: int, units: Units
) -> dict[str, Any]:
    """Return the fields before the tables, in the order of MATLAB.

    `build` is the length of the index of the same name.
    """
    deck = case.deck
    alphas = deck.schedule("FLTCON", "ALSCHD", "NALPHA") or _printed_alphas(tree)
    deltas = symmetric_deflections(deck)
    left_deltas = deck.schedule("ASYFLP", "DELTAL", "NDELTA")
    right_deltas = deck.schedule("ASYFLP", "DELTAR", "NDELTA")
    asymmetric_count = int(deck.value("ASYFLP", "NDELTA") or 0)
    heights = _ground_heights(tree, units.factor("length"))
    # Names and order are those of the reference page of datcomimport.
    flight = {
        "case": deck.caseid or _EMPTY,
        "mach": _row_vector(grid.machs),
        "alt": _row_vector(grid.alts),
        "alpha": _row_vector(alphas),
        "nmach": float(len(grid.machs)),
        "nalt": float(len(grid.alts)),
        "nalpha": float(len(alphas)),
        "rnnub": _row_vector(deck.values("FLTCON", "RNNUB")),
        "hypers": bool(deck.value("FLTCON", "HYPERS")),
        "loop": float(grid.loop),
        "sref": _reference(case, tree, "S", variable="SREF", factor=units.factor("area")),
        "cbar": _reference(case, tree, "cbar", variable="CBARR", factor=units.factor("length")),
        "blref": _reference(case, tree, "b", variable="BLREF", factor=units.factor("length")),
        "dim": deck.dim.lower(),
        "deriv": deck.deriv.lower(),
        "stmach": _number(deck, "FLTCON", "STMACH", default=0.6),
        "tsmach": _number(deck, "FLTCON", "TSMACH", default=1.4),
    }
    geometry = {
        "wsspn": _number(deck, "WGPLNF", "SSPN", default=1.0),
        "hsspn": _number(deck, "HTPLNF", "SSPN", default=1.0),
        "ndelta": float(max(len(deltas), len(left_deltas), asymmetric_count)),
        "delta": _row_vector(deltas),
        "deltal": _row_vector(left_deltas),
        "deltar": _row_vector(right_deltas),
        # Free air is not a ground height, but stands last among them.
        "ngh": float(max(len(heights) - 1, 0)),
        "grndht": _row_vector(heights),
        "config": {name: namelist in deck.namelists for name, namelist in _SURFACES.items()},
        "version": 1976.0,
    }
    return {**flight, **_card_flags(deck, build), **geometry}


def _card_flags(deck: Deck, build: int) -> dict[str, Any]:
    """Return the fields that state which cards and namelists a case has."""
    return {
        "save": deck.has("SAVE"),
        "stype": _number(deck, "ASYFLP", "STYPE", default=_EMPTY),
        "trim": deck.has("TRIM"),
        "damp": deck.has("DAMP"),
        "build": float(build),
        "part": deck.has("PART"),
        "highsym": "SYMFLP" in deck.namelists,
        "highasy": "ASYFLP" in deck.namelists,
        "highcon": "CONTAB" in deck.namelists,
        "tjet": "TRNJET" in deck.namelists,
        "hypeff": "HYPEFF" in deck.namelists,
        "lb": "LARWB" in deck.namelists,
        "pwr": "PROPWR" in deck.namelists or "JETPWR" in deck.namelists,
        "grnd": "GRNDEF" in deck.namelists,
    }


def _reference(case: Case, tree: xr.DataTree, name: str, *, variable: str, factor: float) -> Any:
    """Return a reference quantity of the pages in the unit of the print, or that of the cards."""
    value = tree.attrs.get(name)
    if value is not None:
        return round(float(value) / factor, 9)
    return _number(case.deck, "OPTINS", variable, default=_EMPTY)


def _number(deck: Deck, namelist: str, variable: str, *, default: Any) -> Any:
    """Return a number of the cards, or the default."""
    value = deck.value(namelist, variable)
    if value is None:
        return default
    return value


def _row_vector(values: list[float]) -> np.ndarray:
    if not values:
        return _EMPTY
    return np.array(values, float).reshape(1, -1)


def symmetric_deflections(deck: Deck) -> list[float]:
    """Return the deflections of a symmetric device on the cards. [deg]"""
    return deck.schedule("SYMFLP", "DELTA", "NDELTA") or deck.schedule("HYPEFF", "HDELTA", "HNDLTA")


def _printed_alphas(tree: xr.DataTree) -> list[float]:
    """Return the printed angles of attack of a case without cards. [deg]"""
    for leaf in tree.children.values():
        if "alpha" in leaf.dims:
            alphas = leaf.to_dataset(inherit=False)["alpha"].values
            return np.round(np.rad2deg(alphas), 9).tolist()
    return []


def _ground_heights(tree: xr.DataTree, unit: float) -> list[float]:
    """Return the heights over ground in the unit of the print, free air last."""
    static = tree.children.get("static")
    if static is None or "ground_height" not in static.dims:
        return []
    heights = static.to_dataset(inherit=False)["ground_height"].values
    return np.round(heights / unit, 9).tolist()
