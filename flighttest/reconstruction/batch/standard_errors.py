"""Standard errors of a batch fit: Cramer-Rao, and corrected for residuals that are correlated in
time and for a noisy inertial unit.

The fit takes the readings for the only random thing.  Two facts make its Cramer-Rao bounds too
small:

- residuals are correlated in time: their own autocorrelation replaces the white one;
- the gyros and accelerometers that drive the path are noisy too, and their noise is summed up to a wandering path.
  What it does to the estimate follows from the noise of the specification, by the adjoint of the
  sensitivity equations: one backward running sum per unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.fft import irfft, next_fast_len, rfft

from flightmech.errors import IdentificationError
from flightmech.simulation.normal_sums import driven_series
from flighttest.reconstruction.batch.estimator import BatchEquations
from flighttest.reconstruction.batch.unknowns import driven_paths, window_slices

RANK = 1e-10  # of the largest eigenvalue of the information scaled to unit diagonal
PART = 0.2  # of the largest component: smaller ones are left out of the words


@dataclass(frozen=True)
class Observability:
    """What the readings determine of the constants, the starts of the path unknown.

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
        """Return in words the combinations that weigh less than `limit`."""
        weights = self.directions["weight"].values
        return [self._words(i) for i in np.flatnonzero(weights < limit).tolist()]

    def report(self) -> str:
        """Return rank, condition and hidden combinations as text."""
        head = (
            f"before the fit: rank {self.rank} of {self.constants} constants, condition "
            f"number {self.condition:.3g}"
        )
        words = [f"  ! {word}" for word in self.hidden()]
        return "\n".join([head, *(words or ["  every constant is seen"])])

    def _words(self, i: int) -> str:
        row = self.directions.isel(direction=i)
        move, share = row["move"].values, np.abs(row["component"].values)
        large = np.flatnonzero(share > PART * share.max())
        large = large[np.argsort(-share[large])]
        names, units = row["parameter"].values, row["unit"].values
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
    """Return what the readings determine of the free constants.

    Parameters
    ----------
    equations : Equations
        At the start.
    """
    layout = equations.layout
    nc = len(layout.names)
    free = np.flatnonzero(layout.free)
    rest = np.arange(nc, layout.size)
    normal = equations.normal.copy()
    normal[:nc, :nc] -= layout.prior_information()
    starts = normal[np.ix_(rest, rest)]
    scale = 1.0 / np.sqrt(np.diag(starts))
    root = np.linalg.cholesky(starts * np.outer(scale, scale))
    half = np.linalg.solve(root, scale[:, None] * normal[np.ix_(rest, free)])
    information = normal[np.ix_(free, free)] - half.T @ half
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    own = np.linalg.eigvalsh(information / np.outer(size, size))
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
    rank = int((own > RANK * own[-1]).sum())
    return Observability(
        directions, rank, len(free), float(own[-1] / own[0]) if own[0] > 0.0 else np.inf
    )


def demand_sight(found: Observability) -> None:
    """Refuse to estimate from the readings alone what they do not show.

    Raises
    ------
    IdentificationError
        With all combinations of which the readings are less informative than the specification of
        the instruments.
    """
    blind = found.hidden()
    if blind:
        raise IdentificationError(
            "the readings do not determine these constants (leave `free` out, and their "
            "priors take part):\n  - " + "\n  - ".join(blind)
        )


WINDOW = 0.1  # lag window over the length of a segment


def batch_covariances(equations: BatchEquations) -> tuple[np.ndarray, np.ndarray]:
    """Return the corrected and the white (Cramer-Rao) covariance of all unknowns; zero for those
    not estimated.

    Notes
    -----
    ::

        D = (S' R^-1 S + P0^-1)^-1
        corrected = D [P0^-1 + sum_ij S_i' R^-1 Rvv(i - j) R^-1 S_j + sum_i T_i' Q T_i] D

    Rvv: biased autocorrelation of the residuals of each channel with Bartlett's taper over a tenth
    of the segment; T_i: gradient by the noise of the inertial unit at sample i, Q its variance.
    Where the autocorrelation makes a variance smaller than white residuals would (it is itself
    estimated), the white one stays.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [MaineIliff] Maine, Iliff, NASA RP-1138, 1985.
    """
    layout = equations.layout
    move = np.ix_(layout.moving, layout.moving)
    D = np.zeros_like(equations.normal)
    scale = 1.0 / np.sqrt(np.diag(equations.normal[move]))
    D[move] = np.linalg.inv(equations.normal[move] * np.outer(scale, scale)) * np.outer(
        scale, scale
    )
    coloured, rest = residual_noise(equations)
    floor = np.diag(D) + np.diag(D @ rest @ D)
    nc = len(layout.names)
    rest[:nc, :nc] += layout.prior_information()
    for run, setup in enumerate(layout.setups):
        places = layout.start_places(run)
        rest[places, places] += 1.0 / setup.problem.start_sigma**2
    corrected = D @ (coloured + rest) @ D
    short = np.sqrt(np.maximum(floor / np.maximum(np.diag(corrected), 1e-300), 1.0))
    corrected *= np.outer(short, short)
    return (corrected + corrected.T) / 2.0, D


def residual_noise(equations: BatchEquations) -> tuple[np.ndarray, np.ndarray]:
    """Return what the gradient takes from residuals correlated in time, and from the noise of gyros
    and accelerometers.

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
        problem, at = setup.problem, layout.places[run]
        swept, places = equations.swept(run)
        pressed = np.zeros((*swept.x.shape, len(places[0])))
        for part in equations.parts(run, swept):
            sigma = np.array([equations.sigma[name] for name in part.names])
            series = driven_series(
                swept.X[part.samples],
                len(places[0]),
                part.readings,
                1.0 / sigma,
                pressed[part.samples],
            )
            for S, r, own in zip(series, part.readings.r.T, sigma, strict=True):
                used = np.flatnonzero(S.any(axis=1))
                chosen = places[part.segment][used]
                coloured[np.ix_(chosen, chosen)] += correlated_variance(S[used] / own, r / own)
        paths = driven_paths(problem, equations.at.c[at], swept.x, swept.columns)
        for path, samples, own in zip(paths, window_slices(problem), places, strict=True):
            products = np.zeros((len(own), len(own)))
            path.add_noise(swept.x[samples], problem.noise, pressed[samples], products)
            inertial[np.ix_(own, own)] += products
    return coloured, inertial


def correlated_variance(S: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return sum_ij S_i Rvv(i - j) S_j' of series S (u, N), Rvv the autocorrelation of r (N,), see
    `tapered_autocorrelation`.

    Notes
    -----
    Parseval: the sum over the frequencies of the spectra of S, each with the spectrum of Rvv, both long enough not to wrap around.
    """
    right = tapered_autocorrelation(r)
    size = next_fast_len(S.shape[1] + len(right) - 1, real=True)
    both = np.zeros(size)
    both[: len(right)] = right
    both[size - len(right) + 1 :] = right[:0:-1]
    weight = rfft(both).real / size
    weight[1 : (size + 1) // 2] *= 2.0  # stand for the negative frequencies too
    F = rfft(S, size, axis=1)
    parts = np.concatenate([F.real, F.imag], axis=1)
    return (parts * np.concatenate([weight, weight])) @ parts.T


def tapered_autocorrelation(r: np.ndarray) -> np.ndarray:
    """Return the biased autocorrelation at lags 0, 1, ..., Bartlett's taper over a tenth of the
    record.
    """
    N = len(r)
    window = max(1, round(WINDOW * N))
    size = next_fast_len(N + window - 1, real=True)
    return irfft(np.abs(rfft(r, size)) ** 2, size)[:window] / N * (1.0 - np.arange(window) / window)
