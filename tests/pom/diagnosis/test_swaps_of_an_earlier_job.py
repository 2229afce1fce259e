"""Swaps that an earlier job flew with another final model: taken over to the last bit where they
take nothing of what changed, flown again where they do.
"""

import pytest

from pom.cases.case import read_case
from pom.diagnosis import swap_runs
from pom.diagnosis.diagnosis import diagnose_bench
from pom.diagnosis.kept_diagnosis import Diagnosed
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench

PULSE = {
    "delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)],
    "delta_a": [(0.0, 0.0), (3.0, 0.0), (3.06, 0.01), (20.0, 0.01)],
}


@pytest.fixture
def place(write_case, trainer):
    """A case with its flight, and the mixtures of an a-priori model with the final one changed."""
    final = trainer.database()
    prior = trainer.scaled(final, Cm_elevator=0.6, Cm_qhat=0.8, CL_basic=0.9, Cn_beta=0.9)
    case, path = read_case(write_case()), trainer.flight(final, **PULSE)

    def mixtures(**changed):
        later = trainer.scaled(final, **changed) if changed else final
        return SwapModels.of(prior, later, (trainer.AIRCRAFT, trainer.AIRCRAFT))

    return case, path, mixtures


def diagnosed(case, path, models, before):
    """Return bench and table of a diagnosis, and the choices that it flew after both models."""
    bench, flown = SwapBench.of(case, models, path, before), []
    fly = bench._fly_choices

    def noted(choices):
        for choice, found in fly(choices):
            flown.append(choice)
            yield choice, found

    bench._fly_choices = noted
    return bench, diagnose_bench(bench), flown


@pytest.mark.nightly
def test_only_what_takes_a_changed_term_is_flown(place):
    case, path, mixtures = place
    first, table, every = diagnosed(case, path, mixtures(), {})
    before = Diagnosed.of(first, table).by_content()
    assert len(before) == len(every) > 0
    bench, found, flown = diagnosed(case, path, mixtures(Cm_qhat=1.1), before)
    fresh, expected, all_flown = diagnosed(case, path, mixtures(Cm_qhat=1.1), None)
    assert found.equals(expected)
    assert not found.equals(table)
    assert bench.known == fresh.known
    assert all("Cm/qhat" in choice for choice in flown)
    assert 0 < len(flown) < len(all_flown)


@pytest.mark.slow
def test_nothing_is_flown_again_with_the_same_models(place):
    case, path, mixtures = place
    first, table, _ = diagnosed(case, path, mixtures(), {})
    before = Diagnosed.of(first, table).by_content()
    bench, found, flown = diagnosed(case, path, mixtures(), before)
    assert flown == []
    assert found.equals(table)
    assert bench.known == first.known


@pytest.mark.slow
def test_a_term_that_comes_to_differ_makes_other_mixtures(place):
    """Every mixture then holds the tables of one more term: nothing is taken over."""
    case, path, mixtures = place
    first, table, _ = diagnosed(case, path, mixtures(), {})
    before = Diagnosed.of(first, table).by_content()
    _, found, flown = diagnosed(case, path, mixtures(Cl_beta=1.1), before)
    _, expected, every = diagnosed(case, path, mixtures(Cl_beta=1.1), None)
    assert found.equals(expected)
    assert flown == every


@pytest.mark.slow
@pytest.mark.parametrize("error", [None, -1.0])
def test_a_bench_made_again_does_not_look_for_its_steps(place, monkeypatch, error):
    """With an error that no two runs are within, the steps stay those of the models."""
    if error is not None:
        monkeypatch.setattr(swap_runs, "STEP_ERROR", error)
    case, path, mixtures = place
    flown, ends = [], SwapBench._fly_ends
    monkeypatch.setattr(SwapBench, "_fly_ends", lambda bench: flown.append(1) or ends(bench))
    first = SwapBench.of(case, mixtures(), path)
    looked = len(flown)
    again = SwapBench.of(case, mixtures(), path, step=first.step)
    assert looked >= 2
    assert len(flown) == looked + 1
    assert (first.step == 0.0) == (error is not None)
    assert again.known == first.known
    assert again.flown.parameters == first.flown.parameters
    assert again.judged([["Cm/qhat"]]) == first.judged([["Cm/qhat"]])
