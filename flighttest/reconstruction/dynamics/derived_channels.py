"""Channels derived from measured channels of a manoeuvre, with standard errors.

Every function takes a manoeuvre (channels on one uniform clock, see `cut`) and returns a Dataset of
the derived channels. The attributes of each variable state its inputs (``made_from``) and its
standard error (``stderr``, SI). A derivative has the frequency up to which it follows to 1 %
(``bandwidth``, Hz).

The standard error is the propagated noise of the inputs, and the assumed error of the wind. Fourier
smoothing gives the noise of each input at its recorded rate. Constant errors of the inputs (biases,
a wrong wind) are not included. Reconstruct the path (`reconstruct`) if they matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, mach_number
from flightmech.errors import SchemaError
from flightmech.names import WRAPPED, quantity_attributes
from flightmech.support.arrays import rms
from flighttest.reconstruction.dynamics.kinematics import (
    body_rates_from_angles,
    body_to_ned_rotation,
    gravity,
)
from flighttest.records.signals.differentiation import (
    derivative,
    derivative_gain,
    derivative_noise,
    fourier_smooth,
)
from flighttest.records.signals.resampling import resample

_WIND_ERROR = 1.0  # m/s, of a wind that is not specified
_LEAST_SPEED = 1e-6  # m/s, keeps the sideslip angle finite at rest
_FULL_GAIN = 0.99  # gain of a derivative at the end of its bandwidth


def angular_accelerations(data: xr.Dataset) -> xr.Dataset:
    """Return ``p_dot q_dot r_dot`` by local polynomials over p, q, r.

    Raises
    ------
    SchemaError
        A rate is missing.

    Examples
    --------
    >>> t = np.arange(100) * 0.02
    >>> motion = xr.Dataset({name: ("time", 0.1 * t) for name in "pqr"}, coords={"time": t})
    >>> round(float(angular_accelerations(motion)["q_dot"][50]), 6)
    0.1
    """
    names = ("p", "q", "r")
    _check_channels(data, *names)
    slopes, errors = _differentiate_channels(data, names)
    outputs = ("p_dot", "q_dot", "r_dot")
    return _make_dataset(
        data,
        dict(zip(outputs, slopes, strict=True)),
        errors=dict(zip(outputs, errors, strict=True)),
        origin="local polynomials over p q r",
        bandwidth=_bandwidth(data, *names),
    )


def rates_from_attitude(data: xr.Dataset) -> xr.Dataset:
    """Return ``p q r`` from ``phi theta psi``: omega = W (phi_dot, theta_dot, psi_dot).

    Raises
    ------
    SchemaError
        An angle is missing.
    """
    names = ("phi", "theta", "psi")
    angles = np.stack(_read_channels(data, *names), axis=1)
    slopes, errors = _differentiate_channels(data, names)
    omega, _ = body_rates_from_angles(angles, np.stack(slopes, axis=1))
    return _make_dataset(
        data,
        dict(zip("pqr", omega.T, strict=True)),
        errors=dict(zip("pqr", errors, strict=True)),
        origin="derivatives of phi theta psi",
        bandwidth=_bandwidth(data, *names),
    )


def forces_from_velocity(data: xr.Dataset, latitude: float | None = None) -> xr.Dataset:
    """Return the specific force at the c.g., ``ax ay az``, from ground velocity and attitude.

    The force is R'(v_dot - g), with velocity ``vn ve vd``.

    Parameters
    ----------
    data : Dataset (time,)
        The Earth is flat: the Coriolis acceleration, 0.01 m/s2 at 100 m/s, is neglected. Gravity
        belongs to the mean of the first height among ``h h_gps h_baro``, or to sea level.
    latitude : float, optional
        For gravity; standard gravity without it. [rad]

    Returns
    -------
    Dataset (time,)
        The standard error combines the noise of the differentiated velocity and g times the noise
        of the attitude.

    Raises
    ------
    SchemaError
        A velocity or an angle is missing.
    """
    names = ("vn", "ve", "vd")
    angles = np.stack(_read_channels(data, "phi", "theta", "psi"), axis=1)
    _check_channels(data, *names)
    g = gravity(latitude, _mean_height(data))
    slopes, errors = _differentiate_channels(data, names)
    free = np.stack(slopes, axis=1) - [0.0, 0.0, g]
    force = np.einsum("tji,tj->ti", body_to_ned_rotation(angles), free)
    # In level flight a small tilt changes ax and ay by g times the angle, and az not at all.
    tilt = g * np.array([_channel_noise(data, "theta"), _channel_noise(data, "phi"), 0.0])
    total_error = np.hypot(rms(errors), tilt)
    axes = ("ax", "ay", "az")
    return _make_dataset(
        data,
        dict(zip(axes, force.T, strict=True)),
        errors=dict(zip(axes, total_error, strict=True)),
        origin="derivatives of vn ve vd, attitude and gravity",
        bandwidth=_bandwidth(data, *names),
    )


def airspeed_from_pressures(data: xr.Dataset) -> xr.Dataset:
    """Return ``V mach rho qbar`` from impact pressure, static pressure and static temperature.

    Raises
    ------
    SchemaError
        ``q_c``, ``p_static`` or ``temperature`` is missing.
    """
    names = ("q_c", "p_static", "temperature")
    q_c, p, T = _read_channels(data, *names)
    dq, dp, dT = (_channel_noise(data, name) for name in names)
    values = _air_data(q_c, p, T)
    # the values with one standard deviation of noise in one input each
    disturbed = [_air_data(q_c + dq, p, T), _air_data(q_c, p + dp, T), _air_data(q_c, p, T + dT)]
    errors = {}
    for name, x in values.items():
        variance = sum((air[name] - x) ** 2 for air in disturbed)
        errors[name] = rms(np.sqrt(variance))
    return _make_dataset(data, values, errors=errors, origin="q_c p_static temperature")


def incidence_from_velocity(
    data: xr.Dataset, wind: Sequence[float] = (0.0, 0.0, 0.0), wind_error: float = _WIND_ERROR
) -> xr.Dataset:
    """Return ``V alpha beta`` without vanes and pitot, from ground velocity, wind and attitude.

    Parameters
    ----------
    data : Dataset (time,)
        ``vn ve vd phi theta psi``.
    wind : sequence (3,)
        Velocity of the air mass: north, east, down. [m s-1]
    wind_error : float
        Standard error of each component of the wind. Its effect on the angles is wind_error/V.
        [m s-1]

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    SchemaError
        A velocity or an angle is missing.
    """
    velocity = np.stack(_read_channels(data, "vn", "ve", "vd"), axis=1)
    angles = np.stack(_read_channels(data, "phi", "theta", "psi"), axis=1)
    # air-relative velocity in body axes, R'(v - wind)
    R = body_to_ned_rotation(angles)
    u, v, w = np.einsum("tji,tj->ti", R, velocity - np.asarray(wind, float)).T
    V = np.sqrt(u**2 + v**2 + w**2)
    values = {
        "V": V,
        "alpha": np.arctan2(w, u),
        "beta": np.arcsin(np.clip(v / np.maximum(V, _LEAST_SPEED), -1.0, 1.0)),
    }
    velocity_noise = rms([_channel_noise(data, name) for name in ("vn", "ve", "vd")])
    speed_error = float(np.hypot(wind_error, velocity_noise))
    angle_error = speed_error / rms(V)
    errors = {
        "V": speed_error,
        "alpha": float(np.hypot(angle_error, _channel_noise(data, "theta"))),
        "beta": float(np.sqrt(angle_error**2 + _channel_noise(data, "psi") ** 2)),
    }
    components = ", ".join(f"{x:g}" for x in wind)
    origin = f"vn ve vd less wind ({components}) m/s, attitude"
    return _make_dataset(data, values, errors=errors, origin=origin)


def add_derived_channels(
    data: xr.Dataset, wind: Sequence[float] = (0.0, 0.0, 0.0), wind_error: float = _WIND_ERROR
) -> xr.Dataset:
    """Return a manoeuvre with all missing channels that follow from its channels.

    Measured channels are not replaced.

    Parameters
    ----------
    data : Dataset (time,)
        See `cut`.
    wind, wind_error
        As in `incidence_from_velocity`.

    Returns
    -------
    Dataset (time,)
        New variables carry ``made_from`` and ``stderr``.
    """
    completed = data.copy()
    derivations = (
        airspeed_from_pressures,
        rates_from_attitude,
        angular_accelerations,
        forces_from_velocity,
        lambda channels: incidence_from_velocity(channels, wind, wind_error),
    )
    for derive in derivations:
        try:
            derived = derive(completed)
        except SchemaError:
            # an input is missing
            continue
        missing = {name: x for name, x in derived.data_vars.items() if name not in completed}
        completed = completed.assign(missing)
    return completed


def _check_channels(data: xr.Dataset, *names: str) -> None:
    missing = [name for name in names if name not in data]
    if missing:
        needed = " ".join(names)
        raise SchemaError(
            "manoeuvre",
            [f"no channel {name}; all of {needed} are needed" for name in missing],
        )


def _read_channels(data: xr.Dataset, *names: str) -> list[np.ndarray]:
    _check_channels(data, *names)
    return [_read_channel(data, name) for name in names]


def _read_channel(data: xr.Dataset, name: str) -> np.ndarray:
    x = np.asarray(data[name].values, float)
    if name in WRAPPED:
        return np.unwrap(x)
    return x


def _mean_height(data: xr.Dataset) -> float:
    """Return the mean of the first height of a manoeuvre; zero without one. [m]"""
    for name in ("h", "h_gps", "h_baro"):
        if name in data:
            return float(np.nanmean(data[name].values))
    return 0.0


def _recorded_samples(data: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return clock, samples and step of a channel at the rate of its recorder.

    Why: interpolated samples have no information of their own.
    """
    time = data["time"].values
    step = float(time[-1] - time[0]) / (len(time) - 1)
    recorded_step = 1.0 / data[name].attrs.get("recorded_rate", 1.0 / step)
    # A recorder as fast as the manoeuvre: nothing was interpolated.
    if recorded_step < 1.01 * step:
        return time, _read_channel(data, name), step
    count = int((time[-1] - time[0]) / recorded_step + 1e-6) + 1
    clock = time[0] + recorded_step * np.arange(count)
    return clock, resample(time, _read_channel(data, name), clock, name), recorded_step


def _differentiate_channels(
    data: xr.Dataset, names: Sequence[str]
) -> tuple[list[np.ndarray], list[float]]:
    """Return the derivatives of channels and their standard errors."""
    slopes, errors = [], []
    for name in names:
        clock, x, step = _recorded_samples(data, name)
        slope = derivative(x, step)
        if len(clock) != data.sizes["time"]:
            slope = resample(clock, slope, data["time"].values, name)
        slopes.append(slope)
        errors.append(fourier_smooth(x, step).noise * derivative_noise(step))
    return slopes, errors


def _channel_noise(data: xr.Dataset, name: str) -> float:
    """Return the standard deviation of the noise of a channel."""
    _, x, step = _recorded_samples(data, name)
    return fourier_smooth(x, step).noise


def _bandwidth(data: xr.Dataset, *names: str) -> float:
    """Return the frequency up to which the derivative of the slowest channel is exact to 1 %.
    [Hz]
    """
    # The recorder with the largest step has the smallest bandwidth.
    step = max(_recorded_samples(data, name)[2] for name in names)
    f = np.linspace(0.0, 0.5, 501)[1:] / step
    return float(f[derivative_gain(f, step) > _FULL_GAIN][-1])


def _air_data(q_c: np.ndarray, p: np.ndarray, T: np.ndarray) -> dict[str, np.ndarray]:
    mach = mach_number(np.maximum(q_c, 0.0), p)
    rho = p / (R_AIR * T)
    V = mach * np.sqrt(GAMMA * R_AIR * T)
    return {"V": V, "mach": mach, "rho": rho, "qbar": 0.5 * rho * V**2}


def _make_dataset(
    data: xr.Dataset,
    values: dict[str, np.ndarray],
    errors: dict[str, float],
    origin: str,
    bandwidth: float | None = None,
) -> xr.Dataset:
    """Return derived channels with their origin and standard error as attributes."""
    channels = xr.Dataset(coords={"time": data["time"]})
    for name, x in values.items():
        attributes: dict[str, Any] = {**quantity_attributes(name), "made_from": origin}
        attributes["stderr"] = float(errors[name])
        if bandwidth:
            attributes["bandwidth"] = bandwidth
        channels[name] = "time", x, attributes
    return channels
