import dataclasses
import math

import pytest

from flightmech.errors import ParseError, SchemaError
from pom.cases.case import PomCase, read_case


def criteria(path):
    return {c.name: c for c in read_case(path).criteria}


def test_short_period_has_one_group_of_alternatives(write_case):
    found = criteria(write_case())
    assert {name: c.group for name, c in found.items()} == {
        "pitch_angle": "pitch",
        "pitch_rate": "pitch",
        "normal_acceleration": "g3",
    }
    assert [c.channel for c in found.values()] == ["theta", "q", "nz"]
    assert found["pitch_angle"].band.text == "1.5 deg"
    assert found["normal_acceleration"].band.text == "0.1 g"
    assert found["pitch_angle"].window == (1.0, 9.0)


def test_texts_of_the_page_are_separate_from_what_is_computed(write_case):
    case = read_case(write_case())
    texts = {"title": "Another", "notes": "late", "signatures": {"pilot": {"name": "A"}}}
    assert dataclasses.replace(case, **texts).without_texts() == case.without_texts()
    for other in ({"fraction": 0.5}, {"window": (1.0, 8.0)}, {"rationale": {"theta": "wide"}}):
        assert dataclasses.replace(case, **other).without_texts() != case.without_texts()
    # the page still has them
    assert case.title


def test_a_title_has_500_characters_at_most(write_case):
    path = write_case()
    title = read_case(path).title
    path.write_text(path.read_text().replace(title, "x" * 501))
    with pytest.raises(
        SchemaError, match=r"case\.title: string should have at most 500 characters"
    ):
        read_case(path)


def test_every_problem_at_once(write_case):
    path = write_case(
        case='windw = [1.0, 2.0]\nfeatures = ["reversible_control"]',
        more='[conditions]\ndelta_ff = 1\ngear = "3 ft"',
    )
    with pytest.raises(SchemaError) as caught:
        read_case(path)
    text = str(caught.value)
    assert "case.windw: unknown key; near it: window" in text
    assert "unknown condition 'delta_ff'; near it: delta_f" in text
    assert "conditions.gear: unit 'ft' cannot be converted to '1'" in text


def test_misspelt_feature_and_unknown_test_name_the_near_ones(write_case):
    with pytest.raises(SchemaError) as caught:
        read_case(write_case(id="2.c.100", case='features = ["reversible_control"]'))
    assert "near it: 2.c.10" in str(caught.value)
    assert "near it: reversible_controls" in str(caught.value)


def test_a_missing_record_is_named(write_case, tmp_path):
    path = write_case()
    (tmp_path / "record.nc").unlink()
    with pytest.raises(SchemaError, match=r"case\.record: no file"):
        read_case(path)


def test_broken_toml_names_its_line(tmp_path):
    path = tmp_path / "x.toml"
    path.write_text("[case]\nid = \n")
    with pytest.raises(ParseError, match="line 2"):
        read_case(path)


def test_window_of_a_change_runs_from_5_s_before_to_15_s_after(write_case):
    path = write_case(
        "2.c.4",
        case='shortened = "short record"',
        more="[events]\nchange_start = 3.0\nchange_end = 5.0",
    )
    assert criteria(path)["airspeed"].window == (
        1.0,
        9.0,
    )  # -2 ... 20 s required, cut to the case with a stated reason
    with pytest.raises(SchemaError, match=r"shorter than row airspeed asks \(-2 ... 20 s"):
        read_case(write_case("2.c.4", more="[events]\nchange_start = 3.0\nchange_end = 5.0"))


def test_a_bounding_event_must_be_marked(write_case):
    with pytest.raises(
        SchemaError, match=r"events.input_end: missing; row period .*no events; write its time"
    ):
        read_case(write_case("2.c.9"))


@pytest.mark.parametrize(
    ("test", "events", "names"),
    [
        ("2.c.4", {"change_start": 8.69, "change_end": 6.0}, "change_start 8.69 s is not before"),
        ("2.c.10", {"segment_start": 5.0, "segment_end": 5.0}, "segment_start 5 s is not before"),
        ("1.b.1", {"brake_release": 8.0, "vr": 3.0}, "brake_release 8 s is not before vr 3 s"),
    ],
)
def test_events_in_the_wrong_order_are_refused(write_case, test, events, names):
    times = "\n".join(f"{name} = {time}" for name, time in events.items())
    with pytest.raises(SchemaError) as caught:
        read_case(write_case(test, more=f"[events]\n{times}"))
    assert [text for text in caught.value.problems if "is not before" in text] == [
        text for text in caught.value.problems if names in text
    ]
    assert any(names in text for text in caught.value.problems)


def test_rows_with_a_condition_apply_only_with_the_feature(write_case):
    assert not criteria(write_case("2.d.2"))["wheel_force"].applies
    assert criteria(write_case("2.d.2", case='features = ["reversible_controls"]'))[
        "wheel_force"
    ].applies


def test_a_tolerance_of_the_case_replaces_that_of_the_row(write_case):
    found = criteria(
        write_case(more='[tolerance]\ntheta = "1 deg"\nnz = { abs = "0.1", percent = 10 }')
    )
    assert found["pitch_angle"].band.text == "1 deg"
    assert found["pitch_angle"].provenance == "case file"
    assert found["pitch_angle"].group == "pitch"
    assert found["normal_acceleration"].band.text == "10 % of the flight value or 0.1, the greater"
    assert found["pitch_rate"].provenance == "verified"


def test_a_tolerance_on_another_channel_adds_a_criterion(write_case):
    found = criteria(write_case(more='[tolerance]\nbeta = "1 deg"'))
    assert (found["beta"].measure, found["beta"].group) == ("trace", "beta")


@pytest.mark.parametrize(
    "more",
    [
        '[tolerance]\nbeta = { abs = "1 deg", group = "pitch" }',
        # the row may not join the group of the band either
        '[tolerance]\nbeta = { abs = "1 deg", group = "mine" }\n'
        'pitch_angle = { abs = "1.5 deg", group = "mine" }',
    ],
)
def test_a_band_of_the_case_never_replaces_a_row(write_case, more):
    with pytest.raises(SchemaError, match=r"tolerance\.beta\.group: .* never replaces a row"):
        read_case(write_case(more=more))


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ('theta = "1.5 ft"', "unit 'ft' cannot be converted to 'rad'"),
        ("theta = {}", "has no width"),
        ('theta = "-1 deg"', "is not positive"),
        ("theta = inf", "width inf is not positive and finite"),
        ("theta = nan", "width nan is not positive and finite"),
        ("theta = { percent = inf }", "width inf is not positive and finite"),
        ("theta = { percnt = 3 }", "near it: percent"),
        ('thetta = "1 deg"', "near it: theta"),
    ],
)
def test_wrong_tolerances_are_refused(write_case, entry, text):
    with pytest.raises(SchemaError) as caught:
        read_case(write_case(more=f"[tolerance]\n{entry}"))
    assert text in str(caught.value)


def test_a_condition_in_degrees_or_feet_is_a_problem(write_case):
    with pytest.raises(SchemaError) as caught:
        read_case(write_case(more="[conditions]\ndelta_f = 40\nh = 50000"))
    text = str(caught.value)
    assert "conditions.delta_f: delta_f 40 rad (2292 deg) is outside" in text
    assert "is 40 deg meant? write '40 deg'" in text
    assert "is 50000 ft meant? write '50000 ft'" in text


def test_conditions_carry_units(write_case):
    case = read_case(write_case(more='[conditions]\ndelta_f = "40 deg"'))
    assert case.conditions["delta_f"] == pytest.approx(math.radians(40.0), rel=1e-15)
    assert PomCase.from_dict(case.to_dict()) == case


def test_equipment_that_the_aeroplane_has_not_is_stated_by_the_case(write_case):
    found = criteria(
        write_case("1.d.3", case='absent = ["epr", "torque"]', more="[events]\ncapture = 8.0")
    )
    assert {name for name, c in found.items() if c.applies} == {"n1", "fuel_flow"}
    assert found["epr"].reason == "the aeroplane has no epr"
    with pytest.raises(
        SchemaError,
        match=r"case\.absent: unknown equipment of this test 'n1'; allowed: epr, torque",
    ):
        criteria(write_case("1.d.3", case='absent = ["n1"]', more="[events]\ncapture = 8.0"))


def test_memory_rows_keep_their_mark(write_case):
    later = 'edition = "2016-05-31 (Amdt 60-4)"'
    assert criteria(write_case("2.c.8.a", case=later))["roll_rate"].provenance == "memory"
    assert criteria(write_case("2.d.3"))["bank_angle"].provenance == "verified"


def test_engineering_reference_takes_the_fraction_of_its_edition(write_case):
    """Rule R9: 20 % in the edition of 2014, 40 % from 2016 on; a fraction in the file goes before
    both.
    """
    assert read_case(write_case(case='reference = "engineering"')).fraction == 0.2
    later = 'reference = "engineering"\nedition = "2016-05-31 (Amdt 60-4)"'
    assert read_case(write_case("2.c.8.a", case=later)).fraction == 0.4
    own = read_case(write_case(case='reference = "engineering"\nfraction = 0.3'))
    assert {c.fraction for c in own.criteria} == {0.3}
    assert read_case(write_case()).fraction == 1.0


def test_texts_and_ranges_reach_the_case(write_case):
    more = (
        '[ranges]\n"engine1.thrust" = "1000 lbf"\n[ticks]\npitch_angle = "A. Smith, '
        '2026-11-21, agreed"\n[rationale]\ntheta = "gust"\n'
    )
    case = read_case(
        write_case(
            case='objective = "shows it"\nmanual = "pull"', more=more + '[source]\nrun = "21"'
        )
    )
    assert case.ranges == {"engine1.thrust": pytest.approx(4448.2216)}
    assert (case.objective, case.manual, case.source["run"]) == ("shows it", "pull", "21")
    assert case.ticks["pitch_angle"].startswith("A. Smith")
    assert PomCase.from_dict(case.to_dict()) == case


def test_a_floor_takes_its_certified_value(write_case):
    case = read_case(
        write_case("1.c.2", more='[certified]\nclimb_gradient = "2.4 %"', case='shortened = "x"')
    )
    assert case.certified == {"climb_gradient": pytest.approx(0.024)}


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ('[ticks]\npitch = "x"', "ticks: unknown criterion 'pitch'; near it: pitch_"),
        (
            '[rationale]\nthetta = "x"',
            "rationale: unknown criterion, channel or trim quantity 'thetta'; near it: theta",
        ),
        ('[ranges]\ntheta = "3 ft"', "ranges.theta: unit 'ft' cannot be converted to 'rad'"),
        ('[certified]\nclimb_gradient = "2.4 %"', "certified: unknown parameter 'climb_gradient'"),
    ],
)
def test_tables_of_texts_and_ranges_know_their_keys(write_case, more, text):
    with pytest.raises(SchemaError) as caught:
        read_case(write_case(more=more))
    assert text in str(caught.value)


def test_problems_of_every_table_come_together(write_case):
    """One file, one list: wrong limits, a loop without its drive, an event, a tick and a missing
    record.
    """
    loop = '[[drive.pilot]]\ncontrol = "delta_q"\nchannel = "phi"\ngain = 1\nlimit = 1'
    path = write_case(more=f'[events]\nrelease_x = 1\n[ticks]\nnone = "x"\n{loop}')
    text = path.read_text().replace("record.nc", "no.nc")
    path.write_text(
        text.replace("[drive]", '[drive]\nlimits = { delta_e = "-1 deg", delta_x = 3 }')
    )
    with pytest.raises(SchemaError) as caught:
        read_case(path)
    problems = "\n".join(caught.value.problems)
    for part in (
        "events: unknown event 'release_x'",
        "ticks: unknown criterion 'none'",
        "drive.limits.delta_e: -0.0174533 is not positive",
        "unknown bias of the trim 'delta_x'",
        "unknown control 'delta_q'",
        "loops and surfaces",
        "case.record: no file",
    ):
        assert part in problems


@pytest.mark.parametrize(
    "wrong", ['reference = "flght"', "objektive = 3", "fraction = 7", "show = 3"]
)
def test_a_key_of_wrong_form_does_not_hide_the_rest(write_case, wrong):
    path = write_case("2.c.9", case=wrong, more='[conditions]\ngear = "3 ft"\n[ticks]\nnone = "x"')
    with pytest.raises(SchemaError) as caught:
        read_case(path)
    problems = "\n".join(caught.value.problems)
    assert f"case.{wrong.split(' ')[0]}" in problems
    for part in (
        "conditions.gear: unit 'ft'",
        "unknown criterion 'none'",
        "events.input_end: missing",
    ):
        assert part in problems
    assert len(caught.value.problems) == len(set(caught.value.problems))


def test_without_a_test_or_a_window_only_the_free_tables_are_looked_at(write_case):
    path = write_case("2.c.9", more='[conditions]\ngear = "3 ft"')
    path.write_text(path.read_text().replace("window", "windw"))
    with pytest.raises(SchemaError) as caught:
        read_case(path)
    problems = "\n".join(caught.value.problems)
    assert "case.window: missing" in problems
    assert "conditions.gear: unit 'ft'" in problems
    assert "input_end" not in problems  # nothing is known of the rows' windows


def test_calm_air_takes_no_wind(write_case):
    path = write_case(more='[conditions]\nwind_n = "5 kt"')
    path.write_text(path.read_text().replace("[drive]", '[drive]\nwind = "none"'))
    with pytest.raises(SchemaError, match=r"conditions\.wind_n: drive\.wind is \"none\""):
        read_case(path)


@pytest.mark.parametrize("value", ["inf", "nan"])
@pytest.mark.parametrize(
    ("table", "name"), [("ranges", "theta"), ("conditions", "mass"), ("certified", "gradient")]
)
def test_a_number_that_is_not_finite_is_an_error(write_case, table, name, value):
    path = write_case(more=f"[{table}]\n{name} = {value}")
    with pytest.raises(SchemaError, match=rf"{table}\.{name}: {value} is not finite"):
        read_case(path)


def test_times_in_another_unit_are_named(write_case):
    """Minutes of a window, and milliseconds of an event."""
    path = write_case(more="[events]\ninput_end = 7000.0")
    with pytest.raises(SchemaError, match=r"input_end: 7000 s lies far outside of the window"):
        read_case(path)
    path = write_case()
    text = path.read_text()
    window = next(line for line in text.split("\n") if line.startswith("window"))
    path.write_text(text.replace(window, "window = [0.07, 0.25]"))
    with pytest.raises(SchemaError, match=r"0\.07 \.\.\. 0\.25 s holds 0\.18 s; it counts in sec"):
        read_case(path)


def test_the_contents_of_the_files_that_a_case_names_count(write_case, tmp_path):
    (tmp_path / "aircraft.toml").write_text('engine = [{ deck = { file = "deck.nc" } }]')
    names = ("deck.nc", "names.toml", "law.fmu", "table.toml")
    for name in names:
        (tmp_path / name).write_text("first")
    case = dataclasses.replace(
        read_case(write_case()),
        aircraft=str(tmp_path / "aircraft.toml"),
        names=str(tmp_path / "names.toml"),
        law=str(tmp_path / "law.fmu"),
        models={"other": str(tmp_path / "table.toml")},
    )
    first = case.contents()
    for name in names:
        (tmp_path / name).write_text("edited")
        assert case.contents() != first, name
        (tmp_path / name).write_text("first")
    # the wind of the record is not part of its reconstructed path
    measured = dataclasses.replace(case, wind="measured").contents()
    assert [item.path for item in measured if item not in first] == [tmp_path / "record.nc"]
