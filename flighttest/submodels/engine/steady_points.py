"""Equilibrium points, and net thrust over fuel flow and Mach number in corrected parameters.

The fit over fuel flow is for aeroplanes that record fuel flow and no thrust:

    X / delta = c0 + c1 w + c2 M + c3 w M + c4 M^2,      w = Wf / (delta sqrt(theta))

theta is the total temperature over 288.15 K, and delta is the ambient pressure over 101325 Pa.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flightmech.support.arrays import rms
from flightmech.terms import basis

T_STANDARD, P_STANDARD, GAMMA, G0 = 288.15, 101325.0, 1.4, 9.80665
SPEEDS = ("corrected_n1", "corrected_n2")


def temperature_pressure_ratios(points: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """Return total temperature over 288.15 K and ambient pressure over 101325 Pa.

    Parameters
    ----------
    points : mapping of str to array
        ``mach``, ``h`` [m], ``temperature`` [K] if not standard, ``pressure_ratio``. Without
        ``pressure_ratio``, h is a pressure altitude.
    """
    h, mach = (np.asarray(points[name], float) for name in ("h", "mach"))
    air = atmosphere(h)
    T = np.asarray(points.get("temperature", air.temperature), float)
    delta = np.asarray(points.get("pressure_ratio", np.asarray(air.p_static) / P_STANDARD), float)
    return T / T_STANDARD * (1.0 + 0.2 * mach**2), delta


def speed_axis(prior: xr.Dataset) -> str:
    """Return the corrected speed that is an axis of a deck."""
    for name in SPEEDS:
        if name in prior["value"].dims:
            return name
    raise IdentificationError(
        f"the deck has the axes {' '.join(map(str, prior['value'].dims))}; one of "
        f"{' '.join(SPEEDS)} is needed"
    )


def prior_thrust_shares(prior: xr.Dataset, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the a-priori corrected thrust (point, breakpoint) by breakpoint of the speed. [N]"""
    speed = speed_axis(prior)
    # Index of the breakpoint of the speed to which each node belongs.
    shape = [-1 if dim == speed else 1 for dim in prior["value"].dims]
    index = np.broadcast_to(np.arange(prior.sizes[speed]).reshape(shape), prior["value"].shape)
    weights = basis(prior, at, outside="clamp").toarray() * prior["value"].values.ravel()
    return weights @ (index.ravel()[:, None] == np.arange(prior.sizes[speed]))


def _inside(
    prior: xr.Dataset, points: xr.Dataset, name: str, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which points lie inside the deck, and their thrust shares and pressure ratio."""
    speed = speed_axis(prior)
    theta, delta = temperature_pressure_ratios(points)
    channels = {str(key): points[key].values for key in points.data_vars}
    channels[speed] = points[speed.removeprefix("corrected_")].values / np.sqrt(theta)
    inside = np.ones(len(channels[speed]), bool)
    for dim in map(str, prior["value"].dims):
        breakpoints = prior[dim].values
        inside &= (channels[dim] >= breakpoints[0]) & (channels[dim] <= breakpoints[-1])
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
    shares = prior_thrust_shares(prior, {key: value[inside] for key, value in channels.items()})
    return inside, shares, delta[inside]


def _range(prior: xr.Dataset) -> str:
    return ", ".join(
        f"{dim} {prior[dim].values[0]:.4g} to {prior[dim].values[-1]:.4g}"
        for dim in prior["value"].dims
    )


def recorded_rows(
    prior: xr.Dataset, points: xr.Dataset, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and recorded values, divided by the a-priori thrust."""
    inside, P, delta = _inside(prior, points, "recorded thrust", remarks)
    size = np.abs(delta * P.sum(axis=1))
    X = np.column_stack([delta[:, None] * P, np.zeros((len(P), 2))]) / size[:, None]
    return X, points["thrust"].values[inside] / size


def equilibrium_rows(
    prior: xr.Dataset, points: xr.Dataset, S: float, engines: int, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and measured forces along the flight path.

    Both are divided by the median a-priori thrust.
    """
    inside, P, delta = _inside(prior, points, "equilibrium", remarks)
    channels = {str(key): points[key].values[inside] for key in points.data_vars}
    # Dynamic pressure from the Mach number: q = gamma p M^2 / 2.
    q = 0.5 * GAMMA * P_STANDARD * delta * channels["mach"] ** 2
    along = engines * np.cos(channels.get("alpha", np.zeros(len(q)))) * delta
    # One size for all points: errors of mass, acceleration and climb do not grow with the thrust.
    size = np.median(along * np.abs(P.sum(axis=1)))
    force = channels["mass"] * (channels["V_dot"] + G0 * channels["h_dot"] / channels["V"])
    # Unknowns: factor of the thrust by breakpoint, then CD0 and the factor of CL^2.
    X = np.column_stack([along[:, None] * P, -q * S, -q * S * channels["CL"] ** 2]) / size
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

    The specific force at the c.g. contains acceleration and climb:

        f_x = ax cos(alpha) + az sin(alpha) = V' + g h'/V = [N T cos(alpha + i_T) - D] / m
        f_z = ax sin(alpha) - az cos(alpha)                = [N T sin(alpha + i_T) + L] / m

    Parameters
    ----------
    states : Dataset (time,)
        ``mach``, ``h`` [m], ``alpha`` [rad], ``mass`` [kg], specific force ``ax``, ``az`` at the
        c.g. [m/s2], the speed ``n1`` or ``n2`` [1] of the deck, and ``temperature`` [K],
        ``pressure_ratio`` if recorded.
    prior : Dataset
        ``corrected_thrust`` of the a-priori deck. It gives the small part of the lift that the
        thrust carries. [N]
    S : float
        Reference area. [m2]
    engines : int
        Number of engines.
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
    channels = {
        str(name): np.broadcast_to(points[name].values, points.sizes["time"])
        for name in points.data_vars
    }
    theta, delta = temperature_pressure_ratios(channels)
    alpha, ax, az = channels["alpha"], channels["ax"], channels["az"]
    fx = ax * np.cos(alpha) + az * np.sin(alpha)
    fz = ax * np.sin(alpha) - az * np.cos(alpha)
    q = 0.5 * GAMMA * P_STANDARD * delta * channels["mach"] ** 2
    corrected_speed = {axis: channels[speed] / np.sqrt(theta)}
    shares = prior_thrust_shares(prior, channels | corrected_speed)
    thrust = engines * delta * shares.sum(axis=1)
    lift = channels["mass"] * fz - thrust * np.sin(alpha + i_T)
    columns = {}
    for name in (speed, "mach", "h", "temperature", "pressure_ratio", "mass"):
        if name in channels:
            columns[name] = channels[name]
    # The specific force contains the rate of climb, so h_dot is zero and V has no effect.
    V = np.ones(len(q))
    columns |= {
        "alpha": alpha + i_T,
        "V": V,
        "V_dot": fx,
        "h_dot": 0.0 * V,
        "CL": lift / (q * S),
    }
    return xr.Dataset(
        {name: ("point", values) for name, values in columns.items()}, attrs=dict(states.attrs)
    )


TERMS = ("1", "w", "M", "w M", "M^2")
# Smallest number of points per term.
FEWEST = 3


@dataclass(frozen=True)
class FuelThrust(ShortText):
    """Thrust over fuel flow.

    Attributes
    ----------
    coefficients : array (5,)
        Coefficients of `TERMS`. [N, N per kg/s]
    covariance : array (5, 5)
        Covariance of the coefficients.
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
        """Return ``thrust`` and ``stderr`` [N] at points, and whether they lie ``inside`` the fit.

        The fit covers the ranges of corrected fuel flow and Mach number.
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
        Points of one engine: ``fuel_flow`` [kg/s], ``mach``, ``h`` [m], ``thrust`` [N],
        ``temperature``
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
    # Least squares of the thrust with columns of unit length; the covariance is s^2 (A'A)^-1.
    z = points["thrust"].values
    A = delta[:, None] * X
    theta = np.linalg.lstsq(A / size, z, rcond=None)[0] / size
    v = z - A @ theta
    R = np.linalg.inv(np.linalg.qr(A / size, mode="r"))
    covariance = R @ R.T * float(v @ v) / (len(v) - count) / np.outer(size, size)
    fuel_flow = float(w.min()), float(w.max())
    return FuelThrust(
        theta,
        covariance,
        rms=rms(v),
        fuel_flow=fuel_flow,
        mach=(float(mach.min()), float(mach.max())),
    )


def _rows(points: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the regressors (point, 5), delta, corrected fuel flow w and Mach number (point,)."""
    theta, delta = temperature_pressure_ratios(points)
    mach = points["mach"].values
    w = points["fuel_flow"].values / (delta * np.sqrt(theta))
    return np.column_stack([np.ones(len(w)), w, mach, w * mach, mach**2]), delta, w, mach
