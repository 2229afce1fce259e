"""Flow separation of the wing halves: closed forms, order of the integration, limits, trim,
roll.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.separation import FlowSeparation
from flightmech.errors import SchemaError, SimulationError
from flightmech.names import SEPARATION
from flightmech.steady_flight.linear_model import linearize
from flightmech.terms import make_term

A1, STAR, TAU1, TAU2, STATION = 20.0, 0.3, 6.0, 8.0, 2.4
CBAR = 1.67  # of the jet in conftest
LEFT, RIGHT = 15, 16  # places of the states: rigid body, thrust of two engines


def separation(**changes: object) -> FlowSeparation:
    numbers = {"a1": A1, "alpha_star": STAR, "tau1": TAU1, "tau2": TAU2} | changes
    tables = {name: item for name, item in numbers.items() if isinstance(item, xr.Dataset)}
    tables |= {name: make_term(item) for name, item in numbers.items() if name not in tables}
    return FlowSeparation(STATION, tables)


def steady(alpha: np.ndarray | float, star: float = STAR, a1: float = A1) -> np.ndarray:
    return 0.5 * (1.0 - np.tanh(a1 * (np.asarray(alpha) - star)))


@pytest.fixture
def stalling(make_aircraft, content, make_tree):
    """Return a model of the jet with a separation; `terms` replace or add terms."""

    def compiled(terms: dict[str, xr.Dataset] | None = None, **changes: object):
        craft = make_aircraft(stall=separation(**changes))
        return flightmech.compile(craft, make_tree(content | (terms or {})))

    return compiled


# roll from the difference of the lift, and a roll damping of the attached flow alone
ROLLING = {
    "CL/kirchhoff": make_term([-3.0, 0.0], {"X_lift": [0.25, 1.0]}, ["alpha"]),
    "Cl/kirchhoff": make_term(0.6, regressors=["X_lift_diff", "alpha"]),
    "Cl/phat": make_term([0.0, -0.44], {"X": [0.0, 1.0]}, ["phat"]),
}


@pytest.fixture(scope="module")
def falling(make_aircraft, make_tree):
    """A body without aerodynamic force: in a vertical fall its alpha is what it was at the
    start.
    """
    craft = make_aircraft(stall=separation(), engines=())
    return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))


def fall(sim, run, time: float, steps: int) -> np.ndarray:
    u = np.zeros(len(sim.inputs))
    for i in range(steps):
        run.step(i * time / steps, time / steps, u, u)
    return run.state[13:15]


def test_a_step_of_alpha_decays_exponentially(falling, start):
    """dX/dt = (X0 - X) V / (tau1 cbar) with V = V0 + g t: an exponential of the way travelled."""
    alpha, V = 0.33, 60.0
    run = start(
        falling, init__V=V, init__alpha=alpha, init__theta=alpha - np.pi / 2, mode__earth=0.0
    )
    before = np.array([1.0, 0.25])
    x = run.state
    x[13:15] = before
    run.state = x
    found = fall(falling, run, 0.3, 60)
    chords = (V * 0.3 + 0.5 * 9.80665 * 0.3**2) / CBAR
    target = float(steady(alpha))
    expected = target + (before - target) * np.exp(-chords / TAU1)
    assert found == pytest.approx(expected, abs=2e-8)
    assert expected[0] < 0.45


def test_the_integration_is_of_fourth_order(falling, start):
    """X in a fall that pitches through the stall: half the step, a sixteenth of the error."""
    found = {}
    for steps in (8, 16, 32, 1024):
        run = start(
            falling, init__V=60.0, init__alpha=0.2, init__q=0.25, mode__earth=0.0, mode__step=0.1
        )
        found[steps] = fall(falling, run, 0.4, steps)[0]
    errors = [abs(found[steps] - found[1024]) for steps in (8, 16, 32)]
    assert found[1024] < 0.95
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.2)


def test_the_rate_is_that_of_the_equation_with_roll_and_yaw(stalling, start):
    sim = stalling(ROLLING, asymmetry=0.02)
    run = start(
        sim,
        init__V=55.0,
        init__h=1500.0,
        init__alpha=0.29,
        init__p=0.3,
        init__q=0.1,
        init__r=-0.2,
        mode__earth=0.0,
    )
    x, u = run.state, np.zeros(len(sim.inputs))
    x[LEFT:] = 0.7, 0.4
    run.state = x
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    rate = run.derivative(x, u)
    # d(u, v, w)/dt by the specific force, gravity and the rotation
    g = 9.80665 * np.array([-np.sin(y["theta"]), 0.0, np.cos(y["theta"]) * np.cos(y["phi"])])
    du = y["ax"] + g[0] - (y["q"] * y["w"] - y["r"] * y["v"])
    dw = y["az"] + g[2] - (y["p"] * y["v"] - y["q"] * y["u"])
    for place, side in ((LEFT, -1.0), (RIGHT, 1.0)):
        station = side * STATION
        u_h, w_h = y["u"] - y["r"] * station, y["w"] + y["p"] * station
        du_h, dw_h = du - y["r_dot"] * station, dw + y["p_dot"] * station
        alpha_dot = (u_h * dw_h - w_h * du_h) / (u_h**2 + w_h**2)
        delayed = np.arctan2(w_h, u_h) - TAU2 * CBAR / y["V"] * alpha_dot
        target = steady(delayed, STAR + 0.5 * side * 0.02)
        expected = y["V"] / (TAU1 * CBAR) * (float(target) - x[place])
        assert rate[place] == pytest.approx(expected, rel=1e-10)


def test_terms_see_the_variables(make_aircraft, make_tree, start):
    """Each coefficient is one variable of the separation."""
    places = dict(zip(("CL", "CD", "CY", "Cl", "Cm", "Cn"), SEPARATION, strict=True))
    terms = {f"{c}/{name}": make_term(1.0, regressors=[name]) for c, name in places.items()}
    sim = flightmech.compile(make_aircraft(stall=separation()), make_tree(terms))
    run = start(sim, init__V=55.0, init__alpha=0.2, mode__earth=0.0)
    x = run.state
    x[LEFT:] = 0.49, 0.16
    run.state = x
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    left, right = 0.85**2, 0.7**2
    expected = {"X": 0.325, "X_left": 0.49, "X_right": 0.16, "X_diff": 0.33}
    expected |= {"X_lift": 0.5 * (left + right), "X_lift_diff": left - right}
    for coefficient, name in places.items():
        assert y[coefficient] == pytest.approx(expected[name], rel=1e-14)


def test_halves_alike_do_not_roll(make_aircraft, content, make_tree):
    """Symmetric aircraft, no asymmetry: through the stall and back without a roll to the last
    bit.
    """
    symmetric = {k: v for k, v in content.items() if k not in ("Cn/basic", "Cm/power")}
    craft = make_aircraft(stall=separation(), cg=(0.06, 0.0, 0.22), Ixy=0.0, Iyz=0.0, engines=())
    sim = flightmech.compile(craft, make_tree(symmetric | ROLLING))
    y = pull_up(sim)
    assert y["stall.X_left"].values.min() < 0.2
    assert (y["stall.X_left"].values == y["stall.X_right"].values).all()
    assert (y["p"].values == 0.0).all()
    assert (y["r"].values == 0.0).all()


def pull_up(sim, **parameters: float) -> xr.Dataset:
    time = np.arange(0.0, 10.0, 0.05)
    pull = np.interp(time, [0.0, 4.0, 6.0, 7.0], [-0.1, -0.35, -0.35, 0.05])
    record = xr.Dataset({"delta_e": ("time", pull)}, coords={"time": time})
    start = {"init.V": 60.0, "init.h": 3000.0, "mode.earth": 0.0, "init.alpha": 0.15}
    return flightmech.simulate(sim, record, start | parameters)


def test_the_wing_with_the_lower_alpha_star_drops(stalling):
    """Roll-off towards the half that separates first; the attached flow hardly rolls."""
    for asymmetry in (-0.02, 0.02):
        y = pull_up(stalling(ROLLING, asymmetry=asymmetry))
        # a positive asymmetry: the left half separates first, the left wing drops, p < 0
        drop = y["p"].values[(y["time"].values > 2.0) & (y["time"].values < 5.0)]
        assert np.sign(asymmetry) * drop.min() < 0.0 or np.sign(asymmetry) * drop.max() < 0.0
        assert abs(drop[np.argmax(np.abs(drop))]) > 0.1
        assert np.sign(drop[np.argmax(np.abs(drop))]) == -np.sign(asymmetry)


def roll_damping(sim, alpha: float, start) -> float:
    """Rolling moment over the reduced roll rate with both halves at their steady values."""
    found = []
    for p in (0.1, -0.1):
        run = start(sim, init__V=55.0, init__alpha=alpha, init__p=p, mode__earth=0.0)
        y = dict(zip(sim.outputs, run.outputs(), strict=True))
        found.append(y["Cl"])
    return (found[0] - found[1]) / (0.2 * 10.3 / (2.0 * 55.0))


def test_autorotation_appears_beyond_the_stall(stalling, start):
    sim = stalling(ROLLING)
    assert roll_damping(sim, 0.1, start) == pytest.approx(-0.44, abs=0.01)
    assert roll_damping(sim, 0.30, start) > 0.3
    # far beyond, both halves are separated alike: neither damping nor autorotation by the lift
    assert abs(roll_damping(sim, 0.6, start)) < 0.02


def test_X_stays_between_zero_and_one(stalling):
    sim = stalling(ROLLING, tau1=0.01, a1=200.0, asymmetry=0.01)
    y = pull_up(sim)
    for side in ("left", "right"):
        X = y[f"stall.X_{side}"].values
        assert X.min() >= 0.0
        assert X.max() <= 1.0
        assert X.min() < 1e-3
        assert X.max() > 0.999


def test_the_start_and_the_trim_are_steady(stalling, start):
    sim = stalling(ROLLING, asymmetry=0.01, tau2=0.0)
    conditions = {"init.V": 43.0, "init.h": 1500.0, "mode.earth": 0.0, "mode.trim": 2}
    y = flightmech.trim(sim, {k: v for k, v in conditions.items() if k != "mode.trim"})
    assert 0.1 < float(y["stall.X_left"]) < 0.98
    for side, sign in (("left", -1.0), ("right", 1.0)):
        expected = steady(float(y["alpha"]), STAR + sign * 0.005)
        assert float(y[f"stall.X_{side}"]) == pytest.approx(float(expected), rel=1e-12)
    # held for half a second: nothing moves
    names = [k.replace(".", "__") for k in conditions]
    run = start(sim, **dict(zip(names, conditions.values(), strict=True)))
    u = np.zeros(len(sim.inputs))
    assert np.abs(run.derivative(run.state, u)[LEFT:]).max() < 1e-9


def test_linear_model_with_states_and_quasi_steady(stalling):
    """Chosen as a state, X follows with V / (tau1 cbar); left out, it follows alpha at once."""
    sim = stalling(ROLLING, tau2=0.0)
    condition = {"init.V": 50.0, "init.h": 1500.0}
    states = ("V", "alpha", "q", "theta")
    both = linearize(sim, condition, states=(*states, "X_left", "X_right"))
    quasi = linearize(sim, condition, states=states)
    A = both["A"]
    rate = 50.0 / (TAU1 * CBAR)
    assert float(A.sel(state="X_left", state_="X_left")) == pytest.approx(-rate, rel=1e-6)
    alpha = float(both["x"].sel(state="alpha"))
    slope = -0.5 * A1 / np.cosh(A1 * (alpha - STAR)) ** 2
    assert float(A.sel(state="X_left", state_="alpha")) == pytest.approx(rate * slope, rel=1e-5)
    # eliminate X by X' = 0
    inner = A.values[4:, 4:]
    reduced = A.values[:4, :4] - A.values[:4, 4:] @ np.linalg.solve(inner, A.values[4:, :4])
    assert quasi["A"].values == pytest.approx(reduced, rel=1e-4, abs=1e-5)
    assert "X_left" in quasi.attrs["left_out"]


def test_buffet_is_an_output_and_no_force(stalling):
    buffet = make_term([2.0, 0.5, 0.0], {"X": [0.0, 0.8, 1.0]})
    calm = pull_up(stalling(ROLLING))
    shaken = pull_up(stalling(ROLLING, buffet_rms=buffet, buffet_frequency=make_term(60.0)))
    X = 0.5 * (shaken["stall.X_left"] + shaken["stall.X_right"]).values
    expected = np.interp(X, [0.0, 0.8, 1.0], [2.0, 0.5, 0.0])
    assert shaken["stall.buffet_rms"].values == pytest.approx(expected, abs=1e-12)
    assert (shaken["stall.buffet_frequency"].values == 60.0).all()
    assert expected.max() > 1.5
    for name in ("alpha", "p", "az"):
        assert (calm[name].values == shaken[name].values).all()


def test_wrong_tables_are_refused():
    with pytest.raises(SchemaError, match="a1: has the node 0; give positive numbers"):
        separation(a1=0.0)
    with pytest.raises(SchemaError, match="tau1: has the node -1; give positive"):
        separation(tau1=-1.0)
    with pytest.raises(SchemaError, match=r"tau2: has the node -0\.1; give zero or positive"):
        separation(tau2=-0.1)
    with pytest.raises(SchemaError, match="alpha_star: axis X; allowed: delta_f, gear"):
        separation(alpha_star=make_term([0.2, 0.3], {"X": [0.0, 1.0]}))
    with pytest.raises(SchemaError, match="tau2 is missing; give it"):
        FlowSeparation(2.0, {name: make_term(1.0) for name in ("a1", "alpha_star", "tau1")})
    with pytest.raises(SchemaError, match="station is -1 m"):
        FlowSeparation(-1.0, separation().tables)
    with pytest.raises(SchemaError, match="a2: unknown table; allowed: a1, alpha_star"):
        separation(a2=1.0)


def test_parameters_without_a_meaning_are_refused(stalling, start):
    sim = stalling()
    for name, value in (("a1", 0.0), ("a1", -1.0), ("tau1", -1.0), ("tau2", -1.0)):
        with pytest.raises(SimulationError, match=rf"term\.stall\.{name}"):
            start(sim, **{f"term__stall__{name}": value})
    with pytest.raises(SimulationError, match=r"stall\.station"):
        start(sim, stall__station=-1.0)


def test_terms_of_the_separation_need_the_section(make_aircraft, content, make_tree):
    with pytest.raises(SchemaError, match="unknown model variable of the simulation 'X_lift_diff'"):
        flightmech.compile(make_aircraft(), make_tree(content | ROLLING))
