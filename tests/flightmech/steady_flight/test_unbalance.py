"""Flights that a database cannot balance: one threshold, a bank in place of a rudder, the term."""

import re
from pathlib import Path

import pytest

from flightmech.errors import SimulationError
from flightmech.steady_flight.trim_findings import TRIMMED
from flightmech.steady_flight.trim_point import trimmed_at

LEVEL = {"V": 90.0, "h": 1500.0}
KERNEL = Path(__file__).parents[3] / "kernel" / "src" / "trim" / "trim_residual.h"


def without(tree, control: str, coefficients: tuple[str, ...] = ("CY", "Cl", "Cm", "Cn", "CL")):
    """Return a database without the terms of a control."""
    for coefficient in coefficients:
        for name, leaf in list(tree[coefficient].children.items()):
            if control in str(leaf.attrs.get("regressors", "")).split():
                del tree[coefficient][name]
    return tree


@pytest.fixture
def rudderless(plain_tree):
    return without(plain_tree(), "delta_r")


def test_kernel_and_package_have_the_same_threshold():
    assert float(re.search(r"#define TRIMMED (\S+)", KERNEL.read_text())[1]) == TRIMMED


def test_a_bank_balances_a_yawing_moment_without_a_rudder(plain_aircraft, rudderless):
    point = trimmed_at(plain_aircraft(), rudderless, {**LEVEL, "bias.Cn": 1e-3})
    assert max(abs(point[f"trim.{letter}_dot"]) for letter in "uvwpqr") < 1e-9
    assert abs(point["phi"]) > 1e-3
    (remark,) = point.remarks
    assert "no term of the rudder, such as Cn/rudder: a bank of" in remark


def test_a_bank_of_a_flight_with_a_rudder_blames_no_missing_term(plain_aircraft, plain_tree):
    banked = {**LEVEL, "bias.Cn": 1e-3, "init.phi_range": 0.05}
    point = trimmed_at(plain_aircraft(), plain_tree(), banked)
    assert point.compiled.missing_terms == {}
    (remark,) = point.remarks
    assert re.fullmatch(r"a bank of -?\d\.\d\d deg balances the flight", remark)


def test_a_flight_with_level_wings_names_axis_and_term(plain_aircraft, rudderless):
    with pytest.raises(SimulationError, match=r"v_dot .* m/s2, .*r_dot .* rad/s2 remain") as error:
        trimmed_at(plain_aircraft(), rudderless, {**LEVEL, "bias.Cn": 1e-3, "phi": 0.0})
    assert "no term of delta_r that balances v_dot and r_dot, such as Cn/rudder" in str(error.value)


def test_an_unbalance_below_the_threshold_is_a_remark(plain_aircraft, rudderless):
    held = {**LEVEL, "phi": 0.0}
    point = trimmed_at(plain_aircraft(), rudderless, {**held, "bias.Cn": 1e-6})
    (remark,) = point.remarks
    assert re.fullmatch(r"trimmed to 0.0003 m/s2; accelerations of .*v_dot .* remain", remark)
    assert trimmed_at(plain_aircraft(), rudderless, held).remarks == []


def test_the_missing_term_of_the_elevator_is_named(plain_aircraft, plain_tree):
    with pytest.raises(SimulationError, match=r"delta_e that balances q_dot, such as Cm/elevator"):
        trimmed_at(plain_aircraft(), without(plain_tree(), "delta_e"), LEVEL)
