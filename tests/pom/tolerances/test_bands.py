"""Time histories against hand-computed bands, and the traps of the tolerance table's README."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pom.cases.case import PomCase
from pom.judging.signals import Comparison
from pom.tolerances import bands, rows
from pom.tolerances.bands import (
    Invalid,
    NotJudged,
    half_width,
    inside_window,
    judge_number,
    remarks_text,
    unwrapped_difference,
)
from pom.tolerances.criteria import Band, Criterion, Limit

TIME = np.arange(0.0, 10.001, 0.02)
DEG = math.pi / 180.0


PITCH = Band((Limit("absolute", 1.5, "deg"),))


def criterion(channel="theta", band=PITCH, window=(0.0, 10.0), measure="trace"):
    return Criterion("c", "", channel, measure, "g", band, window)


def trace(criterion, time, flight, model):
    case = PomCase("c", "C", "2.d.6", rows.STANDARD, rows.EDITION, "c.toml", "r.nc", (0.0, 10.0))
    match = Comparison.of(case, time, {criterion.channel: flight}, {criterion.channel: model})
    return bands.judge_trace(criterion, *match.both(criterion))


def both(percent, absolute, unit, rule="greater_of", base="ref_local"):
    return Band((Limit("percent", percent, "%"), Limit("absolute", absolute, unit)), rule, base)


def test_inside_the_band_passes_with_its_ratio():
    flight = 5.0 * DEG * np.sin(TIME)
    got = trace(criterion(), TIME, flight, flight + 0.3 * DEG)
    assert (got.verdict, got.inside) == ("pass", 1.0)
    assert got.worst_ratio == pytest.approx(0.2, rel=1e-12)  # 0.3 of 1.5 deg
    assert math.isnan(got.first_exit)


def test_a_difference_of_exactly_the_tolerance_passes_and_a_hair_more_fails():
    flight = np.zeros_like(TIME)
    assert trace(criterion(), TIME, flight, flight + 1.5 * DEG).verdict == "pass"
    assert trace(criterion(), TIME, flight, flight + 1.5001 * DEG).verdict == "fail"


def test_exit_is_given_by_time_share_and_longest_run():
    model = np.zeros_like(TIME)
    model[(TIME >= 3.999) & (TIME <= 4.481)] = -2.0 * DEG  # 25 samples
    model[TIME[400] == TIME] = -3.0 * DEG
    got = trace(criterion(), TIME, np.zeros_like(TIME), model)
    assert (got.verdict, remarks_text(got.remarks)) == ("fail", "longest run outside 0.50 s")
    assert got.first_exit == pytest.approx(4.0)
    assert got.at == pytest.approx(8.0)
    assert got.worst == pytest.approx(-3.0 * DEG)
    assert got.worst_ratio == pytest.approx(2.0)
    assert got.inside == pytest.approx(1.0 - 26.0 / 501.0)


def test_greater_of_is_the_wider_at_each_instant():
    flight = np.array([0.0, 10.0, 20.0, 40.0, -40.0]) * DEG
    wide = half_width(criterion("p", both(10.0, 2.0, "deg/s")), flight) / DEG
    np.testing.assert_allclose(wide, [2.0, 2.0, 2.0, 4.0, 4.0], rtol=1e-14)
    narrow = half_width(criterion("p", both(10.0, 2.0, "deg/s", "lesser_of")), flight) / DEG
    np.testing.assert_allclose(narrow, [0.0, 1.0, 2.0, 2.0, 2.0], rtol=1e-14)


def test_percent_base_local_against_peak():
    flight = np.array([0.0, 10.0, -40.0])
    band = Band((Limit("percent", 10.0, "%"),), "single", "ref_peak")
    np.testing.assert_allclose(
        half_width(criterion("V", band), flight), [4.0, 4.0, 4.0], rtol=1e-15
    )
    band = Band((Limit("percent", 10.0, "%"),), "single", "ref_local")
    np.testing.assert_allclose(
        half_width(criterion("V", band), flight), [0.0, 1.0, 4.0], rtol=1e-15
    )


def test_a_lone_percentage_of_the_operating_range_is_not_judged():
    band = Band((Limit("percent", 5.0, "%"),), "single", "range_max")
    with pytest.raises(NotJudged, match="largest value in service"):
        half_width(criterion("V", band), np.ones(3))


def test_a_nan_tail_of_the_model_is_invalid_and_not_a_pass():
    model = np.zeros_like(TIME)
    model[TIME > 9.1] = np.nan
    with pytest.raises(
        Invalid, match=r"the model has no value in 45 of 501 samples, first at 9.12 s"
    ):
        trace(criterion(), TIME, np.zeros_like(TIME), model)
    with pytest.raises(Invalid, match="flight has no value"):
        trace(criterion(), TIME, model, np.zeros_like(TIME))


def test_a_record_60_percent_short_is_invalid():
    short = TIME[TIME <= 4.0]
    with pytest.raises(
        Invalid, match=r"samples cover 0.00 ... 4.00 s, the window is 0.00 ... 10.00 s"
    ):
        trace(criterion(), short, np.zeros_like(short), np.zeros_like(short))


def test_time_that_does_not_rise_is_invalid():
    time = TIME.copy()
    time[100] = time[99]
    with pytest.raises(Invalid, match="does not rise"):
        inside_window(time, (0.0, 10.0))


def test_headings_on_both_sides_of_north_are_near():
    flight = np.mod(np.linspace(355.0, 365.0, TIME.size), 360.0) * DEG
    model = np.mod(np.linspace(357.0, 366.0, TIME.size), 360.0) * DEG
    error = unwrapped_difference("psi", flight, model) / DEG
    np.testing.assert_allclose(error, np.linspace(2.0, 1.0, TIME.size), atol=1e-10)
    got = trace(criterion("psi", Band((Limit("absolute", 3.0, "deg"),))), TIME, flight, model)
    assert (got.verdict, round(got.worst_ratio, 6)) == ("pass", round(2.0 / 3.0, 6))


def test_pitch_attitude_is_not_unwrapped():
    assert unwrapped_difference("theta", np.array([0.0]), np.array([6.0]))[0] == 6.0


def test_a_lag_of_0p15_s_breaks_a_rate_band():
    # doublet of 24 deg/s at 0.9 s half period: slope 2 pi/1.8 * 24 = 83.8 deg/s2, so 0.15 s are up
    # to 12.5 deg/s
    q = (
        24.0
        * DEG
        * np.where((TIME > 2.0) & (TIME < 3.8), np.sin(2.0 * np.pi * (TIME - 2.0) / 1.8), 0.0)
    )
    late = np.interp(TIME - 0.15, TIME, q)
    band = Band((Limit("absolute", 2.0, "deg/s"),))
    got = trace(criterion("q", band), TIME, q, late)
    assert got.verdict == "fail"
    assert got.worst_ratio == pytest.approx(
        2.0 * 24.0 * math.sin(math.pi * 0.15 / 1.8) / 2.0, rel=5e-3
    )  # sum-to-product
    shifted = trace(criterion("q", band), TIME, q, np.interp(TIME + 0.15, TIME, late))
    assert shifted.worst_ratio < 0.6  # the same shape: only the delay was at fault


def test_the_band_is_not_centred_again_on_the_start_of_the_model():
    flight = 5.0 * DEG * np.sin(TIME)
    assert trace(criterion(), TIME, flight, flight + 2.0 * DEG).verdict == "fail"


def test_only_the_window_counts():
    model = np.where(TIME > 5.0, 9.0, 0.0)
    assert trace(criterion(window=(0.0, 5.0)), TIME, np.zeros_like(TIME), model).verdict == "pass"


def test_units_of_the_table_are_exact():
    assert half_width(criterion("V_cas", Band((Limit("absolute", 3.0, "kt"),))), 80.0)[
        0
    ] == pytest.approx(3.0 * 1852.0 / 3600.0, rel=1e-15)
    assert half_width(criterion("h", Band((Limit("absolute", 100.0, "ft"),))), 80.0)[
        0
    ] == pytest.approx(30.48, rel=1e-15)
    assert half_width(criterion("nz", Band((Limit("absolute", 0.1, "g"),))), 1.0)[0] == 0.1


def test_scalar_takes_the_percentage_of_the_flight_value():
    band = both(10.0, 0.5, "s", base="ref_scalar")
    assert (
        judge_number(criterion("r", band, measure="period"), 3.0, 3.49).verdict == "pass"
    )  # 0.5 s governs
    assert (
        judge_number(criterion("r", band, measure="period"), 8.0, 8.81).verdict == "fail"
    )  # 0.8 s governs


def test_a_share_of_the_tolerance_for_engineering_simulator_data():
    """Rule R9: 20 % of it before 2016, 40 % after; greater of 10 % of 38 s and 0.5 s is 3.8 s, of
    which 0.76 s are left.
    """
    whole = criterion("r", both(10.0, 0.5, "s", base="ref_scalar"), measure="period")
    fifth = replace(whole, fraction=0.2)
    assert half_width(fifth, 38.0)[0] == pytest.approx(0.76)
    got = judge_number(fifth, 38.0, 38.8)
    assert (got.verdict, got.worst_ratio) == ("fail", pytest.approx(0.8 / 0.76))
    assert got.applied == "20 % of: 10 % of the flight value or 0.5 s, the greater (38 s): 0.76 s"
    assert judge_number(replace(whole, fraction=0.4), 38.0, 38.8).verdict == "pass"
    assert (
        trace(
            replace(criterion(), fraction=0.4),
            TIME,
            np.zeros_like(TIME),
            np.full_like(TIME, 0.59 * DEG),
        ).verdict
        == "pass"
    )


def test_the_range_in_service_is_the_base_of_a_lone_percentage():
    band = Band((Limit("percent", 5.0, "%"),), "single", "range_max")
    wide = replace(criterion("V", band), largest=120.0)
    np.testing.assert_allclose(half_width(wide, np.array([1.0, 50.0])), [6.0, 6.0])


def test_a_percentage_that_grows_with_the_cycle():
    band = Band((Limit("percent_times_n_plus_1", 10.0, "%"),), "single", "ref_scalar")
    wide = criterion("column", band, measure="period_n")
    assert [half_width(wide, 0.8, n)[0] for n in (1, 2, 3)] == pytest.approx([0.16, 0.24, 0.32])
    assert band.text == "10(n+1) % of the flight value"


def test_the_tolerance_as_applied_states_base_and_numbers():
    flight = 40.0 * DEG * np.sin(TIME)
    local = trace(criterion("p", both(10.0, 2.0, "deg/s")), TIME, flight, flight)
    assert local.applied == "10 % of the flight value or 2 deg/s, the greater: 2 ... 4 deg/s"
    peak = trace(
        criterion("q", both(20.0, 0.15, "deg/s", base="ref_peak")),
        TIME,
        2.0 * DEG * np.sin(TIME),
        2.0 * DEG * np.sin(TIME),
    )
    assert (
        peak.applied
        == "20 % of the largest flight value or 0.15 deg/s, the greater (2 deg/s): 0.4 deg/s"
    )
    smaller = criterion(
        "distance", both(10.0, 200.0, "ft", "lesser_of", "ref_scalar"), measure="elapsed"
    )
    assert (
        judge_number(smaller, 3000.0 * 0.3048, 3000.0 * 0.3048).applied
        == "10 % of the flight value or 200 ft, the smaller (3000 ft): 200 ft"
    )


def test_the_readme_doublet_of_a_late_response_differs_by_3p6_deg_per_s():
    """Trap 7: a doublet of 1 s each way, 12 deg/s: 0.15 s late it is 3.6 deg/s off on the slope of
    24 deg/s2.
    """
    q = 12.0 * DEG * np.interp(TIME, [2.0, 2.5, 3.5, 4.0], [0.0, 1.0, -1.0, 0.0])
    late = 12.0 * DEG * np.interp(TIME - 0.15, [2.0, 2.5, 3.5, 4.0], [0.0, 1.0, -1.0, 0.0])
    got = trace(criterion("q", Band((Limit("absolute", 2.0, "deg/s"),))), TIME, q, late)
    assert abs(got.worst) / DEG == pytest.approx(3.6)
    assert (got.verdict, got.worst_ratio) == ("fail", pytest.approx(1.8))
