"""Conditions of the stall rows and of the demonstrations."""

import json
import zipfile
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import aerodb
import flightmech
from flightmech.envelope.envelope import make_envelope
from flightmech.terms import SOURCES, make_term
from flightmech.units import DEGREE, KNOT
from pom.cases.case import PomCase
from pom.judging.beyond_the_bands import BLOCK
from pom.judging.conditions.report_conditions import REPORT_CHECKS, VALUES, report_values
from pom.judging.conditions.row_conditions import condition_remarks
from pom.judging.conditions.stall_checks import reach_remarks
from pom.judging.signals import RunSignals
from pom.tolerances import rows

TIME = np.linspace(0.0, 40.0, 801)
EVENTS = {"stall_warning": 24.0, "stall": 29.0}
NAMES = {
    "2.c.8": (rows.STANDARD, rows.EDITION),
    "2.c.8.a": (rows.STANDARD, "2016-05-31 (Amdt 60-4)"),
    "2.i": (rows.STANDARD, "2016-05-31 (Amdt 60-4)"),
    "7.B": ("FAA 14 CFR Part 60 App A Att 7", "2016-05-31 (Amdt 60-4)"),
}


def made(id, events=EVENTS, **more):
    """Return a case over the whole time, with the rows of its test."""
    standard, edition = NAMES[id]
    table = rows.rows_of_test(id, standard, edition)
    criteria = []
    for row, name in zip(table, rows.names_of(table), strict=True):
        criteria.append(rows.make_criterion(row, name, (0.0, 40.0)))
    facts = {"reversible_controls": False}
    return PomCase(
        "c", "c", id, standard, edition, "c.toml", "r.nc", (0.0, 40.0), events=dict(events),
        facts=facts, criteria=tuple(criteria), **more,
    )  # fmt: skip


def stall(rate=1.0, bank=0.0, recovered=True):
    """Return a stall that is entered with a rate in kt/s and a bank in degrees."""
    top = 18.0 if recovered else 30.0
    alpha = np.interp(TIME, [0.0, 24.0, 29.0, 33.0], [6.0, 14.0, 18.0, 8.0 if recovered else top])
    return {
        "V_cas": 50.0 - rate * KNOT * np.minimum(TIME, 29.0),
        "alpha": alpha * DEGREE,
        "phi": np.full(TIME.size, bank * DEGREE),
        "theta": np.full(TIME.size, 10.0 * DEGREE),
        "nz": np.full(TIME.size, 1.0 / np.cos(bank * DEGREE)),
        "engine1.throttle": np.full(TIME.size, 0.03),
        "gear": np.zeros(TIME.size),
        "delta_f": np.zeros(TIME.size),
    }


def remarks(case, flight, kind="departure"):
    return [
        remark for remark in condition_remarks(case, RunSignals(flight, TIME))
        if remark.kind == kind
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("condition", "flight", "text"),
    [
        ("level_entry", stall(bank=30.0), "30 deg of bank and a mean load factor of 1.15"),
        ("idle_entry", stall() | {"engine1.throttle": np.full(TIME.size, 0.3)}, "levers at 30 %"),
        ("entry_rate", stall(rate=1.5), "entered with 1.5 kt/s at 0 deg of bank"),
        ("recovery_recorded", stall(recovered=False), "back below that of the warning"),
    ],
)
def test_an_entry_that_is_not_that_of_the_row_is_a_departure(condition, flight, text):
    case = made("2.c.8")
    assert remarks(case, stall()) == []
    (found,) = remarks(case, flight)
    assert found.quantity == condition
    assert text in found.text


def test_a_turning_stall_may_be_entered_faster():
    case = made("2.c.8.a")
    assert remarks(case, stall(rate=2.9, bank=30.0)) == []
    assert "entered with 3.4 kt/s at 30 deg" in remarks(case, stall(rate=3.4, bank=30.0))[0].text


def test_a_stall_before_its_warning_is_a_departure():
    late = made("2.c.8.a", {"stall_warning": 29.5, "stall": 29.0})
    (found,) = remarks(late, stall())
    assert found.quantity == "warning_first"
    assert "first warning at 29.5 s" in found.text


def test_conditions_without_events_or_numbers_are_not_shown():
    found = {item.quantity for item in remarks(made("2.c.8.a", {}), stall(), "departure")}
    assert found >= {"entry_rate", "warning_first", "recovery_recorded"}
    found = {item.quantity for item in remarks(made("2.c.8.a", {}), stall(), "not_checked")}
    assert "high_cruise" in found


def test_an_upset_is_one_by_attitude():
    case = made("7.B", {})
    (found,) = remarks(case, stall())
    assert "pitch 10 ... 10 deg, bank up to 0 deg: no upset by attitude" in found.text
    for name, angle in (("theta", 26.0), ("theta", -11.0), ("phi", -46.0)):
        flight = stall() | {name: np.full(TIME.size, angle * DEGREE)}
        assert remarks(case, flight) == []


def of_report(name, id, flights):
    """Return the text of the check of a condition over several cases."""
    results = []
    for conditions, flight in flights:
        case = made(id, conditions=conditions)
        attrs = {VALUES: report_values(case, RunSignals(flight, TIME))}
        assert name in json.loads(attrs[VALUES])
        results.append(SimpleNamespace(case=case, signals=SimpleNamespace(attrs=attrs)))
    return REPORT_CHECKS[name](results)


def test_stalls_are_entered_level_and_in_a_turn():
    level, turn = ({}, stall()), ({}, stall(bank=-27.0))
    assert of_report("stall_entries", "2.c.8.a", [level, turn]) == ""
    assert "at a bank of 0 deg, 0 deg" in of_report("stall_entries", "2.c.8.a", [level, level])


def test_icing_is_shown_clean_and_iced():
    clean, iced = ({}, stall()), ({"device.ice.setting": 1.0}, stall())
    assert of_report("clean_and_iced", "2.i", [clean, iced]) == ""
    assert of_report("clean_and_iced", "2.i", [clean, clean]).startswith("clean runs only")
    assert of_report("clean_and_iced", "2.i", [iced]).startswith("iced runs only")


def fmu_of(folder, envelope=True):
    """Return a file with the block of a model: lift from flight to 20 deg, estimated to 29 deg."""
    alpha = np.radians([-10.0, 0.0, 10.0, 20.0, 29.0])
    lift = make_term(0.3 + 4.0 * alpha, {"alpha": alpha}, stderr=0.05, source="datcom")
    lift["source"].values[:4] = SOURCES.index("flight")
    root = {"title": "jet", "aircraft": "jet", "S": 17.0, "cbar": 1.67, "b": 10.3}
    root |= {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability", "source": "own"}
    db = aerodb.make_database({"CL/basic": lift}, **root, history="", absent="")
    inertia = {"mass": 2400.0, "Ixx": 10800.0, "Iyy": 8100.0, "Izz": 15100.0}
    craft = flightmech.Aircraft("jet", 17.0, 1.67, 10.3, **inertia)
    model = flightmech.compile(craft, db, make_envelope(db) if envelope else None)
    path = folder / "jet.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(BLOCK, model.block)
    return str(path)


@pytest.mark.parametrize(
    ("shift", "kind", "text"),
    [
        (-5.0, "", ""),
        (0.0, "low_confidence", "no flight supports the model from 25.0 deg on"),
        (2.0, "departure", "the model extrapolates from 30.0 deg of alpha on, before the stall at"),
    ],
)
def test_the_model_reaches_ten_degrees_beyond_the_stall(tmp_path, shift, kind, text):
    flight = stall()["alpha"] + shift * DEGREE
    found = reach_remarks(made("2.c.8.a"), TIME, flight, {}, fmu_of(tmp_path))
    assert [item.kind for item in found] == ([kind] if kind else [])
    assert all(text in item.text for item in found)


def test_the_reach_without_an_envelope_event_or_tables(tmp_path):
    case, alpha = made("2.c.8.a"), stall()["alpha"]
    plain = fmu_of(tmp_path, envelope=False)
    (found,) = reach_remarks(case, TIME, alpha + 2.0 * DEGREE, {}, plain)
    assert found.kind == "departure"
    assert "a table ends at 29.0 deg of alpha, before the stall at 20.0 deg" in found.text
    (found,) = reach_remarks(case, TIME, alpha, {}, plain)
    assert "no validity envelope" in found.text
    (found,) = reach_remarks(replace(case, events={}), TIME, alpha, {}, plain)
    assert "the event stall or the recorded angle" in found.text
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("modelDescription.xml", "")
    (found,) = reach_remarks(case, TIME, alpha, {}, str(other))
    assert found.kind == "not_checked"
    assert reach_remarks(made("2.c.8"), TIME, alpha, {}, plain) == ()
