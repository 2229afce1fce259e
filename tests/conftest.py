"""What tests of several packages share."""

import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """Perform the demo once, about a minute: its folder and the finished process; for tests marked slow only."""
    folder = tmp_path_factory.mktemp("demo") / "t37"
    command = [sys.executable, "-m", "aeromatch", "demo", "--json", "-o", str(folder)]
    return folder, subprocess.run(command, capture_output=True, text=True, timeout=600)
