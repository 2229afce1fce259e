"""Standard errors of a batch fit: Cramer-Rao, and corrected for residuals that are correlated in time and for a noisy inertial unit.

The fit takes the readings for the only random thing.  Two facts make its Cramer-Rao bounds too small:

- residuals are correlated in time: their own autocorrelation replaces the white one;
- the gyros and accelerometers that drive the path are noisy too, and their noise is summed up to a wandering path.
  What it does to the estimate follows from the noise of the specification, by the adjoint of the sensitivity equations:
  one backward running sum per unknown.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from flightmech.simulation.normal_sums import driven_series

from .normal_equations import Equations
from .path_sensitivities import driven_paths, segments

WINDOW = 0.1  # lag window over the length of a segment


def covariances(equations: Equations) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected and the white (Cramer-Rao) covariance of all unknowns; zero for those not estimated.

    Notes
    -----
    ::

        D = (S' R^-1 S + P0^-1)^-1
        corrected = D [P0^-1 + sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j + sum_i T_i' Q T_i] D

    Rvv: biased autocorrelation of the residuals of each channel with Bartlett's taper over a tenth of the segment; T_i:
    gradient by the noise of the inertial unit at sample i, Q its variance.  Where the autocorrelation makes a variance
    smaller than white residuals would (it is itself estimated), the white one stays.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [MaineIliff] Maine, Iliff, NASA RP-1138, 1985.
    """
    layout = equations.layout
    move = np.ix_(layout.moving, layout.moving)
    D = np.zeros_like(equations.normal)
    scale = 1.0 / np.sqrt(np.diag(equations.normal[move]))
    D[move] = np.linalg.inv(equations.normal[move] * np.outer(scale, scale)) * np.outer(scale, scale)
    coloured, rest = residual_noise(equations)
    floor = np.diag(D) + np.diag(D @ rest @ D)
    nc = len(layout.names)
    rest[:nc, :nc] += layout.prior_information()
    for run, setup in enumerate(layout.setups):
        places = layout.start_places(run)
        rest[places, places] += 1.0 / setup.problem.start_sigma**2
    corrected = D @ (coloured + rest) @ D
    short = np.sqrt(np.maximum(floor / np.maximum(np.diag(corrected), 1e-300), 1.0))
    corrected *= np.outer(short, short)
    return (corrected + corrected.T) / 2.0, D


def residual_noise(equations: Equations) -> tuple[np.ndarray, np.ndarray]:
    """Return what the gradient takes from residuals correlated in time, and from the noise of gyros and accelerometers.

    Returns
    -------
    coloured : array (size, size)
        sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j.
    inertial : array (size, size)
        sum_i T_i' Q T_i.
    """
    layout = equations.layout
    coloured, inertial = np.zeros_like(equations.normal), np.zeros_like(equations.normal)
    for run, setup in enumerate(layout.setups):
        problem, at = setup.problem, layout.places[run]
        swept, places = equations.swept(run)
        pressed = np.zeros((*swept.x.shape, len(places[0])))
        for part in equations.parts(run, swept):
            sigma = np.array([equations.sigma[name] for name in part.names])
            series = driven_series(swept.X[part.samples], len(places[0]), part.readings, 1.0 / sigma, pressed[part.samples])
            for S, r, own in zip(series, part.readings.r.T, sigma, strict=True):
                used = np.flatnonzero(S.any(axis=1))
                chosen = places[part.segment][used]
                coloured[np.ix_(chosen, chosen)] += spread(S[used] / own, r / own)
        paths = driven_paths(problem, equations.at.c[at], swept.x, swept.columns)
        for path, samples, own in zip(paths, segments(problem), places, strict=True):
            products = np.zeros((len(own), len(own)))
            path.add_noise(swept.x[samples], problem.noise, pressed[samples], products)
            inertial[np.ix_(own, own)] += products
    return coloured, inertial


def spread(S: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return sum_ij S_i Rvv(i - j) S_j' of series S (u, N), Rvv the autocorrelation of r (N,), see `tapered`.

    Notes
    -----
    Parseval: the sum over the frequencies of the spectra of S, each with the spectrum of Rvv, both long enough not to wrap around.
    """
    right = tapered(r)
    size = next_fast_len(S.shape[1] + len(right) - 1, real=True)
    both = np.zeros(size)
    both[: len(right)] = right
    both[size - len(right) + 1 :] = right[:0:-1]
    weight = rfft(both).real / size
    weight[1 : (size + 1) // 2] *= 2.0  # stand for the negative frequencies too
    F = rfft(S, size, axis=1)
    parts = np.concatenate([F.real, F.imag], axis=1)
    return (parts * np.concatenate([weight, weight])) @ parts.T


def tapered(r: np.ndarray) -> np.ndarray:
    """Return the biased autocorrelation at lags 0, 1, ..., Bartlett's taper over a tenth of the record."""
    N = len(r)
    window = max(1, round(WINDOW * N))
    size = next_fast_len(N + window - 1, real=True)
    return irfft(np.abs(rfft(r, size)) ** 2, size)[:window] / N * (1.0 - np.arange(window) / window)
