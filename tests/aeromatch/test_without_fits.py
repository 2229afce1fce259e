"""A match of the a-priori model alone, and a match that proves nothing."""

import pytest

from aeromatch.cli.actions.examples import copy_example
from aeromatch.planning.match_plan import make_plan
from aeromatch.project.project import read_project
from aeromatch.workflow.steps import perform_match
from flightmech.errors import AeromatchWarning
from flightmech.support.console import show_progress


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c182") / "c182"
    copy_example("c182", folder)
    return read_project(folder / "aeromatch.toml").with_changes(fit=())


@pytest.mark.nightly
def test_without_a_fit_the_listings_are_proven(project, tmp_path):
    short_period = [case for case in project.cases if case.stem == "short_period"]
    few = project.with_changes(cases=tuple(short_period))
    assert make_plan(few, tmp_path / "out").problems == []
    with pytest.warns(AeromatchWarning, match="no term is identified"):
        outcome = perform_match(few, tmp_path / "out", 1, show_progress)
    (case,) = outcome.to_dict()["cases"]
    assert set(case["status"].values()) == {"fail"}
    assert outcome.corrected_terms == []
    assert outcome.report.is_file()
    assert not (tmp_path / "out" / "flown.nc").exists()


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:the project has no .*fit")
def test_without_a_case_there_is_no_report(project, tmp_path):
    bare = project.with_changes(cases=())
    plan = make_plan(bare, tmp_path / "out")
    assert plan.problems == []
    assert not any("report" in item for item in [*plan.steps, *plan.products])
    outcome = perform_match(bare, tmp_path / "out", 1, show_progress)
    assert outcome.report is None
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(plan.products)
