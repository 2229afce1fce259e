"""One flight under two titles is named by its noise; two flights flown alike are not."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pom.checking.report_checks import with_report_checks
from pom.judging.conditions.condition_coverage import cover_conditions
from pom.probing.shared_flights import ALIKE, compare_noise

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

TIME = np.arange(0.0, 20.0, 0.02)
NAMES = ("p", "q", "r")


def flight(seed):
    """Return a roll with the noise of its instruments (time,)."""
    generator = np.random.default_rng(seed)
    roll = np.exp(-0.2 * TIME) * np.sin(2.0 * TIME)
    return {name: roll + 0.01 * generator.standard_normal(TIME.size) for name in NAMES}


def part(traces, start, stop, step=0.02):
    """Return the clock and the samples of a part of a flight, interpolated."""
    time = np.arange(start, stop, step)
    return time + 100.0, {name: np.interp(time, TIME, item) for name, item in traces.items()}


@pytest.mark.parametrize("step", [0.02, 0.04, 0.01])
def test_a_trimmed_copy_on_another_clock_and_rate_is_one(step):
    traces = flight(1)
    correlation, overlap = compare_noise(TIME, traces, *part(traces, 3.0, 15.0, step))
    assert correlation > 0.9
    assert overlap == pytest.approx(12.0, abs=0.3)


def test_a_copy_between_the_samples_is_one():
    traces = flight(1)
    correlation, _ = compare_noise(TIME, traces, *part(traces, 3.01, 15.0))
    assert correlation > ALIKE


def test_a_flight_that_was_flown_alike_is_another_one():
    correlation, _ = compare_noise(TIME, flight(1), TIME, flight(2))
    assert correlation < 0.25
    # without noise nothing is compared
    smooth = {name: np.sin(TIME) for name in NAMES}
    assert compare_noise(TIME, smooth, TIME, smooth) == (0.0, 0.0)


def case_of(name, **more):
    result = fixture.roll_result()
    return replace(result, case=replace(result.case, name=name, title=name, **more))


def kinds(result):
    found = []
    for remark in result.rows[0]["remarks"]:
        if remark.quantity == "shared_flight":
            found.append((remark.kind, remark.text))
    return found


def test_one_flight_under_two_titles_counts_once():
    first, second = with_report_checks([case_of("one"), case_of("two")])
    ((kind, text),) = kinds(second)
    assert kind == "departure"
    assert "the same flight is judged as case one" in text
    assert kinds(first)[0][0] == "probe"
    # roll response: cruise, and approach or landing
    assert cover_conditions([first, second]).text.startswith("1 of 2")
    # an additional case counts for nothing anyway
    first, second = with_report_checks([case_of("one"), case_of("two", additional="once more")])
    assert kinds(second)[0][0] == "probe"


def test_parts_of_one_record_are_two_flights():
    first = case_of("one")
    start, stop = first.case.window
    middle = 0.5 * (start + stop)
    later = case_of("two", window=(middle, stop + middle - start))
    earlier = case_of("one", window=(start, middle))
    assert [kinds(item) for item in with_report_checks([earlier, later])] == [[], []]


def smooth_result(name, seed, **more):
    """Return a result whose flight has a motion of its own and no noise."""
    result = fixture.roll_result()
    time = result.signals["time"].values
    generator = np.random.default_rng(seed)
    signals = result.signals.copy(deep=True)
    for channel in ("p", "q", "r"):
        motion = np.cumsum(generator.standard_normal(time.size // 10 + 2))
        clock = time[0] + 10 * np.arange(motion.size) * (time[1] - time[0])
        values = np.interp(time, clock, motion)
        rows = np.stack([values] * signals.sizes["run"])
        signals[channel] = (("run", "time"), rows, {"units": "rad s-1"})
    case = replace(result.case, name=name, title=name, **more)
    return replace(result, signals=signals, case=case)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "kind"),
    [
        ({"id": "2.d.7", "record": "copy.nc"}, "departure"),
        # the same record, openly: rules let some tests be flown together
        ({"id": "2.d.7"}, "record_warning"),
        ({"id": "2.d.7", "record": "copy.nc", "additional": "once more"}, "probe"),
        ({"record": "copy.nc"}, "departure"),
    ],
)
def test_one_flight_of_two_tests_is_named(more, kind):
    _, second = with_report_checks([smooth_result("one", 1), smooth_result("two", 1, **more)])
    (found,) = [r for r in second.rows[0]["remarks"] if r.quantity.startswith("shared_flight")]
    assert found.kind == kind
    assert "the same flight is judged as case one" in found.text


def test_another_motion_is_another_flight():
    cases = [smooth_result("one", 1), smooth_result("two", 2, id="2.d.7", record="other.nc")]
    for result in with_report_checks(cases):
        remarks = result.rows[0]["remarks"]
        assert not [r for r in remarks if r.quantity.startswith("shared_flight")]
