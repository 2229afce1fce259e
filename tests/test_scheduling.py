"""Tests of one file run in one process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
CONFTEST = """
from scheduling import FileScheduling

def pytest_xdist_make_scheduler(config, log):
    return FileScheduling(config, log)
"""
# each test writes its file and its process
TESTS = """
import os
import pytest

@pytest.mark.parametrize("number", range(8))
def test_place(number, worker_id):
    with open("places.txt", "a") as file:
        file.write(os.path.basename(__file__) + " " + worker_id + "\\n")
"""


@pytest.mark.nightly
def test_a_file_is_run_by_one_process_and_two_files_by_two(tmp_path):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    for name in ("test_a.py", "test_b.py"):
        (tmp_path / name).write_text(TESTS)
    # a worker of this run has variables that a run of its own must not see
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadfile"],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(HERE)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    places = (tmp_path / "places.txt").read_text().split("\n")[:-1]
    assert len(places) == 16
    assert len({place.split()[0] for place in places}) == len(set(places)) == 2
    assert len({place.split()[1] for place in places}) == 2
