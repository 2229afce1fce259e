"""Corrections and computed signals against a simulated flight whose truth is known."""

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.errors import SchemaError
from flighttest.reconstruction.dynamics.derived_channels import (
    add_derived_channels,
    airspeed_from_pressures,
    angular_accelerations,
    forces_from_velocity,
    rates_from_attitude,
)
from flighttest.records.sensors.position_corrections import (
    incidence_at_cg,
    true_pressures,
    vane_at_cg,
    vane_true,
    velocity_at,
)


@pytest.fixture(scope="module")
def flight(flown):
    record, errors, truth = flown(3, duration=40.0)
    return flighttest.cut(record, 2.0, 38.0), errors, truth


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def test_position_correction_is_exact():
    rng = np.random.default_rng(0)
    U = np.array([80.0, 6.0, 9.0]) + rng.normal(0.0, 2.0, (50, 3))
    omega, arm = rng.normal(0.0, 0.4, (50, 3)), np.array([4.35, 0.3, 0.15])
    u, v, w = velocity_at(U, omega, arm).T
    V = np.linalg.norm(U, axis=1)
    alpha, beta = incidence_at_cg(np.arctan2(w, u), np.arctan2(v, u), V, omega, arm)
    np.testing.assert_allclose(alpha, np.arctan2(U[:, 2], U[:, 0]), atol=1e-12)
    np.testing.assert_allclose(beta, np.arcsin(U[:, 1] / V), atol=1e-12)
    small, _ = vane_at_cg(np.arctan2(w, u), np.arctan2(v, u), V, omega, arm)
    assert rms(small - alpha) > 1e-4  # what the small-angle form leaves


def test_upwash_and_static_port():
    np.testing.assert_allclose(vane_true(1.1 * np.array([0.0, 0.1]) + 0.02, 1.1, 0.02), [0.0, 0.1])
    p, q = true_pressures(np.array([90000.0 + 0.03 * 6000.0]), np.array([6000.0 * 0.97]), 0.03)
    np.testing.assert_allclose([p[0], q[0]], [90000.0, 6000.0])


def test_rates_from_attitude_within_their_error(flight):
    data, errors, _ = flight
    made = rates_from_attitude(data)
    for name in "pqr":
        difference = made[name] - (data[name] - errors[f"bias.{name}"])
        spread = np.hypot(made[name].attrs["stderr"], 6e-4)  # noise of the gyro
        assert rms(difference[20:-20]) == pytest.approx(spread, rel=0.35)


def test_angular_acceleration_within_its_error(flight):
    data, _, truth = flight
    made = angular_accelerations(data)["q_dot"]
    wrong = made - np.interp(data["time"], truth["time"], truth["q_dot"])
    assert rms(wrong[20:-20]) == pytest.approx(made.attrs["stderr"], rel=0.3)


def test_forces_from_velocity_follow_slow_motion_and_state_how_slow(flight):
    data, errors, truth = flight
    undelayed = data.copy()
    for name in ("vn", "ve", "vd"):
        undelayed[name] = (
            "time",
            flighttest.signals.remove_delay(data["time"], data[name], errors["delay.gps"], name),
            data[name].attrs,
        )
    made = forces_from_velocity(undelayed)["az"]
    assert made.attrs["bandwidth"] == pytest.approx(0.28, abs=0.03)  # nine points of 5 Hz
    slow = flighttest.signals.lowpass(
        made - np.interp(data["time"], truth["time"], truth["az"]), 50.0, 0.2
    )
    assert rms(slow[300:-300]) < 0.1


@pytest.mark.parametrize(
    ("height", "g"),
    [({}, 9.80665), ({"h_gps": 7500.0}, 9.78356), ({"h_baro": 7500.0, "h": 0.0}, 9.80665)],
)
def test_gravity_of_the_forces_falls_with_the_height(height, g):
    """Steady level flight: az = -g, at 7500 m 9.80665 (1 - 2 h/R)."""
    t = np.arange(100) * 0.02
    zero = {name: ("time", 0.0 * t) for name in ("phi", "theta", "psi", "ve", "vd")}
    data = xr.Dataset(
        zero
        | {"vn": ("time", 80.0 + 0.0 * t)}
        | {n: ("time", x + 0.0 * t) for n, x in height.items()},
        {"time": t},
    )
    np.testing.assert_allclose(forces_from_velocity(data)["az"], -g, atol=1e-5)


def test_airspeed_from_pressures(flight):
    data, _, truth = flight
    made = airspeed_from_pressures(data)
    V = np.interp(data["time"], truth["time"], truth["V"])
    # bias of the pressure and error of the static port are lasting errors: 2 % of q_c is 1 % of V
    assert rms(made["V"] - V) < 0.03 * V.mean()
    # third differences hold noise only, sqrt(20) times; the motion is gone
    assert rms(np.diff(made["V"], 3)) == pytest.approx(
        np.sqrt(20.0) * made["V"].attrs["stderr"], rel=0.1
    )


@pytest.mark.slow
def test_complete_adds_and_replaces_nothing(flight):
    data, _, truth = flight
    lacking = data.drop_vars(["p", "q", "r"])
    found = add_derived_channels(lacking, wind_error=6.0)
    assert {
        "p",
        "q",
        "r",
        "p_dot",
        "ax",
        "ay",
        "az",
        "V",
        "alpha",
        "beta",
        "mach",
        "rho",
        "qbar",
    } <= set(found.data_vars)
    for name in lacking.data_vars:
        np.testing.assert_array_equal(found[name], lacking[name])
    assert found["p"].attrs["made_from"] == "derivatives of phi theta psi"
    late = add_derived_channels(data)
    assert "made_from" not in late["p"].attrs
    assert (
        rms(found["alpha"] - np.interp(data["time"], truth["time"], truth["alpha"]))
        < 3.0 * found["alpha"].attrs["stderr"]
    )


def test_what_is_missing_is_named(flight):
    data, _, _ = flight
    with pytest.raises(SchemaError, match="no channel psi; all of phi theta psi are needed"):
        rates_from_attitude(data.drop_vars("psi"))
