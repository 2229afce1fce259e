"""Flight paths between gyros and accelerometers, for the kernel: ``am_drive`` of kernel.h, and the
path that they drive from its start.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, byref, c_double, c_int, c_ubyte
from typing import Any, NamedTuple

import numpy as np

from flightmech.simulation.kernel_library import (
    DOUBLES,
    check_array,
    double_pointer,
    load_kernel,
)

BIAS, SCALE, WIND, LAG = 0, 6, 12, 15  # AM_BIAS and the others of kernel.h


class _Path(ctypes.Structure):
    """``am_path``: pointers to states, rates and specific force, the step and what surrounds the
    path.
    """

    _fields_ = [(name, DOUBLES) for name in ("x", "rates", "force")]
    _fields_ += [(name, c_double) for name in ("dt", "gravity", "fall", "level")]
    _fields_ += [("spin", c_double * 3), ("transport", c_double * 9), ("sensed", c_double * 3)]

    def __init__(self, x, rates, force, dt: float, around: Surroundings):
        super().__init__(x, rates, force, dt, around.gravity, around.fall, around.level)
        self.spin[:], self.sensed[:] = around.spin.tolist(), around.sensed.tolist()
        self.transport[:] = around.transport.ravel().tolist()


class DriveStruct(ctypes.Structure):
    """``am_drive``."""

    _fields_ = (
        [("path", _Path)]
        + [(name, c_int) for name in ("states", "inputs", "vanes", "gusts")]
        + [("side", c_int * 2)]
    )
    _fields_ += [("input", POINTER(c_int)), ("slow", POINTER(c_ubyte)), ("sensed", DOUBLES)]
    _fields_ += [("gain", c_double * 6), ("arm", c_double * 3), ("wind", c_double * 3)]
    _fields_ += [("vane_arm", c_double * 6), ("lag", c_double * 3), ("lag_slope", c_double * 3)]


class Surroundings(NamedTuple):
    """What a flight path passes through.

    Attributes
    ----------
    gravity, fall, level : float
        Gravity at the height `level` [m s-2], what it loses per metre [s-2], and that height [m].
    spin : array (3,)
        Rate of the Earth, north-east-down. [rad s-1]
    transport : array (3, 3)
        ``transport @ v`` is the rate at which the level axes turn because they are carried along.
        [m-1]
    sensed : array (3,)
        Rate of the Earth as far as the gyros show it, north-east-down. [rad s-1]
    """

    gravity: float
    fall: float
    level: float
    spin: np.ndarray
    transport: np.ndarray
    sensed: np.ndarray


class Inertial(NamedTuple):
    """An inertial unit, free of the errors of its constants.

    Attributes
    ----------
    rates : array (N, 3)
        Body rates. [rad s-1]
    force : array (N, 3)
        Specific force at the c.g. [m s-2]
    sensed : array (N, 3)
        The same where the accelerometers sit.
    gain : array (6,)
        1/(1 + scale error) of gyros and accelerometers.
    arm : array (3,)
        The unit from the c.g. [m]
    """

    rates: np.ndarray
    force: np.ndarray
    sensed: np.ndarray
    gain: np.ndarray
    arm: np.ndarray


class Vanes(NamedTuple):
    """Vanes behind a first-order lag, in air that moves steadily.

    Attributes
    ----------
    side : sequence of int
        1 of a vane that shows atan(v/u), 2 of one that shows atan(w/u); two vanes at most.
    arms : array (vanes, 3)
        From the c.g. [m]
    wind : array (3,)
        North, east, down. [m s-1]
    lag, lag_slope : array (3,)
        Weights of the state before, the angle before and the angle after a step, and their
        derivatives by the time constant.
    """

    side: Sequence[int]
    arms: np.ndarray
    wind: np.ndarray
    lag: np.ndarray
    lag_slope: np.ndarray


class DrivenPath:
    """A stretch of uniform samples with the inertial unit and the vanes that belong to it.

    Parameters
    ----------
    inertial : Inertial
    x : array (N, n)
        States: phi, theta, psi [rad], velocity north, east, down [m s-1], height [m], the lagged
        angles of the vanes [rad]; others may follow.  For `follow`, a path from which gravity,
        Coriolis acceleration and the turning of the level axes are taken.
    dt : float
        [s]
    around : Surroundings
    inputs : sequence of int
        Constants to which derivatives are wanted, each once: `BIAS` + i and `SCALE` + i of p, q, r
        and of the specific force forward, right, down, `WIND` + i, `LAG`.
    vanes : Vanes
    gusts : bool
        Whether the states behind the vanes are gusts north, east, down. [m s-1]
    slow : array of bool (N - 1,), optional
        Steps over which the vanes hang freely.

    Attributes
    ----------
    inertial, x, dt, around, inputs, vanes, gusts, slow
        As given.
    samples, states : int
        N and n.

    Raises
    ------
    ValueError
        Arrays of other sizes.
    """

    def __init__(
        self,
        inertial: Inertial,
        x: np.ndarray,
        dt: float,
        around: Surroundings,
        inputs: Sequence[int],
        vanes: Vanes,
        gusts: bool = False,
        slow: np.ndarray | None = None,
    ):
        self.samples, self.states = x.shape
        rates, force, sensed = (check_array(item, (self.samples, 3)) for item in inertial[:3])
        self.inertial = Inertial(
            rates, force, sensed, check_array(inertial.gain, (6,)), check_array(inertial.arm, (3,))
        )
        self.x, self.dt, self.around, self.inputs, self.gusts = (
            check_array(x, x.shape),
            dt,
            around,
            list(inputs),
            gusts,
        )
        wind, lag, lag_slope = (check_array(item, (3,)) for item in vanes[2:])
        self.vanes = Vanes(
            list(vanes.side), check_array(vanes.arms, (len(vanes.side), 3)), wind, lag, lag_slope
        )
        self.slow = (
            np.zeros(self.samples - 1, np.uint8)
            if slow is None
            else np.ascontiguousarray(slow, np.uint8)
        )
        if self.slow.shape != (self.samples - 1,):
            raise ValueError(
                f"array has the shape {self.slow.shape}, expected {(self.samples - 1,)}"
            )
        d = self.drive = DriveStruct(
            _Path(double_pointer(self.x), double_pointer(rates), double_pointer(force), dt, around)
        )
        d.states, d.inputs, d.vanes, d.gusts = (
            self.states,
            len(self.inputs),
            len(self.vanes.side),
            gusts,
        )
        d.input, d.slow = (
            (c_int * d.inputs)(*self.inputs),
            self.slow.ctypes.data_as(POINTER(c_ubyte)),
        )
        d.sensed = double_pointer(sensed)
        d.side[: d.vanes] = self.vanes.side
        d.gain[:], d.arm[:] = self.inertial.gain.tolist(), self.inertial.arm.tolist()
        d.wind[:], d.lag[:], d.lag_slope[:] = wind.tolist(), lag.tolist(), lag_slope.tolist()
        d.vane_arm[: 3 * d.vanes] = self.vanes.arms.ravel().tolist()

    def follow(self, start: np.ndarray, x: np.ndarray, X: np.ndarray | None = None) -> None:
        """Write the path from start (n,) into x (N, n), and its derivatives by start and inputs
        into X (N, n, n + inputs).

        Notes
        -----
        Rates and accelerations are cubics between samples, attitude takes the fourth-order Magnus step, velocity Simpson's rule over
        it; height and sensitivities the trapezoidal rule (1e-5 of their size at 50 Hz).  Straight lines between samples would
        take (omega dt)^2/12 off what oscillates with omega: 1e-3 at 0.9 Hz and 50 samples per second, found again in the vane factors.
        """
        out = output_pointer(x, (self.samples, self.states))
        columns = (
            None
            if X is None
            else output_pointer(X, (self.samples, self.states, self.states + len(self.inputs)))
        )
        self._demand(
            load_kernel().am_follow(
                byref(self.drive),
                self.samples,
                double_pointer(check_array(start, (self.states,))),
                out,
                columns,
            )
        )

    def add_noise(
        self, x: np.ndarray, noise: np.ndarray, pressed: np.ndarray, products: np.ndarray
    ) -> None:
        """Add to products (u, u) the covariance that the noise of the inertial unit gives to the
        sum of `pressed`.

        Parameters
        ----------
        x : array (N, n)
            The path.
        noise : array (6,)
            One sigma of each sample of rates and specific force. [rad s-1], [m s-2]
        pressed : array (N, n, u)
            Derivatives by the state of u sums; they act on the states of vanes without lag.
        products : array (u, u)
        """
        unknowns = pressed.shape[-1]
        given = (
            double_pointer(check_array(x, (self.samples, self.states))),
            unknowns,
            double_pointer(check_array(noise, (6,))),
        )
        pointers = (
            double_pointer(check_array(pressed, (self.samples, self.states, unknowns))),
            output_pointer(products, (unknowns, unknowns)),
        )
        self._demand(load_kernel().am_add_noise(byref(self.drive), self.samples, *given, *pointers))

    def _demand(self, code: int) -> None:
        if code:
            raise ValueError(
                f"the kernel follows no path of {self.samples} samples, {self.states} states "
                f"and these inputs or sums"
            )


def output_pointer(array: np.ndarray, shape: tuple[int, ...]) -> Any:
    """Return the pointer of an array that the kernel writes."""
    if array.shape != shape or array.dtype != float or not array.flags.c_contiguous:
        raise ValueError(
            f"array of {array.dtype} has the shape {array.shape}, expected contiguous "
            f"doubles {shape}"
        )
    return double_pointer(array)
