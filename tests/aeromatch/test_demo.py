"""The whole job on the shipped example."""

import json

import pytest

import aerodb
import pom


@pytest.mark.slow
def test_the_demo_writes_what_it_promises(demo):
    folder, run = demo
    assert run.returncode == 0, run.stderr
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    models = {f"{name}.{kind}" for name in ("datcom", "corrected", "final") for kind in ("nc", "fmu")}
    results = json.loads((folder / "report" / "results.json").read_text())["results"]
    assert len(results) == 12
    report = {"report.html", "report.pdf", "results.json", "results.nc", "results.xml", "manifest.json"}
    report |= {f"csv/{item['case']['name']}.csv" for item in results}
    assert names == models | {f"report/{name}" for name in report}
    assert {item.state for item in pom.verify(folder / "report")} == {"same"}
    for name in ("datcom", "corrected", "final"):
        assert aerodb.check(aerodb.open(folder / f"{name}.nc")) == []


@pytest.mark.slow
def test_flight_makes_the_model_better(demo):
    _, run = demo
    outcome = json.loads(run.stdout)
    passes = {name: sum(case["status"][name] == "pass" for case in outcome["cases"]) for name in ("datcom", "corrected", "final")}
    assert passes["datcom"] < passes["corrected"] <= passes["final"]
    assert outcome["corrected_terms"]
    assert all(case["failure"] == "" for case in outcome["cases"])


@pytest.mark.slow
def test_every_step_is_reported_on_its_own_line(demo):
    _, run = demo
    steps = [line for line in run.stderr.splitlines() if " ... " in line]
    assert len(steps) == 9
    assert all(line.endswith(" s") for line in steps)
