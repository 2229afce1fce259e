"""Static thrust of an a-priori deck corrected from flight: recorded thrust, or longitudinal
equilibrium with a polar.

Corrected thrust over corrected speed and Mach number keeps its breakpoints; all nodes of one
corrected speed are multiplied by one factor r.  A recorded net thrust T, and the equilibrium along
the flight path of an aeroplane with N engines,

    T = delta sum_k r_k P_k(n / sqrt(theta), M)
    m V' + m g h' / V = N cos(alpha + i_T) T - qbar S (CD0 + K CL^2)

are linear in r, CD0 and K, and solved together by weighted least squares with a-priori values.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.2, fig. 6.
.. [Theil1961] Theil, Goldberger, On pure and mixed statistical estimation in economics, Int. Econ. Rev. 2, 1961.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.terms import SOURCE_ATTRS, SOURCES
from flighttest.submodels.engine.steady_points import (
    equilibrium_rows,
    prior_thrust_shares,
    recorded_rows,
    speed_axis,
)

VAGUE = 0.1  # a-priori standard error of a factor where the deck states none
PASSES = 20  # of the noise
# part of the a-priori standard error of the thrust that may be left where it counts as separate
# from the drag
SEPARATE = 0.3
# part of the a-priori standard error that may be left of the polar where it counts as determined
DISTINCT = 0.5


@dataclass(frozen=True)
class Polar:
    """Drag polar CD = CD0 + K CL^2 with standard errors; zero where it is known."""

    CD0: float
    K: float
    CD0_stderr: float = 0.0
    K_stderr: float = 0.0


@dataclass(frozen=True)
class DeckCorrection:
    """A corrected deck.

    Attributes
    ----------
    leaf : Dataset
        Corrected thrust with standard errors. [N]
    speeds, factor, stderr : array (breakpoint,)
        Factors of the a-priori thrust over corrected speed.
    covariance : array (breakpoint, breakpoint)
    determined : array of bool (breakpoint,)
        Whether the flights determine a factor better than its a-priori standard error.
    polar : Polar or None
        As it came out.
    residuals : dict of str to array (point,)
        Measured less computed thrust of one engine, in parts of the a-priori thrust. [1]
    remarks : tuple of str
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

    def ratio(self, speed: float, mach: float, **condition: float) -> tuple[float, float]:
        """Return corrected over a-priori thrust and its standard error, at a corrected speed and
        flight condition.
        """
        at = {self._axis: speed, "mach": mach, **condition}
        P = prior_thrust_shares(
            self.prior, {name: np.array([value]) for name, value in at.items()}
        )[0]
        w = P / P.sum()
        return float(w @ self.factor), float(np.sqrt(w @ self.covariance @ w))

    @property
    def _axis(self) -> str:
        return speed_axis(self.prior)

    def report(self) -> str:
        """Return factors, scatter and remarks as text."""
        lines = [f"{'corrected speed':>16}{'factor':>10}{'stderr':>9}"]
        rows = zip(self.speeds, self.factor, self.stderr, self.determined)
        lines += [
            f"{x:>16.4g}{r:>10.4f}{s:>9.4f}{'' if known else '   as a priori'}"
            for x, r, s, known in rows
        ]
        lines += [
            f"{name}: {len(v)} points, rms {np.sqrt(np.mean(v**2)):.2%} of the thrust"
            for name, v in self.residuals.items()
        ]
        return "\n".join([*lines, *(f"! {text}" for text in self.remarks)])


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
        ``corrected_thrust`` of a deck, over ``corrected_n1`` or ``corrected_n2`` and others;
        ``stderr`` where it has one. [N]
    recorded : Dataset (point,), optional
        ``n1`` or ``n2`` [1], ``mach``, ``h`` [m], ``thrust`` of one engine [N], and ``temperature``
        [K] if not standard.
    equilibrium : Dataset (point,), optional
        Partial climbs and level accelerations: ``n1`` or ``n2``, ``mach``, ``h``, ``mass`` [kg],
        ``V`` [m/s], ``V_dot`` [m/s2], ``h_dot`` [m/s], ``CL``; ``alpha`` [rad], angle of the thrust
        line to the path, zero without it.
    polar : Polar
        Needed for `equilibrium`; estimated along within its standard errors.
    S : float
        Reference area. [m2]
    engines : int
        That share the thrust in `equilibrium`.

    Returns
    -------
    DeckCorrection

    Raises
    ------
    IdentificationError
        No points, or points outside the deck alone.
    """
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
        blocks["equilibrium"] = equilibrium_rows(prior, equilibrium, S, engines, remarks)
    if not blocks:
        raise IdentificationError("no points; give recorded or equilibrium")
    first = np.array([*np.ones(count), *((polar.CD0, polar.K) if polar else (0.0, 0.0))])
    sigma = np.array(
        [
            *_prior_errors(prior, axis),
            *((polar.CD0_stderr, polar.K_stderr) if polar else (0.0, 0.0)),
        ]
    )
    theta, C, residuals = _mixed(list(blocks.values()), first, sigma)
    stderr = np.sqrt(np.diag(C))
    estimated = Polar(*map(float, theta[count:]), *map(float, stderr[count:])) if polar else None
    if equilibrium is not None:
        remarks += _separable(blocks["equilibrium"][0], sigma, C, count)
    determined = stderr[:count] < 0.9 * sigma[:count]
    leaf = _corrected(prior, axis, theta[:count], stderr[:count])
    named = dict(zip(blocks, residuals))
    parts = theta[:count], stderr[:count], C[:count, :count], determined
    return DeckCorrection(leaf, speeds, *parts, estimated, named, tuple(remarks), prior)


def _prior_errors(prior: xr.Dataset, axis: str) -> np.ndarray:
    if "stderr" not in prior:
        return np.full(prior.sizes[axis], VAGUE)
    others = [dim for dim in prior["value"].dims if dim != axis]
    share = prior["stderr"] / abs(prior["value"]).where(prior["value"] != 0.0)
    found = share.mean(others).values if others else share.values
    return np.where(np.isfinite(found), found, VAGUE)


def _mixed(blocks: Sequence[tuple[np.ndarray, np.ndarray]], first: np.ndarray, sigma: np.ndarray):
    """Weighted least squares with a-priori values; every block has noise of its own size, found
    from its residuals.
    """
    free = np.flatnonzero(sigma > 0.0)
    scatter = [1.0] * len(blocks)
    theta = first.copy()
    for _ in range(PASSES):
        M = np.diag(1.0 / sigma[free] ** 2)
        b = np.zeros(len(free))
        for (X, z), s in zip(blocks, scatter):
            M += X[:, free].T @ X[:, free] / s**2
            b += X[:, free].T @ (z - X @ first) / s**2
        D = np.linalg.inv(M)
        theta[free] = first[free] + D @ b
        residuals = [z - X @ theta for X, z in blocks]
        spent = [
            float(np.trace(D @ X[:, free].T @ X[:, free])) / s**2
            for (X, _), s in zip(blocks, scatter)
        ]
        new = [float(np.sqrt(v @ v / max(len(v) - p, 1.0))) for v, p in zip(residuals, spent)]
        settled = np.allclose(new, scatter, rtol=1e-6)
        scatter = [max(s, 1e-12) for s in new]
        if settled:
            break
    C = np.zeros((len(first), len(first)))
    C[np.ix_(free, free)] = D
    return theta, C, residuals


def _separable(X: np.ndarray, sigma: np.ndarray, C: np.ndarray, count: int) -> list[str]:
    """What the equilibrium, rows X (point, unknown), shows of drag and thrust separately."""
    if not (sigma[count:] > 0.0).any():
        return [
            "thrust from equilibrium stands on the polar that was given: an error of the "
            "drag is an equal error of the thrust"
        ]
    mean = X.mean(axis=0)
    thrust, drag = (
        np.where(part, mean, 0.0)
        for part in (np.arange(len(mean)) < count, np.arange(len(mean)) >= count)
    )
    named = {
        "the thrust": thrust,
        "CD0": np.eye(len(mean))[count],
        "K": np.eye(len(mean))[count + 1],
    }
    most = {"the thrust": SEPARATE}
    found = []
    for name, w in named.items():
        before, after = float(np.sqrt(w**2 @ sigma**2)), float(np.sqrt(w @ C @ w))
        if before > 0.0 and after > most.get(name, DISTINCT) * before:
            rho = -float(thrust @ C @ drag) / np.sqrt((thrust @ C @ thrust) * (drag @ C @ drag))
            found.append(
                f"drag and thrust are not separable: {name} keeps {after / before:.0%} of "
                f"its a-priori standard error, correlation of "
                f"drag and thrust {rho:.2f}; fly two power settings at each speed, or record "
                f"the thrust"
            )
    return found


def _corrected(prior: xr.Dataset, axis: str, factor: np.ndarray, stderr: np.ndarray) -> xr.Dataset:
    """The a-priori table times the factors."""
    by = {
        name: xr.DataArray(values, {axis: prior[axis]}, axis)
        for name, values in (("factor", factor), ("stderr", stderr))
    }
    dims = prior["value"].dims
    leaf = prior.drop_vars(["stderr", "source"], errors="ignore").copy()
    leaf["value"] = (prior["value"] * by["factor"]).transpose(*dims)
    leaf["stderr"] = (abs(prior["value"]) * by["stderr"]).transpose(*dims)
    leaf["source"] = dims, np.full(leaf["value"].shape, SOURCES.index("flight"), np.uint8)
    leaf["source"].attrs = dict(SOURCE_ATTRS)
    leaf.attrs = {
        **prior.attrs,
        "comment": "a-priori deck with one factor for each corrected speed, from flight",
    }
    return leaf
