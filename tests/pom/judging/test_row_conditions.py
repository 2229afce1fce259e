"""Conditions that rows state for the flight: evaluated, not shown, or not checked."""

from dataclasses import replace

import numpy as np
import pytest

from flightmech.units import DEGREE, FOOT
from pom.cases.case import PomCase
from pom.cases.case_inputs import CaseInputs
from pom.judging.applicability import settle_criterion
from pom.judging.conditions.flown_case import NotChecked
from pom.judging.conditions.report_conditions import MEASURED_AT, REPORT_CHECKS
from pom.judging.conditions.row_conditions import CASE_CHECKS, condition_remarks
from pom.judging.conditions.stall_checks import REACH
from pom.judging.signals import RunSignals
from pom.judging.watched_channels import watch_track
from pom.status import NOTICES
from pom.tolerances import rows
from pom.tolerances.stated_conditions import CONDITIONS, CONFIGURATIONS, STATED

TIME = np.linspace(0.0, 20.0, 401)
FACTS = {"mtow": 3000.0, "basic_operating_weight": 2000.0, "v1": 50.0, "reversible_controls": False}


def made(id, events=(), facts=FACTS, **more):
    """Return a case over the whole time, with the rows of its test."""
    events = dict(events)
    table = rows.rows_of_test(id)
    criteria = []
    for row, name in zip(table, rows.names_of(table), strict=True):
        criterion = rows.make_criterion(row, name, (0.0, 20.0))
        window = tuple(
            float(rows.bound_time(bound, events, default))
            for bound, default in zip(criterion.bounds, (0.0, 20.0), strict=True)
        )
        criteria.append(replace(criterion, window=window))
    return PomCase(
        name="c", title="c", id=id, standard=rows.STANDARD, edition=rows.EDITION, path="c.toml",
        record="r.nc", window=(0.0, 20.0), events=events, facts=dict(facts),
        criteria=tuple(criteria), **more,
    )  # fmt: skip


def texts(case, kind="departure", **channels):
    flight = {
        name: np.broadcast_to(np.asarray(v, float), TIME.shape) for name, v in channels.items()
    }
    found = condition_remarks(case, RunSignals(flight, TIME))
    return [remark.text for remark in found if remark.kind == kind]


def step(size, start=5.0):
    return np.where(start < TIME, size, 0.0)


def ramp(start, stop):
    return np.linspace(start, stop, TIME.size)


REJECTED = {"brake_release": 0.0, "full_stop": 20.0}
CHANGE = {"change_start": 5.0, "change_end": 5.0}
GROUND = CaseInputs(trim="ground")
BRAKED = {"brake_left": step(1.0), "brake_right": step(1.0)}
TAKE_OFF = {"delta_f": 0.2, "gear": 1.0}
CLEAN, OUT = {"delta_f": 0.0, "gear": 0.0}, {"delta_f": 0.3, "gear": 1.0}
ROLLED = {**CLEAN, "delta_a": step(0.1)}
CHANGED = {"engine1.throttle": step(0.5), "speedbrake": step(1.0)}


@pytest.mark.parametrize(
    ("id", "more", "good", "bad", "text"),
    [
        # 80 % of V1 (50 m/s) is 40 m/s
        ("1.b.7", REJECTED, {"V_cas": 40.1}, {"V_cas": 39.0}, "78 % of V1"),
        ("1.b.7", REJECTED, {"mass": 2801.0}, {"mass": 2799.0}, "weight is 2800 kg or more"),
        ("1.b.7", REJECTED, {}, {"brake_left": step(0.5)}, "brakes at 50 % of the pedal"),
        ("2.c.1", CHANGE, OUT, CLEAN, "flown with flaps at 0 deg; the row has approach"),
        ("2.c.3", CHANGE, CLEAN, OUT, "flaps at 17.2 deg, gear at 1; the row has cruise"),
        (
            "2.c.1",
            CHANGE,
            OUT,
            {"delta_e": step(1.5 * DEGREE, 8.0)},
            "the pilot moves elevator deflection",
        ),
        (
            "2.b.4",
            {"input_start": 5.0},
            {"q": step(DEGREE)},
            {"q": step(5 * DEGREE)},
            "5 deg/s of q",
        ),
        ("1.c.1", {}, {"h": ramp(0, 1001 * FOOT)}, {"h": ramp(0, 300.0)}, "over 984 ft of height"),
        ("1.d.2", {}, {"V_cas": ramp(90, 64)}, {"V_cas": ramp(90, 70)}, "over 38.9 kt of airspeed"),
        ("2.d.3", {}, {"delta_a": step(0.1) - step(0.1, 9.0)}, {"delta_a": step(0.1)}, "neutral"),
        ("2.c.6", {"capture": 9.0}, {"phi": 0.78}, {"phi": 0.9}, "51.6 deg of bank"),
        ("2.d.5", {}, {"engine2.thrust": 0.0}, {"engine2.thrust": 900.0}, "none has failed"),
        (
            "2.d.5",
            {},
            {"engine1.torque": 3e3, "engine2.torque": 0.0},
            {"engine1.torque": 3e3, "engine2.torque": 2.7e3},
            "90 % of the torque",
        ),
        ("1.e.3", {"touchdown": 1.0, "full_stop": 19.0}, {}, {"runway": "dry"}, "has a wet one"),
    ],
)
def test_a_condition_that_does_not_hold_is_a_departure(id, more, good, bad, text):
    base = {
        "V_cas": 45.0,
        "mass": 2900.0,
        "delta_e": 0.0,
        "engine1.thrust": 1000.0,
        **BRAKED,
        **CHANGED,
    }
    base |= OUT if rows.rows_of_test(id)[0]["flight_condition"] != "clean" else CLEAN
    if id in ("2.c.3", "1.d.2", "2.c.6"):
        base |= CLEAN
    drive = GROUND if id.startswith(("1.b", "1.e")) else CaseInputs()
    drive = replace(drive, runway="wet" if id == "1.e.3" else "")
    case = made(id, more, drive=drive)
    assert texts(case, **base | good) == []
    if "runway" in bad:
        case = replace(case, drive=replace(drive, runway=bad.pop("runway")))
    (found,) = texts(case, **base | bad)
    assert text in found


def test_what_is_not_known_is_a_departure_unless_the_program_has_no_check():
    case = made("1.b.7", REJECTED, facts={}, drive=GROUND)
    found = texts(case, V_cas=45.0, **TAKE_OFF)
    assert [text.split(" (")[0] for text in found] == [
        "departure: not shown: the take-off is rejected at 80 % of V1 or more",
        "departure: not shown: near maximum take-off weight",
        "departure: not shown: maximum braking",
    ]
    assert "v1 is not stated in [facts] of the aircraft file" in found[0]
    (found,) = texts(made("2.d.7", {"input_end": 1.0}), kind="not_checked", **ROLLED)
    assert found.startswith("not checked: yaw damper off")
    assert "not_checked" in NOTICES


def test_a_configuration_that_is_not_recorded_is_stated_in_the_case():
    case = made("2.d.7", {"input_end": 1.0})
    (found,) = texts(case, delta_a=step(0.1))
    assert found == (
        "departure: not shown: the configuration of the column flight_condition (the record has no "
        "delta_f: record it, or state it in [conditions] of the case)"
    )
    assert texts(replace(case, conditions={"delta_f": 0.0}), delta_a=step(0.1)) == []


def test_a_gear_that_is_not_recorded_is_fixed_only_without_positions(monkeypatch):
    travels = {"delta_f": 0.7}

    def travel(case, control):
        if control not in travels:
            raise NotChecked(f"no limits of {control}")
        return travels[control]

    monkeypatch.setattr("pom.judging.conditions.configurations.control_travel", travel)
    case = made("2.d.7", {"input_end": 1.0})
    assert texts(case, delta_f=0.0, delta_a=step(0.1)) == []
    travels["gear"] = 1.0
    (found,) = texts(case, delta_f=0.0, delta_a=step(0.1))
    assert "the record has no gear" in found


@pytest.mark.parametrize(
    ("id", "moved", "at_rest"),
    [
        ("2.c.10", {"delta_e": step(0.03)}, {"delta_e": step(0.004)}),
        ("2.d.2", {"delta_a": step(0.03)}, {"delta_a": step(0.004), "delta_e": step(0.1)}),
        ("2.c.1", {"engine2.throttle": step(0.1)}, {"engine1.throttle": 0.6}),
        ("2.c.2", {"delta_f": 0.3 + step(0.2)}, {"delta_f": 0.3}),
        ("2.c.3", {"delta_s": step(0.2)}, {"speedbrake": 1.0}),
        ("2.c.4", {"gear": step(1.0)}, {"gear": 1.0, "delta_f": 0.3 + step(0.2)}),
    ],
)
def test_a_test_without_its_manoeuvre_is_a_departure(id, moved, at_rest):
    case = made(id, CHANGE)

    def named(channels):
        return [text for text in texts(case, **channels) if "does not move" in text]

    assert named(moved) == []
    (found,) = named(at_rest)
    assert "choose a window with the input" in found
    assert [text for text in texts(case) if "the control of the test moves" in text]


@pytest.mark.parametrize(("size", "noise", "is_input"), [
    (0.63, 0.027, True), (0.4, 0.0, True), (0.4, 0.1, False), (1.3, 0.3, True), (0.0, 0.3, False),
])  # fmt: skip
def test_the_input_of_a_test_is_beyond_the_noise(size, noise, is_input):
    """The elevator of a phugoid moves 1.3 deg at 200 kt, and less at a higher speed."""
    random = np.random.default_rng(1).standard_normal(TIME.size)
    found = texts(
        made("2.c.9", {"input_end": 6.0}),
        **CLEAN,
        delta_e=DEGREE * (step(size) + noise * random),
        delta_a=0.0,
    )
    assert any("does not move" in text for text in found) != is_input


def test_unknown_controls_leave_the_rows_of_forces_with_a_departure():
    (found,) = texts(made("2.d.2", facts={}), **ROLLED)
    assert "wheel_force is not judged" in found
    assert "[facts] reversible_controls" in found
    assert texts(made("2.d.2"), **ROLLED) == []


def test_an_additional_case_states_that_it_is_no_test():
    case = made("2.c.10", additional="a check of the tables of the flaps")
    assert texts(case, **OUT, delta_e=step(0.1)) == []
    (found,) = texts(case, kind="additional", **OUT)
    assert found.startswith("additional case, not the test 2.c.10: flown with flaps at 17.2 deg")
    assert texts(case, kind="additional", **CLEAN) == []


def test_every_condition_has_a_check_or_states_that_it_has_none():
    checked = {*CASE_CHECKS, *REPORT_CHECKS, REACH, "configuration"}
    assert {name for name, item in CONDITIONS.items() if item.how} == checked
    assert {name for name, item in CONDITIONS.items() if item.over == "report"} == set(
        REPORT_CHECKS
    )
    assert set(MEASURED_AT) == set(REPORT_CHECKS)
    named = {name for names in STATED.values() for name in names}
    assert named | {"configuration"} == set(CONDITIONS)
    tests = {row["test_id"] for row in rows.tolerance_rows()}
    assert {test for test in STATED if test not in tests} <= {"2.f.1"}
    conditions = {row["flight_condition"] for row in rows.tolerance_rows()}
    assert set(CONFIGURATIONS) <= conditions


def test_the_track_over_the_ground_is_watched():
    case = made("1.b.7", REJECTED, drive=GROUND)
    flight = {"vn": np.full(TIME.size, 20.0), "ve": np.zeros(TIME.size)}

    def watched(sideways):
        model = {"vn": np.full(TIME.size, 20.0), "ve": np.full(TIME.size, sideways)}
        return watch_track(case, TIME, flight, model)

    # 20 s at a speed across make an offset: 10 ft is watched, 30 ft is a departure
    assert watched(9.9 * FOOT / 20.0) == ()
    (remark,) = watched(-20.0 * FOOT / 20.0)
    assert remark.kind == "watch"
    assert "20 ft to the left" in remark.text
    (remark,) = watched(40.0 * FOOT / 20.0)
    assert remark.kind == "departure"
    assert "40 ft to the right" in remark.text
    assert watch_track(replace(case, drive=CaseInputs()), TIME, flight, flight) == ()


def test_a_claim_against_the_aircraft_is_a_departure():
    facts = {**FACTS, "reversible_controls": True}
    case = made("2.c.6", {"capture": 9.0}, facts=facts, features=("alternative_method",))
    table = rows.rows_of_test("2.c.6")
    criteria = [
        rows.make_criterion(row, name, (0.0, 20.0), case.features)
        for row, name in zip(table, rows.names_of(table), strict=True)
    ]
    case = replace(case, criteria=tuple(criteria))
    (found,) = texts(case, phi=0.7, **CLEAN)
    assert "alternative_method is claimed, and the controls of the aircraft are reversible" in found
    assert texts(replace(case, facts=dict(FACTS)), phi=0.7, **CLEAN) == []


def test_the_window_after_an_engine_failure_ends_at_30_deg_of_bank():
    case = made("1.b.8", {"engine_failure": 5.0})
    criterion = next(c for c in case.criteria if c.name == "roll_rate")
    assert criterion.window == (0.0, 10.0)
    # 8 deg/s from 5 s on: 30 deg at 8.75 s
    bank = np.maximum(TIME - 5.0, 0.0) * 8.0 * DEGREE
    flight = RunSignals({"phi": bank, "p": np.zeros(TIME.size)}, TIME)
    start, stop = settle_criterion(case, criterion, time=TIME, flight=flight).window
    assert start == 0.0
    assert 8.7 - 1e-9 <= stop <= 8.75
    case = replace(case, criteria=(replace(criterion, window=(start, stop)),))
    assert texts(case, phi=bank, p=0.0, delta_e=0.0, **OUT) == []


def test_pilot_forces_that_facts_take_out_of_the_judgement_are_stated():
    case = made("2.d.2")
    (found,) = [text for text in texts(case, "not_checked", **CLEAN) if "reversible" in text]
    assert "wheel_force is not judged" in found
    # a record with pilot forces is a reason to look at the facts again
    (found,) = texts(case, "record_warning", F_wheel=3.0, **CLEAN)
    assert "the record has the pilot forces F_wheel" in found
    assert texts(replace(case, facts={}), "record_warning", F_wheel=3.0, **CLEAN) == []
