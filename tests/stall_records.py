"""Records of stalls by the equations of the product, with coloured noise on the coefficients."""

from __future__ import annotations

import numpy as np
import scipy
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import aerodb
from flightmech.terms import make_term

CBAR, SPAN, STEP = 1.67, 10.3, 0.04
STATION = 0.25 * SPAN
ALPHA_STAR = {0.0: np.deg2rad(17.0), 0.6: np.deg2rad(15.0)}
"""alpha* over the flap."""
TRUE = {"a1": 22.0, "tau1": 6.0, "tau2": 9.0, "asymmetry": np.deg2rad(0.8)}
NOISE = {"CL": 0.02, "CD": 0.004, "Cm": 0.006, "Cl": 0.0015, "Cn": 0.0008}
ATTACHED = {
    "CL": ("1", "alpha", "qhat", "delta_e", "delta_f"),
    "CD": ("1", "alpha", "alpha^2", "delta_f"),
}


def wander(rng: np.random.Generator, time: np.ndarray, size: float, frequency: float) -> np.ndarray:
    """Return a sum of six sines up to a frequency [Hz] with an rms of `size`."""
    total = np.zeros_like(time)
    for _ in range(6):
        f, phase = frequency * rng.uniform(0.3, 1.0), rng.uniform(0.0, 6.28)
        total += np.sin(2.0 * np.pi * f * time + phase)
    return size * total / np.sqrt(3.0)


def coloured(rng: np.random.Generator, size: int, rms: float) -> np.ndarray:
    """Return noise with a correlation time of 0.15 s."""
    a = np.exp(-STEP / 0.15)
    white = rng.normal(size=size + 200)
    return rms * np.sqrt(1.0 - a * a) * scipy.signal.lfilter([1.0], [1.0, -a], white)[200:]


def alpha_history(rng: np.random.Generator, kind: str, top: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time and angle of attack of a quasi-steady or an accelerated stall."""
    if kind == "quasi-steady":
        time = np.arange(0.0, 40.0, STEP)
        at = [0.0, 3.0, 20.0, 24.0, 30.0, 40.0]
        degrees = [9.0, 9.0, top + rng.uniform(0.0, 3.0), top + rng.uniform(1.0, 4.0), 9.0, 9.0]
        size, frequency = 0.35, 0.5
    else:
        time = np.arange(0.0, 20.0, STEP)
        up = rng.uniform(1.2, 2.5)
        at = [0.0, 2.0, 2.0 + up, 4.0 + up, 4.0 + 2.0 * up, 9.0 + 2.0 * up, 9.0 + 3.0 * up]
        at += [10.0 + 3.0 * up, 10.0 + 4.0 * up, 60.0]
        degrees = [9.0, 9.0, top + rng.uniform(1.0, 5.0), top + 1.0, 10.0, 10.0]
        degrees += [top + 2.0, top + 2.0, 9.0, 9.0]
        size, frequency = 0.5, 0.9
    alpha = gaussian_filter1d(np.interp(time, at, np.deg2rad(degrees)), 8.0)
    return time, alpha + wander(rng, time, np.deg2rad(size), frequency)


def separation(
    time: np.ndarray, quantities: dict[str, np.ndarray], star: float, true: dict[str, float]
) -> dict[str, np.ndarray]:
    """Return X of both halves, integrated with a tenth of the step from cubic splines."""
    fine = np.linspace(time[0], time[-1], 10 * (len(time) - 1) + 1)
    dense = {name: CubicSpline(time, values) for name, values in quantities.items()}
    V = dense["V"](fine)
    found = {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        y = side * STATION
        u = V * np.cos(dense["alpha"](fine)) - dense["r"](fine) * y
        w = V * np.sin(dense["alpha"](fine)) + dense["p"](fine) * y
        local = CubicSpline(fine, np.arctan2(w, u))
        reach = local(fine) - true["tau2"] * CBAR / V * local(fine, 1)
        reach = reach - star - 0.5 * side * true["asymmetry"]
        steady = 0.5 * (1.0 - np.tanh(true["a1"] * reach))
        rate = V / (true["tau1"] * CBAR) * (fine[1] - fine[0])
        X = np.empty_like(steady)
        X[0] = steady[0]
        for k in range(1, len(X)):
            # trapezoidal rule
            z = 0.25 * (rate[k] + rate[k - 1])
            X[k] = (X[k - 1] * (1.0 - z) + z * (steady[k] + steady[k - 1])) / (1.0 + z)
        found[name] = X[::10]
    return found


def stall_record(
    rng: np.random.Generator,
    kind: str,
    flap: float = 0.0,
    noise: float = 1.0,
    top: float = 17.0,
    **changes: float,
) -> xr.Dataset:
    """Return a stall; `top` is the least of its highest angle of attack [deg]."""
    true = TRUE | changes
    time, alpha = alpha_history(rng, kind, top)
    V = 65.0 - 80.0 * (alpha - np.deg2rad(9.0)) + wander(rng, time, 0.8, 0.1)
    p, r = wander(rng, time, 0.06, 0.7), wander(rng, time, 0.02, 0.4)
    q = 0.7 * CubicSpline(time, alpha)(time, 1)
    beta = wander(rng, time, np.deg2rad(1.5), 0.4)
    elevator = -0.8 * (alpha - 0.1) + wander(rng, time, 0.01, 0.8)
    aileron, rudder = wander(rng, time, 0.06, 0.6), wander(rng, time, 0.03, 0.5)
    star = ALPHA_STAR[flap]
    X = separation(time, {"alpha": alpha, "V": V, "p": p, "r": r}, star, true)
    lift = {name: (0.5 * (1.0 + np.sqrt(half))) ** 2 for name, half in X.items()}
    loss, lift_loss = 1.0 - 0.5 * (X["left"] + X["right"]), 1.0 - 0.5 * sum(lift.values())
    difference, lift_difference = X["left"] - X["right"], lift["left"] - lift["right"]
    phat, qhat, rhat = p * SPAN / (2.0 * V), q * CBAR / (2.0 * V), r * SPAN / (2.0 * V)
    c = {
        "CL": 0.25 + 0.3 * flap + 4.8 * alpha * (1.0 - lift_loss) + 4.0 * qhat + 0.4 * elevator,
        "CD": 0.03 + 1.2 * alpha**2 + 0.05 * flap + 0.08 * loss,
        "Cm": 0.03 - 0.7 * alpha - 13.0 * qhat - 1.05 * elevator + (0.25 * elevator - 0.12) * loss,
        "Cl": -0.09 * beta - 0.44 * phat + 0.12 * rhat - 0.15 * aileron + 0.02 * rudder,
        "Cn": 0.1 * beta - 0.03 * phat - 0.14 * rhat + 0.004 * aileron - 0.07 * rudder,
    }
    c["Cl"] = c["Cl"] + 0.5 * alpha * lift_difference + (0.25 * phat + 0.06 * aileron) * loss
    c["Cn"] = c["Cn"] - 0.02 * difference - 0.05 * beta * loss
    for name, rms in NOISE.items():
        c[name] = c[name] + noise * coloured(rng, len(time), rms)
    states = {"alpha": alpha, "beta": beta, "p": p, "q": q, "r": r, "V": V}
    states |= {"phat": phat, "qhat": qhat, "rhat": rhat, "delta_f": np.full_like(time, flap)}
    states |= {"delta_e": elevator, "delta_a": aileron, "delta_r": rudder}
    columns = {name: ("time", values) for name, values in {**states, **c}.items()}
    return xr.Dataset(columns, {"time": time})


def stall_flights(seed: int, flaps: tuple[float, ...] = (0.0, 0.6)) -> list[xr.Dataset]:
    """Return a quasi-steady and two accelerated stalls with each flap."""
    rng = np.random.default_rng(seed)
    kinds = ("quasi-steady", "accelerated", "accelerated")
    return [stall_record(rng, kind, flap) for flap in flaps for kind in kinds]


def attached_database() -> xr.DataTree:
    """Return the lift of the attached flow as a database."""
    leaves = {
        "CL/basic": make_term(0.25),
        "CL/alpha": make_term(4.8, regressors=["alpha"]),
        "CL/flap": make_term(0.3, regressors=["delta_f"]),
        "CL/qhat": make_term(4.0, regressors=["qhat"]),
        "CL/elevator": make_term(0.4, regressors=["delta_e"]),
    }
    root = {"title": "jet", "aircraft": "jet", "S": 17.0, "cbar": 1.67, "b": 10.3}
    root |= {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability", "source": "own"}
    return aerodb.make_database(leaves, **root, history="", absent="")
