"""An aircraft compiled with its database, and the tables that the kernel does not use."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from flightmech.aircraft.aircraft import Aircraft
from flightmech.axes import lift_drag
from flightmech.build_up import COEFFICIENTS
from flightmech.errors import SimulationError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from flightmech.steady_flight.trim_search import trimmed_outputs
from flightmech.terms import list_model_variables

HINGES = ("Ch_e", "Ch_a", "Ch_r")
# By control: its moment, and the usual name of its term.
_MOMENT_TERMS = {
    "delta_e": ("Cm", "Cm/elevator"),
    "delta_a": ("Cl", "Cl/aileron"),
    "delta_r": ("Cn", "Cn/rudder"),
}
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
    def missing_terms(self) -> dict[str, str]:
        """By control whose moment is not in the database: the name of the missing term."""
        missing = {}
        for control, (moment, term) in _MOMENT_TERMS.items():
            variables: set[str] = set()
            if moment in self.db.children:
                for node in self.db[moment].children.values():
                    variables.update(list_model_variables(node.to_dataset()))
            if control not in variables:
                missing[control] = term
        return missing

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

    @cached_property
    def coefficient_variables(self) -> set[str]:
        """Model variables of the terms of the six coefficients."""
        variables: set[str] = set()
        for coefficient, group in self.db.children.items():
            if coefficient in COEFFICIENTS:
                for node in group.children.values():
                    variables.update(list_model_variables(node.to_dataset()))
        return variables

    def part_variables(
        self, known: Collection[str], inputs: Mapping[str, float], outputs: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the model variables of devices, engines, fuel and gear in a flight. [SI]

        Parameters
        ----------
        known : collection of str
            Variables whose values are known already.
        inputs, outputs : mapping of str to float
            All of the flight.

        Raises
        ------
        SimulationError
            A coefficient depends on a variable that is neither an input nor an output.
        """
        values, missing = {}, []
        for name in self.sim.variables:
            if name in known or name in COEFFICIENTS:
                continue
            if name not in inputs and name not in outputs and name in self.coefficient_variables:
                missing.append(name)
            # one that only tables of engines, fuel or gear use needs a column, but no value
            values[name] = inputs.get(name, outputs.get(name, 0.0))
        if missing:
            raise SimulationError(
                f"terms of the coefficients depend on {', '.join(missing)}, which a trimmed flight "
                f"does not give: derivatives and characteristics are not computed; use "
                f"flightmech.linearize, or delete the terms"
            )
        return values

    def trim_outputs(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return all outputs of the trim at the start, by name. [SI]"""
        values = trimmed_outputs(self.sim, parameters)
        return dict(zip(self.sim.outputs, map(float, values), strict=True))

    def to_stability(
        self, coefficients: np.ndarray, alpha: ArrayLike, beta: ArrayLike
    ) -> np.ndarray:
        """Return CL and CD in stability axes and CY in body axes, then the moments (6, ...).

        The forces are in the axes of the database, in the order of `model_block.FORCES`.
        """
        if self.force_axes == "stability":
            return coefficients
        if self.force_axes == "body":
            CL, CD = lift_drag(coefficients[0], coefficients[1], alpha)
            return np.stack([CL, CD, *coefficients[2:]])
        # wind axes: drag and side force are turned by the sideslip angle
        along = -coefficients[1] * np.cos(beta) - coefficients[2] * np.sin(beta)
        side = -coefficients[1] * np.sin(beta) + coefficients[2] * np.cos(beta)
        return np.stack([coefficients[0], -along, side, *coefficients[3:]])

    def to_database_axes(
        self, coefficients: np.ndarray, variables: Mapping[str, ArrayLike]
    ) -> dict[str, np.ndarray]:
        """Return the coefficients in the axes of the database, in which its terms use them."""
        CL, CD, CY, Cl, Cm, Cn = coefficients
        alpha, beta = np.asarray(variables["alpha"]), np.asarray(variables["beta"])
        by_name = {"CL": CL, "CD": CD, "CY": CY, "Cl": Cl, "Cm": Cm, "Cn": Cn}
        # Body axes from stability axes, a rotation by alpha about y; wind axes by beta about z.
        by_name["CX"] = CL * np.sin(alpha) - CD * np.cos(alpha)
        by_name["CZ"] = -CL * np.cos(alpha) - CD * np.sin(alpha)
        if self.force_axes == "wind":
            by_name["CD"] = CD * np.cos(beta) - CY * np.sin(beta)
            by_name["CY"] = CD * np.sin(beta) + CY * np.cos(beta)
        return by_name


def _narrow_ranges(ranges: dict[str, tuple[float, float]], node: xr.DataTree) -> None:
    """Intersect the ranges of the axes with the breakpoints of one table, in place."""
    for axis, coordinate in node.coords.items():
        points = coordinate.values
        # an axis with a single breakpoint is a constant, which holds everywhere
        if points.size < 2:
            continue
        low, high = ranges.get(str(axis), (-np.inf, np.inf))
        ranges[str(axis)] = (max(low, float(points[0])), min(high, float(points[-1])))
