"""Spools, fuel and tyres as states of the linear model: closed forms, and small steps of the
simulation.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

import flightmech
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import UnknownName
from flightmech.simulation.kernel import STATE
from flightmech.steady_flight import linear_model as linear
from flightmech.steady_flight.trim_search import start_of
from flightmech.terms import make_term
from flightmech.units import G0

V, H = 90.0, 1500.0
LEVEL = {"init.V": V, "init.h": H, "mode.engine": 0.0}
UP, N1_UP = 0.5, 0.4
DECK = {
    "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
    "n2_up_time": make_term(UP),
    "n2_down_time": make_term(UP),
    "n1_command": make_term([0.2, 0.9], {"n2": [0.5, 1.0]}),
    "n1_up_time": make_term(N1_UP),
    "n1_down_time": make_term(N1_UP),
    "corrected_thrust": make_term([0.0, 8000.0], {"n1": [0.0, 1.0]}),
    "fuel_flow": make_term([0.02, 0.12], {"n2": [0.5, 1.0]}),
}
RUNWAY_STATES = ("V", "alpha", "q", "theta", "h", "beta", "p", "r", "phi", "psi")


@pytest.fixture(scope="module")
def decked(plain, plain_aircraft) -> flightmech.SimModel:
    """The plain jet with one full deck and a tank at the centre of gravity."""
    engine = flightmech.aircraft.Engine((0.0, 0.0, 0.0), deck=EngineDeck(DECK))
    return plain(plain_aircraft(engines=(engine,), fuel=Fuel(300.0)))


@pytest.fixture(scope="module")
def rolling(plain, plain_aircraft) -> flightmech.SimModel:
    """The plain jet on wheels, nose wheel steered by a spring."""
    wheel = {
        "side_stiffness": 150e3,
        "cornering_stiffness": 40e3,
        "cornering_load": 12e3,
        "rolling": 0.02,
        "loss": 0.01,
    }
    main = {"stiffness": 110e3, "damping": 8e3, "damping_ext": 8e3, "brake": 8e3, **wheel}
    contacts = (
        Contact(
            "nose",
            (2.2, 0.0, 0.85),
            stiffness=60e3,
            damping=4e3,
            damping_ext=4e3,
            steering=1.0,
            **wheel,
        ),
        Contact("left", (-0.35, -1.9, 0.85), **main),
        Contact("right", (-0.35, 1.9, 0.85), **main),
    )
    return plain(plain_aircraft(gear=LandingGear(contacts, Steering(stiffness=20e3, trail=0.05))))


def test_spools_by_hand(decked):
    """n2' = (command - n2) / T2 and so on, thrust at once: T = 8000 n1 times the pressure ratio,
    along body x on 2400 kg.
    """
    states = ("V", "alpha", "q", "theta", "engine1.n1", "engine1.n2", "fuel")
    found = flightmech.linearize(decked, LEVEL, states=states)
    A = found["A"].sel
    y = flightmech.trim(decked, {**LEVEL, "mode.earth": 0.0})
    alpha, delta = float(y["alpha"]), float(y["p_static"]) / 101325.0
    assert float(A(state="engine1.n2", state_="engine1.n2")) == pytest.approx(-1.0 / UP, rel=1e-8)
    assert float(A(state="engine1.n1", state_="engine1.n1")) == pytest.approx(
        -1.0 / N1_UP, rel=1e-8
    )
    assert float(A(state="engine1.n1", state_="engine1.n2")) == pytest.approx(1.4 / N1_UP, rel=1e-8)
    assert float(found["B"].sel(state="engine1.n2", input="engine1.throttle")) == pytest.approx(
        0.5 / UP, rel=1e-8
    )
    pull = 8000.0 * delta * np.cos(alpha) / 2400.0
    assert float(A(state="V", state_="engine1.n1")) == pytest.approx(pull, rel=1e-7)
    assert float(A(state="fuel", state_="engine1.n2")) == pytest.approx(-0.2, rel=1e-8)
    assert float(A(state="alpha", state_="fuel")) == pytest.approx(
        G0 / (2400.0 * V), rel=1e-7
    )  # lift over mass less gravity
    assert found["state_units"].values.tolist()[4:] == ["1", "1", "kg"]
    assert found.attrs["left_out"].split() == ["engine1.thrust", "engine1.burning", "engine1.itt"]


def test_modes_of_engine_and_fuel_keep_their_names(decked):
    states = ("V", "alpha", "q", "theta", "engine1.n1", "engine1.n2", "fuel")
    found = flightmech.modes(flightmech.linearize(decked, LEVEL, states=states))
    assert sorted(found["mode"]) == ["engine", "engine", "fuel", "phugoid", "short period"]
    engines = found[found["mode"] == "engine"]["real"]
    assert sorted(engines) == pytest.approx([-1.0 / N1_UP, -1.0 / UP], rel=1e-6)
    assert (
        set(
            linear.subset(flightmech.linearize(decked, LEVEL, states=states), "lateral")[
                "state"
            ].values
        )
        == set()
    )


def test_spools_left_out_follow_at_once(decked):
    """Throttle to thrust through both commands: 0.5 x 1.4 x dT/dn1."""
    states = ("V", "alpha", "q", "theta")
    slow = flightmech.linearize(decked, LEVEL, states=(*states, "engine1.n1", "engine1.n2"))
    quick = flightmech.linearize(decked, LEVEL, states=states)
    along = float(slow["A"].sel(state="V", state_="engine1.n1"))
    assert float(quick["B"].sel(state="V", input="engine1.throttle")) == pytest.approx(
        0.7 * along, rel=1e-7
    )


@pytest.mark.slow
@pytest.mark.parametrize("control", ["delta_nw", "delta_r", "engine1.thrust_drive"])
def test_small_steps_on_the_runway_follow(control, rolling):
    """Rolling at 30 m/s: a step of 1e-4 rad or 1 N for 0.5 s against x = integral of expm(A t) B
    du, tyres and steering among x.
    """
    y = flightmech.trim(
        rolling, {"mode.earth": 0.0}, kind="ground", fixed={"V": 30.0, "u_dot": 0.0}
    )
    start = start_of(y)
    tyres = [
        row.name.removeprefix("state.")
        for row in rolling.entries(STATE)[13:]
        if row.name.startswith("state.gear.")
    ]
    found = flightmech.linearize(
        rolling, start, states=(*RUNWAY_STATES, *tyres), inputs=(control,), outputs=()
    )
    assert found.attrs["left_out"] == "engine1.thrust"
    size = 1.0 if control.endswith("drive") else 1e-4
    time = np.arange(0.0, 0.5, 0.01)
    step = xr.Dataset(
        {control: ("time", np.full(time.shape, float(start.get(control, 0.0)) + size))},
        {"time": time},
    )
    step[control][0] -= size
    runs = [
        flightmech.simulate(rolling, inputs, start, hold="zero", step=0.0025)
        for inputs in (xr.Dataset(coords={"time": time}), step)
    ]
    A, B = found["A"].values, found["B"].values
    block = np.block([[A, B], [np.zeros((1, len(A) + 1))]])
    x = np.stack([expm(block * max(t - time[1], 0.0))[:-1, -1] * size for t in time])
    outputs = {"V", "alpha", "q", "theta", "beta", "p", "r", "phi", "psi", "h"}
    scale = {"V": 30.0, "h": 30.0}
    for k, name in enumerate(found["state"].values):
        if str(name) in outputs:
            change = (runs[1][str(name)] - runs[0][str(name)]).values
            largest = max(
                np.abs(x[:, j]).max() / scale.get(str(other), 1.0)
                for j, other in enumerate(found["state"].values)
                if other in outputs
            )
            np.testing.assert_allclose(
                x[:, k], change, atol=5e-3 * largest * scale.get(str(name), 1.0), err_msg=str(name)
            )


def test_about_a_turn(plain):
    """The linear model of a banked turn: the rates vanish there, and longitudinal and lateral
    motion are coupled.
    """
    turn = flightmech.trim(
        plain(),
        {"init.V": V, "init.h": H, "mode.earth": 0.0},
        kind="turn",
        fixed={"phi": np.radians(45.0)},
    )
    found = flightmech.linearize(plain(), start_of(turn))
    assert float(np.abs(found["x_dot"]).max()) < 1e-12
    assert float(found["x"].sel(state="phi")) == pytest.approx(np.radians(45.0))
    assert linear.subset(found, "longitudinal").attrs["coupling"] > 1e-2


def test_states_the_model_does_not_have(plain):
    with pytest.raises(UnknownName, match=r"unknown state 'engine1.n1'"):
        flightmech.linearize(plain(), {"init.V": V, "init.h": H}, states=("V", "engine1.n1"))
