"""The window of a case, and the end of the input that it states, against the recorded flight."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flightmech.units import DEGREE
from pom.judging.signals import signals_of_run
from pom.judging.window_checks import (
    WINDOW,
    WINDOW_UNCHECKED,
    check_window,
    input_end_remarks,
    window_departures,
    window_remarks,
)

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


@pytest.fixture(scope="module")
def case():
    return fixture.roll_result().case


def check(
    case, window, test="2.d.2", control="delta_a", size=8.0 * DEGREE, hold=(3.0, 4.5), **changes
):
    """Return the check of a window for a control that is held, without motion.

    A change of a channel to None takes it away.
    """
    rows = tuple(replace(row, window=window) for row in case.criteria)
    case = replace(case, id=test, criteria=rows, window=window)
    zero = 0.0 * TIME
    names = ("phi", "theta", "p", "q", "r", "delta_e", "delta_a", "delta_r")
    motion = {**dict.fromkeys(names, zero), control: held(hold, size), **changes}
    states = {name: ("time", y) for name, y in motion.items() if y is not None}
    return check_window(case, xr.Dataset(states, {"time": TIME}))


def held(hold, size):
    return np.where((hold[0] < TIME) & (hold[1] > TIME), size, 0.0)


def with_hole(values, start, stop):
    return np.where((start <= TIME) & (stop >= TIME), np.nan, values)


def test_missing_samples_elsewhere_do_not_end_the_check(case):
    pulse = held((3.0, 4.5), 8.0 * DEGREE)
    open_end = check(case, (1.9, 4.0))
    (text,) = open_end.departures
    assert "0.5 s before the input of the aileron ends" in text
    # 26 s behind the window, and for a tenth of a second inside it
    for hole in ((29.9, 30.0), (2.0, 2.1)):
        assert check(case, (1.9, 4.0), delta_a=with_hole(pulse, *hole)) == open_end
    # at the end of the input nothing shows it
    found = check(case, (1.9, 4.0), delta_a=with_hole(pulse, 4.2, 5.0))
    assert found.departures == ()
    (text,) = found.unchecked
    assert text == (
        "whether the window ends before the input does: the record has none of delta_a, wheel, "
        "F_rim from 1.4 to 6 s throughout"
    )


def test_a_start_without_rates_is_not_checked(case):
    found = check(case, (1.9, 11.9), p=None, q=with_hole(0.0 * TIME, 1.0, 1.8))
    assert found.departures == ()
    (text,) = found.unchecked
    assert text == (
        "whether the flight is steady at 1.9 s, where the window starts: the record has no p, q "
        "there; only the other channels are checked"
    )
    # the controls still are
    (text,) = check(case, (3.2, 13.1), p=None).departures
    assert "aileron deflection" in text
    states = xr.Dataset(attrs={WINDOW_UNCHECKED: ("why",)})
    (remark,) = window_remarks(states)
    assert (remark.kind, remark.text) == ("not_checked", "not checked: why")


@pytest.mark.parametrize(
    ("channel", "factor", "control"),
    [("F_rim", 1.0, "pilot force at the rim of the wheel"), ("F_wheel", 0.2, "pilot force at")],
)
def test_a_force_on_the_wheel_departs_as_one_on_the_column(case, channel, factor, control):
    case = replace(case, conditions={**case.conditions, "wheel_radius": 0.2})
    size = 50.0 * factor  # 50 N at the rim are 10 N m
    (text,) = check(case, (1.9, 4.0), control=channel, size=size).departures
    assert f"before the input of the {control}" in text
    (text,) = check(case, (3.2, 13.1), control=channel, size=size).departures
    assert "pilot force at the rim of the wheel 11.24 lbf in 0.5 s" in text
    assert check(case, (3.2, 13.1), control=channel, size=0.2 * size).departures == ()
    (text,) = check(case, (1.9, 4.0), "2.c.10", control="F_column", size=50.0).departures
    assert "pilot force on the column" in text


def test_a_later_start_is_named_where_it_is_the_right_one(case):
    # a spiral is entered by a roll, after which the controls rest
    roll = held((3.0, 5.0), 10.0 * DEGREE)
    (text,) = check(case, (4.0, 24.0), "2.d.4", p=roll).departures
    assert text.endswith("the flight is steady until 2.7 s, and from 5.7 s on")
    # of a response only as long as its input is still to come
    early = held((1.0, 2.0), 10.0 * DEGREE)
    still_to_come = check(case, (1.5, 11.5), hold=(4.0, 5.0), p=early)
    (text,) = still_to_come.departures
    assert text.endswith("the flight is steady until 0.7 s, and from 2.7 s on")
    (text,) = check(case, (4.0, 14.0), hold=(3.0, 5.0), p=roll).departures
    assert text.endswith("the flight is steady until 2.7 s: start there or earlier")
    # a hole does not show steady flight
    (text,) = check(
        case, (4.0, 24.0), "2.d.4", p=roll, q=with_hole(0.0 * TIME, 0.0, 2.9)
    ).departures
    assert text.endswith("the flight is steady from 5.7 s on: start there or later")


def test_a_hole_in_a_control_leaves_the_advice(case):
    roll = held((3.0, 5.0), 10.0 * DEGREE)
    whole = check(case, (4.0, 24.0), "2.d.4", p=roll)
    assert whole.unchecked == ()
    zero = 0.0 * TIME
    places = ("4 s, where the window starts", "2.7 s, the earlier start", "5.7 s, the later start")
    for name, stop in (("F_pedal", 28.0), ("F_column", 6.0)):
        found = check(case, (4.0, 24.0), "2.d.4", p=roll, **{name: with_hole(zero, 0.0, stop)})
        assert found.departures == whole.departures
        assert found.unchecked == tuple(
            f"whether the flight is steady at {place}: the record has no {name} there; only the "
            f"other channels are checked"
            for place in places
        )
    # a control that is missing at the earlier start alone
    found = check(case, (4.0, 24.0), "2.d.4", p=roll, F_pedal=with_hole(zero, 0.0, 3.0))
    (text,) = found.unchecked
    assert "at 2.7 s, the earlier start: the record has no F_pedal there" in text


def test_a_line_through_missing_samples_is_no_movement(case):
    # the aileron moves somewhere between 2.5 and 3.4 s
    aileron = with_hole(held((3.0, 4.5), 8.0 * DEGREE), 2.5, 3.4)
    found = check(case, (3.2, 13.1), delta_a=aileron)
    assert found.departures == ()
    assert "the record has no delta_a there" in found.unchecked[0]
    # samples before the hole show a movement
    wheel = with_hole(held((2.8, 4.5), 8.0 * DEGREE), 3.0, 3.4)
    (text,) = check(case, (3.2, 13.1), delta_a=wheel).departures
    assert "aileron deflection" in text


def departures(window, test="2.d.2", control="delta_a", hold=(3.0, 4.5), rate=0.0):
    """Return the departures of a window for a control that is held, with the bank that follows."""
    case = fixture.roll_result().case
    rows = tuple(replace(row, window=window) for row in case.criteria)
    case = replace(case, id=test, criteria=rows, window=window)
    held = np.where((hold[0] < TIME) & (hold[1] > TIME), 8.0 * DEGREE, 0.0)
    zero = 0.0 * TIME
    p = np.where((hold[0] < TIME) & (hold[1] + 2.0 > TIME), 20.0 * DEGREE, rate)
    motion = dict.fromkeys(("phi", "theta", "q", "r", "delta_e", "delta_a", "delta_r"), zero)
    motion |= {"p": p, control: held}
    states = {name: ("time", values) for name, values in motion.items()}
    return window_departures(case, xr.Dataset(states, {"time": TIME}))


def test_a_window_around_the_whole_input_is_right():
    assert departures((1.9, 11.9)) == ()
    # it ends at the last sample of the record, which shows no return
    assert departures((1.9, 29.98), hold=(3.0, 31.0)) == ()


def test_a_window_that_ends_before_the_return_departs():
    (text,) = departures((1.9, 4.0))
    assert text == (
        "the window ends at 4 s, 0.5 s before the input of the aileron ends; the return is not "
        "judged"
    )
    # a control that stays away much longer than it was judged is a step
    assert departures((1.9, 4.0), hold=(3.0, 20.0)) == ()
    # neither another axis nor a test without a free response is an open input
    assert departures((1.9, 4.0), control="delta_e") == ()
    assert departures((1.9, 4.0), test="2.c.1") == ()


def test_an_unsteady_start_departs_and_names_the_last_steady_instant():
    (text,) = departures((3.6, 13.1))
    assert "starts at 3.6 s in unsteady flight" in text
    assert "bank angle changes by 20 deg/s" in text
    assert "steady until 2.7 s: start there or earlier" in text


def test_a_small_motion_before_a_large_response_is_steady():
    # turbulence of 1.5 deg/s before a response of 20 deg/s
    assert departures((1.9, 11.9), rate=1.5 * DEGREE) == ()
    (text,) = departures((1.9, 11.9), rate=3.0 * DEGREE)
    assert "choose a record with steady flight" in text


def test_the_departure_of_the_record_is_a_remark():
    states = xr.Dataset(attrs={WINDOW: ("it ends early",)})
    (remark,) = window_remarks(states)
    assert (remark.kind, remark.text) == ("departure", "departure: it ends early")
