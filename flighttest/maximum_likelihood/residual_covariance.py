"""Covariance of the estimates if residuals are correlated in time.

    cov = M^-1 [ P^-1 + sum_i sum_k S_i' R^-1 Rvv(i - k) R^-1 S_k ] M^-1

This is [Morelli1997]_ with the cross-covariance Rvv of the disturbance behind the residuals.

- The disturbance is estimated as in `flighttest.regression.uncertainty.coloured_residuals`: on
  means over short blocks, output by output, by its spectrum. The fit has absorbed those directions
  of the unknowns of which an output contains more than half of the information.
- The innovations of two outputs are correlated at equal times. Rvv therefore has the cross-spectrum
  H_a(f) C_ab H_b*(f), which cannot make a variance negative. [Andrews1992]_ describes this
  prewhitening by autoregressions H.
- Manoeuvres are independent of each other.

References
----------
.. [Morelli1997] Morelli, Klein, Accuracy of aerodynamic model parameters estimated from flight test
   data, J. Guidance 20, 1997.
.. [Andrews1992] Andrews, Monahan, An improved heteroskedasticity and autocorrelation consistent
   covariance matrix, Econometrica 60, 1992.
.. [Haugh1976] Haugh, Checking the independence of two covariance-stationary time series,
   J. American Statistical Association 71, 1976.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import AeromatchWarning
from flighttest.maximum_likelihood.likelihood import LikelihoodMaximum
from flighttest.maximum_likelihood.search import invert_information, root_of_inverse
from flighttest.regression.uncertainty.coloured_residuals import BLOCK
from flighttest.regression.uncertainty.disturbance import Disturbance
from flighttest.regression.uncertainty.residual_spectrum import residual_spectrum

CHANCE = 1e-3  # probability that independent noise couples any two outputs
SPAN = 0.3  # longest lag between two outputs; more lags only add chance [s]
FEWEST = 16  # blocks, below which the coupling is not determined
FELT = 0.02  # effect on the motion from which a disturbance matters
# disturbance over the noise from sample to sample, from which an output is named with those that
# are coupled
LOUD = 2.0
# share of the information on a direction above which an output's residual has lost the direction
_DETERMINED = 0.5
_MOST_TIMES = 1e4  # disturbance over the noise from sample to sample, from which there is none


def innovation_coupling(innovations: np.ndarray, block: float) -> np.ndarray:
    """Return the correlation of the innovations of two outputs, (output, output).

    A value above one is not a chance result.

    Parameters
    ----------
    innovations : array (block, output)
        Prediction error of each residual from its own past.
    block : float
        Time between two of them. [s]

    Notes
    -----
    The statistic of [Haugh1976]_, n^2 sum_k r_k^2 / (n - |k|) over lags up to 0.3 s, is divided by
    the value that independent noise exceeds with the probability `CHANCE` in any pair. The diagonal
    is zero. An output without a residual is zero too.
    """
    count, outputs = innovations.shape
    statistic = np.zeros((outputs, outputs))
    if count < FEWEST or outputs < 2:
        return statistic
    size = np.sqrt((innovations**2).mean(axis=0))
    e = innovations / np.where(size > 0.0, size, 1.0)
    lags = max(1, min(round(SPAN / block), count // 4))
    for lag in range(lags + 1):
        r = e[lag:].T @ e[: count - lag] / count  # of output a after output b
        share = count**2 * r**2 / (count - lag)
        # A positive lag stands for both signs.
        if lag:
            share = share + share.T
        statistic += share
    limit = scipy.stats.chi2.isf(CHANCE / (outputs * (outputs - 1) // 2), 2 * lags + 1)
    np.fill_diagonal(statistic, 0.0)
    return statistic / limit


def turbulence_warnings(noise: xr.Dataset) -> tuple[str, ...]:
    """Return a warning as text if an open-loop fit will fail.

    The result is empty if the residuals are noise of instruments, or if they do not matter.

    Parameters
    ----------
    noise : Dataset (output,)
        ``slow``, ``fast``, ``time``, ``coupling`` and ``effect`` as in `OutputError`.

    Notes
    -----
    The warning has two conditions. The residuals of two outputs are coupled. The standard error of
    an estimate, for coloured residuals, moves the outputs by more than 2 % of the motion. Coloured
    noise of instruments does not meet the first condition. A small disturbance does not meet the
    second one in a record that determines its estimates; the standard errors contain both. A term
    that the model lacks has the same effect as turbulence. Plots of the residuals over the inputs
    distinguish the two.
    """
    effect = float(noise.attrs["effect"])
    is_coupled = (noise["coupling"].values > 1.0).any(axis=1)
    if not (effect > FELT and is_coupled.any()):
        return ()
    is_named = is_coupled | (noise["slow"].values > LOUD * noise["fast"].values)
    parts = []
    for k in np.flatnonzero(is_named):
        name, time = noise["output"].values[k], noise["time"].values[k]
        slow, fast = noise["slow"].values[k], noise["fast"].values[k]
        size = "no noise from sample to sample"
        if slow < _MOST_TIMES * fast:
            size = f"{slow / fast:.1f} times its noise"
        parts.append(f"{name} ({size}, {time:.2g} s)")
    return (
        f"turbulence or a missing term: residuals of {', '.join(parts)} are a disturbance of "
        f"the motion, which moves the outputs through "
        f"each estimate by {100.0 * effect:.2g} % of the motion; fitted open loop the "
        f"estimates are biased and scatter more than they "
        "determine. Use flighttest.maximum_likelihood.filter_error, equation error, or a "
        "record in calm air",
    )


def warn_of_turbulence(noise: xr.Dataset) -> tuple[str, ...]:
    """Issue the warnings of `turbulence_warnings` to the caller of the fit, and return them."""
    texts = turbulence_warnings(noise)
    for text in texts:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return texts


class ResidualNoise(NamedTuple):
    """Components of the residuals of one output.

    Attributes
    ----------
    disturbance : Disturbance
        Disturbance of the means over blocks.
    slow : float
        Standard deviation of the disturbance.
    white : float
        Standard deviation of the noise from sample to sample.
    time : float
        Correlation time of the disturbance: integral of its autocorrelation, at least a block. [s]
    block : float
        Length of a block: white noise has this correlation time. [s]
    innovations : array (block,)
        Prediction errors of the disturbance, one manoeuvre after the other.
    """

    disturbance: Disturbance
    slow: float
    white: float
    time: float
    block: float
    innovations: np.ndarray


class _Blocks(NamedTuple):
    """Weighted slopes and residuals of one manoeuvre, divided into blocks.

    Attributes
    ----------
    sums, means : array (unknown, block, output)
        Slopes.
    inside : array (unknown, sample, output)
        Slopes less their block means.
    residual : array (block, output)
        Block means of the residuals.
    remainder : array (sample, output)
        Residuals less their block means.
    """

    sums: np.ndarray
    means: np.ndarray
    inside: np.ndarray
    residual: np.ndarray
    remainder: np.ndarray


@dataclass(frozen=True)
class _BlockedRecords:
    """All manoeuvres in blocks, with the positions of their unknowns.

    Attributes
    ----------
    pieces : list of _Blocks
    columns : sequence of array of int
        Positions of the unknowns of each manoeuvre.
    root : array (unknown, unknown)
        Root of the covariance of the estimates: its columns are independent directions.
    block : float
        Length of a block. [s]
    """

    pieces: list[_Blocks]
    columns: Sequence[np.ndarray]
    root: np.ndarray
    block: float

    @property
    def rows(self) -> list[slice]:
        """Blocks of each manoeuvre among those of all manoeuvres."""
        edges = np.cumsum([0, *(len(piece.residual) for piece in self.pieces)])
        return [slice(int(start), int(stop)) for start, stop in pairwise(edges)]


def coloured_likelihood_covariance(
    maximum: LikelihoodMaximum, columns: Sequence[np.ndarray], steps: Sequence[float]
) -> tuple[np.ndarray, list[ResidualNoise]]:
    """Return the covariance of the estimates (unknown, unknown), and the colour of every output.

    Parameters
    ----------
    maximum : LikelihoodMaximum
        Its residuals, over the square root of the noise variance, count as one process in all
        manoeuvres.
    columns : sequence of array of int
        Positions of the unknowns of each manoeuvre.
    steps : sequence of float
        Sampling interval of each manoeuvre. [s]
    """
    pieces = []
    for S, v, noise, step in zip(maximum.slopes, maximum.residuals, maximum.noise, steps):
        pieces.append(_divide_into_blocks(S, v, noise=noise, step=step))
    free = ~maximum.active
    records = _BlockedRecords(
        pieces=pieces,
        columns=columns,
        root=root_of_inverse(maximum.information, free),
        block=max(1, round(BLOCK / steps[0])) * steps[0],
    )
    outputs = pieces[0].residual.shape[1]
    colours = [_estimate_colour(output, records) for output in range(outputs)]
    # white noise inside the blocks, (output, output)
    remainder = np.concatenate([piece.remainder for piece in pieces])
    freedom = max(1, len(remainder) - sum(len(piece.residual) for piece in pieces))
    white = remainder.T @ remainder / freedom
    coupling = _innovation_covariance(colours)
    inner = np.zeros_like(maximum.information)
    longest = max(len(piece.residual) for piece in pieces)
    for piece, positions in zip(pieces, columns):
        slow = _slow_products(piece.sums, colours, coupling=coupling, longest=longest)
        inner[np.ix_(positions, positions)] += slow + _fast_products(piece.inside, white)
    # The prior P^-1 is the information without that of the readings.
    prior = maximum.information - _reading_information(pieces, columns, len(free))
    D = invert_information(maximum.information, free)
    return D @ (inner + prior) @ D, colours


def effect_on_motion(
    maximum: LikelihoodMaximum,
    columns: Sequence[np.ndarray],
    covariance: np.ndarray,
    measured: Sequence[np.ndarray],
) -> float:
    """Return the mean effect of one standard error of an estimate, as a share of the motion.

    The effect is the root of tr(S' R^-1 S cov) / n over that of the motion sum z' R^-1 z, with n
    estimates. For y = theta x alone it is the standard error over theta. It does not depend on the
    choice of the unknowns or on their correlation.

    Parameters
    ----------
    maximum : LikelihoodMaximum
    columns : sequence of array of int
        Positions of the unknowns of each manoeuvre.
    covariance : array (unknown, unknown)
        Covariance of the estimates.
    measured : sequence of array (time, output)
        Outputs of each manoeuvre, NaN for a missing reading.
    """
    level = np.nanmean(np.concatenate(measured), axis=0)
    M, motion = np.zeros_like(covariance), 0.0
    for S, noise, positions, z in zip(maximum.slopes, maximum.noise, columns, measured):
        X = (S / np.sqrt(noise)[:, None]).reshape(-1, len(positions))
        M[np.ix_(positions, positions)] += X.T @ X
        motion += float(np.nansum((z - level) ** 2 / noise))
    count = int(((np.diag(M) > 0.0) & ~maximum.active).sum())
    if not count or not motion > 0.0:
        return 0.0
    trace = float((M * covariance).sum())
    return float(np.sqrt(max(trace, 0.0) / (count * motion)))


def _divide_into_blocks(S: np.ndarray, v: np.ndarray, noise: np.ndarray, step: float) -> _Blocks:
    """Return slopes and residuals over the root of the noise variance, in blocks."""
    length = max(1, round(BLOCK / step))
    starts = np.arange(0, len(v), length)
    counts = np.diff([*starts, len(v)])
    root = np.sqrt(noise)
    X = np.divide(np.moveaxis(S, 2, 0), root, order="C")
    e = v / root
    sums = np.add.reduceat(X, starts, axis=1)
    means = sums / counts[:, None]
    residual = np.add.reduceat(e, starts, axis=0) / counts[:, None]
    X -= np.repeat(means, counts, axis=1)
    return _Blocks(
        sums=sums,
        means=means,
        inside=X,
        residual=residual,
        remainder=e - np.repeat(residual, counts, axis=0),
    )


def _reading_information(
    pieces: Sequence[_Blocks], columns: Sequence[np.ndarray], unknowns: int
) -> np.ndarray:
    """Return the information of the readings alone, sum S'R^-1 S."""
    M = np.zeros((unknowns, unknowns))
    for piece, positions in zip(pieces, columns):
        sums = piece.sums.reshape(len(positions), -1)
        means = piece.means.reshape(len(positions), -1)
        inside = piece.inside.reshape(len(positions), -1)
        M[np.ix_(positions, positions)] += sums @ means.T + inside @ inside.T
    return M


def _estimate_colour(output: int, records: _BlockedRecords) -> ResidualNoise:
    """Return the components of the residuals of one output."""
    pieces, rows, block = records.pieces, records.rows, records.block
    v = np.concatenate([piece.residual[:, output] for piece in pieces])
    # Block means of the slopes (block, unknown), and the samples per block.
    X, samples = np.zeros((len(v), len(records.root))), np.zeros((len(v), 1))
    for piece, blocks, positions in zip(pieces, rows, records.columns):
        block_rows = np.arange(blocks.start, blocks.stop)
        X[np.ix_(block_rows, positions)] = piece.means[:, :, output].T
        samples[blocks] = len(piece.remainder) / len(piece.residual)
    # Along independent directions of the unknowns, s^2 is the share of the information that this
    # output contributes. The triangle of all rows has the same singular values.
    directions = X @ records.root
    triangle = np.linalg.qr(directions * np.sqrt(samples), mode="r")
    _, s, Vt = np.linalg.svd(triangle, full_matrices=False)
    share = s**2
    # The residual has lost the determined directions; the first direction always counts.
    absorbed = Vt[share >= min(_DETERMINED, share[0])].T
    model = residual_spectrum(directions @ absorbed, v, rows).model
    remainder = np.concatenate([piece.remainder[:, output] for piece in pieces])
    white = float(remainder @ remainder) / max(1, len(remainder) - len(v))
    r = model.autocovariance(max(2, len(v) // 4))
    time = block
    if r[0] > 0.0:
        time = block * max(1.0, float(2.0 * r.sum() / r[0] - 1.0))
    return ResidualNoise(
        disturbance=model,
        slow=float(np.sqrt(r[0])),
        white=float(np.sqrt(white)),
        time=time,
        block=block,
        innovations=np.concatenate([model.innovations(v[blocks]) for blocks in rows]),
    )


def _innovation_covariance(colours: Sequence[ResidualNoise]) -> np.ndarray:
    """Return the covariance of the innovations of all outputs at equal times."""
    e = np.column_stack([colour.innovations for colour in colours])
    size = np.sqrt((e**2).mean(axis=0))
    e = e / np.where(size > 0.0, size, 1.0)
    deviation = np.array([np.sqrt(colour.disturbance.variance) for colour in colours])
    return e.T @ e / len(e) * np.outer(deviation, deviation)


def _slow_products(
    X: np.ndarray, colours: Sequence[ResidualNoise], coupling: np.ndarray, longest: int
) -> np.ndarray:
    """Return sum_i sum_k X_i' Rvv(i - k) X_k of the disturbances; X is (unknown, time, output)."""
    # Order and memory of the disturbances are limited by the longest manoeuvre.  A transform of the
    # length of a shorter one would lose coefficients, and 1/A could have any size.
    size = 1 << int(4 * longest - 1).bit_length()
    by_output = np.ascontiguousarray(X.transpose(0, 2, 1))
    F = np.fft.rfft(by_output, size)  # (unknown, output, frequency)
    responses = [1.0 / np.fft.rfft(colour.disturbance.coefficients, size) for colour in colours]
    H = np.stack(responses).conj()
    H[:, 1:-1] *= np.sqrt(2.0)  # for the negative frequencies
    # Rvv(k) = E v_i v_(i+k)' has the spectrum conj(H) C H'. With C = L L' the sum is a square.
    values, vectors = np.linalg.eigh(coupling)
    L = vectors * np.sqrt(np.maximum(values, 0.0))
    G = (L.T @ (H * F).view(float)).reshape(len(X), -1)
    return G @ G.T / size


def _fast_products(inside: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Return sum_i X_i' W X_i of the slopes inside the blocks."""
    flat = inside.reshape(len(inside), -1)
    return flat @ (inside @ white).reshape(flat.shape).T
