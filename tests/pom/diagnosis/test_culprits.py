"""Two errors that compensate each other are both named, though no case fails."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
import pom
from pom.cases.case import read_case
from pom.diagnosis import diagnosis
from pom.diagnosis.culprits.ranking import (
    UNKNOWN_WEIGHT,
    evidence_weight,
    node_distances,
    order_corrections,
    rank_culprits,
)
from pom.diagnosis.culprits.sentences import describe_culprits
from pom.diagnosis.diagnosis import diagnose_bench
from pom.diagnosis.swap_judgement import (
    LEAST_GAP,
    DiagnosisRows,
    Judged,
    effect_correlation,
    effect_products,
)
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench
from pom.report.models.diagnosis import cause_sentences

PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}
# The elevator is weaker and the damping less: the pitch rate hardly changes.
COMPENSATING = {"Cm_elevator": 0.8, "Cm_qhat": 0.6}
NEAR = {"CL_basic": 1.01, "Cm_alphadothat": 0.9}


@pytest.fixture(scope="module")
def truth(trainer):
    return trainer.flight(trainer.database(), **PULSE)


def identified(db, **stderr):
    """Return `db` with standard errors of terms from flight."""
    leaves, new = aerodb.terms(db), {}
    for key, size in stderr.items():
        name = key.replace("_", "/", 1)
        value = leaves[name]["value"]
        new[name] = leaves[name].assign(
            stderr=xr.full_like(value, size), source=xr.ones_like(value, np.uint8)
        )
    return aerodb.replace_terms(db, new)


def bench_of(write_case, trainer, truth, **factors):
    final = trainer.database()
    models = SwapModels.of(trainer.scaled(final, **factors), final, (trainer.AIRCRAFT,) * 2)
    return SwapBench.of(read_case(write_case()), models, truth)


@pytest.fixture
def bench(write_case, trainer, truth):
    return bench_of(write_case, trainer, truth, **COMPENSATING, **NEAR)


def test_both_of_two_compensating_errors_are_named(bench, trainer):
    evidence = identified(
        trainer.database(), Cm_elevator=0.02, Cm_qhat=0.5, CL_basic=0.05, Cm_alphadothat=0.6
    )
    table = diagnose_bench(bench)
    assert table.loc[0, "verdict"] == "pass"
    assert pom.corrected_terms([table]) == []  # the case alone names none
    ranked = rank_culprits({"a_case": bench}, evidence)
    assert set(ranked["term"][:2]) == {"Cm/elevator", "Cm/qhat"}
    rows = ranked.set_index("term")
    assert rows.loc["Cm/elevator", "distance"] == pytest.approx(0.2 * 1.1 / 0.02)
    assert rows.loc["Cm/alphadothat", "distance"] == pytest.approx(1.0)
    steps = order_corrections({"a_case": bench}, ranked)
    # It passes, fails with one corrected, and passes again: a search that stops does not see it.
    assert list(steps["matched"]) == [1, 0, 1, 1]
    assert set(steps["term"][1:3]) == {"Cm/elevator", "Cm/qhat"}
    assert steps["mismatch"].iloc[1] > steps["mismatch"].iloc[0]
    assert steps["partner"].iloc[1] == steps["term"].iloc[2]
    assert -1.0 <= steps["correlation"].iloc[1] < -0.9
    text = " ".join(describe_culprits(ranked, steps))
    assert f"most likely wrong in {steps['term'].iloc[1]}, {steps['term'].iloc[2]}." in text
    assert f"The correction of {steps['term'].iloc[1]} makes the match worse on the way" in text


def test_the_effect_is_that_of_the_final_model_without_the_term(bench):
    ranked = rank_culprits({"a_case": bench}).set_index("term")
    end, without = bench.judged(
        [bench.names, [name for name in bench.names if name != "Cm/qhat"]], exact=True
    )
    assert ranked.loc["Cm/qhat", "effect"] == pytest.approx(
        np.sqrt(without.total**2 - end.total**2)
    )
    assert ranked.loc["Cm/qhat", "without"] == pytest.approx(without.total)
    assert np.isnan(ranked["distance"]).all()


def test_a_term_that_the_final_model_has_wrong_is_not_named(write_case, trainer, truth):
    right = trainer.database()
    models = SwapModels.of(right, trainer.scaled(right, Cm_elevator=0.8), (trainer.AIRCRAFT,) * 2)
    bench = SwapBench.of(read_case(write_case()), models, truth)
    ranked = rank_culprits({"a_case": bench})
    assert list(ranked["score"]) == [0.0]
    steps = order_corrections({"a_case": bench}, ranked)
    assert list(steps["term"]) == ["", "final"]
    assert describe_culprits(ranked, steps)[0].startswith("No term is named")


def test_the_odds_are_even_at_three_standard_errors():
    assert evidence_weight(3.0) == 0.5
    assert evidence_weight(0.0) == pytest.approx(1.0 / (1.0 + np.exp(4.5)))
    assert evidence_weight(50.0) == 1.0
    assert evidence_weight(np.nan) == UNKNOWN_WEIGHT


def test_the_distance_of_nodes_needs_the_same_breakpoints(trainer):
    db = identified(trainer.database(), CL_basic=0.1, Cm_elevator=0.1)
    moved = trainer.scaled(db, Cm_elevator=1.2)
    assert node_distances(moved, db) == pytest.approx({"CL/basic": 0.0, "Cm/elevator": 2.2})
    shorter = aerodb.replace_terms(
        moved, {"CL/basic": aerodb.terms(moved)["CL/basic"].isel(alpha=slice(0, 3))}
    )
    assert set(node_distances(shorter, db)) == {"Cm/elevator"}


def test_the_correlation_of_effects_by_hand():
    rng = np.random.default_rng(3)
    x, y = rng.standard_normal((2, 50))
    y -= 0.5 * x

    def judged(values):
        return Judged("pass", {}, {}, 0.0, change={"q": float(np.sqrt(np.mean(values**2)))})

    products = effect_products(judged(x), judged(y), judged(x + y), {"q": 2.0, "nz": 0.0})
    expected = np.mean(x * y) / np.sqrt(np.mean(x**2) * np.mean(y**2))
    assert effect_correlation(products) == pytest.approx(expected)
    failed = Judged("invalid", {}, {}, 0.0)
    assert np.isnan(effect_correlation(effect_products(failed, judged(y), judged(y), {"q": 2.0})))


def test_a_small_gap_has_no_shares(write_case, trainer, truth):
    """Both models match: a percentage of a hundredth of a half width means nothing."""
    table = diagnose_bench(bench_of(write_case, trainer, truth, Cm_elevator=0.995, Cm_qhat=0.98))
    start, end = table["mismatch"][:2]
    assert 0.0 < start - end < LEAST_GAP
    assert table["explained"].isna().all()
    text = cause_sentences(table)
    assert "Both models match the flight: the mismatches of" in text
    assert "%" not in text


@pytest.mark.parametrize(("gap", "is_stated"), [(0.049, False), (0.051, True)])
def test_shares_begin_at_the_least_gap(gap, is_stated):
    prior = Judged("fail", {"q": 0.5 + gap}, {"q": 1.1}, total=0.5 + gap)
    rows = DiagnosisRows(prior, Judged("pass", {"q": 0.5}, {"q": 0.9}, total=0.5))
    rows.add("prior", "", prior)
    assert np.isfinite(rows.rows[0]["explained"]) == is_stated


@pytest.mark.slow
def test_opposed_shares_are_stated_with_their_correlation(write_case, trainer, truth, monkeypatch):
    """A strong elevator, and a strong static stability that compensates a part of it."""
    monkeypatch.setattr(diagnosis, "LEAST_OPPOSED", 0.03)
    bench = bench_of(write_case, trainer, truth, Cm_elevator=1.6, Cm_basic=1.3)
    table = diagnose_bench(bench)
    shares = table[table["stage"] == "share"].set_index("term")
    assert shares.loc["Cm/basic", "explained"] < -0.03
    assert shares.loc["Cm/elevator", "explained"] > 1.03
    assert dict(shares["partner"]) == {"Cm/basic": "Cm/elevator", "Cm/elevator": "Cm/basic"}
    (pair,) = table.loc[table["stage"] == "pair", "correlation"]
    assert pair < -0.5
    assert list(shares["correlation"]) == [pair, pair]
    text = cause_sentences(table)
    assert "The shares of Cm/basic (−5 %) and Cm/elevator (105 %) belong together" in text
    assert text.count("belong together") == 1


def test_a_step_that_makes_it_worse_is_stated():
    blank = {"explained": np.nan, "interaction": 0.0, "correlation": np.nan, "partner": ""}
    table = pd.DataFrame(
        [
            blank | {"stage": "prior", "term": "", "verdict": "fail", "mismatch": 0.8},
            blank | {"stage": "final", "term": "", "verdict": "pass", "mismatch": 0.1},
            blank | {"stage": "single", "term": "A", "verdict": "fail", "mismatch": 1.5},
            blank
            | {"stage": "pair", "term": "B + A", "verdict": "pass", "correlation": -0.93}
            | {"mismatch": 0.1},
            blank | {"stage": "sequence", "term": "A", "verdict": "fail", "mismatch": 1.5},
            blank | {"stage": "sequence", "term": "B", "verdict": "pass", "mismatch": 0.1},
        ]
    )
    text = cause_sentences(table)
    assert (
        "The sequence makes the match worse on the way: A raises the mismatch from 0.80 to 1.50 "
        "half widths, because it and B compensate each other (correlation of their effects on the "
        "judged outputs −0.93)." in text
    )
    assert "B raises" not in text
