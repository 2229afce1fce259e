"""A data package of files that the match did not use is refused."""

import json
from types import SimpleNamespace

import pytest

from aeromatch.workflow import match_inputs
from flightmech.errors import SchemaError
from flightmech.support.input_files import file_sha256
from pom.archive.origins import BUILD


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Return a project of four files, whose match has used three of them."""
    names = ("aeromatch.toml", "aircraft.toml", "flight.csv", "unused.csv")
    files = [tmp_path / name for name in names]
    for file in files:
        file.write_text(file.name)
    (tmp_path / "out" / "report").mkdir(parents=True)
    used = [
        {"name": f"sub/{file.name}", "digest": {"sha256": file_sha256(file)}} for file in files[:3]
    ]
    model = {"name": "final.fmu", "digest": {"sha256": "0"}, "annotations": {"run": "final"}}
    statement = {
        "subject": [],
        "predicate": {
            "buildDefinition": {"buildType": BUILD, "resolvedDependencies": [*used, model]}
        },
    }
    (tmp_path / "out" / "report" / "manifest.json").write_text(json.dumps(statement))

    def inputs_of(project, names, cases):
        return [*files[:2], *(project.flights[name] for name in names)]

    monkeypatch.setattr(match_inputs, "inputs_of", inputs_of)
    flights = {"flight": files[2], "unused": files[3]}
    return SimpleNamespace(file=files[0], flights=flights, cases=())


def test_files_edited_after_the_match_are_named(project, tmp_path):
    match_inputs.demand_match_of_project(project, tmp_path / "out")
    (tmp_path / "unused.csv").write_text("no part of the match used it")
    match_inputs.demand_match_of_project(project, tmp_path / "out")
    for name in ("aircraft.toml", "flight.csv"):
        (tmp_path / name).write_text("edited")
    with pytest.raises(SchemaError) as caught:
        match_inputs.demand_match_of_project(project, tmp_path / "out")
    first, second, remedy = caught.value.problems
    assert "aircraft.toml: it was changed after the match" in first
    assert "flight.csv: it was changed after the match" in second
    assert "run `aeromatch match " in remedy


def test_a_file_that_the_match_has_not_is_named(project, tmp_path):
    other = tmp_path / "commuter.toml"
    other.write_text("another project")
    project.flights["flight"] = other
    match_inputs.demand_match_of_project(project, tmp_path / "out")
    (tmp_path / "aircraft.toml").rename(tmp_path / "aeroplane.toml")
    manifest = tmp_path / "out" / "report" / "manifest.json"
    manifest.write_text(manifest.read_text().replace("aircraft.toml", "other.toml"))
    (tmp_path / "aircraft.toml").write_text("x")
    with pytest.raises(SchemaError, match=r"aircraft\.toml: the match did not use a file of this"):
        match_inputs.demand_match_of_project(project, tmp_path / "out")
