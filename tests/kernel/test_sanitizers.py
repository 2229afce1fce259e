"""The kernel under sanitizers and fuzzers: kernel/fuzz/check.py, one check after the other."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CHECK = Path(__file__).parents[2] / "kernel" / "fuzz" / "check.py"
pytestmark = [pytest.mark.slow, pytest.mark.nightly]
SECONDS = os.environ.get("AEROMATCH_FUZZ_SECONDS", "20")


def checked(name: str, folder: Path) -> str:
    """Run one check and return what it prints."""
    command = [
        sys.executable,
        str(CHECK),
        "--only",
        name,
        "--seconds",
        SECONDS,
        "--keep",
        str(folder),
    ]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    if done.returncode and "no clang here" in done.stderr:
        pytest.skip(
            "no clang here; on Debian and Ubuntu: sudo apt-get install clang libclang-rt-dev"
        )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-8000:]
    return done.stdout


@pytest.mark.parametrize("sanitizer", ["address", "memory", "thread"])
def test_flights(sanitizer, tmp_path):
    """No fault, no leak, no number that was never set, no race; the same bits in every thread."""
    assert "threads alike" in checked(sanitizer, tmp_path)


@pytest.mark.parametrize("target", ["block", "calls", "fmu"])
def test_fuzzers(target, tmp_path):
    """Any block, any calls of the library, any calls of the FMU and any stored state: an answer or
    a refusal.
    """
    assert "inputs tried" in checked(target, tmp_path)
    assert not list(tmp_path.iterdir())
