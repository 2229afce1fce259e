"""Body rates taken apart into the rotation about the flight path and the remainder, as [Gresham]
does for a spin.

    Omega = p cos(alpha) cos(beta) + q sin(beta) + r sin(alpha) cos(beta)        eq. (2)
    p_osc = p - Omega cos(alpha) cos(beta)                                       eq. (3)
    q_osc = q - Omega sin(beta)                                                  eq. (4)
    r_osc = r - Omega sin(alpha) cos(beta)                                       eq. (5)

Omega is a rate about the wind x axis, (p_osc, q_osc, r_osc) are body components of the remaining vector.  That vector
is at right angles to the flight path, so it has two degrees of freedom and not three::

    p_osc cos(alpha) cos(beta) + q_osc sin(beta) + r_osc sin(alpha) cos(beta) = 0

As regressors the three are collinear to first order about any nominal state.  Two are the same:
q_osc, which is the rate about the wind y axis times cos(beta), and the rate about the wind z axis,
r_wind = r cos(alpha) - p sin(alpha).

In a steady spin the rest is zero only when the spin radius is: a body that moves down a helix turns
about the vertical, not about its path.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft Using Flight Data, eq. (1)-(5).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import quantity_attributes
from flighttest.reconstruction.dynamics.kinematics import body_to_ned_rotation
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.smoother import reconstruct
from flighttest.records.sensors.instruments import stated_in

WIND_RATES = {
    "Omegahat": ("Omega", "b"),
    "phat_osc": ("p_osc", "b"),
    "qhat_osc": ("q_osc", "cbar"),
    "rhat_osc": ("r_osc", "b"),
    "rhat_wind": ("r_wind", "b"),
}
_NEEDED = ("V", "alpha", "beta", "p", "q", "r")


class WindRates(NamedTuple):
    """Rate about the flight path, body components of the rest, and the rest about the wind z axis.
    [rad s-1]
    """

    Omega: np.ndarray
    p_osc: np.ndarray
    q_osc: np.ndarray
    r_osc: np.ndarray
    r_wind: np.ndarray


def wind_axis_rates(p, q, r, alpha, beta) -> WindRates:
    """Return body rates as a rotation about the flight path and a rest, [Gresham] eq. (2)-(5).

    Parameters
    ----------
    p, q, r : array (time,)
        Body rates. [rad s-1]
    alpha, beta : array (time,)
        Angles of attack and sideslip. [rad]

    Returns
    -------
    WindRates

    Examples
    --------
    >>> found = wind_axis_rates(1.0, 0.0, 0.0, 0.0, 0.0)
    >>> float(found.Omega), float(found.p_osc)
    (1.0, 0.0)
    """
    p, q, r, alpha, beta = (np.asarray(a, float) for a in (p, q, r, alpha, beta))
    x, y, z = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
    Omega = p * x + q * y + r * z
    return WindRates(
        Omega, p - Omega * x, q - Omega * y, r - Omega * z, r * np.cos(alpha) - p * np.sin(alpha)
    )


def spin_variables(data: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return the states with the explanatory variables of a spin model.

    Parameters
    ----------
    data : Dataset (time,)
        `V alpha beta p q r`; with `alpha_dot` and `beta_dot`, or with `ax ay az phi theta`, from
        which these follow. [SI]
    aircraft : Aircraft
        For the span and the mean chord.

    Returns
    -------
    Dataset (time,)
        A new Dataset with ``Omega p_osc q_osc r_osc r_wind`` [rad s-1] and, reduced by b/2V (q_osc:
        cbar/2V), ``Omegahat phat_osc qhat_osc rhat_osc rhat_wind``; also ``phat qhat rhat``, and
        the quasi-steady ``alphadothat`` (cbar/2V) and ``betadothat`` (b/2V) where the data allow
        it.

    Raises
    ------
    UnknownName
        A state that is missing.
    """
    for name in _NEEDED:
        if name not in data:
            raise UnknownName(
                name,
                map(str, data.data_vars),
                "state",
                "the rotation about the flight path needs it",
            )
    found = reduced_rates(data, aircraft)
    rates = wind_axis_rates(*(data[name].values for name in ("p", "q", "r", "alpha", "beta")))
    dims = data["p"].dims
    for name, rate in rates._asdict().items():
        found[name] = dims, rate, quantity_attributes(name)
    for name, (rate_name, length) in WIND_RATES.items():
        found[name] = (
            dims,
            found[rate_name].values * getattr(aircraft, length) / (2.0 * data["V"].values),
            quantity_attributes(name),
        )
    return found


def nominal_variables(state: Mapping[str, float], aircraft: Aircraft) -> dict[str, float]:
    """Return the explanatory variables of a steady state: what a model in deviations counts from.

    Parameters
    ----------
    state : mapping of str to float
        `V alpha beta p q r`, and surfaces such as `delta_e`. [SI]
    aircraft : Aircraft

    Returns
    -------
    dict of str to float
        `alpha`, `beta`, the surfaces, the reduced rates of `spin_variables`; ``alphadothat`` and
        ``betadothat`` are zero.
    """
    numbers = xr.Dataset({name: ("time", [float(value)]) for name, value in state.items()})
    found = spin_variables(numbers, aircraft)
    kept = [name for name in state if name in ("alpha", "beta") or name.startswith("delta_")]
    reduced = ("phat", "qhat", "rhat", *WIND_RATES)
    return {
        **{name: float(found[name][0]) for name in (*kept, *reduced)},
        "alphadothat": 0.0,
        "betadothat": 0.0,
    }


TURN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # body to turned axes
_TRIPLES = (
    ("p", "q", "r"),
    ("ax_imu", "ay_imu", "az_imu"),
    ("ax", "ay", "az"),
    ("u", "v", "w"),
    ("p_dot", "q_dot", "r_dot"),
)
_EULER = ("phi", "theta", "psi")
_ANEW = (
    "alpha",
    "beta",
    "nz",
    "alpha_dot",
    "beta_dot",
    "phat",
    "qhat",
    "rhat",
    "alphadothat",
    "betadothat",
)


def reconstruct_steep(record: xr.DataTree, aircraft: Aircraft, rate: float = 50.0) -> FlightPath:
    """Reconstruct the flight path of a record with the nose near the vertical.

    Parameters
    ----------
    record : DataTree
        As for `reconstruct`; heading is needed, vanes are not used.
    aircraft : Aircraft
        As for `reconstruct`.
    rate : float
        Samples per second of the path. [Hz]

    Returns
    -------
    Path
        States in the body axes of the aircraft.  Constants and residuals of inertial unit and
        attitude are those of the turned axes: ``bias.p`` is about the turned x axis.
    """
    path = reconstruct(_turned_record(record), _turned_aircraft(aircraft, record.attrs), rate=rate)
    return replace(path, states=_turned_back(path.states, aircraft))


def _turned_record(record: xr.DataTree) -> xr.DataTree:
    leaves = {}
    for name, node in record.children.items():
        data = node.to_dataset(inherit=False)
        for triple in (*_TRIPLES[:2],):
            if all(part in data for part in triple):
                data = _with(
                    data, triple, np.stack([data[part].values for part in triple], axis=1) @ TURN.T
                )
        if all(part in data for part in _EULER):
            R = body_to_ned_rotation(np.stack([data[part].values for part in _EULER], axis=1))
            data = _with(data, _EULER, _euler(R @ TURN.T))
        leaves[f"/{name}"] = data.drop_vars(["alpha_vane", "beta_vane"], errors="ignore")
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset(
                attrs={key: item for key, item in record.attrs.items() if key != "instruments"}
            ),
            **leaves,
        }
    )


def _turned_aircraft(aircraft: Aircraft, facts: Mapping[Any, Any]) -> Aircraft:
    """The aircraft with c.g. and instruments in turned axes; x and z change places, and so do their
    specifications.
    """
    swapped = {"p": "r", "r": "p", "ax_imu": "az_imu", "az_imu": "ax_imu"}
    tables: dict[str, Any] = {}
    for name, item in {**aircraft.instruments, **stated_in(facts)}.items():
        table = dict(item)
        for key in ("noise", "bias_sigma", "scale_sigma"):
            if key in table:
                table[key] = {
                    swapped.get(channel, channel): value for channel, value in table[key].items()
                }
        if "position" in table:
            table["position"] = (TURN @ np.asarray(table["position"], float)).tolist()
        tables[name] = table
    x, y, z = TURN @ np.asarray(aircraft.cg, float)
    return replace(aircraft, cg=(float(x), float(y), float(z)), instruments=tables)


def _turned_back(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    found = states.drop_vars([name for name in _ANEW if name in states])
    for triple in _TRIPLES:
        if all(part in states for part in triple):
            found = _with(
                found, triple, np.stack([states[part].values for part in triple], axis=1) @ TURN
            )
    R = body_to_ned_rotation(np.stack([states[part].values for part in _EULER], axis=1))
    found = _with(found, _EULER, _euler(R @ TURN))
    u, v, w, V = (found[name].values for name in ("u", "v", "w", "V"))
    found["alpha"] = "time", np.arctan2(w, u), quantity_attributes("alpha")
    found["beta"] = "time", np.arcsin(np.clip(v / V, -1.0, 1.0)), quantity_attributes("beta")
    return reduced_rates(found, aircraft)


def _with(data: xr.Dataset, names: tuple[str, ...], columns: np.ndarray) -> xr.Dataset:
    return data.assign(
        {
            name: (data[names[0]].dims, column, data[name].attrs)
            for name, column in zip(names, columns.T, strict=True)
        }
    )


def _euler(R: np.ndarray) -> np.ndarray:
    """phi, theta, psi of rotations from body to north-east-down axes, heading unwrapped. [rad]"""
    phi, theta = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    return np.stack([phi, theta, np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))], axis=1)
