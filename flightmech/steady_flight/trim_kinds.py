"""Kinds of steady flight: unknowns, residuals and fixed quantities; ranges of the search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightmech.air import P_SEA
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import CatalogueEntry
from flightmech.units import G0

ACCELERATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
CLIMB = "hddot"  # upward acceleration: the kernel computes it, but it is not an output
# Constraint of the search of the kernel: fixed climb angle, fixed pitch attitude, or the ground.
BY_GAMMA, BY_THETA, ON_GROUND = range(3)
# Unknown that brings about the value of an output, in any kind.
UNKNOWN_FOR = {"V_cas": "V", "mach": "V", "qbar": "V", "hdot": "gamma", "h_agl": "h"}
# Input that drives an engine, by mode.engine.
DRIVES = {
    0.0: "throttle",
    1.0: "n1_drive",
    2.0: "thrust_drive",
    3.0: "torque_drive",
    4.0: "rpm_drive",
    5.0: "manifold_pressure_drive",
}
_SURFACES = ("delta_e", "delta_a", "delta_r")
_STRAIGHT = {"gamma": 0.0, "phi": 0.0, "psi_dot": 0.0}


@dataclass(frozen=True)
class Kind:
    """One kind of steady flight.

    Parameters
    ----------
    unknowns, residuals : tuple of str
        Unknowns, and the quantities that vanish.
    fixed : mapping of str to float
        Fixed quantities and their default values. [SI]
    one_of : tuple of str
        The flight is not defined without a value of at least one of these quantities.
    frees : mapping of str to str
        A value of the first quantity makes the second one unknown.
    drops : mapping of str to str
        A value of the first quantity removes the second one from the residuals.
    path : int
        `BY_GAMMA`, `BY_THETA` or `ON_GROUND`.
    """

    unknowns: tuple[str, ...]
    residuals: tuple[str, ...] = ACCELERATIONS
    fixed: Mapping[str, float] = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    frees: Mapping[str, str] = field(default_factory=dict)
    drops: Mapping[str, str] = field(default_factory=dict)
    path: int = BY_GAMMA


# Once the values of `one_of` are fixed, a kind has as many unknowns as residuals. A fixed output is
# a residual, too.
KINDS = {
    "level": Kind(
        ("alpha", "beta", *_SURFACES, "power"), fixed=_STRAIGHT, frees={"beta": "phi", "power": "V"}
    ),
    "climb": Kind(
        ("alpha", "beta", *_SURFACES, "power"),
        fixed={"phi": 0.0, "psi_dot": 0.0},
        one_of=("gamma", "hdot", "theta", "power"),
        frees={"beta": "phi", "power": "gamma"},
    ),
    "turn": Kind(
        ("alpha", "beta", *_SURFACES, "power", "psi_dot"),
        (*ACCELERATIONS, "ay"),
        fixed={"gamma": 0.0},
        one_of=("phi", "psi_dot", "nz"),
        frees={"psi_dot": "phi", "nz": "phi", "power": "gamma"},
        drops={"beta": "ay"},
    ),
    "sideslip": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0},
        one_of=("beta", "delta_r", "phi"),
        frees={"delta_r": "beta", "phi": "beta", "power": "gamma"},
    ),
    "pull_up": Kind(
        ("alpha", "beta", *_SURFACES, "power", "q"),
        fixed=_STRAIGHT,
        one_of=("nz", "q"),
        frees={"power": "gamma"},
    ),
    "engine_out": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0, "beta": 0.0},
        frees={"phi": "beta", "delta_r": "beta", "power": "gamma"},
    ),
    "ground": Kind(
        ("h", "theta", "phi"),
        (CLIMB, "p_dot", "q_dot"),
        fixed={"V": 0.0, "gamma": 0.0, "psi_dot": 0.0, "gear": 1.0},
        frees={"u_dot": "power"},
        path=ON_GROUND,
    ),
}
_ANGLE, _RATE = 1.5, 3.0  # limits of attitude and climb angle [rad], of rates [rad s-1]


class TrimLimits(NamedTuple):
    """Limits of an unknown, and the size over which the residuals change. [SI]"""

    low: float
    high: float
    size: float


# Alpha and beta have the limits of the kernel's trim at the start of a run.
LIMITS = {
    "alpha": TrimLimits(-0.6, 0.6, 1.0),
    "beta": TrimLimits(-0.35, 0.35, 1.0),
    "psi": TrimLimits(-np.inf, np.inf, 1.0),
    "V": TrimLimits(1.0, 1000.0, 100.0),
    "h": TrimLimits(-500.0, 30000.0, 10000.0),
    **dict.fromkeys(("gamma", "theta", "phi"), TrimLimits(-_ANGLE, _ANGLE, 1.0)),
    **dict.fromkeys(("p", "q", "r", "psi_dot"), TrimLimits(-_RATE, _RATE, 1.0)),
}

# Inputs that drive a propeller or its engine. The search starts at this part of their size, and
# ends at this multiple of it.
SHAFT_DRIVES = (".torque_drive", ".rpm_drive", ".manifold_pressure_drive")
_GUESS = 0.7
_MOST_DRIVE = 3.0
_CLIMB_RATE = 5.0  # [m/s]
_PILOT_FORCE = 100.0  # size of a pilot force [N]
_TYRE = 0.2  # largest deflection of a tyre along the ground [m]
# Height of the reference point on the ground, from the runway: lower and upper limit, size. [m]
_ABOVE_RUNWAY = TrimLimits(-20.0, 50.0, 10.0)


@dataclass(frozen=True)
class SearchRanges:
    """Where the search of each unknown starts, and its limits.

    Attributes
    ----------
    sim : SimModel
    rows : mapping of str to CatalogueEntry
        Parameters and inputs of the model.
    states : mapping of str to CatalogueEntry
        States behind those of the rigid body.
    values : mapping of str to float
        Parameters and inputs before the search. [SI]
    path : int
        `BY_GAMMA`, `BY_THETA` or `ON_GROUND`.
    """

    sim: SimModel
    rows: Mapping[str, CatalogueEntry]
    states: Mapping[str, CatalogueEntry]
    values: Mapping[str, float]
    path: int

    def first_guess(self, name: str, item: str) -> float:
        """Return the value at which the search of an unknown starts. [SI]

        `item` is the first entry that the unknown moves. NaN: the kernel computes the value.
        """
        if self.path == ON_GROUND and name in ("h", "theta"):
            return np.nan  # the kernel computes height and attitude of the aircraft at rest
        if item.endswith(SHAFT_DRIVES) and item not in self.values:
            return _GUESS * self._shaft_size(item)
        has_propeller = f"{item.partition('.')[0]}.rpm" in self.sim.outputs
        if item.endswith(".throttle") and has_propeller and item not in self.values:
            # a chart of power that ends above idle is flat there: the search starts half-way
            row = self.rows[item]
            return 0.5 * (max(row.low, 0.0) + min(row.high, 1.0))
        return 0.0 if item in self.states else self._value(item)

    def limits(self, name: str, item: str) -> TrimLimits:
        """Return the limits of an unknown; `item` is the first entry that it moves."""
        if name == "h" and self.path == ON_GROUND:
            runway = self._value("env.runway_elevation")
            low, high, size = _ABOVE_RUNWAY
            return TrimLimits(runway + low, runway + high, size)
        if name in LIMITS:
            return LIMITS[name]
        if item in self.states:
            row = self.states[item]
            if ".tyre_" in item:
                return TrimLimits(-_TYRE, _TYRE, 0.05 * _TYRE)
            return TrimLimits(row.low, row.high, 1.0)
        entry, weight = self.rows[item], self._value("mass.mass") * G0
        if item.endswith(".thrust_drive"):
            return TrimLimits(max(entry.low, -weight), min(entry.high, weight), weight)
        if item.endswith(SHAFT_DRIVES):
            size = self._shaft_size(item)
            return TrimLimits(entry.low, min(entry.high, _MOST_DRIVE * size), size)
        size = 1.0
        if item.startswith("F_"):
            size = _PILOT_FORCE
        elif item in self.sim.parameters:
            size = max(abs(self._value(item)), 1.0)
        return TrimLimits(entry.low, entry.high, size)

    def turn_start(self, solve_for: Sequence[str], fixed: Mapping[str, float]) -> dict[str, float]:
        """Return start values at which turn rate, bank and load factor agree for small angles."""
        start: dict[str, float] = {}
        V, g = max(self._value("init.V"), 1.0), G0
        phi, turn = self._value("init.phi"), self._value("init.psi_dot")
        load = fixed.get("nz", 1.0)
        # coordinated turn: tan(phi) = V psi_dot / g, cos(phi) = 1 / n; pull-up: q = (n - 1) g / V
        if "phi" in solve_for and "psi_dot" in fixed:
            start["init.phi"] = float(np.arctan(V * turn / g))
        elif "phi" in solve_for and "psi_dot" in solve_for:
            phi = float(np.arccos(min(1.0, 1.0 / max(load, 1.0))))
            start["init.phi"] = phi
        if "psi_dot" in solve_for:
            start["init.psi_dot"] = g * float(np.tan(phi)) / V
        if "q" in solve_for:
            start["init.q"] = (load - 1.0) * g / V
        return start

    def _value(self, name: str) -> float:
        return self.values.get(name, self.rows[name].value)

    def _shaft_size(self, item: str) -> float:
        """Return the size of an input that drives a propeller."""
        engine, _, drive = item.rpartition(".")
        if drive == "manifold_pressure_drive":
            return P_SEA
        speed = self._value(f"{engine}.rpm_high")
        if drive == "rpm_drive":
            return speed
        # torque of a power that carries the weight at a few metres per second
        return _CLIMB_RATE * self._value("mass.mass") * G0 / speed
