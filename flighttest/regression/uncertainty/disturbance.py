"""Stationary disturbance as an autoregression.

The recursion between autocovariance and reflection coefficients is that of [Levinson1947]_.

References
----------
.. [Levinson1947] Levinson, The Wiener RMS error criterion in filter design and prediction,
   J. Mathematics and Physics 25, 1947.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy


@dataclass(frozen=True)
class Disturbance:
    """A stationary disturbance as an autoregression.

    Attributes
    ----------
    reflections : array (order,)
        Reflection coefficients, all between -1 and 1.
    variance : float
        Variance of the innovation.
    """

    reflections: np.ndarray
    variance: float

    @classmethod
    def of_autocovariance(cls, r: np.ndarray) -> Disturbance:
        """Return the autoregression with a given autocovariance [Levinson1947]_.

        Parameters
        ----------
        r : array (order + 1,)
            Autocovariance at lags 0 ... order.
        """
        reflections: list[float] = []
        a, variance = np.ones(1), float(r[0])
        if not variance > 0.0:
            return cls(np.array(reflections), variance)
        # k_(m+1) = -sum_i a_i r_(m+1-i) / variance, and the variance shrinks by 1 - k^2.
        for m in range(len(r) - 1):
            k = -float(a @ r[m + 1 : 0 : -1]) / variance
            a = _raise_order(a, k)
            reflections.append(k)
            variance *= 1.0 - k * k
        return cls(np.array(reflections), variance)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """1, a_1 ... a_p of the innovation e_t = v_t + a_1 v_(t-1) + ... + a_p v_(t-p)."""
        a = np.ones(1)
        for k in self.reflections:
            a = _raise_order(a, k)
        return a

    @cached_property
    def _whitening(self) -> np.ndarray:
        """Filters (order, order) that whiten the first samples to the innovation's variance."""
        p = len(self.reflections)
        filters, a = np.zeros((p, p)), np.ones(1)
        for m, k in enumerate(self.reflections):
            # Sample m has m predecessors. Its prediction error has the variance of the innovation
            # over the product of the later factors 1 - k^2.
            filters[m, : m + 1] = a[::-1] * np.sqrt(np.prod(1.0 - self.reflections[m:] ** 2))
            a = _raise_order(a, k)
        return filters

    def autocovariance(self, lags: int) -> np.ndarray:
        """Return the autocovariance at lags 0 ... lags - 1."""
        p = len(self.reflections)
        r, a = np.zeros(p + 1), np.ones(1)
        # Levinson's recursion backwards: up to lag p from the reflection coefficients.
        variance = self.variance / np.prod(1.0 - self.reflections**2)
        r[0] = variance
        for m, k in enumerate(self.reflections):
            r[m + 1] = -k * variance - a[1:] @ r[m:0:-1]
            a, variance = _raise_order(a, k), variance * (1.0 - k * k)
        if lags <= p + 1:
            return r[:lags]
        # Beyond lag p the autocovariance satisfies the equation of the process without innovation.
        no_innovation = np.zeros(lags - p - 1)
        later, _ = scipy.signal.lfilter([1.0], a, no_innovation, zi=_filter_state(a, r))
        return np.concatenate([r, later])

    def innovations(self, v: np.ndarray) -> np.ndarray:
        """Return the prediction errors of a signal (time,).

        The first samples are scaled to the variance of the later ones.
        """
        p = len(self.reflections)
        first = self._whitening[: len(v), : len(v)] @ v[:p]
        return np.concatenate([first, scipy.signal.lfilter(self.coefficients, [1.0], v)[p:]])

    def sample(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (size,), stationary from its first sample on."""
        a, p = self.coefficients, len(self.reflections)
        e = np.sqrt(self.variance) * rng.normal(size=max(size, p))
        first = later = e[:0]
        if p:
            first = scipy.linalg.solve_triangular(self._whitening, e[:p], lower=True)
        if size > p:
            later = scipy.signal.lfilter([1.0], a, e[p:], zi=_filter_state(a, first))[0]
        return np.concatenate([first, later])[:size]


def _raise_order(a: np.ndarray, k: float) -> np.ndarray:
    """Return the coefficients of the next order, with its reflection coefficient k."""
    raised = np.zeros(len(a) + 1)
    raised[:-1] = a
    raised[1:] += k * a[::-1]
    return raised


def _filter_state(a: np.ndarray, past: np.ndarray) -> np.ndarray:
    """Return the state of the filter 1/a after given outputs."""
    p = len(a) - 1
    return -np.array([a[i + 1 :] @ past[::-1][: p - i] for i in range(p)])
