"""Trees in SI and radians; numbers typed from the listings in data/t37/datcom, at the lines
named.
"""

import math

import numpy as np
import pytest
import xarray as xr

import datcom_io
from datcom_io.cells import ABSENT, BLANK, FILLED, NA, NDM, OK, SUSPECT
from flightmech.errors import SchemaError

DEG = math.pi / 180.0
FOOT = 0.3048
EXACT = {"rtol": 1e-12}  # the same printed number through one multiplication


@pytest.fixture(scope="module")
def trees(t37):
    import functools

    return functools.cache(lambda name: t37(name)[0].to_datatree())


def test_root_carries_reference_quantities_in_si(trees):
    attrs = trees("t37_clean.out").attrs
    assert attrs["S"] == pytest.approx(
        182.0 * FOOT**2, rel=1e-12
    )  # SREF, CBARR, BLREF, XCG of the deck
    assert attrs["cbar"] == pytest.approx(5.47 * FOOT, rel=1e-12)
    assert attrs["b"] == pytest.approx(33.83 * FOOT, rel=1e-12)
    assert attrs["x_cg"] == pytest.approx(9.88 * FOOT, rel=1e-12)
    assert attrs["z_cg"] == 0.0
    assert (attrs["dim"], attrs["deriv"], attrs["file"]) == ("FT", "RAD", "t37_clean.out")
    assert attrs["title"] == "T-37 OWN DECK CLEAN AIRCRAFT"


def test_conditions(trees):
    static = trees("t37_clean.out")["static"]
    assert static.sizes["condition"] == 18
    np.testing.assert_allclose(static["mach"][:7], [0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.15])
    np.testing.assert_allclose(static["h"][[0, 6, 12]], [0.0, 3048.0, 6096.0])
    first = trees("t37_elevator.out")["static"].isel(condition=0)  # line 184
    assert float(first["V"]) == pytest.approx(167.45 * FOOT, rel=1e-12)
    assert float(first["p_static"]) == pytest.approx(2116.2 * 4.4482216152605 / FOOT**2, rel=1e-12)
    assert float(first["temperature"]) == pytest.approx(288.15, rel=1e-12)
    assert float(first["reynolds_per_m"]) == pytest.approx(1.0602e6 / FOOT, rel=1e-12)
    assert str(first["lines"].values) == "188-206"


def test_static_per_radian(trees):
    static = trees("t37_elevator.out")["static"]
    np.testing.assert_allclose(static["alpha"][:3], np.array([-8.0, -6.0, -4.0]) * DEG, **EXACT)
    row = static.isel(condition=0, alpha=2)  # line 190
    printed = {"CD": 0.022, "CL": -0.224, "Cm": 0.1249, "CN": -0.225, "CA": 0.006, "xcp": -0.555}
    slopes = {"CL_alpha": 5.334, "Cm_alpha": -1.094, "Cl_beta": -5.983e-02}
    for name, value in {**printed, **slopes}.items():
        assert float(row[name]) == value
        assert int(row[f"{name}_flag"]) == OK
    assert static["Cm_flag"][0, -1] == NA  # line 206
    assert math.isnan(static["Cm"][0, -1])
    assert static["CL_alpha"].attrs["per"] == "radian"
    assert static["CL"].attrs["units"] == "1"


def test_constant_columns_are_filled_and_state_it(trees):
    tree = trees("t37_elevator.out")
    for leaf, name, value in (
        ("static", "CY_beta", -4.177e-01),
        ("static", "Cn_beta", 5.272e-02),
        ("dynamic", "Cm_qhat", -17.75),
    ):
        np.testing.assert_array_equal(tree[leaf][name][0], np.full(19, value))  # lines 188 and 243
        assert tree[leaf][f"{name}_flag"][0].values.tolist() == [OK] + [FILLED] * 18


def test_dynamic_and_downwash(trees):
    dynamic = trees("t37_elevator.out")["dynamic"].isel(condition=0, alpha=0)  # line 243
    printed = {
        "CL_qhat": 8.451,
        "CL_alphadothat": 3.204,
        "Cm_alphadothat": -8.702,
        "Cl_phat": -4.885e-01,
        "CY_phat": -8.032e-02,
        "Cn_phat": 3.449e-02,
        "Cn_rhat": -8.197e-02,  # printed before CLR
        "Cl_rhat": -6.971e-02,
    }
    for name, value in printed.items():
        assert float(dynamic[name]) == value
    downwash = trees("t37_elevator.out")["downwash"].isel(condition=0, alpha=16)  # line 225
    assert float(downwash["q_ratio"]) == 1.0
    assert float(downwash["epsilon"]) == pytest.approx(10.443 * DEG, rel=1e-12)
    assert float(downwash["epsilon_alpha"]) == 0.291


def test_derivatives_per_degree_become_per_radian(elevator_lines):
    lines = [
        line.replace("DERIV RAD", "DERIV DEG").replace("(PER RADIAN)", "(PER DEGREE)")
        for line in elevator_lines
    ]
    tree = datcom_io.read(lines)[0].to_datatree()
    assert float(tree["static"]["CL_alpha"][0, 0]) == pytest.approx(5.797 / DEG, rel=1e-12)
    assert float(tree["dynamic"]["Cl_phat"][0, 0]) == pytest.approx(-0.4885 / DEG, rel=1e-12)
    assert float(tree["static"]["CL"][0, 0]) == -0.613


def test_elevator(trees):
    symflp = trees("t37_elevator.out")["symflp"]
    assert symflp.attrs["surface"] == "tail"
    assert symflp.attrs["device"] == "plain trailing-edge flap"
    np.testing.assert_allclose(
        symflp["delta"],
        np.array([-25, -20, -15, -10, -5, 0, 5, 10, 15]) * DEG,
        rtol=1e-12,
        atol=1e-15,
    )
    first = symflp.isel(condition=0, delta=0)  # line 275
    assert [float(first[name]) for name in ("dCL", "dCm", "dCLmax", "dCDmin")] == [
        -0.202,
        0.4444,
        0.120,
        0.01167,
    ]
    assert float(first["Ch_alpha"]) == pytest.approx(
        -4.446e-03 / DEG, rel=1e-12
    )  # per degree though the deck has DERIV RAD
    assert float(first["Ch_delta"]) == pytest.approx(-1.155e-02 / DEG, rel=1e-12)
    assert symflp["Ch_alpha_flag"][0].values.tolist() == [OK] + [FILLED] * 8
    assert (symflp["CL_alpha_delta_flag"] == NDM).all()
    assert symflp["dCDi"].dims == ("condition", "alpha", "delta")
    assert float(symflp["dCDi"][0, 0, 4]) == 2.63e-03  # line 290
    assert str(symflp["lines_dCDi"][0].values) == "290-308"


def test_wing_flaps_without_hinge_moments(trees):
    symflp = trees("t37_flaps.out")["symflp"]
    assert symflp.attrs["surface"] == "wing"
    assert symflp.attrs["device"] == "single-slotted flap"
    assert symflp["dCm"][0].values.tolist() == [-0.0, -0.0779, -0.1279]  # lines 191-193
    assert float(symflp["CL_alpha_delta"][0, 2]) == pytest.approx(5.899e-02 / DEG, rel=1e-12)
    assert (symflp["Ch_alpha_flag"] == NDM).all()  # NDM in the first row holds for the blanks below


def test_ailerons(trees):
    asyflp = trees("t37_aileron.out")["asyflp"]
    np.testing.assert_allclose(asyflp["delta_left"][:2], np.array([-20.0, -15.0]) * DEG, **EXACT)
    np.testing.assert_allclose(asyflp["delta_right"][:2], np.array([20.0, 15.0]) * DEG, **EXACT)
    assert float(asyflp["Cl"][0, 0]) == -4.9445e-02  # line 178
    assert float(asyflp["Cn"][0, 0, 0]) == -3.577e-03  # line 156
    assert float(asyflp["Cn"][0, 18, 8]) == -1.198e-02  # line 174
    assert asyflp["Cn"].dims == ("condition", "alpha", "delta_pair")


def test_ground_heights_and_free_air(trees):
    static = trees("t37_ground.out")["static"]
    heights = (
        np.array([2.5, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0, 30.0, np.inf]) * FOOT
    )  # GRDHT of the deck
    np.testing.assert_allclose(static["ground_height"], heights, **EXACT)
    at = static.isel(condition=0).sel(ground_height=7.0 * FOOT, method="nearest").isel(alpha=4)
    assert (float(at["CL"]), float(at["Cm"])) == (0.592, -0.0341)  # line 423
    assert "ground_height" not in trees("t37_ground.out")["dynamic"].dims
    assert trees("t37_ground.out")["dynamic"].sizes["condition"] == 1


def test_elevator_pages_in_ground_effect_are_distinguished_by_their_order(trees, t37):
    static = trees("t37_ground_elevator.out")["static"]
    assert static["CL"].dims == ("condition", "ground_height", "delta_e", "alpha")
    assert (static["CL_flag"].sel(ground_height=np.inf) == ABSENT).all("alpha").values.tolist() == [
        [True] * 5 + [False] + [True] * 3
    ]
    pages = [page for page in t37("t37_ground_elevator.out").pages if page.ground_height == 2.5]
    assert len(pages) == 9
    for k, page in enumerate(pages):
        np.testing.assert_array_equal(static["CL"][0, 0, k], page.table("static").values[:, 2])


def test_flap_pages_in_ground_effect(trees):
    static = trees("t37_ground_flap.out")["static"]
    np.testing.assert_allclose(static["delta_f"], np.array([0.0, 20.0, 40.0]) * DEG, **EXACT)
    over_ground = static.isel(condition=0, ground_height=slice(0, 8))
    assert over_ground["CL_flag"].isel(alpha=0, ground_height=0).values.tolist() == [
        OK,
        SUSPECT,
        SUSPECT,
    ]
    assert (over_ground["CL_flag"].isel(delta_f=0) == OK).all()
    for name in ("CD", "CL", "Cm", "CN", "CA", "CL_alpha", "Cm_alpha"):
        assert (over_ground[f"{name}_flag"].isel(delta_f=slice(1, 3)) == SUSPECT).all()
        assert over_ground[name].notnull().all()  # the numbers stay
    assert (over_ground["Cl_beta_flag"] == OK).all()
    assert (static["CL_flag"].sel(ground_height=np.inf, delta_f=0.0) == OK).all()
    assert "must be added" in trees("t37_ground_flap.out").attrs["messages"]


def test_build_up_by_configuration(trees):
    static = trees("t37_build.out")["static"]
    assert static["CL"].dims == ("configuration", "condition", "alpha")
    assert {"WING ALONE", "WING-BODY", "WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"} <= set(
        static["configuration"].values
    )
    vertical = static.sel(configuration="VERTICAL TAIL").isel(condition=0)
    assert (vertical["CL_flag"][1:] == BLANK).all()  # not computed: never filled downwards
    assert vertical["CL"][1:].isnull().all()


@pytest.mark.slow
def test_runs_joined_along_the_condition(t37):
    listing = t37("t37_elevator_one_by_one.pdas.out")
    tree = datcom_io.join(case.to_datatree() for case in listing)
    symflp = tree["symflp"]
    assert symflp["mach"].values.tolist() == [0.15, 0.2, 0.3, 0.4, 0.5, 0.6]
    at = symflp["dCm"].isel(delta=3)  # -10 deg, README of the data set
    assert at.values.tolist() == [0.2592, 0.2625, 0.2659, 0.2660, 0.2621, 0.2551]
    assert symflp["case"].values.tolist() == listing.case_names
    assert tree["static"].sizes["condition"] == 6
    assert tree.attrs["S"] == pytest.approx(182.0 * FOOT**2)


def test_trees_that_do_not_fit_are_not_joined(trees):
    with pytest.raises(
        SchemaError,
        match=r"static of t37_ground\.out: T-37 OWN DECK CLEAN AIRCRAFT IN GROUND EFFECT has the "
        r"axes",
    ):
        datcom_io.join([trees("t37_clean.out"), trees("t37_ground.out")])
    other = trees("t37_clean.out").copy()
    other.attrs["S"] = 20.0
    with pytest.raises(SchemaError, match=r"S is 20\.0 in t37_clean"):
        datcom_io.join([trees("t37_clean.out"), other])
    with pytest.raises(SchemaError, match="no tree was given"):
        datcom_io.join([])


@pytest.mark.slow
def test_grid_of_altitude_and_mach(trees):
    static = trees("t37_clean.out")["static"].to_dataset()
    grid = datcom_io.to_grid(static)
    assert grid["CL"].dims == ("h", "mach", "alpha")
    assert grid["CL_flag"].dtype == np.uint8
    for k in range(18):
        at = static.isel(condition=k)
        np.testing.assert_array_equal(grid["CL"].sel(h=at["h"], mach=at["mach"]), at["CL"])
        assert grid["lines"].sel(h=at["h"], mach=at["mach"]).item() == at["lines"].item()
    with pytest.raises(SchemaError, match=r"Mach 0\.2 at 3048 m is missing"):
        datcom_io.to_grid(static.isel(condition=[0, 1, 6]))
    with pytest.raises(SchemaError, match=r"Mach 0\.15 at 0 m occurs 2 times"):
        datcom_io.to_grid(static.isel(condition=[0, 0]))
    with pytest.raises(SchemaError, match="no dimension condition"):
        datcom_io.to_grid(grid)


def test_transonic_pages_are_filled_only_when_asked(elevator_lines):
    lines = [line.replace("STMACH=0.8", "STMACH=0.1") for line in elevator_lines]
    case = datcom_io.read(lines)[0]
    plain, filled = (
        case.to_datatree(fill_transonic=fill)["static"]["CY_beta_flag"][0].values.tolist()
        for fill in (False, True)
    )
    assert plain == [OK] + [BLANK] * 18
    assert filled == [OK] + [FILLED] * 18


@pytest.mark.nightly
def test_listing_tree_is_written_completely_and_read_again(t37, tmp_path):
    from datcom_io.arrays.frames import write_tree

    assert (
        list(t37("t37_elevator_one_by_one.pdas.out").to_datatree().children)
        == t37("t37_elevator_one_by_one.pdas.out").case_names
    )
    tree = t37("t37_elevator.out").to_datatree()
    write_tree(tree, tmp_path / "a.nc")
    with xr.open_datatree(tmp_path / "a.nc", engine="h5netcdf") as again:
        for name, leaf in tree["T-37 OWN DECK ELEVATOR"].children.items():
            xr.testing.assert_identical(
                again["T-37 OWN DECK ELEVATOR"][name].to_dataset(), leaf.to_dataset()
            )
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]


def test_a_failed_write_leaves_nothing(trees, tmp_path):
    from datcom_io.arrays.frames import write_tree

    (tmp_path / "a.nc").write_text("kept")
    tree = trees("t37_clean.out").copy()
    tree.attrs["broken"] = object()
    with pytest.raises(TypeError):
        write_tree(tree, tmp_path / "a.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]
    assert (tmp_path / "a.nc").read_text() == "kept"


@pytest.mark.parametrize(
    ("caseid", "name"),
    [("WING/BODY, M=0.6", "WING|BODY, M=0.6"), ("..", "case 1"), ("A/..", "A|..")],
)
def test_a_name_that_would_be_a_path(elevator_lines, caseid, name):
    listing = datcom_io.read(
        [line.replace("T-37 OWN DECK ELEVATOR", caseid) for line in elevator_lines]
    )
    tree = listing.to_datatree()
    assert list(tree.children) == [name] == [listing[0].to_datatree().name]
    assert tree[name].attrs["case"] == caseid
