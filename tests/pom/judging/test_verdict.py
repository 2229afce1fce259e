"""What becomes of each row in a case: judged, advisory, not tested, invalid; conditions, drives,
references, standards.
"""

from dataclasses import replace

import numpy as np
import pytest

import pom
from flightmech.units import KNOT
from pom.cases.case import PomCase
from pom.cases.case_inputs import CaseInputs
from pom.cases.pilot import PilotLoop
from pom.judging.applicability import reason_not_judged, settle_case
from pom.judging.measures import values as trends
from pom.judging.verdict import band_widths, judge_all, judge_criterion, verdict_row
from pom.status import group_verdicts, status_of
from pom.tolerances import rows as table
from pom.tolerances.bands import remarks_text
from pom.tolerances.criteria import Band, Limit
from pom.tolerances.overrides import apply_override
from pom.tolerances.rows import helpful_signals, required_quantities, required_signals

TIME = np.arange(0.0, 40.0, 0.02)
FLAT = np.ones_like(TIME)
DEG = np.pi / 180.0
OF_2016 = {"edition": "2016-05-31 (Amdt 60-4)"}


def case(id, drive=None, **more):
    window = (0.0, 39.9)
    rows = table.rows_of_test(id)
    criteria = [
        table.make_criterion(
            r, name, window, tuple(more.get("features", ())), engine_parameter="engine1.thrust"
        )
        for r, name in zip(rows, table.names_of(rows), strict=True)
    ]
    return PomCase(
        "c",
        "C",
        id,
        table.STANDARD,
        table.EDITION,
        "c.toml",
        "r.nc",
        window,
        drive=drive or CaseInputs(),
        criteria=tuple(criteria),
        **more,
    )


def named(case, name):
    return next(c for c in case.criteria if c.name == name)


# ---- what is not judged


def test_what_drives_a_model_is_not_judged():
    c = case("1.f.1")
    assert (
        reason_not_judged(c, named(c, "ti"))
        == "engine1.thrust is driven by the record; what drives a model cannot be judged"
    )
    assert reason_not_judged(case("1.f.1", CaseInputs(engine="throttle")), named(c, "ti")) == ""


def test_forces_are_judged_where_the_cockpit_is_driven():
    """Trap 8."""
    c = case("2.d.2", features=("reversible_controls",))
    force = named(c, "wheel_force")
    assert reason_not_judged(c, force) == "the surfaces are driven, so pilot forces have no meaning"
    assert reason_not_judged(case("2.d.2", CaseInputs("cockpit")), force) == ""
    assert reason_not_judged(case("2.d.2", CaseInputs("force")), force).startswith(
        "F_rim is driven"
    )
    assert not named(case("2.d.2"), "wheel_force").applies  # powered controls: the row is not there


def test_what_a_math_pilot_holds_is_not_judged_and_what_he_moves_is():
    pilot = CaseInputs("pilot", "throttle", pilot=(PilotLoop("delta_a", "phi", 0.5, 0.1),))
    c = case("2.d.8", pilot)
    assert (
        reason_not_judged(c, named(c, "bank_angle"))
        == "phi is held by the math pilot; what a controller holds cannot be judged"
    )
    assert reason_not_judged(c, named(c, "aileron")) == ""
    still = case("2.d.8", CaseInputs(trim=False))
    assert reason_not_judged(still, named(still, "aileron")).startswith("delta_a is driven")


def test_a_footprint_has_no_band_and_no_verdict():
    c = replace(case("2.d.6"), reference="footprint")
    flight = {"r": 0.1 * np.sin(TIME)}
    got = judge_criterion(c, c.criteria[0], TIME, flight, flight)
    assert (got.verdict, remarks_text(got.remarks)) == (
        "not_tested",
        "a footprint: a recording without a reference has no band and no verdict",
    )
    assert not band_widths(c, TIME, flight).data_vars


def test_demonstrations_are_explained():
    icing = table.make_criterion(
        table.rows_of_test("2.i", table.STANDARD, "2016-05-31 (Amdt 60-4)")[0],
        "demonstration",
        (0.0, 10.0),
    )
    got = judge_criterion(case("2.g"), icing, TIME, {}, {})
    assert (got.verdict, remarks_text(got.remarks)) == ("demonstration", table.DEMONSTRATION)
    shown = replace(case("2.g"), criteria=(icing,), reference="footprint")
    assert shown.is_demonstration
    assert judge_criterion(shown, icing, TIME, {}, {}).verdict == "demonstration"
    groups = group_verdicts(shown, {"demonstration": "demonstration"})
    # no pass, whatever else the report states about the run
    assert status_of(groups, limits_exceeded=True, departures=True) == "demonstration"
    assert status_of({**groups, "g2": "pass"}) == "demonstration"
    assert status_of({**groups, "g2": "fail"}) == "fail"
    assert status_of({**groups, "g2": "not_tested"}) == "not_tested"
    assert "four recordings" in case("2.g").criteria[0].note  # the row states what to fly


def test_windshear_is_judged_by_the_trend_of_the_airspeed():
    shear = {"V_cas": 60.0 - 8.0 * np.clip(TIME - 3.0, 0.0, 1.0)}
    c = case("2.g")
    assert (
        judge_criterion(c, c.criteria[0], TIME, shear, shear).verdict == "advisory"
    )  # a tick makes it a pass
    assert (
        judge_criterion(c, c.criteria[0], TIME, shear, {"V_cas": 60.0 + 0.0 * TIME}).verdict
        == "fail"
    )


def test_a_nose_wheel_that_the_record_commands_is_not_judged():
    c = case("2.a.5")
    sweep = {
        "pedal": np.sin(TIME),
        "gear.steering": 0.1 * np.sin(TIME),
        "delta_nw": 0.1 * np.sin(TIME),
    }
    c = replace(c, drive=replace(c.drive, surfaces="cockpit"))
    assert "gear.steering follows delta_nw" in remarks_text(
        judge_criterion(c, c.criteria[0], TIME, sweep, sweep).remarks
    )
    held = replace(c, conditions={"delta_nw": 0.0})
    assert judge_criterion(held, c.criteria[0], TIME, sweep, sweep).verdict == "pass"


def test_a_trim_surface_is_judged_where_the_trim_solves_for_it():
    c = replace(case("2.c.5"), events={"capture": 6.0})
    tab = next(x for x in c.criteria if x.name == "trim_surface")
    level = {"delta_t": 0.02 + 0.0 * TIME}
    forced = replace(c, drive=replace(c.drive, surfaces="force"))
    assert "driven by the record" in remarks_text(
        judge_criterion(forced, tab, TIME, level, level).remarks
    )
    solved = replace(c, drive=replace(c.drive, surfaces="force", trim_surfaces=("delta_t",)))
    assert judge_criterion(solved, tab, TIME, level, level).verdict == "pass"
    assert (
        judge_criterion(solved, tab, TIME, level, {"delta_t": 0.03 + 0.0 * TIME}).verdict == "fail"
    )  # 0.57 of 0.5 deg


def test_a_channel_that_one_side_lacks_is_not_tested():
    c = case("2.d.6")
    got = judge_criterion(c, c.criteria[0], TIME, {"r": TIME}, {"p": TIME})
    assert (got.verdict, remarks_text(got.remarks)) == ("not_tested", "the model has no r")


def test_an_input_of_a_model_is_taken_from_what_it_applies():
    pilot = CaseInputs("pilot", "throttle", pilot=(PilotLoop("delta_e", "theta", 0.5, 0.1),))
    c = case("2.f", pilot, events={"capture": 20.0})
    flight = {"delta_e": -0.05 * FLAT}
    got = judge_criterion(c, named(c, "elevator"), TIME, flight, {"applied.delta_e": -0.06 * FLAT})
    assert got.model == pytest.approx(-0.06)


def test_short_data_and_missing_samples_are_invalid_not_an_exception():
    c = case("2.d.6")
    short = TIME[TIME < 16.0]  # 60 % short
    got = judge_criterion(c, c.criteria[0], short, {"r": short}, {"r": short})
    assert (got.verdict, remarks_text(got.remarks)[:28]) == (
        "invalid",
        "samples cover 0.00 ... 15.98",
    )
    tail = np.where(TIME > 36.0, np.nan, 0.1)
    got = judge_criterion(c, c.criteria[0], TIME, {"r": 0.1 * FLAT}, {"r": tail})
    assert (got.verdict, remarks_text(got.remarks)[:28]) == (
        "invalid",
        "the model has no value in 19",
    )


# ---- which rows count, and where


def test_a_row_outside_its_segment_does_not_count(judged):
    """Trap 9: the heading band of 1.b.6 counts above 40 kt, below it the trend; bank of 2.c.8 above
    the warning.
    """
    V = 2.0 * TIME  # 40 kt at 10.3 s
    flight = {"V_cas": V, "vn": V, "ve": 0.0 * V, "psi": 0.0 * V}
    flight |= dict.fromkeys(("theta", "alpha", "h_agl", "phi", "beta", "pedal"), 0.0 * FLAT)
    events = {"brake_release": 0.0, "200ft_agl": 39.0}
    excursion = flight | {"psi": np.where(TIME < 10.0, 8.0, 0.0) * DEG}
    got = judged("1.b.6", TIME, flight, excursion, events=events)
    assert got["heading"]["verdict"] == "pass"
    assert (
        judged(
            "1.b.6",
            TIME,
            flight,
            flight | {"psi": np.where(TIME > 10.5, 3.1, 0.0) * DEG},
            events=events,
        )["heading"]["verdict"]
        == "fail"
    )
    slow = judged(
        "1.b.6",
        TIME,
        flight | {"psi": 0.02 * np.sin(TIME)},
        flight | {"psi": 0.021 * np.sin(TIME)},
        events=events,
    )
    assert slow["heading trend"]["verdict"] == "advisory"

    V = 60.0 - 0.5 * TIME  # warning at 50 m/s, 20 s
    stall = {"V_cas": V, "phi": 0.0 * FLAT, "alpha": 0.1 + 0.001 * TIME}
    rolls = stall | {"phi": np.where(TIME > 20.1, 30.0, 1.0) * DEG}
    got = judged(
        "2.c.8", TIME, stall, rolls, events={"stall_warning": 20.0, "initial_buffet": 22.0}
    )
    assert (got["bank_angle"]["verdict"], got["bank_angle"]["worst_ratio"]) == (
        "pass",
        pytest.approx(0.5),
    )


def test_parts_of_a_stall_lie_between_its_events(judged):
    V = 60.0 - 0.5 * TIME
    flight = {
        "V_cas": V,
        "phi": 0.0 * FLAT,
        "alpha": 0.1 + 0.001 * TIME,
        "theta": 0.05 * FLAT,
        "p": 0.1 * np.sin(TIME),
        "r": 0.1 * np.sin(TIME),
    }
    model = flight | {"theta": 0.05 + np.where(TIME > 20.05, 3.0, 1.0) * DEG}
    events = {"stall_warning": 20.0, "stall": 30.0}
    got = judged("2.c.8.a", TIME, flight, model, events=events, **OF_2016)
    assert (got["pitch_angle"]["window_stop"], got["pitch_angle"]["verdict"]) == (20.0, "pass")
    after = next(item for name, item in got.items() if name.startswith("pitch_angle trace"))
    assert (after["window_start"], after["window_stop"], after["verdict"]) == (20.0, 30.0, "fail")
    unmarked = judged("2.c.8.a", TIME, flight, model, **OF_2016)["pitch_angle"]
    assert remarks_text(unmarked["remarks"]).startswith(
        "give the event stall_warning in [events]: the row counts only in approach_to_stall"
    )


def test_groups_are_alternatives_across_parameters(judged):
    """Trap 1.  Short period: pitch angle or pitch rate, and load factor.  Half a second of 4 deg/s
    is too much for the rate.
    """
    flight = {"theta": 0.0 * FLAT, "q": 0.0 * FLAT, "nz": FLAT}
    model = flight | {
        "q": np.where((TIME > 10.0) & (TIME < 10.5), 4.0, 0.0) * DEG,
        "theta": np.where(TIME > 10.0, 1.4, 0.0) * DEG,
    }
    got = judged("2.c.10", TIME, flight, model)
    assert (got["pitch_angle"]["verdict"], got["pitch_rate"]["verdict"]) == ("pass", "fail")
    verdicts = {name: item["verdict"] for name, item in got.items()}
    c = case("2.c.10")
    assert group_verdicts(c, verdicts) == {"pitch": "pass", "g3": "pass"}
    assert status_of(group_verdicts(c, verdicts)) == "pass"
    assert status_of(group_verdicts(c, verdicts | {"normal_acceleration": "fail"})) == "fail"


def test_a_precondition_alone_is_no_pass_and_a_broken_one_makes_the_case_invalid():
    c = case("1.b.8")
    rates = dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "not_tested")
    assert status_of(group_verdicts(c, rates | {"engine_failure_speed": "pass"})) == "not_tested"
    passed = dict.fromkeys(rates, "pass")
    assert status_of(group_verdicts(c, passed | {"engine_failure_speed": "pass"})) == "pass"
    assert status_of(group_verdicts(c, passed | {"engine_failure_speed": "invalid"})) == "invalid"
    assert group_verdicts(c, {"engine_failure_speed": "pass"}) == {}


def test_a_row_that_the_flight_rules_out_does_not_block(judged):
    V = np.maximum(50.0 - 4.0 * np.maximum(TIME - 1.0, 0.0), 0.0)  # 313 m = 1025 ft
    flight = {"vn": V, "ve": 0.0 * V, "h_agl": np.where(TIME < 1.0, 1.0 - TIME, -0.1), "V_cas": V}
    c = replace(case("1.e.1"), events={"touchdown": 1.0, "full_stop": 13.5})
    c = replace(c, criteria=tuple(replace(x, window=(1.0, 13.5)) for x in c.criteria))
    done = settle_case(c, TIME, flight)
    assert [x.applies for x in done.criteria] == [True, True, False]
    verdicts = {
        x.name: judge_criterion(done, x, TIME, flight, flight).verdict for x in done.criteria
    }
    assert group_verdicts(done, verdicts) == {"g1": "pass", "g2": "pass"}
    assert settle_case(done, TIME, flight) == done


def test_spiral_is_judged_at_the_end_and_its_trend_is_advice():
    c = case("2.d.4")
    flight = {"phi": 20.0 * DEG * np.exp(-TIME / 60.0)}
    model = {"phi": flight["phi"] + np.where(TIME < 30.0, 10.0 * DEG, 1.0 * DEG)}
    assert judge_criterion(
        c, named(c, "bank_angle"), TIME, flight, model
    ).worst_ratio == pytest.approx(0.5)
    assert (
        judge_criterion(c, named(c, "bank_angle trend"), TIME, flight, model).verdict == "advisory"
    )
    assert not named(c, "aileron").applies


# ---- trend


def test_a_trend_states_its_criteria(judged):
    flight = {"phi": 20.0 * DEG * np.exp(-TIME / 60.0)}  # 20 (exp(-20/60) - 1) = -5.67 deg
    half = judged("2.d.4", TIME, flight, {"phi": 0.5 * flight["phi"] + 10.0 * DEG})[
        "bank_angle trend"
    ]
    assert half["verdict"] == "advisory"
    assert remarks_text(half["remarks"]).startswith(
        "largest change of flight -5.67 deg, of model -2.83 deg, amplitude ratio 0.50, "
        "correlation 1.00; "
        "all criteria of trend are met; to be ticked by an engineer"
    )
    away = judged("2.d.4", TIME, flight, {"phi": 40.0 * DEG - flight["phi"]})["bank_angle trend"]
    assert away["verdict"] == "fail"
    assert "not met: sign, correlation; an engineer may tick it" in remarks_text(away["remarks"])
    small = judged("2.d.4", TIME, flight, {"phi": 0.4 * flight["phi"] + 12.0 * DEG})[
        "bank_angle trend"
    ]
    assert "not met: amplitude;" in remarks_text(small["remarks"])
    assert small["verdict"] == "fail"


def test_a_change_within_the_scatter_of_the_flight_is_no_trend(judged):
    """0.03 deg is not a trend whatever its sign, and a model that moves by 2 deg there has one that
    the flight has not.
    """
    flight = {"phi": 0.03 * DEG * TIME / TIME[-1]}
    still = judged("2.d.4", TIME, flight, {"phi": -flight["phi"]})["bank_angle trend"]
    assert still["verdict"] == "advisory"
    assert (
        "within the dead band of +0.1 deg: no trend; of model -0.015 deg, allowed +2 deg"
        in remarks_text(still["remarks"])
    )
    moving = judged(
        "2.d.4",
        TIME,
        flight,
        {"phi": 4.2 * DEG * TIME / TIME[-1]},
        ticks={"bank_angle trend": "A. Engineer"},
    )
    assert moving["bank_angle trend"]["verdict"] == "fail"
    assert "the tick (A. Engineer) does not hold: the flight has no trend" in remarks_text(
        moving["bank_angle trend"]["remarks"]
    )
    rough = 0.5 * DEG * np.sin(9.0 * TIME)
    assert trends.trend_dead_band("phi", TIME, rough) == pytest.approx(
        3.0 * 0.5 * DEG / np.sqrt(2.0), rel=0.1
    )


def test_a_sample_without_a_number_leaves_no_alternative(judged):
    """Either pitch angle or pitch rate passes 2.c.10; a model whose pitch rate is not a number
    passes neither.
    """
    flight = {"theta": 0.0 * FLAT, "q": 0.0 * FLAT, "nz": FLAT}
    c = case("2.c.10")
    model = flight | {"q": np.where(TIME > 10.0, np.nan, 0.0)}
    outcomes = judge_all(c, TIME, flight, model)
    assert {name: found.verdict for name, found in outcomes.items() if named(c, name).applies} == {
        "pitch_angle": "invalid",
        "pitch_rate": "invalid",
        "normal_acceleration": "pass",
    }
    assert remarks_text(outcomes["pitch_angle"].remarks).startswith(
        "its alternative pitch_rate: the model has no value in "
    )


def test_the_order_of_peaks_is_part_of_the_trend(judged):
    """Up at 4.7 s and down at 14.1 s; the model goes down first and then up, a little further."""
    flight = {"phi": np.sin(TIME / 3.0) * np.where(TIME < 9.5, 1.1, 1.0)}
    swapped = {"phi": -np.sin(TIME / 3.0) * np.where(TIME < 9.5, 1.0, 1.2)}
    got = judged("2.d.4", TIME, flight, swapped)["bank_angle trend"]
    assert "not met: order of peaks, correlation; an engineer may tick it" in remarks_text(
        got["remarks"]
    )


def test_a_tick_makes_a_trend_a_pass_that_names_who_but_not_a_wrong_sign(judged):
    flight = {"phi": 20.0 * DEG * np.exp(-TIME / 60.0)}
    ticks = {"bank_angle trend": "A. Engineer, 2026-11-21, both converge"}
    got = judged("2.d.4", TIME, flight, {"phi": 0.4 * flight["phi"] + 12.0 * DEG}, ticks=ticks)[
        "bank_angle trend"
    ]
    assert got["verdict"] == "pass"
    assert "not met: amplitude; ticked by A. Engineer, 2026-11-21, both converge" in remarks_text(
        got["remarks"]
    )
    away = judged("2.d.4", TIME, flight, {"phi": 40.0 * DEG - flight["phi"]}, ticks=ticks)[
        "bank_angle trend"
    ]
    assert away["verdict"] == "fail"
    assert "does not hold: the model moves the other way" in remarks_text(away["remarks"])


# ---- rows of the verdict table


def test_rows_are_in_the_unit_of_the_table():
    c = case("2.c.10")
    flight = {"q": 0.0 * TIME}
    found = verdict_row(
        "m",
        named(c, "pitch_rate"),
        judge_criterion(c, named(c, "pitch_rate"), TIME, flight, {"q": flight["q"] + 3.0 * DEG}),
    )
    assert (found["unit"], found["tolerance_text"], found["applied_text"], found["provenance"]) == (
        "deg/s",
        "2 deg/s",
        "2 deg/s",
        "verified",
    )
    assert found["worst"] == pytest.approx(3.0)
    assert found["width"] == pytest.approx(2.0)
    assert found["fraction"] == 1.0
    assert np.isnan(found["flight_value"])


def test_the_share_of_the_tolerance_comes_from_the_case():
    """Trap 10."""
    c = replace(case("2.c.10"), reference="engineering", fraction=0.2)
    flight = {"q": 0.0 * TIME}
    got = judge_criterion(c, named(c, "pitch_rate"), TIME, flight, {"q": flight["q"] + 0.5 * DEG})
    assert (got.verdict, got.worst_ratio) == ("fail", pytest.approx(0.5 / 0.4))
    assert got.applied == "20 % of: 2 deg/s: 0.4 deg/s"


def test_memory_stays_in_every_row(judged):
    rates = dict.fromkeys("pqr", 0.1 * np.sin(TIME)) | {"V_cas": 60.0 * FLAT}
    got = judged("1.b.8", TIME, rates, rates, events={"engine_failure": 10.0})
    assert {item["provenance"] for item in got.values()} == {"verified"}
    later = judged(
        "2.c.8.a", TIME, {"p": TIME}, {}, events={"stall_warning": 10.0, "stall": 20.0}, **OF_2016
    )
    assert later["roll_rate"]["provenance"] == "memory"


def test_bands_are_drawn_where_they_count():
    c = case("2.d.2")
    inside = replace(c.criteria[0], window=(10.0, 20.0))
    width = band_widths(replace(c, criteria=(inside,)), TIME, {"p": 30.0 * DEG * FLAT})["p"].values
    assert np.isnan(width[TIME < 9.9]).all()
    np.testing.assert_allclose(width[(TIME > 10.1) & (TIME < 19.9)], 3.0 * DEG)  # 10 % of 30 deg/s
    fast = replace(inside, condition="groundspeed>=40kt")
    width = band_widths(
        replace(c, criteria=(fast,)),
        TIME,
        {"p": 30.0 * DEG * FLAT, "vn": 1.4 * TIME, "ve": 0.0 * TIME},
    )["p"].values
    assert np.isnan(width[TIME < 40.0 * KNOT / 1.4]).all()
    assert np.isfinite(width[(TIME > 40.0 * KNOT / 1.4 + 0.1) & (TIME < 19.9)]).all()


def test_what_a_model_has_to_offer():
    c = case("1.b.1")
    assert required_signals(named(c, "distance")) == ("vn", "ve", "V_cas")
    assert required_quantities(named(c, "distance")) == ("distance", "V_cas")
    assert required_signals(named(case("2.a.2.a"), "wheel_force")) == ("F_wheel", "wheel")
    assert helpful_signals(named(case("2.c.8"), "stall_warning_speed")) == (
        "stall_warning",
        "alpha",
    )


# ---- standards and editions are data


@pytest.mark.parametrize(
    ("id", "standard", "edition", "name", "off", "verdict"),
    [
        (
            "2.c(10)",
            "EASA CS-FSTD(A) Issue 2 AMC1 FSTD(A).300",
            "2018-05-03",
            "pitch_rate",
            1.9,
            "pass",
        ),
        (
            "2.d(2)",
            "EASA CS-FSTD(A) Issue 2 AMC1 FSTD(A).300",
            "2018-05-03",
            "roll_rate",
            2.1,
            "fail",
        ),
        (
            "2.f",
            "CAAC CCAR-60 App A aeroplane simulator tests",
            "2005-09-01",
            "pitch_angle",
            0.9,
            "pass",
        ),
        ("2.c.8", "FAA 14 CFR Part 60 App B Table B2A", "2014-01-01", "bank_angle", 2.1, "fail"),
        (
            "2.c.8.b",
            "FAA 14 CFR Part 60 App A Table A2A",
            "2016-05-31 (Amdt 60-4)",
            "bank_angle",
            1.9,
            "pass",
        ),
    ],
)
def test_a_case_of_every_standard_is_read_and_judged(
    write_case, id, standard, edition, name, off, verdict
):
    path = write_case(
        id,
        case=f'standard = "{standard}"\nedition = "{edition}"',
        more="[events]\ncapture = 5.0\nstall_warning = 8.0",
    )
    read = pom.read_case(path)
    time = np.arange(1.0, 9.001, 0.02)
    flight = {channel: 0.0 * time for channel in ("theta", "q", "p", "phi")} | {
        "V_cas": 60.0 - time
    }
    criterion = named(read, name)
    got = judge_criterion(
        read, criterion, time, flight, {k: v + off * DEG for k, v in flight.items()}
    )
    assert (got.verdict, criterion.provenance) == (
        verdict,
        "verified" if standard.startswith(("CAAC", "FAA 14 CFR Part 60 App B")) else "memory",
    )


def test_a_case_may_take_a_percentage_of_the_range_in_service():
    c = replace(
        case("1.d.3"),
        ranges={"engine1.n1": 1.04},
        drive=CaseInputs(engine="throttle"),
        events={"capture": 20.0},
    )
    changed = apply_override(c.criteria, "n1", {"percent": 2.0, "base": "range_max"}, c.window)
    n1 = next(x for x in changed if x.name == "n1")
    got = judge_criterion(c, n1, TIME, {"engine1.n1": 0.5 * FLAT}, {"engine1.n1": 0.52 * FLAT})
    assert (got.verdict, got.worst_ratio, n1.provenance) == (
        "pass",
        pytest.approx(0.02 / 0.0208),
        "case file",
    )
    assert got.applied == "2 % of the largest value in service (104 %): 2.08 %"


def test_a_row_without_a_width_is_not_tested():
    c = case("2.d.6")
    odd = replace(c.criteria[0], band=Band((Limit("ratio", 5.0, "%"),)))
    assert judge_criterion(c, odd, TIME, {"r": TIME}, {"r": TIME}).verdict == "not_tested"
