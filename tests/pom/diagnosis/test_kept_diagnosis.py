"""The bench of a kept diagnosis: what is known is not flown, what is not makes the bench once."""

from types import SimpleNamespace

import pandas as pd
import pytest

from pom.diagnosis.kept_diagnosis import Diagnosed, LateBench


def bench(known, idle=()):
    made = []

    def judged(keys, exact):
        assert exact
        whole.known.update({key: f"judged {sorted(key)}" for key in keys if key not in whole.known})

    whole = SimpleNamespace(names=("a", "b", "c"), idle={}, known={}, judged=judged)

    def make():
        made.append(1)
        return whole

    diagnosed = Diagnosed(pd.DataFrame(), whole.names, dict.fromkeys(idle, 0.1), known)
    return LateBench(diagnosed, {frozenset("b"): "judged by an earlier job"}, make), whole, made


def test_a_known_choice_is_not_flown():
    late, _, made = bench({frozenset("a"): "judged by the diagnosis"})
    assert late.judged([["a"], ["b"]], exact=True) == [
        "judged by the diagnosis",
        "judged by an earlier job",
    ]
    assert made == []


def test_a_new_choice_makes_the_bench_once_with_all_that_is_known():
    late, whole, made = bench({frozenset("a"): "judged by the diagnosis"}, idle=["c"])
    assert late.judged([["a", "b"], ["a"]], exact=True) == [
        "judged ['a', 'b']",
        "judged by the diagnosis",
    ]
    assert late.judged([["b", "c"]], exact=True) == ["judged ['b', 'c']"]
    assert made == [1]
    assert whole.idle == {"c": 0.1}
    assert whole.known.keys() == late.known.keys()


@pytest.mark.parametrize(
    ("choice", "idle", "meant"),
    [
        (("a",), "bc", {"a"}),
        (("a", "b"), "bcd", {"a"}),
        (("a", "b", "c"), "bcd", {"a", "b", "c", "d"}),
    ],
)
def test_a_choice_takes_all_idle_terms_or_none(choice, idle, meant):
    late, _, _ = bench({}, idle)
    assert late.judged([choice]) == [f"judged {sorted(meant)}"]
