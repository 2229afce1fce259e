"""Cable, inertia and friction at the surface's end, by the stretch of the cable: inverse dynamics of the surface.

With the travel a = delta / gearing of the surface's end, [LR743] 4.5.3,

    K (s - a) + D (s' - a') = J g^2 a'' + w g^2 a' + r |g| sgn(a') - g H

The stretch is the small difference of two measured travels and carries their noise; everything on the right moves far more than its noise
and H is known from the force at the hand.  So the stretch is the response of a linear regression whose coefficients are those of the
surface over K, and K follows from that of the hinge moment.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from ..uncertainty import collinearity
from ..uncertainty.coloured_residuals import coloured
from .loading import ControlLoading
from .motion import CUTOFF, FREE_CUTOFF, noise, rates, signals, sliding
from .regression import SlidingFit, stretches

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
    records = [_record(loading, one, band, known) for band, group in ((cutoff, driven), (FREE_CUTOFF, free)) for one in group]
    records = [record for record in records if record[1].any()]
    p = np.zeros(len(_COLUMNS))
    for _ in range(_PASSES):
        parts = [(time, use, _with_stretch(X, p, time, share), z) for time, use, X, z, _, share in records]
        X, z = (np.concatenate([part[k][part[1]] for part in parts]) for k in (2, 3))
        moves = np.array([True, True, True, True, bool(p.any()), True])
        collinearity.demand_rank(X[:, moves], [name for name, use in zip(_COLUMNS, moves) if use])
        p = np.zeros(len(_COLUMNS))
        p[moves] = least_squares.solve(X[:, moves], z)[0]
    if not p[0] > 0.0:
        raise IdentificationError(
            f"{loading.item}: the cable does not stretch under load; use order 2, or check the gearing {loading.gearing:g}"
        )
    v = z - X @ p
    # what an error of the hinge moments would change
    slopes = -p[0] * least_squares.estimator(X) @ np.concatenate([terms[use] for _, use, _, _, terms, _ in records])
    at = [slid.loading.names.index(loading.term(term)) for term in loading.model.terms]
    held = slid.estimates["covariance"].values[np.ix_(at, at)]
    covariance = coloured(X, v, *stretches(parts)).covariance + slopes @ held @ slopes.T
    values, G = _physical(p, loading.gearing)
    found = least_squares.estimates(NAMES, values, G @ covariance @ G.T, np.full(len(NAMES), np.nan), ([], np.zeros((len(NAMES), 0))), {})
    return found.assign_attrs(rms=float(np.sqrt(v @ v / len(v))))


def _record(loading: ControlLoading, one: xr.Dataset, band: float, known: np.ndarray):
    """Time, samples that slide, regressors without stretch, stretch, terms of the hinge moment, share of the cockpit's travel.

    Rates are those of a mean of both travels whose noise does not correlate with that of their difference, the response.
    """
    moved = signals(loading, one, band)
    step = float(np.median(np.diff(moved["time"].values)))
    s, a = moved["travel"].values, moved[loading.deflection].values / loading.gearing
    quiet = noise(one[loading.item].values) ** 2
    loud = (noise(one[loading.deflection].values) / loading.gearing) ** 2
    share = loud / (quiet + loud) if quiet + loud > 0.0 else 0.5
    rate, acceleration = rates(share * s + (1.0 - share) * a, step)
    terms = loading.load(moved)[:, None] * loading.model.design(moved)
    columns = (terms @ known, acceleration, moved["direction"].values, rate, np.zeros_like(a), np.ones_like(a))
    return moved["time"].values, sliding(loading, one, moved, band), np.column_stack(columns), s - a, terms, share


def _with_stretch(X: np.ndarray, p: np.ndarray, time: np.ndarray, share: float) -> np.ndarray:
    """Regressors at the surface's end, by the fitted stretch: that of the measured one would be noise."""
    found = X.copy()
    rate, acceleration = rates(X @ p, float(np.median(np.diff(time))))
    found[:, _COLUMNS.index("rate")] -= share * rate
    found[:, _COLUMNS.index("acceleration")] -= share * acceleration
    found[:, _COLUMNS.index("stretching")] = -rate
    return found


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
