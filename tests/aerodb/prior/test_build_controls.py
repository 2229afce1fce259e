"""Spoilers, differential tail, stabilizer, hinge moments and tabs of a jet against their pages.

A printed number is known to half a unit of its last digit; tolerances are that, unless stated
otherwise.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.cli.group import db as group
from flightmech import terms
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.units import DEGREE

CORPUS = Path(__file__).parents[4] / "shared" / "data" / "datcom"
AIRCRAFT = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"


@pytest.fixture(scope="module")
def clean(corpus):
    return corpus("ce500_clean")


@pytest.fixture(scope="module")
def spoiled(jet, corpus, clean):
    with pytest.warns(AeromatchWarning, match="Cl 0.008136 is printed for a spoiler of no height"):
        return aerodb.from_datcom(
            jet, clean=clean, spoilers=corpus("spoilers_diff_tail", "FLAP SPOILER ON WING")
        )


@pytest.fixture(scope="module")
def tailed(jet, corpus, clean):
    return aerodb.from_datcom(
        jet,
        clean=clean,
        differential_tail=corpus("spoilers_diff_tail", "DIFFERENTIAL HORIZONTAL STABILIZER"),
    )


@pytest.fixture(scope="module")
def hinged(jet, corpus, clean):
    """Return the database of control_tab.pdas.out: (CH)A -4.871E-03, (CH)D -8.157E-03 at -20 and
    -7.535E-03 at 10 deg, per degree.
    """
    listing = corpus("control_tab", build=".pdas")
    return aerodb.from_datcom(jet, clean=clean, elevator=listing, tabs=listing)


def table(db, name, **where):
    """Return the value of a term at a node, or along the axes that are not given."""
    return db[name]["value"].sel(where, method="nearest", tolerance=1e-6).values


def in_stability_axes(db, contribution, alpha, **where):
    """Return rolling and yawing moment turned back to DATCOM's axes."""
    Cl, Cn = (table(db, f"{c}/{contribution}", alpha=alpha, **where) for c in ("Cl", "Cn"))
    return Cl * np.cos(alpha) + Cn * np.sin(alpha), Cn * np.cos(alpha) - Cl * np.sin(alpha)


def flown(jet):
    """Return an aircraft file's aeroplane with the reference quantities of the jet."""
    return dataclasses.replace(
        flightmech.read_aircraft(AIRCRAFT), S=jet.S, cbar=jet.cbar, b=jet.b, reference=jet.reference
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mach", "Cl", "Cn"), [(0.3, 1.3049e-2, 3.408e-3), (1.6, 5.0671e-3, 3.132e-3)]
)
def test_left_spoiler_rolls_left(spoiled, mach, Cl, Cn):
    """spoilers_diff_tail.out, DS/C 0.09: (CL)ROLL 1.3049E-02 and CN 3.408E-03 at Mach 0.3,
    5.0671E-03 and 3.132E-03 at Mach 1.6.
    """
    for side in (1.0, -1.0):
        found = in_stability_axes(spoiled, "spoiler", 8 * DEGREE, mach=mach, delta_s=side * 0.09)
        assert found == pytest.approx((-side * Cl, -side * Cn), abs=5e-7)


def test_no_height_no_moment(spoiled):
    """6.9082E-03 is printed at DS/C 0, 0.03 and 0.06 alike: the first is zero by definition, the
    others stay as printed.
    """
    roll = [
        float(in_stability_axes(spoiled, "spoiler", 0.0, mach=0.3, delta_s=height)[0])
        for height in (0.0, 0.03, 0.06)
    ]
    assert roll == pytest.approx([0.0, -6.9082e-3, -6.9082e-3], abs=5e-8)
    assert (spoiled["Cl/spoiler"]["stderr"].sel(delta_s=0.0) == 0.0).all()


def test_a_yawing_moment_without_method_leaves_the_roll(spoiled):
    """Mach 0.7 prints CN NDM: it is not a node of Cn, and counts as zero in the roll, 1.5369E-02,
    turned to body axes.
    """
    np.testing.assert_array_equal(spoiled["Cn/spoiler"]["mach"], [0.0, 0.3, 1.6])
    found = table(spoiled, "Cl/spoiler", mach=0.7, alpha=8 * DEGREE, delta_s=-0.09)
    assert found == pytest.approx(1.5369e-2 * np.cos(8 * DEGREE), abs=5e-7)


@pytest.mark.slow
def test_a_spoiler_rolls_the_aeroplane_in_flight(spoiled, jet):
    sim = flightmech.compile(flown(jet), spoiled)
    at = {"init.V": 100.0, "init.h": 1000.0, "init.alpha": 0.0, "mode.engine": 2.0}
    inputs = xr.Dataset({"delta_s": ("time", [0.09, 0.09])}, {"time": [0.0, 0.01]})
    start = flightmech.simulate(sim, inputs, at, terms=True).isel(time=0)
    given = {"mach": float(start["mach"]), "alpha": 0.0, "delta_s": 0.09}
    expected = float(
        terms.evaluate_term(spoiled["Cl/spoiler"].to_dataset(), given, outside="clamp")
    )
    assert float(start["contribution"].sel(term="Cl/spoiler")) == pytest.approx(expected, rel=1e-9)
    assert expected < 0


@pytest.mark.nightly
def test_slot_deflector_of_another_case_of_the_file(jet, corpus, clean):
    """SPOILER SLOT DEFLECTOR, Mach 0.3, DS/C 0.06: the heading names DD/C too; 0.01082 is printed
    at height zero of Mach 0.3 or 0.7.
    """
    case = corpus("spoilers_diff_tail", "SPOILER SLOT DEFLECTOR")
    page = case.to_datatree()["spoiler"].to_dataset().isel(condition=0, deflection=3)
    with pytest.warns(AeromatchWarning, match="is printed for a spoiler of no height"):
        db = aerodb.from_datcom(jet, clean=clean, spoilers=case)
    assert table(db, "Cl/spoiler", mach=0.3, alpha=0.0, delta_s=-0.09) == pytest.approx(
        float(page["Cl"]), abs=1e-12
    )
    assert db["Cl/spoiler"].attrs["comment"].startswith("spoiler-slot-deflector")


@pytest.mark.slow
def test_right_trailing_edge_down_rolls_left(tailed):
    """Mach 0.3, alpha 8, left 10 and right -10 deg: 1.359E-02; there is no yawing moment."""
    found = table(tailed, "Cl/differential_tail", mach=0.3, alpha=8 * DEGREE, delta_d=10 * DEGREE)
    assert found == pytest.approx(-1.359e-2 * np.cos(8 * DEGREE), abs=5e-6)
    assert "Cn/differential_tail" in tailed.attrs["absent"].split()


def test_the_transonic_list_holds_for_every_alpha(tailed):
    """Mach 0.7 lists 1.8687E-02 for left 10 and right -10 deg, without alpha."""
    found = (
        tailed["Cl/differential_tail"]["value"]
        .sel(mach=0.7)
        .sel(delta_d=-10 * DEGREE, method="nearest")
    )
    inner = found["alpha"].values[1:-1]  # the ends are those of CL/basic, their values held
    np.testing.assert_allclose(found[1:-1], 1.8687e-2 * np.cos(inner), atol=5e-7)
    assert (
        "mach 0.7: the page prints one value for all alphas"
        in tailed["Cl/differential_tail"].attrs["comment"]
    )


@pytest.mark.nightly
def test_it_is_no_aileron_and_an_aileron_is_no_tail(jet, corpus, clean):
    with pytest.raises(SchemaError, match="ailerons are needed"):
        aerodb.from_datcom(
            jet,
            clean=clean,
            aileron=corpus("spoilers_diff_tail", "DIFFERENTIAL HORIZONTAL STABILIZER"),
        )
    with pytest.raises(SchemaError, match="ailerons go to aileron="):
        aerodb.from_datcom(jet, clean=clean, differential_tail=corpus("ce500_aileron"))


@pytest.mark.nightly
def test_stabilizer_meets_the_tail_lift_at_trim(jet, corpus, clean):
    """ce500_trim.out, second case, Mach 0.25: the slope of the tail alone gives the printed tail
    lift at the printed incidence of trim.

    The incidence has one decimal, worth 0.001 of lift, the lift three; 0.0012 seen between -8 and 8
    deg.
    """
    case = corpus("ce500_trim").cases[1]
    db = aerodb.from_datcom(jet, clean=clean, elevator=case, altitude=0.0)
    tree = case.to_datatree()
    page, flow = (
        tree[leaf].to_dataset().isel(condition=0) for leaf in ("trim_stabilizer", "downwash")
    )
    inside = np.abs(page["alpha"].values) < 8.5 * DEGREE
    CL = table(db, "CL/elevator", mach=0.25) * (page["alpha"] - flow["epsilon"] + page["i_tail"])
    np.testing.assert_allclose(CL[inside], page["CL_tail_trim"][inside], atol=0.0016)
    arm = float(
        db["Cm/elevator"]["value"].sel(mach=0.25) / db["CL/elevator"]["value"].sel(mach=0.25)
    )
    assert arm == pytest.approx(
        -0.1143 / 0.044, rel=0.03
    )  # alpha 8, tail at trim: CM -0.1143, CL 0.044 with two digits
    assert db["CL/elevator"].attrs["regressors"] == "delta_e"
    assert (db["CL/elevator"]["source"] == 2).all()


@pytest.mark.slow
def test_hinge_moment_of_deflection(hinged):
    assert table(hinged, "Ch_e/delta", mach=0.25, delta_e=-20 * DEGREE) == pytest.approx(
        20 * 8.157e-3, abs=20 * 5e-7
    )
    assert table(hinged, "Ch_e/delta", mach=0.25, delta_e=10 * DEGREE) == pytest.approx(
        -10 * 7.535e-3, abs=10 * 5e-7
    )
    assert table(hinged, "Ch_e/delta", mach=0.25, delta_e=0.0) == 0.0
    assert (hinged["Ch_e/delta"]["stderr"].sel(delta_e=0.0) == 0.0).all()


@pytest.mark.slow
def test_hinge_moment_of_the_tails_own_angle_of_attack(hinged):
    """Downwash 5.471 deg at alpha 8, stabilizer at 0.5 deg (ALIH): the tail flies at 3.029 deg."""
    found = table(hinged, "Ch_e/alpha", mach=0.25, alpha=8 * DEGREE)
    assert found == pytest.approx(-4.871e-3 * (8 - 5.471 + 0.5), abs=3.03 * 5e-7 + 4.871e-3 * 5e-4)


@pytest.mark.nightly
def test_hinge_moments_do_not_depend_on_the_reference_of_the_aeroplane(jet, corpus, clean, hinged):
    listing = corpus("control_tab", build=".pdas")
    with pytest.warns(AeromatchWarning, match="not the reference quantities"):
        other = aerodb.from_datcom(
            dataclasses.replace(jet, S=30.0, cbar=2.2), clean=clean, elevator=listing, tabs=listing
        )
    for name in ("Ch_e/alpha", "Ch_e/delta", "Ch_e/tab", "Ch_e/tab_gearing"):
        np.testing.assert_array_equal(other[name]["value"], hinged[name]["value"])


def test_tab_gives_the_engineer_his_B4_back(hinged):
    """The deck gives B4 -0.006 per degree; the streams are printed with three digits."""
    assert float(hinged["Ch_e/tab"]["value"]) * DEGREE == pytest.approx(-0.006, rel=2e-3)
    assert hinged["Ch_e/tab"].attrs["regressors"] == "delta_t"


def test_gearing_of_the_tab(hinged):
    """DUE TO GEARING, first line, alpha -6: -20 deg stands with one decimal, -15 deg as 6.74E-02,
    -10 deg as 4.49E-02.
    """
    for delta, value in ((-15, 6.74e-2), (-10, 4.49e-2)):
        assert table(
            hinged, "Ch_e/tab_gearing", alpha=-6 * DEGREE, delta_e=delta * DEGREE
        ) == pytest.approx(value, abs=5e-5)


@pytest.mark.nightly
def test_tab_locked_stands_in_for_the_page(jet, corpus, clean):
    """Deck: B1 -0.004 and B3 -0.007 per degree."""
    db = aerodb.from_datcom(jet, clean=clean, tabs=corpus("control_tab"))
    assert float(db["Ch_e/delta"]["value"]) * DEGREE == pytest.approx(-0.004, rel=2e-3)
    assert float(db["Ch_e/alpha"]["value"]) * DEGREE == pytest.approx(-0.007, rel=2e-3)
    assert {"CL/tab", "CD/tab", "Cm/tab"} <= set(db.attrs["absent"].split())


@pytest.mark.nightly
def test_hinge_moments_are_evaluated_and_do_not_move_the_aeroplane(hinged, jet):
    given = {"mach": 0.25, "alpha": 8 * DEGREE, "delta_e": 0.0, "delta_t": 10 * DEGREE}
    parts = aerodb.contributions(hinged, "Ch_e", given)
    assert set(parts) == {"alpha", "delta", "tab", "tab_gearing"}
    assert parts["tab"] == pytest.approx(-0.06, rel=2e-3)
    sim = flightmech.compile(flown(jet), hinged)
    bare = flightmech.compile(
        flown(jet),
        aerodb.delete_terms(
            hinged, [name for name in aerodb.terms(hinged) if name.startswith("Ch_")]
        ),
    )
    assert {name for name in sim.terms if name.startswith("Ch_")} == {
        f"Ch_e/{name}" for name in parts
    }
    inputs = xr.Dataset({"delta_e": ("time", [0.0, -0.05, 0.0])}, {"time": [0.0, 0.2, 0.4]})
    at = {"init.V": 100.0, "init.h": 1000.0, "mode.engine": 2.0}
    assert flightmech.simulate(sim, inputs, at)["q"].equals(
        flightmech.simulate(bare, inputs, at)["q"]
    )


@pytest.mark.nightly
def test_without_downwash_the_angle_of_attack_of_the_tail_is_not_known(jet, corpus, clean):
    trees = [listing[0].to_datatree() for listing in (clean, corpus("control_tab", build=".pdas"))]
    for tree in trees:
        del tree["downwash"]
    with pytest.warns(AeromatchWarning) as caught:
        db = aerodb.from_datcom(jet, clean=trees[0], elevator=trees[1])
    assert any(
        "no listing with downwash is at hand; Ch_e/alpha is left absent" in str(warning.message)
        for warning in caught
    )
    assert "Ch_e/alpha" in db.attrs["absent"].split()
    assert "Ch_e/delta" in aerodb.terms(db)


@pytest.mark.nightly
def test_aileron_hinge_from_a_flap_page_of_the_wing(jet, corpus, clean):
    """ce500_flaps.out, second case, Mach 0.15, 0 m: plain flap of the wing, taken for an
    aileron.
    """
    case = corpus("ce500_flaps").cases[1]
    page = case.to_datatree()["symflp"].to_dataset().isel(condition=0)
    db = aerodb.from_datcom(jet, clean=clean, aileron_hinge=case, altitude=0.0)
    assert float(page["mach"]) == 0.15
    assert table(db, "Ch_a/alpha", mach=0.15) == float(page["Ch_alpha"][0])
    last = page.isel(delta=-1)
    assert table(db, "Ch_a/delta", mach=0.15, delta_a=float(last["delta"])) == pytest.approx(
        float(last["Ch_delta"] * last["delta"])
    )
    assert "CL/flap" in db.attrs["absent"].split()
    with pytest.raises(SchemaError, match="the deflected surface is the tail, the wing is needed"):
        aerodb.from_datcom(jet, clean=clean, aileron_hinge=corpus("ce500_elevator"))


@pytest.mark.nightly
def test_one_case_of_a_file_on_the_command_line(corpus, tmp_path):
    clean, tail = (
        str(CORPUS / name / f"{name}.out") for name in ("ce500_clean", "spoilers_diff_tail")
    )
    corpus("ce500_clean")  # skips without listings
    case = "DIFFERENTIAL HORIZONTAL STABILIZER"
    arguments = [
        "build",
        str(AIRCRAFT),
        "--clean",
        clean,
        "-o",
        str(tmp_path / "jet.nc"),
        "--json",
        "--move-reference",
        "--differential-tail",
    ]
    done = CliRunner().invoke(group, [*arguments, f"{tail}:{case}"], catch_exceptions=False)
    assert done.exit_code == 0
    assert "Cl/differential_tail" in aerodb.terms(aerodb.open(tmp_path / "jet.nc"))
    wrong = CliRunner().invoke(group, [*arguments, f"{tail}x:{case}"])
    assert wrong.exit_code == 2
    assert "write FILE, or FILE:CASE for one case of it" in wrong.output
