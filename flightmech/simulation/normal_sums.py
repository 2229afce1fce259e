"""Sums of the normal equations of a trajectory, by the kernel: what ``am_add_residuals`` of
kernel.h adds.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import POINTER, byref, c_int, c_longlong, c_size_t, pointer
from typing import Any, NamedTuple

import numpy as np

from flightmech.simulation.driven_path import DrivenPath, DriveStruct, output_pointer
from flightmech.simulation.kernel_library import (
    DOUBLES,
    check_array,
    double_pointer,
    load_kernel,
)


class _Sums(ctypes.Structure):
    _fields_ = [("states", c_int), ("constants", c_int)] + [
        (name, DOUBLES) for name in ("D", "O", "G", "C", "gx", "gc", "cost")
    ]


class _Driven(ctypes.Structure):
    _fields_ = [("states", c_int), ("columns", c_int), ("unknowns", c_int), ("X", DOUBLES)]


class _Residuals(ctypes.Structure):
    _fields_ = [("rows", c_int), ("states", c_int), ("columns", c_int), ("column", POINTER(c_int))]
    _fields_ += [(name, DOUBLES) for name in ("r", "weight", "J")]


class _Group(ctypes.Structure):
    _fields_ = [("given", _Residuals), ("count", c_size_t), ("A", DOUBLES), ("B", DOUBLES)]
    _fields_ += [
        ("drive", POINTER(DriveStruct)),
        ("same", c_int),
        ("k", POINTER(c_longlong)),
        ("f", DOUBLES),
    ]


class NormalSums:
    """Blocks of a normal matrix and its gradient, zero at first.

    Parameters
    ----------
    samples, states, constants : int
        N, n and nc.

    Attributes
    ----------
    D, O : array (N, n, n), (N - 1, n, n)
        Blocks of a sample, and of the next sample (rows) with it (columns).
    G : array (N, n, nc)
    C : array (nc, nc)
    gx, gc : array (N, n), (nc,)
        Half of the gradient.
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.D, self.O = (
            np.empty((samples, states, states)),
            np.empty((samples - 1, states, states)),
        )
        self.G, self.C = np.empty((samples, states, constants)), np.empty((constants, constants))
        self.gx, self.gc = np.empty((samples, states)), np.empty(constants)
        self._cost = np.empty(1)
        # np.zeros would leave the first touch of each small page to the sums; np.empty takes large
        # ones where there are any
        self.clear()
        arrays = (self.D, self.O, self.G, self.C, self.gx, self.gc, self._cost)
        self._sums = _Sums(states, constants, *(array.ctypes.data_as(DOUBLES) for array in arrays))
        self._rest: Elimination | None = None
        self._waiting: list[tuple[_Group, Any]] | None = None

    @contextmanager
    def together(self) -> Iterator[None]:
        """Add what is added inside only at the end, all residuals of a stretch of samples before
        the next: the sums stay in the cache.
        """
        waiting: list[tuple[_Group, Any]] = []
        self._waiting = waiting
        try:
            yield
        finally:
            self._waiting = None
        self._add(waiting)

    def _add(self, groups: list[tuple[_Group, Any]]) -> None:
        array = (_Group * len(groups))(*(group for group, _ in groups))
        if load_kernel().am_add_residuals(byref(self._sums), len(self.D), array, len(groups)):
            sizes = f"{self._sums.states} states and {self._sums.constants} constants"
            raise ValueError(
                f"{sizes}: more than the kernel sums at once, 32; or a path with an unknown input"
            )

    def _take(self, group: _Group, *kept: Any) -> None:
        if self._waiting is None:
            self._add([(group, kept)])
        else:
            self._waiting.append((group, kept))

    def clear(self) -> None:
        """Set all sums to zero: memory in use costs less than new memory."""
        for array in (self.D, self.O, self.G, self.C, self.gx, self.gc, self._cost):
            array.fill(0.0)

    def take_room(self, other: NormalSums) -> None:
        """Take over the memory of the elimination of sums of the same size."""
        self._rest, other._rest = other._rest or self._rest, None

    @property
    def cost(self) -> float:
        """Sum of the squared residuals."""
        return float(self._cost[0])

    @cost.setter
    def cost(self, value: float) -> None:
        self._cost[0] = value

    def steps(
        self,
        r: np.ndarray,
        weight: np.ndarray,
        A: np.ndarray,
        B: np.ndarray,
        columns: np.ndarray,
        J: np.ndarray,
    ) -> None:
        """Add residuals between neighbours.

        Parameters
        ----------
        r, weight : array (N - 1, m)
            The residuals are r times their weight; so are the derivatives.
        A, B : array (N - 1, m, q)
            Derivatives by the first q of the state before and after.
        columns : array of int (p,)
            The constants involved, each once.
        J : array (N - 1, m, p)
            Derivatives by them.
        """
        given, kept = _given(r, weight, A.shape[-1], self._among(columns), J)
        A, B = (check_array(item, (len(self.D) - 1, r.shape[1], A.shape[-1])) for item in (A, B))
        self._take(_Group(given, len(r), double_pointer(A), double_pointer(B)), kept, A, B)

    def path_steps(self, path: DrivenPath, weight, columns) -> None:
        """Add what inertial unit and vanes would have to be wrong by between the samples of a path.

        In body axes at the middle of the step, R and the rates W of the angles taken there, rates and force being their means over it::

            W (angles_k+1 - angles_k)/dt + R' (transport v + sensed) - rates
            R' [(v_k+1 - v_k)/dt + (2 spin + transport v) x v - g] - force
            (h_k+1 - h_k)/dt + v_down

        and of each vane y_k+1 - E y_k - c0 angle_k - c1 angle_k+1, or y_k+1 - y_k where it hangs
        freely.

        Parameters
        ----------
        path : DrivenPath
        weight : array (N - 1, 7 + vanes)
            A step whose first weight is zero parts two windows.
        columns : array of int (p,)
            The places among the constants of the inputs of `path`.
        """
        rows, samples = 7 + len(path.vanes.side), len(self.D)
        if (path.samples, path.states) != self.D.shape[:2]:
            raise ValueError(
                f"path of {path.samples} samples and {path.states} states, expected "
                f"{samples} and {self.D.shape[1]}"
            )
        weight, column = check_array(weight, (samples - 1, rows)), self._among(columns)
        pointers = column.ctypes.data_as(POINTER(c_int)), None, double_pointer(weight), None
        given = _Residuals(rows, rows + 3 * path.gusts, len(column), *pointers)
        self._take(_Group(given, samples - 1, drive=pointer(path.drive)), weight, column, path)

    def readings(self, r, weight, k, f, A, columns, J) -> None:
        """Add residuals of readings at (1 - f) x_k + f x_k+1: k and f (M,), the others as in
        `steps` with M for N - 1.

        A may be that of a single reading, which all others share.
        """
        group, kept = _reading_group(r, k, f, A, self._among(columns), J, weight, len(self.D))
        self._take(group, kept)

    def eliminate(self) -> Elimination:
        """Return the normal equations with the states eliminated, T = F F'; the next call writes
        over what it returns.

        Raises
        ------
        LinAlgError
            With sample and state that nothing determines, as its arguments.
        """
        samples, states, constants = self.G.shape
        rest = self._rest = self._rest or Elimination(samples, states, constants)
        rest.products.fill(0.0)
        failed = load_kernel().am_eliminate(
            byref(self._sums),
            samples,
            *map(double_pointer, (rest.L, rest.V, rest.columns, rest.products)),
        )
        if failed >= 0:
            raise np.linalg.LinAlgError(*divmod(failed, states))
        return rest

    def _among(self, columns) -> np.ndarray:
        column = np.ascontiguousarray(columns, np.intc)
        if len(column) and not 0 <= column.min() <= column.max() < len(self.C):
            raise IndexError(f"constants {column.min()} ... {column.max()} of {len(self.C)}")
        return column


def _given(r, weight, states: int, columns, J) -> tuple[_Residuals, Any]:
    r = np.ascontiguousarray(r, float)
    weight = np.ascontiguousarray(np.broadcast_to(weight, r.shape), float)
    column = np.ascontiguousarray(columns, np.intc)
    J = check_array(J, (*r.shape, len(column)))
    pointers = (
        column.ctypes.data_as(POINTER(c_int)),
        double_pointer(r),
        double_pointer(weight),
        double_pointer(J),
    )
    return _Residuals(r.shape[1], states, len(column), *pointers), (r, weight, column, J)


def _reading_group(r, k, f, A, columns, J, weight, samples: int) -> tuple[_Group, Any]:
    """Return readings as the kernel takes them, and what has to stay in memory for it; arguments as
    in `NormalSums.readings`.
    """
    given, kept = _given(r, weight, A.shape[-1], columns, J)
    before, share, same = np.ascontiguousarray(k, np.int64), check_array(f, (len(r),)), len(A) == 1
    A = check_array(A, (1 if same else len(r), r.shape[1], A.shape[-1]))
    last = before + (share != 0.0)
    if len(before) != len(r) or (len(before) and not 0 <= before.min() <= last.max() < samples):
        raise IndexError(
            f"{len(r)} readings at samples {before.min()} ... {last.max()} of {samples}"
        )
    places = before.ctypes.data_as(POINTER(c_longlong))
    return _Group(
        given, len(before), double_pointer(A), same=same, k=places, f=double_pointer(share)
    ), (
        kept,
        before,
        share,
        A,
    )


class Elimination:
    """What `NormalSums.eliminate` leaves.

    Attributes
    ----------
    L, V : array (N, n, n)
        Diagonal blocks of the factor, and the transposed blocks below them.
    columns : array (N, n, width)
        F^-1 [G, gx] and zeros up to a width of fours.
    products : array (width, width)
        Lower half of the products of these columns.
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.L, self.V = np.empty((samples, states, states)), np.empty((samples, states, states))
        width = (constants + 4) // 4 * 4
        self.columns, self.products, self._used = (
            np.empty((samples, states, width)),
            np.empty((width, width)),
            constants + 1,
        )

    @property
    def right(self) -> np.ndarray:
        """F^-1 [G, gx] (N, n, nc + 1)."""
        return self.columns[..., : self._used]

    @property
    def border(self) -> np.ndarray:
        """Products of the columns of F^-1 [G, gx] (nc + 1, nc + 1)."""
        low = self.products[: self._used, : self._used]
        return np.tril(low) + np.tril(low, -1).T

    def along(self, directions: np.ndarray) -> np.ndarray:
        """Return F^-1 [G, gx] times directions of constants and right-hand side (nc + 1, m), (N, n,
        m).
        """
        samples, states, width = self.columns.shape
        full = np.zeros((width, directions.shape[1]))
        full[: self._used] = directions
        return (self.columns.reshape(-1, width) @ full).reshape(samples, states, -1)

    def back(self, x: np.ndarray) -> np.ndarray:
        """Return F'^-1 x (N, n, any), written over x."""
        samples, states, columns = x.shape
        load_kernel().am_substitute(
            states,
            samples,
            double_pointer(self.L),
            double_pointer(self.V),
            columns,
            double_pointer(check_array(x, x.shape)),
        )
        return x


class Readings(NamedTuple):
    """Readings of one sensor along a driven path.

    Attributes
    ----------
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        They are at (1 - f) x_k + f x_k+1.
    A : array (M, m, q) or (1, m, q)
        Derivative by the first q of the state there, of each reading or of all.
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
    """Return for each channel of a sensor the sums of products of its derivatives by the unknowns
    and its residual, (m, u + 1, u + 1).

    Parameters
    ----------
    X : array (N, n, columns)
        Derivatives of the path, see `DrivenPath.follow` of `driven_path`; its columns are the first
        of the unknowns.
    unknowns : int
        u.
    readings : Readings
    """
    products = np.zeros((readings.r.shape[1], unknowns + 1, unknowns + 1))
    _add(X, unknowns, readings, 0.0, products, None, None)
    return products


def driven_series(
    X: np.ndarray, unknowns: int, readings: Readings, weight: np.ndarray, pressed: np.ndarray
) -> np.ndarray:
    """Return the derivatives of each channel by the unknowns (m, u, M), and add their squares times
    weight (m,) by the state to pressed.

    Arguments as in `driven_products`; pressed (N, n, u) takes J' weight^2 A, J the derivatives by
    the state and A those by the unknowns.
    """
    series = np.zeros((readings.r.shape[1], unknowns, len(readings.r)))
    _add(X, unknowns, readings, weight, None, series, pressed)
    return series


def _add(X, unknowns: int, readings: Readings, weight, products, series, pressed) -> None:
    samples, states, columns = X.shape
    group, kept = _reading_group(*readings, weight, samples)
    low, high = min(readings.columns, default=-1), max(readings.columns, default=-1)
    if not (-1 <= low <= high < unknowns and columns <= unknowns):
        raise IndexError(f"{columns} columns and constants {low} ... {high} of {unknowns} unknowns")
    driven = _Driven(states, columns, unknowns, double_pointer(check_array(X, X.shape)))
    out = None if pressed is None else output_pointer(pressed, (samples, states, unknowns))
    sums = (None if item is None else double_pointer(item) for item in (products, series))
    if load_kernel().am_add_driven(byref(driven), byref(group), *sums, out):
        raise ValueError(
            f"{unknowns} unknowns or {readings.A.shape[-1]} states: more than the kernel "
            f"sums at once, 96 and {states}"
        )
    del kept
