"""Flight conditions, pages and configurations of a case in a plot file (unit 13)."""

from __future__ import annotations

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import printed_name
from datcom_io.exchange.plot_records import PlotCase, PlotRecord
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
MOST_ANGLES = 20  # in a block
_MOST_HEIGHTS = 10
_ALPHA_ATTRS = {"units": "rad", "sign": "ANU", "long_name": "angle of attack"}

PlotPage = dict[str, PlotRecord]
"""Records of a static page by name."""


def run_schedule(case: PlotCase) -> list[tuple[float, float]]:
    """Return Mach number and altitude [ft] in the order of the run."""
    # FLC: 1 NMACH, 3 MACH(20), 97 ALT(20), 159 NALT, 160 LOOP.
    flight = case.records["FLC"]
    machs = flight.numbers(3, 22)[0][: flight.count(1, MOST_ANGLES)]
    heights = flight.numbers(97, 116)[0][: flight.count(159, MOST_ANGLES)]
    loop = flight.number(160)
    if not len(heights):
        # With LOOP=1 both lists step together.
        count = 1 if loop in (2.0, 3.0) else len(machs)
        heights = np.full(count, np.nan)
    if loop not in (2.0, 3.0):
        return list(zip(machs, heights))
    pairs = []
    if loop == 2.0:
        for height in heights:
            pairs += [(mach, height) for mach in machs]
    else:
        for mach in machs:
            pairs += [(mach, height) for height in heights]
    return pairs


def ground_heights(case: PlotCase) -> np.ndarray:
    """Return the heights over ground of the case. [ft]"""
    # FLC: 63 NGH, 64 GRDHT(10).
    flight = case.records["FLC"]
    return flight.numbers(64, 73)[0][: flight.count(63, _MOST_HEIGHTS)]


def angles_of_attack(case: PlotCase) -> np.ndarray:
    """Return the angles of attack. [deg]"""
    # FLC: 2 NALPHA, 23 ALSCHD(20).
    flight = case.records["FLC"]
    return flight.numbers(23, 42)[0][: flight.count(2, MOST_ANGLES)]


def pages_by_condition(case: PlotCase) -> list[list[PlotPage]]:
    """Return the pages of each flight condition.

    The page in free air comes first, then deflection by deflection the pages over ground.
    """
    heights, count = len(ground_heights(case)), len(run_schedule(case))
    per_condition = 1
    if heights and count and len(case.pages) % count == 0:
        pages = len(case.pages) // count
        # All deflections have the same heights.
        if pages >= 1 and (pages - 1) % heights == 0:
            per_condition = pages
    starts = range(0, len(case.pages), per_condition)
    return [case.pages[start : start + per_condition] for start in starts]


def free_air_pages(case: PlotCase) -> list[PlotPage]:
    """Return the page in free air of each flight condition."""
    return [pages[0] for pages in pages_by_condition(case)]


def condition_coords(case: PlotCase) -> dict[str, xr.Variable]:
    """Return Mach number, altitude and line of each flight condition."""
    pages, schedule = free_air_pages(case), run_schedule(case)
    count = len(pages)
    if len(schedule) != count:
        schedule = [(np.nan, np.nan)] * count
    pairs = np.array(schedule, float).reshape(count, 2)
    lines = np.array([page["BODY"].line for page in pages], int)
    return {
        "condition": xr.Variable("condition", np.arange(count)),
        "mach": xr.Variable("condition", pairs[:, 0], {"units": "1"}),
        "h": xr.Variable("condition", pairs[:, 1] * FOOT, {"units": "m"}),
        "line": xr.Variable("condition", lines),
    }


def alpha_coord(case: PlotCase) -> xr.Variable:
    """Return the coordinate of the angles of attack."""
    return xr.Variable("alpha", angles_of_attack(case) * DEGREE, _ALPHA_ATTRS)


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
    # FLC: 94 STMACH, 95 TSMACH.
    flight = case.records["FLC"]
    low, high = flight.number(94), flight.number(95)
    machs = [mach for mach, _ in run_schedule(case)]
    count = len(free_air_pages(case))
    if len(machs) != count:
        return [True] * count
    return [low < mach < high for mach in machs]
