"""Leaves of the airfoil sections, once per case: ``section`` over surface and Mach number,
``coordinates`` over surface and point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.stacking import LeafBuilder, Stacker
from datcom_io.printout.content import Page
from datcom_io.printout.layouts.auxiliary import SURFACES
from datcom_io.printout.layouts.sections import COORDINATES, SLOPE, SUMMARY
from datcom_io.printout.tables import PrintedTable
from flightmech.errors import ParseError

_HALF_UNIT = 0.5001e-4  # of the printed Mach number
_NAMES = {
    "alpha_ideal": "ideal angle of attack of the section",
    "alpha_zero_lift": "angle of attack of the section at zero lift",
    "CL_ideal": "lift coefficient of the section at the ideal angle of attack",
    "Cm_zero_lift": "pitching-moment coefficient of the section at zero lift, about the quarter "
    "chord",
    "CL_alpha_mach_zero": "lift-curve slope of the section at Mach 0",
    "leading_edge_radius": "leading-edge radius, in chords",
    "thickness_ratio": "greatest thickness, in chords",
    "delta_y": "difference of the upper ordinates at 6 and 0.15 % chord, in chords",
    "mach_crest": "crest-critical Mach number",
    "x_crest": "crest behind the leading edge, in chords",
    "CL_alpha_crest": "lift-curve slope of the section at the crest-critical Mach number, used "
    "above it",
    "CL_alpha": "lift-curve slope of the section, absent from the crest-critical Mach number on",
    "xac": "aerodynamic centre of the section behind the leading edge, in chords",
    "designation": "name of a NACA section, empty for one that the user defines",
}
_COORDINATE_NAMES = {
    "x_upper": "upper surface behind the leading edge, in chords",
    "z_upper": "upper surface above the chord line, in chords",
    "x_lower": "lower surface behind the leading edge, in chords",
    "z_lower": "lower surface above the chord line, in chords",
    "x": "station of mean line and thickness behind the leading edge, in chords",
    "mean_line": "mean line above the chord line, in chords",
    "thickness": "thickness, in chords",
    "designation": _NAMES["designation"],
}


def _surface(page: Page) -> str:
    """Return the surface that a section page describes."""
    words = page.heading[0] if page.heading else ""
    return next((name for name in SURFACES if name in words), "")


def _surfaces(pages: Sequence[Page]) -> list[str]:
    found = {_surface(page) for page in pages}
    return [name for name in SURFACES if name in found]


def stack_section(stacker: Stacker) -> LeafBuilder | None:
    """Stack what the section module computes."""
    case = stacker.case
    summaries = [(page, group) for page, group in case.values("section") if _surface(page)]
    slopes = [(page, table) for page, table in case.tables(SLOPE.name) if _surface(page)]
    if not summaries and not slopes:
        return None
    surfaces = _surfaces([page for page, _ in (*summaries, *slopes)])
    machs = case.deck.schedule("FLTCON", "MACH", "NMACH")
    machs = machs or max((table.values[:, 0].tolist() for _, table in slopes), key=len, default=[])
    sheet = NumberStack(stacker, {"surface": [name.lower() for name in surfaces], "mach": machs})
    single = [column for form in SUMMARY for column in form.numbers]
    sheet.add(
        single,
        ("surface",),
        (
            ((surfaces.index(_surface(page)),), page, labelled_numbers(group))
            for page, group in summaries
        ),
    )
    items: list[Item] = []
    for page, table in slopes:
        places = _places(stacker, table, machs)
        items += [
            ((surfaces.index(_surface(page)), place), page, row_numbers(table, k))
            for k, place in enumerate(places)
        ]
    sheet.add(SLOPE.columns[1:], ("surface", "mach"), items)
    found = sheet.finished(_NAMES)
    found.coords["lines"] = xr.Variable(
        ("surface", "mach"), np.repeat(found["lines"].values[:, None], len(machs), axis=1)
    )
    for name, text in (("case", case.name), ("file", case.file)):
        found.coords[name] = xr.Variable("mach", [text] * len(machs))
    return found


def _places(stacker: Stacker, table: PrintedTable, machs: Sequence[float]) -> list[int]:
    """Return the index of each printed Mach number in the schedule; some are not printed, but none
    out of turn.
    """
    places, at = [], 0
    for line, mach in zip(table.lines, table.values[:, 0].tolist()):
        at = next((k for k in range(at, len(machs)) if abs(machs[k] - mach) <= _HALF_UNIT), -1) + 1
        if not at:
            expected = "one of the Mach numbers of the input cards, in their order"
            raise ParseError(stacker.case.file, line, f"MACH = {mach:g}", expected)
        places.append(at - 1)
    return places


def stack_coordinates(stacker: Stacker) -> LeafBuilder | None:
    """Stack the coordinates of the sections."""
    tables = [
        (page, table) for page, table in stacker.case.tables(COORDINATES.name) if _surface(page)
    ]
    if not tables:
        return None
    surfaces = _surfaces([page for page, _ in tables])
    points = range(max(len(table.rows) for _, table in tables))
    sheet = NumberStack(stacker, {"surface": [name.lower() for name in surfaces], "point": points})
    items = (
        ((surfaces.index(_surface(page)), k), page, row_numbers(table, k))
        for page, table in tables
        for k in range(len(table.rows))
    )
    sheet.add(COORDINATES.columns, ("surface", "point"), items)
    names = {
        _surface(page): " ".join(group.texts) for page, group in stacker.case.values("designation")
    }
    designations = [names.get(surface, "") for surface in surfaces]
    sheet.leaf.coords["designation"] = xr.Variable("surface", designations)
    return sheet.finished(_COORDINATE_NAMES, file=stacker.case.file)


LEAVES = {"section": stack_section, "coordinates": stack_coordinates}
