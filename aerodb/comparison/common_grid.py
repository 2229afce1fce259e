"""Where two databases are compared: the nodes of both, and a grid of conditions that both can answer.

For a term the grid is the union of the breakpoints of both tables; as both are multilinear, no larger difference hides between.
For a coefficient the product of all its axes would be out of reach; its grid is mach x alpha in full, with every other
variable in turn at each of its breakpoints and the rest neutral.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.names import VOCABULARY, lookup
from flightmech.units import DEGREE, from_si

from ..store.number_text import FREE_AIR, plain_number, readable

TABLES = ("value", "K1", "K2")
# ends of a variable that multiplies tables and is no axis of any: what brisk manoeuvres of a trainer or business jet reach [SI]
REACH: dict[str, tuple[float, ...]] = {
    "alpha": (-5 * DEGREE, 10 * DEGREE),
    "beta": (-10 * DEGREE, 10 * DEGREE),
    "phi": (-30 * DEGREE, 30 * DEGREE),
    "phat": (-0.05, 0.05),
    "qhat": (-0.005, 0.005),
    "rhat": (-0.02, 0.02),
    "alphadothat": (-0.005, 0.005),
    "betadothat": (-0.02, 0.02),
    "dnz": (-1.0, 1.0),
    "CT": (0.0, 0.2),
    "CL": (0.0, 1.5),
    "CD": (0.0, 0.2),
    "CX": (-0.2, 0.2),
    "CZ": (-1.5, 0.0),
    **dict.fromkeys(("CY", "Cl", "Cm", "Cn"), (-0.05, 0.05)),
    "h_agl": (2.0, 5.0, 15.0, FREE_AIR),
    **dict.fromkeys(("gear", "speedbrake"), (0.0, 1.0)),
    **dict.fromkeys(("delta_e", "delta_a", "delta_r", "delta_t", "delta_ta", "delta_tr", "delta_d"), (-10 * DEGREE, 10 * DEGREE)),
    **dict.fromkeys(("delta_f", "delta_s"), (0.0, 40 * DEGREE)),
}
_IN_FULL = ("mach", "alpha")

Place = Callable[[int], str]
Conditions = Mapping[str, Any] | xr.Dataset


def axes_of(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the axes of all tables of a leaf with their breakpoints. [SI]"""
    return {str(axis): leaf[table][axis].values.astype(float) for table in TABLES if table in leaf for axis in leaf[table].dims}


def breakpoints(leaves: Iterable[xr.Dataset]) -> dict[str, np.ndarray]:
    """Return the breakpoints of all axes of several leaves, merged axis by axis. [SI]"""
    points: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis, values in axes_of(leaf).items():
            points[axis] = np.union1d(points.get(axis, []), values)
    return points


def mesh(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the product of breakpoints as samples, each (samples,)."""
    return dict(zip(points, (grid.ravel() for grid in np.meshgrid(*points.values(), indexing="ij")))) if points else {}


def neutral(name: str, points: np.ndarray) -> float:
    """Return the value of a variable that is at rest: zero or what is nearest to it in range, the highest `h_agl`: free air. [SI]"""
    return float(points[-1] if name == "h_agl" else np.clip(0.0, points[0], points[-1]))


def coefficient_points(ours: Sequence[xr.Dataset], theirs: Sequence[xr.Dataset]) -> dict[str, np.ndarray]:
    """Return what the grid of a coefficient takes of every variable: the breakpoints of both in the range that both cover.

    Returns
    -------
    dict of str to array
        Empty arrays where the ranges do not meet; `REACH` for variables that are no axis of any table; 0 for others. [SI]
    """
    of_a, of_b = breakpoints(ours), breakpoints(theirs)
    found = {}
    for name in sorted({v for leaf in [*ours, *theirs] for v in _terms.variables(leaf)}, key=_place_in_vocabulary):
        sides = [points[name] for points in (of_a, of_b) if name in points]
        if not sides:
            found[name] = np.array(REACH.get(name, (0.0,)))
            continue
        low, high = max(p[0] for p in sides), min(p[-1] for p in sides)
        both = np.unique(np.concatenate([*sides, [low, high]]))
        found[name] = both[(both >= low) & (both <= high)]
    return found


def coefficient_grid(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the conditions at which a coefficient is compared, each (samples,). [SI]"""
    full = {name: points[name] for name in _IN_FULL if name in points}
    rest = {name: neutral(name, values) for name, values in points.items() if name not in full}
    turns = [rest] + [{**rest, name: float(x)} for name, at_rest in rest.items() for x in points[name] if x != at_rest]
    base = mesh(full) or {"": np.zeros(1)}
    count = len(next(iter(base.values())))
    grid = {name: np.tile(values, len(turns)) for name, values in base.items() if name}
    return {name: grid[name] if name in grid else np.repeat([turn[name] for turn in turns], count) for name in points}


def grid_text(points: Mapping[str, np.ndarray]) -> str:
    """Return the grid of a coefficient in words: ranges in display units with the number of points."""
    full = " x ".join(_range(name, points[name]) for name in _IN_FULL if name in points)
    turns = ", ".join(_range(name, values) for name, values in points.items() if name not in _IN_FULL and len(values) > 1)
    return " with, in turn, ".join(text for text in (full, turns) if text) or "one condition"


def location(samples: Mapping[str, np.ndarray], names: Iterable[str], prefix: Callable[[int], str] | None = None) -> Place:
    """Return a function that gives the condition of one sample in display units."""
    names = list(names)

    def at(i: int) -> str:
        where = ", ".join(f"{name} {readable(name, samples[name][i])}" for name in names)
        return where if prefix is None else ": ".join(text for text in (prefix(i), where) if text)

    return at


def ordered(names: Iterable[str]) -> list[str]:
    """Return names of variables, mach and alpha first, the others as the vocabulary has them."""
    return sorted(names, key=_place_in_vocabulary)


def _place_in_vocabulary(name: str) -> tuple[int, int]:
    first = _IN_FULL.index(name) if name in _IN_FULL else len(_IN_FULL)
    return first, list(VOCABULARY).index(name) if name in VOCABULARY else len(VOCABULARY)


def _range(name: str, points: np.ndarray) -> str:
    unit = lookup(name).display_units
    low, high = (plain_number(from_si(float(x), unit)) for x in (points[0], points[-1]))
    span = low if len(points) == 1 else f"{low} ... {high}"
    return f"{name} {span}{'' if unit == '1' else f' {unit}'} ({len(points)})"
