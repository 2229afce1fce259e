"""Linear motions without a database: derivatives of simulated records, and the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from scipy.signal import lfilter, lsim

from flightmech.errors import IdentificationError, UnknownName
from flightmech.units import G0
from flighttest.cli.group import flight
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion

V, ALPHA, THETA, STEP = 80.0, 0.05, 0.03, 0.04
SHORT = {"Z_alpha": -1.2, "Z_delta_e": -0.1, "M_alpha": -6.0, "M_q": -1.8, "M_delta_e": -9.0}
LATERAL = {
    "Y_beta": -0.15, "Y_delta_r": 0.03,
    "L_beta": -12.0, "L_p": -2.5, "L_r": 0.8, "L_delta_a": -15.0, "L_delta_r": 2.0,
    "N_beta": 4.5, "N_p": -0.1, "N_r": -0.4, "N_delta_a": 0.4, "N_delta_r": -3.0,
}  # fmt: skip


def doublet(t, start, size):
    return size * (((t > start) & (t <= start + 1)) * 1.0 - ((t > start + 1) & (t <= start + 2)))


def measured(columns, rng, noise):
    t = np.arange(len(next(iter(columns.values())))) * STEP
    held = {"V": np.full(len(t), V), "theta": np.full(len(t), THETA)}
    variables = {**held, **columns}
    for name, size in noise.items():
        variables[name] = variables[name] + size * rng.standard_normal(len(t))
    return xr.Dataset({name: ("time", x) for name, x in variables.items()}, {"time": t})


def short_period(seed, elevator=0.03):
    d = SHORT
    A = np.array([[d["Z_alpha"], 1.0], [d["M_alpha"], d["M_q"]]])
    B = np.array([[d["Z_delta_e"]], [d["M_delta_e"]]])
    t = np.arange(0.0, 16.0, STEP)
    u = doublet(t, 1.0, elevator) + doublet(t, 6.0, -0.7 * elevator)
    C = np.vstack([np.eye(2), V * A[0] * [1.0, 0.0]])
    _, y, _ = lsim((A, B, C, [[0.0], [0.0], [V * d["Z_delta_e"]]]), u, t)
    # Readings of a flight have the trim in them.
    columns = {"alpha": ALPHA + y[:, 0], "q": y[:, 1], "az": -G0 + y[:, 2], "delta_e": 0.02 + u}
    noise = {"alpha": 2e-3, "q": 2e-3, "az": 0.1}
    return measured(columns, np.random.default_rng(seed), noise)


def lateral(seed):
    d = LATERAL
    A = np.array(
        [
            [d["Y_beta"], np.sin(ALPHA), -np.cos(ALPHA), G0 / V * np.cos(THETA)],
            [d["L_beta"], d["L_p"], d["L_r"], 0.0],
            [d["N_beta"], d["N_p"], d["N_r"], 0.0],
            [0.0, 1.0, np.tan(THETA), 0.0],
        ]
    )
    B = np.array(
        [
            [0.0, d["Y_delta_r"]],
            [d["L_delta_a"], d["L_delta_r"]],
            [d["N_delta_a"], d["N_delta_r"]],
            [0.0, 0.0],
        ]
    )
    t = np.arange(0.0, 20.0, STEP)
    u = np.column_stack([doublet(t, 1.0, 0.02), doublet(t, 6.0, 0.04)])
    C = np.vstack([np.eye(4), [V * d["Y_beta"], 0.0, 0.0, 0.0]])
    D = np.vstack([np.zeros((4, 2)), [0.0, V * d["Y_delta_r"]]])
    _, y, _ = lsim((A, B, C, D), u, t)
    columns = dict(zip(("beta", "p", "r", "phi", "ay"), y.T))
    columns |= {"delta_a": u[:, 0], "delta_r": u[:, 1], "alpha": np.full(len(t), ALPHA)}
    noise = {"beta": 1e-3, "p": 2e-3, "r": 1e-3, "phi": 2e-3, "ay": 0.05}
    return measured(columns, np.random.default_rng(seed), noise)


def errors(done, truth):
    e = done.fit.estimates.sel(parameter=list(truth))
    return (e["estimate"].values - np.array(list(truth.values()))) / e["stderr"].values


def test_derivatives_of_the_short_period():
    done = fit_motion([short_period(1), short_period(2)], "short-period")
    assert done.fit.estimates.attrs["stop"] == "converged"
    assert np.abs(errors(done, SHORT)).max() < 3.0
    assert not done.notes
    assert "mean V 80.0 m/s" in done.report()


def test_derivatives_of_the_lateral_motion():
    done = fit_motion([lateral(1)], "lateral")
    assert done.fit.estimates.attrs["stop"] == "converged"
    assert np.abs(errors(done, LATERAL)).max() < 3.0


def test_a_control_that_does_not_move_has_no_derivative():
    record = lateral(2)
    record["delta_r"] = xr.zeros_like(record["delta_r"])
    record = record.isel(time=slice(0, 130))
    done = fit_motion([record], "lateral")
    assert done.held == ("delta_r",)
    assert not [name for name in done.fit.parameters if name.endswith("delta_r")]
    still = short_period(1, elevator=0.0)
    with pytest.raises(IdentificationError, match="delta_e do not move"):
        fit_motion([still], "short-period")
    with pytest.raises(UnknownName, match="az"):
        fit_motion([still.drop_vars("az")], "short-period")
    with pytest.raises(ValueError, match="gusts need it: vane, inertial"):
        fit_motion([short_period(1)], "short-period", "gusts")
    with pytest.raises(ValueError, match="span is 9 m, but disturbance is 'process'; only gusts"):
        fit_motion([short_period(1)], "short-period", "process", span=9.0)


def test_a_change_of_speed_is_remarked():
    record = short_period(1)
    record["V"] = record["V"] * np.linspace(0.9, 1.1, record.sizes["time"])
    done = fit_motion([record], "short-period")
    assert [remark.term for remark in done.remarks if remark.kind == "range"] == ["V"]


@pytest.mark.nightly
def test_gusts_that_are_not_there_leave_the_derivatives():
    """In calm air the fit is output error, with a remark, from a trim far from zero."""
    done = fit_motion([short_period(1)], "short-period", "gusts", angle="inertial")
    assert done.fit.estimates.attrs["stop"] == "converged"
    assert np.abs(errors(done, SHORT)).max() < 3.0
    texts = [remark.text for remark in done.fit.remarks if remark.kind == "disturbance"]
    assert texts[0].startswith("no process noise is identified")
    calm = fit_motion([short_period(1)], "short-period").fit
    xr.testing.assert_equal(done.fit.estimates["estimate"], calm.estimates["estimate"])


@pytest.mark.nightly
def test_the_factor_on_the_rotation_of_gusts_is_an_unknown():
    record, rng = short_period(1).isel(time=slice(0, 200)), np.random.default_rng(3)
    gust = lfilter([4e-3], [1.0, -0.97], rng.standard_normal(200))
    moved = {"alpha": record["alpha"] + gust, "az": record["az"] + V * SHORT["Z_alpha"] * gust}
    done = fit_motion(
        [record.assign(moved)], "short-period", "gusts", angle="vane", scale=100.0, span=10.0
    )
    assert done.fit.estimates.attrs["converged"]
    assert done.fit.estimates.attrs["span"] == 10.0
    assert {"gust.w", "turn.w"} < set(done.fit.parameters)
    assert np.isfinite(done.fit.estimates["stderr"].sel(parameter="turn.w"))


@pytest.mark.nightly
def test_the_command_prints_derivatives_and_remarks(tmp_path):
    path = tmp_path / "readings.nc"
    short_period(3).to_netcdf(path, engine="h5netcdf")
    arguments = ["fit-linear", str(path), "--motion", "short-period"]
    printed = CliRunner().invoke(flight, [*arguments, "-o", str(tmp_path / "fit.nc")])
    assert printed.exit_code == 0, printed.output
    assert "M_alpha" in printed.output
    assert ", converged" in printed.output
    found = CliRunner().invoke(flight, [*arguments, "--disturbance", "process", "--json"])
    content = json.loads(found.stdout)
    row = content["parameters"]["M_alpha"]
    assert abs(row["estimate"] + 6.0) < 3.0 * row["stderr"]
    assert set(content["whiteness"]) == {"alpha", "q", "az"}
    refused = CliRunner().invoke(flight, [*arguments, "--disturbance", "gusts"])
    assert refused.exit_code == 2
    assert "--angle" in refused.output


def test_an_estimate_that_is_zero_is_printed_as_zero():
    fit = fit_motion([short_period(1)], "short-period").fit
    values = fit.estimates["estimate"].values.copy()
    printed = []
    for rounding in (7.3e-14, -7.4e-14):  # as two kernels of the linear algebra sum
        values[-1] = rounding
        changed = fit.estimates.assign(estimate=("parameter", values))
        printed.append(replace(fit, estimates=changed).report())
    assert printed[0] == printed[1]
    assert "e-14" not in printed[0]
