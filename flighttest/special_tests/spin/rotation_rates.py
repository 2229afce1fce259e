"""Body rates as a rotation about the flight path and a remainder, as in [Gresham] for a spin.

    Omega = p cos(alpha) cos(beta) + q sin(beta) + r sin(alpha) cos(beta)        eq. (2)
    p_osc = p - Omega cos(alpha) cos(beta)                                       eq. (3)
    q_osc = q - Omega sin(beta)                                                  eq. (4)
    r_osc = r - Omega sin(alpha) cos(beta)                                       eq. (5)

Omega is a rate about the wind x axis, (p_osc, q_osc, r_osc) are body components of the remaining
vector.  This vector is at right angles to the flight path, so it has two degrees of freedom and not
three::

    p_osc cos(alpha) cos(beta) + q_osc sin(beta) + r_osc sin(alpha) cos(beta) = 0

As regressors the three are collinear to first order about any nominal state.  Two regressors
contain the same information.  One is q_osc, the rate about the wind y axis times cos(beta).  The
other is the rate about the wind z axis, r_wind = r cos(alpha) - p sin(alpha).

In a steady spin the remainder is zero only if the spin radius is zero.  A body that moves down a
helix turns about the vertical, not about its path.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft
   Using Flight Data, eq. (1)-(5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import REDUCED_RATES, quantity_attributes
from flighttest.reconstruction.dynamics.kinematics import body_to_ned_rotation
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.smoother import reconstruct
from flighttest.records.sensors.instruments import stated_in

# Reduced rates: rate, and reference length over 2V.
WIND_RATES = {
    "Omegahat": ("Omega", "b"),
    "phat_osc": ("p_osc", "b"),
    "qhat_osc": ("q_osc", "cbar"),
    "rhat_osc": ("r_osc", "b"),
    "rhat_wind": ("r_wind", "b"),
}
_NEEDED = ("V", "alpha", "beta", "p", "q", "r")


class WindRates(NamedTuple):
    """Rate about the flight path, and the remainder. [rad s-1]

    The remainder has body components ``p_osc q_osc r_osc``; ``r_wind`` is about the wind z axis.
    """

    Omega: np.ndarray
    p_osc: np.ndarray
    q_osc: np.ndarray
    r_osc: np.ndarray
    r_wind: np.ndarray


def wind_axis_rates(p, q, r, alpha, beta) -> WindRates:
    """Return body rates as a rotation about the flight path and a remainder, [Gresham] eq. (2)-(5).

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
    >>> rates = wind_axis_rates(1.0, 0.0, 0.0, 0.0, 0.0)
    >>> float(rates.Omega), float(rates.p_osc)
    (1.0, 0.0)
    """
    p, q, r, alpha, beta = (np.asarray(a, float) for a in (p, q, r, alpha, beta))
    # unit vector of the flight path in body axes
    x, y, z = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
    Omega = p * x + q * y + r * z
    return WindRates(
        Omega=Omega,
        p_osc=p - Omega * x,
        q_osc=q - Omega * y,
        r_osc=r - Omega * z,
        r_wind=r * np.cos(alpha) - p * np.sin(alpha),
    )


def spin_variables(data: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return the states with the explanatory variables of a spin model.

    Parameters
    ----------
    data : Dataset (time,)
        `V alpha beta p q r`, and `alpha_dot beta_dot` or `ax ay az phi theta`, from which these
        follow. [SI]
    aircraft : Aircraft
        Span and mean chord.

    Returns
    -------
    Dataset (time,)
        A new Dataset with ``Omega p_osc q_osc r_osc r_wind`` [rad s-1] and, reduced by b/2V (q_osc:
        cbar/2V), ``Omegahat phat_osc qhat_osc rhat_osc rhat_wind``.  Also ``phat qhat rhat`` and,
        if the data determine them, the quasi-steady ``alphadothat`` (cbar/2V) and ``betadothat``
        (b/2V).

    Raises
    ------
    UnknownName
        A state is missing.
    """
    for name in _NEEDED:
        if name not in data:
            raise UnknownName(
                name,
                map(str, data.data_vars),
                "state",
                "the rotation about the flight path needs it",
            )
    variables = reduced_rates(data, aircraft)
    rates = wind_axis_rates(
        data["p"].values,
        data["q"].values,
        r=data["r"].values,
        alpha=data["alpha"].values,
        beta=data["beta"].values,
    )
    dims = data["p"].dims
    for name, rate in rates._asdict().items():
        variables[name] = dims, rate, quantity_attributes(name)
    for name, (rate_name, length) in WIND_RATES.items():
        rate = variables[rate_name].values
        reduced = rate * getattr(aircraft, length) / (2.0 * data["V"].values)
        variables[name] = dims, reduced, quantity_attributes(name)
    return variables


def nominal_variables(state: Mapping[str, float], aircraft: Aircraft) -> dict[str, float]:
    """Return the explanatory variables of a steady state, for models in deviations from it.

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
    variables = spin_variables(numbers, aircraft)
    names = [name for name in state if name in ("alpha", "beta") or name.startswith("delta_")]
    nominal = {}
    for name in (*names, "phat", "qhat", "rhat", *WIND_RATES):
        nominal[name] = float(variables[name][0])
    return {**nominal, "alphadothat": 0.0, "betadothat": 0.0}


# Matrix from body axes to turned axes, whose x axis is up in level flight. Near the vertical the
# turned axes have a small pitch angle.
TURN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
# Vectors of a record, and of a path.
_RECORDED = (("p", "q", "r"), ("ax_imu", "ay_imu", "az_imu"))
_CG = ("x_cg_b", "y_cg_b", "z_cg_b")
_VECTORS = (*_RECORDED, ("ax", "ay", "az"), ("u", "v", "w"), ("p_dot", "q_dot", "r_dot"), _CG)
_EULER = ("phi", "theta", "psi")
# States that are computed again in body axes.
_DERIVED = ("alpha", "beta", "nz", "alpha_dot", "beta_dot", *REDUCED_RATES)
# Channels that exchange their specifications when x and z exchange places.
_EXCHANGED = {"p": "r", "r": "p", "ax_imu": "az_imu", "az_imu": "ax_imu"}


def reconstruct_steep(record: xr.DataTree, aircraft: Aircraft, rate: float = 50.0) -> FlightPath:
    """Reconstruct the flight path of a record with the nose near the vertical.

    Parameters
    ----------
    record : DataTree
        As for `reconstruct`, with heading; vanes are not used.
    aircraft : Aircraft
        As for `reconstruct`.
    rate : float
        Samples per second of the path. [Hz]

    Returns
    -------
    FlightPath
        States in the body axes of the aircraft.  Constants and residuals of inertial unit and
        attitude belong to the turned axes: ``bias.p`` is about the turned x axis.
    """
    turned = _turn_aircraft(aircraft, record.attrs)
    path = reconstruct(_turn_record(record), turned, rate=rate)
    return replace(path, states=_turn_back(path.states, aircraft))


def _turn_record(record: xr.DataTree) -> xr.DataTree:
    """Return the record in turned axes, without vanes."""
    attributes = {key: item for key, item in record.attrs.items() if key != "instruments"}
    nodes = {"/": xr.Dataset(attrs=attributes)}
    for name, node in record.children.items():
        data = node.to_dataset(inherit=False)
        for names in _RECORDED:
            if all(part in data for part in names):
                data = _replace_columns(data, names, _stack_columns(data, names) @ TURN.T)
        if all(part in data for part in _EULER):
            R = body_to_ned_rotation(_stack_columns(data, _EULER))
            data = _replace_columns(data, _EULER, _euler_angles(R @ TURN.T))
        data = _turn_recorded_cg(data)
        nodes[f"/{name}"] = data.drop_vars(["alpha_vane", "beta_vane"], errors="ignore")
    return xr.DataTree.from_dict(nodes)


def _turn_recorded_cg(data: xr.Dataset) -> xr.Dataset:
    """Return a leaf with its c.g. in turned axes; a coordinate may be recorded without others."""
    turned = {}
    for row, name in zip(TURN, _CG, strict=True):
        k = int(np.abs(row).argmax())
        if _CG[k] in data:
            turned[name] = data[_CG[k]] * row[k]
    return data.drop_vars(list(_CG), errors="ignore").assign(turned)


def _turn_aircraft(aircraft: Aircraft, facts: Mapping[Any, Any]) -> Aircraft:
    """Return the aircraft with c.g., tanks and instruments in turned axes."""
    tables: dict[str, Any] = {}
    for name, item in {**aircraft.instruments, **stated_in(facts)}.items():
        table = dict(item)
        for key in ("noise", "bias_sigma", "scale_sigma"):
            if key in table:
                channels = table[key].items()
                table[key] = {_EXCHANGED.get(name, name): value for name, value in channels}
        if "position" in table:
            table["position"] = (TURN @ np.asarray(table["position"], float)).tolist()
        tables[name] = table
    fuel = aircraft.fuel
    if fuel is not None:
        tanks = [replace(tank, position=_turn_place(tank.position)) for tank in fuel.tanks]
        fuel = replace(fuel, tanks=tuple(tanks))
    return replace(aircraft, cg=_turn_place(aircraft.cg), fuel=fuel, instruments=tables)


def _turn_place(place: Sequence[float]) -> tuple[float, float, float]:
    """Return a place of the aircraft in turned axes. [m]"""
    x, y, z = TURN @ np.asarray(place, float)
    return float(x), float(y), float(z)


def _turn_back(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return the states of a path in body axes, with the states that depend on the axes."""
    body = states.drop_vars([name for name in _DERIVED if name in states])
    for names in _VECTORS:
        if all(part in states for part in names):
            body = _replace_columns(body, names, _stack_columns(states, names) @ TURN)
    R = body_to_ned_rotation(_stack_columns(states, _EULER))
    body = _replace_columns(body, _EULER, _euler_angles(R @ TURN))
    u, v, w, V = (body[name].values for name in ("u", "v", "w", "V"))
    body["alpha"] = "time", np.arctan2(w, u), quantity_attributes("alpha")
    body["beta"] = "time", np.arcsin(np.clip(v / V, -1.0, 1.0)), quantity_attributes("beta")
    return reduced_rates(body, aircraft)


def _stack_columns(data: xr.Dataset, names: tuple[str, ...]) -> np.ndarray:
    return np.stack([data[name].values for name in names], axis=1)


def _replace_columns(data: xr.Dataset, names: tuple[str, ...], columns: np.ndarray) -> xr.Dataset:
    """Return the data with new values of some variables."""
    dims = data[names[0]].dims
    changed = {}
    for name, column in zip(names, columns.T, strict=True):
        changed[name] = (dims, column, data[name].attrs)
    return data.assign(changed)


def _euler_angles(R: np.ndarray) -> np.ndarray:
    """Return phi, theta and continuous psi of rotations from body to north, east, down. [rad]"""
    phi, theta = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    return np.stack([phi, theta, np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))], axis=1)
