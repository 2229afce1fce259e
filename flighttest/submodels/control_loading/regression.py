"""Friction, preload, unbalance and hinge moments from the force at the hand while the control
slides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.stats import chi2, t

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.time_domain import SAMPLES_PER_TERM
from flighttest.regression.uncertainty import collinearity
from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.joint_fit import (
    JointFit,
    PriorConstraint,
    RecordEquations,
    estimates_convergence,
    joint_fit,
)
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.windows import PreparedRecord, force_rows

# correlation inside every manoeuvre from which on only the differences between manoeuvres separate
# two terms
_ALIKE = 0.98


@dataclass(frozen=True)
class SlidingFit:
    """Estimates of the force at the hand while the control slides.

    Attributes
    ----------
    loading : ControlLoading
    estimates : Dataset (term, term_, error)
        Names of `ControlLoading.names`: ``estimate``, ``stderr`` (coloured residuals),
        ``stderr_white``, ``covariance``, ``correlation``; ``friction``, ``damping`` and ``mass``
        are those of both ends of the cable together, reduced to the travel. Attributes
        ``residual_rms`` [N or N m], ``R2``, ``samples``, ``manoeuvres``.
    alike : list of (str, str)
        Terms that go together inside every manoeuvre: their separation depends on differences
        between the manoeuvres.
    """

    loading: ControlLoading
    estimates: xr.Dataset
    alike: list[tuple[str, str]]

    def value(self, name: str) -> tuple[float, float]:
        """Return an estimate and its standard error."""
        one = self.estimates.sel(term=name)
        return float(one["estimate"]), float(one["stderr"])


def sliding_fit(
    loading: ControlLoading,
    driven: Sequence[PreparedRecord],
    free: Sequence[PreparedRecord],
    cutoff: float,
    aft: Mapping[str, float] | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[SlidingFit, JointFit]:
    """Fit the force at the hand by least squares over the samples in which the control slides.

    Parameters
    ----------
    loading : ControlLoading
    driven, free : sequence of Stretch
        Of several speeds and tab settings; pulses and releases.
    cutoff : float
        Low-pass of the driven manoeuvres. [Hz]
    aft : mapping of str to float, optional
        Share of the surface in ``friction``, ``damping`` and ``mass`` of both ends: its end of the
        cable reverses at other moments and is accelerated otherwise than the cockpit's. [1]
    known : mapping of str to (float, float), optional
        Values and standard errors from elsewhere, such as the mass of both ends.

    Returns
    -------
    SlidingFit
    JointFit
        How the estimates follow from the records.

    Raises
    ------
    IdentificationError
        Too few samples, or terms that the manoeuvres cannot distinguish.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.3.
    """
    slow, quick = (
        [force_rows(loading, one, aft or {}) for one in group] for group in (driven, free)
    )
    need = SAMPLES_PER_TERM * len(loading.names)
    count = sum(len(part.z) for part in slow)
    if count < need:
        raise IdentificationError(
            f"{loading.item}: {count} samples in which the control slides; at least {need} "
            f"are needed"
        )
    held = [
        PriorConstraint(np.array([float(n == name) for n in loading.names]), *pair)
        for name, pair in (known or {}).items()
        if name in loading.names
    ]
    found = joint_fit(slow, quick, loading.names, cutoff, held)
    fixed = np.array([name == "offset" for name in loading.names])
    collinearity.demand_independence(found.X, fixed, loading.names)
    z, v, none = (
        np.concatenate([part.z for part in slow]),
        found.residual[: found.samples],
        np.zeros((len(loading.names), 0)),
    )
    white = np.sqrt(np.diag(np.linalg.inv(found.X.T @ found.X)))
    more = least_squares.regressor_diagnostics(found.X, fixed)
    estimates = least_squares.regression_estimates(
        loading.names, found.theta, found.covariance, white, ([], none), more
    )
    estimates.attrs = {
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()), "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z), "windows": found.windows, "manoeuvres": len(slow),
    }  # fmt: skip
    return SlidingFit(loading, estimates, _alike(loading, [part.X for part in slow])), found


def _alike(loading: ControlLoading, parts: Sequence[np.ndarray]) -> list[tuple[str, str]]:
    """Pairs of bob weight or spring with a hinge moment whose regressors go together inside every
    manoeuvre.
    """
    names = loading.names
    found: list[tuple[str, str]] = []
    for name in ("bob_weight", "stiffness"):
        if name not in names:
            continue
        j = names.index(name)
        for k in range(len(loading.constants), len(names)):
            moving = [
                X for X in parts if len(X) > 2 and np.ptp(X[:, j]) > 0.0 and np.ptp(X[:, k]) > 0.0
            ]
            if moving and min(abs(np.corrcoef(X[:, j], X[:, k])[0, 1]) for X in moving) > _ALIKE:
                found.append((name, names[k]))
    return found


@dataclass(frozen=True)
class TrimForces:
    """Forces that hold a control at rest, fitted over steady points.

    Attributes
    ----------
    loading : ControlLoading
    estimates : Dataset (term, term_, error)
        ``offset`` and terms of the hinge moment; attributes ``rms`` [N or N m], ``points``,
        ``friction_limit`` [N or N m]: friction of both ends is smaller with 97.5 % confidence.
    """

    loading: ControlLoading
    estimates: xr.Dataset

    def determined(self) -> dict[str, bool]:
        """Return whether every estimate differs from zero with 95 % confidence."""

        found = self.estimates
        limit = float(t.ppf(0.975, found.attrs["points"] - found.sizes["term"]))
        return {
            str(name): bool(abs(one["estimate"]) > limit * one["stderr"])
            for name, one in found.groupby("term")
        }

    def report(self) -> str:
        """Return the estimates as a text table; what the points do not show is called not
        determined.
        """
        found, seen = self.estimates, self.determined()
        lines = [
            f"{self.loading.item}: {self.loading.model}, {found.attrs['points']} steady "
            f"points, rms {found.attrs['rms']:.3g}"
        ]
        for name in map(str, found["term"].values):
            one = found.sel(term=name)
            text = f"{float(one['estimate']):>12.5g}{float(one['stderr']):>10.2g}"
            lines.append(f"{name:<18}{text}{'' if seen[name] else '  not determined'}")
        lines.append(
            f"{'friction':<18}{'not determined; below':>22} {found.attrs['friction_limit']:.3g}"
        )
        return "\n".join(lines)


def trim_forces(loading: ControlLoading, points: xr.Dataset) -> TrimForces:
    """Fit the force at the hand over steady points, at which the control is at rest.

    Parameters
    ----------
    loading : ControlLoading
        Geometry and terms of the hinge moment; its other constants are not used.  Where the
        geometry is not known, area, chord and gearing 1, 1 and -1 give the product of all four.
    points : Dataset (point,)
        ``F_column`` (wheel, pedal), ``qbar`` and the variables of the hinge moment, one value per
        point. [SI]

    Raises
    ------
    UnknownName
        A variable that the points do not hold.
    IdentificationError
        Fewer points than terms and two, or terms that the points cannot distinguish.

    Notes
    -----
    At rest friction takes any value inside its band, so that it cannot be estimated; uniform over the band of half width R its rms is
    R / 3^0.5, and the residuals limit R.  Points at one loading and one tab setting vary angle of attack and deflection together; a
    displaced c.g. separates the two.
    """

    wanted = [f"F_{loading.item}", "qbar", *loading.model.variables]
    for name in wanted:
        if name not in points:
            raise UnknownName(
                name, map(str, points.data_vars), "channel", "every steady point needs it"
            )
    names = ["offset", *(loading.term(term) for term in loading.model.terms)]
    X = np.column_stack(
        [np.ones(points["qbar"].size), loading.load(points)[:, None] * loading.model.design(points)]
    )
    spare = len(X) - len(names)
    if spare < 2:
        raise IdentificationError(
            f"{loading.item}: {len(X)} steady points; at least {len(names) + 2} are needed "
            f"for {len(names)} terms"
        )
    collinearity.demand_rank(X, names)
    F = points[f"F_{loading.item}"].values
    theta, _ = least_squares.solve_least_squares(X, F)
    v = F - X @ theta
    covariance = float(v @ v) / spare * np.linalg.inv(X.T @ X)
    stderr = np.sqrt(np.diag(covariance))
    found = least_squares.regression_estimates(
        names, theta, covariance, stderr, ([], np.zeros((len(names), 0))), {}
    )
    limit = float(np.sqrt(3.0 * (v @ v) / chi2.ppf(0.025, spare)))
    return TrimForces(
        loading,
        found.assign_attrs(rms=float(np.sqrt(v @ v / spare)), points=len(X), friction_limit=limit),
    )


NAMES = (
    "cable_stiffness",
    "inertia",
    "hinge_friction",
    "hinge_damping",
    "cable_damping",
    "rigging",
)
_PASSES = 3  # the fitted stretch of a pass is in the regressors of the next
_COLUMNS = ("hinge moment", "acceleration", "friction", "rate", "stretching", "constant")


@dataclass(frozen=True)
class CableFit:
    """Fit of the stretch.

    Attributes
    ----------
    loading : ControlLoading
    estimates : Dataset (term, term_, error)
        ``cable_stiffness``, ``cable_damping`` reduced to the travel, ``inertia``,
        ``hinge_friction``, ``hinge_damping`` about the hinge, ``rigging`` (deflection at zero
        travel without load).  Attribute ``rms``: of the residual of the stretch. [m or rad]
    p : array (columns,)
        Coefficients of the stretch.
    slopes : array (NAMES, rows)
        Changes of the estimates by those of the stretch.
    iterations : dict of str to Convergence
        End of the passes over weights and stretch.
    """

    loading: ControlLoading
    estimates: xr.Dataset
    p: np.ndarray
    slopes: np.ndarray
    iterations: Mapping[str, Convergence]

    def residual(self, stretches: Sequence[PreparedRecord], known: np.ndarray) -> np.ndarray:
        """Return the residual of the stretch in records, samples before windows, with hinge moments
        `known`, (terms,).
        """
        moves = np.ones(len(_COLUMNS), bool)
        parts = [_rows(self.loading, one, known, self.p, moves) for one in stretches]
        return np.concatenate([part.z - part.X @ self.p for part in parts])


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
        Its hinge moments are taken for known: they are ten times as accurate; their errors are
        carried on.
    driven, free, cutoff
        As in `sliding_fit`.
    drawn : (float, float, float), optional
        Inertia of the surface, reduced to the travel, and stiffness of the cable by the drawings,
        and the standard error of the inertia over its value: one equation more, inertia = drawn
        inertia, in coefficients of the stretch. [kg, N m-1, 1]

    Raises
    ------
    IdentificationError
        Too little motion, or a cable that does not stretch under load.
    """
    loading = slid.loading
    known = np.array([slid.value(loading.term(term))[0] for term in loading.model.terms])
    p = np.zeros(len(_COLUMNS))
    for _ in range(_PASSES):
        before = p
        moves = np.array([True, True, True, True, bool(p.any()), True])
        names = [name for name, use in zip(_COLUMNS, moves) if use]
        slow, quick = (
            [_rows(loading, one, known, p, moves) for one in group] for group in (driven, free)
        )
        fit = joint_fit(
            slow, quick, names, cutoff, [] if drawn is None else [_known_inertia(names, *drawn)]
        )
        p = np.zeros(len(_COLUMNS))
        p[moves] = fit.theta
    stderr = np.sqrt(np.diag(fit.covariance))
    iterations = {
        "weights of the stretch": fit.convergence,
        "stretch of the cable": estimates_convergence(
            (p - before)[moves], fit.theta, stderr=stderr, iterations=_PASSES
        ),
    }
    if not p[0] > 0.0:
        raise IdentificationError(
            f"{loading.item}: the cable does not stretch under load; use order 2, or check "
            f"the gearing {loading.gearing:g}"
        )
    values, G = _physical(p, loading.gearing)
    slopes = G[:, moves] @ fit.estimator[:, : fit.samples + fit.windows]
    # what an error of the hinge moments would change
    by_terms = (
        -p[0]
        * slopes
        @ np.concatenate([one.rows(_terms(loading, one)) for one in (*driven, *free)])
    )
    at = [slid.loading.names.index(loading.term(term)) for term in loading.model.terms]
    covariance = G[:, moves] @ fit.covariance @ G[:, moves].T
    covariance += by_terms @ slid.estimates["covariance"].values[np.ix_(at, at)] @ by_terms.T
    found = least_squares.regression_estimates(
        NAMES, values, covariance, np.full(len(NAMES), np.nan), ([], np.zeros((len(NAMES), 0))), {}
    )
    return CableFit(
        loading,
        found.assign_attrs(rms=float(np.sqrt(np.mean(fit.residual[: fit.samples] ** 2)))),
        p,
        slopes,
        iterations,
    )


def _known_inertia(
    names: Sequence[str], inertia: float, stiffness: float, error: float
) -> PriorConstraint:
    """J g^2 / K of the stretch is that of the drawings times 1 / K of the stretch."""
    row = np.zeros(len(names))
    row[names.index("acceleration")], row[names.index("hinge moment")] = 1.0, -inertia
    return PriorConstraint(row, 0.0, error * inertia / stiffness)


def _terms(loading: ControlLoading, one: PreparedRecord) -> np.ndarray:
    """Force at the hand by every term of the hinge moment, (time, terms)."""
    return loading.load(one.moved)[:, None] * loading.model.design(one.moved)


def _rows(
    loading: ControlLoading,
    one: PreparedRecord,
    known: np.ndarray,
    p: np.ndarray,
    moves: np.ndarray,
) -> RecordEquations:
    """Equations at the surface's end.

    Its motion is that of a mean of both travels whose noise does not correlate with that of their
    difference, the response, less its part of the stretch fitted before: the measured one would be
    noise.
    """
    quiet, loud = one.white
    share = (
        quiet / (quiet + loud) if quiet + loud > 0.0 else 0.5
    )  # of the surface's end in the mean
    a = one.moved[loading.deflection].values / loading.gearing
    signals = {
        "hinge moment": _terms(loading, one) @ known,
        "acceleration": (1.0 - share) * one.moved["acceleration"].values
        + share * one.moved["aft_acceleration"].values,
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
