"""Leaves of the special pages and of the weight lines: ``hypersonic jet weight``.

The hypersonic and the jet pages print no line of flight conditions.  They come once per condition
in the order of the run, so the input cards give Mach number and altitude where their number agrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import PrintedCondition, nearest_exact, si_factor
from datcom_io.arrays.families.single_numbers import Item, NumberStack, labelled_numbers
from datcom_io.arrays.stacking import HALF_UNIT, LeafBuilder, StackedAxis, Stacker
from datcom_io.cells import ABSENT
from datcom_io.printout.content import Page
from datcom_io.printout.layouts.special import HYPERSONIC, HYPERSONIC_FROM
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.errors import ParseError
from flightmech.units import FOOT

_HALF_UNIT_MACH = 0.005  # of the hypersonic page
_HALF_UNIT_REFERENCE = 0.0005  # ft2, ft
_INCREMENT_NAMES = {
    "dCN": "increment of the normal-force coefficient per span of the control",
    "dCA": "increment of the axial-force coefficient per span of the control",
    "dCm_CN": "pitching moment of the normal-force increment about the hinge line, per span of "
    "the control",
    "dCm_CA": "pitching moment of the axial-force increment about the hinge line, per span of the "
    "control",
    "xcp_CN": "centre of pressure of the normal-force increment forward of the hinge line, in "
    "chords",
    "zcp_CA": "centre of pressure of the axial-force increment below the hinge line, in chords",
}
# printed label, quantity, unit, meaning
_JET = (
    ("CONTROL FORCE (LB)", "F_control", "lbf", "control force wanted"),
    ("LOCAL MACH NO.", "mach_local", "1", "Mach number of the surface flow ahead of the jet"),
    (
        "REYNOLDS NO.",
        "reynolds_local",
        "1",
        "Reynolds number of the surface flow on the length of the plate ahead of the jet",
    ),
    (
        "LOCAL PRESSURE (LB/IN2)",
        "p_local",
        "pressure",
        "pressure of the surface flow ahead of the jet",
    ),
    (
        "DYNAMIC PRESSURE (LB/IN2)",
        "qbar_local",
        "pressure",
        "dynamic pressure of the surface flow ahead of the jet",
    ),
    ("CONTROL-FORCE COEFF.", "C_control", "1", "coefficient of the control force"),
    (
        "CORRECTED FORCE COEFF.",
        "C_control_corrected",
        "1",
        "coefficient of the control force, corrected for the gas of the jet",
    ),
    (
        "SONIC AMPLIFICATION FACTOR",
        "amplification_sonic",
        "1",
        "control force over vacuum thrust, sonic nozzle",
    ),
    ("AMPLIFICATION FACTOR", "amplification", "1", "control force over vacuum thrust"),
    ("VACUUM THRUST (LB)", "F_vacuum", "lbf", "vacuum thrust of the jet"),
    (
        "MIN. PRESSURE RATIO",
        "p_jet_ratio_min",
        "1",
        "smallest ratio of jet stagnation pressure to local pressure",
    ),
    (
        "MIN. JET PRESSURE (LB/IN2)",
        "p_jet_min",
        "pressure",
        "smallest stagnation pressure of the jet",
    ),
    ("JET PRESSURE (LB/IN2)", "p_jet", "pressure", "stagnation pressure of the jet"),
    ("MASS-FLOW RATE (LB/SEC)", "mass_flow", "lb/s", "mass flow of the jet"),
    ("PROPELLANT WEIGHT (LB)", "propellant_mass", "lb", "propellant used since the first time"),
)
_SI = {"1/ft": "m-1", "lbf": "N", "psi": "Pa", "psf": "Pa", "lb/s": "kg s-1", "lb": "kg"}
_WEIGHT_NAMES = {
    "weight": "weight as printed",
    "CL_level_flight": "lift coefficient of level flight as printed",
}


def stack_hypersonic(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of a hypersonic flap, per metre of its span."""
    tables = {layout.name: list(stacker.case.tables(layout.name)) for layout in HYPERSONIC}
    count = max(map(len, tables.values()))
    if not count:
        return None
    placed = [item for items in tables.values() for item in items]
    schedule = [pair for pair in stacker.case.deck.conditions() if pair[0] >= HYPERSONIC_FROM]
    headers = [_header(page) for page, _ in max(tables.values(), key=len)]
    local = _local(
        stacker,
        [
            _condition(stacker, header, pair)
            for header, pair in zip(headers, _matched(schedule, count))
        ],
    )
    deltas = _axis(local, placed, "delta", stacker.case.deck.schedule("HYPEFF", "HDELTA", "HNDLTA"))
    alphas = _axis(local, placed, "alpha", stacker.alphas())
    found = LeafBuilder(local.coords([local.condition_axis(), alphas, deltas]))
    lines = np.full(count, "", dtype=object)
    for layout in HYPERSONIC:
        assert layout.across is not None
        column, shape = layout.across.cell, (count, len(alphas.values), len(deltas.values))
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        for k, (page, table) in enumerate(tables[layout.name]):
            rows, fields = table.values[:, 1:].shape
            flag[k, :rows, :fields] = table.flags[:, 1:]
            value[k, :rows, :fields] = stacker.si(
                column, page, table.values[:, 1:], table.flags[:, 1:]
            )
            lines[k] = f"{lines[k].partition('-')[0] or table.lines[0]}-{table.lines[-1]}"
        _add(found, column, ["condition", "alpha", "delta"], value, flag)
    found.coords["lines"] = xr.Variable("condition", lines.astype(str))
    return found.described(
        _INCREMENT_NAMES, **_reference(stacker, headers[0]), moments="about the hinge line"
    )


def stack_jet(stacker: Stacker) -> LeafBuilder | None:
    """Stack the transverse jet over time."""
    placed = list(stacker.case.values("jet"))
    if not placed:
        return None
    deck = stacker.case.deck
    conditions = [_unprinted(stacker, pair) for pair in _matched(deck.conditions(), len(placed))]
    local = _local(stacker, conditions)
    times = _times(stacker, [group for _, group in placed])
    found = LeafBuilder(local.coords([local.condition_axis(), StackedAxis("time", times, "s")]))
    for label, quantity, units, meaning in _JET:
        column = PrintedColumn(
            label, 0, 0, quantity, _pressure_unit(stacker) if units == "pressure" else units
        )
        value, flag = (
            np.full((len(placed), len(times)), np.nan),
            np.full((len(placed), len(times)), ABSENT, np.uint8),
        )
        for k, (page, group) in enumerate(placed):
            at = _places(stacker, group, label)
            value[k, : len(at)] = stacker.si(column, page, group.values[at], group.flags[at])
            flag[k, : len(at)] = group.flags[at]
        _add(found, column, ["condition", "time"], value, flag)
        found[quantity].attrs["long_name"] = meaning
    layer = np.full((len(placed), len(times)), "", dtype=object)
    for k, (_, group) in enumerate(placed):
        at = _places(stacker, group, "BOUNDARY LAYER")
        layer[k, : len(at)] = [group.texts[i] for i in at]
    found.coords["boundary_layer"] = xr.Variable(("condition", "time"), layer.astype(str))
    angles = deck.schedule("TRNJET", "ALPHA", "NT")
    if len(angles) == len(times):
        found.coords["alpha"] = xr.Variable("time", np.radians(angles), {"units": "rad"})
    found.coords["lines"] = xr.Variable(
        "condition", np.array([f"{group.lines[0]}-{group.lines[-1]}" for _, group in placed])
    )
    return found


def stack_weight(stacker: Stacker) -> LeafBuilder | None:
    """Stack weight and lift coefficient of level flight, of the first page of each condition that
    has them.
    """
    first: dict[int, Page] = {}
    for spot, page, _ in stacker.placed_values("weight"):
        first.setdefault(spot.condition, page)
    if not first:
        return None
    sheet = NumberStack(stacker, {"condition": None})
    items: list[Item] = []
    units = "lbf"
    for condition, page in first.items():
        groups = [
            group for group in page.printed if isinstance(group, PrintedValues) and group.name == "weight"
        ]
        items.append(
            (
                (condition,),
                page,
                {
                    label: number
                    for group in groups[:2]
                    for label, number in labelled_numbers(group).items()
                },
            )
        )
        units = next((unit for group in groups for unit in group.units if unit), units)
    sheet.add([PrintedColumn("VEHICLE WEIGHT", 0, 0, "weight", units)], ["condition"], items)
    sheet.add(
        [PrintedColumn("LEVEL FLIGHT LIFT COEFFICIENT", 0, 0, "CL_level_flight")],
        ["condition"],
        items,
    )
    found = sheet.finished(_WEIGHT_NAMES)
    found["weight"].attrs["units"] = "N"
    return found


def _local(stacker: Stacker, conditions: list[PrintedCondition]) -> Stacker:
    """Return a stacker over the conditions of special pages."""
    return Stacker(stacker.case, conditions, {}, stacker.fill_transonic)


def _matched(schedule: Sequence[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    """Return Mach number and altitude of the cards when there are as many as pages, else NaN. [1,
    deck unit]
    """
    return list(schedule) if len(schedule) == count else [(math.nan, math.nan)] * count


def _unprinted(stacker: Stacker, pair: tuple[float, float]) -> PrintedCondition:
    return PrintedCondition(
        pair[0], pair[1] * si_factor("length", stacker.case.deck.dim), *[math.nan] * 4
    )


def _condition(
    stacker: Stacker, header: dict[str, float], pair: tuple[float, float]
) -> PrintedCondition:
    """Return the condition of a hypersonic page: printed Mach and Reynolds number, altitude of the
    cards.
    """
    mach = header.get("MACH NUMBER", math.nan)
    if abs(mach - pair[0]) > _HALF_UNIT_MACH * 1.001:
        pair = (math.nan, math.nan)  # the cards are those of another condition
    condition = _unprinted(stacker, pair)
    reynolds = header.get("REYNOLDS NO./FT", math.nan) / FOOT
    return condition._replace(
        mach=nearest_exact(mach, [pair[0]], _HALF_UNIT_MACH), reynolds_per_m=reynolds
    )


def _header(page: Page) -> dict[str, float]:
    """Return the numbers of the heading of a hypersonic page. [as printed]"""
    groups = [
        group for group in page.printed if isinstance(group, PrintedValues) and group.name == "hypersonic"
    ]
    return {
        label: number.value for group in groups for label, number in labelled_numbers(group).items()
    }


def _reference(stacker: Stacker, header: dict[str, float]) -> dict[str, float]:
    """Return reference area and length: the printed ones, with the digits of the cards where they
    print so. [m2, m]
    """
    deck = stacker.case.deck
    found = {}
    for name, label, variable, units, foot in (
        ("S", "REF. AREA (FT2)", "SREF", "area", FOOT**2),
        ("cbar", "LONG. REF. LENGTH(FT)", "CBARR", "length", FOOT),
    ):
        exact = deck.value("OPTINS", variable)
        given = [] if exact is None else [exact * si_factor(units, deck.dim)]
        found[name] = nearest_exact(
            header.get(label, math.nan) * foot, given, _HALF_UNIT_REFERENCE * foot
        )
    return found


def _axis(
    stacker: Stacker, placed: list[tuple[Page, PrintedTable]], name: str, exact: Sequence[float]
) -> StackedAxis:
    """Return alpha or deflection: the deck's values, or the printed ones without a deck; all tables
    must agree. [deg]
    """
    printed: list[tuple[np.ndarray, Sequence[int]]] = [
        (table.values[:, 0], table.lines) for _, table in placed
    ]
    if name == "delta":
        printed = [
            (table.across, [table.across_line] * len(table.across))
            for _, table in placed
            if table.across is not None
        ]
    values = list(exact) or max((shown for shown, _ in printed), key=len).tolist()
    for shown, lines in printed:
        stacker.demand(name.upper(), shown, values, lines)
    return StackedAxis(name, values, "deg")


def _places(stacker: Stacker, group: PrintedValues, label: str) -> list[int]:
    """Return where the columns of a row of the jet page stand in its group."""
    at = [k for k, other in enumerate(group.labels) if other == label]
    if at and group.lines[at[-1]] != group.lines[at[0]]:
        raise ParseError(
            stacker.case.file,
            group.lines[at[-1]],
            f"a second row {label}",
            "one row for each quantity of the jet",
        )
    return at


def _times(stacker: Stacker, groups: list[PrintedValues]) -> list[float]:
    """Return the deck's times, or the printed ones without a deck; all pages must agree with them.
    [s]
    """
    rows = [
        (group.values[at], [group.lines[k] for k in at])
        for group in groups
        if (at := _places(stacker, group, "TIME (SEC)"))
    ]
    times = (
        stacker.case.deck.schedule("TRNJET", "TIME", "NT")
        or max((shown for shown, _ in rows), key=len).tolist()
    )
    for shown, lines in rows:
        stacker.demand("TIME", shown, times, lines, HALF_UNIT, "s")
    return times


def _pressure_unit(stacker: Stacker) -> str:
    """Return the unit of the pressures of the jet page.

    The method multiplies the free-stream pressure by factors.  From an altitude the program has it
    in pounds per square foot, in spite of the label; a pressure of the cards is taken as labelled.
    """
    return "psi" if stacker.case.deck.values("FLTCON", "PINF") else "psf"


def _add(
    leaf: LeafBuilder,
    column: PrintedColumn,
    dims: Sequence[str],
    value: np.ndarray,
    flag: np.ndarray,
) -> None:
    leaf.add(column, dims, value, flag)
    leaf[column.quantity].attrs["units"] = _SI.get(column.units, "1")


LEAVES = {"hypersonic": stack_hypersonic, "jet": stack_jet, "weight": stack_weight}
