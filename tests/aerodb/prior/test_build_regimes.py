"""Speed regimes, rates from the downwash, and the normalisation of rates, on listings of jets."""

import dataclasses

import numpy as np
import pytest

import aerodb
from flightmech.errors import AeromatchWarning
from flightmech.units import DEGREE


@pytest.fixture(scope="module")
def fighter(craft, corpus):
    """Return aeroplane and case of fighter_regimes.out: Mach 0.5, transonic 0.9 and 1.2, supersonic
    1.6 and 2.5, each at its altitude.
    """
    case = corpus("fighter_regimes")[0]
    at = case.to_datatree().attrs
    return dataclasses.replace(
        craft, S=at["S"], cbar=at["cbar"], b=at["b"], reference=(-at["x_cg"], 0.0, -at["z_cg"])
    ), case


@pytest.fixture(scope="module")
def fighter_db(fighter):
    with pytest.warns(AeromatchWarning) as caught:
        db = aerodb.from_datcom(fighter[0], clean=fighter[1])
    return db, [str(warning.message) for warning in caught]


@pytest.mark.nightly
def test_the_tail_share_gives_the_printed_alpha_dot_derivatives(jet, corpus):
    """ce500_build.out, Mach 0.2 and 0.5: without its dynamic page, CLAD within 0.4 % and CMAD
    within 0.7 % up to 12 deg.

    The arm of the program is that of the tail's aerodynamic centre, 2.726 chords; the quarter chord
    gives 2.720.
    """
    tree = corpus("ce500_build")[0].to_datatree()
    printed = aerodb.from_datcom(jet, clean=tree, altitude=0.0)
    del tree["dynamic"]
    with pytest.warns(AeromatchWarning, match="no dynamic page"):
        derived = aerodb.from_datcom(jet, clean=tree, altitude=0.0)
    for name, within in (("CL/alphadothat", 4e-3), ("Cm/alphadothat", 7e-3)):
        low = printed[name]["alpha"].values < 12.5 * DEGREE
        np.testing.assert_allclose(
            derived[name]["value"][:, low], printed[name]["value"][:, low], rtol=within
        )
        assert (derived[name]["source"] == 2).all()
        assert "from downwash, interference and planform tables" in derived[name].attrs["comment"]
    assert "CL/qhat" in derived.attrs["absent"].split()


@pytest.mark.nightly
def test_printed_cells_stay(jet, corpus):
    tree = corpus("ce500_build")[0].to_datatree()
    tree["dynamic"]["CL_alphadothat"].values[-1, 0, 4] = (
        np.nan
    )  # whole aeroplane, Mach 0.2 at 0 m, alpha -2
    db = aerodb.from_datcom(jet, clean=tree, altitude=0.0)
    leaf = db["CL/alphadothat"].to_dataset().sel(mach=0.2)
    np.testing.assert_array_equal(leaf["source"].values == 2, np.arange(20) == 4)
    assert (
        db["CL/alphadothat"]
        .attrs["comment"]
        .startswith("1 cells that the dynamic page does not give")
    )
    assert float(leaf["stderr"][4]) == pytest.approx(
        2 * np.hypot(0.5 * float(leaf["value"][4]), 0.5)
    )


@pytest.mark.nightly
def test_supersonic_rates_are_not_made_from_the_downwash(fighter):
    aircraft, case = fighter
    tree = case.to_datatree()
    del tree["dynamic"]
    with pytest.warns(AeromatchWarning) as caught:
        db = aerodb.from_datcom(aircraft, clean=tree)
    np.testing.assert_array_equal(
        db["CL/alphadothat"]["mach"], [0.5, 2.5]
    )  # 1.6 is not there, 2.5 is held
    assert any(
        "CL/alphadothat Cm/alphadothat: nothing is printed beyond Mach 0.5" in str(w.message)
        for w in caught
    )


@pytest.mark.slow
def test_conditions_along_a_climb_go_over_mach_alone(fighter_db):
    db, messages = fighter_db
    assert (
        sum(
            "every Mach number stands at an altitude of its own (0.5 at 0 m, 0.9 at 5000 m" in text
            for text in messages
        )
        == 1
    )
    np.testing.assert_array_equal(
        db["CL/basic"]["mach"], [0.5, 1.6, 2.5]
    )  # the transonic pages print one row
    assert "CL/altitude" in db.attrs["absent"].split()


def test_a_supersonic_page_has_the_errors_of_its_class(fighter_db):
    leaf = fighter_db[0]["CL/basic"].to_dataset()
    base = np.hypot(0.08 * leaf["value"], 0.05)
    for mach, factor in ((0.5, 1.0), (1.6, 1.25), (2.5, 1.25)):
        printed = leaf["source"].sel(mach=mach) == 0
        np.testing.assert_allclose((leaf["stderr"] / base).sel(mach=mach)[printed], factor)


def test_a_derivative_held_into_another_regime_is_warned_of(fighter_db):
    """CLP is printed at Mach 0.5 only; it reaches Mach 2.5 with the factor of the supersonic class,
    doubled.
    """
    db, messages = fighter_db
    text = next(text for text in messages if "Cl/phat" in text)
    assert (
        "nothing is printed beyond Mach 0.5; that value is held to Mach 2.5, another speed regime"
        in text
    )
    leaf = db["Cl/phat"].to_dataset()
    np.testing.assert_allclose(leaf["stderr"].sel(mach=2.5) / leaf["stderr"].sel(mach=0.5), 2 * 1.5)
    assert (leaf["source"].sel(mach=2.5) == 2).all()


@pytest.mark.nightly
def test_the_deck_states_where_the_subsonic_methods_end(jet, corpus):
    """ce500_clean.inp ends them at STMACH 0.8: Mach 0.7 is subsonic there, with the factor one."""
    case = corpus("ce500_clean")[0]
    assert case.deck.value("FLTCON", "STMACH") == 0.8
    leaf = aerodb.from_datcom(jet, clean=case)["CL/basic"].to_dataset().sel(mach=0.7)
    printed = leaf["source"] == 0
    np.testing.assert_allclose(
        leaf["stderr"][printed], np.hypot(0.08 * leaf["value"], 0.05)[printed]
    )
    with_tree = (
        aerodb.from_datcom(jet, clean=case.to_datatree())["CL/basic"].to_dataset().sel(mach=0.7)
    )  # no cards: 0.6
    np.testing.assert_allclose(with_tree["stderr"], 2.0 * leaf["stderr"])


@pytest.mark.nightly
def test_pitch_rates_against_the_course_values(jet, corpus):
    """Second check of 2V: halved, the listing is near the Ce-500 course values on q c/V (README of
    the corpus), Mach 0.15, alpha 8 deg.

    -CZ_q 3.86 against 3.86, Cm_q -8.34 against -7.04, -CZ_alphadot 1.78 against 1.43, Cm_alphadot
    -4.84 against -3.70. With rates on V the listing would be twice as large; what remains are
    another tail and another lift coefficient.
    """
    db = aerodb.from_datcom(jet, clean=corpus("ce500_clean"), altitude=0.0)
    rows = {
        "CL/qhat": (3.86, 3.86),
        "Cm/qhat": (-8.34, -7.04),
        "CL/alphadothat": (1.78, 1.43),
        "Cm/alphadothat": (-4.84, -3.70),
    }
    for name, (listing, course) in rows.items():
        half = (
            float(
                db[name]["value"].sel(mach=0.15, alpha=8 * DEGREE, method="nearest", tolerance=1e-6)
            )
            / 2
        )
        assert half == pytest.approx(listing, abs=5e-3)
        assert 0.95 < half / course < 1.35
