"""The scheme of LR-743 against the equations of the report, and leaves made by it."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as group
from aerodb.prior.prior_errors import PRIOR_ERRORS
from aerodb.store.templates import lr743, make, scheme_table
from flightmech import terms
from flightmech.errors import SchemaError, UnknownName

# every symbol of the right-hand sides of LR-743 eq. (2) to (11): term, K, axes of the report,
# regressors
EQUATIONS = {
    "(2)": [("altitude", "", "mach h", "alpha"), ("flap", "", "alpha delta_f", "")],
    "(3)": [("basic", "", "alpha mach", "")],
    "(4)": [
        ("elevator", "", "alpha mach", "delta_e"),
        ("elevator_flap", "", "alpha delta_f", "delta_e"),
        ("elevator_altitude", "", "mach h", "delta_e"),
        ("elevator_deflection", "", "delta_e", "delta_e"),
    ],
    "(5)": [("tab", "", "alpha mach", "delta_t")],
    "(6)": [("qhat", "x_cg", "mach h", "qhat"), ("qhat_flap", "x_cg", "mach delta_f", "qhat")],
    "(7)": [
        ("alphadothat", "x_cg", "mach h", "alphadothat"),
        ("alphadothat_flap", "x_cg", "mach delta_f", "alphadothat"),
    ],
    "(8)": [("load_factor", "", "mach h", "dnz"), ("load_factor_flap", "", "mach delta_f", "dnz")],
    "(9)": [
        ("speedbrake", "speedbrake", "alpha mach", ""),
        ("speedbrake_flap", "speedbrake", "alpha delta_f", ""),
    ],
    "(10)": [("gear", "gear", "alpha delta_f", ""), ("gear_mach", "gear", "alpha", "mach")],
    "(11)": [
        ("ground", "h_agl", "alpha delta_f", ""),
        ("ground_alphadothat", "h_agl", "delta_f", "alphadothat"),
        ("ground_elevator", "h_agl", "alpha delta_f", "delta_e"),
    ],
}


@pytest.mark.parametrize("equation", EQUATIONS)
def test_every_symbol_of_the_equations_has_its_term(equation):
    scheme = lr743()
    for name, K1, axes, regressors in EQUATIONS[equation]:
        for coefficient in ("CL", "CD", "Cm"):
            slot = scheme[f"{coefficient}/{name}"]
            assert slot.equation == (equation if coefficient == "CL" else f"like {equation}")
            assert slot.K1 == K1
            assert set(axes.split()) <= set(slot.axes)
            assert slot.regressors == tuple(regressors.split())


def test_what_could_not_be_identified_is_reported_as_in_4_5():
    scheme = lr743()
    gone = {name for name, slot in scheme.items() if "could not be identified" in slot.identified}
    assert gone == {
        f"CL/{name}"
        for name in (
            "elevator_altitude",
            "elevator_deflection",
            "tab",
            "qhat_flap",
            "load_factor",
            "load_factor_flap",
            "speedbrake_flap",
        )
    }
    assert scheme["CL/gear_mach"].identified == "deleted"
    assert scheme["CL/qhat_gear"].identified == "added"
    assert "embedded in the pitch-rate term" in scheme["CL/alphadothat"].identified


@pytest.mark.nightly
def test_the_empty_slot_of_every_term_is_a_sound_leaf():
    for name, slot in lr743().items():
        axes = {axis: [0.0, 0.1] for axis in slot.axes}
        K1 = {slot.K1: ([0.0, 1.0], [0.0, 1.0])} if slot.K1 else None
        leaf = make(name, axes, K1=K1)
        assert terms.check_term(leaf) == [], name
        assert set(leaf["value"].dims) == set(slot.axes)
        assert terms.list_regressors(leaf) == slot.regressors


def test_the_kernel_knows_the_variables_of_the_build_up():
    from flightmech.simulation.kernel import VARIABLE, computable_names

    flown = {name.pattern for name in computable_names(VARIABLE) if not name.group}
    assert not [
        name
        for name, slot in lr743().items()
        if not {*slot.axes, *slot.regressors, *filter(None, [slot.K1])} <= flown
    ]


def test_an_extension_multiplies_where_no_factor_is_given():
    gear = make("CL/gear", {"alpha": [0.0, 0.2]}, value=[0.01, 0.02])
    assert terms.list_regressors(gear) == ("gear",)
    np.testing.assert_allclose(terms.evaluate_term(gear, {"alpha": 0.1, "gear": 0.5}), 0.0075)
    curved = make(
        "CL/gear",
        {"alpha": [0.0, 0.2]},
        value=[0.01, 0.02],
        K1={"gear": ([0.0, 0.5, 1.0], [0.0, 0.8, 1.0])},
    )
    assert terms.list_regressors(curved) == ()
    np.testing.assert_allclose(terms.evaluate_term(curved, {"alpha": 0.1, "gear": 0.5}), 0.012)
    with_mach = make("CL/gear_mach", {"alpha": [0.0, 0.2]}, value=0.1)
    assert terms.list_regressors(with_mach) == ("mach", "gear")


def test_a_control_may_be_an_axis_instead_of_a_factor():
    slope = make("Cm/elevator", {"mach": [0.2, 0.6]}, value=[-1.5, -1.4])
    assert terms.list_regressors(slope) == ("delta_e",)
    table = make("Cm/elevator", {"delta_e": [-0.3, 0.0, 0.3]}, value=[0.4, 0.0, -0.4])
    assert terms.list_regressors(table) == ()
    both = make("CL/elevator_deflection", {"delta_e": [-0.3, 0.0, 0.3]}, value=[-0.1, 0.0, -0.1])
    assert terms.list_regressors(both) == ("delta_e",)  # the axis is the report's own here


def test_wrong_axes_are_errors():
    with pytest.raises(
        SchemaError,
        match=r"CL/gear(.|\n)*the axis mach does not belong here; allowed: alpha, delta_f, gear",
    ):
        make("CL/gear", {"mach": [0.2, 0.4]})
    with pytest.raises(SchemaError, match="K1 over x_cg does not belong here; it goes over gear"):
        make("CL/gear", {}, K1={"x_cg": ([0.2, 0.3], [1.0, 1.1])})
    with pytest.raises(
        SchemaError, match="K1 over gear does not belong here; the term has no factor"
    ):
        make("CL/basic", {}, K1={"gear": ([0.0, 1.0], [0.0, 1.0])})
    with pytest.raises(SchemaError, match="gear is an axis of K1 and of the table"):
        make("CL/gear", {"gear": [0.0, 1.0]}, K1={"gear": ([0.0, 1.0], [0.0, 1.0])})
    with pytest.raises(SchemaError, match="is not a pair of breakpoints and as many factors"):
        make("CL/gear", {}, K1={"gear": ([0.0, 1.0], [0.0])})
    with pytest.raises(
        SchemaError,
        match="does not depend on height; give K1 over h_agl, h_agl among the breakpoints, or a "
        "power "
        "of it",
    ):
        make("CL/ground", {"alpha": [0.0, 0.2]})
    with pytest.raises(
        SchemaError, match=r"value has the shape \(3,\), the breakpoints alpha have \(2,\)"
    ):
        make("CL/basic", {"alpha": [0.0, 0.2]}, value=[1.0, 2.0, 3.0])
    with pytest.raises(UnknownName, match="unknown term 'CL/gaer'; near it: CL/gear"):
        make("CL/gaer")


def test_the_page_of_terms_has_every_term_in_the_order_of_the_scheme():
    script = Path(__file__).parents[3] / "docs" / "scripts" / "make_terms.py"
    scheme, errors = runpy.run_path(str(script))["page"]().split("\n## Standard errors")
    rows = [line for line in scheme.splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == list(lr743())
    assert {row.count(" | ") for row in rows} == {7}
    assert "| `Cm/qhat` | 25% | 0 | x 2 | x 1.5 |" in errors
    assert errors.count("\n| `") == len(PRIOR_ERRORS)


def test_the_scheme_as_a_table_and_on_the_command_line():
    frame = scheme_table()
    assert list(frame.index) == list(aerodb.store.templates.lr743())
    assert (
        frame.loc["Cl/ground", "identified"]
        == "Cl = k h^s CL phi, k -0.078, s -1.09 at 40 deg of flap (Table 2)"
    )
    assert frame.loc["CD/elevator", "from_datcom"] == "SYMFLP on the tail, D(CD MIN) + D(CDI)"
    assert frame.loc["CY/rhat", "from_datcom"] == "no method"
    shown = CliRunner().invoke(group, ["scheme", "CL"])
    assert shown.exit_code == 0
    assert len(shown.output.splitlines()) == 1 + sum(name.startswith("CL/") for name in frame.index)
    assert "CL/load_factor_flap" in shown.output
    wrong = CliRunner().invoke(group, ["scheme", "CX"])
    assert isinstance(wrong.exception, UnknownName)
