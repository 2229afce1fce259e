"""Estimators and options of `flight identify`."""

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.errors import SchemaError
from flighttest.cli.identify import identify_command

AIRCRAFT = """
name = "test"
S = 16.0
cbar = 1.6
b = 10.0
mass = 2000.0
Ixx = 11000.0
Iyy = 8000.0
Izz = 15000.0
"""


def noisy_path(folder):
    """A path whose sideslip has noise, which a rudder moves: CY = -0.5 beta + 0.2 delta_r."""
    rng = np.random.default_rng(1)
    t = 0.02 * np.arange(1500)
    k = np.arange(2, 30)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(k))
    rudder = 0.05 * np.cos(2 * np.pi * np.outer(t, k) / 30 + phases).sum(axis=1) / 5.0
    beta = np.zeros(1500)
    for i in range(1499):
        beta[i + 1] = 0.98 * beta[i] + 0.03 * rudder[i]
    ay = 4000 * 16 / 2000 * (-0.5 * beta + 0.2 * rudder + 1e-4 * rng.normal(size=1500))
    columns = {"beta": beta + 0.01 * rng.normal(size=1500), "delta_r": rudder, "ay": ay}
    held = {"V": 80.0, "alpha": 0.05, "qbar": 4000.0, "az": -9.8}
    held |= {k: 0.0 for k in ("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax")}
    columns |= {k: np.full(1500, value) for k, value in held.items()}
    states = xr.Dataset({k: ("time", v) for k, v in columns.items()}, coords={"time": t})
    xr.DataTree.from_dict({"/states": states}).to_netcdf(folder / "noisy.nc", engine="h5netcdf")
    clean = states.assign(beta=("time", beta + 0.001 * rng.normal(size=1500)))
    xr.DataTree.from_dict({"/states": clean}).to_netcdf(folder / "other.nc", engine="h5netcdf")
    (folder / "a.toml").write_text(AIRCRAFT)
    model = ["--model", "CY = 1 + beta + delta_r"]
    return [str(folder / "noisy.nc"), "--aircraft", str(folder / "a.toml"), *model]


@pytest.mark.nightly
def test_estimators_for_noisy_regressors(tmp_path):
    arguments = noisy_path(tmp_path)

    def slope(*options):
        done = CliRunner().invoke(identify_command, [*arguments, *options, "--json"])
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout)["terms"]["beta"]

    plain = slope()
    assert plain["estimate"] > -0.46
    for options in (
        ("--method", "iv"),
        ("--method", "iv", "--instruments", str(tmp_path / "other.nc")),
        ("--method", "tls", "--noise", "beta", "0.57296 deg"),
    ):
        found = slope(*options)
        assert abs(found["estimate"] + 0.5) < 3 * found["stderr"], options
        assert found["least_squares"] == pytest.approx(plain["estimate"])
    held = slope("--constraint", "delta_r = -0.4*beta")
    assert held["estimate"] < 0.0
    text = CliRunner().invoke(identify_command, [*arguments, "--constraint", "beta = -0.7"]).output
    assert "constraint beta = -0.7: holds" in text
    assert "the data contradict the constraint" in text


@pytest.mark.slow
def test_options_that_do_not_go_together_are_refused(tmp_path):
    arguments = noisy_path(tmp_path)
    for options, text in (
        (("--method", "tls"), "--noise"),
        (("--noise", "beta", "0.01"), "--noise"),
        (("--method", "iv", "--band", "0.1", "2"), "works in time"),
        (("--method", "tls", "--noise", "beta", "0.01", "--ridge", "auto"), "works in time"),
        (("--instruments", str(tmp_path / "other.nc")), "--method iv"),
    ):
        done = CliRunner().invoke(identify_command, [*arguments, *options])
        assert isinstance(done.exception, SchemaError), options
        assert text in str(done.exception)
