"""The record of a finished match: it holds for the very same inputs, program, settings and outputs
only.
"""

import os

import pytest

from aeromatch.rebuilding import finished
from aeromatch.rebuilding.finished import Finished, Watched

SETTINGS = {"command": "aeromatch match", "samples": 0}


@pytest.fixture
def project(tmp_path):
    """A project file that names files directly, by patterns, as cases of listings, and in a file
    that it names.
    """
    folder = tmp_path / "project"
    (folder / "cases").mkdir(parents=True)
    files = {
        "aeromatch.toml": 'title = "T"\naircraft = "aircraft.toml"\nflights = "*.csv"\ncases = '
        '["cases/*.toml"]\n'
        '[listings]\nclean = "clean.out:2"\n',
        "aircraft.toml": '[[engine]]\ndeck = "engine.nc"\n',
        "engine.nc": "deck",
        "clean.out": "listing",
        "a.csv": "1",
        "cases/one.toml": 'record = "../a.csv"\n[control_law]\nfmu = "../damper.fmu"\n',
        "damper.fmu": "law",
        "unrelated.txt": "words",
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder / "aeromatch.toml"


@pytest.fixture
def done(project, tmp_path):
    """A finished match."""
    output = tmp_path / "out"
    (output / "report").mkdir(parents=True)
    for name in ("final.nc", "report/report.html"):
        (output / name).write_text(name)
    record = Finished(tmp_path / "store", output)
    record.write(
        Watched(project),
        SETTINGS,
        [output / "final.nc", output / "report" / "report.html"],
        {"lines": ["done"]},
    )
    return record


def test_every_file_that_a_project_rests_on_is_watched(project):
    names = {os.path.relpath(file, project.parent) for file in Watched(project).files}
    assert names == {
        "aeromatch.toml",
        "aircraft.toml",
        "engine.nc",
        "clean.out",
        "a.csv",
        "cases/one.toml",
        "damper.fmu",
    }


def test_a_match_of_which_nothing_changed_is_shown_again(project, done):
    assert done.read(Watched(project), SETTINGS) == {"lines": ["done"]}
    os.utime(project, (1.0, 1.0))  # a time is no content
    (project.parent / "unrelated.txt").write_text("other words")
    assert done.read(Watched(project), SETTINGS) == {"lines": ["done"]}


@pytest.mark.parametrize(
    "name",
    [
        "aeromatch.toml",
        "engine.nc",
        "clean.out",
        "a.csv",
        "damper.fmu",
        "new.csv",
        "cases/two.toml",
    ],
)
def test_whatever_changes_lets_the_match_run(project, done, name):
    with (project.parent / name).open("a") as file:
        file.write("# more\n")
    assert done.read(Watched(project), SETTINGS) is None


def test_another_setting_program_or_arithmetic_lets_the_match_run(project, done, monkeypatch):
    watched = Watched(project)
    assert done.read(watched, {**SETTINGS, "samples": 5}) is None
    for name in ("hash_installation", "hash_arithmetic"):
        with monkeypatch.context() as patch:
            patch.setattr(finished, name, lambda: "another")
            assert done.read(watched, SETTINGS) is None
    assert done.read(watched, SETTINGS) is not None


@pytest.mark.parametrize("harm", ["changed", "gone", "record", "no record"])
def test_an_output_or_a_record_that_is_not_intact_lets_the_match_run(project, done, tmp_path, harm):
    page = tmp_path / "out" / "report" / "report.html"
    if harm == "changed":
        page.write_text("other")
    elif harm == "gone":
        page.unlink()
    elif harm == "record":
        done._file.write_bytes(done._file.read_bytes().replace(b'"done"', b'"pass"'))
    else:
        done.forget()
    assert done.read(Watched(project), SETTINGS) is None


def test_an_input_that_changes_while_the_match_runs_is_noticed(project):
    watched = Watched(project)
    assert watched.unchanged()
    (project.parent / "b.csv").write_text("1")
    assert not watched.unchanged()
    (project.parent / "b.csv").unlink()
    assert watched.unchanged()
    (project.parent / "a.csv").write_text(
        "1"
    )  # the same again: it may have been another in between
    assert not watched.unchanged()
