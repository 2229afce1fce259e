"""Leaves of the pages of card PART: ``auxiliary planform interference vortex increments
canard_downwash``.
"""

from __future__ import annotations

from datcom_io.arrays.families.single_numbers import (
    Item,
    NumberStack,
    labelled_numbers,
    row_numbers,
)
from datcom_io.arrays.stacking import LeafBuilder, Stacker
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
from datcom_io.printout.tables import TableLayout

_ALONG = ("condition",)
_BODY_NAMES = {
    "area_wetted": "wetted area of the body",
    "x_moment_centre": "moment centre aft of the drawing datum",
    "z_moment_centre": "moment centre above the drawing datum",
    "area_base": "base area of the body",
    "CD0": "zero-lift drag coefficient of the body, on the reference area",
    "CD_base": "base drag coefficient of the body",
    "CD_friction": "friction drag coefficient of the body",
    "CD_pressure": "pressure drag coefficient of the body",
    "x_behind_mac": "moment centre aft of the leading edge of the theoretical mean chord, of the "
    "wing where there is one",
}
_PLANFORM_NAMES = {
    "area": "area of the panels of both sides",
    "taper_ratio": "tip chord over root chord",
    "aspect_ratio": "aspect ratio; of the theoretical inboard panel right with DIM FT only",
    "sweep_c4": "sweep of the quarter-chord line",
    "mac": "mean chord",
    "x_c4_mac": "quarter chord of the mean chord aft of the drawing datum",
    "y_mac": "mean chord outboard of the root of the theoretical surface",
    "CD0": "zero-lift drag coefficient, on the reference area",
    "Cf": "skin-friction coefficient",
}
_INTERFERENCE_NAMES = {
    "CL_alpha_body": "lift-curve slope carried over to the body by the surface, on the reference "
    "area",
    "CL_alpha_surface": "lift-curve slope of the surface in the presence of the body, on the "
    "reference area",
    "K_body": "lift carried over to the body over that of the exposed surface alone",
    "K_surface": "lift of the surface in the presence of the body over that of the exposed "
    "surface alone",
    "xac_body": "aerodynamic centre of the lift carried over to the body, in chords as printed",
    "sidewash": "(1 + d sigma/d beta) q_v/q at the vertical tail",
}
_VORTEX_NAMES = {
    "i_body_wing": "interference factor of the body vortices on the wing",
    "i_wing_tail": "interference factor of the wing vortices on the horizontal tail",
    "i_body_tail": "interference factor of the body vortices on the horizontal tail",
    "gamma": "strength of a body vortex at the wing over 2 pi alpha V r",
    "gamma_tail": "strength of a body vortex at the horizontal tail over 2 pi alpha V r",
}
_INCREMENT_NAMES = {
    "Cl_phat": "roll damping of the wing without dihedral and lift, on theoretical wing area and "
    "span",
    "Cl_phat_ratio_dihedral": "roll damping with dihedral over that without",
    "Cn_phat_twist": "yawing moment from roll rate per twist of the wing",
    "dCY_phat_dihedral": "side force from roll rate due to the dihedral of the wing; the label "
    "CYP/GAMMA pretends a division",
    "CY_phat_CL": "side force from roll rate per lift coefficient, at zero lift",
    "Cl_beta_dihedral": "rolling moment from sideslip per dihedral of the wing",
    "Cm0_twist_wing": "pitching moment at zero lift per twist of the wing",
    "Cm0_twist_tail": "pitching moment at zero lift per twist of the horizontal tail",
}
_CANARD_NAMES = {
    "epsilon_effective": "effective downwash angle of a canard at the wing",
    "epsilon_alpha_effective": "slope of the effective downwash angle with alpha",
}


def stack_auxiliary(stacker: Stacker) -> LeafBuilder | None:
    """Stack the properties of the body and the place of the moment centre."""
    bodies = stacker.placed("body")
    places = stacker.placed_values("mac")
    if not bodies and not places:
        return None
    sheet = NumberStack(stacker, {"condition": None})
    sheet.add(
        BODY.columns,
        _ALONG,
        (((spot.condition,), page, row_numbers(table)) for spot, page, table in bodies),
    )
    sheet.add(
        MAC.numbers,
        _ALONG,
        (((spot.condition,), page, labelled_numbers(group)) for spot, page, group in places),
    )
    return sheet.finished(_BODY_NAMES, configuration=(bodies or places)[0][1].configuration)


def stack_planform(stacker: Stacker) -> LeafBuilder | None:
    """Stack the properties of the surfaces and their panels."""
    groups = stacker.placed_values("planform")
    if not groups:
        return None
    labels = {label for _, _, group in groups for label in group.labels}
    surfaces = [name for name in SURFACES if any(label.startswith(f"{name} ") for label in labels)]
    panels = [
        name for name in PANELS if any(f"{surface} {name} AREA" in labels for surface in surfaces)
    ]
    names = [panel.lower().replace("theoritical", "theoretical") for panel in panels]
    sheet = NumberStack(
        stacker, {"condition": None, "surface": [name.lower() for name in surfaces], "panel": names}
    )
    items: list[Item] = [
        ((spot.condition, i, k), page, numbers)
        for spot, page, group in groups
        for i, surface in enumerate(surfaces)
        for k, panel in enumerate(panels)
        if (numbers := labelled_numbers(group, f"{surface} {panel}"))
    ]
    sheet.add(PLANFORM, ("condition", "surface", "panel"), items)
    return sheet.finished(_PLANFORM_NAMES)


def stack_interference(stacker: Stacker) -> LeafBuilder | None:
    """Stack the interference factors of wing and horizontal tail with the body, and the sidewash."""
    groups = stacker.placed_values("interference")
    if not groups:
        return None
    present = {label for _, _, group in groups for label in group.labels}
    surfaces = [name for name, form in INTERFERENCE.items() if form.numbers[0].name in present]
    sheet = NumberStack(
        stacker, {"condition": None, "surface": [name.lower() for name in surfaces]}
    )
    wing = INTERFERENCE["WING"].numbers
    items: list[Item] = []
    for spot, page, group in groups:
        numbers = labelled_numbers(group)
        for k, name in enumerate(surfaces):
            own = {
                column.name: number
                for column, other in zip(wing, INTERFERENCE[name].numbers)
                if (number := numbers.get(other.name))
            }
            items.append(((spot.condition, k), page, own))
    sheet.add(wing, ("condition", "surface"), items)
    sheet.add(
        SIDEWASH.numbers,
        _ALONG,
        (((spot.condition,), page, labelled_numbers(group)) for spot, page, group in groups),
    )
    found = sheet.finished(_INTERFERENCE_NAMES)
    for column in wing:
        found[column.quantity].attrs["printed_as"] = (
            f"{column.name} of the wing, {column.name.replace('W', 'H')} of the horizontal tail"
        )
    return found


def stack_increments(stacker: Stacker) -> LeafBuilder | None:
    """Stack the increments of dynamic derivatives, and the derivatives per dihedral and twist."""
    groups = stacker.placed_values("increments")
    if not groups:
        return None
    sheet = NumberStack(stacker, {"condition": None})
    columns = [column for form in INCREMENTS for column in form.numbers] + list(DIHEDRAL_AND_TWIST)
    sheet.add(
        columns,
        _ALONG,
        (((spot.condition,), page, labelled_numbers(group)) for spot, page, group in groups),
    )
    return sheet.finished(_INCREMENT_NAMES)


def _over_alpha(stacker: Stacker, layout: TableLayout) -> LeafBuilder | None:
    placed = stacker.placed(layout.name)
    if not placed:
        return None
    items = [([spot.condition], page, table) for spot, page, table in placed]
    alphas = stacker.axis(placed, "alpha", stacker.alphas())
    return stacker.stack(layout.columns[1:], [stacker.condition_axis()], alphas, items)


def stack_vortex(stacker: Stacker) -> LeafBuilder | None:
    """Stack the vortex interference factors and vortex strengths."""
    found = _over_alpha(stacker, VORTEX)
    return None if found is None else found.described(_VORTEX_NAMES)


def canard_downwash(stacker: Stacker) -> LeafBuilder | None:
    """Stack the effective downwash of a canard."""
    found = _over_alpha(stacker, CANARD)
    return None if found is None else found.described(_CANARD_NAMES)


LEAVES = {
    "auxiliary": stack_auxiliary,
    "planform": stack_planform,
    "interference": stack_interference,
    "vortex": stack_vortex,
    "increments": stack_increments,
    "canard_downwash": canard_downwash,
}
