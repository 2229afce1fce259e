"""Net thrust over fuel flow and Mach number in corrected parameters, for aeroplanes that record fuel flow and no thrust.

    X / delta = c0 + c1 w + c2 M + c3 w M + c4 M^2,      w = Wf / (delta sqrt(theta))

theta is the total temperature over 288.15 K, delta the ambient pressure over 101325 Pa.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.arrays import rms

from .points import ratios

TERMS = ("1", "w", "M", "w M", "M^2")
FEWEST = 3  # points per term


@dataclass(frozen=True)
class FuelThrust:
    """Thrust over fuel flow.

    Attributes
    ----------
    coefficients : array (5,)
        Of `TERMS`. [N, N per kg/s]
    covariance : array (5, 5)
    rms : float
        Residual of the fitted points. [N]
    fuel_flow, mach : (low, high)
        Corrected fuel flow [kg/s] and Mach number of the fitted points.
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    rms: float
    fuel_flow: tuple[float, float]
    mach: tuple[float, float]

    def predict(self, points: xr.Dataset) -> xr.Dataset:
        """Return ``thrust`` and ``stderr`` [N] at points, and whether they lie ``inside`` what was fitted."""
        X, delta, w, mach = _rows(points)
        stderr = delta * np.sqrt(np.einsum("ij,jk,ik->i", X, self.covariance, X))
        inside = (w >= self.fuel_flow[0]) & (w <= self.fuel_flow[1]) & (mach >= self.mach[0]) & (mach <= self.mach[1])
        columns = {"thrust": delta * (X @ self.coefficients), "stderr": stderr, "inside": inside}
        return xr.Dataset({name: ("point", values) for name, values in columns.items()})


def fit_fuel_thrust(points: xr.Dataset) -> FuelThrust:
    """Fit the net thrust over fuel flow and Mach number by least squares.

    Parameters
    ----------
    points : Dataset (point,)
        Of one engine: ``fuel_flow`` [kg/s], ``mach``, ``h`` [m], ``thrust`` [N], ``temperature`` [K] if not standard.

    Returns
    -------
    FuelThrust

    Raises
    ------
    IdentificationError
        Too few points, or points that do not separate the terms.
    """
    X, delta, w, mach = _rows(points)
    count = X.shape[1]
    if len(X) < FEWEST * count:
        raise IdentificationError(f"{len(X)} points for {count} terms; at least {FEWEST * count} are needed")
    size = np.linalg.norm(X, axis=0)
    if np.linalg.cond(X / size) > 1e6:
        raise IdentificationError("the points do not separate fuel flow and Mach number; add other powers or speeds")
    z = points["thrust"].values
    A = delta[:, None] * X
    theta = np.linalg.lstsq(A / size, z, rcond=None)[0] / size
    v = z - A @ theta
    R = np.linalg.inv(np.linalg.qr(A / size, mode="r"))
    covariance = R @ R.T * float(v @ v) / (len(v) - count) / np.outer(size, size)
    spans = [(float(x.min()), float(x.max())) for x in (w, mach)]
    return FuelThrust(theta, covariance, rms(v), spans[0], spans[1])


def _rows(points: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    theta, delta = ratios(points)
    mach = points["mach"].values
    w = points["fuel_flow"].values / (delta * np.sqrt(theta))
    return np.column_stack([np.ones(len(w)), w, mach, w * mach, mach**2]), delta, w, mach
