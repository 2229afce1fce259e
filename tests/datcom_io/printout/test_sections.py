"""Airfoil sections; numbers typed from t37_build.out (data/t37/datcom) and from the corpus, at the
lines named.
"""

import math
from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, OK
from flightmech.errors import ParseError, SchemaError

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"
DEG = math.pi / 180.0
EXACT = 1e-12  # the same printed number through one multiplication


@pytest.fixture(scope="module", params=[".out", ".pdas.out"])
def tree(request, t37):
    """Both builds of the program; the second one prints five lines less before the pages."""
    return t37(f"t37_build{request.param}")[0].to_datatree()


@pytest.fixture(scope="module")
def lines():
    return (DATA / "t37_build.out").read_text().split("\n")


def test_summary(tree):
    section = tree["section"]
    assert section["surface"].values.tolist() == ["wing", "horizontal tail", "vertical tail"]
    wing = section.sel(surface="wing")  # lines 165-179
    angles = {"alpha_ideal": 0.25757, "alpha_zero_lift": -1.83645}
    for name, value in angles.items():
        assert float(wing[name]) == pytest.approx(value * DEG, rel=EXACT)
        assert section[name].attrs["units"] == "rad"
    plain = {
        "CL_ideal": 0.25602,
        "Cm_zero_lift": -0.05027,
        "leading_edge_radius": 0.02479,
        "thickness_ratio": 0.15,
    }
    assert {name: float(wing[name]) for name in plain} == plain
    assert float(wing["CL_alpha_mach_zero"]) == pytest.approx(0.09358 / DEG, rel=EXACT)
    assert float(wing["delta_y"]) == pytest.approx(
        0.0396122, rel=EXACT
    )  # per cent of the chord in the print
    assert section["CL_alpha_mach_zero"].attrs["per"] == "radian"
    assert (section["mach_crest_flag"] == ABSENT).all()


def test_slope_and_aerodynamic_centre_per_mach(tree):
    section = tree["section"]
    assert section["CL_alpha"].dims == ("surface", "mach")
    assert section["mach"].values.tolist() == [0.2, 0.4]
    np.testing.assert_allclose(
        section["CL_alpha"].sel(surface="wing"), np.array([0.09505, 0.10018]) / DEG, rtol=EXACT
    )  # lines 182, 183
    assert section["xac"].sel(surface="wing").values.tolist() == [0.26056, 0.26230]
    assert "condition" not in section.dims


def test_coordinates(tree):
    points = tree["coordinates"]
    assert points["designation"].values.tolist() == ["NACA 2415", "NACA 0010", "NACA 0012"]
    assert points.sizes["point"] == 60
    at = points.sel(surface="wing").isel(point=1)  # line 104
    printed = {
        "x_upper": 0.00031,
        "z_upper": 0.00701,
        "x_lower": 0.00169,
        "z_lower": -0.00681,
        "x": 0.00100,
        "mean_line": 0.00010,
        "thickness": 0.01389,
    }
    assert {name: float(at[name]) for name in printed} == printed
    wanted = {"t37_build.out": "103-162", "t37_build.pdas.out": "98-157"}
    assert str(points["lines"].sel(surface="wing").values) == wanted[points.attrs["file"]]
    assert (points["x_flag"] == OK).all()


def test_upper_and_lower_surface_lie_about_the_mean_line(tree):
    points = tree["coordinates"]
    half = 2 * 0.5e-5  # both ordinates are rounded to five decimals
    np.testing.assert_allclose(
        (points["z_upper"] + points["z_lower"]) / 2, points["mean_line"], atol=half
    )
    np.testing.assert_allclose(
        points["thickness"].max("point"), tree["section"]["thickness_ratio"], atol=0.005
    )  # between two stations


def test_above_the_crest_critical_mach_number(corpus):
    section = corpus("ce500_transonic")[0].to_datatree()["section"].sel(surface="wing")
    assert section["mach"].values.tolist() == [0.55, 0.62, 0.7, 0.8, 0.95, 1.1]
    assert section["CL_alpha_flag"].values.tolist() == [OK, OK] + [ABSENT] * 4
    assert float(section["mach_crest"]) == 0.69060  # line 184
    assert float(section["x_crest"]) == 0.26015
    assert float(section["CL_alpha_crest"]) == pytest.approx(0.09787 / DEG, rel=EXACT)  # line 188


def test_designations(corpus):
    points = corpus("fighter_regimes")[0].to_datatree()["coordinates"]
    assert points["designation"].values.tolist() == [
        "NACA 64A005",
        "NACA S-3-50.0-05.0-00.0",
        "NACA 64A005",
    ]
    cells = corpus("fighter_regimes").cells()
    cell = cells[cells["table"] == "designation"].iloc[1]
    assert cell[["line", "column", "text", "flag"]].tolist() == [
        184,
        "DESIGNATION",
        "NACA S-3-50.0-05.0-00.0",
        "ok",
    ]
    assert math.isnan(cell["value"])


def test_cells_and_block(t37):
    listing = t37("t37_build.out")
    cells = listing.cells()
    slope = cells[cells["line"] == 182]
    assert slope[["column", "text", "mach_node"]].values.tolist() == [
        ["MACH", "0.2000", 0.2],
        ["LIFT-CURVE-SLOPE", "0.09505", 0.2],
        ["XAC", "0.26056", 0.2],
    ]
    frame = listing[0].block("coordinates")
    assert len(frame) == 180
    assert frame.loc[1, ["line", "UPPER ORDINATE", "THICKNESS"]].tolist() == [104, 0.00701, 0.01389]


def test_velocity_instead_of_mach(corpus):
    second = corpus("speed_input")[1].to_datatree()["section"]
    assert second["mach"].values.tolist() == [0.3]


def test_a_section_that_the_user_defines(lines):
    changed = list(lines)
    changed[99:101] = [
        "                                                        USER DEFINED WING SECTION"
    ]  # no designation
    listing = datcom_io.read(changed)
    assert listing.unread == []
    assert [page.kind for page in listing.pages[:3]] == ["section"] * 3
    points = listing[0].to_datatree()["coordinates"]
    assert points["designation"].values.tolist() == ["", "NACA 0010", "NACA 0012"]
    assert float(points["thickness"][0, 1]) == 0.01389


def test_fewer_points_on_one_surface(lines):
    points = datcom_io.read(lines[:140] + lines[150:])[0].to_datatree()["coordinates"]
    assert (points["x_flag"] == ABSENT).sum("point").values.tolist() == [10, 0, 0]


def test_a_mean_line_in_a_line_of_its_own(lines):
    changed = [*lines[:101], f"{'A=0.5':>70}", *lines[101:]]
    changed[100] = f"{'NACA 65-415':>73}"
    listing = datcom_io.read(changed)
    assert listing.unread == []
    assert listing[0].to_datatree()["coordinates"]["designation"].values[0] == "NACA 65-415 0.5"
    cells = listing.cells()
    assert cells[cells["line"] == 102][["column", "text", "value"]].values.tolist() == [
        ["A", "0.5", 0.5]
    ]


def test_messages_of_the_section_module(lines):
    texts = [
        "0**** REYNOLDS NUMBER TOO LOW FOR THE AIRFOIL SECTION MODULE, SECTION "
        "CHARACTERISTICS BASED ON A VALUE OF 2.718E5 ***",
        "      AIRFOIL MODULE UNABLE TO CALCULATE SECTION CLALPA FOR MACH NO =   0.300  "
        "THEREFORE A VALUE MUST BE SPECIFIED BY THE USER.",
        "      SEE USERS MANUAL FOR SECTION CHARACTERISTICS INPUT.",
    ]
    listing = datcom_io.read([*lines[:182], *texts, *lines[182:]])
    assert listing.unread == []
    reported = [message.text for message in listing.messages if message.line in (183, 184)]
    assert reported[0].startswith("**** REYNOLDS NUMBER TOO LOW")
    assert reported[1].endswith(
        "SPECIFIED BY THE USER. SEE USERS MANUAL FOR SECTION CHARACTERISTICS INPUT."
    )
    assert listing[0].to_datatree()["section"]["CL_alpha"].sizes["mach"] == 2


def test_a_mach_number_that_is_not_in_the_cards(lines):
    changed = [line.replace("MACH= 0.4000 LIFT", "MACH= 0.3000 LIFT") for line in lines]
    with pytest.raises(
        ParseError,
        match=r"line 183: found MACH = 0\.3; expected one of the Mach numbers of the input cards",
    ):
        datcom_io.read(changed)[0].to_datatree()


def test_a_mach_number_that_comes_twice_keeps_both_places(lines):
    changed = [
        line.replace("MACH(1)=0.2,0.4", "MACH(1)=0.2,0.2").replace(
            "MACH= 0.4000 LIFT", "MACH= 0.2000 LIFT"
        )
        for line in lines
    ]
    assert sum("MACH(1)=0.2,0.2" in line for line in changed) == 2
    section = datcom_io.read(changed)[0].to_datatree()[
        "section"
    ]  # another Reynolds number gives another slope
    assert section["mach"].values.tolist() == [0.2, 0.2]
    assert section["xac"].sel(surface="wing").values.tolist() == [0.26056, 0.26230]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "old", "new"),
    [
        (167, "-1.83645", "-1.83 45"),
        (182, "XAC =   0.26056", "XAC =   0.26O56"),
        (182, "/DEG.", "/RAD."),
        (101, "NACA", "NOCA"),
        (179, "DELTA-Y", "DELTA-Z"),
    ],
)
def test_damaged_lines_are_named(lines, number, old, new):
    damaged = list(lines)
    assert old in damaged[number - 1]
    damaged[number - 1] = damaged[number - 1].replace(old, new)
    listing = datcom_io.read(damaged)
    assert listing.unread == [number]
    assert number not in set(listing.cells()["line"])


def test_a_surface_whose_summary_comes_twice(lines):
    page = lines[162:183]
    with pytest.raises(
        ParseError, match="a second IDEAL ANGLE OF ATTACK for the place of an earlier one"
    ):
        datcom_io.read([*lines[:183], *page, *lines[183:]])[0].to_datatree()


def test_joined_runs(t37):
    listing = t37("t37_elevator_one_by_one.pdas.out")
    section = datcom_io.join(case.to_datatree() for case in listing)["section"]
    assert section["mach"].values.tolist() == [0.15, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert section["case"].values.tolist() == listing.case_names
    assert section["alpha_zero_lift"].dims == ("surface",)
    assert len(set(section["lines"].sel(surface="wing").values.tolist())) == 6


@pytest.mark.slow
def test_joined_runs_complete_each_other_but_may_not_differ(corpus):
    tree = corpus("ce500_transonic")[0].to_datatree()
    below = tree.copy(deep=True)
    plain = below["section"].to_dataset()
    for name in ("mach_crest", "x_crest", "CL_alpha_crest"):
        plain[f"{name}_flag"][:] = ABSENT
        plain[name][:] = np.nan
    below["section"] = plain
    joined = datcom_io.join([below, tree])
    assert joined["section"]["mach_crest"].values[0] == 0.69060
    assert joined["section"].sizes["mach"] == 12
    assert joined["coordinates"].sizes == tree["coordinates"].sizes
    other = tree.copy(deep=True)
    other["coordinates"]["thickness"][0, 5] = 0.5
    with pytest.raises(
        SchemaError,
        match=r"coordinates of .*TRANSONIC FAIRING: thickness differs from that of the first tree",
    ):
        datcom_io.join([tree, other])
