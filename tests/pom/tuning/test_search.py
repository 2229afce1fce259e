"""Tuning moves what the evidence allows, no more than it takes, and refuses with the price."""

import numpy as np
import pytest
import xarray as xr

import aerodb
from pom.cases.case import read_case
from pom.diagnosis.tuning.demands import least_distance
from pom.diagnosis.tuning.search import tune
from pom.replaying.replay_case import plan_of

PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}


@pytest.fixture(scope="module")
def flight(trainer):
    return trainer.flight(trainer.database(), duration=9.5, **PULSE)


@pytest.fixture
def plan(write_case, flight):
    return plan_of(read_case(write_case()), flight)


def uncertain(
    db,
    share,
    names=(
        "CL/basic",
        "CD/basic",
        "Cm/basic",
        "Cm/elevator",
        "Cm/qhat",
        "Cm/alphadothat",
        "CL/qhat",
        "CL/elevator",
    ),
):
    """Return `db` with standard errors of a share of the largest value of each term."""
    leaves = aerodb.terms(db)
    new = {
        n: leaves[n].assign(
            stderr=xr.full_like(leaves[n]["value"], share * float(abs(leaves[n]["value"]).max()))
        )
        for n in names
    }
    return aerodb.replace_terms(db, new)


def test_shortest_vector_within_limits():
    assert least_distance(np.array([[1.0, 1.0]]), np.array([2.0])) == pytest.approx([1.0, 1.0])
    assert least_distance(
        np.array([[1.0, 1.0], [-1.0, 0.0]]), np.array([2.0, -0.5])
    ) == pytest.approx([0.5, 1.5])
    assert least_distance(np.array([[1.0, 0.0]]), np.array([-1.0])) == pytest.approx([0.0, 0.0])
    assert least_distance(np.array([[1.0], [-1.0]]), np.array([1.0, 1.0])) is None


@pytest.mark.slow
def test_the_spoilt_terms_take_the_distance(plan, trainer):
    """The evidence is wrong by a standard error here and there; two terms of the model were spoilt
    until the row failed.
    """
    evidence = uncertain(
        trainer.scaled(trainer.database(), Cm_qhat=1.04, CL_basic=0.99, Cm_basic=1.01), 0.04
    )
    model = trainer.scaled(evidence, Cm_elevator=0.7, Cm_alphadothat=0.5)
    found = tune([plan], model, trainer.AIRCRAFT, evidence=evidence)
    assert found.rows.loc["a_case", "before"] == "fail"
    assert found.rows.loc["a_case", "after"] == "pass"
    assert found.moves.loc[["Cm/elevator", "Cm/alphadothat"], "share"].sum() > 0.8
    assert found.moves["from_evidence"].max() <= 2.0
    tuned = found.database
    assert aerodb.store.history(tuned)["text"].iloc[-1].startswith("replace_terms: replaced")
    assert "pom tune for a_case" in aerodb.terms(tuned)["Cm/elevator"].attrs["history"]
    back = aerodb.store.undo_edits(tuned)
    assert np.array_equal(
        aerodb.terms(back)["Cm/elevator"]["value"], aerodb.terms(model)["Cm/elevator"]["value"]
    )


@pytest.mark.slow
def test_what_the_evidence_contradicts_is_refused_with_the_price(plan, trainer):
    """The evidence itself is far off, with small standard errors: two of them do not do; a
    rationale lets one term go farther.
    """
    model = uncertain(trainer.scaled(trainer.database(), Cm_elevator=0.7), 0.02)
    refused = tune([plan], model, trainer.AIRCRAFT)
    assert refused.database is None
    assert "cannot pass within 2 standard errors; it would take" in refused.refusal
    assert "Cm/elevator" in refused.refusal
    assert refused.rows.loc["a_case", "after"] == "pass"  # with what it would take
    allowed = tune(
        [plan],
        model,
        trainer.AIRCRAFT,
        rationale={"Cm/elevator": "A. Bell, 2026-11-28, the horn was changed after the flights"},
    )
    assert allowed.refusal == ""
    assert allowed.moves.loc["Cm/elevator", "from_evidence"] > 2.0
    assert allowed.moves.drop(index="Cm/elevator")["from_evidence"].max() <= 2.0 + 1e-6
    assert "the horn was changed" in "\n".join(allowed.log())


@pytest.mark.slow
def test_a_row_that_passes_moves_nothing(plan, trainer):
    db = uncertain(trainer.database(), 0.05)
    found = tune([plan], db, trainer.AIRCRAFT)
    assert found.distance == 0.0
    assert found.moves.empty
    assert found.database is db
