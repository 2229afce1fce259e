"""Splines in time over a record, as matrices, with their normal equations and covariance."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

_DEGREE = 5
# Number of splines that are not zero at one time.
_SPAN = _DEGREE + 1


class RecordSplines:
    """Splines of fifth degree over a record, with their derivatives.

    The knots are half a period of the cut-off apart.

    Parameters
    ----------
    time : array (time,)
        [s]
    cutoff : float
        [Hz]

    Attributes
    ----------
    count : int
        Number of coefficients.
    value, slope, bend : array (time, coefficient)
        Values of the splines, and their first and second derivatives in time.
    start : array of int (time,)
        First spline that is not zero at each time.
    """

    def __init__(self, time: np.ndarray, cutoff: float):
        self.time = time
        pieces = max(1, int(np.ceil((time[-1] - time[0]) * 2.0 * cutoff)))
        inner = np.linspace(time[0], time[-1], pieces + 1)
        knots = np.concatenate([np.full(_DEGREE, time[0]), inner, np.full(_DEGREE, time[-1])])
        self.count = pieces + _DEGREE
        basis = BSpline(knots, np.eye(self.count), _DEGREE)
        self.value, self.slope, self.bend = (basis(time, nu=order) for order in range(3))
        self.start = np.clip(np.searchsorted(inner, time, side="right") - 1, 0, pieces - 1)

    def through(self, y: np.ndarray) -> np.ndarray:
        """Return the coefficients (coefficient, column) of the least squares through values."""
        return np.linalg.lstsq(self.value, y, rcond=None)[0]

    def normal(self, J: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal equations of residuals (time, row) with slopes (time, row, column)."""
        width = J.shape[2]
        N, b = np.zeros((self.count * width,) * 2), np.zeros(self.count * width)
        products, gradients = np.swapaxes(J, 1, 2) @ J, np.einsum("trc,tr->tc", J, e)
        # coefficients are ordered (spline, column); only _SPAN splines act at one time
        for t, first in enumerate(self.start):
            B = self.value[t, first : first + _SPAN]
            block = slice(first * width, (first + _SPAN) * width)
            N[block, block] += np.kron(np.outer(B, B), products[t])
            b[block] += np.kron(B, gradients[t])
        return N, b

    def covariance(self, C: np.ndarray, width: int, use: slice) -> np.ndarray:
        """Return the covariance (time, 3 width, 3 width) of values and derivatives at one time."""
        covariances = []
        for t in range(len(self.value))[use]:
            first = self.start[t]
            splines = slice(first, first + _SPAN)
            D = np.array([self.value[t, splines], self.slope[t, splines], self.bend[t, splines]])
            block = slice(first * width, (first + _SPAN) * width)
            part = C[block, block].reshape(_SPAN, width, _SPAN, width)
            # D maps spline coefficients a, b to the derivatives k, l of the columns i, j
            covariance = np.einsum("ka,aibj,lb->kilj", D, part, D)
            covariances.append(covariance.reshape(3 * width, 3 * width))
        return np.array(covariances)
