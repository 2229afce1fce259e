"""Net thrust over fuel flow and Mach number in corrected parameters, for aeroplanes that record
fuel flow and no thrust.

    X / delta = c0 + c1 w + c2 M + c3 w M + c4 M^2,      w = Wf / (delta sqrt(theta))

theta is the total temperature over 288.15 K, delta the ambient pressure over 101325 Pa.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError, UnknownName
from flightmech.support.arrays import rms
from flightmech.terms import basis

T_STANDARD, P_STANDARD, GAMMA, G0 = 288.15, 101325.0, 1.4, 9.80665
SPEEDS = ("corrected_n1", "corrected_n2")


def temperature_pressure_ratios(points: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """Return total temperature over 288.15 K and ambient pressure over 101325 Pa.

    Parameters
    ----------
    points : mapping of str to array
        ``mach``, ``h`` [m], ``temperature`` [K] if not standard; ``pressure_ratio``, without which
        h is a pressure altitude.
    """
    h, mach = (np.asarray(points[name], float) for name in ("h", "mach"))
    air = atmosphere(h)
    T = np.asarray(points.get("temperature", air.temperature), float)
    delta = np.asarray(points.get("pressure_ratio", np.asarray(air.p_static) / P_STANDARD), float)
    return T / T_STANDARD * (1.0 + 0.2 * mach**2), delta


def speed_axis(prior: xr.Dataset) -> str:
    """Return which corrected speed is an axis of a deck."""
    found = [name for name in SPEEDS if name in prior["value"].dims]
    if not found:
        raise IdentificationError(
            f"the deck has the axes {' '.join(map(str, prior['value'].dims))}; one of "
            f"{' '.join(SPEEDS)} is needed"
        )
    return found[0]


def prior_thrust_shares(prior: xr.Dataset, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the a-priori corrected thrust (point, breakpoint) by the speed to whose nodes it
    belongs. [N]
    """
    axis = speed_axis(prior)
    place = prior["value"].dims.index(axis)
    index = np.broadcast_to(
        np.arange(prior.sizes[axis]).reshape(
            [-1 if k == place else 1 for k in range(prior["value"].ndim)]
        ),
        prior["value"].shape,
    )
    weights = basis(prior, at, outside="clamp").toarray() * prior["value"].values.ravel()
    return weights @ (index.ravel()[:, None] == np.arange(prior.sizes[axis]))


def _inside(
    prior: xr.Dataset, points: xr.Dataset, name: str, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points lie inside the deck; shares and pressure ratio of those."""
    axis = speed_axis(prior)
    theta, delta = temperature_pressure_ratios(points)
    speed = points[axis.removeprefix("corrected_")].values / np.sqrt(theta)
    at = {**{str(key): points[key].values for key in points.data_vars}, axis: speed}
    inside = np.all(
        [
            (at[str(a)] >= prior[a].values[0]) & (at[str(a)] <= prior[a].values[-1])
            for a in prior["value"].dims
        ],
        axis=0,
    )
    if not inside.any():
        raise IdentificationError(
            f"{name}: no point inside the a-priori deck, {_range(prior)}; look at the units, "
            f"or extend the deck"
        )
    if not inside.all():
        remarks.append(
            f"{name}: {np.count_nonzero(~inside)} of {len(inside)} points lie outside the "
            f"a-priori deck and are left out"
        )
    return (
        inside,
        prior_thrust_shares(prior, {key: value[inside] for key, value in at.items()}),
        delta[inside],
    )


def _range(prior: xr.Dataset) -> str:
    return ", ".join(
        f"{dim} {prior[dim].values[0]:.4g} to {prior[dim].values[-1]:.4g}"
        for dim in prior["value"].dims
    )


def recorded_rows(
    prior: xr.Dataset, points: xr.Dataset, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and measured values, in parts of the a-priori thrust."""
    inside, P, delta = _inside(prior, points, "recorded thrust", remarks)
    size = np.abs(delta * P.sum(axis=1))
    X = np.column_stack([delta[:, None] * P, np.zeros((len(P), 2))]) / size[:, None]
    return X, points["thrust"].values[inside] / size


def equilibrium_rows(
    prior: xr.Dataset, points: xr.Dataset, S: float, engines: int, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and measured values along the flight path, in parts of
    the median a-priori thrust.
    """
    inside, P, delta = _inside(prior, points, "equilibrium", remarks)
    at = {str(key): points[key].values[inside] for key in points.data_vars}
    q = 0.5 * GAMMA * P_STANDARD * delta * at["mach"] ** 2
    along = engines * np.cos(at.get("alpha", np.zeros(len(q)))) * delta
    size = np.median(
        along * np.abs(P.sum(axis=1))
    )  # errors of mass, acceleration and climb do not go with the thrust
    force = at["mass"] * (at["V_dot"] + G0 * at["h_dot"] / at["V"])
    X = np.column_stack([along[:, None] * P, -q * S, -q * S * at["CL"] ** 2]) / size
    return X, force / size


NEEDED = ("mach", "h", "alpha", "mass", "ax", "az")


def equilibrium_points(
    states: xr.Dataset,
    prior: xr.Dataset,
    S: float,
    engines: int = 1,
    every: float = 1.0,
    i_T: float = 0.0,
) -> xr.Dataset:
    """Return means over short times of a record as points of equilibrium for `correct_deck`.

    The specific force at the c.g. holds acceleration and climb together:

        f_x = ax cos(alpha) + az sin(alpha) = V' + g h'/V = [N T cos(alpha + i_T) - D] / m
        f_z = ax sin(alpha) - az cos(alpha)                = [N T sin(alpha + i_T) + L] / m

    Parameters
    ----------
    states : Dataset (time,)
        ``mach``, ``h`` [m], ``alpha`` [rad], ``mass`` [kg], specific force ``ax``, ``az`` at the
        c.g. [m/s2], the speed ``n1`` or ``n2`` [1] of the deck, and ``temperature`` [K],
        ``pressure_ratio`` where there are any.
    prior : Dataset
        ``corrected_thrust`` of the a-priori deck; the part of the lift that it carries is small.
        [N]
    S : float
        Reference area. [m2]
    engines : int
    every : float
        Time over which a point is averaged. [s]
    i_T : float
        Angle of the thrust line to body x, positive upward. [rad]

    Returns
    -------
    Dataset (point,)
        For ``equilibrium`` of `correct_deck`: ``alpha`` is the angle of the thrust line to the
        path, ``V_dot`` is f_x and ``h_dot`` zero.

    Raises
    ------
    UnknownName
        A channel is missing.
    """
    axis = speed_axis(prior)
    speed = axis.removeprefix("corrected_")
    for name in (*NEEDED, speed):
        if name not in states:
            raise UnknownName(name, map(str, states.data_vars), "channel")
    step = float(np.median(np.diff(states["time"].values)))
    points = states.coarsen(time=max(round(every / step), 1), boundary="trim").mean()
    at = {
        str(name): np.broadcast_to(points[name].values, points.sizes["time"])
        for name in points.data_vars
    }
    theta, delta = temperature_pressure_ratios(at)
    fx = at["ax"] * np.cos(at["alpha"]) + at["az"] * np.sin(at["alpha"])
    fz = at["ax"] * np.sin(at["alpha"]) - at["az"] * np.cos(at["alpha"])
    q = 0.5 * GAMMA * P_STANDARD * delta * at["mach"] ** 2
    thrust = (
        engines
        * delta
        * prior_thrust_shares(prior, at | {axis: at[speed] / np.sqrt(theta)}).sum(axis=1)
    )
    lift = at["mass"] * fz - thrust * np.sin(at["alpha"] + i_T)
    kept = {
        name: at[name]
        for name in (speed, "mach", "h", "temperature", "pressure_ratio", "mass")
        if name in at
    }
    V = np.ones(len(q))  # the rate of climb is in the specific force
    columns = kept | {
        "alpha": at["alpha"] + i_T,
        "V": V,
        "V_dot": fx,
        "h_dot": 0.0 * V,
        "CL": lift / (q * S),
    }
    return xr.Dataset(
        {name: ("point", values) for name, values in columns.items()}, attrs=dict(states.attrs)
    )


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
        """Return ``thrust`` and ``stderr`` [N] at points, and whether they lie ``inside`` what was
        fitted.
        """
        X, delta, w, mach = _rows(points)
        stderr = delta * np.sqrt(np.einsum("ij,jk,ik->i", X, self.covariance, X))
        inside = (
            (w >= self.fuel_flow[0])
            & (w <= self.fuel_flow[1])
            & (mach >= self.mach[0])
            & (mach <= self.mach[1])
        )
        columns = {"thrust": delta * (X @ self.coefficients), "stderr": stderr, "inside": inside}
        return xr.Dataset({name: ("point", values) for name, values in columns.items()})


def fit_fuel_thrust(points: xr.Dataset) -> FuelThrust:
    """Fit the net thrust over fuel flow and Mach number by least squares.

    Parameters
    ----------
    points : Dataset (point,)
        Of one engine: ``fuel_flow`` [kg/s], ``mach``, ``h`` [m], ``thrust`` [N], ``temperature``
        [K] if not standard.

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
        raise IdentificationError(
            f"{len(X)} points for {count} terms; at least {FEWEST * count} are needed"
        )
    size = np.linalg.norm(X, axis=0)
    if np.linalg.cond(X / size) > 1e6:
        raise IdentificationError(
            "the points do not separate fuel flow and Mach number; add other powers or speeds"
        )
    z = points["thrust"].values
    A = delta[:, None] * X
    theta = np.linalg.lstsq(A / size, z, rcond=None)[0] / size
    v = z - A @ theta
    R = np.linalg.inv(np.linalg.qr(A / size, mode="r"))
    covariance = R @ R.T * float(v @ v) / (len(v) - count) / np.outer(size, size)
    spans = [(float(x.min()), float(x.max())) for x in (w, mach)]
    return FuelThrust(theta, covariance, rms(v), spans[0], spans[1])


def _rows(points: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    theta, delta = temperature_pressure_ratios(points)
    mach = points["mach"].values
    w = points["fuel_flow"].values / (delta * np.sqrt(theta))
    return np.column_stack([np.ones(len(w)), w, mach, w * mach, mach**2]), delta, w, mach
