"""Observability of the constants of a batch fit, and standard errors of all unknowns.

The fit takes the readings for the only random quantities. Two facts make its Cramer-Rao bounds too
small:

- Residuals are correlated in time. Their autocorrelation replaces the autocorrelation of white
  noise.
- The gyros and accelerometers that drive the path are noisy. The path is the sum of their noise and
  wanders. The effect on the estimate follows from the noise of the specification by the adjoint of
  the sensitivity equations: one backward running sum per unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.simulation.normal_sums import driven_series
from flighttest.reconstruction.batch.estimator import BatchEquations
from flighttest.reconstruction.batch.unknowns import driven_paths, window_slices

# Share of the largest eigenvalue of the scaled information above which a direction counts as seen.
RANK = 1e-10
# Share of the largest component of a direction below which a constant is not named.
PART = 0.2
WINDOW = 0.1  # lag window over the length of a segment
_TINY = 1e-300  # prevents division by zero


@dataclass(frozen=True)
class Observability:
    """Information of the readings on the constants, for unknown starts of the path.

    Attributes
    ----------
    directions : Dataset (direction, parameter)
        ``weight`` (direction): sum of the squared changes of all readings, in units of their noise,
        when the constants move together by ``move`` (direction, parameter), which is one standard
        deviation of their prior.  Below one the readings are less informative than the
        specification of the instruments.  Smallest first.
    rank, constants : int
        Numerical rank of the information on the constants, and how many there are.
    condition : float
        Condition number of the information scaled to unit diagonal.
    """

    directions: xr.Dataset
    rank: int
    constants: int
    condition: float

    def hidden(self, limit: float = 1.0) -> list[str]:
        """Return a sentence on each combination with a weight below `limit`."""
        weights = self.directions["weight"].values
        return [self._describe_direction(i) for i in np.flatnonzero(weights < limit).tolist()]

    def report(self) -> str:
        """Return rank, condition and hidden combinations as text."""
        head = (
            f"before the fit: rank {self.rank} of {self.constants} constants, condition "
            f"number {self.condition:.3g}"
        )
        sentences = [f"  ! {sentence}" for sentence in self.hidden()]
        return "\n".join([head, *(sentences or ["  every constant is seen"])])

    def _describe_direction(self, i: int) -> str:
        row = self.directions.isel(direction=i)
        move, share = row["move"].values, np.abs(row["component"].values)
        # constants with a large part in the direction, the largest first
        large = np.flatnonzero(share > PART * share.max())
        large = large[np.argsort(-share[large])]
        names, units = row["parameter"].values, row["unit"].values
        # The sign of a direction is arbitrary: the first constant moves upwards.
        sign = np.sign(move[large[0]])
        parts = [f"{names[j]} {sign * move[j]:+.3g} {units[j]}".removesuffix(" 1") for j in large]
        noise = np.sqrt(max(float(row["weight"]), 0.0))
        if len(parts) == 1:
            return (
                f"not seen: {parts[0]} changes all readings together by {noise:.2g} of their "
                f"noise; it rests on its prior"
            )
        return (
            f"not seen apart: {', '.join(parts)} together change all readings by {noise:.2g} "
            f"of their noise; "
            "give one of them a prior from elsewhere, or fly a manoeuvre that separates them"
        )


def determine_observability(equations: BatchEquations) -> Observability:
    """Return the information of the readings on the free constants.

    Parameters
    ----------
    equations : BatchEquations
        Equations at the start.
    """
    layout = equations.layout
    free = np.flatnonzero(layout.free)
    information = _constants_information(equations, free)
    size = np.sqrt(np.maximum(np.diag(information), _TINY))
    eigenvalues = np.linalg.eigvalsh(information / np.outer(size, size))
    # In units of the prior standard deviations, an eigenvalue is the weight of a direction.
    sigma = np.sqrt(np.diag(layout.covariance))[free]
    weight, component = np.linalg.eigh(information * np.outer(sigma, sigma))
    directions = xr.Dataset(
        {
            "weight": ("direction", weight),
            "component": (("direction", "parameter"), component.T),
            "move": (("direction", "parameter"), component.T * sigma),
            "unit": ("parameter", [layout.units[i] for i in free]),
        },
        coords={"parameter": [layout.names[i] for i in free]},
    )
    rank = int((eigenvalues > RANK * eigenvalues[-1]).sum())
    condition = np.inf
    if eigenvalues[0] > 0.0:
        condition = float(eigenvalues[-1] / eigenvalues[0])
    return Observability(directions, rank, constants=len(free), condition=condition)


def _constants_information(equations: BatchEquations, free: np.ndarray) -> np.ndarray:
    """Return the information of the readings on free constants, without the prior."""
    layout = equations.layout
    nc = len(layout.names)
    starts = np.arange(nc, layout.size)
    normal = equations.normal.copy()
    normal[:nc, :nc] -= layout.prior_information()
    # Schur complement C - B' S^-1 B, with S = L L' the block of the starts, scaled to unit diagonal
    block = normal[np.ix_(starts, starts)]
    scale = 1.0 / np.sqrt(np.diag(block))
    root = np.linalg.cholesky(block * np.outer(scale, scale))
    half = np.linalg.solve(root, scale[:, None] * normal[np.ix_(starts, free)])
    return normal[np.ix_(free, free)] - half.T @ half


def demand_sight(observability: Observability) -> None:
    """Refuse to estimate constants from readings that do not determine them.

    Raises
    ------
    IdentificationError
        The readings on some combinations are less informative than the specification of the
        instruments. The message names all of them.
    """
    hidden = observability.hidden()
    if hidden:
        raise IdentificationError(
            "the readings do not determine these constants (leave `free` out, and their "
            "priors take part):\n  - " + "\n  - ".join(hidden)
        )


def batch_covariances(equations: BatchEquations) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected and the white (Cramer-Rao) covariance of all unknowns.

    Both are zero for unknowns that are not estimated.

    Notes
    -----
    ::

        D = (S' R^-1 S + P0^-1)^-1
        corrected = D [P0^-1 + sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j + sum_i T_i' Q T_i] D

    Rvv is the biased autocorrelation of the residuals of each channel with Bartlett's taper over a
    tenth of the segment. T_i is the gradient by the noise of the inertial unit at sample i, and Q
    the variance of this noise. The autocorrelation is an estimate. Where it makes a variance
    smaller than white residuals do, the variance for white residuals is used.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [MaineIliff] Maine, Iliff, NASA RP-1138, 1985.
    """
    layout = equations.layout
    movable = np.ix_(layout.moving, layout.moving)
    D = np.zeros_like(equations.normal)
    scale = 1.0 / np.sqrt(np.diag(equations.normal[movable]))
    scales = np.outer(scale, scale)
    D[movable] = np.linalg.inv(equations.normal[movable] * scales) * scales
    coloured, inertial = residual_noise(equations)
    floor = np.diag(D) + np.diag(D @ inertial @ D)
    # inertial noise, and the priors of constants and starts
    others = inertial
    nc = len(layout.names)
    others[:nc, :nc] += layout.prior_information()
    for run, setup in enumerate(layout.setups):
        places = layout.start_places(run)
        others[places, places] += 1.0 / setup.problem.start_sigma**2
    corrected = D @ (coloured + others) @ D
    # Raise each variance to the floor and keep the correlations.
    raise_to_floor = np.sqrt(np.maximum(floor / np.maximum(np.diag(corrected), _TINY), 1.0))
    corrected *= np.outer(raise_to_floor, raise_to_floor)
    return (corrected + corrected.T) / 2.0, D


def residual_noise(equations: BatchEquations) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of the gradient from coloured residuals and from inertial noise.

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
        problem = setup.problem
        path, places = equations.linearise_path(run)
        # weighted derivatives of the readings by the states, per sample: input of the adjoint
        adjoint = np.zeros((*path.x.shape, len(places[0])))
        for part in equations.segment_readings(run, path):
            sigma = np.array([equations.sigma[name] for name in part.names])
            series = driven_series(
                path.X[part.samples],
                len(places[0]),
                part.readings,
                1.0 / sigma,
                adjoint[part.samples],
            )
            for S, r, noise in zip(series, part.readings.r.T, sigma, strict=True):
                involved = np.flatnonzero(S.any(axis=1))
                indices = places[part.segment][involved]
                variance = correlated_variance(S[involved] / noise, r / noise)
                coloured[np.ix_(indices, indices)] += variance
        c = equations.at.c[layout.places[run]]
        windows = driven_paths(problem, c, before=path.x, columns=path.columns)
        for window, samples, indices in zip(windows, window_slices(problem), places, strict=True):
            products = np.zeros((len(indices), len(indices)))
            window.add_noise(path.x[samples], problem.noise, adjoint[samples], products)
            inertial[np.ix_(indices, indices)] += products
    return coloured, inertial


def correlated_variance(S: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return sum_ij S_i Rvv(i - j) S_j' of series S (u, N).

    Rvv is the autocorrelation of r (N,), see `tapered_autocorrelation`.

    Notes
    -----
    Parseval's theorem: the result is the sum over the frequencies of the spectra of S, each times
    the spectrum of Rvv. The transforms are long enough that no product wraps around.
    """
    lags = tapered_autocorrelation(r)
    size = scipy.fft.next_fast_len(S.shape[1] + len(lags) - 1, real=True)
    # autocorrelation at positive and negative lags, the negative lags at the end
    symmetric = np.zeros(size)
    symmetric[: len(lags)] = lags
    symmetric[size - len(lags) + 1 :] = lags[:0:-1]
    weight = scipy.fft.rfft(symmetric).real / size
    # Each positive frequency also represents its negative.
    weight[1 : (size + 1) // 2] *= 2.0
    F = scipy.fft.rfft(S, size, axis=1)
    parts = np.concatenate([F.real, F.imag], axis=1)
    return (parts * np.concatenate([weight, weight])) @ parts.T


def tapered_autocorrelation(r: np.ndarray) -> np.ndarray:
    """Return the biased autocorrelation at lags 0, 1, ... (window,).

    Bartlett's taper goes over a tenth of the record.
    """
    N = len(r)
    window = max(1, round(WINDOW * N))
    size = scipy.fft.next_fast_len(N + window - 1, real=True)
    products = scipy.fft.irfft(np.abs(scipy.fft.rfft(r, size)) ** 2, size)[:window]
    taper = 1.0 - np.arange(window) / window
    return products / N * taper
