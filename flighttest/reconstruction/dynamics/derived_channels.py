"""Signals that were not measured, from those that were, each with an error figure.

Every function takes a manoeuvre (channels on one uniform clock, see `cut`) and returns a Dataset of
what it computed.  Each variable states in its attributes what it is made of (``made_from``), its
standard error (``stderr``, SI) and, where something was differentiated, the frequency up to which
it follows to 1 % (``bandwidth``, Hz).  The error is noise carried through, with the noise of each
input found by Fourier smoothing at the rate at which it was recorded, and what is unknown by
assumption (wind).  Lasting errors of the inputs (biases, a wrong wind) are not in it: reconstruct
the path (`reconstruct`) when they matter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, mach_number
from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
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

_WIND_ERROR = 1.0  # m/s, of a wind that nobody gave


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
    _demand(data, "p", "q", "r")
    found = {f"{name}_dot": _differentiated(data, name) for name in "pqr"}
    made, error = (
        {name: x for name, (x, _) in found.items()},
        {name: sigma for name, (_, sigma) in found.items()},
    )
    return _dataset(
        data, made, error, "local polynomials over p q r", _bandwidth(data, "p", "q", "r")
    )


def rates_from_attitude(data: xr.Dataset) -> xr.Dataset:
    """Return ``p q r`` from ``phi theta psi``: omega = W (phi_dot, theta_dot, psi_dot).

    Raises
    ------
    SchemaError
        An angle is missing.
    """
    names = ("phi", "theta", "psi")
    angles = np.stack(_channels(data, *names), axis=1)
    turned = [_differentiated(data, name) for name in names]
    omega, _ = body_rates_from_angles(angles, np.stack([x for x, _ in turned], axis=1))
    error = dict(zip("pqr", (sigma for _, sigma in turned)))
    return _dataset(
        data,
        dict(zip("pqr", omega.T)),
        error,
        "derivatives of phi theta psi",
        _bandwidth(data, *names),
    )


def forces_from_velocity(data: xr.Dataset, latitude: float | None = None) -> xr.Dataset:
    """Return the specific force at the c.g., ``ax ay az``, from ground velocity ``vn ve vd`` and
    attitude: R'(v_dot - g).

    Parameters
    ----------
    data : Dataset (time,)
        Flat Earth: Coriolis acceleration, 0.01 m/s2 at 100 m/s, is left out.  Gravity falls with
        the height, the first of ``h h_gps h_baro`` that is there; without one it is that of sea
        level.
    latitude : float, optional
        For gravity; standard gravity without it. [rad]

    Returns
    -------
    Dataset (time,)
        The error figure joins the noise of the velocity, differentiated, and g times that of the
        attitude.

    Raises
    ------
    SchemaError
        A velocity or an angle is missing.
    """
    names = ("vn", "ve", "vd")
    angles = np.stack(_channels(data, "phi", "theta", "psi"), axis=1)
    _demand(data, *names)
    heights = [data[name].values for name in ("h", "h_gps", "h_baro") if name in data]
    g = gravity(latitude, float(np.nanmean(heights[0])) if heights else 0.0)
    turned = [_differentiated(data, name) for name in names]
    rate = np.stack([x for x, _ in turned], axis=1) - [0.0, 0.0, g]
    force = np.einsum("tji,tj->ti", body_to_ned_rotation(angles), rate)
    tilt = g * np.array(
        [_noise(data, "theta"), _noise(data, "phi"), 0.0]
    )  # about level flight, where az does not see the attitude
    error = np.hypot(rms([sigma for _, sigma in turned]), tilt)
    axes = ("ax", "ay", "az")
    origin = "derivatives of vn ve vd, attitude and gravity"
    return _dataset(
        data, dict(zip(axes, force.T)), dict(zip(axes, error)), origin, _bandwidth(data, *names)
    )


def airspeed_from_pressures(data: xr.Dataset) -> xr.Dataset:
    """Return ``V mach rho qbar`` from impact pressure, static pressure and static temperature.

    Raises
    ------
    SchemaError
        ``q_c``, ``p_static`` or ``temperature`` is missing.
    """
    q_c, p, T = _channels(data, "q_c", "p_static", "temperature")
    dq, dp, dT = (_noise(data, name) for name in ("q_c", "p_static", "temperature"))
    made = _air(q_c, p, T)
    moved = [_air(q_c + dq, p, T), _air(q_c, p + dp, T), _air(q_c, p, T + dT)]
    error = {name: rms(np.sqrt(sum((m[name] - x) ** 2 for m in moved))) for name, x in made.items()}
    return _dataset(data, made, error, "q_c p_static temperature")


def incidence_from_velocity(
    data: xr.Dataset, wind: Sequence[float] = (0.0, 0.0, 0.0), wind_error: float = _WIND_ERROR
) -> xr.Dataset:
    """Return ``V alpha beta`` without vanes and pitot: ground velocity less wind, turned into body
    axes.

    Parameters
    ----------
    data : Dataset (time,)
        ``vn ve vd phi theta psi``.
    wind : sequence (3,)
        Velocity of the air mass: north, east, down. [m s-1]
    wind_error : float
        Standard error of each of its components; it goes into the angles as wind_error/V. [m s-1]

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    SchemaError
        A velocity or an angle is missing.
    """
    velocity, angles = _channels(data, "vn", "ve", "vd"), _channels(data, "phi", "theta", "psi")
    R = body_to_ned_rotation(np.stack(angles, axis=1))
    u, v, w = np.einsum("tji,tj->ti", R, np.stack(velocity, axis=1) - np.asarray(wind, float)).T
    V = np.sqrt(u**2 + v**2 + w**2)
    speed = float(np.hypot(wind_error, rms([_noise(data, name) for name in ("vn", "ve", "vd")])))
    theta, psi = (_noise(data, name) for name in ("theta", "psi"))
    turned = speed / rms(V)
    error = {
        "V": speed,
        "alpha": float(np.hypot(turned, theta)),
        "beta": float(np.sqrt(turned**2 + psi**2)),
    }
    made = {
        "V": V,
        "alpha": np.arctan2(w, u),
        "beta": np.arcsin(np.clip(v / np.maximum(V, 1e-6), -1.0, 1.0)),
    }
    return _dataset(
        data, made, error, f"vn ve vd less wind ({', '.join(f'{x:g}' for x in wind)}) m/s, attitude"
    )


def add_derived_channels(
    data: xr.Dataset, wind: Sequence[float] = (0.0, 0.0, 0.0), wind_error: float = _WIND_ERROR
) -> xr.Dataset:
    """Return a manoeuvre with everything added that it lacks and that follows from what it has;
    nothing measured is replaced.

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
    found = data.copy()
    ways = (
        airspeed_from_pressures,
        rates_from_attitude,
        angular_accelerations,
        forces_from_velocity,
        lambda d: incidence_from_velocity(d, wind, wind_error),
    )
    for way in ways:
        try:
            made = way(found)
        except SchemaError:
            continue
        found = found.assign({name: x for name, x in made.data_vars.items() if name not in found})
    return found


def _demand(data: xr.Dataset, *names: str) -> None:
    missing = [name for name in names if name not in data]
    if missing:
        raise SchemaError(
            "manoeuvre",
            [f"no channel {name}; all of {' '.join(names)} are needed" for name in missing],
        )


def _channels(data: xr.Dataset, *names: str) -> list[np.ndarray]:
    _demand(data, *names)
    return [_values(data, name) for name in names]


def _values(data: xr.Dataset, name: str) -> np.ndarray:
    x = np.asarray(data[name].values, float)
    return np.unwrap(x) if name == "psi" else x


def _as_recorded(data: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return clock, samples and step of a channel at the rate of its recorder: interpolated samples
    are not news.
    """
    time = data["time"].values
    step = float(time[-1] - time[0]) / (len(time) - 1)
    recorded = 1.0 / data[name].attrs.get("recorded_rate", 1.0 / step)
    if recorded < 1.01 * step:
        return time, _values(data, name), step
    clock = time[0] + recorded * np.arange(int((time[-1] - time[0]) / recorded + 1e-6) + 1)
    return clock, resample(time, _values(data, name), clock, name), recorded


def _differentiated(data: xr.Dataset, name: str) -> tuple[np.ndarray, float]:
    """Return the derivative of a channel and the standard error that its noise gives it."""
    clock, x, step = _as_recorded(data, name)
    slope = derivative(x, step)
    return slope if len(clock) == data.sizes["time"] else resample(
        clock, slope, data["time"].values, name
    ), (fourier_smooth(x, step).noise * derivative_noise(step))


def _noise(data: xr.Dataset, name: str) -> float:
    _, x, step = _as_recorded(data, name)
    return fourier_smooth(x, step).noise


def _bandwidth(data: xr.Dataset, *names: str) -> float:
    """Return the frequency at which the derivative of the slowest of `names` has lost one per cent.
    [Hz]
    """
    step = max(_as_recorded(data, name)[2] for name in names)
    f = np.linspace(0.0, 0.5, 501)[1:] / step
    return float(f[derivative_gain(f, step) > 0.99][-1])


def _air(q_c: np.ndarray, p: np.ndarray, T: np.ndarray) -> dict[str, np.ndarray]:
    mach = mach_number(np.maximum(q_c, 0.0), p)
    rho = p / (R_AIR * T)
    V = mach * np.sqrt(GAMMA * R_AIR * T)
    return {"V": V, "mach": mach, "rho": rho, "qbar": 0.5 * rho * V**2}


def _dataset(
    data: xr.Dataset,
    made: dict[str, np.ndarray],
    error: dict[str, float],
    origin: str,
    bandwidth: float | None = None,
) -> xr.Dataset:
    found = xr.Dataset(coords={"time": data["time"]})
    for name, x in made.items():
        about = {"made_from": origin, "stderr": float(error[name])} | (
            {"bandwidth": bandwidth} if bandwidth else {}
        )
        found[name] = "time", x, {**quantity_attributes(name), **about}
    return found
