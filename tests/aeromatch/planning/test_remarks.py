"""Unusual numbers and models of a project file are remarks of the plan."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import xarray as xr

import flightmech
from aeromatch.planning.record_look import stop_remarks
from aeromatch.planning.remarks import (
    aircraft_remarks,
    case_statements,
    project_remarks,
    purpose_gaps,
)
from aeromatch.project.model_sections import NewTerm
from flightmech.errors import SchemaError
from pom.cases.case import read_case

C182 = Path(__file__).parents[3] / "data" / "c182"


def remarks(*models, gear=None, manoeuvres=(), **errors):
    fit = SimpleNamespace(name="pitch", models=models, manoeuvres=manoeuvres)
    project = SimpleNamespace(fit=(fit,), errors=errors, ground_effect=None, gear=gear)
    return project_remarks(project)


def test_usual_errors_and_models_have_no_remark():
    assert remarks("Cm = 1 + alpha + qhat", mass=0.005, thrust=0.1, timing=0.02) == []


def test_standard_errors_in_per_cent():
    mass, thrust = remarks(mass=0.5, thrust=3.0)
    assert "errors.mass = 0.5 is a standard error of 50 %" in mass
    assert "0.005 for half a per cent" in mass
    assert "300 %" in thrust
    assert "2 s" in remarks(timing=2.0)[0]
    (drag,) = remarks(gear=SimpleNamespace(errors={"drag": 3.0}))
    assert drag.startswith("gear.errors.drag = 3 is a standard error of 3 in CD; 0.03")


def test_a_model_without_its_constant():
    (line,) = remarks("Cm = alpha + qhat + delta_e")
    assert "has no constant" in line
    assert "write Cm = 1 + ..." in line


def test_a_rate_with_a_dimension():
    (line,) = remarks("Cm = 1 + alpha + q")
    assert "write qhat" in line


def test_an_angle_without_a_unit_that_is_one_in_degrees():
    with pytest.raises(SchemaError) as caught:
        NewTerm(axes={"alpha": [0, 6]}, stderr=0.1).leaf()
    assert caught.value.problems == [
        "axis alpha reaches 6 rad, 343.8 deg; a number without a unit is in rad: write '6 deg'"
    ]
    # small numbers are radians, a text has its unit, and other axes have no angle
    NewTerm(axes={"alpha": [0, 0.1]}, stderr=0.1).leaf()
    NewTerm(axes={"alpha": ["0 deg", "180 deg"], "mach": [0, 3]}, stderr=0.1).leaf()


def test_engines_and_instruments_of_the_aircraft_file():
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    assert aircraft_remarks(aircraft) == []
    engine = aircraft.engines[0]
    small = replace(engine, propeller=replace(engine.propeller, diameter=0.81))
    unit = {**aircraft.instruments["inertial"], "position": [15.7, 5.9, 9.8]}
    instruments = {**aircraft.instruments, "inertial": unit}
    power, place = aircraft_remarks(replace(aircraft, engines=(small,), instruments=instruments))
    assert "as if in were given as cm" in power
    assert "accelerometers: position = [15.7, 5.9, 9.8] m is outside" in place


def test_errors_of_instruments_in_degrees_per_cent_or_milliseconds():
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    tables = {name: dict(table) for name, table in aircraft.instruments.items()}
    (vanes,) = [name for name, table in tables.items() if "alpha_vane" in table.get("noise", {})]
    tables[vanes]["noise"] = {"alpha_vane": 0.3, "beta_vane": "0.3 deg"}
    tables[vanes]["lag"] = [50.0, 30.0]
    tables[vanes]["factor"] = {"alpha_vane": [105.0, 5.0]}
    noise, factor, lag = aircraft_remarks(replace(aircraft, instruments=tables))
    assert f"instruments.{vanes}: noise of alpha_vane is 17" in noise
    assert "factor of alpha_vane is 105 +- 5; usual is 1.05 +- 0.05" in factor
    assert "lag is 50 +- 30 s" in lag


def test_a_control_past_its_stops():
    aircraft = SimpleNamespace(limits={"delta_e": (-0.05, 0.05), "delta_r": (-0.3, 0.3)})
    moved = ("time", [-0.02, 0.0, 0.14])
    states = xr.Dataset({"delta_e": moved, "delta_r": moved})
    (line,) = stop_remarks(SimpleNamespace(name="cruise", aircraft=aircraft), states)
    assert line.startswith("record cruise: delta_e reaches 8.02 deg, past its upper stop")


def test_the_rolling_moment_with_the_regressors_of_lift():
    (line,) = remarks("Cl = 1 + alpha + qhat")
    assert "Cl is the rolling moment, and lift is CL" in line
    assert remarks("Cl = 1 + beta + phat + rhat") == []


def test_a_moment_without_the_surface_of_its_manoeuvre():
    (line,) = remarks("Cm = 1 + alpha + qhat", manoeuvres=["3211 elevator"])
    assert "Cm lacks delta_e, and the elevator moves in its manoeuvres" in line
    assert remarks("Cm = 1 + alpha + delta_e", manoeuvres=["3211 elevator"]) == []
    assert remarks("CL = 1 + alpha", manoeuvres=["3211 elevator"]) == []


def test_a_match_that_identifies_or_proves_nothing_is_no_success():
    bare = SimpleNamespace(published=(), cases=())
    identifies, proves = purpose_gaps(bare, {"proof": False})
    assert identifies.startswith("no record identifies: the project has no fit")
    assert proves.startswith("no record proves: the project has no case")
    assert purpose_gaps(bare, {"cruise": True}) == [proves]
    whole = SimpleNamespace(published=("slopes.csv",), cases=("case.toml",))
    assert purpose_gaps(whole, {"proof": False}) == []


def test_what_a_case_file_makes_unusual_is_in_the_plan():
    case = read_case(C182 / "cases" / "short_period.toml")
    assert case_statements([case]) == []
    untrimmed = replace(case, drive=replace(case.drive, trim=False))
    (line,) = case_statements([untrimmed])
    assert line.startswith("case short_period: the model starts at the recorded state without trim")


@pytest.mark.parametrize(("reason", "has_remark"), [("", True), ("pitch_rate", False)])
def test_a_wider_band_without_a_rationale_is_named(tmp_path, reason, has_remark):
    text = (C182 / "cases" / "short_period.toml").read_text().replace('"../', f'"{C182}/')
    text += '\n[tolerance]\npitch_rate = "9 deg/s"\n'
    text += f'\n[rationale]\n{reason} = "J. Smith, 2024-05-17, gusts"\n' if reason else ""
    file = tmp_path / "wide.toml"
    file.write_text(text)
    (line,) = case_statements([read_case(file)])
    assert line.startswith("case short_period: tolerance of pitch rate")
    assert line.endswith("; no [rationale] states why") == has_remark
