"""Response of one mode to its initial state and to inputs, and the search of its root.

A channel of a linear system in one of its modes, lambda = -sigma + j omega, is

    y = b + c t + Re[(A + sum_i B_i int exp(-lambda s) u_i ds) exp(lambda t)]

with the inputs u_i linear between samples.  For given lambda it is linear in all other parameters,
which are eliminated [Golub].  The unknowns of the search are the one or two numbers of lambda,
common to all channels.

References
----------
.. [Golub] Golub, Pereyra, The differentiation of pseudo-inverses and nonlinear least squares
   problems whose variables separate, SIAM J. Numer. Anal. 10, 1973.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy import stats
from scipy.optimize import least_squares
from scipy.signal import lfilter

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.regression.uncertainty.significance import degrees_of_freedom
from flighttest.remarks import Convergence

# Largest number of samples in the search of a start.
_COARSE = 300
# Ratios sigma / omega of the search of a start.
_RATIOS = (-0.1, 0.0, 0.1, 0.3, 0.7)
# Rounds in which the channels get weights from their residuals.
_ROUNDS = 2
# Largest number of evaluations of a search, for each unknown of the root.
_EVALUATIONS = 100
# Change of the root by a further round at which the weights have converged, and above which no
# figure may be used. [standard errors]
SAME, WRONG = 0.5, 1.0
# Smallest tolerance of the root, over its magnitude.
_RELATIVE = 1e-6
# Exponents are clipped at this size, so that no response overflows.
_LARGEST_EXPONENT = 60.0
KINDS = ("oscillation", "aperiodic")
# Range below which an input or a channel does not move: 0.006 deg or 0.1 mm/s. [SI]
MOVES = 1e-4
# Fewest samples of a window, and largest range of its steps over their mean.
_FEWEST, _UNEVEN = 12, 1e-3
# Smallest length of a column, and smallest weight.
_TINY = 1e-300


class AmplitudeTest(NamedTuple):
    """Wald's statistic of the amplitudes of a motion.

    Attributes
    ----------
    F : float
        Statistic per amplitude.
    terms : int
        Number of amplitudes.
    dof : float
        Degrees of freedom of the residuals.
    probability : float
        Probability of a larger statistic by chance.
    """

    F: float
    terms: int
    dof: float
    probability: float


class RootSearch(NamedTuple):
    """End of the search of a root.

    Attributes
    ----------
    complete : bool
        Whether all rounds ended within their tolerance.
    evaluations : int
        Number of evaluations in all rounds.
    change : array (unknown,)
        Change of the root by a further round of weights.
    size : float
        Magnitude of the root.
    """

    complete: bool
    evaluations: int
    change: np.ndarray
    size: float

    def convergence(self, covariance: np.ndarray) -> Convergence:
        """Return the end of the search for a covariance (2, 2) of sigma and omega."""
        stderr = np.sqrt(np.diag(covariance)[: len(self.change)])
        # Without noise the standard errors are those of rounding, below the search tolerance.
        tolerance = np.maximum(SAME * stderr, _RELATIVE * self.size)
        ratio = float(np.max(self.change / tolerance))
        if not self.complete:
            ratio = math.inf
        return Convergence(ratio <= 1.0, self.evaluations, ratio)


class ModeResponse:
    """Response of one mode at a root x = (sigma, omega) or (sigma,), all else eliminated.

    Parameters
    ----------
    t : array (time,)
        Time from the first sample. [s]
    y : array (time, channel)
        Channels that share the mode.
    u : array (time, input)
        Inputs that drive it.
    kind : {"oscillation", "aperiodic"}
        A complex pair or a real root.
    trend : bool
        Whether each channel drifts along a straight line.
    """

    def __init__(self, t: np.ndarray, y: np.ndarray, u: np.ndarray, kind: str, trend: bool):
        self.t, self.y, self.u, self.kind, self.trend = t, y, u - u[:1], kind, trend
        self.step = float(t[1] - t[0])
        self.weight = np.maximum(y.std(axis=0), _TINY)

    def basis(self, x: np.ndarray) -> np.ndarray:
        """Return the columns (time, term): constant, trend, free motion, response to the inputs."""
        is_oscillation = self.kind == "oscillation"
        pole = complex(-x[0], x[1] if is_oscillation else 0.0)
        exponent = np.clip(pole.real * self.t, -_LARGEST_EXPONENT, _LARGEST_EXPONENT)
        responses = [np.exp(exponent + 1j * pole.imag * self.t)]
        responses += [_driven_response(pole, column, self.step) for column in self.u.T]
        columns = [np.ones_like(self.t)]
        if self.trend:
            columns.append(self.t)
        # Real and imaginary part take the complex amplitude of an oscillation.
        for response in responses:
            columns.append(response.real)
            if is_oscillation:
                columns.append(response.imag)
        return np.column_stack(columns)

    def fitted(self, x: np.ndarray) -> np.ndarray:
        """Return the response (time, channel) with the linear parameters of least squares."""
        X = self.basis(x)
        size = _column_sizes(X)
        return (X / size) @ np.linalg.lstsq(X / size, self.y, rcond=1e-12)[0]

    def search_root(self) -> tuple[np.ndarray, RootSearch]:
        """Return the root of the least residual, and the end of its search.

        The search is by grid and least squares. The channels have the weight of their residuals.
        """
        x = self._best_grid_point()
        scale = np.full(len(x), max(abs(x[-1]), abs(x[0])))
        evaluations, complete, change = 0, True, np.zeros(len(x))

        def minimise(start: np.ndarray):
            return least_squares(
                lambda z: ((self.y - self.fitted(z)) / self.weight).ravel(),
                start,
                x_scale=scale,
                xtol=1e-10,
                ftol=1e-12,
                max_nfev=_EVALUATIONS * len(start),
            )

        for _ in range(_ROUNDS):
            search = minimise(x)
            x, complete = search.x, complete and bool(search.success)
            evaluations += int(search.nfev)
            rms = np.sqrt(np.mean((self.y - self.fitted(x)) ** 2, axis=0))
            # A channel without noise would have an infinite weight.
            self.weight = np.maximum(rms, 1e-9 * self.y.std(axis=0))
        # A further round shows how far the root still moves. A single weight has no effect on it.
        if self.y.shape[1] > 1:
            change = np.abs(minimise(x).x - x)
        return x, RootSearch(complete, evaluations, change, float(np.linalg.norm(x)))

    def _best_grid_point(self) -> np.ndarray:
        """Return the grid point of the least residual, on thinned samples."""
        every = max(len(self.t) // _COARSE, 1)
        coarse = ModeResponse(
            self.t[::every], self.y[::every], self.u[::every], kind=self.kind, trend=self.trend
        )
        points = coarse._grid(longest=self.t[-1])
        costs = []
        for x in points:
            costs.append(float((((coarse.y - coarse.fitted(x)) / coarse.weight) ** 2).sum()))
        return points[int(np.argmin(costs))]

    def _grid(self, longest: float) -> list[np.ndarray]:
        """Return the roots of the grid for a window of the duration `longest`. [s]"""
        points = []
        if self.kind == "aperiodic":
            for T in np.geomspace(3.0 * self.step, 3.0 * longest, 40):
                points.append(np.array([1.0 / T]))
                # A growth is searched for only if it is slow.
                if 0.2 * longest < T:
                    points.append(np.array([-1.0 / T]))
            return points
        # From half a cycle in the window to eight samples a cycle.
        fastest = max(2.0 * math.pi / (8.0 * self.step), 4.0 * math.pi / longest)
        for w in np.geomspace(math.pi / longest, fastest, 50):
            points += [np.array([ratio * w, w]) for ratio in _RATIOS]
        return points

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Return the covariance (2, 2) of sigma and omega.

        All other parameters are estimated with them. The residuals are coloured.
        """
        unknowns, basis = len(x), self.basis(x)
        X = self._tangents(x, basis)
        v = self._stack_weighted(self.y - self.fitted(x))
        steps = [self.step] * self.y.shape[1]
        coloured = coloured_covariance_of(X, v, self._pieces(), steps).covariance
        covariance = np.zeros((2, 2))
        covariance[:unknowns, :unknowns] = coloured[:unknowns, :unknowns]
        return covariance

    def test_amplitudes(self, x: np.ndarray) -> AmplitudeTest:
        """Return Wald's test of the amplitudes of the motion.

        Next to an oscillation the drift is a cubic, so that a slow curve is not taken for one.
        """
        basis, channels = self.basis(x), self.y.shape[1]
        drift = 1 + self.trend
        if self.kind == "oscillation":
            powers = (self.t[:, None] / self.t[-1]) ** np.arange(drift, 4)
            basis, drift = np.column_stack([basis[:, :drift], powers, basis[:, drift:]]), 4
        X, size = self._tangents(x, basis), _column_sizes(basis)
        residual = self._stack_weighted(self.y - self.fitted(x))
        v = residual - X @ np.linalg.lstsq(X, residual, rcond=1e-10)[0]
        pieces = self._pieces()
        try:
            C = coloured_covariance_of(X, v, pieces, [self.step] * channels).covariance
        except np.linalg.LinAlgError:
            # The motion is a cubic in this window.
            return AmplitudeTest(0.0, channels, 1.0, 1.0)
        parameters = np.linalg.lstsq(basis / size, self.y, rcond=1e-12)[0] / self.weight
        amplitudes = parameters[drift:].T.ravel()
        # Indices of the amplitudes among the root and the linear parameters, channel by channel.
        columns = np.arange(drift, basis.shape[1])
        indices = len(x) + np.concatenate([k * basis.shape[1] + columns for k in range(channels)])
        inner = np.linalg.lstsq(C[np.ix_(indices, indices)], amplitudes, rcond=1e-12)[0]
        F = float(amplitudes @ inner) / len(indices)
        # Impulses have a flat spectrum: all frequencies of the residual count.
        impulses = np.zeros((1, len(v)))
        impulses[0, [piece.start for piece in pieces]] = 1.0
        dof = float(degrees_of_freedom(impulses, v, pieces, len(indices) + len(x))[0])
        probability = float(stats.f.sf(max(F, 0.0), len(indices), dof))
        return AmplitudeTest(max(F, 0.0), len(indices), dof, probability)

    def _stack_weighted(self, y: np.ndarray) -> np.ndarray:
        """Return weighted channels (time, channel) one after the other."""
        return (y / self.weight).T.ravel()

    def _pieces(self) -> list[slice]:
        """Return the slice of each channel among the stacked residuals."""
        n, channels = self.y.shape
        return [slice(a, b) for a, b in pairwise(range(0, n * channels + 1, n))]

    def _tangents(self, x: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """Return the derivatives of the stacked weighted response (row, unknown).

        The unknowns are the root, then the linear parameters of each channel.
        """
        n, channels = self.y.shape
        basis = basis / _column_sizes(basis)
        unknowns, terms = len(x), basis.shape[1]
        X = np.zeros((n * channels, unknowns + channels * terms))
        # Central differences for the root; the response is linear in the other parameters.
        for k, axis in enumerate(np.eye(unknowns)):
            step = 1e-5 * max(abs(x[k]), abs(x[-1]), 1e-6)
            up, down = self.fitted(x + 1.0 * step * axis), self.fitted(x + -1.0 * step * axis)
            X[:, k] = ((up - down) / (2.0 * step) / self.weight).T.ravel()
        for k, piece in enumerate(self._pieces()):
            X[piece, unknowns + k * terms : unknowns + (k + 1) * terms] = basis
        return X


def _column_sizes(X: np.ndarray) -> np.ndarray:
    """Return the largest magnitude of each column."""
    return np.maximum(np.abs(X).max(axis=0), _TINY)


def _driven_response(pole: complex, u: np.ndarray, step: float) -> np.ndarray:
    """Return int exp(pole (t - s)) u(s) ds from the first sample, `u` linear between samples."""
    z = pole * step
    real = np.clip(z.real, -_LARGEST_EXPONENT, _LARGEST_EXPONENT)
    E = np.exp(real + 1j * z.imag)
    # Weights of the sample at the end and at the beginning of a step. For small z they cancel.
    early = late = 0.5 * step
    if abs(z) > 1e-4:
        late = step * (E - 1.0 - z) / z**2
        early = step * (E - 1.0) / z - late
    response = lfilter([late, early], [1.0, -E], u.astype(complex))
    # The response starts from zero.
    return response - late * u[0] * E ** np.arange(len(u))


def take_samples(
    data: xr.Dataset, channels: Sequence[str], kind: str, inputs: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return outputs (time, channel), inputs (time, input) and time, after all checks."""
    if kind not in KINDS:
        raise SchemaError("motion", [f"kind is {kind!r}; allowed: {', '.join(KINDS)}"])
    for name in (*channels, *inputs):
        if name not in data:
            raise UnknownName(name, map(str, data.data_vars), "channel")
    time = data["time"].values.astype(float)
    steps = np.diff(time)
    if len(time) < _FEWEST or not np.ptp(steps) <= _UNEVEN * steps.mean():
        raise SchemaError(
            "motion",
            [
                f"its time is not uniform or does not rise, or it has fewer than {_FEWEST} "
                f"samples; cut it with flighttest.cut"
            ],
        )
    incomplete = [n for n in (*channels, *inputs) if not np.isfinite(data[n].values).all()]
    if incomplete:
        raise SchemaError(
            "motion",
            [f"{', '.join(incomplete)}: samples are missing; choose a window without gaps"],
        )
    y, u = _columns(data, channels), _columns(data, inputs)
    for name, column in zip(inputs, u.T):
        if np.ptp(column) < MOVES:
            raise IdentificationError(
                f"no excitation: {name} moves by {np.ptp(column):.2g} in the window; choose "
                f"one in which it moves"
            )
    for name, column in zip(channels, y.T):
        if np.ptp(column) < MOVES:
            raise IdentificationError(
                f"no motion: {name} moves by {np.ptp(column):.2g} in the window; it is dead "
                f"or nothing happens there"
            )
    return y, u, time


def _columns(data: xr.Dataset, names: Sequence[str]) -> np.ndarray:
    """Return variables as columns (time, name); no columns without names."""
    columns = np.empty((data.sizes["time"], len(names)))
    for k, name in enumerate(names):
        columns[:, k] = data[name].values
    return columns
