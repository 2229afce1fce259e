"""Fit of one damped sine with a linear trend to a free response.

The model is y = b + c t + exp(-sigma t) (A cos wd t + B sin wd t). The fit is by least squares
with b, c, A, B eliminated at every (sigma, wd) [GolubPereyra1973]. A fit uses all samples. The
alternative, periods between raw extremes, is fragile: one noisy sample can add or remove a period.

References
----------
.. [GolubPereyra1973] G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and
   nonlinear least squares problems whose variables separate, SIAM J. Numer. Anal. 10(2), 1973,
   pp. 413-432.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from flightmech.support.arrays import rms
from pom.tolerances.bands import Invalid, demand_finite

_LEAST_SAMPLES = 7  # one more than the parameters of a mode
_COARSE = 250  # samples for the search of a start point
_GRID = 60  # frequencies of the search
_RATIOS = (-0.1, 0.0, 0.1, 0.3, 0.7)  # sigma / wd of the search
_MOST_DECAY = 50.0  # largest |sigma t|; exp of it stays far from an overflow


@dataclass(frozen=True)
class DampedSine:
    """A damped sine with a linear trend.

    y = offset + slope t + amplitude exp(-sigma t) cos(wd t + phase), t from the first sample.
    """

    sigma: float
    wd: float
    amplitude: float
    phase: float
    offset: float
    slope: float
    residual_rms: float
    duration: float

    @property
    def period(self) -> float:
        """Time of one cycle, 2 pi / wd. [s]"""
        return 2.0 * math.pi / self.wd

    @property
    def damping_ratio(self) -> float:
        """Damping ratio; negative for a growing oscillation."""
        return self.sigma / math.hypot(self.sigma, self.wd)

    @property
    def t_half(self) -> float:
        """Time to half the amplitude; negative: time to double. [s]"""
        return math.log(2.0) / self.sigma if self.sigma else math.inf

    @property
    def cycles(self) -> float:
        """Full cycles in the record."""
        return self.duration / self.period


def fit_mode(time, y) -> DampedSine:
    """Fit one damped sine with a linear trend to a free response.

    Parameters
    ----------
    time : array (time,)
        Rising. [s]
    y : array (time,)
        Free response, from the end of the input on.

    Returns
    -------
    DampedSine

    Raises
    ------
    Invalid
        Fewer samples than a mode needs, a sample that is NaN or infinite, or no clear oscillation:
        less than half a cycle in the record, or an amplitude below twice the residual.
    """
    if len(time) < _LEAST_SAMPLES:
        raise Invalid(f"{len(time)} samples; a mode needs {_LEAST_SAMPLES} at least")
    t, y = np.asarray(time, float) - float(time[0]), np.asarray(y, float)
    demand_finite("the trace", t + float(time[0]), y)
    # Search and first fit use every n-th sample, the final fit uses all.
    every = max(len(t) // _COARSE, 1)
    start = _search_start(t[::every], y[::every])
    if every > 1:
        start = _minimise_residual(t[::every], y[::every], start, tolerance=1e-4)
    sigma, wd = _minimise_residual(t, y, start, tolerance=1e-12)
    projection = _project_trace(t, y, sigma, wd=wd)
    b, c, A, B = projection.theta
    mode = DampedSine(
        sigma=sigma,
        wd=wd,
        amplitude=math.hypot(A, B),
        phase=math.atan2(-B, A),
        offset=b,
        slope=c,
        residual_rms=rms(projection.residual),
        duration=float(t[-1]),
    )
    if mode.cycles < 0.5:
        raise Invalid(
            f"no oscillation: the fit finds {mode.cycles:.2f} of a cycle in {mode.duration:.1f} s"
        )
    if mode.amplitude < 2.0 * mode.residual_rms:
        raise Invalid(
            f"no oscillation stands out: its amplitude is "
            f"{mode.amplitude / mode.residual_rms:.2g} of the rms residual of the fit, 2 is needed"
        )
    return mode


def phase_at(t: np.ndarray, y: np.ndarray, *, sigma: float, wd: float) -> float:
    """Return the phase of a trace that is fitted at given (sigma, wd). [rad]"""
    _, _, A, B = _project_trace(t, y, sigma, wd=wd).theta
    return math.atan2(-B, A)


def fit_linear_part(
    t: np.ndarray, y: np.ndarray, *, sigma: float, wd: float
) -> tuple[float, float, float, float]:
    """Return offset, slope, amplitude and phase [rad] of a trace at given (sigma, wd).

    They are those of `DampedSine`, in the unit of the trace.
    """
    b, c, A, B = _project_trace(t, y, sigma, wd=wd).theta
    return float(b), float(c), math.hypot(A, B), math.atan2(-B, A)


@dataclass(frozen=True)
class _Projection:
    """Least-squares fit of a trace at given (sigma, wd).

    The regressors are 1, t, exp(-sigma t) cos wd t and exp(-sigma t) sin wd t.

    Attributes
    ----------
    t, X : array (time,), (time, 4)
        Time and regressors.
    Q, R : array (time, 4), (4, 4)
        Factors of X.
    theta : array (4,)
        Linear parameters b, c, A, B.
    residual : array (time,)
    """

    t: np.ndarray
    X: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    theta: np.ndarray
    residual: np.ndarray

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Derivative of the residual by (sigma, wd), (time, 2) [GolubPereyra1973, eq. (4.8)].

        The linear parameters follow the change of (sigma, wd).
        """
        t, (cosine, sine), (A, B) = self.t, self.X.T[2:], self.theta[2:]
        # Derivative of the fitted curve X theta at constant theta, (2, time).
        curve_change = np.empty((2, t.size))
        np.multiply(t, -A * cosine - B * sine, out=curve_change[0])
        np.multiply(t, B * cosine - A * sine, out=curve_change[1])
        # Derivative of X' applied to the residual. The first two regressors are constant.
        scaled = t * self.residual
        c, s = float(cosine @ scaled), float(sine @ scaled)
        regressor_change = np.array([[0.0, 0.0], [0.0, 0.0], [-c, -s], [-s, c]])
        theta_change, _ = scipy.linalg.lapack.dtrtrs(self.R, regressor_change, trans=1)
        return self.Q @ (self.Q.T @ curve_change.T - theta_change) - curve_change.T


def _project_trace(t: np.ndarray, y: np.ndarray, sigma: float, *, wd: float) -> _Projection:
    """Return the least-squares fit of a trace at (sigma, wd).

    It calls LAPACK directly: the wrappers in numpy take as long as the decomposition.
    """
    X = np.empty((4, t.size))
    X[0], X[1] = 1.0, t
    exponent = -sigma * t
    if not abs(sigma * t[-1]) < _MOST_DECAY:
        exponent = -np.clip(sigma * t, -_MOST_DECAY, _MOST_DECAY)
    decay = np.exp(exponent)
    angle = wd * t
    np.multiply(decay, np.cos(angle), out=X[2])
    np.multiply(decay, np.sin(angle), out=X[3])
    # QR decomposition of X, then R theta = Q' y.
    factors, tau, _, _ = scipy.linalg.lapack.dgeqrf(X.T)
    Q, _, _ = scipy.linalg.lapack.dorgqr(factors, tau)
    R = factors[:4]
    components = Q.T @ y
    theta, singular = scipy.linalg.lapack.dtrtrs(R, components)
    if singular:
        raise np.linalg.LinAlgError("Singular matrix")
    return _Projection(t, X.T, Q=Q, R=R, theta=theta, residual=y - Q @ components)


def _minimise_residual(
    t: np.ndarray, y: np.ndarray, start: tuple[float, float], *, tolerance: float
) -> tuple[float, float]:
    """Return (sigma, wd) of least squares to a relative tolerance, from a start point."""
    scaled = y / (float(np.ptp(y)) or 1.0)

    # MINPACK requires residual and derivative of one point in two calls.
    @lru_cache(maxsize=2)
    def project(sigma: float, wd: float) -> _Projection:
        return _project_trace(t, scaled, sigma, wd=wd)

    # MINPACK itself: `scipy.optimize.least_squares` has a high overhead for two parameters. The
    # status of MINPACK is ignored, because `fit_mode` judges the result.
    (sigma, wd), *_ = scipy.optimize.leastsq(
        lambda x: project(*x.tolist()).residual,
        start,
        Dfun=lambda x: project(*x.tolist()).jacobian,
        diag=(1.0 / start[1], 1.0 / start[1]),
        xtol=tolerance,
        ftol=tolerance,
        gtol=tolerance,
        maxfev=200,
        full_output=True,
    )
    return float(sigma), abs(float(wd))


def _search_start(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return (sigma, wd) of the grid point that explains most of a trace.

    The grid runs from half a cycle in the record to eight samples a cycle.
    """
    sigma, wd, regressors = _make_grid(t.tobytes())
    components = (regressors @ y).reshape(4, -1)
    best = int(np.argmax(np.einsum("ik,ik->k", components, components)))
    return float(sigma[best]), float(wd[best])


@lru_cache(maxsize=8)
def _make_grid(times: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sigma, wd and orthonormal regressors of the search grid over samples `times`.

    The regressors are (4 of every point, time).
    """
    t = np.frombuffer(times)
    # From half a cycle in the window up to eight samples in a cycle.
    fastest = max(2.0 * math.pi / (8.0 * float(np.median(np.diff(t)))), 4.0 * math.pi / t[-1])
    frequencies, ratios = np.meshgrid(np.geomspace(math.pi / t[-1], fastest, _GRID), _RATIOS)
    wd, ratio = frequencies.ravel(), ratios.ravel()
    exponent = np.clip(np.outer(ratio * wd, t), -_MOST_DECAY, _MOST_DECAY)
    decay, angle = np.exp(-exponent), np.outer(wd, t)
    level = np.ones_like(angle)
    X = np.stack([level, level * t / t[-1], decay * np.cos(angle), decay * np.sin(angle)], axis=2)
    # Orthonormal regressors: the fit of a grid point is then a product.
    X /= np.linalg.norm(X, axis=1, keepdims=True)
    Q = np.linalg.qr(X)[0]  # (point, time, 4)
    return ratio * wd, wd, Q.transpose(2, 0, 1).reshape(4 * len(wd), len(t))
