"""A flight that is kinematically exact, and what instruments with known errors record of it."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from flightmech.air import impact_pressure
from flighttest.reconstruction.dynamics.kinematics import (
    EARTH_RADIUS,
    body_to_ned_rotation,
    gravity,
    rate_matrix,
)

sys.path.insert(0, str(Path(__file__).parent))  # for the helpers next to the tests
sys.path.append(
    str(Path(__file__).parents[2] / "benchmarks")
)  # for the studies that tests run in small

RATE = 50.0
IMU, BOOM = np.array([0.9, 0.25, 0.32]), np.array([4.3, 0.0, 0.15])
NOISE = {
    "p": 6e-4, "q": 6e-4, "r": 6e-4, "phi": 5e-4, "theta": 5e-4, "psi": 8e-4, "ax_imu": 0.025,
    "ay_imu": 0.025, "az_imu": 0.04,
    "alpha_vane": 1.5e-3, "beta_vane": 1.5e-3, "p_static": 5.0, "q_c": 12.0, "temperature": 0.05,
    "vn": 0.05, "ve": 0.05, "vd": 0.08, "h_gps": 0.5, "h_radio": 0.1,
}  # fmt: skip
BIAS = {
    "p": 5e-4, "q": 5e-4, "r": 5e-4, "phi": 1e-3, "theta": 1e-3, "psi": 2e-3, "ax_imu": 0.04,
    "ay_imu": 0.04, "az_imu": 0.05,
    "alpha_vane": 8e-3, "beta_vane": 8e-3, "q_c": 8.0, "temperature": 0.5,
}  # fmt: skip
INSTRUMENTS = {
    "imu": {
        "position": list(IMU),
        "noise": {
            k: NOISE[k]
            for k in ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu")
        },
        "bias_sigma": {
            k: BIAS[k] for k in ("p", "q", "r", "phi", "theta", "psi", "ax_imu", "ay_imu", "az_imu")
        },
    },
    "vanes": {
        "position": list(BOOM),
        "noise": {k: NOISE[k] for k in ("alpha_vane", "beta_vane")},
        "bias_sigma": {k: BIAS[k] for k in ("alpha_vane", "beta_vane")},
        "factor": {"alpha_vane": [1.08, 0.04], "beta_vane": [1.05, 0.04]},
        "lag": [0.05, 0.015],
    },
    "air_data": {
        "noise": {k: NOISE[k] for k in ("p_static", "q_c", "temperature")},
        "bias_sigma": {k: BIAS[k] for k in ("q_c", "temperature")},
        "static_error": [0.0, 0.02],
        "delay": [0.12, 0.03],
    },
    "gps": {"noise": {k: NOISE[k] for k in ("vn", "ve", "vd", "h_gps")}, "delay": [0.15, 0.03]},
}


def spline(time, x):
    return CubicSpline(time, x, axis=0)


def path(duration, rng, gust=0.0, motion=1.0):
    """Return time, attitude, rates, accelerations, specific force, air-relative velocity, ground
    velocity, height, wind.
    """
    t = np.arange(round(duration * RATE) + 1) / RATE

    def wave(*parts):
        return motion * sum(a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in parts)

    V = 85.0 + wave((12.0, 0.02, 0.3), (1.0, 0.1, 1.0))
    alpha = 0.06 + wave((0.03, 0.35, 0.0), (0.02, 0.9, 1.0), (0.02, 0.06, 2.0))
    beta = wave((0.04, 0.3, 0.5), (0.02, 0.7, 2.0))
    attitude = np.stack(
        [
            wave((0.3, 0.1, 0.0), (0.1, 0.5, 1.0)),
            0.06 + wave((0.06, 0.3, 0.4), (0.05, 0.05, 0.0)),
            1.5 + wave((0.6, 0.02, 0.0)),
        ],
        1,
    )
    wind = np.tile([4.0, -3.0, 0.0], (len(t), 1))
    if gust:
        keep = np.exp(-1.0 / (RATE * 1.5))
        drive = rng.normal(0.0, gust * np.sqrt(1 - keep**2), (len(t), 3))
        wind = wind + lfilter([1.0], [1.0, -keep], drive, axis=0)
    air = np.stack(
        [V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)], 1
    )
    R = body_to_ned_rotation(attitude)
    steady = (R @ air[..., None])[..., 0] + [
        4.0,
        -3.0,
        0.0,
    ]  # the aeroplane does not follow the gusts
    air = ((steady - wind)[:, None, :] @ R)[:, 0]
    acceleration = spline(t, steady)(t, 1)
    omega = (rate_matrix(attitude) @ spline(t, attitude)(t, 1)[..., None])[..., 0]
    height = 1500.0 - spline(t, steady[:, 2]).antiderivative()(t)
    acceleration[:, 2] -= gravity(None, 0.0) * (1.0 - 2.0 * height / EARTH_RADIUS)
    force = (acceleration[:, None, :] @ R)[:, 0]
    return SimpleNamespace(
        time=t, attitude=attitude, omega=omega, omega_dot=spline(t, omega)(t, 1), force=force,
        air=air, velocity=steady, h=height, wind=wind
    )  # fmt: skip


def lag(x, tau):
    """First-order lag of an input linear between samples, as a recursion."""
    y, keep = np.array(x, float), np.exp(-1.0 / (RATE * tau))
    for i in range(1, len(x)):
        slope = (x[i] - x[i - 1]) * RATE * tau
        y[i] = x[i] - slope + (y[i - 1] - x[i - 1] + slope) * keep
    return y


def errors(rng):
    """Draw errors of the instruments from the priors of their specification."""
    found = {f"bias.{name}": rng.normal(0.0, sigma) for name, sigma in BIAS.items()}
    for name, (mean, sigma) in INSTRUMENTS["vanes"]["factor"].items():
        found[f"factor.{name}"] = rng.normal(mean, sigma)
    found["lag.vanes"] = rng.normal(0.05, 0.01)
    found["static_error"] = rng.normal(0.0, 0.02)
    found["delay.air_data"], found["delay.gps"] = rng.normal(0.12, 0.03), rng.normal(0.15, 0.03)
    return found


def leaf(time, **channels):
    data = xr.Dataset({name: ("time", x) for name, x in channels.items()}, coords={"time": time})
    data.attrs["rate"] = 1.0 / float(np.median(np.diff(time)))
    return data


def fly(seed=0, duration=40.0, gust=0.0, noise=1.0, inertial_noise=1.0, motion=1.0, error=None):
    """Return a record, its instrument errors, and the truth as a Dataset."""
    rng = np.random.default_rng(seed)
    true, error = path(duration, rng, gust, motion), error or errors(rng)
    t, omega = true.time, true.omega
    turned = np.cross(true.omega_dot, IMU) + np.cross(omega, np.cross(omega, IMU))
    sensed = dict(zip(("ax_imu", "ay_imu", "az_imu"), (true.force + turned).T, strict=True))
    sensed.update(zip("pqr", omega.T, strict=True))
    sensed.update(zip(("phi", "theta", "psi"), true.attitude.T, strict=True))
    u, v, w = (true.air + np.cross(omega, BOOM)).T
    sensed["alpha_vane"] = error["factor.alpha_vane"] * lag(np.arctan2(w, u), error["lag.vanes"])
    sensed["beta_vane"] = error["factor.beta_vane"] * lag(np.arctan2(v, u), error["lag.vanes"])
    T = 280.0 - 0.0065 * (true.h - 1500.0)
    p = 84000.0 * (1.0 - 0.0065 * (true.h - 1500.0) / 280.0) ** (
        gravity(None, 1500.0) / (287.05287 * 0.0065)
    )
    V = np.linalg.norm(true.air, axis=1)
    q_c = impact_pressure(V / np.sqrt(1.4 * 287.05287 * T), p)
    sensed["q_c"], sensed["p_static"], sensed["temperature"] = (
        q_c * (1 - error["static_error"]),
        p + error["static_error"] * q_c,
        T,
    )
    sensed.update(zip(("vn", "ve", "vd"), true.velocity.T, strict=True), h_gps=true.h)

    def level(name):
        return (
            noise * inertial_noise
            if name in ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
            else noise
        )

    def record(names, rate, delay=0.0):
        clock = np.arange(0.0, t[-1] + 1e-9, 1.0 / rate)
        shown = {
            n: np.interp(clock - delay, t, sensed[n])
            + error.get(f"bias.{n}", 0.0)
            + rng.normal(0.0, level(n) * NOISE[n], len(clock))
            for n in names.split()
        }
        return leaf(clock, **shown)

    leaves = {
        "imu": record("p q r phi theta psi ax_imu ay_imu az_imu", RATE),
        "vanes": record("alpha_vane beta_vane", RATE),
        "air_data": record("p_static q_c temperature", RATE, error["delay.air_data"]),
        "gps": record("vn ve vd h_gps", 5.0, error["delay.gps"]),
        "controls": leaf(t, delta_e=0.05 * np.sin(t), **{"engine1.thrust": 3000.0 + 0.0 * t}),
    }
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={"title": f"simulated {seed}"}),
            **{f"/{k}": d for k, d in leaves.items()},
        }
    )
    truth = xr.Dataset(coords={"time": t})
    columns = {
        "V": V,
        "alpha": np.arctan2(true.air[:, 2], true.air[:, 0]),
        "beta": np.arcsin(true.air[:, 1] / V),
        **dict(zip(("phi", "theta", "psi"), true.attitude.T, strict=True)),
        **dict(zip(("vn", "ve", "vd"), true.velocity.T, strict=True)),
        "h": true.h,
    }
    for name, x in {
        **columns,
        "rho": p / (287.05287 * T),
        "az": true.force[:, 2],
        "q_dot": true.omega_dot[:, 1],
    }.items():
        truth[name] = "time", x
    return tree, error, truth


@pytest.fixture(scope="session")
def flown():
    return fly


@pytest.fixture(scope="session")
def aircraft():
    return SimpleNamespace(
        name="test",
        S=17.0,
        cbar=1.7,
        b=10.3,
        mass=2100.0,
        cg=(0.0, 0.0, 0.0),
        instruments=INSTRUMENTS,
        engines=(),
        fuel=None,
    )
