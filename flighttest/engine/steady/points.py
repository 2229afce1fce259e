"""Settled points as linear equations in the factors of an a-priori deck, and in the drag polar."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError
from flightmech.terms import basis

T_STANDARD, P_STANDARD, GAMMA, G0 = 288.15, 101325.0, 1.4, 9.80665
SPEEDS = ("corrected_n1", "corrected_n2")


def ratios(points: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """Return total temperature over 288.15 K and ambient pressure over 101325 Pa.

    Parameters
    ----------
    points : mapping of str to array
        ``mach``, ``h`` [m], ``temperature`` [K] if not standard; ``pressure_ratio``, without which h is a pressure altitude.
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
        raise IdentificationError(f"the deck has the axes {' '.join(map(str, prior['value'].dims))}; one of {' '.join(SPEEDS)} is needed")
    return found[0]


def shares(prior: xr.Dataset, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the a-priori corrected thrust (point, breakpoint) by the speed to whose nodes it belongs. [N]"""
    axis = speed_axis(prior)
    place = prior["value"].dims.index(axis)
    index = np.broadcast_to(
        np.arange(prior.sizes[axis]).reshape([-1 if k == place else 1 for k in range(prior["value"].ndim)]), prior["value"].shape
    )
    weights = basis(prior, at, outside="clamp").toarray() * prior["value"].values.ravel()
    return weights @ (index.ravel()[:, None] == np.arange(prior.sizes[axis]))


def _inside(prior: xr.Dataset, points: xr.Dataset, name: str, remarks: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points lie inside the deck; shares and pressure ratio of those."""
    axis = speed_axis(prior)
    theta, delta = ratios(points)
    speed = points[axis.removeprefix("corrected_")].values / np.sqrt(theta)
    at = {**{str(key): points[key].values for key in points.data_vars}, axis: speed}
    inside = np.all([(at[str(a)] >= prior[a].values[0]) & (at[str(a)] <= prior[a].values[-1]) for a in prior["value"].dims], axis=0)
    if not inside.any():
        raise IdentificationError(f"{name}: no point inside the a-priori deck, {_range(prior)}; look at the units, or extend the deck")
    if not inside.all():
        remarks.append(f"{name}: {np.count_nonzero(~inside)} of {len(inside)} points lie outside the a-priori deck and are left out")
    return inside, shares(prior, {key: value[inside] for key, value in at.items()}), delta[inside]


def _range(prior: xr.Dataset) -> str:
    return ", ".join(f"{dim} {prior[dim].values[0]:.4g} to {prior[dim].values[-1]:.4g}" for dim in prior["value"].dims)


def recorded_rows(prior: xr.Dataset, points: xr.Dataset, remarks: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and measured values, in parts of the a-priori thrust."""
    inside, P, delta = _inside(prior, points, "recorded thrust", remarks)
    size = np.abs(delta * P.sum(axis=1))
    X = np.column_stack([delta[:, None] * P, np.zeros((len(P), 2))]) / size[:, None]
    return X, points["thrust"].values[inside] / size


def equilibrium_rows(prior: xr.Dataset, points: xr.Dataset, S: float, engines: int, remarks: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (point, breakpoint + 2) and measured values along the flight path, in parts of the median a-priori thrust."""
    inside, P, delta = _inside(prior, points, "equilibrium", remarks)
    at = {str(key): points[key].values[inside] for key in points.data_vars}
    q = 0.5 * GAMMA * P_STANDARD * delta * at["mach"] ** 2
    along = engines * np.cos(at.get("alpha", np.zeros(len(q)))) * delta
    size = np.median(along * np.abs(P.sum(axis=1)))  # errors of mass, acceleration and climb do not go with the thrust
    force = at["mass"] * (at["V_dot"] + G0 * at["h_dot"] / at["V"])
    X = np.column_stack([along[:, None] * P, -q * S, -q * S * at["CL"] ** 2]) / size
    return X, force / size
