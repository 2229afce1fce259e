"""Flight paths from inertial measurements, computed by the kernel.

Gyros and accelerometers drive a path from its start: ``am_drive`` of kernel.h.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import POINTER, byref, c_int, c_ubyte
from typing import Any, NamedTuple

import numpy as np

from flightmech.simulation.kernel_library import (
    DriveStruct,
    PathStruct,
    check_array,
    double_pointer,
    load_kernel,
)

# First input of each kind: AM_BIAS, AM_SCALE, AM_WIND and AM_LAG of kernel.h.
BIAS, SCALE, WIND, LAG = 0, 6, 12, 15


class Surroundings(NamedTuple):
    """Earth and gravity along a flight path.

    Attributes
    ----------
    gravity, fall, level : float
        Gravity at the height `level` [m s-2], its decrease per metre [s-2], and that height [m].
    spin : array (3,)
        Rate of the Earth, north-east-down. [rad s-1]
    transport : array (3, 3)
        ``transport @ v`` is the transport rate: the level axes turn as they move over the Earth.
        [m-1]
    sensed : array (3,)
        Rate of the Earth in the readings of the gyros, north-east-down. [rad s-1]
    """

    gravity: float
    fall: float
    level: float
    spin: np.ndarray
    transport: np.ndarray
    sensed: np.ndarray


class Inertial(NamedTuple):
    """Readings of an inertial unit, corrected for the errors of its constants.

    Attributes
    ----------
    rates : array (N, 3)
        Body rates. [rad s-1]
    force : array (N, 3)
        Specific force at the c.g. [m s-2]
    sensed : array (N, 3)
        Specific force at the accelerometers. [m s-2]
    gain : array (6,)
        1/(1 + scale error) of gyros and accelerometers.
    arm : array (3,)
        Position of the unit from the c.g. [m]
    """

    rates: np.ndarray
    force: np.ndarray
    sensed: np.ndarray
    gain: np.ndarray
    arm: np.ndarray


class Vanes(NamedTuple):
    """Vanes with a first-order lag, in a steady wind.

    Attributes
    ----------
    side : sequence of int
        1 for a vane that measures atan(v/u), 2 for a vane that measures atan(w/u). At most two.
    arms : array (vanes, 3)
        Positions from the c.g. [m]
    wind : array (3,)
        North, east, down. [m s-1]
    lag, lag_slope : array (3,)
        Weights of the state before, the angle before and the angle after a step, and their
        derivatives with respect to the time constant.
    """

    side: Sequence[int]
    arms: np.ndarray
    wind: np.ndarray
    lag: np.ndarray
    lag_slope: np.ndarray


class DrivenPath:
    """A sequence of uniform samples with the readings of its inertial unit and its vanes.

    Parameters
    ----------
    inertial : Inertial
    x : array (N, n)
        States: phi, theta, psi [rad], velocity north, east, down [m s-1], height [m], the lagged
        angles of the vanes [rad]; others may follow.  `follow` computes gravity, Coriolis
        acceleration and transport rate from this path.
    dt : float
        Time between samples. [s]
    around : Surroundings
        Earth and gravity.
    inputs : sequence of int
        Constants of the derivatives, each once: `BIAS` + i and `SCALE` + i of p, q, r and of the
        specific force forward, right, down, `WIND` + i, `LAG`.
    vanes : Vanes
    gusts : bool
        Whether the states after those of the vanes are gusts north, east, down. [m s-1]
    slow : array of bool (N - 1,), optional
        Steps whose airspeed is too low to move the vanes.

    Attributes
    ----------
    inertial, x, dt, around, inputs, vanes, gusts, slow
        The arguments.
    drive : DriveStruct
        The structure for the kernel.
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
        # arrays are attributes: the structure for the kernel has pointers to them
        self.x, self.dt, self.around = check_array(x, x.shape), dt, around
        self.inputs, self.gusts = list(inputs), gusts
        self.inertial = _check_inertial(inertial, self.samples)
        self.vanes = _check_vanes(vanes)
        if slow is None:
            slow = np.zeros(self.samples - 1)
        self.slow = np.ascontiguousarray(slow, np.uint8)
        if self.slow.shape != (self.samples - 1,):
            raise ValueError(
                f"array has the shape {self.slow.shape}, expected {(self.samples - 1,)}"
            )
        self.drive = self._pack_drive()

    def _pack_drive(self) -> DriveStruct:
        """Return the structure for the kernel; its pointers are those of the arrays of the path."""
        # pointers into arrays that the path holds
        drive = DriveStruct(self._pack_path())
        drive.states, drive.inputs = self.states, len(self.inputs)
        drive.vanes, drive.gusts = len(self.vanes.side), self.gusts
        drive.input = (c_int * drive.inputs)(*self.inputs)
        drive.slow = self.slow.ctypes.data_as(POINTER(c_ubyte))
        drive.sensed = double_pointer(self.inertial.sensed)
        # arrays inside the structure
        drive.side[: drive.vanes] = self.vanes.side
        drive.gain[:] = self.inertial.gain.tolist()
        drive.arm[:] = self.inertial.arm.tolist()
        drive.wind[:] = self.vanes.wind.tolist()
        drive.lag[:] = self.vanes.lag.tolist()
        drive.lag_slope[:] = self.vanes.lag_slope.tolist()
        drive.vane_arm[: 3 * drive.vanes] = self.vanes.arms.ravel().tolist()
        return drive

    def _pack_path(self) -> PathStruct:
        around = self.around
        path = PathStruct(
            x=double_pointer(self.x),
            rates=double_pointer(self.inertial.rates),
            force=double_pointer(self.inertial.force),
            dt=self.dt,
            gravity=around.gravity,
            fall=around.fall,
            level=around.level,
        )
        # the kernel has the matrix row by row
        path.spin[:], path.sensed[:] = around.spin.tolist(), around.sensed.tolist()
        path.transport[:] = around.transport.ravel().tolist()
        return path

    def follow(self, start: np.ndarray, x: np.ndarray, X: np.ndarray | None = None) -> None:
        """Compute the path from a start, and its derivatives.

        Parameters
        ----------
        start : array (n,)
            First state.
        x : array (N, n)
            The path is written into it.
        X : array (N, n, n + inputs), optional
            The derivatives with respect to start and inputs are written into it.

        Notes
        -----
        Rates and accelerations are cubics between samples.  Attitude uses the fourth-order Magnus
        step, velocity Simpson's rule over it, height and sensitivities the trapezoidal rule (1e-5
        of their size at 50 Hz).  Straight lines between samples would reduce an oscillation of
        frequency omega by (omega dt)^2/12: 1e-3 at 0.9 Hz and 50 samples per second.  The error
        would appear in the vane factors.
        """
        # the kernel writes into the arrays of the caller, which must therefore be contiguous
        path = output_pointer(x, (self.samples, self.states))
        derivatives = None
        if X is not None:
            columns = self.states + len(self.inputs)
            derivatives = output_pointer(X, (self.samples, self.states, columns))
        first = check_array(start, (self.states,))
        self._check(
            load_kernel().am_follow(
                byref(self.drive), self.samples, double_pointer(first), path, derivatives
            )
        )

    def add_noise(
        self, x: np.ndarray, noise: np.ndarray, pressed: np.ndarray, products: np.ndarray
    ) -> None:
        """Add the covariance of sums that the noise of the inertial unit causes.

        Parameters
        ----------
        x : array (N, n)
            The path.
        noise : array (6,)
            One sigma of each sample of rates and specific force. [rad s-1], [m s-2]
        pressed : array (N, n, u)
            Derivatives of u sums with respect to the states; they act on the states of vanes
            without lag.
        products : array (u, u)
            The covariance of the sums is added to it.
        """
        unknowns = pressed.shape[-1]
        # inputs are converted; the covariance is added to the array of the caller
        path = check_array(x, (self.samples, self.states))
        sigma = check_array(noise, (6,))
        derivatives = check_array(pressed, (self.samples, self.states, unknowns))
        covariance = output_pointer(products, (unknowns, unknowns))
        inputs = (double_pointer(path), unknowns, double_pointer(sigma))
        self._check(
            load_kernel().am_add_noise(
                byref(self.drive), self.samples, *inputs, double_pointer(derivatives), covariance
            )
        )

    def _check(self, code: int) -> None:
        if code:
            raise ValueError(
                f"the kernel follows no path of {self.samples} samples, {self.states} states "
                f"and these inputs or sums"
            )


def _check_inertial(inertial: Inertial, samples: int) -> Inertial:
    """Return an inertial unit with contiguous arrays of the right shapes."""
    return Inertial(
        rates=check_array(inertial.rates, (samples, 3)),
        force=check_array(inertial.force, (samples, 3)),
        sensed=check_array(inertial.sensed, (samples, 3)),
        gain=check_array(inertial.gain, (6,)),
        arm=check_array(inertial.arm, (3,)),
    )


def _check_vanes(vanes: Vanes) -> Vanes:
    """Return vanes with contiguous arrays of the right shapes."""
    return Vanes(
        side=list(vanes.side),
        arms=check_array(vanes.arms, (len(vanes.side), 3)),
        wind=check_array(vanes.wind, (3,)),
        lag=check_array(vanes.lag, (3,)),
        lag_slope=check_array(vanes.lag_slope, (3,)),
    )


def output_pointer(array: np.ndarray, shape: tuple[int, ...]) -> Any:
    """Return the pointer of an array that the kernel writes."""
    if array.shape != shape or array.dtype != float or not array.flags.c_contiguous:
        raise ValueError(
            f"array of {array.dtype} has the shape {array.shape}, expected contiguous "
            f"doubles {shape}"
        )
    return double_pointer(array)
