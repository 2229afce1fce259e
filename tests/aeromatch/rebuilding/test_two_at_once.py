"""Two matches into one output folder: the second waits for the end of the first."""

import subprocess
import sys

import pytest

from aeromatch.rebuilding.finished import Finished

# A process that holds the lock until its input ends.
_HOLDER = """
import fcntl, sys
lock = open(sys.argv[1], "a")
fcntl.lockf(lock, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other locks")


def never():
    raise AssertionError("nobody else writes into the folder")


def test_a_match_waits_for_another_one_in_its_folder(tmp_path):
    finished = Finished(tmp_path / "store", tmp_path / "out")
    with finished.alone(never):
        (lock,) = (tmp_path / "store" / "finished").glob("*.lock")
        # a match into another folder does not wait
        with Finished(tmp_path / "store", tmp_path / "other").alone(never):
            pass
    events = []
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(lock)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "held\n"

        def announce():
            events.append("waits")
            holder.stdin.close()

        with finished.alone(announce):
            events.append("runs")
            assert holder.wait() == 0
    assert events == ["waits", "runs"]


def test_a_killed_match_leaves_no_lock(tmp_path):
    finished = Finished(tmp_path / "store", tmp_path / "out")
    with finished.alone(never):
        (lock,) = (tmp_path / "store" / "finished").glob("*.lock")
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(lock)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "held\n"
        holder.kill()
    with finished.alone(never):
        pass
