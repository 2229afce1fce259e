"""Sums of the normal equations of a trajectory, by the kernel: what ``am_add_residuals`` of kernel.h adds."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import POINTER, byref, c_double, c_int, c_longlong, c_size_t, pointer
from typing import Any, NamedTuple

import numpy as np

from .kernel import _checked, _doubles, _pointer, library


class _Sums(ctypes.Structure):
    _fields_ = [("states", c_int), ("constants", c_int)] + [(name, _doubles) for name in ("D", "O", "G", "C", "gx", "gc", "cost")]


class _Residuals(ctypes.Structure):
    _fields_ = [("rows", c_int), ("states", c_int), ("columns", c_int), ("column", POINTER(c_int))]
    _fields_ += [(name, _doubles) for name in ("r", "weight", "J")]


class Path(ctypes.Structure):
    """``am_path``: pointers to states, rates and specific force, the step and what surrounds the path."""

    _fields_ = [(name, _doubles) for name in ("x", "rates", "force")]
    _fields_ += [(name, c_double) for name in ("dt", "gravity", "fall", "level")]
    _fields_ += [("spin", c_double * 3), ("transport", c_double * 9), ("sensed", c_double * 3)]

    def __init__(self, x, rates, force, dt: float, around: Surroundings):
        super().__init__(x, rates, force, dt, around.gravity, around.fall, around.level)
        self.spin[:], self.sensed[:] = around.spin.tolist(), around.sensed.tolist()
        self.transport[:] = around.transport.ravel().tolist()


class _Group(ctypes.Structure):
    _fields_ = [("given", _Residuals), ("count", c_size_t), ("A", _doubles), ("B", _doubles)]
    _fields_ += [("path", POINTER(Path)), ("k", POINTER(c_longlong)), ("f", _doubles)]


class Surroundings(NamedTuple):
    """What a flight path passes through.

    Attributes
    ----------
    gravity, fall, level : float
        Gravity at the height `level` [m s-2], what it loses per metre [s-2], and that height [m].
    spin : array (3,)
        Rate of the Earth, north-east-down. [rad s-1]
    transport : array (3, 3)
        ``transport @ v`` is the rate at which the level axes turn because they are carried along. [m-1]
    sensed : array (3,)
        Rate of the Earth as far as the gyros show it, north-east-down. [rad s-1]
    """

    gravity: float
    fall: float
    level: float
    spin: np.ndarray
    transport: np.ndarray
    sensed: np.ndarray


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
        self.D, self.O = np.zeros((samples, states, states)), np.zeros((samples - 1, states, states))
        self.G, self.C = np.zeros((samples, states, constants)), np.zeros((constants, constants))
        self.gx, self.gc = np.zeros((samples, states)), np.zeros(constants)
        self._cost = np.zeros(1)
        arrays = (self.D, self.O, self.G, self.C, self.gx, self.gc, self._cost)
        self._sums = _Sums(states, constants, *(array.ctypes.data_as(_doubles) for array in arrays))
        self._rest: Elimination | None = None
        self._waiting: list[tuple[_Group, Any]] | None = None

    @contextmanager
    def together(self) -> Iterator[None]:
        """Add what is added inside only at the end, all residuals of a stretch of samples before the next: the sums stay in the cache."""
        waiting: list[tuple[_Group, Any]] = []
        self._waiting = waiting
        try:
            yield
        finally:
            self._waiting = None
        self._add(waiting)

    def _add(self, groups: list[tuple[_Group, Any]]) -> None:
        array = (_Group * len(groups))(*(group for group, _ in groups))
        if library().am_add_residuals(byref(self._sums), len(self.D), array, len(groups)):
            sizes = f"{self._sums.states} states and {self._sums.constants} constants"
            raise ValueError(f"{sizes}: more than the kernel sums at once, 32")

    def _take(self, group: _Group, *kept: Any) -> None:
        if self._waiting is None:
            self._add([(group, kept)])
        else:
            self._waiting.append((group, kept))

    def clear(self) -> None:
        """Set all sums to zero: memory in use costs less than new memory."""
        for array in (self.D, self.O, self.G, self.C, self.gx, self.gc, self._cost):
            array.fill(0.0)

    @property
    def cost(self) -> float:
        """Sum of the squared residuals."""
        return float(self._cost[0])

    @cost.setter
    def cost(self, value: float) -> None:
        self._cost[0] = value

    def steps(self, r: np.ndarray, weight: np.ndarray, A: np.ndarray, B: np.ndarray, columns: np.ndarray, J: np.ndarray) -> None:
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
        A, B = (_checked(item, (len(self.D) - 1, r.shape[1], A.shape[-1])) for item in (A, B))
        self._take(_Group(given, len(r), _pointer(A), _pointer(B)), kept, A, B)

    def path_steps(self, x, rates, force, dt: float, around: Surroundings, weight, columns, J) -> None:
        """Add what the instruments would have to be wrong by between the samples of a flight path.

        In body axes at the middle of the step, R and the rates W of the angles taken there::

            W (angles_k+1 - angles_k)/dt + R' (transport v + sensed) - rates
            R' [(v_k+1 - v_k)/dt + (2 spin + transport v) x v - g] - force
            (h_k+1 - h_k)/dt + v_down

        Parameters
        ----------
        x : array (N, n)
            States that begin with phi, theta, psi [rad], velocity north, east, down [m s-1], height [m].
        rates, force : array (N - 1, 3)
            Means of the body rates [rad s-1] and of the specific force [m s-2] over the steps.
        dt : float
            [s]
        around : Surroundings
        weight : array (N - 1, 7)
        columns : array of int (p,)
            The constants involved, each once.
        J : array (N - 1, 7, p)
            Derivatives of the residuals by them.
        """
        steps = len(self.D) - 1
        given, kept = _given(np.broadcast_to(0.0, (steps, 7)), weight, 7, self._among(columns), J)
        x, rates, force = _checked(x, (steps + 1, self.D.shape[1])), _checked(rates, (steps, 3)), _checked(force, (steps, 3))
        path = Path(_pointer(x), _pointer(rates), _pointer(force), dt, around)
        self._take(_Group(given, steps, path=pointer(path)), kept, x, rates, force)

    def readings(self, r, weight, k, f, A, columns, J) -> None:
        """Add residuals of readings at (1 - f) x_k + f x_k+1: k and f (M,), the others as in `steps` with M for N - 1."""
        group, kept = reading_group(r, k, f, A, self._among(columns), J, weight, len(self.D))
        self._take(group, kept)

    def eliminate(self) -> Elimination:
        """Return the normal equations with the states eliminated, T = F F'; the next call writes over what it returns.

        Raises
        ------
        LinAlgError
            With sample and state that nothing determines, as its arguments.
        """
        samples, states, constants = self.G.shape
        rest = self._rest = self._rest or Elimination(samples, states, constants)
        rest.products.fill(0.0)
        failed = library().am_eliminate(byref(self._sums), samples, *map(_pointer, (rest.L, rest.V, rest.columns, rest.products)))
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
    J = _checked(J, (*r.shape, len(column)))
    pointers = column.ctypes.data_as(POINTER(c_int)), _pointer(r), _pointer(weight), _pointer(J)
    return _Residuals(r.shape[1], states, len(column), *pointers), (r, weight, column, J)


def reading_group(r, k, f, A, columns, J, weight, samples: int) -> tuple[_Group, Any]:
    """Return readings as the kernel takes them, and what has to stay in memory for it; arguments as in `NormalSums.readings`."""
    given, kept = _given(r, weight, A.shape[-1], columns, J)
    before, share, A = np.ascontiguousarray(k, np.int64), _checked(f, (len(r),)), _checked(A, (*r.shape, A.shape[-1]))
    last = before + (share != 0.0)
    if len(before) != len(r) or (len(before) and not 0 <= before.min() <= last.max() < samples):
        raise IndexError(f"{len(r)} readings at samples {before.min()} ... {last.max()} of {samples}")
    places = before.ctypes.data_as(POINTER(c_longlong))
    return _Group(given, len(before), _pointer(A), k=places, f=_pointer(share)), (kept, before, share, A)


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
        self.columns, self.products, self._used = np.empty((samples, states, width)), np.empty((width, width)), constants + 1

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
        """Return F^-1 [G, gx] times directions of constants and right-hand side (nc + 1, m), (N, n, m)."""
        samples, states, width = self.columns.shape
        full = np.zeros((width, directions.shape[1]))
        full[: self._used] = directions
        return (self.columns.reshape(-1, width) @ full).reshape(samples, states, -1)

    def back(self, x: np.ndarray) -> np.ndarray:
        """Return F'^-1 x (N, n, any), written over x."""
        samples, states, columns = x.shape
        library().am_substitute(states, samples, _pointer(self.L), _pointer(self.V), columns, _pointer(_checked(x, x.shape)))
        return x
