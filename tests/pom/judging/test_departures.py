"""Departures from the printed row: found from the case, stated as remarks, never a plain pass."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import xarray as xr

import flightmech
from flightmech.errors import SchemaError
from pom.cases.case import PomCase, read_case
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import RECORD_SPAN
from pom.cases.resolve import LIMIT_UNITS
from pom.judging.departures import case_departures, record_departures
from pom.replaying.trim import _limit_remark
from pom.status import status_of

PHUGOID = Path(__file__).parents[3] / "data" / "t37" / "cases" / "26_phugoid.toml"


def departures(path):
    case = read_case(path)
    texts = [remark.text for remark in case_departures(case)]
    # a stored case shows the same departures
    assert [item.text for item in case_departures(PomCase.from_dict(case.to_dict()))] == texts
    return texts


def test_the_printed_rows_are_no_departure(write_case):
    assert departures(write_case()) == []


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ('pitch_angle = "9 deg"', "pitch angle 9 deg, printed 1.5 deg, 6 times as wide"),
        ('theta = "0.0525 rad"', "pitch angle 0.0525 rad, printed 1.5 deg, 2.01 times as wide"),
        # the greater of a wide and a narrow limit is wide
        (
            'pitch_angle = { abs = "1 deg", percent = 50 }',
            "pitch angle 50 % of the flight value or 1 deg, the greater, printed 1.5 deg",
        ),
        ("pitch_angle = { percent = 1 }", "pitch angle 1 % of the flight value, printed 1.5 deg"),
    ],
)
def test_a_band_that_may_be_wider_is_a_departure(write_case, entry, text):
    (found,) = departures(write_case(more=f"[tolerance]\n{entry}"))
    assert text in found


@pytest.mark.parametrize(
    "entry",
    [
        'pitch_angle = "1.5 deg"',
        'pitch_angle = "1 deg"',
        # the smaller of two is at most the narrow one
        'pitch_angle = { abs = "1 deg", percent = 50, rule = "lesser_of" }',
        # a band in addition to the rows
        'beta = "9 deg"',
    ],
)
def test_a_band_that_is_never_wider_is_none(write_case, entry):
    assert departures(write_case(more=f"[tolerance]\n{entry}")) == []


def test_a_narrowed_window_is_a_departure(write_case):
    case = read_case(write_case())
    (row,) = [c for c in case.criteria if c.name == "pitch_angle"]
    start, stop = row.window
    entry = f'[tolerance]\npitch_angle = {{ abs = "1.5 deg", window = [{start}, {stop - 1.0}] }}'
    (found,) = departures(write_case(more=entry))
    assert found == (
        f"departure: pitch angle is judged in {start:g} ... {stop - 1.0:g} s, the row in "
        f"{start:g} ... {stop:g} s"
    )
    whole = f'[tolerance]\npitch_angle = {{ abs = "1.5 deg", window = [{start}, {stop}] }}'
    assert departures(write_case(more=whole)) == []


def test_a_row_that_becomes_an_alternative_is_a_departure(write_case):
    entry = '[tolerance]\nnormal_acceleration = { abs = "0.1 g", group = "pitch" }'
    (found,) = departures(write_case(more=entry))
    assert "normal acceleration is an alternative of pitch angle" in found


def test_a_larger_share_of_the_tolerance_is_a_departure(write_case):
    engineering = 'reference = "engineering"'
    assert departures(write_case(case=engineering)) == []
    (found,) = departures(write_case(case=f"{engineering}\nfraction = 0.5"))
    assert "0.5 of the tolerance is applied, the rule has 0.2" in found


def test_a_record_called_short_must_be_short(write_case):
    case = read_case(write_case("2.c.2", **FLAPS))

    def found(first, last):
        states = xr.Dataset(attrs={RECORD_SPAN: (first, last)})
        return [remark.text for remark in record_departures(case, states)]

    (text,) = found(*case.window)
    assert "the record holds" in text
    assert "that the rows require (the record ends)" in text
    (text,) = found(0.0, 60.0)
    assert "is called short (the record ends), but the record holds" in text


def overrides(path, **recorded):
    states = xr.Dataset({name: ("time", [value, value]) for name, value in recorded.items()})
    return [remark.text for remark in record_departures(read_case(path), states)]


def test_a_mass_or_a_state_against_the_record_is_a_departure(write_case):
    path = write_case(more='[conditions]\nmass = 1900.0\npsi = "361 deg"\nlat = "45 deg"')
    (text,) = overrides(path, mass=2099.0, psi=math.radians(361.0), lat=0.0)
    assert "mass" in text
    assert "is 1900 kg by the conditions of the case, the flight path has 2099 kg" in text
    assert overrides(path, mass=1900.1, psi=math.radians(361.0)) == []
    # what the record does not have is no override
    assert overrides(path) == []
    (text,) = overrides(path, mass=1900.0, psi=0.0)
    assert text.startswith("departure: 'psi'")


def test_a_wind_that_the_record_does_not_have_is_a_departure(write_case):
    path = write_case(more="[conditions]\nwind_d = 0.6")
    (text,) = overrides(path)
    assert text.startswith("departure: 'wind_d'")
    assert len(overrides(path, wind_d=0.1)) == 1
    assert overrides(path, wind_d=0.6) == []


FLAPS = {
    "case": 'shortened = "the record ends"',
    "more": "[events]\nchange_start = 6.0\nchange_end = 7.0",
}


def test_a_width_without_its_unit_is_refused(write_case):
    with pytest.raises(SchemaError) as caught:
        read_case(write_case("2.d.2", more="[tolerance]\nroll_rate = 0.5"))
    text = "0.5 has no unit: in rad s-1 it would be a half width of 0.5 rad s-1, 14.3 times the"
    assert text in str(caught.value)
    # a load factor counts in g and has no unit
    read_case(write_case(more="[tolerance]\nnormal_acceleration = 0.1"))


def test_departures_are_weaker_than_a_pass_and_stronger_than_limits():
    groups = {"g": "pass"}
    assert status_of(groups, departures=True) == "pass_with_departures"
    assert status_of(groups, departures=True, limits_exceeded=True) == "limits_exceeded"
    assert status_of({"g": "fail"}, departures=True) == "fail"


def test_the_wind_of_the_record_that_is_left_out_is_a_departure(write_case):
    def found(speed, wind):
        path = write_case(more=f'wind = "{wind}"')
        states = xr.Dataset({name: ("time", [speed, speed]) for name in ("wind_n", "wind_e")})
        return [remark.text for remark in record_departures(read_case(path), states)]

    assert found(5.0, "record") == []
    (text,) = found(5.0, "none")
    assert "calm air by drive.wind, the record has a mean wind of 13.7 kt" in text
    assert found(0.5, "none") == []


def test_a_held_input_against_the_record_is_a_departure(write_case):
    path = write_case(more='[conditions]\ndelta_f = "0 deg"\ndelta_nw = 0.0')
    assert overrides(path, delta_f=0.0, delta_nw=0.1) == []
    (text,) = overrides(path, delta_f=0.35, delta_nw=0.1)
    assert "delta_f" in text
    assert "the record has 20.054 deg" in text
    path = write_case(more='[conditions]\n"device.ice.setting" = 0.0')
    (text,) = overrides(path, **{"device.ice.setting": 1.0})
    assert "is 0 by the conditions of the case, the record has 1" in text


def test_a_row_left_out_by_the_case_is_a_departure(write_case):
    case = 'absent = ["epr", "torque"]'
    found = departures(write_case("1.d.3", case=case, more="[events]\ncapture = 8.0"))
    assert [text.split(" is left out")[0] for text in found] == [
        "departure: epr",
        "departure: torque",
    ]


def test_an_inertia_against_the_aircraft_file_is_a_departure(write_case, trainer, tmp_path):
    flightmech.write_aircraft(trainer.AIRCRAFT, tmp_path / "aircraft.toml")

    def found(more):
        path = write_case(case='aircraft = "aircraft.toml"', more=f"[conditions]\n{more}")
        return overrides(path)

    (text,) = found("Iyy = 12150.0")
    assert "Iyy" in text
    assert "12150 kg m2 by the conditions of the case, the aircraft file has 8100 kg m2" in text
    assert found("Iyy = 8100.0") == []
    (text,) = found('x_cg_b = "3 in"')
    assert "the aircraft file has 0 m" in text


def test_a_configuration_that_no_record_shows_is_a_departure(write_case):
    (text,) = overrides(write_case(more='[conditions]\ndelta_f = "30 deg"'))
    assert "delta_f" in text
    assert "is held at 30 deg by the conditions of the case; the record does not show it" in text
    # at rest, or steered as its calibration requires
    assert overrides(write_case(more="[conditions]\ndelta_f = 0.0\ndelta_nw = 0.1")) == []


def test_a_temperature_against_the_record_is_a_departure(write_case):
    path = write_case(more="[conditions]\ndelta_T = 30.0")
    assert overrides(path) == []
    # 1500 m in the standard atmosphere: 278.4 K
    (text,) = overrides(path, h=1500.0, temperature=283.4)
    assert "'delta_T' is 30 K by the conditions of the case, the record has 5 K" in text
    assert overrides(path, h=1500.0, temperature=308.2) == []


def test_a_mode_of_another_channel_is_a_departure(write_case):
    more = "[events]\ninput_end = 2.0"
    assert departures(write_case(id="2.d.7", more=more)) == []
    texts = departures(write_case(id="2.d.7", case='mode_channel = "p"', more=more))
    assert len(texts) == 3
    for text in texts:
        assert "is measured on p by case.mode_channel, usual is r" in text


# a name of the vocabulary or of a row with an underscore, not in quotes
RAW = re.compile(r"(?<!['\w.])[A-Za-z]+\w*_\w+")


def test_departures_name_quantities_in_words(write_case):
    entries = ('pitch_angle = "9 deg"', 'pitch_angle = { abs = "1.5 deg", window = [1.0, 2.0] }')
    texts = []
    for entry in entries:
        texts += departures(write_case(more=f"[tolerance]\n{entry}"))
    path = write_case(more="[conditions]\nx_cg_b = 0.3\nwind_d = 0.6\ndelta_T = 30.0")
    texts += overrides(path, x_cg_b=0.1, h=0.0, temperature=288.15)
    assert len(texts) == 5
    assert [RAW.findall(text) for text in texts] == [[]] * 5


def test_a_trim_beyond_its_limit_is_named_in_words():
    for name in LIMIT_UNITS:
        text = _limit_remark(name, 1.0, 0.1, reason="").text
        assert not RAW.findall(text)
        # the key of a rationale stays
        assert text.endswith(f"('trim.{name}')")


@pytest.mark.parametrize(("control", "count"), [("delta_e", 1), ("delta_a", 0)])
def test_a_pilot_in_the_axis_of_a_mode_is_a_departure(control, count):
    case = read_case(PHUGOID)
    loop = PilotLoop(control, "alpha", -0.3, 0.0, 0.1)
    piloted = replace(case, drive=replace(case.drive, pilot=(loop,)))
    texts = [item.text for item in case_departures(piloted)]
    assert len([text for text in texts if "the math pilot moves" in text]) == count
