"""The moment reference moved: vector algebra, the listing's other way, and the flight itself as
judges.
"""

import dataclasses

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from aerodb.store.effects import Effect, transfer_moments
from flightmech import axes, terms
from flightmech.aircraft.engine import Engine
from flightmech.errors import SchemaError

ALPHA = np.radians(np.arange(-8.0, 21.0, 2.0))
MACH = [0.2, 0.6]
OLD, NEW = np.array([-3.0, 0.0, 0.2]), np.array([-3.25, 0.0, 0.05])
S, CBAR, B = 17.0, 1.7, 10.3
ORIGIN = {
    "title": "t",
    "aircraft": "t",
    "S": S,
    "cbar": CBAR,
    "b": B,
    "x_ref": 0.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
}


@pytest.fixture(scope="module")
def trainer():
    """Return a database whose forces depend on alpha, on controls, rates, flaps, gear and
    height.
    """
    over = {"mach": MACH, "alpha": ALPHA}
    ground = [[0.1, 0.2], [0.0, 0.0]]
    K1 = terms.make_term([0.0, 0.4, 1.0], {"gear": [0.0, 0.5, 1.0]})["value"]
    leaves = {
        "CL/basic": terms.make_term(
            np.outer([1.0, 1.1], 0.2 + 5 * ALPHA - 9 * ALPHA**3), over, stderr=0.05, source="datcom"
        ),
        "CL/flap": terms.make_term(
            [0.0, 0.4], {"delta_f": [0.0, 0.6]}, stderr=[0.0, 0.08], source="flight"
        ),
        "CL/elevator": terms.make_term(
            [-0.15, 0.0, 0.1], {"delta_e": [-0.4, 0.0, 0.3]}, stderr=0.01, source="datcom"
        ),
        "CL/qhat": terms.make_term(
            [8.0, 8.4], {"mach": MACH}, ["qhat"], stderr=2.0, source="datcom"
        ),
        "CL/alphadothat": terms.make_term(
            3.0, regressors=["alphadothat"], stderr=1.0, source="datcom"
        ),
        "CL/ground": terms.make_term(
            ground, {"h_agl": [1.0, 20.0], "alpha": [0.0, 0.2]}, stderr=0.02, source="datcom"
        ),
        "CD/basic": terms.make_term(
            0.02 + 1.1 * ALPHA**2, {"alpha": ALPHA}, stderr=0.003, source="datcom"
        ),
        "CD/gear": terms.make_term(0.03, K1=K1, stderr=0.01, source="judgement"),
        "CY/beta": terms.make_term(
            -0.5 + ALPHA, {"alpha": ALPHA}, ["beta"], stderr=0.1, source="datcom"
        ),
        "CY/rudder": terms.make_term(
            [-0.06, 0.0, 0.06], {"delta_r": [-0.4, 0.0, 0.4]}, stderr=0.01, source="datcom"
        ),
        "CY/phat": terms.make_term(-0.06, regressors=["phat"], stderr=0.05, source="datcom"),
        "Cl/beta": terms.make_term(-0.08, regressors=["beta"], stderr=0.02, source="datcom"),
        "Cl/phat": terms.make_term(
            -0.46 - 0.1 * ALPHA, {"alpha": ALPHA}, ["phat"], stderr=0.05, source="datcom"
        ),
        "Cm/basic": terms.make_term(
            [0.1, -0.05, -0.3], {"alpha": [-0.15, 0.05, 0.36]}, stderr=0.02, source="datcom"
        ),
        "Cm/elevator": terms.make_term(
            np.outer([1, 1.1], [0.4, 0.0, -0.3]),
            {"mach": MACH, "delta_e": [-0.4, 0.0, 0.3]},
            stderr=0.04,
            source="flight",
        ),
        "Cm/qhat": terms.make_term(-17.0, regressors=["qhat"], stderr=4.0, source="datcom"),
        "Cn/beta": terms.make_term(0.06, regressors=["beta"], stderr=0.01, source="datcom"),
        "Cn/rudder": terms.make_term(-0.07, regressors=["delta_r"], stderr=0.01, source="datcom"),
        "Cn/rhat": terms.make_term(-0.1, regressors=["rhat"], stderr=0.03, source="datcom"),
        "Ch_e/delta": terms.make_term(-0.3, regressors=["delta_e"], stderr=0.05, source="datcom"),
    }
    place = dict(zip(("x_ref", "y_ref", "z_ref"), OLD))
    root = {
        **ORIGIN,
        **place,
        "title": "trainer",
        "force_axes": "stability",
        "absent": "Cm/flap CL/gear",
    }
    return aerodb.make_database(leaves, **root)


@pytest.fixture(scope="module")
def moved(trainer):
    return aerodb.transform.move_reference(trainer, NEW, note="new datum")


@pytest.mark.slow
def test_every_effect_is_transferred_as_the_builder_does_it(trainer, moved):
    """At the breakpoints, against the cross product of `aerodb.store.effects`."""
    before, after = aerodb.terms(trainer), aerodb.terms(moved)
    alpha = before["CL/basic"]["alpha"].sel(alpha=slice(-0.15, 0.36))
    CL, CD, Cm = (before[f"{c}/basic"]["value"].interp(alpha=alpha) for c in ("CL", "CD", "Cm"))
    by = transfer_moments(
        Effect("basic", {"CL": CL, "CD": CD, "Cm": Cm}), OLD - NEW, CBAR, B, alpha
    )
    xr.testing.assert_allclose(
        after["Cm/basic"]["value"].sel(alpha=alpha),
        by.tables["Cm"].transpose("alpha", "mach"),
        atol=1e-14,
    )


def test_terms_that_are_made_and_joined(trainer, moved):
    after = aerodb.terms(moved)
    made = set(after) - set(aerodb.terms(trainer))
    # Cl and Cn of the rudder: a force over delta_r cannot join a moment per delta_r
    assert made == {
        "Cm/flap",
        "Cm/alphadothat",
        "Cm/ground",
        "Cm/gear",
        "Cl/rudder",
        "Cn/rudder_moved",
        "Cn/phat",
    }
    assert moved.attrs["absent"] == "CL/gear"
    assert after["Cm/gear"]["K1"].equals(after["CD/gear"]["K1"])
    assert after["Cm/elevator"].sizes["delta_e"] == 3
    assert set(after["Cm/elevator"].dims) == {"mach", "delta_e", "alpha"}
    assert after["Cm/flap"].attrs["comment"] == "moment of CL/flap about the moment reference point"
    xr.testing.assert_identical(after["Ch_e/delta"], aerodb.terms(trainer)["Ch_e/delta"])
    assert [float(moved.attrs[key]) for key in ("x_ref", "y_ref", "z_ref")] == NEW.tolist()
    assert (
        moved.attrs["history"]
        == "move_reference: from (-3.0000, 0.0000, 0.2000) to (-3.2500, 0.0000, 0.0500) m (new "
        "datum)"
    )
    assert aerodb.check(moved) == []


def test_standard_errors_and_sources_go_along(trainer, moved):
    after = aerodb.terms(moved)
    dx, _, dz = OLD - NEW
    qhat = after["Cm/qhat"].sel(mach=0.2)
    lever = (dz * np.sin(qhat["alpha"]) + dx * np.cos(qhat["alpha"])) / CBAR
    np.testing.assert_allclose(qhat["value"], -17.0 + 8.0 * lever, rtol=1e-14)
    np.testing.assert_allclose(qhat["stderr"], np.hypot(4.0, 2.0 * lever), rtol=1e-14)
    assert (qhat["source"] == 0).all()
    at = after["Cm/elevator"]["source"].sel(mach=0.2)
    assert (at.sel(delta_e=-0.4) == 2).all()  # of flight and DATCOM: judgement
    assert (at.sel(delta_e=0.0) == 1).all()  # no force: as it was
    assert (after["Cm/flap"]["source"].sel(delta_f=0.6) == 1).all()


def test_heights_are_counted_from_the_new_point(trainer, moved):
    np.testing.assert_allclose(
        aerodb.terms(moved)["CL/ground"]["h_agl"], [1.15, 20.15]
    )  # the point rose by 0.15 m
    assert (
        aerodb.terms(moved)["CL/ground"]["h_agl"].attrs
        == aerodb.terms(trainer)["CL/ground"]["h_agl"].attrs
    )


@pytest.mark.slow
def test_the_flight_does_not_change(trainer, moved):
    """The same aeroplane, described about two points, flies the same in the kernel."""
    engine, cg = Engine((0.3, 0.0, 0.1)), np.array([0.05, 0.0, 0.1])
    craft = flightmech.Aircraft(
        "t",
        S,
        CBAR,
        B,
        2500.0,
        1e4,
        8e3,
        15e3,
        Ixz=500.0,
        reference=tuple(OLD),
        cg=tuple(cg),
        engines=(engine,),
    )
    d = OLD - NEW
    there = dataclasses.replace(
        craft,
        reference=tuple(NEW),
        cg=tuple(cg + d),
        engines=(dataclasses.replace(engine, position=tuple(np.array(engine.position) + d)),),
    )
    fine = aerodb.transform.move_reference(trainer, NEW, tolerance=1e-6)
    time = np.arange(0.0, 6.01, 0.02)
    controls = {
        "delta_e": np.where(time > 1, -0.03, 0.0),
        "delta_r": 0.05 * np.sin(2 * time),
        "delta_f": 0.3,
        "gear": 0.6,
    }
    inputs = xr.Dataset(
        {name: ("time", np.broadcast_to(x, time.shape)) for name, x in controls.items()},
        {"time": time},
    )
    start = {
        "init.V": 80.0,
        "init.h": 1000.0,
        "init.alpha": 0.05,
        "init.theta": 0.05,
        "mode.engine": 2,
    }
    runs = [
        flightmech.simulate(flightmech.compile(aircraft, db), inputs, start)
        for aircraft, db in ((craft, trainer), (there, fine), (there, moved))
    ]
    for name in ("theta", "phi", "alpha", "beta", "q", "p"):
        reach = float(np.ptp(runs[0][name].values))
        assert reach > 0.01
        # a moment error of the tolerance is that share of the moment a force has: the motion
        # differs by about as much
        assert float(np.abs(runs[1][name] - runs[0][name]).max()) < 1e-4 * reach
        assert float(np.abs(runs[2][name] - runs[0][name]).max()) < 1e-2 * reach


@pytest.mark.nightly
def test_another_listing_of_the_same_aeroplane_agrees(make_case, craft):
    """Built about B at once, or about A and moved to B with its flow angles: first order in the
    rates, central differences in alpha.
    """
    case = make_case(
        S=craft.S,
        cbar=craft.cbar,
        b=craft.b,
        CD=0.02 + 1.1 * np.radians(np.arange(-8.0, 17.0, 2.0)) ** 2,
    )
    A, C = (
        dataclasses.replace(craft, reference=point)
        for point in ((-3.1, 0.0, 0.1), (-2.7, 0.0, -0.2))
    )
    at_A, at_B = (
        aerodb.from_datcom(aircraft, clean=case, move_reference=True) for aircraft in (A, C)
    )
    new = aerodb.transform.move_reference(at_A, C.reference, flow="moved", tolerance=0.5)
    wide = aerodb.terms(at_B)
    for name in ("Cm/basic", "Cl/beta", "Cn/beta", "Cm/alphadothat"):
        there = aerodb.terms(new)[name]["value"].interp(
            alpha=wide[name]["alpha"], mach=wide[name]["mach"]
        )
        np.testing.assert_allclose(
            there.transpose(*wide[name]["value"].dims),
            wide[name]["value"],
            atol=2e-4 * float(np.abs(wide[name]["value"]).max()),
        )
    inner = {"alpha": slice(ALPHA[1], np.radians(14.5))}  # ends have one-sided differences
    for name in (
        "CL/qhat",
        "CD/qhat",
        "Cm/qhat",
        "CY/phat",
        "Cl/phat",
        "Cn/phat",
        "CY/rhat",
        "Cl/rhat",
        "Cn/rhat",
    ):
        expected = wide[name]["value"].sel(inner)
        found = (
            aerodb.terms(new)[name]["value"]
            .interp(alpha=expected["alpha"])
            .transpose(*expected.dims)
        )
        kept = (
            aerodb.terms(at_A)[name]["value"]
            .interp(alpha=expected["alpha"])
            .transpose(*expected.dims)
        )
        change = float(np.abs(expected - kept).max())
        assert float(np.abs(found - expected).max()) < 0.01 * change, name
    assert new.attrs["history"].endswith("m, flow angles with it")


@pytest.mark.nightly
def test_the_whole_database_of_the_t37(t37_db):
    """Thirty-odd terms, random conditions: the cross product of the summed forces within the
    tolerance.
    """
    old = np.array([t37_db.attrs[key] for key in ("x_ref", "y_ref", "z_ref")])
    point, rng, count = old + [-0.15, 0.0, 0.1], np.random.default_rng(1), 500
    reach = {
        "alpha": (-0.13, 0.34),
        "mach": (0.0, 0.6),
        "h": (0.0, 6000.0),
        "delta_f": (0.0, 0.69),
        "delta_e": (-0.43, 0.26),
        "h_agl": (1, 25),
    }
    reach |= {
        "delta_a": (-0.3, 0.3),
        "beta": (-0.2, 0.2),
        "phat": (-0.05, 0.05),
        "rhat": (-0.02, 0.02),
    }
    reach |= dict.fromkeys(("qhat", "alphadothat"), (-0.005, 0.005))
    at = {name: rng.uniform(*ends, count) for name, ends in reach.items()}
    new = aerodb.transform.move_reference(t37_db, point)

    def six(db, conditions):
        found = [
            aerodb.evaluate(db, c, "clamp", **conditions)
            for c in ("CL", "CD", "CY", "Cl", "Cm", "Cn")
        ]
        CL, CD, CY, *moments = (np.broadcast_to(c, count) for c in found)
        return axes.stability_to_body(np.stack([-CD, CY, -CL], axis=-1), at["alpha"]), np.stack(
            moments, axis=-1
        )

    lengths = np.array([t37_db.attrs[key] for key in ("b", "cbar", "b")])
    F, M = six(t37_db, at)
    expected = axes.transfer_moment(M * lengths, F, old, point) / lengths
    F_new, found = six(new, at | {"h_agl": at["h_agl"] - 0.1})
    np.testing.assert_allclose(F_new, F, atol=1e-14)
    assert np.abs(expected - M)[:, 1].max() > 0.1
    # 1e-3 of the largest lift, 1.94, for each of six terms of lift; seen 2.9e-4
    assert np.abs(found - expected)[:, 1].max() < 6 * 1e-3 * 1.94 * np.hypot(0.15, 0.1) / lengths[1]
    np.testing.assert_allclose(found[:, [0, 2]], expected[:, [0, 2]], atol=1e-12)
    assert aerodb.check(new) == []
    assert aerodb.store.undo_edits(new).identical(t37_db)


@pytest.mark.nightly
def test_moves_do_not_pile_up(trainer, moved):
    directly = aerodb.transform.move_reference(trainer, [-2.8, 0.0, 0.0])
    further = aerodb.transform.move_reference(moved, [-2.8, 0.0, 0.0])
    for name, leaf in aerodb.terms(directly).items():
        xr.testing.assert_identical(leaf.drop_attrs(), aerodb.terms(further)[name].drop_attrs())
    assert aerodb.store.undo_edits(further).identical(moved)
    assert aerodb.store.undo_edits(further, 2).identical(trainer)
    back = aerodb.transform.move_reference(further, OLD)
    assert list(aerodb.terms(back)) == list(aerodb.terms(trainer))
    assert back.attrs["absent"] == trainer.attrs["absent"]
    for name, leaf in aerodb.terms(back).items():
        xr.testing.assert_identical(leaf, aerodb.terms(trainer)[name])


def test_body_axes_need_no_breakpoints():
    leaves = {
        "CZ/basic": terms.make_term([-0.2, -1.2], {"alpha": [0.0, 0.2]}),
        "CX/elevator": terms.make_term(-0.1, regressors=["delta_e"]),
    }
    new = aerodb.terms(
        aerodb.transform.move_reference(
            aerodb.make_database(leaves, **ORIGIN, force_axes="body"), [0.3, 0.5, -0.2]
        )
    )
    np.testing.assert_array_equal(new["Cm/basic"]["alpha"], [0.0, 0.2])
    d = np.array([-0.3, -0.5, 0.2])
    F = np.array([[0.0, 0.0, -0.2], [0.0, 0.0, -1.2]])
    M = axes.transfer_moment(np.zeros(3), F, d, np.zeros(3)) / [B, CBAR, B]
    np.testing.assert_allclose(new["Cm/basic"]["value"], M[:, 1], rtol=1e-14)
    np.testing.assert_allclose(new["Cl/basic"]["value"], M[:, 0], rtol=1e-14)
    assert float(new["Cn/elevator"]["value"]) == pytest.approx(-d[1] * -0.1 / B)
    assert "Cn/basic" not in new


def test_an_angle_that_no_table_has_gets_its_full_range():
    leaves = {"CL/qhat": terms.make_term(8.0, regressors=["qhat"])}
    made = aerodb.terms(
        aerodb.transform.move_reference(
            aerodb.make_database(leaves, **ORIGIN, force_axes="stability"), [0.3, 0.0, 0.0]
        )
    )["Cm/qhat"]
    alpha = np.linspace(-1.5, 1.5, 301)
    found = terms.evaluate_term(made, {"alpha": alpha, "qhat": 1.0})
    assert np.abs(found - 8.0 * -0.3 * np.cos(alpha) / CBAR).max() < 1e-3 * 8.0 * 0.3 / CBAR


@pytest.mark.parametrize("rules", [("linear", "hold"), ("hold", "linear")])
def test_a_term_with_another_rule_beyond_its_ends_is_not_joined(rules):
    """Force and moment keep their own rule: beyond the tables the moment about the new point is
    that of the continued or held force, but for the change of the lever there (below 1.5 %).
    """
    of_force, of_moment = rules
    points = {"alpha": [-0.1, 0.2]}
    leaves = {
        "CL/basic": terms.make_term([-0.5, 1.0], points, outside=of_force),
        "Cm/basic": terms.make_term([0.1, -0.1], points, outside=of_moment),
    }
    db = aerodb.make_database(leaves, **ORIGIN, force_axes="stability")
    moved = aerodb.transform.move_reference(db, (0.5, 0.0, 0.0))
    alpha = 0.3
    at = {"outside": "clamp", "alpha": alpha}
    lift = aerodb.evaluate(db, "CL", **at)
    expected = aerodb.evaluate(db, "Cm", **at) - 0.5 * lift * np.cos(alpha) / CBAR
    found = aerodb.evaluate(moved, "Cm", **at)
    assert found == pytest.approx(expected, rel=0.02)
    assert set(aerodb.terms(moved)) == {"CL/basic", "Cm/basic", "Cm/basic_moved"}


@pytest.mark.parametrize(
    ("point", "options", "text"),
    [
        ([0.0, 0.0], {}, "give x, y, z from the drawing datum"),
        ([0.0, 0.0, np.nan], {}, "three finite numbers in m"),
        (NEW, {"tolerance": 0.0}, "tolerance is 0.0; give a share"),
        (NEW, {"flow": "turned"}, "flow is 'turned'; allowed: kept, moved"),
        ([-3.0, 0.1, 0.2], {"flow": "moved"}, "parallel to that of symmetry; keep y"),
    ],
)
def test_what_cannot_be_moved_is_refused(trainer, point, options, text):
    with pytest.raises(SchemaError, match=text):
        aerodb.transform.move_reference(trainer, point, **options)


def test_a_table_with_too_many_axes_is_named():
    axes4 = {"h_agl": [1.0, 9.0], "delta_f": [0.0, 0.5], "mach": [0.1, 0.3], "delta_e": [-0.1, 0.1]}
    leaves = {
        "CL/basic": terms.make_term(1.0),
        "CL/much": terms.make_term(np.ones((2, 2, 2, 2)), axes4),
    }
    with pytest.raises(
        SchemaError,
        match="Cm of CL/much: would have the axes h_agl delta_f mach delta_e alpha; at most 4 are "
        "allowed",
    ):
        aerodb.transform.move_reference(
            aerodb.make_database(leaves, **ORIGIN, force_axes="stability"), [0.3, 0.0, 0.0]
        )
