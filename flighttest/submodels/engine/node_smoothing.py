"""Most likely nodes of a steady table: smooth over the axes, with noise that is slow in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flighttest.remarks import Convergence

# Durations of the means that give noise and slow disturbance. [s]
BLOCK, LONG = 1.0, 20.0
# Candidates of a correlation length, in widths of an axis.
LENGTHS = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
# Largest number of passes over lengths and noise.
PASSES = 8
# Relative change of the noise at which it has converged.
SAME_NOISE = 1e-3
# Added to the diagonal of a correlation matrix before its inversion.
JITTER = 1e-8


class TableSamples(NamedTuple):
    """Samples of a flight.

    Attributes
    ----------
    weights : array (sample, node)
        Weights of the nodes of the table.
    values : array (sample,)
        Samples of the table.
    step : float
        Sampling interval, 0 for points. [s]
    """

    weights: np.ndarray
    values: np.ndarray
    step: float


class SmoothNodes(NamedTuple):
    """Nodes (node,) with covariance, lengths along the axes, factor on sigma, and convergence."""

    nodes: np.ndarray
    covariance: np.ndarray
    lengths: list[float]
    spread: float
    convergence: Convergence


def _block_means(x: np.ndarray, count: int) -> np.ndarray:
    """Return the means of successive blocks of `count` rows."""
    used = len(x) // count * count
    return x[:used].reshape(-1, count, *x.shape[1:]).mean(axis=1)


def _second_means(blocks: Sequence[TableSamples]) -> list[TableSamples]:
    """Return the samples averaged over `BLOCK`; the sampling interval does not change."""
    means = []
    for block in blocks:
        count = max(round(BLOCK / block.step), 1) if block.step else 1
        if len(block.values) >= count:
            weights = _block_means(block.weights, count)
            means.append(TableSamples(weights, _block_means(block.values, count), block.step))
    return means


def smooth_nodes(
    blocks: Sequence[TableSamples],
    sigma: np.ndarray,
    grid: Sequence[np.ndarray],
    spreads: Sequence[float],
) -> SmoothNodes:
    """Return the nodes with the most likely lengths, factor on sigma and noise."""
    means = _second_means(blocks)
    X = np.concatenate([block.weights for block in means])
    y = np.concatenate([block.values for block in means])
    XX, Xy, yy = X.T @ X, X.T @ y, float(y @ y)
    # Candidates of each length, then of the factor; a choice is an index into each of them.
    options = [*(LENGTHS for _ in grid), tuple(spreads)]
    choice = [len(values) // 2 for values in options]
    noise = float(np.var(y))

    def precision(chosen: Sequence[int]) -> np.ndarray:
        # The correlation is a product over the axes, so its inverse is a Kronecker product.
        *lengths, spread = (values[k] for values, k in zip(options, chosen))
        inverse: np.ndarray = np.eye(1)
        for x, length in zip(grid, lengths):
            inverse = np.kron(inverse, np.linalg.inv(_correlation(x, length * np.ptp(x))))
        return inverse / np.outer(spread * sigma, spread * sigma)

    def cost(chosen: Sequence[int]) -> float:
        # Twice the negative logarithm of the marginal likelihood [Rasmussen2006], up to terms
        # that do not depend on the choice.
        Q = precision(chosen)
        M, b = XX / noise + Q, Xy / noise
        return float(np.linalg.slogdet(M)[1] - np.linalg.slogdet(Q)[1] - b @ np.linalg.solve(M, b))

    # Minimise over one option after the other, then estimate nodes and noise.
    for count in range(1, PASSES + 1):
        before, noise_before = list(choice), noise
        for axis, values in enumerate(options):
            candidates = [[*choice[:axis], k, *choice[axis + 1 :]] for k in range(len(values))]
            choice = min(candidates, key=cost)
        C = np.linalg.inv(XX / noise + precision(choice))
        d = C @ Xy / noise
        noise = max(_long_term_variance(means, d), 1e-12 * yy / len(y))
        change = abs(noise - noise_before)
        moves = max(abs(k - last) for k, last in zip(choice, before))
        convergence = Convergence(
            converged=moves == 0 and change < SAME_NOISE * noise,
            iterations=count,
            change=max(change / (SAME_NOISE * noise), float(moves)),
        )
        if convergence.converged:
            break
    *lengths, spread = (float(values[k]) for values, k in zip(options, choice))
    # Lengths in units of their axis.
    scaled = [length * float(np.ptp(x)) for length, x in zip(lengths, grid)]
    return SmoothNodes(d, C, scaled, spread=spread, convergence=convergence)


def _correlation(x: np.ndarray, length: float) -> np.ndarray:
    """Return the Matern 3/2 correlation of nodes along an axis."""
    r = np.sqrt(3.0) * np.abs(x[:, None] - x) / (length if length > 0.0 else 1.0)
    return (1.0 + r) * np.exp(-r) + JITTER * np.eye(len(x))


def _long_term_variance(blocks: Sequence[TableSamples], nodes: np.ndarray) -> float:
    """Return the variance of a sample from which means over `LONG` have their observed scatter."""
    count = round(LONG / BLOCK)
    residuals, means = [], []
    for block in blocks:
        v = block.values - block.weights @ nodes
        residuals.append(v)
        # Points have no order in time.
        if block.step and len(v) >= count:
            means.append(_block_means(v, count))
    slow = 0.0
    if means:
        slow = count * float(np.mean(np.concatenate(means) ** 2))
    return max(float(np.mean(np.concatenate(residuals) ** 2)), slow)
