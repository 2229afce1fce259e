"""Landing gear: loads, struts, energy, rest, touchdown, tail, retraction; equations once more in
NumPy.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flightmech
from flightmech import axes
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering
from flightmech.errors import SimulationError
from flightmech.simulation.kernel import STATE
from flightmech.terms import make_term

g = 9.80665
CG = np.array([0.0, 0.0, 0.2235])
MASS, INERTIA = 2150.0, np.diag([10826.0, 8135.0, 15162.0])
LEG = {
    "radius": 0.25,
    "stiffness": 90e3,
    "damping": 8e3,
    "damping_ext": 14e3,
    "orifice": 5e3,
    "orifice_ext": 9e3,
    "tyre_stiffness": 400e3,
    "side_stiffness": 150e3,
    "cornering_stiffness": 45e3,
    "cornering_load": 14e3,
    "rolling": 0.02,
}
NOSE = LEG | {
    "stiffness": 40e3,
    "damping": 5e3,
    "side_stiffness": 80e3,
    "cornering_stiffness": 15e3,
    "cornering_load": 5e3,
    "steering": 1.0,
}
SKID = {
    "side_stiffness": 200e3,
    "stiffness": 150e3,
    "damping": 3e3,
    "friction": 0.4,
    "retracts": False,
}
CONTACTS = (
    Contact("nose", (1.564, 0.0, 0.798), **NOSE),
    Contact("left", (-0.17, -0.805, 0.759), brake=8e3, **LEG),
    Contact("right", (-0.17, 0.805, 0.759), brake=8e3, **LEG),
    Contact("tail", (-4.0, 0.0, -0.1), **SKID),
)
STEERING = Steering(limit=0.7, stiffness=2000.0, trail=0.05, scrub=0.05)
STANDING = {"mode__earth": 0.0, "init__V": 0.0, "init__h": 0.415, "init__theta": 0.065, "gear": 1.0}


def craft(make_aircraft, gear: LandingGear | None, **changes) -> flightmech.Aircraft:
    I = INERTIA.diagonal()
    fields = {
        "mass": MASS,
        "Ixx": I[0],
        "Iyy": I[1],
        "Izz": I[2],
        "Ixy": 0.0,
        "Ixz": 0.0,
        "Iyz": 0.0,
        "cg": tuple(CG),
        "engines": (),
    }
    return make_aircraft(**(fields | {"gear": gear} | changes))


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    """A gear on an aircraft without air forces, or with the given terms."""

    def build(gear: LandingGear | None, terms=None, **changes) -> flightmech.SimModel:
        return flightmech.compile(
            craft(make_aircraft, gear, **changes), make_tree(terms or {"CD/basic": make_term(0.0)})
        )

    return build


@pytest.fixture(scope="module")
def stand(compiled) -> flightmech.SimModel:
    return compiled(LandingGear(CONTACTS, STEERING))


def inputs(sim: flightmech.SimModel, **values: float) -> np.ndarray:
    u = np.zeros(len(sim.inputs))
    for name, value in {"gear": 1.0, **values}.items():
        u[sim.inputs.index(name.replace("__", "."))] = value
    return u


def named(sim: flightmech.SimModel, run) -> dict[str, float]:
    return dict(zip(sim.outputs, map(float, run.outputs()), strict=True))


def states(sim: flightmech.SimModel) -> list[str]:
    return [row.name for row in sim.entries(STATE)]


def test_static_loads_are_those_of_the_levers(stand, start):
    """Moments about the contact points, their places from pitch, compression and the round tyre."""
    run, u = start(stand, **STANDING), inputs(stand)
    run.step(0.0, 60.0, u, u)
    y = named(stand, run)
    place = {}
    for contact in CONTACTS[:3]:
        axle = np.array(contact.position) - [0.0, 0.0, contact.radius] - CG
        axle[2] -= y[f"gear.{contact.name}.compression"] + y[f"gear.{contact.name}.tyre_deflection"]
        place[contact.name] = axle[0] * np.cos(y["theta"]) + axle[2] * np.sin(
            y["theta"]
        )  # the tyre stands below its axle
    nose = MASS * g * -place["left"] / (place["nose"] - place["left"])
    assert y["gear.nose.Fz"] == pytest.approx(
        nose, rel=2e-4
    )  # 0.1 N of rolling resistance against each other are left
    assert y["gear.left.Fz"] == pytest.approx(0.5 * (MASS * g - nose), rel=2e-4)
    assert y["gear.left.compression"] == pytest.approx(
        y["gear.left.Fz"] * np.cos(y["theta"]) / 90e3, rel=2e-3
    )
    assert y["gear.left.tyre_deflection"] == pytest.approx(
        y["gear.left.Fz"] * np.cos(y["theta"]) / 400e3, rel=2e-3
    )
    assert (y["wow_nose"], y["wow_left"], y["wow_right"], y["wow_tail"]) == (1.0, 1.0, 1.0, 0.0)
    assert -y["gear.Fz"] == pytest.approx(MASS * g * np.cos(y["theta"]), rel=1e-6)


def test_start_settles_the_struts(stand, start):
    run = start(stand, **STANDING)
    rates = run.derivative(run.state, inputs(stand))
    assert all(
        abs(rates[states(stand).index(f"state.gear.{name}.stroke")]) < 1e-9
        for name in ("nose", "left", "right")
    )


def test_table_over_compression_is_the_spring(compiled, start, stand):
    points = np.array([0.0, 0.1, 0.3])
    leaf = make_term(60e3 * points, {"compression": points}, outside="linear")
    legs = tuple(
        replace(c, stiffness=30e3, strut=leaf) if c.name in ("left", "right") else c
        for c in CONTACTS
    )
    table = compiled(LandingGear(legs, STEERING))
    assert "gear.left/strut" in table.terms
    a, b = start(table, **STANDING), start(stand, **STANDING)
    np.testing.assert_allclose(a.outputs(), b.outputs(), rtol=1e-9, atol=1e-9)
    for run, sim in ((a, table), (b, stand)):
        run.step(0.0, 0.5, inputs(sim), inputs(sim))
    # damping floor: (tyre + constant spring) times 10 ms is 600 N s/m lower with the table, both
    # far below the 8000 given
    np.testing.assert_allclose(a.state, b.state, rtol=1e-9, atol=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("tyre", [400e3, 0.0])
def test_drop_against_scipy(tyre, compiled, start):
    """One leg below the c.g., dropped at 2 m/s: strut, oleo in and out, stop, rebound, second
    touch.
    """
    leg = replace(
        CONTACTS[1],
        position=(0.0, 0.0, 0.759),
        tyre_stiffness=tyre,
        preload=2e3 if tyre else 0.0,
        stroke=0.22,
        stiffness=70e3,
    )
    sim = compiled(LandingGear((leg,)))
    height = 0.759 - CG[2]
    run = start(
        sim,
        mode__earth=0.0,
        init__V=2.0,
        init__alpha=np.pi / 2,
        init__h=height + 0.05,
        gear=1.0,
        mode__step=0.0005,
    )
    u, time = inputs(sim), np.arange(0.0, 1.5, 0.01)

    def force(h, w, s):
        """Leg force and rate of the strut."""
        gap = height - h
        strut = (leg.preload if tyre else 0.0) + leg.stiffness * (s if tyre else gap)
        if not tyre:
            c, o = (leg.damping, leg.orifice) if w >= 0.0 else (leg.damping_ext, leg.orifice_ext)
            return (max(strut + c * w + o * w * abs(w), 0.0) if gap > 0.0 else 0.0), -50.0 * s
        pushed = tyre * max(gap - s, 0.0)
        c, o = (leg.damping, leg.orifice) if pushed >= strut else (leg.damping_ext, leg.orifice_ext)
        roots = np.roots([o, c, -abs(pushed - strut)])
        rate = np.sign(pushed - strut) * roots[roots >= 0.0][0] if pushed != strut else 0.0
        return pushed, min(max(rate, -50.0 * s), 50.0 * max(leg.stroke - s, 0.0))

    def slope(t, x):
        F, rate = force(*x)
        return [-x[1], g - F / MASS, rate]

    truth = solve_ivp(
        slope,
        (0.0, time[-1]),
        [height + 0.05, 2.0, 0.0],
        t_eval=time,
        rtol=1e-9,
        atol=1e-11,
        max_step=1e-3,
    ).y
    found = [run.outputs()]
    for t in time[:-1]:
        run.step(t, 0.01, u, u)
        found.append(run.outputs())
    h = np.array(found)[:, sim.outputs.index("h")]
    # a fixed step passes over the touch: second order with a tyre, first with a rigid wheel, whose
    # damping begins at once
    np.testing.assert_allclose(h, truth[0], rtol=0.0, atol=1e-6 if tyre else 3e-4)
    F = np.array(found)[:, sim.outputs.index("gear.left.Fz")]
    assert F.min() >= 0.0
    assert (F[1:][h[1:] > height] == 0.0).all()


def counterpart(
    sim, gear: LandingGear, x: np.ndarray, u: dict[str, float]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Ground force, moment about the c.g. (body axes) and rates of the contacts, from
    docs/explanation/simulation/landing-gear.md.
    """
    lag, order = 0.02, states(sim)
    C = axes.matrix_from_quaternion(x[6:10])
    down, F, M, rates = C[:, 2], np.zeros(3), np.zeros(3), {}
    for leg in gear.contacts:
        name = f"state.gear.{leg.name}"
        s, z = (
            x[order.index(f"{name}.stroke")],
            np.array([x[order.index(f"{name}.tyre_{axis}")] for axis in "xy"]),
        )
        steer = leg.steering * np.clip(
            x[order.index("state.gear.steering")], -gear.steering.limit, gear.steering.limit
        )
        lean = max(down[2], 0.2)
        rim = np.array([down[0], 0.0, down[2]]) / np.hypot(down[0], down[2]) - [0.0, 0.0, 1.0]
        point = np.array(leg.position) + leg.radius * rim - CG
        deflection = (point @ down + x[2]) / lean
        arm = point - [0.0, 0.0, deflection]
        heading = np.array([np.cos(steer), np.sin(steer), 0.0])
        forward = heading - (heading @ down) * down
        level = np.linalg.norm(forward)
        forward = forward / level
        right = np.cross(down, forward)
        v = C @ x[3:6] + np.cross(x[10:13], arm)
        sink = v @ down / lean
        v = v - [0.0, 0.0, sink]
        v, turn = np.array([v @ forward, v @ right]), np.cross(x[10:13], heading) @ right / level
        if leg.tyre_stiffness:
            push = leg.tyre_stiffness * max(deflection - s, 0.0)
            excess = push - leg.preload - leg.stiffness * s
            c, o = (
                (leg.damping, leg.orifice) if excess >= 0.0 else (leg.damping_ext, leg.orifice_ext)
            )
            c = max(c, 0.01 * (leg.tyre_stiffness + leg.stiffness))
            rate = (
                np.sign(excess) * (np.sqrt(c * c + 4.0 * o * abs(excess)) - c) / (2.0 * o)
                if o
                else excess / c
            )
            rate = np.clip(rate, -s / lag, max(leg.stroke - s, 0.0) / lag)
        else:
            c, o = (leg.damping, leg.orifice) if sink >= 0.0 else (leg.damping_ext, leg.orifice_ext)
            push = (
                max(leg.stiffness * deflection + c * sink + o * abs(sink) * sink, 0.0)
                if deflection > 0.0
                else 0.0
            )
            rate = -s / lag
        push *= u["gear"] if leg.retracts else 1.0
        load = push / lean
        speed, seen = np.hypot(*v), v + turn * np.array([z[1], -z[0]])
        for _ in range(3):
            plane, slip = plane_forces(gear, leg, load, speed, z, seen, u, lag)
            load = (
                max((push + plane[0] * forward[2] + plane[1] * right[2]) / lean, 0.0)
                if push > 0.0
                else 0.0
            )
        force = plane[0] * forward + plane[1] * right - load * down
        F, M = F + force, M + np.cross(arm, force)
        rates[leg.name] = np.array([rate, *slip])
    return F, M, rates


def plane_forces(gear, leg, load, speed, z, v, u, lag):
    """Force in the ground plane and rate of the deflection of one tyre or skid."""
    if load <= 0.0:
        return np.zeros(2), -z / lag
    mu, B, cornering = leg.friction, np.inf, 0.0
    if not leg.friction:
        V = min(speed, 103.0)
        mu = (gear.mu_dry, max(np.polynomial.Polynomial(gear.mu_wet)(V), 0.0), gear.mu_icy)[
            gear.condition
        ]
        pedal = {
            -1.0: u["brake_left"],
            1.0: u["brake_right"],
            0.0: 0.5 * (u["brake_left"] + u["brake_right"]),
        }[np.sign(leg.position[1])]
        B = pedal * (leg.brake + leg.brake_friction * load)
        if gear.antiskid:
            B = min(B, gear.antiskid * mu * load)
        B += leg.rolling * load
        mu *= 1.0 - (1.0 - gear.skid_ratio) * np.clip((B / (mu * load) - 1.0) / 0.1, 0.0, 1.0)
        part = load / leg.cornering_load
        cornering = leg.cornering_stiffness * 2.0 * part / (1.0 + part**2)
    k = leg.side_stiffness
    if cornering:
        k = min(k, cornering / (lag * speed_of(v))) if speed_of(v) else k
    full = 3.0 * mu * load / k + 1e-9

    def brush(w):
        size = np.hypot(*w) / full
        return (
            mu * load * ((1.0 - (1.0 - size) ** 3) / size if size < 1.0 else 1.0 / size) / full * w
            if size
            else 0.0 * w
        )

    def chord(w):
        size = np.hypot(*w) / full
        return 3.0 - 3.0 * size + size**2 if size < 1.0 else 1.0 / size

    ahead = z + lag * v
    if abs(brush(ahead)[0]) > B:
        most = min(B * full / (mu * load * chord(z)), full)
        x = np.clip(ahead[0], -most, most)
        renewal = min(abs(v[0] - (x - z[0]) / lag) * k / cornering, 1.0 / lag)
        room = np.sqrt(max(full**2 - x**2, 0.0))
        rate = (np.array([x, np.clip(ahead[1] - lag * renewal * z[1], -room, room)]) - z) / lag
    else:
        rate = (
            (ahead * min(1.0, full / np.hypot(*ahead)) - z) / lag if np.hypot(*ahead) else 0.0 * z
        )
    return -brush(z + leg.loss * rate), rate


def speed_of(v):
    return float(np.hypot(*v))


@pytest.mark.nightly
@pytest.mark.parametrize(
    "changes", [{}, {"condition": 1, "antiskid": 0.8}, {"condition": 2}], ids=["dry", "wet", "icy"]
)
def test_whole_gear_against_its_counterpart(changes, compiled, start):
    contacts = [replace(leg, brake_friction=0.3) if leg.brake else leg for leg in CONTACTS]
    gear = LandingGear(tuple(contacts), STEERING, **changes)
    sim, rng = compiled(gear), np.random.default_rng(3)
    run, order = start(sim, **STANDING), states(sim)
    touched = 0
    for _ in range(300):
        x = run.state.copy()
        quiet = rng.choice([0.0, 0.01, 1.0])  # at rest, nearly, rolling or sliding
        tilt = rng.normal(0.0, [0.04, 0.05, 1.0])
        x[2], x[3:6] = -rng.uniform(0.3, 0.6), quiet * rng.normal(0.0, [25.0, 25.0, 1.0])
        x[6:10] = axes.quaternion_from_matrix(axes.matrix_from_euler(*tilt))
        x[10:13] = quiet * rng.normal(0.0, 0.2, 3)
        x[13:] = 0.0
        x[order.index("state.gear.steering")] = rng.normal(0.0, 0.3)
        for leg in CONTACTS:
            x[order.index(f"state.gear.{leg.name}.stroke")] = (
                rng.uniform(0.0, 0.15) if leg.tyre_stiffness else 0.0
            )
            (
                x[order.index(f"state.gear.{leg.name}.tyre_x")],
                x[order.index(f"state.gear.{leg.name}.tyre_y")],
            ) = rng.normal(0.0, 0.02, 2)
        given = {
            "gear": 1.0,
            "brake_left": rng.uniform(0.0, 1.0),
            "brake_right": rng.choice([0.0, 1.0]),
        }
        F, M, rates = counterpart(sim, gear, x, given)
        dx = run.derivative(x, inputs(sim, **given))
        w = x[10:13]
        np.testing.assert_allclose(
            dx[3:6] * MASS,
            axes.matrix_from_quaternion(x[6:10]).T @ F + [0.0, 0.0, MASS * g],
            rtol=1e-9,
            atol=1e-6,
        )
        np.testing.assert_allclose(
            INERTIA @ dx[10:13] + np.cross(w, INERTIA @ w), M, rtol=1e-9, atol=1e-6
        )
        for name, rate in rates.items():
            found = [
                dx[order.index(f"state.gear.{name}.{state}")]
                for state in ("stroke", "tyre_x", "tyre_y")
            ]
            np.testing.assert_allclose(found, rate, rtol=1e-9, atol=1e-9)
        touched += np.linalg.norm(F) > 0.0
    assert touched > 200


def mechanical_energy(sim, run) -> float:
    """Motion, weight, strut, tyre; the brush as the work of its force, 3 mu Fz / k being where all
    of it slides.
    """
    x, y, order = run.state, named(sim, run), states(sim)
    E = 0.5 * MASS * x[3:6] @ x[3:6] + 0.5 * x[10:13] @ INERTIA @ x[10:13] + MASS * g * y["h"]
    for leg in CONTACTS:
        s, tyre = y[f"gear.{leg.name}.compression"], y[f"gear.{leg.name}.tyre_deflection"]
        E += 0.5 * leg.stiffness * s**2 + 0.5 * leg.tyre_stiffness * tyre**2
        most = (leg.friction or 0.8) * y[f"gear.{leg.name}.Fz"]
        z = np.hypot(*(x[order.index(f"state.gear.{leg.name}.tyre_{axis}")] for axis in "xy"))
        full = 3.0 * most / leg.side_stiffness
        part = z / full if full else 0.0
        E += (
            most * full * (1.5 * part**2 - part**3 + 0.25 * part**4)
            if part < 1.0
            else most * (z - 0.25 * full)
        )
    return E


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_energy_only_falls(seed, stand, start):
    """Touchdown with drift, bank, roll rate and any brake, skid and stop."""
    rng = np.random.default_rng(seed)
    attitude = {"init__theta": rng.uniform(-0.05, 0.2), "init__phi": rng.uniform(-0.15, 0.15)}
    motion = {
        "init__V": rng.uniform(0.0, 50.0),
        "init__beta": rng.uniform(-0.5, 0.5),
        "init__p": rng.uniform(-0.3, 0.3),
    }
    brakes = {"brake_left": rng.uniform(0.0, 1.0), "brake_right": rng.uniform(0.0, 1.0)}
    run = start(stand, mode__earth=0.0, init__h=0.9, gear=1.0, **attitude, **motion, **brakes)
    u, E = inputs(stand, **brakes), [mechanical_energy(stand, run)]
    for i in range(500):
        run.step(0.02 * i, 0.02, u, u)
        E.append(mechanical_energy(stand, run))
    # a tyre that is stretched while its load grows stiffens: the one source, 2e-5 of the energy at
    # most in 24 such landings
    assert np.diff(E).clip(0.0).sum() < 1e-4 * E[0]
    assert E[-1] < 0.2 * E[0] + MASS * g * 0.5


WIND = {
    "CL/basic": make_term(0.3),
    "CD/basic": make_term(0.05),
    "CY/beta": make_term(-0.6, regressors=["beta"]),
    "Cn/beta": make_term(0.05, regressors=["beta"]),
    "Cl/beta": make_term(-0.05, regressors=["beta"]),
}
IDLE = {"mode__engine": 2.0, "engine1__thrust_drive": 240.0, "engine2__thrust_drive": 240.0}
ENGINES = (
    flightmech.aircraft.Engine((-0.3, -0.76, 0.0)),
    flightmech.aircraft.Engine((-0.3, 0.76, 0.0)),
)


@pytest.mark.nightly
@pytest.mark.parametrize("earth", [0.0, pytest.param(1.0, marks=pytest.mark.slow)])
def test_at_rest_for_an_hour_in_crosswind_with_engines_idling(earth, compiled, start):
    sim = compiled(LandingGear(CONTACTS, STEERING), WIND, engines=ENGINES)
    calm = {"init__V": 15.0, "init__beta": -np.pi / 2, "wind_e": 15.0}  # stands in the wind
    given = STANDING | IDLE | calm | {"mode__earth": earth, "brake_left": 1.0, "brake_right": 1.0}
    run = start(sim, **given)
    u = inputs(
        sim,
        **{
            k: v
            for k, v in given.items()
            if k in ("brake_left", "brake_right", "wind_e") or k.startswith("engine")
        },
    )
    run.step(0.0, 120.0, u, u)
    before = run.state
    run.step(120.0, 3600.0, u, u)
    assert (
        np.linalg.norm(run.state[:3] - before[:3]) < 1e-6
    )  # the elastic anchor is settled; the rounding of 6.4e6 m is 1e-9
    assert np.linalg.norm(run.state[3:6]) < 1e-7
    assert named(sim, run)["gear.left.Fy"] != 0.0


@pytest.mark.nightly
def test_anchors_hold_in_turbulence(compiled, start):
    """Ten minutes of gusts of 8 m/s wind: the tyres give way by millimetres, the places they stand
    on do not move.
    """
    sim = compiled(
        LandingGear(tuple(replace(c, radius=0.0) for c in CONTACTS), STEERING),
        WIND,
        engines=ENGINES,
    )
    gusts = {
        "turbulence__mode": 1.0,
        "turbulence__W20": 8.0,
        "init__V": 8.0,
        "init__beta": -np.pi / 2,
        "wind_e": 8.0,
    }
    given = STANDING | IDLE | gusts | {"brake_left": 1.0, "brake_right": 1.0}
    run, order, track = start(sim, **given), states(sim), []
    u = inputs(
        sim,
        wind_e=8.0,
        brake_left=1.0,
        brake_right=1.0,
        engine1__thrust_drive=240.0,
        engine2__thrust_drive=240.0,
    )
    for i in range(600):
        run.step(float(i), 1.0, u, u)
        x = run.state
        C = axes.matrix_from_quaternion(x[6:10])
        point = np.array(CONTACTS[1].position) - CG
        point[2] -= (point @ C[:, 2] + x[2]) / C[2, 2]
        forward = C.T @ [1.0, 0.0, 0.0] * [1.0, 1.0, 0.0]
        forward /= np.linalg.norm(forward)
        z = [x[order.index(f"state.gear.left.tyre_{axis}")] for axis in "xy"]
        rim = (x[:3] + C.T @ point)[:2]
        track.append(
            [*rim, *(rim - z[0] * forward[:2] - z[1] * np.array([-forward[1], forward[0]]))]
        )
    moved = np.ptp(np.array(track)[60:], axis=0)
    assert moved[:2].max() > 1e-3
    assert moved[2:].max() < 1e-6  # RK4 of a path of metres


def test_landing_lift_and_nose_down(compiled, start):
    """Touchdown at 0.8 m/s on the mains, nose after; no bounce higher than the strut, all three
    wheels carry at the end.
    """
    db = {
        "CL/basic": make_term(0.25 + 4.8 * np.array([-0.2, 0.3]), {"alpha": [-0.2, 0.3]}),
        "Cm/basic": make_term(-0.05),
        "Cm/q": make_term(-13.0, regressors=["qhat"]),
    }
    sim = compiled(LandingGear(CONTACTS, STEERING), db | {"CD/basic": make_term(0.08)})
    run, u = (
        start(
            sim,
            mode__earth=0.0,
            init__V=46.0,
            init__alpha=0.103,
            init__theta=0.086,
            init__h=0.85,
            gear=1.0,
        ),
        inputs(sim),
    )
    rows = []
    for i in range(600):
        run.step(0.02 * i, 0.02, u, u)
        rows.append(run.outputs())
    y = dict(zip(sim.outputs, np.array(rows).T, strict=True))
    mains, nose = np.argmax(y["wow_left"]), np.argmax(y["wow_nose"])
    assert 0 < mains < nose
    assert (y["wow_left"] == y["wow_right"]).all()
    assert y["gear.left.Fz"].max() < 3.0 * 0.5 * MASS * g
    assert (y["wow_nose"][-50:] == 1.0).all()
    assert (y["wow_left"][-50:] == 1.0).all()
    assert abs(y["hdot"][-50:]).max() < 0.02
    assert (np.diff(y["V"][nose:]) < 0.0).all()


def test_tail_scraper_ends_the_rotation(compiled, start):
    """Minimum unstick: pulled up too early the tail touches, carries, drags, and leaves the ground
    with the aircraft.
    """
    db = {
        "CL/basic": make_term([-0.6, 0.25, 1.7], {"alpha": [-0.17, 0.0, 0.3]}),
        "CD/basic": make_term(0.05),
        "Cm/pull": make_term(0.55),
        "Cm/q": make_term(-15.0, regressors=["qhat"]),
    }
    sim = compiled(LandingGear(CONTACTS, STEERING), db, engines=ENGINES)
    thrust = {"engine1__thrust_drive": 4500.0, "engine2__thrust_drive": 4500.0}
    run = start(
        sim,
        **(
            STANDING
            | {"init__V": 25.0, "init__alpha": 0.05, "init__theta": 0.05, "mode__engine": 2.0}
            | thrust
        ),
    )
    u, rows = inputs(sim, **thrust), []
    for i in range(1000):
        run.step(0.02 * i, 0.02, u, u)
        rows.append(run.outputs())
        if rows[-1][sim.outputs.index("h_agl")] > 3.0:
            break
    y = dict(zip(sim.outputs, np.array(rows).T, strict=True))
    scraping = y["wow_tail"] == 1.0
    touch = np.arctan2(
        -0.1 - 0.759, -0.17 + 4.0
    )  # pitch at which tail and mains stand on one line, legs out
    assert scraping.sum() > 20
    assert y["gear.tail.Fz"].max() > 500.0
    assert (
        y["theta"][scraping & (y["wow_left"] == 1.0)].max() < -touch + 0.06
    )  # legs and skid give way
    sliding = scraping & (y["gear.tail.Fz"] > 100.0)
    np.testing.assert_allclose(
        y["gear.tail.Fx"][sliding][5:], -0.4 * y["gear.tail.Fz"][sliding][5:], rtol=0.05
    )
    assert y["h_agl"][-1] > 3.0
    assert y["wow_tail"][-1] == 0.0


def test_retracted_legs_carry_nothing_and_the_belly_does(compiled, start):
    belly = tuple(
        Contact(name, (x, 0.0, 0.6), **SKID) for name, x in (("bow", 1.2), ("belly", -1.0))
    )
    wings = tuple(
        Contact(name, (-0.2, y, 0.4), **SKID)
        for name, y in (("tip_left", -2.0), ("tip_right", 2.0))
    )
    sim = compiled(LandingGear((*CONTACTS, *belly, *wings), STEERING))
    run, u = (
        start(sim, **(STANDING | {"init__V": 20.0, "gear": 0.0, "init__theta": 0.0})),
        inputs(sim, gear=0.0),
    )
    run.step(0.0, 30.0, u, u)
    y = named(sim, run)
    assert y["gear.left.Fz"] == y["gear.nose.Fz"] == y["wow_left"] == 0.0
    assert y["gear.bow.Fz"] + y["gear.belly.Fz"] == pytest.approx(MASS * g, rel=1e-3)
    assert y["V"] < 1e-3  # 20 m/s against 0.4 g: 5 s


def test_in_the_air_the_gear_is_not_there(stand, compiled, start):
    bare, high = compiled(None), STANDING | {"init__h": 500.0, "init__V": 60.0, "init__q": 0.1}
    a = start(stand, **high)
    b = start(bare, **high)
    a.step(0.0, 2.0, inputs(stand, brake_left=1.0), inputs(stand, brake_left=1.0))
    b.step(0.0, 2.0, inputs(bare), inputs(bare))
    np.testing.assert_array_equal(a.state[:13], b.state)


def test_the_runway_may_lie_anywhere(stand, start):
    """The same rest at 120 m over WGS-84 as at sea level over the plane; gravity differs by 0.01
    m/s2 at 45 degrees.
    """
    found = []
    for place in (
        {},
        {
            "mode__earth": 1.0,
            "init__lat": np.pi / 4,
            "init__lon": 1.0,
            "init__h": 120.415,
            "env__runway_elevation": 120.0,
            "init__psi": 1.0,
        },
    ):
        run, u = start(stand, **(STANDING | place)), inputs(stand)
        run.step(0.0, 60.0, u, u)
        y = named(stand, run)
        found.append([y["theta"], y["gear.nose.Fz"], y["gear.left.compression"], y["h_agl"]])
    np.testing.assert_allclose(found[0], found[1], rtol=2e-3)


@pytest.mark.nightly
@pytest.mark.parametrize(("thrust", "theta"), [(238.0, 3.27), (4430.0, 0.22)], ids=["idle", "full"])
def test_t37_stands_on_its_brakes_as_recorded(thrust, theta, compiled, start):
    """Runs 17 and 25 before the roll, 2150 kg: pitch attitude in degrees against the brakes at idle
    and at full power.
    """
    gear = flightmech.read_aircraft(
        Path(__file__).parents[2] / "data" / "t37" / "aircraft.toml"
    ).gear
    assert gear is not None
    sim = compiled(
        gear,
        engines=tuple(
            replace(engine, position=(0.0, engine.position[1], 0.0)) for engine in ENGINES
        ),
    )
    drive = {"engine1__thrust_drive": thrust, "engine2__thrust_drive": thrust}
    run = start(
        sim, **(STANDING | drive | {"mode__engine": 2.0, "brake_left": 1.0, "brake_right": 1.0})
    )
    u = inputs(sim, brake_left=1.0, brake_right=1.0, **drive)
    run.step(0.0, 40.0, u, u)
    y = named(sim, run)
    assert np.degrees(y["theta"]) == pytest.approx(
        theta, abs=0.1
    )  # bias of the recorded attitude: 0.07 deg
    assert abs(y["u"]) < 1e-6


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("gear__left__stroke", 0.0, "gear.left.stroke is 0; it must be positive"),
        ("gear__tail__damping", -1.0, "gear.tail.damping is -1; it must be zero or positive"),
        (
            "gear__tail__preload",
            5.0,
            "gear.tail.preload is 5; it must be zero without a tyre_stiffness",
        ),
        (
            "gear__nose__cornering_stiffness",
            0.0,
            "must be positive for a wheel; a skid has a friction",
        ),
        ("gear__nose__loss", 0.1, "gear.nose.loss is 0.1; it must be at most 0.04 s"),
        ("gear__nose__retracts", 0.5, "0 .fixed. or 1 .retracts."),
        ("runway__condition", 3.0, "runway.condition is 3; it must be 0 .dry., 1 .wet. or 2 .icy."),
        ("gear__antiskid", 1.5, "between 0 .none. and 1"),
        ("steering__order", 3.0, "0 .quasi-static., 2 or 4"),
        ("steering__order", 2.0, "steering.inertia is 0; it must be positive"),
    ],
)
def test_senseless_parameters_are_refused(name, value, text, stand, start):
    with pytest.raises(SimulationError, match=text):
        start(stand, **(STANDING | {name: value}))
