"""From DATCOM to a database: a case that algebra can follow, and refusals."""

import dataclasses

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName

# numbers that algebra can follow are not those of an aeroplane
pytestmark = pytest.mark.filterwarnings("ignore:.* is implausible at")
CRAFT = {"S": 16.0, "cbar": 1.6, "b": 10.0, "reference": (-3.0, 0.0, 0.0)}


@pytest.fixture
def craft(craft):
    return dataclasses.replace(craft, **CRAFT)


def total(db, alpha, beta=0.0, phat=0.0, qhat=0.0, rhat=0.0):
    """Return body-axis force and moment coefficients (CX CY CZ, Cl Cm Cn) of a database at Mach
    0.3.
    """
    given = {
        "mach": 0.3,
        "h": 0.0,
        "alpha": alpha,
        "beta": beta,
        "phat": phat,
        "qhat": qhat,
        "rhat": rhat,
        "alphadothat": 0.0,
    }
    c = {
        name: float(aerodb.evaluate(db, name, **given))
        for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    }
    CX, CZ = (
        c["CL"] * np.sin(alpha) - c["CD"] * np.cos(alpha),
        -c["CL"] * np.cos(alpha) - c["CD"] * np.sin(alpha),
    )
    return np.array([CX, c["CY"], CZ]), np.array([c["Cl"], c["Cm"], c["Cn"]])


@pytest.mark.nightly
def test_basic_and_altitude_add_up_to_every_printed_page(craft, make_case):
    case = make_case()
    case["static"]["CL"].values[:] *= np.array([1.0, 1.02, 1.01, 1.03])[
        :, None
    ]  # make pages differ
    db = aerodb.from_datcom(craft, clean=case, altitude=0.0)
    page = case["static"].to_dataset()
    for i in range(page.sizes["condition"]):
        given = {
            "mach": float(page["mach"][i]),
            "h": float(page["h"][i]),
            "alpha": page["alpha"].values,
        } | dict.fromkeys(("qhat", "alphadothat"), 0.0)
        for name in ("CL", "CD", "Cm"):
            np.testing.assert_allclose(
                aerodb.evaluate(db, name, **given), page[name][i], rtol=1e-14, atol=1e-15
            )
    assert (db["CL/altitude"]["stderr"].sel(h=0.0) == 0).all()
    assert (db["CL/altitude"]["stderr"].sel(h=3000.0) > 0).all()


@pytest.mark.nightly
def test_the_middle_altitude_is_the_basic_one_unless_specified(craft, make_case):
    assert (
        aerodb.from_datcom(craft, clean=make_case())["CL/basic"]
        .attrs["comment"]
        .startswith("clean aeroplane at 3000 m")
    )
    with pytest.raises(
        SchemaError, match=r"altitude 1500.0 m is not printed; choose one of 0.0, 3000.0 m"
    ):
        aerodb.from_datcom(craft, clean=make_case(), altitude=1500.0)


@pytest.mark.nightly
def test_all_names_axes_and_absent_terms(craft, make_case):
    db = aerodb.from_datcom(craft, clean=make_case())
    assert set(aerodb.terms(db)) == {
        *(f"{c}/{n}" for c in ("CL", "CD", "Cm") for n in ("basic", "altitude")),
        *(f"{c}/{n}" for c in ("CL", "Cm") for n in ("qhat", "alphadothat")),
        *(f"{c}/{n}" for c in ("CY", "Cl", "Cn") for n in ("beta", "phat")),
        "Cl/rhat",
        "Cn/rhat",
    }
    absent = db.attrs["absent"].split()
    assert {"CY/rhat", "Cn/rudder", "CL/gear", "CL/speedbrake", "CL/flap", "Cl/aileron"} <= set(
        absent
    )
    assert not set(absent) & set(aerodb.terms(db))
    assert len(absent) == len(set(absent))
    assert db["Cl/phat"].dims == {"mach": 3, "alpha": 13}  # Mach 0 and the two of the case
    assert db.attrs["force_axes"] == "stability"


@pytest.mark.nightly
def test_moment_reference_moves_with_forces_and_flow(craft, make_case):
    """The same aeroplane about two points: total moments and rate effects agree with rigid-body
    kinematics.
    """
    here = aerodb.from_datcom(craft, clean=make_case())
    there = aerodb.from_datcom(
        dataclasses.replace(craft, reference=(-3.4, 0.0, 0.25)),
        clean=make_case(),
        move_reference=True,
    )
    d = np.array([0.4, 0.0, -0.25])  # from the new point to the old one
    cbar, b, V = craft.cbar, craft.b, 1.0
    lengths = np.array([b, cbar, b])
    alpha = np.radians(4.0)  # a node: tables are straight on both sides
    F_here, M_here = total(here, alpha)
    F_there, M_there = total(there, alpha)
    np.testing.assert_allclose(F_there, F_here, atol=1e-14)
    np.testing.assert_allclose(
        M_there * lengths, M_here * lengths + np.cross(d, F_here), atol=1e-14
    )

    def about_new_point(omega):
        """Return forces and moments about the new point, from the old database and the flow at the
        old point.
        """
        u, v, w = V * np.array([np.cos(alpha), 0.0, np.sin(alpha)]) + np.cross(omega, d)
        V_old = np.linalg.norm([u, v, w])
        phat, qhat, rhat = omega * lengths / (2 * V_old)
        F, M = total(here, np.arctan2(w, u), np.arcsin(v / V_old), phat, qhat, rhat)
        return np.append(F, M * lengths + np.cross(d, F)) * V_old**2

    step = 1e-6
    for axis, rate in enumerate(("phat", "qhat", "rhat")):
        omega = np.eye(3)[axis] * step
        hat = step * lengths[axis] / (2 * V)
        expected = (about_new_point(omega) - about_new_point(-omega)) / (2 * hat)
        F_plus, M_plus = total(there, alpha, **{rate: hat})
        F_minus, M_minus = total(there, alpha, **{rate: -hat})
        found = np.append(F_plus - F_minus, (M_plus - M_minus) * lengths) / (2 * hat)
        # slopes of Cm about the new point are central differences over 4 deg of a curve: 2e-5 seen
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.nightly
def test_other_reference_quantities_are_stated_and_converted(craft, make_case):
    case = make_case(S=32.0, cbar=1.6, b=10.0)
    with pytest.warns(
        AeromatchWarning,
        match="clean: S 32 against 16: not the reference quantities of the aircraft",
    ):
        db = aerodb.from_datcom(craft, clean=case)
    np.testing.assert_allclose(
        db["CL/basic"]["value"].sel(mach=0.2), 2 * case["static"]["CL"][0], rtol=1e-14
    )


def test_the_reference_point_must_lie_in_the_plane_of_symmetry(craft, make_case):
    with pytest.raises(SchemaError, match=r"lies 0.5000 m right of the plane of symmetry"):
        aerodb.from_datcom(
            dataclasses.replace(craft, reference=(-3.0, 0.5, 0.0)), clean=make_case()
        )


@pytest.mark.nightly
def test_a_derivative_without_method_is_absent(craft, make_case):
    case = make_case()
    case["dynamic"]["Cl_rhat"].values[:] = np.nan
    db = aerodb.from_datcom(craft, clean=case)
    assert "Cl/rhat" in db.attrs["absent"].split()
    assert "Cl/phat" in aerodb.terms(db)


@pytest.mark.slow
def test_without_dynamic_pages_the_rates_are_absent(craft, make_case):
    case = make_case()
    del case["dynamic"]
    with pytest.warns(
        AeromatchWarning,
        match=r"clean: by_hand.out has no dynamic page, so that the database has no damping .* "
        r"with a card DAMP",
    ):
        db = aerodb.from_datcom(craft, clean=case)
    assert {"CL/qhat", "Cl/phat", "Cn/rhat"} <= set(db.attrs["absent"].split())
    assert "Cl/beta" in aerodb.terms(db)


@pytest.mark.nightly
def test_transonic_pages_are_left_out_and_not_held_over(craft, make_case):
    case = make_case()
    leaf = case["static"].to_dataset()
    transonic = leaf["mach"] > 0.3
    for name in ("CL", "CD", "Cm"):
        leaf[name] = leaf[name].where(
            ~transonic | (leaf["alpha"] == leaf["alpha"][0])
        )  # one row is printed
    case["static"] = leaf
    db = aerodb.from_datcom(craft, clean=case)
    np.testing.assert_array_equal(db["CL/basic"]["mach"], [0.0, 0.2])
    assert "mach 0.4 not printed" in db["CL/basic"].attrs["comment"]


def test_a_clean_case_without_lift_is_refused(craft, make_case):
    with pytest.raises(SchemaError, match=r"by_hand.out prints no lift coefficient"):
        aerodb.from_datcom(craft, clean=make_case(CL=np.nan))


def grounded(case, heights=(1.0, 3.0, np.inf)):
    """Give a case pages over ground: CL half larger at one metre, a tenth at three."""
    leaf = case["static"].to_dataset().isel(condition=[0])
    leaf = leaf.expand_dims(ground_height=list(heights), axis=1)
    factor = xr.DataArray(
        [{1.0: 1.5, 3.0: 1.1}.get(h, 1.0) for h in heights],
        {"ground_height": list(heights)},
        "ground_height",
    )
    case["static"] = leaf.assign(CL=leaf["CL"] * factor)
    del case["dynamic"]
    return case


@pytest.mark.nightly
def test_ground_effect_over_the_height_of_the_reference_point(craft, make_case):
    lower = dataclasses.replace(
        craft, reference=(-3.0, 0.0, 0.25)
    )  # a quarter of a metre below the datum
    db = aerodb.from_datcom(
        lower, clean=make_case(), ground=grounded(make_case()), move_reference=True
    )
    leaf = db["CL/ground"]
    np.testing.assert_allclose(leaf["h_agl"], [0.75, 2.75, 20.0, 30000.0])
    np.testing.assert_allclose(
        leaf["value"].sel(h_agl=0.75), 0.5 * make_case()["static"]["CL"][0], atol=1e-15
    )
    assert "mach" not in leaf.dims
    assert leaf.attrs["comment"].startswith("computed at Mach 0.2")


@pytest.mark.slow
def test_ground_cases_that_cannot_be_used(craft, make_case):
    with pytest.raises(
        SchemaError,
        match="no pages over ground next to the one in free air; give a case with GRNDEF",
    ):
        aerodb.from_datcom(craft, clean=make_case(), ground=make_case())
    with pytest.raises(
        SchemaError, match=r"ground heights reach 25.0 m, beyond two spans \(20.0 m\)"
    ):
        aerodb.from_datcom(
            craft, clean=make_case(), ground=grounded(make_case(), (1.0, 25.0, np.inf))
        )
    with pytest.raises(
        SchemaError, match=r"ground_flap: 1 problem(.|\n)*no several delta_f with zero among them"
    ):
        aerodb.from_datcom(craft, clean=make_case(), ground_flap=grounded(make_case()))


def test_conditions_that_fill_no_grid_are_refused(craft, make_case):
    case = make_case()
    case["static"] = case["static"].to_dataset().isel(condition=[0, 1, 2])
    with pytest.raises(SchemaError, match=r"Mach 0.4 at 3000 m is missing(.|\n)*LOOP=2"):
        aerodb.from_datcom(craft, clean=case)


def test_missing_tables_and_wrong_objects_are_named(craft, make_case):
    with pytest.raises(SchemaError, match=r"elevator: 1 problem(.|\n)*holds no symflp table"):
        aerodb.from_datcom(craft, clean=make_case(), elevator=make_case())
    with pytest.raises(SchemaError, match=r"found an object of type int; give a Listing"):
        aerodb.from_datcom(craft, clean=3)
    with pytest.raises(SchemaError, match="has no reference quantity cbar"):
        aerodb.from_datcom(craft, clean=make_case(cbar=np.nan))


@pytest.mark.nightly
def test_standard_errors_may_be_overridden(craft, make_case):
    db = aerodb.from_datcom(craft, clean=make_case(), stderr={"Cm/qhat": (0.5, 1.0)})
    np.testing.assert_allclose(db["Cm/qhat"]["stderr"], np.hypot(8.5, 1.0))
    np.testing.assert_allclose(db["CL/qhat"]["stderr"], 0.35 * 8.0)
    with pytest.raises(UnknownName, match="unknown term 'Cm/qhut'; near it: Cm/qhat"):
        aerodb.from_datcom(craft, clean=make_case(), stderr={"Cm/qhut": (0.5, 1.0)})
    with pytest.raises(SchemaError, match=r"Cm/qhat is -1; give \(relative, absolute\)"):
        aerodb.from_datcom(craft, clean=make_case(), stderr={"Cm/qhat": -1})


def flapped(case, surface, deltas, machs=(0.2,)):
    """Give a case a symmetrical flap, linear in its deflection, with a pitching moment that is not
    zero without.
    """
    delta, machs = np.radians(deltas), np.array(machs)
    tables = {
        "dCL": 0.5 * delta,
        "dCm": 0.002 - 1.6 * delta,
        "dCDmin": 0.05 * np.abs(delta),
        "CL_alpha_delta": np.nan * delta,
    }
    case["symflp"] = xr.Dataset(
        {
            name: (("condition", "delta"), np.ones((machs.size, 1)) * item)
            for name, item in tables.items()
        },
        {
            "delta": delta,
            "condition": np.arange(machs.size),
            "mach": ("condition", machs),
            "h": ("condition", 0.0 * machs),
        },
        {"surface": surface},
    )
    return case


@pytest.mark.nightly
def test_increments_are_zero_without_deflection(craft, make_case):
    db = aerodb.from_datcom(
        craft, clean=make_case(), elevator=flapped(make_case(), "tail", [-20, 0, 10])
    )
    Cm = db["Cm/elevator"]["value"].sel(mach=0.2)
    np.testing.assert_allclose(Cm, -1.6 * np.radians([-20, 0, 10]), atol=1e-16)
    assert (db["Cm/elevator"]["stderr"].sel(delta_e=0.0) == 0).all()


@pytest.mark.nightly
def test_a_node_is_put_in_where_zero_deflection_is_not_printed(craft, make_case):
    db = aerodb.from_datcom(craft, clean=make_case(), flaps=flapped(make_case(), "wing", [15, 40]))
    np.testing.assert_allclose(np.degrees(db["CL/flap"]["delta_f"]), [0, 15, 40])
    np.testing.assert_allclose(db["CL/flap"]["value"].sel(mach=0.2), 0.5 * np.radians([0, 15, 40]))
    assert "CL/flap_slope" in db.attrs["absent"].split()


def test_flaps_and_elevator_cannot_be_exchanged(craft, make_case):
    with pytest.raises(
        SchemaError,
        match="the deflected surface is the wing, the tail is needed; exchange flaps and elevator",
    ):
        aerodb.from_datcom(
            craft, clean=make_case(), elevator=flapped(make_case(), "wing", [-20, 0, 10])
        )


@pytest.mark.nightly
def test_a_loop_over_conditions_is_warned_about(craft, make_case):
    looped = flapped(make_case(), "tail", [-20, 0, 10], machs=(0.2, 0.4))
    with pytest.warns(
        AeromatchWarning,
        match=r"elevator: D\(CM\) comes from a loop over several flight conditions",
    ):
        aerodb.from_datcom(craft, clean=make_case(), elevator=looped)
    one_by_one = [flapped(make_case(), "tail", [-20, 0, 10], machs=(mach,)) for mach in (0.2, 0.4)]
    for case in one_by_one:
        case["static"] = case["static"].to_dataset().isel(condition=[0])
        case["dynamic"] = case["dynamic"].to_dataset().isel(condition=[0])
    db = aerodb.from_datcom(craft, clean=make_case(), elevator=one_by_one)
    np.testing.assert_array_equal(db["CL/elevator"]["mach"], [0.0, 0.2, 0.4])


@pytest.mark.nightly
def test_increments_follow_the_moment_reference_too(craft, make_case):
    moved = dataclasses.replace(craft, reference=(-3.4, 0.0, 0.0))
    db = aerodb.from_datcom(
        moved,
        clean=make_case(),
        elevator=flapped(make_case(), "tail", [-20, 0, 10]),
        move_reference=True,
    )
    node = (
        db["Cm/elevator"]["value"]
        .sel(mach=0.2)
        .sel(delta_e=np.radians(10), alpha=0.0, method="nearest")
    )
    # 0.4 m of arm ahead of the new point, lift up: nose up by CL d/cbar at alpha 0
    np.testing.assert_allclose(node, np.radians(10) * (-1.6 + 0.5 * 0.4 / 1.6), rtol=1e-12)
