"""Transonic data fairing; numbers typed from the corpus, at the lines named."""

import math

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, OK, SENTINEL

DEG = math.pi / 180.0
EXACT = 1e-12  # the same printed number through one multiplication


@pytest.fixture(scope="module")
def fairing(corpus):
    return corpus("ce500_transonic")[0].to_datatree()["fairing"].to_dataset()


def test_only_transonic_conditions_have_it(fairing):
    assert fairing["mach"].values.tolist() == [0.55, 0.62, 0.7, 0.8, 0.95, 1.1]
    assert (fairing["CDL_CL2_flag"].sel(configuration="wing") == OK).values.tolist() == [False] + [
        True
    ] * 5
    assert fairing["lines"].values.tolist()[:2] == ["", "765-812"]


def test_wing(fairing):
    wing = fairing.sel(configuration="wing").isel(condition=1)  # lines 765-768
    printed = {
        "CDL_CL2": 0.3008,
        "mach_break_unswept": 0.7870,
        "mach_break": 0.7883,
        "mach_a": 0.858,
        "mach_b": 0.928,
    }
    assert {name: float(wing[name]) for name in printed} == printed
    slopes = {
        "Cl_beta_CL": 0.1948e-02,
        "CL_alpha_a": 0.1071e-01,
        "CL_alpha_b": 0.6745e-01,
        "Cl_beta_CL_mach_06": 0.1944e-02,
    }
    for name, value in slopes.items():
        assert float(wing[name]) == pytest.approx(value / DEG, rel=EXACT)
        assert fairing[name].attrs["per"] == "radian"


def test_with_the_body(fairing):
    both = fairing.sel(configuration=["wing-body", "horizontal tail-body"]).isel(
        condition=1
    )  # lines 780 and 801
    np.testing.assert_allclose(
        both["Cl_beta_CL"], np.array([0.1616e-02, 0.8681e-03]) / DEG, rtol=EXACT
    )
    np.testing.assert_allclose(
        both["Cl_beta_CL_break"], np.array([0.9538e-03, 0.6641e-03]) / DEG, rtol=EXACT
    )
    np.testing.assert_allclose(
        both["CN_alpha_mach_14"], np.array([0.7074e-01, 0.1956e-01]) / DEG, rtol=EXACT
    )
    assert (both["CDL_CL2_flag"] == ABSENT).all()


def test_what_the_program_leaks_is_flagged(fairing):
    at = fairing["Cl_beta_CL_mach_14_flag"].isel(
        condition=1
    )  # lines 768, 780, 789, 801: 0.1000E-29
    assert at.values.tolist() == [SENTINEL] * 4
    assert fairing["Cl_beta_CL_mach_14"].isel(condition=1).isnull().all()


def test_tables(fairing):
    wing = fairing.sel(configuration="wing").isel(condition=1)  # lines 772-776
    assert wing["CL_alpha_mach"].values.tolist() == [0.62, 0.788, 0.858, 0.928, 1.4]
    np.testing.assert_allclose(
        wing["CL_alpha"],
        np.array([0.7287e-01, 0.7936e-01, 0.1071e-01, 0.6745e-01, 0.5785e-01]) / DEG,
        rtol=EXACT,
    )
    tail = fairing.sel(configuration="horizontal tail").isel(condition=1)  # line 797
    assert float(tail["CL_alpha"][4]) == pytest.approx(0.1789e-01 / DEG, rel=EXACT)
    assert (fairing["CL_alpha_flag"].sel(configuration="wing-body") == ABSENT).all()
    assert fairing["CD0_mach"].values[1].tolist() == [0.6, 0.7, 1.1, 1.4]  # lines 809-812
    assert fairing["CD0"].values[1].tolist() == [0.01702, 0.01738, 0.09313, 0.09939]
    assert float(fairing["mach_divergence"][1]) == 0.773  # line 807


def test_the_nodes_are_those_of_the_force_break(fairing):
    at = fairing.sel(configuration=["wing", "horizontal tail"]).isel(condition=slice(1, None))
    np.testing.assert_allclose(
        at["mach_a"], at["mach_break"] + 0.07, atol=0.0006
    )  # three decimals printed
    np.testing.assert_allclose(at["mach_b"], at["mach_break"] + 0.14, atol=0.0006)
    np.testing.assert_array_equal(at["CL_alpha"].isel(node=2), at["CL_alpha_a"])


def test_values_that_touch_their_labels(corpus):
    fairing = corpus("fighter_regimes")[0].to_datatree()["fairing"]
    at = fairing["Cl_beta_CL"].isel(condition=1)  # lines 1535, 1550, 1556, 1571
    np.testing.assert_allclose(
        at, np.array([-0.3694e-02, -0.9874e-02, -0.2512e-02, -0.8716e-02]) / DEG, rtol=EXACT
    )


def test_without_a_tail(corpus):
    fairing = corpus("spoilers_diff_tail")[0].to_datatree()["fairing"]
    assert fairing["configuration"].values.tolist() == ["wing", "wing-body"]
    assert fairing.sizes["drag_node"] == 0
    at = fairing["mach"].values.tolist().index(0.7)
    assert float(fairing["Cl_beta_CL_mach_14"].sel(configuration="wing")[at]) == pytest.approx(
        0.4567e-02 / DEG, rel=EXACT
    )  # line 281


def test_labels_that_hold_signs_of_equality(corpus):
    cells = corpus("ce500_transonic").cells()
    row = cells[(cells["line"] == 768) & (cells["column"] == "WING (CLB/CL)M=1.4")].iloc[0]
    assert row[["table", "text", "value", "flag", "mach"]].tolist() == [
        "fairing",
        "0.1000E-29",
        1e-30,
        "sentinel",
        0.62,
    ]
    node = cells[cells["line"] == 773]
    assert node[["table", "column", "text"]].values.tolist() == [
        ["slope_wing", "MACH", "0.788"],
        ["slope_wing", "CL-ALPHA", "0.7936E-01"],
    ]
    assert set(node["mach"]) == {0.62}  # of the page, not of the row


def test_tables_as_printed(corpus):
    frame = corpus("ce500_transonic")[0].block("drag_rise")
    assert frame.loc[:3, "CDO"].tolist() == [0.01702, 0.01738, 0.09313, 0.09939]
    assert frame["line"].tolist()[:4] == [809, 810, 811, 812]


@pytest.mark.parametrize(
    ("number", "old", "new", "lost"),
    [
        (764, "WING DATA", "WING DATUM", {765, 766, 767, 768, *range(772, 777)}),
        (766, "0.7870E+00", "0.7870EE00", {766, 767, 768, *range(772, 777)}),
        (773, "0.7936E-01", "0.7936 -01", {773, 774, 775, 776}),
        (807, "0.773", "O.773", {807, 809, 810, 811, 812}),
    ],
)
def test_damaged_lines_are_named(corpus_lines, corpus, number, old, new, lost):
    lines = list(corpus_lines("ce500_transonic"))
    assert old in lines[number - 1]
    lines[number - 1] = lines[number - 1].replace(old, new)
    listing = datcom_io.read(lines)
    assert lost <= set(listing.unread)
    assert set(corpus("ce500_transonic").cells()["line"]) - set(listing.cells()["line"]) == lost
