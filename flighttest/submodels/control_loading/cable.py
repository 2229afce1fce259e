"""Cable, surface inertia and hinge friction from the stretch of the cable.

The end of the cable at the surface moves by

    s - a = p0 H + p1 a'' + p2 Sgn(a') + p3 a' - p4 (s' - a') + p5

with the hinge moment H as a force at the hand, the travel s of the cockpit end and the travel a of
the surface end.  The coefficients p are those of the equation of motion of the surface divided by
the stiffness of the cable (`simulation`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error import least_squares
from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.joint_fit import (
    JointFit,
    PriorConstraint,
    RecordEquations,
    estimates_convergence,
    joint_fit,
)
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.regression import SlidingFit
from flighttest.submodels.control_loading.windows import PreparedRecord

NAMES = (
    "cable_stiffness",
    "inertia",
    "hinge_friction",
    "hinge_damping",
    "cable_damping",
    "rigging",
)
# Passes: the fitted stretch of a pass is in the regressors of the next one.
_PASSES = 3
# Regressors of the stretch, in the order of its coefficients p.
_COLUMNS = ("hinge moment", "acceleration", "friction", "rate", "stretching", "constant")
_ACCELERATION, _RATE, _STRETCHING = 1, 3, 4


@dataclass(frozen=True)
class CableFit:
    """Fit of the stretch.

    Attributes
    ----------
    loading : ControlLoading
        Control circuit.
    estimates : Dataset (term, term_, error)
        ``cable_stiffness``, ``cable_damping`` reduced to the travel, ``inertia``,
        ``hinge_friction``, ``hinge_damping`` about the hinge, ``rigging`` (deflection at zero
        travel without load).  Attribute ``rms``: of the residual of the stretch. [m or rad]
    p : array (columns,)
        Coefficients of the stretch.
    slopes : array (NAMES, rows)
        Changes of the estimates by changes of the stretch.
    iterations : dict of str to Convergence
        End of the passes over weights and stretch.
    """

    loading: ControlLoading
    estimates: xr.Dataset
    p: np.ndarray
    slopes: np.ndarray
    iterations: Mapping[str, Convergence]

    def residual(self, stretches: Sequence[PreparedRecord], known: np.ndarray) -> np.ndarray:
        """Return the residual of the stretch in records, samples before windows.

        `known` are the coefficients of the hinge moment, (terms,).
        """
        in_use = np.ones(len(_COLUMNS), bool)
        residuals = []
        for record in stretches:
            rows = _stretch_rows(self.loading, record, known, p=self.p, in_use=in_use)
            residuals.append(rows.z - rows.X @ self.p)
        return np.concatenate(residuals)


def cable_fit(
    slid: SlidingFit,
    driven: Sequence[PreparedRecord],
    free: Sequence[PreparedRecord],
    cutoff: float,
    drawn: tuple[float, float, float] | None = None,
) -> CableFit:
    """Fit the stretch of the cable by least squares over the samples in which the control slides.

    Parameters
    ----------
    slid : SlidingFit
        Fit that provides the hinge moments, which are ten times as accurate. Their errors are
        propagated.
    driven, free, cutoff
        As in `sliding_fit`.
    drawn : (float, float, float), optional
        Inertia of the surface, reduced to the travel, and stiffness of the cable by the drawings,
        and the standard error of the inertia over its value. They give one further equation,
        inertia = drawn inertia, in coefficients of the stretch. [kg, N m-1, 1]

    Raises
    ------
    IdentificationError
        Too little motion, or a cable that does not stretch under load.
    """
    loading = slid.loading
    p, in_use, fit, iterations = _iterate_stretch(
        slid, driven, free=free, cutoff=cutoff, drawn=drawn
    )
    if not p[0] > 0.0:
        raise IdentificationError(
            f"{loading.item}: the cable does not stretch under load; use order 2, or check "
            f"the gearing {loading.gearing:g}"
        )
    values, G = _physical_constants(p, loading.gearing)
    slopes = G[:, in_use] @ fit.estimator[:, : fit.samples + fit.windows]
    # Changes of the estimates by an error of each coefficient of the hinge moment.
    forces = [record.rows(_force_by_term(loading, record)) for record in (*driven, *free)]
    by_terms = -p[0] * slopes @ np.concatenate(forces)
    indices = [loading.names.index(loading.term(term)) for term in loading.model.terms]
    covariance = G[:, in_use] @ fit.covariance @ G[:, in_use].T
    hinge_covariance = slid.estimates["covariance"].values[np.ix_(indices, indices)]
    covariance += by_terms @ hinge_covariance @ by_terms.T
    estimates = least_squares.regression_estimates(
        NAMES,
        values,
        covariance,
        white=np.full(len(NAMES), np.nan),
        systematic=([], np.zeros((len(NAMES), 0))),
        extra={},
    )
    rms = float(np.sqrt(np.mean(fit.residual[: fit.samples] ** 2)))
    return CableFit(
        loading, estimates.assign_attrs(rms=rms), p=p, slopes=slopes, iterations=iterations
    )


def _iterate_stretch(
    slid: SlidingFit,
    driven: Sequence[PreparedRecord],
    free: Sequence[PreparedRecord],
    cutoff: float,
    drawn: tuple[float, float, float] | None,
) -> tuple[np.ndarray, np.ndarray, JointFit, dict[str, Convergence]]:
    """Return the coefficients p, the columns in use, the last fit, and the end of the passes."""
    loading = slid.loading
    hinge = np.array([slid.value(loading.term(term))[0] for term in loading.model.terms])
    p = np.zeros(len(_COLUMNS))
    for _ in range(_PASSES):
        before = p
        # The rate of the stretch is a regressor as soon as there is a fitted stretch.
        in_use = np.ones(len(_COLUMNS), bool)
        in_use[_STRETCHING] = p.any()
        names = [name for name, use in zip(_COLUMNS, in_use) if use]
        slow, quick = [], []
        for record in driven:
            slow.append(_stretch_rows(loading, record, hinge, p=p, in_use=in_use))
        for record in free:
            quick.append(_stretch_rows(loading, record, hinge, p=p, in_use=in_use))
        constraints = [] if drawn is None else [_inertia_constraint(names, *drawn)]
        fit = joint_fit(slow, quick, names=names, cutoff=cutoff, constraints=constraints)
        p = np.zeros(len(_COLUMNS))
        p[in_use] = fit.theta
    stderr = np.sqrt(np.diag(fit.covariance))
    iterations = {
        "weights of the stretch": fit.convergence,
        "stretch of the cable": estimates_convergence(
            (p - before)[in_use], fit.theta, stderr=stderr, iterations=_PASSES
        ),
    }
    return p, in_use, fit, iterations


def _inertia_constraint(
    names: Sequence[str], inertia: float, stiffness: float, error: float
) -> PriorConstraint:
    """Return the equation p1 = inertia p0: J g^2 / K of the stretch, with 1 / K of the stretch."""
    row = np.zeros(len(names))
    row[names.index("acceleration")], row[names.index("hinge moment")] = 1.0, -inertia
    return PriorConstraint(row, 0.0, stderr=error * inertia / stiffness)


def _force_by_term(loading: ControlLoading, record: PreparedRecord) -> np.ndarray:
    """Return the force at the hand by every term of the hinge moment, (time, terms)."""
    return loading.load(record.moved)[:, None] * loading.model.design(record.moved)


def _stretch_rows(
    loading: ControlLoading,
    record: PreparedRecord,
    hinge: np.ndarray,
    p: np.ndarray,
    in_use: np.ndarray,
) -> RecordEquations:
    """Return the equations of the stretch of one record.

    The response is the difference of both travels.  The noise of their weighted mean does not
    correlate with that of the difference.  The motion of the surface end is therefore that of the
    mean, less its part of the stretch fitted before; the measured part would be noise.
    """
    quiet, loud = record.white
    # Share of the surface end in the mean.
    share = 0.5
    if quiet + loud > 0.0:
        share = quiet / (quiet + loud)
    moved = record.moved
    a = moved[loading.deflection].values / loading.gearing
    rate = (1.0 - share) * moved["rate"].values + share * moved["aft_rate"].values
    acceleration = (1.0 - share) * moved["acceleration"].values
    acceleration = acceleration + share * moved["aft_acceleration"].values
    signals = {
        "hinge moment": _force_by_term(loading, record) @ hinge,
        "acceleration": acceleration,
        "friction": moved["aft_direction"].values,
        "rate": rate,
        "stretching": np.zeros(len(a)),
        "constant": np.ones(len(a)),
    }
    columns = np.column_stack([signals[name] for name in _COLUMNS])
    X = record.rows(columns)
    noise = np.zeros(X.shape)
    # Derivatives of the stretch fitted before.
    stretch = columns @ p
    stretching = record.rows(stretch, 1)
    derivatives = ((1, _RATE, stretching), (2, _ACCELERATION, record.rows(stretch, 2)))
    for order, k, change in derivatives:
        X[:, k] = record.motion(loading, order, share) - (1.0 - share) * change
        noise[:, k] = record.motion_noise(order, share)
    X[:, _STRETCHING] = -stretching
    z = record.rows(moved["travel"].values - a)
    return record.equations(X[:, in_use], z, noise[:, in_use])


def _physical_constants(p: np.ndarray, gearing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the constants `NAMES` from the coefficients p, and their derivatives (NAMES, p)."""
    # K = 1 / p0; the others are a coefficient times K, reduced by a power of the gearing.
    K, g = 1.0 / p[0], abs(gearing)
    scale = np.array([0.0, 1.0 / g**2, 1.0 / g, 1.0 / g**2, 1.0, 0.0])
    values, G = scale * p * K, np.diag(scale * K)
    G[:, 0] -= scale * p * K**2
    values[0], G[0] = K, 0.0
    G[0, 0] = -(K**2)
    # The rigging is the constant as a deflection.
    values[5], G[5] = -gearing * p[5], 0.0
    G[5, 5] = -gearing
    return values, G
