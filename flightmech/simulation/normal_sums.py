"""Sums of the normal equations of a trajectory, computed by the kernel.

The residuals of steps between samples and of readings are those of ``am_add_residuals`` of
kernel.h.  Unknowns are n states at each of N samples, and nc constants.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import POINTER, byref, c_longlong, pointer
from typing import Any, NamedTuple

import numpy as np

from flightmech.simulation.driven_path import DrivenPath, output_pointer
from flightmech.simulation.kernel_library import (
    INTEGERS,
    DrivenStruct,
    GroupStruct,
    ResidualsStruct,
    SumsStruct,
    check_array,
    double_pointer,
    load_kernel,
)

_LANES = 4  # columns of the elimination are a multiple of this number


class _ResidualGroup(NamedTuple):
    """A structure for the kernel, and the arrays that must stay in memory for it."""

    struct: GroupStruct
    arrays: tuple[Any, ...]


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
        Blocks of the states (rows) with the constants (columns).
    C : array (nc, nc)
        Block of the constants.
    gx, gc : array (N, n), (nc,)
        Half of the gradient.
    """

    def __init__(self, samples: int, states: int, constants: int):
        # np.empty may use large pages. np.zeros would leave the first access of each small page
        # to the sums.
        self.D = np.empty((samples, states, states))
        self.O = np.empty((samples - 1, states, states))
        self.G = np.empty((samples, states, constants))
        self.C = np.empty((constants, constants))
        self.gx, self.gc = np.empty((samples, states)), np.empty(constants)
        self._cost = np.empty(1)
        self.clear()
        pointers = map(double_pointer, self._arrays)
        self._sums = SumsStruct(states, constants, *pointers)
        self._elimination: Elimination | None = None
        self._collected: list[_ResidualGroup] | None = None

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        return self.D, self.O, self.G, self.C, self.gx, self.gc, self._cost

    @contextmanager
    def collect_groups(self) -> Iterator[None]:
        """Collect the residual groups of the block, and add them in one pass at its end.

        The kernel then adds all residuals of a range of samples before the next range, so that the
        sums stay in the cache.
        """
        groups: list[_ResidualGroup] = []
        self._collected = groups
        try:
            yield
        finally:
            self._collected = None
        self._add(groups)

    def _add(self, groups: Sequence[_ResidualGroup]) -> None:
        structs = (GroupStruct * len(groups))(*[group.struct for group in groups])
        samples = len(self.D)
        if load_kernel().am_add_residuals(byref(self._sums), samples, structs, len(groups)):
            raise ValueError(
                f"{self._sums.states} states and {self._sums.constants} constants: more than the "
                f"kernel sums at once, 32; or a path with an unknown input"
            )

    def _add_or_collect(self, group: _ResidualGroup) -> None:
        if self._collected is None:
            self._add([group])
        else:
            self._collected.append(group)

    def clear(self) -> None:
        """Set all sums to zero. It is faster than new arrays."""
        for array in self._arrays:
            array.fill(0.0)

    def reuse_elimination(self, source: NormalSums) -> None:
        """Reuse the memory of the elimination of sums of the same size."""
        self._elimination = source._elimination or self._elimination
        source._elimination = None

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
        """Add residuals between adjacent samples.

        Parameters
        ----------
        r, weight : array (N - 1, m)
            The residuals are r times their weight, and so are the derivatives.
        A, B : array (N - 1, m, q)
            Derivatives with respect to the first q states before and after the step.
        columns : array of int (p,)
            The constants involved, each once.
        J : array (N - 1, m, p)
            Derivatives with respect to these constants.
        """
        # the arrays stay in memory with the group
        residuals, arrays = _pack_residuals(
            r, weight, A.shape[-1], columns=self._check_columns(columns), J=J
        )
        shape = (len(self.D) - 1, r.shape[1], A.shape[-1])
        before, after = check_array(A, shape), check_array(B, shape)
        struct = GroupStruct(residuals, len(r), double_pointer(before), double_pointer(after))
        self._add_or_collect(_ResidualGroup(struct, (*arrays, before, after)))

    def path_steps(self, path: DrivenPath, weight: Any, columns: Any) -> None:
        """Add the errors of inertial unit and vanes that explain each step of a path.

        In body axes at the middle of the step, with R and the rates W of the angles at that
        attitude, and with rates and force as their means over the step, the residuals are::

            W (angles_k+1 - angles_k)/dt + R' (transport v + sensed) - rates
            R' [(v_k+1 - v_k)/dt + (2 spin + transport v) x v - g] - force
            (h_k+1 - h_k)/dt + v_down

        and of each vane y_k+1 - E y_k - c0 angle_k - c1 angle_k+1, or y_k+1 - y_k in the slow
        steps of the path.

        Parameters
        ----------
        path : DrivenPath
        weight : array (N - 1, 7 + vanes)
            A step whose first weight is zero separates two windows.
        columns : array of int (p,)
            Positions of the inputs of `path` among the constants.
        """
        rows, samples = 7 + len(path.vanes.side), len(self.D)
        if (path.samples, path.states) != self.D.shape[:2]:
            raise ValueError(
                f"path of {path.samples} samples and {path.states} states, expected "
                f"{samples} and {self.D.shape[1]}"
            )
        weight = check_array(weight, (samples - 1, rows))
        column = self._check_columns(columns)
        # the kernel computes residuals and derivatives from the path
        residuals = ResidualsStruct(
            rows=rows,
            states=rows + 3 * path.gusts,
            columns=len(column),
            column=column.ctypes.data_as(INTEGERS),
            weight=double_pointer(weight),
        )
        struct = GroupStruct(residuals, samples - 1, drive=pointer(path.drive))
        self._add_or_collect(_ResidualGroup(struct, (weight, column, path)))

    def readings(self, r: Any, weight: Any, k: Any, f: Any, A: Any, columns: Any, J: Any) -> None:
        """Add residuals of readings at (1 - f) x_k + f x_k+1.

        k and f are (M,), and the other arguments are as in `steps` with M in place of N - 1. A may
        have the derivatives of a single reading, which then hold for all readings.
        """
        readings = Readings(r, k, f, A=A, columns=self._check_columns(columns), J=J)
        self._add_or_collect(_pack_readings(readings, weight, len(self.D)))

    def eliminate(self) -> Elimination:
        """Return the normal equations with the states eliminated, T = F F'.

        The next call overwrites the result.

        Raises
        ------
        LinAlgError
            A state is not determined: twelve digits of its information cancel. The arguments are
            the sample and the state.
        ValueError
            More states than the kernel eliminates at once.
        """
        samples, states, constants = self.G.shape
        if self._elimination is None:
            self._elimination = Elimination(samples, states, constants)
        result = self._elimination
        result.products.fill(0.0)
        pointers = map(double_pointer, (result.L, result.V, result.columns, result.products))
        failed = load_kernel().am_eliminate(byref(self._sums), samples, *pointers)
        if failed < -1:
            raise ValueError(f"{states} states: the kernel eliminates 1 ... 32 at once")
        # a failure is the number of the state among all states of all samples
        if failed >= 0:
            raise np.linalg.LinAlgError(*divmod(failed, states))
        return result

    def _check_columns(self, columns: Any) -> np.ndarray:
        column = np.ascontiguousarray(columns, np.intc)
        if len(column) and not 0 <= column.min() <= column.max() < len(self.C):
            raise IndexError(f"constants {column.min()} ... {column.max()} of {len(self.C)}")
        return column


def _pack_residuals(
    r: Any, weight: Any, states: int, columns: Any, J: Any
) -> tuple[ResidualsStruct, tuple[np.ndarray, ...]]:
    """Return the structure of residuals, and the arrays of its pointers."""
    r = np.ascontiguousarray(r, float)
    # one weight may hold for all residuals of a row
    weight = np.ascontiguousarray(np.broadcast_to(weight, r.shape), float)
    column = np.ascontiguousarray(columns, np.intc)
    J = check_array(J, (*r.shape, len(column)))
    struct = ResidualsStruct(
        rows=r.shape[1],
        states=states,
        columns=len(column),
        column=column.ctypes.data_as(INTEGERS),
        r=double_pointer(r),
        weight=double_pointer(weight),
        J=double_pointer(J),
    )
    return struct, (r, weight, column, J)


def _pack_readings(readings: Readings, weight: Any, samples: int) -> _ResidualGroup:
    """Return the group of the readings of a sensor along a path of `samples` samples."""
    count, states = len(readings.r), readings.A.shape[-1]
    residuals, arrays = _pack_residuals(
        readings.r, weight, states, columns=readings.columns, J=readings.J
    )
    before = np.ascontiguousarray(readings.k, np.int64)
    fraction = check_array(readings.f, (count,))
    # one set of derivatives may hold for all readings
    same = len(readings.A) == 1
    A = check_array(readings.A, (1 if same else count, readings.r.shape[1], states))
    # a reading at a sample does not use the next sample
    last = before + (fraction != 0.0)
    if len(before) != count or (len(before) and not 0 <= before.min() <= last.max() < samples):
        raise IndexError(
            f"{count} readings at samples {before.min()} ... {last.max()} of {samples}"
        )
    struct = GroupStruct(
        residuals,
        len(before),
        A=double_pointer(A),
        same=same,
        k=before.ctypes.data_as(POINTER(c_longlong)),
        f=double_pointer(fraction),
    )
    return _ResidualGroup(struct, (*arrays, before, fraction, A))


class Elimination:
    """Result of `NormalSums.eliminate`.

    Attributes
    ----------
    L, V : array (N, n, n)
        Diagonal blocks of the factor, and the transposed blocks below them.
    columns : array (N, n, width)
        F^-1 [G, gx] and zeros up to a width that is a multiple of four.
    products : array (width, width)
        Lower half of the products of these columns.
    """

    def __init__(self, samples: int, states: int, constants: int):
        self.L, self.V = np.empty((samples, states, states)), np.empty((samples, states, states))
        self._used = constants + 1
        width = (constants + _LANES) // _LANES * _LANES
        self.columns = np.empty((samples, states, width))
        self.products = np.empty((width, width))

    @property
    def right(self) -> np.ndarray:
        """F^-1 [G, gx] (N, n, nc + 1)."""
        return self.columns[..., : self._used]

    @property
    def border(self) -> np.ndarray:
        """Products of the columns of F^-1 [G, gx] (nc + 1, nc + 1)."""
        # the kernel computes the lower half only
        low = self.products[: self._used, : self._used]
        return np.tril(low) + np.tril(low, -1).T

    def multiply_columns(self, directions: np.ndarray) -> np.ndarray:
        """Return F^-1 [G, gx] times directions (nc + 1, m) as an array (N, n, m).

        A direction has one number per constant, and one for the right-hand side.
        """
        samples, states, width = self.columns.shape
        # the last columns are zeros, so that their directions do not matter
        full = np.zeros((width, directions.shape[1]))
        full[: self._used] = directions
        return (self.columns.reshape(-1, width) @ full).reshape(samples, states, -1)

    def substitute_back(self, x: np.ndarray) -> np.ndarray:
        """Return F'^-1 x (N, n, any), written over x."""
        samples, states, columns = x.shape
        # back substitution with the transposed factor, in place
        factor = double_pointer(self.L), double_pointer(self.V)
        right = double_pointer(check_array(x, x.shape))
        load_kernel().am_substitute(states, samples, *factor, columns, right)
        return x


class Readings(NamedTuple):
    """Readings of one sensor along a driven path.

    Attributes
    ----------
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        The readings are at (1 - f) x_k + f x_k+1.
    A : array (M, m, q) or (1, m, q)
        Derivative with respect to the first q states there, of each reading or of all.
    columns : array of int (p,)
        Positions of constants among the unknowns, -1 for constants that are fixed.
    J : array (M, m, p)
        Derivative with respect to these constants.
    """

    r: np.ndarray
    k: np.ndarray
    f: np.ndarray
    A: np.ndarray
    columns: np.ndarray
    J: np.ndarray


def driven_products(X: np.ndarray, unknowns: int, readings: Readings) -> np.ndarray:
    """Return sums of products of derivatives and residual of each channel (m, u + 1, u + 1).

    Parameters
    ----------
    X : array (N, n, columns)
        Derivatives of the path, see `DrivenPath.follow` of `driven_path`. Its columns are the first
        unknowns.
    unknowns : int
        u.
    readings : Readings
    """
    products = np.zeros((readings.r.shape[1], unknowns + 1, unknowns + 1))
    _add_driven(X, unknowns, readings, products=products)
    return products


def driven_series(
    X: np.ndarray, unknowns: int, readings: Readings, weight: np.ndarray, pressed: np.ndarray
) -> np.ndarray:
    """Return the derivatives of each channel with respect to the unknowns (m, u, M).

    Parameters
    ----------
    X, unknowns, readings
        As in `driven_products`.
    weight : array (m,)
        Weights of the channels.
    pressed : array (N, n, u)
        The sum of J' weight^2 A is added to it, J the derivatives with respect to the state, A
        those with respect to the unknowns.
    """
    series = np.zeros((readings.r.shape[1], unknowns, len(readings.r)))
    _add_driven(X, unknowns, readings, weight=weight, series=series, pressed=pressed)
    return series


def _add_driven(
    X: np.ndarray,
    unknowns: int,
    readings: Readings,
    *,
    weight: np.ndarray | float = 0.0,
    products: np.ndarray | None = None,
    series: np.ndarray | None = None,
    pressed: np.ndarray | None = None,
) -> None:
    """Add the sums of readings along a driven path to arrays; None omits a sum."""
    samples, states, columns = X.shape
    group = _pack_readings(readings, weight, samples)
    # -1 marks a constant that is not an unknown
    low, high = min(readings.columns, default=-1), max(readings.columns, default=-1)
    if not (-1 <= low <= high < unknowns and columns <= unknowns):
        raise IndexError(f"{columns} columns and constants {low} ... {high} of {unknowns} unknowns")
    derivatives = check_array(X, X.shape)
    driven = DrivenStruct(states, columns, unknowns, double_pointer(derivatives))
    products_pointer = None if products is None else double_pointer(products)
    series_pointer = None if series is None else double_pointer(series)
    pressed_pointer = None
    if pressed is not None:
        pressed_pointer = output_pointer(pressed, (samples, states, unknowns))
    sums = (products_pointer, series_pointer, pressed_pointer)
    # `group` holds the arrays of its structure until the end of this function
    if load_kernel().am_add_driven(byref(driven), byref(group.struct), *sums):
        raise ValueError(
            f"{unknowns} unknowns or {readings.A.shape[-1]} states: more than the kernel "
            f"sums at once, 96 and {states}"
        )
