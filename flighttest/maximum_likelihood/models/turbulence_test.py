"""Whether the residuals of an output-error fit are noise of instruments or a disturbance of the motion that the estimates feel.

Noise of instruments belongs to one output, whatever its colour.  What moves the aeroplane shows in several outputs, which
follow from each other by the dynamics.  So the innovations of two residuals, each predicted from its own past alone, are independent in the
first case and correlated at some lag in the second [Haugh1976]_.

References
----------
.. [Haugh1976] Haugh, Checking the independence of two covariance-stationary time series: a univariate residual cross-correlation
   approach, J. American Statistical Association 71, 1976, pp. 378-385.
"""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr
from scipy.stats import chi2

from flightmech.errors import AeromatchWarning

CHANCE = 1e-3  # probability that independent noise couples any two outputs
SPAN = 0.3  # one output follows another within so long; more lags only add chance [s]
FEWEST = 16  # blocks, below which the coupling is not determined
FELT = 0.02  # effect on the motion from which a disturbance matters
LOUD = 2.0  # disturbance over the noise from sample to sample, from which an output is named with those that are coupled


def coupling(innovations: np.ndarray, block: float) -> np.ndarray:
    """Return how far the innovations of two outputs are correlated (output, output); above one is no chance.

    Parameters
    ----------
    innovations : array (block, output)
        Of each residual, from its own past.
    block : float
        Time between two of them. [s]

    Notes
    -----
    Haugh's  n^2 sum_k r_k^2 / (n - |k|)  over lags up to 0.3 s, over the value that independent noise exceeds with probability
    `CHANCE` in any pair.  The diagonal is zero, as is an output without a residual.
    """
    count, outputs = innovations.shape
    found = np.zeros((outputs, outputs))
    if count < FEWEST or outputs < 2:
        return found
    size = np.sqrt((innovations**2).mean(axis=0))
    e = innovations / np.where(size > 0.0, size, 1.0)
    lags = max(1, min(round(SPAN / block), count // 4))
    for lag in range(lags + 1):
        r = e[lag:].T @ e[: count - lag] / count  # of output a after output b
        share = count**2 * r**2 / (count - lag)
        found += share + share.T if lag else share
    limit = chi2.isf(CHANCE / (outputs * (outputs - 1) // 2), 2 * lags + 1)
    np.fill_diagonal(found, 0.0)
    return found / limit


def turbulence(noise: xr.Dataset) -> tuple[str, ...]:
    """Return a warning when open-loop fitting will fail, as texts; empty when the residuals are noise of instruments or do not matter.

    Parameters
    ----------
    noise : Dataset (output,)
        ``slow``, ``fast``, ``time``, ``coupling`` and ``effect`` as in `OutputError`.

    Notes
    -----
    Two conditions: the residuals of two outputs are coupled, and the standard error of an estimate, the colour of the residuals in it,
    moves the outputs by more than 2 % of the motion.  Coloured noise of instruments does not meet the first, a small disturbance
    in a record that determines its estimates not the second; the standard errors hold both.  A term that the model lacks looks
    like turbulence: the residuals over the inputs show which.
    """
    effect = float(noise.attrs["effect"])
    coupled = (noise["coupling"].values > 1.0).any(axis=1)
    if not (effect > FELT and coupled.any()):
        return ()
    named = coupled | (noise["slow"].values > LOUD * noise["fast"].values)
    columns = [noise[key].values[named] for key in ("output", "slow", "fast", "time")]
    parts = [f"{name} ({slow / max(fast, 1e-300):.1f} times its noise, {time:.2g} s)" for name, slow, fast, time in zip(*columns)]
    return (
        f"turbulence or a missing term: residuals of {', '.join(parts)} are a disturbance of the motion, which moves the outputs through "
        f"each estimate by {100.0 * effect:.2g} % of the motion; fitted open loop the estimates are biased and scatter more than they "
        "determine. Use flighttest.maximum_likelihood.filter_error, equation error, or a record in calm air",
    )


def warned(noise: xr.Dataset) -> tuple[str, ...]:
    """Return what `turbulence` finds, after a warning to the caller of the fit."""
    found = turbulence(noise)
    for text in found:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return found
