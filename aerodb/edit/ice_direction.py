"""Whether differences by ice make an aeroplane worse, as ice does.

Ice raises drag, lowers the largest lift and its angle, and weakens controls and damping.  A
difference in the other direction is mostly a wrong sign, or a factor that was inverted.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.units import DEGREE

_ROUNDING = 1e-9
_DAMPING = {("Cl", "phat"), ("Cm", "qhat"), ("Cn", "rhat")}
# The controls whose purpose a coefficient is; other effects, such as adverse yaw, may grow.
_CONTROLS = {
    "CL": ("delta_e", "delta_f"),
    "CY": ("delta_r",),
    "Cl": ("delta_a", "delta_d", "delta_s", "delta_sp"),
    "Cm": ("delta_e",),
    "Cn": ("delta_r",),
}
_REMEDY = "ice does the opposite: correct the sign, or the factor"


def improvements(name: str, clean: xr.Dataset, iced: np.ndarray) -> list[str]:
    """Return how ice improves one term; empty if it makes the aeroplane worse.

    Parameters
    ----------
    name : str
        Such as ``CL/basic``.
    clean : Dataset
        The clean term.
    iced : array
        Iced values at the nodes of the clean term.
    """
    values = clean["value"].values
    coefficient, _, contribution = name.partition("/")
    if contribution == "basic" and coefficient == "CD":
        return _drag(name, values, iced)
    if contribution == "basic" and coefficient in ("CL", "CZ"):
        sign = 1.0 if coefficient == "CL" else -1.0
        return _lift(name, clean, sign * values, sign * iced)
    strength, iced_strength = _size(values), _size(iced)
    if iced_strength <= strength * (1.0 + _ROUNDING):
        return []
    if _is_of_control(coefficient, clean):
        word = "control power"
    elif (coefficient, contribution) in _DAMPING:
        word = "damping"
    else:
        return []
    raised = 100.0 * (iced_strength / strength - 1.0) if strength else np.inf
    return [f"{name}: the {word} is {raised:.3g} % larger with ice than clean; {_REMEDY}"]


def _drag(name: str, values: np.ndarray, iced: np.ndarray) -> list[str]:
    # Behind the stall ice may lower the drag. A wrong sign lowers it at most nodes.
    change = iced - values
    least = float(change.min())
    if np.median(change) >= -_ROUNDING:
        return []
    return [f"{name}: ice lowers the drag, by up to {-least:.3g}; {_REMEDY}"]


def _lift(name: str, clean: xr.Dataset, values: np.ndarray, iced: np.ndarray) -> list[str]:
    texts = []
    gain = float(iced.max() - values.max())
    if gain > _ROUNDING:
        texts.append(f"{name}: ice raises the largest lift coefficient by {gain:.3g}; {_REMEDY}")
    dims = list(clean["value"].dims)
    if "alpha" not in dims:
        return texts
    alpha, axis = clean["alpha"].values, dims.index("alpha")
    before, after = values.argmax(axis=axis), iced.argmax(axis=axis)
    # a curve that rises up to its last node has no stall in the table
    later = (before < len(alpha) - 1) & (after > before)
    if later.any():
        where = tuple(np.argwhere(later)[0])
        first, second = (alpha[place[where]] / DEGREE for place in (before, after))
        texts.append(
            f"{name}: ice moves the largest lift from alpha {first:.4g} to {second:.4g} deg; "
            f"{_REMEDY}"
        )
    return texts


def _size(values: np.ndarray) -> float:
    """Return the range of a table; the size of a table of one sign or one node."""
    return float(max(np.ptp(values), np.abs(values).max()))


def _is_of_control(coefficient: str, clean: xr.Dataset) -> bool:
    """Return whether a term is the effect for which a control surface is there."""
    regressors = str(clean.attrs.get("regressors", "")).split()
    names = [*map(str, clean["value"].dims), *regressors]
    return any(control in names for control in _CONTROLS.get(coefficient, ()))
