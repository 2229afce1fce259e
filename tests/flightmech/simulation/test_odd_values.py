"""Tests of values of a flight that no aeroplane has: mostly a number without its unit."""

import warnings

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.errors import AeromatchWarning, OutOfRange, SimulationError
from flightmech.simulation.stated_values.odd_values import (
    describe_bare_numbers,
    describe_odd_quantity,
    describe_odd_values,
    warn_of_odd_time,
)
from flightmech.steady_flight.stated_speeds.odd_speeds import describe_odd_speed
from flightmech.terms import evaluate_term, make_term

DEG = np.pi / 180.0


def make_model() -> tuple[flightmech.Aircraft, xr.DataTree]:
    """Return a light aircraft whose tables reach from Mach 0.1 to 0.2."""
    craft = flightmech.Aircraft(
        "Small", 16.0, 1.5, 11.0, 1000.0, 1500.0, 2000.0, 3000.0,
        engines=(Engine((0.0, 0.0, 0.0)),),
        limits={"delta_e": (-28.0 * DEG, 23.0 * DEG)},
    )  # fmt: skip
    alpha, mach = np.array([-8.0, 0.0, 12.0, 16.0]) * DEG, [0.1, 0.2]
    lift = [[-0.5, -0.5], [0.2, 0.2], [1.3, 1.3], [1.2, 1.2]]
    leaves = {
        "/CL/basic": make_term(lift, {"alpha": alpha, "mach": mach}),
        "/CD/basic": make_term(0.05),
        "/Cm/alpha": make_term(-0.8, regressors=["alpha"]),
        "/Cm/delta_e": make_term(-1.2, regressors=["delta_e"]),
        "/Cm/qhat": make_term(-12.0, regressors=["qhat"]),
        "/CY/beta": make_term(-0.5, regressors=["beta"]),
        "/Cl/delta_a": make_term(-0.1, regressors=["delta_a"]),
        "/Cl/phat": make_term(-0.4, regressors=["phat"]),
        "/Cn/beta": make_term(0.08, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.1, regressors=["rhat"]),
        "/Cn/delta_r": make_term(-0.06, regressors=["delta_r"]),
    }
    return craft, xr.DataTree.from_dict(leaves)


CRAFT, TREE = make_model()
SIM = flightmech.compile(CRAFT, TREE)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("init.theta", 5.0, "init.theta 5 rad (286.5 deg) is outside of -1.6 to 1.6 rad; is 5 deg"),
        ("phi", 30.0, "is 30 deg meant? write '30 deg'"),
        ("delta_f", 20.0, "is 20 deg meant? write '20 deg'"),
        ("q", 10.0, "is 10 deg/s meant?"),
        ("h", 50000.0, "is 50000 ft meant? write '50000 ft'"),
        ("env.qnh", 1013.0, "env.qnh 1013 Pa is outside of 85000 to 109000 Pa; is 1013 hPa meant?"),
        ("env.delta_T", 288.0, "outside of -80 to 80 K; a number without a unit is in K"),
        ("x_cg_b", 43.3, "is 43.3 in meant? write '43.3 in'"),
        ("theta", 0.1, ""),
        ("h", 12000.0, ""),
        ("mode.trim", 2.0, ""),
        # 130 deg of a power lever, 120 deg of a control wheel
        ("engine1.pla", 2.27, ""),
        ("wheel", 2.1, ""),
        ("engine1.pla", 90.0, "is 90 deg meant?"),
        # a hypersonic listing, and a speed in place of a Mach number
        ("mach", 12.0, ""),
        ("V", 3600.0, ""),
        ("mach", 60.0, "mach 60 is outside of 0 to 25"),
    ],
)
def test_a_quantity_without_its_unit(name: str, value: float, text: str) -> None:
    found = describe_odd_quantity(name, value)
    assert text in found
    assert bool(found) == bool(text)


def test_masses_and_inputs_are_judged_by_the_aircraft() -> None:
    odd = describe_odd_values(SIM, {"mass.mass": 9000.0, "delta_e": 5.0, "delta_r": 0.2})
    assert len(odd) == 2
    assert odd[0].startswith("mass 9000 kg is 9 times that of the aircraft file")
    assert "delta_e reaches 286.5 deg, its limit is 23 deg; a number or a column without" in odd[1]
    (slight,) = describe_odd_values(SIM, {}, {"delta_e": np.array([0.0, 25.0 * DEG])})
    assert "delta_e reaches 25 deg, its limit is 23 deg; the model flies with it" in slight
    assert describe_odd_values(SIM, {"mass.mass": 1100.0, "delta_e": 0.3, "init.V": 60.0}) == []


def test_a_speed_in_another_unit() -> None:
    fast = describe_odd_speed(SIM, {"init.V": 100.0, "init.h": 1500.0})
    assert "V 100 m/s (194.4 kt) is Mach 0.299, and the tables end at Mach 0.2" in fast
    assert fast.endswith('is 100 kt meant? write V = "100 kt"')
    slow = describe_odd_speed(SIM, {"V": 22.0, "h": 1500.0})
    assert "is below the stall: the greatest lift of the tables carries" in slow
    assert slow.endswith('is 42.76 m/s meant? write V = "42.76 m/s"')
    point = describe_odd_speed(SIM, {"mach": 1.5, "h": 1500.0})
    assert point.startswith("1.5 is Mach 1.5, and the tables end at Mach 0.2; check the decimal")
    assert describe_odd_speed(SIM, {"mach": 0.15, "h": 1500.0}) == ""
    # no unit makes a speed of it
    assert "meant" not in describe_odd_speed(SIM, {"V": 900.0, "h": 1500.0})
    for V in (35.0, 50.0, 60.0):
        assert describe_odd_speed(SIM, {"V": V, "h": 1500.0}) == ""


def test_every_way_into_the_model_names_them() -> None:
    start = {"init.V": 60.0, "init.h": 1000.0, "mode.engine": 2.0}
    inputs = xr.Dataset({"delta_e": ("time", [0.0, 5.0])}, {"time": [0.0, 0.02]})
    with pytest.warns(AeromatchWarning, match="delta_e reaches 286.5 deg"):
        flightmech.simulate(SIM, inputs, start)
    with pytest.warns(AeromatchWarning, match="is 5 deg meant"):
        flightmech.trim(SIM, {**start, "init.gamma": 5.0})
    with pytest.warns(AeromatchWarning, match="is 100 kt meant"):
        flightmech.trim(SIM, kind="level", V=100.0, h=1500.0)
    with pytest.warns(AeromatchWarning, match="is 30 deg meant"):
        flightmech.linearize(SIM, {**start, "init.psi": 30.0})
    with pytest.raises(SimulationError, match=r"V 20 m/s .* is below the stall"):
        flightmech.characteristics(CRAFT, TREE, {"V": 20.0, "h": 1500.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flightmech.trim(SIM, start)


def test_inputs_over_milliseconds_in_place_of_seconds() -> None:
    with pytest.warns(AeromatchWarning, match="last 5000 s in 4 samples, 2000 s apart; .*time .ms"):
        warn_of_odd_time(np.array([0.0, 1000.0, 3000.0, 5000.0]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # few breakpoints of a short run, a long record, and one sample
        for time in ([0.0, 100.0, 300.0], np.arange(0.0, 4000.0, 1.0), [0.0]):
            warn_of_odd_time(np.array(time))


def test_a_table_that_is_read_in_degrees() -> None:
    leaf = TREE["CL/basic"].to_dataset()
    with pytest.raises(OutOfRange, match="if 4 deg is meant, give '4 deg'"):
        evaluate_term(leaf, {"alpha": 4.0, "mach": 0.15})
    with pytest.raises(OutOfRange) as caught:
        evaluate_term(leaf, {"alpha": 0.0, "mach": 4.0})
    assert "deg" not in str(caught.value)


def test_the_units_of_bare_numbers() -> None:
    text = describe_bare_numbers({"V": 100.0, "mode.trim": 2.0, "init.h": 1500.0})
    assert text == "taken without a unit: V 100 m/s (194.4 kt), h 1500 m (4921 ft)"
    assert describe_bare_numbers({"mach": 0.2}) == ""
