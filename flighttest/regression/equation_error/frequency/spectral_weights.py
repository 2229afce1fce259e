"""Spectrum of the residual of a frequency-domain fit, and the weights that follow from it.

The logarithm of the spectrum is a parabola in the logarithm of the frequency. Its coefficients
maximise Whittle's likelihood [Whittle1953]_.

References
----------
.. [Whittle1953] Whittle, Estimation and information in stationary time series, Arkiv foer
   Matematik 2, 1953.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    TransformedStretch,
    stack_complex,
)
from flighttest.remarks import Convergence

_SHAPE = 2  # degree of the logarithm of the residual's spectrum over the logarithm of the frequency
_PER_SHAPE = 6  # frequencies that each degree needs
# scoring steps of the logarithm of the spectrum, and the step that ends them
_ROUNDS, _STILL = 30, 1e-4
# alternations of fit and spectrum, and the change of the logarithm of the weights that ends them
_WEIGHINGS, _WEIGHED = 50, 1e-6
_SETTLED = 1e-4  # the same change up to which the weights have converged
_NOT_ITERATED = Convergence(True, 0, 0.0)
_LEAST_FREE = 0.05  # least share of a row that counts as free of the fit
_LEAST_POWER = 1e-300  # keeps the division by the variance of an estimate finite


@dataclass(frozen=True)
class Whitened:
    """Weights of the equations by the spectrum of their noise.

    Attributes
    ----------
    root : array (rows,)
        Root of the weight of every frequency; mean one.
    ends : array (2 rows, unknowns)
        Orthonormal basis of the weighted leakage from the ends of the stretches.
    convergence : Convergence
        End of the alternation of fit and spectrum. Its change is the largest of the logarithm of a
        weight over its tolerance.
    """

    root: np.ndarray
    ends: np.ndarray
    convergence: Convergence

    def equations(self, columns: np.ndarray) -> np.ndarray:
        """Return transformed columns as weighted real equations without the leakage of the ends.

        Parameters
        ----------
        columns : complex array (rows, columns)

        Returns
        -------
        array (2 rows, columns)
        """
        weighted = stack_complex(columns * self.root[:, None])
        if not self.ends.shape[1]:
            return weighted
        return weighted - self.ends @ (self.ends.T @ weighted)

    def residual(self, zf: np.ndarray, Xf: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Return the complex residual (rows,), without weights.

        Parameters
        ----------
        zf : complex array (rows,)
        Xf : complex array (rows, terms)
        theta : array (terms,)
        """
        v = zf - Xf @ theta
        if not self.ends.shape[1]:
            return v
        weighted = self.equations(v[:, None])[:, 0]
        return (weighted[: len(v)] + 1j * weighted[len(v) :]) / self.root


def equal_weights(rows: int) -> Whitened:
    """Return equal weights of all rows, without leakage of the ends."""
    return Whitened(np.ones(rows), np.zeros((2 * rows, 0)), _NOT_ITERATED)


def whitening_weights(
    Xf: np.ndarray, zf: np.ndarray, parts: Sequence[TransformedStretch]
) -> Whitened:
    """Return the weights with which the residual of a fit has a flat spectrum.

    Parameters
    ----------
    Xf : complex array (rows, terms)
        Transformed regressors.
    zf : complex array (rows,)
        Transformed coefficient.
    parts : sequence of TransformedStretch

    Raises
    ------
    IdentificationError
        The ends of the stretches take too many of the equations.

    Notes
    -----
    Least squares with the weights 1/S alternates with the spectrum S of its residual, see
    `residual_power`, until S does not change. The result is the maximum of Whittle's likelihood of
    terms and spectrum together.

    Noise of an acceleration that comes from a measured position is v = p'', with the noise p of the
    position. Its finite transform is

        v~ = -omega^2 p~ + j omega [p(T) - p(0)] + [p'(T) - p'(0)]

    The last two parts have the same two numbers at all frequencies. They are much larger than the
    first part where omega is small, and make the residuals of neighbouring frequencies nearly equal
    (correlation 0.9 on flights from markers). The removed trend adds a multiple of 1/(j omega).
    """
    leaks = _end_leakage(parts, len(zf))
    equations = 2 * len(zf) - leaks.shape[1]
    if equations < 2 * Xf.shape[1]:
        raise IdentificationError(
            f"weights='spectrum': of {2 * len(zf)} equations, two per frequency, the ends of "
            f"{len(parts)} stretches take {leaks.shape[1]}; the {equations} left for "
            f"{Xf.shape[1]} slopes are less than two each: widen the band, give longer "
            f"manoeuvres or take equal weights"
        )
    X, root = np.hstack([Xf, leaks]), np.ones(len(zf))
    convergence = _NOT_ITERATED
    for count in range(1, _WEIGHINGS + 1):
        E, z = stack_complex(X * root[:, None]), stack_complex(zf * root)
        v = zf - X @ np.linalg.lstsq(E, z, rcond=None)[0]
        power = residual_power(v, E, parts)[: len(v)]
        if not power.all():
            # An exact fit has no noise to weight by.
            convergence = Convergence(True, count, 0.0)
            break
        previous, root = root, 1.0 / np.sqrt(power)
        root /= root.mean()
        change = float(np.abs(np.log(root / previous)).max())
        convergence = Convergence(change <= _SETTLED, count, change / _SETTLED)
        if change < _WEIGHED:
            break
    ends = np.linalg.qr(stack_complex(leaks * root[:, None]))[0]
    return Whitened(root, ends, convergence)


def _end_leakage(parts: Sequence[TransformedStretch], rows: int) -> np.ndarray:
    """Return the normalised leakage of the ends of all stretches, complex (rows, unknowns)."""
    columns = []
    for part in parts:
        j_omega = 2j * np.pi * part.frequencies
        shapes = (np.ones(len(j_omega)), j_omega, 1.0 / j_omega)
        # A stretch with a single frequency has two equations, so at most two unknowns.
        for shape in shapes[: 2 * len(j_omega)]:
            column = np.zeros(rows, complex)
            # Each sample is the middle of its interval: the ends of the record are half a step out.
            column[part.rows] = np.exp(0.5 * j_omega * part.step) * shape
            columns.append(column)
    leaks = np.stack(columns, axis=1)
    leaks /= np.linalg.norm(leaks, axis=0)
    return leaks


def residual_power(v: np.ndarray, E: np.ndarray, parts: Sequence[TransformedStretch]) -> np.ndarray:
    """Return the variance of each real equation, (2 rows,), from the spectrum of the residual.

    Parameters
    ----------
    v : complex array (rows,)
        Residuals.
    E : array (2 rows, unknowns)
        Regressors as real rows, see `stack_complex`.
    parts : sequence of TransformedStretch

    Notes
    -----
    The logarithm of the spectrum is a parabola in the logarithm of the frequency. In Whittle's
    likelihood, power over spectrum has a chi-square distribution. The parabola is found by the
    scoring steps of a regression with a logarithmic link. The share of each row that the fit has
    absorbed is corrected for.
    """
    return np.tile(residual_spectrum_of(v, E, parts).power, 2)


class FrequencySpectrum(NamedTuple):
    """Spectrum of the residual at the rows of a transform.

    Attributes
    ----------
    power : array (rows,)
        Variance of one real equation.
    basis : array (rows, unknowns)
        Orthonormal functions of the frequency that form the logarithm of `power`.
    free : array (rows,)
        Share of each row that the fit has not absorbed.
    convergence : Convergence
        End of the scoring steps. Its change is the largest step of the logarithm of the spectrum
        over its tolerance.
    """

    power: np.ndarray
    basis: np.ndarray
    free: np.ndarray
    convergence: Convergence


def residual_spectrum_of(
    v: np.ndarray, E: np.ndarray, parts: Sequence[TransformedStretch]
) -> FrequencySpectrum:
    """Return the spectrum of a residual; arguments as in `residual_power`."""
    # A row of leverage h keeps the share 1 - h of its variance. A complex row is two real rows.
    leverage = (np.linalg.qr(E)[0] ** 2).sum(axis=1)
    free = np.maximum(_LEAST_FREE, 1.0 - 0.5 * (leverage[: len(v)] + leverage[len(v) :]))
    power = 0.5 * np.abs(v) ** 2 / free
    x = np.log(np.concatenate([part.frequencies for part in parts]))
    degree = _spectrum_degree(len(v))
    basis = np.linalg.qr(np.vander((x - x.mean()) / max(np.ptp(x), 1e-9), degree + 1))[0]
    if not power.any():
        return FrequencySpectrum(power, basis, free, _NOT_ITERATED)
    # Scoring steps of Whittle's likelihood, from the spectrum that is the same everywhere.
    level = np.full(len(v), np.log((power * free).sum() / free.sum()))
    weighted_basis = basis * free[:, None]
    convergence = _NOT_ITERATED
    for count in range(1, _ROUNDS + 1):
        change = power / np.exp(level) - 1.0
        step = basis @ np.linalg.solve(weighted_basis.T @ basis, weighted_basis.T @ change)
        level = level + np.clip(step, -1.0, 1.0)
        size = float(np.abs(step).max())
        convergence = Convergence(size < _STILL, count, size / _STILL)
        if convergence.converged:
            break
    return FrequencySpectrum(np.exp(level), basis, free, convergence)


def estimate_freedom(D: np.ndarray, spectrum: FrequencySpectrum) -> np.ndarray:
    """Return the degrees of freedom of the variances of weighted estimates, (estimates,).

    Parameters
    ----------
    D : array (estimates, 2 rows)
        Linear map from the real equations to the estimates.
    spectrum : FrequencySpectrum

    Notes
    -----
    The degrees of freedom are 2 over the relative variance. A weighted estimate comes from few
    frequencies at the quiet end of the band, and few frequencies determine the spectrum there.
    """
    half = len(spectrum.power)
    share = (D[:, :half] ** 2 + D[:, half:] ** 2) * spectrum.power
    # Derivative of the logarithm of each variance by the unknowns of the logarithm of the spectrum.
    slope = share @ spectrum.basis / np.maximum(share.sum(axis=1), _LEAST_POWER)[:, None]
    information = (spectrum.basis * spectrum.free[:, None]).T @ spectrum.basis
    return np.maximum(1.0, 2.0 / (slope * np.linalg.solve(information, slope.T).T).sum(axis=1))


def _spectrum_degree(frequencies: int) -> int:
    return min(_SHAPE, frequencies // _PER_SHAPE)


def spectral_freedom(frequencies: int, slopes: int) -> int:
    """Return the degrees of freedom of the residual's spectrum: two per frequency, less the fit.

    Parameters
    ----------
    frequencies : int
        Independent frequencies.
    slopes : int
        Fitted parameters.
    """
    return max(1, 2 * frequencies - slopes - _spectrum_degree(frequencies) - 1)


def student_factor(free: float | np.ndarray) -> np.ndarray:
    """Return the factor on standard errors with which two of them contain 95.45 %.

    Parameters
    ----------
    free : float or array
        Degrees of freedom of the disturbance.
    """
    return np.asarray(scipy.stats.t.ppf(scipy.stats.norm.cdf(2.0), free)) / 2.0
