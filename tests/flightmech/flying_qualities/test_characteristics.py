"""Characteristics against closed forms of a model with constant derivatives, and the reasons in
words for what is absent.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import flightmech
from flightmech import terms
from flightmech.aircraft import Engine
from flightmech.aircraft.aircraft import with_contents
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.aircraft.separation import FlowSeparation
from flightmech.errors import SimulationError
from flightmech.flying_qualities.trim_over_speed import speed_stability
from flightmech.steady_flight.trim_point import trimmed_at
from flightmech.units import G0

V, H = 90.0, 1500.0
CONDITION = {"V": V, "h": H}
HINGE = {"": 0.01, "alpha": -0.15, "delta_e": -0.45, "qhat": -2.0}
CONTROLS = {
    "delta_e": ControlGeometry(1.6, 0.34, -1.1),
    "delta_a": ControlGeometry(1.2, 0.25, -0.4),
    "delta_r": ControlGeometry(0.9, 0.4, -2.0),
}
LATERAL_HINGE = {"Ch_a": {"delta_a": -0.3, "alpha": 0.0}, "Ch_r": {"delta_r": -0.4, "beta": 0.1}}


def value(found, quantity: str) -> float:
    row = found.table.loc[quantity]
    assert row["absent"] == "", row["absent"]
    return float(row["value"])


@pytest.fixture(scope="module")
def state(plain_aircraft):
    """What the closed forms need, from lift and moment balance without the kernel's trim."""
    craft = plain_aircraft()
    air = flightmech.air.atmosphere(H)
    qS = 0.5 * float(air.rho) * V**2 * craft.S

    def balance(alpha):  # L + T sin = W with T cos = D
        return (
            qS * (0.25 + 5.2 * alpha)
            + qS * (0.025 + 1.4 * alpha**2) * np.tan(alpha)
            - craft.mass * G0
        )

    alpha = brentq(balance, -0.1, 0.2, xtol=1e-14)
    CD = 0.025 + 1.4 * alpha**2
    return {
        "alpha": alpha,
        "qS": qS,
        "CD": CD,
        "CT": CD / np.cos(alpha),
        "CW": craft.mass * G0 / qS,
        "delta_e": (0.03 - 0.8 * alpha) / 1.2,
    }


@pytest.fixture(scope="module")
def found(plain_aircraft, plain_tree):
    return flightmech.characteristics(
        plain_aircraft(controls=CONTROLS), plain_tree(Ch_e=HINGE, **LATERAL_HINGE), CONDITION
    )


def normal_slope(state):
    """Slope of the force normal to the path: lift and thrust through the c.g."""
    return 5.2 + state["CT"] * np.cos(state["alpha"])


def test_trim(found, state):
    assert float(found.linear["x"].sel(state="alpha")) == pytest.approx(state["alpha"], rel=1e-9)
    assert float(found.linear["u"].sel(input="delta_e")) == pytest.approx(
        state["delta_e"], rel=1e-9
    )


def test_one_g_line(plain_aircraft, plain_tree):
    """At every Mach number the angle of attack by the balance of lift, drag, thrust and weight; NaN
    below the stall.
    """
    craft, mass, mach = plain_aircraft(), 2400.0, np.array([0.05, 0.15, 0.25, 0.4])
    point = trimmed_at(craft, plain_tree(), {**CONDITION, "mass": mass, "mode.engine": 2.0})
    line = flightmech.performance.one_g(point, mach)
    air = flightmech.air.atmosphere(H)
    for k in (1, 2, 3):
        qS = 0.5 * float(air.rho) * (mach[k] * float(air.a_sound)) ** 2 * craft.S

        def balance(alpha, qS=qS):
            return (
                qS * (0.25 + 5.2 * alpha)
                + qS * (0.025 + 1.4 * alpha**2) * np.tan(alpha)
                - mass * G0
            )

        alpha = brentq(balance, -0.1, 0.5, xtol=1e-14)
        assert float(line["alpha"][k]) == pytest.approx(alpha, rel=1e-8)
        assert float(line["delta_e"][k]) == pytest.approx((0.03 - 0.8 * alpha) / 1.2, rel=1e-8)
    assert np.isnan(line["alpha"][0])
    assert line["V"].values[1:] == pytest.approx(mach[1:] * float(air.a_sound), rel=1e-12)


def test_neutral_point_fixed(found, state, plain_aircraft):
    """Cm_alpha(x) = Cm_alpha + x CZ_alpha / cbar = 0 with CZ = -CL cos - CD sin; the textbook's h -
    Cm_alpha/CL_alpha within 2 %.
    """
    a, CL, CD = state["alpha"], 0.25 + 5.2 * state["alpha"], state["CD"]
    CZ_alpha = -5.2 * np.cos(a) + CL * np.sin(a) - 2.8 * a * np.sin(a) - CD * np.cos(a)
    expected = 0.25 + -0.8 / CZ_alpha
    assert value(found, "neutral_point_fixed") == pytest.approx(expected, rel=1e-8)
    assert value(found, "neutral_point_fixed") == pytest.approx(0.25 + 0.8 / 5.2, rel=0.02)
    assert value(found, "static_margin_fixed") == pytest.approx(expected - 0.25, rel=1e-7)


def test_neutral_point_free(found, state):
    """Elevator floats by -Ch_alpha/Ch_delta; CL_delta is zero here."""
    a, CL, CD = state["alpha"], 0.25 + 5.2 * state["alpha"], state["CD"]
    CZ_alpha = -5.2 * np.cos(a) + CL * np.sin(a) - 2.8 * a * np.sin(a) - CD * np.cos(a)
    Cm_alpha = -0.8 + -1.2 * 0.15 / -0.45
    assert value(found, "neutral_point_free") == pytest.approx(0.25 + Cm_alpha / CZ_alpha, rel=1e-7)
    assert value(found, "neutral_point_free") < value(
        found, "neutral_point_fixed"
    )  # a surface that floats with the wind


def test_elevator_per_g(found, state, plain_aircraft):
    """-(1/Cm_de) (Cm_alpha CW / CL_alpha + Cm_q g cbar / (2 V^2)), Etkin eq. (7.1,8) with CL_q =
    CL_de = 0.
    """
    qhat = G0 * plain_aircraft().cbar / (2 * V**2)
    alpha = state["CW"] / normal_slope(state)
    assert value(found, "alpha_per_g") == pytest.approx(alpha, rel=1e-8)
    assert value(found, "elevator_per_g") == pytest.approx(
        (-0.8 * alpha - 14.0 * qhat) / 1.2, rel=1e-8
    )


def test_manoeuvre_points(found, state, plain_aircraft):
    """Between neutral and manoeuvre point lies -rho S cbar Cm_q / (4 m) chords, free alike with the
    floating elevator.
    """
    craft = plain_aircraft()
    qhat, alpha = G0 * craft.cbar / (2 * V**2), state["CW"] / normal_slope(state)
    a, CL, CD = state["alpha"], 0.25 + 5.2 * state["alpha"], state["CD"]
    CZ_alpha = -5.2 * np.cos(a) + CL * np.sin(a) - 2.8 * a * np.sin(a) - CD * np.cos(a)
    fixed = 0.25 + (-0.8 + -14.0 * qhat / alpha) / CZ_alpha
    assert value(found, "manoeuvre_point_fixed") == pytest.approx(fixed, rel=1e-7)
    textbook = value(found, "neutral_point_fixed") + state["qS"] / (
        0.5 * V**2
    ) * craft.cbar * 14.0 / (4 * craft.mass)
    assert value(found, "manoeuvre_point_fixed") == pytest.approx(textbook, rel=0.01)
    floating = (0.15 * alpha + 2.0 * qhat) / -0.45
    free = 0.25 + (-0.8 - 14.0 * qhat / alpha - 1.2 * floating / alpha) / CZ_alpha
    assert value(found, "manoeuvre_point_free") == pytest.approx(free, rel=1e-7)


def test_elevator_per_g_is_that_of_the_kernel_in_a_pull_up(plain_aircraft, plain_tree):
    """Trimmed with pitch rates, CL_q and CL_de on: the thrust that the kernel adds acts through the
    c.g. and lifts a little.
    """
    db = plain_tree(CL={"qhat": 5.0, "delta_e": 0.5})
    found = flightmech.characteristics(plain_aircraft(), db, CONDITION)
    sim = flightmech.compile(plain_aircraft(), db)
    flown = [
        flightmech.trim(
            sim, {"init.V": V, "init.h": H, "mode.earth": 0.0, "init.q": sign * 0.01 * G0 / V}
        )
        for sign in (-1.0, 1.0)
    ]
    n = [1.0 + float(y["q"]) * V / G0 for y in flown]
    elevator = (float(flown[1]["applied.delta_e"]) - float(flown[0]["applied.delta_e"])) / (
        n[1] - n[0]
    )
    # thrust grows by dCD/dn = 0.08, and sin(alpha) of it, 0.014 of a CW of 0.5: lifts 0.3 % less
    assert value(found, "elevator_per_g") == pytest.approx(elevator, rel=0.004)


def test_stick_force_per_g(found, state, plain_aircraft):
    qhat = G0 * plain_aircraft().cbar / (2 * V**2)
    alpha = state["CW"] / normal_slope(state)
    delta_e = (-0.8 * alpha - 14.0 * qhat) / 1.2
    hinge = state["qS"] / 17.0 * 1.6 * 0.34 * (-0.15 * alpha - 0.45 * delta_e - 2.0 * qhat)
    assert value(found, "stick_force_per_g") == pytest.approx(1.1 * hinge, rel=1e-7)
    assert value(found, "stick_force_per_g") > 0.0  # pull for g


def test_force_over_speed(found, state, plain_aircraft):
    """F = -G qbar S c (Ch - Ch of the trim speed), differentiated numerically along the closed-form
    trim.
    """
    craft, rho = plain_aircraft(), 2.0 * state["qS"] / (V**2 * 17.0)

    def hinge(speed):
        qS = 0.5 * rho * speed**2 * craft.S
        alpha = brentq(
            lambda a: qS * (0.25 + 5.2 * a + (0.025 + 1.4 * a**2) * np.tan(a)) - craft.mass * G0,
            -0.1,
            0.3,
            xtol=1e-15,
        )
        delta_e = (0.03 - 0.8 * alpha) / 1.2
        return 0.01 - 0.15 * alpha - 0.45 * delta_e, delta_e

    h = 0.01
    (Ch_low, e_low), (Ch_high, e_high) = hinge(V - h), hinge(V + h)
    gradient = 1.1 * 0.5 * rho * V**2 * 1.6 * 0.34 * (Ch_high - Ch_low) / (2 * h)
    assert value(found, "F_column_per_V") == pytest.approx(
        gradient, rel=1e-3
    )  # the code differences over 0.1 % of V, curvature included
    assert value(found, "F_column") == pytest.approx(
        1.1 * 0.5 * rho * V**2 * 1.6 * 0.34 * hinge(V)[0], rel=1e-8
    )
    assert value(found, "delta_e_per_V") == pytest.approx((e_high - e_low) / (2 * h), rel=1e-4)
    at_trim = found.trim.interp(V=V)
    assert float(at_trim["delta_e"]) == pytest.approx(state["delta_e"], abs=1e-3)
    assert float(at_trim["F_column_trimmed"]) == pytest.approx(
        0.0, abs=3.0
    )  # interpolated between speeds 10 m/s apart


def test_neutral_point_of_the_trim_curve(found):
    """Without Mach effects and thrust moments it is where Cm_alpha vanishes but for drag in CZ and
    thrust in lift.
    """
    assert value(found, "neutral_point_trim") == pytest.approx(
        value(found, "neutral_point_fixed"), abs=0.005
    )


def test_sideslip(found, state):
    """CY_beta + CY_dr r + CW phi = 0, Cl and Cn likewise: solved here by elimination."""
    A = np.array([[-0.14, 0.01], [0.005, -0.08]])
    a, r = np.linalg.solve(A, [0.09, -0.1])
    theta = state["alpha"]
    phi = -(-0.7 + 0.17 * r) / (state["CW"] * np.cos(theta))
    assert value(found, "delta_a_per_beta") == pytest.approx(a, rel=1e-8)
    assert value(found, "delta_r_per_beta") == pytest.approx(r, rel=1e-8)
    assert value(found, "phi_per_beta") == pytest.approx(phi, rel=1e-8)
    qbar = state["qS"] / 17.0
    assert value(found, "F_pedal_per_beta") == pytest.approx(
        2.0 * qbar * 0.9 * 0.4 * (0.1 - 0.4 * r), rel=1e-7
    )
    assert value(found, "F_wheel_per_beta") == pytest.approx(
        0.4 * qbar * 1.2 * 0.25 * -0.3 * a, rel=1e-7
    )


def test_sideslip_is_that_of_the_kernel(found, plain):
    """Trimmed with 0.5 degrees of bank."""
    y = flightmech.trim(plain(), {"init.V": V, "init.h": H, "mode.earth": 0.0, "init.phi": 0.01})
    beta = float(y["beta"])
    for quantity, output in (
        ("delta_a_per_beta", "applied.delta_a"),
        ("delta_r_per_beta", "applied.delta_r"),
        ("phi_per_beta", "phi"),
    ):
        assert value(found, quantity) == pytest.approx(
            float(y[output]) / beta, rel=2e-3
        )  # sine of the bank, beta of second order


def test_roll_rate(found, state, plain_aircraft):
    p = -(-0.14 * -0.35) / -0.45 * 2 * V / 10.3
    assert value(found, "roll_rate_one_degree") == pytest.approx(p, rel=1e-8)
    assert value(found, "F_wheel_full") == pytest.approx(
        0.4 * state["qS"] / 17.0 * 1.2 * 0.25 * -0.3 * -0.35, rel=1e-7
    )


def test_roll_rate_of_the_whole_aircraft(plain_aircraft, plain_tree):
    """Without sideslip in the rolling moment and without yaw the whole aircraft rolls as one degree
    of freedom.
    """
    alone = plain_tree(
        Cl={"beta": 0.0, "rhat": 0.0}, Cn={"beta": 0.5, "phat": 0.0, "rhat": 0.0, "delta_a": 0.0}
    )
    limits = {
        "delta_e": (-0.4, 0.4),
        "delta_a": (-0.05, 0.05),
    }  # 16 deg/s: the nose hardly drops in 5 s
    found = flightmech.characteristics(plain_aircraft(limits=limits), alone, CONDITION)
    assert value(found, "roll_rate_peak") == pytest.approx(
        value(found, "roll_rate_one_degree"), rel=0.01
    )


def test_polar_and_glide(found, state, plain_aircraft):
    """CD = 0.025 + 1.4 ((CL - 0.25)/5.2)^2: tangent from the origin by hand."""
    k = 1.4 / 5.2**2
    CL = np.sqrt((0.025 + k * 0.25**2) / k)
    CD = 0.025 + k * (CL - 0.25) ** 2
    assert value(found, "L_D_max") == pytest.approx(CL / CD, rel=1e-3)  # best of 121 angles
    assert value(found, "gamma_best_glide") == pytest.approx(-np.arctan(CD / CL), rel=1e-3)
    rho = 2.0 * state["qS"] / (V**2 * 17.0)
    assert value(found, "V_best_glide") == pytest.approx(
        np.sqrt(2 * 2400.0 * G0 / (rho * 17.0 * np.hypot(CL, CD))), rel=0.01
    )


def test_fuel_of_the_flight_counts_in_mass_and_centre_of_gravity(plain_aircraft, plain_tree):
    """Tanks emptied by the condition, against an aircraft file that states them empty."""
    tank = Tank((-1.0, 0.0, 0.2), 400.0, name="aft", content=400.0)
    engine = Engine((0.0, 0.0, 0.0), feed=("aft",))
    craft = plain_aircraft(engines=(engine,), fuel=Fuel(400.0, tanks=(tank,)))
    flown = trimmed_at(craft, plain_tree(), CONDITION | {"init.tank.aft.fuel": 0.0})
    assert flown.mass == pytest.approx(2000.0, rel=1e-13)
    assert flown.cg == pytest.approx([0.2, 0.0, -0.04], abs=1e-13)
    stated = trimmed_at(with_contents(craft, {"aft": 0.0}), plain_tree(), CONDITION)
    np.testing.assert_allclose(flown.body_slopes("alpha"), stated.body_slopes("alpha"), rtol=1e-9)
    assert flown.variables["x_cg"] == pytest.approx(0.25 - 0.2 / 1.67, rel=1e-13)
    found, expected = (
        next(row.value for row in speed_stability(one) if row.quantity == "neutral_point_trim")
        for one in (flown, stated)
    )
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("setting", [0.0, 1.0])
def test_derivatives_hold_the_setting_of_a_device(setting, plain_aircraft, plain_tree):
    """Ice takes 1.0 of the lift slope of 5.2 per radian."""
    iced = terms.make_term(-1.0, regressors=["alpha", "device.ice.setting"])
    tree = plain_tree(CL={"ice": iced})
    flight = trimmed_at(plain_aircraft(), tree, CONDITION | {"device.ice.setting": setting})
    assert flight.coefficients()[0] == pytest.approx(flight["CL"], rel=1e-12)
    assert flight.body_slopes("alpha")[2] < 0.0
    slope = flight.derivatives(["alpha"])["value"].sel(coefficient="CL").item()
    assert slope == pytest.approx(5.2 - setting, rel=1e-9)


def test_a_variable_that_no_trim_gives_is_named(plain_aircraft, plain_tree):
    parts = {"a1": 20.0, "alpha_star": 0.25, "tau1": 15.0, "tau2": 4.0}
    stall = FlowSeparation(2.0, {name: terms.make_term(value) for name, value in parts.items()})
    tree = plain_tree(CL={"separated": terms.make_term(0.1, regressors=["X_lift"])})
    flight = trimmed_at(plain_aircraft(stall=stall), tree, CONDITION)
    with pytest.raises(SimulationError, match="depend on X_lift, which a trimmed flight does not"):
        flight.coefficients()
