"""Stated events of a case against the recorded flight."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flightmech.units import FOOT, KNOT
from pom.judging.event_checks import event_remarks
from pom.judging.signals import signals_of_run

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

TIME = np.arange(0.0, 40.0, 0.02)
# stands until 5 s, lifts off at 20 s, and passes 200 ft at 30 s
TAKE_OFF = {
    "vn": np.clip(2.0 * (TIME - 5.0), 0.0, 60.0),
    "ve": 0.0 * TIME,
    "h_agl": np.clip(20.0 * FOOT * (TIME - 20.0), 0.0, None),
    "wow_left": (TIME < 20.0).astype(float),
    "wow_right": (TIME < 19.9).astype(float),
    "wow_nose": (TIME < 18.0).astype(float),
    "gear": np.clip((TIME - 32.0) / 2.0, 0.0, 1.0),
}


def remarks(test, channels=TAKE_OFF, bounds=("", ""), **events):
    case = fixture.roll_result().case
    rows = tuple(replace(row, bounds=bounds, applies=True) for row in case.criteria)
    case = replace(case, id=test, criteria=rows, events=events)
    return event_remarks(case, signals_of_run(case, channels, TIME))


@pytest.mark.parametrize(
    ("test", "name", "right", "wrong", "text"),
    [
        ("1.b.4", "200ft_agl", 30.9, 12.0, "where the record is 0 ft above the ground"),
        ("1.b.4", "brake_release", 5.5, 10.0, "where the ground speed of the record is 19 kt"),
        ("1.b.3", "main_gear_liftoff", 20.5, 12.0, "last main wheel leaves the ground at 20.0 s"),
        ("2.c.4", "change_end", 34.2, 32.5, "the control stops at 34.0 s"),
    ],
)
def test_an_event_that_the_record_contradicts_is_a_departure(test, name, right, wrong, text):
    assert remarks(test, **{name: right}) == ()
    (found,) = remarks(test, **{name: wrong})
    assert found.kind == "departure"
    assert found.quantity == name
    assert text in found.text


def test_a_landing_is_compared_downward():
    landing = {name: values[::-1] for name, values in TAKE_OFF.items()}
    # wheels: the right one touches first, 20 s before the end of the reversed record
    assert remarks("2.e.1", landing, nosewheel_touchdown=22.0) == ()
    (found,) = remarks("2.e.1", landing, nosewheel_touchdown=15.0)
    assert "the nose wheel touches the ground at 22.0 s" in found.text
    (found,) = remarks("1.e.1", landing, full_stop=30.0)
    speed = float(np.interp(30.0, TIME, landing["vn"])) / KNOT
    assert f"{speed:.0f} kt" in found.text


def test_an_event_that_the_record_does_not_show_is_not_checked():
    no_heights = {name: values for name, values in TAKE_OFF.items() if name != "h_agl"}
    (found,) = remarks("1.b.4", no_heights, bounds=("", "200ft_agl"), **{"200ft_agl": 12.0})
    assert found.kind == "not_checked"
    # one that bounds no row changes no verdict
    assert remarks("1.b.4", no_heights, **{"200ft_agl": 12.0}) == ()
    # and one outside the replay has no samples
    assert remarks("1.b.4", bounds=("", "200ft_agl"), **{"200ft_agl": 60.0}) == ()
