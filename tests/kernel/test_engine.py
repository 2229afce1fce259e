"""Thrust: table, lag, recorded thrust, lever arms, gyroscopic moment."""

from __future__ import annotations

import numpy as np
import pytest

import flightmech
from flightmech import terms
from flightmech.terms import make_term

STILL = {"init__V": 0.0, "init__h": 0.0, "mode__earth": 0.0}


@pytest.fixture(scope="module")
def bare(make_aircraft, make_tree) -> flightmech.SimModel:
    """The jet without aerodynamics."""
    return flightmech.compile(make_aircraft(), make_tree({"CD/basic": make_term(0.0)}))


def test_static_thrust_is_the_table(bare, flown, make_aircraft):
    leaf = make_aircraft().engines[0].thrust
    y = flown(bare, init__V=150.0, init__h=3000.0, engine1__throttle=0.45, engine2__throttle=1.0)
    for engine, throttle in ((1, 0.45), (2, 1.0)):
        expected = float(
            terms.evaluate_term(leaf, {"throttle": throttle, "mach": y["mach"], "h": y["h"]})
        )
        assert y[f"engine{engine}.thrust"] == pytest.approx(expected, rel=1e-12)


def test_lag_is_first_order(make_aircraft, make_tree, start):
    engine = flightmech.aircraft.Engine(
        (0.0, 0.0, 0.0),
        thrust=make_term([300.0, 4500.0], {"throttle": [0.0, 1.0]}),
        time_constant=1.2,
    )
    sim = flightmech.compile(
        make_aircraft(engines=(engine,)), make_tree({"CD/basic": make_term(0.0)})
    )
    run = start(sim, **STILL)
    idle, full = np.zeros(len(sim.inputs)), np.zeros(len(sim.inputs))
    full[sim.inputs.index("engine1.throttle")] = 1.0
    thrust = sim.outputs.index("engine1.thrust")
    assert run.outputs()[thrust] == 300.0
    assert run.derivative(run.state, idle)[13] == 0.0
    run.step(0.0, 1.2, full, full)
    assert run.outputs()[thrust] == pytest.approx(
        4500.0 - 4200.0 * np.exp(-1.0), rel=1e-9
    )  # RK4: (0.01/1.2)^4


def test_no_time_constant_means_no_lag(bare, flown):
    y = flown(bare, **STILL, engine1__throttle=1.0, engine1__time_constant=0.0)
    assert y["engine1.thrust"] == pytest.approx(4559.0)


def test_recorded_thrust_drives(bare, flown):
    y = flown(
        bare,
        **STILL,
        mode__engine=2.0,
        engine1__thrust_drive=1234.0,
        engine1__throttle=1.0,
        bias__thrust=10.0,
    )
    assert (y["engine1.thrust"], y["engine2.thrust"]) == (1244.0, 10.0)


def test_force_and_moment_of_one_engine(bare, flown, make_aircraft):
    y = flown(bare, **STILL, mode__engine=2.0, engine2__thrust_drive=1000.0)
    craft = make_aircraft()
    moment = np.cross(np.array(craft.engines[1].position) - craft.cg, [1000.0, 0.0, 0.0])
    from flightmech.aircraft.aircraft import inertia_tensor

    assert y["ax"] == pytest.approx(1000.0 / 2300.0, rel=1e-14)
    np.testing.assert_allclose(
        [y["p_dot"], y["q_dot"], y["r_dot"]],
        np.linalg.solve(inertia_tensor(craft), moment),
        rtol=1e-12,
        atol=1e-15,
    )


def test_rotors_turn_pitch_into_yaw(make_aircraft, make_tree, flown):
    """A nose-up rate with a right-handed rotor along +x yaws the nose right: M = -w x H."""
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), angular_momentum=200.0)
    craft = make_aircraft(engines=(engine,), cg=(0.0, 0.0, 0.0), Ixy=0.0, Ixz=0.0, Iyz=0.0)
    sim = flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))
    y = flown(sim, **STILL, mode__engine=2.0, init__q=0.1)
    assert (y["p_dot"], y["q_dot"]) == (0.0, 0.0)
    assert y["r_dot"] == pytest.approx(0.1 * 200.0 / 15100.0, rel=1e-13)


def test_throttle_without_a_table_is_refused(make_aircraft, make_tree, flown):
    sim = flightmech.compile(
        make_aircraft(engines=(flightmech.aircraft.Engine((0.0, 0.0, 0.0)),)),
        make_tree({"CD/basic": make_term(0.0)}),
    )
    assert np.isfinite(
        list(flown(sim, **STILL).values())
    ).all()  # the default is then the recorded thrust
    with pytest.raises(
        flightmech.errors.SimulationError,
        match=r"mode.engine = 0 needs a thrust table, engine1 has none; use mode.engine = 2",
    ):
        flown(sim, **STILL, mode__engine=0.0)
