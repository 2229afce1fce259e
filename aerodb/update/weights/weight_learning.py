"""Weights of the parts of a covariance and of fits, learnt from the estimates by their likelihood.

The estimates y are normal with the covariance

    S(u) = sum_k exp(u_k) S_k + S_fixed

and the logarithms u of the weights are normal a priori, N(mean, spread^2).  The mode of their
posterior is the minimum of

    J(u) = 1/2 log det S + 1/2 y' S^-1 y + 1/2 sum_k ((u_k - mean_k) / spread_k)^2

found by Newton's method with exact derivatives and Marquardt's damping.

One wrong fit must not decide on the tables of the others.  The errors of a fit i with p estimates
are normal with the covariance v_i N_i, and its factor v_i is unknown: inverse gamma a priori with
`_FREEDOM` degrees of freedom.  The errors are then those of a multivariate Student distribution
[Lange1989]_ of the whole fit, not of single estimates.  The factor that maximises the posterior
density, given the expected square of the residual, is

    v_i = (freedom + E r_i' N_i^-1 r_i) / (freedom + p)

    E r_i' N_i^-1 r_i = r_i' N_i^-1 r_i + trace(N_i^-1 cov r_i)

This is a step of the EM algorithm: it never lowers the density.  The trace is the part of the
residual that the fit hides because the tables follow it.  A factor below 1 is not admitted, so that
agreement does not make a fit more accurate than it states.  The weight of the fit is 1/v_i.

The steps alternate with learning the weights of the prior until neither changes.  Then each
derivative gets the probability that it has the shape of the handbook
(`aerodb.update.weights.weight_likelihood`), and the steps are repeated with it.  If more than a
quarter of the fits are then suspect, nothing decides which ones are wrong: all keep a weight of 1,
and the factor on C rises.

References
----------
.. [Rasmussen2006] Rasmussen, Williams, Gaussian Processes for Machine Learning, chapter 2.
.. [Searle1992] Searle, Casella, McCulloch, Variance Components, Wiley 1992, chapter 8.
.. [Lange1989] Lange, Little, Taylor, Robust statistical modeling using the t distribution, J. of
   the American Statistical Association 84, 1989.
.. [Paule1982] Paule, Mandel, Consensus values and weighting factors, J. Research of the National
   Bureau of Standards 87, 1982.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from aerodb.update.correlation import SHARES
from aerodb.update.observations import Observation
from aerodb.update.weights.weight_likelihood import (
    WeightLikelihood,
    a_priori_logarithms,
    invert_covariance,
    plain_probabilities,
    without_shapes,
)
from flightmech.errors import IdentificationError

# Least and largest variance of the deviation of the tables from a regression, over their a-priori
# variance.  The least is not zero: curves of few parameters do not describe an aeroplane exactly.
SCATTER = (0.003, 4.0)
_BISECTIONS = 40  # of the logarithm of the scatter
SUSPECT = 0.3
"""Weight below which a fit is listed as suspect."""
_MOST_SUSPECT = 0.25  # share of suspect fits above which all keep their weight
_FREEDOM = 4.0  # of the Student distribution: six standard errors in one of two, weight 0.15
_MOST_ROUNDS = 200  # of weighing the fits and learning the prior
_CONVERGED = 1e-6  # change of the logarithms of all weights and factors at which the rounds end
_CORRELATION_JITTER = 1e-9  # added to a unit diagonal, so that equal estimates can be inverted


def learn_weights(
    y: np.ndarray, parts: np.ndarray, fixed: np.ndarray, start: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of the parts of a covariance, and their logarithms at the mode.

    The weights of all tables and the factor on the errors of the fits are learnt together.
    Otherwise an overconfident prior would be mistaken for fits that disagree.

    Parameters
    ----------
    y : array (estimates,)
        Estimates less their a-priori expectation.
    parts : array (parts, estimates, estimates)
        The `PARTS` of each table in turn, and last the errors of the fits.
    fixed : array (estimates, estimates)
        The part of the covariance that has no weight.
    start : array (parts,), optional
        Logarithms from which the search starts.  The default is their a-priori mean.

    Returns
    -------
    weights : array (parts,)
        Lognormal means at the mode.  The part `reach` and the errors of the fits never have less
        than their a-priori weight.
    logarithms : array (parts,)
        The mode, from which the next search can start.
    """
    tables = (len(parts) - 1) // len(SHARES)
    mean, spread = a_priori_logarithms(tables)
    if start is None:
        start = mean
    # Parts that do not reach any estimate keep their prior.
    used = np.einsum("kii->k", parts) > 0
    u, covariance = mean.copy(), np.diag(spread**2)
    likelihood = WeightLikelihood(y, parts[used], fixed, mean=mean[used], spread=spread[used])
    u[used], covariance[np.ix_(used, used)] = likelihood.find_mode(start[used])
    least = np.zeros(len(SHARES))
    least[list(SHARES).index("reach")] = SHARES["reach"]
    weights = np.exp(u + np.diag(covariance) / 2.0)
    return np.maximum(weights, np.append(np.tile(least, tables), 1.0)), u


def estimate_scatter(y: np.ndarray, S: np.ndarray, deviation: np.ndarray) -> float:
    """Return the scatter with which chi-squared equals the number of estimates [Paule1982].

    Parameters
    ----------
    y : array (estimates,)
        Estimates less their a-priori expectation.
    S : array (estimates, estimates)
        Covariance of y without the deviation of the tables.
    deviation : array (estimates, estimates)
        A-priori covariance of the deviation; the scatter is the factor on it.
    """
    low, high = np.log(SCATTER)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        chi2 = y @ np.linalg.solve(S + np.exp(middle) * deviation, y)
        if chi2 > len(y):
            low = middle
        else:
            high = middle
    return float(np.exp(low))


def estimate_mixed(A: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return M = (A'S^-1 A + I)^-1 and the gain M A'S^-1 of mixed estimation."""
    scale = np.sqrt(np.diag(S))
    L = np.linalg.cholesky(S / np.outer(scale, scale))
    white = np.linalg.solve(L, A / scale[:, None])
    M = np.linalg.inv(white.T @ white + np.eye(A.shape[1]))
    return M, M @ (np.linalg.solve(L.T, white) / scale[:, None]).T


@dataclass(frozen=True)
class FitWeighing:
    """Weights of the fits and of the parts of the prior, and the covariances that they give."""

    weight: np.ndarray  # (fits,)
    distance: np.ndarray  # (fits,)
    factors: np.ndarray  # (terms x parts + 1,): the last one is the factor on C
    own_errors: np.ndarray  # (estimates, estimates): D D' of each fit by itself
    noise: np.ndarray  # (estimates, estimates): C with its factor, and the errors of each fit's own
    inverse: np.ndarray  # (estimates, estimates): inverse of H P H' + noise


def weigh_fits(
    y: np.ndarray,
    observed: Sequence[Observation],
    D: np.ndarray,
    expected: np.ndarray,
    start: np.ndarray | None = None,
    shares: np.ndarray | None = None,
) -> FitWeighing:
    """Return the weights of the fits and of the parts of the prior.

    Parameters
    ----------
    y : array (estimates,)
        Estimates less their a-priori expectation.
    observed : sequence of Observation
    D : array (estimates, common errors)
    expected : array (terms x parts, estimates, estimates)
        Parts of the a-priori covariance of the estimates.
    start : array (fits,), optional
        Weights of the first round, default 1.  The result does not depend on them.
    shares : array (terms,), optional
        A-priori probability that a table has the shape of the handbook, as of `plain_shares`;
        default zero.

    Raises
    ------
    IdentificationError
        The weights do not converge.
    """
    slices = slices_of_sizes([len(observation.theta) for observation in observed])
    measured = [observation.C for observation in observed]
    common = [observation.D @ observation.D.T for observation in observed]
    weight = np.ones(len(observed)) if start is None else start
    logarithms: np.ndarray | None = None
    is_robust = True
    plain: np.ndarray | None = None
    for _ in range(_MOST_ROUNDS):
        before = weight, logarithms
        parts = np.concatenate([expected, _weighted_blocks(measured, weight)[None]])
        factors, logarithms = learn_weights(y, parts, D @ D.T, logarithms)
        if plain is not None:
            factors = without_shapes(factors, plain)
        # For the weights, each fit has the common errors for itself.
        own_errors = _weighted_blocks(common, weight)
        noise = factors[-1] * parts[-1] + own_errors
        inverse = invert_covariance(np.einsum("k,kij->ij", factors[:-1], expected) + noise)
        # Estimates less the tables after the update, (noise S^-1) y, and their covariance.
        shrink = noise @ inverse
        residual, scatter = shrink @ y, noise - shrink @ noise
        weight = np.ones(len(observed))
        for number, rows in enumerate(slices if is_robust else ()):
            N = factors[-1] * measured[number] + common[number]
            square = np.outer(residual[rows], residual[rows]) + scatter[rows, rows]
            size = _FREEDOM + len(N)
            weight[number] = min(1.0, size / (_FREEDOM + _trace_in_stderr(square, N)))
        if not _has_converged(before, (weight, logarithms)):
            continue
        if np.mean(weight < SUSPECT) > _MOST_SUSPECT:
            # Without a clear majority no fit can be called wrong: all are less accurate.
            weight, logarithms, plain, is_robust = np.ones(len(observed)), None, None, False
        elif plain is None and shares is not None:
            plain = plain_probabilities(y, parts, D @ D.T, logarithms, shares)
        else:
            break
    else:
        raise IdentificationError(
            f"the weights of {len(observed)} fits of one coefficient do not converge in "
            f"{_MOST_ROUNDS} rounds; look for fits that contradict each other, and leave one out"
        )
    distances = []
    for rows, C, errors in zip(slices, measured, common):
        square = np.outer(residual[rows], residual[rows])
        distances.append(np.sqrt(_trace_in_stderr(square, C + errors) / len(C)))
    return FitWeighing(
        weight=weight,
        distance=np.array(distances),
        factors=factors,
        own_errors=own_errors,
        noise=noise,
        inverse=inverse,
    )


def _has_converged(
    before: tuple[np.ndarray, np.ndarray | None], after: tuple[np.ndarray, np.ndarray]
) -> bool:
    """Return whether neither weights of fits nor logarithms of factors change between rounds."""
    if before[1] is None:
        return False
    change = np.abs(np.log(after[0] / before[0])).max(), np.abs(after[1] - before[1]).max()
    return max(change) < _CONVERGED


def slices_of_sizes(sizes: Sequence[int]) -> list[slice]:
    """Return consecutive ranges of the given sizes."""
    return [slice(end - size, end) for end, size in zip(np.cumsum(sizes), sizes)]


def _trace_in_stderr(square: np.ndarray, C: np.ndarray) -> float:
    """Return trace(C^-1 square), the sum of squares in standard errors with their correlation."""
    sd = np.sqrt(np.diag(C))
    correlation = C / np.outer(sd, sd) + _CORRELATION_JITTER * np.eye(len(sd))
    return float(np.trace(np.linalg.solve(correlation, square / np.outer(sd, sd))))


def _weighted_blocks(blocks: Sequence[np.ndarray], weight: np.ndarray) -> np.ndarray:
    """Return the block-diagonal matrix of covariances of fits, each divided by its weight."""
    return scipy.linalg.block_diag(*[block / w for block, w in zip(blocks, weight)])
