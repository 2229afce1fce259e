"""Thrust and torque of a propeller from its speed, against those of the simulation."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.aircraft import Engine, PistonEngine, Propeller
from flightmech.errors import AeromatchWarning, IdentificationError
from flightmech.terms import make_term
from flighttest.reconstruction.dynamics.loads import (
    engine_loads,
    with_propeller_thrust_coefficient,
)
from flighttest.reconstruction.dynamics.propeller_loads import (
    propeller_channels,
    with_engine_channels,
)
from flighttest.reconstruction.dynamics.reduced_rates import read_columns
from flighttest.reconstruction.dynamics.shaft_condition import shaft_condition

J = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
ANGLES = np.array([0.2, 0.7])
CT = make_term(0.06 + 0.2 * ANGLES - 0.12 * J[:, None], {"J": J, "blade_angle": ANGLES})
CP = make_term(0.01 + 0.2 * ANGLES - 0.05 * J[:, None], {"J": J, "blade_angle": ANGLES})
MAP = [2e4, 1.2e5]
CHART = 130e3 / 1e5 / 280.0 * np.outer(MAP, [0.0, 400.0])
POWER = make_term(CHART, {"manifold_pressure": MAP, "engine_rpm": [0.0, 400.0]})
TIME = np.arange(0.0, 8.01, 0.02)
LEVER = np.interp(TIME, [0.0, 1.0, 2.0, 4.0, 5.0, 8.0], [0.5, 0.5, 0.9, 0.9, 0.4, 0.4])
RECORDED = ("V", "alpha", "beta", "qbar", "mach", "h", "p_static", "temperature", "rho", "a_sound")


def trainer(**engine) -> flightmech.Aircraft:
    propeller = Propeller(
        {"CT_prop": CT, "CP_prop": CP},
        diameter=2.0,
        inertia=2.0,
        rpm_high=270.0,
        rpm_low=150.0,
        low_pitch=0.2,
        high_pitch=0.7,
        rotation=-1,
    )
    piston = PistonEngine(
        {"corrected_power": POWER, "friction_power": make_term(2e3)},
        intake_impedance=2e-4,
        throttle_impedance=0.02,
    )
    parts = {"propeller": propeller, "piston": piston} | engine
    return flightmech.Aircraft(
        name="trainer",
        S=16.0,
        cbar=1.5,
        b=11.0,
        mass=1100.0,
        Ixx=1300.0,
        Iyy=1800.0,
        Izz=2700.0,
        engines=(Engine((1.8, 0.0, -0.1), **parts),),
        limits={"delta_e": (-0.4, 0.4)},
    )


@pytest.fixture(scope="module")
def flown() -> xr.Dataset:
    """Level flight with the lever up and down; Cl is -0.4 beta alone."""
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/q": make_term(-12.0, regressors=["qhat"]),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rudder": make_term(-0.1, regressors=["delta_r"]),
        "Cl/beta": make_term(-0.4, regressors=["beta"]),
        "Cl/p": make_term(-0.5, regressors=["phat"]),
        "Cl/aileron": make_term(-0.1, regressors=["delta_a"]),
    }
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    tree.attrs["force_axes"] = "stability"
    sim = flightmech.compile(trainer(), tree)
    inputs = xr.Dataset({"engine1.throttle": ("time", LEVER)}, {"time": TIME})
    start = {"init.V": 50.0, "init.h": 1000.0, "mode.trim": 1.0, "mode.engine": 0.0}
    out = flightmech.simulate(sim, inputs, start)
    # the trim adds a thrust that no propeller makes
    own = out["engine1.thrust"] - out["trim.thrust"]
    return out.assign({"engine1.thrust": own})


def states_of(flown: xr.Dataset, *names: str) -> xr.Dataset:
    kept = [name for name in RECORDED if name in flown]
    return flown[[*kept, *names]]


def test_thrust_and_torque_of_speed_and_manifold_pressure(flown):
    states = states_of(flown, "engine1.rpm", "engine1.manifold_pressure")
    found = with_engine_channels(states, trainer())
    assert np.ptp(flown["engine1.thrust"].values) > 800.0
    np.testing.assert_allclose(found["engine1.thrust"], flown["engine1.thrust"], atol=20.0)
    np.testing.assert_allclose(found["engine1.torque"], flown["engine1.torque"], rtol=1e-6)
    np.testing.assert_allclose(found["engine1.J"], flown["engine1.J"], rtol=1e-4)


def test_recorded_torque_takes_the_place_of_the_chart(flown):
    states = states_of(flown, "engine1.rpm", "engine1.torque")
    found = with_engine_channels(states, trainer())
    np.testing.assert_allclose(found["engine1.thrust"], flown["engine1.thrust"], atol=20.0)
    recorded = states.assign({"engine1.thrust": ("time", np.full(TIME.size, 700.0))})
    assert with_engine_channels(recorded, trainer()) is not recorded
    assert set(with_engine_channels(recorded, trainer())["engine1.thrust"].values) == {700.0}


def test_a_path_holds_the_thrust_coefficient_of_the_propeller(flown):
    """A path has no aircraft file with it; tables that are read later give another thrust."""
    states = states_of(flown, "engine1.rpm", "engine1.manifold_pressure")
    path = with_propeller_thrust_coefficient(states, trainer())
    assert set(path) - set(states) == {"CT"}
    expected = flown["engine1.thrust"] / (flown["qbar"] * 16.0)
    np.testing.assert_allclose(path["CT"], expected, atol=20.0 / (0.5 * 45.0**2 * 16.0))
    # the aircraft of a later step counts, not that of the reconstruction
    assert "CT" not in with_engine_channels(path, trainer())
    thrust = states.assign({"engine1.thrust": flown["engine1.thrust"]})
    assert with_propeller_thrust_coefficient(thrust, trainer()) is thrust


def test_a_path_without_the_power_of_a_governed_propeller_has_no_thrust_coefficient(flown):
    states = states_of(flown, "engine1.rpm")
    assert with_propeller_thrust_coefficient(states, trainer()) is states


def test_coefficients_are_free_of_propeller_and_rotor(flown):
    """Cl returns the term of the database, though the torque of the engine rolls the aircraft."""
    names = ("p", "q", "r", "ax", "ay", "az")
    states = states_of(flown, *names, "engine1.rpm", "engine1.manifold_pressure")
    data = flighttest.coefficients(states, trainer())
    phat = flown["p"] * 11.0 / (2.0 * flown["V"])
    expected = -0.4 * flown["beta"] - 0.5 * phat - 0.1 * flown["applied.delta_a"]
    middle = slice(10, -10)
    np.testing.assert_allclose(data["Cl"].values[middle], expected.values[middle], atol=1e-4)
    # without the torque, an error of the size of the torque over qbar S b
    blind = replace(trainer(), engines=(Engine((1.8, 0.0, -0.1)),))
    thrust = {"engine1.thrust": data["engine1.thrust"]}
    wrong = flighttest.coefficients(states.assign(thrust), blind)
    assert np.abs(wrong["Cl"] - expected).values[middle].min() > 5e-4


def test_a_missing_power_is_named(flown):
    with pytest.raises(IdentificationError, match=r"neither torque nor .* map engine1\.torque"):
        with_engine_channels(states_of(flown, "engine1.rpm"), trainer())


@pytest.mark.parametrize("rotation", [1, -1])
def test_all_six_loads_are_those_of_the_kernel(rotation):
    """Rates, sideslip, toe and tilt of the line, gear, force in the disk, P-factor, rotor, torque.

    Without aerodynamic loads of the airframe, m a and I w' + w x I w are those of the propeller.
    """
    gear, line = 2.4, np.array([1.0, 0.06, -0.05])
    base = trainer()
    engine = base.engines[0]
    tables = {
        **engine.propeller.tables,
        "CN_prop": make_term([0.10, 0.25], {"J": [0.0, 4.0]}),
        "CM_prop": make_term([0.03, 0.08], {"J": [0.0, 4.0]}),
    }
    propeller = replace(engine.propeller, tables=tables, rotation=rotation, gear_ratio=gear)
    chart = make_term(CHART, {"manifold_pressure": MAP, "engine_rpm": [0.0, 1000.0]})
    piston = replace(engine.piston, tables={"corrected_power": chart})
    direction = tuple(line / np.linalg.norm(line))
    geared = Engine((1.8, 0.6, -0.1), direction=direction, propeller=propeller, piston=piston)
    craft = replace(base, engines=(geared,), cg=(0.1, 0.05, 0.2))
    tree = xr.DataTree.from_dict({"/CD/basic": make_term(0.0)})
    tree.attrs["force_axes"] = "stability"
    omega = np.array([0.3, 0.2, -0.4])
    start = dict(zip(("init.p", "init.q", "init.r"), omega))
    start |= {"init.V": 50.0, "init.h": 1000.0, "init.alpha": 0.12, "init.beta": 0.175}
    start |= {"mode.trim": 0.0, "mode.engine": 0.0, "mode.earth": 0.0}
    lever = xr.Dataset({"engine1.throttle": ("time", np.full(2, 0.7))}, {"time": [0.0, 0.001]})
    flown = flightmech.simulate(flightmech.compile(craft, tree), lever, start)
    # one instant, twice: the shaft is at rest relative to the balance of its torque
    flown = flown.isel(time=[0, 0]).assign_coords(time=[0.0, 1.0])
    states = states_of(flown, "p", "q", "r", "engine1.manifold_pressure")
    states = states.assign({"engine1.engine_rpm": gear * flown["engine1.rpm"]})
    columns = read_columns(with_engine_channels(states, craft))
    ((F, M),) = engine_loads(columns, craft)
    acceleration, rates = (
        np.array([float(flown[name][0]) for name in names])
        for names in (("ax", "ay", "az"), ("p_dot", "q_dot", "r_dot"))
    )
    inertia = np.diag([craft.Ixx, craft.Iyy, craft.Izz])
    np.testing.assert_allclose(F[0], craft.mass * acceleration, rtol=1e-9)
    np.testing.assert_allclose(M[0], inertia @ rates + np.cross(omega, inertia @ omega), rtol=1e-9)
    # each part is there: 1 % of the loads would not hide one of them
    assert np.abs(F[0]).min() > 50.0
    assert np.abs(M[0]).min() > 100.0


def test_noise_of_the_tachometer_makes_no_torque():
    """White noise of 0.3 rad/s at 25 samples per second, at constant power."""
    count = 400
    rng = np.random.default_rng(6)
    still = np.zeros(count)
    columns = {"V": 50.0, "alpha": 0.05, "h": 1000.0, "engine1.torque": 300.0}
    states = xr.Dataset(
        {name: ("time", x + still) for name, x in columns.items()}, {"time": np.arange(count) / 25}
    )
    noise = 0.3 * rng.standard_normal(count)
    found = with_engine_channels(states.assign({"engine1.rpm": ("time", 240 + noise)}), trainer())
    quiet = with_engine_channels(states.assign({"engine1.rpm": ("time", 240 + still)}), trainer())
    scatter = float((found["engine1.thrust"] - quiet["engine1.thrust"]).std())
    mean = float(quiet["engine1.thrust"].mean())
    assert mean == pytest.approx(1034.0, abs=300.0)
    # a difference of successive samples scatters by 4 %
    assert scatter < 0.01 * mean


def torque_of_shaft(time: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the torque that accelerates a shaft of 2 kg m2 with a propeller of fixed pitch."""
    columns = {"V": 50.0, "alpha": 0.05, "h": 1000.0}
    states = xr.Dataset({name: ("time", np.full(time.size, x)) for name, x in columns.items()})
    states = states.assign({"engine1.rpm": ("time", speed)}).assign_coords(time=time)
    tables = {name: leaf.isel(blade_angle=0) for name, leaf in (("CT_prop", CT), ("CP_prop", CP))}
    torques = []
    for inertia in (1.0, 3.0):
        propeller = Propeller(tables, diameter=2.0, inertia=inertia, rpm_high=270.0)
        craft = trainer(propeller=propeller)
        torques.append(with_engine_channels(states, craft)["engine1.torque"].values)
    return torques[1] - torques[0]


def test_rounded_times_do_not_make_a_torque_of_the_noise():
    """64 Hz, times rounded to 1 ms: steps of 15 and 16 ms."""
    exact = np.arange(640) / 64.0
    noise = 0.3 * np.random.default_rng(4).standard_normal(exact.size)
    speed = 240.0 + 10.0 * np.sin(2.0 * np.pi * 0.3 * exact)
    wanted = 2.0 * 10.0 * 2.0 * np.pi * 0.3 * np.cos(2.0 * np.pi * 0.3 * exact)
    middle = slice(20, -20)
    errors = []
    for time in (exact, np.round(exact, 3)):
        found = torque_of_shaft(time, speed + noise)
        errors.append(float(np.sqrt(np.mean((found - wanted)[middle] ** 2))))
    # differences of successive samples: 27 N m
    assert errors == pytest.approx([1.55, 1.44], abs=0.01)


def test_rounding_of_a_clock_of_ten_hertz_does_not_change_the_derivative():
    speed = 240.0 + 0.3 * np.random.default_rng(4).standard_normal(200)
    time = np.arange(200) / 10.0
    next_day = torque_of_shaft(86400.0 + time, speed)
    np.testing.assert_allclose(torque_of_shaft(time, speed), next_day, atol=1e-6)


def test_stretches_between_gaps_have_their_own_derivative():
    clock = np.arange(400) / 20.0

    def shaft(time):
        # the speed jumps by 50 rad/s in the gap, which no acceleration shows
        return 240.0 + time + np.where(time > 10.2, 50.0, 0.0)

    # gaps of 0.6 s, of 0.2 s without the jump, and one sample between two gaps
    time = np.delete(clock, slice(200, 211))
    np.testing.assert_allclose(torque_of_shaft(time, shaft(time)), 2.0, rtol=1e-6)
    short = np.delete(clock, slice(100, 103))
    np.testing.assert_allclose(torque_of_shaft(short, 240.0 + short), 2.0, rtol=1e-6)
    time = np.delete(clock, [*range(190, 201), *range(202, 213)])
    torque = torque_of_shaft(time, shaft(time))
    assert np.flatnonzero(np.isnan(torque)).tolist() == [190]
    np.testing.assert_allclose(np.delete(torque, 190), 2.0, rtol=1e-6)
    # samples without a speed, in the middle and at both ends
    speed = shaft(clock)
    missing = [0, 1, *range(200, 211), 399]
    speed[missing] = np.nan
    torque = torque_of_shaft(clock, speed)
    assert np.flatnonzero(np.isnan(torque)).tolist() == missing
    np.testing.assert_allclose(np.delete(torque, missing), 2.0, rtol=1e-6)
    with pytest.raises(IdentificationError, match=r"steps by 0 s, .* increasing clock first"):
        torque_of_shaft(np.sort([*clock, clock[50]]), np.full(401, 240.0))


def test_a_slow_clock_is_not_differentiated_across_a_gap():
    clock = np.arange(100) / 5.0
    time = np.delete(clock, slice(50, 60))
    # the speed jumps by 50 rad/s in the gap of 2.2 s
    speed = 240.0 + time + np.where(time > 10.0, 50.0, 0.0)
    np.testing.assert_allclose(torque_of_shaft(time, speed), 2.0, rtol=1e-6)


@pytest.mark.parametrize("power", ["engine1.torque", "engine1.manifold_pressure"])
def test_missing_samples_of_the_speed_leave_the_other_coefficients(flown, power):
    names = ("p", "q", "r", "ax", "ay", "az", "p_dot", "q_dot", "r_dot", "engine1.rpm", power)
    states = states_of(flown, *names)
    whole = flighttest.coefficients(states, trainer())
    gap = np.zeros(TIME.size, bool)
    gap[300:335] = True
    cut = flighttest.coefficients(states.isel(time=~gap), trainer())
    speed = states["engine1.rpm"].where(~xr.DataArray(gap, dims="time"))
    holed = flighttest.coefficients(states.assign({"engine1.rpm": speed}), trainer())
    for name in ("CL", "CD", "Cl", "Cm"):
        np.testing.assert_array_equal(np.isnan(holed[name]), gap)
        np.testing.assert_allclose(holed[name].values[~gap], cut[name].values, atol=1e-12)
        np.testing.assert_allclose(cut[name].values, whole[name].values[~gap], atol=3e-4)


def test_without_power_the_rotor_stays_and_the_torque_is_named():
    time = np.arange(5.0)
    columns = {"V": 50.0, "alpha": 0.1, "qbar": 1390.0, "h": 1000.0, "p": 0.0, "q": 0.0, "r": 0.3}
    columns |= {"engine1.rpm": 230.0, "engine1.thrust": 1100.0}
    states = xr.Dataset({name: ("time", x + 0.0 * time) for name, x in columns.items()})
    states = states.assign_coords(time=time)
    with pytest.warns(AeromatchWarning, match=r"rolling moment of the torque .* engine1\.torque"):
        found = with_engine_channels(states, trainer())
    ((_, M),) = engine_loads(read_columns(found), trainer())
    # -omega x (rotation I w d) along y, less the thrust times its arm
    assert M[0, 1] + 0.1 * 1100.0 == pytest.approx(-0.3 * -1 * 2.0 * 230.0)
    assert M[0, 0] == 0.0


@pytest.mark.parametrize("function", [shaft_condition, propeller_channels])
def test_the_center_of_gravity_is_given(function):
    assert inspect.signature(function).parameters["cg"].default is inspect.Parameter.empty
