"""Pages of card PART; numbers typed from t37_build.out (data/t37/datcom) and from the corpus, at
the lines named.
"""

import math
from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, BLANK, NA, NDM, OK, SENTINEL
from flightmech.errors import ParseError

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"
DEG = math.pi / 180.0
FOOT = 0.3048
EXACT = 1e-12  # the same printed number through one multiplication


@pytest.fixture(scope="module", params=[".out", ".pdas.out"])
def listing(request, t37):
    return t37(f"t37_build{request.param}")


@pytest.fixture(scope="module")
def tree(listing):
    return listing[0].to_datatree()


@pytest.fixture(scope="module")
def lines():
    return (DATA / "t37_build.out").read_text().split("\n")


def test_body(tree):
    body = tree["auxiliary"]
    assert body.attrs["configuration"] == "WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"
    first = body.isel(condition=0)  # line 1076
    assert float(first["area_wetted"]) == pytest.approx(273.5 * FOOT**2, rel=EXACT)
    assert float(first["area_base"]) == pytest.approx(5.3386 * FOOT**2, rel=EXACT)
    assert float(first["x_moment_centre"]) == pytest.approx(9.88 * FOOT, rel=EXACT)
    assert [float(first[name]) for name in ("CD0", "CD_base", "CD_friction")] == [
        0.6828e-02,
        0.2124e-02,
        0.4704e-02,
    ]
    assert int(first["CD_pressure_flag"]) == NA
    assert math.isnan(first["CD_pressure"])
    assert float(first["x_behind_mac"]) == pytest.approx(1.48 * FOOT, rel=EXACT)  # line 1079
    assert body["x_behind_mac"].attrs["units"] == "m"


def test_planform(tree):
    planform = tree["planform"]
    assert planform["surface"].values.tolist() == ["wing", "horizontal tail", "vertical tail"]
    assert planform["panel"].values.tolist() == ["total theoretical", "total exposed"]
    wing = planform.sel(surface="wing", panel="total exposed").isel(condition=0)  # line 1090
    printed = {"taper_ratio": 0.736, "aspect_ratio": 5.491, "CD0": 0.00696, "Cf": 0.00311}
    assert {name: float(wing[name]) for name in printed} == printed
    assert float(wing["area"]) == pytest.approx(154.5 * FOOT**2, rel=EXACT)
    assert [float(wing[name]) for name in ("mac", "x_c4_mac", "y_mac")] == pytest.approx(
        [5.35 * FOOT, 9.77 * FOOT, 9.26 * FOOT], rel=EXACT
    )
    assert float(
        planform["sweep_c4"].sel(surface="vertical tail", panel="total exposed")[0]
    ) == pytest.approx(28.0 * DEG, rel=EXACT)
    assert (planform["CD0_flag"].sel(panel="total theoretical") == BLANK).all()
    assert planform["area"].attrs["units"] == "m2"


def test_the_moment_centre_lies_where_the_planform_states(tree):
    wing = tree["planform"].to_dataset().sel(surface="wing", panel="total theoretical")
    leading_edge = wing["x_c4_mac"] - 0.25 * wing["mac"]
    behind = tree["auxiliary"]["x_moment_centre"] - leading_edge
    np.testing.assert_allclose(
        behind, tree["auxiliary"]["x_behind_mac"], atol=0.01 * FOOT
    )  # two decimals of a foot


def test_interference_is_per_degree_though_the_deck_states_radian(tree, listing):
    assert listing[0].deck.deriv == "RAD"
    found = tree["interference"]
    wing = found.sel(surface="wing").isel(condition=0)  # line 1111
    assert float(wing["CL_alpha_body"]) == pytest.approx(1.137e-02 / DEG, rel=EXACT)
    assert float(wing["CL_alpha_surface"]) == pytest.approx(6.571e-02 / DEG, rel=EXACT)
    assert [float(wing[name]) for name in ("K_body", "K_surface", "xac_body")] == [
        0.1923,
        1.111,
        0.2793,
    ]
    tail = found.sel(surface="horizontal tail").isel(condition=0)  # line 1112
    assert [float(tail[name]) for name in ("K_body", "K_surface", "xac_body")] == [
        0.01865,
        1.011,
        0.1899,
    ]
    assert found["sidewash"].values[0] == 0.96238351  # line 1113
    assert found["CL_alpha_surface"].attrs["per"] == "radian"
    static = tree["static"]["CL_alpha"].isel(condition=0)
    alone, together = (
        static.sel(configuration=name).isel(alpha=4) for name in ("DATCOM BODY ALONE", "WING-BODY")
    )
    parts = wing["CL_alpha_body"] + wing["CL_alpha_surface"] + alone
    # the static page, per radian, at alpha = -1 deg: a slope between two neighbours, so the linear
    # one is some per cent off
    assert float(parts) == pytest.approx(float(together), rel=0.05)


def test_vortices(tree):
    vortex = tree["vortex"].isel(condition=0)
    assert vortex["i_wing_tail"].values[[0, 5, 18]].tolist() == [
        -0.9202,
        -0.9976,
        -1.069,
    ]  # lines 1119, 1124, 1137
    assert vortex["i_body_tail"].values[15] == -0.03554  # line 1134
    assert vortex["gamma_flag"].values.tolist() == [NDM] * 2 + [OK] * 9 + [NDM] * 8
    assert vortex["gamma_tail"].values[18] == 0.6360
    assert vortex["alpha"].values[0] == pytest.approx(-8.0 * DEG, rel=EXACT)


def test_increments(tree):
    first = tree["increments"].isel(condition=0)
    assert float(first["Cl_phat"]) == -0.40918  # line 1141, per radian whatever DERIV is
    assert float(first["Cl_phat_ratio_dihedral"]) == 1.0
    assert float(first["Cn_phat_twist"]) == pytest.approx(-1.6819e-04 / DEG, rel=EXACT)
    assert float(first["CY_phat_CL"]) == -3.3606e-02  # line 1142
    assert float(first["Cl_beta_dihedral"]) == pytest.approx(
        -0.2143e-03 / DEG**2, rel=EXACT
    )  # line 1145
    assert float(first["Cm0_twist_wing"]) == 0.0
    assert int(first["Cm0_twist_tail_flag"]) == NA


def test_the_label_of_side_force_due_to_dihedral_pretends_a_division(tree):
    increments = tree["increments"]
    dihedral = 3.0 * DEG  # DHDADI of the deck; the wing lies at the height of the moment centre
    wanted = (
        3.0 * math.sin(dihedral) * increments["Cl_phat"]
    )  # the DATCOM method for the increment itself
    np.testing.assert_allclose(increments["dCY_phat_dihedral"], wanted, rtol=1e-4)  # five digits


def test_cells(listing):
    cells = listing.cells()
    of_wing = cells[cells["column"] == "WING TOTAL EXPOSED AREA"]
    assert len(of_wing) == 4
    assert of_wing.iloc[0][["table", "text", "value", "flag", "mach"]].tolist() == [
        "planform",
        "0.1545E+03",
        154.5,
        "ok",
        0.2,
    ]
    sidewash = cells[cells["column"] == "SIDEWASH, (1 + D(SIGMA)/D(BETA))QV/Q"]
    assert sidewash["text"].tolist()[0] == "9.6238351E-01"
    roll = cells[cells["column"] == "CLP(GAMMA=CL=0)"]
    assert roll["value"].tolist()[0] == -0.40918  # touches its label


def test_block_of_numbers_with_labels(listing):
    frame = listing[0].block("interference")
    assert frame.columns.tolist()[:6] == [
        "line",
        "configuration",
        "mach",
        "altitude",
        "ground_height",
        "flap",
    ]
    assert frame.loc[2, ["label", "text", "value", "mach"]].tolist() == [
        "K-B(W)",
        "1.923E-01",
        0.1923,
        0.2,
    ]
    assert len(frame) == 4 * 11
    body = listing[0].block("body")
    assert body.attrs["units"]["WETTED AREA"] == "ft2"
    assert body["WETTED AREA"].tolist() == [273.5] * 4


def test_panels_of_a_cranked_wing(corpus):
    case = corpus("cranked_wing_ndm")[0]
    planform = case.to_datatree()["planform"].isel(condition=0)
    assert planform["panel"].values.tolist() == [
        "theoretical inboard",
        "exposed inboard",
        "outboard",
        "total theoretical",
        "total exposed",
    ]
    wing = planform.sel(surface="wing")
    assert wing["area"].values.tolist() == [14.38, 9.325, 13.86, 28.24, 23.19]  # lines 690-698
    assert wing["Cf"].values[[1, 2]].tolist() == [0.00267, 0.00286]
    assert wing["Cf_flag"].values.tolist() == [BLANK, OK, OK, BLANK, NA]
    assert (planform["area_flag"].sel(surface="vertical tail")[:3] == ABSENT).all()
    outboard = 2.0 * case.deck.value("WGPLNF", "SSPNOP")
    assert float(wing["aspect_ratio"][2]) == pytest.approx(
        outboard**2 / 13.86, rel=1e-3
    )  # four digits


def test_aspect_ratio_of_an_inboard_panel_in_metres_is_reported_and_kept(corpus):
    case = corpus("cranked_wing_ndm")[0]
    span = 2.0 * (case.deck.value("WGPLNF", "SSPN") - case.deck.value("WGPLNF", "SSPNOP"))
    printed = float(case.to_datatree()["planform"]["aspect_ratio"][0, 0, 0])
    assert printed == 18.41
    assert printed == pytest.approx(
        (span / FOOT) ** 2 / 14.38, rel=1e-3
    )  # feet squared over square metres
    reported = [
        message
        for message in case.messages
        if message.text.startswith("aspect ratio 0.1841E+02 of the theoretical inboard panel")
    ]
    assert [(message.line, message.origin) for message in reported] == [(690, "reader")]


def test_sentinels_are_no_numbers(corpus):
    interference = corpus("cranked_wing_ndm")[0].to_datatree()["interference"]
    assert interference["K_body_flag"].values.tolist() == [
        [OK, SENTINEL]
    ]  # line 719: K-B(H)= 1.000E-30
    assert np.isnan(interference["K_body"].values[0, 1])
    increments = corpus("fighter_regimes")[0].to_datatree()["increments"]
    assert increments["Cl_phat_flag"].values.tolist() == [
        OK,
        ABSENT,
        ABSENT,
        SENTINEL,
        SENTINEL,
    ]  # transonic pages have none


def test_a_transonic_page_has_no_vortices(corpus):
    tree = corpus("fighter_regimes")[0].to_datatree()
    assert (tree["vortex"]["gamma_flag"] == ABSENT).all("alpha").values.tolist() == [
        False,
        True,
        True,
        False,
        False,
    ]
    assert tree["interference"].sizes["condition"] == 5


CANARD = [
    *["", "", ""],
    f"{'CANARD EFFECTIVE DOWNWASH':>80}",
    f"{'ALPHA      (EPSOLN)EFF.     D(EPSOLN)/D(ALPHA) EFF.':>98}",
]


def canard_row(alpha, epsilon, slope):
    """Write a row as the program's FORMAT does: no listing of the corpus has this table."""
    return f"{alpha:52.3f}{epsilon:>18}{slope:>18}"


def test_effective_downwash_of_a_canard(lines):
    alphas = [-8, -6, -4, -2, -1, 0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20]
    rows = [
        canard_row(alpha, "  NDM      " if alpha < -6 else f"{0.25 * alpha:.4E}", "0.2500E+00")
        for alpha in alphas
    ]
    listing = datcom_io.read([*lines[:1145], *CANARD, *rows, *lines[1145:]])
    assert listing.unread == []
    found = listing[0].to_datatree()["canard_downwash"]
    assert float(found["epsilon_effective"][0, 4]) == pytest.approx(-0.25 * DEG, rel=EXACT)
    assert found["epsilon_effective_flag"].values[:, 0].tolist() == [NDM, ABSENT, ABSENT, ABSENT]
    assert float(found["epsilon_alpha_effective"][0, 0]) == 0.25
    assert str(found["lines"].values[0]) == "1151-1169"


def test_pages_repeated_for_ground_heights_count_once(lines):
    first, end = 1061, 1147  # both auxiliary pages of the first condition
    assert "AUXILIARY" in lines[first + 1]
    case = datcom_io.read(lines[:end] + lines[first:end] + lines[end:])[0]
    assert len(list(case.tables("vortex"))) == 5
    tree = case.to_datatree()
    assert tree["vortex"]["lines"].values.tolist()[0] == "1119-1137"
    assert tree["planform"].sizes["condition"] == 4


@pytest.mark.slow
def test_a_printer_filter_puts_label_and_numbers_into_one_line(lines):
    joined = list(lines)
    joined[1088:1090] = [lines[1088].ljust(20)[:20] + lines[1089][20:]]
    plain, other = (datcom_io.read(text)[0].to_datatree()["planform"] for text in (lines, joined))
    np.testing.assert_array_equal(other["area"], plain["area"])


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("number", "old", "new", "lost"),
    [
        (1076, "0.2735E+03", "0.2735E*03", {1076}),
        (1079, "MAC=   1.48", "MAC=", {1079}),
        (1086, "WING", "WINGS", {1088, 1090}),
        (1089, "TOTAL EXPOSED", "TOTAL EXPOSE", {1090}),
        (1090, "0.1545E+03", "0.1545 +03", {1090}),
        (1111, "CLA-W(B)= 6.571E-02", "CLA-W(B)= 6.571-E02", {1111}),
        (1111, "     K-B(W)", "   K-B(W)", {1111}),
        (1113, " 9.6238351E-01", "9_6238351E-01", {1113}),
        (1118, "2*PI", "3*PI", set(range(1119, 1138))),
        (1141, "CLP(GAMMA=CL=0)", "CLP(GAMMA=CL=1)", {1141}),
        (1145, "-0.2143E-03", "-0.2143 E-03", {1145}),
    ],
)
def test_a_damaged_line_is_named_and_takes_no_other_along(lines, number, old, new, lost):
    damaged = list(lines)
    assert old in damaged[number - 1]
    damaged[number - 1] = damaged[number - 1].replace(old, new)
    listing = datcom_io.read(damaged)
    assert number in listing.unread
    assert set(datcom_io.read(lines).cells()["line"]) - set(listing.cells()["line"]) == lost


def test_a_lost_row_of_the_vortex_table(lines):
    with pytest.raises(ParseError, match="found 18 rows in the vortex table; expected 19 rows"):
        datcom_io.read(lines[:1124] + lines[1125:])


def test_a_page_without_flight_conditions(lines):
    damaged = list(lines)
    damaged[1109] = damaged[1109].replace("223.27", "2#3.27")
    with pytest.raises(ParseError, match="no flight-condition line that can be read"):
        datcom_io.read(damaged)
    tree = datcom_io.read(damaged, partial=True)[0].to_datatree()
    assert (tree["interference"]["K_body_flag"] == ABSENT).all("surface").values.tolist() == [
        True,
        False,
        False,
        False,
    ]


def test_lengths_follow_the_units_of_the_page(lines):
    units = (
        "             FT       FT/SEC     LB/FT**2       DEG R         1/FT               "
        "FT**2        FT        FT        FT        FT"
    )
    inches = units.replace("FT", "IN").replace("1/IN", "1/FT")
    tree = datcom_io.read([inches if line == units else line for line in lines])[0].to_datatree()
    assert float(tree["auxiliary"]["area_wetted"][0]) == pytest.approx(273.5 * 0.0254**2, rel=EXACT)
    assert float(tree["planform"]["mac"][0, 0, 0]) == pytest.approx(5.49 * 0.0254, rel=EXACT)
