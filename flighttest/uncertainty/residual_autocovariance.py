"""A stationary disturbance as an autoregression, given by its reflection coefficients.

References
----------
.. [Levinson1947] Levinson, The Wiener RMS error criterion in filter design and prediction, J. Math. and Physics 25, 1947.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg import solve_triangular


@dataclass(frozen=True)
class Disturbance:
    """A stationary disturbance as an autoregression.

    Attributes
    ----------
    reflections : array (order,)
        Reflection coefficients, all between -1 and 1.
    variance : float
        Of the innovation.
    """

    reflections: np.ndarray
    variance: float

    @classmethod
    def of_autocovariance(cls, r: np.ndarray) -> Disturbance:
        """Return the autoregression with the autocovariance `r` (order + 1,) at lags 0 ... order [Levinson1947]_."""
        a, reflections, variance = np.ones(1), [], float(r[0])
        for m in range(len(r) - 1 if variance > 0.0 else 0):
            k = -float(a @ r[m + 1 : 0 : -1]) / variance
            a = _longer(a, k)
            reflections.append(k)
            variance *= 1.0 - k * k
        return cls(np.array(reflections), variance)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """1, a_1 ... a_p of the innovation e_t = v_t + a_1 v_(t-1) + ... + a_p v_(t-p)."""
        a = np.ones(1)
        for k in self.reflections:
            a = _longer(a, k)
        return a

    @cached_property
    def _whitening(self) -> np.ndarray:
        """Filters (order, order) that whiten the first samples, scaled to the variance of the innovation."""
        p = len(self.reflections)
        filters, a = np.zeros((p, p)), np.ones(1)
        for m, k in enumerate(self.reflections):
            filters[m, : m + 1] = a[::-1] * np.sqrt(np.prod(1.0 - self.reflections[m:] ** 2))
            a = _longer(a, k)
        return filters

    def autocovariance(self, lags: int) -> np.ndarray:
        """Return the autocovariance at lags 0 ... lags - 1."""
        p = len(self.reflections)
        r, a = np.zeros(p + 1), np.ones(1)
        r[0] = left = self.variance / np.prod(1.0 - self.reflections**2)
        for m, k in enumerate(self.reflections):
            r[m + 1] = -k * left - a[1:] @ r[m:0:-1]
            a, left = _longer(a, k), left * (1.0 - k * k)
        if lags <= p + 1:
            return r[:lags]
        later, _ = scipy.signal.lfilter([1.0], a, np.zeros(lags - p - 1), zi=_history(a, r))
        return np.concatenate([r, later])

    def innovations(self, v: np.ndarray) -> np.ndarray:
        """Return what the past of a signal (time,) does not predict; the first samples in units of the later ones."""
        p = len(self.reflections)
        first = self._whitening[: len(v), : len(v)] @ v[:p]
        return np.concatenate([first, scipy.signal.lfilter(self.coefficients, [1.0], v)[p:]])

    def sample(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (size,), stationary from its first sample on."""
        a, p = self.coefficients, len(self.reflections)
        e = np.sqrt(self.variance) * rng.normal(size=max(size, p))
        first = solve_triangular(self._whitening, e[:p], lower=True) if p else e[:0]
        later = scipy.signal.lfilter([1.0], a, e[p:], zi=_history(a, first))[0] if size > p else e[:0]
        return np.concatenate([first, later])[:size]


def _longer(a: np.ndarray, k: float) -> np.ndarray:
    """Coefficients of the next order, with its reflection coefficient."""
    longer = np.zeros(len(a) + 1)
    longer[:-1] = a
    longer[1:] += k * a[::-1]
    return longer


def _history(a: np.ndarray, past: np.ndarray) -> np.ndarray:
    """State of the filter 1/a after given outputs."""
    p = len(a) - 1
    return -np.array([a[i + 1 :] @ past[::-1][: p - i] for i in range(p)])
