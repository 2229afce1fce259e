"""What tests of several packages share."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]
EXAMPLES = int(os.environ.get("AEROMATCH_EXAMPLES", "30"))  # of a property; .ci/run tries 100, and tests that need more take multiples
settings.register_profile("any load", deadline=None, max_examples=EXAMPLES)  # a busy machine is no fault of the code
settings.load_profile("any load")


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """Perform the demo once, about a minute: its folder and the finished process; for tests marked slow only."""
    folder = tmp_path_factory.mktemp("demo") / "fresh" / "out" / "t37"  # as deep as its copies in test_docs: reports name inputs relatively
    folder.parent.mkdir(parents=True)
    command = [sys.executable, "-m", "aeromatch", "demo", "--json", "-o", str(folder)]
    return folder, subprocess.run(command, capture_output=True, text=True, timeout=1800)


@pytest.fixture
def mat_files_in_this_process(monkeypatch):
    """Read MAT files without the child process that protects users from a crash of SciPy: it takes half a second a file."""
    from flightmech.support.input_files import mat_child, mat_file

    monkeypatch.setattr(mat_file, "_answer", mat_child.decode)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item):
    """Give all tests of a folder that need absent material of ``../shared`` one reason, so that ``-rs`` prints one line a folder."""
    report = (yield).get_result()
    if report.skipped and isinstance(report.longrepr, tuple) and "../shared" in report.longrepr[2]:
        folder = ROOT.joinpath(*report.nodeid.partition("::")[0].split("/")[:2])
        report.longrepr = str(folder), None, "Skipped: needs ../shared, material that is not part of the repository"
