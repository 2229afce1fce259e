"""Case files drafted from a record: events where the record shows them, and always a sound case."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import pom.cases.case_file
import pom.cli.group
import pom.cli.report
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from pom.cases.case import read_case
from pom.cases.drafting.draft import draft_case, init_case
from pom.cases.drafting.draft_text import draft_text
from pom.cases.drafting.event_detection import (
    Recorded,
    RecordedManoeuvre,
    find_events,
    find_movement,
    on_ground,
    quiet_instant,
)
from pom.cases.drafting.recorded_channels import recorded_channels
from pom.tolerances import rows
from pom.tolerances.editions import edition_of

FLIGHT = Path(__file__).parents[3] / "data" / "t37" / "flight"
NAMES = FLIGHT.parent / "names.toml"
TIME = np.arange(0.0, 40.0, 0.02)


def recorded(manoeuvres=(), **channels):
    """Return a record of 40 s at 50 Hz: corners of straight lines by channel, noise of 0.01 deg on
    all.
    """
    noise = np.random.default_rng(3).normal(0.0, np.radians(0.01), TIME.size)
    rest = {"delta_e": [0.0], "delta_a": [0.0], "delta_r": [0.0], "engine1.thrust": [3000.0]}
    found = {}
    for name, corners in {**rest, **channels}.items():
        y = (
            np.interp(TIME, *np.transpose(corners))
            if np.ndim(corners) == 2
            else np.full(TIME.size, corners[0])
        )
        found[name] = TIME, y + noise
    return Recorded(found, (0.0, float(TIME[-1])), list(manoeuvres))


PULSE = [(10.0, 0.0), (10.1, -0.05), (12.0, -0.05), (12.1, 0.0)]


def test_a_movement_starts_and_ends_where_the_control_does():
    found = find_movement(recorded(delta_e=PULSE), ["delta_a", "delta_e"], (0.0, 40.0))
    assert found.channel == "delta_e"  # noise of the aileron is not a movement
    assert found.start == pytest.approx(10.0, abs=0.04)
    assert found.end == pytest.approx(12.1, abs=0.04)
    assert find_movement(recorded(), ["delta_e"], (0.0, 40.0)) is None


def test_a_control_that_floats_after_its_release_is_at_rest():
    float_of_12_percent = [(18.0, 0.006), (24.0, -0.006), (30.0, 0.006), (36.0, 0.0)]
    found = find_movement(
        recorded(delta_e=[*PULSE, *float_of_12_percent]), ["delta_e"], (0.0, 40.0)
    )
    assert found.end == pytest.approx(12.1, abs=0.05)


def test_of_two_kinds_of_control_the_one_that_moves_most():
    small = [(5.0, 0.0), (5.1, 0.002), (6.0, 0.0)]
    assert (
        find_movement(
            recorded(delta_r=small, delta_a=PULSE), ["delta_r", "delta_a"], (0.0, 40.0)
        ).channel
        == "delta_a"
    )


def test_a_control_that_still_moves_at_the_end_has_no_end_of_input():
    rising = [(10.0, 0.0), (40.0, -0.1)]
    found = find_events(
        ["input_start", "input_end"], "2.c.9", recorded(delta_e=rising), (0.0, 40.0), (0.0, 40.0)
    )
    assert set(found) == {"input_start"}


def test_events_of_a_takeoff_and_a_landing():
    channels = {
        "brake": [(5.0, 1.0), (5.2, 0.0)],
        "wow_left": [(20.0, 1.0), (20.02, 0.0)],
        "wow_right": [(21.0, 1.0), (21.02, 0.0)],
    }
    channels |= {"h_agl": [(20.0, 0.0), (40.0, 100.0)], "delta_e": [(15.0, 0.0), (16.0, -0.1)]}
    up = find_events(rows.window_events(), "1.b.4", recorded(**channels), (0.0, 40.0), (0.0, 40.0))
    assert up["brake_release"] == pytest.approx(5.2, abs=0.05)
    assert up["main_gear_liftoff"] == pytest.approx(21.02, abs=0.03)  # the last wheel
    assert up["200ft_agl"] == pytest.approx(20.0 + 60.96 / 5.0, abs=0.05)
    assert up["vr"] == pytest.approx(15.0, abs=0.1)
    down = {
        "wow_left": [(20.0, 0.0), (20.02, 1.0)],
        "wow_nose": [(23.0, 0.0), (23.02, 1.0)],
        "h_agl": [(0.0, 100.0), (20.0, 0.0)],
    }
    down |= {"vn": [(20.0, 50.0), (30.0, 0.0)], "ve": [0.0]}
    found = find_events(rows.window_events(), "2.e.3", recorded(**down), (0.0, 40.0), (0.0, 40.0))
    assert found["touchdown"] == pytest.approx(20.02, abs=0.03)
    assert found["nosewheel_touchdown"] == pytest.approx(23.02, abs=0.03)
    assert found["200ft_agl"] == pytest.approx((100.0 - 60.96) / 5.0, abs=0.05)
    assert found["50pct_of_touchdown_speed"] == pytest.approx(25.0, abs=0.05)
    assert on_ground(recorded(**channels), 1.0)
    assert not on_ground(recorded(**channels), 30.0)


def test_a_control_is_released_where_it_leaves_the_hand():
    """Held at 0.1 m until 15 s, then two cycles of its own about neutral, of 50 and 20 % of
    that.
    """
    free = [(15.0, 0.1), (15.2, -0.05), (15.5, 0.02), (15.8, 0.0)]
    found = find_events(
        ["control_release"],
        "2.b.1",
        recorded(delta_e=[(9.0, 0.0), (10.0, 0.1), *free]),
        (0.0, 40.0),
        (0.0, 40.0),
    )
    assert found["control_release"] == pytest.approx(15.0, abs=0.04)


def test_engines_that_part_show_a_failure():
    one = {"engine1.thrust": [(12.0, 3000.0), (13.0, 0.0)], "engine2.thrust": [3000.0]}
    assert find_events(["engine_failure"], "1.b.8", recorded(**one), (0.0, 40.0), (0.0, 40.0)) == {
        "engine_failure": pytest.approx(12.2, abs=0.05)  # a fifth of the thrust is gone
    }


def test_a_snapshot_takes_the_quiet_stretch():
    restless = [(0.0, 0.0), (3.0, 0.2), (6.0, -0.2), (9.0, 0.0), (20.0, 0.0), (30.0, 0.3)]
    at = quiet_instant(recorded(theta=restless), (0.0, 40.0))
    assert 13.0 <= at <= 19.0 or at >= 34.0


def test_of_several_manoeuvres_the_first_is_taken_and_the_others_are_reported():
    manoeuvres = [
        RecordedManoeuvre(9.5, 20.0, "elevator", "pulse"),
        RecordedManoeuvre(25.0, 35.0, "elevator", "pulse"),
    ]
    draft = draft_case(rows.rows_of_test("2.c.9"), recorded(manoeuvres, delta_e=PULSE))
    assert draft.events["input_end"] == (pytest.approx(12.1, abs=0.04), True)
    assert draft.case["window"] == [pytest.approx(9.0, abs=0.11), 20.0]
    assert "--window chooses another: 25 ... 35 s" in draft.remarks[0]


def test_what_the_record_does_not_show_is_reported(tmp_path):
    draft = draft_case(rows.rows_of_test("1.b.8"), recorded())
    assert any(
        text.startswith("engine_failure was not found in the record") for text in draft.remarks
    )
    (tmp_path / "record.nc").touch()
    (tmp_path / "case.toml").write_text(draft_text(draft_with(draft), ()))
    assert "engine_failure = " in (tmp_path / "case.toml").read_text()
    assert "# NOT FOUND in the record: set it" in (tmp_path / "case.toml").read_text()
    assert read_case(tmp_path / "case.toml").id == "1.b.8"


def draft_with(draft, standard=rows.STANDARD, edition=rows.EDITION):
    draft.case.update(standard=standard, edition=edition, record="record.nc")
    return draft


@pytest.mark.nightly
def test_every_test_of_every_standard_becomes_a_sound_case(tmp_path):
    record = recorded_channels(FLIGHT / "t37_31_val_landing.nc", NAMES)
    (tmp_path / "record.nc").touch()
    path = tmp_path / "case.toml"
    tests = {(row["standard"], row["edition"], row["test_id"]) for row in rows.tolerance_rows()}
    assert len(tests) > 100
    for standard, edition, test in sorted(tests):
        path.write_text(
            draft_text(
                draft_with(
                    draft_case(rows.rows_of_test(test, standard, edition), record),
                    standard,
                    edition,
                ),
                (),
            )
        )
        assert read_case(path).id == test


def test_a_window_outside_the_record_and_a_record_without_controls_are_refused():
    with pytest.raises(
        OutOfRange, match=r"window 50 ... 60 s lies outside the record, 0 ... 39\.98 s"
    ):
        draft_case(rows.rows_of_test("2.c.10"), recorded(), (50.0, 60.0))
    bare = recorded()
    del bare.channels["delta_r"]
    with pytest.raises(SchemaError, match="no complete set of controls"):
        draft_case(rows.rows_of_test("2.c.10"), bare)
    still = recorded()
    del still.channels["engine1.thrust"]
    with pytest.raises(SchemaError, match=r"no engine1\.thrust, engine1\.torque, .*: one of"):
        draft_case(rows.rows_of_test("2.c.10"), still)
    # the record of a glider
    drafted = draft_case(rows.rows_of_test("2.c.10"), still, drives=frozenset())
    assert drafted.drive["engine"] == "none"
    driven = draft_case(rows.rows_of_test("2.c.10"), recorded(), drives=frozenset())
    assert driven.drive["engine"] == "thrust"


@pytest.mark.slow
def test_the_engine_is_driven_by_what_the_aircraft_takes():
    """Of the recorded quantities the first that the engines take, else the first."""
    several = recorded(**{"engine1.n1": [0.8], "engine1.throttle": [0.7]})
    for drives, engine in (
        (None, "thrust"),
        ({"throttle", "thrust_drive"}, "thrust"),
        ({"throttle"}, "throttle"),
        ({"torque_drive"}, "thrust"),
    ):
        drawn = draft_case(rows.rows_of_test("2.c.10"), several, drives=drives)
        assert drawn.drive["engine"] == engine, drives


@pytest.mark.nightly
def test_the_file_of_the_phugoid_is_the_one_an_engineer_would_write(tmp_path):
    path = tmp_path / "case.toml"
    case, remarks = init_case(FLIGHT / "t37_26_val_phugoid.nc", "2.c.9", path)
    shipped = read_case(FLIGHT.parent / "cases" / "26_phugoid.toml")
    assert remarks == []
    assert case.events["input_end"] == pytest.approx(shipped.events["input_end"], abs=0.5)
    assert case.window == (pytest.approx(shipped.window[0], abs=1.0), shipped.window[1])
    assert (case.drive.surfaces, case.drive.engine, case.conditions) == (
        "recorded",
        "thrust",
        shipped.conditions,
    )
    text = path.read_text()
    assert text.startswith("#:schema case.schema.json\n")
    assert (
        "#   period: 10 % of the flight value, period of V_cas, 11.57 ... 101.4 s, group g1" in text
    )
    assert "verified: 14 CFR 1-1-14 ed. p." in text
    assert Path(case.aircraft).is_file()  # found one folder above the record, with the name map


@pytest.mark.nightly
def test_a_standing_start_is_driven_from_its_wheels(tmp_path):
    case, _ = init_case(FLIGHT / "t37_25_val_normal_takeoff.nc", "1.b.4", tmp_path / "case.toml")
    assert case.drive.trim == "ground"
    assert case.events == {
        "brake_release": pytest.approx(12.0, abs=0.1),
        "200ft_agl": pytest.approx(40.2, abs=0.1),
    }
    assert case.window[0] == pytest.approx(8.0, abs=0.1)


@pytest.mark.slow
def test_a_reconstructed_path_will_do(lag_states, tmp_path):
    lag_states.to_netcdf(tmp_path / "path.nc", engine="h5netcdf")
    case, _ = init_case(tmp_path / "path.nc", "2.c.10", tmp_path / "case.toml")
    assert case.window[1] == 10.0
    assert case.aircraft == ""


def test_nothing_is_overwritten_and_a_failure_leaves_nothing(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="--force"):
        init_case(FLIGHT / "t37_26_val_phugoid.nc", "2.c.9", path)
    with pytest.raises(UnknownName, match="near it: 2"):
        init_case(FLIGHT / "t37_26_val_phugoid.nc", "2.c.99", tmp_path / "other.toml")
    assert path.read_text() == "mine"
    assert [file.name for file in tmp_path.iterdir()] == ["case.toml"]


def test_standards_by_a_part_of_their_name():
    assert edition_of() == (rows.STANDARD, rows.EDITION)
    assert edition_of("ccar") == ("CAAC CCAR-60 App A aeroplane simulator tests", "2005-09-01")
    assert edition_of("A2A", "2016")[1] == "2016-05-31 (Amdt 60-4)"
    with pytest.raises(UnknownName, match="several have it in their name"):
        edition_of("Part 60")
    with pytest.raises(UnknownName, match="unknown edition"):
        edition_of("A2A", "1999")


@pytest.mark.nightly
def test_the_command_asks_two_questions_on_a_terminal(tmp_path, monkeypatch):
    monkeypatch.setattr("pom.cli.actions.report._on_terminal", lambda: True)
    record, output = str(FLIGHT / "t37_26_val_phugoid.nc"), str(tmp_path / "case.toml")
    done = CliRunner().invoke(
        pom.cli.group.pom, ["init", record, "-o", output], input="no such thing\nphugoid\n\n"
    )
    assert done.exit_code == 0, done.output
    assert "no row has all of these words" in done.output
    assert "2.c.9    Phugoid dynamics" in done.output
    assert read_case(output).id == "2.c.9"


def test_without_a_terminal_the_test_must_be_named(tmp_path):
    done = CliRunner().invoke(
        pom.cli.group.pom,
        ["init", str(FLIGHT / "t37_26_val_phugoid.nc"), "-o", str(tmp_path / "case.toml")],
    )
    assert done.exit_code == 2
    assert "--test is missing" in done.output


def test_schema_command_writes_the_schema_of_the_reader(tmp_path):
    output = tmp_path / "case.schema.json"
    assert CliRunner().invoke(pom.cli.group.pom, ["schema", "-o", str(output)]).exit_code == 0
    assert json.loads(output.read_text(encoding="utf-8")) == pom.cases.case_schema()


@pytest.mark.nightly
def test_the_manoeuvre_of_the_right_kind_is_taken():
    """Run 01 lists a 3-2-1-1, doublets, a pull-up, speed changes and two sideslips, all of which
    move the elevator.
    """
    record = recorded_channels(FLIGHT / "t37_01_clean_low_speed_5kft.nc", NAMES)
    sideslip = draft_case(rows.rows_of_test("2.d.8"), record)
    assert 271.7 <= sideslip.case["window"][0] < sideslip.case["window"][1] <= 280.8
    assert sideslip.events["capture"][1]
    assert "--window chooses another: 280.76 ... 289.76 s" in sideslip.remarks[0]
    assert draft_case(rows.rows_of_test("2.c.10"), record).case["window"] == [
        8.4,
        21.7,
    ]  # the 3-2-1-1, not the pull-up
    assert draft_case(rows.rows_of_test("1.d.1"), record).case["window"][0] == pytest.approx(
        210.5, abs=0.2
    )


@pytest.mark.nightly
def test_a_record_without_a_manoeuvre_that_fits_states_what_it_lists(tmp_path):
    with pytest.raises(
        SchemaError,
        match=r"fits 2\.d\.8 \(steady_sideslip, sideslip\); it lists trim .*, block \(elevator\) "
        r".*--window",
    ):
        init_case(FLIGHT / "t37_26_val_phugoid.nc", "2.d.8", tmp_path / "case.toml")
    assert not list(tmp_path.iterdir())
    case, _ = init_case(
        FLIGHT / "t37_26_val_phugoid.nc", "2.d.8", tmp_path / "case.toml", window=(8.0, 20.0)
    )
    assert case.id == "2.d.8"
