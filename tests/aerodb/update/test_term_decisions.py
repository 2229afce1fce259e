"""Replace, correct, keep or delete: what the flights decide about a term."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as group
from aerodb.store.schema import make_database
from aerodb.update.tabulation import tabulate
from aerodb.update.term_decisions import add_decisions, decisions
from flightmech import terms
from tests.aerodb.update.test_tabulation import ROOT, drawn, local_fits, prior_leaves


@pytest.fixture(scope="module")
def found():
    """Fits at constant flap without gear; a term each that they determine, hardly know of, and
    cannot know of.
    """
    leaves = prior_leaves()
    rng = np.random.default_rng(3)
    truth = drawn(leaves, rng)
    leaves["CL/gear"] = terms.make_term(0.0, {}, ("gear",), stderr=0.05, source="judgement")
    leaves["CL/speedbrake"] = terms.make_term(
        -0.1, {}, ("speedbrake",), stderr=0.05, source="datcom"
    )
    prior = make_database(leaves, **ROOT)
    tabulation = tabulate(local_fits(truth, rng), prior)
    return tabulation, aerodb.replace_terms(prior, tabulation)


def test_terms_that_flights_determine_are_replaced(found):
    tabulation, db = found
    assert tabulation.report.loc["CL/basic", "decision"] == "replace"
    assert db["CL/basic"].attrs["decision"] == "replace"
    assert (
        db["CL/basic"]
        .attrs["reason"]
        .endswith("flown nodes with less than 0.5 of the a-priori standard error")
    )


def test_terms_without_flights_are_kept_or_deleted(found):
    table = decisions(found[1])
    assert table.loc["CL/gear"].tolist() == ["delete", "no fit informs it"]
    assert table.loc["CL/speedbrake"].tolist() == ["keep", "no fit informs it"]


@pytest.mark.parametrize(
    ("ratio", "value", "source", "expected"),
    [
        (0.49, 1.0, "datcom", "replace"), (0.51, 1.0, "datcom", "correct"),
        (0.89, 1.0, "datcom", "correct"),
        (0.91, 1.0, "datcom", "keep"), (0.91, 0.0, "datcom", "keep"),
        (0.91, 0.0, "judgement", "delete"),
        (0.49, 0.0, "judgement", "replace"),
    ],
)  # fmt: skip
def test_bounds_of_the_standard_error(ratio, value, source, expected):
    before = {
        "CL/q": terms.make_term([value, value], {"alpha": [0.0, 0.1]}, stderr=0.1, source=source)
    }
    factor = np.zeros((1, 2))
    after = {
        name: leaf.assign_coords(component=[0.0], kind=[0.0, 1.0]).assign(
            stderr=leaf["stderr"] * ratio,
            posterior_factor=(("component", "alpha"), factor),
            posterior_sign=("component", [-1.0]),
        )
        for name, leaf in before.items()
    }
    made = add_decisions(before, after, {"CL/q": np.array([True, False])})["CL/q"]
    assert made.attrs["decision"] == expected
    if source == "judgement" and expected == "replace":
        assert "zero within 0.0 standard errors: it may be left out" in made.attrs["reason"]


@pytest.mark.nightly
def test_terms_that_flights_determine_only_together_are_named(found):
    """Two tables with the same regressor on the same axis cannot be distinguished by any flight."""
    leaves = prior_leaves()
    leaves["CL/alphadothat"] = leaves["CL/qhat"].copy()
    rng = np.random.default_rng(4)
    made = tabulate(local_fits(drawn(prior_leaves(), rng), rng), make_database(leaves, **ROOT))
    assert (
        "with CL/alphadothat: the flights determine them together"
        in made.report.loc["CL/qhat", "reason"]
    )


@pytest.mark.slow
def test_verb_lists_the_decisions(found, tmp_path):
    aerodb.save(found[1], tmp_path / "db.nc")
    result = CliRunner().invoke(group, ["decisions", str(tmp_path / "db.nc"), "--json"])
    rows = {row["term"]: row["decision"] for row in json.loads(result.output)["terms"]}
    assert rows["CL/gear"] == "delete"
    text = CliRunner().invoke(group, ["decisions", str(tmp_path / "db.nc")]).output
    assert text.splitlines()[-1] == "replace 3, correct 0, keep 1, delete 1"
    shown = (
        CliRunner().invoke(group, ["show", str(tmp_path / "db.nc"), "--term", "CL/basic"]).output
    )
    assert "decision: replace" in shown


def test_a_term_entered_from_flight_has_its_history_as_the_reason(small):
    """The ground effect of a submodel has no decision of the tables, but it is from flight."""
    entered = terms.make_term(-0.4, regressors=["delta_r"], source="flight").assign_attrs(
        history="ground effect: identified from 4 passes"
    )
    db = aerodb.replace_terms(small, {"CY/rudder": entered})
    decision, reason = decisions(db).loc["CY/rudder"]
    assert decision == "replace"
    assert reason.startswith("from flight, entered outside the fits of the tables: ")
    assert "no fit informs it" in decisions(db).loc["CL/basic"].tolist()
