"""Leaf of the transonic data fairing: ``fairing``."""

from __future__ import annotations

from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.arrays.stacking import PlacedTable, Stacker
from datcom_io.printout.layouts.fairing import (
    DIVERGENCE,
    DRAG,
    SLOPES,
    SUBJECTS,
    SURFACE,
    WHOLE_AIRCRAFT,
    WITH_BODY,
)
from datcom_io.printout.rows import PrintedColumn


def stack_fairing(stacker: Stacker) -> LeafBuilder | None:
    """Stack the numbers between which the program interpolates in transonic flow."""
    groups = stacker.placed_values("fairing")
    if not groups:
        return None
    # Every block of a surface, with or without body, prints CLB/CL.
    labels: set[str] = set()
    for _, _, group in groups:
        labels |= set(group.labels)
    subjects = [name for name in SUBJECTS if f"{name} CLB/CL" in labels]
    slopes: dict[str, list[PlacedTable]] = {}
    for subject, layout in SLOPES.items():
        if subject in subjects:
            slopes[subject] = stacker.placed_tables(layout.name)
    drag = stacker.placed_tables(DRAG.name)
    axes = {
        "condition": None,
        "configuration": [name.lower() for name in subjects],
        "node": range(max(map(_most_rows, slopes.values()), default=0)),
        "drag_node": range(_most_rows(drag)),
    }
    sheet = NumberStack(stacker, axes)

    # Single numbers of surfaces, with and without body.
    items: list[Item] = []
    for spot, page, group in groups:
        for k, subject in enumerate(subjects):
            numbers = labelled_numbers(group, subject)
            if numbers:
                items.append(((spot.condition, k), page, numbers))
    columns: dict[str, PrintedColumn] = {}
    for form in (*SURFACE, *WITH_BODY):
        columns |= {column.quantity: column for column in form.numbers}
    sheet.add(columns.values(), ("condition", "configuration"), items)

    # Tables of the lift slope over Mach number.
    nodes: list[Item] = []
    for subject, placed in slopes.items():
        for spot, page, table in placed:
            for k in range(len(table.rows)):
                index = (spot.condition, subjects.index(subject), k)
                nodes.append((index, page, row_numbers(table, k)))
    mach, slope = SLOPES["WING"].columns
    slope_columns = (mach._replace(quantity="CL_alpha_mach"), slope)
    sheet.add(slope_columns, ("condition", "configuration", "node"), nodes)

    # Drag divergence and drag rise of the whole aircraft.
    divergence: list[Item] = []
    for spot, page, group in groups:
        divergence.append(((spot.condition,), page, labelled_numbers(group, WHOLE_AIRCRAFT)))
    sheet.add(DIVERGENCE[0].numbers, ("condition",), divergence)
    rise: list[Item] = []
    for spot, page, table in drag:
        for k in range(len(table.rows)):
            rise.append(((spot.condition, k), page, row_numbers(table, k)))
    mach, cd0 = DRAG.columns
    rise_columns = (mach._replace(quantity="CD0_mach"), cd0)
    sheet.add(rise_columns, ("condition", "drag_node"), rise)
    return sheet.finish()


def _most_rows(placed: list[PlacedTable]) -> int:
    return max((len(table.rows) for _, _, table in placed), default=0)


LEAVES = {"fairing": stack_fairing}
