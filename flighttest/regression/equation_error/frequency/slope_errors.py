"""Errors of slopes that are fitted in the frequency domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flighttest.records.signals.fourier import adjoint_fourier, remove_straight_line
from flighttest.regression.equation_error.frequency.spectral_weights import (
    Whitened,
    estimate_freedom,
    residual_spectrum_of,
    spectral_freedom,
    student_factor,
)
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    TransformedStretch,
    fill_rows,
)
from flighttest.remarks import Convergence


@dataclass(frozen=True)
class SlopeErrors:
    """Uncertainty of the slopes.

    Attributes
    ----------
    covariance : array (slopes, slopes)
        For the spectrum of the residual, with Student's factor.
    white : array (slopes,)
        Standard errors for a flat spectrum.
    freedom : array (slopes,)
        Degrees of freedom of the variances.
    factor : array (slopes,)
        Student's factor, which the standard errors contain.
    convergence : Convergence
        End of the search of the spectrum.
    """

    covariance: np.ndarray
    white: np.ndarray
    freedom: np.ndarray
    factor: np.ndarray
    convergence: Convergence


def estimate_slope_errors(
    v: np.ndarray,
    E: np.ndarray,
    D: np.ndarray,
    whitened: Whitened,
    parts: Sequence[TransformedStretch],
) -> SlopeErrors:
    """Return the errors of slopes theta = D [Re z; Im z].

    Parameters
    ----------
    v : complex array (rows,)
        Residual without weights.
    E : array (2 rows, slopes)
        Equivalent regressors of the weighted real equations.
    D : array (slopes, 2 rows)
        Linear map from the real equations without weights to the slopes.
    whitened : Whitened
        Weights of the equations.
    parts : sequence of TransformedStretch
    """
    slopes, leaks = len(D), whitened.ends.shape[1]
    s2 = float((np.abs(v) ** 2).sum()) / (2 * len(v) - slopes - leaks)
    # Frequencies closer than 1/T are not independent: the covariance is multiplied by 1/(T df).
    crowding = []
    for part in parts:
        crowding.append(max(1.0, 1.0 / (part.duration * _frequency_spacing(part))))
    dense = fill_rows(parts, crowding)
    free = spectral_freedom(round(len(v) / dense.mean()), slopes + leaks)
    root = whitened.root
    if leaks:
        # The residual is whitened: its spectrum is that of the weighted equations, over root^2.
        spectrum = residual_spectrum_of(v * root, np.hstack([E, whitened.ends]), parts)
        by_estimate = estimate_freedom(D / np.tile(root, 2), spectrum) / dense.mean()
        freedom = np.minimum(float(free), by_estimate)
        power = spectrum.power / root**2
    else:
        spectrum = residual_spectrum_of(v, E, parts)
        power = spectrum.power
        freedom = np.full(slopes, float(free))
    # Student's factor: few frequencies determine the spectrum of the disturbance.
    factor = student_factor(freedom)
    covariance = (D * np.tile(power * dense, 2)) @ D.T * np.outer(factor, factor)
    white = np.sqrt(s2 * ((D**2) * np.tile(dense, 2)).sum(axis=1))
    return SlopeErrors(covariance, white, freedom, factor, spectrum.convergence)


def _frequency_spacing(part: TransformedStretch) -> float:
    if len(part.frequencies) == 1:
        return 1.0 / part.duration
    return float(part.frequencies[1] - part.frequencies[0])


def map_samples_to_slopes(
    D: np.ndarray, parts: Sequence[TransformedStretch], samples: int
) -> np.ndarray:
    """Return the linear map (slopes, samples) from the measured coefficient to the slopes.

    Parameters
    ----------
    D : array (slopes, 2 rows)
        Linear map from the real equations to the slopes.
    parts : sequence of TransformedStretch
    samples : int
        Samples of the record.
    """
    half = D.shape[1] // 2
    weights = (D[:, :half] + 1j * D[:, half:]).T
    A = np.zeros((len(D), samples))
    for part in parts:
        count = part.samples.stop - part.samples.start
        # The adjoint of detrending and transforming. Detrending is its own adjoint.
        in_time = adjoint_fourier(
            weights[part.rows] / np.sqrt(part.duration),
            part.step,
            frequencies=part.frequencies,
            samples=count,
        )
        A[:, part.samples] = remove_straight_line(in_time).T
    return A
