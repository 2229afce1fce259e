"""Reduced rates of a motion, and states as plain columns along time."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import REDUCED_RATES, quantity_attributes
from flightmech.units import G0

Columns = dict[str, np.ndarray]  # states by name, and time


def read_columns(states: xr.Dataset) -> Columns:
    """Return time and the numeric states as arrays (time,). Constants are repeated."""
    time = states["time"].values
    columns = {"time": time}
    for name, item in states.variables.items():
        if item.dims in ((), ("time",)) and item.dtype.kind in "fiub":
            columns[str(name)] = np.broadcast_to(np.asarray(item.values, float), time.shape)
    return columns


def read_column(columns: Columns, name: str, default: float | None = None) -> np.ndarray:
    """Return one column (time,), or the default at all times.

    Raises
    ------
    UnknownName
        The column is missing and has no default.
    """
    if name in columns:
        return columns[name]
    if default is None:
        raise UnknownName(
            name,
            set(columns) - {"time"},
            "state",
            "the coefficients need it: name its column in the name map of the record and "
            "reconstruct again",
        )
    return np.full(len(columns["time"]), float(default))


def stack_columns(columns: Columns, names: tuple[str, ...]) -> np.ndarray:
    """Return columns side by side (time, names)."""
    return np.stack([read_column(columns, name) for name in names], axis=1)


def center_of_gravity(columns: Columns, aircraft: Aircraft) -> np.ndarray:
    """Return the position of the c.g. (time, 3): ``x_cg_b``, ``y_cg_b``, ``z_cg_b``, or that of the
    aircraft. [m]
    """
    names = ("x_cg_b", "y_cg_b", "z_cg_b")
    coordinates = []
    for name, default in zip(names, aircraft.cg, strict=False):
        coordinates.append(read_column(columns, name, default))
    return np.stack(coordinates, axis=1)


def reduced_rates(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return `states` with those of `flightmech.names.REDUCED_RATES` that are missing.

    Parameters
    ----------
    states : Dataset (time,)
        At least `V p q r`; with `alpha_dot` and `beta_dot`, or with the states that these follow
        from: `alpha beta ax ay az phi theta`. [SI]
    aircraft : Aircraft
        For the span and the mean chord.

    Returns
    -------
    Dataset (time,)
        A new Dataset.

    Notes
    -----
    Rates are divided by 2 V: phat = p b/(2 V), qhat = q cbar/(2 V).
    """
    rates = missing_reduced_rates(read_columns(states), aircraft)
    variables = {}
    for name, values in rates.items():
        variables[name] = ("time", values, quantity_attributes(name))
    return states.assign(variables)


def missing_reduced_rates(columns: Columns, aircraft: Aircraft) -> Columns:
    """Return the reduced rates that are missing, and the rates of incidence that they need."""
    rates: Columns = {}
    has_rate = "alphadothat" in columns or "alpha_dot" in columns
    if not has_rate and _has_incidence_rates(columns):
        rates["alpha_dot"], rates["beta_dot"] = _incidence_rates(columns)
    for name, (rate, reference) in REDUCED_RATES.items():
        length = getattr(aircraft, reference)
        if name in columns:
            continue
        # phat = p b / 2V, qhat = q cbar / 2V, and so on.
        if rate in rates:
            rates[name] = rates[rate] * length / (2.0 * read_column(columns, "V"))
        elif rate in columns:
            rates[name] = columns[rate] * length / (2.0 * read_column(columns, "V"))
    return rates


def _has_incidence_rates(columns: Columns) -> bool:
    needed = {"alpha", "beta", "ax", "ay", "az", "phi", "theta"}
    return needed <= columns.keys()


def _incidence_rates(columns: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha_dot and beta_dot from accelerations, for unaccelerated air. [rad s-1]"""
    V = read_column(columns, "V")
    p, q, r = (read_column(columns, name) for name in ("p", "q", "r"))
    al, be = read_column(columns, "alpha"), read_column(columns, "beta")
    ph, th = read_column(columns, "phi"), read_column(columns, "theta")
    # acceleration = specific force + gravity, in body axes
    ax = read_column(columns, "ax") - G0 * np.sin(th)
    ay = read_column(columns, "ay") + G0 * np.cos(th) * np.sin(ph)
    az = read_column(columns, "az") + G0 * np.cos(th) * np.cos(ph)
    alpha_dot = (
        q
        - np.tan(be) * (p * np.cos(al) + r * np.sin(al))
        + (az * np.cos(al) - ax * np.sin(al)) / (V * np.cos(be))
    )
    beta_dot = (
        p * np.sin(al)
        - r * np.cos(al)
        + (ay * np.cos(be) - np.sin(be) * (ax * np.cos(al) + az * np.sin(al))) / V
    )
    return alpha_dot, beta_dot
