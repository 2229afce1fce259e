"""Tyres, brakes and steering: side force, friction circle, stopping, skidding, turning, the nose
wheel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import flightmech
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering, wet_friction
from flightmech.simulation.kernel import STATE
from flightmech.terms import make_term

g, MASS, KNOT = 9.80665, 2150.0, 1852.0 / 3600.0
LEG = {
    "stiffness": 90e3,
    "damping": 8e3,
    "tyre_stiffness": 400e3,
    "side_stiffness": 150e3,
    "cornering_stiffness": 45e3,
}
MAIN = LEG | {"cornering_load": 14e3, "rolling": 0.02, "brake": 12e3}
NOSE = LEG | {
    "stiffness": 40e3,
    "cornering_stiffness": 15e3,
    "cornering_load": 5e3,
    "rolling": 0.02,
    "steering": 1.0,
}
STEERING = Steering(limit=0.7, stiffness=5000.0, trail=0.05, scrub=0.05)
STANDING = {"mode__earth": 0.0, "init__V": 0.0, "init__h": 0.415, "init__theta": 0.0, "gear": 1.0}


def gear(nose: float = 1.564, mains: float = -0.17, **changes) -> LandingGear:
    contacts = (
        Contact("nose", (nose, 0.0, 0.759), **NOSE),
        Contact("left", (mains, -0.805, 0.759), **MAIN),
        Contact("right", (mains, 0.805, 0.759), **MAIN),
    )
    return LandingGear(**({"contacts": contacts, "steering": STEERING} | changes))


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    def build(landing_gear: LandingGear, **changes) -> flightmech.SimModel:
        body = {
            "mass": MASS,
            "Ixx": 10826.0,
            "Iyy": 8135.0,
            "Izz": 15162.0,
            "Ixy": 0.0,
            "Ixz": 0.0,
            "Iyz": 0.0,
            "cg": (0.0, 0.0, 0.2235),
        }
        engines = (flightmech.aircraft.Engine((0.0, 0.0, 0.2235)),)
        craft = make_aircraft(**(body | {"engines": engines, "gear": landing_gear} | changes))
        return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))

    return build


@pytest.fixture(scope="module")
def car(compiled) -> flightmech.SimModel:
    return compiled(gear())


def drive(sim, run, seconds: float, time: float = 0.0, **values: float) -> dict[str, np.ndarray]:
    """Outputs every 20 ms under constant inputs."""
    u = np.zeros(len(sim.inputs))
    for name, value in {"gear": 1.0, **values}.items():
        u[sim.inputs.index(name.replace("__", "."))] = value
    rows = []
    for i in range(round(seconds / 0.02)):
        run.step(time + 0.02 * i, 0.02, u, u)
        rows.append(run.outputs())
    return dict(zip(sim.outputs, np.array(rows).T, strict=True)) | {
        "time": time + 0.02 * np.arange(1, len(rows) + 1)
    }


def settled(sim, run, speed: float, slip: float, **values: float) -> dict[str, float]:
    """Outputs with the aircraft held at a speed and slip angle over the ground and the tyres
    settled.
    """
    u = np.zeros(len(sim.inputs))
    for name, value in {"gear": 1.0, **values}.items():
        u[sim.inputs.index(name)] = value
    run.set_inputs(u)
    order = [row.name for row in sim.entries(STATE)]
    tyres = [i for i, name in enumerate(order) if name.endswith(("tyre_x", "tyre_y"))]
    x = run.state
    x[3:6], x[10:13] = [speed * np.cos(slip), speed * np.sin(slip), 0.0], 0.0
    for _ in range(2000):
        x[tyres] += 0.002 * run.derivative(x, u)[tyres]
    run.state = x
    return dict(zip(sim.outputs, map(float, run.outputs()), strict=True))


def brush(slip: float, load: float, mu: float = 0.8) -> float:
    """Side force of a brush of parabolic pressure (Pacejka 2012, eq. 3.11)."""
    C = 45e3 * 2.0 * (load / 14e3) / (1.0 + (load / 14e3) ** 2)
    u = min(C * abs(np.tan(slip)) / (3.0 * mu * load), 1.0)
    return -np.sign(slip) * mu * load * (1.0 - (1.0 - u) ** 3)


@pytest.mark.nightly
@pytest.mark.parametrize("speed", [2.0, 60.0])
@pytest.mark.parametrize("slip", [0.002, -0.03, 0.1, 0.35])
def test_side_force_by_slip_angle(speed, slip, car, start):
    y = settled(car, start(car, **STANDING), speed, slip)
    assert y["gear.left.slip_angle"] == pytest.approx(slip, abs=1e-12)
    # rolling resistance takes its share of the friction: 0.02 / 0.8 of it, less than 1 % of the
    # side force
    assert y["gear.left.Fy"] == pytest.approx(brush(slip, y["gear.left.Fz"]), rel=0.012)


@pytest.mark.slow
def test_side_force_depends_on_load(car, start):
    """Slope C = 2 C_max (F / F_0) / (1 + (F / F_0)^2): greatest at F_0, the same at F_0 / 2 and 2
    F_0.
    """
    slope = []
    for load in (7e3, 14e3, 28e3):
        run = start(car, **(STANDING | {"init__h": 0.5355 - load / 90e3 - load / 400e3}))
        y = settled(car, run, 20.0, 1e-3)
        assert y["gear.left.Fz"] == pytest.approx(load, rel=1e-9)
        slope.append(-y["gear.left.Fy"] / np.tan(1e-3))
    assert slope == pytest.approx([36e3, 45e3, 36e3], rel=0.012)


def test_relaxation_length_is_cornering_over_side_stiffness(car, start):
    """A wheel set at a slip angle builds the force up over the distance C / k, at 2 m/s."""
    run = start(car, **STANDING)
    order = [row.name for row in car.entries(STATE)]
    u = np.zeros(len(car.inputs))
    u[car.inputs.index("gear")] = 1.0
    x, built = run.state, []
    along, side = order.index("state.gear.left.tyre_x"), order.index("state.gear.left.tyre_y")
    x[3:6] = [2.0, 0.01, 0.0]
    for i in range(3000):
        rate = run.derivative(x, u)
        x[along] += 0.001 * rate[along]
        if i >= 1000:  # rolling by then
            built.append(x[side])
            x[side] += 0.001 * rate[side]
    load = start(car, **STANDING).outputs()[car.outputs.index("gear.left.Fz")]
    C = 45e3 * 2.0 * (load / 14e3) / (1.0 + (load / 14e3) ** 2)
    reached = np.interp(C / 150e3 / 2.0, 0.001 * np.arange(2000), built) / built[-1]
    assert reached == pytest.approx(1.0 - np.exp(-1.0), abs=0.005)


def test_brake_force_that_follows_the_load(compiled, start):
    """brake = 0: deceleration by friction alone, whatever the mass (here the weight), at part of
    the pedal.
    """
    legs = tuple(
        replace(c, brake=0.0, brake_friction=0.6) if c.brake else c for c in gear().contacts
    )
    run = start(sim := compiled(gear(contacts=legs)), **(STANDING | {"init__V": 30.0}))
    y = drive(sim, run, 2.0, brake_left=0.5, brake_right=0.5)
    mains, nose = y["gear.left.Fz"] + y["gear.right.Fz"], y["gear.nose.Fz"]
    slowing = -np.gradient(y["V"], y["time"])[40:-40]
    np.testing.assert_allclose(
        slowing, (0.32 * mains + 0.02 * nose)[40:-40] / MASS, rtol=0.01
    )  # pitching moves the c.g. to and fro


@pytest.mark.nightly
@pytest.mark.parametrize("slip", [0.0, 0.03, 0.1, 0.3])
@pytest.mark.parametrize("pedal", [0.2, 0.45, 1.0])
def test_friction_circle(pedal, slip, car, start):
    y = settled(car, start(car, **STANDING), 30.0, slip, brake_left=pedal, brake_right=pedal)
    Fx, Fy, Fz = (y[f"gear.left.F{axis}"] for axis in "xyz")
    assert np.hypot(Fx, Fy) <= 0.8 * Fz * (1.0 + 1e-9)
    if (
        pedal == 1.0
    ):  # 12 kN are more than the tyre holds: locked, all its friction against the motion
        assert np.hypot(Fx, Fy) == pytest.approx(0.7 * 0.8 * Fz, rel=1e-9)
        assert np.arctan2(-Fy, -Fx) == pytest.approx(slip, abs=1e-6)
    else:
        assert Fx == pytest.approx(-(pedal * 12e3 + 0.02 * Fz), rel=1e-6)
        assert abs(Fy) <= abs(brush(slip, Fz))


@pytest.mark.parametrize(
    ("changes", "pedal", "mu"),
    [
        ({}, 0.3, None),
        ({"skid_ratio": 1.0}, 1.0, 0.8),
        ({}, 1.0, 0.56),
        ({"antiskid": 0.5}, 1.0, 0.42),
    ],
)
def test_braking(changes, pedal, mu, compiled, start):
    """Deceleration of a straight stop: brake force and rolling resistance, all friction, that of
    locked wheels, anti-skid.
    """
    sim = compiled(gear(**changes))
    run = start(sim, **(STANDING | {"init__V": 30.0}))
    y = drive(sim, run, 2.0, brake_left=pedal, brake_right=pedal)
    mains, nose = y["gear.left.Fz"] + y["gear.right.Fz"], y["gear.nose.Fz"]
    friction = 2.0 * pedal * 12e3 + 0.02 * mains if mu is None else mu * mains
    slowing = -np.gradient(y["V"], y["time"])[40:-40]
    np.testing.assert_allclose(
        slowing, (friction + 0.02 * nose)[40:-40] / MASS, rtol=0.01
    )  # pitching moves the c.g. to and fro
    assert np.ptp(y["psi"]) < 1e-9


def test_stop_and_stay(car, start):
    y = drive(
        car, start(car, **(STANDING | {"init__V": 8.0})), 20.0, brake_left=0.4, brake_right=0.4
    )
    assert abs(y["u"][-1]) < 1e-6
    assert np.ptp(y["gear.left.Fx"][-100:]) < 1.0


@pytest.mark.parametrize(("thrust", "stays"), [(300.0, True), (4000.0, True), (14000.0, False)])
def test_brakes_against_thrust(thrust, stays, car, start):
    """Held up to the friction of the braked wheels; beyond it the aircraft slides with the
    remainder.
    """
    run = start(car, **STANDING, mode__engine=2.0)
    y = drive(car, run, 10.0, brake_left=1.0, brake_right=1.0, engine1__thrust_drive=thrust)
    held = 0.56 * (y["gear.left.Fz"] + y["gear.right.Fz"]) + 0.02 * y["gear.nose.Fz"]
    if stays:
        assert thrust < held.min()
        assert abs(y["u"][-1]) < 1e-3  # the last of the pitching from the start
    else:
        assert np.gradient(y["u"], y["time"])[-100:] == pytest.approx(
            (thrust - held)[-100:] / MASS, rel=0.02
        )


def test_free_wheels_roll_and_rolling_resistance_holds(car, start):
    for thrust, speed in ((300.0, 0.0), (1000.0, (1000.0 - 0.02 * MASS * g) / MASS * 10.0)):
        y = drive(car, start(car, **STANDING, mode__engine=2.0), 10.0, engine1__thrust_drive=thrust)
        assert y["u"][-1] == pytest.approx(speed, rel=0.01, abs=1e-3)


def test_wet_runway_is_that_of_the_regulation():
    """14 CFR 25.109(c)(1): at 100 kt by hand from the printed cubics."""
    for psi, value in ((50.0, 0.303), (100.0, 0.2753), (200.0, 0.2529), (300.0, 0.2259)):
        assert np.polynomial.Polynomial(wet_friction(psi * 6894.757293168))(
            100.0 * KNOT
        ) == pytest.approx(value, abs=1e-9)
    assert wet_friction(75.0 * 6894.757293168)[0] == pytest.approx(0.5 * (0.883 + 0.804), rel=1e-9)


@pytest.mark.nightly
def test_runway_conditions(car, start):
    friction = {}
    for condition in (0.0, 1.0, 2.0):
        for knots in (20.0, 100.0):
            run = start(car, **STANDING, runway__condition=condition, runway__skid_ratio=1.0)
            y = settled(car, run, knots * KNOT, 0.0, brake_left=1.0, brake_right=1.0)
            friction[condition, knots] = -y["gear.left.Fx"] / y["gear.left.Fz"]
    wet = np.polynomial.Polynomial([0.804, -0.805, 0.320, -0.0437])
    expected = {
        (0.0, 20.0): 0.8,
        (0.0, 100.0): 0.8,
        (1.0, 20.0): wet(0.2),
        (1.0, 100.0): wet(1.0),
        (2.0, 20.0): 0.05,
        (2.0, 100.0): 0.05,
    }
    assert friction == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("delta", [0.1, -0.3, 0.5])
def test_slow_turn_has_the_radius_of_the_wheelbase(delta, compiled, start):
    sim = compiled(gear(contacts=tuple(replace(c, rolling=0.0) for c in gear().contacts)))
    y = drive(sim, start(sim, **(STANDING | {"init__V": 1.0})), 10.0, delta_nw=delta)
    rate, speed = np.gradient(y["psi"], y["time"])[-50], np.hypot(y["vn"], y["ve"])[-50]
    wheelbase = 1.734
    radius = wheelbase / np.tan(
        y["gear.steering"][-50]
    )  # of the middle of the main wheels; the c.g. is 0.17 m ahead
    assert speed / rate == pytest.approx(np.sign(delta) * np.hypot(radius, 0.17), rel=0.02)


@pytest.mark.parametrize(("nose", "mains", "stable"), [(1.564, -0.17, True), (-1.3, 0.5, False)])
def test_ground_loop(nose, mains, stable, compiled, start):
    """With the mains behind the c.g. a yaw dies out; ahead of it (a free tail wheel) it grows."""
    contacts = tuple(
        replace(c, steering=0.0) if c.name != "nose" else replace(c, cornering_stiffness=1.0)
        for c in gear(nose, mains).contacts
    )
    sim = compiled(gear(contacts=contacts))
    y = drive(sim, start(sim, **(STANDING | {"init__V": 30.0, "init__beta": 0.01})), 4.0)
    crab = np.arctan2(y["v"], y["u"])
    assert (abs(crab[-1]) < 0.002) if stable else (abs(crab[-1]) > 0.1)


ORDERS = {
    0: Steering(limit=0.7, stiffness=2000.0, trail=0.05, scrub=0.05),
    2: Steering(2, limit=0.7, stiffness=2000.0, trail=0.05, scrub=0.05, damping=30.0, inertia=0.5),
    4: Steering(
        4,
        limit=0.7,
        stiffness=2000.0,
        trail=0.05,
        scrub=0.05,
        damping=30.0,
        inertia=0.5,
        arm_stiffness=9000.0,
        arm_damping=20.0,
        arm_inertia=2.0,
    ),
}


@pytest.mark.parametrize("order", ORDERS)
def test_steering_gives_way_to_the_side_force(order, compiled, start):
    """Rolling in a turn: spring moment = trail times side force, for every order."""
    sim = compiled(gear(steering=ORDERS[order]))
    y = drive(sim, start(sim, **(STANDING | {"init__V": 15.0})), 3.0, delta_nw=0.1)
    assert abs(y["gear.nose.Fy"][-1]) > 200.0
    assert y["gear.steering_moment"][-1] == pytest.approx(0.05 * y["gear.nose.Fy"][-1], rel=0.03)
    springs = 1.0 / 2000.0 + (1.0 / 9000.0 if order == 4 else 0.0)
    assert 0.1 - y["gear.steering"][-1] == pytest.approx(
        0.05 * y["gear.nose.Fy"][-1] * springs, rel=0.03
    )


@pytest.mark.nightly
@pytest.mark.parametrize("order", ORDERS)
def test_standing_wheel_is_held_by_the_ground(order, compiled, start):
    """Turned at rest the wheel lags by scrub moment over stiffness and keeps that when the pull
    ends; rolling frees it.
    """
    sim = compiled(gear(steering=ORDERS[order]))
    run, hold = start(sim, **STANDING), {"brake_left": 1.0, "brake_right": 1.0}
    drive(sim, run, 40.0, **hold)
    for i in range(60):  # slowly: a jump would overshoot and be held nearer to the command
        there = drive(sim, run, 0.2, 40.0 + 0.2 * i, **hold, delta_nw=0.005 * (i + 1))
    lag = 0.8 * there["gear.nose.Fz"][-1] * 0.05 / 2000.0 + (
        0.8 * there["gear.nose.Fz"][-1] * 0.05 / 9000.0 if order == 4 else 0.0
    )
    assert 0.3 - there["gear.steering"][-1] == pytest.approx(lag, rel=0.02)
    small = drive(sim, run, 5.0, 52.0, **hold, delta_nw=0.3 - 0.5 * lag)
    # the twist of the tyre carries the small change with orders 2 and 4, nothing moves with order 0
    assert abs(np.ptp(small["gear.steering"])) < (1e-9 if order == 0 else 0.05)
    assert small["gear.steering"][-1] == pytest.approx(small["gear.steering"][-2], abs=1e-6)


def test_airborne_wheel_follows_the_command_and_stops_at_the_limit(compiled, start):
    for order, steering in ORDERS.items():
        sim = compiled(gear(steering=steering))
        y = drive(sim, start(sim, **(STANDING | {"init__h": 300.0})), 3.0, delta_nw=1.5)
        assert y["gear.steering"].max() <= 0.7
        assert y["gear.steering"][-1] == pytest.approx(0.7, abs=1e-3), order


def test_natural_frequency_of_the_second_order(compiled, start):
    sim = compiled(gear(steering=replace(ORDERS[2], damping=0.0)))
    run = start(sim, **(STANDING | {"init__h": 300.0}))
    order = [row.name for row in sim.entries(STATE)]
    x = run.state
    x[order.index("state.gear.steering")] = 0.1
    run.state = x
    y = drive(sim, run, 1.0)
    assert y["gear.steering"] == pytest.approx(
        0.1 * np.cos(np.sqrt(2000.0 / 0.5) * y["time"]), abs=0.02
    )  # RK4, 63 rad/s at 10 ms


def test_castor_follows_a_turn_by_the_brakes(compiled, start):
    sim = compiled(gear(steering=Steering(limit=1.2, trail=0.1)))
    y = drive(sim, start(sim, **(STANDING | {"init__V": 5.0})), 2.0, brake_right=0.15)
    assert y["psi"][-1] > 0.15
    assert np.tan(y["gear.steering"][-1]) == pytest.approx(
        (y["v"][-1] + 1.564 * y["r"][-1]) / y["u"][-1], rel=0.1
    )
    assert (
        abs(y["gear.nose.Fy"][-1]) < 0.08 * y["gear.nose.Fz"][-1]
    )  # lags the growing turn by trail over speed


def test_rudder_pedals_steer(compiled, start):
    sim = compiled(gear(steering=replace(STEERING, rudder=0.5)))
    y = drive(sim, start(sim, **(STANDING | {"init__V": 5.0})), 2.0, delta_r=-0.2)
    assert y["gear.steering"][-1] == pytest.approx(0.1, abs=0.01)
    assert y["psi"][-1] > 0.1
