"""Range of the standard errors that fits will give, by draws of what `aerodb.tabulate` learns.

The standard errors of `tabulate` depend on the estimates through the weights of the parts of the
prior covariance, the factor on the errors of the fits and the weights of the fits.  Before the
flights nobody has the estimates, but their distribution is that of the method: each draw takes the
logarithms of all weights from their a-priori distribution, the estimates from the covariance of
these weights, and learns from them as `tabulate` does.  The range is that of the quantiles of 10
and 90 % over the draws, widened on both sides by a tenth (`range_of_draws`).

Half of the derivatives of a draw have the shape of the handbook, as `tabulate` assumes: lognormal
weights exclude it, and it is frequent.  A table without regressor (`CD/basic`) never has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.correlation import PARTS, SHARES, prior_parts
from aerodb.update.expectation import Expectation, align_errors
from aerodb.update.observations import coefficient_of, observed_nodes, sampled_weights
from aerodb.update.weights.weight_learning import weigh_fits
from aerodb.update.weights.weight_likelihood import SHAPE, a_priori_logarithms, plain_shares
from flightmech.errors import IdentificationError
from flighttest.flight_programme.planning.selection import Goal


def draw_stderr(
    expectation: Expectation, fits: Sequence[Any], count: int, seed: int = 0
) -> dict[str, np.ndarray]:
    """Return draws of the standard errors after some fits, (draw, *axes) by term.

    Parameters
    ----------
    expectation : Expectation
        Of the prior, before any flight.
    fits : sequence of Fit
        Predicted fits.  Their estimates are not used.
    count : int
        Number of draws.
    seed : int
        The draws of a coefficient depend on the seed and on its name.

    Returns
    -------
    dict of str to array
        Of the terms that the fits inform.  NaN in a draw whose weights do not converge.
    """
    drawn: dict[str, np.ndarray] = {}
    for coefficient in dict.fromkeys(map(coefficient_of, fits)):
        local = [fit for fit in fits if coefficient_of(fit) == coefficient]
        rng = np.random.default_rng([seed, *coefficient.encode()])
        drawn |= _CoefficientDraws(expectation, coefficient, local).draw(count, rng)
    return drawn


class _CoefficientDraws:
    """Draws of one coefficient: parts of the prior, computed once."""

    def __init__(self, expectation: Expectation, coefficient: str, fits: Sequence[Any]):
        self.observed = [expectation.observation(fit) for fit in fits]
        self.D, _ = align_errors(self.observed)
        self.C = scipy.linalg.block_diag(*[one.C for one in self.observed])
        H = np.vstack([one.H for one in self.observed])
        touched, sampled = observed_nodes(self.observed), sampled_weights(self.observed)
        self.shapes: dict[str, tuple[int, ...]] = {}
        leaves = []
        variances, crossed, estimates = [], [], []
        for name, nodes in expectation.node_slices(coefficient).items():
            if not touched[nodes].any():
                continue
            leaf = expectation.leaf(name)
            leaves.append(leaf)
            self.shapes[name] = leaf["value"].shape
            P = prior_parts(leaf, (sampled * touched)[nodes], expectation.lengths)
            PH = P @ H[:, nodes].T
            variances.append(np.diagonal(P, axis1=1, axis2=2))
            crossed.append(PH)
            estimates.append(H[:, nodes] @ PH)
        self.variances, self.crossed = variances, crossed
        self.estimates = np.concatenate(estimates)
        self.plain_shares = plain_shares(leaves)

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Return draws of the standard errors by term."""
        drawn = {name: np.full((count, *shape), np.nan) for name, shape in self.shapes.items()}
        for k in range(count):
            y = self._draw_estimates(rng)
            try:
                weighing = weigh_fits(
                    y, self.observed, self.D, self.estimates, shares=self.plain_shares
                )
            except (IdentificationError, np.linalg.LinAlgError):
                continue
            weights = weighing.factors[:-1].reshape(len(self.shapes), -1)
            pairs = zip(self.shapes.items(), weights, self.variances, self.crossed, strict=True)
            for (name, shape), w, variances, crossed in pairs:
                # as in `aerodb.update.tabulation`
                PH = np.einsum("k,kij->ij", w, crossed)
                gain = PH @ weighing.inverse
                variance = (
                    w @ variances
                    - np.einsum("ij,ij->i", gain, PH)
                    + ((gain @ self.D) ** 2).sum(axis=1)
                    - np.einsum("ij,ij->i", gain @ weighing.own_errors, gain)
                )
                drawn[name][k] = np.sqrt(np.maximum(variance, 0.0)).reshape(shape)
        return drawn

    def _draw_estimates(self, rng: np.random.Generator) -> np.ndarray:
        """Return estimates less their expectation, with drawn weights and errors."""
        tables = len(self.shapes)
        mean, spread = a_priori_logarithms(tables)
        weights = np.exp(mean + spread * rng.standard_normal(len(mean)))
        plain = np.repeat(rng.random(tables) < self.plain_shares, len(PARTS))
        weights[:-1][plain & np.tile(np.isin(PARTS, SHAPE), tables)] = 0.0
        reach = np.arange(len(weights) - 1) % len(PARTS) == PARTS.index("reach")
        weights[:-1][reach] = np.maximum(weights[:-1][reach], SHARES["reach"])
        S = np.einsum("k,kij->ij", weights[:-1], self.estimates)
        S = S + self.D @ self.D.T + max(weights[-1], 1.0) * self.C
        scale = np.sqrt(np.diag(S))
        root = np.linalg.cholesky(S / np.outer(scale, scale))
        return scale * (root @ rng.standard_normal(len(S)))


# Range of the standard errors over the draws.
RANGE_COLUMNS = ["low", "median", "high"]
_QUANTILES = (0.1, 0.5, 0.9)
# Factor by which the range is wider than the quantiles.  All nodes of a table have the same draws,
# and where the flights hardly inform a table its quantiles are close together: without the factor
# most of its nodes lie outside at once.
_MARGIN = 1.1
# Fewest draws of a range: of 20 draws two lie beyond each quantile.
_FEWEST_DRAWS = 20


def range_of_draws(drawn: np.ndarray) -> np.ndarray:
    """Return low end, median and high end of the range of standard errors, (3, *axes).

    Parameters
    ----------
    drawn : array (draw, *axes)
        From `draw_stderr`; a draw that failed is NaN.
    """
    low, median, high = np.nanquantile(drawn, _QUANTILES, axis=0)
    return np.stack([low / _MARGIN, median, high * _MARGIN])


def draw_ranges(
    goal: Goal, fits: Sequence[Any], draws: int
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the ranges of the standard errors over draws, and notes on draws that failed."""
    if not draws or not fits:
        return {}, []
    leaves, ranges, has_range = terms(goal.expectation.prior), {}, False
    by_text: dict[str, list[str]] = {}
    drawn = draw_stderr(goal.expectation, fits, draws, seed=goal.prediction.catalogue.seed)
    for name, values in drawn.items():
        # A draw whose weights do not converge is NaN at all nodes.
        usable = int(np.isfinite(values.reshape(draws, -1)).any(axis=1).sum())
        if text := _describe_draws(usable, draws):
            by_text.setdefault(text, []).append(name)
        dims = leaves[name]["value"].dims
        quantiles = np.full((len(_QUANTILES), *values.shape[1:]), np.nan)
        if usable >= _FEWEST_DRAWS:
            has_range = True
            quantiles = range_of_draws(values)
        ranges[name] = xr.Dataset(
            {key: (dims, table) for key, table in zip(RANGE_COLUMNS, quantiles, strict=True)}
        )
    notes = [f"range of {', '.join(names)}: {text}" for text, names in by_text.items()]
    return ranges if has_range else {}, notes


def _describe_draws(usable: int, draws: int) -> str:
    """Return what is to be noted on the draws of a term; empty without failures."""
    texts = []
    if usable < draws:
        texts.append(
            f"{draws - usable} of {draws} draws failed because their weights do not converge; the "
            f"range is that of the others and may be too narrow"
        )
    if usable < _FEWEST_DRAWS:
        texts = [text.partition(";")[0] for text in texts]
        texts.append(f"no range, {usable} draws are less than {_FEWEST_DRAWS}; give more draws")
    return "; ".join(texts)
