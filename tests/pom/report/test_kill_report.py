"""A process that is killed while it writes databases, models and their report: they are always of one job."""

import json
import os
import random
import signal
import time

import pytest
import report_fixture as fixture

import pom
from flightmech.support.atomic_write import folder_written_atomically
from pom.archive.origins import sha256

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL of POSIX")


def job(folder, number, result):
    """Write a model and the report on it, as `aeromatch match` does."""
    with folder_written_atomically(folder, own=["final.fmu", "report"].__contains__) as new:
        (new / "final.fmu").write_text(f"model {number}")
        made_from = pom.provenance([], {"final": new / "final.fmu"})
        pom.write_report([result], new / "report", title=f"job {number}", provenance=made_from, paper=None)


@pytest.mark.slow
def test_sixty_kills_mix_nothing(tmp_path):
    folder, result, drawn = tmp_path / "out", fixture.roll_result(), random.Random(16)
    job(folder, 0, result)
    seen = set()
    for number in range(1, 61):
        child = os.fork()
        if child == 0:
            try:
                for part in range(100):
                    job(folder, 100 * number + part, result)
            finally:
                os._exit(1)
        time.sleep(drawn.uniform(0.2, 0.8))
        os.kill(child, signal.SIGKILL)
        assert os.waitpid(child, 0)[1] == signal.SIGKILL
        report = folder / "report"
        statement = json.loads((report / "manifest.json").read_text())
        assert {item["name"]: item["digest"]["sha256"] for item in statement["subject"]} == {
            file.relative_to(report).as_posix(): sha256(file)
            for file in report.rglob("*")
            if file.is_file() and file.name != "manifest.json"
        }
        definition = statement["predicate"]["buildDefinition"]
        assert definition["resolvedDependencies"][0]["digest"]["sha256"] == sha256(folder / "final.fmu")
        assert f"model {definition['externalParameters']['title'].split()[1]}" == (folder / "final.fmu").read_text()
        seen.add(definition["externalParameters"]["title"])
    assert len(seen) > 10, "jobs must have come to their end, or nothing was tested"
    job(folder, 1, result)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
