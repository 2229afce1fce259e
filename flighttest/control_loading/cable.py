"""Cable, inertia and friction at the surface's end, by the stretch of the cable: inverse dynamics of the surface.

With the travel a = delta / gearing of the surface's end, [LR743] 4.5.3,

    K (s - a) + D (s' - a') = J g^2 a'' + w g^2 a' + r |g| sgn(a') - g H

The stretch is the small difference of two measured travels and carries their noise; everything on the right moves far more than its noise
and H is known from the force at the hand.  So the stretch is the response of a linear regression whose coefficients are those of the
surface over K, and K follows from that of the hinge moment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from .joint_fit import Rows, joint_fit, stretch_lengths
from .loading import ControlLoading
from .modulation import free_signals, modulated, modulation_noise
from .motion import CUTOFF, noise, pick_up_noise, signals, sliding, smoothed
from .regression import SlidingFit

NAMES = ("cable_stiffness", "inertia", "hinge_friction", "hinge_damping", "cable_damping", "rigging")
_PASSES = 3  # the fitted stretch of a pass is in the regressors of the next
_COLUMNS = ("hinge moment", "acceleration", "friction", "rate", "stretching", "constant")


def cable_fit(slid: SlidingFit, driven: Sequence[xr.Dataset], free: Sequence[xr.Dataset], cutoff: float = CUTOFF) -> xr.Dataset:
    """Fit the stretch of the cable by least squares over the samples in which the control slides.

    Parameters
    ----------
    slid : SlidingFit
        Its hinge moments are taken for known: they are ten times as accurate; their errors are carried on.
    driven, free, cutoff
        As in `sliding_fit`.

    Returns
    -------
    Dataset (term, term_, error)
        ``cable_stiffness``, ``cable_damping`` reduced to the travel, ``inertia``, ``hinge_friction``, ``hinge_damping`` about the hinge,
        ``rigging`` (deflection at zero travel without load).  Attribute ``rms``: of the residual of the stretch. [m or rad]

    Raises
    ------
    IdentificationError
        Too little motion, or a cable that does not stretch under load.
    """
    loading = slid.loading
    known = np.array([slid.value(loading.term(term))[0] for term in loading.model.terms])
    slow = [record for record in (_driven(loading, one, cutoff, known) for one in driven) if len(record.z)]
    quick = [record for record in (_free(loading, one, known) for one in free) if len(record.z)]
    p = np.zeros(len(_COLUMNS))
    for _ in range(_PASSES):
        moves = np.array([True, True, True, True, bool(p.any()), True])
        names = [name for name, use in zip(_COLUMNS, moves) if use]
        fit = joint_fit([one.rows(p, moves) for one in slow], [one.rows(p, moves) for one in quick], names, cutoff)
        p = np.zeros(len(_COLUMNS))
        p[moves] = fit.theta
    if not p[0] > 0.0:
        raise IdentificationError(
            f"{loading.item}: the cable does not stretch under load; use order 2, or check the gearing {loading.gearing:g}"
        )
    # what an error of the hinge moments would change
    slopes = np.zeros((len(_COLUMNS), len(known)))
    slopes[moves] = -p[0] * fit.estimator @ np.concatenate([record.terms for record in (*slow, *quick)])
    at = [slid.loading.names.index(loading.term(term)) for term in loading.model.terms]
    held = slid.estimates["covariance"].values[np.ix_(at, at)]
    covariance = slopes @ held @ slopes.T
    covariance[np.ix_(moves, moves)] += fit.covariance
    values, G = _physical(p, loading.gearing)
    found = least_squares.estimates(NAMES, values, G @ covariance @ G.T, np.full(len(NAMES), np.nan), ([], np.zeros((len(NAMES), 0))), {})
    return found.assign_attrs(rms=float(np.sqrt(np.mean(fit.residual**2))))


@dataclass(frozen=True)
class _Record:
    """Regressors of the stretch in time, and how they become rows.

    ``project(x, order)`` takes a signal, (time,) or (time, columns), to rows; ``noise`` is that of rate and acceleration.
    """

    columns: np.ndarray
    z: np.ndarray
    terms: np.ndarray
    share: float
    noise: tuple[np.ndarray | float, np.ndarray | float]
    lengths: tuple[int, ...]
    step: float
    own: np.ndarray  # rows of the travel's rate and acceleration
    project: Callable[[np.ndarray, int], np.ndarray]

    def rows(self, p: np.ndarray, moves: np.ndarray) -> Rows:
        """Equations at the surface's end, by the stretch fitted before: that of the measured one would be noise."""
        X = self.project(self.columns, 0)
        stretch = self.columns @ p
        rate, acceleration = self.project(stretch, 1), self.project(stretch, 2)
        noise = np.zeros(X.shape)
        for k, (name, change) in enumerate((("rate", rate), ("acceleration", acceleration))):
            X[:, _COLUMNS.index(name)] = self.own[:, k] - self.share * change
            noise[:, _COLUMNS.index(name)] = self.noise[k]
        X[:, _COLUMNS.index("stretching")] = -rate
        return Rows(X[:, moves], self.z, noise[:, moves], self.lengths, self.step)


def _driven(loading: ControlLoading, one: xr.Dataset, cutoff: float, known: np.ndarray) -> _Record:
    """Samples of a driven manoeuvre in which the control slides."""
    moved = signals(loading, one, cutoff)
    step = float(np.median(np.diff(moved["time"].values)))
    use = sliding(loading, one, moved, cutoff)

    def project(x: np.ndarray, order: int) -> np.ndarray:
        return x[use] if order == 0 else smoothed(x, step, np.inf)[order][use]

    quiet, loud = (np.array(x) ** 2 for x in pick_up_noise(loading, one, cutoff))
    columns, mean, terms, share = _stretch(loading, one, moved, known)
    own = np.column_stack([share * moved[x].values + (1.0 - share) * moved[f"aft_{x}"].values for x in ("rate", "acceleration")])
    noise = share**2 * quiet + (1.0 - share) ** 2 * loud
    return _Record(columns, mean[use], terms[use], share, (noise[0], noise[1]), stretch_lengths(use), step, own[use], project)


def _free(loading: ControlLoading, one: xr.Dataset, known: np.ndarray) -> _Record:
    """Windows of free motion."""
    moved, windows = free_signals(loading, one)
    columns, z, terms, share = _stretch(loading, one, moved, known)
    mean = share * moved["travel"].values + (1.0 - share) * moved[loading.deflection].values / loading.gearing
    own = np.column_stack([modulated(mean, windows, order) for order in (1, 2)])
    both = [modulation_noise(loading, one, windows, order) for order in (1, 2)]
    noise = [share**2 * quiet + (1.0 - share) ** 2 * loud for quiet, loud in both]
    step = float(np.median(np.diff(moved["time"].values)))

    def project(x: np.ndarray, order: int) -> np.ndarray:
        return modulated(x, windows, order)

    return _Record(columns, project(z, 0), project(terms, 0), share, (noise[0], noise[1]), (), step, own, project)


def _stretch(loading: ControlLoading, one: xr.Dataset, moved: xr.Dataset, known: np.ndarray):
    """Regressors that need no derivative, stretch, terms of the hinge moment, share of the cockpit's travel.

    Rates are those of a mean of both travels whose noise does not correlate with that of their difference, the response.
    """
    a = moved[loading.deflection].values / loading.gearing
    quiet = noise(one[loading.item].values) ** 2
    loud = (noise(one[loading.deflection].values) / loading.gearing) ** 2
    share = loud / (quiet + loud) if quiet + loud > 0.0 else 0.5
    terms = loading.load(moved)[:, None] * loading.model.design(moved)
    columns = np.zeros((len(a), len(_COLUMNS)))
    columns[:, _COLUMNS.index("hinge moment")] = terms @ known
    columns[:, _COLUMNS.index("acceleration")] = share * moved["acceleration"].values + (1.0 - share) * moved["aft_acceleration"].values
    columns[:, _COLUMNS.index("friction")] = moved["aft_direction"].values
    columns[:, _COLUMNS.index("rate")] = share * moved["rate"].values + (1.0 - share) * moved["aft_rate"].values
    columns[:, _COLUMNS.index("constant")] = 1.0
    return columns, moved["travel"].values - a, terms, share


def _physical(p: np.ndarray, gearing: float) -> tuple[np.ndarray, np.ndarray]:
    """Constants from the coefficients of the stretch, and their derivatives by these."""
    K, g = 1.0 / p[0], abs(gearing)
    scale = np.array([0.0, 1.0 / g**2, 1.0 / g, 1.0 / g**2, 1.0, 0.0])
    values, G = scale * p * K, np.diag(scale * K)
    G[:, 0] -= scale * p * K**2
    values[0], G[0] = K, 0.0
    G[0, 0] = -(K**2)
    values[5], G[5] = -gearing * p[5], 0.0
    G[5, 5] = -gearing
    return values, G
