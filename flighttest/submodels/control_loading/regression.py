"""Constants and hinge moments from the force at the hand.

`sliding_fit` uses manoeuvres in which the control slides, `trim_forces` steady points at which it
is at rest.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.problem import SAMPLES_PER_TERM
from flighttest.regression.uncertainty import collinearity
from flighttest.remarks import TabledEstimates
from flighttest.submodels.control_loading.joint_fit import (
    JointFit,
    PriorConstraint,
    joint_fit,
)
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.windows import PreparedRecord, force_rows

# Correlation inside every manoeuvre above which only the differences between manoeuvres separate
# two terms.
_ALIKE = 0.98
# Smallest number of samples for a correlation.
_FEWEST = 3
# Two-sided confidence of 95 %, and one-sided one of 97.5 % of a limit.
_QUANTILE, _LOWER_QUANTILE = 0.975, 0.025
# Steady points beyond the number of terms.
_SPARE = 2


@dataclass(frozen=True)
class SlidingFit:
    """Estimates from the force at the hand while the control slides.

    Attributes
    ----------
    loading : ControlLoading
        Control circuit.
    estimates : Dataset (term, term_, error)
        Names of `ControlLoading.names`: ``estimate``, ``stderr`` (coloured residuals),
        ``stderr_white``, ``covariance``, ``correlation``; ``friction``, ``damping`` and ``mass``
        are those of both ends of the cable together, reduced to the travel. Attributes
        ``residual_rms`` [N or N m], ``R2``, ``samples``, ``manoeuvres``.
    alike : list of (str, str)
        Terms that are collinear inside every manoeuvre. Their separation depends on differences
        between the manoeuvres.
    """

    loading: ControlLoading
    estimates: xr.Dataset
    alike: list[tuple[str, str]]

    def value(self, name: str) -> tuple[float, float]:
        """Return an estimate and its standard error."""
        row = self.estimates.sel(term=name)
        return float(row["estimate"]), float(row["stderr"])


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
        Control circuit.
    driven, free : sequence of PreparedRecord
        Driven manoeuvres at several speeds and tab settings; pulses and releases.
    cutoff : float
        Cut-off frequency of the low-pass of the driven manoeuvres. [Hz]
    aft : mapping of str to float, optional
        Share of the surface in ``friction``, ``damping`` and ``mass`` of both ends. The surface end
        of the cable reverses at other times than the cockpit end and has another acceleration. [1]
    known : mapping of str to (float, float), optional
        Values and standard errors from another source, such as the mass of both ends.

    Returns
    -------
    SlidingFit
        Estimates.
    JointFit
        Dependence of the estimates on the records.

    Raises
    ------
    IdentificationError
        Too few samples, or terms that the manoeuvres cannot distinguish.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.3.
    """
    shares = aft or {}
    slow = [force_rows(loading, record, shares) for record in driven]
    quick = [force_rows(loading, record, shares) for record in free]
    needed = SAMPLES_PER_TERM * len(loading.names)
    count = sum(len(record.z) for record in slow)
    if count < needed:
        raise IdentificationError(
            f"{loading.item}: {count} samples in which the control slides; at least {needed} "
            f"are needed"
        )
    constraints = []
    for name, (value, stderr) in (known or {}).items():
        if name in loading.names:
            row = np.array([float(term == name) for term in loading.names])
            constraints.append(PriorConstraint(row, value, stderr))
    fit = joint_fit(slow, quick, names=loading.names, cutoff=cutoff, constraints=constraints)
    is_constant = np.array([name == "offset" for name in loading.names])
    collinearity.demand_independence(fit.X, is_constant, loading.names)
    z = np.concatenate([record.z for record in slow])
    v = fit.residual[: fit.samples]
    estimates = least_squares.regression_estimates(
        loading.names,
        fit.theta,
        fit.covariance,
        white=np.sqrt(np.diag(np.linalg.inv(fit.X.T @ fit.X))),
        systematic=([], np.zeros((len(loading.names), 0))),
        extra=least_squares.regressor_diagnostics(fit.X, is_constant),
    )
    estimates.attrs = {
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z),
        "windows": fit.windows,
        "manoeuvres": len(slow),
    }
    alike = _find_collinear_pairs(loading, [record.X for record in slow])
    return SlidingFit(loading, estimates, alike), fit


def _find_collinear_pairs(
    loading: ControlLoading, regressors: Sequence[np.ndarray]
) -> list[tuple[str, str]]:
    """Return pairs of bob weight or spring and a hinge moment, collinear in every manoeuvre.

    `regressors` are those of the manoeuvres, (samples, terms).
    """
    names = loading.names
    pairs: list[tuple[str, str]] = []
    for name in ("bob_weight", "stiffness"):
        if name not in names:
            continue
        j = names.index(name)
        for k in range(len(loading.constants), len(names)):
            if _least_correlation(regressors, j, k) > _ALIKE:
                pairs.append((name, names[k]))
    return pairs


def _least_correlation(regressors: Sequence[np.ndarray], j: int, k: int) -> float:
    """Return the smallest correlation of two columns over the manoeuvres in which both move."""
    correlations = []
    for X in regressors:
        if len(X) >= _FEWEST and np.ptp(X[:, j]) > 0.0 and np.ptp(X[:, k]) > 0.0:
            correlations.append(abs(np.corrcoef(X[:, j], X[:, k])[0, 1]))
    return min(correlations, default=0.0)


@dataclass(frozen=True)
class TrimForces(ShortText, TabledEstimates):
    """Forces that hold a control at rest, fitted over steady points.

    Attributes
    ----------
    loading : ControlLoading
        Control circuit.
    estimates : Dataset (term, term_, error)
        ``offset`` and terms of the hinge moment; attributes ``rms`` [N or N m], ``points``,
        ``friction_limit`` [N or N m]: friction of both ends is smaller with 97.5 % confidence.
    """

    loading: ControlLoading
    estimates: xr.Dataset

    def determined(self) -> dict[str, bool]:
        """Return whether every estimate differs from zero with 95 % confidence."""
        e = self.estimates
        limit = float(scipy.stats.t.ppf(_QUANTILE, e.attrs["points"] - e.sizes["term"]))
        is_determined = {}
        for name, row in e.groupby("term"):
            is_determined[str(name)] = bool(abs(row["estimate"]) > limit * row["stderr"])
        return is_determined

    def report(self) -> str:
        """Return the estimates as a text table.

        A term that the points do not show is called not determined.
        """
        e, is_determined = self.estimates, self.determined()
        lines = [
            f"{self.loading.item}: {self.loading.model}, {e.attrs['points']} steady "
            f"points, rms {e.attrs['rms']:.3g}"
        ]
        for name in map(str, e["term"].values):
            row = e.sel(term=name)
            text = f"{float(row['estimate']):>12.5g}{float(row['stderr']):>10.2g}"
            note = "" if is_determined[name] else "  not determined"
            lines.append(f"{name:<18}{text}{note}")
        limit = f"{'not determined; below':>22} {e.attrs['friction_limit']:.3g}"
        return "\n".join([*lines, f"{'friction':<18}{limit}"])


def trim_forces(loading: ControlLoading, points: xr.Dataset) -> TrimForces:
    """Fit the force at the hand over steady points, at which the control is at rest.

    Parameters
    ----------
    loading : ControlLoading
        Geometry and terms of the hinge moment. Its other constants are not used.  If the geometry
        is not known, area, chord and gearing 1, 1 and -1 give the product of all four.
    points : Dataset (point,)
        ``F_column`` (wheel, pedal), ``qbar`` and the variables of the hinge moment, one value per
        point. [SI]

    Raises
    ------
    UnknownName
        A variable that the points do not contain.
    IdentificationError
        Fewer points than terms and two, or terms that the points cannot distinguish.

    Notes
    -----
    At rest, friction takes any value inside its band and cannot be estimated.  A uniform
    distribution over the band of half width R has an rms of R / 3^0.5; the residuals therefore
    limit R.  Points at one loading and one tab setting vary angle of attack and deflection
    together.  A displaced c.g. separates the two.
    """
    force = f"F_{loading.item}"
    for name in (force, "qbar", *loading.model.variables):
        if name not in points:
            raise UnknownName(
                name, map(str, points.data_vars), "channel", "every steady point needs it"
            )
    names = ["offset", *(loading.term(term) for term in loading.model.terms)]
    by_term = loading.load(points)[:, None] * loading.model.design(points)
    X = np.column_stack([np.ones(points["qbar"].size), by_term])
    spare = len(X) - len(names)
    if spare < _SPARE:
        raise IdentificationError(
            f"{loading.item}: {len(X)} steady points; at least {len(names) + _SPARE} are needed "
            f"for {len(names)} terms"
        )
    collinearity.demand_rank(X, names)
    F = points[force].values
    theta, _ = least_squares.solve_least_squares(X, F)
    v = F - X @ theta
    covariance = float(v @ v) / spare * np.linalg.inv(X.T @ X)
    estimates = least_squares.regression_estimates(
        names,
        theta,
        covariance,
        white=np.sqrt(np.diag(covariance)),
        systematic=([], np.zeros((len(names), 0))),
        extra={},
    )
    # Upper limit of the standard deviation by the chi-square of the residuals; R = 3^0.5 rms.
    limit = float(np.sqrt(3.0 * (v @ v) / scipy.stats.chi2.ppf(_LOWER_QUANTILE, spare)))
    estimates = estimates.assign_attrs(
        rms=float(np.sqrt(v @ v / spare)), points=len(X), friction_limit=limit
    )
    return TrimForces(loading, estimates)
