"""Angular acceleration that an a-priori database gives for the recorded motion and controls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from aerodb.store.evaluation import evaluate, evaluate_any
from aerodb.store.overview import FREE_AIR
from aerodb.store.schema import terms
from flightmech.air import GAMMA, R_AIR, pressure_altitude
from flightmech.aircraft.aircraft import Aircraft, inertia_tensor
from flightmech.aircraft.controls import ICE
from flightmech.axes import stability_to_body, transfer_moment
from flightmech.errors import IdentificationError
from flightmech.names import ATTACHED_FLOW
from flightmech.terms import list_model_variables
from flighttest.reconstruction.dynamics.reduced_rates import Columns, missing_reduced_rates
from flighttest.reconstruction.quality.checks.signals import (
    BAND,
    ResampledChannels,
    lowpass_if_possible,
)
from flighttest.records.signals.differentiation import derivative
from flighttest.records.signals.resampling import is_control

_NEEDS = ("V", "p_static", "temperature", "alpha_vane")
_RATES = ("p", "q", "r")
_ZERO = ("delta_", "gear", "speedbrake", ICE)  # beginnings of the names of controls
_MOMENTS = {"delta_e": ("Cm", "CL", "CX", "CZ"), "delta_a": ("Cl", "Cn", "CY")}
_MOMENTS["delta_r"] = _MOMENTS["delta_a"]
_SLOWEST = 0.3  # of the median speed, below which reduced rates are limited


def has_effect(database: xr.DataTree, surface: str) -> bool:
    """Return whether a term of a database gives moments of a surface."""
    variables: set[str] = set()
    for name, leaf in terms(database).items():
        if name.split("/")[0] in _MOMENTS[surface]:
            variables.update(list_model_variables(leaf))
    return surface in variables


def recorded_air(signals: ResampledChannels) -> ResampledChannels:
    """Return a record with airspeed, air and angle of attack at every sample.

    Parameters
    ----------
    signals : ResampledChannels

    Returns
    -------
    ResampledChannels
        Channels without a valid sample are left out, or formed from others.  Values that are not
        valid are interpolated between valid ones.  `flying` has the samples in flight at which all
        of ``V p_static temperature alpha_vane`` are valid.

    Raises
    ------
    IdentificationError
        One of these quantities, or a time with all of them, is missing.
    """
    # a column without a valid sample holds zeros
    dead = [name for name, good in signals.good.items() if not good.any()]
    full = signals.without(dead).completed(_NEEDS)
    missing = [name for name in _NEEDS if name not in full]
    if missing:
        raise IdentificationError(
            f"the record has no valid sample of {', '.join(missing)}; record or map these channels"
        )
    known = full.mask(_NEEDS)
    if not known.any():
        raise IdentificationError(
            f"the record has no time in flight with valid samples of all of {', '.join(_NEEDS)}; "
            f"cut the record to a time with all of them"
        )
    bridged = {}
    for name in _NEEDS:
        good = full.good[name]
        bridged[name] = np.interp(full.time, full.time[good], full[name][good])
    return replace(full.with_values(bridged), flying=known)


def database_accelerations(
    signals: ResampledChannels, aircraft: Aircraft, database: xr.DataTree
) -> dict[str, np.ndarray]:
    """Return the rates of p, q and r that a database gives for a record.

    Parameters
    ----------
    signals : ResampledChannels
        As of `recorded_air`, with flow angles at the c.g.
    aircraft : Aircraft
        Mass properties, c.g. and reference quantities.
    database : DataTree
        Tables end with their last value.

    Returns
    -------
    dict of str to array (time,)
        I^-1 M about the c.g., without thrust and gyroscopic moments.  The controls have the
        low-pass that the other channels have from `resample_channels`, so that the result has it
        too. [rad s-2]

    Raises
    ------
    OutOfRange, SchemaError, UnknownName
        As of `aerodb.evaluate`.
    """
    state = _database_state(signals, aircraft, database)
    coefficients = {}
    for name in ("CL", "CD"):
        coefficients[name] = evaluate_any(database, name, "clamp", state)
    held = {term.split("/")[0] for term in terms(database)}
    for name in ("CY", "Cl", "Cm", "Cn"):
        coefficients[name] = np.zeros(1)
        if name in held:
            coefficients[name] = evaluate(database, name, "clamp", **state)
    size = signals.time.shape
    CL, CD, CY, Cl, Cm, Cn = (
        np.broadcast_to(coefficients[name], size) for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    )
    # forces at the reference point, moments about it, then about the c.g.
    qS = (0.5 * state["rho"] * state["V"] ** 2 * aircraft.S)[:, None]
    force = qS * stability_to_body(np.stack([-CD, CY, -CL], axis=1), state["alpha"])
    lengths = np.array([aircraft.b, aircraft.cbar, aircraft.b])
    moment = qS * lengths * np.stack([Cl, Cm, Cn], axis=1)
    moment = transfer_moment(moment, force, old=np.zeros(3), new=np.asarray(aircraft.cg, float))
    rates = np.linalg.solve(inertia_tensor(aircraft), moment.T)
    return dict(zip(_RATES, rates, strict=True))


def _database_state(
    signals: ResampledChannels, aircraft: Aircraft, database: xr.DataTree
) -> Columns:
    """Return every variable of a database along the record. [SI]"""
    state: Columns = {}
    for name, values in signals.values.items():
        state[name] = values
        if is_control(name):
            state[name] = lowpass_if_possible(values, signals.step, BAND)
    zero = np.zeros(signals.time.shape)
    state["alpha"], state["beta"] = state["alpha_vane"], state.get("beta_vane", zero)
    temperature = np.maximum(state["temperature"], 100.0)
    state["rho"] = state["p_static"] / (R_AIR * temperature)
    state["mach"] = state["V"] / np.sqrt(GAMMA * R_AIR * temperature)
    state["h"] = pressure_altitude(np.clip(state["p_static"], 1e3, 1.2e5))
    state["h_agl"] = state.get("h_radio", zero + FREE_AIR)
    for name in ("alpha", "beta"):
        state[f"{name}_dot"] = derivative(state[name], signals.step, 5, 2)
    slowest = _SLOWEST * float(np.median(state["V"]))
    moving = {**state, "V": np.maximum(state["V"], max(slowest, 1.0))}
    state |= missing_reduced_rates(moving, aircraft)
    # controls and rates without a record are zero, the flow is attached
    for leaf in terms(database).values():
        for name in list_model_variables(leaf):
            if name in ATTACHED_FLOW:
                state.setdefault(name, zero + ATTACHED_FLOW[name])
            elif name.endswith(("hat", "_osc", "_wind")) or name.startswith(_ZERO):
                state.setdefault(name, zero)
    return state
