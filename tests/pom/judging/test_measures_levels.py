"""Snapshots, changes between two of them, ends of records, segments, preconditions: against numbers
made by hand.
"""

import numpy as np
import pytest

from flightmech.units import FOOT, KNOT
from pom.cases.case_inputs import CaseInputs
from pom.cases.pilot import PilotLoop
from pom.tolerances.bands import remarks_text

TIME = np.arange(0.0, 60.001, 0.02)
DEG = np.pi / 180.0
FLAT = np.ones_like(TIME)
TRIM = {
    "delta_t": 0.0 * FLAT,
    "delta_e": -2.0 * DEG * FLAT,
    "theta": 3.0 * DEG * FLAT,
    "engine1.thrust": 8000.0 * FLAT,
}
RECORDED = CaseInputs("recorded", "thrust", trim=True)


def test_a_snapshot_compares_means_of_steady_records(judged):
    wavy = TRIM | {"theta": (3.0 + 0.2 * np.sin(2.0 * np.pi * TIME)) * DEG}
    got = judged(
        "2.c.5",
        TIME,
        wavy,
        TRIM | {"theta": 3.6 * DEG * FLAT},
        drive=RECORDED,
        events={"capture": 30.0},
    )["pitch_angle"]
    assert got["verdict"] == "pass"
    assert (got["flight_value"], got["model_value"]) == pytest.approx((3.0, 3.6), abs=2e-3)
    assert got["worst_ratio"] == pytest.approx(0.6, abs=2e-3)  # of 1 deg
    # 0.2 deg of sine over five periods: standard deviation 0.141 deg, the fitted line falls by 6/(5
    # pi) 0.2 deg
    assert remarks_text(got["remarks"]).startswith(
        "steady: flight drift 0.08, spread 0.14; the model drift 0.00, spread 0.00 of the tolerance"
    )
    assert got["applied_text"] == "1 deg"


def test_a_drifting_record_is_invalid_on_either_side(judged):
    drifting = TRIM | {
        "theta": (3.0 + 0.1 * TIME) * DEG
    }  # 0.5 deg in 5 s, one third of 1 deg is 0.33
    for pair in ((drifting, TRIM), (TRIM, drifting)):
        got = judged("2.c.5", TIME, *pair, drive=RECORDED, events={"capture": 30.0})["pitch_angle"]
        assert got["verdict"] == "invalid"
        assert (
            "is not steady: drift 0.50, spread 0.00 of the tolerance (1/3 allowed)"
            in remarks_text(got["remarks"])
        )


def test_a_snapshot_needs_4_s_before_and_1_s_after(judged):
    got = judged("2.c.5", TIME, TRIM, TRIM, drive=RECORDED, events={"capture": 3.0})["pitch_angle"]
    assert (got["verdict"], "the window is -1.00 ... 4.00 s" in remarks_text(got["remarks"])) == (
        "invalid",
        True,
    )
    got = judged("2.c.5", TIME, TRIM, TRIM, drive=RECORDED)["pitch_angle"]
    assert (got["verdict"], remarks_text(got["remarks"])[:40]) == (
        "not_tested",
        "give the event capture in [events]; the ",
    )


def test_a_snapshot_judges_the_elevator_that_the_trim_found(judged):
    """The record drives the elevator, but the trim at the start adds what the model needs more:
    applied.delta_e shows it.
    """
    model = {**TRIM, "applied.delta_e": -2.7 * DEG * FLAT}
    del model["delta_e"]
    got = judged("2.c.5", TIME, TRIM, model, drive=RECORDED, events={"capture": 30.0})
    assert got["elevator"]["worst"] == pytest.approx(-0.7)
    assert got["elevator"]["verdict"] == "pass"
    untrimmed = judged(
        "2.c.5",
        TIME,
        TRIM,
        model,
        drive=CaseInputs("recorded", "thrust", trim=False),
        events={"capture": 30.0},
    )
    assert remarks_text(untrimmed["elevator"]["remarks"]).startswith(
        "delta_e is driven by the record"
    )
    assert got["trim_surface"]["verdict"] == "not_tested"  # nothing trims the tab


def test_a_lone_percentage_is_of_the_largest_value_in_service(judged):
    """5 % of net thrust (2.c.5): rule R3.  8000 N in flight, 8700 N in the model, 20 kN in
    service.
    """
    model = TRIM | {"engine1.thrust": 8700.0 * FLAT}
    kwargs = {"drive": RECORDED, "events": {"capture": 30.0}}
    got = judged("2.c.5", TIME, TRIM, model, **kwargs)["net_thrust"]
    assert got["verdict"] == "not_tested"  # 8.75 % of the flight value: only the range can decide
    assert "give that of engine1.thrust in [ranges]" in remarks_text(got["remarks"])
    got = judged("2.c.5", TIME, TRIM, model, ranges={"engine1.thrust": 20e3}, **kwargs)[
        "net_thrust"
    ]
    assert (got["verdict"], round(got["worst_ratio"], 9)) == ("pass", 0.7)  # 700 N of 1000 N
    assert got["applied_text"] == "5 % of the largest value in service (4496 lbf): 224.8 lbf"
    close = judged("2.c.5", TIME, TRIM, TRIM | {"engine1.thrust": 8300.0 * FLAT}, **kwargs)[
        "net_thrust"
    ]
    assert (
        close["verdict"] == "pass"
    )  # 3.75 % of the flight value is less than 5 % of anything larger
    assert "passes on the flight value" in remarks_text(close["remarks"])


def test_two_snapshots_give_a_change(judged):
    """Elevator per speed (2.c.7, alternative method): 10 % or 1 deg of the change between trim and
    capture.
    """
    flight = {"delta_e": np.where(TIME < 20.0, -1.0, 3.0) * DEG}
    model = {"delta_e": np.where(TIME < 20.0, 2.0, 6.9) * DEG}
    events = {"trim": 10.0, "capture": 40.0}
    got = judged(
        "2.c.7",
        TIME,
        flight,
        model,
        features=("alternative_method",),
        events=events,
        drive=RECORDED,
    )["elevator_change"]
    assert (got["flight_value"], got["model_value"]) == pytest.approx((4.0, 4.9))
    assert got["worst_ratio"] == pytest.approx(0.9)  # 1 deg governs over 0.4 deg
    silent = judged("2.c.7", TIME, flight, model, events=events, drive=RECORDED)["elevator_change"]
    assert remarks_text(silent["remarks"]).startswith("applies only with alternative_method")


def test_climb_rate_is_height_over_time(judged):
    """2.4 m/s oscillation on 8 m/s: the mean of the instants would be the same, the ends show it; 5
    % or 100 ft/min.
    """
    oscillation = 30.0 * (1.0 - np.cos(2.0 * np.pi * TIME / 60.0)) / 2.0
    flight = {"h": 1000.0 + 8.0 * TIME + oscillation, "V_cas": 60.0 * FLAT, "V": 70.0 * FLAT}
    model = {"h": 1000.0 + 8.6 * TIME, "V_cas": 61.0 * FLAT, "V": 70.0 * FLAT}
    got = judged("1.c.1", TIME, flight, model)
    rate = got["climb_rate"]
    assert rate["flight_value"] == pytest.approx(8.0 * 60.0 / FOOT)  # 1575 ft/min
    assert rate["worst"] == pytest.approx(0.6 * 60.0 / FOOT)
    assert rate["verdict"] == "fail"  # 118 ft/min; 5 % are 79, 100 governs
    assert rate["worst_ratio"] == pytest.approx(0.6 * 60.0 / FOOT / 100.0)
    assert got["airspeed"]["worst_ratio"] == pytest.approx(1.0 / (3.0 * KNOT))
    assert remarks_text(rate["remarks"]).startswith("segment of 1575 ft")


def test_descent_rate_counts_downwards_and_a_short_segment_is_invalid(judged):
    flight = {"h": 3000.0 - 10.0 * TIME, "V_cas": 90.0 * FLAT}
    got = judged("1.d.4", TIME, flight, flight)["descent_rate"]
    assert got["flight_value"] == pytest.approx(10.0 * 60.0 / FOOT)
    got = judged("1.d.5", TIME, flight, flight)["descent_rate"]  # 1969 of 3000 ft
    assert got["verdict"] == "invalid"
    assert "segment of 1969 ft; the table requires 3000 ft or more" in remarks_text(got["remarks"])
    got = judged("1.d.5", TIME, flight, flight, shortened="the flight was broken off")[
        "descent_rate"
    ]
    assert (
        got["verdict"],
        remarks_text(got["remarks"]).startswith("segment of 1969 ft of 3000 ft required"),
    ) == ("pass", True)


def test_a_gradient_below_the_certified_one_fails_inside_its_band(judged):
    """V 50 m/s, 1.25 and 1.15 m/s up: gradients 1.25 / sqrt(50^2 - 1.25^2) = 0.025008 and
    0.023006.
    """
    flight = {"h": 500.0 + 1.25 * TIME, "V": 50.0 * FLAT, "V_cas": 48.0 * FLAT}
    model = flight | {"h": 500.0 + 1.15 * TIME}
    kwargs = {"certified": {"climb_gradient": 0.024}, "shortened": "one engine out, 60 s"}
    got = judged("1.c.2", TIME, flight, model, **kwargs)
    assert got["climb_rate"]["verdict"] == "pass"
    assert got["climb_gradient"]["verdict"] == "fail"
    assert got["climb_gradient"]["flight_value"] == pytest.approx(
        100.0 * 1.25 / np.sqrt(2500.0 - 1.25**2)
    )
    assert got["climb_gradient"]["model_value"] == pytest.approx(
        100.0 * 1.15 / np.sqrt(2500.0 - 1.15**2)
    )
    assert got["climb_gradient"]["worst_ratio"] == pytest.approx(0.024 / 0.0230061, rel=1e-5)
    assert got["climb_gradient"]["tolerance_text"] == "not below the certified value"
    assert judged("1.c.2", TIME, flight, flight, **kwargs)["climb_gradient"]["verdict"] == "pass"
    silent = judged("1.c.2", TIME, flight, flight, shortened="60 s")["climb_gradient"]
    assert (silent["verdict"], remarks_text(silent["remarks"])[:37]) == (
        "not_tested",
        "give the certified climb_gradient in ",
    )


def test_only_the_low_speed_end_of_a_deceleration_counts(judged):
    """80 to 20 kt in 60 s: the lowest tenth of the range are the 6 s after 54 s."""
    V = (80.0 - TIME) * KNOT
    flight = {"V_cas": V, "vn": V, "ve": 0.0 * V, "psi": 0.0 * V}
    early = flight | {"psi": np.where(TIME < 53.0, 20.0, 2.0) * DEG}
    assert judged("2.e.9", TIME, flight, early)["heading"]["verdict"] == "pass"
    late = flight | {"psi": np.where(TIME > 55.0, 3.5, 0.0) * DEG}
    got = judged("2.e.9", TIME, flight, late)["heading"]
    assert got["verdict"] == "fail"
    assert remarks_text(got["remarks"]).startswith("low-speed end, from 54.0 s on")
    assert got["inside"] == pytest.approx(1.0 / 6.0, abs=5e-3)


def test_a_precondition_that_does_not_hold_makes_the_test_invalid_not_failed(judged):
    """Engine failure speed of a Vmcg test (1.b.2): 1 kt."""
    flight = {"V_cas": 50.0 + TIME, "vn": 50.0 * FLAT, "ve": 0.0 * FLAT, "F_pedal": 0.0 * FLAT}
    events = {"engine_failure": 20.0, "recovery": 50.0}
    near = judged(
        "1.b.2", TIME, flight, flight | {"V_cas": 50.0 + TIME + 0.9 * KNOT}, events=events
    )["engine_failure_speed"]
    assert (near["verdict"], round(near["worst_ratio"], 9)) == ("pass", 0.9)
    far = judged(
        "1.b.2", TIME, flight, flight | {"V_cas": 50.0 + TIME + 1.1 * KNOT}, events=events
    )["engine_failure_speed"]
    assert far["verdict"] == "invalid"
    assert remarks_text(far["remarks"]).startswith(
        "a precondition of the test does not hold: the test is not valid"
    )
    assert far["flight_value"] == pytest.approx(70.0 / KNOT)


def test_lateral_deviation_is_formed_of_ground_speed_alike_in_both(judged):
    """Both start on the track; flight drifts by 0.2 m/s from 20 s on, the model by 0.25: 8 and 10 m
    at 60 s.
    """
    track = 30.0 * DEG

    def run(drift):
        along, across = 60.0 * FLAT, np.where(TIME > 20.0, drift, 0.0)
        return {
            "vn": along * np.cos(track) - across * np.sin(track),
            "ve": along * np.sin(track) + across * np.cos(track),
            "V_cas": 60.0 * FLAT,
        }

    events = {"engine_failure": 15.0, "recovery": 60.0}
    got = judged("1.b.2", TIME, run(0.2), run(0.25), events=events)["lateral_deviation"]
    assert got["worst"] * FOOT == pytest.approx(2.0, abs=2e-3)
    assert got["width"] * FOOT == pytest.approx(
        0.25 * 8.0, abs=2e-3
    )  # 25 % of the largest flight value, 8 m, over 5 ft
    assert (
        got["applied_text"]
        == "25 % of the largest flight value or 5 ft, the greater (26.24 ft): 6.56 ft"
    )


def test_radius_of_a_turn_and_rate_of_a_trim_surface(judged):
    """5 m/s at 0.25 rad/s is a circle of 20 m; the tolerance is 3 ft or 20 %, so 4 m."""

    def turn(rate):
        psi = rate * TIME
        return {"psi": np.mod(psi, 2.0 * np.pi), "vn": 5.0 * np.cos(psi), "ve": 5.0 * np.sin(psi)}

    got = judged("1.a.1", TIME, turn(0.25), turn(0.22))["turn_radius"]
    assert got["flight_value"] == pytest.approx(20.0 / FOOT, rel=1e-5)
    assert got["worst_ratio"] == pytest.approx((5.0 / 0.22 - 20.0) / 4.0, rel=1e-4)
    straight = judged("1.a.1", TIME, turn(0.25), turn(0.02))["turn_radius"]
    assert (
        straight["verdict"],
        "the model turns by 69 deg" in remarks_text(straight["remarks"]),
    ) == (
        "invalid",
        True,
    )

    def trim(rate):
        return {"delta_t": np.clip(rate * (TIME - 10.0), 0.0, 8.0) * DEG}

    driven = judged("2.a.7", TIME, trim(0.4), trim(0.43))[
        "trim_rate"
    ]  # by the record, which the model would only repeat
    assert (
        driven["verdict"],
        "delta_t is driven by the record" in remarks_text(driven["remarks"]),
    ) == (
        "not_tested",
        True,
    )
    moved = CaseInputs("pilot", "throttle", pilot=(PilotLoop("delta_t", "q", 1.0, 0.1),))
    got = judged("2.a.7", TIME, trim(0.4), trim(0.43), drive=moved)["trim_rate"]
    assert got["flight_value"] == pytest.approx(0.4, rel=1e-6)
    assert (got["verdict"], round(got["worst_ratio"], 6)) == ("pass", 0.75)  # 7.5 % of 10 %
    stabilizer = {"i_h": np.clip(0.4 * (TIME - 10.0), 0.0, 8.0) * DEG}
    assert judged("2.a.7", TIME, stabilizer, stabilizer)["trim_rate"]["verdict"] == "pass"
