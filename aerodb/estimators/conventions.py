"""A set of coefficients in stability axes, with the controls and signs of the product.

``AVL .sb`` prints forces and derivatives along body axes, with respect to the velocities u, v, w
over the speed of the run. With C the coefficient of the fixed speed,

    C_alpha = C_w cos(alpha) - C_u sin(alpha),   C_beta = C_v   at beta = 0,
    CL = CX sin(alpha) - CZ cos(alpha),          CD = -CX cos(alpha) - CZ sin(alpha).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from aerodb.estimators.coefficient_set import CONDITIONS, CoefficientSet
from flightmech.errors import SchemaError

# Controls of a database: coefficient terms and their name in the build-up.
CONTROLS = {
    "delta_e": "elevator",
    "delta_a": "aileron",
    "delta_r": "rudder",
    "delta_f": "flap",
}
_SIGNS = {"+": 1.0, "-": -1.0}
_SIGN_RULES = (
    "delta_e and delta_f trailing edge down, delta_a right aileron down (rolls left), delta_r "
    "trailing edge left (yaws left)"
)


def name_controls(one: CoefficientSet, controls: Mapping[str, str]) -> CoefficientSet:
    """Return a set whose controls have the names and signs of the product.

    Parameters
    ----------
    one : CoefficientSet
    controls : mapping of str to str
        Control of the file to ``"+delta_e"``, ``"-delta_r"`` ...; ``""`` for a control that is not
        used. The sign is that of the product's deflection for a positive one of the file.

    Raises
    ------
    SchemaError
        A control of the file has no entry, an entry names no control of the file, has no sign or
        an unknown control, or two controls have the same name.
    """
    problems = []
    for name in one.controls:
        if name not in controls:
            problems.append(
                f"controls.{name}: missing; state which control it is and its sign, such as "
                f'"+delta_e", or "" to leave it out; no file states the sign ({_SIGN_RULES})'
            )
    for name, meaning in controls.items():
        if name not in one.controls:
            known = ", ".join(one.controls) or "none"
            problems.append(f"controls.{name}: the files have no such control; they have {known}")
        elif meaning and (meaning[0] not in _SIGNS or meaning[1:] not in CONTROLS):
            allowed = ", ".join(CONTROLS)
            problems.append(
                f"controls.{name}: found {meaning!r}; expected a sign and one of {allowed}, such "
                f'as "-delta_r" ({_SIGN_RULES})'
            )
    used = [meaning[1:] for meaning in controls.values() if meaning]
    for name in sorted(set(used)):
        if used.count(name) > 1:
            problems.append(
                f"controls: {used.count(name)} controls of the files are {name}; give one"
            )
    if problems:
        raise SchemaError("estimate", problems)
    numbers = one.numbers.copy()
    # All names change at once: a control of the file may have a name of the product.
    new_names: dict[str, str] = {}
    variables = one.numbers["variable"]
    for name in one.controls:
        meaning = controls[name]
        if not meaning:
            # A run with this control deflected is not one of the clean aeroplane.
            numbers = numbers[(numbers[name] == 0.0) & (variables[numbers.index] != name)]
            numbers = numbers.drop(columns=name)
            continue
        sign = _SIGNS[meaning[0]]
        is_derivative = variables[numbers.index] == name
        numbers.loc[is_derivative, "value"] *= sign
        numbers.loc[is_derivative, "variable"] = meaning[1:]
        numbers[name] *= sign
        new_names[name] = meaning[1:]
    numbers = numbers.rename(columns=new_names)
    return replace(one, controls=tuple(used), numbers=numbers)


def forces_to_stability(one: CoefficientSet) -> CoefficientSet:
    """Return a set with lift and drag in place of forces along body axes.

    Derivatives with respect to u, v, w become those with respect to alpha and beta. Numbers at a
    sideslip are left out of them, because the relation holds without sideslip.
    """
    if one.force_axes == "stability":
        return one
    numbers = one.numbers
    keys = [*CONDITIONS, *one.controls, "file"]
    rows = []
    for condition, group in numbers.groupby(keys, sort=False, dropna=False):
        place: dict[str, Any] = dict(zip(keys, condition))
        place["line"] = int(group["line"].min())
        by_variable: dict[str, dict[str, float]] = {}
        for row in group.to_dict("records"):
            by_variable.setdefault(row["variable"], {})[row["coefficient"]] = row["value"]
        turned = _turn_condition(by_variable, place["alpha"], place["beta"] == 0.0)
        for (coefficient, variable), value in turned.items():
            found = {"coefficient": coefficient, "variable": variable, "value": value}
            rows.append(place | found)
    table = pd.DataFrame(rows).reindex(columns=numbers.columns)
    return replace(one, force_axes="stability", numbers=table)


def _turn_condition(
    by_variable: Mapping[str, Mapping[str, float]], alpha: float, is_straight: bool
) -> dict[tuple[str, str], float]:
    """Return totals and derivatives of one condition in stability axes of forces."""
    sin, cos = float(np.sin(alpha)), float(np.cos(alpha))
    columns = {name: dict(values) for name, values in by_variable.items()}
    if {"u", "v", "w"} <= set(columns):
        u, v, w = (columns.pop(name) for name in ("u", "v", "w"))
        if is_straight:
            columns["alpha"] = {name: w[name] * cos - u[name] * sin for name in w}
            columns["beta"] = v
    total = columns.get("", {})
    turned: dict[tuple[str, str], float] = {}
    for variable, values in columns.items():
        for name in ("CY", "Cl", "Cm", "Cn"):
            if name in values:
                turned[name, variable] = values[name]
        # An empty cell of a table is a missing number.
        if not {"CX", "CZ"} <= set(values):
            continue
        lift = values["CX"] * sin - values["CZ"] * cos
        drag = -values["CX"] * cos - values["CZ"] * sin
        if variable == "alpha":
            if not {"CX", "CZ"} <= set(total):
                continue
            # The axes turn with alpha.
            lift += total["CX"] * cos + total["CZ"] * sin
            drag += total["CX"] * sin - total["CZ"] * cos
        turned["CL", variable] = lift
        turned["CD", variable] = drag
    return turned
