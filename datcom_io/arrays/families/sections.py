"""Leaves of the airfoil sections, which are printed once per case.

They are ``section`` over surface and Mach number, and ``coordinates`` over surface and point.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.arrays.stacking import Stacker
from datcom_io.printout.content import Page
from datcom_io.printout.layouts.auxiliary import SURFACES
from datcom_io.printout.layouts.sections import COORDINATES, SLOPE, SUMMARY
from datcom_io.printout.tables import PrintedTable
from flightmech.errors import ParseError

_HALF_UNIT = 0.5001e-4  # of the printed Mach number
_DESIGNATION = "name of a NACA section, empty for one that the user defines"


def _surface_of(page: Page) -> str:
    """Return the surface that a section page describes, empty for any other page."""
    heading = ""
    if page.heading:
        heading = page.heading[0]
    for name in SURFACES:
        if name in heading:
            return name
    return ""


def _surfaces_of(pages: Iterable[Page]) -> list[str]:
    """Return the surfaces of section pages in the order of the program."""
    printed = {_surface_of(page) for page in pages}
    return [name for name in SURFACES if name in printed]


def stack_section(stacker: Stacker) -> LeafBuilder | None:
    """Stack the results of the section module."""
    case = stacker.case
    # Section pages belong to no flight condition, so they are taken from the case itself.
    summaries = [(page, group) for page, group in case.values("section") if _surface_of(page)]
    slopes = [(page, table) for page, table in case.tables(SLOPE.name) if _surface_of(page)]
    if not summaries and not slopes:
        return None
    pages = [page for page, _ in summaries]
    pages += [page for page, _ in slopes]
    surfaces = _surfaces_of(pages)
    machs = case.deck.schedule("FLTCON", "MACH", "NMACH")
    if not machs:
        # Without cards the longest table has the Mach numbers.
        printed = [table.values[:, 0].tolist() for _, table in slopes]
        machs = max(printed, key=len, default=[])
    sheet = NumberStack(stacker, {"surface": [name.lower() for name in surfaces], "mach": machs})
    numbers: list[Item] = []
    for page, group in summaries:
        numbers.append(((surfaces.index(_surface_of(page)),), page, labelled_numbers(group)))
    for form in SUMMARY:
        sheet.add(form.numbers, ("surface",), numbers)
    # Lift slope and aerodynamic centre are printed for the subsonic Mach numbers.
    rows: list[Item] = []
    for page, table in slopes:
        surface = surfaces.index(_surface_of(page))
        for k, mach_index in enumerate(_mach_indices(stacker, table, machs)):
            rows.append(((surface, mach_index), page, row_numbers(table, k)))
    sheet.add(SLOPE.columns[1:], ("surface", "mach"), rows)
    leaf = sheet.finish()
    # The dimension mach is joined between runs, so provenance goes along it as well.
    lines = np.repeat(leaf["lines"].values[:, None], len(machs), axis=1)
    leaf.coords["lines"] = xr.Variable(("surface", "mach"), lines)
    for name, text in (("case", case.name), ("file", case.file)):
        leaf.coords[name] = xr.Variable("mach", [text] * len(machs))
    return leaf


def _mach_indices(stacker: Stacker, table: PrintedTable, machs: Sequence[float]) -> list[int]:
    """Return the index of each printed Mach number in the schedule.

    The program leaves some Mach numbers out, but keeps their order.
    """
    indices: list[int] = []
    start = 0
    for line, mach in zip(table.lines, table.values[:, 0].tolist()):
        index = start
        while index < len(machs) and not abs(machs[index] - mach) <= _HALF_UNIT:
            index += 1
        if index == len(machs):
            expected = "one of the Mach numbers of the input cards, in their order"
            raise ParseError(stacker.case.file, line, f"MACH = {mach:g}", expected)
        indices.append(index)
        start = index + 1
    return indices


def stack_coordinates(stacker: Stacker) -> LeafBuilder | None:
    """Stack the coordinates of the sections."""
    case = stacker.case
    tables = [(page, table) for page, table in case.tables(COORDINATES.name) if _surface_of(page)]
    if not tables:
        return None
    surfaces = _surfaces_of(page for page, _ in tables)
    points = range(max(len(table.rows) for _, table in tables))
    sheet = NumberStack(stacker, {"surface": [name.lower() for name in surfaces], "point": points})
    items: list[Item] = []
    for page, table in tables:
        surface = surfaces.index(_surface_of(page))
        for k in range(len(table.rows)):
            items.append(((surface, k), page, row_numbers(table, k)))
    sheet.add(COORDINATES.columns, ("surface", "point"), items)
    # The designation has one or two texts: the name, and the mean line of a 6-series section.
    designations = {}
    for page, group in case.values("designation"):
        designations[_surface_of(page)] = " ".join(group.texts)
    names = [designations.get(surface, "") for surface in surfaces]
    sheet.leaf.coords["designation"] = xr.Variable("surface", names, {"long_name": _DESIGNATION})
    return sheet.finish(file=case.file)


LEAVES = {"section": stack_section, "coordinates": stack_coordinates}
