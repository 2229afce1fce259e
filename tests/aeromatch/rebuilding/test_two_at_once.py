"""Two matches into one output folder: the second waits for the end of the first."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from aeromatch.rebuilding import finished as finished_module
from aeromatch.rebuilding.finished import Finished

# A process that holds the lock until its input ends.
_HOLDER = """
import fcntl, sys
lock = open(sys.argv[1], "a")
fcntl.lockf(lock, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""
of_posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other locks")


def never():
    raise AssertionError("nobody else writes into the folder")


@of_posix
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


@of_posix
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


def test_a_match_waits_on_windows(tmp_path, monkeypatch):
    """There the lock is one byte, and no call waits for it: it is requested again and again."""
    answers = [PermissionError(13, "held"), PermissionError(13, "held"), None]
    events = []

    def locking(handle, kind, size):
        events.append((kind, size))
        answer = answers.pop(0)
        if answer is not None:
            raise answer

    monkeypatch.setattr(finished_module.sys, "platform", "win32")
    fake = SimpleNamespace(locking=locking, LK_NBLCK=2)
    monkeypatch.setattr(finished_module, "msvcrt", fake, raising=False)
    monkeypatch.setattr(finished_module.time, "sleep", lambda seconds: events.append("pause"))
    finished = Finished(tmp_path / "store", tmp_path / "out")
    with finished.alone(lambda: events.append("waits")):
        events.append("runs")
    assert events == [(2, 1), "waits", (2, 1), "pause", (2, 1), "runs"]


def test_two_matches_run_on_windows_without_locks(tmp_path, monkeypatch):
    """A network drive may answer that it has no locks: the match does not wait for ever."""

    def locking(handle, kind, size):
        raise OSError(22, "no locks here")

    monkeypatch.setattr(finished_module.sys, "platform", "win32")
    fake = SimpleNamespace(locking=locking, LK_NBLCK=2)
    monkeypatch.setattr(finished_module, "msvcrt", fake, raising=False)
    with Finished(tmp_path / "store", tmp_path / "out").alone(never):
        pass
