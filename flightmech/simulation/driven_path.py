"""Paths that gyros and accelerometers drive from their start, by the kernel: what ``am_follow`` of kernel.h computes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, byref, c_double, c_int
from typing import NamedTuple

import numpy as np

from .kernel import _checked, _doubles, _pointer, library
from .normal_sums import Path, Surroundings, reading_group

BIAS, SCALE, WIND, LAG = 0, 6, 12, 15  # AM_BIAS and the others of kernel.h
_OWN = 7  # states without vanes


class _Drive(ctypes.Structure):
    _fields_ = [("path", Path)] + [(name, c_int) for name in ("states", "inputs", "vanes")] + [("side", c_int * 2)]
    _fields_ += [("input", POINTER(c_int)), ("sensed", _doubles), ("gain", c_double * 6), ("arm", c_double * 3), ("wind", c_double * 3)]
    _fields_ += [("vane_arm", c_double * 6), ("lag", c_double * 3), ("lag_slope", c_double * 3)]


class _Driven(ctypes.Structure):
    _fields_ = [("states", c_int), ("columns", c_int), ("unknowns", c_int), ("X", _doubles)]


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
        Weights of the state before, the angle before and the angle after a step, and their derivatives by the time constant.
    """

    side: Sequence[int]
    arms: np.ndarray
    wind: np.ndarray
    lag: np.ndarray
    lag_slope: np.ndarray


class DrivenPath:
    """Path and sensitivities of one stretch of uniform samples.

    Parameters
    ----------
    inertial : Inertial
    before : array (N, n)
        A path from which gravity, Coriolis acceleration and the turning of the level axes are taken.
    dt : float
        [s]
    around : Surroundings
    inputs : sequence of int
        Constants to which derivatives are wanted, each once: `BIAS` + i and `SCALE` + i of p, q, r and of the specific force forward,
        right, down, `WIND` + i, `LAG`.
    vanes : Vanes

    Raises
    ------
    ValueError
        Arrays of other sizes, an unknown input.
    """

    def __init__(self, inertial: Inertial, before: np.ndarray, dt: float, around: Surroundings, inputs: Sequence[int], vanes: Vanes):
        self.samples, self.states, self.inputs = len(before), _OWN + len(vanes.side), len(inputs)
        rates, force, sensed = (_checked(item, (self.samples, 3)) for item in (inertial.rates, inertial.force, inertial.sensed))
        before = _checked(before, (self.samples, self.states))
        self._kept = rates, force, sensed, before
        d = self._drive = _Drive(Path(_pointer(before), _pointer(rates), _pointer(force), dt, around))
        d.states, d.inputs, d.vanes, d.sensed = self.states, self.inputs, len(vanes.side), _pointer(sensed)
        d.input = (c_int * len(inputs))(*inputs)
        d.side[: len(vanes.side)] = list(vanes.side)
        for name, size in (("gain", 6), ("arm", 3)):
            getattr(d, name)[:] = _checked(getattr(inertial, name), (size,)).tolist()
        for name in ("wind", "lag", "lag_slope"):
            getattr(d, name)[:] = _checked(getattr(vanes, name), (3,)).tolist()
        d.vane_arm[: 3 * len(vanes.side)] = _checked(vanes.arms, (len(vanes.side), 3)).ravel().tolist()

    def follow(self, start: np.ndarray, x: np.ndarray, X: np.ndarray | None = None) -> None:
        """Write the path from start (n,) into x (N, n), and its derivatives by start and inputs into X (N, n, n + inputs).

        Notes
        -----
        Rates and accelerations are cubics between samples, attitude takes the fourth-order Magnus step, velocity Simpson's rule over
        it; height and sensitivities the trapezoidal rule (1e-5 of their size at 50 Hz).  Straight lines between samples would
        take (omega dt)^2/12 off what oscillates with omega: 1e-3 at 0.9 Hz and 50 samples per second, found again in the vane factors.
        """
        out = _written(x, (self.samples, self.states))
        columns = None if X is None else _written(X, (self.samples, self.states, self.states + self.inputs))
        self._demand(library().am_follow(byref(self._drive), self.samples, _pointer(_checked(start, (self.states,))), out, columns))

    def add_noise(self, x: np.ndarray, noise: np.ndarray, pressed: np.ndarray, products: np.ndarray) -> None:
        """Add to products (u, u) the covariance that the noise of the inertial unit gives to the sum of `pressed`.

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
        given = _pointer(_checked(x, (self.samples, self.states))), unknowns, _pointer(_checked(noise, (6,)))
        pointers = _pointer(_checked(pressed, (self.samples, self.states, unknowns))), _written(products, (unknowns, unknowns))
        self._demand(library().am_add_noise(byref(self._drive), self.samples, *given, *pointers))

    def _demand(self, code: int) -> None:
        if code:
            raise ValueError(f"the kernel follows no path of {self.samples} samples, {self.states} states and these inputs or sums")


class Readings(NamedTuple):
    """Readings of one sensor along a driven path.

    Attributes
    ----------
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        They are at (1 - f) x_k + f x_k+1.
    A : array (M, m, q)
        Derivative by the first q of the state there.
    columns : array of int (p,)
        Places of constants among the unknowns, -1 of those that stay.
    J : array (M, m, p)
        Derivative by them.
    """

    r: np.ndarray
    k: np.ndarray
    f: np.ndarray
    A: np.ndarray
    columns: np.ndarray
    J: np.ndarray


def driven_products(X: np.ndarray, unknowns: int, readings: Readings) -> np.ndarray:
    """Return for each channel of a sensor the sums of products of its derivatives by the unknowns and its residual, (m, u + 1, u + 1).

    Parameters
    ----------
    X : array (N, n, columns)
        Derivatives of the path, see `DrivenPath.follow`; its columns are the first of the unknowns.
    unknowns : int
        u.
    readings : Readings
    """
    products = np.zeros((readings.r.shape[1], unknowns + 1, unknowns + 1))
    _add(X, unknowns, readings, 0.0, products, None, None)
    return products


def driven_series(X: np.ndarray, unknowns: int, readings: Readings, weight: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """Return the derivatives of each channel by the unknowns (m, u, M), and add their squares times weight (m,) by the state to pressed.

    Arguments as in `driven_products`; pressed (N, n, u) takes J' weight^2 A, J the derivatives by the state and A those by the unknowns.
    """
    series = np.zeros((readings.r.shape[1], unknowns, len(readings.r)))
    _add(X, unknowns, readings, weight, None, series, pressed)
    return series


def _add(X, unknowns: int, readings: Readings, weight, products, series, pressed) -> None:
    samples, states, columns = X.shape
    group, kept = reading_group(*readings, weight, samples)
    low, high = min(readings.columns, default=-1), max(readings.columns, default=-1)
    if not (-1 <= low <= high < unknowns and columns <= unknowns):
        raise IndexError(f"{columns} columns and constants {low} ... {high} of {unknowns} unknowns")
    driven = _Driven(states, columns, unknowns, _pointer(_checked(X, X.shape)))
    out = None if pressed is None else _written(pressed, (samples, states, unknowns))
    sums = (None if item is None else _pointer(item) for item in (products, series))
    if library().am_add_driven(byref(driven), byref(group), *sums, out):
        raise ValueError(f"{unknowns} unknowns or {readings.A.shape[-1]} states: more than the kernel sums at once, 96 and {states}")
    del kept


def _written(array: np.ndarray, shape: tuple[int, ...]):
    """Return the pointer of an array that the kernel writes."""
    if array.shape != shape or array.dtype != float or not array.flags.c_contiguous:
        raise ValueError(f"array of {array.dtype} has the shape {array.shape}, expected contiguous doubles {shape}")
    return _pointer(array)
