"""Covariance of the estimates when residuals are correlated in time.

    cov = M^-1 [ P^-1 + sum_i sum_k S_i' R^-1 Rvv(i - k) R^-1 S_k ] M^-1

with the cross-covariance Rvv of the disturbance behind the residuals.  As in
`flighttest.regression.uncertainty.coloured_residuals` it is estimated on means over short blocks,
output by output, by its spectrum.  The fit has taken up the directions of the unknowns that an
output shows more than half of.  Between outputs the innovations are correlated at equal times, so
that Rvv is the cross-spectrum  H_a(f) C_ab H_b*(f),  which no estimate can make negative.  Between
manoeuvres nothing is correlated.

References
----------
.. [Morelli1997] Morelli, Klein, Accuracy of aerodynamic model parameters estimated from flight test data, J. Guidance 20, 1997.
.. [Andrews1992] Andrews, Monahan, An improved heteroskedasticity and autocorrelation consistent covariance matrix, Econometrica 60, 1992.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import AeromatchWarning
from flighttest.maximum_likelihood.search import (
    LikelihoodMaximum,
    invert_information,
    root_of_inverse,
)
from flighttest.regression.uncertainty.coloured_residuals import BLOCK
from flighttest.regression.uncertainty.residual_spectrum import Disturbance, residual_spectrum

CHANCE = 1e-3  # probability that independent noise couples any two outputs
SPAN = 0.3  # one output follows another within so long; more lags only add chance [s]
FEWEST = 16  # blocks, below which the coupling is not determined
FELT = 0.02  # effect on the motion from which a disturbance matters
# disturbance over the noise from sample to sample, from which an output is named with those that
# are coupled
LOUD = 2.0


def innovation_coupling(innovations: np.ndarray, block: float) -> np.ndarray:
    """Return how far the innovations of two outputs are correlated (output, output); above one is
    no chance.

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
    limit = scipy.stats.chi2.isf(CHANCE / (outputs * (outputs - 1) // 2), 2 * lags + 1)
    np.fill_diagonal(found, 0.0)
    return found / limit


def turbulence_warnings(noise: xr.Dataset) -> tuple[str, ...]:
    """Return a warning when open-loop fitting will fail, as texts; empty when the residuals are
    noise of instruments or do not matter.

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
    parts = [
        f"{name} ({slow / max(fast, 1e-300):.1f} times its noise, {time:.2g} s)"
        for name, slow, fast, time in zip(*columns)
    ]
    return (
        f"turbulence or a missing term: residuals of {', '.join(parts)} are a disturbance of "
        f"the motion, which moves the outputs through "
        f"each estimate by {100.0 * effect:.2g} % of the motion; fitted open loop the "
        f"estimates are biased and scatter more than they "
        "determine. Use flighttest.maximum_likelihood.filter_error, equation error, or a "
        "record in calm air",
    )


def warn_of_turbulence(noise: xr.Dataset) -> tuple[str, ...]:
    """Return what `turbulence_warnings` finds, after a warning to the caller of the fit."""
    found = turbulence_warnings(noise)
    for text in found:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return found


_DETERMINED = (
    0.5  # share of the information on a direction above which an output's residual has lost it
)


class ResidualNoise(NamedTuple):
    """What the residuals of one output are made of.

    Attributes
    ----------
    disturbance : Disturbance
        Of the means over blocks.
    slow : float
        Standard deviation of the disturbance.
    white : float
        Standard deviation of the noise from sample to sample.
    time : float
        Over how long the disturbance is correlated: integral of its autocorrelation, at least a
        block. [s]
    block : float
        Length of a block: white noise has this correlation time. [s]
    innovations : array (block,)
        What its past does not predict of the disturbance, one manoeuvre after the other.
    """

    disturbance: Disturbance
    slow: float
    white: float
    time: float
    block: float
    innovations: np.ndarray


class _Blocks(NamedTuple):
    """Weighted slopes and residuals of one manoeuvre: means and sums over blocks, and the remainder
    inside them.
    """

    sums: np.ndarray  # (unknown, block, output)
    means: np.ndarray  # (unknown, block, output)
    inside: np.ndarray  # (unknown, sample, output)
    residual: np.ndarray  # (block, output)
    rest: np.ndarray  # (sample, output)


def coloured_likelihood_covariance(
    found: LikelihoodMaximum, columns: Sequence[np.ndarray], steps: Sequence[float]
) -> tuple[np.ndarray, list[ResidualNoise]]:
    """Return the covariance of the estimates (unknown, unknown), and the colour of every output.

    Parameters
    ----------
    found : Found
        Residuals divided by the square root of the noise variance are taken for one process in all
        manoeuvres.
    columns : sequence of array of int
        Places of the unknowns of each manoeuvre.
    steps : sequence of float
        Sampling interval of each manoeuvre. [s]
    """
    pieces = [
        _blocks(S, v, noise, step)
        for S, v, noise, step in zip(found.slopes, found.residuals, found.noise, steps)
    ]
    free = ~found.active
    colours = _colours(pieces, columns, found.information, free, steps)
    rest = np.concatenate([piece.rest for piece in pieces])
    freedom = max(1, len(rest) - sum(len(piece.residual) for piece in pieces))
    white = rest.T @ rest / freedom
    links = _links(colours)
    inner = np.zeros_like(found.information)
    for piece, place in zip(pieces, columns):
        inner[np.ix_(place, place)] += _slow(piece.sums, colours, links) + _fast(
            piece.inside, white
        )
    D = invert_information(found.information, free)
    prior = found.information - _gathered(pieces, columns, len(free))
    return D @ (inner + prior) @ D, colours


def effect_on_motion(
    found: LikelihoodMaximum,
    columns: Sequence[np.ndarray],
    covariance: np.ndarray,
    measured: Sequence[np.ndarray],
) -> float:
    """Return by which part of the motion the error of an estimate moves the outputs, one standard
    error, in the mean of all estimates.

    The root of  tr(S' R^-1 S cov) / n  over that of the motion  sum z' R^-1 z,  with n estimates.
    Where y = theta x alone it is the standard error over theta; it does not depend on how the
    unknowns are chosen, nor on how they are correlated.

    Parameters
    ----------
    found : Found
    columns : sequence of array of int
        Places of the unknowns of each manoeuvre.
    covariance : array (unknown, unknown)
        Of the estimates.
    measured : sequence of array (time, output)
        Outputs of each manoeuvre, NaN where there is no reading.
    """
    level = np.nanmean(np.concatenate(measured), axis=0)
    M, motion = np.zeros_like(covariance), 0.0
    for S, noise, place, z in zip(found.slopes, found.noise, columns, measured):
        X = (S / np.sqrt(noise)[:, None]).reshape(-1, len(place))
        M[np.ix_(place, place)] += X.T @ X
        motion += float(np.nansum((z - level) ** 2 / noise))
    count = int(((np.diag(M) > 0.0) & ~found.active).sum())
    moved = float((M * covariance).sum())
    return float(np.sqrt(max(moved, 0.0) / (count * motion))) if count and motion > 0.0 else 0.0


def _blocks(S: np.ndarray, v: np.ndarray, noise: np.ndarray, step: float) -> _Blocks:
    length = max(1, round(BLOCK / step))
    starts = np.arange(0, len(v), length)
    counts = np.diff([*starts, len(v)])
    root = np.sqrt(noise)
    X = np.divide(np.moveaxis(S, 2, 0), root, order="C")
    e = v / root
    sums, residual = (
        np.add.reduceat(X, starts, axis=1),
        np.add.reduceat(e, starts, axis=0) / counts[:, None],
    )
    means = sums / counts[:, None]
    X -= np.repeat(means, counts, axis=1)
    return _Blocks(sums, means, X, residual, e - np.repeat(residual, counts, axis=0))


def _gathered(
    pieces: Sequence[_Blocks], columns: Sequence[np.ndarray], unknowns: int
) -> np.ndarray:
    """Return the information of the readings alone, sum S'R^-1 S."""
    M = np.zeros((unknowns, unknowns))
    for piece, place in zip(pieces, columns):
        sums, means, inside = (
            x.reshape(len(place), -1) for x in (piece.sums, piece.means, piece.inside)
        )
        M[np.ix_(place, place)] += sums @ means.T + inside @ inside.T
    return M


def _colours(
    pieces, columns, information: np.ndarray, free: np.ndarray, steps
) -> list[ResidualNoise]:
    edges = np.cumsum([0, *(len(piece.residual) for piece in pieces)])
    places = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    root = root_of_inverse(information, free)
    block = max(1, round(BLOCK / steps[0])) * steps[0]
    return [
        _colour(a, pieces, columns, places, root, block) for a in range(pieces[0].residual.shape[1])
    ]


def _colour(a: int, pieces, columns, places, root: np.ndarray, block: float) -> ResidualNoise:
    v = np.concatenate([piece.residual[:, a] for piece in pieces])
    X, length = np.zeros((len(v), len(root))), np.zeros((len(v), 1))
    for piece, rows, place in zip(pieces, places, columns):
        X[np.ix_(np.arange(rows.start, rows.stop), place)] = piece.means[:, :, a].T
        length[rows] = len(piece.rest) / len(piece.residual)
    slopes = X @ root
    _, s, Vt = np.linalg.svd(
        np.linalg.qr(slopes * np.sqrt(length), mode="r"), full_matrices=False
    )  # of all rows, by their triangle
    share = s**2
    model = residual_spectrum(
        slopes @ Vt[share >= min(_DETERMINED, share[0])].T, v, places
    ).model  # the first is always there
    rest = np.concatenate([piece.rest[:, a] for piece in pieces])
    r = model.autocovariance(max(2, len(v) // 4))
    white = float(rest @ rest) / max(1, len(rest) - len(v))
    time = block * max(1.0, float(2.0 * r.sum() / r[0] - 1.0)) if r[0] > 0.0 else block
    innovations = np.concatenate([model.innovations(v[place]) for place in places])
    return ResidualNoise(
        model, float(np.sqrt(r[0])), float(np.sqrt(white)), time, block, innovations
    )


def _links(colours: Sequence[ResidualNoise]) -> np.ndarray:
    """Return the covariance of the innovations of all outputs at equal times."""
    e = np.column_stack([colour.innovations for colour in colours])
    size = np.sqrt((e**2).mean(axis=0))
    e = e / np.where(size > 0.0, size, 1.0)
    deviation = np.array([np.sqrt(colour.disturbance.variance) for colour in colours])
    return e.T @ e / len(e) * np.outer(deviation, deviation)


def _slow(X: np.ndarray, colours: Sequence[ResidualNoise], links: np.ndarray) -> np.ndarray:
    """Return sum_i sum_k X_i' Rvv(i - k) X_k by the cross-spectrum of the disturbances; X is
    (unknown, time, output).
    """
    size = 1 << int(4 * X.shape[1] - 1).bit_length()
    F = np.fft.rfft(
        np.ascontiguousarray(X.transpose(0, 2, 1)), size
    )  # (unknown, output, frequency)
    H = np.stack(
        [1.0 / np.fft.rfft(colour.disturbance.coefficients, size) for colour in colours]
    ).conj()
    H[:, 1:-1] *= np.sqrt(2.0)  # for the frequencies below zero
    # Rvv(k) = E v_i v_(i+k)' has the spectrum conj(H) C H': with root C = L L' the sum is a square
    values, vectors = np.linalg.eigh(links)
    L = vectors * np.sqrt(np.maximum(values, 0.0))
    G = (L.T @ (H * F).view(float)).reshape(len(X), -1)
    return G @ G.T / size


def _fast(inside: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Return sum_i X_i' W X_i of what varies inside the blocks."""
    flat = inside.reshape(len(inside), -1)
    return flat @ (inside @ white).reshape(flat.shape).T
