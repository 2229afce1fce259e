"""The end of the input that a case states against the recorded controls."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flightmech.units import DEGREE
from pom.judging.input_end_check import input_end_remarks
from pom.judging.signals import signals_of_run

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

TIME = np.arange(0.0, 30.0, 0.02)


def case_with(end, measure="period"):
    case = fixture.roll_result().case
    (criterion, *_) = case.criteria
    row = replace(criterion, measure=measure, bounds=("input_end", ""), applies=True)
    return replace(case, criteria=(row,), events={"input_end": end})


def texts(case, size=5.0 * DEGREE, noise=0.0):
    """Return the remarks for a rudder that is held from 2 to 6 s, with noise of its pick-up."""
    rudder = np.where((TIME > 2.0) & (TIME < 6.0), size, 0.0)
    rudder = rudder + noise * np.random.default_rng(1).standard_normal(TIME.size)
    flight = signals_of_run(case, {"delta_r": rudder, "delta_e": 0.0 * TIME}, TIME)
    return [item.text for item in input_end_remarks(case, flight)]


@pytest.mark.parametrize("end", [6.0, 6.3, 7.9])
def test_an_end_at_rest_is_right(end):
    assert texts(case_with(end)) == []
    assert texts(case_with(end), noise=0.3 * DEGREE) == []


def test_an_early_end_measures_the_input():
    (text,) = texts(case_with(3.0))
    assert text.startswith("departure: the input ends at 3 s in the case, the rudder moves until 6")


def test_a_late_end_leaves_the_first_part_out():
    (text,) = texts(case_with(12.0))
    assert "is at rest from 6" in text


def test_rows_of_another_kind_and_small_inputs_are_not_checked():
    assert texts(case_with(12.0, measure="trace")) == []
    assert texts(case_with(12.0), size=0.5 * DEGREE) == []
