"""A process that is killed while it writes databases, models and their report: they are always of
one job.
"""

import json
import os

import pytest
import report_fixture as fixture
import write_calls

import pom
from flightmech.support.atomic_write import folder_written_atomically
from pom.archive.origins import file_sha256

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL of POSIX")


def job(folder, number, result):
    """Write a model and the report on it, as `aeromatch match` does."""
    with folder_written_atomically(folder, own=["final.fmu", "report"].__contains__) as new:
        (new / "final.fmu").write_text(f"model {number}")
        made_from = pom.provenance([], {"final": new / "final.fmu"})
        pom.write_report(
            [result], new / "report", title=f"job {number}", provenance=made_from, paper=None
        )


def report_killed_at_each_call(folder):
    """Write a second job over the first and be killed; both files and report are those of one job,
    then as after it.
    """
    result, out = fixture.roll_result(), folder / "out"
    job(out, 0, result)
    before = {file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}
    titles = []
    for number in write_calls.each_call(lambda: job(out, 1, result), folder):
        titles.append(title_of_job(out))
        if titles[-1] == "job 0":
            assert {file: file.read_bytes() for file in before} == before, f"call {number}"
        else:
            job(out, 0, result)
        for rest in folder.iterdir():
            assert rest == out or rest.name.endswith(".part"), f"call {number}: {rest}"
    job(out, 0, result)
    assert [path.name for path in folder.iterdir()] == ["out"]
    assert titles.count("job 0") > 50
    assert titles.count("job 1") > 0


def title_of_job(out):
    """Return the title of the report in a folder, after a check that report and model belong
    together.
    """
    report = out / "report"
    statement = json.loads((report / "manifest.json").read_text())
    files = [file for file in report.rglob("*") if file.is_file() and file.name != "manifest.json"]
    subjects = {item["name"]: item["digest"]["sha256"] for item in statement["subject"]}
    assert subjects == {file.relative_to(report).as_posix(): file_sha256(file) for file in files}
    definition = statement["predicate"]["buildDefinition"]
    assert definition["resolvedDependencies"][0]["digest"]["sha256"] == file_sha256(
        out / "final.fmu"
    )
    title = definition["externalParameters"]["title"]
    assert f"model {title.split()[1]}" == (out / "final.fmu").read_text()
    return title


@pytest.mark.serial
@pytest.mark.nightly  # .ci/run kills at the write calls of common verbs
def test_a_killed_job_mixes_nothing(tmp_path):
    write_calls.run_preloaded(report_killed_at_each_call, tmp_path)
