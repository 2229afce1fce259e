"""Signs, axes and normalisation, each against a number worked out by hand.

All at sea level over the flat Earth: rho = 1.225 kg/m3, so that 100 m/s give 6125 Pa and, on 17 m2,
a force of 104 125 N per unit coefficient.  The standard's constants make 1.225 to 1e-7, hence the
relative tolerance of 1e-6.
"""

from __future__ import annotations

import numpy as np
import pytest

import flightmech
from flightmech import air
from flightmech.terms import make_term

LEVEL = {"init__V": 100.0, "init__h": 0.0, "mode__earth": 0.0}
QS, MASS, WEIGHT = 104125.0, 2300.0, 2300.0 * 9.80665
IXX, IYY, IZZ = 10800.0, 8100.0, 15100.0
PLAIN = {"engines": (), "cg": (0.0, 0.0, 0.0), "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0}


@pytest.fixture(scope="module")
def body(make_aircraft, make_tree):
    """Compile constant or linear terms: a number, or (number, regressor, ...)."""

    def build(terms: dict, attrs: dict | None = None, **changes) -> flightmech.SimModel:
        rows = {
            name: value if isinstance(value, tuple) else (value,) for name, value in terms.items()
        }
        leaves = {
            name: make_term(value, regressors=list(words)) for name, (value, *words) in rows.items()
        }
        return flightmech.compile(
            make_aircraft(**(PLAIN | changes)), make_tree(leaves, **(attrs or {}))
        )

    return build


def near(value):
    return pytest.approx(value, rel=1e-6)


def test_dynamic_pressure_and_reference_area(body, flown):
    assert flown(body({"CD/basic": 0.04}), **LEVEL)["qbar"] == near(6125.0)
    assert flown(body({"CD/basic": 0.04}), **LEVEL)["ax"] == near(-0.04 * QS / MASS)


def test_stability_axes_are_body_axes_turned_by_alpha(body, flown):
    """alpha = 30 deg: CX = CL sin - CD cos = 0.5 - 0.4330127, CZ = -CL cos - CD sin = -0.8660254 -
    0.25.
    """
    y = flown(body({"CL/a": 1.0, "CD/a": 0.5, "CY/a": 0.2}), **LEVEL, init__alpha=np.pi / 6)
    assert (y["ax"], y["ay"], y["az"]) == near(
        (0.0669873 * QS / MASS, 0.2 * QS / MASS, -1.1160254 * QS / MASS)
    )


def test_moments_of_the_database_are_in_body_axes_with_span_and_chord(body, flown):
    y = flown(
        body({"Cl/a": 0.01, "Cm/a": 0.02, "Cn/a": -0.03}), **LEVEL, init__alpha=0.5, init__beta=0.2
    )
    assert (y["p_dot"], y["q_dot"], y["r_dot"]) == near(
        (0.01 * QS * 10.3 / IXX, 0.02 * QS * 1.67 / IYY, -0.03 * QS * 10.3 / IZZ)
    )


def test_aerodynamic_force_about_the_centre_of_gravity(body, flown):
    """F = (-5206.25, 10412.5, -52062.5) N acts at r = (0.1, -0.02, -0.3) m from the c.g.; r x F by
    components.

    The c.g. lies behind, right of and below the reference point.
    """
    sim = body(
        {"CX/a": -0.05, "CY/a": 0.1, "CZ/a": -0.5}, {"force_axes": "body"}, cg=(-0.1, 0.02, 0.3)
    )
    y = flown(sim, **LEVEL)
    assert (y["p_dot"], y["q_dot"], y["r_dot"]) == near(
        (4165.0 / IXX, 6768.125 / IYY, 937.125 / IZZ)
    )


def test_thrust_about_the_centre_of_gravity(body, flown):
    """1000 N forward at (-0.36, -0.77, -0.17) m from the c.g.: above it pitches down 170 N m, left
    of it yaws right 770 N m.
    """
    engine = flightmech.aircraft.Engine((-0.3, -0.76, 0.05))
    y = flown(
        body({"CD/a": 0.0}, engines=(engine,), cg=(0.06, 0.01, 0.22)),
        **LEVEL,
        engine1__thrust_drive=1000.0,
    )
    assert (y["ax"], y["p_dot"], y["q_dot"], y["r_dot"]) == near(
        (1000.0 / MASS, 0.0, -170.0 / IYY, 770.0 / IZZ)
    )


def test_rates_are_reduced_by_span_and_chord_over_twice_the_speed(body, flown):
    """p b/2V = 0.4 x 10.3 / 200 = 0.0206, q c/2V = 0.2 x 1.67 / 200 = 0.00167, r b/2V = -0.3 x 10.3
    / 200 = -0.01545.
    """
    y = flown(
        body({"Cl/p": (-0.4, "phat"), "Cm/q": (-12.0, "qhat"), "Cn/r": (-0.15, "rhat")}),
        **LEVEL,
        init__p=0.4,
        init__q=0.2,
        init__r=-0.3,
    )
    assert (y["Cl"], y["Cm"], y["Cn"]) == near((-0.4 * 0.0206, -12.0 * 0.00167, -0.15 * -0.01545))


def test_flow_rates_and_their_reduced_forms(body, flown):
    """Without forces, bank 30 deg: w' = g cos + q V, v' = g sin - r V.

    alpha-dot = (8.4928080 + 10) / 100, beta-dot = (4.903325 - 3) / 100; reduced by 1.67 / 200 and
    10.3 / 200.
    """
    sim = body({"Cm/a": (-4.0, "alphadothat"), "Cn/b": (2.0, "betadothat"), "Cl/n": (0.1, "dnz")})
    y = flown(sim, **LEVEL, init__phi=np.pi / 6, init__q=0.1, init__r=0.03)
    assert (y["alpha_dot"], y["beta_dot"]) == near((0.18492808, 0.01903325))
    assert (y["Cm"], y["Cn"], y["Cl"]) == near(
        (-4.0 * 0.18492808 * 1.67 / 200, 2.0 * 0.01903325 * 10.3 / 200, -0.1)
    )


def test_lift_due_to_alpha_dot_slows_alpha_dot(body, flown):
    """alpha-dot V = g - (qS / m) k alpha-dot c / 2V, solved for alpha-dot; and nz is what that lift
    makes.
    """
    y = flown(body({"CL/a": (2.0, "alphadothat")}), **LEVEL)
    alpha_dot = 9.80665 / 100 / (1.0 + QS / MASS * 2.0 * 1.67 / 200 / 100)
    assert y["alpha_dot"] == near(alpha_dot)
    assert y["nz"] == near(QS * 2.0 * alpha_dot * 1.67 / 200 / WEIGHT)


def test_lift_due_to_load_factor(body, flown):
    """nz W = qS (0.2 - 0.01 (nz - 1)), solved for nz."""
    y = flown(body({"CL/a": 0.2, "CL/n": (-0.01, "dnz")}), **LEVEL)
    assert y["nz"] == near(QS * 0.21 / (WEIGHT + 0.01 * QS))


def test_height_of_the_reference_point_over_the_runway(body, flown):
    """c.g. 1 m behind, 0.5 m right of and 2 m below it; bank 30, pitch 20 deg: down = (-0.3420201,
    0.4698463, 0.8137977) in body axes.

    The reference point is higher than the c.g. by 0.3420201 + 0.2349232 + 1.6275954 m.
    """
    attitude = {
        "init__phi": np.pi / 6,
        "init__theta": np.pi / 9,
        "init__psi": 2.0,
        "init__h": 100.0,
        "env__runway_elevation": 20.0,
    }
    y = flown(body({"CD/a": 0.0}, cg=(-1.0, 0.5, 2.0)), **(LEVEL | attitude))
    assert y["h"] == near(100.0)
    assert y["h_agl"] == near(82.2045387)


def test_centre_of_gravity_in_chords(body, flown):
    """0.25 c minus 0.167 m / 1.67 m: a c.g. ahead of the reference point has the smaller x_cg."""
    assert flown(body({"Cm/a": (1.0, "x_cg")}, cg=(0.167, 0.0, 0.0)), **LEVEL)["Cm"] == near(0.15)


@pytest.mark.parametrize(
    ("wind", "found"),
    [
        ({"wind_n": 10.0}, (90.0, 0.0, 0.0)),  # a tailwind takes airspeed
        (
            {"wind_e": 10.0},
            (np.sqrt(10100.0), 0.0, -0.0996687),
        ),  # air that moves to the right comes from the left
        ({"wind_d": -5.0}, (np.sqrt(10025.0), 0.0499584, 0.0)),  # rising air raises alpha
    ],
)
def test_wind_is_the_velocity_of_the_air(wind, found, body, start):
    """Flying north at 100 m/s, then the wind sets in; atan 0.1 = 0.0996687, atan 0.05 =
    0.0499584.
    """
    sim = body({"CD/a": 0.0})
    run = start(sim, **LEVEL)
    run.set_inputs([wind.get(name, 0.0) for name in sim.inputs])
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    assert (y["V"], y["alpha"], y["beta"]) == pytest.approx(found, rel=1e-6, abs=1e-12)
    assert (y["vn"], y["ve"], y["vd"]) == pytest.approx((100.0, 0.0, 0.0), abs=1e-12)


def test_calibrated_airspeed(body, flown):
    """At sea level it is the true airspeed, supersonic too.  At half the pressure and M = 1 the
    impact pressure is 0.8929292 p = 0.4464646 p0, and sqrt(5 (1.4464646^(2/7) - 1)) = 0.7457392 of
    the speed of sound there.
    """
    sim, sound = body({"CD/a": 0.0}), 340.2940
    for V in (60.0, 250.0, 2.0 * sound):
        assert flown(sim, **LEVEL | {"init__V": V})["V_cas"] == near(V)
    y = flown(sim, **LEVEL | {"init__V": sound, "env__qnh": 101325.0 / 2})
    assert y["V_cas"] == near(0.7457392 * sound)


def test_specific_force_is_that_of_the_centre_of_gravity(body, flown):
    """What falls freely feels nothing, however it turns; and F / m has no part of the rates when
    the c.g. is off the reference point.
    """
    turning = {"init__p": 1.0, "init__q": -2.0, "init__r": 3.0, "init__theta": 0.5}
    y = flown(body({"CD/a": 0.0}, cg=(0.3, 0.1, -0.2)), **LEVEL, **turning)
    assert (y["ax"], y["ay"], y["az"], y["nz"]) == (0.0, 0.0, 0.0, 0.0)
    y = flown(body({"CL/a": 0.3}, cg=(0.3, 0.1, -0.2)), **LEVEL, **turning)
    assert (y["ax"], y["ay"], y["az"]) == near((0.0, 0.0, -0.3 * QS / MASS))
    assert y["nz"] == near(0.3 * QS / WEIGHT)


GLIDE = {
    "CL/0": 0.1,
    "CL/a": (5.0, "alpha"),
    "CD/0": 0.03,
    "CY/b": (-0.6, "beta"),
    "Cl/b": (-0.08, "beta"),
    "Cl/d": (-0.15, "delta_a"),
    "Cm/0": 0.04,
    "Cm/a": (-0.7, "alpha"),
    "Cm/d": (-1.1, "delta_e"),
    "Cn/b": (0.1, "beta"),
    "Cn/d": (-0.07, "delta_r"),
}


@pytest.fixture(scope="module")
def steady(body) -> flightmech.SimModel:
    return body(GLIDE, engines=(flightmech.aircraft.Engine((0.0, 0.0, 0.0)),))


def root(f, low: float, high: float) -> float:
    """Bisection."""
    for _ in range(80):
        low, high = (
            (0.5 * (low + high), high)
            if f(0.5 * (low + high)) * f(low) > 0.0
            else (low, 0.5 * (low + high))
        )
    return low


def trimmed(sim: flightmech.SimModel, **extra: float) -> dict[str, float]:
    names = {key.replace("__", "."): value for key, value in {**LEVEL, **extra}.items()}
    return {str(name): float(value) for name, value in flightmech.trim(sim, names).items()}


@pytest.mark.parametrize("gamma", [0.0, 0.1, -0.05])
def test_trim_of_straight_flight(gamma, steady):
    """Along the path T cos a = D + W sin g, across it L + T sin a = W cos g: with T eliminated one
    equation for alpha.
    """
    pull = 0.03 + WEIGHT / QS * np.sin(gamma)
    alpha = root(
        lambda a: 0.1 + 5.0 * a + pull * np.tan(a) - WEIGHT / QS * np.cos(gamma), -0.2, 0.3
    )
    y = trimmed(steady, init__gamma=gamma)
    assert (y["alpha"], y["theta"], y["beta"], y["phi"]) == pytest.approx(
        (alpha, alpha + gamma, 0.0, 0.0), rel=1e-6, abs=1e-12
    )
    assert y["trim.thrust"] == near(QS * pull / np.cos(alpha))
    assert y["trim.delta_e"] == near((0.04 - 0.7 * alpha) / 1.1)
    assert (y["ax"], y["nz"]) == near((9.80665 * np.sin(alpha + gamma), np.cos(alpha + gamma)))


def test_trim_of_a_steady_sideslip(steady):
    """Right wing down 5 deg without a turn: W sin phi cos theta = 0.6 beta qS, wind from the right;
    rudder and aileron hold the moments.
    """
    y = trimmed(steady, init__phi=np.radians(5.0))
    beta = WEIGHT * np.sin(np.radians(5.0)) * np.cos(y["theta"]) / (0.6 * QS)
    assert beta > 0.02
    found = (y["beta"], y["trim.delta_r"], y["trim.delta_a"])
    assert found == near((beta, 0.1 * beta / 0.07, -0.08 * beta / 0.15))
    assert (y["gamma"], y["phi"]) == pytest.approx((0.0, np.radians(5.0)), abs=1e-10)


def test_trim_of_a_coordinated_turn(steady):
    """Level turn with bank 45 deg and g tan(phi) / V: the specific force is g / cos(phi) =
    13.8686971 m/s2, the sideslip next to none.
    """
    turn, theta = 9.80665 / 100.0, 0.0
    for _ in range(30):  # body rates of the turn follow the pitch attitude, which the trim finds
        rates = {
            "init__p": -turn * np.sin(theta),
            "init__q": turn * np.cos(theta) * np.sqrt(0.5),
            "init__r": turn * np.cos(theta) * np.sqrt(0.5),
        }
        y = trimmed(steady, init__phi=np.pi / 4, **rates)
        theta = y["theta"]
    assert max(abs(y[f"trim.{name}_dot"]) for name in "uvwpqr") < 1e-9
    assert np.linalg.norm([y["ax"], y["ay"], y["az"]]) == near(13.8686971)
    assert (y["gamma"], y["phi"]) == pytest.approx((0.0, np.pi / 4), abs=1e-10)
    assert abs(y["beta"]) < 1e-3  # g tan(phi) / V is the turn without sideslip for small alpha only


@pytest.mark.parametrize("h", [-200.0, 0.0, 1500.0, 10999.0, 15000.0, 25000.0])
def test_pressure_altitude_is_that_of_an_altimeter_at_1013(h, sim, flown):
    y = flown(sim, init__h=h, env__delta_T=18.0, env__qnh=99000.0)
    assert y["h_baro"] == pytest.approx(float(air.pressure_altitude(y["p_static"])), abs=1e-6)
    standard = flown(sim, init__h=h)
    assert standard["h_baro"] == pytest.approx(
        6356766.0 * h / (6356766.0 + h), abs=1e-6
    )  # geopotential metres
    # an altimeter set to the QNH of the runway shows its elevation
    qnh = 102000.0
    on_runway = flown(
        sim, init__h=1500.0, env__delta_T=20.0, env__qnh=air.sea_level_pressure(qnh, 1500.0, 20.0)
    )
    shown = on_runway["h_baro"] - float(air.pressure_altitude(qnh))
    assert shown == pytest.approx(6356766.0 * 1500.0 / (6356766.0 + 1500.0), abs=1e-6)
