"""Terms that cannot matter in a case are not flown alone: the bound holds, and the conclusion is
that of all swaps.
"""

import numpy as np
import pytest

import pom
from flightmech.errors import UnknownName
from pom.cases.case import read_case
from pom.diagnosis import diagnosis, screening, swap_runs
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench

PULSE = {
    "delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)],
    "delta_a": [(0.0, 0.0), (3.0, 0.0), (3.06, 0.01), (20.0, 0.01)],
}


@pytest.fixture(scope="module")
def models(trainer):
    """Pitch spoilt, and all of the lateral terms, which hardly move in this case."""
    final = trainer.database()
    yaw = {"Cn_beta": 0.97, "Cn_rhat": 0.9, "Cn_phat": 0.9, "Cn_rudder": 0.9}
    roll = {"Cl_beta": 0.97, "Cl_phat": 0.97, "Cl_rhat": 0.95, "Cl_aileron": 0.99}
    prior = trainer.scaled(
        final,
        Cm_elevator=0.6,
        Cm_qhat=0.8,
        Cm_basic=0.95,
        Cm_alphadothat=0.9999,
        CL_basic=0.9,
        **yaw,
        **roll,
    )
    return SwapModels.of(prior, final, (trainer.AIRCRAFT, trainer.AIRCRAFT))


@pytest.fixture
def bench(write_case, trainer, models):
    return SwapBench.of(
        read_case(write_case()), models, trainer.flight(trainer.database(), **PULSE)
    )


def test_no_idle_term_moves_more_than_its_bound(bench):
    screening.screen_idle_terms(bench)
    assert {"Cm/alphadothat", "Cn/rudder"} <= bench.idle.keys()
    assert not {"Cm/elevator", "Cm/qhat", "CL/basic"} & bench.idle.keys()
    for name, bound in bench.idle.items():
        (alone,) = bench.judged([[name]], exact=True)
        assert alone.moved <= bound < screening.LEAST_TOGETHER
    (largest,) = bench.judged([["Cm/elevator"]])
    assert largest.moved > 0.1


def test_the_table_names_every_idle_term_and_what_all_move_together(bench):
    table = diagnosis.diagnose_bench(bench)
    together, *alone = table.query("stage == 'idle'").to_dict("records")
    assert together["term"] == ""
    assert together["verdict"] == "fail"
    (flown,) = bench.judged([bench.idle], exact=True)
    assert together["bound"] == flown.moved < screening.LEAST_TOGETHER
    assert together["mismatch"] == flown.total
    assert {row["term"]: row["bound"] for row in alone} == bench.idle
    assert [row["bound"] for row in alone] == sorted(bench.idle.values(), reverse=True)
    singles = set(table.query("stage == 'single'")["term"])
    assert singles | bench.idle.keys() == set(bench.names)
    assert not singles & bench.idle.keys()
    assert table.query("stage != 'idle'")["bound"].isna().all()


@pytest.mark.slow
def test_the_conclusion_is_that_of_all_swaps(bench, write_case, trainer, models, monkeypatch):
    fewer = diagnosis.diagnose_bench(bench)
    monkeypatch.setattr(diagnosis, "screen_idle_terms", lambda bench: None)
    whole = SwapBench.of(
        read_case(write_case()), models, trainer.flight(trainer.database(), **PULSE)
    )
    every = diagnosis.diagnose_bench(whole)
    assert len(bench.known) < len(whole.known)
    assert pom.corrected_terms([fewer]) == pom.corrected_terms([every])
    one, other = (
        table[table["stage"] != "idle"].set_index(["stage", "term"]) for table in (fewer, every)
    )
    for stage in ("sequence", "pair", "share"):
        assert list(one.loc[stage].index) == list(other.loc[stage].index)
    apart = np.abs(one["explained"] - other["explained"][one.index])
    assert apart.max() < screening.LEAST_TOGETHER
    assert (
        apart[["single", "pair", "sequence"]].max() == 0.0
    )  # with a rest of mostly idle terms a choice takes all of these


def test_without_a_measure_the_check_has_all_flown_that_matter(bench, monkeypatch):
    """Only the two largest of a coefficient are flown for the measure; the check of all others
    together finds what is missing.
    """
    monkeypatch.setattr(screening, "SAFETY", 0.0)
    screening.screen_idle_terms(bench)
    assert bench.idle
    assert "Cm/basic" not in bench.idle  # third of its coefficient
    start, together = bench.judged([(), bench.idle], exact=True)
    assert together.verdict == start.verdict
    assert together.moved < screening.LEAST_TOGETHER


def test_all_terms_are_flown_where_the_record_lacks_what_a_table_is_over(bench, monkeypatch):
    def lacking(*_):
        raise UnknownName("mach", ["alpha"], "variable")

    monkeypatch.setattr(screening, "fill_missing_devices", lacking)
    table = diagnosis.diagnose_bench(bench)
    assert bench.idle == {}
    assert set(table.query("stage == 'single'")["term"]) == set(bench.names)
    assert "idle" not in set(table["stage"])


def test_a_choice_takes_the_idle_terms_all_or_none_but_for_the_joint_model(bench):
    screening.screen_idle_terms(bench)
    first, *rest = bench.idle
    known = len(bench.known)
    assert bench.judged([[first], ["Cm/elevator", *rest]]) == bench.judged(
        [[], ["Cm/elevator", *bench.idle]]
    )
    assert len(bench.known) == known + 1
    bench.judged([[first]], exact=True)
    assert len(bench.known) == known + 2


def test_steps_are_as_long_as_both_models_agree(bench, write_case, trainer, models, monkeypatch):
    assert bench.flown.parameters["mode.step"] in swap_runs.LONG_STEPS
    assert bench.flown.time is bench.job.time  # the pulse begins and ends between two samples
    monkeypatch.setattr(swap_runs, "STEP_ERROR", 0.3)
    coarse = SwapBench.of(
        read_case(write_case()), models, trainer.flight(trainer.database(), **PULSE)
    )
    assert coarse.flown.time.size < coarse.job.time.size
    for one, other in zip(
        bench.judged([(), bench.names]), coarse.judged([(), bench.names]), strict=True
    ):
        assert one.mismatch.keys() == other.mismatch.keys()
        assert (
            0.0
            < max(abs(value - other.mismatch[name]) for name, value in one.mismatch.items())
            < 0.1
        )
    monkeypatch.setattr(swap_runs, "STEP_ERROR", -1.0)  # no two runs are that near
    usual = SwapBench.of(
        read_case(write_case()), models, trainer.flight(trainer.database(), **PULSE)
    )
    assert usual.flown is usual.job
    assert "mode.step" not in usual.job.parameters
    for one, other in zip(
        bench.judged([(), bench.names]), usual.judged([(), usual.names]), strict=True
    ):
        assert one.verdict == other.verdict
        for name, value in one.mismatch.items():
            assert abs(value - other.mismatch[name]) < 2e-3


def test_a_choice_of_parts_is_compiled_once(models, monkeypatch):
    calls = []
    own = swap_runs.SwapModels.of(models.prior, models.final, models.aircraft)
    monkeypatch.setattr(
        "pom.diagnosis.swap_models.swap_parts", lambda *pair: calls.append(pair) or pair[0]
    )
    assert own.compiled(()) is own.compiled(frozenset())
    assert len(calls) == 1
