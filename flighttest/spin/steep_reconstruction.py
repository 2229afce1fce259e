"""Reconstruction of steep flight: with the body axes turned by 90 degrees about y.

Euler angles are singular with the nose straight down, where a spin nearly is (theta = -74 deg in [Gresham]).  The kinematics
do not care which axes of the body are called x, y and z, so the record is handed on in axes

    x' = -z,  y' = y,  z' = x

in which the same motion has theta' near zero: a spin becomes a fast turn on the spot.  What comes back is turned to the
body axes of the aircraft, and incidence, attitude and reduced rates are formed anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.names import attrs

from ..dynamics.force_coefficients import reduced_rates
from ..dynamics.kinematics import rotation
from ..reconstruction.smoother import Path, reconstruct
from ..sensors.instruments import stated_in

if TYPE_CHECKING:
    from flightmech import Aircraft

TURN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # body to turned axes
_TRIPLES = (("p", "q", "r"), ("ax_imu", "ay_imu", "az_imu"), ("ax", "ay", "az"), ("u", "v", "w"), ("p_dot", "q_dot", "r_dot"))
_EULER = ("phi", "theta", "psi")
_ANEW = ("alpha", "beta", "nz", "alpha_dot", "beta_dot", "phat", "qhat", "rhat", "alphadothat", "betadothat")


def reconstruct_steep(record: xr.DataTree, aircraft: Aircraft, rate: float = 50.0) -> Path:
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
        States in the body axes of the aircraft.  Constants and residuals of inertial unit and attitude are those of the turned
        axes: ``bias.p`` is about the turned x axis.
    """
    path = reconstruct(_turned_record(record), _turned_aircraft(aircraft, record.attrs), rate=rate)
    return replace(path, states=_turned_back(path.states, aircraft))


def _turned_record(record: xr.DataTree) -> xr.DataTree:
    leaves = {}
    for name, node in record.children.items():
        data = node.to_dataset(inherit=False)
        for triple in (*_TRIPLES[:2],):
            if all(part in data for part in triple):
                data = _with(data, triple, np.stack([data[part].values for part in triple], axis=1) @ TURN.T)
        if all(part in data for part in _EULER):
            R = rotation(np.stack([data[part].values for part in _EULER], axis=1))
            data = _with(data, _EULER, _euler(R @ TURN.T))
        leaves[f"/{name}"] = data.drop_vars(["alpha_vane", "beta_vane"], errors="ignore")
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs={key: item for key, item in record.attrs.items() if key != "instruments"}), **leaves}
    )


def _turned_aircraft(aircraft: Aircraft, facts: Mapping[Any, Any]) -> Aircraft:
    """The aircraft with c.g. and instruments in turned axes; x and z change places, and so do their specifications."""
    swapped = {"p": "r", "r": "p", "ax_imu": "az_imu", "az_imu": "ax_imu"}
    tables: dict[str, Any] = {}
    for name, item in {**aircraft.instruments, **stated_in(facts)}.items():
        table = dict(item)
        for key in ("noise", "bias_sigma", "scale_sigma"):
            if key in table:
                table[key] = {swapped.get(channel, channel): value for channel, value in table[key].items()}
        if "position" in table:
            table["position"] = (TURN @ np.asarray(table["position"], float)).tolist()
        tables[name] = table
    x, y, z = TURN @ np.asarray(aircraft.cg, float)
    return replace(aircraft, cg=(float(x), float(y), float(z)), instruments=tables)


def _turned_back(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    found = states.drop_vars([name for name in _ANEW if name in states])
    for triple in _TRIPLES:
        if all(part in states for part in triple):
            found = _with(found, triple, np.stack([states[part].values for part in triple], axis=1) @ TURN)
    R = rotation(np.stack([states[part].values for part in _EULER], axis=1))
    found = _with(found, _EULER, _euler(R @ TURN))
    u, v, w, V = (found[name].values for name in ("u", "v", "w", "V"))
    found["alpha"] = "time", np.arctan2(w, u), attrs("alpha")
    found["beta"] = "time", np.arcsin(np.clip(v / V, -1.0, 1.0)), attrs("beta")
    return reduced_rates(found, aircraft)


def _with(data: xr.Dataset, names: tuple[str, ...], columns: np.ndarray) -> xr.Dataset:
    return data.assign({name: (data[names[0]].dims, column, data[name].attrs) for name, column in zip(names, columns.T, strict=True)})


def _euler(R: np.ndarray) -> np.ndarray:
    """phi, theta, psi of rotations from body to north-east-down axes, heading unwrapped. [rad]"""
    phi, theta = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    return np.stack([phi, theta, np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))], axis=1)
