"""Windows of free motion as pieces of a likelihood, simulated by the kernel.

The friction of both ends is R tanh(rate / friction_rate), or it is R y with bristles whose
deflection y builds up over the bristle travel, dy/ds = (1 - y sgn(rate)) / bristle_travel.  The
preload is P tanh(travel / preload_travel).  The widths are unknowns: dry friction is the limit of a
small one.  The search moves their logarithms, because a width of zero has no effect that a search
could follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flightmech.simulation.estimation.circuit_response import (
    CIRCUIT_CONSTANTS,
    CircuitSlopes,
    DrivenCircuit,
    LinearInput,
)
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.free_response import (
    EDGE,
    ERROR,
    HAND,
    SURFACE,
    TRAVEL,
    FreeWindow,
)

# Names of the widths. A model has one of the first two.
FRICTION_RATE, BRISTLE_TRAVEL = "friction_rate", "bristle_travel"
PRELOAD_TRAVEL = "preload_travel"
WIDTHS = (FRICTION_RATE, BRISTLE_TRAVEL, PRELOAD_TRAVEL)
# Longest sub-step [s], and its largest phase of the cable mode [rad].
LONGEST_STEP, PHASE = 2.5e-4, 0.1
# Largest motion of a simulated end, in ranges of the recorded motion; beyond it the fit has failed.
_BEYOND = 50.0
# Width of the preload where the circuit has none: any positive number.
_ANY_WIDTH = 1.0
# Constant of the kernel by constant of the circuit: power of the gearing that reduces it.
_AFT = {
    "inertia": ("aft_mass", 2),
    "hinge_damping": ("aft_damping", 2),
    "hinge_friction": ("aft_friction", 1),
}
_SAME_NAME = (
    "mass",
    "damping",
    "friction",
    "cable_stiffness",
    "cable_damping",
    "preload",
    "stiffness",
    "rigging",
)


@dataclass(frozen=True)
class SimulatedPiece:
    """One window with the names of its unknowns.

    Attributes
    ----------
    loading : ControlLoading
    window : FreeWindow
    names : tuple of str
        Unknowns: common ones, then those of the window.
    parts : int
        Sub-steps of a step of the record.
    """

    loading: ControlLoading
    window: FreeWindow
    names: tuple[str, ...]
    parts: int

    @property
    def measured(self) -> np.ndarray:
        """Travel and surface end over their noise, (time, 2)."""
        return self.window.measured

    @property
    def step(self) -> float:
        """Sampling interval. [s]"""
        return self.window.step

    @cached_property
    def circuit(self) -> DrivenCircuit:
        """Circuit whose constants and inputs are linear in the unknowns."""
        return DrivenCircuit(
            has_cable="cable_stiffness" in self.names,
            has_bristles=BRISTLE_TRAVEL in self.names,
            gearing=self.loading.gearing,
            step=self.window.step,
            parts=self.parts,
            constants=self._constants(),
            start=self._start(),
            force=self._force(),
            moment=self._moment(),
            edge=self._edge(),
        )

    def _zero(self, *shape: int) -> LinearInput:
        return LinearInput(np.zeros(shape), np.zeros((*shape, len(self.names))))

    def _constants(self) -> LinearInput:
        """Return the constants of the circuit, those of the surface reduced to the travel."""
        at_zero, slope = self._zero(len(CIRCUIT_CONSTANTS))
        g = abs(self.loading.gearing)
        factors: dict[str, list[tuple[str, float]]] = {name: [(name, 1.0)] for name in _SAME_NAME}
        for name, (aft, power) in _AFT.items():
            factors[name] = [(aft, g**power)]
        factors["nose_spring"] = [("stiffness", self.window.ground)]
        factors[FRICTION_RATE] = [("rate_width", 1.0)]
        factors[BRISTLE_TRAVEL] = [("bristle_travel", 1.0)]
        factors[PRELOAD_TRAVEL] = [("place_width", 1.0)]
        if self.window.is_driven:
            # The record lacks this part of the force, as if the circuit had less damping.
            factors[HAND] = [("damping", -1.0)]
        for k, name in enumerate(self.names):
            for constant, factor in factors.get(name, ()):
                slope[CIRCUIT_CONSTANTS.index(constant), k] += factor
        if PRELOAD_TRAVEL not in self.names:
            at_zero[CIRCUIT_CONSTANTS.index("place_width")] = _ANY_WIDTH
        return LinearInput(at_zero, slope)

    def _start(self) -> LinearInput:
        at_zero, slope = self._zero(2)
        for row, name in enumerate((TRAVEL, SURFACE)):
            slope[row, self.names.index(name)] = 1.0
        if "rigging" in self.names:
            # The surface end of the record contains the rigging.
            slope[1, self.names.index("rigging")] = -1.0 / self.loading.gearing
        return LinearInput(at_zero, slope)

    def _force(self) -> LinearInput:
        """Return the force of the hand less all parts that depend on neither travel nor rate."""
        window = self.window
        at_zero, slope = window.force.astype(float), self._zero(len(window.time)).slope
        slope[:, self.names.index("offset")] = -1.0
        if "bob_weight" in self.names:
            slope[:, self.names.index("bob_weight")] = -window.weight
        for k, (part, _) in enumerate(window.errors):
            slope[part, self.names.index(f"{ERROR}{k + 1}")] = -1.0
        return LinearInput(at_zero, slope)

    def _moment(self) -> LinearInput:
        window = self.window
        highest = max(power for power, _ in window.factors)
        at_zero, slope = self._zero(len(window.time), 1 + highest)
        for (power, factor), term in zip(window.factors, self.loading.model.terms):
            slope[:, power, self.names.index(self.loading.term(term))] += window.load * factor
        return LinearInput(at_zero, slope)

    def _edge(self) -> LinearInput:
        at_zero, slope = self._zero(len(self.window.time))
        at_zero[:] = np.nan
        for k, sample in enumerate(self.window.edges):
            at_zero[sample] = 0.0
            slope[sample, self.names.index(f"{EDGE}{k + 1}")] = 1.0
        return LinearInput(at_zero, slope)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return travel and surface end over their noise, (time, 2)."""
        return self._readings(self.circuit.follow(raise_widths(self.names, values)), values)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the derivatives (time, 2, unknowns), which are exact.

        At a kink they are those of a control that friction holds.
        """
        return self.one_sided_slopes(values).held()

    def one_sided_slopes(self, values: np.ndarray) -> CircuitSlopes:
        """Return the derivatives on both sides of the kinks at which an end begins to slide."""
        raised = raise_widths(self.names, values)
        both = self.circuit.slopes(raised)
        Y = both.sliding
        if "rigging" in self.names:
            Y[:, 1, self.names.index("rigging")] += 1.0 / self.loading.gearing
        return CircuitSlopes(
            lower_slopes(self.names, raised, Y / self.window.scale[:, None]),
            both.bends / self.window.scale[:, None],
            both.ratio,
            lower_slopes(self.names, raised, both.by_unknown),
        )

    def load_ratios(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return load over friction of both ends at rest (2,), and derivatives (2, unknowns)."""
        raised = raise_widths(self.names, values)
        ratio, by_unknown = self.circuit.load_ratios(raised)
        return ratio, lower_slopes(self.names, raised, by_unknown)

    def _readings(self, y: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the readings of both ends over their noise; NaN far beyond the record."""
        if "rigging" in self.names:
            rigging = values[self.names.index("rigging")] / self.loading.gearing
            y = y + np.array([0.0, rigging])
        y = y / self.window.scale
        limit = _BEYOND * (1.0 + np.abs(self.window.measured).max())
        return np.where(np.abs(y) < limit, y, np.nan)


def raise_widths(names: Sequence[str], values: np.ndarray) -> np.ndarray:
    """Return the unknowns with widths in place of their logarithms."""
    raised = values.copy()
    for name in WIDTHS:
        if name in names:
            k = list(names).index(name)
            raised[k] = np.exp(values[k])
    return raised


def lower_slopes(names: Sequence[str], raised: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return derivatives (..., unknowns) by the logarithms of the widths from those by widths."""
    for name in WIDTHS:
        if name in names:
            k = list(names).index(name)
            slopes[..., k] *= raised[k]
    return slopes


def count_sub_steps(start: Mapping[str, float], gearing: float, step: float) -> int:
    """Return the number of sub-steps of a step of the record [s], for the first constants."""
    longest = LONGEST_STEP
    if "cable_stiffness" in start:
        ends = 1.0 / start["mass"] + 1.0 / (start["inertia"] * gearing**2)
        longest = min(longest, PHASE / float(np.sqrt(start["cable_stiffness"] * ends)))
    return int(np.ceil(step / longest - 1e-9))


def largest_motion(windows: Sequence[FreeWindow]) -> tuple[float, float]:
    """Return range of the travel, and the largest rate between samples, of all windows."""
    spans, rates = [], []
    for window in windows:
        travel = window.measured[:, 0] * window.scale[0]
        spans.append(float(np.ptp(travel)))
        # Over four steps, so that noise of the pick-up does not count.
        rates.append(float(np.abs(travel[4:] - travel[:-4]).max()) / (4.0 * window.step))
    return max(spans), max(rates)
