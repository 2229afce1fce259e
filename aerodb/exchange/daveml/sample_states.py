"""States at which a database and its DAVE-ML model are compared: spread over the tables, some of them beyond."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import xarray as xr

from flightmech.names import lookup
from flightmech.terms import variables

from .conventions import REDUCED

Limits = Mapping[str, tuple[float, float]]
SEED = 119  # of S-119
BEYOND = 0.15  # of the range of a table, on either side
_AIRSPEED = (30.0, 250.0)  # m/s
_RANGES = {  # of what no table covers, by name, then by unit
    "phat": (-0.06, 0.06), "qhat": (-0.01, 0.01), "rhat": (-0.04, 0.04), "alphadothat": (-0.01, 0.01), "betadothat": (-0.02, 0.02),
    "p": (-1.5, 1.5), "q": (-0.4, 0.4), "r": (-0.4, 0.4), "gear": (0.0, 1.0), "speedbrake": (0.0, 1.0), "mach": (0.1, 0.8),
    "CT": (0.0, 0.2), "x_cg": (0.1, 0.4), "V": _AIRSPEED,
    "rad": (-0.3, 0.3), "m": (-1.0, 1.0), "Pa": (500.0, 20000.0), "m s-1": (-10.0, 10.0), "rad s-1": (-0.5, 0.5),
}  # fmt: skip


def needed_inputs(leaves: Iterable[xr.Dataset]) -> list[str]:
    """Return the model variables of the terms, by name."""
    return sorted(set().union(*(variables(leaf) for leaf in leaves)))


def ranges(leaves: Iterable[xr.Dataset], limits: Limits) -> dict[str, tuple[float, float]]:
    """Return the range (low, high) of each variable: of the control, of the tables that have it as an axis, or a usual one. [SI]"""
    leaves = list(leaves)
    found: dict[str, tuple[float, float]] = {}
    for name in needed_inputs(leaves):
        tables = [leaf[name].values for leaf in leaves if name in leaf.dims and leaf.sizes[name] > 1]
        row = lookup(name)
        if name in limits:
            found[name] = limits[name]
        elif tables:
            found[name] = float(max(points[0] for points in tables)), float(min(points[-1] for points in tables))
        else:
            found[name] = _RANGES.get(row.name, _RANGES.get(row.units, (-1.0, 1.0)))
        low, high = found[name]
        if low >= high and tables:  # tables that do not overlap: over all of them
            found[name] = float(min(points[0] for points in tables)), float(max(points[-1] for points in tables))
    return found


def size(name: str) -> float:
    """Return the usual largest size of a variable. [SI]"""
    row = lookup(name)
    return max(map(abs, _RANGES.get(row.name, _RANGES.get(row.units, (-1.0, 1.0)))))


def draw(leaves: Iterable[xr.Dataset], count: int, beyond: float, limits: Limits | None = None) -> dict[str, np.ndarray]:
    """Return states (count,) by variable, a Latin hypercube over the ranges extended by a share of them. [SI]"""
    random = np.random.default_rng(SEED)
    states = {}
    for name, (low, high) in ranges(leaves, limits or {}).items():
        places = (random.permutation(count) + random.random(count)) / count
        margin = beyond * (high - low)
        states[name] = low - margin + places * (high - low + 2.0 * margin)
    return states


def with_rates(states: Mapping[str, np.ndarray], lengths: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the states with true airspeed and the rates that the reduced rates stand for."""
    count = len(next(iter(states.values()), np.zeros(1)))
    random = np.random.default_rng(SEED + 1)
    V = states.get("V", random.uniform(*_AIRSPEED, count))
    found = {**states, "V": V}
    for name, (rate, length) in REDUCED.items():
        if name in states:
            found[rate] = 2.0 * V / lengths[length] * states[name]
    return found


def with_reduced(states: Mapping[str, np.ndarray], lengths: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the states with the reduced rates that rates and true airspeed make."""
    made = {
        name: states[rate] * lengths[length] / (2.0 * states["V"])
        for name, (rate, length) in REDUCED.items()
        if rate in states and "V" in states and length in lengths
    }
    return {**states, **made}
