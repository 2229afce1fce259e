"""Data of the page of the match: verdicts, criteria and causes are those of the report; trials
stand apart from the proof.
"""

import shutil
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from bench import CASE, one_case_project

import aerodb
import pom
from aeromatch.workbench import matching
from aeromatch.workbench.opened import OpenProject
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.simulation.compiler import compile as compile_model

pytestmark = pytest.mark.slow  # a case is flown by two models, diagnosed and reported: five seconds
NAME, CASE_FILE = "roll_response", f"{{project}}/cases/{CASE}.toml"
TRIAL = "runs/edited"


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """The roll response of the T-37 flown by DATCOM's tables and by the same with more directional
    stability, as a match and as a trial.
    """
    folder = tmp_path_factory.mktemp("opened")
    opened = OpenProject(one_case_project(folder / "t37"), folder / "work")
    match, aircraft = opened.work / "match", opened.aircraft
    for place in (match, opened.work / "databases"):
        place.mkdir(parents=True)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", AeromatchWarning
        )  # of the listing of the flaps; tests/aerodb has them
        datcom = a_priori(opened.project, aircraft)
    models, files = {"datcom": datcom, "final": aerodb.edit.scale(datcom, "Cn/beta", 1.5)}, {}
    for name, db in models.items():
        aerodb.save(db, match / f"{name}.nc")
        write_aircraft(aircraft, match / f"{name}.toml")
        files[name] = write_fmu(compile_model(aircraft, db), match / f"{name}.fmu")
    case = pom.read_case(opened.project.cases[0])
    results, table = pom.replay_all([case], files), pom.diagnose(case, *models.values(), aircraft)
    pom.write_report(results, match / "report", title="T-37", diagnoses={NAME: table}, paper=None)
    pom.write_report(results, opened.work / TRIAL, title="trial", paper=None)
    for suffix in ("nc", "fmu"):
        shutil.copy(match / f"final.{suffix}", opened.work / "databases" / f"edited.{suffix}")
    return opened


def test_a_project_that_has_not_been_matched(tmp_path):
    opened = OpenProject(one_case_project(tmp_path / "t37"), tmp_path / "work")
    found = matching.show_match(opened, {}, None)
    assert found["project"] == "{project}/aeromatch.toml"
    assert [found[key] for key in ("reports", "models", "databases", "runs", "cases")] == [[]] * 5
    assert found["tuned"] is None
    with pytest.raises(FileNotFoundError, match="no results here"):
        matching.show_case(opened, {"name": NAME}, None)


@pytest.mark.nightly
def test_verdicts_are_those_of_the_report(opened):
    found = matching.show_match(opened, {}, None)
    assert found["reports"] == ["match", TRIAL]
    assert found["runs"] == ["datcom", "final"]
    assert found["place"] == "match/report/report.html"
    (row,) = found["cases"]
    (result,) = pom.read_archive(opened.work / "match" / "report").results
    assert (row["name"], row["row"], row["file"], row["failure"]) == (NAME, "2.d.2", CASE_FILE, "")
    assert row["passed"] == {run: result.status(run) == "pass" for run in result.runs}
    assert row["passed"]["datcom"] is False
    assert row["worst"] == {run: result.worst(run)["worst_ratio"] for run in result.runs}
    assert row["worst"]["datcom"] > 2.0 > row["worst"]["final"] > 1.0
    assert row["criterion"]["datcom"] == "roll rate"
    assert f'id="case-{row["key"]}"' in (opened.work / found["place"]).read_text(encoding="utf-8")


@pytest.mark.nightly
def test_a_trial_stands_apart_from_the_proof(opened):
    found = matching.show_match(opened, {"report": TRIAL}, None)
    assert found["place"] == f"{TRIAL}/report.html"
    assert [row["name"] for row in found["cases"]] == [NAME]
    assert matching.show_case(opened, {"report": TRIAL, "name": NAME}, None)["trial"] is True
    assert matching.show_case(opened, {"name": NAME}, None)["trial"] is False
    for report in ("runs/none", "../match", "runs/../match/report", ""):
        assert matching.show_match(opened, {"report": report}, None)["cases"] == []
        with pytest.raises(UnknownName, match="unknown report"):
            matching.show_case(opened, {"report": report, "name": NAME}, None)


@pytest.mark.nightly
def test_criteria_and_causes_of_a_case(opened):
    found = matching.show_case(opened, {"name": NAME}, None)
    assert {(row["run"], row["criterion"], row["verdict"]) for row in found["rows"]} >= {
        ("datcom", "roll_rate", "fail"),
        ("final", "roll_rate", "fail"),
    }
    assert found["window"] == [13.5, 22.5]
    assert ("single", "Cn/beta") in {(cause["stage"], cause["term"]) for cause in found["causes"]}
    assert "Cn/beta" in found["story"]
    assert (
        matching.show_case(opened, {"report": TRIAL, "name": NAME}, None)["causes"] == []
    )  # a trial is not diagnosed
    with pytest.raises(UnknownName, match=NAME):
        matching.show_case(opened, {"name": "roll_respons"}, None)


@pytest.mark.nightly
def test_models_and_databases_that_can_be_flown(opened):
    found = matching.show_match(opened, {}, None)
    work = ("match/datcom", "match/final", "databases/edited")
    assert [model["file"] for model in found["models"]] == [f"{{work}}/{name}.fmu" for name in work]
    assert [one["file"] for one in found["databases"]] == [
        "{work}/match/final.nc",
        "{work}/databases/edited.nc",
    ]


@pytest.mark.nightly
def test_a_report_is_read_again_when_it_has_changed(opened):
    first = matching.show_match(opened, {"report": TRIAL}, None)["cases"]
    (result,) = pom.read_archive(opened.work / TRIAL).results
    other = replace(result, case=replace(result.case, title="another title"))
    pom.write_report([other], opened.work / TRIAL, title="trial", paper=None)
    assert first[0]["title"] == "Roll response, clean"
    assert (
        matching.show_match(opened, {"report": TRIAL}, None)["cases"][0]["title"] == "another title"
    )
