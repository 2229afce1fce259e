"""An aircraft compiled with its database, and the tables that the kernel does not use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from flightmech.steady_flight.trim_search import trimmed_outputs

HINGES = ("Ch_e", "Ch_a", "Ch_r")
_LIFT = ("CL", "CX", "CZ")  # coefficients of lift in stability and in body axes


@dataclass(frozen=True)
class CompiledAircraft:
    """An aircraft and its database, compiled, with the tables that flights share.

    Parameters
    ----------
    aircraft : Aircraft
        Geometry, engines, controls.
    db : DataTree
        The database. Its hinge moments are not part of the compiled model.
    sim : SimModel
        The compiled model of both.
    """

    aircraft: Aircraft
    db: xr.DataTree = field(repr=False)
    sim: SimModel = field(repr=False)

    @cached_property
    def defaults(self) -> dict[str, float]:
        """Default of each parameter."""
        return {row.name: row.value for row in self.sim.entries(PARAMETER)}

    @cached_property
    def force_axes(self) -> str:
        """Axes of the force coefficients of the database."""
        return str(self.sim.meta["force_axes"])

    @cached_property
    def hinges(self) -> dict[str, list[xr.Dataset]]:
        """Terms of the hinge moments by coefficient."""
        # terms as datasets, which `terms.evaluate_term` needs
        terms_of = {}
        for name in HINGES:
            if name in self.db.children:
                nodes = self.db[name].children.values()
                terms_of[name] = [node.to_dataset() for node in nodes]
        return terms_of

    @cached_property
    def lift_range(self) -> dict[str, tuple[float, float]]:
        """First and last breakpoint that all lift tables share, by axis."""
        ranges: dict[str, tuple[float, float]] = {}
        for name in _LIFT:
            if name not in self.db.children:
                continue
            for node in self.db[name].children.values():
                _narrow_ranges(ranges, node)
        return ranges

    def trim_outputs(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return all outputs of the trim at the start, by name. [SI]"""
        values = trimmed_outputs(self.sim, parameters)
        return dict(zip(self.sim.outputs, map(float, values), strict=True))


def _narrow_ranges(ranges: dict[str, tuple[float, float]], node: xr.DataTree) -> None:
    """Intersect the ranges of the axes with the breakpoints of one table, in place."""
    for axis, coordinate in node.coords.items():
        points = coordinate.values
        # an axis with a single breakpoint is a constant, which holds everywhere
        if points.size < 2:
            continue
        low, high = ranges.get(str(axis), (-np.inf, np.inf))
        ranges[str(axis)] = (max(low, float(points[0])), min(high, float(points[-1])))
