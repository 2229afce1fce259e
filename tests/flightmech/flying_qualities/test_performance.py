"""Stall, level flight, climb, ceilings and minimum control speed; conditions, absent quantities."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq

import flightmech
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import SchemaError, SimulationError, UnknownName
from flightmech.simulation import catalogue, submodels
from flightmech.simulation.kernel import VARIABLE
from flightmech.steady_flight.trim_point import trimmed_at
from flightmech.terms import make_term
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


def reason(found, quantity: str) -> str:
    row = found.table.loc[quantity]
    assert np.isnan(row["value"])
    return row["absent"]


@pytest.fixture(scope="module")
def found(plain_aircraft, plain_tree):
    return flightmech.characteristics(
        plain_aircraft(controls=CONTROLS), plain_tree(Ch_e=HINGE, **LATERAL_HINGE), CONDITION
    )


def symmetric_jet(plain_aircraft, plain_tree, **engine):
    """Symmetric polar CD = 0.02 + 0.05 CL^2, two engines 2 m apart."""
    engines = tuple(Engine((0.0, y, 0.0), **engine) for y in (-1.0, 1.0))
    alpha = np.radians([-10.0, 0.0, 10.0, 14.0, 18.0])
    lift = make_term([-0.9, 0.0, 0.9, 1.26, 1.1], {"alpha": alpha})
    slope = 0.9 / np.radians(10.0)
    db = plain_tree(
        CL={"": lift, "alpha": 0.0}, CD={"": 0.02, "alpha alpha": 0.05 * slope**2}, Cm={"": 0.0}
    )
    return flightmech.characteristics(
        plain_aircraft(engines=engines), db, {"V": 120.0, "h": 3000.0, "mass": 2500.0}
    )


@pytest.fixture(scope="module")
def jet(plain_aircraft, plain_tree):
    """Thrust that falls with height only."""
    return symmetric_jet(
        plain_aircraft,
        plain_tree,
        thrust=make_term(
            [[0.0, 0.0], [5000.0, 0.0]], {"throttle": [0.0, 1.0], "h": [0.0, 12000.0]}
        ),
    )


@pytest.fixture(scope="module")
def decked(plain_aircraft, plain_tree):
    """Corrected thrust over corrected N2, which the lever commands, and a fuel flow in proportion:
    2e-5 kg/s per N.
    """
    speeds, time = {"corrected_n2": [0.5, 1.0]}, make_term(0.5)
    tables = {
        "corrected_n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
        "n2_up_time": time,
        "corrected_thrust": make_term([0.0, 6000.0], speeds),
        "corrected_fuel_flow": make_term([0.0, 0.12], speeds),
    }
    return symmetric_jet(plain_aircraft, plain_tree, deck=EngineDeck(tables))


@pytest.mark.slow
def test_stall_at_the_maximum_of_the_table(jet):
    rho = float(flightmech.air.atmosphere(3000.0).rho)
    assert value(jet, "CL_max") == pytest.approx(1.26, rel=3e-3)  # best of 121 angles
    assert "maximum of the lift table" in jet.table.loc["CL_max", "remark"]
    assert value(jet, "V_stall") == pytest.approx(
        np.sqrt(2 * 2500.0 * G0 / (rho * 17.0 * 1.26)), rel=2e-3
    )


def test_parabola_through_the_polar_below_the_stall(jet):
    assert value(jet, "CD0") == pytest.approx(0.02, rel=1e-3)
    assert value(jet, "k") == pytest.approx(0.05, rel=1e-3)
    assert value(jet, "oswald") == pytest.approx(17.0 / (np.pi * 10.3**2 * 0.05), rel=1e-3)


def test_level_flight(jet):
    """Minimum drag W 2 sqrt(CD0 k) at CL = sqrt(CD0/k), minimum power at CL = sqrt(3 CD0/k), M L/D
    at CL = sqrt(CD0/(3k)).
    """
    W, rho = 2500.0 * G0, float(flightmech.air.atmosphere(3000.0).rho)

    def speed(CL):
        return np.sqrt(2 * W / (rho * 17.0 * CL))

    # thrust along body x carries sin(alpha) of itself, 0.5 % of the weight at least drag, 2 % at
    # least power
    assert value(jet, "minimum_drag") == pytest.approx(W * 2 * np.sqrt(0.02 * 0.05), rel=0.01)
    assert value(jet, "V_minimum_drag") == pytest.approx(speed(np.sqrt(0.02 / 0.05)), rel=0.02)
    assert value(jet, "V_minimum_power") == pytest.approx(speed(np.sqrt(3 * 0.02 / 0.05)), rel=0.05)
    assert value(jet, "V_M_L_D_max") == pytest.approx(speed(np.sqrt(0.02 / 0.15)), rel=0.02)
    assert value(jet, "L_D_level") == pytest.approx(1 / (2 * np.sqrt(0.02 * 0.05)), rel=0.01)
    assert "no fuel flow" in reason(jet, "specific_range")


def test_climb_and_ceiling(jet):
    W, have = 2500.0 * G0, 2 * (5000.0 - 5000.0 * 3000.0 / 12000.0)
    least = W * 2 * np.sqrt(0.02 * 0.05)
    assert np.sin(value(jet, "gamma_max")) == pytest.approx((have - least) / W, rel=0.01)
    # absolute ceiling: 2 * 5000 (1 - h/12000) = least drag, which does not depend on height
    assert value(jet, "absolute_ceiling") == pytest.approx(
        12000.0 * (1.0 - least / 10000.0), rel=0.01
    )
    assert value(jet, "service_ceiling") < value(jet, "absolute_ceiling")
    V_y = value(jet, "V_climb_rate_max")
    drag = float(jet.performance["thrust_required"].interp(V=V_y))
    assert value(jet, "climb_rate_max") == pytest.approx((have - drag) / W * V_y, rel=0.01)
    V_max = value(jet, "V_max")
    assert float(jet.performance["thrust_required"].interp(V=V_max)) == pytest.approx(
        have, rel=0.01
    )


@pytest.mark.slow
def test_climb_and_ceiling_of_a_deck(decked):
    """Thrust is the pressure ratio times 12 kN, so the absolute ceiling is the pressure altitude
    where that is the least drag.
    """
    W = 2500.0 * G0
    least = W * 2 * np.sqrt(0.02 * 0.05)
    have = 12000.0 * float(flightmech.air.atmosphere(3000.0).p_static) / 101325.0
    assert np.sin(value(decked, "gamma_max")) == pytest.approx((have - least) / W, rel=0.01)
    np.testing.assert_allclose(decked.performance["thrust_available"], have, rtol=1e-9)
    ceiling = brentq(
        lambda h: 12000.0 * float(flightmech.air.atmosphere(h).p_static) / 101325.0 - least,
        0.0,
        20e3,
    )
    assert value(decked, "absolute_ceiling") == pytest.approx(
        ceiling, abs=100.0
    )  # 1 % of thrust is 80 m
    assert (
        "tables of the deck" not in decked.table.loc["absolute_ceiling", "remark"]
    )  # none has an axis of height


def test_specific_range_of_a_deck(decked):
    """V / (2e-5 sqrt(theta) D), theta the total temperature ratio, over all speeds."""
    air, W = flightmech.air.atmosphere(3000.0), 2500.0 * G0
    speed = np.linspace(60.0, 200.0, 1401)
    qS = 0.5 * float(air.rho) * speed**2 * 17.0
    drag = 0.02 * qS + 0.05 * W**2 / qS
    theta = float(air.temperature) / 288.15 * (1.0 + 0.2 * (speed / float(air.a_sound)) ** 2)
    far = speed / (2e-5 * np.sqrt(theta) * drag)
    assert value(decked, "specific_range") == pytest.approx(far.max(), rel=0.01)
    assert value(decked, "V_specific_range") == pytest.approx(speed[far.argmax()], rel=0.02)


@pytest.mark.nightly
def test_minimum_control_speed(plain_aircraft, plain_tree):
    """Balance of sideslip, ailerons and rudder at 5 degrees of bank, solved here by linear algebra
    at the speed found.
    """
    thrust = make_term([0.0, 9000.0], {"throttle": [0.0, 1.0]})
    engines = tuple(Engine((0.0, y, 0.0), thrust=thrust) for y in (-1.5, 1.5))
    db = plain_tree(Cn={"delta_r": -0.06})
    craft = plain_aircraft(engines=engines)
    found = flightmech.characteristics(craft, db, CONDITION)
    Vmc = value(found, "minimum_control_speed")
    assert "engine 1 gives no thrust" in found.table.loc["minimum_control_speed", "remark"]
    sim = flightmech.compile(craft, db)
    y = flightmech.trim(sim, {"init.V": Vmc, "init.h": H, "mode.engine": 2.0, "mode.earth": 0.0})
    qS = float(y["qbar"]) * craft.S
    # live engine right: nose goes left, bank to the right helps
    A = np.array([[-0.7, 0.0, 0.17], [-0.09, -0.14, 0.01], [0.1, 0.005, -0.06]])
    right = -np.array(
        [
            2400.0 * G0 * np.cos(float(y["theta"])) * np.sin(np.radians(5.0)) / qS,
            0.0,
            -9000.0 * 1.5 / (qS * 10.3),
        ]
    )
    _, delta_a, delta_r = np.linalg.solve(A, right)
    assert max(abs(delta_a), abs(delta_r)) == pytest.approx(0.35, rel=1e-3)
    assert delta_r < 0.0  # trailing edge right: nose right, towards the live engine


@pytest.mark.nightly
def test_what_is_absent_states_why(plain_aircraft, plain_tree):
    found = flightmech.characteristics(
        plain_aircraft(limits={"delta_e": (-0.4, 0.4)}), plain_tree(Cn={"delta_r": 0.0}), CONDITION
    )
    assert reason(found, "stick_force_per_g") == "the database has no hinge moments Ch_e"
    assert "no hinge moments Ch_e over the elevator" in reason(found, "neutral_point_free")
    assert "rudder has no effect" in reason(found, "delta_r_per_beta")
    assert reason(found, "roll_rate_peak") == "the aircraft file gives no limits of delta_a"
    assert (
        reason(found, "climb_rate_max")
        == "the aircraft file gives an engine neither a thrust table nor a deck nor a propeller"
    )
    assert "no engines off the centre line" in reason(found, "minimum_control_speed")
    half = flightmech.characteristics(plain_aircraft(), plain_tree(Ch_e=HINGE), CONDITION)
    assert "no [control.delta_e]" in reason(half, "stick_force_per_g")
    assert np.isfinite(value(half, "neutral_point_free"))
    loose = flightmech.characteristics(
        plain_aircraft(controls={"delta_e": ControlGeometry(1.6, 0.34)}),
        plain_tree(Ch_e=HINGE),
        CONDITION,
    )
    assert "gives no gearing in [control.delta_e]" in reason(loose, "stick_force_per_g")


def test_a_glider_has_no_level_flight(plain_aircraft, plain_tree):
    found = flightmech.characteristics(
        plain_aircraft(engines=()), plain_tree(), {"V": 60.0, "h": 0.0}
    )
    y = found.linear["x"].sel(state=["alpha", "theta"]).values
    lift, drag = 0.25 + 5.2 * y[0], 0.025 + 1.4 * y[0] ** 2
    assert np.tan(y[1] - y[0]) == pytest.approx(-drag / lift, rel=1e-8)  # it glides
    assert reason(found, "V_minimum_drag") == "the aircraft file has no engines"
    assert reason(found, "climb_rate_max") == "the aircraft file has no engines"
    assert value(found, "L_D_max") > 10.0
    assert not found.performance.data_vars


POWER = ["CT", "engine1.thrust", "engine1.throttle"]


@pytest.mark.nightly
@pytest.mark.parametrize("variable", POWER)
def test_terms_of_power_are_evaluated_and_vanish_power_off(variable, plain_aircraft, plain_tree):
    """A drag and a moment of power: in the trim, not in the polar, which is that of the database
    without them.
    """
    plain = flightmech.characteristics(plain_aircraft(), plain_tree(), CONDITION)
    slope = {"CT": 1.0, "engine1.thrust": 1e-5, "engine1.throttle": 0.1}[variable]
    db = plain_tree(
        Cm={"": 0.03, "alpha": -0.8, "qhat": -15.0, "delta_e": -1.2, variable: -0.05 * slope}
    )
    powered = flightmech.characteristics(plain_aircraft(), db, CONDITION)
    same = plain_tree(Cm={"": 0.03, "alpha": -0.8, "qhat": -15.0, "delta_e": -1.2})
    off = flightmech.characteristics(plain_aircraft(), same, CONDITION)
    np.testing.assert_allclose(powered.polar["CL"], off.polar["CL"], rtol=1e-12)
    np.testing.assert_allclose(powered.polar["delta_e"], off.polar["delta_e"], atol=1e-9)
    if variable != "engine1.throttle":  # the trim sets the thrust itself
        assert (
            float(powered.linear["u"].sel(input="delta_e"))
            < float(off.linear["u"].sel(input="delta_e")) - 1e-4
        )
    assert value(plain, "L_D_max") > 1.0


def test_thrust_coefficient_over_speed_at_constant_thrust(plain_aircraft, plain_tree):
    """CL = 0.3 CT: CL_V = -2 CL/V in addition to what the tables have over Mach number."""
    db = plain_tree(CL={"": 0.25, "alpha": 5.2, "CT": 0.3})
    point = trimmed_at(plain_aircraft(), db, CONDITION)
    CT = point.thrust / (point["qbar"] * point.aircraft.S)
    assert point.variables["CT"] == pytest.approx(CT)
    slope = float(point.derivatives(["V"])["value"].sel(coefficient="CL", variable="V"))
    assert slope == pytest.approx(-2.0 * 0.3 * CT / V, rel=1e-6)
    assert point["CL"] == pytest.approx(float(point.coefficients()[0]), rel=1e-12)


@pytest.mark.nightly
def test_every_variable_of_the_simulation_may_be_in_a_term(plain_aircraft, plain_tree):
    """None of them ends in an internal error: characteristics, or one line that states why not."""
    craft = plain_aircraft()
    names = [
        entry.name
        for entry in catalogue.variable_rows(
            list(catalogue.stages_by_name(VARIABLE, submodels.submodel_items(craft))), craft
        )
    ]
    assert {"CT", "h_agl", "delta_s", "engine1.thrust", "CL"} <= set(names)
    for name in sorted(set(names) - {"alpha", "qhat", "delta_e", "Cm", "CX", "CZ"}):
        db = plain_tree(Cm={"": 0.03, "alpha": -0.8, "qhat": -15.0, "delta_e": -1.2, name: 1e-7})
        assert np.isfinite(trimmed_at(craft, db, CONDITION).coefficients()).all(), name


def test_speeds_without_a_steady_glide_are_blank(plain_aircraft, plain_tree):
    """The secant of the path angle runs away where the lift cannot carry the weight; the curve over
    speed has NaN there.
    """
    glider = flightmech.characteristics(
        plain_aircraft(engines=()), plain_tree(), {"V": 60.0, "h": 0.0}
    )
    assert np.isfinite(glider.trim["alpha"].values).any()
    with pytest.raises(
        SimulationError,
        match=r"no steady glide \(the aircraft file has no engines\) at .*accelerations",
    ):
        flightmech.characteristics(plain_aircraft(engines=()), plain_tree(), {"V": 5.0, "h": 0.0})


@pytest.mark.slow
@pytest.mark.parametrize("axes", ["wind", "body"])
def test_force_axes_of_the_database_do_not_matter(axes, plain_aircraft, plain_tree):
    """Symmetric flight: wind axes are stability axes; in body axes CX, CZ over alpha are the same
    forces at the nodes' slopes.
    """
    stability = flightmech.characteristics(plain_aircraft(), plain_tree(), CONDITION)
    tree = plain_tree()
    if axes == "wind":
        tree.attrs["force_axes"] = "wind"
    else:
        alpha = np.radians(np.linspace(-12.0, 24.0, 721))
        CL, CD = 0.25 + 5.2 * alpha, 0.025 + 1.4 * alpha**2
        leaves = {
            f"/{node.path.strip('/')}": node.to_dataset()
            for node in tree.leaves
            if node.path[1:3] not in ("CL", "CD")
        }
        leaves["/CX/basic"] = make_term(CL * np.sin(alpha) - CD * np.cos(alpha), {"alpha": alpha})
        leaves["/CZ/basic"] = make_term(-CL * np.cos(alpha) - CD * np.sin(alpha), {"alpha": alpha})
        tree = xr.DataTree.from_dict(leaves)
        tree.attrs["force_axes"] = "body"
    other = flightmech.characteristics(plain_aircraft(), tree, CONDITION)
    for quantity in (
        "neutral_point_fixed",
        "elevator_per_g",
        "manoeuvre_point_fixed",
        "L_D_max",
        "delta_r_per_beta",
    ):
        assert value(other, quantity) == pytest.approx(
            value(stability, quantity), rel=3e-3
        )  # tables of 0.05 degrees


def test_centre_of_gravity_moves_the_margins_and_not_the_points(plain_aircraft, plain_tree, found):
    aft = flightmech.characteristics(plain_aircraft(), plain_tree(), {**CONDITION, "x_cg_b": -0.1})
    assert value(aft, "static_margin_fixed") == pytest.approx(
        value(found, "static_margin_fixed") - 0.1 / 1.67, abs=2e-3
    )
    assert value(aft, "x_cg") == pytest.approx(0.25 + 0.1 / 1.67)


@pytest.mark.slow
def test_condition_in_any_speed(plain_aircraft, plain_tree):
    a = float(flightmech.air.atmosphere(H).a_sound)
    by_mach = flightmech.characteristics(plain_aircraft(), plain_tree(), {"mach": V / a, "h": H})
    assert f"V {V:.4g} m/s" in by_mach.condition
    with pytest.raises(SchemaError, match="holds V, mach; give one of V, mach, V_cas, V_eas"):
        flightmech.characteristics(plain_aircraft(), plain_tree(), {"V": 80.0, "mach": 0.3})
    with pytest.raises(SchemaError, match="V is -3; give a positive speed"):
        flightmech.characteristics(plain_aircraft(), plain_tree(), {"V": -3.0})
    with pytest.raises(SchemaError, match="h is nan; give a finite number"):
        flightmech.characteristics(plain_aircraft(), plain_tree(), {"V": 90.0, "h": float("nan")})
    with pytest.raises(UnknownName, match="unknown condition 'weight'"):
        flightmech.characteristics(plain_aircraft(), plain_tree(), {"V": 90.0, "weight": 3.0})


def test_a_speed_below_all_lift_is_refused(plain_aircraft, plain_tree):
    with pytest.raises(
        SimulationError,
        match=r"no steady flight at V 12 m s-1, h 0 m: accelerations of w_dot .* remain at alpha",
    ):
        flightmech.characteristics(plain_aircraft(), plain_tree(), {"V": 12.0, "h": 0.0})


def test_report_in_words(found):
    text = found.report()
    assert "neutral_point_fixed" in text
    assert "Dutch roll" in text
    assert "deg/s" in text
    assert found.derivatives["value"].sel(coefficient="Cm", variable="qhat") == pytest.approx(-14.0)


def test_speeds_that_cannot_be_trimmed_are_no_fault_of_the_search():
    """A table may be such that level flights between two speeds have no trim: the highest level
    speed is absent with the reason.
    """
    from flightmech.flying_qualities.climb import fastest_level_rows, find_zero

    row = fastest_level_rows(
        lambda V: 2.0 if V < 120.0 else np.nan if V < 150.0 else -1.0, 100.0, (40.0, 180.0)
    )[0]
    assert np.isnan(row.value)
    assert row.absent == "not every level flight from 100 to 180 m/s can be trimmed"
    assert fastest_level_rows(lambda V: 150.0 - V, 100.0, (40.0, 180.0))[0].value == pytest.approx(
        150.0
    )
    assert np.isnan(find_zero(lambda V: np.nan, 0.0, 1.0, 1e-3))
