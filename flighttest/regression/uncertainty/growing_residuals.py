"""Residuals that grow with the motion, as those of a missing term do.

The disturbance is a stationary one times an envelope s(t), a modulated process [Priestley1965]_.
The mean of the squared residual is linear in the squares of the regressors about their means, in
units of their variance, with coefficients that are not negative [Amemiya1977]_:

    s^2 = c_0 + sum_j c_j (x_j - mean x_j)^2 / var x_j

A squared residual of a coloured disturbance has few independent samples, and c_j of a stationary
one is not zero by chance. Only what exceeds `CHANCE` standard errors of c_j counts. The standard
errors are those for the autocorrelation of the squares, which is the square of the autocorrelation
of a normal process. A stationary residual thus keeps its standard errors, and the change is
continuous.

References
----------
.. [Priestley1965] Priestley, Evolutionary spectra and non-stationary processes, J. Royal
   Statistical Society B 27, 1965.
.. [Amemiya1977] Amemiya, A note on a heteroscedastic model, J. Econometrics 6, 1977.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

CHANCE = 1.5  # standard errors of a coefficient of growth up to which it is chance
_MOST_ABSORBED = 0.8  # largest share of the disturbance at a sample that the fit has taken up
_LEAST = 0.05  # least squared envelope, of its mean: a sample never counts as free of disturbance


def growth_envelope(X: np.ndarray, v: np.ndarray, pieces: Sequence[slice]) -> np.ndarray:
    """Return the standard deviation of the disturbance at each sample, over its rms, (samples,).

    Parameters
    ----------
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals.
    pieces : sequence of slice
        Contiguous stretches of samples, in order.

    Returns
    -------
    array (samples,)
        Ones for a residual that does not grow with the motion.
    """
    ones = np.ones(len(v))
    departures = X - X.mean(axis=0)
    variances = (departures**2).mean(axis=0)
    is_moving = variances > 1e-12 * (X**2).mean(axis=0)
    power = float(v @ v) / len(v)
    if not is_moving.any() or not power > 0.0:
        return ones
    squares = departures[:, is_moving] ** 2 / variances[is_moving]
    memory = memory_of_squares(v, pieces)
    # The fit takes up most of the disturbance where the motion is large.
    target = v**2 / (1.0 - np.minimum(_MOST_ABSORBED, memory * _leverage(X)))
    target /= target.mean()
    coefficients = scipy.optimize.nnls(np.column_stack([ones, squares]), target)[0]
    used = np.flatnonzero(coefficients[1:] > 0.0)
    if not len(used):
        return ones
    design = np.column_stack([ones, squares[:, used]])
    chance = CHANCE * _standard_errors(design, target, memory)[1:]
    found = coefficients[1 + used]
    growth = found * np.maximum(0.0, 1.0 - (chance / found) ** 2)
    if not growth.any():
        return ones
    # The mean of the squares is one, so that the mean of s^2 is one as well.
    level = max(_LEAST, 1.0 - float(growth.sum()))
    envelope2 = level + squares[:, used] @ growth
    return np.sqrt(envelope2 / envelope2.mean())


def _leverage(X: np.ndarray) -> np.ndarray:
    """Return the diagonal of X (X'X)^-1 X', (samples,)."""
    Q = np.linalg.qr(X)[0]
    return np.einsum("ij,ij->i", Q, Q)


def memory_of_squares(v: np.ndarray, pieces: Sequence[slice]) -> float:
    """Return the samples per independent square: 1 + 2 sum of rho^2 of the residual."""
    longest = max(piece.stop - piece.start for piece in pieces)
    size = 1 << (2 * longest).bit_length()
    products = np.zeros(longest)
    for piece in pieces:
        power = np.abs(np.fft.rfft(v[piece], size)) ** 2
        products += np.fft.irfft(power, size)[:longest]
    rho = products / products[0]
    # Beyond a quarter of the longest stretch an autocorrelation is noise.
    return 1.0 + 2.0 * float((rho[1 : max(2, longest // 4)] ** 2).sum())


def _standard_errors(design: np.ndarray, target: np.ndarray, memory: float) -> np.ndarray:
    """Return standard errors of the regression of squares whose scatter is that of a normal
    process.

    A square of unit mean has the variance two; `memory` samples count as one.
    """
    R = np.linalg.qr(design, mode="r")
    inverse = np.linalg.solve(R, np.eye(len(R)))
    return np.sqrt(2.0 * memory * (inverse**2).sum(axis=1))
