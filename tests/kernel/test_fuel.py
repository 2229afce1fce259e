"""Fuel burnt: mass, centre of gravity and inertia of the moment against tanks summed one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flightmech
from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.aircraft.fuel import Fuel, tank_tables
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SimulationError
from flightmech.simulation.kernel import STATE
from flightmech.terms import make_term

STILL = {"init__V": 0.0, "init__h": 0.0, "mode__earth": 0.0, "mode__engine": 0.0}
FLOW = 2.0  # kg/s: empties the tanks within a short run
TANKS = (
    Tank((0.1, -2.0, 0.15), 60.0, order=2),
    Tank((0.1, 2.0, 0.15), 60.0, order=2),
    Tank((0.8, 0.3, -0.1), 50.0, order=1),
    Tank((-1.2, -0.2, 0.3), 90.0, order=3),
)
MASS = 220.0  # on board at the start, of 260


def content(fuel: float) -> list[float]:
    """What each tank holds: the lowest order is emptied first."""
    left, held = fuel, [0.0] * len(TANKS)
    for order in sorted({tank.order for tank in TANKS}, reverse=True):
        own = [i for i, tank in enumerate(TANKS) if tank.order == order]
        room = sum(TANKS[i].capacity for i in own)
        for i in own:
            held[i] = min(left, room) * TANKS[i].capacity / room
        left -= min(left, room)
    assert left == pytest.approx(0.0, abs=1e-9)
    return held


def point(m: float, r: np.ndarray) -> np.ndarray:
    """Inertia tensor of a mass point about the origin."""
    return m * ((r @ r) * np.eye(3) - np.outer(r, r))


def counterpart(craft: flightmech.Aircraft, fuel: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of gravity and inertia tensor about it: the dry aircraft from the one at the
    start, plus what the tanks hold.
    """
    cg0 = np.array(craft.cg)
    bodies = [
        (-held, np.array(tank.position)) for held, tank in zip(content(MASS), TANKS, strict=True)
    ]
    bodies += [
        (held, np.array(tank.position)) for held, tank in zip(content(fuel), TANKS, strict=True)
    ]
    mass = craft.mass + sum(m for m, _ in bodies)
    cg = (craft.mass * cg0 + sum(m * r for m, r in bodies)) / mass
    J = (
        inertia_tensor(craft)
        + point(craft.mass, cg0)
        + sum(point(m, r) for m, r in bodies)
        - point(mass, cg)
    )
    return mass, cg, J


@pytest.fixture(scope="module")
def craft(make_aircraft):
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "thrust": make_term([0.0, 4000.0], {"n2": [0.5, 1.0]}),
            "fuel_flow": make_term(FLOW),
        }
    )
    return make_aircraft(
        engines=(flightmech.aircraft.Engine((0.0, 0.5, 0.0), deck=deck),),
        fuel=Fuel(MASS, tables=tank_tables(TANKS)),
    )


@pytest.fixture(scope="module")
def sim(craft, make_tree):
    return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))


def burnt(sim, run, seconds: float, start: float = 0.0, throttle: float = 0.0) -> dict[str, float]:
    u = np.zeros(len(sim.inputs))
    u[sim.inputs.index("engine1.throttle")] = throttle
    run.step(start, seconds, u, u)
    return dict(zip(sim.outputs, run.outputs(), strict=True))


def test_at_the_start_the_masses_are_those_of_the_aircraft(sim, flown, craft):
    y = flown(sim, **STILL)
    assert y["fuel"] == MASS
    assert y["mass"] == craft.mass
    assert (y["x_cg_b"], y["y_cg_b"], y["z_cg_b"]) == pytest.approx(craft.cg, rel=1e-15)
    names = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    assert [y[name] for name in names] == pytest.approx(
        [getattr(craft, name) for name in names], rel=1e-13
    )


def test_burning_against_the_counterpart(sim, start, craft):
    """Through every tank: each order begins and ends inside the run."""
    run = start(sim, **STILL)
    for k in range(1, 11):
        y = burnt(sim, run, 10.0, start=10.0 * (k - 1), throttle=0.5)
        fuel = MASS - FLOW * 10.0 * k
        mass, cg, J = counterpart(craft, fuel)
        assert y["fuel"] == pytest.approx(fuel, abs=1e-9)  # sum of some thousand steps
        assert y["mass"] == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose([y["x_cg_b"], y["y_cg_b"], y["z_cg_b"]], cg, rtol=1e-11)
        found = np.array(
            [
                [y["Ixx"], -y["Ixy"], -y["Ixz"]],
                [-y["Ixy"], y["Iyy"], -y["Iyz"]],
                [-y["Ixz"], -y["Iyz"], y["Izz"]],
            ]
        )
        np.testing.assert_allclose(found, J, rtol=1e-10, atol=1e-9)


def test_motion_uses_the_mass_of_the_moment(sim, start, craft):
    run = start(sim, **STILL)
    burnt(sim, run, 50.0)
    x = run.state
    names = [row.name for row in sim.entries(STATE)]
    x[names.index("state.p") : names.index("state.r") + 1] = (0.1, -0.2, 0.3)
    x[names.index("state.engine1.n2")] = 0.8
    run.state = x
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    mass, cg, J = counterpart(craft, MASS - 50.0 * FLOW)
    w, force = np.array([0.1, -0.2, 0.3]), np.array([2400.0, 0.0, 0.0])
    moment = np.cross(np.array(craft.engines[0].position) - cg, force)
    assert y["ax"] == pytest.approx(2400.0 / mass, rel=1e-12)
    np.testing.assert_allclose(
        [y["p_dot"], y["q_dot"], y["r_dot"]],
        np.linalg.solve(J, moment - np.cross(w, J @ w)),
        rtol=1e-10,
    )
    assert y["h_agl"] == pytest.approx(y["h"] + float(run_down(y) @ cg), abs=1e-9)


def run_down(y: dict[str, float]) -> np.ndarray:
    """Components of down in body axes."""
    return np.array(
        [
            -np.sin(y["theta"]),
            np.sin(y["phi"]) * np.cos(y["theta"]),
            np.cos(y["phi"]) * np.cos(y["theta"]),
        ]
    )


def test_the_engine_goes_out_when_the_fuel_is_gone(sim, start, craft):
    run = start(sim, **STILL)
    y = burnt(sim, run, 109.0, throttle=1.0)
    assert (y["engine1.burning"], y["engine1.thrust"]) == (1.0, pytest.approx(4000.0))
    y = burnt(sim, run, 5.0, start=109.0, throttle=1.0)
    assert y["engine1.burning"] < 1e-6
    assert y["fuel"] == 0.0
    assert y["mass"] == pytest.approx(craft.mass - MASS, rel=1e-14)
    assert abs(y["engine1.thrust"]) < 0.01
    later = burnt(sim, run, 1.0, start=114.0, throttle=1.0)
    assert (later["fuel"], later["mass"]) == (y["fuel"], y["mass"])


def test_one_mass_point_needs_no_tables(make_tree, craft, start):
    here = np.array([0.3, -0.1, 0.2])
    lone = replace(craft, fuel=Fuel(MASS, tuple(here)))
    sim = flightmech.compile(lone, make_tree({"CD/basic": make_term(0.0)}))
    y = burnt(sim, start(sim, **STILL), 20.0)
    mass, cg0 = craft.mass - 40.0, np.array(craft.cg)
    cg = (craft.mass * cg0 - 40.0 * here) / mass
    J = inertia_tensor(craft) + point(craft.mass, cg0) - point(40.0, here) - point(mass, cg)
    np.testing.assert_allclose([y["x_cg_b"], y["y_cg_b"], y["z_cg_b"]], cg, rtol=1e-12)
    np.testing.assert_allclose([y["Ixx"], y["Iyy"], y["Izz"]], np.diag(J), rtol=1e-12)
    np.testing.assert_allclose(
        [y["Ixy"], y["Ixz"], y["Iyz"]], [-J[0, 1], -J[0, 2], -J[1, 2]], rtol=1e-9
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"init__fuel": -1.0},
            "init.fuel is -1; it must be zero or positive, and less than mass.mass",
        ),
        (
            {"init__fuel": 2300.0},
            "init.fuel is 2300; it must be zero or positive, and less than mass.mass",
        ),
        (
            {"mass__Ixx": 200.0},
            "without its fuel the aircraft has no positive definite inertia; check init.fuel, fuel",
        ),
    ],
)
def test_masses_without_meaning_are_refused(sim, flown, changed, message):
    with pytest.raises(SimulationError, match=message):
        flown(sim, **STILL, **changed)
