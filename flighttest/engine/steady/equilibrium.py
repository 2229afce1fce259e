"""In-flight thrust from the equilibrium of forces along the flight path: points out of flight records."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName

from .points import GAMMA, P_STANDARD, ratios, shares, speed_axis

NEEDED = ("mach", "h", "alpha", "mass", "ax", "az")


def equilibrium_points(
    states: xr.Dataset, prior: xr.Dataset, S: float, engines: int = 1, every: float = 1.0, i_T: float = 0.0
) -> xr.Dataset:
    """Return means over short times of a record as points of equilibrium for `correct_deck`.

    The specific force at the c.g. holds acceleration and climb together:

        f_x = ax cos(alpha) + az sin(alpha) = V' + g h'/V = [N T cos(alpha + i_T) - D] / m
        f_z = ax sin(alpha) - az cos(alpha)                = [N T sin(alpha + i_T) + L] / m

    Parameters
    ----------
    states : Dataset (time,)
        ``mach``, ``h`` [m], ``alpha`` [rad], ``mass`` [kg], specific force ``ax``, ``az`` at the c.g. [m/s2], the speed ``n1`` or
        ``n2`` [1] of the deck, and ``temperature`` [K], ``pressure_ratio`` where there are any.
    prior : Dataset
        ``corrected_thrust`` of the a-priori deck; the part of the lift that it carries is small. [N]
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
        For ``equilibrium`` of `correct_deck`: ``alpha`` is the angle of the thrust line to the path, ``V_dot`` is f_x and ``h_dot`` zero.

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
    at = {str(name): np.broadcast_to(points[name].values, points.sizes["time"]) for name in points.data_vars}
    theta, delta = ratios(at)
    fx = at["ax"] * np.cos(at["alpha"]) + at["az"] * np.sin(at["alpha"])
    fz = at["ax"] * np.sin(at["alpha"]) - at["az"] * np.cos(at["alpha"])
    q = 0.5 * GAMMA * P_STANDARD * delta * at["mach"] ** 2
    thrust = engines * delta * shares(prior, at | {axis: at[speed] / np.sqrt(theta)}).sum(axis=1)
    lift = at["mass"] * fz - thrust * np.sin(at["alpha"] + i_T)
    kept = {name: at[name] for name in (speed, "mach", "h", "temperature", "pressure_ratio", "mass") if name in at}
    V = np.ones(len(q))  # the rate of climb is in the specific force
    columns = kept | {"alpha": at["alpha"] + i_T, "V": V, "V_dot": fx, "h_dot": 0.0 * V, "CL": lift / (q * S)}
    return xr.Dataset({name: ("point", values) for name, values in columns.items()}, attrs=dict(states.attrs))
