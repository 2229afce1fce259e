"""Selection, output error and the board of models: the page and the commands have the same
numbers.
"""

import json
import os
import sys
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from bench import reconstructed_project

from aeromatch.workbench import identification as page
from aeromatch.workbench.actions import LoggedAction, demand_allowed, last_match, make_folders
from aeromatch.workbench.models.kept_paths import has_newer_paths, list_older_paths
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.kept_stages.stages import NotStored, Stages
from flightmech.support.kept_stages.store import StageStore
from flighttest.cli.group import flight

RECORD = "t37_01_clean_low_speed_5kft"


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opened")
    project = reconstructed_project(folder / "t37", folder / "work", [RECORD])
    return OpenProject(project, folder / "work")


def call(opened, path, body=None, method="POST", **query):
    return page.ROUTES[(method, path)](opened, query, body)


def run(opened, words, file):
    """Run a command of the page as the server does, in this process."""
    words = [*words, "-o", file]
    demand_allowed(words, opened.places)
    make_folders(words, opened.places)
    done = CliRunner().invoke(flight, opened.places.real(words)[1:], catch_exceptions=False)
    assert done.exit_code in (0, 1), done.output


@pytest.mark.slow
@pytest.mark.nightly
def test_the_loop_of_the_page_is_that_of_the_commands(opened):
    fitted = [{"record": RECORD, "start": 9.0, "end": 21.7}]
    other = [{"record": RECORD, "start": 39.4, "end": 49.0}]
    chosen = {"windows": fitted, "coefficient": "Cm", "variables": "alpha qhat delta_e",
              "method": "stepwise", "cutoff": 4.0}  # fmt: skip
    found = call(opened, "/api/select", chosen)
    run(opened, found["command"], "{work}/fits/pitch.nc")
    saved = call(opened, "/api/model", method="GET", model="{work}/fits/pitch.nc")
    assert saved["text"] == found["model"]
    assert found["steps"][-1]["terms"] == len(saved["rows"])
    motion = call(opened, "/api/motion", {"windows": fitted, "motion": "short-period"})
    run(opened, motion["command"], "{work}/fits/oe.nc")
    request = {"models": ["{work}/fits/pitch.nc", "{work}/fits/oe.nc"], "windows": other + fitted}
    board = call(opened, "/api/board", {**request, "cutoff": 4.0})
    summary = {row["model"]: row for row in board["summary"]}
    assert summary["pitch"]["R2"] > 0.9
    assert summary["oe"]["parameters"] == 5
    # The windows of the fits are named, and are not in the figures.
    used = [row for row in board["rows"] if row["remarks"].startswith("in the fit")]
    assert {row["window"] for row in used} == {f"{RECORD} 9-21.68 s"}
    totals = [row for row in board["rows"] if row["window"] == "all"]
    assert {row["samples"] for row in totals} == {480}
    run(opened, board["command"], "{work}/boards/board.csv")
    table = pd.read_csv(opened.work / "boards" / "board.csv")
    assert list(table["R2"]) == pytest.approx([row["R2"] for row in board["rows"]], rel=1e-9)
    assert list(table["model"]) == [row["model"] for row in board["rows"]]
    # The fit on the screen has the figures of its saved form.
    body = {"windows": fitted, "model": found["model"], "cutoff": 4.0}
    shown = call(opened, "/api/fit/validation", {"fit": body, "windows": other})
    assert shown["summary"][0]["R2"] == pytest.approx(summary["pitch"]["R2"], rel=1e-9)
    lines = call(opened, "/api/prediction", {**request, "cutoff": 4.0})
    assert [one["channel"] for one in lines["channels"]] == ["Cm"]
    json.dumps(motion)


@pytest.mark.nightly
def test_requests_that_cannot_be_answered(opened):
    windows = [{"record": RECORD, "start": 9.0, "end": 21.7}]
    with pytest.raises(SchemaError, match="no candidates"):
        call(opened, "/api/select", {"windows": windows, "coefficient": "Cm"})
    with pytest.raises(SchemaError, match="there are CL"):
        call(opened, "/api/select", {"windows": windows, "coefficient": "q", "variables": "alpha"})
    with pytest.raises(UnknownName):
        call(opened, "/api/board", {"models": ["{project}/aircraft.toml"], "windows": windows})
    with pytest.raises(SchemaError, match="motion"):
        call(opened, "/api/motion", {"windows": windows, "motion": "phugoid"})
    with pytest.raises(SchemaError):
        call(opened, "/api/board", ["no mapping"])


@pytest.mark.nightly
def test_older_paths_are_named(opened):
    """A path older than its recording, and a match that came after the paths."""
    assert list_older_paths(opened) == []
    os.utime(opened.path_file(RECORD), (1e9, 1e9))
    assert list_older_paths(opened) == [RECORD]
    assert not has_newer_paths(opened, [RECORD])
    (opened.work / "match" / "final.nc").write_bytes(b"")
    assert has_newer_paths(opened, [RECORD])
    os.utime(opened.path_file(RECORD))
    assert not has_newer_paths(opened, [RECORD])
    assert not has_newer_paths(opened, [])


def test_nothing_is_computed_where_only_the_store_is_asked(tmp_path):
    store = StageStore(tmp_path / "store")
    with pytest.raises(NotStored, match="record a is not in the store"):
        Stages(store, only_stored=True).one("record", {"file": 1}, lambda: 2, item="a")
    Stages(store).one("record", {"file": 1}, lambda: 2, item="a")
    assert Stages(store, only_stored=True).one("record", {"file": 1}, lambda: 3, "a").value == 2
    with pytest.raises(NotStored):
        Stages(only_stored=True).one("record", {"file": 1}, lambda: 2)


def test_paths_are_not_the_match_of_a_log():
    match = LoggedAction(1, ("match", "p.toml", "-o", "{work}/match"), code=0, files={})
    paths = LoggedAction(2, ("match", "p.toml", "--paths", "-o", "{work}/paths"), code=0, files={})
    assert last_match([match, paths]) is match
    assert last_match([paths]) is None
