"""Correction of the static thrust of an a-priori deck from flight.

The measurements are recorded thrust, or longitudinal equilibrium with a polar.  Corrected thrust
over corrected speed and Mach number keeps its breakpoints.  One factor r multiplies all nodes of a
corrected speed.  A recorded net thrust T, and the equilibrium along the flight path of an aeroplane
with N engines,

    T = delta sum_k r_k P_k(n / sqrt(theta), M)
    m V' + m g h' / V = N cos(alpha + i_T) T - qbar S (CD0 + K CL^2)

are linear in r, CD0 and K.  They are solved together by weighted least squares with a-priori values
[Theil1961].

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 6.
.. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int. Econ.
   Rev. 2, 1961.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flightmech.terms import SOURCE_ATTRS, SOURCES
from flighttest.remarks import Convergence, Remark, remark_lines
from flighttest.submodels.engine.steady_points import (
    equilibrium_rows,
    prior_thrust_shares,
    recorded_rows,
    speed_axis,
)

# A-priori standard error of a factor if the deck states none.
VAGUE = 0.1
# Largest number of passes over the noise.
PASSES = 20
# Absolute and relative change of the noise of a block at which it has converged.
_SAME_ABSOLUTE, _SAME_RELATIVE = 1e-8, 1e-6
# Remaining part of the a-priori standard error of the thrust up to which thrust and drag are
# separable.
SEPARATE = 0.3
# Remaining part of the a-priori standard error of the polar up to which the polar is determined.
DISTINCT = 0.5


@dataclass(frozen=True)
class Polar:
    """Drag polar CD = CD0 + K CL^2 with standard errors; zero for a fixed value."""

    CD0: float
    K: float
    CD0_stderr: float = 0.0
    K_stderr: float = 0.0

    def demand_possible(self) -> None:
        """Refuse a polar that no aeroplane has; estimates may leave these ranges.

        Raises
        ------
        IdentificationError
            CD0 outside of 0 to 1, K outside of 0 to 2, or a standard error outside of 0 to 1.
        """
        is_polar = 0.0 < self.CD0 < 1.0 and 0.0 <= self.K < 2.0
        if not is_polar or not (0.0 <= self.CD0_stderr < 1.0 and 0.0 <= self.K_stderr < 1.0):
            raise IdentificationError(
                f"polar CD0 {self.CD0:g} ({self.CD0_stderr:g}), K {self.K:g} ({self.K_stderr:g}); "
                "CD0 is between 0 and 1, K between 0 and 2, and their standard errors between 0 "
                "and 1: give those of the flown configuration"
            )


@dataclass(frozen=True)
class DeckCorrection(ShortText):
    """A corrected deck.

    Attributes
    ----------
    leaf : Dataset
        Corrected thrust with standard errors. [N]
    speeds, factor, stderr : array (breakpoint,)
        Factors of the a-priori thrust over corrected speed.
    covariance : array (breakpoint, breakpoint)
        Covariance of the factors.
    determined : array of bool (breakpoint,)
        Whether the flights determine a factor better than its a-priori standard error.
    polar : Polar or None
        Estimate of the polar.
    residuals : dict of str to array (point,)
        Measured less computed thrust of one engine, in parts of the a-priori thrust. [1]
    remarks : tuple of str
        Remarks on points outside the deck and on separability.
    prior : Dataset
        Corrected thrust of the a-priori deck. [N]
    convergence : Convergence
        End of the iteration over the noise of the blocks.
    """

    leaf: xr.Dataset
    speeds: np.ndarray
    factor: np.ndarray
    stderr: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    polar: Polar | None
    residuals: dict[str, np.ndarray]
    remarks: tuple[str, ...]
    prior: xr.Dataset
    convergence: Convergence

    def ratio(self, speed: float, mach: float, **condition: float) -> tuple[float, float]:
        """Return the factor on the a-priori thrust and its standard error at a condition."""
        point = {self._axis: speed, "mach": mach, **condition}
        P = prior_thrust_shares(
            self.prior, {name: np.array([value]) for name, value in point.items()}
        )[0]
        # The factors of the breakpoints have the weight of their shares of the thrust.
        w = P / P.sum()
        return float(w @ self.factor), float(np.sqrt(w @ self.covariance @ w))

    def convergence_remarks(self) -> list[Remark]:
        """Return an error if the noise of the blocks did not converge."""
        advice = (
            "factors and standard errors belong to a noise that still changes; give more points, "
            "or recorded thrust and equilibrium separately"
        )
        return self.convergence.remarks("noise of the static thrust", advice, "corrected_thrust")

    @property
    def _axis(self) -> str:
        return speed_axis(self.prior)

    def report(self) -> str:
        """Return factors, scatter and remarks as text."""
        lines = [f"{'corrected speed':>16}{'factor':>10}{'stderr':>9}"]
        rows = zip(self.speeds, self.factor, self.stderr, self.determined)
        for x, factor, stderr, is_determined in rows:
            note = "" if is_determined else "   as a priori"
            lines.append(f"{x:>16.4g}{factor:>10.4f}{stderr:>9.4f}{note}")
        for name, v in self.residuals.items():
            scatter = np.sqrt(np.mean(v**2))
            lines.append(f"{name}: {len(v)} points, rms {scatter:.2%} of the thrust")
        lines += [f"! {text}" for text in self.remarks]
        return "\n".join([*lines, *remark_lines(self.convergence_remarks())])


def correct_deck(
    prior: xr.Dataset,
    recorded: xr.Dataset | None = None,
    equilibrium: xr.Dataset | None = None,
    polar: Polar | None = None,
    S: float = 0.0,
    engines: int = 1,
) -> DeckCorrection:
    """Correct the static thrust of a deck from settled points.

    Parameters
    ----------
    prior : Dataset
        ``corrected_thrust`` of a deck, over ``corrected_n1`` or ``corrected_n2`` and others, with
        ``stderr`` if available. [N]
    recorded : Dataset (point,), optional
        ``n1`` or ``n2`` [1], ``mach``, ``h`` [m], ``thrust`` of one engine [N], and ``temperature``
        [K] if not standard.
    equilibrium : Dataset (point,), optional
        Partial climbs and level accelerations: ``n1`` or ``n2``, ``mach``, ``h``, ``mass`` [kg],
        ``V`` [m/s], ``V_dot`` [m/s2], ``h_dot`` [m/s], ``CL``; ``alpha`` [rad], angle of the thrust
        line to the path, by default zero.
    polar : Polar
        Required for `equilibrium`. It is estimated within its standard errors.
    S : float
        Reference area. [m2]
    engines : int
        Number of engines that share the thrust in `equilibrium`.

    Returns
    -------
    DeckCorrection

    Raises
    ------
    IdentificationError
        No points, all points outside the deck, or an impossible polar.
    """
    if polar is not None:
        polar.demand_possible()
    axis = speed_axis(prior)
    speeds = prior[axis].values.astype(float)
    count = len(speeds)
    blocks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    remarks: list[str] = []
    if recorded is not None:
        blocks["recorded thrust"] = recorded_rows(prior, recorded, remarks)
    if equilibrium is not None:
        if polar is None or not S > 0.0:
            raise IdentificationError(
                "equilibrium points need the polar and the reference area; give polar and S"
            )
        blocks["equilibrium"] = equilibrium_rows(
            prior, equilibrium, S=S, engines=engines, remarks=remarks
        )
    if not blocks:
        raise IdentificationError("no points; give recorded or equilibrium")
    # Unknowns: factors of the thrust by breakpoint, then CD0 and K.
    fixed = polar or Polar(0.0, 0.0)
    first = np.array([*np.ones(count), fixed.CD0, fixed.K])
    sigma = np.array([*_prior_errors(prior, axis), fixed.CD0_stderr, fixed.K_stderr])
    theta, C, residuals, convergence = _mixed_estimate(list(blocks.values()), first, sigma)
    stderr = np.sqrt(np.diag(C))
    estimated = Polar(*map(float, theta[count:]), *map(float, stderr[count:])) if polar else None
    if equilibrium is not None:
        remarks += _separability_remarks(blocks["equilibrium"][0], sigma, C=C, count=count)
    determined = stderr[:count] < 0.9 * sigma[:count]
    return DeckCorrection(
        leaf=_scaled_table(
            prior, axis, factor=theta[:count], stderr=stderr[:count], determined=determined
        ),
        speeds=speeds,
        factor=theta[:count],
        stderr=stderr[:count],
        covariance=C[:count, :count],
        determined=determined,
        polar=estimated,
        residuals=dict(zip(blocks, residuals)),
        remarks=tuple(remarks),
        prior=prior,
        convergence=convergence,
    )


def _prior_errors(prior: xr.Dataset, axis: str) -> np.ndarray:
    """Return the a-priori standard error of each factor (breakpoint,)."""
    if "stderr" not in prior:
        return np.full(prior.sizes[axis], VAGUE)
    others = [dim for dim in prior["value"].dims if dim != axis]
    share = prior["stderr"] / abs(prior["value"]).where(prior["value"] != 0.0)
    error = share.mean(others).values if others else share.values
    return np.where(np.isfinite(error), error, VAGUE)


def _mixed_estimate(
    blocks: Sequence[tuple[np.ndarray, np.ndarray]], first: np.ndarray, sigma: np.ndarray
):
    """Return estimates, covariance, residuals and convergence of mixed estimation [Theil1961].

    Every block has noise of its own size, which is estimated from its residuals.
    """
    free = np.flatnonzero(sigma > 0.0)
    scatter = [1.0] * len(blocks)
    theta = first.copy()
    for count in range(1, PASSES + 1):
        # Normal equations of [Theil1961]: a-priori values and blocks weighted by their variances.
        M = np.diag(1.0 / sigma[free] ** 2)
        b = np.zeros(len(free))
        for (X, z), s in zip(blocks, scatter):
            M += X[:, free].T @ X[:, free] / s**2
            b += X[:, free].T @ (z - X @ first) / s**2
        D = np.linalg.inv(M)
        theta[free] = first[free] + D @ b
        residuals = [z - X @ theta for X, z in blocks]
        # Each block has as many degrees of freedom fewer as it determines unknowns.
        spent = [
            float(np.trace(D @ X[:, free].T @ X[:, free])) / s**2
            for (X, _), s in zip(blocks, scatter)
        ]
        new = [float(np.sqrt(v @ v / max(len(v) - p, 1.0))) for v, p in zip(residuals, spent)]
        before = np.array(scatter)
        changes = np.abs(np.array(new) - before) / (_SAME_ABSOLUTE + _SAME_RELATIVE * before)
        convergence = Convergence(bool((changes <= 1.0).all()), count, float(np.max(changes)))
        scatter = [max(s, 1e-12) for s in new]
        if convergence.converged:
            break
    C = np.zeros((len(first), len(first)))
    C[np.ix_(free, free)] = D
    return theta, C, residuals, convergence


def _separability_remarks(X: np.ndarray, sigma: np.ndarray, C: np.ndarray, count: int) -> list[str]:
    """Return remarks on drag and thrust that the rows X (point, unknown) do not separate."""
    if not (sigma[count:] > 0.0).any():
        return [
            "thrust from equilibrium stands on the polar that was given: an error of the "
            "drag is an equal error of the thrust"
        ]
    # Weights of the unknowns in the mean thrust, in the mean drag, and in CD0 and K alone.
    mean = X.mean(axis=0)
    is_thrust = np.arange(len(mean)) < count
    thrust, drag = np.where(is_thrust, mean, 0.0), np.where(is_thrust, 0.0, mean)
    unit = np.eye(len(mean))
    quantities = (
        ("the thrust", thrust, SEPARATE),
        ("CD0", unit[count], DISTINCT),
        ("K", unit[count + 1], DISTINCT),
    )
    remarks = []
    for name, w, limit in quantities:
        before, after = float(np.sqrt(w**2 @ sigma**2)), float(np.sqrt(w @ C @ w))
        if before > 0.0 and after > limit * before:
            rho = -float(thrust @ C @ drag) / np.sqrt((thrust @ C @ thrust) * (drag @ C @ drag))
            remarks.append(
                f"drag and thrust are not separable: {name} keeps {after / before:.0%} of "
                f"its a-priori standard error, correlation of "
                f"drag and thrust {rho:.2f}; fly two power settings at each speed, or record "
                f"the thrust"
            )
    return remarks


def _scaled_table(
    prior: xr.Dataset,
    axis: str,
    factor: np.ndarray,
    stderr: np.ndarray,
    determined: np.ndarray,
) -> xr.Dataset:
    """Return the a-priori table times the factors; nodes without flight keep their source."""
    factors = xr.DataArray(factor, {axis: prior[axis]}, axis)
    errors = xr.DataArray(stderr, {axis: prior[axis]}, axis)
    dims = prior["value"].dims
    leaf = prior.drop_vars(["stderr", "source"], errors="ignore").copy()
    leaf["value"] = (prior["value"] * factors).transpose(*dims)
    leaf["stderr"] = (abs(prior["value"]) * errors).transpose(*dims)
    source = xr.full_like(prior["value"], SOURCES.index("judgement"), np.uint8)
    if "source" in prior:
        source = prior["source"]
    is_flown = xr.DataArray(determined, {axis: prior[axis]}, axis)
    source = xr.where(is_flown, SOURCES.index("flight"), source).transpose(*dims)
    leaf["source"] = dims, source.values.astype(np.uint8)
    leaf["source"].attrs = dict(SOURCE_ATTRS)
    leaf.attrs = {
        **prior.attrs,
        "comment": "a-priori deck with one factor for each corrected speed, from flight",
    }
    return leaf
