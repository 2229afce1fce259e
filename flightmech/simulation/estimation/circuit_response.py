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
# Most unknowns of one call: AM_MOST_CIRCUIT_UNKNOWNS of kernel.h.
MOST_UNKNOWNS = 128
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

    def follow(self, theta: np.ndarray, wants_slopes: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Return travel of both ends (time, 2), and derivatives (time, 2, unknowns) if wanted.

        A motion without bound is NaN, and so is one of which a sub-step does not converge: a search
        refuses such a step.

        Raises
        ------
        ValueError
            Arrays of other sizes, or a width that is not positive.
        """
        samples, powers = self.moment.at_zero.shape
        unknowns = len(theta)
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
            arrays[f"by_{name}"] = check_array(linear.slope, (*shape, unknowns))
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
                f"the kernel follows no circuit of {samples} samples, {powers} powers, {unknowns} "
                f"unknowns (at most {MOST_UNKNOWNS}) and widths {widths}"
            )
        return y, Y
