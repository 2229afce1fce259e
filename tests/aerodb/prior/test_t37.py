"""The T-37 database against its listings: numbers as printed in data/t37/datcom and its README.

A printed number is known to half a unit of its last digit; tolerances are that, unless stated
otherwise.
"""

import numpy as np
import pytest

import aerodb
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE, FOOT

ALPHA = 2 * DEGREE


def at(db, name, **where):
    """Return the value of a term's table at a node."""
    return float(db[name]["value"].sel(where, method="nearest", tolerance=1e-6))


def stability_axes(db, alpha=ALPHA, mach=0.3):
    """Return the lateral rate derivatives turned back to stability axes: Cl_p, Cl_r, Cn_p, Cn_r."""
    D_b = np.array(
        [
            [at(db, f"{c}/{rate}", mach=mach, alpha=alpha) for rate in ("phat", "rhat")]
            for c in ("Cl", "Cn")
        ]
    )
    T = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
    return T.T @ D_b @ T


@pytest.mark.nightly
def test_sanity_table_longitudinal(t37_db):
    """README: Mach 0.3, 10 000 ft, alpha 2 deg."""
    where = {"mach": 0.3, "alpha": ALPHA}
    CL = t37_db["CL/basic"]["value"].sel(mach=0.3)
    slope = float(CL.differentiate("alpha").sel(alpha=ALPHA, method="nearest"))
    assert slope == pytest.approx(5.46, abs=0.06)  # three decimals of CL over 2 deg of alpha
    assert at(t37_db, "CL/basic", mach=0.3, alpha=0.0) == pytest.approx(0.138, abs=5e-4)
    assert at(t37_db, "CD/basic", mach=0.3, alpha=0.0) == pytest.approx(0.018, abs=5e-4)
    assert at(t37_db, "Cm/qhat", **where) == pytest.approx(-17.6, abs=0.05)
    assert at(t37_db, "CL/qhat", **where) == pytest.approx(8.43, abs=5e-3)
    assert at(t37_db, "CL/alphadothat", **where) == pytest.approx(3.71, abs=5e-3)
    assert at(t37_db, "Cm/alphadothat", **where) == pytest.approx(-10.1, abs=0.05)
    Cm_alpha = float(
        t37_db["Cm/basic"]["value"]
        .sel(mach=0.3)
        .differentiate("alpha")
        .sel(alpha=ALPHA, method="nearest")
    )
    assert Cm_alpha == pytest.approx(-0.82, abs=0.01)


@pytest.mark.slow
def test_sanity_table_lateral(t37_db):
    """README, in DATCOM's stability axes: the database turned back."""
    (Cl_p, Cl_r), (Cn_p, Cn_r) = stability_axes(t37_db)
    assert Cl_p == pytest.approx(-0.463, abs=5e-4)
    assert Cl_r == pytest.approx(0.078, abs=5e-4)
    assert Cn_p == pytest.approx(-0.020, abs=5e-4)
    assert Cn_r == pytest.approx(-0.089, abs=5e-4)
    Cl, Cn = (at(t37_db, f"{c}/beta", mach=0.3, alpha=ALPHA) for c in ("Cl", "Cn"))
    assert Cl * np.cos(ALPHA) + Cn * np.sin(ALPHA) == pytest.approx(-0.078, abs=5e-4)
    assert Cn * np.cos(ALPHA) - Cl * np.sin(ALPHA) == pytest.approx(0.051, abs=5e-4)
    # t37_clean.out prints CYB -4.190E-01 for Mach 0.3, 10 000 ft (the README's -0.418 belongs to
    # lower Mach numbers)
    assert at(t37_db, "CY/beta", mach=0.3, alpha=ALPHA) == pytest.approx(-0.4190, abs=5e-5)
    assert at(t37_db, "CY/phat", mach=0.3, alpha=ALPHA) == pytest.approx(
        -0.066 * np.cos(ALPHA), abs=5e-4
    )


def test_elevator_one_by_one(t37_db):
    """README, fault 1: D(CM) of -10 deg at Mach 0.15 ... 0.6, run one by one."""
    minus_ten = (
        t37_db["Cm/elevator"]["value"]
        .sel(delta_e=-10 * DEGREE, method="nearest")
        .sel(mach=[0.15, 0.2, 0.3, 0.4, 0.5, 0.6])
    )
    np.testing.assert_allclose(
        minus_ten, [0.2592, 0.2625, 0.2659, 0.2660, 0.2621, 0.2551], atol=4e-4
    )  # its own value at zero, 0.0003, taken off
    # printed at Mach 0.15, alpha of no matter: D(CL) -0.118; effectiveness of the README at Mach
    # 0.3: CL 0.68, Cm -1.52
    assert at(t37_db, "CL/elevator", mach=0.15, delta_e=-10 * DEGREE) == pytest.approx(
        -0.118, abs=5e-4
    )
    ten = {"mach": 0.3, "delta_e": 10 * DEGREE}
    assert at(t37_db, "CL/elevator", **ten) / (10 * DEGREE) == pytest.approx(0.68, abs=0.01)
    assert at(t37_db, "Cm/elevator", **ten) / (10 * DEGREE) == pytest.approx(-1.52, abs=0.01)


@pytest.mark.nightly
def test_the_looped_elevator_is_warned_about_and_differs(t37, craft, t37_db):
    with pytest.warns(AeromatchWarning, match="elevator: D\\(CM\\) comes from a loop"):
        looped = aerodb.from_datcom(craft, clean=t37["clean"], elevator=t37["elevator"])
    row = aerodb.compare(
        t37_db, aerodb.replace_terms(t37_db, {"Cm/elevator": aerodb.terms(looped)["Cm/elevator"]})
    ).loc["Cm/elevator"]
    assert (
        0.002 < abs(row["max_difference"]) < 0.02
    )  # README: 0.2686 against 0.2659 at Mach 0.3, -10 deg


def test_flap_increments(t37_db):
    """t37_flaps.out, Mach 0.15: 20 deg 0.227 -0.0779 0.00925, 40 deg 0.363 -0.1279 0.03443; D(CDI)
    at alpha 4: 0.0141, 0.0276.
    """
    for degrees, CL, Cm, CD in (
        (20, 0.227, -0.0779, 0.00925 + 0.0141),
        (40, 0.363, -0.1279, 0.03443 + 0.0276),
    ):
        where = {"mach": 0.15, "delta_f": degrees * DEGREE}
        assert at(t37_db, "CL/flap", **where) == pytest.approx(CL, abs=5e-4)
        assert at(t37_db, "Cm/flap", **where) == pytest.approx(Cm, abs=5e-5)
        assert at(t37_db, "CD/flap", alpha=4 * DEGREE, **where) == pytest.approx(CD, abs=6e-5)
    # (CLA)D 0.05899 against 0.05886 per degree
    assert at(t37_db, "CL/flap_slope", mach=0.15, delta_f=40 * DEGREE) == pytest.approx(
        0.00013 / DEGREE, abs=1e-5 / DEGREE
    )


def test_aileron_sign_and_axes(t37_db):
    """t37_aileron.out, Mach 0.15: DELTAL -20, DELTAR 20 prints (CL)ROLL -4.9445E-02, CN 2.560E-03
    at alpha 2: left roll, nose right.
    """
    where = {"mach": 0.15, "delta_a": 20 * DEGREE}
    Cl, Cn = (at(t37_db, f"{c}/aileron", alpha=ALPHA, **where) for c in ("Cl", "Cn"))
    assert Cl * np.cos(ALPHA) + Cn * np.sin(ALPHA) == pytest.approx(-4.9445e-2, abs=5e-7)
    assert Cn * np.cos(ALPHA) - Cl * np.sin(ALPHA) == pytest.approx(2.560e-3, abs=5e-7)
    assert Cl < 0
    small = at(t37_db, "Cl/aileron", mach=0.15, delta_a=5 * DEGREE, alpha=0.0) / (5 * DEGREE)
    assert small == pytest.approx(-0.165, abs=5e-4)  # -1.4388E-02 over 5 deg


def test_ground_effect_against_the_pages(t37_db, craft):
    """t37_ground.out, alpha 4: CL 0.525 free, 0.754 at 2.5 ft; CM -0.0023 and -0.0868; CD 0.033 and
    0.028.
    """
    low = {"h_agl": 2.5 * FOOT, "alpha": 4 * DEGREE}
    assert at(t37_db, "CL/ground", **low) == pytest.approx(0.754 - 0.525, abs=1e-6)
    assert at(t37_db, "Cm/ground", **low) == pytest.approx(-0.0868 + 0.0023, abs=1e-6)
    assert at(t37_db, "CD/ground", **low) == pytest.approx(0.028 - 0.033, abs=1e-6)
    for name in ("CL/ground", "CD/ground", "Cm/ground", "CL/ground_flap"):
        leaf = t37_db[name]
        far = leaf["h_agl"].values[-2:]
        assert far[0] == pytest.approx(2 * craft.b)
        assert np.isfinite(far).all()
        assert (leaf["value"].sel(h_agl=far) == 0).all()
        assert (leaf["stderr"].sel(h_agl=far) == 0).all()
        assert "zero from two spans (20.62 m) on" in leaf.attrs["comment"]


def test_flaps_near_the_ground_add_only_ground_effect(t37_db):
    """One deflection per run, alpha 4, 2.5 ft: CL 0.716, 0.796, 0.842 at 0, 20, 40 deg; the
    increment of free air is not in the pages.
    """
    low = {"h_agl": 2.5 * FOOT, "alpha": 4 * DEGREE}
    assert at(t37_db, "CL/ground_flap", delta_f=20 * DEGREE, **low) == pytest.approx(
        0.796 - 0.716, abs=1e-6
    )
    assert at(t37_db, "CL/ground_flap", delta_f=40 * DEGREE, **low) == pytest.approx(
        0.842 - 0.716, abs=1e-6
    )
    assert at(
        t37_db, "CL/ground_flap", delta_f=40 * DEGREE, h_agl=30 * FOOT, alpha=4 * DEGREE
    ) == pytest.approx(0.003, abs=1e-6)
    assert at(t37_db, "CL/ground_flap", delta_f=0.0, **low) == 0.0
    given = {
        "mach": 0.15,
        "h": 0.0,
        "alpha": 4 * DEGREE,
        "qhat": 0.0,
        "alphadothat": 0.0,
        "delta_e": 0.0,
    }
    free = {**given, "h_agl": 1000.0}
    flaps = aerodb.evaluate(t37_db, "CL", delta_f=40 * DEGREE, **free) - aerodb.evaluate(
        t37_db, "CL", delta_f=0.0, **free
    )
    assert flaps == pytest.approx(0.363 + 0.0074 * 4 * DEGREE, abs=1e-3)


@pytest.mark.slow
def test_flaps_over_ground_of_one_run_are_refused(t37, craft):
    """Every deflection but the first holds the ground effect of those before: 0.539 instead of
    0.526 at 30 ft, flap 40, alpha 4.
    """
    with pytest.raises(
        SchemaError,
        match=r"ground_flap: 1 problem(.|\n)*t37_ground_flap.out holds .* several deflections "
        r"from one program run",
    ):
        aerodb.from_datcom(craft, clean=t37["clean"], ground_flap=t37["ground_flap"])


@pytest.mark.nightly
def test_listings_of_one_flap_setting_each(t37, t37_db, craft):
    """Given as separate listings, in any order, they make the same tables as in one file."""
    cases = t37["ground_flap_one_by_one"].cases
    db = aerodb.from_datcom(craft, clean=t37["clean"], ground_flap=[cases[2], cases[0], cases[1]])
    for name in ("CL/ground_flap", "CD/ground_flap", "Cm/ground_flap"):
        np.testing.assert_array_equal(db[name]["value"], t37_db[name]["value"])
    np.testing.assert_allclose(db["CL/ground_flap"]["delta_f"], np.radians([0.0, 20.0, 40.0]))
    with pytest.raises(SchemaError, match="no several delta_f with zero among them"):
        aerodb.from_datcom(craft, clean=t37["clean"], ground_flap=cases[1:])


@pytest.mark.nightly
def test_the_program_has_no_ground_effect_of_the_elevator(t37, craft):
    """The first deflection prints the clean ground pages, the others add to them: zero deflection,
    the sixth, gives CL 0.726 for 0.754.
    """
    with pytest.warns(AeromatchWarning, match="computes the ground effect without the elevator"):
        db = aerodb.from_datcom(
            craft, clean=t37["clean"], ground=t37["ground"], ground_elevator=t37["ground_elevator"]
        )
    assert {"CL/ground_elevator", "CD/ground_elevator", "Cm/ground_elevator"} <= set(
        db.attrs["absent"].split()
    )


@pytest.mark.nightly
def test_the_clean_ground_effect_from_pages_with_elevator(t37, t37_db, craft):
    db = aerodb.from_datcom(craft, clean=t37["clean"], ground=t37["ground_elevator"])
    for name in ("CL/ground", "CD/ground", "Cm/ground"):
        np.testing.assert_array_equal(db[name]["value"], t37_db[name]["value"])


@pytest.mark.slow
def test_lift_passes_through_the_printed_pages(t37, t37_db):
    """Free air, no deflection: every printed CL, CD, Cm of all 18 conditions comes back."""
    page = t37["clean"][0].to_datatree()["static"].to_dataset()
    zero = dict.fromkeys(("qhat", "alphadothat", "delta_e", "delta_f"), 0.0)
    for i in range(page.sizes["condition"]):
        given = {**zero, "h_agl": 1000.0, "mach": float(page["mach"][i]), "h": float(page["h"][i])}
        for name in ("CL", "CD", "Cm"):
            printed = np.isfinite(page[name][i].values)
            value = aerodb.evaluate(t37_db, name, alpha=page["alpha"].values[printed], **given)
            np.testing.assert_allclose(value, page[name][i].values[printed], atol=1e-12)


def test_pitching_moment_keeps_the_stall_at_low_mach(t37_db):
    """CM is printed to 18 deg at Mach 0.15 (-0.318) and only to 12 deg at Mach 0.6: both stay, the
    gap is marked as judgement.
    """
    leaf = t37_db["Cm/basic"]
    assert at(t37_db, "Cm/basic", mach=0.15, alpha=18 * DEGREE) == pytest.approx(-0.318, abs=1e-3)
    source = leaf["source"].sel(alpha=18 * DEGREE, method="nearest")
    assert source.sel(mach=0.15) == 0
    assert source.sel(mach=0.6) == 2
    assert "alpha 20 deg not printed" in leaf.attrs["comment"]


def test_listing_lines_and_files_are_named(t37_db):
    assert t37_db["CL/basic"].attrs["references"] == "t37_clean.out, lines 185-1716"
    assert "elevator from t37_elevator_one_by_one.pdas.out" in t37_db.attrs["history"]


def test_derivatives_of_the_fin_show_the_axes_of_datcom(t37):
    """The decision on axes (docs/explanation/database/from-datcom.md): fin = whole aeroplane minus
    wing-body-horizontal tail, Mach 0.2, t37_build.out.

    A fin force at (l, z) gives Cl_beta = CY (z cos - l sin)/b, Cn_r = 2 CY (l cos + z sin)^2/b^2
    and Cn_p = -2 CY (l cos + z sin) (z cos - l sin - z)/b^2 in stability axes, all constant in
    alpha in body axes. The print follows the first, to its last digit.
    """
    tree = t37["build"][0].to_datatree()
    whole, without = (
        {"configuration": name, "condition": 0}
        for name in ("WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL", "WING-BODY-HORIZONTAL TAIL")
    )
    static, dynamic = (
        tree[leaf].to_dataset().set_index(configuration="configuration")
        for leaf in ("static", "dynamic")
    )

    def fin(leaf, name):
        return (leaf[name].sel(whole) - leaf[name].sel(without)).values

    alpha, b = static["alpha"].values, tree.attrs["b"]
    sin, cos = np.sin(alpha), np.cos(alpha)
    CY = fin(static, "CY_beta")[0]
    (z, l), *_ = np.linalg.lstsq(np.c_[cos, -sin] * CY / b, fin(static, "Cl_beta"), rcond=None)
    assert l == pytest.approx(14.86 * FOOT, abs=0.02 * FOOT)
    aft, up = l * cos + z * sin, z * cos - l * sin
    # half a unit of the last digit (1e-4 from 0.1 on) of two printed numbers
    np.testing.assert_allclose(fin(static, "Cl_beta"), CY * up / b, atol=1e-4)
    np.testing.assert_allclose(fin(dynamic, "Cn_rhat"), 2 * CY * (aft / b) ** 2, atol=1e-4)
    np.testing.assert_allclose(fin(dynamic, "Cn_phat"), -2 * CY * aft * (up - z) / b**2, atol=1e-4)
    assert np.ptp(fin(dynamic, "Cn_rhat")) > 0.01  # in body axes it would not change
    # Cn_beta alone is printed once for all alphas, with the arm of alpha zero
    np.testing.assert_allclose(fin(static, "Cn_beta"), -CY * l / b, atol=2e-5)


def test_pitch_rate_is_divided_by_two_V(t37):
    """The tail's share of CL_q is 2 (l_H/cbar) times its lift slope; with V it would be half of
    that. t37_build.out, Mach 0.2, alpha -8.
    """
    tree = t37["build"][0].to_datatree()
    pick = {"condition": 0, "alpha": 0}
    static, dynamic, downwash = (
        tree[leaf].to_dataset().isel(pick).set_index(configuration="configuration")
        for leaf in ("static", "dynamic", "downwash")
    )
    whole, wing = {"configuration": "WING-BODY-HORIZONTAL TAIL"}, {"configuration": "WING-BODY"}
    slope = float(static["CL_alpha"].sel(whole) - static["CL_alpha"].sel(wing)) / (
        1 - float(downwash["epsilon_alpha"].sel(whole))
    )
    arm = -float(
        dynamic["Cm_alphadothat"].sel(whole) / dynamic["CL_alphadothat"].sel(whole)
    )  # l_H / cbar
    share = float(dynamic["CL_qhat"].sel(whole) - dynamic["CL_qhat"].sel(wing))
    assert share == pytest.approx(
        2 * arm * slope, rel=0.01
    )  # three decimals of the downwash slope, interference left out


def test_alpha_of_every_leaf_rises_and_nodes_are_finite(t37_db):
    assert aerodb.check(t37_db) == []
    assert len(aerodb.terms(t37_db)) == 35
