"""Flight conditions that a row wants: two cases in one condition cover one."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from flightmech.units import DEGREE
from pom.judging.conditions.condition_coverage import WANTED, cover_conditions
from pom.judging.conditions.configurations import CONFIGURATION_CHECKS
from pom.report.overview import table_coverage
from pom.result import make_verdict_table
from pom.status import PASSED
from pom.tolerances.bands import RowRemark
from pom.tolerances.editions import test_order as order_of_test

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture


def flown(flaps=0.0, gear=0.0, test="2.d.2", **more):
    """A roll response (cruise, and approach or landing) with flaps [deg] and gear."""
    result = fixture.roll_result()
    time = result.inputs["time"]
    inputs = result.inputs.assign(
        delta_f=("time", 0.0 * time.values + flaps * DEGREE),
        gear=("time", 0.0 * time.values + gear),
    )
    return replace(result, case=replace(result.case, id=test, **more), inputs=inputs)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cases", "text"),
    [
        ([{}], "1 of 2; missing: approach or landing"),
        ([{}, {}], "1 of 2; missing: approach or landing"),
        ([{"flaps": 20.0}], "1 of 2; missing: cruise"),
        ([{"flaps": 20.0, "gear": 1.0}, {}], "2 of 2"),
        # flaps in and gear down is none of the two
        ([{"gear": 1.0}], "0 of 2; missing: cruise, approach or landing"),
        (
            [{}, {"flaps": 20.0, "additional": "a check of the model"}],
            "1 of 2; missing: approach or landing",
        ),
        # one condition is enough
        ([{"test": "2.c.10"}], ""),
    ],
)
def test_conditions_are_covered_by_cases_that_show_them(cases, text):
    assert cover_conditions([flown(**case) for case in cases]).text == text


def test_a_case_that_fits_two_conditions_gives_way_to_the_other():
    # flaps out and gear down is approach and landing; flaps out and gear up is approach only
    both, approach = {"flaps": 30.0, "gear": 1.0}, {"flaps": 20.0}
    for cases in ([both, approach], [approach, both]):
        found = cover_conditions([flown(test="2.c.5", **case) for case in cases])
        assert found.covered == ("approach", "landing")
        assert found.missing == ("cruise",)


def with_departure(result, runs):
    remark = RowRemark("departure", "departure: the aeroplane is not near maximum weight", "mass")
    rows = []
    for row in result.rows:
        more = (remark,) if row["run"] in runs else ()
        rows.append({**row, "remarks": (*row["remarks"], *more)})
    return replace(result, verdict=make_verdict_table(rows))


@pytest.mark.slow
def test_a_condition_that_only_a_case_with_departures_shows_is_stated():
    clean, extended = flown(), flown(flaps=20.0)
    departing = with_departure(extended, list(extended.runs))
    assert cover_conditions([clean, departing]).text == "2 of 2, 1 with departures"
    assert cover_conditions([departing, extended, clean]).text == "2 of 2"
    # a departure of one model that fails, such as tables that it leaves, is not one of the case
    failing = [run for run in extended.runs if extended.status(run) not in PASSED]
    assert failing
    assert cover_conditions([clean, with_departure(extended, failing)]).text == "2 of 2"
    # a test in one condition
    single = with_departure(flown(test="2.c.10"), list(clean.runs))
    rows = [{"standard": single.case.standard, "edition": single.case.edition}]
    rows = [{**rows[0], "test_id": "2.c.10", "title": "Short period"}]
    (part,) = table_coverage([single], rows)
    assert part["run"][0]["conditions"] == "1 of 1 case with departures"


def test_every_wanted_condition_has_a_check():
    for wanted in WANTED.values():
        assert {name for _, name in wanted} <= set(CONFIGURATION_CHECKS)


def test_tests_are_in_the_order_of_their_numbers(tmp_path):
    ids = ["2.c.10", "1.e.1", "2.c.9", "2.a.1.b", "2.a.1.a", "10.a"]
    assert sorted(ids, key=order_of_test) == [
        *("1.e.1", "2.a.1.a", "2.a.1.b", "2.c.9", "2.c.10", "10.a"),
    ]


def test_a_configuration_that_is_not_recorded_is_stated():
    result = flown()
    result = replace(result, inputs=result.inputs.drop_vars("delta_f"))
    assert cover_conditions([result]).text == (
        "0 of 2; not recorded: cruise, approach or landing (the record has no delta_f: record it, "
        "or state it in [conditions] of the case)"
    )
    stated = replace(result, case=replace(result.case, conditions={"delta_f": 0.0}))
    assert cover_conditions([stated]).text == "1 of 2; missing: approach or landing"
