"""Facts of the aircraft: read, joined with a case, and contradictions found before a run."""

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.facts import AircraftFacts, read_facts
from flightmech.errors import SchemaError
from pom.cases.case import PomCase, read_case
from pom.cases.fact_agreement import check_record_facts, contradictions, demand_agreement

AIRCRAFT = """name = "A"
S = 20.0
cbar = 1.7
b = 10.0
mass = 2000.0
Ixx = 1000.0
Iyy = 2000.0
Izz = 2500.0
[[engine]]
position = [0.0, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
{more}
"""
FACTS = '[facts]\nreversible_controls = true\nmtow = "6000 lb"\nv1 = "90 kt"'


@pytest.fixture
def write_aircraft_file(tmp_path):
    def write(more=FACTS):
        path = tmp_path / "aircraft.toml"
        path.write_text(AIRCRAFT.format(more=more))
        return path

    return write


def test_the_facts_are_read_in_si_and_written_again(write_aircraft_file, tmp_path):
    path = write_aircraft_file()
    facts = flightmech.read_aircraft(path).facts
    assert facts == AircraftFacts(True, pytest.approx(2721.55, abs=0.01), v1=pytest.approx(46.3))
    assert read_facts(path).facts.engines == 1  # of the engine tables
    written = flightmech.write_aircraft(flightmech.read_aircraft(path), tmp_path / "again.toml")
    assert flightmech.read_aircraft(written).facts == facts


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("[facts]\nmtow = 1900.0", "mtow: 1900 kg is below the gross mass 2000 kg"),
        ("[facts]\nbasic_operating_weight = 2300.0", "2300 kg is above the gross mass 2000 kg"),
        ("[facts]\nengines = 2", "engines: 2, and the file has 1 tables"),
        ('[facts]\nmean_chord = "17 m"', "check the units"),
        ("[facts]\nmtow = 2500.0\nbasic_operating_weight = 2600.0", "is not below mtow"),
        ("[facts]\nv1 = -3.0", "expected a positive number"),
        ("[facts]\nv1 = 90.0", "90 m/s is 174.9 kt, .* lift coefficient of 0.2.*write '90 kt'"),
    ],
)
def test_facts_that_contradict_their_file_are_errors(write_aircraft_file, more, text):
    with pytest.raises(SchemaError, match=text):
        flightmech.read_aircraft(write_aircraft_file(more))


def test_reversible_controls_of_the_aircraft_apply_the_rows_of_forces(
    write_case, write_aircraft_file
):
    write_aircraft_file()
    named = 'aircraft = "aircraft.toml"'
    case = read_case(write_case("2.d.2", case=named))
    assert case.features == ("reversible_controls",)
    assert {c.name for c in case.criteria if c.applies} == {"roll_rate", "wheel_force"}
    # a stored case is the same
    assert PomCase.from_dict(case.to_dict()).criteria == case.criteria
    write_aircraft_file("[facts]\nreversible_controls = false")
    assert not read_case(write_case("2.d.2", case=named)).criteria[1].applies
    with pytest.raises(SchemaError, match="controls are not reversible"):
        read_case(write_case("2.d.2", case=f'{named}\nfeatures = ["reversible_controls"]'))


def test_a_case_does_not_contradict_its_aircraft(write_case, write_aircraft_file):
    write_aircraft_file()
    named = 'aircraft = "aircraft.toml"'
    with pytest.raises(SchemaError, match=r"facts\.mtow: 3000 kg contradicts 2721\.6 kg"):
        read_case(write_case(case=named, more="[facts]\nmtow = 3000.0"))
    with pytest.raises(SchemaError, match=r"conditions\.mass: .* above the largest take-off mass"):
        read_case(write_case(case=named, more="[conditions]\nmass = 2800.0"))
    # the decision speed depends on weight and flaps
    case = read_case(write_case(case=named, more="[facts]\nv1 = 40.0"))
    assert case.facts["v1"] == 40.0
    with pytest.raises(SchemaError, match="engine 2, and the aircraft has 1"):
        read_case(write_case(case=f'{named}\nshow = ["engine2.n1"]'))


def test_only_an_aircraft_without_engines_flies_without_a_drive(write_case, write_aircraft_file):
    aircraft = write_aircraft_file()
    driven = write_case(case='aircraft = "aircraft.toml"')
    undriven = driven.with_name("undriven.toml")
    undriven.write_text(driven.read_text().replace('engine = "thrust"', 'engine = "none"'))
    with pytest.raises(SchemaError, match='engine: "none" is for an aircraft without engines, and'):
        read_case(undriven)
    aircraft.write_text(AIRCRAFT.split("[[engine]]")[0] + "[facts]\nengines = 0\n")
    assert read_case(undriven).drive.engine == "none"
    with pytest.raises(
        SchemaError, match=r'the aircraft has none .*; write drive\.engine = "none"'
    ):
        read_case(driven)


def test_equipment_that_the_aircraft_lacks_is_no_departure(write_case, write_aircraft_file):
    write_aircraft_file('[facts]\nwithout = ["epr", "torque"]')
    more = "[events]\ncapture = 8.0"
    case = read_case(write_case("1.d.3", case='aircraft = "aircraft.toml"', more=more))
    assert {c.name for c in case.criteria if c.applies} == {"n1", "fuel_flow"}
    assert case.absent == ()
    write_aircraft_file('[facts]\nwithout = ["epsilon"]')
    with pytest.raises(SchemaError, match=r"facts\.without"):
        read_case(write_case("1.d.3", case='aircraft = "aircraft.toml"', more=more))


def test_a_record_does_not_contradict_the_aircraft(write_case, write_aircraft_file):
    write_aircraft_file()
    case = read_case(write_case(case='aircraft = "aircraft.toml"'))
    mass = ("time", np.array([2700.0, 2690.0]))
    check_record_facts(case, xr.Dataset({"mass": mass, "engine1.thrust": mass}))
    with pytest.raises(SchemaError) as error:
        check_record_facts(case, xr.Dataset({"mass": ("time", [2800.0, 1.0]), "engine2.n1": mass}))
    assert "above the largest take-off mass" in str(error.value)
    assert "the record has engine 2" in str(error.value)


def test_cases_of_one_report_agree_on_the_aircraft(write_case):
    claims = read_case(write_case("2.d.2", case='features = ["reversible_controls"]'))
    silent = read_case(
        write_case("2.e.1", more='[events]\n"200ft_agl" = 1\nnosewheel_touchdown = 9')
    )
    other = read_case(write_case("2.c.9", more="[events]\ninput_end = 2\n[facts]\nengines = 4"))
    two = read_case(write_case("2.c.10", more="[facts]\nengines = 2\nv1 = 40.0"))
    three = read_case(write_case("2.c.10", more="[facts]\nengines = 2\nv1 = 50.0"))
    assert contradictions([claims, two, three]) == []
    (text,) = contradictions([claims, silent])
    assert "claims reversible_controls and this case does not" in text
    with pytest.raises(SchemaError, match=r"engines is 4, and case .* has 2"):
        demand_agreement([other, two])


SPRINGLESS = """[control.delta_e]
S_hinge = 1.0
c_hinge = 0.3
gearing = -2.0
[circuit.column]
mass = 4.0
stops = [-0.15, 0.18]
"""


def test_circuits_without_a_spring_are_reversible_controls(write_case, write_aircraft_file):
    named = 'aircraft = "aircraft.toml"'
    denied = "[facts]\nreversible_controls = false\n"
    write_aircraft_file(denied + SPRINGLESS)
    with pytest.raises(SchemaError, match=r"\[circuit.column\] .* has no centring spring"):
        read_case(write_case(case=named))
    # an artificial feel has a spring
    write_aircraft_file(denied + SPRINGLESS + "stiffness = 400.0\n")
    assert read_case(write_case(case=named)).facts["reversible_controls"] is False
