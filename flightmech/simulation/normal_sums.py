"""Sums of the normal equations of a trajectory, by the kernel: what ``am_add_steps`` and ``am_add_readings`` of kernel.h add."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, byref, c_int
from typing import Any

import numpy as np

from .kernel import _checked, _doubles, _pointer, library


class _Sums(ctypes.Structure):
    _fields_ = [("states", c_int), ("constants", c_int)] + [(name, _doubles) for name in ("D", "O", "G", "C", "gx", "gc", "cost")]


class _Residuals(ctypes.Structure):
    _fields_ = [("rows", c_int), ("states", c_int), ("columns", c_int), ("column", POINTER(c_int))]
    _fields_ += [(name, _doubles) for name in ("r", "weight", "J")]


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
        given, _kept = self._given(r, weight, A.shape[-1], columns, J)
        A, B = (_checked(item, (len(self.D) - 1, r.shape[1], A.shape[-1])) for item in (A, B))
        self._demand(library().am_add_steps(byref(self._sums), byref(given), len(r), _pointer(A), _pointer(B)))

    def readings(self, r, weight, k, f, A, columns, J) -> None:
        """Add residuals of readings at (1 - f) x_k + f x_k+1: k and f (M,), the others as in `steps` with M for N - 1."""
        given, _kept = self._given(r, weight, A.shape[-1], columns, J)
        before, share, A = np.ascontiguousarray(k, np.int64), _checked(f, (len(r),)), _checked(A, (*r.shape, A.shape[-1]))
        last = before + (share != 0.0)
        if len(before) != len(r) or (len(before) and not 0 <= before.min() <= last.max() < len(self.D)):
            raise IndexError(f"{len(r)} readings at samples {before.min()} ... {last.max()} of {len(self.D)}")
        places = before.ctypes.data_as(POINTER(ctypes.c_longlong))
        self._demand(library().am_add_readings(byref(self._sums), byref(given), len(before), places, _pointer(share), _pointer(A)))

    def eliminate(self) -> Elimination:
        """Return the normal equations with the states eliminated, T = F F'.

        Raises
        ------
        LinAlgError
            With sample and state that nothing determines, as its arguments.
        """
        samples, states, constants = self.G.shape
        rest = Elimination(samples, states, constants)
        L, M, border = rest.L, rest.M, rest.border
        failed = library().am_eliminate(byref(self._sums), samples, *map(_pointer, (L, M, border)))
        if failed >= 0:
            raise np.linalg.LinAlgError(*divmod(failed, states))
        border[...] = np.tril(border) + np.tril(border, -1).T
        return rest

    def _given(self, r, weight, states: int, columns, J) -> tuple[_Residuals, Any]:
        r = np.ascontiguousarray(r, float)
        weight = np.ascontiguousarray(np.broadcast_to(weight, r.shape), float)
        column = np.ascontiguousarray(columns, np.intc)
        J = _checked(J, (*r.shape, len(column)))
        if len(column) and not 0 <= column.min() <= column.max() < len(self.C):
            raise IndexError(f"constants {column.min()} ... {column.max()} of {len(self.C)}")
        pointers = column.ctypes.data_as(POINTER(c_int)), _pointer(r), _pointer(weight), _pointer(J)
        return _Residuals(r.shape[1], states, len(column), *pointers), (r, weight, column, J)

    def _demand(self, status: int) -> None:
        if status:
            raise ValueError(f"{self._sums.states} states and {self._sums.constants} constants: more than the kernel sums at once, 64")


class Elimination:
    """What `NormalSums.eliminate` leaves.

    Attributes
    ----------
    L, M : array (N, n, n), (N, n, n + nc + 1)
        Diagonal blocks of the factor; blocks below them, then F^-1 [G, gx].
    border : array (nc + 1, nc + 1)
        Products of the columns of F^-1 [G, gx].
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.L, self.M = np.empty((samples, states, states)), np.empty((samples, states, states + constants + 1))
        self.border = np.zeros((constants + 1, constants + 1))

    @property
    def right(self) -> np.ndarray:
        """F^-1 [G, gx] (N, n, nc + 1)."""
        return self.M[:, :, self.L.shape[1] :]

    def back(self, right: np.ndarray) -> np.ndarray:
        """Return F'^-1 right, (N, n, any)."""
        samples, states, columns = right.shape
        x = np.array(right, float, order="C")
        sizes = states, self.M.shape[2] - states - 1, samples
        library().am_substitute(*sizes, _pointer(self.L), _pointer(self.M), columns, _pointer(x))
        return x
