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

The steps alternate with learning the weights of the prior until neither changes.  If more than a
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

from aerodb.update.correlation import SHARES, SPREADS
from aerodb.update.observations import Observation
from flightmech.errors import IdentificationError

# Least and largest variance of the deviation of the tables from a regression, over their a-priori
# variance.  The least is not zero: curves of few parameters do not describe an aeroplane exactly.
SCATTER = (0.003, 4.0)
_BISECTIONS = 40  # of the logarithm of the scatter
_STEPS = 100  # most steps of Newton's method
SPREAD_OF_FITS = 0.7  # a-priori standard error of the logarithm of the factor on C
_STEP_TOLERANCE = 1e-6  # step of a logarithm at which the iteration ends
_LONGEST_STEP = 2.0  # of a logarithm: a factor of 7 on a weight
_LEAST_DAMPING, _MOST_DAMPING = 1e-10, 1e10
_COST_ROUNDING = 1e-12  # change of the cost, relative to it, that is rounding
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
    spread = np.append(np.tile(list(SPREADS.values()), tables), SPREAD_OF_FITS)
    share = np.append(np.tile(list(SHARES.values()), tables), 1.0)
    # The a-priori share is the mean of exp(u): E exp(u) = exp(mean + spread^2 / 2).
    mean = np.log(share) - spread**2 / 2.0
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


@dataclass(frozen=True)
class WeightLikelihood:
    """Posterior density of the logarithms of the weights, given the estimates.

    Attributes
    ----------
    y : array (estimates,)
    parts : array (parts, estimates, estimates)
    fixed : array (estimates, estimates)
    mean, spread : array (parts,)
        A-priori mean and standard error of the logarithms.
    """

    y: np.ndarray
    parts: np.ndarray
    fixed: np.ndarray
    mean: np.ndarray
    spread: np.ndarray

    def cost(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """Return J(u), the negative logarithm of the density, and the covariance S(u) of y."""
        S = np.einsum("k,kij->ij", np.exp(u), self.parts) + self.fixed
        # log det S and y' S^-1 y from the Cholesky factor of the correlation matrix.
        scale = np.sqrt(np.diag(S))
        L = np.linalg.cholesky(S / np.outer(scale, scale))
        z = np.linalg.solve(L, self.y / scale)
        log_density = np.log(scale * np.diag(L)).sum() + z @ z / 2.0
        return float(log_density + (((u - self.mean) / self.spread) ** 2).sum() / 2.0), S

    def find_mode(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the mode of the logarithms and the inverse of the information matrix there.

        Parameters
        ----------
        u : array (parts,)
            Logarithms from which the search starts.
        """
        cost, S = self.cost(u)
        damping = 1e-3
        for _ in range(_STEPS):
            gradient, curvature, information = self._derivatives(u, S)
            while damping < _MOST_DAMPING:
                trial = np.inf
                damped = curvature + damping * np.diag(np.diag(information))
                try:
                    step = _newton_step(damped, gradient)
                    trial, S_trial = self.cost(u + step)
                except np.linalg.LinAlgError:
                    pass  # the quadratic has no minimum: increase the damping
                if trial <= cost + _COST_ROUNDING * abs(cost):
                    break
                damping *= 10.0
            else:
                break
            u, cost, S = u + step, trial, S_trial
            damping = max(damping / 10.0, _LEAST_DAMPING)
            if np.abs(step).max() < _STEP_TOLERANCE:
                break
        return u, np.linalg.inv(information)

    def _derivatives(
        self, u: np.ndarray, S: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gradient, Hessian and expected Hessian (information) of J."""
        inverse = invert_covariance(S)
        r = inverse @ self.y
        size = np.exp(u)
        # A_k = exp(u_k) S^-1 S_k and b_k = exp(u_k) S_k S^-1 y.
        share = size[:, None, None] * (inverse @ self.parts)
        pull = size[:, None] * (self.parts @ r)
        # dJ/du_k = 1/2 (tr A_k - b_k' S^-1 y) + (u_k - mean_k) / spread_k^2
        likelihood = (np.einsum("kii->k", share) - pull @ r) / 2.0
        gradient = likelihood + (u - self.mean) / self.spread**2
        # Information 1/2 tr(A_k A_l), as a product of the flattened matrices.
        flat = share.reshape(len(u), -1)
        expected = flat @ share.transpose(0, 2, 1).reshape(len(u), -1).T / 2.0
        information = expected + np.diag(self.spread**-2.0)
        # Hessian b_k' S^-1 b_l - 1/2 tr(A_k A_l), and on the diagonal the first derivative again.
        curvature = pull @ inverse @ pull.T - expected + np.diag(likelihood + self.spread**-2.0)
        return gradient, curvature, information


def _newton_step(curvature: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Return the step to the minimum of the quadratic, shortened to `_LONGEST_STEP`."""
    L = np.linalg.cholesky(curvature)
    step = -np.linalg.solve(L.T, np.linalg.solve(L, gradient))
    step *= min(1.0, _LONGEST_STEP / np.abs(step).max())
    return step


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


def invert_covariance(S: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance, scaled to a unit diagonal before it is inverted."""
    # Terms differ by orders of magnitude, so that S itself is badly conditioned.
    scale = np.sqrt(np.diag(S))
    return np.linalg.inv(S / np.outer(scale, scale)) / np.outer(scale, scale)


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
    for _ in range(_MOST_ROUNDS):
        before = weight, logarithms
        parts = np.concatenate([expected, _weighted_blocks(measured, weight)[None]])
        factors, logarithms = learn_weights(y, parts, D @ D.T, logarithms)
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
        if np.mean(weight < SUSPECT) <= _MOST_SUSPECT:
            break
        # Without a clear majority no fit can be called wrong: all are less accurate.
        weight, logarithms, is_robust = np.ones(len(observed)), None, False
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
