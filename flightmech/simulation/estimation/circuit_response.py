"""Free motion of a control circuit with dry friction, computed by the kernel.

The integration is that of ``am_follow_circuit`` of kernel.h.  All that enters it, the constants and
the inputs, is a linear function of the unknowns.
"""

from __future__ import annotations

from ctypes import byref
from typing import NamedTuple

import numpy as np

from flightmech.simulation.kernel_library import (
    CircuitStruct,
    check_array,
    double_pointer,
    load_kernel,
)

# Constants of a circuit in the order of kernel.h.
CIRCUIT_CONSTANTS = (
    "mass",
    "damping",
    "friction",
    "aft_mass",
    "aft_damping",
    "aft_friction",
    "cable_stiffness",
    "cable_damping",
    "preload",
    "stiffness",
    "rate_width",
    "place_width",
    "rigging",
    "bristle_travel",
)
# Most unknowns of one call: AM_MOST_CIRCUIT_UNKNOWNS of kernel.h, less the bends of both bristles.
MOST_UNKNOWNS = 128
# Distance of the ratio of load to friction from 1 that counts as none.
AT_KINK = 1e-9
# Status of a motion without bound and of one whose sub-step has no solution that the iteration
# reaches: AM_NOT_FINITE and AM_NOT_SOLVED of kernel.h.
_NO_MOTION = (3, 6)


class LinearInput(NamedTuple):
    """A quantity that is a linear function of the unknowns.

    Attributes
    ----------
    at_zero : array (...)
        Its value if all unknowns are 0.
    slope : array (..., unknowns)
        Its derivatives.
    """

    at_zero: np.ndarray
    slope: np.ndarray

    def at(self, theta: np.ndarray) -> np.ndarray:
        """Return its value for the unknowns (unknowns,)."""
        return self.at_zero + self.slope @ theta


class CircuitSlopes(NamedTuple):
    """Derivatives of the motion of a circuit on both sides of the kinks of its start.

    The first deflection of a bristle is the load of its end over its friction, -1 to 1.  Beyond,
    the end slides at once.  So the motion has a kink where this ratio is -1 or 1.

    Attributes
    ----------
    sliding : array (time, 2, unknowns)
        Of the travel of both ends, if no bristle can give way.
    bends : array (time, 2, 2)
        By the first deflections of both bristles.
    ratio : array (2,)
        Load of each end at rest over its friction; 0 without friction.
    by_unknown : array (2, unknowns)
        Its derivatives: ``sliding + bends @ by_unknown`` are those of a control that is held.
    """

    sliding: np.ndarray
    bends: np.ndarray
    ratio: np.ndarray
    by_unknown: np.ndarray

    def held(self) -> np.ndarray:
        """Return the derivatives (time, 2, unknowns); at a kink those of a held control."""
        is_held = np.abs(self.ratio) <= 1.0 + AT_KINK
        return self.sliding + self.bends @ (is_held[:, None] * self.by_unknown)


class DrivenCircuit(NamedTuple):
    """A control circuit at rest, and what moves it.

    Attributes
    ----------
    has_cable : bool
        Whether cockpit end and surface end are two bodies.
    has_bristles : bool
        Whether friction builds up over ``bristle_travel``, not with the rate over ``rate_width``.
    gearing : float
        d(delta)/ds. [rad per unit of travel]
    step : float
        Step of the record. [s]
    parts : int
        Sub-steps of a step.
    constants : LinearInput (CIRCUIT_CONSTANTS,)
        Reduced to the travel. [SI]
    start : LinearInput (2,)
        Travel of the cockpit end and of the surface end of the cable.
    force : LinearInput (time,)
        Force at the hand. [N or N m]
    moment : LinearInput (time, powers)
        Hinge moment as a polynomial of the deflection. [N m]
    edge : LinearInput (time,)
        Part of the step after a jump of the force between a sample and the next one; NaN without a
        jump.
    """

    has_cable: bool
    has_bristles: bool
    gearing: float
    step: float
    parts: int
    constants: LinearInput
    start: LinearInput
    force: LinearInput
    moment: LinearInput
    edge: LinearInput

    def follow(self, theta: np.ndarray) -> np.ndarray:
        """Return travel of both ends, (time, 2).

        A motion without bound is NaN, and so is one of which a sub-step does not converge: a search
        refuses such a step.

        Raises
        ------
        ValueError
            Arrays of other sizes, or a width that is not positive.
        """
        y, _ = self._run(theta, self.load_ratios(theta)[0], wants_slopes=False)
        return y

    def slopes(self, theta: np.ndarray) -> CircuitSlopes:
        """Return the derivatives of `follow` by the unknowns, which are exact.

        Raises
        ------
        ValueError
            As `follow`.
        """
        ratio, by_unknown = self.load_ratios(theta)
        _, Y = self._run(theta, ratio, wants_slopes=True)
        assert Y is not None
        n = len(theta)
        return CircuitSlopes(Y[:, :, :n], Y[:, :, n:], ratio, by_unknown)

    def load_ratios(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return load over friction of both ends at rest (2,), and derivatives (2, unknowns).

        Both are 0 with friction by the rate, and for an end without friction.
        """
        ratio, by_unknown = np.zeros(2), np.zeros((2, len(theta)))
        if not self.has_bristles:
            return ratio, by_unknown
        bodies = 2 if self.has_cable else 1
        last = bodies - 1
        q = dict(zip(CIRCUIT_CONSTANTS, self.constants.at(theta)))
        by = dict(zip(CIRCUIT_CONSTANTS, self.constants.slope))
        s, S = self.start.at(theta), self.start.slope
        # centring spring and force of the hand
        part = np.tanh(s[0] / q["place_width"])
        steep = (1.0 - part**2) / q["place_width"]
        load, by_load = np.zeros(2), np.zeros((2, len(theta)))
        load[0] = self._at_start(self.force, theta) - q["preload"] * part - q["stiffness"] * s[0]
        by_part = steep * (S[0] - s[0] / q["place_width"] * by["place_width"])
        by_load[0] = self.force.slope[0] - by["preload"] * part - q["preload"] * by_part
        by_load[0] -= by["stiffness"] * s[0] + q["stiffness"] * S[0]
        # hinge moment
        deflection = q["rigging"] + self.gearing * s[last]
        powers = deflection ** np.arange(self.moment.at_zero.shape[1])
        moment = self._at_start(self.moment, theta)
        slope = float(np.arange(1, len(powers)) * moment[1:] @ powers[:-1])
        load[last] += self.gearing * float(moment @ powers)
        by_deflection = by["rigging"] + self.gearing * S[last]
        by_load[last] += self.gearing * (powers @ self.moment.slope[0] + slope * by_deflection)
        if self.has_cable:
            tension = q["cable_stiffness"] * (s[0] - s[1])
            by_tension = by["cable_stiffness"] * (s[0] - s[1])
            by_tension = by_tension + q["cable_stiffness"] * (S[0] - S[1])
            load += np.array([-tension, tension])
            by_load += np.array([-by_tension, by_tension])
        for i, name in enumerate(("friction", "aft_friction")[:bodies]):
            if q[name] > 0.0:
                ratio[i] = load[i] / q[name]
                by_unknown[i] = (by_load[i] - ratio[i] * by[name]) / q[name]
        return ratio, by_unknown

    @staticmethod
    def _at_start(linear: LinearInput, theta: np.ndarray) -> np.ndarray:
        """Return an input at the first sample."""
        return linear.at_zero[0] + linear.slope[0] @ theta

    def _run(
        self, theta: np.ndarray, ratio: np.ndarray, wants_slopes: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return travel (time, 2), and derivatives (time, 2, unknowns and bends) if wanted."""
        samples, powers = self.moment.at_zero.shape
        unknowns = len(theta) + 2
        shapes = {
            "constants": (len(CIRCUIT_CONSTANTS),),
            "start": (2,),
            "force": (samples,),
            "moment": (samples, powers),
            "edge": (samples,),
        }
        # The arrays stay in memory during the call.
        arrays = {}
        for name, shape in shapes.items():
            linear = getattr(self, name)
            arrays[name] = check_array(linear.at(theta), shape)
            slope = np.zeros((*shape, unknowns))
            slope[..., :-2] = check_array(linear.slope, (*shape, len(theta)))
            arrays[f"by_{name}"] = slope
        # The bends of the bristles are two more unknowns.
        arrays["bend"] = np.clip(ratio, -1.0, 1.0)
        arrays["by_bend"] = np.eye(2, unknowns, unknowns - 2)
        y = np.full((samples, 2), np.nan)
        Y = np.full((samples, 2, unknowns), np.nan) if wants_slopes else None
        circuit = CircuitStruct(
            bodies=2 if self.has_cable else 1,
            bristles=int(self.has_bristles),
            unknowns=unknowns,
            powers=powers,
            parts=self.parts,
            step=self.step,
            gearing=self.gearing,
            **{name: double_pointer(array) for name, array in arrays.items()},
        )
        slopes = None if Y is None else double_pointer(Y)
        code = load_kernel().am_follow_circuit(byref(circuit), samples, double_pointer(y), slopes)
        if code in _NO_MOTION:
            y[:] = np.nan
            if Y is not None:
                Y[:] = np.nan
        elif code:
            widths = {}
            for name in ("rate_width", "place_width", "bristle_travel"):
                widths[name] = float(arrays["constants"][CIRCUIT_CONSTANTS.index(name)])
            raise ValueError(
                f"the kernel follows no circuit of {samples} samples, {powers} powers, "
                f"{len(theta)} unknowns (at most {MOST_UNKNOWNS}) and widths {widths}"
            )
        return y, Y
