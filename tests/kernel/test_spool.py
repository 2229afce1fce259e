"""The full deck of an engine: tables by hand, spools against closed forms, lever delay, flame,
drives, forces.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

import flightmech
from flightmech import air, terms
from flightmech.aircraft.aircraft import inertia_tensor
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import SimulationError
from flightmech.simulation.kernel import STATE, Simulation
from flightmech.terms import make_term

STILL = {"init__V": 0.0, "init__h": 0.0, "mode__earth": 0.0, "mode__engine": 0.0}
N2 = {
    "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
    "n2_up_time": make_term(0.5),
    "n2_down_time": make_term(0.8),
}
STATIC = {
    **N2,
    "n1_command": make_term([0.2, 0.9], {"n2": [0.5, 1.0]}),
    "n1_up_time": make_term(0.4),
    "corrected_thrust": make_term(
        [[100.0, -50.0], [5000.0, 4000.0]], {"corrected_n1": [0.2, 1.0], "mach": [0.0, 0.6]}
    ),
    "corrected_air_flow": make_term([5.0, 30.0], {"corrected_n1": [0.2, 1.0]}),
    "corrected_fuel_flow": make_term([0.02, 0.12], {"corrected_n2": [0.5, 1.0]}),
    "corrected_itt": make_term([600.0, 900.0], {"corrected_n2": [0.5, 1.0]}),
    "corrected_n1_windmill": make_term([0.0, 0.3], {"mach": [0.0, 0.6]}),
    "corrected_n2_windmill": make_term([0.0, 0.15], {"mach": [0.0, 0.6]}),
    "windmill_thrust": make_term(-0.02, regressors=["qbar"]),
}


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    """Compile the jet without aerodynamics, with one deck at the moment reference or the decks
    given.
    """

    def of(*decks: EngineDeck, **changes) -> flightmech.SimModel:
        places = [(0.0, 0.0, 0.0)] if len(decks) == 1 else [(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)]
        engines = tuple(
            flightmech.aircraft.Engine(place, deck=deck)
            for place, deck in zip(places, decks, strict=True)
        )
        return flightmech.compile(
            make_aircraft(engines=engines, **changes), make_tree({"CD/basic": make_term(0.0)})
        )

    return of


@pytest.fixture(scope="module")
def static(compiled) -> flightmech.SimModel:
    return compiled(EngineDeck(STATIC))


def with_thrust(**tables: xr.Dataset | float) -> EngineDeck:
    """A deck of N2 alone with a thrust, changed."""
    leaves = {
        name: leaf if isinstance(leaf, xr.Dataset) else make_term(leaf)
        for name, leaf in tables.items()
    }
    return EngineDeck({**N2, "thrust": make_term([0.0, 4000.0], {"n2": [0.5, 1.0]}), **leaves})


def values(sim: flightmech.SimModel, run: Simulation) -> dict[str, float]:
    return dict(zip(sim.outputs, run.outputs(), strict=True))


def inputs(sim: flightmech.SimModel, **given: float) -> np.ndarray:
    u = np.zeros(len(sim.inputs))
    for key, value in given.items():
        u[sim.inputs.index(key.replace("__", "."))] = value
    return u


def flown_through(
    sim: flightmech.SimModel,
    run: Simulation,
    u: np.ndarray,
    seconds: float,
    step: float = 0.01,
    start: float = 0.0,
):
    """Step with constant inputs; the outputs at the end."""
    for k in range(round(seconds / step)):
        run.step(start + k * step, step, u, u)
    return values(sim, run)


FLIGHT = {"mode__engine": 0.0, "init__V": 120.0, "init__h": 4000.0, "engine1__throttle": 0.6}


def test_static_deck_by_hand(static, flown):
    y = flown(static, **FLIGHT)
    atm = air.atmosphere(y["h"])
    mach = 120.0 / float(atm.a_sound)
    theta, delta = (
        float(atm.temperature) / 288.15 * (1.0 + 0.2 * mach**2),
        float(atm.p_static) / 101325.0,
    )
    root = theta**0.5
    n2, n1 = 0.5 + 0.5 * 0.6, 0.2 + 0.7 * 0.6
    at = {"corrected_n1": n1 / root, "corrected_n2": n2 / root, "mach": mach}

    def of(name: str) -> float:
        return float(terms.evaluate_term(STATIC[name], at))

    gross, flow = delta * of("corrected_thrust"), delta / root * of("corrected_air_flow")
    expected = {
        "n1": n1,
        "n2": n2,
        "gross_thrust": gross,
        "air_flow": flow,
        "ram_drag": flow * 120.0,
        "thrust": gross - flow * 120.0,
        "fuel_flow": delta * root * of("corrected_fuel_flow"),
        "itt": theta * of("corrected_itt"),
        "burning": 1.0,
        "pla": 0.6,
    }
    assert {name: y[f"engine1.{name}"] for name in expected} == pytest.approx(expected, rel=1e-12)


def test_start_is_steady(static, start):
    run = start(static, **FLIGHT)
    rate = run.derivative(run.state, inputs(static, engine1__throttle=0.6))
    own = [i for i, row in enumerate(static.entries(STATE)) if row.name.startswith("state.engine")]
    assert len(own) == 5  # lagged thrust, n1, n2, flame, turbine temperature
    np.testing.assert_allclose(rate[own], 0.0, atol=1e-14)


def test_ram_drag_acts_at_the_inlet_against_the_airspeed(compiled, flown, make_aircraft):
    deck = EngineDeck(
        {**N2, "thrust": make_term(0.0), "air_flow": make_term(20.0)}, inlet=(0.5, 0.4, -0.3)
    )
    y = flown(compiled(deck), **FLIGHT, init__alpha=0.1, init__beta=0.05)
    force = -20.0 * np.array([y["u"], y["v"], y["w"]])
    craft = make_aircraft()
    moment = np.cross(np.array(deck.inlet) - craft.cg, force)
    np.testing.assert_allclose([y["ax"], y["ay"], y["az"]], force / craft.mass, rtol=1e-12)
    np.testing.assert_allclose(
        [y["p_dot"], y["q_dot"], y["r_dot"]],
        np.linalg.solve(inertia_tensor(craft), moment),
        rtol=1e-11,
    )
    assert force @ [y["u"], y["v"], y["w"]] < 0.0  # takes energy away
    assert y["engine1.thrust"] == pytest.approx(-20.0 * 120.0)


@pytest.mark.parametrize(("before", "after", "tau"), [(0.0, 1.0, 0.5), (1.0, 0.2, 0.8)])
def test_spool_without_limits_is_first_order(compiled, start, before, after, tau):
    sim = compiled(with_thrust())
    y = flown_through(
        sim,
        start(sim, **STILL, engine1__throttle=before),
        inputs(sim, engine1__throttle=after),
        0.6,
    )
    goal, n = 0.5 + 0.5 * after, 0.5 + 0.5 * before
    assert y["engine1.n2"] == pytest.approx(
        goal + (n - goal) * np.exp(-0.6 / tau), abs=2e-9
    )  # RK4: (0.01/0.5)^4 / 120
    assert y["engine1.thrust"] == pytest.approx(8000.0 * (y["engine1.n2"] - 0.5))


@pytest.mark.parametrize(
    ("before", "after", "tau", "limit"), [(0.0, 1.0, 0.5, 0.25), (1.0, 0.0, 0.8, 0.125)]
)
def test_limited_spool_runs_straight_then_first_order(compiled, start, before, after, tau, limit):
    """The rate is limited until the gap is limit x tau; chop and slam have limits of their own."""
    sim = compiled(with_thrust(n2_up_limit=0.25, n2_down_limit=0.125))
    run, u = start(sim, **STILL, engine1__throttle=before), inputs(sim, engine1__throttle=after)
    goal, n = 0.5 + 0.5 * after, 0.5 + 0.5 * before
    way = np.sign(goal - n)
    straight = (abs(goal - n) - limit * tau) / limit
    y = flown_through(sim, run, u, 1.0)
    assert y["engine1.n2"] == pytest.approx(n + way * limit * 1.0, abs=1e-13)
    y = flown_through(sim, run, u, 4.0, start=1.0)
    expected = goal - way * limit * tau * np.exp(-(5.0 - straight) / tau)
    assert y["engine1.n2"] == pytest.approx(
        expected, abs=1e-6
    )  # the kink lies inside a step: error below h^2 limit / tau / 8


def test_time_constant_depends_on_the_speed(compiled, start):
    """tau = 2 - 1.5 n: between n' = (1 - n) / tau and its integral 1.5 (n - n0) - 0.5 ln((1 - n)/(1
    - n0)) = t.
    """
    sim = compiled(with_thrust(n2_up_time=make_term([2.0, 0.5], {"n2": [0.0, 1.0]})))
    n = flown_through(sim, start(sim, **STILL), inputs(sim, engine1__throttle=1.0), 1.5)[
        "engine1.n2"
    ]
    assert 1.5 * (n - 0.5) - 0.5 * np.log((1.0 - n) / 0.5) == pytest.approx(1.5, abs=1e-7)


def test_corrected_command_and_pla(compiled, flown):
    """A schedule over the lever angle, of the corrected speed."""
    schedule = make_term([0.5, 1.0], {"pla": [0.2, 1.2]})
    deck = EngineDeck(
        {"corrected_n1_command": schedule, "n1_up_time": make_term(0.5), "thrust": make_term(0.0)},
        pla_idle=0.2,
        pla_full=1.2,
    )
    y = flown(compiled(deck), **{**FLIGHT, "init__h": 9000.0})
    root = (
        float(air.atmosphere(9000.0).temperature) / 288.15 * (1.0 + 0.2 * y["mach"] ** 2)
    ) ** 0.5
    assert y["engine1.pla"] == pytest.approx(0.8, rel=1e-15)
    assert y["engine1.n1"] == pytest.approx(0.8 * root, rel=1e-12)
    assert y["engine1.n2"] == 0.0


def lever_record() -> tuple[np.ndarray, np.ndarray]:
    """Ramps and rests at uneven times."""
    return np.array([0.0, 0.4, 0.47, 0.9, 1.0, 1.03, 2.0, 3.0]), np.array(
        [0.1, 0.1, 0.8, 0.8, 0.2, 0.25, 1.0, 1.0]
    )


def steps_of(seed: int, end: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.unique(np.concatenate([[0.0, end], rng.uniform(0.0, end, 200), lever_record()[0]]))


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.004, 0.23, 1.7])
@pytest.mark.parametrize("seed", [1, 2])
def test_lever_delay_is_exact_at_any_steps(compiled, start, delay, seed):
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__throttle=0.1, engine1__lever_delay=delay)
    knots, lever = lever_record()
    time = steps_of(seed, 3.0)
    for t0, t1 in pairwise(time):
        u0, u1 = (
            inputs(sim, engine1__throttle=float(np.interp(t, knots, lever))) for t in (t0, t1)
        )
        run.step(t0, t1 - t0, u0, u1)
        assert values(sim, run)["engine1.pla"] == pytest.approx(
            float(np.interp(t1 - delay, knots, lever)), abs=1e-12
        )


def test_delayed_lever_without_dynamics_moves_the_spool_alike_at_any_steps(compiled, start):
    """Random communication steps against uniform ones: what differs is the error of the
    integration.
    """
    sim = compiled(with_thrust())
    knots, lever = lever_record()

    def final(time: np.ndarray) -> float:
        run = start(
            sim, **STILL, engine1__throttle=0.1, engine1__lever_delay=0.23, mode__step=0.002
        )
        for t0, t1 in pairwise(time):
            u0, u1 = (
                inputs(sim, engine1__throttle=float(np.interp(t, knots, lever))) for t in (t0, t1)
            )
            run.step(t0, t1 - t0, u0, u1)
        return values(sim, run)["engine1.n2"]

    uniform = final(np.unique(np.concatenate([np.linspace(0.0, 2.0, 201), knots[knots < 2.0]])))
    for seed in (3, 4):
        time = steps_of(seed, 3.0)
        assert final(np.append(time[time < 2.0], 2.0)) == pytest.approx(uniform, abs=1e-7)


def test_held_inputs_jump_after_the_delay(compiled, start):
    """A jump that arrives between two steps counts from the step that begins with it: n2 is first
    order to rounding of RK4.
    """
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__lever_delay=0.3)
    full = inputs(sim, engine1__throttle=1.0)
    run.step(0.0, 0.1, inputs(sim), inputs(sim))
    for k in range(10, 100):
        run.step(k * 0.01, 0.01, full, full)
        y = values(sim, run)
        age = max((k + 1) * 0.01 - 0.4, 0.0)
        assert y["engine1.n2"] == pytest.approx(1.0 - 0.5 * np.exp(-age / 0.5), abs=2e-9)


def test_many_knots_within_the_delay_are_thinned_not_lost(compiled, start):
    """A noisy lever at 1 kHz and a delay of 2 s: 2000 knots; what is thinned lies within delay /
    200 in time.
    """
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__throttle=0.5, engine1__lever_delay=2.0)
    time = np.arange(0.0, 5.0, 0.001)
    lever = 0.5 + 0.4 * np.sin(time) + 0.001 * (np.arange(len(time)) % 2)
    for k in range(len(time) - 1):
        run.step(
            time[k],
            0.001,
            inputs(sim, engine1__throttle=lever[k]),
            inputs(sim, engine1__throttle=lever[k + 1]),
        )
    assert values(sim, run)["engine1.pla"] == pytest.approx(
        0.5 + 0.4 * np.sin(time[-1] - 2.0), abs=0.4 * 0.01 + 0.001
    )


def test_copy_carries_the_lever_history(compiled, start):
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__lever_delay=0.5)
    flown_through(sim, run, inputs(sim, engine1__throttle=1.0), 0.3)
    counterpart = run.copy()
    u = inputs(sim, engine1__throttle=0.4)
    flown_through(sim, counterpart, u, 0.5, start=0.3)  # another future first
    assert flown_through(sim, run.copy(), u, 0.5, start=0.3) == flown_through(
        sim, run, u, 0.5, start=0.3
    )


def test_start_up_and_shut_down(compiled, start):
    """Cranked to light-off, up to idle by the acceleration table, cut off and run down: each piece
    by its closed form.
    """
    deck = EngineDeck(
        {
            **N2,
            "thrust": make_term([0.0, 4000.0], {"n2": [0.5, 1.0]}),
            "fuel_flow": make_term(0.05),
            "n2_up_limit": make_term(0.05),
            "itt": make_term(900.0),
        },
        starter_speed=0.25,
        starter_time=2.0,
        light_speed=0.15,
        n2_rundown=5.0,
        flame_time=0.2,
    )
    sim = compiled(deck)
    run = start(sim, **STILL, engine1__cutoff=1.0)
    cranking = inputs(sim, engine1__cutoff=1.0, engine1__starter=1.0)
    y = values(sim, run)
    assert (y["engine1.n2"], y["engine1.burning"], y["engine1.fuel_flow"], y["engine1.itt"]) == (
        0.0,
        0.0,
        0.0,
        pytest.approx(288.15),
    )
    y = flown_through(sim, run, cranking, 1.0)
    assert y["engine1.n2"] == pytest.approx(0.25 * (1.0 - np.exp(-0.5)), abs=1e-9)
    y = flown_through(
        sim, run, inputs(sim, engine1__starter=1.0), 0.5, start=1.0
    )  # fuel on below the light-off speed: nothing yet
    assert y["engine1.burning"] == 0.0
    y = flown_through(sim, run, inputs(sim, engine1__starter=1.0), 1.0, start=1.5)
    lit = 2.0 * np.log(0.25 / 0.10)  # when 0.25 (1 - exp(-t/2)) is 0.15
    assert y["engine1.burning"] == pytest.approx(
        1.0 - np.exp(-(2.5 - lit) / 0.2), abs=0.01
    )  # the crossing lies inside a step
    n = y["engine1.n2"]
    y = flown_through(sim, run, inputs(sim), 2.0, start=2.5)
    assert y["engine1.n2"] == pytest.approx(n + 0.05 * 2.0, abs=2e-3)  # the flame was at 0.96
    y = flown_through(sim, run, inputs(sim), 20.0, start=4.5)
    assert y["engine1.n2"] == pytest.approx(0.5, abs=1e-9)
    assert (y["engine1.fuel_flow"], y["engine1.itt"]) == pytest.approx((0.05, 900.0))
    y = flown_through(sim, run, inputs(sim, engine1__cutoff=1.0), 4.0, start=24.5)
    b = np.exp(-4.0 / 0.2)
    down = solve_ivp(  # while the flame lives the governor still accelerates
        lambda t, n: (
            min((0.5 - n[0]) / 0.5, 0.05) * np.exp(-t / 0.2) - (1.0 - np.exp(-t / 0.2)) * n[0] / 5.0
        ),
        (0.0, 4.0),
        [0.5],
        rtol=1e-10,
        atol=1e-12,
    )
    assert y["engine1.burning"] == pytest.approx(b, rel=1e-4)
    assert y["engine1.n2"] == pytest.approx(down.y[0, -1], rel=1e-6)
    assert y["engine1.fuel_flow"] == pytest.approx(0.05 * b, rel=1e-4)


def test_windmilling(static, start, flown):
    y = flown(static, **FLIGHT, engine1__cutoff=1.0)
    theta = float(air.atmosphere(4000.0).temperature) / 288.15 * (1.0 + 0.2 * y["mach"] ** 2)
    assert y["engine1.n1"] == pytest.approx(theta**0.5 * 0.5 * y["mach"], rel=1e-12)
    assert y["engine1.n2"] == pytest.approx(theta**0.5 * 0.25 * y["mach"], rel=1e-12)
    assert y["engine1.gross_thrust"] == pytest.approx(-0.02 * y["qbar"], rel=1e-12)
    assert y["engine1.itt"] == pytest.approx(theta * 288.15, rel=1e-12)
    assert y["engine1.fuel_flow"] == 0.0
    run = start(static, **FLIGHT)
    x = run.state
    names = [row.name for row in static.entries(STATE)]
    n2 = x[names.index("state.engine1.n2")]
    x[names.index("state.engine1.burning")] = 0.0
    rate = run.derivative(x, inputs(static, engine1__throttle=0.6))[names.index("state.engine1.n2")]
    assert rate == pytest.approx((y["engine1.n2"] - n2) / 8.0, rel=1e-12)


def test_flame_out_needs_ignition_to_light_again(compiled, start):
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__throttle=1.0)
    on = inputs(sim, engine1__throttle=1.0)
    flown_through(sim, run, inputs(sim, engine1__throttle=1.0, engine1__flameout=1.0), 1.0)
    assert flown_through(sim, run, on, 1.0, start=1.0)["engine1.burning"] < 1e-3
    relit = flown_through(
        sim, run, inputs(sim, engine1__throttle=1.0, engine1__ignition=1.0), 5.0, start=2.0
    )
    assert relit["engine1.burning"] == pytest.approx(1.0, abs=1e-9)
    assert flown_through(sim, run, on, 1.0, start=7.0)["engine1.burning"] == pytest.approx(
        1.0, abs=1e-9
    )


def test_too_slow_to_light_or_to_go_on(compiled, start):
    sim = compiled(with_thrust())
    run = start(sim, **STILL, engine1__cutoff=1.0)
    assert (
        flown_through(sim, run, inputs(sim, engine1__ignition=1.0), 3.0)["engine1.burning"] == 0.0
    )
    run = start(
        sim, **STILL, engine1__light_speed=0.6, engine1__sustain_speed=0.55, engine1__throttle=1.0
    )
    assert (
        flown_through(sim, run, inputs(sim), 5.0)["engine1.burning"] < 1e-3
    )  # the lever is pulled to an idle of 0.5


def test_envelopes(compiled, flown, start):
    """The flame goes out where burn_margin is negative and lights only where light_margin is
    not.
    """
    margin = {
        "burn_margin": make_term([1.0, -1.0], {"h": [8000.0, 12000.0]}),
        "light_margin": make_term([1.0, -1.0], {"h": [5000.0, 7000.0]}),
    }
    sim = compiled(with_thrust(**margin))
    for h, burning in ((9900.0, 1.0), (10100.0, 0.0)):
        assert flown(sim, mode__engine=0.0, init__h=h)["engine1.burning"] == burning
    for h, lights in ((5900.0, True), (6100.0, False)):
        run = start(sim, mode__engine=0.0, init__h=h, init__V=150.0, engine1__throttle=1.0)
        flown_through(sim, run, inputs(sim, engine1__throttle=1.0, engine1__flameout=1.0), 1.0)
        y = flown_through(
            sim, run, inputs(sim, engine1__throttle=1.0, engine1__ignition=1.0), 2.0, start=1.0
        )
        assert (y["engine1.burning"] > 0.99) == lights


def test_one_engine_failed_yaws_towards_it(compiled, flown, make_aircraft):
    sim = compiled(with_thrust(), with_thrust())
    y = flown(sim, **STILL, engine1__throttle=1.0, engine2__throttle=1.0, engine2__cutoff=1.0)
    craft = make_aircraft()
    assert (y["engine1.thrust"], y["engine2.thrust"]) == (pytest.approx(4000.0), 0.0)
    moment = np.cross(np.array([0.0, -1.0, 0.0]) - craft.cg, [y["engine1.thrust"], 0.0, 0.0])
    np.testing.assert_allclose(
        [y["p_dot"], y["q_dot"], y["r_dot"]],
        np.linalg.solve(inertia_tensor(craft), moment),
        rtol=1e-11,
    )
    assert y["r_dot"] > 0.0  # left engine pushes, right engine is dead


def test_n1_drives(compiled, start):
    deck = EngineDeck(
        {**STATIC, "corrected_n2_driven": make_term([0.4, 1.0], {"corrected_n1": [0.1, 1.0]})}
    )
    sim = compiled(deck)
    run = start(sim, **{**FLIGHT, "mode__engine": 1.0}, engine1__n1_drive=0.7)
    for n1 in (0.7, 0.9):
        u = inputs(sim, engine1__throttle=0.1, engine1__n1_drive=n1)
        run.step(0.0 if n1 == 0.7 else 0.01, 0.01, u, u)
        y = values(sim, run)
        theta = y["temperature"] / 288.15 * (1.0 + 0.2 * y["mach"] ** 2)
        corrected_n2 = 0.4 + 0.6 / 0.9 * (n1 / theta**0.5 - 0.1)
        assert y["engine1.n1"] == n1
        assert y["engine1.n2"] == pytest.approx(corrected_n2 * theta**0.5, rel=1e-12)
        thrust = float(
            terms.evaluate_term(
                STATIC["corrected_thrust"], {"corrected_n1": n1 / theta**0.5, "mach": y["mach"]}
            )
        )
        assert y["engine1.gross_thrust"] == pytest.approx(
            thrust * y["p_static"] / 101325.0, rel=1e-12
        )
        fuel = float(
            terms.evaluate_term(STATIC["corrected_fuel_flow"], {"corrected_n2": corrected_n2})
        )
        assert y["engine1.fuel_flow"] == pytest.approx(
            fuel * y["p_static"] / 101325.0 * theta**0.5, rel=1e-12
        )


def test_recorded_thrust_is_net(static, flown, make_aircraft):
    """The spools still follow the lever, but neither the deck's thrust nor its ram drag acts."""
    y = flown(static, **{**FLIGHT, "mode__engine": 2.0}, engine1__thrust_drive=1500.0)
    assert (y["engine1.thrust"], y["engine1.ram_drag"]) == (1500.0, 0.0)
    assert y["ax"] == pytest.approx(1500.0 / make_aircraft().mass, rel=1e-13)
    assert y["engine1.n2"] == pytest.approx(0.8)


def test_rotors_keep_the_angular_momentum(compiled, start, make_aircraft):
    """Without outer moments, J w + H of the rotors that speed up stays what it was, in
    magnitude.
    """
    craft = {"cg": (0.0, 0.0, 0.0), "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0}
    sim = compiled(
        EngineDeck(
            {**STATIC, "corrected_thrust": make_term(0.0), "corrected_air_flow": make_term(0.0)},
            n1_rated=1500.0,
            n2_rated=-3000.0,
            n1_inertia=0.4,
            n2_inertia=0.1,
        ),
        **craft,
    )
    run = start(sim, **STILL, init__p=0.05, init__q=0.3, init__r=-0.2)
    J = inertia_tensor(make_aircraft(**craft))

    def momentum(y: dict[str, float]) -> np.ndarray:
        return J @ [y["p"], y["q"], y["r"]] + [
            600.0 * y["engine1.n1"] - 300.0 * y["engine1.n2"],
            0.0,
            0.0,
        ]

    first = values(sim, run)
    last = flown_through(sim, run, inputs(sim, engine1__throttle=1.0), 2.0)
    spun_up = 600.0 * (last["engine1.n1"] - first["engine1.n1"]) - 300.0 * (
        last["engine1.n2"] - first["engine1.n2"]
    )
    assert spun_up > 200.0
    assert np.linalg.norm(momentum(last)) == pytest.approx(
        np.linalg.norm(momentum(first)), rel=1e-10
    )
    rest = flown_through(sim, start(sim, **STILL), inputs(sim, engine1__throttle=1.0), 2.0)
    assert rest["p"] == pytest.approx(
        -spun_up / J[0, 0], rel=1e-10
    )  # the airframe turns against the rotor that speeds up


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"engine1__lever_delay": -0.1},
            "engine1.lever_delay is -0.1; it must be zero or positive",
        ),
        ({"engine1__n2_rundown": 0.0}, "engine1.n2_rundown is 0; it must be 0.02 s or more"),
        (
            {"engine1__itt_time": 0.001},
            "engine1.itt_time is 0.001; it must be 0, or 0.02 s or more",
        ),
        (
            {"engine1__light_speed": 0.01},
            "engine1.light_speed is 0.01; it must be at least sustain_speed, below which the "
            "flame goes out",
        ),
        ({"engine1__n1_inertia": -1.0}, "engine1.n1_inertia is -1; it must be zero or positive"),
    ],
)
def test_constants_without_meaning_are_refused(static, flown, changed, message):
    with pytest.raises(SimulationError, match=message):
        flown(static, **STILL, **changed)


def test_n1_drive_needs_a_deck(make_aircraft, make_tree, flown):
    sim = flightmech.compile(make_aircraft(), make_tree({"CD/basic": make_term(0.0)}))
    with pytest.raises(
        SimulationError,
        match=r"mode.engine = 1 drives N1, but the engines have no deck of spool speeds",
    ):
        flown(sim, **{**STILL, "mode__engine": 1.0})
