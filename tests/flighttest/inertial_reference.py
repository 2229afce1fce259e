"""A flight in closed form, with the record that a near-perfect inertial reference and uncalibrated
air data make of it.

Attitude and air-relative velocity are sums of elementary functions of time, so rates, accelerations
and specific force follow by complex-step differentiation without any discretisation [Squire1998];
height is the integral of the vertical velocity by Gauss's rule.

References
----------
.. [Squire1998] Squire, Trapp, Using Complex Variables to Estimate Derivatives of Real Functions,
   SIAM Rev. 40, 1998.
"""

from types import SimpleNamespace

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, calibrated_airspeed, impact_pressure
from flighttest.reconstruction.dynamics.kinematics import (
    EARTH_RADIUS,
    body_to_ned_rotation,
    earth_rotation,
    gravity,
    rate_matrix,
)

RATE = 100.0
IMU, BOOM, PITOT = np.array([0.6, 0.1, 0.2]), np.array([5.0, 0.3, 0.1]), np.array([5.2, -0.4, 0.2])
DEGREE = np.pi / 180.0
START, LEVEL, LAPSE, P_LEVEL = (
    2000.0,
    275.15,
    0.0065,
    79500.0,
)  # m, K, K/m, Pa: height, temperature and pressure at the start
NOISE = {
    "p": 0.0012 * DEGREE, "q": 0.0012 * DEGREE, "r": 0.0012 * DEGREE, "ax_imu": 0.004,
    "ay_imu": 0.004, "az_imu": 0.006,
    "phi": 0.02 * DEGREE, "theta": 0.02 * DEGREE, "psi": 0.03 * DEGREE, "alpha_vane": 0.05 * DEGREE,
    "beta_vane": 0.05 * DEGREE,
    "vn": 0.05, "ve": 0.05, "vd": 0.05, "h_gps": 0.5, "V": 0.05, "V_cas": 0.05, "mach": 2e-4,
    "q_c": 4.0, "p_static": 5.0,
    "temperature": 0.02,
}  # fmt: skip
TURN = 1.2  # rad, half of the change of heading
INERTIAL = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
SPREAD = {"p": 0.01 * DEGREE, "q": 0.01 * DEGREE, "r": 0.01 * DEGREE, "ax_imu": 0.05,
    "ay_imu": 0.05, "az_imu": 0.05,
          "alpha_vane": 2.0 * DEGREE, "beta_vane": 2.0 * DEGREE}  # fmt: skip
SPEED_SPREAD = {"V": 1.0, "V_cas": 1.0, "mach": 0.003, "q_c": 30.0}


def aircraft(speed: str = "V", placed: bool = True, **more) -> SimpleNamespace:
    """Return the aircraft with the specification of its instruments; `speed` names the channel that
    shows the airspeed.

    `placed` states where the pitot tube is; `more` adds to the tables of the instruments.
    """
    pressures = ("q_c", "p_static") if speed == "q_c" else ()
    tables = {
        "irs": {
            "position": list(IMU),
            "noise": {k: NOISE[k] for k in (*INERTIAL, "phi", "theta", "psi")},
            "bias_sigma": {k: SPREAD[k] for k in INERTIAL},
        },
        "vanes": {
            "position": list(BOOM),
            "noise": {k: NOISE[k] for k in ("alpha_vane", "beta_vane")},
            "bias_sigma": {k: SPREAD[k] for k in ("alpha_vane", "beta_vane")},
            "factor": {"alpha_vane": [1.0, 0.2], "beta_vane": [1.0, 0.2]},
            "lag": [0.0, 1e-4],
        },
        "pitot": {
            "noise": {k: NOISE[k] for k in pressures or (speed,)},
            "bias_sigma": {speed: SPEED_SPREAD[speed]},
        },
        "navigation": {"noise": {k: NOISE[k] for k in ("vn", "ve", "vd", "h_gps")}},
    }
    if speed == "q_c":
        tables["pitot"]["static_error"] = [0.0, 0.03]
    else:
        tables["pitot"]["factor"] = {speed: [1.0, 0.03]}
    if placed:
        tables["pitot"]["position"] = list(PITOT)
    for name, table in more.items():
        tables[name] = {**tables.get(name, {}), **table}
    return SimpleNamespace(
        name="test",
        S=17.0,
        cbar=1.7,
        b=10.3,
        mass=2100.0,
        cg=(0.0, 0.0, 0.0),
        instruments=tables,
        engines=(),
        fuel=None,
    )


def _packet(t, size, at, width, f, phase):
    return (
        size * np.exp(-0.5 * ((t - at) / width) ** 2) * np.sin(2.0 * np.pi * f * (t - at) + phase)
    )


def trajectory(rng, duration: float, excitation: float = 1.0) -> SimpleNamespace:
    """Return functions of (complex) time: attitude (3,) and its rate, air-relative velocity in body
    axes (3,).
    """

    def packets(size, width, frequency, count):
        parts = [
            (excitation * size * rng.uniform(0.6, 1.2),
             duration * (i + rng.uniform(0.2, 0.8)) / count, width * rng.uniform(0.8, 1.2),
             frequency * rng.uniform(0.8, 1.2), rng.uniform(0.0, 2.0 * np.pi)) for i in range(count)
        ]  # fmt: skip
        return lambda t: sum(_packet(t, *part) for part in parts)

    short, dutch = packets(0.05, 1.2, 0.5, 5), packets(0.06, 1.5, 0.4, 4)
    rolls, climb = packets(0.6, 1.5, 0.25, 4), packets(0.06, 4.0, 0.08, 3)
    sway, course, side = packets(0.02, 1.5, 0.4, 4), rng.uniform(-3.0, 3.0), rng.choice([-1.0, 1.0])
    fast = packets(14.0, 9.0, 0.03, 2)

    def V(t):
        return 95.0 + fast(t)

    def alpha(t):
        return 0.07 * (95.0 / V(t)) ** 2 + short(t)

    def heading(t):
        return course + side * excitation * TURN * np.tanh((t - duration / 2.0) / (0.2 * duration))

    def attitude(t):
        turn = (
            side
            * excitation
            * TURN
            / (0.2 * duration)
            / np.cosh((t - duration / 2.0) / (0.2 * duration)) ** 2
        )
        return np.stack(
            [np.arctan(V(t) * turn / 9.8) + rolls(t), alpha(t) + climb(t), heading(t) + sway(t)],
            axis=-1,
        )

    def air(t):
        a, b = alpha(t), dutch(t)
        return V(t)[..., None] * np.stack(
            [np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)], axis=-1
        )

    return SimpleNamespace(attitude=attitude, air=air)


_STEP = 1e-30


def _slope(function, t):
    return function(t + 1j * _STEP).imag / _STEP


def _second(function, t):
    """Return the second derivative: central differences of eighth order over exact first ones."""
    h, weights = 5e-3, (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
    return (
        sum(
            w * (_slope(function, t + k * h) - _slope(function, t - k * h))
            for k, w in enumerate(weights, 1)
        )
        / h
    )


def motion(rng, duration: float, wind, excitation: float = 1.0) -> SimpleNamespace:
    """Return the true motion: function of time for each quantity, the air moving steadily with
    `wind`.
    """
    flown = trajectory(rng, duration, excitation)

    def velocity(t):
        return (body_to_ned_rotation(flown.attitude(t)) @ flown.air(t)[..., None])[..., 0] + wind

    def omega(t):
        return (rate_matrix(flown.attitude(t)) @ _slope(flown.attitude, t)[..., None])[..., 0]

    def omega_dot(t):
        angles, slope, bend = (
            flown.attitude(t),
            _slope(flown.attitude, t),
            _second(flown.attitude, t),
        )
        change = rate_matrix(angles + 1j * _STEP * slope).imag / _STEP
        return (rate_matrix(angles) @ bend[..., None] + change @ slope[..., None])[..., 0]

    edges = np.arange(round(duration * RATE) + 1) / RATE
    nodes, weights = np.polynomial.legendre.leggauss(5)
    inner = edges[:-1, None] + (nodes + 1.0) / (2.0 * RATE)
    fallen = (velocity(inner.ravel())[:, 2].reshape(inner.shape) @ weights) / (2.0 * RATE)
    return SimpleNamespace(
        t=edges, attitude=flown.attitude(edges), omega=omega(edges), omega_dot=omega_dot(edges),
        air=flown.air(edges),
        velocity=velocity(edges), acceleration=_slope(velocity, edges),
        h=START - np.concatenate([[0.0], np.cumsum(fallen)]),
    )  # fmt: skip


def draw_errors(rng, speed: str = "V") -> dict[str, float]:
    """Return biases, factors and winds, drawn from the priors; the factors of the vanes uniform
    within 0.2.
    """
    found = {f"bias.{name}": rng.normal(0.0, sigma) for name, sigma in SPREAD.items()}
    found.update(
        {f"factor.{name}": 1.0 + rng.uniform(-0.2, 0.2) for name in ("alpha_vane", "beta_vane")}
    )
    found[f"bias.{speed}"] = rng.normal(0.0, SPEED_SPREAD[speed])
    found["static_error" if speed == "q_c" else f"factor.{speed}"] = rng.normal(
        0.0 if speed == "q_c" else 1.0, 0.03
    )
    found.update(
        wind_n=rng.normal(0.0, 8.0), wind_e=rng.normal(0.0, 8.0), wind_d=rng.normal(0.0, 0.2)
    )
    return found


def leaf(time, channels: dict[str, np.ndarray]) -> xr.Dataset:
    data = xr.Dataset({name: ("time", x) for name, x in channels.items()}, coords={"time": time})
    data.attrs["rate"] = RATE
    return data


def fly(
    seed: int = 0,
    duration: float = 60.0,
    speed: str = "V",
    noise: float = 1.0,
    given=None,
    facts=None,
):
    """Return a record, its errors and the truth.

    `given` replaces single errors, ``excitation`` among them (size of all movements); `facts` are
    attributes of the record; with ``latitude`` the Earth is round and turns, and the gyros show its
    rate.
    """
    rng = np.random.default_rng(seed)
    error = {**draw_errors(rng, speed), **(given or {})}
    wind = np.array([error["wind_n"], error["wind_e"], error["wind_d"]])
    true = motion(rng, duration, wind, error.get("excitation", 1.0))
    R = body_to_ned_rotation(true.attitude)
    latitude = (facts or {}).get("latitude")
    spin, transport = earth_rotation(latitude)
    carried = true.velocity @ transport.T
    pull = gravity(latitude, 0.0) * (1.0 - 2.0 * true.h / EARTH_RADIUS)
    inertial = (
        true.acceleration
        - pull[:, None] * np.array([0.0, 0.0, 1.0])
        + np.cross(2.0 * spin + carried, true.velocity)
    )
    force = (inertial[:, None, :] @ R)[:, 0]
    turned = true.omega + ((spin + carried)[:, None, :] @ R)[:, 0]
    sensed_force = (
        force + np.cross(true.omega_dot, IMU) + np.cross(true.omega, np.cross(true.omega, IMU))
    )
    shown = dict(zip(("p", "q", "r"), turned.T)) | dict(
        zip(("ax_imu", "ay_imu", "az_imu"), sensed_force.T)
    )
    shown |= (
        dict(zip(("phi", "theta", "psi"), true.attitude.T))
        | dict(zip(("vn", "ve", "vd"), true.velocity.T))
        | {"h_gps": true.h}
    )
    u, v, w = (true.air + np.cross(true.omega, BOOM)).T
    shown["alpha_vane"], shown["beta_vane"] = np.arctan2(w, u), np.arctan2(v, u)
    T = LEVEL - LAPSE * (true.h - START)
    p = P_LEVEL * (T / LEVEL) ** (gravity(latitude, START) / (R_AIR * LAPSE))
    local = np.linalg.norm(true.air + np.cross(true.omega, PITOT), axis=1)
    mach = local / np.sqrt(GAMMA * R_AIR * T)
    q_c = impact_pressure(mach, p)
    k = error.get("static_error", 0.0)
    shown |= {"V": local, "mach": mach, "V_cas": calibrated_airspeed(q_c), "temperature": T}
    shown |= {"q_c": q_c * (1.0 - k), "p_static": p + k * q_c}

    def record(*names):
        return leaf(true.t, {
            n: error.get(f"factor.{n}", 1.0) * shown[n] + error.get(f"bias.{n}",
                0.0) + rng.normal(0.0, noise * NOISE[n], len(true.t))
            for n in names
        })  # fmt: skip

    leaves = {
        "irs": record(*INERTIAL, "phi", "theta", "psi"),
        "vanes": record("alpha_vane", "beta_vane"),
        "pitot": record(*(("q_c", "p_static") if speed == "q_c" else (speed,)), "temperature"),
        "navigation": record("vn", "ve", "vd", "h_gps"),
    }
    about = xr.Dataset(attrs={"title": f"inertial reference {seed}", **(facts or {})})
    tree = xr.DataTree.from_dict({"/": about, **{f"/{k}": d for k, d in leaves.items()}})
    V = np.linalg.norm(true.air, axis=1)
    columns = {
        "V": V,
        "alpha": np.arctan2(true.air[:, 2], true.air[:, 0]),
        "beta": np.arcsin(true.air[:, 1] / V),
        "h": true.h,
    }
    columns |= dict(zip(("phi", "theta", "psi"), true.attitude.T)) | dict(
        zip(("vn", "ve", "vd"), true.velocity.T)
    )
    truth = xr.Dataset({name: ("time", x) for name, x in columns.items()}, coords={"time": true.t})
    return tree, error, truth
