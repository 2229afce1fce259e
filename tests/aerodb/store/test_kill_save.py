"""A process that is killed while it saves, and a disk that is full: the older file or the new one is there, whole, never a third thing."""

import os
import random
import resource
import signal
import time

import pytest
import xarray as xr

import aerodb
from flightmech import terms

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL of POSIX")


@pytest.fixture
def pair(small):
    """Return two databases that differ in every number."""
    changed = {name: leaf.assign(value=leaf["value"] * 2.0 + 1.0) for name, leaf in aerodb.terms(small).items()}
    big = terms.make([[float(i + j) for i in range(60)] for j in range(60)], {"mach": range(60), "alpha": range(60)}, history="y" * 20_000)
    changed["CD/basic"] = big
    return small, aerodb.database(changed, **{**small.attrs, "title": "another"})


def killed_while(work, moment):
    """Repeat `work` in a child process and kill it after a time. [s]"""
    child = os.fork()
    if child == 0:
        try:
            while True:
                work()
        finally:
            os._exit(1)  # only a fault of the work comes here: SIGKILL leaves no time to
    time.sleep(moment)
    assert os.waitpid(child, os.WNOHANG) == (0, 0), "the child must still be at work"
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


@pytest.mark.slow
def test_a_killed_save_leaves_the_old_file_or_the_new_one(pair, tmp_path):
    path = tmp_path / "db.nc"
    aerodb.save(pair[0], path)
    moments = random.Random(4)
    found = [0, 0]

    def work():
        for db in reversed(pair):
            aerodb.save(db, path)

    while sum(found) < 60 or (min(found) < 5 and sum(found) < 400):
        killed_while(work, moments.uniform(0.0, 0.15))
        there = aerodb.open(path)  # checks the seal over every byte
        same = [there.identical(db) for db in pair]
        assert sum(same) == 1
        found[same.index(True)] += 1
    assert min(found) >= 5, "both files must have been caught, or nothing was tested"
    left = [name for name in os.listdir(tmp_path) if name != "db.nc"]
    assert all(name.startswith(".db.nc.") and name.endswith(".part") for name in left)


def test_what_a_kill_leaves_behind_does_no_harm(pair, tmp_path):
    path = tmp_path / "db.nc"
    (tmp_path / ".db.nc.0badcafe.part").write_bytes(b"\x89HDF half of a file")
    aerodb.save(pair[1], path)
    xr.testing.assert_identical(aerodb.open(path), pair[1])
    assert [file.name for file in tmp_path.glob("*.nc")] == ["db.nc"]


def in_a_child(work):
    """Return the exit code of a child process that does `work`: what it returns."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.parametrize("room", [0, 1, 4096, 40_000])
def test_a_full_disk_leaves_the_old_file(pair, tmp_path, room):
    path = tmp_path / "db.nc"
    aerodb.save(pair[0], path)
    before = path.read_bytes()

    def work():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        try:
            aerodb.save(pair[1], path)
        except OSError:
            return 7
        return 0

    assert in_a_child(work) == 7
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["db.nc"]
