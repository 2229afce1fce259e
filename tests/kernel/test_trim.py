"""Trim: accelerations gone, what is held is held, missing controls and limits leave a residual."""

from __future__ import annotations

import numpy as np
import pytest

import flightmech
from flightmech.errors import SimulationError

RESIDUALS = ("trim.u_dot", "trim.v_dot", "trim.w_dot", "trim.p_dot", "trim.q_dot", "trim.r_dot")
CRUISE = {"init.V": 110.0, "init.h": 3000.0, "init.psi": 0.7, "init.lat": 0.8}


@pytest.mark.parametrize("earth", [0.0, 1.0])
@pytest.mark.parametrize(
    "case",
    [
        {},
        {"init.gamma": 0.06, "wind_n": 15.0, "wind_e": -4.0},
        {"init.V": 60.0, "init.h": 300.0, "gear": 1.0},
        {"init.gamma": -0.05, "mass.x_cg_b": -0.05},
        {"init.u_dot": 0.5},
    ],
)
def test_wanted_accelerations_are_reached(earth, case, sim):
    values = {**CRUISE, "mode.earth": earth, **case}
    y = flightmech.trim(sim, values)
    assert max(abs(float(y[name])) for name in RESIDUALS) < 1e-11
    assert float(y["gamma"]) == pytest.approx(values.get("init.gamma", 0.0), abs=1e-10)
    assert float(y["V"]) == pytest.approx(values["init.V"], rel=1e-12)
    assert float(y["phi"]) == pytest.approx(0.0, abs=1e-12)
    assert float(y["psi"]) == pytest.approx(0.7, abs=1e-12)


def test_trim_point_stays(sim):
    import xarray as xr

    time = np.arange(0.0, 10.0, 0.1)
    y = flightmech.simulate(
        sim, xr.Dataset(coords={"time": time}), {**CRUISE, "mode.earth": 0.0, "mode.trim": 2.0}
    )
    for name, spread in (("V", 1e-4), ("h", 1e-3), ("theta", 1e-6), ("phi", 1e-6)):
        assert float(np.ptp(y[name].values)) < spread, name


def test_thrust_is_unknown_for_recorded_thrust(sim):
    y = flightmech.trim(
        sim,
        {
            **CRUISE,
            "mode.engine": 2.0,
            "engine1.thrust_drive": 500.0,
            "engine2.thrust_drive": 500.0,
        },
    )
    assert float(y["engine1.thrust"]) == pytest.approx(500.0 + float(y["trim.thrust"]))
    assert float(y["trim.throttle"]) == 0.0
    assert max(abs(float(y[name])) for name in RESIDUALS) < 1e-11


def test_biases_come_on_top_of_the_recorded_controls(sim):
    plain = flightmech.trim(sim, CRUISE)
    given = flightmech.trim(
        sim, {**CRUISE, "delta_e": 0.05, "engine1.throttle": 0.4, "engine2.throttle": 0.4}
    )
    assert float(given["trim.delta_e"]) == pytest.approx(
        float(plain["trim.delta_e"]) - 0.05, abs=1e-10
    )
    assert float(given["applied.delta_e"]) == pytest.approx(
        float(plain["applied.delta_e"]), abs=1e-10
    )


def test_a_bank_that_is_free_shares_a_side_acceleration_with_the_sideslip(sim):
    """From a trimmed state: of all banks the trim takes that of the smallest change of bank,
    sideslip, aileron and rudder together.
    """
    level = flightmech.trim(sim, {**CRUISE, "mode.earth": 0.0})
    start = {name: float(level[f"applied.{name}"]) for name in ("delta_e", "delta_a", "delta_r")}
    start |= {f"init.{name}": float(level[name]) for name in ("alpha", "beta")}
    held = {**CRUISE, **start, "mode.earth": 0.0, "init.v_dot": 0.02}

    def trimmed(**more):
        y = flightmech.trim(
            sim, {**held, **{f"init.{name}": value for name, value in more.items()}}
        )
        assert max(abs(float(y[name])) for name in RESIDUALS) < 1e-11
        return y, np.linalg.norm(
            [y["phi"], y["beta"] - level["beta"], y["trim.delta_a"], y["trim.delta_r"]]
        )

    free, change = trimmed(phi_range=0.02)
    phi = float(free["phi"])
    assert 1e-4 < phi < 0.02 / 9.8  # all of it by gravity
    assert all(change < trimmed(phi=other)[1] for other in (0.0, 0.7 * phi, 1.3 * phi, 0.02 / 9.8))
    assert float(trimmed(phi_range=0.5 * phi)[0]["phi"]) == pytest.approx(0.5 * phi, abs=1e-15)
    held_again, _ = trimmed()
    assert float(held_again["phi"]) == pytest.approx(0.0, abs=1e-12)  # init.phi is as it was given


def test_a_negative_range_of_the_bank_is_refused(sim):
    with pytest.raises(SimulationError, match=r"init\.phi_range"):
        flightmech.trim(sim, {**CRUISE, "init.phi_range": -0.01})


def test_without_a_rudder_the_rudder_stays_and_yaw_is_left(sim):
    """A bank with no turn rate requires sideslip; without rudder terms nothing holds it."""
    values = {
        **CRUISE,
        "mode.earth": 0.0,
        "init.phi": 0.2,
        "term.Cn.rudder": 0.0,
        "term.CY.rudder": 0.0,
    }
    y = flightmech.trim(sim, values)
    assert float(y["trim.delta_r"]) == 0.0
    assert max(abs(float(y[name])) for name in RESIDUALS) > 1e-3
    level = flightmech.trim(sim, {**values, "init.phi": 0.0})
    assert float(level["trim.delta_r"]) == 0.0


def test_the_residual_is_a_least_squares_minimum(sim):
    """No small change of any unknown makes the weighed residual smaller."""
    values = {
        **CRUISE,
        "mode.earth": 0.0,
        "init.phi": 0.2,
        "term.Cn.rudder": 0.0,
        "term.CY.rudder": 0.0,
    }
    y = flightmech.trim(sim, values)
    weight = np.array([1.0, 1.0, 1.0, 5.15, 5.15, 5.15])  # half the span of 10.3 m
    best = np.linalg.norm(weight * [float(y[name]) for name in RESIDUALS])
    for change in (
        {"bias.delta_a": 0.002},
        {"bias.delta_a": -0.002},
        {"bias.delta_e": 0.002},
        {"bias.delta_e": -0.002},
    ):
        held = {
            **{name: value for name, value in values.items() if name != "mode.trim"},
            "init.alpha": float(y["alpha"]),
            "init.beta": float(y["beta"]),
            "init.theta": float(y["theta"]),
            "mode.trim": 0.0,
            "delta_e": float(y["applied.delta_e"]),
            "delta_a": float(y["applied.delta_a"]),
            "engine1.throttle": float(y["trim.throttle"]),
            "engine2.throttle": float(y["trim.throttle"]),
            **change,
        }
        z = flightmech.trim(sim, held)
        a = np.array([float(z[k]) for k in ("ax", "ay", "az")])
        C = flightmech.axes.matrix_from_euler(float(z["phi"]), float(z["theta"]), float(z["psi"]))
        gravity = C @ [0.0, 0.0, 9.80665]
        found = np.concatenate([a + gravity, [float(z[k]) for k in ("p_dot", "q_dot", "r_dot")]])
        assert np.linalg.norm(weight * found) > best


def test_limits_of_the_controls_hold(sim):
    y = flightmech.trim(sim, {**CRUISE, "init.V": 110.0, "bias.Cm": 0.9})
    assert -0.35 - 1e-15 <= float(y["applied.delta_e"]) <= 0.3 + 1e-15
    assert abs(float(y["trim.q_dot"])) > 0.1


def test_engine_at_its_stop_leaves_a_deceleration(sim):
    y = flightmech.trim(sim, {**CRUISE, "init.gamma": 0.5})
    assert float(y["trim.throttle"]) == 1.0
    assert float(y["trim.u_dot"]) < -1.0


def test_a_throttle_that_meets_its_limit_on_the_way_comes_back(flown, sim):
    """The solution passes full throttle, beyond which nothing moves the thrust: slopes are taken
    inwards there.
    """
    throttle = {"engine1__throttle": 0.5, "engine2__throttle": 0.5}
    found = flown(sim, mode__trim=2, init__V=61.5, init__h=8100.0, init__gamma=-0.035, **throttle)
    assert found["trim.throttle"] == pytest.approx(-0.39, abs=0.02)
    assert max(abs(found[f"trim.{name}_dot"]) for name in "uvwpqr") < 1e-12


def test_no_speed_is_an_error(sim):
    with pytest.raises(SimulationError, match=r"init.V = 0.5 m/s; a trim needs more than 1 m/s"):
        flightmech.trim(sim, {"init.V": 0.5})


def test_throttle_and_recorded_thrust_contradict(sim):
    with pytest.raises(
        SimulationError, match=r"mode.trim = 2 solves for the throttle, but mode.engine = 2"
    ):
        flightmech.trim(sim, {**CRUISE, "mode.engine": 2.0, "mode.trim": 2.0})
