"""The comparison of `benchmarks/rounding.py` sees every estimate that moves."""

import copy
import math
import runpy
from pathlib import Path

import pytest

FIT = {
    "terms": {"alpha": {"estimate": -0.6, "stderr": 0.02}, "qhat": {"estimate": -9.0, "stderr": 1}},
    "constants": {"time": [0.5, 0.1]},
    "tables": {"fan": {"value": [0.2, 0.4], "stderr": [0.01, 0.02]}},
}


@pytest.fixture(scope="module")
def compare():
    return runpy.run_path(str(Path(__file__).parents[1] / "benchmarks" / "rounding.py"))["compare"]


def test_differences_are_in_standard_errors(compare):
    count, moved, changed, _ = compare(FIT, FIT)
    assert (count, moved, changed) == (5, 0.0, 0.0)
    other = copy.deepcopy(FIT)
    other["tables"]["fan"]["value"][1] += 0.004
    other["constants"]["time"][1] *= 1.05
    count, moved, changed, place = compare(FIT, other)
    assert count == 5
    assert math.isclose(moved, 0.2)
    assert math.isclose(changed, 0.05)
    assert place == "/tables/fan"


def test_another_set_of_terms_is_infinitely_far(compare):
    other = copy.deepcopy(FIT)
    del other["terms"]["qhat"]
    assert compare(FIT, other)[1] == math.inf
