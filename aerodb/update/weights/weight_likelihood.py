"""Marginal likelihood of the weights of the parts of a covariance, and of tables without a shape.

The estimates y are normal with the covariance S(u) of `aerodb.update.weights.weight_learning`.  The
mode of the logarithms u is the minimum of J(u) given there.

Lognormal weights exclude a table whose error has no shape.  Derivatives often have none: the
handbook has the right course over incidence, or the derivative is constant.  A priori a derivative
is therefore *plain* with the probability `PLAIN`: the weights of its parts `long`, `medium` and
`short` are zero.  A table without regressor (`CL/basic`) is not.  It holds the stall: a kink at the
edge of the flown region, which its middle does not show, would be excluded.  On a set of local
models of an aeroplane with another stall, 75 % of the flown nodes were within two standard errors
with this state, and 97 % without it.

The evidence of both states is that of Laplace's method [Rasmussen2006]_,

    ln Z = -J(u) - 1/2 ln det I - sum_k ln spread_k

at the mode u with its information matrix I, and the probability p that a table is plain follows
from both by Bayes' theorem.  The posterior mean of these weights is 1 - p of the mean of the
lognormal distribution.  The states of the other tables do not change meanwhile.

References
----------
.. [Rasmussen2006] Rasmussen, Williams, Gaussian Processes for Machine Learning, chapters 3 and 5.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from aerodb.update.correlation import PARTS, SHARES, SPREADS
from flightmech import terms

SPREAD_OF_FITS = 0.7  # a-priori standard error of the logarithm of the factor on C
SHAPE = ("long", "medium", "short")
"""Parts by which the shape of a table departs from the handbook."""
PLAIN = 0.5
"""A-priori share of the derivatives without these parts."""
_STEPS = 100  # most steps of Newton's method
_STEP_TOLERANCE = 1e-6  # step of a logarithm at which the iteration ends
_LONGEST_STEP = 2.0  # of a logarithm: a factor of 7 on a weight
_LEAST_DAMPING, _MOST_DAMPING = 1e-10, 1e10
_COST_ROUNDING = 1e-12  # change of the cost, relative to it, that is rounding
_STEPS_WITHOUT = 2  # steps of the other logarithms after a table has lost its shape
_MOST_EVIDENCE = 50.0  # logarithm of a ratio of evidences that is certain
_SAME_PART = 1e-9  # relative difference of parts that the estimates cannot distinguish
_SINGULAR = 1e-14  # eigenvalue of a correlation matrix that rounding can make negative


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

    def log_evidence(self, u: np.ndarray, steps: int) -> float:
        """Return the logarithm of the marginal likelihood by Laplace's method, but for a constant.

        Parameters
        ----------
        u : array (parts,)
            Logarithms near the mode.
        steps : int
            Steps of Newton's method towards the mode.
        """
        cost, S = self.cost(u)
        for _ in range(steps):
            gradient, _, information = self._derivatives(u, S)
            # The expected Hessian has a minimum everywhere.
            step = _newton_step(information, gradient)
            trial, S_trial = self.cost(u + step)
            if trial >= cost:
                break
            u, cost, S = u + step, trial, S_trial
        information = self._derivatives(u, S)[2]
        log_det = np.linalg.slogdet(information)[1]
        return float(-cost - log_det / 2.0 - np.log(self.spread).sum())

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


def a_priori_logarithms(tables: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a-priori means and standard errors of the logarithms of the weights, (parts,).

    They are those of the `PARTS` of each table in turn, and last of the factor on the fits.
    """
    spread = np.append(np.tile(list(SPREADS.values()), tables), SPREAD_OF_FITS)
    share = np.append(np.tile(list(SHARES.values()), tables), 1.0)
    # The a-priori share is the mean of exp(u): E exp(u) = exp(mean + spread^2 / 2).
    return np.log(share) - spread**2 / 2.0, spread


def plain_shares(leaves: Iterable[xr.Dataset]) -> np.ndarray:
    """Return the a-priori probability that each table is plain, (tables,).

    It is `PLAIN` for a derivative, and zero for a table without regressor.
    """
    return np.array([PLAIN if terms.list_regressors(leaf) else 0.0 for leaf in leaves])


def _is_singular(covariance: np.ndarray) -> bool:
    """Return whether rounding decides about the Cholesky factor of a covariance."""
    scale = np.sqrt(np.diag(covariance))
    return bool(np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] < _SINGULAR)


def plain_probabilities(
    y: np.ndarray, parts: np.ndarray, fixed: np.ndarray, u: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Return the probability that each table is plain, (tables,).

    Parameters
    ----------
    y, parts, fixed
        As of `aerodb.update.weights.weight_learning.learn_weights`.
    u : array (parts,)
        Logarithms of the weights at their mode.
    share : array (tables,)
        A-priori probability of each table, below one: see `plain_shares`.

    Returns
    -------
    array (tables,)
        Zero for a table whose parts the estimates cannot distinguish, such as one number, or whose
        covariance without these parts is singular.
    """
    tables = (len(parts) - 1) // len(PARTS)
    mean, spread = a_priori_logarithms(tables)
    used = np.einsum("kii->k", parts) > 0

    def evidence(kept: np.ndarray, steps: int) -> float:
        likelihood = WeightLikelihood(y, parts[kept], fixed, mean=mean[kept], spread=spread[kept])
        return likelihood.log_evidence(u[kept], steps)

    with_all = evidence(used, 0) if share.any() else 0.0
    probability = np.zeros(tables)
    for table in np.flatnonzero(share):
        first = table * len(PARTS)
        of_shape = [first + PARTS.index(name) for name in SHAPE]
        level = parts[first + PARTS.index("level")]
        departure = np.abs(parts[of_shape] - level).max()
        if departure <= _SAME_PART * np.abs(level).max():
            continue
        kept = used.copy()
        kept[of_shape] = False
        # The covariance without a shape is singular for fits almost without noise.
        if _is_singular(np.einsum("k,kij->ij", np.exp(u[kept]), parts[kept]) + fixed):
            continue
        gain = evidence(kept, _STEPS_WITHOUT) - with_all
        odds = (
            share[table]
            / (1.0 - share[table])
            * np.exp(np.clip(gain, -_MOST_EVIDENCE, _MOST_EVIDENCE))
        )
        probability[table] = odds / (1.0 + odds)
    return probability


def without_shapes(factors: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """Return weights (parts,) whose parts `SHAPE` have 1 - p of theirs in tables of probability p.

    `plain` are the probabilities p, (tables,).
    """
    is_shape = np.append(np.tile(np.isin(PARTS, SHAPE), len(plain)), False)
    share = np.append(np.repeat(1.0 - plain, len(PARTS)), 1.0)
    return np.where(is_shape, share, 1.0) * factors


def invert_covariance(S: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance, scaled to a unit diagonal before it is inverted."""
    # Terms differ by orders of magnitude, so that S itself is badly conditioned.
    scale = np.sqrt(np.diag(S))
    return np.linalg.inv(S / np.outer(scale, scale)) / np.outer(scale, scale)


def updated_variance(
    prior: np.ndarray, crossed: np.ndarray, gain: np.ndarray, S: np.ndarray
) -> np.ndarray:
    """Return the variance (node,) that estimates leave: diag(P - 2 K H P + K S K').

    It is P - K H P in Joseph's form [Bucy1968]_: an error of the gain enters as its square. A
    variance of 1e-6 of the prior then hardly depends on the rounding of an inverse.

    Parameters
    ----------
    prior : array (node,)
        Variance before the estimates.
    crossed, gain : array (node, estimate)
        Covariance P H' of nodes and estimates, and gain K.
    S : array (estimate, estimate)
        Covariance of the estimates with which the gain acts.

    References
    ----------
    .. [Bucy1968] R. S. Bucy, P. D. Joseph, Filtering for stochastic processes with applications to
       guidance, Wiley 1968.
    """
    reduction = np.einsum("ij,ij->i", gain, crossed)
    return prior - 2.0 * reduction + np.einsum("ij,ij->i", gain @ S, gain)
