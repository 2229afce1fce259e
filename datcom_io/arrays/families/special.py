"""Leaves of the special pages and of the weight lines: ``hypersonic jet weight``.

The hypersonic and the transverse-jet pages do not print a line of flight conditions.  They come
once per condition in the order of the run.  The input cards therefore give Mach number and altitude
where they have as many conditions as there are pages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import PrintedCondition, nearest_exact, si_factor
from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    PrintedNumber,
    labelled_numbers,
)
from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.arrays.stacking import HALF_UNIT, StackedAxis, Stacker
from datcom_io.printout.content import Page
from datcom_io.printout.layouts.special import (
    HYPERSONIC,
    HYPERSONIC_FROM,
    JET_LAYER,
    JET_NUMBERS,
    JET_TIME,
)
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.errors import ParseError
from flightmech.units import FOOT

_HALF_UNIT_MACH = 0.005  # of the hypersonic page
_HALF_UNIT_REFERENCE = 0.0005  # ft2, ft
_SI = {"1/ft": "m-1", "lbf": "N", "psi": "Pa", "psf": "Pa", "lb/s": "kg s-1", "lb": "kg"}

PageTable = tuple[Page, PrintedTable]


def stack_hypersonic(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of a hypersonic flap, per metre of its span."""
    deck = stacker.case.deck
    tables = {layout.name: list(stacker.case.tables(layout.name)) for layout in HYPERSONIC}
    most = max(tables.values(), key=len)
    count = len(most)
    if not count:
        return None
    # All six tables of a page must agree in alpha and deflection.
    placed: list[PageTable] = []
    for pairs in tables.values():
        placed += pairs
    schedule = [pair for pair in deck.conditions() if pair[0] >= HYPERSONIC_FROM]
    headers = [_page_header(page) for page, _ in most]
    conditions = []
    for header, pair in zip(headers, _match_schedule(schedule, count)):
        conditions.append(_hypersonic_condition(stacker, header, pair))
    # These pages have conditions of their own, apart from those of the case.
    local = _stacker_over(stacker, conditions)
    deltas = _delta_axis(local, placed, deck.schedule("HYPEFF", "HDELTA", "HNDLTA"))
    alphas = _alpha_axis(local, placed)
    leaf = LeafBuilder(local.make_coords([local.condition_axis(), alphas, deltas]))
    shape = (count, len(alphas.values), len(deltas.values))
    for layout in HYPERSONIC:
        assert layout.across is not None
        column = layout.across.cell
        value, flag = empty_cells(shape)
        for k, (page, table) in enumerate(tables[layout.name]):
            # The first column of the table is alpha.
            numbers, codes = table.values[:, 1:], table.flags[:, 1:]
            rows, fields = numbers.shape
            flag[k, :rows, :fields] = codes
            value[k, :rows, :fields] = stacker.to_si(column, page, numbers, codes)
        _add_with_unit(leaf, column, ("condition", "alpha", "delta"), value=value, flag=flag)
    leaf.coords["lines"] = xr.Variable("condition", _ranges_of_pages(tables, count))
    reference = _reference_quantities(stacker, headers[0])
    return leaf.describe({}, **reference, moments="about the hinge line")


def _ranges_of_pages(tables: dict[str, list[PageTable]], count: int) -> np.ndarray:
    """Return the range of lines of each page, over its six tables in their order."""
    first: dict[int, int] = {}
    last: dict[int, int] = {}
    for pairs in tables.values():
        for k, (_, table) in enumerate(pairs):
            first.setdefault(k, table.lines[0])
            last[k] = table.lines[-1]
    return np.array([f"{first[k]}-{last[k]}" for k in range(count)])


def stack_jet(stacker: Stacker) -> LeafBuilder | None:
    """Stack the transverse jet over time."""
    placed = list(stacker.case.values("jet"))
    if not placed:
        return None
    deck = stacker.case.deck
    conditions = []
    for pair in _match_schedule(deck.conditions(), len(placed)):
        conditions.append(_condition_from_cards(stacker, pair))
    local = _stacker_over(stacker, conditions)
    times = _jet_times(stacker, [group for _, group in placed])
    axes = [local.condition_axis(), StackedAxis("time", times, "s")]
    leaf = LeafBuilder(local.make_coords(axes))
    shape = (len(placed), len(times))
    # A row of the page becomes a variable over time.
    for row in JET_NUMBERS:
        units = row.units
        if units == "pressure":
            units = _jet_pressure_unit(stacker)
        column = PrintedColumn(row.label, 0, 0, row.quantity, units, meaning=row.meaning)
        value, flag = empty_cells(shape)
        for k, (page, group) in enumerate(placed):
            index = _row_indices(stacker, group, row.label)
            numbers, codes = group.values[index], group.flags[index]
            value[k, : len(index)] = stacker.to_si(column, page, numbers, codes)
            flag[k, : len(index)] = codes
        _add_with_unit(leaf, column, ("condition", "time"), value=value, flag=flag)
    layer = np.full(shape, "", dtype=object)
    ranges = []
    for k, (_, group) in enumerate(placed):
        index = _row_indices(stacker, group, JET_LAYER.label)
        layer[k, : len(index)] = [group.texts[i] for i in index]
        ranges.append(f"{group.lines[0]}-{group.lines[-1]}")
    leaf.coords[JET_LAYER.quantity] = xr.Variable(("condition", "time"), layer.astype(str))
    # The page does not print the angle of attack of each time.
    angles = deck.schedule("TRNJET", "ALPHA", "NT")
    if len(angles) == len(times):
        leaf.coords["alpha"] = xr.Variable("time", np.radians(angles), {"units": "rad"})
    leaf.coords["lines"] = xr.Variable("condition", np.array(ranges))
    return leaf


def stack_weight(stacker: Stacker) -> LeafBuilder | None:
    """Stack weight and lift coefficient of level flight.

    They come from the first page of each condition that has them.
    """
    first_pages: dict[int, Page] = {}
    for spot, page, _ in stacker.placed_values("weight"):
        first_pages.setdefault(spot.condition, page)
    if not first_pages:
        return None
    items: list[Item] = []
    units = "lbf"
    for condition, page in first_pages.items():
        groups = page.groups("weight")
        # The first two lines are the weight and the lift coefficient.
        numbers: dict[str, PrintedNumber] = {}
        for group in groups[:2]:
            numbers |= labelled_numbers(group)
        items.append(((condition,), page, numbers))
        units = _first_unit(groups) or units
    weight = PrintedColumn("VEHICLE WEIGHT", 0, 0, "weight", units, meaning="weight as printed")
    lift = PrintedColumn(
        "LEVEL FLIGHT LIFT COEFFICIENT",
        0,
        0,
        "CL_level_flight",
        meaning="lift coefficient of level flight as printed",
    )
    sheet = NumberStack(stacker, {"condition": None})
    sheet.add([weight, lift], ("condition",), items)
    leaf = sheet.finish()
    leaf["weight"].attrs["units"] = "N"
    return leaf


def _first_unit(groups: list[PrintedValues]) -> str:
    """Return the first unit that some groups print, empty without any."""
    for group in groups:
        for unit in group.units:
            if unit:
                return unit
    return ""


# Flight conditions of the pages.


def _stacker_over(stacker: Stacker, conditions: list[PrintedCondition]) -> Stacker:
    """Return a stacker over the conditions of special pages."""
    return Stacker(stacker.case, conditions, {}, stacker.fill_transonic)


def _match_schedule(
    schedule: Sequence[tuple[float, float]], count: int
) -> list[tuple[float, float]]:
    """Return Mach number and altitude of the cards for each page. [1, deck unit]

    They are NaN unless the cards have as many conditions as there are pages.
    """
    if len(schedule) == count:
        return list(schedule)
    return [(math.nan, math.nan)] * count


def _condition_from_cards(stacker: Stacker, pair: tuple[float, float]) -> PrintedCondition:
    mach, height = pair
    h = height * si_factor("length", stacker.case.deck.dim)
    missing = math.nan
    return PrintedCondition(
        mach, h, V=missing, p_static=missing, temperature=missing, reynolds_per_m=missing
    )


def _hypersonic_condition(
    stacker: Stacker, header: dict[str, float], pair: tuple[float, float]
) -> PrintedCondition:
    """Return the condition of a hypersonic page.

    Mach and Reynolds number are the printed ones, the altitude is that of the cards.
    """
    mach = header.get("MACH NUMBER", math.nan)
    # Another Mach number on the page means that the cards are those of another condition.
    if abs(mach - pair[0]) > _HALF_UNIT_MACH * 1.001:
        pair = (math.nan, math.nan)
    condition = _condition_from_cards(stacker, pair)
    reynolds = header.get("REYNOLDS NO./FT", math.nan) / FOOT
    return condition._replace(
        mach=nearest_exact(mach, [pair[0]], _HALF_UNIT_MACH), reynolds_per_m=reynolds
    )


def _page_header(page: Page) -> dict[str, float]:
    """Return the numbers of the heading of a hypersonic page. [as printed]"""
    numbers = {}
    for group in page.groups("hypersonic"):
        for label, number in labelled_numbers(group).items():
            numbers[label] = number.value
    return numbers


def _reference_quantities(stacker: Stacker, header: dict[str, float]) -> dict[str, float]:
    """Return reference area and length of a hypersonic page. [m2, m]

    The digits of the cards are used where they print as the page shows.
    """
    deck = stacker.case.deck
    quantities = {}
    for name, label, variable, units, foot in (
        ("S", "REF. AREA (FT2)", "SREF", "area", FOOT**2),
        ("cbar", "LONG. REF. LENGTH(FT)", "CBARR", "length", FOOT),
    ):
        exact = []
        value = deck.value("OPTINS", variable)
        if value is not None:
            exact = [value * si_factor(units, deck.dim)]
        printed = header.get(label, math.nan) * foot
        quantities[name] = nearest_exact(printed, exact, _HALF_UNIT_REFERENCE * foot)
    return quantities


# Axes of the tables.


def _alpha_axis(stacker: Stacker, placed: list[PageTable]) -> StackedAxis:
    """Return alpha: the values of the deck, or the printed ones without a deck. [deg]

    All tables must agree with it.
    """
    printed = [(table.values[:, 0], table.lines) for _, table in placed]
    return _checked_axis(stacker, printed, "alpha", stacker.alphas())


def _delta_axis(stacker: Stacker, placed: list[PageTable], exact: Sequence[float]) -> StackedAxis:
    """Return the deflections: those of the deck, or the printed ones without a deck. [deg]

    All tables must agree with them.
    """
    printed: list[tuple[np.ndarray, Sequence[int]]] = []
    for _, table in placed:
        if table.across is not None:
            printed.append((table.across, [table.across_line] * len(table.across)))
    return _checked_axis(stacker, printed, "delta", exact)


def _checked_axis(
    stacker: Stacker,
    printed: Sequence[tuple[np.ndarray, Sequence[int]]],
    name: str,
    exact: Sequence[float],
) -> StackedAxis:
    values = list(exact)
    if not values:
        values = max((numbers for numbers, _ in printed), key=len).tolist()
    for numbers, lines in printed:
        stacker.check_axis(name.upper(), numbers, exact=values, lines=lines)
    return StackedAxis(name, values, "deg")


def _row_indices(stacker: Stacker, group: PrintedValues, label: str) -> list[int]:
    """Return the indices of one row of the jet page in its group."""
    # The labels of a group repeat, once for each time.
    indices = [k for k, row_label in enumerate(group.labels) if row_label == label]
    if indices and group.lines[indices[-1]] != group.lines[indices[0]]:
        raise ParseError(
            stacker.case.file,
            group.lines[indices[-1]],
            f"a second row {label}",
            "one row for each quantity of the jet",
        )
    return indices


def _jet_times(stacker: Stacker, groups: list[PrintedValues]) -> list[float]:
    """Return the times of the deck, or the printed ones without a deck. [s]

    All pages must agree with them.
    """
    rows = []
    for group in groups:
        indices = _row_indices(stacker, group, JET_TIME.label)
        if indices:
            rows.append((group.values[indices], [group.lines[k] for k in indices]))
    times = stacker.case.deck.schedule("TRNJET", "TIME", "NT")
    if not times:
        times = max((numbers for numbers, _ in rows), key=len).tolist()
    for numbers, lines in rows:
        stacker.check_axis("TIME", numbers, times, lines, half_unit=HALF_UNIT, units="s")
    return times


def _jet_pressure_unit(stacker: Stacker) -> str:
    """Return the unit of the pressures of the jet page.

    The method multiplies the free-stream pressure by factors.  From an altitude the program has it
    in pounds per square foot, in spite of the label; a pressure of the cards is taken as labelled.
    """
    if stacker.case.deck.values("FLTCON", "PINF"):
        return "psi"
    return "psf"


def _add_with_unit(
    leaf: LeafBuilder,
    column: PrintedColumn,
    dims: Sequence[str],
    value: np.ndarray,
    flag: np.ndarray,
) -> None:
    """Add a column whose SI unit is not in the vocabulary."""
    leaf.add_described(column, dims, value, flag)
    leaf[column.quantity].attrs["units"] = _SI.get(column.units, "1")


LEAVES = {"hypersonic": stack_hypersonic, "jet": stack_jet, "weight": stack_weight}
