"""Friction, preload, unbalance and hinge moments from the force at the hand while the control slides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

from ..equation_error import least_squares
from ..equation_error.time_domain import SAMPLES_PER_TERM
from ..uncertainty import collinearity
from ..uncertainty.coloured_residuals import coloured
from .loading import ControlLoading
from .motion import CUTOFF, FREE_CUTOFF, design, rates, signals, sliding

_ALIKE = 0.98  # correlation inside every manoeuvre from which on only the differences between manoeuvres separate two terms


@dataclass(frozen=True)
class SlidingFit:
    """Estimates of the force at the hand while the control slides.

    Attributes
    ----------
    loading : ControlLoading
    estimates : Dataset (term, term_, error)
        Names of `ControlLoading.names`: ``estimate``, ``stderr`` (coloured residuals), ``stderr_white``, ``covariance``,
        ``correlation``; ``friction``, ``damping`` and ``mass`` are those of both ends of the cable together, reduced to the travel.
        Attributes ``residual_rms`` [N or N m], ``R2``, ``samples``, ``manoeuvres``.
    alike : list of (str, str)
        Terms that go together inside every manoeuvre: their separation depends on differences between the manoeuvres.
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
    driven: Sequence[xr.Dataset],
    free: Sequence[xr.Dataset] = (),
    cutoff: float = CUTOFF,
    aft: tuple[float, float] = (0.0, 0.0),
) -> SlidingFit:
    """Fit the force at the hand by least squares over the samples in which the control slides.

    Parameters
    ----------
    loading : ControlLoading
    driven : sequence of Dataset (time,)
        Manoeuvres in which the hand moves the control, of several speeds and tab settings: see `motion.signals`.
    free : sequence of Dataset (time,)
        Pulses and releases, low-passed at `motion.FREE_CUTOFF`: inverse dynamics.
    cutoff : float
        Low-pass of the driven manoeuvres, all channels alike. [Hz]
    aft : (float, float)
        Mass and damping of the surface, reduced to the travel, for what its end of the cable moves otherwise than the cockpit's.
        [kg or kg m2, N s m-1 or N m s]

    Raises
    ------
    IdentificationError
        Too few samples, or terms that the manoeuvres cannot distinguish.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.3.
    """
    parts = []
    for one, band in [*((one, cutoff) for one in driven), *((one, FREE_CUTOFF) for one in free)]:
        moved = signals(loading, one, band)
        use = sliding(loading, one, moved, band)
        if use.any():
            parts.append((moved["time"].values, use, design(loading, moved), _force(loading, moved, aft)))
    need = SAMPLES_PER_TERM * len(loading.names)
    count = int(sum(use.sum() for _, use, _, _ in parts))
    if count < need:
        raise IdentificationError(f"{loading.item}: {count} samples in which the control slides; at least {need} are needed")
    X = np.concatenate([X[use] for _, use, X, _ in parts])
    z = np.concatenate([F[use] for _, use, _, F in parts])
    fixed = np.array([name == "offset" for name in loading.names])
    collinearity.demand_rank(X, loading.names)
    collinearity.demand_independence(X, fixed, loading.names)
    theta, _ = least_squares.solve(X, z)
    v = z - X @ theta
    pieces, steps = stretches(parts)
    found = coloured(X, v, pieces, steps)
    white = np.sqrt(np.diag(np.linalg.inv(X.T @ X)) * float(v @ v) / (len(z) - len(theta)))
    more = least_squares.diagnostics(X, fixed)
    estimates = least_squares.estimates(loading.names, theta, found.covariance, white, ([], np.zeros((len(theta), 0))), more)
    estimates.attrs = {
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()), "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z), "manoeuvres": len(parts), "offset": found.offset,
    }  # fmt: skip
    return SlidingFit(loading, estimates, _alike(loading, [X[use] for _, use, X, _ in parts[: len(driven)]]))


def _force(loading: ControlLoading, moved: xr.Dataset, aft: tuple[float, float]) -> np.ndarray:
    """Force at the hand as if the surface moved with the cockpit's end."""
    step = float(np.median(np.diff(moved["time"].values)))
    rate, acceleration = rates(moved[loading.deflection].values / loading.gearing - moved["travel"].values, step)
    return moved[f"F_{loading.item}"].values - aft[0] * acceleration - aft[1] * rate


def stretches(parts) -> tuple[list[slice], list[float]]:
    """Stretches without a gap, as slices of all samples used, and their sampling intervals."""
    pieces, steps, at = [], [], 0
    for time, use, _, _ in parts:
        own = np.flatnonzero(use)
        edges = [0, *(np.flatnonzero(np.diff(own) > 1) + 1).tolist(), len(own)]
        pieces += [slice(at + a, at + b) for a, b in pairwise(edges)]
        steps += [float(np.median(np.diff(time)))] * (len(edges) - 1)
        at += len(own)
    return pieces, steps


def _alike(loading: ControlLoading, parts: Sequence[np.ndarray]) -> list[tuple[str, str]]:
    """Pairs of bob weight or spring with a hinge moment whose regressors go together inside every manoeuvre."""
    names = loading.names
    found: list[tuple[str, str]] = []
    for name in ("bob_weight", "stiffness"):
        if name not in names:
            continue
        j = names.index(name)
        for k in range(len(loading.constants), len(names)):
            moving = [X for X in parts if len(X) > 2 and np.ptp(X[:, j]) > 0.0 and np.ptp(X[:, k]) > 0.0]
            if moving and min(abs(np.corrcoef(X[:, j], X[:, k])[0, 1]) for X in moving) > _ALIKE:
                found.append((name, names[k]))
    return found
