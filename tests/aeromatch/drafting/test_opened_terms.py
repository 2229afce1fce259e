"""Terms of the fits that the listings do not give are opened in a drafted project."""

from __future__ import annotations

import tomllib

import pytest

from aeromatch.cli.actions.examples import example_folder
from aeromatch.drafting import project_text as drafted
from aeromatch.drafting.flown import FitDraft
from aeromatch.drafting.geometry import geometry_of, given_terms

MODELS = (
    "CY = 1 + beta + phat + rhat + delta_r",
    "Cl = 1 + beta + phat + rhat + delta_a + delta_r",
    "Cm = 1 + alpha + qhat + delta_e",
)
FIT = FitDraft("all", ("cruise",), ("3211 elevator",), windows=(), models=MODELS)


@pytest.fixture(scope="module")
def geometry():
    folder = example_folder("c182") / "datcom"
    return geometry_of(sorted(folder.glob("*.out")), [])


def opened(geometry) -> dict:
    lines = drafted._term_lines(geometry, [FIT])
    return tomllib.loads("\n".join(lines)).get("terms", {})


@pytest.mark.slow
def test_what_the_listings_give_is_that_of_the_database(geometry):
    given = given_terms(geometry)
    assert {"CL/basic", "Cl/rhat", "Cl/aileron", "Cm/elevator"} <= given
    assert set(opened(geometry)) == {
        "CY/rudder", "Cl/rudder", "CY/rhat", "CY/basic", "Cl/basic"
    }  # fmt: skip


@pytest.mark.slow
def test_a_term_that_a_listing_prints_as_ndm_is_opened(geometry, monkeypatch):
    given = given_terms(geometry) - {"Cl/rhat", "Cm/qhat", "Cm/elevator"}
    monkeypatch.setattr(drafted, "given_terms", lambda _: given)
    terms = opened(geometry)
    assert terms["Cl/rhat"] == {"regressors": ["rhat"], "stderr": 0.3}
    assert {"Cm/qhat", "Cm/elevator"} <= set(terms)


def test_listings_that_make_no_database_count_by_their_roles(geometry, monkeypatch):
    monkeypatch.setattr(drafted, "given_terms", lambda _: None)
    assert {"Cm/elevator", "Cl/rhat"}.isdisjoint(opened(geometry))
    assert "Cl/rudder" in opened(geometry)
