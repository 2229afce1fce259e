"""Fit springs and dampers of the legs of ``aircraft.toml`` to the recordings in ``flight/``, with the simulation itself.

    python data/t37/make_gear.py

Take-offs 17 and 25 from the run-up against the brakes to 14 s (9 m/s: no air forces yet): pitch attitude and rate, which
the thrust changes by 3 degrees, and the rebound when the brakes go.  Landings 18 and 31 from 0.3 s before to 0.7 s after
the touch: vertical specific force.  What the instruments may be wrong by is estimated with its own standard deviation.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

import flightmech
import flighttest
from flightmech.terms import make

HERE = Path(__file__).parent
IMU = (0.90, 0.0, 0.0965)  # from the c.g.
TAKE_OFFS, LANDINGS = (17, 25), (18, 31)
UNKNOWN = ("nose.stiffness", "main.stiffness", "nose.damping", "main.damping")
GUESS = np.array([49e3, 96e3, 8e3, 16e3])
NUISANCE = {"theta": 1.3e-3, "thrust": 0.02}  # one standard deviation
SIGMA = {"theta": 1e-3, "q": 2e-3, "az": 0.3}  # of the fit: noise of the instruments and what a linear leg cannot do


def recording(run: int) -> xr.Dataset:
    """Return a run at 50 Hz as recorded."""
    (path,) = (HERE / "flight").glob(f"t37_{run:02d}_*.nc")
    record = flighttest.read(path, HERE / "names.toml")
    return flighttest.cut(record, 0.0, min(float(leaf["time"][-1]) for leaf in record.children.values()), rate=50.0)


craft = flightmech.read_aircraft(HERE / "aircraft.toml")
sim = flightmech.compile(craft, xr.DataTree.from_dict({"/CL/lift": make(1.0)}))


def parameters(values: np.ndarray, data: xr.Dataset) -> dict[str, float]:
    """Return the parameters of the gear and of the start of a run."""
    given = dict(zip(UNKNOWN, values, strict=False))
    legs = {}
    for leg, like in (("nose", "nose"), ("left", "main"), ("right", "main")):
        legs[f"gear.{leg}.stiffness"] = given[f"{like}.stiffness"]
        legs[f"gear.{leg}.damping"] = legs[f"gear.{leg}.damping_ext"] = given[f"{like}.damping"]
    mass = float(np.ravel(data["mass"])[0])
    return legs | {"mass.mass": mass, "mode.earth": 0.0, "mode.engine": 2.0, "env.runway_elevation": 0.0, "gear": 1.0}


def take_off(values: np.ndarray, data: xr.Dataset) -> np.ndarray:
    """Return the residuals of pitch attitude and rate of a run-up, after 20 s at idle to come to rest."""
    at_rest = 20.0
    time = np.concatenate([[0.0, at_rest - 1e-3], at_rest + data["time"].values])
    inputs = {"brake_left": data["brake"], "brake_right": data["brake"]}
    inputs |= {f"engine{i}.thrust_drive": data[f"engine{i}.thrust"] * (1.0 + values[5]) for i in (1, 2)}
    flown = xr.Dataset({name: ("time", np.concatenate([[x[0], x[0]], np.asarray(x)])) for name, x in inputs.items()}, {"time": time})
    start = {"init.V": 0.0, "init.h": 0.45, "init.theta": 0.06, "term.CL.lift": 0.0}
    y = flightmech.simulate(sim, flown, parameters(values, data) | start).isel(time=slice(2, None))
    theta = (y["theta"].values + values[4] - data["theta"].values) / SIGMA["theta"]
    return np.concatenate([theta, (y["q"].values - data["q"].values) / SIGMA["q"]]) / np.sqrt(50.0)


def landing(values: np.ndarray, data: xr.Dataset, touch: float, extra: np.ndarray) -> np.ndarray:
    """Return the residuals of the vertical specific force about a touch; `extra` is sink rate and time of the touch."""
    window = data.sel(time=slice(touch - 0.3, touch + 0.7))
    before = data.sel(time=slice(touch - 0.5, touch - 0.1))
    V, theta = float(before["V"].mean()), float(before["theta"].mean())
    sink, late = extra
    alpha = theta + sink / V
    depth = 0.759 * np.cos(theta) + 0.170 * np.sin(theta) - 0.2235 * np.cos(theta)
    height = depth + sink * (0.3 + late)
    start = {"init.V": V, "init.alpha": alpha, "init.theta": theta, "init.h": height, "term.CL.lift": 0.0}
    air = flightmech.air.atmosphere(0.0)
    start["bias.CL"] = -float(before["az_imu"].mean()) * float(data["mass"].mean()) / (0.5 * float(air.rho) * V**2 * craft.S)
    y = flightmech.simulate(sim, xr.Dataset(coords={"time": window["time"].values}), parameters(values, data) | start)
    return (y["az"].values - y["q_dot"].values * IMU[0] - window["az_imu"].values) / SIGMA["az"] / np.sqrt(5.0)


runs = {run: recording(run) for run in TAKE_OFFS + LANDINGS}
run_ups = [runs[run].sel(time=slice(0.0, 14.0)) for run in TAKE_OFFS]
touches = [float(runs[run]["time"][int(np.argmax(runs[run]["wow_left"].values > 0.5))]) for run in LANDINGS]


def residual(scaled: np.ndarray) -> np.ndarray:
    """Return all residuals; the leg constants over their guess, then the nuisances, then sink rate and delay of each landing."""
    values = np.concatenate([scaled[:4] * GUESS, scaled[4:6]])
    found = [take_off(values, data) for data in run_ups]
    found += [
        landing(values, runs[run], touch, scaled[6 + 2 * i : 8 + 2 * i])
        for i, (run, touch) in enumerate(zip(LANDINGS, touches, strict=True))
    ]
    return np.concatenate([*found, values[4:] / list(NUISANCE.values())])


if __name__ == "__main__":
    start = np.concatenate([np.ones(4), np.zeros(2), [0.8, 0.0] * len(LANDINGS)])
    fit = least_squares(
        residual,
        start,
        x_scale=np.concatenate([np.ones(4), [1e-3, 0.01], [0.1, 0.01] * len(LANDINGS)]),
        diff_step=1e-3,
        ftol=1e-5,
        xtol=1e-5,
    )
    error = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    for name, value, e in zip(UNKNOWN, fit.x[:4] * GUESS, error[:4] * GUESS, strict=True):
        print(f"{name:16s} {value:8.0f} +- {e:5.0f}")
    print("theta bias [rad], thrust scale - 1, sink rate [m/s] and delay [s] of each landing:", fit.x[4:].round(4))
    values = np.concatenate([fit.x[:4] * GUESS, fit.x[4:6]])
    for run, data in zip(TAKE_OFFS, run_ups, strict=True):
        theta, q = np.split(take_off(values, data) * np.sqrt(50.0), 2)
        print(f"run {run}: rms theta {np.std(theta) * SIGMA['theta']:.2e} rad, q {np.std(q) * SIGMA['q']:.2e} rad/s")
    for i, (run, touch) in enumerate(zip(LANDINGS, touches, strict=True)):
        az = landing(values, runs[run], touch, fit.x[6 + 2 * i : 8 + 2 * i]) * np.sqrt(5.0) * SIGMA["az"]
        print(f"run {run}: rms az {np.std(az):.2f} m/s2")
