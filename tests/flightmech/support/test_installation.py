"""A package that another of the same name hides is reported at import and refused on the command
line.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flightmech.support.imports import hidden_packages

ROOT = Path(__file__).parents[3]


def test_nothing_is_hidden_here():
    assert hidden_packages() == {}


@pytest.fixture
def hiding(tmp_path):
    """Folder of a script next to which a file ``pom.py`` lies."""
    (tmp_path / "pom.py").write_text("answer = 42\n", encoding="utf-8")
    return tmp_path


def run(folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_import_warns_with_the_place_of_the_other(hiding):
    done = run(hiding, "-c", "import flightmech")
    assert done.returncode == 0
    assert "AeromatchWarning: Python would import 'pom' from" in done.stderr
    assert "pom.py, not from" in done.stderr


def test_command_line_refuses(hiding):
    done = run(
        hiding,
        "-c",
        "import sys; from aeromatch.cli import main; sys.argv = ['aeromatch', '--help']; main()",
    )
    assert done.returncode == 2
    assert "'pom' from" in done.stderr
    assert done.stdout == ""
