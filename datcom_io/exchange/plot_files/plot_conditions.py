"""Coordinates and configurations of a case in a plot file (unit 13)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import printed_name
from datcom_io.exchange.plot_files.plot_cases import PlotCase
from datcom_io.exchange.plot_files.plot_schedule import angles_of_attack
from flightmech.units import DEGREE, FOOT

# Logical of a surface to the part of the aeroplane.
_SURFACES = {
    "BO": "body",
    "WGPL": "wing",
    "HTPL": "horizontal",
    "VTPL": "vertical",
    "VFPL": "fin",
    "TVTPAN": "panels",
}
# Parts of each configuration; upright stands for vertical tail, fin and panels together.
_PARTS_OF_BLOCK = {
    "BODY": "body",
    "WING": "wing",
    "HT": "horizontal",
    "VT": "vertical",
    "VF": "fin",
    "BW": "body wing",
    "BH": "body horizontal",
    "BV": "body upright",
    "BWH": "body wing horizontal",
    "BWV": "body wing upright",
    "BWHV": "body wing horizontal upright",
}
_UPRIGHT = ("vertical", "fin", "panels")
_ALPHA_ATTRS = {"units": "rad", "sign": "ANU", "long_name": "angle of attack"}


def condition_coords(case: PlotCase) -> dict[str, xr.Variable]:
    """Return Mach number, altitude and line of each flight condition of the run."""
    conditions = case.conditions
    machs = np.array([condition.scheduled.mach for condition in conditions], float)
    heights = np.array([condition.scheduled.height for condition in conditions], float)
    lines = np.array([condition.line for condition in conditions], int)
    return {
        "condition": xr.Variable("condition", np.arange(len(conditions))),
        "mach": xr.Variable("condition", machs, {"units": "1"}),
        "h": xr.Variable("condition", heights * FOOT, {"units": "m"}),
        "line": xr.Variable("condition", lines),
    }


def alpha_coord(case: PlotCase) -> xr.Variable:
    """Return the coordinate of the angles of attack."""
    return xr.Variable("alpha", angles_of_attack(case.flight) * DEGREE, _ALPHA_ATTRS)


def real_configurations(case: PlotCase) -> dict[str, str]:
    """Return block and printed name of the configurations that the case has."""
    surfaces = [part for word, part in _SURFACES.items() if case.logicals[word]]
    upright = " ".join(part for part in surfaces if part in _UPRIGHT)
    names = {}
    for block, text in _PARTS_OF_BLOCK.items():
        if "upright" in text and not upright:
            continue
        made_of = frozenset(text.replace("upright", upright).split())
        if made_of <= set(surfaces):
            names[block] = printed_name(made_of)
    return names


def transonic_conditions(case: PlotCase) -> list[bool]:
    """Return whether each flight condition is transonic, or not known to be in another regime."""
    return ["transonic" in condition.scheduled.regimes for condition in case.conditions]
