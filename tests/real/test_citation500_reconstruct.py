"""Reconstruction of the Citation 500 simulation of ../shared: error-free signals of a foreign
flight model, flown at 7500 m.

The record has no pressures and no height: they are made from its speed, Mach number and climb with
the standard atmosphere.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.io import loadmat

import flighttest
from flightmech.air import GAMMA, R_AIR, atmosphere, impact_pressure
from flighttest.reconstruction.dynamics import kinematics

FOLDER = Path(__file__).parents[2] / ".." / "shared" / "data" / "flight" / "citation500_sim"
IMU = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
# the course's recipe of 2021: biases 0.01 m/s2 and 0.001 deg/s, noise of the same size; 0.1 m/s,
# 0.1 deg, 5 m
NOISE = {**dict.fromkeys(IMU[:3], np.radians(0.001)), **dict.fromkeys(IMU[3:], 0.01)}
NOISE |= dict.fromkeys(("phi", "theta", "psi", "alpha_vane", "beta_vane"), np.radians(0.1))
NOISE |= dict.fromkeys(("vn", "ve", "vd"), 0.1) | {
    "h_gps": 5.0,
    "q_c": 8.0,
    "p_static": 5.0,
    "temperature": 0.05,
}
GROUPS = {
    "imu": (*IMU, "phi", "theta", "psi"),
    "vanes": ("alpha_vane", "beta_vane"),
    "air_data": ("q_c", "p_static", "temperature"),
    "gps": ("vn", "ve", "vd", "h_gps"),
}


def specification(noise):
    tables = {name: {"noise": {n: noise[n] for n in names}} for name, names in GROUPS.items()}
    tables["imu"] |= {
        "position": [0.0, 0.0, 0.0],
        "bias_sigma": {**dict.fromkeys(IMU[:3], 1e-4), **dict.fromkeys(IMU[3:], 0.05)},
    }
    tables["vanes"] |= {
        "position": [0.0, 0.0, 0.0],
        "bias_sigma": dict.fromkeys(GROUPS["vanes"], 0.01),
        "lag": [1e-3, 1e-6],
    }
    return SimpleNamespace(
        name="CE-500",
        S=24.99,
        cbar=1.991,
        b=13.325,
        mass=4500.0,
        cg=(0.0, 0.0, 0.0),
        instruments=tables,
        engines=(),
        fuel=None,
    )


def record(name, height, seed=None, errors=None):
    """Return a record; with a seed its readings are noisy and wrong by `errors`."""
    file = FOLDER / f"{name}.mat"
    if not file.exists():
        pytest.skip(
            "the Citation 500 simulation (../shared/data/flight/citation500_sim) is not here"
        )
    data = {
        key: np.ravel(value).astype(float)
        for key, value in loadmat(file).items()
        if isinstance(value, np.ndarray) and value.dtype.kind == "f"
    }
    t = data["t"] - data["t"][0]
    h = height - np.concatenate(
        [[0.0], np.cumsum(0.5 * (data["w_n"][1:] + data["w_n"][:-1]) * np.diff(t))]
    )
    temperature = (data["vtas"] / data["Mach"]) ** 2 / (GAMMA * R_AIR)
    p = atmosphere(h).p_static
    signals = dict(zip(IMU, (data[key] for key in ("p", "q", "r", "Ax", "Ay", "Az"))))
    signals |= {key: data[key] for key in ("phi", "theta", "psi")} | {
        "alpha_vane": data["alpha"],
        "beta_vane": np.arctan2(np.tan(data["beta"]), np.cos(data["alpha"])),
    }
    signals |= {
        "vn": data["u_n"],
        "ve": data["v_n"],
        "vd": data["w_n"],
        "h_gps": h,
        "temperature": temperature,
    }
    signals |= {
        "p_static": p,
        "q_c": impact_pressure(data["vtas"] / np.sqrt(GAMMA * R_AIR * temperature), p),
    }
    rng = np.random.default_rng(seed)
    leaves = {}
    for leaf, names in GROUPS.items():
        shown = {
            n: signals[n]
            + (errors or {}).get(f"bias.{n}", 0.0)
            + (rng.normal(0.0, NOISE[n], len(t)) if seed is not None else 0.0)
            for n in names
        }
        leaves[f"/{leaf}"] = xr.Dataset(
            {n: ("time", x) for n, x in shown.items()}, {"time": t}, {"rate": 100.0}
        )
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": name}), **leaves}), data


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "error::RuntimeWarning"
)  # constants that nothing determines have errors without a bound
# the noise of signals without error becomes smaller in every round
@pytest.mark.filterwarnings("ignore:.*noise of the channels. not converged")
def test_error_free_signals_show_no_accelerometer_bias(monkeypatch):
    flight, _ = record("de3211_1", 7500.0)
    quiet = specification({name: 0.1 * value for name, value in NOISE.items()})

    def bias():
        found = flighttest.reconstruct_batch([flight], quiet, [[(0.0, 30.0)]]).estimates
        return float(found["estimate"].sel(parameter="bias.az_imu"))

    with_height = bias()
    assert abs(with_height) < 2e-3
    # with the gravity of sea level the 0.023 m/s2 of 7500 m come back as the bias of an
    # accelerometer
    monkeypatch.setattr(
        "flighttest.reconstruction.problem.assembly.gravity",
        lambda latitude, h: kinematics.gravity(latitude, 0.0),
    )
    assert bias() - with_height == pytest.approx(0.023, abs=0.002)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "height"),
    [
        ("de3211_1", 7500.0),
        *(pytest.param(name, 7500.0, marks=pytest.mark.slow) for name in ("da3211_2", "dr3211_1")),
    ],
)
@pytest.mark.parametrize("method", ["smoother", pytest.param("batch", marks=pytest.mark.slow)])
def test_noisy_readings_of_the_course_give_the_path_back(name, height, method):
    errors = {
        **{f"bias.{n}": np.radians(0.001) for n in IMU[:3]},
        **{f"bias.{n}": 0.01 for n in IMU[3:]},
    }
    flight, data = record(name, height, seed=1, errors=errors)
    craft = specification(NOISE)
    if method == "batch":
        path = flighttest.reconstruct_batch([flight], craft, rate=100.0).paths[0]
    else:
        path = flighttest.reconstruct(flight, craft, rate=100.0)
    biases = path.biases.sel(parameter=[f"bias.{n}" for n in IMU])
    true = np.array([errors[n] for n in biases["parameter"].values])
    assert (np.abs(biases["estimate"] - true) < 3.0 * biases["stderr"]).all()
    rest = path.states["alpha"].values - data["alpha"]
    assert np.sqrt(np.mean(rest**2)) < np.radians(
        0.05
    )  # half the noise of one reading; the offset of the vane is unknown to 0.6 deg
    assert np.std(rest) < np.radians(0.02)
