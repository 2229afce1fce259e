"""Leaves of the pages of card PART.

They are ``auxiliary planform interference vortex increments canard_downwash``.
"""

from __future__ import annotations

from datcom_io.arrays.families.single_numbers import (
    Item,
    Numbers,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.arrays.stacking import Stacker
from datcom_io.printout.layouts.auxiliary import (
    BODY,
    CANARD,
    DIHEDRAL_AND_TWIST,
    INCREMENTS,
    INTERFERENCE,
    MAC,
    PANELS,
    PLANFORM,
    SIDEWASH,
    SURFACES,
    VORTEX,
)
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedValues, TableLayout

_ALONG = ("condition",)


def items_by_condition(stacker: Stacker, name: str) -> list[Item]:
    """Return the groups of a kind, with the index of their flight condition."""
    items: list[Item] = []
    for spot, page, group in stacker.placed_values(name):
        items.append(((spot.condition,), page, labelled_numbers(group)))
    return items


def stack_auxiliary(stacker: Stacker) -> LeafBuilder | None:
    """Stack the properties of the body and the position of the moment centre."""
    # The body has a row of its own; the line of the moment centre has a label.
    bodies: list[Item] = []
    for spot, page, table in stacker.placed_tables("body"):
        bodies.append(((spot.condition,), page, row_numbers(table)))
    centres = items_by_condition(stacker, "mac")
    if not bodies and not centres:
        return None
    sheet = NumberStack(stacker, {"condition": None})
    sheet.add(BODY.columns, _ALONG, bodies)
    sheet.add(MAC.numbers, _ALONG, centres)
    _, page, _ = (bodies or centres)[0]
    return sheet.finish(configuration=page.configuration)


def stack_planform(stacker: Stacker) -> LeafBuilder | None:
    """Stack the properties of the surfaces and their panels."""
    groups = stacker.placed_values("planform")
    if not groups:
        return None
    surfaces, panels = _printed_surfaces([group for _, _, group in groups])
    # The misspelling of the print is corrected in the labels of the panels.
    panel_names = [panel.lower().replace("theoritical", "theoretical") for panel in panels]
    axes = {
        "condition": None,
        "surface": [surface.lower() for surface in surfaces],
        "panel": panel_names,
    }
    sheet = NumberStack(stacker, axes)
    items: list[Item] = []
    for spot, page, group in groups:
        for i, surface in enumerate(surfaces):
            for k, panel in enumerate(panels):
                numbers = labelled_numbers(group, f"{surface} {panel}")
                if numbers:
                    items.append(((spot.condition, i, k), page, numbers))
    sheet.add(PLANFORM, ("condition", "surface", "panel"), items)
    return sheet.finish()


def _printed_surfaces(groups: list[PrintedValues]) -> tuple[list[str], list[str]]:
    """Return the surfaces and panels that are printed, in the order of the program."""
    # Every panel of a surface has an area; see the labels of `PLANFORM`.
    pairs = set()
    for surface in SURFACES:
        for panel in PANELS:
            if any(f"{surface} {panel} AREA" in group.labels for group in groups):
                pairs.add((surface, panel))
    printed_surfaces = {surface for surface, _ in pairs}
    printed_panels = {panel for _, panel in pairs}
    surfaces = [surface for surface in SURFACES if surface in printed_surfaces]
    panels = [panel for panel in PANELS if panel in printed_panels]
    return surfaces, panels


def stack_interference(stacker: Stacker) -> LeafBuilder | None:
    """Stack the interference of wing and horizontal tail with the body, and the sidewash."""
    items = items_by_condition(stacker, "interference")
    if not items:
        return None
    surfaces = []
    for name, form in INTERFERENCE.items():
        if any(form.numbers[0].name in numbers for _, _, numbers in items):
            surfaces.append(name)
    axes = {"condition": None, "surface": [name.lower() for name in surfaces]}
    sheet = NumberStack(stacker, axes)
    # Labels hold the letter of the surface, W or H; variables are named by those of the wing.
    wing = INTERFERENCE["WING"].numbers
    factors: list[Item] = []
    for (condition,), page, numbers in items:
        for k, name in enumerate(surfaces):
            named_as_wing = _rename(numbers, INTERFERENCE[name].numbers, wing)
            factors.append(((condition, k), page, named_as_wing))
    sheet.add(wing, ("condition", "surface"), factors)
    sheet.add(SIDEWASH.numbers, _ALONG, items)
    leaf = sheet.finish()
    # The attribute states both labels, because one variable has the numbers of both surfaces.
    for column in wing:
        of_tail = column.name.replace("W", "H")
        label = f"{column.name} of the wing, {of_tail} of the horizontal tail"
        leaf[column.quantity].attrs["printed_as"] = label
    return leaf


def _rename(
    numbers: Numbers, columns: tuple[PrintedColumn, ...], names: tuple[PrintedColumn, ...]
) -> Numbers:
    """Return the numbers of some columns under the names of others."""
    renamed = {}
    for column, name in zip(columns, names):
        if column.name in numbers:
            renamed[name.name] = numbers[column.name]
    return renamed


def stack_increments(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of dynamic derivatives, and the derivatives per dihedral and twist."""
    items = items_by_condition(stacker, "increments")
    if not items:
        return None
    sheet = NumberStack(stacker, {"condition": None})
    for form in INCREMENTS:
        sheet.add(form.numbers, _ALONG, items)
    sheet.add(DIHEDRAL_AND_TWIST, _ALONG, items)
    return sheet.finish()


def _stack_over_alpha(stacker: Stacker, layout: TableLayout) -> LeafBuilder | None:
    placed = stacker.placed_tables(layout.name)
    if not placed:
        return None
    return stacker.stack_over_alpha(placed, stacker.row_axis(placed, "alpha", stacker.alphas()))


def stack_vortex(stacker: Stacker) -> LeafBuilder | None:
    """Stack the vortex interference factors and vortex strengths."""
    return _stack_over_alpha(stacker, VORTEX)


def canard_downwash(stacker: Stacker) -> LeafBuilder | None:
    """Stack the effective downwash of a canard."""
    return _stack_over_alpha(stacker, CANARD)


LEAVES = {
    "auxiliary": stack_auxiliary,
    "planform": stack_planform,
    "interference": stack_interference,
    "vortex": stack_vortex,
    "increments": stack_increments,
    "canard_downwash": canard_downwash,
}
