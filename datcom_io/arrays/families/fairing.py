"""Leaf of the transonic data fairing: ``fairing``."""

from __future__ import annotations

from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.stacking import LeafBuilder, Stacker
from datcom_io.printout.layouts.fairing import (
    DIVERGENCE,
    DRAG,
    SLOPES,
    SUBJECTS,
    SURFACE,
    WITH_BODY,
)

_NAMES = {
    "CDL_CL2": "drag due to lift over the square of the lift coefficient",
    "Cl_beta_CL": "rolling moment from sideslip per lift coefficient",
    "mach_break_unswept": "force-break Mach number without sweep",
    "mach_break": "force-break Mach number with sweep",
    "mach_a": "Mach number 0.07 above the force break",
    "CL_alpha_a": "lift-curve slope at mach_a",
    "mach_b": "Mach number 0.14 above the force break",
    "CL_alpha_b": "lift-curve slope at mach_b",
    "Cl_beta_CL_mach_06": "rolling moment from sideslip per lift coefficient at Mach 0.6",
    "Cl_beta_CL_mach_14": "rolling moment from sideslip per lift coefficient at Mach 1.4",
    "Cl_beta_CL_break": "rolling moment from sideslip per lift coefficient at the force-break "
    "Mach number",
    "CN_alpha_mach_14": "normal-force slope at Mach 1.4",
    "CL_alpha_mach": "Mach numbers between which the lift-curve slope is interpolated",
    "CL_alpha": "lift-curve slope at these Mach numbers",
    "mach_divergence": "drag-divergence Mach number",
    "CD0_mach": "Mach numbers between which the zero-lift drag is interpolated",
    "CD0": "zero-lift drag coefficient at these Mach numbers",
}


def stack_fairing(stacker: Stacker) -> LeafBuilder | None:
    """Stack the numbers between which the program interpolates in transonic flow."""
    groups = stacker.placed_values("fairing")
    if not groups:
        return None
    present = {label for _, _, group in groups for label in group.labels}
    subjects = [name for name in SUBJECTS if f"{name} CLB/CL" in present]
    tables = {
        subject: stacker.placed(layout.name)
        for subject, layout in SLOPES.items()
        if subject in subjects
    }
    nodes = max(
        (len(table.rows) for placed in tables.values() for _, _, table in placed), default=0
    )
    drag = stacker.placed(DRAG.name)
    drag_nodes = max((len(table.rows) for _, _, table in drag), default=0)
    axes = {
        "condition": None,
        "configuration": [name.lower() for name in subjects],
        "node": range(nodes),
        "drag_node": range(drag_nodes),
    }
    sheet = NumberStack(stacker, axes)
    columns = {
        column.quantity: column for form in (*SURFACE, *WITH_BODY) for column in form.numbers
    }
    items: list[Item] = [
        ((spot.condition, k), page, numbers)
        for spot, page, group in groups
        for k, subject in enumerate(subjects)
        if (numbers := labelled_numbers(group, subject))
    ]
    sheet.add(columns.values(), ("condition", "configuration"), items)
    points: list[Item] = [
        ((spot.condition, subjects.index(subject), k), page, row_numbers(table, k))
        for subject, placed in tables.items()
        for spot, page, table in placed
        for k in range(len(table.rows))
    ]
    mach, slope = SLOPES["WING"].columns
    sheet.add(
        (mach._replace(quantity="CL_alpha_mach"), slope),
        ("condition", "configuration", "node"),
        points,
    )
    whole = "BODY-WING-HORIZONTAL TAIL"
    divergence = (
        ((spot.condition,), page, labelled_numbers(group, whole)) for spot, page, group in groups
    )
    sheet.add(DIVERGENCE[0].numbers, ("condition",), divergence)
    mach, cd0 = DRAG.columns
    rise = (
        ((spot.condition, k), page, row_numbers(table, k))
        for spot, page, table in drag
        for k in range(len(table.rows))
    )
    sheet.add((mach._replace(quantity="CD0_mach"), cd0), ("condition", "drag_node"), rise)
    return sheet.finished(_NAMES)


LEAVES = {"fairing": stack_fairing}
