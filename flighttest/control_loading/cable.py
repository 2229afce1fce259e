"""Cable, inertia and friction at the surface's end, by the stretch of the cable: inverse dynamics of the surface.

With the travel a = delta / gearing of the surface's end, [LR743] 4.5.3,

    K (s - a) + D (s' - a') = J g^2 a'' + w g^2 a' + r |g| sgn(a') - g H

The stretch is the small difference of two measured travels and carries their noise; everything on the right moves far more than its noise
and H is known from the force at the hand.  So the stretch is the response of a linear regression whose coefficients are those of the
surface over K, and K follows from that of the hinge moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from ..equation_error.joint_fit import Known, Rows, joint_fit
from .loading import ControlLoading
from .regression import SlidingFit
from .stretches import Stretch

NAMES = ("cable_stiffness", "inertia", "hinge_friction", "hinge_damping", "cable_damping", "rigging")
_PASSES = 3  # the fitted stretch of a pass is in the regressors of the next
_COLUMNS = ("hinge moment", "acceleration", "friction", "rate", "stretching", "constant")


@dataclass(frozen=True)
class CableFit:
    """Fit of the stretch.

    Attributes
    ----------
    loading : ControlLoading
    estimates : Dataset (term, term_, error)
        ``cable_stiffness``, ``cable_damping`` reduced to the travel, ``inertia``, ``hinge_friction``, ``hinge_damping`` about the hinge,
        ``rigging`` (deflection at zero travel without load).  Attribute ``rms``: of the residual of the stretch. [m or rad]
    p : array (columns,)
        Coefficients of the stretch.
    slopes : array (NAMES, rows)
        Changes of the estimates by those of the stretch.
    """

    loading: ControlLoading
    estimates: xr.Dataset
    p: np.ndarray
    slopes: np.ndarray

    def residual(self, stretches: Sequence[Stretch], known: np.ndarray) -> np.ndarray:
        """Return the residual of the stretch in records, samples before windows, with hinge moments `known`, (terms,)."""
        moves = np.ones(len(_COLUMNS), bool)
        parts = [_rows(self.loading, one, known, self.p, moves) for one in stretches]
        return np.concatenate([part.z - part.X @ self.p for part in parts])


def cable_fit(
    slid: SlidingFit,
    driven: Sequence[Stretch],
    free: Sequence[Stretch],
    cutoff: float,
    drawn: tuple[float, float, float] | None = None,
) -> CableFit:
    """Fit the stretch of the cable by least squares over the samples in which the control slides.

    Parameters
    ----------
    slid : SlidingFit
        Its hinge moments are taken for known: they are ten times as accurate; their errors are carried on.
    driven, free, cutoff
        As in `sliding_fit`.
    drawn : (float, float, float), optional
        Inertia of the surface, reduced to the travel, and stiffness of the cable by the drawings, and the standard error of the inertia
        over its value: one equation more, inertia = drawn inertia, in coefficients of the stretch. [kg, N m-1, 1]

    Raises
    ------
    IdentificationError
        Too little motion, or a cable that does not stretch under load.
    """
    loading = slid.loading
    known = np.array([slid.value(loading.term(term))[0] for term in loading.model.terms])
    p = np.zeros(len(_COLUMNS))
    for _ in range(_PASSES):
        moves = np.array([True, True, True, True, bool(p.any()), True])
        names = [name for name, use in zip(_COLUMNS, moves) if use]
        slow, quick = ([_rows(loading, one, known, p, moves) for one in group] for group in (driven, free))
        fit = joint_fit(slow, quick, names, cutoff, [] if drawn is None else [_known_inertia(names, *drawn)])
        p = np.zeros(len(_COLUMNS))
        p[moves] = fit.theta
    if not p[0] > 0.0:
        raise IdentificationError(
            f"{loading.item}: the cable does not stretch under load; use order 2, or check the gearing {loading.gearing:g}"
        )
    values, G = _physical(p, loading.gearing)
    slopes = G[:, moves] @ fit.estimator[:, : fit.samples + fit.windows]
    # what an error of the hinge moments would change
    by_terms = -p[0] * slopes @ np.concatenate([one.rows(_terms(loading, one)) for one in (*driven, *free)])
    at = [slid.loading.names.index(loading.term(term)) for term in loading.model.terms]
    covariance = G[:, moves] @ fit.covariance @ G[:, moves].T
    covariance += by_terms @ slid.estimates["covariance"].values[np.ix_(at, at)] @ by_terms.T
    found = least_squares.estimates(NAMES, values, covariance, np.full(len(NAMES), np.nan), ([], np.zeros((len(NAMES), 0))), {})
    return CableFit(loading, found.assign_attrs(rms=float(np.sqrt(np.mean(fit.residual[: fit.samples] ** 2)))), p, slopes)


def _known_inertia(names: Sequence[str], inertia: float, stiffness: float, error: float) -> Known:
    """J g^2 / K of the stretch is that of the drawings times 1 / K of the stretch."""
    row = np.zeros(len(names))
    row[names.index("acceleration")], row[names.index("hinge moment")] = 1.0, -inertia
    return Known(row, 0.0, error * inertia / stiffness)


def _terms(loading: ControlLoading, one: Stretch) -> np.ndarray:
    """Force at the hand by every term of the hinge moment, (time, terms)."""
    return loading.load(one.moved)[:, None] * loading.model.design(one.moved)


def _rows(loading: ControlLoading, one: Stretch, known: np.ndarray, p: np.ndarray, moves: np.ndarray) -> Rows:
    """Equations at the surface's end.

    Its motion is that of a mean of both travels whose noise does not correlate with that of their difference, the response, less its part
    of the stretch fitted before: the measured one would be noise.
    """
    quiet, loud = one.white
    share = quiet / (quiet + loud) if quiet + loud > 0.0 else 0.5  # of the surface's end in the mean
    a = one.moved[loading.deflection].values / loading.gearing
    signals = {
        "hinge moment": _terms(loading, one) @ known,
        "acceleration": (1.0 - share) * one.moved["acceleration"].values + share * one.moved["aft_acceleration"].values,
        "friction": one.moved["aft_direction"].values,
        "rate": (1.0 - share) * one.moved["rate"].values + share * one.moved["aft_rate"].values,
        "stretching": np.zeros(len(a)),
        "constant": np.ones(len(a)),
    }
    columns = np.column_stack([signals[name] for name in _COLUMNS])
    X = one.rows(columns)
    noise = np.zeros(X.shape)
    stretch = columns @ p
    stretching = one.rows(stretch, 1)
    for order, name, change in ((1, "rate", stretching), (2, "acceleration", one.rows(stretch, 2))):
        at = _COLUMNS.index(name)
        X[:, at] = one.motion(loading, order, share) - (1.0 - share) * change
        noise[:, at] = one.motion_noise(order, share)
    X[:, _COLUMNS.index("stretching")] = -stretching
    return one.equations(X[:, moves], one.rows(one.moved["travel"].values - a), noise[:, moves])


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
