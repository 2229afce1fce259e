"""Trim on the ground: the legs carry what statics requires, what stands stays, what cannot be held
is result.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.landing_gear import Contact, LandingGear
from flightmech.errors import SchemaError, SimulationError
from flightmech.steady_flight.trim_search import start_of

G0, MASS = 9.80665, 2300.0
NOSE, MAIN, TRACK, LOW = 2.2, -0.35, 1.9, 0.85
BRAKED = {"brake_left": 1.0, "brake_right": 1.0}
_WHEEL = {
    "side_stiffness": 150e3,
    "cornering_stiffness": 40e3,
    "cornering_load": 12e3,
    "rolling": 0.02,
}
STIFF = {"nose": 60e3, "left": 110e3, "right": 110e3}


def legs(radius: float = 0.0) -> LandingGear:
    main = {"stiffness": STIFF["left"], "damping": 8e3, "radius": radius, "brake": 8e3, **_WHEEL}
    return LandingGear(
        (
            Contact(
                "nose",
                (NOSE, 0.0, LOW),
                stiffness=STIFF["nose"],
                damping=4e3,
                radius=radius,
                steering=1.0,
                **_WHEEL,
            ),
            Contact("left", (MAIN, -TRACK, LOW), **main),
            Contact("right", (MAIN, TRACK, LOW), **main),
            Contact(
                "tail",
                (-4.0, 0.0, -0.1),
                side_stiffness=100e3,
                stiffness=200e3,
                damping=5e3,
                friction=0.5,
            ),
        )
    )


@pytest.fixture(scope="module")
def jet_on_wheels(make_aircraft, make_tree, content):
    """Compile the jet with wheels; without changes it is the one of all tests of the kernel."""
    return lambda **changes: flightmech.compile(
        make_aircraft(**({"gear": legs(0.25)} | changes)), make_tree(content)
    )


@pytest.fixture(scope="module")
def wheels(jet_on_wheels) -> flightmech.SimModel:
    return jet_on_wheels()


def test_loads_by_statics(jet_on_wheels):
    """No thrust, no wind, c.g. at the reference point, points for wheels: lever arms and Hooke's
    law, exact in the found attitude.

    A leg gives way along body z: its point on the ground is (x, z - d), and its force k d is the
    part of the load along it. Wheels can strain against each other along the ground without an
    outer force; the search leaves some 0.1 N of that, hence 1e-5.
    """
    engines = (flightmech.aircraft.Engine((0.0, 0.0, 0.0)),)
    sim = jet_on_wheels(gear=legs(), engines=engines, cg=(0.0, 0.0, 0.0))
    y = flightmech.trim(sim, {"mode.earth": 0.0, "env.runway_elevation": 120.0}, kind="ground")
    assert y.attrs["verdict"].startswith("trimmed")
    sin, cos, height = np.sin(float(y["theta"])), np.cos(float(y["theta"])), float(y["h"]) - 120.0
    load = {name: float(y[f"gear.{name}.Fz"]) for name in ("nose", "left", "right", "tail")}
    arms = {}
    for name, x in (("nose", NOSE), ("left", MAIN)):
        depth = LOW - (height + x * sin) / cos
        arms[name] = x * cos + (LOW - depth) * sin  # ahead of the c.g.
        assert STIFF[name] * depth == pytest.approx(load[name] * cos, rel=1e-5)
    nose = MASS * G0 * -arms["left"] / (arms["nose"] - arms["left"])
    assert load["nose"] == pytest.approx(nose, rel=1e-5)
    assert load["left"] == pytest.approx(0.5 * (MASS * G0 - nose), rel=1e-5)
    assert load["right"] == pytest.approx(load["left"], rel=1e-5)
    assert load["tail"] == 0.0
    assert float(y["phi"]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("earth", [0.0, 1.0, 3.0])
@pytest.mark.parametrize(
    "more",
    [{}, {"wind_n": -8.0, "wind_e": 5.0}, {"engine1.throttle": 0.3, "engine2.throttle": 0.25}],
)
def test_what_stands_stays(earth, more, wheels):
    """Brakes on, engines idling, wind or power: 30 s on, nothing has moved.  On a round Earth
    rounding of 6e6 m is left.
    """
    values = {"mode.earth": earth, "init.psi": 0.4, "init.lat": 0.8, **BRAKED, **more}
    y = flightmech.trim(wheels, values, kind="ground")
    assert y.attrs["converged"] == 1
    flown = flightmech.simulate(
        wheels, xr.Dataset(coords={"time": np.arange(0.0, 30.0, 0.5)}), start_of(y)
    )
    tolerance = 1e-8 if earth else 1e-12
    for name in ("h", "theta", "phi", "vn", "ve", "p", "q", "r", "gear.left.Fz"):
        size = 1e5 if name.endswith("Fz") else 1.0  # the stiffness of a leg
        assert float(np.abs(flown[name].values - float(y[name])).max()) < tolerance * size, name


def test_the_start_of_a_run_stands_up_by_itself(wheels):
    """mode.trim 3: inputs and init.psi are all it needs, and init.* stay what they were given
    as.
    """
    values = {
        "mode.earth": 0.0,
        "mode.trim": 3.0,
        "gear": 1.0,
        "init.V": 0.0,
        "init.h": 1000.0,
        **BRAKED,
    }
    flown = flightmech.simulate(
        wheels, xr.Dataset(coords={"time": np.arange(0.0, 5.0, 0.5)}), values
    )
    y = flightmech.trim(wheels, {"mode.earth": 0.0, **BRAKED}, kind="ground")
    assert float(flown["h"][0]) == pytest.approx(float(y["h"]), abs=1e-9)
    assert float(np.ptp(flown["h"].values)) < 1e-12
    assert max(abs(float(flown[f"trim.{name}_dot"][0])) for name in "uvwpqr") < 1e-9


@pytest.mark.parametrize("speed", [0.0, 30.0])
def test_the_search_ends_where_rounding_does(speed, wheels):
    """What rounding changes along the way, the end of the search changes by less than 3e-7 m/s2
    bend a leg (k/m 50 s-2).
    """
    values = {"mode.earth": 0.0, "mode.trim": 3.0, "gear": 1.0, "init.V": speed, **BRAKED}
    record = xr.Dataset(coords={"time": np.array([0.0, 0.1])})
    mass = flightmech.simulate(wheels, record, values)["mass"].values[0]
    one, other = (
        flightmech.simulate(wheels, record, {**values, "mass.mass": part * mass}).isel(time=0)
        for part in (1.0, 1.0 + 1e-12)
    )
    assert one["mass"] != other["mass"]
    for name in ("h", "theta", "phi"):
        assert float(one[name]) == pytest.approx(float(other[name]), abs=6e-9), name
    solved = "uvwpqr" if speed == 0.0 else "pq"
    assert max(abs(float(one[f"trim.{name}_dot"])) for name in solved) < 3.2e-7


def test_rolling_at_constant_speed(wheels):
    """Throttle unknown: what pushes forward along the runway is drag and 0.02 of the load; the c.g.
    neither sinks nor pitches.
    """
    y = flightmech.trim(wheels, {"mode.earth": 0.0}, kind="ground", fixed={"V": 30.0, "u_dot": 0.0})
    assert y.attrs["verdict"] == "trimmed"
    assert list(y["unknown"].values) == ["h", "theta", "phi", "throttle"]
    load = sum(float(y[f"gear.{name}.Fz"]) for name in ("nose", "left", "right"))
    along = sum(float(y[f"gear.{name}.Fx"]) for name in ("nose", "left", "right"))
    assert along == pytest.approx(-0.02 * load, rel=1e-9)
    assert (float(y["V"]), float(y["hdot"])) == pytest.approx((30.0, 0.0), abs=1e-12)
    flown = flightmech.simulate(
        wheels, xr.Dataset(coords={"time": np.arange(0.0, 0.2, 0.01)}), start_of(y)
    )
    assert float(np.abs(flown["hdot"]).max()) < 1e-4  # offset c.g.: yaw and bank begin, slowly
    assert float(np.abs(flown["V"] - 30.0).max()) < 1e-3


def test_rolling_under_full_power(wheels):
    """Acceleration is what it comes to: felt along the runway, no part of it upward."""
    y = flightmech.trim(
        wheels, {"mode.earth": 0.0}, kind="ground", fixed={"V": 30.0, "throttle": 1.0}
    )
    assert y.attrs["verdict"] == "trimmed"
    u_dot, w_dot, theta = (float(y[name]) for name in ("trim.u_dot", "trim.w_dot", "theta"))
    assert 2.0 < u_dot < 4.5  # twice 4000 N and more on 2300 kg
    assert w_dot * np.cos(theta) - u_dot * np.sin(theta) == pytest.approx(
        0.0, abs=1e-3
    )  # bank and v_dot are small


def test_speed_on_the_ground_is_over_the_ground(wheels):
    y = flightmech.trim(
        wheels,
        {"mode.earth": 0.0, "wind_n": -10.0, "wind_e": 3.0},
        kind="ground",
        fixed={"V": 20.0},
    )
    assert float(y["vn"]) == pytest.approx(20.0, abs=1e-9)
    assert float(y["V"]) == pytest.approx(np.hypot(30.0, 3.0), rel=1e-9)
    assert float(y["beta"]) == pytest.approx(
        -np.arcsin(3.0 / np.hypot(30.0, 3.0)), abs=2e-3
    )  # plus a little bank


def test_brakes_that_do_not_hold_are_reported(wheels):
    """Idling without brakes: 600 N of thrust against 0.02 of the weight leave the difference."""
    y = flightmech.trim(wheels, {"mode.earth": 0.0}, kind="ground")
    assert y.attrs["converged"] == 0
    assert "left over: u_dot" in y.attrs["verdict"]
    thrust = float(y["engine1.thrust"]) + float(y["engine2.thrust"])
    assert float(y["left"].sel(residual="u_dot")) == pytest.approx(
        thrust / MASS - 0.02 * G0, rel=1e-2
    )


def test_a_tail_dragger_sits_on_its_tail(jet_on_wheels):
    """Main wheels ahead of the c.g.: the attitude of rest is that of the lower hull, far from
    level.
    """
    main = {"stiffness": 110e3, "damping": 8e3, "brake": 8e3, **_WHEEL}
    tail = Contact("tail", (-4.0, 0.0, 0.2), stiffness=60e3, damping=4e3, **_WHEEL)
    gear = LandingGear(
        (Contact("left", (0.8, -1.0, 1.2), **main), Contact("right", (0.8, 1.0, 1.2), **main), tail)
    )
    y = flightmech.trim(jet_on_wheels(gear=gear), {"mode.earth": 0.0, **BRAKED}, kind="ground")
    assert y.attrs["converged"] == 1
    assert float(y["theta"]) == pytest.approx(
        np.arctan2(1.0, 4.8), abs=0.03
    )  # the legs give way by some centimetres
    assert min(float(y[f"gear.{name}.Fz"]) for name in ("left", "right", "tail")) > 1000.0


def test_what_cannot_stand_is_refused(sim, wheels):
    with pytest.raises(SchemaError, match=r"the aircraft has no landing gear; give it \[gear\]"):
        flightmech.trim(sim, {}, kind="ground")
    with pytest.raises(
        SimulationError,
        match=r"mode.trim = 3 stands on the ground, but the aircraft has no landing gear",
    ):
        flightmech.trim(sim, {"mode.trim": 3.0})
    with pytest.raises(SimulationError, match=r"the input gear is 0; extend it \(1\)"):
        flightmech.trim(wheels, {"mode.trim": 3.0, "gear": 0.0})
