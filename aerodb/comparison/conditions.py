"""Conditions at which databases are compared: grids, and samples of a flight record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.grids import neutral_value
from aerodb.store.overview import FREE_AIR, display_text, plain_number
from flightmech import terms as _terms
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import OutOfRange, UnknownName
from flightmech.names import ATTACHED_FLOW, VOCABULARY, lookup, unit_suffix
from flightmech.units import DEGREE, from_si

TABLES = ("value", "K1", "K2")  # variables of a leaf that are tables over axes
# Values of a variable that multiplies tables and is not an axis of any: the range of brisk
# manoeuvres of a trainer or business jet. [SI]
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
    **dict.fromkeys(
        ("delta_e", "delta_a", "delta_r", "delta_t", "delta_ta", "delta_tr", "delta_d"),
        (-10 * DEGREE, 10 * DEGREE),
    ),
    **dict.fromkeys(("delta_f", "delta_s"), (0.0, 40 * DEGREE)),
}
# Variables whose breakpoints form a grid. The others are varied in turn over it.
_IN_FULL = ("mach", "alpha")

Place = Callable[[int], str]
Conditions = Mapping[str, Any] | xr.Dataset


def usual_reach(name: str) -> tuple[float, ...]:
    """Return the values of a variable that is not an axis of any table. [SI]

    Those of `REACH`; the whole range of the flow separation and of the setting of a device, and the
    deflection of a device as that of a surface.  Another variable, such as a speed of a spool, is
    0.
    """
    if name in ATTACHED_FLOW:
        return (ATTACHED_FLOW[name] - 1.0, 1.0)
    if name.startswith(DEVICE):
        return (0.0, 1.0) if name.endswith(".setting") else REACH["delta_e"]
    return REACH.get(name, (0.0,))


def names_at_zero(points: Mapping[str, np.ndarray]) -> str:
    """Return a text with the variables of a grid that are always zero; empty without any."""
    names = [name for name, values in points.items() if not np.any(values)]
    return f"{', '.join(names)} taken as 0" if names else ""


def leaf_breakpoints(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the axes of all tables of a leaf with their breakpoints. [SI]"""
    points = {}
    for table in TABLES:
        if table in leaf:
            for axis in leaf[table].dims:
                points[str(axis)] = leaf[table][axis].values.astype(float)
    return points


def merge_leaf_breakpoints(leaves: Iterable[xr.Dataset]) -> dict[str, np.ndarray]:
    """Return the breakpoints of all axes of several leaves, merged axis by axis. [SI]"""
    points: dict[str, np.ndarray] = {}
    for leaf in leaves:
        for axis, values in leaf_breakpoints(leaf).items():
            points[axis] = np.union1d(points.get(axis, []), values)
    return points


def mesh_samples(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the product of breakpoints as samples, each (samples,)."""
    if not points:
        return {}
    grids = np.meshgrid(*points.values(), indexing="ij")
    return {name: grid.ravel() for name, grid in zip(points, grids)}


def coefficient_points(
    ours: Sequence[xr.Dataset], theirs: Sequence[xr.Dataset]
) -> dict[str, np.ndarray]:
    """Return the values of every variable in the grid of a coefficient.

    They are the breakpoints of both databases in the range that both cover.

    Returns
    -------
    dict of str to array
        Empty arrays if the ranges do not overlap; `usual_reach` for variables that are not an axis
        of any table. [SI]
    """
    points_a, points_b = merge_leaf_breakpoints(ours), merge_leaf_breakpoints(theirs)
    variables: set[str] = set()
    for leaf in [*ours, *theirs]:
        variables.update(_terms.list_model_variables(leaf))
    selected = {}
    for name in order_names(variables):
        sides = [points[name] for points in (points_a, points_b) if name in points]
        if not sides:
            selected[name] = np.array(usual_reach(name))
            continue
        # Both ends of the common range are breakpoints.
        low = max(points[0] for points in sides)
        high = min(points[-1] for points in sides)
        union = np.unique(np.concatenate([*sides, [low, high]]))
        selected[name] = union[(union >= low) & (union <= high)]
    return selected


def coefficient_grid(points: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the conditions at which a coefficient is compared, each (samples,). [SI]

    Mach number and incidence form a grid.  The other variables are varied in turn over it.
    """
    full = {name: points[name] for name in _IN_FULL if name in points}
    neutral = {}
    for name, values in points.items():
        if name not in full:
            neutral[name] = neutral_value(name, values)
    # All variables neutral, then each one at each of its other values.
    turns = [neutral]
    for name, neutral_point in neutral.items():
        for x in points[name]:
            if x != neutral_point:
                turns.append({**neutral, name: float(x)})
    # Without Mach number and incidence the grid has one condition.
    base = mesh_samples(full) or {"": np.zeros(1)}
    count = len(next(iter(base.values())))
    grid = {}
    for name in points:
        if name in base:
            grid[name] = np.tile(base[name], len(turns))
        else:
            grid[name] = np.repeat([turn[name] for turn in turns], count)
    return grid


def grid_text(points: Mapping[str, np.ndarray]) -> str:
    """Return the grid of a coefficient as text: ranges in display units, number of points."""
    full, turns = [], []
    for name in _IN_FULL:
        if name in points:
            full.append(_format_points(name, points[name]))
    for name, values in points.items():
        if name not in _IN_FULL and len(values) > 1:
            turns.append(_format_points(name, values))
    texts = filter(None, [" x ".join(full), ", ".join(turns)])
    return " with, in turn, ".join(texts) or "one condition"


def condition_text(
    samples: Mapping[str, np.ndarray],
    names: Iterable[str],
    prefix: Callable[[int], str] | None = None,
) -> Place:
    """Return a function that gives the condition of one sample in display units."""
    names = list(names)

    def describe(i: int) -> str:
        text = ", ".join(f"{name} {display_text(name, samples[name][i])}" for name in names)
        if prefix is None:
            return text
        return ": ".join(filter(None, [prefix(i), text]))

    return describe


def order_names(names: Iterable[str]) -> list[str]:
    """Return names of variables, mach and alpha first, the others as the vocabulary has them."""
    return sorted(names, key=_vocabulary_order)


def _vocabulary_order(name: str) -> tuple[int, int]:
    """Return the sort key of a variable."""
    # Names outside the vocabulary come last.
    vocabulary = list(VOCABULARY)
    first, second = len(_IN_FULL), len(vocabulary)
    if name in _IN_FULL:
        first = _IN_FULL.index(name)
    if name in vocabulary:
        second = vocabulary.index(name)
    return first, second


def _format_points(name: str, points: np.ndarray) -> str:
    """Return the range and the number of the values of a variable as text."""
    unit = lookup(name).display_units
    low, high = (plain_number(from_si(float(x), unit)) for x in (points[0], points[-1]))
    text = f"{name} {low}"
    if len(points) > 1:
        text = f"{text} ... {high}"
    return f"{text}{unit_suffix(unit)} ({len(points)})"


def select_covered_samples(
    conditions: Conditions, leaves: Iterable[xr.Dataset]
) -> tuple[dict[str, np.ndarray], int, Callable[[int], str], int]:
    """Return the samples at which all leaves can be evaluated.

    Parameters
    ----------
    conditions : mapping of str to array
        A Dataset, or arrays that broadcast. [SI]
    leaves : iterable of Dataset
        Terms.

    Returns
    -------
    samples : dict of str to array (samples,)
        The variables that the leaves use. [SI]
    count : int
        Number of samples.
    name : callable
        Function of the number of a sample that returns ``"time 4.12 s"``, or ``"sample 7"`` for
        conditions without time.
    left_out : int
        Number of samples with a NaN.

    Raises
    ------
    UnknownName
        A variable is missing.
    OutOfRange
        No sample is left.
    """
    variables: set[str] = set()
    for leaf in leaves:
        variables.update(_terms.list_model_variables(leaf))
    required = sorted(variables)
    for name in required:
        if name not in conditions:
            hint = "a term needs it; pass it with the conditions"
            raise UnknownName(name, map(str, conditions), "condition", hint)
    names = list(required)
    if "time" in conditions:
        names.append("time")
    columns = _broadcast_columns(conditions, names)
    size = 1
    if columns:
        size = len(columns[names[0]])
    complete = np.ones(size, bool)
    for name in required:
        complete &= np.isfinite(columns[name])
    if not complete.any():
        raise OutOfRange(
            f"no sample of {size} has a number in all of {', '.join(required)}; give "
            f"conditions without NaN",
            ~complete,
        )
    # Messages count the samples of the record, with those that are left out.
    numbers, time = np.flatnonzero(complete), columns.get("time")

    def describe(i: int) -> str:
        if time is None:
            return f"sample {numbers[i]}"
        return f"time {display_text('time', time[numbers[i]])}"

    samples = {name: columns[name][complete] for name in required}
    return samples, int(complete.sum()), describe, int((~complete).sum())


def _broadcast_columns(conditions: Conditions, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return variables of conditions broadcast against each other, each (samples,)."""
    if not names:
        return {}
    arrays = [conditions[name] for name in names]
    # Arrays of a Dataset are broadcast by the names of their axes.
    if isinstance(conditions, xr.Dataset):
        arrays = list(xr.broadcast(*arrays))
    columns = {}
    for name, array in zip(names, np.broadcast_arrays(*arrays)):
        columns[name] = np.ravel(array).astype(float)
    return columns


def count_samples_beyond(
    pair: Iterable[xr.Dataset | None], samples: Mapping[str, np.ndarray]
) -> str:
    """Return a text with the number of samples beyond the tables of a term in `a` and `b`.

    It is empty if all samples are inside.
    """
    texts = []
    for side, leaf in zip("ab", pair):
        if leaf is None:
            continue
        outside: Any = np.zeros(1, bool)
        for axis, points in leaf_breakpoints(leaf).items():
            outside = outside | (samples[axis] < points[0]) | (samples[axis] > points[-1])
        if outside.any():
            texts.append(
                f"{int(outside.sum())} of {len(outside)} samples beyond the table of {side}"
            )
    return "; ".join(texts)
